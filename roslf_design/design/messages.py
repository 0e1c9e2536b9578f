"""A design's faults: those of its file, and those between the values that could be read all the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from ..errors import Problem
from ..toml_files import problems_of
from ..units import Distance, Length
from .check import cross_check
from .conjugates import CONJUGATES
from .parts import Light
from .real_lens import focal_length_at, lens_problems, read_prescription


def design_problems(
    error: ValidationError,
    data: Mapping[str, Any],
    model: type[BaseModel],
    *,
    from_file: bool,
    folder: str | Path = "",
) -> tuple[Problem, ...]:
    """Every fault that pydantic found, and those between the values that could be read all the same.

    Parameters
    ----------
    error : ValidationError
        What pydantic raised.
    data : mapping
        The nested values that were validated.
    model : type
        The model they were validated against, for its known keys.
    from_file : bool
        Whether numbers need units.
    folder : path-like
        What the path of a lens file counts from.
    """
    # A fault of the whole (empty place) comes from the cross-check, which is told here with the places it found.
    found = [problem for problem in problems_of(error, model) if problem.key]
    readable = dict(_readable(data, from_file))
    lens = data.get("main_lens")
    if isinstance(lens, Mapping) and (lens.get("prescription") is not None or lens.get("reversed")):
        faults, focal_length = _about_lens(data, lens, readable, from_file, folder)
        if focal_length is None:
            readable.pop(CONJUGATES[0], None)
        else:
            readable[CONJUGATES[0]] = focal_length
        found += faults
    return (*found, *cross_check(readable))


def _about_lens(
    data: Mapping[str, Any],
    given: Mapping[str, Any],
    readable: Mapping[str, float | None],
    from_file: bool,
    folder: str | Path,
) -> tuple[list[Problem], float | None]:
    """What a real main lens contradicts, and its focal length [mm]; None where it or its wavelength is not readable."""
    light = data.get("light", {})
    wavelength = light.get("wavelength", Light().wavelength) if isinstance(light, Mapping) else None
    context = {"from_file": from_file and isinstance(light, Mapping) and "wavelength" in light}
    turned = given.get("reversed", False) is True
    try:
        lens = read_prescription(given.get("prescription"), folder)
        colour = TypeAdapter(Length).validate_python(wavelength, context=context)
        wide = given.get("diameter")
        if wide is not None:
            wide = TypeAdapter(Length).validate_python(wide, context={"from_file": from_file})
    except (ValueError, ValidationError):  # told already, under its own key
        return [], None
    faults = list(lens_problems(lens, turned, colour, readable.get(CONJUGATES[0]), wide))
    if lens is None:
        return faults, readable.get(CONJUGATES[0])
    return faults, None if faults else focal_length_at(lens, colour)


def _readable(data: Mapping[str, Any], from_file: bool) -> Iterator[tuple[str, float | None]]:
    places = [*((key, Length) for key in CONJUGATES), ("aperture.distance", Distance)]
    stops = data.get("stops")
    if isinstance(stops, (list, tuple)):
        places += [(f"stops.{index}.distance", Distance) for index in range(len(stops))]
    for key, kind in places:
        part, _, name = key.rpartition(".")
        table: Any = data
        for step in part.split("."):
            if isinstance(table, (list, tuple)):
                table = table[int(step)]
            else:
                table = table.get(step) if isinstance(table, Mapping) else None
        if not isinstance(table, Mapping):
            continue
        if table.get(name) is None:
            yield key, None
            continue
        try:
            yield key, TypeAdapter(kind).validate_python(table[name], context={"from_file": from_file})
        except ValidationError:
            continue
