"""Views warped back along their disparity: their splines, and what they have in common at each microlens."""

from __future__ import annotations

import math

import numpy as np
from numpy import float32
from numpy.typing import NDArray

from .._jit import kernel, prange

Floats = NDArray[np.floating]
Samples = NDArray[np.float32]
Lines = NDArray[np.float64]
Whole = NDArray[np.int64]
Flags = NDArray[np.bool_]
Sums = tuple[Samples, Samples, Samples, Samples, Samples, Samples]
"""Sums of weights, with values and their squares, freedom, count, and room: arrays of their own, as of rows of one,
which might overlap, the compiler makes no vectors."""
Taps = tuple[float32, float32, float32, float32, float32, float32, float32, float32]

SUMS = 12
"""Maps that `common` makes: mean, weight, mean s (2), scatter of s (xx, xy, yy), moment of values with s (2), residual
chi-square, its expectation, number of samples."""
TAPS = 8
"""Samples along each axis that a place between them is interpolated from: by splines of degree 7. Those of degree 5
turn detail of 2.5 samples by 0.8 of what they should, and disparities of such texture would be 1.5 % too large."""
_POLES = (-0.5352804307964382, -0.12255461519232669, -0.009148694809608277)
"""Poles of the spline: roots of x^6 + 120 x^5 + 1191 x^4 + 2416 x^3 + ... + 1 inside the unit circle."""
_REACH = 27
"""Samples after which the slowest pole has died down to 5e-8."""
_BEYOND = 11
"""Samples that a view is continued beyond its sides before it is made a spline: 0.54^11 of an error comes back."""
_VECTOR = 16
"""Samples that the widest vectors hold."""
_SAME_PLACE = 1e-5
"""Difference of pupil coordinates, and of pitches, that is rounding."""
_SPLINE_LOSS = 0.1235
"""Noise power that a spline loses midway between two samples; elsewhere nearly (4 f (1 - f))^2.3 of it."""


@kernel()
def fill_holes(views: Samples, light: Samples) -> None:
    """Carry values into samples without light, along rows, then down columns, so that splines do not ring there."""
    count, rows, columns = views.shape
    for k in range(count):
        first = -1
        for v in range(rows):
            lit = -1
            for u in range(columns):
                if light[k, v, u] > 0:
                    if lit < 0:
                        for a in range(u):
                            views[k, v, a] = views[k, v, u]
                    lit = u
                elif lit >= 0:
                    views[k, v, u] = views[k, v, lit]
            if lit < 0 and first >= 0:
                for u in range(columns):
                    views[k, v, u] = views[k, v - 1, u]
            if lit >= 0 and first < 0:
                first = v
                for a in range(v):
                    for u in range(columns):
                        views[k, a, u] = views[k, v, u]
        if first < 0:
            for v in range(rows):
                for u in range(columns):
                    views[k, v, u] = 0.0


@kernel()
def _filter(lines: Floats, pole: float) -> None:
    """Divide by one pole of a spline, forth and back along the first axis, mirrored at its ends, but for a factor."""
    count, width = lines.shape
    for u in range(width):
        power = pole
        for v in range(1, min(_REACH, count)):
            lines[0, u] += power * lines[v, u]
            power *= pole
    for v in range(1, count):
        for u in range(width):
            lines[v, u] += pole * lines[v - 1, u]
    for u in range(width):
        lines[count - 1, u] = pole / (pole * pole - 1.0) * (lines[count - 1, u] + pole * lines[count - 2, u])
    for v in range(count - 2, -1, -1):
        for u in range(width):
            lines[v, u] = pole * (lines[v + 1, u] - lines[v, u])


@kernel()
def _extend(lines: Floats) -> None:
    """Go on beyond both ends, which are `_BEYOND` lines from the sides, as the lines before them turned about them."""
    count, width = lines.shape
    for k in range(1, _BEYOND + 1):
        inner = min(k, count - 2 * _BEYOND - 1)
        first, last = _BEYOND, count - 1 - _BEYOND
        for u in range(width):
            lines[first - k, u] = 2 * lines[first, u] - lines[first + inner, u]
            lines[last + k, u] = 2 * lines[last, u] - lines[last - inner, u]


@kernel(parallel=True)
def _coefficients(views: Samples, out: Samples) -> None:
    count, rows, columns = views.shape
    for k in prange(count):
        lying, standing = np.empty((columns + 2 * _BEYOND, rows)), np.empty((rows + 2 * _BEYOND, columns + TAPS - 2))
        for v in range(rows):
            for u in range(columns):
                lying[u + _BEYOND, v] = views[k, v, u]
        _extend(lying)
        for pole in _POLES:
            _filter(lying, pole)
        for v in range(rows):
            for u in range(columns + TAPS - 2):
                standing[v + _BEYOND, u] = lying[u + _BEYOND - 3, v]
        _extend(standing)
        for pole in _POLES:
            _filter(standing, pole)
        for v in range(rows + TAPS - 2):
            for u in range(columns + TAPS - 2):
                out[k, v, u] = standing[v + _BEYOND - 3, u]


def spline_coefficients(views: Samples) -> Samples:
    """Coefficients of each view's B-spline of degree 7, over 5040^2, three samples more on each side.

    Beyond its sides a view goes on as it was before them, turned about them. Hold `THREADS`.
    """
    count, rows, columns = views.shape
    out = np.empty((count, rows + TAPS - 2, columns + TAPS - 2), np.float32)
    _coefficients.compiled(views, out)
    return out


@kernel(inline=True)
def _taps(f: float32) -> Taps:
    """B-spline of degree 7 at the eight samples about a place `f` of a step after the fourth, times 5040.

    In single precision throughout: a constant of another type would make all that follows double.
    """
    one, seven, many, most = float32(1), float32(7), float32(21), float32(35)
    e = one - f
    f2, e2 = f * f, e * e
    f3, e3 = f2 * f, e2 * e
    f4, e4 = f2 * f2, e2 * e2
    first, last = e3 * e4, f3 * f4
    # B(2 + x) and B(1 + x) for x in [0, 1] by powers of 1 - x, B(x) by those of x.
    second = one + seven * e + many * e2 + most * e3 + e4 * (most + many * e + seven * e2 - seven * e3)
    seventh = one + seven * f + many * f2 + most * f3 + f4 * (most + many * f + seven * f2 - seven * f3)
    a, b, c, d, g, h = float32(120), float32(392), float32(504), float32(280), float32(84), float32(42)
    third = a + b * e + c * e2 + d * e3 - e4 * (g * e + h * e2 - many * e3)
    sixth = a + b * f + c * f2 + d * f3 - f4 * (g * f + h * f2 - many * f3)
    fourth = float32(2416) - float32(1680) * f2 + f4 * (float32(560) - float32(140) * f2 + most * f3)
    rest = float32(5040) - first - second - third - fourth - sixth - seventh - last
    return first, second, third, fourth, rest, sixth, seventh, last


def light_of_cells(light: Samples, full: Flags | None = None) -> Samples:
    """Light between four neighbouring samples, shape (view, v - 1, u - 1); 0 where one of 4 x 4 about it has none.

    Without light is what neighbours carry on to; `full` samples are dark by as much as nobody knows, and none of 6 x 6
    may be. The outermost of the 8 x 8 that are interpolated from weigh 2e-4 at most.
    """
    some_full = full is not None and bool(full.any())
    dimmest = light.min()
    if dimmest == light.max() and not some_full:
        return np.broadcast_to(dimmest, (len(light), light.shape[1] - 1, light.shape[2] - 1))
    mean = float32(0.25) * (light[:, :-1, :-1] + light[:, :-1, 1:] + light[:, 1:, :-1] + light[:, 1:, 1:])
    rows, columns = mean.shape[1:]
    for bad, reach in ((light <= 0, 1), (full, 2)):
        if bad is None or not bad.any():
            continue
        good = ~np.pad(bad, ((0, 0), (reach, reach), (reach, reach)))
        good = np.logical_and.reduce([good[:, k : k + rows] for k in range(2 * reach + 2)])
        mean *= np.logical_and.reduce([good[..., k : k + columns] for k in range(2 * reach + 2)])
    return np.asarray(mean)


@kernel(parallel=True)
def gather_zones(
    values: Samples, light: Samples, pupil: Floats, aside: Floats, zone: Whole, picture: Floats, electrons: float,
    read: float, out: Samples,
) -> None:  # fmt: skip
    """Mean value, information, pupil coordinate (2) and shift aside (2) of each zone; `out`: (zone, 6, v, u)."""
    count, rows, columns = values.shape
    for v in prange(rows):
        for k in range(count):
            z = zone[k]
            for u in range(columns):
                if light[k, v, u] > 0:
                    lit = electrons * light[k, v, u]
                    weight = lit * lit / max(lit * picture[v, u] + read * read, 1.0)
                    out[z, 0, v, u] += weight * (values[k, v, u] - picture[v, u])
                    out[z, 1, v, u] += weight
                    out[z, 2, v, u] += weight * pupil[0, k, v, u]
                    out[z, 3, v, u] += weight * pupil[1, k, v, u]
                    out[z, 4, v, u] += weight * aside[0, k, v, u]
                    out[z, 5, v, u] += weight * aside[1, k, v, u]
        for z in range(out.shape[0]):
            for u in range(columns):
                weight = out[z, 1, v, u]
                if weight > 0:
                    out[z, 0, v, u] = out[z, 0, v, u] / weight + picture[v, u]
                    for a in range(2, 6):
                        out[z, a, v, u] /= weight


@kernel()
def _add(values: NDArray[np.floating], times: float | float32, to: NDArray[np.floating]) -> None:
    """Add so many times a row's values: a kernel of its own, of which the compiler makes vectors."""
    for u in range(to.size):
        to[u] += times * values[u]


@kernel()
def window_sums(values: NDArray[np.floating], window: int, out: NDArray[np.floating]) -> None:
    """Sums over the window about each place of pictures, as far as it lies in them; shape (picture, v, u)."""
    count, rows, columns = values.shape
    reach, down, total = window // 2, np.zeros(columns + window), np.zeros(columns)
    inner = down[reach : reach + columns]
    for k in range(count):
        inner[:] = 0.0
        for v in range(-reach, rows):
            if v + reach < rows:
                _add(values[k, v + reach], 1.0, inner)
            if v > reach:
                _add(values[k, v - reach - 1], -1.0, inner)
            if v >= 0:
                total[:] = 0.0
                for a in range(window):
                    _add(down[a:], 1.0, total)
                out[k, v] = total


@kernel()
def _zeros(count: int) -> Samples:
    """Room for a row."""
    return np.zeros(count, float32)


@kernel()
def _room(count: int) -> Sums:
    """Room for sums over zones of a row."""
    return _zeros(count), _zeros(count), _zeros(count), _zeros(count), _zeros(count), _zeros(count)


@kernel()
def _clear(sums: Sums, start: int, stop: int) -> None:
    """Make columns `start` to `stop` of sums 0."""
    for each in sums:
        for u in range(start, stop):
            each[u] = float32(0)


@kernel()
def _add_zone(
    values: Samples, cells: Samples, expected: Samples, left: int, f: float32, g: float32, u: int, end: int,
    sums: Sums,
) -> None:  # fmt: skip
    """Add two rows of a zone, bilinear f and g of a sample beyond those `left` aside, to columns of a row's sums."""
    one, two, zero = float32(1), float32(2), float32(0)
    e, h = one - f, one - g
    kept = (one - two * f * e) * (one - two * g * h)
    here, wide = slice(u, end), slice(u + left, end + left + 1)
    above, below, light, mean = values[0, wide], values[1, wide], cells[wide], expected[here]
    total, moment, square = sums[0][here], sums[1][here], sums[2][here]
    free, count, value = sums[3][here], sums[4][here], sums[5][here]
    for i in range(end - u):
        value[i] = h * (e * above[i] + f * above[i + 1]) + g * (e * below[i] + f * below[i + 1]) - mean[i]
    for i in range(end - u):
        total[i] += light[i]
        moment[i] += light[i] * value[i]
    for i in range(end - u):
        square[i] += light[i] * value[i] * value[i]
    for i in range(end - u):
        free[i] += kept if light[i] > zero else zero
        count[i] += one if light[i] > zero else zero


@kernel(inline=True)
def _whole(zones: Samples, v: int, whole: Floats) -> None:
    """Tell which zones look from one place all along a row: those move as a whole, in vectors of the compiler's."""
    for z in range(zones.shape[0]):
        whole[z] = 1.0
        for u in range(zones.shape[3]):
            for a in range(2, 6):
                if zones[z, 1, v, u] <= 0 or abs(zones[z, a, v, u] - zones[z, a, v, 0]) > _SAME_PLACE:
                    whole[z] = 0.0


@kernel(inline=True)
def _add_zones(
    zones: Samples, cells: Samples, expected: Samples, disparity: float, steps: tuple[float, float], whole: Floats,
    v: int, start: int, stop: int, sums: Sums,
) -> None:  # fmt: skip
    """Add all zones, moved by a disparity, to columns `start` to `stop` of a row's sums."""
    rows, columns = zones.shape[2:]
    for z in range(zones.shape[0]):
        end = start
        while end < stop:
            u, end = end, end + 1
            if zones[z, 1, v, u] <= 0:
                continue
            x = u + (disparity * zones[z, 2, v, u] + zones[z, 4, v, u]) / steps[0]
            y = v + (disparity * zones[z, 3, v, u] + zones[z, 5, v, u]) / steps[1]
            if x < 0 or y < 0 or x > columns - 1 or y > rows - 1:
                continue
            a, b = min(int(x), columns - 2), min(int(y), rows - 2)
            if whole[z] > 0:
                end = max(end, columns - 1 - (a - u))
            _add_zone(
                zones[z, 0, b : b + 2], cells[z, b], expected, a - u, float32(x - a), float32(y - b), u,
                min(end, stop), sums,
            )  # fmt: skip


@kernel()
def _spread(sums: Sums, start: int, stop: int, squares: Samples, freedom: Samples) -> None:
    """Chi-square and freedom of sums over zones, at columns `start` to `stop` of a row."""
    total, moment, square, free, count, _ = sums
    one, zero = float32(1), float32(0)
    for u in range(start, stop):
        weight = total[u] if total[u] > zero else one
        squares[u] = max(square[u] - moment[u] * moment[u] / weight, zero)
    for u in range(start, stop):
        freedom[u] = free[u] * (one - one / max(count[u], one))


@kernel(parallel=True)
def spread_of_zones(
    zones: Samples, cells: Samples, picture: Samples, candidates: Lines, steps: tuple[float, float], some: Flags,
    squares: Samples, freedom: Samples, mean: Samples,
) -> None:  # fmt: skip
    """Chi-square of the zones about their mean at `some` microlenses, moved by each disparity.

    `steps` are pitches a sample. Shape (candidate, v, u) of `squares`, `freedom` and `mean`; `cells` has the least
    weight of each four neighbours, `picture` about what zones show, so that single precision is enough.
    """
    count, _, rows, columns = zones.shape
    for v in prange(rows):
        whole, sums = np.ones(count), _room(columns)
        total, moment = sums[:2]
        _whole(zones, v, whole)
        stop = 0
        while stop < columns:
            start, stop = stop, stop + 1
            if not some[v, start]:
                continue
            while stop < columns and some[v, stop]:
                stop += 1
            for c in range(candidates.size):
                _clear(sums, start, stop)
                _add_zones(zones, cells, picture[v], candidates[c], steps, whole, v, start, stop, sums)
                _spread(sums, start, stop, squares[c, v], freedom[c, v])
                for u in range(start, stop):
                    if total[u] > 0:
                        mean[c, v, u] = picture[v, u] + moment[u] / total[u]


@kernel(parallel=True)
def best_and_next(
    squares: Samples, freedoms: Samples, best: Whole, part: Floats, least: Floats, second: Floats, level: Floats
) -> None:  # fmt: skip
    """Best candidate of each microlens by chi-square over freedom, and floors of its dip and of the next.

    `part` of a step lies its floor beyond it by the parabola through it; where there is no floor it is infinite;
    `level` is the mean of all costs.
    """
    count, rows, columns = squares.shape
    for v in prange(rows):
        most, costs = np.zeros(columns, float32), np.full((count + 2, columns), float32(math.inf))
        lowest, some = np.full(columns, float32(math.inf)), np.zeros(columns)
        for u in range(columns):
            best[v, u], level[v, u], part[v, u], least[v, u], second[v, u] = 0, 0.0, 0.0, math.inf, math.inf
        for k in range(count):
            for u in range(columns):
                most[u] = max(most[u], freedoms[k, v, u])
        for k in range(count):
            for u in range(columns):
                # A candidate that few zones can judge would win by chance.
                if freedoms[k, v, u] > 0.5 and freedoms[k, v, u] >= 0.25 * most[u]:
                    cost = squares[k, v, u] / freedoms[k, v, u]
                    costs[k + 1, u] = cost
                    level[v, u] += cost
                    some[u] += 1
                    if cost < lowest[u]:
                        lowest[u], best[v, u] = cost, k
        for u in range(columns):
            level[v, u] /= max(some[u], 1.0)
        for k in range(count):
            for u in range(columns):
                here, before, after = costs[k + 1, u], costs[k, u], costs[k + 2, u]
                if not (here < math.inf and here <= before and here <= after):
                    continue
                bend, rise = np.float64(before) - 2 * here + after, np.float64(before) - after
                floor = np.float64(here)
                if 0 < bend < math.inf:
                    floor -= rise * rise / (8 * bend)
                    if k == best[v, u]:
                        part[v, u] = min(max(0.5 * rise / bend, -0.5), 0.5)
                if k == best[v, u]:
                    least[v, u] = floor
                elif abs(k - best[v, u]) >= 3 and floor < second[v, u]:
                    second[v, u] = floor


@kernel(inline=True)
def _row(line: Samples, i: int, taps: Taps) -> float32:
    total = float32(0)
    for j in range(TAPS):
        total += taps[j] * line[i + j]
    return total


@kernel()
def _interpolate(
    spline: Samples, light: Samples, left: Whole, above: Whole, f: Samples, g: Samples, out: Samples
) -> None:
    """A view at places f and g of a step beyond samples (left, above), wherever there is light."""
    end = 0
    while end < light.size:
        u, end = end, end + 1
        if light[u] <= 0:
            continue
        # Those that read neighbours are done in one go, which the compiler makes vectors of.
        a, b = left[u], above[u]
        while end < light.size and light[end] > 0 and left[end] - end == a - u and above[end] == b:
            end += 1
        # Whole vectors, if half of the first is needed: what lies beyond its run is written over by the next.
        count = (end - u + _VECTOR - 1) // _VECTOR * _VECTOR if 2 * (end - u) >= _VECTOR else end - u
        count = min(count, light.size - u, spline.shape[1] - TAPS + 1 - a)
        wide = slice(a, a + count + TAPS - 1)
        first, second, third, fourth = spline[b, wide], spline[b + 1, wide], spline[b + 2, wide], spline[b + 3, wide]
        fifth, sixth, seventh, last = spline[b + 4, wide], spline[b + 5, wide], spline[b + 6, wide], spline[b + 7, wide]
        values, along, down = out[u : u + count], f[u : u + count], g[u : u + count]
        for i in range(values.size):
            across, over = _taps(along[i]), _taps(down[i])
            values[i] = (
                over[0] * _row(first, i, across) + over[1] * _row(second, i, across)
                + over[2] * _row(third, i, across) + over[3] * _row(fourth, i, across)
                + over[4] * _row(fifth, i, across) + over[5] * _row(sixth, i, across)
                + over[6] * _row(seventh, i, across) + over[7] * _row(last, i, across)
            )  # fmt: skip


@kernel()
def _split(disparity: Samples, slope: float32, aside: float32, whole: Whole, part: Samples) -> None:
    """Split what each disparity moves by, in samples, into whole ones and the part of one beyond them."""
    one, zero = float32(1), float32(0)
    for i in range(disparity.size):
        moved = disparity[i] * slope + aside
        down = int(moved)
        rest = moved - float32(down)
        whole[i] = down - 1 if rest < zero else down
        part[i] = rest + one if rest < zero else rest


@kernel()
def _place(
    at: Whole, v: int, cells: Samples, left: Whole, above: Whole, f: Samples, g: Samples, light: Samples
) -> None:
    """Samples before the places that lie so far from those `at` columns of a row, and the light there, or 0 outside."""
    rows, columns, one, zero = cells.shape[0] + 1, cells.shape[1] + 1, float32(1), float32(0)
    for i in range(at.size):
        a, b = at[i] + left[i], v + above[i]
        # The last sample is the end of the last cell.
        ends, stops = a == columns - 1 and f[i] == zero, b == rows - 1 and g[i] == zero
        a, b = a - 1 if ends else a, b - 1 if stops else b
        f[i], g[i] = one if ends else f[i], one if stops else g[i]
        inside = (a >= 0) & (b >= 0) & (a <= columns - 2) & (b <= rows - 2)
        left[i], above[i], light[i] = a if inside else 0, b if inside else 0, one if inside else zero
    for i in range(at.size):
        light[i] *= cells[above[i], left[i]]


@kernel()
def _weigh(
    light: Samples, expected: Samples, variance: float32, robust: float32, value: Samples, weight: Samples
) -> None:
    """Make values differences from what is expected, and tell their weights; see `common`."""
    one = float32(1)
    for i in range(value.size):
        value[i] -= expected[i]
    for i in range(value.size):
        weight[i] = light[i] * light[i] / max(light[i] * expected[i] + variance, one)
    if robust < math.inf:
        for i in range(value.size):
            weight[i] *= robust / max(abs(value[i]) * math.sqrt(weight[i]), robust)


@kernel()
def _add_moments(
    light: Samples, weight: Samples, pupils: Samples, value: Samples, f: Samples, g: Samples, sums: Samples,
    part: Samples,
) -> None:  # fmt: skip
    """Add a view's moments of 1, pupil coordinates and value, freedom and count to sums; `part` is room for a row."""
    n, count = 0, weight.size
    for first in range(4):
        here = pupils[first] if first < 3 else value
        for i in range(count):
            part[i] = weight[i] * here[i]
        for second in range(first, 4):
            total, there = sums[n], pupils[second] if second < 3 else value
            for i in range(count):
                total[i] += part[i] * there[i]
            n += 1
    free, some, one, four, loss = sums[10], sums[11], float32(1), float32(4), float32(_SPLINE_LOSS)
    for i in range(count):
        lost, less = four * f[i] * (one - f[i]), four * g[i] * (one - g[i])
        kept = (one - loss * lost * lost) * (one - loss * less * less)
        free[i] += kept if light[i] > float32(0) else float32(0)
    for i in range(count):
        some[i] += one if light[i] > float32(0) else float32(0)


@kernel(parallel=True)
def common(
    splines: Samples, cells: Samples, pupil: Floats, aside: Floats, still: bool, chosen: Whole, disparity: Floats,
    picture: Floats, peak: Floats, steps: tuple[float, float], electrons: float, read: float, brightest: float,
    robust: float, out: Floats,
) -> None:  # fmt: skip
    """Moments of chosen views about each microlens of `picture`, warped back by `disparity` and `aside`; see `SUMS`.

    Weights are the inverse variance that `picture`, not the noisy sample, predicts; beyond `robust` standard errors
    from it they fall as Huber's. Where `peak`, the brightest about a microlens, makes more than `brightest` electrons,
    nothing is used: what by chance did not saturate would be dark by selection. `still`: each view looks from one
    place and to one side all over. `out` may have the first of the maps alone; it stays where no disparity is a number.
    """
    rows, columns = disparity.shape
    one, zero = float32(1), float32(0)
    for v in prange(rows):
        at, some = np.empty(columns, np.int64), 0
        for u in range(columns):
            if not math.isnan(disparity[v, u]):
                at[some] = u
                some += 1
        # Each of its own: of what might overlap the compiler makes no vectors.
        sums, pupils = np.zeros((SUMS, some), float32), np.ones((3, some), float32)
        left, above = np.zeros(some, np.int64), np.zeros(some, np.int64)
        light, weight, f, g = _zeros(some), _zeros(some), _zeros(some), _zeros(some)
        expected, moves, part, value = _zeros(some), _zeros(some), _zeros(some), _zeros(some)
        for i in range(some):
            expected[i], moves[i] = picture[v, at[i]], disparity[v, at[i]]
        for k in chosen:
            if still:
                along, over = pupil[0, k, v, 0], pupil[1, k, v, 0]
                _split(moves, float32(along / steps[0]), float32(aside[0, k, v, 0] / steps[0]), left, f)
                _split(moves, float32(over / steps[1]), float32(aside[1, k, v, 0] / steps[1]), above, g)
                pupils[1], pupils[2] = float32(along), float32(over)
                _place(at[:some], v, cells[k], left, above, f, g, light)
            else:
                for i in range(some):
                    u = at[i]
                    light[i] = zero
                    along, over = pupil[0, k, v, u], pupil[1, k, v, u]
                    x = u + (disparity[v, u] * along + aside[0, k, v, u]) / steps[0]
                    y = v + (disparity[v, u] * over + aside[1, k, v, u]) / steps[1]
                    if not (x >= 0 and y >= 0 and x <= columns - 1 and y <= rows - 1):
                        continue
                    # The pupil coordinate is that of the microlens whose light this is, not of the one it is warped to.
                    there, below = int(x + 0.5), int(y + 0.5)
                    near, lower = pupil[0, k, below, there], pupil[1, k, below, there]
                    if near != along or lower != over:
                        along, over = near, lower
                        x = u + (disparity[v, u] * along + aside[0, k, v, u]) / steps[0]
                        y = v + (disparity[v, u] * over + aside[1, k, v, u]) / steps[1]
                        if not (x >= 0 and y >= 0 and x <= columns - 1 and y <= rows - 1):
                            continue
                    a, b = min(int(x), columns - 2), min(int(y), rows - 2)
                    left[i], above[i], f[i], g[i] = a, b, x - a, y - b
                    pupils[1, i], pupils[2, i] = along, over
                    light[i] = cells[k, b, a]
            for i in range(some):
                charge = light[i] * float32(electrons)
                light[i] = charge if charge * peak[v, at[i]] < brightest else zero
            _interpolate(splines[k], light, left, above, f, g, value)
            _weigh(light, expected, float32(read * read), float32(robust), value, weight)
            _add_moments(light, weight, pupils, value, f, g, sums, part)
        for i in range(some):
            total = sums[0, i]
            if total > 0:
                x, y, mean = sums[1, i] / total, sums[2, i] / total, sums[3, i] / total
                sums[4, i] -= total * x * x
                sums[5, i] -= total * x * y
                sums[6, i], sums[7, i] = sums[7, i] - total * y * y, sums[6, i] - sums[3, i] * x
                sums[8, i] -= sums[3, i] * y
                sums[9, i] = max(sums[9, i] - sums[3, i] * mean, zero)
                sums[10, i] *= one - one / sums[11, i]
                sums[0, i], sums[1, i], sums[2, i], sums[3, i] = mean + expected[i], total, x, y
            else:
                sums[:, i] = zero
        for a in range(out.shape[0]):
            here, there = out[a, v], sums[a]
            for i in range(some):
                here[at[i]] = there[i]
