"""Disparities by light that microlenses share, and how much more they err than by light of their own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..calibration.decoding import LightField
from .bends import straightened
from .estimate import DisparityMap, PixelNoise, saturated
from .geometry import GridGeometry, Viewing
from .unmixing import PreparedViews

Array = NDArray[np.float64]

ROUNDS, SETTLED = 10, 0.1
"""Rounds at most in which disparities and picture settle; change of the former that ends them, over their error."""
TURNING = -2.0, 0.6
"""Bounds of how far a round goes back to the one before: of what comes back by factors of -1.5 to 2/3."""
DULLED, ASKED, ANSWERS = 0.05, 0.05, (-1.0, 0.7)
"""Share of a view's samples that are saturated from which light that it shares is left out; error of the disparities
that say what neighbours send which asks for what comes of it [pitches], and bounds of what may, over it."""
DRAWN, MOST_DRAWN, RELAXED, DRAWN_ROUNDS = 6_000, 80, 2 / 3, 12
"""Microlenses, about, for which noise is drawn, which tell its variance to some 5 %, and along each side at most; share
of each round by which that settles, and how many it has for it."""


def with_shared_light(
    field: LightField, noise: PixelNoise, viewing: Viewing, looks: PreparedViews, views: PreparedViews,
    disparities: DisparityMap, estimate: Callable[..., DisparityMap],
) -> tuple[PreparedViews, DisparityMap]:  # fmt: skip
    """Views and disparities once light that microlenses share tells them too.

    What neighbours send follows from the picture and the disparities before, in rounds until these are those found, as
    views that share light show another picture. What is off comes back with the other sign by the picture, with either
    by disparities: each round goes as far as two before it say that it has to (secants; Anderson 1965, of depth one).
    An error of the disparities makes c times as much in those found, which one more round shows, by others of the same
    picture. What windows take off a bent surface would come back as well, and is given back first.
    """
    start = disparities.begun
    if isinstance(viewing, GridGeometry) or start is None:  # cameras share no light
        return views, disparities
    dull, dark = saturated(field.values, field.weight, noise).mean((2, 3)) > DULLED, start.dark
    latest, lit, at = disparities, views, np.stack([start.disparity, start.picture])
    made, off, scale = at, np.zeros_like(at), np.ones((2, 1))

    def round_by(aside: float) -> tuple[PreparedViews, DisparityMap] | None:
        smooth = ndimage.median_filter(at[0], disparities.window)
        straight = straightened(np.where(dark, np.nan, smooth), disparities.window, disparities.error, 2)
        shared = viewing.with_shared(field, looks, np.where(dark, smooth, straight) + aside, at[1])
        if shared is None:
            return None
        bright = np.where(dull[..., None, None], 0, shared.field.weight)
        asked = shared._replace(field=replace(shared.field, weight=bright))
        return asked, estimate(asked.field, asked.pupil, aside=asked.aside, begun=latest.begun)

    for number in range(ROUNDS):
        by_round = round_by(0.0)
        if by_round is None:
            return views, disparities
        lit, latest = by_round
        if latest.begun is None or not (known := latest.measured).any():
            return views, disparities
        before, made = made, np.stack([latest.begun.disparity, latest.begun.picture])
        last, off = off, made - at
        if number == ROUNDS - 1 or np.median(np.abs(off[0][known])) < SETTLED * latest.error:
            break  # `at` is what these were found by
        if number == 0:
            scale = np.sqrt(np.square(off[:, known]).mean(1, keepdims=True))
        step, now = (part[:, known] / np.maximum(scale, 1e-12) for part in (off - last, off))
        back = float((step * now).sum() / max(float(np.square(step).sum()), 1e-12)) if number else 0.0
        at = made - np.clip(back, *TURNING) * (made - before)
    found, by_other = latest, round_by(ASKED)
    assert by_other is not None
    other = by_other[1]
    both = found.measured & other.measured
    if not both.any():
        return views, disparities
    c = float(np.clip(np.median((other.disparity - found.disparity)[both]) / ASKED, *ANSWERS))
    back = float(np.clip(c + viewing.returned(lit, float(np.median(found.disparity[both]))), *ANSWERS))
    sigma = math.sqrt(_shared_noise(c, back, disparities.window, both.shape)) * found.sigma
    names = ("disparity", "sigma", "status", "chi2", "views", "picture")
    maps: dict[str, Any] = {
        name: np.where(found.measured, sigma if name == "sigma" else getattr(found, name), getattr(disparities, name))
        for name in names
    }
    return lit, replace(disparities, **maps, begun=found.begun)


def _shared_noise(c: float, back: float, window: int, shape: tuple[int, int]) -> float:
    """Variance of disparities by shared light over that of samples each by itself, by noise drawn for a field of them.

    Pixels that two microlenses share pull both, by covariances whose sum over neighbours is -c of the variance: what
    they send is told by the same pixels. Errors of the disparities found are smoothed as `with_shared_light` smooths
    them, and come back through four neighbours, `back` times as large.
    """

    def neighbours(values: Array, axis: int) -> Array:
        return np.asarray(ndimage.correlate1d(values, [0.5, 0, 0.5], axis))

    shape = min(shape[0], MOST_DRAWN), min(shape[1], MOST_DRAWN)
    rng, squares = np.random.default_rng(0), np.zeros(2)
    for _ in range(math.ceil(DRAWN / math.prod(shape))):
        pulls = math.sqrt(1 - abs(c)) * rng.standard_normal(shape)
        for axis in (0, 1):
            two = [1, -math.copysign(1, c)]
            pulls += math.sqrt(abs(c) / 4) * ndimage.correlate1d(rng.standard_normal(shape), two, axis)
        latest = drawn = ndimage.uniform_filter(pulls, window)
        for _ in range(DRAWN_ROUNDS):
            assumed = straightened(ndimage.median_filter(latest, window), window, math.inf, 2)
            near = (neighbours(assumed, 0) + neighbours(assumed, 1)) / 2
            latest = latest + RELAXED * (drawn + back * ndimage.uniform_filter(near, window) - latest)
        squares += (latest**2).sum(), (drawn**2).sum()
    # Pulls alone have so much, as each neighbour but those beyond its rims is in the window.
    return float(squares[0] / squares[1]) * (1 - c * (1 - 1 / window))
