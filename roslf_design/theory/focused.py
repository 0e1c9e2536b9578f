"""Focused (plenoptic 2.0) arrays: what microlenses show that are focused elsewhere than on the pupil.

Virtual depth v = a/b (Perwass and Wietzke 2012) counts distances before the array in units of b = d_2, here with a
sign: above 0 the main lens's image lies before the array (Keplerian), below 0 behind it (Galilean). All forms take 1/v,
which is 0 at infinity and ``d_2/f_ml - 1`` where microlenses are focused; the pupil stands at ``d_2/L``. A point is
blurred over the difference of its 1/v and the microlenses' own, in pitches; one over its difference to the pupil's, for
images that fill their cells, is how many microlenses across see it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, product, ratio
from ..camera import Camera
from ..design import PATHS, Design
from ..errors import InputError, Problem
from ..words import length, listed, number
from .colours import PIXEL_FILTERS
from .exit_pupil import microlens_image_diameter, microlens_image_pitch
from .light import diffraction_width, geometric_views, microlens_defocus_blur

LIMIT = 2.0
"""Blur of the pupil, over that of pixels and diffraction together, from which an array is a focused one.

A microlens then tells two points apart on its own share of the plane that it is focused on, where an unfocused one has
one sample, and less than half (1 of sqrt(5)) of the views are left that pixels and diffraction would leave.
"""
LEAST_VIEWS = 2
"""Pixels across a microlens image from which a camera tells directions apart."""
COVERED = 2.0
"""Virtual depth of the total covering plane: from there on each point is seen by two microlenses across, and in a
hexagonal array of three types by one of each."""


def _own_blur(c: Camera) -> Array:
    """Width on the sensor of what pixels and diffraction blur together [mm]."""
    return np.hypot(c.q, diffraction_width(c))


def inverse_virtual_depth(c: Camera, at: float) -> Array:
    """1/v of a plane `at` a distance ahead of the bore's tip [mm]; infinite at the focal plane."""
    seen = c.plane_ahead(at).distance
    return ratio(c.seen.d_2, c.seen.d_1 - ratio(c.f, 1 - ratio(c.f, seen)))


def _ahead(c: Camera, inverse: float) -> float:
    """Distance ahead of the bore's tip at which an object has 1/v [mm]; inf at infinity and beyond."""
    with np.errstate(divide="ignore"):
        plane = c.plane_of_vergence(1 / c.f - ratio(inverse, product(c.seen.d_1, inverse) - c.seen.d_2))
    return float(np.where(c.chain.past_infinity(c.numbers, plane), np.inf, plane - c.tip))


def seen_by(c: Camera, inverse: ArrayLike) -> Array:
    """Microlenses across that see a point at 1/v: its light's width on the array, in pitches."""
    return ratio(microlens_image_diameter(c), c.d * np.abs(np.asarray(inverse) - product(c.seen.d_2, c.seen.vergence)))


def point_blur(c: Camera, inverse: ArrayLike) -> Array:
    """Width over which a microlens spreads a point at 1/v [px]; near the array its light fills a microlens in part."""
    off = np.abs(np.asarray(inverse) + 1 - ratio(c.seen.d_2, c.f_ml))
    part = ratio(off, np.abs(np.asarray(inverse) - product(c.seen.d_2, c.seen.vergence)))
    return np.minimum(c.d * off, product(microlens_image_diameter(c), part)) / c.q


def resolution_ratio(c: Camera, inverse: ArrayLike) -> Array:
    """Pixels of the refocused image of a plane at 1/v for one of the sensor's, along each axis.

    What a microlens tells apart of its image, over the number of microlenses that tell the same: q/(s v) for
    microlenses whose images fill their cells, before a pupil far away, s the widths of pixel, diffraction and blur.
    """
    told = microlens_image_diameter(c) / np.hypot(_own_blur(c), c.q * point_blur(c, inverse))
    return np.asarray(told / np.maximum(seen_by(c, inverse), 1.0) * np.abs(c.q / microlens_image_pitch(c)))


def pupil_blur_ratio(c: Camera) -> Array:
    """Blur of the pupil over that of pixels and diffraction together, of the type of microlens that blurs it most."""
    return np.asarray(np.max([microlens_defocus_blur(one) / _own_blur(one) for one in c.microlens_types], axis=0))


def is_focused(c: Camera) -> Any:
    """True where microlenses of any type are focused elsewhere than on the pupil, by `LIMIT`."""
    return pupil_blur_ratio(c) >= LIMIT


def filtered_views(c: Camera) -> Array:
    """Pixels across a microlens image; behind a Bayer pattern green ones, which lie farther apart."""
    return geometric_views(c) / PIXEL_FILTERS[c.colours].spacing


def has_views(c: Camera) -> Any:
    """True where pixels are views: microlenses image the pupil, over pixels enough to tell its directions apart."""
    return (pupil_blur_ratio(c) < LIMIT) & (filtered_views(c) >= LEAST_VIEWS)


def pupil_remedy(c: Camera) -> str:
    """Focal length that would make the microlenses image the pupil, in words."""
    focal = float(c.replace({}, in_focus=True).f_ml)
    images = 0 < focal < np.inf
    return f"f_ml = {length(focal)} would image the pupil" if images else "another d_3 would move the pupil into focus"


@dataclass(frozen=True)
class _FocusedPlane:
    """A plane of object space as focused microlenses show it."""

    name: str
    """Type that is focused on it, or where in the sharp range it lies."""
    virtual_depth: float
    """Distance from its image by the main lens to the array, over d_2; below 0 where that lies behind the array."""
    ahead_mm: float
    """Distance ahead of the tip; infinite at infinity and beyond."""
    blur_px: tuple[float, ...]
    """Width over which each type of microlens spreads a point."""
    seen_by: float
    """Microlenses across that see a point: two at least for depth."""
    resolution_ratio: float
    """Pixels of the refocused image for one of the sensor's, along each axis, of the type that shows it best."""

    @classmethod
    def of(cls, c: Camera, name: str, inverse: float) -> _FocusedPlane:
        """Plane of a camera at 1/v."""
        types = c.microlens_types
        blurs = tuple(float(point_blur(one, inverse)) for one in types)
        best = max(float(resolution_ratio(one, inverse)) for one in types)
        return cls(name, float(ratio(1.0, inverse)), _ahead(c, inverse), blurs, float(seen_by(c, inverse)), best)

    @property
    def cells(self) -> tuple[str, ...]:
        """Row of the table of planes."""
        shown = (self.virtual_depth, 3), (self.ahead_mm, 4), *((blur, 3) for blur in self.blur_px)
        return self.name, *(number(*each) for each in (*shown, (self.seen_by, 3), (self.resolution_ratio, 3)))


@dataclass(frozen=True)
class FocusedArray:
    """Focused microlenses of a camera."""

    types: tuple[str, ...]
    """Focal length of each type."""
    own_blur_px: float
    """Blur of pixels and diffraction together."""
    pupil_blur_px: tuple[float, ...]
    """Width over which each type spreads a point of the pupil."""
    in_focus: tuple[_FocusedPlane, ...]
    """Plane that each type is focused on."""
    limits: tuple[_FocusedPlane, ...]
    """Where the sharp range of each type begins and ends, and the total covering plane."""

    @classmethod
    def of(cls, c: Camera) -> FocusedArray | None:
        """Array of one camera; None where its microlenses image the pupil."""
        if not is_focused(c):
            return None
        types, room = c.microlens_types, float(_own_blur(c) / c.d)
        names = tuple(length(float(one.f_ml)) for one in types)
        focus = [float(ratio(one.seen.d_2, one.f_ml)) - 1 for one in types]
        ends = [
            (f"{name} sharp {end}", at + math.copysign(room, at) * way)
            for name, at in zip(names, focus, strict=True)
            for end, way in (("from", 1), ("to", -1))
        ]
        planes = tuple(_FocusedPlane.of(c, f"{name} in focus", at) for name, at in zip(names, focus, strict=True))
        limits = tuple(
            _FocusedPlane.of(c, *end) for end in (*ends, ("all covered", math.copysign(1 / COVERED, focus[0])))
        )
        blurs = tuple(float(microlens_defocus_blur(one) / one.q) for one in types)
        return cls(names, float(_own_blur(c) / c.q), blurs, planes, limits)


def focus_faults(design: Design, *asked: str, changed: Iterable[str] = ()) -> Iterator[Problem]:
    """Fault of asking what takes pixels for views, as "depth from views", of a camera where they are none.

    None where the microlenses' focal length is among the places, or symbols, that are `changed`.
    """
    camera = Camera.of(design.thin_twin)
    if asked and is_focused(camera) and PATHS["f_ml"] not in {PATHS.get(place, place) for place in changed}:
        array = design.microlens_array
        yield Problem(
            f"microlens_array.focal_length{'s' if array.focal_lengths else ''}",
            f"{array.focal_words} does not focus the microlenses of {design.name} on the pupil (a focused, plenoptic "
            f"2.0 camera), so that pixels are no views and there is no {listed([*asked])}; roslf evaluate and render "
            f"hold, and {pupil_remedy(camera)}",
        )


def refuse_focused(design: Design, *asked: str, changed: Iterable[str] = ()) -> None:
    """Refuse what `focus_faults` finds, with an `InputError`."""
    if faults := tuple(focus_faults(design, *asked, changed=changed)):
        raise InputError(faults)
