"""Folds of the axis: where directions and points of unfolded space really are."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .element import Element

Floats = NDArray[np.float64]


def fold_of(turn: float, towards: float, reverses: bool) -> Floats:
    """Directions beyond a fold by those of the axis gone straight on, (3, 3).

    Parameters
    ----------
    turn : float
        Angle by which it turns the view [rad].
    towards : float
        Direction into which it does, across the axis from x towards y [rad].
    reverses : bool
        Whether it reverses along that direction, as an odd number of reflections does.
    """
    (c, s), (ahead, aside) = (math.cos(turn), math.sin(turn)), (math.cos(towards), math.sin(towards))
    roll = np.array([[ahead, -aside, 0.0], [aside, ahead, 0.0], [0.0, 0.0, 1.0]])
    own = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) * [-1.0 if reverses else 1.0, 1.0, 1.0]
    return np.asarray(roll @ own @ roll.T)


class Reflection(NamedTuple):
    """A flat mirror where it should be, in unfolded space."""

    distance: float
    """Where the axis meets it before the main lens [mm]."""
    normal: Floats
    """On the sensor's side, (3,)."""

    @classmethod
    def of(cls, part: Element) -> Reflection:
        """Mirror that an element is."""
        across = math.cos(part.turn / 2)
        way = across * math.cos(part.towards), across * math.sin(part.towards), math.sin(part.turn / 2)
        return cls(part.distance, np.array(way))

    def height(self, points: Floats) -> Floats:
        """Heights of points above it, below 0 beyond it [mm]."""
        return np.asarray((points + np.array([0.0, 0.0, self.distance])) @ self.normal)


def folded(reflections: Sequence[Reflection], points: Floats) -> Floats:
    """Points of one part, or of none, from unfolded space to where they really are: as their middle is, all are."""
    distance, real = -float(points[:, 2].mean()), points
    for mirror in reversed(reflections):
        if distance > mirror.distance * (1 + 1e-12):
            real = real - 2 * mirror.height(real)[:, None] * mirror.normal
    return real


def folded_line(reflections: Sequence[Reflection], line: Floats) -> Floats:
    """A polyline likewise, (N, 3), with a corner at each mirror that it goes through."""
    for mirror in reflections:
        height = mirror.height(line)
        cut = np.flatnonzero(height[1:] * height[:-1] < 0)
        share = (height[cut] / (height[cut] - height[cut + 1]))[:, None]
        line = np.insert(line, cut + 1, line[cut] + share * (line[cut + 1] - line[cut]), axis=0)
    real, beyond = line, [mirror.height(line) < -1e-9 for mirror in reflections]
    for mirror, away in zip(reversed(reflections), reversed(beyond), strict=True):
        real = np.where(away[:, None], real - 2 * mirror.height(real)[:, None] * mirror.normal, real)
    return np.asarray(real)


class PartOutline(NamedTuple):
    """A part of known height about the unfolded axis."""

    place: str
    near: float
    """Its sensor's side before the main lens, below 0 behind it [mm]."""
    far: float
    half: float
    """Half its height [mm]."""
    angle: float | None = None
    """Angle between the axis and its surface, of a mirror [rad]."""

    def corners(self, mirror: PartOutline, folded: bool) -> Floats:
        """Corners in the plane of a mirror's fold, from its vertex: into the fold, and towards the sensor [mm]."""
        if self.angle is not None:
            along = self.half * np.array([math.sin(self.angle), -math.cos(self.angle)])
            return np.array([along, -along])
        near, far = mirror.near - self.near, mirror.near - self.far
        box = np.array([(-self.half, far), (self.half, far), (self.half, near), (-self.half, near)])
        if not folded:
            return box
        assert mirror.angle is not None
        c, s = math.cos(2 * mirror.angle), math.sin(2 * mirror.angle)
        return np.asarray(box @ np.array([[-c, -s], [-s, c]]))


def outlines_of(parts: Iterable[Element]) -> list[PartOutline]:
    """Elements of known height."""
    return [
        PartOutline(
            f"elements.{k}", part.distance, part.distance + part.length, half, part.turn / 2 if part.folds else None
        )
        for k, part in enumerate(parts)
        if (half := part.half_height) is not None
    ]


def collisions(outlines: Sequence[PartOutline]) -> Iterator[tuple[str, str]]:
    """Places of those that stand in each other about a mirror: behind it, before it, or in the mirror itself.

    Each fold is looked at in its own plane, where round parts are widest, with what stands up to the next ones.
    """
    ordered = sorted(outlines, key=lambda part: part.near)
    mirrors = [k for k, part in enumerate(ordered) if part.angle is not None]
    for before, k, after in zip([-1, *mirrors], mirrors, [*mirrors[1:], len(ordered)], strict=False):
        mirror, nearer, farther = ordered[k], ordered[before + 1 : k], ordered[k + 1 : after]
        folded = [(part, part.corners(mirror, folded=True)) for part in farther]
        straight = [(part, part.corners(mirror, folded=False)) for part in nearer]
        own = [(mirror, mirror.corners(mirror, folded=False))]
        for (one, corners), (other, more) in (*product(straight, folded), *product(own, [*straight, *folded])):
            if _overlap(corners, more):
                yield one.place, other.place


def _overlap(one: Floats, other: Floats) -> bool:
    """Whether two convex polygons have more in common than an edge: no side of either parts them."""
    size = max(float(np.abs(one).max()), float(np.abs(other).max()))
    for polygon in (one, other):
        for side in np.roll(polygon, -1, axis=0) - polygon:
            for way in (side, side[::-1] * [1, -1]):  # also along it: a mirror has no thickness
                a, b = one @ way, other @ way
                near = 1e-9 * size * np.hypot(*side)
                if near > 0 and (a.max() <= b.min() + near or b.max() <= a.min() + near):
                    return False
    return True
