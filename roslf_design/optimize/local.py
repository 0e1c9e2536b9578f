"""One local search: from any start to the best point near it, feasible if there is one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .elastic import least_violation
from .guard import BIG, FEASIBLE, Guard, Smooth, violation_of
from .runs import FTOL, Stop, slsqp

Array = NDArray[np.float64]

NEAR = 1e-7
"""Rows this close to their limit are put exactly on it in the end."""
QUICK = 1e-8
"""Relative change of the merit at which an unpolished search ends."""


@dataclass(frozen=True)
class Search:
    """What one search found."""

    unit: Array
    """Scaled variables."""
    merit: float
    violation: float
    stop: Stop
    evaluations: int
    mapped: int
    faults: int
    fault: str
    clipped: bool
    """Whether the start lay outside the bounds and was moved onto them."""

    @property
    def feasible(self) -> bool:
        """Whether every row holds."""
        return self.violation <= FEASIBLE


def search(
    problem: Smooth,
    start: Array,
    deadline: float = float("inf"),
    evaluations: int = 300,
    *,
    polish: bool = True,
    tolerance: float = QUICK,
) -> Search:
    """SLSQP from a start, by way of the least violation where it does not reach a feasible point, then polished.

    Parameters
    ----------
    problem : Smooth
    start : ndarray, shape (n,)
        Outside the unit box it is clipped to it.
    deadline : float
        On the monotonic clock [s].
    evaluations : int
        Of each run.
    polish : bool
        Whether the run is repeated from its own end until nothing is gained; if not, it also ends earlier.
    tolerance : float
        Change of the merit, absolute and relative, at which an unpolished search ends.
    """
    guard = Guard(problem, deadline)
    begin = np.clip(np.nan_to_num(np.asarray(start, float), nan=0.5), 0.0, 1.0)
    ftol = FTOL if polish else tolerance
    stop = slsqp(guard, begin, evaluations, ftol)
    if not guard.feasible and guard.seconds_left > 0:
        starts = [begin] if guard.unit is None else [guard.unit, begin][: 2 if polish else 1]
        unit, _, _ = least_violation(guard, starts, evaluations=evaluations)
        if guard.feasible:
            stop = slsqp(guard, unit, evaluations, ftol)
    for _ in range(4 if polish else 0):
        before = guard.merit
        if guard.unit is None or not guard.feasible or guard.seconds_left <= 0:
            break
        stop = slsqp(guard, guard.unit, evaluations)
        if before - guard.merit <= 1e-12 * max(1.0, abs(before)):
            break
    unit, merit, violation = _on_limits(guard, begin)
    clipped = bool((np.asarray(start) != begin).any())
    return Search(unit, merit, violation, stop, guard.evaluations, guard.mapped, guard.faults, guard.fault, clipped)


def _on_limits(guard: Guard, begin: Array) -> tuple[Array, float, float]:
    """The guard's best point, moved by Newton's method exactly onto the limits that it touches."""
    if guard.unit is None:
        return begin, BIG, BIG
    unit, merit, violation = guard.unit, guard.merit, guard.violation
    if violation > FEASIBLE:
        return unit, merit, violation
    equalities = guard.problem.equalities
    moved = unit
    for _ in range(4):
        values, jacobian = guard.rows(moved, True)
        rows = values[1:]
        touching = np.flatnonzero((rows > -NEAR) | (np.arange(len(rows)) >= len(rows) - equalities))
        over = violation_of(rows, equalities)
        if over <= violation and values[0] <= merit + 1e-6:
            unit, merit, violation = moved, float(values[0]), over
        if not touching.size or over <= 1e-15:
            break
        free = (moved > 0) & (moved < 1)
        step = np.zeros_like(moved)
        step[free] = -np.linalg.lstsq(jacobian[1:][touching][:, free], rows[touching], rcond=1e-12)[0]
        moved = np.clip(moved + step, 0.0, 1.0)
    return unit, merit, violation
