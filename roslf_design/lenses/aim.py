"""Microlens images of many builds of a camera, from aimed exact rays: where they lie, how large, what is cut.

Everything is traced through every build's own lens. Only the shape of an image is interpolated: by Fourier series
along its rim, by polynomials of the fifth degree where rims cut it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import THREADS
from .build_kernels import aim, land, spots, spots_on_all_threads
from .builds import LensBuilds
from .camera import LensCamera, views
from .images import sensor_of_pupil
from .kernels import BLOCK
from .outline_kernels import DEGREE, cut_images, whole_images

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

RIM = 16
"""Rays along the FAP's rim; the outline's area converges exponentially in them."""
HARMONICS = 6
"""Of a ray's squared height on a surface, along the FAP's rim."""
RINGS = ((0.5, 8), (0.8, 8))
"""Radii and rays of the rings inside, where rims cut."""
TOLERANCE, CORRECTIONS = 1e-11, 12
"""How near the FAP's point rays must come, in its radius, and after how many corrections at most they are given up."""
POWERS = np.array([(a, b) for a in range(DEGREE + 1) for b in range(DEGREE + 1 - a)])
"""Of the polynomials over the FAP's disc."""
_NODES, _WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(10))


class Planes(NamedTuple):
    """Where what is around the lens stands in T builds: origins, axes x and y and normals, in the lens's frame [mm]."""

    array: Array
    """(T, 12)."""
    sensor: Array
    """(T, 12)."""
    rims: Array
    """FAP, then further stops, each with its radius, (T, R, 13)."""


class Aims(NamedTuple):
    """Rays that are wanted, n of them, and how the nominal camera finds them."""

    base: Array
    offset: Array
    """Where on the array, in its own coordinates: base plus offset times half the pitch, (n, 2)."""
    target: Array
    """Where on the FAP, in units of its radius, (n, 2)."""
    start: Array
    """Slopes in the nominal camera, (n, 2); nan where it has no such ray."""
    inverse: Array
    """Inverse of d(target)/d(slope) there, (n, 4)."""


class Aimed(NamedTuple):
    """What became of N jobs of n rays."""

    landed: Array
    """Sensor points, in its own coordinates [mm], (N, n, 2); nan for rays that do not come through."""
    heights: Array
    """Squared heights over those of every surface and further stop, (N, n, S + R - 1); nan likewise."""
    miss: Array
    """What is left between ray and target, in the FAP's radius, (N, n)."""


def pupil_points() -> tuple[Array, Array]:
    """FAP points along its rim, (RIM, 2), and inside it with its middle first, (..., 2), in units of its radius."""
    rings = [radius * _circle(count) for radius, count in RINGS]
    return _circle(RIM), np.concatenate([np.zeros((1, 2)), *rings])


def _circle(count: int) -> Array:
    turns = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(turns), np.sin(turns)], axis=-1)


def aims(camera: LensCamera, base: ArrayLike, target: ArrayLike, there: Array, offset: ArrayLike = (0.0, 0.0)) -> Aims:
    """Find rays in the nominal camera.

    Parameters
    ----------
    camera : LensCamera
        As drawn.
    base, offset, target : array_like, (n, 2) or (2,)
        As `Aims` has them.
    there : ndarray, (n, 2)
        Those places of the array in the camera's own counting (`of_design.microlenses`).
    """
    a = np.broadcast_to(np.asarray(target, float), there.shape)
    fap = camera.fap
    wanted = np.array([fap.x, fap.y]) + fap.diameter / 2 * a
    found = sensor_of_pupil(camera, there, wanted)
    lens_at = camera.array.lifted(there, camera.mla)

    def slopes(p: Array) -> Array:
        run = camera.detector.lifted(p, camera.sensor) - lens_at
        return np.asarray(np.moveaxis(run[:2] / run[2], 0, -1))

    nudge = 1e-3 * float(np.hypot(*np.ptp(found.sensor - there, axis=0))) + 1e-6 * camera.d_2
    start = slopes(found.sensor)
    columns, rates = [], []
    for step in nudge * np.eye(2):
        ends = [found.sensor + sign * step for sign in (1, -1)]
        seen = [views(camera, there, p, clip=False).pupil for p in ends]
        columns.append((seen[0] - seen[1]) / (fap.diameter / 2))
        rates.append(slopes(ends[0]) - slopes(ends[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.stack(rates, axis=-1) @ np.linalg.pinv(np.stack(columns, axis=-1))
    start = np.where(found.ok[:, None], start, np.nan)
    at, aside, goal = (np.broadcast_to(np.asarray(part, float), there.shape).copy() for part in (base, offset, a))
    return Aims(at, aside, goal, start, inverse.reshape(-1, 4))


def aimed(lens: LensBuilds, planes: Planes, half: Array, wanted: Aims, trial: Ints, begin: Ints, rays: int) -> Aimed:
    """Trace rays of N jobs.

    Parameters
    ----------
    lens, planes, half
        T builds; `half` of the microlens pitch [mm], (T,).
    wanted : Aims
        The rays.
    trial, begin : ndarray of int, (N,)
        The build of each job, and its first ray in the list.
    rays : int
        Rays of a job, at most `BLOCK`.
    """
    surfaces, stops = lens.media.shape[1] - 1, planes.rims.shape[1]
    n = len(trial)
    assert rays <= BLOCK
    landed, heights = np.empty((n, rays, 2)), np.empty((n, rays, surfaces + stops - 1))
    miss = np.empty((n, rays))
    aim.compiled(
        trial, begin, lens.table, surfaces, lens.media, planes.array, planes.sensor, planes.rims, half, *wanted,
        TOLERANCE, CORRECTIONS, landed, heights, miss,
    )  # fmt: skip
    lost = ~(miss <= 1e3 * TOLERANCE)
    landed[lost], heights[lost] = np.nan, np.nan
    return Aimed(landed, heights, miss)


class Outlines(NamedTuple):
    """Microlens images of N build-and-field pairs as if nothing cut them, from `RIM` rays each."""

    shape: Array
    """Area, centroid, central second moments (xx, xy, yy) [mm], (N, 6)."""
    peaks: Array
    """Largest squared height of the pencil over that of each rim, (N, S + R - 1): above 1 where it is cut."""
    turns: Array
    """Where on the FAP's rim [rad], likewise."""


def outlines(rim: Aimed) -> Outlines:
    """Areas, moments and largest heights from rays along the FAP's rim."""
    count, rims = rim.landed.shape[0], rim.heights.shape[2]
    found = Outlines(np.empty((count, 6)), np.empty((count, rims)), np.empty((count, rims)))
    points = rim.landed.shape[1]
    waves = np.cos(2 * np.pi * np.arange(points) / points)
    whole_images.compiled(rim.landed, rim.heights, _periodic_slopes(points), waves, HARMONICS, *found)
    return found


def _periodic_slopes(count: int) -> Array:
    """Weights of the derivative of a periodic function from its evenly spaced values, an even number of them."""
    k = np.arange(1, count)
    return np.concatenate([[0.0], 0.5 * (-1.0) ** k / np.tan(np.pi * k / count)])


def cut_shapes(rim: Aimed, inner: Aimed, found: Outlines) -> tuple[Array, Array]:
    """Lit shapes (N, 6) and seen parts of the FAP (N,) of images that rims cut, from rays all over the FAP.

    nan where the lens loses some of those rays altogether.
    """
    outer_points, inner_points = pupil_points()
    places = np.concatenate([inner_points, outer_points])
    fit = np.ascontiguousarray(np.linalg.pinv(np.prod(places[:, None, :] ** POWERS, axis=-1)))
    landed = np.concatenate([inner.landed, rim.landed], axis=1)
    heights = np.concatenate([inner.heights, rim.heights], axis=1)
    shape, share = np.full((len(landed), 6), np.nan), np.full(len(landed), np.nan)
    whole = np.flatnonzero(~np.any(np.isnan(landed[:, :, 0]), axis=1))
    size, part = np.empty((len(whole), 6)), np.empty(len(whole))
    cut_images.compiled(
        landed[whole], heights[whole], found.peaks[whole], found.turns[whole], places, fit, _NODES + 0.5, _WEIGHTS,
        size, part,
    )  # fmt: skip
    shape[whole], share[whole] = size, part
    return shape, share


def landings(lens: LensBuilds, planes: Planes, world: Array, point: ArrayLike, pupil: ArrayLike) -> Array:
    """Where rays from object points through FAP points meet the array, then the sensor, in their own coordinates.

    Parameters
    ----------
    lens, planes
        T builds.
    world : ndarray, (T, 3)
        What the object points' frame is shifted by against the lens's [mm].
    point : array_like, (n, 3)
        [mm].
    pupil : array_like, (n, 2)
        In units of the FAP's radius.

    Returns
    -------
    ndarray
        Points (T, n, 4) [mm], nan for a ray that does not come through; rims stop none.
    """
    x, a = np.ascontiguousarray(point, float), np.ascontiguousarray(pupil, float)
    trials, n = len(world), len(x)
    landed, lost = np.empty((trials, n, 4)), np.empty((trials, n), bool)
    count = lens.media.shape[1] - 1
    land.compiled(lens.table, count, lens.media, planes.array, planes.sensor, planes.rims, world, x, a, landed, lost)
    landed[lost] = np.nan
    return landed


def spot_radii(
    lens: LensBuilds,
    plane: Array,
    rims: Array,
    world: Array,
    point: ArrayLike,
    pupil: ArrayLike,
    weight: ArrayLike,
    *,
    threads: bool = False,
) -> Array:
    """Root-mean-square radii on a plane of the light from object points, about its centroid.

    Parameters
    ----------
    lens : LensBuilds
        T builds.
    plane, rims : ndarray, (T, 12), (T, R, 13)
        Where the spots are seen, and what rays pass, as `Planes` has them.
    world : ndarray, (T, 3)
        What the object points' frame is shifted by against the lens's [mm].
    point : array_like, (F, 3)
        Object points [mm].
    pupil, weight : array_like, (P, 2), (P,)
        Points of the FAP in units of its radius, and how much of the light each stands for.
    threads : bool
        Whether all of the process's threads share the work; the numbers are the same.

    Returns
    -------
    ndarray
        (T, F) [mm], of the rays that no rim stops; nan where none comes through.
    """
    x, a, w = np.atleast_2d(np.asarray(point, float)), np.asarray(pupil, float), np.ascontiguousarray(weight, float)
    size = np.empty((len(world), len(x)))
    rays = (np.repeat(x, len(a), axis=0), np.tile(a, (len(x), 1)), w)
    arguments = (lens.table, lens.media.shape[1] - 1, lens.media, plane, rims, world, *rays, size)
    if threads:
        with THREADS:
            spots_on_all_threads.compiled(*arguments)
    else:
        spots.compiled(*arguments)
    return size


__all__ = [
    "Aimed",
    "Aims",
    "Outlines",
    "Planes",
    "aimed",
    "aims",
    "cut_shapes",
    "landings",
    "outlines",
    "pupil_points",
    "spot_radii",
]
