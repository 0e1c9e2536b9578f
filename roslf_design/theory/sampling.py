"""Sampling: how many views and how many lateral samples a design has, and how many light allows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio
from .conjugates import inverse_magnification
from .diffraction import fresnel_number
from .pupils import microlens_image_diameter


def geometric_views(
    pupil_diameter: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Pixels across an undistorted microlens image: the views per axis that ray optics promises.

    Parameters
    ----------
    pupil_diameter, pixel_pitch, sensor_distance : array_like
        D_F, q and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``D_F H d_2 / (d_1 q)`` [px], broadcast; inf at ``d_3 = d_f`` unless ``D_F`` or ``d_2`` is 0 (finite twin:
        `inverse_aperture_constant`).
    """
    (q,) = floats(pixel_pitch)
    diameter = microlens_image_diameter(
        pupil_diameter, sensor_distance, focal_length, focal_plane_distance, pupil_distance
    )
    return diameter / q


def independent_views(microlens_pitch: ArrayLike, sensor_distance: ArrayLike, wavelength: ArrayLike) -> Array:
    """Views per axis that diffraction leaves independent, whatever the pixel count.

    Parameters
    ----------
    microlens_pitch, sensor_distance, wavelength : array_like
        d, d_2 and lambda [mm].

    Returns
    -------
    ndarray
        ``4 N_F = d^2 / (lambda d_2)``, broadcast; inf at ``d_2 = 0`` (finite twin: `diffraction_width`).
    """
    return 4 * fresnel_number(microlens_pitch, sensor_distance, wavelength)


def lateral_samples(width: ArrayLike, microlens_pitch: ArrayLike) -> Array:
    """Lateral samples, one a microlens, across a width of the array; not rounded.

    Parameters
    ----------
    width, microlens_pitch : array_like
        Of the sensor (or of what it sees of the array), and d [mm].

    Returns
    -------
    ndarray
        ``width / d``, broadcast.
    """
    span, d = floats(width, microlens_pitch)
    return ratio(span, d)


def object_sample(microlens_pitch: ArrayLike, focal_length: ArrayLike, focal_plane_distance: ArrayLike) -> Array:
    """Footprint of one microlens on the focal plane: the lateral sampling step in the scene.

    Parameters
    ----------
    microlens_pitch, focal_length, focal_plane_distance : array_like
        d, f and d_f [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``d d_f / d_1`` [mm], broadcast; inf at ``d_f = inf`` (finite twin: `magnification`, 0 there).
    """
    (d,) = floats(microlens_pitch)
    return product(d, inverse_magnification(focal_length, focal_plane_distance))


def phase_space_limit(
    pupil_diameter: ArrayLike, field_radius: ArrayLike, depth: ArrayLike, wavelength: ArrayLike
) -> Array:
    """Most samples that light carries per axis through the pupil: lateral samples times independent views.

    Parameters
    ----------
    pupil_diameter : array_like
        D_F [mm].
    field_radius, depth : array_like
        Half the field |X| and its distance Z_F from the pupil [mm], not both 0; for a field at infinity the tangent of
        the half field angle and 1.
    wavelength : array_like
        lambda [mm].

    Returns
    -------
    ndarray
        ``2 D_F sin(theta) / lambda`` with ``tan(theta) = |X|/Z_F``, broadcast.

    Notes
    -----
    The rest of this package is paraxial and counts with tan(theta): a matched design that fills its field comes to
    ``2 D_F tan(theta)/lambda``, above this limit by 1/cos(theta) (0.7 % in the paper's system).
    """
    de, x, z, wave = floats(pupil_diameter, field_radius, depth, wavelength)
    return 2 * (de / wave) * np.abs(ratio(x, np.hypot(x, z)))
