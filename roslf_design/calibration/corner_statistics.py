"""Statistics of corners: what all views together say of the place and the slope of each, and the fit on them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .epilines import EpiLines
from .frames import Array, CalibrationError
from .least_squares import Covariance, Linear, covariance_of, settle, whitened
from .model import GLOBALS, Intrinsics, Observations, Poses, project_boards

_SETTLED = 10
"""Most rounds in which a fit and the scatter about it settle; from a tenth of the scatter it takes five."""
_FAR = 3.0
"""Standard deviations beyond which a corner pulls no harder (Huber's loss): scatter alone puts one in 400 there."""


@dataclass(frozen=True, eq=False)
class _CornerStatistics:
    """Statistics of each corner over all views, in three numbers: a sufficient summary of the observations."""

    points: Array
    """Corners in the board's frame [mm], shape (n, 3)."""
    values: Array
    """u, v [pitches] at `at`, and the slope [pitches/px], shape (b, n, 3); 0 where not seen."""
    at: Array
    """Mean (s', t') [px], shape (b, n, 2)."""
    share: Array
    """Share of the squared baseline along s, shape (b, n)."""
    sigma: Array
    """Standard deviation of each value, shape (b, n, 3); infinite where not seen."""

    def linear(self, camera: Array, pose: Array, derivatives: bool = True) -> Linear:
        """Residuals of `project_boards`, in standard deviations."""
        model = project_boards(camera, pose, self.points, self.at[:, None], self.share[:, None], derivatives)
        return whitened(model, self.values[:, None], 1 / self.sigma[:, None])


def corner_statistics(observations: Observations, lines: EpiLines, sigma: float) -> _CornerStatistics:
    """Summarise observations, of which `lines` are, whose coordinates have independent errors of `sigma` [pitches]."""
    power = lines.lever.sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        place, slope = sigma / np.sqrt(lines.views), sigma / np.sqrt(power)
        share = np.where(power > 0, lines.lever[..., 0] / power, 0.5)
    values = np.nan_to_num(np.concatenate([lines.mean, lines.slope[..., None]], axis=-1))
    at = np.nan_to_num(lines.at)
    return _CornerStatistics(observations.points, values, at, share, np.stack([place, place, slope], axis=-1))


class StatisticsFit(NamedTuple):
    """The fit, and how the boards follow the camera."""

    camera: Intrinsics
    poses: Poses
    statistics: _CornerStatistics
    """Statistics of the corners, with the standard deviations used."""
    covariance: Covariance
    """Covariance of the shared parameters, poses eliminated."""
    pose_by_shared: Array
    """Derivative of each board's best pose by the shared parameters, shape (b, 6, p)."""
    scales: tuple[float, float] = (1.0, 1.0)
    """Scatter of places and of slopes about the model over what the views' scatter about their lines promises: 1 where
    the model holds."""
    systematic: Array = np.zeros((0, 3))
    """Standard deviations of what corners' scatter does not show, as independent shifts of (A, m, 1/d_2), (k, 3)."""


def fit_statistics(
    statistics: _CornerStatistics, camera: Intrinsics, poses: Poses, names: tuple[str, ...]
) -> StatisticsFit:
    """Fit the shared parameters `names` and all poses to the statistics, from near the solution.

    Errors of a corner in neighbouring views are seldom independent (interpolation, diffraction, the detector's own
    bias). So the scatter about the model of places and of slopes, each over its own degrees of freedom, replaces what
    independence would promise. Huber's loss keeps corners that are simply wrong from pulling; their standard deviations
    come back widened so that plain least squares, and the likelihood, weigh them the same way.

    Raises
    ------
    CalibrationError
        A parameter is not determined, or the fit does not settle.
    """
    scales = np.ones(3)
    for _ in range(_SETTLED):
        fit = settle(statistics.linear, camera, poses, names, far=_FAR)
        if not fit.done:
            raise CalibrationError("the fit of the camera does not settle: the boards' views hardly determine it")
        camera, poses = fit.camera, fit.poses
        change = np.nan_to_num(leftover(fit.linear).scales(_FAR), nan=1.0)[[0, 0, 1]]  # of u, v and slope
        statistics, scales = replace(statistics, sigma=statistics.sigma * change), scales * change
        if np.abs(change - 1).max() < 0.01:
            break
    off = statistics.linear(camera.vector(), poses.vector).off.reshape(statistics.sigma.shape)
    statistics = replace(statistics, sigma=statistics.sigma * np.sqrt(_beyond(off)))
    return fit_at(statistics, camera, poses, names)._replace(scales=(float(scales[0]), float(scales[2])))


def fit_at(statistics: _CornerStatistics, camera: Intrinsics, poses: Poses, names: tuple[str, ...]) -> StatisticsFit:
    """Fit that ended at this camera and these poses, with its errors."""
    linear = statistics.linear(camera.vector(), poses.vector)
    linear = linear._replace(shared=linear.shared[..., [GLOBALS.index(name) for name in names]])
    follow = -np.linalg.pinv(linear.own) @ linear.shared
    return StatisticsFit(camera, poses, statistics, covariance_of(linear.information(), names), follow)


def _beyond(off: Array) -> Array:
    """How many times as far as `_FAR` residuals lie, 1 for those within: the square of what widens their errors."""
    return np.maximum(np.abs(off) / _FAR, 1.0)


class Leftover(NamedTuple):
    """Residuals that a linear model leaves once its columns have taken up what they can."""

    off: Array
    """Residuals [standard deviations], shape (b, r)."""
    free: Array
    """Degrees of freedom of each, shape (b, r); 0 where nothing was seen."""

    def scales(self, far: float = math.inf) -> tuple[float, float]:
        """Scatter of places and of slopes; residuals beyond `far` count as at it. NaN without degrees of freedom."""
        sloped = np.broadcast_to(np.arange(self.off.shape[1]) % 3 == 2, self.off.shape)
        near = np.square(np.clip(self.off, -far, far))
        place, slope = ((near[rows].sum(), self.free[rows].sum()) for rows in (~sloped, sloped))
        places, slopes = (math.sqrt(squares / free) if free > 1 else math.nan for squares, free in (place, slope))
        return places, slopes


def leftover(linear: Linear) -> Leftover:
    """Residuals of a model of corner statistics; corners beyond `_FAR` pull no harder than there."""
    weight = 1 / np.sqrt(_beyond(linear.off))
    free = Linear(*(part * weight.reshape(weight.shape + (1,) * (part.ndim - 2)) for part in linear)).eliminated()
    flat = free.shared.reshape(-1, free.shared.shape[-1])
    basis = np.linalg.qr(flat / np.sqrt(np.square(flat).sum(axis=0)))[0]
    off = (free.off - (basis @ (basis.T @ free.off.ravel())).reshape(free.off.shape)) / weight
    taken = np.square(basis).sum(axis=1).reshape(off.shape) + np.square(free.own).sum(axis=-1)
    used = (linear.own != 0).any(axis=-1)
    return Leftover(np.where(used, off, 0.0), np.where(used, 1.0 - taken, 0.0))
