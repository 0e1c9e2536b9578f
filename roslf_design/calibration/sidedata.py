"""Side data of a calibration besides corners and data sheet: the white image's pitch, the boards' distances.

Both bear on f, q, d and the board's scale together with what the images say, so all are conditioned at once: states are
(shared parameters of the fit, f, q, d, relative scale of the board, the data sheet's elements), of p + 4 numbers or
more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .corner_statistics import StatisticsFit
from .frames import Array, CalibrationError
from .misfit import DISAGREE
from .model import DataSheet, derived

_STEPS = 20
NUDGE = 1e-6
"""Relative step of derivatives."""


@dataclass(frozen=True, eq=False)
class SideDatum:
    """Measurements besides the corners."""

    name: str
    """Name of the data as a source of variance: "white" or "distances"."""
    what: str
    """Description in a sentence."""
    off: Callable[[Array], Array]
    """Modelled less measured of states (n, p + 4), in standard deviations and independent, shape (n, k)."""
    rank: int
    """Numbers that they say."""


def white_pitch(fit: StatisticsFit, sheet: DataSheet, pitch: float, sigma: float) -> SideDatum:
    """The pitch of the microlens images in the white image [px], known to the relative standard deviation `sigma`.

    Image pitch/q = (d/q) (1 + d_2/L) with the exit pupil's vergence 1/L = (f - d_3)/(f A): with A, d_3 and d_2 from
    the images it ties f.
    """
    if not 0 < sigma < math.inf:
        raise CalibrationError(f"the white image's pitch needs a standard deviation above zero, got {sigma}")
    count = len(fit.covariance.names)

    def off(states: Array) -> Array:
        return (image_pitch(states[:, :count], sheet, states[:, count:].T) / pitch - 1)[:, None] / sigma

    return SideDatum("white", "the white image's pitch", off, 1)


def image_pitch(camera: Array, sheet: DataSheet, drawn: Array | None = None) -> Array:
    """Pitch of the microlens images [px]; arguments as of `derived`."""
    f, q, d, *_ = sheet.mean if drawn is None else drawn
    lengths = derived(camera, sheet, drawn)
    return np.asarray(d / q * (1 + lengths["d_2"] * (f - lengths["d_3"]) / (f * lengths["A"])))


def board_distances(
    fit: StatisticsFit, sheet: DataSheet, distances: Mapping[int, float], sigma: float, *, relative: bool
) -> SideDatum:
    """Distances of boards' middles, each with the standard deviation `sigma` [mm].

    Parameters
    ----------
    distances : mapping
        By the board's number in the fit, from the main lens along its axis [mm]; with `relative` from any one place, as
        a rail shows them, growing away from the camera.

    Raises
    ------
    CalibrationError
        A sigma that is not positive, or too few boards to say anything.
    """
    if not 0 < sigma < math.inf:
        raise CalibrationError(f"distances need a standard deviation above zero, got {sigma} mm")
    if len(distances) < (2 if relative else 1):
        raise CalibrationError("distances from an unknown place say something for two boards or more")
    boards, readings = np.array(list(distances)), np.array(list(distances.values()))
    count, names = len(fit.covariance.names), fit.covariance.names
    best, depth = fit.camera.vector(names), fit.poses.translation[boards, 2]
    # A board's own depth, once the camera is given.
    own = fit.statistics.linear(fit.camera.vector(), fit.poses.vector).own[boards]
    spread = np.sqrt(sigma**2 + np.linalg.inv(np.swapaxes(own, 1, 2) @ own)[:, 5, 5])
    common = 1 / spread / np.linalg.norm(1 / spread)

    def off(states: Array) -> Array:
        shared, drawn = states[:, :count], states[:, count:].T
        moved = depth + (shared - best) @ fit.pose_by_shared[boards, 5].T
        start = 0.0 if relative else sheet.apparent(derived(shared, sheet, drawn)).pupil[:, None]
        away = (moved * drawn[3][:, None] + start - readings) / spread
        return np.asarray(away - (away @ common)[:, None] * common if relative else away)

    return SideDatum("distances", "the boards' distances", off, len(boards) - relative)


@dataclass(frozen=True, eq=False)
class Combined:
    """Images, data sheet and side data together, to first order about the best state."""

    names: tuple[str, ...]
    """Names of the fit's shared parameters."""
    best: Array
    """Most probable state, shape (p + 4,)."""
    sources: tuple[str, ...]
    """Source of each row of `gain`, shape (k,)."""
    gain: Array
    """Change of the state for one standard deviation of each datum, shape (p + 4, k)."""
    jacobian: Array
    """Change of the data with the state, in their standard deviations, shape (k, p + 4)."""
    apart: Mapping[str, float]
    """How far each source lay from the rest, in standard deviations of both (root of chi^2 over its rank)."""
    data: tuple[SideDatum, ...] = ()

    @property
    def keeps(self) -> Array:
        """Share of errors of images and data sheet that the state keeps, shape (p + 4, p + 4)."""
        return np.asarray(np.eye(len(self.best)) - self.gain @ self.jacobian)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sources that contradict the rest."""
        what = {datum.name: datum.what for datum in self.data}
        return tuple(
            f"{what[name]} and the rest disagree by {far:.1f} sigma: check what was given of them, their sigma, f, q, d"
            " and the board's cell"
            for name, far in self.apart.items()
            if far > DISAGREE
        )

    @property
    def f(self) -> float:
        """Focal length of the best state [mm]."""
        return float(self.best[len(self.names)])

    def lengths(self, sheet: DataSheet) -> dict[str, Array]:
        """`derived` of the best state."""
        count = len(self.names)
        return derived(self.best[:count], sheet, self.best[count:])

    def conditioned(self, states: Array, rng: np.random.Generator) -> Array:
        """Draws from images and data sheet, shape (n, p + 4), made draws that know the side data, too.

        Each is moved to where it and side data, with an error drawn for them, agree best: exact where all is linear.
        """
        if not self.data:
            return states
        noise, moved = rng.normal(size=(len(states), len(self.sources))), states
        for _ in range(4):
            off = np.concatenate([datum.off(moved) for datum in self.data], axis=1) + noise
            moved = states - (off - (moved - states) @ self.jacobian.T) @ self.gain.T
        return moved


def _prior_of(fit: StatisticsFit, sheet: DataSheet) -> tuple[Array, Array]:
    """Mean state of images and data sheet and its covariance, systematic errors counted in."""
    count = len(fit.covariance.names)
    size = count + len(sheet.mean)
    spread = np.zeros((size, size))
    spread[:count, :count] = fit.covariance.matrix
    spread[:3, :3] += fit.systematic.T @ fit.systematic
    spread[count:, count:] = np.diag(sheet.sigma**2)
    return np.concatenate([fit.camera.vector(fit.covariance.names), sheet.mean]), spread


def combine(fit: StatisticsFit, sheet: DataSheet, data: Sequence[SideDatum]) -> Combined:
    """Put side data beside images and data sheet; without any, the best state is theirs."""
    start, spread = _prior_of(fit, sheet)
    best, size = start, len(start)
    gain, jacobian = np.zeros((size, 0)), np.zeros((0, size))
    step = NUDGE * np.maximum(np.abs(start), 1e-3)

    def off(states: Array) -> Array:
        return np.concatenate([datum.off(states) for datum in data], axis=1)

    for _ in range(_STEPS if data else 0):
        nudged = np.concatenate([best + np.diag(step), best - np.diag(step), best[None]])
        values = off(nudged)
        jacobian = (values[:size] - values[size:-1]).T / (2 * step)
        gain = spread @ jacobian.T @ np.linalg.inv(jacobian @ spread @ jacobian.T + np.eye(len(jacobian)))
        new = start - gain @ (values[-1] - jacobian @ (best - start))
        moved, best = float(np.abs((new - best) / np.maximum(np.abs(best), 1e-3)).max()), new
        if moved < 1e-12:
            break
    sources: list[str] = []
    apart = {}
    for datum in data:
        first = datum.off(start[None])[0]
        rows = slice(len(sources), len(sources) + len(first))
        whole = jacobian[rows] @ spread @ jacobian[rows].T + np.eye(len(first))
        apart[datum.name] = math.sqrt(float(first @ np.linalg.solve(whole, first)) / datum.rank)
        sources += [datum.name] * len(first)
    return Combined(fit.covariance.names, best, tuple(sources), gain, jacobian, apart, tuple(data))
