"""Flat mirrors that fold the axis.

Everything else keeps its place along the unfolded axis: what stands before a mirror is where the mirror shows it. A
mirror where it should be thus does nothing to rays but for its clear aperture, a stop that leans; tilted or shifted, it
moves all that lies before it as one rigid body, twice reflected: in the mirror as it is, and back in the one meant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import field_validator

from ..lenses.prescription import Surface, rotation
from ..lenses.tracer import MIRROR, MOVED
from ..units import Angle, AnyLength, Length
from .element import Element, Flags, Matrix, Outline, Shift, face
from .export import SequenceRow
from .faces import KIND, TURNED, Face, Surroundings, plane_row
from .part import Number, PartNumbers

Triple = tuple[Number, Number, Number]


class Mirror(Element):
    """A flat mirror that folds the axis."""

    kind: Literal["mirror"]
    angle: Angle
    """Between the axis and its surface, between 0 and 90 degrees; the axis turns by twice as much [rad]."""
    azimuth: Angle = 0.0
    """Direction across the axis into which it turns the view, from x towards y [rad]."""
    diameter: Length
    """Clear aperture, in its surface [mm]."""
    piston: AnyLength = 0.0
    """Shift along its normal, out of its place in the fold [mm]; what stands before it stays where it is."""

    number_keys: ClassVar = (*Element.number_keys, "piston")
    bends: ClassVar = False
    leans: ClassVar = True
    signed: ClassVar = ("piston",)
    sealable: ClassVar = False
    bounces: ClassVar = 1

    @field_validator("angle", mode="after")
    @classmethod
    def _folds(cls, value: float) -> float:
        if not 0 < value < math.pi / 2:
            raise ValueError(
                f"{math.degrees(value):.4g} deg is no fold: 0 is along the axis, 90 deg sends light straight back; "
                "give the angle between the axis and the mirror's surface, as 45 deg for a turn by 90 deg"
            )
        return value

    @property
    def turn(self) -> float:  # type: ignore[override]
        """Angle by which it turns the axis [rad]."""
        return 2 * float(self.angle)

    @property
    def towards(self) -> float:  # type: ignore[override]
        """Direction into which it turns the view, across the axis from x towards y [rad]."""
        return float(self.azimuth)

    @property
    def _normal(self) -> tuple[float, float, float]:
        """Normal on the sensor's side where it stands straight."""
        across = math.cos(self.angle)
        return across * math.cos(self.azimuth), across * math.sin(self.azimuth), math.sin(self.angle)

    def _turned(self, at: PartNumbers) -> Triple:
        """Normal as it is: tilted about its own axes, x and y of the camera turned with the mirror's fold."""
        (tilt_x, tilt_y), (sin, cos) = at.pair("tilt"), (math.sin(self.angle), math.cos(self.angle))
        x, y, z = np.sin(tilt_y) * np.cos(tilt_x), -np.sin(tilt_x), np.cos(tilt_y) * np.cos(tilt_x)
        ahead, aside = math.cos(self.azimuth), math.sin(self.azimuth)
        along, across = x * ahead + y * aside, y * ahead - x * aside
        along, z = along * sin + z * cos, z * sin - along * cos
        return along * ahead - across * aside, along * aside + across * ahead, z

    def _moves(self, at: PartNumbers) -> tuple[list[list[Number]], list[Number]]:
        """Turn about its vertex and shift [mm] that its tilt and piston give to all that it shows."""
        meant, own = self._normal, self._turned(at)
        share = _inner(meant, own)
        turn = [
            [float(i == j) - 2 * a * b - 2 * own[i] * own[j] + 4 * share * a * own[j] for j, b in enumerate(meant)]
            for i, a in enumerate(meant)
        ]
        far = 2 * at["piston"] * share
        return turn, [far * (mine - 2 * share * a) for a, mine in zip(meant, own, strict=True)]

    def lean(self, at: PartNumbers) -> tuple[Number, Number]:
        """Tilt of its clear aperture against upright [rad]."""
        x, y, z = self._turned(at)
        return np.arctan(-y / np.sqrt(x * x + z * z)), np.arctan(x / z)

    def reach(self, diameter: Number, height: Number) -> Number:
        """How far to both sides of its vertex its surface goes within a height [mm]."""
        return np.minimum(diameter / 2 * math.cos(self.angle), height / math.tan(self.angle))

    def _depth(self, at: PartNumbers) -> Number:
        """How far before its vertex the middle of its clear aperture lies [mm]: that moves along its surface."""
        (x, y, z), (off_x, off_y) = self._turned(at), at.pair("decentre")
        pushed = at["piston"] * _inner(self._normal, (x, y, z))
        return (x * off_x + y * off_y - pushed) / z

    def openings(self, at: PartNumbers) -> Iterator[tuple[str, Number]]:
        """Opening of its clear aperture and the place of its middle."""
        yield "", at["distance"] + self._depth(at)

    def forward(self, at: PartNumbers, inside: Number, passed: Flags) -> Matrix:
        """Matrix of the way that a piston takes off."""
        return 1.0, np.where(passed, self._moves(at)[1][2], 0.0)[()], 0.0, 1.0

    def shifted(
        self, at: PartNumbers, axis: int, forward: Matrix, inside: Number, shift: Shift, beyond: Number
    ) -> Shift:
        """Main lens's axis behind it, moved and turned as a whole."""
        (turn, moved), (e, f) = self._moves(at), shift
        f = f + turn[axis][2] / turn[2][2]
        return e + moved[axis] - forward[1] * f, f

    def faces(self, at: PartNumbers, name: str, around: Surroundings) -> list[Face]:
        """Clear aperture, and what it does to rays that pass it."""
        (x, y), z, (turn, moved) = at.pair("decentre"), at["distance"], self._moves(at)
        vertex = np.stack(np.broadcast_arrays(x, y, -z - self._depth(at)), axis=-1)
        row = plane_row(vertex, rotation(*self.lean(at)), at["diameter"] / 2, *(part for line in turn for part in line))
        row[..., KIND], row[..., TURNED] = MIRROR, 0.0
        pivot = np.negative(x), np.negative(y), self._depth(at)  # where the axis meets it, from the row's vertex
        for i, line in enumerate(turn):
            for j, part in enumerate(line):
                row[..., MOVED + 3 * i + j] = part
            row[..., MOVED + 9 + i] = moved[i] + pivot[i] - _inner((line[0], line[1], line[2]), pivot)
        return [Face(row, 1.0, 1.0, f"{at.place}.0", name)]

    def profile(self, ends: tuple[float, float], thick: float) -> list[tuple[Outline, Outline]]:
        """Its surface, and a back as a mirror has one."""
        x, _, z = self._normal
        middle, size = (ends[0] + ends[1]) / 2, math.hypot(x, z)
        along = np.linspace(ends[0] - middle, ends[1] - middle, 25)
        surface = np.stack([-self.distance - along * x / size, middle + along * z / size], -1)
        return [(surface - thick / 4 * np.array([z, x]) / size, surface)]

    def body(self, half: float, thick: float) -> list[tuple[Outline, Outline]]:
        """Its surface, and a back as a mirror has one."""
        ends = -half, half
        return [(face(ends, -self.distance - thick / 4), face(ends, -self.distance))]

    def rows(self, name: str, at: float, semi: float) -> list[SequenceRow]:
        """Surface that reflects."""
        return [SequenceRow(name, at, Surface(0.0, semi), mirror=(float(self.angle), float(self.azimuth)))]

    def words(self) -> tuple[str, ...]:
        """Turn of the axis."""
        return (f"turns by {math.degrees(self.turn):.4g}°",)


def _inner(a: Triple, b: Triple) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
