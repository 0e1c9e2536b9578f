"""Many builds of a camera behind a real lens: aimed rays, spots, and microlens images from a few rays each.

A ray from a microlens is wanted that meets the flexible angular plane (FAP) at a given point. Its slope is found by
Broyden's method from the nominal camera's slope and Jacobian: builds differ little, so two to five rays do, and no
derivative is ever taken. Everything is traced through every build's own lens, the rays of one build together.

An image is the map from the disc of the FAP to the sensor, known at some points of the disc. Whole images need the
points on its rim alone: closed curves, integrated by their Fourier series. Cut ones take the map and the rims' squared
heights as polynomials of the fifth degree over the disc; the lit part is integrated in polar pieces between corners.
"""

from __future__ import annotations

import math
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from ..lenses.tracer import BLOCK, COLUMNS, ROWS, Rays, SurfaceStack, pass_surfaces
from .camera import FOUND, LOST, LensCamera, Train, aim_beyond, sensor_of_pupil, views
from .images import circle, polygon_moments

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE, CORRECTIONS = 1e-11, 12
"""How near the FAP's point rays must come, in its radius, and after how many corrections at most they are given up."""
RIM = 16
"""Rays along the FAP's rim, a multiple of four; the outline's area converges exponentially in them."""
HARMONICS = 6
"""Of a ray's squared height on a surface, along the FAP's rim."""
RINGS = ((0.5, 8), (0.8, 8))
"""Radii and rays of the rings inside, where rims cut."""
DEGREE, TERMS = 5, 21
"""Of the polynomials over the FAP's disc: products x^a y^b with a + b <= 5, b running fastest."""
POWERS = np.array([(a, b) for a in range(DEGREE + 1) for b in range(DEGREE + 1 - a)])
SCAN = 32
"""Directions in which the nearest rim is asked for, before corners are looked for between them."""
HALVINGS = 12
"""To a corner: its angle is then right to 5e-5, and the area to the square of that."""
PANEL = math.pi / 4
"""Largest angle for one quadrature."""
FAP = -1
"""Stands for the FAP's own rim where rims are numbered."""
_NODES, _WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(10))


@kernel()
def crossing(x: float, y: float, z: float, sx: float, sy: float, plane: Any) -> tuple[float, float]:
    """Where the line through a point with slopes dx/dz, dy/dz crosses a plane, in the plane's own coordinates."""
    ox, oy, oz = x - plane[0], y - plane[1], z - plane[2]
    lean = plane[9] * sx + plane[10] * sy + plane[11]
    step = -(plane[9] * ox + plane[10] * oy + plane[11] * oz) / lean
    hx, hy, hz = ox + step * sx, oy + step * sy, oz + step
    return plane[3] * hx + plane[4] * hy + plane[5] * hz, plane[6] * hx + plane[7] * hy + plane[8] * hz


@kernel()
def aim(
    trial: Any, begin: Any, table: Any, count: int, media: Any, outer: Any, outer_count: int, outer_media: Any,
    array: Any, sensor: Any, rims: Any, half: Any, base: Any, offset: Any, target: Any, start: Any, inverse: Any,
    tolerance: float, most: int, landed: Any, heights: Any, miss: Any,
) -> None:  # fmt: skip
    """Aim rays of N jobs, n <= BLOCK rays each, and tell where they meet the sensor and every rim.

    Parameters
    ----------
    trial, begin : (N,)
        The build of each job, and its first ray in the lists of rays.
    table, media, outer, outer_media, array, sensor, rims, half : (T, ...)
        The builds: lens, what stands before the FAP, planes of 12 numbers, rims (R of 13, the FAP first), half the
        microlens pitch.
    base, offset, target, start, inverse : (rays, ...)
        As `Aims` has them; `tolerance` is in the target's units, `most` the corrections at most.
    landed, heights, miss : (N, n, ...)
        Get what `Aimed` has, `LOST` as the miss of a ray that does not come through.
    """
    n = landed.shape[1]
    stops = rims.shape[1]
    buffer, radii = np.empty(ROWS * BLOCK), np.empty((count + outer_count) * BLOCK)
    px, py, pz = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    sx, sy, ex, ey = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    dx, dy, left = np.zeros(BLOCK), np.zeros(BLOCK), np.empty(BLOCK)
    a, b, c, d = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for job in range(len(trial)):
        t, first = trial[job], begin[job]
        lens, index, plane = table[t], media[t], array[t]
        fap = rims[t, 0]
        unit = 1.0 / fap[12]
        for i in range(n):
            u = base[first + i, 0] + offset[first + i, 0] * half[t]
            v = base[first + i, 1] + offset[first + i, 1] * half[t]
            px[i] = plane[0] + u * plane[3] + v * plane[6]
            py[i] = plane[1] + u * plane[4] + v * plane[7]
            pz[i] = plane[2] + u * plane[5] + v * plane[8]
            sx[i], sy[i] = start[first + i, 0], start[first + i, 1]
            a[i], b[i] = inverse[first + i, 0], inverse[first + i, 1]
            c[i], d[i] = inverse[first + i, 2], inverse[first + i, 3]
            left[i] = LOST
        for step in range(most + 1):
            for i in range(n):
                shrink = 1.0 / sqrt(1.0 + sx[i] * sx[i] + sy[i] * sy[i])
                buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = px[i], py[i], pz[i]
                buffer[3 * BLOCK + i] = -sx[i] * shrink
                buffer[4 * BLOCK + i] = -sy[i] * shrink
                buffer[5 * BLOCK + i] = -shrink
                buffer[6 * BLOCK + i] = 0.0
            pass_surfaces(buffer, n, lens, index, count, True, False, radii)
            worst = 0.0
            for i in range(n):
                down = buffer[5 * BLOCK + i]
                ox, oy = buffer[3 * BLOCK + i] / down, buffer[4 * BLOCK + i] / down
                hx, hy = crossing(buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], ox, oy, fap)
                fx, fy = hx * unit - target[first + i, 0], hy * unit - target[first + i, 1]
                done = left[i] <= tolerance
                gx, gy = fx - ex[i], fy - ey[i]
                wx, wy = a[i] * gx + b[i] * gy, c[i] * gx + d[i] * gy
                size = dx[i] * wx + dy[i] * wy
                if step > 0 and not done and size != 0.0:  # the inverse that explains the step just made
                    rx, ry = (dx[i] - wx) / size, (dy[i] - wy) / size
                    va, vb = dx[i] * a[i] + dy[i] * c[i], dx[i] * b[i] + dy[i] * d[i]
                    a[i], b[i], c[i], d[i] = a[i] + rx * va, b[i] + rx * vb, c[i] + ry * va, d[i] + ry * vb
                ex[i], ey[i] = fx, fy
                far = max(abs(fx), abs(fy))
                left[i] = far if buffer[6 * BLOCK + i] == 0.0 and far < LOST else LOST
                worst = max(worst, left[i] if left[i] < LOST else 0.0)
            if worst <= tolerance or step == most:
                break
            for i in range(n):
                moves = left[i] > tolerance and left[i] < LOST
                dx[i] = -(a[i] * ex[i] + b[i] * ey[i]) if moves else 0.0
                dy[i] = -(c[i] * ex[i] + d[i] * ey[i]) if moves else 0.0
                sx[i] += dx[i]
                sy[i] += dy[i]
        for i in range(n):
            for k in range(count):
                heights[job, i, k] = radii[k * BLOCK + i] / lens[k * COLUMNS + 5]
            down = buffer[5 * BLOCK + i]
            ox, oy = buffer[3 * BLOCK + i] / down, buffer[4 * BLOCK + i] / down
            for k in range(1, stops):
                rim = rims[t, k]
                hx, hy = crossing(buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], ox, oy, rim)
                heights[job, i, count + k - 1] = (hx * hx + hy * hy) / (rim[12] * rim[12])
        pass_surfaces(buffer, n if outer_count else 0, outer[t], outer_media[t], outer_count, True, False, radii)
        for i in range(n):
            for k in range(outer_count):
                heights[job, i, count + stops - 1 + k] = radii[k * BLOCK + i] / outer[t, k * COLUMNS + 5]
            miss[job, i] = left[i] if buffer[6 * BLOCK + i] == 0.0 else LOST
            # What is left of the miss is undone to first order: no ray is spent on the last digits.
            tx, ty = sx[i] - (a[i] * ex[i] + b[i] * ey[i]), sy[i] - (c[i] * ex[i] + d[i] * ey[i])
            landed[job, i, 0], landed[job, i, 1] = crossing(px[i], py[i], pz[i], tx, ty, sensor[t])


@kernel()
def spots(
    table: Any, count: int, media: Any, outer: Any, outer_count: int, outer_media: Any, plane: Any, rims: Any,
    world: Any, point: Any, pupil: Any, weight: Any, size: Any,
) -> None:  # fmt: skip
    """Root-mean-square radii (T, F) of the light from object points; arguments as of `spot_radii`, a ray a row."""
    buffer, radii, cut = np.empty(ROWS * BLOCK), np.empty(count * BLOCK), np.empty(BLOCK)
    single, squares = np.empty(ROWS * BLOCK), np.empty(outer_count * BLOCK)
    lx, ly = np.empty(len(point)), np.empty(len(point))
    each, total = len(weight), len(point)
    for t in range(len(size)):
        lens, fap = table[t], rims[t, 0]
        for first in range(0, total, BLOCK):
            m = min(BLOCK, total - first)
            for i in range(m):
                u, v = pupil[first + i, 0] * fap[12], pupil[first + i, 1] * fap[12]
                x = fap[0] + u * fap[3] + v * fap[6]
                y = fap[1] + u * fap[4] + v * fap[7]
                z = fap[2] + u * fap[5] + v * fap[8]
                ax, ay = x - (point[first + i, 0] + world[t, 0]), y - (point[first + i, 1] + world[t, 1])
                az = z - (point[first + i, 2] + world[t, 2])
                cut[i] = 0.0
                if outer_count:
                    ax, ay, far = aim_beyond(outer[t], outer_media[t], single, squares, x, y, z, x - ax, y - ay, z - az)
                    az = 1.0
                    for k in range(outer_count):
                        if not squares[k * BLOCK] <= outer[t, k * COLUMNS + 5] or not far <= FOUND:
                            cut[i] = 1.0
                shrink = 1.0 / sqrt(ax * ax + ay * ay + az * az)
                buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = x, y, z
                buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = ax * shrink, ay * shrink
                buffer[5 * BLOCK + i], buffer[6 * BLOCK + i] = az * shrink, 0.0
            for k in range(1, rims.shape[1]):
                rim = rims[t, k]
                for i in range(m):
                    x, y, z, up = buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], buffer[5 * BLOCK + i]
                    hx, hy = crossing(x, y, z, buffer[3 * BLOCK + i] / up, buffer[4 * BLOCK + i] / up, rim)
                    cut[i] = 1.0 if hx * hx + hy * hy > rim[12] * rim[12] else cut[i]
            pass_surfaces(buffer, m, lens, media[t], count, False, False, radii)
            for k in range(count):
                for i in range(m):
                    cut[i] = 1.0 if radii[k * BLOCK + i] > lens[k * COLUMNS + 5] else cut[i]
            for i in range(m):
                up = buffer[5 * BLOCK + i]
                ox, oy = buffer[3 * BLOCK + i] / up, buffer[4 * BLOCK + i] / up
                x, y = crossing(buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], ox, oy, plane[t])
                stopped = cut[i] != 0.0 or buffer[6 * BLOCK + i] != 0.0
                lx[first + i], ly[first + i] = (LOST, LOST) if stopped else (x, y)
        for field in range(total // each):
            begin = field * each
            share, mx, my = 0.0, 0.0, 0.0
            for i in range(each):
                w = weight[i] if lx[begin + i] < LOST else 0.0
                share += w
                mx += w * (lx[begin + i] if w != 0.0 else 0.0)
                my += w * (ly[begin + i] if w != 0.0 else 0.0)
            mx, my = mx / share, my / share
            square = 0.0
            for i in range(each):
                x, y = lx[begin + i] - mx, ly[begin + i] - my
                square += weight[i] * (x * x + y * y) if lx[begin + i] < LOST else 0.0
            size[t, field] = sqrt(square / share)


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
    """Where on the FAP, in its own coordinates and units of its radius, (n, 2)."""
    start: Array
    """Slopes in the nominal camera, (n, 2); nan where it has no such ray."""
    inverse: Array
    """Inverse of d(target)/d(slope) there, (n, 4)."""


class Aimed(NamedTuple):
    """What became of N jobs of n rays, nan for those that do not come through."""

    landed: Array
    """Sensor points, in its own coordinates [mm], (N, n, 2)."""
    heights: Array
    """Squared heights over those of every surface, every further stop, all before the FAP, (N, n, S + R - 1)."""


def aims(camera: LensCamera, base: ArrayLike, target: ArrayLike, there: Array, offset: ArrayLike = (0.0, 0.0)) -> Aims:
    """Find rays in the nominal camera.

    Parameters
    ----------
    camera : LensCamera
        As drawn.
    base, offset, target : array_like, (n, 2) or (2,)
        As `Aims` has them.
    there : ndarray, (n, 2)
        Those places of the array in the camera's own counting (`camera.microlenses`).
    """
    a, fap = np.broadcast_to(np.asarray(target, float), there.shape), camera.fap
    nominal = sensor_of_pupil(camera, there, fap.centre + fap.diameter / 2 * a)
    lens_at = camera.array.lifted(there)

    def slopes(p: Array) -> Array:
        run = camera.detector.lifted(p) - lens_at
        return np.asarray(np.moveaxis(run[:2] / run[2], 0, -1))

    nudge = 1e-3 * float(np.hypot(*np.ptp(nominal.sensor - there, axis=0))) + 1e-6 * camera.d_2
    columns, rates = [], []
    for step in nudge * np.eye(2):
        ends = [nominal.sensor + sign * step for sign in (1, -1)]
        one, other = (views(camera, there, p, clip=False).pupil for p in ends)
        columns.append((one - other) / (fap.diameter / 2))
        rates.append(slopes(ends[0]) - slopes(ends[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.stack(rates, axis=-1) @ np.linalg.pinv(np.stack(columns, axis=-1))
    start = np.where(nominal.ok[:, None], slopes(nominal.sensor), np.nan)
    at, aside, goal = (np.broadcast_to(np.asarray(part, float), there.shape).copy() for part in (base, offset, a))
    return Aims(at, aside, goal, start, inverse.reshape(-1, 4))


def aimed(train: Train, planes: Planes, half: Array, wanted: Aims, trial: Ints, begin: Ints, rays: int) -> Aimed:
    """Trace rays of N jobs.

    Parameters
    ----------
    train, planes, half
        T builds; `half` of the microlens pitch [mm], (T,).
    wanted : Aims
        The rays.
    trial, begin : ndarray of int, (N,)
        The build of each job, and its first ray in the list.
    rays : int
        Rays of a job, at most `BLOCK`.
    """
    n, (lens, beyond) = len(trial), train
    assert rays <= BLOCK
    limits = sum(part.media.shape[1] - 1 for part in train) + planes.rims.shape[1] - 1
    landed, heights = np.empty((n, rays, 2)), np.empty((n, rays, limits))
    miss = np.empty((n, rays))
    aim.compiled(
        trial, begin, *_counted(lens), *_counted(beyond), planes.array, planes.sensor, planes.rims, half, *wanted,
        TOLERANCE, CORRECTIONS, landed, heights, miss,
    )  # fmt: skip
    lost = ~(miss <= 1e3 * TOLERANCE)
    landed[lost], heights[lost] = np.nan, np.nan
    return Aimed(landed, heights)


def _counted(part: SurfaceStack) -> tuple[Array, int, Array]:
    return part.table, part.media.shape[1] - 1, part.media


def landings(train: Train, planes: Planes, world: Array, point: ArrayLike, pupil: ArrayLike) -> Array:
    """Where rays from object points through FAP points meet the array, then the sensor, in their own coordinates.

    Parameters
    ----------
    train, planes
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
    fap, aside = planes.rims[:, 0], np.asarray(pupil, float)[None] * planes.rims[:, :1, 12:]
    through = fap[:, None, :3] + aside[..., :1] * fap[:, None, 3:6] + aside[..., 1:] * fap[:, None, 6:9]
    start = np.asarray(point, float) + world[:, None]
    run = through - start
    if train.beyond.table.size:
        ends = np.ascontiguousarray(np.concatenate([through, start], axis=-1))
        aim_all.compiled(*_counted(train.beyond), ends, run)
    way = run / np.sqrt(np.sum(np.square(run), axis=-1, keepdims=True))
    traced = train.lens.trace(Rays(np.moveaxis(through, -1, 0), np.moveaxis(way, -1, 0)), clip=False)
    place, way = (np.moveaxis(part, 0, -1) for part in traced.rays)
    landed = np.concatenate([crossings(place, way, plane[:, None]) for plane in (planes.array, planes.sensor)], axis=-1)
    landed[~(traced.kept & np.isfinite(run[..., 0]))] = np.nan
    return landed


@kernel()
def aim_all(outer: Any, outer_count: int, outer_media: Any, ends: Any, run: Any) -> None:
    """Ways (T, n, 3) through points of the FAP from points of the scene, both in `ends` (T, n, 6); nan where none."""
    single, squares = np.empty(ROWS * BLOCK), np.empty(outer_count * BLOCK)
    for t in range(ends.shape[0]):
        for i in range(ends.shape[1]):
            x, y, z, tx, ty, tz = ends[t, i]
            ax, ay, far = aim_beyond(outer[t], outer_media[t], single, squares, x, y, z, tx, ty, tz)
            run[t, i, 0], run[t, i, 1], run[t, i, 2] = ax if far <= FOUND else math.nan, ay, 1.0


def crossings(point: Array, way: Array, plane: Array) -> Array:
    """Where lines through points along ways (..., 3) cross planes (..., 12), in their own coordinates, (..., 2)."""
    off, normal = point - plane[..., :3], plane[..., 9:12]
    hit = off - way * (np.sum(off * normal, axis=-1) / np.sum(way * normal, axis=-1))[..., None]
    return np.stack([np.sum(hit * plane[..., 3:6], axis=-1), np.sum(hit * plane[..., 6:9], axis=-1)], axis=-1)


def spot_radii(
    train: Train,
    plane: Array,
    rims: Array,
    world: Array,
    point: ArrayLike,
    pupil: ArrayLike,
    weight: ArrayLike,
) -> Array:
    """Root-mean-square radii on a plane of the light from object points, about its centroid.

    Parameters
    ----------
    train : Train
        T builds.
    plane, rims : ndarray, (T, 12), (T, R, 13)
        Where the spots are seen, and what rays pass, as `Planes` has them.
    world : ndarray, (T, 3)
        What the object points' frame is shifted by against the lens's [mm].
    point : array_like, (F, 3)
        Object points [mm].
    pupil, weight : array_like, (P, 2), (P,)
        Points of the FAP in units of its radius, and how much of the light each stands for.

    Returns
    -------
    ndarray
        (T, F) [mm], of the rays that no rim stops; nan where none comes through.
    """
    x, a, w = np.atleast_2d(np.asarray(point, float)), np.asarray(pupil, float), np.ascontiguousarray(weight, float)
    size = np.empty((len(world), len(x)))
    rays = np.repeat(x, len(a), axis=0), np.tile(a, (len(x), 1))
    spots.compiled(*_counted(train.lens), *_counted(train.beyond), plane, rims, world, *rays, w, size)
    return size


def pupil_points() -> tuple[Array, Array]:
    """FAP points along its rim, (RIM, 2), and inside it with its middle first, (..., 2), in units of its radius."""
    return circle(RIM), np.concatenate([np.zeros((1, 2)), *(radius * circle(count) for radius, count in RINGS)])


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
    area, centroid, moments = polygon_moments(rim.landed)
    peaks, turns = np.empty((len(area), rim.heights.shape[2])), np.empty((len(area), rim.heights.shape[2]))
    waves = np.exp(-2j * np.pi * np.arange(RIM) / RIM)
    highest.compiled(rim.heights, waves, np.empty(HARMONICS + 1, complex), peaks, turns)
    return Outlines(np.concatenate([area[:, None], centroid, moments], axis=1), peaks, turns)


def cut_shapes(rim: Aimed, inner: Aimed, uncut: Outlines) -> tuple[Array, Array]:
    """Lit shapes (N, 6) and seen parts of the FAP (N,) of images that rims cut, from rays all over the FAP.

    nan where the lens loses some of those rays altogether.
    """
    outer_points, inner_points = pupil_points()
    places = np.concatenate([inner_points, outer_points])
    fit = np.linalg.pinv(np.prod(places[:, None, :] ** POWERS, axis=-1))
    landed = np.concatenate([inner.landed, rim.landed], axis=1)
    heights = np.concatenate([inner.heights, rim.heights], axis=1)
    shape, share = np.full((len(landed), 6), np.nan), np.full(len(landed), np.nan)
    whole = ~np.any(np.isnan(landed[:, :, 0]), axis=1)
    landed, heights, peaks = landed[whole], heights[whole], uncut.peaks[whole]
    cutting = (peaks > 1) | np.any(heights > 1, axis=1)
    maps, rims = (np.swapaxes(fit @ part, 1, 2).copy() for part in (landed - landed[:, :1], heights))
    size, part = np.empty((len(landed), 6)), np.empty(len(landed))
    corners = np.where(peaks > 1, uncut.turns[whole], np.nan)
    cut_images.compiled(maps, rims, cutting, corners, places, _NODES + 0.5, _WEIGHTS, size, part)
    size[:, 1:3] += np.where(part[:, None] > 0, landed[:, 0], 0.0)
    shape[whole], share[whole] = size, part
    return shape, share


def seen_shapes(
    train: Train, planes: Planes, base: Array, trial: Ints, rim: Aimed, inner: Aimed, about: Array, wide: Array
) -> tuple[Array, Array]:
    """Lit shapes (N, 6) and seen parts of the FAP (N,) of images of which part is out of the lens's sight.

    Parameters
    ----------
    train, planes
        T builds.
    base : ndarray, (N, 2)
        Microlenses, on the array [mm].
    trial : ndarray of int, (N,)
        Their builds.
    rim, inner
        Rays of `pupil_points`, nan where there is none: the boundary is looked for about the one with most room.
    about, wide : ndarray, (N, 2) and (N,)
        Where to look, and how far, where the lens shows none of them: sensor points [mm].

    Notes
    -----
    No ray is aimed: `BLOCK` of them leave the microlens, along spokes, to where they are lost or stopped. Corners make
    areas right to 20/`BLOCK`^2 of themselves.
    """
    rim_points, inner_points = pupil_points()
    on_fap = np.sum(np.concatenate([inner_points, rim_points]) ** 2, axis=1)
    landed = np.concatenate([inner.landed, rim.landed], axis=1)
    tallest = np.max(np.concatenate([inner.heights, rim.heights], axis=1), axis=2, initial=0.0)
    tallest = np.where(np.isnan(landed[:, :, 0]), np.inf, np.maximum(tallest, on_fap))
    hub = landed[np.arange(len(landed)), np.argmin(tallest, axis=1)]
    known = np.isfinite(landed)
    some = known.any(axis=(1, 2))
    reach = np.max(landed, axis=(1, 2), where=known, initial=-np.inf)
    reach = np.where(some, reach - np.min(landed, axis=(1, 2), where=known, initial=np.inf), wide)
    hub = np.where(some[:, None], hub, about)
    edge, pupil = np.empty((2, len(landed), BLOCK, 2))
    lit = np.zeros(len(landed), np.bool_)
    lens, beyond = train
    follow_spokes.compiled(
        trial, base, *_counted(lens), *_counted(beyond), planes.array, planes.sensor, planes.rims, hub, reach,
        circle(BLOCK), edge, pupil, lit,
    )  # fmt: skip
    shape, share = np.zeros((len(landed), 6)), np.zeros(len(landed))
    if lit.any():
        area, centroid, moments = polygon_moments(edge[lit])
        shape[lit] = np.concatenate([area[:, None], centroid, moments], axis=1)
        share[lit] = np.minimum(polygon_moments(pupil[lit])[0] / math.pi, 1.0)
    return shape, share


@kernel()
def measure_rays(
    buffer: Any, radii: Any, n: int, at: Any, sx: Any, sy: Any, lens: Any, count: int, index: Any, outer: Any,
    outer_count: int, outer_index: Any, rims: Any, tallest: Any, pupil: Any,
) -> None:  # fmt: skip
    """Largest squared heights (n,) over surfaces, stops and the FAP, and FAP points (n, 2) in its radius.

    Of rays with slopes `sx`, `sy` from a point of the array; `LOST` for those that do not come through.
    """
    for i in range(n):
        shrink = 1.0 / sqrt(1.0 + sx[i] * sx[i] + sy[i] * sy[i])
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = at[0], at[1], at[2]
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = -sx[i] * shrink, -sy[i] * shrink
        buffer[5 * BLOCK + i], buffer[6 * BLOCK + i] = -shrink, 0.0
        tallest[i] = 0.0
    pass_surfaces(buffer, n, lens, index, count, True, False, radii)
    for i in range(n):
        for k in range(count):
            tallest[i] = max(tallest[i], radii[k * BLOCK + i] / lens[k * COLUMNS + 5])
        down = buffer[5 * BLOCK + i]
        ox, oy = buffer[3 * BLOCK + i] / down, buffer[4 * BLOCK + i] / down
        for k in range(rims.shape[0]):
            hx, hy = crossing(buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], ox, oy, rims[k])
            hx, hy = hx / rims[k, 12], hy / rims[k, 12]
            if k == 0:
                pupil[i, 0], pupil[i, 1] = hx, hy
            tallest[i] = max(tallest[i], hx * hx + hy * hy)
    pass_surfaces(buffer, n if outer_count else 0, outer, outer_index, outer_count, True, False, radii)
    for i in range(n):
        for k in range(outer_count):
            tallest[i] = max(tallest[i], radii[k * BLOCK + i] / outer[k * COLUMNS + 5])
        if buffer[6 * BLOCK + i] != 0.0 or not tallest[i] < LOST:
            tallest[i] = LOST


@kernel()
def follow_spokes(
    trial: Any, base: Any, table: Any, count: int, media: Any, outer: Any, outer_count: int, outer_media: Any,
    array: Any, sensor: Any, rims: Any, hub: Any, reach: Any, ways: Any, edge: Any, pupil: Any, lit: Any,
) -> None:  # fmt: skip
    """Boundaries of N lit images along `BLOCK` spokes; arguments as of `aim`.

    Parameters
    ----------
    hub, reach : (N, 2), (N,)
        Sensor points where to begin, and how far from them the image reaches at most [mm].
    ways : (BLOCK, 2)
        Directions.
    edge, pupil : (N, BLOCK, 2)
        Get the boundary on the sensor [mm] and on the FAP, in its radius.
    lit : (N,)
        Gets whether there is any light.
    """
    buffer, radii = np.empty(ROWS * BLOCK), np.empty((count + outer_count) * BLOCK)
    sx, sy, tallest, seen = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty((BLOCK, 2))
    low, high, at = np.empty(BLOCK), np.empty(BLOCK), np.empty(3)
    for job in range(len(trial)):
        t = trial[job]
        x, y = hub[job, 0], hub[job, 1]
        plane, screen = array[t], sensor[t]
        for k in range(3):
            at[k] = plane[k] + base[job, 0] * plane[3 + k] + base[job, 1] * plane[6 + k]
        size, best = reach[job], LOST
        for search in range(18):  # to where there is most room: on a grid of 16 x 16, then on ever finer ones of 5 x 5
            side = 16 if search == 0 else 5
            step = 2.0 * size / (side - 1)
            for i in range(side * side):
                u, v = x - size + step * (i // side), y - size + step * (i % side)
                run = screen[2] + u * screen[5] + v * screen[8] - at[2]
                sx[i] = (screen[0] + u * screen[3] + v * screen[6] - at[0]) / run
                sy[i] = (screen[1] + u * screen[4] + v * screen[7] - at[1]) / run
            measure_rays(
                buffer, radii, side * side, at, sx, sy, table[t], count, media[t], outer[t], outer_count,
                outer_media[t], rims[t], tallest, seen,
            )  # fmt: skip
            u, v = x, y
            for i in range(side * side):
                if tallest[i] < best:
                    best = tallest[i]
                    x, y = u - size + step * (i // side), v - size + step * (i % side)
            size = 2.0 * step if search == 0 else 0.6 * size
        if not best < 1.0:
            continue
        lit[job] = True
        for i in range(BLOCK):
            low[i], high[i] = 0.0, 3.0 * reach[job]
        for _ in range(40):
            for i in range(BLOCK):
                far = 0.5 * (low[i] + high[i])
                u, v = x + far * ways[i, 0], y + far * ways[i, 1]
                run = screen[2] + u * screen[5] + v * screen[8] - at[2]
                sx[i] = (screen[0] + u * screen[3] + v * screen[6] - at[0]) / run
                sy[i] = (screen[1] + u * screen[4] + v * screen[7] - at[1]) / run
            measure_rays(
                buffer, radii, BLOCK, at, sx, sy, table[t], count, media[t], outer[t], outer_count, outer_media[t],
                rims[t], tallest, seen,
            )  # fmt: skip
            for i in range(BLOCK):
                far = 0.5 * (low[i] + high[i])
                if tallest[i] <= 1.0:
                    low[i] = far
                    pupil[job, i, 0], pupil[job, i, 1] = seen[i, 0], seen[i, 1]
                else:
                    high[i] = far
        for i in range(BLOCK):
            edge[job, i, 0], edge[job, i, 1] = x + low[i] * ways[i, 0], y + low[i] * ways[i, 1]


@kernel()
def peak(g: Any, waves: Any, series: Any) -> tuple[float, float]:
    """Largest value of a periodic function from its evenly spaced values, and the angle where it is taken.

    `waves` holds the unit circle's points, clockwise; `series` is room for the Fourier coefficients.
    """
    n = len(g)
    best = 0
    for i in range(1, n):
        if g[i] > g[best]:
            best = i
    for h in range(len(series)):
        total = 0j
        for i in range(n):
            total += g[i] * waves[(h * i) % n]
        series[h] = total / n if h == 0 else 2.0 * total / n
    start, limit = 2.0 * math.pi * best / n, math.pi / n
    angle, value = start, g[best]
    for _ in range(6):
        slope, curve, value = 0.0, 0.0, series[0].real
        turn, power = complex(math.cos(angle), math.sin(angle)), 1.0 + 0.0j
        for h in range(1, len(series)):
            power *= turn
            here = series[h] * power
            value += here.real
            slope -= h * here.imag
            curve -= h * h * here.real
        if not curve < 0 or abs(slope) <= 1e-7 * -curve:  # the value is then right to rounding
            break
        angle = min(max(angle - slope / curve, start - limit), start + limit)
    return max(value, g[best]), angle


@kernel()
def highest(heights: Any, waves: Any, series: Any, peaks: Any, turns: Any) -> None:
    """Largest squared heights (N, R) along the FAP's rim and the angles where they are, from (N, K, R) of K rays."""
    for n in range(len(heights)):
        for k in range(heights.shape[2]):
            peaks[n, k], turns[n, k] = peak(heights[n, :, k], waves, series)


@kernel()
def polynomial(c: Any, x: float, y: float) -> tuple[float, float, float]:
    """A polynomial of `TERMS` coefficients and its derivatives by x and y."""
    f, fx, fy = 0.0, 0.0, 0.0
    last = TERMS
    for a in range(DEGREE, -1, -1):
        last -= DEGREE + 1 - a
        q, dq = 0.0, 0.0
        for b in range(DEGREE - a, -1, -1):
            dq = dq * y + q
            q = q * y + c[last + b]
        fx = fx * x + f
        f = f * x + q
        fy = fy * x + dq
    return f, fx, fy


@kernel()
def to_circle(hx: float, hy: float, cosine: float, sine: float) -> float:
    """From an inner point along a direction to the unit circle."""
    along = hx * cosine + hy * sine
    return -along + math.sqrt(max(0.0, along * along + 1.0 - hx * hx - hy * hy))


@kernel()
def to_rim(c: Any, hx: float, hy: float, cosine: float, sine: float, far: float) -> float:
    """From an inner point along a direction to where a rim's polynomial is 1; `far` where it is nowhere up to there."""
    f, _, _ = polynomial(c, hx + far * cosine, hy + far * sine)
    if f <= 1.0:
        return far
    low, high, x = 0.0, far, 0.5 * far
    for _ in range(60):
        f, fx, fy = polynomial(c, hx + x * cosine, hy + x * sine)
        if f > 1.0:
            high = x
        else:
            low = x
        slope = fx * cosine + fy * sine
        step = x - (f - 1.0) / slope if slope > 0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - x) <= 1e-15:
            return step
        x = step
    return x


@kernel()
def nearest(rims: Any, count: int, hx: float, hy: float, angle: float) -> int:
    """Which rim is met first along a direction; `FAP` for the FAP's own."""
    cosine, sine = math.cos(angle), math.sin(angle)
    far = to_circle(hx, hy, cosine, sine)
    first = FAP
    for k in range(count):
        at = to_rim(rims[k], hx, hy, cosine, sine, far)
        if at < far:
            far, first = at, k
    return first


@kernel()
def corner(rims: Any, count: int, one: int, hx: float, hy: float, low: float, high: float) -> float:
    """Angle between two at which the boundary leaves rim `one`."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if nearest(rims, count, hx, hy, middle) == one else (low, middle)
    return high


@kernel()
def roominess(rims: Any, count: int, x: float, y: float) -> float:
    """How far inside the FAP and all rims a point lies."""
    least = 1.0 - x * x - y * y
    for k in range(count):
        f, _, _ = polynomial(rims[k], x, y)
        least = min(least, 1.0 - f)
    return least


@kernel()
def add_piece(
    rims: Any, active: int, image: Any, hx: float, hy: float, low: float, high: float, nodes: Any, weights: Any,
    sums: Any,
) -> None:  # fmt: skip
    """Green's integrals along one piece of the boundary, about the image of the hub; then the area on the disc."""
    x0, _, _ = polynomial(image[0], hx, hy)
    y0, _, _ = polynomial(image[1], hx, hy)
    panels = max(1, math.ceil((high - low) / PANEL))
    width = (high - low) / panels
    for panel in range(panels):
        for q in range(len(nodes)):
            angle = low + width * (panel + nodes[q])
            cosine, sine = math.cos(angle), math.sin(angle)
            at = to_circle(hx, hy, cosine, sine)
            if active != FAP:
                at = to_rim(rims[active], hx, hy, cosine, sine, 2.0 * at)
            tx, ty = hx + at * cosine, hy + at * sine
            nx, ny = tx, ty
            if active != FAP:
                _, nx, ny = polynomial(rims[active], tx, ty)
            out, across = nx * cosine + ny * sine, ny * cosine - nx * sine
            grow = -at * across / out  # of the distance, along the boundary
            ux, uy = grow * cosine - at * sine, grow * sine + at * cosine
            x, fx, fy = polynomial(image[0], tx, ty)
            y, gx, gy = polynomial(image[1], tx, ty)
            weight = weights[q] * width
            dx, dy = weight * (fx * ux + fy * uy), weight * (gx * ux + gy * uy)
            x, y = x - x0, y - y0
            sums[0] += 0.5 * (x * dy - y * dx)
            sums[1] += 0.5 * x * x * dy
            sums[2] -= 0.5 * y * y * dx
            sums[3] += x * x * x * dy / 3.0
            sums[4] += 0.5 * x * x * y * dy
            sums[5] -= y * y * y * dx / 3.0
            sums[6] += 0.5 * at * at * weight


@kernel()
def cut_images(
    maps: Any, rims: Any, cutting: Any, turns: Any, places: Any, nodes: Any, weights: Any, shape: Any, share: Any
) -> None:
    """Lit shapes of N images that rims cut.

    Parameters
    ----------
    maps, rims : (N, 2, TERMS), (N, R, TERMS)
        Polynomials over the unit disc of the FAP: sensor points from that of its middle, and squared heights.
    cutting, turns : (N, R)
        Which rims cut, and where on the FAP's rim they cut most; nan where they spare it.
    places : (P, 2)
        Points of the disc, one of which lies near enough to the roomiest.
    nodes, weights
        Of a quadrature over [0, 1].
    shape : (N, 6)
        Gets area, centroid and central second moments; zeros where dark.
    share : (N,)
        Gets the part of the FAP that is seen.
    """
    most = rims.shape[1]
    cuts = np.empty((most, TERMS))
    angles, active = np.empty(SCAN + most), np.empty(SCAN + most, np.int64)
    ends, along = np.empty(SCAN + most), np.empty(SCAN + most, np.int64)
    sums = np.empty(7)
    for n in range(len(maps)):
        image, count, marks = maps[n], 0, SCAN
        for k in range(most):
            if cutting[n, k]:
                cuts[count] = rims[n, k]
                count += 1
        hx, hy, best = 0.0, 0.0, -1e300
        for p in range(len(places)):
            room = roominess(cuts, count, places[p, 0], places[p, 1])
            if room > best:
                hx, hy, best = places[p, 0], places[p, 1], room
        reach = 0.25
        for _ in range(24 if best < 0.2 else 0):
            ux, uy = hx, hy
            for i in range(-2, 3):
                for j in range(-2, 3):
                    x, y = ux + i * reach, uy + j * reach
                    room = roominess(cuts, count, x, y)
                    if room > best:
                        hx, hy, best = x, y, room
            reach *= 0.6
        shape[n], share[n] = 0.0, 0.0
        if best <= 0.0:
            continue
        for i in range(SCAN):
            angles[i] = 2.0 * math.pi * i / SCAN
        for k in range(most):
            if turns[n, k] == turns[n, k]:  # a sliver between two directions of the scan must not be missed
                angle = math.atan2(math.sin(turns[n, k]) - hy, math.cos(turns[n, k]) - hx)
                angles[marks] = angle if angle >= 0 else angle + 2.0 * math.pi
                marks += 1
        order = np.argsort(angles[:marks])
        for i in range(marks):
            active[i] = nearest(cuts, count, hx, hy, angles[order[i]])
        corners = 0
        for i in range(marks):
            after = i + 1 if i + 1 < marks else 0
            one, low = active[i], angles[order[i]]
            high = angles[order[after]] + (0.0 if after else 2.0 * math.pi)
            while one != active[after] and corners < len(ends):
                low = corner(cuts, count, one, hx, hy, low, high)
                one = nearest(cuts, count, hx, hy, low)
                ends[corners], along[corners] = low, one
                corners += 1
        sums[:] = 0.0
        if corners == 0:
            add_piece(cuts, active[0], image, hx, hy, 0.0, 2.0 * math.pi, nodes, weights, sums)
        for i in range(corners):
            high = ends[i + 1] if i + 1 < corners else ends[0] + 2.0 * math.pi
            add_piece(cuts, along[i], image, hx, hy, ends[i], high, nodes, weights, sums)
        area = sums[0]
        mx, my = sums[1] / area, sums[2] / area
        x0, _, _ = polynomial(image[0], hx, hy)
        y0, _, _ = polynomial(image[1], hx, hy)
        shape[n, 0], shape[n, 1], shape[n, 2] = abs(area), x0 + mx, y0 + my
        shape[n, 3], shape[n, 4] = sums[3] / area - mx * mx, sums[4] / area - mx * my
        shape[n, 5] = sums[5] / area - my * my
        share[n] = min(1.0, sums[6] / math.pi)
