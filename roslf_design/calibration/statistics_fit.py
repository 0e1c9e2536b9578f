"""Weighted least squares on the corners' statistics: a joint fit in milliseconds, noise judged by its own scatter."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .corner_statistics import CornerStatistics, model_statistics
from .errors import CalibrationError
from .fisher import Covariance, covariance_of
from .lattice import Array
from .model import GLOBALS, Camera, Poses

_ROUNDS = 40


class StatisticsFit(NamedTuple):
    """The fit, and how the boards follow the camera."""

    camera: Camera
    poses: Poses
    statistics: CornerStatistics
    """With the standard deviations used."""
    covariance: Covariance
    """Of the shared parameters, poses eliminated."""
    place_scale: float
    """Scatter of the places about the model over what independent errors allow."""
    slope_scale: float
    """The same of the slopes."""
    pose_by_shared: Array
    """Derivative of each board's best pose by the shared parameters, shape (b, 6, p)."""
    systematic: Array = np.zeros((0, 3))
    """Standard deviations of what corners' scatter does not show, as independent shifts of (A, m, 1/d_2), (k, 3)."""


class _Linear(NamedTuple):
    """Whitened model at one point."""

    off: Array
    """Residuals, shape (b, r)."""
    shared: Array
    """Shape (b, r, p)."""
    own: Array
    """Shape (b, r, 6)."""


def fit_statistics(
    statistics: CornerStatistics, camera: Camera, poses: Poses, names: tuple[str, ...], *, scale: bool = True
) -> StatisticsFit:
    """Fit the shared parameters `names` and all poses to the statistics.

    Errors of a corner in neighbouring views are seldom independent (interpolation, diffraction, the detector's own
    bias). With `scale`, the scatter about the model of places and of slopes, each over its own degrees of freedom,
    replaces what independence would promise.

    Parameters
    ----------
    statistics : CornerStatistics
    camera, poses
        Where to start, near the solution.
    names : tuple of str
        Shared parameters to fit.
    scale : bool
        Judge the noise by the scatter.

    Raises
    ------
    CalibrationError
        A parameter is not determined, or the fit does not settle.
    """
    columns = [GLOBALS.index(name) for name in names]
    shared, pose = camera.vector(names), poses.vector
    place = slope = 1.0
    for _ in range(3 if scale else 1):
        weighted = statistics.scaled(place, slope)
        shared, pose = _settled(weighted, camera, names, columns, shared, pose)
        if scale:
            more = _scatter(_linear(weighted, camera.with_values(names, shared), pose, columns))
            place, slope = place * more[0], slope * more[1]
    best = camera.with_values(names, shared)
    found = fit_at(statistics.scaled(place, slope), best, Poses.from_vector(pose), names)
    return found._replace(place_scale=place, slope_scale=slope)


def fit_at(statistics: CornerStatistics, camera: Camera, poses: Poses, names: tuple[str, ...]) -> StatisticsFit:
    """What a fit that ended at this camera and these poses would say of its errors."""
    linear = _linear(statistics, camera, poses.vector, [GLOBALS.index(name) for name in names])
    free = _eliminated(linear)
    covariance = covariance_of(np.einsum("brp,brq->pq", free.shared, free.shared), names)
    follow = -np.linalg.pinv(linear.own) @ linear.shared
    return StatisticsFit(camera, poses, statistics, covariance, 1.0, 1.0, follow)


def _linear(statistics: CornerStatistics, camera: Camera, pose: Array, columns: list[int]) -> _Linear:
    model = model_statistics(camera.vector(), pose, statistics)
    boards, weight = len(pose), 1 / statistics.sigma
    off = (model.values - statistics.values) * weight
    shared = (model.by_globals[..., columns] * weight[..., None]).reshape(boards, -1, len(columns))
    return _Linear(off.reshape(boards, -1), shared, (model.by_pose * weight[..., None]).reshape(boards, -1, 6))


def _eliminated(linear: _Linear) -> _Linear:
    """Residuals and shared derivatives with what poses can take up projected out."""
    length = np.sqrt(np.square(linear.own).sum(axis=1, keepdims=True))
    basis = np.linalg.qr(linear.own / np.where(length > 0, length, 1.0))[0]
    turned = np.swapaxes(basis, 1, 2)
    off = linear.off - (basis @ (turned @ linear.off[..., None]))[..., 0]
    return _Linear(off, linear.shared - basis @ (turned @ linear.shared), basis)


def _settled(
    statistics: CornerStatistics, camera: Camera, names: tuple[str, ...], columns: list[int], shared: Array, pose: Array
) -> tuple[Array, Array]:
    """Gauss-Newton, each step halved until it improves."""
    linear = _linear(statistics, camera.with_values(names, shared), pose, columns)
    cost = float(np.square(linear.off).sum())
    for _ in range(_ROUNDS):
        free = _eliminated(linear)
        flat = free.shared.reshape(-1, len(names))
        size = np.sqrt(np.square(flat).sum(axis=0))
        if not (size > 0).all():
            covariance_of(flat.T @ flat, names)  # says which parameter is lost
        step = -np.linalg.lstsq(flat / size, free.off.ravel(), rcond=None)[0] / size
        rest = linear.off + np.einsum("brp,p->br", linear.shared, step)
        turn = -(np.linalg.pinv(linear.own) @ rest[..., None])[..., 0]
        promised = cost - float(np.square(free.off.ravel() + flat @ step).sum())
        if promised <= 1e-10 * max(cost, 1.0):
            return shared + step, pose + turn
        for half in range(12):
            part = 0.5**half
            trial_shared, trial_pose = shared + part * step, pose + part * turn
            trial = _linear(statistics, camera.with_values(names, trial_shared), trial_pose, columns)
            trial_cost = float(np.square(trial.off).sum())
            if trial_cost < cost:
                break
        else:
            return shared, pose
        shared, pose, linear, cost = trial_shared, trial_pose, trial, trial_cost
    raise CalibrationError("the fit of the camera does not settle: the boards' views hardly determine it")


def _scatter(linear: _Linear) -> tuple[float, float]:
    """Scatter of places and slopes over their standard deviations, each by its own degrees of freedom."""
    free = _eliminated(linear)
    flat = free.shared.reshape(-1, free.shared.shape[-1])
    basis = np.linalg.qr(flat / np.sqrt(np.square(flat).sum(axis=0)))[0]
    taken = np.square(basis).sum(axis=1) + np.square(free.own).sum(axis=-1).ravel()
    off, used = linear.off.ravel(), (linear.own != 0).any(axis=-1).ravel()
    kind = np.arange(off.size) % 3 == 2
    found = []
    for rows in (used & ~kind, used & kind):
        freedom = rows.sum() - taken[rows].sum()
        found.append(float(np.sqrt(np.square(off[rows]).sum() / freedom)) if freedom > 8 else 1.0)
    return found[0], found[1]
