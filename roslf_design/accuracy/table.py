"""The table of what each method costs and how far off it is: measured, shipped, or the user's own."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ..design import Design
from ..errors import InputError, Problem
from .jobs import QUANTITIES, Job, panel_jobs
from .methods import Method, methods
from .random_jobs import random_job
from .references import reference

SCHEMA = "roslf.accuracy-table/1"
SHIPPED = "default_table.json"

LONGEST = 0.25
"""Levels that take longer than this on the smallest job are not measured, nor ever chosen [s]."""

LEVEL_SECONDS = 0.8
"""Time that one level's errors may take beyond its first jobs."""

FEWEST_JOBS = 4
"""Random jobs that are measured in any case; the panels always are."""

EXTRA_JOBS = 16
"""Random jobs beside the panels."""

REPEATS = 5


@dataclass(frozen=True)
class Row:
    """One method at one level."""

    quantity: str
    method: str
    level: int
    error: float
    """Largest error over all jobs and seeds it was measured on."""
    seconds: float
    """Median time on the first job."""
    work: float
    """Of the first job."""
    fixed: float
    """Part of the time that does not grow with work [s]."""

    def seconds_for(self, work: float) -> float:
        """Time expected for another job."""
        return self.fixed + (self.seconds - self.fixed) * work / self.work


@dataclass(frozen=True, eq=False)
class Table:
    """All rows, and where they were measured."""

    rows: tuple[Row, ...]
    machine: str
    """Python, numpy, processor; empty where unknown."""

    @cached_property
    def _parts(self) -> dict[str, tuple[Row, ...]]:
        return {name: tuple(row for row in self.rows if row.quantity == name) for name in QUANTITIES}

    def of(self, quantity: str) -> tuple[Row, ...]:
        """Rows of one quantity, methods together, levels rising."""
        return self._parts.get(quantity, ())

    def to_json(self) -> str:
        """Text of a table file."""
        rows = [{key: _short(value) for key, value in asdict(row).items()} for row in self.rows]
        lines = ",\n  ".join(json.dumps(row, allow_nan=False) for row in rows)
        head = json.dumps({"schema": SCHEMA, "machine": self.machine})[:-1]
        return f'{head}, "rows": [\n  {lines}\n]}}\n'


def _short(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value


def read_table(path: Path) -> Table:
    """A table file.

    Raises
    ------
    InputError
        Not such a file.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["schema"] != SCHEMA:
            raise ValueError(data["schema"])
        return Table(tuple(Row(**row) for row in data["rows"]), str(data["machine"]))
    except (ValueError, KeyError, TypeError) as error:
        message = f"is no accuracy table ({error}); make a new one with: roslf accuracy calibrate"
        raise InputError((Problem("", message),), str(path)) from None


def cache_file() -> Path:
    """Where the user's own table lies."""
    fallback = os.environ.get("LOCALAPPDATA") or str(Path.home() / ".cache")
    return Path(os.environ.get("XDG_CACHE_HOME") or fallback) / "roslf" / "accuracy.json"


@cache
def current_table() -> Table:
    """The user's own table where there is one, else the shipped one; read once."""
    own = cache_file()
    return read_table(own) if own.is_file() else shipped_table()


@cache
def shipped_table() -> Table:
    """Measured on another machine: errors hold here as well, times only in proportion."""
    return read_table(Path(str(files("roslf_design.accuracy") / SHIPPED)))


def machine() -> str:
    """What times depend on, in a line."""
    return f"Python {platform.python_version()}, numpy {np.__version__}, {platform.machine()}, {os.cpu_count()} cores"


def timed(method: Method, job: Job, level: int, repeats: int = REPEATS) -> tuple[float, float, float]:
    """Median and quartiles of the times of a few runs [s]; the first, which fetches code, does not count."""
    method.compute(job, level, 0)
    found = []
    for n in range(repeats):
        start = time.perf_counter()
        method.compute(job, level, n)
        found.append(time.perf_counter() - start)
        if sum(found) > LONGEST:
            break
    low, high = np.quantile(found, [0.25, 0.75])
    return median(found), float(low), float(high)


def load_kernels() -> None:
    """Have compiled code in memory: times are those of a program at work, not of its first second."""
    from ..lenses.kernels import trace_rays
    from ..microlens._pixels import coverage

    for kernel in (trace_rays, coverage):
        assert kernel.compiled is not None


def calibrate(
    design: Design,
    quantities: Iterable[str] = tuple(QUANTITIES),
    *,
    extra: int = EXTRA_JOBS,
    seed: int = 0,
    progress: Callable[[str], None] = lambda what: None,
) -> Table:
    """Measure every method at every level: errors on jobs of all kinds, times on the first.

    Parameters
    ----------
    design : Design
        To make the jobs from.
    quantities : iterable of str
    extra : int
        Random jobs of each quantity beside the panels.
    seed : int
        Of the jobs and of random methods.
    progress : callable
        Told what is being measured.
    """
    load_kernels()
    rows: list[Row] = []
    for number, quantity in enumerate(quantities):
        rng = np.random.default_rng([seed, number])
        jobs = [*panel_jobs(design, quantity).values()]
        jobs += [random_job(design, quantity, rng) for _ in range(extra)]
        for method in methods(quantity):
            progress(f"{quantity}, {method.name}")
            fewest = sum(method.tested_on(job) for job in jobs[: len(jobs) - extra + FEWEST_JOBS])
            rows += _measured(method, [job for job in jobs if method.tested_on(job)], seed, fewest)
    return Table(tuple(rows), machine())


def _worst(method: Method, jobs: list[Job], level: int, seeds: range, fewest: int) -> float:
    """Largest error over jobs and seeds, as many as there is time for but the first few in any case."""
    spent, worst = 0.0, 0.0
    for n, job in enumerate(jobs):
        truth = reference(job)
        start = time.perf_counter()
        for seed in seeds:
            worst = max(worst, job.error(method.compute(job, level, seed), truth))
        spent += time.perf_counter() - start
        if n + 1 >= fewest and spent > LEVEL_SECONDS:
            break
    return worst


def _measured(method: Method, jobs: list[Job], seed: int, fewest: int) -> list[Row]:
    first = jobs[0]
    rows = []
    for level in method.levels:
        work = method.work(first, level)
        seconds = timed(method, first, level)[0]
        if seconds > LONGEST:
            break
        # The job with most work tells what part of the time grows with it.
        largest = max(jobs, key=lambda job: method.work(job, level))
        more = method.work(largest, level) / work
        fixed = 0.0
        if more > 2:
            grown = timed(method, largest, level, 3)[0]
            fixed = min(max(seconds - max(grown - seconds, 0.0) / (more - 1), 0.0), seconds)
        error = _worst(method, jobs, level, range(seed, seed + (4 if method.random else 1)), fewest)
        rows.append(Row(method.quantity, method.name, level, error, seconds, work, fixed))
    return rows
