"""The decoded light field: pupil points, views, depth from disparity, lengths from a calibration. Eqs. 1, 2, 10 to 12.

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

Disparities are in microlens pitches, positive for points nearer than the focal plane, which stands at ``Z_F = g = d_f -
d_3 = A/m``. Eq. 12's ``m - A/Z_F`` cancels there; written with the gap, ``m (Z_F - g)/Z_F``, it does not.

A calibration of decoded light fields determines A = d_1/H and m = d_1/d_f, not the focal length: f must be known, and
its error enters d_3 magnified by ``1 + 1/m``. An f assumed without a stated error makes d_3 look better than it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, floats, product, ratio
from ..camera import Camera


def pixel_to_pupil(c: Camera, pixel: ArrayLike) -> Array:
    """Coordinate S' [mm] on the FAP that the pixel s' looks at, ``-(q A/d_2) s'``; inf at d_2 = 0. Eqs. 1, 2."""
    (s,) = floats(pixel)
    return ratio(-product(s, c.q * c.seen.A), c.seen.d_2)


def view_projection(c: Camera, view: ArrayLike) -> Array:
    """Camera matrix of one view: the picture made of pixel (s', t') of every microlens. Eq. 10; Eq. 11 at d_3 = 0.

    Parameters
    ----------
    view : array_like, shape (..., 2)
        (s', t') [px].

    Returns
    -------
    ndarray, shape (..., 3, 4)
        Takes a scene point ``(X, Y, Z_F, W)`` to ``(u w, v w, w)`` with ``w = Z_F``, finite for finite arguments: a
        view is a pinhole camera at ``(S', T')`` on the FAP.
    """
    pupil = pixel_to_pupil(c.with_axes(1) if c.shape else c, view)
    shape = np.broadcast_shapes(pupil.shape[:-1], c.shape)
    matrix = np.zeros((*shape, 3, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = -c.seen.A / c.d
    matrix[..., :2, 2] = -(c.seen.m / c.d)[..., None] * pupil
    matrix[..., :2, 3] = (c.seen.A / c.d)[..., None] * pupil
    matrix[..., 2, 2] = 1.0
    return matrix


def pupil_shear(c: Camera, depth: ArrayLike) -> Array:
    """Millimetres that a point's image moves on the array per millimetre the viewpoint moves on the FAP.

    Parameters
    ----------
    depth : array_like
        Z_F [mm], may be inf.

    Returns
    -------
    ndarray
        ``m (Z_F - g)/Z_F = m - A/Z_F``, broadcast; exactly 0 at the focal plane, m at ``Z_F = inf``.
    """
    z, df = floats(depth, c.seen.d_f)
    with np.errstate(invalid="ignore"):
        shear = product(ratio(z - c.seen.gap, z), c.seen.m)
    focused_at_infinity = np.isinf(df)
    if focused_at_infinity.any():  # m = 0, and an infinite gap no longer tells A
        shear = np.where(focused_at_infinity, -ratio(c.seen.A, z), shear)[()]
    return shear


def epi_slope(c: Camera, depth: ArrayLike) -> Array:
    """Microlenses that a point at Z_F = `depth` [mm] moves by from view to view, Du/Ds'. Eq. 12; inf at 0."""
    return product(pupil_shear(c, depth), ratio(c.q / c.d * c.seen.A, c.seen.d_2))


def depth_of_slope(c: Camera, slope: ArrayLike) -> Array:
    """Depth Z_F [mm] of what moves by `slope` [microlenses per px] from view to view: the inverse of `epi_slope`.

    Inf for what is infinitely far; below 0, where no point is, for larger slopes still.
    """
    (k,) = floats(slope)
    return ratio(c.seen.A, c.seen.m - product(k, ratio(c.seen.d_2 * c.d, c.q * c.seen.A)))


def rim_disparity(c: Camera, depth: ArrayLike) -> Array:
    """Disparity of a point at Z_F = `depth` [mm] between the FAP's opposite rims [pitches]; inf at 0."""
    return product(-c.seen.D_F / c.d, pupil_shear(c, depth))


def disparity_rate(c: Camera, depth: ArrayLike) -> Array:
    """Change of the rim disparity per millimetre of depth, ``D_F A/(d Z_F^2)`` [pitches per mm], inf at Z_F = 0."""
    (z,) = floats(depth)
    return product(c.seen.D_F / c.d, ratio(ratio(c.seen.A, z), z))


def depth_sigma(c: Camera, depth: ArrayLike, disparity_sigma: ArrayLike) -> Array:
    """Standard deviation of depth from that of the rim disparity, to first order.

    Parameters
    ----------
    depth : array_like
        Z_F [mm].
    disparity_sigma : array_like
        sigma_B [microlens pitches].

    Returns
    -------
    ndarray
        ``Z_F^2 d sigma_B/(D_F A)`` [mm], broadcast; inf at D_F = 0.
    """
    sigma, z = floats(disparity_sigma, depth)
    return product(ratio(product(sigma * c.d, z), product(c.seen.D_F, c.seen.A)), z)


class _BackSubstituted(NamedTuple):
    """Lengths of the camera from a calibration."""

    mla_distance: Array
    """d_1 = f (1 + m) [mm]."""
    focal_plane_distance: Array
    """d_f = f (1 + m)/m [mm]."""
    aperture_constant: Array
    """H = f (1 + m)/A; inf at A = 0."""
    pupil_distance: Array
    """d_3 = f + (f - A)/m [mm]."""
    inverse_aperture_constant: Array
    """1/H = A/(f (1 + m)), finite."""


def back_substitute(
    focal_length: ArrayLike, effective_image_distance: ArrayLike, magnification: ArrayLike
) -> _BackSubstituted:
    """Lengths d_1, d_f, d_3 and the aperture constant from f, A and m.

    Parameters
    ----------
    focal_length, effective_image_distance, magnification : array_like
        f, A [mm] and m.

    Returns
    -------
    BackSubstituted
        Broadcast; only H can be infinite (``A = 0``; finite twin: 1/H, beside it).

    Raises
    ------
    ValueError
        f or m is not positive: at ``m = 0`` the camera is focused at infinity, where ``A = f`` says nothing of d_3.

    Notes
    -----
    Table 2 of the paper is f = 100 mm, A = 91.09 mm, m = 0.42.
    """
    f, reach, m = floats(focal_length, effective_image_distance, magnification)
    for name, value in (("focal_length", f), ("magnification", m)):
        if not (value > 0).all():
            raise ValueError(
                f"{name} must be positive, got {float(np.ravel(value[~(value > 0)])[0])}: "
                "without it the pupil distance is not determined"
            )
    d1 = f * (1 + m)
    with np.errstate(divide="ignore"):
        constant = d1 / reach
    return _BackSubstituted(d1, d1 / m, constant, f + (f - reach) / m, reach / d1)
