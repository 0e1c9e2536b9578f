"""Boundary of what discs and convex polygons have in common, in pieces: arcs and straight edges, as kernels.

Every polygon is its edges, and each of those a half-plane: arcs are cut by edges, edges by discs and by each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from .circles import TURN, exclude, leave, trace

Floats = NDArray[np.float64]

X, Y, DX, DY, LENGTH, OWNER = range(6)
"""Numbers of an edge: where it starts, its direction, its length; which polygon it is of."""
EDGE = 6
ARC, STRAIGHT, PIECE = 0.0, 1.0, 4
"""Rows of pieces: (0, disc, start and end [rad]) of an arc, (1, edge, start and end along it) of a straight one."""
COINCIDE = 1e-12
"""Share of edges' lengths up to which two of them lie on one line: the first one's is then kept."""


@kernel()
def ordered(values: Floats, count: int, order: NDArray[np.int64]) -> None:
    """Into `order`, which of the first values are the smaller, by insertion: numpy's sort takes seconds to compile."""
    for i in range(count):
        k = i
        while k > 0 and values[order[k - 1]] > values[i]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = i


@kernel()
def lay_edges(polygon: Floats, owner: float, edges: Floats, count: int) -> int:
    """Append the edges of a polygon (M, 2), counterclockwise; corners that repeat have none between."""
    corners = len(polygon)
    for e in range(corners):
        x = polygon[e, 0]
        y = polygon[e, 1]
        dx = polygon[(e + 1) % corners, 0] - x
        dy = polygon[(e + 1) % corners, 1] - y
        length = math.hypot(dx, dy)
        if length > 0.0:
            edges[count, X] = x
            edges[count, Y] = y
            edges[count, DX] = dx / length
            edges[count, DY] = dy / length
            edges[count, LENGTH] = length
            edges[count, OWNER] = owner
            count += 1
    return count


@kernel()
def _cut_arcs(discs: Floats, arcs: Floats, count: int, edges: Floats, sides: int, work: Floats, pieces: Floats) -> int:
    """Pieces of traced arcs on the inner side of all edges, from the first row on; returns how many there are."""
    parts = work[sides + 1 :]
    filled = 0
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
        for e in range(sides):
            dx = edges[e, DX]
            dy = edges[e, DY]
            # To the last bit as for the edges below: what one leaves out of a circle that just touches, the other does.
            inside = dx * (y - edges[e, Y]) - dy * (x - edges[e, X])
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
        if m == 0 or (m == 1 and free < TURN):  # no edge cuts it
            parts[0, 0] = arcs[k, 0]
            parts[0, 1] = arcs[k, 1]
        else:
            n = leave(origin, m, work, parts, 0)
        for p in range(n):
            pieces[filled, 0] = ARC
            pieces[filled, 1] = i
            pieces[filled, 2] = parts[p, 0]
            pieces[filled, 3] = parts[p, 1]
            filled += 1
    return filled


@kernel()
def within_edges(edges: Floats, sides: int, e: int, low: float, high: float) -> tuple[float, float]:
    """Part of an edge, from `low` to `high` along it, on the inner side of all other polygons' edges."""
    for f in range(sides):
        if edges[f, OWNER] == edges[e, OWNER]:
            continue
        fx = edges[f, DX]
        fy = edges[f, DY]
        apart = fx * (edges[e, Y] - edges[f, Y]) - fy * (edges[e, X] - edges[f, X])
        rise = fx * edges[e, DY] - fy * edges[e, DX]
        reach = max(edges[e, LENGTH], edges[f, LENGTH])
        if abs(rise) <= COINCIDE:
            if apart < -COINCIDE * reach or (apart <= COINCIDE * reach and edges[f, OWNER] < edges[e, OWNER]):
                return low, low
        elif rise > 0.0:
            low = max(low, -apart / rise)
        else:
            high = min(high, -apart / rise)
    return low, high


@kernel()
def _cut_edges(discs: Floats, edges: Floats, sides: int, pieces: Floats, filled: int) -> int:
    """Pieces of edges inside all discs and other polygons, behind `filled` rows; returns how many rows there are."""
    for e in range(sides):
        ax = edges[e, X]
        ay = edges[e, Y]
        dx = edges[e, DX]
        dy = edges[e, DY]
        low = 0.0
        high = edges[e, LENGTH]
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
            low, high = within_edges(edges, sides, e, low, high)
        if high > low:
            pieces[filled, 0] = STRAIGHT
            pieces[filled, 1] = e
            pieces[filled, 2] = low
            pieces[filled, 3] = high
            filled += 1
    return filled


@kernel()
def bound(discs: Floats, arcs: Floats, edges: Floats, sides: int, work: Floats, pieces: Floats) -> int:
    """Pieces of the boundary of what discs and polygons have in common; returns how many there are.

    Parameters
    ----------
    discs, arcs
        The D discs, rows (x, y, r, mark), and room for `trace`, (D * D, 5).
    edges, sides
        Edges of all polygons (`lay_edges`), and how many there are.
    work, pieces
        Room, (D + 2 * sides + 3, 2), and for the results (`most_pieces`, PIECE).
    """
    count = 0
    if len(discs) > 0:
        count, _, _ = trace(discs, work, arcs)
        if count == 0:
            return 0
    filled = _cut_arcs(discs, arcs, count, edges, sides, work, pieces)
    return _cut_edges(discs, edges, sides, pieces, filled)


def boundary(
    centres: Floats, radii: Floats, polygons: Sequence[Floats] | Floats
) -> tuple[Floats, Floats, list[list[float]]]:
    """Discs, edges and pieces (`bound`) of one common part of discs and convex polygons (M, 2), counterclockwise."""
    k, most = len(radii), sum(map(len, polygons))
    discs = np.column_stack([centres, radii, np.empty(k)])
    edges, pieces = np.empty((most, EDGE)), np.empty((most_pieces(k, most), PIECE))
    sides = 0
    for number, polygon in enumerate(polygons):
        sides = lay_edges.interpreted(polygon, number, edges, sides)
    work = np.empty((k + 2 * most + 3, 2))
    count = bound.interpreted(discs, np.empty((k * k, 5)), edges, sides, work, pieces)
    return discs, edges, pieces[:count].tolist()


def area_inside(centres: Floats, radii: Floats, polygons: Sequence[Floats]) -> float:
    """Area of one common part, as of `boundary`: Green's integral ``(x dy - y dx)/2`` along its pieces."""
    # About disc 0, or the first polygon, where the digits are.
    origin = centres[0] if len(radii) else polygons[0].mean(0)
    discs, edges, pieces = boundary(centres - origin, radii, [polygon - origin for polygon in polygons])
    along_arcs, along_edges = 0.0, 0.0
    for kind, index, start, end in pieces:
        if kind == ARC:
            x, y, r = discs[int(index), :3].tolist()
            across = x * (math.sin(end) - math.sin(start)) + y * (math.cos(start) - math.cos(end))
            along_arcs += 0.5 * r * (r * (end - start) + across)
        else:
            x, y, dx, dy = edges[int(index), :4].tolist()
            along_edges += 0.5 * (x * dy - y * dx) * (end - start)
    return max(0.0, along_arcs + along_edges)


def most_pieces(discs: int, sides: int) -> int:
    """Pieces of a boundary at most."""
    return discs * discs + (discs + 1) * (2 * sides + 1)


@kernel()
def break_heights(
    centres: Floats, radii: Floats, polygons: Floats, edges: Floats, pieces: Floats, work: Floats, out: Floats
) -> None:
    """Heights at which the sides of each of n common parts bend, rising, the last one repeated; (n, B).

    Of an empty part all are 0. `edges`, `pieces` and `work` are room.
    """
    count = radii.shape[1]
    discs = np.empty((count, 4))
    arcs = np.empty((count * count, 5))
    for s in range(len(radii)):
        for k in range(count):
            discs[k, 0] = centres[s, k, 0]
            discs[k, 1] = centres[s, k, 1]
            discs[k, 2] = radii[s, k]
        sides = 0
        for p in range(polygons.shape[1]):
            sides = lay_edges(polygons[s, p], p, edges, sides)
        n = bound(discs, arcs, edges, sides, work, pieces)
        m = 0
        for k in range(n):
            i = int(pieces[k, 1])
            if pieces[k, 0] == STRAIGHT:
                for end in range(2):
                    out[s, m] = edges[i, Y] + pieces[k, 2 + end] * edges[i, DY]
                    m += 1
                continue
            y = discs[i, 1]
            r = discs[i, 2]
            start = pieces[k, 2]
            end_angle = pieces[k, 3]
            out[s, m] = y + r * math.sin(start)
            out[s, m + 1] = y + r * math.sin(end_angle)
            m += 2
            for quarter in range(-3, 8):
                top = 0.5 * math.pi * (2 * quarter + 1)
                if start < top < end_angle:
                    out[s, m] = y + r * math.sin(top)
                    m += 1
        for k in range(1, m):
            height = out[s, k]
            at = k
            while at > 0 and out[s, at - 1] > height:
                out[s, at] = out[s, at - 1]
                at -= 1
            out[s, at] = height
        for k in range(m, out.shape[1]):
            out[s, k] = out[s, m - 1] if m > 0 else 0.0
