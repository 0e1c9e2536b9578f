"""Where the chief rays of the sensor's field go in the scene: angles of view, direction of view, distortion.

Angles of view are those between chief rays, which cross in the entrance pupil (ISO 8600-3, method B: the FAP as the
scene sees it), or those of the same field seen from the middle of the bore's tip, on a plane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._arrays import Array, product, ratio
from ..camera import Camera, Number
from ..design.parts import PATHS
from ..lenses.angles import angle_in_air
from .light import SensorField

Place = tuple[Number, Number]


class Across(NamedTuple):
    """A value over the width, the height and the diagonal of the field."""

    width: Array
    height: Array
    diagonal: Array


def outer_slopes(c: Camera, place: Place) -> Place:
    """Index times slope, to first order, of a microlens's chief ray in front of the bore, along x and y.

    Parameters
    ----------
    c : Camera
        Its tilts but those of elements are left out.
    place : pair of float or ndarray
        The microlens, from the main lens's axis [mm].
    """
    front = c.front[1]
    out = []
    for at, pupil, lean in zip(place, c.decentre("aperture"), front.lean, strict=True):
        before = ratio(pupil + product(at, c.inverse_m), c.gap)
        out.append(front.d * before - front.c * (pupil + before * c.d_3) + lean)
    return out[0], out[1]


def directions(c: Camera, place: Place) -> Array:
    """Unit vectors of chief rays away from the bore, in the medium of the scene; shape (..., 3), the axis last.

    By Snell's law, as for `light.field_angle`; parameters are those of `outer_slopes`.
    """
    x, y = outer_slopes(c, place)
    steep = np.hypot(x, y)
    in_air = np.arctan(steep) if c.law is None else angle_in_air(c.law, np.minimum(steep, c.law[0, 1]))
    sine = np.sin(in_air) / c.front[1].medium
    share = np.where(steep > 0, ratio(sine, np.asarray(steep)), 0.0)
    along = np.broadcast_arrays(-share * x, -share * y, np.sqrt((1 - sine) * (1 + sine)))
    return np.stack(along, axis=-1)


def on_plane(c: Camera, place: Place, ahead: Number) -> Place:
    """Where the chief ray of a microlens meets a plane `ahead` of the bore's tip, from the system's axis [mm]."""
    z = c.tip + ahead
    plane = c.plane(z)
    slopes = outer_slopes(c, place)
    steep = np.hypot(*slopes)
    met = []
    for axis, (at, pupil, aside, slope) in enumerate(
        zip(place, c.decentre("aperture"), plane.aside, slopes, strict=True)
    ):
        before = ratio(pupil + product(at, c.inverse_m), c.gap)
        x = plane.a * (pupil + before * c.d_3) - plane.b * before + aside + c[f"main_lens.decentre.{axis}"]
        if c.law is not None:
            x = x - slope / plane.medium * (c.stretch(steep) - 1) * (z - c.pupil_stands)
        met.append(x)
    return met[0], met[1]


def between(first: Array, second: Array) -> Array:
    """Angle between vectors, shape (..., 3) [degrees]."""
    crossed = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.asarray(np.rad2deg(np.arctan2(crossed, (first * second).sum(-1))))


def ends(field: SensorField) -> tuple[tuple[Place, Place], ...]:
    """Opposite ends of the field from the lens's axis: left and right, below and above, of both diagonals [mm]."""
    (x0, y0), (x1, y1) = field
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    return ((x0, y), (x1, y)), ((x, y0), (x, y1)), ((x0, y0), (x1, y1)), ((x0, y1), (x1, y0))


def widest(values: Sequence[Array]) -> Across:
    """Of values between those ends."""
    width, height, up, down = values
    return Across(width, height, np.maximum(up, down))


def field_of_view(c: Camera, field: SensorField) -> Across:
    """Full angles between the chief rays of the field's ends, from the entrance pupil [degrees]."""
    return widest([between(directions(c, a), directions(c, b)) for a, b in ends(field)])


def tip_field_of_view(c: Camera, field: SensorField, ahead: Number | None) -> Across:
    """Full angles under which the middle of the tip sees the field on a plane `ahead` of it [degrees].

    None is the focal plane.
    """
    away = focus_ahead(c) if ahead is None else ahead

    def direction(place: Place) -> Array:
        return np.stack(np.broadcast_arrays(*on_plane(c, place, away), away), axis=-1)

    return widest([between(direction(a), direction(b)) for a, b in ends(field)])


def focus_ahead(c: Camera) -> Array:
    """From the tip to the focal plane [mm]."""
    return np.asarray(c[PATHS["d_f"]] - c.tip)


def turn_of_prisms(c: Camera) -> float:
    """By how much prisms turn the axis, all in one plane [rad]."""
    return sum(element.turn for element in c.chain.elements)


def direction_of_view(c: Camera, field: SensorField) -> Array:
    """Angle between the tube's axis and the chief ray of the field's middle, prisms' turns included [degrees]."""
    (x0, y0), (x1, y1) = field
    x, y, z = np.moveaxis(directions(c, ((x0 + x1) / 2, (y0 + y1) / 2)), -1, 0)
    turn = turn_of_prisms(c)
    cos, sin = math.cos(turn), math.sin(turn)
    y, z = y * cos + z * sin, z * cos - y * sin
    return np.asarray(np.rad2deg(np.arctan2(np.hypot(x, y), z)))


def stretch_of(c: Camera, place: Place) -> tuple[Number, Number]:
    """How much larger than on the axis the object field of a microlens is, along the field's radius and across it."""
    p = np.hypot(*outer_slopes(c, place))
    return c.stretch_along(p), c.stretch(p)
