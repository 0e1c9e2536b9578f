"""Environment of a camera: its temperature, and the materials that hold it.

Lengths of a design hold at `Environment.reference` until it is built; built, they are those at
`Environment.temperature`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer, field_validator

from ..bore.part import Part
from ..errors import InputError
from ..lenses.glass import ROOM
from ..lenses.solid import Solid, find_solid, opaque_solids, solid_of, solids
from ..toml_files import Instance
from ..units import Temperature

REFERENCE = "environment.reference"
"""Place of the temperature at which a file's lengths hold."""


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


Housed = Annotated[Solid, Instance, BeforeValidator(_solid), PlainSerializer(_written, return_type=Any)]
"""A material by its name, or as a table with its expansion [1/K]."""


class Environment(Part):
    """Environment in which the camera is used."""

    temperature: Temperature = ROOM
    """Temperature of the whole camera and of what it looks through [degrees C]."""
    range: Annotated[tuple[Temperature, Temperature] | None, Field(default=None)]
    """Coldest and warmest that the camera meets, in use or in an autoclave [degrees C]."""
    calibrated_at: Temperature | None = None
    """Temperature at which the camera is calibrated [degrees C]; None is the middle of `range`."""
    housing: Housed | None = None
    """Housing that holds the parts apart, as spacers do: glass between grows as glass; None does not grow."""
    sensor: Housed = opaque_solids()["silicon"]
    """Material that pixels are made on."""
    reference: Temperature = ROOM
    """Temperature at which the lengths of the file hold [degrees C]."""

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
