"""From a design with a real main lens to the camera that is traced.

The design's distances count from the principal planes: d_f, d_3 and the further stops from the object-side one, d_1
from the image-side one. Everything then stands in the lens's own frame, its decentre taken up by what is around it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Design, Stop
from ..design.parts import MicrolensArray, Sensor
from ..errors import InputError
from .camera import UPRIGHT, LensCamera, Plane, Rim, chief_slope
from .fields import FieldMap, field_map, undistorted_field
from .first_order import first_order
from .images import CLIPPED, FOLDED, MicrolensImages, real_images
from .perturb import turned
from .trace import KEPT, describe

Array = NDArray[np.float64]

VISIBLE = (486.1e-6, 656.3e-6)
"""F and C lines [mm]: lateral colour is told between them."""


@lru_cache(maxsize=64)
def camera_of(design: Design) -> LensCamera:
    """The traced camera of a design.

    Parameters
    ----------
    design : Design
        With a real main lens. A tilt of the main lens turns it about the middle of its principal planes, one of any
        other part about its own centre.

    Raises
    ------
    LensError
        Parts that collide: a stop or the array inside the lens.
    ValueError
        The design's main lens is ideal.
    """
    lens = design.lens
    if lens is None:
        raise ValueError(f"{design.name} has an ideal main lens; there is nothing to trace")
    constants = first_order(lens, design.wavelength)
    front, rear = constants.front_principal, constants.rear_principal
    if design.main_lens.tilt != (0.0, 0.0):
        lens = turned(lens, *design.main_lens.tilt, pivot=(front + rear) / 2)
    lens_x, lens_y = design.main_lens.decentre

    def rim(stop: Stop) -> Rim:
        x, y = stop.decentre
        return Rim(stop.diameter, front - stop.distance, x - lens_x, y - lens_y, stop.tilt)

    def stands(part: MicrolensArray | Sensor) -> Plane:
        x, y = part.decentre
        return Plane(x - lens_x, y - lens_y, part.tilt) if part.tilt != (0.0, 0.0) else UPRIGHT

    mla = rear + design.d_1
    rims = tuple(rim(stop) for stop in design.all_stops)
    planes = (stands(design.microlens_array), stands(design.sensor))
    return LensCamera(lens, design.wavelength, rims, front - design.d_f, mla, mla + design.d_2, *planes)


def tilted_parts(design: Design) -> tuple[str, ...]:
    """Parts around the main lens that are tilted."""
    tilts = {"FAP": design.aperture.tilt, "microlens array": design.microlens_array.tilt, "sensor": design.sensor.tilt}
    tilts |= {f"stop {number}": stop.tilt for number, stop in enumerate(design.stops, start=1)}
    return tuple(name for name, tilt in tilts.items() if tilt != (0.0, 0.0))


def microlenses(design: Design, axes: Sequence[tuple[float, float]] | ArrayLike) -> Array:
    """Microlens axes (..., 2), given in the array's own frame, in the lens's [mm]; as if the array stood upright."""
    on_array = np.asarray(axes, float)
    cosine, sine = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    there = on_array @ np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(there + np.subtract(design.microlens_array.decentre, design.main_lens.decentre))


class RealField(NamedTuple):
    """What a real lens does to microlenses (N); lengths in mm, nan where there is no light to tell it by."""

    microlens: Array
    """In the lens's frame, (N, 2)."""
    images: MicrolensImages
    thin_centre: Array
    """Image of the FAP's centre by the thin twin, relative to the microlens axis, (N, 2)."""
    thin_diameter: float
    shift: Array
    """Image centres against the thin twin's, (N, 2)."""
    widening: Array
    """Diameter over the thin twin's, less 1, (N); of what is lit where the image is folded, nan where part of the FAP's
    rim is out of the lens's sight."""
    rim_shift: Array
    """Farthest that a point of the FAP's rim is imaged from where the thin twin images it, (N); nan likewise."""
    maps: FieldMap
    lateral_colour: Array
    """Between the F and the C line on the array, (N); nan outside the glasses' range."""
    chief: tuple[str, ...]
    """What became of each chief ray."""


def real_field(design: Design, axes: Sequence[tuple[float, float]] | ArrayLike) -> RealField:
    """Microlens images and aberrations at microlenses of a design (N, 2), in its array's frame [mm]."""
    camera = camera_of(design)
    fap = camera.fap
    c = microlenses(design, axes).reshape(-1, 2)
    images = real_images(camera, c)
    middle = np.array([fap.x, fap.y])
    turns = 2 * np.pi * np.arange(images.outline.shape[-2]) / images.outline.shape[-2]
    rim = middle + fap.diameter / 2 * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    thin_centre = camera.d_2 * chief_slope(camera, c, middle)
    thin_rim = camera.d_2 * chief_slope(camera, c[:, None], rim)
    thin_diameter = fap.diameter * abs(float(camera.d_2 * chief_slope(camera, [0.0, 0.0], [1.0, 0.0])[0]))
    try:
        maps = field_map(camera, c, VISIBLE)
        colour = np.hypot(*np.moveaxis(maps.lateral_colour[:, 1] - maps.lateral_colour[:, 0], -1, 0))
    except InputError:  # a glass that is not known so far
        maps = field_map(camera, c)
        colour = np.full(len(c), math.nan)
    own = np.where(images.status == FOLDED, 2 * np.sqrt(images.area / np.pi), images.diameter)
    lost = maps.status != KEPT
    # Where part of the rim is out of the lens's sight there is no whole image; its area was set to the thin lens's.
    first_order_area = float(camera.thin_images(np.zeros(2)).area)
    guessed = lost | ((images.status == CLIPPED) & (images.whole_area == first_order_area))
    return RealField(
        c,
        images,
        thin_centre,
        thin_diameter,
        np.where(lost[:, None], math.nan, images.chief - thin_centre),
        np.where(guessed, math.nan, own / thin_diameter - 1),
        np.where(guessed, math.nan, np.max(np.hypot(*np.moveaxis(images.outline - thin_rim, -1, 0)), axis=-1)),
        maps,
        np.where(lost, math.nan, colour),
        tuple(describe(int(state)) for state in maps.status),
    )


def measured_bound(design: Design) -> tuple[float, float]:
    """Undistorted half-field measured on the traced lens, on the focal plane and on the array [mm].

    Twin of Eq. 6's bound; where parts are off axis, the least of eight directions.
    """
    camera = camera_of(design)
    centred = camera.lens.is_centred and camera.is_upright and all((rim.x, rim.y) == (0.0, 0.0) for rim in camera.rims)
    turns = [0.0] if centred else [k * math.pi / 4 for k in range(8)]
    found = [undistorted_field(camera, angle=turn) for turn in turns]
    least = min(found, key=lambda bound: float(bound.mla_radius))
    return float(least.object_radius), float(least.mla_radius)
