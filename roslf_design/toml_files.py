"""TOML files of every kind (designs, lenses, scenes, studies, stories, catalogues): read, and their faults told.

Every fault at once, each with its place in the file, the value, the remedy and, of a key that is not known, the nearest
that is.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import InputError, Problem

REMEDIES = {
    "missing": "is missing; add it",
    "greater_than": "must be greater than zero",
    "greater_than_equal": "must not be negative",
}


def read_toml(
    path: Path, origin: str, missing: str = "check the path", *, refusal: type[InputError] = InputError
) -> dict[str, Any]:
    """The nested values of a TOML file, with one clear error for a file that cannot be read.

    Parameters
    ----------
    path : Path
        The file.
    origin : str
        What errors call it.
    missing : str
        What to do where there is no such file.
    refusal : type
        What is raised: the `InputError` of this kind of file.

    Raises
    ------
    InputError
        Missing, not a file, not readable, not UTF-8, not TOML.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        message = f"no such file; {missing}"
    except IsADirectoryError:
        message = "is a folder; name the file inside it"
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start}); expected a TOML file"
    except OSError as error:
        message = f"cannot be read: {error.strerror}; check its permissions"
    else:
        return parse_toml(text, origin, refusal=refusal)
    raise refusal((Problem("", message),), origin)


def parse_toml(text: str, origin: str, *, refusal: type[InputError] = InputError) -> dict[str, Any]:
    """The nested values of TOML text; `origin` is what errors call it, `refusal` what is raised where it is no TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        detail = str(error)
        message = f"is not valid TOML: {detail[:1].lower()}{detail[1:]}; mend the line named"
        raise refusal((Problem("", message),), origin) from None


def nearest(name: str, known: Collection[str], otherwise: str = "") -> str:
    """What was perhaps meant by a name that is not known; else `otherwise`, or all that is known."""
    near = difflib.get_close_matches(name, known, 1, 0.5)
    return f"did you mean '{near[0]}'?" if near else otherwise or f"known here: {', '.join(known)}"


def problems_of(error: ValidationError, model: type[BaseModel]) -> tuple[Problem, ...]:
    """What pydantic found wrong with nested values, in the words of a file.

    Parameters
    ----------
    error : ValidationError
        What pydantic raised.
    model : type
        The model they were validated against, for its known keys.
    """
    return tuple(
        problem
        for detail in error.errors(include_url=False)
        for problem in (_problems_within(detail) or [_problem(detail, model)])
    )


def _problems_within(detail: ErrorDetails) -> list[Problem]:
    """Faults of another file that a key names, each a line of its own: the file, the place in it, what is wrong."""
    error = detail.get("ctx", {}).get("error")
    if not isinstance(error, InputError):
        return []
    key = ".".join(str(step) for step in detail["loc"])
    return [Problem(key, str(InputError((problem,), error.origin))) for problem in error.problems]


def _problem(detail: ErrorDetails, model: type[BaseModel]) -> Problem:
    place = tuple(detail["loc"])
    key = ".".join(str(step) for step in place)
    kind, value = detail["type"], detail["input"]
    if kind == "extra_forbidden":
        return Problem(key, "is not a known key; " + nearest(str(place[-1]), _known_keys(model, place[:-1])))
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
