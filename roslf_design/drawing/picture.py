"""Pictures: panels with their legend and remarks, and how they are set beside and below each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from . import axes, svg
from .marks import Key, Mark, Point, Text, shifted
from .panel import Panel, Scale
from .theme import SMALL, ThemeName, text_width, theme_named, wrapped
from .typeset import png_of

if TYPE_CHECKING:
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
    """Title: what the picture shows, in one sentence, for those who cannot see it."""
    size: Point
    """Width and height [px]."""
    panels: tuple[Panel, ...]
    keys: tuple[Key, ...] = ()
    """The legend."""
    key_box: tuple[float, float, float] = (14.0, 0.0, 0.0)
    """Left, top and width of the legend [px]; no width for the rest of the picture's."""
    remarks: tuple[Mark, ...] = ()
    """Marks in pixels of the picture, downwards positive."""
    breaks: float = 0.0
    """Share of its height after which it may go on another page; 0 for nowhere."""

    @property
    def mapping(self) -> Panel:
        """Panel that maps pixels to values, by `Panel.at` and `Panel.to_value`: the first one."""
        return self.panels[0]

    @property
    def marks(self) -> tuple[Mark, ...]:
        """Marks of all panels."""
        return tuple(mark for panel in self.panels for mark in panel.marks)

    def with_panels(self, *more: Panel) -> Picture:
        """Picture with further panels beside."""
        return replace(self, panels=(*self.panels, *more))

    @property
    def over(self) -> list[Mark]:
        """Remarks and legend, in pixels of the picture."""
        left, top, width = self.key_box
        marks = list(self.remarks)
        places, _ = _placed(self.keys, width or self.size[0] - left - 8)
        for key, (x, y, lines) in zip(self.keys, places, strict=True):
            marks += [shifted(sample, left + x + 11, top + y + 8) for sample in key.samples]
            across = left + x + (27 if key.samples else 0)
            marks += [Text(across, top + y + 12 + LEGEND_ROW * k, line) for k, line in enumerate(lines)]
        return marks

    def _all(self) -> list[Panel]:
        over = tuple(replace(mark, clip=False) for mark in self.over)
        whole = Panel((0.0, 0.0, *self.size), Scale(0, self.size[0]), Scale(self.size[1], 0), over, bare=True)
        return [*self.panels, whole]

    def svg(self, theme: ThemeName = "light", name: str = "") -> str:
        """As SVG text, the same bytes for the same picture; another name where the page has one like it."""
        return svg.document(name or self.name, self.title, self.size, self._all(), theme_named(theme))

    def svg_file(self) -> bytes:
        """SVG file of the picture."""
        return svg.file_of(self.svg())

    def figure(self, theme: ThemeName = "light") -> Figure:
        """Figure of matplotlib with the picture."""
        return axes.figure_of(self.size, self._all(), theme_named(theme))

    def to_png(self, dpi: int = 144, theme: ThemeName = "light") -> bytes:
        """As PNG bytes; 96 dots an inch are a dot a pixel."""
        return png_of(svg.file_of(self.svg(theme)), self.size, dpi)

    def _repr_svg_(self) -> str:
        return self.svg()


def _placed(keys: Sequence[Key], width: float) -> tuple[list[tuple[float, float, list[str]]], float]:
    """Left, top and lines of each entry, and the height of all."""
    x, y, down, places = 0.0, 0.0, 0.0, []
    for key in keys:
        lines = wrapped(key.text, width - 27)
        wide = 27 + max(text_width(line, SMALL) for line in lines)
        if x > 0 and x + wide > width:
            x, y = 0.0, y + down
        places.append((x, y, lines))
        x, down = x + wide + 14, max(down if x > 0 else 0.0, LEGEND_ROW * len(lines))
    return places, y + down


def legend_height(keys: Sequence[Key], width: float) -> float:
    """Height of a legend, broken at a width [px]."""
    return _placed(keys, width)[1]


def beside(
    name: str, title: str, pictures: Iterable[Picture], keys: Sequence[Key] = (), *, down: bool = False
) -> Picture:
    """Pictures in a row or, with `down`, in a column, each with its own legend; a common one below."""
    x, y, wide, high = 0.0, 0.0, 0.0, 0.0
    panels: list[Panel] = []
    remarks: list[Mark] = []
    first = 0.0
    for picture in pictures:
        panels += [replace(p, box=(p.box[0] + x, p.box[1] + y, *p.box[2:])) for p in picture.panels]
        remarks += [shifted(mark, x, y) for mark in picture.over]
        wide, high = max(wide, x + picture.size[0]), max(high, y + picture.size[1])
        x, y = (0.0, high) if down else (wide, 0.0)
        first = first or y
    size = wide, high + legend_height(keys, wide - 28)
    breaks = first / size[1] if first < high else 0.0
    return Picture(name, title, size, tuple(panels), tuple(keys), (14.0, high - 3, wide - 28), tuple(remarks), breaks)


def one_panel(
    name: str, title: str, size: Point, panel: Panel, keys: Sequence[Key] = (), *, left: float = 58.0,
    top: float = 14.0, right: float = 16.0, foot: float = 42.0,
) -> Picture:  # fmt: skip
    """A picture of one panel with its legend below; the panel's box is made to fit, with room for ticks and labels."""
    height = max(size[1] - top - foot - legend_height(keys, size[0] - 24), 60.0)
    _, up = replace(panel, box=(left, top, 80.0, height)).ticks()
    if panel.y_label:
        left = max(left, 30.0 + max((text_width(text, SMALL) for _, text in up), default=0.0))
    width = max(size[0] - left - right, 80.0)
    return as_tall(name, title, replace(panel, box=(left, top, width, height)), keys, size=size, foot=foot)


def as_tall(
    name: str, title: str, panel: Panel, keys: Sequence[Key] = (), *, size: Point, foot: float = 42.0
) -> Picture:
    """A picture of one panel whose box stays, as high as that and the legend below ask for but no lower than `size`."""
    top, width = panel.bottom + foot, size[0] - 24
    tall = (size[0], max(size[1], top + legend_height(keys, width)))
    return Picture(name, title, tall, (panel,), tuple(keys), (14.0, top - 2, width))


def notice(name: str, words: str, size: Point) -> Picture:
    """Picture of a sentence in the place of one that cannot be drawn."""
    lines = enumerate(wrapped(words, size[0] - 28))
    remarks = tuple(Text(14, 24 + LEGEND_ROW * n, line, testid="undrawn" if n == 0 else "") for n, line in lines)
    return Picture(name, words, size, (), remarks=remarks)
