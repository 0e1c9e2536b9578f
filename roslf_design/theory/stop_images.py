"""Images of stops on the sensor, through a microlens, with every element decentred and tilted.

All rays through a pinhole microlens pass, in object space, through the microlens's conjugate point (an ideal lens
images points to points). The way from a stop's plane to the sensor is thus two central projections, a homography, and
the image of the stop's circle is exactly an ellipse; a disc where nothing is tilted: there a stop at z, of radius R and
decentre e, is seen from the microlens at c as the disc of radius ``s R`` about ``c + s (c (1 - z/f) - e)`` with
``s = d_2 h/d_1`` and ``h = d_f/(d_f - z)``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array, floats, magnitude, product, ratio
from ..bore.opening import ClearAperture, farthest, repeated
from ..bore.part import minus, plus, times
from ..camera import Camera, Frame, Number, Rim, Vector
from ..camera.frames import cross, dot, frame, total
from ..shapes.discs import DiscIntersection
from ..shapes.ellipses import intersect_ellipses
from ..shapes.openings import Openings
from .chief_rays import ChiefRays, chief_rays, outer_slopes
from .exit_pupil import stop_angle
from .field_of_view import scales
from .leaning import least_of_angles
from .light import falloff, object_scale

Linear = tuple[Number, Number, Number]
"""Coefficients of 1, alpha and beta, the coordinates on a stop's plane [mm]."""


class _Ellipse(NamedTuple):
    """The points p with ``(p - centre)^T S^-1 (p - centre) = 1``."""

    x: Number
    y: Number
    """Centre [mm]."""
    xx: Number
    xy: Number
    yy: Number
    """S [mm^2]."""

    @property
    def width(self) -> Number:
        """Diameter of the disc as large [mm]."""
        return 2 * np.sqrt(np.sqrt(cross(self.xx, self.yy, self.xy, self.xy)))

    @property
    def reach(self) -> Number:
        """Distance of its farthest point from the origin, along the direction of its centre."""
        off = np.hypot(self.x, self.y)
        return off + _reach(self, off)

    def support(self, x: Number, y: Number) -> Number:
        """How far it reaches along a direction, a unit vector, from the origin."""
        return x * self.x + y * self.y + np.sqrt(x * x * self.xx + 2 * x * y * self.xy + y * y * self.yy)


class _Polygon(NamedTuple):
    """Image of straight sides: corners counterclockwise [mm]."""

    corners: tuple[tuple[Number, Number], ...]

    @property
    def x(self) -> Number:
        """Middle of its corners [mm]."""
        return sum(x for x, _ in self.corners) / len(self.corners)

    @property
    def y(self) -> Number:
        """Middle of its corners [mm]."""
        return sum(y for _, y in self.corners) / len(self.corners)

    @property
    def width(self) -> Number:
        """The wider of its extents along x and y [mm]."""
        ways = (1.0, 0.0), (0.0, 1.0)
        return reduce(np.maximum, [self.support(x, y) + self.support(-x, -y) for x, y in ways])

    @property
    def reach(self) -> Number:
        """Distance of its farthest point from the origin."""
        return farthest(self.corners)

    def support(self, x: Number, y: Number) -> Number:
        """How far it reaches along a direction from the origin."""
        return reduce(np.maximum, [x * a + y * b for a, b in self.corners])


class Projected(NamedTuple):
    """Homogeneous point of some plane, linear in a stop's coordinates."""

    u: Linear
    v: Linear
    w: Linear

    @property
    def centre(self) -> tuple[Number, Number]:
        """Image of the stop's centre [mm]."""
        return np.divide(self.u[0], self.w[0]), np.divide(self.v[0], self.w[0])

    def at(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Image of points (a, b) of the stop's plane [mm]."""
        (u, v, w) = (part[0] + part[1] * a + part[2] * b for part in self)
        return u / w, v / w

    def ahead(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Whether light from those points gets there, as it does from the stop's centre: not from behind."""
        w = self.w
        return np.asarray((w[0] + w[1] * a + w[2] * b) * w[0] > 0)

    def image(self, opening: ClearAperture) -> _Ellipse | _Polygon:
        """Image of an opening about the stop's centre."""
        if not opening.straight:
            return self.ellipse(opening.radius)
        corners = [self.at(np.asarray(a), np.asarray(b)) for a, b in opening.corners]
        return _Polygon(tuple(corners))

    def ellipse(self, radius: Number) -> _Ellipse:
        """Image of the circle of that radius about the stop's centre."""
        scale, square = 1.0 / self.w[0], times(radius, radius)
        bu, bv = times(self.u[0], scale), times(self.v[0], scale)
        ga, gb = times(self.w[1], scale), times(self.w[2], scale)
        left = np.asarray(1.0 - square * total(0.0, ga, ga, gb, gb))
        beyond = left.real <= 0
        if beyond.any():  # it leans through an image of the plane in focus: as if upright
            upright = np.where(beyond, 0.0, 1.0)[()]
            ga, gb, left = times(ga, upright), times(gb, upright), np.where(beyond, 1.0, left)
        ja, jb = (minus(times(self.u[k], scale), times(bu, g)) for k, g in ((1, ga), (2, gb)))
        ka, kb = (minus(times(self.v[k], scale), times(bv, g)) for k, g in ((1, ga), (2, gb)))
        xx, yy, xy = total(0.0, ja, ja, jb, jb), total(0.0, ka, ka, kb, kb), total(0.0, ja, ka, jb, kb)
        # Dual conic of the circle, N diag(r^2, r^2, -1) N^T, with the image of its centre as the origin.
        size = square / left[()]
        vu, vv = total(0.0, ja, ga, jb, gb), total(0.0, ka, ga, kb, gb)
        return _Ellipse(
            bu - size * vu,
            bv - size * vv,
            size * plus(xx, size * times(vu, vu)),
            size * plus(xy, size * times(vu, vv)),
            size * plus(yy, size * times(vv, vv)),
        )


def lens_point(c: Camera, rim: Rim, microlens: Vector) -> Projected:
    """Point on the main lens of the rays of a stop's plane that end in a microlens.

    With the microlens at c and its conjugate ``c' = c / (1 - c_z/f)``, the line from a through c' crosses z = 0 at
    ``(c_z a - a_z c) / (c_z - a_z (1 - c_z/f))``.
    """
    cx, cy, cz = microlens
    bend = 1.0 - cz / c.f
    pose = c.apparent_pose(rim.part)
    columns = []
    for own, (ax, ay, az) in zip((cz, 0.0, 0.0), (pose.origin, pose.x, pose.y), strict=True):
        columns.append((cross(cz, ax, az, cx), cross(cz, ay, az, cy), minus(own, times(az, bend))))
    return Projected(*zip(*columns, strict=True))


def project(point: Projected, through: Vector, weight: Number, plane: Frame) -> Projected:
    """Project points of the main lens's plane through a (homogeneous) point onto an element's plane.

    Parameters
    ----------
    point : Projected
        What is projected, on the main lens's plane.
    through, weight : vector, float or array
        The centre of projection is ``through / weight``: the microlens with 1, its conjugate with ``1 - c_z/f``.
    plane : Frame
        Results are in its coordinates.
    """

    def against(axis: Vector) -> tuple[Vector, Number]:
        """Coefficients of a homogeneous point's coordinate along an axis of the plane, and the centre's coordinate."""
        offset = minus(0.0, dot(axis, plane.origin))
        return (axis[0], axis[1], offset), plus(dot(axis, through), times(weight, offset))

    (x, cx), (y, cy), (z, cz) = against(plane.x), against(plane.y), against(plane.z)
    columns = []
    for column in zip(*point, strict=True):
        e, h, n = dot(x, column), dot(y, column), dot(z, column)
        columns.append((cross(e, cz, n, cx), cross(h, cz, n, cy), cross(cz, column[2], weight, n)))
    return Projected(*zip(*columns, strict=True))


def _stop_image(c: Camera, rim: Rim, microlens: Vector) -> Projected:
    """Image of a stop on the sensor, through a microlens [mm, the sensor's own frame]."""
    return project(lens_point(c, rim, microlens), microlens, 1.0, c.apparent_pose("sensor"))


def _room(rim: ClearAperture, pencil: _Ellipse | _Polygon) -> Number:
    """Room between a pencil and a rim about the origin of the rim's plane [mm]."""
    if not rim.straight and isinstance(pencil, _Ellipse):
        off = np.hypot(pencil.x, pencil.y)
        return rim.radius - off - _reach(pencil, off)
    return reduce(np.minimum, [edge - pencil.support(*normal) for normal, edge in rim.sides], rim.radius - pencil.reach)


def _reach(pencil: _Ellipse, off: Number) -> Number:
    """Half-width of an ellipse along the direction of its own centre from the origin."""
    if isinstance(pencil.xy, float) and pencil.xy == 0.0 and (pencil.xx is pencil.yy):
        return np.sqrt(pencil.xx)
    away = np.where(np.asarray(off) > 0, off, 1.0)
    a = np.where(np.asarray(off) > 0, pencil.x / away, 1.0)
    b = pencil.y / away
    reach: Number = np.sqrt(a * a * pencil.xx + 2 * a * b * pencil.xy + b * b * pencil.yy)
    return reach


def _farthest(pencil: Projected, radius: Number, shape: tuple[int, ...]) -> Number:
    """Largest distance from the middle of a stop's plane at which a pencil that fills the FAP meets it [mm]."""

    def nearness(around: Array) -> Array:
        return -np.hypot(*pencil.at(np.asarray(radius * np.cos(around)), np.asarray(radius * np.sin(around))))

    return -least_of_angles(nearness, shape, 1)


ROUNDING = 2.0**-49
"""Share of a radius, or of a distance, that a few roundings make up."""


def room_in_pupil(c: Camera, rim: Rim) -> Array:
    """Room that a rim in the FAP's own plane leaves about it [mm, on that plane]; nan where it stands elsewhere.

    The same at any field: such a rim, as the main lens is to a pupil at d_3 = 0, cuts all microlens images or none.
    What rounding leaves of no room is none.
    """
    radius, distance, pupil = floats(rim.radius, rim.distance, c.fap.distance)
    beside = np.abs(distance - pupil) <= ROUNDING * np.maximum(c.f, np.abs(pupil))
    if not beside.any():
        return np.asarray(np.nan)
    (x, y), (u, v) = c.decentre(rim.part), c.decentre("aperture")
    room = settled(np.asarray(rim.outline.room(c.fap.outline, u - x, v - y)), radius)
    return np.where(beside, room, np.nan)


def settled(room: Array, size: Number) -> Array:
    """Room beside a rim of a size, none where rounding alone tells it from none."""
    return np.where(np.abs(room) <= ROUNDING * np.abs(size), 0.0, room)


def stop_discs(c: Camera, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Discs that the FAP and the rims cut out of the light behind pinhole microlenses.

    Parameters
    ----------
    c : Camera
        Its tilts are left out.
    x, y : array_like
        Microlens axes counted from the main lens's centre [mm], shape (...); they broadcast with the builds.

    Returns
    -------
    (centres, radii)
        Shapes (..., K, 2) and (..., K) [mm], the FAP first, then `Camera.rims`; centres relative to the microlens
        axis, where the digits are. inf where a stop stands in the focal plane.
    """
    at_x, at_y = floats(x, y)
    rims = (c.fap, *c.rims)
    shape = *np.broadcast_shapes(at_x.shape, at_y.shape, c.shape), len(rims)
    centres, radii = np.empty((*shape, 2)), np.empty(shape)
    if not c.shape:  # all of one camera at once
        distance = np.array([rim.distance for rim in rims], float)
        scale = product(c.seen.d_2, stop_angle(c, distance))
        bend = (c.f - distance) / c.f
        aside = np.array([c.decentre(rim.part) for rim in rims], float)
        centres[..., 0] = product(scale, at_x[..., None] * bend - aside[:, 0])
        centres[..., 1] = product(scale, at_y[..., None] * bend - aside[:, 1])
        radii[:] = np.array([rim.radius for rim in rims], float) * magnitude(scale)
    for k, rim in enumerate(rims if c.shape else ()):
        scale = product(c.seen.d_2, stop_angle(c, rim.distance))
        bend = (c.f - rim.distance) / c.f  # d_1/L_k over h: one factor for both terms, or they would be inf - inf
        e_x, e_y = c.decentre(rim.part)
        centres[..., k, 0] = product(scale, at_x * bend - e_x)
        centres[..., k, 1] = product(scale, at_y * bend - e_y)
        radii[..., k] = rim.radius * magnitude(scale)
    for k, rim in enumerate(c.rims, 1):
        whole = room_in_pupil(c, rim) >= 0
        if np.any(whole):  # no rounding of centres may cut there
            apart = np.hypot(*np.moveaxis(centres[..., k, :] - centres[..., 0, :], -1, 0))
            same = (apart == 0) & (radii[..., k] == radii[..., 0])  # which cuts nothing either
            around = np.maximum(radii[..., k], (radii[..., 0] + apart) * (1 + ROUNDING))
            radii[..., k] = np.where(whole & ~same, around, radii[..., k])
    return centres, radii


def stop_openings(c: Camera, x: ArrayLike, y: ArrayLike) -> Openings:
    """Openings that the FAP and the rims cut out of the light behind pinhole microlenses, as `stop_discs`.

    Further rims lean as they do: those of tilted stops and of mirrors are ellipses, or quadrilaterals.
    """
    centres, radii = stop_discs(c, x, y)
    every = (c.fap, *c.rims)
    straight = tuple(k for k in range(len(every)) if every[k].outline.straight)
    leaning = {
        k: _leaning_image(c, rim, x, y)
        for k, rim in enumerate(every)
        if k > 1 and np.any(np.isfinite(rim.outline.reach)) and any(np.any(tilt) for tilt in c.tilt(rim.part))
    }
    if not straight and not leaning:
        return Openings.of_discs(centres, radii)
    most = max((len(every[k].outline.corners) for k in straight), default=4)
    corners = np.empty((*radii.shape[:-1], len(straight), most, 2))
    ellipses = tuple(k for k in leaning if k not in straight)
    forms = np.empty((*radii.shape[:-1], len(ellipses), 3))
    for n, k in enumerate(straight):
        sign = 1.0 if (plane := every[k].plane) is None else np.sign(plane.magnification)
        scale = -sign * product(c.seen.d_2, stop_angle(c, every[k].distance))
        upright = [(x * scale, y * scale) for x, y in every[k].outline.corners]
        seen = leaning[k].image(every[k].outline) if k in leaning else None
        for m, corner in enumerate(repeated(tuple(upright), most)):
            for axis in (0, 1):
                at = centres[..., k, axis] + np.asarray(corner[axis])
                corners[..., n, m, axis] = repeated(seen.corners, most)[m][axis] if isinstance(seen, _Polygon) else at
        radii[..., k] = math.inf
    for n, k in enumerate(ellipses):
        seen = leaning[k].ellipse(every[k].radius)
        centres[..., k, 0], centres[..., k, 1], radii[..., k] = seen.x, seen.y, math.inf
        forms[..., n, 0], forms[..., n, 1], forms[..., n, 2] = seen.xx, seen.xy, seen.yy
    return Openings(centres, radii, corners, straight, forms, ellipses)


def _leaning_image(c: Camera, rim: Rim, x: ArrayLike, y: ArrayLike) -> Projected:
    """Image on the sensor of a rim's plane, from the axis of a microlens at (x, y), as if all else stood straight.

    A point a of that plane is seen ``d_2 (c (1 + a_z/f) - a) / (d_1 - a_z (1 - d_1/f))`` from the axis of the microlens
    at c.
    """
    pose, cx, cy = frame(c.decentre(rim.part), -rim.distance, c.tilt(rim.part)), *floats(x, y)
    d_1, d_2 = c.seen.d_1, c.seen.d_2
    bend, columns = 1 - d_1 / c.f, []
    for own, (ax, ay, az) in zip((1.0, 0.0, 0.0), (pose.origin, pose.x, pose.y), strict=True):
        share = own + az / c.f
        columns.append((d_2 * (cx * share - ax), d_2 * (cy * share - ay), own * d_1 - az * bend))
    return Projected(*zip(*columns, strict=True))


def _disc(c: Camera, rim: Rim) -> tuple[Number, tuple[Number, Number], Number]:
    """One of `stop_discs`: how far its centre lies aside per millimetre of the microlens, and on the axis; radius."""
    scale = product(c.seen.d_2, stop_angle(c, rim.distance))
    e_x, e_y = c.decentre(rim.part)
    reach = rim.outline.inradius if rim is not c.fap else rim.radius
    return scale * ((c.f - rim.distance) / c.f), (scale * e_x, scale * e_y), reach * np.abs(scale)


CLEAR, TILTED = 0.02, 10.0
"""Share of a rim that tilts do not reach across: this much, and this much for each radian of the largest tilt."""


class MicrolensImages:
    """Microlens images at some fields of any number of builds; what several numbers share is computed once.

    Parameters
    ----------
    camera : Camera
        The builds, shape (trials,) or ().
    fields : array_like, shape (fields, 2)
        Microlens positions on the array, in its own frame [mm].

    Notes
    -----
    Every number broadcasts to (fields, trials). Where nothing is tilted stops are discs, else ellipses; both exactly.
    """

    def __init__(self, camera: Camera, fields: ArrayLike) -> None:
        self.camera = camera
        self.fields = np.asarray(fields, np.float64).reshape(-1, 2)
        self.x, self.y = self.fields[:, :1], self.fields[:, 1:]
        self.microlens = camera.microlens(self.x, self.y)

    def by(self, camera: Camera) -> MicrolensImages:
        """Images of another camera at the same fields, by closed forms."""
        return MicrolensImages(camera, self.fields)

    @cached_property
    def in_system(self) -> Array:
        """Microlens axes against the optical axis, tilts left out: shape (fields, 2) for one camera [mm]."""
        decentre = [self.camera[f"main_lens.decentre.{axis}"] for axis in (0, 1)]
        return np.asarray(self.from_lens + np.asarray(decentre))

    @cached_property
    def from_lens(self) -> Array:
        """Microlens axes against the main lens's centre, tilts left out: shape (fields, 2) for one camera [mm]."""
        n = self.camera
        turn = n["microlens_array.rotation"]
        cos, sin = np.cos(turn), np.sin(turn)
        e_x, e_y = n.decentre("microlens_array")
        x, y = self.fields.T
        return np.stack([x * cos - y * sin + e_x, x * sin + y * cos + e_y], -1)

    @property
    def spot_pitches(self) -> Number:
        """Rms radius of a point in focus on the array [microlens pitches]: 0, of an ideal lens's rays."""
        return np.zeros((len(self.fields), *(self.camera.shape or (1,))))

    @cached_property
    def stretch(self) -> tuple[Number, Number]:
        """Stretch of a microlens's part of the focal plane against that on the axis.

        Along the field's radius and across it.
        """
        along, across = self.scales(None)
        axial = object_scale(self.camera)
        return ratio(along, axial), ratio(across, axial)

    def scales(self, at: Number | None) -> tuple[Number, Number]:
        """Millimetres on a plane ahead of the tip per millimetre on the array, along the field's radius and across it.

        None is the focal plane.
        """
        return scales(self.camera, (self.microlens[0], self.microlens[1]), at)

    @cached_property
    def chief_rays(self) -> ChiefRays:
        """Rays through the middles of microlenses and the FAP, in front of the bore."""
        return chief_rays(self.camera, (self.microlens[0], self.microlens[1]))

    @property
    def directions(self) -> Array:
        """Unit vectors of chief rays away from the bore, in the medium of the scene; shape (..., 3), the axis last."""
        return self.chief_rays.directions

    def on_plane(self, ahead: Number) -> tuple[Number, Number]:
        """Points where chief rays meet a plane `ahead` of the bore's tip, from the system's axis [mm]."""
        return self.chief_rays.on_plane(self.camera.tip + ahead)

    @cached_property
    def level(self) -> Number:
        """Light of a pixel that a microlens lights against such a pixel on the axis."""
        slopes = outer_slopes(self.camera, (self.microlens[0], self.microlens[1]))
        return falloff(self.camera, np.hypot(*slopes))

    @cached_property
    def illumination(self) -> Number:
        """Light of a microlens against one whose image nothing cuts, on the axis."""
        return self.shapes.kept_fraction * self.level

    @cached_property
    def openings(self) -> Openings:
        """Images of the FAP and the rims where nothing is tilted, as `stop_openings` gives them."""
        x, y = self.microlens[:2]
        shape = (len(self.fields), *(self.camera.shape or (1,)))
        return stop_openings(self.camera, np.broadcast_to(x, shape), np.broadcast_to(y, shape))

    @cached_property
    def _through_fap(self) -> Projected:
        """Points on the main lens of the rays of the FAP's plane."""
        return lens_point(self.camera, self.camera.fap, self.microlens)

    @cached_property
    def outline(self) -> _Ellipse | _Polygon:
        """The FAP's image, as if nothing cut it."""
        image = project(self._through_fap, self.microlens, 1.0, self.camera.apparent_pose("sensor"))
        return image.image(self.camera.fap.outline)

    @cached_property
    def diameter(self) -> Number:
        """Diameter of the disc as large as the uncut image [mm]; of a rectangle its wider extent along x and y."""
        return self.outline.width

    @cached_property
    def pitch(self) -> Number:
        """Distance between neighbouring images [mm], from the points half a pitch to either side."""
        c, half = self.camera, self.camera.d / 2
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = (
            c.chief_point(self.x + a * half, self.y + b * half) for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))
        )
        return np.sqrt(np.abs((x1 - x0) * (y3 - y2) - (y1 - y0) * (x3 - x2)))

    @cached_property
    def clearance(self) -> Number:
        """Room between the pencil that fills the FAP and the nearest rim, on that rim's plane [mm].

        Negative where the rim cuts the pencil. Exact where nothing is tilted (the pencil is then a disc on every rim's
        plane); with tilts the pencil's reach is taken along the direction of its centre, right to first order.
        """
        c, point = self.camera, self._through_fap
        bend = 1.0 - self.microlens[2] / c.f
        upright = not c.tilted
        rooms, discs = list[Number](), list[tuple[Number, ...]]()
        for rim in c.rims:
            on_lens = rim.part == "main_lens"
            anywhere = room_in_pupil(c, rim) if upright else np.asarray(math.nan)
            elsewhere = np.isnan(anywhere)
            if upright and c.fap.round and rim.round and not on_lens and elsewhere.all():
                discs.append((*c.apparent_pose(rim.part).origin, rim.radius, rim.scale))
                continue
            crossing = point if on_lens else project(point, self.microlens, bend, c.apparent_pose(rim.part))
            if rim.leans:
                off = np.hypot(*crossing.ellipse(c.fap.radius)[:2])
                room = settled(np.asarray(rim.radius - _farthest(crossing, c.fap.radius, np.shape(off))), rim.radius)
            else:
                room = settled(np.asarray(_room(rim.outline, crossing.image(c.fap.outline))), rim.radius)
            rooms.append(times(rim.scale, np.where(elsewhere, room, anywhere)))
        return reduce(np.minimum, [*rooms, *([self._least_room(discs, bend)] if discs else [])])

    def _least_room(self, discs: Sequence[tuple[Number, ...]], bend: Number) -> Number:
        """Least room beside upright discs by place, radius and scale: all at once, on a first axis of theirs."""
        axes = max(1, *map(np.ndim, (*self.microlens, bend)))

        def stacked(numbers: Iterable[Number]) -> Array:
            row = np.stack(np.broadcast_arrays(*numbers))
            return row.reshape(len(row), *(1,) * (axes + 1 - row.ndim), *row.shape[1:])

        x, y, z, radius, scale = map(stacked, zip(*discs, strict=True))
        pose = Frame((x, y, z), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        crossing = project(self._through_fap, self.microlens, bend, pose)
        rooms = settled(np.asarray(_room(ClearAperture(radius), crossing.image(self.camera.fap.outline))), radius)
        return np.asarray(np.min(times(scale, rooms), axis=0))

    @cached_property
    def chief(self) -> tuple[Number, Number]:
        """Image centres: where the chief rays meet the sensor [mm]."""
        return self.camera.chief_point(self.x, self.y)

    @cached_property
    def through_lens(self) -> tuple[Number, Number]:
        """Points of the sensor that rays through the main lens's centre meet [mm]."""
        return _stop_image(self.camera, self.camera.rims[0], self.microlens).centre

    @property
    def _clear(self) -> tuple[bool, ...]:
        """Whether a rim stays so far off every image of every build that no tilt brings it there; of each rim."""
        c = self.camera
        (e_x, e_y), room = c.decentre("microlens_array"), 1 - CLEAR - TILTED * c.largest_tilt
        reach = np.max(np.hypot(self.x, self.y)) + np.hypot(e_x, e_y)
        (bend, (x, y), radius), *others = (_disc(c, rim) for rim in (c.fap, *c.rims))
        return tuple(
            k not in c.leaning and bool(np.all(reach * np.abs(b - bend) + np.hypot(u - x, v - y) + radius <= room * r))
            for k, (b, (u, v), r) in enumerate(others)
        )

    @cached_property
    def shapes(self) -> DiscIntersection:
        """The lit parts, what all stops leave of the FAP's image [mm].

        Positions count from the microlens axis where nothing is tilted, else from the centre of the FAP's image.
        """
        c = self.camera
        if not c.tilted:
            return self.openings.common()
        shape = (len(self.fields), *(c.shape or (1,)))
        rims = [rim for rim, clear in zip(c.rims, self._clear, strict=True) if not clear]
        images = [self.outline, *(_stop_image(c, rim, self.microlens).image(rim.outline) for rim in rims)]
        order = np.argsort([isinstance(image, _Polygon) for image in images], kind="stable")
        ellipses = [image for image in images if isinstance(image, _Ellipse)]
        polygons = [image for image in images if isinstance(image, _Polygon)]
        centres, matrices = np.empty((*shape, len(ellipses), 2)), np.empty((*shape, len(ellipses), 3))
        for k, image in enumerate(ellipses):
            centres[..., k, 0], centres[..., k, 1] = image.x - self.outline.x, image.y - self.outline.y
            matrices[..., k, 0], matrices[..., k, 1], matrices[..., k, 2] = image.xx, image.xy, image.yy
        most = max((len(one.corners) for one in polygons), default=4)
        corners = np.empty((*shape, len(polygons), most, 2))
        for k, one in enumerate(polygons):
            for m, (x, y) in enumerate(repeated(one.corners, most)):
                corners[..., k, m, 0], corners[..., k, m, 1] = x - self.outline.x, y - self.outline.y
        places = np.argsort(order)
        part = intersect_ellipses(centres, matrices, corners, int(places[0]))
        return part._replace(clipping=part.clipping[..., places])
