"""Common part of K ellipses: the microlens image where something is tilted.

In coordinates that turn ellipse 0 into the unit circle, each boundary is cut at its crossings with the others, the
pieces inside all others are kept, and area and moments follow from Green's theorem along them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel

Array = NDArray[np.float64]

SAME = 1e-12
"""|p^T Q p - 1| up to which a point counts as lying on a boundary; one of two equal boundaries is then kept."""
SAMPLES = 16
"""Where crossings are looked for before they are refined; a boundary has at most four with another."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)


class Shapes(NamedTuple):
    """Common parts of ellipses, shape (...) each."""

    area: Array
    """[mm^2]."""
    x: Array
    y: Array
    """Centroid [mm]; NaN where nothing is left."""
    kept_fraction: Array
    """Area over that of ellipse 0."""
    axis_ratio: Array
    """Minor over major axis of the second moments; NaN where nothing is left."""


def intersect_ellipses(centres: Array, matrices: Array) -> Shapes:
    """Common parts of K ellipses.

    Parameters
    ----------
    centres : ndarray, shape (N, K, 2)
        [mm].
    matrices : ndarray, shape (N, K, 3)
        (xx, xy, yy) of S in ``(p - centre)^T S^-1 (p - centre) = 1`` [mm^2].

    Returns
    -------
    Shapes
        Shape (N,); areas right to about 1e-13 of ellipse 0.
    """
    results = np.empty((6, len(centres)))
    if len(centres):
        run = _all.compiled if len(centres) * centres.shape[1] > 64 else _all
        run(np.ascontiguousarray(centres), np.ascontiguousarray(matrices), results, _NODES, _WEIGHTS)
    share, x, y, xx, xy, yy = results
    scale = np.sqrt(matrices[:, 0, 0] * matrices[:, 0, 2] - matrices[:, 0, 1] ** 2)
    lit = share > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        major = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        ratio = np.sqrt(np.maximum(xx * yy - xy * xy, 0.0)) / major
        ratio = np.where(lit, ratio, np.nan)
    return Shapes(math.pi * scale * share, np.where(lit, x, np.nan), np.where(lit, y, np.nan), share, ratio)


@kernel()
def _crossing(c0: float, c1: float, s1: float, c2: float, s2: float, left: float, right: float, slope: bool) -> float:
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
def _cuts(c0: float, c1: float, s1: float, c2: float, s2: float, cuts: Array, count: int) -> int:
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
            cuts[count] = _crossing(c0, c1, s1, c2, s2, left, right, False)
            count += 1
        elif (g0 < 0) != (g1 < 0) and (f0 < 0) != (g0 < 0):
            turn = _crossing(c0, c1, s1, c2, s2, left, right, True)
            c, s = math.cos(turn), math.sin(turn)
            top = c0 + c1 * c + s1 * s + c2 * (c * c - s * s) + s2 * 2 * c * s
            if (top < 0) != (f0 < 0):
                cuts[count] = _crossing(c0, c1, s1, c2, s2, left, turn, False)
                cuts[count + 1] = _crossing(c0, c1, s1, c2, s2, turn, right, False)
                count += 2
        f0, g0 = f1, g1
    return count


@kernel()
def _all(centres: Array, matrices: Array, results: Array, nodes: Array, weights: Array) -> None:
    """Fill `results` (share of ellipse 0, centroid, central second moments per area) for every image."""
    images, rims = centres.shape[0], centres.shape[1]
    # For each rim, in units where rim 0 is the unit circle: centre (2), boundary's axes (a_x, a_y, b_y), inverse (3).
    unit = np.empty((rims, 8))
    poly = np.empty((rims, 5))
    cuts = np.empty(4 * rims + 2)
    sums = np.empty(6)
    for n in range(images):
        lx = math.sqrt(matrices[n, 0, 0])
        ly = matrices[n, 0, 1] / lx
        lz = math.sqrt(matrices[n, 0, 2] - ly * ly)
        for k in range(rims):
            dx = (centres[n, k, 0] - centres[n, 0, 0]) / lx
            dy = (centres[n, k, 1] - centres[n, 0, 1] - ly * dx) / lz
            xx = matrices[n, k, 0] / (lx * lx)
            xy = (matrices[n, k, 1] / lx - ly * xx) / lz
            yy = (matrices[n, k, 2] - ly * ly * xx - 2 * ly * lz * xy) / (lz * lz)
            det = xx * yy - xy * xy
            ax = math.sqrt(xx)
            unit[k, 0], unit[k, 1] = dx, dy
            unit[k, 2], unit[k, 3], unit[k, 4] = ax, xy / ax, math.sqrt(det) / ax
            unit[k, 5], unit[k, 6], unit[k, 7] = yy / det, -xy / det, xx / det
        for m in range(6):
            sums[m] = 0.0
        whole = False
        for i in range(rims):
            if whole:
                break
            mx, my, ax, ay, by = unit[i, 0], unit[i, 1], unit[i, 2], unit[i, 3], unit[i, 4]
            count = 0
            outside = False
            for j in range(rims):
                if j == i:
                    continue
                px, py = mx - unit[j, 0], my - unit[j, 1]
                qxx, qxy, qyy = unit[j, 5], unit[j, 6], unit[j, 7]
                # f = (p + a cos + b sin)^T Q (p + a cos + b sin) - 1, with b = (0, by).
                aa = qxx * ax * ax + 2 * qxy * ax * ay + qyy * ay * ay
                bb = qyy * by * by
                ab = qxy * ax * by + qyy * ay * by
                poly[j, 0] = qxx * px * px + 2 * qxy * px * py + qyy * py * py + 0.5 * (aa + bb) - 1
                poly[j, 1] = 2 * (ax * (qxx * px + qxy * py) + ay * (qxy * px + qyy * py))
                poly[j, 2] = 2 * by * (qxy * px + qyy * py)
                poly[j, 3] = 0.5 * (aa - bb)
                poly[j, 4] = ab
                swing = math.sqrt(poly[j, 1] ** 2 + poly[j, 2] ** 2) + math.sqrt(poly[j, 3] ** 2 + poly[j, 4] ** 2)
                if poly[j, 0] > swing:
                    outside = True
                    break
                count = _cuts(poly[j, 0], poly[j, 1], poly[j, 2], poly[j, 3], poly[j, 4], cuts, count)
            if outside:
                continue
            ordered = np.sort(cuts[:count])
            pieces = max(count, 1)
            for piece in range(pieces):
                start = ordered[piece] if count > 0 else 0.0
                if count == 0:
                    end = 2 * math.pi
                elif piece + 1 < count:
                    end = ordered[piece + 1]
                else:
                    end = ordered[0] + 2 * math.pi
                middle = 0.5 * (start + end)
                c, s = math.cos(middle), math.sin(middle)
                kept = True
                for j in range(rims):
                    if j != i:
                        f = (
                            poly[j, 0]
                            + poly[j, 1] * c
                            + poly[j, 2] * s
                            + poly[j, 3] * (c * c - s * s)
                            + poly[j, 4] * 2 * c * s
                        )
                        if f > (SAME if i < j else -SAME):
                            kept = False
                            break
                if not kept:
                    continue
                if i == 0 and count == 0:
                    whole = True  # nothing cuts rim 0: one exactly, not to rounding
                    sums[1] = sums[2] = sums[4] = 0.0
                    sums[3] = sums[5] = 0.25 * math.pi
                    break
                parts = math.ceil((end - start) / (0.5 * math.pi))
                half = 0.5 * (end - start) / parts
                for part in range(parts):
                    mid = start + (2 * part + 1) * half
                    for q in range(nodes.shape[0]):
                        c, s = math.cos(mid + half * nodes[q]), math.sin(mid + half * nodes[q])
                        x, y = mx + ax * c, my + ay * c + by * s
                        dx, dy = -ax * s, by * c - ay * s
                        weight = weights[q] * half
                        sums[0] += weight * 0.5 * (x * dy - y * dx)
                        sums[1] += weight * 0.5 * x * x * dy
                        sums[2] -= weight * 0.5 * y * y * dx
                        sums[3] += weight * x * x * x * dy / 3
                        sums[4] += weight * 0.5 * x * x * y * dy
                        sums[5] -= weight * y * y * y * dx / 3
        area = math.pi if whole else sums[0]
        if area <= 0:
            for m in range(6):
                results[m, n] = 0.0
            continue
        ux, uy = sums[1] / area, sums[2] / area
        vxx, vxy, vyy = sums[3] / area - ux * ux, sums[4] / area - ux * uy, sums[5] / area - uy * uy
        results[0, n] = min(area / math.pi, 1.0)
        results[1, n] = centres[n, 0, 0] + lx * ux
        results[2, n] = centres[n, 0, 1] + ly * ux + lz * uy
        results[3, n] = lx * lx * vxx
        results[4, n] = lx * (ly * vxx + lz * vxy)
        results[5, n] = ly * ly * vxx + 2 * ly * lz * vxy + lz * lz * vyy
