"""A lens as it was made: radii, thicknesses, indices, decentres, tilts and wedges missed, by name.

Places are named as on a drawing of the lens as it stands in the camera, from 1 at the scene: ``surfaces.1.radius``,
``surfaces.1.thickness``, ``surfaces.1.index``, ``elements.1.decentre.0`` (along x), ``elements.1.tilt.1`` (about y).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..errors import InputError, Problem
from .camera import LensCamera
from .glass import AIR, Glass
from .images import FULL, real_images
from .of_design import camera_of, microlenses
from .perturb import (
    moved,
    surface_tilted,
    with_curvature_error,
    with_index_error,
    with_radius_error,
    with_thickness_error,
)
from .prescription import LensError, Prescription

Array = NDArray[np.float64]

D_LINE, F_LINE, C_LINE = 587.5618e-6, 486.1327e-6, 656.2725e-6
"""Wavelengths that an Abbe number is told by [mm]."""


@lru_cache(maxsize=64)
def lens_places(lens: Prescription) -> Mapping[str, str]:
    """Everything that the making of a lens can miss, with what it measures.

    Returns
    -------
    mapping
        Place to "length", "curvature", "angle", or "number" (an index, an Abbe number, a conic constant). An element's
        wedge is the tilt of its last surface about that surface's vertex; its own tilt is about the middle of its axis.
    """
    found = {}
    last = len(lens.surfaces)
    for number, surface in enumerate(lens.surfaces, start=1):
        if surface.curvature:
            found[f"surfaces.{number}.radius"] = "length"
            found[f"surfaces.{number}.conic"] = "number"
        found[f"surfaces.{number}.curvature"] = "curvature"
        if number < last:
            found[f"surfaces.{number}.thickness"] = "length"
        if surface.glass != AIR:
            found[f"surfaces.{number}.index"] = "number"
            if abbe_number(surface.glass) is not None:
                found[f"surfaces.{number}.abbe"] = "number"
        found |= _pair(f"surfaces.{number}.decentre", "length") | _pair(f"surfaces.{number}.tilt", "angle")
    for number, members in enumerate(lens.elements, start=1):
        found |= _pair(f"elements.{number}.decentre", "length") | _pair(f"elements.{number}.tilt", "angle")
        if len(members) > 1:
            found |= _pair(f"elements.{number}.wedge", "angle")
    return found


def _pair(name: str, kind: str) -> dict[str, str]:
    return {f"{name}.0": kind, f"{name}.1": kind}


@lru_cache(maxsize=256)
def abbe_number(glass: Glass) -> float | None:
    """V_d = (n_d - 1)/(n_F - n_C); None for a medium without dispersion, or whose formula does not reach the lines."""
    try:
        d, f, c = (float(glass.index(line)) for line in (D_LINE, F_LINE, C_LINE))
    except InputError:
        return None
    return (d - 1) / (f - c) if f > c else None


def lens_values(lens: Prescription, wavelength: float) -> dict[str, float]:
    """The lens's number at every place of `lens_places` [mm, 1/mm, rad or none]; misalignments count from as drawn."""
    found = {}
    for place in lens_places(lens):
        part, number, what = place.split(".")[:3]
        surface = lens.surfaces[int(number) - 1] if part == "surfaces" else None
        value = 0.0
        if surface is not None and what in ("radius", "curvature", "thickness", "conic"):
            value = float(getattr(surface, what))
        elif surface is not None and what == "index":
            value = float(surface.glass.index(wavelength))
        elif surface is not None and what == "abbe":
            value = abbe_number(surface.glass) or 0.0
        found[place] = value
    return found


def as_made(lens: Prescription, values: Mapping[str, float], wavelength: float) -> Prescription:
    """The lens with some places at other values than drawn.

    Parameters
    ----------
    lens : Prescription
        As drawn.
    values : mapping
        Place to value [mm, 1/mm, rad or none].
    wavelength : float
        At which indices are told [mm].

    Raises
    ------
    LensError
        The lens has no such place (those it has are named), or the values make it impossible.

    Notes
    -----
    Whatever the order given: first shapes, thicknesses and glasses, then surfaces' own decentres, tilts and wedges,
    then each element's decentre and tilt.
    """
    drawn = lens_values(lens, wavelength)
    unknown = [place for place in values if place not in drawn]
    if unknown:
        known = ", ".join(drawn)
        raise LensError((Problem(unknown[0], f"is no place of {lens.name} that can be missed; there are {known}"),))
    off = {place: value - drawn[place] for place, value in values.items()}
    made = lens
    for number in range(1, len(lens.surfaces) + 1):
        made = _surface_made(made, number, values, off, wavelength)
    for number, members in enumerate(lens.elements, start=1):
        name = f"elements.{number}"
        wedge, tilt = _two(off, f"{name}.wedge"), _two(off, f"{name}.tilt")
        if wedge != (0.0, 0.0):
            made = surface_tilted(made, members[-1] + 1, *wedge)
        made = moved(made, number, _two(off, f"{name}.decentre"), tilt)
    return made


def _surface_made(
    lens: Prescription, number: int, values: Mapping[str, float], off: Mapping[str, float], wavelength: float
) -> Prescription:
    name = f"surfaces.{number}"
    old = lens.surfaces[number - 1]
    if f"{name}.radius" in off:
        lens = with_radius_error(lens, number, off[f"{name}.radius"])
    lens = with_curvature_error(lens, number, off.get(f"{name}.curvature", 0.0))
    if f"{name}.thickness" in off:
        lens = with_thickness_error(lens, number, off[f"{name}.thickness"])
    if f"{name}.abbe" in off:
        lens = with_index_error(lens, number, dispersion_change(old.glass, values[f"{name}.abbe"], wavelength))
    if f"{name}.index" in off:
        lens = with_index_error(lens, number, off[f"{name}.index"])
    x, y = _two(off, f"{name}.decentre")
    surface = lens.surfaces[number - 1]
    aside = (surface.shift[0] + x, surface.shift[1] + y, surface.shift[2])
    surface = replace(surface, conic=surface.conic + off.get(f"{name}.conic", 0.0), shift=aside)
    lens = replace(lens, surfaces=(*lens.surfaces[: number - 1], surface, *lens.surfaces[number:]))
    return surface_tilted(lens, number, *_two(off, f"{name}.tilt"))


def dispersion_change(glass: Glass, abbe: float, wavelength: float) -> float:
    """Change of the index at a wavelength where the Abbe number is another, n_d kept: n - n_d goes like 1/V."""
    drawn = abbe_number(glass)
    assert drawn is not None
    return float(glass.index(wavelength) - glass.index(D_LINE)) * (drawn / abbe - 1)


def _two(off: Mapping[str, float], name: str) -> tuple[float, float]:
    return off.get(f"{name}.0", 0.0), off.get(f"{name}.1", 0.0)


class Missed(NamedTuple):
    """What an error does at each field, against the nominal real lens."""

    shift: Array
    """Image centres' displacement [mm], (..., N, 2)."""
    growth: Array
    """Change of image diameters, as a share, (..., N)."""
    whole: NDArray[np.bool_]
    """Whether images are full, (..., N)."""


def sensitivity(
    design: Design, deviations: Mapping[str, float], axes: Sequence[tuple[float, float]]
) -> dict[str, Missed]:
    """Each place missed by its deviation alone; the camera around the lens stays where the nominal lens focused it.

    Parameters
    ----------
    design : Design
        With a real main lens.
    deviations : mapping
        Place to deviation [mm, 1/mm, rad or none].
    axes : sequence of (x, y)
        Microlenses on the array [mm].
    """
    camera, c = camera_of(design), microlenses(design, axes).reshape(-1, 2)
    nominal = real_images(camera, c)
    drawn = lens_values(camera.lens, design.wavelength)
    made = {
        place: camera.with_lens(as_made(camera.lens, {place: drawn[place] + value}, design.wavelength))
        for place, value in deviations.items()
    }
    return {place: _missed(other, c, nominal.chief, nominal.diameter) for place, other in made.items()}


def _missed(camera: LensCamera, c: Array, chief: Array, diameter: Array) -> Missed:
    images = real_images(camera, c)
    return Missed(images.chief - chief, images.diameter / diameter - 1, images.status == FULL)
