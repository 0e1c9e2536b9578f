"""Any number of circular stops, decentred or not: their discs on the sensor, and the room they leave the pupil.

Seen through a pinhole microlens in focus, each stop before the microlens array is a disc on the sensor; the microlens
image is the intersection of these discs. Stops lie at distances z_k before the main lens (the lens itself at 0, the
flexible angular plane, FAP, at d_3). With one stop (the lens) the margin is that of Eq. 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, product
from .aperture import pupil_angle
from .field import require_finite


class StopDisc(NamedTuple):
    """Image of a stop on the sensor, through one microlens."""

    radius: Array
    """[mm]."""
    centre: Array
    """x, y on the sensor [mm], relative to the optical axis, shape (..., 2)."""


def stop_margin(
    stop_diameter: ArrayLike,
    stop_distance: ArrayLike,
    pupil_diameter: ArrayLike,
    pupil_distance: ArrayLike,
    distance: ArrayLike,
    point: ArrayLike,
    stop_decentre: ArrayLike = (0.0, 0.0),
    pupil_decentre: ArrayLike = (0.0, 0.0),
    weight: ArrayLike = 1.0,
) -> Array:
    """Signed room left inside a stop for the whole pencil of a field point that fills the pupil.

    Parameters
    ----------
    stop_diameter, stop_distance : array_like
        D_k and z_k [mm].
    pupil_diameter, pupil_distance : array_like
        D_F and d_3 [mm].
    distance : array_like
        Z, object plane to main lens [mm]; beyond pupil and stop, finite.
    point : array_like, shape (..., 2)
        Field point X on that plane [mm]. The microlens at c looks at ``X = -c d_f/d_1``, ``Z = d_f``.
    stop_decentre, pupil_decentre : array_like, shape (..., 2)
        e_k and e_F [mm].
    weight : array_like
        Homogeneous weight W of the field point ``(X/W, Z/W)``. A point at infinity has ``weight=0, distance=1`` and the
        tangents of its field angles as `point`; the margin is then in mm.

    Returns
    -------
    ndarray
        ``D_k (Z - W d_3) - D_F (Z - W z_k) - 2 |X (d_3 - z_k) + e_k (Z - W d_3) - e_F (Z - W z_k)|`` [mm^2], broadcast
        over the leading axes; the stop takes nothing where it is >= 0. Over `Z - d_3` it is the room in diameter at the
        stop [mm].

    Raises
    ------
    ValueError
        `distance` is not finite.

    Notes
    -----
    Generalises Eq. 6, whose stop is the main lens: ``z_k = 0``, ``D_k = D``.
    """
    dk, zk, de, d3 = floats(stop_diameter, stop_distance, pupil_diameter, pupil_distance)
    z, w, x, ek, ef = floats(distance, weight, point, stop_decentre, pupil_decentre)
    require_finite(z)
    beyond_pupil, beyond_stop = z - w * d3, z - w * zk
    between = d3 - zk
    off = [x[..., i] * between + ek[..., i] * beyond_pupil - ef[..., i] * beyond_stop for i in (0, 1)]
    margin: Array = dk * beyond_pupil - de * beyond_stop - 2 * np.hypot(*off)
    return margin


def stop_disc(
    stop_diameter: ArrayLike,
    stop_distance: ArrayLike,
    microlens_centre: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    stop_decentre: ArrayLike = (0.0, 0.0),
) -> StopDisc:
    """Disc that a stop casts on the sensor through a pinhole microlens.

    Parameters
    ----------
    stop_diameter, stop_distance : array_like
        D_k and z_k [mm], shape (...).
    microlens_centre : array_like, shape (..., 2)
        c, the microlens's axis on the array [mm].
    sensor_distance : array_like
        d_2 [mm].
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.
    stop_decentre : array_like, shape (..., 2)
        e_k [mm].

    Returns
    -------
    StopDisc
        With ``h = d_f / (d_f - z_k)``: radius ``(D_k/2) h d_2/d_1`` and centre ``c (1 + d_2/L_k) - e_k h d_2/d_1``,
        where ``1/L_k = 1/d_1 - h z_k/d_1^2`` is the vergence of the stop's image at the array; broadcast. inf at
        ``z_k = d_f``, where the stop's edge is in focus on the array.

    Notes
    -----
    For the FAP (``z_k = d_3``) the diameter is that of Eqs. 2-3 and the centre that of Eq. 4.
    """
    dk, zk, d2, c, ek = floats(stop_diameter, stop_distance, sensor_distance, microlens_centre, stop_decentre)
    f, df = floats(focal_length, focal_plane_distance)
    scale = product(d2, pupil_angle(1.0, f, df, zk))
    bend = (f - zk) / f  # d_1/L_k over h: one factor for both terms, or they would be inf - inf at z_k = d_f
    centre = c + product(scale[..., None], c * bend[..., None] - ek)
    return StopDisc(product(dk / 2, scale), centre)
