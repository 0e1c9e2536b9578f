"""Conjugate distances of the main lens, 1/f = 1/d_f + 1/d_1: any two give the third, and which one follows a change.

Everything is written on the differences d_f - f and d_1 - f (Newton's form), which floating point subtracts without
loss, so results stay good to a few ulp however close the focal plane comes to the front focus.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, floats, ratio

CONJUGATES = ("main_lens.focal_length", "main_lens.focal_plane", "microlens_array.distance")
"""Keys of f, d_f and d_1, any two of which give the third."""


def mla_distance(focal_length: ArrayLike, focal_plane_distance: ArrayLike) -> Array:
    """Distance d_1 from the main lens to the plane conjugate to the focal plane.

    Parameters
    ----------
    focal_length, focal_plane_distance : array_like
        f and d_f [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``f d_f / (d_f - f)`` [mm], broadcast; f at ``d_f = inf``, inf at ``d_f = f``, negative for ``d_f < f``.
    """
    f, df = floats(focal_length, focal_plane_distance)
    return f * ratio(df, df - f)


def focal_plane_distance(focal_length: ArrayLike, mla_distance: ArrayLike) -> Array:
    """Distance d_f [mm] from the main lens to the focal plane: `mla_distance` again; inf at ``d_1 = f``."""
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


def conjugate_residual(focal_length: ArrayLike, focal_plane_distance: ArrayLike, mla_distance: ArrayLike) -> Array:
    """Contradiction ``f/d_f + f/d_1 - 1`` left in an over-determined triple; lengths [mm], positive.

    Accurate to a few ulp of f over the *larger* distance, not of 1.
    """
    f, df, d1 = floats(focal_length, focal_plane_distance, mla_distance)
    near, far = np.minimum(df, d1), np.maximum(df, d1)
    return f / far - ratio(near - f, near)


REFRACTING = ("elements", "object_space", "sensor.cover", "microlens_array.substrate")
"""Beginnings of the places of all that light meets but the main lens."""

WARMING = ("environment.temperature",)
"""The place that moves all of them."""


def follower(changed: Collection[str]) -> str | None:
    """Conjugate that follows, of f, d_f and d_1, where places change.

    Returns
    -------
    str or None
        Its key: d_f where f, d_1, the glass about them or the temperature changes (the hardware stays), d_1 where d_f
        does (refocusing), of two that change the third; None where nothing of that changes, or all three do.
    """
    named = [key for key in CONJUGATES if key in changed]
    if len(named) == 3:
        return None
    if not named:
        return CONJUGATES[1] if any(place.startswith((*REFRACTING, *WARMING)) for place in changed) else None
    if len(named) == 2:
        return next(key for key in CONJUGATES if key not in named)
    return CONJUGATES[2] if named[0] == CONJUGATES[1] else CONJUGATES[1]


def followed(numbers: Mapping[str, ArrayLike], key: str) -> Array:
    """The value of one of f, d_f and d_1 that the other two in `numbers` give [mm]."""
    f, plane, distance = CONJUGATES
    if key == f:
        return focal_length(numbers[plane], numbers[distance])
    if key == plane:
        return focal_plane_distance(numbers[f], numbers[distance])
    return mla_distance(numbers[f], numbers[plane])
