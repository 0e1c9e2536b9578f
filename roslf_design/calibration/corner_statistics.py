"""What all views say of each corner, in three numbers: where the model puts them, and how noisy they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .board import Observations
from .lattice import Array
from .lines import EpiLines, fit_lines
from .model import GLOBALS, cross_matrix, right_jacobian, rotation_matrix


@dataclass(frozen=True, eq=False)
class CornerStatistics:
    """Mean place and slope of every corner, with standard deviations; a sufficient summary of the observations."""

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

    def scaled(self, place: float, slope: float) -> CornerStatistics:
        """The same with the places' and the slopes' standard deviations multiplied."""
        return CornerStatistics(
            self.points, self.values, self.at, self.share, self.sigma * np.array([place, place, slope])
        )


def corner_statistics(observations: Observations, sigma: float, lines: EpiLines | None = None) -> CornerStatistics:
    """Summarise observations whose coordinates have independent errors of `sigma` [pitches]."""
    found = fit_lines(observations) if lines is None else lines
    seen = found.views > 0
    sloped = np.isfinite(found.slope)
    base = np.where(observations.seen[..., None], observations.views[None, :, None, :] - found.at[:, None], 0.0)
    along = np.square(base[..., 0]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread_place = np.where(seen, sigma / np.sqrt(found.views), np.inf)
        spread_slope = np.where(sloped, sigma / np.sqrt(found.lever), np.inf)
        share = np.where(found.lever > 0, along / found.lever, 0.5)
    values = np.concatenate([np.where(seen[..., None], found.mean, 0), np.where(sloped, found.slope, 0)[..., None]], -1)
    spread = np.stack([spread_place, spread_place, spread_slope], axis=-1)
    return CornerStatistics(observations.points, values, np.where(seen[..., None], found.at, 0.0), share, spread)


class Modelled(NamedTuple):
    """Model of the statistics."""

    values: Array
    """Shape (b, n, 3)."""
    by_globals: Array
    """Derivatives by `GLOBALS`, shape (b, n, 3, 9)."""
    by_pose: Array
    """Derivatives by the board's pose, shape (b, n, 3, 6)."""


def model_statistics(camera: Array, pose: Array, statistics: CornerStatistics) -> Modelled:
    """Place and slope of each corner with derivatives: the model of `project_boards` and its derivative by the view.

    Parameters
    ----------
    camera : ndarray
        The nine `GLOBALS`.
    pose : ndarray
        Shape (b, 6).
    statistics : CornerStatistics
        For the corners, mean views and baselines.
    """
    A, m, inverse_d_2, x_0, y_0, k_1, k_2, q, d = camera
    step = q * A * inverse_d_2
    turn = rotation_matrix(pose[:, :3])
    scene = np.einsum("bij,nj->bni", turn, statistics.points) + pose[:, None, 3:]
    z = scene[..., 2]
    pupil = -step * statistics.at
    slope = (scene[..., :2] - pupil) / z[..., None]
    r2 = (slope * slope).sum(axis=-1)
    gain, bend, curl = 1 + r2 * (k_1 + k_2 * r2), k_1 + 2 * k_2 * r2, 2 * k_2
    weights = np.stack([statistics.share, 1 - statistics.share], axis=-1)
    tilted = (weights * slope * slope).sum(axis=-1)
    stretch = gain + 2 * bend * tilted
    place = np.array([x_0, y_0]) - (A * gain[..., None] * slope + m * pupil) / d
    values = np.concatenate([place, (step / d * (m - A * stretch / z))[..., None]], axis=-1)

    tensor = gain[..., None, None] * np.eye(2) + (2 * bend)[..., None, None] * slope[..., :, None] * slope[..., None, :]
    stretch_by_slope = 2 * bend[..., None] * slope + 4 * curl * tilted[..., None] * slope
    stretch_by_slope = stretch_by_slope + 4 * bend[..., None] * weights * slope
    by_pupil = (A / d) * tensor / z[..., None, None] - (m / d) * np.eye(2)
    moved = np.einsum("bnij,bnj->bni", by_pupil, statistics.at)
    slope_moved = (stretch_by_slope * statistics.at).sum(axis=-1) / z  # minus d(stretch) per unit of `step`, negated
    rate = m - A * stretch / z
    by_globals = np.zeros((*values.shape, len(GLOBALS)), values.dtype)
    # The pupil moves with A, 1/d_2 and q through `step`; d(slope)/d(step) = at/z.
    for column, by_step in ((0, q * inverse_d_2), (2, q * A), (7, A * inverse_d_2)):
        by_globals[..., :2, column] = -by_step * moved
        by_globals[..., 2, column] = by_step / d * (rate - step * A / z * slope_moved)
    by_globals[..., :2, 0] += -gain[..., None] * slope / d
    by_globals[..., 2, 0] += -step / d * stretch / z
    by_globals[..., :2, 1] = -pupil / d
    by_globals[..., 2, 1] = step / d
    by_globals[..., 0, 3] = by_globals[..., 1, 4] = 1.0
    for column, power in ((5, r2), (6, r2 * r2)):
        by_globals[..., :2, column] = -(A / d) * power[..., None] * slope
    by_globals[..., 2, 5] = -step * A / (d * z) * (r2 + 2 * tilted)
    by_globals[..., 2, 6] = -step * A / (d * z) * (r2 * r2 + 4 * r2 * tilted)
    by_globals[..., :2, 8] = (A * gain[..., None] * slope + m * pupil) / (d * d)
    by_globals[..., 2, 8] = -values[..., 2] / d

    slope_by_scene = np.concatenate([np.broadcast_to(np.eye(2), (*slope.shape, 2)), -slope[..., None]], axis=-1)
    slope_by_scene = slope_by_scene / z[..., None, None]
    by_scene = np.empty((*values.shape, 3), values.dtype)
    by_scene[..., :2, :] = -(A / d) * tensor @ slope_by_scene
    by_scene[..., 2, :] = -(step * A / (d * z))[..., None] * np.einsum(
        "bni,bnij->bnj", stretch_by_slope, slope_by_scene
    )
    by_scene[..., 2, 2] += step * A / d * stretch / (z * z)
    twist = -turn[:, None] @ cross_matrix(statistics.points) @ right_jacobian(pose[:, None, :3])
    return Modelled(values, by_globals, np.concatenate([by_scene @ twist, by_scene], axis=-1))
