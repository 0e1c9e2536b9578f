"""What a lens's manufacture does to a light-field camera: radii, thicknesses, indices, decentres and tilts missed.

Places are named as on a drawing, from 1 at the scene: ``surfaces.1.radius``, ``surfaces.1.thickness``,
``surfaces.1.index``, ``elements.1.decentre`` (along x), ``elements.1.tilt`` (about y, in the meridional plane of
fields along x). The camera around the lens stays where the nominal lens focused it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..errors import Problem
from .camera import LensCamera
from .glass import AIR
from .images import FULL, real_images
from .of_design import camera_of, microlenses
from .perturb import decentred, tilted, with_index_error, with_radius_error, with_thickness_error
from .prescription import LensError, Prescription

Array = NDArray[np.float64]


def lens_places(lens: Prescription) -> dict[str, str]:
    """Everything that the making of a lens can miss, with what it measures: "length", "ratio" or "angle"."""
    found = {}
    last = len(lens.surfaces)
    for number, surface in enumerate(lens.surfaces, start=1):
        if surface.curvature:
            found[f"surfaces.{number}.radius"] = "length"
        if number < last:
            found[f"surfaces.{number}.thickness"] = "length"
        if surface.glass != AIR:
            found[f"surfaces.{number}.index"] = "ratio"
    for number in range(1, len(lens.elements) + 1):
        found |= {f"elements.{number}.decentre": "length", f"elements.{number}.tilt": "angle"}
    return found


def as_made(lens: Prescription, place: str, change: float) -> Prescription:
    """The lens with one place missed by `change` [mm, rad or index].

    Raises
    ------
    LensError
        The lens has no such place (those it has are named), or the change makes it impossible.
    """
    if place not in lens_places(lens):
        known = ", ".join(lens_places(lens))
        raise LensError((Problem(place, f"is no place of {lens.name} that can be missed; there are {known}"),))
    _, number, what = place.split(".")
    which = int(number)
    if what == "decentre":
        return decentred(lens, which, change, 0.0)
    if what == "tilt":
        return tilted(lens, which, 0.0, change)
    make = {"radius": with_radius_error, "thickness": with_thickness_error, "index": with_index_error}[what]
    return make(lens, which, change)


class Missed(NamedTuple):
    """What builds do at each field, against the nominal real lens; leading axis of the builds or places."""

    shift: Array
    """Image centres' displacement [mm], (..., N, 2)."""
    growth: Array
    """Change of image diameters, as a share, (..., N)."""
    whole: NDArray[np.bool_]
    """Whether images are full, (..., N)."""


def sensitivity(
    design: Design, deviations: Mapping[str, float], axes: Sequence[tuple[float, float]]
) -> dict[str, Missed]:
    """Each place missed by its deviation alone.

    Parameters
    ----------
    design : Design
        With a real main lens.
    deviations : mapping
        Place to deviation [mm, rad or index].
    axes : sequence of (x, y)
        Microlenses on the array [mm].
    """
    camera, c = camera_of(design), microlenses(design, axes).reshape(-1, 2)
    nominal = real_images(camera, c)
    made = {place: camera.with_lens(as_made(camera.lens, place, value)) for place, value in deviations.items()}
    return {place: _missed(other, c, nominal.chief, nominal.diameter) for place, other in made.items()}


def trials(
    design: Design, deviations: Mapping[str, float], axes: Sequence[tuple[float, float]], count: int, seed: int = 0
) -> Missed:
    """Builds with every place missed at once, normally distributed with the deviations as 2 sigma.

    Parameters
    ----------
    design, deviations, axes
        As for `sensitivity`.
    count, seed : int
        Number of builds; the same seed gives the same builds.
    """
    camera, c = camera_of(design), microlenses(design, axes).reshape(-1, 2)
    nominal = real_images(camera, c)
    draws = np.random.default_rng(seed).normal(size=(count, len(deviations))) / 2
    builds = [
        _missed(camera.with_lens(lens), c, nominal.chief, nominal.diameter)
        for lens in _built(camera.lens, tuple(deviations), draws * np.array(list(deviations.values())))
    ]
    return Missed(*(np.stack(column) for column in zip(*builds, strict=True)))


def _built(lens: Prescription, places: tuple[str, ...], changes: Array) -> Iterator[Prescription]:
    for row in changes:
        made = lens
        for place, change in zip(places, row, strict=True):
            made = as_made(made, place, float(change))
        yield made


def _missed(camera: LensCamera, c: Array, chief: Array, diameter: Array) -> Missed:
    images = real_images(camera, c)
    return Missed(images.chief - chief, images.diameter / diameter - 1, images.status == FULL)
