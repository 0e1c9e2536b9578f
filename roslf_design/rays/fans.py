"""Fans of rays for drawing: the course of each from the object plane to the sensor, or to the element that takes it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .clipping import Bytes
from .forward import trace_pupil
from .frames import Floats, Pose, poses
from .status import Status
from .system import System


class Fan(NamedTuple):
    """Polylines of rays, in the system's axes [mm]."""

    z: Floats
    """Along the axis; shape (..., rays, 4): object plane, main lens, microlens, sensor."""
    x: Floats
    """Height in the meridional plane, likewise. A stopped ray repeats the point where it ended."""
    y: Floats
    """Height across it: 0 unless something is tilted about x, rotated or decentred in y."""
    status: Bytes
    """`Status` codes; shape (..., rays)."""


def fans(
    system: System, microlens: ArrayLike, *, rays: int = 9, fill: float = 1.0, distance: float | None = None
) -> Fan:
    """Fans from the object plane through the pupil and one microlens each.

    Parameters
    ----------
    system : System
        Its trials broadcast with the microlenses.
    microlens : array_like
        x of the microlenses' axes, in the MLA's frame [mm].
    rays : int, optional
        In each fan, spread evenly along the flexible angular plane's x, rim to rim.
    fill : float, optional
        How much of that diameter they span; above 1, the outermost rays are shown being clipped.
    distance : float, optional
        Where they start, from the main lens [mm]; None for the plane in focus on the MLA or, where that is at
        infinity or behind the lens, one and a half times as far as the farthest stop.

    Returns
    -------
    Fan

    Raises
    ------
    ValueError
        A `distance` that is not finite.
    """
    if distance is not None and not np.isfinite(distance):
        raise ValueError(f"distance: {distance} cannot be drawn; give a finite one in mm")
    spread, c = system.spread(1), np.asarray(microlens, float)[..., None]
    course = trace_pupil(spread, (np.linspace(-fill, fill, rays), 0.0), (c, 0.0))
    sensor, array, *openings = poses(spread)
    start = _start(spread) if distance is None else np.asarray(distance, float)
    line = (*course.height, *course.slope)
    vertices = [
        (*course.at(start), -start),
        _meeting(openings[0], line),
        _placed(array, c, np.zeros(())),
        _placed(sensor, *course.sensor),
    ]
    ended = [(int(Status.MAIN_LENS), _meeting(openings[0], line))]
    ended += [(Status.APERTURE + k, _meeting(pose, line)) for k, pose in enumerate(openings[1:])]
    shape = course.status.shape
    paths = np.stack([np.stack([np.broadcast_to(x, shape) for x in vertex], -1) for vertex in vertices], -2)
    for code, point in ended:
        stopped = course.status == code
        stop = np.stack([np.broadcast_to(x, shape) for x in point], -1)
        paths = np.where(stopped[..., None, None] & (np.arange(4) > 0)[:, None], stop[..., None, :], paths)
    return Fan(paths[..., 2], paths[..., 0], paths[..., 1], course.status)


def _start(system: System) -> Floats:
    power = np.divide(1.0, system.lens.focal_length) - np.divide(1.0, system.array.distance)
    farthest = np.max(np.broadcast_arrays(*(stop.distance for stop in system.stops), 0.0), axis=0)
    beyond = np.where(farthest > 0, 1.5 * farthest, system.array.distance)
    return np.where(power > 0, 1.0 / np.where(power > 0, power, 1.0), beyond)


def _meeting(pose: Pose, line: tuple[Floats, Floats, Floats, Floats]) -> tuple[Floats, Floats, Floats]:
    """Where object-side rays meet an element's plane."""
    (nx, ny, nz), (ex, ey, ez) = pose.axes[:, 2], pose.vertex
    hx, hy, ox, oy = line
    z = (nx * (ex - hx) + ny * (ey - hy) + nz * ez) / (nx * ox + ny * oy + nz)
    return hx + ox * z, hy + oy * z, z


def _placed(pose: Pose, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Points of an element in the system's axes."""
    (ax, bx, _), (ay, by, _), (az, bz, _) = pose.axes
    ex, ey, ez = pose.vertex
    return ax * x + bx * y + ex, ay * x + by * y + ey, az * x + bz * y + ez
