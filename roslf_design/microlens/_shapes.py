"""Kernels for the common part of K discs: its area, centroid and second moments, and what disc 0 loses.

The common part is convex: a polygon of the crossing points plus one circular cap per arc, all of them positive. Sums of
positives lose nothing, so thin shapes are as good as thick ones. Positions are counted from disc 0.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ._arcs import between, survivors, trace
from ._circles import INSIDE, NODES, WEIGHTS, cap, crescent

Floats = NDArray[np.float64]

EMPTY, CLIPPED, FULL = 0, 1, 2
"""What is left of disc 0."""


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
def add_region(total: Floats, discs: Floats, arcs: Floats, count: int) -> None:
    """Join the part bounded by traced arcs: a fan of triangles and a cap on each chord, positions from disc 0."""
    x0 = 0.0
    y0 = 0.0
    for k in range(count):
        i = int(arcs[k, 2])
        cx = discs[i, 0] - discs[0, 0]
        cy = discs[i, 1] - discs[0, 1]
        r = discs[i, 2]
        middle = 0.5 * (arcs[k, 0] + arcs[k, 1])
        half = 0.5 * (arcs[k, 1] - arcs[k, 0])
        sine = math.sin(half)
        cosine = math.cos(half)
        ux = math.cos(middle)
        uy = math.sin(middle)
        footx = cx + r * cosine * ux
        footy = cy + r * cosine * uy
        sx = footx + r * sine * uy
        sy = footy - r * sine * ux
        ex = footx - r * sine * uy
        ey = footy + r * sine * ux
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
        add_cap(total, r, sine, cosine, footx, footy, ux, uy)


@kernel()
def notches(base: int, discs: Floats, arcs: Floats, count: int) -> float:
    """Area of disc `base` outside the part bounded by the traced arcs, for a disc that keeps most of itself.

    In polar coordinates about its centre the loss is the integral of ``(r^2 - rho^2)/2`` over the arcs of other discs;
    ``r - rho`` is a quotient of positive terms, so a loss of any smallness is right relative to itself.
    """
    r0 = discs[base, 2]
    lost = 0.0
    for k in range(count):
        j = int(arcs[k, 2])
        if j == base:
            continue
        _, ux, uy, d, height, foot, _ = between(discs, base, j)
        edge = math.atan2(height, -foot)
        gap = discs[j, 0] - discs[base, 0]
        rise = discs[j, 1] - discs[base, 1]
        r = discs[j, 2]
        sx = gap + r * math.cos(arcs[k, 0])
        sy = rise + r * math.sin(arcs[k, 0])
        ex = gap + r * math.cos(arcs[k, 1])
        ey = rise + r * math.sin(arcs[k, 1])
        # Angles from the direction away from disc j; exact where the arc ends on the circle of `base` itself.
        start = -edge if arcs[(k - 1) % count, 2] == base else math.atan2(uy * sx - ux * sy, -(ux * sx + uy * sy))
        end = edge if arcs[(k + 1) % count, 2] == base else math.atan2(uy * ex - ux * ey, -(ux * ex + uy * ey))
        part = 0.0
        for n in range(16):
            angle = start + (end - start) * NODES[n]
            power = 4.0 * r0 * d * math.sin(0.5 * (edge + angle)) * math.sin(0.5 * (edge - angle))
            side = d * math.sin(angle)
            depth = power / (r0 + d * math.cos(angle) + math.sqrt((r - side) * (r + side)))
            part += WEIGHTS[n] * depth * (r0 - 0.5 * depth)
        lost += part * (end - start)
    return lost


@kernel()
def shape(
    discs: Floats, intervals: Floats, arcs: Floats, total: Floats, clips: NDArray[np.bool_]
) -> tuple[int, float, float]:
    """Common part of K discs into `total` (area, centroid from disc 0, central moments) and `clips` (K).

    Returns
    -------
    (status, kept, lost)
        Fractions of disc 0's area.
    """
    total[:] = 0.0
    clips[:] = False
    n, first, second = survivors(discs)
    if n == 0:
        clips[first] = first > 0
        clips[second] = second > 0
        return EMPTY, 0.0, 1.0
    # The disc that the loss is counted from: disc 0, or one inside it where disc 0 bounds nothing.
    base = 0
    if discs[0, 3] == 0.0:
        for j in range(len(discs)):
            if discs[j, 3] != 0.0 and between(discs, j, 0)[0] == INSIDE:
                base = j
                break
    r = discs[base, 2]
    room = math.pi * r * r
    lost = 0.0
    if n == 1:
        clips[first] = first > 0
        total[0] = room
        total[1] = discs[base, 0] - discs[0, 0]
        total[2] = discs[base, 1] - discs[0, 1]
        total[3] = 0.25 * room * r * r
        total[5] = total[3]
        if base == 0:
            return FULL, 1.0, 0.0
    elif n == 2:
        clips[first] = first > 0
        clips[second] = True
        meeting = between(discs, first, second)
        add_lens(total, meeting, discs[first, 2], discs[second, 2])
        if total[0] <= 0.0:  # too thin for a number
            return EMPTY, 0.0, 1.0
        _, ux, uy, d, height, foot, back = meeting
        total[1] += ux * foot + (discs[first, 0] - discs[0, 0])
        total[2] += uy * foot + (discs[first, 1] - discs[0, 1])
        if base == first:
            lost = crescent(discs[first, 2], discs[second, 2], d, height, foot, back)
        else:
            lost = crescent(discs[second, 2], discs[first, 2], d, height, back, foot)
    else:
        count = trace(discs, intervals, arcs)
        for k in range(count):
            if arcs[k, 2] > 0:
                clips[int(arcs[k, 2])] = True
        add_region(total, discs, arcs, count)
        if total[0] <= 0.0:
            for k in range(1, len(discs)):
                clips[k] = discs[k, 3] != 0.0
            return EMPTY, 0.0, 1.0
        lost = room - total[0]
        if discs[base, 3] != 0.0 and lost < 0.125 * room:
            lost = notches(base, discs, arcs, count)
    if lost < 0.5 * room:
        total[0] = room - lost
    r0 = discs[0, 2]
    whole = math.pi * r0 * r0
    lost_fraction = lost / whole
    if base != 0:
        lost_fraction += ((r0 - r) / r0) * ((r0 + r) / r0)
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
    discs = np.empty((k, 4))
    intervals = np.empty((k, 2))
    arcs = np.empty((k * k, 3))
    total = np.empty(6)
    for i in range(n):
        for j in range(k):
            discs[j, 0] = centres[i, j, 0]
            discs[j, 1] = centres[i, j, 1]
            discs[j, 2] = radii[i, j]
        status[i], kept[i], lost[i] = shape(discs, intervals, arcs, total, clips[i])
        area[i] = total[0]
        centroid[i, 0] = discs[0, 0] + total[1]
        centroid[i, 1] = discs[0, 1] + total[2]
        for j in range(3):
            moments[i, j] = total[3 + j] / total[0] if total[0] > 0.0 else 0.0
