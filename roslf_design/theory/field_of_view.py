"""Angles of view, direction of view and distortion: the chief rays of the sensor's field in the scene.

Angles of view are those between chief rays, which cross in the entrance pupil (ISO 8600-3, method B: the FAP as the
scene sees it), or those of the same field seen from the middle of the bore's tip, on a plane. All of them, and what is
told of the object's size and distortion, come from the same rays (`.chief_rays`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .._arrays import Array, magnitude, ratio
from ..camera import Camera, Number
from ..design.parts import PATHS
from ..design.required import ROUND_RADIUS, Required
from ..units import parse_in, read_quantity
from .chief_rays import ChiefRays, Place, Places, chief_rays
from .light import SensorField, chief_spread, object_scale, sensor_field

Lit = Callable[[Array, Array], Array] | None
"""Radius on the array to which light reaches towards places [mm]; None where all is lit."""
NEAR = 0.002
"""Part of a pitch to either side of a microlens, between whose chief rays its scale is taken."""
STEPS, SETTLED = 60, 1e-13
"""Steps towards the rim of a round field at most, by regula falsi, and what they may miss it by, relative; one or two
where nothing is decentred, up to ten of the widest angles."""


class Across(NamedTuple):
    """A value over the width, the height and the diagonal of the field."""

    width: Array
    height: Array
    diagonal: Array

    @classmethod
    def widest(cls, values: Sequence[Array]) -> Across:
        """Widest of the values between the field's `ends`, along each direction."""
        width, height, up, down = values
        return cls(width, height, np.maximum(up, down))


def between(first: Array, second: Array) -> Array:
    """Angle between vectors, shape (..., 3) [degrees]."""
    crossed = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.asarray(np.rad2deg(np.arctan2(crossed, (first * second).sum(-1))))


def ends(field: SensorField, lit: Lit = None) -> tuple[tuple[Place, Place], ...]:
    """Opposite ends of the field from the lens's axis: left and right, below and above, of both diagonals [mm].

    Those beyond where light reaches lie where it ends, in the same directions.
    """
    (x0, y0), (x1, y1) = field
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    pairs = ((x0, y), (x1, y)), ((x, y0), (x, y1)), ((x0, y0), (x1, y1)), ((x0, y1), (x1, y0))
    return tuple((_lit_part(*one, lit), _lit_part(*other, lit)) for one, other in pairs)


def _lit_part(x: Array, y: Array, lit: Lit) -> Place:
    """A place or, beyond where light reaches, where it ends on the way there."""
    if lit is None:
        return x, y
    end, away = lit(x, y), np.sqrt(x * x + y * y)  # complex numbers, too: derivatives
    dark = away.real > end.real
    share = np.where(dark, np.where(dark, end, 1.0) / np.where(dark, away, 1.0), 1.0)
    return share * x, share * y


def _of_ends(c: Camera, field: SensorField, lit: Lit) -> tuple[tuple[ChiefRays, ChiefRays], ...]:
    """Chief rays of the field's `ends`, in that order."""
    every = [place for pair in ends(field, lit) for place in pair]
    x, y = (np.stack(np.broadcast_arrays(*axis, np.empty(c.shape))[:-1]) for axis in zip(*every, strict=True))
    rays = chief_rays(c, (x, y))
    each = [ChiefRays(*((x[k], y[k]) for x, y in rays)) for k in range(len(every))]
    return tuple(zip(each[::2], each[1::2], strict=True))


def field_of_view(c: Camera, field: SensorField, lit: Lit = None) -> Across:
    """Full angles between the chief rays of the field's ends, from the entrance pupil [degrees]."""
    return Across.widest([between(a.directions, b.directions) for a, b in _of_ends(c, field, lit)])


def tip_field_of_view(c: Camera, field: SensorField, ahead: Number | None, lit: Lit = None) -> Across:
    """Full angles under which the middle of the tip sees the field on a plane `ahead` of it [degrees].

    None is the focal plane.
    """
    away = focus_ahead(c) if ahead is None else ahead

    def direction(rays: ChiefRays) -> Array:
        return np.stack(np.broadcast_arrays(*rays.on_plane(c.tip + away), away), axis=-1)

    return Across.widest([between(direction(a), direction(b)) for a, b in _of_ends(c, field, lit)])


def object_field(c: Camera, field: SensorField, ahead: Number | None, lit: Lit = None) -> Across:
    """Width, height and diagonal of the field on a plane `ahead` of the tip, or the focal plane if None [mm]."""
    z = _plane(c, ahead)
    return Across.widest([_apart(a.on_plane(z), b.on_plane(z)) for a, b in _of_ends(c, field, lit)])


def _plane(c: Camera, ahead: Number | None) -> Number:
    """Place of a plane `ahead` of the tip, or of the focal plane if None, before the main lens [mm]."""
    return c.tip + (focus_ahead(c) if ahead is None else ahead)


def _apart(one: Places, other: Places) -> Array:
    """Distance between places on a plane [mm]."""
    with np.errstate(invalid="ignore"):  # of rays along the plane, which meet it nowhere
        away = [np.where(np.isinf(a) | np.isinf(b), np.inf, a - b) for a, b in zip(one, other, strict=True)]
    return np.asarray(np.hypot(*away))


def apart(field: SensorField, lit: Lit = None) -> Across:
    """Width, height and diagonal of the field on the array [mm]."""
    return Across.widest(
        [np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2) for (x0, y0), (x1, y1) in ends(field, lit)]
    )  # complex numbers, too: derivatives


def focus_ahead(c: Camera) -> Array:
    """Distance from the tip to the focal plane [mm]."""
    return np.asarray(c[PATHS["d_f"]] - c.tip)


def entrance_pupil_ahead(c: Camera) -> Array:
    """Distance from the tip to the entrance pupil, the FAP as the scene sees it [mm]; below 0 where it lies behind."""
    return np.asarray(c.entrance_pupil_distance - c.tip)


def entrance_pupil_diameter(c: Camera) -> Array:
    """Diameter of the entrance pupil [mm], D_F in air; inf where it is at infinity.

    By Lagrange's invariant: index times slope of a chief ray times the pupil's size are the same before and behind all
    that bends light.
    """
    return ratio(magnitude(c.seen.D_F), chief_spread(c))


def entrance_pupil_from_focus(c: Camera) -> tuple[Array, Array]:
    """Vergence of the entrance pupil at the focal plane [1/mm], and its diameter over the distance between them.

    1 over that distance, below 0 of a pupil beyond the focal plane; finite where the pupil is at infinity, and 0 where
    the focal plane is.
    """
    plane, seen, endless = c.focus, c.seen, np.isinf(c[PATHS["d_f"]])
    with np.errstate(invalid="ignore"):
        away = np.where(endless, np.inf, plane.medium * (plane.b - plane.a * seen.d_3))
    return ratio(plane.d - plane.c * seen.d_3, away), ratio(magnitude(seen.D_F), magnitude(away))


def feet(field: SensorField) -> tuple[Place, ...]:
    """Places of the field's four sides that are nearest to the lens's axis, left, right, below and above [mm]."""
    (x0, y0), (x1, y1) = field
    nothing = np.zeros_like(x0)
    return (x0, nothing), (x1, nothing), (nothing, y0), (nothing, y1)


def round_within(field: SensorField, off: Array) -> Array:
    """Least of what chief rays of the field's `feet` are off the axis, shape (4, ...); 0 where that lies outside."""
    (x0, y0), (x1, y1) = field
    inside = np.stack(np.broadcast_arrays(-x0, x1, -y0, y1)).reshape(
        4, *[1] * (off.ndim - 1 - np.ndim(x0)), *np.shape(x0)
    )
    return np.asarray(np.where(inside > 0, off, 0.0).min(axis=0))


def off_axis(directions: Array) -> Array:
    """Angle to the axis of unit vectors, shape (..., 3) [rad]."""
    return np.asarray(np.arctan2(np.hypot(directions[..., 0], directions[..., 1]), directions[..., 2]))


def round_field_of_view(c: Camera, field: SensorField) -> Array:
    """Full angle of the widest cone about the axis all of which the sensor sees, from the entrance pupil [degrees]."""
    return np.rad2deg(2 * round_within(field, off_axis(_of_feet(c, field).directions)))


def round_object_radius(c: Camera, field: SensorField, ahead: Number | None) -> Array:
    """Radius of the largest circle about the axis all of which the sensor sees, `ahead` of the tip or in focus [mm]."""
    return round_within(field, np.hypot(*_of_feet(c, field).on_plane(_plane(c, ahead))))


def _of_feet(c: Camera, field: SensorField) -> ChiefRays:
    x, y = (np.stack(np.broadcast_arrays(*axis, np.empty(c.shape))[:-1]) for axis in zip(*feet(field), strict=True))
    return chief_rays(c, (x, y))


def judged_field(c: Camera) -> SensorField:
    """Part of the array to be lit and imaged: all that the sensor sees, or the square whose corners lie on the rim.

    That rim is of the widest round field that is required, at the nearest of four places along x and y; of a camera
    that does not see it, even towards its corner, all that the sensor sees.
    """
    key = "judged field"
    if key not in c.worked_out:
        c.worked_out[key] = _judged_field(c)
    field: SensorField = c.worked_out[key]
    return field


def _judged_field(c: Camera) -> SensorField:
    field, asked = sensor_field(c), [(one, least) for one in c.round_fields if (least := _least(one)) > 0]
    if not asked:
        return field

    def beyond(radius: Array) -> Array:
        circle = SensorField((-radius, -radius), (radius, radius))
        return np.asarray(np.min([_reached(c, circle, *one) for one in asked], axis=0))

    far = np.broadcast_to(field.radius, c.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        radius, seen = far, beyond(far) >= 0
        ends, values = [np.zeros(c.shape), far], [np.full(c.shape, -1.0), beyond(far)]
        for _ in range(STEPS if seen.any() else 0):
            radius = ends[1] - values[1] * (ends[1] - ends[0]) / (values[1] - values[0])
            value = beyond(radius)
            if np.all(np.abs(value[seen]) <= SETTLED):
                break
            # The end that stays counts less (Illinois), so that both move.
            same_side = (value < 0) == (values[1] < 0)
            ends = [np.where(same_side, ends[0], ends[1]), radius]
            values = [np.where(same_side, values[0] / 2, values[1]), value]
    if not seen.any():
        return field
    half = radius / np.sqrt(2)
    left, below, right, above = (
        np.where(seen, sign * half, end) for sign, side in zip((-1, 1), field, strict=True) for end in side
    )
    return SensorField((left, below), (right, above))


def _least(asked: Required) -> float:
    """Least radius [mm] or full angle [deg] of a round field that is required; 0 where it is at most limited."""
    if asked.quantity == ROUND_RADIUS:
        return read_quantity(asked.min or 0.0, "length", unit_required=False)
    return parse_in(asked.min, "deg") if isinstance(asked.min, str) else asked.min or 0.0


def _reached(c: Camera, circle: SensorField, asked: Required, least: float) -> Array:
    """Round field that a circle on the array sees over the least that is required, less 1."""
    if asked.quantity == ROUND_RADIUS:
        return round_object_radius(c, circle, asked.at) / least - 1
    seen = np.deg2rad(round_field_of_view(c, circle))  # tangents are nearly proportional to radii
    return np.asarray(np.tan(seen / 2) / math.tan(math.radians(least / 2)) - 1)


def direction_of_view(c: Camera, field: SensorField) -> Array:
    """Angle between the tube's axis and the chief ray of the field's middle, folds of the axis included [degrees]."""
    (x0, y0), (x1, y1) = field
    # Away from the bore the axis counts up, in the system's axes down.
    x, y, z = np.moveaxis(
        (chief_rays(c, ((x0 + x1) / 2, (y0 + y1) / 2)).directions * [1, 1, -1]) @ c.chain.fold.T, -1, 0
    )
    return np.asarray(np.rad2deg(np.arctan2(np.hypot(x, y), -z)))


def scales(c: Camera, place: Place, at: Number | None) -> tuple[Number, Number]:
    """Millimetres on a plane per millimetre on the array about a microlens, along the field's radius and across it.

    Parameters
    ----------
    place : pair of float or ndarray
        The microlens, from the main lens's axis [mm].
    at : float, ndarray or None
        How far ahead of the tip the plane is [mm]; None is the focal plane.
    """
    if not c.chain.bends_rays:
        axial = object_scale(c, at)
        return axial, axial
    x, y, step, _ = np.broadcast_arrays(*place, NEAR * c.d, np.empty(c.shape))
    radius = np.hypot(x, y)
    cos, sin = (np.where(radius > 0, ratio(part, radius), one) for part, one in ((x, 1.0), (y, 0.0)))
    ways = ((cos, sin), (-cos, -sin), (-sin, cos), (sin, -cos))
    rays = chief_rays(c, (np.stack([x + step * u for u, _ in ways]), np.stack([y + step * v for _, v in ways])))
    met = rays.on_plane(c.tip + (focus_ahead(c) if at is None else at))
    along, across = (_apart(*((met[0][k], met[1][k]) for k in pair)) / (2 * step) for pair in ((0, 1), (2, 3)))
    return along, across
