"""f-number matching: whether the microlens images just fill the sensor, and what would make them.

Three rules, from exact to traditional, each told as two f-numbers that should agree or as the image fill
(microlens-image diameter over pitch) that should be 1. An image fill above 1 means overlapping images, below 1 unused
pixels. What neighbours are apart by is the pitch's magnitude: images in reversed order (an exit pupil between array and
sensor) are matched as others are.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, floats, magnitude, product, ratio
from ..camera import Camera
from ..design import PATHS
from .exit_pupil import microlens_image_pitch

TOUCHING_PX = 1e-6
"""Overlap or gap that is told as touching: rounding, not optics [px]."""


def microlens_f_number(c: Camera) -> Array:
    """Working f-number ``d_2/d`` of a microlens, the left side of Eqs. 8 and 9."""
    return ratio(c.seen.d_2, c.d)


def pupil_f_number(c: Camera) -> Array:
    """Working f-number ``d_1/(D_F H) = A/D_F`` of the FAP at the array, the right side of Eq. 8; inf at D_F = 0."""
    return ratio(c.seen.A, c.seen.D_F)


def main_lens_f_number(c: Camera) -> Array:
    """Working f-number ``d_1/D`` of the whole main lens, the right side of Eq. 9; inf at d_1 = inf."""
    return ratio(c.seen.d_1, c.D)


def inverse_fill_factor(c: Camera) -> Array:
    """Microlens-image pitch over diameter, ``d (A/d_2 + (f-d_3)/f)/D_F``: linear where the image fill has poles.

    Below 0 where images lie in reversed order.
    """
    return c.d * (ratio(c.seen.A, c.seen.d_2) + (c.f - c.seen.d_3) / c.f) / c.seen.D_F


def fill_factor(c: Camera) -> Array:
    """Microlens-image diameter over pitch, exactly: 1 where Eq. 7 holds.

    ``D_F d_2 / (d |A + d_2 (f - d_3)/f|)``; inf where the images have no pitch.
    """
    return magnitude(ratio(c.seen.D_F * c.seen.d_2, c.d * (c.seen.A + c.seen.d_2 * ((c.f - c.seen.d_3) / c.f))))


def mismatch_px(c: Camera) -> Array:
    """Microlens-image diameter minus the pitch's magnitude [px]: overlap above 0, gap below; +-inf at d_3 = d_f."""
    order = np.where(np.real(microlens_image_pitch(c)) < 0, -1.0, 1.0)
    # Diameter and pitch run off together at d_3 = d_f: what runs off is their difference.
    apart = c.seen.D_F - order * c.d * ((c.f - c.seen.d_3) / c.f)
    return (product(c.seen.d_2 * apart / c.f, ratio(c.seen.d_f - c.f, c.seen.gap)) - order * c.d) / c.q


class _Matched(NamedTuple):
    """Length that makes the f-numbers match."""

    value: Array
    """The length [mm]; inf where there is none."""
    exists: NDArray[np.bool_]
    """Whether there is one."""


def matched(c: Camera, symbol: Literal["d_2", "D_F", "d", "d_3"], *, exact: bool = True) -> _Matched:
    """Solve Eq. 7, or Eq. 8 where not `exact`, for one length, the others held.

    Parameters
    ----------
    symbol : {"d_2", "D_F", "d", "d_3"}
        Which length.

    Returns
    -------
    Matched
        Each rule is linear in each length, so there is one solution or none: where it would have to be zero, negative,
        infinite, or put the FAP behind the lens or beyond the focal plane, the value is inf and `exists` False. D_F and
        d match images in the order in which they lie, d_2 and d_3 those in direct order.
    """
    de, d, d2, f, df, d3 = floats(
        c.seen.D_F, c.d, c.seen.d_2, c.f, c.seen.d_f, c.seen.d_3
    )  # as the main lens sees them
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
        if not c.chain.in_air:
            # Behind a lens the FAP is seen in another size wherever it stands: no rule that is linear in d_3.
            stands = np.full(np.shape(length), np.nan) if c.chain.bends else c.chain.stands_at(c.numbers, length)
            length = np.asarray(stands)
            exists = exists & np.isfinite(length)
        return _Matched(np.where(exists, length, np.inf)[()], exists)
    bend = (f - d3) / f if exact else np.zeros(())
    if symbol == "d_2":
        length, image = ratio(c.seen.A, de / d - bend) + (c[PATHS["d_2"]] - c.seen.d_2), de > 0
    elif symbol == "D_F":
        length = d * magnitude(ratio(c.seen.A, d2) + bend) * c.fap.scale
    else:
        length = ratio(de * d2, magnitude(c.seen.A + product(d2, bend)))
    exists = image & (length > 0) & np.isfinite(length)
    return _Matched(np.where(exists, length, np.inf)[()], exists)
