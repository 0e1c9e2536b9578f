"""Common part of K ellipses: the microlens image where something is tilted."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from .discs import CLIPPED, EMPTY, FULL, DiscIntersection

Array = NDArray[np.float64]


INTERPRETED_BELOW = 64
"""Ellipses in all up to which compiling, or even loading compiled code, takes longer than it saves."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)


def intersect_ellipses(centres: ArrayLike, matrices: ArrayLike) -> DiscIntersection:
    """Common parts of K ellipses.

    Parameters
    ----------
    centres : array_like, shape (..., K, 2)
        [mm].
    matrices : array_like, shape (..., K, 3)
        (xx, xy, yy) of S in ``(p - centre)^T S^-1 (p - centre) = 1`` [mm^2].

    Returns
    -------
    DiscIntersection
        As `discs.intersect` gives for discs, ellipse 0 in the place of disc 0. Areas, positions and moments are right
        to about 1e-13 of ellipse 0 (its area, semi-axis and semi-axis squared); so is `lost_fraction`, here
        1 - `kept_fraction`.
    """
    c, s = np.asarray(centres, float), np.asarray(matrices, float)
    lead, k = c.shape[:-2], c.shape[-2]
    c, s = np.ascontiguousarray(c.reshape(-1, k, 2)), np.ascontiguousarray(s.reshape(-1, k, 3))
    n = len(c)
    results, status, clipping = np.empty((6, n)), np.empty(n, np.int8), np.empty((n, k), np.bool_)
    run = ellipse_shapes.interpreted if n * k <= INTERPRETED_BELOW else ellipse_shapes.compiled
    run(c, s, results, status, clipping, _NODES, _WEIGHTS)
    share, x, y, *moments = results
    dark = np.equal(status, EMPTY)
    centroid = np.where(dark[:, None], c[:, 0], np.stack([x, y], axis=-1))
    area = math.pi * np.sqrt(s[:, 0, 0] * s[:, 0, 2] - s[:, 0, 1] ** 2) * share
    return DiscIntersection(
        area.reshape(lead),
        centroid.reshape(*lead, 2),
        np.stack(moments, axis=-1).reshape(*lead, 3),
        share.reshape(lead),
        (1 - share).reshape(lead),
        status.reshape(lead),
        clipping.reshape(*lead, k),
    )


SAME = 1e-12
"""|p^T Q p - 1| up to which a point counts as lying on a boundary; one of two equal boundaries is then kept."""
SAMPLES = 16
"""Where crossings are looked for before they are refined; a boundary has at most four with another."""


@kernel()
def crossing(c0: float, c1: float, s1: float, c2: float, s2: float, left: float, right: float, slope: bool) -> float:
    """Root of a trigonometric polynomial (of its derivative where `slope`) in a bracket, by guarded Newton steps."""
    x = 0.5 * (left + right)
    rising = False
    for step in range(60):
        at = left if step == 0 else x
        c, s = math.cos(at), math.sin(at)
        cc, ss = c * c - s * s, 2 * c * s
        if slope:
            f = -c1 * s + s1 * c - 2 * c2 * ss + 2 * s2 * cc
            g = -c1 * c - s1 * s - 4 * c2 * cc - 4 * s2 * ss
        else:
            f = c0 + c1 * c + s1 * s + c2 * cc + s2 * ss
            g = -c1 * s + s1 * c - 2 * c2 * ss + 2 * s2 * cc
        if step == 0:
            rising = f < 0
            continue
        if (f < 0) == rising:
            left = x
        else:
            right = x
        new = x - f / g if g != 0 else 0.5 * (left + right)
        if not (left < new < right):
            new = 0.5 * (left + right)
        if abs(new - x) <= 1e-15 * (1 + abs(x)):
            return new
        x = new
    return x


@kernel()
def cuts(c0: float, c1: float, s1: float, c2: float, s2: float, places: Array, count: int) -> int:
    """Append the angles in [0, 2 pi) where a trigonometric polynomial of degree 2 is zero."""
    if abs(c0) > math.sqrt(c1 * c1 + s1 * s1) + math.sqrt(c2 * c2 + s2 * s2):
        return count
    width = 2 * math.pi / SAMPLES
    f0 = c0 + c1 + c2
    g0 = s1 + 2 * s2
    for k in range(1, SAMPLES + 1):
        c, s = math.cos(k * width), math.sin(k * width)
        cc, ss = c * c - s * s, 2 * c * s
        f1 = c0 + c1 * c + s1 * s + c2 * cc + s2 * ss
        g1 = -c1 * s + s1 * c - 2 * c2 * ss + 2 * s2 * cc
        left, right = (k - 1) * width, k * width
        if (f0 < 0) != (f1 < 0):
            places[count] = crossing(c0, c1, s1, c2, s2, left, right, False)
            count += 1
        elif (g0 < 0) != (g1 < 0) and (f0 < 0) != (g0 < 0):
            turn = crossing(c0, c1, s1, c2, s2, left, right, True)
            c, s = math.cos(turn), math.sin(turn)
            top = c0 + c1 * c + s1 * s + c2 * (c * c - s * s) + s2 * 2 * c * s
            if (top < 0) != (f0 < 0):
                places[count] = crossing(c0, c1, s1, c2, s2, left, turn, False)
                places[count + 1] = crossing(c0, c1, s1, c2, s2, turn, right, False)
                count += 2
        f0, g0 = f1, g1
    return count


@kernel()
def to_unit(centres: Array, matrices: Array, unit: Array) -> None:
    """Ellipses where ellipse 0 is the unit circle: centre (2), boundary's axes (a_x, a_y, b_y), inverse (3)."""
    lx = math.sqrt(matrices[0, 0])
    ly = matrices[0, 1] / lx
    lz = math.sqrt(matrices[0, 2] - ly * ly)
    for k in range(len(centres)):
        dx = (centres[k, 0] - centres[0, 0]) / lx
        dy = (centres[k, 1] - centres[0, 1] - ly * dx) / lz
        xx = matrices[k, 0] / (lx * lx)
        xy = (matrices[k, 1] / lx - ly * xx) / lz
        yy = (matrices[k, 2] - ly * ly * xx - 2 * ly * lz * xy) / (lz * lz)
        det = xx * yy - xy * xy
        ax = math.sqrt(xx)
        unit[k, 0], unit[k, 1] = dx, dy
        unit[k, 2], unit[k, 3], unit[k, 4] = ax, xy / ax, math.sqrt(det) / ax
        unit[k, 5], unit[k, 6], unit[k, 7] = yy / det, -xy / det, xx / det


@kernel()
def outside_of(first: Array, second: Array, poly: Array) -> bool:
    """Into `poly`, the polynomial on one boundary that is positive outside the other; whether it is so everywhere.

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
    return bool(poly[0] > math.sqrt(poly[1] ** 2 + poly[2] ** 2) + math.sqrt(poly[3] ** 2 + poly[4] ** 2))


@kernel()
def add_arc(own: Array, start: float, end: float, nodes: Array, weights: Array, sums: Array) -> None:
    """Green's integrals along a piece of a boundary: area, x, y, xx, xy, yy."""
    parts = math.ceil((end - start) / (0.5 * math.pi))
    half = 0.5 * (end - start) / parts
    for part in range(parts):
        mid = start + (2 * part + 1) * half
        for q in range(nodes.shape[0]):
            c, s = math.cos(mid + half * nodes[q]), math.sin(mid + half * nodes[q])
            x, y = own[0] + own[2] * c, own[1] + own[3] * c + own[4] * s
            dx, dy = -own[2] * s, own[4] * c - own[3] * s
            weight = weights[q] * half
            sums[0] += weight * 0.5 * (x * dy - y * dx)
            sums[1] += weight * 0.5 * x * x * dy
            sums[2] -= weight * 0.5 * y * y * dx
            sums[3] += weight * x * x * x * dy / 3
            sums[4] += weight * 0.5 * x * x * y * dy
            sums[5] -= weight * y * y * y * dx / 3


@kernel()
def is_kept(poly: Array, rims: int, own: int, middle: float) -> bool:
    """Whether a point of a boundary lies inside all others."""
    c, s = math.cos(middle), math.sin(middle)
    for j in range(rims):
        if j != own:
            p = poly[j]
            f = p[0] + p[1] * c + p[2] * s + p[3] * (c * c - s * s) + p[4] * 2 * c * s
            if f > (SAME if own < j else -SAME):
                return False
    return True


@kernel()
def add_boundary(
    unit: Array,
    own: int,
    poly: Array,
    places: Array,
    apart: NDArray[np.bool_],
    nodes: Array,
    weights: Array,
    sums: Array,
) -> int:
    """Add what one ellipse bounds of the common part; 0: nothing, 1: some of its boundary, 2: all of it."""
    rims = len(unit)
    count = 0
    outside = False
    for j in range(rims):
        if j != own:
            if outside_of(unit[own], unit[j], poly[j]):
                apart[own, j] = True
                outside = True
                continue
            p = poly[j]
            if (
                abs(p[0]) + abs(p[1]) + abs(p[2]) + abs(p[3]) + abs(p[4]) <= SAME
            ):  # the same boundary: the first is kept
                outside = outside or j < own
            elif not outside:
                count = cuts(p[0], p[1], p[2], p[3], p[4], places, count)
    if outside:
        return 0
    if count == 0:
        if not is_kept(poly, rims, own, math.pi):
            return 0
        if own == 0:  # nothing cuts it: one exactly, not to rounding
            sums[0] = math.pi
            sums[1] = sums[2] = sums[4] = 0.0
            sums[3] = sums[5] = 0.25 * math.pi
        else:
            add_arc(unit[own], 0.0, 2 * math.pi, nodes, weights, sums)
        return 2
    ordered = np.sort(places[:count])
    found = 0
    for piece in range(count):
        start = ordered[piece]
        end = ordered[piece + 1] if piece + 1 < count else ordered[0] + 2 * math.pi
        if end > start and is_kept(poly, rims, own, 0.5 * (start + end)):
            add_arc(unit[own], start, end, nodes, weights, sums)
            found = 1
    return found


@kernel()
def ellipse_shapes(
    centres: Array, matrices: Array, results: Array, status: NDArray[np.int8], clips: NDArray[np.bool_], nodes: Array,
    weights: Array,
) -> None:  # fmt: skip
    """Fill `results` (share of ellipse 0, centroid, central second moments per area) and verdicts for every image."""
    rims = centres.shape[1]
    unit, poly = np.empty((rims, 8)), np.empty((rims, 5))
    places, sums = np.empty(4 * rims + 2), np.empty(6)
    apart = np.empty((rims, rims), np.bool_)
    for n in range(len(centres)):
        to_unit(centres[n], matrices[n], unit)
        for m in range(6):
            sums[m] = 0.0
        apart[:] = False
        clips[n] = False
        state = EMPTY
        for i in range(rims):
            found = add_boundary(unit, i, poly, places, apart, nodes, weights, sums)
            if i == 0 and found == 2:
                state = FULL
                break
            if found:
                state = CLIPPED
                clips[n, i] = i > 0
        if sums[0] <= 0.0:
            state = EMPTY
        status[n] = state
        if state == EMPTY:
            for m in range(6):
                results[m, n] = 0.0
            name_empty(apart, clips[n])
            continue
        area = sums[0]
        ux, uy = sums[1] / area, sums[2] / area
        vxx, vxy, vyy = sums[3] / area - ux * ux, sums[4] / area - ux * uy, sums[5] / area - uy * uy
        lx = math.sqrt(matrices[n, 0, 0])
        ly = matrices[n, 0, 1] / lx
        lz = math.sqrt(matrices[n, 0, 2] - ly * ly)
        results[0, n] = min(area / math.pi, 1.0)
        results[1, n] = centres[n, 0, 0] + lx * ux
        results[2, n] = centres[n, 0, 1] + ly * ux + lz * uy
        results[3, n] = lx * lx * vxx
        results[4, n] = lx * (ly * vxx + lz * vxy)
        results[5, n] = ly * ly * vxx + 2 * ly * lz * vxy + lz * lz * vyy


@kernel()
def name_empty(apart: NDArray[np.bool_], clips: NDArray[np.bool_]) -> None:
    """Which ellipses leave nothing: a pair without a common point, else all together."""
    rims = len(clips)
    for i in range(rims):
        clips[i] = i > 0
    for i in range(rims):
        for j in range(i):
            if apart[i, j] and apart[j, i]:
                for k in range(rims):
                    clips[k] = k > 0 and k in (i, j)
                return
