"""Work-precision points: what each method at each level costs on a job, and how far off it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from .jobs import LENS, Job
from .methods import Method, methods
from .references import reference
from .table import load_kernels, timed
from .wave_methods import WAVES, geometric

SEEDS = 3

REPEATS = 9
"""Runs that each time is the median of, as far as they fit in a quarter of a second."""

SLOWEST = 0.12
"""Levels slower than this are left out of diagrams [s]."""


@dataclass(frozen=True)
class WorkPoint:
    """One method at one level on one job."""

    method: str
    kind: str
    level: int
    error: float
    """Median over seeds."""
    error_range: tuple[float, float]
    """Least and largest over seeds."""
    seconds: float
    """Median."""
    seconds_range: tuple[float, float]
    """Quartiles over runs: what else the machine does comes in now and then."""


@dataclass(frozen=True, eq=False)
class WorkDiagram:
    """All methods on one job."""

    title: str
    job: Job
    points: tuple[WorkPoint, ...]
    floor: float | None
    """What a simpler model leaves out: waves where rays are traced, a real lens where it is thin; or None."""

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "title": self.title,
            "quantity": self.job.quantity,
            "model_error_of_rays": self.floor,
            "points": [
                {
                    "method": point.method,
                    "level": point.level,
                    "error": point.error,
                    "error_range": list(point.error_range),
                    "seconds": point.seconds,
                    "seconds_range": list(point.seconds_range),
                }
                for point in self.points
            ],
        }


def work_diagram(
    title: str, job: Job, *, seed: int = 0, repeats: int = REPEATS, progress: Callable[[str], None] = lambda what: None
) -> WorkDiagram:
    """Measure every method of a job's quantity.

    Parameters
    ----------
    title : str
        What the job shows.
    job : Job
    seed : int
        First of those that random methods are run with.
    repeats : int
        Runs that each time is the median of.
    progress : callable
        Told what is being measured.
    """
    progress(f"{job.quantity}, {title}")
    load_kernels()
    points = [
        point
        for method in methods(job.quantity)
        if method.tested_on(job)
        for point in _points(method, job, seed, repeats)
    ]
    return WorkDiagram(title, job, tuple(points), model_error(job))


def _points(method: Method, job: Job, seed: int, repeats: int) -> list[WorkPoint]:
    truth, found = reference(job), []
    for level in method.levels:
        middle, least, most = timed(method, job, level, repeats)
        if middle > SLOWEST:
            break
        seeds = range(seed, seed + (SEEDS if method.random and middle < 0.2 * SLOWEST else 1))
        errors = [job.error(method.compute(job, level, s), truth) for s in seeds]
        span = (min(errors), max(errors))
        found.append(WorkPoint(method.name, method.kind, level, median(errors), span, middle, (least, most)))
    return found


def model_error(job: Job) -> float | None:
    """Largest difference between the ray image and the wave image of a white scene, neighbours alike."""
    if job.quantity == LENS:
        thin = next(method for method in methods(LENS) if method.name == "thin lens")
        return job.error(thin.compute(job, 0, 0), reference(job))
    if job.quantity not in ("pixel image", "textured image"):
        return None
    alike = Job("diffraction image", job.design)
    waves = next(method for method in WAVES if method.name == "harmonic series").compute(alike, 100, 0)
    return float(np.max(np.abs(geometric(alike) - waves)))
