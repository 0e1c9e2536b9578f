"""`roslf calibrate` end to end on a hexagonal array of round microlenses, with a dark frame."""

import json

import numpy as np
import pytest
import tifffile
from PIL import Image

from roslf_design.calibration.frames import read_image
from roslf_design.cli import main
from roslf_design.design import load, save
from roslf_design.imaging.render import render
from roslf_design.scenes import make_scene
from tests.bench.made import SAMPLING

CELL = 1.7
RAYS = ["-microlens_diffraction", "-fap_diffraction", "-microlens_defocus", "+object_defocus"]
POSES = [(-14, 28, 5), (25, -28, 8), (12, -24, -20)]
"""Distance from the focal plane [mm], tilts [deg]."""
LIGHT, FLOOR = 12_000, 400
"""Counts of a fully lit pixel, and of the sensor's darkness in a corner."""


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    """The paper's camera at a third of its size, hexagonal and slightly turned: counts over an uneven darkness."""
    paper = load("paper")
    pixel = 2 * paper.sensor.pixel
    size = (640 * pixel, 560 * pixel)
    camera = paper.replace(
        {
            "name": "hexagonal camera",
            "sensor.pixel": pixel,
            "sensor.size": size,
            "microlens_array.size": (size[0] + 0.5, size[1] + 0.5),
            "microlens_array.layout": "hexagonal",
            "microlens_array.lens_shape": "circular",
            "microlens_array.rotation": 0.004,
        },
        f=paper.f / 3, d_1=paper.d_1 / 3, d_3=paper.d_3 / 3, D=paper.D / 3, D_F=0.95 * paper.D_F / 3,
    )  # fmt: skip
    place = tmp_path_factory.mktemp("hexagonal")
    save(camera, place / "camera.toml")
    cells = np.pad(np.where(np.add.outer(np.arange(6), np.arange(7)) % 2 == 0, 20, 230), 1, constant_values=230)
    Image.fromarray(np.kron(cells, np.ones((24, 24))).astype(np.uint8)).save(place / "board.png")
    folder = place / "images"
    folder.mkdir()
    rng = np.random.default_rng(5)
    darkness = FLOOR * (1 + np.linspace(0, 4, 640)[None, :] * np.linspace(0, 1, 560)[:, None])

    def expose(pixels, name):
        counts = rng.poisson(np.maximum(pixels, 0) * LIGHT) + darkness
        tifffile.imwrite(folder / name, np.rint(counts).astype(np.uint16))

    expose(render(camera, overrides=[o for o in RAYS if "object" not in o], sampling=SAMPLING).pixels, "white.tif")
    expose(np.zeros((560, 640)), "dark.tif")
    for number, (away, about_x, about_y) in enumerate(POSES, 1):
        plane = {
            "kind": "plane",
            "distance": camera.d_f + away,
            "tilt": (np.radians(about_x), np.radians(about_y)),
            "size": (9 * CELL, 8 * CELL),
            "texture": {"kind": "image", "file": str(place / "board.png"), "width": 9 * CELL},
        }
        scene = make_scene({"name": "board", "objects": [plane], "background": 0.3})
        expose(render(camera, scene, overrides=RAYS, sampling=SAMPLING).pixels, f"board{number}.tif")
    return place, camera


def calibrated(capsys, place, out):
    code = main(
        [
            *("calibrate", str(place / "images"), "--design", str(place / "camera.toml")),
            *("--board", f"7x6 {CELL} mm", "-o", str(out), "--no-posterior", "--json"),
        ]
    )
    said, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return json.loads(said)


def test_hexagonal_round_and_dark_from_the_images_to_the_lengths(capsys, captured, tmp_path):
    place, camera = captured
    found = calibrated(capsys, place, tmp_path / "out")
    white = found["white_image"]
    assert white["layout"] == "hexagonal"
    assert white["rotation_rad"] == pytest.approx(0.004, abs=2e-4)
    assert white["pitch_px"] == pytest.approx(camera.d * (1 + camera.d_2 * exit_vergence(camera)) / camera.q, rel=2e-4)
    assert len(found["images_used"]) == len(POSES)
    assert found["reprojection_rms_pitches"] < 0.017  # square microlenses: 0.013
    assert max(found["residual_scales"].values()) < 2
    truth = {"H": camera.d_1 / (92 / 3), "d_3": 40.0, "d_1": camera.d_1, "d_f": camera.d_f, "d_2": 2.0, "m": 0.4}
    for name, true in truth.items():
        low, high = found["quantities"][name]["interval_95"]
        assert low < true < high, name


def exit_vergence(camera):
    """1/L by the textbook: the FAP imaged by the lens, seen from the array."""
    image = 1 / (1 / camera.f - 1 / camera.d_3)
    return 1 / (camera.d_1 - image)


def test_the_dark_frame_is_what_frees_the_light_from_the_sensor_s_own(capsys, captured, tmp_path):
    from roslf_design.calibration import decode, find_centres

    folder = captured[0] / "images"
    white, dark, board = (read_image(folder / f"{name}.tif") for name in ("white", "dark", "board1"))
    lattice = find_centres(white, dark, layout="hexagonal").lattice
    freed, left = (decode(board, lattice, white=white, dark=black) for black in (dark, None))
    view, weight = freed.view(), freed.view_weight()
    cells = view[weight > 0.9] / view[weight > 0.9].max()
    assert np.quantile(cells, 0.02) < 0.1  # black cells are black: 20 of 255
    assert left.view()[weight > 0.9].min() > 1.5 * view[weight > 0.9].min()
