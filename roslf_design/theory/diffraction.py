"""Diffraction and defocus of a microlens: how far wave optics lets a microlens image be sharp.

One number rules, the microlens's Fresnel number ``N_F = d^2/(4 lambda d_2)``: the image is shadow-sharp for N_F >> 1
and has 4 N_F independent views per axis whatever the pixel count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio

AIRY = 1.22
"""First zero of the Airy pattern over lambda times f-number, to the three digits that the field quotes."""


def fresnel_number(microlens_pitch: ArrayLike, sensor_distance: ArrayLike, wavelength: ArrayLike) -> Array:
    """Fresnel number of a microlens seen from the sensor.

    Parameters
    ----------
    microlens_pitch, sensor_distance, wavelength : array_like
        d, d_2 and lambda [mm].

    Returns
    -------
    ndarray
        ``d^2 / (4 lambda d_2)``, broadcast; inf at ``d_2 = 0`` (finite twin: `diffraction_width`, 0 there).
    """
    d, d2, wave = floats(microlens_pitch, sensor_distance, wavelength)
    return ratio(d, wave) * ratio(d, 4 * d2)


def diffraction_width(microlens_pitch: ArrayLike, sensor_distance: ArrayLike, wavelength: ArrayLike) -> Array:
    """Width of the blur that a microlens's own aperture makes on the sensor.

    Parameters
    ----------
    microlens_pitch, sensor_distance, wavelength : array_like
        d, d_2 and lambda [mm].

    Returns
    -------
    ndarray
        ``lambda d_2 / d`` [mm], broadcast; 0 at ``d_2 = 0``.
    """
    d, d2, wave = floats(microlens_pitch, sensor_distance, wavelength)
    return wave * ratio(d2, d)


def airy_radius(microlens_pitch: ArrayLike, sensor_distance: ArrayLike, wavelength: ArrayLike) -> Array:
    """Airy radius on the sensor of a microlens of diameter d, parameters as for `diffraction_width`.

    Returns
    -------
    ndarray
        ``1.22 lambda d_2 / d`` [mm], broadcast.
    """
    return AIRY * diffraction_width(microlens_pitch, sensor_distance, wavelength)


def pupil_airy_radius(pupil_diameter: ArrayLike, effective_image_distance: ArrayLike, wavelength: ArrayLike) -> Array:
    """Airy radius on the microlens array of the flexible angular plane's own aperture.

    Parameters
    ----------
    pupil_diameter, effective_image_distance, wavelength : array_like
        D_F, A = d_1/H and lambda [mm].

    Returns
    -------
    ndarray
        ``1.22 lambda d_1 / (D_F H)`` [mm], broadcast; inf at ``D_F = 0`` (finite twin: `pupil_angle`).
    """
    de, reach, wave = floats(pupil_diameter, effective_image_distance, wavelength)
    return AIRY * wave * ratio(reach, de)


def microlens_defocus_waves(
    microlens_focal_length: ArrayLike,
    sensor_distance: ArrayLike,
    exit_pupil_vergence: ArrayLike,
    microlens_pitch: ArrayLike,
    wavelength: ArrayLike,
) -> Array:
    """Defocus of the exit pupil's image at the edge of a microlens.

    Parameters
    ----------
    microlens_focal_length, sensor_distance : array_like
        f_ml, inf for pinholes without power, and d_2 [mm].
    exit_pupil_vergence : array_like
        1/L [1/mm], as `roslf_design.theory.exit_pupil_vergence` gives it.
    microlens_pitch, wavelength : array_like
        d and lambda [mm].

    Returns
    -------
    ndarray
        ``|1/f_ml - 1/d_2 - 1/L| d^2 / (8 lambda)`` [waves], broadcast; inf at ``d_2 = 0`` (finite twin:
        `microlens_defocus_blur`) and where 1/L is.
    """
    fm, d2, vergence, d, wave = floats(
        microlens_focal_length, sensor_distance, exit_pupil_vergence, microlens_pitch, wavelength
    )
    with np.errstate(invalid="ignore"):
        error = np.abs(ratio(ratio(fm - d2, fm), d2) + vergence)
    if np.isinf(vergence).any():  # opposite infinities: the sensor on the microlenses, and the exit pupil as well
        error = np.where(np.isinf(vergence), np.inf, error)[()]
    return error * (d / wave * (d / 8))


def microlens_defocus_blur(
    microlens_focal_length: ArrayLike,
    sensor_distance: ArrayLike,
    exit_pupil_vergence: ArrayLike,
    microlens_pitch: ArrayLike,
) -> Array:
    """Width of the geometric blur by defocus of a microlens, parameters as for `microlens_defocus_waves`.

    Returns
    -------
    ndarray
        ``d d_2 |1/f_ml - 1/d_2 - 1/L|`` [mm], broadcast; d at ``d_2 = 0``; inf where 1/L is.
    """
    fm, d2, vergence, d = floats(microlens_focal_length, sensor_distance, exit_pupil_vergence, microlens_pitch)
    return d * np.abs(ratio(fm - d2, fm) + product(d2, vergence))
