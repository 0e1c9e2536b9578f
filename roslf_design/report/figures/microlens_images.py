"""One microlens image: its exact outline and the exact share of each pixel that it covers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...evaluation.fields import field_discs
from ...evaluation.rims import axes_in_space, rims
from ...microlens._pixels import LARGEST_RADIUS
from ...microlens.cells import area_in_rectangle
from ...microlens.coverage import LARGEST_PART, coverage_image
from ...microlens.discs import intersect, outline
from ...microlens.lattice import cell_polygon
from ...theory.pupils import microlens_image_pitch
from .style import FAP_COLOUR, GREEN, GREY, INK, LENS_COLOUR, STOP_COLOURS, VERMILLION, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

Floats = NDArray[np.float64]


GRID_UP_TO = 60
"""Pixels across a picture up to which lines are drawn between them."""


class ImageView(NamedTuple):
    """A microlens image; lengths relative to its microlens's axis [mm]."""

    centres: Floats
    """Of the rims' discs, the FAP first, shape (K, 2)."""
    radii: Floats
    """Shape (K,)."""
    outline: Floats
    """Shape (N, 2), not closed; (0, 2) where dark."""
    cell: Floats
    """Corners of its own cell, shape (M, 2)."""
    x: Floats
    """Edges of the pixels seen, shape (I + 1,)."""
    y: Floats
    """Shape (J + 1,)."""
    coverage: Floats
    """Share of each pixel that the image covers, shape (J, I); (0, 0) where there are more than was asked for
    or a disc is too large for it."""
    kept_fraction: float
    on_sensor: float
    """Share of the image that falls on the sensor; 1 where dark."""
    half: float
    """Half width of a view that shows the FAP's disc and the cell."""


def image_view(design: Design, place: tuple[float, float], most: float = math.inf) -> ImageView:
    """The image behind a microlens.

    Parameters
    ----------
    design : Design
    place : (x, y)
        The microlens's axis on the MLA [mm].
    most : float
        Pixels in view up to which each is looked at.
    """
    discs, sizes = field_discs(design, [place])
    centres, radii = discs[0], sizes[0]
    pitch = abs(float(microlens_image_pitch(design.d, design.d_2, design.f, design.d_f, design.d_3)))
    cell = cell_polygon(design.microlens_array.layout, pitch, design.microlens_array.rotation) + centres[0]
    half = 1.12 * max(float(radii[0]), float(np.max(np.abs(cell - centres[0]))))
    (axis,) = axes_in_space(design, [place])
    middle = centres[0] + axis
    columns, rows = (_pixels_within(design, side, middle[side] - half, middle[side] + half) for side in (0, 1))
    count = (columns.stop - columns.start) * (rows.stop - rows.start)
    drawable = radii.max() <= LARGEST_RADIUS * design.q and 2 * radii.min() <= LARGEST_PART * design.q
    drawable = drawable and count <= most
    x, y = (_edges(design, side, seen, drawable) - axis[side] for side, seen in enumerate((columns, rows)))
    shares = np.zeros((0, 0))
    if drawable and count:
        covered = coverage_image(
            axis, centres, radii, pixel=design.q, size=design.pixels, sensor_centre=design.sensor.decentre,
            window=(rows, columns),
        )  # fmt: skip
        shares = np.asarray(covered, float)
    image = intersect(centres, radii)
    half_sensor, sensor = np.multiply(design.pixels, design.q / 2), np.subtract(design.sensor.decentre, axis)
    seen = 0.0
    if half_sensor.min() > 0:
        seen = float(area_in_rectangle(centres, radii, sensor - half_sensor, sensor + half_sensor))
    on_sensor = min(seen / float(image.area), 1.0) if image.lit else 1.0
    kept = float(image.kept_fraction)
    return ImageView(centres, radii, outline(centres, radii), cell, x, y, shares, kept, on_sensor, half)


def _pixels_within(design: Design, side: int, low: float, high: float) -> slice:
    """Pixels from the one that holds `low` to the one that holds `high` [mm]; those on the sensor."""
    count = design.pixels[side]
    start = design.sensor.decentre[side] - count * design.q / 2
    first, last = math.floor((low - start) / design.q), math.ceil((high - start) / design.q)
    return slice(min(max(first, 0), count), min(max(last, 0), count))


def _edges(design: Design, side: int, seen: slice, each: bool) -> Floats:
    """Edges between these pixels [mm], one more than there are pixels; or the outermost ones alone."""
    start = design.sensor.decentre[side] - design.pixels[side] * design.q / 2
    numbers = np.arange(seen.start, seen.stop + 1) if each else np.unique([seen.start, seen.stop])
    return np.asarray(start + design.q * numbers, float)


def plot_microlens_image(
    design: Design, place: tuple[float, float] = (0.0, 0.0), ax: Axes | None = None, view: ImageView | None = None
) -> Axes:
    """Draw a microlens image on its pixels, with the discs of the single rims, its cell and its chief ray.

    Parameters
    ----------
    design : Design
    place : (x, y)
        The microlens's axis on the MLA [mm].
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    view : ImageView, optional
        As `image_view` gives it, where it is known already.

    Returns
    -------
    Axes
        In um, relative to the microlens's axis.
    """
    alone, ax = ax is None, new_axes(ax, width=4.5, height=4.6)
    view = image_view(design, place) if view is None else view
    um = 1e3
    if view.coverage.size:
        # Half grey for a full pixel leaves lines on it visible; a grid of very many would itself be grey.
        lines: dict[str, Any] = {"edgecolors": "#cfcfcf", "linewidth": 0.3}
        grid = lines if view.coverage.shape[1] <= GRID_UP_TO else {}
        ax.pcolormesh(um * view.x, um * view.y, view.coverage, cmap="gray_r", vmin=0, vmax=2.2, **grid)
    if len(view.outline):
        ring = um * np.concatenate([view.outline, view.outline[:1]])
        ax.plot(ring[:, 0], ring[:, 1], color=INK, linewidth=1.5, label="outline of the image")
    turn = np.linspace(0, 2 * np.pi, 361)
    for k, (rim, centre, radius) in enumerate(zip(rims(design), view.centres, view.radii, strict=True)):
        colour = (FAP_COLOUR, LENS_COLOUR, *STOP_COLOURS)[min(k, 2) if k < 2 else 2 + (k - 2) % len(STOP_COLOURS)]
        ax.plot(
            um * (centre[0] + radius * np.cos(turn)), um * (centre[1] + radius * np.sin(turn)),
            color=colour, linewidth=1.0, linestyle=(0, (5, 3)), label=f"disc of the {rim.name}",
        )  # fmt: skip
    box = um * np.concatenate([view.cell, view.cell[:1]])
    ax.plot(box[:, 0], box[:, 1], color=GREEN, linewidth=1.2, label="own cell")
    middle = um * view.centres[0]
    ax.plot(*middle, "+", color=VERMILLION, markersize=8, markeredgewidth=1.4, label="chief ray", linestyle="none")
    ax.set_aspect("equal")
    half = um * view.half
    _hatch_beyond_sensor(ax, view, middle, half)
    ax.set(
        xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half),
        xlabel="x from the microlens axis [µm]", ylabel="y from the microlens axis [µm]",
    )  # fmt: skip
    ax.spines[:].set_color(GREY)
    title = "dark" if view.kept_fraction == 0 else f"{100 * view.kept_fraction:.4g} % kept"
    # Rounding of a sum over pixels is not an edge.
    # A sliver beyond the sensor's edge (less than half a percent) is hatched but not worth a number.
    whole = view.on_sensor > 0.995
    ax.set_title(title if whole else f"{title},\n{100 * view.on_sensor:.3g} % on the sensor")
    if alone:
        ax.figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return ax


def _hatch_beyond_sensor(ax: Axes, view: ImageView, middle: Floats, half: float) -> None:
    """Mark where there are no pixels."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    frame = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * 1.05 * half + middle
    vertices, codes = [*frame], [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY]
    if len(view.x) > 1 and len(view.y) > 1:
        (left, right), (low, high) = ((1e3 * edges[0], 1e3 * edges[-1]) for edges in (view.x, view.y))
        if left <= frame[0, 0] and right >= frame[1, 0] and low <= frame[0, 1] and high >= frame[2, 1]:
            return
        # The other way round: what both paths enclose stays free.
        vertices += [(left, low), (left, high), (right, high), (right, low), (left, low)]
        codes = codes * 2
    ax.add_patch(
        PathPatch(Path(vertices, codes), facecolor="none", edgecolor=GREY, linewidth=0.6, hatch="////",
                  alpha=0.5, label="beyond the sensor")
    )  # fmt: skip
