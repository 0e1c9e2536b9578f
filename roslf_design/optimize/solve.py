"""Solving a problem: many starts, a second solver as a check, and an answer that says how far to trust it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .conflicts import Conflict, explain
from .gradients import gradient_error
from .guard import Guard
from .local import Search, search
from .multipliers import Conditions, conditions
from .problem import Constraint, Goal, Problem
from .runs import FTOL, GLOBAL_FTOL, Global, Stop, globally
from .sampling import sobol_units

Array = NDArray[np.float64]

AGREE = 1e-6
"""Difference of merit (1e-6: goals equal to 1e-4 %) within which two searches found the same."""

LOOSE = 0.01
"""Relative difference of a variable between equally good designs that is worth telling."""

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """How hard to look."""

    starts: int = 16
    """Local searches, from Sobol points."""
    seed: int = 0
    evaluations: int = 300
    """Of one local run."""
    seconds: float = 60.0
    """For the whole problem."""
    check: bool = True
    """Whether CRS2_LM looks again."""
    isres: bool = False
    """Whether ISRES does too."""
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


@dataclass(frozen=True)
class Check:
    """What another solver found."""

    solver: str
    evaluations: int
    stop: Stop
    merit: float | None
    """Of its own best feasible point; None where it met none."""
    polished: Search
    """A local search from its best point."""
    within: float = AGREE
    """Difference of merit that does not count."""

    def agrees(self, merit: float) -> bool:
        """Whether its polished point is the answer, or no better."""
        return not self.polished.feasible or self.polished.merit >= merit - self.within


@dataclass(frozen=True)
class Stage:
    """One goal of a lexicographic order, solved."""

    goal: str
    value: float
    held: str
    """The limit that it puts on later stages."""


@dataclass(frozen=True)
class Answer:
    """What was found."""

    problem: Problem
    """As solved: of a lexicographic order, the last stage."""
    asked: Problem
    """As posed."""
    unit: Array
    """Scaled variables of the best or, where nothing is feasible, the least violating point."""
    merit: float
    violation: float
    feasible: bool
    conditions: Conditions | None
    """None where infeasible."""
    conflict: Conflict | None
    """Why nothing is feasible; None where something is."""
    searches: tuple[Search, ...]
    checks: tuple[Check, ...]
    stages: tuple[Stage, ...]
    gradient_error: float
    evaluations: int
    seconds: float
    notes: tuple[str, ...]
    agree: float = AGREE
    """Difference of merit within which two searches found the same."""
    gained: float = 0.0
    """By how much the merit fell when the best was polished once more: what the searches had left."""

    @property
    def same(self) -> int:
        """How many starts ended at the answer."""
        return sum(s.feasible and abs(s.merit - self.merit) <= self.agree for s in self.searches)

    @property
    def reached(self) -> int:
        """How many starts ended at a feasible point."""
        return sum(s.feasible for s in self.searches)

    def loose(self) -> dict[str, tuple[float, float]]:
        """Variables that differ between starts that ended equally good: name to least and greatest value [mm]."""
        equal = [s.unit for s in self.searches if s.feasible and abs(s.merit - self.merit) <= self.agree]
        if len(equal) < 2:
            return {}
        values = self.problem.values(np.stack(equal))
        ends = {v.name: (float(values[v.place].min()), float(values[v.place].max())) for v in self.problem.variables}
        return {name: (low, high) for name, (low, high) in ends.items() if high - low > LOOSE * max(abs(high), 1e-12)}

    def variables(self) -> dict[str, float]:
        """Name to value [mm]."""
        values = self.problem.values(self.unit[None])
        return {v.name: float(values[v.place][0]) for v in self.problem.variables}

    def number(self, part: Constraint | Goal) -> float:
        """Value of a constraint's or goal's quantity."""
        return float(np.ravel(part.values(self.problem.cameras(self.unit[None])))[0])


def solve(problem: Problem, settings: Settings = Settings(), tell: Tell = lambda _: None) -> Answer:
    """The best design, or what stands in the way.

    Parameters
    ----------
    problem : Problem
    settings : Settings
    tell : callable
        Told what is being done.
    """
    began = time.monotonic()
    deadline = began + settings.seconds
    if problem.order == "weighted" or len(problem.goals) == 1:
        answer = _solve(problem, settings, deadline, tell, _starts(problem, settings))
        return replace(answer, seconds=time.monotonic() - began)
    stages: list[Stage] = []
    current = replace(problem, goals=problem.goals[:1], order="weighted")
    spent, starts = 0, _starts(problem, settings)
    for number, goal in enumerate(problem.goals):
        current = replace(current, goals=(goal,))
        last = number == len(problem.goals) - 1
        part = settings if last else replace(settings, check=False, isres=False)
        answer = _solve(current, part, deadline, tell, starts)
        spent += answer.evaluations
        if not answer.feasible:
            break
        held = _held(answer, goal, problem.slack)
        value = answer.number(goal)
        limit = "" if last else f"{goal.label} {'<=' if held.low is None else '>='} {held.limit(held.sides[0]):.6g}"
        stages.append(Stage(goal.label, value, limit))
        starts = [answer.unit, *starts]
        if not last:
            current = replace(current, constraints=(*current.constraints, held))
    return replace(answer, asked=problem, stages=tuple(stages), evaluations=spent, seconds=time.monotonic() - began)


def _held(answer: Answer, goal: Goal, slack: float) -> Constraint:
    value = answer.number(goal)
    give = slack * (abs(value) if goal.quantity.positive else answer.problem.goal_scale(0)) * goal.sign
    limit = value + give
    return Constraint(goal.quantity, None if goal.sign > 0 else limit, limit if goal.sign > 0 else None, goal.at)


def _starts(problem: Problem, settings: Settings) -> list[Array]:
    given = [v.start for v in problem.variables]
    first = []
    if any(value is not None for value in given):
        # Unclipped, so that a start outside its bounds can be told.
        first = [
            np.array(
                [
                    0.5 if s is None else _unclipped(v.unit(s), s, v.low, v.high)
                    for v, s in zip(problem.variables, given, strict=True)
                ]
            )
        ]
    return [*first, *sobol_units(problem.n, settings.starts, settings.seed)]


def _unclipped(unit: float, value: float, low: float, high: float) -> float:
    return -0.01 if value < low else 1.01 if value > high else unit


def _solve(problem: Problem, settings: Settings, deadline: float, tell: Tell, starts: Sequence[Array]) -> Answer:
    found: list[Search] = []
    for number, start in enumerate(starts, 1):
        if found and time.monotonic() > deadline:
            break
        tell(f"start {number} of {len(starts)}")
        found.append(_search(problem, start, deadline, settings))
    best = min(found, key=lambda s: (not s.feasible, s.merit if s.feasible else s.violation))
    checks: list[Check] = []
    conditions_found = conditions(problem, best.unit) if best.feasible else None
    for name in _checkers(settings):
        if time.monotonic() > deadline:
            break
        tell(f"checking with {name}")
        check = _check(problem, name, settings, deadline, conditions_found)
        checks.append(check)
        if (check.polished.feasible, -check.polished.merit) > (best.feasible, -best.merit) and check.polished.feasible:
            better_by = best.merit - check.polished.merit if best.feasible else np.inf
            if better_by > settings.agree:
                best = check.polished
                conditions_found = conditions(problem, best.unit)
    gained = 0.0
    if best.feasible:
        polished = search(problem, best.unit, deadline, settings.evaluations)
        if polished.feasible and polished.merit < best.merit:
            gained, best = best.merit - polished.merit, polished
            conditions_found = conditions(problem, best.unit)
    conflict = None
    if not best.feasible:
        tell("finding what stands in the way")
        conflict = explain(problem, [s.unit for s in sorted(found, key=lambda s: s.violation)], deadline, settings.seed)
        if conflict.feasible_after_all is not None:
            again = search(problem, conflict.feasible_after_all, deadline, settings.evaluations)
            if again.feasible:
                found.append(again)
                best, conflict, conditions_found = again, None, conditions(problem, again.unit)
        else:
            best = replace(best, unit=conflict.unit, violation=conflict.violation)
    return Answer(
        problem=problem,
        asked=problem,
        unit=best.unit,
        merit=best.merit,
        violation=best.violation,
        feasible=best.feasible and conflict is None,
        conditions=conditions_found,
        conflict=conflict,
        searches=tuple(found),
        checks=tuple(checks),
        stages=(),
        gradient_error=gradient_error(problem.vector, best.unit),
        evaluations=sum(s.evaluations for s in found) + sum(c.evaluations + c.polished.evaluations for c in checks),
        seconds=0.0,
        notes=tuple(_notes(found, len(starts))),
        agree=settings.agree,
        gained=gained,
    )


def _search(problem: Problem, start: Array, deadline: float, settings: Settings) -> Search:
    """A local search, as thorough as the accuracy asks for."""
    return search(
        problem,
        start,
        deadline,
        settings.evaluations,
        polish=settings.accuracy is None,
        tolerance=settings.tolerance,
    )


def _checkers(settings: Settings) -> list[Global]:
    asked: tuple[tuple[Global, bool], ...] = (("crs2", settings.check), ("isres", settings.isres))
    return [name for name, wanted in asked if wanted]


def _check(problem: Problem, name: Global, settings: Settings, deadline: float, known: Conditions | None) -> Check:
    steepest = max((a.multiplier for a in known.active), default=0.0) if known is not None else 10.0
    guard = Guard(problem, deadline)
    ftol = max(GLOBAL_FTOL, settings.tolerance)
    stop, unit = globally(guard, name, 1.0 + 3.0 * steepest, min(1500 * problem.n, 9000), settings.seed, ftol)
    if name == "isres" and guard.unit is not None:
        unit = guard.unit  # it minimises no penalty: its best point is the best feasible one
    polished = _search(problem, unit, deadline, settings)
    return Check(
        {"crs2": "CRS2_LM with penalty", "isres": "ISRES"}[name],
        guard.evaluations,
        stop,
        guard.merit if guard.feasible else None,
        polished,
        settings.agree,
    )


def _notes(found: Sequence[Search], wanted: int) -> list[str]:
    notes = []
    if len(found) < wanted:
        notes.append(f"time ran out after {len(found)} of {wanted} starts; give more seconds for a surer answer")
    if any(s.clipped for s in found):
        notes.append("a start lay outside the bounds and was moved onto them")
    mapped, faults = sum(s.mapped for s in found), sum(s.faults for s in found)
    if mapped:
        notes.append(f"{mapped} evaluations met numbers that are not finite; they counted as very bad")
    if faults:
        first = next(s.fault for s in found if s.fault)
        notes.append(f"{faults} evaluations were refused; the first because: {first}")
    return notes
