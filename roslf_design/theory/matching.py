"""f-number matching: whether the microlens images just fill the sensor.

Three rules, from exact to traditional, each told as two f-numbers that should agree or as the fill factor
(microlens-image diameter over pitch) that should be 1. A fill factor above 1 means overlapping images, below 1 unused
pixels. `roslf_design.theory.matched` solves the rules for one length.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio
from .aperture import effective_image_distance, inverse_aperture_constant
from .pupils import microlens_image_diameter, microlens_image_pitch


def microlens_f_number(sensor_distance: ArrayLike, microlens_pitch: ArrayLike) -> Array:
    """Working f-number of a microlens, the left side of Eqs. 8 and 9.

    Parameters
    ----------
    sensor_distance, microlens_pitch : array_like
        d_2 and d [mm].

    Returns
    -------
    ndarray
        ``d_2 / d``, broadcast; 0 at ``d_2 = 0``. Its inverse is `microlens_angle`.
    """
    d2, d = floats(sensor_distance, microlens_pitch)
    return ratio(d2, d)


def microlens_angle(sensor_distance: ArrayLike, microlens_pitch: ArrayLike) -> Array:
    """Angle that a microlens's share of the sensor subtends at the microlens.

    Parameters
    ----------
    sensor_distance, microlens_pitch : array_like
        d_2 and d [mm].

    Returns
    -------
    ndarray
        ``d / d_2`` [rad, paraxial], broadcast; inf at ``d_2 = 0`` (finite twin: `microlens_f_number`).
    """
    d2, d = floats(sensor_distance, microlens_pitch)
    return ratio(d, d2)


def pupil_f_number(
    pupil_diameter: ArrayLike, focal_length: ArrayLike, focal_plane_distance: ArrayLike, pupil_distance: ArrayLike
) -> Array:
    """Working f-number of the flexible angular plane at the microlens array, the right side of Eq. 8.

    Parameters
    ----------
    pupil_diameter : array_like
        D_F [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``d_1 / (D_F H)``, broadcast; 0 at ``d_3 = d_f``; inf at ``D_F = 0`` (finite twin: `pupil_angle`).
    """
    (de,) = floats(pupil_diameter)
    return ratio(effective_image_distance(focal_length, focal_plane_distance, pupil_distance), de)


def main_lens_f_number(lens_diameter: ArrayLike, mla_distance: ArrayLike) -> Array:
    """Working f-number of the whole main lens, the right side of Eq. 9.

    Parameters
    ----------
    lens_diameter, mla_distance : array_like
        D and d_1 [mm].

    Returns
    -------
    ndarray
        ``d_1 / D``, broadcast; inf only for an infinite d_1.
    """
    diameter, d1 = floats(lens_diameter, mla_distance)
    return ratio(d1, diameter)


def fill_factor(
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Microlens-image diameter over microlens-image pitch, exactly.

    Parameters
    ----------
    pupil_diameter, microlens_pitch, sensor_distance : array_like
        D_F, d and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``D_F d_2 / (d (A + d_2 (f - d_3)/f))``, broadcast; 1 where matched, 0 at ``D_F = 0`` and ``d_2 = 0``, finite at
        ``d_3 = d_f``; negative where the images' order is reversed, inf where their pitch vanishes (finite twin:
        `matching_mismatch`).

    Notes
    -----
    Eq. 7 says that it is 1. Eq. 7 as printed is this equality divided by ``d_f - d_3``.
    """
    de, d, d2 = floats(pupil_diameter, microlens_pitch, sensor_distance)
    reach = effective_image_distance(focal_length, focal_plane_distance, pupil_distance)
    f, d3 = floats(focal_length, pupil_distance)
    return ratio(de * d2, d * (reach + d2 * ((f - d3) / f)))


def approximate_fill_factor(
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Microlens-image diameter over the microlens's own pitch.

    Parameters
    ----------
    pupil_diameter, microlens_pitch, sensor_distance : array_like
        D_F, d and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``D_F H d_2 / (d d_1)``, broadcast; 1 where `microlens_f_number` equals `pupil_f_number`; inf at ``d_3 = d_f``
        (finite twin: the f-numbers).

    Notes
    -----
    Eq. 8 says that it is 1. It equals `fill_factor` when the system is telecentric.
    """
    (d,) = floats(microlens_pitch)
    triple = focal_length, focal_plane_distance, pupil_distance
    return microlens_image_diameter(pupil_diameter, sensor_distance, *triple) / d


def traditional_fill_factor(
    lens_diameter: ArrayLike, microlens_pitch: ArrayLike, sensor_distance: ArrayLike, mla_distance: ArrayLike
) -> Array:
    """Fill factor of a traditional light-field camera, whose angular plane is the main lens itself.

    Parameters
    ----------
    lens_diameter, microlens_pitch, sensor_distance, mla_distance : array_like
        D, d, d_2 and d_1 [mm].

    Returns
    -------
    ndarray
        ``D d_2 / (d d_1)``, broadcast; 1 where `microlens_f_number` equals `main_lens_f_number`.

    Notes
    -----
    Eq. 9 says that it is 1.
    """
    diameter, d, d2, d1 = floats(lens_diameter, microlens_pitch, sensor_distance, mla_distance)
    return (diameter / d1) * (d2 / d)


def matching_mismatch(
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Microlens-image diameter minus pitch, in pixels.

    Parameters
    ----------
    pupil_diameter, microlens_pitch, pixel_pitch, sensor_distance : array_like
        D_F, d, q and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``(D_F H d_2/d_1 - d (1 + d_2/L)) / q`` [px], broadcast; positive: overlap, negative: unused pixels; inf at
        ``d_3 = d_f`` (finite twin: `fill_factor`).

    Notes
    -----
    Eq. 7 says that it is 0.
    """
    (q,) = floats(pixel_pitch)
    triple = focal_length, focal_plane_distance, pupil_distance
    diameter = microlens_image_diameter(pupil_diameter, sensor_distance, *triple)
    return (diameter - microlens_image_pitch(microlens_pitch, sensor_distance, *triple)) / q


def matching_residual(
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    mla_distance: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Left minus right side of the exact matching condition, cleared of the gap that Eq. 7 divides by.

    Parameters
    ----------
    pupil_diameter, microlens_pitch, sensor_distance, mla_distance : array_like
        D_F, d, d_2 and d_1 [mm].
    focal_plane_distance, pupil_distance : array_like
        d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``D_F/d + d_3/d_1 - (1/H)(1 + d_1/d_2)``, broadcast; 0 where matched, positive for overlap; finite at
        ``d_3 = d_f``; -inf at ``d_2 = 0`` (finite twin: `fill_factor`).

    Notes
    -----
    Eq. 7 times ``d_f - d_3``: smooth in every length, which makes it the constraint to hand to an optimiser.
    """
    de, d, d2, d1, d3 = floats(pupil_diameter, microlens_pitch, sensor_distance, mla_distance, pupil_distance)
    share = inverse_aperture_constant(focal_plane_distance, pupil_distance)
    return de / d + d3 / d1 - product(share, 1 + ratio(d1, d2))
