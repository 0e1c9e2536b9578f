"""Glass between two flat faces: windows, and prisms unfolded into blocks."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from .._arrays import Array
from ..lenses.glass import Glass
from ..lenses.material import Material
from ..lenses.prescription import Surface, rotation
from ..units import Angle, Length
from ..words import length
from .element import Element, Flags, Matrix, degrees
from .export import SequenceRow
from .faces import Face, Surroundings, axes_of, plane_row, vertex_of
from .part import Number, PartName, PartNumbers, Tilt


def glass_rows(name: str, at: float, thickness: float, glass: Glass, semi: float) -> list[SequenceRow]:
    """Rows of flat glass whose sensor's side stands at a place behind the main lens's reference plane [mm]."""
    return [
        SequenceRow(f"{name}, front", at - thickness, Surface(0.0, semi, glass=glass)),
        SequenceRow(f"{name}, back", at, Surface(0.0, semi)),
    ]


class Block(Element):
    """Glass between two flat faces."""

    thickness: Length
    """Thickness along the axis [mm]; of a prism the axis's whole way through the glass."""
    material: Material
    """Glass."""
    wedge: Tilt = (0.0, 0.0)
    """Wedge: tilt of the sensor-side face out of parallel [rad]."""

    number_keys: ClassVar = (*Element.number_keys, "thickness")
    poses: ClassVar = (*Element.poses, "wedge")
    bends: ClassVar = False
    seals: ClassVar = True

    @property
    def glass(self) -> Glass:
        """Material of its index."""
        return self.material

    def forward(self, at: PartNumbers, inside: Number, passed: Flags) -> Matrix:
        """Matrix of a reduced thickness."""
        return 1.0, inside / at["index"], 0.0, 1.0

    def kick(self, at: PartNumbers, axis: int) -> Number:
        """Index times slope that a wedge adds."""
        return (at["index"] - 1) * at.pair("wedge")[1 - axis] * (1 if axis == 0 else -1)

    def faces(self, at: PartNumbers, name: str, around: Surroundings) -> list[Face]:
        """Both faces; a wedge turns the one on the sensor's side."""
        z, index, thick = at["distance"], at["index"], np.asarray(self.span(at), float)
        radius, vertex, axes = at.get("diameter", math.inf) / 2, vertex_of(at, z), axes_of(at)
        near = plane_row(vertex, axes @ rotation(*at.pair("wedge")), radius)
        far = plane_row(vertex - thick[..., None] * axes[..., :, 2], axes, radius)
        return [
            Face(near, index, 1.0, f"{at.place}.0", f"{name}, back"),
            Face(far, around.medium, index, f"{at.place}.1", f"{name}, front"),
        ]

    def rows(self, name: str, at: float, semi: float) -> list[SequenceRow]:
        """Rows of both faces."""
        return glass_rows(name, at, self.thickness, self.material, semi)

    def words(self) -> tuple[str, ...]:
        """Thickness and material."""
        return (f"{length(self.thickness)} of {self.material.name}",)

    def reflects(self, wavelength: float, beyond: float) -> tuple[str, float] | None:
        """Key and angle of the face that totally reflects light along the axis: turned too far for its glass."""
        if not any((*self.tilt, *self.wedge)):
            return None
        glass, own = float(self.material.index(wavelength)), rotation(*self.tilt)
        way = np.array([0.0, 0.0, -1.0])
        for normal, before, behind in (((own @ rotation(*self.wedge))[:, 2], 1.0, glass), (own[:, 2], glass, beyond)):
            ratio, cosine = before / behind, -float(way @ normal)
            square = 1 - ratio**2 * (1 - cosine**2)
            if cosine <= 0 or square < 0:
                return "wedge" if any(self.wedge) else "tilt", degrees(cosine)
            way = ratio * way + (ratio * cosine - math.sqrt(square)) * normal
        return None


class Plate(Block):
    """A plane-parallel plate: a window, or a rod where it is longer than wide."""

    kind: Literal["plate"]
    part: PartName | None = None
    """Window in the catalogue that gives what is left out of thickness, material and diameters; as `sensor.part`."""
    outer_diameter: Length | None = None
    """Diameter of the whole window with its edge, which a tube must hold [mm]; None: its `diameter`."""

    catalogue: ClassVar = ("windows",)
    number_keys: ClassVar = (*Block.number_keys, "outer_diameter")

    @property
    def trade_name(self) -> str:  # type: ignore[override]
        """Name that makers know it by."""
        return "rod" if self.diameter is not None and self.length > self.diameter else "window"


class Prism(Block):
    """A prism, unfolded into a block."""

    kind: Literal["prism"]
    deviation: Angle = 0.0
    """Angle by which it turns the axis, for the drawing and the direction of view [rad]."""
    azimuth: Angle = 0.0
    """Direction across the axis into which it turns the view, from x towards y [rad]."""
    reflections: Annotated[int, Field(strict=True, ge=0)] = 0
    """How often light is reflected in it; an odd number reverses pictures."""

    @property
    def turn(self) -> float:  # type: ignore[override]
        """Angle by which it turns the axis [rad]."""
        return float(self.deviation)

    @property
    def towards(self) -> float:  # type: ignore[override]
        """Direction into which it turns the view, across the axis from x towards y [rad]."""
        return float(self.azimuth)

    @property
    def bounces(self) -> int:  # type: ignore[override]
        """How often light is reflected in it."""
        return self.reflections

    def block_reach(self, at: PartNumbers) -> Number:
        """Corners of both faces, as wide and as high as the clear aperture; by more reflections it is of any shape."""
        if not self.turn or self.reflections > 1:
            return 0.0
        half, turn = at.get("diameter", 0.0) / 2, self.turn
        beside = self.span(at) / 2 * math.sin(turn) + half * abs(math.cos(turn))
        return np.hypot(np.maximum(half, beside), half)

    @property
    def shortest(self) -> float:  # type: ignore[override]
        """Least path through a prism of one reflection whose faces are as wide as its clear aperture [mm]."""
        if self.reflections != 1 or not 0 < self.turn < math.pi or self.diameter is None:
            return 0.0
        half = math.tan(self.turn / 2)
        return self.diameter * max(half, 1 / half)

    def incidence(self, wavelength: float, sines: Array) -> tuple[float, float] | None:
        """Least angle by one reflection, whose face halves the angle between both parts of the axis."""
        if self.reflections != 1 or not self.deviation:
            return None
        index = float(self.material.index(wavelength))
        x, y = np.moveaxis(sines, -1, 0) / index
        across, along = math.cos(self.deviation / 2), math.sin(self.deviation / 2)
        cosine = along * np.sqrt(1 - x * x - y * y) - across * (math.cos(self.azimuth) * x + math.sin(self.azimuth) * y)
        return degrees(float(np.abs(cosine).max())), math.degrees(math.asin(1 / index))

    def words(self) -> tuple[str, ...]:
        """Thickness and material, and the deviation."""
        turns = (f"turns by {math.degrees(self.deviation):.4g}°",) if self.deviation else ()
        return (*super().words(), *turns)
