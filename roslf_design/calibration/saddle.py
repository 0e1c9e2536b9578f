"""Sub-pixel corners: two blurred edges that cross, integrated over each sample, fitted to the picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from .lattice import Array

_ROUNDS = 30
_BLUR = (0.15, 4.0)
"""Least and most blur (standard deviation) of an edge, besides the sample's own width [px]."""
_NODES = np.array([[-math.sqrt(0.6) / 2, 5 / 18], [0.0, 8 / 18], [math.sqrt(0.6) / 2, 5 / 18]])
"""Gauss's three points across a sample, with weights."""


class Saddles(NamedTuple):
    """Fitted corners."""

    corners: Array
    """Columns and rows, shape (n, 2)."""
    contrast: Array
    """Half the difference between bright and dark cells, its sign the corner's colours, shape (n,)."""
    misfit: Array
    """RMS difference between picture and model over the window, against the contrast, shape (n,)."""
    settled: NDArray[np.bool_]
    """Corners whose fit came to rest inside its window, with most of the window known."""


def fit_saddles(picture: Array, known: NDArray[np.bool_], corners: Array, edges: Array, half: int) -> Saddles:
    """Fit ``level + slopes + contrast erf(a/w) erf(b/w)`` around each corner, a and b distances from two edges.

    Each sample is the mean of the model over its square, as a microlens averages what its aperture sees; a model
    taken at the sample's middle is off by up to 0.1 px where edges are sharp and run along the rows.

    Parameters
    ----------
    picture : ndarray
        Shape (rows, columns).
    known : ndarray of bool
        Pixels to fit.
    corners : ndarray
        Start, columns and rows, shape (n, 2), within about a pixel.
    edges : ndarray
        Directions of the two edges [rad], shape (n, 2).
    half : int
        Windows reach this many pixels to each side, weighted by a Gaussian of 0.6 of that.

    Notes
    -----
    Levenberg-Marquardt in nine parameters.
    """
    out = np.zeros((len(corners), 5))
    run = _fit.compiled
    run(
        np.ascontiguousarray(picture, float),
        np.ascontiguousarray(known),
        np.ascontiguousarray(corners, float),
        np.ascontiguousarray(edges, float),
        half,
        _NODES,
        np.array(_BLUR),
        _ROUNDS,
        out,
    )
    return Saddles(out[:, :2], out[:, 2], out[:, 3], out[:, 4] > 0)


@kernel()
def _fit(
    picture: Array,
    known: NDArray[np.bool_],
    corners: Array,
    edges: Array,
    half: int,
    nodes: Array,
    blur: Array,
    rounds: int,
    out: Array,
) -> None:
    rows, columns = picture.shape
    H, new_H, L = np.empty((9, 9)), np.empty((9, 9)), np.empty((9, 9))
    g, new_g, step, p, trial = np.empty(9), np.empty(9), np.empty(9), np.empty(9), np.empty(9)
    for n in range(corners.shape[0]):
        cx, cy = math.floor(corners[n, 0] + 0.5), math.floor(corners[n, 1] + 0.5)
        out[n, 0], out[n, 1], out[n, 2], out[n, 3], out[n, 4] = corners[n, 0], corners[n, 1], 0.0, 1.0, 0.0
        if cx < half or cy < half or cx >= columns - half or cy >= rows - half:
            continue
        p[:] = 0.0
        p[0], p[1], p[2], p[3], p[4] = corners[n, 0] - cx, corners[n, 1] - cy, edges[n, 0], edges[n, 1], 0.8
        low, high, whole, covered = 1e300, -1e300, 0.0, 0.0
        for y in range(-half, half + 1):
            for x in range(-half, half + 1):
                w = math.exp(-0.5 * (x * x + y * y) / (0.36 * half * half))
                whole += w
                if known[cy + y, cx + x]:
                    covered += w
                    low, high = min(low, picture[cy + y, cx + x]), max(high, picture[cy + y, cx + x])
        if covered < 0.6 * whole or high <= low:
            continue
        p[5] = 0.5 * (low + high)
        # The sign of the contrast: the model against the picture at the start.
        p[8] = 0.5 * (high - low)
        cost = _misfit(picture, known, cx, cy, half, nodes, p, H, g, False)
        p[8] = -p[8]
        if _misfit(picture, known, cx, cy, half, nodes, p, H, g, False) > cost:
            p[8] = -p[8]
        cost = _misfit(picture, known, cx, cy, half, nodes, p, H, g, True)
        damping, moved, rest = 1e-2, 1e300, False
        for _ in range(rounds):
            if not _solve(H, g, damping, L, step):
                damping *= 8.0
                continue
            for k in range(9):
                trial[k] = p[k] + (min(max(step[k], -0.7), 0.7) if k < 5 else step[k])
            trial[4] = min(max(trial[4], blur[0]), blur[1])
            moved = max(abs(step[0]), abs(step[1]))
            cost_now = _misfit(picture, known, cx, cy, half, nodes, trial, new_H, new_g, True)
            if cost_now < cost:
                gain = cost - cost_now
                p[:] = trial
                damping = max(damping / 6.0, 1e-9)
                cost = cost_now
                H[:] = new_H
                g[:] = new_g
                if moved < 1e-3 and gain < 1e-4 * cost:
                    rest = True
                    break
            else:
                if moved < 1e-3:
                    rest = True
                    break
                damping *= 8.0
        out[n, 0], out[n, 1], out[n, 2] = cx + p[0], cy + p[1], p[8]
        out[n, 3] = math.sqrt(cost / covered) / max(abs(p[8]), 1e-300)
        if (rest or moved < 0.01) and max(abs(p[0]), abs(p[1])) < 0.6 * half:
            out[n, 4] = 1.0


@kernel()
def _misfit(
    picture: Array,
    known: NDArray[np.bool_],
    cx: int,
    cy: int,
    half: int,
    nodes: Array,
    p: Array,
    H: Array,
    g: Array,
    derivatives: bool,
) -> float:
    """Weighted square misfit; with `derivatives` the normal matrix and right side as well."""
    sin_a, cos_a, sin_b, cos_b = math.sin(p[2]), math.cos(p[2]), math.sin(p[3]), math.cos(p[3])
    w = p[4]
    scale, norm = 1.0 / (math.sqrt(2.0) * w), math.sqrt(2.0 / math.pi) / w
    if derivatives:
        H[:] = 0.0
        g[:] = 0.0
    d = np.empty(9)
    total = 0.0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            if not known[cy + y, cx + x]:
                continue
            weight = math.exp(-0.5 * (x * x + y * y) / (0.36 * half * half))
            d[:] = 0.0
            saddle = 0.0
            a0, b0 = cos_a * (y - p[1]) - sin_a * (x - p[0]), cos_b * (y - p[1]) - sin_b * (x - p[0])
            beyond_a, beyond_b = abs(a0) > 5.0 * w + 0.71, abs(b0) > 5.0 * w + 0.71
            sign_a, sign_b = (1.0 if a0 > 0.0 else -1.0), (1.0 if b0 > 0.0 else -1.0)
            if beyond_a and beyond_b:
                saddle = sign_a * sign_b
            for i in range(0 if beyond_a and beyond_b else nodes.shape[0]):
                dy = y + nodes[i, 0] - p[1]
                for j in range(nodes.shape[0]):
                    dx = x + nodes[j, 0] - p[0]
                    k = nodes[i, 1] * nodes[j, 1]
                    a, b = cos_a * dy - sin_a * dx, cos_b * dy - sin_b * dx
                    ea = sign_a if beyond_a else math.erf(a * scale)
                    eb = sign_b if beyond_b else math.erf(b * scale)
                    saddle += k * ea * eb
                    if derivatives:
                        first = 0.0 if beyond_a else k * norm * math.exp(-0.5 * (a / w) ** 2) * eb
                        second = 0.0 if beyond_b else k * norm * math.exp(-0.5 * (b / w) ** 2) * ea
                        d[0] += first * sin_a + second * sin_b
                        d[1] -= first * cos_a + second * cos_b
                        d[2] -= first * (cos_a * dx + sin_a * dy)
                        d[3] -= second * (cos_b * dx + sin_b * dy)
                        d[4] -= (first * a + second * b) / w
            level = p[5] + p[6] * x / half + p[7] * y / half + p[8] * saddle
            rest = picture[cy + y, cx + x] - level
            total += weight * rest * rest
            if derivatives:
                for k5 in range(5):
                    d[k5] *= p[8]
                d[5], d[6], d[7], d[8] = 1.0, x / half, y / half, saddle
                for r in range(9):
                    g[r] += weight * d[r] * rest
                    for c in range(r + 1):
                        H[r, c] += weight * d[r] * d[c]
    return total


@kernel()
def _solve(H: Array, g: Array, damping: float, L: Array, step: Array) -> bool:
    """Damped normal equations by Cholesky's method; false where they are not positive definite."""
    for j in range(9):
        for i in range(j, 9):
            total = H[i, j]
            if i == j:
                total += damping * H[j, j] + 1e-300
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if total <= 0.0:
                    return False
                L[j, j] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    for j in range(9):
        total = g[j]
        for k in range(j):
            total -= L[j, k] * step[k]
        step[j] = total / L[j, j]
    for m in range(9):
        j = 8 - m
        total = step[j]
        for k in range(j + 1, 9):
            total -= L[k, j] * step[k]
        step[j] = total / L[j, j]
    return True
