"""Circles: where two meet, caps, and the boundary of the common part of discs, as kernels.

Everything the shapes need is a smooth integral or an exact gap here, so that nothing small is ever a difference of
two large numbers: the two gaps of a pair of circles come from error-free sums, and thin pieces from quadrature of
positive integrands.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel

Floats = NDArray[np.float64]

APART, CROSSING, INSIDE, AROUND = 0, 1, 2, 3
"""Relations of disc i to disc j: no common inside, circles cross, i within j (or equal to it), i around j."""

_GAUSS = np.polynomial.legendre.leggauss(16)
NODES = tuple(float(0.5 * (x + 1)) for x in _GAUSS[0])
"""Gauss-Legendre nodes on [0, 1]: exact to the last bit for the integrands used here, whose singularities lie at
1.33 or beyond."""
WEIGHTS = tuple(float(0.5 * w) for w in _GAUSS[1])


@kernel()
def _sum_error(a: float, b: float) -> float:
    """Rounding error of ``a + b`` (Knuth): the exact sum is ``(a + b) + sum_error(a, b)``."""
    s = a + b
    t = s - a
    return (a - (s - t)) + (b - t)


@kernel()
def _square_error(a: float) -> float:
    """Rounding error of ``a * a`` (Dekker's splitting; no fused multiply-add needed)."""
    t = 134217729.0 * a
    high = t - (t - a)
    low = a - high
    return ((high * high - a * a) + 2.0 * high * low) + low * low


@kernel()
def _meet(
    xi: float, yi: float, ri: float, xj: float, yj: float, rj: float
) -> tuple[int, float, float, float, float, float, float]:
    """Relation of circle i to circle j, and their common chord.

    The gaps ``ri + rj - d`` (to tangency) and ``d - |ri - rj|`` (to containment) are summed without error but for their
    last rounding, also when the distance d is not a machine number. The height of the triangle of the two centres and
    a crossing point then follows from Kahan's product of sorted differences with nothing lost: it is right to a few
    ulp of itself however thin the triangle, for the numbers exactly as given.

    Returns
    -------
    (relation, ux, uy, distance, height, foot_i, foot_j)
        Unit vector from i to j; half the length of the chord; signed distance of the chord from each centre, counted
        from i towards j and from j towards i, each good to a few ulp of its own radius.
    """
    # Plain floats: interpreted, numpy's scalars would cost several times as much.
    xi, yi, ri = float(xi), float(yi), float(ri)
    xj, yj, rj = float(xj), float(yj), float(rj)
    x = xj - xi
    y = yj - yi
    x_low = _sum_error(xj, -xi)
    y_low = _sum_error(yj, -yi)
    xx = x * x
    yy = y * y
    square = xx + yy
    d = 0.0
    d_low = 0.0
    ux = 1.0
    uy = 0.0
    if square > 1e-280:  # below, its digits are lost, and so is the distance among the radii
        d = math.sqrt(square)
        excess = (square - d * d) - _square_error(d)
        excess += _sum_error(xx, yy) + _square_error(x) + _square_error(y) + 2.0 * (x * x_low + y * y_low)
        d_low = excess / (2.0 * d)
        ux = x / d
        uy = y / d
    total = ri + rj
    overlap = (total - d) + ((_sum_error(ri, rj) + _sum_error(total, -d)) - d_low)
    if overlap <= 0.0 or ri <= 0.0 or rj <= 0.0:
        return APART, ux, uy, d, 0.0, 0.0, 0.0
    large = max(ri, rj)
    small = min(ri, rj)
    step = large - small
    beyond = (d - step) + ((_sum_error(d, -step) - _sum_error(large, -small)) + d_low)
    if beyond <= 0.0:
        return (INSIDE if ri <= rj else AROUND), ux, uy, d, 0.0, 0.0, 0.0
    height = math.sqrt((total + d) * (d + step)) * math.sqrt(overlap * beyond) / (2.0 * d)
    difference = step * total
    foot_large = (d * d + difference) / (2.0 * d)
    # Two equal forms of d^2 + small^2 - large^2: each good to an ulp of the small radius where it is used.
    if d >= 0.5 * large:
        foot_small = (small * small + (beyond - small) * (d + large)) / (2.0 * d)
    else:
        foot_small = (d * d - difference) / (2.0 * d)
    if ri <= rj:
        return CROSSING, ux, uy, d, height, foot_small, foot_large
    return CROSSING, ux, uy, d, height, foot_large, foot_small


@kernel()
def cap(sine: float, cosine: float) -> tuple[float, float, float, float]:
    """Cap of the unit disc beyond a chord: the part with ``x >= cosine``, of half-angle ``atan2(sine, cosine)``.

    Returns
    -------
    (area, rise, xx, yy)
        Area; distance of the centroid beyond the chord; central second moments (area integrals) along and across the
        axis. Each is right to a few ulp of itself, also for the thinnest cap.
    """
    if cosine > 0.0:
        # Thin cap: depth s^2 below the rim, width sqrt(2 s^2) times a smooth factor.
        depth = sine * sine / (1.0 + cosine)
        if depth <= 0.0:
            return 0.0, 0.0, 0.0, 0.0
        half = 0.5 * depth
        s0 = 0.0
        s1 = 0.0
        s2 = 0.0
        t0 = 0.0
        for n in range(16):
            s = NODES[n]
            ss = s * s
            factor = math.sqrt(1.0 - half * ss)
            term = WEIGHTS[n] * ss * factor
            left = 1.0 - ss
            s0 += term
            s1 += term * left
            s2 += term * left * left
            t0 += term * ss * factor * factor
        scale = 4.0 * depth * math.sqrt(2.0 * depth)
        area = scale * s0
        rise = s1 / s0
        return area, depth * rise, scale * depth * depth * (s2 - s1 * rise), scale * depth * t0 * (2.0 / 3.0)
    angle = math.atan2(sine, cosine)
    area = angle - sine * cosine
    beyond = (2.0 / 3.0) * sine * sine * sine / area
    fourth = sine * cosine * (cosine - sine) * (cosine + sine)
    xx = 0.25 * (angle - fourth) - area * beyond * beyond
    yy = 0.25 * angle - sine * cosine / 3.0 + fourth / 12.0
    return area, beyond - cosine, xx, yy


Meeting = tuple[int, float, float, float, float, float, float]

TURN = 2.0 * math.pi
POINT = 1e-70
"""Radii [mm] from here down are no disc at all: their fourth power leaves the range of numbers."""
SHORTEST = 1e-15
"""Arcs below this [rad] are rounding: three circles through one point leave such crumbs."""


@kernel()
def between(discs: Floats, i: int, j: int) -> Meeting:
    """Relation of circle i to circle j: `_meet` for rows (x, y, r, ...) of a table of discs."""
    return _meet(discs[i, 0], discs[i, 1], discs[i, 2], discs[j, 0], discs[j, 1], discs[j, 2])


@kernel()
def _survivors(discs: Floats) -> tuple[int, int, int]:
    """Mark each disc that counts (``discs[:, 3]``): not those around another; of equal discs the first.

    Returns
    -------
    (count, first, second)
        How many discs stay, and the first two of them. A count of 0: two discs (`first`, `second`) have nothing in
        common, so the whole part is empty.
    """
    n = len(discs)
    for i in range(n):
        discs[i, 3] = 1.0
    for i in range(n):
        if discs[i, 2] <= POINT:
            return 0, i, i
        for j in range(i + 1, n):
            if discs[i, 3] == 0.0:
                break
            if discs[j, 3] != 0.0:
                relation = between(discs, i, j)[0]
                if relation == APART:
                    return 0, i, j
                if relation == INSIDE:
                    discs[j, 3] = 0.0
                elif relation == AROUND:
                    discs[i, 3] = 0.0
    count = 0
    first = -1
    second = -1
    for i in range(n):
        if discs[i, 3] != 0.0:
            count += 1
            if first < 0:
                first = i
            elif second < 0:
                second = i
    return count, first, second


@kernel()
def exclude(start: float, length: float, origin: float, m: int, intervals: Floats) -> int:
    """Insert an excluded interval of a rim into the sorted list of m, counted from `origin`; returns m + 1."""
    start = (start - origin) % TURN
    k = m
    while k > 0 and intervals[k - 1, 0] > start:
        intervals[k, 0] = intervals[k - 1, 0]
        intervals[k, 1] = intervals[k - 1, 1]
        k -= 1
    intervals[k, 0] = start
    intervals[k, 1] = start + length
    return m + 1


@kernel()
def leave(origin: float, m: int, intervals: Floats, out: Floats, filled: int) -> int:
    """Part of a turn outside m >= 1 excluded intervals: rows (start, end) of ``out``, from `filled` on.

    `origin` must be the start of one of the intervals, so that no part that is left runs across it. Returns the number
    of rows then filled.
    """
    reach = 0.0
    for k in range(m):
        reach = max(reach, intervals[k, 1] - TURN)
    for k in range(m + 1):
        start = intervals[k, 0] if k < m else TURN
        if start - reach > SHORTEST:
            out[filled, 0] = origin + reach
            out[filled, 1] = origin + start
            filled += 1
        if k < m:
            reach = max(reach, intervals[k, 1])
    return filled


@kernel()
def trace(discs: Floats, intervals: Floats, arcs: Floats) -> tuple[int, int, int]:
    """Boundary of the common part: its arcs counterclockwise, in the order of their outward normals.

    Along the boundary of a convex part the normal only ever turns one way, and the normals of an arc are its own
    angles: sorting by them needs no inner point and cannot fail on a thin part.

    Parameters
    ----------
    discs, intervals
        The K discs, rows (x, y, r, mark), and workspace (K, 2).
    arcs
        Results, room for K * K rows: start in [0, 2 pi) and end [rad], disc, sine and cosine of half its angle.

    Returns
    -------
    (count, first, second)
        Number of arcs; 0 if the part is empty, then the two discs that have nothing in common, or -1, -1 if it takes
        more than two.
    """
    n, first, second = _survivors(discs)
    if n == 0:
        return 0, first, second
    total = 0
    for i in range(len(discs)):
        if discs[i, 3] != 0.0:
            m = 0
            origin = 0.0
            half = math.pi
            towards = math.pi
            sine = 0.0
            cosine = -1.0
            # Each other disc excludes one interval of circle i; what their union leaves is boundary.
            for j in range(len(discs)):
                if j != i and discs[j, 3] != 0.0:
                    relation, ux, uy, _, height, foot, _ = between(discs, i, j)
                    if relation == CROSSING:
                        half = math.atan2(height, foot)
                        towards = math.atan2(uy, ux) if i < j else math.atan2(-uy, -ux) + math.pi
                        if m == 0:
                            origin = towards + half
                        m = exclude(towards + half, TURN - 2.0 * half, origin, m, intervals)
                        sine = height / discs[i, 2]
                        cosine = foot / discs[i, 2]
            if m > 1:
                filled = leave(origin, m, intervals, arcs, total)
            else:  # its only chord, to the last bit, or the whole circle
                filled = total + 1
                arcs[total, 0] = towards - half
                arcs[total, 1] = towards + half
            for k in range(total, filled):
                if m > 1:
                    half = 0.5 * (arcs[k, 1] - arcs[k, 0])
                    sine = math.sin(half)
                    cosine = math.cos(half)
                shift = TURN * math.floor(arcs[k, 0] / TURN)
                start = arcs[k, 0] - shift
                end = arcs[k, 1] - shift
                at = k
                while at > 0 and arcs[at - 1, 0] > start:
                    for c in range(5):
                        arcs[at, c] = arcs[at - 1, c]
                    at -= 1
                arcs[at, 0] = start
                arcs[at, 1] = end
                arcs[at, 2] = i
                arcs[at, 3] = sine
                arcs[at, 4] = cosine
            total = filled
    return total, -1, -1
