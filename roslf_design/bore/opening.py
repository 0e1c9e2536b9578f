"""Clear opening of a stop: a disc, or a rectangle, about the stop's own centre, as everything asks it.

A further shape is a further case here, and its keys in a design file (`..design.parts.Stop`). On the sensor openings
are convex regions, cut out of each other in `..shapes.openings`; rays ask `contains`, kernels a `row`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import DISC_RULE, Array, magnitude
from .._jit import kernel
from ..words import length
from .part import Number

Flags = NDArray[np.bool_]
Pair = tuple[Number, Number]

DIAMETER, SIDES, TURN = "diameter", ("sides.0", "sides.1"), "turn"
"""Keys that a stop's numbers have."""
ROW = 5
"""Numbers of an opening that `inside` takes: square of its radius, half sides, cosine and sine of its turn."""
_GAUSS = np.polynomial.legendre.leggauss(3)


class ClearAperture(NamedTuple):
    """Clear opening about its own centre; numbers are one or many [mm, rad]."""

    radius: Number
    """Radius of a disc; inf where straight sides alone bound it."""
    half: Pair | None = None
    """Half sides of a rectangle; None of a disc."""
    turn: Number = 0.0
    """Angle of a rectangle's first side to x."""

    @classmethod
    def of(cls, numbers: Mapping[str, Number], part: str) -> ClearAperture:
        """ClearAperture of a part of a camera, from numbers by their places."""
        first, second = (f"{part}.{key}" for key in SIDES)
        if first not in numbers:
            return cls(numbers[f"{part}.{DIAMETER}"] / 2)
        if np.all(np.isinf(numbers[first])):
            return UNBOUNDED
        return cls(math.inf, (numbers[first] / 2, numbers[second] / 2), numbers[f"{part}.{TURN}"])

    @property
    def straight(self) -> bool:
        """Whether straight sides bound it."""
        return self.half is not None

    @property
    def kind(self) -> str:
        """Name of its shape."""
        return "disc" if self.half is None else "rectangle"

    @property
    def size(self) -> str:
        """Its size in words, as made: "3 mm", "4 mm x 3 mm"."""
        return " x ".join(length(float(side)) for side in self.lengths)

    @property
    def words(self) -> str:
        """Its size, and how it is turned: "4 mm x 3 mm, turned by 30 deg"."""
        turned = math.degrees(float(self.turn))
        return f"{self.size}, turned by {turned:.4g} deg" if turned else self.size

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the lengths that make it as wide as it is."""
        return (DIAMETER,) if self.half is None else SIDES

    @property
    def lengths(self) -> tuple[Number, ...]:
        """Lengths at these keys."""
        return (2 * self.radius,) if self.half is None else (2 * self.half[0], 2 * self.half[1])

    @property
    def axes(self) -> tuple[Pair, Pair]:
        """Unit vectors along its sides."""
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        return (cosine, sine), (-sine, cosine)

    @property
    def corners(self) -> tuple[Pair, ...]:
        """Corners counterclockwise; none of a disc."""
        if self.half is None:
            return ()
        (a, b), ((ux, uy), (vx, vy)) = self.half, self.axes
        signs = (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)
        return tuple((s * a * ux + t * b * vx, s * a * uy + t * b * vy) for s, t in signs)

    @property
    def sides(self) -> tuple[tuple[Pair, Number], ...]:
        """Straight sides: normals and their distance from the centre; none of a disc."""
        if self.half is None:
            return ()
        (a, b), (u, v) = self.half, self.axes
        return (u, a), (v, b), ((-u[0], -u[1]), a), ((-v[0], -v[1]), b)

    @property
    def reach(self) -> Number:
        """Distance of its farthest point from its centre."""
        return self.radius if self.half is None else np.hypot(*self.half)

    def support(self, x: Number, y: Number) -> Number:
        """How far it reaches along a direction, a unit vector."""
        if self.half is None:
            return self.radius
        (a, b), (u, v) = self.half, self.axes
        reach: Number = a * magnitude(u[0] * x + u[1] * y) + b * magnitude(v[0] * x + v[1] * y)
        return reach

    @property
    def widths(self) -> Pair:
        """Its extents along x and y."""
        return 2 * self.support(1.0, 0.0), 2 * self.support(0.0, 1.0)

    @property
    def width(self) -> Number:
        """The wider of its extents along x and y: a disc's diameter."""
        return 2 * self.radius if self.half is None else np.maximum(*self.widths)

    @property
    def narrowest(self) -> Number:
        """Its least extent in any direction."""
        return 2 * self.inradius

    @property
    def inradius(self) -> Number:
        """Distance of its nearest side from its centre."""
        return self.radius if self.half is None else np.minimum(*self.half)

    @property
    def slimness(self) -> Number:
        """Least extent over `width`: 1 of a disc, of whatever size."""
        return 1.0 if self.half is None else self.narrowest / self.width

    @property
    def ways(self) -> tuple[tuple[float, float], ...]:
        """Directions that stand for all others: of a disc one, else x and y."""
        return ((1.0, 0.0),) if self.half is None else ((1.0, 0.0), (0.0, 1.0))

    @property
    def first_zero(self) -> float:
        """First zero of its diffraction across `narrowest`, in wavelengths over that [rad], as the field quotes it."""
        return 1.22 if self.half is None else 1.0

    @property
    def area(self) -> Number:
        """Area [mm^2]."""
        return math.pi * self.radius**2 if self.half is None else 4 * self.half[0] * self.half[1]

    def scaled(self, factor: Number) -> ClearAperture:
        """The opening as it is seen so much larger."""
        if self.half is None:
            return ClearAperture(self.radius * factor)
        return self._replace(half=(self.half[0] * factor, self.half[1] * factor))

    def over(self, factor: Number) -> ClearAperture:
        """The opening as it is seen so much smaller."""
        if self.half is None:
            return ClearAperture(self.radius / factor)
        return self._replace(half=(self.half[0] / factor, self.half[1] / factor))

    def sized(self, width: Number) -> ClearAperture:
        """The opening as it is seen so wide."""
        return ClearAperture(width / 2) if self.half is None else self.scaled(width / self.width)

    def contains(self, x: ArrayLike, y: ArrayLike) -> Flags:
        """True for points in it, counted from its centre [mm]; what is not finite is not."""
        x, y = np.asarray(x), np.asarray(y)
        if self.half is None:
            return np.asarray(x * x + y * y <= np.square(self.radius))
        (a, b), (u, v) = self.half, self.axes
        return np.asarray((np.abs(u[0] * x + u[1] * y) <= a) & (np.abs(v[0] * x + v[1] * y) <= b))

    def height(self, x: Number, y: Number) -> Array:
        """Squared height of points over that of the rim in their directions: above 1 outside."""
        if self.half is None:
            return np.asarray((np.square(x) + np.square(y)) / np.square(self.radius))
        u, v = self.shares(x, y)
        return np.square(np.maximum(np.abs(u), np.abs(v)))

    def shares(self, x: Number, y: Number) -> tuple[Array, Array]:
        """Points along its own sides, in units of half of them; of a disc in its radius."""
        if self.half is None:
            return np.asarray(x / self.radius), np.asarray(y / self.radius)
        (a, b), (u, v) = self.half, self.axes
        return np.asarray((u[0] * x + u[1] * y) / a), np.asarray((v[0] * x + v[1] * y) / b)

    def at_shares(self, p: Number, q: Number) -> tuple[Array, Array]:
        """Points [mm] that have these `shares`."""
        if self.half is None:
            return np.asarray(self.radius * p), np.asarray(self.radius * q)
        x, y = self._placed(self.half[0] * p, self.half[1] * q)
        return np.asarray(x), np.asarray(y)

    def room(self, other: ClearAperture, x: Number, y: Number) -> Number:
        """Room that it leaves around another opening whose centre lies at (x, y) from its own [mm].

        The least way that other may go before it is cut; below 0 where it is. In the worst direction each millimetre
        of way takes one of it.
        """
        if self.half is not None:
            rooms = [
                half - magnitude(axis[0] * x + axis[1] * y) - other.support(*axis)
                for half, axis in zip(self.half, self.axes, strict=True)
            ]
            return np.minimum(*rooms)
        if other.half is None:
            return self.radius - other.radius - np.hypot(x, y)
        return self.radius - farthest([(x + a, y + b) for a, b in other.corners])

    def places(self, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Points [mm] for those of the unit disc, which lie as evenly: equal areas to equal areas, rim to rim."""
        if self.half is None:
            return self.radius * np.asarray(u), self.radius * np.asarray(v)
        u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        r, angle = np.hypot(u, v), np.arctan2(v, u)  # rings to square rings (Shirley and Chiu)
        quarter = np.rint(angle / (math.pi / 2))
        aside = r * (angle - quarter * (math.pi / 2)) / (math.pi / 4)
        cosine, sine = (np.rint(f(quarter * (math.pi / 2))) for f in (np.cos, np.sin))
        return self._placed(self.half[0] * (cosine * r - sine * aside), self.half[1] * (sine * r + cosine * aside))

    def polar(self, share: ArrayLike, turn: ArrayLike) -> tuple[Array, Array]:
        """`places` of points of the unit disc in polar coordinates."""
        share = np.asarray(share)
        if self.half is not None:
            return self.places(share * np.cos(turn), share * np.sin(turn))
        r = self.radius * share
        return r * np.cos(turn), r * np.sin(turn)

    def across(self, share: ArrayLike) -> tuple[Array, Array]:
        """Points of the unit disc for those along x through the centre, at shares of the way to the rim."""
        share = np.asarray(share, float)
        if self.half is None:
            return share, np.zeros_like(share)
        cosine, sine = float(np.ravel(np.cos(self.turn))[0]), float(np.ravel(np.sin(self.turn))[0])
        a, b = (float(np.ravel(half)[0]) for half in self.half)
        p, q = cosine / a, -sine / b
        p, q = p / max(abs(p), abs(q)), q / max(abs(p), abs(q))
        aside, quarter = (q / p, 0.0 if p > 0 else 2.0) if abs(p) >= abs(q) else (-p / q, 1.0 if q > 0 else -1.0)
        angle = quarter * (math.pi / 2) + aside * (math.pi / 4)
        return share * math.cos(angle), share * math.sin(angle)

    def _placed(self, p: Any, q: Any) -> tuple[Any, Any]:
        (ux, uy), (vx, vy) = self.axes
        return p * ux + q * vx, p * uy + q * vy

    def rim(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Points of its rim in directions from its centre, which are unit vectors."""
        if self.half is None:
            return self.radius * x, self.radius * y
        (a, b), (u, v) = self.half, self.axes
        reach = 1 / np.maximum(np.abs(u[0] * x + u[1] * y) / a, np.abs(v[0] * x + v[1] * y) / b)
        return reach * x, reach * y

    def along_rim(self, points: int) -> Array:
        """Points of its rim, shape (points, 2), counterclockwise: as many along each side, within its ends."""
        if self.half is None:
            angle = np.linspace(0, 2 * math.pi, points, endpoint=False)
            return np.asarray(self.radius * np.stack([np.cos(angle), np.sin(angle)], -1))
        corners, each = np.array(self.corners, float), points // len(self.corners)
        share = ((np.arange(each) + 0.5) / each)[:, None]
        return np.concatenate([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])

    @property
    def rule(self) -> Sequence[tuple[Number, Number, float]]:
        """Points (x, y) and weights that average polynomials up to the fifth degree over it exactly."""
        if self.half is None:
            return [
                (self.radius * (r * np.cos(a)), self.radius * (r * np.sin(a)), weight) for r, a, weight in DISC_RULE
            ]
        (a, b), weights = self.half, [*zip(*(part.tolist() for part in _GAUSS), strict=True)]
        points: list[tuple[Number, Number, float]] = []
        for (p, v), (q, w) in itertools.product(weights, weights):
            x, y = self._placed(p * a, q * b)
            points.append((x, y, v * w / 4))
        return points

    def outline(self, step: float = math.pi / 90) -> Array:
        """Points along its rim for drawing, shape (N, 2), counterclockwise, not closed."""
        if self.half is not None:
            return np.array(self.corners, float)
        angle = np.linspace(0.0, 2 * math.pi, math.ceil(2 * math.pi / step), endpoint=False)
        points: Array = np.asarray(self.radius, float) * np.stack([np.cos(angle), np.sin(angle)], -1)
        return points

    def spectrum(self, x: Array, y: Array) -> Array:
        """Fourier transform at frequencies (x, y) [1/mm], real as it is symmetric: its area at 0 [mm^2]."""
        if self.half is not None:
            (a, b), (u, v) = self.half, self.axes
            waves = np.sinc(2 * a * (u[0] * x + u[1] * y)) * np.sinc(2 * b * (v[0] * x + v[1] * y))
            return np.asarray(self.area * waves)
        from scipy.special import j1

        height = np.hypot(x, y)
        safe = np.where(height > 0, height, 1.0)
        wave = self.radius * j1(2 * math.pi * self.radius * safe) / safe
        return np.where(height > 0, wave, math.pi * self.radius**2)

    def overlap(self, shift: Array, x: float, y: float) -> Array:
        """Share of it that is left of its overlap with itself, shifted along a unit vector."""
        if self.half is None:
            return disc_overlap(shift / (2 * self.radius))
        left: Array = np.ones(())
        for half, axis in zip(self.half, self.axes, strict=True):
            left = left * np.maximum(1 - np.abs(shift * (axis[0] * x + axis[1] * y)) / (2 * half), 0.0)
        return left

    def row(self) -> Array:
        """Numbers that `inside` takes, shape (..., ROW)."""
        half = (math.inf, math.inf) if self.half is None else self.half
        numbers = self.radius * self.radius, *half, np.cos(self.turn), np.sin(self.turn)
        return np.stack(np.broadcast_arrays(*(np.asarray(number, float) for number in numbers)), -1)


POINT = ClearAperture(0.0)
"""A point, as an opening."""
UNBOUNDED = ClearAperture(math.inf)
"""An opening that cuts nothing."""


def repeated(corners: tuple[Pair, ...], count: int) -> tuple[Pair, ...]:
    """Corners, of which the last stands for those that are missing."""
    return (*corners, *corners[-1:] * (count - len(corners)))


def farthest(points: Sequence[Pair]) -> Number:
    """Distance of the farthest of some points from the origin."""
    far = np.hypot(*points[0])
    for point in points[1:]:
        far = np.maximum(far, np.hypot(*point))
    return far


def disc_overlap(shift: ArrayLike) -> Array:
    """Overlap of a disc with itself, shifted by a share of its diameter, over its area."""
    x = np.clip(np.abs(shift), 0.0, 1.0)
    return np.asarray(2 / math.pi * (np.arccos(x) - x * np.sqrt((1 - x) * (1 + x))))


@kernel()
def inside(row: Array, at: int, x: float, y: float) -> bool:
    """Whether a point, counted from an opening's centre, lies in it.

    `ClearAperture.row` begins in column `at` of a row.
    """
    return bool(
        x * x + y * y <= row[at]
        and abs(row[at + 3] * x + row[at + 4] * y) <= row[at + 1]
        and abs(row[at + 3] * y - row[at + 4] * x) <= row[at + 2]
    )
