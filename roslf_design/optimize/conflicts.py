"""Why nothing is feasible: the least-violating point, the smallest set of limits that conflict, and remedies."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .elastic import least_violation
from .guard import FEASIBLE, Guard, violation_of
from .problem import Constraint, Problem
from .sampling import sobol_units

Array = NDArray[np.float64]

STARTS = 6
"""Of each question whether a subset can hold."""


@dataclass(frozen=True)
class Violation:
    """How far a limit is missed at the least-violating point."""

    label: str
    value: float
    limit: float
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
    violations: tuple[Violation, ...]
    smallest: tuple[str, ...]
    """Constraints that cannot hold together within the bounds, while any fewer of them can, as far as searches tell."""
    complete: bool
    """Whether every smaller set was shown to be feasible before the time was up."""
    relaxations: tuple[Relaxation, ...]
    bounds: tuple[str, ...]
    """Bounds of variables that the least-violating point touches: relaxing these may help too."""
    feasible_after_all: Array | None = None


def explain(problem: Problem, points: Sequence[Array], deadline: float, seed: int) -> Conflict:
    """Find what stands in the way.

    Parameters
    ----------
    problem : Problem
        Found infeasible.
    points : sequence of ndarray
        Where searches ended, best first.
    deadline : float
        On the monotonic clock; a few seconds more are taken where it has passed.
    seed : int
        Of further starts.
    """
    deadline = max(deadline, time.monotonic() + 10.0)
    pool = _Pool(problem, deadline, [*points, *sobol_units(problem.n, STARTS, seed + 1)])
    unit, rows = pool.relaxed(frozenset(range(len(problem.constraints))))
    if violation_of(rows, problem.equalities) <= FEASIBLE:
        return Conflict(unit, 0.0, (), (), True, (), (), unit)
    smallest, complete = _smallest(pool, len(problem.constraints))
    relaxations = tuple(
        pool.alone(index, side) for index in sorted(smallest) for side in _violated_sides(problem, index)
    )
    return Conflict(
        unit=unit,
        violation=violation_of(rows, problem.equalities),
        violations=_violations(problem, unit, rows),
        smallest=tuple(_described(problem.constraints[index]) for index in sorted(smallest)),
        complete=complete,
        relaxations=relaxations,
        bounds=_bounds(problem, unit),
    )


class _Pool:
    """Points met so far, and which constraints each of them holds."""

    def __init__(self, problem: Problem, deadline: float, starts: Sequence[Array]) -> None:
        self.problem, self.deadline = problem, deadline
        self.starts = [np.clip(start, 0, 1) for start in starts]
        self.held: list[frozenset[int]] = []
        self.see(np.concatenate([np.stack(self.starts), sobol_units(problem.n, 2048, 5)]))

    def see(self, units: Array) -> None:
        rows = self.problem.vector(units)[1:]
        split = len(rows) - self.problem.equalities
        with np.errstate(invalid="ignore"):
            good = np.concatenate([rows[:split] <= FEASIBLE, np.abs(rows[split:]) <= FEASIBLE])
        owner = np.array([row.constraint for row in self.problem.rows])
        count = len(self.problem.constraints)
        each = np.stack([good[owner == index].all(axis=0) for index in range(-1, count)])
        for column in np.unique(each[:, each[0]], axis=1).T:
            self.held.append(frozenset(np.flatnonzero(column[1:]).tolist()))

    def relaxed(self, keep: frozenset[int]) -> tuple[Array, Array]:
        """Least violation of some of the constraints; rows are those of the problem with only these."""
        part = self.problem.without(keep)
        guard = Guard(part, self.deadline)
        weights = [10.0 if row.constraint < 0 else 1.0 for row in part.rows]
        unit, rows, _ = least_violation(guard, self.starts[: 2 * STARTS], weights)
        self.see(unit[None])
        if guard.unit is not None:
            self.see(guard.unit[None])
            if guard.feasible:
                unit, rows = guard.unit, part.vector(guard.unit[None])[1:, 0]
        return unit, rows

    def possible(self, keep: frozenset[int]) -> bool:
        """Whether some constraints can hold together, as far as searches tell."""
        if any(keep <= held for held in self.held):
            return True
        _, rows = self.relaxed(keep)
        return violation_of(rows, self.problem.without(keep).equalities) <= FEASIBLE

    def alone(self, index: int, side: str) -> Relaxation:
        """What one limit would have to be, all others kept."""
        constraint = self.problem.constraints[index]
        guard = Guard(self.problem, self.deadline)
        weights = [1.0 if row.constraint == index and row.side == side else np.inf for row in self.problem.rows]
        unit, rows, _ = least_violation(guard, self.starts[: 2 * STARTS], weights)
        others = np.array([np.isinf(weight) for weight in weights])
        split = len(rows) - self.problem.equalities
        over = np.where(np.arange(len(rows)) < split, rows, np.abs(rows))
        value = float(np.ravel(constraint.values(self.problem.cameras(unit[None])))[0])
        helps = bool((over[others] <= 1e-7).all()) and np.isfinite(value)
        sign = {"min": ">=", "max": "<=", "equal": "="}[side]
        limit = constraint.limit(side)  # type: ignore[arg-type]
        return Relaxation(f"{constraint.label} {sign}", limit, value if helps else None, constraint.quantity.unit)


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


def _violated_sides(problem: Problem, index: int) -> tuple[str, ...]:
    return tuple(problem.constraints[index].sides)


def _violations(problem: Problem, unit: Array, rows: Array) -> tuple[Violation, ...]:
    found = {}
    cameras = problem.cameras(unit[None])
    for row, over in zip(problem.rows, rows, strict=True):
        missed = abs(over) if row.side == "equal" else over
        if missed <= FEASIBLE or row.constraint < 0:
            continue
        constraint = problem.constraints[row.constraint]
        sign = {"min": ">=", "max": "<=", "equal": "="}[row.side]
        value = float(np.ravel(constraint.values(cameras))[0])
        label = f"{constraint.label} {sign}"
        found[label] = Violation(label, value, constraint.limit(row.side), constraint.quantity.unit)
    return tuple(found.values())


def _described(constraint: Constraint) -> str:
    unit = f" {constraint.quantity.unit}" if constraint.quantity.unit else ""
    if constraint.sides == ("equal",):
        return f"{constraint.label} = {constraint.low:.6g}{unit}"
    if len(constraint.sides) == 2:
        return f"{constraint.low:.6g} <= {constraint.label} <= {constraint.high:.6g}{unit}"
    side = constraint.sides[0]
    return f"{constraint.label} {'>=' if side == 'min' else '<='} {constraint.limit(side):.6g}{unit}"


def _bounds(problem: Problem, unit: Array) -> tuple[str, ...]:
    found = []
    for variable, place in zip(problem.variables, unit, strict=True):
        if place < 1e-6:
            found.append(f"{variable.name} >= {variable.low:.6g} mm")
        elif place > 1 - 1e-6:
            found.append(f"{variable.name} <= {variable.high:.6g} mm")
    return tuple(found)


def relaxed_problem(problem: Problem, relaxation: Relaxation) -> Problem:
    """The problem with one limit moved to where it makes the whole feasible."""
    assert relaxation.needed is not None
    changed = []
    for constraint in problem.constraints:
        for side in constraint.sides:
            sign = {"min": ">=", "max": "<=", "equal": "="}[side]
            if relaxation.label == f"{constraint.label} {sign}" and relaxation.limit == constraint.limit(side):
                low = relaxation.needed if side in ("min", "equal") else constraint.low
                high = relaxation.needed if side in ("max", "equal") else constraint.high
                constraint = replace(constraint, low=low, high=high)
        changed.append(constraint)
    return replace(problem, constraints=tuple(changed))
