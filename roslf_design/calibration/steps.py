"""Lines through the views, step one (Zhang's method), step two (Eq. 12), and the joint fit of all corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .corners import homography
from .frames import Array, CalibrationError
from .model import (
    GLOBALS,
    Intrinsics,
    Observations,
    Poses,
    ProjectedCorners,
    observed,
    project_boards,
    rotation_matrix,
)

_MOST = 200
"""Most evaluations: fits that are determined take 4 to 20, one that is not would wander on."""
_SCALES = {"A": 100.0, "m": 0.4, "inverse_d_2": 0.5, "x_0": 100.0, "y_0": 100.0, "k_1": 10.0, "k_2": 1000.0}
_LOST = 0.3
"""Relative standard deviation of A, m or d_2 above which it counts as not determined."""


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
        """What poses cannot take up, as `off` and `shared`; `own` is then an orthonormal basis of what they can."""
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


def whitened(model: ProjectedCorners, measured: Array, weight: Array | NDArray[np.bool_]) -> Linear:
    """Corners where they are modelled minus `measured`, both (b, ..., n, k), in units of their errors 1/`weight`."""
    boards, share = len(measured), np.zeros(measured.shape) + weight
    off = ((model.values - measured) * share).reshape(boards, -1)
    if not model.by_pose.size:
        return Linear(off, model.by_globals, model.by_pose)
    shared, own = (part * share[..., None] for part in (model.by_globals, model.by_pose))
    return Linear(off, shared.reshape(boards, -1, len(GLOBALS)), own.reshape(boards, -1, 6))


class SettledFit(NamedTuple):
    """A least-squares fit of a camera and its boards' poses."""

    camera: Intrinsics
    poses: Poses
    linear: Linear
    done: bool
    """False where it ran out of evaluations."""


def settle(
    model: Callable[[Array, Array, bool], Linear], camera: Intrinsics, poses: Poses, names: tuple[str, ...]
) -> SettledFit:
    """Fit the shared parameters `names` and all poses by Levenberg-Marquardt, from `camera` and `poses`.

    `model` takes the nine `GLOBALS`, poses (b, 6) and whether to differentiate; `shared` then has their columns.
    """
    from scipy.optimize import least_squares

    count, columns = len(names), [GLOBALS.index(name) for name in names]

    def at(x: Array, derivatives: bool) -> Linear:
        return model(camera.with_values(names, x[:count]).vector(), x[count:].reshape(-1, 6), derivatives)

    def jacobian(x: Array) -> Array:
        linear = at(x, True)
        boards, rows = linear.off.shape
        full = np.zeros((boards, rows, len(x)))
        full[..., :count] = linear.shared[..., columns]
        for b in range(boards):
            full[b, :, count + 6 * b : count + 6 * b + 6] = linear.own[b]
        return full.reshape(boards * rows, -1)

    start = np.concatenate([camera.vector(names), poses.vector.ravel()])

    def residuals(x: Array) -> Array:
        return at(x, False).off.ravel()

    run = least_squares(
        residuals, start, jacobian,
        method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12, max_nfev=_MOST,
    )  # fmt: skip
    linear = at(run.x, True)
    linear = linear._replace(shared=linear.shared[..., columns])
    best = camera.with_values(names, run.x[:count])
    return SettledFit(best, Poses.from_vector(run.x[count:]), linear, bool(run.success))


class Covariance(NamedTuple):
    """How well a fit knows its shared parameters."""

    names: tuple[str, ...]
    matrix: Array
    """Covariance, shape (p, p)."""
    condition: float
    """Condition number of the normal matrix with its columns scaled to unit length."""

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return {name: float(value) for name, value in zip(self.names, np.sqrt(np.diag(self.matrix)), strict=True)}

    @property
    def correlation(self) -> Array:
        """Correlation matrix, shape (p, p)."""
        sigma = np.sqrt(np.diag(self.matrix))
        return np.asarray(self.matrix / np.outer(sigma, sigma))

    def part(self, names: Sequence[str]) -> Array:
        """Covariance of the parameters named, in their order."""
        at = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(at, at)]


def covariance_of(information: Array, names: tuple[str, ...]) -> Covariance:
    """Invert an information matrix after scaling it to unit diagonal.

    Raises
    ------
    CalibrationError
        A parameter has no information at all, or the matrix is singular: names what is lost.
    """
    diagonal = np.diag(information)
    typical = np.array([_SCALES.get(name, 1.0) for name in names])
    blind = [n for n, d, t in zip(names, diagonal, typical, strict=True) if not d * t * t > 1e-12]
    if blind:
        raise CalibrationError(f"the images do not determine {', '.join(map(_symbol, blind))}")
    scale = 1 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    condition = float(values[-1] / max(values[0], 1e-300))
    if values[0] < 1e-13 * values[-1]:
        share = np.abs(vectors[:, 0]) * scale / typical
        lost = [n for n, s in zip(names, share, strict=True) if s > 0.1 * share.max()]
        raise CalibrationError(f"the images do not determine {', '.join(map(_symbol, lost))}: rank loss")
    inverse = (vectors / values) @ vectors.T
    return Covariance(names, inverse * np.outer(scale, scale), condition)


def undetermined(covariance: Covariance, camera: Intrinsics) -> list[str]:
    """Parameters whose standard deviation exceeds 30 % of their value (A, m, d_2 only), in the paper's symbols."""
    sigma = covariance.sigma
    checked = [name for name in ("A", "m", "inverse_d_2") if name in sigma]
    return [_symbol(name) for name in checked if sigma[name] > _LOST * abs(getattr(camera, name))]


def _symbol(name: str) -> str:
    return {"inverse_d_2": "d_2"}.get(name, name)


def shared_names(distortion: int) -> tuple[str, ...]:
    """Names of the shared parameters that a fit with so many radial coefficients finds."""
    if distortion not in (0, 1, 2):
        raise ValueError(f"distortion must be 0, 1 or 2 radial coefficients, got {distortion}")
    return GLOBALS[: 5 + distortion]


# --- lines through the views ------------------------------------------------------------------------------------------


class EpiLines(NamedTuple):
    """Lines u = u_mean + slope (s - s_mean), v = v_mean + slope (t - t_mean) of board b's corner n.

    Means and slope are independent for independent errors of the corners, and hold all that the views say of a corner
    but for distortion's second order in the baseline (1e-3 px in the paper's system).
    """

    mean: Array
    """(u, v) averaged over the views that saw the corner [pitches], shape (b, n, 2); NaN where fewer than one did."""
    at: Array
    """The same average of (s', t') [px], shape (b, n, 2)."""
    slope: Array
    """Du/Ds' = Dv/Dt' [pitches/px], shape (b, n); NaN without a baseline."""
    views: Array
    """Views that saw the corner, shape (b, n)."""
    lever: Array
    """Sum of squared baselines of both axes [px^2], shape (b, n): slopes have variance sigma^2 over it."""
    sigma: float
    """Standard deviation of one coordinate about its line [pitches]; NaN with one view only."""

    @property
    def central(self) -> Array:
        """(u, v) in the central view [pitches], shape (b, n, 2)."""
        return self.mean - np.nan_to_num(self.slope)[..., None] * self.at


def fit_lines(observations: Observations) -> EpiLines:
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
    count = seen.sum(axis=1).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = (seen / count[:, None])[..., None]
        uv = np.where(seen[..., None], observations.uv, 0.0)
        st = np.broadcast_to(observations.views[None, :, None, :], uv.shape)
        mean, at = (weight * uv).sum(axis=1), (weight * st).sum(axis=1)
        mean[count == 0] = np.nan
        base = np.where(seen[..., None], st - at[:, None], 0.0)
        lever = np.square(base).sum(axis=(1, 3))
        moved = np.where(seen[..., None], observations.uv - mean[:, None], 0.0)
        slope = np.where(lever > 0, (base * moved).sum(axis=(1, 3)) / lever, np.nan)
    rest = moved - np.nan_to_num(slope)[:, None, :, None] * base
    freedom = 2 * seen.sum() - 2 * (count > 0).sum() - (lever > 0).sum()
    sigma = float(np.sqrt(np.square(rest).sum() / freedom)) if freedom > 0 and (lever > 0).any() else float("nan")
    return EpiLines(mean, at, slope, count, lever, sigma)


# --- step one ---------------------------------------------------------------------------------------------------------


class StepOne(NamedTuple):
    """The central view's calibration."""

    camera: Intrinsics
    """A, x_0, y_0, k_1, k_2 found; m and 1/d_2 not yet."""
    poses: Poses
    rms: float
    """Reprojection error in the central view: RMS distance [pitches] from measured to modelled corner."""


def step_one(
    observations: Observations,
    lines: EpiLines,
    pixel_pitch: float,
    microlens_pitch: float,
    *,
    distortion: int = 0,
    guess: float | None = None,
) -> StepOne:
    """Zhang's method on the central view gives A, the axis, distortion and the boards' poses.

    `lines`, of the observations, put each corner in the central view with the help of all views; `guess` is an A [mm]
    to start from where the boards' tilts leave it open.

    Raises
    ------
    CalibrationError
        The boards do not determine A or the axis: all parallel.
    """
    central = lines.central
    seen = observed(central)
    if (seen.sum(axis=1) < 4).any():
        few = [observations.names[k] for k in np.flatnonzero(seen.sum(axis=1) < 4)]
        raise CalibrationError(f"fewer than four corners were seen of {', '.join(few)}")
    maps = np.stack([homography(observations.points[s, :2], c[s]) for s, c in zip(seen, central, strict=True)])
    middle = np.nanmean(central, axis=(0, 1))
    start = _zhang(maps, middle)
    if start is None and guess is None:
        raise CalibrationError(
            "the boards do not determine A: their perspective shows no tilt; tilt them by 20 degrees or more, in"
            " several directions"
        )
    focal, x_0, y_0 = start if start is not None else (guess / microlens_pitch, *middle)  # type: ignore[operator]
    camera = Intrinsics(focal * microlens_pitch, 0.0, 0.0, x_0, y_0, q=pixel_pitch, d=microlens_pitch)
    view = Observations(observations.points, np.zeros((1, 2)), central[:, None], observations.names)
    fit = refine(view, camera, _poses_from(maps, focal, (x_0, y_0)), ("A", *shared_names(distortion)[3:]))
    if fit.camera.A < 0:  # the mirrored solution: depth and A change sign together
        raise CalibrationError("step one went astray: the boards' poses do not fit a camera in front of them")
    return StepOne(fit.camera, fit.poses, fit.rms)


def _zhang(homographies: Array, middle: Array) -> tuple[float, float, float] | None:
    """Focal length and principal point of square pixels without skew, in closed form, in image units.

    Where the boards do not tell the principal point, `middle` stands in; None where they do not even tell the focal
    length then. The closed form only starts a fit.
    """
    shift = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1.0]])
    moved = shift @ homographies
    scale = max(100.0 * float(np.median(np.abs(moved[:, :2, :2]).max(axis=(1, 2)) / np.abs(moved[:, 2, 2]))), 1.0)
    moved = np.diag([1 / scale, 1 / scale, 1.0]) @ moved
    moved = moved / np.cbrt(np.abs(np.linalg.det(moved)))[:, None, None]

    def row(g: Array, h: Array) -> Array:
        """Coefficients of (a, b, c, e) in g' omega h, omega = [[a, 0, b], [0, a, c], [b, c, e]]."""
        (g0, g1, g2), (h0, h1, h2) = g.T, h.T
        return np.stack([g0 * h0 + g1 * h1, g0 * h2 + g2 * h0, g1 * h2 + g2 * h1, g2 * h2], axis=-1)

    h1, h2 = moved[..., 0], moved[..., 1]
    rows = np.concatenate([row(h1, h2), row(h1, h1) - row(h2, h2)])
    values, vectors = np.linalg.svd(rows)[1:]
    a, b, c, e = vectors[-1]
    if len(values) == 4 and values[2] > 1e-6 * values[0] and a != 0:
        x, y = -b / a, -c / a
        square = e / a - x * x - y * y
        if square > 0 and np.hypot(x, y) < np.sqrt(square):
            return float(np.sqrt(square) * scale), float(x * scale + middle[0]), float(y * scale + middle[1])
    power = float(rows[:, 3] @ rows[:, 3])
    square = -float(rows[:, 3] @ rows[:, 0]) / power if power > 0 else 0.0
    return (float(np.sqrt(square) * scale), float(middle[0]), float(middle[1])) if square > 0 else None


def _poses_from(homographies: Array, focal: float, centre: tuple[float, float]) -> Poses:
    """Boards' poses before a camera whose picture is turned round (u falls as X grows), from their homographies."""
    from scipy.spatial.transform import Rotation

    columns = np.linalg.inv(np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])) @ homographies
    columns = columns * np.sign(columns[:, 2:, 2:])
    columns = columns / np.sqrt(np.prod(np.linalg.norm(columns[..., :2], axis=1), axis=-1))[:, None, None]
    first, second, translation = np.moveaxis(columns, 2, 0)
    left, _, right = np.linalg.svd(np.stack([first, second, np.cross(first, second)], axis=-1))
    turned = np.diag([-1.0, -1.0, 1.0])
    return Poses(Rotation.from_matrix(turned @ left @ right).as_rotvec(), translation @ turned)


def all_parallel(observations: Observations, lines: EpiLines) -> bool:
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


class StepTwo(NamedTuple):
    """The line fit of Eq. 12."""

    camera: Intrinsics
    """With m and 1/d_2."""
    inverse_depth: Array
    """1/Z_F of every corner used [1/mm], shape (k,)."""
    slope: Array
    """Its measured slope [pitches/px], shape (k,)."""
    fitted: Array
    """The line's slope there, shape (k,)."""


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
    if not np.sqrt(power / np.sum(weight**2)) > 1e-9 * abs(centre):
        raise CalibrationError(
            "all corners lie at one depth: d_2 and m are not determined; show boards at several distances"
        )
    # Both sums centred: the rounding of the mean of 1/Z would else enter times the mean slope, as 1/gap^2.
    beta = float(np.sum(weight**2 * away * (slope - alpha))) / power
    fitted = alpha + beta * away
    if beta >= 0:
        raise CalibrationError(
            "the epipolar slopes do not fall with inverse depth: the boards stand too nearly at one depth for d_2 and"
            " m, or the views are mirrored"
        )
    A, q, d = camera.A, camera.q, camera.d
    m = A * (centre - alpha / beta)
    if m <= 0:
        raise CalibrationError(f"step two found m = {m:.3g}: the boards' depths do not determine d_2 and m")
    best = camera.with_values(("m", "inverse_d_2"), np.array([m, -beta * d / (q * A * A)]))
    return StepTwo(best, inverse, slope, fitted)


# --- the joint fit ----------------------------------------------------------------------------------------------------


class Refined(NamedTuple):
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
    """Of the shared parameters, for independent errors of `sigma`."""


def refine(observations: Observations, camera: Intrinsics, poses: Poses, names: tuple[str, ...]) -> Refined:
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
    return Refined(fit.camera, fit.poses, residuals, float(np.sqrt(squares / seen.sum())), sigma, covariance)
