"""Solving a problem: many starts, a second solver as a check, and an answer that says how far to trust it.

Where nothing is feasible, `conflict` says why.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Annotated

import numpy as np
from pydantic import Field, StrictBool

from .._arrays import Array, by_value
from ..accuracy.statement import Accuracy
from ..progress import CountedProgress, silent
from ..theory.quantity import FEASIBLE
from ..toml_files import StrictTable
from .conflict import Conflict, explain
from .goals import Constraint, Goal
from .problem import APART, ROOM, DesignProblem, promising_starts, sobol_units
from .reach import Unreachable, conflict_with
from .search import (
    BIG,
    FTOL,
    QUICK,
    TOGETHER,
    Ended,
    Global,
    Guard,
    Search,
    SearchBudget,
    followed,
    globally,
    gradient_error,
    search,
    value_and_jacobian,
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

MOST_SETTLING, SETTLED = 16, 1e-4
"""Searches after which numbers that rays tell are taken as they are, and how little they move before that, relative: in
an answer by no more than `FEASIBLE`."""
RESTS = 0.1
"""Residual of the first-order conditions above which an end is no optimum, but where a search broke off."""
BESIDE = 1e-2
"""Distance in the unit box over which a goal that rays tell must gain less than `SETTLED` at an optimum."""
AROUND = 10
"""Evaluations for each variable, at most, of a search between points where rays told."""
DEAR = 15
"""Evaluations of a budget that a design counts for whose depth errors are summed behind a real lens."""
DRIFT = 1e-6
"""Violation of a limit by rays that is none where searches never settle: along flat goals they end some way apart."""
LOOKED_AT, ROUGHLY = 64, 1e-2
"""Points of the bounds of which the best begins a search that takes no rays at fields, and relative change of numbers
that rays tell of the whole camera, below which they decide whether fields are traced at all."""

Tell = CountedProgress


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
    check: StrictBool = True
    """Whether CRS2_LM looks again."""
    isres: StrictBool = False
    """Whether ISRES does too."""


class Settings(SolverTable):
    """Settings of the solver, those that only a command gives included."""

    seed: int = 0
    accuracy: float | None = None
    """Error allowed in the merit (0.01: 1 % of a goal); None: searches end at 1e-8."""

    def fresh(self, dear: bool = False) -> SearchBudget:
        """All that may be tried, from now on; of `dear` designs each counts."""
        return SearchBudget.of(self.budget, self.seconds, DEAR * dear)

    @property
    def agree(self) -> float:
        """Difference of merit within which two searches found the same."""
        return AGREE if self.accuracy is None else max(AGREE, self.accuracy)

    @property
    def tolerance(self) -> float:
        """Change of the merit at which a search that is not polished ends.

        A hundredth: along a curved valley (Rosenbrock's) the last of many small steps leaves up to fifty of them.
        """
        return QUICK if self.accuracy is None else max(FTOL, self.accuracy / 100)


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
    """Active constraints; none where infeasible."""
    residual: float
    """Residual of the first-order conditions: length of what no multiplier explains, over the length of the merit's
    gradient; infinite where the merit has none."""
    conflict: Conflict | None
    """Why nothing is feasible; None where something is, or somebody had enough before anything was."""
    searches: tuple[Search, ...]
    checks: tuple[Check, ...]
    stages: tuple[_Stage, ...]
    gradient_error: float
    evaluations: int
    seconds: float
    notes: tuple[str, ...]
    settings: Settings
    ended: Ended = ""
    """Budget that ended the search before its own end; "" where none did."""
    gained: float = 0.0
    """By how much the merit fell when the best was polished once more: what the searches had left."""

    @property
    def equals(self) -> tuple[Search, ...]:
        """Searches that ended at the answer, or equally good."""
        agree = max(self.settings.agree, SETTLED if self.problem.told_at else 0.0)
        return tuple(s for s in self.searches if s.feasible and abs(s.merit - self.merit) <= agree)

    @property
    def reached(self) -> int:
        """Number of starts that ended at a feasible point."""
        return sum(s.feasible for s in self.searches)

    @property
    def optimal(self) -> bool:
        """Whether it is a design, and not one where what rays tell left a search short of first-order conditions."""
        return self.feasible and not (self.problem.told_at and RESTS < self.residual < math.inf)

    @property
    def status(self) -> str:
        """How it ended, in a word."""
        if self.feasible:
            return "optimal" if self.optimal else "feasible"
        return "stopped" if self.conflict is None else "infeasible"

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

    def held(self) -> dict[str, float]:
        """Value [mm] of that one of d_f and d_1 which stayed where f varied."""
        return self.problem.held(self.unit)

    def number(self, part: Constraint | Goal) -> float:
        """Value of a constraint's or goal's quantity."""
        return self.problem.number(part, self.unit)


def solve(problem: DesignProblem, settings: Settings = USUAL, tell: Tell = silent) -> Answer:
    """The best design, or what stands in the way; `tell` is told what is being done."""
    began = time.monotonic()
    return replace(_solved(problem, settings, settings.fresh(), tell), seconds=time.monotonic() - began)


def _solved(
    problem: DesignProblem, settings: Settings, budget: SearchBudget, tell: Tell, found: Sequence[Array] = ()
) -> Answer:
    """`solve` within a budget, whose time the caller knows, from points that were found before any other."""
    starts = [*found, *_starts(problem, settings)]
    if problem.order == "weighted" or len(problem.goals) == 1:
        return _solve(problem, settings, budget, tell, starts)
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
    return replace(answer, asked=problem, stages=tuple(stages), evaluations=spent)


def solve_by_rays(problem: DesignProblem, settings: Settings = USUAL, tell: Tell = silent) -> Answer:
    """`solve`, with what rays tell of the whole camera at the optimum: about first, then polished.

    Where fields are traced at every design tried, what no such ray tells is looked at before any is.
    """
    if not (problem.by_rays or problem.traced):
        return solve(problem, settings, tell)
    began, budget = time.monotonic(), settings.fresh(problem.dear)
    answer = _settled_by_rays(problem, settings, budget, tell)
    spent = max(answer.evaluations, settings.budget - int(budget.evaluations))  # settling counts, too
    return replace(answer, evaluations=spent, ended=budget.ended, seconds=time.monotonic() - began)


def _settled_by_rays(problem: DesignProblem, settings: Settings, budget: SearchBudget, tell: Tell) -> Answer:
    few, finest = min(settings.evaluations, AROUND * problem.n), problem.finest

    def polish(part: DesignProblem, begin: Array, reach: float = 1.0, most: int = few, to: float = finest) -> Search:
        return searched(part, begin, budget, most, to, reach)

    roughly = partial(polish, most=settings.evaluations, to=max(settings.tolerance, finest))
    start, found = None, []
    if problem.summed:
        budget.heard(tell, "limits of the whole camera")
        problem, part, near = reached_untraced(problem, _first(problem), settings.seed, roughly, budget)
        start = near.unit
        if problem.traced and not near.feasible:
            budget.heard(tell, "finding what stands in the way")
            conflict = explain(part, [start], budget, settings.seed)
            if conflict is None or not conflict.feasible_after_all:
                return _unreached(problem, part, conflict, near, settings, budget)
            start = conflict.unit
            found = [start]
    if not problem.by_rays:
        return _solved(problem, settings, budget, tell, found)
    start = _starts(problem, settings)[0] if start is None else start
    problem, first, _ = settled(problem, start, SETTLED, partial(polish, to=SETTLED), tell, budget=budget)
    found = [first.unit] if first.feasible else found
    answer, moved = _solved(problem, settings, budget, tell, found), 0.0
    # Of a lexicographic order the stages are solved as they were settled.
    for again in (False, True) if answer.problem is answer.asked else ():
        told, moved = answer.problem.told_by_rays(answer.unit)
        right = moved <= SETTLED
        told, end, moved = settled(told, answer.unit, FEASIBLE if answer.feasible else SETTLED, polish, budget=budget)
        if answer.feasible and end.feasible:
            answer = _moved_to(answer, told, end)
            break
        if (right or budget.ended) and not (answer.feasible or end.feasible):
            break
        if budget.ended and first.feasible:  # no more is known of what was found since
            return _moved_to(replace(answer, feasible=True, conflict=None), problem, first)
        if not again:  # judged by what rays tell elsewhere
            answer = _solve(told, settings, budget, tell, [end.unit, *_starts(told, settings)])
    if moved <= SETTLED:
        return answer
    note = f"limits and goals by rays are not settled: where the search ended they differ by up to {100 * moved:.2g} %"
    return replace(answer, notes=(*answer.notes, note))


def _moved_to(answer: Answer, problem: DesignProblem, end: Search) -> Answer:
    """An answer at a search's end behind numbers that rays tell there; where others ended, they move along."""
    by = end.merit - answer.merit
    ends = tuple(replace(one, merit=one.merit + by) for one in answer.searches)
    checks = tuple(replace(one, polished=replace(one.polished, merit=one.polished.merit + by)) for one in answer.checks)
    active, residual = _rests(problem, end.unit)
    answer = replace(answer, problem=problem, asked=problem, searches=ends, active=active, residual=residual)
    return replace(answer, unit=end.unit, merit=end.merit, violation=end.violation, checks=checks)


def _unreached(
    problem: DesignProblem,
    part: DesignProblem,
    conflict: Conflict | None,
    near: Search,
    settings: Settings,
    budget: SearchBudget,
) -> Answer:
    """Answer where limits of a problem clash that take no rays at fields, `part`, or a search for them was stopped."""
    notes = _notes([near], settings.starts, budget, settings)
    if conflict is not None:
        judged = {limit.label for limit in part.constraints}
        unjudged = (limit.label for limit in problem.constraints if limit.label not in judged)
        conflict = replace(conflict, unjudged=tuple(dict.fromkeys(unjudged)))
        near = replace(near, unit=conflict.unit, violation=conflict.violation)
        note = (
            "limits at single fields were not looked at, since those of the whole camera cannot be held; what would "
            "free these leaves the others out"
        )
        notes.insert(0, note)
    return _infeasible(problem, conflict, near, settings, notes)


def refused_by_bore(problem: DesignProblem, beyond: Sequence[Unreachable], settings: Settings) -> Answer:
    """Answer where limits lie beyond what the bore lets through: what holds the others, or comes nearest to it."""
    others = frozenset(range(len(problem.constraints))) - {one.constraint for one in beyond}
    rest = replace(problem.keeping(others).untraced(), thin=True)
    near = searched(rest, _first(problem), settings.fresh(), settings.evaluations, settings.tolerance)
    held = "holds all others that take no rays at fields" if near.feasible else "comes nearest to the others"
    note = (
        "no search was begun, as the bore does not let through what is asked for; the design in the file "
        f"{held}, fields counted over all that the sensor sees, dark or not"
    )
    conflict = conflict_with(near.unit, beyond)
    near = replace(near, violation=max(near.violation, conflict.violation))
    return _infeasible(problem, conflict, near, settings, [note])


def _infeasible(
    problem: DesignProblem, conflict: Conflict | None, near: Search, settings: Settings, notes: Sequence[str]
) -> Answer:
    """Answer of a search that looked for no goals, as limits cannot be held."""
    return Answer(
        problem=problem,
        asked=problem,
        unit=near.unit,
        merit=BIG,
        violation=near.violation,
        feasible=False,
        active=(),
        residual=0.0,
        conflict=conflict,
        searches=(near,),
        checks=(),
        stages=(),
        gradient_error=0.0,
        evaluations=near.evaluations,
        seconds=0.0,
        notes=tuple(notes),
        settings=settings,
    )


def reached_untraced(
    problem: DesignProblem,
    start: Array,
    seed: int,
    search: Callable[[DesignProblem, Array, float], Search],
    budget: SearchBudget,
) -> tuple[DesignProblem, DesignProblem, Search]:
    """Where those limits hold that no rays at fields tell, or the nearest to it; what takes long last.

    Beside it the problem, told by rays there, and with the limits alone that were looked at.
    """

    def nearest(part: DesignProblem, first: Array, reach: float = 1.0) -> Search:
        if reach < 1:
            return search(part, first, reach)
        units = np.concatenate([first[None], sobol_units(part.n, LOOKED_AT, seed)])
        over = np.nan_to_num(part.limits(np.clip(units, 0.0, 1.0)), nan=BIG).max(axis=0, initial=-BIG)
        return search(part, units[over.argmin()], reach)

    part = problem.untraced(rays=False, sums=False)
    near = nearest(part, start)
    for sums in (False, True):
        if not near.feasible:
            break
        if problem.untraced(sums=sums).constraints != part.constraints:
            wanted = partial(DesignProblem.untraced, sums=sums)
            problem, near, _ = settled(problem, near.unit, ROUGHLY, nearest, wanted=wanted, budget=budget)
            part = wanted(problem)
    return problem, part, near


def settled(
    problem: DesignProblem,
    unit: Array,
    within: float,
    search: Callable[[DesignProblem, Array, float], Search],
    tell: Tell = silent,
    wanted: Callable[[DesignProblem], DesignProblem] = lambda whole: whole,
    budget: SearchBudget | None = None,
) -> tuple[DesignProblem, Search, float]:
    """A search that ends where rays tell what it took them to tell, but for so little, and the problem that it solves.

    Of the problem it searches what is `wanted`.

    It begins anew until then, at most `MOST_SETTLING` times, from the best place that rays told, within a reach of it:
    halved where rays tell of none better there, or where the search breaks off, else at least twice the last step; a
    step of more than half the last is doubled. Where limits hold and the step gains next to nothing it ends as well.
    Beside it how far they were apart in the end.
    """
    best, reach, last = np.clip(unit, 0.0, 1.0), 1.0, np.zeros(problem.n)
    problem, moved = problem.told_by_rays(best)
    for done in range(MOST_SETTLING):
        (budget or SearchBudget()).heard(tell, "rays at the optimum", done, MOST_SETTLING)
        part = wanted(problem)
        end = search(part, best, reach)
        way = end.unit - best
        if creeps := bool(way @ last > last @ last / 2 > 0):
            end = replace(end, unit=np.clip(end.unit + way, 0.0, 1.0))
        step = float(np.abs(end.unit - best).max())
        if step < APART < reach and not (end.feasible and not RESTS < _rests(part, end.unit)[1] < math.inf):
            reach /= 4
            if budget is None or not budget.ended:
                continue
            break
        problem, moved = problem.told_by_rays(end.unit)
        if moved <= within and not creeps and (step < reach or reach >= 1):
            return problem, end, moved
        part = wanted(problem)
        there, here = judged(part, end), judged(part, replace(end, unit=best))
        if _rank(there) < _rank(here):
            if not creeps and max(there.violation, here.violation) <= DRIFT and here.merit - there.merit < SETTLED:
                return problem, replace(there, violation=0.0), 0.0
            last, best, reach = way, end.unit, max(reach, 2 * step)
        else:
            last, reach = np.zeros(problem.n), step / 2
        if budget is not None and budget.ended:
            break
    problem, _ = problem.told_by_rays(best)
    own = judged(wanted(problem), replace(end, unit=best))
    return problem, replace(own, violation=0.0) if own.violation <= DRIFT else own, moved


def _rank(end: Search) -> tuple[float, float]:
    return end.violation * (end.violation > DRIFT), end.merit


def _first(problem: DesignProblem) -> Array:
    """Where a search starts first: as given, not clipped, so that a start outside its bounds can be told, or amid."""
    return np.array([
        0.5 if v.start is None else -0.01 if v.start < v.min else 1.01 if v.start > v.max else v.unit(v.start)
        for v in problem.variables.values()
    ])  # fmt: skip


def _starts(problem: DesignProblem, settings: Settings) -> list[Array]:
    """Where searches start: as given, and Sobol points."""
    given = [_first(problem)] if any(v.start is not None for v in problem.variables.values()) else []
    points = sobol_units(problem.n, settings.starts, settings.seed)
    return [*given, *promising_starts(problem, list(points), settings.starts, settings.seed)]


def _solve(
    problem: DesignProblem, settings: Settings, budget: SearchBudget, tell: Tell, starts: Sequence[Array]
) -> Answer:
    searches: list[Search] = []
    # What rays tell between points they told at is known about: the best is polished, and settled.
    evaluations = min(settings.evaluations, AROUND * problem.n) if problem.told_at else settings.evaluations
    tolerance = max(settings.tolerance, SETTLED / 10 if problem.told_at else problem.finest)
    polish = partial(searched, problem, budget=budget, evaluations=evaluations, tolerance=tolerance)
    checking = settings.check + settings.isres
    searching, steps, began = "searches, then a check" if checking else "searches", len(starts), time.monotonic()
    for number, start in enumerate(starts, 1):
        budget.heard(tell, searching, number - 1, steps)
        if searches and budget.ended:
            break
        with budget.interruptible() if searches else nullcontext():
            searches.append(polish(start))
        if checking and number == 1:  # so that the time told to be left is that of both
            one = time.monotonic() - began
            with budget.interruptible():
                worth = math.ceil(checking * _seconds_of_a_check(problem, searches[0].unit, budget) / max(one, 1e-6))
                searching, steps = f"searches, with a check that takes as long as {worth}", len(starts) + worth
    best = min(searches, key=lambda s: (not s.feasible, s.merit if s.feasible else s.violation))
    checks: list[Check] = []
    wanted: dict[Global, bool] = {"crs2": settings.check, "isres": settings.isres}
    for name in (name for name, asked in wanted.items() if asked):
        if budget.ended:
            break
        what = "checking by a global search" if name == "crs2" else "checking by a second global search"
        rows, heard = budget.counting(problem.vector), partial(budget.heard, tell, what)
        guard = Guard(followed(rows, heard, _most_checked(problem)), budget)
        check: Check | None = None
        with budget.interruptible():
            check = _check(problem, name, guard, best, settings.seed, polish)
        if check is None or budget.halted.is_set():  # unfinished it tells nothing, but the best that it met counts
            other = judged(problem, replace(best, unit=best.unit if guard.unit is None else guard.unit))
        else:
            checks.append(check)
            other = check.polished
        if other.feasible and (not best.feasible or best.merit - other.merit > settings.agree):
            best = other
    gained, conflict = 0.0, None
    if best.feasible:
        polished = searched(problem, best.unit, budget, evaluations, problem.finest)
        if polished.feasible and polished.merit < best.merit:
            gained, best = best.merit - polished.merit, polished
    else:
        budget.heard(tell, "finding what stands in the way")
        points = [s.unit for s in sorted(searches, key=lambda s: s.violation)]
        conflict = explain(problem, points, budget, settings.seed)
        if conflict is not None:
            best = replace(best, unit=conflict.unit, violation=conflict.violation)
        if conflict is not None and conflict.feasible_after_all:
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


def _most_checked(problem: DesignProblem) -> int:
    """Points that a global search tries at most."""
    return min(1500 * problem.n, 9000) // (5 if problem.summed else 1)


def _seconds_of_a_check(problem: DesignProblem, unit: Array, budget: SearchBudget) -> float:
    """Time that a global search takes at most, by that of as many designs as it tries at once [s]."""
    began = time.monotonic()
    problem.vector(np.tile(unit, (TOGETHER, 1)))
    designs = min(_most_checked(problem), budget.evaluations / max(budget.each, 1))
    return (time.monotonic() - began) / TOGETHER * max(designs, 0.0)


def _check(
    problem: DesignProblem, name: Global, guard: Guard, best: Search, seed: int, polish: Callable[[Array], Search]
) -> Check:
    known = _conditions(problem, best.unit)[0] if best.feasible else ()
    steepest = max((a.multiplier for a in known), default=0.0 if best.feasible else 10.0)
    unit = globally(guard, problem.n, name, 1.0 + 3.0 * steepest, _most_checked(problem), seed)
    polished = polish(unit)
    solver = {"crs2": "random search, CRS2", "isres": "evolutionary search, ISRES"}[name]
    return Check(solver, guard.evaluations, guard.merit if guard.feasible else None, polished)


def _notes(searches: Sequence[Search], wanted: int, budget: SearchBudget, settings: Settings) -> list[str]:
    notes, tried = [], f"after {len(searches)} of {wanted} starts"
    tried += f" (the design's own point and {settings.starts} more)" * (wanted == settings.starts + 1)
    if budget.ended == "evaluations":
        counts = f", {budget.each} a design whose depth is summed behind a real lens," if budget.each else ""
        spent = f"the budget of {settings.budget} evaluations{counts} was spent {tried}"
        notes.append(f"{spent}: what more would gain is not known; give more for a surer answer")
    elif budget.ended == "stopped":
        notes.append(f"it was stopped {tried}: what more would gain is not known")
    elif budget.ended:
        remedy = "give more, or none, for a surer answer that no other work on the machine changes"
        notes.append(f"the clock of {settings.seconds:g} seconds ran out {tried}; {remedy}")
    if any(s.clipped for s in searches):
        notes.append("a start lay outside the bounds and was moved onto them")
    mapped = sum(s.mapped for s in searches)
    if mapped:
        designs = f"{mapped} designs that were tried have" if mapped > 1 else "A design that was tried has"
        notes.append(f"{designs} undefined numbers, and counted as worse than any other")
    return notes


def searched(
    problem: DesignProblem,
    start: Array,
    budget: SearchBudget,
    evaluations: int = 300,
    tolerance: float = FTOL,
    reach: float = 1.0,
) -> Search:
    """A `search`, no farther from its start than a reach; where goals have kinks, again on both sides of each."""
    low = np.clip(start - reach, 0.0, 1.0) if reach < 1 else np.zeros(problem.n)
    size = np.clip(start + reach, 0.0, 1.0) - low if reach < 1 else np.ones(problem.n)

    def searched_once(part: DesignProblem, first: Array) -> Search:
        vector, limits = (
            partial(_within, budget.counting(rows) if part.dear else rows, low, size)
            for rows in (part.vector, part.limits)
        )
        end = search(vector, (first - low) / size, budget, evaluations, tolerance, part.always, limits)
        return replace(end, unit=low + size * end.unit)

    best = searched_once(problem, start)
    for side in problem.sides() if best.feasible else ():
        end = searched_once(side, best.unit)
        guard = Guard(problem.vector)
        guard.rows(end.unit)
        spent = replace(best, evaluations=best.evaluations + end.evaluations + guard.evaluations)
        better = guard.feasible and guard.merit < best.merit
        best = replace(spent, unit=end.unit, merit=guard.merit, violation=guard.violation) if better else spent
    return best


def _within(rows: Callable[[Array], Array], low: Array, size: Array, units: Array) -> Array:
    return rows(low + size * units)


def judged(problem: DesignProblem, found: Search) -> Search:
    """A search's end as a problem judges it that is posed otherwise than what was searched."""
    guard = Guard(problem.vector)
    guard.rows(found.unit)
    return replace(found, merit=guard.merit, violation=guard.violation)


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
            limits.append((f"{problem.called(name)} {variable.end(upper)}", "mm", variable.rate(float(unit[i])), True))
    length = float(np.linalg.norm(jacobian[0]))
    if not columns:
        ahead = np.clip(unit - BESIDE * jacobian[0] / max(length, 1e-12), 0.0, 1.0)
        flat = problem.told_at and problem.vector(ahead[None])[0, 0] > values[0] - SETTLED
        return (), 0.0 if flat or length <= 1e-6 else 1.0
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
    """Method, expected and measured error of an answer's merit; None where none was found, or not all was looked at."""
    if not answer.feasible or (answer.ended and answer.problem.told_at):
        return None
    asked, checks = answer.settings.accuracy, ", ".join(check.solver for check in answer.checks)
    method = f"SLSQP from {len(answer.searches)} starts to {answer.settings.tolerance:g}, the best polished"
    return Accuracy(
        "merit of the optimum",
        "% of a goal",
        method + (f"; checked by a second search ({checks})" if checks else ""),
        AGREE if asked is None else asked,
        answer.gained,
        "what one more search gained",
        asked,
        seconds,
        model="that no better optimum lies elsewhere is only as sure as the starts and checks agree",
    )
