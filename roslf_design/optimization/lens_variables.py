"""Variables of a real main lens: thicknesses, air gaps and radii; the bending and focal length of a custom lens.

A custom lens is a spherical singlet or cemented doublet. Bent, every curvature grows by the same amount, which to first
order leaves the power of each of its glasses as it is. Then all are scaled together until the focal length is the one
wanted; glasses, thicknesses and clear diameters stay.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..lenses.glass import AIR, Glass
from ..lenses.manufacture import HEIGHTS, as_made
from ..lenses.prescription import Prescription, abcd, sag
from ..tolerancing.places import LENS, in_lens

BENDING = "main_lens.bending"
"""Shape factor (R_2 + R_1)/(R_2 - R_1) of the outer surfaces, as the lens stands in the camera, scene first."""
FOCAL = CONJUGATES[0]
OWN = re.compile(r"main_lens\.surfaces\.\d+\.(radius|thickness)")
"""Places of a lens's drawing that may vary."""
NEWTON = 12
"""Steps from a thin lens's scale to the thick one's."""
STEEPEST = 0.98
"""Largest ratio of clear semi-diameter to radius of a surface."""


def varies_lens(place: str) -> bool:
    """Whether a variable is of a real lens itself."""
    return place in (BENDING, FOCAL) or OWN.fullmatch(place) is not None


def places_that_vary(lens: Prescription) -> tuple[str, ...]:
    """Names of variables of a lens itself, whether or not all go with it (`lens_faults`)."""
    numbers = range(1, len(lens.surfaces) + 1)
    return (BENDING, *(f"{LENS}surfaces.{k}.{what}" for k in numbers for what in ("radius", "thickness")))


def why_not_bent(lens: Prescription) -> str | None:
    """Reason why a lens is no singlet or cemented doublet of spheres; None where it is one."""
    pieces, surfaces = len(lens.elements), len(lens.surfaces)
    if pieces > 1 or surfaces not in (2, 3):
        return f"it has {pieces} element{'s' if pieces > 1 else ''} of {surfaces} surfaces"
    if any(s.conic or any(s.asphere) for s in lens.surfaces) or not lens.is_centred:
        return "its surfaces are not centred spheres"
    if lens.surfaces[0].curvature == lens.surfaces[-1].curvature:
        return "its outer surfaces have the same radius, and no shape factor"
    return None


def lens_faults(lens: Prescription, names: Collection[str]) -> Iterator[str]:
    """Faults of variables (dotted places) of a real lens."""
    own, shaped = sorted(n for n in names if in_lens(n)), sorted({BENDING, FOCAL} & set(names))
    for name in own:
        number, what = int(name.split(".")[2]), name.rpartition(".")[2]
        if what == "thickness" and number == len(lens.surfaces):
            yield f"'{name}' is of the last surface, behind which nothing follows; drop it"
        elif what == "radius" and number <= len(lens.surfaces) and not lens.surfaces[number - 1].curvature:
            yield f"'{name}' is of a plane, which has no radius to vary; bend the lens instead"
    wrong = why_not_bent(lens) if shaped else None
    if wrong is not None:
        is_focal = shaped == [FOCAL]
        what = (
            "'f' is the real lens's own" if is_focal else f"'{BENDING}' is for spherical singlets and cemented doublets"
        )
        yield f"{what} ({lens.name}: {wrong}); drop it, or vary its air gaps or radii"
    radii = [name for name in own if name.endswith("radius")]
    if radii and shaped:
        yield f"'{shaped[0]}' sets every radius, and '{radii[0]}' varies too; drop one of them"


class VariedLens(NamedTuple):
    """Builds of a lens, numbers or arrays of any one shape; lengths along z from the first vertex [mm]."""

    places: dict[str, Array]
    """Place of the drawing, after ``main_lens.``, to its numbers."""
    focal_length: Array
    front_principal: Array
    rear_principal: Array
    front: Array
    rear: Array
    """Foremost and hindmost point on the axis or at the rims."""
    rooms: dict[str, Array]
    """Clearances that must not be below 0, by label."""


@dataclass(frozen=True)
class LensVariation:
    """How variables change a lens as it stands in the camera."""

    lens: Prescription
    wavelength: float
    """At which its focal length is told [mm]."""
    focal_length: float
    """Focal length that a bent lens keeps where it does not vary [mm]."""

    @cached_property
    def _media(self) -> list[float]:
        return [1.0, *(float(surface.glass.index(self.wavelength)) for surface in self.lens.surfaces)]

    def at(self, values: Mapping[str, Any]) -> VariedLens:
        """The lens at values of what varies (`varies_lens`; the rest is as drawn), which broadcast together."""
        surfaces, places = self.lens.surfaces, {}
        shape = np.broadcast_shapes(*(np.shape(value) for place, value in values.items() if varies_lens(place)))
        bends = [np.full(shape, surface.curvature) for surface in surfaces]
        gaps = [np.full(shape, surface.thickness) for surface in surfaces]
        for place, value in values.items():
            if OWN.fullmatch(place):
                number, own = int(place.split(".")[2]) - 1, place.removeprefix(LENS)
                places[own] = np.broadcast_to(np.asarray(value, float), shape)
                if own.endswith("radius"):
                    bends[number] = 1 / places[own]
                else:
                    gaps[number] = places[own]
        if BENDING in values or FOCAL in values:
            step = bends[0] - bends[-1]
            factor = values.get(BENDING, (bends[0] + bends[-1]) / step)
            bends = [bend + (factor * step - bends[0] - bends[-1]) / 2 for bend in bends]
            scale = self._scale(bends, gaps, 1 / np.asarray(values.get(FOCAL, self.focal_length)))
            bends = [bend * scale for bend in bends]
            places |= {f"surfaces.{k}.curvature": bend for k, bend in enumerate(bends, 1)}
        outer = [
            bend + surface.vertex_curvature - surface.curvature for bend, surface in zip(bends, surfaces, strict=True)
        ]
        a, _, c, d = abcd(outer, gaps, self._media)
        with np.errstate(divide="ignore"):
            focal = np.asarray(-1 / c)
        length = sum(gaps[:-1], np.zeros(shape))
        with np.errstate(invalid="ignore"):
            rims = [
                sag(np.asarray(surface.semi_diameter**2), bend, 1 + surface.conic, surface.asphere)
                for bend, surface in zip(bends, surfaces, strict=True)
            ]
        ends = np.fmin(0.0, rims[0]), length + np.fmax(0.0, rims[-1])
        rooms = dict(self._rooms(bends, gaps)) if values else {}
        return VariedLens(places, focal, (1 - d) * focal, length + (a - 1) * focal, *ends, rooms)

    def _scale(self, bends: list[Array], gaps: list[Array], power: Array) -> Array:
        """Common factor of curvatures at which the thick lens has a power [1/mm].

        The power is a polynomial in it without a constant term, of as many degrees as there are surfaces.
        """
        tried = np.arange(1.0, len(bends) + 1)
        powers = np.stack([-abcd([bend * t for bend in bends], gaps, self._media)[2] for t in tried], axis=-1)
        terms = np.linalg.solve(np.stack([tried ** (k + 1) for k in range(len(tried))], axis=-1), powers[..., None])[
            ..., 0
        ]
        with np.errstate(all="ignore"):
            scale = power / terms[..., 0]
            for _ in range(NEWTON):
                value, slope = np.zeros_like(scale), np.zeros_like(scale)
                for k in range(len(tried) - 1, -1, -1):
                    slope = slope * scale + (k + 1) * terms[..., k]
                    value = (value + terms[..., k]) * scale
                scale = scale - (value - power) / slope
        return np.asarray(scale)

    def _rooms(self, bends: list[Array], gaps: list[Array]) -> Iterator[tuple[str, Array]]:
        """Rims that are not a hemisphere's, and glass and air that do not run out before the rims."""
        surfaces, held = self.lens.surfaces, list(bends)
        for k, (bend, surface) in enumerate(zip(bends, surfaces, strict=True)):
            steep = bend * surface.semi_diameter
            if 1 + surface.conic > 0:
                most = STEEPEST / np.sqrt(1 + surface.conic)
                yield f"the lens's surface {k + 1} less than a hemisphere", most - np.abs(steep)
                held[k] = np.clip(steep, -most, most) / surface.semi_diameter
        for k, (front, rear) in enumerate(pairwise(range(len(surfaces))), 1):
            one, other = surfaces[front], surfaces[rear]
            semi, what = min(one.semi_diameter, other.semi_diameter), "glass" if one.glass != AIR else "air"
            heights = np.square(HEIGHTS * semi)[:, *[None] * np.ndim(gaps[front])]
            front_sag = sag(heights, held[front], 1 + one.conic, one.asphere)
            room = gaps[front] + sag(heights, held[rear], 1 + other.conic, other.asphere) - front_sag
            yield f"{what} behind the lens's surface {k} up to its rim", np.min(room, axis=0) / semi

    def prescription(self, values: Mapping[str, float]) -> Prescription:
        """The lens at one value of each variable, as a drawing of its own."""
        varied = self.at(values)
        return as_made(self.lens, {place: float(number) for place, number in varied.places.items()}, self.wavelength)


def with_glasses(lens: Prescription, glasses: Collection[Glass], wavelength: float) -> Prescription:
    """A spherical singlet or cemented doublet of other glasses, its curvatures scaled so that its focal length stays.

    Raises
    ------
    InputError
        The lens cannot be made of these: its glass runs out, or they have no index at the wavelength [mm].
    """
    before = LensVariation(lens, wavelength, 1.0).at({}).focal_length
    changed = [replace(s, glass=glass) for s, glass in zip(lens.surfaces, (*glasses, AIR), strict=True)]
    made = LensVariation(replace(lens, surfaces=tuple(changed)), wavelength, float(before))
    return made.prescription({FOCAL: float(before)})
