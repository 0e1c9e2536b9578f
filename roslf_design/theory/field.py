"""Non-distortion field of view: how far off axis a microlens still sees the whole pupil.

The pencil of a field point that fills the flexible angular plane (FAP) covers a disc on the main lens; the microlens
image is undistorted ("full", not a cat's eye) while that disc lies inside the lens.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio
from .aperture import effective_image_distance


class FieldBound(NamedTuple):
    """Largest undistorted field radius, object side and microlens-array side."""

    object_radius: Array
    """Radius on the plane at `distance` [mm]; inf where no field is too large, 0 where even the axis is clipped."""
    mla_radius: Array
    """Where its chief ray meets the microlens array [mm]; finite also for an infinite `distance`."""


def nondistortion_margin(
    lens_diameter: ArrayLike,
    pupil_diameter: ArrayLike,
    pupil_distance: ArrayLike,
    distance: ArrayLike,
    radius: ArrayLike,
    weight: ArrayLike = 1.0,
) -> Array:
    """Signed room left inside the main lens for the whole pencil of a field point.

    The pencil covers, on the main lens, a disc of radius ``(D_F Z / 2 + |X| d_3) / (Z - d_3)`` about the axis. The
    margin is that inequality cleared of its denominators, so it stays finite and exact at ``d_3 = 0`` where Eq. 6
    divides by zero.

    Parameters
    ----------
    lens_diameter, pupil_diameter : array_like
        D and D_F [mm].
    pupil_distance : array_like
        d_3, FAP to main lens [mm].
    distance : array_like
        Z, object plane to main lens [mm]; ``Z > d_3``, finite.
    radius : array_like
        X, distance of the field point from the axis [mm], of either sign. A half-field, not a full one.
    weight : array_like
        Homogeneous weight W of the field point ``(X/W, Z/W)``. A point at infinity has ``weight=0, distance=1`` and the
        tangent of its field angle as `radius`; the margin is then in mm.

    Returns
    -------
    ndarray
        ``D (Z - W d_3) - D_F Z - 2 |X| d_3`` [mm^2], broadcast; the microlens image is undistorted where it is >= 0.

    Raises
    ------
    ValueError
        `distance` is not finite.

    Notes
    -----
    Eqs. 5-6, with d_f replaced by any object distance Z.
    """
    lens, de, d3, z, x, w = floats(lens_diameter, pupil_diameter, pupil_distance, distance, radius, weight)
    require_finite(z)
    margin: Array = (lens - de) * z - (w * lens + 2 * np.abs(x)) * d3
    return margin


def nondistortion_bound(
    lens_diameter: ArrayLike,
    pupil_diameter: ArrayLike,
    pupil_distance: ArrayLike,
    distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
) -> FieldBound:
    """Field radius at which `nondistortion_margin` reaches zero.

    Parameters
    ----------
    lens_diameter, pupil_diameter, pupil_distance : array_like
        D, D_F and d_3 [mm].
    distance : array_like
        Z, object plane to main lens [mm]; ``Z > d_3``, may be inf. The paper's bound is at ``Z = d_f``.
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.

    Returns
    -------
    FieldBound
        ``|X| = (D (Z - d_3) - D_F Z) / (2 d_3)`` and ``|A X / (Z - d_3)|`` [mm], broadcast. Both inf at ``d_3 = 0``
        with ``D >= D_F`` (finite twin: the margin); the first inf at ``Z = inf`` (finite twin: the second).

    Notes
    -----
    Eq. 6. Off the focal plane a point's pencil spreads over several microlenses; `mla_radius` follows its chief ray.
    """
    lens, de, d3, z = floats(lens_diameter, pupil_diameter, pupil_distance, distance)
    depth = z - d3
    axial = lens * ratio(depth, z) - de
    clear = axial >= 0
    slope = np.where(clear, ratio(axial, 2 * d3), 0.0)
    slope = np.where(clear & (d3 == 0), np.inf, slope)
    reach = effective_image_distance(focal_length, focal_plane_distance, d3)
    return FieldBound(product(slope, z), product(slope, np.abs(reach * ratio(z, depth))))


def require_finite(distance: Array) -> None:
    """Refuse an infinite object distance where a homogeneous point is the way to say it."""
    if not np.isfinite(distance).all():
        raise ValueError(
            f"distance must be finite, got {float(np.ravel(distance[~np.isfinite(distance)])[0])}: for a field point "
            "at infinity pass weight=0, distance=1 and the tangent of its field angle"
        )
