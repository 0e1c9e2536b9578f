"""Diffraction, defocus and sampling: how sharp wave optics lets a microlens image be, how many samples it holds.

One number rules, the microlens's Fresnel number ``N_F = d^2/(4 lambda d_2)``: the image is shadow-sharp for N_F >> 1
and has 4 N_F independent views per axis whatever the pixel count.
"""

from __future__ import annotations

import numpy as np

from .._arrays import Array, product, ratio
from ..camera import Camera
from .exit_pupil import microlens_image_diameter

AIRY = 1.22
"""First zero of the Airy pattern over lambda times f-number, to the three digits that the field quotes."""


def fresnel_number(c: Camera) -> Array:
    """Fresnel number of a microlens seen from the sensor, ``d^2/(4 lambda d_2)``; inf at d_2 = 0."""
    return ratio(c.d, c.wavelength) * ratio(c.d, 4 * c.d_2)


def independent_views(c: Camera) -> Array:
    """Views per axis that diffraction leaves independent, 4 N_F, whatever the pixel count; inf at d_2 = 0."""
    return 4 * fresnel_number(c)


def geometric_views(c: Camera) -> Array:
    """Pixels across an uncut microlens image, the views per axis that ray optics promises; inf at d_3 = d_f."""
    return microlens_image_diameter(c) / c.q


def diffraction_width(c: Camera) -> Array:
    """Width ``lambda d_2/d`` of the blur that a microlens's own aperture makes on the sensor [mm]."""
    return c.wavelength * ratio(c.d_2, c.d)


def airy_radius(c: Camera) -> Array:
    """Airy radius on the sensor of a microlens of diameter d, ``1.22 lambda d_2/d`` [mm]."""
    return AIRY * diffraction_width(c)


def pupil_airy_radius(c: Camera) -> Array:
    """Airy radius on the microlens array of the FAP's own aperture, ``1.22 lambda A/D_F`` [mm]; inf at D_F = 0."""
    return AIRY * c.wavelength * ratio(c.A, c.D_F)


def microlens_defocus(c: Camera) -> Array:
    """``1 - d_2/f_ml + d_2/L``, signed: 0 where the microlenses image the exit pupil onto the sensor."""
    return ratio(c.f_ml - c.d_2, c.f_ml) + product(c.d_2, c.vergence)


def microlens_defocus_blur(c: Camera) -> Array:
    """Width of the ray blur by defocus of a microlens, ``d d_2 |1/f_ml - 1/d_2 - 1/L|`` [mm]; inf at d_3 = d_f."""
    return c.d * np.abs(microlens_defocus(c))


def microlens_defocus_waves(c: Camera) -> Array:
    """Wavefront error at the middle of a square microlens's edge [waves].

    ``(d^2/8 lambda) |1/f_ml - 1/d_2 - 1/L|``; inf at d_2 = 0 and at d_3 = d_f.
    """
    return ratio(np.abs(microlens_defocus(c)), c.d_2) * (c.d / c.wavelength * (c.d / 8))


def object_sample(c: Camera) -> Array:
    """Footprint ``d d_f/d_1`` of one microlens on the focal plane: the lateral sampling step [mm]; inf at d_f = inf."""
    return product(c.d, c.inverse_m)


def half_field(c: Camera) -> tuple[Array, Array]:
    """Half width and half height of the array that the sensor sees [mm], where array or sensor ends."""
    x, y = (
        np.asarray(np.minimum(array, sensor)) / 2 for array, sensor in zip(c.array_size, c.sensor_size, strict=True)
    )
    return x, y


def half_diagonal(c: Camera) -> Array:
    """From the axis to the corner of what the sensor sees, on the array [mm]."""
    x, y = half_field(c)
    return np.asarray(np.sqrt(x * x + y * y))  # complex numbers, too: derivatives


def lateral_samples(c: Camera) -> Array:
    """Microlenses across the width that the sensor sees; not rounded."""
    return ratio(2 * half_field(c)[0], c.d)


def view_baseline(c: Camera) -> Array:
    """Distance on the FAP between neighbouring pixels' views, ``q A/d_2 = q d_1/(H d_2)`` [mm]; inf at d_2 = 0."""
    return ratio(c.q * c.A, c.d_2)


def solid_angle(c: Camera) -> Array:
    """Solid angle of the pupil seen from the array, ``pi/4 (D_F/A)^2`` [sr]: the light a pixel gets."""
    return np.pi / 4 * ratio(c.D_F, c.A) ** 2
