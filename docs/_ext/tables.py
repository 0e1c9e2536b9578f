"""Tables of keys from the code that reads or writes them: pydantic models of files, dataclasses of results."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

from roslf_design.evaluation.groups import Numbers
from roslf_design.reporting.keys import NEEDED, KeyTable, UndescribedError, descriptions
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.words import sentence


def keys_table(table: KeyTable) -> str:
    """A file's table: key, what it takes, default, meaning."""
    rows = (
        (code(key.name), key.takes, f"**{NEEDED}**" if key.default == NEEDED else key.default, plain(key.meaning))
        for key in table.rows()
    )
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
    return " ".join(inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].split())


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
