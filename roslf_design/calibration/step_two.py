"""Step two: slopes of the epipolar lines against inverse depth give d_2 and m (Eq. 12)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .board import Observations
from .errors import CalibrationError
from .lattice import Array
from .lines import EpiLines
from .model import Camera, rotation_matrix
from .step_one import StepOne


class StepTwo(NamedTuple):
    """The line fit of Eq. 12."""

    camera: Camera
    """With m and 1/d_2."""
    inverse_depth: Array
    """1/Z_F of every corner used [1/mm], shape (k,)."""
    slope: Array
    """Its measured slope [pitches/px], shape (k,)."""
    fitted: Array
    """The line's slope there, shape (k,)."""
    centre: float
    """1/Z_0, mean inverse depth, about which the line is fitted [1/mm]."""
    covariance: Array
    """Of (m, 1/d_2), given step one, shape (2, 2)."""
    condition: float
    """1/Z_0 over the spread of 1/Z_F: how short the lever is that tells d_2 from m."""

    @property
    def correlation(self) -> float:
        """Between m and 1/d_2."""
        return float(self.covariance[0, 1] / np.sqrt(self.covariance[0, 0] * self.covariance[1, 1]))


def step_two(observations: Observations, lines: EpiLines, first: StepOne) -> StepTwo:
    """Fit ``slope = alpha + beta (1/Z_F - 1/Z_0)``, beta = -q A^2/(d d_2), alpha = (q A/(d d_2))(m - A/Z_0).

    Centred on the mean inverse depth the two columns are orthogonal, so that few or near depths widen the errors of m
    and d_2 without losing digits. From the fit ``1/d_2 = -beta d/(q A^2)`` and ``m = A (1/Z_0 - alpha/beta)``.

    Raises
    ------
    CalibrationError
        No baseline (one view only), or slopes that do not fall with inverse depth: one depth only.
    """
    camera = first.camera
    turn = rotation_matrix(first.poses.rotation)
    depth = np.einsum("bj,nj->bn", turn[:, 2], observations.points) + first.poses.translation[:, 2:]
    used = np.isfinite(lines.slope)
    if not used.any():
        raise CalibrationError(
            "all corners were seen in one view only: step two needs views from several places of the pupil"
        )
    inverse, slope = 1 / depth[used], lines.slope[used]
    weight = np.sqrt(lines.lever[used])
    centre = float(np.average(inverse, weights=weight**2))
    away = inverse - centre
    alpha = float(np.average(slope, weights=weight**2))
    power = float(np.sum((weight * away) ** 2))
    spread = np.sqrt(power / np.sum(weight**2))
    if not spread > 1e-9 * abs(centre):
        raise CalibrationError(
            "all corners lie at one depth: d_2 and m are not determined; show boards at several distances"
        )
    # Both sums centred: the rounding of the mean of 1/Z would else enter times the mean slope, as 1/gap^2.
    beta = float(np.sum(weight**2 * away * (slope - alpha))) / power
    fitted = alpha + beta * away
    variance = float(np.sum((weight * (slope - fitted)) ** 2)) / max(len(slope) - 2, 1)
    if beta >= 0:
        raise CalibrationError(
            "the epipolar slopes do not fall with inverse depth: the boards stand too nearly at one depth for d_2 and"
            " m, or the views are mirrored"
        )
    A, q, d = camera.A, camera.q, camera.d
    by_fit = np.array([[-A / beta, A * alpha / beta**2], [0.0, -d / (q * A * A)]])
    covariance = by_fit @ np.diag([variance / np.sum(weight**2), variance / power]) @ by_fit.T
    found = camera.with_values(("m", "inverse_d_2"), np.array([A * (centre - alpha / beta), -beta * d / (q * A * A)]))
    if found.m <= 0:
        raise CalibrationError(f"step two found m = {found.m:.3g}: the boards' depths do not determine d_2 and m")
    return StepTwo(found, inverse, slope, fitted, centre, covariance, float(abs(centre) / spread))
