"""Axes of a picture: scales, ticks at round numbers, frame with labels, and the way back from pixels to values."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .svg import PLAIN, SMALL, Point, line, short, tag, text, text_width
from .theme import Theme

Floats = NDArray[np.float64]


LEGEND_ROW = 17.0
"""Height of a legend's row [px]."""


class Mapping(NamedTuple):
    """How a picture's pixels and its values belong together; both axes linear."""

    left: float
    top: float
    width: float
    height: float
    """Box that the values fill [px]."""
    x0: float
    x1: float
    """Values at the box's left and right edge."""
    y0: float
    y1: float
    """Values at its lower and upper edge."""

    def to_value(self, px: float, py: float) -> tuple[float, float]:
        """The values at a point of the picture, also outside the box."""
        x = self.x0 + (px - self.left) / self.width * (self.x1 - self.x0)
        y = self.y1 - (py - self.top) / self.height * (self.y1 - self.y0)
        return x, y

    def to_px(self, x: float, y: float) -> Point:
        """Where these values are [px]."""
        px = self.left + (x - self.x0) / (self.x1 - self.x0) * self.width
        py = self.top + (self.y1 - y) / (self.y1 - self.y0) * self.height
        return px, py

    def as_dict(self) -> dict[str, float]:
        """The same as plain numbers, for the browser."""
        return {name: float(value) for name, value in zip(self._fields, self, strict=True)}


class Picture(NamedTuple):
    """An SVG, and what its pixels mean where one may click or drag."""

    svg: str
    mapping: Mapping | None = None


class Scale(NamedTuple):
    """One axis: `low` and `high` are the values at its ends."""

    low: float
    high: float
    log: bool = False

    def share(self, value: Any) -> Any:
        """Where along the axis a value is, 0 to 1; for numbers and arrays."""
        if self.log:
            return np.log(np.asarray(value, float) / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def ticks(self, wanted: int = 6) -> list[float]:
        """Round numbers on the axis: about so many, or 1, 2, 5 of each decade as far as there is room."""
        return log_ticks(self.low, self.high, wanted) if self.log else round_ticks(self.low, self.high, wanted)


def round_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten within the two ends, about `wanted` of them and more than one."""
    rough = (high - low) / max(wanted, 1)
    if not (rough > 0 and math.isfinite(rough)):
        return [low]
    power = 10.0 ** math.floor(math.log10(rough))
    steps = [factor * power for factor in (0.1, 0.2, 0.5, 1, 2, 5, 10)]
    wide = next(k for k, step in enumerate(steps) if step >= rough * (1 - 1e-9))
    found = _multiples(low, high, steps[wide])
    # One number alone on an axis tells no scale.
    return found if len(found) > 1 else _multiples(low, high, steps[wide - 1])


def _multiples(low: float, high: float, step: float) -> list[float]:
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [step * k for k in range(first, last + 1)]


def log_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Powers of ten within the two ends, with their 2- and 5-fold where few decades are seen."""
    decades = math.log10(high / low)
    factors = (1, 2, 5) if decades <= wanted / 3 else (1,)
    stride = max(1, math.ceil(decades / max(wanted, 1)))
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found = [factor * 10.0**power for power in powers if power % stride == 0 for factor in factors]
    kept = [value for value in found if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
    return kept if len(kept) >= 2 else round_ticks(low, high, wanted)


class Plot(NamedTuple):
    """A box with two scales."""

    left: float
    top: float
    width: float
    height: float
    """[px]."""
    x: Scale
    y: Scale

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, width, height [px]."""
        return self.left, self.top, self.width, self.height

    @property
    def right(self) -> float:
        """[px]."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """[px]."""
        return self.top + self.height

    @property
    def mapping(self) -> Mapping:
        """Pixels to values, where both scales are linear."""
        return Mapping(*self.box, self.x.low, self.x.high, self.y.low, self.y.high)

    def at(self, x: float, y: float) -> Point:
        """Where a pair of values is [px]."""
        return self.left + float(self.x.share(x)) * self.width, self.bottom - float(self.y.share(y)) * self.height

    def along(self, x: Floats, y: Floats) -> list[Point]:
        """Where these pairs of values are [px]; those without a place are left out, far ones brought near."""
        with np.errstate(divide="ignore", invalid="ignore"):
            across = self.left + self.x.share(np.asarray(x, float)) * self.width
            up = self.bottom - self.y.share(np.asarray(y, float)) * self.height
        seen = ~(np.isnan(across) | np.isnan(up))
        # What lies far outside is cut off by the frame; browsers do not like very large coordinates.
        pairs = np.clip(np.stack([across[seen], up[seen]], -1), -1e4, 1e4)
        return [(float(a), float(b)) for a, b in pairs]


def frame(
    plot: Plot, theme: Theme, x_label: str, y_label: str, *, grid: bool = True, x_ticks: Iterable[float] | None = None,
    y_ticks: Iterable[float] | None = None, y_colour: str | None = None,
) -> str:  # fmt: skip
    """Axes with ticks and labels; `y_ticks` may be () for none.

    Labels stand below and, turned, to the left; leave 40 px below and 54 px to the left.
    """
    across = list(plot.x.ticks(_room(plot.width, 62, 3)) if x_ticks is None else x_ticks)
    up = list(plot.y.ticks(_room(plot.height, 34, 2)) if y_ticks is None else y_ticks)
    parts = []
    for value in across:
        px, _ = plot.at(value, plot.y.low)
        if grid:
            parts.append(line((px, plot.top), (px, plot.bottom), theme.grid))
        parts.append(line((px, plot.bottom), (px, plot.bottom + 4), theme.grey))
        parts.append(text((px, plot.bottom + 16), short(value), theme.ink, SMALL, "middle"))
    for value in up:
        _, py = plot.at(plot.x.low, value)
        if grid:
            parts.append(line((plot.left, py), (plot.right, py), theme.grid))
        parts.append(line((plot.left - 4, py), (plot.left, py), theme.grey))
        parts.append(text((plot.left - 7, py + 4), short(value), y_colour or theme.ink, SMALL, "end"))
    parts.append(line((plot.left, plot.bottom), (plot.right, plot.bottom), theme.grey))
    parts.append(line((plot.left, plot.top), (plot.left, plot.bottom), theme.grey))
    parts.append(text((plot.left + plot.width / 2, plot.bottom + 33), x_label, theme.ink, PLAIN, "middle"))
    if y_label:
        wide = max((text_width(short(value), SMALL) for value in up), default=0.0)
        place = max(13.0, plot.left - 14 - wide)
        parts.append(
            text((place, plot.top + plot.height / 2), y_label, y_colour or theme.ink, PLAIN, "middle", turned=True)
        )
    return tag("g", "".join(parts))


def _room(length: float, each: float, least: int) -> int:
    """How many ticks a length has room for."""
    return max(least, int(length / each))


def legend(entries: Iterable[tuple[str, str]], theme: Theme, width: float) -> tuple[str, float]:
    """Marks with their names in rows, broken at a width.

    Parameters
    ----------
    entries : iterable of (mark, name)
        A mark is drawn about (0, 0), 22 px wide.
    theme : Theme
    width : float
        [px].

    Returns
    -------
    (elements, height)
        Elements from (0, 0) to the right and downwards; height of all rows [px].
    """
    x, y, parts = 0.0, 0.0, []
    for mark, name in entries:
        wide = 27 + text_width(name, SMALL)
        if x > 0 and x + wide > width:
            x, y = 0.0, y + LEGEND_ROW
        parts.append(tag("g", mark, transform=f"translate({x + 11:.1f} {y + 8:.1f})"))
        parts.append(text((x + 27, y + 12), name, theme.ink, SMALL))
        x += wide + 14
    return "".join(parts), y + LEGEND_ROW


def moved(content: str, x: float, y: float) -> str:
    """Elements elsewhere [px]."""
    return tag("g", content, transform=f"translate({x:.1f} {y:.1f})")
