"""The PyVista model: where parts are, what colour they have, and what happens without OpenGL."""

from __future__ import annotations

import io

import numpy as np
import pytest
import pyvista
from PIL import Image

from roslf_design.cli import main
from roslf_design.design import load
from roslf_design.drawing import solid
from roslf_design.drawing.solid import model, vtp_bytes
from roslf_design.drawing.theme import THEMES, rgb
from roslf_design.reporting.design.instrument import instrument_scene

PAPER = instrument_scene(load("paper"))


PARTS = {part.name: part for part in PAPER.parts}


def test_parts_stand_where_the_design_says():
    z = {name: np.mean(PARTS[name].points[:, 2]) for name in ("FAP plate", "lens", "MLA", "sensor")}
    assert z == pytest.approx({"FAP plate": -120, "lens": 0, "MLA": 140, "sensor": 142}, abs=1e-9)
    assert np.ptp(PARTS["sensor"].points[:, :2], axis=0) == pytest.approx((22.3, 14.932))
    assert PARTS["lens"].points[:, 0].max() == pytest.approx(25.4)


def test_every_cell_keeps_its_parts_colour_when_all_are_one_body(tmp_path):
    path = tmp_path / "model.vtp"
    path.write_bytes(vtp_bytes(PAPER))
    read = pyvista.read(path)
    assert read.n_cells == model(PAPER).n_cells > 2000
    colours = np.asarray(read.cell_data["colour"])
    centres = np.asarray(read.cell_centers().points)
    sensor = np.abs(centres[:, 2] - 142) < 1e-9
    flat = np.abs(centres[:, 0]) < 1e-9
    wanted = THEMES["light"].ink
    assert (colours[sensor & flat] == rgb(wanted)).all(axis=1).any()
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
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index.html", "tables"]


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
        solid.picture(PAPER, timeout=3)  # more than a pipe holds


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
