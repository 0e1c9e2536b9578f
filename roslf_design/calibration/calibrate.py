"""The whole calibration: steps, joint fit, and the fit on the corners' statistics that intervals come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..theory.light_field import BackSubstituted, back_substitute
from .datasheet import DataSheet
from .frames import Array, CalibrationError
from .model import GLOBALS, Intrinsics, Observations, Poses, ProjectedCorners, project_boards
from .steps import (
    Covariance,
    EpiLines,
    Linear,
    Refined,
    StepOne,
    StepTwo,
    all_parallel,
    covariance_of,
    fit_lines,
    refine,
    settle,
    shared_names,
    step_one,
    step_two,
    undetermined,
    whitened,
)


@dataclass(frozen=True, eq=False)
class CornerStatistics:
    """What all views say of each corner, in three numbers: a sufficient summary of the observations."""

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

    def model(self, camera: Array, pose: Array, derivatives: bool = True) -> ProjectedCorners:
        """Where `project_boards` puts them: values (b, n, 3), derivatives (b, n, 3, 9) and (b, n, 3, 6)."""
        both = project_boards(camera, pose, self.points, self.at[:, None], self.share[:, None], derivatives)
        return ProjectedCorners(*(part[:, 0] if part.ndim > 1 else part for part in both))

    def linear(self, camera: Array, pose: Array, derivatives: bool = True) -> Linear:
        """The model's residuals, in standard deviations."""
        return whitened(self.model(camera, pose, derivatives), self.values, 1 / self.sigma)


def corner_statistics(observations: Observations, sigma: float, lines: EpiLines | None = None) -> CornerStatistics:
    """Summarise observations whose coordinates have independent errors of `sigma` [pitches]."""
    fit = fit_lines(observations) if lines is None else lines
    seen, sloped = fit.views > 0, np.isfinite(fit.slope)
    base = np.where(observations.seen[..., None], observations.views[None, :, None, :] - fit.at[:, None], 0.0)
    along = np.square(base[..., 0]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.where(seen, sigma / np.sqrt(fit.views), np.inf)
        slope = np.where(sloped, sigma / np.sqrt(fit.lever), np.inf)
        share = np.where(fit.lever > 0, along / fit.lever, 0.5)
    values = np.concatenate([np.where(seen[..., None], fit.mean, 0), np.where(sloped, fit.slope, 0)[..., None]], -1)
    at = np.where(seen[..., None], fit.at, 0.0)
    return CornerStatistics(observations.points, values, at, share, np.stack([place, place, slope], axis=-1))


class StatisticsFit(NamedTuple):
    """The fit, and how the boards follow the camera."""

    camera: Intrinsics
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


def fit_statistics(
    statistics: CornerStatistics, camera: Intrinsics, poses: Poses, names: tuple[str, ...], *, scale: bool = True
) -> StatisticsFit:
    """Fit the shared parameters `names` and all poses to the statistics.

    Errors of a corner in neighbouring views are seldom independent (interpolation, diffraction, the detector's own
    bias). With `scale`, the scatter about the model of places and of slopes, each over its own degrees of freedom,
    replaces what independence would promise. `camera` and `poses` are where to start, near the solution.

    Raises
    ------
    CalibrationError
        A parameter is not determined, or the fit does not settle.
    """
    scales = np.ones(2)
    data = statistics
    for _ in range(3 if scale else 1):
        fit = settle(data.linear, camera, poses, names)
        if not fit.done:
            raise CalibrationError("the fit of the camera does not settle: the boards' views hardly determine it")
        camera, poses = fit.camera, fit.poses
        if scale:
            scales *= _scatter(fit.linear)
            data = replace(statistics, sigma=statistics.sigma * scales[[0, 0, 1]])
    place, slope = map(float, scales)
    return fit_at(data, camera, poses, names)._replace(place_scale=place, slope_scale=slope)


def fit_at(statistics: CornerStatistics, camera: Intrinsics, poses: Poses, names: tuple[str, ...]) -> StatisticsFit:
    """What a fit that ended at this camera and these poses would say of its errors."""
    linear = statistics.linear(camera.vector(), poses.vector)
    linear = linear._replace(shared=linear.shared[..., [GLOBALS.index(name) for name in names]])
    follow = -np.linalg.pinv(linear.own) @ linear.shared
    return StatisticsFit(camera, poses, statistics, covariance_of(linear.information(), names), 1.0, 1.0, follow)


def _scatter(linear: Linear) -> tuple[float, float]:
    """Scatter of places and slopes over their standard deviations, each by its own degrees of freedom."""
    free = linear.eliminated()
    flat = free.shared.reshape(-1, free.shared.shape[-1])
    basis = np.linalg.qr(flat / np.sqrt(np.square(flat).sum(axis=0)))[0]
    taken = np.square(basis).sum(axis=1) + np.square(free.own).sum(axis=-1).ravel()
    off, used = linear.off.ravel(), (linear.own != 0).any(axis=-1).ravel()
    sloped = np.arange(off.size) % 3 == 2
    scales = []
    for rows in (used & ~sloped, used & sloped):
        freedom = rows.sum() - taken[rows].sum()
        scales.append(float(np.sqrt(np.square(off[rows]).sum() / freedom)) if freedom > 8 else 1.0)
    return scales[0], scales[1]


@dataclass(frozen=True, eq=False)
class Calibration:
    """What the boards say of the camera, by both ways."""

    observations: Observations
    lines: EpiLines
    first: StepOne
    """Zhang's method on the central view."""
    second: StepTwo
    """Eq. 12 on the epipolar slopes."""
    joint: Refined
    """All corners in all views."""
    fit: StatisticsFit
    """The joint fit on the corners' statistics, noise judged by its scatter: what intervals come from."""
    stepwise: BackSubstituted
    """d_1, d_f, H, d_3 from steps one and two, with the data sheet's f."""
    refined: BackSubstituted
    """The same from the joint fit."""

    @property
    def missing(self) -> tuple[str, ...]:
        """Images in which no board was found."""
        return self.observations.missing


def calibrate(
    observations: Observations, sheet: DataSheet, *, distortion: int = 0, guess: float | None = None
) -> Calibration:
    """Calibrate the camera from a board's corners in the views of several light fields.

    Parameters
    ----------
    observations : Observations
    sheet : DataSheet
        f, q and d.
    distortion : int
        Radial coefficients to find: 0, 1 or 2.
    guess : float, optional
        A [mm] to start from, such as the design's.

    Raises
    ------
    CalibrationError
        The boards do not determine the camera: says which parameter is lost, and why.
    """
    if len(observations.names) < 2:
        raise CalibrationError(
            "one image of the board cannot tell its distance from A; show two or more, tilted differently"
        )
    lines = fit_lines(observations)
    try:
        first = step_one(observations, lines, sheet.q, sheet.d, distortion=distortion, guess=guess)
        second = step_two(observations, lines, first)
        joint = refine(observations, second.camera, first.poses, shared_names(distortion))
        lost = undetermined(joint.covariance, joint.camera)
        if lost:
            raise CalibrationError(f"{', '.join(lost)} not determined to 30 %: {_why(joint.poses)}")
    except CalibrationError as error:
        if all_parallel(observations, lines):
            raise CalibrationError(
                "A, x_0 and y_0 (and with them d_2, H and d_3) are not determined: the boards are all parallel, as far"
                " as their corners tell; tilt them by 20 degrees in several directions"
            ) from error
        raise
    camera, sigma = joint.camera, lines.sigma if lines.sigma > 0 else joint.sigma
    fit = fit_statistics(corner_statistics(observations, sigma, lines), camera, joint.poses, shared_names(distortion))
    stepwise, refined = (back_substitute(sheet.f, c.A, c.m) for c in (second.camera, camera))
    return Calibration(observations, lines, first, second, joint, fit, stepwise, refined)


def _why(poses: Poses) -> str:
    depth, count = poses.translation[:, 2], len(poses.rotation)
    if np.ptp(depth) < 0.02 * depth.mean():
        near = f"{depth.mean():.1f} mm from the pupil, within {np.ptp(depth):.2f} mm"
        return f"the boards stand at one depth ({near}); spread their distances"
    return f"{count} boards are too few, their tilts too small, or their corners too noisy"
