"""Methods for the pixels behind one microlens: white, and of a sinusoid off the focal plane."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from .jobs import Job
from .methods import Kind, Method, grid_points, inside, random_points
from .pixels import covered_pixels
from .slices import slice_moments

Floats = NDArray[np.float64]

BLOCK = 2_000_000
"""Samples held at a time."""


def _exact(job: Job, level: int, seed: int) -> Floats:
    centres, radii = job.discs
    corner, width = job.box
    return covered_pixels(centres - corner, radii, width, width).ravel()


def _panels(job: Job, nodes: int, seed: int) -> Floats:
    low, high = job.cells
    if job.quantity == "pixel image":
        return slice_moments(*job.discs, low, high, nodes)[:, 0]
    return slice_moments(*job.discs, low, high, nodes, job.texture)


def _counted(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """The same points in every pixel; random ones anew in each."""
    centres, radii = job.discs
    low, _ = job.cells
    if kind == "random":
        rng = np.random.default_rng(seed)
    else:
        unit = grid_points(count) if kind == "grid" else random_points(kind, count, seed)
    each = count * count if kind == "grid" else count
    step = max(1, BLOCK // each)
    found = np.empty(len(low))
    for first in range(0, len(low), step):
        part = low[first : first + step]
        if kind == "random":
            points = rng.random((len(part), each, 2))
            x, y = part[:, :1] + points[..., 0], part[:, 1:] + points[..., 1]
        else:
            x, y = part[:, :1] + unit[:, 0], part[:, 1:] + unit[:, 1]
        kept = inside(centres, radii, x, y)
        light = kept if job.quantity == "pixel image" else kept * job.texture(x, y)
        found[first : first + step] = light.mean(-1)
    return found


def _per_pixel(power: int, job: Job, n: int) -> float:
    return float(job.pixels * n**power)


def _make() -> tuple[Method, ...]:
    found = [
        Method(
            "exact arc-pixel area",
            "pixel image",
            "exact",
            (0,),
            _exact,
            lambda job, n: float(job.pixels),
            "Green's theorem pixel by pixel",
        )
    ]
    for quantity in ("pixel image", "textured image"):
        inner = 1 if quantity == "pixel image" else 2
        found += [
            Method(
                "Gauss panels",
                quantity,
                "panels",
                (1, 2, 3, 4, 6, 8, 12, 16, 24, 32),
                _panels,
                partial(_per_pixel, inner),
                "slices of each pixel, n nodes a panel",
            ),
            Method(
                "grid",
                quantity,
                "grid",
                (1, 2, 4, 8, 16, 32, 64, 128),
                partial(_counted, "grid"),
                partial(_per_pixel, 2),
                "n x n points in each pixel",
            ),
            Method(
                "Monte Carlo",
                quantity,
                "random",
                tuple(4**k for k in range(1, 8)),
                partial(_counted, "random"),
                partial(_per_pixel, 1),
                "n random points in each pixel",
            ),
            Method(
                "scrambled Sobol",
                quantity,
                "sobol",
                tuple(4**k for k in range(1, 8)),
                partial(_counted, "sobol"),
                partial(_per_pixel, 1),
                "n evenly spread points in each pixel",
            ),
        ]
    return tuple(found)


IMAGES = _make()
