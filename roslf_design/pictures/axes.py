"""The printer for matplotlib: a picture's panels as Axes with true scales and ticks, for notebooks and PNG.

matplotlib is used without pyplot: no global state, and faster to start. Its own look here also serves drawings that are
made with matplotlib itself.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from html import unescape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..words import SYMBOL, typographic
from .marks import Area, Disc, Dots, Image, Key, Line, Mark, Point, Text
from .svg import HEAD, STROKES, runs, with_subscripts
from .theme import THEMES, Theme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .picture import Panel

WIDTH = 8.0
"""Width of a figure that fills the page [inch]."""
POINTS = 0.75
"""Points a pixel."""
INK, GREY, PALE = THEMES["light"].ink, THEMES["light"].grey, THEMES["light"].pale
BLUE, SKY, GREEN = THEMES["light"].blue, THEMES["light"].sky, THEMES["light"].green
ORANGE, VERMILLION, PURPLE = THEMES["light"].orange, THEMES["light"].vermillion, THEMES["light"].purple

SETTINGS: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"], "font.size": 8.5, "text.color": INK, "mathtext.default": "it",
    "axes.titlesize": 8.5, "axes.titleweight": "bold", "axes.titlelocation": "left", "axes.labelsize": 8.5,
    "axes.labelcolor": INK, "axes.edgecolor": GREY, "axes.linewidth": 0.7, "axes.axisbelow": True,
    "axes.spines.top": False, "axes.spines.right": False,
    "xtick.color": GREY, "xtick.labelcolor": INK, "xtick.labelsize": 8, "xtick.major.width": 0.7,
    "ytick.color": GREY, "ytick.labelcolor": INK, "ytick.labelsize": 8, "ytick.major.width": 0.7,
    "lines.linewidth": 1.3, "path.simplify": True, "legend.fontsize": 8, "legend.frameon": False,
    "grid.color": "#e6e6e6", "grid.linewidth": 0.6, "svg.fonttype": "none",
    "image.interpolation": "nearest", "image.composite_image": True,
}  # fmt: skip
"""Settings of matplotlib within `drawing`."""


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in the pictures' look; matplotlib's own settings come back afterwards."""
    import matplotlib

    with matplotlib.rc_context(SETTINGS):
        yield


def figure_of(size: Point, panels: Iterable[Panel], theme: Theme) -> Figure:
    """A picture as a figure of that many pixels, 96 an inch."""
    from matplotlib.figure import Figure

    width, height = size
    with drawing():
        figure = Figure(figsize=(width / 96, height / 96), facecolor=theme.ground)
        for panel in panels:
            left, top, wide, high = panel.box
            box = (left / width, 1 - (top + high) / height, wide / width, high / height)
            draw(panel, figure.add_axes(box, facecolor="none"), theme)
    return figure


def draw(panel: Panel, ax: Axes, theme: Theme) -> Axes:
    """A panel on Axes: scales, ticks and labels set, every mark drawn in the panel's units."""
    x_ticks, y_ticks = ((), ()) if panel.bare else panel.ticks()
    for name, axis, scale, ticks, label, hue in (
        ("x", ax.xaxis, panel.x, x_ticks, panel.x_label, "ink"),
        ("y", ax.yaxis, panel.y, y_ticks, panel.y_label, panel.y_colour),
    ):
        ax.set(**{f"{name}scale": "log" if scale.log else "linear", f"{name}lim": scale[:2]})
        axis.set_ticks([value for value, _ in ticks], [label for _, label in ticks])
        axis.set_ticks([], minor=True)
        axis.set_label_text(_mathtext(label), color=theme.colour(hue))
        axis.set_tick_params(color=theme.grey, labelcolor=theme.colour(hue))
        if name in panel.grid:
            axis.grid(True, color=theme.grid)
    if panel.right:
        ax.yaxis.tick_right()
        ax.yaxis.set_label_position("right")
    for side, spine in ax.spines.items():
        spine.set_color(theme.grey)
        spine.set_visible(side in (("right",) if panel.right else ("left", "bottom")))
    ax.set_title(_mathtext(panel.title), color=theme.ink)
    if panel.bare:
        ax.set_axis_off()
    if panel.equal:
        ax.set_aspect("equal", adjustable="box")
    for order, mark in enumerate(panel.marks):
        _mark(mark, ax, theme, 2 + order / 1000)
    return ax


def handles(keys: Sequence[Key], theme: Theme) -> list[Any]:
    """What matplotlib's own legends take."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    made: list[Any] = []
    for key in keys:
        words = _mathtext(key.text)
        match key.samples:
            case Line(colour=colour, width=width, dash=dash), *_:
                look: dict[str, Any] = {"color": theme.colour(colour), "linewidth": POINTS * width}
                made.append(Line2D([], [], label=words, linestyle=_dashes(dash), **look))
            case Area(fill=fill, edge=edge, opacity=opacity), *_:
                look = {"facecolor": theme.colour(fill), "edgecolor": theme.colour(edge), "alpha": opacity}
                made.append(Patch(label=words, **look))
            case Dots(colour=colour, shape=shape, size=size), *_:
                look = {"marker": shape, "color": theme.colour(colour), "markersize": 1.5 * size}
                made.append(Line2D([], [], label=words, linestyle="none", **look))
    return made


def _mark(mark: Mark, ax: Axes, theme: Theme, order: float) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.patheffects import withStroke

    at: dict[str, Any] = {"clip_on": mark.clip, "zorder": order}
    match mark:
        case Line():
            ax.plot(
                np.atleast_1d(mark.x), np.atleast_1d(mark.y), color=theme.colour(mark.colour),
                linewidth=POINTS * mark.width, linestyle=_dashes(mark.dash), alpha=mark.opacity, scalex=False,
                scaley=False, **at,
            )  # fmt: skip
            _ends(mark, ax, theme, order)
        case Area() | Disc():
            path = _path(mark)
            if path is None:
                return
            if isinstance(mark, Area) and mark.hatch:
                ax.add_patch(PathPatch(path, lw=0, fc="none", ec=theme.colour(mark.fill), hatch="////", **at))
            elif mark.fill != "none":
                ax.add_patch(PathPatch(path, lw=0, fc=theme.colour(mark.fill), alpha=mark.opacity, **at))
            if mark.edge != "none":
                look = {"ec": theme.colour(mark.edge), "lw": POINTS * mark.width, "ls": _dashes(mark.dash)}
                ax.add_patch(PathPatch(path, fill=False, **look, **at))
        case Dots():
            lines = mark.shape in STROKES
            edge_colour = mark.colour if lines else mark.edge
            ax.plot(
                np.atleast_1d(mark.x), np.atleast_1d(mark.y), linestyle="none", marker=mark.shape,
                markersize=2 * POINTS * mark.size, color=theme.colour(mark.colour), alpha=mark.opacity,
                markeredgecolor=theme.colour(edge_colour), markeredgewidth=POINTS * mark.width,
                scalex=False, scaley=False, **at,
            )  # fmt: skip
        case Text():
            plate = {"facecolor": theme.ground, "edgecolor": "none", "pad": 1.0, "alpha": 0.85} if mark.plate else None
            written = ax.annotate(
                _mathtext(mark.text), (mark.x, mark.y), xytext=(POINTS * mark.dx, -POINTS * mark.dy),
                textcoords="offset points", color=theme.colour(mark.colour), fontsize=POINTS * mark.size,
                ha={"start": "left", "middle": "center", "end": "right"}[mark.anchor],
                va="baseline", fontweight="bold" if mark.bold else "normal", bbox=plate,
                annotation_clip=mark.clip, zorder=order,
            )  # fmt: skip
            if mark.halo:
                written.set_path_effects([withStroke(linewidth=2.6, foreground=theme.ground)])
        case Image():
            if np.size(mark.values):
                ax.imshow(
                    theme.shades(mark.ramp, mark.shares), extent=mark.box, origin="lower", aspect="auto",
                    interpolation="none", zorder=order,
                )  # fmt: skip


def _path(mark: Area | Disc) -> Any:
    """Polygons as one path, None where there are none; or a circle."""
    from matplotlib.path import Path

    if isinstance(mark, Disc):
        return Path.circle((mark.x, mark.y), mark.radius)
    rings = runs(np.stack(np.broadcast_arrays(np.asarray(mark.x, float), np.asarray(mark.y, float)), -1))
    paths = [Path(np.concatenate([ring, ring[:1]]), closed=True) for ring in rings]
    return Path.make_compound_path(*paths) if paths else None


def _ends(mark: Line, ax: Axes, theme: Theme, order: float) -> None:
    x, y = (np.asarray(v, float) for v in np.broadcast_arrays(mark.x, mark.y))
    if not mark.ends or len(x) < 2:
        return
    arrow = {"|": "|-|,widthA=0.25,widthB=0.25", "<>": "<|-|>", ">": "-|>"}[mark.ends]
    if mark.ends != "|":
        arrow += f",head_length={HEAD / 20},head_width={HEAD / 45}"
    for k in range(len(x) - 1):
        if np.isfinite([x[k], x[k + 1], y[k], y[k + 1]]).all():
            look = {"arrowstyle": arrow, "color": theme.colour(mark.colour), "linewidth": POINTS * mark.width}
            ax.annotate(
                "", (x[k + 1], y[k + 1]), (x[k], y[k]), annotation_clip=mark.clip, zorder=order,
                arrowprops={**look, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 10},
            )  # fmt: skip


def _dashes(dash: str) -> Any:
    """Lengths in widths of the line would grow with it; matplotlib is told pixels as points."""
    return (0, tuple(max(float(part) * POINTS, 0.5) for part in dash.split())) if dash else "solid"


def _mathtext(text: str) -> str:
    plain = typographic(text).replace("$", r"\$")
    return SYMBOL.sub(lambda m: f"${m[1]}_{{{m[2]}}}${m[3] or ''}", plain)


def to_svg(figure: Figure, name: str) -> str:
    """A figure that was drawn with matplotlib itself, within `drawing`, as SVG text to put into a page.

    Parameters
    ----------
    figure : Figure
    name : str
        Unique on the page; keeps identifiers of different figures apart.

    Returns
    -------
    str
        With selectable text and no date, the same for the same figure.
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
    text = re.sub(r"(<text[^>]*>)([^<]*)(</text>)", lambda m: m[1] + with_subscripts(unescape(m[2])) + m[3], text)
    text = re.sub(r" +\n|\n +", "\n", text)
    return text.strip()


def standalone(svg: str) -> bytes:
    """What `to_svg` gives, as a file of its own."""
    look = "<style>svg { font-family: sans-serif; } * { stroke-linejoin: round; stroke-linecap: butt; }</style>"
    head, rest = svg.split(">", 1)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{head}>\n{look}{rest}\n'.encode()


def _font(match: re.Match[str]) -> str:
    weight = "font-weight: 700; " if re.search(r"\b(bold|700)\b", match[0]) else ""
    return f"{weight}font-size: {match[1]}px"


def to_png(figure: Figure, dpi: int = 150) -> bytes:
    """A figure as PNG bytes."""
    stream = io.BytesIO()
    with drawing():
        figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()


__all__ = [
    "BLUE", "GREEN", "GREY", "INK", "ORANGE", "PALE", "PURPLE", "SKY", "VERMILLION", "WIDTH", "draw",
    "drawing", "figure_of", "handles", "standalone", "to_png", "to_svg",
]  # fmt: skip
