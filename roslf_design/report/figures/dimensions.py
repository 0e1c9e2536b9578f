"""A design's drawing with its dimensions: elements in their order along the axis, every length written in."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from ...words import length
from .style import GREY, INK, LENS_COLOUR, SKY, STOP_COLOURS, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

ROOM = 0.35
"""Exponent that brings distances of all sizes into one drawing; 1 would be to scale."""
WALL = 1.12
"""Where mounts end, in half heights of the tallest element."""


class Element(NamedTuple):
    """Something on the axis."""

    name: str
    z: float
    """In front of the lens below 0 [mm]."""
    diameter: float
    """Or height [mm]; 0 where it has none."""
    says: str
    """What is written above it."""


def plot_dimensions(design: Design, ax: Axes | None = None) -> Axes:
    """Draw the elements and their dimension lines; not to scale, the numbers are.

    Parameters
    ----------
    design : Design
    ax : Axes, optional
        To draw on; a new figure's where none is given.

    Returns
    -------
    Axes
        Without ticks: lengths are written, not read off.
    """
    elements = elements_of(design)
    ax = new_axes(ax, height=4.0 + 0.25 * len(design.stops))
    place = places(elements)
    tallest = max(element.diameter for element in elements)
    high = {e.name: max(0.16, math.sqrt(e.diameter / tallest)) for e in elements}
    left, right = place["object plane"], place["sensor"]
    ax.plot([left - 0.1, right + 0.25], [0, 0], color=GREY, linewidth=0.7, linestyle=(0, (9, 3, 2, 3)))
    for element in elements:
        _draw(ax, design, element, place[element.name], high[element.name])
    _write_above(ax, elements, place, high)
    level = -WALL - 0.25
    for text, start, end in dimension_lines(design):
        _dimension(ax, text, place[start], place[end], level, -high[start], -high[end])
        level -= 0.36
    ax.set(xlim=(left - 0.35, right + 0.55), ylim=(level + 0.05, WALL + 1.25))
    ax.set_axis_off()
    return ax


def elements_of(design: Design) -> list[Element]:
    """Everything on the axis, from the object to the sensor."""
    mla, (wide, tall) = design.microlens_array, design.sensor_size
    found = [
        Element("object plane", -design.d_f, 0.0, "object plane"),
        Element("FAP", -design.d_3, design.D_F, f"FAP\nD_F = {length(design.D_F)}"),
        Element("main lens", 0.0, design.D, f"main lens, D = {length(design.D)}\nf = {length(design.f)}"),
        Element("MLA", design.d_1, mla.size[1], f"MLA\nd = {length(design.d)}\nf_ml = {length(design.f_ml)}"),
        Element("sensor", design.d_1 + design.d_2, tall, f"sensor\nq = {length(design.q)}\n{wide:.4g} x {tall:.4g} mm"),
    ]
    for number, stop in enumerate(design.stops, 1):
        found.append(
            Element(f"stop {number}", -stop.distance, stop.diameter, f"stop {number}\n{length(stop.diameter)}")
        )
    return sorted(found, key=lambda element: element.z)


def places(elements: list[Element]) -> dict[str, float]:
    """Where each element is drawn, from 0 at the object plane to 8 at the sensor, in their order."""
    gaps = [b.z - a.z for a, b in pairwise(elements)]
    widest = max(gaps)
    drawn = [max(0.28, (gap / widest) ** ROOM) for gap in gaps]
    found, at = {elements[0].name: 0.0}, 0.0
    for element, gap in zip(elements[1:], drawn, strict=True):
        at += gap
        found[element.name] = at
    return {name: 8 * x / at for name, x in found.items()}


def dimension_lines(design: Design) -> list[tuple[str, str, str]]:
    """What each dimension line says, and the elements it runs between."""
    lines = [
        (f"d_2 = {length(design.d_2)}", "MLA", "sensor"),
        (f"d_1 = {length(design.d_1)}", "main lens", "MLA"),
        (f"d_3 = {length(design.d_3)}", "FAP", "main lens"),
    ]
    for number, stop in enumerate(design.stops, 1):
        lines.append((f"stop {number}: {length(stop.distance)}", f"stop {number}", "main lens"))
    lines.append((f"d_f = {length(design.d_f)}", "object plane", "main lens"))
    front = max(design.all_stops, key=lambda stop: stop.distance)
    name = "FAP" if front is design.all_stops[0] else f"stop {design.all_stops.index(front)}"
    name = name if front.distance > 0 else "main lens"
    overall = max(front.distance, 0.0) + design.d_1 + design.d_2
    lines.append((f"overall {length(overall)}", name, "sensor"))
    return lines


def _draw(ax: Axes, design: Design, element: Element, x: float, half: float) -> None:
    from matplotlib.patches import Ellipse, Rectangle

    if element.name == "object plane":
        ax.plot([x, x], [-0.8, 0.8], color=INK, linewidth=1, linestyle=(0, (4, 3)))
    elif element.name == "main lens":
        ax.add_patch(Ellipse((x, 0), 0.26, 2 * half, facecolor=SKY, edgecolor=LENS_COLOUR, linewidth=1, alpha=0.75))
    elif element.name == "MLA":
        count = 11
        for k in range(count):
            y = (2 * k + 1 - count) * half / count
            ax.add_patch(Ellipse((x, y), 0.1, 2 * half / count, facecolor=SKY, edgecolor=LENS_COLOUR, linewidth=0.5))
    elif element.name == "sensor":
        ax.add_patch(Rectangle((x, -half), 0.09, 2 * half, facecolor=INK, edgecolor=INK))
    else:
        colour = INK if element.name == "FAP" else STOP_COLOURS[(int(element.name.split()[1]) - 1) % len(STOP_COLOURS)]
        for sign in (-1, 1):
            ax.plot([x, x], [sign * half, sign * WALL], color=colour, linewidth=3, solid_capstyle="butt")


def _write_above(ax: Axes, elements: list[Element], place: dict[str, float], high: dict[str, float]) -> None:
    """What each element is, above it; one row higher where its neighbour's words would touch."""
    reached = [-math.inf] * 3
    for element in elements:
        x = place[element.name]
        half = 0.055 * max(len(line) for line in element.says.split("\n"))
        row = next((r for r, end in enumerate(reached) if x - half > end), 0)
        shift = 0.0
        if all(x - half <= end for end in reached):
            row = min(range(len(reached)), key=lambda r: reached[r])
            shift = reached[row] - (x - half) + 0.05
        reached[row] = x + half + shift
        bottom = WALL + 0.12 + 0.58 * row
        top = 0.8 if element.name == "object plane" else high[element.name]
        top = WALL if element.name == "FAP" or element.name.startswith("stop") else top
        ax.plot([x, x + shift], [top + 0.03, bottom - 0.03], color=GREY, linewidth=0.5)
        ax.text(x + shift, bottom, element.says, ha="center", va="bottom", fontsize=7.5, linespacing=1.25)


def _dimension(ax: Axes, text: str, start: float, end: float, level: float, from_start: float, from_end: float) -> None:
    for x, top in ((start, from_start), (end, from_end)):
        ax.plot([x, x], [top - 0.04, level - 0.05], color=GREY, linewidth=0.4)
    style = {
        "arrowstyle": "<|-|>,head_length=0.35,head_width=0.12",
        "color": INK,
        "linewidth": 0.7,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    ax.annotate("", (start, level), (end, level), arrowprops=style)
    wide = end - start > 0.06 * len(text) * 2
    paper = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    if wide:
        ax.text((start + end) / 2, level, text, ha="center", va="center", fontsize=8, bbox=paper)
    else:
        ax.text(start - 0.08, level, text, ha="right", va="center", fontsize=8, bbox=paper)
