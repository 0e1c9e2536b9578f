"""`roslf bench` and `roslf bench check` on captures rendered of a small camera, sound and with each fault."""

import json
import shutil

import numpy as np
import pytest
import tifffile
from PIL import Image

import roslf_design as roslf
from roslf_design.calibration.options import CalibrateOptions
from roslf_design.calibration.outcome import calibrated
from roslf_design.cli import main
from roslf_design.commands.terminal import json_text
from roslf_design.design import load
from roslf_design.design import save as save_design
from tests.bench.made import BOARD, CELL, POSES, board_scene, picture, rendered, save, small

pytestmark = pytest.mark.usefixtures("found_once")
SOUND = [f"board_{k:02d}.tif" for k in range(1, len(POSES) + 1)]


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A bench as `roslf bench` writes it, with whites, a dark frame and the boards; and what else was rendered."""
    place = tmp_path_factory.mktemp("bench")
    camera = small()
    save_design(camera, place / "small.toml")
    assert main(["bench", str(place / "small.toml"), "-o", str(place / "bench"), "--board", BOARD]) == 0
    rng = np.random.default_rng(0)
    white = np.asarray(picture().pixels, float)
    images = {"white": white, "dark": 0 * white}
    images |= {k: np.asarray(picture(pose).pixels, float) for k, pose in enumerate(POSES, 1)}
    images["cells"] = rendered(camera, board_scene(place, camera, POSES[0], cells=(6, 5)))
    images["size"] = rendered(camera, board_scene(place, camera, POSES[0], cell=0.82 * CELL))
    other = camera.replace(d_f=0.9 * camera.d_f)
    images["refocused"] = rendered(other, board_scene(place, other, POSES[2]))
    folder = place / "bench" / "calibration"
    for name in ("white_1", "white_2"):
        save(folder / f"{name}.tif", white, rng)
    save(folder / "dark_1.tif", images["dark"], rng)
    for k, name in enumerate(SOUND, 1):
        save(folder / name, images[k], rng)
    return place, images


@pytest.fixture
def bench(made, tmp_path):
    """A copy of the bench to change, and what was rendered."""
    return shutil.copytree(made[0] / "bench", tmp_path / "bench"), made[1]


def change(folder, old, new):
    text = (folder / "bench.toml").read_text()
    assert old in text
    (folder / "bench.toml").write_text(text.replace(old, new, 1))


def told(capsys, folder):
    code, out, err = run(capsys, "bench", "check", folder, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


def test_a_bench_has_what_the_protocol_names(made):
    folder = made[0] / "bench"
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    targets = {
        f"targets/{kind}.{end}" for kind in ("board", "edge", "wall", "spheres", "field") for end in ("pdf", "svg")
    }
    assert names >= {"design.toml", "bench.toml", "protocol.pdf", "protocol.html"} | targets
    assert (folder / "acceptance").is_dir()
    assert load(folder / "design.toml") == load(made[0] / "small.toml")


def test_sound_captures_have_no_fault_and_tell_how_sure_they_are(capsys, bench, tmp_path):
    folder, _ = bench
    array = tifffile.imread(folder / "calibration" / SOUND[0])
    Image.fromarray(array).save((folder / "calibration" / SOUND[0]).with_suffix(".png"))  # a picture of any kind
    (folder / "calibration" / SOUND[0]).unlink()
    check = told(capsys, folder)
    assert not {one.removesuffix(".tif") for one in check["missing"]} & {one.removesuffix(".tif") for one in SOUND}
    assert check["faults"] == []
    assert check["boards"] == len(SOUND)
    tifffile.imwrite(folder / "calibration" / SOUND[0], array)
    (folder / "calibration" / SOUND[0]).with_suffix(".png").unlink()
    images = {one["name"].replace(".png", ".tif"): one for one in check["images"]}
    tip = float(small().d_3)
    for name, (away, about_x, about_y) in zip(SOUND, POSES, strict=True):
        one = images[name]
        assert one["corners"] == [30, 30]
        assert one["pose"]["ahead_mm"] == pytest.approx(small().d_f + away - tip, abs=1.0)
        assert one["pose"]["tilt_deg"] == pytest.approx(np.hypot(about_x, about_y), abs=1.5)
        assert 0.6 < one["level"] < 0.8
    assert (folder / "check.html").read_text().count("board_0") > len(SOUND)
    # What a calibration of these images finds, by its own scatter.
    for name in ("white", "dark"):
        shutil.copy(folder / "calibration" / f"{name}_1.tif", tmp_path / f"{name}.tif")
    for name in SOUND:
        shutil.copy(folder / "calibration" / name, tmp_path / name)
    outcome = calibrated(tmp_path, small(), CalibrateOptions(board=BOARD, posterior=False))
    data = outcome.to_dict()["quantities"]
    for name in ("H", "d_3"):
        low, high = data[name]["interval_68"]
        assert check["sigma"][name] == pytest.approx((high - low) / 2, rel=0.1)
    # The pose to take next leaves them surer, and fewer boards less sure.
    assert check["next"]["sigma"]["d_3"] < check["sigma"]["d_3"]
    (folder / "calibration" / SOUND[1]).unlink()
    fewer = told(capsys, folder)
    images = [one["sigma"]["d_3"] * one["d_3_variance_by_images"] ** 0.5 for one in (fewer, check)]
    noise = [one["corner_noise_pitches"] for one in (fewer, check)]
    assert images[0] / noise[0] > 1.02 * images[1] / noise[1]
    for name in SOUND[2:]:
        (folder / "calibration" / name).unlink()
    code, out, _ = run(capsys, "bench", "check", folder)
    assert code == 0
    assert "do not determine H and d_3 yet" in out
    assert "Take next: board_" in out


def test_faults_are_told_by_name(capsys, bench):
    folder, images = bench
    place, rng = folder / "calibration", np.random.default_rng(1)
    save(place / "board_05.tif", images[1], rng, gain=6000)
    save(place / "board_06.tif", images[2], rng, gain=300)
    save(place / "board_07.tif", images["cells"], rng)
    save(place / "board_08.tif", images["size"], rng)
    save(place / "board_09.tif", images["refocused"], rng)
    save(place / "board_10.tif", images["white"], rng)
    save(place / "dark_2.tif", 0.03 * images["white"], rng)
    save(folder / "acceptance" / "wall_78mm.tif", images[3], rng)
    check = told(capsys, folder)
    faults = {one["name"]: "; ".join(one["faults"]) for one in check["images"] if one["faults"]}
    wanted = {
        "board_05.tif": "overexposed",
        "board_06.tif": "too dark",
        "board_07.tif": "wrong target: a board of",
        "board_08.tif": "wrong target",
        "board_09.tif": "refocused",
        "board_10.tif": "no board of 7 x 6 cells",
        "dark_2.tif": "light in the dark frame",
    }
    assert faults.keys() == wanted.keys()
    for name, words in wanted.items():
        assert faults[name].startswith(words), faults[name]
    assert f"{0.82 * CELL:.3g} mm" in faults["board_08.tif"]
    assert check["boards"] == len(SOUND)
    code, out, err = run(capsys, "bench", "check", folder)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    for one in check["images"]:
        assert sum(line.startswith(f"{one['name']}: {one['kind']}") for line in lines) == 1


def test_a_white_image_of_another_camera_blames_no_dark_frame(capsys, bench):
    folder, images = bench
    other = np.full((60, 80), 2000, np.uint16)
    tifffile.imwrite(folder / "calibration" / "white_0.tif", other)
    save(folder / "calibration" / "board_05.tif", images["dark"], np.random.default_rng(1))
    check = told(capsys, folder)
    assert {fault.split(":")[0] for fault in check["faults"]} == {"white_0.tif", "board_05.tif"}
    capped = next(one for one in check["images"] if one["name"] == "board_05.tif")
    assert 0 <= capped["contrast"] <= 1


def test_a_report_is_the_same_from_the_shell_and_from_python(capsys, bench):
    """Lengths as rendered; Python leaves the folder as it was."""
    folder, _ = bench
    before = sorted(folder.rglob("*"))
    assert roslf.bench_check(folder).faults == ()
    result = roslf.bench_report(folder, placed=0.001)
    assert sorted(folder.rglob("*")) == before
    lines = {line.name: line for line in result.lines}
    for name, truth in (("d_3", small().d_3), ("D_F", small().D_F), ("H", small().d_1 / 92 * 3)):
        assert abs(lines[name].value - truth) < 1.5 * lines[name].expanded
    code, out, err = run(capsys, "bench", "report", folder, "--placed", "0.1 %", "--no-stamp", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["lines"] == json.loads(json_text(result.to_dict()))["lines"]
    pupil = json.loads((folder / "calibration" / "result" / "calibration.json").read_text())["pupil"]
    assert 0 <= pupil["sigma_of_rim_mm"] <= pupil["sigma_mm"]
    shutil.rmtree(folder / "calibration")
    code, out, err = run(capsys, "bench", "report", folder)
    assert (code, out) == (2, "")
    assert "no white image" in err


def test_a_bar_that_was_measured_corrects_the_board(capsys, bench):
    folder, _ = bench
    before = told(capsys, folder)["images"][-1]["pose"]["ahead_mm"]
    text = (folder / "bench.toml").read_text()
    (folder / "bench.toml").write_text(text.replace('printed_bar = "100 mm"', 'printed_bar = "99 mm"', 1))
    after = told(capsys, folder)["images"][-1]["pose"]["ahead_mm"]
    assert after == pytest.approx(0.99 * before, rel=1e-3)


def test_without_a_white_image_levels_are_told_alone(capsys, bench):
    folder, _ = bench
    for path in (folder / "calibration").glob("white*"):
        path.unlink()
    check = told(capsys, folder)
    assert check["missing"][0] == "white"
    assert all(one["corners"] is None for one in check["images"])
    assert check["sigma"] is None


def test_what_was_measured_is_not_overwritten(capsys, made, bench):
    folder, _ = bench
    again = ["bench", made[0] / "small.toml", "-o", folder, "--board", BOARD]
    assert run(capsys, *again)[0] == 0
    text = (folder / "bench.toml").read_text()
    (folder / "bench.toml").write_text(text.replace('"100 mm"', '"99.8 mm"', 1))
    code, _, err = run(capsys, *again)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
    assert "bench.toml" in err


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: shutil.rmtree(folder), "no such folder"),
        (lambda folder: (folder / "bench.toml").unlink(), "has no bench.toml"),
        (lambda folder: (folder / "design.toml").unlink(), "design.toml"),
        (lambda folder: (folder / "bench.toml").write_text("[board"), "not valid TOML"),
        (lambda folder: change(folder, 'printed_bar = "100 mm"', 'printed_bar = "10 mm"'), "measure again"),
        (lambda folder: change(folder, 'cells = "7x6 1.7 mm"', 'cells = "7x"'), "board.cells"),
        (lambda folder: change(folder, "seed = 0", "sead = 0"), "did you mean 'seed'"),
        (lambda folder: (folder / "calibration" / "white_1.tif").write_bytes(b"II*"), "cannot be read as an image"),
        (lambda folder: (folder / "acceptance" / "edge.tif").write_bytes(b"II*"), "edge_40mm.tif"),
        (lambda folder: (folder / "calibration" / "board_05.jpg").write_bytes(b""), "board_05.jpg: raw counts come as"),
    ],
)
def test_bad_folders_are_refused_in_one_line(capsys, bench, spoil, words):
    folder, _ = bench
    spoil(folder)
    code, out, err = run(capsys, "bench", "check", folder)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert words in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--board", "9x9 60 mm"], "--board: the board measures 540 x 540 mm"),
        (["--board", "9x9"], "--board"),
        (["--boards", "1"], "one image of the board"),
        (["--distance", "100 mm"], "reach into the bore"),
        (["--seed", "-1"], "--seed"),
        (["--at", "130"], "--at"),
        (["--at", "1 mm", "--at", "900 mm"], "--at: 1 mm is too near"),
    ],
)
def test_benches_that_cannot_be_are_refused_in_one_line(capsys, tmp_path, options, words):
    code, out, err = run(capsys, "bench", "paper", "-o", tmp_path / "a", *options)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert words in err
    assert not (tmp_path / "a").exists()
