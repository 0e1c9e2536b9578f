"""Area, moments and textures of discs cut by boxes, integrated slice by slice with Gauss panels.

A slice at x runs from the highest lower edge to the lowest upper edge of all curves there. Between the places where
another curve takes over its length is smooth but for square roots at the ends, which ``x = middle - half cos(pi u)``
removes: Gauss's rule in u then converges exponentially.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Texture = Callable[[Floats, Floats], Floats]
"""Brightness at sensor points (x, y)."""


@lru_cache(maxsize=64)
def gauss(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss's rule on [0, 1], weights right to some 1e-14 of themselves.

    numpy's lose two more digits at the ends, where 1 - x^2 cancels. Here Newton's method on ``P_n(cos t)`` finds the
    angle whose cosine a node is, from which both follow without a difference.
    """
    t = math.pi * (np.arange(count, 0, -1) - 0.25) / (count + 0.5)
    for _ in range(6):
        x = np.cos(t)
        before, here = np.ones_like(x), x
        for k in range(2, count + 1):
            before, here = here, ((2 * k - 1) * x * here - (k - 1) * before) / k
        slope = -count * (before - x * here) / np.sin(t)
        t = t - here / slope
    return np.cos(0.5 * t) ** 2, 1 / slope**2


@lru_cache(maxsize=64)
def _mapped(count: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Gauss's rule, and the places and weights of the panels' map, from 0 to 2 in units of half a panel."""
    u, w = gauss(count)
    return u, w, 1 - np.cos(math.pi * u), math.pi * np.sin(math.pi * u) * w


def breaks(centres: Floats, radii: Floats, low: Floats, high: Floats) -> Floats:
    """Where slices change their curves, sorted, shape (P, B); the first and last are the ends (equal if empty)."""
    start = np.maximum(low[:, 0], np.max(centres[:, 0] - radii))
    end = np.maximum(np.minimum(high[:, 0], np.min(centres[:, 0] + radii)), start)
    places = [start, end]
    for (x, y), r in zip(centres, radii, strict=True):
        for edge in (low[:, 1], high[:, 1]):
            off = edge - y
            half = np.sqrt(np.maximum((r - off) * (r + off), 0.0))
            places += [x - half, x + half]
        places += [np.full(len(low), x)]
    for i, j in combinations(range(len(radii)), 2):
        places += [np.full(len(low), x) for x in crossings(centres[i], radii[i], centres[j], radii[j])]
    stacked = np.stack(places, -1)
    return np.sort(np.clip(stacked, start[:, None], end[:, None]), -1)


def crossings(a: Floats, r: float, b: Floats, R: float) -> list[float]:
    """X of the points where two circles cross."""
    dx, dy = b - a
    square = dx * dx + dy * dy
    if square == 0:
        return []
    t = 0.5 * (1 + (r - R) * (r + R) / square)
    root = r * r / square - t * t
    if root < 0:
        return []
    return [float(a[0] + t * dx + side * math.sqrt(root) * dy) for side in (-1, 1)]


def slice_moments(
    centres: Floats, radii: Floats, low: Floats, high: Floats, nodes: int, texture: Texture | None = None
) -> Floats:
    """Integrals of 1, x and y over the common part of discs in each of P boxes; of a texture instead where given.

    Parameters
    ----------
    centres, radii : ndarray
        Shapes (K, 2) and (K,).
    low, high : ndarray
        Corners of the boxes, shape (P, 2).
    nodes : int
        Of each panel (and, for textures, of each slice).
    texture : callable, optional

    Returns
    -------
    ndarray
        Shape (P, 3); (P,) for a texture.
    """
    edges = breaks(centres, radii, low, high)
    # Most curves do not change within most boxes: only panels of some width are integrated.
    box, panel = np.nonzero(edges[:, 1:] > edges[:, :-1])
    start, half = edges[box, panel], 0.5 * (edges[box, panel + 1] - edges[box, panel])
    u, w, ramp, slope = _mapped(nodes)
    x = start[:, None] + half[:, None] * ramp
    weight = half[:, None] * slope
    top, bottom = high[box, 1, None], low[box, 1, None]
    for (cx, cy), r in zip(centres, radii, strict=True):
        off = x - cx
        chord = np.sqrt(np.maximum((r - off) * (r + off), 0.0))
        top, bottom = np.minimum(top, cy + chord), np.maximum(bottom, cy - chord)
    length = np.maximum(top - bottom, 0.0)
    count = len(low)
    if texture is None:
        area = weight * length
        parts = (area, area * x, area * 0.5 * (top + bottom))
        return np.stack([np.bincount(box, part.sum(1), count) for part in parts], -1)
    y = bottom[..., None] + length[..., None] * u
    light = weight * length * (texture(x[..., None], y) @ w)
    return np.bincount(box, light.sum(1), count).astype(float)
