"""Depth: how a scene point moves from view to view, and how well a measured disparity tells its distance.

Depth Z_F = Z - d_3 is measured from the flexible angular plane (FAP), the focal plane at ``Z_F = g = d_f - d_3 = A/m``.
Disparities are in microlens pitches, and positive for points nearer than the focal plane. Eq. 12's ``m - A/Z_F``
cancels at the focal plane; written with the gap, ``m (Z_F - g)/Z_F``, it does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, floats, product, ratio
from ..camera import Camera

SIGMA_DISPARITY = 0.1
"""Disparity error that depth precision is told for [microlens pitches]: what careful matching of views reaches."""


def pupil_shear(c: Camera, depth: ArrayLike) -> Array:
    """Millimetres that a point's image moves on the array per millimetre the viewpoint moves on the FAP.

    Parameters
    ----------
    c : Camera
    depth : array_like
        Z_F [mm], may be inf.

    Returns
    -------
    ndarray
        ``m (Z_F - g)/Z_F = m - A/Z_F``, broadcast; exactly 0 at the focal plane, m at ``Z_F = inf``.
    """
    z, df = floats(depth, c.d_f)
    with np.errstate(invalid="ignore"):
        shear = product(ratio(z - c.gap, z), c.m)
    focused_at_infinity = np.isinf(df)
    if focused_at_infinity.any():  # m = 0, and an infinite gap no longer tells A
        shear = np.where(focused_at_infinity, -ratio(c.A, z), shear)[()]
    return shear


def epi_slope(c: Camera, depth: ArrayLike) -> Array:
    """Microlenses that a point at Z_F = `depth` [mm] moves by from view to view, Du/Ds'. Eq. 12; inf at 0."""
    d, q, d2 = floats(c.d, c.q, c.d_2)
    return product(pupil_shear(c, depth), ratio(q / d * c.A, d2))


def rim_disparity(c: Camera, depth: ArrayLike) -> Array:
    """Disparity of a point at Z_F = `depth` [mm] between the FAP's opposite rims [pitches]; inf at 0."""
    de, d = floats(c.D_F, c.d)
    return product(-de / d, pupil_shear(c, depth))


def disparity_rate(c: Camera, depth: ArrayLike) -> Array:
    """Change of the rim disparity per millimetre of depth, ``D_F A/(d Z_F^2)`` [pitches per mm], inf at Z_F = 0."""
    z, de, d = floats(depth, c.D_F, c.d)
    return product(de / d, ratio(ratio(c.A, z), z))


def depth_sigma(c: Camera, depth: ArrayLike, disparity_sigma: ArrayLike = SIGMA_DISPARITY) -> Array:
    """Standard deviation of depth from that of the rim disparity, to first order.

    Parameters
    ----------
    c : Camera
    depth : array_like
        Z_F [mm].
    disparity_sigma : array_like
        sigma_B [microlens pitches].

    Returns
    -------
    ndarray
        ``Z_F^2 d sigma_B/(D_F A)`` [mm], broadcast; inf at D_F = 0.
    """
    sigma, z, de, d = floats(disparity_sigma, depth, c.D_F, c.d)
    return product(ratio(product(sigma * d, z), product(de, c.A)), z)
