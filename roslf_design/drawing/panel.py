"""Panels: scales with their ticks, marks in their units, and panels of one kind."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array
from .marks import Box, Image, Line, Mark, Point, Text
from .theme import SMALL, short, text_width


class Scale(NamedTuple):
    """One axis: `low` and `high` are the values at its ends."""

    low: float
    high: float
    log: bool = False

    def share(self, value: Any) -> Any:
        """Where along the axis a value is, 0 to 1; for numbers and arrays."""
        if self.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.log(np.asarray(value, float) / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def ticks(self, wanted: int = 6) -> list[float]:
        """Round numbers on the axis: about so many, or 1, 2, 5 of each decade as far as there is room."""
        if self.log:
            return _log_ticks(self.low, self.high, wanted)
        return round_ticks(min(self.low, self.high), max(self.low, self.high), wanted)

    @staticmethod
    def around(values: ArrayLike, room: float = 0.08) -> Scale:
        """A scale with some room on either side of the values."""
        known = np.asarray(values, float)
        known = known[np.isfinite(known)]
        low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
        more = room * (high - low) or 0.1 * abs(high) or 1.0
        return Scale(low - more, high + more)


def round_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten within the two ends, about `wanted` of them and more than one."""
    rough = (high - low) / max(wanted, 1)
    if not (rough > 0 and math.isfinite(rough)):
        return [low]
    power = 10.0 ** math.floor(math.log10(rough))
    steps = [factor * power for factor in (0.1, 0.2, 0.5, 1, 2, 5, 10)]
    wide = next(k for k, step in enumerate(steps) if step >= rough * (1 - 1e-9))
    ticks: list[float] = []
    for step in steps[wide::-1]:
        ticks = [step * k for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
        # One number alone on an axis tells no scale.
        if len(ticks) > 1:
            break
    return ticks


def _log_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Powers of ten within the two ends, with their 2- and 5-fold where few decades are seen."""
    decades = math.log10(high / low)
    factors = (1, 2, 5) if decades <= wanted / 3 else (1,)
    stride = max(1, math.ceil(decades / max(wanted, 1)))
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    known = [factor * 10.0**power for power in powers if power % stride == 0 for factor in factors]
    ticks = [value for value in known if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
    return ticks if len(ticks) >= 2 else round_ticks(low, high, wanted)


Tick = tuple[float, str]


def named_ticks(values: Iterable[float]) -> tuple[Tick, ...]:
    """Ticks with their numbers, each told from the others."""
    known = tuple(values)
    texts = ([short(value, digits, zero=0.0) for value in known] for digits in (4, 6, 8, 12))
    return tuple(
        zip(known, next((each for each in texts if len({*each}) == len({*known})), map(str, known)), strict=True)
    )


@dataclass(frozen=True)
class Panel:
    """A box with two scales, marks in their units, ticks and labels around it."""

    box: Box
    """Left, top, width, height in the picture [px]."""
    x: Scale
    y: Scale
    marks: tuple[Mark, ...] = ()
    x_label: str = ""
    y_label: str = ""
    title: str = ""
    x_ticks: tuple[Tick, ...] | None = None
    y_ticks: tuple[Tick, ...] | None = None
    """Ticks along y; None for round numbers, () for none."""
    grid: str = "xy"
    """Lines behind the data at the ticks of "x", "y", both or ""."""
    right: bool = False
    """Whether the ordinate stands on the right."""
    y_colour: str = "ink"
    bare: bool = False
    """True where the panel has no lines of axes."""
    equal: bool = False
    """Whether both scales are meant to be one, on Axes of any shape."""

    @property
    def bottom(self) -> float:
        """[px]."""
        return self.box[1] + self.box[3]

    @property
    def per_px(self) -> Point:
        """Units a pixel, to the right and upwards, on linear scales."""
        return (self.x.high - self.x.low) / self.box[2], (self.y.high - self.y.low) / self.box[3]

    def ticks(self) -> tuple[tuple[Tick, ...], tuple[Tick, ...]]:
        """Ticks of both axes, as many as there is room for."""
        _, _, width, height = self.box
        x = named_ticks(self.x.ticks(max(3, int(width / 62)))) if self.x_ticks is None else self.x_ticks
        y = named_ticks(self.y.ticks(max(2, int(height / 34)))) if self.y_ticks is None else self.y_ticks
        return x, y

    def at(self, x: float, y: float) -> Point:
        """Pixel of a pair of values [px]."""
        left, _, width, height = self.box
        return left + float(self.x.share(x)) * width, self.bottom - float(self.y.share(y)) * height

    def to_value(self, px: float, py: float) -> Point:
        """The values at a point of the picture, also outside the box; on linear scales."""
        across, up = self.per_px
        return self.x.low + (px - self.box[0]) * across, self.y.high - (py - self.box[1]) * up

    def all_at(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Pixels of arrays of values, shape (N, 2); far ones brought near, as browsers like no large coordinates."""
        left, _, width, height = self.box
        with np.errstate(over="ignore", invalid="ignore"):
            across = left + self.x.share(np.atleast_1d(np.asarray(x, float))) * width
            up = self.bottom - self.y.share(np.atleast_1d(np.asarray(y, float))) * height
        return np.asarray(np.clip(np.stack(np.broadcast_arrays(across, up), -1), -1e4, 1e4), float)

    def with_marks(self, *more: Mark) -> Panel:
        """Panel with marks on top."""
        return replace(self, marks=(*self.marks, *more))


def names_width(names: Iterable[str]) -> float:
    """Width of the widest of some names [px]."""
    return max((text_width(name, SMALL) for name in names), default=40.0)


def rows_panel(
    box: Box, x: Scale, names: Sequence[str], marks: Iterable[Mark], label: str, row: float = 24.0, bold: str = ""
) -> Panel:
    """Bars in rows with their names on the left, one of them bold; the ordinate counts pixels downwards."""
    written = [
        Text(x.low, row * (k + 0.5), name, "ink", SMALL, "end", dx=-7, dy=4, bold=name == bold)
        for k, name in enumerate(names)
    ]
    ticks = named_ticks(x.ticks(max(2, int(box[2] / 64))))
    return Panel(box, x, Scale(box[3], 0.0), (*marks, *written), label, grid="x", x_ticks=ticks, y_ticks=())


def threshold(x: float, tall: float, words: str, beside: float | None = None) -> list[Mark]:
    """A line through all rows, its name above it or at another abscissa."""
    line = Line([x, x], [-4.0, tall], "orange", 2, clip=False)
    at = x if beside is None else beside
    # Orange text has too little contrast on white.
    return [line, Text(at, 0.0, words, "lost", SMALL, "middle", dy=-8, bold=True)]


def colour_bar(panel: Panel, low: float, high: float, ramp: str, label: str, log: bool = False) -> Panel:
    """A bar beside a panel that says what its shades mean, those of logarithms where `log`."""
    left, top, width, height = panel.box
    shades = Image(np.linspace(low, high, 128)[:, None], (0.0, 1.0, low, high), ramp, low, high)
    box = (left + width + 8, top, 11.0, height)
    return Panel(box, Scale(0, 1), Scale(low, high, log), (shades,), y_label=label, x_ticks=(), grid="", right=True)
