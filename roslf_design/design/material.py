"""A transparent material in a design file: by its name, or by index and Abbe number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, InstanceOf, PlainSerializer

from ..errors import InputError
from ..lenses.glass import COEFFICIENTS, Glass, catalogue, find_glass, glass_of_index


def _material(value: Any) -> Glass:
    if isinstance(value, Glass):
        return value
    try:
        if isinstance(value, Mapping):
            return glass_of_index(value)
        if isinstance(value, str):
            return find_glass(value)
    except InputError as error:
        raise ValueError("; ".join(problem.message for problem in error.problems)) from None
    raise ValueError(f"expected a material by name or a table such as {{index = 1.35, abbe = 55}}, got {value!r}")


def _written(glass: Glass) -> str | dict[str, float]:
    if glass.name.upper() in catalogue():
        return glass.name
    return dict(zip(COEFFICIENTS[glass.formula], glass.coefficients, strict=True))


def material_told(glass: Glass, wavelength: float) -> str:
    """Its name, and its index at a wavelength [mm] where that is not its name."""
    return glass.name if glass.name.startswith("n =") else f"{glass.name}, n = {float(glass.index(wavelength)):.5g}"


Material = Annotated[
    InstanceOf[Glass],
    BeforeValidator(_material),
    PlainSerializer(_written, return_type=Any),
]
"""A medium by its name, or by index at 587.6 nm and Abbe number."""
