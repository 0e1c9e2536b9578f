"""What a picture is made of, as data: marks in a panel's own units, and panels with scales, ticks and labels.

A mark names its colour for `theme.Theme`; widths, sizes and shifts of text are pixels. Printers (`svg`, `axes`) draw.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..words import SYMBOL

Floats = NDArray[np.float64]
Point = tuple[float, float]
Box = tuple[float, float, float, float]

SMALL, PLAIN = 11, 12
"""Sizes of letters [px]; nothing is smaller."""
GLYPH = 0.56
"""Mean width of a letter as a share of its size."""


@dataclass(frozen=True, slots=True)
class Line:
    """A polyline; NaN breaks it."""

    x: ArrayLike
    y: ArrayLike
    colour: str = "ink"
    width: float = 1.3
    dash: str = ""
    """Lengths of dashes and gaps [px], as "7 4"."""
    ends: str = ""
    """"|" for ticks or "<>" for arrow heads at both ends, ">" for a head at its end."""
    opacity: float = 1.0
    clip: bool = True
    """Whether it ends at the panel's edge; so for all marks."""
    testid: str = ""
    """What tests find it by in SVG; so for all marks."""


@dataclass(frozen=True, slots=True)
class Area:
    """Polygons parted by NaN, what lies in two of them free; bars among them."""

    x: ArrayLike
    y: ArrayLike
    fill: str = "blue"
    opacity: float = 1.0
    """Of the filling."""
    edge: str = "none"
    width: float = 1.0
    dash: str = ""
    hatch: bool = False
    """Filled by slanting lines of the colour."""
    clip: bool = True
    testid: str = ""


@dataclass(frozen=True, slots=True)
class Disc:
    """A circle, in a panel with equal scales."""

    x: float
    y: float
    radius: float
    fill: str = "none"
    opacity: float = 1.0
    edge: str = "ink"
    width: float = 1.2
    dash: str = ""
    clip: bool = True
    testid: str = ""


@dataclass(frozen=True, slots=True)
class Dots:
    """Equal signs at places."""

    x: ArrayLike
    y: ArrayLike
    colour: str = "blue"
    shape: str = "o"
    """"o", "s", "D", "^", "v", "<", ">", "*", or of lines "x", "+", "|"."""
    size: float = 4.0
    """Radius [px]."""
    edge: str = "none"
    width: float = 1.4
    """Of the edge, or of a shape of lines [px]."""
    opacity: float = 1.0
    clip: bool = False
    testid: str = ""
    cursor: str = ""
    """A browser's cursor over it."""


@dataclass(frozen=True, slots=True)
class Text:
    """A line of text, its baseline at a place; d_3 gets its subscript."""

    x: float
    y: float
    text: str
    colour: str = "ink"
    size: float = SMALL
    anchor: str = "start"
    """Which of its "start", "middle" and "end" is there."""
    dx: float = 0.0
    dy: float = 0.0
    """Right and down from there [px]."""
    bold: bool = False
    halo: bool = False
    """With an edge of the ground's colour around the letters, for text over lines."""
    plate: bool = False
    """On a plate of the ground's colour."""
    turned: bool = False
    """Upwards."""
    clip: bool = False
    testid: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """Values as shades, row 0 at the bottom."""

    values: Floats
    """Shape (rows, columns)."""
    box: Box
    """Left, right, lower, upper end of the whole in the panel's units."""
    ramp: str = "grey"
    """As `Theme.shades` has it."""
    low: float = 0.0
    high: float = 1.0
    clip: bool = True
    testid: str = ""

    @property
    def shares(self) -> Floats:
        """Values on the ramp, 0 to 1."""
        return np.asarray((np.asarray(self.values, float) - self.low) / (self.high - self.low))


Mark = Line | Area | Disc | Dots | Text | Image


def bars(low: ArrayLike, high: ArrayLike, at: ArrayLike, thick: float, *, upright: bool = False, **look: Any) -> Area:
    """Bars from `low` to `high`, their middles at `at`; lying, or `upright`."""
    a, b, c = (np.atleast_1d(np.asarray(v, float)) for v in np.broadcast_arrays(low, high, at))
    gap = np.full(a.shape, np.nan)
    along = np.stack([a, b, b, a, gap], -1).ravel()[:-1]
    across = np.stack([c - thick / 2, c - thick / 2, c + thick / 2, c + thick / 2, gap], -1).ravel()[:-1]
    return Area(across, along, **look) if upright else Area(along, across, **look)


def whiskers(low: ArrayLike, high: ArrayLike, at: ArrayLike, *, upright: bool = False, colour: str = "ink") -> Line:
    """Error bars from `low` to `high`."""
    a, b, c = (np.atleast_1d(np.asarray(v, float)) for v in np.broadcast_arrays(low, high, at))
    gap = np.full(a.shape, np.nan)
    along, across = np.stack([a, b, gap], -1).ravel()[:-1], np.stack([c, c, gap], -1).ravel()[:-1]
    return Line(*((across, along) if upright else (along, across)), colour, 1.4, ends="|")


def where_above(values: ArrayLike, x: ArrayLike, y: ArrayLike, level: float) -> Floats:
    """Outlines of where values exceed a level, linear between points.

    Parameters
    ----------
    values : array_like, shape (M, N)
        Rows along y; NaN where there are none.
    x, y : array_like
        Shapes (N,) and (M,).
    level : float

    Returns
    -------
    ndarray, shape (K, 2)
        Corners of closed rings, holes among them, parted by NaN.
    """
    from contourpy import contour_generator

    known = np.ma.masked_invalid(np.asarray(values, float))
    if known.count() == 0 or known.max() <= level:
        return np.empty((0, 2))
    lines = contour_generator(x, y, known, fill_type="OuterOffset").filled(level, float(known.max()) + 1.0)
    rings: list[Floats] = []
    for corners, starts in zip(*lines, strict=True):
        for first, last in itertools.pairwise(starts.tolist()):
            rings += [corners[first:last], np.full((1, 2), np.nan)]
    return np.asarray(np.concatenate(rings[:-1]), float)


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
            return log_ticks(self.low, self.high, wanted)
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
    ticks = _multiples(low, high, steps[wide])
    # One number alone on an axis tells no scale.
    return ticks if len(ticks) > 1 else _multiples(low, high, steps[wide - 1])


def _multiples(low: float, high: float, step: float) -> list[float]:
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [step * k for k in range(first, last + 1)]


def log_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
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
    """Ticks with their numbers."""
    return tuple((value, short(value)) for value in values)


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
    """None for round numbers, () for none."""
    grid: str = "xy"
    """Lines behind the data at the ticks of "x", "y", both or ""."""
    right: bool = False
    """Whether the ordinate stands on the right."""
    y_colour: str = "ink"
    bare: bool = False
    """Without lines of axes."""
    equal: bool = False
    """Whether both scales are meant to be one, on Axes of any shape."""

    @property
    def right_edge(self) -> float:
        """[px]."""
        return self.box[0] + self.box[2]

    @property
    def bottom(self) -> float:
        """[px]."""
        return self.box[1] + self.box[3]

    @property
    def per_px(self) -> Point:
        """Units a pixel, to the right and upwards, on linear scales."""
        return (self.x.high - self.x.low) / self.box[2], (self.y.high - self.y.low) / self.box[3]

    def ticks(self) -> tuple[tuple[Tick, ...], tuple[Tick, ...]]:
        """Of both axes, as many as there is room for."""
        _, _, width, height = self.box
        x = named_ticks(self.x.ticks(max(3, int(width / 62)))) if self.x_ticks is None else self.x_ticks
        y = named_ticks(self.y.ticks(max(2, int(height / 34)))) if self.y_ticks is None else self.y_ticks
        return x, y

    def at(self, x: float, y: float) -> Point:
        """Where a pair of values is [px]."""
        left, _, width, height = self.box
        return left + float(self.x.share(x)) * width, self.bottom - float(self.y.share(y)) * height

    def all_at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """The same for arrays, shape (N, 2); far ones brought near, as browsers like no large coordinates."""
        left, _, width, height = self.box
        with np.errstate(over="ignore", invalid="ignore"):
            across = left + self.x.share(np.atleast_1d(np.asarray(x, float))) * width
            up = self.bottom - self.y.share(np.atleast_1d(np.asarray(y, float))) * height
        return np.asarray(np.clip(np.stack(np.broadcast_arrays(across, up), -1), -1e4, 1e4), float)

    def with_marks(self, *more: Mark) -> Panel:
        """The same with marks on top."""
        return replace(self, marks=(*self.marks, *more))


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

    def to_value(self, px: float, py: float) -> Point:
        """The values at a point of the picture, also outside the box."""
        x = self.x0 + (px - self.left) / self.width * (self.x1 - self.x0)
        y = self.y1 - (py - self.top) / self.height * (self.y1 - self.y0)
        return x, y

    def to_px(self, x: float, y: float) -> Point:
        """Where these values are [px]."""
        px = self.left + (x - self.x0) / (self.x1 - self.x0) * self.width
        py = self.top + (self.y1 - y) / (self.y1 - self.y0) * self.height
        return px, py


class Key(NamedTuple):
    """An entry of a legend."""

    text: str
    samples: tuple[Mark, ...]
    """About (0, 0), to the right and downwards, 22 px wide."""


def line_key(text: str, colour: str, width: float = 1.6, dash: str = "", *more: Mark) -> Key:
    """A legend's entry for a line, with further marks on it."""
    return Key(text, (Line((-11.0, 11.0), (0.0, 0.0), colour, width, dash), *more))


def box_key(text: str, fill: str, opacity: float = 1.0, edge: str = "none", width: float = 1.0, **more: Any) -> Key:
    """A legend's entry for an area."""
    corners = (-9.0, 9.0, 9.0, -9.0), (-5.0, -5.0, 5.0, 5.0)
    return Key(text, (Area(*corners, fill, opacity, edge, width, **more),))


def dot_key(text: str, colour: str, shape: str = "o", size: float = 4.5, **more: Any) -> Key:
    """A legend's entry for a sign."""
    return Key(text, (Dots((0.0,), (0.0,), colour, shape, size, **more),))


def shifted(mark: Mark, x: float, y: float) -> Mark:
    """A mark elsewhere in its panel; not for images."""
    assert not isinstance(mark, Image)
    if isinstance(mark, Disc | Text):
        return replace(mark, x=mark.x + x, y=mark.y + y)
    return replace(mark, x=np.asarray(mark.x, float) + x, y=np.asarray(mark.y, float) + y)


def xy(points: ArrayLike) -> tuple[Floats, Floats]:
    """X and y of points, shape (N, 2)."""
    x, y = np.asarray(points, float).reshape(-1, 2).T
    return x, y


def text_width(content: str, size: float = PLAIN) -> float:
    """About how wide a text is [px]."""
    # Of d_3 the underscore is not seen, and the index is small.
    return GLYPH * size * (len(content) - 1.2 * len(SYMBOL.findall(content)))


def wrapped(content: str, width: float, size: float = SMALL, most: int = 99) -> list[str]:
    """A text in lines no wider than `width` px; where there are more than `most`, the last ends in an ellipsis."""
    lines = [""]
    for word in content.split():
        longer = f"{lines[-1]} {word}".strip()
        if text_width(longer, size) <= width or not lines[-1]:
            lines[-1] = longer
        elif len(lines) < most:
            lines.append(word)
        else:
            lines[-1] = lines[-1].rstrip(" ,;:") + " …"
            break
    return lines


def short(value: float, digits: int = 4) -> str:
    """A number for people: `digits` significant digits, a power of ten only where it would be long."""
    if value == 0:
        return "0"
    if not math.isfinite(value):
        return "∞" if value > 0 else "−∞"
    if not 1e-4 <= abs(value) < 1e6:
        mantissa, power = f"{value:.{max(digits - 2, 0)}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{mantissa}×10{raised}".replace("-", "−")
    text = f"{value:.{digits}g}"
    if "e" in text:
        text = f"{float(text):.0f}"
    return text.replace("-", "−")


def rows_of_names(places: Sequence[float], widths: Sequence[float], gap: float = 0.0) -> list[int]:
    """Row of each name, from 0, such that no two touch; places are their middles, in order, in the widths' unit."""
    reached: list[float] = []
    rows = []
    for place, width in zip(places, widths, strict=True):
        row = next((r for r, end in enumerate(reached) if place - width / 2 > end), len(reached))
        reached[row : row + 1] = [place + width / 2 + gap]
        rows.append(row)
    return rows
