"""Rays of the pupil: from a point of the flexible angular plane through a microlens to the sensor, each with a fate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bore.chain import COVER, SUBSTRATE
from ..bore.part import minus, times
from ..camera import Camera, Rim, Vector
from ..camera.frames import along, dot
from ..design.parts import PATHS
from ..fates import RayFate, state_at
from ..shapes.lattice import PACKINGS
from ..theory.object_space import FAP, MAIN_LENS
from ..theory.stop_images import Projected, lens_point, project

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Point = tuple[ArrayLike, ArrayLike]

PASSED = (RayFate.KEPT, RayFate.NEIGHBOUR, RayFate.OFF_SENSOR)
"""Past every rim, wherever on the sensor's plane it landed."""


class PupilRays(NamedTuple):
    """Rays through the pupil: their fate, where they land, and their course in object space."""

    status: NDArray[np.int16]
    """State of the ray (`..fates`): the first opening in the order of light that takes it, where it lands, or `MISSED`
    of one that meets some element from behind, along its plane or at infinity."""
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
        Of one that is no disc, what `ClearAperture.places` makes of points of the unit disc.
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
    a, b = camera.fap.outline.places(ax, ay)
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
            passes[rim.name] = np.broadcast_to(rim.outline.contains(x, y), shape)
            good = good & crossing.ahead(a, b)
        lx, ly = point.at(a, b)
        ray: Vector = (minus(axis[0], bend * lx) / axis[2], minus(axis[1], bend * ly) / axis[2], 1.0)
        height, slope = _in_system(camera, (lx, ly, 0.0), ray)
        width, tall = camera.sensor_size
        on_sensor = (np.abs(px) <= width / 2) & (np.abs(py) <= tall / 2)
        own = _own_cell(camera, cx, cy, landing, px, py)
    status = _status_of(camera, shape, passes, on_sensor=on_sensor, own_cell=own, traceable=good)
    lit = status != RayFate.MISSED

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
) -> NDArray[np.int16]:
    """Status of every ray: who takes it first, in the order of light; the masks broadcast to `shape`."""
    numbers = {"main lens": MAIN_LENS} | {rim.name: FAP + k for k, rim in enumerate(camera.openings_ahead)}
    status = np.full(shape, RayFate.KEPT, np.int16)
    # Light's first obstacle overrules what would take the ray later.
    np.copyto(status, np.int16(RayFate.NEIGHBOUR), where=~own_cell)
    np.copyto(status, np.int16(RayFate.OFF_SENSOR), where=~on_sensor)
    for rim in reversed(camera.in_light_order):
        np.copyto(status, np.int16(state_at(numbers[rim.name])), where=~passes[rim.name])
    np.copyto(status, np.int16(RayFate.MISSED), where=~traceable)
    return status


def _through(camera: Camera, x: Floats, y: Floats) -> tuple[Vector, Projected, Projected]:
    """A microlens in the lens's frame, and the ways from the FAP's plane to the lens and to the sensor through it."""
    axis = camera.microlens(x, y)
    point = lens_point(camera, camera.fap, axis)
    return axis, point, project(point, axis, 1.0, camera.apparent_pose("sensor"))


def _crossing(camera: Camera, rim: Rim, point: Projected, axis: Vector) -> Projected:
    if rim.part == "main_lens":
        return point
    return project(point, axis, minus(1.0, axis[2] / camera.f), camera.apparent_pose(rim.part))


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
    return PACKINGS[camera.layout].in_cell(u, v)


class Fan(NamedTuple):
    """Polylines of rays for drawing, with a ruler's lengths, in the system's axes [mm]."""

    z: Floats
    """Places along the axis; shape (microlenses, rays, V), V = 4 in air: object plane, main lens, microlens, sensor."""
    x: Floats
    """Height in the meridional plane, likewise. A stopped ray repeats the point where it ended."""
    y: Floats
    """Height across it: 0 unless something is tilted about x, rotated or decentred in y."""
    status: NDArray[np.int16]
    """`PupilRays.status`, shape (microlenses, rays)."""


def fans(camera: Camera, microlens: ArrayLike, *, rays: int = 9, fill: float = 1.0) -> Fan:
    """Fans from the object plane through the pupil and one microlens each.

    They start at the plane in focus on the array or, where that is at infinity or behind the lens, one and a half times
    as far as the farthest stop or element.

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
    """
    c = np.asarray(microlens, float)[..., None]
    course = trace_pupil(camera, camera.fap.outline.across(np.linspace(-fill, fill, rays)), (c, 0.0))
    drawn = paths(camera, course, (c, 0.0), _start(camera))
    return Fan(drawn[..., 2], drawn[..., 0], drawn[..., 1], course.status)


def _start(camera: Camera) -> float:
    d_f = float(camera[PATHS["d_f"]])
    if np.isfinite(d_f) and d_f > 0:
        return d_f
    farthest = float(camera.tip)
    return 1.5 * farthest if farthest > 0 else float(camera[PATHS["d_1"]])


def paths(camera: Camera, rays: PupilRays, microlens: Point, start: float) -> Floats:
    """Polylines of traced rays as a ruler finds them, bent at every face, in the system's axes.

    Parameters
    ----------
    camera : Camera
        The build that was traced.
    rays : PupilRays
        What `trace_pupil` gave.
    microlens : pair of array_like
        As they were traced through [mm].
    start : float
        Where they begin before the main lens [mm].

    Returns
    -------
    ndarray
        Shape (*rays, V, 3) [mm], light's way: at `start`, at what stands between, the main lens, the microlens, the
        sensor. A stopped ray repeats the point where it ended.
    """
    lens = _meeting(camera, "main_lens", _line_at(camera, rays, 0.0))
    axis = _placed(camera, "microlens_array", *(np.asarray(part, float) for part in microlens))
    sensor = _placed(camera, "sensor", *rays.sensor)
    planes = [start, *(z for z in _planes(camera) if z < start)]
    before = [_on_plane(camera, rays, z) for z in planes]
    to_array, to_sensor = glass_shares(camera)
    vertices = [
        *before,
        lens,
        *(_between(lens, axis, *share) for share in to_array),
        axis,
        *(_between(axis, sensor, *share) for share in to_sensor),
        sensor,
    ]
    shape = rays.status.shape
    drawn = np.stack([np.stack([np.broadcast_to(x, shape) for x in vertex], -1) for vertex in vertices], -2)
    takers = [(state_at(MAIN_LENS), camera.rims[0])]
    takers += [(state_at(FAP + k), rim) for k, rim in enumerate(camera.openings_ahead)]
    reached = np.array([*planes, 0.0, *[-np.inf] * (len(vertices) - len(planes) - 1)])
    for code, rim in takers:
        stands = float(rim.ruler_distance)
        met = _meeting(camera, rim.part, _line_at(camera, rays, stands))
        end = np.stack([np.broadcast_to(x, shape) for x in met], -1)
        # A ray always keeps the point it starts from.
        past = (reached <= stands) & (np.arange(len(vertices)) > 0)
        drawn = np.where((rays.status == code)[..., None, None] & past[:, None], end[..., None, :], drawn)
    return np.asarray(drawn)


def _planes(camera: Camera) -> list[float]:
    """Planes where rays bend before the main lens [mm], the farthest first."""
    planes: list[float] = []
    for part in reversed(camera.chain.standing(camera.numbers)):
        near, length, steps = float(part.start), float(part.length), part.element.steps
        planes += [near + length * (steps - i) / steps for i in range(steps if length else 0)]
        planes.append(near)
    return planes


def glass_shares(camera: Camera) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Faces of glass between lens and array, and between array and sensor: shares of the way in air, and of a ruler's.

    A cover lies on the sensor.
    """
    to_array: list[tuple[float, float]] = []
    to_sensor: list[tuple[float, float]] = []
    numbers, (d_1, d_2) = camera.numbers, (float(camera[PATHS[symbol]]) for symbol in ("d_1", "d_2"))
    if (substrate := numbers.get(f"{SUBSTRATE}.thickness")) is not None:
        thick = float(substrate)
        if SUBSTRATE in camera.chain.plates_before:
            to_array.append(((d_1 - thick) / float(camera.seen.d_1), (d_1 - thick) / d_1))
        else:
            reduced = thick / float(numbers[f"{SUBSTRATE}.index"])
            to_sensor.append((reduced / float(camera.seen.d_2), thick / d_2))
    if (cover := numbers.get(f"{COVER}.thickness")) is not None:
        reduced = float(cover) / float(numbers[f"{COVER}.index"])
        to_sensor.append((1 - reduced / float(camera.seen.d_2), 1 - float(cover) / d_2))
    return to_array, to_sensor


def _between(a: Vector, b: Vector, in_air: float, ruler: float) -> Vector:
    (ax, ay, az), (bx, by, bz) = a, b
    return ax + in_air * (bx - ax), ay + in_air * (by - ay), az + ruler * (bz - az)


def _line_at(camera: Camera, rays: PupilRays, distance: float) -> tuple[Floats, Floats, Floats, Floats]:
    """The straight course of rays at a plane of object space, with a ruler: height where it meets z = 0, and slope."""
    if camera.chain.in_air:
        return (*rays.height, *rays.slope)
    plane = camera.plane(distance)
    lines = []
    for axis, off in enumerate(camera.lens_centre):
        height, slope = rays.height[axis] - off, rays.slope[axis]
        here = plane.a * height - plane.b * slope + plane.axis_offset[axis] + off
        there = (-plane.c * height + plane.d * slope + plane.axis_slope[axis]) / plane.medium
        lines.append((np.asarray(here + there * distance), np.asarray(there)))
    (hx, sx), (hy, sy) = lines
    if distance <= camera.chain.mapped_from(camera.numbers):
        return hx, hy, sx, sy

    def grown() -> Floats:
        # What the objective does not image is drawn on as the first order has it, to where it is blocked.
        p = plane.medium * np.hypot(sx, sy)
        return np.where(p <= camera.mapping.end, camera.mapping.stretch(p, plane.medium), 1.0)

    (hx, sx), (hy, sy) = camera.mapping.redrawn(lines, grown, lambda: camera.pupil_seen_before(distance))
    return hx, hy, sx, sy


def _on_plane(camera: Camera, rays: PupilRays, distance: float) -> Vector:
    hx, hy, sx, sy = _line_at(camera, rays, distance)
    return hx - sx * distance, hy - sy * distance, np.asarray(-distance)


def _meeting(camera: Camera, part: str, line: tuple[Floats, Floats, Floats, Floats]) -> Vector:
    """Points where object-side rays meet a part's plane, in the system's axes."""
    pose = camera.ruler_pose(part)
    (nx, ny, nz), (ex, ey, ez) = pose.z, pose.origin
    hx, hy, ox, oy = line
    z = (nx * (ex - hx) + ny * (ey - hy) + nz * ez) / (nx * ox + ny * oy + nz)
    return hx + ox * z, hy + oy * z, np.asarray(z)


def _placed(camera: Camera, part: str, x: Floats, y: Floats) -> Vector:
    """Points of a part's own plane in the system's axes."""
    pose = camera.ruler_pose(part)
    return along(pose.origin, x, pose.x, y, pose.y)
