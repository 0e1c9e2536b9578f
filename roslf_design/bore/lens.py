"""Ideal thin lenses before the main lens: objectives, relays, field lenses."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import ValidationInfo, field_validator

from ..lenses.angles import AngleMap
from ..lenses.glass import Glass
from ..lenses.material import Material
from ..lenses.prescription import Surface
from ..lenses.tracer import LENGTH, MAPPED, THIN
from ..units import AnyLength
from ..words import length
from .element import Element, Flags, Matrix, Outline, face
from .export import SequenceRow
from .faces import KIND, TURNED, Face, Surroundings, axes_of, plane_row, vertex_of
from .mapping import COLLINEAR, AnyMapping, MappingTable, angle_map, mapping_fault
from .part import Number, PartNumbers

IMAGE = ".image"
"""After the place of an objective with a mapping: the stop that is the end of what it images."""


USUAL_INDEX = 1.5
"""Index of a lens whose material no design tells, for its field curvature."""


class FieldLens(Element):
    """An ideal thin lens before the main lens: an objective, a relay, a field lens."""

    kind: Literal["lens"]
    focal_length: AnyLength
    """Focal length [mm]; below 0 it diverges."""
    mapping: AnyMapping = COLLINEAR
    """Mapping of the foremost one, the objective: how it takes angles of the field to image heights."""
    material: Material | None = None
    """Material, as far as temperature goes; None leaves its focal length as it is."""

    number_keys: ClassVar = (*Element.number_keys, "focal_length")
    maps: ClassVar = True

    @field_validator("focal_length", mode="after")
    @classmethod
    def _bends(cls, value: float) -> float:
        if value == 0:
            raise ValueError("0 is no focal length; give one of either sign")
        return value

    @field_validator("mapping", mode="after")
    @classmethod
    def _begins(cls, value: str | MappingTable, info: ValidationInfo) -> str | MappingTable:
        focal_length = info.data.get("focal_length")  # one that could not be read is told of by itself
        if focal_length and isinstance(value, MappingTable) and (fault := mapping_fault(value, focal_length)):
            raise ValueError(fault)
        return value

    @property
    def angle_map(self) -> AngleMap:
        """Its mapping; of a table that of its focal length."""
        return angle_map(self.mapping, float(self.focal_length) if self.mapping_name == "table" else 1.0)

    @property
    def mapping_name(self) -> str:
        """Name of its mapping, "table" of a measured one."""
        if isinstance(self.mapping, MappingTable):
            return "table"
        return "" if self.mapping == COLLINEAR else self.mapping

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Every material of it by its key."""
        return (("material", self.material),)

    @property
    def grows(self) -> bool:
        """Whether its material is known."""
        return self.material is not None

    @property
    def power_sign(self) -> int:  # type: ignore[override]
        """Sign of its power."""
        return 1 if self.focal_length > 0 else -1

    def forward(self, at: PartNumbers, inside: Number, passed: Flags) -> Matrix:
        """Matrix of a thin lens."""
        return 1.0, 0.0, -np.where(passed, 1 / at["focal_length"], 0.0)[()], 1.0

    def petzval(self, at: PartNumbers) -> Number:
        """Power over the index of its material, or `USUAL_INDEX`."""
        return thin_petzval(at["focal_length"], self.material, at.wavelength)

    def faces(self, at: PartNumbers, name: str, around: Surroundings) -> list[Face]:
        """The thin lens, and behind it what its mapping makes of rays."""
        z, f = at["distance"], at["focal_length"]
        vertex, axes, opening = vertex_of(at, z), axes_of(at), f"{at.place}.0"
        row = plane_row(vertex, axes, at.get("diameter", math.inf) / 2, f)
        row[..., KIND], row[..., TURNED], row[..., 3] = THIN, 0.0, 1 / f
        faces = [Face(row, around.medium, 1.0, opening, name)]
        if self.mapping_name:
            reach, image = around.pupil_ahead(np.nextafter(z, np.inf)) - z, np.abs(f)
            bent = plane_row(vertex, axes, image * self.angle_map.end, reach)
            bent[..., KIND], bent[..., LENGTH], bent[..., TURNED], bent[..., 4] = MAPPED, reach, 0.0, image
            faces.append(Face(bent, around.medium, 1.0, f"{at.place}{IMAGE}", f"{name}, mapping"))
        return faces

    def moved(self, at: PartNumbers, before: Number, after: Number) -> dict[str, Number]:
        """Focal length, which grows with the glass and with what its index loses; a measured mapping keeps its own."""
        if self.material is None or isinstance(self.mapping, MappingTable):
            return {}
        weaker = power_ratio(self.material, at.wavelength, before, after)
        return {"focal_length": at["focal_length"] * self.material.grown(before, after) * weaker}

    def profile(self, ends: tuple[float, float], thick: float) -> list[tuple[Outline, Outline]]:
        """Two bulging or hollow faces."""
        t = np.linspace(-1, 1, 25)
        bulge = thick / 2 * (1 - t**2 if self.focal_length > 0 else 0.2 + t**2)
        return [(face(ends, -self.distance - bulge), face(ends, -self.distance + bulge))]

    def rows(self, name: str, at: float, semi: float) -> list[SequenceRow]:
        """A paraxial surface; there is none for a mapping."""
        if self.mapping_name:
            raise ValueError("a lens with a mapping")
        return [SequenceRow(name, at, Surface(0.0, semi), float(self.focal_length))]

    def words(self) -> tuple[str, ...]:
        """Focal length and mapping."""
        words = [f"f = {length(self.focal_length)}"]
        if isinstance(self.mapping, MappingTable):
            words.append(f"mapping by a table to {math.degrees(self.mapping.angles[-1]):.4g}°")
        elif self.mapping != COLLINEAR:
            words.append(f"mapping {self.mapping}")
        return tuple(words)


def thin_petzval(focal_length: Number, material: Glass | None, wavelength: Any) -> Number:
    """Petzval sum of a thin lens, of `USUAL_INDEX` where no material is told [1/mm]."""
    return 1 / (focal_length * (USUAL_INDEX if material is None else material.index(wavelength)))


def power_ratio(glass: Glass, wavelength: Any, before: Any, after: Any) -> Number:
    """Focal length of a thin lens after over before a change of temperature, for its index alone."""
    return (glass.index(wavelength, before) - 1) / (glass.index(wavelength, after) - 1)
