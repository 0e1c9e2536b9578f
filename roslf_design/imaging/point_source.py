"""A point of light as a camera sees it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from .._arrays import by_value
from ..camera import Camera
from ..shapes.openings import Openings
from .camera import Floats


@by_value
@dataclass(frozen=True)
class PointSource:
    """One point as a camera sees it; positions against the main lens's axis."""

    camera: Camera
    """Camera as planned, not tilted."""
    x: float
    y: float
    distance: float
    """Z, as the main lens sees it [mm]."""
    place: tuple[float, float, float] | None = None
    """Mechanical place, from the system's axis [mm]; None without exact rays through the elements."""

    @property
    def lens(self) -> Floats:
        """The main lens's decentre [mm]."""
        return np.array(self.camera.lens_centre, float)

    def slope(self, pupil: Floats) -> Floats:
        """Slope of the ideal wave at places (..., 2) of the FAP."""
        return np.asarray((pupil - (self.x, self.y)) / self.reach)

    @property
    def reach(self) -> float:
        """Distance from the FAP, R = Z - d_3 [mm]."""
        return float(self.distance - self.camera.seen.d_3)

    @property
    def throw(self) -> float:
        """B of the ray matrix from the FAP to the array, A = d_1/H [mm]."""
        return float(self.camera.seen.A)

    @property
    def defocus(self) -> float:
        """Curvature of the wave on the FAP that the main lens does not undo, 1/R - 1/(d_f - d_3) [1/mm]."""
        return float((self.camera.seen.d_f - self.distance) / (self.reach * self.camera.seen.gap))

    @property
    def spot(self) -> Floats:
        """Point where the ray through the FAP plane's axis point meets the array [mm]."""
        return -np.array([self.x, self.y]) * (self.throw / self.reach)

    @cached_property
    def opening(self) -> Openings:
        """Openings of the FAP, the lens and further rims for this point, on the FAP's plane from the lens's axis."""
        rows = []
        for rim in self.camera.openings:
            grow = self.reach / (self.distance - float(rim.distance))
            at_x, at_y = self.camera.decentre(rim.part)
            middle = np.array([self.x + (at_x - self.x) * grow, self.y + (at_y - self.y) * grow], float)
            rows.append(Openings.of(rim.outline.scaled(abs(grow)), ()).moved(middle))
        return reduce(Openings.beside, rows)
