"""Between a problem and nlopt: no NaN goes in, no fault escapes, and the best point seen is never lost.

nlopt passes views of its own memory, stops without a point on round-off, and some of its algorithms die of NaN. Every
evaluation therefore goes through one guard, which copies, maps, counts and remembers.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .gradients import value_and_jacobian

Array = NDArray[np.float64]

BIG = 1e6
"""What stands for a value that is not finite: far beyond any merit or row of a camera."""

FEASIBLE = 1e-9
"""Largest violation of a scaled row that counts as none: 1e-9 of a limit."""


class Smooth(Protocol):
    """What an optimiser can work on, over the unit box."""

    @property
    def n(self) -> int:
        """How many variables."""

    @property
    def equalities(self) -> int:
        """How many of the last rows must be 0; the others must not be above 0."""

    def vector(self, units: Array) -> Array:
        """Merit and rows, shape (1 + rows, N), at points of shape (N, n)."""


@dataclass
class Guard:
    """Evaluations of a problem, watched."""

    problem: Smooth
    deadline: float = float("inf")
    """On the monotonic clock [s]."""
    evaluations: int = 0
    """Points asked for by the optimiser; those for derivatives are not counted."""
    mapped: int = 0
    """Evaluations with a value that was not finite."""
    faults: int = 0
    """Evaluations that raised."""
    fault: str = ""
    """What the first of them said."""
    unit: Array | None = None
    """Best point so far: the best feasible or, before there is one, the least violating."""
    merit: float = float("inf")
    violation: float = float("inf")
    _last: tuple[bytes, Array, Array | None] | None = field(default=None, repr=False)

    def rows(self, unit: Array, derivatives: bool) -> tuple[Array, Array]:
        """Merit and rows, all finite, and their derivatives (zeros where not asked for)."""
        key = unit.tobytes()
        if self._last is not None and self._last[0] == key and (self._last[2] is not None or not derivatives):
            jacobian = self._last[2]
            return self._last[1], np.zeros((len(self._last[1]), len(unit))) if jacobian is None else jacobian
        own = np.clip(np.array(unit, dtype=np.float64), 0.0, 1.0)  # a copy: nlopt reuses its memory
        if self._last is None or self._last[0] != key:
            self.evaluations += 1
        values, jacobian = self._evaluate(own, derivatives)
        if not np.isfinite(values).all():
            self.mapped += 1
            values = np.where(np.isnan(values), BIG, np.clip(values, -BIG, BIG))
        else:
            self._remember(own, values)
        if jacobian is not None:
            jacobian = np.where(np.isfinite(jacobian), np.clip(jacobian, -BIG, BIG), 0.0)
        self._last = (key, values, jacobian)
        return values, np.zeros((len(values), len(own))) if jacobian is None else jacobian

    def _evaluate(self, unit: Array, derivatives: bool) -> tuple[Array, Array | None]:
        try:
            if derivatives:
                return value_and_jacobian(self.problem.vector, unit)
            return self.problem.vector(unit[None])[:, 0], None
        except (ArithmeticError, ValueError) as error:
            # A formula that refuses a camera tells that there is none; the search goes on elsewhere.
            self.faults += 1
            self.fault = self.fault or str(error)
            rows = self._last[1].size if self._last is not None else None
            if rows is None:
                rows = self._count()
            return np.full(rows, np.nan), None

    def _count(self) -> int:
        """How many rows there are, from a problem that may refuse points."""
        for place in (0.5, 0.25, 0.75, 0.1, 0.9):
            try:
                return len(self.problem.vector(np.full((1, self.problem.n), place)))
            except (ArithmeticError, ValueError):
                continue
        raise ValueError(f"the problem cannot be evaluated anywhere: {self.fault}")

    def _remember(self, unit: Array, values: Array) -> None:
        violation = violation_of(values[1:], self.problem.equalities)
        better = violation < self.violation
        if violation <= FEASIBLE:
            better = self.violation > FEASIBLE or values[0] < self.merit
        if better:
            self.unit, self.merit, self.violation = unit, float(values[0]), violation

    @property
    def feasible(self) -> bool:
        """Whether the best point holds every row."""
        return self.violation <= FEASIBLE

    @property
    def seconds_left(self) -> float:
        """Until the deadline."""
        return self.deadline - time.monotonic()


def violation_of(rows: Array, equalities: int) -> float:
    """Largest violation of the rows (without the merit), 0 where all hold."""
    split = len(rows) - equalities
    above = np.max(rows[:split], initial=0.0)
    return float(max(above, np.max(np.abs(rows[split:]), initial=0.0)))
