"""`roslf catalogue`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from ..catalogue import KINDS, Kind, load_catalogue, parse_condition, read_condition, rows
from ..catalogue.entries import ELECTRONS, NAMED
from ..lenses.glass import catalogue as materials
from ..lenses.lens_file import shipped_names
from ..lenses.solid import opaque_solids
from ..tables import Table, print_table
from .terminal import Json, Repeated, json_text, say

SHOWN: dict[Kind, tuple[str, ...]] = {
    "lenses": ("diameter", "clear_aperture", "focal_length", "prescription"),
    "microlens_arrays": ("pitch", "layout", "lens_shape", "focal_length", "effective_focal_length", "size"),
    "sensors": ("pixel", "pixels", "size", "filters", "package", "acceptance", *ELECTRONS),
    "windows": ("material", "diameter", "clear_aperture", "thickness"),
}
"""Columns of each kind, but those in which no part has anything."""
SORTED: dict[Kind, tuple[str, ...]] = {
    "lenses": ("focal_length", "diameter"),
    "microlens_arrays": ("pitch", "focal_length"),
    "sensors": ("size",),
    "windows": ("diameter", "thickness"),
}
"""Keys by which parts of each kind are sorted, the least first."""
TRACED = [name.upper() for name in shipped_names()]
"""Lenses that ship with their surfaces."""


def catalogue(
    *,
    kind: Annotated[list[Kind | Literal["arrays"]] | None, Parameter(negative=())] = None,
    where: Repeated = None,
    file: Annotated[list[Path] | None, Parameter(negative=())] = None,
    json: Json = False,
) -> None:
    """Parts that can be bought, with where their figures come from and how sure they are.

    Example: roslf catalogue --kind lenses --where "focal_length<=100 mm" --where "diameter=25.4 mm"

    Parameters
    ----------
    kind
        Only these kinds, arrays being microlens_arrays; may be given several times.
    where
        A condition on a key: =, <, <=, > or >=, with a length as text ("pitch<150 um") or words ("maker=Thorlabs");
        may be given several times, and all must hold. Parts without the key are left out.
    file
        Further catalogue files of your own, in the same format.
    """
    conditions = {text: read_condition(text) for text in where or []}
    known = load_catalogue(file or [])
    kinds = ["microlens_arrays" if one == "arrays" else one for one in kind or KINDS]
    every = sorted(rows(known, kinds), key=_rank)
    chosen = [row for row in every if all(condition(row) for condition in conditions.values())]
    if json:
        print(json_text({"schema": "roslf.catalogue/1", "parts": chosen, "prescriptions": TRACED, "solids": _solids()}))
        return
    from rich.console import Console

    console = Console()
    notes: list[str] = []
    for name in KINDS:
        lines, own = [], [row for row in chosen if row["kind"] == name]
        shown = [key for key in SHOWN[name] if any(row.get(key) is not None for row in own)]
        units = {key: _unit(own, key) for key in shown}
        for row in own:
            read = " ".join(filter(None, (row.get("page"), f"read {row['read']}" if "read" in row else "")))
            note = "; ".join(filter(None, (row["provenance"], read, row.get("remark"))))
            if row.get("clear_aperture_assumed"):
                note += "; clear aperture taken as 90 % of the diameter"
            if note not in notes:
                notes.append(note)
            cells = [_cell(row, key, units[key]) for key in shown]
            lines.append((row["part"], row.get("maker", ""), *cells, row["confidence"], str(1 + notes.index(note))))
        if lines:
            heads = ("part", "maker", *(key.replace("_", " ") for key in shown), "confidence", "note")
            print_table(Table(tuple(lines), "l" * len(heads), heads, name.replace("_", " ")), console)
    if whole := kind is None and not conditions:
        heads = ("solid", "taken as", "other names", "expansion", "note")
        lines = []
        for solid in _solids():
            notes += [solid["source"]] * (solid["source"] not in notes)
            grown, note = f"{1e6 * solid['expansion_per_k']:.4g}e-6 /K", str(1 + notes.index(solid["source"]))
            lines.append((solid["name"], solid["grade"], ", ".join(solid["also"]), grown, note))
        print_table(Table(tuple(lines), "l" * len(heads), heads, "solids of housings and packages"), console)
    first = {row["kind"]: row["part"] for row in chosen[::-1]}
    if first:
        print("\nA design that names a part has from it what its own table leaves out:")
    for place, name in NAMED.items():
        for part in [part for part in known.of(name) if part.part == first.get(name)]:
            given = ", ".join(part.table)
            print(f"\n{_head(place)}\npart = {_named(name, part.part, file or [])}  # gives {given}")
    print()
    for number, note in enumerate(notes, 1):
        say(f"{number}  {note}")
    if any(row["kind"] == "lenses" for row in chosen):
        print("\nLenses with a prescription are traced behind main_lens.prescription; of the others f and D are known.")
    if any(row["kind"] == "sensors" for row in chosen):
        print("\nNo cover glass is stated: most sensors have one; sensor.cover gives it, and d_2 has to hold it.")
    if whole:
        print(
            f"\nMaterials by name: {', '.join(sorted({glass.name for glass in materials().values()}, key=str.lower))}."
        )
    if not chosen:
        for text, condition in conditions.items():
            say(f'"{text}" holds for {sum(map(condition, every))} of {len(every)} parts{_theirs(every, text)}')
    print(f"\n{len(chosen)} part{'s' * (len(chosen) != 1)}. Add your own with --file, or in a study.")


def _solids() -> list[dict[str, Any]]:
    """Solids of housings by name, with their other names, expansion and source; glasses have theirs as materials."""
    each: dict[str, list[str]] = {}
    known = opaque_solids()
    for name, solid in known.items():
        each.setdefault(f"{solid.expansion!r} {solid.source}", []).append(name)
    return [
        {
            "name": (own := known[names[0]]).name,
            "grade": own.grade,
            "also": names[1:],
            "expansion_per_k": own.expansion,
            "source": own.source,
        }
        for names in each.values()
    ]


def _head(place: str) -> str:
    """Head of a table of a design that may name a part."""
    return '[[elements]]\nkind = "plate"' if place == "elements" else f"[{place}]"


def _named(kind: Kind, part: str, files: Sequence[Path]) -> str:
    """Value of `part` in a design: its name, of one in a file of the user's with that."""
    name = json_text(part).strip()
    own = [path for path in files if part in (one.part for one in load_catalogue([path], shipped=False).of(kind))]
    return f"{{file = {json_text(str(own[0])).strip()}, name = {name}}}" if own else name


def _theirs(every: Sequence[Mapping[str, Any]], text: str) -> str:
    """Clause with the least and the largest value of the key that a condition asks for; empty where it has words."""
    key = parse_condition(text)[0]
    own = [row for row in every if isinstance(row.get(key), (int, float, list, tuple))]
    if not own:
        return ""
    each = sorted(own, key=lambda row: float(np.max(row[key])))
    least, largest = (_cell(row, key, _unit(own, key)) for row in (each[0], each[-1]))
    return f"; {len(own)} have such a value, from {least} to {largest}"


def _rank(row: Mapping[str, Any]) -> tuple[int, list[float]]:
    """Place of a part in the list: its kind, then what those of its kind are sorted by."""
    kind: Kind = row["kind"]
    return KINDS.index(kind), [float(number) for key in SORTED[kind] for number in np.ravel(row[key])]


def _unit(rows: Sequence[Mapping[str, Any]], key: str) -> tuple[float, str]:
    """Factor and unit of all lengths of a column: micrometres where each is below a millimetre."""
    values = [row[key] for row in rows if isinstance(row.get(key), (int, float, list, tuple))]
    return (1e3, "um") if values and np.max(np.hstack(values)) < 1 else (1.0, "mm")


def _cell(row: Mapping[str, Any], key: str, unit: tuple[float, str]) -> str:
    value = row.get(key)
    if value is None:
        return "not stated" if key in ("package", "acceptance", *ELECTRONS) else ""
    if isinstance(value, str):
        return value
    if key == "acceptance":
        return f"{math.degrees(value):.4g} deg"
    if key in ELECTRONS:
        return f"{value:.6g} e-"
    if key == "pixels":
        return " x ".join(str(number) for number in value)
    numbers = value if isinstance(value, (list, tuple)) else [value]
    return " x ".join(f"{unit[0] * number:.6g} {unit[1]}" for number in numbers)
