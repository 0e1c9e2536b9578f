"""Work-precision diagrams: error against time, both logarithmic, one line a method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..report.figures.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILLION, WIDTH
from .choice import Answer
from .jobs import LENS
from .measure import WorkDiagram

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = {
    "closed form": (INK, "D"),
    "exact arc-pixel area": (INK, "D"),
    "harmonic series": (INK, "s"),
    "Gauss panels": (BLUE, "o"),
    "arc integrals": (INK, "D"),
    "adaptive quadrature": (SKY, "v"),
    "grid": (ORANGE, "s"),
    "Monte Carlo": (VERMILLION, "x"),
    "scrambled Sobol": (GREEN, "^"),
    "rays (Sobol)": (GREEN, "^"),
    "FFT": (ORANGE, "P"),
    "direct Huygens": (PURPLE, "o"),
    "exact trace": (INK, "D"),
    "polynomial surrogate": (BLUE, "o"),
    "thin lens": (GREY, "*"),
    "rays alone": (GREY, "*"),
    "first order": (GREY, "*"),
}
"""Colour and marker of each method: told apart by either."""

FLOORS = {LENS: "thin lens against the real one"}
"""What the floor's line is called, where it is not rays against waves."""

LEAST = 1e-17
MOST = {LENS: 30.0}
"""Errors above this are not drawn; of most quantities 3, where 1 is everything."""
COLUMNS = 2


def plot_diagrams(diagrams: Sequence[WorkDiagram], answers: Sequence[Answer | None] = ()) -> Figure:
    """Panels side by side, one legend.

    Parameters
    ----------
    diagrams : sequence of WorkDiagram
    answers : sequence of Answer or None
        What was chosen for each; its point gets a ring, its accuracy a line.
    """
    from matplotlib.figure import Figure

    rows = -(-len(diagrams) // COLUMNS)
    columns = min(COLUMNS, len(diagrams))
    figure = Figure(figsize=(WIDTH * (1.0 if columns > 1 else 0.75), 2.75 * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for n, ax in enumerate(axes.flat):
        if n >= len(diagrams):
            ax.set_axis_off()
            continue
        plot_diagram(ax, diagrams[n], answers[n] if n < len(answers) else None)
    for row in axes:
        row[0].set_ylabel("error")
    handles: dict[str, Any] = {}
    for ax in axes.flat[: len(diagrams)]:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4)
    return figure


def plot_diagram(ax: Axes, diagram: WorkDiagram, answer: Answer | None = None) -> None:
    """One job."""
    most = MOST.get(diagram.job.quantity, 3.0)
    drawn = [point for point in diagram.points if point.error_range[1] <= most]
    for name in dict.fromkeys(point.method for point in drawn):
        mine = [point for point in drawn if point.method == name]
        colour, marker = LOOKS[name]
        seconds = [point.seconds for point in mine]
        errors = [max(point.error, LEAST) for point in mine]
        spread = [
            [max(e, LEAST) - max(point.error_range[0], LEAST) for point, e in zip(mine, errors, strict=True)],
            [max(point.error_range[1], LEAST) - e for point, e in zip(mine, errors, strict=True)],
        ]
        across = [
            [point.seconds - point.seconds_range[0] for point in mine],
            [point.seconds_range[1] - point.seconds for point in mine],
        ]
        ax.errorbar(
            seconds, errors, yerr=spread, xerr=across, color=colour, marker=marker, markersize=4, linewidth=1.0,
            elinewidth=0.6, label=name, clip_on=False,
        )  # fmt: skip
    if diagram.floor is not None:
        name = FLOORS.get(diagram.job.quantity, "rays against waves")
        ax.axhline(diagram.floor, color=GREY, linestyle="--", linewidth=1.0, label=name)
    if answer is not None:
        _mark(ax, diagram, answer)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(LEAST, most)
    ax.set_yticks([1e-16, 1e-12, 1e-8, 1e-4, 1])
    ax.minorticks_off()
    ax.grid(True)
    ax.set_xlabel("time [s]")
    ax.set_title(f"{diagram.job.quantity}: {diagram.title}")


def _mark(ax: Axes, diagram: WorkDiagram, answer: Answer) -> None:
    choice = answer.choice
    ax.axhline(choice.accuracy, color=INK, linestyle=":", linewidth=1.0, label="accuracy asked for")
    for point in diagram.points:
        if (point.method, point.level) == (choice.method, choice.level):
            ax.plot(
                point.seconds, max(point.error, LEAST), "o", markersize=13, markerfacecolor="none",
                markeredgecolor=INK, markeredgewidth=1.4, label="chosen", zorder=5, clip_on=False,
            )  # fmt: skip
