"""From corners to the camera: lines through the views, Zhang's method, Eq. 12, and the joint fit of all corners.

Intervals come from a last fit, on what all views together say of each corner: its place and its slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .corner_statistics import StatisticsFit, corner_statistics, fit_statistics
from .corners import homography
from .epilines import EpiLines, fit_lines
from .frames import Array, CalibrationError
from .least_squares import Covariance, Linear, covariance_of, settle, undetermined, whitened
from .model import (
    GLOBALS,
    MOST_RADIAL,
    DataSheet,
    Intrinsics,
    Observations,
    Poses,
    observed,
    project_boards,
    rotation_matrix,
)

_PARALLEL = "the boards are all parallel, as far as their corners show; tilt them by 20 degrees in several directions"
_MIRRORED = 3
"""Rounds in which boards are tried tilted the other way."""
VISIBLE = 2.0
"""Scale of residuals, against what views of one corner scatter by, from which a misfit is one."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibration of a camera from images of boards, by both ways."""

    observations: Observations
    lines: EpiLines
    first: _StepOne
    """Zhang's method on the central view."""
    second: _StepTwo
    """Eq. 12 on the epipolar slopes."""
    joint: _Refined
    """All corners in all views."""
    fit: StatisticsFit
    """The joint fit on the corners' statistics, noise judged by its scatter: what intervals come from."""


def calibrate(
    observations: Observations, sheet: DataSheet, *, distortion: int = 0, guess: float | None = None
) -> Calibration:
    """Calibrate the camera from a board's corners in the views of several light fields.

    Parameters
    ----------
    sheet : DataSheet
        f, q and d.
    distortion : int
        Radial coefficients to find: 0, 1 or 2; with any, the field's curvature and the growth of the views' baseline.
    guess : float, optional
        A [mm] to start from, such as the design's.

    Raises
    ------
    CalibrationError
        The boards do not determine the camera: says which parameter is lost, and why.
    """
    if len(observations.names) < 2:
        raise CalibrationError(
            "one image of the board cannot separate its distance from A; show two or more, tilted differently"
        )
    lines, names = fit_lines(observations), shared_names(distortion)
    try:
        first = _step_one(observations, lines, sheet.q, sheet.d, distortion=distortion, guess=guess)
        second = _step_two(observations, lines, first, distorted=distortion > 0)
        joint = _refine(observations, second.camera, first.poses, names)
        _refuse_lost(joint.covariance, joint.camera, joint.poses)
        statistics = corner_statistics(observations, lines, independent_sigma(lines, joint))
        fit = fit_statistics(statistics, joint.camera, joint.poses, names)
        _refuse_lost(fit.covariance, fit.camera, fit.poses)
    except CalibrationError as error:
        if _all_parallel(observations, lines):
            raise CalibrationError(
                f"A, x_0 and y_0 (and with them d_2, H and d_3) are not determined: {_PARALLEL}"
            ) from error
        raise
    return Calibration(observations, lines, first, second, joint, fit)


def independent_sigma(lines: EpiLines, joint: _Refined) -> float:
    """Standard deviation of one coordinate by its scatter about the views' lines; where there is none, by the fit's."""
    return lines.sigma if lines.sigma > 0 else joint.sigma


def _refuse_lost(covariance: Covariance, camera: Intrinsics, poses: Poses) -> None:
    lost = undetermined(covariance, camera, len(poses.rotation))
    if lost:
        raise CalibrationError(f"{lost} not determined: {_why(lost, poses)}")


def _why(lost: str, poses: Poses) -> str:
    depth, count = poses.translation[:, 2], len(poses.rotation)
    if np.ptp(depth) < 0.02 * depth.mean():
        near = f"{depth.mean():.1f} mm from the pupil, within {np.ptp(depth):.2f} mm"
        return f"the boards stand at one depth ({near}); spread their distances"
    if lost.startswith("A"):
        return _PARALLEL
    return f"{count} boards are too few, their tilts too small, or their corners too noisy"


def shared_names(distortion: int) -> tuple[str, ...]:
    """Names of the shared parameters that a fit with so many radial coefficients finds: what goes with them, too."""
    if distortion not in range(MOST_RADIAL + 1):
        raise ValueError(f"distortion must be 0, 1 or 2 radial coefficients, got {distortion}")
    return (*GLOBALS[: 5 + distortion], *(("c_1", "b_1") if distortion else ()))


# --- step one ---------------------------------------------------------------------------------------------------------


class _StepOne(NamedTuple):
    """The central view's calibration."""

    camera: Intrinsics
    """A, x_0, y_0, k_1, k_2 found; m and 1/d_2 not yet."""
    poses: Poses
    rms: float
    """Reprojection error in the central view: RMS distance [pitches] from measured to modelled corner."""


def _step_one(
    observations: Observations,
    lines: EpiLines,
    pixel_pitch: float,
    microlens_pitch: float,
    *,
    distortion: int = 0,
    guess: float | None = None,
) -> _StepOne:
    """Zhang's method on the central view gives A, the axis, distortion and the boards' poses.

    `lines`, of the observations, put each corner in the central view with the help of all views; `guess` is an A [mm]
    to start from where the boards' tilts leave it open.

    Raises
    ------
    CalibrationError
        The boards do not determine A or the axis: all parallel.
    """
    import cv2

    central = lines.central
    seen = observed(central)
    if (seen.sum(axis=1) < 4).any():
        few = [observations.names[k] for k in np.flatnonzero(seen.sum(axis=1) < 4)]
        raise CalibrationError(f"fewer than four corners were seen of {', '.join(few)}")
    middle = np.nanmean(central, axis=(0, 1))
    # The picture is turned round: u falls as X grows.
    plates = [(observations.points[s], middle - c[s]) for s, c in zip(seen, central, strict=True)]
    A = microlens_pitch * _focal_length(np.stack([homography(points[:, :2], image) for points, image in plates]))
    if A == 0 and guess is None:
        raise CalibrationError(
            "the boards do not determine A: their perspective shows no tilt; tilt them by 20 degrees or more, in"
            " several directions"
        )
    A = A or guess or 0.0
    pinhole = np.diag([A / microlens_pitch, A / microlens_pitch, 1.0])
    poses = [np.concatenate(cv2.solvePnP(points, image, pinhole, None)[1:]).ravel() for points, image in plates]
    x_0, y_0 = middle.tolist()
    camera = Intrinsics(A, 0.0, 0.0, x_0, y_0, q=pixel_pitch, d=microlens_pitch)
    view = Observations(observations.points, np.zeros((1, 2)), central[:, None], observations.names)
    names = ("A", *GLOBALS[3 : 5 + distortion])
    fit = _refine(view, camera, Poses.from_vector(np.array(poses)), names)
    for _ in range(_MIRRORED):
        better = _better_mirrored(view, fit)
        if better is None:
            break
        fit = _refine(view, fit.camera, better, names)
    if fit.camera.A < 0:  # the mirrored solution: depth and A change sign together
        raise CalibrationError("step one went astray: the boards' poses do not fit a camera in front of them")
    if 0.01 * (guess or A) > fit.camera.A:  # no board is foreshortened: A shrinks without end
        raise CalibrationError(f"A not determined: {_PARALLEL}")
    return _StepOne(fit.camera, fit.poses, fit.rms)


def _better_mirrored(view: Observations, fit: _Refined) -> Poses | None:
    """The poses with those boards tilted the other way that fit better so; None where none does.

    A board tilted the other way, mirrored in the plane square to its line of sight, looks alike but for perspective: a
    fit that starts there, as from corners that distortion has moved, does not come back by itself.
    """
    from scipy.spatial.transform import Rotation

    turn, place = rotation_matrix(fit.poses.rotation), fit.poses.translation
    sight = place / np.linalg.norm(place, axis=1, keepdims=True)
    over = np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]
    turned = Rotation.from_matrix(over @ turn @ np.diag([1.0, 1.0, -1.0])).as_rotvec()
    measured = np.where(view.seen[..., None], view.uv, 0.0)

    def model(shared: Array, pose: Array, derivatives: bool) -> Linear:
        corners = project_boards(shared, pose, view.points, view.views, derivatives=derivatives)
        return whitened(corners, measured, view.seen[..., None])

    other = settle(model, fit.camera, Poses(turned, place), ())
    before = np.nansum(np.square(fit.residuals), axis=(1, 2, 3))
    better = np.square(other.linear.off).sum(axis=1) < before
    if not better.any():
        return None
    return Poses.from_vector(np.where(better[:, None], other.poses.vector, fit.poses.vector))


def _focal_length(homographies: Array) -> float:
    """Focal length of square pixels in image units, to start a fit from; 0 where the boards show no perspective.

    Closed form, with the principal point at (0, 0): of omega = diag(a, a, e), h_1' omega h_2 = 0 and h_1' omega h_1 =
    h_2' omega h_2 for each board.
    """
    scaled = homographies / np.cbrt(np.abs(np.linalg.det(homographies)))[:, None, None]
    g, h = scaled[..., 0], scaled[..., 1]
    products = np.concatenate([g * h, g * g - h * h])
    near, far = products[:, :2].sum(axis=1), products[:, 2]
    square = -float(far @ near) / max(float(far @ far), 1e-300)
    return math.sqrt(max(square, 0.0))


def _all_parallel(observations: Observations, lines: EpiLines) -> bool:
    """Whether boards may all be parallel, as far as their corners tell.

    Parallel planes share one vanishing line. The lines, with their errors from those of the corners, are compared with
    their weighted mean: true unless parallel boards would look as different in fewer than one of 1000 sets.
    """
    from scipy.stats import chi2

    central, rng = lines.central, np.random.default_rng(0)
    seen = observed(central)
    if (seen.sum(axis=1) < 4).any() or not lines.sigma > 0:
        return False
    sigma = lines.sigma / float(np.sqrt(np.median(lines.views[lines.views > 0])))
    middle = central[seen].mean(axis=0)

    def vanishing(plane: Array, image: Array) -> Array:
        """(a, b) of the line a x + b y + 1 = 0 about `middle`; (0, 0): face on."""
        line = np.linalg.inv(homography(plane, image - middle))[2]
        return np.asarray(line[:2] / line[2])

    lines_at, weights = [], []
    for s, c in zip(seen, central, strict=True):
        plane, image = observations.points[s, :2], c[s]
        drawn = [vanishing(plane, image + sigma * rng.normal(size=image.shape)) for _ in range(100)]
        lines_at.append(vanishing(plane, image))
        weights.append(np.linalg.pinv(np.cov(drawn, rowvar=False)))
    mean = np.linalg.solve(np.sum(weights, axis=0), np.einsum("bij,bj->i", weights, lines_at))
    away = np.array(lines_at) - mean
    misfit = float(np.einsum("bi,bij,bj->", away, weights, away))
    return misfit < float(chi2.ppf(0.999, max(2 * (len(away) - 1), 1)))


# --- step two ---------------------------------------------------------------------------------------------------------


class _StepTwo(NamedTuple):
    """The line fit of Eq. 12."""

    camera: Intrinsics
    """Camera with m and 1/d_2."""
    inverse_depth: Array
    """1/Z_F of every corner used [1/mm], shape (k,)."""
    slope: Array
    """Slope measured [pitches/px], shape (k,)."""
    fitted: Array
    """The line's slope there, shape (k,)."""


def _step_two(observations: Observations, lines: EpiLines, first: _StepOne, *, distorted: bool = False) -> _StepTwo:
    """Fit ``slope = alpha + beta (1/Z_F - 1/Z_0)``, beta = -q A^2/(d d_2), alpha = (q A/(d d_2))(m - A/Z_0).

    Centred on the mean inverse depth the two columns are orthogonal, so that few or near depths widen the errors of m
    and d_2 without losing digits. From the fit ``1/d_2 = -beta d/(q A^2)`` and ``m = A (1/Z_0 - alpha/beta)``. A lens
    that is `distorted` adds terms in |X/Z_F|^2 and |X/Z_F|^2/Z_F, which are fitted first and taken off the slopes.

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
    inverse, slope, weight = 1 / depth[used], lines.slope[used], lines.lever.sum(axis=-1)[used]
    if distorted:
        aside = (np.square(lines.central - (camera.x_0, camera.y_0)).sum(axis=-1) * (camera.d / camera.A) ** 2)[used]
        columns = np.stack([aside, aside * inverse, np.ones_like(aside), inverse], axis=-1)
        size, root = np.sqrt(np.square(columns).sum(axis=0)), np.sqrt(weight)
        terms = np.linalg.lstsq(root[:, None] * columns / size, root * slope, rcond=None)[0] / size
        slope = slope - columns[:, :2] @ terms[:2]
    centre, alpha = (float(np.average(values, weights=weight)) for values in (inverse, slope))
    away = inverse - centre
    power = float(np.sum(weight * away**2))
    if not np.sqrt(power / np.sum(weight)) > 1e-9 * abs(centre):
        raise CalibrationError(
            "all corners lie at one depth: d_2 and m are not determined; show boards at several distances"
        )
    # Both sums centred: the rounding of the mean of 1/Z would else enter times the mean slope, as 1/gap^2.
    beta = float(np.sum(weight * away * (slope - alpha))) / power
    if beta >= 0:
        raise CalibrationError(
            "the epipolar slopes do not fall with inverse depth: the boards stand too nearly at one depth for d_2 and"
            " m, or the views are mirrored"
        )
    A, q, d = camera.A, camera.q, camera.d
    m = A * (centre - alpha / beta)
    if m <= 0:
        raise CalibrationError(f"step two found m = {m:.3g}: the boards' depths do not determine d_2 and m")
    best = replace(camera, m=m, inverse_d_2=-beta * d / (q * A * A))
    return _StepTwo(best, inverse, slope, alpha + beta * away)


# --- the joint fit ----------------------------------------------------------------------------------------------------


class _Refined(NamedTuple):
    """The joint fit."""

    camera: Intrinsics
    poses: Poses
    residuals: Array
    """Measured minus modelled [pitches], shape (b, v, n, 2); NaN where not seen."""
    rms: float
    """RMS distance from measured to modelled corner [pitches]."""
    sigma: float
    """Standard deviation of one coordinate [pitches]."""
    covariance: Covariance
    """Covariance of the shared parameters, for independent errors of `sigma`."""


def _refine(observations: Observations, camera: Intrinsics, poses: Poses, names: tuple[str, ...]) -> _Refined:
    """Fit the shared parameters `names` and every pose to all corners in all views at once, from steps one and two.

    Raises
    ------
    CalibrationError
        Too few corners, or a parameter that they do not determine.
    """
    seen = observations.seen
    count, unknown = observations.count, len(names) + 6 * len(poses.rotation)
    if count < unknown:
        raise CalibrationError(f"{count} coordinates cannot determine {unknown} parameters: show more boards")
    measured = np.where(seen[..., None], observations.uv, 0.0)

    def model(shared: Array, pose: Array, derivatives: bool) -> Linear:
        corners = project_boards(shared, pose, observations.points, observations.views, derivatives=derivatives)
        return whitened(corners, measured, seen[..., None])

    fit = settle(model, camera, poses, names)
    squares = float(np.square(fit.linear.off).sum())
    sigma = float(np.sqrt(squares / max(count - unknown, 1)))
    residuals = np.where(seen[..., None], -fit.linear.off.reshape(measured.shape), np.nan)
    covariance = covariance_of(fit.linear.information() / max(sigma, 1e-12) ** 2, names)
    return _Refined(fit.camera, fit.poses, residuals, float(np.sqrt(squares / seen.sum())), sigma, covariance)
