"""TOML files of every kind (designs, lenses, scenes, studies, stories, catalogues): read, and their faults told.

Every fault at once, each with its place in the file, the value, the remedy and, of a key that is not known, the nearest
that is.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from itertools import accumulate, chain
from operator import eq, ne
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from .errors import InputError, Problem
from .input_files import read_text, strange

Model = TypeVar("Model", bound=BaseModel)
FROM_ZERO = {"greater_than": "must be greater than zero", "greater_than_equal": "must not be negative"}
"""Messages about a value below its least, where that is 0."""
BOUNDS = {"greater_than": "above", "greater_than_equal": "at least", "less_than": "below", "less_than_equal": "at most"}
"""Words for a bound, by the kind of fault and as pydantic calls it."""
ELSEWHERE = {
    "metric": "quantity", "glass": "material", "material": "glass", "lambda": "wavelength",
    "resolution": "pixels", "pixel_size": "pixel", "position": "distance", "qe": "quantum_efficiency",
    "fov": "field_of_view_deg", "dof": "depth_of_field_far_mm", "mtf": "mtf50_lp_per_mm",
    "model": "part", "product": "part",
    "detail": "detail_lp_per_mm",
}  # fmt: skip
"""Keys and quantities that files of one kind, or people, call so, and others otherwise."""
TYPES = {
    "string_type": "text",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a finite number without a unit",
    "float_parsing": "a finite number without a unit",
    "finite_number": "a finite number without a unit",
    "list_type": "a list",
    "tuple_type": "a list",
}
"""Words for what a value must be, by the kind of fault."""
SLIP, LEAST = 0.75, 0.65
"""Likeness of letters from which a name is another one, mistyped; and from which it may be, where no word is shared."""
KIND = "kind"
"""Key that tells which table one is, where it may be several."""
TAG = "%"
"""Prefix that pydantic puts before the kind of a value that may be a name or a table."""


class StrictTable(BaseModel):
    """Base of every table of a file: frozen, unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    if not TYPE_CHECKING:  # to which fields are the arguments

        def __init__(self, **data: Any) -> None:
            try:
                super().__init__(**data)
            except ValidationError as error:
                raise self._refused(error, data) from None

        # Not an initialiser of its own to pydantic, which would otherwise lose the context of `model_validate` over it.
        __init__.__pydantic_base_init__ = True

    @classmethod
    def _refused(cls, error: ValidationError, data: Mapping[str, Any]) -> InputError:
        """Error for values that make no such table, in the words of a file."""
        return InputError(problems_of(error, cls))


PlainNumber = Annotated[float, Field(strict=True)]
"""A number that is not written as text."""


class Instance:
    """Mark of a type whose values a validator makes: pydantic's own `InstanceOf` also builds a reader of its fields."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: type, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.is_instance_schema(source)


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
        As for `read_text`; not TOML, or with values that nothing means: see `strange`.
    """
    return parse_toml(read_text(path, origin, "TOML", missing, refusal=refusal), origin, refusal=refusal)


def parse_toml(text: str, origin: str, *, refusal: type[InputError] = InputError) -> dict[str, Any]:
    """The nested values of TOML text; `origin` is what errors call it, `refusal` what is raised where it is no TOML."""
    try:
        data = tomllib.loads(text)
        message = strange(data)
    except tomllib.TOMLDecodeError as error:
        detail = str(error)
        message = f"is not valid TOML: {detail[:1].lower()}{detail[1:]}; mend the line named"
    except ValueError:  # Python reads no whole number of more than 4300 digits
        message = "is not valid TOML: a whole number has thousands of digits; write a smaller one"
    except RecursionError:
        message = "is not valid TOML: its tables or lists lie too deep within each other; leave the inner ones out"
    if message:
        raise refusal((Problem("", message),), origin)
    return data


def nearest(
    name: str,
    known: Collection[str],
    otherwise: str = "",
    meanings: Mapping[str, str] | None = None,
    least: float = LEAST,
) -> str:
    """Suggestion for a name that is not known; else `otherwise`, or all that is known.

    A slip of the pen counts first, then words that a name shares with others and with their `meanings`, then letters,
    alike by `least`.
    """
    other = difflib.get_close_matches(name, [one for one in ELSEWHERE if ELSEWHERE[one] in known], 1, SLIP)
    name = ELSEWHERE[other[0]] if other and name not in known else name
    near = difflib.get_close_matches(name, known, 20, SLIP)
    near.sort(
        key=lambda one: (
            -difflib.SequenceMatcher(None, one, name).ratio(),
            sum(map(ne, one, name)),
            -sum(accumulate(map(eq, one, name), min)),  # letters alike from the first on
        )
    )
    near = near[:1] or _alike(name, meanings or dict.fromkeys(known, ""))
    near = near or difflib.get_close_matches(name, known, 1, least)
    return f"did you mean {' or '.join(map(repr, near))}?" if near else otherwise or f"known here: {', '.join(known)}"


def _alike(name: str, meanings: Mapping[str, str]) -> list[str]:
    """Names that share most words with one, at most three; the shorter what stands behind a name, the better."""
    words = _words(name)
    both = {one: _words(f"{one} {meaning}") for one, meaning in meanings.items()}
    shared = {one: len(words & other) / len(words | other) for one, other in both.items() if words & other}
    best = max(shared.values(), default=0.0)
    near = [one for one in shared if shared[one] >= best / 2]
    return sorted(near, key=lambda one: (not meanings[one].lower().startswith(tuple(words)), -shared[one]))[:3]


def _words(text: str) -> set[str]:
    """Words of some length: no symbols, units or articles; "depth of field" is one, and no depth."""
    joined = re.sub(r"([a-z]+)[ _]of[ _]([a-z]+)", r"\1of\2", text.lower())
    return set(re.findall(r"[a-z]{4,}", joined))


def validated(
    model: type[Model], data: Any, origin: str = "", *, refusal: type[InputError] = InputError, **context: Any
) -> Model:
    """A file's nested values as their model; `context` is what its validators go by.

    Raises
    ------
    InputError
        Every fault of them; `origin` is what it calls the file, `refusal` the `InputError` of this kind of file.
    """
    try:
        return model.model_validate(data, context={"from_file": True, **context})
    except ValidationError as error:
        raise refusal(problems_of(error, model), origin) from None
    except UnicodeEncodeError as error:  # bytes of a command line that are no letters
        raise refusal((Problem("", f'"{error.object}" is no UTF-8 text; write it again'),), origin) from None


def problems_of(error: ValidationError, model: type[BaseModel]) -> tuple[Problem, ...]:
    """Problems that pydantic found with nested values, in the words of a file.

    Parameters
    ----------
    error : ValidationError
        What pydantic raised.
    model : type
        The model they were validated against, for its known keys.
    """
    details = error.errors(include_url=False)
    faulty = {detail["loc"][:-1] for detail in details}  # lists that pydantic calls short where entries are wrong
    told = [detail for detail in details if detail["type"] != "too_short" or detail["loc"] not in faulty]
    problems = (_problems_within(detail, model) or [_problem(detail, model)] for detail in told)
    return tuple(dict.fromkeys(chain.from_iterable(problems)))


def _problems_within(detail: ErrorDetails, model: type[BaseModel]) -> list[Problem]:
    """Faults of a table that reads itself, or of another file that a key names, each a line of its own."""
    error = detail.get("ctx", {}).get("error")
    if not isinstance(error, InputError):
        return []
    key = _at(model, detail["loc"]).key
    if error.origin or not key:
        return [Problem(key, str(InputError((problem,), error.origin))) for problem in error.problems]
    return [Problem(".".join(filter(None, (key, problem.key))), problem.message) for problem in error.problems]


def _problem(detail: ErrorDetails, model: type[BaseModel]) -> Problem:
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    at = _at(model, detail["loc"])
    key, name = at.key, str(detail["loc"][-1]) if detail["loc"] else ""
    if kind == "extra_forbidden":
        known = dict.fromkeys(key for table in _at(model, detail["loc"][:-1]).models for key in _keys(table))
        other = ELSEWHERE.get(name)
        if other in known:
            return Problem(key, f"is called {other} here")
        table, _, own = getattr(model, "SYMBOLS", {}).get(name, "").rpartition(".")
        if table:
            return Problem(key, f"is called {own} here" if f"{table}.{name}" == key else f"is {own} in [{table}]")
        tables = [_at(model, (table,)) for table in _keys(model)]
        holding = [table for table in tables if any(name in _keys(one) for one in table.models)]
        homes = [_head(table, name if table.key == detail["loc"][0] else "") for table in holding]
        remedy = f"it stands in {' or '.join(homes)}" if homes else nearest(name, known)
        return Problem(key, f"is not a known key; {remedy}")
    such_as = f" such as {json.dumps(at.examples[0])}" if at.examples else ""
    in_list = bool(detail["loc"]) and isinstance(detail["loc"][-1], int)
    if kind == "missing" and in_list:
        several = f"a list of {at.entries}" if at.entries else "a longer list"
        return Problem(key.rpartition(".")[0], f"must be {several}{such_as}, got {value!r}")
    if kind == "missing":
        return Problem(key, _missing(at, name))
    if kind == "value_error":
        return Problem(key, detail["msg"].removeprefix("Value error, "))
    if kind in BOUNDS:
        bound = next(iter(context.values()))
        below_zero = kind in FROM_ZERO and bound == 0
        return Problem(key, f'"{value}" ' + (FROM_ZERO[kind] if below_zero else f"must be {BOUNDS[kind]} {bound:g}"))
    if kind == "literal_error":
        return Problem(key, f'"{value}" is not known; write {context["expected"]}')
    if kind == "too_long":
        counts = f"{context['actual_length']} entries, at most {context['max_length']} can be used"
        return Problem(key, f"has {counts}; leave some out")
    if kind == "too_short" and context["actual_length"]:
        return Problem(key, f"has {context['actual_length']} of at least {context['min_length']} entries; add some")
    if kind.startswith("union_tag"):
        names = [_tag(one) for one in at.models]
        remedy = f"write one of {', '.join(names)}"
        tag = context.get("tag")
        fault = "is missing; " + remedy if tag is None else f'"{tag}" is not known; {nearest(str(tag), names, remedy)}'
        return Problem(f"{key}.{KIND}", fault)
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        head = f"[[{key.rpartition('.')[0]}]]" if at.listed else f"[{key}]"
        return Problem(key, f"must be a table of keys ({head} in the file), got {value!r}")
    if kind == "tuple_type" and at.models:
        return Problem(key, f"must be tables, each headed [[{key}]], got {value!r}")
    if kind in TYPES:
        several = f" of {at.entries}" if kind == "tuple_type" and at.entries else ""
        if several and isinstance(value, str) and not such_as:
            such_as = f" such as {json.dumps([value] * at.entries)}"
        return Problem(key, f"must be {TYPES[kind]}{several}{'' if in_list else such_as}, got {value!r}")
    return Problem(key, f"{detail['msg'][0].lower()}{detail['msg'][1:]}, got {value!r}")


class _Place(NamedTuple):
    """A place in a file, as its reader wrote it."""

    key: str
    """Dotted; without the kind that pydantic puts before each table that may be of several."""
    models: list[type[BaseModel]]
    """Models that may stand there: one table, or several; empty for values."""
    listed: bool
    """Whether there are several, each headed by double brackets."""
    entries: int
    """Count of a list of values that has just so many; 0 elsewhere."""
    examples: Sequence[Any]
    """Values that a field says could stand there."""


def _at(model: type[BaseModel], place: Sequence[int | str]) -> _Place:
    names: list[int | str] = []
    models, listed, entries = [model], False, 0
    examples: Sequence[Any] = ()
    named = False
    for step in place:
        if str(step).startswith(TAG):
            continue
        chosen = [one for one in models if _tag(one) == step] if len(models) > 1 else []
        if chosen:
            models = chosen
            continue
        names.append('""' if step == "" else step)
        if named:  # a key of one's own, of many tables alike
            named = False
        elif isinstance(step, str):
            field = _field(models[0], step) if len(models) == 1 else None
            kind = None if field is None else field.annotation
            models, entries = _tables(kind), _entries(kind)
            listed = get_origin(kind) in (list, tuple) or get_args(kind)[:1] == (int,)
            named = get_origin(kind) in (dict, Mapping) and get_args(kind)[:1] == (str,)
            examples = () if field is None else field.examples or ()
    return _Place(".".join(map(str, names)), models, listed, entries, examples)


def _head(place: _Place, key: str) -> str:
    """Head of a table; with the kinds that have a key, if any."""
    kinds = " or ".join(f'{KIND} = "{_tag(one)}"' for one in place.models if key in _keys(one))
    return (f"[[{place.key}]]" if place.listed else f"[{place.key}]") + (f" ({kinds})" if kinds else "")


def _field(table: type[BaseModel], key: str) -> FieldInfo | None:
    fields = table.model_fields
    return fields.get(key) or next((field for field in fields.values() if field.alias == key), None)


def _keys(table: type[BaseModel]) -> list[str]:
    return [*(field.alias or name for name, field in table.model_fields.items()), *getattr(table, "INSTEAD", ())]


def _tables(kind: Any) -> list[type[BaseModel]]:
    """Every table that a field's type may be."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return [kind]
    return [table for part in get_args(kind) for table in _tables(part)]


def _entries(kind: Any) -> int:
    """Count of values in a list of a type that has just so many; 0 of any other."""
    if get_origin(kind) is tuple:
        return 0 if Ellipsis in get_args(kind) else len(get_args(kind))
    return max(map(_entries, get_args(kind)), default=0)


def _tag(table: type[BaseModel]) -> str:
    return str(get_args(table.model_fields[KIND].annotation)[0]) if KIND in table.model_fields else ""


def _missing(at: _Place, name: str) -> str:
    if len(at.models) != 1:
        example = f", e.g. {name} = {' or '.join(map(json.dumps, at.examples))}" if at.examples else ""
        return f"is missing; add it{example}"
    # A default that is validated is none: it stands for a value that another key gives.
    fields = at.models[0].model_fields.items()
    needed = getattr(at.models[0], "USUAL", None) or [
        name for name, field in fields if field.is_required() or field.validate_default
    ]
    table = f"[[{at.key}]]" if at.listed else f"[{at.key}]"
    return f"is missing; add the table {table} with {', '.join(needed)}"
