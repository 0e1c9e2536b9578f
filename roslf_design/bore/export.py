"""A surface of what other programs take as a sequence."""

from __future__ import annotations

from dataclasses import dataclass

from .._arrays import by_value
from ..lenses.prescription import Prescription, Surface
from .opening import ClearAperture


@by_value
@dataclass(frozen=True)
class SequenceRow:
    """Surface of a sequence, as one row."""

    name: str
    z: float
    """Place of its vertex behind the main lens's reference plane [mm]."""
    surface: Surface
    """Surface's shape and the glass behind it."""
    focal_length: float | None = None
    """Focal length of an ideal thin lens [mm]; None is a real surface."""
    is_stop: bool = False
    mirror: tuple[float, float] | None = None
    """Angle between the axis and a mirror's surface, and the azimuth into which that turns the view [rad]."""
    opening: ClearAperture | None = None
    """Clear opening; None is the disc of the surface's semi-diameter."""

    @property
    def clip(self) -> ClearAperture:
        """Clear opening."""
        return ClearAperture(self.surface.semi_diameter) if self.opening is None else self.opening


def lens_surfaces(name: str, lens: Prescription, start: float) -> list[SequenceRow]:
    """Surfaces of a lens whose first vertex stands at `start` [mm]."""
    pairs = enumerate(zip(lens.surfaces, lens.vertices, strict=True), 1)
    return [SequenceRow(f"{name}, surface {k}", start + z, surface) for k, (surface, z) in pairs]
