"""The camera that a plan asks for, and where on the sensor its microlens images lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..effects import Plan, SceneBrief, Subject
from ..effects.field import exit_pupil_vergence, image_diameter, ray_blur, stop_scale
from ..effects.geometry import tilt_shift

Floats = NDArray[np.float64]

STRAIGHT = (0.0, 0.0)


def planned_design(design: Design, plan: Plan) -> Design:
    """The design without what the plan leaves out, its main lens ideal.

    Misalignments that are off become zero; without vignetting the lens is wide and the bore has no further rims;
    without microlens defocus the microlenses image the exit pupil onto the sensor.
    """
    design = straightened(design, plan).thin_twin
    changes: dict[str, Any] = {}
    if not plan.on("microlens_defocus"):
        power = 1 / design.d_2 + exit_pupil_vergence(design)
        if power > 0:
            changes["microlens_array.focal_length"] = 1 / power
    if not plan.on("vignetting"):
        changes |= {"main_lens.diameter": _wide(design), "stops": ()}
    return design.replace(changes)


def straightened(design: Design, plan: Plan) -> Design:
    """The design without the misalignments that the plan leaves out; a real main lens stays."""
    changes: dict[str, Any] = {}
    places = ("main_lens", "aperture", *(f"stops.{k}" for k in range(len(design.stops))), "microlens_array", "sensor")
    for effect, key in (("tilts", "tilt"), ("decentres", "decentre")):
        if not plan.on(effect):
            changes |= {f"{place}.{key}": STRAIGHT for place in places}
    if not plan.on("mla_rotation"):
        changes["microlens_array.rotation"] = 0.0
    return design.replace(changes)


def _wide(design: Design) -> float:
    """A main lens that clips nothing: as wide as the array's far corner needs, ten times over [mm]."""
    corner = math.hypot(*design.microlens_array.size)
    reach = corner * (1 + design.d_1 / design.d_2) + design.D_F
    return 10 * (design.D + reach * design.d_f / (design.d_f - design.d_3))


@dataclass(frozen=True)
class ImageLattice:
    """Where microlenses stand on the array and their images' centres on the sensor, both affine in the index."""

    axes: Floats
    """Columns: steps of a microlens in its array's frame [mm], shape (2, 2)."""
    image_axes: Floats
    """Columns: steps of an image's centre in the sensor's frame [mm]."""
    image_origin: Floats
    """Image centre of the microlens at the array's centre [mm], shape (2,)."""
    half_size: tuple[float, float]
    """Microlenses whose centres lie beyond this are not there [mm]."""
    reach: float
    """How far from an image's centre its light may fall, by rays [mm]."""

    @classmethod
    def of(cls, design: Design) -> ImageLattice:
        """The lattice of a design; tilts widen `reach`, everything else is exact."""
        array, sensor = design.microlens_array, design.sensor
        step = np.array([[1.0, 0.5], [0.0, math.sqrt(3) / 2]]) if array.layout == "hexagonal" else np.eye(2)
        axes = design.d * step
        c, s = math.cos(array.rotation), math.sin(array.rotation)
        turn = np.array([[c, -s], [s, c]])
        grow = 1 + design.d_2 * exit_pupil_vergence(design)
        lens, fap = np.array(design.main_lens.decentre), np.array(design.aperture.decentre)
        shift = stop_scale(design, design.d_3) * (lens * (design.d_3 / design.f) - fap)
        origin = grow * np.array(array.decentre) + shift - np.array(sensor.decentre)
        width, height = array.size
        slack = (
            0.0
            if design.aligned
            else 2 * tilt_shift(Subject(design, SceneBrief(field_radius=math.hypot(width, height) / 2)))
        )
        # A stop cannot widen an image, but a microlens out of focus can, and a finite one moves it.
        reach = image_diameter(design) / 2 + ray_blur(design) * math.sqrt(0.5) + slack
        # A microlens belongs to the array if its whole cell fits.
        half = (width - design.d) / 2, (height - axes[1, 1]) / 2
        return cls(axes, grow * turn @ axes, origin, half, reach)

    @property
    def neighbours(self) -> int:
        """How many lattice steps around the nearest image may reach a sensor point."""
        height = abs(np.linalg.det(self.image_axes)) / np.linalg.norm(self.image_axes, axis=0).max()
        return math.ceil(float(self.reach / height) + 0.5)

    def indices(self, left: float, right: float, low: float, high: float) -> NDArray[np.int64]:
        """Indices of the microlenses whose images may touch a rectangle of the sensor, shape (N, 2), row by row."""
        corners = np.array(
            [[x, y] for x in (left - self.reach, right + self.reach) for y in (low - self.reach, high + self.reach)]
        )
        found = np.linalg.solve(self.image_axes, (corners - self.image_origin).T)
        (i0, j0), (i1, j1) = np.floor(found.min(1)).astype(int), np.ceil(found.max(1)).astype(int)
        i, j = np.meshgrid(np.arange(i0, i1 + 1), np.arange(j0, j1 + 1))
        index = np.stack([i.ravel(), j.ravel()], -1)
        place, image = index @ self.axes.T, index @ self.image_axes.T + self.image_origin
        near = (image[:, 0] >= left - self.reach) & (image[:, 0] <= right + self.reach)
        near &= (image[:, 1] >= low - self.reach) & (image[:, 1] <= high + self.reach)
        there = (np.abs(place) <= np.array(self.half_size) + 1e-9).all(1)
        return np.asarray(index[near & there])
