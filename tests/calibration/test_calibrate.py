"""Step one, step two and the joint fit on corners whose camera is known."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.calibration.calibrate import calibrate, corner_statistics, fit_statistics
from roslf_design.calibration.datasheet import DataSheet, derived
from roslf_design.calibration.frames import CalibrationError
from roslf_design.calibration.model import Board, Intrinsics, Observations
from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations
from roslf_design.calibration.steps import Linear, covariance_of, refine
from roslf_design.theory import back_substitute

CAMERA = Intrinsics(92.0, 0.4, 0.5, 182.0, 118.0, q=0.004847826, d=0.063)
SHEET = DataSheet(100.0, CAMERA.q, CAMERA.d, 1.0)
NAMES = ("A", "m", "inverse_d_2", "x_0", "y_0")


def captured(captures, seed=0, camera=CAMERA):
    rng = np.random.default_rng(seed)
    return synthetic_observations(camera, random_poses(captures, 120.0, rng), captures, rng)


def sigmas_off(camera, covariance):
    return (camera.vector(covariance.names) - CAMERA.vector(covariance.names)) / np.sqrt(np.diag(covariance.matrix))


@pytest.mark.parametrize("distortion", [0, 2])
def test_exact_corners_give_the_camera_back(distortion):
    camera = CAMERA if distortion == 0 else replace(CAMERA, k_1=0.5, k_2=-8.0)
    found = calibrate(
        captured(Captures(noise=1e-10, boards=6, offset=15.0), camera=camera), SHEET, distortion=distortion
    )
    np.testing.assert_allclose(found.joint.camera.vector(), camera.vector(), rtol=1e-6, atol=1e-6)
    assert found.refined.pupil_distance == pytest.approx(120.0, abs=1e-6)
    assert found.refined.aperture_constant == pytest.approx(140 / 92, rel=1e-8)
    # Distortion is not in the steps' straight lines: second order in the baseline, 1e-3 px.
    assert found.stepwise.pupil_distance == pytest.approx(120.0, abs=1e-6 if distortion == 0 else 0.5)
    assert found.joint.rms < 1e-9


def test_joint_fit_is_at_the_noise_and_its_errors_are_honest():
    off, ratio = [], []
    for seed in range(12):
        found = calibrate(captured(Captures(boards=8, views=3), seed), SHEET)
        off.append(sigmas_off(found.joint.camera, found.joint.covariance))
        ratio.append(found.joint.sigma / 0.06)
        assert found.joint.rms == pytest.approx(0.06 * math.sqrt(2), rel=0.1)
        assert found.first.rms < found.joint.rms  # the central view of the lines is averaged over the views
        steps = sigmas_off(found.second.camera, found.joint.covariance)
        assert np.abs(steps - off[-1]).max() < 1.5  # both ways agree to within their errors
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=0.45)  # chi^2 with 60 degrees of freedom: 2.5 sigma
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)


def test_fit_on_statistics_is_the_joint_fit():
    observations = captured(Captures(boards=8))
    found = calibrate(observations, SHEET)
    plain = fit_statistics(
        corner_statistics(observations, found.joint.sigma), found.joint.camera, found.joint.poses, NAMES, scale=False
    )
    difference = plain.camera.vector(NAMES) - found.joint.camera.vector(NAMES)
    assert np.abs(difference / np.sqrt(np.diag(found.joint.covariance.matrix))).max() < 1e-4
    np.testing.assert_allclose(plain.covariance.matrix, found.joint.covariance.matrix, rtol=1e-6)
    assert found.fit.place_scale == pytest.approx(1.0, abs=0.15)
    assert found.fit.slope_scale == pytest.approx(1.0, abs=0.3)


def test_errors_common_to_all_views_widen_the_errors():
    observations = captured(Captures(boards=8))
    shared = np.random.default_rng(9).normal(0, 0.06, observations.uv[:, :1].shape)  # a corner off in every view alike
    found = calibrate(replace(observations, uv=observations.uv + shared), SHEET)
    assert found.fit.place_scale == pytest.approx(math.sqrt(1 + 13), rel=0.15)  # 13 views no longer average it away
    assert found.fit.covariance.sigma["A"] > 2.5 * found.joint.covariance.sigma["A"]


def test_reduced_information_is_the_inverse_of_the_whole_covariance_s_block():
    rng = np.random.default_rng(0)
    shared, own = rng.normal(size=(3, 40, 5)), rng.normal(size=(3, 40, 6)) * 10.0 ** rng.integers(-3, 4, 6)
    whole = np.zeros((3, 40, 5 + 18))
    whole[..., :5] = shared
    for b in range(3):
        whole[b, :, 5 + 6 * b : 11 + 6 * b] = own[b]
    flat = whole.reshape(120, -1)
    block = np.linalg.inv(flat.T @ flat)[:5, :5]
    np.testing.assert_allclose(np.linalg.inv(Linear(np.zeros((3, 40)), shared, own).information()), block, rtol=1e-6)


def test_missing_corners_and_views_are_left_out():
    observations = captured(Captures(boards=8))
    rng = np.random.default_rng(4)
    uv = observations.uv.copy()
    uv[rng.uniform(size=uv.shape[:3]) < 0.2] = np.nan
    uv[2, 5:] = np.nan
    found = calibrate(replace(observations, uv=uv), SHEET)
    assert np.abs(sigmas_off(found.joint.camera, found.joint.covariance)).max() < 3.5
    assert np.isnan(found.joint.residuals[2, 5:]).all()
    plain = fit_statistics(
        corner_statistics(found.observations, found.joint.sigma),
        found.joint.camera,
        found.joint.poses,
        NAMES,
        scale=False,
    )
    difference = plain.camera.vector(NAMES) - found.joint.camera.vector(NAMES)
    assert np.abs(difference / np.sqrt(np.diag(found.joint.covariance.matrix))).max() < 1e-3


def test_table_2_of_the_paper_with_its_spread():
    lengths = back_substitute(100.0, 91.09, 0.42)
    np.testing.assert_allclose(lengths[:4], (142.00, 338.10, 1.56, 121.21), atol=0.005)
    printed = derived(np.array([91.09, 0.42, 0.5]), SHEET, np.asarray(100.0))
    assert printed["d_3"] == lengths.pupil_distance
    corners = [
        derived(np.array([91.09 + a, 0.42 + m, 0.5]), SHEET, np.asarray(100.0 + f))["d_3"]
        for a, m, f in itertools.product((-0.005, 0.005), (-0.005, 0.005), (-1.0, 1.0))
    ]
    rounding = [
        derived(np.array([91.09 + a, 0.42 + m, 0.5]), SHEET, np.asarray(100.0))["d_3"]
        for a, m in itertools.product((-0.005, 0.005), repeat=2)
    ]
    assert np.ptp(rounding) / 2 == pytest.approx(0.265, abs=0.005)  # by digits alone
    assert np.ptp(corners) / 2 == pytest.approx(3.4 + 0.26, abs=0.05)  # 1 % of f: 3.4 mm more


def test_boards_that_do_not_determine_the_camera_are_refused_by_name():
    with pytest.raises(CalibrationError, match=r"A, x_0 and y_0 .* not determined: the boards are all parallel"):
        calibrate(captured(Captures(tilt=0.0)), SHEET)
    one_way = captured(Captures(tilt=0.0, boards=4))
    with pytest.raises(CalibrationError, match="all parallel"):
        calibrate(one_way, SHEET, guess=92.0)
    with pytest.raises(CalibrationError, match="one image of the board"):
        calibrate(captured(Captures(boards=1)), SHEET)
    with pytest.raises(CalibrationError, match="one view only"):
        calibrate(captured(Captures(views=1)), SHEET)
    with pytest.raises(CalibrationError, match="not determined to 30 %: the boards stand at one depth"):
        calibrate(captured(Captures(distance_range=0.0, tilt=math.radians(6), noise=0.4, boards=6), 3), SHEET)


def test_slopes_that_rise_with_inverse_depth_are_mirrored_views():
    observations = captured(Captures(boards=6))
    with pytest.raises(CalibrationError, match="views are mirrored"):
        calibrate(replace(observations, views=-observations.views), SHEET)


def test_rank_loss_names_the_parameter():
    with pytest.raises(CalibrationError, match="do not determine x_0"):
        covariance_of(np.diag([1.0, 1.0, 1.0, 0.0, 1.0]), NAMES)
    information = np.eye(5)
    information[1:3, 1:3] = 1.0
    with pytest.raises(CalibrationError, match="do not determine m, d_2: rank loss"):
        covariance_of(information, NAMES)


def test_too_few_corners_are_refused():
    observations = captured(Captures(boards=3))
    uv = observations.uv.copy()
    uv[1, :, 3:] = np.nan
    with pytest.raises(CalibrationError, match="fewer than four corners were seen of board 2"):
        calibrate(replace(observations, uv=uv), SHEET)
    uv[1] = np.nan
    with pytest.raises(CalibrationError, match="no corner was seen of board 2"):
        calibrate(replace(observations, uv=uv), SHEET)
    few = Observations(observations.points[:4], observations.views[:1], observations.uv[:2, :1, :4])
    with pytest.raises(CalibrationError, match="cannot determine"):
        refine(few, CAMERA, _poses(2))
    with pytest.raises(ValueError, match="0, 1 or 2 radial"):
        calibrate(observations, SHEET, distortion=3)


def _poses(boards):
    return random_poses(Captures(boards=boards), 120.0, np.random.default_rng(0))


def test_boards_are_read_and_checked():
    assert Board.parse("4x5 6 mm") == Board(4, 5, 6.0)
    assert Board.parse(" 20 x 23  400 um ") == Board(20, 23, 0.4)
    assert Board(4, 5, 6.0).inner == (3, 4)
    points = Board(4, 5, 6.0).points
    assert points.shape == (12, 3)
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(points[1] - points[0], (6, 0, 0))
    for text in ("4x5", "four by five", "4x5 6", "4x5 6 furlongs"):
        with pytest.raises(CalibrationError, match="write cells and their size"):
            Board.parse(text)
    with pytest.raises(CalibrationError, match="too few inner corners"):
        Board.parse("2x5 6 mm")
    with pytest.raises(CalibrationError, match="positive"):
        Board(4, 5, 0.0)
