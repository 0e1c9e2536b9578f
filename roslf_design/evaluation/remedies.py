"""Remedies: one length of a camera that alone mends what it is judged by, in digits that do when they are typed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..camera import Camera
from ..design import PATHS
from ..theory import tube
from ..theory.focused import is_focused
from ..theory.quantity import Depth, Quantity

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


def reaching(camera: Camera, quantity: Quantity, at: Depth, low: float | None, high: float | None) -> str:
    """Sentence on changes of d_2, D_F or d_3, each the least, that alone bring a quantity within limits; or empty."""

    def within(least: float | None, most: float | None) -> Holds:
        return lambda changed: quantity.within(least, most, quantity(changed, at))

    rises = low is not None and not quantity.within(low, None, quantity(camera, at))
    missed = within(low, None) if rises else within(None, high)
    found = {symbol: value for symbol in SYMBOLS if (value := _nearest_length(camera, symbol, missed)) is not None}
    ways = ways_of(camera, found, within(low, high))
    several = f"any one of these alone does: {', '.join(ways)}"
    return several if len(ways) > 1 else "".join(f"{way} alone does" for way in ways)


def ways_of(camera: Camera, values: dict[str, float], holds: Holds) -> list[str]:
    """Lengths as a remedy prints them, of those that fit the bore: typed, each makes a camera hold what is wanted."""
    typed = {s: _typed(camera, s, value, holds) for s, value in values.items() if _stands(camera, s, value)}
    return [_way(camera, symbol, text) for symbol, text in typed.items() if text]


def _nearest_length(camera: Camera, symbol: str, holds: Holds) -> float | None:
    """Length nearest to a camera's own with which it holds; None where none that was tried does."""
    now = float(camera[PATHS[symbol]])
    if not now > 0:
        return None
    longer = np.geomspace(1, REACH, PLACES)
    tried = now * np.ravel([1 / longer, longer], order="F")
    return nearest_holding(lambda values: _held(camera, symbol, values, holds), tried, now)


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


def _held(camera: Camera, symbol: str, values: Array, holds: Holds) -> NDArray[np.bool_]:
    with np.errstate(all="ignore"):  # of lengths that make no camera
        changed = camera.replace({symbol: values})
        return np.broadcast_to(np.asarray(holds(changed)) & np.asarray(changed.valid), values.shape)


def _typed(camera: Camera, symbol: str, value: float, holds: Holds) -> str:
    """The value's digits on the side that holds; empty where no rounding of it does."""
    for digits in range(DIGITS, MOST_DIGITS + 1):
        step = 10.0 ** (math.floor(math.log10(value)) + 1 - digits)
        texts = [f"{turn(value / step) * step:.{digits}g}" for turn in (math.floor, math.ceil)]
        held = _held(camera, symbol, np.array([float(text) for text in texts]), holds)
        for text in (text for text, good in zip(texts, held.tolist(), strict=True) if good):
            return text
    return ""


def _stands(camera: Camera, symbol: str, value: float) -> bool:
    """Whether the FAP would go through tube and lens, or stand in no glass, or glass before the sensor have room."""
    if symbol == "d_3":
        return not any(part.start < value < part.end for part in camera.in_bore)
    if symbol == "d_2":
        return value >= sum(float(camera[f"{plate}.thickness"]) for plate in camera.chain.plates_behind)
    return value <= float(tube.widest_fap(camera))


def _way(camera: Camera, symbol: str, text: str) -> str:
    """Length that does, with the f_ml that keeps the microlenses on the pupil where their own would not."""
    way, changed = f"{symbol} = {text} mm", camera.replace({symbol: float(text)})
    if is_focused(camera) or not is_focused(changed):
        return way
    focal = float(camera.replace({symbol: float(text)}, in_focus=True).f_ml)
    return f"{way} with f_ml = {focal:.5g} mm" if 0 < focal < math.inf else f"{way}, out of the microlenses' focus"
