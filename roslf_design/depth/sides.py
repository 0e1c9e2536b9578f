"""Sides of depth steps: windows that hold two surfaces, parted into those of the one and of the other."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .occlusion import sides_about
from .windows import DISPARITY, SharedLight, WindowFit, box

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SURE = 6.0
"""Standard errors of a jump between windows before and beyond a microlens from which a step lies about it, and of
disparities by which its two surfaces differ."""
_HALVES = (1, 0.0), (2, 0.2)
"""Windows' widths of those that are compared, and jumps from which they are believed [pitches]: a ball bends such wide
ones by up to 0.14."""
_HELD, _ALIKE = 0.55, 0.75
"""Share of their microlenses that windows must hold, as those at the field's rim look past it; and of the fuller one's
that the other must: slopes of unlike ones count unlike, and a bend would pass for a step."""
_AT_ODDS = 3.0
"""Chi-square of disparities about the plane from which a window is no surface's."""
_WIDE = 3
"""Windows' widths of those that tell slopes."""
_PARTED, _VOTE = 3, 9.0
"""Side of the windows whose views tell which surface a microlens sees [microlenses], and half the chi-square from which
they do, three standard errors. A microlens says no more by itself: the edge is seen by all about it. Where they do not,
windows of the size wanted do."""
_FATTER = 3
"""Microlenses along the edge of the nearer surface that are not believed to be its own: the edge moves with it, so that
one or two of the farther seem to as well, and as many show some of both."""
_MIXED = 2
"""Microlenses along the edge of the farther surface that show some of both, as far as interpolation tells."""
_LEAK, _LEAKS = 0.03, 5
"""Error of the farther surface by the other's edge that moves across it, over what they differ by, and microlenses from
the edge up to which it has it: so much it was beside steps of half a pitch of four cameras, by the columns of
microlenses along them; farther on, and on the nearer side, there was none of it."""


def _middle(t: Array) -> tuple[Array, ...]:
    """Mean disparity of windows by their sums, its place (2) and variance, and scatter about it.

    That of places (uu, uv, vv), of these with the disparities (2), and of the disparities that microlenses ask for.
    """
    sharp = np.maximum(t[0], 1e-9)
    mean, u, v = t[6] / sharp, t[1] / sharp, t[2] / sharp
    variance = np.where(t[0] > 0.05 * t[9], t[9] / sharp**2, math.inf)
    square = t[12] - 2 * t[13] + t[14] + mean**2 * t[9] - 2 * mean * (t[11] - t[10])
    scatter = t[3] - u * t[1], t[4] - u * t[2], t[5] - v * t[2], t[7] - u * t[6], t[8] - v * t[6]
    return mean, u, v, variance, *scatter, square


def steps(terms: Array, window: int) -> Flags:
    """True of microlenses before and beyond which windows of any of `_HALVES` differ most, and surely, from one plane.

    Both share slopes, so that neither slopes nor bends of a surface count, and none that is at odds with itself knows
    more than it shows. `terms` as `SharedLight.terms`.
    """
    found = np.zeros(terms.shape[1:], np.bool_)
    for times, smallest in _HALVES:
        half = times * window | 1
        near, gap = box(terms, half), half // 2 + 1
        before_these = found.copy()
        for axis in (1, 0):
            size = found.shape[axis] - 2 * gap
            if size < window:
                continue
            halves = [np.take(near, range(start, start + size), axis + 1) for start in (0, 2 * gap)]
            (before, *first), (beyond, *second) = (_middle(half) for half in halves)
            uu, uv, vv, ub, vb = (one + other for one, other in zip(first[3:8], second[3:8], strict=True))
            whole = np.maximum(uu * vv - uv**2, 1e-9)
            along, down = (ub * vv - vb * uv) / whole, (vb * uu - ub * uv) / whole
            u, v = second[0] - first[0], second[1] - first[1]
            jump = np.abs(beyond - before - along * u - down * v)
            # The picture's own noise lends slopes no information, but noise.
            lent = np.add(halves[0][9], halves[1][9]) / np.maximum(halves[0][0] + halves[1][0], 1e-9)
            variance = first[2] + second[2] + lent * (u**2 * vv - 2 * u * v * uv + v**2 * uu) / whole
            odds = [
                (part[8] - 2 * (along * part[6] + down * part[7]) + along**2 * part[3] + 2 * along * down * part[4]
                 + down**2 * part[5]) / np.maximum(half[18] - 3, 1)
                for half, part in zip(halves, (first, second), strict=True)
            ]  # fmt: skip
            strain = np.maximum(1, np.maximum(*odds))
            least, fullest = (pick(halves[0][18], halves[1][18]) for pick in (np.minimum, np.maximum))
            some = (least > _HELD * half**2) & (least > _ALIKE * fullest)
            surely = np.where(some & (strain < _AT_ODDS), jump / np.sqrt(strain * np.maximum(variance, 1e-30)), 0)
            most = surely == ndimage.maximum_filter1d(surely, 4 * gap + 1, axis)
            # Halves that hold the step themselves differ as well.
            beside = [4 * gap + 1 if k == axis else window for k in (0, 1)]
            elsewhere = ~ndimage.binary_dilation(before_these, np.ones(beside, np.bool_))
            inner = [slice(None)] * 2
            inner[axis] = slice(gap, gap + size)
            found[tuple(inner)] |= (surely > _SURE) & (jump > smallest) & most & elsewhere[tuple(inner)]
    return found


class Parted(NamedTuple):
    """Windows about depth steps, each of the microlenses on one side alone."""

    about: Flags
    """Windows of these microlenses, or those that tell their slopes, hold both surfaces."""
    beside: Flags
    """Own windows of these may as well."""
    unsure: Flags
    """Microlenses beside the edge of the nearer surface, which of the two is not known of."""
    leak: Array
    """Error of the farther surface by the other's edge [pitches]."""
    fit: WindowFit
    """Windows of the side that each microlens lies on."""
    change: Array
    """Disparity less the one that `fit` is linearised about."""


def parted(
    look: SharedLight, fit: WindowFit, window: int, error: float, again: Callable[[Array], SharedLight]
) -> Parted | None:
    """Windows about depth steps by sides; None where there is no step.

    What views show along either surface, by what is known aside of the step, tells which of the two each microlens
    sees. `error` is that of disparities, `again` looks along others.
    """
    stepped = steps(look.terms, window)
    if not stepped.any():
        return None
    full = np.ones((window, window), np.bool_)
    stepped = ndimage.binary_dilation(stepped, full, iterations=2)
    near = ndimage.binary_dilation(stepped, full, iterations=4)
    known = np.where(~stepped & np.isfinite(fit.sigma), fit.disparity, np.nan)
    sides = sides_about(known, near, 4 * window, _SURE * error)
    both = np.isfinite(sides).all(0)
    if not both.any():
        return None
    looks, step = [again(np.where(both, side, np.nan)) for side in sides], sides[1] - sides[0]
    each = np.clip(looks[0].sums[9] - looks[1].sums[9], -_VOTE, _VOTE)
    votes, wider = (box(each, size) for size in (_PARTED, window))
    votes = np.where(np.abs(votes) < 2 * _VOTE, wider, votes)
    nearer = both & np.where(stepped | np.isnan(known), votes > 0, known > sides.mean(0))
    nearer = both & (ndimage.median_filter(nearer.view(np.uint8), window) > 0)
    front, back = (ndimage.distance_transform_cdt(part | ~both, "chessboard") for part in (nearer, ~nearer))
    away = np.where(nearer, front, back)
    unsure = (nearer & (front < _FATTER)) | ((away <= _PARTED) & (np.abs(votes) < 2 * _VOTE))
    counted = both & ~nearer & (back > _MIXED + step / 2) & ~unsure, nearer & (front > _FATTER) & ~unsure
    farther, fore = (WindowFit.of(one, window, some) for one, some in zip(looks, counted, strict=True))
    maps = np.where(nearer, fore.maps, farther.maps)
    leaky, whole = (box(part.astype(float), window) for part in (counted[0] & (back <= _LEAKS), counted[0]))
    leak = np.where(nearer, 0, _LEAK * step * leaky / np.maximum(whole, 1))
    about, beside = (both & (away <= width // 2 + _FATTER) for width in (_WIDE * window, window))
    change = maps[DISPARITY] - np.where(nearer, *sides[::-1])
    return Parted(about, beside, unsure, leak, WindowFit(*maps), change)
