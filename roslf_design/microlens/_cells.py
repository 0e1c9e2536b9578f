"""Kernel for the part of K discs inside a convex polygon, by Green's theorem over its arcs and straight pieces."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ._shapes import TURN, exclude, leave, trace

Floats = NDArray[np.float64]


@kernel()
def arcs_inside(
    x: Floats, y: Floats, r: Floats, px: Floats, py: Floats, owner: Floats, arcs: Floats, count: int, work: Floats
) -> float:
    """Green's integral ``(x dy - y dx)/2`` along those parts of traced arcs that lie in the polygon."""
    corners = len(px)
    parts = work[corners + 1 :]
    total = 0.0
    for k in range(count):
        i = int(owner[k])
        m = 0
        origin = 0.0
        free = arcs[k, 1] - arcs[k, 0]
        if free < TURN:
            origin = arcs[k, 1]
            m = exclude(origin, TURN - free, origin, m, work)
        outside = False
        for e in range(corners):
            ax = px[e]
            ay = py[e]
            dx = px[(e + 1) % corners] - ax
            dy = py[(e + 1) % corners] - ay
            length = math.hypot(dx, dy)
            if length <= 0.0:
                continue
            inside = (dx * (y[i] - ay) - dy * (x[i] - ax)) / length
            if inside <= -r[i]:
                outside = True
                break
            if inside < r[i]:
                half = math.atan2(math.sqrt((r[i] - inside) * (r[i] + inside)), inside)
                start = math.atan2(-dx, dy) - half
                if m == 0:
                    origin = start
                m = exclude(start, 2.0 * half, origin, m, work)
        if outside:
            continue
        n = 1
        if m == 0:
            parts[0, 0] = 0.0
            parts[0, 1] = TURN
        else:
            n = leave(origin, m, work, parts)
        for p in range(n):
            start = parts[p, 0]
            end = parts[p, 1]
            total += (
                0.5
                * r[i]
                * (
                    r[i] * (end - start)
                    + x[i] * (math.sin(end) - math.sin(start))
                    + y[i] * (math.cos(start) - math.cos(end))
                )
            )
    return total


@kernel()
def edges_inside(x: Floats, y: Floats, r: Floats, px: Floats, py: Floats) -> float:
    """The same integral along those parts of the polygon's edges that lie in all discs."""
    corners = len(px)
    total = 0.0
    for e in range(corners):
        ax = px[e]
        ay = py[e]
        dx = px[(e + 1) % corners] - ax
        dy = py[(e + 1) % corners] - ay
        length = math.hypot(dx, dy)
        if length <= 0.0:
            continue
        dx /= length
        dy /= length
        low = 0.0
        high = length
        for i in range(len(r)):
            foot = dx * (x[i] - ax) + dy * (y[i] - ay)
            off = dx * (y[i] - ay) - dy * (x[i] - ax)
            if abs(off) >= r[i]:
                high = low
                break
            half = math.sqrt((r[i] - off) * (r[i] + off))
            low = max(low, foot - half)
            high = min(high, foot + half)
        if high > low:
            total += 0.5 * (ax * dy - ay * dx) * (high - low)
    return total


@kernel()
def cell_areas(centres: Floats, radii: Floats, polygons: Floats, area: Floats) -> None:
    """Areas of n common parts, centres (n, K, 2), radii (n, K), each in its own polygon (n, M, 2), counterclockwise."""
    n, k = radii.shape
    corners = polygons.shape[1]
    x = np.empty(k)
    y = np.empty(k)
    r = np.empty(k)
    px = np.empty(corners)
    py = np.empty(corners)
    alive = np.empty(k, np.bool_)
    owner = np.empty(k * k)
    arcs = np.empty((k * k, 2))
    work = np.empty((max(k, 2 * corners + 3), 2))
    for s in range(n):
        # About disc 0, where the digits are.
        x0 = centres[s, 0, 0]
        y0 = centres[s, 0, 1]
        for j in range(k):
            x[j] = centres[s, j, 0]
            y[j] = centres[s, j, 1]
            r[j] = radii[s, j]
        count = trace(x, y, r, alive, work, owner, arcs)
        area[s] = 0.0
        if count == 0:
            continue
        for j in range(k):
            x[j] -= x0
            y[j] -= y0
        for j in range(corners):
            px[j] = polygons[s, j, 0] - x0
            py[j] = polygons[s, j, 1] - y0
        whole = arcs_inside(x, y, r, px, py, owner, arcs, count, work) + edges_inside(x, y, r, px, py)
        area[s] = max(0.0, whole)
