"""The look that all figures share, and how a figure becomes text for a page.

matplotlib is used without pyplot: no global state, and faster to start.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape, unescape
from typing import TYPE_CHECKING, Any

from ...words import SYMBOL, typographic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1a1a1a"
GREY = "#6b6b6b"
PALE = "#d9d9d9"
BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
ORANGE_TEXT = "#8a5f00"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
YELLOW = "#F0E442"
"""Okabe-Ito: told apart with any colour vision, and in grey print by lightness."""

FIELD_COLOURS = (BLUE, GREEN, PURPLE)
"""Centre, edge, corner."""
BLOCKED = VERMILLION
"""Rays that some element takes; nothing else has this colour."""
FAP_COLOUR = INK
LENS_COLOUR = BLUE
STOP_COLOURS = (ORANGE, GREEN, PURPLE, SKY)
"""Of further stops, again from the start where there are more."""

WIDTH = 8.0
"""Width of a figure that fills the page [inch]."""

SETTINGS: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "lines.linewidth": 1.3,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "svg.fonttype": "none",
    "image.interpolation": "nearest",
    "image.composite_image": True,
    "path.simplify": True,
}
"""Settings of matplotlib within `drawing`."""


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in the report's look; matplotlib's own settings come back afterwards."""
    import matplotlib

    with matplotlib.rc_context(SETTINGS):
        yield


def new_axes(ax: Axes | None, width: float = WIDTH, height: float = 3.6) -> Axes:
    """The axes given, or those of a new figure of its own."""
    if ax is not None:
        return ax
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained").subplots()


def to_svg(figure: Figure, name: str) -> str:
    """A figure as SVG text to put into a page: selectable text, no date, the same bytes for the same figure.

    Parameters
    ----------
    figure : Figure
        Drawn within `drawing`.
    name : str
        Unique on the page; keeps identifiers of different figures apart.
    """
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({**SETTINGS, "svg.hashsalt": name}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    # A style element inside the page would reach beyond its figure; the page's own style sheet says the same.
    text = re.sub(r"\s*<defs>\s*<style.*?</style>\s*</defs>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r"font: [^;\"]*?([\d.]+)px[^;\"]*", _font, text)
    text = re.sub(r" font-family: [^;\"]*;?", "", text)
    # Identifiers that nothing refers to would only clash with those of other figures.
    text = re.sub(r' id="([^"]+)"', lambda match: match[0] if f"#{match[1]}" in text else "", text)
    text = re.sub(r"(<text[^>]*>)([^<]*)(</text>)", lambda m: m[1] + _subscripts(m[2]) + m[3], text)
    text = re.sub(r" +\n|\n +", "\n", text)
    return text.strip()


def standalone(content: str | bytes) -> bytes:
    """What `to_svg` gives for a page, as a file of its own; the bytes of a picture as they are."""
    if isinstance(content, bytes):
        return content
    look = "<style>svg { font-family: sans-serif; } * { stroke-linejoin: round; stroke-linecap: butt; }</style>"
    head, rest = content.split(">", 1)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{head}>\n{look}{rest}\n'.encode()


def _font(match: re.Match[str]) -> str:
    weight = "font-weight: 700; " if re.search(r"\b(bold|700)\b", match[0]) else ""
    return f"{weight}font-size: {match[1]}px"


def _subscripts(text: str) -> str:
    """Set d_3 with a subscript that every browser knows; selecting the text still gives its letters."""

    def lower(match: re.Match[str]) -> str:
        letter, index, over = match[1], match[2], match[3] or "\u200b"
        return (
            f'<tspan font-style="italic">{letter}</tspan><tspan dy=".28em" font-size="72%">{index}</tspan>'
            f'<tspan dy="-.2em">{over}</tspan>'
        )

    return SYMBOL.sub(lower, escape(typographic(unescape(text)), quote=False))


def to_png(figure: Figure, dpi: int = 150) -> bytes:
    """A figure as PNG bytes, for looking at it."""
    stream = io.BytesIO()
    with drawing():
        figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()
