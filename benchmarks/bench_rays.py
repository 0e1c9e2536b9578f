"""Backward rays through stop, main lens and microlens, beside plain numpy; ray budgets."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from roslf_design.rays import Array, Lens, Sensor, Status, Stop, System, ray_budget
from roslf_design.rays.backward import Ends, compiled_ends, ends

Floats = NDArray[np.float64]

GOAL = 120.0
"""Millions of aligned rays a second, two threads."""
PAPER = System(Lens(100.0, 50.8), (Stop(2.9, 120.0),), Array(140.0, 2.0, 0.063), Sensor(2.0))
DISTANCE = 350.0
BLOCK = 4096
"""Rays that plain numpy does at once, so that its temporaries stay in cache."""


def plain_numpy(
    p: Floats, c: tuple[float, float], v: Floats | None, status: NDArray[np.uint8], x: Floats, y: Floats
) -> None:
    """Trace an aligned camera as one would by hand: whole blocks, buffers reused, one thread."""
    lens, stop, array, sensor = PAPER.lens, PAPER.stops[0], PAPER.array, PAPER.sensor
    f, d_1, d_2, f_ml = lens.focal_length, array.distance, sensor.distance, array.focal_length
    height, slope, at_stop, spare = np.empty((4, 2, BLOCK))
    for start in range(0, status.size, BLOCK):
        out = slice(start, min(start + BLOCK, status.size))
        n = out.stop - start
        for axis, end in enumerate((x, y)):
            s, h, a, w = slope[axis, :n], height[axis, :n], at_stop[axis, :n], spare[axis, :n]
            np.subtract(p[axis, out], c[axis], out=s)
            if v is None:
                s /= d_2
                np.multiply(s, -d_1, out=h)
            else:
                s -= v[axis, out]
                s /= d_2
                np.divide(v[axis, out], f_ml, out=w)
                s += w
                np.multiply(s, -d_1, out=h)
                h += v[axis, out]
            h += c[axis]
            np.divide(h, f, out=w)
            s += w
            np.multiply(s, -stop.distance, out=a)
            a += h
            np.multiply(s, -DISTANCE, out=end[out])
            end[out] += h
        fate = status[out]
        fate[:] = Status.KEPT
        if v is not None:
            half = array.pitch / 2
            fate[(np.abs(v[0, out]) > half) | (np.abs(v[1, out]) > half)] = Status.MICROLENS
        for miss, radius, code in (
            (height, lens.diameter / 2, Status.MAIN_LENS),
            (at_stop, stop.diameter / 2, Status.APERTURE),
        ):
            near = miss[:, :n]
            np.multiply(near, near, out=near)
            near[0] += near[1]
            fate[near[0] > radius * radius] = code


def rate(run: Callable[[], object], count: int, repeats: int) -> tuple[float, float]:
    """Median and best rate of `run`, in millions a second, after a first run."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return count / statistics.median(times) / 1e6, count / min(times) / 1e6


def report(name: str, figures: tuple[float, float], note: str = "") -> None:
    print(f"{name:<58} {figures[0]:7.1f} (best {figures[1]:6.1f}) million rays/s{note}")


def main(count: int = 10_000_000, repeats: int = 9) -> None:
    """Print medians; results are compared before anything is timed."""
    import numba

    rng = np.random.default_rng(1)
    c = (11.15, 3.0)
    p = rng.uniform(-0.05, 0.05, (2, count)) + np.array(c)[:, None] * (1 - 0.0043478)
    v = rng.uniform(-0.033, 0.033, (2, count))
    status, x, y = np.empty(count, np.uint8), np.empty(count), np.empty(count)
    out = Ends(np.empty(count, np.uint8), np.empty(count), np.empty(count))
    print(f"{count} rays, {numba.get_num_threads()} threads; status and end points written; medians of {repeats} runs")
    for label, offset in (("pinhole microlens", None), ("point on the microlens varied", v)):
        through: tuple[Floats | float, Floats | float] = (0.0, 0.0) if offset is None else (offset[0], offset[1])
        got = compiled_ends(PAPER, (p[0], p[1]), c, through, distance=DISTANCE)
        plain_numpy(p, c, offset, status, x, y)
        assert np.sum(got.status != status) <= 3  # but for rays within rounding of a rim
        np.testing.assert_allclose(got.x, x, rtol=0, atol=1e-11)
        np.testing.assert_allclose(got.y, y, rtol=0, atol=1e-11)
        plain = partial(plain_numpy, p, c, offset, status, x, y)
        report(f"plain numpy, blocks, one thread; {label}", rate(plain, count, repeats))
        compiled = partial(compiled_ends, PAPER, (p[0], p[1]), c, through, distance=DISTANCE, out=out)
        report(f"compiled, aligned; {label}", rate(compiled, count, repeats), f"   goal {GOAL:.0f}")
    tilted = replace(PAPER, sensor=replace(PAPER.sensor, tilt=(1e-3, 0.0)), lens=replace(PAPER.lens, tilt=(0.0, 0.01)))
    part = slice(0, count // 10)
    few = ends(tilted, (p[0, part], p[1, part]), c, distance=DISTANCE)
    for a, b in zip(few, compiled_ends(tilted, (p[0, part], p[1, part]), c, distance=DISTANCE), strict=True):
        np.testing.assert_array_equal(a, b)
    slow = partial(ends, tilted, (p[0, part], p[1, part]), c, distance=DISTANCE)
    report("numpy, tilted elements", rate(slow, count // 10, repeats))
    fast = partial(compiled_ends, tilted, (p[0], p[1]), c, distance=DISTANCE, out=out)
    report("compiled, tilted elements", rate(fast, count, repeats))
    fields = (np.linspace(-11, 11, 365)[:, None], np.linspace(-7, 7, 10))
    budgets = [ray_budget(PAPER, fields, rays=500, compiled=way) for way in (False, True)]
    assert budgets[0] == budgets[1]
    for name, way in (("numpy", False), ("compiled", True)):
        report(f"ray budgets, {name}", rate(partial(ray_budget, PAPER, fields, rays=500, compiled=way), 3650 * 500, 3))


if __name__ == "__main__":
    main()
