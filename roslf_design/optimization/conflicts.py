"""Why nothing is feasible: the least-violating point, the smallest set of limits that conflict, and remedies."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .problem import SIGNS, DesignProblem, Side, sobol_units
from .search import FEASIBLE, Guard, least_violation, violation_of

Array = NDArray[np.float64]

STARTS = 6
"""Of each question whether a subset can hold."""


@dataclass(frozen=True)
class Violation:
    """How far a limit is missed at the least-violating point."""

    limit: str
    """E.g. ``fill_factor <=``."""
    value: float
    wanted: float
    unit: str


@dataclass(frozen=True)
class Relaxation:
    """A limit that, moved alone, makes the whole problem feasible."""

    label: str
    limit: float
    """As asked."""
    needed: float | None
    """What it would have to be; None where moving it alone does not help."""
    unit: str


@dataclass(frozen=True)
class Conflict:
    """What stands in the way."""

    unit: Array
    """The least-violating point."""
    violation: float
    violations: tuple[Violation, ...] = ()
    smallest: tuple[str, ...] = ()
    """Constraints that cannot hold together within the bounds, while any fewer of them can, as far as searches tell."""
    complete: bool = True
    """Whether every smaller set was shown to be feasible before the time was up."""
    relaxations: tuple[Relaxation, ...] = ()
    bounds: tuple[str, ...] = ()
    """Bounds of variables that the least-violating point touches: relaxing these may help too."""
    feasible_after_all: bool = False


def explain(problem: DesignProblem, points: Sequence[Array], deadline: float, seed: int) -> Conflict:
    """Find what stands in the way of a problem, from where searches ended (best first) and Sobol points by the seed.

    The deadline is on the monotonic clock; a few seconds more are taken where it has passed.
    """
    deadline = max(deadline, time.monotonic() + 10.0)
    pool = _Pool(problem, deadline, [*points, *sobol_units(problem.n, STARTS, seed + 1)])
    unit, rows = pool.relaxed(frozenset(range(len(problem.constraints))))
    violation = violation_of(rows)
    if violation <= FEASIBLE:
        return Conflict(unit, 0.0, feasible_after_all=True)
    smallest, complete = _smallest(pool, len(problem.constraints))
    clashing = sorted(smallest)
    return Conflict(
        unit=unit,
        violation=violation,
        violations=_violations(problem, unit, rows),
        smallest=tuple(str(problem.constraints[index]) for index in clashing),
        complete=complete,
        relaxations=tuple(pool.alone(index, side) for index in clashing for side in problem.constraints[index].limits),
        bounds=tuple(
            f"{name} {variable.end(place > 0.5)}"
            for (name, variable), place in zip(problem.variables.items(), unit, strict=True)
            if not 1e-6 <= place <= 1 - 1e-6
        ),
    )


class _Pool:
    """Points met so far, and which constraints each of them holds."""

    def __init__(self, problem: DesignProblem, deadline: float, starts: Sequence[Array]) -> None:
        self.problem, self.deadline = problem, deadline
        self.starts = [np.clip(start, 0, 1) for start in starts]
        self.held: list[frozenset[int]] = []
        self.add(np.concatenate([np.stack(self.starts), sobol_units(problem.n, 2048, 5)]))

    def add(self, units: Array) -> None:
        good = self.problem.vector(units)[1:] <= FEASIBLE
        owner = np.array([row.constraint for row in self.problem.rows])
        each = np.stack([good[owner == index].all(axis=0) for index in range(-1, len(self.problem.constraints))])
        for column in np.unique(each[:, each[0]], axis=1).T:
            self.held.append(frozenset(np.flatnonzero(column[1:]).tolist()))

    def relaxed(self, keep: frozenset[int]) -> tuple[Array, Array]:
        """Least violation of some of the constraints; rows are those of the problem with only these."""
        part = self.problem.without(keep)
        guard = Guard(part.vector, self.deadline)
        weights = [10.0 if row.constraint < 0 else 1.0 for row in part.rows]
        unit, rows = least_violation(guard, self.starts[: 2 * STARTS], weights)
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

    def alone(self, index: int, side: Side) -> Relaxation:
        """What one limit would have to be, all others kept."""
        constraint = self.problem.constraints[index]
        soft = np.array([row.constraint == index and row.side == side for row in self.problem.rows])
        guard = Guard(self.problem.vector, self.deadline)
        unit, rows = least_violation(guard, self.starts[: 2 * STARTS], np.where(soft, 1.0, np.inf).tolist())
        value = self.problem.number(constraint, unit)
        helps = violation_of(rows[~soft]) <= 1e-7 and np.isfinite(value)
        label = f"{constraint.label} {SIGNS[side]}"
        return Relaxation(label, constraint.limits[side], value if helps else None, constraint.quantity.unit)


def _smallest(pool: _Pool, count: int) -> tuple[frozenset[int], bool]:
    """By size: the first set that cannot hold. Points met on the way settle most sets without a search."""
    for size in range(1, count + 1):
        for keep in combinations(range(count), size):
            if time.monotonic() > pool.deadline:
                return _by_deletion(pool, count), False
            if not pool.possible(frozenset(keep)):
                return frozenset(keep), True
    return frozenset(range(count)), True


def _by_deletion(pool: _Pool, count: int) -> frozenset[int]:
    """Where time is short: leave out what the conflict does not need, one after the other."""
    pool.deadline = time.monotonic() + 5.0
    keep = set(range(count))
    for index in range(count):
        if time.monotonic() < pool.deadline and not pool.possible(frozenset(keep - {index})):
            keep.discard(index)
    return frozenset(keep)


def _violations(problem: DesignProblem, unit: Array, rows: Array) -> tuple[Violation, ...]:
    missed = {}
    for row, over in zip(problem.rows, rows, strict=True):
        if over <= FEASIBLE or row.constraint < 0:
            continue
        constraint = problem.constraints[row.constraint]
        label, value = f"{constraint.label} {SIGNS[row.side]}", problem.number(constraint, unit)
        missed[label] = Violation(label, value, constraint.limits[row.side], constraint.quantity.unit)
    return tuple(missed.values())
