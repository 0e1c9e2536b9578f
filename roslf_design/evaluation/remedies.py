"""Remedies: one length of a camera that alone mends what it is judged by, in digits that do when they are typed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..bore.part import TEMPERATURE
from ..camera import TEMPERATURES, Camera
from ..design import PATHS
from ..theory import tube
from ..theory.f_number import fill_factor, mismatch_px
from ..theory.focused import is_focused
from ..theory.quantity import Depth, Quantity
from ..words import listed

SLACK_PX = 0.5
"""Overlap or gap of neighbouring microlens images that still counts as matched [px]."""
OVERLAP_SLACK, GAP_SLACK = 0.01, 0.05
"""Slacks as shares of the pitch, where that allows more: overlap mixes views, a gap only wastes pixels."""
MATCH = "the f-number match"
"""Name of what `is_matched` judges."""
Holds = Callable[[Camera], NDArray[np.bool_]]
"""Whether cameras are as wanted, each of several builds."""
SYMBOLS = ("d_2", "D_F", "d_3")
"""Lengths that are changed, one at a time."""
REACH, PLACES = 4.0, 9
"""Factor that a length is changed by at most, and into how many steps that is cut, either way."""
BETWEEN, ROUNDS = 17, 10
"""Lengths that are tried at once between one with which something holds and one with which it does not, how often."""
DIGITS, MOST_DIGITS = 5, 9
"""Digits of a remedy, and those that it has where no fewer do."""


def reaching(
    camera: Camera,
    quantity: Quantity,
    at: Depth,
    low: float | None,
    high: float | None,
    others: Mapping[str, Holds] = MappingProxyType({}),
) -> str:
    """Sentence on changes of d_2, D_F or d_3, each the least, that alone bring a quantity within limits; or empty.

    A change names those `others`, by their words, that hold now and would no longer.
    """

    def within(least: float | None, most: float | None) -> Holds:
        return lambda changed: quantity.within(least, most, quantity(changed, at))

    rises = low is not None and not quantity.within(low, None, quantity(camera, at))
    missed = within(low, None) if rises else within(None, high)
    found = {symbol: value for symbol in SYMBOLS if (value := _nearest_length(camera, symbol, missed)) is not None}
    kept = {words: holds for words, holds in others.items() if holds(camera)}
    ways = ways_of(camera, found, within(low, high), kept)
    several = f"any one of these alone does: {', '.join(ways)}"
    return several if len(ways) > 1 else "".join(f"{way} alone does" for way in ways)


def is_matched(camera: Camera) -> NDArray[np.bool_]:
    """Whether microlens images just touch, to `SLACK_PX` or a share of the pitch."""
    gap = fill_factor(camera) - 1
    close = np.abs(mismatch_px(camera)) <= SLACK_PX
    return np.asarray(((gap >= -GAP_SLACK) & (gap <= OVERLAP_SLACK)) | close)


def ways_of(
    camera: Camera, values: dict[str, float], holds: Holds, kept: Mapping[str, Holds] = MappingProxyType({})
) -> list[str]:
    """Lengths as a remedy prints them, of those that fit the bore: typed, each makes a camera hold what is wanted.

    They are those at 20 degrees C, as files have them; what each spoils of what is `kept` now stands beside it.
    """
    drawn = {s: _drawn(camera, s, value) for s, value in values.items() if _stands(camera, s, value)}
    typed = {s: _typed(camera, s, value, holds) for s, value in drawn.items()}
    return [_way(camera, symbol, text, kept) for symbol, text in typed.items() if text]


def _used(camera: Camera, symbol: str, values: ArrayLike) -> Camera:
    """Cameras with lengths at 20 degrees C, at the temperature, and in the range, of a camera."""
    warmth = {place: camera[place] for place in (TEMPERATURE, *TEMPERATURES[:2]) if place in camera.numbers}
    return camera.cold.replace({symbol: values}).replace(warmth)


def _drawn(camera: Camera, symbol: str, value: float) -> float:
    """Length at 20 degrees C that a camera's temperature makes the one given."""
    drawn = value
    for _ in range(ROUNDS if camera.cold is not camera else 0):
        drawn += value - float(_used(camera, symbol, drawn)[PATHS[symbol]])
    return drawn


def _nearest_length(camera: Camera, symbol: str, holds: Holds) -> float | None:
    """Length nearest to a camera's own with which it holds; None where none that was tried does."""
    now = float(camera[PATHS[symbol]])
    if not now > 0:
        return None
    longer = np.geomspace(1, REACH, PLACES)
    tried = now * np.ravel([1 / longer, longer], order="F")
    return nearest_holding(
        lambda values: _held(lambda: camera.replace({symbol: values}), values.shape, holds), tried, now
    )


def nearest_holding(holds: Callable[[Array], NDArray[np.bool_]], tried: Array, now: float) -> float | None:
    """Value up to which it holds towards today's, from the first tried one with which it does; None without one."""
    held = np.flatnonzero(holds(tried))
    if not held.size:
        return None
    inside, outside = float(tried[held[0]]), now
    for _ in range(ROUNDS):
        between = np.linspace(inside, outside, BETWEEN)
        last = int(np.argmin(holds(between))) - 1
        inside, outside = float(between[last]), float(between[last + 1])
    return inside


def _held(cameras: Callable[[], Camera], shape: tuple[int, ...], holds: Holds) -> NDArray[np.bool_]:
    with np.errstate(all="ignore"):  # of lengths that make no camera
        changed = cameras()
        return np.broadcast_to(np.asarray(holds(changed)) & np.asarray(changed.valid), shape)


def _typed(camera: Camera, symbol: str, value: float, holds: Holds) -> str:
    """The value's digits on the side that holds; empty where no rounding of it does."""
    for digits in range(DIGITS, MOST_DIGITS + 1):
        step = 10.0 ** (math.floor(math.log10(value)) + 1 - digits)
        texts = [f"{turn(value / step) * step:.{digits}g}" for turn in (math.floor, math.ceil)]
        held = _held(partial(_used, camera, symbol, [float(text) for text in texts]), (2,), holds)
        for text in (text for text, good in zip(texts, held.tolist(), strict=True) if good):
            return text
    return ""


def _stands(camera: Camera, symbol: str, value: float) -> bool:
    """Whether the FAP would go through tube and lens, behind a tip that is another's and in no glass, or plates fit."""
    if symbol == "d_3":
        ahead = float(camera[PATHS["d_3"]]) < float(camera.tip) < value
        return not ahead and not any(part.start < value < part.end for part in camera.in_bore)
    if symbol == "d_2":
        return value >= sum(float(camera[f"{plate}.thickness"]) for plate in camera.chain.plates_behind)
    return value <= float(tube.widest_fap(camera))


def _way(camera: Camera, symbol: str, text: str, kept: Mapping[str, Holds]) -> str:
    """Length that does, with the f_ml that keeps the microlenses on the pupil where their own would not."""
    way, changed = f"{symbol} = {text} mm", _used(camera, symbol, float(text))
    if is_focused(changed) and not is_focused(camera):
        focal = float(camera.replace({symbol: float(text)}, in_focus=True).f_ml)
        way += f" with f_ml = {focal:.5g} mm" if 0 < focal < math.inf else ", out of the microlenses' focus"
    if spoilt := [words for words, holds in kept.items() if not holds(changed)]:
        fill = f": image fill {float(fill_factor(changed)):.3g}" if MATCH in spoilt else ""
        way += f" [spoils {listed(spoilt)}{fill}]"
    return way
