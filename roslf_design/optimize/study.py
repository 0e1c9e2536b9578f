"""Study files: TOML to a problem, with every fault at once."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..design import Design, load, preset_names
from ..design.files import read_toml
from ..design.kinds import expect_kind
from ..design.messages import problems_of
from ..design.parts import Stop
from ..errors import InputError
from ..errors import Problem as Fault
from .bore import Tube
from .cameras import places_of
from .problem import Constraint, Goal, Problem
from .quantities import quantity_named
from .solve import Settings
from .tables import StudyTable
from .variables import Variable


@dataclass(frozen=True)
class Study:
    """A study, ready to run."""

    problem: Problem
    settings: Settings
    table: StudyTable
    bore: tuple[Stop, ...]
    """Rims of the bore; empty where the design's aperture stands."""
    folder: Path
    """Where files that the study names are looked for."""


def load_study(path: str | os.PathLike[str], seed: int | None = None, accuracy: float | None = None) -> Study:
    """Read a study; `seed` overrides the file's, `accuracy` is `Settings.accuracy`.

    Raises
    ------
    InputError
        Names the file and every fault in it.
    """
    place = Path(path)
    data = read_toml(place, str(path))
    expect_kind(data, "optimize", str(path))
    study = read_study(data, place.parent, str(path), seed)
    return replace(study, settings=replace(study.settings, accuracy=accuracy))


def read_study(data: Mapping[str, Any], folder: Path = Path(), origin: str = "", seed: int | None = None) -> Study:
    """The same from nested values, with `folder` for the files they name."""
    faults: list[Fault] = []
    design = _base(data, folder, faults)
    places = None if design is None else places_of(design)
    table = None
    try:
        table = StudyTable.model_validate(data, context={"from_file": True, "places": places})
    except ValidationError as error:
        faults += _faults(error, data)
    if faults or table is None or design is None:
        raise InputError(tuple(dict.fromkeys(faults)), origin)
    if table.wavelength is not None:
        design = design.replace(wavelength=table.wavelength)
    settings = Settings(
        starts=table.solver.starts,
        seed=table.seed if seed is None else seed,
        evaluations=table.solver.evaluations,
        seconds=table.solver.seconds,
        check=table.solver.check,
        isres=table.solver.isres,
    )
    return Study(_problem(table, design), settings, table, _rims(table), folder)


def _problem(table: StudyTable, design: Design) -> Problem:
    if table.bore is not None:
        design = design.replace({"stops": ()})  # the bore takes the place of the design's own
    limits = [constraint.limits() for constraint in table.constraints]
    return Problem(
        name=table.name,
        question=table.question,
        design=design,
        variables=tuple(Variable(name, v.min, v.max, v.start) for name, v in table.variables.items()),
        constraints=tuple(
            Constraint(quantity_named(c.quantity), low, high, c.at)
            for c, (low, high) in zip(table.constraints, limits, strict=True)
        ),
        goals=tuple(
            Goal(quantity_named(g.quantity), "min" if g.direction == "min" else "max", g.at, g.weight)
            for g in table.goals
        ),
        order=table.order,
        slack=table.slack,
        in_focus=table.microlens_in_focus,
        tip=max((rim.distance for rim in _rims(table)), default=0.0),
    )


def _rims(table: StudyTable) -> tuple[Stop, ...]:
    if table.bore is None:
        return ()
    if table.bore.tube is not None:
        tube = table.bore.tube
        return Tube(tube.diameter, tube.length, tube.distance).rims
    return tuple(Stop(diameter=stop.diameter, distance=stop.distance) for stop in table.bore.stops)


def _faults(error: ValidationError, data: Mapping[str, Any]) -> list[Fault]:
    found = list(problems_of(error, data, StudyTable, from_file=True))
    for detail in error.errors(include_url=False):
        if not detail["loc"]:  # of the study as a whole, one a line, each with its place
            for line in detail["msg"].removeprefix("Value error, ").splitlines():
                key, _, message = line.partition(": ")
                found.append(Fault(key, message))
    return found


def _base(data: Mapping[str, Any], folder: Path, faults: list[Fault]) -> Design | None:
    name = data.get("design")
    if not isinstance(name, str):
        return None  # the study's own check says so
    try:
        design = load(name if name in preset_names() and not (folder / name).exists() else folder / name)
    except InputError as error:
        faults += [Fault("design", f"{name}: {fault}") for fault in error.problems]
        return None
    if design.lens is not None:
        message = (
            f"{name}: has a real main lens ({design.lens.name}), and the search varies ideal ones; give main_lens "
            f'focal_length = "{design.f:.6g} mm" and diameter = "{design.D:.6g} mm" in place of its prescription, then '
            "see `roslf evaluate` with the lens for what it really does"
        )
        faults.append(Fault("design", message))
        return None
    return design


def with_design(problem: Problem, design: Design) -> Problem:
    """The same problem on another base design."""
    return replace(problem, design=design)
