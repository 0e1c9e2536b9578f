"""Pictures of a study: the front, what one stop makes of a bore, the price of robustness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..report.figures.style import BLUE, GREY, ORANGE, VERMILLION, drawing, new_axes
from ..words import in_words
from .bore import Bore
from .pareto import Front
from .problem import Goal
from .robust import Robust
from .run import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def drawn(result: Result) -> dict[str, Figure]:
    """Name to figure; empty where a study has nothing to draw."""
    found = {}
    with drawing():
        if result.bore is not None:
            found["bore"] = plot_bore(result.bore)
        if result.front is not None and len(result.front.points) > 1:
            found["front"] = plot_front(result.front, result)
        if result.robust is not None:
            found["robust"] = plot_robust(result.robust)
    return found


def plot_front(front: Front, result: Result) -> Figure:
    """The first goal over the second; the third, where there is one, by shade."""
    ax = new_axes(None, 6.0, 3.8)
    values = np.array([point.values for point in front.points])
    first, second = front.goals[:2]
    if len(front.goals) == 2:
        order = np.argsort(values[:, 1])
        ax.plot(values[order, 1], values[order, 0], "-o", color=BLUE, markersize=4)
    else:
        third, column = front.goals[2], values[:, 2]
        logarithmic = third.quantity.positive and column.max() > 3 * column.min() > 0
        shades = ax.scatter(
            values[:, 1],
            values[:, 0],
            c=column,
            cmap="cividis",  # even in lightness, and to every colour vision
            norm="log" if logarithmic else None,
            s=28,
            edgecolors=GREY,
            linewidths=0.4,
        )
        ax.figure.colorbar(shades, ax=ax, label=_axis(third))
    answer = [result.answer.number(goal) for goal in front.goals]
    ax.plot(answer[1], answer[0], "*", color=VERMILLION, markersize=11, zorder=5)
    ax.annotate("the optimum", (answer[1], answer[0]), xytext=(9, -4), textcoords="offset points", color=VERMILLION)
    for goal, axis, scale in ((second, ax.xaxis, ax.set_xscale), (first, ax.yaxis, ax.set_yscale)):
        column = values[:, front.goals.index(goal)]
        if goal.quantity.positive and column.max() > 3 * column.min() > 0:
            scale("log")
            _plain_ticks(axis)
    ax.set_xlabel(_axis(second))
    ax.set_ylabel(_axis(first))
    ax.grid(True)
    figure = ax.figure
    return figure  # type: ignore[return-value]


def _plain_ticks(axis: object) -> None:
    from matplotlib.axis import Axis
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    assert isinstance(axis, Axis)
    axis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _axis(goal: Goal) -> str:
    unit = f" [{goal.quantity.unit}]" if goal.quantity.unit else ""
    return f"{in_words(goal.label)}{unit} ({'less' if goal.direction == 'min' else 'more'} is better)"


def plot_bore(bore: Bore) -> Figure:
    """Kept light over the field, through the bore and through the one stop that stands for it."""
    pupil = bore.pupil
    ax = new_axes(None, 6.0, 3.2)
    ax.plot(pupil.field_mm, pupil.kept_bore, "-o", color=BLUE, markersize=4, label="bore, all rims")
    ax.plot(pupil.field_mm, pupil.kept_pupil, "--s", color=ORANGE, markersize=4, label="equivalent stop")
    ax.plot(pupil.field_mm, pupil.misplaced, ":^", color=VERMILLION, markersize=4, label="on the wrong side of its rim")
    ax.set_xlabel("microlens position from the axis [mm]")
    ax.set_ylabel("share of the equivalent\nstop's light")
    ax.set_ylim(bottom=0)
    ax.legend(loc="best")
    ax.grid(True)
    figure = ax.figure
    return figure  # type: ignore[return-value]


def plot_robust(robust: Robust) -> Figure:
    """Share of builds that hold each constraint, of the nominal and of the robust design."""
    rows = [*robust.constraint_yields, ("all together", robust.nominal.yield_.value, robust.robust.yield_.value)]
    ax = new_axes(None, 7.0, 0.9 + 0.42 * len(rows))
    places = np.arange(len(rows))[::-1]
    for shift, column, colour, label in ((0.2, 1, GREY, "nominal optimum"), (-0.2, 2, BLUE, "robust design")):
        values = [100 * float(row[column]) for row in rows]
        ax.barh(places + shift, values, 0.36, color=colour, label=label)
        for place, value in zip(places + shift, values, strict=True):
            ax.text(value + 1, place, f"{value:.1f} %", va="center", fontsize=8)
    ax.set_yticks(places, [in_words(str(row[0])) for row in rows])
    ax.set_xlim(0, 118)
    ax.set_xticks(range(0, 101, 20))
    ax.set_xlabel("builds that hold it [%]")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0 + 0.35 / len(rows) * 1.6), ncols=2)
    figure = ax.figure
    return figure  # type: ignore[return-value]
