"""Views warped back along their disparity: their splines, and what they have in common at each microlens."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy import float32
from numpy.typing import NDArray

from .._jit import WHOLE, Band, kernel, prange

Floats = NDArray[np.floating]
Samples = NDArray[np.float32]
Lines = NDArray[np.float64]
Whole = NDArray[np.int64]
Flags = NDArray[np.bool_]
Sums = tuple[Samples, Samples, Samples, Samples, Samples, Samples]
"""Sums of weights, with values and their squares, freedom, count, and room: arrays of their own, as of rows of one,
which might overlap, the compiler makes no vectors."""

SUMS = 12
"""Maps that `common` makes: mean, weight, mean s (2), scatter of s (xx, xy, yy), moment of values with s (2), residual
chi-square, its expectation, number of samples."""
TAPS = 8
"""Samples along each axis that a place between them is interpolated from, by polynomials of degree 7. Splines of degree
5 turn detail of 2.5 samples by 0.8 of what they should, those of degree 7 by 0.92: disparities of detail of 2.34
samples, as walls have at their far ends, were 1 % too large."""
_SHARPER = 1 / (2 * math.pi * 0.62) ** 2
"""Share of its second derivative that the spline of degree 7 has as well (Blu, Thevenaz and Unser 2001: MOMS), by which
it passes nothing at 0.62 periods a sample, the mirror image of the finest detail: that is turned by 0.99 then."""
_B_SPLINE = tuple(
    tuple(
        float(sum((-1) ** k * math.comb(8, k) * math.comb(7, m) * (7 - j - k) ** (7 - m) for k in range(8 - j)))
        for m in range(8)
    )
    for j in range(TAPS)
)
_PIECES = tuple(
    tuple(
        (c + (_SHARPER * (m + 2) * (m + 1) * line[m + 2] if m < 6 else 0.0)) / (1 + 42 * _SHARPER)
        for m, c in enumerate(line)
    )
    for line in _B_SPLINE
)
"""Coefficients of their polynomials in the part of a step that a place lies beyond the fourth, times a factor."""
_POLES = (-0.6460092239394939, -0.19827440011293504, -0.02379777982116882)
"""Poles inside the unit circle of their values at whole steps."""
_REACH = 39
"""Samples after which the slowest pole has died down to 5e-8."""
_BEYOND = 16
"""Samples that a view is continued beyond its sides before it is made a spline: 0.65^16 of an error comes back."""
_VECTOR = 16
"""Samples that the widest vectors hold."""
_FEW = 6
"""Samples in a row below which each is worked out by itself."""
_LINES = 32
"""Lines that are made splines together, a multiple of `_VECTOR`."""
_TILE = 16
"""Rows that are worked out one after the other, by one thread."""
_TOGETHER = 512
"""Places that are worked out together at most: calls are dear of fewer, and more do not lie in the nearer caches."""
_OUTSIDE = -9
"""Sample before a place that lies outside."""
_SAME_PLACE = 1e-5
"""Difference of pupil coordinates, and of pitches, that is rounding."""
_SPLINE_LOSS = 0.0805
"""Noise power that a spline loses midway between two samples; elsewhere nearly (4 f (1 - f))^2.3 of it."""
_UNSEEN, _FADES, _CELLS = 0.0124, 0.22, 6
"""Variance of places d samples before the last, by those beyond a view's sides, which nobody knows: `_UNSEEN` times
sin^2(pi d) `_FADES`^d of the mean square of second differences, with detail of 2.5 samples, less of coarser; steps
up to which that is looked at."""


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
def divide_by_poles(lines: Samples, poles: tuple[float, ...]) -> None:
    """Divide by the poles of a spline's values along the first axis, mirrored at its ends, but for a factor."""
    count, width = lines.shape
    for each in poles:
        pole, power = float32(each), float32(each)
        last = float32(each / (each * each - 1.0))
        for v in range(1, min(_REACH, count)):
            add(lines[v], power, lines[0])
            power *= pole
        for v in range(1, count):
            add(lines[v - 1], pole, lines[v])
        for u in range(width):
            lines[count - 1, u] = last * (lines[count - 1, u] + pole * lines[count - 2, u])
        for v in range(count - 2, -1, -1):
            for u in range(width):
                lines[v, u] = pole * (lines[v + 1, u] - lines[v, u])


@kernel()
def _extend(lines: Samples) -> None:
    """Go on beyond both ends, which are `_BEYOND` lines from the sides, as the lines before them turned about them."""
    count, width = lines.shape
    for k in range(1, _BEYOND + 1):
        inner = min(k, count - 2 * _BEYOND - 1)
        first, last = _BEYOND, count - 1 - _BEYOND
        for u in range(width):
            lines[first - k, u] = lines[first, u] + (lines[first, u] - lines[first + inner, u])
            lines[last + k, u] = lines[last, u] + (lines[last, u] - lines[last - inner, u])


@kernel(parallel=True)
def _coefficients(views: Samples, out: Samples, band: Band = WHOLE) -> None:
    count, rows, columns = views.shape
    for k in prange(count, band):
        # So many lines at a time as lie in the nearest cache.
        lying = np.zeros((columns + 2 * _BEYOND, _LINES), float32)
        standing = np.zeros((rows + 2 * _BEYOND, _LINES), float32)
        between = np.empty((rows, columns + TAPS - 2), float32)
        for top in range(0, rows, _LINES):
            some = min(_LINES, rows - top)
            for v in range(some):
                for u in range(columns):
                    lying[u + _BEYOND, v] = views[k, top + v, u]
            _extend(lying)
            divide_by_poles(lying, _POLES)
            for v in range(some):
                for u in range(columns + TAPS - 2):
                    between[top + v, u] = lying[u + _BEYOND - 3, v]
        for left in range(0, columns + TAPS - 2, _LINES):
            some = min(_LINES, columns + TAPS - 2 - left)
            for v in range(rows):
                for u in range(some):
                    standing[v + _BEYOND, u] = between[v, left + u]
            _extend(standing)
            divide_by_poles(standing, _POLES)
            for v in range(rows + TAPS - 2):
                for u in range(some):
                    out[k, v, left + u] = standing[v + _BEYOND - 3, u]


def spline_coefficients(views: Samples) -> Samples:
    """Coefficients of each view's B-spline of degree 7, over 5040^2, three samples more on each side.

    Beyond its sides a view goes on as it was before them, turned about them.
    """
    count, rows, columns = views.shape
    out = np.empty((count, rows + TAPS - 2, columns + TAPS - 2), np.float32)
    _coefficients.compiled(views, out)
    return out


@kernel(apart=True)
def _taps(part: Samples, taps: Samples) -> None:
    """B-spline of degree 7 at the eight samples about places `part` of a step after the fourth, times 5040: (8, place).

    In single precision throughout: a constant of another type would make all that follows double.
    """
    for j in range(TAPS):
        k = _PIECES[j]
        a, b, c, d = float32(k[0]), float32(k[1]), float32(k[2]), float32(k[3])
        e, f, g, h = float32(k[4]), float32(k[5]), float32(k[6]), float32(k[7])
        line = taps[j]
        for i in range(part.size):
            x = part[i]
            line[i] = a + x * (b + x * (c + x * (d + x * (e + x * (f + x * (g + x * h))))))


def light_of_cells(light: Samples, full: Flags | None = None) -> Samples:
    """Light between four neighbouring samples, shape (view, v - 1, u - 1); 0 where one of 4 x 4 about it has none.

    Without light is what neighbours carry on to; `full` samples are dark by as much as nobody knows, and none of 6 x 6
    may be. The outermost of the 8 x 8 that are interpolated from weigh 2e-4 at most.
    """
    some_full = full is not None and bool(full.any())
    dimmest = light.min() if any(light.strides) else light.flat[0]
    if (not any(light.strides) or dimmest == light.max()) and not some_full:
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


@kernel(apart=True)
def _add_weighted(values: Samples, weight: Samples, less: Samples, to: Samples) -> None:
    """Add values beyond others, times their weights, to a row; what has none may be no number."""
    for u in range(to.size):
        to[u] += weight[u] * (values[u] - less[u]) if weight[u] > float32(0) else float32(0)


@kernel(apart=True)
def _divide(to: Samples, weight: Samples) -> None:
    """Divide sums along a row by their weights, if any."""
    for u in range(to.size):
        to[u] = to[u] / max(weight[u], float32(1e-30))


@kernel(parallel=True)
def gather_zones(
    values: Samples, light: Samples, pupil: Floats, aside: Floats, zone: Whole, picture: Floats, electrons: float,
    read: float, out: Samples, band: Band = WHOLE,
) -> None:  # fmt: skip
    """Mean value, information, pupil coordinate (2) and shift aside (2) of each zone; `out`: (zone, 6, v, u)."""
    count, rows, columns = values.shape
    for v in prange(rows, band):
        lit, expected, weight, root = _zeros(columns), _zeros(columns), _zeros(columns), _zeros(columns)
        for u in range(columns):
            expected[u] = picture[v, u]
        for k in range(count):
            z = zone[k]
            for u in range(columns):
                lit[u] = light[k, v, u] * float32(electrons)
            _inform(lit, expected, float32(read * read), weight, root)
            _add_weighted(values[k, v], weight, expected, out[z, 0, v])
            for u in range(columns):
                out[z, 1, v, u] += weight[u]
                root[u] = 0.0
            for axis in range(2):
                _add_weighted(pupil[axis, k, v], weight, root, out[z, 2 + axis, v])
                _add_weighted(aside[axis, k, v], weight, root, out[z, 4 + axis, v])
        for z in range(out.shape[0]):
            for a in range(2, 6):
                _divide(out[z, a, v], out[z, 1, v])
            _divide(out[z, 0, v], out[z, 1, v])
            for u in range(columns):
                out[z, 0, v, u] += expected[u] if out[z, 1, v, u] > 0 else float32(0)


@kernel()
def add(values: NDArray[np.floating], times: float | float32, to: NDArray[np.floating]) -> None:
    """Add so many times a row's values: a kernel of its own, of which the compiler makes vectors."""
    for u in range(to.size):
        to[u] += times * values[u]


@kernel()
def clear(to: NDArray[np.floating]) -> None:
    """Make a row 0, as `add` by a kernel of its own: what assigns to slices is no vector."""
    for u in range(to.size):
        to[u] = 0.0


@kernel()
def window_sums(values: NDArray[np.floating], window: int, out: NDArray[np.floating]) -> None:
    """Sums over the window about each place of pictures, as far as it lies in them; shape (picture, v, u)."""
    count, rows, columns = values.shape
    # A wide one is three side by side.
    part, times = (window // 3, 3) if window % 3 == 0 else (window, 1)
    beside = np.zeros(columns + window - part)
    reach, down, total = window // 2, np.zeros(columns + window), np.zeros(columns)
    inner = down[reach : reach + columns]
    for k in range(count):
        clear(inner)
        for v in range(-reach, rows):
            if v + reach < rows:
                add(values[k, v + reach], 1.0, inner)
            if v > reach:
                add(values[k, v - reach - 1], -1.0, inner)
            if v >= 0:
                clear(beside)
                clear(total)
                for a in range(part):
                    add(down[a:], 1.0, beside)
                for a in range(times):
                    add(beside[a * part :], 1.0, total)
                for u in range(columns):
                    out[k, v, u] = total[u]


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
    squares: Samples, freedom: Samples, mean: Samples, band: Band = WHOLE,
) -> None:  # fmt: skip
    """Chi-square of the zones about their mean at `some` microlenses, moved by each disparity.

    `steps` are pitches a sample. Shape (candidate, v, u) of `squares`, `freedom` and `mean`; `cells` has the least
    weight of each four neighbours, `picture` about what zones show, so that single precision is enough.
    """
    count, _, rows, columns = zones.shape
    for v in prange(rows, band):
        inside = np.flatnonzero(some[v])
        if not inside.size:
            continue
        # Those between are added up as well: calls are dear of few.
        start, stop, whole, sums = inside[0], inside[-1] + 1, np.ones(count), _room(columns)
        total, moment = sums[:2]
        _whole(zones, v, whole)
        for c in range(candidates.size):
            _clear(sums, start, stop)
            _add_zones(zones, cells, picture[v], candidates[c], steps, whole, v, start, stop, sums)
            _spread(sums, start, stop, squares[c, v], freedom[c, v])
            for u in range(start, stop):
                if not some[v, u]:
                    squares[c, v, u], freedom[c, v, u] = 0.0, 0.0
                elif total[u] > 0:
                    mean[c, v, u] = picture[v, u] + moment[u] / total[u]


@kernel(parallel=True)
def best_and_next(
    squares: Samples, freedoms: Samples, best: Whole, part: Floats, least: Floats, second: Floats, level: Floats,
    band: Band = WHOLE
) -> None:  # fmt: skip
    """Best candidate of each microlens by chi-square over freedom, and floors of its dip and of the next.

    `part` of a step lies its floor beyond it by the parabola through it; where there is no floor it is infinite;
    `level` is the mean of all costs.
    """
    count, rows, columns = squares.shape
    for v in prange(rows, band):
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
def _row(
    line: Samples, i: int, a: Samples, b: Samples, c: Samples, d: Samples, e: Samples, f: Samples, g: Samples,
    h: Samples,
) -> Any:  # fmt: skip
    return (
        a[i] * line[i] + b[i] * line[i + 1] + c[i] * line[i + 2] + d[i] * line[i + 3]
        + e[i] * line[i + 4] + f[i] * line[i + 5] + g[i] * line[i + 6] + h[i] * line[i + 7]
    )  # fmt: skip


@kernel(apart=True)
def _interpolate(
    spline: Samples, left: Whole, above: Whole, ends: Whole, stops: Whole, across: Samples, down: Samples,
    line: Samples, out: Samples,
) -> None:  # fmt: skip
    """A view at places beyond samples (left, above), in runs of them inside, by taps across and down.

    `line` is room for `TAPS` numbers.
    """
    end = 0
    while end < out.size:
        # Those that read neighbours are done in one go, which the compiler makes vectors of.
        u, end = end, min(ends[end], stops[end])
        v, start = above[u], left[u]
        if v < 0 or start < 0:
            continue
        if end - u < _FEW:
            # One by one vectors are along the taps; a number of them that the compiler knew it would unroll instead.
            for i in range(u, end):
                k, l, m, n = down[0, i], down[1, i], down[2, i], down[3, i]
                o, p, q, r = down[4, i], down[5, i], down[6, i], down[7, i]
                first = left[i]
                for j in range(line.size if first >= 0 else 0):  # indices below 0, which are none, are no vectors
                    at = first + j
                    line[j] = (
                        (k * spline[v, at] + l * spline[v + 1, at]) + (m * spline[v + 2, at] + n * spline[v + 3, at])
                        + ((o * spline[v + 4, at] + p * spline[v + 5, at])
                           + (q * spline[v + 6, at] + r * spline[v + 7, at]))
                    )  # fmt: skip
                a, b, c, d = across[0, i], across[1, i], across[2, i], across[3, i]
                e, f, g, h = across[4, i], across[5, i], across[6, i], across[7, i]
                out[i] = ((a * line[0] + b * line[1]) + (c * line[2] + d * line[3])) + (
                    (e * line[4] + f * line[5]) + (g * line[6] + h * line[7])
                )
            continue
        # Whole vectors, half ones for short runs: what lies beyond its run is written over by the next.
        vector = _VECTOR // 2 if end - u <= _VECTOR // 2 else _VECTOR
        count = min((end - u + vector - 1) // vector * vector, out.size - u, spline.shape[1] - TAPS + 1 - start)
        some, wide, values = slice(u, u + count), slice(start, start + count + TAPS - 1), out[u : u + count]
        first, second, third, fourth = spline[v, wide], spline[v + 1, wide], spline[v + 2, wide], spline[v + 3, wide]
        fifth, sixth, seventh, last = spline[v + 4, wide], spline[v + 5, wide], spline[v + 6, wide], spline[v + 7, wide]
        a, b, c, d = across[0, some], across[1, some], across[2, some], across[3, some]
        e, f, g, h = across[4, some], across[5, some], across[6, some], across[7, some]
        k, l, m, n = down[0, some], down[1, some], down[2, some], down[3, some]
        o, p, q, r = down[4, some], down[5, some], down[6, some], down[7, some]
        for i in range(values.size):
            values[i] = (
                k[i] * _row(first, i, a, b, c, d, e, f, g, h) + l[i] * _row(second, i, a, b, c, d, e, f, g, h)
                + m[i] * _row(third, i, a, b, c, d, e, f, g, h) + n[i] * _row(fourth, i, a, b, c, d, e, f, g, h)
                + o[i] * _row(fifth, i, a, b, c, d, e, f, g, h) + p[i] * _row(sixth, i, a, b, c, d, e, f, g, h)
                + q[i] * _row(seventh, i, a, b, c, d, e, f, g, h) + r[i] * _row(last, i, a, b, c, d, e, f, g, h)
            )  # fmt: skip


@kernel(apart=True)
def _place(disparity: Samples, slope: float32, aside: float32, at: Whole, size: int, first: Whole, f: Samples) -> None:
    """First of two neighbours of `size` samples about each place that lies so far from `at`, or `_OUTSIDE`, and f."""
    one, zero = float32(1), float32(0)
    for i in range(at.size):
        moved = disparity[i] * slope + aside
        whole = int(moved)
        rest = moved - float32(whole)
        a, rest = (at[i] + whole - 1, rest + one) if rest < zero else (at[i] + whole, rest)
        # The last sample is the end of the last step.
        ends = a == size - 1 and rest == zero
        a, f[i] = (a - 1, one) if ends else (a, rest)
        first[i] = a if 0 <= a <= size - 2 else _OUTSIDE


@kernel(apart=True)
def _prepare(
    first: Whole, ahead: int, f: Samples, size: int, ends: Whole, taps: Samples, lit: Samples, kept: Samples,
    unseen: Samples,
) -> None:  # fmt: skip
    """Ends of runs whose samples lie each so far ahead of the one before; taps, 1 inside, and freedom that is left.

    `unseen`: variance by what lies beyond `size` samples, over the mean square of second differences.
    """
    one, four, loss, count, some = float32(1), float32(4), float32(_SPLINE_LOSS), f.size, 0
    for i in range(count):
        unseen[i] = float32(0)
        if first[i] < _CELLS or first[i] > size - 2 - _CELLS:
            ends[some] = i  # few, of which powers are dear
            some += 1
    for j in range(some):
        i = ends[j]
        before = min(first[i], size - 2 - first[i])
        if 0 <= before < _CELLS:
            lost, beyond = four * f[i] * (one - f[i]), f[i] if before == first[i] else one - f[i]
            unseen[i] = float32(_UNSEEN) * lost * lost * float32(_FADES) ** (float32(before) + beyond)
    end = count
    for i in range(count - 1, -1, -1):
        if i < count - 1 and first[i + 1] - first[i] != ahead:
            end = i + 1
        ends[i] = end
    _taps(f, taps)
    for i in range(count):
        lit[i] = one if first[i] >= 0 else float32(0)
    for i in range(count):
        lost = four * f[i] * (one - f[i])
        kept[i] = one - loss * lost * lost


@kernel(apart=True)
def _doubt(
    across: Samples, rough: Samples, down: Samples, rough_down: Samples, views: float32, whole: Samples, lit: Samples
) -> None:
    """Take samples for as much less as what nobody saw errs in them, alike in all `views`."""
    one = float32(1)
    for i in range(lit.size):
        lit[i] /= one + views * whole[i] * (across[i] * rough[i] + down[i] * rough_down[i])


@kernel(apart=True)
def _inform(light: Samples, expected: Samples, variance: float32, weight: Samples, root: Samples) -> None:
    """Information of samples by what is expected of them, and its root."""
    one = float32(1)
    for i in range(weight.size):
        weight[i] = light[i] * light[i] / max(light[i] * expected[i] + variance, one)
    for i in range(weight.size):
        root[i] = math.sqrt(weight[i])


@kernel(apart=True)
def _weigh(
    lit: Samples, expected: Samples, whole: Samples, root: Samples, robust: float32, value: Samples, weight: Samples
) -> None:
    """Make values differences from what is expected, and tell their weights; see `common`."""
    for i in range(value.size):
        value[i] -= expected[i]
    if robust < math.inf:
        for i in range(value.size):
            weight[i] = lit[i] * whole[i] * (robust / max(abs(value[i]) * root[i], robust))
    else:
        for i in range(value.size):
            weight[i] = lit[i] * whole[i]


@kernel(apart=True)
def _add_moments(
    lit: Samples, weight: Samples, x: Samples, y: Samples, value: Samples, kept: Samples, less: Samples, sums: Samples
) -> None:
    """Add a view's moments of 1, pupil coordinates and value, freedom and count to sums."""
    count = weight.size
    whole, over, under, mean = sums[0], sums[1], sums[2], sums[3]
    for i in range(count):
        w = weight[i]
        whole[i] += w
        over[i] += w * x[i]
        under[i] += w * y[i]
        mean[i] += w * value[i]
    xx, xy, yy = sums[4], sums[5], sums[7]
    for i in range(count):
        across, down = weight[i] * x[i], weight[i] * y[i]
        xx[i] += across * x[i]
        xy[i] += across * y[i]
        yy[i] += down * y[i]
    along, below, square = sums[6], sums[8], sums[9]
    for i in range(count):
        pull = weight[i] * value[i]
        along[i] += pull * x[i]
        below[i] += pull * y[i]
        square[i] += pull * value[i]
    free, some = sums[10], sums[11]
    for i in range(count):
        free[i] += lit[i] * kept[i] * less[i]
        some[i] += lit[i]


@kernel()
def _place_each(
    k: int, own: Whole, at: Whole, disparity: Floats, pupil: Floats, aside: Floats, steps: tuple[float, float],
    left: Whole, above: Whole, f: Samples, g: Samples, pupils: Samples,
) -> None:  # fmt: skip
    """As `_place`, along both axes, of a view whose samples look each from a place of its own, and these places."""
    rows, columns = disparity.shape
    for i in range(at.size):
        u, v = at[i], own[i]
        left[i], above[i] = _OUTSIDE, _OUTSIDE
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
        left[i], above[i] = min(int(x), columns - 2), min(int(y), rows - 2)
        f[i], g[i] = x - left[i], y - above[i]
        pupils[0, i], pupils[1, i] = along, over


@kernel(apart=True)
def _centre(expected: Samples, sums: Samples) -> None:
    """Make moments those about the mean, in the order of `SUMS`; `sums` begins with them."""
    one, zero = float32(1), float32(0)
    for i in range(expected.size):
        total = sums[0, i]
        if total > 0:
            x, y, mean = sums[1, i] / total, sums[2, i] / total, sums[3, i] / total
            sums[4, i] -= total * x * x
            sums[5, i] -= total * x * y
            sums[6, i], sums[7, i] = sums[7, i] - total * y * y, sums[6, i] - sums[3, i] * x
            sums[8, i] -= sums[3, i] * y
            sums[9, i] = max(sums[9, i] - sums[3, i] * mean, zero)
            sums[10, i] *= one - one / max(sums[11, i], one)
            sums[0, i], sums[1, i], sums[2, i], sums[3, i] = mean + expected[i], total, x, y
        else:
            sums[:, i] = zero


@kernel()
def _lines(pupil: Floats, aside: Floats, chosen: Whole, still: bool) -> tuple[Whole, Whole, Whole]:
    """Line of views that each is of, along both axes, which look from alike; one view of each line, and their count.

    All are of one line where views look from other places all over.
    """
    line, one, count = (
        np.zeros((2, pupil.shape[1]), np.int64),
        np.zeros((2, chosen.size), np.int64),
        np.ones(2, np.int64),
    )
    for axis in range(2 if still else 0):
        n = 0
        for k in chosen:
            g = 0
            while g < n and (
                pupil[axis, one[axis, g], 0, 0] != pupil[axis, k, 0, 0]
                or aside[axis, one[axis, g], 0, 0] != aside[axis, k, 0, 0]
            ):
                g += 1
            one[axis, g], line[axis, k], n = k, g, max(n, g + 1)
        count[axis] = n
    return line, one, count


@kernel()
def _places(disparity: Floats) -> Whole:
    """Columns and rows of the places at which disparity is a number, shape (2, place)."""
    rows, columns = disparity.shape
    places, total = np.empty((2, rows * columns), np.int64), 0
    for v in range(rows):
        for u in range(columns):
            places[0, total], places[1, total] = u, v
            total += not math.isnan(disparity[v, u])
    return places[:, :total]


@kernel(parallel=True)
def common(
    splines: Samples, cells: Samples, pupil: Floats, aside: Floats, still: bool, even: bool, chosen: Whole,
    disparity: Floats, picture: Floats, rough: Samples, peak: Floats, steps: tuple[float, float], electrons: float,
    read: float, brightest: float, robust: float, out: Floats, slot: Whole, each: Samples, band: Band = WHOLE,
) -> None:  # fmt: skip
    """Moments of chosen views about each microlens of `picture`, warped back by `disparity` and `aside`; see `SUMS`.

    Weights are the inverse variance that `picture`, not the noisy sample, predicts; beyond `robust` standard errors
    from it they fall as Huber's, and with what lies beyond a view's sides, by `rough`: mean squares of the picture's
    second differences, along u and v. Where `peak`, the brightest about a microlens, makes more than `brightest`
    electrons, nothing is used: what by chance did not saturate would be dark by selection. `still`: each view looks
    from one place and to one side all over; `even`: all samples have the same light, none near saturation. `out` stays
    where no disparity is a number. Views with a `slot` leave there what they show and its weights (slot, 2, v, u).
    """
    rows, columns = disparity.shape
    one, zero = float32(1), float32(0)
    line, example, lines = _lines(pupil, aside, chosen, still)
    most = lines.max()
    places = _places(disparity)
    total = places.shape[1]
    # Room for some places, had once for all of them: new pages are slow to come by.
    size = min(_TOGETHER, total)
    room, sums, pupils = np.zeros((8, size), float32), np.zeros((SUMS, size), float32), np.ones((2, size), float32)
    first, ends = np.zeros((2, most, size), np.int64), np.zeros((2, most, size), np.int64)
    taps, parts = np.zeros((2, most, TAPS, size), float32), np.zeros((2, most, size), float32)
    inside, kept = np.zeros((2, most, size), float32), np.zeros((2, most, size), float32)
    unseen, bent, each_tap = np.zeros((2, most, size), float32), np.zeros((2, size), float32), _zeros(TAPS)
    for part in prange((total + _TOGETHER - 1) // _TOGETHER, band):
        start = part * _TOGETHER
        some = min(_TOGETHER, total - start)
        at, own = places[0, start : start + some], places[1, start : start + some]
        light, whole, root, lit = room[0, :some], room[1, :some], room[2, :some], room[3, :some]
        expected, moves, weight, value = room[4, :some], room[5, :some], room[6, :some], room[7, :some]
        sums[:] = zero
        for i in range(some):
            expected[i], moves[i] = picture[own[i], at[i]], disparity[own[i], at[i]]
            bent[0, i], bent[1, i] = rough[0, own[i], at[i]], rough[1, own[i], at[i]]
        for axis in range(2 if still else 0):
            for n in range(lines[axis]):
                k, begin, end = example[axis, n], at if axis == 0 else own, columns if axis == 0 else rows
                slope, off = pupil[axis, k, 0, 0] / steps[axis], aside[axis, k, 0, 0] / steps[axis]
                f = parts[axis, n, :some]
                _place(moves, float32(slope), float32(off), begin, end, first[axis, n], f)
                _prepare(
                    first[axis, n], 1 - axis, f, end, ends[axis, n], taps[axis, n], inside[axis, n], kept[axis, n],
                    unseen[axis, n],
                )  # fmt: skip
        if even:
            light[:] = cells[0, 0, 0] * float32(electrons)
            _inform(light, expected, float32(read * read), whole, root)
        for k in chosen:
            g, h = line[0, k], line[1, k]
            left, above, f, over = first[0, g], first[1, h], parts[0, g], parts[1, h]
            if still:
                pupils[0], pupils[1] = pupil[0, k, 0, 0], pupil[1, k, 0, 0]
            else:
                _place_each(k, own, at, disparity, pupil, aside, steps, left, above, f, over, pupils)
                for axis in range(2):
                    _prepare(
                        first[axis, 0], 1 - axis, parts[axis, 0, :some], rows if axis else columns, ends[axis, 0],
                        taps[axis, 0], inside[axis, 0], kept[axis, 0], unseen[axis, 0],
                    )  # fmt: skip
            for i in range(some):
                lit[i] = inside[0, g, i] * inside[1, h, i]
            if not even:
                for i in range(some):
                    charge = cells[k, above[i], left[i]] * float32(electrons) if lit[i] > zero else zero
                    light[i] = charge if charge * peak[own[i], at[i]] < brightest else zero
                    lit[i] = one if light[i] > zero else zero
                _inform(light, expected, float32(read * read), whole, root)
            _doubt(unseen[0, g], bent[0], unseen[1, h], bent[1], float32(chosen.size), whole, lit)
            _interpolate(splines[k], left, above, ends[0, g], ends[1, h], taps[0, g], taps[1, h], each_tap, value)
            _weigh(lit, expected, whole, root, float32(robust), value, weight)
            if slot[k] >= 0:
                shown, weights = each[slot[k], 0], each[slot[k], 1]
                for i in range(some):
                    shown[own[i], at[i]], weights[own[i], at[i]] = value[i] + expected[i], weight[i]
            if out.shape[0]:
                _add_moments(lit, weight, pupils[0], pupils[1], value, kept[0, g], kept[1, h], sums)
        _centre(expected, sums)
        for a in range(out.shape[0]):
            here, there = out[a], sums[a]
            for i in range(some):
                here[own[i], at[i]] = there[i]


@kernel(parallel=True)
def add_pulls(
    each: Samples, pupil: Floats, chosen: Whole, sums: Floats, slope_u: Floats, slope_v: Floats, known: Flags,
    windows: Whole, square: Floats, information: Floats, band: Band = WHOLE,
) -> None:  # fmt: skip
    """Sums of squares of how views pull windows, and their information, each of shape (window, v, u).

    `each` as `common` leaves it for the views `chosen`, `sums` as it makes them of all.
    """
    rows, columns = known.shape
    beside = windows.max() // 2
    for tile in prange((rows + _TILE - 1) // _TILE, band):
        top, bottom = tile * _TILE, min(tile * _TILE + _TILE, rows)
        low, high = max(top - beside, 0), min(bottom + beside, rows)
        pull, lent = np.zeros((high - low, columns)), np.zeros((high - low, columns))
        down, total = np.zeros(columns + 2 * beside), np.zeros(columns)
        inner = down[beside : beside + columns]
        for n in range(chosen.size + 1):
            last = n == chosen.size
            if not last:
                k = chosen[n]
                for v in range(low, high):
                    shown, weight, along, over = each[n, 0, v], each[n, 1, v], pupil[0, k, v], pupil[1, k, v]
                    mean, x, y, su, sv = sums[0, v], sums[2, v], sums[3, v], slope_u[v], slope_v[v]
                    here, there, some = pull[v - low], lent[v - low], known[v]
                    for u in range(columns):
                        moved = su[u] * (along[u] - x[u]) + sv[u] * (over[u] - y[u]) if some[u] else 0.0
                        here[u] = weight[u] * moved * (shown[u] - mean[u])
                        there[u] += weight[u] * moved * moved
            for w in range(windows.size):
                reach = windows[w] // 2
                for v in range(top, bottom):
                    inner[:], total[:] = 0.0, 0.0
                    for b in range(max(v - reach, 0), min(v + reach + 1, rows)):
                        add(lent[b - low] if last else pull[b - low], 1.0, inner)
                    for a in range(-reach, reach + 1):
                        add(down[beside + a :], 1.0, total)
                    to = information[w, v] if last else square[w, v]
                    for u in range(columns):
                        to[u] += total[u] if last else total[u] * total[u]
