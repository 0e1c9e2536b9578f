"""Common part of ellipses and convex polygons: the microlens image where something is tilted."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from .discs import CLIPPED, EMPTY, FULL, DiscIntersection, common
from .pieces import DX, DY, EDGE, LENGTH, OWNER, X, Y, lay_edges, ordered, within_edges

Array = NDArray[np.float64]

INTERPRETED_BELOW = 64
"""Ellipses in all up to which compiling, or even loading compiled code, takes longer than it saves."""
_GAUSS = np.polynomial.legendre.leggauss(10)
NODES, WEIGHTS = (tuple(float(x) for x in values) for values in _GAUSS)
SAME = 1e-12
"""|p^T Q p - 1| up to which a point counts as lying on a boundary; one of two equal boundaries is then kept."""
SAMPLES = 16
"""Samples at which crossings are looked for before they are refined; a boundary has at most four with another."""


def intersect_ellipses(
    centres: ArrayLike, matrices: ArrayLike, polygons: ArrayLike | None = None, first: int = 0
) -> DiscIntersection:
    """Common parts of K ellipses and P convex polygons.

    Parameters
    ----------
    centres : array_like, shape (..., K, 2)
        [mm].
    matrices : array_like, shape (..., K, 3)
        (xx, xy, yy) of S in ``(p - centre)^T S^-1 (p - centre) = 1`` [mm^2].
    polygons : array_like, shape (..., P, M, 2), optional
        Corners counterclockwise [mm]; of fewer than M, some repeated.
    first : int
        Which counts as whole: an ellipse, or ``K + p`` of a polygon.

    Returns
    -------
    DiscIntersection
        As `discs.intersect` gives for discs, with the first in the place of disc 0, ellipses before polygons. Areas,
        positions and moments are right to about 1e-13 of the first (its area, semi-axis and semi-axis squared); so is
        `lost_fraction`, here 1 - `kept_fraction`.
    """
    c, s = np.asarray(centres, float), np.asarray(matrices, float)
    lead, k = c.shape[:-2], c.shape[-2]
    p = np.empty((*lead, 0, 3, 2)) if polygons is None else np.asarray(polygons, float)
    sets = (part.reshape(math.prod(lead), *part.shape[len(lead) :]) for part in (c, s, p))
    c, s, p = (np.ascontiguousarray(part) for part in sets)
    own = (c[:, first], s[:, first]) if first < k else _spans(p[:, first - k])
    middle, form = map(np.ascontiguousarray, own)  # kernels are compiled once more for another layout
    total = k + p.shape[1]
    compiled = _ellipse_shapes.ready or len(c) * total >= INTERPRETED_BELOW
    return common(_ellipse_shapes, compiled, lead, total, middle, form, c, s, p, first)


def _spans(polygon: Array) -> tuple[Array, Array]:
    """Ellipses about as large as polygons (n, M, 2): centres and matrices."""
    middle = polygon.mean(1)
    x, y = np.moveaxis(polygon - middle[:, None], -1, 0)
    return middle, np.stack([(x * x).mean(1), (x * y).mean(1), (y * y).mean(1)], -1)


@kernel()
def _value(p: Array, c: float, s: float) -> float:
    """Value of a trigonometric polynomial of degree 2, coefficients of 1, cos, sin, cos 2x and sin 2x."""
    at: float = p[0] + p[1] * c + p[2] * s + p[3] * (c * c - s * s) + p[4] * 2.0 * c * s
    return at


@kernel()
def _crossing(p: Array, slope: Array, left: float, right: float) -> float:
    """Root of a trigonometric polynomial in a bracket, by guarded Newton steps."""
    rising = _value(p, math.cos(left), math.sin(left)) < 0
    x = 0.5 * (left + right)
    for _ in range(60):
        c, s = math.cos(x), math.sin(x)
        f, g = _value(p, c, s), _value(slope, c, s)
        if (f < 0) == rising:
            left = x
        else:
            right = x
        new = x - f / g if g != 0 else right
        if not (left < new < right):
            new = 0.5 * (left + right)
        if abs(new - x) <= 1e-15 * (1 + abs(x)):
            return new
        x = new
    return x


@kernel()
def _cuts(p: Array, slope: Array, bend: Array, places: Array, count: int) -> int:
    """Append the angles in [0, 2 pi) where a polynomial is zero; `slope` and `bend` take its derivatives."""
    slope[0], slope[1], slope[2], slope[3], slope[4] = 0.0, p[2], -p[1], 2 * p[4], -2 * p[3]
    bend[0], bend[1], bend[2], bend[3], bend[4] = 0.0, -p[1], -p[2], -4 * p[3], -4 * p[4]
    left = 0.0
    f0, g0 = _value(p, 1.0, 0.0), _value(slope, 1.0, 0.0)
    for k in range(1, SAMPLES + 1):
        right = k * (2 * math.pi / SAMPLES)
        c, s = math.cos(right), math.sin(right)
        f1, g1 = _value(p, c, s), _value(slope, c, s)
        if (f0 < 0) != (f1 < 0):
            places[count] = _crossing(p, slope, left, right)
            count += 1
        elif (g0 < 0) != (g1 < 0) and (f0 < 0) != (g0 < 0):
            turn = _crossing(slope, bend, left, right)
            if (_value(p, math.cos(turn), math.sin(turn)) < 0) != (f0 < 0):
                places[count] = _crossing(p, slope, left, turn)
                places[count + 1] = _crossing(p, slope, turn, right)
                count += 2
        left, f0, g0 = right, f1, g1
    return count


@kernel()
def _to_unit(middle: Array, form: Array, centres: Array, matrices: Array, unit: Array) -> tuple[float, float, float]:
    """Ellipses where that of a middle and a form is the unit circle: centre (2), boundary's axes, inverse (3).

    Returns the map's own lower triangle (xx, xy, yy).
    """
    lx = math.sqrt(form[0])
    ly = form[1] / lx
    lz = math.sqrt(form[2] - ly * ly)
    for k in range(len(centres)):
        dx = (centres[k, 0] - middle[0]) / lx
        dy = (centres[k, 1] - middle[1] - ly * dx) / lz
        xx = matrices[k, 0] / (lx * lx)
        xy = (matrices[k, 1] / lx - ly * xx) / lz
        yy = (matrices[k, 2] - ly * ly * xx - 2 * ly * lz * xy) / (lz * lz)
        det = xx * yy - xy * xy
        ax = math.sqrt(xx)
        unit[k, 0], unit[k, 1] = dx, dy
        unit[k, 2], unit[k, 3], unit[k, 4] = ax, xy / ax, math.sqrt(det) / ax
        unit[k, 5], unit[k, 6], unit[k, 7] = yy / det, -xy / det, xx / det
    return lx, ly, lz


@kernel()
def _side_of(first: Array, second: Array, poly: Array) -> int:
    """Into `poly`, the polynomial on one boundary that is positive outside the other; 1, -1: everywhere out, in; 0.

    ``(p + a cos + b sin)^T Q (p + a cos + b sin) - 1`` with b = (0, b_y): of the second degree in cosine and sine.
    """
    ax, ay, by = first[2], first[3], first[4]
    px, py = first[0] - second[0], first[1] - second[1]
    qxx, qxy, qyy = second[5], second[6], second[7]
    aa = qxx * ax * ax + 2 * qxy * ax * ay + qyy * ay * ay
    bb = qyy * by * by
    poly[0] = qxx * px * px + 2 * qxy * px * py + qyy * py * py + 0.5 * (aa + bb) - 1
    poly[1] = 2 * (ax * (qxx * px + qxy * py) + ay * (qxy * px + qyy * py))
    poly[2] = 2 * by * (qxy * px + qyy * py)
    poly[3] = 0.5 * (aa - bb)
    poly[4] = qxy * ax * by + qyy * ay * by
    most = math.sqrt(poly[1] ** 2 + poly[2] ** 2) + math.sqrt(poly[3] ** 2 + poly[4] ** 2)
    return 1 if poly[0] > most else -1 if poly[0] < -most else 0


@kernel()
def _beyond_edge(own: Array, edge: Array, poly: Array) -> int:
    """`_side_of` of an edge: the polynomial that is positive beyond it."""
    nx, ny = edge[DY], -edge[DX]
    poly[0] = nx * (own[0] - edge[X]) + ny * (own[1] - edge[Y])
    poly[1] = nx * own[2] + ny * own[3]
    poly[2] = ny * own[4]
    poly[3] = poly[4] = 0.0
    most = math.sqrt(poly[1] ** 2 + poly[2] ** 2)
    return 1 if poly[0] > most else -1 if poly[0] < -most else 0


@kernel()
def _add_edge(unit: Array, edges: Array, sides: int, e: int, sums: Array) -> int:
    """Add what one edge bounds of the common part, as `_add_boundary`."""
    ax, ay, dx, dy, high = edges[e, X], edges[e, Y], edges[e, DX], edges[e, DY], edges[e, LENGTH]
    low = 0.0
    for k in range(len(unit)):
        px, py = ax - unit[k, 0], ay - unit[k, 1]
        qxx, qxy, qyy = unit[k, 5], unit[k, 6], unit[k, 7]
        a = qxx * dx * dx + 2 * qxy * dx * dy + qyy * dy * dy
        b = qxx * px * dx + qxy * (px * dy + py * dx) + qyy * py * dy
        under = b * b - a * (qxx * px * px + 2 * qxy * px * py + qyy * py * py - 1)
        if under <= 0.0:
            return 0
        root = math.sqrt(under)
        low, high = max(low, (-b - root) / a), min(high, (-b + root) / a)
    if high > low:
        low, high = within_edges(edges, sides, e, low, high)
    if high <= low:
        return 0
    half = 0.5 * (high - low)
    for q in range(10):
        at = low + half * (1 + NODES[q])
        _add_point(ax + at * dx, ay + at * dy, dx, dy, WEIGHTS[q] * half, sums)
    return 2 if low == 0.0 and high == edges[e, LENGTH] else 1


@kernel()
def _add_point(x: float, y: float, dx: float, dy: float, weight: float, sums: Array) -> None:
    """One point's share of Green's integrals along a boundary: area, x, y, xx, xy, yy."""
    sums[0] += weight * 0.5 * (x * dy - y * dx)
    sums[1] += weight * 0.5 * x * x * dy
    sums[2] -= weight * 0.5 * y * y * dx
    sums[3] += weight * x * x * x * dy / 3
    sums[4] += weight * 0.5 * x * x * y * dy
    sums[5] -= weight * y * y * y * dx / 3


@kernel()
def _add_arc(own: Array, start: float, end: float, sums: Array) -> None:
    """Green's integrals along a piece of a boundary: area, x, y, xx, xy, yy."""
    parts = math.ceil((end - start) / (0.5 * math.pi))
    half = 0.5 * (end - start) / parts
    for part in range(parts):
        mid = start + (2 * part + 1) * half
        for q in range(10):
            c, s = math.cos(mid + half * NODES[q]), math.sin(mid + half * NODES[q])
            x, y = own[0] + own[2] * c, own[1] + own[3] * c + own[4] * s
            dx, dy = -own[2] * s, own[4] * c - own[3] * s
            _add_point(x, y, dx, dy, WEIGHTS[q] * half, sums)


@kernel()
def _is_kept(poly: Array, rims: int, own: int, middle: float) -> bool:
    """Whether a point of a boundary lies inside all others."""
    c, s = math.cos(middle), math.sin(middle)
    for j in range(rims):
        limit = SAME if own < j else -SAME
        if j != own and _value(poly[j], c, s) > limit:
            return False
    return True


@kernel()
def _add_boundary(
    unit: Array, edges: Array, own: int, lead: bool, poly: Array, places: Array, apart: NDArray[np.bool_], sums: Array
) -> int:
    """Add what one ellipse bounds of the common part; 0: nothing, 1: some of its boundary, 2: all of it."""
    rims, others = len(unit), len(unit) + len(edges)
    count = 0
    outside, within = False, True
    for j in range(others):
        if j != own:
            straight = j >= rims
            side = (
                _beyond_edge(unit[own], edges[j - rims], poly[j]) if straight else _side_of(unit[own], unit[j], poly[j])
            )
            if side > 0:
                if not straight:
                    apart[own, j] = True
                outside = True
                continue
            if side < 0:
                continue
            p, within = poly[j], False
            if abs(p[0]) + abs(p[1]) + abs(p[2]) + abs(p[3]) + abs(p[4]) <= SAME:
                outside = outside or j < own  # the same boundary: the first is kept
            elif not outside:
                count = _cuts(p, poly[others], poly[others + 1], places, count)
    if outside:
        return 0
    if count == 0:
        if not within and not _is_kept(poly, others, own, math.pi):
            return 0
        if not lead:
            _add_arc(unit[own], 0.0, 2 * math.pi, sums)
        return 2
    order = np.empty(count, np.int64)
    ordered(places, count, order)
    bounds = 0
    for piece in range(count):
        start = places[order[piece]]
        end = places[order[piece + 1]] if piece + 1 < count else places[order[0]] + 2 * math.pi
        if end > start and _is_kept(poly, others, own, 0.5 * (start + end)):
            _add_arc(unit[own], start, end, sums)
            bounds = 1
    return bounds


@kernel()
def _contains(own: Array, edges: Array, polygon: int) -> bool:
    """Whether all corners of a polygon lie well inside an ellipse, which then bounds nothing of what is cut out."""
    for e in range(len(edges)):
        if int(edges[e, OWNER]) == polygon:
            px, py = edges[e, X] - own[0], edges[e, Y] - own[1]
            if own[5] * px * px + 2 * own[6] * px * py + own[7] * py * py > 1 - 1e-6:
                return False
    return True


@kernel()
def _whole(centre: Array, matrix: Array, row: Array) -> None:
    """The row of an ellipse that nothing cuts: kept exactly, not to rounding."""
    row[0] = math.pi * math.sqrt(matrix[0] * matrix[2] - matrix[1] * matrix[1])
    row[1], row[2] = 1.0, 0.0
    row[3], row[4] = centre[0], centre[1]
    row[5], row[6], row[7] = 0.25 * matrix[0], 0.25 * matrix[1], 0.25 * matrix[2]


@kernel()
def _ellipse_shapes(
    middle: Array, form: Array, centres: Array, matrices: Array, polygons: Array, first: int,
    table: Array, status: NDArray[np.int8], clips: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Common parts of sets of ellipses and polygons, as `discs.common` wants them."""
    rims, straight, corners = centres.shape[1], polygons.shape[1], polygons.shape[2]
    most = straight * corners
    unit, poly, edges = np.empty((rims, 8)), np.empty((rims + most + 2, 5)), np.empty((most, EDGE))
    places, sums = np.empty(4 * rims + 2 * most + 2), np.empty(6)
    corner = np.empty((corners, 2))
    apart, index = np.empty((rims, rims), np.bool_), np.empty(rims, np.int64)
    for n in range(len(centres)):
        clips[n] = False
        status[n] = FULL
        if rims == 1 and straight == 0:
            _whole(middle[n], form[n], table[n])
            continue
        lx, ly, lz = _to_unit(middle[n], form[n], centres[n], matrices[n], unit)
        sides = 0
        for p in range(straight):
            for m in range(corners):
                corner[m, 0] = (polygons[n, p, m, 0] - middle[n, 0]) / lx
                corner[m, 1] = (polygons[n, p, m, 1] - middle[n, 1] - ly * corner[m, 0]) / lz
            sides = lay_edges(corner, rims + p, edges, sides)
        sums[:] = 0.0
        apart[:] = False
        status[n] = EMPTY
        near = 0
        for i in range(rims):
            if first < rims or not _contains(unit[i], edges[:sides], first):
                index[near] = i
                for k in range(8):
                    unit[near, k] = unit[i, k]
                near += 1
        for i in range(near):
            bounds = _add_boundary(unit[:near], edges[:sides], i, i == first, poly, places, apart, sums)
            if i == first and bounds == 2:
                status[n] = FULL
                break
            if bounds:
                status[n] = CLIPPED
                clips[n, index[i]] = i != first
        if status[n] == FULL:
            _whole(middle[n], form[n], table[n])
            continue
        uncut, area_of_first = first >= rims, math.pi
        if uncut:
            area_of_first = 0.0
        for e in range(sides):
            bounds, owner = _add_edge(unit[:near], edges, sides, e, sums), int(edges[e, OWNER])
            if owner == first:
                uncut = uncut and bounds == 2
                area_of_first += 0.5 * edges[e, LENGTH] * (edges[e, X] * edges[e, DY] - edges[e, Y] * edges[e, DX])
            elif bounds:
                clips[n, owner] = True
            if bounds:
                status[n] = CLIPPED
        area = sums[0]
        if area <= 0.0:
            status[n] = EMPTY
            table[n] = 0.0
            table[n, 2] = 1.0
            table[n, 3], table[n, 4] = middle[n, 0], middle[n, 1]
            _name_empty(apart[:near, :near], index, first, clips[n])
            continue
        if uncut:
            status[n] = FULL
            clips[n] = False
            area = area_of_first
        ux, uy = sums[1] / area, sums[2] / area
        vxx, vxy, vyy = sums[3] / area - ux * ux, sums[4] / area - ux * uy, sums[5] / area - uy * uy
        share = min(area / area_of_first, 1.0)
        table[n, 0], table[n, 1], table[n, 2] = area_of_first * lx * lz * share, share, 1.0 - share
        table[n, 3] = middle[n, 0] + lx * ux
        table[n, 4] = middle[n, 1] + ly * ux + lz * uy
        table[n, 5] = lx * lx * vxx
        table[n, 6] = lx * (ly * vxx + lz * vxy)
        table[n, 7] = ly * ly * vxx + 2 * ly * lz * vxy + lz * lz * vyy


@kernel()
def _name_empty(apart: NDArray[np.bool_], index: NDArray[np.int64], first: int, clips: NDArray[np.bool_]) -> None:
    """Which openings leave nothing: a pair of ellipses without a common point, else all together."""
    for k in range(len(clips)):
        clips[k] = k != first
    for i in range(len(apart)):
        for j in range(i):
            if apart[i, j] and apart[j, i]:
                for k in range(len(clips)):
                    clips[k] = k != first and (k == index[i] or k == index[j])
                return
