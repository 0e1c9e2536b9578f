"""Arrays: float64 in, broadcast float64 out, the limits that plain division misses; points spread evenly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
"""Broadcast float64 result; a numpy float64 scalar where every argument was a scalar."""

Complex = NDArray[np.complexfloating[Any, Any]]

COMPLEX = np.dtype(np.complex128)


def floats(*values: ArrayLike) -> tuple[Array, ...]:
    """Arguments as float64 arrays, not copied where they are already; complex ones (for derivatives) stay complex."""
    kinds = (COMPLEX if getattr(v, "dtype", None) is COMPLEX else np.float64 for v in values)
    return tuple([np.asarray(v, kind) for v, kind in zip(values, kinds, strict=True)])


def ratio(numerator: Array | float, denominator: Array | float) -> Array:
    """Quotient with its limits: +-1 for inf/inf, 0 for 0/0, signed inf for x/0.

    The closed forms meet inf/inf only as two lengths that differ from one infinite length by finite amounts,
    and 0/0 only where the numerator's own zero (a pixel on the axis, a sensor on the microlenses) comes first.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        quotient: Array = np.divide(numerator, denominator)
    if not np.count_nonzero(np.isnan(quotient)):
        return quotient
    unity = np.copysign(1.0, numerator) * np.copysign(1.0, denominator)
    quotient = np.where(np.isinf(numerator) & np.isinf(denominator), unity, quotient)
    return np.where((numerator == 0) & (denominator == 0), 0.0, quotient)[()]


def product(left: Array | float, right: Array | float) -> Array:
    """Product that is 0 wherever a factor is, also where the other is infinite: no pupil has no blur at any depth."""
    with np.errstate(invalid="ignore", over="ignore"):
        result: Array = np.multiply(left, right)
    if not np.count_nonzero(np.isnan(result)):
        return result
    return np.where(((left == 0) & np.isinf(right)) | (np.isinf(left) & (right == 0)), 0.0, result)[()]


def magnitude(value: Array | float) -> Array:
    """Size of something of either sign; of complex numbers (for derivatives), by their real part."""
    size: Array = np.where(np.asarray(value).real < 0, np.negative(value), value)[()]
    return size


def same(a: Any, b: Any) -> bool:
    """True where two values are alike: arrays element by element, in tuples, lists and mappings; NaN is like NaN."""
    if a is b:
        return True
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        numbers = all(np.asarray(value).dtype.kind in "fc" for value in (a, b))
        return np.array_equal(a, b, equal_nan=numbers)
    for kind in (tuple, list):
        if isinstance(a, kind) and isinstance(b, kind):
            return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(same(value, b[key]) for key, value in a.items())
    return bool(a == b or (a != a and b != b))


Class = TypeVar("Class", bound=type)


def by_value(cls: Class) -> Class:
    """Decorator of frozen dataclasses that hold arrays: equal where all fields are the `same`."""
    names = [field.name for field in fields(cls)]

    def __eq__(self: Any, other: object) -> bool:  # noqa: N807
        if other.__class__ is not self.__class__:
            return NotImplemented
        return all(same(getattr(self, name), getattr(other, name)) for name in names)

    cls.__eq__ = __eq__  # type: ignore[assignment]
    return cls


GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
"""Turn between successive points of the sunflower [rad]."""


def sunflower(count: int, start: float = 0.0) -> Array:
    """Points that fill the unit disc evenly (Vogel's spiral).

    Parameters
    ----------
    count : int
        N.
    start : float
        Where the spiral begins [turns between successive points].

    Returns
    -------
    ndarray, shape (2, N)
        The k-th at radius sqrt((k + 1/2)/N): equal areas, strictly inside.
    """
    k = np.arange(count)
    radius, angle = np.sqrt((k + 0.5) / count), (k + start) * GOLDEN_ANGLE
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


DISC_RULE = ((0.0, 0.0, 0.25), *((math.sqrt(2 / 3), k * math.pi / 3, 0.125) for k in range(6)))
"""Radius, angle and weight of points that average polynomials up to the fifth degree over the unit disc exactly."""
