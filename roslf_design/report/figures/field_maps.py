"""Maps over the microlens array: how much of each microlens image is kept, and how far it sits off its microlens."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...evaluation.fields import field_discs
from ...evaluation.rims import axes_in_space, field_limit
from ...microlens.discs import intersect
from .style import BLUE, GREY, INK, VERMILLION, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from ...design import Design

Floats = NDArray[np.float64]


class FieldMap(NamedTuple):
    """Microlens images on a grid of places over the MLA, rows along y."""

    x: Floats
    """Places on the MLA [mm], shape (N,)."""
    y: Floats
    """Shape (M,)."""
    kept: Floats
    """Kept fraction, shape (M, N)."""
    offset_px: Floats
    """Centroid relative to the microlens's axis [px], shape (M, N, 2); NaN where dark."""


def field_map(design: Design, points: int = 160) -> FieldMap:
    """Shapes of the images of microlenses on a grid, `points` along the MLA's longer side.

    Images change so slowly over the array that the grid need not be that of the microlenses.
    """
    width, height = design.microlens_array.size
    step = max(width, height) / points
    x, y = (_middles(side, step) for side in (width, height))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    found = intersect(*field_discs(design, places))
    shape = len(y), len(x)
    offset = np.where(found.lit[:, None], found.centroid / design.q, np.nan)
    return FieldMap(x, y, found.kept_fraction.reshape(shape), offset.reshape(*shape, 2))


def _middles(side: float, step: float) -> Floats:
    count = max(2, round(side / step))
    return np.asarray(step * (np.arange(count) - (count - 1) / 2), float)


def plot_kept_fraction(design: Design, ax: Axes | None = None, fields: FieldMap | None = None) -> Axes:
    """Draw the kept fraction over the MLA, with the sensor and the circle of Eq. 6.

    Parameters
    ----------
    design : Design
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    fields : FieldMap, optional
        As `field_map` gives it, where it is known already.

    Returns
    -------
    Axes
    """
    alone, ax = ax is None, new_axes(ax, width=5.0, height=3.9)
    fields = field_map(design) if fields is None else fields
    lowest = float(fields.kept.min())
    floor = min(0.9, math.floor(lowest * 10) / 10)
    image = _draw_map(ax, fields, fields.kept, "gray", floor, 1.0)
    ax.figure.colorbar(image, cax=ax.inset_axes((1.03, 0, 0.045, 1)), label="kept fraction [1]")
    _draw_frame(ax, design, fields)
    ax.set_title("kept fraction" + (": 1 everywhere" if lowest == 1.0 else f": down to {lowest:.3g}"))
    if alone:
        ax.legend(loc="upper left")
    return ax


def plot_image_offset(design: Design, ax: Axes | None = None, fields: FieldMap | None = None) -> Axes:
    """Draw how far each microlens image's centroid lies off its axis; parameters as `plot_kept_fraction`."""
    alone, ax = ax is None, new_axes(ax, width=5.0, height=3.9)
    fields = field_map(design) if fields is None else fields
    size = np.hypot(fields.offset_px[..., 0], fields.offset_px[..., 1])
    top = float(np.nanmax(size)) if np.isfinite(size).any() else 0.0
    image = _draw_map(ax, fields, size, "cividis", 0.0, top or 1.0)
    ax.figure.colorbar(image, cax=ax.inset_axes((1.03, 0, 0.045, 1)), label="offset from the microlens axis [px]")
    step = max(1, round(len(fields.x) / 9)), max(1, round(len(fields.x) / 9))
    rows, columns = np.arange(step[1] // 2, len(fields.y), step[1]), np.arange(step[0] // 2, len(fields.x), step[0])
    arrows = fields.offset_px[np.ix_(rows, columns)]
    if top > 0:
        ax.quiver(
            fields.x[columns], fields.y[rows], arrows[..., 0], arrows[..., 1], color="white", edgecolor=INK,
            linewidth=0.4, width=0.007, scale=9.5 * top, scale_units="width", pivot="mid", zorder=3,
        )  # fmt: skip
    _draw_frame(ax, design, fields)
    ax.set_title(f"image centroid: up to {top:.3g} px off axis")
    if alone:
        ax.legend(loc="upper left")
    return ax


def _draw_map(ax: Axes, fields: FieldMap, values: Floats, colours: str, low: float, high: float) -> AxesImage:
    dx, dy = ((axis[1] - axis[0]) / 2 for axis in (fields.x, fields.y))
    box = (fields.x[0] - dx, fields.x[-1] + dx, fields.y[0] - dy, fields.y[-1] + dy)
    return ax.imshow(
        values, extent=box, origin="lower", cmap=colours, vmin=low, vmax=high, interpolation="none", aspect="equal"
    )


def _draw_frame(ax: Axes, design: Design, fields: FieldMap) -> None:
    from matplotlib.patches import Circle, Rectangle
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=3.2, foreground="white")]
    width, height = design.microlens_array.size
    ax.add_patch(
        Rectangle((-width / 2, -height / 2), width, height, fill=False, edgecolor=GREY, linewidth=0.8, label="MLA")
    )
    width, height = design.sensor_size
    x, y = on_mla(design, design.sensor.decentre)
    turn = -math.degrees(design.microlens_array.rotation)
    ax.add_patch(
        Rectangle((x - width / 2, y - height / 2), width, height, angle=turn, rotation_point="center", fill=False,
                  edgecolor=BLUE, linewidth=1.4, label="sensor", path_effects=halo)
    )  # fmt: skip
    half_x, half_y = (size / 2 for size in design.microlens_array.size)
    reach = math.hypot(half_x, half_y)
    radius = field_limit(design, 0.0).radius * design.d_1 / design.d_f
    shown = 0 < radius <= 1.35 * reach
    if shown:
        centre = on_mla(design, design.main_lens.decentre)
        ax.add_patch(
            Circle(centre, radius, fill=False, edgecolor=VERMILLION, linewidth=1.6,
                   label=f"Eq. 6: undistorted within {radius:.4g} mm", path_effects=halo)
        )  # fmt: skip
        half_x, half_y = max(half_x, 1.02 * (radius + abs(centre[0]))), max(half_y, 1.02 * (radius + abs(centre[1])))
    else:
        far = "any radius" if math.isinf(radius) else f"{radius:.4g} mm, far outside this map"
        told = "Eq. 6: undistorted nowhere" if radius == 0 else f"Eq. 6: undistorted within {far}"
        ax.plot([], [], color=VERMILLION, linewidth=1.6, label=told)
    edge = 0.06 * max(half_x, half_y)
    ax.set(
        xlim=(-half_x - edge, half_x + edge), ylim=(-half_y - edge, half_y + edge),
        xlabel="x on the MLA [mm]", ylabel="y on the MLA [mm]",
    )  # fmt: skip
    ax.locator_params(nbins=6)
    ax.spines[:].set_visible(False)
    ax.tick_params(color=GREY)


def on_mla(design: Design, point: tuple[float, float]) -> tuple[float, float]:
    """A point against the optical axis in the MLA's own axes [mm]."""
    (home, along, up) = axes_in_space(design, [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    offset = np.subtract(point, home)
    return float(offset @ (along - home)), float(offset @ (up - home))
