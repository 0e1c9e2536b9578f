"""Conflicts of limits: the least-violating point, the smallest set that cannot hold together, and remedies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from .._arrays import Array, by_value
from ..theory.quantity import FEASIBLE
from ..words import listed, number, on_side
from .bounds import ruled_out
from .goals import Constraint
from .problem import FRESH_POINTS, DesignProblem, sobol_units
from .search import BIG, Guard, SearchBudget, least_violation, violation_of

EXPLAINING = 10_000, 10.0
"""Evaluations, and seconds where there is a clock, that why nothing is feasible may take at least."""
DEAR = 10
"""Such evaluations, of what takes milliseconds, for one."""
LOOKED_AT = 2048
"""Points all over the bounds that are looked at first."""
STARTS, APART = 4, 0.05
"""Points from which limits are searched for together, and their least distance in one of the variables."""
PRESSED = 1e-4
"""Scaled rows so close to their limit count as pressed on."""


@dataclass(frozen=True)
class Violation:
    """A limit, and what there is of it at a least-violating point."""

    limit: str
    """E.g. ``fill_factor <=``."""
    value: float
    wanted: float
    unit: str

    @classmethod
    def of(cls, problem: DesignProblem, constraint: Constraint, unit: Array) -> Violation:
        """A one-sided limit of a problem at scaled variables."""
        ((side, limit),) = constraint.limits.items()
        value = problem.number(constraint, unit)
        return cls(constraint.limit_words(side), value, limit, constraint.quantity.unit)

    @property
    def asked(self) -> str:
        """The limit in words, e.g. ``d_3 <= 8 mm``."""
        return f"{self.limit} {number(self.wanted, 6)} {self.unit}".rstrip()

    @property
    def value_words(self) -> str:
        """Value with its unit, or none."""
        return "none" if math.isnan(self.value) else f"{number(self.value)} {self.unit}".rstrip()

    @property
    def held(self) -> bool:
        """Whether it is held in all digits that are told."""
        return number(self.value) == number(self.wanted)

    def __str__(self) -> str:
        return f"{self.asked} ({'at its limit' if self.held else f'got {self.value_words}'})"


@dataclass(frozen=True)
class _Relaxation:
    """A limit that, moved alone, makes the whole problem feasible."""

    label: str
    limit: float
    """Limit as asked."""
    needed: float | None
    """Limit that would make the problem feasible; None where moving it alone does not help."""
    unit: str
    reached: float = math.nan
    """Value where this limit alone, of all, is missed least."""

    @property
    def alone(self) -> str:
        """Value nearest to the limit that any camera within the bounds has, all other limits left out."""
        over = self.reached - self.limit if self.label.endswith("<=") else self.limit - self.reached
        return "held" if over <= FEASIBLE * abs(self.limit) else number(self.reached, 6)

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
    violations: tuple[Violation, ...] = ()
    clashing: tuple[Violation, ...] = ()
    """Limits that no search within the bounds held together, while any fewer of them can be, with what there is of each
    at the least-violating point of them alone."""
    proven: bool = False
    """Whether bounds of closed forms prove that nothing holds them together."""
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
    unjudged: tuple[str, ...] = ()
    """Labels of limits that were not looked at."""
    bore: tuple[str, ...] = ()
    """Words on limits beyond what the bore's rims let through, whatever the lens: known before any search."""

    @property
    def smallest(self) -> tuple[str, ...]:
        """Limits that clash, in words."""
        return tuple(one.asked for one in self.clashing)

    @property
    def reason(self) -> str:
        """Reason why nothing is feasible, in words."""
        if self.bore:
            return "; ".join(self.bore)
        if self.undefined:
            return f"where the limits hold, {' and '.join(self.undefined)} is undefined"
        if not self.clashing:
            return f"within the bounds no camera was found ({', '.join(self.always) or 'nothing can be built'})"
        doubt = "" if self.complete else " (a smaller set was not excluded before the budget was spent)"
        views = ", of microlenses that image the pupil (microlens_in_focus = true lets f_ml follow)" * self.by_views
        several = len(self.clashing) > 1
        clash = "these cannot hold together:" if several else "nothing holds"
        if not self.proven:
            clash = f"no search found a camera that holds{' these together:' * several}"
        told = {one.limit: one.value_words for one in self.violations}
        alone = any(told.get(one.limit, one.value_words) != one.value_words for one in self.clashing)
        alone_words = ", all other limits left out" * alone
        return f"within the bounds, {clash} {' and '.join(map(str, self.clashing))}{alone_words}{views}{doubt}"

    @property
    def missed(self) -> str:
        """Further limits that the least-violating point misses in the digits told, with what it has there, in words."""
        known = {one.limit for one in self.clashing}
        got = [str(one) for one in self.violations if one.limit not in known and not one.held]
        return f"The least-violating point misses {listed(got)} as well." if got else ""

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {
            "violations": self.violations,
            "cannot_hold_together": self.smallest,
            "clashing": self.clashing,
            "proven": self.proven,
            "smaller_sets_shown_feasible": self.complete,
            "reason": self.reason,
            "no_camera": self.always,
            "goals_undefined": self.undefined,
            "relaxations": [
                {"limit": r.label, "from": r.limit, "to": r.needed, "unit": r.unit} for r in self.relaxations
            ],
            "bounds_touched": self.bounds,
        }


def explain(problem: DesignProblem, points: Sequence[Array], budget: SearchBudget, seed: int) -> Conflict | None:
    """Find what stands in the way of a problem, from where searches ended (best first), its base design and others.

    Where the budget is spent, some more is taken; None where somebody has enough: a search cut short tells no conflict.
    """
    with budget.interruptible():
        if budget.ended != "stopped":
            return _explained(problem, points, budget, seed)
    return None


def _explained(problem: DesignProblem, points: Sequence[Array], budget: SearchBudget, seed: int) -> Conflict:
    sided = problem.one_sided()
    every = frozenset(range(len(sided.constraints)))
    pool = _Pool.about(sided, points, budget, seed)
    unit = pool.nearest(every)
    rows = np.nan_to_num(sided.limits(unit[None])[:, 0], nan=BIG)
    violation = violation_of(rows)
    if violation <= FEASIBLE:
        lost = tuple(goal.label for goal in problem.goals if math.isnan(problem.number(goal, unit)))
        return Conflict(unit, 0.0, feasible_after_all=True, undefined=lost or tuple(g.label for g in problem.goals))
    # At the point of least violation, limits that are held with room keep nothing from being held.
    pressed = {row.constraint for row, over in zip(sided.rows, rows, strict=True) if over > -PRESSED} - {-1}
    within = every if pool.possible(frozenset(pressed)) else pressed
    smallest, complete = _smallest(pool, sorted(within))
    relaxations = [pool.alone(index) for index in sorted(smallest)]
    over = [row for row, by in zip(sided.rows, rows, strict=True) if by > FEASIBLE]
    limits = sorted({row.constraint for row in over} - {-1})
    missed = tuple(Violation.of(problem, sided.constraints[index], unit) for index in limits)
    # What else is missed helps not at all alone: the smallest set goes without it.
    labels = {way.label for way in relaxations}
    others = {
        index: _Relaxation(one.limit, one.wanted, None, one.unit)
        for index, one in zip(limits, missed, strict=True)
        if one.limit not in labels
    }
    ways = dict(zip(sorted(smallest), relaxations, strict=True)) | others
    reached = {index: pool.alone_best(index) for index in ways}
    there = pool.best(smallest)  # of all points met, also while looking for those
    return Conflict(
        unit=unit,
        violation=violation,
        violations=missed,
        clashing=tuple(Violation.of(problem, sided.constraints[index], there) for index in sorted(smallest)),
        proven=ruled_out(sided.keeping(smallest)),
        complete=complete,
        relaxations=tuple(
            replace(way, reached=problem.number(sided.constraints[index], reached[index]))
            for index, way in ways.items()
        ),
        bounds=tuple(
            f"{problem.called(name)} {variable.end(place > 0.5)}"
            for (name, variable), place in zip(problem.variables.items(), unit, strict=True)
            if variable.max > variable.min and not 1e-6 <= place <= 1 - 1e-6
        ),
        always=tuple(dict.fromkeys(row.label for row in over if row.constraint < 0)),
        by_views=problem.of_views and not problem.in_focus,
    )


class _Pool:
    """Points met so far, and how far each limit of a problem is missed at each of them."""

    def __init__(self, problem: DesignProblem, budget: SearchBudget, starts: Sequence[Array]) -> None:
        self.problem, self.cost = problem.without_goals(), DEAR if problem.summed else 1
        self.counts = self.problem.dear and budget.each > 0
        evaluations, seconds = EXPLAINING
        self.each = 1 if self.counts else self.cost
        self.budget = budget.at_least(evaluations / self.each, seconds)
        self.owner = np.array([row.constraint for row in self.problem.rows])
        self.units, self.over = np.empty((0, problem.n)), np.empty((1 + len(problem.constraints), 0))
        self.add(np.concatenate([np.clip(np.stack(starts), 0, 1), sobol_units(problem.n, LOOKED_AT // self.cost, 5)]))

    @classmethod
    def about(cls, problem: DesignProblem, points: Sequence[Array], budget: SearchBudget, seed: int) -> _Pool:
        """Points about which to look: those given, of the base design, and others."""
        return cls(problem, budget, [*points, *problem.drawn, *sobol_units(problem.n, FRESH_POINTS, seed + 1)])

    def add(self, units: Array) -> None:
        """Look at further points."""
        rows = np.nan_to_num(self.problem.limits(units), nan=BIG, posinf=BIG, neginf=-BIG)
        each = [rows[self.owner == k].max(axis=0, initial=-BIG) for k in range(-1, len(self.problem.constraints))]
        self.units, self.over = np.concatenate([self.units, units]), np.concatenate([self.over, each], axis=1)

    def missed(self, keep: frozenset[int]) -> Array:
        """By how much each point misses some of the limits at most."""
        return np.asarray(self.over[[0, *(k + 1 for k in sorted(keep))]].max(axis=0))

    def in_all(self, keep: frozenset[int]) -> Array:
        """Sum of what each point misses of some of the limits, as searches for the least violation count it."""
        over = np.maximum(self.over, 0.0)
        return np.asarray(10.0 * over[0] + over[[k + 1 for k in sorted(keep)]].sum(axis=0))

    def best(self, keep: frozenset[int]) -> Array:
        """The point met that misses some of the limits least."""
        return np.asarray(self.units[self.missed(keep).argmin()])

    def alone_best(self, index: int) -> Array:
        """The point that misses one limit least, all others left out, as far as searches tell."""
        self.possible(frozenset({index}))
        return self.best(frozenset({index}))

    def _starts(self, keep: frozenset[int]) -> list[Array]:
        starts: list[Array] = []
        for unit in self.units[np.argsort(self.in_all(keep), kind="stable")]:
            if all(np.abs(unit - other).max() > APART for other in starts):
                starts.append(unit)
            if len(starts) == STARTS:
                break
        return starts

    def _guard(self, part: DesignProblem) -> Guard:
        vector = self.budget.counting(part.vector) if part.dear else part.vector
        return Guard(vector, self.budget, roughly=self.counts)

    def nearest(self, keep: frozenset[int]) -> Array:
        """The point of least violation of some of the limits, as far as searches tell."""
        part = self.problem.keeping(keep)
        guard = self._guard(part)
        unit, _ = least_violation(guard, self._starts(keep), [10.0 if row.constraint < 0 else 1.0 for row in part.rows])
        self.add(np.stack([unit] if guard.unit is None else [unit, guard.unit]))
        return self.best(keep) if guard.feasible else np.asarray(self.units[self.in_all(keep).argmin()])

    def possible(self, keep: frozenset[int]) -> bool | None:
        """Whether some limits can hold together, as far as searches tell; None where the budget ended one."""
        if not (self.missed(keep) <= FEASIBLE).any():
            self.nearest(keep)
        held = bool((self.missed(keep) <= FEASIBLE).any())
        return None if self.budget.ended and not held else held

    def alone(self, index: int) -> _Relaxation:
        """Relaxation of one limit, all others kept, that makes the problem feasible."""
        constraint = self.problem.constraints[index]
        others = frozenset(range(len(self.problem.constraints))) - {index}
        guard, soft = self._guard(self.problem), self.owner == index
        unit, rows = least_violation(guard, self._starts(others), np.where(soft, 1.0, np.inf).tolist())
        helps = violation_of(rows[~soft]) <= 1e-7
        # Where nothing else keeps from it, searches for all limits, or for this one, may have come nearer.
        self.add(np.stack([unit, self.alone_best(index)]))
        over = np.where(self.missed(others) <= FEASIBLE, self.over[index + 1], np.inf)
        if np.isfinite(over.min()) and (not helps or over.min() < violation_of(rows[soft])):
            unit, helps = self.units[over.argmin()], True
        one = Violation.of(self.problem, constraint, unit)
        return _Relaxation(one.limit, one.wanted, one.value if helps and np.isfinite(one.value) else None, one.unit)


def _smallest(pool: _Pool, among: Sequence[int]) -> tuple[frozenset[int], bool]:
    """By size: the first set that cannot hold. Points met on the way settle most sets without a search."""
    for size in range(len(among) + 1):
        for keep in combinations(among, size):
            possible = pool.possible(frozenset(keep))
            if possible is None:
                return _by_deletion(pool, among), False
            if not possible:
                return frozenset(keep), True
    return frozenset(among), True


def _by_deletion(pool: _Pool, among: Sequence[int]) -> frozenset[int]:
    """Where the budget is spent: leave out what the conflict does not need, one after the other."""
    evaluations, seconds = EXPLAINING
    pool.budget = pool.budget.at_least(evaluations / pool.each / 2, seconds / 2)
    keep = frozenset(among)
    for index in among:
        if pool.possible(keep - {index}) is False:
            keep -= {index}
    return keep
