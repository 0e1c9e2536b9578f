"""What may stand in object space. Positions are (x, y) [mm] off the axis and distances Z from the main lens [mm]."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..design.parts import Offset, Part, Size, Tilt
from ..design.units import AnyLength, Length
from .textures import Checkerboard, Picture, Sinusoid, Texture, Uniform

Surface = Checkerboard | Picture | Sinusoid | Uniform


class White(Part):
    """A uniform field that fills the view at every distance."""

    kind: Literal["white"] = "white"
    level: Annotated[float, Field(ge=0)] = 1.0
    """Radiance."""


class Plane(Part):
    """A plane at any pose, unbounded or a rectangle; seen from both sides."""

    kind: Literal["plane"] = "plane"
    distance: Length | None = None
    """Z of its origin [mm]; none is the design's focal plane."""
    centre: Offset = (0.0, 0.0)
    """(x, y) of its origin."""
    tilt: Tilt = (0.0, 0.0)
    """Its normal is z turned by t_x about x, then by t_y about y [rad]."""
    size: Size | None = None
    """Width and height [mm]; none is unbounded."""
    texture: Texture = Uniform()
    """Over its own (u, v), u along x and v along y before it is tilted."""

    @model_validator(mode="after")
    def _faces_the_lens(self) -> Plane:
        if math.cos(self.tilt[0]) * math.cos(self.tilt[1]) < 0.01:
            raise ValueError(f"tilt {self.tilt} rad shows the plane's edge to the lens; keep it below 89 degrees")
        return self


class Points(Part):
    """Point sources."""

    kind: Literal["points"] = "points"
    positions: tuple[tuple[AnyLength, AnyLength, Length], ...] = Field(min_length=1)
    """(x, y, Z) of each."""
    flux: Annotated[float, Field(gt=0)] = 1.0
    """Light of one that the FAP takes in: the sum over all pixels, where 1 is a fully lit one."""


class Sphere(Part):
    """An opaque sphere seen from outside; texture over (longitude, latitude) times radius, (0, 0) facing the lens."""

    kind: Literal["sphere"] = "sphere"
    distance: Length
    """Z of its centre [mm]."""
    radius: Length
    """[mm]."""
    centre: Offset = (0.0, 0.0)
    """(x, y) of its centre."""
    texture: Texture = Uniform()
    """Over its surface."""


class Tube(Part):
    """The inside of a tube along the axis (a lumen); texture over (arc length around, Z)."""

    kind: Literal["tube"] = "tube"
    start: Length
    """Z of its near end [mm]."""
    end: Length
    """Z of its far end [mm]."""
    radius: Length
    """[mm]."""
    centre: Offset = (0.0, 0.0)
    """(x, y) of its axis."""
    texture: Texture = Uniform()
    """Over its wall."""

    @model_validator(mode="after")
    def _has_a_length(self) -> Tube:
        if self.end <= self.start:
            raise ValueError(f"end {self.end:g} mm is not beyond start {self.start:g} mm; the far end comes second")
        return self


Object = Annotated[White | Plane | Points | Sphere | Tube, Field(discriminator="kind")]

OBJECTS: dict[str, type[Part]] = {"white": White, "plane": Plane, "points": Points, "sphere": Sphere, "tube": Tube}
"""Kinds of object by the name that a file gives them."""


def depths(thing: White | Plane | Points | Sphere | Tube, focal_plane: float, slopes: float) -> Iterator[float]:
    """Nearest and farthest Z that an object shows [mm]; nothing for a white field, which looks alike at any.

    Parameters
    ----------
    thing
        The object.
    focal_plane : float
        Z [mm] of planes that give none.
    slopes : float
        Largest slope at which the camera looks off its axis, for planes without bounds.
    """
    if isinstance(thing, Points):
        yield from (z for _, _, z in thing.positions)
    elif isinstance(thing, Sphere):
        yield from (thing.distance - thing.radius, thing.distance)
    elif isinstance(thing, Tube):
        yield from (thing.start, thing.end)
    elif isinstance(thing, Plane):
        yield from _plane_depths(thing, focal_plane if thing.distance is None else thing.distance, slopes)


def _plane_depths(plane: Plane, distance: float, slopes: float) -> Iterator[float]:
    tilt_x, tilt_y = plane.tilt
    # Z on the plane grows by (rise_x x + rise_y y): its normal is (sin t_y cos t_x, -sin t_x, cos t_x cos t_y), and
    # distances Z count against the light's z.
    rise_x, rise_y = math.tan(tilt_y), -math.tan(tilt_x) / math.cos(tilt_y)
    if plane.size is not None:
        half = abs(math.sin(tilt_y)) * plane.size[0] / 2
        half += abs(math.cos(tilt_y) * math.sin(tilt_x)) * plane.size[1] / 2
        yield from (distance - half, distance + half)
        return
    at_axis = distance - rise_x * plane.centre[0] - rise_y * plane.centre[1]
    rise = math.hypot(rise_x, rise_y) * slopes
    yield from (at_axis / (1 + rise), at_axis / (1 - rise) if rise < 1 else math.inf)
