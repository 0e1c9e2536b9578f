"""Study files in TOML, which design, what it is held to, what it may miss; and the plan that is made of one.

A `Study` is what a file says. A `TolerancePlan` is ready to run: every place, number and limit resolved, one frozen
value that travels to any worker.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import compress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    Field,
    StrictBool,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..bore.part import TEMPERATURE
from ..camera import Camera
from ..design import Design
from ..design.files import expect_kind
from ..design.growth import Growth
from ..errors import InputError, Problem
from ..evaluation import default_fields
from ..evaluation.fields import FIELD_NAMES, MOST_FIELDS, unseen
from ..evaluation.required import limits_for_study, studied
from ..options import Options, up_to
from ..seeds import Seed
from ..sobol import BITS
from ..theory.focused import focus_faults
from ..theory.quantities import NO_LENS_MOVES
from ..theory.quantity import finite
from ..toml_files import StrictTable, nearest, problems_of, read_toml
from ..units import Length, in_file, read_quantity
from ..words import number
from .draws import Distribution, Draws, Perturbation, Sampling
from .ideal import bore_end
from .metrics import (
    DISTANT,
    METRICS,
    SHAPES,
    Column,
    Question,
    evaluate_builds,
    faults_of,
    focus_shown,
    mount_of,
    share_by_rays,
)
from .places import (
    CALIBRATION,
    LEFT,
    LENSLETS,
    SHIPPED,
    Aim,
    Grades,
    expand,
    focus_fault,
    load_grades,
    nominal_values,
    tolerance_at,
)

Only = Literal["yield"]
"""Analyses of a study that are asked for alone."""
OWN = "this study"
"""Source of a tolerance that is no grade's."""
VIEWS = "as its own views show it"
"""Source of what a compensator to the focus leaves of which neither study nor grade says what that is."""
MOST_TRIALS = 10**10
"""Fifteen hours of a processor at best."""
MOST_MEMORY, SOBOL_ROWS = 1 << 30, 600
"""Bytes that Sobol indices may take, and numbers a sample beside those of factors: weights of its resampling."""

SAME_PLACE = 1e-9
"""Distance below which two fields are one [mm]."""
FORMAT = 12
"""Raised when the same plan would give other bytes; part of the digest that guards a resumed run."""
TIED = ": "
"""Between a group's name and the pose that its members share."""


def _design(info: ValidationInfo) -> Design | None:
    """The study's design, where it could be read."""
    design: Design | None = (info.context or {}).get("design")
    return design


def _expanded(names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
    design = _design(info)
    return names if design is None else tuple(place for name in names for place in expand(design, name))


def _adjustable(names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
    rest = tuple(name for name in names if name != CALIBRATION)
    return _expanded(rest, info) + ((CALIBRATION,) if len(rest) < len(names) else ())


def _listed(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


def _widths(text: str | float | None, places: Iterable[str], design: Design | None) -> dict[str, float]:
    """A tolerance at each of some places, read; nothing without a text or a design."""
    if text is None or design is None:
        return {}
    return {p: tolerance_at(design, p, text) for p in places if p != CALIBRATION}


def _field_place(value: Any, info: ValidationInfo) -> Any:
    if value in FIELD_NAMES:
        return value
    place = (value, 0) if isinstance(value, str) and re.search(r"\d", value) else value
    if not isinstance(place, (list, tuple)) or len(place) != 2:
        raise ValueError(
            f"{value!r} is no field; write {', '.join(FIELD_NAMES)}, a length along x, or a place on the array "
            '["2 mm", "0 mm"]'
        )
    return tuple(read_quantity(one, "length", unit_required=in_file(info)) for one in place)


def _field_or_index(value: Any, info: ValidationInfo) -> Any:
    return value if isinstance(value, int) and not isinstance(value, bool) else _field_place(value, info)


def _metric(name: str) -> str:
    if name not in METRICS:
        raise ValueError(f"'{name}' is no quantity of builds; {nearest(name, METRICS)}")
    return name


def _metric_anywhere(name: str) -> str:
    return name if name in DISTANT else _metric(name)


FieldPlace = Annotated[Any, BeforeValidator(_field_place)]
"""A name of `FIELD_NAMES`, or (x, y) on the array [mm]; a single length lies along x."""


class Perturb(StrictTable):
    """Perturbation of one or more places. Places that a grade covers need no line of their own."""

    place: Annotated[tuple[str, ...], BeforeValidator(_listed), AfterValidator(_expanded)]
    """Dotted places, pairs or symbols of the paper."""
    tolerance: str | float | None = None
    """Half-width: "0.05 mm", "3 mrad", "1 %"; the study's grade where left out."""
    distribution: Distribution | None = None
    truncate: Annotated[float, Field(ge=1e-3, le=1e3)] | None = None
    """Truncation of "normal": the tolerance in sigmas."""
    group: str | None = None
    """Members of a group move together: decentres along x, decentres along y, each tilt, and all others as one."""
    opposed: StrictBool = False
    """Moves against its group."""

    @field_validator("tolerance")
    @classmethod
    def _readable(cls, tolerance: str | float | None, info: ValidationInfo) -> str | float | None:
        _widths(tolerance, info.data.get("place", ()), _design(info))
        return tolerance


class Group(StrictTable):
    """Parts on one barrel."""

    name: str
    correlation: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Correlation of the members' normal scores; 1: they share their deviation."""


class MetricGoal(StrictTable):
    """A limit. A build passes when all its goals hold, at all their fields; what is undefined does not hold."""

    quantity: Annotated[str, AfterValidator(_metric_anywhere)] = Field(
        validation_alias=AliasChoices("quantity", "metric")
    )
    at: Length | None = None
    """Ahead of the bore's tip [mm], of the whole camera; at the fields, or at the focal plane, where left out."""
    min: float | None = None
    max: float | None = None
    """In the unit of the quantity's name, or text with a unit."""
    field: FieldPlace | None = None
    """Microlens that it is asked for; all of the study's fields where left out."""
    fields: tuple[Annotated[Any, BeforeValidator(_field_or_index)], ...] | None = Field(None, min_length=1)
    """Several of them; a whole number is the index of one of the study's fields, from 0."""

    @field_validator("min", "max", mode="before")
    @classmethod
    def _read(cls, value: Any, info: ValidationInfo) -> float | None:
        name = info.data.get("quantity")
        return value if value is None or name is None else Column(name, None, info.data.get("at")).quantity.limit(value)

    @model_validator(mode="after")
    def _bounded(self) -> MetricGoal:
        if self.min is None and self.max is None:
            raise ValueError(f"{self.quantity} has no limit; give min, max or both")
        quantity = Column(self.quantity, None, self.at).quantity
        if fault := quantity.fault_of_distance(self.at):
            raise ValueError(fault)
        if self.at is not None and self.asked is not None:
            raise ValueError(f"{self.quantity} at a field is not asked for at a distance; drop at or field")
        if quantity.local is None and any(not isinstance(place, int) for place in self.asked or ()):
            raise ValueError(f"{self.quantity} is one number for the whole field; drop field or fields")
        if fault := quantity.fault_of_limits(self.min, self.max):
            raise ValueError(f"{self.quantity}: {fault}")
        return self

    @property
    def asked(self) -> tuple[Any, ...] | None:
        """Fields that it is asked for, places or indices into the study's; None for all of these."""
        one = () if self.field is None else (self.field,)
        return (*one, *(self.fields or ())) or None


class Compensate(StrictTable):
    """Something that is adjusted on each build: a place of the design, or "calibration" of the decoder."""

    place: Annotated[tuple[str, ...], BeforeValidator(_listed), AfterValidator(_adjustable)]
    aim: Aim = "limits"
    """Aim of the move: `"limits"`, where the goals' quantities are nearest to nominal; `"focus"`, of the array
    (`microlens_array.distance`) or a lens in the bore (`elements.0.distance`), where what is in focus is as far ahead
    of the tip as designed, at the design's own temperature, medium and light."""
    range: str | float | None = None
    """How far it can be moved either way; without limit where left out."""
    error: str | float | None = None
    """Error that it leaves, as a tolerance with the study's distribution: by how much the part is set amiss either way,
    or depth of a calibrated decoder is off; where left out that of the study's grade, if its table tells one, else
    of a focus what the camera's own views show of it, of others nothing, and pages say so."""

    @field_validator("aim")
    @classmethod
    def _focuses(cls, aim: Aim, info: ValidationInfo) -> Aim:
        if fault := focus_fault(aim, info.data.get("place", ()), _design(info)):
            raise ValueError(fault)
        return aim

    @field_validator("range")
    @classmethod
    def _readable(cls, reach: str | float | None, info: ValidationInfo) -> str | float | None:
        _widths(reach, info.data.get("place", ()), _design(info))
        return reach

    @field_validator("error")
    @classmethod
    def _stated(cls, error: str | float | None, info: ValidationInfo) -> str | float | None:
        _widths(error, [LEFT + place for place in info.data.get("place", ())], _design(info))
        return error


class Study(StrictTable):
    """A tolerance study, as its file says it."""

    name: str
    question: str = ""
    """Question that the study asks, for the report."""
    design: str
    """Design file, relative to the study, or the name of a preset."""
    grade: str | None = None
    """Gives a tolerance to every place that the table of grades covers."""
    grades: str | None = None
    """A table of grades of one's own, relative to the study."""
    exclude: Annotated[tuple[str, ...], AfterValidator(_expanded)] = ()
    """Places that keep their nominal value though the grade covers them."""
    distribution: Distribution = "normal"
    truncate: Annotated[float, Field(ge=1e-3, le=1e3)] = 2.0
    trials: Annotated[int, Field(gt=0)] = 100_000
    seed: Annotated[int, Field(ge=0)] = 0
    sampling: Sampling = "random"
    fields: tuple[FieldPlace, ...] = ("centre", "edge", "corner")
    """Microlens positions on the array."""
    object_distance: Length | None = None
    """Z of the decoder's target, from the main lens; the focal plane where left out."""
    perturb: tuple[Perturb, ...] = ()
    groups: tuple[Group, ...] = ()
    required: StrictBool = False
    """Whether the limits of the design's `[required]` count beside the goals; they do alone where there are none."""
    goals: Annotated[tuple[MetricGoal, ...], Field(validate_default=True)] = ()
    """Limits; where left out, those of the design's `[required]`."""
    report: tuple[Annotated[str, AfterValidator(_metric)], ...] = ()
    """Further metrics to tabulate, without limits."""
    compensators: tuple[Compensate, ...] = ()
    share: Literal["rss", "worst-case"] = "rss"
    """How inverse sensitivity shares a limit out among n parameters: 1/sqrt(n) or 1/n of it each."""
    yield_target: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """Target yield, for the inverse by yield."""
    sobol_samples: Annotated[int, Field(ge=0, le=2**22)] = 1024
    """Base samples of the Sobol indices, a power of two; 0: none. Unless given, fewer where depth is limited behind a
    real lens: 10,000 builds at most."""
    only: Only | None = None
    """Analyses alone, "yield": the yield of all trials and what one factor on all tolerances makes of it, sooner;
    nothing of what takes most of the time, as single tolerances, indices, other grades and changes that reach the
    target."""
    quantiles: tuple[Annotated[float, Field(gt=0, lt=1)], ...] = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
    keep_trials: Annotated[int, Field(ge=0, le=10**7)] = 10_000
    """How many of the first trials are written out one by one."""
    keep_worst: Annotated[int, Field(ge=0, le=100)] = 3
    """How many of the worst trials are written as design files."""

    @field_validator("required")
    @classmethod
    def _there(cls, required: bool, info: ValidationInfo) -> bool:
        design = _design(info)
        if required and design is not None and not design.required:
            raise ValueError(f"{design.name} has no [required] to be held; add it, or drop the key")
        return required

    @field_validator("goals", mode="before")
    @classmethod
    def _some(cls, goals: Any, info: ValidationInfo) -> Any:
        if goals and not info.data.get("required"):
            return goals
        design = _design(info)
        asked = () if design is None else limits_for_study(design)
        if not asked and not goals:
            raise ValueError(
                "a study needs at least one [[goals]] with a quantity and a limit, or a design with [required], whose "
                "limits it takes where [[goals]] are left out"
            )
        return (*goals, *asked) if isinstance(goals, (list, tuple)) else goals

    @field_validator("goals")
    @classmethod
    def _once(cls, goals: tuple[MetricGoal, ...]) -> tuple[MetricGoal, ...]:
        return tuple(goal for k, goal in enumerate(goals) if goal not in goals[:k])

    @field_validator("fields", mode="before")
    @classmethod
    def _anywhere(cls, places: Any) -> Any:
        if not places:
            raise ValueError(f"a study needs at least one field, e.g. {', '.join(FIELD_NAMES)}")
        return places


def read_study(
    data: Mapping[str, Any], folder: Path = Path(), origin: str = "", design: Design | None = None
) -> tuple[Study, Design, Grades]:
    """A study from the nested values of its file, with its design and its grades; arguments as for `tolerance_plan`."""
    problems: list[Problem] = []
    grades = study = None
    data, design = studied(data, folder, design, problems)
    table = folder / str(data["grades"]) if data.get("grades") else SHIPPED
    try:
        grades = load_grades(table)
    except InputError as error:
        problems += [Problem("grades", f"{table.name}: {fault}") for fault in error.problems]
    try:
        study = Study.model_validate(data, context={"from_file": True, "design": design})
    except ValidationError as error:
        problems += problems_of(error, Study)
    if study is not None and grades is not None and study.grade is not None and study.grade not in grades.names:
        problems.append(Problem("grade", f"'{study.grade}' is not known; use one of {', '.join(grades.names)}"))
    if problems or study is None or design is None or grades is None:
        raise InputError(tuple(dict.fromkeys(problems)), origin)
    return study, design, grades


@dataclass(frozen=True)
class _Limit:
    """A goal at one column."""

    column: int
    low: float
    high: float
    """Infinite where there is none."""


@dataclass(frozen=True)
class Adjuster:
    """A compensator that moves a part."""

    place: str
    reach: float
    """[mm or rad]; infinite without limit."""
    aim: Aim = "limits"


@dataclass(frozen=True)
class TolerancePlan:
    """Plan of a tolerance study, ready to run."""

    name: str
    question: Question
    draws: Draws
    limits: tuple[_Limit, ...]
    adjusters: tuple[Adjuster, ...]
    """Adjusters; focus is set last, as it makes up for what the others move."""
    calibrated: bool
    """Whether full calibration is among the compensators."""
    trials: int
    chunk: int
    """Trials a chunk."""
    keep_trials: int
    keep_worst: int
    quantiles: tuple[float, ...]

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of what is measured of each trial; the last is what counts."""
        if self.adjusters and not self.adjusters_to_limits:
            return ("as built", "focused")
        if self.adjusters:
            return ("as built", "adjusted, linear", "adjusted")
        return ("as built", "calibrated") if self.calibrated else ("as built",)

    @property
    def adjusters_to_limits(self) -> tuple[Adjuster, ...]:
        """Adjusters that are moved to where the limits hold best."""
        return tuple(adjuster for adjuster in self.adjusters if adjuster.aim == "limits")

    @property
    def perfect(self) -> tuple[str, ...]:
        """Places of compensators that leave nothing: nobody says what, or none."""
        every = [one.place for one in self.adjusters] + [CALIBRATION] * self.calibrated
        stated = {p.place for p in self.draws.perturbations}
        return tuple(place for place in every if LEFT + place not in stated)

    def at_end(self, moved: Array) -> NDArray[np.bool_]:
        """True where an adjustment, shape (adjusters, trials), rests at the end of its range."""
        return np.asarray(np.abs(moved) >= np.array([one.reach for one in self.adjusters])[:, None])

    def with_adjusters(self, *more: Adjuster) -> TolerancePlan:
        """The plan with more of them."""
        return replace(self, adjusters=tuple(sorted((*self.adjusters, *more), key=lambda one: one.aim == "focus")))

    @property
    def chunks(self) -> int:
        """How many chunks there are; the last may be short."""
        return -(-self.trials // self.chunk)

    def chunk_trials(self, index: int) -> int:
        """Trials of one chunk."""
        return min(self.chunk, self.trials - index * self.chunk)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns measured of each build: metrics at fields."""
        return self.question.columns

    @cached_property
    def nominal(self) -> Array:
        """The nominal design's columns, shape (columns,); as builds' where they differ in temperature, at its own."""
        warmth = {p.place: np.array([p.nominal]) for p in self.draws.perturbations if p.place == TEMPERATURE}
        return evaluate_builds(self.question, warmth, 1)[:, 0]

    @cached_property
    def limited(self) -> TolerancePlan:
        """The plan with its limited metrics alone: whether builds pass hangs on no others."""
        return self._of_limits(self.limits)

    @cached_property
    def dear(self) -> bool:
        """Whether limits on depth errors are summed of traced builds, a millisecond each: analyses take fewer then."""
        summed = any(self.columns[limit.column].quantity.numeric for limit in self.limits)
        return summed and bool(self.question.design.main_lens.kind.mounted)

    @cached_property
    def stages(self) -> tuple[TolerancePlan, ...]:
        """Plans of some limits each, which builds pass one after the other; what takes longest comes last.

        Adjusted builds have one, as all limits tell where they are adjusted to.
        """
        asked = [self.columns[limit.column] for limit in self.limits]
        cost = [0 if self.adjusters else 2 * one.quantity.numeric + (one.metric in SHAPES) for one in asked]
        parts = (tuple(compress(self.limits, np.equal(cost, rank))) for rank in range(3))
        return tuple(map(self._of_limits, filter(None, parts)))

    def _of_limits(self, limits: tuple[_Limit, ...]) -> TolerancePlan:
        """The plan with these limits and their metrics alone."""
        question = self.question.limited_to(self.columns[limit.column] for limit in limits)
        rows = {column: row for row, column in enumerate(question.columns)}
        moved = tuple(replace(limit, column=rows[self.columns[limit.column]]) for limit in limits)
        return replace(self, question=question, limits=moved)

    @cached_property
    def infinite(self) -> NDArray[np.bool_]:
        """Which columns may be infinite, shape (columns,)."""
        return self.question.infinite

    def judged(self, values: Array, columns: Sequence[int] | NDArray[np.intp] | slice = slice(None)) -> Array:
        """Values by which builds are compared, shape (columns, ...): infinite ones as their finite twins."""
        which = self.infinite[columns]
        if not which.any():
            return values
        judged = np.array(values, float)
        judged[which] = finite(judged[which])
        return judged

    @cached_property
    def faults(self) -> tuple[str, ...]:
        """Reasons why a build can be no camera, in words."""
        return tuple(faults_of(self.question, {}, 1))

    def nominal_misses(self) -> tuple[str, ...]:
        """Labels of the limits that the nominal design itself does not hold: no tolerance mends those.

        What is a thin-lens model's has its value, so that it is not taken for the one that rays tell.
        """
        missed, twins = [], self.of_thin_twins
        for limit in self.missed:
            label, value = self.columns[limit.column].label, float(self.nominal[limit.column])
            missed.append(f"{label} ({number(value, 4)} of the thin-lens model)" if label in twins else label)
        return tuple(dict.fromkeys(missed))

    @property
    def missed(self) -> tuple[_Limit, ...]:
        """Limits that the nominal design does not hold."""
        return tuple(one for one in self.limits if not self._holds(one, float(self.nominal[one.column])))

    def defined(self, origin: str = "") -> TolerancePlan:
        """The plan itself, which can be run.

        Raises
        ------
        InputError
            The nominal design has no value for a limit, as where its parts collide: no build would tell anything.
        """
        labels = (self.columns[l.column].label for l in self.limits if np.isnan(self.nominal[l.column]))
        if undefined := ", ".join(dict.fromkeys(labels)):
            if reasons := [words for words, flags in faults_of(self.question, {}, 1).items() if flags.any()]:
                told = f"the nominal design cannot be built: {'; '.join(reasons)}; `roslf evaluate` has the remedy"
                raise InputError((Problem("design", told),), origin)
            words = f"{undefined}: the nominal design has no value there; limit it at other fields, or drop it"
            raise InputError((Problem("goals", words),), origin)
        return self

    @property
    def of_thin_twins(self) -> tuple[str, ...]:
        """Labels of what is told of the thin-lens model of a build, behind a real lens; nothing behind an ideal one."""
        if not self.question.design.main_lens.kind.mounted:
            return ()
        told = (*NO_LENS_MOVES, *(column.metric for column in self.by_rays))
        return tuple(column.label for column in self.columns if column.field is None and column.metric not in told)

    @property
    def by_formula(self) -> dict[str, str]:
        """Metrics that formulas of a thin lens tell though a real lens differs, with what these leave out, in words."""
        told = {column.metric for column in self.by_rays}
        left_out = mount_of(self.question.design).left_out
        return {name: left_out[name] for name in self.question.metrics if name in left_out and name not in told}

    @property
    def by_rays(self) -> tuple[Column, ...]:
        """Whole cameras' columns that rays tell at nominal, from where builds change as thin-lens models do."""
        whole = (column for column in self.columns if column.field is None)
        return tuple(c for c in whole if share_by_rays(self.question.design, c.metric, c.at) is not None)

    def passes(self, values: Array) -> NDArray[np.bool_]:
        """Which limits hold, shape (limits, trials), for values of shape (columns, trials); NaN never passes."""
        return np.array([self._holds(limit, values[limit.column]) for limit in self.limits])

    def _holds(self, limit: _Limit, values: Array | float) -> NDArray[np.bool_]:
        return self.columns[limit.column].quantity.within(limit.low, limit.high, values)

    def used_room(self, values: Array) -> Array:
        """Largest share of its limits' room that each trial uses, (trials,), for values of shape (columns, trials).

        0 at nominal, 1 at a limit; infinite where something limited is undefined.
        """
        most = np.full(values.shape[1], -np.inf)
        for limit in self.limits:
            rows = [limit.column]
            value, here = self.judged(values[rows], rows)[0], self.judged(self.nominal[rows], rows)[0]
            for edge, over in ((limit.high, value - here), (limit.low, here - value)):
                if np.isfinite(edge):
                    allowed = abs(self.judged(np.array([edge]), rows)[0] - here)
                    used = over / allowed if allowed > 0 else np.where(over > 0, 1 + over, over)
                    most = np.maximum(most, np.where(np.isnan(used), np.inf, used))
        return most

    def digest(self) -> str:
        """Fingerprint of all that decides the results' bytes."""
        text = json.dumps([FORMAT, repr(self), self.question.design.model_dump(mode="json")], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def _most_sobol_samples(factors: int, columns: int) -> int:
    """Base samples, a power of two, of Sobol indices that a gigabyte of memory holds."""
    each = SOBOL_ROWS + 4 * factors + columns * (4 * factors + 8)
    return int(1 << int(math.log2(MOST_MEMORY / (8 * each))))


class RunOptions(Options):
    """Trials of a tolerance study, instead of what its file says."""

    seed: Seed | None = None
    """Instead of the study's; the same seed gives the same bytes."""
    trials: Annotated[int, up_to(MOST_TRIALS)] | None = None
    """Instead of the study's."""
    accuracy: float | None = None
    """Instead of a number of trials: what shares of builds (the yield, those below a quantile) may be off by, as 0.005
    (in 95 % of runs). 0.001 takes a million trials."""
    only: Only | None = None
    """Analyses alone, instead of the study's: yield, without the searches behind it for single tolerances, indices,
    other grades and changes that reach the target, which take most of the time. Given again without it and with resume,
    they follow."""

    def plan(self, path: str | Path) -> tuple[TolerancePlan, Study, Grades]:
        """Study of a file, resolved; errors as of `load_plan`."""
        return load_plan(path, trials=self.trials, seed=self.seed, only=self.only)


def load_plan(
    path: str | Path, *, trials: int | None = None, seed: int | None = None, only: Only | None = None
) -> tuple[TolerancePlan, Study, Grades]:
    """Read a study file and resolve it; `trials`, `seed` and `only` override the file's.

    Raises
    ------
    InputError
        Names the file and every fault in it.
    """
    path = Path(path)
    data = read_toml(path, str(path))
    expect_kind(data, "tolerance", str(path))
    study, design, grades = read_study(data, path.parent, str(path))
    changes = {"trials": trials, "seed": seed, "only": only}
    study = study.model_copy(update={key: value for key, value in changes.items() if value is not None})
    return make_plan(study, design, grades, str(path)).defined(str(path)), study, grades


def tolerance_plan(
    data: Mapping[str, Any], design: Design | None = None, folder: Path = Path(), origin: str = ""
) -> tuple[TolerancePlan, Study, Grades]:
    """A tolerance study ready to run.

    Parameters
    ----------
    data : mapping
        As the study's file says it.
    design : Design, optional
        Takes the place of the file's own.
    folder : Path
        Where files that the study names are looked for.
    origin : str
        What errors call it.

    Raises
    ------
    InputError
        Every fault of the study.
    """
    study, own, grades = read_study(data, folder, origin, design)
    return make_plan(study, own, grades, origin), study, grades


def plan_from(data: Mapping[str, Any]) -> TolerancePlan:
    """A plan from the nested values of a study, for scripts."""
    return tolerance_plan(data)[0]


def make_plan(study: Study, design: Design, grades: Grades, origin: str = "") -> TolerancePlan:
    """Resolve a study.

    Raises
    ------
    InputError
        Every fault between its tables.
    """
    problems: list[Problem] = []
    distance = design.d_f if study.object_distance is None else study.object_distance
    if distance <= (bore := bore_end(Camera.of(design))):
        end = f"d_3 = {bore:g} mm" if bore == design.d_3 else f"its farthest element ends at {bore:g} mm"
        problems.append(Problem("object_distance", f"{distance:g} mm lies within the bore ({end}); move it out"))
    if study.trials > MOST_TRIALS:
        problems.append(Problem("trials", f"{study.trials} would take days and weeks; ask for {MOST_TRIALS} at most"))
    if study.sampling == "sobol" and study.trials > 2**BITS:
        problems.append(Problem("trials", f"a Sobol sequence has {2**BITS} points; ask for fewer, or sample at random"))
    fields, asked = _fields_of(study, design)
    if len(fields) > MOST_FIELDS:
        problems.append(Problem("fields", f"{len(fields)} are too many; ask for {MOST_FIELDS} at most"))
    for index, place in enumerate(fields[:MOST_FIELDS]):
        if words := unseen(design, place):
            goals = (f"goals.{goal}" for goal, own in enumerate(asked) if index in own)
            problems.append(Problem(f"fields.{index}" if index < len(study.fields) else next(goals), words))
    metrics = tuple(dict.fromkeys([*(goal.quantity for goal in study.goals if goal.at is None), *study.report]))
    distant = dict.fromkeys(Column(goal.quantity, None, goal.at) for goal in study.goals if goal.at is not None)
    question = Question(design, metrics, fields, distance, tuple(distant))
    problems += focus_faults(design, *dict.fromkeys(c.metric for c in question.columns if c.quantity.of_views))
    perturbations = _perturbations(study, question, grades, problems)
    members = {line.group for line in study.perturb}
    problems += [
        Problem("groups", f"'{group.name}' has no member; name it as `group` in some [[perturb]]")
        for group in study.groups
        if group.name not in members
    ]
    declared = {group.name: group.correlation for group in study.groups}
    groups = dict.fromkeys(p.group for p in perturbations if p.group)
    limits = []
    for index, goal in enumerate(study.goals):
        wanted = None if goal.at is not None or METRICS[goal.quantity].local is None else asked[index]
        problems += [
            Problem(f"goals.{index}.fields", f"{field} is no field; they run from 0 to {len(study.fields) - 1}")
            for field in goal.asked or ()
            if isinstance(field, int) and not 0 <= field < len(study.fields)
        ]
        low, high = -math.inf if goal.min is None else goal.min, math.inf if goal.max is None else goal.max
        limits += [
            _Limit(number, low, high)
            for number, column in enumerate(question.columns)
            if (column.metric, column.at) == (goal.quantity, goal.at) and (wanted is None or column.field in wanted)
        ]
    draws = Draws(
        perturbations,
        tuple((name, declared.get(name.split(TIED)[0], 1.0)) for name in groups),
        study.sampling,
        study.seed,
    )
    most = _most_sobol_samples(len(draws.factors), len(question.columns))
    if study.sobol_samples > most:
        problems.append(
            Problem(
                "sobol_samples",
                f"{study.sobol_samples} of {len(draws.factors)} factors and"
                f" {len(question.columns)} numbers take more than a gigabyte of memory; ask for {most} at most",
            )
        )
    adjusters = _adjusters(study, design)
    problems += focused_twice(adjusters, perturbations)
    if problems:
        raise InputError(tuple(problems), origin)
    plan = TolerancePlan(
        name=study.name,
        question=question,
        draws=draws,
        limits=tuple(limits),
        adjusters=(),
        calibrated=any(CALIBRATION in line.place for line in study.compensators),
        trials=study.trials,
        # Enough work for a worker, few enough files for a folder.
        chunk=1 << min(20, max(15, math.ceil(math.log2(max(study.trials, 1) / 1024)))),
        keep_trials=study.keep_trials,
        keep_worst=study.keep_worst,
        quantiles=study.quantiles,
    )
    return plan.with_adjusters(*adjusters)


def _adjusters(study: Study, design: Design) -> tuple[Adjuster, ...]:
    """Compensators that move a part."""
    places = {place: line for line in study.compensators for place in line.place if place != CALIBRATION}
    return tuple(
        Adjuster(place, _widths(line.range, (place,), design).get(place, math.inf), line.aim)
        for place, line in places.items()
    )


def focused_twice(adjusters: Collection[Adjuster], perturbations: Iterable[Perturbation]) -> Iterator[Problem]:
    """Faults of a study that focuses each build and says otherwise, too, where its focus is."""
    plane = CONJUGATES[1]
    focusing = [one.place for one in adjusters if one.aim == "focus"]
    if len(focusing) > 1:
        yield Problem("compensators", f"{' and '.join(focusing)} cannot all be set to the focus; leave one of them")
    if focusing:
        words = f'{plane} is what aim = "focus" sets on each build: drop it here, or that compensator'
        if any(p.place == plane for p in perturbations):
            yield Problem("perturb", words)
        if any(one.place == plane for one in adjusters):
            yield Problem("compensators", words)


def _fields_of(study: Study, design: Design) -> tuple[tuple[tuple[float, float], ...], list[list[int]]]:
    """Places that a study looks at [mm], its own first, and which of them each goal is asked for."""
    named = dict(zip(FIELD_NAMES, default_fields(design), strict=True))

    def place_of(field: Any) -> tuple[float, float]:
        x, y = named[field] if isinstance(field, str) else field
        return float(x), float(y)

    places, chosen = [place_of(field) for field in study.fields], []
    for goal in study.goals:
        own: list[int] = []
        for field in range(len(study.fields)) if goal.asked is None else goal.asked:
            if isinstance(field, int):
                own.append(field)
                continue
            place = place_of(field)
            near = [k for k, at in enumerate(places) if math.dist(at, place) < SAME_PLACE]
            places += [] if near else [place]
            own.append(near[0] if near else len(places) - 1)
        chosen.append(own)
    return tuple(places), chosen


def _perturbations(
    study: Study, question: Question, grades: Grades, problems: list[Problem]
) -> tuple[Perturbation, ...]:
    design = question.design
    nominal = nominal_values(design)
    missed = partial(Perturbation, distribution=study.distribution, truncation=study.truncate)
    graded = {}
    if study.grade:
        widths = grades.tolerances(study.grade, design)
        words = grades.provenance(design)
        graded = {
            place: missed(place, nominal[place], width, source=f"{study.grade}: {words[place]}")
            for place, width in widths.items()
        }
    if design.sensor.relay_magnification == 1:
        graded.pop("sensor.relay_magnification", None)  # there is no relay to be wrong
    adjusted = {LEFT + place for compensator in study.compensators for place in compensator.place}
    graded = {place: miss for place, miss in graded.items() if place in adjusted or not place.startswith(LEFT)}
    result = {place: miss for place, miss in graded.items() if place not in study.exclude}
    given: set[str] = set()
    for index, line in enumerate(study.perturb):
        own = _widths(line.tolerance, line.place, design)
        for place in line.place:
            if place.startswith(LENSLETS) and int(place.split(".")[2]) >= len(question.fields):
                continue  # nobody looks at it
            key = f"perturb.{index}.place"
            if place in given:
                problems.append(Problem(key, f"{place} is given twice; keep one line"))
            given.add(place)
            miss = graded.get(place)
            if place in own:
                miss = missed(place, nominal[place], own[place], source=OWN)
            if miss is None:
                why = f"the grade '{study.grade}' does not cover it" if study.grade else "the study names no grade"
                problems.append(Problem(key, f"{place} has no tolerance and {why}; add tolerance = ..."))
                continue
            result[place] = replace(
                miss,
                distribution=line.distribution or miss.distribution,
                truncation=line.truncate or miss.truncation,
                group=_tied(line.group, place),
                opposed=line.opposed,
            )
    for compensator in study.compensators:
        left = [LEFT + place for place in compensator.place]
        for place, width in _widths(compensator.error, left, design).items():
            result[place] = missed(place, 0.0, width, source=OWN)
            if not width:
                del result[place]  # without error, as it is told
        for place in compensator.place if compensator.aim == "focus" and compensator.error is None else ():
            if LEFT + place not in result and math.isfinite(width := focus_shown(question, place)[1]):
                result[LEFT + place] = missed(LEFT + place, 0.0, width, source=VIEWS)
    if (warm := result.get(TEMPERATURE)) is not None and (growth := Growth.of(design)) is not None:
        ends = np.array([warm.nominal - warm.tolerance, warm.nominal + warm.tolerance])
        lines = (f"perturb.{k}.tolerance" for k, line in enumerate(study.perturb) if TEMPERATURE in line.place)
        key = next(lines, "grade")
        for known, within in growth.known(ends):
            if not within.all():
                reach = f"{warm.nominal:g} +- {warm.tolerance:g} degC reaches {ends[0]:g} to {ends[1]:g} degC"
                remedy = "take a tolerance, or a temperature in [environment], that stays inside"
                problems.append(Problem(key, f"{reach}, beyond what is known of {known}; {remedy}"))
    if not result:
        problems.append(Problem("perturb", "nothing is perturbed; name a grade or add [[perturb]] tables"))
    if all(place in result for place in CONJUGATES):
        f, plane, distance = CONJUGATES
        problems.append(Problem("perturb", f"{f}, {plane} and {distance} cannot all miss; one follows from two"))
    return tuple(result.values())


def _tied(group: str | None, place: str) -> str | None:
    """Parts on one barrel share their shift along x, along y, their tilts: each pose is tied to its like."""
    *_, name, axis = place.split(".")
    pose = f"{name} {'xy'[int(axis)] if axis in '01' else axis}"
    return f"{group}{TIED}{pose}" if group and axis.isdigit() else group
