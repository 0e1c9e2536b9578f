"""Zoom on microlens array and sensor: several microlenses, the cone behind each, and the pixels it covers."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...camera import Camera
from ...rays import PASSED, trace_pupil
from .style import BLOCKED, BLUE, GREY, INK, PALE, SKY, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

Floats = NDArray[np.float64]


def plot_cells(design: Design, place: float = 0.0, ax: Axes | None = None, microlenses: int = 5) -> Axes:
    """Draw neighbouring microlenses along x with their light cones and the pixels behind them; scales differ.

    Parameters
    ----------
    design : Design
    place : float
        x of the middle microlens on the MLA [mm].
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    microlenses : int
        How many; an odd number.

    Returns
    -------
    Axes
        Abscissa: distance behind the MLA [um]; ordinate: height from the middle microlens's axis [um].
    """
    ax = new_axes(ax, width=4.0, height=3.2)
    half = microlenses // 2
    offsets = design.d * np.arange(-half, half + 1)
    share = np.linspace(-1, 1, 129)
    rays = trace_pupil(Camera.of(design), (share, 0.0), (place + offsets[:, None], 0.0))
    origin = place + design.microlens_array.decentre[0]
    landing = 1e3 * (rays.sensor[0] + design.sensor.decentre[0] - origin)
    passed = np.isin(rays.status, PASSED)
    depth, axes = 1e3 * design.d_2, 1e3 * offsets
    for axis, ends, lit, colour in zip(axes, landing, passed, _alternating(microlenses), strict=True):
        for start, stop, kept in _runs(lit):
            edge = ends[[start, stop]]
            look = (
                {"facecolor": colour, "alpha": 0.4}
                if kept
                else {"facecolor": "none", "edgecolor": BLOCKED, "hatch": "////"}
            )
            ax.fill([0, depth, depth], [axis, *edge], linewidth=0, **look)
            ax.plot([depth, 0, depth], [edge[0], axis, edge[1]], color=colour if kept else BLOCKED, linewidth=0.7)
    _draw_lenses(ax, axes, 1e3 * design.d, depth)
    low, high = axes[0] - 600 * design.d, axes[-1] + 600 * design.d
    low, high = min(low, float(landing.min())), max(high, float(landing.max()))
    _draw_pixels(ax, design, 1e3 * (origin - design.sensor.decentre[0]), low, high, depth)
    ax.set(
        xlim=(-0.16 * depth, 1.16 * depth), ylim=(low, high),
        xlabel="distance behind the MLA [µm]", ylabel="height from this microlens's axis [µm]",
    )  # fmt: skip
    return ax


def _alternating(count: int) -> list[str]:
    return [BLUE if (k - count // 2) % 2 == 0 else SKY for k in range(count)]


def _runs(lit: NDArray[np.bool_]) -> list[tuple[int, int, bool]]:
    """Stretches of equal fate: first and last index (shared with the next stretch), and the fate."""
    cuts = [0, *(np.flatnonzero(np.diff(lit.astype(int))) + 1).tolist(), len(lit) - 1]
    return [(a, b, bool(lit[a])) for a, b in pairwise(cuts) if b > a]


def _draw_lenses(ax: Axes, axes: NDArray[np.floating], pitch: float, depth: float) -> None:
    t = np.linspace(-1, 1, 31)
    for axis in axes:
        bulge = 0.03 * depth * (1 - t**2)
        ax.fill(
            np.concatenate([-bulge, bulge[::-1]]), axis + pitch / 2 * np.concatenate([t, t[::-1]]),
            facecolor=PALE, edgecolor=GREY, linewidth=0.7,
        )  # fmt: skip


def _draw_pixels(ax: Axes, design: Design, origin: float, low: float, high: float, depth: float) -> None:
    from matplotlib.collections import PolyCollection

    size = 1e3 * design.q
    # The sensor's first pixel starts at its edge.
    edge = -500 * design.pixels[0] * design.q - origin
    first, last = int(np.floor((low - edge) / size)), int(np.ceil((high - edge) / size))
    first, last = max(first, 0), min(last, design.pixels[0])
    starts = edge + size * np.arange(first, last)
    left, right = depth, 1.06 * depth
    boxes = [[(left, y), (right, y), (right, y + size), (left, y + size)] for y in starts]
    colours = [PALE if k % 2 else "white" for k in range(first, last)]
    ax.add_collection(
        PolyCollection(boxes, facecolors=colours, edgecolors=GREY, linewidths=min(0.3, 15 / max(1, last - first)))
    )
    ax.plot([depth, depth], [low, high], color=INK, linewidth=1.2)
