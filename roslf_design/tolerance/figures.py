"""Figures of a study: yield over tolerance, grades, ranked sensitivities, correlations, the weakest metric's spread."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..report.figures.style import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    ORANGE_TEXT,
    PALE,
    SKY,
    VERMILLION,
    drawing,
    new_axes,
    to_png,
    to_svg,
)
from ..words import in_words
from .analyses import LimitYield
from .metrics import METRICS
from .places import short_name
from .result import StudyResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 14
"""Bars that a ranking shows."""
MAJOR = 0.9
"""Height of a bar."""


def plot_yield(result: StudyResult, ax: Axes | None = None) -> Axes:
    """Draw the yield over a common factor on all tolerances, with its interval, the target and what meets it."""
    ax = new_axes(ax, width=5.2, height=3.4)
    scales = [scale for scale, _ in result.yield_curve]
    values = [100 * point.value for _, point in result.yield_curve]
    low, high = (np.array([100 * point.interval[end] for _, point in result.yield_curve]) for end in (0, 1))
    ax.fill_between(scales, low, high, color=SKY, alpha=0.4, linewidth=0, label="95 % interval")
    ax.plot(scales, values, "o-", color=BLUE, markersize=3.5, label="yield")
    ax.axvline(1, color=GREY, linewidth=0.8, linestyle=(0, (6, 3)))
    ax.text(1, 2, " as given", color=GREY, va="bottom", ha="left")
    target = 100 * result.study.yield_target
    ax.axhline(target, color=ORANGE, linewidth=1)
    if result.scale_for_target is not None:
        scale = min(result.scale_for_target[0], max(scales))
        ax.plot(scale, target, "D", color=VERMILLION, markeredgecolor="white", markersize=7)
        text = f"{target:.3g} % at {result.scale_for_target[0]:.3g} times"
        ax.annotate(
            text, (scale, target), xytext=(-8, -8), textcoords="offset points", color=ORANGE_TEXT, ha="right", va="top"
        )
    ax.set_xscale("log")
    ax.set_xticks([0.25, 0.5, 1, 2, 4], ["0.25", "0.5", "1", "2", "4"])
    ax.minorticks_off()
    ax.grid(axis="y")
    ax.set(xlabel="all tolerances times", ylabel="yield [%]", ylim=(0, 103), xlim=(scales[0], scales[-1]))
    ax.legend(loc="lower left")
    return ax


def plot_sensitivity(result: StudyResult, ax: Axes | None = None) -> Axes:
    """Draw how far each perturbation alone moves the weakest metric, ranked, at both ends of its tolerance."""
    limit, row = _weakest(result)
    found = result.sensitivity
    order = _largest(np.nan_to_num(found.worst[-1, row], posinf=np.finfo(float).max))
    ax = new_axes(ax, width=5.6, height=0.9 + 0.24 * len(order))
    places = np.arange(len(order))[::-1]
    plus, minus = (np.nan_to_num(moves[-1, row, order]) for moves in (found.plus, found.minus))
    ax.barh(places + MAJOR / 4, plus, MAJOR / 2, color=BLUE, label="at + tolerance")
    ax.barh(places - MAJOR / 4, minus, MAJOR / 2, color=ORANGE, label="at \u2212 tolerance")
    names = [short_name(result.plan.draws.perturbations[index].place) for index in order]
    ax.set_yticks(places, names)
    nominal = _nominal(result, row)
    reach = max(float(np.abs([plus, minus]).max()), 1e-300)
    near = [edge - nominal for edge in (limit.low, limit.high) if abs(edge - nominal) < 3 * reach]
    for edge in near:
        _mark_limit(ax, edge)
    ax.margins(x=0.15 if near else 0.05)
    ax.axvline(0, color=INK, linewidth=0.7)
    ax.grid(axis="x")
    ax.set(xlabel=f"change of {_axis(result, row)}", ylim=(-0.7, len(order) - 0.3))
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    return ax


def plot_correlations(result: StudyResult, ax: Axes | None = None) -> Axes:
    """Draw the correlation of each perturbation with the weakest metric over all trials, ranked."""
    _, row = _weakest(result)
    values = result.correlations[row]
    noise = 2 / np.sqrt(result.plan.trials)
    order = _largest(np.where(np.abs(values) > noise, np.abs(values), 0.0))
    ax = new_axes(ax, width=5.6, height=0.9 + 0.2 * len(order))
    places = np.arange(len(order))[::-1]
    ax.axvspan(-noise, noise, color=PALE, alpha=0.8, linewidth=0)
    ax.barh(places, values[order], 0.7, color=[BLUE if values[index] > 0 else ORANGE for index in order])
    ax.set_yticks(places, [short_name(result.plan.draws.perturbations[index].place) for index in order])
    ax.axvline(0, color=INK, linewidth=0.7)
    ax.grid(axis="x")
    ax.set(xlabel=f"correlation with {_axis(result, row, unit=False)}", xlim=(-1.05, 1.05))
    return ax


def plot_grades(result: StudyResult, ax: Axes | None = None) -> Axes:
    """Draw the yield that each grade of tolerances gives."""
    ax = new_axes(ax, width=3.6, height=3.0)
    values = np.array([100 * grade.result.value for grade in result.grades])
    ends = np.array([[100 * end for end in grade.result.interval] for grade in result.grades])
    places = [float(place) for place in range(len(values))]
    colours = [BLUE if grade.grade == result.study.grade else SKY for grade in result.grades]
    errors = np.abs(ends.T - values)
    ax.bar(places, values, 0.6, color=colours, yerr=errors, error_kw={"ecolor": INK, "elinewidth": 0.8, "capsize": 3})
    for place, value in zip(places, values, strict=True):
        ax.text(place, min(value, 100) + 3, f"{value:.1f} %", ha="center")
    ax.axhline(100 * result.study.yield_target, color=ORANGE, linewidth=1)
    ax.text(len(values) - 0.6, 100 * result.study.yield_target, "target", color=ORANGE_TEXT, ha="left", va="top")
    ax.set_xticks(places, [grade.grade for grade in result.grades])
    ax.set(ylabel="yield [%]", ylim=(0, 112), xlim=(-0.6, len(values) - 0.1), xlabel="grade of tolerances")
    return ax


def plot_spread(result: StudyResult, ax: Axes | None = None) -> Axes:
    """Draw the distribution of the weakest metric, as built and, where anything is adjusted, afterwards."""
    limit, row = _weakest(result)
    ax = new_axes(ax, width=5.2, height=3.2)
    shown = [result.variants[0]] if len(result.variants) == 1 else [result.variants[0], result.final]
    styles = ((True, SKY, 0.6), (False, BLUE, 1.0))
    for variant, (filled, colour, alpha) in zip(shown, styles, strict=False):
        column = variant.distributions[row]
        if column.cuts:
            cuts, bars = np.array(column.cuts), np.array(column.histogram)
            density = bars / bars.sum() / np.diff(cuts)
            ax.stairs(density, cuts, fill=filled, color=colour, alpha=alpha, label=variant.name)
    column = shown[-1].distributions[row]
    edges = [edge for edge in (limit.low, limit.high) if np.isfinite(edge)]
    reach = max(column.high - column.low, *(abs(edge - column.nominal) for edge in edges))
    left, right = ax.get_xlim()
    low, high = min([left, *edges]) - 0.1 * reach, max([right, *edges]) + 0.1 * reach
    ax.set_xlim(max(low, column.nominal - 1.5 * reach), min(high, column.nominal + 1.5 * reach))
    for edge in edges:
        _mark_limit(ax, edge, column.nominal)
    ax.axvline(_nominal(result, row), color=GREY, linewidth=0.8, linestyle=(0, (6, 3)))
    ax.set(xlabel=_axis(result, row), ylabel="share of builds per unit", ylim=(0, None))
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    return ax


PLOTS: dict[str, tuple[str, Callable[[StudyResult], Axes]]] = {
    "yield": ("Yield over tolerance", plot_yield),
    "grades": ("What a grade buys", plot_grades),
    "spread": ("Spread of the weakest metric", plot_spread),
    "sensitivity": ("What moves the weakest metric", plot_sensitivity),
    "correlation": ("What goes with the weakest metric", plot_correlations),
}
"""Name to title and drawing function."""


def drawn(result: StudyResult) -> dict[str, Figure]:
    """Every figure that the study has something for."""
    figures: dict[str, Figure] = {}
    with drawing():
        for name, (_, plot) in PLOTS.items():
            if name == "grades" and not result.grades:
                continue
            figure = plot(result).figure
            figures[name] = figure  # type: ignore[assignment]
    return figures


def pictures(result: StudyResult) -> dict[str, bytes]:
    """Every figure as the bytes of files: name with suffix to content, SVG and PNG."""
    files: dict[str, bytes] = {}
    for name, figure in drawn(result).items():
        files[f"{name}.svg"] = svg_file(figure, name)
        files[f"{name}.png"] = to_png(figure)
    return files


def svg_file(figure: Figure, name: str) -> bytes:
    """A figure as a file of its own: as for a page, with the fonts a page would give it."""
    text = to_svg(figure, f"tolerance-{name}")
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return (head + text.replace("<svg ", '<svg font-family="DejaVu Sans, Verdana, sans-serif" ', 1) + "\n").encode()


def _mark_limit(ax: Axes, place: float, nominal: float = 0.0) -> None:
    """A limit's line, its name on the side where nothing is allowed."""
    ax.axvline(place, color=VERMILLION, linewidth=1.2)
    above = place >= nominal
    text, side = (" limit", "left") if above else ("limit ", "right")
    ax.text(place, 0.98, text, color=VERMILLION, ha=side, va="top", transform=ax.get_xaxis_transform())


def _largest(sizes: NDArray[np.float64]) -> NDArray[np.intp]:
    """Where the largest are, in order; without those too small to be seen."""
    order = np.argsort(-sizes, kind="stable")[:MOST]
    seen = order[sizes[order] > 2e-3 * sizes[order[0]]]
    return seen if len(seen) else order[:1]


def _weakest(result: StudyResult) -> tuple[LimitYield, int]:
    limit = result.final.weakest
    return limit, [column.label for column in result.plan.columns].index(limit.label)


def _nominal(result: StudyResult, row: int) -> float:
    value = result.variants[0].distributions[row].nominal
    return value if np.isfinite(value) else 0.0


def _axis(result: StudyResult, row: int, unit: bool = True) -> str:
    column = result.plan.columns[row]
    metric = METRICS[column.metric]
    place = ""
    if column.field is not None:
        x, y = result.plan.question.fields[column.field]
        place = f" at ({x:.3g}, {y:.3g}) mm"
    return f"{in_words(metric.name)}{place}" + (f" [{metric.unit}]" if unit and metric.unit else "")
