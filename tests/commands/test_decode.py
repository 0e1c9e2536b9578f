"""`roslf decode`: what it finds in rendered images whose scene is known, what it writes, and its refusals."""

import json
import re

import numpy as np
import pytest
import tifffile

import roslf_design as roslf
from roslf_design.calibration import CalibrationError, find_centres, find_centres_in_scene, read_image
from roslf_design.cli import main
from roslf_design.depth.view_files import read_views
from roslf_design.effects import Budget
from roslf_design.imaging.files import write_image
from roslf_design.imaging.render import render
from roslf_design.scenes import make_scene
from tests.oracles.calibration import nodes_over, white_image

pytestmark = pytest.mark.usefixtures("found_once")
NEAR, FAR = 315.0, 395.0
REGION = (2090, 1400, 420, 280)
PICTURES = ("lattice", "centre-view", "views", "refocus", "epi")


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    """The paper's camera before a board at 395 mm and, on the right of the raw image, one at 315 mm."""
    folder = tmp_path_factory.mktemp("decode")
    board = {"kind": "plane", "size": [80.0, 80.0], "texture": {"kind": "checkerboard", "period": 2.4}}
    near = {**board, "centre": [-40.0, 0.0], "distance": NEAR}
    scene = make_scene({"name": "step", "objects": [{**board, "distance": FAR, "size": [300.0, 300.0]}, near]})
    budget, rays = Budget(intensity=0.15), ["-microlens_diffraction", "-fap_diffraction", "-microlens_defocus"]
    design = roslf.load("paper")
    write_image(render(design, scene, budget=budget, overrides=rays, region=REGION), folder / "raw.tif")
    write_image(render(design, budget=budget, overrides=rays, region=REGION), folder / "white.tif")
    return folder


@pytest.fixture(scope="module")
def decoded(captured, tmp_path_factory):
    """What the command left in its folder."""
    out = tmp_path_factory.mktemp("decoded") / "out"
    asked = ["--focus", f"{NEAR} mm,{FAR} mm", "--focus", "0"]
    code = main(["decode", *map(str, (captured / "raw.tif", "--white", captured / "white.tif")), "--design", "paper",
                 *asked, "-o", str(out)])  # fmt: skip
    assert code == 0
    return out


def sharpness(values):
    return np.square(np.diff(values.astype(float), axis=1)).sum(axis=0)


def test_refocusing_to_a_distance_shows_what_stands_there_sharp(captured):
    stack = roslf.decode(
        captured / "raw.tif", captured / "white.tif", design="paper",
        focus=[f"{z} mm" for z in (280, NEAR, 335, 350, FAR, 450)],
    ).stack  # fmt: skip
    assert [round(plane.distance) for plane in stack] == [450, 395, 350, 335, 315, 280]
    left, right = (
        [sharpness(plane.values[4:-4])[part].sum() for plane in stack] for part in (slice(3, 11), slice(-11, -3))
    )
    assert stack[int(np.argmax(left))].distance == pytest.approx(FAR)
    assert stack[int(np.argmax(right))].distance == pytest.approx(NEAR)


def test_the_folder_holds_pictures_views_stack_and_page(captured, decoded):
    data = json.loads((decoded / "decoding.json").read_text())
    assert data["schema"] == "roslf.decoding/1"
    assert data["lattice"]["layout"] == "square"
    assert data["lattice"]["pitch_px"] == pytest.approx(12.939, abs=2e-3)
    assert [plane["distance_mm"] for plane in data["focus"]] == pytest.approx([FAR, 350, NEAR])
    assert data["focus"][1]["disparity_pitches"] == pytest.approx(0.0, abs=1e-9)
    for name in PICTURES:
        assert (decoded / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (decoded / f"{name}.svg").read_bytes().startswith(b"<?xml")
    page = (decoded / "index.html").read_text()
    assert all(f'id="figure-{name}"' in page for name in PICTURES)
    assert len(list((decoded / "refocus").iterdir())) == 3
    field = roslf.decode(captured / "raw.tif", captured / "white.tif").field
    back = read_views(decoded / "views").field
    assert back.values.shape == field.values.shape
    np.testing.assert_allclose(back.values, field.values.clip(0), atol=field.values.max() / 65535)


def test_json_and_a_folder_of_views(capsys, decoded, tmp_path):
    code, out, err = run(capsys, "decode", decoded / "views", "--json", "--row", "7", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert (data["kind"], data["lattice"], data["distances_from"]) == ("views", None, None)
    assert data["epi"]["row"] == 7
    assert len(data["focus"]) == 7
    assert not (tmp_path / "out" / "views").exists()
    assert (tmp_path / "out" / "epi.png").exists()


def test_the_same_image_makes_the_same_bytes(capsys, captured, decoded, tmp_path, found_once):
    found_once.clear()
    asked = ["--focus", f"{NEAR} mm,{FAR} mm", "--focus", "0", "-o", tmp_path / "out"]
    code, _, _ = run(capsys, "decode", captured / "raw.tif", "--white", captured / "white.tif", "--design", "paper",
                     *asked)  # fmt: skip
    assert code == 0
    for path in (p for p in decoded.rglob("*") if p.is_file() and p.name != "index.html"):  # which tells the command
        assert (tmp_path / "out" / path.relative_to(decoded)).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_centres_in_a_scene_of_texture_lie_where_the_white_image_has_them(layout):
    truth = nodes_over((420, 520), 13.3, 0.01, layout)
    white = white_image((420, 520), truth, 6.0)
    rng = np.random.default_rng(4)
    y, x = np.mgrid[:420, :520]
    shades = 0.55 + 0.4 * np.sign(np.sin(x / 31.0) * np.sin(y / 23.0)) + 0.03 * np.sin(x / 2.9 + y / 5.1)
    raw = 900 * white * shades + rng.normal(0, 4, white.shape)
    found = find_centres_in_scene(raw, layout=layout, pitch=13.0)
    best = find_centres(white)
    away = found.lattice.nodes(*np.round(found.lattice.indices(best.centres)).T) - best.centres
    # Texture draws single centroids by 0.3 px rms; what is left of it over 1000 images is 0.01, noise and edges beside.
    assert np.hypot(*away.T).max() < 0.1
    assert "centres come from the scene itself" in found.warnings[0]


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_a_scene_with_periods_of_its_own_is_no_lattice(layout, shared_data):
    for path in sorted((shared_data / "lytro-checkerboard").glob("raw[1-4]__*.png")):  # central views of checkerboards
        with pytest.raises(CalibrationError, match=f"no {layout} lattice of about 13 px pitch"):
            find_centres_in_scene(read_image(path), layout=layout, pitch=13.0)


def test_a_real_scene_shows_the_lattice_that_its_white_image_has(shared_data):
    folder = shared_data / "guv"
    frames = (read_image(next(folder.glob(f"{name}*.tif"))) for name in ("Lightfield", "Radiometry", "DarkFrame"))
    raw, white, dark = frames
    best = find_centres(white, dark)
    found = find_centres_in_scene(raw, dark, layout="square", pitch=15.0)
    away = found.lattice.nodes(*np.round(found.lattice.indices(best.centres)).T) - best.centres
    # The vesicle's light is not even over the pupil, which moves all images alike by some tenths of a pixel.
    told = float(re.search(r"to about ([\d.]+) px", found.warnings[0])[1])
    left = away - away.mean(axis=0)
    assert np.sqrt(np.square(left).sum(axis=1).mean()) < told < 0.5
    assert np.hypot(*away.mean(axis=0)) < 0.04 * best.lattice.pitch


def test_without_a_white_image_a_design_helps(capsys, captured, tmp_path):
    code, out, err = run(capsys, "decode", captured / "raw.tif", "--design", "paper", "--json", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert data["lattice"]["from"] == "raw image"
    assert data["lattice"]["pitch_px"] == pytest.approx(12.939, abs=0.03)
    assert "centres come from the scene itself" in data["warnings"][0]


def test_the_camera_as_calibrated_names_the_planes(captured, tmp_path):
    row = {
        "estimate": 1.5,
        "unit": "",
        "sigma": 0.1,
        "interval_68": [1, 2],
        "interval_95": [1, 2],
        "variance_shares": {},
    }
    data = {"schema": "roslf.calibration/1", "design": "x", "quantities": {"H": row, "d_3": row}}
    (tmp_path / "calibration.json").write_text(json.dumps(data))
    roslf.save(roslf.load("paper").replace(d_3=110.0), tmp_path / "calibrated.toml")
    images = captured / "raw.tif", captured / "white.tif"
    found = roslf.decode(*images, calibration=tmp_path, focus=["-3"])
    assert found.distances_from == "the calibration"
    by_design = roslf.decode(*images, design="paper", focus=["-3"])
    # Eq. 12: A/Z_F = m - slope d_2 d/(q A), with A = f + m (f - d_3).
    for result, d_3 in ((found, 110.0), (by_design, 120.0)):
        A, m, (plane,) = 100 + 0.4 * (100 - d_3), 0.4, result.stack
        expected = d_3 + A / (m - plane.slope * 2 * 0.063 / (0.004847826 * A))
        assert plane.distance == pytest.approx(expected, rel=1e-6)
    (tmp_path / "calibrated.toml").unlink()
    with pytest.raises(roslf.InputError, match="no such file"):
        roslf.decode(*images, calibration=tmp_path)


def test_the_design_of_another_camera_is_told(captured):
    result = roslf.decode(captured / "raw.tif", captured / "white.tif", design="ear-speculum", focus=["0"])
    assert any("distances are right only if it describes this camera" in warning for warning in result.warnings)


def test_no_lattice_leaves_a_picture_of_what_was_seen(capsys, captured, tmp_path):
    noise = np.random.default_rng(0).normal(500, 5, (280, 420)).astype(np.float32)
    tifffile.imwrite(tmp_path / "noise.tif", noise)
    tifffile.imwrite(tmp_path / "black.tif", np.zeros((280, 420), np.float32))
    for number, (image, *more) in enumerate(
        [
            (captured / "raw.tif", "--white", tmp_path / "noise.tif"),
            (tmp_path / "noise.tif", "--design", "paper"),
            (tmp_path / "black.tif", "--design", "rigid-scope"),
        ]
    ):
        out = tmp_path / str(number)
        code, printed, err = run(capsys, "decode", image, *more, "-o", out)
        assert (code, printed) == (2, "")
        assert len(err.splitlines()) == 1
        assert f"(what was seen: {out / 'failed.png'})" in err
        assert sorted(path.name for path in out.iterdir()) == ["failed.png", "failed.svg"]
        assert "spectrum (log)" in (out / "failed.svg").read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["raw.tif"], "--white: is missing"),
        (["none.tif", "--design", "paper"], "none.tif: no such file"),
        (["junk.tif", "--design", "paper"], "junk.tif: cannot be read as an image"),
        (["huge.tif", "--design", "paper"], "huge.tif: the picture has pixels that are not finite"),
        (["raw.tif", "--white", "small.tif"], "differ in size (420 x 280 px and 40 x 30 px)"),
        (["raw.tif", "--white", "white.tif", "--dark", "small.tif"], "dark frame small.tif differ in size"),
        (["raw.tif", "--white", "."], "is a folder; name the file inside it"),
        (["raw.tif", "--white", "white.tif", "--focus", "300 mm"], "takes --design or --calibration"),
        (["raw.tif", "--white", "white.tif", "--focus", "nan"], "--focus"),
        (["raw.tif", "--white", "white.tif", "--focus", "1," * 100 + "2"], "asks for 101 planes; give 100 at most"),
        (["raw.tif", "--white", "white.tif", "--focus", "1e9"], "more than the whole picture"),
        (["raw.tif", "--white", "white.tif", "--design", "paper", "--focus", "9 m/s"], "--focus"),
        (["raw.tif", "--white", "white.tif", "--design", "paper", "--focus", "100 mm"], "the camera sees nothing"),
        (["raw.tif", "--white", "white.tif", "--row", "99"], "none of the views' rows; give 0 to"),
        (["raw.tif", "--design", "paper", "--calibration", "."], "drop one"),
        (["raw.tif", "--calibration", "."], "calibration.json: no such file"),
        ([".", "--design", "paper"], "--design: goes with a raw image"),
        (["views"], "views: holds no pictures"),
        (["raw.tif", "--white", "white.tif", "-o", "raw.tif"], "is a file, not a folder"),
    ],
)
def test_what_cannot_be_had_is_one_line_and_nothing_written(capsys, captured, tmp_path, monkeypatch, arguments, said):
    for name in ("raw.tif", "white.tif"):
        (tmp_path / name).write_bytes((captured / name).read_bytes())
    (tmp_path / "junk.tif").write_text("junk")
    (tmp_path / "views").mkdir()
    tifffile.imwrite(tmp_path / "small.tif", np.zeros((30, 40), np.float32))
    tifffile.imwrite(tmp_path / "huge.tif", np.full((30, 40), 1e300))
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    code, printed, err = run(capsys, "decode", *arguments, *(["-o", "out"] if "-o" not in arguments else []))
    assert (code, printed) == (2, "")
    assert said in err
    assert len(err.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before
