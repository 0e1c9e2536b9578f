"""`roslf calibrate` on images rendered of a camera whose lengths are known, and its refusals."""

import json
import re
import shutil
from functools import partial

import numpy as np
import pytest
import tifffile
from PIL import Image

import roslf_design as roslf
from roslf_design.calibration import Board, CalibrationError, Captures, outcome
from roslf_design.calibration.frames import read_capture, read_image
from roslf_design.calibration.planning import too_large
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.commands.terminal import json_text
from roslf_design.depth.geometry import calibration_sigma
from roslf_design.design import load, save
from roslf_design.imaging.files import write_image
from roslf_design.imaging.render import render
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.length_covariance import LengthCovariance
from roslf_design.words import uncertainty
from tests.bench.made import BOARD, CELL, RAYS, SAMPLING, board_scene, picture
from tests.bench.made import POSES as FOUR_POSES
from tests.bench.made import small as small_camera
from tests.depth.made import at_first_sight
from tests.docs.described import undescribed
from tests.reporting.made import few_builds, few_waves

pytestmark = pytest.mark.usefixtures("found_once")
POSES = [*FOUR_POSES, (12, -24, -20)]
NAMES = (
    *("quantities", "ruler", "variance_shares", "r_hat", "bulk_ess", "tail_ess", "fit", "steps_one_and_two", "joint"),
    *("ways_apart_sigma", "without", "elements", "off_sigma", "microlenses"),
)
"""Objects in calibration.json whose keys are names: of lengths, parameters, sources, images."""


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture(scope="module")
def small():
    return small_camera()


@pytest.fixture(scope="module")
def captured(small, tmp_path_factory):
    """A folder of rendered images, the last without a board; the design file beside it."""
    place = tmp_path_factory.mktemp("calibrate")
    save(small, place / "small.toml")
    folder = place / "images"
    folder.mkdir()
    write_image(picture(), folder / "white.tif")
    for number, pose in enumerate(POSES, 1):
        write_image(picture(pose), folder / f"board{number}.tif")
    shutil.copy(folder / "white.tif", folder / "board6.tif")
    return place


@pytest.fixture
def images(captured, tmp_path):
    """A copy of the images to spoil."""
    return shutil.copytree(captured / "images", tmp_path / "images")


def test_lengths_of_a_rendered_camera_come_back(capsys, captured, small, tmp_path, monkeypatch):
    # Sampling ends by its own measures, at which it looks three times as often.
    monkeypatch.setattr(outcome, "sample_posterior", partial(outcome.sample_posterior, chunk=160))
    out = tmp_path / "out"
    code, said, err = run(
        capsys, "calibrate", captured / "images", "--design", captured / "small.toml", "--board", BOARD, "-o", out
    )
    assert (code, err) == (0, "")
    assert "board6.tif" in said
    for words in ("68 % interval", "Calibrated against the design", "Board by board"):
        assert words in said
    result = json.loads((out / "calibration.json").read_text())
    assert not undescribed(result, NAMES)
    assert [warning for warning in result["warnings"] if "design" in warning] == []
    assert max(result["residual_scales"].values()) < 2
    assert [board["image"] for board in result["boards"]] == result["images_used"]
    assert result["schema"] == "roslf.calibration/1"
    truth = {"H": small.d_1 / 92 * 3, "d_3": small.d_3, "d_1": small.d_1, "d_f": small.d_f, "m": 0.4}
    for name, true in truth.items():
        found = result["quantities"][name]
        low, high = found["interval_95"]
        assert low < true < high, name
        assert low < found["interval_68"][0] < found["estimate"] < found["interval_68"][1] < high
        assert found["r_hat"] < 1.01
        assert found["ess"] > 400
        assert sum(found["variance_shares"].values()) == pytest.approx(1)
    # Interpolation between microlenses biases slopes by parts of a per cent, which scatter does not show.
    assert result["quantities"]["d_2"]["estimate"] == pytest.approx(2.0, rel=0.02)
    assert result["quantities"]["A"]["estimate"] == pytest.approx(92 / 3, rel=0.01)
    assert result["converged"] is True
    # What depth does with the lengths' covariance is what the posterior's draws do, but for second orders.
    covariance = LengthCovariance(tuple(result["covariance"]["places"]), np.array(result["covariance"]["matrix"]))
    errors = result["depth_errors_mm"]
    told = calibration_sigma(load(out / "calibrated.toml"), covariance, np.array(errors["distance"]))
    np.testing.assert_allclose(told, errors["from_lens"], rtol=1e-3)
    # What measurements alone tell and what was known before make up the posterior, of 400 independent draws or more.
    told = result["covariance"]["information"]
    seen = LengthCovariance(tuple(told["places"]), np.array(told["matrix"])).of(covariance.places)
    sheet = dict(zip(told["places"], told["sheet_sigma"], strict=True)) | {"sensor.pixel": 0.0}
    before = np.diag([1e6 if sheet[place] is None else sheet[place] ** 2 for place in covariance.places])
    after = LengthCovariance(covariance.places, before).informed(seen.matrix)
    np.testing.assert_allclose(np.diag(after.matrix), np.diag(covariance.matrix), rtol=0.2, atol=1e-20)
    assert result["images_missing"] == ["board6.tif"]
    assert result["images_used"] == [f"board{n}.tif" for n in range(1, 6)]
    assert result["reprojection_rms_pitches"] < 0.06
    written = load(out / "calibrated.toml")
    assert written.d_3 == pytest.approx(result["quantities"]["d_3"]["estimate"])
    assert written.f == pytest.approx(small.f, rel=1e-12)  # written to 13 digits
    assert written.d_f == pytest.approx(result["quantities"]["d_f"]["estimate"])
    assert "d_3 = 4" in written.source
    for name in ("residuals", "epi-lines", "posterior", "depth"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert b"<svg" in (out / f"{name}.svg").read_bytes()
    page = (out / "index.html").read_text()
    assert page.count("<svg") == 4
    assert "Run again" in page


def test_without_posterior_the_same_bytes_and_gaussian_intervals(capsys, captured, tmp_path, found_once):
    out = tmp_path / "a"
    options = ["--design", captured / "small.toml", "--board", BOARD, "-o", out, "--no-posterior", "--json"]
    code, said, _ = run(capsys, "calibrate", captured / "images", *options, "--f-sigma", "0.5 mm")
    assert code == 0
    assert json.loads(said)["accuracy"].pop("seconds") > 0  # printed only: files repeat themselves
    names = ["depth.png", "epi-lines.png", "posterior.png", "residuals.png"]
    assert sorted(p.name for p in out.iterdir() if p.suffix == ".png") == names
    assert "Laplace" in (out / "posterior.svg").read_text()
    text = (out / "calibration.json").read_text()
    found_once.clear()
    options = {"f_sigma": "0.5 mm", "distortion": 0, "posterior": False}
    again = roslf.calibrate(captured / "images", captured / "small.toml", BOARD, **options)
    assert f"{json_text(again.to_dict())}\n" == text
    result = json.loads(text)
    assert result["converged"] is None
    assert result["intervals_from"] == "Fisher matrix (Laplace)"
    assert len(result["depth_errors_mm"]["from_lens"]) == len(result["depth_errors_mm"]["distance"])
    assert result["data_sheet"]["f_sigma_mm"] == 0.5
    d_3 = result["quantities"]["d_3"]
    # To first order an error of f reaches d_3 magnified by 1 + 1/m.
    assert d_3["sigma"] == pytest.approx(0.5 * 3.5, rel=0.05)
    assert d_3["interval_95"][1] - d_3["estimate"] == pytest.approx(1.96 * d_3["sigma"], rel=1e-4)


def test_a_design_of_another_camera_is_noticed(capsys, captured, tmp_path):
    options = ["--design", "paper", "--board", BOARD, "-o", tmp_path / "out", "--no-posterior", "--json"]
    code, said, _ = run(capsys, "calibrate", captured / "images", *options)
    assert code == 0
    pitch, missing = json.loads(said)["warnings"]
    assert "6.413 px apart, and the design says 12.939 px" in pitch
    assert "board6.tif" in missing


def test_cells_told_wrong_are_not_passed_over(capsys, captured, tmp_path):
    """Right ones bring no warning: those of the camera whose lengths come back, above."""
    out = tmp_path / "out"
    options = ["--design", captured / "small.toml", "--board", f"7x6 {1.07 * CELL} mm", "-o", out, "--no-posterior"]
    code, said, err = run(capsys, "calibrate", captured / "images", *options)
    assert (code, err) == (0, "")
    assert "Calibrated against the design" in said
    assert "Board by board" in said
    wrong = json.loads((out / "calibration.json").read_text())
    d_2 = wrong["quantities"]["d_2"]
    assert d_2["design"] == 2.0
    # Cells 7 % too large make d_2 and m 7 % too small; the data sheet and the images know them to half a per cent.
    assert d_2["off_design_sigma"] == pytest.approx((d_2["estimate"] - 2.0) / d_2["sigma"])
    assert d_2["off_design_sigma"] < -10
    (warning,) = [warning for warning in wrong["warnings"] if "far from the design" in warning]
    assert "if the board's cells measured 1.7 mm, not 1.819 mm" in warning


def test_calibrated_in_air_used_in_water(capsys, captured, small, tmp_path):
    """Behind a flat window the images are those of the camera without it; in water the way from it is n-fold."""
    window = {"kind": "plate", "distance": small.d_3 + 1, "thickness": 1.0, "material": {"index": 1.5}}
    save(small.replace({"elements": [window]}, d_1=small.d_1), tmp_path / "dry.toml")
    out = tmp_path / "out"
    options = ["--design", tmp_path / "dry.toml", "--board", BOARD, "-o", out, "--no-posterior", "--use-in", "1.333"]
    code, said, err = run(capsys, "calibrate", captured / "images", *options)
    assert (code, err) == (0, "")
    assert "used in a medium of n = 1.333: depths there would be off by -25.0 %" in " ".join(said.split())
    result = json.loads((out / "calibration.json").read_text())
    assert not undescribed(result, NAMES)
    end, used, ruler = small.d_3 + 2, result["used_in"], result["ruler"]
    distances, told = np.array(used["distances_mm"]), np.array(used["uncorrected_mm"])
    np.testing.assert_allclose((told - end) / (distances - end), 1 / 1.333, rtol=1e-9)
    wet = load(out / "calibrated.toml")
    assert wet.object_space.medium.index(5.5e-4) == pytest.approx(1.333)
    assert wet.d_1 == pytest.approx(ruler["d_1"]["estimate"])
    # Focused at 117 mm in air, a third of a millimetre of which is the window's.
    assert ruler["d_f"]["estimate"] == pytest.approx(small.d_f + 1 / 3, abs=3 * ruler["d_f"]["sigma"])
    assert wet.d_f == pytest.approx(end + 1.333 * (ruler["d_f"]["estimate"] - end), rel=1e-9)
    page = (out / "index.html").read_text()
    assert "The same as mechanical distances" in page
    assert "uncorrected [mm]" in page


def test_side_data_reach_the_answer(capsys, captured, small, tmp_path):
    stood = "\n".join(f'"board{k}.tif" = "{small.d_f + away:.9g} mm"' for k, (away, _, _) in enumerate(POSES, 1))
    (tmp_path / "stood.toml").write_text(f'sigma = "0.05 mm"\nrelative = true\n[distances]\n{stood}\n')
    options = ["--design", captured / "small.toml", "--board", BOARD, "-o", tmp_path / "out", "--no-posterior"]
    known = ["--d-sigma", "0.01%", "--cell-sigma", "1 um", "--white-pitch", "0.01%"]
    code, said, err = run(
        capsys, "calibrate", captured / "images", *options, *known, "--distances", tmp_path / "stood.toml"
    )
    assert (code, err) == (0, "")
    assert "With the white image's pitch and the boards' distances" in said
    result = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert not undescribed(result, NAMES)
    assert result["data_sheet"]["d_sigma_mm"] == pytest.approx(1e-4 * small.d)
    assert result["data_sheet"]["cell_sigma_relative"] == pytest.approx(0.001 / CELL)
    side = result["side_data"]
    assert side["used"] == ["white", "distances"]
    assert max(side["off_sigma"].values()) < 3
    assert side["f_sigma_mm"] < 0.2 * result["data_sheet"]["f_sigma_mm"]
    assert side["f_mm"] == pytest.approx(small.f, abs=3 * side["f_sigma_mm"])
    d_3 = result["quantities"]["d_3"]
    assert d_3["sigma"] < 0.2  # 1.2 mm by the data sheet's f
    assert d_3["estimate"] == pytest.approx(40.0, abs=3 * d_3["sigma"])
    assert load(tmp_path / "out" / "calibrated.toml").f == pytest.approx(side["f_mm"])
    assert "--distances" in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('sigma = "1 mm"\n[distances]\n"boardx.tif" = "9 mm"', "distances.boardx.tif: is no image of the board"),
        ('sigma = "1"\n[distances]\n"board1.tif" = "9 mm"', '"1" has no unit'),
        ('sigma = "1 mm"\n[distances]\n"board1.tif" = "-9 mm"', "say relative = true?"),
        ('sigma = "1 mm"', "distances: is missing"),
        ("sigma", "is not valid TOML"),
    ],
)
def test_distances_that_cannot_be_read_are_refused(capsys, captured, tmp_path, text, said):
    (tmp_path / "stood.toml").write_text(text)
    options = ["--design", captured / "small.toml", "--board", BOARD, "-o", tmp_path / "out", "--no-posterior"]
    code, out, err = run(capsys, "calibrate", captured / "images", *options, "--distances", tmp_path / "stood.toml")
    assert (code, out) == (2, "")
    assert said in err
    assert "stood.toml" in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def no_white(folder):
    (folder / "white.tif").unlink()
    return "no white image"


def two_whites(folder):
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(folder / "white.png")
    return "white.png and white.tif"


def no_boards(folder):
    for path in folder.glob("board*"):
        path.unlink()
    return "no images of the board"


def unreadable(folder):
    (folder / "board1.tif").write_bytes(b"II*\0 nothing")
    return "board1.tif cannot be read as an image"


def unreadable_white(folder):
    (folder / "white.tif").unlink()
    (folder / "white.png").write_bytes(b"no picture")
    return "white.png cannot be read as an image"


def other_size(folder):
    tifffile.imwrite(folder / "board1.tif", np.ones((100, 100), np.float32))
    return "board1.tif and the white image differ in size"


def other_dark(folder):
    tifffile.imwrite(folder / "dark.tif", np.zeros((100, 100), np.float32))
    return "dark frame differ in size"


def saturated(folder):
    tifffile.imwrite(folder / "board1.tif", np.full((540, 640), 65535, np.uint16))
    return "board1.tif: the raw image is saturated"


def saturated_white(folder):
    tifffile.imwrite(folder / "white.tif", np.full((540, 640), 65535, np.uint16))
    return "the white image is saturated"


def melted(folder):
    tifffile.imwrite(folder / "white.tif", np.random.default_rng(0).normal(500, 5, (540, 640)).astype(np.float32))
    return "shows no periodic lattice"


def none_found(folder):
    for number in (2, 3, 4, 6):
        (folder / f"board{number}.tif").unlink()
    for number in (1, 5):
        shutil.copy(folder / "white.tif", folder / f"board{number}.tif")
    return "no board of 7 x 6 cells"


def parallel(folder):
    for number in (1, 3, 4, 5):
        shutil.copy(folder / "board2.tif", folder / f"board{number}.tif")
    return "parallel"


@pytest.mark.parametrize(
    "spoil",
    [
        no_white, two_whites, no_boards, unreadable, unreadable_white, other_size, other_dark, saturated,
        saturated_white, melted, none_found, parallel,
    ],
)  # fmt: skip
def test_spoilt_captures_are_one_line_exit_2_and_no_result_written(capsys, captured, images, tmp_path, spoil):
    said = spoil(images)
    out = tmp_path / "out"
    code, printed, err = run(
        capsys, "calibrate", images, "--design", captured / "small.toml", "--board", BOARD, "-o", out, "--no-posterior"
    )
    assert (code, printed) == (2, "")
    assert said in err
    assert err.startswith(f"roslf: {images}: ")
    assert len(err.splitlines()) == 1
    if spoil in (none_found, parallel):  # by then there is something to look at
        assert f"(what was seen: {out / 'failed.png'})" in err
        assert sorted(path.name for path in out.iterdir()) == ["failed.png", "failed.svg"]
        svg = (out / "failed.svg").read_text()
        assert all(text in svg for text in ("microlenses of the white image", "board1.tif", "board5.tif"))
    elif spoil in (saturated_white, melted):
        assert f"(what was seen: {out / 'failed.png'})" in err
        svg = (out / "failed.svg").read_text()
        assert all(text in svg for text in ("No lattice of microlenses", "frequency of the expected pitch"))
    else:
        assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "FOLDER: name the folder"),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out"], "none: no such folder"),
        (["none", "--design", "paper", "--board", "4 by 5", "-o", "out"], '--board: board "4 by 5" is not understood'),
        (["none", "--design", "paper", "--board", "4x5 0 mm", "-o", "out"], "cell must be a positive length"),
        (["none", "--design", "paper", "--board", "2x5 6 mm", "-o", "out"], "too few inner corners"),
        *(
            (["none", "--design", "paper", "--board", f"charuco {board}", "-o", "out"], f"--board: {said}")
            for board, said in (
                ("8x6 6 mm", 'board "charuco 8x6 6 mm" is not understood'),
                ("8x6 4 mm 6 mm DICT_4X4_50", "markers of 6 mm do not fit into cells of 4 mm: give the cell's size"),
                ("3x3 6 mm 4 mm DICT_4X4_50", "a ChArUco board of 3 x 3 cells has too few inner corners: 4 x 3 cells"),
                ("9x8 6 mm 5.4 mm DICT_5X5_100", "markers of 5.4 mm in cells of 6 mm leave a rim of 0.3 mm, and less"),
                ("8x6 6 mm 4 mm DICT_9X9_50", 'markers "DICT_9X9_50" are not known: write DICT_4X4_50 or such'),
                ("20x6 6 mm 4 mm DICT_4X4_50", "a board of 20 x 6 cells has 60 markers, DICT_4X4_50 only 50: name"),
            )
        ),
        (["none", "--design", "none", "--board", "4x5 6 mm", "-o", "out"], "none"),
        ([__file__, "--design", "paper", "--board", "4x5 6 mm", "-o", "out"], "is a file; name the folder of images"),
        (["none", "--design", "paper", "--board", "4x5 6 mm"], "--output: is missing"),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--f-sigma", "x%"], "--f-sigma"),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--f-sigma", "30%"], "20 % at most"),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--seed=-1"], "--seed"),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--d-sigma", "x"], "--d-sigma"),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--cell-sigma=-1%"], "must not be negative"),
        (
            ["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--white-pitch", "1 um"],
            "no share above zero",
        ),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--distances", "none"], "no such file"),
        (["--plan", "paper", "--distances", "none"], "--distances: has no place beside --plan"),
        (["--plan", "paper", "--use-in", "1.33"], "--use-in: has no place beside --plan"),
        (
            ["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--use-in", "1.33"],
            "--use-in: 1.33: nothing keeps n = 1.33 from the main lens; add the window",
        ),
        (
            ["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--use-in", "0.5"],
            "--use-in: 0.5: an index must be a number from 1 to 5",
        ),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--tilt", "9 deg"], "--tilt: goes with"),
        (["--plan", "paper", "-o", "out"], "--output: has no place beside --plan"),
        (["--plan", "paper", "--tilt", "0 deg"], "up to 0.0 degrees); tilt them by up to 20 degrees"),
        (["--plan", "paper", "--tilt", "20"], "--tilt"),
        (["--plan", "paper", "--tilt", "20 mm"], "--tilt"),
        (["--plan", "paper", "--tilt", "95 deg"], "stay below 90"),
        (["--plan", "paper", "--boards", "1"], "one image of the board"),
        (["--plan", "paper", "--distance", "100 mm"], "reach into the bore"),
        (["--plan", "paper", "--noise=-1"], "must be at least 1e-06"),
        (["--plan", "paper", "--range=-1 mm"], '--range: "-1 mm" must not be negative'),
        (["none", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--at", "9 mm"], "--at: goes with"),
        (["--plan", "paper", "--at", "9"], "--at"),
        (["--plan", "none.toml"], "none.toml: no such file"),
        (["--plan", "paper", "--sigma", "elements.0.thickness=1 um"], "elements.0.thickness: is no number of what"),
        (["--plan", "arthroscope", "--sigma", "elements.1.thicknes=1 um"], "did you mean 'elements.1.thickness'?"),
        (["--plan", "arthroscope", "--sigma", "elements.1.thickness"], '--sigma: cannot read "elements.1.thickness"'),
        (["--plan", "arthroscope", "--sigma", "elements.1.thickness=blue"], 'cannot read "blue" as a length'),
        (["--plan", "arthroscope", "--sigma", "elements.1.index=1"], "is hardly known: 20 % at most"),
        (["--plan", "arthroscope", *(["--sigma", "object_space.index=0.1 %"] * 2)], "is given twice; drop one"),
    ],
)
def test_bad_options_are_one_line_and_exit_2(capsys, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "calibrate", *arguments)
    assert (code, out) == (2, "")
    assert said in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_boards_at_one_depth_are_used_with_a_warning(capsys, captured, small, tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    shutil.copy(captured / "images" / "white.tif", folder / "white.tif")
    for number, tilt in enumerate([(28, 5), (-24, -20)], 1):
        image = render(small, board_scene(captured, small, (0, *tilt)), overrides=RAYS, sampling=SAMPLING)
        write_image(image, folder / f"board{number}.tif")
    code, said, err = run(
        capsys, "calibrate", folder, "--design", captured / "small.toml", "--board", BOARD, "-o", tmp_path / "out",
        "--no-posterior",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "The boards stand at one depth, within" in said
    assert "spread their distances" in said


def test_a_plan_lists_changes_by_depth_and_says_what_boards_add_and_leave_out(capsys):
    """Each number beside a plan that is asked for with that change, or with boards at that distance."""
    _, said, _ = run(capsys, "calibrate", "--plan", "paper")
    said = " ".join(said.split())
    depths = [float(row) for row in re.findall(r" \d\.\d\d (0\.\d+)(?= [a-z]|$)", said.partition("one change")[2])]
    assert len(depths) > 6
    assert depths == sorted(depths)
    six = re.search(r"Half the boards do nearly as well: with 6, U = ± (\S+) mm", said)[1]
    _, fewer, _ = run(capsys, "calibrate", "--plan", "paper", "--boards", "6")
    assert f"U = ± {six} mm in the focal plane" in " ".join(fewer.split())
    near, far, end = re.search(r"Boards stand from (\S+) to (\S+) mm .* ends at (\S+) mm: beyond", said).groups()
    _, wider, _ = run(capsys, "calibrate", "--plan", "paper", "--at", f"{end} mm", "--json")
    captures = json.loads(wider)["captures"]
    tip = float(Camera.of(load("paper")).tip)
    half = captures["range_mm"] / 2 * (1 - 1 / captures["boards"])
    assert captures["distance_mm"] + half - tip > float(far)
    assert float(near) < float(far) < float(end)


def test_a_plan_of_a_study_knows_its_tolerances_before(tmp_path, capsys):
    """Lengths by hand: of a single length, known to a tenth of a tenth of a millimetre, sigma is width over sqrt(3)."""
    study = tmp_path / "own.toml"
    study.write_text(
        'name = "own"\ndesign = "paper"\ntrials = 8\n'
        '[[perturb]]\nplace = "microlens_array.distance"\ntolerance = "0.01 mm"\ndistribution = "uniform"\n'
        '[[goals]]\nquantity = "fill_factor"\nmin = 0.5\n'
    )
    code, out, err = run(capsys, "calibrate", "--plan", study, "--json")
    assert (code, err) == (0, "")
    plan, design = json.loads(out), load("paper")
    made = LengthCovariance(("microlens_array.distance",), np.array([[0.01**2 / 3]]))
    bare = {t.name: t.u_mm for t in depth_budget(Camera.of(design), build=made).terms}["lengths as built"]
    told = {t["name"]: t["u_mm"] for t in plan["depth_with_tolerances"]["terms"]}["lengths as calibrated"]
    assert 0 < told <= float(bare) * (1 + 1e-9)
    assert plan["depth_with_tolerances"]["u_z_mm"] < plan["depth_expected"]["u_z_mm"] / 5
    code, said, _ = run(capsys, "calibrate", "--plan", study)
    said = " ".join(said.split())
    assert "bench system, tolerances of the study own known before" in said
    u = float(depth_budget(Camera.of(design), build=made).expanded_mm)
    assert f"Uncalibrated, by tolerances of the study own alone: {uncertainty(u, 3, '± ')} in the focal plane" in said
    assert "in the focal plane, not focused at assembly" in said


def test_the_plan_of_the_paper(capsys):
    code, out, _ = run(capsys, "calibrate", "--plan", "paper", "--range", "80 mm", "--json")
    assert code == 0
    plan = json.loads(out)
    # An f known to 1 % alone moves d_3 by 1 + 1/m = 3.5 mm.
    assert 3.5 < plan["expected_sigma"]["d_3"] < 4.5
    gains = [change["gain_d_3"] for change in plan["changes"]]
    assert gains == sorted(gains, reverse=True)
    assert plan["advice"].startswith("Know f twice as well")
    code, exact, _ = run(capsys, "calibrate", "--plan", "paper", "--range", "80 mm", "--json", "--f-sigma", "0 mm")
    assert code == 0
    assert json.loads(exact)["expected_sigma"]["d_3"] < plan["expected_sigma"]["d_3"] / 2
    # So it does d_f, and the FAP, which is the tip, as much: ahead of it the focal plane lies at A/m, whatever f is.
    depth, sigma = plan["depth_expected"], plan["expected_sigma"]
    ahead = 92.0 / 0.4 * np.hypot(sigma["A"] / 92.0, sigma["m"] / 0.4)
    assert depth["u_z_mm"] == pytest.approx(ahead, rel=0.05)  # both share the pitch's error
    # What is left is type B, nobody has measured yet.
    assert {t["name"]: t["type"] for t in depth["terms"]}["lengths as calibrated"] == "B"
    assert json.loads(exact)["depth_expected"]["u_z_mm"] == pytest.approx(depth["u_z_mm"], rel=1e-5)
    code, out, _ = run(capsys, "calibrate", "--plan", "paper", "--range", "80 mm", "--json", "--at", "300 mm")
    assert code == 0
    assert json.loads(out)["depth_expected"] == depth
    (there,) = json.loads(out)["depth_expected_at"]
    assert there["at_mm"] == 300.0
    assert depth["u_z_mm"] < there["u_z_mm"] < (300 / 230) ** 2 * depth["u_z_mm"]
    code, out, _ = run(capsys, "calibrate", "--plan", "paper")
    assert code == 0
    assert "Expected sigma after one change" in out
    # As a report has it, which takes default tolerances as known; beside it the same by captures alone.
    assert "Calibration as planned, with tolerances known before: depth, expected, to U = ± 0.78" in out
    assert "By captures alone, of a camera whose tolerances nobody knows: ± 2.39" in out
    known = json.loads(exact)["depth_with_tolerances"]["u_z_mm"]
    assert known < json.loads(exact)["depth_expected"]["u_z_mm"]
    assert json.loads(exact)["depth_expected"]["u_z_mm"] < 1.8
    pitch = ["--white-pitch", "0.01%", "--d-sigma", "0.01%"]
    code, tied, _ = run(capsys, "calibrate", "--plan", "paper", "--range", "80 mm", "--json", *pitch)
    assert code == 0
    assert json.loads(tied)["expected_sigma"]["d_3"] < plan["expected_sigma"]["d_3"] / 3
    assert json.loads(tied)["variance_shares"]["d_3"]["white"] > 0


def test_a_board_that_the_sensor_cannot_see_whole_is_noted():
    paper = load("paper")
    assert too_large(paper, Captures.for_design(paper, board=Board(4, 5, 6.0))) == ""
    note = too_large(paper, Captures.for_design(paper, board=Board(9, 10, 6.0)))
    assert "54 x 60 mm" in note


def test_sixteen_bits_of_a_render_come_back_as_intensities(small, tmp_path):
    image = render(small, overrides=RAYS, sampling=SAMPLING, region=(300, 250, 40, 30))
    for name in ("a.png", "a.tif"):
        write_image(image, tmp_path / name, "16")
        np.testing.assert_allclose(read_image(tmp_path / name), image.pixels, atol=2 / 65535)
    Image.fromarray(np.full((9, 9), 700, np.uint16)).save(tmp_path / "camera.png")
    assert read_image(tmp_path / "camera.png").dtype == np.uint16


def test_boards_come_in_the_order_of_their_numbers_without_previews(tmp_path):
    for name in ("white", "b10", "b2", "B1-preview", "b1"):
        Image.fromarray(np.zeros((9, 9), np.uint8)).save(tmp_path / f"{name}.png")
    assert [path.name for path in read_capture(tmp_path).boards] == ["b1.png", "b2.png", "b10.png"]
    with pytest.raises(CalibrationError, match="is a file"):
        read_capture(tmp_path / "b1.png")


def test_sensor_and_pupil_are_measured_and_used(capsys, captured, small, tmp_path, monkeypatch):
    """Counts with noise of a sensor and a pupil other than the design's: both come back, in depth as well."""
    rng, gain, read, black = np.random.default_rng(4), 2.0, 6.0, 120
    built = small.replace(D_F=0.94 * small.D_F)
    even = read_image(captured / "images" / "white.tif")
    scenes = {f"board{number}": read_image(captured / "images" / f"board{number}.tif") for number in range(1, 6)}
    white = render(built, overrides=RAYS, sampling=SAMPLING).pixels
    for name, light, count in (("white", white, 2), ("dark", 0 * even, 3), *((n, s, 1) for n, s in scenes.items())):
        charge = rng.poisson(np.broadcast_to(7000 * light, (count, *light.shape))) + read * rng.normal(
            size=(count, *light.shape)
        )
        counts = np.clip(np.rint(charge / gain + black), 0, 4095).astype(np.uint16)
        (tmp_path / "in").mkdir(exist_ok=True)
        if name == "dark":
            np.save(tmp_path / "in" / "dark_1.npy", counts)
        else:
            for number, frame in enumerate(counts, 1):
                tifffile.imwrite(tmp_path / "in" / f"{name}_{number}.tif", frame)
    out = tmp_path / "out"
    options = ["--design", captured / "small.toml", "--board", BOARD, "--no-posterior", "-o", out]
    code, said, err = run(capsys, "calibrate", tmp_path / "in", *options)
    assert (code, err) == (0, "")
    result = json.loads((out / "calibration.json").read_text())
    assert not undescribed(result, NAMES)
    sensor, pupil = result["sensor"], result["pupil"]
    assert abs(sensor["gain"]["value"] - gain) < 3 * sensor["gain"]["sigma"] < 0.05
    assert abs(sensor["read_noise"]["value"] - read) < 3 * sensor["read_noise"]["sigma"] < 0.2
    assert sensor["full_well"]["bound"] == "at least"
    assert (sensor["white_frames"], sensor["dark_frames"]) == ([2], 3)
    assert abs(pupil["diameter_mm"] - built.D_F) < 3 * pupil["sigma_mm"] < 0.1 * built.D_F
    assert abs(result["veil"]["share"]) < 3 * result["veil"]["sigma"] + 1e-3
    places = result["covariance"]["places"]
    at = places.index("aperture.diameter")
    assert np.sqrt(result["covariance"]["matrix"][at][at]) == pytest.approx(pupil["sigma_mm"])
    assert "aperture.diameter" in result["covariance"]["information"]["places"]
    used = load(str(out / "calibrated.toml"))
    assert pytest.approx(pupil["diameter_mm"], rel=1e-6) == used.D_F
    assert used.sensor.read_noise == pytest.approx(sensor["read_noise"]["value"], rel=1e-6)
    words = " ".join(said.split())
    assert "Effective pupil" in words
    assert "read noise 6" in words or "read noise 5.9" in words
    assert "at least" in words
    frames = [tmp_path / "in" / name for name in ("board1_1.tif", "white_1.tif", "dark_1.npy")]
    at_first_sight(monkeypatch)
    between = f"{small.d_f - 16} mm, {small.d_f - 8} mm"
    code, said, err = run(
        capsys, "depth", frames[0], "--white", frames[1], "--dark", frames[2], "--calibration", out, "--json",
        "--between", between,
    )  # fmt: skip
    assert (code, err) == (0, "")
    noise = json.loads(said)["noise"]
    assert "as calibrated" in noise["from"]
    believed = noise["read_noise"] * noise["times_believed"]  # views differ by the rendering's scatter besides
    assert believed == pytest.approx(np.hypot(sensor["read_noise"]["value"], gain / np.sqrt(12)), rel=0.01)
    sheet = tmp_path / "sheet.html"
    few_builds(monkeypatch)
    few_waves(monkeypatch)
    code, said, err = run(capsys, "datasheet", captured / "small.toml", "--calibration", out, "-o", sheet)
    assert (code, err) == (0, "")
    assert re.search(r"derivatives over [^.;]*<var>D</var><sub>F</sub>", sheet.read_text())
