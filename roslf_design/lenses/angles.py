"""Laws by which an objective takes angles in air to image heights, p = h/f = g(theta), as kernels want them.

A law is an array: a row of kind and largest p; of a table also a row an interval, with a cubic of p^2 for theta/p. So
is the light over the field where it is told rather than follows: its cubics are those of the light itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import repeat
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel

Law = NDArray[np.float64]
T = TypeVar("T")
Way = TypeVar("Way")

THETA, SINE, STEREOGRAPHIC, TABLE, TOLD = range(5)
NOTHING = 1e-150
"""Added to p where it divides: changes no other number."""
LAW_COLUMNS = 5
"""Numbers of a law's row."""


@kernel()
def _angle_in_air(law: Any, p: Any) -> Any:
    """Angle theta [rad] with g(theta) = p, where p does not exceed the law's largest."""
    kind = law[0, 0]
    if kind == THETA:
        return p * 1.0
    if kind == SINE:
        return np.arcsin(p)
    if kind == STEREOGRAPHIC:
        return 2.0 * np.arctan(p / 2.0)
    q = p * p
    i = 1 + np.maximum(np.searchsorted(law[1:, 0], q.real, "right") - 1, 0)
    t = q - law[:, 0][i]
    return p * (((law[:, 1][i] * t + law[:, 2][i]) * t + law[:, 3][i]) * t + law[:, 4][i])


@kernel()
def stretch(law: Any, p: Any, n: Any) -> Any:
    """Slope in a medium of index n over the first order's, p/n: 1 near the axis, huge at 90 degrees.

    Beyond the law's largest p that of the largest.
    """
    held = np.minimum(p, law[0, 1]) + NOTHING
    angle = _angle_in_air(law, held)
    sine, cosine = np.sin(angle), np.cos(angle)
    return sine / np.sqrt((n - 1.0) * (n + 1.0) + cosine * cosine) * (n / held)


@kernel()
def illumination(law: Any, p: Any) -> Any:
    """Irradiance against the axis, through an entrance pupil that is a flat opening of one size: 1 for f sin.

    A part of the image of area dA = f^2 g dg dphi gets its light from the solid angle dOmega = sin(theta) dtheta dphi,
    through an opening that is seen foreshortened, by cos(theta). Its etendue over dA, against that on the axis, is

        cos(theta) sin(theta)/(g g') = sin(theta) cos(theta) theta'(p)/p,

    cos^4 for f tan, sin(theta) cos(theta)/theta for f theta, cos(theta) cos^4(theta/2) for 2f tan(theta/2), 1 for
    f sin. Flat windows and liquid change nothing: n^2 cos(theta) dOmega is the same in each. What is `TOLD` is as told.
    """
    held = np.minimum(p, law[0, 1]) + NOTHING
    kind = law[0, 0]
    if kind == TOLD:
        q = held * held
        i = 1 + np.maximum(np.searchsorted(law[1:, 0], q.real, "right") - 1, 0)
        t = q - law[:, 0][i]
        return ((law[:, 1][i] * t + law[:, 2][i]) * t + law[:, 3][i]) * t + law[:, 4][i]
    angle = _angle_in_air(law, held)
    light = np.sin(angle) * np.cos(angle) / held
    if kind == THETA:
        return light
    if kind == SINE:
        return held * 0.0 + 1.0
    if kind == STEREOGRAPHIC:
        return light / (1.0 + held * held / 4.0)
    q = held * held
    i = 1 + np.maximum(np.searchsorted(law[1:, 0], q.real, "right") - 1, 0)
    t = q - law[:, 0][i]
    steepness = (3.0 * law[:, 1][i] * t + 2.0 * law[:, 2][i]) * t + law[:, 3][i]
    return light * (angle / held + 2.0 * q * steepness)


@kernel()
def _image_height(law: Any, angle: Any) -> Any:
    """P = g(theta) of angles in air [rad]; beyond what is imaged, the largest."""
    largest = law[0, 1]
    kind = law[0, 0]
    held = np.minimum(angle, _angle_in_air(law, largest))
    if kind == THETA:
        return held * 1.0
    if kind == SINE:
        return np.sin(held)
    if kind == STEREOGRAPHIC:
        return 2.0 * np.tan(held / 2.0)
    p, step = held * 0.0, largest
    for _ in range(60):  # the angle rises with p
        step = step / 2.0
        p = p + step * (_angle_in_air(law, p + step) < held)
    return p


@kernel()
def first_order(law: Any, slope: Any, n: Any) -> Any:
    """Inverse of p/n times `stretch`: p, of a slope in a medium of index n."""
    return _image_height(law, np.arcsin(np.minimum(n * np.sin(np.arctan(slope)), 1.0)))


NO_LAW = np.zeros((0, LAW_COLUMNS))
"""Law of f tan, for kernels."""
STEEPEST = 1e15
"""Slope that is taken for infinite."""


class AngleMap:
    """f tan: angles as the first order has them."""

    bends: ClassVar[bool] = False
    """True where it bends the plane in focus, and draws what lies off the axis smaller."""
    words: str = ""
    """Words for why light falls off otherwise than by cos^4."""
    kernel: Law = NO_LAW
    """Law as kernels take it; no rows of f tan."""
    shade: Law = NO_LAW
    """Law of the light over the field (`illumination`), as kernels take it; no rows of cos^4."""
    end: float = math.inf
    """Largest slope times index to first order that it images."""

    @property
    def widest(self) -> float:
        """Largest angle in air that it images [rad]."""
        return math.pi / 2

    def angle(self, slope: Any) -> Any:
        """Angle in air [rad] of a slope times index to first order."""
        return np.arctan(slope)

    def light(self, slope: Any) -> Any:
        """Light off the axis against the middle, at a slope times index to first order: cos^4."""
        return (1 + slope * slope) ** -2.0

    def loss(self, slope: float) -> float:
        """Share of light that is lost there, small ones exactly."""
        return float(-np.expm1(-2 * np.log1p(slope**2)))

    def height(self, angle: Any) -> Any:
        """Slope times index to first order, of an angle in air [rad]."""
        return np.tan(angle)

    def dim(self, row: Any, along: Any, across: Any) -> None:
        """Darken places in place by the light at slopes whose squares are sums of two."""
        slope = 1 + along + across
        row /= slope * slope

    def stretch(self, p: Any, medium: Any) -> Any:
        """Slope in a medium over that of the first order, p over its index."""
        return 1.0

    def stretch_along(self, p: Any, medium: Any) -> Any:
        """Derivative of that slope by the first order's."""
        return 1.0

    def stretches(self, p: Callable[[], Any], medium: Callable[[], Any]) -> tuple[Any, Any]:
        """Both, along the field's radius and across it."""
        return 1.0, 1.0

    def first_order(self, slope: Any, medium: Any) -> Any:
        """Slope times index to first order, of a slope in a medium."""
        return slope * medium

    def redrawn(self, rays: Any, grown: Callable[[], Any], pupil: Callable[[], Any]) -> Any:
        """Heights on the axis's start and slopes of the first order's rays, as they are drawn.

        Through the same point of the entrance pupil, which stands at `pupil` [mm], slopes are `grown` times as large.
        """
        return rays

    def straight(self, at: Any, drawn: Callable[[], Any]) -> Any:
        """Point of the first order's object space that stands for one; `drawn` finds it along a straight ray."""
        return at

    def images(self, image: Callable[[Way], T], ways: Sequence[Way]) -> Iterator[T]:
        """Image of a point through each of some points of the pupil: of f tan the same through all."""
        return repeat(image(ways[0]), len(ways))

    def undrawn(self, distance: Any, along: Callable[[], Any], pupil: Callable[[], Any]) -> Any:
        """Distance of a point from the one that the first order draws it at; the entrance pupil stands at `pupil`.

        A small step along the field's radius is drawn `along` times as long.
        """
        return distance


class ShadedTangent(AngleMap):
    """f tan with light over the field that is not cos^4."""

    words = ", as its data sheet states"

    def __init__(self, shade: Law) -> None:
        self.shade = np.array(shade, order="C")

    def light(self, slope: Any) -> Any:
        """Light by `illumination`."""
        return illumination(self.shade, slope)

    def loss(self, slope: float) -> float:
        """Share by `illumination`."""
        return 1 - float(self.light(np.abs(slope)))

    def dim(self, row: Any, along: Any, across: Any) -> None:
        """Darken by `illumination`."""
        row *= illumination(self.shade, np.sqrt(along + across, dtype=np.float64))


class AngleLaw(ShadedTangent):
    """Objective that maps angles by a law of its own, and its light by that or as told."""

    bends = True

    def __init__(self, law: Law, shade: Law | None = None) -> None:
        super().__init__(law if shade is None else shade)
        self.kernel, self.end = np.array(law, order="C"), float(law[0, 1])
        self.words = ", by the objective's mapping" if shade is None else ShadedTangent.words

    @property
    def widest(self) -> float:
        """Angle of the law's largest p."""
        return float(_angle_in_air(self.kernel, self.end))

    def angle(self, slope: Any) -> Any:
        """Angle by the law; beyond what is imaged, the largest."""
        return _angle_in_air(self.kernel, np.minimum(slope, self.end))

    def height(self, angle: Any) -> Any:
        """Inverse of the angle."""
        return _image_height(self.kernel, angle)

    def stretch(self, p: Any, medium: Any) -> Any:
        """Stretch by the law, infinite at 90 degrees."""
        grown = stretch(self.kernel, p, medium)
        return np.where(np.real(grown) < STEEPEST, grown, np.inf)[()]

    def stretch_along(self, p: Any, medium: Any) -> Any:
        """Derivative by a complex step."""
        held = np.minimum(p, self.end * (1 - 1e-12)) + 1j * STEP
        return np.imag(held * stretch(self.kernel, held, medium))[()] / STEP

    def stretches(self, p: Callable[[], Any], medium: Callable[[], Any]) -> tuple[Any, Any]:
        """Both by the law."""
        steep, index = p(), medium()
        return self.stretch_along(steep, index), self.stretch(steep, index)

    def first_order(self, slope: Any, medium: Any) -> Any:
        """Inverse of the law."""
        return first_order(self.kernel, slope, medium)

    def redrawn(self, rays: Any, grown: Callable[[], Any], pupil: Callable[[], Any]) -> Any:
        """Rays turned about the entrance pupil."""
        times, stands = grown(), pupil()
        return [(height + slope * (times - 1) * stands, slope * times) for height, slope in rays]

    def straight(self, at: Any, drawn: Callable[[], Any]) -> Any:
        """Point drawn along a straight ray."""
        return drawn()

    def images(self, image: Callable[[Way], T], ways: Sequence[Way]) -> Iterator[T]:
        """Each sees the point elsewhere."""
        return map(image, ways)

    def undrawn(self, distance: Any, along: Callable[[], Any], pupil: Callable[[], Any]) -> Any:
        """As if the radius were drawn for so much farther away."""
        stands = pupil()
        return stands + (distance - stands) / along()


F_TAN = AngleMap()
STEP = 1e-30
"""Size of complex steps of derivatives."""
