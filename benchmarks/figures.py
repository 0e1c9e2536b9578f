"""Figures of the benchmarks' page: ratios with intervals, and time and memory against size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from roslf_design.pictures.axes import BLUE, GREY, INK, ORANGE, VERMILLION, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKS = {"peer": (BLUE, "o", "a peer"), "floor": (GREY, "D", "plain numpy, or writing alone")}


def ratio_rows(cases: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, Mapping[str, Any], str]]:
    """Case, other side, its ratio and its kind, for every ratio to another program."""
    found = []
    for case in cases:
        for side in case["sides"][1:]:
            if side["ratio"] is not None and side["program"] != "here":
                kind = "floor" if side["program"] == "numpy" else "peer"
                found.append((case["title"], side["label"], side["ratio"], kind))
    return found


def plot_ratios(cases: Sequence[Mapping[str, Any]], goals: Sequence[Mapping[str, Any]]) -> Figure:
    """A row for each ratio: median, interval, and the goal where there is one."""
    from matplotlib.figure import Figure

    wanted = {(goal["case"], goal["against"]): goal["least"] for goal in goals}
    names = {case["title"]: case["name"] for case in cases}
    rows = ratio_rows(cases)
    figure = Figure(figsize=(WIDTH, 0.7 + 0.34 * max(1, len(rows))), layout="constrained")
    ax = figure.subplots()
    seen: set[str] = set()
    last = ""
    for at, (title, label, ratio, kind) in enumerate(rows):
        colour, mark, word = MARKS[kind]
        low, high = ratio["value"] - ratio["low"], ratio["high"] - ratio["value"]
        ax.errorbar(
            ratio["value"], at, xerr=[[low], [high]], fmt=mark, color=colour, ms=5, capsize=3, lw=1.2,
            label=word if word not in seen else None,
        )  # fmt: skip
        seen.add(word)
        goal = wanted.get((names[title], label))
        if goal is not None:
            ax.plot(goal, at, "|", color=VERMILLION, ms=13, mew=2, label=None if "goal" in seen else "goal")
            seen.add("goal")
        if title != last and at:
            ax.axhline(at - 0.5, color="#e6e6e6", lw=0.7)
        last = title
    ax.axvline(1, color=INK, lw=0.8)
    ax.set_xscale("log")
    ax.set_yticks(range(len(rows)), [f"{_short(title)}: {label}" for title, label, _, _ in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlabel("time of the other over time here (right of 1: slower)")
    ax.grid(True, axis="x")
    if rows:
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return figure


def _short(title: str) -> str:
    """A title up to its first comma or colon."""
    for stop in (",", ":"):
        title = title.split(stop)[0]
    return title


def plot_scaling(scaling: Sequence[Mapping[str, Any]], bandwidth: Mapping[str, float]) -> Figure:
    """Time, and below it memory, against size; what memory's bandwidth alone would take is drawn in."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 2.7 * ((len(scaling) + 1) // 2)), layout="constrained")
    all_axes = figure.subplots((len(scaling) + 1) // 2, 2, squeeze=False).ravel()
    seen: dict[str, Any] = {}
    for ax, axis in zip(all_axes, scaling, strict=False):
        seen |= _panel(ax, axis, bandwidth)
    for ax in all_axes[len(scaling) :]:
        ax.axis("off")
    figure.legend(list(seen.values()), list(seen), loc="outside upper center", ncols=4)
    return figure


def _panel(ax: Axes, axis: Mapping[str, Any], bandwidth: Mapping[str, float]) -> dict[str, Any]:
    """Draw one way of growing; its lines by their names."""
    done = [point for point in axis["points"] if point["measured"]]
    guessed = [point for point in axis["points"] if not point["measured"] and point["seconds"]]
    ax.plot([p["size"] for p in done], [p["seconds"] for p in done], "o-", color=BLUE, ms=4, label="time, measured")
    if guessed:
        ax.plot(
            [p["size"] for p in guessed], [p["seconds"] for p in guessed], "o", mfc="white", color=BLUE, ms=5,
            label="time, extrapolated",
        )  # fmt: skip
    if axis["bytes_each"]:
        speed = bandwidth.get(str(axis["threads"])) or next(iter(bandwidth.values()))
        sizes = [point["size"] for point in axis["points"]]
        floor = [size * axis["bytes_each"] / speed for size in sizes]
        ax.plot(sizes, floor, "--", color=VERMILLION, lw=1.2, label="memory's bandwidth alone")
    if axis["name"] != "posterior":
        ax.set_xscale("log")
        ax.set_yscale("log")
    else:
        ax.set_ylim(0, 1.25 * max((point["seconds"] for point in done), default=1.0))
    ax.set_title(axis["title"])
    ax.set_xlabel(axis["unit"])
    ax.set_ylabel("time [s]")
    ax.grid(True)
    other = ax.twinx()
    other.spines["right"].set_visible(True)
    held = [point for point in done if point["peak_mib"]]
    other.plot([p["size"] for p in held], [p["peak_mib"] for p in held], "s:", color=ORANGE, ms=3.5, label="memory")
    other.set_ylim(0, 1.3 * max((point["peak_mib"] for point in held), default=1.0))
    other.set_ylabel("largest process [MiB]")
    return {str(line.get_label()): line for line in (*ax.get_lines(), *other.get_lines())}
