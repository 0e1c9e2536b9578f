"""A transparent material in a file: by its name, by index and Abbe number, or out of a glass catalogue's file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, ValidationInfo

from ..toml_files import Instance
from ..units import format_quantity
from .glass import COEFFICIENTS, Glass, Warming, find_glass, is_shipped
from .glass_files import glass_of_table


def _material(value: Any, info: ValidationInfo) -> Glass:
    if isinstance(value, Glass):
        return value
    if isinstance(value, Mapping):
        folder = (info.context or {}).get("folder", "")
        return glass_of_table(value, None if folder is None else Path(folder))
    if isinstance(value, str):
        return find_glass(value)
    raise ValueError(f"must be a glass's name or a table such as {{index = 1.35, abbe = 55}}, got {value!r}")


def _written(glass: Glass) -> str | dict[str, Any]:
    if is_shipped(glass):
        return glass.name
    return numbers_of(glass) or {"name": glass.name, **glass_table(glass)}


def material_label(glass: Glass, wavelength: float) -> str:
    """Its name, and its index at a wavelength [mm] where that is not its name."""
    return glass.name if glass.name.startswith("n =") else f"{glass.name}, n = {float(glass.index(wavelength)):.5g}"


Material = Annotated[Glass, Instance, BeforeValidator(_material), PlainSerializer(_written, return_type=Any)]
"""A medium by its name, by index at 587.6 nm and Abbe number, or out of a glass catalogue's file."""


def numbers_of(glass: Glass) -> dict[str, float]:
    """Index and Abbe number of a glass that was given by them; empty of one with a name of its own."""
    if glass.formula not in ("constant", "abbe") or not glass.name.startswith("n ="):
        return {}
    return dict(zip(COEFFICIENTS[glass.formula], glass.coefficients, strict=True))


def glass_table(glass: Glass) -> dict[str, Any]:
    """The nested values that `read_glass` turns into an equal glass, but for its name and offset."""
    table: dict[str, Any] = {"formula": glass.formula}
    if glass.formula == "sellmeier":
        table |= {"b": list(glass.coefficients[::2]), "c": list(glass.coefficients[1::2])}
    elif glass.formula == "schott":
        table["a"] = list(glass.coefficients)
    else:
        table |= dict(zip(COEFFICIENTS[glass.formula], glass.coefficients, strict=True))
    if glass.against != "air":
        table["against"] = glass.against
    if math.isfinite(glass.longest):
        table["range"] = [format_quantity(glass.shortest, "length"), format_quantity(glass.longest, "length")]
    if glass.source:
        table["source"] = glass.source
    return table | _warming_table(glass.warming)


def _warming_table(warming: Warming) -> dict[str, Any]:
    laws: dict[str, Any] = {"water": "water"}
    if warming.law == "schott":
        *terms, resonance = warming.coefficients
        laws["schott"] = {"d": terms[:3], "e": terms[3:], "lambda_tk": resonance}
    elif warming.law == "rate":
        laws["rate"] = {"rate": warming.coefficients[0], "against": warming.against}
    entries = {"cte": warming.expansion, "dndt": laws.get(warming.law), "warming_source": warming.source}
    return {key: value for key, value in entries.items() if value}
