"""The printer for matplotlib: a picture's panels as Axes with true scales and ticks, for notebooks.

matplotlib is used without pyplot: no global state, and faster to start. Its own look here also serves drawings that are
made with matplotlib itself.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from ..words import SYMBOL, typographic
from .marks import Area, Disc, Dots, Image, Line, Mark, Point, Text
from .svg import HEAD, STROKES, runs
from .theme import THEMES, Theme
from .typeset import POINTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .panel import Panel

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
    "grid.color": "#e6e6e6", "grid.linewidth": 0.6,
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


def draw(panel: Panel, ax: Axes, theme: Theme) -> None:
    """A panel on Axes: scales, ticks and labels set, every mark drawn in the panel's units."""
    x_ticks, y_ticks = ((), ()) if panel.bare else panel.ticks()
    for name, axis, scale, ticks, label, hue in (
        ("x", ax.xaxis, panel.x, x_ticks, panel.x_label, "ink"),
        ("y", ax.yaxis, panel.y, y_ticks, panel.y_label, panel.y_colour),
    ):
        if scale.log:
            ax.set(**{f"{name}scale": "log"})
        ax.set(**{f"{name}lim": scale[:2]})
        axis.set_ticks([value for value, _ in ticks], [label for _, label in ticks])
        if scale.log:
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


def to_png(figure: Figure, dpi: int = 150) -> bytes:
    """A figure as PNG bytes."""
    stream = io.BytesIO()
    with drawing():
        figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()
