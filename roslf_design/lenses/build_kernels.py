"""Rays through many builds of a camera, each ray aimed: the loops.

A ray from a microlens is wanted that meets the flexible angular plane (FAP) at a given point. Its slope is found by
Broyden's method from the nominal camera's slope and Jacobian: builds differ little, so two to five rays do, and no
derivative is ever taken. Rays of one build are taken together, through the same passes as `kernels.trace_rays`.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from .._jit import kernel, prange
from .kernels import BLOCK, COLUMNS, CONIC, ROWS, SPHERE, meet_asphere, meet_conic, meet_sphere, turn

PLANE, RIM = 12, 13
"""Numbers of a plane (origin, x, y, normal) and of a rim (the same and its radius)."""
PIECE = 64
"""Builds that a thread takes at once."""
LOST = 1e300
"""Size of the miss of a ray that did not come through the lens."""


@kernel()
def through(buffer: Any, m: int, table: Any, count: int, index: Any, backward: bool, heights: Any) -> None:
    """Carry a block of rays through a lens whose rims stop nothing; `heights` gets r^2 over each surface's axis."""
    s = -1.0 if backward else 1.0
    for j in range(count):
        k = count - 1 - j if backward else j
        first = k * COLUMNS
        before, after = (index[k + 1], index[k]) if backward else (index[k], index[k + 1])
        kind, code, mu = int(table[first + 6]), 8.0 * (k + 1), before / after
        turned = table[first + 7] != 0
        if turned:
            turn(buffer, m, table, first, True)
        if kind == SPHERE:
            meet_sphere(buffer, m, table, first, 1e300, mu, s, code)
        elif kind == CONIC:
            meet_conic(buffer, m, table, first, 1e300, mu, s, code)
        else:
            meet_asphere(buffer, m, table, first, 1e300, mu, s, code)
        if turned:
            turn(buffer, m, table, first, False)
        for i in range(m):
            heights[k * BLOCK + i] = buffer[8 * BLOCK + i]


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
    trial: Any,
    begin: Any,
    table: Any,
    count: int,
    index: Any,
    array: Any,
    sensor: Any,
    rims: Any,
    half: Any,
    base: Any,
    offset: Any,
    target: Any,
    start: Any,
    inverse: Any,
    tolerance: float,
    most: int,
    landed: Any,
    heights: Any,
    miss: Any,
) -> None:
    """Aim rays of N jobs, n <= BLOCK rays each, and tell where they meet the sensor and every rim.

    Parameters
    ----------
    trial, begin : (N,)
        The build of each job, and its first ray in the lists of rays.
    table, index, array, sensor, rims : (T, ...)
        The builds: lens, planes of 12 numbers, rims (R of 13, the FAP first).
    half : (T,)
        Half the microlens pitch.
    base, offset : (rays, 2)
        Where a ray meets the array, in its own coordinates: base plus offset times half.
    target : (rays, 2)
        Where it is to meet the FAP, in its own coordinates and units of its radius.
    start, inverse : (rays, 2), (rays, 4)
        Slopes to begin with, and the inverse of d(target)/d(slope).
    tolerance, most
        In the target's units, and how many corrections at most.
    landed : (N, n, 2)
        Gets sensor points, in the sensor's own coordinates.
    heights : (N, n, S + R - 1)
        Gets squared heights over those of the rims: of each surface, then of the further stops.
    miss : (N, n)
        Gets what is left between ray and target; `LOST` for a ray that does not come through.
    """
    n = landed.shape[1]
    stops = rims.shape[1]
    buffer, radii = np.empty(ROWS * BLOCK), np.empty(count * BLOCK)
    px, py, pz = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    sx, sy, ex, ey = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    dx, dy, left = np.zeros(BLOCK), np.zeros(BLOCK), np.empty(BLOCK)
    a, b, c, d = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for job in range(len(trial)):
        t, first = trial[job], begin[job]
        lens, media, plane = table[t], index[t], array[t]
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
            through(buffer, n, lens, count, media, True, radii)
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
            miss[job, i] = left[i]
            # What is left of the miss is undone to first order: no ray is spent on the last digits.
            tx, ty = sx[i] - (a[i] * ex[i] + b[i] * ey[i]), sy[i] - (c[i] * ex[i] + d[i] * ey[i])
            landed[job, i, 0], landed[job, i, 1] = crossing(px[i], py[i], pz[i], tx, ty, sensor[t])


@kernel()
def send(
    t: int, table: Any, count: int, media: Any, rims: Any, world: Any, point: Any, pupil: Any, first: int, m: int,
    buffer: Any, radii: Any, cut: Any,
) -> None:  # fmt: skip
    """Send `m` rays of build `t` from object points through FAP points and the lens; `cut` tells what rims stop."""
    lens, fap, stops = table[t], rims[t, 0], rims.shape[1]
    for i in range(m):
        u, v = pupil[first + i, 0] * fap[12], pupil[first + i, 1] * fap[12]
        x = fap[0] + u * fap[3] + v * fap[6]
        y = fap[1] + u * fap[4] + v * fap[7]
        z = fap[2] + u * fap[5] + v * fap[8]
        ax, ay = x - (point[first + i, 0] + world[t, 0]), y - (point[first + i, 1] + world[t, 1])
        az = z - (point[first + i, 2] + world[t, 2])
        shrink = 1.0 / sqrt(ax * ax + ay * ay + az * az)
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = x, y, z
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = ax * shrink, ay * shrink, az * shrink
        buffer[6 * BLOCK + i] = 0.0
        cut[i] = 0.0
    for k in range(1, stops):
        rim = rims[t, k]
        for i in range(m):
            x, y, z = buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i]
            up = buffer[5 * BLOCK + i]
            hx, hy = crossing(x, y, z, buffer[3 * BLOCK + i] / up, buffer[4 * BLOCK + i] / up, rim)
            cut[i] = 1.0 if hx * hx + hy * hy > rim[12] * rim[12] else cut[i]
    through(buffer, m, lens, count, media[t], False, radii)
    for k in range(count):
        for i in range(m):
            cut[i] = 1.0 if radii[k * BLOCK + i] > lens[k * COLUMNS + 5] else cut[i]


@kernel()
def land(
    table: Any, count: int, media: Any, array: Any, sensor: Any, rims: Any, world: Any, point: Any, pupil: Any,
    landed: Any, lost: Any,
) -> None:  # fmt: skip
    """Send rays from object points through FAP points to the array and the sensor; rims stop none.

    Parameters
    ----------
    table, media, array, sensor, rims : (T, ...)
        As for `aim`.
    world : (T, 3)
        What the object points' frame is shifted by against the lens's.
    point : (n, 3)
        Object points [mm].
    pupil : (n, 2)
        FAP points, in its own coordinates and units of its radius.
    landed : (T, n, 4)
        Gets points of the array, then of the sensor, each in its own coordinates.
    lost : (T, n)
        Gets whether the ray did not come through the lens.
    """
    n = landed.shape[1]
    buffer, radii, cut = np.empty(ROWS * BLOCK), np.empty(count * BLOCK), np.empty(BLOCK)
    for t in range(len(landed)):
        for first in range(0, n, BLOCK):
            m = min(BLOCK, n - first)
            send(t, table, count, media, rims, world, point, pupil, first, m, buffer, radii, cut)
            for i in range(m):
                up = buffer[5 * BLOCK + i]
                ox, oy = buffer[3 * BLOCK + i] / up, buffer[4 * BLOCK + i] / up
                x, y, z = buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i]
                landed[t, first + i, 0], landed[t, first + i, 1] = crossing(x, y, z, ox, oy, array[t])
                landed[t, first + i, 2], landed[t, first + i, 3] = crossing(x, y, z, ox, oy, sensor[t])
                lost[t, first + i] = buffer[6 * BLOCK + i] != 0.0


@kernel()
def spot_sizes(
    t: int, table: Any, count: int, media: Any, plane: Any, rims: Any, world: Any, point: Any, pupil: Any, weight: Any,
    buffer: Any, radii: Any, cut: Any, lx: Any, ly: Any, size: Any,
) -> None:  # fmt: skip
    """Root-mean-square radii of the spots of build `t`: see `spots`; the last arrays before `size` are room to work."""
    each = len(weight)
    total = len(point)
    for first in range(0, total, BLOCK):
        m = min(BLOCK, total - first)
        send(t, table, count, media, rims, world, point, pupil, first, m, buffer, radii, cut)
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


@kernel()
def spots(
    table: Any, count: int, media: Any, plane: Any, rims: Any, world: Any, point: Any, pupil: Any, weight: Any,
    size: Any,
) -> None:  # fmt: skip
    """Root-mean-square radii on a plane of the light from object points, about its centroid.

    Parameters
    ----------
    table, media, plane, rims, world
        T builds, as for `land`; `plane` is where the spots are seen.
    point, pupil : (F * P, 3), (F * P, 2)
        Rays, the P of each object point together.
    weight : (P,)
        Of the rays; those that a rim stops do not count.
    size : (T, F)
        Gets the radii [mm]; nan where no ray comes through.
    """
    buffer, radii, cut = np.empty(ROWS * BLOCK), np.empty(count * BLOCK), np.empty(BLOCK)
    lx, ly = np.empty(len(point)), np.empty(len(point))
    for t in range(len(size)):
        spot_sizes(t, table, count, media, plane, rims, world, point, pupil, weight, buffer, radii, cut, lx, ly, size)


@kernel(parallel=True)
def spots_on_all_threads(
    table: Any, count: int, media: Any, plane: Any, rims: Any, world: Any, point: Any, pupil: Any, weight: Any,
    size: Any,
) -> None:  # fmt: skip
    """`spots` with the builds shared out over threads; the same numbers."""
    pieces = (len(size) + PIECE - 1) // PIECE
    for piece in prange(pieces):
        buffer, radii, cut = np.empty(ROWS * BLOCK), np.empty(count * BLOCK), np.empty(BLOCK)
        lx, ly = np.empty(len(point)), np.empty(len(point))
        for t in range(piece * PIECE, min(len(size), (piece + 1) * PIECE)):
            spot_sizes(
                t, table, count, media, plane, rims, world, point, pupil, weight, buffer, radii, cut, lx, ly, size
            )
