"""Fronts: what of one goal another costs, by limiting all but one and going from limit to limit, each warm-started."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..tolerancing.study import StrictTable
from .problem import Constraint, DesignProblem, Goal, sobol_units
from .search import search

Array = NDArray[np.float64]

STARTS = 6
"""Fresh starts for each end of the front."""
HAIR = 1e-6
"""What an end of the front gives of its own goal, relatively, to be told apart from worse designs as good in it."""


class ParetoTable(StrictTable):
    """Two or three goals to trade."""

    goals: Annotated[tuple[str, ...], Field(min_length=2, max_length=3)]
    """Names of quantities among [[goals]]."""
    points: Annotated[int, Field(ge=3, le=100)] = 13
    """Along each limited goal."""


@dataclass(frozen=True)
class FrontPoint:
    """One design of a front."""

    unit: Array
    values: tuple[float, ...]
    """Of the front's goals, in their order and units."""


@dataclass(frozen=True)
class Front:
    """Designs of which none is better in every goal."""

    goals: tuple[Goal, ...]
    points: tuple[FrontPoint, ...]
    """In the order of the first limited goal."""
    failed: int
    """Limits at which no feasible design was found."""
    dominated: int
    """Designs left out since another was better in every goal."""
    evaluations: int
    complete: bool
    """Whether all limits were tried before the time was up."""


def pareto_front(
    problem: DesignProblem,
    goals: Sequence[Goal],
    points: int,
    known: Sequence[Array],
    deadline: float,
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
    deadline : float
        On the monotonic clock [s].
    """
    designs: list[FrontPoint] = []
    spent = 0
    fresh = [*known, *sobol_units(problem.n, STARTS, seed)]

    def best_of(wanted: Goal, limits: Sequence[Constraint], starts: Sequence[Array]) -> Array | None:
        nonlocal spent
        posed = replace(problem, goals=(wanted,), constraints=(*problem.constraints, *limits), order="weighted")
        results = [search(posed.vector, start, deadline) for start in starts]
        spent += sum(result.evaluations for result in results)
        feasible = [result for result in results if result.feasible]
        return min(feasible, key=lambda result: result.merit).unit if feasible else None

    def keep(unit: Array) -> Array:
        designs.append(FrontPoint(unit, tuple(problem.number(goal, unit) for goal in goals)))
        return unit

    ends = []
    for number, goal in enumerate(goals):
        tell(f"front: end {number + 1} of {len(goals)}")
        end = best_of(goal, (), fresh)
        if end is None:
            return Front(tuple(goals), (), 1, 0, spent, False)
        if number:
            # Of designs equally good in this goal, the one that is best in the first.
            value = problem.number(goal, end)
            refined = best_of(goals[0], [goal.held(value + goal.sign * HAIR * abs(value))], [end])
            end = end if refined is None else refined
        ends.append(keep(end))
    payoff = np.array([point.values for point in designs])
    ladders = [_ladder(payoff[:, k], goals[k], points if k == 1 else max(3, points // 3)) for k in range(1, len(goals))]
    grid = [limits[::-1] for limits in product(*ladders[::-1])]
    failed, complete = 0, True
    warm = ends[0]
    for number, limits in enumerate(grid, 1):
        if time.monotonic() > deadline:
            complete = False
            break
        tell(f"front: limit {number} of {len(grid)}")
        if limits[0] == ladders[0][0]:
            warm = ends[0]
        held = [goal.held(value) for goal, value in zip(goals[1:], limits, strict=True)]
        best = best_of(goals[0], held, [warm])
        if best is None:
            best = best_of(goals[0], held, ends)
        if best is None:
            failed += 1
        else:
            warm = keep(best)
    undominated = _undominated(designs, goals)
    return Front(tuple(goals), undominated, failed, len(designs) - len(undominated), spent, complete)


def _ladder(values: Array, goal: Goal, count: int) -> list[float]:
    """Limits from the worst value at another goal's end to the best, in equal ratios where ratios count."""
    worst, best = (goal.sign * float(end) for end in ((goal.sign * values).max(), (goal.sign * values).min()))
    return list(map(float, (np.geomspace if goal.quantity.positive else np.linspace)(worst, best, count)))


def _undominated(designs: Sequence[FrontPoint], goals: Sequence[Goal]) -> tuple[FrontPoint, ...]:
    values = np.array([point.values for point in designs]) * [goal.sign for goal in goals]
    tiny = 1e-7 * np.maximum(np.abs(values), 1e-12)
    front: list[int] = []
    for i, own in enumerate(values):
        better = (values <= own + tiny[i]).all(axis=1) & (values < own - tiny[i]).any(axis=1)
        twin = any(np.allclose(values[j], own, rtol=1e-6, atol=0) for j in front)
        if not better.any() and not twin:
            front.append(i)
    return tuple(designs[i] for i in sorted(front, key=lambda i: tuple(values[i][1:][::-1])))
