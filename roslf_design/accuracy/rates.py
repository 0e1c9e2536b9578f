"""Convergence rates, fitted to errors over many jobs so that luck averages out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from .jobs import Job
from .methods import Method
from .references import reference

ROUNDING = 3e-14
"""Errors below this are rounding, and left out of fits."""


class Rate(NamedTuple):
    """How errors fall with effort."""

    power: float
    """p of ``error ~ N^p``, N being samples."""
    per_node: float
    """r of ``error ~ exp(r n)``, n being the level."""
    levels: tuple[int, ...]
    errors: tuple[float, ...]
    """Root mean squares over jobs and seeds."""


def fitted_rate(method: Method, jobs: Iterable[Job], levels: Sequence[int], seeds: Iterable[int] = (0,)) -> Rate:
    """Fit both laws to a method's errors.

    Parameters
    ----------
    method : Method
    jobs : iterable of Job
        Of the method's quantity.
    levels : sequence of int
        Rising.
    seeds : iterable of int
    """
    many, tries = list(jobs), list(seeds)
    errors = []
    for level in levels:
        found = [job.error(method.compute(job, level, seed), reference(job)) for job in many for seed in tries]
        errors.append(float(np.sqrt(np.mean(np.square(found)))))
    used = [n for n, error in enumerate(errors) if error > ROUNDING]
    logs = np.log([errors[n] for n in used])
    effort = np.array([levels[n] for n in used], float)
    samples = effort**2 if method.kind == "grid" else effort
    power = float(np.polyfit(np.log(samples), logs, 1)[0])
    return Rate(power, float(np.polyfit(effort, logs, 1)[0]), tuple(levels), tuple(errors))
