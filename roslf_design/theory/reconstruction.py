"""The decoded light field as a whole, both ways, as homogeneous matrices: scene points and rays. Eqs. 2, 10 and 11.

Signs, frames and symbols are those of the table in `roslf_design.theory.projection`: points ``(X, Y, Z_F, W)`` from the
flexible angular plane (FAP), pixels s', t' within a microlens image, microlenses u, v. With ``A = d_1`` and
``Z_F = Z`` all is that of a traditional light field.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats


def light_field_projection(
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    microlens_centre: ArrayLike = (0.0, 0.0),
) -> Array:
    """Scene point to what all views together say of it: central-view microlens and EPI slope.

    Parameters
    ----------
    effective_image_distance, magnification : array_like, shape (...)
        A [mm] and m.
    microlens_pitch, pixel_pitch, sensor_distance : array_like, shape (...)
        d, q and d_2 [mm], ``d_2 > 0``.
    microlens_centre : array_like, shape (..., 2)
        (u_0, v_0).

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Takes ``(X, Y, Z_F, W)`` to ``(u w, v w, rho w, w)``, ``w = Z_F``: in view s' the point is at
        ``u + rho (s' - s'_0)``, rho [microlenses per pixel] the slope of Eq. 12.
    """
    reach, m, d, q, d2 = floats(effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance)
    (uv0,) = floats(microlens_centre)
    slope = q * reach / (d * d2)
    matrix = np.zeros((*np.broadcast_shapes(slope.shape, m.shape, uv0.shape[:-1]), 4, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = -reach / d
    matrix[..., :2, 2] = uv0
    matrix[..., 2, 2], matrix[..., 2, 3] = slope * m, -slope * reach
    matrix[..., 3, 2] = 1.0
    return matrix


def light_field_reconstruction(
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    microlens_centre: ArrayLike = (0.0, 0.0),
) -> Array:
    """Central-view microlens and EPI slope to scene point: the inverse of `light_field_projection`.

    Parameters
    ----------
    effective_image_distance, magnification : array_like, shape (...)
        A [mm], not 0, and m.
    microlens_pitch, pixel_pitch, sensor_distance : array_like, shape (...)
        d, q and d_2 [mm].
    microlens_centre : array_like, shape (..., 2)
        (u_0, v_0).

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Takes ``(u, v, rho, 1)`` to ``(X, Y, Z_F, W)`` up to a factor; W = 0 at infinity.
    """
    reach, m, d, q, d2 = floats(effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance)
    (uv0,) = floats(microlens_centre)
    scale = d / reach
    depth = scale * d2 / (q * reach)
    matrix = np.zeros((*np.broadcast_shapes(depth.shape, m.shape, uv0.shape[:-1]), 4, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = -scale
    matrix[..., :2, 3] = scale[..., None] * uv0
    matrix[..., 2, 3] = 1.0
    matrix[..., 3, 2], matrix[..., 3, 3] = -depth, m / reach
    return matrix


def ray_matrix(
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    view_centre: ArrayLike = (0.0, 0.0),
    microlens_centre: ArrayLike = (0.0, 0.0),
) -> Array:
    """Decoded coordinates to the ray in object space that they are the radiance of.

    Parameters
    ----------
    effective_image_distance, magnification : array_like, shape (...)
        A [mm], not 0, and m.
    microlens_pitch, pixel_pitch, sensor_distance : array_like, shape (...)
        d, q and d_2 [mm], ``d_2 > 0``.
    view_centre, microlens_centre : array_like, shape (..., 2)
        (s'_0, t'_0) [px] and (u_0, v_0).

    Returns
    -------
    ndarray, shape (..., 5, 5)
        Takes ``(s', t', u, v, 1)`` to ``(S', T', dX/dZ_F, dY/dZ_F, 1)``: the ray is at
        ``S' + Z_F dX/dZ_F`` at depth Z_F.

    Notes
    -----
    Eq. 2 and ``dX/dZ_F = -(d (u - u_0) + m S')/A``.
    """
    reach, m, d, q, d2 = floats(effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance)
    st0, uv0 = floats(view_centre, microlens_centre)
    pupil, tilt, scale = q * reach / d2, m * q / d2, d / reach
    shape = np.broadcast_shapes(pupil.shape, tilt.shape, scale.shape, st0.shape[:-1], uv0.shape[:-1])
    matrix = np.zeros((*shape, 5, 5))
    for i in (0, 1):
        matrix[..., i, i], matrix[..., i, 4] = -pupil, pupil * st0[..., i]
        matrix[..., 2 + i, i], matrix[..., 2 + i, 2 + i] = tilt, -scale
        matrix[..., 2 + i, 4] = scale * uv0[..., i] - tilt * st0[..., i]
    matrix[..., 4, 4] = 1.0
    return matrix


def decoding_matrix(
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    view_centre: ArrayLike = (0.0, 0.0),
    microlens_centre: ArrayLike = (0.0, 0.0),
) -> Array:
    """Ray in object space to decoded coordinates: the inverse of `ray_matrix`, parameters as there.

    Returns
    -------
    ndarray, shape (..., 5, 5)
        Takes ``(S', T', dX/dZ_F, dY/dZ_F, 1)`` to ``(s', t', u, v, 1)``.
    """
    reach, m, d, q, d2 = floats(effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance)
    st0, uv0 = floats(view_centre, microlens_centre)
    pixel, row, scale = d2 / (q * reach), m / d, reach / d
    shape = np.broadcast_shapes(pixel.shape, row.shape, scale.shape, st0.shape[:-1], uv0.shape[:-1])
    matrix = np.zeros((*shape, 5, 5))
    for i in (0, 1):
        matrix[..., i, i], matrix[..., i, 4] = -pixel, st0[..., i]
        matrix[..., 2 + i, i], matrix[..., 2 + i, 2 + i], matrix[..., 2 + i, 4] = -row, -scale, uv0[..., i]
    matrix[..., 4, 4] = 1.0
    return matrix
