"""Stories and studies as reports: parts hand their designs on, errors come in one line, nothing is half-written."""

import math
import re
import tomllib
from types import SimpleNamespace

import pytest

from roslf_design.calibration.options import planned_lengths
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.commands import report as command
from roslf_design.design import load, save
from roslf_design.errors import InputError
from roslf_design.evaluation import evaluate
from roslf_design.progress import silent
from roslf_design.reporting import story
from roslf_design.reporting.blocks import Bullets, Code, Report, Statements, Table
from roslf_design.reporting.optimise.pages import optimization_finding
from roslf_design.reporting.optimise.run import run_optimisation
from roslf_design.reporting.printers import render_html, render_pdf
from roslf_design.reporting.story import (
    CENTRE,
    FILL,
    load_story_or_study,
    quick_study,
    story_report,
    study_report,
)
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.study import tolerance_plan
from roslf_design.tolerancing.trials import lengths_built
from tests.optimization.posing import PAPER
from tests.reporting import made

OPTIMIZE = """
name = "shorter"
design = "given.toml"
seed = 3
[solver]
starts = 2
check = false
[variables]
d_2 = ["1 mm", "3 mm"]
D_F = ["2 mm", "4 mm"]
[[constraints]]
quantity = "fill_factor"
min = 0.99
max = 1.0
[[goals]]
quantity = "sigma_z_mm"
at = "100 mm"
direction = "min"
"""
TOLERANCE = """
name = "built"
design = "given.toml"
trials = 2000
seed = 5
sobol_samples = 0
keep_worst = 0
[[perturb]]
place = ["aperture.diameter", "sensor.distance"]
tolerance = "20 um"
[[goals]]
metric = "fill_factor"
min = 0.95
max = 1.05
"""
STORY = """
[story]
title = "A short story"
question = "Does it hang together?"
design = "given.toml"
[[parts]]
optimize = "optimize.toml"
[[parts]]
tolerance = "tolerance.toml"
[[parts]]
calibration = { board = "6x5 5 mm", boards = 9, tilt = "15 deg", seed = 4 }
"""


def write(place):
    """The story and its studies, of the paper's camera with depth errors in closed form."""
    save(PAPER, place / "given.toml")
    for name, text in (("optimize", OPTIMIZE), ("tolerance", TOLERANCE), ("story", STORY)):
        (place / f"{name}.toml").write_text(text)
    return place


@pytest.fixture
def folder(tmp_path):
    return write(tmp_path)


@pytest.fixture(scope="module")
def told(tmp_path_factory, few_builds):
    """The story's report, and what was said on the way."""
    place, said = write(tmp_path_factory.mktemp("story")), []
    story = load_story_or_study(place / "story.toml")[1]
    with pytest.MonkeyPatch.context() as patch:
        made.without_figures(patch)  # those of the data sheet and of the parts stay
        report = story_report(story, command="roslf report story.toml", progress=lambda *one: said.append(one))
    return report, said, place


def blocks(report, kind):
    return [block for section in report.sections for block in section.blocks if isinstance(block, kind)]


def test_a_design_that_is_not_the_optimum_is_told_with_its_own_numbers(folder, few_builds):
    """Of a robust design the goal is told as it is of that design, beside the optimum's."""
    extra = '[robust]\nmaximise = "yield"\ntrials = 64\n[[robust.perturb]]\nplace = "d_2"\ntolerance = "10 um"'
    result = run_optimisation(tomllib.loads(OPTIMIZE + extra), None, folder)
    taken = dict(result.designs())["robust.toml"]
    own = float(QUANTITIES["sigma_z_mm"](Camera.of(taken), 100.0))
    text = optimization_finding(result, "robust", "the robust design").statement.text
    first, _, second = text.partition(" This report is of another design, the robust design; its own numbers: ")
    assert f"{result.answer.number(result.answer.asked.goals[0]):.5g} mm" in first
    assert f"{own:.5g} mm." in second
    assert first != second
    assert optimization_finding(result).statement.text == first
    lead = optimization_finding(result, "robust", "the robust design").section.blocks[0].text
    assert lead == "This section is about the study's optimum, all else in this report about the robust design."


def test_each_part_hands_its_design_on(told):
    report, _, place = told
    best = run_optimisation(tomllib.loads(OPTIMIZE), None, place).answer
    (design,) = (code.text for code in blocks(report, Code) if code.title == "The design, as a file")
    (place / "found.toml").write_text(design)
    found = load(place / "found.toml")
    assert (found.d_2, found.D_F) == pytest.approx((best.variables()["d_2"], best.variables()["D_F"]), rel=1e-12)
    nominal = {t.title: t for t in blocks(report, Table)}["Distributions, as built"].rows[0][1]
    # Tables give four digits.
    assert float(nominal) == pytest.approx(evaluate(found).f_number.fill_factor, rel=1e-3)


def test_a_story_has_every_section_and_says_what_was_done(told):
    report, said, _ = told
    assert report.title == "A short story"
    wanted = ["Optimisation", "Tolerances and yield", "Calibration plan"]
    assert [section.title for section in report.sections if section.title in wanted] == wanted
    steps = next(part for part in report.sections if part.title == "Summary").blocks[1]
    assert isinstance(steps, Bullets)
    assert len(steps.items) == 3
    answers = " ".join(item.text for item in blocks(report, Statements)[0].items)
    assert "Optimisation: a design holds every limit" in answers
    assert "2,000 Monte Carlo units (builds), seed 5" in answers
    assert "Calibration as planned" in answers
    seeds = " ".join(item for block in blocks(report, Bullets) for item in block.items)
    assert all(f"{what}: {seed}." in seeds for what, seed in (("starts", 3), ("2,000 builds", 5), ("poses", 4)))
    assert any("part 1 of 3" in step for step, *_ in said)
    assert ("part 2 of 3, tolerances: builds", 2000, 2000) in said


def test_the_same_story_gives_the_same_page_and_pdf(told, without_figures):
    report, _, place = told
    again = story_report(load_story_or_study(place / "story.toml")[1], command="roslf report story.toml")
    assert render_html(again) == render_html(report)
    pytest.importorskip("typst", reason="the typst package is not installed")
    assert render_pdf(again) == render_pdf(report)


def test_another_seed_reaches_every_part(folder, monkeypatch, few_builds):
    parts = []

    def pages(design, *, findings, **_):
        parts.extend(findings.values())
        return Report("", "", ())

    monkeypatch.setattr(story, "design_report", pages)  # what findings say of seeds is on the page, as told above
    monkeypatch.setattr(story, "_basis_of", lambda *_: SimpleNamespace(calibration=None))  # the data sheet's
    story_report(load_story_or_study(folder / "story.toml")[1], seed=77)
    seeds = " ".join(part.seed for part in parts)
    assert all(f"{what}: 77." in seeds for what in ("starts", "2,000 builds", "poses"))


@pytest.mark.parametrize(("kind", "section"), [("optimize", "Optimisation"), ("tolerance", "Tolerances and yield")])
def test_a_study_alone_makes_a_whole_report(folder, kind, section, without_figures, few_builds):
    assert load_story_or_study(folder / f"{kind}.toml") == (kind, None)
    report = study_report(kind, folder / f"{kind}.toml")
    titles = [part.title for part in report.sections]
    default = "Default tolerances and limits"
    assert titles[:2] == ["Summary", "Data sheet"]  # a report opens with its answers
    assert {section, "Calibration plan", "Parts list", "Accuracy"} <= set(titles)
    assert (default in titles) == (kind != "tolerance")
    # A verdict is by limits that the user set, as in the tolerance study; default ones are nobody's.
    yields = [s for block in blocks(report, Statements) for s in block.items if s.text.startswith("Yield ")]
    assert len(yields) == (2 if kind == "tolerance" else 1)
    judged = {s.tone in ("good", "bad") for s in yields}
    assert judged == {kind == "tolerance"}
    assert all(("by default limits, not yours" in s.text) == (kind != "tolerance") for s in yields)
    sheet = report.sections[1].blocks
    told = [row[2] for block in sheet if isinstance(block, Table) for row in block.rows]
    assert any(cell.startswith("±") for cell in told) == (kind == "tolerance")
    assert "nominal" in sheet[0].text.lower()  # once


def test_a_study_without_a_design_tells_what_stands_in_the_way(folder, few_builds):
    impossible = OPTIMIZE.replace(
        'direction = "min"', 'direction = "min"\n[[constraints]]\nquantity = "D_F"\nmin = "9 mm"'
    )
    (folder / "optimize.toml").write_text(impossible)
    report = study_report("optimize", folder / "optimize.toml")
    assert [section.title for section in report.sections] == ["Summary", "Optimisation", "How this report was made"]
    assert "nothing holds" in report.sections[0].blocks[0].items[0].text
    with pytest.raises(InputError, match=r"story.toml: parts.0: no design was found to go on with: .*nothing holds"):
        story_report(load_story_or_study(folder / "story.toml")[1])


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("optimize.toml", "gone.toml"), r"parts.0.optimize: gone.toml: no such file"),
        (("given.toml", "gone.toml"), r"story.design: .*no such file"),
        (('tolerance = "tolerance.toml"', ""), r"parts.1: has nothing; give each part one of"),
        (
            ('tolerance = "tolerance.toml"', 'tolerance = "tolerance.toml"\ntake = "best"'),
            "take goes with optimize only",
        ),
        (('optimize = "optimize.toml"', 'optimize = "optimize.toml"\ntake = "worst"'), "'worst' is nothing to take"),
        (('"6x5 5 mm"', '"6 by 5"'), r"parts.2.calibration.board: .*not understood"),
        (('"15 deg"', '"15"'), r"parts.2.calibration.tilt"),
        (("boards = 9", "boreds = 9"), r"boreds.*boards"),
        (('title = "A short story"', ""), r"story.title: is missing"),
    ],
)
def test_faults_are_told_with_their_place_and_nothing_is_written(folder, capsys, change, complaint):
    assert change[0] in STORY
    (folder / "story.toml").write_text(STORY.replace(*change))
    assert main(["report", str(folder / "story.toml"), "-o", str(folder / "out")]) == 2
    said = capsys.readouterr().err
    assert re.search(complaint, said)
    assert "Traceback" not in said
    assert len(said.strip().splitlines()) == 1
    assert not (folder / "out").exists()


def test_a_part_that_was_not_found_is_told(folder, few_builds):
    (folder / "story.toml").write_text(
        STORY.replace('optimize = "optimize.toml"', 'optimize = "optimize.toml"\ntake = "robust"')
    )
    with pytest.raises(InputError, match="found no 'robust' to take; it has best"):
        story_report(load_story_or_study(folder / "story.toml")[1])


@pytest.mark.parametrize("text", ["", "[scene]\nkind = 'plane'\n"])
def test_what_is_no_design_and_no_study_says_what_was_looked_for(tmp_path, capsys, text):
    file = tmp_path / "odd.toml"
    file.write_text(text)
    assert main(["report", str(file), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert len(said.strip().splitlines()) == 1
    for key in ("[main_lens]", "[variables]", "[[perturb]]", "[story]"):
        assert key in said
    assert ("it is empty" if not text else "it has scene") in said


def test_unwritable_output_is_one_line_and_leaves_nothing(folder, capsys, monkeypatch):
    monkeypatch.setattr(command, "maker", lambda *_: ("a", lambda **_: Report("a", "", ())))
    monkeypatch.setattr("tempfile.mkstemp", refuse)
    assert main(["report", "paper", "-o", str(folder / "out")]) == 1
    said = capsys.readouterr().err
    assert len(said.strip().splitlines()) == 1
    assert "No space left" in said
    assert not list((folder / "out").glob("*"))


def refuse(*_, **__):
    raise OSError(28, "No space left on device")


def test_a_required_depth_is_that_of_the_camera_calibrated_as_planned(without_figures, few_builds):
    asked = load("paper").replace({"required": {"u_z_mm": [{"max": 1e3}, {"at": "240 mm", "max": 1e3}]}})
    report = story.full_report(asked)
    (by_distance,) = (table for table in blocks(report, Table) if table.title == "At its distances")
    assert [row[0] for row in by_distance.rows][1:] == ["240 mm"]
    told = blocks(report, Statements)[0].items[0]
    assert "depth, expected" in told.text
    assert "lengths as calibrated" in told.text
    assert told.text.startswith("Met once calibrated as planned: ")
    tables = {table.title: table for table in report.sections[1].blocks if isinstance(table, Table)}
    required, _ = tables["Required"].rows  # one verdict, that of the summary
    assert required[-1].startswith("~ met once calibrated as planned: at most 1000 mm (U = 2000 mm); U = ")
    assert "as drawn" not in required[-1]
    assert f" is {required[1]} (U = " in told.text
    lead, built, calibrated = tables["Depth, expected"].rows[:3]
    assert lead[0] == "expanded uncertainty U in the focal plane, k = 2, as drawn"
    assert lead[-1].endswith("quote it of no camera")
    assert built[0] == "U in the focal plane, uncalibrated, as built to default tolerances"
    assert required[-1].endswith(f"uncalibrated, by default tolerances, U = {built[1]}")
    assert calibrated[0] == "U in the focal plane, calibrated"
    assert f"; U = {calibrated[1]}" in required[-1]
    assert calibrated[-1].endswith(", as planned; required depths count it")
    planned = next(items.items[-1].text for items in blocks(report, Statements) if "as planned" in items.items[-1].text)
    assert f"U = ± {float(calibrated[1].split()[0]):.3g} mm in the focal plane" in planned
    names = [row[0] for table in ("Distances", "Depth, expected") for row in tables[table].rows]
    assert (
        "standard uncertainty u in the focal plane, as drawn" in names,
        "standard uncertainty u in the focal plane, as built" in names,
    ) == (True, False)
    glance = next(table for table in blocks(report, Table) if table.title == "What it sees")
    for told in (names, [row[0] for row in glance.rows]):
        ranges = [name for name in told if name.startswith("working range")]
        assert ranges
        assert all("as drawn" in name for name in ranges)
    ahead, _, u, *_ = by_distance.rows[0]  # one U leads: that of the evaluation, of the sheet and of the curves
    assert evaluate(asked).answer.at[0].cells[:3] == (ahead, by_distance.rows[0][1], u)
    assert float(lead[1].split()[0]) == pytest.approx(evaluate(asked).answer.at[0].expanded_mm, rel=1e-3)
    assert evaluate(asked).verdicts[0].text.startswith("met as drawn: ")


def test_the_yield_of_a_story_counts_what_its_calibration_leaves(folder):
    """Decoded depth scatters by the plan's own term of the budget, a normal cut off at two sigmas: 0.8796 of it."""
    goal = TOLERANCE.replace('metric = "fill_factor"\nmin = 0.95\nmax = 1.05', 'metric = "depth_error_mm"\nmax = 1')
    goal = goal.replace('"sensor.distance"]', '"main_lens.focal_length"]').replace("20 um", "0.1 mm")
    calibrated = f'{goal}[[compensators]]\nplace = "calibration"\n'
    (folder / "tolerance.toml").write_text(calibrated.replace("seed = 5", 'seed = 5\nfields = ["centre"]'))
    (folder / "story.toml").write_text(STORY.replace('[[parts]]\noptimize = "optimize.toml"\n', ""))
    _, read = load_story_or_study(folder / "story.toml")
    built, planned = story._walked(read, None, silent, (), story._builds_alone)
    plan = built.outcome.plan
    lengths = planned_lengths(planned.design, planned.outcome)
    budget = depth_budget(Camera.of(planned.design), build=lengths_built(plan), calibration=lengths)
    u = math.hypot(*(term.u_mm for term in budget.terms if term.name.startswith("lengths as")))
    (column,) = built.outcome.final.distributions
    assert column.deviation == pytest.approx(0.8796 * u, rel=0.06)
    assert plan.perfect == ()
    stated = calibrated.replace('"calibration"\n', '"calibration"\nerror = "1 um"\n')  # counts as it stands
    (folder / "tolerance.toml").write_text(stated)
    _, read = load_story_or_study(folder / "story.toml")
    built, _ = story._walked(read, None, silent, (), story._builds_alone)
    assert max(column.deviation for column in built.outcome.final.distributions) < 1e-3


def test_the_first_look_holds_builds_to_the_nominal():
    """Its limits are those of its docstring, about the evaluation's own numbers."""
    design = load("paper-mismatched")
    goals = quick_study(design)["goals"]
    fill = evaluate(design).f_number.fill_factor
    own = [goal for goal in goals if goal["quantity"] == "fill_factor"]
    assert len(own) == 3
    for goal in own:
        # Local image fills of a straight design are the axial one, to rounding.
        assert (goal["min"], goal["max"]) == pytest.approx(((1 - FILL) * fill, (1 + FILL) * fill), rel=1e-9)
    assert {"quantity": "centre_error_px", "max": CENTRE, "fields": [0]} in goals
    plan, *_ = tolerance_plan(quick_study(design), design)
    assert plan.passes(plan.nominal[:, None]).all()


@pytest.mark.parametrize("name", ["borescope", "otoscope"])
def test_shipped_stories_can_be_read(root, name):
    story = load_story_or_study(root / "studies" / f"story-{name}" / "story.toml")[1]
    assert [bool(p.optimize) + 2 * bool(p.tolerance) + 4 * bool(p.calibration) for p in story.table.parts] == [1, 2, 4]
    assert (root / "reports" / f"story-{name}" / "report.pdf").stat().st_size < 500_000


def test_a_story_s_yield_says_of_required_depth_what_its_verdicts_say(folder, without_figures, few_builds):
    """Uncalibrated U is missed, that of the plan is met: the headline had the one, the ticks the other."""
    required = [{"quantity": "u_z_mm", "at": "100 mm", "max": "0.5 mm"}]
    save(load(folder / "given.toml").replace({"required": required}), folder / "given.toml", overwrite=True)
    (folder / "tolerance.toml").write_text(TOLERANCE.replace("20 um", "60 um"))
    (folder / "story.toml").write_text(STORY.replace('[[parts]]\noptimize = "optimize.toml"\n', ""))
    report = story_report(load_story_or_study(folder / "story.toml")[1])
    alone = study_report("tolerance", folder / "tolerance.toml")

    def told(of, words):
        return next(s for block in blocks(of, Statements) for s in block.items if words in s.text)

    assert "is missed" in told(alone, "Yield ").text
    assert told(alone, "depth, expected, u_Z at 100 mm is 0.7").tone == "bad"
    assert told(report, "depth, expected, u_Z at 100 mm is 0.2").tone == "caution"  # met where single views blur
    assert "missed" not in told(report, "Yield ").text.lower()
    rows = [row for block in blocks(report, Table) if block.title == "Limits" for row in block.rows]
    (depth,) = [row for row in rows if row[0].startswith("depth, expected")]
    assert any(cell.startswith("✓ met") and cell.endswith(", calibrated") for cell in depth)
