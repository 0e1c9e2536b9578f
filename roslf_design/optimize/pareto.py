"""Fronts: what of one goal another costs, by limiting all but one and going from limit to limit, each warm-started."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .local import Search, search
from .problem import Constraint, Goal, Problem
from .sampling import sobol_units

Array = NDArray[np.float64]

STARTS = 6
"""Fresh starts for each end of the front."""
HAIR = 1e-6
"""What an end of the front gives of its own goal, relatively, to be told apart from worse designs as good in it."""


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
    problem: Problem,
    goals: Sequence[Goal],
    points: int,
    known: Sequence[Array],
    deadline: float,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Front:
    """Trade two or three goals.

    Parameters
    ----------
    problem : Problem
        Its own goals are not looked at.
    goals : sequence of Goal
        The first is optimised while the others are limited.
    points : int
        Limits along the second goal; of the third a third as many.
    known : sequence of ndarray
        Feasible points, scaled; searches start there.
    deadline : float
        On the monotonic clock [s].
    seed : int
        Of fresh starts.
    tell : callable
        Told what is being done.
    """
    found: list[FrontPoint] = []
    spent = 0
    fresh = [*known, *sobol_units(problem.n, STARTS, seed)]

    def solved(wanted: Goal, limits: Sequence[Constraint], starts: Sequence[Array]) -> Search | None:
        nonlocal spent
        posed = replace(problem, goals=(wanted,), constraints=(*problem.constraints, *limits), order="weighted")
        best = None
        for start in starts:
            result = search(posed, start, deadline)
            spent += result.evaluations
            if result.feasible and (best is None or result.merit < best.merit):
                best = result
        return best

    def keep(unit: Array) -> None:
        cameras = problem.cameras(unit[None])
        found.append(FrontPoint(unit, tuple(float(np.ravel(goal.values(cameras))[0]) for goal in goals)))

    ends = []
    for number, goal in enumerate(goals):
        tell(f"front: end {number + 1} of {len(goals)}")
        end = solved(goal, (), fresh)
        if end is None:
            return Front(tuple(goals), (), 1, 0, spent, False)
        unit = end.unit
        if number:
            # Of designs equally good in this goal, the one that is best in the first.
            value = float(np.ravel(goal.values(problem.cameras(unit[None])))[0])
            refined = solved(goals[0], [_limit(goal, value + goal.sign * HAIR * abs(value))], [unit])
            unit = unit if refined is None else refined.unit
        keep(unit)
        ends.append(unit)
    payoff = np.array([point.values for point in found])
    ladders = [_ladder(payoff[:, k], goals[k], points if k == 1 else max(3, points // 3)) for k in range(1, len(goals))]
    failed, complete = 0, True
    grid = [(limit,) for limit in ladders[0]] if len(ladders) == 1 else [(a, b) for b in ladders[1] for a in ladders[0]]
    warm = ends[0]
    for number, limits in enumerate(grid, 1):
        if time.monotonic() > deadline:
            complete = False
            break
        tell(f"front: limit {number} of {len(grid)}")
        if len(limits) == 2 and limits[0] == ladders[0][0]:
            warm = ends[0]
        held = [_limit(goal, value) for goal, value in zip(goals[1:], limits, strict=True)]
        best = solved(goals[0], held, [warm])
        if best is None:
            best = solved(goals[0], held, ends)
        if best is None:
            failed += 1
            continue
        warm = best.unit
        keep(best.unit)
    points_kept = _undominated(found, goals)
    return Front(tuple(goals), points_kept, failed, len(found) - len(points_kept), spent, complete)


def _ladder(values: Array, goal: Goal, count: int) -> Array:
    """Limits from the worst value at another goal's end to the best, in equal ratios where ratios count."""
    best = float(values.min() if goal.sign > 0 else values.max())
    worst = float(values.max() if goal.sign > 0 else values.min())
    if goal.quantity.positive:
        return np.asarray(np.geomspace(worst, best, count))
    return np.linspace(worst, best, count)


def _limit(goal: Goal, value: float) -> Constraint:
    return Constraint(goal.quantity, None if goal.sign > 0 else value, value if goal.sign > 0 else None, goal.at)


def _undominated(found: Sequence[FrontPoint], goals: Sequence[Goal]) -> tuple[FrontPoint, ...]:
    signs = np.array([goal.sign for goal in goals])
    values = np.array([point.values for point in found]) * signs
    tiny = 1e-7 * np.maximum(np.abs(values), 1e-12)
    kept: list[int] = []
    for i, own in enumerate(values):
        others = np.delete(np.arange(len(values)), i)
        worse = (values[others] <= own + tiny[i]).all(axis=1) & (values[others] < own - tiny[i]).any(axis=1)
        twin = any(np.allclose(values[j], own, rtol=1e-6, atol=0) for j in kept)
        if not worse.any() and not twin:
            kept.append(i)
    order = sorted(kept, key=lambda i: tuple(values[i][1:][::-1]))
    return tuple(found[i] for i in order)
