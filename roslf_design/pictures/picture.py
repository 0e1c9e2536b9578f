"""Pictures: panels on a ground with a legend and remarks, and how they are set beside and below each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from . import axes, svg
from .lettering import SMALL, text_width
from .marks import Box, Image, Key, Mark, Point, Text, shifted
from .panel import Panel, Scale
from .theme import ThemeName, theme_named

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = 768.0
"""Width of a picture that fills a report's page [px]."""
LEGEND_ROW = 17.0
"""Height of a legend's row [px]."""


@dataclass(frozen=True)
class Picture:
    """A whole picture, before it is printed in any format."""

    name: str
    """Short and unique on a page."""
    title: str
    """What is seen, in one sentence, for those who cannot see it."""
    size: Point
    """Width and height [px]."""
    panels: tuple[Panel, ...]
    keys: tuple[Key, ...] = ()
    """The legend."""
    key_box: tuple[float, float, float] = (14.0, 0.0, 0.0)
    """Left, top and width of the legend [px]; no width for the rest of the picture's."""
    remarks: tuple[Mark, ...] = ()
    """Marks in pixels of the picture, downwards positive."""

    @property
    def mapping(self) -> Panel:
        """What says what pixels mean: the first panel, by `Panel.at` and `Panel.to_value`."""
        return self.panels[0]

    @property
    def marks(self) -> tuple[Mark, ...]:
        """Of all panels."""
        return tuple(mark for panel in self.panels for mark in panel.marks)

    def _all(self) -> list[Panel]:
        left, top, width = self.key_box
        keys = legend(self.keys, left, top, width or self.size[0] - left - 8)
        whole = Panel((0.0, 0.0, *self.size), Scale(0, self.size[0]), Scale(self.size[1], 0), bare=True)
        over = tuple(replace(mark, clip=False) for mark in (*self.remarks, *keys))
        return [*self.panels, replace(whole, marks=over)]

    def svg(self, theme: ThemeName = "light", name: str = "") -> str:
        """As SVG text, the same bytes for the same picture; another name where the page has one like it."""
        return svg.document(name or self.name, self.title, self.size, self._all(), theme_named(theme))

    def svg_file(self) -> bytes:
        """As an SVG file."""
        return svg.file_of(self.svg())

    def figure(self, theme: ThemeName = "light") -> Figure:
        """As a figure of matplotlib."""
        return axes.figure_of(self.size, self._all(), theme_named(theme))

    def to_png(self, dpi: int = 144, theme: ThemeName = "light") -> bytes:
        """As PNG bytes; 96 dots an inch are a dot a pixel."""
        return axes.to_png(self.figure(theme), dpi)

    def on_axes(self, ax: Axes | None = None, theme: ThemeName = "light") -> Axes:
        """The first panel and the legend on Axes, a new figure's where none are given."""
        if ax is None:
            from matplotlib.figure import Figure

            ax = Figure(figsize=(self.size[0] / 96, self.size[1] / 96), layout="constrained").subplots()
        colours = theme_named(theme)
        with axes.drawing():
            axes.draw(self.panels[0], ax, colours)
            if self.keys:
                ax.legend(handles=axes.handles(self.keys, colours), loc="best")
        return ax

    def _repr_svg_(self) -> str:
        return self.svg()


def _placed(keys: Sequence[Key], width: float) -> tuple[list[tuple[float, float]], float]:
    """Left and top of each entry, and the height of all."""
    x, y, places = 0.0, 0.0, []
    for key in keys:
        wide = 27 + text_width(key.text, SMALL)
        if x > 0 and x + wide > width:
            x, y = 0.0, y + LEGEND_ROW
        places.append((x, y))
        x += wide + 14
    return places, y + LEGEND_ROW if keys else 0.0


def legend_height(keys: Sequence[Key], width: float) -> float:
    """Height of a legend, broken at a width [px]."""
    return _placed(keys, width)[1]


def legend(keys: Sequence[Key], left: float, top: float, width: float) -> list[Mark]:
    """Samples with their names in rows, broken at a width; in pixels, downwards positive."""
    marks: list[Mark] = []
    for key, (x, y) in zip(keys, _placed(keys, width)[0], strict=True):
        marks += [shifted(sample, left + x + 11, top + y + 8) for sample in key.samples]
        marks.append(Text(left + x + (27 if key.samples else 0), top + y + 12, key.text))
    return marks


def moved(picture: Picture, x: float, y: float) -> tuple[tuple[Panel, ...], tuple[Mark, ...]]:
    """Panels and remarks of a picture elsewhere [px], its legend among the remarks."""
    left, top, width = picture.key_box
    keys = legend(picture.keys, left, top, width or picture.size[0] - left - 8)
    panels = tuple(replace(p, box=(p.box[0] + x, p.box[1] + y, *p.box[2:])) for p in picture.panels)
    return panels, tuple(shifted(mark, x, y) for mark in (*picture.remarks, *keys))


def beside(name: str, title: str, pictures: Iterable[Picture], keys: Sequence[Key] = ()) -> Picture:
    """Pictures in a row, a common legend below."""
    x, high = 0.0, 0.0
    panels: list[Panel] = []
    remarks: list[Mark] = []
    for picture in pictures:
        more, words = moved(picture, x, 0.0)
        panels += more
        remarks += words
        x, high = x + picture.size[0], max(high, picture.size[1])
    tall = legend_height(keys, x - 28)
    return Picture(name, title, (x, high + tall), tuple(panels), tuple(keys), (14.0, high - 3, x - 28), tuple(remarks))


def below(name: str, title: str, pictures: Iterable[Picture]) -> Picture:
    """Pictures in a column, each with its own legend."""
    y, wide = 0.0, 0.0
    panels: list[Panel] = []
    remarks: list[Mark] = []
    for picture in pictures:
        more, words = moved(picture, 0.0, y)
        panels += more
        remarks += words
        y, wide = y + picture.size[1], max(wide, picture.size[0])
    return Picture(name, title, (wide, y), tuple(panels), remarks=tuple(remarks))


def one_panel(
    name: str, title: str, size: Point, panel: Panel, keys: Sequence[Key] = (), *, left: float = 58.0,
    top: float = 14.0, right: float = 16.0, below: float = 42.0, remarks: tuple[Mark, ...] = (),
) -> Picture:  # fmt: skip
    """A picture of one panel with its legend below; the panel's box is made to fit.

    Parameters
    ----------
    name, title, size
        As in `Picture`.
    panel : Panel
        Its box is not looked at.
    keys : sequence of Key
    left, top, right, below : float
        Room around the panel, for ticks and labels [px].
    remarks : tuple of Mark
    """
    box = room(size, keys, left, top, right, below)
    key_box = (14.0, box[1] + box[3] + below - 2, size[0] - 24)
    return Picture(name, title, size, (replace(panel, box=box),), tuple(keys), key_box, remarks)


def as_tall(
    name: str, title: str, panel: Panel, keys: Sequence[Key] = (), *, size: Point, foot: float = 42.0
) -> Picture:
    """A picture of one panel whose box stays, as high as that and the legend below ask for but no lower than `size`."""
    top, width = panel.bottom + foot, size[0] - 24
    tall = (size[0], max(size[1], top + legend_height(keys, width)))
    return Picture(name, title, tall, (panel,), tuple(keys), (14.0, top - 2, width))


def room(
    size: Point, keys: Sequence[Key] = (), left: float = 58.0, top: float = 14.0, right: float = 16.0,
    below: float = 42.0,
) -> Box:  # fmt: skip
    """The box that margins and a legend leave of a picture [px]."""
    tall = legend_height(keys, size[0] - 24)
    return left, top, max(size[0] - left - right, 80.0), max(size[1] - top - below - tall, 60.0)


def colour_bar(panel: Panel, low: float, high: float, ramp: str, label: str) -> Panel:
    """A bar beside a panel that says what its shades mean."""
    left, top, width, height = panel.box
    shades = Image(np.linspace(low, high, 128)[:, None], (0.0, 1.0, low, high), ramp, low, high)
    box = (left + width + 8, top, 11.0, height)
    return Panel(box, Scale(0, 1), Scale(low, high), (shades,), y_label=label, x_ticks=(), grid="", right=True)
