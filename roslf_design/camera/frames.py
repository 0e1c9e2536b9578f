"""Arithmetic on vectors whose components are floats or arrays over fields and trials, skipping exact zeros and ones.

Most poses of a perturbed camera stay exactly nominal: their frames hold plain 0.0 and 1.0, and the products with those
cost nothing here, while a perturbed component is an array and costs what it must.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..design.parts import Number

Vector = tuple[Number, Number, Number]


def times(a: Number, b: Number) -> Number:
    """Product."""
    if isinstance(a, float):
        if a == 0.0:
            return 0.0
        if a == 1.0:
            return b
    if isinstance(b, float):
        if b == 0.0:
            return 0.0
        if b == 1.0:
            return a
    return a * b


def plus(a: Number, b: Number) -> Number:
    """Sum."""
    if isinstance(a, float) and a == 0.0:
        return b
    if isinstance(b, float) and b == 0.0:
        return a
    return a + b


def minus(a: Number, b: Number) -> Number:
    """Difference."""
    if isinstance(b, float) and b == 0.0:
        return a
    return a - b


def dot(a: Vector, b: Vector) -> Number:
    """Inner product."""
    return plus(plus(times(a[0], b[0]), times(a[1], b[1])), times(a[2], b[2]))


def along(origin: Vector, a: Number, x: Vector, b: Number, y: Vector) -> Vector:
    """``origin + a x + b y``."""
    return (
        plus(origin[0], plus(times(a, x[0]), times(b, y[0]))),
        plus(origin[1], plus(times(a, x[1]), times(b, y[1]))),
        plus(origin[2], plus(times(a, x[2]), times(b, y[2]))),
    )


class Frame(NamedTuple):
    """Vertex and axes of an element, in the coordinates of some other frame."""

    origin: Vector
    """[mm]."""
    x: Vector
    y: Vector
    z: Vector
    """Its normal."""

    def seen_from(self, other: Frame) -> Frame:
        """The same element in the coordinates of `other`'s axes; both given in the same coordinates."""
        axes = (other.x, other.y, other.z)

        def turned(v: Vector) -> Vector:
            return dot(axes[0], v), dot(axes[1], v), dot(axes[2], v)

        offset = tuple(minus(a, b) for a, b in zip(self.origin, other.origin, strict=True))
        return Frame(turned((offset[0], offset[1], offset[2])), turned(self.x), turned(self.y), turned(self.z))


def frame(decentre: tuple[Number, Number], z: Number, tilt: tuple[Number, Number], roll: Number = 0.0) -> Frame:
    """Pose of an element: rotated by `roll` about its normal, tilted about x, then y, vertex at (decentre, z).

    Parameters
    ----------
    decentre : pair
        [mm].
    z : float or array
        Of the vertex [mm].
    tilt : pair
        (t_x, t_y) [rad].
    roll : float or array
        [rad].
    """
    (cx, sx), (cy, sy), (cr, sr) = _turn(tilt[0]), _turn(tilt[1]), _turn(roll)
    e: Vector = (cy, 0.0, _negative(sy))
    h: Vector = (times(sy, sx), cx, times(cy, sx))
    n: Vector = (times(sy, cx), _negative(sx), times(cy, cx))
    nothing: Vector = (0.0, 0.0, 0.0)
    return Frame((*decentre, z), along(nothing, cr, e, sr, h), along(nothing, _negative(sr), e, cr, h), n)


def _turn(angle: Number) -> tuple[Number, Number]:
    if isinstance(angle, float):
        return float(np.cos(angle)), float(np.sin(angle))
    return np.cos(angle), np.sin(angle)


def _negative(value: Number) -> Number:
    return 0.0 if isinstance(value, float) and value == 0.0 else -value
