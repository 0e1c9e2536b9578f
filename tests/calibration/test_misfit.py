"""What a fit leaves over is seen, blamed on what was done to the corners, and does not pull the camera."""

from dataclasses import replace

import numpy as np
import pytest

from roslf_design.calibration import Captures, Observations, calibrate, random_poses
from roslf_design.calibration.misfit import misfit_of
from roslf_design.calibration.model import project_boards
from tests.calibration.made import CAMERA, SHEET, captured

CAPTURES = Captures(boards=8, noise=0.02, offset=15.0)


@pytest.fixture(scope="module")
def clean():
    return captured(CAPTURES, 3)


def far_off(way, found):
    """A of one way less the truth, in the fit's standard deviations."""
    return abs(way.camera.A - CAMERA.A) / found.fit.covariance.sigma["A"]


def test_corners_that_only_scatter_are_a_good_fit(clean):
    misfit = misfit_of(calibrate(clean, SHEET))
    assert misfit.places == pytest.approx(1.0, abs=0.15)
    assert misfit.slopes == pytest.approx(1.0, abs=0.25)
    assert misfit.views == pytest.approx(1.0, abs=0.15)
    assert list(misfit.warnings) == []
    # Each board's RMS is that of 60 corners in 13 views: 0.02 per coordinate.
    for board in misfit.boards:
        assert board.rms == pytest.approx(0.02 * np.sqrt(2), rel=0.12)
        assert (board.corners, board.strays) == (12, 0)


def test_distortion_that_nobody_asked_for_is_named():
    bent = captured(CAPTURES, 3, camera=replace(CAMERA, k_1=1.0))
    misfit = misfit_of(calibrate(bent, SHEET))
    assert misfit.scale > 3.3
    (said,) = misfit.warnings
    assert "distortion = 1" in said
    assert misfit_of(calibrate(bent, SHEET, distortion=1)).scale < 1.3


def test_a_bowed_board_is_named_with_its_bow():
    poses = random_poses(CAPTURES, 120.0, np.random.default_rng(3))
    points = CAPTURES.board.points.copy()
    points[:, 2] = 0.3 * (points[:, 0] / points[:, 0].max()) ** 2  # 0.3 mm from the middle to both sides
    uv = project_boards(CAMERA.vector(), poses.vector, points, CAPTURES.view_grid()).values
    uv = uv + 0.02 * np.random.default_rng(4).normal(size=uv.shape)
    misfit = misfit_of(calibrate(Observations(CAPTURES.board.points, CAPTURES.view_grid(), uv), SHEET))
    assert misfit.scale > 10
    assert "bowed by 0.3 mm" in next(misfit.warnings)


def test_the_image_that_does_not_fit_is_named(clean):
    uv = clean.uv.copy()
    uv[3] += np.random.default_rng(1).normal(0, 0.2, uv[3, :1].shape)  # the same in all its views
    names = tuple(f"image{k}.tif" for k in range(8))
    found = calibrate(replace(clean, uv=uv, names=names), SHEET)
    misfit = misfit_of(found)
    assert misfit.scale > 2
    said = list(misfit.warnings)
    assert "dropping image3.tif" in said[0]
    assert "in image3.tif" in said[1]
    worst = max(misfit.boards, key=lambda board: board.places)
    assert worst.name == "image3.tif"
    assert worst.places > 10


def test_one_wrong_corner_does_not_pull_the_camera(clean):
    uv = clean.uv.copy()
    uv[3, :, 5] += (0.8, -0.5)
    found = calibrate(replace(clean, uv=uv), SHEET)
    assert far_off(found.joint, found) > 10  # plain least squares
    assert far_off(found.fit, found) < 2
    assert found.fit.covariance.sigma["A"] < 1.3 * calibrate(clean, SHEET).fit.covariance.sigma["A"]
    misfit = misfit_of(found)
    assert misfit.scale < 1.5
    assert [board.strays for board in misfit.boards] == [0, 0, 0, 1, 0, 0, 0, 0]


def test_what_sampling_leaves_of_corners_is_no_misfit(clean):
    """Views that sample once a microlens put corners of an ideal board off by a hundredth of it, all of them alike."""
    misfit = replace(misfit_of(calibrate(clean, SHEET)), places=4.8)

    def off(rms, **scales):
        boards = tuple(board._replace(rms=rms) for board in misfit.boards)
        return list(replace(misfit, boards=boards, **scales).warnings)

    assert off(0.008) == []
    assert "4.8 times" in off(0.02)[0]
    assert "5.2 times" in off(0.008, slopes=5.2)[0]


def test_two_steps_far_from_the_joint_fit_are_told_with_which_to_believe(clean):
    found = calibrate(clean, SHEET)
    sigma = found.fit.covariance.sigma["A"]
    other = found.second._replace(camera=replace(found.second.camera, A=found.fit.camera.A + 5 * sigma))
    misfit = misfit_of(replace(found, second=other))
    assert misfit.apart["A"] == pytest.approx(5.0)
    (said,) = misfit.warnings
    assert "A by 5.0 sigma" in said
    assert "believe the joint fit" in said
    assert "of step one" in list(replace(misfit, slopes=2.5).warnings)[1]
    assert "believe neither" in list(replace(misfit, places=2.5).warnings)[1]


def test_views_that_are_off_as_wholes_are_told(clean):
    """As a correction that knows a view's place to half a pixel leaves them: no corner says so, all together do."""
    rng = np.random.default_rng(2)
    uv = clean.uv + 0.03 * rng.normal(size=(8, clean.uv.shape[1], 1, 2))
    misfit = misfit_of(calibrate(replace(clean, uv=uv), SHEET))
    assert misfit.scale < 2
    assert misfit.views > 2
    assert "the corners of a view lie off together" in next(misfit.warnings)
