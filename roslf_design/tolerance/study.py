"""Study files: which design, what it is held to, what it may miss, in TOML."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ..design import Design, load, preset_names
from ..design.files import read_toml
from ..design.kinds import expect_kind
from ..design.messages import problems_of
from ..design.units import Length, parse_quantity
from ..errors import InputError, Problem
from .distributions import Distribution
from .draws import Sampling
from .grades import SHIPPED, Grades, load_grades
from .metrics import metric_named
from .places import expand, nominal_values, parse_tolerance, perturbable

CALIBRATION = "calibration"
"""Name of the compensator that teaches the decoder each build instead of moving a part."""

FIELD_NAMES = ("centre", "edge", "corner")
"""Fields of what the sensor sees, as `roslf evaluate` takes them."""


class Table(BaseModel):
    """Base of every table of a study: frozen, unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _places(names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
    design = (info.context or {}).get("design")
    return names if design is None else tuple(place for name in names for place in expand(design, name))


def _tuple(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


def _field_place(value: Any, info: ValidationInfo) -> Any:
    if value in FIELD_NAMES:
        return value
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise ValueError(
            f'{value!r} is no field; write {", ".join(FIELD_NAMES)} or a place on the array ["2 mm", "0 mm"]'
        )
    from_file = bool(info.context and info.context.get("from_file"))
    return tuple(parse_quantity(number, "length", unit_required=from_file) for number in value)


FieldPlace = Annotated[Any, BeforeValidator(_field_place)]
"""A name of `FIELD_NAMES`, or (x, y) on the array [mm]."""


class Perturb(Table):
    """What a build misses; several places share one line. Places that a grade covers need no line of their own."""

    place: tuple[str, ...]
    """Dotted places, pairs or symbols of the paper."""
    tolerance: str | float | None = None
    """Half-width: "0.05 mm", "3 mrad", "1 %"; the study's grade where left out."""
    distribution: Distribution | None = None
    truncate: Annotated[float, Field(gt=0)] | None = None
    """Of "normal": the tolerance in sigmas."""
    group: str | None = None
    """Members of a group move together: decentres along x, decentres along y, each tilt, and all others as one."""
    opposed: bool = False
    """Moves against its group."""

    _listed = field_validator("place", mode="before")(_tuple)
    _known = field_validator("place")(_places)

    @model_validator(mode="after")
    def _readable(self, info: ValidationInfo) -> Perturb:
        design = (info.context or {}).get("design")
        if design is not None and self.tolerance is not None:
            kinds, nominal = perturbable(design), nominal_values(design)
            for place in self.place:
                parse_tolerance(self.tolerance, kinds[place], nominal[place])
        return self


class Group(Table):
    """Parts on one barrel."""

    name: str
    correlation: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Of the members' normal scores; 1: they share their deviation."""


class Goal(Table):
    """A limit. A build passes when all its goals hold, at all their fields; what is undefined does not hold."""

    metric: str
    min: float | None = None
    max: float | None = None
    """In the unit of the metric's name."""
    fields: tuple[int, ...] | None = None
    """Indices into the study's fields; all where left out."""

    @field_validator("metric")
    @classmethod
    def _known(cls, name: str) -> str:
        return metric_named(name).name

    @model_validator(mode="after")
    def _bounded(self) -> Goal:
        if self.min is None and self.max is None:
            raise ValueError(f"{self.metric} has no limit; give min, max or both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"{self.metric}: min {self.min:g} is above max {self.max:g}; swap them")
        return self


class Compensate(Table):
    """Something that is adjusted on each build: a place of the design, or "calibration" of the decoder."""

    place: tuple[str, ...]
    range: str | float | None = None
    """How far it can be moved either way; without limit where left out."""

    _listed = field_validator("place", mode="before")(_tuple)

    @field_validator("place")
    @classmethod
    def _known(cls, names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        rest = tuple(name for name in names if name != CALIBRATION)
        return _places(rest, info) + ((CALIBRATION,) if len(rest) < len(names) else ())

    @model_validator(mode="after")
    def _readable(self, info: ValidationInfo) -> Compensate:
        design = (info.context or {}).get("design")
        if design is not None and self.range is not None:
            kinds, nominal = perturbable(design), nominal_values(design)
            for place in self.place:
                if place != CALIBRATION:
                    parse_tolerance(self.range, kinds[place], nominal[place])
        return self


class Study(Table):
    """A tolerance study, as its file says it."""

    name: str
    question: str = ""
    """What it asks, for the report."""
    design: str
    """Design file, relative to the study, or the name of a preset."""
    grade: str | None = None
    """Gives a tolerance to every place that the table of grades covers."""
    grades: str | None = None
    """A table of grades of one's own, relative to the study."""
    exclude: tuple[str, ...] = ()
    """Places that keep their nominal value though the grade covers them."""
    distribution: Distribution = "normal"
    truncate: Annotated[float, Field(gt=0)] = 2.0
    trials: Annotated[int, Field(gt=0, le=10**12)] = 100_000
    seed: Annotated[int, Field(ge=0)] = 0
    sampling: Sampling = "random"
    fields: tuple[FieldPlace, ...] = ("centre", "edge", "corner")
    """Microlens positions on the array."""
    object_distance: Length | None = None
    """Z of the decoder's target; the focal plane where left out."""
    perturb: tuple[Perturb, ...] = ()
    groups: tuple[Group, ...] = ()
    goals: tuple[Goal, ...]
    report: tuple[str, ...] = ()
    """Further metrics to tabulate, without limits."""
    compensators: tuple[Compensate, ...] = ()
    share: Literal["rss", "worst-case"] = "rss"
    """How inverse sensitivity shares a limit out among n parameters: 1/sqrt(n) or 1/n of it each."""
    yield_target: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """For the inverse by yield."""
    sobol_samples: Annotated[int, Field(ge=0, le=2**22)] = 1024
    """Base samples of the Sobol indices, a power of two; 0: none."""
    quantiles: tuple[Annotated[float, Field(gt=0, lt=1)], ...] = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
    keep_trials: Annotated[int, Field(ge=0, le=10**7)] = 10_000
    """How many of the first trials are written out one by one."""
    keep_worst: Annotated[int, Field(ge=0, le=100)] = 3
    """How many of the worst trials are written as design files."""

    _excluded = field_validator("exclude")(_places)

    @field_validator("goals", mode="before")
    @classmethod
    def _some(cls, goals: Any) -> Any:
        if not goals:
            raise ValueError("a study needs at least one [[goals]] with a metric and a limit")
        return goals

    @field_validator("fields", mode="before")
    @classmethod
    def _anywhere(cls, places: Any) -> Any:
        if not places:
            raise ValueError(f"a study needs at least one field, e.g. {', '.join(FIELD_NAMES)}")
        return places

    @field_validator("report")
    @classmethod
    def _known(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(metric_named(name).name for name in names)


def load_study(path: str | os.PathLike[str]) -> tuple[Study, Design, Grades]:
    """Read a study with its design and its grades.

    Raises
    ------
    InputError
        Names the file and every fault in it: of the study, and of the design or grades it names.
    """
    place = Path(path)
    data = read_toml(place, str(path))
    expect_kind(data, "tolerance", str(path))
    return read_study(data, place.parent, str(path))


def read_study(data: Mapping[str, Any], folder: Path = Path(), origin: str = "") -> tuple[Study, Design, Grades]:
    """The same from nested values, with `folder` for the files they name."""
    problems: list[Problem] = []
    design = _named(data, "design", folder, problems)
    grades_path = folder / str(data["grades"]) if data.get("grades") else SHIPPED
    grades = None
    try:
        grades = load_grades(grades_path)
    except InputError as error:
        problems += [Problem("grades", f"{grades_path.name}: {fault}") for fault in error.problems]
    try:
        study = Study.model_validate(data, context={"from_file": True, "design": design})
    except ValidationError as error:
        problems += problems_of(error, data, Study, from_file=True)
        study = None
    if study is not None and grades is not None and study.grade is not None and study.grade not in grades.names:
        problems.append(Problem("grade", f"'{study.grade}' is not known; use one of {', '.join(grades.names)}"))
    if problems or study is None or design is None or grades is None:
        raise InputError(tuple(dict.fromkeys(problems)), origin)
    return study, design, grades


def _named(data: Mapping[str, Any], key: str, folder: Path, problems: list[Problem]) -> Design | None:
    name = data.get(key)
    if not isinstance(name, str):
        return None  # the study's own check says so
    try:
        return load(name if name in preset_names() and not (folder / name).exists() else folder / name)
    except InputError as error:
        problems += [Problem(key, f"{name}: {fault}") for fault in error.problems]
        return None
