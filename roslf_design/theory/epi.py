"""Epipolar-plane images: how a scene point moves across the array from view to view. Eq. 12.

Depth is measured from the flexible angular plane (FAP): Z_F = Z - d_3, with the focal plane at
``Z_F = g = d_f - d_3 = A/m``. Eq. 12's ``m - A/Z_F`` cancels there. Written with the gap, ``m (Z_F - g)/Z_F``, it does
not; but a gap re-computed from A and m brings their rounding back, so the form that holds starts from the lengths
(`pupil_shear`), and the one for a calibration's A and m (`calibrated_epi_slope`) is no better than these are known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio
from .aperture import effective_image_distance, gap
from .conjugates import magnification


def pupil_shear(
    depth: ArrayLike, focal_length: ArrayLike, focal_plane_distance: ArrayLike, pupil_distance: ArrayLike
) -> Array:
    """Millimetres that a scene point's image moves on the array per millimetre the viewpoint moves on the FAP.

    Parameters
    ----------
    depth : array_like
        Z_F, from the FAP to the scene point [mm]; may be inf.
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``m - A/Z_F`` as ``m (Z_F - g)/Z_F``, broadcast; exactly 0 on the focal plane, positive beyond it, m at
        ``Z_F = inf``; -inf at ``Z_F = 0``, a point on the pupil itself (finite twin: `epi_inverse_slope`, 0 there);
        infinite at ``d_f = f`` off the focal plane (finite twin: `inverse_magnification`).

    Notes
    -----
    The bracket of Eq. 12, with the sign of the array's own axes: the image moves by minus the shear.
    """
    z, f, df, d3 = floats(depth, focal_length, focal_plane_distance, pupil_distance)
    with np.errstate(invalid="ignore"):
        shear = product(ratio(z - gap(df, d3), z), magnification(f, df))
    focused_at_infinity = np.isinf(df)
    if focused_at_infinity.any():  # m = 0, and an infinite gap no longer tells A
        shear = np.where(focused_at_infinity, -ratio(effective_image_distance(f, df, d3), z), shear)[()]
    return shear


def epi_slope(
    depth: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Microlenses that a scene point moves by from one view to the next, Du/Ds'.

    Parameters
    ----------
    depth : array_like
        Z_F, from the FAP to the scene point [mm]; may be inf.
    microlens_pitch, pixel_pitch, sensor_distance : array_like
        d, q and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``(q A / (d d_2)) (m - A/Z_F)`` [microlenses per pixel], broadcast; exactly 0 on the focal plane, positive
        beyond it; -inf at ``Z_F = 0`` and, off the focal plane, infinite at ``d_2 = 0`` and ``d_f = f`` (finite twin:
        `epi_inverse_slope`).

    Notes
    -----
    Eq. 12.
    """
    d, q, d2, f, df, d3 = floats(
        microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
    )
    step = ratio(q / d * effective_image_distance(f, df, d3), d2)
    return product(pupil_shear(depth, f, df, d3), step)


def epi_inverse_slope(
    depth: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Views through which a scene point passes between two neighbouring microlenses, Ds'/Du.

    Parameters
    ----------
    depth, microlens_pitch, pixel_pitch, sensor_distance : array_like
        As for `epi_slope`.
    focal_length, focal_plane_distance, pupil_distance : array_like
        As for `epi_slope`.

    Returns
    -------
    ndarray
        ``(d d_2 / (q A)) / (m - A/Z_F)`` [pixels per microlens], broadcast; 0 at ``Z_F = 0``; inf on the focal plane
        (finite twin: `epi_slope`, 0 there) and at ``d_3 = d_f``.
    """
    return ratio(
        np.ones(()),
        epi_slope(
            depth, microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
        ),
    )


def calibrated_epi_slope(
    depth: ArrayLike,
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
) -> Array:
    """Slope of Eq. 12 from the parameters that a calibration fits.

    Parameters
    ----------
    depth : array_like
        Z_F, from the FAP to the scene point [mm]; may be inf.
    effective_image_distance, magnification : array_like
        A [mm] and m.
    microlens_pitch, pixel_pitch, sensor_distance : array_like
        d, q and d_2 [mm].

    Returns
    -------
    ndarray
        ``(q A / (d d_2)) (m - A/Z_F)`` [microlenses per pixel], broadcast; infinite at ``Z_F = 0`` unless
        ``A = 0``, and at ``d_2 = 0`` off the focal plane.

    Notes
    -----
    Eq. 12. Near the focal plane its error is that of A and m over the difference of the two terms.
    """
    z, reach, m, d, q, d2 = floats(
        depth, effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance
    )
    return product(ratio(q * reach, d * d2), m - ratio(reach, z))


def inverse_depth_from_epi_slope(
    slope: ArrayLike,
    effective_image_distance: ArrayLike,
    magnification: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
) -> Array:
    """Inverse depth 1/Z_F of a scene point from its slope in the epipolar-plane image.

    Parameters
    ----------
    slope : array_like
        Du/Ds' [microlenses per pixel].
    effective_image_distance, magnification : array_like
        A [mm] and m.
    microlens_pitch, pixel_pitch, sensor_distance : array_like
        d, q and d_2 [mm].

    Returns
    -------
    ndarray
        ``(m - slope d d_2 / (q A)) / A`` [1/mm], broadcast; 0 for a scene point at infinity; infinite at ``A = 0``
        (``d_3 = d_f``, where slopes are 0 at every depth).

    Notes
    -----
    Eq. 12, solved for the depth.
    """
    rho, reach, m, d, q, d2 = floats(
        slope, effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance
    )
    return ratio(m * reach - rho * (d * d2 / q), reach * reach)
