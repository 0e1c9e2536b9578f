"""How an optimisation went: what every start came to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .style import BLUE, GREY, ORANGE, VERMILLION, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...optimize.solve import Answer

FLOOR = 1e-6
"""Differences [%] below are drawn here: the same design."""


def plot_search_history(answer: Answer, ax: Axes | None = None) -> Axes:
    """Draw each start's and each check's end, as a loss against the answer, over the evaluations spent so far.

    Parameters
    ----------
    answer : Answer
        What the study found.
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    """
    ax = new_axes(ax, width=6.0, height=2.9)
    spent, good, bad = 0, ([], []), []  # type: tuple[int, tuple[list[float], list[float]], list[float]]
    for search in answer.searches:
        spent += search.evaluations
        if search.feasible:
            good[0].append(spent)
            good[1].append(max(100 * (search.merit - answer.merit), FLOOR))
        else:
            bad.append(spent)
    ax.plot(*good, "o", color=BLUE, markersize=5, label="a start's end", clip_on=False)
    if bad:
        ax.plot(bad, [1.0] * len(bad), "x", color=VERMILLION, label="ended where a limit fails", clip_on=False)
    checked = [check for check in answer.checks if check.polished.feasible]
    for number, check in enumerate(checked):
        spent += check.evaluations
        loss = max(100 * (check.polished.merit - answer.merit), FLOOR)
        label = "another solver's end" if number == 0 else None
        ax.plot(spent, loss, "D", color=ORANGE, markersize=6, label=label, clip_on=False)
        ax.annotate(
            check.solver, (spent, loss), xytext=(0, 7), textcoords="offset points", ha="right", color=GREY, fontsize=7.5
        )
    ax.set_yscale("log")
    ax.set_ylim(FLOOR, max(ax.get_ylim()[1], 1.0))
    ax.set(xlabel="evaluations of the whole problem so far [1]", ylabel="goals worse than the answer by [%]")
    ax.set_xlim(left=0)
    ax.grid(True)
    ax.legend(loc="upper left", bbox_to_anchor=(0, 1.14), ncols=3, borderaxespad=0)
    return ax
