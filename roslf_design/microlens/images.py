"""Where the stops' images lie behind a microlens, and the microlens images they leave."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..shapes.discs import DiscIntersection, intersect

Array = NDArray[np.float64]


def stop_images(
    axis: ArrayLike,
    diameter: ArrayLike,
    distance: ArrayLike,
    decentre: ArrayLike = (0.0, 0.0),
    *,
    focal_length: ArrayLike,
    focal_plane: ArrayLike,
    mla_distance: ArrayLike,
    sensor_distance: ArrayLike,
) -> tuple[Array, Array]:
    """Discs that the stops cut out of the light behind a pinhole microlens.

    The backward ray from sensor point p through the microlens at c crosses the plane of a stop at distance z where
    ``a = c (1 - z/f) - (p - c) d_1 / (h d_2)``, with ``h = d_f / (d_f - z)``; solved for p where ``|a - e|`` is
    the stop's radius, this is a disc of radius ``(D_k/2) h d_2/d_1`` about ``c + (h d_2/d_1)(c (1 - z/f) - e)``.

    Parameters
    ----------
    axis : array_like
        c, microlens axes on the MLA [mm], shape (..., 2).
    diameter, distance : array_like
        D_k and z_k of the K stops [mm], shape (..., K); z_k in front of the main lens: 0 is the main lens itself, a
        negative z_k means the object-side ray prolonged. Put the flexible angular plane (FAP) first.
    decentre : array_like
        e_k [mm], shape (..., K, 2) or (2,) for all.
    focal_length, focal_plane, mla_distance, sensor_distance : array_like
        f, d_f, d_1 and d_2 [mm], shape (...), with ``1/f = 1/d_f + 1/d_1``; d_f may be inf. All leading axes
        broadcast. Stops and microlenses are counted from the main lens's centre: subtract its decentre from both.

    Returns
    -------
    (centres, radii)
        Shapes (..., K, 2) and (..., K) [mm]; centres relative to the microlens axis c, where the digits are.

    Raises
    ------
    ValueError
        The object plane d_f within the bore: some z_k >= d_f.
    """
    f, d_f, d_1, d_2 = (_numbers(v) for v in (focal_length, focal_plane, mla_distance, sensor_distance))
    c, D, z, e = (np.asarray(v, float) for v in (axis, diameter, distance, decentre))
    if (z >= d_f).any():
        raise ValueError(
            f"stop at {z.max():g} mm is not in front of the object plane ({d_f.min():g} mm): the object is in the bore"
        )
    with np.errstate(invalid="ignore"):
        share = np.where(np.isinf(d_f), 1.0, (d_f - z) / d_f)
    scale = d_2 / (d_1 * share)
    centres = scale[..., None] * (c[..., None, :] * ((f - z) / f)[..., None] - e)
    return centres, np.broadcast_to(D / 2 * scale, centres.shape[:-1])


def microlens_images(
    axis: ArrayLike,
    diameter: ArrayLike,
    distance: ArrayLike,
    decentre: ArrayLike = (0.0, 0.0),
    *,
    focal_length: ArrayLike,
    focal_plane: ArrayLike,
    mla_distance: ArrayLike,
    sensor_distance: ArrayLike,
) -> DiscIntersection:
    """Shapes of the geometric microlens images, for any number of microlenses and trials at once.

    Parameters as `stop_images`, with the FAP first: `DiscIntersection.kept_fraction` counts from it, and centroids are
    relative to the microlens axis.
    """
    return intersect(
        *stop_images(
            axis,
            diameter,
            distance,
            decentre,
            focal_length=focal_length,
            focal_plane=focal_plane,
            mla_distance=mla_distance,
            sensor_distance=sensor_distance,
        )
    )


def _numbers(value: ArrayLike) -> Array:
    """One number a trial, with an axis for the stops."""
    return np.asarray(value, float)[..., None]
