"""Methods for the rays of one microlens through a real main lens: where they meet the focal plane."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..lenses.of_design import camera_of
from ..lenses.prescription import LensError
from ..lenses.surrogate import Surrogate, fitted
from ..lenses.trace import Rays, trace
from .jobs import LENS, Job
from .lens_jobs import FIELD, RAYS, microlens_rays
from .methods import Method

Floats = NDArray[np.float64]


def _traced(job: Job, level: int, seed: int) -> Floats:
    camera = camera_of(job.design)
    place, slope = microlens_rays(job.design, job.axis)
    size = np.sqrt(1 + (slope**2).sum(0))
    start = np.stack([*place, np.full(RAYS, camera.mla)])
    rays = Rays(start, np.stack([-slope[0], -slope[1], -np.ones(RAYS)]) / size)
    found = trace(camera.lens, rays, camera.wavelength, backward=True, plane=camera.focal_plane, clip=False)
    return np.asarray(found.rays.position[:2].T.ravel())


@lru_cache(maxsize=128)
def surrogate_of(design: Design, order: int) -> Surrogate | None:
    """Fitted once for the middle of the array; None where the lens does not let the whole FAP be seen from there."""
    try:
        return fitted(camera_of(design), FIELD * design.microlens_array.size[0], order=order)
    except LensError:
        return None


def _surrogate(job: Job, order: int, seed: int) -> Floats:
    """Fitting, 0.05 to 1 s once for a lens, is not counted: pictures trace millions of rays through one fit."""
    camera, found = camera_of(job.design), surrogate_of(job.design, order)
    assert found is not None
    place, slope = microlens_rays(job.design, job.axis)
    rays = found.rays(place[0, :1], place[1, :1], slope[0], slope[1])
    depth = camera.fap.z - camera.focal_plane
    return np.stack([rays.x - depth * rays.slope_x, rays.y - depth * rays.slope_y], -1).ravel()


def _thin(job: Job, level: int, seed: int) -> Floats:
    """The lens's thin twin: its principal planes and focal length alone."""
    design = job.design
    place, slope = microlens_rays(design, job.axis)
    height = place - slope * design.d_1
    return np.asarray((height - (slope + height / design.f) * design.d_f).T.ravel())


def _fits(job: Job) -> bool:
    return surrogate_of(job.design, 1) is not None


def _surfaces(job: Job, level: int) -> float:
    assert job.design.lens is not None
    return float(len(job.design.lens.surfaces))


LENSES = (
    Method("exact trace", LENS, "exact", (0,), _traced, _surfaces, "Snell's law at every surface"),
    Method(
        "polynomial surrogate", LENS, "fit", (1, 2, 3, 4, 5, 6, 8), _surrogate, lambda job, n: n + 3.0,
        "fitted once, order n in the field, 5 in the pupil", _fits,
    ),
    Method("thin lens", LENS, "first order", (0,), _thin, lambda job, n: 1.0, "focal length and principal planes"),
)  # fmt: skip
"""Methods for rays through real lenses."""
