"""What can be changed in the explorer: the numbers of a design, their units, and how far a slider reaches."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from ..design import Design
from ..design.parameters import PATHS
from ..design.units import UNITS, parse_quantity

STEPS = 1000
"""A slider's positions are the whole numbers from 0 to this."""

SPAN = 4.0
"""A slider reaches from the reference over this to the reference times this."""

CONJUGATE = ("f", "d_1", "d_f")
"""Any two of these give the third."""


class Field(NamedTuple):
    """One number of a design as the page shows it."""

    symbol: str
    """As in the paper, and as `Design.replace` takes it."""
    name: str
    """In words."""
    group: str
    """Part of the camera that it belongs to."""
    unit: str
    """The unit that it is shown in, and that a number without a unit has."""
    scale: Literal["log", "linear"] = "log"
    """How the slider runs."""


FIELDS = (
    Field("D", "Clear aperture", "Main lens", "mm"),
    Field("f", "Focal length", "Main lens", "mm"),
    Field("d_f", "Focal plane", "Main lens", "mm"),
    Field("d_1", "Lens to MLA", "Main lens", "mm"),
    Field("D_F", "Pupil diameter", "Angular plane", "mm"),
    Field("d_3", "Pupil to lens", "Angular plane", "mm", "linear"),
    Field("d", "Pitch", "Microlenses", "um"),
    Field("f_ml", "Focal length", "Microlenses", "mm"),
    Field("d_2", "MLA to sensor", "Sensor and light", "mm"),
    Field("q", "Pixel pitch", "Sensor and light", "um"),
    Field("wavelength", "Wavelength", "Sensor and light", "nm", "linear"),
)
"""Every field, in the order of the page."""

BY_SYMBOL = {field.symbol: field for field in FIELDS}

_VISIBLE = (380e-6, 1000e-6)
"""Wavelengths that a slider reaches, whatever the design [mm]."""


def factor(field: Field) -> float:
    """Millimetres in one of the field's unit."""
    return float(UNITS["length"][field.unit])


def show(field: Field, value: float) -> str:
    """The number as text with its unit, to seven digits.

    Parameters
    ----------
    field : Field
        Whose unit to use.
    value : float
        [mm].
    """
    return f"{value / factor(field):.7g} {field.unit}"


def read(field: Field, text: str) -> float:
    """A length that was typed, in mm; a bare number has the unit that the field shows.

    Raises
    ------
    ValueError
        What is wrong and what to write instead.
    """
    stripped = text.strip().replace(",", ".") if text.count(",") == 1 and "." not in text else text.strip()
    if not stripped:
        raise ValueError(f'empty; write e.g. "{_example(field)}"')
    try:
        float(stripped)
    except ValueError:
        return parse_quantity(stripped, "length")
    return parse_quantity(f"{stripped} {field.unit}", "length")


def _example(field: Field) -> str:
    return {"mm": "2.9 mm", "um": "63 um", "nm": "550 nm"}[field.unit]


def reach(field: Field, reference: Design, design: Design) -> tuple[float, float]:
    """Smallest and largest value of the field's slider [mm].

    Parameters
    ----------
    field : Field
        Which number.
    reference : Design
        The design that was loaded: a slider keeps its place while it is moved.
    design : Design
        The design as it is now; a slider always reaches its value.
    """
    now, centre = float(getattr(design, field.symbol)), float(getattr(reference, field.symbol))
    if field.symbol == "wavelength":
        low, high = _VISIBLE
    elif field.symbol == "d_3":
        low, high = 0.0, 0.995 * design.d_f
    elif field.symbol in CONJUGATE[1:]:
        low, high = max(centre / SPAN, 1.001 * design.f), centre * SPAN
    else:
        low, high = centre / SPAN, centre * SPAN
    return min(low, now), max(high, now)


def position(field: Field, value: float, ends: tuple[float, float]) -> int:
    """Where the slider stands for a value [mm], from 0 to `STEPS`."""
    low, high = ends
    if not high > low:
        return 0
    share = (
        math.log(value / low) / math.log(high / low)
        if field.scale == "log" and low > 0 < value
        else (value - low) / (high - low)
    )
    return round(STEPS * min(max(share, 0.0), 1.0))


def value_at(field: Field, place: float, ends: tuple[float, float]) -> float:
    """Value [mm] of a slider's position, rounded to as many digits as a step has; the ends are met exactly."""
    low, high = ends
    share = min(max(place / STEPS, 0.0), 1.0)
    if share in (0.0, 1.0):
        return high if share else low
    if field.scale == "log" and low > 0:
        return _rounded(low * (high / low) ** share, 4)
    span = high - low
    digits = 1 + math.ceil(math.log10(STEPS))
    value = low + share * span
    return round(value, digits - 1 - math.floor(math.log10(span))) if span > 0 else low


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def symbol_of(path: str) -> str | None:
    """The field that a place in a design file belongs to, None where it has none."""
    return next((symbol for symbol, place in PATHS.items() if place == path), None)
