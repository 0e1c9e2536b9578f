"""Through one microlens: where each rim's image lies on the sensor, in 3D, with every element decentred and tilted.

All rays through a pinhole microlens pass, in object space, through the microlens's conjugate point (an ideal lens
images points to points). The way from a rim's plane to the sensor is thus two central projections, a homography, and
the image of the rim's circle is exactly an ellipse; a disc where nothing is tilted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .algebra import Frame, Number, Vector, dot, minus, plus, times
from .camera import Camera, Rim

Linear = tuple[Number, Number, Number]
"""Coefficients of 1, alpha and beta, the coordinates on a rim's plane [mm]."""


class LensPoint(NamedTuple):
    """Homogeneous point of the main lens's plane, linear in a rim's coordinates."""

    x: Linear
    y: Linear
    w: Linear


class Ellipse(NamedTuple):
    """The points p with ``(p - centre)^T S^-1 (p - centre) = 1``."""

    x: Number
    y: Number
    """Centre [mm]."""
    xx: Number
    xy: Number
    yy: Number
    """S [mm^2]."""

    @property
    def determinant(self) -> Number:
        """Determinant of S [mm^4]; the area is pi times its root."""
        return minus(times(self.xx, self.yy), times(self.xy, self.xy))


class Projected(NamedTuple):
    """Homogeneous point of some plane, linear in a rim's coordinates."""

    u: Linear
    v: Linear
    w: Linear

    @property
    def centre(self) -> tuple[Number, Number]:
        """Image of the rim's centre [mm]."""
        return self.u[0] / self.w[0], self.v[0] / self.w[0]

    def ellipse(self, radius: Number) -> Ellipse:
        """Image of the circle of that radius about the rim's centre."""
        scale = 1.0 / self.w[0]
        bu, bv = times(self.u[0], scale), times(self.v[0], scale)
        ga, gb = times(self.w[1], scale), times(self.w[2], scale)
        ja, jb = (
            times(minus(self.u[1], times(bu, self.w[1])), scale),
            times(minus(self.u[2], times(bu, self.w[2])), scale),
        )
        ka, kb = (
            times(minus(self.v[1], times(bv, self.w[1])), scale),
            times(minus(self.v[2], times(bv, self.w[2])), scale),
        )
        xx, yy = plus(times(ja, ja), times(jb, jb)), plus(times(ka, ka), times(kb, kb))
        xy = plus(times(ja, ka), times(jb, kb))
        square = times(radius, radius)
        slant = plus(times(ga, ga), times(gb, gb))
        if isinstance(slant, float) and slant == 0.0:
            return Ellipse(bu, bv, times(square, xx), times(square, xy), times(square, yy))
        # Dual conic of the circle, N diag(r^2, r^2, -1) N^T, with the image of its centre as the origin.
        size = square / (1.0 - square * slant)
        vu, vv = plus(times(ja, ga), times(jb, gb)), plus(times(ka, ga), times(kb, gb))
        return Ellipse(
            bu - size * vu,
            bv - size * vv,
            size * plus(xx, size * times(vu, vu)),
            size * plus(xy, size * times(vu, vv)),
            size * plus(yy, size * times(vv, vv)),
        )


def lens_point(rim: Rim, microlens: Vector, f: Number) -> LensPoint:
    """Where the rays of a rim's plane that end in a microlens cross the main lens.

    With the microlens at c and its conjugate ``c' = c / (1 - c_z/f)``, the line from a through c' crosses z = 0 at
    ``(c_z a - a_z c) / (c_z - a_z (1 - c_z/f))``.
    """
    cx, cy, cz = microlens
    bend = 1.0 - cz / f
    x, y, w = [], [], []
    for k, (ax, ay, az) in enumerate((rim.pose.origin, rim.pose.x, rim.pose.y)):
        x.append(minus(times(cz, ax), times(az, cx)))
        y.append(minus(times(cz, ay), times(az, cy)))
        w.append(minus(cz if k == 0 else 0.0, times(az, bend)))
    return LensPoint((x[0], x[1], x[2]), (y[0], y[1], y[2]), (w[0], w[1], w[2]))


def project(point: LensPoint, through: Vector, weight: Number, plane: Frame, order: int = 3) -> Projected:
    """Project points of the main lens's plane through a (homogeneous) point onto an element's plane.

    Parameters
    ----------
    point : LensPoint
        What is projected.
    through, weight : vector, float or array
        The centre of projection is ``through / weight``: the microlens with 1, its conjugate with ``1 - c_z/f``.
    plane : Frame
        Results are in its coordinates.
    order : int
        1 for the rim's centre only, 3 for all coefficients.
    """

    def against(axis: Vector) -> tuple[Number, Number]:
        offset = dot(axis, plane.origin)
        return offset, minus(dot(axis, through), times(weight, offset))

    (ox, cx), (oy, cy), (oz, cz) = against(plane.x), against(plane.y), against(plane.z)
    u: list[Number] = [0.0] * 3
    v: list[Number] = [0.0] * 3
    w: list[Number] = [0.0] * 3
    for k in range(order):
        lx, ly, lw = point.x[k], point.y[k], point.w[k]
        e = minus(plus(times(plane.x[0], lx), times(plane.x[1], ly)), times(ox, lw))
        h = minus(plus(times(plane.y[0], lx), times(plane.y[1], ly)), times(oy, lw))
        n = minus(plus(times(plane.z[0], lx), times(plane.z[1], ly)), times(oz, lw))
        u[k] = minus(times(e, cz), times(n, cx))
        v[k] = minus(times(h, cz), times(n, cy))
        w[k] = minus(times(cz, lw), times(weight, n))
    return Projected((u[0], u[1], u[2]), (v[0], v[1], v[2]), (w[0], w[1], w[2]))


def rim_image(camera: Camera, rim: Rim, microlens: Vector) -> Projected:
    """Image of a rim on the sensor, through a microlens [mm, the sensor's own frame]."""
    return project(lens_point(rim, microlens, camera.f), microlens, 1.0, camera.sensor)


def chief_point(camera: Camera, microlens: Vector) -> tuple[Number, Number]:
    """Where the ray through the FAP's centre and a microlens meets the sensor [mm]."""
    return project(lens_point(camera.rims[0], microlens, camera.f), microlens, 1.0, camera.sensor, order=1).centre


def room(camera: Camera, microlens: Vector) -> Number:
    """Room between the pencil that fills the FAP and the nearest rim, on that rim's plane [mm].

    Negative where the rim cuts the pencil. Exact where nothing is tilted (the pencil is then a disc on every rim's
    plane); with tilts the pencil's reach is taken along the direction of its centre, right to first order.
    """
    pupil = camera.rims[0]
    point = lens_point(pupil, microlens, camera.f)
    bend = 1.0 - microlens[2] / camera.f
    rooms = []
    for rim in camera.rims[1:]:
        if rim is camera.rims[1]:
            crossing = Projected(point.x, point.y, point.w)
        else:
            crossing = project(point, microlens, bend, rim.pose)
        pencil = crossing.ellipse(pupil.radius)
        off = np.hypot(pencil.x, pencil.y)
        rooms.append(rim.radius - off - _reach(pencil, off))
    nearest = rooms[0]
    for other in rooms[1:]:
        nearest = np.minimum(nearest, other)
    return nearest


def _reach(pencil: Ellipse, off: Number) -> Number:
    """Half-width of an ellipse along the direction of its own centre from the origin."""
    if isinstance(pencil.xy, float) and pencil.xy == 0.0 and (pencil.xx is pencil.yy):
        return np.sqrt(pencil.xx)
    away = np.where(np.asarray(off) > 0, off, 1.0)
    a = np.where(np.asarray(off) > 0, pencil.x / away, 1.0)
    b = pencil.y / away
    reach: Number = np.sqrt(a * a * pencil.xx + 2 * a * b * pencil.xy + b * b * pencil.yy)
    return reach
