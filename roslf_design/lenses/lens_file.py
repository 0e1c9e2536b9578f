"""Lens files: a prescription as TOML with units, in and out, every fault told at once.

.. code-block:: toml

    name = "LA1050-A"
    source = "Thorlabs catalogue"
    wavelength = "587.6 nm"       # optional: the maker's design wavelength

    [[surfaces]]                  # from the scene to the sensor
    radius = "51.5 mm"            # "inf" for a plane; or curvature = "0.0194 mm^-1"
    thickness = "9.69 mm"         # to the next surface
    glass = "N-BK7"               # after this surface; left out: air
    diameter = "50.8 mm"          # clear diameter; what lies outside is clipped
    conic = -0.6                  # optional
    asphere = { r4 = "1e-6 mm^-3" }   # optional: r2 to r16

    [[surfaces]]
    radius = "inf"
    diameter = "50.8 mm"
"""

from __future__ import annotations

import difflib
import math
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from decimal import Decimal
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from ..design.files import parse_toml, read_toml
from ..design.units import format_quantity, parse_quantity
from ..errors import InputError, Problem
from .glass import AIR, Glass, catalogue, find_glass, read_glass
from .prescription import ASPHERE_TERMS, LensError, Prescription, Surface, faults

TOP = ("name", "source", "wavelength", "surfaces", "glasses")
SURFACE = ("radius", "curvature", "thickness", "glass", "diameter", "conic", "asphere", "index_offset", "shift", "tilt")
_POWER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*mm(?:\^|\*\*)(-?\d+)\s*")


def load_lens(path: str | os.PathLike[str]) -> Prescription:
    """Read a lens from a .toml or .zmx file, or a shipped one by its name such as "LA1050-A".

    Raises
    ------
    LensError
        Names the file and every fault in it.
    """
    place, origin = Path(path), os.fspath(path)
    if not place.exists() and origin.lower() in shipped_names():
        return loads_lens(_shipped(origin.lower()), origin)
    if place.suffix.lower() == ".zmx":
        from .zmx import read_zmx

        return read_zmx(place)
    known = ", ".join(name.upper() for name in shipped_names())
    try:
        data = read_toml(place, origin, f"check the path, or name a lens that ships: {known}")
    except InputError as error:
        raise LensError(error.problems, origin) from None
    return lens_of(data, origin)


@cache
def shipped_names() -> tuple[str, ...]:
    """Names of the lenses that ship, in lower case."""
    folder = files(__package__).joinpath("shipped")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def _shipped(name: str) -> str:
    return files(__package__).joinpath("shipped", f"{name}.toml").read_text("utf-8")


def loads_lens(text: str, origin: str = "") -> Prescription:
    """Read a lens from TOML text; `origin` is what errors call it."""
    try:
        data = parse_toml(text, origin)
    except InputError as error:
        raise LensError(error.problems, origin) from None
    return lens_of(data, origin)


def lens_of(data: Mapping[str, Any], origin: str = "") -> Prescription:
    """A lens from the nested values of a lens file; `origin` is what errors call it."""
    found = [*_unknown("", data, TOP)]
    own: dict[str, Glass] = {}
    for name, table in _table(data.get("glasses", {}), "glasses", found).items():
        glass, problems = read_glass(name, _table(table, f"glasses.{name}", found))
        found += [Problem(f"glasses.{name}.{problem.key}", problem.message) for problem in problems]
        if glass is not None:
            own[name.upper()] = glass
    rows = data.get("surfaces", [])
    if not isinstance(rows, list):
        found.append(Problem("surfaces", "must be a list of tables; write [[surfaces]] once for each surface"))
        rows = []
    surfaces = [_surface(row, f"surfaces.{number}", own, found) for number, row in enumerate(rows, start=1)]
    wavelength = _length(data, "wavelength", "", found) if "wavelength" in data else None
    texts = {key: data.get(key, "") for key in ("name", "source")}
    found += [Problem(k, f"must be text, got {v!r}") for k, v in texts.items() if not isinstance(v, str)]
    whole = tuple(surface for surface in surfaces if surface is not None)
    if len(whole) == len(rows):
        found += faults(whole)
    if not found:
        try:
            return Prescription(whole, texts["name"], texts["source"], wavelength)
        except LensError as error:
            found += error.problems
    raise LensError(tuple(found), origin)


def _surface(row: Any, place: str, own: Mapping[str, Glass], found: list[Problem]) -> Surface | None:
    before = len(found)
    row = _table(row, place, found)
    found += _unknown(place, row, SURFACE)
    curvature = _curvature(row, place, found)
    thickness = _length(row, "thickness", place, found) if "thickness" in row else 0.0
    diameter = _length(row, "diameter", place, found)
    if diameter <= 0:
        found.append(Problem(f"{place}.diameter", f'"{row["diameter"]}" must be greater than zero'))
    conic, offset = (_number(row, key, place, found) for key in ("conic", "index_offset"))
    asphere = _asphere(row.get("asphere", {}), f"{place}.asphere", found)
    shift = _tuple(row, "shift", 3, "length", place, found)
    tilt = _tuple(row, "tilt", 2, "angle", place, found)
    glass = AIR
    try:
        name = row.get("glass", "air")
        glass = find_glass(name, own) if isinstance(name, str) else AIR
        if not isinstance(name, str):
            found.append(Problem(f"{place}.glass", f"must be a glass's name, got {name!r}"))
    except InputError as error:
        found.append(Problem(f"{place}.glass", error.problems[0].message))
    if len(found) > before:
        return None
    return Surface(
        curvature,
        diameter / 2,
        thickness,
        glass.with_offset(offset),
        conic,
        asphere,
        (shift[0], shift[1], shift[2]),
        (tilt[0], tilt[1]),
    )


def _table(value: Any, place: str, found: list[Problem]) -> Mapping[str, Any]:
    if isinstance(value, Mapping):
        return value
    found.append(Problem(place, f"must be a table of keys, got {value!r}"))
    return {}


def _unknown(place: str, table: Mapping[str, Any], known: Iterable[str]) -> list[Problem]:
    found = []
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1, 0.5)
            hint = f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(known)}"
            found.append(Problem(f"{place}.{key}".strip("."), f"is not a known key; {hint}"))
    return found


def _length(table: Mapping[str, Any], key: str, place: str, found: list[Problem]) -> float:
    where = f"{place}.{key}".strip(".")
    if key not in table:
        found.append(Problem(where, f'is missing; add it, e.g. {key} = "50.8 mm"'))
        return math.nan
    try:
        return parse_quantity(table[key], "length")
    except ValueError as error:
        found.append(Problem(where, str(error)))
        return math.nan


def _number(table: Mapping[str, Any], key: str, place: str, found: list[Problem]) -> float:
    value = table.get(key, 0.0)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        found.append(Problem(f"{place}.{key}", f"must be a finite number without a unit, got {value!r}"))
        return 0.0
    return float(value)


def _curvature(row: Mapping[str, Any], place: str, found: list[Problem]) -> float:
    if ("radius" in row) == ("curvature" in row):
        what = "both are given; drop one" if "radius" in row else 'is missing; add e.g. radius = "51.5 mm", or "inf"'
        found.append(Problem(f"{place}.radius", what if "radius" not in row else f"radius and curvature: {what}"))
        return 0.0
    if "curvature" in row:
        return _inverse_length(row["curvature"], -1, f"{place}.curvature", found)
    text = row["radius"]
    if isinstance(text, str) and text.strip().lower().removesuffix("mm").strip() in ("inf", "+inf", "-inf", "infinity"):
        return 0.0
    before = len(found)
    radius = _length(row, "radius", place, found)
    if len(found) == before and radius == 0:
        found.append(Problem(f"{place}.radius", '"0 mm" is a point; write "inf" for a plane'))
    return 0.0 if len(found) > before else 1 / radius


def _inverse_length(text: Any, power: int, place: str, found: list[Problem]) -> float:
    match = _POWER.fullmatch(text) if isinstance(text, str) else None
    if match is None or int(match[2]) != power:
        unit = f"mm^{power}"
        found.append(Problem(place, f'expected a number of {unit} such as "1.2e-5 {unit}", got {text!r}'))
        return 0.0
    return float(match[1])


def _asphere(value: Any, place: str, found: list[Problem]) -> tuple[float, ...]:
    table = _table(value, place, found)
    powers = [f"r{2 * i}" for i in range(1, ASPHERE_TERMS + 1)]
    found += _unknown(place, table, powers)
    terms = [
        _inverse_length(table[key], 1 - 2 * i, f"{place}.{key}", found) if key in table else 0.0
        for i, key in enumerate(powers, start=1)
    ]
    while terms and terms[-1] == 0:
        terms.pop()
    return tuple(terms)


def _tuple(
    row: Mapping[str, Any], key: str, count: int, dimension: str, place: str, found: list[Problem]
) -> tuple[float, ...]:
    values = row.get(key, None)
    if values is None:
        return (0.0,) * count
    if not isinstance(values, list) or len(values) != count:
        found.append(Problem(f"{place}.{key}", f"must be a list of {count} {dimension}s, got {values!r}"))
        return (0.0,) * count
    out = []
    for value in values:
        try:
            out.append(parse_quantity(value, dimension))
        except ValueError as error:
            found.append(Problem(f"{place}.{key}", str(error)))
            out.append(0.0)
    return tuple(out)


def dumps_lens(lens: Prescription) -> str:
    """Write a lens as TOML text that `loads_lens` turns into an equal lens."""
    import tomli_w

    return tomli_w.dumps(table_of(lens))


def table_of(lens: Prescription) -> dict[str, Any]:
    """The nested values of a lens file that `lens_of` turns into an equal lens."""
    data: dict[str, Any] = {key: text for key in ("name", "source") if (text := getattr(lens, key))}
    if lens.wavelength is not None:
        data["wavelength"] = format_quantity(lens.wavelength, "length")
    data["surfaces"] = [_row(surface) for surface in lens.surfaces]
    own = {s.glass.name: replace(s.glass, offset=0.0) for s in lens.surfaces if s.glass.name.upper() not in catalogue()}
    if own:
        data["glasses"] = {name: _glass_table(glass) for name, glass in own.items()}
    return data


def _row(surface: Surface) -> dict[str, Any]:
    row: dict[str, Any] = _radius_text(surface.curvature)
    if surface.thickness:
        row["thickness"] = format_quantity(surface.thickness, "length")
    if surface.glass != AIR:
        row["glass"] = surface.glass.name
    if surface.glass.offset:
        row["index_offset"] = surface.glass.offset
    row["diameter"] = format_quantity(2 * surface.semi_diameter, "length")
    if surface.conic:
        row["conic"] = surface.conic
    terms = {f"r{2 * i}": f"{a!r} mm^{1 - 2 * i}" for i, a in enumerate(surface.asphere, start=1) if a}
    if terms:
        row["asphere"] = terms
    if any(surface.shift):
        row["shift"] = [format_quantity(value, "length") for value in surface.shift]
    if any(surface.tilt):
        row["tilt"] = [format_quantity(value, "angle") for value in surface.tilt]
    return row


def _radius_text(curvature: float) -> dict[str, Any]:
    """The shortest radius whose reciprocal is this very curvature, else the curvature itself."""
    if curvature == 0:
        return {"radius": "inf"}
    for digits in range(1, 18):
        radius = float(f"{1 / curvature:.{digits}g}")
        if 1 / radius == curvature:
            return {"radius": format_quantity(radius, "length")}
    return {"curvature": f"{Decimal(repr(curvature))} mm^-1"}


def _glass_table(glass: Glass) -> dict[str, Any]:
    table: dict[str, Any] = {"formula": glass.formula}
    if glass.formula == "sellmeier":
        table |= {"b": list(glass.coefficients[::2]), "c": list(glass.coefficients[1::2])}
    elif glass.formula == "schott":
        table["a"] = list(glass.coefficients)
    else:
        table["index"] = glass.coefficients[0]
    if math.isfinite(glass.longest):
        table["range"] = [format_quantity(glass.shortest, "length"), format_quantity(glass.longest, "length")]
    if glass.source:
        table["source"] = glass.source
    return table
