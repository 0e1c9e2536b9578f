"""Designs that match: Eqs. 7 and 8 solved for one length, the others held.

Each rule is linear in each of the four lengths, so there is one solution or none. Where there is none (the length
would have to be zero, negative, infinite, or put the flexible angular plane behind the lens or beyond the focal
plane) `exists` is False and the value is inf, which no later formula mistakes for a length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import Array, floats, ratio
from .aperture import effective_image_distance


class Matched(NamedTuple):
    """One length that makes the f-numbers match."""

    value: Array
    """The length [mm]; inf where there is none."""
    exists: NDArray[np.bool_]
    """Whether there is one."""


def matched_sensor_distance(
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
    exact: bool = True,
) -> Matched:
    """Sensor distance d_2 at which the microlens images just touch.

    Parameters
    ----------
    pupil_diameter, microlens_pitch : array_like
        D_F and d [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.
    exact : bool
        Eq. 7 (True) or its approximation Eq. 8 (False).

    Returns
    -------
    Matched
        ``d_2 = A / (D_F/d - (f - d_3)/f)`` [mm], broadcast; Eq. 8 leaves out the second term. None where the pupil is
        so small that images never grow to their pitch, and at ``D_F = 0`` and ``d_3 = d_f``.
    """
    de, d, f, d3 = floats(pupil_diameter, microlens_pitch, focal_length, pupil_distance)
    growth = de / d - (f - d3) / f if exact else de / d
    return _matched(ratio(effective_image_distance(f, focal_plane_distance, d3), growth), de > 0)


def matched_pupil_diameter(
    microlens_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
    exact: bool = True,
) -> Matched:
    """Pupil diameter D_F at which the microlens images just touch.

    Parameters
    ----------
    microlens_pitch, sensor_distance : array_like
        d and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.
    exact : bool
        Eq. 7 (True) or its approximation Eq. 8 (False).

    Returns
    -------
    Matched
        ``D_F = d (A/d_2 + (f - d_3)/f)`` [mm], broadcast; Eq. 8 leaves out the second term. None at ``d_2 = 0`` and
        where the exit pupil lies between array and sensor.
    """
    d, d2, f, d3 = floats(microlens_pitch, sensor_distance, focal_length, pupil_distance)
    reach = ratio(effective_image_distance(f, focal_plane_distance, d3), d2)
    return _matched(d * (reach + (f - d3) / f if exact else reach))


def matched_microlens_pitch(
    pupil_diameter: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
    exact: bool = True,
) -> Matched:
    """Microlens pitch d at which the microlens images just touch.

    Parameters
    ----------
    pupil_diameter, sensor_distance : array_like
        D_F and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.
    exact : bool
        Eq. 7 (True) or its approximation Eq. 8 (False).

    Returns
    -------
    Matched
        ``d = D_F d_2 / (A + d_2 (f - d_3)/f)`` [mm], broadcast; Eq. 8 leaves out the second term. None at ``D_F = 0``,
        at ``d_2 = 0`` and where the exit pupil lies between array and sensor.
    """
    de, d2, f, d3 = floats(pupil_diameter, sensor_distance, focal_length, pupil_distance)
    reach = effective_image_distance(f, focal_plane_distance, d3)
    return _matched(ratio(de * d2, reach + d2 * ((f - d3) / f) if exact else reach))


def matched_pupil_distance(
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    exact: bool = True,
) -> Matched:
    """Distance d_3 of the flexible angular plane at which the microlens images just touch.

    Parameters
    ----------
    pupil_diameter, microlens_pitch, sensor_distance : array_like
        D_F, d and d_2 [mm].
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.
    exact : bool
        Eq. 7 (True) or its approximation Eq. 8 (False).

    Returns
    -------
    Matched
        ``d_3 = (d_1 + d_2 - D_F d_2/d) / (m + d_2/f)`` [mm], broadcast; Eq. 8: ``(d_1 - D_F d_2/d) / m``. None where it
        lies behind the lens (``d_3 < 0``: the pupil is too large to match even at the lens) or not before the focal
        plane (in float64), and where there is no image (``D_F = 0`` or ``d_2 = 0``). Eq. 8 holds for all d_3 or none at
        ``d_f = inf``: told as none.
    """
    de, d, d2, f, df = floats(pupil_diameter, microlens_pitch, sensor_distance, focal_length, focal_plane_distance)
    share, nearness = ratio(df - f, df), f / df
    exists = (de > 0) & (d2 > 0)
    if exact:
        distance = ratio(f + d2 * (1 - de / d) * share, nearness + d2 / f * share)
    else:
        distance = ratio(f - de * (d2 / d) * share, nearness)
        exists = exists & np.isfinite(df)
    exists = exists & (distance >= 0) & (distance < df)
    return Matched(np.where(exists, distance, np.inf)[()], exists)


def _matched(length: Array, image: NDArray[np.bool_] | bool = True) -> Matched:
    exists = image & (length > 0) & np.isfinite(length)
    return Matched(np.where(exists, length, np.inf)[()], exists)
