"""Focused (plenoptic 2.0) arrays: what microlenses show that are focused elsewhere than on the pupil.

Virtual depth v = a/b (Perwass and Wietzke 2012) counts distances before the array in units of b = d_2, here with a
sign: above 0 the main lens's image lies before the array (Keplerian), below 0 behind it (Galilean). All forms take 1/v,
which is 0 at infinity and ``d_2/f_ml - 1`` where microlenses are focused; the pupil stands at ``d_2/L``. A point is
blurred over the difference of its 1/v and the microlenses' own, in pitches; one over its difference to the pupil's, for
images that fill their cells, is how many microlenses across see it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, product, ratio
from ..camera import Camera
from ..design import PATHS, Design
from ..errors import InputError, Problem
from ..words import listed
from .exit_pupil import microlens_image_diameter, microlens_image_pitch
from .light import diffraction_width, microlens_defocus_blur

LIMIT = 2.0
"""Blur of the pupil, over that of pixels and diffraction together, from which an array is a focused one.

A microlens then tells two points apart on its own share of the plane that it is focused on, where an unfocused one has
one sample, and less than half (1 of sqrt(5)) of the views are left that pixels and diffraction would leave.
"""
COVERED = 2.0
"""Virtual depth of the total covering plane: from there on each point is seen by two microlenses across, and in a
hexagonal array of three types by one of each."""
PLANES = (COVERED, 2.5, 3.0, 3.5, 4.0, 5.0, 7.0, 10.0)
"""Virtual depths that are told."""


def own_blur(c: Camera) -> Array:
    """Width on the sensor of what pixels and diffraction blur together [mm]."""
    return np.hypot(c.q, diffraction_width(c))


def focus_of(c: Camera) -> Array:
    """1/v of the plane that the microlenses image onto the sensor."""
    return ratio(c.seen.d_2 - c.f_ml, c.f_ml)


def inverse_virtual_depth(c: Camera, at: float) -> Array:
    """1/v of a plane `at` a distance ahead of the bore's tip [mm]; infinite at the focal plane."""
    seen = c.plane(at + c.tip).distance
    return ratio(c.seen.d_2, c.seen.d_1 - ratio(c.f, 1 - ratio(c.f, seen)))


def plane_of(c: Camera, inverse: ArrayLike) -> Array:
    """Distance ahead of the bore's tip at which an object has 1/v [mm]; inf at infinity and beyond."""
    inverse = np.asarray(inverse, float)
    vergence = 1 / c.f - ratio(inverse, product(c.seen.d_1, inverse) - c.seen.d_2)
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = np.asarray(c.plane_of_vergence(vergence))
    return np.where(c.chain.past_infinity(c.numbers, plane), np.inf, plane - c.tip)


def seen_by(c: Camera, inverse: ArrayLike) -> Array:
    """Microlenses across that see a point at 1/v: its light's width on the array, in pitches."""
    return ratio(microlens_image_diameter(c), c.d * np.abs(np.asarray(inverse) - product(c.seen.d_2, c.seen.vergence)))


def point_blur(c: Camera, inverse: ArrayLike) -> Array:
    """Width on the sensor over which a microlens spreads a point at 1/v [mm]; near the array light fills it in part."""
    off, apart = np.abs(np.asarray(inverse) - focus_of(c)), product(c.seen.d_2, c.seen.vergence)
    part = product(microlens_image_diameter(c), ratio(off, np.abs(np.asarray(inverse) - apart)))
    return np.minimum(c.d * off, part)


def resolution_ratio(c: Camera, inverse: ArrayLike) -> Array:
    """Pixels of the refocused image of a plane at 1/v for one of the sensor's, along each axis.

    What a microlens tells apart of its image, over the number of microlenses that tell the same: q/(s v) for
    microlenses whose images fill their cells, before a pupil far away, s the widths of pixel, diffraction and blur.
    """
    told = microlens_image_diameter(c) / np.hypot(own_blur(c), point_blur(c, inverse))
    return np.asarray(told / np.maximum(seen_by(c, inverse), 1.0) * np.abs(c.q / microlens_image_pitch(c)))


def sharp_range(c: Camera) -> tuple[Array, Array]:
    """1/v at the ends of what the microlenses show as sharp as pixels and diffraction allow, the nearer to 0 first."""
    focus, room = focus_of(c), own_blur(c) / c.d
    side = np.where(focus < 0, -1.0, 1.0)
    return side * np.maximum(np.abs(focus) - room, 0.0), side * (np.abs(focus) + room)


def is_focused(c: Camera) -> Any:
    """True where microlenses of any type are focused elsewhere than on the pupil, by `LIMIT`."""
    return np.any([microlens_defocus_blur(one) >= LIMIT * own_blur(one) for one in c.microlens_types], axis=0)


def pupil_remedy(c: Camera) -> str:
    """What would make the microlenses image the pupil."""
    focal = float(c.replace({}, in_focus=True).f_ml)
    if not 0 < focal < np.inf:
        return "no microlens images a pupil so near the array; another d_3 moves it"
    return f"microlenses of {1e3 * focal:.4g} um would image the pupil"


@dataclass(frozen=True)
class FocusedType:
    """Microlenses of one focal length."""

    focal_length_mm: float
    virtual_depth: float
    """v, above 0 before the array (Keplerian), below 0 behind (Galilean)."""
    focused_at_mm: float
    """Plane that they are focused on, ahead of the tip; infinite where there is none."""
    sharp_virtual_depths: tuple[float, float]
    """Between which blur is no more than that of pixels and diffraction."""
    sharp_mm: tuple[float, float]
    """The same ahead of the tip, nearer end first."""
    seen_by: float
    """Microlenses across that see a point of the plane in focus."""
    resolution_ratio: float
    """Pixels of its refocused image for one of the sensor's, along each axis."""
    pupil_blur_px: float

    @classmethod
    def of(cls, c: Camera) -> FocusedType:
        """Microlenses of a camera that has one type."""
        focus, ends = focus_of(c), sharp_range(c)
        near, far = sorted(float(plane_of(c, end)) for end in ends)
        depths = float(ratio(1.0, ends[1])), float(np.copysign(ratio(1.0, abs(ends[0])), ends[1]))
        at = (float(form(c, focus)) for form in (plane_of, seen_by, resolution_ratio))
        blur = float(microlens_defocus_blur(c) / c.q)
        plane, across, resolved = at
        return cls(float(c.f_ml), float(ratio(1.0, focus)), plane, depths, (near, far), across, resolved, blur)


@dataclass(frozen=True)
class VirtualDepth:
    """A plane of object space by its virtual depth."""

    virtual_depth: float
    at_mm: float
    """Ahead of the tip."""
    blur_px: tuple[float, ...]
    """Width over which each type of microlens spreads a point."""
    seen_by: float
    resolution_ratio: float
    """With the microlenses that show it sharpest."""

    @classmethod
    def of(cls, c: Camera, depth: float) -> VirtualDepth:
        """Plane of a camera at a virtual depth."""
        types, at = c.microlens_types, 1 / depth
        blurs = tuple(float(point_blur(one, at) / one.q) for one in types)
        best = max(float(resolution_ratio(one, at)) for one in types)
        return cls(depth, float(plane_of(c, at)), blurs, float(seen_by(c, at)), best)


@dataclass(frozen=True)
class FocusedArray:
    """A focused array in numbers."""

    own_blur_px: float
    """Blur of pixels and diffraction."""
    types: tuple[FocusedType, ...]
    planes: tuple[VirtualDepth, ...]

    @classmethod
    def of(cls, c: Camera) -> FocusedArray | None:
        """Array of one camera; None where its microlenses image the pupil."""
        if not is_focused(c):
            return None
        types = tuple(map(FocusedType.of, c.microlens_types))
        sides = sorted({float(np.sign(one.virtual_depth)) for one in types})
        planes = (VirtualDepth.of(c, side * depth) for side in sides for depth in PLANES)
        return cls(float(own_blur(c) / c.q), types, tuple(plane for plane in planes if plane.at_mm < np.inf))


def focus_faults(design: Design, *what: str, changed: Iterable[str] = ()) -> tuple[Problem, ...]:
    """Fault of asking what takes each pixel behind a microlens for a view, of a camera where it is none.

    Parameters
    ----------
    design : Design
    *what : str
        What is asked for: "depth from views".
    changed : iterable of str
        Places, or symbols, that vary: where the microlenses' focus is among them there is no fault.
    """
    camera = Camera.of(design.thin_twin)
    if not what or not is_focused(camera) or PATHS["f_ml"] in {PATHS.get(place, place) for place in changed}:
        return ()
    key = "focal_lengths" if design.microlens_array.focal_lengths else "focal_length"
    message = (
        f"{design.microlens_array.focal_words} does not focus the microlenses of {design.name} on the pupil (a "
        f"focused, plenoptic 2.0 camera), so that pixels are no views and there is no {listed([*what])}; roslf "
        f"evaluate and render hold, and {pupil_remedy(camera)}"
    )
    return (Problem(f"microlens_array.{key}", message),)


def refuse_focused(design: Design, *what: str, changed: Iterable[str] = ()) -> None:
    """Refuse what `focus_faults` finds; parameters as there.

    Raises
    ------
    InputError
    """
    if faults := focus_faults(design, *what, changed=changed):
        raise InputError(faults)
