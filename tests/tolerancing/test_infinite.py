"""Builds in which a metric is infinite: yields, quantiles and spreads against builds one by one."""

import json
import math

import numpy as np
import pytest

from roslf_design.camera import Camera
from roslf_design.optimization.study import read_study, run
from roslf_design.reporting.tolerance.pages import tables, tolerance_pictures
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.result import analyse
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.sensitivities import sobol_indices
from roslf_design.tolerancing.study import tolerance_plan

FAR, VIEW_FAR = "depth_of_field_far_mm", "view_depth_of_field_far_mm"
TRIALS = 4000


def study(metric, low=None, high=None, **more):
    data = {
        "name": "far",
        "design": "rigid-scope",
        "trials": TRIALS,
        "perturb": [{"place": "D_F", "tolerance": "10 um"}, {"place": "d_1", "tolerance": "20 um"}],
        "goals": [{"metric": metric, **{k: v for k, v in (("min", low), ("max", high)) if v is not None}}],
        "sobol_samples": 64,
        **more,
    }
    plan, read, grades = tolerance_plan(data)
    return plan, analyse(plan, read, grades, tally_chunk(plan, 0))


def each(plan, metric):
    """Every trial's far end by the quantity itself, of cameras made outside the study."""
    draws = plan.draws
    values = draws.values(draws.deviations(draws.uniforms(0, plan.chunk, 0, plan.trials)))
    return QUANTITIES[metric](Camera.of(plan.question.design).replace(values))


@pytest.mark.parametrize(
    ("metric", "low", "high", "more"),
    [
        # Infinite at nominal and in every build; in a few; in a third of them.
        (VIEW_FAR, 200.0, None, {}),
        (FAR, 90.0, None, {}),
        (FAR, None, 300.0, {}),
        (FAR, 100.0, 5000.0, {"perturb": [{"place": "d_1", "tolerance": "60 um"}]}),
    ],
)
def test_yield_and_quantiles_are_those_of_the_builds(metric, low, high, more):
    plan, result = study(metric, low, high, **more)
    far = each(plan, metric)
    holds = (far >= (low or 0.0)) & (far <= (math.inf if high is None else high))
    (column,) = result.final.distributions
    assert result.final.result.passed == holds.sum()
    assert (column.infinite, column.undefined) == (np.isinf(far).sum(), 0)
    assert column.low == pytest.approx(far.min(), rel=1e-12)
    assert column.high == far.max()
    ordered = np.sort(far)
    for share, quantile in zip(column.probabilities, column.quantiles, strict=True):
        # A bin is a 128th of a deviation from nominal wide, and ranks may be one off.
        near = ordered[np.clip(math.ceil(share * TRIALS) - 1 + np.arange(-2, 3), 0, TRIALS - 1)]
        slack = 0.0 if np.isinf(near).all() else np.abs(near[np.isfinite(near)] - 174.0).max() / 128
        assert near[0] - slack <= quantile <= near[-1] + slack
    assert sum(column.histogram) == pytest.approx(TRIALS if column.cuts else 0)
    if np.isinf(far).any():
        assert math.isnan(column.mean)


def test_a_share_of_tolerances_and_their_indices_are_told_where_builds_go_to_infinity():
    plan, result = study(FAR, 90.0)
    far = each(plan, FAR)
    assert np.isinf(far).any()
    # The far end alone until it fails: d_1 that puts it at 90 mm, by bisection on the quantity.
    camera = Camera.of(plan.question.design)
    inside, outside = 0.0, 0.1
    for _ in range(60):
        middle = (inside + outside) / 2
        held = float(QUANTITIES[FAR](camera.replace({"microlens_array.distance": camera.d_1 + middle}))) >= 90
        inside, outside = (middle, outside) if held else (inside, middle)
    assert result.allowed[1].alone == pytest.approx(inside, rel=1e-5)
    indices = sobol_indices(plan, 1024)
    assert indices.undefined_evaluations.tolist() == [0]
    assert indices.total[0].sum() == pytest.approx(1, abs=0.1)
    corr = np.corrcoef(-1 / far, plan.draws.deviations(plan.draws.uniforms(0, plan.chunk, 0, TRIALS)))[0, 1:]
    assert result.correlations[0] == pytest.approx(corr, abs=1e-9)


def test_json_has_no_infinity_but_its_inverse():
    plan, result = study(VIEW_FAR, 200.0)
    data = result.to_dict()
    text = json.dumps(data, allow_nan=False)
    assert json.loads(text) == data
    column = data["variants"][0]["distributions"][0]
    assert column["nominal"] is None
    assert column["inverse"]["nominal"] == 0
    assert column["infinite_trials"] == TRIALS
    twins = data["sensitivity"]["twins"][VIEW_FAR]
    assert np.isfinite(np.array(twins["at_plus"], float)).all()
    assert not plan.nominal_misses()
    assert not any("misses" in words for words in result.warnings)


@pytest.mark.parametrize(("metric", "low"), [(VIEW_FAR, 200.0), (FAR, 90.0)])
def test_tables_and_pictures_stand_infinity(metric, low):
    _, result = study(metric, low)
    assert any("∞" in cell for table in tables(result) for row in table.rows for cell in row) == (metric == VIEW_FAR)
    assert {"spread", "sensitivity", "correlation"} <= set(tolerance_pictures(result))


def test_a_compensator_brings_a_far_end_back_from_infinity():
    """d_1 misses by more than its whole room; refocused by d_1, every build has its nominal far end again."""
    more = {
        "perturb": [{"place": "f", "tolerance": "2 %"}],
        "compensators": [{"place": "d_1"}],
        "sobol_samples": 0,
    }
    plan, result = study(FAR, 150.0, 200.0, **more)
    assert np.isinf(each(plan, FAR)).any()
    assert result.variants[0].result.value < 0.5
    assert result.final.result.value == 1


def test_robust_designs_hold_limits_by_infinity():
    data = {
        "name": "far",
        "design": "rigid-scope",
        "variables": {"D_F": ["0.05 mm", "0.6 mm"], "d_f": ["15 mm", "60 mm"]},
        "constraints": [{"quantity": VIEW_FAR, "min": "200 mm"}],
        "goals": [{"quantity": "light_sr", "direction": "max"}],
        "solver": {"starts": 1, "check": False},
        "robust": {"trials": 32, "perturb": [{"place": "d_1", "tolerance": "5 um"}]},
    }
    robust = run(read_study(data)).to_dict()["robust"]
    assert robust["nominal"]["yield"] == robust["robust"]["yield"] == 1
    goal = {"quantity": FAR, "direction": "max"}
    several = {**data["robust"], "maximise": "quantile"}
    robust = run(read_study({**data, "constraints": [], "goals": [goal], "robust": several})).to_dict()["robust"]
    assert robust["nominal"]["goal"] is None
    assert robust["robust"]["goal_quantile"] is None
