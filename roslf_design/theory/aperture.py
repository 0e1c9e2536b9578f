"""The flexible angular plane (FAP) as seen from the focal plane: Eq. 3 and the two lengths behind it.

H = d_f/(d_f - d_3) overflows as the FAP nears the focal plane; the gap g = d_f - d_3 and 1/H = g/d_f do not, and
everything else in this package is built on them. A = d_1/H is the distance that, divided by the FAP's diameter, gives
the working f-number at the microlens array: A takes d_1's place wherever a pupil at the lens gives way to the FAP.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio


def gap(focal_plane_distance: ArrayLike, pupil_distance: ArrayLike) -> Array:
    """Depth g of the focal plane measured from the FAP.

    Parameters
    ----------
    focal_plane_distance, pupil_distance : array_like
        d_f and d_3 [mm].

    Returns
    -------
    ndarray
        ``d_f - d_3`` [mm], broadcast, correctly rounded; positive in front of the bore's end, inf at ``d_f = inf``
        (finite twin: `inverse_aperture_constant`).
    """
    df, d3 = floats(focal_plane_distance, pupil_distance)
    return df - d3


def aperture_constant(focal_plane_distance: ArrayLike, pupil_distance: ArrayLike) -> Array:
    """Aperture constant H: the FAP's projection from the focal plane onto the main lens is H times the FAP.

    Parameters
    ----------
    focal_plane_distance, pupil_distance : array_like
        d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``d_f / (d_f - d_3)``, broadcast; 1 at ``d_3 = 0`` and at ``d_f = inf``; inf at ``d_3 = d_f`` (finite twin:
        `inverse_aperture_constant`), negative beyond, where the focal plane lies inside the bore.

    Notes
    -----
    Eq. 3.
    """
    df, d3 = floats(focal_plane_distance, pupil_distance)
    return ratio(df, df - d3)


def inverse_aperture_constant(focal_plane_distance: ArrayLike, pupil_distance: ArrayLike) -> Array:
    """Inverse aperture constant 1/H, finite everywhere.

    Parameters
    ----------
    focal_plane_distance, pupil_distance : array_like
        d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``(d_f - d_3) / d_f``, broadcast; 0 at ``d_3 = d_f``, 1 at ``d_3 = 0`` and at ``d_f = inf``.

    Notes
    -----
    Eq. 3.
    """
    df, d3 = floats(focal_plane_distance, pupil_distance)
    return ratio(df - d3, df)


def effective_image_distance(
    focal_length: ArrayLike, focal_plane_distance: ArrayLike, pupil_distance: ArrayLike
) -> Array:
    """Effective image distance A = d_1/H; A/D_F is the working f-number at the microlens array.

    Parameters
    ----------
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``f (d_f - d_3) / (d_f - f)`` [mm], broadcast; d_1 at ``d_3 = 0``, f at ``d_3 = f`` and at ``d_f = inf``, 0 at
        ``d_3 = d_f``, inf at ``d_f = f`` (finite twin: `inverse_aperture_constant`).
    """
    f, df, d3 = floats(focal_length, focal_plane_distance, pupil_distance)
    return f * ratio(df - d3, df - f)


def effective_image_distance_from_magnification(
    focal_length: ArrayLike, magnification: ArrayLike, pupil_distance: ArrayLike
) -> Array:
    """Effective image distance A from the magnification, the form a calibration inverts.

    Parameters
    ----------
    focal_length, magnification, pupil_distance : array_like
        f [mm], m = d_1/d_f and d_3 [mm].

    Returns
    -------
    ndarray
        ``f + m (f - d_3)`` [mm], broadcast; finite for finite arguments.
    """
    f, m, d3 = floats(focal_length, magnification, pupil_distance)
    return f + product(f - d3, m)


def pupil_angle(
    pupil_diameter: ArrayLike, focal_length: ArrayLike, focal_plane_distance: ArrayLike, pupil_distance: ArrayLike
) -> Array:
    """Angular diameter of the pupil as every microlens sees it, D_F H/d_1 = D_F/A.

    Parameters
    ----------
    pupil_diameter : array_like
        D_F [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``D_F (d_f - f) / (f (d_f - d_3))`` [rad, paraxial], broadcast; the finite twin of `pupil_f_number`: 0 at
        ``D_F = 0``. inf at ``d_3 = d_f`` (finite twin: the f-number, 0 there).
    """
    de, f, df, d3 = floats(pupil_diameter, focal_length, focal_plane_distance, pupil_distance)
    return product(de / f, ratio(df - f, df - d3))
