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

BACK = -0.5
"""Cosine of the angle (120 degrees) from which on joints are a mirror's: a bend's own lie ever further along."""


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


class Fold(NamedTuple):
    """A place where the axis turns, in unfolded space: a mirror where it should be, or the middle of a prism."""

    distance: float
    """Where the axis meets it before the main lens [mm]."""
    turn: Floats
    """Directions beyond it by those of the axis gone straight on, (3, 3)."""
    parts: Floats
    """Normal of the plane that parts both sides, on the sensor's, (3,)."""
    joints: tuple[Floats, Floats]
    """Normals of the planes in which a tube ends on the sensor's and on the scene's side, each of unfolded space."""

    @classmethod
    def of(cls, part: Element) -> Fold:
        """Fold that an element makes; of an even number of reflections, or none that is told, as if the axis bent."""
        turn, middle = fold_of(part.turn, part.towards, part.reverses), part.distance + part.length / 2
        half = part.turn / 2 % math.pi  # so that its normal looks at the sensor's side
        across = math.cos(half)
        mirror = np.array([across * math.cos(part.towards), across * math.sin(part.towards), math.sin(half)])
        if part.reverses:
            return cls(middle, turn, mirror, (mirror, mirror))
        ahead = np.array([0.0, 0.0, 1.0])
        if math.cos(part.turn) < BACK:
            return cls(middle, turn, ahead, (mirror, -turn.T @ mirror))
        joint = (ahead + turn[:, 2]) / np.linalg.norm(ahead + turn[:, 2])
        return cls(middle, turn, ahead, (joint, turn.T @ joint))

    def height(self, points: Floats) -> Floats:
        """Heights of points above the plane that parts its sides, below 0 beyond it [mm]."""
        return np.asarray((points + np.array([0.0, 0.0, self.distance])) @ self.parts)

    def turned(self, points: Floats) -> Floats:
        """Points beyond it from unfolded space to where they really are."""
        at = np.array([0.0, 0.0, -self.distance])
        return np.asarray(at + (points - at) @ self.turn.T)


def folded(folds: Sequence[Fold], points: Floats) -> Floats:
    """Points of one part, or of none, from unfolded space to where they really are: as their middle is, all are."""
    distance, real = -float(points[:, 2].mean()), points
    for fold in reversed(folds):
        if distance > fold.distance * (1 + 1e-12):
            real = fold.turned(real)
    return real


def folded_line(folds: Sequence[Fold], line: Floats) -> Floats:
    """A polyline likewise, (N, 3); at each fold that it goes through it ends in one joint and goes on in the other."""
    sides: list[NDArray[np.bool_]] = []
    for fold in folds:
        height = fold.height(line)
        cut = np.flatnonzero(height[1:] * height[:-1] < 0)
        way, apart = line[cut + 1] - line[cut], line[cut] + np.array([0.0, 0.0, fold.distance])
        near, far = (line[cut] - way * ((apart @ joint) / (way @ joint))[:, None] for joint in fold.joints)
        back, at = height[cut] < 0, np.repeat(cut + 1, 2)  # whether it comes from beyond
        met = np.stack([np.where(back[:, None], far, near), np.where(back[:, None], near, far)], axis=1)
        line = np.insert(line, at, met.reshape(-1, 3), axis=0)
        sides = [np.insert(side, at, np.repeat(side[cut], 2)) for side in sides]
        sides.append(np.insert(height < -1e-9, at, np.stack([back, ~back], axis=1).ravel()))
    real = line
    for fold, beyond in zip(reversed(folds), reversed(sides), strict=True):
        real = np.where(beyond[:, None], fold.turned(real), real)
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
            f"elements.{k}", part.distance, part.distance + part.length, half, part.turn / 2 if part.leans else None
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
