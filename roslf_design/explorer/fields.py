"""What can be changed in the explorer: the numbers of a design, their units, and how far a slider reaches."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from ..design import Design
from ..design.parts import PATHS
from ..units import UNITS, parse_quantity

STEPS = 1000
"""A slider's positions are the whole numbers from 0 to this."""

SPAN = 4.0
"""A slider reaches from the reference over this to the reference times this."""

CONJUGATE = ("f", "d_1", "d_f")
"""Any two of these give the third."""


class NumberField(NamedTuple):
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
    NumberField("D", "Clear aperture", "Main lens", "mm"),
    NumberField("f", "Focal length", "Main lens", "mm"),
    NumberField("d_f", "Focal plane", "Main lens", "mm"),
    NumberField("d_1", "Lens to MLA", "Main lens", "mm"),
    NumberField("D_F", "Pupil diameter", "Angular plane", "mm"),
    NumberField("d_3", "Pupil to lens", "Angular plane", "mm", "linear"),
    NumberField("d", "Pitch", "Microlenses", "um"),
    NumberField("f_ml", "Focal length", "Microlenses", "mm"),
    NumberField("d_2", "MLA to sensor", "Sensor and light", "mm"),
    NumberField("q", "Pixel pitch", "Sensor and light", "um"),
    NumberField("wavelength", "Wavelength", "Sensor and light", "nm", "linear"),
)
"""Every field, in the order of the page."""

BY_SYMBOL = {field.symbol: field for field in FIELDS}

EXAMPLES = {"mm": "2.9 mm", "um": "63 um", "nm": "550 nm"}
"""What may be typed, by the field's unit."""

VISIBLE = (380e-6, 1000e-6)
"""Wavelengths that a slider reaches, whatever the design [mm]."""


def show(field: NumberField, value: float) -> str:
    """A length [mm] as text in the field's unit, to seven digits."""
    return f"{value / float(UNITS['length'][field.unit]):.7g} {field.unit}"


def read(field: NumberField, text: str) -> float:
    """A length that was typed [mm]; a bare number has the unit that the field shows.

    Raises
    ------
    ValueError
        What is wrong and what to write instead.
    """
    typed = text.strip()
    if typed.count(",") == 1 and "." not in typed:
        typed = typed.replace(",", ".")
    if not typed:
        raise ValueError(f'empty; write e.g. "{EXAMPLES[field.unit]}"')
    try:
        float(typed)
    except ValueError:
        return parse_quantity(typed, "length")
    return parse_quantity(f"{typed} {field.unit}", "length")


def reach(field: NumberField, reference: Design, design: Design) -> tuple[float, float]:
    """Smallest and largest value of the field's slider [mm].

    Parameters
    ----------
    field : NumberField
        Which number.
    reference : Design
        The design that was loaded: a slider keeps its place while it is moved.
    design : Design
        The design as it is now; a slider always reaches its value.
    """
    now, centre = float(getattr(design, field.symbol)), float(getattr(reference, field.symbol))
    low, high = centre / SPAN, centre * SPAN
    if field.symbol == "wavelength":
        low, high = VISIBLE
    elif field.symbol == "d_3":
        low, high = 0.0, 0.995 * design.d_f
    elif field.symbol in ("d_1", "d_f"):
        low = max(low, 1.001 * design.f)
    return min(low, now), max(high, now)


def position(field: NumberField, value: float, ends: tuple[float, float]) -> int:
    """Where the slider stands for a value [mm], from 0 to `STEPS`."""
    low, high = ends
    if not high > low:
        return 0
    if field.scale == "log" and low > 0 < value:
        share = math.log(value / low) / math.log(high / low)
    else:
        share = (value - low) / (high - low)
    return round(STEPS * min(max(share, 0.0), 1.0))


def value_at(field: NumberField, place: float, ends: tuple[float, float]) -> float:
    """Value [mm] of a slider's position, rounded to as many digits as a step has; the ends are met exactly."""
    low, high = ends
    share = min(max(place / STEPS, 0.0), 1.0)
    if share in (0.0, 1.0):
        return high if share else low
    if field.scale == "log" and low > 0:
        return float(f"{low * (high / low) ** share:.4g}")
    span = high - low
    return round(low + share * span, 3 - math.floor(math.log10(span))) if span > 0 else low


def symbol_of(path: str) -> str | None:
    """The field that a place in a design file belongs to, None where it has none."""
    return next((symbol for symbol, place in PATHS.items() if place == path), None)
