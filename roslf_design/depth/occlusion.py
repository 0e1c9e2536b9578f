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
from numpy import float32
from numpy.typing import NDArray
from scipy import ndimage

from .._jit import WHOLE, Band, kernel, prange
from .warping import add, clear
from .windows import (
    CHI2,
    FREE,
    QUORUM,
    SPARE,
    STRAIN,
    TERMS,
    UNDER,
    SharedLight,
    carried,
    extreme,
    fit_window,
    row_terms,
)  # fmt: skip

Array = NDArray[np.float64]
Samples = NDArray[np.float32]
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
_NEAR = 3
"""Microlenses beside those wanted that are looked at as well, for windows that hold these."""
_TILE = 32
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
    lowest: Array
    """Least of it near each microlens."""

    @classmethod
    def of(cls, largest_sigma: float, alike: Sequence[float] | None, level: Array) -> Limits:
        """Limits by chi-square of windows that see one surface."""
        return cls(largest_sigma, alike, level, extreme(np.minimum, level, SIZES[0]))


class Quarter(NamedTuple):
    """Views of a quarter of the pupil."""

    views: Flags
    few: NDArray[np.int64]
    """Indices of those that tell whether the quarter agrees."""

    @classmethod
    def of(cls, views: Flags, some: Flags, grid: NDArray[np.int64], lit: bool) -> Quarter:
        """Quarter whose outermost ones among `some` are its few; all of these, where there are no corners.

        Corners alone tell only where all views are `lit` everywhere: two views hardly agree or disagree.
        """
        own = views & some
        ends = [np.isin(at, (at[own].min(initial=at.max()), at[own].max(initial=at.min()))) for at in grid.T]
        corners = np.flatnonzero(own & ends[0] & ends[1])
        return cls(views, corners if lit and len(corners) > 2 else np.flatnonzero(own))


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
        alike = np.full(len(SIZES), np.nan) if limits.alike is None else np.array(limits.alike)
        slopes = look.gradient
        _take_best.compiled(
            look.sums, *slopes, look.disparity, look.steps, look.density, limits.level,
            limits.lowest, alike, wanted, limits.largest_sigma,
            self.disparity, self.sigma, self.chi2, self.views, self.picture,
        )  # fmt: skip


@kernel(inline=True)
def _chance(freedom: float) -> float:
    """As `windows.chance`."""
    over = 8.0 / max(freedom, 0.5)
    return 1.0 + 2.0 * math.sqrt(over) + 2.0 * over


@kernel(inline=True)
def _surely(chi2: float, freedom: float) -> float:
    """Chi-square per degree of freedom where it is surely above 1, else 1."""
    return chi2 if chi2 > 1 + 3 * math.sqrt(2 / max(freedom, 1.0)) else 1.0


@kernel(parallel=True)
def _take_best(
    sums: Array, slope_u: Array, slope_v: Array, known: Flags, begun: Array, steps: tuple[float, float],
    density: float, level: Array, lowest: Array, alike: Array, wanted: Flags, largest_sigma: float, disparity: Array,
    sigma: Array, chi2: Array, views: Array, picture: Array, band: Band = WHOLE,
) -> None:  # fmt: skip
    """Take, of windows that hold a microlens, that which knows its disparity best, if it knows more than `sigma`."""
    rows, columns = wanted.shape
    most = SIZES[0] // 2
    # Room had once, and not cleared: windows that are asked for are all fitted before.
    terms = np.empty((_TILE + 4 * most, TERMS, columns))
    fit, tall = np.empty((UNDER + 1, _TILE + 2 * most, columns)), _TILE + 2 * most
    misfit, widened = np.empty((tall, columns)), np.empty((tall, columns))
    down, near, none = np.zeros((TERMS, columns + 2 * most)), np.zeros((TERMS, columns)), np.zeros(0)
    for tile in prange((rows + _TILE - 1) // _TILE, band):
        top, bottom = tile * _TILE, min(tile * _TILE + _TILE, rows)
        if not wanted[top:bottom].any():
            continue
        low, high = max(top - 2 * most, 0), min(bottom + 2 * most, rows)
        first = max(top - most, 0)
        for v in range(low, high):
            row_terms(sums, slope_u, slope_v, known, begun, steps, v, terms[v - low])
        for n in range(len(SIZES)):
            reach = SIZES[n] // 2
            quorum = QUORUM * SIZES[n] ** 2
            for v in range(max(top - reach, 0), min(bottom + reach, rows)):
                row, some, wide = v - first, np.zeros(columns, np.bool_), np.zeros(columns + 2 * most, np.bool_)
                for b in range(v - reach, v + reach + 1, reach):
                    if top <= b < bottom:
                        wide[most : most + columns] |= wanted[b]
                for a in range(-reach, reach + 1, reach):
                    some |= wide[most + a : most + a + columns]
                if not some.any():
                    continue
                clear(down.reshape(-1))
                clear(near.reshape(-1))
                for k in range(TERMS):
                    for b in range(max(v - reach, 0), min(v + reach + 1, rows)):
                        add(terms[b - low, k], 1.0, down[k, reach : reach + columns])
                    for a in range(2 * reach + 1):
                        add(down[k, a:], 1.0, near[k])
                for u in range(columns):
                    if not some[u]:
                        continue
                    fit_window(near[:, u], none, v, u, begun[v, u], quorum, density, row, fit)
                    square, free, strain, spare = (
                        fit[CHI2, row, u], fit[FREE, row, u], fit[STRAIN, row, u], fit[SPARE, row, u],
                    )  # fmt: skip
                    misfit[row, u] = max(
                        square / (level[v, u] * max(_chance(free), AT_ODDS)), strain / max(_chance(spare), AT_ODDS)
                    )
                    if math.isnan(alike[n]):
                        more = max(_surely(square, free), _surely(strain, spare))
                    else:
                        more = max(alike[n] * square, strain if spare > 3 else 0.0, 1e-12)
                    widened[row, u] = _PICKED * math.sqrt(more)
            for v in range(top, bottom):
                raw, moment = terms[v - low, 9], terms[v - low, 10]
                for u in range(columns):
                    if not wanted[v, u]:
                        continue
                    free = max(sums[10, v, u], 0.5)
                    limit = max(AT_ODDS, _chance(sums[10, v, u])) * lowest[v, u] * free
                    for b in range(v - reach, v + reach + 1, reach):
                        for a in range(u - reach, u + reach + 1, reach):
                            if not (0 <= b < rows and 0 <= a < columns):
                                continue
                            row = b - first
                            if misfit[row, a] > 1 or not fit[SPARE, row, a] > 3:
                                continue
                            value, error = carried(fit, row, a, u - a, v - b)
                            reported, change = error * widened[row, a], value - begun[v, u]
                            own = sums[9, v, u] + (2 * moment[u] + raw[u] * change) * change
                            good = own <= limit and reported <= largest_sigma
                            good = good and abs(change) <= max(0.5 * error, SETTLED)
                            if good and reported < sigma[v, u]:
                                disparity[v, u], sigma[v, u] = value, reported
                                chi2[v, u] = max(fit[CHI2, row, a], fit[STRAIN, row, a])
                                views[v, u], picture[v, u] = sums[11, v, u], sums[0, v, u]


@kernel(parallel=True)
def _sides(
    disparity: Array, least: Array, most: Array, wanted: Flags, weights: Array, two: float, sides: Array,
    band: Band = WHOLE,
) -> None:  # fmt: skip
    """Disparities of the farther and the nearer surface about some microlenses, by every other known one about them.

    `disparity` of every other one, with the `least` and `most` about it; `weights` by distances along both axes.
    """
    rows, columns = disparity.shape
    reach = len(weights) - 1
    # Of four together.
    for v in prange(rows, band):
        for u in range(columns):
            low, high = least[v, u], most[v, u]
            if low > high or not wanted[2 * v : 2 * v + 2, 2 * u : 2 * u + 2].any():
                continue
            middle, under, over, below, above = 0.5 * (low + high), 0.0, 0.0, 0.0, 0.0
            for b in range(max(v - reach, 0), min(v + reach + 1, rows)):
                for a in range(max(u - reach, 0), min(u + reach + 1, columns)):
                    weight, each = weights[abs(b - v), abs(a - u)], disparity[b, a]
                    if each > middle:
                        over += weight
                        above += weight * each
                    elif each <= middle:
                        under += weight
                        below += weight * each
            sides[0, 2 * v : 2 * v + 2, 2 * u : 2 * u + 2] = below / max(under, 1e-30)
            if high > low + two:
                sides[1, 2 * v : 2 * v + 2, 2 * u : 2 * u + 2] = above / max(over, 1e-30)


def sides_about(disparity: Array, wanted: Flags, reach: int = _BESIDE, two: float = _TWO) -> Array:
    """Disparities of the farther and the nearer surface about some microlenses, shape (2, v, u), by the known ones.

    Known ones within `reach` tell them; they are two where these differ by more than `two`, else one, the first. Not
    numbers where nothing is wanted or known.
    """
    sides, some = np.full((2, *wanted.shape), np.nan), np.ascontiguousarray(disparity[::2, ::2])
    least, most = (
        extreme(choose, np.where(np.isnan(some), none, some), reach + 1)
        for choose, none in ((np.minimum, np.inf), (np.maximum, -np.inf))
    )
    away = (2.0 * np.arange(reach // 2 + 1)) ** 2
    _sides.compiled(some, least, most, wanted, (np.add.outer(away, away) + 0.1) ** -2, two, sides)
    return sides


@dataclass(frozen=True, eq=False)
class _Settled:
    """Disparities along which some views of each quarter agree best so far."""

    least: Array
    """Chi-square per degree of freedom that they leave, of the quarter that agrees best."""
    chosen: Array
    """Shape (quarter, v, u): of that quarter, not numbers of others."""

    @classmethod
    def none(cls, count: int, shape: tuple[int, int]) -> _Settled:
        """Nothing of so many quarters to begin with."""
        return cls(np.full(shape, 1e30), np.full((count, *shape), np.nan))


class FewViews(NamedTuple):
    """Few views along a disparity, each by itself."""

    each: Samples
    """Values and their weights, shape (view, 2, v, u)."""
    pupil: Samples
    """Pupil coordinates of all views, shape (2, view, v, u)."""
    indices: NDArray[np.int64]
    """Indices of the few."""
    picture: Array
    """Picture that they are expected to show."""
    disparity: Array
    steps: tuple[float, float]

    def settle(self, quarters: Sequence[Flags], window: int, before: Array, settled: _Settled) -> None:
        """Correct disparities once over windows, each quarter's, and choose them where they leave less than so far.

        They become those `settled` of one of the `quarters`, true for its views among these, unless they are what that
        had `before`. What they leave is that of the microlens's own views and of the best window that holds it: beside
        a step that about it sees both surfaces, whichever of the two it is compared along, and the edge is the nearer
        one's.
        """
        _settle.compiled(
            self.each, self.pupil, self.indices, np.array(quarters), self.picture, self.disparity, self.steps,
            window // 2, before, settled.least, settled.chosen,
        )  # fmt: skip


@kernel()
def _rows(count: int, columns: int) -> Samples:
    """Room for rows."""
    return np.zeros((count, columns), float32)


@kernel()
def _six_rows(columns: int) -> tuple[Samples, Samples, Samples, Samples, Samples, Samples]:
    """Room for rows, each contiguous to the compiler, which rows that an array is taken apart into are not."""
    room = _rows(6, columns)
    return room[0], room[1], room[2], room[3], room[4], room[5]


@kernel(apart=True)
def _add_light(shown: Samples, weight: Samples, expected: Samples, total: Samples, value: Samples) -> None:
    """Add weights of a view, and what it shows beyond what is expected times these, along a row."""
    for u in range(weight.size):
        total[u] += weight[u]
        value[u] += weight[u] * (shown[u] - expected[u])


@kernel(apart=True)
def _add_pulls(
    shown: Samples, weight: Samples, expected: Samples, x: Samples, y: Samples, along: Samples, over: Samples,
    pull: Samples, value: Samples, sums: Samples,
) -> None:  # fmt: skip
    """Add moments of a view's pull, which slopes (x, y) of the picture lend it, and of its value to sums, along a row.

    Sums of weights, with pull and value, with their squares and product, and the count: shape (7, u).
    """
    one, zero = float32(1), float32(0)
    for u in range(weight.size):
        pull[u] = x[u] * along[u] + y[u] * over[u]
        value[u] = shown[u] - expected[u]
    whole, pulls, values, count = sums[0], sums[1], sums[2], sums[6]
    for u in range(weight.size):
        whole[u] += weight[u]
        pulls[u] += weight[u] * pull[u]
        values[u] += weight[u] * value[u]
        count[u] += one if weight[u] > zero else zero
    squares, both, residual = sums[3], sums[4], sums[5]
    for u in range(weight.size):
        w = weight[u] * pull[u]
        squares[u] += w * pull[u]
        both[u] += w * value[u]
        residual[u] += weight[u] * value[u] * value[u]


@kernel(apart=True)
def _about_mean(sums: Samples, known: Flags, terms: Samples) -> None:
    """Chi-square about another disparity: raw, moment, residual and freedom, shape (4, u), by sums of `_add_pulls`."""
    one, zero, least = float32(1), float32(0), float32(1e-30)
    for u in range(known.size):
        here, total = known[u] and sums[6, u] > one, max(sums[0, u], least)
        p, value = sums[1, u] / total, sums[2, u] / total
        terms[0, u] = sums[3, u] - sums[1, u] * p if here else zero
        terms[1, u] = sums[4, u] - sums[1, u] * value if here else zero
        terms[2, u] = max(sums[5, u] - sums[2, u] * value, zero) if here else zero
        terms[3, u] = sums[6, u] - one if here else zero


@kernel()
def _quarter_terms(
    each: Samples, pupil: Samples, indices: NDArray[np.int64], own: Flags, expected: Samples, known: Flags,
    steps: tuple[float, float], start: int, low: int, terms: Samples,
) -> None:  # fmt: skip
    """As `_about_mean` of a quarter's `own` views, of the rows from `low`; what is `expected` begins at row `start`."""
    count, columns = expected.shape
    rows, still = each.shape[2], pupil.strides[2] == 0 and pupil.strides[3] == 0
    zero, one = float32(0), float32(1)
    total, sums, seen = _rows(2, columns), _rows(7, columns), _rows(count, columns)
    x, y, along, over, pull, value = _six_rows(columns)
    for v in range(start, start + count):
        clear(total[0])
        clear(total[1])
        for n in range(indices.size):
            if own[n]:
                _add_light(each[n, 0, v], each[n, 1, v], expected[v - start], total[0], total[1])
        for u in range(columns):
            lit = known[v - start, u] and total[0, u] > zero
            seen[v - start, u] = expected[v - start, u] + (total[1, u] / total[0, u] if lit else zero)
    for v in range(low, low + len(terms)):
        above, below = seen[max(v - 1, 0) - start], seen[min(v + 1, rows - 1) - start]
        row, tall = seen[v - start], one / float32((2 if 0 < v < rows - 1 else 1) * steps[1])
        wide = one / float32(2 * steps[0])
        for u in range(1, columns - 1):
            x[u] = (row[u + 1] - row[u - 1]) * wide
        x[0], x[columns - 1] = 2 * (row[1] - row[0]) * wide, 2 * (row[columns - 1] - row[columns - 2]) * wide
        for u in range(columns):
            y[u] = (below[u] - above[u]) * tall
        clear(sums.reshape(-1))
        for n in range(indices.size):
            if own[n]:
                k = indices[n]
                x_at, y_at = pupil[0, k, 0, 0], pupil[1, k, 0, 0]
                for u in range(columns):
                    along[u], over[u] = x_at, y_at
                for u in range(0 if still else columns):
                    along[u], over[u] = pupil[0, k, v, u], pupil[1, k, v, u]
                _add_pulls(each[n, 0, v], each[n, 1, v], expected[v - start], x, y, along, over, pull, value, sums)
        _about_mean(sums, known[v - start], terms[v - low])


@kernel(apart=True)
def _correct(total: Samples, changes: Samples, costs: Samples) -> None:
    """Change of disparity by sums of terms over windows along a row, and chi-square per degree of freedom it leaves."""
    one, two, furthest = float32(1), float32(2), float32(_FURTHEST)
    for u in range(total.shape[1]):
        near, pull, square, freedom = total[0, u], total[1, u], total[2, u], total[3, u]
        change = min(max(-pull / max(near, one), -furthest), furthest)
        left = (square + (two * pull + near * change) * change) / max(freedom, one)
        changes[u], costs[u] = change, left if freedom > one else float32(math.inf)


@kernel(apart=True)
def _choose(
    change: Samples, cost: Samples, begun: Samples, before: Samples, terms: Samples, least: Samples, best: Samples
) -> None:
    """Take what windows aside change along a row where that leaves less than so far."""
    two, half, same = float32(2), float32(0.5), float32(SETTLED)
    for u in range(least.size):
        own = terms[2, u] + (two * terms[1, u] + terms[0, u] * change[u]) * change[u]
        left, settled = max(cost[u], own / max(terms[3, u], half)), begun[u] + change[u]
        better = (terms[3, u] > half) & (left < least[u]) & (abs(settled - before[u]) > same)
        least[u], best[u] = left if better else least[u], settled if better else best[u]


@kernel(parallel=True)
def _settle(
    each: Samples, pupil: Samples, indices: NDArray[np.int64], quarters: Flags, picture: Array, begun: Array,
    steps: tuple[float, float], reach: int, before: Array, least: Array, chosen: Array, band: Band = WHOLE,
) -> None:  # fmt: skip
    """As `FewViews.settle`; slopes of what a quarter shows are differences of neighbours."""
    rows, columns = begun.shape
    one = float32(1)
    for tile in prange((rows + _TILE - 1) // _TILE, band):
        top, bottom = tile * _TILE, min(tile * _TILE + _TILE, rows)
        first, last = max(top - reach, 0), min(bottom + reach, rows)
        low, high = max(first - reach, 0), min(last + reach, rows)
        start, stop = max(low - 1, 0), min(high + 1, rows)
        known = ~np.isnan(begun[start:stop])
        if not known.any():
            continue
        expected = _rows(stop - start, columns)
        terms, down = np.zeros((high - low, 4, columns), float32), np.zeros((4, columns + 2 * reach), float32)
        windows = np.full((2, last - first, columns + 2 * reach), float32(math.inf))
        total = _rows(4, columns)
        here, tried, smallest, best, _, _ = _six_rows(columns)
        for v in range(start, stop):
            for u in range(columns):
                expected[v - start, u] = picture[v, u]
        for q in range(quarters.shape[0]):
            if not quarters[q].any():
                continue
            _quarter_terms(each, pupil, indices, quarters[q], expected, known, steps, start, low, terms)
            for v in range(first, last):
                clear(down.reshape(-1))
                clear(total.reshape(-1))
                for k in range(4):
                    for b in range(max(v - reach, 0), min(v + reach + 1, rows)):
                        add(terms[b - low, k], one, down[k, reach : reach + columns])
                    for a in range(2 * reach + 1):
                        add(down[k, a:], one, total[k])
                changes, costs = windows[0, v - first], windows[1, v - first]
                _correct(total, changes[reach : reach + columns], costs[reach : reach + columns])
            for v in range(top, bottom):
                for u in range(columns):
                    here[u], smallest[u] = begun[v, u], least[v, u]
                    tried[u] = math.inf if math.isnan(before[q, v, u]) else before[q, v, u]
                    best[u] = math.nan
                for b in range(v - reach, v + reach + 1, reach):
                    for a in range(0, 2 * reach + 1, reach):
                        if 0 <= b < rows:
                            aside = slice(a, a + columns)
                            _choose(
                                windows[0, b - first, aside], windows[1, b - first, aside], here, tried, terms[v - low],
                                smallest, best,
                            )  # fmt: skip
                for u in range(columns):
                    if not math.isnan(best[u]):
                        least[v, u] = smallest[u]
                        for k in range(chosen.shape[0]):
                            chosen[k, v, u] = best[u] if k == q else math.nan


def past_edges(
    first: SharedLight, wanted: Flags, quarters: Sequence[Quarter], disparity: Array,
    search: Callable[[Flags, Flags], Array], look: Callable[..., SharedLight], few: Callable[..., FewViews],
    limits: Limits,
) -> tuple[_Offered, Flags]:  # fmt: skip
    """Disparities of the microlenses `wanted`, where other windows or a quarter of the views have them.

    `first` is of all views. Few views of the `quarters` tell which agrees best, along which of the surfaces beside by
    the `disparity` that is known; all of that quarter are looked at along it. Then what has none still, by what is
    known now: in places wider than a window, which no surface beside may explain, also along what `search` makes of
    some views near some microlenses. `look` looks at some views along disparities, as `_AllViews` does, and `few` at
    each of a few. With them comes where all disparities so far are wrong.
    """
    found = _Offered.none(wanted.shape)
    found.take(first, wanted, limits)
    if not quarters:
        return found, np.zeros(wanted.shape, np.bool_)
    each, own = _few_of(quarters)
    settled = _Settled.none(len(quarters), wanted.shape)
    for last in (False, True):
        wanted = wanted & ~np.isfinite(found.sigma)
        if not wanted.any():
            break
        near, known = ndimage.binary_dilation(wanted, iterations=_NEAR), np.isfinite(found.sigma)
        tried, settled = settled.chosen, _Settled.none(len(quarters), wanted.shape)
        for side in sides_about(np.where(known, found.disparity, disparity), near):
            few(each, side, first.picture).settle(own, SIZES[0], tried, settled)
        reach = SIZES[0] // 2
        within = np.pad(extreme(np.minimum, wanted & last, SIZES[0])[reach:-reach, reach:-reach], reach)
        wide = extreme(np.maximum, within, SIZES[0])
        about = ndimage.binary_dilation(wide, iterations=4)
        for number, quarter in enumerate(quarters if wide.any() else ()):
            along = np.where(about, search(quarter.views, about), np.nan)
            alone = [np.full(len(quarter.few), k == number) for k in range(len(quarters))]
            few(quarter.few, along, first.picture).settle(alone, SIZES[0], tried, settled)
        found.take(look(_parts(quarters, settled), first.picture), wanted, limits)
    return found, _behind(first, quarters, disparity, look, few, limits, found)


def _few_of(quarters: Sequence[Quarter]) -> tuple[NDArray[np.int64], list[Flags]]:
    """Indices of the few views of all quarters, and which of them are each quarter's."""
    each = np.unique(np.concatenate([quarter.few for quarter in quarters]))
    return each, [np.isin(each, quarter.few) for quarter in quarters]


def _parts(quarters: Sequence[Quarter], settled: _Settled) -> list[tuple[Flags, Array]]:
    """Views of each quarter, and the disparities along which it agrees best."""
    return [(quarter.views, own) for quarter, own in zip(quarters, settled.chosen, strict=True)]


def _behind(
    first: SharedLight, quarters: Sequence[Quarter], disparity: Array, look: Callable[..., SharedLight],
    few: Callable[..., FewViews], limits: Limits, found: _Offered,
) -> Flags:  # fmt: skip
    """Mark where near a step the farther surface explains a quarter of the views better than the disparity known does.

    An edge's texture makes windows take what is behind, beside it, for the nearer surface. What windows of that quarter
    have of the farther one is put into `found`, nothing where they have none. Arguments are those of `past_edges`.
    """
    known = np.where(np.isfinite(found.sigma), found.disparity, disparity)
    farther = extreme(np.minimum, np.where(np.isnan(known), np.inf, known), _FATTENED)
    beside = known - farther > _DEPTH_STEP
    about = extreme(np.maximum, beside, SIZES[0])
    untried = np.full((len(quarters), *known.shape), np.nan)
    each, own = _few_of(quarters)
    here, behind = (_Settled.none(len(quarters), known.shape) for _ in range(2))
    for surface, along in ((here, known), (behind, np.where(np.isfinite(farther), farther, np.nan))):
        light = few(each, np.where(about, along, np.nan), first.picture)
        light.settle(own, SIZES[1], untried, surface)
    wrong: Flags = beside & (behind.least < _CLEARLY * here.least)
    found.sigma[wrong] = np.inf
    # Windows that hold one, and as much again for slopes.
    near = extreme(np.maximum, wrong, 2 * SIZES[0] + 1)
    parts = [(views, np.where(near, along, np.nan)) for views, along in _parts(quarters, behind)]
    if wrong.any():
        found.take(look(parts, first.picture), wrong, limits)
    return wrong


def beside_steps(disparity: Array) -> Flags:
    """True where known disparities nearby, those that are numbers, differ by a depth step."""
    known = np.isfinite(disparity)
    most = extreme(np.maximum, np.where(known, disparity, -np.inf), SIZES[0])
    least = extreme(np.minimum, np.where(known, disparity, np.inf), SIZES[0])
    return np.asarray(most > least + _DEPTH_STEP)
