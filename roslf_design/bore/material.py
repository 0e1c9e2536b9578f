"""A transparent material in a design file: by its name, or by index and Abbe number."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, InstanceOf, PlainSerializer, ValidationInfo

from ..errors import InputError
from ..lenses.glass import Glass, find_glass, is_shipped
from ..lenses.glass_files import glass_of_table
from ..lenses.lens_file import glass_table, numbers_of


def _material(value: Any, info: ValidationInfo) -> Glass:
    if isinstance(value, Glass):
        return value
    try:
        if isinstance(value, Mapping):
            folder = (info.context or {}).get("folder", "")
            return glass_of_table(value, None if folder is None else Path(folder))
        if isinstance(value, str):
            return find_glass(value)
    except InputError as error:
        file = f"{error.origin}: " if error.origin else ""
        raise ValueError("; ".join(file + problem.message for problem in error.problems)) from None
    raise ValueError(f"expected a material by name or a table such as {{index = 1.35, abbe = 55}}, got {value!r}")


def _written(glass: Glass) -> str | dict[str, Any]:
    if is_shipped(glass):
        return glass.name
    return numbers_of(glass) or {"name": glass.name, **glass_table(glass)}


def material_label(glass: Glass, wavelength: float) -> str:
    """Its name, and its index at a wavelength [mm] where that is not its name."""
    return glass.name if glass.name.startswith("n =") else f"{glass.name}, n = {float(glass.index(wavelength)):.5g}"


Material = Annotated[
    InstanceOf[Glass],
    BeforeValidator(_material),
    PlainSerializer(_written, return_type=Any),
]
"""A medium by its name, by index at 587.6 nm and Abbe number, or out of a glass catalogue's file."""
