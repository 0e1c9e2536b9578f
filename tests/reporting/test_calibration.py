"""A calibration in a report: the numbers and drawings of its folder, what is none, and plans that fit a design."""

import json
import re

import numpy as np
import pytest

from roslf_design.calibration.options import PlanOptions, calibration_plan, planned_lengths
from roslf_design.calibration.planning import Captures, field_at
from roslf_design.cli import main
from roslf_design.design import load, loads
from roslf_design.drawing.svg import file_of
from roslf_design.errors import InputError
from roslf_design.evaluation import evaluate
from roslf_design.reporting.blocks import Report
from roslf_design.reporting.calibrate.pages import (
    calibrated_finding,
    plan_blocks,
    plan_finding,
    planned_depth,
    read_calibration,
)
from roslf_design.reporting.printers import render_html
from roslf_design.reporting.sheet.lines import CalibrationSpread, basis
from roslf_design.reporting.story import _read_story
from roslf_design.theory.length_covariance import LengthCovariance
from tests.reporting.made import rough_resolution, views_as_refocused

pytestmark = pytest.mark.usefixtures("found_once")
SHARES = {"images": 0.25, "f": 0.7, "q": 0.0, "d": 0.0, "board": 0.0, "systematic": 0.05}
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="9pt" height="9pt">\n<text>ridge</text>\n</svg>'


def row(estimate, sigma, unit):
    return {
        "estimate": estimate,
        "unit": unit,
        "sigma": sigma,
        "interval_68": [estimate - sigma, estimate + sigma],
        "interval_95": [estimate - 2 * sigma, estimate + 2 * sigma],
        "r_hat": 1.001,
        "ess": 2000.0,
        "variance_shares": SHARES,
    }


DATA = {
    "schema": "roslf.calibration/1",
    "design": "Zhou 2023 bench system",
    "intervals_from": "posterior",
    "quantities": {"H": row(1.5234, 0.0123, ""), "d_3": row(120.456, 2.34, "mm"), "d_2": row(2.00123, 0.00456, "mm")},
    "converged": True,
    "posterior": {"message": "converged: R-hat 1.001"},
    "images_used": ["a.tif", "b.tif"],
    "warnings": [],
}


def written(folder, **changes):
    (folder / "calibration.json").write_text(json.dumps({**DATA, **changes}))
    (folder / "posterior.svg").write_bytes(file_of(SVG))
    return folder


def test_numbers_and_drawings_are_those_of_the_folder(tmp_path):
    section = calibrated_finding(load("paper"), read_calibration(written(tmp_path))).section
    said, quantities, shares, figure = section.blocks
    text = "H = 1.523 ± 0.012, d_3 = 120.5 ± 2.3 mm (standard deviations)."
    assert said.items[0].text == f"Calibrated from 2 images: a signed calibration may quote H, d_3 and d_2. {text}"
    assert [item.tone for item in said.items] == ["good", "good"]
    expected = ("d_3", "120.5", "mm", "2.3", "118.1 to 122.8", "115.8 to 125.1", "1.0010", "2000", "✓")
    assert quantities.rows[1] == expected
    assert shares.rows[0] == ("H", "25.0 %", "70.0 %", "5.0 %")
    assert figure.content == SVG
    assert "ridge" in render_html(Report("a", "", (section,)))


def test_a_sigma_as_large_as_the_length_is_a_cross_and_one_over_a_tenth_a_reserve(tmp_path):
    """Of f focused at infinity m is nothing, and d_f by it; H is known by its own; d_3 at the lens against d_1."""
    rows = {
        "d_3": row(0.005, 3.0, "mm"),
        "d_1": row(51.0, 0.5, "mm"),
        "d_2": row(2.0, 0.21, "mm"),
        "A": row(5.0, 5.0, ""),
    }
    rows |= {"m": row(1e-4, 2e-4, ""), "H": row(1.0, 0.01, ""), "d_f": row(-9.0, 0.1, "mm")}
    finding = calibrated_finding(load("paper"), read_calibration(written(tmp_path, quantities=rows)))
    marks = {cells[0]: cells[-1] for cells in finding.section.blocks[1].rows}
    assert marks == {"d_3": "✓", "d_1": "✓", "d_2": "!", "A": "✗", "m": "✗", "H": "✓", "d_f": "✗"}
    assert finding.statement.tone == "bad"
    quoted = "may quote d_3, d_1 and H; with reserve d_2 (sigma over 10 % of it); not A, m and d_f (sigma as large"
    assert quoted in finding.statement.text


def test_warnings_lost_convergence_and_another_design_are_told(tmp_path):
    found = read_calibration(written(tmp_path, converged=False, warnings=["dim"], design="another"))
    said = calibrated_finding(load("paper"), found).section.blocks[0]
    assert [item.tone for item in said.items] == ["caution", "bad", "caution"]
    assert "another design: another" in said.items[2].text


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (None, "no such file"),
        ("{", "no JSON"),
        ('{"schema": "roslf.evaluation/1"}', "is no calibration"),
        ("[1]", "is no"),
    ],
)
def test_what_is_no_calibration_is_told(tmp_path, capsys, content, complaint):
    if content is not None:
        (tmp_path / "calibration.json").write_text(content)
    assert main(["report", "paper", "--calibration", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def changed(**changes):
    """The numbers with some of d_3's changed; None takes one away."""
    quantities = {name: dict(values) for name, values in DATA["quantities"].items()}
    quantities["d_3"] = {key: value for key, value in (quantities["d_3"] | changes).items() if value is not None}
    return json.dumps({**DATA, "quantities": quantities})


def without(key):
    return json.dumps({name: value for name, value in DATA.items() if name != key})


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"\xff\xfe\x00", "is damaged, or no JSON"),
        (b"[" * 100_000, "is damaged, or no JSON"),
        (json.dumps(DATA).replace("2.34", "NaN"), "is damaged, or no JSON"),
        (json.dumps({**DATA, "quantities": {}}), "quantities lacks H, d_3"),
        (json.dumps({**DATA, "quantities": {"H": 1, "d_3": 2}}), "quantities.H: must be a table"),
        (json.dumps({**DATA, "posterior": {}}), "posterior.message: is missing"),
        (json.dumps({**DATA, "design": 7}), "design: "),
        (json.dumps({**DATA, "warnings": 7}), "warnings: "),
        (without("design"), "design: is missing"),
        (without("quantities"), "quantities: is missing"),
        (changed(sigma=None), "quantities.d_3.sigma: is missing"),
        (changed(sigma="x"), "quantities.d_3.sigma: "),
        (changed(sigma="0.1"), "quantities.d_3.sigma: "),
        (changed(sigma=-1.0), "must not be negative"),
        (changed(interval_68=[1.0]), "quantities.d_3.interval_68: must be a list of 2"),
        (changed(variance_shares=[1.0]), "quantities.d_3.variance_shares: "),
        (changed(r_hat=None), "lacks r_hat or ess"),
    ],
)
def test_a_damaged_calibration_is_told_in_one_line(tmp_path, capsys, content, complaint):
    (tmp_path / "calibration.json").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert main(["report", "paper", "--calibration", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "svg", [SVG.replace("ridge", "ridge<script>document.title = 1</script>").encode(), b"no picture", b"\xff" * 9]
)
def test_a_drawing_that_is_none_of_ours_does_not_come_into_a_report(tmp_path, capsys, svg):
    (written(tmp_path) / "posterior.svg").write_bytes(svg)
    assert main(["report", "paper", "--calibration", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "posterior.svg: " in said
    assert "delete the file, or calibrate again" in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_story_may_end_in_a_calibration(tmp_path):
    written(tmp_path)
    data = {"story": {"title": "t", "design": "paper"}, "parts": [{"calibrated": "."}]}
    story = _read_story(data, tmp_path, "story.toml")
    assert story.calibrations[0].data["quantities"]["d_3"]["sigma"] == 2.34
    with pytest.raises(InputError, match=r"story.toml: parts.0.calibrated: .*no such file"):
        _read_story({**data, "parts": [{"calibrated": "gone"}]}, tmp_path, "story.toml")


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "ear-speculum"])
def test_a_board_of_our_own_choosing_is_seen_whole_at_its_nearest(name):
    design = load(name)
    captures = Captures.for_design(design)
    board = captures.board
    sides = sorted((board.columns * board.cell, board.rows * board.cell))
    seen = sorted(field_at(design, captures.distance - captures.distance_range / 2))
    assert all(0.2 * field < side < field for side, field in zip(sides, seen, strict=True))


def test_a_plan_tells_boards_too_large_and_captures_that_determine_nothing():
    paper = load("paper")
    part = PlanOptions(board="6x5 90 mm", boards=3)
    said = plan_finding(paper, part).section.blocks[1].items
    assert "the sensor sees only" in said[1].text
    flat = PlanOptions(boards=2, tilt=1e-9, range=1e-9)
    why = calibration_plan(paper, flat)
    assert isinstance(why, str)
    assert plan_finding(paper, flat).section.blocks[0].items[0].text == f"No plan: {why}."
    with pytest.raises(InputError, match=r'^f_sigma: "sharp" is not understood'):
        PlanOptions(f_sigma="sharp")


COLLIMATED = """
name = "collimated"
[main_lens]
diameter = "50 mm"
focal_length = "100 mm"
[aperture]
diameter = "2.9 mm"
distance = "120 mm"
[[elements]]
kind = "lens"
distance = "150 mm"
focal_length = "200 mm"
diameter = "60 mm"
[microlens_array]
pitch = "63 um"
focal_length = "2 mm"
distance = "100 mm"
size = ["23 mm", "23 mm"]
[sensor]
distance = "2 mm"
pixel = "4.85 um"
size = ["22.3 mm", "14.9 mm"]
[light]
wavelength = "550 nm"
"""
"""A camera whose main lens is focused at infinity, and in its element's front focus by that."""


def test_a_plan_leads_with_depth_and_names_what_its_poses_do_not_determine(monkeypatch):
    """Of a main lens focused at infinity d_f = f (1 + m)/m is known to no digit, depth is."""
    rough_resolution(monkeypatch)
    views_as_refocused(monkeypatch)
    paper = load("paper")
    asked = PlanOptions(at=(300.0,), distance=350.0, range=60.0, f_sigma="0.1 %")
    # One answer more than before: which of the distances asked for the boards cover; these stand nearer.
    depth, cover, lengths = plan_finding(paper, asked).section.blocks[1].items
    assert "cover nothing; not 300 mm, as views are sharp only up to 272 mm" in cover.text
    assert cover.tone == "caution"
    plan = calibration_plan(paper, asked)
    at_focus, there = (2 * float(planned_depth(paper, plan, asked, at=z).u_z_mm) for z in (None, 300.0))
    assert f"U = ± {at_focus:.3g} mm in the focal plane" in depth.text
    assert f"± {there:.3g} mm at 300 mm ahead of the tip" in depth.text
    assert depth.text.count("there the model alone tells depth") == 1  # boards stand about the focal plane
    assert "the model alone tells depth. Assumes a board" in depth.text
    assert depth.text.startswith("Calibration as planned, by captures alone: ")
    warm = paper.replace({"environment": {"range": ["15 degC", "70 degC"], "housing": "aluminium"}})
    told = plan_finding(warm, asked).section.blocks[1].items[0].text
    ends = r" at -?\d+ °C, the worse end of environment.range, U = [\d.]+ mm"
    assert re.search(rf"in the focal plane, mostly [^;,]+, but{ends}; ± ", told)
    assert re.search(
        rf"at 300 mm ahead of the tip, mostly [^;,]+, but{ends}, and no board covers that distance: ", told
    )
    built = LengthCovariance(("sensor.distance",), np.array([[1e-6]]))
    text, *_, alone = (item.text for item in plan_finding(paper, asked, built).section.blocks[1].items)
    assert text.startswith("Calibration as planned, with tolerances known before: ")
    assert alone.startswith("By captures alone, of a camera whose tolerances nobody knows: ")
    assert alone.endswith(f": ± {at_focus:.3g} mm in the focal plane.")
    assert "in front of the lens, over 60 mm (± 30);" in plan_blocks(paper, plan, asked)[0].text
    # A camera is never known worse than it was built, nor than captures alone tell it.
    alone = plan.expected.sigma["d_3"]
    for made in (0.02 * alone, alone, 50 * alone):
        built = LengthCovariance(("aperture.distance",), np.array([[made**2]]))
        text = plan_blocks(paper, plan, asked, built)[1].items[2].text
        assert float(text.partition("d_3 to ")[2].split()[0]) <= 1.03 * min(made, alone)
        assert f"captures alone tell d_3 to {alone:.2g} mm" in text
    required = paper.replace({"required": {"u_z_mm": [{"max": 1e3}, {"at": 300.0, "max": 1e-3}]}})
    told = [item.text for item in plan_finding(required, asked, built).section.blocks[1].items]
    assert [text.partition(":")[0] for text in told[2:4]] == ["As required", "Not as required"]
    required = paper.replace({"required": {"u_z_mm": [{"max": 1e3}, {"at": 300.0, "max": 1e3}]}})
    lengths_known = planned_lengths(required, asked)
    grounds = basis(required, None, CalibrationSpread("as planned", required, lengths_known), asked.at)
    alone = [row.name for row in grounds.rows if "no board covers that distance" in row.remark]
    assert [name.endswith("at 300 mm") for name in alone] == [True, True]  # the required one and that of "expected"
    (near, away, *_) = evaluate(required, at=asked.at, calibration=lengths_known).verdicts
    assert ["model alone" in one.text for one in (near, away)] == [False, True]
    assert "H to" in lengths.text
    assert "ot determined" not in lengths.text
    far = loads(COLLIMATED)
    plan = calibration_plan(far, PlanOptions())
    blocks = plan_blocks(far, plan, PlanOptions())
    depth, lengths = blocks[1].items
    assert "focal plane at infinity, so m is 0 and d_f is infinite." in lengths.text
    assert "ot determined" not in lengths.text
    assert "d_2 to" in lengths.text
    at_focus = 2 * float(planned_depth(far, plan, PlanOptions()).u_z_mm)
    assert at_focus < 30.0
    assert f"± {at_focus:.3g} mm in the focal plane" in depth.text
    rows = {row[0]: row[1] for row in blocks[2].rows}
    assert list(rows) == ["H", "d_3", "d_1", "d_2", "A"]
    # 1/H = 1 - d_3/d_f: by the sigma of 1/d_f, in which both are linear.
    assert float(rows["H"]) < 0.02
    assert [row[0] for row in blocks[2].rows if row[-1] == "✗"] == []
    assert lengths.tone == "plain"
