"""Do the inner views tell of the same camera as all of them? What they disagree on, scatter does not show."""

from __future__ import annotations

import numpy as np

from .board import Observations
from .calibrate import Calibration, calibrate
from .datasheet import DataSheet
from .errors import CalibrationError
from .lattice import Array

NAMES = ("A", "m", "inverse_d_2")
_INNER = 0.75
"""Views within this share of the outermost one's distance from the centre count as inner."""


def camera_vector(found: Calibration) -> Array:
    """A, m and 1/d_2 of the fit that intervals come from."""
    return found.fit.camera.vector(NAMES)


def view_disagreement(observations: Observations, found: Calibration, sheet: DataSheet, distortion: int = 0) -> Array:
    """Difference of (A, m, 1/d_2) between inner views and all, beyond what noise explains.

    Corners read between microlenses and pixels are off by up to a hundredth of a pitch in ways that repeat from board
    to board and change from view to view. Their scatter is small, the slopes' common error is not: it shows when the
    outer views are left out.

    Returns
    -------
    ndarray
        As one independent standard deviation, shape (1, 3); (0, 3) where there are too few inner views to tell.
    """
    away = np.hypot(*observations.views.T)
    inner = np.flatnonzero(away <= _INNER * away.max() + 1e-9)
    if len(inner) < 5 or len(inner) == len(away):
        return np.zeros((0, 3))
    try:
        other = calibrate(
            observations.select(views=inner.tolist()), sheet, distortion=distortion, guess=found.fit.camera.A
        )
    except CalibrationError:
        return np.zeros((0, 3))
    difference = camera_vector(other) - camera_vector(found)
    # All views hold the inner ones: the difference of the estimates has the difference of their variances.
    variance = [fit.covariance.part(NAMES)[2, 2] for fit in (other.fit, found.fit)]
    noise = max(float(variance[0] - variance[1]), 0.0)
    beyond = max(1.0 - noise / max(float(difference[2]) ** 2, 1e-300), 0.0)
    return np.asarray(np.sqrt(beyond) * difference[None])
