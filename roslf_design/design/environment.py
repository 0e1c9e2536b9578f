"""Environment of a camera: its temperature, and what that does to lengths, curvatures and indices.

One rule (`Growth.moved`) takes a camera's numbers from one temperature to another, one camera or arrays of builds.
Glass grows as glass, all between parts as the housing, wherever light meets both. Lengths of a design hold at
`Environment.reference` until it is built; built, they are those at `Environment.temperature`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, InstanceOf, PlainSerializer, field_validator

from ..bore.elements import AnyElement, element_name
from ..bore.lens import power_ratio
from ..bore.part import Number, Part, PartNumbers
from ..errors import InputError, Problem
from ..lenses.glass import ROOM, Glass, growth
from ..lenses.prescription import Prescription, lens_growth, warm_constants
from ..lenses.solid import Solid, find_solid, solid_of, solids
from ..units import Temperature
from .parts import PATHS

if TYPE_CHECKING:
    from .design import Design

REFERENCE = "environment.reference"


def _solid(value: Any) -> Solid:
    if isinstance(value, Solid):
        return value
    try:
        return solid_of(value) if isinstance(value, Mapping) else find_solid(str(value))
    except InputError as error:
        raise ValueError("; ".join(problem.message for problem in error.problems)) from None


def _written(solid: Solid) -> str | dict[str, Any]:
    if solids().get(solid.name.lower()) == solid:
        return solid.name
    return {"expansion": solid.expansion, **({} if solid.name.endswith(" /K") else {"name": solid.name})}


Housed = Annotated[InstanceOf[Solid], BeforeValidator(_solid), PlainSerializer(_written, return_type=Any)]
"""A material by its name, or as a table with its expansion [1/K]."""


class Environment(Part):
    """Where the camera is used."""

    temperature: Temperature = ROOM
    """Temperature of the whole camera and of what it looks through [degrees C]."""
    range: Annotated[tuple[Temperature, Temperature] | None, Field(default=None)]
    """Coldest and warmest that the camera meets, in use or in an autoclave [degrees C]."""
    housing: Housed | None = None
    """Housing that holds the parts apart; None does not grow."""
    sensor: Housed = solids()["silicon"]
    """Material that pixels are made on."""
    reference: Temperature = ROOM
    """At which the lengths of the file hold [degrees C]."""

    @field_validator("range", mode="after")
    @classmethod
    def _rising(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError(f"{value[0]:g} to {value[1]:g} degC does not rise; write the colder end first")
        return value

    @property
    def expansion(self) -> float:
        """Expansion of the housing [1/K]."""
        return 0.0 if self.housing is None else self.housing.expansion


def glasses_of(design: Design) -> Iterator[tuple[str, Glass | None]]:
    """Every material of a design by its place; of lenses by prescription each glass."""
    array = design.microlens_array
    yield "main_lens.material", design.main_lens.material
    yield "object_space.medium", design.object_space.medium
    yield "microlens_array.material", array.material
    if array.substrate is not None:
        yield "microlens_array.substrate.material", array.substrate.material
    if design.sensor.cover is not None:
        yield "sensor.cover.material", design.sensor.cover.material
    if design.main_lens.prescription is not None:
        yield from (("main_lens.prescription", surface.glass) for surface in design.main_lens.prescription.surfaces)
    for k, element in enumerate(design.elements):
        yield from ((f"elements.{k}.{key}", glass) for key, glass in element.glasses)


def prescriptions_of(design: Design) -> Iterator[tuple[str, Prescription]]:
    """Every lens of a design that is given by its surfaces, by its part."""
    if design.main_lens.prescription is not None:
        yield "main_lens", design.main_lens.prescription
    for k, element in enumerate(design.elements):
        if element.prescribed is not None:
            yield f"elements.{k}", element.prescribed


def about_environment(design: Design) -> tuple[Problem, ...]:
    """Temperatures that what is known of a material does not reach."""
    environment, problems = design.environment, []
    if environment is None:
        return ()
    asked = {"temperature": environment.temperature}
    asked |= dict(zip(("range.1", "range.2"), environment.range or (), strict=False))
    for place, glass in glasses_of(design):
        for key, degrees in asked.items():
            if glass is None or glass.warming.coldest <= degrees <= glass.warming.hottest:
                continue
            known = f"{glass.warming.coldest:g} to {glass.warming.hottest:g} degC"
            message = f"{degrees:g} degC is outside what is known of {glass.name} ({place}): {known}; stay inside"
            problems.append(Problem(f"environment.{key}", message))
    return tuple(dict.fromkeys(problems))


def not_known(design: Design) -> tuple[str, ...]:
    """Names of a design's materials whose index is taken not to change with temperature."""
    glasses = (glass for _, glass in glasses_of(design) if glass is not None and glass.name != "air")
    return tuple(dict.fromkeys(glass.name for glass in glasses if glass.warming.law == "none"))


def not_named(design: Design) -> tuple[str, ...]:
    """Names of the parts that stay as they are at any temperature, because no material is given for them."""
    environment, array, lens = design.environment, design.microlens_array, design.main_lens
    silent = {
        "the housing": environment is None or environment.housing is None,
        "the main lens": lens.prescription is None and lens.material is None,
        "the microlenses": array.material is None and array.substrate is None,
    }
    silent |= {element_name(element, k): not element.grows for k, element in enumerate(design.elements, 1)}
    return tuple(name for name, is_silent in silent.items() if is_silent)


@dataclass(frozen=True)
class Growth:
    """Materials of a camera's parts, by which it grows with temperature."""

    housing: float
    """Its expansion [1/K]."""
    sensor: float
    """Expansion of what pixels are made on [1/K]."""
    lens: Glass | Prescription | None
    """The main lens: what an ideal one is made of, or its surfaces."""
    array: Glass | None
    """Material of the microlenses; None where not given."""
    elements: tuple[AnyElement, ...]
    lenslets: str
    glasses: tuple[tuple[str, Glass], ...]
    """Glass of each index, by the index's place."""

    @classmethod
    def of(cls, design: Design, materials: Mapping[str, Glass]) -> Growth | None:
        """Growth of a design, given the materials of its indices by place; None of one without `[environment]`."""
        environment, substrate = design.environment, design.microlens_array.substrate
        if environment is None:
            return None
        array = design.microlens_array.material or (None if substrate is None else substrate.material)
        return cls(
            environment.expansion,
            environment.sensor.expansion,
            design.main_lens.material if design.lens is None else design.lens,
            array,
            design.elements,
            "scene" if substrate is None else substrate.lenslets,
            tuple(materials.items()),
        )

    def moved(
        self, numbers: Mapping[str, Number], before: Number, after: Number, *, lens_stays: bool = False
    ) -> dict[str, Number]:
        """The numbers that change between two temperatures.

        Parameters
        ----------
        numbers : mapping
            Dotted place to number(s), at the first temperature.
        before, after : float or ndarray
            [degrees C].
        lens_stays : bool
            Whether distances go on counting from the principal planes that a real lens had before.
        """
        wavelength, housing = numbers[PATHS["wavelength"]], growth(self.housing, before, after)
        front, rear = _principal_shifts(self.lens, wavelength, before, after, self.housing)
        spans = list(self._spans(numbers, before, after, housing))

        def stretched(z: Number) -> Number:
            """Distance from the lens's first vertex, from that."""
            return housing * z + sum(more * np.clip(z - start, 0.0, length) for start, length, more in spans)

        def before_lens(z: Number) -> Number:
            return stretched(z - front[0]) + front[0 if lens_stays else 1]

        def behind(length: Number, plates: tuple[str, ...]) -> Number:
            more = sum(
                (glasses[plate].grown(before, after) - housing) * numbers[f"{plate}.thickness"]
                for plate in plates
                if plate in glasses
            )
            return housing * length + more

        glasses = {place.removesuffix(".index"): glass for place, glass in self.glasses}
        substrate, cover = "microlens_array.substrate", "sensor.cover"
        sensor = growth(self.sensor, before, after)
        result: dict[str, Number] = {}
        for place, value in numbers.items():
            part, name = place.rsplit(".", 1) if "." in place else (place, "")
            kind = part.split(".", 1)[0]
            if place == PATHS["d_1"]:
                glass = (substrate,) if self.lenslets == "sensor" else ()
                result[place] = behind(value - rear[0], glass) + rear[1] - (rear[2] if lens_stays else 0.0)
            elif place == PATHS["d_2"]:
                result[place] = behind(value, (cover,) if self.lenslets == "sensor" else (substrate, cover))
            elif place in (PATHS["d"], PATHS["f_ml"]) or part == "microlens_array.size":
                if self.array is not None:
                    grows = self.array.grown(before, after)
                    weaker = power_ratio(self.array, wavelength, before, after) if place == PATHS["f_ml"] else 1.0
                    result[place] = value * grows * weaker
            elif place == PATHS["q"] or part == "sensor.size":
                result[place] = value * sensor
            elif place == PATHS["f"]:
                if isinstance(self.lens, Glass):
                    result[place] = (
                        value * self.lens.grown(before, after) * power_ratio(self.lens, wavelength, before, after)
                    )
                elif self.lens is not None:
                    result[place] = warm_constants(self.lens, wavelength, after, self.housing).focal_length
            elif name == "distance" and kind in ("aperture", "stops", "elements"):
                result[place] = before_lens(value)
            elif name == "thickness":
                result[place] = value * glasses[part].grown(before, after) if part in glasses else value
            elif name == "index" and part in glasses:
                glass_in = glasses[part]
                result[place] = value + (glass_in.index(wavelength, after) - glass_in.index(wavelength, before))
            elif place == PATHS["D"] and self.lens is not None:
                result[place] = value * _wider(self.lens, before, after, self.housing)
            elif name == "diameter" or part.endswith("decentre") or kind in ("tube", "tip"):
                result[place] = value * housing
        for k, element in enumerate(self.elements):
            at = PartNumbers(numbers, f"elements.{k}", self.housing)
            result |= {f"{at.place}.{key}": value for key, value in element.moved(at, before, after).items()}
        return {place: value[()] if isinstance(value, np.ndarray) else value for place, value in result.items()}

    def _spans(
        self, numbers: Mapping[str, Number], before: Number, after: Number, housing: Number
    ) -> Iterator[tuple[Number, Number, Number]]:
        """Elements: where each begins, its length, and how much more it grows than the housing."""
        for k, element in enumerate(self.elements):
            at = PartNumbers(numbers, f"elements.{k}", self.housing)
            length, times = element.lengthened(at, before, after)
            yield at["distance"], length, times - housing


def _wider(lens: Glass | Prescription, before: Number, after: Number, housing: float) -> Number:
    """Clear diameter of a lens after over before: of one by its surfaces, that of the narrowest."""
    if isinstance(lens, Glass):
        return lens.grown(before, after)
    k = min(range(len(lens.surfaces)), key=lambda k: lens.surfaces[k].semi_diameter)
    old, new = (lens_growth(lens, at, housing)[k][0] for at in (before, after))
    return new / old


def _principal_shifts(
    lens: Glass | Prescription | None, wavelength: Number, before: Number, after: Number, housing: float
) -> tuple[tuple[Number, Number], tuple[Number, Number, Number]]:
    """Where a lens's principal planes stand, before and after.

    The front one behind the first vertex, the rear one before the last; then by how much less the rear one stands
    behind the first.
    """
    if not isinstance(lens, Prescription):
        return (0.0, 0.0), (0.0, 0.0, 0.0)
    a, b = (warm_constants(lens, wavelength, at, housing) for at in (before, after))
    rear = a.length - a.rear_principal, b.length - b.rear_principal
    return (a.front_principal, b.front_principal), (*rear, a.rear_principal - b.rear_principal)
