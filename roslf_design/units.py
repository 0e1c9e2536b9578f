"""Units, at the boundary only: text such as "63 um" to millimetres or radians, and back without losing a bit.

Conversion goes through decimal arithmetic, so that "63 um", "0.063 mm" and 0.063 are the same float and a value
written to a file and read again is the same value.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable
from decimal import Decimal
from numbers import Real
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer, ValidationInfo

_PI = Decimal("3.14159265358979323846264338327950288")

UNITS: dict[str, dict[str, Decimal]] = {
    "length": {
        "nm": Decimal("1e-6"),
        "um": Decimal("1e-3"),
        "µm": Decimal("1e-3"),
        "μm": Decimal("1e-3"),
        "mm": Decimal(1),
        "cm": Decimal(10),
        "m": Decimal(1000),
        "in": Decimal("25.4"),
    },
    "angle": {
        "rad": Decimal(1),
        "mrad": Decimal("1e-3"),
        "urad": Decimal("1e-6"),
        "deg": _PI / 180,
        "°": _PI / 180,
        "arcmin": _PI / 10800,
    },
}
"""Known units by dimension, in millimetres or radians."""

_EXAMPLE = {"length": "120 mm", "angle": "2 mrad"}
# Possessive, or a text of thousand digits that is no quantity takes ten seconds to refuse.
_NUMBER = re.compile(r"\s*([+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?)\s*(\S*)\s*")


def parse_quantity(text: object, dimension: str, *, unit_required: bool = True) -> float:
    """Read a length in millimetres or an angle in radians.

    Parameters
    ----------
    text : object
        "63 um", "120 mm", "2 mrad"; a bare number counts as mm or rad only where `unit_required` is false.
    dimension : {"length", "angle"}
        What is being read.
    unit_required : bool
        True for what comes from a file, where a number without a unit is an error; but 0 needs none.

    Raises
    ------
    ValueError
        Says what is wrong and what to write instead.
    """
    example, base = _EXAMPLE[dimension], "mm" if dimension == "length" else "rad"
    if isinstance(text, bool) or not isinstance(text, (str, Real)):  # a numpy float32 is a number, too
        raise ValueError(f'expected a {dimension} such as "{example}", got {text!r}')
    if not isinstance(text, str):
        if unit_required and text != 0:  # which is the same in every unit
            raise ValueError(f'{text!r} has no unit; write it as text with one, e.g. "{text!r} {base}"')
        value = float(text)
        if not math.isfinite(value):
            raise ValueError(f"{text!r} is not a finite number")
        return value + 0.0  # -0.0 and 0.0 are one value, and so must be one text
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f'cannot read "{text}" as a {dimension}; write e.g. "{example}"')
    number, unit = match.groups()
    if not unit:
        raise ValueError(f'"{text}" has no unit; write e.g. "{number} {base}"')
    factor = UNITS[dimension].get(unit)
    if factor is None:
        raise ValueError(f'"{text}": {_about_unit(unit, dimension)}')
    value = float(Decimal(number) * factor)
    if not math.isfinite(value):
        raise ValueError(f'"{text}" is not a finite number')
    return value + 0.0


def _about_unit(unit: str, dimension: str) -> str:
    for other, known in UNITS.items():
        if unit in known and other != dimension:
            return f"'{unit}' is a unit of {other}, but this is a {dimension}"
    near = difflib.get_close_matches(unit, UNITS[dimension], 1, 0.5)
    remedy = f"did you mean '{near[0]}'?" if near else f"use one of {', '.join(UNITS[dimension])}"
    return f"'{unit}' is not a known unit of {dimension}; {remedy}"


def format_quantity(value: float, dimension: str) -> str:
    """Write millimetres or radians as text in the unit that reads best; `parse_quantity` gives the same float back.

    Parameters
    ----------
    value : float
        A finite length [mm] or angle [rad].
    dimension : {"length", "angle"}
        Which of the two.
    """
    if dimension == "angle":
        unit = "mrad"
    else:
        size = abs(value)
        unit = "mm" if size == 0 or size >= 0.1 else "um" if size >= 2e-3 else "nm"
    exact = Decimal(repr(value)) / UNITS[dimension][unit]
    return f"{_plain(exact)} {unit}"


def _plain(number: Decimal) -> str:
    if number and not -9 <= number.adjusted() <= 9:
        return f"{number.normalize():e}"
    text = f"{number:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _validator(dimension: str) -> Callable[[Any, ValidationInfo], float]:
    def validate(value: Any, info: ValidationInfo) -> float:
        from_file = bool(info.context and info.context.get("from_file"))
        return parse_quantity(value, dimension, unit_required=from_file)

    return validate


def _writer(dimension: str) -> PlainSerializer:
    return PlainSerializer(lambda value: format_quantity(value, dimension), return_type=str, when_used="json")


AnyLength = Annotated[float, BeforeValidator(_validator("length")), _writer("length")]
"""A length of either sign [mm]."""
Length = Annotated[AnyLength, Field(gt=0)]
"""A positive length [mm]."""
Distance = Annotated[AnyLength, Field(ge=0)]
"""A length that may be zero [mm]."""
Angle = Annotated[float, BeforeValidator(_validator("angle")), _writer("angle")]
"""An angle of either sign [rad]."""
