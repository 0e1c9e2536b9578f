"""The uncertainty budget of depth, against brute-force Fisher information, 60-digit lengths and the laws of the GUM."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.evaluation.working_range import WorkingRange
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.depth_error import (
    depth_at,
    depth_error,
    depth_told,
    lengths_error,
    seen_at,
    temperature_error,
)
from roslf_design.theory.depth_of_field import view_blur
from roslf_design.theory.disparity_error import _disparity_information, axial_disparity_sigma
from roslf_design.theory.disparity_information import Spectrum
from roslf_design.theory.field_of_view import focus_ahead
from roslf_design.theory.length_covariance import CalibratedLengths, LengthCovariance
from roslf_design.theory.light_field import epi_slope
from roslf_design.theory.photometry import Beside, electrons
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from studies.depth.prediction_proof import rendered_information
from tests.laws import DEAR

PAPER = roslf.load("paper")
WARM = roslf.load("cystoscope").replace(
    {
        "environment": {"temperature": "25 degC", "range": ["15 degC", "40 degC"], "housing": "316L"},
        "main_lens.material": "N-BK7",
    }
)
HAND_HELD = roslf.load("paper").replace(
    {
        "main_lens": {"diameter": 20.0, "focal_length": 30.0, "focal_plane": 67.5},
        "microlens_array.distance": None,
        "aperture": {"diameter": 0.53, "distance": 45.0},
        "stops": [{"diameter": 4.0, "distance": 53.0}],
        "environment": {"temperature": "40 degC", "calibrated_at": "20 degC", "housing": "aluminium"},
    }
)
PLACES = ("main_lens.focal_length", "microlens_array.distance", "aperture.distance", "sensor.distance")
TOLERANCES = np.array([0.3, 0.05, 0.2, 0.004])
BUILD = LengthCovariance(PLACES, np.diag(TOLERANCES**2))


def terms(budget):
    return {term.name: term for term in budget.terms}


# --- the Fisher information ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("beside", [Beside(0.05), Beside(0.1, 30.0), Beside(0.03, 5.0, 2000.0)])
def test_mismatch_enters_each_pixel_before_matching(beside, light_from_48_px):
    """Brute force over the pixels of rendered pictures, each with its own variance; to 2 % of sigma."""
    camera, periods = Camera.of(PAPER), 0.25
    power = np.full(1, 0.5**2 / 2 * np.sinc(periods) ** 2)
    wave = Spectrum(np.array([periods]), np.array([0.0]), power)
    brute = rendered_information(PAPER, (0.0, 0.0), periods, 0.0, 0.0, beside=beside)
    ours = _disparity_information(MicrolensImages(camera, [(0.0, 0.0)]), seen_at(camera, None), wave, beside)
    assert np.sqrt(brute / ours[0, 0]) == pytest.approx(1.0, abs=0.02)


def test_series_through_many_builds_know_the_mismatch():
    """Series over 600 builds that differ in light, mismatch and veil, against each build alone; to 1e-4."""
    rng = np.random.default_rng(3)
    changes = {
        "light.illuminance": rng.uniform(0.5e5, 1e5, 600),
        "depth.view_mismatch": rng.uniform(0.015, 0.025, 600),
        "light.veil": rng.uniform(0.0, 0.1, 600),
    }
    design = PAPER.replace({"light.exposure": "8 ms"})
    many = Camera.of(design, changes)
    together = axial_disparity_sigma(many, seen_at(many, None), Beside.of(many))
    for k in range(0, 600, 60):
        alone = many.build(k)
        assert together[k] == pytest.approx(
            float(axial_disparity_sigma(alone, seen_at(alone, None), Beside.of(alone))), rel=1e-4
        )


@pytest.mark.parametrize("diameter", [3.25, 4.0])
def test_many_distances_of_images_that_overlap_are_those_taken_one_by_one(diameter):
    """Where several images' light adds up to more than the full well here and there; to 1e-4."""
    camera, at = Camera.of(PAPER.replace({"aperture.diameter": diameter})), np.linspace(250.0, 400.0, 200)
    together = depth_budget(camera, at).u_z_mm
    alone = [float(depth_budget(camera, at[k]).u_z_mm) for k in range(0, 200, 40)]
    np.testing.assert_allclose(together[::40], alone, rtol=1e-4)  # what series promise


def test_without_anything_else_it_is_the_bound():
    bare = Camera.of(PAPER.replace({"depth.view_mismatch": 0.0}))
    budget = depth_budget(bare)
    assert float(budget.u_z_mm) == float(QUANTITIES["sigma_z_mm"](bare)) == float(QUANTITIES["u_z_mm"](bare))
    assert [float(terms(budget)[name].u_mm) for name in ("view mismatch", "veil")] == [0.0, 0.0]


def test_the_bound_knows_nothing_of_what_comes_on_top():
    rough = {"depth.view_mismatch": 0.2, "sensor.prnu": 0.1, "sensor.dsnu": 50.0, "light.veil": 0.3}
    bound = QUANTITIES["sigma_z_mm"]
    assert float(bound(Camera.of(PAPER.replace(rough)))) == float(bound(Camera.of(PAPER)))


def test_mismatch_alone_does_not_hang_on_the_light():
    """With eps far above noise, contrast in units of eps is all that counts."""
    rough = PAPER.replace({"depth.view_mismatch": 0.5, "sensor.full_well": 1e8, "sensor.bits": 24})
    errors = [depth_error(c, None, beside=Beside.of(c)) for c in
              (Camera.of(rough.replace({"light.exposure": t})) for t in (0.1, 1.0))]  # fmt: skip
    assert errors[0] == pytest.approx(errors[1], rel=1e-3)


def test_prnu_counts_as_mismatch_and_dsnu_as_read_noise():
    both = Camera.of(PAPER.replace({"depth.view_mismatch": 0.03, "sensor.prnu": 0.04}))
    one = Camera.of(PAPER.replace({"depth.view_mismatch": 0.05}))
    assert float(QUANTITIES["u_z_mm"](both)) == pytest.approx(float(QUANTITIES["u_z_mm"](one)), rel=1e-12)
    dark = PAPER.replace({"depth.view_mismatch": 0.0, "sensor.dsnu": 40.0})
    read = PAPER.replace({"sensor.read_noise": float(np.hypot(2.5, 40.0))})
    expected = float(QUANTITIES["sigma_z_mm"](Camera.of(read)))
    assert float(QUANTITIES["u_z_mm"](Camera.of(dark))) == pytest.approx(expected, rel=1e-12)


def test_a_veil_that_saturates_leaves_nothing():
    hazy = Camera.of(PAPER.replace({"light.veil": 0.6}))  # beside half of the full well
    assert float(electrons(hazy)) == pytest.approx(0.5 * 10_500)
    assert depth_budget(hazy).largest.name == "veil"
    assert np.isinf(QUANTITIES["u_z_mm"](hazy))
    assert np.isfinite(QUANTITIES["sigma_z_mm"](hazy))


# --- lengths and temperature ----------------------------------------------------------------------------------------


def told(f, d_1, d_3, d_2, slope):
    """Distance from the lens of what has a slope [mm of the array per mm of the sensor], in air, to 60 digits."""
    d_f = 1 / (1 / f - 1 / d_1)
    reach, m = d_1 * (d_f - d_3) / d_f, d_1 / d_f
    return d_3 + reach / (m - slope * d_2 / reach)


@pytest.mark.parametrize("at", [None, 60.0])
def test_lengths_are_carried_by_the_formula_s_own_derivatives(at):
    camera = Camera.of(PAPER)
    with mpmath.workdps(60):
        f, d_1, d_3, d_2 = (mpmath.mpf(float(v)) for v in (camera.f, camera["microlens_array.distance"], 120.0, 2.0))
        d_f = 1 / (1 / f - 1 / d_1)
        z = d_f if at is None else d_3 + at
        reach, m = d_1 * (d_f - d_3) / d_f, d_1 / d_f
        slope = (m - reach / (z - d_3)) * reach / d_2
        assert mpmath.almosteq(told(f, d_1, d_3, d_2, slope), z)
        rates = [
            mpmath.diff(lambda *x: told(*x, slope) - x[2], (f, d_1, d_3, d_2), order)  # the FAP is the tip
            for order in np.eye(4, dtype=int).tolist()
        ]
    rates = np.array([float(rate) for rate in rates])
    assert float(lengths_error(camera, at, BUILD)) == pytest.approx(np.linalg.norm(rates * TOLERANCES), rel=2e-3)


def test_a_thousandth_of_d_1_moves_the_plane_in_focus():
    """The plane in focus is told where it would be with the other d_1."""
    design = PAPER.replace(d_1=140.14)
    moved = abs(design.d_f - PAPER.d_f)
    one = LengthCovariance(("microlens_array.distance",), np.array([[0.14**2]]))
    assert float(lengths_error(Camera.of(PAPER), None, one)) == pytest.approx(moved, rel=0.01)


@pytest.mark.parametrize("at", [None, 30.0])
@pytest.mark.parametrize("calibrated_at", [None, "18 degC", "25 degC", "40 degC", "5 degC"])
@pytest.mark.parametrize("medium", ["air", "water"])
def test_temperature_is_the_root_mean_square_of_shifts_from_where_it_is_calibrated(medium, calibrated_at, at):
    """Brute force: what the same picture is told as, ahead of the tip, at each of 4001 temperatures of the range."""
    design = WARM.replace({"environment.calibrated_at": calibrated_at, "object_space": {"medium": medium}})
    camera = Camera.of(design)
    slope = epi_slope(camera, depth_at(camera, at))
    known = Camera.of(design, {"environment.temperature": float((calibrated_at or "27.5").split()[0])})
    met = Camera.of(design, {"environment.temperature": np.linspace(15.0, 40.0, 4001)})
    shifts = (depth_told(met, slope) - met.tip) - (depth_told(known, slope) - known.tip)
    expected = np.sqrt(np.trapezoid(shifts**2, dx=1 / 4000))
    assert float(temperature_error(camera, at)) == pytest.approx(expected, rel=5e-5)


def test_temperature_moves_the_plane_in_focus_ahead_of_the_tip_by_what_it_counts():
    """Closed form: an ideal lens that nothing moves, in a housing that grows; d_1, its conjugate and the tip move."""
    grown = 1 + 20 * 23.6e-6
    with mpmath.workdps(40):
        f, d_1 = mpmath.mpf("30"), 1 / (1 / mpmath.mpf("30") - 1 / mpmath.mpf("67.5"))
        focus = 1 / (1 / f - 1 / (d_1 * grown))
        expected = float((focus - 53 * grown) - (mpmath.mpf("67.5") - 53))
    assert float(temperature_error(Camera.of(HAND_HELD), None)) == pytest.approx(abs(expected), rel=1e-9)


def test_temperature_of_builds_at_distances_is_that_of_each_alone():
    known = WARM.replace({"environment.calibrated_at": "18 degC"})
    builds = Camera.of(known, {"aperture.distance": [62.0, 63.0, 64.0], "environment.calibrated_at": [18, 20, 22]})
    many = temperature_error(builds.with_axes(1), np.array([20.0, 30.0]))
    alone = [[float(temperature_error(builds.build(k), at)) for at in (20.0, 30.0)] for k in range(3)]
    assert many == pytest.approx(np.array(alone), rel=1e-12)
    row = temperature_error(builds.build(1), np.array([20.0, 30.0]))
    assert row == pytest.approx(np.array(alone[1]), rel=1e-12)


def test_no_depth_at_a_temperature_of_the_range_is_no_finite_error():
    """What is 1 m away at 25 degC moves, to the coldest camera, faster than what is infinitely far."""
    camera = Camera.of(WARM)
    assert np.isinf(temperature_error(camera, np.array([1e3])))
    assert np.isfinite(temperature_error(camera, np.array([30.0])))


def test_temperature_says_where_it_counts_from():
    budgets = {at: depth_budget(Camera.of(WARM.replace({"environment.calibrated_at": at}))) for at in (None, "18 degC")}
    assert budgets[None].to_dict()["calibrated_at_degc"] == 27.5
    assert "27.5 °C, the middle of the range; " in terms(budgets[None])["temperature"].remark
    assert budgets["18 degC"].to_dict()["calibrated_at_degc"] == 18.0
    assert terms(budgets["18 degC"])["temperature"].remark == "15 to 40 °C, counted from 18 °C, where it is calibrated"
    assert depth_budget(Camera.of(PAPER)).to_dict()["calibrated_at_degc"] is None


@pytest.mark.parametrize(("known", "swept"), [("range", "range.0"), ("calibrated_at", "calibrated_at")])
def test_temperatures_are_swept_with_the_other_kind_left_out(known, swept):
    """Of arrays whether any is given is no truth value."""
    value = {"range": ("15 degC", "40 degC"), "calibrated_at": "18 degC"}
    nothing = {"environment.range": None, "environment.calibrated_at": None}
    design = WARM.replace(nothing | {f"environment.{known}": value[known]})
    table = roslf.sweep(design, {f"environment.{swept}": [10.0, 20.0]}, "u_z_mm")
    told = table.values["u_z_mm"]
    assert table.units[f"environment.{swept}"] == "degC"
    first = Camera.of(design, {f"environment.{swept}": 10.0})
    assert told[0] == pytest.approx(float(QUANTITIES["u_z_mm"](first)), rel=1e-12)
    assert told[1] != told[0]


def test_without_a_range_temperature_counts_from_there_to_its_own():
    alone = WARM.replace({"environment.range": None, "environment.calibrated_at": "18 degC"})
    budget = terms(depth_budget(Camera.of(alone)))["temperature"]
    assert budget.remark == "25 °C, counted from 18 °C, where it is calibrated"
    away, known = (Camera.of(alone, {"environment.temperature": t}) for t in (25.0, 18.0))
    there, before = (float(camera.plane_seen_at(camera.seen.d_f) - camera.tip) for camera in (away, known))
    shift = abs(there - before)
    assert float(budget.u_mm) == pytest.approx(shift, rel=1e-9)
    warmer = terms(depth_budget(Camera.of(alone.at_temperature(18))))["temperature"]
    assert float(warmer.u_mm) == 0.0


def test_asked_at_a_temperature_a_range_counts_no_more():
    """As if it stated no range, and was calibrated in its middle; a file keeps its range, whatever it is drawn at."""
    degrees = [15.0, 22.0, 27.5, 45.0]
    stated = {"environment.range": None, "environment.calibrated_at": 27.5}
    alone = [WARM.replace({**stated, "environment.temperature": t}) for t in degrees]
    expected = [float(QUANTITIES["u_z_mm"](Camera.of(one), 30.0)) for one in alone]
    swept = roslf.sweep(WARM, {"environment.temperature": degrees}, "u_z_mm", at=30.0).values["u_z_mm"]
    assert swept == pytest.approx(expected, rel=1e-9)
    assert len({f"{u:.3g}" for u in expected}) == 4
    results = [roslf.evaluate(WARM, temperature=t, at=30.0) for t in degrees]
    assert [one.answer.at[1].u_z_mm for one in results] == pytest.approx(expected, rel=1e-9)
    assert "depth, U, lengths as drawn, at 22 °C" in str(results[1])
    assert "depth, U, lengths as drawn, at" not in str(roslf.evaluate(WARM))
    assert WARM.at_room.environment.range == WARM.environment.range


def test_lines_without_a_number_say_why():
    budget = terms(depth_budget(Camera.of(PAPER)))
    assert budget["lengths as built"].u_mm is None
    assert "tolerances" in budget["lengths as built"].remark
    assert budget["temperature"].u_mm is None
    assert "environment.range" in budget["temperature"].remark
    fixed = terms(depth_budget(Camera.of(PAPER.replace({"depth.disparity_error": 0.1}))))
    assert fixed["view mismatch"].u_mm is None
    assert fixed["disparity error"].u_mm == pytest.approx(1.2491, rel=1e-3)


# --- laws ---------------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**31 - 1), st.integers(1, 4))
def test_calibrated_is_never_worse_than_built(seed, rank):
    rng = np.random.default_rng(seed)
    known = rng.normal(size=(rank, 4)) * 10.0 ** rng.uniform(-3, 6)
    information = known.T @ known
    after, calibration = BUILD.informed(information), CalibratedLengths(BUILD, LengthCovariance(PLACES, information))
    inverse = np.linalg.inv(np.linalg.inv(BUILD.matrix) + information)
    scale = np.outer(TOLERANCES, TOLERANCES)
    assert np.allclose(after.matrix / scale, inverse / scale, atol=1e-6)
    camera = Camera.of(PAPER)
    built, calibrated = (depth_budget(camera, build=BUILD, calibration=some) for some in (None, calibration))
    assert "lengths as built" not in terms(calibrated)
    assert float(calibrated.u_z_mm) <= float(built.u_z_mm) * (1 + 1e-9)


def test_what_a_calibration_does_not_see_keeps_its_own_term():
    seen = CalibratedLengths(LengthCovariance(PLACES[:2], np.diag([1e-4, 1e-4])))
    budget = terms(depth_budget(Camera.of(PAPER), build=BUILD, calibration=seen))
    rest = LengthCovariance(PLACES[2:], np.diag(TOLERANCES[2:] ** 2))
    assert budget["lengths as built"].u_mm == pytest.approx(float(lengths_error(Camera.of(PAPER), None, rest)))


CORRELATED = LengthCovariance(
    PLACES,
    np.outer(TOLERANCES, TOLERANCES)
    * np.array([[1, 0.3, 0.5, 0], [0.3, 1, -0.6, 0.2], [0.5, -0.6, 1, 0.1], [0, 0.2, 0.1, 1]]),
)


@pytest.mark.parametrize("known", [(), (0, 1, 2, 3), (1,), (0, 3), (2, 1)])
@pytest.mark.parametrize("at", [None, 150.0])
def test_depths_of_builds_that_are_believed_to_be_as_calibrated(known, at):
    """Builds drawn, some of their lengths measured, all others inferred from these, depth told by what is believed."""
    rng, count, nominal = np.random.default_rng(1), 20_000, np.array([PAPER.f, PAPER.d_1, PAPER.d_3, PAPER.d_2])
    true = nominal + rng.multivariate_normal(np.zeros(4), CORRELATED.matrix, count)
    measures, noise = rng.normal(size=(2, len(known))) / TOLERANCES[list(known)], np.eye(2)
    given_by = np.zeros((2, 4))
    given_by[:, list(known)] = measures
    gain = CORRELATED.matrix @ given_by.T @ np.linalg.inv(given_by @ CORRELATED.matrix @ given_by.T + noise)
    believed = nominal + ((true - nominal) @ given_by.T + rng.normal(size=(count, 2))) @ gain.T
    ahead = PAPER.d_f - PAPER.d_3 if at is None else at  # of the FAP of each build, its tip
    f, d_1, d_3, d_2 = true.T
    d_f = 1 / (1 / f - 1 / d_1)
    reach = d_1 * (d_f - d_3) / d_f
    rms = np.std(told(*believed.T, (d_1 / d_f - reach / ahead) * reach / d_2) - believed[:, 2] - ahead)
    some = tuple(PLACES[k] for k in known)
    calibration = (
        CalibratedLengths(CORRELATED.of(some), LengthCovariance(some, measures.T @ measures)) if known else None
    )
    budget = depth_budget(Camera.of(PAPER), at, build=CORRELATED, calibration=calibration)
    assert float(budget.of_kind("trueness")) == pytest.approx(rms, rel=0.02)  # of 20,000 draws, 0.5 %; bends
    assert ("lengths as built" in terms(budget)) == (len(known) < 4)


TIP_PLACES = ("elements.6.distance", "elements.5.distance", "microlens_array.distance", "main_lens.focal_length")


@pytest.mark.parametrize("at", [None, 8.0, 30.0])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_builds_tell_what_stands_ahead_of_their_own_tips_as_surely_as_the_budget_says(count, at):
    """Drawn: an object so far ahead of each build's window, its picture by that build, told by the camera as drawn."""
    design = WARM.replace({"environment": None})
    camera = Camera.of(design)
    assert float(camera.tip) == pytest.approx(design.elements[6].distance + design.elements[6].thickness)
    places, sigmas = TIP_PLACES[:count], np.array([0.05, 0.002, 0.005, 0.01])[:count]
    off = np.random.default_rng(5).normal(size=(count, 40_000)) * sigmas[:, None]
    builds = Camera.of(design, {place: camera[place] + row for place, row in zip(places, off, strict=True)})
    ahead = float(focus_ahead(camera)) if at is None else at
    slopes = epi_slope(builds, depth_at(builds, np.asarray(ahead)))
    found = depth_told(camera, slopes) - camera.tip - ahead
    budget = lengths_error(camera, at, LengthCovariance(places, np.diag(sigmas**2)))
    assert float(budget) == pytest.approx(np.sqrt((found**2).mean()), rel=0.03)  # of so many, 0.4 %; bends


def test_ends_of_what_a_calibration_can_know():
    camera, whole = Camera.of(PAPER), np.diag(TOLERANCES**-2.0)
    built = float(depth_budget(camera, build=CORRELATED).of_kind("trueness"))
    blind, perfect = (
        float(
            depth_budget(
                camera, build=CORRELATED, calibration=CalibratedLengths(CORRELATED, LengthCovariance(PLACES, F))
            ).of_kind("trueness")
        )
        for F in (0 * whole, 1e12 * whole)
    )
    assert blind == pytest.approx(built, rel=1e-9)
    assert perfect < 1e-5 * built
    exact = LengthCovariance(PLACES, np.zeros((4, 4)))
    for calibration in (None, CalibratedLengths(BUILD, LengthCovariance(PLACES, whole))):
        assert float(depth_budget(camera, build=exact, calibration=calibration).of_kind("trueness")) == 0.0


@given(st.integers(0, 2**31 - 1), st.sampled_from([(0,), (1, 2), (3, 0, 1)]), st.integers(0, 3))
def test_no_calibration_makes_a_camera_worse(seed, known, rank):
    """Of any covariance, perhaps of tied lengths, any information and any data sheet."""
    rng = np.random.default_rng(seed)
    mixing = rng.normal(size=(4, int(rng.integers(1, 5)))) * TOLERANCES[:, None]
    build, some = LengthCovariance(PLACES, mixing @ mixing.T), tuple(PLACES[k] for k in known)
    rows = rng.normal(size=(rank, len(known))) * 10.0 ** rng.uniform(-3, 6)
    sheet = TOLERANCES[list(known)] * 10.0 ** rng.uniform(-3, 1, len(known))
    calibration = CalibratedLengths(build.of(some), LengthCovariance(some, rows.T @ rows), sheet)
    camera = Camera.of(PAPER)
    built, calibrated = (depth_budget(camera, build=build, calibration=one) for one in (None, calibration))
    assert float(calibrated.u_z_mm) <= float(built.u_z_mm) * (1 + 1e-6)
    after, left = calibration.after(build)
    assert set(after.places) == set(PLACES)
    back = after.plus(left).of(PLACES).matrix
    assert np.linalg.eigvalsh((build.matrix - back) / np.outer(TOLERANCES, TOLERANCES)).min() > -1e-6
    exact = [place for place, s, t in zip(some, sheet, TOLERANCES[list(known)], strict=True) if s < 1e-2 * t]
    assert all(after.of((place,)).matrix[0, 0] <= (1e-2 * t) ** 2 for place, t in zip(PLACES, TOLERANCES, strict=True)
               if place in exact)  # fmt: skip


def test_a_plan_is_no_measurement():
    for planned, kind in ((True, "B"), (False, "A")):
        calibration = CalibratedLengths(BUILD, LengthCovariance(PLACES, np.zeros((4, 4))), planned=planned)
        assert terms(depth_budget(Camera.of(PAPER), calibration=calibration))["lengths as calibrated"].type == kind


@DEAR
@given(st.floats(0, 0.3), st.floats(0, 0.1), st.floats(0, 100), st.floats(0, 0.4))
def test_squares_add_up_and_nothing_makes_depth_better(mismatch, prnu, dsnu, veil):
    changes = {"depth.view_mismatch": mismatch, "sensor.prnu": prnu, "sensor.dsnu": dsnu, "light.veil": veil}
    camera = Camera.of(WARM.replace(changes))
    budget = depth_budget(camera)
    parts = [float(term.u_mm) for term in budget.terms if term.u_mm is not None]
    assert float(budget.u_z_mm) == pytest.approx(float(np.linalg.norm(parts)))
    assert float(QUANTITIES["u_z_mm"](camera)) == pytest.approx(float(budget.u_z_mm), rel=1e-9)
    assert float(budget.u_z_mm) >= float(QUANTITIES["sigma_z_mm"](camera))
    kinds = [float(budget.of_kind(kind)) for kind in ("precision", "trueness")]
    assert float(budget.u_z_mm) == pytest.approx(float(np.hypot(*kinds)))
    assert float(budget.expanded_mm) == 2 * float(budget.u_z_mm)


def test_builds_and_distances_lead():
    camera = Camera.of(WARM, {"aperture.distance": WARM.d_3 * np.linspace(0.99, 1.01, 3)})
    build = LengthCovariance(("microlens_array.distance",), np.array([[0.01**2]]))
    budget = depth_budget(camera, build=build)
    assert budget.u_z_mm.shape == (3,)
    for k in range(3):
        assert budget.u_z_mm[k] == pytest.approx(float(depth_budget(camera.build(k), build=build).u_z_mm), rel=1e-6)


def test_many_distances_at_once_are_each_its_own():
    """As many distances as the covariance takes steps, too, which must not be taken for each other."""
    camera = Camera.of(WARM)
    for at in np.array([200.0, 231.0, 260.0]), np.linspace(200.0, 260.0, 2 * len(PLACES)):
        budget = depth_budget(camera, at, build=CORRELATED)
        alone = [float(depth_budget(camera, one, build=CORRELATED).u_z_mm) for one in at.tolist()]
        assert budget.u_z_mm == pytest.approx(alone, rel=1e-6)


def test_many_builds_that_are_all_alike_have_one_bound():
    camera = Camera.of(PAPER, {"aperture.distance": np.full(300, PAPER.d_3)})
    one = float(QUANTITIES["sigma_z_mm"](Camera.of(PAPER)))
    assert QUANTITIES["sigma_z_mm"](camera) == pytest.approx(np.full(300, one), rel=1e-6)


def test_fields_have_theirs_too():
    camera = Camera.of(PAPER)
    images = MicrolensImages(camera, [(0.0, 0.0), (11.0, 7.0)])
    ours = QUANTITIES["u_z_at_field_mm"].at_fields(images)[:, 0]
    assert ours[0] == pytest.approx(float(QUANTITIES["u_z_mm"](camera)), rel=1e-4)
    assert ours[1] > ours[0]


def test_what_evaluate_prints_and_writes():
    result = roslf.evaluate(PAPER, build=BUILD)
    expected = result.to_dict()["depth"]["expected"]
    assert expected["k"] == 2
    assert expected["u_z_mm"] == pytest.approx(np.linalg.norm([t["u_mm"] or 0 for t in expected["terms"]]))
    assert {t["kind"] for t in expected["terms"]} == {"precision", "trueness"}
    assert all(t["type"] in ("A", "B") for t in expected["terms"])
    assert f"largest: {result.depth_budget.largest.name}" in " ".join(result.everything.split())


@pytest.mark.parametrize(("place", "value"), [
    ("depth.view_mismatch", -0.1), ("depth.view_mismatch", 1.5), ("sensor.prnu", 2.0), ("sensor.dsnu", -1.0),
    ("light.veil", 1.0)])  # fmt: skip
def test_values_that_cannot_be(place, value):
    with pytest.raises(roslf.DesignError, match=place.replace(".", r"\.")):
        PAPER.replace({place: value})


def test_temperature_of_a_camera_of_no_material_is_unknown_not_none():
    """Where nothing grows by the file, its range says nothing of depth; at one temperature nothing is due."""
    plain = PAPER.replace({"environment": {"range": ["15 degC", "37 degC"]}})
    for at in (None, 10.0, 100.0):  # where pixels alone grow
        budget = depth_budget(Camera.of(plain), at)
        assert terms(budget)["temperature"].u_mm is None
        assert (
            "temperature: nothing says how the housing, the main lens and the microlenses would grow" in budget.left_out
        )
        # One rounding apart on some processors: a number is a scalar here, an array of one there.
        assert float(QUANTITIES["u_z_mm"](Camera.of(plain), at)) == pytest.approx(float(budget.u_z_mm), rel=4e-16)
    named = plain.replace({"environment.housing": "316L"})
    assert float(terms(depth_budget(Camera.of(named)))["temperature"].u_mm) > 0
    still = PAPER.replace({"environment": {"calibrated_at": "20 degC"}})
    assert float(terms(depth_budget(Camera.of(still)))["temperature"].u_mm) == 0


def test_noise_of_full_pixels_is_called_so():
    full = PAPER.replace({"light.exposure": "1 s"})
    noise = terms(depth_budget(Camera.of(full)))["shot and read noise"]
    assert (noise.u_mm, noise.remark) == (np.inf, "the bound; pixels are full")


@pytest.mark.parametrize("at", [None, 100.0])
def test_u_as_large_as_the_distance_is_no_depth(at):
    camera = Camera.of(roslf.load("paper"))
    ahead = float(focus_ahead(camera)) if at is None else at
    sigma = float(
        depth_budget(camera, at, build=_of_d_1(1.0)).terms[-2].u_mm
    )  # per mm of d_1, beside which all is small
    for share, told in ((0.9, True), (1.1, False)):
        budget = depth_budget(camera, at, build=_of_d_1(share * ahead / (2 * sigma)))
        assert (" mm" in budget.expanded_words()) == told
        assert ("no depth there" in budget.words) != told


def _of_d_1(sigma):
    return LengthCovariance(("microlens_array.distance",), np.array([[sigma**2]]))


def test_a_texture_too_fine_for_views_is_told_and_ends_the_working_range():
    """What is 2.3 microlenses a period in focus has 2 at 35 mm, and aliases beyond, where views are sharp."""
    scope = roslf.load("rigid-scope").replace(d_f=30.0)
    sample = float(QUANTITIES["object_sample_mm"](Camera.of(scope)))
    camera = Camera.of(scope.replace({"depth.finest": 2.3 * sample}))
    near, beyond, far = (depth_budget(camera, at) for at in (25.0, 36.0, 60.0))
    assert near.caution == ""
    assert near.cause == "view mismatch"
    assert "1.9 microlenses a period there, and aliases" in beyond.caution
    assert 2 * near.u_z_mm < beyond.u_z_mm < np.inf
    assert np.isinf(far.u_z_mm)
    assert far.cause == "the texture aliases"
    assert "views disagree" in far.largest.remark
    within, free = (WorkingRange.of(Camera.of(one)) for one in (scope.replace({"depth.finest": 2.3 * sample}), scope))
    assert 34 < within.useful_to < 60 < free.useful_to
    coarse = Camera.of(scope.replace({"depth.finest": 1.4 * sample}))  # aliases in focus, and is known nearer
    assert np.isinf(depth_budget(coarse).u_z_mm)
    assert WorkingRange.of(coarse).useful_to < 27


def test_far_out_of_focus_depth_is_told_with_a_doubt():
    """Views are sharp from 199 to 272 mm; that is where they are blurred over a pitch."""
    camera = Camera.of(PAPER)
    near, far = (float(QUANTITIES[f"view_depth_of_field_{end}_mm"](camera)) for end in ("near", "far"))
    for end in (near, far):
        assert float(view_blur(camera, seen_at(camera, end).disparity)) == pytest.approx(1.0, rel=1e-9)
        assert depth_budget(camera, end).caution == ""
    assert "blurred over 2 pitches there" in depth_budget(camera, 176.0).caution
    assert "up to five times" in depth_budget(camera, 160.0).caution
