"""Openings that light must pass, as the main lens sees them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._arrays import by_value
from ..bore.chain import Flags, ImagedPlane
from ..bore.lens import IMAGE
from ..bore.opening import ClearAperture
from ..bore.part import Number
from ..bore.rod import SECTION_WORD


@by_value
@dataclass(frozen=True)
class Rim:
    """An opening that light must pass: the flexible angular plane (FAP), the main lens, a further stop."""

    name: str
    """"FAP", "main lens", or "stop 1" or a name of its own and so on, in the order of the design file."""
    part: str
    """Its place in a design: "aperture", "main_lens", "stops.0"; of an element's two faces "elements.0.0" and ".1",
    of sections of a rod's barrel ".2" and so on; of what an objective with a mapping images "elements.0.image"."""
    outline: ClearAperture
    """Clear opening as the main lens sees it: through what stands between."""
    distance: Number
    """z_k as the main lens sees it, in front of it [mm]."""
    ruler_distance: Number
    """Mechanical distance in front of the main lens [mm]."""
    scale: Number = 1.0
    """Its own lengths over those that the main lens sees."""
    plane: ImagedPlane | None = None
    """Plane that it stands on; None in air."""
    leans: bool = False
    """True where it leans by design, as that of a mirror."""

    @property
    def opening(self) -> str:
        """Name of the opening; of a barrel's section that of the whole barrel."""
        return self.name.partition(SECTION_WORD)[0]

    @property
    def radius(self) -> Number:
        """R_k as the main lens sees it: distance of its farthest point from its centre [mm]."""
        return self.outline.reach

    @property
    def round(self) -> bool:
        """Whether it is a disc that stands upright."""
        return not (self.leans or self.outline.straight)

    @property
    def behind(self) -> Flags:
        """True of builds where it stands behind the main lens, which shows the scene its image alone."""
        if self.plane is None:
            return np.False_
        return np.less(self.ruler_distance, 0) & np.not_equal(self.plane.c, 0)

    @property
    def size_places(self) -> tuple[str, ...]:
        """Where the lengths stand in a design that make it as wide as it is; none of the end of a mapping."""
        if self.part.endswith(IMAGE):
            return ()
        return tuple(f"{place_of(self.part)}.{key}" for key in self.outline.keys)


def place_of(part: str) -> str:
    """Place of a part's numbers in a design: "elements.0" of its face "elements.0.1", else its own place."""
    return part.rpartition(".")[0] if part.count(".") == 2 else part
