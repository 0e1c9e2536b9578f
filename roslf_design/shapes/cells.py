"""Light of one microlens inside a cell: the area of a microlens image within a rectangle or a convex polygon."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .circles import trace
from .discs import checked
from .pieces import EDGE, PIECE, cut_arcs, cut_edges, lay_edges, most_pieces

Floats = NDArray[np.float64]
Array = Floats


def area_in_polygon(centres: ArrayLike, radii: ArrayLike, polygon: ArrayLike) -> Array:
    """Area of the common part of K discs inside a convex polygon, exactly.

    Parameters
    ----------
    centres, radii : array_like
        Discs [mm], shapes (..., K, 2) and (..., K), as `discs.intersect` takes them.
    polygon : array_like
        Corners [mm] in order, either way round, shape (..., M, 2); leading axes broadcast against those of the discs.

    Returns
    -------
    ndarray
        Areas [mm^2], shape (...), right to about 1e-15 of the square of the discs' and the polygon's extent.

    Raises
    ------
    ValueError
        As `discs.intersect`; a polygon that is not convex, or has no area.
    """
    centre, radius = checked(centres, radii)
    corners = np.asarray(polygon, float)
    if corners.ndim < 2 or corners.shape[-1] != 2 or corners.shape[-2] < 3:
        raise ValueError(f"polygon must have shape (..., M, 2) with M >= 3, not {corners.shape}")
    if not np.isfinite(corners).all():
        raise ValueError("corners of the polygon must be finite")
    corners = np.where(_doubled_area(corners)[..., None, None] < 0, corners[..., ::-1, :], corners)
    edge = np.roll(corners, -1, -2) - corners
    turn = _cross(edge, np.roll(edge, -1, -2))
    slack = 1e-12 * np.max(np.abs(edge), axis=(-2, -1), initial=0.0)[..., None] ** 2
    if (turn < -slack).any() or (_doubled_area(corners) <= 0).any():
        raise ValueError("the polygon must be convex, with an area, and its corners in order")
    lead = np.broadcast_shapes(radius.shape[:-1], corners.shape[:-2])
    k, m, n = radius.shape[-1], corners.shape[-2], math.prod(lead)
    centre = np.broadcast_to(centre, (*lead, k, 2)).reshape(n, k, 2)
    radius = np.broadcast_to(radius, (*lead, k)).reshape(n, k)
    corners = np.broadcast_to(corners, (*lead, m, 2)).reshape(n, m, 2)
    shares = [area_inside(c, r, [p]) for c, r, p in zip(centre, radius, corners, strict=True)]
    return np.array(shares, float).reshape(lead)


def area_in_rectangle(centres: ArrayLike, radii: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    """Area of the common part of K discs inside an upright rectangle, exactly.

    Parameters
    ----------
    centres, radii : array_like
        Discs [mm], shapes (..., K, 2) and (..., K).
    low, high : array_like
        Opposite corners [mm], shape (..., 2), each coordinate of `low` below that of `high`.

    Returns
    -------
    ndarray
        Areas [mm^2], shape (...), as `area_in_polygon`.
    """
    a, b = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
    if not (a < b).all():
        raise ValueError("a rectangle's low corner must lie below its high one in x and in y")
    corners = [a, np.stack([b[..., 0], a[..., 1]], -1), b, np.stack([a[..., 0], b[..., 1]], -1)]
    return area_in_polygon(centres, radii, np.stack(corners, -2))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _doubled_area(corners: Array) -> Array:
    """Twice the signed area; about the first corner, where the digits are."""
    spokes = corners - corners[..., :1, :]
    return np.asarray(_cross(spokes, np.roll(spokes, -1, -2)).sum(-1))


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
