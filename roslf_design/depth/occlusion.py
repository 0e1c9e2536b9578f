"""Disparity about occlusion: by the quarter of the views that looks past the edge, and by small windows on one side.

At a depth step windows hold two surfaces, and some views see another than the rest. Each is sought once more by the
views of one quarter of the pupil alone, one of which still sees it beside most edges and corners. Of all windows that
hold a microlens and are at one with themselves and with its own views, the one that knows its disparity best is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .._jit import THREADS, kernel, prange
from .warping import add
from .windows import CHI2, SPARE, STRAIN, SharedLight, WindowFit, carried, chance

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SIZES = (5, 3)
"""Sides of the windows tried where the wanted one is at odds [microlenses]."""
SETTLED = 0.25
"""Change of disparity from the one warped back by up to which a slope tells it well enough near an edge [pitches]."""
AT_ODDS = 5.0
"""Chi-square per degree of freedom, over that of like texture, above which windows are at odds there: edges alias."""
_PICKED = 1.3
"""Factor by which the least of the errors of many windows is taken as too small: chosen on rendered light fields, not
derived."""
_BESIDE, _TWO = 12, 0.5
"""Reach of the known disparities, every other one, that tell which surfaces are beside a microlens, and difference of
theirs from which these are two [pitches]."""
_FURTHEST = 0.5
"""Change of disparity that a slope tells roughly [pitches]: the outermost views move by half a microlens."""
_FATTENED = 7
"""Side of the window in which a farther surface is looked for beside the microlens in its middle [microlenses]."""
_CLEARLY = 0.6
"""Chi-square along the farther surface, over that along the nearer, below which a microlens shows the farther: chosen
on rendered light fields and a Lytro's, where noise alone makes the two alike."""
_TILE = 16
"""Rows that are worked out one after the other, by one thread."""
_DEPTH_STEP, BESIDE_STEP = 0.9, 2.0
"""Difference of known disparities within `SIZES[0]` that is a depth step [pitches], and the factor by which errors are
larger there than windows tell: pixels show some of both sides. Chosen on rendered light fields, not derived."""


class Limits(NamedTuple):
    """Limits that windows beside steps are held to."""

    largest_sigma: float
    alike: Sequence[float] | None
    """How much more windows of `SIZES` vary than if noise were each sample's own, where views tell it."""
    level: Array
    """Chi-square of windows that see one surface."""

    def own(self, freedom: Array) -> Array:
        """Chi-square per degree of freedom up to which a microlens's views, of so many degrees, see the surface."""
        return np.asarray(np.maximum(AT_ODDS, chance(freedom)) * ndimage.minimum_filter(self.level, SIZES[0]))


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

    def take(self, look: SharedLight, wanted: Flags, limits: Limits) -> None:
        """Take the windows of a look that know more than those so far."""
        largest_sigma, alike, level = limits
        own_limit = limits.own(look.sums[10])
        raw, moment = (np.where(look.gradient[2], part, 0) for part in look.moments)
        for number, window in enumerate(SIZES):
            fit = WindowFit.of(look, window, ndimage.binary_dilation(wanted, np.ones((window, window), np.bool_)))
            widened, misfit = _PICKED * fit.widened(alike[number] if alike else None), fit.misfit(AT_ODDS, level)
            with THREADS:
                _take_best.compiled(
                    fit.maps, widened, misfit, look.disparity, look.sums, raw, moment,
                    own_limit, wanted, window // 2, largest_sigma,
                    self.disparity, self.sigma, self.chi2, self.views, self.picture,
                )  # fmt: skip


@kernel(parallel=True)
def _take_best(
    fit: Array, widened: Array, misfit: Array, begun: Array, sums: Array, raw: Array, moment: Array, own_limit: Array,
    wanted: Flags, reach: int, largest_sigma: float, disparity: Array, sigma: Array, chi2: Array, views: Array,
    picture: Array,
) -> None:  # fmt: skip
    """Take, of windows that hold a microlens, that which knows its disparity best, if it knows more than `sigma`."""
    rows, columns = wanted.shape
    for v in prange(rows):
        for u in range(columns):
            if not wanted[v, u]:
                continue
            for b in range(max(v - reach, 0), min(v + reach + 1, rows), reach):
                for a in range(max(u - reach, 0), min(u + reach + 1, columns), reach):
                    over, under = u - a, v - b
                    if (over % reach) + (under % reach) or misfit[b, a] > 1 or not fit[SPARE, b, a] > 3:
                        continue
                    value, error = carried(fit, b, a, over, under)
                    change = value - begun[v, u]
                    own = sums[9, v, u] + (2 * moment[v, u] + raw[v, u] * change) * change
                    reported = error * widened[b, a]
                    good = own <= own_limit[v, u] * max(sums[10, v, u], 0.5) and reported <= largest_sigma
                    good = good and abs(change) <= max(0.5 * error, SETTLED)
                    if good and reported < sigma[v, u]:
                        disparity[v, u], sigma[v, u] = value, reported
                        chi2[v, u] = max(fit[CHI2, b, a], fit[STRAIN, b, a])
                        views[v, u], picture[v, u] = sums[11, v, u], sums[0, v, u]


@kernel(parallel=True)
def _sides(disparity: Array, wanted: Flags, reach: int, two: float, sides: Array) -> None:
    """Disparities of the farther and the nearer surface about some microlenses, by the known ones within `reach`."""
    rows, columns = disparity.shape
    # Every other one tells enough, of four together.
    for half in prange((rows + 1) // 2):
        v = 2 * half
        for u in range(0, columns, 2):
            if not wanted[v : v + 2, u : u + 2].any():
                continue
            top, bottom = v - reach if v >= reach else v % 2, min(v + reach + 1, rows)
            left, right = u - reach if u >= reach else u % 2, min(u + reach + 1, columns)
            least, most = math.inf, -math.inf
            for b in range(top, bottom, 2):
                for a in range(left, right, 2):
                    if not math.isnan(disparity[b, a]):
                        least, most = min(least, disparity[b, a]), max(most, disparity[b, a])
            if least > most:
                continue
            middle, sums = 0.5 * (least + most), np.zeros((2, 2))
            for b in range(top, bottom, 2):
                for a in range(left, right, 2):
                    if not math.isnan(disparity[b, a]):
                        side, away = int(disparity[b, a] > middle), (b - v) ** 2 + (a - u) ** 2 + 0.1
                        weight = 1.0 / (away * away)
                        sums[side, 0] += weight
                        sums[side, 1] += weight * disparity[b, a]
            for side in range(2 if most > least + two else 1):
                sides[side, v : v + 2, u : u + 2] = sums[side, 1] / max(sums[side, 0], 1e-30)


def sides_about(disparity: Array, wanted: Flags, reach: int = _BESIDE, two: float = _TWO) -> Array:
    """Disparities of the farther and the nearer surface about some microlenses, shape (2, v, u), by the known ones.

    Known ones within `reach` tell them; they are two where these differ by more than `two`, else one, the first. Not
    numbers where nothing is wanted or known.
    """
    sides = np.full((2, *wanted.shape), np.nan)
    with THREADS:
        _sides.compiled(disparity, wanted, reach, two, sides)
    return sides


def settle(look: SharedLight, window: int, number: int, before: Array, least: Array, chosen: Array) -> None:
    """Correct the disparities of a look once over windows, and choose them where they leave less than so far.

    They become those `chosen` of look `number`, instead of any other's, where chi-square per degree of freedom is below
    `least`, unless they are what that had `before`. It is that of the microlens's own views and of the best window that
    holds it: beside a step that about it sees both surfaces, whichever of the two it is compared along, and the edge
    is the nearer one's.
    """
    with THREADS:
        _settle.compiled(
            look.sums, look.picture, look.disparity, look.steps, window // 2, number, before, least, chosen
        )


@kernel(parallel=True)
def _settle(
    sums: Array, picture: Array, begun: Array, steps: tuple[float, float], reach: int, number: int, before: Array,
    least: Array, chosen: Array,
) -> None:  # fmt: skip
    """As `settle`; slopes of the picture are differences of neighbours."""
    rows, columns = begun.shape
    for tile in prange((rows + _TILE - 1) // _TILE):
        top, bottom = tile * _TILE, min(tile * _TILE + _TILE, rows)
        first, last = max(top - reach, 0), min(bottom + reach, rows)
        low, high = max(first - reach, 0), min(last + reach, rows)
        terms, down = np.zeros((high - low, 4, columns)), np.zeros((4, columns + 2 * reach))
        windows, total = np.zeros((last - first, 2, columns)), np.zeros((4, columns))
        for v in range(low, high):
            raw, moment, squares, free = terms[v - low]
            above, below = max(v - 1, 0), min(v + 1, rows - 1)
            for u in range(columns):
                left, right = max(u - 1, 0), min(u + 1, columns - 1)
                x = (picture[v, right] - picture[v, left]) / ((right - left) * steps[0])
                y = (picture[below, u] - picture[above, u]) / ((below - above) * steps[1])
                raw[u] = x * x * sums[4, v, u] + 2 * x * y * sums[5, v, u] + y * y * sums[6, v, u]
                moment[u] = x * sums[7, v, u] + y * sums[8, v, u]
                squares[u], free[u] = sums[9, v, u], sums[10, v, u]
        for v in range(first, last):
            down[:], total[:] = 0.0, 0.0
            for k in range(4):
                for b in range(max(v - reach, 0), min(v + reach + 1, rows)):
                    add(terms[b - low, k], 1.0, down[k, reach : reach + columns])
                for a in range(2 * reach + 1):
                    add(down[k, a:], 1.0, total[k])
            changes, costs = windows[v - first]
            for u in range(columns):
                near, pull, square, freedom = total[:, u]
                change = min(max(-pull / max(near, 1.0), -_FURTHEST), _FURTHEST)
                changes[u], costs[u] = change, math.inf
                if freedom > 1:
                    costs[u] = (square + (2 * pull + near * change) * change) / freedom
        for v in range(top, bottom):
            raw, moment, squares, free = terms[v - low]
            for u in range(columns):
                if not sums[11, v, u] > 0:
                    continue
                for b in range(max(v - reach, 0), min(v + reach + 1, rows), reach):
                    for a in range(max(u - reach, 0), min(u + reach + 1, columns), reach):
                        change, cost = windows[b - first, 0, a], windows[b - first, 1, a]
                        settled = begun[v, u] + change
                        if cost >= least[v, u] or abs(settled - before[v, u]) <= SETTLED:
                            continue
                        own = squares[u] + (2 * moment[u] + raw[u] * change) * change
                        cost = max(cost, own / max(free[u], 0.5))
                        if cost < least[v, u]:
                            least[v, u] = cost
                            for k in range(chosen.shape[0]):
                                chosen[k, v, u] = settled if k == number else math.nan


def past_edges(
    first: SharedLight, wanted: Flags, quarters: Sequence[tuple[Flags, Flags]], disparity: Array,
    search: Callable[[Flags, Flags], Array], look: Callable[..., SharedLight], limits: Limits,
) -> tuple[_Offered, Flags]:  # fmt: skip
    """Disparities of the microlenses `wanted`, where other windows or a quarter of the views have them.

    `first` is of all views; `quarters` are true for the views of each quarter of the pupil, and for few of these. The
    few tell which quarter agrees best, along which of the surfaces beside by the `disparity` that is known; all of that
    quarter are looked at along it. Then what has none still, by what is known now: in places wider than a window, which
    no surface beside may explain, also along what `search` makes of some views near some microlenses. `look` looks at
    some views along disparities, as `_AllViews` does. With them comes where all disparities so far are wrong.
    """
    found = _Offered.none(wanted.shape)
    found.take(first, wanted, limits)
    tried = np.full((len(quarters), *wanted.shape), np.nan)
    for last in (False, True):
        wanted = wanted & ~np.isfinite(found.sigma)
        if not wanted.any():
            break
        near, known = ndimage.binary_dilation(wanted, iterations=4), np.isfinite(found.sigma)
        sides = sides_about(np.where(known, found.disparity, disparity), near)
        least, chosen = np.full(wanted.shape, 1e30), np.full((len(quarters), *wanted.shape), np.nan)
        wide = ndimage.binary_opening(wanted, np.ones((SIZES[0], SIZES[0]), np.bool_)) & last
        about = ndimage.binary_dilation(wide, iterations=4)
        for number, (_, few) in enumerate(quarters):
            others = [np.where(about, search(few, about), np.nan)] if wide.any() else []
            for side in (*sides, *others):
                settle(look([(few, side)], first.picture), SIZES[0], number, tried[number], least, chosen)
        parts = [(whole, own) for (whole, _), own in zip(quarters, chosen, strict=True)]
        found.take(look(parts, first.picture), wanted, limits)
        tried = chosen
    return found, _behind(first, quarters, disparity, look, limits, found)


def _behind(
    first: SharedLight, quarters: Sequence[tuple[Flags, Flags]], disparity: Array, look: Callable[..., SharedLight],
    limits: Limits, found: _Offered,
) -> Flags:  # fmt: skip
    """Mark where near a step the farther surface explains a quarter of the views better than the disparity known does.

    An edge's texture makes windows take what is behind, beside it, for the nearer surface. What windows of that quarter
    have of the farther one is put into `found`, nothing where they have none. Arguments are those of `past_edges`.
    """
    known = np.where(np.isfinite(found.sigma), found.disparity, disparity)
    farther = ndimage.minimum_filter(np.where(np.isnan(known), np.inf, known), _FATTENED)
    beside = known - farther > _DEPTH_STEP
    about = ndimage.binary_dilation(beside, np.ones((SIZES[0], SIZES[0]), np.bool_))
    untried, least = np.full(known.shape, np.nan), np.full((2, *known.shape), 1e30)
    chosen = np.full((2, len(quarters), *known.shape), np.nan)
    for surface, along in enumerate((known, np.where(np.isfinite(farther), farther, np.nan))):
        for number, (_, few) in enumerate(quarters):
            seen = look([(few, np.where(about, along, np.nan))], first.picture)
            settle(seen, SIZES[1], number, untried, least[surface], chosen[surface])
    wrong: Flags = beside & (least[1] < _CLEARLY * least[0])
    found.sigma[wrong] = np.inf
    parts = [(whole, own) for (whole, _), own in zip(quarters, chosen[1], strict=True)]
    found.take(look(parts, first.picture), wrong, limits)
    return wrong


def beside_steps(disparity: Array) -> Flags:
    """True where known disparities nearby, those that are numbers, differ by a depth step."""
    known = np.isfinite(disparity)
    most = ndimage.maximum_filter(np.where(known, disparity, -np.inf), SIZES[0])
    least = ndimage.minimum_filter(np.where(known, disparity, np.inf), SIZES[0])
    return np.asarray(most > least + _DEPTH_STEP)
