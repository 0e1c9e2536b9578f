"""Light of one microlens inside a cell: the area of a microlens image within a rectangle or a convex polygon."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .circles import TURN, exclude, leave, trace
from .discs import checked

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
    return np.array([_inside(*one) for one in zip(centre, radius, corners, strict=True)], float).reshape(lead)


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


def _inside(centres: Array, radii: Array, polygon: Array) -> float:
    """Area of one common part, centres (K, 2), radii (K,), in a polygon (M, 2), counterclockwise."""
    k, corners = len(radii), len(polygon)
    discs, arcs = np.column_stack([centres, radii, np.empty(k)]), np.empty((k * k, 5))
    work = np.empty((max(k, 2 * corners + 3), 2))
    count, _, _ = trace.interpreted(discs, work, arcs)
    if count == 0:
        return 0.0
    # From here on about disc 0, where the digits are.
    discs[:, :2] -= centres[0]
    near = polygon - centres[0]
    return max(0.0, _arcs_inside(discs, arcs, count, near, work) + _edges_inside(discs, near))


def _edge(polygon: Floats, e: int) -> tuple[float, float, float, float, float]:
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


def _arcs_inside(discs: Floats, arcs: Floats, count: int, polygon: Floats, work: Floats) -> float:
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
            ax, ay, dx, dy, length = _edge(polygon, e)
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
        if m == 0 or (m == 1 and free < TURN):  # no edge cuts it
            parts[0, 0] = arcs[k, 0]
            parts[0, 1] = arcs[k, 1]
        else:
            n = leave(origin, m, work, parts, 0)
        for p in range(n):
            start = parts[p, 0]
            end = parts[p, 1]
            across = x * (math.sin(end) - math.sin(start)) + y * (math.cos(start) - math.cos(end))
            total += 0.5 * r * (r * (end - start) + across)
    return total


def _edges_inside(discs: Floats, polygon: Floats) -> float:
    """Boundary integral along those parts of the polygon's edges that lie in all discs."""
    corners = len(polygon)
    total = 0.0
    for e in range(corners):
        ax, ay, dx, dy, high = _edge(polygon, e)
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
