"""Light of one microlens inside a cell: the area of a microlens image within convex polygons."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .circles import trace
from .pieces import EDGE, PIECE, cut_arcs, cut_edges, lay_edges, most_pieces

Array = NDArray[np.float64]


def area_inside(centres: Array, radii: Array, polygons: Sequence[Array]) -> float:
    """Area of one common part of discs, centres (K, 2), radii (K,), and convex polygons (M, 2), counterclockwise."""
    k, most = len(radii), sum(len(polygon) for polygon in polygons)
    discs, arcs, edges = np.column_stack([centres, radii, np.empty(k)]), np.empty((k * k, 5)), np.empty((most, EDGE))
    work, pieces = np.empty((k + 2 * most + 3, 2)), np.empty((most_pieces(k, most), PIECE))
    count = 0
    if k:
        count, _, _ = trace.interpreted(discs, work, arcs)
        if count == 0:
            return 0.0
    # From here on about disc 0, or the first polygon, where the digits are.
    origin = centres[0] if k else polygons[0].mean(0)
    discs[:, :2] -= origin
    sides = 0
    for number, polygon in enumerate(polygons):
        sides = lay_edges.interpreted(polygon - origin, number, edges, sides)
    turned = cut_arcs.interpreted(discs, arcs, count, edges, sides, work, pieces)
    filled = cut_edges.interpreted(discs, edges, sides, pieces, turned)
    along_arcs = _along_arcs(discs, pieces[:turned].tolist())
    return max(0.0, along_arcs + _along_edges(edges, pieces[turned:filled].tolist()))


def _along_arcs(discs: Array, pieces: list[list[float]]) -> float:
    """Green's integral ``(x dy - y dx)/2`` along pieces of circles."""
    total = 0.0
    for _, disc, start, end in pieces:
        x, y, r = (float(value) for value in discs[int(disc), :3])
        across = x * (math.sin(end) - math.sin(start)) + y * (math.cos(start) - math.cos(end))
        total += 0.5 * r * (r * (end - start) + across)
    return total


def _along_edges(edges: Array, pieces: list[list[float]]) -> float:
    """The integral along pieces of edges."""
    total = 0.0
    for _, edge, low, high in pieces:
        x, y, dx, dy = (float(value) for value in edges[int(edge), :4])
        total += 0.5 * (x * dy - y * dx) * (high - low)
    return total
