"""Arithmetic on vectors whose components are floats or arrays over fields and trials, skipping exact zeros and ones.

Most poses of a perturbed camera stay exactly nominal: their frames hold plain 0.0 and 1.0, and the products with those
cost nothing here, while a perturbed component is an array and costs what it must. Of long arrays sums of products are
taken in one pass, to the same bits: memory, not arithmetic, is what they take time for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import Kernel, kernel
from ..bore.part import Number, minus, plus, times

Vector = tuple[Number, Number, Number]

REAL = np.dtype(np.float64)
LONG = 4096
"""Numbers in an array from which compiled passes are worth loading."""


def _long(values: tuple[Number, ...]) -> bool:
    """Whether there is a long array among them, and no complex number."""
    for value in values:
        if isinstance(value, np.ndarray) and value.size >= LONG:
            return all(not isinstance(each, np.ndarray) or each.dtype is REAL for each in values)
    return False


@kernel(elementwise=True)
def _pair(a: Number, b: Number, c: Number, d: Number) -> Number:
    return a * b + c * d


@kernel(elementwise=True)
def _triple(a: Number, b: Number, c: Number, d: Number, e: Number, f: Number) -> Number:
    return a * b + c * d + e * f


@kernel(elementwise=True)
def _more(o: Number, a: Number, b: Number) -> Number:
    return o + a * b


@kernel(elementwise=True)
def _more_by_pair(o: Number, a: Number, b: Number, c: Number, d: Number) -> Number:
    return o + (a * b + c * d)


@kernel(elementwise=True)
def _cross(a: Number, b: Number, c: Number, d: Number) -> Number:
    return a * b - c * d


SUMS: dict[tuple[bool, int], Kernel[..., Number]] = {
    (False, 2): _pair,
    (False, 3): _triple,
    (True, 1): _more,
    (True, 2): _more_by_pair,
}
"""Whether something stands before so many products, and their sum."""


def total(o: Number, *factors: Number) -> Number:
    """``o + a b + c d`` and so on."""
    if not _long((o, *factors)):
        some = times(factors[0], factors[1])
        for k in range(2, len(factors), 2):
            some = plus(some, times(factors[k], factors[k + 1]))
        return plus(o, some)
    live: tuple[Number, ...] = ()
    for a, b in zip(factors[::2], factors[1::2], strict=True):
        if isinstance(a, float) and (a == 0.0 or a == 1.0):
            o = plus(o, b) if a else o
        elif isinstance(b, float) and (b == 0.0 or b == 1.0):
            o = plus(o, a) if b else o
        else:
            live += a, b
    alone = isinstance(o, float) and o == 0.0
    form = SUMS.get((not alone, len(live) // 2))
    if form is not None:
        return form.compiled(*(live if alone else (o, *live)))
    if not live:
        return o
    return plus(o, live[0] * live[1] if len(live) == 2 else total(0.0, *live))


def cross(a: Number, b: Number, c: Number, d: Number) -> Number:
    """``a b - c d``."""
    if any(isinstance(value, float) for value in (a, b, c, d)) or not _long((a, b, c, d)):
        return minus(times(a, b), times(c, d))
    return _cross.compiled(a, b, c, d)


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
