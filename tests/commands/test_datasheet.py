"""`roslf datasheet` and `roslf sweep`, as a user types them."""

import csv
import functools
import hashlib
import itertools
import json
import re
import tomllib

import numpy as np
import pytest
import tomli_w

import roslf_design as roslf
from roslf_design.calibration.options import PlanOptions, calibration_plan, planned_lengths
from roslf_design.camera import Camera
from roslf_design.commands import report as report_command
from roslf_design.design import dumps
from roslf_design.drawing.marks import Dots, Line, Text
from roslf_design.drawing.theme import text_width
from roslf_design.evaluation.evaluate import held_to
from roslf_design.reporting import story
from roslf_design.reporting.blocks import Report
from roslf_design.reporting.calibrate.pages import planned_depth
from roslf_design.reporting.depth.pages import _beside_expected
from roslf_design.reporting.sheet import lines as datasheet
from roslf_design.reporting.sheet.lines import (
    BY_DEFINITION,
    DEPTH,
    EXPECTED,
    basis,
    datasheet_report,
    datasheet_section,
)
from roslf_design.reporting.sweep import sweep_picture
from roslf_design.tables import Table
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.limits import limits
from roslf_design.theory.tube import WIDTHS
from roslf_design.tolerancing.study import tolerance_plan
from roslf_design.tolerancing.trials import lengths_built
from tests.commands.test_cli import run
from tests.reporting.made import rough_resolution, views_as_refocused

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


@pytest.fixture
def rough(monkeypatch):
    """As `rough_resolution` says: where nobody looks at it."""
    rough_resolution(monkeypatch)
    views_as_refocused(monkeypatch)


def test_a_sheet_tells_each_line_with_its_tolerance(tmp_path, capsys, monkeypatch):
    (tmp_path / "study.toml").write_text(STUDY)
    for name, builds in (("a.json", datasheet.FEW), ("a.csv", 4)):  # of the table names and values are looked at
        monkeypatch.setattr(datasheet, "FEW", builds)
        code, out, _ = run(capsys, "datasheet", tmp_path / "study.toml", "-o", tmp_path / name)
        assert (code, out.strip()) == (0, str(tmp_path / name))
    told = json.loads((tmp_path / "a.json").read_text())
    lines = {line["name"]: line for line in told["lines"]}
    assert "256 Monte Carlo units" in told["basis"]
    assert "yield 100.00 %" in told["basis"]
    # Views across are in proportion to D_F: 1 % of tolerance, as a bound or as two deviations.
    views = lines["views across"]
    assert 0.5 < views["two_sigma"] / (0.01 * views["value"]) < 1.3
    assert lines["length"]["two_sigma"] == pytest.approx(0.0, abs=1e-9)
    # Depth as expected is an uncertainty itself, in which tolerances have a part: it has none of its own. No more have
    # numbers that an ideal lens has by definition.
    assert all(
        (line["two_sigma"] is None) == (line["subject"] == EXPECTED or BY_DEFINITION in line["remark"])
        for line in told["lines"]
        if line["value"] is not None
    )
    # At distances and fields the spread is that of D_F, too, to what 48 builds tell of it.
    share, paper = views["two_sigma"] / views["value"], roslf.load("paper")
    ends = [roslf.specification(paper.replace(D_F=paper.D_F * (1 + step))) for step in (-0.01, 0.01)]
    for row, name in (
        (0, "refocused, 199.4 mm ahead (near end), axis"),
        (5, "refocused, 230 mm ahead (focal plane), corner of the field"),
        (9, "a view, 199.4 mm ahead (near end), axis"),
    ):
        low, high = (sheet.resolution[row].usable_lp_per_mm for sheet in ends)
        assert lines[name]["two_sigma"] == pytest.approx(abs(high - low) / 0.02 * share, rel=0.25), name
    assert lines["width at 199.4 mm (near end)"]["two_sigma"] == pytest.approx(0.0, abs=1e-9)
    with (tmp_path / "a.csv").open() as file:
        first, second, *rows = csv.DictReader(file)
    assert [(row["name"], row["text"]) for row in (first, second)] == [("design", told["design"]), ("revision", "–")]
    assert [row["name"] for row in rows] == [line["name"] for line in told["lines"]]
    assert float(rows[0]["value"]) == told["specification"]["field_of_view_deg"][0]["diagonal"]


def test_spreads_do_not_hang_on_what_a_study_reports(rough):
    """Behind a real lens they are scaled by what rays tell, as the study's own columns are."""
    lens = roslf.load("paper-singlet")
    study = {"name": "s", "grade": "commercial", "trials": 1024, "sobol_samples": 0, "fields": ["centre"]}
    study["goals"] = [{"quantity": "object_sample_mm", "min": 0.0}]
    (row,) = (row for row in datasheet.basis(lens).rows if row.quantity == "field_of_view_deg")
    told = (story._builds_alone(study | {"report": names}, lens).deviations([row]) for names in ([], [row.quantity]))
    unreported, reported = (deviations[row.quantity] for deviations in told)
    assert unreported == pytest.approx(reported * np.sqrt(1024 / 1023), rel=1e-9)  # of a sample, of all that were drawn


def test_a_distance_asked_for_stays_where_it_is_in_every_build(tmp_path, capsys, monkeypatch):
    """In the focal plane's place, too, whose own rows say what its moving from build to build adds."""
    monkeypatch.setattr(datasheet, "FEW", 8)
    study = STUDY + '[[perturb]]\nplace = "microlens_array.distance"\ntolerance = "0.5 mm"\n'
    (tmp_path / "study.toml").write_text(study)
    asked = ("--at", "230mm", "--at", "230.1mm", "-o", tmp_path / "a.json")
    assert run(capsys, "datasheet", tmp_path / "study.toml", *asked)[0] == 0
    lines = [line for line in json.loads((tmp_path / "a.json").read_text())["lines"] if line["two_sigma"] is not None]
    spread = {line["name"]: line["two_sigma"] for line in lines}
    assert len(spread) == len(lines)  # no name stands twice
    for name in (
        "width at {}",
        "magnification at {}",
        "object sample at {}",
        "refocused, {}, axis",
        "a view, {}, axis",
    ):
        ahead = "{} mm ahead ({})" if "axis" in name else "{} mm ({})"
        here, beside = (spread[name.format(ahead.format(at, "asked for"))] for at in (230, 230.1))
        assert here == pytest.approx(beside, rel=0.01), name
        assert spread[name.format(ahead.format(230, "focal plane"))] > 2 * here, name


def test_small_lengths_and_their_spreads_are_printed_in_one_unit_without_powers_of_ten(tmp_path, rough):
    (tmp_path / "design.toml").write_text(
        roslf.dumps(roslf.load("rigid-scope").replace({"depth.disparity_error": 1e-4}))
    )
    (tmp_path / "study.toml").write_text(STUDY.replace('"paper"', '"design.toml"').replace("29 um", "2 um"))
    section = datasheet_section(story.datasheet_of(tmp_path / "study.toml"))
    rows = [
        row for block in section.blocks if getattr(block, "title", "").startswith("Depth noise") for row in block.rows
    ]
    assert all(row[1].endswith(" mm") for row in rows)
    assert not any("e-" in cell for row in rows for cell in row[1:3])
    _, value, spread, *_ = next(row for row in rows if row[2] != "–")
    assert 0 < float(value.split()[0]) < 0.1
    assert float(spread.split()[-1]) < float(value.split()[0])  # of the same unit: some per cent of it


def test_what_is_required_is_printed_in_the_unit_of_its_limit():
    scope = roslf.load("rigid-scope").replace({"depth.disparity_error": 1e-4})
    required = roslf.loads(roslf.dumps(scope) + '\n[required]\nu_z_mm = {max = "0.25 mm"}\n')
    (line,) = (line for line in datasheet.basis(required).rows if line.subject == "Required")
    assert 0 < line.value < 0.1
    assert datasheet._value(line) == f"{line.value:.4g} mm"
    assert "at most 0.25 mm" in line.remark


def test_what_is_required_says_how_many_builds_meet_it(tmp_path, capsys, monkeypatch, rough):
    """Views across are in proportion to D_F, whose misses are even: half of the builds have fewer than nominal."""
    monkeypatch.setattr(datasheet, "FEW", 4)
    views = float(roslf.quantity("views_geometric")(Camera.of(roslf.load("paper"))))
    limits = f"views_geometric = {{min = {views!r}}}\nfill_factor = {{min = 0.9, max = 1.1}}\nu_z_mm = {{max = 9}}\n"
    (tmp_path / "design.toml").write_text(roslf.dumps(roslf.load("paper")) + f"\n[required]\n{limits}")
    study = STUDY.replace('"paper"', '"design.toml"') + '[[perturb]]\nplace = "sensor.distance"\ntolerance = "2 um"\n'
    (tmp_path / "study.toml").write_text(study)
    assert run(capsys, "datasheet", tmp_path / "study.toml", "-o", tmp_path / "a.json")[0] == 0
    lines = json.loads((tmp_path / "a.json").read_text())["lines"]
    across, fill, depth = (line for line in lines if line["subject"] == "Required")
    share, count = re.search(r"; ([0-9.]+) % of ([0-9,]+) builds meet it$", across["remark"]).groups()
    assert 40 < float(share) < 60
    of = int(count.replace(",", ""))
    assert float(share) * of / 100 == pytest.approx(round(float(share) * of / 100), abs=0.2)  # a whole number of them
    assert across["two_sigma"] > 0
    assert "; 100 % of " in fill["remark"]  # the study's own limit
    assert depth["remark"].endswith("of the nominal design")
    outcome = "~ marginal" if float(share) >= 50 else "✗ missed"  # of a target yield of 95 %
    assert across["remark"].startswith(f"{outcome}: at least")
    assert fill["remark"].startswith("✓ met: ")
    grounds = story.datasheet_of(tmp_path / "study.toml")
    result = held_to(roslf.evaluate(tmp_path / "design.toml", build=grounds.build), grounds.required)
    levels = [one.level for one in result.verdicts if one.name.startswith("required")]
    assert levels == [
        "limit" if float(share) >= 50 else "fault",
        "good",
        "good",
    ]
    assert run(capsys, "tolerance", tmp_path / "study.toml", "-o", tmp_path / "fill")[0] == 0
    assert json.loads((tmp_path / "fill/results.json").read_text())["yield"]["left_out"] == ""  # no goal of depth
    (tmp_path / "study.toml").write_text(study + '[[goals]]\nmetric = "u_z_mm"\nmax = 9\n')
    assert run(capsys, "tolerance", tmp_path / "study.toml", "-o", tmp_path / "out")[0] == 0
    says = f"nobody calibrates, u = {depth['value']:.3g} mm in the focal plane"
    assert says in json.loads((tmp_path / "out/results.json").read_text())["yield"]["left_out"]
    pages = [(tmp_path / "out" / page).read_text() for page in ("summary.txt", "index.html")]
    assert all(says in " ".join(page.split()) for page in pages)
    words = story.datasheet_of(tmp_path / "study.toml").words
    assert (
        f" meet everything required and the study's limits (but {depth['name']}, which builds do not tell). " in words
    )


@pytest.mark.usefixtures("rough")
def test_the_sheet_one_signs_names_its_design_and_ends_where_depth_is_of_little_use(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    for name, *more in (("a.json",), ("b.json", "--stamp"), ("a.html",), ("b.html", "--stamp")):
        assert run(capsys, "datasheet", "paper", "--revision", "C7", "-o", tmp_path / name, *more)[0] == 0
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    told = json.loads((tmp_path / "a.json").read_text())
    digest = hashlib.sha256(roslf.dumps(roslf.load("paper")).encode()).hexdigest()[:12]
    assert (told["revision"], told["design_hash"]) == ("C7", digest)
    plain, dated = ((tmp_path / name).read_text() for name in ("a.html", "b.html"))
    assert ("1970-01-02" in plain, "1970-01-02" in dated) == (False, True)
    assert all(words in plain for words in ("C7", digest, "prepared", "checked", "approved", "figure-dimensions"))
    lines = {line["name"]: line for line in told["lines"]}
    assert lines["evenly lit"]["text"] == "yes"
    near, far = told["specification"]["working_range_mm"]
    assert [lines[f"working range, as drawn, {end}"]["value"] for end in ("near", "far")] == [near, far]
    # Of the paper's bench views blur long before depth is of no use.
    assert [near, far] == told["specification"]["depth_of_field_mm"]["view"]
    scope = datasheet.basis(roslf.load("rigid-scope"))
    (useful,) = (line.value for line in scope.rows if line.name == "working range, as drawn, far")
    camera = roslf.Camera.of(scope.design)
    assert float(depth_budget(camera, useful).expanded_mm) <= 0.1 * useful
    assert all(float(depth_budget(camera, far * useful).expanded_mm) > 0.1 * far * useful for far in (1.01, 2.0, 20.0))


def test_what_spreads_are_taken_of_is_the_design_s_own_value_on_the_design():
    """Lines at a distance or a field, detail of single views among them, which reports' tests take for another's."""
    paper = roslf.load("paper")
    rows = [row for row in datasheet.basis(paper).rows if row.of is not None and row.value is not None]
    assert any(row.subject.startswith("Resolution") for row in rows)
    for row in rows:
        assert row.of(Camera.of(paper)) == pytest.approx(row.value, rel=1e-6), row.key


def test_spreads_are_of_builds_that_can_be_put_together(tmp_path, monkeypatch, capsys):
    window = {"kind": "plate", "distance": 121.0, "thickness": 4.0, "material": "N-BK7", "diameter": 20.0}
    roslf.save(roslf.load("paper").replace({"elements": [window]}), tmp_path / "design.toml")
    study = STUDY.replace('"paper"', '"design.toml"').replace("aperture.diameter", "aperture.distance")
    (tmp_path / "study.toml").write_text(study.replace("29 um", "2 mm").replace("[[goals]]", DOWN))
    monkeypatch.setattr(datasheet, "FEW", 8)
    assert run(capsys, "datasheet", tmp_path / "study.toml", "-o", tmp_path / "a.json")[0] == 0
    told = json.loads((tmp_path / "a.json").read_text())
    assert "of the builds cannot be put together: FAP and plate 1 collide" in told["basis"]
    for line in told["lines"]:
        if (
            line["subject"]
            in (
                "Field of view",
                "Distances",
                "Depth noise (bound), 1 σ",
                "Resolution",
            )
            and line["name"] != "light that depth assumes"
        ):  # words
            assert line["two_sigma"] is not None, line["name"]


DOWN = """distribution = "uniform"
[[goals]]"""

WINDOWED = {
    "object_space.medium": "water",
    "elements": [{"kind": "plate", "distance": 130.0, "thickness": 1.0, "material": "sapphire"}],
}
PLACES = {"aperture.distance": 0.05, "microlens_array.distance": 0.1, "sensor.distance": 0.004,
          "main_lens.focal_length": 0.04, "elements.0.thickness": 0.02}  # fmt: skip
"""Of that camera, with what each may be off by [mm]."""


@pytest.fixture
def calibration(tmp_path):
    """A folder as `roslf calibrate` leaves it, of a camera in water whose lengths err together."""
    design = roslf.load("paper").replace(WINDOWED)
    mixing = np.random.default_rng(0).normal(size=(5, 5)) * np.array([*PLACES.values()])[:, None]
    (tmp_path / "monday").mkdir()
    quantity = {"estimate": 1.0, "unit": "mm", "sigma": 1.0, "interval_68": [0, 1], "interval_95": [0, 1]}
    data = {
        "schema": "roslf.calibration/1", "design": design.name,
        "quantities": {name: {**quantity, "variance_shares": {}} for name in ("H", "d_3")},
        "covariance": {"places": [*PLACES], "matrix": (mixing @ mixing.T).tolist()},
    }  # fmt: skip
    (tmp_path / "monday" / "calibration.json").write_text(json.dumps(data))
    roslf.save(design.replace({"name": f"{design.name}, calibrated"}), tmp_path / "monday" / "calibrated.toml")
    return design, mixing, tmp_path / "monday"


def test_what_a_calibration_leaves_uncertain_against_cameras_drawn_from_it(calibration, tmp_path, capsys):
    design, mixing, folder = calibration
    roslf.save(design, tmp_path / "design.toml")
    arguments = ("datasheet", tmp_path / "design.toml", "--calibration", folder)
    code, _, _ = run(capsys, *arguments, "-o", tmp_path / "a.json")
    assert code == 0
    sheet = json.loads((tmp_path / "a.json").read_text())
    assert sheet["design"] == f"{design.name}, calibrated"
    assert all(words in sheet["basis"] for words in ("monday", "two standard deviations", "plate 1 thickness"))
    (known,) = (line for line in sheet["lines"] if line["name"] == "u in the focal plane from lengths as calibrated")
    assert (known["value"] > 0, known["remark"]) == (True, "by its pictures, its data sheet known before")
    draws = mixing @ np.random.default_rng(1).normal(size=(5, 600))
    best = roslf.Camera.of(design)
    drawn = roslf.Camera.of(design, {place: float(best[place]) + off for place, off in zip(PLACES, draws, strict=True)})
    told = {line["quantity"]: line["calibration_two_sigma"] for line in sheet["lines"] if line["quantity"]}
    assert len(told) > 18
    for name, sigma in told.items():
        scatter = 2 * np.std(np.broadcast_to(roslf.quantity(name)(drawn), 600))
        # 600 draws tell a standard deviation to 3 %; four of those. What hangs on no length is known but for rounding.
        assert sigma == pytest.approx(scatter, rel=0.12, abs=1e-9), name
    code, _, err = run(capsys, "datasheet", "rigid-scope", "--calibration", folder, "-o", tmp_path / "b.json")
    assert (code, err.count("\n")) == (2, 1)
    assert "drop the wrong one" in err


def test_a_report_with_a_calibration_begins_with_the_page_of_that_instrument(calibration, monkeypatch, capsys, rough):
    design, _, folder = calibration
    sheets = []

    def caught(*_, grounds, **__):
        sheets.append(grounds and datasheet_section(grounds))
        return Report(design.name, "", (sheets[-1],) if grounds else ())

    monkeypatch.setattr(story, "design_report", caught)
    monkeypatch.setattr(story, "_first_look", lambda *_, **__: ({}, None))
    monkeypatch.setattr(story, "calibrated_finding", lambda *_: None)
    roslf.save(design, folder.parent / "water.toml")
    told = ("--calibration", folder, "-o", folder.parent / "out")
    assert run(capsys, "report", folder.parent / "water.toml", *told)[0] == 0
    code, _, _ = run(capsys, "datasheet", folder.parent / "water.toml", *told[:2], "-o", folder.parent / "s.json")
    assert code == 0
    paragraph, table, *_ = sheets[0].blocks
    assert "Values are those of that instrument" in paragraph.text
    assert "± 2σ, calibrated" in table.headings
    data = json.loads((folder / "calibration.json").read_text())
    (folder / "calibration.json").write_text(json.dumps({k: v for k, v in data.items() if k != "covariance"}))
    assert run(capsys, "report", folder.parent / "water.toml", *told)[0] == 0
    assert sheets[1].blocks[0].text == datasheet.NOMINAL  # an older one: lines stay nominal


def test_the_sheet_of_a_story_is_of_the_design_it_ends_with(tmp_path, capsys, monkeypatch, rough):
    monkeypatch.setattr(datasheet, "FEW", 4)  # lines at a distance or a field are not looked at
    (tmp_path / "study.toml").write_text(STUDY)
    parts = """
[story]
title = "built and calibrated"
design = "paper"
[[parts]]
tolerance = "study.toml"
[[parts]]
calibration = { boards = 9 }
"""

    def told_of(text):
        (tmp_path / "story.toml").write_text(text)
        code, _, _ = run(capsys, "datasheet", tmp_path / "story.toml", "-o", tmp_path / "a.json")
        assert code == 0
        return json.loads((tmp_path / "a.json").read_text())

    told = told_of(parts)
    assert all(words in told["basis"] for words in ("256 Monte Carlo units", "as planned"))
    assert "derivatives over d_3, d_1, d_2" in told["basis"]  # words, not keys of a file
    lines = {line["quantity"]: line for line in told["lines"]}
    assert lines["views_geometric"]["two_sigma"] > 0
    # The calibration does not see D_F, and all else is built exactly: it stays as it was.
    # 256 builds tell it to 4 %.
    views = lines["views_geometric"]
    assert views["calibration_two_sigma"] == pytest.approx(views["two_sigma"], rel=0.15)
    assert lines["total_length_mm"]["calibration_two_sigma"] == pytest.approx(0.0, abs=1e-9)
    told = told_of(parts.replace('[[parts]]\ntolerance = "study.toml"\n', ""))
    lines = {line["quantity"]: line for line in told["lines"]}
    code, out, _ = run(capsys, "calibrate", "--plan", "paper", "--boards", 9, "--json")
    sigma = json.loads(out)["expected_sigma"]
    # d_3, d_1 and d_2 add up to the length, and an error of f makes all longer. A tenth for one of eight sets of poses.
    assert code == 0
    assert lines["total_length_mm"]["calibration_two_sigma"] == pytest.approx(
        2 * (sigma["d_3"] + sigma["d_1"]), rel=0.1
    )


def test_a_calibrated_camera_is_not_known_worse_than_it_was_built(monkeypatch, rough):
    """Each line of a sheet; depth as expected on it is that of `evaluate`, which names the same largest term."""
    monkeypatch.setattr(datasheet, "FEW", 8)
    design = roslf.load("paper")
    study = {**story.quick_study(design), "trials": 512}
    built = story._builds_alone(study, design)
    known = datasheet.CalibrationSpread("as planned", design, planned_lengths(design, PlanOptions()))
    grounds, bare = datasheet.basis(design, built, known), datasheet.basis(design, None, known)
    for key, sigma in grounds.sigma.items():
        assert grounds.calibrated.get(key, 0.0) <= sigma, key
    for width in WIDTHS:  # no board tells how wide parts are
        assert grounds.calibrated[width] == grounds.sigma[width]
    assert grounds.calibrated["direction_of_view_deg"] == grounds.sigma["direction_of_view_deg"] > 0
    assert grounds.calibrated["total_length_mm"] < 0.03 * bare.calibrated["total_length_mm"]
    budget = roslf.evaluate(design, build=grounds.build, calibration=grounds.calibration).depth_budget
    (line,) = (line for line in grounds.rows if line.name.startswith("expanded uncertainty U"))
    assert (line.value, line.remark) == (pytest.approx(2 * budget.u_z_mm), f"mostly {budget.largest.name}")
    assert budget.largest.name == "lengths as calibrated"
    loose = roslf.evaluate(design, build=grounds.build).depth_budget
    assert loose.largest.name == "lengths as built"
    assert loose.u_z_mm > 5 * budget.u_z_mm


def test_a_sheet_with_the_calibration_that_is_planned(tmp_path, capsys, rough):
    """U is that of a report's plan, whose default tolerances are known before; of captures alone it is larger."""
    assert (
        run(capsys, "datasheet", "paper", "--calibration", "planned", "--at", "240mm", "-o", tmp_path / "a.json")[0]
        == 0
    )
    told = json.loads((tmp_path / "a.json").read_text())
    lines = {line["name"]: line["value"] for line in told["lines"]}
    code, out, _ = run(capsys, "calibrate", "--plan", "paper", "--at", "240mm", "--json")
    plan = json.loads(out)
    assert code == 0
    design, asked = roslf.load("paper"), PlanOptions(at=(240.0,))
    build = lengths_built(tolerance_plan(story.quick_study(design), design)[0])
    there, focus = (
        planned_depth(design, calibration_plan(design, asked), asked, build, at).expanded_mm for at in (240, None)
    )
    assert lines["U at 240 mm"] == pytest.approx(there)
    assert there == pytest.approx(plan["depth_with_tolerances_at"][0]["expanded_mm"])
    assert focus == pytest.approx(plan["depth_with_tolerances"]["expanded_mm"])
    assert there < plan["depth_expected_at"][0]["expanded_mm"]
    by_lengths = {each["lengths"]: each["expanded_mm"] for each in told["depth_by_lengths"]}
    assert by_lengths["as calibrated"] == pytest.approx(focus)
    assert focus < min(plan["depth_expected"]["expanded_mm"], by_lengths["as built to default tolerances"])
    assert "Default tolerances count as known before it" in told["basis"]
    assert "as planned" in told["basis"]
    assert "Values are those of that instrument" not in told["basis"]


def test_distortion_of_an_ideal_lens_is_put_down_to_its_window():
    paper, window = roslf.load("paper"), {"kind": "plate", "distance": 121.0, "thickness": 20.0, "material": "N-BK7"}
    for design in (paper, paper.replace({"elements": [{**window, "diameter": 90.0}]})):
        (line,) = (row for row in datasheet.basis(design).rows if row.name.startswith("distortion"))
        assert ("flat faces of windows" in line.remark) == bool(design.elements) == (abs(line.value) > 0.01)


def test_depth_noise_of_the_thin_lens_says_where_the_real_one_is_not_sharp():
    """In words of the resolution's own rows."""
    rows = datasheet.basis(roslf.load("paper-singlet")).rows
    shown = {row.name: row.value for row in rows if row.subject == "Resolution" and row.name.startswith("refocused")}
    middle, edge, corner = (value for name, value in shown.items() if "focal plane" in name)
    assert corner < middle / 2
    noise = [row.remark for row in rows if row.subject == DEPTH]
    assert noise[:3] == ["", "", ""]
    for there, remark in zip((edge, corner), noise[3:], strict=True):
        assert remark == (
            f"of the thin lens; the real one is not sharp there: {there:.3g} lp/mm" if there < middle / 2 else ""
        )


def test_a_page_of_one_design(tmp_path, capsys, rough):
    code, _, _ = run(capsys, "datasheet", "video-otoscope", "-o", tmp_path / "sheet.html")
    page = (tmp_path / "sheet.html").read_text()
    assert code == 0
    assert all(words in page for words in ("ISO 8600-3", "no tolerance study is at hand", "direction of view", "alias"))
    assert "quote it of no camera" in page
    assert "not known here: <code>roslf datasheet</code> of a tolerance study has it" in " ".join(page.split())
    far = [row.remark for row in datasheet.basis(roslf.load("paper"), at=(200.0,)).rows if row.name == "U at 200 mm"]
    assert [remark.endswith("; lengths as built not in it") for remark in far] == [True]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("datasheet", "paper", "-o", "sheet.docx"), ".pdf, .html, .json, .csv"),
        (
            ("datasheet", "studies/story-otoscope/story.toml", "--calibration", "x"),
            'name it, as calibrated = "FOLDER", in the story',
        ),
        (("datasheet", "studies/story-otoscope/story.toml", "--calibration", "planned"), "plan it in the story"),
        (
            ("datasheet", "paper", "--calibration", "nowhere", "-o", "x.pdf"),
            "name the folder that roslf calibrate wrote",
        ),
        (("sweep", "paper", "--set", "d_3=0..9", "--quantity", "fill_factor"), "no unit"),
        (("sweep", "paper", "--set", "d_3", "--quantity", "fill_factor"), "PLACE=FROM..TO UNIT"),
        (("sweep", "paper", "--set", "depth.contrast=0.1..0.2 mm", "--quantity", "sigma_z_mm"), "plain number"),
        (("sweep", "paper", "--set", "d_9=0..9 mm", "--quantity", "fill_factor"), "is not a number of this design"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fil_factor"), "did you mean 'fill_factor'"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "kept_fraction"), "belongs to a field"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "blur_pitches"), "a distance ahead of the tip"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fill_factor", "-o", "x.xlsx"), ".csv"),
        (("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fill_factor", "--points", "1"), "--points"),
        (
            ("sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "sigma_z_mm", "--at", "0 mm"),
            "--at: 0 mm is not ahead",
        ),
        (
            ("sweep", "paper", "--set", "d_3=400..900 mm", "--quantity", "fill_factor"),
            "is not less than the focal-plane",
        ),
        (
            ("sweep", "paper-singlet", "--set", "f=99..101mm", "--quantity", "field_half_width_mm", "--points", "3"),
            "3 of 3 points cannot be built: at f = 99 mm: main_lens.focal_length: 99 mm contradicts the prescription",
        ),
        (
            ("sweep", "papr", "--set", "d_3=0..9 mm", "--quantity", "fill_factor"),
            "papr: no such file; did you mean 'paper'?",
        ),
        (("datasheet", "papr"), "papr: no such file; did you mean 'paper'?"),
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
    assert "no camera" not in picture  # it ends where cameras do
    assert "image fill" in picture


def test_a_sweep_says_what_its_picture_leaves_out(tmp_path, capsys):
    plate = {"kind": "plate", "distance": 10, "thickness": 160, "material": "N-BK7"}
    scope = roslf.load("paper").replace({"elements": [plate], "aperture.distance": 0.0})
    roslf.save(scope, tmp_path / "scope.toml")
    code, _, err = run(
        capsys, "sweep", tmp_path / "scope.toml", "--set", "d_3=0..1000 mm", "--quantity", "fill_factor", "--points",
        "11", "-o", tmp_path / "s.svg",
    )  # fmt: skip
    assert code == 0
    # 100 mm is inside the plate, beyond 404.6 mm (350 mm, and what the glass adds) is nothing that could be in focus.
    assert "7 of 11 points cannot be built: at d_3 = 100 mm: aperture.distance: 100 mm lies inside elements" in err
    assert "at d_3 = 500 mm: aperture.distance: 500 mm is not less than the focal-plane distance" in err
    assert "7 of 11 points cannot be built" in (tmp_path / "s.svg").read_text()
    ahead = sweep_picture(roslf.sweep(scope, {"d_3": [0.0, 300.0]}, ["sigma_z_mm"], 15), "scope")
    assert ahead.panels[0].title == "scope, 15 mm ahead of the tip"
    picture = sweep_picture(roslf.sweep(scope, {"d_3": np.linspace(0, 1000, 11)}, ["fill_factor"]), "scope")
    panel = picture.panels[0]
    assert (panel.x.low, panel.x.high) == (0, 400)
    (dots,) = (mark for mark in panel.marks if isinstance(mark, Dots))
    assert list(dots.x) == [0]
    within = roslf.sweep(scope, {"d_3": [0, 100, 200], "D_F": [2, 3]}, ["fill_factor"])
    assert b"no camera" in sweep_picture(within, "scope").svg_file()


def test_a_sweep_marks_the_design_where_it_is_among_what_is_swept():
    design = roslf.load("paper")
    for places, marked in (({"d_3": [20.0, 130.0]}, True), ({"d_3": [20.0, 60.0]}, False)):
        for more in ({}, {"D_F": [2.0, 3.0]}):
            (panel,) = sweep_picture(roslf.sweep(design, places | more, ["fill_factor"]), "paper").panels[:1]
            own = [mark for mark in panel.marks if getattr(mark, "testid", "") == "own"]
            assert [float(mark.x[0]) for mark in own] == [120.0] * marked
            assert [float(mark.y[0]) for mark in own if more] == [2.9] * (marked and bool(more))


def test_a_sheet_says_on_every_page_whose_it_is_and_is_signed_on_its_first():
    page = datasheet_report(basis(roslf.load("paper")), "B", "2026-11-29")
    section, annex = page.sections
    head, signed = section.blocks[:2]
    assert annex.title == "Annex"
    assert not {block.title for block in section.blocks if isinstance(block, Table)} & {DEPTH, "Object field"}
    assert section.blocks[-1].title == "Dimensions"
    assert (head.title, signed.title) == ("This sheet", "Signed")
    shown = dict(head.rows)["hash of the design"].split()[0]
    assert page.footer == f"Zhou 2023 bench system; revision B, hash of the design {shown}, date 2026-11-29"


def test_a_sweep_has_one_legend_and_the_limits_of_its_design():
    asked = {"u_z_mm": [{"max": 0.2}, {"at": 15.0, "max": 0.05}], "field_of_view_deg": {"min": 60.0, "max": 170.0}}
    design = roslf.load("rigid-scope").replace({"required": asked})
    places, names = {"d_3": np.linspace(0.0, 5.0, 11)}, ["fill_factor", "u_z_mm", "field_of_view_deg"]
    picture = sweep_picture(roslf.sweep(design, places, names), "scope", required=limits(design))
    told = ["the design", "required", "required: field of view, full at most 170 deg, above all that is shown"]
    assert [key.text for key in picture.keys] == told
    drawn = [[mark for mark in panel.marks if getattr(mark, "testid", "") == "required"] for panel in picture.panels]
    assert [[float(mark.y[0]) for mark in marks] for marks in drawn[:3]] == [[], [0.2], [60.0]]
    words = [mark.text for panel in picture.panels for mark in panel.marks if isinstance(mark, Text)]
    assert {"at most 0.2 mm", "at least 60 deg"} <= {*words}
    grid = sweep_picture(
        roslf.sweep(design, places | {"D_F": np.linspace(0.2, 0.3, 11)}, names[1:2]), "scope", required=limits(design)
    )
    (line,) = (mark for mark in grid.panels[0].marks if isinstance(mark, Line) and mark.colour == "orange")
    swept = Camera.of(design, {"d_3": line.x[np.isfinite(line.x)], "D_F": line.y[np.isfinite(line.x)]})
    assert roslf.quantity("u_z_mm")(swept) == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("points", [2, 3, 6])
def test_numbers_on_a_coarse_map_stand_clear_of_each_other(points):
    """Lines go from the first points to the last, half of a map of two points a side."""
    places = {"d_2": np.linspace(1.0, 4.0, points), "d": np.linspace(0.03, 0.2, points)}
    panel = sweep_picture(roslf.sweep(roslf.load("paper"), places, ["sigma_z_mm"]), "paper").panels[0]
    words = [mark for mark in panel.marks if isinstance(mark, Text)]
    assert len(words) > 1
    for one, other in itertools.combinations(words, 2):
        (a, up), (b, down) = (panel.at(mark.x, mark.y) for mark in (one, other))
        wide = (text_width(one.text, one.size) + text_width(other.text, other.size)) / 2
        assert abs(a + one.dx - b - other.dx) > wide or abs(up - down) > one.size


def test_a_sweep_over_distance_is_evaluate_at_each(tmp_path, capsys):
    """Alone, beside a length on either axis, and through a real lens; CSV has a row a distance."""
    paper = roslf.load("paper")
    names, planes = ["sigma_z_mm", "field_half_width_mm", "fill_factor"], [150.0, 200.0, 400.0]
    for design in (paper, roslf.load("paper-singlet")):
        alone = roslf.sweep(design, {"at": planes}, names)
        each = [roslf.evaluate_many({"own": design}, names, at=one) for one in planes]
        for name in names:
            assert alone.values[name] == pytest.approx([float(table.columns[name][0]) for table in each], rel=1e-12)
    assert (alone.follows, alone.own) == (None, (pytest.approx(350.0 - design.aperture.distance),))
    lengths = [60.0, 100.0]
    grid = roslf.sweep(paper, {"d_3": lengths, "at": planes}, ["sigma_z_mm"]).values["sigma_z_mm"]
    turned = roslf.sweep(paper, {"at": planes, "d_3": lengths}, ["sigma_z_mm"]).values["sigma_z_mm"]
    assert (grid.shape, turned.shape) == ((2, 3), (3, 2))
    for k, d_3 in enumerate(lengths):
        own = roslf.sweep(paper.replace(d_3=d_3), {"at": planes}, ["sigma_z_mm"]).values["sigma_z_mm"]
        assert grid[k] == pytest.approx(own, rel=1e-12)
        assert turned[:, k] == pytest.approx(own, rel=1e-12)
    asked = ("sweep", "paper", "--set", "at=150..400 mm", "--points", "3", "--quantity", "sigma_z_mm")
    assert run(capsys, *asked, "-o", tmp_path / "own.csv")[0] == 0
    assert (tmp_path / "own.csv").read_text().startswith("at,sigma_z_mm,")
    code, _, err = run(capsys, *asked, "--at", "20 mm", "-o", tmp_path / "twice.csv")
    assert (code, "given and swept; drop one of them" in err) == (2, True)


def test_a_sweep_says_which_length_follows(tmp_path, capsys):
    """As in Design.replace: the array stays where f is swept, though the file gives the focal plane."""
    arguments = (
        "--set",
        "f=99..101 mm",
        "--quantity",
        "working_distance_mm",
        "--points",
        "2",
        "-o",
        tmp_path / "s.csv",
    )
    code, _, err = run(capsys, "sweep", "paper", *arguments)
    assert (code, err) == (
        0,
        "roslf: main_lens.focal_plane follows from what is swept; microlens_array.distance stays 140 mm\n",
    )


def test_quantities_are_listed(capsys):
    code, out, _ = run(capsys, "quantities", "--json")
    listed = json.loads(out)["quantities"]
    assert code == 0
    assert {one["quantity"] for one in listed} == set(roslf.QUANTITIES)
    assert run(capsys, "quantities")[0] == 0


def test_a_file_that_cannot_be_written_is_called_by_its_name_before_the_work(capsys, monkeypatch):
    monkeypatch.setattr("roslf_design.commands.sweep.compute", None)  # which would fail
    place = "/proc/x.csv"  # where nobody may write, root neither
    code, _, err = run(capsys, "sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fill_factor", "-o", place)
    assert code == 2
    assert err.startswith(f"roslf: -o: {place} cannot be written: ")
    assert len(err.splitlines()) == 1


def test_a_sweep_as_parquet(tmp_path, capsys):
    """The same columns and numbers as CSV; what has no value is null or not a number there."""
    parquet = pytest.importorskip("pyarrow.parquet")
    for kind in ("csv", "parquet"):
        file = tmp_path / f"a.{kind}"
        wish = ("--set", "d_3=0..400 mm", "--quantity", "fill_factor,hyperfocal_mm", "--points", 9, "-o", file)
        assert run(capsys, "sweep", "paper", *wish)[0] == 0
    table = parquet.read_table(tmp_path / "a.parquet").to_pydict()
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(table) == list(rows[0])
    read = {name: [float(row[name] or "nan") for row in rows] for name in table}
    for name, values in table.items():
        np.testing.assert_array_equal(np.array(values, float), read[name])
    assert np.isnan(read["fill_factor"][-1])


def test_a_sweep_in_other_units(tmp_path, capsys):
    arguments = ("sweep", "paper", "--set", "light.illuminance=1e4..1e5 lx", "--quantity", "pixel_electrons")
    code, _, _ = run(capsys, *arguments, "--points", "2", "-o", tmp_path / "s.csv")
    rows = list(csv.reader((tmp_path / "s.csv").read_text().splitlines()))
    assert code == 0
    assert rows[0] == ["light.illuminance [lx]", "pixel_electrons", "roslf_sweep_point"]
    assert [row[2] for row in rows[1:]] == ["1", "2"]
    assert [float(row[0]) for row in rows[1:]] == [1e4, 1e5]


def test_a_sweep_from_python():
    found = roslf.sweep(roslf.load("paper"), {"d_3": [20.0, 120.0]}, ["fill_factor", "sigma_z_mm"], at=100.0)
    assert found.units == {"fill_factor": "", "sigma_z_mm": "mm", "d_3": "mm"}
    assert np.isfinite(found.values["sigma_z_mm"]).all()


def test_what_is_of_another_design_or_signed_is_not_written_over(tmp_path, capsys, rough, monkeypatch):
    monkeypatch.setattr(story, "basis", functools.cache(basis))  # of each design once

    def again(design, name, *more):
        before = (tmp_path / name).read_bytes() if (tmp_path / name).exists() else b""
        code, _, err = run(capsys, "datasheet", design, "-o", tmp_path / name, *more)
        assert (code == 2) == ("delete it or choose another place" in err)
        assert code == 0 or (tmp_path / name).read_bytes() == before
        return code

    for name in ("draft.html", "draft.pdf", "draft.json", "draft.csv"):
        assert [again(design, name) for design in ("paper", "paper", "rigid-scope")] == [0, 0, 2]
    with (tmp_path / "draft.pdf").open("ab") as signed:
        signed.write(b"1 0 obj\nendobj\n%%EOF\n")  # as programs that sign a PDF, or mark it, add to its end
    assert again("paper", "draft.pdf") == 2
    for kind in ("html", "json", "csv"):
        assert [again("paper", f"a.{kind}", "--revision", each) for each in "AAB"] == [0, 0, 2]
        assert again("paper", f"a.{kind}") == 2
    for kind in ("json", "csv"):
        (tmp_path / f"other.{kind}").write_text('{"a": 1}' if kind == "json" else "a,b\n1,2\n")
        assert again("paper", f"other.{kind}") == 2


def test_another_s_page_is_refused_before_any_work(tmp_path, capsys, monkeypatch):
    """A report, and a sheet of a design, were made to the end before their place was looked at."""

    def worked(*_, **__):
        raise AssertionError("worked")

    for place in (report_command, story):
        for name in ("full_report", "study_report", "comparison_report", "basis"):
            monkeypatch.setattr(place, name, worked, raising=False)
    (tmp_path / "index.html").write_text("<title>rigid 4 mm scope</title>")
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "sheet.json").write_text("{}")
    for words in (
        ("report", "paper", "-o", tmp_path),
        ("report", tmp_path / "study.toml", "-o", tmp_path),
        ("report", "--compare", "paper", "rigid-scope", "-o", tmp_path),
        ("report", "studies/story-otoscope/story.toml", "-o", tmp_path),
        ("datasheet", "paper", "-o", tmp_path / "index.html"),
        ("datasheet", "paper", "-o", tmp_path / "sheet.json"),
    ):
        code, _, err = run(capsys, *words)
        assert code == 2
        assert re.search(r"is of (rigid 4 mm scope|something else); delete it or choose another place", err)


def test_a_folder_of_another_study_is_refused_before_any_work(tmp_path, capsys):
    (tmp_path / "index.html").write_text("<title>rigid 4 mm scope</title>")
    (tmp_path / "study.toml").write_text(STUDY)
    for command, study in (
        ("optimize", "studies/optimize-ear-speculum/study.toml"),
        ("tolerance", tmp_path / "study.toml"),
    ):
        code, _, err = run(capsys, command, study, "-o", tmp_path)
        assert (code, "is of rigid 4 mm scope" in err) == (2, True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index.html", "study.toml"]


def test_a_part_s_clear_diameter_stands_beside_its_outer_one(rough):
    """Edmund 45-089 is 3 mm wide and clear to 2.7 mm, which is D where the design gives none."""
    table = {"part": "45-089", "focal_plane": "60 mm"}
    text = dumps(roslf.load("rigid-scope"))
    data = tomllib.loads(text) | {"main_lens": table}
    design = roslf.loads(tomli_w.dumps(data))
    assert pytest.approx(2.7) == design.D
    rows = {line.name: line.remark for line in basis(design).rows}
    assert "main lens of 3 mm (D = 2.7 mm clear)" in rows["parts"]
    assert "clear" not in {line.name: line.remark for line in basis(roslf.load("rigid-scope")).rows}["parts"]


def test_what_simulated_exposures_lack_of_depth_expected_is_named():
    camera = Camera.of(roslf.load("paper"))
    u = float(depth_budget(camera).u_z_mm)
    assert f"(u = {u:.3g} mm) counts view mismatch beside that noise" in _beside_expected(camera)
    assert _beside_expected(Camera.of(roslf.load("paper").replace({"depth.view_mismatch": 0.0}))) == ""


def test_an_empty_revision_is_refused(tmp_path, capsys):
    code, _, err = run(capsys, "datasheet", "paper", "--revision", "", "-o", tmp_path / "a.html")
    assert (code, list(tmp_path.iterdir())) == (2, [])
    assert err == 'roslf: --revision: "" is no revision; give text on one line, as "B"\n'


def test_depths_name_their_distance_and_a_round_field_has_one_rim():
    asked = "[required]\nround_field_of_view_deg = {min = 10}\n"
    design = roslf.loads(f"{roslf.dumps(roslf.load('paper'))}\n{asked}")
    lines = datasheet.basis(design, at=(200.0,)).rows
    names = [(line.subject, line.name) for line in lines]
    assert len(names) == len(set(names))
    depths = [name for subject, name in names if subject == EXPECTED and name != "not in it"]
    assert all("in the focal plane" in name or name == "U at 200 mm" for name in depths)
    rims = [name for subject, name in names if subject == DEPTH and "round field" in name]
    assert [name.endswith("rim of the round field") for name in rims] == [True]
    focal = [name for subject, name in names if subject == "Resolution" and "round field" in name]
    assert [name.rpartition(", ")[2] for name in focal] == ["along x", "towards the corner"]
