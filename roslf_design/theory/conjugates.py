"""Conjugate distances of the main lens: 1/f = 1/d_f + 1/d_1, any two give the third.

Everything is written on the differences d_f - f and d_1 - f (Newton's form), which floating point subtracts without
loss, so results stay good to a few ulp however close the focal plane comes to the front focus.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ._arrays import Array, floats, ratio


class Conjugates(NamedTuple):
    """A consistent triple of main-lens distances [mm]."""

    focal_length: Array
    """f."""
    focal_plane_distance: Array
    """d_f, object side."""
    mla_distance: Array
    """d_1, image side."""


def mla_distance(focal_length: ArrayLike, focal_plane_distance: ArrayLike) -> Array:
    """Distance d_1 from the main lens to the plane conjugate to the focal plane.

    Parameters
    ----------
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``f d_f / (d_f - f)`` [mm], broadcast. It is f at ``d_f = inf``; inf at ``d_f = f`` (finite twin:
        `inverse_magnification`, 0 there); negative (virtual image) for ``d_f < f``.
    """
    f, df = floats(focal_length, focal_plane_distance)
    return f * ratio(df, df - f)


def focal_plane_distance(focal_length: ArrayLike, mla_distance: ArrayLike) -> Array:
    """Distance d_f from the main lens to the focal plane, the conjugate of the microlens array.

    Parameters
    ----------
    focal_length, mla_distance : array_like
        f and d_1 [mm]; d_1 may be inf.

    Returns
    -------
    ndarray
        ``f d_1 / (d_1 - f)`` [mm], broadcast. It is f at ``d_1 = inf``; inf at ``d_1 = f`` (finite twin: the
        magnification ``(d_1 - f)/f``, 0 there); negative for ``d_1 < f``.
    """
    f, d1 = floats(focal_length, mla_distance)
    return f * ratio(d1, d1 - f)


def focal_length(focal_plane_distance: ArrayLike, mla_distance: ArrayLike) -> Array:
    """Focal length f of the main lens that images the focal plane onto the microlens array.

    Parameters
    ----------
    focal_plane_distance, mla_distance : array_like
        d_f and d_1 [mm], positive; either may be inf.

    Returns
    -------
    ndarray
        ``1 / (1/d_f + 1/d_1)`` [mm], broadcast; the other distance where one is inf, inf where both are (no lens).
    """
    df, d1 = floats(focal_plane_distance, mla_distance)
    near, far = np.minimum(df, d1), np.maximum(df, d1)
    return near / (1 + ratio(near, far))


def mla_excess(focal_length: ArrayLike, focal_plane_distance: ArrayLike) -> Array:
    """How far behind the rear focus the microlens array stands, d_1 - f, without cancellation.

    Parameters
    ----------
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``f^2 / (d_f - f)`` [mm], broadcast; 0 at ``d_f = inf``, inf at ``d_f = f`` (finite twin: ``d_f - f``).
    """
    f, df = floats(focal_length, focal_plane_distance)
    return f * ratio(f, df - f)


def magnification(focal_length: ArrayLike, focal_plane_distance: ArrayLike) -> Array:
    """Image-side magnification m = d_1/d_f, as a positive number.

    Parameters
    ----------
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``f / (d_f - f)``, broadcast; 0 at ``d_f = inf``, inf at ``d_f = f`` (finite twin: `inverse_magnification`).

    Notes
    -----
    Table 2 of the paper labels it d_1/f; its value is d_1/d_f.
    """
    f, df = floats(focal_length, focal_plane_distance)
    return ratio(f, df - f)


def inverse_magnification(focal_length: ArrayLike, focal_plane_distance: ArrayLike) -> Array:
    """Object-side millimetres per millimetre on the microlens array, 1/m = d_f/d_1.

    Parameters
    ----------
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``(d_f - f) / f``, broadcast; 0 at ``d_f = f``, inf at ``d_f = inf`` (finite twin: `magnification`).
    """
    f, df = floats(focal_length, focal_plane_distance)
    return (df - f) / f


def conjugate_residual(focal_length: ArrayLike, focal_plane_distance: ArrayLike, mla_distance: ArrayLike) -> Array:
    """Contradiction left in an over-determined triple f, d_f, d_1.

    Parameters
    ----------
    focal_length, focal_plane_distance, mla_distance : array_like
        f, d_f and d_1 [mm], positive; d_f and d_1 may be inf.

    Returns
    -------
    ndarray
        ``f/d_f + f/d_1 - 1``, broadcast; 0 for a consistent triple. Accurate to a few ulp of f over the *larger*
        distance, not of 1.
    """
    f, df, d1 = floats(focal_length, focal_plane_distance, mla_distance)
    near, far = np.minimum(df, d1), np.maximum(df, d1)
    return f / far - ratio(near - f, near)


def conjugates(
    focal_length: ArrayLike | None = None,
    focal_plane_distance: ArrayLike | None = None,
    mla_distance: ArrayLike | None = None,
    tolerance: float = 1e-9,
) -> Conjugates:
    """Complete the triple f, d_f, d_1 from any two of them, or check three.

    Parameters
    ----------
    focal_length, focal_plane_distance, mla_distance : array_like or None
        f, d_f and d_1 [mm]; at least two.
    tolerance : float
        Largest `conjugate_residual` allowed where all three are given.

    Returns
    -------
    Conjugates
        The three distances [mm], as given or as the named functions of this module return them.

    Raises
    ------
    ValueError
        Fewer than two are given, or three that contradict each other; the message holds the residual and the remedy.
    """
    f, df, d1 = focal_length, focal_plane_distance, mla_distance
    if f is None and df is not None and d1 is not None:
        return Conjugates(_focal_length(df, d1), _plain(df), _plain(d1))
    if df is None and f is not None and d1 is not None:
        return Conjugates(_plain(f), _focal_plane_distance(f, d1), _plain(d1))
    if d1 is None and f is not None and df is not None:
        return Conjugates(_plain(f), _plain(df), _mla_distance(f, df))
    if f is None or df is None or d1 is None:
        raise ValueError(
            "the main lens is under-determined: give two of focal_length, focal_plane_distance and mla_distance"
        )
    residual = conjugate_residual(f, df, d1)
    wrong = ~(np.abs(residual) <= tolerance)
    if np.any(wrong):
        worst = np.unravel_index(np.argmax(np.abs(residual)), np.shape(residual))
        f_, df_, d1_ = (float(value[worst]) for value in np.broadcast_arrays(f, df, d1))
        raise ValueError(
            f"focal_length {f_:g}, focal_plane_distance {df_:g} and mla_distance {d1_:g} mm contradict each other: "
            f"f/d_f + f/d_1 - 1 = {float(residual[worst]):.3g}; drop one of them "
            f"(without mla_distance it would be {float(_mla_distance(f_, df_)):.9g} mm)"
        )
    return Conjugates(_plain(f), _plain(df), _plain(d1))


def _plain(value: ArrayLike) -> Array:
    plain: Array = np.asarray(value, dtype=np.float64)[()]
    return plain


# The parameters of `conjugates` bear the names of the functions that find them.
_focal_length, _focal_plane_distance, _mla_distance = focal_length, focal_plane_distance, mla_distance
