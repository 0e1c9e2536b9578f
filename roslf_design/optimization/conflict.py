"""Conflicts of limits: the least-violating point, the smallest set that cannot hold together, and remedies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from .._arrays import Array, by_value
from ..theory.quantity import FEASIBLE
from ..words import listed, number, on_side
from .goals import Side
from .problem import FRESH_POINTS, DesignProblem, sobol_units
from .search import Guard, SearchBudget, least_violation, violation_of

EXPLAINING = 10_000, 10.0
"""Evaluations, and seconds where there is a clock, that why nothing is feasible may take at least."""


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

    @property
    def feasible_from(self) -> str:
        """Digits of the limit that would do, on its side; empty where moving it alone does not help."""
        return "" if self.needed is None else on_side(self.needed, self.label.endswith("<="), 6)


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
    by_views: bool = False
    """Whether pixels must be views, of microlenses that no focal length keeps focused on the pupil."""

    @property
    def reason(self) -> str:
        """Reason why nothing is feasible, in words."""
        if self.undefined:
            return f"where the limits hold, {' and '.join(self.undefined)} is undefined"
        if not self.smallest:
            return f"within the bounds stands no camera ({', '.join(self.always) or 'nothing can be built'})"
        doubt = "" if self.complete else " (a smaller set was not excluded before the budget was spent)"
        views = ", of microlenses that image the pupil (microlens_in_focus = true lets f_ml follow)" * self.by_views
        clash = "these cannot hold together:" if len(self.smallest) > 1 else "nothing holds"
        return f"within the bounds, {clash} {' and '.join(self.smallest)}{views}{doubt}"

    @property
    def missed(self) -> str:
        """Every limit that the least-violating point misses, with what it has there, in words; empty where none."""
        units = [f" {one.unit}" if one.unit else "" for one in self.violations]
        got = [
            f"{one.limit} {number(one.wanted)}{unit} (got {number(one.value)}{unit})"
            for one, unit in zip(self.violations, units, strict=True)
        ]
        return f"The least-violating point misses {listed(got)}." if got else ""

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


def explain(problem: DesignProblem, points: Sequence[Array], budget: SearchBudget, seed: int) -> Conflict:
    """Find what stands in the way of a problem, from where searches ended (best first) and Sobol points by the seed.

    Where the budget is spent, some more is taken.
    """
    pool = _Pool(problem, budget.at_least(*EXPLAINING), [*points, *sobol_units(problem.n, FRESH_POINTS, seed + 1)])
    unit, rows = pool.relaxed(frozenset(range(len(problem.constraints))))
    violation = violation_of(rows)
    if violation <= FEASIBLE:
        lost = tuple(goal.label for goal in problem.goals if math.isnan(problem.number(goal, unit)))
        return Conflict(unit, 0.0, feasible_after_all=True, undefined=lost or tuple(g.label for g in problem.goals))
    smallest, complete = _smallest(pool, len(problem.constraints))
    clashing = sorted(smallest)
    relaxations = [pool.alone(index, side) for index in clashing for side in problem.constraints[index].limits]
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
    # What else is missed helps not at all alone: the smallest set goes without it.
    others = [one for one in missed.values() if one.limit not in {way.label for way in relaxations}]
    over = zip(problem.rows, rows, strict=True)
    missing = dict.fromkeys(row.label for row, by in over if row.constraint < 0 and by > FEASIBLE)
    return Conflict(
        unit=unit,
        violation=violation,
        violations=tuple(missed.values()),
        smallest=tuple(str(problem.constraints[index]) for index in clashing),
        complete=complete,
        relaxations=(*relaxations, *(_Relaxation(one.limit, one.wanted, None, one.unit) for one in others)),
        bounds=tuple(
            f"{name} {variable.end(place > 0.5)}"
            for (name, variable), place in zip(problem.variables.items(), unit, strict=True)
            if variable.max > variable.min and not 1e-6 <= place <= 1 - 1e-6
        ),
        always=tuple(missing),
        by_views=problem.of_views and not problem.in_focus,
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
        unit, rows = least_violation(guard, self.starts[: 2 * FRESH_POINTS], weights)
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
        unit, rows = least_violation(guard, self.starts[: 2 * FRESH_POINTS], np.where(soft, 1.0, np.inf).tolist())
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
