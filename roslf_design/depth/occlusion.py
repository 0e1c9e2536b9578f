"""Disparity about occlusion: by the half of the views that looks past the edge, and by small windows on one side of it.

At a depth step windows hold two surfaces, and some views see another than the rest. Each surface is carried on from
where it is known, into what is unknown; the half of the views on its own side still sees it there. Of all windows that
hold a microlens and are at one with themselves and with its own views, the one that knows its disparity best is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .windows import SharedLight, WindowFit, chance

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SIZES = (5, 3)
"""Sides of the windows tried where the wanted one is at odds [microlenses]."""
REACH = 16
"""Microlenses that a surface is carried on over what is unknown."""
SETTLED = 0.25
"""Change of disparity from the one warped back by up to which a slope tells it well enough near an edge [pitches]."""
AT_ODDS = 5.0
"""Chi-square per degree of freedom above which a window is at odds with itself there: edges alias."""
CLEARLY, FEW = 2, 200
"""Times as many microlenses, and how many more, that one side's halves know from which the other side's are wrong."""
_PICKED = 1.3
"""Factor by which the least of the errors of many windows is taken as too small: chosen on rendered light fields, not
derived."""
_DEPTH_STEP, BESIDE_STEP = 0.9, 2.0
"""Difference of known disparities within `SIZES[0]` that is a depth step [pitches], and the factor by which errors are
larger there than windows tell: pixels show some of both sides. Chosen on rendered light fields, not derived."""
_NUDGE = 0.3
"""Largest correction of a surface that is carried on [pitches]."""

HALVES = ((0, -1), (0, 1), (-1, 0), (1, 0))
"""Directions (v, u) that surfaces are carried on from."""


@dataclass(frozen=True, eq=False)
class _Offered:
    """Disparities by other windows or views, of the microlenses with a finite `sigma`."""

    disparity: Array
    sigma: Array
    chi2: Array
    views: Array
    picture: Array

    @classmethod
    def none(cls, shape: tuple[int, int]) -> _Offered:
        """Nothing to begin with."""
        return cls(np.full(shape, np.nan), np.full(shape, np.inf), *(np.zeros(shape) for _ in range(3)))

    def take(self, look: SharedLight, wanted: Flags, largest_sigma: float, alike: float | None) -> int:
        """Take the windows of a look that know more than those so far; how many do."""
        before = int(np.isfinite(self.sigma).sum())
        at = np.argwhere(wanted)
        rows, columns = wanted.shape
        own_limit = np.maximum(AT_ODDS, chance(look.sums[10]))
        raw, moment = look.moments
        here = tuple(at.T)
        moment, raw = (np.where(look.gradient[2], part, 0)[here] for part in (moment, raw))
        for window in SIZES:
            fit, reach = WindowFit.of(look, window, alone=True), window // 2
            widened, misfit = fit.widened(alike), fit.misfit(AT_ODDS)
            for under in (-reach, 0, reach):
                for over in (-reach, 0, reach):
                    v, u = at[:, 0] + under, at[:, 1] + over
                    inside = (v >= 0) & (v < rows) & (u >= 0) & (u < columns)
                    there = np.clip(v, 0, rows - 1), np.clip(u, 0, columns - 1)
                    value = fit.disparity[there] - np.clip(
                        fit.across[there] * over + fit.down[there] * under, -0.5, 0.5
                    )
                    carried = fit.uu[there] * over**2 + 2 * fit.uv[there] * over * under + fit.vv[there] * under**2
                    sigma = np.sqrt(fit.sigma[there] ** 2 + np.maximum(carried, 0))
                    change = value - look.disparity[here]
                    own = (look.sums[9][here] + (2 * moment + raw * change) * change) / np.maximum(
                        look.sums[10][here], 0.5
                    )
                    good = inside & (misfit[there] <= 1) & (own <= own_limit[here]) & (sigma <= largest_sigma)
                    good &= (np.abs(change) <= np.maximum(0.5 * sigma, SETTLED)) & (fit.spare[there] > 3)
                    sigma = _PICKED * sigma * widened[there]
                    good &= sigma < self.sigma[here]
                    to, source = tuple(at[good].T), (there[0][good], there[1][good])
                    self.disparity[to], self.sigma[to] = value[good], sigma[good]
                    self.chi2[to] = np.maximum(fit.chi2[source], fit.strain[source])
                    self.views[to], self.picture[to] = look.sums[11][to], look.sums[0][to]
        return int(np.isfinite(self.sigma).sum()) - before


def past_edges(
    first: SharedLight,
    fit: WindowFit,
    known: Flags,
    wanted: Flags,
    halves: tuple[Flags, Flags],
    sparse: Flags,
    look: Callable[[Flags | None, Array, Array], SharedLight],
    largest_sigma: float,
    alike: float | None,
) -> _Offered:
    """Disparities of the microlenses `wanted`, where other windows or half of the views have them.

    Parameters
    ----------
    first : SharedLight
        Of all views.
    fit : WindowFit
        Of it, with the slopes of its disparity.
    known, wanted : ndarray
        True where a disparity is known and can be carried on; where one is wanted. Shape (v, u).
    halves : tuple of ndarray
        True for the views whose pupil coordinate along u, along v is not above 0, shape (view,).
    look : callable
        Makes another look with some of the views, as `_AllViews` does.
    largest_sigma : float
        Standard error above which there is none [pitches].
    alike : float, optional
        As `PixelNoise` has it.
    """
    found = _Offered.none(known.shape)
    found.take(first, wanted, largest_sigma, alike)
    wanted = wanted & ~np.isfinite(found.sigma)
    near = ndimage.binary_dilation(wanted, iterations=SIZES[0])
    known = known | np.isfinite(found.sigma)
    disparity = np.where(np.isfinite(found.sigma), found.disparity, fit.disparity)
    sides = [1, -1]
    gains = dict.fromkeys(sides, 0)
    for down, right in HALVES:
        # Which half sees past is the same all over; the first axis tells it, as some folders are turned by half a turn.
        for side in sides:
            half = halves[0] if right else halves[1]
            some = half if (down + right) * side < 0 else ~half
            carried = _carried(disparity, known, fit, (down, right))
            carried = np.where(near, np.where(np.isfinite(carried), carried, first.disparity), np.nan)
            once = look(some & sparse, carried, first.picture)
            change = WindowFit.of(once, SIZES[0], alone=True).disparity - once.disparity
            again = look(some, carried + np.clip(change, -_NUDGE, _NUDGE), once.picture)
            gains[side] += found.take(again, wanted, largest_sigma, alike)
        if right > 0 or max(gains.values()) > CLEARLY * min(gains.values()) + FEW:
            sides = [max(sides, key=gains.__getitem__)]
    return found


def _carried(disparity: Array, known: Flags, fit: WindowFit, direction: tuple[int, int]) -> Array:
    """Disparities carried on along their slopes from where they are known, in one direction; else not a number."""
    down, right = direction
    value = np.where(known, disparity, np.nan)
    slope = np.clip(fit.across * right + fit.down * down, -0.2, 0.2)
    for _ in range(REACH):
        hole = np.isnan(value)
        before, steep = (np.roll(part, (down, right), (0, 1)) for part in (value, slope))
        edge = (slice(None), 0 if right > 0 else -1) if right else (0 if down > 0 else -1, slice(None))
        before[edge] = np.nan
        value, slope = np.where(hole, before + steep, value), np.where(hole, steep, slope)
    return value


def beside_steps(disparity: Array) -> Flags:
    """True where known disparities nearby, those that are numbers, differ by a depth step."""
    known = np.isfinite(disparity)
    most = ndimage.maximum_filter(np.where(known, disparity, -np.inf), SIZES[0])
    least = ndimage.minimum_filter(np.where(known, disparity, np.inf), SIZES[0])
    return np.asarray(most > least + _DEPTH_STEP)
