"""What scatter does not show: views that disagree, microlenses beyond the undistorted field, Laplace's draws."""

import math
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.calibration.calibrate import calibrate
from roslf_design.calibration.datasheet import DataSheet, laplace_draws, variance_shares
from roslf_design.calibration.diffraction import view_disagreement
from roslf_design.calibration.model import Intrinsics
from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations
from roslf_design.calibration.result import undistorted_radius
from roslf_design.design import load
from roslf_design.design.parts import Stop

CAMERA = Intrinsics(92.0, 0.4, 0.5, 182.0, 118.0, q=0.004847826, d=0.063)
SHEET = DataSheet(100.0, CAMERA.q, CAMERA.d, 0.1)
CAPTURES = Captures(boards=8, views=5, noise=0.01)


def observed(seed=0):
    rng = np.random.default_rng(seed)
    return synthetic_observations(CAMERA, random_poses(CAPTURES, 120.0, rng), CAPTURES, rng)


def test_views_that_look_from_further_inside_are_seen_to_disagree():
    clean = observed()
    found = calibrate(clean, SHEET)
    sigma = found.fit.covariance.sigma["inverse_d_2"]
    agreed = view_disagreement(clean, found, SHEET)
    assert agreed.shape == (1, 3)
    assert abs(agreed[0, 2]) < 2.5 * sigma  # by chance more than once in a hundred, but the seed is fixed
    # The outermost views see what those 4 % further inside do: slopes of 3.54 (m - A/Z) pitches a pixel.
    outer = np.hypot(*clean.views.T) > 0.8 * 5
    lines = np.einsum("bvni,vi->bn", clean.uv - clean.uv.mean(axis=1, keepdims=True), clean.views)
    slope = lines / np.square(clean.views).sum()
    pulled = np.where(outer[:, None], -0.04 * clean.views, 0.0)
    uv = clean.uv + slope[:, None, :, None] * pulled[None, :, None, :]
    spoilt = replace(clean, uv=uv)
    worse = calibrate(spoilt, SHEET)
    shift = view_disagreement(spoilt, worse, SHEET)
    assert abs(shift[0, 2]) > 5 * sigma
    error = worse.fit.camera.inverse_d_2 - CAMERA.inverse_d_2
    assert abs(error) < 2 * abs(shift[0, 2])
    assert len(view_disagreement(clean.of_views(views=[0, 1, 2, 3]), found, SHEET)) == 0


def test_systematic_errors_widen_every_interval_that_follows():
    fit = calibrate(observed(), SHEET).fit
    wide = fit._replace(systematic=np.array([[0.0, 0.0, 0.01]]))
    draws = laplace_draws(wide, SHEET, 20_000, np.random.default_rng(0))
    d_2 = draws.draws("d_2")
    assert d_2.std() == pytest.approx(math.hypot(0.04, 4 * fit.covariance.sigma["inverse_d_2"]), rel=0.03)  # d_2 = 2
    assert draws.names[-1] == "f"
    shares = variance_shares(wide, SHEET)
    assert shares["d_2"]["systematic"] > 0.9
    assert shares["d_2"]["sigma"] == pytest.approx(d_2.std(), rel=0.03)
    assert variance_shares(fit, SHEET)["d_2"]["systematic"] == 0


def test_undistorted_radius_is_equation_6_on_the_sensor():
    paper = load("paper")
    # (D (d_f - d_3) - D_F d_f)/(2 d_3) on the focal plane, times d_1/d_f onto the array, to the image pitch.
    bound = (50.8 * 230 - 2.9 * 350) / 240 * 140 / 350
    assert undistorted_radius(paper) == pytest.approx(bound * (1 - 2 / 460) / paper.q, rel=1e-12)
    assert undistorted_radius(paper.replace(d_3=0.0)) == math.inf
    assert undistorted_radius(paper.replace(D=3.0)) == 0
    tube = paper.replace({"stops": (Stop(diameter=20.0, distance=60.0),)})
    assert undistorted_radius(tube) < undistorted_radius(paper)
