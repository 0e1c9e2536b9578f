"""Every row of hard cases on designs that differ: budgets kept, no fault, and the numbers that were asked for."""

import json
import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.accuracy.cases import Budget, HardCase, Trial
from roslf_design.accuracy.hard_cases import all_cases, run_hard_cases, share
from roslf_design.accuracy.hard_cases_page import hard_cases_report, tangency_table
from roslf_design.accuracy.walks import approach, gaps
from roslf_design.report.html import render_html
from studies.accuracy.oracles.discs import lens_area

CASES = {case.name: case for case in all_cases()}
DESIGNS = ("paper", "ear-speculum", "mismatched-borescope")


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("design", DESIGNS)
def test_budgets_hold_on_the_way_to_every_singular_point(name, design):
    (result,) = run_hard_cases(roslf.load(design), cases=[CASES[name]], steps=5, seed=3).results
    assert not result.faults
    assert result.at_point is None or not result.at_point.faults
    for one in result.functions:
        assert one.share <= 1, one


def test_discs_of_the_bench_at_three_gaps():
    """At most 16 ulp, where the textbook formula is off by 5.6e-5, 0.18 and 1.9e3."""
    case = CASES["discs near tangency"]
    found = run_hard_cases(roslf.load("paper"), cases=[case], steps=0)
    first = found.results[0].points[:3]
    assert [point.ours.ulps <= 16 for point in first] == [True] * 3
    for point, textbook in zip(first, (5.6e-5, 0.18, 1.9e3), strict=True):
        assert 0.2 * textbook < point.naive < 5 * textbook  # its last digits depend on the libm
    assert [row[0] for row in tangency_table(found).rows] == ["1e−04", "1e−06", "1e−08"]


@pytest.mark.parametrize("gap", [1e-4, 1e-6, 1e-8])
def test_reference_of_the_overlap_is_another_formula_s(gap):
    from roslf_design.accuracy.shape_cases import _exact_area

    r, R = 2.2, 25.4
    distance = r + R - gap
    import mpmath as mp

    with mp.workdps(60):
        mine = _exact_area(*(mp.mpf(v) for v in (r, R, distance, 0.0)))
        assert abs(mine - lens_area([[0.0, 0.0], [distance, 0.0]], [r, R])) < mp.mpf(10) ** -40


def test_a_function_that_loses_digits_is_caught():
    """The table is not blind: a formula that cancels, judged as if it were ours, breaks its budget."""
    real = CASES["d_f → f"]

    def swapped(design, rng, count):
        for trial in real.trials(design, rng, count):
            if trial.function == "mla_distance":
                yield Trial("mla_distance", trial.gap, trial.given, trial.naive, trial.exact, trial.naive)

    bad = HardCase("swapped", "", "", swapped, shown="mla_distance")
    found = run_hard_cases(roslf.load("paper"), cases=[bad], steps=10)
    # Near f the distance is ill-conditioned by 1/gap alone, and so is the textbook's loss: it must show at its own
    # budget only if larger than the condition excuses. Nearer than that, 1/f - 1/d_f is no number.
    assert not found.held or max(point.naive for point in found.results[0].points) > 1e-3


def test_nan_and_exceptions_are_faults():
    def trials(design, rng, count):
        for ours in (lambda x: float("nan"), lambda x: 1 / (x - 1.0)):
            yield Trial("f", 0.1, {"x": 1.0}, ours, lambda x: x, None)

    found = run_hard_cases(roslf.load("paper"), cases=[HardCase("broken", "", "", trials, shown="f")], steps=1)
    assert len(found.results[0].faults) == 2
    assert not found.held
    assert json.dumps(found.to_dict(), allow_nan=False)


def test_walks_end_at_the_neighbours():
    rng = np.random.default_rng(1)
    values = list(approach(350.0, rng, 20))
    assert values[-2:] == [math.nextafter(350.0, 0), math.nextafter(350.0, 400)]
    assert len(set(values)) > 20
    assert 350.0 not in values
    spread = np.log10(gaps(np.random.default_rng(2), 2000, 1e-16))
    assert abs(np.mean(spread) + 8.5) < 0.4  # log-uniform between -16 and -1


def test_share_grants_the_condition_only_where_the_budget_does():
    from roslf_design.accuracy.digits import Judged

    judged = Judged(40.0, 1e-15, 9.0)
    assert share(judged, Budget(4)) == 1.0
    assert share(judged, Budget(16, "", False)) == 2.5


def test_design_near_a_case_is_told():
    paper = roslf.load("paper")
    near = {one.case: one for one in run_hard_cases(paper.replace(d_3=100.0000001), cases=[]).near}
    assert near["d_3 → f"].near
    assert "7" in near["d_3 → f"].says or "9" in near["d_3 → f"].says
    assert not near["d_3 → d_f"].near
    clipped = paper.replace({"main_lens.diameter": 8.0})
    assert any(one.distance < 3 for one in run_hard_cases(clipped, cases=[]).near if one.case == "barely clipped")


def test_page_holds_every_case_and_repeats_itself():
    few = [CASES[name] for name in ("d_3 → d_f", "discs near tangency", "points at infinity")]
    found = run_hard_cases(roslf.load("paper"), cases=few, steps=2)
    page = render_html(hard_cases_report(found, "roslf accuracy hard-cases paper"))
    assert page == render_html(hard_cases_report(found, "roslf accuracy hard-cases paper"))
    for case in found.results:
        assert case.worst.function in page
    assert "http://" not in page.replace("http://www.w3.org", "")
