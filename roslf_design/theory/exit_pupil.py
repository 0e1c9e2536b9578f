"""Exit pupil, the pupil as the sensor's side sees it, and pitch, diameter and shift of the microlens images.

The flexible angular plane (FAP) is the system's aperture stop and, having no lens before it, its own entrance pupil:
diameter D_F, d_3 before the main lens. The exit pupil is its image by the main lens. Every microlens images the exit
pupil, which stands L before the array; at ``d_3 = f`` it is at infinity, and only the vergence 1/L stays finite.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array, floats, product, ratio
from ..camera import Camera


def exit_pupil_distance(c: Camera) -> Array:
    """Position ``z_x = f d_3/(d_3 - f)`` of the exit pupil behind the main lens [mm].

    Negative (virtual, object side) for ``d_3 < f``, inf at ``d_3 = f`` (finite twin: `Camera.vergence`, 0 there).
    """
    return c.f * ratio(c.seen.d_3, c.seen.d_3 - c.f)


def exit_pupil_diameter(c: Camera) -> Array:
    """Diameter ``D_F f/|d_3 - f|`` of the exit pupil [mm]; inf at ``d_3 = f`` unless D_F is 0."""
    return product(c.seen.D_F, ratio(c.f, np.abs(c.seen.d_3 - c.f)))


def is_telecentric(c: Camera) -> NDArray[np.bool_]:
    """Whether the exit pupil is at infinity: ``|d_3 - f|`` at most 1e-9 of f."""
    return np.asarray(np.abs(c.seen.d_3 - c.f) <= 1e-9 * c.f)


def pupil_angle(c: Camera) -> Array:
    """Angular diameter of the pupil as every microlens sees it, D_F H/d_1 = D_F/A [rad, paraxial]; inf at d_3 = d_f."""
    return stop_angle(c, c.seen.d_3, c.seen.D_F)


def stop_angle(c: Camera, distance: ArrayLike, length: ArrayLike = 1.0) -> Array:
    """Angle under which a microlens sees a length at a distance before the main lens: ``length h/d_1`` [rad].

    With ``h = d_f/(d_f - z)`` it is ``length (d_f - f)/(f (d_f - z))``: one sensor distance d_2 behind the array the
    length is imaged d_2 times as large. inf at ``z = d_f``, where the length is in focus on the array.
    """
    size, z = floats(length, distance)
    return product(size / c.f, ratio(c.seen.d_f - c.f, c.seen.d_f - z))


def microlens_image_diameter(c: Camera) -> Array:
    """Diameter ``D_F H d_2/d_1`` of an uncut, geometric microlens image [mm]; inf at d_3 = d_f."""
    return product(c.seen.d_2, pupil_angle(c))


def microlens_image_pitch(c: Camera) -> Array:
    """Distance ``d (1 + d_2/L)`` between neighbouring microlens images' centres on the sensor [mm].

    Exactly d at ``d_3 = f``, ``d (1 + d_2/d_1)`` at ``d_3 = 0``; negative where the exit pupil lies between array and
    sensor (images in reversed order); -inf at ``d_3 = d_f``.
    """
    return c.d * (1 + product(c.seen.d_2, c.seen.vergence))


def centre_shift_per_microlens(c: Camera) -> Array:
    """Shift of an image's centre against the traditional light field, per microlens off axis [px]. Eq. 4.

    ``d d_2 d_3 d_f / (q d_1^2 (d_f - d_3))``; positive towards the axis. Per *microlens index*: the paper calls that
    index a photosensor coordinate, which is off by q/d. inf at ``d_3 = d_f``.
    """
    # H/d_1^2 = (d_f - f)^2 / (f^2 d_f (d_f - d_3)): no d_1, which runs off at d_f = f.
    reach = ratio(c.seen.d_f - c.f, c.seen.gap)
    return product(c.d * c.seen.d_2 * c.seen.d_3 / (c.q * c.f * c.f), ratio(c.seen.d_f - c.f, c.seen.d_f) * reach)


def centre_deviation(c: Camera, index: ArrayLike) -> Array:
    """Deviation of a microlens image's centre from where a traditional light field has it [px]; Eq. 4.

    Parameters
    ----------
    c : Camera
    index : array_like
        Microlens index ``x - x_0``, counted from the axis.

    Returns
    -------
    ndarray
        Broadcast; inf at ``d_3 = d_f``.
    """
    (x,) = floats(index)
    return product(x, centre_shift_per_microlens(c))
