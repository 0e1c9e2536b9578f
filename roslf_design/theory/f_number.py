"""f-number matching: whether the microlens images just fill the sensor, and what would make them.

Three rules, from exact to traditional, each told as two f-numbers that should agree or as the fill factor
(microlens-image diameter over pitch) that should be 1. A fill factor above 1 means overlapping images, below 1 unused
pixels.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, floats, product, ratio
from ..camera import Camera
from .exit_pupil import microlens_image_diameter, microlens_image_pitch


def microlens_f_number(c: Camera) -> Array:
    """Working f-number ``d_2/d`` of a microlens, the left side of Eqs. 8 and 9."""
    d2, d = floats(c.d_2, c.d)
    return ratio(d2, d)


def pupil_f_number(c: Camera) -> Array:
    """Working f-number ``d_1/(D_F H) = A/D_F`` of the FAP at the array, the right side of Eq. 8; inf at D_F = 0."""
    (de,) = floats(c.D_F)
    return ratio(c.A, de)


def main_lens_f_number(c: Camera) -> Array:
    """Working f-number ``d_1/D`` of the whole main lens, the right side of Eq. 9; inf at d_1 = inf."""
    diameter, d1 = floats(c.D, c.d_1)
    return ratio(d1, diameter)


def inverse_fill_factor(c: Camera) -> Array:
    """Microlens-image pitch over diameter, ``d (A/d_2 + (f-d_3)/f)/D_F``: linear where the fill factor has poles."""
    de, d, d2, f, d3 = floats(c.D_F, c.d, c.d_2, c.f, c.d_3)
    return d * (ratio(c.A, d2) + (f - d3) / f) / de


def fill_factor(c: Camera) -> Array:
    """Microlens-image diameter over pitch, exactly: 1 where Eq. 7 holds.

    ``D_F d_2 / (d (A + d_2 (f - d_3)/f))``; inf where the images have no pitch.
    """
    de, d, d2, f, d3 = floats(c.D_F, c.d, c.d_2, c.f, c.d_3)
    return ratio(de * d2, d * (c.A + d2 * ((f - d3) / f)))


def approximate_fill_factor(c: Camera) -> Array:
    """Microlens-image diameter over the microlens's own pitch: 1 where Eq. 8 holds; inf at d_3 = d_f."""
    (d,) = floats(c.d)
    return microlens_image_diameter(c) / d


def traditional_fill_factor(c: Camera) -> Array:
    """The same with the main lens for a pupil, ``D d_2/(d_1 d)``: 1 where Eq. 9 holds."""
    diameter, d, d2, d1 = floats(c.D, c.d, c.d_2, c.d_1)
    return (diameter / d1) * (d2 / d)


def mismatch_px(c: Camera) -> Array:
    """Microlens-image diameter minus pitch [px]: overlap above 0, gap below; inf at d_3 = d_f."""
    (q,) = floats(c.q)
    return (microlens_image_diameter(c) - microlens_image_pitch(c)) / q


class Matched(NamedTuple):
    """One length that makes the f-numbers match."""

    value: Array
    """The length [mm]; inf where there is none."""
    exists: NDArray[np.bool_]
    """Whether there is one."""


def matched(c: Camera, symbol: Literal["d_2", "D_F", "d", "d_3"], *, exact: bool = True) -> Matched:
    """Solve Eq. 7, or Eq. 8 where not `exact`, for one length, the others held.

    Parameters
    ----------
    c : Camera
    symbol : {"d_2", "D_F", "d", "d_3"}
        Which length.

    Returns
    -------
    Matched
        Each rule is linear in each length, so there is one solution or none: where it would have to be zero, negative,
        infinite, or put the FAP behind the lens or beyond the focal plane, the value is inf and `exists` False.
    """
    de, d, d2, f, df, d3 = floats(c.D_F, c.d, c.d_2, c.f, c.d_f, c.d_3)
    image: NDArray[np.bool_] | bool = True
    if symbol == "d_3":
        share, nearness = ratio(df - f, df), f / df
        image = (de > 0) & (d2 > 0)
        if exact:
            length = ratio(f + d2 * (1 - de / d) * share, nearness + d2 / f * share)
        else:
            length = ratio(f - de * (d2 / d) * share, nearness)
            image = image & np.isfinite(df)
        exists = image & (length >= 0) & (length < df)
        return Matched(np.where(exists, length, np.inf)[()], exists)
    bend = (f - d3) / f if exact else np.zeros(())
    if symbol == "d_2":
        length, image = ratio(c.A, de / d - bend), de > 0
    elif symbol == "D_F":
        length = d * (ratio(c.A, d2) + bend)
    else:
        length = ratio(de * d2, c.A + product(d2, bend))
    exists = image & (length > 0) & np.isfinite(length)
    return Matched(np.where(exists, length, np.inf)[()], exists)
