"""Calibration: microlens centres against known truth, decoding, the joint fit and the posterior."""

from __future__ import annotations

import functools
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roslf_design.calibration.calibrate import calibrate, corner_statistics, fit_statistics
from roslf_design.calibration.centres import MicrolensCentres, find_centres
from roslf_design.calibration.datasheet import DataSheet
from roslf_design.calibration.decoding import decode
from roslf_design.calibration.lattice import CentreLattice, Layout
from roslf_design.calibration.model import Intrinsics
from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations
from roslf_design.calibration.posterior import sample_posterior
from roslf_design.microlens.coverage import coverage_image

Array = NDArray[np.float64]
PITCH, ROTATION, FILL, NOISE = 14.07, math.radians(0.31), 0.95, 0.01
CUT_RADIUS, CUT_SHIFT = 0.62, 5.0
"""Second disc: radius in pitches, displacement at the corner [px]."""
CAMERA = Intrinsics(92.0, 0.4, 0.5, 182.0, 118.0, q=0.004847826, d=0.063)
SHEET = DataSheet(100.0, CAMERA.q, CAMERA.d, 1.0, d_sigma=6.3e-5, cell_sigma=1e-3)


def main() -> None:
    """Print measured errors and times."""
    _centres()
    _decode()
    _fits()
    _posterior()


def _centres() -> None:
    print("microlens centres, 1 % noise: RMS error of the fitted centres per axis (goals 0.002 clean, 0.05 cut, 6 s)")
    for shape in ((1000, 1000), (3000, 4000)):
        for layout in ("square", "hexagonal"):
            for cut in (False, True):
                image, truth = _white(shape, layout, cut)
                seconds, found = _timed(functools.partial(find_centres, image), 3)
                error = _error(found, truth)
                print(
                    f"  {shape[0] * shape[1] / 1e6:4.0f} Mpx {layout:10s} {'cut  ' if cut else 'clean'} {error:.5f} px"
                    f"   {seconds:5.2f} s   {int(found.used.sum())} of {len(found.indices)} lenses used"
                )


def _white(shape: tuple[int, int], layout: Layout, cut: bool) -> tuple[NDArray[np.float32], CentreLattice]:
    """White image by exact pixel coverage; lattice in pixels, the first pixel's centre at 0."""
    rows, columns = shape
    turn = ROTATION + (math.pi / 2 if layout == "square" else math.pi / 3)
    first = PITCH * math.cos(ROTATION), PITCH * math.sin(ROTATION)
    second = PITCH * math.cos(turn), PITCH * math.sin(turn)
    truth = CentreLattice((columns / 2 + 0.83, rows / 2 - 0.41), first, second, layout)
    index = truth.inside(shape, margin=-PITCH)
    centres = truth.nodes(index[:, 0], index[:, 1])
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    shift = (centres - middle) / np.hypot(*middle) * CUT_SHIFT
    discs = np.stack([np.zeros_like(shift), shift], axis=1)[:, : 2 if cut else 1]
    radii = np.broadcast_to([FILL * PITCH / 2, CUT_RADIUS * PITCH][: 2 if cut else 1], discs.shape[:2])
    axes = centres - middle  # the engine counts millimetres from the sensor's middle: here one a pixel
    image = coverage_image(axes, discs, radii, pixel=1.0, size=(columns, rows), dtype=np.float32, parallel=True)
    noise = np.random.default_rng(0).normal(0, NOISE, shape).astype(np.float32)
    return np.asarray(image + noise, np.float32), truth


def _error(found: MicrolensCentres, truth: CentreLattice) -> float:
    index = np.round(truth.indices(found.centres))
    return float(np.sqrt(np.mean((found.centres - truth.nodes(index[:, 0], index[:, 1])) ** 2)))


def _decode() -> None:
    image, truth = _white((3000, 4000), "square", False)
    seconds, field = _timed(lambda: decode(image, truth, white=np.abs(image) + 1), 3)
    print(f"decode 12 Mpx with its white image: {seconds:.2f} s ({field.values.size / 1e6:.1f} M samples)")


def _fits() -> None:
    captures = Captures(boards=12, views=7)
    rng = np.random.default_rng(0)
    observations = synthetic_observations(CAMERA, random_poses(captures, 120.0, rng), captures, rng)
    seconds, found = _timed(lambda: calibrate(observations, SHEET), 5)
    print(
        f"calibration, 12 boards in {len(observations.views)} views, {observations.count} coordinates: {seconds:.3f} s"
    )
    data = corner_statistics(observations, found.lines.sigma)
    names = found.fit.covariance.names
    seconds, _ = _timed(lambda: fit_statistics(data, found.joint.camera, found.joint.poses, names), 9)
    print(f"  of that the fit on corner statistics: {1e3 * seconds:.1f} ms")


def _posterior() -> None:
    captures = Captures(boards=12, views=5)
    rng = np.random.default_rng(0)
    observations = synthetic_observations(CAMERA, random_poses(captures, 120.0, rng), captures, rng)
    fit = calibrate(observations, SHEET).fit
    sample_posterior(fit, SHEET, seed=0, chunk=10, most_steps=10)
    start = time.perf_counter()
    found = sample_posterior(fit, SHEET, seed=1)
    seconds = time.perf_counter() - start
    least = min(min(found.bulk_ess.values()), min(found.tail_ess.values()))
    print(f"posterior of 12 boards: {found.steps} steps of {found.walkers} walkers; {found.message}")
    print(f"  {seconds:5.2f} s, {least / seconds:4.0f} effective samples/s (least of bulk and tail)")
    print("  goal: converged in under 60 s")


def _timed(run: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    run()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = run()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), result


if __name__ == "__main__":
    main()
