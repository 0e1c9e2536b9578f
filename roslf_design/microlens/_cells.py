"""Kernel for the part of K discs inside a convex polygon, by Green's theorem over its arcs and straight pieces."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ._arcs import TURN, exclude, leave, trace

Floats = NDArray[np.float64]


@kernel()
def edge(polygon: Floats, e: int) -> tuple[float, float, float, float, float]:
    """Edge e of a polygon: where it starts, its direction and length (direction 0, 0 where that is 0)."""
    x = polygon[e, 0]
    y = polygon[e, 1]
    dx = polygon[(e + 1) % len(polygon), 0] - x
    dy = polygon[(e + 1) % len(polygon), 1] - y
    length = math.hypot(dx, dy)
    if length > 0.0:
        dx /= length
        dy /= length
    return x, y, dx, dy, length


@kernel()
def arcs_inside(discs: Floats, arcs: Floats, count: int, polygon: Floats, work: Floats) -> float:
    """Green's integral ``(x dy - y dx)/2`` along those parts of traced arcs that lie in the polygon."""
    corners = len(polygon)
    parts = work[corners + 1 :]
    total = 0.0
    for k in range(count):
        i = int(arcs[k, 2])
        x = discs[i, 0]
        y = discs[i, 1]
        r = discs[i, 2]
        m = 0
        origin = 0.0
        free = arcs[k, 1] - arcs[k, 0]
        if free < TURN:
            origin = arcs[k, 1]
            m = exclude(origin, TURN - free, origin, m, work)
        outside = False
        for e in range(corners):
            ax, ay, dx, dy, length = edge(polygon, e)
            if length <= 0.0:
                continue
            # To the last bit as for the edges below: what one leaves out of a circle that just touches, the other does.
            inside = dx * (y - ay) - dy * (x - ax)
            if inside <= -r:
                outside = True
                break
            if inside < r:
                half = math.atan2(math.sqrt((r - inside) * (r + inside)), inside)
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
            n = leave(origin, m, work, parts, 0)
        for p in range(n):
            start = parts[p, 0]
            end = parts[p, 1]
            across = x * (math.sin(end) - math.sin(start)) + y * (math.cos(start) - math.cos(end))
            total += 0.5 * r * (r * (end - start) + across)
    return total


@kernel()
def edges_inside(discs: Floats, polygon: Floats) -> float:
    """The same integral along those parts of the polygon's edges that lie in all discs."""
    corners = len(polygon)
    total = 0.0
    for e in range(corners):
        ax, ay, dx, dy, high = edge(polygon, e)
        low = 0.0
        for i in range(len(discs)):
            if discs[i, 3] != 0.0:
                x = discs[i, 0]
                y = discs[i, 1]
                r = discs[i, 2]
                inside = dx * (y - ay) - dy * (x - ax)
                if abs(inside) >= r:
                    high = low
                    break
                foot = dx * (x - ax) + dy * (y - ay)
                half = math.sqrt((r - inside) * (r + inside))
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
    discs = np.empty((k, 4))
    arcs = np.empty((k * k, 3))
    polygon = np.empty((corners, 2))
    work = np.empty((max(k, 2 * corners + 3), 2))
    for s in range(n):
        for j in range(k):
            discs[j, 0] = centres[s, j, 0]
            discs[j, 1] = centres[s, j, 1]
            discs[j, 2] = radii[s, j]
        count = trace(discs, work, arcs)
        area[s] = 0.0
        if count == 0:
            continue
        # From here on about disc 0, where the digits are.
        for c in range(2):
            for j in range(k):
                discs[j, c] -= centres[s, 0, c]
            for j in range(corners):
                polygon[j, c] = polygons[s, j, c] - centres[s, 0, c]
        whole = arcs_inside(discs, arcs, count, polygon, work) + edges_inside(discs, polygon)
        area[s] = max(0.0, whole)
