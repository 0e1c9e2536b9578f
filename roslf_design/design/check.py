"""A design's faults: those of its values, and those between values that are each right on their own."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from ..bore.conjugates import CONJUGATES, REFRACTING, conjugate_residual, followed
from ..bore.main_lens import IdealMainLens, MainLensKind, main_lens_kind
from ..bore.real_lens import read_prescription
from ..catalogue.entries import NAMED, with_named_parts
from ..errors import InputError, Problem
from ..toml_files import problems_of
from ..units import format_quantity, read_quantity
from .parts import PATHS, Light

FOCAL, PLANE, DISTANCE = CONJUGATES
RESIDUAL_LIMIT = 1e-6
"""Largest |f/d_f + f/d_1 - 1| at which f, d_f and d_1 count as one set: rounding of printed digits, not an error."""
MISFIT = "misfit"
"""Type of the error of a design whose values are each right on their own and do not fit each other."""
TINY = "1e-9 mm"
"""Width that fits into anything."""
WIDTHS = ("diameter", "pitch", "pixel")
"""Keys of lengths across the axis, on which no image's place hangs."""
ASIDE = ("layout", "lens_shape", "colours", "source")
"""Keys that may be left out, on which none hangs either."""
GLASSES = ({"index": 1.1}, {"index": 3.0})
"""Materials in place of one that could not be read: what is wrong with both is wrong whatever it should be."""


class DesignError(InputError):
    """A design (or its file) that cannot be used."""


def at(value: Any, place: str) -> Any:
    """Value at a dotted place of nested parts, tables and lists; None where there is none."""
    for step in place.split("."):
        if isinstance(value, (list, tuple)):
            value = value[int(step)] if step.isdecimal() and int(step) < len(value) else None
        else:
            value = value.get(step) if isinstance(value, Mapping) else getattr(value, step, None)
    return value


def checked_places(openings: Iterable[str]) -> tuple[str, ...]:
    """Places of the lengths that must fit each other, by the places of the openings."""
    return (*CONJUGATES, PATHS["D"], PATHS["wavelength"], *(f"{opening}.distance" for opening in openings))


def design_problems(
    error: ValidationError,
    data: Mapping[str, Any],
    model: type[BaseModel],
    *,
    from_file: bool,
    folder: str | Path | None = "",
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
        What the path of a lens file counts from; None where none may be opened.
    """
    for fault in error.errors(include_url=False):
        if fault["type"] == MISFIT:  # every value was read: what was found between them
            return tuple(fault["ctx"]["problems"])
    problems = [problem for problem in problems_of(error, model) if problem.key]
    if any(problem.key.endswith(".part") for problem in problems):  # what it gives is not known
        return tuple(problems)
    named = {place: with_named_parts(place, data[place], folder) for place in NAMED if place in data}
    data = {**data, **named}
    if (mended := [_mended(data, problems, glass) for glass in GLASSES])[0] is not None:
        between = [_between(one, model, from_file, folder) for one in mended]
        return tuple(dict.fromkeys((*problems, *(fault for fault in between[0] if fault in between[1]))))

    def readable(place: str) -> bool:
        faulty = (f"{problem.key}." for problem in problems)
        return not any(f"{place}.".startswith(key) or key.startswith(f"{place}.") for key in faulty)

    # Where light meets more than air and the main lens, conjugates are told once every element can be read.
    refracts = any(at(data, place) for place in REFRACTING)
    stops = data.get("stops")
    further = [f"stops.{index}" for index, _ in enumerate(stops if isinstance(stops, (list, tuple)) else ())]
    given = {
        place: at(data, place)
        for place in checked_places(("aperture", *further))
        if readable(place) and not (place in (PLANE, DISTANCE) and refracts)
    }
    values = {
        place: None if value is None else read_quantity(value, "length", unit_required=from_file)
        for place, value in given.items()
    }
    if not readable("main_lens.prescription") or at(data, "main_lens.sheet") is not None:
        values.pop(FOCAL, None)
        return (*problems, *cross_check(values, IdealMainLens(), turned=False))
    turned = at(data, "main_lens.reversed") is True
    lens = main_lens_kind(read_prescription(at(data, "main_lens.prescription"), folder), turned)
    return (*problems, *cross_check(values, lens, turned=turned))


def _between(
    data: Mapping[str, Any] | None, model: type[BaseModel], from_file: bool, folder: str | Path | None
) -> tuple[Problem, ...]:
    """Faults between values, of which each can be read."""
    try:
        model.model_validate(data, context={"from_file": from_file, "folder": folder})
    except ValidationError as error:
        return tuple(chain.from_iterable(e["ctx"]["problems"] for e in error.errors() if e["type"] == MISFIT))
    return ()


def _mended(data: Mapping[str, Any], problems: Sequence[Problem], glass: Mapping[str, float]) -> dict[str, Any] | None:
    """Values without those that could not be read, or with a width or a glass in their place; None where more is wrong.

    No width moves a plane, so what is then found between the values holds whatever it should be.
    """
    mended = copy.deepcopy(dict(data))
    for problem in problems:
        *parents, last = problem.key.split(".")
        held = at(mended, ".".join(parents)) if parents else mended
        if parents[:1] == ["required"]:
            mended.pop("required", None)
        elif not isinstance(held, dict) or last not in held or "surfaces" in parents:
            return None
        elif last in WIDTHS and parents:
            held[last] = TINY
        elif last == "material" and parents[0] == "elements":
            held[last] = dict(glass)
        elif last in ASIDE or "is not a known key" in problem.message:
            del held[last]
        else:
            return None
    return mended


def cross_check(
    values: Mapping[str, float | None],
    lens: MainLensKind,
    *,
    turned: bool,
    bends: bool = False,
    stated: Mapping[str, float | None] | None = None,
) -> tuple[Problem, ...]:
    """Faults between values that are each right on their own.

    Parameters
    ----------
    values : mapping
        Those of `checked_places` to length [mm]; None where a key is not given, absent where it could not be read.
    lens : MainLensKind
        The main lens.
    turned : bool
        Whether it is to stand the other way round.
    bends : bool
        Whether anything before the main lens bends light, so that what is in focus may be seen at infinity and beyond.
    stated : mapping, optional
        Lengths as the design states them, where the main lens sees others through what stands before it.
    """
    known = PATHS["wavelength"] in values
    wavelength = (values[PATHS["wavelength"]] or Light().wavelength) if known else None
    problems = list(lens.about(values, turned, wavelength))
    values = lens.settled(values, None if problems else wavelength)
    problems += _about_conjugates(values, bends, stated or {})
    f, d_f, d_1 = (values.get(key) for key in CONJUGATES)
    if d_f is None and f is not None and d_1 is not None and d_1 > f:
        d_f = float(followed({FOCAL: f, DISTANCE: d_1}, PLANE))
    for key, distance in values.items():
        if d_f is not None and distance is not None and key.startswith(("aperture", "stops")) and distance >= d_f:
            problems.append(stop_beyond_focus(key, distance, d_f))
    return tuple(problems)


def _about_conjugates(
    values: Mapping[str, float | None], bends: bool, stated: Mapping[str, float | None]
) -> Iterator[Problem]:
    if any(key not in values for key in CONJUGATES):
        return
    given = {key: value for key in CONJUGATES if (value := values[key]) is not None}
    missing = [key for key in CONJUGATES if key not in given]
    if len(missing) > 1:
        yield Problem(FOCAL, f"two of {', '.join(CONJUGATES)} are needed; give one of {' or '.join(missing)}")
    near = [key for key in given if FOCAL in given and key != FOCAL and given[key] <= given[FOCAL]]
    if bends:  # only what is seen between the main lens and its focus has no image behind it
        near = [key for key in near if key == PLANE and given[key] > 0]
    for key in near:
        focal = f"the focal length {shown(given[FOCAL])}"
        as_seen, typed = shown(given[key]), shown(stated.get(key) or given[key])
        subject = as_seen if typed == as_seen else f"{typed}, which the main lens sees at {as_seen},"
        yield Problem(key, f"{subject} is not beyond {focal}, so no real image forms; make it longer")
    if not (missing or near) and abs(residual := float(conjugate_residual(*given.values()))) > RESIDUAL_LIMIT:
        ways = " or ".join(f"{key} (it would become {shown(float(followed(given, key)))})" for key in (DISTANCE, PLANE))
        message = f"f, d_f and d_1 contradict each other: f/d_f + f/d_1 - 1 = {residual:.4g}, not 0; drop {ways}"
        yield Problem(DISTANCE, message)


def shown(value: float) -> str:
    """A length [mm] in a message: eight digits, in the unit it was typed in."""
    return format_quantity(value, "length", 8)


def stop_beyond_focus(place: str, distance: float, d_f: float) -> Problem:
    """The fault of a stop at a `place` [mm] that does not stand before the focal plane."""
    message = (
        f"{shown(distance)} is not less than the focal-plane distance d_f = {shown(d_f)}: the object plane would lie "
        "inside the bore; move this stop closer to the lens or focus farther out"
    )
    return Problem(place, message)
