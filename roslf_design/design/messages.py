"""Pydantic's findings, told in the words of a design file: place, value, remedy, nearest known key."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from .check import cross_check
from .conjugates import CONJUGATES
from .errors import InputError, Problem
from .parts import Light
from .real_lens import focal_length_at, lens_problems, read_prescription
from .units import Distance, Length

REMEDIES = {
    "missing": "is missing; add it",
    "greater_than": "must be greater than zero",
    "greater_than_equal": "must not be negative",
}


def problems_of(
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
    found = [
        problem
        for detail in error.errors(include_url=False)
        if detail["loc"]
        for problem in (_problems_within(detail) or [_problem(detail, model)])
    ]
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


def _problems_within(detail: ErrorDetails) -> list[Problem]:
    """Faults of another file that a key names, each a line of its own: the file, the place in it, what is wrong."""
    error = detail.get("ctx", {}).get("error")
    if not isinstance(error, InputError):
        return []
    key = ".".join(str(step) for step in detail["loc"])
    return [Problem(key, str(InputError((problem,), error.origin))) for problem in error.problems]


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


def _problem(detail: ErrorDetails, model: type[BaseModel]) -> Problem:
    place = tuple(detail["loc"])
    key = ".".join(str(step) for step in place)
    kind, value = detail["type"], detail["input"]
    if kind == "extra_forbidden":
        return Problem(key, "is not a known key; " + _nearest(str(place[-1]), _known_keys(model, place[:-1])))
    if kind == "missing":
        return Problem(key, _missing(model, place))
    if kind == "value_error":
        return Problem(key, detail["msg"].removeprefix("Value error, "))
    if kind in REMEDIES:
        return Problem(key, f'"{value}" {REMEDIES[kind]}')
    if kind == "literal_error":
        return Problem(key, f'"{value}" is not known; write {detail["ctx"]["expected"]}')
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return Problem(key, f"must be a table of keys ([{key}] in the file), got {value!r}")
    return Problem(key, f"{detail['msg'][0].lower()}{detail['msg'][1:]}, got {value!r}")


def _nearest(name: str, known: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(name, known, 1, 0.5)
    return f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(known)}"


def _model_at(model: type[BaseModel], place: tuple[Any, ...]) -> type[BaseModel] | None:
    current: Any = model
    for step in place:
        if isinstance(step, int):
            continue
        if not (isinstance(current, type) and issubclass(current, BaseModel)) or step not in current.model_fields:
            return None
        current = current.model_fields[step].annotation
        current = next((part for part in get_args(current) if isinstance(part, type)), current)
    return current if isinstance(current, type) and issubclass(current, BaseModel) else None


def _known_keys(model: type[BaseModel], place: tuple[Any, ...]) -> tuple[str, ...]:
    found = _model_at(model, place)
    return tuple(found.model_fields) if found else ()


def _missing(model: type[BaseModel], place: tuple[Any, ...]) -> str:
    inner = _model_at(model, place)
    if inner is None:
        return "is missing; add it"
    # A default that is validated is none: it stands for a value that another key gives.
    fields = inner.model_fields.items()
    needed = ", ".join(name for name, field in fields if field.is_required() or field.validate_default)
    name = ".".join(map(str, place))
    table = f"[[{name}]]" if _is_list(model, place) else f"[{name}]"
    return f"is missing; add the table {table} with {needed}"


def _is_list(model: type[BaseModel], place: tuple[Any, ...]) -> bool:
    """Whether a key holds several tables, each headed by double brackets."""
    outer = _model_at(model, place[:-1]) if place[:-1] else model
    return outer is not None and get_origin(outer.model_fields[place[-1]].annotation) in (list, tuple)


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
