"""Fronts of competing goals: all but one limited, going from limit to limit, each search warm-started."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from .._arrays import Array
from ..json_data import plain
from ..progress import CountedProgress, silent
from ..theory.quantity import finite, from_finite
from ..toml_files import StrictTable
from .goals import Constraint, Goal
from .problem import FRESH_POINTS, DesignProblem, sobol_units
from .search import QUICK, SearchBudget
from .solve import searched
from .variables import lengths_and_numbers

HAIR = 1e-6
"""Relative loss in its own goal that an end of a front accepts, to leave worse designs that are as good in it."""
LARGEST = 1e300
"""Where numbers are compared, what stands for infinity."""


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
    tell: CountedProgress = silent,
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
    spent, alone = 0, replace(problem, goals=tuple(goals), constraints=())

    def best_of(wanted: Goal, limits: Sequence[Constraint], starts: Sequence[Array]) -> Array | None:
        nonlocal spent
        posed = replace(problem, goals=(wanted,), constraints=(*problem.constraints, *limits))
        results = [searched(posed, start, budget, tolerance=max(QUICK, posed.finest)) for start in starts]
        spent += sum(result.evaluations for result in results)
        feasible = [result for result in results if result.feasible]
        return min(feasible, key=lambda result: result.merit).unit if feasible else None

    def values(unit: Array, posed: DesignProblem) -> list[float]:
        return [posed.number(goal, unit) for goal in posed.goals]

    for number, goal in enumerate(goals):
        budget.heard(tell, "front: ends", number, len(goals))
        end = best_of(goal, (), [*known, *sobol_units(problem.n, FRESH_POINTS, seed)])
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
    ends, payoff = list(met), np.array([values(unit, alone) for unit in met])
    ladders = [_ladder(payoff[:, k], goals[k], points if k == 1 else max(3, points // 3)) for k in range(1, len(goals))]
    grid = [limits[::-1] for limits in product(*ladders[::-1])]
    failed, complete, warm = 0, True, ends[0]
    for number, limits in enumerate(grid, 1):
        budget.heard(tell, "front: limits", number - 1, len(grid))
        if budget.ended:
            complete = False
            break
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
    reached = np.array([values(unit, alone.told_by_rays(unit)[0]) for unit in met])
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
