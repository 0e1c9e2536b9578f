"""Units, at the boundary only: text such as "63 um" to millimetres or radians, and back without losing a bit.

Conversion goes through decimal arithmetic, so that "63 um", "0.063 mm" and 0.063 are the same float and a value
written to a file and read again is the same value, in the unit that was typed. Files for people may ask for fewer
digits.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from decimal import Context, Decimal
from numbers import Real
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, GetCoreSchemaHandler, SerializationInfo, ValidationInfo
from pydantic_core import CoreSchema, core_schema

_PI = Decimal("3.14159265358979323846264338327950288")

NAMES = {"micron": "um", "micrometer": "um", "u": "um", "inch": "in", "inche": "in", "degree": "deg", "radian": "rad"}
NAMES |= {"nanometer": "nm", "millimeter": "mm", "centimeter": "cm", "meter": "m", "second": "s"}
"""Names of units in full, one of each, and their letters."""
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
    "gradient": {"/mm": Decimal(1), "1/mm": Decimal(1), "mm^-1": Decimal(1), "/m": Decimal("1e-3")},
    "illuminance": {"lx": Decimal(1), "klx": Decimal(1000), "lux": Decimal(1)},
    "radiance": {"W/m2/sr": Decimal(1), "W/m^2/sr": Decimal(1), "mW/mm2/sr": Decimal(1000)},
    "time": {
        "s": Decimal(1),
        "ms": Decimal("1e-3"),
        "us": Decimal("1e-6"),
        "µs": Decimal("1e-6"),
        "μs": Decimal("1e-6"),
    },
    "temperature": {"degC": Decimal(1), "°C": Decimal(1)},
    "temperature difference": {"K": Decimal(1), "degC": Decimal(1), "°C": Decimal(1)},
}
"""Known units by dimension, in millimetres, radians, lux, watts per square metre and steradian, seconds, degrees C."""

FARTHEST = {
    "length": 1e15,
    "angle": 1e3,
    "gradient": 1e6,
    "illuminance": 1e15,
    "radiance": 1e15,
    "time": 1e9,
    "temperature": 1e3,
    "temperature difference": 1e3,
}
"""Limits that no quantity of a camera exceeds, in its base unit: a plane in focus at infinity may be written as 1e12 m.
"""
_CELSIUS, _FAHRENHEIT, _KELVIN = (1.0, 0.0), (5 / 9, -160 / 9), (1.0, -273.15)
SCALES = {
    **dict.fromkeys(("c", "celsius"), _CELSIUS),
    **dict.fromkeys(("f", "fahrenheit"), _FAHRENHEIT),
    **dict.fromkeys(("k", "kelvin"), _KELVIN),
}
"""Scales of temperature by their names: size of a degree, and the zero [degrees C]."""
COLDEST, HOTTEST = -60.0, 150.0
"""Between which cameras are used, stored and cleaned [degrees C]."""
SHORTEST = 1e-12
"""Length that none which must be positive falls below [mm]: a thousandth of a proton."""

_EXAMPLE = {
    "length": "120 mm",
    "angle": "2 mrad",
    "gradient": "0.2 /mm",
    "illuminance": "1e5 lx",
    "radiance": "10 W/m2/sr",
    "time": "16.7 ms",
    "temperature": "37 degC",
    "temperature difference": "10 K",
}
_BASE = {
    "length": "mm",
    "angle": "rad",
    "gradient": "/mm",
    "illuminance": "lx",
    "radiance": "W/m2/sr",
    "time": "s",
    "temperature": "degC",
    "temperature difference": "K",
}
LACKING = _BASE | {"angle": "deg"}
"""Unit that a remedy names for a number without one, by its dimension."""
"""Units that messages offer for a number without one."""
# Possessive, or a text of thousand digits that is no quantity takes ten seconds to refuse.
_NUMBER = re.compile(r"\s*([+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?)\s*(\S*)\s*")


def parse_quantity(text: object, dimension: str, *, unit_required: bool = True, unit: str = "") -> float:
    """Read a length in millimetres or an angle in radians.

    Parameters
    ----------
    text : object
        "63 um", "120 mm", "2 mrad"; a bare number counts as mm or rad only where `unit_required` is false.
    dimension : {"length", "angle"}
        What is being read.
    unit_required : bool
        True for what comes from a file, where a number without a unit is an error; but 0 needs none.
    unit : str
        Unit that the number of a text is given in, instead of mm or rad.

    Raises
    ------
    ValueError
        Says what is wrong and what to write instead.
    """
    example, lacking = _EXAMPLE[dimension], unit or LACKING[dimension]
    if isinstance(text, bool) or not isinstance(text, (str, Real)):  # a numpy float32 is a number, too
        raise ValueError(f'expected a {dimension} such as "{example}", got {text!r}')
    if not isinstance(text, str):
        if unit_required and text != 0:  # which is the same in every unit
            raise ValueError(f'{text!r} has no unit; write it as text with one, e.g. "{text!r} {lacking}"')
        value = float(text)
        if not math.isfinite(value):
            raise ValueError(f"{text!r} is not a finite number")
        return value + 0.0  # -0.0 and 0.0 are one value, and so must be one text
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f'cannot read "{text}" as a {dimension}; write e.g. "{example}"')
    number, given = match.groups()
    if not given:
        raise ValueError(f'"{text}" has no unit; write e.g. "{number} {lacking}"')
    factor = UNITS[dimension].get(given)
    if factor is None:
        raise ValueError(f'"{text}": {_about_unit(given, dimension, float(number))}')
    value = float(number)
    if math.isfinite(value) and value:  # decimals reach no further than floats
        value = float(Decimal(number) * factor / UNITS[dimension][unit or _BASE[dimension]])
    if not math.isfinite(value):
        raise ValueError(f'"{text}" is not a finite number')
    return value + 0.0


def parse_in(text: str, unit: str) -> float:
    """A number written with its unit, in the unit given: "70 deg" in deg, "1.2 rad" as well, "3 px" in px.

    Raises
    ------
    ValueError
        Another unit, or none where there is one.
    """
    dimension = next((name for name, known in UNITS.items() if unit in known), None)
    if dimension is not None:
        return parse_quantity(text, dimension, unit=unit)
    match = _NUMBER.fullmatch(text)
    if match is None or match[2] != unit or not math.isfinite(float(match[1])):
        remedy = f'write it in {unit}, e.g. "3 {unit}"' if unit else "write a number without a unit, e.g. 3"
        raise ValueError(f'cannot read "{text}"; {remedy}')
    return float(match[1])


def read_quantity(text: object, dimension: str, *, unit_required: bool = True) -> float:
    """A quantity as `parse_quantity` reads it, of a size that a camera can have; arguments and errors as there."""
    return within_reach(parse_quantity(text, dimension, unit_required=unit_required), dimension, text)


def within_reach(value: float, dimension: str, text: object = None) -> float:
    """A length or angle as it is, where it can belong to a camera: what is computed from it is then finite.

    Parameters
    ----------
    value : float
        [mm] or [rad].
    dimension : {"length", "angle"}
        Which of the two.
    text : object
        How it was written.

    Raises
    ------
    ValueError
        Beyond `FARTHEST`.
    """
    if abs(value) <= FARTHEST[dimension]:
        return value
    most = format_quantity(FARTHEST[dimension], dimension)
    raise ValueError(f'"{text or format_quantity(value, dimension)}" is beyond {most}; write what the camera has')


def _about_unit(unit: str, dimension: str, number: float) -> str:
    scale = SCALES.get(unit.lower().removeprefix("deg").removeprefix("°"))
    if scale is not None and dimension == "temperature" and math.isfinite(number):
        return f'temperatures are written in degC; write "{number * scale[0] + scale[1]:.6g} degC"'
    for other, known in UNITS.items():
        if unit in known and other != dimension:
            article = "an" if dimension[0] in "aeiou" else "a"
            return f"'{unit}' is a unit of {other}, but this is {article} {dimension}"
    # Degrees of one scale are none of the other, however alike their letters.
    near = [] if dimension.startswith("temperature") else _alike(unit, UNITS[dimension])
    remedy = f"did you mean {' or '.join(map(repr, near))}?" if near else f"use one of {', '.join(UNITS[dimension])}"
    return f"'{unit}' is not a known unit of {dimension}; {remedy}"


def _alike(unit: str, known: Collection[str]) -> list[str]:
    """Units that one stands for: its name in full, one letter off, or alike."""
    letters = NAMES.get(unit.lower().removesuffix("s").replace("metre", "meter"), "")
    if letters in known:
        return [letters]
    slips = [one for one in known if len(one) == len(unit) > 1 and (one[0] == unit[0] or set(one) == set(unit))]
    return slips or difflib.get_close_matches(unit, known, 1, 0.5)


def format_quantity(value: float, dimension: str, digits: int | None = None) -> str:
    """Write millimetres or radians as text, in the unit they were typed in or the one that reads best.

    Parameters
    ----------
    value : float
        A finite length [mm] or angle [rad].
    dimension : {"length", "angle"}
        Which of the two.
    digits : int, optional
        To round to. By default `parse_quantity` gives the same float back.
    """
    size = abs(value)
    if isinstance(value, _TypedQuantity):
        unit = value.unit
    elif dimension != "length":
        unit = {"angle": "mrad", "time": "ms"}.get(dimension, _BASE[dimension])
    else:
        unit = "mm" if size == 0 or size >= 0.1 else "um" if size >= 1e-3 else "nm"
    exact = Decimal(repr(float(value))) / UNITS[dimension][unit]
    return f"{_plain(exact if digits is None else Context(prec=digits).plus(exact))} {unit}"


class _TypedQuantity(float):
    """A number [mm] or [rad] that knows the unit it was typed in; what is computed from it is a float like any."""

    __slots__ = ("unit",)
    unit: str
    """Unit, one of `UNITS`."""

    def __new__(cls, value: float, unit: str = "mm") -> Self:
        number = super().__new__(cls, value)
        number.unit = unit
        return number


def _plain(number: Decimal) -> str:
    if number and not -9 <= number.adjusted() <= 9:
        return f"{number.normalize():e}"
    text = f"{number:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def in_file(info: ValidationInfo) -> bool:
    """Whether what is validated stands in a file, where numbers need their units."""
    return bool(info.context and info.context.get("from_file"))


@dataclass(frozen=True)
class _Typed:
    """Reader and writer of a dimension's text, as pydantic asks for them: its own take twice as long to build."""

    dimension: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        text = core_schema.plain_serializer_function_ser_schema(
            self.write, info_arg=True, return_schema=core_schema.str_schema(), when_used="json"
        )
        return core_schema.with_info_wrap_validator_function(self.read, handler(source), serialization=text)

    def read(self, value: Any, check: Callable[[Any], float], info: ValidationInfo) -> float:
        number = check(read_quantity(value, self.dimension, unit_required=in_file(info)))
        typed = _NUMBER.fullmatch(value)[2] if isinstance(value, str) else getattr(value, "unit", "")  # type: ignore[index]
        return _TypedQuantity(number, typed) if typed else number

    def write(self, value: float, info: SerializationInfo) -> str:
        return format_quantity(value, self.dimension, (info.context or {}).get("digits"))


def _no_nothing(value: float) -> float:
    if 0 < value < SHORTEST:
        least = format_quantity(SHORTEST, "length")
        raise ValueError(f'"{format_quantity(value, "length")}" is less than {least}; write what the camera has')
    return value


AnyLength = Annotated[float, _Typed("length")]
"""A length of either sign [mm]."""
Length = Annotated[AnyLength, AfterValidator(_no_nothing), Field(gt=0)]
"""A positive length [mm]."""
Distance = Annotated[AnyLength, Field(ge=0)]
"""A length that may be zero [mm]."""
Angle = Annotated[float, _Typed("angle")]
"""An angle of either sign [rad]."""
Gradient = Annotated[float, _Typed("gradient"), Field(gt=0)]
"""A positive inverse length [1/mm]."""
Illuminance = Annotated[float, _Typed("illuminance"), Field(gt=0)]
"""[lx]."""
Radiance = Annotated[float, _Typed("radiance"), Field(gt=0)]
"""[W/m^2/sr]."""
Time = Annotated[float, _Typed("time"), Field(gt=0)]
"""[s]."""
Temperature = Annotated[float, _Typed("temperature"), Field(ge=COLDEST, le=HOTTEST)]
"""[degrees C]."""
