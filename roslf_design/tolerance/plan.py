"""A study made ready to run: every place, number and limit resolved, one frozen value that travels to any worker."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..errors import InputError, Problem
from ..evaluation import default_fields
from .camera import DISTANCE, FOCAL, PLANE
from .draws import BITS, Draws, Perturbation
from .grades import Grades
from .metrics import METRICS, Column, Question, evaluate_builds
from .places import nominal_values, parse_tolerance, perturbable
from .study import CALIBRATION, FIELD_NAMES, Goal, Study, load_study, read_study

Array = NDArray[np.float64]

FORMAT = 2
"""Raised when the same plan would give other bytes; part of the digest that guards a resumed run."""
TIED = ": "
"""Between a group's name and the pose that its members share."""


@dataclass(frozen=True)
class Limit:
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


@dataclass(frozen=True)
class Plan:
    """What runs."""

    name: str
    question: Question
    draws: Draws
    limits: tuple[Limit, ...]
    adjusters: tuple[Adjuster, ...]
    calibrated: bool
    """Whether full calibration is among the compensators."""
    trials: int
    chunk: int
    """Trials a chunk."""
    keep_trials: int
    keep_worst: int
    quantiles: tuple[float, ...]

    @property
    def compensated(self) -> bool:
        """Whether anything is adjusted after the build."""
        return bool(self.adjusters) or self.calibrated

    @property
    def chunks(self) -> int:
        """How many chunks there are; the last may be short."""
        return -(-self.trials // self.chunk)

    def chunk_trials(self, index: int) -> int:
        """Trials of one chunk."""
        return min(self.chunk, self.trials - index * self.chunk)

    @property
    def columns(self) -> tuple[Column, ...]:
        """What is measured of each build."""
        return self.question.columns

    @property
    def nominal(self) -> Array:
        """The nominal design's columns, shape (columns,)."""
        return evaluate_builds(self.question, {}, 1)[:, 0]

    def nominal_misses(self) -> tuple[str, ...]:
        """Labels of the limits that the nominal design itself does not hold: no tolerance mends those."""
        nominal = self.nominal
        missed = [self.columns[l.column].label for l in self.limits if not l.low <= nominal[l.column] <= l.high]
        return tuple(dict.fromkeys(missed))

    def passes(self, values: Array) -> NDArray[np.bool_]:
        """Which limits hold, shape (limits, trials), for values of shape (columns, trials); NaN never passes."""
        held = np.empty((len(self.limits), values.shape[1]), bool)
        for row, limit in enumerate(self.limits):
            value = values[limit.column]
            held[row] = (value >= limit.low) & (value <= limit.high)
        return held

    def digest(self) -> str:
        """Fingerprint of all that decides the results' bytes."""
        text = json.dumps([FORMAT, repr(self), self.question.design.model_dump(mode="json")], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def with_draws(self, **changes: Any) -> Plan:
        """The same plan with its draws changed."""
        return replace(self, draws=replace(self.draws, **changes))


def chunk_size(trials: int) -> int:
    """Trials a chunk: enough work for a worker, few enough files for a folder."""
    return 1 << min(20, max(15, math.ceil(math.log2(max(trials, 1) / 1024))))


def load_plan(path: Path, *, trials: int | None = None, seed: int | None = None) -> tuple[Plan, Study, Grades]:
    """Read a study file and resolve it; `trials` and `seed` override the file's.

    Raises
    ------
    InputError
        Every fault of the file.
    """
    study, design, grades = load_study(path)
    changes = {"trials": trials, "seed": seed}
    study = study.model_copy(update={key: value for key, value in changes.items() if value is not None})
    return make_plan(study, design, grades, str(path)), study, grades


def plan_from(data: Mapping[str, Any]) -> Plan:
    """A plan from the nested values of a study, for scripts."""
    return make_plan(*read_study(data))


def make_plan(study: Study, design: Design, grades: Grades, origin: str = "") -> Plan:
    """Resolve a study.

    Raises
    ------
    InputError
        Every fault between its tables.
    """
    problems: list[Problem] = []
    fields = tuple(_field(item, design) for item in study.fields)
    distance = design.d_f if study.object_distance is None else study.object_distance
    if distance <= design.d_3:
        problems.append(
            Problem("object_distance", f"{distance:g} mm lies within the bore (d_3 = {design.d_3:g} mm); move it out")
        )
    if study.sampling == "sobol" and study.trials > 2**BITS:
        problems.append(Problem("trials", f"a Sobol sequence has {2**BITS} points; ask for fewer, or sample at random"))
    metrics = tuple(dict.fromkeys([*(goal.metric for goal in study.goals), *study.report]))
    question = Question(design, metrics, fields, distance)
    perturbations = _perturbations(study, design, grades, problems)
    declared = {group.name: group.correlation for group in study.groups}
    used = dict.fromkeys(p.group for p in perturbations if p.group)
    bases = {line.group for line in study.perturb if line.group}
    lonely = [name for name in declared if name not in bases]
    no_member = "has no member; name it as `group` in some [[perturb]]"
    problems += [Problem("groups", f"'{name}' {no_member}") for name in lonely]
    correlations = tuple((name, declared.get(name.split(TIED)[0], 1.0)) for name in used)
    limits = tuple(
        limit for index, goal in enumerate(study.goals) for limit in _limits(index, goal, question, problems)
    )
    adjusters, calibrated = _adjusters(study, design)
    if problems:
        raise InputError(tuple(problems), origin)
    draws = Draws(perturbations, correlations, study.sampling, study.seed)
    plan = Plan(
        study.name,
        question,
        draws,
        tuple(limits),
        adjusters,
        calibrated,
        study.trials,
        chunk_size(study.trials),
        study.keep_trials,
        study.keep_worst,
        study.quantiles,
    )
    return plan


def _field(item: Any, design: Design) -> tuple[float, float]:
    if isinstance(item, str):
        return default_fields(design)[FIELD_NAMES.index(item)]
    return float(item[0]), float(item[1])


def _perturbations(study: Study, design: Design, grades: Grades, problems: list[Problem]) -> tuple[Perturbation, ...]:
    kinds, nominal = perturbable(design), nominal_values(design)
    graded = grades.tolerances(study.grade, design) if study.grade else {}
    if design.sensor.relay_magnification == 1:
        graded.pop("sensor.relay_magnification", None)  # there is no relay to be wrong
    origin = grades.provenance(design)
    found = {
        place: Perturbation(
            place, nominal[place], width, study.distribution, study.truncate, source=f"{study.grade}: {origin[place]}"
        )
        for place, width in graded.items()
        if place not in study.exclude
    }
    seen: set[str] = set()
    for index, line in enumerate(study.perturb):
        for place in line.place:
            key = f"perturb.{index}.place"
            if place in seen:
                problems.append(Problem(key, f"{place} is given twice; keep one line"))
            seen.add(place)
            if line.tolerance is None and place not in graded:
                why = f"the grade '{study.grade}' does not cover it" if study.grade else "the study names no grade"
                problems.append(Problem(key, f"{place} has no tolerance and {why}; add tolerance = ..."))
                continue
            width = (
                graded[place]
                if line.tolerance is None
                else parse_tolerance(line.tolerance, kinds[place], nominal[place])
            )
            source = f"{study.grade}: {origin[place]}" if line.tolerance is None else "this study"
            found[place] = Perturbation(
                place,
                nominal[place],
                width,
                line.distribution or study.distribution,
                line.truncate or study.truncate,
                _tied(line.group, place),
                line.opposed,
                source,
            )
    if not found:
        problems.append(Problem("perturb", "nothing is perturbed; name a grade or add [[perturb]] tables"))
    if all(place in found for place in (FOCAL, PLANE, DISTANCE)):
        problems.append(Problem("perturb", f"{FOCAL}, {PLANE} and {DISTANCE} cannot all miss; one follows from two"))
    return tuple(found.values())


def _tied(group: str | None, place: str) -> str | None:
    """Parts on one barrel share their shift along x, along y, their tilts: each pose is tied to its like."""
    *_, name, axis = place.split(".")
    pose = f"{TIED}{name} {'xy'[int(axis)]}" if axis.isdigit() else ""
    return f"{group}{pose}" if group else None


def _limits(index: int, goal: Goal, question: Question, problems: list[Problem]) -> list[Limit]:
    count = len(question.fields)
    wanted = goal.fields if METRICS[goal.metric].per_field else None
    key, beyond = f"goals.{index}.fields", [field for field in wanted or () if not 0 <= field < count]
    problems += [Problem(key, f"{field} is no field; they run from 0 to {count - 1}") for field in beyond]
    low = -math.inf if goal.min is None else goal.min
    high = math.inf if goal.max is None else goal.max
    return [
        Limit(number, low, high)
        for number, column in enumerate(question.columns)
        if column.metric == goal.metric and (wanted is None or column.field in wanted)
    ]


def _adjusters(study: Study, design: Design) -> tuple[tuple[Adjuster, ...], bool]:
    kinds, nominal = perturbable(design), nominal_values(design)
    found: dict[str, Adjuster] = {}
    for line in study.compensators:
        for place in line.place:
            if place != CALIBRATION:
                reach = math.inf if line.range is None else parse_tolerance(line.range, kinds[place], nominal[place])
                found[place] = Adjuster(place, reach)
    return tuple(found.values()), any(CALIBRATION in line.place for line in study.compensators)
