"""`roslf datasheet` and `roslf sweep`, as a user types them."""

import csv
import json

import numpy as np
import pytest

import roslf_design as roslf
from tests.commands.test_cli import run

STUDY = """
name = "sheet"
design = "paper"
trials = 256
sobol_samples = 0
[[perturb]]
place = "aperture.diameter"
tolerance = "29 um"
[[goals]]
metric = "fill_factor"
min = 0.9
max = 1.1
"""


def test_a_sheet_tells_each_line_with_its_tolerance(tmp_path, capsys):
    (tmp_path / "study.toml").write_text(STUDY)
    for name in ("a.json", "a.csv"):
        code, out, _ = run(capsys, "datasheet", tmp_path / "study.toml", "-o", tmp_path / name)
        assert (code, out.strip()) == (0, str(tmp_path / name))
    told = json.loads((tmp_path / "a.json").read_text())
    lines = {line["name"]: line for line in told["lines"]}
    assert "256 builds" in told["basis"]
    assert "yield 100.00 %" in told["basis"]
    # Views across are in proportion to D_F: 1 % of tolerance, as a bound or as two deviations.
    views = lines["views across"]
    assert 0.5 < views["two_sigma"] / (0.01 * views["value"]) < 1.3
    assert lines["length"]["two_sigma"] == pytest.approx(0.0, abs=1e-9)
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == [line["name"] for line in told["lines"]]
    assert float(rows[0]["value"]) == told["specification"]["field_of_view_deg"][0]["diagonal"]


def test_a_page_of_one_design(tmp_path, capsys):
    code, _, _ = run(capsys, "datasheet", "video-otoscope", "-o", tmp_path / "sheet.html")
    page = (tmp_path / "sheet.html").read_text()
    assert code == 0
    assert all(words in page for words in ("ISO 8600-3", "no tolerance study is at hand", "direction of view", "folds"))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("datasheet", "paper", "-o", "sheet.docx"), ".pdf, .html, .json, .csv"),
        (("datasheet", "studies/story-otoscope/story.toml", "-o", "x.pdf"), "a story carries several designs"),
        (("sweep", "paper", "--set", "d_3=0..9", "--quantity", "fill_factor"), "no unit"),
        (("sweep", "paper", "--set", "d_3", "--quantity", "fill_factor"), "PLACE=FROM..TO UNIT"),
        (("sweep", "paper", "--set", "depth.contrast=0.1..0.2 mm", "--quantity", "sigma_z_mm"), "plain number"),
        (("sweep", "paper", "--set", "d_9=0..9 mm", "--quantity", "fill_factor"), "is not a number of this design"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fil_factor"), "did you mean 'fill_factor'"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "kept_fraction"), "belongs to a field"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "blur_pitches"), "at a distance"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fill_factor", "-o", "x.xlsx"), ".csv"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fill_factor", "--points", "1"), "--points"),
    ],
)
def test_bad_input_is_told_in_a_line(arguments, told, capsys):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert told in err
    assert err.count("\n") == 1


def test_a_sweep_is_its_single_cameras(tmp_path, capsys):
    places = ("--set", "aperture.distance=0..400 mm", "--set", "D_F=2..3 mm")
    quantities = ("--quantity", "fill_factor,mtf50_lp_per_mm")
    code, _, _ = run(capsys, "sweep", "paper", *places, *quantities, "--points", "3", "-o", tmp_path / "s.csv")
    assert code == 0
    with (tmp_path / "s.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 9
    for row in rows:
        d_3, D_F = float(row["aperture.distance [mm]"]), float(row["D_F [mm]"])
        if d_3 >= 350:
            assert row["fill_factor"] == ""
            continue
        camera = roslf.Camera.of(roslf.load("paper").replace(d_3=d_3, D_F=D_F))
        for name in ("fill_factor", "mtf50_lp_per_mm"):
            assert float(row[name]) == pytest.approx(float(roslf.quantity(name)(camera)), rel=1e-12)
    for kind in ("svg", "png"):
        code, _, _ = run(capsys, "sweep", "paper", *places, *quantities, "--points", "3", "-o", tmp_path / f"s.{kind}")
        assert code == 0
    picture = (tmp_path / "s.svg").read_text()
    assert "no camera" in picture
    assert "fill factor" in picture


def test_a_sweep_in_other_units(tmp_path, capsys):
    arguments = ("sweep", "paper", "--set", "light.illuminance=1e4..1e5 lx", "--quantity", "pixel_electrons")
    code, _, _ = run(capsys, *arguments, "--points", "2", "-o", tmp_path / "s.csv")
    rows = list(csv.reader((tmp_path / "s.csv").read_text().splitlines()))
    assert code == 0
    assert rows[0] == ["light.illuminance [lx]", "pixel_electrons"]
    assert [float(row[0]) for row in rows[1:]] == [1e4, 1e5]


def test_a_sweep_from_python():
    found = roslf.sweep(roslf.load("paper"), {"d_3": [20.0, 120.0]}, ["fill_factor", "sigma_z_mm"], at=100.0)
    assert found.units == {"fill_factor": "", "sigma_z_mm": "mm", "d_3": "mm"}
    assert np.isfinite(found.values["sigma_z_mm"]).all()
