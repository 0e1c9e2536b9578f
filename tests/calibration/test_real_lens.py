"""Calibrations behind real lenses, of corners that exact rays make, and how far from a design a good camera lies."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.bore.main_lens import IdealMainLens, RealMainLens
from roslf_design.calibration import (
    Board,
    CalibrationError,
    Captures,
    Corrected,
    DiffractionCheck,
    calibrate,
    camera_of,
    derived,
    laplace_draws,
    random_poses,
    sheet_of,
    synthetic_observations,
    with_distortion,
)
from roslf_design.calibration.aberrations import aberration_error
from roslf_design.calibration.fit import _better_mirrored, _refine
from roslf_design.calibration.misfit import misfit_of
from roslf_design.calibration.model import QUANTITIES, Observations, Poses, project_boards
from roslf_design.calibration.options import PlanOptions, calibration_plan
from roslf_design.calibration.planning import pupil_of
from roslf_design.calibration.result import _built_sigma, _pulled
from roslf_design.calibration.sidedata import combine
from roslf_design.design import load
from roslf_design.lenses.lens_file import load_lens
from roslf_design.reporting.calibrate.pages import plan_blocks
from tests.calibration.made import CAMERA, SHEET, captured, traced_corners

CAPTURES = Captures(boards=8, views=3, board=Board(4, 5, 5.0), offset=6.0)
NAMES = ("A", "m", "inverse_d_2")
LENSES = {"singlet": {}, "achromat": {"main_lens.prescription": "AC508-100-A", "main_lens.reversed": False}}
SINGLET = load("paper-singlet")


@functools.cache
def behind(lens):
    """The paper's bench behind a lens, and its corners without noise."""
    design = SINGLET.replace(LENSES[lens])
    return design, traced_corners(design, CAPTURES, 0)


def noisy(corners, seed=0, noise=0.06):
    return replace(corners, uv=corners.uv + noise * np.random.default_rng(seed).normal(size=corners.uv.shape))


@pytest.mark.parametrize("lens", LENSES)
def test_m_and_d_2_of_the_principal_planes_come_back(lens):
    """Without the field's curvature m comes out 1 to 4 % too large; d_1/d_f is what focuses on the axis."""
    design, corners = behind(lens)
    sheet, true = sheet_of(design), camera_of(design)
    assert true.m == pytest.approx(design.d_1 / design.d_f, rel=1e-12)
    found = calibrate(noisy(corners, noise=0.003), sheet, distortion=1)
    fit, error = found.fit, aberration_error(found, sheet, design, 1)
    off = (fit.camera.vector(NAMES) - true.vector(NAMES)) / true.vector(NAMES)
    assert (np.abs(off) < (0.01, 0.004, 0.01)).all()
    # Taken by the design's own rays, what the model leaves is told.
    spread = np.sqrt(np.diag(fit.covariance.part(NAMES)) + np.square(error[0])) / true.vector(NAMES)
    assert (np.abs(off) < 2.5 * spread).all()
    assert np.abs(off[1] - error[0, 1] / true.m) < 0.001
    # Lagrange's invariant ties the growth of the baseline to distortion: 2 k_1 + 1 - (A/L)^2.
    reach = (true.A / design.f - 1) / true.m
    assert fit.camera.b_1 == pytest.approx(2 * fit.camera.k_1 + 1 - reach**2, abs=2.5)
    assert max(fit.scales) < 2


def test_intervals_behind_a_real_lens_hold_the_truth():
    design, corners = behind("singlet")  # of both the one whose field curves more
    true, ideal = camera_of(design), sheet_of(design)
    truth = {"A": true.A, "m": true.m, "d_2": design.d_2, "d_1": design.d_1, "d_3": design.d_3, "d_f": design.d_f}
    held = {68: 0, 95: 0}
    for seed in range(8):
        rng = np.random.default_rng([seed, 5])
        f, _, d, cell = (float(value[0]) for value in ideal.draws(1, rng))
        sheet = replace(ideal, f=f, d=d)
        observed = replace(noisy(corners, seed), points=corners.points * cell)
        found = calibrate(observed, sheet, distortion=1)
        if seed == 0:
            error = aberration_error(found, sheet, design, 1)
        draws = laplace_draws(found.fit._replace(systematic=error), sheet, 4000, rng).quantities
        for name, value in truth.items():
            for level in held:
                low, high = np.quantile(draws[name], [0.5 - level / 200, 0.5 + level / 200])
                held[level] += int(low < value < high)
    # Of 48, of which those of f and those of the images go together: 16 independent ones, 99 of 100 times.
    assert held[68] >= 18
    assert held[95] >= 39


def fitted(observations, sheet):
    check = DiffractionCheck(False, "", 0.0)
    tries = []

    def fit(count):
        tries.append(count)
        return Corrected(calibrate(observations, sheet, distortion=count), check)

    return fit, lambda found: calibrate(found.calibration.observations, sheet), tries


def test_a_prescription_asks_for_distortion():
    design, corners = behind("achromat")
    fit, plain, tries = fitted(noisy(corners), sheet_of(design))
    (found, _), bent = with_distortion(fit, plain, RealMainLens(load_lens("AC508-100-A")), None)
    assert tries == [1]
    assert (bent.coefficients, bent.automatic) == (1, True)
    assert "main lens is real (AC508-100-A)" in bent.reason
    assert bent.without is None or bent.without.scale > 2
    assert misfit_of(found).scale < 2


def test_residuals_ask_for_distortion_and_an_ideal_lens_does_not():
    straight = captured(Captures(boards=8, views=3, noise=0.02, offset=15.0), 3)
    camera = replace(CAMERA, k_1=1.0, c_1=2.0, b_1=2.0)
    bent = captured(Captures(boards=8, views=3, noise=0.02, offset=15.0), 3, camera=camera)
    fit, plain, tries = fitted(bent, SHEET)
    (found, _), said = with_distortion(fit, plain, IdealMainLens(), None)
    assert tries == [0, 1]
    assert said.coefficients == 1
    assert said.reason == "as residuals ask for it"
    assert said.without.scale > 3
    assert misfit_of(found).scale < 1.3
    fit, plain, tries = fitted(straight, SHEET)
    assert with_distortion(fit, plain, IdealMainLens(), None)[1].coefficients == 0
    assert tries == [0]
    for asked in (0, 1):  # what is asked for is obeyed, whatever residuals say
        fit, plain, tries = fitted(bent, SHEET)
        said = with_distortion(fit, plain, RealMainLens(load_lens("LA1050-A")), asked)[1]
        assert (said.coefficients, said.automatic, tries) == (asked, False, [asked])


def test_boards_that_are_parallel_stay_refused():
    fit, plain, tries = fitted(captured(Captures(tilt=0.0, boards=4), 1), SHEET)
    with pytest.raises(CalibrationError, match="all parallel"):
        with_distortion(fit, plain, IdealMainLens(), None)
    assert tries == [0, 1]


def test_a_board_tilted_the_other_way_is_turned_back():
    captures = replace(CAPTURES, noise=0.01)
    poses = random_poses(captures, 120.0, np.random.default_rng(2))
    uv = project_boards(CAMERA.vector(), poses.vector, captures.board.points, np.zeros((1, 2))).values
    view = Observations(captures.board.points, np.zeros((1, 2)), uv)
    wrong = poses.rotation.copy()
    wrong[3, :2] *= -1
    stuck = _refine(view, CAMERA, Poses(wrong, poses.translation), ("A",))
    turned = _better_mirrored(view, stuck)
    assert turned is not None
    again = _refine(view, stuck.camera, turned, ("A",))
    np.testing.assert_allclose(again.poses.rotation, poses.rotation, atol=1e-6)
    assert pytest.approx(CAMERA.A, rel=1e-6) == again.camera.A
    assert _better_mirrored(view, again) is None


def test_plans_behind_a_real_lens_count_what_distortion_costs():
    asked = PlanOptions(board="4x5 5 mm")
    plan, without = (calibration_plan(SINGLET, asked, count) for count in (None, 0))
    assert (plan.distortion, without.distortion) == (1, 0)
    assert plan.to_dict("x", 0)["distortion_coefficients"] == 1
    for name in ("m", "d_2"):
        assert plan.expected.sigma[name] > without.expected.sigma[name]
    assert "Distortion is fitted (1 radial coefficient" in plan_blocks(SINGLET, plan, asked)[0].text
    assert calibration_plan(load("paper"), PlanOptions()).distortion == 0


# --- how far from the design ------------------------------------------------------------------------------------------


def built_off(design, sheet, f, seed, d_1=None):
    """Estimates of a camera with another focal length, less the design's, in the deviations that are told."""
    d_1, rng = design.d_1 if d_1 is None else d_1, np.random.default_rng(seed)
    # The thin lens by hand: m = d_1/f - 1, A = f + m (f - d_3).
    m = d_1 / f - 1
    camera = replace(camera_of(design), A=f + m * (f - design.d_3), m=m)
    captures = Captures(boards=8, views=3, noise=0.02)
    observations = synthetic_observations(camera, random_poses(captures, pupil_of(design), rng), captures, rng)
    fit = calibrate(observations, sheet).fit
    known = combine(fit, sheet, ())
    found, designed = known.lengths(sheet), derived(camera_of(design).vector(), sheet)
    pulled, draws = _pulled(design, sheet, known), laplace_draws(fit, replace(sheet, f_sigma=0.0), 4000, rng).quantities
    sigma = {name: _built_sigma(float(draws[name].std()), 0.0, float(pulled[name])) for name in QUANTITIES}
    return {name: float(found[name] - designed[name]) / sigma[name] for name in QUANTITIES}


def test_cameras_built_as_designed_lie_near_the_design():
    """Their focal lengths are as far off the data sheet's as that says: m by 7 deviations of its estimate."""
    paper = load("paper")
    sheet = sheet_of(paper)
    rng = np.random.default_rng(1)
    off = [built_off(paper, sheet, paper.f + sheet.f_sigma * rng.normal(), seed) for seed in range(12)]
    for name in off[0]:
        values = np.array([one[name] for one in off])
        assert np.abs(values).max() < 4
        assert 0.4 < np.sqrt(np.mean(np.square(values))) < 1.6  # chi over 12: 0.5 to 1.5 in 99 of 100
    # Of m alone: (1 + m) 1 %.
    assert _pulled(paper, sheet, combine(calibrate(captured(CAPTURES), sheet).fit, sheet, ()))["m"] == pytest.approx(
        -1.4 * 0.01, rel=1e-3
    )


def test_another_camera_is_still_told_from_the_design():
    paper = load("paper")
    sheet = sheet_of(paper)
    other_lens = built_off(paper, sheet, 1.06 * paper.f, 0)
    assert abs(other_lens["m"]) > 4
    longer = built_off(paper, sheet, paper.f, 0, d_1=1.1 * paper.d_1)
    assert abs(longer["m"]) > 4
    assert abs(longer["d_1"]) > 4
