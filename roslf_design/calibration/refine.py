"""Joint refinement: all corners in all views at once, by Levenberg-Marquardt with analytic derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .board import Observations
from .errors import CalibrationError
from .fisher import Covariance, covariance_of, reduced_information
from .lattice import Array
from .model import GLOBALS, Camera, Poses, bordered, project_boards

_MOST = 100
"""Most evaluations: from steps one and two, a determined fit takes 4 to 10."""


class Refined(NamedTuple):
    """The joint fit."""

    camera: Camera
    poses: Poses
    residuals: Array
    """Measured minus modelled [pitches], shape (b, v, n, 2); NaN where not seen."""
    rms: float
    """RMS distance from measured to modelled corner [pitches]."""
    sigma: float
    """Standard deviation of one coordinate [pitches]."""
    covariance: Covariance
    """Of the shared parameters, for independent errors of `sigma`."""
    evaluations: int
    """Of the model."""


def shared_names(distortion: int) -> tuple[str, ...]:
    """Names of the shared parameters that a fit finds."""
    if distortion not in (0, 1, 2):
        raise ValueError(f"distortion must be 0, 1 or 2 radial coefficients, got {distortion}")
    return GLOBALS[: 5 + distortion]


def refine(observations: Observations, camera: Camera, poses: Poses, *, distortion: int = 0) -> Refined:
    """Fit A, m, 1/d_2, x_0, y_0, the distortion asked for, and every pose to all corners in all views.

    Parameters
    ----------
    observations : Observations
    camera, poses
        Where to start: steps one and two.
    distortion : int
        Radial coefficients to fit.

    Raises
    ------
    CalibrationError
        Too few corners, or a parameter that they do not determine.
    """
    from scipy.optimize import least_squares

    names = shared_names(distortion)
    columns = [GLOBALS.index(name) for name in names]
    seen, count, boards = observations.seen, len(names), len(poses.rotation)
    rows = np.repeat(seen.reshape(boards, -1), 2, axis=1)
    measured = np.where(rows, observations.uv.reshape(boards, -1), 0.0)
    unknown = count + 6 * boards
    if rows.sum() < unknown:
        raise CalibrationError(f"{rows.sum()} coordinates cannot determine {unknown} parameters: show more boards")

    def model(x: Array, derivatives: bool) -> tuple[Array, Array, Array]:
        trial = camera.with_values(names, x[:count]).vector()
        view = project_boards(trial, x[count:].reshape(-1, 6), observations.points, observations.views, derivatives)
        off = (view.uv.reshape(boards, -1) - measured) * rows
        if view.by_globals is None or view.by_pose is None:
            return off, np.empty(0), np.empty(0)
        shared = view.by_globals.reshape(boards, -1, len(GLOBALS))[..., columns] * rows[..., None]
        return off, shared, view.by_pose.reshape(boards, -1, 6) * rows[..., None]

    def misfit(x: Array) -> Array:
        return model(x, False)[0].ravel()

    def jacobian(x: Array) -> Array:
        return bordered(*model(x, True)[1:])

    found = least_squares(
        misfit,
        np.concatenate([camera.vector(names), poses.vector.ravel()]),
        jacobian,
        method="lm",
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        max_nfev=_MOST,
    )
    best = camera.with_values(names, found.x[:count])
    off, shared, own = model(found.x, True)
    sigma = float(np.sqrt(np.square(off).sum() / max(rows.sum() - unknown, 1)))
    information = reduced_information(shared, own) / max(sigma, 1e-12) ** 2
    residuals = np.where(rows, -off, np.nan).reshape(observations.uv.shape)
    return Refined(
        camera=best,
        poses=Poses.from_vector(found.x[count:]),
        residuals=residuals,
        rms=float(np.sqrt(np.square(off).sum() / seen.sum())),
        sigma=sigma,
        covariance=covariance_of(information, names),
        evaluations=int(found.nfev),
    )
