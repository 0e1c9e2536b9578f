"""Projection between scene points and the decoded light field, as homogeneous matrices: Eqs. 10 and 11.

With ``d_3 = 0`` (so ``A = d_1``, ``Z_F = Z``) every matrix here is that of a traditional light field (Eq. 11).

======================  ====================================================================================
coordinate              convention
======================  ====================================================================================
X, Y                    scene, mm, same axes as the array and the sensor; nothing is turned round on purpose
Z                       depth of the scene point *before the main lens*, positive, mm
Z_F = Z - d_3           the same from the flexible angular plane (FAP): the frame of these matrices
(X, Y, Z_F, W)          homogeneous scene point; W = 0 is a point at infinity, seen along (X, Y)/Z_F
u, v                    microlens index: its axis is at d (u - u_0) on the array; u_0 is the microlens on axis
s', t'                  pixel within that microlens's image, from the image's own centre s'_0 (chief ray)
S' = -(q A/d_2)(s'-s'_0)  FAP coordinate that the pixel sees (Eq. 2); minus: the microlens turns its image round
x_mla = -A X/Z_F        where the chief ray of a scene point meets the array; minus: the main lens does as well
m, A                    image-side magnification d_1/d_f; effective image distance d_1/H
======================  ====================================================================================

All follows from one ray: through S' on the FAP and the scene point, it meets the array at
``d (u - u_0) = -A X/Z_F - (m - A/Z_F) S'``. Indices are real numbers; a microlens sees what lies within half of one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, ratio


def pupil_frame(pupil_distance: ArrayLike) -> Array:
    """Change of frame, main lens to flexible angular plane.

    Parameters
    ----------
    pupil_distance : array_like, shape (...)
        d_3 [mm]; its negative gives the way back.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Takes ``(X, Y, Z, W)`` to ``(X, Y, Z - d_3 W, W)``.
    """
    (d3,) = floats(pupil_distance)
    matrix = np.zeros((*d3.shape, 4, 4))
    matrix[..., range(4), range(4)] = 1.0
    matrix[..., 2, 3] = -d3
    return matrix


def view_projection(
    view: ArrayLike,
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    view_centre: ArrayLike = (0.0, 0.0),
    microlens_centre: ArrayLike = (0.0, 0.0),
) -> Array:
    """Camera matrix of one view: the picture made of pixel (s', t') of every microlens.

    Parameters
    ----------
    view, view_centre : array_like, shape (..., 2)
        (s', t') and (s'_0, t'_0) [px].
    effective_image_distance, magnification : array_like, shape (...)
        A [mm] and m.
    microlens_pitch, pixel_pitch, sensor_distance : array_like, shape (...)
        d, q and d_2 [mm], ``d_2 > 0``.
    microlens_centre : array_like, shape (..., 2)
        (u_0, v_0).

    Returns
    -------
    ndarray, shape (..., 3, 4)
        Takes a scene point ``(X, Y, Z_F, W)`` to ``(u w, v w, w)`` with ``w = Z_F``. Finite for finite arguments.

    Notes
    -----
    Eq. 10; Eq. 11 with ``A = d_1``. A view is a pinhole camera at ``(S', T')`` on the FAP.
    """
    reach, m, d, q, d2 = floats(effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance)
    st, st0, uv0 = floats(view, view_centre, microlens_centre)
    pupil = -(q * reach / d2)[..., None] * (st - st0)
    shape = np.broadcast_shapes(pupil.shape[:-1], m.shape, d.shape, uv0.shape[:-1])
    matrix = np.zeros((*shape, 3, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = -reach / d
    matrix[..., :2, 2] = uv0 - (m / d)[..., None] * pupil
    matrix[..., :2, 3] = (reach / d)[..., None] * pupil
    matrix[..., 2, 2] = 1.0
    return matrix


def microlens_projection(
    microlens: ArrayLike,
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    view_centre: ArrayLike = (0.0, 0.0),
    microlens_centre: ArrayLike = (0.0, 0.0),
) -> Array:
    """Camera matrix of one microlens: the picture on the pixels behind it.

    Parameters
    ----------
    microlens, microlens_centre : array_like, shape (..., 2)
        (u, v) and (u_0, v_0).
    effective_image_distance, magnification : array_like, shape (...)
        A [mm], not 0, and m.
    microlens_pitch, pixel_pitch, sensor_distance : array_like, shape (...)
        d, q and d_2 [mm].
    view_centre : array_like, shape (..., 2)
        (s'_0, t'_0) [px].

    Returns
    -------
    ndarray, shape (..., 3, 4)
        Takes a scene point ``(X, Y, Z_F, W)`` to ``(s' w, t' w, w)`` with ``w = m Z_F - A W``, which vanishes on the
        focal plane: all pixels of a microlens see the same point of it.

    Notes
    -----
    Eq. 10 solved for the pixel; Eq. 11 with ``A = d_1``.
    """
    reach, m, d, q, d2 = floats(effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance)
    uv, st0, uv0 = floats(microlens, view_centre, microlens_centre)
    offset = (d / reach)[..., None] * (uv - uv0)
    scale = d2 / q
    shape = np.broadcast_shapes(offset.shape[:-1], m.shape, scale.shape, st0.shape[:-1])
    matrix = np.zeros((*shape, 3, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = scale
    matrix[..., :2, 2] = m[..., None] * st0 + scale[..., None] * offset
    matrix[..., :2, 3] = -reach[..., None] * st0
    matrix[..., 2, 2], matrix[..., 2, 3] = m, -reach
    return matrix


def project(matrix: ArrayLike, point: ArrayLike) -> Array:
    """Apply a matrix of this module to homogeneous points.

    Parameters
    ----------
    matrix : array_like, shape (..., R, C)
    point : array_like, shape (..., C)

    Returns
    -------
    ndarray, shape (..., R)
        Homogeneous, broadcast over the leading axes.
    """
    rows, columns = floats(matrix, point)
    return (rows @ columns[..., None])[..., 0]


def from_homogeneous(point: ArrayLike) -> Array:
    """Ordinary coordinates of homogeneous ones.

    Parameters
    ----------
    point : array_like, shape (..., N + 1)
        The weight last.

    Returns
    -------
    ndarray, shape (..., N)
        Coordinates over weight; where the weight is 0, signed inf (finite twin: the homogeneous point), and 0 for a
        coordinate that is itself 0.
    """
    (p,) = floats(point)
    return np.asarray(ratio(p[..., :-1], p[..., -1:]))
