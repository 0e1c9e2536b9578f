"""Tables of keys from the code that reads or writes them: pydantic models of files, dataclasses of results."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from sphinx.pycode import ModuleAnalyzer

from roslf_design.bore.real_lens import Lens
from roslf_design.evaluation.groups import Numbers
from roslf_design.lenses.glass import Glass
from roslf_design.lenses.material import Material
from roslf_design.lenses.solid import Solid
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.study import FieldPlace
from roslf_design.units import (
    Angle,
    AnyLength,
    Distance,
    Gradient,
    Illuminance,
    Length,
    Radiance,
    Temperature,
    Time,
    format_quantity,
)
from roslf_design.words import sentence

LENGTHS = ((Length, "length\u00a0>\u00a00"), (Distance, "length\u00a0≥\u00a00"), (AnyLength, "length"))
OTHERS = (
    (Angle, "angle"),
    (Illuminance, "illuminance"),
    (Radiance, "radiance"),
    (Time, "time"),
    (Temperature, "temperature"),
)


class UndescribedError(ValueError):
    """A key that neither the code nor the page says anything about."""


def descriptions(kind: type) -> dict[str, str]:
    """What the code says of each field, from the text below it; of base classes too."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if base.__module__.startswith("roslf_design"):
            notes = ModuleAnalyzer.for_module(base.__module__).find_attr_docs()
            found |= {name: _one_line(lines) for (owner, name), lines in notes.items() if owner == base.__qualname__}
    return found


def _one_line(lines: Iterable[str]) -> str:
    return " ".join(line.strip() for line in lines if line.strip())


def keys_table(model: type[BaseModel], own: Mapping[str, str] = {}) -> str:
    """A file's table: key, what it takes, default, meaning.

    Parameters
    ----------
    model : type
        The model that reads the table.
    own : mapping
        What to say of keys that the code leaves undescribed, or says in words that need the code.
    """
    options = {name: field.description for name, field in model.model_fields.items() if field.description}
    told = descriptions(model) | options | own
    hints = get_type_hints(model, include_extras=True)
    rows = []
    for name, field in model.model_fields.items():
        if name == "kind":
            (called,) = get_args(hints[name])
            rows.append((code(name), code(f'"{called}"'), "**needed**", "which of these it is"))
            continue
        if name not in told:
            raise UndescribedError(f"{model.__name__}.{name} is described neither in the code nor on the page")
        needed = field.is_required() or field.validate_default
        default = "**needed**" if needed else _default(field.get_default(call_default_factory=True), hints[name])
        # In a file a length carries its own unit.
        meaning = re.sub(
            r" ?\[(mm|rad|lx|s|W/m\^2/sr|degrees C)\]", "", re.sub(r"\bNone\b", "left out", told[name])
        ).strip(" .")
        meaning = f"{meaning or name.replace('_', ' ').capitalize()}."
        rows.append((code(name), takes(hints[name]), default, plain(meaning)))
    return markdown(("key", "takes", "default", "meaning"), rows)


NOT_THERE = "-"


def results_table(example: Any, own: Mapping[str, str]) -> str:
    """A result's JSON keys, nested ones under their path.

    Parameters
    ----------
    example : any
        Of the dataclass that becomes the JSON object; groups of numbers have the quantities that they have there.
    own : mapping
        What to say of paths that the code leaves undescribed; `NOT_THERE` of what has no key.
    """
    rows = [
        (key, shape, _as_json(about or own.get(key, "")))
        for key, shape, about in _result_rows(type(example), "", example)
        if own.get(key.split(".")[0]) != NOT_THERE
    ]
    blank = [key for key, _, about in rows if not about]
    if blank:
        raise UndescribedError(f"described neither in the code nor on the page: {', '.join(blank)}")
    return markdown(("key", "type", "meaning"), ((code(key), shape, plain(about)) for key, shape, about in rows))


def _as_json(text: str) -> str:
    text = re.sub(r"\bNone\b", "null", text)
    return re.sub(r"\b([Ii])nfinite\b", lambda m: ("Null" if m[1] == "I" else "null") + " (infinite)", text)


def _result_rows(kind: type, prefix: str, example: Any = None) -> Iterator[tuple[str, str, str]]:
    told = descriptions(kind)
    hints = get_type_hints(kind)
    for field in fields(kind):
        hint = hints[field.name]
        inner, many, optional = _unwrapped(hint)
        about = told.get(field.name, "")
        if inner is Numbers:
            yield prefix + field.name, "object", about
            yield from _number_rows(field.name, getattr(example, field.name))
        elif is_dataclass(inner):
            summary = _first_paragraph(inner)
            about = f"{about} {summary}".strip() if about != summary else about
            shape = "list of objects" if many else "object"
            yield prefix + field.name, shape + (" or null" if optional else ""), about
            yield from _result_rows(inner, f"{prefix}{field.name}{'[]' if many else ''}.")
        else:
            yield prefix + field.name, _json_type(hint), about


def _number_rows(group: str, numbers: Numbers) -> Iterator[tuple[str, str, str]]:
    listed = [q for q in QUANTITIES.values() if q.evaluated is not None and q.evaluated.under == group]
    words = {q.evaluated.key or q.name: f"{q.words}{f' ({q.equation})' if q.equation else ''}" for q in listed}
    for key, value in numbers.items():
        place, about = f"{group}.{key}", sentence(words.get(key, ""))
        if is_dataclass(value):
            yield place, "object or null", _first_paragraph(type(value))
            yield from _result_rows(type(value), f"{place}.")
        else:
            yield place, _json_type(type(value)), about


def _first_paragraph(kind: type) -> str:
    return _one_line(inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].splitlines())


def _unwrapped(hint: Any) -> tuple[Any, bool, bool]:
    optional = False
    if get_origin(hint) in (Union, types.UnionType):
        rest = [part for part in get_args(hint) if part is not type(None)]
        optional = len(rest) < len(get_args(hint))
        hint = rest[0]
    if get_origin(hint) is tuple and get_args(hint)[-1] is Ellipsis:
        return get_args(hint)[0], True, optional
    return hint, False, optional


def _json_type(hint: Any) -> str:
    inner, many, optional = _unwrapped(hint)
    if get_origin(inner) is tuple:
        text = f"[{', '.join(_json_type(part) for part in get_args(inner))}]"
    else:
        text = {float: "number", int: "integer", bool: "boolean", str: "text"}.get(inner, "value")
    text = f"list of {text}s" if many else text
    return f"{text} or null" if optional else text


def takes(hint: Any) -> str:
    """What a key may hold, in words."""
    for known, words in (*LENGTHS, *OTHERS):
        if hint == known:
            return words
    others = (
        (Lens, "text or table"),
        (FieldPlace, "name or [length, length]"),
        (Material, "name or table"),
        (Gradient, "per length\u00a0>\u00a00"),
    )
    for known, words in others:
        if hint == known:
            return words
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        words, limits = takes(parts[0]), _limits(parts[1:])
        return f"{words} {limits}" if limits else words
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(takes(part) for part in parts if part is not type(None)))
    if origin is Literal:
        return " or ".join(code(f'"{part}"' if isinstance(part, str) else str(part)) for part in parts)
    if origin is tuple:
        words = takes(parts[0])
        if parts[-1] is Ellipsis:
            return "tables" if words == "table" else f"list of {words}"
        return f"[{words}, {words}]" if set(parts) == {parts[0]} else f"[{', '.join(map(takes, parts))}]"
    if origin is dict:
        return "table"
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return "table"
    simple = {float: "number", int: "whole number", bool: "`true` or `false`", str: "text", Any: "text or number"}
    return simple.get(hint, getattr(hint, "__name__", str(hint)).lower())


def _limits(constraints: Iterable[Any]) -> str:
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    found = []
    for constraint in constraints:
        for part in getattr(constraint, "metadata", [constraint]):
            found += [
                f"{s}\u00a0{_number(getattr(part, n))}" for n, s in signs.items() if getattr(part, n, None) is not None
            ]
    return ", ".join(found)


def _number(value: float) -> str:
    return f"{value:.0e}".replace("e+", "e") if isinstance(value, int) and value > 10**6 else f"{value:,}"


def _default(value: Any, hint: Any) -> str:
    if value is PydanticUndefined or value is None:
        return "none"
    if isinstance(value, bool):
        return code(str(value).lower())
    if isinstance(value, BaseModel) or (isinstance(value, tuple) and value and isinstance(value[0], BaseModel)):
        return "as below" if isinstance(value, BaseModel) else "a white field"
    if value == () or value == {}:
        return "none"
    if isinstance(value, tuple):
        unit = "length" if takes(get_args(hint)[0]).startswith("length") else "angle"
        texts = [
            f'"{format_quantity(v, unit)}"' if isinstance(v, float) and "le" in takes(hint) else repr(v) for v in value
        ]
        return code("[" + ", ".join(texts).replace("'", '"') + "]")
    for known, words in (*LENGTHS, *OTHERS):
        if hint == known:
            return code(f'"{format_quantity(value, words.partition(chr(0xA0))[0])}"')
    if isinstance(value, (Glass, Solid)):
        return code(f'"{value.name}"')
    return code(f'"{value}"' if isinstance(value, str) and value else '""' if value == "" else f"{value:g}")


def markdown(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; bars within cells are kept."""
    lines = [list(heads), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def code(text: str) -> str:
    """As code."""
    return f"`{text}`"


def plain(text: str) -> str:
    """Words of a docstring as Markdown: stars and dollars are meant as such, double backticks are code."""
    text = re.sub(r"``(.+?)``", r"`\1`", text)
    parts = re.split(r"(`[^`]*`)", text)
    safe = (p if i % 2 else re.sub(r"([*$\[\]<_])", r"\\\1", p) for i, p in enumerate(parts))
    return "".join(safe)
