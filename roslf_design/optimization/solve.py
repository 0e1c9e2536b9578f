"""Solving a problem: many starts, a second solver as a check, and an answer that says how far to trust it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..accuracy.statement import Accuracy
from ..tolerancing.study import StrictTable
from .conflicts import Conflict, explain
from .problem import Constraint, DesignProblem, Goal, sobol_units
from .search import FTOL, GLOBAL_FTOL, Global, Guard, Search, globally, gradient_error, search, value_and_jacobian

Array = NDArray[np.float64]

AGREE = 1e-6
"""Difference of merit (1e-6: goals equal to 1e-4 %) within which two searches found the same."""
LOOSE = 0.01
"""Relative difference of a variable between equally good designs that is worth telling."""
TOUCHING = 1e-6
"""Scaled rows and variables this close to their limit count as on it."""

Tell = Callable[[str], None]


class SolverTable(StrictTable):
    """How hard to look, as a study says it."""

    starts: Annotated[int, Field(ge=1, le=4096)] = 16
    """Local searches, from Sobol points."""
    evaluations: Annotated[int, Field(ge=10)] = 300
    """Of one local run."""
    seconds: Annotated[float, Field(gt=0)] = 60.0
    """For the whole problem."""
    check: bool = True
    """Whether CRS2_LM looks again."""
    isres: bool = False
    """Whether ISRES does too."""


class Settings(SolverTable):
    """The same with what a command may say instead."""

    seed: int = 0
    accuracy: float | None = None
    """What the merit may be off by (0.01: 1 % of a goal); None polishes every search to rounding."""

    @property
    def agree(self) -> float:
        """Difference of merit within which two searches found the same."""
        return AGREE if self.accuracy is None else max(AGREE, self.accuracy)

    @property
    def tolerance(self) -> float:
        """Change of the merit at which a search that is not polished ends.

        A hundredth: along a curved valley (Rosenbrock's) the last of many small steps leaves up to fifty of them.
        """
        return FTOL if self.accuracy is None else max(FTOL, self.accuracy / 100)


USUAL = Settings()


@dataclass(frozen=True)
class Check:
    """What another solver found."""

    solver: str
    evaluations: int
    merit: float | None
    """Of its own best feasible point; None where it met none."""
    polished: Search
    """A local search from its best point."""


@dataclass(frozen=True)
class Stage:
    """One goal of a lexicographic order, solved."""

    goal: str
    value: float
    held: str
    """The limit that it puts on later stages."""


@dataclass(frozen=True)
class Active:
    """A limit that the optimum touches."""

    limit: str
    """E.g. ``fill_factor <= 1`` or ``d_3 <= 8 mm``."""
    unit: str
    """Of the limit."""
    multiplier: float
    """Change of the scaled merit per unit of the scaled row; 0 where the limit only happens to be touched."""
    merit_gain_per_unit: float
    """By how much the merit falls (0.01: the goals get 1 % better) where the limit is relaxed by one unit."""
    goal_gain_per_unit: float | None
    """The same for a single goal, in the goal's unit: how much better it gets."""


@dataclass(frozen=True)
class Answer:
    """What was found."""

    problem: DesignProblem
    """As solved: of a lexicographic order, the last stage."""
    asked: DesignProblem
    """As posed."""
    unit: Array
    """Scaled variables of the best or, where nothing is feasible, the least violating point."""
    merit: float
    violation: float
    feasible: bool
    active: tuple[Active, ...]
    """Limits that the optimum rests on; none where infeasible."""
    residual: float
    """Of the first-order conditions: length of what no multiplier explains, over the length of the merit's gradient."""
    conflict: Conflict | None
    """Why nothing is feasible; None where something is."""
    searches: tuple[Search, ...]
    checks: tuple[Check, ...]
    stages: tuple[Stage, ...]
    gradient_error: float
    evaluations: int
    seconds: float
    notes: tuple[str, ...]
    settings: Settings
    gained: float = 0.0
    """By how much the merit fell when the best was polished once more: what the searches had left."""

    @property
    def equals(self) -> tuple[Search, ...]:
        """Searches that ended at the answer, or equally good."""
        return tuple(s for s in self.searches if s.feasible and abs(s.merit - self.merit) <= self.settings.agree)

    @property
    def same(self) -> int:
        """How many starts ended at the answer."""
        return len(self.equals)

    @property
    def reached(self) -> int:
        """How many starts ended at a feasible point."""
        return sum(s.feasible for s in self.searches)

    def agrees(self, check: Check) -> bool:
        """Whether another solver's polished point is the answer, or no better."""
        return not check.polished.feasible or check.polished.merit >= self.merit - self.settings.agree

    def loose(self) -> dict[str, tuple[float, float]]:
        """Variables that differ between starts that ended equally good: name to least and greatest value [mm]."""
        designs = [self.problem.named(s.unit) for s in self.equals]
        values = {name: [design[name] for design in designs] for name in (self.problem.variables if designs else ())}
        ends = {name: (min(each), max(each)) for name, each in values.items()}
        return {name: (low, high) for name, (low, high) in ends.items() if high - low > LOOSE * max(abs(high), 1e-12)}

    def variables(self) -> dict[str, float]:
        """Name to value [mm]."""
        return self.problem.named(self.unit)

    def number(self, part: Constraint | Goal) -> float:
        """Value of a constraint's or goal's quantity."""
        return self.problem.number(part, self.unit)


def solve(problem: DesignProblem, settings: Settings = USUAL, tell: Tell = lambda _: None) -> Answer:
    """The best design, or what stands in the way; `tell` is told what is being done."""
    began = time.monotonic()
    deadline = began + settings.seconds
    starts = _starts(problem, settings)
    if problem.order == "weighted" or len(problem.goals) == 1:
        return replace(_solve(problem, settings, deadline, tell, starts), seconds=time.monotonic() - began)
    stages: list[Stage] = []
    current, spent = replace(problem, order="weighted"), 0
    for number, goal in enumerate(problem.goals, 1):
        current = replace(current, goals=(goal,))
        last = number == len(problem.goals)
        part = settings if last else settings.model_copy(update={"check": False, "isres": False})
        answer = _solve(current, part, deadline, tell, starts)
        spent += answer.evaluations
        if not answer.feasible:
            break
        value = answer.number(goal)
        held = goal.held(value + goal.sign * problem.slack * _goal_per_merit(current, answer.unit))
        stages.append(Stage(goal.label, value, "" if last else str(held)))
        starts = [answer.unit, *starts]
        if not last:
            current = replace(current, constraints=(*current.constraints, held))
    return replace(answer, asked=problem, stages=tuple(stages), evaluations=spent, seconds=time.monotonic() - began)


def _starts(problem: DesignProblem, settings: Settings) -> list[Array]:
    """Where searches start: as given, not clipped, so that a start outside its bounds can be told; Sobol points."""
    bounds = problem.variables.values()
    first = [
        0.5 if v.start is None else -0.01 if v.start < v.min else 1.01 if v.start > v.max else v.unit(v.start)
        for v in bounds
    ]
    given = [np.array(first)] if any(v.start is not None for v in bounds) else []
    return [*given, *sobol_units(problem.n, settings.starts, settings.seed)]


def _solve(problem: DesignProblem, settings: Settings, deadline: float, tell: Tell, starts: Sequence[Array]) -> Answer:
    searches: list[Search] = []
    for number, start in enumerate(starts, 1):
        if searches and time.monotonic() > deadline:
            break
        tell(f"start {number} of {len(starts)}")
        searches.append(search(problem.vector, start, deadline, settings.evaluations, settings.tolerance))
    best = min(searches, key=lambda s: (not s.feasible, s.merit if s.feasible else s.violation))
    notes = _notes(searches, len(starts))
    checks: list[Check] = []
    wanted: dict[Global, bool] = {"crs2": settings.check, "isres": settings.isres}
    for name in (name for name, asked in wanted.items() if asked):
        if time.monotonic() > deadline:
            break
        tell(f"checking with {name}")
        checks.append(_check(problem, name, settings, deadline, best))
        other = checks[-1].polished
        if other.feasible and (not best.feasible or best.merit - other.merit > settings.agree):
            best = other
    gained, conflict = 0.0, None
    if best.feasible:
        polished = search(problem.vector, best.unit, deadline, settings.evaluations)
        if polished.feasible and polished.merit < best.merit:
            gained, best = best.merit - polished.merit, polished
    else:
        tell("finding what stands in the way")
        points = [s.unit for s in sorted(searches, key=lambda s: s.violation)]
        conflict = explain(problem, points, deadline, settings.seed)
        best = replace(best, unit=conflict.unit, violation=conflict.violation)
        if conflict.feasible_after_all:
            again = search(problem.vector, conflict.unit, deadline, settings.evaluations)
            if again.feasible:
                searches.append(again)
                best, conflict = again, None
    feasible = best.feasible and conflict is None
    active, residual = conditions(problem, best.unit) if feasible else ((), 0.0)
    return Answer(
        problem=problem,
        asked=problem,
        unit=best.unit,
        merit=best.merit,
        violation=best.violation,
        feasible=feasible,
        active=active,
        residual=residual,
        conflict=conflict,
        searches=tuple(searches),
        checks=tuple(checks),
        stages=(),
        gradient_error=gradient_error(problem.vector, best.unit),
        evaluations=sum(s.evaluations for s in searches) + sum(c.evaluations + c.polished.evaluations for c in checks),
        seconds=0.0,
        notes=tuple(notes),
        settings=settings,
        gained=gained,
    )


def _check(problem: DesignProblem, name: Global, settings: Settings, deadline: float, best: Search) -> Check:
    known = conditions(problem, best.unit)[0] if best.feasible else ()
    steepest = max((a.multiplier for a in known), default=0.0 if best.feasible else 10.0)
    guard = Guard(problem.vector, deadline)
    ftol, most = max(GLOBAL_FTOL, settings.tolerance), min(1500 * problem.n, 9000)
    unit = globally(guard, problem.n, name, 1.0 + 3.0 * steepest, most, settings.seed, ftol)
    polished = search(problem.vector, unit, deadline, settings.evaluations, settings.tolerance)
    solver = {"crs2": "CRS2_LM with penalty", "isres": "ISRES"}[name]
    return Check(solver, guard.evaluations, guard.merit if guard.feasible else None, polished)


def _notes(searches: Sequence[Search], wanted: int) -> list[str]:
    notes = []
    if len(searches) < wanted:
        notes.append(f"time ran out after {len(searches)} of {wanted} starts; give more seconds for a surer answer")
    if any(s.clipped for s in searches):
        notes.append("a start lay outside the bounds and was moved onto them")
    mapped = sum(s.mapped for s in searches)
    if mapped:
        notes.append(f"{mapped} evaluations met numbers that are not finite; they counted as very bad")
    return notes


def conditions(problem: DesignProblem, unit: Array) -> tuple[tuple[Active, ...], float]:
    """Limits that a point rests on, hardest first, by non-negative least squares on the gradients.

    Beside it the length of what no multiplier explains, over the length of the merit's gradient: 0 at an optimum.
    """
    from scipy.optimize import nnls

    values, jacobian = value_and_jacobian(problem.vector, unit)
    columns: list[Array] = []
    limits: list[tuple[str, str, float]] = []
    for row, value, slope in zip(problem.rows, values[1:], jacobian[1:], strict=True):
        if row.constraint >= 0 and value >= -TOUCHING:
            columns.append(slope)
            limits.append((row.label, problem.constraints[row.constraint].quantity.unit, row.size))
    for i, (name, variable) in enumerate(problem.variables.items()):
        if variable.max > variable.min and not TOUCHING <= unit[i] <= 1 - TOUCHING:
            upper = unit[i] > 0.5
            columns.append((1.0 if upper else -1.0) * np.eye(problem.n)[i])
            limits.append((f"{name} {variable.end(upper)}", "mm", variable.rate(float(unit[i]))))
    length = float(np.linalg.norm(jacobian[0]))
    if not columns:
        return (), 1.0 if length > 1e-6 else 0.0
    per_merit = _goal_per_merit(problem, unit) if len(problem.goals) == 1 else None
    multipliers, residual = nnls(np.stack(columns, axis=1), -jacobian[0])
    merged: dict[str, Active] = {}
    for (label, kind, size), multiplier in zip(limits, multipliers.tolist(), strict=True):
        gain = multiplier / size
        if label not in merged or multiplier > merged[label].multiplier:
            merged[label] = Active(label, kind, multiplier, gain, None if per_merit is None else gain * per_merit)
    order = sorted(merged.values(), key=lambda a: -a.multiplier)
    return tuple(order), float(residual) / max(length, 1e-12)


def _goal_per_merit(problem: DesignProblem, unit: Array) -> float:
    """How much a single goal changes where the merit changes by 1."""
    goal = problem.goals[0]
    return problem.number(goal, unit) if goal.quantity.positive else problem.goal_scale(0)


def optimum_accuracy(answer: Answer, seconds: float | None = None) -> Accuracy | None:
    """Method, expected and measured error of an answer's merit; None where no design was found."""
    if not answer.feasible:
        return None
    asked, checks = answer.settings.accuracy, ", ".join(check.solver for check in answer.checks)
    method = f"SLSQP from {len(answer.searches)} starts to {answer.settings.tolerance:g}, the best polished"
    return Accuracy(
        "merit of the optimum (0.01: 1 % of a goal)",
        method + (f"; checked by {checks}" if checks else ""),
        AGREE if asked is None else asked,
        answer.gained,
        "what one more search gained",
        asked,
        seconds,
        model="that no better optimum lies elsewhere is only as sure as the starts and checks agree",
    )
