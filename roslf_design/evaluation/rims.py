"""For modules that are being moved: rims of a design as values."""

from __future__ import annotations

from typing import NamedTuple

from ..camera import Camera
from ..design import Design
from ..theory.vignetting import FieldLimit
from ..theory.vignetting import field_limit as limit_of
from .fields import axes_in_space

__all__ = ["FieldLimit", "axes_in_space", "field_limit", "rims"]


class OldRim(NamedTuple):
    """A circular opening that light must pass."""

    name: str
    diameter: float
    distance: float
    decentre: tuple[float, float]


def rims(design: Design) -> tuple[OldRim, ...]:
    """FAP first, then the main lens, then the further stops; decentres against the main lens."""
    c = Camera.of(design)
    return tuple(
        OldRim(
            r.name, 2 * float(r.radius), float(r.distance), (float(c.decentre(r.part)[0]), float(c.decentre(r.part)[1]))
        )
        for r in (c.fap, *c.rims)
    )


def field_limit(design: Design, object_radius: float = 0.0) -> FieldLimit:
    """Of a design's camera; the room is told at the corner of what the sensor sees."""
    return limit_of(Camera.of(design))
