"""Single microlenses of a design with tilts: rims are no discs on the sensor, so rays are counted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..rays import System, trace_pupil
from ..rays.sampling import pupil_samples
from ..rays.status import Status
from .result import Field, RayBudget
from .rims import axes_in_space

RAYS = 65_536
"""Rays per microlens, evenly over the FAP, where no accuracy is asked for."""
BEST_ACCURACY = 3e-5
"""Below this, counting takes more rays than memory holds comfortably."""
RIM_POINTS = 4096
"""Points of the FAP's rim that outline its image; the polygon's area is right to 1e-6."""


def rays_for(accuracy: float) -> int:
    """Rays that count a share to within `accuracy`.

    Points that fill the FAP evenly, cut by a rim, miss its share by at most about ``N^-3/4`` (largest of six tilted
    cameras each at 256 to 262 144 rays); twice that is allowed for.

    Raises
    ------
    ValueError
        Not between `BEST_ACCURACY` and 1.
    """
    if not BEST_ACCURACY <= accuracy <= 1:
        raise ValueError(
            f"accuracy {accuracy:g} is out of reach of counted rays; give {BEST_ACCURACY:g} to 1, or leave out tilts: "
            "straight designs are exact"
        )
    return max(256, math.ceil(math.pow(2 / accuracy, 4 / 3)))


def count_fields(design: Design, axes: Sequence[tuple[float, float]], rays: int = RAYS) -> tuple[Field, ...]:
    """Shape and ray budget of the microlens at each place, every tilt included, from so many rays each."""
    system = System.from_design(design)
    return tuple(_count(design, system, axis, rays) for axis in axes)


def _count(design: Design, system: System, axis: tuple[float, float], count: int) -> Field:
    samples = pupil_samples(count)
    traced = trace_pupil(system, (samples[0], samples[1]), axis)
    status = traced.status
    # One rim after the other, in the order of the budget: the main lens, then each further stop.
    taken = {int(np.asarray(code).item()): mask for mask, code in traced.taken}
    clear = status != Status.UNTRACEABLE
    past = []
    for code in (Status.MAIN_LENS, *(Status.APERTURE + k for k in range(1, len(system.stops)))):
        clear = clear & ~taken[code]
        past.append(clear)
    kept = past[-1]
    landing = np.stack(traced.sensor, -1)[kept] + np.asarray(design.sensor.decentre)
    share = float(kept.mean())
    lit = bool(kept.any())
    centroid = landing.mean(axis=0) - axes_in_space(design, [axis])[0] if lit else None
    return Field(
        x_ml_mm=axis,
        status="full" if kept.all() else "clipped" if lit else "dark",
        area_mm2=share * _pupil_image_area(system, axis),
        kept_fraction=share,
        lost_fraction=float((~kept).mean()),
        centroid_mm=None if centroid is None else (float(centroid[0]), float(centroid[1])),
        axis_ratio=_axis_ratio(landing) if lit else None,
        ray_budget=RayBudget(
            fap=1.0,
            main_lens=float(past[0].mean()),
            stops=tuple(float(passed.mean()) for passed in past[1:]),
            own_cell=float((status == Status.KEPT).mean()),
        ),
        rays=count,
    )


def _pupil_image_area(system: System, axis: tuple[float, float]) -> float:
    angle = 2 * math.pi * np.arange(RIM_POINTS) / RIM_POINTS
    inside = 1 - 1e-12  # on the rim, rounding decides whether a ray is still of the pupil
    x, y = trace_pupil(system, (inside * np.cos(angle), inside * np.sin(angle)), axis).sensor
    x, y = x - x.mean(), y - y.mean()
    polygon = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))
    return polygon * (2 * math.pi / RIM_POINTS) / math.sin(2 * math.pi / RIM_POINTS)


def _axis_ratio(points: NDArray[np.float64]) -> float:
    if len(points) < 3:
        return 0.0
    minor, major = np.linalg.eigvalsh(np.cov(points.T))
    return math.sqrt(max(float(minor), 0.0) / float(major)) if major > 0 else 0.0
