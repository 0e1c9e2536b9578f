"""Long runs from the page: what the forms ask for, progress, results, cancel, and nothing left behind."""

import math
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.camera import Camera
from roslf_design.depth.pictures import region_about
from roslf_design.design import load, preset_names
from roslf_design.errors import InputError
from roslf_design.evaluation import evaluate
from roslf_design.explorer import measure_run, optimise_run
from roslf_design.explorer.forms import (
    GOALS,
    GRADES,
    HELD,
    VARIABLES,
    MeasureRequest,
    OptimiseRequest,
    ToleranceRequest,
    _usual_bounds,
    forms,
    read_form,
)
from roslf_design.explorer.measure_run import run_measure, trial_page
from roslf_design.explorer.optimise_run import run_optimise
from roslf_design.explorer.runs import Run, summary
from roslf_design.explorer.state import BY_SYMBOL, State, read
from roslf_design.explorer.tolerance_run import run_tolerance
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.study import tolerance_plan
from tests.depth.made import at_first_sight

PAPER = load("paper")
IMAGE_PITCH = 0.0627261
"""Of the paper's microlens images, by Eq. 7 [mm]."""


@pytest.fixture(autouse=True)
def _few_searches(monkeypatch):
    """Three of eight starts: how far to trust an optimum is said by `tests/optimization`."""
    monkeypatch.setattr(optimise_run, "STARTS", 3)


@pytest.mark.parametrize("grade", GRADES)
def test_the_tolerance_form_is_read(grade):
    request = read_form(
        ToleranceRequest, PAPER, {"grade": [grade], "trials": [" 500 "], "seed": ["7"], "calibrated": ["on"]}
    )
    assert (request.design, request.grade, request.trials, request.seed) == (PAPER, grade, 500, 7)
    assert request.calibrated
    assert not read_form(ToleranceRequest, PAPER, {}).calibrated


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"trials": ["many"]}, "trials: 'many' is not a whole number from 64 to 1000000"),
        ({"trials": ["1e9"]}, "trials: '1e9' is not"),
        ({"trials": ["5"]}, "trials: '5' is not"),
        ({"seed": ["-1"]}, "seed: '-1' is not"),
        ({"grade": ["best"]}, "grade: 'best' is not known"),
    ],
)
def test_what_the_tolerance_form_cannot_ask_is_told(options, message):
    with pytest.raises(InputError) as caught:
        read_form(ToleranceRequest, PAPER, options)
    assert message in str(caught.value)


def limited(*rows, **more):
    """Options of a form with such limits: quantity, min and max."""
    return {f"limit_{part}": [row[k] for row in rows] for k, part in enumerate(("of", "min", "max"))} | more


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (limited(("object_sample_mm", "", "")), "object_sample_mm has no limit; give min, max or both"),
        (limited(("object_sample_mm", "1 mm", "0.2")), "min 1 mm is above max 0.2 mm"),
        (limited(("fill_factor", "much", "")), 'cannot read "much"; write a number without a unit'),
        (limited(("price", "1", "")), "price"),
        (limited(("", "", ""), only_own=["on"]), "limits: there are none; choose a quantity"),
    ],
)
def test_limits_that_cannot_be_are_told(options, message):
    with pytest.raises(InputError) as caught:
        read_form(ToleranceRequest, PAPER, options)
    assert message in str(caught.value)


def test_own_limits_are_those_of_the_yield():
    """Of the paper's object sample, 0.0945 mm: nearly all builds lie in a wide band, half of them above nominal."""
    nominal = float(QUANTITIES["object_sample_mm"](Camera.of(PAPER)))
    rows = (("object_sample_mm", "0.5 um", f"{2e3 * nominal} um"), ("object_sample_mm", repr(nominal), ""))
    options = limited(*rows, ("", "", ""), trials=["256"], only_own=["on"])
    result = run_tolerance(read_form(ToleranceRequest, PAPER, options))
    (_, wide), (_, half) = result.limits
    assert (wide.value, half.value) == (1.0, pytest.approx(0.5, abs=0.1))
    assert result.share.value == half.value
    assert "image centres" not in result.question
    assert f"at least {nominal:.4g} mm" in result.question
    both = read_form(ToleranceRequest, PAPER, limited(rows[0], trials=["64"]))
    assert (both.only_own, [limit.quantity for limit in both.limits]) == (False, ["object_sample_mm"])


def test_what_a_design_requires_is_what_a_good_build_holds():
    """As `roslf tolerance` has it where a study has no goals of its own; the form's rows show it, to be edited."""
    limits = {"total_length_mm": {"max": "400 mm"}, "object_sample_mm": {"at": "150 mm", "max": "0.2 mm"}}
    asking = PAPER.replace({"required": limits})
    rows = forms(State.of(asking))["asked"]
    assert rows == [
        {"of": "total_length_mm", "at": "", "min": "", "max": "400 mm"},
        {"of": "object_sample_mm", "at": "150 mm", "min": "", "max": "0.2 mm"},
    ]
    assert forms(State.of(PAPER))["asked"] == []
    options = {f"limit_{part}": [row[part] for row in rows] for part in ("of", "min", "max", "at")}
    request = read_form(ToleranceRequest, asking, options | {"trials": ["64"], "only_own": ["on"]})
    study = {"name": "the same", "design": "paper", "grade": request.grade, "trials": 64}
    assert request.limits == tolerance_plan(study, asking)[1].goals
    result = run_tolerance(request)
    assert len(result.limits) == 2
    assert "object sample at 150 mm at most 0.2 mm" in result.question


def test_a_limit_that_the_design_misses_as_drawn_is_said_while_builds_are_tried():
    """Its offenders used no share of a room that is none: all were undefined, after a minute of builds."""
    nominal = float(QUANTITIES["object_sample_mm"](Camera.of(PAPER)))
    rows = (("object_sample_mm", "", f"{0.5 * nominal} mm"), ("total_length_mm", "", "400 mm"))
    request = read_form(ToleranceRequest, PAPER, limited(*rows, trials=["64"], only_own=["on"]))
    heard = []
    result = run_tolerance(request, lambda share, text: heard.append(text))
    words = "As drawn, before any tolerance, it misses object sample, which no grade mends."
    assert heard[1] == f"0 of 64 builds. {words}"
    assert words in result.question
    assert result.share.value == 0
    assert all(math.isfinite(one.used) for one in result.offenders)
    assert {one.limited_by for one in result.offenders if one.used > 0} == {"length from tip to sensor"}
    assert "As drawn" not in run_tolerance(replace(request, limits=request.limits[1:])).question


def test_the_optimise_form_is_read():
    offered = forms(State.of(PAPER))
    chosen = {
        "goal": [offered["goals"][2]["key"]],
        "against": ["depth"],
        "variables": [item["key"] for item in offered["variables"] if not item["follows"]],
        "held": [item["key"] for item in offered["held"]],
        "matched": ["on"],
    }
    request = read_form(OptimiseRequest, PAPER, chosen)
    assert (request.goal, request.against) == (list(GOALS)[2], "depth")
    assert (request.variables, request.held) == (tuple(s for s in VARIABLES if s != "d_f"), tuple(HELD))
    assert (request.matched, request.undistorted, request.in_focus) == (True, False, False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "may vary: nothing is chosen"),
        ({"variables": ["no such"]}, "may vary: nothing is chosen"),
        ({"variables": ["d_2"], "goal": ["money"]}, "goal: 'money' is not known"),
        ({"variables": ["d_2"], "against": ["money"]}, "against: 'money' is not known"),
        ({"variables": ["f", "d_f"]}, "d_f: follows from the other two"),
        ({"variables": ["d_1"], "follows": ["d_1"]}, "d_1: follows from the other two"),
        ({"variables": ["D_F"], "low_D_F": ["x"]}, "D_F, bound: cannot read"),
        ({"variables": ["D_F"], "low_D_F": ["4 mm"], "high_D_F": ["3 mm"]}, "D_F, bounds: 4 mm to 3 mm"),
        ({"variables": ["D_F"], "low_D_F": ["0 mm"]}, "must be above zero"),
        ({"variables": ["d_3"], "low_d_3": ["-1 mm"]}, "must not be negative"),
    ],
)
def test_what_the_optimise_form_cannot_ask_is_told(options, message):
    with pytest.raises(InputError) as caught:
        read_form(OptimiseRequest, PAPER, options)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"exposures": ["0"]}, "exposures: '0' is not"), ({"seed": ["x"]}, "seed: 'x' is not a whole number")],
)
def test_what_the_measuring_form_cannot_ask_is_told(options, message):
    with pytest.raises(InputError) as caught:
        read_form(MeasureRequest, PAPER, options)
    assert message in str(caught.value)


def test_depth_is_measured_about_the_microlens_that_is_looked_at(monkeypatch):
    """At the corner the square is moved until it lies on the sensor."""
    monkeypatch.setattr(measure_run, "ACROSS", 5)
    at_first_sight(monkeypatch)
    corner = (11.0, 7.3)  # of a sensor of 11.15 x 7.47 mm
    request = read_form(MeasureRequest, PAPER, {"place": list(map(str, corner)), "exposures": ["1"]})
    shares = []
    trial = run_measure(request, lambda share, text: shares.append(share))
    rows, columns = trial.true.shape
    assert {rows, columns} <= {5, 6}
    assert abs(trial.first.x_ml[rows // 2, columns // 2] - corner).max() <= 3 * PAPER.d
    assert shares == sorted(shares)
    page = trial_page(trial)
    assert "predicted" in page["headline"]
    assert not any("--" in said["remedy"] for said in page["sentences"])


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_a_region_about_a_microlens_has_it_in_the_middle(layout):
    design = PAPER.replace({"microlens_array.layout": layout})
    column, row, columns, rows = region_about(design, (4.0, -2.0), 15)
    place = np.array([column + columns / 2, row + rows / 2]) - np.array(design.pixels) / 2
    assert place * design.q == pytest.approx(np.array([4.0, -2.0]) * IMAGE_PITCH / design.d, abs=design.q)


SCOPE = load("rigid-scope")


@pytest.mark.parametrize("follows", ["d_f", "d_1"])
def test_only_what_is_ticked_and_what_is_said_to_follow_moves_and_all_of_it_is_told(follows):
    # Of these numbers f moves because it is ticked, and f_ml and one of d_f and d_1 because the page says so.
    options = {"variables": ["f"], "follows": [follows], "low_f": ["1.7 mm"], "high_f": ["1.9 mm"], "in_focus": ["on"]}
    request = read_form(OptimiseRequest, SCOPE, options)
    assert request.bounds == {"f": (1.7, 1.9)}
    shares = []
    result = run_optimise(request, lambda share, text: shares.append(share))
    assert shares[1:] == sorted(shares[1:])
    found = result.design
    moved = {s for s in BY_SYMBOL if abs(getattr(found, s) / getattr(SCOPE, s) - 1) > 1e-9}
    assert moved == {"f", follows, "f_ml"}
    assert {change.symbol for change in result.changes} | {symbol for symbol, *_ in result.followers} == moved
    assert 1.7 * (1 - 1e-12) <= found.f <= 1.9 * (1 + 1e-12)
    for symbol, before, after in result.followers:
        assert (before, after) == (getattr(SCOPE, symbol), pytest.approx(getattr(found, symbol), rel=1e-9))


def test_an_optimum_holds_the_glass_about_its_array():
    """Its search went where the sensor stands inside the array's plate, and ended in an error about a design."""
    scope = load("arthroscope")
    found = run_optimise(OptimiseRequest(scope, variables=("D_F", "d_2"))).design
    assert found is not None
    assert found.d_2 >= scope.microlens_array.substrate.thickness > 0.75 * scope.d_2


def test_f_ml_stays_where_it_is_not_let_follow():
    request = read_form(OptimiseRequest, SCOPE, {"variables": ["d_2"]})
    result = run_optimise(request)
    assert result.design.f_ml == SCOPE.f_ml
    assert (result.followers, result.design.d_2 == SCOPE.d_2) == ((), False)


@pytest.mark.parametrize("name", preset_names())
def test_usual_bounds_keep_the_fap_before_the_focal_plane_and_that_ahead_of_the_tip(name):
    design = load(name)
    tip = float(Camera.of(design).tip)
    low, high = _usual_bounds(design, "d_3")
    assert low <= design.d_3 <= high < design.d_f
    assert Camera.of(design, {"d_3": high}).tip <= max(tip, high)
    if design.d_3 < tip:  # another part is the tip, and stays it
        assert high <= tip
    low, high = _usual_bounds(design, "d_f")
    assert max(tip, design.f) < low <= design.d_f <= high


def test_bounds_are_those_that_are_shown_unless_another_is_typed():
    shown = {item["key"]: item for item in forms(State.of(SCOPE))["variables"]}
    assert (read(BY_SYMBOL["D_F"], shown["D_F"]["low"]), shown["d_1"]["follows"]) == (SCOPE.D_F / 2, True)
    request = read_form(OptimiseRequest, SCOPE, {"variables": ["D_F", "d_2"], "high_D_F": ["1.2"]})
    assert request.bounds == {"D_F": (SCOPE.D_F / 2, 1.2), "d_2": (SCOPE.d_2 / 2, SCOPE.d_2 * 2)}


def test_behind_a_real_lens_a_search_is_by_rays_and_varies_nothing_of_the_lens():
    singlet = load("paper-singlet")
    offered = {item["key"] for item in forms(State.of(singlet))["variables"]}
    assert set(VARIABLES) - offered == {"D", "f"}
    ticks = {"variables": ["d_2"], "goal": ["field"], "matched": ["on"], "in_focus": ["on"], "low_d_2": ["1.9 mm"]}
    found = run_optimise(read_form(OptimiseRequest, singlet, ticks))
    # What varies hardly moves the field, which rays tell before and after.
    assert found.before == pytest.approx(evaluate(singlet).answer.at[0].width_mm / 2, rel=1e-6)
    assert found.after == pytest.approx(found.before, rel=3e-4)
    levels = {verdict.name: verdict.level for verdict in evaluate(found.design).verdicts}
    assert levels["f_number_matched"] == "good"
    assert any("Behind the real lens" in said.text for said in found.sentences)
    # Where d_1 varies, d_f follows alone, as f is the lens's own.
    moved = run_optimise(read_form(OptimiseRequest, singlet, ticks | {"variables": ["d_1", "d_2"], "low_d_1": ["120"]}))
    assert {symbol for symbol, *_ in moved.followers} == {"f_ml", "d_f"}


def test_a_run_is_told_from_start_to_cancel():
    assert summary(None, PAPER)["state"] == "none"
    run = Run.begin("tolerance", PAPER, {"trials": ["1000000"]})
    try:
        assert summary(run, PAPER)["state"] == "running"
        assert summary(run, PAPER)["text"].startswith("running")
        assert summary(run, PAPER.replace(D_F=3.0))["stale"]
    finally:
        run.job.cancel()
    assert summary(run, PAPER)["state"] == "failed"
    assert summary(run, PAPER)["message"] == "cancelled"


def test_an_optimum_is_of_the_depth_that_a_data_sheet_may_have_unless_another_is_chosen():
    assert GOALS[read_form(OptimiseRequest, PAPER, {"variables": ["d_3"]}).goal].quantity == "u_z_mm"
    assert next(iter(GOALS.values())).quantity == "u_z_mm"


def test_what_a_design_requires_is_held_where_it_is_ticked():
    whole = float(QUANTITIES["total_length_mm"](Camera.of(PAPER)))
    limits = {"total_length_mm": {"min": f"{whole - 20} mm"}, "object_sample_mm": {"at": "40 mm", "max": "10 mm"}}
    asking = PAPER.replace({"required": limits})
    length, sample = f"at least {whole - 20} mm", "at most 10 mm, 40 mm ahead of the tip"
    told = f"length from tip to sensor {length}; object sample {sample}"
    assert (forms(State.of(asking))["required"], forms(State.of(PAPER))["required"]) == (told, "")
    sharp = PAPER.replace({"required": {"detail_lp_per_mm": {"min": 1.0}}})
    assert "at least 1 lp/mm" in forms(State.of(sharp))["required"]
    ticks = {"variables": ["d_3"], "goal": ["length"]}
    assert not read_form(OptimiseRequest, asking, ticks).required
    held = run_optimise(read_form(OptimiseRequest, asking, ticks | {"required": ["on"]}))
    assert held.after == pytest.approx(whole - 20, abs=1e-3)
