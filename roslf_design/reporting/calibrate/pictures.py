"""Drawings of a calibration: residuals of the fit, Eq. 12's line, the posterior, what it means for depths."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..._arrays import Array
from ...drawing.marks import (
    Area,
    Disc,
    Dots,
    Image,
    Key,
    Line,
    Mark,
    Text,
    box_key,
    dot_key,
    line_key,
    parted,
    stairs,
    where_above,
    xy,
)
from ...drawing.panel import Panel, Scale, named_ticks
from ...drawing.picture import PAGE, Picture, beside, legend_height, one_panel
from ...drawing.theme import MANY, PLAIN, SMALL

if TYPE_CHECKING:
    from ...calibration.centres import MicrolensCentres
    from ...calibration.result import Outcome

DOTS = 2000
"""Most dots of a cloud: more would only make the picture larger."""
SIGNS = "os^Dv<>"


def what_was_seen(centres: MicrolensCentres, views: Mapping[str, NDArray[np.floating]]) -> Picture:
    """Draw what there was before a calibration failed: which microlenses spoke, and the boards' central views."""
    box, gap, columns = 220.0, 28.0, 3
    shown = list(views.items())[:8]
    places = centres.centres
    marks: list[Mark] = []
    keys: list[Key] = []
    for reason, (said, count) in zip(np.unique(centres.reasons), centres.counts().items(), strict=True):
        own = places[centres.reasons == reason]
        colour, text = MANY[reason % len(MANY)], f"{count} {said}"
        marks.append(Dots(*xy(np.random.default_rng(0).permutation(own)[:DOTS]), colour, size=1.2))
        keys.append(dot_key(text, colour, size=2.6))
    panels = []
    for number in range(1 + len(shown)):
        at = (16 + (box + gap) * (number % columns), 26 + (box + gap) * (number // columns))
        title, drawn = "microlenses of the white image", tuple(marks)
        low, high = places.min(axis=0), places.max(axis=0)
        if number:
            title, view = shown[number - 1]
            low, high = np.zeros(2), np.array(view.shape[::-1], float)
            dark, bright = np.quantile(view, (0.005, 0.995))
            shades = np.clip(view, dark, bright)[::-1]
            ends = (0.0, high[0], 0.0, high[1])
            drawn = (Image(shades, ends, "grey", float(dark), float(max(bright, dark + 1e-9))),)
        size = (high - low) / (high - low).max() * box
        # Rows of images run downwards; those of `Image` upwards.
        y = Scale(high[1], low[1]) if number == 0 else Scale(low[1], high[1])
        panels.append(
            Panel(
                (*at, *size), Scale(low[0], high[0]), y, drawn, title=title, x_ticks=(), y_ticks=(), grid="", equal=True
            )
        )
    foot = max(panel.bottom for panel in panels) + 14
    size = (PAGE, foot + legend_height(keys, PAGE - 40))
    return Picture(
        "failed",
        "What was seen before the calibration failed",
        size,
        tuple(panels),
        tuple(keys),
        (14.0, foot, PAGE - 40),
    )


def residuals(result: Outcome) -> Picture:
    """Draw the joint fit's residuals: all of them as a cloud, and their mean over the views at each corner."""
    fitted = result.calibration
    off, rms = fitted.joint.residuals, float(fitted.joint.rms)
    flat = np.asarray(off[fitted.observations.seen])
    if len(flat) > DOTS:  # at random: every nth aliases with the corners and views
        flat = flat[np.random.default_rng(result.seed).choice(len(flat), DOTS, replace=False)]
    reach = max(1.15 * float(np.quantile(np.abs(flat), 0.999)), 1.4 * rms)
    side = 240.0
    scale = Scale(-reach, reach)
    cloud = Panel(
        (64, 28, side, side), scale, scale,
        (Dots(*xy(flat), size=1.3, opacity=0.5, clip=True), Disc(0.0, 0.0, rms, edge="vermillion", width=1.7)),
        "residual in u [pitches]", "residual in v [pitches]", f"all views; the circle is the RMS, {rms:.3g}",
        equal=True,
    )  # fmt: skip
    shown = np.asarray(fitted.observations.seen.any(axis=1))
    mean = np.nansum(off, axis=1)[shown] / fitted.observations.seen.sum(axis=1)[shown][:, None]
    place = fitted.lines.central[shown]
    typical = float(np.sqrt(np.square(mean).sum(axis=1).mean())) or 1.0
    gain = 0.03 * float(np.ptp(place, axis=0).max()) / typical
    marks: list[Mark] = []
    keys: list[Key] = []
    boards = np.repeat(np.arange(len(shown)), shown.sum(axis=1))
    for k, name in enumerate(fitted.observations.names):
        own = boards == k
        colour, sign = MANY[k % 7], SIGNS[k // 7 % 7]
        ends = place[own] + gain * mean[own]
        x, y = (parted(np.stack([place[own][:, c], ends[:, c]], -1)) for c in (0, 1))
        marks += [Line(x, y, colour, 1.2), Dots(*xy(place[own]), colour, sign, 1.8)]
        keys.append(dot_key(name, colour, sign, 2.6))
    u, v = (Scale.around(place[:, c], 0.06) for c in (0, 1))
    unit = max((u.high - u.low) / 330, (v.high - v.low) / side)
    width, height = (u.high - u.low) / unit, (v.high - v.low) / unit
    field = Panel(
        (384, 28, width, height), u, Scale(v.high, v.low), tuple(marks), "u [pitches]", "v [pitches]",
        f"mean over views, {float(f'{gain:.2g}'):,.0f} times as long", grid="", equal=True,
    )  # fmt: skip
    keys = keys if len(shown) <= 14 else []
    foot = 28 + side + 44
    size = (PAGE, foot + legend_height(keys, PAGE - 40))
    title = f"Residuals of the joint fit: {rms:.3g} pitches RMS"
    return Picture("residuals", title, size, (cloud, field), tuple(keys), (14.0, foot - 2, PAGE - 40))


def epi_lines(result: Outcome) -> Picture:
    """Draw the epipolar slopes over inverse depth with the line of Eq. 12, and what it leaves over."""
    second = result.calibration.second
    order = np.argsort(second.inverse_depth)
    x, y, fitted = 1e3 * second.inverse_depth[order], second.slope[order], second.fitted[order]
    left = 1e3 * (y - fitted)
    across, size = Scale.around(x, 0.03), (540.0, 270.0)
    marks: list[Mark] = [
        Line([across.low, across.high], [0.0, 0.0], "grey", 0.9),
        Dots(x, y, "blue", size=1.9, opacity=0.7, clip=True), Line(x, fitted, "vermillion", 1.4),
    ]  # fmt: skip
    focus = 1e3 * second.camera.m / second.camera.A
    if x[0] < focus < x[-1]:
        marks.append(Text(float(focus), 0.0, "focal plane", "grey", SMALL, dx=8, dy=-8))
    keys = [dot_key("a corner", "blue", size=1.9), line_key("Eq. 12, fitted", "vermillion", 1.4)]
    up = Scale.around([*y, *fitted, 0.0], 0.05)
    above = Panel((0, 0, 1, 1), across, up, tuple(marks), "", "slope Δu/Δs [pitches/px]", grid="y")
    rest: tuple[Mark, ...] = (
        Dots(x, left, "blue", size=1.9, opacity=0.7, clip=True),
        Line([across.low, across.high], [0.0, 0.0], "vermillion", 1.4),
    )
    under = Panel(
        (0, 0, 1, 1), across, Scale.around([*left, 0.0], 0.1), rest, "inverse depth 1/Z from the FAP [1/m]",
        "left over [10⁻³]", grid="y",
    )  # fmt: skip
    return beside(
        "epi-lines", "Epipolar slopes over inverse depth, with the line of Eq. 12 and what it leaves over",
        [one_panel("slopes", "", size, above, keys, foot=22), one_panel("left", "", (540.0, 160.0), under)], down=True,
    )  # fmt: skip


def posterior(result: Outcome, units: Mapping[str, str]) -> Picture:
    """Draw the posterior of H, d_3, d_2, A, m and f: each alone and every pair, with 68 and 95 % regions.

    Without a posterior, Laplace's approximation is drawn in its place, and called so; `units` are the quantities'.
    """
    names = ["H", "d_3", "d_2", "A", "m"] + (["f"] if result.sheet.f_sigma > 0 else [])
    draws = {name: np.asarray(result.draws.draws(name)) for name in names}
    quantiles = {name: np.quantile(v, (0.002, 0.998)).tolist() for name, v in draws.items()}
    ends = {name: Scale(low, high) for name, (low, high) in quantiles.items()}
    labels = {n: f"{n} [{unit}]" if (unit := units.get(n, "mm" if n == "f" else "")) else n for n in names}
    head, left, gap = 24.0, 74.0, 12.0
    side = (PAGE - left - 12) / len(names) - gap
    panels = []
    for row, down in enumerate(names):
        for column, across in enumerate(names[: row + 1]):
            box = (left + column * (side + gap), head + row * (side + gap), side, side)
            x, last = ends[across], row == len(names) - 1
            x_ticks = named_ticks(x.ticks(2)) if last else tuple((v, "") for v in x.ticks(2))
            x_label = labels[across] if last else ""
            if row == column:
                heights, edges = np.histogram(draws[across], 40, (x.low, x.high))
                y = Scale(0.0, 1.08 * float(heights.max()))
                marks = _histogram(draws[across], heights, edges, y.high)
                panels.append(Panel(box, x, y, marks, x_label, x_ticks=x_ticks, y_ticks=(), grid=""))
                continue
            y = ends[down]
            ticks = y.ticks(3)
            y_ticks = named_ticks(ticks) if column == 0 else tuple((v, "") for v in ticks)
            marks = _regions(draws[across], draws[down], x, y)
            y_label = labels[down] if column == 0 else ""
            panels.append(Panel(box, x, y, marks, x_label, y_label, x_ticks=x_ticks, y_ticks=y_ticks, grid=""))
    sampled = result.posterior is not None
    words = "" if sampled else "Laplace's approximation: the normal law of the Fisher matrix, not sampled"
    remarks = (Text(PAGE - 12, 15, words, "ink", PLAIN, "end"),)
    size = (PAGE, head + len(names) * (side + gap) + 34)
    return Picture(
        "posterior", words or "The posterior of every pair of quantities", size, tuple(panels), remarks=remarks
    )


def _histogram(values: Array, heights: Array, edges: Array, top: float) -> tuple[Mark, ...]:
    x, y = stairs(edges, heights)
    low, middle, high = (float(q) for q in np.quantile(values, (0.16, 0.5, 0.84)))
    lines = [Line([at, at], [0.0, top], "ink", 1.0, dash) for at, dash in ((low, "4 3"), (middle, ""), (high, "4 3"))]
    return (Area(x, y, "blue", 0.35), Line(x, y, "blue", 1.2), *lines)


def _regions(x: Array, y: Array, across: Scale, up: Scale) -> tuple[Mark, ...]:
    """Regions of highest density that hold 68 and 95 % of the draws."""
    from scipy.ndimage import gaussian_filter

    counts, x_edges, y_edges = np.histogram2d(x, y, 44, [tuple(across[:2]), tuple(up[:2])])
    density = gaussian_filter(counts, 1.1)
    ranked = np.sort(density.ravel())[::-1]
    held = np.cumsum(ranked) / ranked.sum()
    outer, inner = (float(ranked[np.searchsorted(held, share)]) for share in (0.95, 0.68))
    if not outer < inner < float(density.max()) * 1.01:
        return ()
    middles = [(edges[1:] + edges[:-1]) / 2 for edges in (x_edges, y_edges)]
    marks: list[Mark] = []
    for level, colour in ((outer, "sky"), (inner, "blue")):
        marks.append(Area(*xy(where_above(density.T, middles[0], middles[1], level)), colour, 0.75, "blue", 0.8))
    return tuple(marks)


def depth_errors(result: Outcome) -> Picture:
    """Draw the standard deviation of measured depths over the boards' range, from the lens and from the pupil."""
    d = result.depths
    distance = np.asarray(d["distance"])
    half = 0.5 * (np.asarray(d["high_95"]) - np.asarray(d["low_95"]))
    boards = result.estimates["d_3"].value + result.calibration.fit.poses.translation[:, 2]
    marks: list[Mark] = [
        Area([*distance, distance[-1], distance[0]], [*half, 0.0, 0.0], "pale"),
        Line(distance, d["from_lens"], "blue", 1.8), Line(distance, d["from_pupil"], "vermillion", 1.8, "7 3"),
        Dots(boards, np.zeros(len(boards)), "ink", "|", 6, width=1.4),
    ]  # fmt: skip
    keys = [
        box_key("half the 95 % interval, from the lens", "pale"), line_key("σ of Z, from the lens", "blue", 1.8),
        line_key("σ of Z from the FAP", "vermillion", 1.8, "7 3"), dot_key("boards", "ink", "|", 6),
    ]  # fmt: skip
    across, up = Scale(float(distance[0]), float(distance[-1])), Scale(0.0, 1.15 * float(half.max()))
    labels = "distance from the lens [mm]", "systematic depth error [mm]"
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), *labels, grid="y")
    return one_panel("depth", "Systematic error of measured depths", (540, 340), panel, keys, left=70)
