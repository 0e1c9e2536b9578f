"""What each method costs and errs: the table measured, the choice run and tried, error against time."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roslf_design.accuracy.table import QUANTITIES, AccuracyTable, Choice, Row, current_table, ranked
from roslf_design.design import Design
from roslf_design.errors import InputError, Problem
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.lenses.tracer import _trace_slopes
from roslf_design.scenes import Scene
from roslf_design.shapes.coverage import coverage

from . import shapes, waves
from .jobs import LENS, WAVES, Job, panel_jobs, random_job, random_jobs, square_twin, unfit
from .references import reference
from .shapes import Method

Floats = NDArray[np.float64]
Tell = Callable[[str], None]
"""Told what is being measured."""

LONGEST = 0.25
"""Levels that take longer than this on the smallest job are not measured, nor ever chosen [s]."""
LEVEL_SECONDS = 0.8
"""Time that one level's errors may take beyond its first jobs."""
FEWEST_JOBS, EXTRA_JOBS = 4, 16
"""Random jobs beside the panels: measured in any case, and drawn."""
SLOWEST = 0.12
"""Levels slower than this are left out of diagrams [s]."""
SEEDS, REPEATS = 3, 9
"""Of diagrams: seeds of random methods, and runs that each time is the median of."""

CHECKED = frozenset({"random", "sobol", "grid", "panels", "fft", "huygens"})
"""Kinds whose error can be measured by a second, coarser run."""
CHEAP_CHECK = 0.6
"""A check may take this share of the run's own time."""

SCENE_RAYS, REFERENCE_RAYS = (16, 64, 256, 1024), 8192
WITHOUT = ("-noise", "-microlens_diffraction")
"""Left out of a scene: noise is no error of the method, and diffraction only smooths what sampling leaves, so that
errors told are upper bounds."""
PATCH = 32
"""Pixels across the patch of a scene."""


@cache
def methods(quantity: str) -> tuple[Method, ...]:
    """All methods of one quantity."""
    return tuple(method for method in (*shapes.METHODS, *waves.METHODS) if method.quantity == quantity)


def _silent(what: str) -> None:
    """Progress that nobody follows."""


def load_kernels() -> None:
    """Have compiled code in memory: times are those of a program at work, not of its first second."""
    for kernel in (_trace_slopes, coverage):
        assert kernel.compiled is not None


def timed(method: Method, job: Job, level: int, repeats: int = 5) -> tuple[float, float, float]:
    """Median and quartiles of the times of a few runs [s]; the first, which fetches code, does not count."""
    method.compute(job, level, 0)
    times: list[float] = []
    for n in range(repeats):
        start = time.perf_counter()
        method.compute(job, level, n)
        times.append(time.perf_counter() - start)
        if sum(times) > LONGEST:
            break
    low, high = np.quantile(times, [0.25, 0.75])
    return median(times), float(low), float(high)


# --- the table --------------------------------------------------------------------------------------------------------


def calibrate(
    design: Design, quantities: Iterable[str] = tuple(QUANTITIES), *, extra: int = EXTRA_JOBS, seed: int = 0,
    progress: Tell = _silent,
) -> AccuracyTable:  # fmt: skip
    """Measure every method at every level: errors on jobs of all kinds, times on the first.

    Parameters
    ----------
    design : Design
        To make the jobs from; where its microlenses fit no method, square ones stand in.
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
        camera = square_twin(design) if unfit(design, quantity) else design
        if why := unfit(camera, quantity):
            raise InputError((Problem("", f"{quantity} cannot be measured: {why}"),), design.name)
        jobs = [*panel_jobs(camera, quantity).values()]
        jobs += [random_job(camera, quantity, rng) for _ in range(extra)]
        for method in methods(quantity):
            progress(f"{quantity}, {method.name}")
            fewest = sum(method.tested_on(job) for job in jobs[: len(jobs) - extra + FEWEST_JOBS])
            rows += _rows(method, [job for job in jobs if method.tested_on(job)], seed, fewest)
    machine = (
        f"Python {platform.python_version()}, numpy {np.__version__}, {platform.machine()}, {os.cpu_count()} cores"
    )
    return AccuracyTable(tuple(rows), machine)


def _rows(method: Method, jobs: list[Job], seed: int, fewest: int) -> list[Row]:
    rows = []
    for level in method.levels:
        work = method.work(jobs[0], level)
        seconds = timed(method, jobs[0], level)[0]
        if seconds > LONGEST:
            break
        # The job with most work tells what part of the time grows with it.
        largest = max(jobs, key=lambda job: method.work(job, level))
        more, fixed = method.work(largest, level) / work, 0.0
        if more > 2:
            grown = timed(method, largest, level, 3)[0]
            fixed = min(max(seconds - max(grown - seconds, 0.0) / (more - 1), 0.0), seconds)
        error = _worst(method, jobs, level, range(seed, seed + (4 if method.random else 1)), fewest)
        rows.append(Row(method.quantity, method.name, level, error, seconds, work, fixed))
    return rows


def _worst(method: Method, jobs: list[Job], level: int, seeds: range, fewest: int) -> float:
    """Largest error over jobs and seeds, as many as there is time for but the first few in any case."""
    spent, worst = 0.0, 0.0
    for n, job in enumerate(jobs):
        truth = reference(job)
        start = time.perf_counter()
        worst = max(worst, *(job.error(method.compute(job, level, seed), truth) for seed in seeds))
        spent += time.perf_counter() - start
        if n + 1 >= fewest and spent > LEVEL_SECONDS:
            break
    return worst


# --- the choice, run --------------------------------------------------------------------------------------------------


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
        run = {"measured_error": self.measured_error, "seconds": self.seconds, "runs": self.runs}
        return asdict(self.choice) | run


def candidates(job: Job, accuracy: float, table: AccuracyTable | None = None) -> tuple[Choice, ...]:
    """Methods that keep the promise on a job, cheapest first; where none does, the most accurate one alone."""
    known = {method.name: method for method in methods(job.quantity)}
    return ranked(
        job.quantity,
        accuracy,
        table,
        work=lambda row: known[row.method].work(job, row.level),
        able=lambda row: (
            row.method in known and row.level in known[row.method].levels and known[row.method].tested_on(job)
        ),
    )


def compute(
    job: Job, accuracy: float, table: AccuracyTable | None = None, *, seed: int = 0, check: bool = True
) -> Answer:
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
    choice = replace(choice, accuracy=accuracy, attainable=choice.expected_error <= accuracy)
    return Answer(value, choice, measured, time.perf_counter() - start, runs)


def _measure(method: Method, job: Job, choice: Choice, value: Floats, seed: int, table: AccuracyTable) -> float | None:
    """Error told by the level below and another seed, scaled down by what the table says of the two levels."""
    place = method.levels.index(choice.level)
    if method.kind not in CHECKED or place == 0:
        return None
    rows = {row.level: row for row in table.of(job.quantity) if row.method == method.name}
    coarse = rows.get(method.levels[place - 1])
    if coarse is None or not coarse.error > 0:
        return None
    if coarse.seconds_for(method.work(job, coarse.level)) > CHEAP_CHECK * choice.expected_seconds:
        return None
    other = method.compute(job, coarse.level, seed + 1)
    return job.error(value, other) * rows[choice.level].error / coarse.error


# --- is the choice honest? --------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Tried:
    """A random job, run by the choice and judged against its reference."""

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
    design: Design, count: int = 100, *, seed: int = 0, table: AccuracyTable | None = None, times: bool = True,
    progress: Tell = _silent,
) -> tuple[Tried, ...]:  # fmt: skip
    """Run random jobs, each to an accuracy of its own.

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
    tried = []
    for n, (job, accuracy) in enumerate(random_jobs(design, count, seed + 7919)):
        progress(f"job {n + 1} of {count}")
        if times:
            compute(job, accuracy, table, seed=n)  # fetches code, as a user's second call would find it
        answers = [compute(job, accuracy, table, seed=n) for _ in range(3 if times else 1)]
        answer = sorted(answers, key=lambda one: one.seconds)[len(answers) // 2]
        actual = job.error(answer.value, reference(job))
        tried.append(Tried(job, accuracy, answer, actual, _fastest(job, accuracy, n) if times else None))
    return tuple(tried)


def _fastest(job: Job, accuracy: float, seed: int) -> float | None:
    truth, best = reference(job), None
    for method in (method for method in methods(job.quantity) if method.tested_on(job)):
        for level in method.levels:
            times = []
            for _ in range(3):
                start = time.perf_counter()
                value = method.compute(job, level, seed)
                times.append(time.perf_counter() - start)
                if job.error(value, truth) > accuracy:
                    break
            else:
                best = median(times) if best is None else min(best, median(times))
                break
            if times[0] > LONGEST or (best is not None and times[0] > 2 * best):
                break
    return best


# --- error against time -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WorkPoint:
    """One method at one level on one job."""

    method: str
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
            "points": [asdict(point) for point in self.points],
        }


def work_diagram(
    title: str, job: Job, *, seed: int = 0, repeats: int = REPEATS, progress: Tell = _silent
) -> WorkDiagram:  # fmt: skip
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
    truth, points = reference(job), []
    for level in method.levels:
        middle, least, most = timed(method, job, level, repeats)
        if middle > SLOWEST:
            break
        seeds = range(seed, seed + (SEEDS if method.random and middle < 0.2 * SLOWEST else 1))
        errors = [job.error(method.compute(job, level, s), truth) for s in seeds]
        span = (min(errors), max(errors))
        points.append(WorkPoint(method.name, level, median(errors), span, middle, (least, most)))
    return points


def model_error(job: Job) -> float | None:
    """What no effort gets past: a thin lens for a real one; rays for waves, of a white scene, neighbours alike.

    None where nothing is known of it.
    """
    if job.quantity == LENS:
        return job.error(shapes.thin_rays(job), reference(job))
    if job.quantity not in ("pixel image", "textured image") or unfit(job.design, WAVES):
        return None
    alike = Job(WAVES, job.design)
    return float(np.max(np.abs(waves.rays_alike(alike) - waves.harmonic_series(alike))))


def scene_diagram(
    design: Design, scene: Scene, accuracy: float, *, seed: int = 0, axis: tuple[float, float] = (0.0, 0.0),
    progress: Tell = _silent,
) -> tuple[WorkDiagram, Answer, str]:  # fmt: skip
    """Render a patch of a user's own scene with more and more rays, and choose how many are enough.

    Parameters
    ----------
    design : Design
    scene : Scene
    accuracy : float
        What a pixel may be off by; 1 is a fully lit pixel.
    seed : int
    axis : (x, y)
        Middle of the patch, on the sensor [mm].
    progress : callable
        Told what is being measured.

    Returns
    -------
    WorkDiagram
        One point for each number of rays; the reference has `REFERENCE_RAYS` of another seed, so that errors are told
        to about a fifth of themselves, and none below its own.
    Answer
        Without a value. Its level is the rays per pixel, 0 where the scene's method traces none; its expected error the
        largest of a pixel on the patch, doubled; its time that of tracing the whole sensor.
    str
        How the renderer explains the scene: "rays", "coverage", "harmonics" or "convolution".
    """
    width, height = design.pixels
    at = [round(a / design.q + n / 2) - PATCH // 2 for a, n in zip(axis, (width, height), strict=True)]
    column, row = (min(max(0, a), max(0, n - PATCH)) for a, n in zip(at, (width, height), strict=True))
    region = (column, row, min(PATCH, width), min(PATCH, height))

    def image(rays: int, seed: int) -> tuple[Floats, float, str]:
        start = time.perf_counter()
        sampling = RaySampling(least=rays, most=rays, tolerance=0.0, seed=seed)
        raw = render(design, scene, region=region, sampling=sampling, overrides=WITHOUT, seed=seed)
        return raw.pixels.astype(float), time.perf_counter() - start, raw.method

    progress("scene, reference")
    truth, _, method = image(REFERENCE_RAYS, seed + 1000)
    sampled = method == "rays"
    name = "rays (Sobol)" if sampled else "closed form"
    points = []
    for rays in SCENE_RAYS if sampled else (0,):
        progress(f"scene, {rays} rays a pixel")
        runs = [image(max(rays, 16), seed + n) for n in range(3)]
        errors = [float(np.max(np.abs(pixels - truth))) for pixels, _, _ in runs]
        times = [seconds for _, seconds, _ in runs]
        span, quartiles = (min(errors), max(errors)), (min(times), max(times))
        points.append(WorkPoint(name, rays, median(errors), span, median(times), quartiles))
    good = [point for point in points if 2 * point.error_range[1] <= accuracy or not sampled]
    best = good[0] if good else points[-1]
    diagram = WorkDiagram(scene.name or "scene", Job("scene image", design, axis), tuple(points), None)
    seconds = best.seconds * width * height / (region[2] * region[3])
    largest = best.error_range[1]
    choice = Choice("scene image", accuracy, name, best.level, 2 * largest, seconds, bool(good))
    return diagram, Answer(np.zeros(0), choice, largest, seconds, 1), method
