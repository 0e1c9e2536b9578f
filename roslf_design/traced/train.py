"""Surfaces that rays meet in builds of a camera behind a real lens, rays aimed through it, and their spots.

A ray is wanted from a point to another one behind some faces: from a microlens to the flexible angular plane (FAP), or
from there to the scene. Its slope is found by Broyden's method. Builds of a study start from the nominal camera's slope
and Jacobian: they differ little, so two to five rays do, and no derivative is ever taken; else a ray starts where first
order has it, with differences for derivatives. A single camera is one build.
"""

from __future__ import annotations

import math
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import DISC_RULE
from .._jit import kernel
from ..bore.faces import KIND, LIMIT, OPEN, STOP
from ..bore.opening import ClearAperture
from ..fates import RayFate
from ..lenses.tracer import BLOCK, COLUMNS, MAPPED, ROWS, SPHERE, SurfaceStack, pass_surfaces
from ..theory.object_space import FAP, ObjectSpaceFaces

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE, CORRECTIONS = 1e-11, 12
"""Tolerance within which rays meet the FAP's point, in its radius, and corrections after which they are given up."""
AFRESH, PATIENCE, NUDGE = 8, 24, 1e-5
"""After so many corrections derivatives are taken again; corrections of rays that start from first order, and the steps
in slope that derivatives are taken with."""
LOST = 1e300
"""Size of the miss of a ray that did not come through."""
NEAR = 1e-11
"""Distance within which rays meet the point of the scene that they are aimed at, from up to 100 mm away [mm]."""
FOUND = 1e3
"""Multiple of that distance which still counts, where they cannot come nearer."""


class Train(NamedTuple):
    """Train of surfaces that rays meet on either side of the FAP, in the lens's frame; builds lead."""

    lens: SurfaceStack
    """The main lens, and before it what stands between it and the FAP."""
    beyond: SurfaceStack
    """Surfaces before the FAP; a stack without surfaces where there are none."""

    @classmethod
    def in_air(cls, lens: SurfaceStack) -> Train:
        """A lens before which nothing stands."""
        builds = len(lens.table)
        return cls(lens, SurfaceStack(np.empty((builds, 0)), np.ones((builds, 1))))

    @classmethod
    def of(cls, lens: SurfaceStack, ahead: ObjectSpaceFaces, origin: ArrayLike) -> Train:
        """A lens and what stands before it.

        Parameters
        ----------
        lens : SurfaceStack
            T builds.
        ahead : ObjectSpaceFaces
            Of the same builds.
        origin : array_like
            Where those faces' frame has its origin in the lens's [mm], (3,) or (T, 3).
        """
        builds = len(lens.table)
        table = np.array(np.broadcast_to(ahead.table, (builds, *ahead.table.shape[-2:])))
        table[..., :3] += np.broadcast_to(np.asarray(origin, float), (builds, 3))[:, None]
        media = np.broadcast_to(ahead.media, (builds, *ahead.media.shape[-2:]))
        fap = np.argmax(np.broadcast_to(ahead.openings, table.shape[:2]) == FAP, axis=1)[:, None, None]
        # A build with fewer faces on a side than others meets the FAP's plane there instead, which does nothing.
        bare, beside = (np.take_along_axis(part, fap, axis=1) for part in (table, media))
        bare[..., LIMIT] = OPEN
        table, media, none = np.concatenate([table, bare], 1), np.concatenate([media, beside], 1), table.shape[1]
        inside, outside = np.arange(fap.max())[:, None], np.arange(fap.min() + 1, none)[:, None]
        law, sides = np.broadcast_to(ahead.law.ravel(), (builds, ahead.law.size)), []
        for rows, medium in (
            (np.where(inside < fap, inside, none), media[:, :1, 1]),
            (np.where(outside > fap, outside, none), beside[..., 0]),
        ):
            met, indices = (np.take_along_axis(part, rows, axis=1) for part in (table, media))
            sides.append((_stack(met, indices, medium), law if MAPPED in met[..., KIND] else law[:, :0]))
        (near, near_law), (far, far_law) = sides
        own = SurfaceStack(
            np.concatenate([near.table, lens.table, near_law], axis=1),
            np.concatenate([near.media[:, :-1], lens.media], axis=1),
        )
        return cls(own, far._replace(table=np.concatenate([far.table, far_law], axis=1)))

    @classmethod
    def before(cls, *ahead: ObjectSpaceFaces) -> Train:
        """Faces before an ideal lens in air, from there outwards, of one build and in its own frame, all `beyond`."""
        rows, sides = (np.concatenate(parts)[None] for parts in zip(*((a.table, a.media) for a in ahead), strict=True))
        far = _stack(rows, sides, np.ones((1, 1)))
        far = far._replace(table=np.concatenate([far.table, ahead[0].law.reshape(1, -1)], axis=1))
        return cls(SurfaceStack(np.empty((1, 0)), np.ones((1, 1))), far)


def _stack(rows: Array, sides: Array, medium: Array) -> SurfaceStack:
    """Faces (T, S) from the lens outwards in the order of the light, which comes out of the last into a medium.

    Stops, which the tracer does not know, are planes of their reach.
    """
    rows, sides = rows[:, ::-1].copy(), sides[:, ::-1]
    rows[rows[..., KIND] == STOP, KIND] = SPHERE
    return SurfaceStack(rows.reshape(len(rows), -1), np.concatenate([sides[..., 0], medium], axis=1))


def fap_of(ahead: ObjectSpaceFaces) -> int:
    """Number of faces between main lens and FAP."""
    return int(np.flatnonzero(ahead.openings == FAP)[0])


class Planes(NamedTuple):
    """Planes of the parts around the lens in T builds: origins, axes x and y and normals, in the lens's frame [mm]."""

    array: Array
    """(T, 12)."""
    sensor: Array
    """(T, 12)."""
    rims: Array
    """FAP, then further stops, each with its axes along its sides, half of both and their number, 1 of a disc, (T, R,
    15)."""

    @property
    def straight(self) -> list[bool]:
        """Which rims have straight sides, (R,)."""
        return [bool(count > 1) for count in self.rims[0, :, 14]]

    @property
    def lengths(self) -> Array:
        """Distance of every rim's sides from its centre, but for the FAP's, (T, L) [mm]: of a disc its radius."""
        rows = [self.rims[:, k, [12, 12, 13, 13] if straight else [12]] for k, straight in enumerate(self.straight)]
        return np.concatenate([self.rims[:, 0, :0], *rows[1:]], axis=1)

    def unsquared(self, heights: Array, before: int) -> Array:
        """Heights from those of `AimedRays`, of which so many are surfaces' before the stops'."""
        linear = np.repeat(self.straight[1:], [4 if straight else 1 for straight in self.straight[1:]])
        squared = np.ones(heights.shape[-1], np.bool_)
        squared[before : before + len(linear)] = ~linear.astype(np.bool_)
        return np.where(squared, np.sqrt(np.where(squared, heights, 0.0)), heights)


def rim_row(pose: Array, opening: ClearAperture) -> Array:
    """Numbers (..., 15) of stops, as `Planes.rims` has them, from their poses (..., 12)."""
    if opening.half is None:
        half, sides, turn = (opening.radius, opening.radius), 1.0, np.zeros(())
    else:
        half, sides, turn = opening.half, 4.0, np.asarray(opening.turn)
    cosine, sine = np.cos(turn)[..., None], np.sin(turn)[..., None]
    x, y = pose[..., 3:6], pose[..., 6:9]
    axes = pose[..., :3], cosine * x + sine * y, cosine * y - sine * x, pose[..., 9:]
    numbers = (np.broadcast_to(np.asarray(part, float), pose.shape[:-1])[..., None] for part in (*half, sides))
    return np.concatenate([*(np.broadcast_to(part, (*pose.shape[:-1], 3)) for part in axes), *numbers], axis=-1)


@kernel()
def side_height(x: float, y: float, rim: Any, side: int) -> float:
    """Height of a point over that of one of a rim's sides: of straight ones, of a disc squared; above 1 outside."""
    if rim[14] == 1.0:
        x, y = x / rim[12], y / rim[13]
        return float(x * x + y * y)
    if side < 2:
        return float((x if side == 0 else -x) / rim[12])
    return float((y if side == 2 else -y) / rim[13])


@kernel()
def crossing(x: float, y: float, z: float, sx: float, sy: float, plane: Any) -> tuple[float, float]:
    """Point where the line through a point with slopes dx/dz, dy/dz crosses a plane, in the plane's own coordinates."""
    ox, oy, oz = x - plane[0], y - plane[1], z - plane[2]
    lean = plane[9] * sx + plane[10] * sy + plane[11]
    step = -(plane[9] * ox + plane[10] * oy + plane[11] * oz) / lean
    hx, hy, hz = ox + step * sx, oy + step * sy, oz + step
    return plane[3] * hx + plane[4] * hy + plane[5] * hz, plane[6] * hx + plane[7] * hy + plane[8] * hz


@kernel()
def _meet(
    n: int, ray: Any, sx: Any, sy: Any, table: Any, media: Any, count: int, target: Any, axes: Any, buffer: Any,
    radii: Any, fx: Any, fy: Any, far: Any,
) -> None:  # fmt: skip
    """Trace rays and tell where they cross planes through their targets, from there along two axes.

    `far` is the larger of both, `LOST` for a ray that does not come through.
    """
    px, py, pz = ray
    gx, gy, gz = target
    for i in range(n):
        shrink = 1.0 / sqrt(1.0 + sx[i] * sx[i] + sy[i] * sy[i])
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = px[i], py[i], pz[i]
        buffer[3 * BLOCK + i] = -sx[i] * shrink
        buffer[4 * BLOCK + i] = -sy[i] * shrink
        buffer[5 * BLOCK + i] = -shrink
        buffer[6 * BLOCK + i] = 0.0
    pass_surfaces(buffer, n, table, media, count, True, False, radii)
    for i in range(n):
        down = buffer[5 * BLOCK + i]
        alive = buffer[6 * BLOCK + i] == 0.0 and down < 0.0
        wx, wy = buffer[3 * BLOCK + i] / (down if alive else 1.0), buffer[4 * BLOCK + i] / (down if alive else 1.0)
        ox, oy, oz = buffer[i] - gx[i], buffer[BLOCK + i] - gy[i], buffer[2 * BLOCK + i] - gz[i]
        lean = axes[6] * wx + axes[7] * wy + axes[8]
        step = -(axes[6] * ox + axes[7] * oy + axes[8] * oz) / lean
        hx, hy, hz = ox + step * wx, oy + step * wy, oz + step
        fx[i] = axes[0] * hx + axes[1] * hy + axes[2] * hz
        fy[i] = axes[3] * hx + axes[4] * hy + axes[5] * hz
        miss = max(abs(fx[i]), abs(fy[i]))
        far[i] = miss if alive and miss < LOST else LOST


@kernel()
def _aim_block(
    n: int, ray: Any, slope: Any, home: Any, inverse: Any, known: bool, table: Any, media: Any, count: int,
    target: Any, axes: Any, tolerance: Any, most: int, work: Any,
) -> None:  # fmt: skip
    """Slopes of n <= BLOCK rays through some surfaces that meet points behind them, and how far they miss those.

    Parameters
    ----------
    ray : tuple
        Points x, y and z where they start, (n,) each.
    slope, home : tuple
        First guesses dx/dz, dy/dz, which get the nearest approach; and where to turn back to where those are lost.
    inverse : tuple
        Inverse of d(miss)/d(slope), row by row, (n,) each; not `known`, it is taken from nudged rays.
    target, axes
        Points x, y and z; two axes, over the units of misses along them, and the normal (9,) of planes through them.
    tolerance : (n,)
        Of a miss; corrections end when all are met, after `most` at the latest.
    work : tuple
        Room; its first two are the tracer's, which has met the surfaces by those rays; the next three get the misses
        along both axes and the larger.
    """
    sx, sy = slope
    a, b, c, d = inverse
    buffer, radii, ex, ey, left, bx, by, fx, fy, far, ux, uy = work
    for i in range(n):
        bx[i], by[i], ex[i], ey[i], left[i] = sx[i], sy[i], 0.0, 0.0, LOST
    for step in range(most + 1):
        afresh = step % AFRESH == 0 and (step > 0 or not known)
        for probe in range(2 if afresh else 0):
            for i in range(n):
                ux[i] = (sx[i] if left[i] == LOST else bx[i]) + (NUDGE if probe == 0 else 0.0)
                uy[i] = (sy[i] if left[i] == LOST else by[i]) + (NUDGE if probe == 1 else 0.0)
            _meet(n, ray, ux, uy, table, media, count, target, axes, buffer, radii, fx, fy, far)
            for i in range(n):
                a[i], b[i], c[i], d[i] = (fx[i], fy[i], 0.0, 0.0) if probe == 0 else (a[i], b[i], fx[i], fy[i])
        _meet(n, ray, sx, sy, table, media, count, target, axes, buffer, radii, fx, fy, far)
        for i in range(n if afresh else 0):
            gx, gy = (fx[i], fy[i]) if left[i] == LOST else (ex[i], ey[i])
            xx, yx, xy, yy = (a[i] - gx) / NUDGE, (b[i] - gy) / NUDGE, (c[i] - gx) / NUDGE, (d[i] - gy) / NUDGE
            area = xx * yy - xy * yx
            area = 1.0 / area if 0.0 < abs(area) < LOST else 0.0
            a[i], b[i], c[i], d[i] = yy * area, -xy * area, -yx * area, xx * area
        moving = False
        for i in range(n):
            if left[i] <= tolerance[i]:
                continue
            dx, dy, nearer = sx[i] - bx[i], sy[i] - by[i], far[i] < left[i]
            if left[i] < LOST and far[i] < LOST:  # the inverse that explains the step just made
                gx, gy = fx[i] - ex[i], fy[i] - ey[i]
                wx, wy = a[i] * gx + b[i] * gy, c[i] * gx + d[i] * gy
                size = dx * wx + dy * wy
                if size != 0.0:
                    rx, ry = (dx - wx) / size, (dy - wy) / size
                    va, vb = dx * a[i] + dy * c[i], dx * b[i] + dy * d[i]
                    a[i], b[i], c[i], d[i] = a[i] + rx * va, b[i] + rx * vb, c[i] + ry * va, d[i] + ry * vb
            if nearer:
                bx[i], by[i], ex[i], ey[i], left[i] = sx[i], sy[i], fx[i], fy[i], far[i]
            if left[i] <= tolerance[i]:
                continue
            if left[i] == LOST:  # no ray yet: half way back to where there may be one
                dx, dy = 0.5 * (home[0][i] - sx[i]), 0.5 * (home[1][i] - sy[i])
                sx[i], sy[i] = sx[i] + dx, sy[i] + dy
                bx[i], by[i] = sx[i], sy[i]
                moving = moving or abs(dx) + abs(dy) > 1e-9
                continue
            moving = True
            mx, my = -(a[i] * ex[i] + b[i] * ey[i]), -(c[i] * ex[i] + d[i] * ey[i])
            if not nearer:  # no farther than half of what went astray
                long, short = sqrt(mx * mx + my * my), 0.5 * sqrt(dx * dx + dy * dy)
                part = short / long if long > short else 1.0
                mx, my = (mx * part, my * part) if far[i] < LOST else (0.5 * dx, 0.5 * dy)
            sx[i], sy[i] = bx[i] + mx, by[i] + my
        if not moving:
            break
        if step >= most - 1:
            for i in range(n):
                sx[i], sy[i] = bx[i], by[i]
    for i in range(n):
        sx[i], sy[i] = bx[i], by[i]


@kernel()
def _room_to_aim(count: int) -> Any:
    """Working arrays of `_aim_block`, for so many surfaces."""
    radii = np.empty(max(1, count) * BLOCK)
    one, two, three, four, five = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    six, seven, eight, nine, ten = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    return np.empty(ROWS * BLOCK), radii, one, two, three, four, five, six, seven, eight, nine, ten


@kernel()
def _aim(
    trial: Any, begin: Any, table: Any, count: int, media: Any, outer: Any, outer_count: int, outer_media: Any,
    array: Any, sensor: Any, rims: Any, half: Any, base: Any, offset: Any, target: Any, start: Any, home: Any,
    inverse: Any, known: bool, tolerance: float, most: int, landed: Any, heights: Any, miss: Any,
) -> None:  # fmt: skip
    """Aim rays of N jobs, n <= BLOCK rays each, and tell where they meet the sensor and every rim.

    Parameters
    ----------
    trial, begin : (N,)
        The build of each job, and its first ray in the lists of rays.
    table, media, outer, outer_media, array, sensor, rims, half : (T, ...)
        The builds: lens, what stands before the FAP, planes of 12 numbers, rims (R of 15, the FAP first), half the
        microlens pitch.
    base, offset, target, start, home, inverse : (rays, ...)
        As `RayTargets` has them, and where rays turn back to that are lost; `inverse` where it is `known`. `tolerance`
        is in the target's units, `most` the corrections at most.
    landed, heights, miss : (N, n, ...)
        Get what `AimedRays` has, `LOST` as the miss of a ray that does not come through.
    """
    n, stops, beyond = landed.shape[1], rims.shape[1], heights.shape[2] - outer_count
    work = _room_to_aim(count + outer_count)
    buffer, radii, ex, ey, left = work[:5]
    ray, goal = (np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)), (np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK))
    slope, away = (np.empty(BLOCK), np.empty(BLOCK)), (np.empty(BLOCK), np.empty(BLOCK))
    turned = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    (px, py, pz), (gx, gy, gz), (sx, sy), (a, b, c, d) = ray, goal, slope, turned
    enough, axes = np.empty(BLOCK), np.empty(9)
    enough[:] = tolerance
    for job in range(len(trial)):
        t, first = trial[job], begin[job]
        lens, index, plane = table[t], media[t], array[t]
        fap = rims[t, 0]
        for k in range(3):
            axes[k], axes[3 + k], axes[6 + k] = fap[3 + k] / fap[12], fap[6 + k] / fap[13], fap[9 + k]
        for i in range(n):
            u = base[first + i, 0] + offset[first + i, 0] * half[t]
            v = base[first + i, 1] + offset[first + i, 1] * half[t]
            px[i] = plane[0] + u * plane[3] + v * plane[6]
            py[i] = plane[1] + u * plane[4] + v * plane[7]
            pz[i] = plane[2] + u * plane[5] + v * plane[8]
            u, v = target[first + i, 0] * fap[12], target[first + i, 1] * fap[13]
            gx[i] = fap[0] + u * fap[3] + v * fap[6]
            gy[i] = fap[1] + u * fap[4] + v * fap[7]
            gz[i] = fap[2] + u * fap[5] + v * fap[8]
            sx[i], sy[i] = start[first + i, 0], start[first + i, 1]
            away[0][i], away[1][i] = home[first + i, 0], home[first + i, 1]
            a[i], b[i] = inverse[first + i, 0], inverse[first + i, 1]
            c[i], d[i] = inverse[first + i, 2], inverse[first + i, 3]
        _aim_block(
            n, ray, slope, away, turned, known, lens, index, count, goal, axes, enough, most, work,
        )  # fmt: skip
        for i in range(n):
            for k in range(count):
                heights[job, i, k] = radii[k * BLOCK + i] / lens[k * COLUMNS + 5]
            down = buffer[5 * BLOCK + i]
            ox, oy = buffer[3 * BLOCK + i] / down, buffer[4 * BLOCK + i] / down
            side = count
            for k in range(1, stops):
                rim = rims[t, k]
                hx, hy = crossing(buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], ox, oy, rim)
                for s in range(int(rim[14])):
                    heights[job, i, side] = side_height(hx, hy, rim, s)
                    side += 1
        pass_surfaces(buffer, n if outer_count else 0, outer[t], outer_media[t], outer_count, True, False, radii)
        for i in range(n):
            for k in range(outer_count):
                heights[job, i, beyond + k] = radii[k * BLOCK + i] / outer[t, k * COLUMNS + 5]
            miss[job, i] = left[i] if buffer[6 * BLOCK + i] == 0.0 else LOST
            # What is left of the miss is undone to first order: no ray is spent on the last digits.
            part = 1.0 if left[i] <= FOUND * tolerance else 0.0
            tx = sx[i] - part * (a[i] * ex[i] + b[i] * ey[i])
            ty = sy[i] - part * (c[i] * ex[i] + d[i] * ey[i])
            landed[job, i, 0], landed[job, i, 1] = crossing(px[i], py[i], pz[i], tx, ty, sensor[t])


@kernel()
def _aim_all(outer: Any, outer_count: int, outer_media: Any, ends: Any, slopes: Any, far: Any, tallest: Any) -> None:
    """Aim from points of the FAP at points of the scene, both in `ends` (T, n, 6), past what stands between.

    `slopes` (T, n, 2), which hold first guesses, get those at the FAP, `far` (T, n) by how many `NEAR` rays miss the
    point, and `tallest` (T, n) their largest squared height over that of a face.
    """
    work = _room_to_aim(outer_count)
    radii, left = work[1], work[4]
    ray, goal = (np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)), (np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK))
    slope, home = (np.empty(BLOCK), np.empty(BLOCK)), (np.zeros(BLOCK), np.zeros(BLOCK))
    inverse = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    enough, upright = np.empty(BLOCK), np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    for t in range(ends.shape[0]):
        for first in range(0, ends.shape[1], BLOCK):
            n = min(BLOCK, ends.shape[1] - first)
            for i in range(n):
                for k in range(3):
                    ray[k][i], goal[k][i] = ends[t, first + i, k], ends[t, first + i, 3 + k]
                enough[i] = NEAR * (1.0 + 0.01 * abs(goal[2][i] - ray[2][i]))
                slope[0][i], slope[1][i] = slopes[t, first + i, 0], slopes[t, first + i, 1]
            _aim_block(
                n, ray, slope, home, inverse, False, outer[t], outer_media[t], outer_count, goal, upright, enough,
                PATIENCE, work,
            )  # fmt: skip
            for i in range(n):
                slopes[t, first + i, 0], slopes[t, first + i, 1] = slope[0][i], slope[1][i]
                far[t, first + i], tallest[t, first + i] = left[i] / enough[i], 0.0
                for k in range(outer_count):
                    height = radii[k * BLOCK + i] / outer[t, k * COLUMNS + 5]
                    tallest[t, first + i] = max(tallest[t, first + i], height)


@kernel()
def _spots(
    table: Any, count: int, media: Any, outer: Any, outer_count: int, outer_media: Any, plane: Any, rims: Any,
    world: Any, point: Any, pupil: Any, weight: Any, size: Any,
) -> None:  # fmt: skip
    """Root-mean-square radii (T, F) of the light from object points; arguments as of `spot_radii`, a ray a row."""
    buffer, radii, cut = np.empty(ROWS * BLOCK), np.empty(count * BLOCK), np.empty(BLOCK)
    aiming, upright = _room_to_aim(outer_count), np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    ray, goal = (np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)), (np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK))
    slope, home, enough = (np.empty(BLOCK), np.empty(BLOCK)), (np.zeros(BLOCK), np.zeros(BLOCK)), np.empty(BLOCK)
    inverse = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    lx, ly = np.empty(len(point)), np.empty(len(point))
    each, total = len(weight), len(point)
    for t in range(len(size)):
        lens, fap = table[t], rims[t, 0]
        for first in range(0, total, BLOCK):
            m = min(BLOCK, total - first)
            for i in range(m):
                u, v = pupil[first + i, 0] * fap[12], pupil[first + i, 1] * fap[13]
                for k in range(3):
                    ray[k][i] = fap[k] + u * fap[3 + k] + v * fap[6 + k]
                    goal[k][i] = point[first + i, k] + world[t, k]
                run = ray[2][i] - goal[2][i]
                for k in range(2):
                    slope[k][i] = 0.0 if outer_count else (ray[k][i] - goal[k][i]) / run
                enough[i], cut[i] = NEAR * (1.0 + 0.01 * abs(run)), 0.0
            if outer_count:
                _aim_block(
                    m, ray, slope, home, inverse, False, outer[t], outer_media[t], outer_count, goal, upright, enough,
                    PATIENCE, aiming,
                )  # fmt: skip
                for i in range(m):
                    cut[i] = 0.0 if aiming[4][i] <= FOUND * enough[i] else 1.0
                    for k in range(outer_count):
                        if not aiming[1][k * BLOCK + i] <= outer[t, k * COLUMNS + 5]:
                            cut[i] = 1.0
            for i in range(m):
                ax, ay = slope[0][i], slope[1][i]
                shrink = 1.0 / sqrt(1.0 + ax * ax + ay * ay)
                for k in range(3):
                    buffer[k * BLOCK + i] = ray[k][i]
                buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = ax * shrink, ay * shrink
                buffer[5 * BLOCK + i], buffer[6 * BLOCK + i] = shrink, 0.0
            for k in range(1, rims.shape[1]):
                rim = rims[t, k]
                for i in range(m):
                    x, y, z, up = buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], buffer[5 * BLOCK + i]
                    hx, hy = crossing(x, y, z, buffer[3 * BLOCK + i] / up, buffer[4 * BLOCK + i] / up, rim)
                    for side in range(int(rim[14])):
                        cut[i] = 1.0 if side_height(hx, hy, rim, side) > 1.0 else cut[i]
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


class RayTargets(NamedTuple):
    """Rays that are wanted, n of them, and how the nominal camera finds them."""

    base: Array
    offset: Array
    """Points of the array, in its own coordinates: base plus offset times half the pitch, (n, 2)."""
    target: Array
    """Points of the FAP along its own sides, in half of those, of a disc in its radius, (n, 2)."""
    start: Array
    """Slopes in the nominal camera, (n, 2); nan where it has no such ray."""
    inverse: Array
    """Inverse of d(target)/d(slope) there, (n, 4)."""


class AimedRays(NamedTuple):
    """Aimed rays: N jobs of n each, nan for those that do not come through."""

    landed: Array
    """Sensor points, in its own coordinates [mm], (N, n, 2)."""
    heights: Array
    """Squared heights over those of every surface, heights over every side of further stops, squared of discs, and
    squared ones of all before the FAP, (N, n, S + L)."""


def aimed(train: Train, planes: Planes, half: Array, wanted: RayTargets, rays: int, *, own: bool = False) -> AimedRays:
    """Trace rays of every place in each of T builds, (T * places, rays) with the places running fastest.

    Parameters
    ----------
    train, planes, half
        T builds; `half` of the microlens pitch [mm], (T,).
    wanted : RayTargets
        The rays.
    rays : int
        Rays of a place, at most `BLOCK`.
    own : bool
        Whether every build has targets of its own, the builds slowest.
    """
    trials, places = len(half), len(wanted.base) // rays // (len(half) if own else 1)
    together = next(count for count in range(places, 0, -1) if places % count == 0 and count * rays <= BLOCK)
    groups = places // together
    trial = np.repeat(np.arange(trials), groups)
    begin = np.tile(np.arange(groups) * together * rays, trials) + (trial * places * rays if own else 0)
    landed, heights, miss = nearest(train, planes, half, wanted, wanted.start, trial, begin, together * rays)
    lost = ~(miss <= FOUND * TOLERANCE)
    landed[lost], heights[lost] = np.nan, np.nan
    return AimedRays(*(part.reshape(trials * places, rays, -1) for part in (landed, heights)))


def nearest(
    train: Train, planes: Planes, half: Array, wanted: RayTargets, home: Array, trial: Ints, begin: Ints, rays: int
) -> tuple[Array, Array, Array]:
    """Landing places, heights and misses of what comes nearest to the rays wanted, in the FAP's radius.

    Lost rays turn back to slopes `home` (n, 2). Where inverses are nan, they are taken from nudged rays, and
    corrections go on for longer.

    Parameters
    ----------
    trial, begin : ndarray of int, (N,)
        The build of each job, and its first ray in the list.
    rays : int
        Rays of a job, at most `BLOCK`.
    train, planes, half, wanted
        As of `aimed`.
    """
    n, (lens, beyond) = len(trial), train
    assert rays <= BLOCK
    limits = sum(part.media.shape[1] - 1 for part in train) + planes.lengths.shape[1]
    landed, heights = np.empty((n, rays, 2)), np.empty((n, rays, limits))
    miss = np.empty((n, rays))
    # Of one layout: kernels are compiled once more for another.
    base, offset, target, start, inverse = map(np.ascontiguousarray, wanted)
    known = not np.isnan(inverse).all()
    corrections = CORRECTIONS if known else PATIENCE
    _aim.quickest((lens.seconds + beyond.seconds) * (corrections + 1) * miss.size)(
        trial, begin, *kernel_args(lens), *kernel_args(beyond), planes.array, planes.sensor, planes.rims, half, base,
        offset, target, start, np.ascontiguousarray(home), inverse, known, TOLERANCE,
        corrections, landed, heights, miss,
    )  # fmt: skip
    return landed, heights, miss


def kernel_args(part: SurfaceStack) -> tuple[Array, int, Array]:
    """Arguments that kernels take of a stack: its table, how many surfaces, the media between."""
    return part.table, part.media.shape[1] - 1, part.media


def landings(train: Train, planes: Planes, world: Array, point: ArrayLike, pupil: ArrayLike) -> Array:
    """Points where rays from object points through FAP points meet the array, then the sensor, in own coordinates.

    Parameters
    ----------
    train, planes
        T builds.
    world : ndarray, (T, 3)
        What the object points' frame is shifted by against the lens's [mm].
    point : array_like, (n, 3)
        [mm].
    pupil : array_like, (n, 2) or (T, n, 2)
        Along the FAP's own sides, in half of those.

    Returns
    -------
    ndarray
        Points (T, n, 4) [mm], nan for a ray that does not come through; rims stop none.
    """
    fap, aside = planes.rims[:, 0], np.asarray(pupil, float) * planes.rims[:, :1, 12:14]
    through = fap[:, None, :3] + aside[..., :1] * fap[:, None, 3:6] + aside[..., 1:] * fap[:, None, 6:9]
    start = np.asarray(point, float) + world[:, None]
    run = through - start
    if train.beyond.table.size:
        slopes, far, _ = beyond_fap(train, np.concatenate([through, start], axis=-1))
        run = np.concatenate([np.where((far <= FOUND)[..., None], slopes, np.nan), np.ones((*far.shape, 1))], axis=-1)
    x, y, z = np.moveaxis(through, -1, 0)
    end = planes.array[:, 2]
    passed = train.lens.through(
        (x, y), np.moveaxis(run[..., :2] / run[..., 2:], -1, 0), start=z, end=end, backward=False
    )
    place = np.stack([*passed.height, np.broadcast_to(end[:, None], z.shape)], axis=-1)
    way = np.stack([*passed.slope, np.ones(z.shape)], axis=-1)
    landed = np.concatenate([crossings(place, way, plane[:, None]) for plane in (planes.array, planes.sensor)], axis=-1)
    landed[passed.state != RayFate.KEPT] = np.nan
    return landed


def beyond_fap(train: Train, ends: Array, start: ArrayLike = 0.0) -> tuple[Array, Array, Array]:
    """Slopes (T, n, 2) at points of the FAP of rays to points of the scene, both in `ends` (T, n, 6); as `_aim_all`.

    From slopes `start`, where something stands between.
    """
    shape = ends.shape[:2]
    slopes, far, tallest = np.empty((*shape, 2)), np.zeros(shape), np.zeros(shape)
    if not train.beyond.table.size:
        return (ends[..., :2] - ends[..., 3:5]) / (ends[..., 2:3] - ends[..., 5:]), far, tallest
    slopes[...] = start
    work = train.beyond.seconds * PATIENCE * far.size
    _aim_all.quickest(work)(*kernel_args(train.beyond), np.ascontiguousarray(ends), slopes, far, tallest)
    return slopes, far, tallest


def crossings(point: Array, way: Array, plane: Array) -> Array:
    """Points where lines through points along ways (..., 3) cross planes (..., 12), in own coordinates, (..., 2)."""
    off, normal = point - plane[..., :3], plane[..., 9:12]
    hit = off - way * (np.sum(off * normal, axis=-1) / np.sum(way * normal, axis=-1))[..., None]
    return np.stack([np.sum(hit * plane[..., 3:6], axis=-1), np.sum(hit * plane[..., 6:9], axis=-1)], axis=-1)


def etendue_sr(shape: Array, base: Array, array: Array, sensor: Array) -> Array:
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
    plane, rims : ndarray, (T, 12), (T, R, 15)
        Where the spots are seen, and what rays pass, as `Planes` has them.
    world : ndarray, (T, 3)
        What the object points' frame is shifted by against the lens's [mm].
    point : array_like, (F, 3)
        Object points [mm].
    pupil, weight : array_like, (P, 2), (P,)
        Points of the FAP, as `RayTargets.target`, and how much of the light each stands for.

    Returns
    -------
    ndarray
        (T, F) [mm], of the rays that no rim stops; nan where none comes through.
    """
    x, a, w = np.atleast_2d(np.asarray(point, float)), np.asarray(pupil, float), np.ascontiguousarray(weight, float)
    size = np.empty((len(world), len(x)))
    rays = np.repeat(x, len(a), axis=0), np.tile(a, (len(x), 1))
    frame = np.ascontiguousarray(world)  # kernels are compiled once more for another layout
    work = (train.lens.seconds + PATIENCE * train.beyond.seconds) * size.size * len(a)
    _spots.quickest(work)(*kernel_args(train.lens), *kernel_args(train.beyond), plane, rims, frame, *rays, w, size)
    return size
