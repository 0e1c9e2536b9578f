"""Figures of a calibration: what the fit left over, Eq. 12's line, the posterior, what it means for depths."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..report.figures.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    VERMILLION,
    drawing,
    new_axes,
)
from .frames import Array
from .result import UNITS, Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DOTS = 2000
"""Most dots of a cloud: more would only make the file larger."""
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION, GREY)
_MARKS = "os^Dv<>"


def plot_residuals(result: Outcome) -> Figure:
    """Draw the joint fit's residuals: all of them as a cloud, and their mean over the views at each corner."""
    from matplotlib.figure import Figure

    found = result.calibration
    figure = Figure(figsize=(8.0, 3.25), layout="constrained")
    cloud, field = figure.subplots(1, 2, width_ratios=(1, 1.25))
    off = found.joint.residuals
    flat = np.asarray(off[found.observations.seen])
    flat = flat[:: max(1, -(-len(flat) // _DOTS))]
    cloud.plot(flat[:, 0], flat[:, 1], ".", color=BLUE, markersize=2.5, alpha=0.5)
    turn = np.linspace(0, 2 * np.pi, 181)
    cloud.plot(found.joint.rms * np.cos(turn), found.joint.rms * np.sin(turn), color=VERMILLION)
    reach = max(1.15 * float(np.quantile(np.abs(flat), 0.999)), 1.4 * found.joint.rms)
    cloud.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    cloud.set(xlabel="residual in u [pitches]", ylabel="residual in v [pitches]")
    cloud.set_title(f"all views; the circle is the RMS, {found.joint.rms:.3g}")
    seen = np.asarray(found.observations.seen.any(axis=1))
    mean = np.nansum(off, axis=1)[seen] / found.observations.seen.sum(axis=1)[seen][:, None]
    place = found.lines.central[seen]
    span = float(np.ptp(place, axis=0).max())
    typical = float(np.sqrt(np.square(mean).sum(axis=1).mean())) or 1.0
    gain = 0.03 * span / typical
    for k, name in enumerate(found.observations.names):
        own = np.repeat(np.arange(len(seen)), seen.sum(axis=1)) == k
        colour, mark = _COLOURS[k % 7], _MARKS[k // 7 % 7]
        ends = place[own] + gain * mean[own]
        for (x, y), (x_end, y_end) in zip(place[own], ends, strict=True):
            field.plot([x, x_end], [y, y_end], color=colour, linewidth=0.9)
        field.plot(*place[own].T, mark, color=colour, markersize=2.2, label=name)
    field.set(aspect="equal", xlabel="u [pitches]", ylabel="v [pitches]")
    field.invert_yaxis()
    field.set_title(f"mean over views, {float(f'{gain:.2g}'):,.0f} times as long")
    for ax in (cloud, field):
        ax.set_anchor("N")
    if len(seen) <= 14:
        field.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=7, handletextpad=0.2)
    return figure


def plot_lines(result: Outcome) -> Figure:
    """Draw the epipolar slopes over inverse depth with the line of Eq. 12, and what it leaves over."""
    from matplotlib.figure import Figure

    found = result.calibration.second
    figure = Figure(figsize=(5.6, 4.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    order = np.argsort(found.inverse_depth)
    x, y, fitted = (1e3 * found.inverse_depth[order], found.slope[order], found.fitted[order])
    above.plot(x, y, "o", color=BLUE, markersize=2.6, alpha=0.7, label="a corner")
    above.plot(x, fitted, color=VERMILLION, linewidth=1, label="Eq. 12, fitted")
    above.axhline(0, color=GREY, linewidth=0.7)
    focus = 1e3 * found.camera.m / found.camera.A
    if x[0] < focus < x[-1]:
        above.annotate(
            "focal plane", (focus, 0), xytext=(6, 8), textcoords="offset points", color=GREY, ha="left", va="bottom"
        )
    above.set_ylabel("slope Δu/Δs [pitches/px]")
    above.legend(loc="upper right")
    below.plot(x, 1e3 * (y - fitted), "o", color=BLUE, markersize=2.6, alpha=0.7)
    below.axhline(0, color=VERMILLION, linewidth=1)
    below.set(xlabel="inverse depth 1/Z from the FAP [1/m]", ylabel="left over [10⁻³]")
    for ax in (above, below):
        ax.grid(axis="y")
    return figure


def plot_posterior(result: Outcome) -> Figure:
    """Draw the posterior of H, d_3, d_2, A, m and f: each alone and every pair, with 68 and 95 % regions.

    Without a posterior, Laplace's approximation in its place, and says so.
    """
    from matplotlib.figure import Figure

    names = ["H", "d_3", "d_2", "A", "m"] + (["f"] if result.sheet.f_sigma > 0 else [])
    draws = {name: result.draws.draws(name) for name in names}
    ends = {name: np.quantile(values, (0.002, 0.998)) for name, values in draws.items()}
    count = len(names)
    figure = Figure(figsize=(8.0, 7.8), layout="constrained")
    panels = figure.subplots(count, count)
    for row, below in enumerate(names):
        for column, across in enumerate(names):
            ax = panels[row, column]
            if column > row:
                ax.set_axis_off()
                continue
            ax.set_xlim(*ends[across])
            if row == column:
                _histogram(ax, draws[across], ends[across])
            else:
                ax.set_ylim(*ends[below])
                _regions(ax, draws[across], draws[below], ends[across], ends[below])
            ax.locator_params(nbins=3)
            ax.tick_params(labelsize=7, labelbottom=row == count - 1, labelleft=column == 0 and row > 0)
            if row == count - 1:
                ax.set_xlabel(_label(across))
                ax.tick_params(axis="x", labelrotation=40)
            if column == 0 and row > 0:
                ax.set_ylabel(_label(below))
    figure.align_labels()
    if result.posterior is None:
        figure.suptitle("Laplace's approximation: the normal law of the Fisher matrix, not sampled", x=0.98, ha="right")
    return figure


def plot_depth(result: Outcome, ax: Axes | None = None) -> Figure:
    """Draw the standard deviation of measured depths over the boards' range, from the lens and from the pupil."""
    d = result.depths
    ax = new_axes(ax, width=5.6, height=3.4)
    half = 0.5 * (d["high_95"] - d["low_95"])
    ax.fill_between(d["distance"], 0, half, color=PALE, linewidth=0, label="half the 95 % interval, from the lens")
    ax.plot(d["distance"], d["from_lens"], color=BLUE, label="σ of Z, from the lens")
    ax.plot(d["distance"], d["from_pupil"], color=VERMILLION, linestyle=(0, (5, 2)), label="σ of Z from the FAP")
    d_3 = result.estimates["d_3"].value
    boards = d_3 + result.calibration.fit.poses.translation[:, 2]
    ax.plot(boards, np.zeros(len(boards)), "|", color=INK, markersize=9, clip_on=False, label="boards")
    ax.grid(axis="y")
    ax.set(xlabel="distance from the lens [mm]", ylabel="systematic depth error [mm]")
    ax.set(xlim=(d["distance"][0], d["distance"][-1]))
    ax.set_ylim(0, 1.35 * float(half.max()))
    ax.legend(loc="upper left", ncols=2)
    figure: Figure = ax.figure  # type: ignore[assignment]
    return figure


PLOTS: dict[str, tuple[str, Callable[[Outcome], Figure]]] = {
    "residuals": ("What the joint fit leaves over", plot_residuals),
    "epi-lines": ("Epipolar slopes against inverse depth", plot_lines),
    "posterior": ("How sure: the posterior", plot_posterior),
    "depth": ("What it means for measured depths", plot_depth),
}
"""Name of each figure's file: its title and what draws it."""


def drawn(result: Outcome) -> dict[str, Figure]:
    """Every figure that the calibration has."""
    with drawing():
        return {name: plot(result) for name, (_, plot) in PLOTS.items()}


def _histogram(ax: Axes, values: Array, ends: Array) -> None:
    heights, edges = np.histogram(values, 40, (float(ends[0]), float(ends[1])))
    ax.stairs(heights, edges, color=BLUE, fill=True, alpha=0.35)
    ax.stairs(heights, edges, color=BLUE)
    low, middle, high = np.quantile(values, (0.16, 0.5, 0.84))
    ax.axvline(middle, color=INK, linewidth=0.8)
    for end in (low, high):
        ax.axvline(end, color=INK, linewidth=0.7, linestyle=(0, (3, 2)))
    ax.set_ylim(0, 1.08 * heights.max())
    ax.set_yticks([])


def _regions(ax: Axes, x: Array, y: Array, x_ends: Array, y_ends: Array) -> None:
    """Regions of highest density that hold 68 and 95 % of the draws."""
    from scipy.ndimage import gaussian_filter

    bounds = [(float(a), float(b)) for a, b in (x_ends, y_ends)]
    counts, x_edges, y_edges = np.histogram2d(x, y, 44, bounds)
    density = gaussian_filter(counts, 1.1)
    ranked = np.sort(density.ravel())[::-1]
    held = np.cumsum(ranked) / ranked.sum()
    levels = [float(ranked[np.searchsorted(held, share)]) for share in (0.95, 0.68)]
    middles = [(edges[1:] + edges[:-1]) / 2 for edges in (x_edges, y_edges)]
    top = float(density.max()) * 1.01
    if levels[0] < levels[1] < top:
        ax.contourf(*middles, density.T, [*levels, top], colors=[SKY, BLUE], alpha=0.75)
        ax.contour(*middles, density.T, levels, colors=BLUE, linewidths=0.6)


def _label(name: str) -> str:
    unit = "mm" if name == "f" else UNITS[name]
    symbol = name.replace("_", "$_{") + "}$" if "_" in name else name
    return f"{symbol} [{unit}]" if unit else symbol
