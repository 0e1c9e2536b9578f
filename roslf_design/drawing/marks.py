"""Marks that a picture is made of, in a panel's own units, as data; and samples of them for legends.

A mark names its colour for `theme.Theme`; widths, sizes and shifts of text are pixels. Printers (`svg`, `axes`) draw.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array
from .theme import SMALL, text_width

Point = tuple[float, float]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drawn:
    """Fields common to all marks."""

    clip: bool = True
    """Whether it ends at the panel's edge."""
    testid: str = ""
    """Identifier by which tests find it in SVG."""


@dataclass(frozen=True, slots=True)
class Line(_Drawn):
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


@dataclass(frozen=True, slots=True)
class Area(_Drawn):
    """Polygons parted by NaN, what lies in two of them free; bars among them."""

    x: ArrayLike
    y: ArrayLike
    fill: str = "blue"
    opacity: float = 1.0
    """Opacity of the filling."""
    edge: str = "none"
    width: float = 1.0
    dash: str = ""
    hatch: bool = False
    """Filled by slanting lines of the colour."""


@dataclass(frozen=True, slots=True)
class Disc(_Drawn):
    """A circle, in a panel with equal scales."""

    x: float
    y: float
    radius: float
    fill: str = "none"
    opacity: float = 1.0
    edge: str = "ink"
    width: float = 1.2
    dash: str = ""


@dataclass(frozen=True, slots=True)
class Dots(_Drawn):
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
    """Width of the edge, or of a shape of lines [px]."""
    opacity: float = 1.0
    clip: bool = field(default=False, kw_only=True)
    cursor: str = ""
    """A browser's cursor over it."""


@dataclass(frozen=True, slots=True)
class Text(_Drawn):
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
    """True where the text has a plate of the ground's colour behind it."""
    clip: bool = field(default=False, kw_only=True)


@dataclass(frozen=True, slots=True, eq=False)
class Image(_Drawn):
    """Values as shades, row 0 at the bottom."""

    values: Array
    """Shape (rows, columns)."""
    box: Box
    """Left, right, lower, upper end of the whole in the panel's units."""
    ramp: str = "grey"
    """Ramp of shades, as `Theme.shades` has it."""
    low: float = 0.0
    high: float = 1.0

    @property
    def shares(self) -> Array:
        """Values on the ramp, 0 to 1."""
        return np.asarray((np.asarray(self.values, float) - self.low) / (self.high - self.low))


Mark = Line | Area | Disc | Dots | Text | Image


def parted(rows: ArrayLike) -> Array:
    """Rows, shape (N, K), one after the other with NaN between: many polylines or polygons as one mark."""
    each = np.asarray(rows, float)
    return np.hstack([each, np.full((len(each), 1), np.nan)]).ravel()[:-1]


def bars(low: ArrayLike, high: ArrayLike, at: ArrayLike, thick: float, **look: Any) -> Area:
    """Lying bars from `low` to `high`, their middles at `at`."""
    a, b, c = (np.atleast_1d(np.asarray(v, float)) for v in np.broadcast_arrays(low, high, at))
    t = thick / 2
    return Area(parted(np.stack([a, b, b, a], -1)), parted(np.stack([c - t, c - t, c + t, c + t], -1)), **look)


def stairs(cuts: ArrayLike, heights: ArrayLike) -> tuple[Array, Array]:
    """Outline of a histogram: N + 1 cuts and N heights."""
    return np.repeat(cuts, 2), np.concatenate([[0.0], np.repeat(heights, 2), [0.0]])


def where_above(values: ArrayLike, x: ArrayLike, y: ArrayLike, level: float) -> Array:
    """Outlines of where values exceed a level, linear between points: rings, holes among them, parted by NaN.

    Values have rows along y, shape (M, N), NaN where there are none; corners have shape (K, 2).
    """
    from contourpy import contour_generator

    known = np.ma.masked_invalid(np.asarray(values, float))
    if known.count() == 0 or known.max() <= level:
        return np.empty((0, 2))
    lines = contour_generator(x, y, known, fill_type="OuterOffset").filled(level, float(known.max()) + 1.0)
    return joined(ring for each, starts in zip(*lines, strict=True) for ring in np.split(each, starts[1:-1]))


LABELLED = 0.15
"""Share of a map's width or height from which a line of equal values has its number."""
INSIDE = 0.46
"""Distance from a map's middle, over its width or height, within which the number stands."""
LABEL_TALL = 18.0
"""Height that a number on a line takes [px]."""


def contours(
    values: ArrayLike, x: ArrayLike, y: ArrayLike, levels: Iterable[tuple[float, str, tuple[str, float, str]]],
    size: Point, kept: Sequence[Point] = (),
) -> list[Line | Text]:  # fmt: skip
    """Lines of equal values, each with its number and its look, those of mere corners without the number.

    Values are as for `where_above`. A number stands on its line as near the middle as it is inside the map, on none of
    those before it and on no place that is `kept` free; `size` is that from the first points to the last [px].
    """
    from contourpy import contour_generator

    made = contour_generator(x, y, np.ma.masked_invalid(np.asarray(values, float)), name="serial")
    sides = np.array([[np.min(x), np.min(y)], [np.max(x), np.max(y)]], float)
    middle, spans = sides.mean(axis=0), np.where(np.ptp(sides, axis=0) > 0, np.ptp(sides, axis=0), 1.0)
    px = np.array(size)
    taken = [(*map(float, (np.array(place) - middle) / spans * px), LABEL_TALL / 2) for place in kept]
    marks: list[Line | Text] = []
    for level, text, (colour, width, dash) in levels:
        runs = [np.asarray(run) for run in made.lines(level)]
        if not runs:
            continue
        longest = max(runs, key=len)
        marks.append(Line(*xy(joined(runs)), colour, width, dash))
        if not (np.ptp(longest, axis=0) > LABELLED * spans).any():
            continue
        half = text_width(text, SMALL) / 2 + 5
        shares = (_close_points(longest, spans / px) - middle) / spans
        for share in shares[np.argsort(np.hypot(*shares.T), kind="stable")]:
            across, up = map(float, share * px)
            inside = float(np.clip(across, half - size[0] / 2, size[0] / 2 - half))
            free = all(abs(inside - a) > half + wide or abs(up - b) > LABEL_TALL for a, b, wide in taken)
            if abs(share[1]) < INSIDE and free:
                taken.append((inside, up, half))
                x_at, y_at = map(float, middle + share * spans)
                marks.append(Text(x_at, y_at, text, anchor="middle", dx=inside - across, dy=4.0, plate=True))
                break
    return marks


def _close_points(run: Array, per_px: Array) -> Array:
    """Points of a polyline and, where these are far apart, others between them, a few pixels from each other."""
    steps = np.hypot(*(np.diff(run, axis=0) / per_px).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], int(along[-1] / 4) + 2)
    return np.stack([np.interp(at, along, values) for values in run.T], -1)


def joined(runs: Iterable[Array]) -> Array:
    """Points of polylines or polygons, each of shape (N, 2), one after the other with NaN between."""
    return np.concatenate([np.empty((0, 2)), *(np.append(run, [[np.nan, np.nan]], axis=0) for run in runs)])[:-1]


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
    there: dict[str, Any] = {"x": np.add(mark.x, x), "y": np.add(mark.y, y)}
    return replace(mark, **there)


def xy(points: ArrayLike) -> tuple[Array, Array]:
    """X and y of points, shape (N, 2)."""
    x, y = np.asarray(points, float).reshape(-1, 2).T
    return x, y
