"""Depth: what disparity between the pupil's rims a distance makes, and how well a measured disparity tells it.

Depth Z_F = Z - d_3 is measured from the flexible angular plane (FAP), the focal plane at ``Z_F = g = d_f - d_3``.
Disparities are in microlens pitches, and positive for points nearer than the focal plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio
from .aperture import effective_image_distance
from .epi import pupil_shear


def rim_disparity(
    depth: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Disparity of a scene point between the views from opposite rims of the FAP.

    Parameters
    ----------
    depth : array_like
        Z_F, from the FAP to the scene point [mm]; may be inf.
    pupil_diameter, microlens_pitch : array_like
        D_F and d [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``B = (D_F d_1/(d H)) (1/Z_F - 1/g)`` [microlens pitches], broadcast; exactly 0 on the focal plane; inf at
        ``Z_F = 0`` unless ``D_F = 0`` (finite twin: `inverse_depth_sigma`).
    """
    de, d = floats(pupil_diameter, microlens_pitch)
    return product(-de / d, pupil_shear(depth, focal_length, focal_plane_distance, pupil_distance))


def defocus_blur(
    depth: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Diameter of the blur that a scene point makes on the microlens array, parameters as for `rim_disparity`.

    Returns
    -------
    ndarray
        ``(D_F d_1/d) |1/(H Z_F) - 1/d_f|`` [microlens pitches], broadcast; inf at ``Z_F = 0`` unless ``D_F = 0``
        (finite twin: `inverse_depth_sigma`).
    """
    triple = focal_length, focal_plane_distance, pupil_distance
    return np.abs(rim_disparity(depth, pupil_diameter, microlens_pitch, *triple))


def disparity_rate(
    depth: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Change of the rim disparity per millimetre of depth, as a positive number; parameters as for `rim_disparity`.

    Returns
    -------
    ndarray
        ``D_F d_1 / (d H Z_F^2)`` [microlens pitches per mm], broadcast; at the focal plane with ``depth = gap``; 0 at
        ``Z_F = inf``; inf at ``Z_F = 0`` unless ``D_F = 0`` (finite twin: `depth_sigma`, 0 there).
    """
    z, de, d = floats(depth, pupil_diameter, microlens_pitch)
    reach = effective_image_distance(focal_length, focal_plane_distance, pupil_distance)
    return product(de / d, ratio(ratio(reach, z), z))


def depth_sigma(
    disparity_sigma: ArrayLike,
    depth: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Standard deviation of depth from that of the rim disparity, to first order.

    Parameters
    ----------
    disparity_sigma : array_like
        sigma_B [microlens pitches].
    depth, pupil_diameter, microlens_pitch : array_like
        Z_F, D_F and d [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``Z_F^2 d H sigma_B / (D_F d_1)`` [mm], broadcast; inf at ``Z_F = inf`` (finite twin: `inverse_depth_sigma`),
        ``D_F = 0`` and ``d_3 = d_f`` (finite twin: `disparity_rate`, 0 there).
    """
    sigma, z, de, d = floats(disparity_sigma, depth, pupil_diameter, microlens_pitch)
    reach = effective_image_distance(focal_length, focal_plane_distance, pupil_distance)
    return product(ratio(product(sigma * d, z), product(de, reach)), z)


def inverse_depth_sigma(
    disparity_sigma: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Standard deviation of inverse depth 1/Z_F, the same at every depth; parameters as for `depth_sigma`.

    Returns
    -------
    ndarray
        ``d H sigma_B / (D_F d_1)`` [1/mm], broadcast; inf at ``D_F = 0`` and ``d_3 = d_f`` (finite twin:
        `disparity_rate`, 0 there).
    """
    sigma, de, d = floats(disparity_sigma, pupil_diameter, microlens_pitch)
    reach = effective_image_distance(focal_length, focal_plane_distance, pupil_distance)
    return ratio(sigma * d, product(de, reach))
