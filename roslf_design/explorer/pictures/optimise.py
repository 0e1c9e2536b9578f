"""What an optimisation run found: variables before and after, where its searches ended, what the goal costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .axes import Picture, Plot, Scale, frame, legend, moved
from .svg import PLAIN, SMALL, clipped, document, line, path, path_of, short, tag, text, text_width
from .theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ..runs import OptimiseResult

ROW = 46.0
"""Height of a variable's row [px]."""
FLOOR = 1e-8
"""Losses below this share are drawn here: the same design."""


def change_bars(found: OptimiseResult, theme: ThemeName = "light", size: tuple[float, float] = (560, 200)) -> Picture:
    """Draw every variable between its bounds, where it was and where it is now.

    Parameters
    ----------
    found : OptimiseResult
    theme : {"light", "dark"}
    size : (width, height)
        [px]; the picture may be higher, so that its rows are legible.
    """
    colours = theme_named(theme)
    left, right = 48.0, 24.0
    width = max(size[0] - left - right, 100.0)
    parts = []
    for k, change in enumerate(found.changes):
        y = 26 + k * ROW
        scale = Scale(change.low, change.high)
        before, after = (
            left + width * min(max(float(scale.share(v)), 0.0), 1.0) for v in (change.before, change.after)
        )
        parts.append(line((left, y), (left + width, y), colours.pale, 6, stroke_linecap="round"))
        parts.append(line((before, y), (after, y), colours.blue, 3))
        parts.append(tag("circle", cx=before, cy=y, r=5, fill=colours.ground, stroke=colours.grey, stroke_width=2))
        hue = colours.orange if change.at_bound else colours.blue
        parts.append(tag("circle", cx=after, cy=y, r=6, fill=hue, data_testid=f"change-{change.symbol}"))
        parts.append(text((left - 14, y + 4), change.symbol, colours.ink, PLAIN, "end"))
        told = f"{short(change.before)} → {short(change.after)} mm{', at bound' if change.at_bound else ''}"
        half = text_width(told, SMALL) / 2
        at = min(max(after, left + half), left + width - half)
        parts.append(text((at, y - 10), told, colours.ink, SMALL, "middle"))
        parts.append(text((left, y + 16), short(change.low, 3), colours.grey, SMALL))
        parts.append(text((left + width, y + 16), short(change.high, 3), colours.grey, SMALL, "end"))
    foot = 26 + ROW * len(found.changes)
    key, tall = legend(_variables(colours), colours, size[0] - 24)
    parts.append(moved(key, 14, foot))
    title = "Variables: " + "; ".join(f"{c.symbol} {c.before:.4g} to {c.after:.4g} mm" for c in found.changes)
    return Picture(document("changes", title, (size[0], max(size[1], foot + tall + 6)), colours, parts))


def _variables(theme: Theme) -> list[tuple[str, str]]:
    return [
        (tag("circle", r=5, fill=theme.ground, stroke=theme.grey, stroke_width=2), "before"),
        (tag("circle", r=6, fill=theme.blue), "found"),
        (tag("circle", r=6, fill=theme.orange), "found, at its bound"),
    ]


def search_history(
    found: OptimiseResult, theme: ThemeName = "light", size: tuple[float, float] = (420, 260)
) -> Picture:
    """Draw where every search ended, as a loss against the answer; parameters as `change_bars`."""
    colours = theme_named(theme)
    key, tall = legend(_ends(colours), colours, size[0] - 24)
    spent = max((end.spent for end in found.ends), default=1)
    top = max([1e-2, *(100 * end.loss for end in found.ends if end.kind != "bad")])
    plot = Plot(
        72, 14, max(size[0] - 72 - 16, 80.0), max(size[1] - 14 - 42 - tall, 60.0),
        Scale(0.0, 1.05 * spent), Scale(100 * FLOOR / 3, 3 * top, log=True),
    )  # fmt: skip
    parts = []
    for end in found.ends:
        x, y = plot.at(end.spent, top if end.kind == "bad" else max(100 * end.loss, 100 * FLOOR))
        parts.append(tag("g", _mark(end.kind, colours), transform=f"translate({x:.1f} {y:.1f})"))
    body = [
        frame(plot, colours, "evaluations so far", "worse than the answer by [%]"),
        tag("g", "".join(parts), data_testid="search-ends"),
        moved(key, 14, plot.bottom + 40),
    ]
    same = sum(end.kind != "bad" and end.loss <= 1e-6 for end in found.ends)
    title = f"{same} of {len(found.ends)} searches ended at the answer"
    return Picture(document("history", title, size, colours, body))


def _mark(kind: str, theme: Theme) -> str:
    if kind == "bad":
        return path("M-4,-4l8,8m0,-8l-8,8", theme.vermillion, 2)
    if kind == "check":
        return path("M0,-6l6,6l-6,6l-6,-6Z", theme.ground, 1, theme.orange)
    return tag("circle", r=4.5, fill=theme.blue)


def _ends(theme: Theme) -> list[tuple[str, str]]:
    names = (("start", "a search's end"), ("check", "another solver's"), ("bad", "a limit fails"))
    return [(_mark(kind, theme), name) for kind, name in names]


def front(found: OptimiseResult, theme: ThemeName = "light", size: tuple[float, float] = (420, 300)) -> Picture:
    """Draw designs of which none is better in both goals, and where the design asked about is; as `change_bars`.

    Raises
    ------
    ValueError
        No second goal was asked for.
    """
    if not found.against:
        raise ValueError("no front: the run was asked for one goal alone")
    colours = theme_named(theme)
    xs, ys = [x for x, _ in found.front], [y for _, y in found.front]
    plot = Plot(
        60, 14, max(size[0] - 60 - 18, 80.0), max(size[1] - 14 - 42, 60.0), _around([*xs, found.after]), _around(ys)
    )
    points = [plot.at(x, y) for x, y in found.front]
    inside = path(path_of(points), colours.blue, 1.8, data_testid="front-line")
    dots = "".join(tag("circle", cx=x, cy=y, r=4.5, fill=colours.blue) for x, y in points)
    units = [f" [{unit}]" if unit else "" for unit in (found.unit, found.against_unit)]
    body = [
        frame(plot, colours, f"{found.quantity}{units[0]}", f"{found.against_quantity}{units[1]}"),
        clipped("front-window", plot.box, inside),
        dots,
    ]
    if len(points) < 2:
        told = "the goals do not compete" if points else "no design holds every limit"
        body.append(text((plot.left + plot.width / 2, plot.top + 18), told, colours.ink, PLAIN, "middle"))
    title = f"What {found.goal} costs of {found.against}: {len(points)} designs"
    return Picture(document("front", title, size, colours, body), plot.mapping)


def _around(values: list[float]) -> Scale:
    """A scale with some room on either side."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return Scale(low - room, high + room)
