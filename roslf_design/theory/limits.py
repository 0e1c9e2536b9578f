"""Limits that a design's `[required]` sets to quantities, read; and designs whose limits can be."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..design import Design, load, loads
from ..design.check import DesignError
from ..design.required import Required, readable
from ..errors import Problem, expect
from ..toml_files import parse_toml, read_toml
from .depth_budget import COVERAGE
from .quantities import EXPANDED, QUANTITIES, quantity_named
from .quantity import Quantity

PLACES = 'field = "corner" or 0.5, object_height = "5 mm" or field_angle = "30 deg"'
"""Ways to say where off the axis something is required."""
AT_FIELD = {"sigma_z_at_field_mm": "sigma_z_mm", "u_z_at_field_mm": "u_z_mm"}
"""Quantities of single fields, and those that stand for them in what is required."""
OFF_AXIS = ("detail_lp_per_mm", *AT_FIELD.values())
"""Quantities of the axis that are known off it as well, at all distances."""

Limits = tuple[Required, Quantity, float | None, float | None]
"""Limits that a file states, as it states them and read: the quantity, the least and the largest value."""


def held_by_builds(asked: Required) -> bool:
    """Whether studies have a number for what is required: off the axis not for detail, nor for depth at a distance."""
    at_focus = asked.at is None and asked.quantity in (*AT_FIELD, *AT_FIELD.values())
    return asked.off_axis is None or asked.quantity not in (*OFF_AXIS, *AT_FIELD) or at_focus


def as_design(design: Design | str | os.PathLike[str], origin: str = "") -> Design:
    """Design given, or the one of a path or a preset's name; all errors of `load`, and of `limits`, which checks it."""
    expect(design, "design", (Design, str, os.PathLike), "a Design, the name of a preset or the path of a design file")
    if not isinstance(design, Design):
        path = origin = os.fspath(design)
        design = _with_all_faults(lambda: load(path), lambda: read_toml(Path(path), path))
    limits(design, origin)
    return design


def design_of_text(text: str, origin: str) -> Design:
    """Design of TOML text that someone else wrote, which opens no file of this machine; errors as of `as_design`."""
    read = _with_all_faults(lambda: loads(text, origin, folder=None), lambda: parse_toml(text, origin))
    return as_design(read, origin)


def _with_all_faults(read: Callable[[], Design], values: Callable[[], Mapping[str, Any]]) -> Design:
    """Design as read; where that fails, the faults of what it requires are told with the others."""
    try:
        return read()
    except DesignError as error:
        if not any(problem.key for problem in error.problems):  # nothing that can be read
            raise
        _, asked = _read(readable(values().get("required")))
        raise DesignError(tuple(dict.fromkeys((*error.problems, *asked))), error.origin) from None


def limits(design: Design, origin: str = "") -> list[Limits]:
    """Quantities and limits that a design requires, in the order of its file.

    Raises
    ------
    DesignError
        A quantity that is none, or limits that cannot be: all at once; `origin` is what it calls the design.
    """
    read, problems = _read(design.required)
    if problems:
        raise DesignError(tuple(dict.fromkeys(problems)), origin)
    return read


def _read(required: Iterable[Required]) -> tuple[list[Limits], list[Problem]]:
    """Limits that can be read, and the faults of others."""
    read: list[Limits] = []
    problems = []
    for asked in required:
        key = f"required.{asked.quantity}"
        try:
            quantity = quantity_named(asked.quantity)
        except ValueError as error:
            problems.append(Problem(key, str(error)))
            continue
        ends: dict[str, float | None] = {"min": None, "max": None}
        for side in ends:
            value = getattr(asked, side)
            try:
                ends[side] = None if value is None else quantity.limit(value)
            except ValueError as error:
                problems.append(Problem(f"{key}.{side}", str(error)))
        if quantity.name == EXPANDED:  # verdicts, budgets and calibrations are those of u
            quantity = QUANTITIES["u_z_mm"]
            asked = asked.model_copy(update={"quantity": quantity.name})
            ends = {side: None if value is None else value / COVERAGE for side, value in ends.items()}
        if quantity.name in AT_FIELD and asked.off_axis is not None:
            quantity = QUANTITIES[AT_FIELD[quantity.name]]
            asked = asked.model_copy(update={"quantity": quantity.name})
        if fault := _fault(asked, quantity, ends["min"], ends["max"]):
            problems.append(Problem(key, fault))
        read.append((asked, quantity, ends["min"], ends["max"]))
    if not problems:
        problems += _apart(read)
    return read, problems


def _apart(read: Iterable[Limits]) -> Iterator[Problem]:
    """Faults of limits of a list that contradict each other at one place."""
    together: dict[tuple[object, ...], list[Limits]] = {}
    for one in read:
        together.setdefault((one[1].name, *one[0].where), []).append(one)
    for (name, at, *_), several in together.items():
        low = max((low for _, _, low, _ in several if low is not None), default=None)
        high = min((high for *_, high in several if high is not None), default=None)
        if fault := several[0][1].fault_of_limits(low, high):
            yield Problem(f"required.{name}", f"{fault}{'' if at is None else f' (both at {at:g} mm)'}")


def _fault(asked: Required, quantity: Quantity, low: float | None, high: float | None) -> str:
    """Fault of limits that can be read; empty where there is none."""
    off = asked.off_axis is not None
    if quantity.of is None and not off:
        return f"'{quantity.name}' differs from field to field; say where by {PLACES}"
    if off and quantity.local is None and quantity.name not in OFF_AXIS:
        return f"{quantity.name} is of the whole camera; drop {asked.places[0]}"
    if asked.at is not None and quantity.name not in OFF_AXIS and off and asked.object_height is None:
        return f"{quantity.name} of a microlens is the same at all distances; drop at, or say where by object_height"
    distance = "" if off and quantity.name not in OFF_AXIS else quantity.fault_of_distance(asked.at)
    return distance or quantity.fault_of_limits(low, high)
