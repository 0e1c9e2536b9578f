"""From corners to the camera: lines through the views, Zhang's method, Eq. 12, and the joint fit of all corners.

Intervals come from a last fit, on what all views together say of each corner: its place and its slope.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .corners import homography
from .frames import Array, CalibrationError
from .model import (
    GLOBALS,
    MOST_RADIAL,
    DataSheet,
    Intrinsics,
    Observations,
    Poses,
    ProjectedCorners,
    observed,
    project_boards,
    rotation_matrix,
)

_SETTLED = 10
"""Most rounds in which a fit and the scatter about it settle; from a tenth of the scatter it takes five."""
_MOST = 200
"""Most evaluations: fits that are determined take 4 to 20, one that is not would wander on."""
_SCALES = {"A": 100.0, "m": 0.4, "inverse_d_2": 0.5, "x_0": 100.0, "y_0": 100.0, "k_2": 1000.0}
_SCALES |= dict.fromkeys(("k_1", "c_1", "b_1"), 10.0)
_LOST = 0.3
"""Relative standard deviation of A, m or d_2 above which it counts as not determined."""
_CHANCE = 1e-3
"""Share of sets of parallel boards whose noise may pass for tilts."""
_PARALLEL = "the boards are all parallel, as far as their corners show; tilt them by 20 degrees in several directions"
_FAR = 3.0
"""Standard deviations beyond which a corner pulls no harder (Huber's loss): scatter alone puts one in 400 there."""
_MIRRORED = 3
"""Rounds in which boards are tried tilted the other way."""
VISIBLE = 2.0
"""Scale of residuals, against what views of one corner scatter by, from which a misfit is one."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibration of a camera from images of boards, by both ways."""

    observations: Observations
    lines: _EpiLines
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
        fit = _fit_statistics(statistics, joint.camera, joint.poses, names)
        _refuse_lost(fit.covariance, fit.camera, fit.poses)
    except CalibrationError as error:
        if _all_parallel(observations, lines):
            raise CalibrationError(
                f"A, x_0 and y_0 (and with them d_2, H and d_3) are not determined: {_PARALLEL}"
            ) from error
        raise
    return Calibration(observations, lines, first, second, joint, fit)


def independent_sigma(lines: _EpiLines, joint: _Refined) -> float:
    """Standard deviation of one coordinate by its scatter about the views' lines; where there is none, by the fit's."""
    return lines.sigma if lines.sigma > 0 else joint.sigma


def _refuse_lost(covariance: _Covariance, camera: Intrinsics, poses: Poses) -> None:
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


# --- lines through the views ------------------------------------------------------------------------------------------


class _EpiLines(NamedTuple):
    """Lines u = u_mean + slope (s - s_mean), v = v_mean + slope (t - t_mean) of board b's corner n.

    Means and slope are independent for independent errors of the corners, and hold all that the views say of a corner
    but for distortion's second order in the baseline (1e-3 px in the paper's system).
    """

    mean: Array
    """(u, v) averaged over the views that saw the corner [pitches], shape (b, n, 2); NaN where fewer than one did."""
    at: Array
    """Average of (s', t') over the same views [px], shape (b, n, 2)."""
    slope: Array
    """Du/Ds' = Dv/Dt' [pitches/px], shape (b, n); NaN without a baseline."""
    views: Array
    """Views that saw the corner, shape (b, n)."""
    lever: Array
    """Sum of squared baselines along s and along t [px^2], shape (b, n, 2): slopes have variance sigma^2 over both."""
    sigma: float
    """Standard deviation of one coordinate about its line [pitches]; NaN with one view only."""

    @property
    def central(self) -> Array:
        """(u, v) in the central view [pitches], shape (b, n, 2)."""
        return self.mean - np.nan_to_num(self.slope)[..., None] * self.at


def fit_lines(observations: Observations) -> _EpiLines:
    """Fit every corner's line.

    Raises
    ------
    CalibrationError
        A board without a corner.
    """
    seen = observations.seen
    if not seen.any(axis=(1, 2)).all():
        empty = [observations.names[k] for k in np.flatnonzero(~seen.any(axis=(1, 2)))]
        raise CalibrationError(f"no corner was seen of {', '.join(empty)}")
    count, held = seen.sum(axis=1).astype(float), seen[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = (seen / count[:, None])[..., None]
        st = np.broadcast_to(observations.views[None, :, None, :], observations.uv.shape)
        mean, at = ((weight * np.where(held, part, 0.0)).sum(axis=1) for part in (observations.uv, st))
        mean[count == 0] = np.nan
        base = np.where(held, st - at[:, None], 0.0)
        lever = np.square(base).sum(axis=1)
        power = lever.sum(axis=-1)
        moved = np.where(held, observations.uv - mean[:, None], 0.0)
        slope = np.where(power > 0, (base * moved).sum(axis=(1, 3)) / power, np.nan)
    rest = moved - np.nan_to_num(slope)[:, None, :, None] * base
    freedom = 2 * seen.sum() - 2 * (count > 0).sum() - (power > 0).sum()
    sigma = float(np.sqrt(np.square(rest).sum() / freedom)) if freedom > 0 and (power > 0).any() else float("nan")
    return _EpiLines(mean, at, slope, count, lever, sigma)


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
    lines: _EpiLines,
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
        return _whitened(corners, measured, view.seen[..., None])

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


def _all_parallel(observations: Observations, lines: _EpiLines) -> bool:
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


def _step_two(observations: Observations, lines: _EpiLines, first: _StepOne, *, distorted: bool = False) -> _StepTwo:
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
    covariance: _Covariance
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
        return _whitened(corners, measured, seen[..., None])

    fit = settle(model, camera, poses, names)
    squares = float(np.square(fit.linear.off).sum())
    sigma = float(np.sqrt(squares / max(count - unknown, 1)))
    residuals = np.where(seen[..., None], -fit.linear.off.reshape(measured.shape), np.nan)
    covariance = _covariance_of(fit.linear.information() / max(sigma, 1e-12) ** 2, names)
    return _Refined(fit.camera, fit.poses, residuals, float(np.sqrt(squares / seen.sum())), sigma, covariance)


# --- the fit on what all views say of a corner ------------------------------------------------------------------------


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
        return _whitened(model, self.values[:, None], 1 / self.sigma[:, None])


def corner_statistics(observations: Observations, lines: _EpiLines, sigma: float) -> _CornerStatistics:
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
    covariance: _Covariance
    """Covariance of the shared parameters, poses eliminated."""
    pose_by_shared: Array
    """Derivative of each board's best pose by the shared parameters, shape (b, 6, p)."""
    scales: tuple[float, float] = (1.0, 1.0)
    """Scatter of places and of slopes about the model over what the views' scatter about their lines promises: 1 where
    the model holds."""
    systematic: Array = np.zeros((0, 3))
    """Standard deviations of what corners' scatter does not show, as independent shifts of (A, m, 1/d_2), (k, 3)."""


def _fit_statistics(
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
    return StatisticsFit(camera, poses, statistics, _covariance_of(linear.information(), names), follow)


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


# --- least squares with one pose a board ------------------------------------------------------------------------------


class Linear(NamedTuple):
    """A whitened model at one point."""

    off: Array
    """Residuals, shape (b, r)."""
    shared: Array
    """Derivatives by the shared parameters, shape (b, r, p)."""
    own: Array
    """Derivatives by the board's pose, shape (b, r, 6)."""

    def eliminated(self) -> Linear:
        """Residuals and shared columns without what poses take up, in `off` and `shared`.

        `own` is then an orthonormal basis of what poses take up.
        """
        length = np.sqrt(np.square(self.own).sum(axis=1, keepdims=True))
        basis = np.linalg.qr(self.own / np.where(length > 0, length, 1.0))[0]
        turned = np.swapaxes(basis, 1, 2)
        off = self.off - (basis @ (turned @ self.off[..., None]))[..., 0]
        return Linear(off, self.shared - basis @ (turned @ self.shared), basis)

    def information(self) -> Array:
        """Fisher information on the shared parameters, poses eliminated (Schur complement), shape (p, p).

        Computed from residuals of projections, not from a difference of products.
        """
        free = self.eliminated().shared
        return np.asarray(np.einsum("brp,brq->pq", free, free))


def _whitened(model: ProjectedCorners, measured: Array, weight: Array | NDArray[np.bool_]) -> Linear:
    """Corners where they are modelled minus `measured`, both (b, v, n, k), in units of their errors 1/`weight`."""
    share = np.zeros(measured.shape) + weight
    off = ((model.values - measured) * share).reshape(*model.values.shape[:-3], -1)
    if not model.by_pose.size:
        return Linear(off, model.by_globals, model.by_pose)
    shared, own = ((part * share[..., None]).reshape(len(off), -1, part.shape[-1]) for part in model[1:])
    return Linear(off, shared, own)


class _SettledFit(NamedTuple):
    """A least-squares fit of a camera and its boards' poses."""

    camera: Intrinsics
    poses: Poses
    linear: Linear
    done: bool
    """False where it ran out of evaluations."""


def settle(
    model: Callable[[Array, Array, bool], Linear],
    camera: Intrinsics,
    poses: Poses,
    names: tuple[str, ...],
    far: float | None = None,
) -> _SettledFit:
    """Fit the shared parameters `names` and all poses by least squares, from `camera` and `poses`.

    `model` takes all `GLOBALS`, poses (b, 6) and whether to differentiate; `shared` then has their columns. With
    `far`, residuals beyond it count by Huber's loss: linearly.
    """
    from scipy.optimize import least_squares

    count, columns = len(names), [GLOBALS.index(name) for name in names]

    def at(x: Array, derivatives: bool) -> Linear:
        return model(camera.with_values(names, x[:count]).vector(), x[count:].reshape(-1, 6), derivatives)

    def residuals(x: Array) -> Array:
        return at(x, False).off.ravel()

    def jacobian(x: Array) -> Array:
        linear = at(x, True)
        boards, rows = linear.off.shape
        full = np.zeros((boards, rows, len(x)))
        full[..., :count] = linear.shared[..., columns]
        for b in range(boards):
            full[b, :, count + 6 * b : count + 6 * b + 6] = linear.own[b]
        return full.reshape(boards * rows, -1)

    way: dict[str, Any] = {"method": "lm"} if far is None else {"method": "trf", "loss": "huber", "f_scale": far}
    run = least_squares(
        residuals, np.concatenate([camera.vector(names), poses.vector.ravel()]), jacobian,
        x_scale="jac", xtol=1e-12, ftol=1e-12, max_nfev=_MOST, **way,
    )  # fmt: skip
    linear = at(run.x, True)
    linear = linear._replace(shared=linear.shared[..., columns])
    best = camera.with_values(names, run.x[:count])
    return _SettledFit(best, Poses.from_vector(run.x[count:]), linear, bool(run.success))


class _Covariance(NamedTuple):
    """Covariance of a fit's shared parameters."""

    names: tuple[str, ...]
    matrix: Array
    """Covariance, shape (p, p)."""
    condition: float
    """Condition number of the normal matrix with its columns scaled to unit length."""

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(self.names, np.sqrt(np.diag(self.matrix)).tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """Correlation matrix, shape (p, p)."""
        sigma = np.sqrt(np.diag(self.matrix))
        return np.asarray(self.matrix / np.outer(sigma, sigma))

    def part(self, names: Sequence[str]) -> Array:
        """Covariance of the parameters named, in their order."""
        at = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(at, at)]


def _covariance_of(information: Array, names: tuple[str, ...]) -> _Covariance:
    """Invert an information matrix after scaling it to unit diagonal.

    Raises
    ------
    CalibrationError
        A parameter has no information at all, or the matrix is singular: names what is lost.
    """
    diagonal = np.diag(information)
    typical = np.array([_SCALES.get(name, 1.0) for name in names])
    blind = ~(diagonal * typical**2 > 1e-12)
    if blind.any():
        raise CalibrationError(f"the images do not determine {_symbols(names, blind)}")
    scale = 1 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if values[0] < 1e-13 * values[-1]:
        share = np.abs(vectors[:, 0]) * scale / typical
        raise CalibrationError(f"the images do not determine {_symbols(names, share > 0.1 * share.max())}: rank loss")
    inverse = (vectors / values) @ vectors.T
    return _Covariance(names, inverse * np.outer(scale, scale), float(values[-1] / values[0]))


def _symbols(names: Sequence[str], chosen: NDArray[np.bool_]) -> str:
    return ", ".join("d_2" if name == "inverse_d_2" else name for name, one in zip(names, chosen, strict=True) if one)


def undetermined(covariance: _Covariance, camera: Intrinsics, boards: int) -> str:
    """Which of A, m, d_2 so many boards leave open; "" where none.

    Those with a standard deviation above 30 % of their value; A already where parallel boards would seem to tell it as
    well. Of a board tilted by t, the foreshortening t^2/2 against the perspective, which goes with t/A, gives A: its
    relative error is 1/(2 sqrt(S)), with S the sum of squares of two foreshortenings a board over their variance.
    Parallel boards have an S, too: chi^2 with two degrees of freedom a board, the fit takes noise for tilts and finds
    an A several times too large.
    """
    from scipy.special import chdtri

    names = covariance.names[:3]
    sigma = np.sqrt(np.diag(covariance.matrix))[:3]
    most = np.array([min(_LOST, 0.5 / math.sqrt(chdtri(2 * boards, _CHANCE))), _LOST, _LOST])
    return _symbols(names, sigma > most * np.abs(camera.vector(names)))
