"""Variables of a design problem: bounds and scaling, names, and what several lengths are set by together."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..camera import TIP, VIEWING_CONDITIONS, Camera, Number
from ..design import PATHS
from ..toml_files import StrictTable, nearest
from ..units import AnyLength, format_quantity
from .lens_variables import BENDING

LOG_ABOVE = 4.0
"""Ratio of bounds from which a variable is scaled by its logarithm."""
DERIVED = {
    "working_distance": "from the bore's tip (the farthest of FAP, stops and elements) to the focal plane; sets d_f",
    "tube_length": "from the FAP, the tube's inner rim, to its outer rim, the design's last stop; moves that stop",
    "tube_diameter": "of the FAP and every further stop together",
}
"""Lengths that set several places."""


class Variable(StrictTable):
    """Bounds [mm] of a length that may change: ``["0.5 mm", "8 mm"]`` for short.

    Below 0 are those of the focal length of an element that diverges, and of a FAP behind the lens.
    """

    min: AnyLength
    max: AnyLength
    start: AnyLength | None = None
    """Start of one of the searches."""
    together: dict[str, float] = Field(default_factory=dict)
    """Places that move as one, under a name of the study's own: a list, or a table of each to how many times as far;
    bounds are then of the shift from the base design, and shifts of the same place add."""
    same: tuple[str, ...] = ()
    """Places that are kept alike, under a name of the study's own: bounds are of each."""

    measured_in: ClassVar[str] = "mm"

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        if isinstance(value, (list, tuple)) and len(value) == 2:
            return {"min": value[0], "max": value[1]}
        if not isinstance(value, Mapping):
            example = '["0.5 mm", "8 mm"]' if cls.measured_in else "[-2, 2]"
            raise ValueError(f"{value!r} is no pair of bounds; write e.g. {example}")
        return value

    @field_validator("together", mode="before")
    @classmethod
    def _as_far(cls, value: Any) -> Any:
        if isinstance(value, list) and all(isinstance(place, str) for place in value):
            if twice := [place for place in value if value.count(place) > 1]:
                raise ValueError(f"names {twice[0]} twice; name it once")
            return dict.fromkeys(value, 1.0)
        return value

    @field_validator("together", "same")
    @classmethod
    def _placed(cls, value: Any, info: ValidationInfo) -> Any:
        design = (info.context or {}).get("design")
        placed = [place if design is None else design.place_named(place) for place in value]
        if twice := [place for place in placed if placed.count(place) > 1]:
            raise ValueError(f"names {twice[0]} twice; name it once")
        return dict(zip(placed, value.values(), strict=True)) if isinstance(value, dict) else tuple(placed)

    @model_validator(mode="after")
    def _tied(self) -> Variable:
        if self.together and self.same:
            raise ValueError("places move together, or are the same; keep one, and give the other a name of its own")
        if (empty := {"together", "same"} & self.model_fields_set) and not self.tied:
            raise ValueError(f'{min(empty)} names no place; name some, as ["elements.0.distance"]')
        return self

    @property
    def tied(self) -> tuple[str, ...]:
        """Places that it ties; empty of one that is a place itself."""
        return (*self.together, *self.same)

    def places(self, name: str) -> tuple[str, ...]:
        """Places that it sets under that name."""
        return self.tied or (PATHS.get(name, name),)

    @model_validator(mode="after")
    def _ordered(self) -> Variable:
        if self.measured_in == "":
            shown = f"{self.min:g}", f"{self.max:g}"
        else:
            shown = format_quantity(self.min, "length"), format_quantity(self.max, "length")
        if self.min > self.max:
            raise ValueError(f"min {shown[0]} is above max {shown[1]}: nothing lies between; did you swap them?")
        if self.measured_in and self.max == 0 and not self.together:
            raise ValueError("max must be greater than zero")
        return self

    @property
    def logarithmic(self) -> bool:
        """Whether it is scaled by its logarithm."""
        return self.min > 0 and self.max / self.min >= LOG_ABOVE

    def value(self, unit: Array) -> Array:
        """[mm] from the scaled value, 0 at the lower and 1 at the upper bound; exact at both."""
        if self.logarithmic:
            inside = self.min * np.exp(unit * math.log(self.max / self.min))
        else:
            inside = self.min + unit * (self.max - self.min)
        return np.where(unit == 1, self.max, inside)

    def unit(self, value: float) -> float:
        """Scaled value, clipped to the bounds."""
        value = min(max(value, self.min), self.max)
        if self.logarithmic:
            return math.log(value / self.min) / math.log(self.max / self.min)
        return (value - self.min) / ((self.max - self.min) or 1.0)

    def end(self, upper: bool) -> str:
        """A bound in words, e.g. ``<= 8 mm``."""
        side, limit = ("<=", self.max) if upper else (">=", self.min)
        return f"{side} {limit:.6g} {self.measured_in}".rstrip()

    def rate(self, unit: float) -> float:
        """Millimetres (or what it is counted in) per scaled unit, there."""
        if self.logarithmic:
            return float(self.value(np.asarray(unit))) * math.log(self.max / self.min)
        return self.max - self.min


class NumberVariable(Variable):
    """Bounds of a number without a unit that may change: ``[-2, 2]`` for short."""

    min: float
    max: float
    start: float | None = None

    measured_in: ClassVar[str] = ""

    @property
    def logarithmic(self) -> bool:
        """A number without a unit is never scaled by its logarithm."""
        return False


NUMBERS = (BENDING,)
"""Variables without a unit."""


def lengths_and_numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Lengths, and beside them a lens's shape factor where it varies."""
    lengths = {name: value for name, value in values.items() if name not in NUMBERS}
    return {"variables_mm": lengths} | ({"shape_factor": values[BENDING]} if BENDING in values else {})


def places_of(variables: Mapping[str, Variable]) -> set[str]:
    """All places that variables set."""
    return {place for name, variable in variables.items() for place in variable.places(name)}


def tied(variables: Mapping[str, Variable]) -> bool:
    """Whether some set several places at once."""
    return any(variable.tied for variable in variables.values())


IDLE = (".tilt.", ".wedge.", ".rotation", "microlens_array.decentre", "sensor.decentre")
"""In places that no quantity of a straight camera depends on."""


def name_faults(
    names: Sequence[str],
    numbers: Mapping[str, Number],
    own: Sequence[str] = (),
    called: Callable[[str], str] = str,
    ties: Mapping[str, Variable] = MappingProxyType({}),
) -> Iterator[str]:
    """Faults of variables' names: unknown, or setting a place twice.

    In a design with these numbers, its places `called` so, and a real lens with places of its `own`; `ties` are the
    variables that set several places.
    """
    idle = (*IDLE, ".turn", "decentre", "relay", ".index", ".gradient", "tube.", "environment.")
    built = [place for place in numbers if "." in place and place not in VIEWING_CONDITIONS]
    lengths = [place for place in built if not any(word in place for word in idle)]
    known = dict.fromkeys([*PATHS, *lengths, *DERIVED, *own])
    for name, tie in ties.items():
        if name in known:
            yield f"'{called(name)}' is a place itself; call what is tied otherwise, as \"relay 1\""
        for place in tie.tied:
            if place not in lengths:
                near = nearest(place, [*map(called, lengths)])
                yield f"'{name}' ties '{place}', which is no length that can vary; {near}"
    for name in names:
        if name in ties:
            continue
        if name not in known:
            yield f"'{called(name)}' is nothing that can vary; {nearest(name, [*map(called, known)])}"
        elif name == "tube_length" and "stops.0.distance" not in numbers:
            yield "'tube_length' needs a design with a further stop, the tube's outer rim; add [[stops]] to it"
    shifted = {place for tie in ties.values() for place in tie.together}  # which add
    places = [PATHS.get(name, name) for name in names if name not in ties]
    places += [*shifted, *(place for tie in ties.values() for place in tie.same)]
    twice = (called(place) for place in dict.fromkeys(places) if places.count(place) > 1)
    yield from (f"'{place}' varies twice; name it once" for place in twice)
    focal, plane, distance = (place in places for place in CONJUGATES)
    ahead, tube = "working_distance" in places, "tube_diameter" in places
    rim = any(p == "aperture.diameter" or (p.startswith("stops.") and "diameter" in p) for p in places)
    clashes = {
        "f, d_f and d_1 cannot all vary: two of them give the third; drop one": focal and plane and distance,
        "'working_distance' sets d_f, which varies too; drop one of them": ahead and plane,
        "'working_distance', f and d_1 cannot all vary: two of them give the third; drop one": (
            ahead and focal and distance
        ),
        "'tube_diameter' sets the FAP's and every stop's diameter, one of which varies too; drop one": tube and rim,
    }
    yield from (words for words, clash in clashes.items() if clash)


def as_places(values: Mapping[str, Array], base: Camera) -> dict[str, Array]:
    """Numbers at places, with derived lengths turned into those that they set."""
    result = {name: value for name, value in values.items() if name not in DERIVED}
    stops = [opening.part for opening in base.stop_openings]
    if "tube_diameter" in values:
        result |= {f"{part}.diameter": values["tube_diameter"] for part in stops}
    d_3 = result.get("aperture.distance", base["aperture.distance"])
    if "tube_length" in values:
        result[f"{stops[-1]}.distance"] = d_3 + values["tube_length"]
    if "working_distance" in values:
        tip = base[TIP]
        for stop in stops:
            tip = np.maximum(tip, result.get(f"{stop}.distance", base[f"{stop}.distance"]))
        tip = np.maximum(tip, base.chain.end({**base.numbers, **result}))
        result[CONJUGATES[1]] = tip + values["working_distance"]
    return result
