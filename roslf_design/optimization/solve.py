"""Solving a problem: many starts, a second solver as a check, and an answer that says how far to trust it.

Where nothing is feasible, why: the least-violating point, the smallest set of limits that conflict, and remedies. Where
goals compete, a front: all but one limited, going from limit to limit, each warm-started.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from operator import itemgetter
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from .._arrays import Array, by_value
from ..accuracy.statement import Accuracy
from ..json_data import plain
from ..theory.quantity import finite, from_finite
from ..toml_files import StrictTable
from .problem import (
    ROOM,
    Constraint,
    DesignProblem,
    Goal,
    Side,
    lengths_and_numbers,
    promising_starts,
    sobol_units,
)
from .search import (
    BIG,
    FEASIBLE,
    FTOL,
    GLOBAL_FTOL,
    Global,
    Guard,
    Search,
    SearchBudget,
    globally,
    gradient_error,
    least_violation,
    search,
    value_and_jacobian,
    violation_of,
)

AGREE = 1e-6
"""Difference of merit (1e-6: goals equal to 1e-4 %) within which two searches found the same."""
CLOSE = 1e-3
"""Room that is left to what is no camera any more, within which a pole there draws a search on."""
STEADY = 0.5
"""Part of what a goal gained over a tenfold of that room that it gains again a hundredfold nearer: at a pole all of it
or more, where it is finite next to nothing."""
LOOSE = 0.01
"""Relative difference of a variable between equally good designs that is worth telling."""
TOUCHING = 1e-6
"""Scaled rows and variables this close to their limit count as on it."""

FRESH = 6
"""Sobol points from which it is asked whether some of the limits can hold, and for the ends of a front."""
HAIR = 1e-6
"""Relative loss in its own goal that an end of a front accepts, to leave worse designs that are as good in it."""

LARGEST = 1e300
"""Where numbers are compared, what stands for infinity."""

EXPLAINING = 10_000, 10.0
"""Evaluations, and seconds where there is a clock, that why nothing is feasible may take at least."""

Tell = Callable[[str], None]


class SolverTable(StrictTable):
    """Effort of the search, as a study says it."""

    starts: Annotated[int, Field(ge=1, le=4096)] = 16
    """Local searches, from Sobol points."""
    evaluations: Annotated[int, Field(ge=10)] = 300
    """Evaluations of one local run."""
    budget: Annotated[int, Field(ge=100)] = 30_000
    """Evaluations for the whole problem; a front, robustness and a catalogue have as many more each."""
    seconds: Annotated[float, Field(gt=0)] | None = None
    """A clock besides: what a busy machine does not get done in so long is left out."""
    check: bool = True
    """Whether CRS2_LM looks again."""
    isres: bool = False
    """Whether ISRES does too."""


class Settings(SolverTable):
    """Settings of the solver, those that only a command gives included."""

    seed: int = 0
    accuracy: float | None = None
    """Error allowed in the merit (0.01: 1 % of a goal); None polishes every search to rounding."""

    def fresh(self) -> SearchBudget:
        """All that may be tried, from now on."""
        return SearchBudget.of(self.budget, self.seconds)

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


@by_value
@dataclass(frozen=True)
class Check:
    """Result of the second solver."""

    solver: str
    evaluations: int
    merit: float | None
    """Merit of its own best feasible point; None where it met none."""
    polished: Search
    """A local search from its best point."""


@dataclass(frozen=True)
class _Stage:
    """Goal of a lexicographic order, solved."""

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
    """Unit of the limit."""
    multiplier: float
    """Change of the scaled merit per unit of the scaled row; 0 where the limit only happens to be touched."""
    merit_gain_per_unit: float | None
    """By how much the merit falls (0.01: the goals get 1 % better) where the limit is relaxed by one unit; None where
    it cannot be."""
    goal_gain_per_unit: float | None
    """Gain of a single goal per unit of the limit, in the goal's unit: how much better it gets."""
    bound: bool = False
    """Whether it is a variable's bound, else a limit."""
    always: bool = False
    """Whether it is what every camera must be, which no study can relax."""


@dataclass(frozen=True)
class _Violation:
    """How far a limit is missed at the least-violating point."""

    limit: str
    """E.g. ``fill_factor <=``."""
    value: float
    wanted: float
    unit: str


@dataclass(frozen=True)
class _Relaxation:
    """A limit that, moved alone, makes the whole problem feasible."""

    label: str
    limit: float
    """Limit as asked."""
    needed: float | None
    """Limit that would make the problem feasible; None where moving it alone does not help."""
    unit: str


@by_value
@dataclass(frozen=True)
class Conflict:
    """Conflict of limits, where nothing is feasible."""

    unit: Array
    """The least-violating point."""
    violation: float
    violations: tuple[_Violation, ...] = ()
    smallest: tuple[str, ...] = ()
    """Constraints that cannot hold together within the bounds, while any fewer of them can, as far as searches tell."""
    complete: bool = True
    """Whether every smaller set was shown to be feasible before the budget was spent."""
    relaxations: tuple[_Relaxation, ...] = ()
    bounds: tuple[str, ...] = ()
    """Bounds of variables that the least-violating point touches: relaxing these may help too."""
    feasible_after_all: bool = False
    always: tuple[str, ...] = ()
    """Conditions on every camera that the least-violating point breaks."""
    undefined: tuple[str, ...] = ()
    """Goals that are undefined where the limits hold."""

    @property
    def reason(self) -> str:
        """Reason why nothing is feasible, in words."""
        if self.undefined:
            return f"where the limits hold, {' and '.join(self.undefined)} is undefined"
        if not self.smallest:
            return f"within the bounds stands no camera ({', '.join(self.always) or 'nothing can be built'})"
        doubt = "" if self.complete else " (a smaller set was not excluded before the budget was spent)"
        return f"within the bounds, these cannot hold together: {' and '.join(self.smallest)}{doubt}"

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {
            "violations": self.violations,
            "cannot_hold_together": self.smallest,
            "smaller_sets_shown_feasible": self.complete,
            "reason": self.reason,
            "no_camera": self.always,
            "goals_undefined": self.undefined,
            "relaxations": [
                {"limit": r.label, "from": r.limit, "to": r.needed, "unit": r.unit} for r in self.relaxations
            ],
            "bounds_touched": self.bounds,
        }


@by_value
@dataclass(frozen=True)
class Answer:
    """Answer of the optimiser, with how far to trust it."""

    problem: DesignProblem
    """As solved: of a lexicographic order, the last stage."""
    asked: DesignProblem
    """Problem as posed."""
    unit: Array
    """Scaled variables of the best or, where nothing is feasible, the least violating point."""
    merit: float
    violation: float
    feasible: bool
    active: tuple[Active, ...]
    """Limits that the optimum rests on; none where infeasible."""
    residual: float
    """Residual of the first-order conditions: length of what no multiplier explains, over the length of the merit's
    gradient; infinite where the merit has none."""
    conflict: Conflict | None
    """Why nothing is feasible; None where something is."""
    searches: tuple[Search, ...]
    checks: tuple[Check, ...]
    stages: tuple[_Stage, ...]
    gradient_error: float
    evaluations: int
    seconds: float
    notes: tuple[str, ...]
    settings: Settings
    ended: Literal["", "evaluations", "seconds"] = ""
    """Budget that ended the search before its own end; "" where none did."""
    gained: float = 0.0
    """By how much the merit fell when the best was polished once more: what the searches had left."""

    @property
    def equals(self) -> tuple[Search, ...]:
        """Searches that ended at the answer, or equally good."""
        return tuple(s for s in self.searches if s.feasible and abs(s.merit - self.merit) <= self.settings.agree)

    @property
    def reached(self) -> int:
        """Number of starts that ended at a feasible point."""
        return sum(s.feasible for s in self.searches)

    @property
    def runs_off(self) -> bool:
        """Whether the goal has no optimum here, but a pole that the search ran up to."""
        return self.feasible and runs_off(self.problem, self.unit)

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

    def followers(self) -> dict[str, float]:
        """Value [mm] of what moved with the variables."""
        return self.problem.following(self.unit)

    def number(self, part: Constraint | Goal) -> float:
        """Value of a constraint's or goal's quantity."""
        return self.problem.number(part, self.unit)


def solve(problem: DesignProblem, settings: Settings = USUAL, tell: Tell = lambda _: None) -> Answer:
    """The best design, or what stands in the way; `tell` is told what is being done."""
    began, budget = time.monotonic(), settings.fresh()
    starts = _starts(problem, settings)
    if problem.order == "weighted" or len(problem.goals) == 1:
        return replace(_solve(problem, settings, budget, tell, starts), seconds=time.monotonic() - began)
    stages: list[_Stage] = []
    current, spent = replace(problem, order="weighted"), 0
    for number, goal in enumerate(problem.goals, 1):
        current = replace(current, goals=(goal,))
        last = number == len(problem.goals)
        part = settings if last else settings.model_copy(update={"check": False, "isres": False})
        answer = _solve(current, part, budget, tell, starts)
        spent += answer.evaluations
        if not answer.feasible:
            break
        value = answer.number(goal)
        held = goal.as_constraint(goal.worse(value, problem.slack * _goal_per_merit(current, answer.unit)))
        stages.append(_Stage(goal.label, value, "" if last else str(held)))
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
    points = sobol_units(problem.n, settings.starts, settings.seed)
    return [*given, *promising_starts(problem, list(points), settings.starts, settings.seed)]


def _solve(
    problem: DesignProblem, settings: Settings, budget: SearchBudget, tell: Tell, starts: Sequence[Array]
) -> Answer:
    searches: list[Search] = []
    tolerance = max(settings.tolerance, problem.finest)
    for number, start in enumerate(starts, 1):
        if searches and budget.ended:
            break
        tell(f"start {number} of {len(starts)}")
        searches.append(searched(problem, start, budget, settings.evaluations, tolerance))
    best = min(searches, key=lambda s: (not s.feasible, s.merit if s.feasible else s.violation))
    checks: list[Check] = []
    wanted: dict[Global, bool] = {"crs2": settings.check, "isres": settings.isres}
    for name in (name for name, asked in wanted.items() if asked):
        if budget.ended:
            break
        tell(f"checking with {name}")
        checks.append(_check(problem, name, settings, budget, best))
        other = checks[-1].polished
        if other.feasible and (not best.feasible or best.merit - other.merit > settings.agree):
            best = other
    gained, conflict = 0.0, None
    if best.feasible:
        polished = searched(problem, best.unit, budget, settings.evaluations, problem.finest)
        if polished.feasible and polished.merit < best.merit:
            gained, best = best.merit - polished.merit, polished
    else:
        tell("finding what stands in the way")
        points = [s.unit for s in sorted(searches, key=lambda s: s.violation)]
        conflict = explain(problem, points, budget, settings.seed)
        best = replace(best, unit=conflict.unit, violation=conflict.violation)
        if conflict.feasible_after_all:
            again = searched(problem, conflict.unit, budget, settings.evaluations, problem.finest)
            if again.feasible:
                searches.append(again)
                best, conflict = again, None
    feasible = best.feasible and conflict is None
    active, residual = _rests(problem, best.unit) if feasible else ((), 0.0)
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
        notes=tuple(_notes(searches, len(starts), budget, settings)),
        settings=settings,
        ended=budget.ended,
        gained=gained,
    )


def _check(problem: DesignProblem, name: Global, settings: Settings, budget: SearchBudget, best: Search) -> Check:
    known = _conditions(problem, best.unit)[0] if best.feasible else ()
    steepest = max((a.multiplier for a in known), default=0.0 if best.feasible else 10.0)
    guard = Guard(problem.vector, budget)
    ftol, most = max(GLOBAL_FTOL, settings.tolerance), min(1500 * problem.n, 9000) // (5 if problem.summed else 1)
    unit = globally(guard, problem.n, name, 1.0 + 3.0 * steepest, most, settings.seed, ftol)
    tolerance = max(settings.tolerance, problem.finest)
    polished = searched(problem, unit, budget, settings.evaluations, tolerance)
    solver = {"crs2": "CRS2_LM with penalty", "isres": "ISRES"}[name]
    return Check(solver, guard.evaluations, guard.merit if guard.feasible else None, polished)


def _notes(searches: Sequence[Search], wanted: int, budget: SearchBudget, settings: Settings) -> list[str]:
    notes, tried = [], f"after {len(searches)} of {wanted} starts"
    if budget.ended == "evaluations":
        notes.append(f"the budget of {settings.budget} evaluations was spent {tried}; give more for a surer answer")
    elif budget.ended:
        remedy = "give more, or none, for a surer answer that no other work on the machine changes"
        notes.append(f"the clock of {settings.seconds:g} seconds ran out {tried}; {remedy}")
    if any(s.clipped for s in searches):
        notes.append("a start lay outside the bounds and was moved onto them")
    mapped = sum(s.mapped for s in searches)
    if mapped:
        notes.append(f"{mapped} evaluation{'s' * (mapped > 1)} met numbers that are undefined and counted as very bad")
    return notes


def searched(
    problem: DesignProblem, start: Array, budget: SearchBudget, evaluations: int = 300, tolerance: float = FTOL
) -> Search:
    """A `search`; where goals have kinks, searched again on both sides of each, from its end."""
    best = search(problem.vector, start, budget, evaluations, tolerance, problem.always)
    for side in problem.sides() if best.feasible else ():
        end = search(side.vector, best.unit, budget, evaluations, tolerance, side.always)
        guard = Guard(problem.vector)
        guard.rows(end.unit)
        spent = replace(best, evaluations=best.evaluations + end.evaluations + guard.evaluations)
        better = guard.feasible and guard.merit < best.merit
        best = replace(spent, unit=end.unit, merit=guard.merit, violation=guard.violation) if better else spent
    return best


def runs_off(problem: DesignProblem, unit: Array) -> bool:
    """Whether a goal grows without end at a point: it is infinite there, or has its pole where cameras end.

    Cameras end a hair before their poles. Towards that end a goal goes on gaining as much with every tenfold at a pole,
    and settles where it is finite, however steep it is.
    """
    values, jacobian = value_and_jacobian(problem.vector, unit, always=problem.always)
    if values[0] <= -BIG:
        return True
    for row, value, slope in zip(problem.rows, values[1:], jacobian[1:], strict=True):
        room, size = ROOM - value, float(slope @ slope)
        if row.constraint >= 0 or not 0 < room < CLOSE or not 0 < size < math.inf:
            continue
        nearer = unit + (1 - 10.0 ** -np.arange(4)[:, None]) * room * slope / size
        with np.errstate(all="ignore"):
            cameras = problem.cameras(nearer)
            traces = problem.traces(cameras, problem.varied_lens(nearer))
            for goal in problem.goals:
                reached = np.broadcast_to(goal.judged(cameras, traces), 4)
                gains = -goal.sign * np.diff(reached)
                if gains[0] > AGREE * abs(reached[0]) and gains[2] >= STEADY * gains[0]:
                    return True
    return False


def _rests(problem: DesignProblem, unit: Array) -> tuple[tuple[Active, ...], float]:
    """`_conditions`, at a kink of the merit those of its finite side; that it is a kink is no limit."""
    near = list(problem.sides())[::2]
    active, residual = min((_conditions(side, unit) for side in (problem, *near)), key=itemgetter(1))
    kinks = {str(side.constraints[-1]) for side in near}
    return tuple(one for one in active if one.limit not in kinks), residual


def _conditions(problem: DesignProblem, unit: Array) -> tuple[tuple[Active, ...], float]:
    """Limits that a point rests on, hardest first, by non-negative least squares on the gradients.

    Beside it the length of what no multiplier explains, over the length of the merit's gradient: 0 at an optimum,
    infinite where there is no gradient, as at a pole.
    """
    from scipy.optimize import nnls

    values, jacobian = value_and_jacobian(problem.vector, unit, always=problem.always)
    ends = ~((unit >= TOUCHING) & (unit <= 1 - TOUCHING))
    # Infinite at a bound, a goal is steeper towards it than anything.
    steep = ends & ~np.isfinite(jacobian[0])
    jacobian[0][steep] = np.where(unit > 0.5, -BIG, BIG)[steep]
    if not np.isfinite(jacobian[0]).all() or (runs_off(problem, unit) and values[0] > -BIG):
        return (), math.inf
    columns: list[Array] = []
    limits: list[tuple[str, str, float | None, bool]] = []
    for row, value, slope in zip(problem.rows, values[1:], jacobian[1:], strict=True):
        if value >= -TOUCHING and np.isfinite(slope).all():
            columns.append(slope)
            always = row.constraint < 0
            kind = "" if always else problem.constraints[row.constraint].quantity.unit
            limits.append((row.label, kind, None if always else row.size, False))
    for i, (name, variable) in enumerate(problem.variables.items()):
        if variable.max > variable.min and ends[i]:
            upper = unit[i] > 0.5
            columns.append((1.0 if upper else -1.0) * np.eye(problem.n)[i])
            limits.append((f"{name} {variable.end(upper)}", "mm", variable.rate(float(unit[i])), True))
    length = float(np.linalg.norm(jacobian[0]))
    if not columns:
        return (), 1.0 if length > 1e-6 else 0.0
    per_merit = _goal_per_merit(problem, unit) if len(problem.goals) == 1 else None
    multipliers, residual = nnls(np.stack(columns, axis=1), -jacobian[0])
    merged: dict[str, Active] = {}
    for (label, kind, size, bound), multiplier in zip(limits, multipliers.tolist(), strict=True):
        gain = None if size is None else multiplier / size
        if label not in merged or multiplier > merged[label].multiplier:
            own = None if per_merit is None or gain is None else gain * per_merit
            merged[label] = Active(label, kind, multiplier, gain, own, bound, size is None)
    order = sorted(merged.values(), key=lambda a: -a.multiplier)
    return tuple(order), float(residual) / max(length, 1e-12)


def _goal_per_merit(problem: DesignProblem, unit: Array) -> float:
    """How much a single goal changes where the merit changes by 1."""
    goal, value = problem.goals[0], problem.number(problem.goals[0], unit)
    if goal.quantity.past_infinity is not None:
        return value**2 * problem.goal_scale(0)
    return value if goal.quantity.positive else problem.goal_scale(0)


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


def explain(problem: DesignProblem, points: Sequence[Array], budget: SearchBudget, seed: int) -> Conflict:
    """Find what stands in the way of a problem, from where searches ended (best first) and Sobol points by the seed.

    Where the budget is spent, some more is taken.
    """
    pool = _Pool(problem, budget.at_least(*EXPLAINING), [*points, *sobol_units(problem.n, FRESH, seed + 1)])
    unit, rows = pool.relaxed(frozenset(range(len(problem.constraints))))
    violation = violation_of(rows)
    if violation <= FEASIBLE:
        lost = tuple(goal.label for goal in problem.goals if math.isnan(problem.number(goal, unit)))
        return Conflict(unit, 0.0, feasible_after_all=True, undefined=lost or tuple(g.label for g in problem.goals))
    smallest, complete = _smallest(pool, len(problem.constraints))
    clashing = sorted(smallest)
    missed = {
        constraint.limit_words(row.side): _Violation(
            constraint.limit_words(row.side),
            problem.number(constraint, unit),
            constraint.limits[row.side],
            constraint.quantity.unit,
        )
        for row, over in zip(problem.rows, rows, strict=True)
        if over > FEASIBLE and row.constraint >= 0
        for constraint in [problem.constraints[row.constraint]]
    }
    over = zip(problem.rows, rows, strict=True)
    missing = dict.fromkeys(row.label for row, by in over if row.constraint < 0 and by > FEASIBLE)
    return Conflict(
        unit=unit,
        violation=violation,
        violations=tuple(missed.values()),
        smallest=tuple(str(problem.constraints[index]) for index in clashing),
        complete=complete,
        relaxations=tuple(pool.alone(index, side) for index in clashing for side in problem.constraints[index].limits),
        bounds=tuple(
            f"{name} {variable.end(place > 0.5)}"
            for (name, variable), place in zip(problem.variables.items(), unit, strict=True)
            if variable.max > variable.min and not 1e-6 <= place <= 1 - 1e-6
        ),
        always=tuple(missing),
    )


class _Pool:
    """Points met so far, and which constraints each of them holds."""

    def __init__(self, problem: DesignProblem, budget: SearchBudget, starts: Sequence[Array]) -> None:
        self.problem, self.budget = problem, budget
        self.starts = [np.clip(start, 0, 1) for start in starts]
        self.held: list[frozenset[int]] = []
        self.add(np.concatenate([np.stack(self.starts), sobol_units(problem.n, 2048, 5)]))

    def add(self, units: Array) -> None:
        good = self.problem.without_goals().vector(units)[1:] <= FEASIBLE
        owner = np.array([row.constraint for row in self.problem.rows])
        each = np.stack([good[owner == index].all(axis=0) for index in range(-1, len(self.problem.constraints))])
        for column in np.unique(each[:, each[0]], axis=1).T:
            self.held.append(frozenset(np.flatnonzero(column[1:]).tolist()))

    def relaxed(self, keep: frozenset[int]) -> tuple[Array, Array]:
        """Least violation of some of the constraints; rows are those of the problem with only these."""
        part = self.problem.without(keep).without_goals()
        guard = Guard(part.vector, self.budget)
        weights = [10.0 if row.constraint < 0 else 1.0 for row in part.rows]
        unit, rows = least_violation(guard, self.starts[: 2 * FRESH], weights)
        self.add(unit[None])
        if guard.unit is not None:
            self.add(guard.unit[None])
            if guard.feasible:
                unit, rows = guard.unit, part.vector(guard.unit[None])[1:, 0]
        return unit, rows

    def possible(self, keep: frozenset[int]) -> bool:
        """Whether some constraints can hold together, as far as searches tell."""
        if any(keep <= held for held in self.held):
            return True
        _, rows = self.relaxed(keep)
        return violation_of(rows) <= FEASIBLE

    def alone(self, index: int, side: Side) -> _Relaxation:
        """Relaxation of one limit, all others kept, that makes the problem feasible."""
        constraint = self.problem.constraints[index]
        soft = np.array([row.constraint == index and row.side == side for row in self.problem.rows])
        guard = Guard(self.problem.without_goals().vector, self.budget)
        unit, rows = least_violation(guard, self.starts[: 2 * FRESH], np.where(soft, 1.0, np.inf).tolist())
        value = self.problem.number(constraint, unit)
        helps = violation_of(rows[~soft]) <= 1e-7 and np.isfinite(value)
        needed, unit_name = value if helps else None, constraint.quantity.unit
        return _Relaxation(constraint.limit_words(side), constraint.limits[side], needed, unit_name)


def _smallest(pool: _Pool, count: int) -> tuple[frozenset[int], bool]:
    """By size: the first set that cannot hold. Points met on the way settle most sets without a search."""
    for size in range(count + 1):
        for keep in combinations(range(count), size):
            if pool.budget.ended:
                return _by_deletion(pool, count), False
            if not pool.possible(frozenset(keep)):
                return frozenset(keep), True
    return frozenset(range(count)), True


def _by_deletion(pool: _Pool, count: int) -> frozenset[int]:
    """Where the budget is spent: leave out what the conflict does not need, one after the other."""
    pool.budget = pool.budget.at_least(*(share / 2 for share in EXPLAINING))
    keep = set(range(count))
    for index in range(count):
        if not pool.budget.ended and not pool.possible(frozenset(keep - {index})):
            keep.discard(index)
    return frozenset(keep)


class ParetoTable(StrictTable):
    """Two or three goals to trade."""

    goals: Annotated[tuple[str, ...], Field(min_length=2, max_length=3)]
    """Names of quantities among [[goals]]."""
    points: Annotated[int, Field(ge=3, le=100)] = 13
    """Number of points along each limited goal."""


@dataclass(frozen=True)
class _FrontPoint:
    """Design of a front."""

    goals: dict[str, float]
    """Label to value, in the order of the front's goals."""
    variables_mm: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {"goals": self.goals, **lengths_and_numbers(self.variables_mm)}


@dataclass(frozen=True)
class Front:
    """Designs of which none is better in every goal."""

    goals: tuple[Goal, ...]
    points: tuple[_FrontPoint, ...] = ()
    """Designs in the order of the first limited goal."""
    limits_without_design: int = 1
    dominated: int = 0
    """Designs left out since another was better in every goal."""
    evaluations: int = 0
    complete: bool = False
    """Whether all limits were tried before the budget was spent."""

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        goals = [{"goal": g.label, "direction": g.direction, "unit": g.quantity.unit} for g in self.goals]
        return {**plain(self), "goals": goals, "points": [plain(point.to_dict()) for point in self.points]}


def pareto_front(
    problem: DesignProblem,
    goals: Sequence[Goal],
    points: int,
    known: Sequence[Array],
    budget: SearchBudget,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Front:
    """Trade two or three goals, of which the first is optimised while the others are limited.

    Parameters
    ----------
    problem : DesignProblem
        Its own goals are not looked at.
    goals : sequence of Goal
    points : int
        Limits along the second goal; of the third a third as many.
    known : sequence of ndarray
        Feasible points, scaled; searches start there, and from Sobol points by the seed.
    budget : SearchBudget
        It is spent.
    """
    met: list[Array] = []
    spent = 0

    def best_of(wanted: Goal, limits: Sequence[Constraint], starts: Sequence[Array]) -> Array | None:
        nonlocal spent
        posed = replace(problem, goals=(wanted,), constraints=(*problem.constraints, *limits))
        results = [searched(posed, start, budget, tolerance=posed.finest) for start in starts]
        spent += sum(result.evaluations for result in results)
        feasible = [result for result in results if result.feasible]
        return min(feasible, key=lambda result: result.merit).unit if feasible else None

    def values(units: Sequence[Array]) -> Array:
        return np.array([[problem.number(goal, unit) for goal in goals] for unit in units])

    for number, goal in enumerate(goals):
        tell(f"front: end {number + 1} of {len(goals)}")
        end = best_of(goal, (), [*known, *sobol_units(problem.n, FRESH, seed)])
        if end is None:
            return Front(tuple(goals), evaluations=spent)
        value = problem.number(goal, end)
        if number or math.isinf(value):
            # Of designs equally good in this goal, the one that is best in the first, or that in the next.
            refined = best_of(
                goals[0 if number else 1], [goal.as_constraint(goal.worse(value, HAIR * abs(value)))], [end]
            )
            end = end if refined is None else refined
        met.append(end)
    ends, payoff = list(met), values(met)
    ladders = [_ladder(payoff[:, k], goals[k], points if k == 1 else max(3, points // 3)) for k in range(1, len(goals))]
    grid = [limits[::-1] for limits in product(*ladders[::-1])]
    failed, complete, warm = 0, True, ends[0]
    for number, limits in enumerate(grid, 1):
        if budget.ended:
            complete = False
            break
        tell(f"front: limit {number} of {len(grid)}")
        if limits[0] == ladders[0][0]:
            warm = ends[0]
        held = [goal.as_constraint(value) for goal, value in zip(goals[1:], limits, strict=True)]
        best = best_of(goals[0], held, [warm])
        if best is None:
            best = best_of(goals[0], held, ends)
        if best is None:
            failed += 1
        else:
            warm = best
            met.append(best)
    reached = values(met)
    labels = [goal.label for goal in goals]
    front = tuple(
        _FrontPoint(dict(zip(labels, reached[i].tolist(), strict=True)), problem.named(met[i]))
        for i in _undominated(np.clip(reached, -LARGEST, LARGEST) * [goal.sign for goal in goals])
    )
    return Front(tuple(goals), front, failed, len(met) - len(front), spent, complete)


def _ladder(values: Array, goal: Goal, count: int) -> list[float]:
    """Limits from the worst value at another goal's end to the best: in equal ratios where ratios count.

    In equal steps of the finite twin of what may be infinite.
    """
    worst, best = (goal.sign * float(end) for end in ((goal.sign * values).max(), (goal.sign * values).min()))
    if goal.quantity.infinite:
        return [worst, *from_finite(np.linspace(finite(worst), finite(best), count)[1:-1]).tolist(), best]
    return list(map(float, (np.geomspace if goal.quantity.positive else np.linspace)(worst, best, count)))


def _undominated(values: Array) -> list[int]:
    """Which designs none is better than, small is good; each once, in the order of the second value."""
    tiny = 1e-7 * np.maximum(np.abs(values), 1e-12)
    front: list[int] = []
    for i, own in enumerate(values):
        better = (values <= own + tiny[i]).all(axis=1) & (values < own - tiny[i]).any(axis=1)
        twin = any(np.allclose(values[j], own, rtol=1e-6, atol=0) for j in front)
        if not better.any() and not twin:
            front.append(i)
    return sorted(front, key=lambda i: tuple(values[i][1:][::-1]))
