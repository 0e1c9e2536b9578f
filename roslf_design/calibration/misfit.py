"""Residuals of a fit, board by board, what would explain them, and whether the ways to the camera agree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .corner_statistics import Leftover, corner_statistics, leftover
from .fit import VISIBLE, Calibration, independent_sigma, shared_names
from .frames import Array
from .least_squares import Linear
from .model import GLOBALS, MOST_RADIAL, rotation_matrix

DISAGREE = 4.0
"""Standard deviations between two ways to one number from which they disagree."""
_STRAY = 5.0
"""Standard deviations from which a corner is told: scatter alone does not reach so far."""
SAMPLED = 0.012
"""Error of corners that views leave which sample once a microlens, the same in all of them where the board is sharp, so
that no scatter shows it [pitches]: 0.004 to 0.012 rms of ideal boards, of cells from 5 to 12 microlenses."""
_NAMES = GLOBALS[:3]


class _BoardMisfit(NamedTuple):
    """Misfit of one board."""

    name: str
    corners: int
    """Seen in any view."""
    rms: float
    """Reprojection error of the joint fit over all views [pitches]."""
    places: float
    """Scatter of its corners' places about the model over what their scatter from view to view promises."""
    slopes: float
    """Scatter of slopes, likewise; NaN where it has too few corners to tell."""
    strays: int
    """Corners so far off that they were given little weight."""


class _Remedy(NamedTuple):
    """A change that would explain a misfit."""

    what: str
    """Description as a clause."""
    scale: float
    """The larger of both scales with it."""
    distortion: int = 0
    """Radial coefficients that it fits; 0 where it is something else."""


@dataclass(frozen=True)
class Misfit:
    """Misfit of the joint fit."""

    places: float
    """Scatter of places about the model over what the views promise; 1 where the model holds."""
    slopes: float
    views: float
    """Common offset of the corners of one view of one board, RMS, over what their scatter promises."""
    boards: tuple[_BoardMisfit, ...]
    remedy: _Remedy | None
    """Remedy that would halve the larger scale, or bring it below 2; None where none is needed or none helps."""
    apart: dict[str, float]
    """A, m, 1/d_2 by steps one and two less those of the joint fit, in its standard deviations."""

    @property
    def scale(self) -> float:
        """The larger of both."""
        return max(self.places, self.slopes)

    @property
    def warnings(self) -> Iterator[str]:
        """Warnings before one believes the fit, each with its remedy."""
        rms = float(np.sqrt(np.mean([board.rms**2 for board in self.boards])))
        if self.slopes > VISIBLE or (self.places > VISIBLE and rms > SAMPLED):
            left = (
                f"corners lie {self.scale:.1f} times as far from the fitted camera as they scatter from view to view"
                f" (places {self.places:.1f}, slopes {self.slopes:.1f}; 1 where the model holds)"
            )
            if self.remedy is None:
                yield (
                    f"{left}: no single cause was found; is the board flat, are its cells even, sharp and 10"
                    " microlenses wide or more?"
                )
            else:
                yield f"{left}; {self.remedy.what} to {self.remedy.scale:.1f}"
        if self.views > VISIBLE:
            yield (
                f"the corners of a view lie off together, {self.views:.1f} times as far as scatter explains: views do"
                " not look from where their pixels say; are the design, the white image and the choice of diffraction"
                " right?"
            )
        astray = [f"{board.strays} of {board.corners} in {board.name}" for board in self.boards if board.strays]
        if astray:
            yield f"corners far from where the others put them weigh little: {', '.join(astray)}; look at these images"
        far = {name: off for name, off in self.apart.items() if abs(off) > DISAGREE}
        if far:
            symbols = {"inverse_d_2": "d_2"}
            said = ", ".join(f"{symbols.get(name, name)} by {abs(off):.1f} sigma" for name, off in far.items())
            yield f"steps one and two and the joint fit disagree: {said}; {self._believed}"

    @property
    def _believed(self) -> str:
        if self.scale <= VISIBLE:
            return "believe the joint fit: it weighs every corner by its error and leaves scatter only"
        if self.slopes > self.places:
            return "the slopes misfit: believe A, H and d_3 of step one, which knows no slopes, and no d_2 yet"
        return "believe neither before the misfit is mended"


def misfit_of(calibration: Calibration) -> Misfit:
    """Misfit of a calibration's fit, and its causes."""
    observations, lines, joint = calibration.observations, calibration.lines, calibration.joint
    fit, seen = calibration.fit, observations.seen
    scales = np.array(fit.scales)
    statistics = corner_statistics(observations, lines, independent_sigma(lines, joint))
    statistics = replace(statistics, sigma=statistics.sigma * scales[[0, 0, 1]])
    linear = statistics.linear(fit.camera.vector(), fit.poses.vector)
    columns = [GLOBALS.index(name) for name in fit.covariance.names]
    whole = linear._replace(shared=linear.shared[..., columns])
    left = leftover(whole)
    strays = (np.abs(left.off) > _STRAY).reshape(*seen.shape[::2], 3).any(axis=-1).sum(axis=1)
    boards = []
    for k, name in enumerate(observations.names):
        places, slopes = (scales * Leftover(left.off[k : k + 1], left.free[k : k + 1]).scales()).tolist()
        squares = np.square(joint.residuals[k][seen[k]]).sum(axis=-1)
        corners = int(seen[k].any(axis=0).sum())
        boards.append(_BoardMisfit(name, corners, float(np.sqrt(squares.mean())), places, slopes, int(strays[k])))
    worst = float(scales.max())
    remedy = None
    if worst > VISIBLE:
        remedies = list(_remedies(calibration, linear, whole, scales))
        best = min(remedies, key=lambda one: round(one.scale, 1), default=None)  # the simplest of those alike
        remedy = best if best is not None and best.scale < max(VISIBLE, worst / 2) else None
    spread = fit.covariance.part(_NAMES) + fit.systematic.T @ fit.systematic
    apart = (calibration.second.camera.vector(_NAMES) - fit.camera.vector(_NAMES)) / np.sqrt(np.diag(spread))
    return Misfit(
        float(scales[0]), float(scales[1]), _of_views(calibration), tuple(boards), remedy,
        dict(zip(_NAMES, apart.tolist(), strict=True)),
    )  # fmt: skip


def _of_views(calibration: Calibration) -> float:
    """Common offset of a view's corners from their own lines, RMS over views, over what their scatter promises."""
    observations, lines = calibration.observations, calibration.lines
    seen = observations.seen
    if not lines.sigma > 0:
        return 1.0
    along = observations.views[:, None] - lines.at[:, None]
    off = observations.uv - lines.mean[:, None] - np.nan_to_num(lines.slope)[:, None, :, None] * along
    count = seen.sum(axis=2)
    mean = np.where(seen[..., None], off, 0.0).sum(axis=2) / np.sqrt(np.maximum(count, 1))[..., None]
    freedom = 2 * (count > 0).sum() - 3 * len(seen)
    return float(np.sqrt(np.square(mean).sum() / freedom) / lines.sigma) if freedom > 0 else 1.0


def _remedies(calibration: Calibration, linear: Linear, whole: Linear, scales: Array) -> Iterator[_Remedy]:
    """Changes, and the larger scale with each, to first order."""

    def with_columns(more: Array) -> float:
        return _larger(whole._replace(shared=np.concatenate([whole.shared, more], axis=-1)), scales)

    fitted = calibration.fit.covariance.names
    radial = sum(name.startswith("k_") for name in fitted)
    for count in range(radial + 1, MOST_RADIAL + 1):
        more = [GLOBALS.index(name) for name in shared_names(count) if name not in fitted]
        yield _Remedy(f"distortion = {count} would take that", with_columns(linear.shared[..., more]), count)
    points = calibration.observations.points
    bow, height = _bow(calibration, linear, points)
    coefficients = _taken_up(whole._replace(shared=np.concatenate([whole.shared, bow], axis=-1)))[-3:]
    tall = float(np.ptp(height @ coefficients))
    yield _Remedy(
        f"a board bowed by {tall:.2g} mm would explain it: mount it flat, which takes that", with_columns(bow)
    )
    count = len(calibration.observations.names)
    for k in range(count if count > 2 else 0):
        name = calibration.observations.names[k]
        kept = np.arange(count) != k
        yield _Remedy(f"dropping {name} would take that", _larger(Linear(*(part[kept] for part in whole)), scales))


def _larger(linear: Linear, scales: Array) -> float:
    return float(np.nanmax(leftover(linear).scales() * scales))


def _bow(calibration: Calibration, linear: Linear, points: Array) -> tuple[Array, Array]:
    """Derivatives by a bow x^2, x y, y^2 of the board off its plane, shape (b, r, 3), and its heights, shape (n, 3)."""
    x, y = (points[:, :2] / np.abs(points[:, :2]).max()).T
    height = np.stack([x * x, x * y, y * y], axis=-1)
    plane = np.linalg.qr(np.stack([np.ones_like(x), x, y], axis=-1))[0]
    height = height - plane @ (plane.T @ height)
    normal = rotation_matrix(calibration.fit.poses.rotation)[..., 2]
    lifted = np.einsum("brk,bk->br", linear.own[..., 3:], normal)
    return lifted[..., None] * np.repeat(height, 3, axis=0), height


def _taken_up(linear: Linear) -> Array:
    """Coefficients of the shared columns that fit the residuals best."""
    free = linear.eliminated()
    columns = free.shared.reshape(-1, free.shared.shape[-1])
    size = np.sqrt(np.square(columns).sum(axis=0))
    return np.asarray(np.linalg.lstsq(columns / size, -free.off.ravel(), rcond=None)[0] / size)
