"""The 3D scene as outlines: a vector drawing that needs no OpenGL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..meshes import AROUND, mesh_of
from .style import BLOCKED, FIELD_COLOURS, GREY, WIDTH, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..scene3d import Name, Scene

Floats = NDArray[np.float64]
POINTS = 0.32
"""Widths of a scene's lines in points, for each of its pixels."""


def plot_outlines(scene: Scene, ax: Axes | None = None) -> Axes:
    """Draw a scene in its own view, what is farther first.

    Parameters
    ----------
    scene : Scene
        Of `scene3d.instrument_scene`.
    ax : Axes, optional
        To draw on; a new figure's where none is given.

    Returns
    -------
    Axes
        In pixels of the scene's window, without ticks.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    width, height = scene.data["window"]
    ax = new_axes(ax, height=WIDTH * height / width)
    found = [(part, *_projected(scene, part)) for part in scene.data["parts"]]
    for part, flat, _ in sorted(found, key=lambda one: -one[2]):
        colour, opacity = part["colour"], part.get("opacity", 1.0)
        if part["kind"] == "lines":
            start = 0
            for line in part["lines"]:
                ax.plot(*flat[start : start + len(line)].T, color=colour, linewidth=POINTS * part["width"])
                start += len(line)
            continue
        loops = [flat[:AROUND], flat[AROUND:][::-1]] if part["kind"] == "ring" else [outline(flat)]
        path = Path.make_compound_path(*(Path(np.concatenate([loop, loop[:1]]), closed=True) for loop in loops))
        ax.add_patch(PathPatch(path, facecolor=colour, alpha=opacity, edgecolor="none"))
    place_names(ax, scene.names, width, height)
    return ax


def _projected(scene: Scene, part: Mapping[str, Any]) -> tuple[Floats, float]:
    """Points of a part in pixels of the window, shape (N, 2), and how far away their middle is."""
    camera, (width, height) = scene.data["camera"], scene.data["window"]
    focus, up = np.array(camera["focus"]), np.array(camera["up"])
    away = focus - np.array(camera["position"])
    away /= np.linalg.norm(away)
    points = mesh_of(part).points - focus
    scale = 0.5 * height / camera["scale"]
    flat = np.stack([width / 2 + scale * points @ np.cross(away, up), height / 2 + scale * points @ up], axis=-1)
    return flat, float(np.mean(points @ away))


def outline(points: Floats) -> Floats:
    """Corners of the convex hull of points in a plane, shape (M, 2), counter-clockwise."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    halves = []
    for direction in (ordered, ordered[::-1]):
        half: list[tuple[float, float]] = []
        for x, y in direction:
            while len(half) > 1 and _turn(half[-2], half[-1], (x, y)) <= 0:
                half.pop()
            half.append((x, y))
        halves.append(half[:-1])
    return np.array(halves[0] + halves[1])


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Above 0 where a, b, c turn left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def place_names(ax: Axes, names: Sequence[Name], width: float, height: float) -> None:
    """Write names into a view of that many pixels, with a legend of the rays' colours; frame it without ticks."""
    reached: list[float] = []
    for name in names:
        x, y = name.x * width, name.y * height
        if not name.above:
            ax.text(0.005 * width, 0.02 * height, name.text, ha="left", va="bottom", fontsize=8, color=GREY)
            continue
        half = 0.0062 * width * len(name.text)
        x_text = min(x, width - half)
        row = next((r for r, end in enumerate(reached) if x_text - half > end), len(reached))
        reached[row : row + 1] = [x_text + half]
        y_text = y + (0.035 + 0.05 * row) * height
        ax.plot([x, x], [y, y_text], color=GREY, linewidth=0.6)
        ax.text(x_text, y_text, name.text, ha="center", va="bottom", fontsize=8)
    for label, colour in zip(("centre", "edge", "corner", "blocked"), (*FIELD_COLOURS, BLOCKED), strict=True):
        ax.plot([], [], color=colour, label=label)
    ax.legend(loc="lower right", ncols=4, borderaxespad=0.1)
    ax.set(xlim=(0, width), ylim=(0, height))
    ax.set_axis_off()
