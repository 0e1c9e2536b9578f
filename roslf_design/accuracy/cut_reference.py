"""Reference for cut diffraction images: Huygens's integral itself, on another set of pupil points.

The field behind the aperture is integrated over the aperture and squared, for each pixel's own Gauss points; the pupil
is cut into rows where the methods cut columns. No transfer function, no frequencies, no closed areas. Double precision:
right to about 1e-12 (tests compare it with many digits).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .cut_methods import pixel_places
from .jobs import Job
from .slices import gauss

Floats = NDArray[np.float64]

NODES = 40
"""Of each panel of rows, and four more for each blur width in the pupil's radius."""


def huygens_image(job: Job) -> Floats:
    """Light of each pixel, row by row."""
    rows, weights, left, right = _rows(*job.discs, NODES + math.ceil(4 * job.radius / job.blur[0]))
    x, y = pixel_places(job)
    if not rows.size:
        return np.zeros(x.size * y.size)
    line_x, line_y = _Line(job, x, np.concatenate([left, right])), _Line(job, y, rows)
    across = line_x.integral(left) - line_x.integral(right)
    return np.asarray(((line_y(rows) * weights) @ across.T).ravel())


class _Line:
    """Light of pupil points along one axis, by an interpolant through directly integrated values."""

    def __init__(self, job: Job, at: Floats, places: Floats) -> None:
        self.at = at
        low, high = float(at.min() - places.max()) - 1e-9, float(at.max() - places.min()) + 1e-9
        self.middle, self.half = 0.5 * (low + high), max(0.5 * (high - low), 1e-6)
        # k holds no cycle shorter than w: pi half/w of Chebyshev's degrees are needed, and some for the last digits.
        degree = math.ceil(2 * math.pi * self.half / job.blur[0]) + 48
        nodes = np.cos(math.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        values = self._exact(job, self.middle + self.half * nodes)
        k = np.arange(degree + 1)
        self.coefficients = 2 / (degree + 1) * np.cos(np.outer(k, np.arccos(nodes))) @ values
        self.coefficients[0] /= 2

    def _exact(self, job: Job, off: Floats) -> Floats:
        """Field over the aperture, squared, integrated over the pixel."""
        width, _, bend = job.blur
        sag = 0.5 * bend * job.design.d**2 / job.design.wavelength
        u, w = gauss(math.ceil(3.2 / width) + 16)
        farthest = float(np.abs(off).max()) + 0.5
        nodes, weights = gauss(math.ceil(1.7 * (farthest / width + abs(sag))) + 24)
        v = nodes - 0.5
        lens = weights * np.exp(-2j * math.pi * sag * v * v)
        places = off[:, None] + u - 0.5
        field = np.exp((-2j * math.pi / width) * places[..., None] * v) @ lens
        return np.asarray((field.real**2 + field.imag**2) @ w / width)

    def _scaled(self, places: Floats) -> Floats:
        return np.asarray(((self.at[:, None] - places) - self.middle) / self.half)

    def __call__(self, places: Floats) -> Floats:
        return np.asarray(np.polynomial.chebyshev.chebval(self._scaled(places), self.coefficients))

    def integral(self, places: Floats) -> Floats:
        """From anywhere up to ``at - places``."""
        whole = np.polynomial.chebyshev.chebint(self.coefficients) * self.half
        return np.asarray(np.polynomial.chebyshev.chebval(self._scaled(places), whole))


def _rows(centres: Floats, radii: Floats, nodes: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Heights of rows across the common part, their weights, and where each begins and ends."""
    y, x = centres[:, 1], centres[:, 0]
    low, high = float(np.max(y - radii)), float(np.min(y + radii))
    if high <= low:
        return (np.zeros(0),) * 4
    places = {low, high, *(float(v) for v in y)}
    for i in range(len(radii)):
        for j in range(i):
            places |= set(_heights(centres[i], radii[i], centres[j], radii[j]))
    edges = np.array(sorted(v for v in places if low <= v <= high))
    u, w = gauss(nodes)
    found = []
    for bottom, top in pairwise(edges):
        half = 0.5 * (top - bottom)
        # u^2 (3 - 2 u) has slope 0 at both ends, as the square roots there ask for, twice over.
        row = bottom + 2 * half * u * u * (3 - 2 * u)
        drow = 2 * half * 6 * u * (1 - u) * w
        reach = np.sqrt(np.maximum((radii - (row[:, None] - y)) * (radii + (row[:, None] - y)), 0.0))
        left, right = (x - reach).max(1), (x + reach).min(1)
        found.append([row, drow, left, np.maximum(left, right)])
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))  # type: ignore[return-value]


def _heights(a: Floats, r: float, b: Floats, R: float) -> list[float]:
    """Y of the points where two circles cross."""
    dx, dy = b - a
    square = float(dx * dx + dy * dy)
    if square == 0:
        return []
    t = 0.5 * (1 + (r - R) * (r + R) / square)
    root = r * r / square - t * t
    return [] if root < 0 else [float(a[1] + t * dy + side * math.sqrt(root) * dx) for side in (-1, 1)]
