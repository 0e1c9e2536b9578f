"""Depth of field: between which planes a point spreads over no more than a microlens pitch, by rays on the axis.

A point at Z_F spreads over ``e |m - A/Z_F|`` of the array, e the width of the FAP that counts: all of it in the
refocused image, in a single view what its pixel sees of it, blurred by the microlens, ``(q + lambda d_2/d) A/d_2``.
Sharp is what stays within a pitch. In air, ``1/Z_F = (1 +- d/(e m))/(d_f - d_3)``.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from .._arrays import Array, magnitude, product, ratio
from ..camera import Camera, Number
from ..shapes.lattice import PACKINGS
from .light import diffraction_width

Kind = Literal["view", "refocused"]


class _DepthOfField(NamedTuple):
    """Ahead of the bore's tip [mm]."""

    near: Array
    """0 where everything up to the tip is sharp."""
    far: Array
    """inf where everything beyond is sharp."""


def _pupil_part(c: Camera, kind: Kind) -> Array:
    """Width e of the FAP that a point's light counts through, as the main lens sees it [mm]."""
    whole = magnitude(c.seen.D_F)
    if kind == "refocused":
        return whole
    by_view = product(c.q + diffraction_width(c), magnitude(ratio(c.seen.A, c.seen.d_2)))
    return np.asarray(np.where(np.real(by_view) < np.real(whole), by_view, whole))[()]


def view_blur(c: Camera, disparity: Number) -> Array:
    """Width over which a single view shows a point, by the disparity there [microlens pitches]."""
    return np.asarray(magnitude(disparity) * ratio(_pupil_part(c, "view"), magnitude(c.seen.D_F)))


def view_f_number(c: Camera) -> Array:
    """Working f-number of one view: an ordinary camera's at the array that is sharp as deep as views are, ``A/e``.

    A refocused image's is that of the FAP, ``pupil_f_number``.
    """
    return np.asarray(magnitude(ratio(c.seen.A, _pupil_part(c, "view"))))


def depth_of_field(c: Camera, kind: Kind = "refocused") -> _DepthOfField:
    """Nearest and farthest sharp plane about the focal plane.

    Parameters
    ----------
    kind : {"refocused", "view"}
        The image refocused to the focal plane, or a single view.
    """
    share = _share(c, kind)
    near, far = (
        np.asarray(c.plane_seen_at(c.seen.d_3 + ratio(c.seen.gap, 1 + sign * share)) - c.tip, float) for sign in (1, -1)
    )
    focus = np.asarray(c["main_lens.focal_plane"] - c.tip)
    # A plane that has gone past the tip, or past infinity, comes back on the other side.
    near = np.where((near >= 0) & (near <= focus), near, 0.0)
    far = np.where(far >= focus, far, np.inf)
    return _DepthOfField(near[()], far[()])


def finest_detail(c: Camera, at: float, near: float, far: float) -> float:
    """Finest detail at a distance that any camera shows in that light, whose images are sharp from `near` to `far`.

    A view's part of the FAP is ``lambda A/d`` wide at least, so ``1/near - 1/far <= 2 (d/A)^2/lambda``, both from the
    FAP: footprints s of a microlens at both ends have ``s s' >= lambda (far - near)/2``, wherever the FAP is. The one
    between is their mean by distance, at least ``sqrt(2 lambda (at - near) (far - at)/(far - near))``. A FAP narrower
    than that part shows, by its own diffraction, no finer detail either. In mm ahead of the tip, and lp/mm.
    """
    light = float(c.wavelength / np.asarray(c.front[1].medium))
    return PACKINGS[c.layout].fold / math.sqrt(2 * light * (at - near) * (far - at) / (far - near))


def past_infinity(c: Camera, kind: Kind = "refocused") -> Array:
    """-1 over the far end [1/mm]: 0 at infinity and rising on beyond, smooth where the far end is none."""
    inside = 1 - _share(c, kind)
    seen = c.seen.d_3 * inside + c.seen.gap
    place, front = c.front
    more = front.d * inside - front.c * seen
    less = front.medium * (front.a * seen - front.b * inside) + (place - c.tip) * more
    inverse = np.asarray(ratio(more, less), float)
    return np.where(np.isinf(depth_of_field(c, kind).far), np.abs(inverse), -inverse)[()]


def _share(c: Camera, kind: Kind) -> Array:
    """Change of 1/Z_F from the focal plane to an end, over its own at the focal plane."""
    share = ratio(c.d, product(_pupil_part(c, kind), magnitude(c.seen.m)))
    # Behind a relay the FAP may be seen beyond the focal plane: nearer planes then lie at larger Z_F.
    return np.asarray(share * np.where(np.real(c.seen.gap) < 0, -1.0, 1.0))


def hyperfocal(c: Camera, kind: Kind = "refocused") -> Array:
    """Nearest focal plane whose depth of field reaches infinity, the bore held [mm ahead of its tip].

    0 where that of every one ahead of the tip does, nan where none does.
    """
    front, lens = c.front[1], c.f - c.seen.d_3
    # sigma = (grow m - less)/ahead for what is far, falling with m towards the m that is focused there; A = f + m lens.
    # What is far is seen ahead/front.c before the FAP's image: 0 where object space is telecentric.
    ahead = front.d - front.c * c.seen.d_3
    grow, less = np.asarray(ahead - lens * front.c, float), np.asarray(c.f * front.c, float)
    turn, ahead = np.where(grow < 0, -1.0, 1.0), magnitude(ahead)
    by_all = ratio(ratio(c.d, magnitude(c.seen.D_F)) * ahead + turn * less, turn * grow)
    m, least = np.asarray(by_all), -1.0 if c.chain.bends else 0.0  # m at which d_1 is 0, and at which it is f
    if kind == "view":
        pixel = ratio(c.q + diffraction_width(c), c.seen.d_2) * np.where(np.real(c.seen.inverse_H) < 0, -1.0, 1.0)
        a, b = turn * grow * lens, turn * (grow * c.f - less * lens)
        rest = turn * less * c.f + ratio(c.d, pixel) * ahead
        root = b * b + 4 * a * rest
        by_view = ratio(2 * rest, b + np.where(b < 0, -1.0, 1.0) * np.sqrt(np.maximum(root, 0.0)))
        narrow = magnitude(pixel * (c.f + by_view * lens)) < magnitude(c.seen.D_F)
        m = np.where((root >= 0) & (by_view > least) & narrow, by_view, by_all)
    imaged = m > least
    vergence = np.where(imaged, m, 1.0) / (c.f * (1 + np.where(imaged, m, 1.0)))
    there = np.asarray(c.plane_of_vergence(vergence) - c.tip, float)
    # With none ahead of the tip all focal planes there are alike, this camera's own among them.
    alike = np.where(np.isinf(depth_of_field(c, kind).far), 0.0, np.nan)
    return np.asarray(np.where(imaged & (there > 0) & np.isfinite(there), there, alike))[()]
