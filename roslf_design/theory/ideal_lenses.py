"""Field curvature and colour that lenses have which a design tells as ideal, in closed form; no ray has them.

Thin lenses, gradient-index rods and prescribed groups add up to the Petzval sum P, so that where the array sees a
height h off the axis it looks as if it stood ``P h^2/2`` farther back. Astigmatism comes on top. Colour is what the
camera sees in focus in light of the lines F and C, where each thin lens has the power of its glass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..bore.conjugates import CONJUGATES
from ..bore.lens import thin_petzval
from ..bore.main_lens import FOCAL, IdealMainLens
from ..camera import Camera
from ..errors import InputError
from ..lenses.glass import Glass
from ..lenses.manufacture import C_LINE, F_LINE, abbe_number
from ..words import listed, number
from .depth_of_field import depth_of_field
from .focused import has_views
from .light import sensor_field

SEEN = 400e-6, 700e-6
"""Wavelengths between which light may be white [mm]."""

STEP = 1e-3
"""Share of the way to a colour that tells into which direction it moves the plane in focus."""


class IdealLensFaults(NamedTuple):
    """Sizes, to third order, of what ideal lenses do not have."""

    lenses: int
    """How many of them there are."""
    unnamed: int
    """How many tell no material."""
    petzval: float
    """Petzval sum of all that no ray is traced through [1/mm]."""
    middle: float
    """Focal plane ahead of the tip [mm]."""
    corner: float
    """Plane in focus in the corner of the field, by the Petzval sum alone [mm]: 0 behind the tip, inf past infinity."""
    colours: tuple[float, ...]
    """Planes in focus in light of F and C [mm]; empty where no material tells."""
    sharp: tuple[float, float]
    """Depth of field of single views, of focused microlenses of the refocused image [mm]."""

    @classmethod
    def of(cls, c: Camera) -> IdealLensFaults | None:
        """Faults of a camera with power in its bore; None of one without ideal lenses there."""
        glasses = _materials(c)
        real = bool(c.lens.faults)
        counted = [part for part in c.in_bore if part.element.power_sign or not real]
        petzval = sum(float(part.element.petzval(part.at)) for part in counted)
        if not petzval or not np.isfinite(middle := float(c[CONJUGATES[1]] - c.tip)):
            return None
        if FOCAL in glasses:
            petzval += float(thin_petzval(c[FOCAL], glasses[FOCAL], c.wavelength))
        behind = c.seen.d_1 + petzval * sensor_field(c).radius ** 2 / 2
        corner = float(c.plane_of_vergence(1 / c.f - 1 / behind) - c.tip)
        sharp = depth_of_field(c, "view" if has_views(c) else "refocused")
        unnamed = sum(glass is None for glass in glasses.values())
        colours = _in_colours(c, glasses, middle)
        ends = float(sharp.near), float(sharp.far)
        return cls(len(glasses), unnamed, petzval, middle, _ahead(corner, middle, petzval < 0), colours, ends)

    @property
    def curved(self) -> str:
        """Field curvature in words."""
        index = " (n = 1.5 where no material is stated)" if self.unnamed else ""
        return (
            f"by a Petzval sum of {number(self.petzval, 3)} /mm{index} the plane in focus is "
            f"{_place(self.corner)} in the corner of the field, {number(self.middle, 3)} mm in its middle"
        )

    @property
    def coloured(self) -> str:
        """Colour in words; empty where no material tells."""
        if not self.colours:
            return ""
        unnamed = f", lenses without material left out ({self.unnamed})" if self.unnamed else ""
        return f"in light of 486 and of 656 nm that plane is {listed([*map(_place, self.colours)])}{unnamed}"

    @property
    def beyond(self) -> tuple[str, ...]:
        """Words on those that leave the depth of field."""
        near, far = self.sharp
        listed = ((self.curved, (self.corner,)), (self.coloured, self.colours))
        return tuple(words for words, planes in listed if any(not near <= plane <= far for plane in planes))


def _materials(c: Camera) -> dict[str, Glass | None]:
    """Place of each ideal lens's focal length, and its material."""
    own = {FOCAL: c.lens.material} if isinstance(c.lens, IdealMainLens) else {}
    thin = (part for part in c.in_bore if part.element.power_sign)
    return own | {f"{part.at.place}.focal_length": dict(part.element.glasses)["material"] for part in thin}


def _in_colours(c: Camera, glasses: dict[str, Glass | None], middle: float) -> tuple[float, ...]:
    """Planes in focus in light of F and C, ahead of the tip [mm]; empty where no material has colour."""
    known = {place: glass for place, glass in glasses.items() if glass is not None and abbe_number(glass) is not None}
    own = float(c.wavelength)
    if not known or not SEEN[0] <= own <= SEEN[1]:
        return ()

    def plane(line: float) -> float:
        weaker = {place: (glass.index(own) - 1) / (glass.index(line) - 1) for place, glass in known.items()}
        held = {FOCAL: c.f} if FOCAL in glasses else {}
        changes = held | {place: c[place] * float(share) for place, share in weaker.items()}
        return float(c.replace({**changes, "wavelength": line})[CONJUGATES[1]] - c.tip)

    try:
        return tuple(
            _ahead(plane(line), middle, plane(own + STEP * (line - own)) > middle) for line in (F_LINE, C_LINE)
        )
    except InputError:  # glass of rods or windows whose index is not known there
        return ()


def _ahead(plane: float, middle: float, farther: bool) -> float:
    """A plane that moved from the `middle`: 0 where it has gone past the tip, inf where past infinity [mm]."""
    if farther:
        return plane if plane >= middle else math.inf
    return plane if 0 <= plane <= middle else 0.0


def _place(plane: float) -> str:
    """A plane ahead of the tip in words."""
    return "behind the tip" if plane == 0 else "past infinity" if math.isinf(plane) else f"at {number(plane, 3)} mm"
