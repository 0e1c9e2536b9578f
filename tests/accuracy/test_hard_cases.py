"""Every row of hard cases on designs that differ: budgets kept, no fault; and the references against each other."""

import json
import math

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.evaluation.near_cases import near_cases
from roslf_design.reporting.printers import render_html
from studies.accuracy.hard_cases import Budget, HardCase, Trial, run_hard_cases
from studies.accuracy.hard_page import hard_cases_report, tangency_table
from studies.accuracy.hard_rows import all_cases
from studies.accuracy.hard_walks import approach, gaps
from studies.accuracy.oracles.closed_forms import ORACLES, keywords
from studies.accuracy.oracles.discs import area, lens_area
from studies.accuracy.oracles.judging import DIGITS, Judged, exactly, flat
from studies.accuracy.oracles.textbook import TEXTBOOK, overlap
from tests.theory.designs import arguments, random_designs

CASES = {case.name: case for case in all_cases()}
PAPER = roslf.load("paper")


@pytest.mark.parametrize("name", CASES)
def test_budgets_hold_on_the_way_to_every_singular_point(name):
    (result,) = run_hard_cases(PAPER, [CASES[name]], steps=5, seed=3).results
    assert not result.faults
    assert result.at_point is None or not result.at_point.faults
    for one in result.functions:
        assert one.share <= 1, one


@pytest.mark.parametrize("design", ["cystoscope", "paper-singlet", "arthroscope"])
def test_small_fields_through_a_bore_a_lens_or_a_mapping(design):
    """Lengths as the main lens sees them, not those of a ruler."""
    assert run_hard_cases(roslf.load(design), [CASES["small field angles"]], steps=12).held


def test_discs_of_the_bench_at_three_gaps():
    """At most 16 ulp, where the textbook formula is off by 5.6e-5, 0.18 and 1.9e3."""
    (result,) = run_hard_cases(PAPER, [CASES["discs near tangency"]], steps=0).results
    for point, textbook in zip(result.points[:3], (5.6e-5, 0.18, 1.9e3), strict=True):
        assert point.ours.ulps <= 16
        assert 0.2 * textbook < point.naive < 5 * textbook  # its last digits depend on the libm
    assert [row[0] for row in tangency_table().rows] == ["1e−04", "1e−06", "1e−08"]


def test_a_function_that_loses_digits_is_caught():
    """The table is not blind: a form that cancels, judged as if it were ours, breaks its budget, or its loss shows."""

    def swapped(design, rng, count):
        for trial in CASES["d_f → f"].trials(design, rng, count):
            if trial.function == "mla_distance":
                yield Trial("mla_distance", trial.gap, trial.given, trial.naive, trial.exact, trial.naive)

    cases = run_hard_cases(PAPER, [HardCase("swapped", "", "", swapped, "mla_distance")], steps=10)
    assert not cases.held or max(point.naive for point in cases.results[0].points) > 1e-3


def test_nan_and_exceptions_are_faults():
    def trials(design, rng, count):
        for ours in (lambda x: float("nan"), lambda x: 1 / (x - 1.0)):
            yield Trial("f", 0.1, {"x": 1.0}, ours, lambda x: exactly(x))

    cases = run_hard_cases(PAPER, [HardCase("broken", "", "", trials, "f")], steps=1)
    assert len(cases.results[0].faults) == 2
    assert not cases.held
    assert json.dumps(cases.to_dict(), allow_nan=False)


def test_walks_end_at_the_neighbours():
    values = list(approach(350.0, np.random.default_rng(1), 20))
    assert values[-2:] == [math.nextafter(350.0, 0), math.nextafter(350.0, 400)]
    assert len(set(values)) > 20
    assert 350.0 not in values
    spread = np.log10(gaps(np.random.default_rng(2), 2000, 1e-16))
    assert abs(np.mean(spread) + 8.5) < 0.4  # log-uniform between -16 and -1


def test_share_grants_the_condition_only_where_the_budget_does():
    judged = Judged(None, 40.0, 1e-15, 9.0)
    assert Budget(4).share(judged) == 1.0
    assert Budget(16, "", False).share(judged) == 2.5


def test_design_near_a_case_is_told():
    near = {one.case: one for one in near_cases(PAPER.replace(d_3=100.0000001))}
    assert near["d_3 → f"].near
    assert "7" in near["d_3 → f"].says or "9" in near["d_3 → f"].says
    assert not near["d_3 → d_f"].near
    clipped = near_cases(PAPER.replace({"main_lens.diameter": 8.0}))
    assert any(one.distance < 3 for one in clipped if one.case == "barely clipped")


def test_page_holds_every_case_and_repeats_itself():
    few = [CASES[name] for name in ("d_3 → d_f", "discs near tangency", "points at infinity")]
    cases = run_hard_cases(PAPER, few, steps=2)
    page = render_html(hard_cases_report(cases, "roslf accuracy hard-cases paper"))
    assert page == render_html(hard_cases_report(cases, "roslf accuracy hard-cases paper"))
    for case in cases.results:
        assert case.functions[0].function in page
    assert "http://" not in page.replace("http://www.w3.org", "")


# --- the references: two derivations, one number ----------------------------------------------------------------------

CAMERAS = tuple(random_designs(30, seed=7))


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_textbook_formula_is_the_traced_one(name):
    """Formulas at 60 digits against rays traced at 60 digits."""
    assert set(TEXTBOOK) == set(ORACLES)
    for design in CAMERAS:
        given = arguments(name, design)
        if given.get("pupil_distance") in (0.0, given.get("focal_length"), given.get("focal_plane_distance")):
            continue  # 0/0 in the textbook: the limits are tests/theory's part
        with mp.workdps(DIGITS):
            formula = flat(TEXTBOOK[name](**{key: exactly(given[key]) for key in keywords(name)}))
            for one, other in zip(formula, flat(ORACLES[name](**given)), strict=True):
                if isinstance(one, bool) or mp.isinf(other):
                    assert one == other, given
                else:
                    # Differences of equal terms: 25 digits are left where gaps are 1e-15 of their lengths.
                    assert abs(one - other) <= mp.mpf(10) ** -22 * abs(other) + mp.mpf(10) ** -40, given


def test_overlap_of_discs_is_the_area_between_slices_and_the_segments_of_another_formula():
    with mp.workdps(60):
        for r, R, d in [(2.2, 25.4, 27.0), (2.2, 25.4, 23.5), (1.0, 1.0, 0.5), (3.0, 2.0, 4.9)]:
            sliced = area([[0.0, 0.0], [d, 0.0]], [r, R], digits=40)
            assert abs(overlap(*exactly((r, R, d))) - sliced) < mp.mpf(10) ** -28
        for gap in (1e-4, 1e-6, 1e-8):
            r, R, d = 2.2, 25.4, 27.6 - gap
            other = lens_area([[0.0, 0.0], [d, 0.0]], [r, R])
            assert abs(overlap(*exactly((r, R, d))) - other) < mp.mpf(10) ** -40
