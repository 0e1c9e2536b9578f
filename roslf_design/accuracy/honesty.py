"""Is the choice honest? Random jobs, each with an accuracy, run by the choice and judged against the reference."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

from ..design import Design
from .choice import Answer, compute
from .jobs import Job
from .methods import methods
from .random_jobs import random_jobs
from .references import reference
from .table import LONGEST, Table, load_kernels


@dataclass(frozen=True, eq=False)
class Trial:
    """One job."""

    job: Job
    accuracy: float
    answer: Answer
    actual_error: float
    fastest: float | None
    """Time of the fastest method and level that kept the promise on this very job [s]; None where none did."""

    @property
    def kept(self) -> bool:
        """Whether the promise was kept, or it was said beforehand that it could not be."""
        return self.actual_error <= self.accuracy or not self.answer.choice.attainable

    @property
    def slowdown(self) -> float | None:
        """Time of the choice, checks included, over that of the fastest."""
        return None if self.fastest is None else self.answer.seconds / self.fastest


def try_choice(
    design: Design,
    count: int = 100,
    *,
    seed: int = 0,
    table: Table | None = None,
    times: bool = True,
    progress: Callable[[str], None] = lambda what: None,
) -> tuple[Trial, ...]:
    """Run random jobs.

    Parameters
    ----------
    design : Design
        To make the jobs from.
    count : int
    seed : int
        Of the jobs: another than the table's, or it would be tried on what it was measured on.
    table : Table, optional
        None is the user's own, or the shipped one.
    times : bool
        Also find the fastest method that would have kept each promise.
    progress : callable
        Told how far it is.
    """
    load_kernels()
    found = []
    for n, (job, accuracy) in enumerate(random_jobs(design, count, seed + 7919)):
        progress(f"job {n + 1} of {count}")
        compute(job, accuracy, table, seed=n)  # fetches code, as a user's second call would find it
        answers = [compute(job, accuracy, table, seed=n) for _ in range(3 if times else 1)]
        answer = sorted(answers, key=lambda one: one.seconds)[len(answers) // 2]
        actual = job.error(answer.value, reference(job))
        found.append(Trial(job, accuracy, answer, actual, _fastest(job, accuracy, n) if times else None))
    return tuple(found)


def _fastest(job: Job, accuracy: float, seed: int) -> float | None:
    truth, best = reference(job), None
    for method in methods(job.quantity):
        if not method.tested_on(job):
            continue
        for level in method.levels:
            start = time.perf_counter()
            value = method.compute(job, level, seed)
            seconds = time.perf_counter() - start
            if job.error(value, truth) <= accuracy:
                again = []
                for _ in range(2):
                    start = time.perf_counter()
                    method.compute(job, level, seed)
                    again.append(time.perf_counter() - start)
                seconds = median([seconds, *again])
                best = seconds if best is None else min(best, seconds)
                break
            if seconds > LONGEST or (best is not None and seconds > 2 * best):
                break
    return best
