"""Step one: Zhang's method on the central view gives A, the axis, distortion and the boards' poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .board import Observations
from .errors import CalibrationError
from .fisher import Covariance, covariance_of, reduced_information
from .homography import homography, poses_from, shared_camera
from .lattice import Array
from .lines import EpiLines
from .model import GLOBALS, Camera, Poses, bordered, project_boards

_MOST = 200
"""Most evaluations: fits that are determined take 5 to 20, one that is not would wander on."""


class StepOne(NamedTuple):
    """The central view's calibration."""

    camera: Camera
    """A, x_0, y_0, k_1, k_2 found; m and 1/d_2 not yet."""
    poses: Poses
    rms: float
    """Reprojection error in the central view: RMS distance [pitches] from measured to modelled corner."""
    covariance: Covariance
    """Of A, x_0, y_0 and the distortion, scaled to the residuals found."""


def step_one(
    observations: Observations,
    lines: EpiLines,
    pixel_pitch: float,
    microlens_pitch: float,
    *,
    distortion: int = 0,
    guess: float | None = None,
) -> StepOne:
    """Calibrate the central view.

    Parameters
    ----------
    observations : Observations
    lines : EpiLines
        Of the observations; they put each corner in the central view with the help of all views.
    pixel_pitch, microlens_pitch : float
        q and d [mm].
    distortion : int
        Radial coefficients to find: 0, 1 or 2.
    guess : float, optional
        A [mm] to start from where the boards' tilts leave it open.

    Raises
    ------
    CalibrationError
        The boards do not determine A or the axis: all parallel.
    """
    from scipy.optimize import least_squares

    central = lines.central
    seen = np.isfinite(central[..., 0]) & np.isfinite(central[..., 1])
    if (seen.sum(axis=1) < 4).any():
        few = [observations.names[k] for k in np.flatnonzero(seen.sum(axis=1) < 4)]
        raise CalibrationError(f"fewer than four corners were seen of {', '.join(few)}")
    maps = np.stack([homography(observations.points[s, :2], c[s]) for s, c in zip(seen, central, strict=True)])
    middle = np.nanmean(central, axis=(0, 1))
    start = shared_camera(maps, middle)
    if start is None and guess is None:
        raise CalibrationError(
            "the boards do not determine A: their perspective shows no tilt; tilt them by 20 degrees or more, in"
            " several directions"
        )
    focal, x_0, y_0 = start if start is not None else (guess / microlens_pitch, *middle)  # type: ignore[operator]
    camera = Camera(focal * microlens_pitch, 0.0, 0.0, x_0, y_0, q=pixel_pitch, d=microlens_pitch)
    poses = poses_from(maps, focal, (x_0, y_0))
    names = ("A", "x_0", "y_0", "k_1", "k_2")[: 3 + distortion]
    columns = [GLOBALS.index(name) for name in names]
    boards, flat = len(maps), seen.ravel()

    def residuals(x: Array) -> Array:
        trial = camera.with_values(names, x[: len(names)])
        uv = project_boards(trial.vector(), x[len(names) :].reshape(-1, 6), observations.points, np.zeros((1, 2))).uv
        return np.asarray((uv[:, 0] - central).reshape(-1, 2)[flat].ravel())

    def jacobian(x: Array) -> Array:
        return bordered(*_derivatives(camera.with_values(names, x[: len(names)]), x[len(names) :].reshape(-1, 6)))[keep]

    def _derivatives(trial: Camera, pose: Array) -> tuple[Array, Array]:
        model = project_boards(trial.vector(), pose, observations.points, np.zeros((1, 2)), derivatives=True)
        assert model.by_globals is not None
        assert model.by_pose is not None
        return model.by_globals[..., columns].reshape(boards, -1, len(names)), model.by_pose.reshape(boards, -1, 6)

    keep = np.repeat(flat, 2)
    if keep.sum() < len(names) + 6 * boards:
        raise CalibrationError(
            f"{keep.sum()} coordinates cannot determine {len(names) + 6 * boards} parameters: show more boards"
        )
    x0 = np.concatenate([camera.vector(names), poses.vector.ravel()])
    found = least_squares(residuals, x0, jacobian, method="lm", x_scale="jac", max_nfev=_MOST)
    camera = camera.with_values(names, found.x[: len(names)])
    poses = Poses.from_vector(found.x[len(names) :])
    if camera.A < 0:  # the mirrored solution: depth and A change sign together
        raise CalibrationError("step one went astray: the boards' poses do not fit a camera in front of them")
    shared, own = _derivatives(camera, poses.vector)
    mask = keep.reshape(boards, -1)[..., None]
    freedom = max(int(keep.sum()) - len(found.x), 1)
    information = reduced_information(shared * mask, own * mask) * freedom / max(2 * found.cost, 1e-24)
    rms = float(np.sqrt(2 * found.cost / flat.sum()))
    return StepOne(camera, poses, rms, covariance_of(information, names))
