"""Pydantic's findings, told in the words of a design file: place, value, remedy, nearest known key."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from .check import CONJUGATES, cross_check
from .errors import Problem
from .units import Distance, Length

REMEDIES = {
    "missing": "is missing; add it",
    "greater_than": "must be greater than zero",
    "greater_than_equal": "must not be negative",
}


def problems_of(
    error: ValidationError, data: Mapping[str, Any], model: type[BaseModel], *, from_file: bool
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
    """
    # A fault of the whole (empty place) comes from the cross-check, which is told here with the places it found.
    found = [_problem(detail, model) for detail in error.errors(include_url=False) if detail["loc"]]
    readable = dict(_readable(data, from_file))
    return (*found, *cross_check(readable))


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
    needed = ", ".join(name for name, field in inner.model_fields.items() if field.is_required())
    return f"is missing; add the table [{'.'.join(map(str, place))}] with {needed}"


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
