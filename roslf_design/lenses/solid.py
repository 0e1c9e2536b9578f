"""Solids of housings, spacers and sensors: how lengths grow with temperature."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from ..errors import InputError, Problem
from .glass import MOST_EXPANSION, catalogue, likely


@dataclass(frozen=True)
class Solid:
    """A material whose lengths grow with temperature."""

    name: str
    expansion: float
    """Linear [1/K]."""
    source: str = ""
    grade: str = ""
    """Grade that the name, which stands for several, is taken for."""

    @property
    def words(self) -> str:
        """Its name, the grade that it is taken for, and how it grows."""
        taken = f", taken as {self.grade}" if self.grade else ""
        return f"{self.name}{taken}, {1e6 * self.expansion:.3g}e-6 /K"


@cache
def opaque_solids() -> Mapping[str, Solid]:
    """Every material that ships and is no glass, by its names in lower case."""
    known: dict[str, Solid] = {}
    data = tomllib.loads(Path(__file__).with_name("solids.toml").read_text("utf-8"))
    for name, table in data["solids"].items():
        solid = Solid(name, table["cte"], data["sources"][table["source"]], table.get("grade", ""))
        for spelling in (name, *table.get("also", ())):
            named = solid.grade and solid.grade in spelling
            known[spelling.lower()] = replace(solid, name=spelling, grade="") if named else solid
    return known


@cache
def solids() -> Mapping[str, Solid]:
    """Every material that ships, by its names in lower case; glasses with a known expansion among them."""
    glasses = {
        spelling.lower(): Solid(glass.name, glass.warming.expansion, glass.warming.source)
        for spelling, glass in catalogue().items()
        if glass.warming.expansion
    }
    return {**glasses, **opaque_solids()}


def find_solid(name: str) -> Solid:
    """The material of that name, in any case.

    Raises
    ------
    InputError
        Unknown; names the nearest one known.
    """
    if solid := solids().get(name.strip().lower()):
        return solid
    near = likely(name, solids())
    metals = dict.fromkeys(solid.name for solid in solids().values() if solid.name.upper() not in catalogue())
    hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(metals)}, and glasses by name"
    message = f"'{name}' is no material with a known expansion; {hint}; or give it: {{expansion = 23.6e-6}} per K"
    raise InputError((Problem("material", message),))


def solid_of(table: Mapping[str, object]) -> Solid:
    """A material from its ``expansion`` [1/K] and, where it has one, its ``name``.

    Raises
    ------
    InputError
        Other keys; no expansion, or none that a solid has.
    """
    rate, name = table.get("expansion"), table.get("name", "")
    number = isinstance(rate, (int, float)) and not isinstance(rate, bool) and abs(rate) < MOST_EXPANSION
    if not number or not isinstance(name, str) or table.keys() - {"expansion", "name"}:
        message = f"must be a name, or a table such as {{expansion = 23.6e-6}} per K, got {dict(table)!r}"
        raise InputError((Problem("material", message),))
    return Solid(name or f"{rate:g} /K", float(rate))  # type: ignore[arg-type]
