"""Kernels for the common part of K discs: its boundary arcs, and its area, centroid and second moments.

The common part is convex: a polygon of the crossing points plus one circular cap per arc, all of them positive. Sums of
positives lose nothing, so thin shapes are as good as thick ones. Positions are counted from disc 0.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ._circles import APART, AROUND, CROSSING, INSIDE, NODES, WEIGHTS, cap, crescent, meet

Floats = NDArray[np.float64]

EMPTY, CLIPPED, FULL = 0, 1, 2
"""What is left of disc 0."""

TURN = 2.0 * math.pi
POINT = 1e-70
"""Radii [mm] from here down are no disc at all: their fourth power leaves the range of numbers."""
SHORTEST = 1e-15
"""Arcs below this [rad] are rounding: three circles through one point leave such crumbs."""


@kernel()
def survivors(x: Floats, y: Floats, r: Floats, alive: NDArray[np.bool_]) -> tuple[int, int, int]:
    """Drop each disc that another one lies within, as it bounds nothing; of equal discs the first stays.

    Returns
    -------
    (count, first, second)
        How many discs stay, and the first two of them. A count of 0: two discs (`first`, `second`) have nothing in
        common, so the whole part is empty.
    """
    n = len(r)
    for i in range(n):
        alive[i] = True
    for i in range(n):
        if r[i] <= POINT:
            return 0, i, i
        for j in range(i + 1, n):
            if not alive[i]:
                break
            if alive[j]:
                relation = meet(x[i], y[i], r[i], x[j], y[j], r[j])[0]
                if relation == APART:
                    return 0, i, j
                if relation == INSIDE:
                    alive[j] = False
                elif relation == AROUND:
                    alive[i] = False
    count = 0
    first = -1
    second = -1
    for i in range(n):
        if alive[i]:
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
def leave(origin: float, m: int, intervals: Floats, out: Floats) -> int:
    """What the union of m >= 1 excluded intervals leaves of a turn, into ``out`` (start, end); returns how many parts.

    `origin` must be the start of one of the intervals, so that no part that is left runs across it.
    """
    reach = 0.0
    for k in range(m):
        reach = max(reach, intervals[k, 1] - TURN)
    count = 0
    for k in range(m + 1):
        start = intervals[k, 0] if k < m else TURN
        if start - reach > SHORTEST:
            out[count, 0] = origin + reach
            out[count, 1] = origin + start
            count += 1
        if k < m:
            reach = max(reach, intervals[k, 1])
    return count


@kernel()
def free_arcs(i: int, x: Floats, y: Floats, r: Floats, alive: NDArray[np.bool_], work: Floats, out: Floats) -> int:
    """Parts of circle i inside all other living discs, into ``out`` (start, end) [rad]; returns how many.

    Each other disc excludes one interval of circle i; what the union of the intervals leaves is free.
    """
    m = 0
    origin = 0.0
    for j in range(len(r)):
        if j != i and alive[j]:
            relation, ux, uy, _, height, foot, _ = meet(x[i], y[i], r[i], x[j], y[j], r[j])
            if relation == CROSSING:
                half = math.atan2(height, foot)
                start = math.atan2(uy, ux) + half
                if m == 0:
                    origin = start
                m = exclude(start, TURN - 2.0 * half, origin, m, work)
    return leave(origin, m, work, out)


@kernel()
def trace(x: Floats, y: Floats, r: Floats, alive: NDArray[np.bool_], work: Floats, owner: Floats, arcs: Floats) -> int:
    """Boundary of the common part: its arcs counterclockwise, in the order of their outward normals.

    Along the boundary of a convex part the normal only ever turns one way, and the normals of an arc are its own
    angles: sorting by them needs no inner point and cannot fail on a thin part.

    Parameters
    ----------
    x, y, r
        The K discs.
    alive, work, owner, arcs
        Workspace (K), (K, 2) and results: disc of each arc (K * K), its start in [0, 2 pi) and its end (K * K, 2).

    Returns
    -------
    int
        Number of arcs; 0 if the part is empty.
    """
    n, first, second = survivors(x, y, r, alive)
    if n == 0:
        return 0
    if n == 1:
        owner[0] = first
        arcs[0, 0] = 0.0
        arcs[0, 1] = TURN
        return 1
    total = 0
    if n == 2:
        _, ux, uy, _, height, foot, back = meet(x[first], y[first], r[first], x[second], y[second], r[second])
        towards = math.atan2(uy, ux)
        half = math.atan2(height, foot)
        owner[0] = first
        arcs[0, 0] = towards - half
        arcs[0, 1] = towards + half
        half = math.atan2(height, back)
        owner[1] = second
        arcs[1, 0] = towards + math.pi - half
        arcs[1, 1] = towards + math.pi + half
        total = 2
    else:
        for i in range(len(r)):
            if alive[i]:
                found = free_arcs(i, x, y, r, alive, work, arcs[total:])
                for k in range(total, total + found):
                    owner[k] = i
                total += found
    for k in range(total):
        start = arcs[k, 0]
        end = arcs[k, 1]
        shift = TURN * math.floor(start / TURN)
        disc = owner[k]
        m = k
        while m > 0 and arcs[m - 1, 0] > start - shift:
            owner[m] = owner[m - 1]
            arcs[m, 0] = arcs[m - 1, 0]
            arcs[m, 1] = arcs[m - 1, 1]
            m -= 1
        owner[m] = disc
        arcs[m, 0] = start - shift
        arcs[m, 1] = end - shift
    return total


@kernel()
def add_piece(total: Floats, area: float, x: float, y: float, xx: float, xy: float, yy: float) -> None:
    """Join a piece to `total` (area, x, y, and central moments xx, xy, yy): sums of squares only, no differences."""
    whole = total[0] + area
    if area <= 0.0 or whole <= 0.0:
        return
    share = area / whole
    dx = x - total[1]
    dy = y - total[2]
    weight = total[0] * share
    total[0] = whole
    total[1] += dx * share
    total[2] += dy * share
    total[3] += xx + weight * dx * dx
    total[4] += xy + weight * dx * dy
    total[5] += yy + weight * dy * dy


@kernel()
def add_cap(total: Floats, r: float, sine: float, cosine: float, x: float, y: float, ux: float, uy: float) -> None:
    """Join a cap of a disc of radius r; (x, y) is the middle of its chord, (ux, uy) points from there to the rim."""
    area, rise, along, across = cap(sine, cosine)
    rr = r * r
    along *= rr * rr
    across *= rr * rr
    xx = along * ux * ux + across * uy * uy
    yy = along * uy * uy + across * ux * ux
    add_piece(total, rr * area, x + ux * r * rise, y + uy * r * rise, xx, (along - across) * ux * uy, yy)


@kernel()
def add_lens(
    total: Floats, meeting: tuple[int, float, float, float, float, float, float], ri: float, rj: float
) -> None:
    """Join the lens common to two crossing circles: two caps on one chord, positions from that chord's middle."""
    _, ux, uy, _, height, foot, back = meeting
    add_cap(total, ri, height / ri, foot / ri, 0.0, 0.0, ux, uy)
    add_cap(total, rj, height / rj, back / rj, 0.0, 0.0, -ux, -uy)


@kernel()
def add_region(total: Floats, x: Floats, y: Floats, r: Floats, owner: Floats, arcs: Floats, count: int) -> None:
    """Join the part bounded by traced arcs: a fan of triangles and a cap on each chord, positions from disc 0."""
    x0 = 0.0
    y0 = 0.0
    for k in range(count):
        i = int(owner[k])
        cx = x[i] - x[0]
        cy = y[i] - y[0]
        middle = 0.5 * (arcs[k, 0] + arcs[k, 1])
        half = 0.5 * (arcs[k, 1] - arcs[k, 0])
        sine = math.sin(half)
        cosine = math.cos(half)
        ux = math.cos(middle)
        uy = math.sin(middle)
        footx = cx + r[i] * cosine * ux
        footy = cy + r[i] * cosine * uy
        sx = footx + r[i] * sine * uy
        sy = footy - r[i] * sine * ux
        ex = footx - r[i] * sine * uy
        ey = footy + r[i] * sine * ux
        if k == 0:
            x0 = sx
            y0 = sy
        else:
            px = (x0 + sx + ex) / 3.0
            py = (y0 + sy + ey) / 3.0
            area = 0.5 * ((sx - x0) * (ey - y0) - (sy - y0) * (ex - x0))
            xx = (x0 - px) * (x0 - px) + (sx - px) * (sx - px) + (ex - px) * (ex - px)
            yy = (y0 - py) * (y0 - py) + (sy - py) * (sy - py) + (ey - py) * (ey - py)
            xy = (x0 - px) * (y0 - py) + (sx - px) * (sy - py) + (ex - px) * (ey - py)
            add_piece(total, area, px, py, xx * area / 12.0, xy * area / 12.0, yy * area / 12.0)
        add_cap(total, r[i], sine, cosine, footx, footy, ux, uy)


@kernel()
def notches(base: int, x: Floats, y: Floats, r: Floats, owner: Floats, arcs: Floats, count: int) -> float:
    """Area of disc `base` outside the part bounded by the traced arcs, for a disc that keeps most of itself.

    In polar coordinates about its centre the loss is the integral of ``(r^2 - rho^2)/2`` over the arcs of other discs;
    ``r - rho`` is a quotient of positive terms, so a loss of any smallness is right relative to itself.
    """
    r0 = r[base]
    lost = 0.0
    for k in range(count):
        j = int(owner[k])
        if j == base:
            continue
        _, ux, uy, d, height, foot, _ = meet(x[base], y[base], r0, x[j], y[j], r[j])
        edge = math.atan2(height, -foot)
        gap = x[j] - x[base]
        rise = y[j] - y[base]
        sx = gap + r[j] * math.cos(arcs[k, 0])
        sy = rise + r[j] * math.sin(arcs[k, 0])
        ex = gap + r[j] * math.cos(arcs[k, 1])
        ey = rise + r[j] * math.sin(arcs[k, 1])
        # Angles from the direction away from disc j; exact where the arc ends on the circle of `base` itself.
        start = -edge if owner[(k - 1) % count] == base else math.atan2(uy * sx - ux * sy, -(ux * sx + uy * sy))
        end = edge if owner[(k + 1) % count] == base else math.atan2(uy * ex - ux * ey, -(ux * ex + uy * ey))
        part = 0.0
        for n in range(16):
            angle = start + (end - start) * NODES[n]
            power = 4.0 * r0 * d * math.sin(0.5 * (edge + angle)) * math.sin(0.5 * (edge - angle))
            side = d * math.sin(angle)
            depth = power / (r0 + d * math.cos(angle) + math.sqrt((r[j] - side) * (r[j] + side)))
            part += WEIGHTS[n] * depth * (r0 - 0.5 * depth)
        lost += part * (end - start)
    return lost


@kernel()
def shape(
    x: Floats,
    y: Floats,
    r: Floats,
    alive: NDArray[np.bool_],
    work: Floats,
    owner: Floats,
    arcs: Floats,
    total: Floats,
    clips: NDArray[np.bool_],
) -> tuple[int, float, float]:
    """Common part of K discs into `total` (area, centroid from disc 0, central moments) and `clips` (K).

    Returns
    -------
    (status, kept, lost)
        Fractions of disc 0's area.
    """
    for k in range(6):
        total[k] = 0.0
    for k in range(len(r)):
        clips[k] = False
    n, first, second = survivors(x, y, r, alive)
    if n == 0:
        clips[first] = first > 0
        clips[second] = second > 0
        return EMPTY, 0.0, 1.0
    # The disc that the loss is counted from: disc 0, or one inside it where disc 0 bounds nothing.
    base = 0
    if not alive[0]:
        for j in range(len(r)):
            if alive[j] and meet(x[j], y[j], r[j], x[0], y[0], r[0])[0] == INSIDE:
                base = j
                break
    room = math.pi * r[base] * r[base]
    lost = 0.0
    if n == 1:
        clips[first] = first > 0
        total[0] = room
        total[1] = x[base] - x[0]
        total[2] = y[base] - y[0]
        total[3] = 0.25 * room * r[base] * r[base]
        total[5] = total[3]
        if base == 0:
            return FULL, 1.0, 0.0
    elif n == 2:
        clips[first] = first > 0
        clips[second] = True
        meeting = meet(x[first], y[first], r[first], x[second], y[second], r[second])
        add_lens(total, meeting, r[first], r[second])
        if total[0] <= 0.0:  # too thin for a number
            return EMPTY, 0.0, 1.0
        _, ux, uy, d, height, foot, back = meeting
        total[1] += ux * foot + (x[first] - x[0])
        total[2] += uy * foot + (y[first] - y[0])
        if base == first:
            lost = crescent(r[first], r[second], d, height, foot, back)
        else:
            lost = crescent(r[second], r[first], d, height, back, foot)
    else:
        count = trace(x, y, r, alive, work, owner, arcs)
        for k in range(count):
            if owner[k] > 0:
                clips[int(owner[k])] = True
        add_region(total, x, y, r, owner, arcs, count)
        if total[0] <= 0.0:
            for k in range(1, len(r)):
                clips[k] = alive[k]
            return EMPTY, 0.0, 1.0
        lost = room - total[0]
        if alive[base] and lost < 0.125 * room:
            lost = notches(base, x, y, r, owner, arcs, count)
    if lost < 0.5 * room:
        total[0] = room - lost
    whole = math.pi * r[0] * r[0]
    lost_fraction = lost / whole
    if base != 0:
        lost_fraction += ((r[0] - r[base]) / r[0]) * ((r[0] + r[base]) / r[0])
    if lost_fraction < 0.5:
        return CLIPPED, 1.0 - lost_fraction, lost_fraction
    kept = min(1.0, total[0] / whole)
    return CLIPPED, kept, 1.0 - kept


@kernel()
def shapes(
    centres: Floats,
    radii: Floats,
    area: Floats,
    centroid: Floats,
    moments: Floats,
    kept: Floats,
    lost: Floats,
    status: NDArray[np.int8],
    clips: NDArray[np.bool_],
) -> None:
    """`shape` of every set of discs: centres (n, K, 2), radii (n, K); moments per unit area."""
    n, k = radii.shape
    x = np.empty(k)
    y = np.empty(k)
    r = np.empty(k)
    alive = np.empty(k, np.bool_)
    work = np.empty((k, 2))
    owner = np.empty(k * k)
    arcs = np.empty((k * k, 2))
    total = np.empty(6)
    for i in range(n):
        for j in range(k):
            x[j] = centres[i, j, 0]
            y[j] = centres[i, j, 1]
            r[j] = radii[i, j]
        status[i], kept[i], lost[i] = shape(x, y, r, alive, work, owner, arcs, total, clips[i])
        area[i] = total[0]
        centroid[i, 0] = x[0] + total[1]
        centroid[i, 1] = y[0] + total[2]
        for j in range(3):
            moments[i, j] = total[3 + j] / total[0] if total[0] > 0.0 else 0.0
