"""Errors of depth in the scene: what those of disparities, lengths and temperature make of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..bore.chain import ImagedPlane
from ..bore.part import TEMPERATURE
from ..camera import TEMPERATURES, Camera, Number
from ..design.parts import OCTAVES
from ..shapes.lattice import PACKINGS
from . import light, light_field
from .disparity_error import axial_disparity_sigma, disparity_sigmas
from .disparity_information import Seen
from .f_number import fill_factor
from .length_covariance import LengthCovariance
from .photometry import NOTHING, Beside, electrons
from .quantity import Depth
from .stop_images import MicrolensImages

RANGE_NODES = np.array([-1.0, -((3 / 7) ** 0.5), 0.0, (3 / 7) ** 0.5, 1.0])
RANGE_WEIGHTS = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180
"""Gauss-Lobatto nodes over half a range of temperatures about its middle, its ends among them, and their weights."""
MOST_FILL = {"square": 1.5, "hexagonal": 1.35}
"""Image fill, by layout, beyond which views cannot be told apart one by one: images of several microlenses reach three
quarters of the pixels, and from 1.97 on none shows mostly its own microlens. Told apart so, depths of a borescope
scatter 1.0 times as predicted at a fill of 1.4, 1.9 times at 1.6, 33 times at 1.8; of the paper's bench 1.8 times at
1.4; of a hexagonal array 2.8 times at 1.41."""
MOST_FITTED = {"square": 2.1, "hexagonal": 1.35}
"""Image fill, by layout, up to which texture and disparities fitted together scatter as predicted: before walls
1.03 times at 1.6, 1.00 at 1.8 and 1.28 at 2.1 for the paper's bench, .95 over all scenes for a borescope at 2.08; 1.5
times at 1.6 for a hexagonal array, of which too little was measured."""


def plane_at(c: Camera, at: Depth | Array) -> ImagedPlane:
    """Plane `at` [mm] ahead of the bore's tip, or the focal plane."""
    return c.focus if at is None else c.plane_ahead(at)


def depth_at(c: Camera, at: Depth | Array) -> Array:
    """Z_F of a point `at` [mm] ahead of the bore's tip, or of the focal plane, as the main lens sees it [mm]."""
    return c.seen.gap if at is None else np.asarray(plane_at(c, at).distance - c.seen.d_3)


def seen_at(c: Camera, at: Depth | Array) -> Seen:
    """A plane `at` [mm] ahead of the bore's tip, or the focal plane."""
    focus = np.zeros(()) if at is None else light_field.rim_disparity(c, depth_at(c, at))
    return Seen(focus, light.object_scale(c, at), at)


def depth_error(c: Camera, at: Depth | Array, sigma: Number | None = None, beside: Beside = NOTHING) -> Array:
    """Standard error of depth on the axis, `at` [mm] ahead of the bore's tip or at the focal plane [mm].

    Of noise alone, or of what pixels have `beside` too. The disparity's, which takes milliseconds to predict, may be
    given [microlens pitches].
    """
    sigma = axial_disparity_sigma(c, seen_at(c, at), beside) if sigma is None else np.asarray(sigma)
    return light_field.depth_sigma(c, depth_at(c, at), sigma) * plane_at(c, at).depth


def depth_error_at_fields(images: MicrolensImages) -> Number:
    """Standard error of depth at the focal plane, of each field's own microlens image, shape (fields, builds)."""
    return np.asarray(_errors_at_fields(images, (NOTHING,))[0])


def _errors_at_fields(images: MicrolensImages, besides: tuple[Beside, ...], at: Depth = None) -> Array:
    """`depth_error_at_fields` in each of several noises, or `at` a distance; shape (noises, fields, builds)."""
    c = images.camera
    error = disparity_sigmas(images, seen_at(c, at), besides)
    sigma = light_field.depth_sigma(c, depth_at(c, at), error) * plane_at(c, at).depth
    # Views set apart along the field's radius and across it tell of depth as much less as a mapping stretches slopes.
    along, across = light.field_stretch(c, np.hypot(images.microlens[0], images.microlens[1]))
    return sigma * np.sqrt(2 / (along**-2.0 + across**-2.0))


def depth_told(c: Camera, slope: ArrayLike) -> Array:
    """Distance before the main lens, with a ruler, of what moves by a slope [microlenses per px] from view to view.

    Eq. 12 solved for the depth: what lengths that are off make of the same pictures.
    """
    return np.asarray(c.plane_seen_at(c.seen.d_3 + light_field.depth_of_slope(c, slope)))


def _told_ahead(c: Camera, slope: ArrayLike) -> Array:
    """Distance ahead of the bore's tip that a picture is told as, as `depth_told` from the main lens."""
    return np.asarray(depth_told(c, slope) - c.tip)


def lengths_error(c: Camera, at: Depth | Array, covariance: LengthCovariance) -> Array:
    """Standard error that lengths known to a covariance put into depths ahead of the tip, alike in all pictures [mm].

    The tip is as far from the main lens as a build has it.
    """
    slope = light_field.epi_slope(c, depth_at(c, at))
    if np.ndim(slope) > len(c.shape):  # of one camera at many distances: those follow its builds
        return _finite(covariance.carried(c, lambda builds: np.moveaxis(_told_ahead(builds, slope[..., None]), -1, 0)))
    return _finite(covariance.carried(c, lambda builds: _told_ahead(builds, slope)))


def temperatures_met(c: Camera) -> tuple[Number, Number, Number] | None:
    """Coldest and warmest that a camera is used at, and the one that its lengths are known at [degrees C].

    Without a range it is used at its own temperature; lengths that nothing says where they are calibrated are known in
    the middle of the range. None where neither is given, or lengths are as measured.
    """
    ends = [c.numbers.get(place) for place in TEMPERATURES]
    if c.growth is None or all(end is None for end in ends):
        return None
    coldest, warmest = (c[TEMPERATURE] if end is None else end for end in ends[:2])
    return coldest, warmest, (coldest + warmest) / 2 if ends[2] is None else ends[2]


def temperature_error(c: Camera, at: Depth | Array, met: tuple[Number, Number, Number] | None = None) -> Array | None:
    """Standard uncertainty that temperatures put into depths that are told as where the camera is calibrated [mm].

    Root mean square, over the range, in which all temperatures are alike, of what lies between the depths ahead of the
    tip that the same picture has at T and at T_c: the shift itself where the range is one temperature. The tip moves
    with the housing. Infinite where a camera in the range has no depth for the picture. None as `temperatures_met`, in
    whose place `met` may stand, and where nothing says how the camera grows.
    """
    met = met or temperatures_met(c)
    if met is None or c.growth is None:
        return None
    coldest, warmest, known = met
    if c.growth.unknown and not (np.equal(coldest, warmest) & np.equal(warmest, known)).all():
        return None
    slope = light_field.epi_slope(c, depth_at(c, at))
    half = np.subtract(warmest, coldest) / 2
    met_at = np.stack(np.broadcast_arrays(known, *(coldest + half * (1 + node) for node in RANGE_NODES)))
    between = (1,) * (max(np.ndim(slope), len(c.shape)) - met_at.ndim + 1)
    warmed = c.replace({TEMPERATURE: met_at.reshape(met_at.shape[:1] + between + met_at.shape[1:])})
    with np.errstate(invalid="ignore"):
        told = depth_told(warmed, slope)
        told = np.where(told < 0, np.inf, told) - warmed.tip  # below 0 is beyond the infinitely far
        return _finite(np.sqrt(np.tensordot(RANGE_WEIGHTS, np.square(told[1:] - told[0]), 1)))


def overlap_error(c: Camera, at: Depth | Array = None) -> Array:
    """Infinite where images overlap so much that no depth is known `at` a distance, else 0 [mm].

    Behind ideal lenses texture and disparities are fitted together, to `MOST_FITTED`, unless light that adds up fills
    pixels where the texture is brighter by its rms; else views have to be told apart one by one. 0 where the design
    gives the disparity's error, which counts that.
    """
    if "depth.disparity_error" in c.numbers or not np.any(overlapping(c)):
        return np.zeros(())[()]
    bright = electrons(c, at) * lenses_in_pixel(c) * (1 + c["depth.contrast"] * math.sqrt(OCTAVES))
    fitted = ideal(c) & (fill_left(c) <= MOST_FITTED[c.layout]) & (bright <= c["sensor.full_well"])
    return np.where(overlapping(c) & ~fitted, np.inf, 0.0)[()]


def ideal(c: Camera) -> bool:
    """Whether first order holds from the scene on, so that views follow from the texture in closed form."""
    return not (getattr(c.lens, "prescribed", ()) or c.chain.elements)


def lenses_in_pixel(c: Camera) -> Array:
    """Microlenses whose light a pixel has, on average."""
    return np.asarray(math.pi / 4 * np.square(fill_left(c)) / PACKINGS[c.layout].rise)


def overlapping(c: Camera) -> NDArray[np.bool_]:
    """Where images overlap more than `MOST_FILL`."""
    return np.asarray(fill_left(c) > MOST_FILL[c.layout])


def fill_left(c: Camera) -> Array:
    """Image fill on the axis of what stops leave of the FAP, as a disc's of the same area; the FAP's if little."""
    whole = np.real(fill_factor(c))
    if not np.any(whole > MOST_FILL[c.layout]):
        return whole
    left = MicrolensImages(c, [(0.0, 0.0)]).shapes.kept_fraction[0].reshape(c.shape)
    return np.asarray(whole * np.sqrt(left))[()]


def expected_error(c: Camera, at: Depth | Array) -> Array:
    """Combined standard uncertainty of depth on the axis, but for that of the lengths [mm]."""
    noise, warmth = depth_error(c, at, beside=Beside.of(c)), temperature_error(c, at)
    return np.hypot(noise + overlap_error(c, at), 0.0 if warmth is None else warmth)


def errors_at_fields(images: MicrolensImages, at: Depth = None, *, bound: bool = True) -> tuple[Array, ...]:
    """`depth_error_at_fields`, where the `bound` is asked for, and the combined standard uncertainty, of one signal.

    At the focal plane, or `at` a distance ahead of the tip [mm].
    """
    warmth = temperature_error(images.camera, at)
    *noise, expected = _errors_at_fields(images, (*((NOTHING,) if bound else ()), Beside.of(images.camera)), at)
    return *noise, np.hypot(expected + overlap_error(images.camera, at), 0.0 if warmth is None else warmth)


def _finite(error: Array) -> Array:
    """Errors, infinite where there is nothing to derive."""
    return np.where(np.isnan(error), np.inf, error)[()]
