"""Arithmetic of one ray, and the compiled loops over many.

The `*_ray` functions have no branches, so the same source runs on numpy arrays (interpreted, broadcasting) and on
floats inside the compiled loops; neither fuses or reorders an operation, so both give the same bits. Constants come
as arrays indexed by component first (see `frames`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._jit import kernel, prange
from .frames import STOPS
from .status import Status

D_1, PER_D_2, PER_F_ML, PER_F = 0, 1, 2, 3
"""Places of a system's constants: d_1, 1/d_2, 1/f_ml, 1/f."""
SENSOR_X, ARRAY_X, LENS_X = 4, 6, 8
"""Decentres of sensor against MLA, MLA against lens, lens against the axis; y follows x."""
SHARE, REACH, LENS_RADIUS, HALF, ROUND, PUPIL_RADIUS = 10, 11, 12, 13, 14, 15
"""Weights of height and slope in the end point; radius of the lens; half width and roundness of a microlens; radius of
the flexible angular plane."""

BLOCK = 512
"""Rays per task of the compiled loops. Their scratch stays in the nearer caches and below the size at which malloc
gives memory back after every task, which halves the speed."""

COLUMNS = 6
"""Columns of a ledger before the stops': statuses from kept to untraceable."""
MAIN_LENS, MICROLENS, OFF_SENSOR = int(Status.MAIN_LENS), int(Status.MICROLENS), int(Status.OFF_SENSOR)
NEIGHBOUR, UNTRACEABLE, APERTURE = int(Status.NEIGHBOUR), int(Status.UNTRACEABLE), int(Status.APERTURE)
STOP_CODES = APERTURE - STOPS
"""A stop's status less its place in a stack of frames."""


@kernel()
def aligned_ray(
    d_1: Any, per_d_2: Any, per_f_ml: Any, per_f: Any, sensor: Any, array: Any, p: Any, c: Any, v: Any
) -> Any:
    """One coordinate of a backward ray where nothing is tilted: height against the lens's centre, object-side slope."""
    s = (((p - c) + sensor) - v) * per_d_2 + v * per_f_ml
    height = ((c + v) + array) - s * d_1
    return height, s + height * per_f


@kernel()
def posed_ray(k: Any, m: Any, px: Any, py: Any, cx: Any, cy: Any, vx: Any, vy: Any) -> Any:
    """Backward ray through tilted elements: height and slope in the lens's frame, and whether light can go that way."""
    dx = (((m[0, 0, 0] * px + m[0, 0, 1] * py) - cx) + m[0, 0, 3]) - vx
    dy = (((m[0, 1, 0] * px + m[0, 1, 1] * py) - cy) + m[0, 1, 3]) - vy
    dz = m[0, 2, 0] * px + m[0, 2, 1] * py + m[0, 2, 3]
    gx = dx + vx * (dz * k[PER_F_ML])
    gy = dy + vy * (dz * k[PER_F_ML])
    tx = m[1, 0, 0] * gx + m[1, 0, 1] * gy + m[1, 0, 2] * dz
    ty = m[1, 1, 0] * gx + m[1, 1, 1] * gy + m[1, 1, 2] * dz
    tz = m[1, 2, 0] * gx + m[1, 2, 1] * gy + m[1, 2, 2] * dz
    wx, wy = cx + vx, cy + vy
    wz = m[1, 2, 0] * wx + m[1, 2, 1] * wy + m[1, 2, 3]
    sx, sy = tx / tz, ty / tz
    lx = (m[1, 0, 0] * wx + m[1, 0, 1] * wy + m[1, 0, 3]) - sx * wz
    ly = (m[1, 1, 0] * wx + m[1, 1, 1] * wy + m[1, 1, 3]) - sy * wz
    face = m[0, 0, 2] * dx + m[0, 1, 2] * dy + m[0, 2, 2] * dz
    return lx, ly, sx + lx * k[PER_F], sy + ly * k[PER_F], (dz > 0.0) & (face > 0.0) & (tz > 0.0) & (wz > 0.0)


@kernel()
def crossing(m: Any, lx: Any, ly: Any, ox: Any, oy: Any) -> Any:
    """Height, slope and forwardness of an object-side ray in another element's frame."""
    tx = m[0, 0] * ox + m[0, 1] * oy + m[0, 2]
    ty = m[1, 0] * ox + m[1, 1] * oy + m[1, 2]
    tz = m[2, 0] * ox + m[2, 1] * oy + m[2, 2]
    sx, sy = tx / tz, ty / tz
    z = m[2, 0] * lx + m[2, 1] * ly + m[2, 3]
    ax = (m[0, 0] * lx + m[0, 1] * ly + m[0, 3]) - sx * z
    ay = (m[1, 0] * lx + m[1, 1] * ly + m[1, 3]) - sy * z
    return ax, ay, sx, sy, tz > 0.0


@kernel()
def pupil_ray(k: Any, m: Any, pupil: Any, ax: Any, ay: Any, cx: Any, cy: Any, vx: Any, vy: Any) -> Any:
    """Forward ray from a point of the FAP to a point of a microlens, and on to the sensor.

    The lens maps the FAP's point to (X, Y, Z, 1 + Z/f) in homogeneous coordinates, exactly and with nothing special
    at d_3 = f; the ray behind the lens is the line from the microlens's point to that image.
    """
    ux = pupil[0, 0] * ax + pupil[0, 1] * ay + pupil[0, 3]
    uy = pupil[1, 0] * ax + pupil[1, 1] * ay + pupil[1, 3]
    uz = pupil[2, 0] * ax + pupil[2, 1] * ay + pupil[2, 3]
    weight = 1.0 + uz * k[PER_F]
    bx, by = cx + vx, cy + vy
    wx = m[1, 0, 0] * bx + m[1, 0, 1] * by + m[1, 0, 3]
    wy = m[1, 1, 0] * bx + m[1, 1, 1] * by + m[1, 1, 3]
    wz = m[1, 2, 0] * bx + m[1, 2, 1] * by + m[1, 2, 3]
    tz = uz - weight * wz
    sx, sy = (ux - weight * wx) / tz, (uy - weight * wy) / tz
    lx, ly = wx - sx * wz, wy - sy * wz
    gx = m[1, 0, 0] * sx + m[1, 1, 0] * sy + m[1, 2, 0]
    gy = m[1, 0, 1] * sx + m[1, 1, 1] * sy + m[1, 2, 1]
    gz = m[1, 0, 2] * sx + m[1, 1, 2] * sy + m[1, 2, 2]
    dx, dy = gx / gz - vx * k[PER_F_ML], gy / gz - vy * k[PER_F_ML]
    qx, qy, qz = cx - m[0, 0, 3], cy - m[0, 1, 3], -m[0, 2, 3]
    ex = m[0, 0, 0] * dx + m[0, 1, 0] * dy + m[0, 2, 0]
    ey = m[0, 0, 1] * dx + m[0, 1, 1] * dy + m[0, 2, 1]
    ez = m[0, 0, 2] * dx + m[0, 1, 2] * dy + m[0, 2, 2]
    hx = (m[0, 0, 0] * qx + m[0, 1, 0] * qy + m[0, 2, 0] * qz) + (m[0, 0, 0] * vx + m[0, 1, 0] * vy)
    hy = (m[0, 0, 1] * qx + m[0, 1, 1] * qy + m[0, 2, 1] * qz) + (m[0, 0, 1] * vx + m[0, 1, 1] * vy)
    hz = (m[0, 0, 2] * qx + m[0, 1, 2] * qy + m[0, 2, 2] * qz) + (m[0, 0, 2] * vx + m[0, 1, 2] * vy)
    px, py = hx - ex / ez * hz, hy - ey / ez * hz
    return px, py, lx, ly, sx + lx * k[PER_F], sy + ly * k[PER_F], (gz > 0.0) & (ez > 0.0) & (hz < 0.0) & (wz > 0.0)


@kernel()
def in_microlens(k: Any, vx: Any, vy: Any) -> Any:
    """Whether an offset from a microlens's axis lies inside its clear aperture, rim included."""
    square = (abs(vx) <= k[HALF]) & (abs(vy) <= k[HALF])
    return square & ((k[ROUND] == 0.0) | (vx * vx + vy * vy <= k[HALF] * k[HALF]))


@kernel()
def own_cell(cell: Any, hexagonal: Any, px: Any, py: Any) -> Any:
    """Whether a sensor point lies in the cell: its centre, then the inverse lattice map row by row."""
    x, y = px - cell[0], py - cell[1]
    u, v = cell[2] * x + cell[3] * y, cell[4] * x + cell[5] * y
    slant = hexagonal * 0.8660254037844386 * v
    within = (abs(0.5 * u + slant) <= 0.5) & (abs(0.5 * u - slant) <= 0.5) & (abs(u) <= 0.5)
    return within & ((abs(v) <= 0.5) | (hexagonal > 0))


@kernel()
def line(values: Any, row: int, start: int, count: int, steps: Any, spare: Any) -> Any:
    """A block of a row: a view, or where one value serves the whole row, that value `count` times."""
    first = row * steps[0] + start * steps[1]
    if steps[1] == 1:
        return values[first : first + count]
    spare[:count] = values[first]
    return spare[:count]


@kernel()
def aligned_block(k: Any, axis: int, p: Any, c: Any, v: Any, heights: Any, slopes: Any, ends: Any) -> None:
    """Heights on the lens, slopes and end points of a block, in one coordinate."""
    d_1, per_d_2, per_f_ml, per_f = k[D_1], k[PER_D_2], k[PER_F_ML], k[PER_F]
    sensor, array, lens = k[SENSOR_X + axis], k[ARRAY_X + axis], k[LENS_X + axis]
    share, reach = k[SHARE], k[REACH]
    for j in range(p.size):
        height, slope = aligned_ray(d_1, per_d_2, per_f_ml, per_f, sensor, array, p[j], c[j], v[j])
        heights[j], slopes[j] = height, slope
        ends[j] = (height + lens) * share - slope * reach


@kernel()
def clip(x: Any, y: Any, radius: float, code: int, status: Any) -> None:
    """Mark what passes outside a circle about the origin; a ray on the rim, or one already marked, stays as it is."""
    limit = radius * radius
    for j in range(status.size):
        status[j] = status[j] if x[j] * x[j] + y[j] * y[j] <= limit else code


@kernel()
def begin(k: Any, vx: Any, vy: Any, status: Any) -> None:
    """First verdict of a block: kept, or outside its microlens."""
    for j in range(status.size):
        status[j] = 0 if in_microlens(k, vx[j], vy[j]) else MICROLENS


@kernel(parallel=True)
def aligned_ends(
    constants: Any, rims: Any, codes: Any, steps: Any, columns: int, points: Any, status: Any, x: Any, y: Any
) -> None:
    """Fates and end points of many rays of aligned systems; `backward` explains the layout."""
    blocks = (columns + BLOCK - 1) // BLOCK
    for task in prange(status.size // columns * blocks):
        row, start = task // blocks, task % blocks * BLOCK
        count = min(BLOCK, columns - start)
        system = row * steps[0, 0]
        k, out = constants[system], slice(row * columns + start, row * columns + start + count)
        spare = np.empty((10, BLOCK))
        lx, ly, ox, oy = spare[0, :count], spare[1, :count], spare[2, :count], spare[3, :count]
        vx = line(points[4], row, start, count, steps[3], spare[4])
        vy = line(points[5], row, start, count, steps[3], spare[5])
        for axis in range(2):
            p = line(points[axis], row, start, count, steps[1], spare[6])
            c = line(points[2 + axis], row, start, count, steps[2], spare[7])
            if axis == 0:
                aligned_block(k, axis, p, c, vx, lx, ox, x[out])
            else:
                aligned_block(k, axis, p, c, vy, ly, oy, y[out])
        begin(k, vx, vy, status[out])
        clip(lx, ly, k[LENS_RADIUS], MAIN_LENS, status[out])
        ax, ay = spare[8, :count], spare[9, :count]
        for i in range(codes.shape[1]):
            rim = rims[system, i]
            for j in range(count):
                ax[j] = (lx[j] + rim[0]) - ox[j] * rim[2]
                ay[j] = (ly[j] + rim[1]) - oy[j] * rim[2]
            clip(ax, ay, rim[3], codes[system, i], status[out])
        for j in range(count):
            finite = (lx[j] - lx[j]) + (ly[j] - ly[j]) == 0.0
            at = row * columns + start + j
            status[at] = status[at] if finite else UNTRACEABLE
            x[at], y[at] = (x[at], y[at]) if finite else (0.0, 0.0)


@kernel(parallel=True)
def posed_ends(
    constants: Any, maps: Any, rims: Any, codes: Any, steps: Any, columns: int, points: Any, status: Any, x: Any, y: Any
) -> None:
    """Fates and end points of many rays through tilted elements; `backward` explains the layout."""
    blocks = (columns + BLOCK - 1) // BLOCK
    for task in prange(status.size // columns * blocks):
        row, start = task // blocks, task % blocks * BLOCK
        count = min(BLOCK, columns - start)
        system = row * steps[0, 0]
        k, m = constants[system], maps[system]
        out = slice(row * columns + start, row * columns + start + count)
        fate, end_x, end_y = status[out], x[out], y[out]
        spare = np.empty((12, BLOCK))
        lx, ly, ox, oy, ax, ay = spare[0], spare[1], spare[2], spare[3], spare[4, :count], spare[5, :count]
        px = line(points[0], row, start, count, steps[1], spare[6])
        py = line(points[1], row, start, count, steps[1], spare[7])
        cx = line(points[2], row, start, count, steps[2], spare[8])
        cy = line(points[3], row, start, count, steps[2], spare[9])
        vx = line(points[4], row, start, count, steps[3], spare[10])
        vy = line(points[5], row, start, count, steps[3], spare[11])
        dead = np.zeros(count, np.bool_)
        begin(k, vx, vy, fate)
        for j in range(count):
            lx[j], ly[j], ox[j], oy[j], good = posed_ray(k, m, px[j], py[j], cx[j], cy[j], vx[j], vy[j])
            hx, hy, sx, sy, front = crossing(m[2], lx[j], ly[j], ox[j], oy[j])
            end_x[j], end_y[j] = hx * k[SHARE] - sx * k[REACH], hy * k[SHARE] - sy * k[REACH]
            dead[j] = not (good & front)
        clip(lx, ly, k[LENS_RADIUS], MAIN_LENS, fate)
        for i in range(codes.shape[1]):
            for j in range(count):
                ax[j], ay[j], sx, sy, front = crossing(m[codes[system, i] - STOP_CODES], lx[j], ly[j], ox[j], oy[j])
                dead[j] |= not front
            clip(ax, ay, rims[system, i, 3], codes[system, i], fate)
        for j in range(count):
            finite = (lx[j] - lx[j]) + (ly[j] - ly[j]) == 0.0
            if not finite or dead[j]:
                fate[j], end_x[j], end_y[j] = UNTRACEABLE, 0.0, 0.0


@kernel(parallel=True)
def pupil_ledger(
    constants: Any, maps: Any, rims: Any, codes: Any, step: int, cells: Any, hexagonal: Any, samples: Any, counts: Any
) -> None:
    """Count the fates of the same samples of the pupil for many microlenses; `budget` explains the layout."""
    blocks = counts.shape[1]
    for task in prange(counts.shape[0] * blocks):
        row, part = task // blocks, task % blocks
        k, m, cell, ledger = constants[row * step], maps[row * step], cells[row], counts[row, part]
        size = (samples.shape[1] + blocks - 1) // blocks
        for j in range(part * size, min((part + 1) * size, samples.shape[1])):
            sx, sy, vx, vy = samples[0, j], samples[1, j], samples[2, j] * k[HALF], samples[3, j] * k[HALF]
            px, py, lx, ly, ox, oy, good = pupil_ray(
                k, m, m[-1], sx * k[PUPIL_RADIUS], sy * k[PUPIL_RADIUS], cell[8], cell[9], vx, vy
            )
            fate = 0 if own_cell(cell, hexagonal, px, py) else NEIGHBOUR
            if not ((abs(px) <= cell[6]) & (abs(py) <= cell[7])):
                fate = OFF_SENSOR
            if not lx * lx + ly * ly <= k[LENS_RADIUS] * k[LENS_RADIUS]:
                fate = MAIN_LENS
            for i in range(codes.shape[1]):
                code = codes[row * step, i]
                ax, ay, _, _, front = crossing(m[code - STOP_CODES], lx, ly, ox, oy)
                good &= front
                radius = rims[row * step, i, 3]
                if code != APERTURE and not ax * ax + ay * ay <= radius * radius:
                    fate = code - APERTURE + COLUMNS
            if not good or (lx - lx) + (ly - ly) + (px - px) + (py - py) != 0.0:
                fate = UNTRACEABLE
            ledger[fate] += 1
