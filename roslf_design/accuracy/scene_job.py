"""A user's own scene: rays per pixel against error and time, on a patch of the sensor."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

from ..design import Design
from ..imaging.render import render
from ..imaging.trace import Sampling
from ..scenes import Scene
from .jobs import Job
from .measure import WorkDiagram, WorkPoint

RAYS = (16, 64, 256, 1024)
REFERENCE_RAYS = 8192
WITHOUT = ("-noise", "-microlens_diffraction")
"""Left out: noise is no error of the method, and diffraction only smooths what sampling leaves, so that errors told are
upper bounds."""
PATCH = 32
"""Pixels across the patch."""


@dataclass(frozen=True)
class SceneChoice:
    """Rays per pixel for a scene."""

    accuracy: float
    rays: int
    """0 where the scene's method traces none."""
    method: str
    expected_error: float
    """Largest error of a pixel on the patch, doubled."""
    expected_seconds: float
    """Of tracing the whole sensor."""
    attainable: bool


def scene_diagram(
    design: Design,
    scene: Scene,
    accuracy: float,
    *,
    seed: int = 0,
    axis: tuple[float, float] = (0.0, 0.0),
    progress: Callable[[str], None] = lambda what: None,
) -> tuple[WorkDiagram, SceneChoice]:
    """Render a patch with more and more rays, and choose how many are enough.

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
    SceneChoice
    """
    width, height = design.pixels
    at = [round(a / design.q + n / 2) - PATCH // 2 for a, n in zip(axis, (width, height), strict=True)]
    column, row = (min(max(0, a), max(0, n - PATCH)) for a, n in zip(at, (width, height), strict=True))
    region = (column, row, min(PATCH, width), min(PATCH, height))

    def image(rays: int, seed: int) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float64]], float, str]:
        start = time.perf_counter()
        sampling = Sampling(least=rays, most=rays, tolerance=0.0, seed=seed)
        raw = render(design, scene, region=region, sampling=sampling, overrides=WITHOUT, seed=seed)
        return raw.pixels.astype(float), time.perf_counter() - start, raw.method

    progress("scene, reference")
    truth, _, method = image(REFERENCE_RAYS, seed + 1000)
    sampled = method == "rays"
    points = []
    for rays in RAYS if sampled else (0,):
        progress(f"scene, {rays} rays a pixel")
        runs = [image(max(rays, 16), seed + n) for n in range(3)]
        errors = [float(np.max(np.abs(pixels - truth))) for pixels, _, _ in runs]
        times = [seconds for _, seconds, _ in runs]
        name = "rays (Sobol)" if sampled else "closed form"
        points.append(
            WorkPoint(
                name, "sobol", rays, median(errors), (min(errors), max(errors)), median(times), (min(times), max(times))
            )
        )
    good = [point for point in points if 2 * point.error_range[1] <= accuracy or not sampled]
    best = good[0] if good else points[-1]
    pixels = width * height / (region[2] * region[3])
    diagram = WorkDiagram(scene.name or "scene", Job("scene image", design, axis), tuple(points), None)
    expected = 2 * best.error_range[1]
    return diagram, SceneChoice(accuracy, best.level, method, expected, best.seconds * pixels, bool(good))
