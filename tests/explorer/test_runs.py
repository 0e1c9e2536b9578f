"""What tolerance and optimisation runs find, against closed forms and against the same study run elsewhere."""

import math
import pickle

import pytest

import roslf_design as roslf
from roslf_design import theory
from roslf_design.errors import InputError
from roslf_design.explorer import optimise_run, tolerance_run
from roslf_design.explorer.optimise_run import OptimiseRequest
from roslf_design.explorer.tolerance_run import ToleranceRequest
from roslf_design.report.quick_tolerances import DEPTH, quick_tolerances

PAPER = roslf.load("paper")


@pytest.fixture(scope="module")
def tolerances():
    told = []
    found = tolerance_run.run(ToleranceRequest(PAPER, trials=512), lambda share, text: told.append((share, text)))
    return found, told


def test_yield_is_that_of_the_same_study_in_a_report(tolerances):
    found, _ = tolerances
    other = quick_tolerances(PAPER, trials=512).final
    assert found.share.value == other.result.value
    assert (found.share.low, found.share.high) == other.result.interval
    assert [limit.share.value for limit in found.limits] == [limit.result.value for limit in other.limits]


def test_progress_goes_up_to_the_end(tolerances):
    _, told = tolerances
    shares = [share for share, _ in told if share is not None]
    assert shares == sorted(shares)
    assert 0 <= shares[0] < 0.5 < shares[-1] <= 1


def test_offenders_use_what_closed_forms_say(tolerances):
    found, _ = tolerances
    used = {row.place: row for row in found.offenders}
    # Depth spread goes with 1/D_F, and may grow by DEPTH.
    assert used["aperture diameter"].tolerance == "50 um"
    assert used["aperture diameter"].used == pytest.approx((2.9 / 2.85 - 1) / DEPTH, rel=1e-9)
    assert used["aperture diameter"].limited_by == "depth spread σ_Z"
    # The fill factor may change by a tenth of itself; d_2 is 20 um long or short.
    optics = (PAPER.f, PAPER.d_f, PAPER.d_3)
    fill = [float(theory.fill_factor(PAPER.D_F, PAPER.d, d_2, *optics)) for d_2 in (2.0, 2.02)]
    assert used["sensor distance"].used == pytest.approx((fill[1] / fill[0] - 1) / 0.1, rel=1e-3)
    assert [row.used for row in found.offenders] == sorted((row.used for row in found.offenders), reverse=True)


def test_tighter_grades_and_tolerances_yield_more(tolerances):
    found, _ = tolerances
    grades = [share.value for _, share in found.grades]
    assert [name for name, _ in found.grades] == list(tolerance_run.GRADES)
    assert grades == sorted(grades)
    curve = [share.value for _, share in found.curve]
    # Few builds: neighbouring points may swap within their intervals.
    assert curve[0] >= curve[-1]
    assert all(share.low <= share.value <= share.high for _, share in found.curve)


def test_spreads_lie_about_nominal_and_results_travel(tolerances):
    found, _ = tolerances
    for row in found.spreads:
        assert row.low <= row.high
        assert row.limit_low < row.limit_high
    assert pickle.loads(pickle.dumps(found)) == found


def test_an_unknown_grade_is_named():
    with pytest.raises(InputError, match="'best' is not known; use one of commercial, precision, high"):
        tolerance_run.run(ToleranceRequest(PAPER, grade="best", trials=64))


def test_finest_depth_by_the_pupil_alone_is_where_images_touch():
    found = optimise_run.run(OptimiseRequest(PAPER, variables=("D_F",), undistorted=False))
    exact = theory.matched_pupil_diameter(PAPER.d, PAPER.d_2, PAPER.f, PAPER.d_f, PAPER.d_3).value
    (change,) = found.changes
    assert found.feasible
    assert change.after == pytest.approx(float(exact), rel=1e-6)
    assert math.isclose(found.design.D_F, change.after, rel_tol=1e-12)
    assert not change.at_bound
    assert found.before == pytest.approx(1.249138, rel=1e-5)
    # Depth spread goes with 1/D_F.
    assert found.after / found.before == pytest.approx(2.9 / change.after, rel=1e-9)
    assert pickle.loads(pickle.dumps(found)) == found


def test_held_values_do_not_get_worse_and_bounds_hold():
    request = OptimiseRequest(
        PAPER, goal="light", variables=("D_F", "d_2", "d_3"), held=("views", "field"), bounds={"D_F": (2.0, 3.5)}
    )
    found = optimise_run.run(request)
    assert found.feasible
    before, after = roslf.evaluate(PAPER), roslf.evaluate(found.design)
    assert after.sampling.views_independent >= before.sampling.views_independent * (1 - 1.01 * optimise_run.GIVE)
    assert after.non_distortion.field_half_width_mm >= before.non_distortion.field_half_width_mm * 0.9989
    assert after.non_distortion.room_at_corner_mm >= -1e-6
    assert 0.98 - 1e-6 <= after.f_number.fill_factor <= 1 + 1e-6
    assert 2.0 <= found.design.D_F <= 3.5
    assert found.after > found.before


def test_a_front_trades_and_is_ordered():
    found = optimise_run.run(OptimiseRequest(PAPER, against="field", variables=("D_F", "d_3", "d_2", "d_f")))
    assert found.quantity == "depth spread σ_Z"
    assert found.against_quantity == "field half width"
    assert len(found.front) >= 3
    front = sorted(found.front)
    fields = [field for _, field in front]
    assert fields == sorted(fields)


def test_limits_that_cannot_hold_together_are_named():
    design = roslf.load("mismatched-borescope")
    found = optimise_run.run(OptimiseRequest(design, held=("depth", "pixels", "light", "length")))
    assert not found.feasible
    assert found.design is None
    assert any(s.tone == "bad" and "fill factor" in s.text and s.remedy for s in found.sentences)


def test_a_real_lens_is_refused_in_words_of_the_page():
    with pytest.raises(InputError, match=r"main lens: .* is a real lens, and the search varies ideal ones"):
        optimise_run.run(OptimiseRequest(roslf.load("paper-singlet")))


def test_bounds_are_about_the_design():
    request = OptimiseRequest(PAPER)
    low, high = optimise_run.bounds_of(request, "D_F")
    assert (low, high) == (1.45, 5.8)
    assert optimise_run.bounds_of(OptimiseRequest(PAPER.replace(d_3=0.0)), "d_3") == (0.0, 10.0)
    assert optimise_run.bounds_of(request, "d_f")[0] > PAPER.f
    assert math.isfinite(optimise_run.bounds_of(request, "d_3")[1])
