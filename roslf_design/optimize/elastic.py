"""The least total violation of a problem's rows: how searches get to a feasible point, or learn that there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .guard import Guard, Smooth
from .runs import Stop, slsqp

Array = NDArray[np.float64]

LIMIT = 50.0
"""Largest slack of a scaled row; what is worse is cut off there."""


@dataclass(frozen=True)
class Elastic:
    """A problem with a slack for each row, minimising their weighted sum; slacks are scaled to the unit box too."""

    problem: Smooth
    """Whose rows are relaxed."""
    count: int
    """How many rows it has."""
    weights: tuple[float, ...]
    """One a row; infinite for rows that stay hard."""

    @property
    def soft(self) -> NDArray[np.intp]:
        """Which rows have a slack."""
        return np.flatnonzero(np.isfinite(self.weights))

    @property
    def n(self) -> int:
        """The problem's variables and the slacks."""
        return self.problem.n + len(self.soft)

    @property
    def equalities(self) -> int:
        """None: an equality becomes two inequalities."""
        return 0

    def vector(self, units: Array) -> Array:
        """Weighted sum of slacks; rows less their slacks."""
        n, split = self.problem.n, self.count - self.problem.equalities
        rows = self.problem.vector(units[:, :n])[1:]
        slack = np.zeros_like(rows)
        slack[self.soft] = LIMIT * units[:, n:].T
        total = np.asarray(self.weights)[self.soft] @ slack[self.soft]
        both = [total[None], rows[:split] - slack[:split], rows[split:] - slack[split:], -rows[split:] - slack[split:]]
        return np.concatenate(both)


def least_violation(
    guard: Guard, starts: Sequence[Array], weights: Sequence[float] | None = None, evaluations: int = 200
) -> tuple[Array, Array, Stop]:
    """The point of least weighted violation, by relaxing each row.

    Parameters
    ----------
    guard : Guard
        Of the problem; remembers every point tried, so that a feasible one met on the way is kept.
    starts : sequence of ndarray
        Where searches start.
    weights : sequence of float, optional
        One a row: what a scaled unit of violation costs; infinite keeps the row hard. Default: 1 each.

    Returns
    -------
    (unit, rows, stop)
        The point, its rows (positive: violated) and why the last search stopped.
    """
    values, _ = guard.rows(np.clip(starts[0], 0, 1), False)
    count = len(values) - 1
    given = tuple(np.ones(count) if weights is None else np.asarray(weights, float))
    best: tuple[float, float, Array, Array] | None = None
    stop: Stop = "converged"
    for start in starts:
        elastic = Elastic(guard.problem, count, given)
        inner = Guard(elastic, guard.deadline)
        rows = guard.rows(np.clip(start, 0, 1), False)[0][1:]
        over = _over(rows, guard.problem.equalities)
        stop = slsqp(inner, np.concatenate([start, np.clip(over[elastic.soft] * 1.01 / LIMIT, 0, 1)]), evaluations)
        if inner.unit is None:
            continue
        unit = inner.unit[: guard.problem.n]
        rows = guard.rows(unit, False)[0][1:]
        over = _over(rows, guard.problem.equalities)
        soft = np.isfinite(given)
        cost = float(over[soft] @ np.asarray(given)[soft])
        hard = float(over[~soft].max(initial=0.0))
        key = (round(hard, 7), cost)
        if best is None or key < best[:2]:
            best = (*key, unit, rows)
        if hard <= 1e-9 and cost <= 1e-10:
            break
    if best is None:
        unit = np.clip(np.asarray(starts[0], float), 0, 1)
        return unit, guard.rows(unit, False)[0][1:], stop
    return best[2], best[3], stop


def _over(rows: Array, equalities: int) -> Array:
    split = len(rows) - equalities
    return np.concatenate([np.maximum(rows[:split], 0.0), np.abs(rows[split:])])
