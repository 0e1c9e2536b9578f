"""Backward rays: from a sensor point through a microlens and the main lens out to the object, and who stops them.

The engine's one primitive; it needs no ray aiming. Every ray gets a status: kept, or the first element *in the
direction of light* that takes it - stops from the object side (farthest vertex first), then the main lens, then the
microlens's clear aperture - so that counting statuses gives a ledger that adds up. A ray on a rim is kept.

Ideal lenses are exact collinear maps in their own frames: a ray that meets the lens at height h with slope o leaves
with slope o - h/f, whatever the height; tilted, the same holds along the tilted axes. Tilting the MLA moves its
microlenses in z and turns their axes; tilting a stop makes it a tilted disc.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import THREADS
from . import kernels as kn
from .clipping import Bytes, Mark, finite, outside, stop_marks, verdict
from .constants import constants, lines, reach, rims, rows
from .frames import LENS, Floats, frames
from .status import Status
from .system import System

Point = tuple[ArrayLike, ArrayLike]
"""(x, y); two arrays that broadcast."""

COMPILE_FROM = 2_000_000
"""Rays from which the compiled loop is worth starting numba; below, the same arithmetic runs in numpy."""


class Ends(NamedTuple):
    """Where rays end in object space, and their fate."""

    status: Bytes
    """`Status` codes."""
    x: Floats
    """x at the object distance [mm]; for an infinite distance x/Z, the tangent of the direction."""
    y: Floats
    """y likewise."""


class ObjectRays(NamedTuple):
    """Rays in object space as straight lines, and their fate."""

    status: Bytes
    """`Status` codes."""
    height: tuple[Floats, Floats]
    """(x, y) where the object-side ray, prolonged, meets the plane z = 0 [mm]; l where the lens is not tilted."""
    slope: tuple[Floats, Floats]
    """dx/dz and dy/dz, o."""

    def at(self, distance: ArrayLike) -> tuple[Floats, Floats]:
        """Points at object distances Z [mm] from the lens; for Z = inf, x/Z and y/Z."""
        share, z = reach(distance)
        return self.height[0] * share - self.slope[0] * z, self.height[1] * share - self.slope[1] * z


def trace(system: System, sensor: Point, microlens: Point, offset: Point = (0.0, 0.0)) -> ObjectRays:
    """Trace sensor points back into object space.

    Parameters
    ----------
    system : System
        Its trials broadcast with the points; `System.spread` makes room behind them.
    sensor : pair of array_like
        p, in the sensor's frame [mm].
    microlens : pair of array_like
        c, the microlens's axis, in the MLA's frame [mm].
    offset : pair of array_like, optional
        w - c, where on the microlens the ray passes, in the MLA's frame [mm]; zero is a pinhole.

    Returns
    -------
    ObjectRays
        Rays that are stopped are traced on all the same; untraceable ones hold zeros.

    Notes
    -----
    Aligned: s = (p - w)/d_2 + (w - c)/f_ml, l = w - s d_1, o = s + l/f.
    """
    (px, py), (cx, cy), (vx, vy) = ([np.asarray(c, float) for c in pair] for pair in (sensor, microlens, offset))
    k = constants(system)
    with np.errstate(all="ignore"):
        follow = _aligned if system.aligned else _posed
        heights, slopes, marks = follow(system, k, px, py, cx, cy, vx, vy)
    shape = np.broadcast_shapes(px.shape, py.shape, cx.shape, cy.shape, vx.shape, vy.shape, system.shape)
    status = verdict(shape, marks)
    lit = status != Status.UNTRACEABLE
    (hx, hy), (sx, sy) = ([np.where(lit, c, 0.0) for c in pair] for pair in (heights, slopes))
    return ObjectRays(status, (hx, hy), (sx, sy))


def ends(
    system: System,
    sensor: Point,
    microlens: Point,
    offset: Point = (0.0, 0.0),
    *,
    distance: ArrayLike,
    out: Ends | None = None,
) -> Ends:
    """Trace sensor points back to an object plane, perpendicular to the axis; the fast way for many rays.

    Parameters
    ----------
    system, sensor, microlens, offset
        As in `trace`.
    distance : array_like
        Z, the object plane's distance from the lens [mm]; inf gives directions.
    out : Ends, optional
        Contiguous arrays of the rays' shape to write into; fresh memory costs as much as the rays.

    Returns
    -------
    Ends
        Broadcast shape. x = l - o Z; for Z = inf, x/Z = -o. Untraceable rays hold zeros.

    Raises
    ------
    ValueError
        `out` does not fit.

    Notes
    -----
    From `COMPILE_FROM` rays on a compiled loop runs on all threads, if the system and the distance do not change along
    the last axis. Both ways give the same bits.
    """
    trials = np.broadcast_shapes(system.shape, np.shape(distance))
    shape = np.broadcast_shapes(trials, *(np.shape(c) for c in (*sensor, *microlens, *offset)))
    if int(np.prod(shape)) >= COMPILE_FROM and (not trials or trials[-1] == 1):
        return compiled_ends(system, sensor, microlens, offset, distance=distance, out=out)
    rays = trace(system, sensor, microlens, offset)
    written = _room(shape, out)
    written.status[...] = rays.status
    written.x[...], written.y[...] = rays.at(distance)
    return written


def compiled_ends(
    system: System,
    sensor: Point,
    microlens: Point,
    offset: Point = (0.0, 0.0),
    *,
    distance: ArrayLike,
    out: Ends | None = None,
) -> Ends:
    """`ends` by the compiled loop, however few the rays; the last axis must be one of rays, not of trials.

    Raises
    ------
    ValueError
        The system or the distance changes along the last axis, or there are no rays.
    """
    groups = [[np.asarray(c, float) for c in pair] for pair in (sensor, microlens, offset)]
    trials = np.broadcast_shapes(system.shape, np.shape(distance))
    shape = np.broadcast_shapes((1,), trials, *(c.shape for group in groups for c in group))
    if trials and trials[-1] != 1:
        raise ValueError(f"the system changes along the last axis of {shape}; put the rays last (System.spread)")
    if 0 in shape:
        raise ValueError(f"no rays in an array of shape {shape}")
    leading = shape[:-1] if trials else None
    packed = [lines(group, shape) for group in groups]
    steps = np.array([(int(bool(trials)), 0), *(step for _, step in packed)])
    points = tuple(values for pair, _ in packed for values in pair)
    places, codes = rims(system)
    k, place_rows, code_rows = (
        rows(constants(system, distance), 1, leading),
        rows(places, 2, leading),
        rows(codes, 1, leading),
    )
    written = _room(shape, out)
    flat = (written.status.reshape(-1), written.x.reshape(-1), written.y.reshape(-1))
    maps = None if system.aligned else rows(frames(system), 3, leading)
    with THREADS:
        if maps is None:
            kn.aligned_ends.compiled(k, place_rows, code_rows, steps, shape[-1], points, *flat)
        else:
            kn.posed_ends.compiled(k, maps, place_rows, code_rows, steps, shape[-1], points, *flat)
    return written


def _room(shape: tuple[int, ...], out: Ends | None) -> Ends:
    """Arrays to write rays into."""
    if out is None:
        return Ends(np.empty(shape, np.uint8), np.empty(shape), np.empty(shape))
    for name, kind in (("status", np.uint8), ("x", np.float64), ("y", np.float64)):
        array: NDArray[Any] = getattr(out, name)
        if array.shape != shape or array.dtype != kind or not array.flags.c_contiguous:
            raise ValueError(f"out.{name}: needs a contiguous array of {kind.__name__} of shape {shape}")
    return out


def _aligned(system: System, k: Floats, *points: Floats) -> tuple[list[Floats], list[Floats], list[Mark]]:
    d_1, per_d_2, per_f_ml, per_f = k[: kn.SENSOR_X]
    (lx, ox), (ly, oy) = (
        kn.aligned_ray(d_1, per_d_2, per_f_ml, per_f, k[kn.SENSOR_X + axis], k[kn.ARRAY_X + axis], *points[axis::2])
        for axis in range(2)
    )
    marks = _first_marks(k, points, lx, ly)
    for rim, code in zip(*rims(system), strict=True):
        marks.append((outside((lx + rim[0]) - ox * rim[2], (ly + rim[1]) - oy * rim[2], rim[3]), code))
    marks.append((~finite(lx, ly), Status.UNTRACEABLE))
    return [lx + k[kn.LENS_X], ly + k[kn.LENS_X + 1]], [ox, oy], marks


def _posed(system: System, k: Floats, *points: Floats) -> tuple[list[Floats], list[Floats], list[Mark]]:
    maps = frames(system)
    lx, ly, ox, oy, good = kn.posed_ray(k, maps, *points)
    hx, hy, sx, sy, front = kn.crossing(maps[LENS], lx, ly, ox, oy)
    marks, forward = stop_marks(system, maps, (lx, ly, ox, oy))
    good = good & front & forward & finite(lx, ly)
    return [hx, hy], [sx, sy], [*_first_marks(k, points, lx, ly), *marks, (~good, Status.UNTRACEABLE)]


def _first_marks(k: Floats, points: tuple[Floats, ...], lx: Floats, ly: Floats) -> list[Mark]:
    microlens = ~kn.in_microlens(k, points[4], points[5])
    return [(microlens, Status.MICROLENS), (outside(lx, ly, k[kn.LENS_RADIUS]), Status.MAIN_LENS)]
