"""Time and memory against size, each size in a process of its own."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .comparison import SIDES
from .process import SideError, Worker
from .samples import slope

SHORT = 2.0
"""Runs shorter than this [s] are repeated."""
LONG = 20.0
"""Of runs longer than this [s] the first counts: what loading takes does not show."""
REPEATS = 3
TAIL = 4
"""Largest sizes that the slope is fitted to: small ones show what a start costs."""


@dataclass(frozen=True)
class Axis:
    """One way of growing."""

    name: str
    title: str
    unit: str
    work: str
    sizes: tuple[float, ...]
    threads: int = 2
    options: dict[str, Any] = field(default_factory=dict)
    bytes_each: float | None = None
    """Memory read and written, at least, for one of it."""
    note: str = ""
    limit: float = 60.0
    """Sizes that would take longer [s] are not run but extrapolated, and said to be."""


def measure(axis: Axis, tell: Callable[[str], None] = lambda text: None) -> dict[str, Any]:
    """Time and memory of every size, JSON-ready."""
    points: list[dict[str, Any]] = []
    for size in axis.sizes:
        tell(f"scaling, {axis.title}: {size:g}")
        expected = _expected(points, size)
        if expected is not None and expected > axis.limit:
            points.append({"size": size, "seconds": expected, "measured": False, "runs": 0, "peak_mib": None})
            continue
        try:
            points.append(_point(axis, size))
        except SideError as error:
            points.append({"size": size, "seconds": None, "measured": False, "runs": 0, "reason": str(error)})
    done = [point for point in points if point["measured"]]
    fitted: tuple[float, float] | None = None
    tail = done[-TAIL:]
    if len(tail) >= 2:
        fitted = slope([point["size"] for point in tail], [point["seconds"] for point in tail])
    return {
        "name": axis.name,
        "title": axis.title,
        "unit": axis.unit,
        "threads": axis.threads,
        "bytes_each": axis.bytes_each,
        "note": axis.note,
        "points": points,
        "slope": None if fitted is None else {"value": fitted[0], "error": fitted[1], "over": len(tail)},
    }


def _expected(points: Sequence[dict[str, Any]], size: float) -> float | None:
    """Time in proportion to the largest size measured [s]."""
    done = [point for point in points if point["measured"]]
    return done[-1]["seconds"] * size / done[-1]["size"] if done else None


def _point(axis: Axis, size: float) -> dict[str, Any]:
    worker = Worker(Path(sys.executable), axis.threads)
    try:
        worker.prepare(SIDES / "scaling_side.py", axis.work, None, {**axis.options, "size": size})
        timings = [worker.run()]
        if timings[0].seconds < LONG:  # the first loads compiled code and does not count
            timings = [worker.run()]
            while timings[-1].seconds < SHORT and len(timings) < REPEATS:
                timings.append(worker.run())
        seconds = statistics.median(timing.seconds for timing in timings)
        peak = max(timing.peak_mib for timing in timings)
    finally:
        worker.close()
    return {"size": size, "seconds": seconds, "measured": True, "runs": len(timings), "peak_mib": round(peak, 1)}


def axes(quick: bool) -> list[Axis]:
    """Everything that is scaled."""
    trials = (1e3, 1e4, 1e5) if quick else (1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
    pixels = (1e6, 4e6) if quick else (1e6, 4e6, 14e6, 30e6, 60e6)
    steps = 20 if quick else 200
    return [
        Axis(
            "trials",
            "Tolerance trials, whole studies in two processes",
            "trials",
            "trials",
            trials,
            threads=1,
            options={"workers": 2},
            note="15 perturbations, 5 metrics at 5 fields, closed forms; start of the processes and files included.",
            limit=100.0,
        ),
        Axis("pixels", "White image with diffraction", "pixels", "pixels", pixels, bytes_each=4.0),
        Axis(
            "posterior",
            f"{steps} steps of 4 x 48 walkers of the posterior",
            "parameters",
            "posterior",
            (4.0, 5.0, 6.0, 7.0),
            threads=1,
            options={"steps": steps},
            note="12 boards in 5 views; the focal length is one of the parameters.",
        ),
    ]
