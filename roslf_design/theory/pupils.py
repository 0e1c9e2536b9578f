"""Pupils and what the microlenses make of them: exit pupil, telecentricity, microlens-image pitch and diameter.

The flexible angular plane (FAP) is the system's aperture stop and, having no lens before it, its own entrance pupil:
diameter D_F, d_3 before the main lens. The exit pupil is its image by the main lens. Every microlens images the exit
pupil, which stands L before the array; at ``d_3 = f`` it is at infinity, and only the vergence 1/L stays finite.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import Array, floats, product, ratio
from .aperture import pupil_angle


def exit_pupil_distance(focal_length: ArrayLike, pupil_distance: ArrayLike) -> Array:
    """Position z_x of the exit pupil, behind the main lens.

    Parameters
    ----------
    focal_length, pupil_distance : array_like
        f and d_3 [mm].

    Returns
    -------
    ndarray
        ``f d_3 / (d_3 - f)`` [mm], broadcast; negative (virtual, object side) for ``d_3 < f``, inf at ``d_3 = f``
        (finite twin: `exit_pupil_vergence`, 0 there).
    """
    f, d3 = floats(focal_length, pupil_distance)
    return f * ratio(d3, d3 - f)


def exit_pupil_vergence(focal_length: ArrayLike, focal_plane_distance: ArrayLike, pupil_distance: ArrayLike) -> Array:
    """Vergence 1/L of the exit pupil at the microlens array, L = d_1 - z_x.

    Parameters
    ----------
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``(f - d_3)(d_f - f) / (f^2 (d_f - d_3))`` [1/mm], broadcast. Exactly 0 at ``d_3 = f`` (telecentric), 1/d_1 at
        ``d_3 = 0``; positive for a pupil before the array. inf at ``d_3 = d_f``, where the exit pupil lies on the
        array (finite twin: `exit_pupil_distance`, d_1 there).

    Notes
    -----
    The same as ``(d_3 - f) / (d_1 (d_3 - f) - f d_3)``, factored into differences of given lengths.
    """
    f, df, d3 = floats(focal_length, focal_plane_distance, pupil_distance)
    return product((f - d3) / f, ratio(df - f, df - d3)) / f


def exit_pupil_diameter(pupil_diameter: ArrayLike, focal_length: ArrayLike, pupil_distance: ArrayLike) -> Array:
    """Diameter of the exit pupil.

    Parameters
    ----------
    pupil_diameter, focal_length, pupil_distance : array_like
        D_F, f and d_3 [mm].

    Returns
    -------
    ndarray
        ``D_F f / |d_3 - f|`` [mm], broadcast; inf at ``d_3 = f`` unless ``D_F = 0`` (finite twin: `pupil_angle`).
    """
    de, f, d3 = floats(pupil_diameter, focal_length, pupil_distance)
    return product(de, ratio(f, np.abs(d3 - f)))


def is_telecentric(focal_length: ArrayLike, pupil_distance: ArrayLike, tolerance: float = 1e-9) -> NDArray[np.bool_]:
    """Whether the exit pupil is at infinity: FAP in the front focal plane.

    Parameters
    ----------
    focal_length, pupil_distance : array_like
        f and d_3 [mm].
    tolerance : float
        Largest ``|d_3 - f| / f`` that still counts.

    Returns
    -------
    ndarray of bool
        Broadcast.
    """
    f, d3 = floats(focal_length, pupil_distance)
    return np.abs(d3 - f) <= tolerance * f


def microlens_image_pitch(
    microlens_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Distance between neighbouring microlens images' centres on the sensor.

    Parameters
    ----------
    microlens_pitch, sensor_distance : array_like
        d and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``d (1 + d_2/L)`` [mm], broadcast; exactly d at ``d_3 = f`` and at ``d_2 = 0``, ``d (1 + d_2/d_1)`` at
        ``d_3 = 0``; negative where the exit pupil lies between array and sensor (images in reversed order); -inf at
        ``d_3 = d_f`` (finite twin: `inverse_aperture_constant`).
    """
    d, d2 = floats(microlens_pitch, sensor_distance)
    return d * (1 + product(d2, exit_pupil_vergence(focal_length, focal_plane_distance, pupil_distance)))


def microlens_image_diameter(
    pupil_diameter: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Diameter of an undistorted, geometric microlens image: the FAP through a pinhole microlens.

    Parameters
    ----------
    pupil_diameter, sensor_distance : array_like
        D_F and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``D_F H d_2 / d_1`` [mm], broadcast; inf at ``d_3 = d_f`` unless ``D_F`` or ``d_2`` is 0 (finite twin:
        `inverse_aperture_constant`).
    """
    (d2,) = floats(sensor_distance)
    return product(d2, pupil_angle(pupil_diameter, focal_length, focal_plane_distance, pupil_distance))


def centre_shift_per_microlens(
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Shift of a microlens image's centre against the traditional light field, per microlens off axis.

    Parameters
    ----------
    microlens_pitch, pixel_pitch, sensor_distance : array_like
        d, q and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``d d_2 d_3 d_f / (q d_1^2 (d_f - d_3))`` [pixels per microlens], broadcast; positive towards the axis, 0 at
        ``d_3 = 0`` and ``d_2 = 0``, inf at ``d_3 = d_f`` (finite twin: `inverse_aperture_constant`).

    Notes
    -----
    Eq. 4 per unit of the *microlens index*; the paper calls that index a photosensor coordinate, which is off by q/d.
    """
    d, q, d2, f, df, d3 = floats(
        microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
    )
    reach = ratio(df - f, df - d3)  # H/d_1^2 = (d_f - f)^2 / (f^2 d_f (d_f - d_3)): no d_1, which runs off at d_f = f
    return product(d * d2 * d3 / (q * f * f), ratio(df - f, df) * reach)
