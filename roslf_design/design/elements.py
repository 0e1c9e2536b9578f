"""What stands in object space before the main lens: windows, prisms, lenses, rods, liquids.

An element's `distance` is that of its sensor-side vertex from the main lens, as measured with a ruler. Flat faces are
perpendicular to the axis unless tilted or wedged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, StrictBool, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from ..errors import Problem
from ..lenses.angles import Law
from ..lenses.glass import AIR
from ..lenses.prescription import Prescription, rotation
from ..units import Angle, AnyLength, Distance, Gradient, Length
from ..words import length
from .check import shown, stop_beyond_focus
from .mapping import COLLINEAR, AnyMapping, MappingTable, mapping_fault, mapping_law
from .material import Material
from .parts import Offset, Part, Tilt
from .real_lens import Lens, mounted_lens

if TYPE_CHECKING:
    from .design import Design


class Element(Part):
    """Something transparent before the main lens."""

    distance: Distance
    """Main lens to the sensor-side vertex [mm]."""
    diameter: Length | None = None
    """Clear aperture, of both faces [mm]; None lets everything through."""
    decentre: Offset = (0.0, 0.0)
    """Offset from the axis [mm]."""
    tilt: Tilt = (0.0, 0.0)
    """About the sensor-side vertex [rad]."""

    @property
    def length(self) -> float:
        """From its sensor-side vertex to the one that faces the scene [mm]."""
        return float(getattr(self, "thickness", 0.0))


class Block(Element):
    """Glass between two flat faces."""

    thickness: Length
    """Along the axis [mm]; of a prism the axis's whole way through the glass."""
    material: Material
    """What it is made of."""
    wedge: Tilt = (0.0, 0.0)
    """How far its sensor-side face is turned out of parallel [rad]."""


class Plate(Block):
    """A plane-parallel plate: a window."""

    kind: Literal["plate"]


class Prism(Block):
    """A prism, unfolded into a block."""

    kind: Literal["prism"]
    deviation: Angle = 0.0
    """By how much it turns the axis, for the drawing and the direction of view [rad]."""


class FieldLens(Element):
    """An ideal thin lens before the main lens: an objective, a relay, a field lens."""

    kind: Literal["lens"]
    focal_length: AnyLength
    """[mm]; below 0 it diverges."""
    mapping: AnyMapping = COLLINEAR
    """Of the foremost one, the objective: how it takes angles of the field to image heights."""
    material: Material | None = None
    """What it is made of, as far as temperature goes; None leaves its focal length what it is."""

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
    def law(self) -> Law | None:
        """Its mapping for kernels; None of f tan."""
        return mapping_law(self.mapping, float(self.focal_length) if isinstance(self.mapping, MappingTable) else 1.0)


class Grin(Element):
    """A gradient-index rod with flat faces, ``n(r) = n_0 (1 - g^2 r^2/2)``."""

    kind: Literal["grin"]
    thickness: Length
    """Its length [mm]; a quarter pitch is pi/(2 g)."""
    index: Annotated[float, Field(ge=1, lt=5)]
    """n_0, on its axis."""
    gradient: Gradient
    """g [1/mm]."""


class LensGroup(Element):
    """A real objective or relay by its prescription; its first order counts."""

    kind: Literal["prescription"]
    prescription: Lens
    """A lens that ships, a lens file, or the lens as a table."""
    reversed: StrictBool = False
    """Whether it stands the other way round than its prescription says."""

    @property
    def lens(self) -> Prescription:
        """As it stands in the camera."""
        assert self.prescription is not None
        return mounted_lens(self.prescription, self.reversed, self.diameter)

    @property
    def length(self) -> float:
        """From vertex to vertex [mm]."""
        return self.lens.length

    @field_validator("prescription", mode="after")
    @classmethod
    def _given(cls, value: Prescription | None) -> Prescription:
        if value is None:
            raise PydanticCustomError("missing", "Field required")
        return value


AnyElement = Annotated[Plate | Prism | FieldLens | Grin | LensGroup, Field(discriminator="kind")]
"""One of `[[elements]]`."""


class ObjectSpace(Part):
    """What the scene lies in."""

    medium: Material = AIR
    """In front of the farthest element, which seals it off."""


def element_name(element: AnyElement, number: int) -> str:
    """What it is called; its rims are "plate 1, front" and "plate 1, back"."""
    return f"{element.kind} {number}"


def made_of(element: AnyElement) -> tuple[str, ...]:
    """What it is, in a few words each: size and material, focal length, deviation."""
    if isinstance(element, Block):
        words = [f"{length(element.thickness)} of {element.material.name}"]
    elif isinstance(element, FieldLens):
        words = [f"f = {length(element.focal_length)}"]
        if isinstance(element.mapping, MappingTable):
            words.append(f"mapping by a table to {math.degrees(element.mapping.angles[-1]):.4g}°")
        elif element.mapping != COLLINEAR:
            words.append(f"mapping {element.mapping}")
    elif isinstance(element, Grin):
        words = [f"{length(element.thickness)}, n_0 {element.index:g}", f"g = {element.gradient:.5g} /mm"]
    else:
        words = [element.lens.name or "by its prescription"]
    if isinstance(element, Prism) and element.deviation:
        words.append(f"turns by {math.degrees(element.deviation):.4g}°")
    return (*words, f"diameter {length(element.diameter)}") if element.diameter is not None else tuple(words)


def about_elements(design: Design, known: Sequence[Problem]) -> tuple[Problem, ...]:
    """What elements contradict: each other, stops, the focal plane; `known` are the faults that there are already."""
    spans = [(f"elements.{k}", e.distance, e.distance + e.length) for k, e in enumerate(design.elements)]
    problems = []
    if not spans and design.object_space.medium != AIR:
        name = design.object_space.medium.name
        message = (
            f"nothing keeps {name} from the main lens; add the window that seals it off to [[elements]], or drop it"
        )
        problems.append(Problem("object_space.medium", message))
    ordered = sorted(spans, key=lambda span: span[1:])
    for (_, near, far), (place, start, _) in pairwise(ordered):
        if start < far:
            message = (
                f"{shown(start)} lies inside the element that reaches from {shown(near)} to {shown(far)}; move one"
            )
            problems.append(Problem(f"{place}.distance", message))
    stops = {"aperture": design.aperture, **{f"stops.{k}": stop for k, stop in enumerate(design.stops)}}
    for place, stop in stops.items():
        for element, near, far in spans:
            if near < stop.distance < far:
                span = f"{element}, from {shown(near)} to {shown(far)}"
                problems.append(Problem(f"{place}.distance", f"{shown(stop.distance)} lies inside {span}; move it out"))
    problems += [*([] if known else _about_reflection(design)), *_about_mapping(design)]
    if problems or known:
        return tuple(problems)
    substrate, behind = design.microlens_array.substrate, design.sensor.cover
    plates = [0.0 if plate is None else plate.thickness for plate in (substrate, behind)]
    before = substrate is not None and substrate.lenslets == "sensor"
    for place, room, glass in (
        ("microlens_array.distance", design.d_1, plates[0] if before else 0.0),
        ("sensor.distance", design.d_2, plates[1] if before else sum(plates)),
    ):
        if glass > room * (1 + 1e-9):
            message = (
                f"{shown(room)} does not hold the {shown(glass)} of glass in it; lengthen it or take thinner glass"
            )
            problems.append(Problem(place, message))
    d_f, tip = design.d_f, max([far for *_, far in spans], default=0.0)
    if not tip <= d_f < math.inf:
        message = f"{shown(d_f)} is not in front of the farthest element, which ends at {shown(tip)}; focus farther out"
        problems.append(Problem("main_lens.focal_plane", message))
    for place, stop in stops.items():
        if stop.distance >= d_f:
            problems.append(stop_beyond_focus(f"{place}.distance", stop.distance, d_f))
    return tuple(problems)


def _about_reflection(design: Design) -> list[Problem]:
    """Blocks that the axis itself does not get through: turned so far that their glass reflects it totally."""
    problems = []
    farthest = max((element.distance for element in design.elements), default=0.0)
    for number, block in enumerate(design.elements):
        if not isinstance(block, Block) or not any((*block.tilt, *block.wedge)):
            continue
        glass = float(block.material.index(design.wavelength))
        beyond = float(design.object_space.medium.index(design.wavelength)) if block.distance == farthest else 1.0
        own = rotation(*block.tilt)
        way = np.array([0.0, 0.0, -1.0])
        for normal, before, behind in (((own @ rotation(*block.wedge))[:, 2], 1.0, glass), (own[:, 2], glass, beyond)):
            ratio, cosine = before / behind, -float(way @ normal)
            square = 1 - ratio**2 * (1 - cosine**2)
            if cosine <= 0 or square < 0:
                angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
                name = element_name(block, number + 1)
                message = (
                    f"light along the axis is totally reflected in {name}, which it would leave "
                    f"at {angle:.3g} degrees from the normal; take less wedge or tilt, or glass of a lower index"
                )
                problems.append(Problem(f"elements.{number}.{'wedge' if any(block.wedge) else 'tilt'}", message))
                break
            way = ratio * way + (ratio * cosine - math.sqrt(square)) * normal
    return problems


def _about_mapping(design: Design) -> list[Problem]:
    """What stands before an objective with a mapping: flat glass and the FAP may, other openings and lenses not."""
    problems = []
    for number, lens in enumerate(design.elements):
        if not isinstance(lens, FieldLens) or lens.law is None:
            continue
        key = f"elements.{number}.mapping"
        for other, element in enumerate(design.elements):
            if element.distance <= lens.distance:
                continue
            if not isinstance(element, Block):
                message = (
                    f"only the foremost lens maps angles, and elements.{other} ({element.kind}) stands before it; "
                    "give the mapping to that, or drop it"
                )
                problems.append(Problem(key, message))
            elif element.diameter is not None:
                message = (
                    f"{shown(element.diameter)} would cut rays before the lens with a mapping, where its first order "
                    f"does not tell their heights; drop it, or the mapping of elements.{number}"
                )
                problems.append(Problem(f"elements.{other}.diameter", message))
        for other, stop in enumerate(design.stops):
            if stop.distance > lens.distance:
                message = (
                    f"{shown(stop.distance)} is before the lens with a mapping, where only the FAP may stand; move it "
                    f"behind, or drop the mapping of elements.{number}"
                )
                problems.append(Problem(f"stops.{other}.distance", message))
        if design.aperture.distance > lens.distance and design.aperture.tilt != (0.0, 0.0):
            message = (
                f"a FAP before the lens with a mapping cannot be tilted; drop it, or the mapping of elements.{number}"
            )
            problems.append(Problem("aperture.tilt", message))
    return problems
