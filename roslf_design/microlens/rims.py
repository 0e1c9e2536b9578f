"""Microlens images of tilted stops: the rims are seen in perspective, as ellipses rather than discs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .discs import DiscIntersection
from .ellipses import intersect_ellipses

Array = NDArray[np.float64]


def rim_maps(
    axis: ArrayLike,
    diameter: ArrayLike,
    distance: ArrayLike,
    decentre: ArrayLike,
    tilt: ArrayLike,
    *,
    focal_length: ArrayLike,
    focal_plane: ArrayLike,
    mla_distance: ArrayLike,
    sensor_distance: ArrayLike,
) -> Array:
    """Projective maps from the planes of the stops to the sensor, through the main lens and a pinhole microlens.

    A point of the stop's plane, in units of its radius, is ``(x, y, -z) = e + R (u, v, 0) D_k/2``; its own distance z
    puts its image at ``c + (h d_2/d_1)(c (1 - z/f) - (x, y))``, ``h = d_f/(d_f - z)``, which is linear over linear in
    (u, v).

    Parameters
    ----------
    axis : array_like
        c, microlens axes on the MLA [mm], shape (..., 2).
    diameter, distance : array_like
        D_k and z_k (of the centre) of the K stops [mm], shape (..., K).
    decentre, tilt : array_like
        e_k [mm] and (t_x, t_y) [rad], shape (..., K, 2) or (2,): the stop's normal is z turned by t_x about x, then by
        t_y about y.
    focal_length, focal_plane, mla_distance, sensor_distance : array_like
        f, d_f, d_1 and d_2 [mm], shape (...), with ``1/f = 1/d_f + 1/d_1``; d_f may be inf.

    Returns
    -------
    ndarray
        Shape (..., K, 3, 3): (u, v, 1) to homogeneous (x, y, w) [mm] on the sensor, relative to the microlens axis.

    Raises
    ------
    ValueError
        A diameter that is not positive; a rim that reaches the object plane d_f: the object is in the bore.
    """
    f, d_f, d_1, d_2 = (
        np.asarray(v, float)[..., None] for v in (focal_length, focal_plane, mla_distance, sensor_distance)
    )
    c = np.asarray(axis, float)[..., None, :]
    radius, z = np.asarray(diameter, float) / 2, np.asarray(distance, float)
    e, t = np.asarray(decentre, float), np.asarray(tilt, float)
    (sx, sy), (cx, cy) = np.moveaxis(np.sin(t), -1, 0), np.moveaxis(np.cos(t), -1, 0)
    zero = np.zeros_like(sx)
    # Columns of R = R_y R_x: the stop's own x and y directions; their z components lower the distance.
    across = np.stack([np.stack([cy, sx * sy], -1), np.stack([zero, cx], -1)], -2)
    along = np.stack([-sy, sx * cy], -1)
    if not (radius > 0).all():
        raise ValueError(f"diameters of stops must be above 0 mm, smallest given: {2 * radius.min():g}")
    reach = radius * np.hypot(sy, sx * cy)
    if (z + reach >= d_f).any():
        raise ValueError(
            f"the rim of a stop at {np.max(z + reach):g} mm is not in front of the object plane ({d_f.min():g} mm): "
            "the object is in the bore"
        )
    with np.errstate(invalid="ignore"):
        share = np.where(np.isinf(d_f), 1.0, (d_f - z) / d_f)
    scale = d_2 / d_1
    slope = (radius / f)[..., None, None] * c[..., :, None] * along[..., None, :] - radius[..., None, None] * across
    middle = c * ((f - z) / f)[..., None] - e
    shape = np.broadcast_shapes(slope.shape[:-2], middle.shape[:-1], share.shape, scale.shape)
    maps = np.empty((*shape, 3, 3))
    maps[..., :2, :2] = scale[..., None, None] * slope
    maps[..., :2, 2] = scale[..., None] * middle
    maps[..., 2, :2] = (radius / d_f)[..., None] * along
    maps[..., 2, 2] = share
    return maps


def tilted_microlens_images(
    axis: ArrayLike,
    diameter: ArrayLike,
    distance: ArrayLike,
    decentre: ArrayLike,
    tilt: ArrayLike,
    *,
    focal_length: ArrayLike,
    focal_plane: ArrayLike,
    mla_distance: ArrayLike,
    sensor_distance: ArrayLike,
) -> DiscIntersection:
    """Shapes of the geometric microlens images behind tilted stops; parameters as `rim_maps`, the FAP first.

    Returns
    -------
    DiscIntersection
        As `discs.intersect` gives for stops that stand upright. Areas, positions and moments are right to about 1e-13
        of the FAP's image (its area, radius and radius squared); so is `lost_fraction`, here 1 - `kept_fraction`.
    """
    maps = rim_maps(
        axis,
        diameter,
        distance,
        decentre,
        tilt,
        focal_length=focal_length,
        focal_plane=focal_plane,
        mla_distance=mla_distance,
        sensor_distance=sensor_distance,
    )
    return intersect_ellipses(*_outlines(maps))


def _outlines(maps: Array) -> tuple[Array, Array]:
    """Centres (..., 2) and matrices (..., 3) of the ellipses that the unit circle becomes under projective maps.

    The dual conic ``N diag(1, 1, -1) N^T`` of the circle's image, N the map with the image of the circle's centre as
    the origin: nothing large cancels.
    """
    middle = maps[..., :2, 2] / maps[..., 2:, 2]
    slant = maps[..., 2, :2] / maps[..., 2:, 2]
    across = (maps[..., :2, :2] - middle[..., :, None] * maps[..., 2:, :2]) / maps[..., 2:, 2:]
    size = 1 / (1 - np.sum(slant * slant, axis=-1))
    aside = (across @ slant[..., None])[..., 0]
    shape = across @ np.swapaxes(across, -1, -2) + size[..., None, None] * aside[..., :, None] * aside[..., None, :]
    matrices = size[..., None] * np.stack([shape[..., 0, 0], shape[..., 0, 1], shape[..., 1, 1]], axis=-1)
    return middle - size[..., None] * aside, matrices
