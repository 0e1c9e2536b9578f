"""Many builds of a camera behind a real lens: aimed rays and their spots.

A ray from a microlens is wanted that meets the flexible angular plane (FAP) at a given point. Its slope is found by
Broyden's method from the nominal camera's slope and Jacobian: builds differ little, so two to five rays do, and no
derivative is ever taken. Everything is traced through every build's own lens, the rays of one build together.
"""

from __future__ import annotations

import math
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import DISC_RULE
from .._jit import kernel
from ..lenses.tracer import BLOCK, COLUMNS, KEPT, ROWS, SurfaceStack, pass_surfaces
from .camera import FOUND, LOST, LensCamera, Train, aim_beyond, sensor_of_pupil, views

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE, CORRECTIONS = 1e-11, 12
"""How near the FAP's point rays must come, in its radius, and after how many corrections at most they are given up."""


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
    """Aimed rays: N jobs of n each, nan for those that do not come through."""

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
    # Of one layout: kernels are compiled once more for another.
    alike = Aims(*map(np.ascontiguousarray, wanted))
    aim.compiled(
        trial, begin, *counted(lens), *counted(beyond), planes.array, planes.sensor, planes.rims, half, *alike,
        TOLERANCE, CORRECTIONS, landed, heights, miss,
    )  # fmt: skip
    lost = ~(miss <= 1e3 * TOLERANCE)
    landed[lost], heights[lost] = np.nan, np.nan
    return Aimed(landed, heights)


def counted(part: SurfaceStack) -> tuple[Array, int, Array]:
    """Arguments that kernels take of a stack: its table, how many surfaces, the media between."""
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
        aim_all.compiled(*counted(train.beyond), ends, run)
    x, y, z = np.moveaxis(through, -1, 0)
    end = planes.array[:, 2]
    passed = train.lens.through(
        (x, y), np.moveaxis(run[..., :2] / run[..., 2:], -1, 0), start=z, end=end, backward=False
    )
    place = np.stack([*passed.height, np.broadcast_to(end[:, None], z.shape)], axis=-1)
    way = np.stack([*passed.slope, np.ones(z.shape)], axis=-1)
    landed = np.concatenate([crossings(place, way, plane[:, None]) for plane in (planes.array, planes.sensor)], axis=-1)
    landed[passed.state != KEPT] = np.nan
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


def received(shape: Array, base: Array, array: Array, sensor: Array) -> Array:
    """Projected solid angles under which microlenses see the lit parts of their images [sr], (N,).

    Radiance is the same all along a ray, so this is the light that a microlens gets of a uniform scene, per unit of its
    area: the integral of the cosine at the array over the solid angle. Taken over the ellipse with the same moments.

    Parameters
    ----------
    shape : ndarray, (N, 6)
        Area, centroid, central second moments (xx, xy, yy) [mm], in the sensor's own coordinates.
    base : ndarray, (N, 2)
        Microlenses, in the array's own coordinates [mm].
    array, sensor : ndarray, (N, 12) or (12,)
        As `Planes` has them.
    """
    area, x, y, xx, xy, yy = np.moveaxis(shape, -1, 0)
    wide = 2 * np.sqrt(np.maximum(xx, 0.0))
    lean = np.divide(4 * xy, wide, out=np.zeros_like(wide), where=wide > 0)
    high = np.sqrt(np.maximum(4 * yy - lean * lean, 0.0))

    def lifted(plane: Array, u: Array, v: Array) -> Array:
        return np.asarray(plane[..., :3] + u[..., None] * plane[..., 3:6] + v[..., None] * plane[..., 6:9])

    start, mean = lifted(array, base[..., 0], base[..., 1]), np.zeros_like(area)
    for radius, angle, weight in DISC_RULE:
        u, v = radius * math.cos(angle), radius * math.sin(angle)
        run = lifted(sensor, x + wide * u, y + lean * u + high * v) - start
        leans = [np.sum(run * plane[..., 9:12], axis=-1) for plane in (array, sensor)]
        mean += weight * leans[0] * leans[1] / np.sum(run * run, axis=-1) ** 2
    return np.asarray(area * mean)


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
    frame = np.ascontiguousarray(world)  # kernels are compiled once more for another layout
    spots.compiled(*counted(train.lens), *counted(train.beyond), plane, rims, frame, *rays, w, size)
    return size
