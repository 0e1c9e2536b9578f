"""A point's wave through exact elements: which part of the FAP it fills, and how far it runs ahead of the ideal one.

Rays from the point are aimed through every face at places of the FAP, as the main lens sees that. There, in air, an
ideal wave has slopes ``(a - X)/R``; what the exact slopes add is the gradient of the path by which the wave runs ahead,
for the ideal main lens turns slopes, not angles, into places. A polynomial over the opening has that gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._arrays import sunflower
from ..fates import RayFate
from ..polynomials import Polynomials
from ..shapes.discs import heights
from ..theory.object_space import ObjectSpaceFaces, SceneRays
from ..traced.train import FOUND, Train, beyond_fap

if TYPE_CHECKING:
    from .point_source import PointSource

Floats = NDArray[np.float64]

DEGREE = 9
"""Degree of the polynomial of the path."""
SAMPLES, FEWEST = 400, 108
"""Rays that it is fitted to, and below how many there is none."""
MARGIN = 1.05
"""Width over which these are spread, against the opening's."""
HALVINGS, TURNS = 40, 128
CLOSER, ROUNDS = 16, 4
"""Ends of what is lit: how much finer each further grid of directions is, and their number."""


@dataclass(frozen=True, eq=False)
class Wavefront:
    """The wave of one point in one colour, in the air before the main lens; places against that's axis."""

    source: PointSource
    faces: ObjectSpaceFaces
    """Faces with their clear apertures."""
    radius: float
    """Radius of the disc about its middle that the path is fitted on [mm]."""
    ahead: Polynomials
    """Path by which the wave runs ahead [mm]."""

    @classmethod
    def of(cls, source: PointSource, wavelength: float) -> Wavefront | None:
        """Aim rays all over the FAP; None where none comes through."""
        camera = source.camera.replace({"wavelength": wavelength})
        faces, free = ObjectSpaceFaces.of(camera), ObjectSpaceFaces.of(camera, clip=False)
        opening = source.opening
        middle, radius = opening.centres[0], MARGIN * float(opening.spans[0]) / 2
        disc = np.concatenate([sunflower(SAMPLES).T, _circle(48)])
        pupil = middle + radius * disc
        extra, comes = _extra_slopes(source, free, pupil)
        if np.count_nonzero(comes) < FEWEST:
            return None
        path = Polynomials.with_gradient(middle, np.full(2, radius), DEGREE, pupil[comes].T, extra[comes].T)
        return cls(source, faces, radius, path)

    @property
    def middle(self) -> Floats:
        """Middle of the disc, (2,) [mm]."""
        return self.ahead.middle

    def path(self, pupil: Floats) -> Floats:
        """Path by which the wave runs ahead at places (..., 2) of the FAP [mm]."""
        return self.ahead.at(pupil[..., 0], pupil[..., 1])

    def slopes(self, pupil: Floats) -> Floats:
        """Slopes in addition to the ideal wave's there, (..., 2)."""
        return np.moveaxis(self.ahead.gradient.at(pupil[..., 0], pupil[..., 1]), 0, -1)

    def lit(self, pupil: Floats) -> NDArray[np.bool_]:
        """Whether light comes through places (..., 2) of the FAP: past every rim, face by face, and the main lens."""
        camera = self.source.camera
        slope = self.source.slope(pupil) + self.slopes(pupil)
        height = pupil + slope * float(camera.seen.d_3)
        met = _carried(self.faces, height + self.source.lens, slope)
        return np.asarray((met.status == RayFate.KEPT) & (np.hypot(*np.moveaxis(height, -1, 0)) <= float(camera.D) / 2))

    @property
    def steepest(self) -> float:
        """Most that it adds to a slope over the FAP."""
        disc = self.middle + self.radius / MARGIN * np.concatenate([sunflower(SAMPLES).T, _circle(48)])
        return float(np.max(np.hypot(*self.slopes(disc).T)))

    def chords(self, rows: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Rows across what is lit: heights, their weights, and each chord's ends [mm]; no rows where it is dark."""
        trial = self.middle + self.radius * sunflower(SAMPLES).T
        lit, way = self.lit(trial), _circle(TURNS)
        if not lit.any():
            return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0)
        centre, ends = trial[lit].mean(axis=0), []
        edge = self._edge(np.broadcast_to(centre, way.shape), way)
        for sign in (-1, 1):
            angle, step = int(np.argmax(sign * edge[:, 1])) * (2 * math.pi / TURNS), 2 * math.pi / TURNS
            for _ in range(ROUNDS):  # a grid that closes in: the end may be a corner
                turn = angle + step * np.linspace(-1, 1, 2 * CLOSER + 1)
                way = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
                near = self._edge(np.broadcast_to(centre, way.shape), way)
                best = int(np.argmax(sign * near[:, 1]))
                angle, step = float(turn[best]), step / CLOSER
            ends.append(near[best])
        (low_x, low), (high_x, high) = ends
        # As far from both ends as to first order: sides bend at about the same shares of the height.
        first = self.source.opening.chords(rows)
        y, weight = (first.height, first.weight) if first.weight.any() else heights(-1.0, 1.0, rows)
        tall, middle = weight.sum(), (weight @ y) / weight.sum()
        y, weight = (high + low) / 2 + (y - middle) * ((high - low) / tall), weight * ((high - low) / tall)
        inside = np.stack([low_x + (high_x - low_x) * (y - low) / (high - low), y], axis=-1)
        left, right = (self._edge(inside, np.broadcast_to([sign, 0.0], inside.shape))[:, 0] for sign in (-1.0, 1.0))
        return y, weight, left, right

    def _edge(self, inside: Floats, way: Floats) -> Floats:
        """Places where light ends along ways from places (..., 2)."""
        low, high = np.zeros(len(way)), np.full(len(way), 2.2 * self.radius)
        for _ in range(HALVINGS):
            reach = (low + high) / 2
            lit = self.lit(inside + reach[:, None] * way)
            low, high = np.where(lit, reach, low), np.where(lit, high, reach)
        return np.asarray(inside + low[:, None] * way)


def _carried(faces: ObjectSpaceFaces, height: Floats, slope: Floats) -> SceneRays:
    return faces.rays((height[..., 0], height[..., 1]), (slope[..., 0], slope[..., 1]))


def _circle(count: int) -> Floats:
    turn = 2 * math.pi * np.arange(count) / count
    return np.stack([np.cos(turn), np.sin(turn)], axis=-1)


def _extra_slopes(source: PointSource, faces: ObjectSpaceFaces, pupil: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Slopes of exact rays from the point through places of the FAP, less the ideal wave's, and where rays come."""
    assert source.place is not None
    x, y, z = source.place
    d_3, ideal, start = float(source.camera.seen.d_3), source.slope(pupil), pupil + source.lens
    ends = np.concatenate([start, np.broadcast_to([-d_3, x, y, -z], (len(pupil), 4))], axis=1)
    (slope,), (far,), _ = beyond_fap(Train.before(*faces.bending), ends[None], ideal)
    comes = (far <= FOUND) & (_carried(faces, start + slope * d_3, slope).status == RayFate.KEPT)
    return slope - ideal, comes
