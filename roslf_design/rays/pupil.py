"""Rays of the pupil: from a point of the flexible angular plane through a microlens to the sensor, each with a fate."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import Camera, Rim, Vector
from ..camera.frames import along, dot, minus, plus, times
from ..theory.stop_images import Projected, lens_point, project

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Point = tuple[ArrayLike, ArrayLike]


class Status(IntEnum):
    """Fate of one ray; stored as one byte. Codes from `APERTURE` on number the stops: stop k is ``APERTURE + k``."""

    KEPT = 0
    """Passed everything; it landed in its own microlens's cell."""
    MAIN_LENS = 1
    """Clipped by the main lens's clear aperture."""
    MICROLENS = 2
    """Outside the clear aperture of its microlens."""
    OFF_SENSOR = 3
    """Missed the sensor."""
    NEIGHBOUR = 4
    """Landed on the sensor, outside its own microlens's cell."""
    UNTRACEABLE = 5
    """Meets some element from behind, along its plane or at infinity, or is not finite: no light travels there."""
    REFLECTED = 6
    """Totally reflected inside a window, prism, rod or lens before the main lens."""
    ELEMENT = 7
    """Outside a surface of a lens before the main lens that has no rim of its own in the design."""
    APERTURE = 16
    """Clipped by the flexible angular plane (FAP), which is stop 0; further stops follow."""


PASSED = (int(Status.KEPT), int(Status.NEIGHBOUR), int(Status.OFF_SENSOR))
"""Past every rim, wherever on the sensor's plane it landed."""

_NAMES = {
    Status.KEPT: "kept",
    Status.MAIN_LENS: "clipped by main lens",
    Status.MICROLENS: "outside its microlens",
    Status.OFF_SENSOR: "off the sensor",
    Status.NEIGHBOUR: "in a neighbour's cell",
    Status.UNTRACEABLE: "untraceable",
    Status.REFLECTED: "totally reflected",
    Status.ELEMENT: "clipped by an element",
    Status.APERTURE: "clipped by flexible angular plane",
}


def describe(code: int) -> str:
    """Readable name of a status code: "clipped by main lens", "clipped by stop 2".

    Raises
    ------
    ValueError
        A number that is no status.
    """
    if Status.APERTURE < code <= 255:
        return f"clipped by stop {code - Status.APERTURE}"
    try:
        return _NAMES[Status(code)]
    except ValueError:
        raise ValueError(
            f"{code} is not a ray status: expected 0 to 7, or {Status.APERTURE} + a stop's index"
        ) from None


class PupilRays(NamedTuple):
    """Rays through the pupil: their fate, where they land, and their course in object space."""

    status: NDArray[np.uint8]
    """`Status` codes: the first element in the order of light that takes a ray."""
    sensor: tuple[Floats, Floats]
    """(x, y) in the sensor's frame [mm]."""
    height: tuple[Floats, Floats]
    """(x, y) where the object-side ray, prolonged, meets the plane z = 0 of the system's axes [mm]."""
    slope: tuple[Floats, Floats]
    """dx/dz and dy/dz in object space."""
    passes: dict[str, Mask]
    """Rim's name to whether a ray would pass it, whatever the others take; "FAP" first, then `Camera.rims`."""

    def at(self, distance: ArrayLike) -> tuple[Floats, Floats]:
        """Points at object distances Z [mm] from the lens; for Z = inf, x/Z and y/Z."""
        z = np.asarray(distance, float)
        far = np.isinf(z)
        share, reach = np.where(far, 0.0, 1.0), np.where(far, 1.0, z)
        return self.height[0] * share - self.slope[0] * reach, self.height[1] * share - self.slope[1] * reach


def trace_pupil(camera: Camera, pupil: Point, microlens: Point) -> PupilRays:
    """Trace points of the pupil through pinhole microlenses to the sensor, every part decentred and tilted as it is.

    Parameters
    ----------
    camera : Camera
        Behind an ideal lens; builds broadcast with the points.
    pupil : pair of array_like
        Points of the flexible angular plane (FAP), in its frame and in units of its radius; beyond 1 they are clipped.
    microlens : pair of array_like
        Microlens axes, in the array's frame [mm].

    Returns
    -------
    PupilRays
        Of the broadcast shape. Rays that meet the sensor or a stop from behind are untraceable and hold zeros.

    Notes
    -----
    A ray that passes everything is kept where it lands in its microlens's own cell, a square of one microlens-image
    pitch about the image's chief ray (hexagonal: the lattice's own cell); else it is off the sensor or a neighbour's.
    """
    ax, ay = (np.asarray(part, float) for part in pupil)
    cx, cy = (np.asarray(part, float) for part in microlens)
    shape = np.broadcast_shapes(camera.shape, ax.shape, ay.shape, cx.shape, cy.shape)
    a, b = camera.fap.radius * ax, camera.fap.radius * ay
    with np.errstate(all="ignore"):
        axis, point, landing = _through(camera, cx, cy)
        px, py = landing.at(a, b)
        good = landing.ahead(a, b) & np.isfinite(px + py)
        passes: dict[str, Mask] = {"FAP": np.broadcast_to(ax * ax + ay * ay <= 1.0, shape)}
        bend = minus(1.0, axis[2] / camera.f)
        for rim in camera.rims:
            crossing = _crossing(camera, rim, point, axis)
            x, y = crossing.at(a, b)
            # A number that is not finite is no way through.
            passes[rim.name] = np.broadcast_to(x * x + y * y <= np.square(rim.radius), shape)
            good = good & crossing.ahead(a, b)
        lx, ly = point.at(a, b)
        ray: Vector = (minus(axis[0], bend * lx) / axis[2], minus(axis[1], bend * ly) / axis[2], 1.0)
        height, slope = _in_system(camera, (lx, ly, 0.0), ray)
        width, tall = camera.sensor_size
        on_sensor = (np.abs(px) <= width / 2) & (np.abs(py) <= tall / 2)
        own = _own_cell(camera, cx, cy, landing, px, py)
    status = _status_of(camera, shape, passes, on_sensor=on_sensor, own_cell=own, traceable=good)
    lit = status != Status.UNTRACEABLE

    def pair(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        return np.where(lit, x, 0.0), np.where(lit, y, 0.0)

    return PupilRays(status, pair(px, py), pair(*height), pair(*slope), passes)


def _status_of(
    camera: Camera,
    shape: tuple[int, ...],
    passes: Mapping[str, Mask],
    *,
    on_sensor: Mask,
    own_cell: Mask,
    traceable: Mask,
) -> NDArray[np.uint8]:
    """Status of every ray: who takes it first, in the order of light; the masks broadcast to `shape`."""
    codes = {"FAP": int(Status.APERTURE), "main lens": int(Status.MAIN_LENS)}
    codes |= {rim.name: Status.APERTURE + k for k, rim in enumerate(camera.rims[1:], 1)}
    status = np.full(shape, Status.KEPT, np.uint8)
    # Light's first obstacle overrules what would take the ray later.
    np.copyto(status, np.uint8(Status.NEIGHBOUR), where=~own_cell)
    np.copyto(status, np.uint8(Status.OFF_SENSOR), where=~on_sensor)
    for rim in reversed(camera.in_light_order):
        np.copyto(status, np.uint8(codes[rim.name]), where=~passes[rim.name])
    np.copyto(status, np.uint8(Status.UNTRACEABLE), where=~traceable)
    return status


def _through(camera: Camera, x: Floats, y: Floats) -> tuple[Vector, Projected, Projected]:
    """A microlens in the lens's frame, and the ways from the FAP's plane to the lens and to the sensor through it."""
    axis = camera.microlens(x, y)
    point = lens_point(camera, camera.fap, axis)
    return axis, point, project(point, axis, 1.0, camera.pose("sensor"))


def _crossing(camera: Camera, rim: Rim, point: Projected, axis: Vector) -> Projected:
    if rim.part == "main_lens":
        return point
    return project(point, axis, minus(1.0, axis[2] / camera.f), camera.pose(rim.part))


def _in_system(camera: Camera, point: Vector, ray: Vector) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Height at z = 0 and slope, in the system's axes, of a line in the lens's frame."""
    world = camera.world
    offset: Vector = tuple(minus(p, o) for p, o in zip(point, world.origin, strict=True))  # type: ignore[assignment]
    forward = dot(world.z, ray)
    sx, sy = dot(world.x, ray) / forward, dot(world.y, ray) / forward
    z = dot(world.z, offset)
    height = minus(dot(world.x, offset), times(sx, z)), minus(dot(world.y, offset), times(sy, z))
    return (np.asarray(height[0]), np.asarray(height[1])), (np.asarray(sx), np.asarray(sy))


def _own_cell(camera: Camera, x: Floats, y: Floats, landing: Projected, px: Floats, py: Floats) -> Mask:
    """Whether sensor points lie in the cell about a microlens image's chief ray.

    Half the steps between the chief rays of the neighbours one pitch to either side along the array's x and y span it.
    """
    d = camera.d

    def chief(dx: float, dy: float) -> tuple[Floats, Floats]:
        u, v = camera.chief_point(x + dx * d, y + dy * d)
        return np.asarray(u), np.asarray(v)

    (ax, ay), (bx, by), (cx, cy), (dx, dy) = chief(1, 0), chief(-1, 0), chief(0, 1), chief(0, -1)
    xx, yx, xy, yy = (ax - bx) / 2, (ay - by) / 2, (cx - dx) / 2, (cy - dy) / 2
    area = xx * yy - xy * yx
    x0, y0 = landing.centre
    u, v = (yy * (px - x0) - xy * (py - y0)) / area, (xx * (py - y0) - yx * (px - x0)) / area
    if camera.layout == "square":
        return np.asarray((np.abs(u) <= 0.5) & (np.abs(v) <= 0.5))
    slant = np.sqrt(0.75) * v
    return np.asarray((np.abs(u / 2 + slant) <= 0.5) & (np.abs(u / 2 - slant) <= 0.5) & (np.abs(u) <= 0.5))


class Fan(NamedTuple):
    """Polylines of rays for drawing, in the system's axes [mm]."""

    z: Floats
    """Along the axis; shape (microlenses, rays, 4): object plane, main lens, microlens, sensor."""
    x: Floats
    """Height in the meridional plane, likewise. A stopped ray repeats the point where it ended."""
    y: Floats
    """Height across it: 0 unless something is tilted about x, rotated or decentred in y."""
    status: NDArray[np.uint8]
    """`Status` codes; shape (microlenses, rays)."""


def fans(
    camera: Camera, microlens: ArrayLike, *, rays: int = 9, fill: float = 1.0, distance: float | None = None
) -> Fan:
    """Fans from the object plane through the pupil and one microlens each.

    Parameters
    ----------
    camera : Camera
        One build.
    microlens : array_like
        x of the microlenses' axes, in the array's frame [mm].
    rays : int, optional
        In each fan, spread evenly along the FAP's x, rim to rim.
    fill : float, optional
        How much of that diameter they span; above 1, the outermost rays are shown being clipped.
    distance : float, optional
        Where they start, from the main lens [mm]; None for the plane in focus on the array or, where that is at
        infinity or behind the lens, one and a half times as far as the farthest stop.

    Raises
    ------
    ValueError
        A `distance` that is not finite.
    """
    if distance is not None and not np.isfinite(distance):
        raise ValueError(f"distance: {distance} cannot be drawn; give a finite one in mm")
    c = np.asarray(microlens, float)[..., None]
    course = trace_pupil(camera, (np.linspace(-fill, fill, rays), 0.0), (c, 0.0))
    start = _start(camera) if distance is None else distance
    line = (*course.height, *course.slope)
    lens = _meeting(camera, "main_lens", line)
    vertices = [
        (*course.at(start), np.asarray(-start)),
        lens,
        _placed(camera, "microlens_array", c, np.zeros(())),
        _placed(camera, "sensor", *course.sensor),
    ]
    ended = [(int(Status.MAIN_LENS), lens)]
    ended += [
        (Status.APERTURE + k, _meeting(camera, rim.part, line)) for k, rim in enumerate((camera.fap, *camera.rims[1:]))
    ]
    shape = course.status.shape
    paths = np.stack([np.stack([np.broadcast_to(x, shape) for x in vertex], -1) for vertex in vertices], -2)
    for code, point in ended:
        stop = np.stack([np.broadcast_to(x, shape) for x in point], -1)
        stopped = (course.status == code)[..., None, None] & (np.arange(4) > 0)[:, None]
        paths = np.where(stopped, stop[..., None, :], paths)
    return Fan(paths[..., 2], paths[..., 0], paths[..., 1], course.status)


def _start(camera: Camera) -> float:
    d_f = float(camera.d_f)
    if np.isfinite(d_f) and d_f > 0:
        return d_f
    farthest = max(float(rim.distance) for rim in (camera.fap, *camera.rims))
    return 1.5 * farthest if farthest > 0 else float(camera.d_1)


def _meeting(camera: Camera, part: str, line: tuple[Floats, Floats, Floats, Floats]) -> tuple[Floats, Floats, Floats]:
    """Where object-side rays meet a part's plane, in the system's axes."""
    pose = camera.pose(part).seen_from(camera.world)
    (nx, ny, nz), (ex, ey, ez) = pose.z, pose.origin
    hx, hy, ox, oy = line
    z = (nx * (ex - hx) + ny * (ey - hy) + nz * ez) / (nx * ox + ny * oy + nz)
    return hx + ox * z, hy + oy * z, np.asarray(z)


def _placed(camera: Camera, part: str, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Points of a part's own plane in the system's axes."""
    pose = camera.pose(part).seen_from(camera.world)
    point = along(pose.origin, x, pose.x, y, pose.y)
    return np.asarray(point[0]), np.asarray(point[1]), np.asarray(plus(point[2], 0.0))
