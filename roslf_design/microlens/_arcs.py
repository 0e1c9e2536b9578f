"""Kernels for the boundary of the common part of K discs: which discs count, and the arcs of their circles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ._circles import APART, AROUND, CROSSING, INSIDE, meet

Floats = NDArray[np.float64]
Meeting = tuple[int, float, float, float, float, float, float]

TURN = 2.0 * math.pi
POINT = 1e-70
"""Radii [mm] from here down are no disc at all: their fourth power leaves the range of numbers."""
SHORTEST = 1e-15
"""Arcs below this [rad] are rounding: three circles through one point leave such crumbs."""


@kernel()
def between(discs: Floats, i: int, j: int) -> Meeting:
    """How circle i lies to circle j: `meet` for rows (x, y, r, ...) of a table of discs."""
    return meet(discs[i, 0], discs[i, 1], discs[i, 2], discs[j, 0], discs[j, 1], discs[j, 2])


@kernel()
def survivors(discs: Floats) -> tuple[int, int, int]:
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
    """What the union of m >= 1 excluded intervals leaves of a turn: rows (start, end) of ``out``, from `filled` on.

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
def trace(discs: Floats, intervals: Floats, arcs: Floats) -> int:
    """Boundary of the common part: its arcs counterclockwise, in the order of their outward normals.

    Along the boundary of a convex part the normal only ever turns one way, and the normals of an arc are its own
    angles: sorting by them needs no inner point and cannot fail on a thin part.

    Parameters
    ----------
    discs, intervals
        The K discs, rows (x, y, r, mark), and workspace (K, 2).
    arcs
        Results, room for K * K rows: start in [0, 2 pi) and end [rad], disc.

    Returns
    -------
    int
        Number of arcs; 0 if the part is empty.
    """
    n, first, second = survivors(discs)
    if n == 0:
        return 0
    if n == 1:
        arcs[0, 0] = 0.0
        arcs[0, 1] = TURN
        arcs[0, 2] = first
        return 1
    total = 0
    if n == 2:
        _, ux, uy, _, height, foot, back = between(discs, first, second)
        towards = math.atan2(uy, ux)
        half = math.atan2(height, foot)
        arcs[0, 0] = towards - half
        arcs[0, 1] = towards + half
        arcs[0, 2] = first
        half = math.atan2(height, back)
        arcs[1, 0] = towards + math.pi - half
        arcs[1, 1] = towards + math.pi + half
        arcs[1, 2] = second
        total = 2
    else:
        for i in range(len(discs)):
            if discs[i, 3] != 0.0:
                m = 0
                origin = 0.0
                # Each other disc excludes one interval of circle i; what their union leaves is boundary.
                for j in range(len(discs)):
                    if j != i and discs[j, 3] != 0.0:
                        relation, ux, uy, _, height, foot, _ = between(discs, i, j)
                        if relation == CROSSING:
                            half = math.atan2(height, foot)
                            start = math.atan2(uy, ux) + half
                            if m == 0:
                                origin = start
                            m = exclude(start, TURN - 2.0 * half, origin, m, intervals)
                found = leave(origin, m, intervals, arcs, total)
                for k in range(total, found):
                    arcs[k, 2] = i
                total = found
    for k in range(total):
        shift = TURN * math.floor(arcs[k, 0] / TURN)
        start = arcs[k, 0] - shift
        end = arcs[k, 1] - shift
        disc = arcs[k, 2]
        m = k
        while m > 0 and arcs[m - 1, 0] > start:
            for c in range(3):
                arcs[m, c] = arcs[m - 1, c]
            m -= 1
        arcs[m, 0] = start
        arcs[m, 1] = end
        arcs[m, 2] = disc
    return total
