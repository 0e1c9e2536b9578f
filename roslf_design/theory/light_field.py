"""The decoded light field: which pupil point a pixel sees, and where views show a scene point. Eqs. 1, 2, 10 and 11.

With ``d_3 = 0`` (so ``A = d_1``, ``Z_F = Z``) all of it is that of a traditional light field (Eqs. 1 and 11).

======================  ====================================================================================
coordinate              convention
======================  ====================================================================================
X, Y                    scene, mm, same axes as the array and the sensor; nothing is turned round on purpose
Z_F = Z - d_3           depth of the scene point from the flexible angular plane (FAP), positive, mm
(X, Y, Z_F, W)          homogeneous scene point; W = 0 is a point at infinity, seen along (X, Y)/Z_F
u, v                    microlens index, counted from the microlens on the axis: its axis is at d u on the array
s', t'                  pixel within that microlens's image, from the image's own centre (chief ray)
S' = -(q A/d_2) s'      FAP coordinate that the pixel sees (Eq. 2); minus: the microlens turns its image round
======================  ====================================================================================

All follows from one ray: through S' on the FAP and the scene point, it meets the array at
``d u = -A X/Z_F - (m - A/Z_F) S'``. Indices are real numbers; a microlens sees what lies within half of one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, floats, product, ratio
from ..camera import Camera


def pixel_to_pupil(c: Camera, pixel: ArrayLike) -> Array:
    """Coordinate S' [mm] on the FAP that the pixel s' looks at, ``-(q A/d_2) s'``; inf at d_2 = 0. Eqs. 1, 2."""
    s, q, d2 = floats(pixel, c.q, c.d_2)
    return ratio(-product(s, q * c.A), d2)


def pupil_to_pixel(c: Camera, coordinate: ArrayLike) -> Array:
    """Pixel s' that looks at the coordinate S' [mm] of the FAP, ``-S' d_2/(q A)``; inf at d_3 = d_f."""
    at, q, d2 = floats(coordinate, c.q, c.d_2)
    return -ratio(d2 * at, q * c.A)


def view_projection(c: Camera, view: ArrayLike) -> Array:
    """Camera matrix of one view: the picture made of pixel (s', t') of every microlens. Eq. 10; Eq. 11 at d_3 = 0.

    Parameters
    ----------
    c : Camera
    view : array_like, shape (..., 2)
        (s', t') [px].

    Returns
    -------
    ndarray, shape (..., 3, 4)
        Takes a scene point ``(X, Y, Z_F, W)`` to ``(u w, v w, w)`` with ``w = Z_F``, finite for finite arguments: a
        view is a pinhole camera at ``(S', T')`` on the FAP.
    """
    reach, m, d = floats(c.A, c.m, c.d)
    pupil = pixel_to_pupil(c.spread(1) if c.shape else c, view)
    shape = np.broadcast_shapes(pupil.shape[:-1], c.shape)
    matrix = np.zeros((*shape, 3, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = -reach / d
    matrix[..., :2, 2] = -(m / d)[..., None] * pupil
    matrix[..., :2, 3] = (reach / d)[..., None] * pupil
    matrix[..., 2, 2] = 1.0
    return matrix
