"""Methods for kept fraction, area and centroid of one microlens image."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..microlens.discs import intersect
from .jobs import Job
from .methods import Kind, Method, grid_points, inside, random_points
from .slices import slice_moments

Floats = NDArray[np.float64]

COUNTED = ("kept fraction", "centroid", "area")


def _from_moments(job: Job, area: float, x: float, y: float) -> Floats:
    """The quantity from integrals of 1, x and y."""
    if job.quantity == "kept fraction":
        return np.array([area / (math.pi * job.radius**2)])
    if job.quantity == "area":
        return np.array([area])
    return np.array([x / area, y / area]) if area > 0 else job.discs[0][0].copy()


def _closed(job: Job, level: int, seed: int) -> Floats:
    shape = intersect(*job.discs)
    if job.quantity == "centroid":
        return np.asarray(shape.centroid)
    return np.array([shape.kept_fraction if job.quantity == "kept fraction" else shape.area])


def _panels(job: Job, nodes: int, seed: int) -> Floats:
    centres, radii = job.discs
    low, high = centres[:1] - radii[0], centres[:1] + radii[0]
    return _from_moments(job, *(float(v) for v in slice_moments(centres, radii, low, high, nodes)[0]))


def _adaptive(job: Job, digits: int, seed: int) -> Floats:
    """Slices by scipy's adaptive rule, told nothing of where curves change."""
    from scipy.integrate import quad_vec

    centres, radii = job.discs
    start, end = float(np.max(centres[:, 0] - radii)), float(np.min(centres[:, 0] + radii))
    if end <= start:
        return _from_moments(job, 0.0, 0.0, 0.0)

    def slices(x: float) -> Floats:
        chord = np.sqrt(np.maximum((radii - (x - centres[:, 0])) * (radii + (x - centres[:, 0])), 0.0))
        top, bottom = float(np.min(centres[:, 1] + chord)), float(np.max(centres[:, 1] - chord))
        length = max(top - bottom, 0.0)
        return np.array([length, x * length, 0.5 * (top + bottom) * length])

    scale = math.pi * job.radius**2
    found, _ = quad_vec(slices, start, end, epsabs=scale * 10.0**-digits, epsrel=0.0, norm="max", limit=2000)
    return _from_moments(job, *(float(v) for v in found))


def _counted(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """Points in the square around the pupil's image."""
    centres, radii = job.discs
    unit = grid_points(count) if kind == "grid" else random_points(kind, count, seed)
    x, y = (centres[0] + radii[0] * (2 * unit - 1)).T
    kept = inside(centres, radii, x, y)
    if job.quantity == "kept fraction":
        # Over the points in the pupil's own disc: what is whole comes out as 1.
        whole = int(inside(centres[:1], radii[:1], x, y).sum())
        return np.array([int(kept.sum()) / whole if whole else 0.0])
    cell = 4 * job.radius**2 / len(unit)
    return _from_moments(job, cell * int(kept.sum()), cell * float(x[kept].sum()), cell * float(y[kept].sum()))


def _make() -> tuple[Method, ...]:
    ways: list[tuple[str, Kind, tuple[int, ...], Callable[[Job, int, int], Floats], Callable[[Job, int], float], str]]
    ways = [
        ("closed form", "exact", (0,), _closed, lambda job, n: 1.0, "arcs and triangles in stable form"),
        (
            "Gauss panels",
            "panels",
            (1, 2, 3, 4, 6, 8, 12, 16, 24),
            _panels,
            lambda job, n: n,
            "slices, n nodes a panel",
        ),
        ("adaptive quadrature", "adaptive", (1, 2, 4, 6, 8, 10, 12), _adaptive, lambda job, n: 2.0**n, "to 10^-n"),
        (
            "grid",
            "grid",
            (4, 8, 16, 32, 64, 128, 256, 512, 1024),
            partial(_counted, "grid"),
            lambda job, n: n * n,
            "n x n points",
        ),
        (
            "Monte Carlo",
            "random",
            tuple(4**k for k in range(2, 11)),
            partial(_counted, "random"),
            lambda job, n: n,
            "n random points",
        ),
        (
            "scrambled Sobol",
            "sobol",
            tuple(4**k for k in range(2, 10)),
            partial(_counted, "sobol"),
            lambda job, n: n,
            "n evenly spread points",
        ),
    ]
    return tuple(
        Method(name, quantity, kind, levels, compute, work, does)
        for quantity in COUNTED
        for name, kind, levels, compute, work, does in ways
    )


SHAPES = _make()
