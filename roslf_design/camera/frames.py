"""Arithmetic on vectors whose components are floats or arrays over fields and trials, skipping exact zeros and ones.

Most poses of a perturbed camera stay exactly nominal: their frames hold plain 0.0 and 1.0, and the products with those
cost nothing here, while a perturbed component is an array and costs what it must.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..bore.part import Number, minus, plus, times

Vector = tuple[Number, Number, Number]


def total(o: Number, *factors: Number) -> Number:
    """``o + a b + c d`` and so on: `plus` and `times`, in line, as builds come here some hundred times each."""
    some: Number = 0.0
    for k in range(0, len(factors), 2):
        a, b = factors[k], factors[k + 1]
        if isinstance(a, float) and (a == 0.0 or a == 1.0):
            if a == 0.0:
                continue
            product = b
        elif isinstance(b, float) and (b == 0.0 or b == 1.0):
            if b == 0.0:
                continue
            product = a
        else:
            product = a * b
        some = product if isinstance(some, float) and some == 0.0 else plus(some, product)
    return plus(o, some)


def cross(a: Number, b: Number, c: Number, d: Number) -> Number:
    """``a b - c d``."""
    return minus(times(a, b), times(c, d))


def dot(a: Vector, b: Vector) -> Number:
    """Inner product."""
    return total(0.0, a[0], b[0], a[1], b[1], a[2], b[2])


def along(origin: Vector, a: Number, x: Vector, b: Number, y: Vector) -> Vector:
    """``origin + a x + b y``."""
    u, v, w = (total(o, a, k, b, h) for o, k, h in zip(origin, x, y, strict=True))
    return u, v, w


class Frame(NamedTuple):
    """Vertex and axes of an element, in the coordinates of some other frame."""

    origin: Vector
    """[mm]."""
    x: Vector
    y: Vector
    z: Vector
    """Normal of the element."""

    def seen_from(self, other: Frame) -> Frame:
        """Frame in the coordinates of `other`'s axes; both given in the same coordinates."""
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
