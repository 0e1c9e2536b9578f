"""The PyVista model: where parts are, what colour they have, and what happens without OpenGL."""

from __future__ import annotations

import io

import numpy as np
import pytest
import pyvista
from PIL import Image

from roslf_design.cli import main
from roslf_design.design import load
from roslf_design.pictures import solid
from roslf_design.pictures.solid import model, vtp_bytes

PAPER = load("paper")


def block(name):
    return model(PAPER)[name]


def test_parts_stand_where_the_design_says():
    z = {name: np.mean(block(name).bounds[4:]) for name in ("FAP plate", "lens", "MLA", "sensor")}
    assert z == pytest.approx({"FAP plate": -120, "lens": 0, "MLA": 140, "sensor": 142}, abs=1e-9)
    x0, x1, y0, y1 = block("sensor").bounds[:4]
    assert (x1 - x0, y1 - y0) == pytest.approx((22.3, 14.932))
    assert block("lens").bounds[1] == pytest.approx(25.4)


def test_the_bore_of_the_plate_is_open():
    """A ring's area is that of the polygons it is drawn with: pi (R^2 - r^2) less 1 - sinc(2 pi/72) = 0.13 %."""
    plate = block("FAP plate")
    radii = np.hypot(*np.asarray(plate.points)[:, :2].T)
    assert radii.min() == pytest.approx(1.45)
    assert plate.area == pytest.approx(np.pi * (radii.max() ** 2 - radii.min() ** 2), rel=1.5e-3)


def test_every_cell_keeps_its_parts_colour_when_all_are_one_body(tmp_path):
    path = tmp_path / "model.vtp"
    path.write_bytes(vtp_bytes(PAPER))
    read = pyvista.read(path)
    assert read.n_cells == sum(part.n_cells for part in model(PAPER))
    colours = np.asarray(read.cell_data["colour"])
    centres = np.asarray(read.cell_centers().points)
    sensor = np.abs(centres[:, 2] - 142) < 1e-9
    flat = np.abs(centres[:, 0]) < 1e-9
    wanted = np.asarray(block("sensor").cell_data["colour"])[0]
    assert (colours[sensor & flat] == wanted).all(axis=1).any()
    assert vtp_bytes(PAPER) == path.read_bytes()


@pytest.mark.usefixtures("few_builds", "without_figures")
def test_files_of_the_command(tmp_path, capsys):
    assert main(["report", "paper", "-o", str(tmp_path), "--figure", "model", "--figure", "3d"]) == 0
    told = capsys.readouterr()
    assert (tmp_path / "model.vtp").stat().st_size > 10_000
    if "left out" in told.err:
        assert "apt-get install" in told.err
        assert not (tmp_path / "3d.png").exists()
    else:
        image = np.asarray(Image.open(io.BytesIO((tmp_path / "3d.png").read_bytes())).convert("L"), float)
        assert 0.02 < (image < 200).mean() < 0.9


@pytest.mark.usefixtures("few_builds", "without_figures")
def test_without_opengl_the_picture_is_left_out_and_the_rest_is_made(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(solid, "backend", lambda environment: None)
    assert main(["report", "paper", "-o", str(tmp_path), "--figure", "3d"]) == 0
    assert "3d.png is left out: no OpenGL library is installed; on Debian: apt-get install" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]


@pytest.mark.parametrize("words", [["--compare", "paper", "rigid-scope"], ["studies/tolerance-paper/study.toml"]])
def test_a_model_is_of_one_design(tmp_path, capsys, words):
    assert main(["report", *words, "-o", str(tmp_path / "out"), "--figure", "model"]) == 2
    assert "3d and model are of one design" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("child", "reason"),
    [
        ("import os; os.close(1); os._exit(0)", "no picture came"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "apt-get install libegl1 libgl1-mesa-dri"),
        ("import sys; sys.exit('no such driver')", "no such driver"),
        ("import time; time.sleep(60)", "took more than"),
        ("print('not a picture')", "no picture came"),
    ],
)
def test_a_drawing_process_that_dies_fails_hangs_or_lies_is_told(monkeypatch, child, reason):
    monkeypatch.setattr(solid, "backend", lambda environment: "egl")
    monkeypatch.setattr(solid, "CHILD", ("-c", child))
    with pytest.raises(solid.NoPictureError, match=reason):
        solid.picture(PAPER.replace({"source": "far more than a pipe holds" * 10_000}), timeout=3)


@pytest.mark.parametrize(
    ("libraries", "display", "way"),
    [
        (("libEGL.so.1", "libX11.so.6", "libGL.so.1"), ":0", "egl"),
        (("libX11.so.6", "libGL.so.1"), ":0", "x"),
        (("libX11.so.6", "libGL.so.1"), "", None),
        (("libOSMesa.so",), "", "osmesa"),
        ((), ":0", None),
    ],
)
def test_way_to_draw(monkeypatch, libraries, display, way):
    monkeypatch.setattr(solid.sys, "platform", "linux")
    monkeypatch.setattr(solid, "_loads", lambda name: name in libraries)
    assert solid.backend({"DISPLAY": display}) == way
