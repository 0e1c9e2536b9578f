"""The whole calibration: lines, step one, step two, joint refinement, and the fit that a posterior starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..theory.calibration import BackSubstituted, back_substitute
from .board import Observations
from .corner_statistics import corner_statistics
from .datasheet import DataSheet
from .errors import CalibrationError
from .fisher import undetermined
from .homography import homography, parallel
from .lines import EpiLines, fit_lines
from .model import Poses
from .refine import Refined, refine, shared_names
from .statistics_fit import StatisticsFit, fit_statistics
from .step_one import StepOne, step_one
from .step_two import StepTwo, step_two


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
        joint = refine(observations, second.camera, first.poses, distortion=distortion)
        camera = joint.camera
        lost = undetermined(joint.covariance, {"A": camera.A, "m": camera.m, "inverse_d_2": camera.inverse_d_2})
        if lost:
            raise CalibrationError(f"{', '.join(lost)} not determined to 30 %: {_why(joint.poses)}")
    except CalibrationError as error:
        if _all_parallel(observations, lines):
            raise CalibrationError(
                "A, x_0 and y_0 (and with them d_2, H and d_3) are not determined: the boards are all parallel, as far"
                " as their corners tell; tilt them by 20 degrees in several directions"
            ) from error
        raise
    sigma = lines.sigma if lines.sigma > 0 else joint.sigma
    fit = fit_statistics(corner_statistics(observations, sigma, lines), camera, joint.poses, shared_names(distortion))
    stepwise = back_substitute(sheet.f, second.camera.A, second.camera.m)
    refined = back_substitute(sheet.f, camera.A, camera.m)
    return Calibration(observations, lines, first, second, joint, fit, stepwise, refined)


def _all_parallel(observations: Observations, lines: EpiLines) -> bool:
    central = lines.central
    seen = np.isfinite(central[..., 0]) & np.isfinite(central[..., 1])
    if (seen.sum(axis=1) < 4).any() or not lines.sigma > 0:
        return False
    plane = [observations.points[s, :2] for s in seen]
    image = [c[s] for s, c in zip(seen, central, strict=True)]
    maps = np.stack([homography(p, c) for p, c in zip(plane, image, strict=True)])
    return parallel(plane, image, maps, lines.sigma / float(np.sqrt(np.median(lines.views[lines.views > 0]))))


def _why(poses: Poses) -> str:
    depth, count = poses.translation[:, 2], len(poses.rotation)
    if np.ptp(depth) < 0.02 * depth.mean():
        near = f"{depth.mean():.1f} mm from the pupil, within {np.ptp(depth):.2f} mm"
        return f"the boards stand at one depth ({near}); spread their distances"
    return f"{count} boards are too few, their tilts too small, or their corners too noisy"
