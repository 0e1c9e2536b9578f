"""Microlens images: shapes of the whole array and exact pixel coverage of the whole sensor, beside plain numpy."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from roslf_design.microlens.coverage import coverage_image
from roslf_design.microlens.discs import DiscIntersection
from roslf_design.microlens.images import microlens_images, stop_images
from roslf_design.microlens.lattice import Lattice, lens_centres

Array = NDArray[np.float64]

P1 = {"focal_length": 100.0, "focal_plane": 350.0, "mla_distance": 140.0, "sensor_distance": 2.0}
PIXEL, SIZE = 4.847826e-3, (4600, 3080)
FAP_AND_LENS = ([2.9, 50.8], [120.0, 0.0], (0.0, 0.0))
CUT = ([2.9, 2.9], [120.0, 119.0], [(0.0, 0.0), (0.6, 0.3)])
"""A second rim behind the FAP, off centre, that cuts every microlens image."""
CHUNK = 2000


def main() -> None:
    """Print measured times."""
    axes = lens_centres(Lattice(0.063, (23.0, 14.932)))
    print(
        f"P1: {len(axes)} microlenses, sensor {SIZE[0]} x {SIZE[1]} px of {PIXEL * 1e3:.3f} um, one thread unless said"
    )
    _shapes(axes)
    _pixels(axes)


def _shapes(axes: Array) -> None:
    for name, stops in (("P1, none cut", FAP_AND_LENS), ("every image cut", CUT)):
        plain = _numpy_area(*stop_images(axes, *stops, **P1))
        worst = np.abs(microlens_images(axes, *stops, **P1).area / plain - 1).max()
        assert worst < 1e-7, worst  # arc cosines lose half the digits near a seam

        def run(stops: tuple[object, ...] = stops) -> DiscIntersection:
            return microlens_images(axes, *stops, **P1)  # type: ignore[arg-type]

        _report(f"shapes, discs included; {name}", run, 1e3, "ms", 9)
        _report(
            "  numpy, arc cosines, area only",
            lambda stops=stops: _numpy_area(*stop_images(axes, *stops, **P1)),  # type: ignore[misc]
            1e3,
            "ms",
            5,
        )


def _pixels(axes: Array) -> None:
    pixels = SIZE[0] * SIZE[1]
    image = np.zeros(SIZE[::-1], np.float32)
    cases = (
        ("FAP alone", tuple(part[:1] if isinstance(part, list) else part for part in FAP_AND_LENS)),
        ("clipped by the main lens (P1, none cut)", FAP_AND_LENS),
        ("every image cut", CUT),
    )
    for name, stops in cases:
        centres, radii = (np.ascontiguousarray(v) for v in stop_images(axes, *stops, **P1))
        inside = np.all(np.abs(axes) < np.array(SIZE) * PIXEL / 2 - 0.1, axis=1)
        _check(axes[inside][:3000], centres[inside][:3000], radii[inside][:3000])

        def run(parallel: bool = False, centres: Array = centres, radii: Array = radii) -> object:
            return coverage_image(axes, centres, radii, pixel=PIXEL, size=SIZE, out=image, parallel=parallel)

        _report(f"coverage; {name}", run, 1e9 / pixels, "ns/px", 15)
        _report("  all threads", lambda run=run: run(True), 1e9 / pixels, "ns/px", 9)  # type: ignore[misc]
        few = axes[::20], centres[::20], radii[::20]
        if radii.shape[1] == 1 or name.endswith("none cut)"):
            _report("  numpy, exact", lambda few=few: _numpy_discs(*few), 20e9 / pixels, "ns/px", 3)  # type: ignore[misc]
        else:
            _report("  numpy, 16 slices a pixel", lambda few=few: _numpy_slices(*few), 20e9 / pixels, "ns/px", 3)  # type: ignore[misc]


def _check(axes: Array, centres: Array, radii: Array) -> None:
    """The same image both ways before anything is timed."""
    ours = coverage_image(axes, centres, radii, pixel=PIXEL, size=SIZE)
    area = _numpy_area(centres, radii) if radii.shape[1] == 2 else np.pi * radii[:, 0] ** 2
    assert abs(ours.sum() * PIXEL**2 / area.sum() - 1) < 1e-9, (ours.sum() * PIXEL**2, area.sum())
    whole = np.allclose(area, np.pi * radii[:, 0] ** 2, rtol=1e-12)
    plain = _numpy_discs(axes, centres, radii) if whole else _numpy_slices(axes, centres, radii)
    worst = np.abs(ours - plain).max()
    assert worst < (1e-10 if whole else 1 / 16), worst


def _numpy_area(centres: Array, radii: Array) -> Array:
    """Area common to two discs, as in a textbook."""
    d = np.hypot(*np.moveaxis(centres[..., 1, :] - centres[..., 0, :], -1, 0))
    r, R = radii[..., 0], radii[..., 1]
    inner = np.pi * np.minimum(r, R) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        a = np.arccos(np.clip((d * d + r * r - R * R) / (2 * d * r), -1, 1))
        b = np.arccos(np.clip((d * d + R * R - r * r) / (2 * d * R), -1, 1))
    lens = r * r * (a - np.sin(2 * a) / 2) + R * R * (b - np.sin(2 * b) / 2)
    return np.where(d >= r + R, 0.0, np.where(d <= np.abs(r - R), inner, lens))


def _grid(axes: Array, centres: Array, radii: Array) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64], int]:
    """Centres in pixels and the block of pixels around each first disc."""
    at = (axes + centres[:, 0]) / PIXEL + np.array(SIZE) / 2
    r = radii[:, 0] / PIXEL
    low = np.floor(at - r[:, None]).astype(np.int64)
    return at, r, low[:, 0], low[:, 1], int(np.ceil(2 * r.max())) + 1


def _numpy_discs(axes: Array, centres: Array, radii: Array) -> Array:
    """Exact coverage of whole discs: the area left of and below each corner of the grid, differenced twice."""
    image = np.zeros(SIZE[::-1])
    at, radius, left, low, n = _grid(axes, centres, radii)
    for k in range(0, len(at), CHUNK):
        part = slice(k, k + CHUNK)
        r = radius[part, None]
        x = np.clip(left[part, None] + np.arange(n + 1) - at[part, :1], -r, r)
        y = np.clip(low[part, None] + np.arange(n + 1) - at[part, 1:], -r, r)
        c = np.sqrt(r * r - y * y)

        def under(u: Array, r: Array) -> Array:
            return np.asarray(
                0.5 * (u * np.sqrt(np.maximum(r * r - u * u, 0)) + r * r * np.arcsin(np.clip(u / r, -1, 1)))
            )

        x, y, c, r = x[:, None, :], y[:, :, None], c[:, :, None], r[:, :, None]
        half = under(x, r) + 0.25 * np.pi * r * r
        within = np.clip(x, -c, c)
        strip = under(within, r) - under(-c, r)
        below = np.where(y >= 0, 2 * half - strip + y * (within + c), strip + y * (within + c))
        below = np.where(y >= 0, below, np.where(x <= -c, 0.0, below))
        shares = np.diff(np.diff(below, axis=1), axis=2)
        _put(image, shares, low[part], left[part])
    return image


def _numpy_slices(axes: Array, centres: Array, radii: Array) -> Array:
    """Coverage of two discs' common part by 16 slices a pixel, each of exact height."""
    image = np.zeros(SIZE[::-1])
    at, _, left, low, n = _grid(axes, centres, radii)
    for k in range(0, len(at), CHUNK):
        part = slice(k, k + CHUNK)
        x = left[part, None] + (np.arange(16 * n) + 0.5) / 16
        top, bottom = np.full(x.shape, np.inf), np.full(x.shape, -np.inf)
        for disc in range(radii.shape[1]):
            middle = at[part] + (centres[part, disc] - centres[part, 0]) / PIXEL
            half = np.sqrt(np.maximum((radii[part, disc, None] / PIXEL) ** 2 - (x - middle[:, :1]) ** 2, 0))
            top, bottom = np.minimum(top, middle[:, 1:] + half), np.maximum(bottom, middle[:, 1:] - half)
        row = (low[part, None] + np.arange(n))[:, :, None]
        height = np.minimum(top[:, None], row + 1) - np.maximum(bottom[:, None], row)
        shares = np.maximum(height, 0).reshape(len(x), n, n, 16).mean(axis=3)
        _put(image, shares, low[part], left[part])
    return image


def _put(image: Array, shares: Array, low: NDArray[np.int64], left: NDArray[np.int64]) -> None:
    n = shares.shape[1]
    rows, columns = low[:, None, None] + np.arange(n)[:, None], left[:, None, None] + np.arange(n)
    rows, columns = np.broadcast_arrays(rows, columns)
    on = (rows >= 0) & (rows < image.shape[0]) & (columns >= 0) & (columns < image.shape[1])
    np.add.at(image, (rows[on], columns[on]), shares[on])


def _report(name: str, run: Callable[[], object], scale: float, unit: str, repeats: int) -> None:
    """Time of one call: least of this thread's own (what a quiet machine takes), least and median by the clock."""
    run()
    own, clock = [], []
    for _ in range(repeats):
        start, own_start = time.perf_counter(), time.thread_time()
        run()
        clock.append((time.perf_counter() - start) * scale)
        own.append((time.thread_time() - own_start) * scale)
    times = (
        f"{min(own):8.2f} {unit} of its thread; by the clock {min(clock):8.2f} least, {statistics.median(clock):8.2f}"
    )
    print(f"{name:<52} {times} median", flush=True)


if __name__ == "__main__":
    main()
