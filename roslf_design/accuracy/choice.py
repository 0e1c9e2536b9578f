"""The cheapest method that keeps a promise, and what came of it.

>>> answer = compute(Job("kept fraction", design, (11.15, 0.0)), 1e-3)
>>> answer.value, answer.choice.method, answer.measured_error
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..errors import InputError, Problem
from .jobs import QUANTITIES, Job
from .methods import Method, methods
from .statement import check_accuracy
from .table import Row, Table, current_table

Floats = NDArray[np.float64]

SAFETY = {"random": 2.5, "sobol": 2.5, "grid": 2.0, "panels": 3.0, "adaptive": 3.0, "fft": 2.0, "huygens": 2.0,
          "fit": 6.0}  # fmt: skip
"""How much worse than the worst measured case a method is taken to be; errors of samples scatter, those of
fits grow steeply with field and pupil, exact ones do neither."""

FINEST = 4e-13
"""Accuracy below which rounding rules every method."""

CHECKED = frozenset({"random", "sobol", "grid", "panels", "fft", "huygens"})
"""Kinds whose error can be measured by a second, coarser run."""

CHEAP_CHECK = 0.6
"""A check may take this share of the run's own time."""


@dataclass(frozen=True)
class Choice:
    """A method for a job, before it is run."""

    quantity: str
    accuracy: float
    """What the result may be off by, as `jobs.QUANTITIES` says for each quantity."""
    method: str
    level: int
    expected_error: float
    """At most, as measured on jobs of all kinds, with a margin."""
    expected_seconds: float
    attainable: bool
    """False where no method reaches the accuracy: this is then the most accurate one."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A result with what is known of its error."""

    value: Floats = field(repr=False)
    choice: Choice
    measured_error: float | None
    """From a coarser second run with another seed; None where that costs too much or nothing is sampled."""
    seconds: float
    """Checks and runs that were not good enough included."""
    runs: int
    """1 unless a check said that more was needed."""

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, without the value."""
        return {
            "quantity": self.choice.quantity,
            "accuracy": self.choice.accuracy,
            "method": self.choice.method,
            "level": self.choice.level,
            "expected_error": self.choice.expected_error,
            "measured_error": self.measured_error,
            "attainable": self.choice.attainable,
            "expected_seconds": self.choice.expected_seconds,
            "seconds": self.seconds,
            "runs": self.runs,
        }


def choose(
    quantity: str, accuracy: float, design: Design, axis: tuple[float, float] = (0.0, 0.0), table: Table | None = None
) -> Choice:
    """Cheapest method for a quantity of one microlens; `candidates` ranks all.

    Parameters
    ----------
    quantity : str
        One of `jobs.QUANTITIES`.
    accuracy : float
        What the result may be off by.
    design : Design
    axis : (x, y)
        Microlens, on the array [mm].
    table : Table, optional
        None is the user's own, or the shipped one.

    Raises
    ------
    InputError
        No such quantity, an accuracy out of range.
    """
    if quantity not in QUANTITIES:
        known = ", ".join(QUANTITIES)
        raise InputError((Problem("--quantity", f'no quantity is called "{quantity}"; there are {known}'),))
    return candidates(Job(quantity, design, axis), accuracy, table)[0]


def candidates(job: Job, accuracy: float, table: Table | None = None) -> tuple[Choice, ...]:
    """Methods that keep the promise, cheapest first; where none does, the most accurate one alone."""
    check_accuracy(accuracy)
    found: list[tuple[float, float, Row]] = []
    served = ""
    rows = _known_rows(job.quantity, table or current_table())
    for expected, method, row in rows:
        # Levels rise in cost: of each method the first that is good enough is the cheapest.
        if expected <= accuracy and method.name != served and method.tested_on(job):
            found.append((row.seconds_for(method.work(job, row.level)), expected, row))
            served = method.name
    attainable = bool(found)
    if not attainable:
        best = min(((e, m, r) for e, m, r in rows if m.tested_on(job)), key=lambda one: one[0], default=None)
        if best is None:
            message = f"the accuracy table has nothing on {job.quantity}; make a new one with: roslf accuracy calibrate"
            raise InputError((Problem("accuracy", message),))
        expected, method, row = best
        found = [(row.seconds_for(method.work(job, row.level)), expected, row)]
    found.sort(key=lambda one: one[0])
    return tuple(
        Choice(job.quantity, accuracy, row.method, row.level, expected, seconds, attainable)
        for seconds, expected, row in found
    )


@lru_cache(maxsize=64)
def _known_rows(quantity: str, table: Table) -> tuple[tuple[float, Method, Row], ...]:
    """Rows whose method is known here, with the error to expect."""
    known = {method.name: method for method in methods(quantity)}
    found = []
    for row in table.of(quantity):
        method = known.get(row.method)
        if method is not None and row.level in method.levels:
            expected = max(row.error * SAFETY.get(method.kind, 1.5), FINEST if row.error < FINEST else 0.0)
            found.append((expected, method, row))
    return tuple(found)


def compute(job: Job, accuracy: float, table: Table | None = None, *, seed: int = 0, check: bool = True) -> Answer:
    """Run the cheapest method that keeps the promise, and the next better one where a check says otherwise.

    Parameters
    ----------
    job : Job
    accuracy : float
        What the result may be off by.
    table : Table, optional
        None is the user's own, or the shipped one.
    seed : int
        Of random methods; the same seed gives the same value.
    check : bool
        Measure the error by a coarser second run, where that is cheap.
    """
    start = time.perf_counter()
    table = table or current_table()
    known = {method.name: method for method in methods(job.quantity)}
    runs, wanted = 0, accuracy
    while True:
        runs += 1
        choice = candidates(job, wanted, table)[0]
        method = known[choice.method]
        value = method.compute(job, choice.level, seed)
        measured = _measure(method, job, choice, value, seed, table) if check else None
        if measured is None or measured <= accuracy or not choice.attainable:
            break
        # Worse than the table has it: ask for so much more.
        wanted = max(min(wanted, choice.expected_error) * min(0.5, accuracy / measured), 1e-15)
    kept = choice.expected_error <= accuracy
    choice = replace(choice, accuracy=accuracy, attainable=kept)
    return Answer(value, choice, measured, time.perf_counter() - start, runs)


def _measure(
    method: Method,
    job: Job,
    choice: Choice,
    value: Floats,
    seed: int,
    table: Table,
) -> float | None:
    """Error told by the level below and another seed, scaled down by what the table says of the two levels."""
    place = method.levels.index(choice.level)
    if method.kind not in CHECKED or place == 0:
        return None
    rows = {row.level: row for row in table.of(job.quantity) if row.method == method.name}
    coarse = rows.get(method.levels[place - 1])
    if coarse is None:
        return None
    below, above = coarse.error, rows[choice.level].error
    if coarse.seconds_for(method.work(job, coarse.level)) > CHEAP_CHECK * choice.expected_seconds or not below > 0:
        return None
    other = method.compute(job, coarse.level, seed + 1)
    return job.error(value, other) * above / below
