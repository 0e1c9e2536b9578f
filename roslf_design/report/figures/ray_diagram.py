"""Meridional ray diagram, to scale: from the object plane through bore, lens and microlens array to the sensor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera import Camera
from ...evaluation import default_fields
from ...rays import PASSED, fans
from .style import BLOCKED, FIELD_COLOURS, GREY, INK, LENS_COLOUR, SKY, STOP_COLOURS, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

Floats = NDArray[np.float64]

FILL = 1.5
"""Width of a fan in FAP diameters: its outer rays meet the FAP's plate."""
RAYS = 13
"""Rays of a fan; with `FILL` above, every fourth of a radius."""


class LabelledFan(NamedTuple):
    """Rays of one field."""

    label: str
    kept: NDArray[np.bool_]
    """Shape (N,)."""
    z: Floats
    """Corners of each ray [mm], light's way, shape (N, 4); a blocked ray repeats the point where it ends."""
    x: Floats
    """Heights there [mm]."""


def labelled_fans(design: Design) -> list[LabelledFan]:
    """Fans of centre, edge and corner; of both edges where decentres make the sides differ."""
    (x, _), (edge, _), corner = default_fields(design)
    if is_centred(design):
        places = {"centre": 0.0, "edge": edge, "corner": math.hypot(*corner)}
    else:
        places = {"centre": x, "edge +x": edge, "edge -x": 2 * x - edge}
    found = fans(Camera.of(design), list(places.values()), rays=RAYS, fill=FILL)
    kept = np.isin(found.status, PASSED)
    return [LabelledFan(label, kept[i], found.z[i], found.x[i]) for i, label in enumerate(places)]


def is_centred(design: Design) -> bool:
    """Whether all elements are round about one axis, so that every meridional plane is like every other."""
    offsets = [design.main_lens.decentre, design.microlens_array.decentre, design.sensor.decentre]
    offsets += [stop.decentre for stop in design.all_stops]
    return design.aligned and all(offset == (0.0, 0.0) for offset in offsets)


def plot_ray_diagram(design: Design, ax: Axes | None = None, *, instrument_only: bool = False) -> Axes:
    """Draw the meridional section of a design to scale, with ray fans.

    Parameters
    ----------
    design : Design
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    instrument_only : bool
        From the outermost stop to the sensor only, leaving out the way to the object plane.

    Returns
    -------
    Axes
        Equal scale along both axes [mm].

    Notes
    -----
    Each field lies in its own meridional plane, turned into the page; with decentres, the plane is x-z.
    """
    drawn = labelled_fans(design)
    frame = frame_of(design, instrument_only, drawn)
    ax = new_axes(ax, height=0.7 + frame.height_at(7.2))
    for ray_fan, colour in zip(drawn, FIELD_COLOURS, strict=True):
        _draw_fan(ax, ray_fan, colour)
    ax.plot([], [], color=BLOCKED, linewidth=0.7, linestyle=(0, (4, 2)), marker="x", markersize=4, label="blocked")
    _draw_elements(ax, design, frame.half)
    if not instrument_only:
        seen = max(float(np.max(np.abs(f.x[:, 0]))) for f in drawn)
        ax.plot([-design.d_f] * 2, [-seen, seen], color=INK, linewidth=1.6, solid_capstyle="butt")
    draw_names(ax, element_names(design, instrument_only), frame)
    draw_distances(ax, design, frame, instrument_only)
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlim=(frame.left, frame.right), ylim=(frame.bottom, frame.top), xlabel="z [mm]", ylabel="height [mm]")
    ax.set_yticks([tick for tick in ax.get_yticks() if abs(tick) <= frame.half])
    ax.spines["left"].set_bounds(-frame.half, frame.half)
    return ax


class Frame(NamedTuple):
    """What part of the section is drawn [mm]."""

    left: float
    right: float
    half: float
    """Rays and elements reach this high."""
    line: float
    """Height of a line of text, where the drawing is 7.2 inch wide or `tallest` high."""
    names: int
    """Lines of names above."""
    distances: int
    """Lines of distances below."""

    @property
    def top(self) -> float:
        """With room for the names."""
        return self.half + (0.5 + self.names) * self.line

    @property
    def bottom(self) -> float:
        """With room for the distances."""
        return -self.half - (0.7 + 1.3 * self.distances) * self.line

    def height_at(self, width: float) -> float:
        """Height of the drawing of that width, in the width's unit."""
        return width * (self.top - self.bottom) / (self.right - self.left)


TALLEST = 3.6
"""Of one drawing [inch]; a taller one gets narrower instead."""


def frame_of(design: Design, instrument_only: bool, drawn: list[LabelledFan] | None = None) -> Frame:
    """What to draw."""
    drawn = labelled_fans(design) if drawn is None else drawn
    end = design.d_1 + design.d_2
    front = max(stop.distance for stop in design.all_stops)
    length = end + (front if instrument_only else design.d_f)
    left = -front - 0.14 * length if instrument_only else -design.d_f - 0.05 * length
    right = end + 0.07 * length
    solid = [design.D / 2 + math.hypot(*design.main_lens.decentre), math.hypot(*design.sensor_size) / 2]
    solid += [stop.diameter / 2 + math.hypot(*stop.decentre) for stop in design.all_stops]
    rays = max(float(np.max(np.abs(f.x[f.z >= left]))) for f in drawn)
    half = 1.08 * max(*solid, rays)
    # Text is as high as a share of whichever side limits the scale.
    line = max((right - left) / 7.2, 2 * half / (TALLEST - 0.8)) * 0.16
    rows = name_rows(element_names(design, instrument_only), line)
    return Frame(left, right, half, line, 1 + max(rows), 1 if instrument_only else 2)


def instrument_is_small(design: Design) -> bool:
    """Whether the instrument needs a drawing of its own beside that of the whole."""
    end, front = design.d_1 + design.d_2, max(stop.distance for stop in design.all_stops)
    return (end + front) < 0.75 * (end + design.d_f)


def _draw_fan(ax: Axes, rays: LabelledFan, colour: str) -> None:
    shown = False
    for z, x, kept in zip(rays.z, rays.x, rays.kept, strict=True):
        if kept:
            ax.plot(z, x, color=colour, linewidth=0.8, label=None if shown else rays.label)
            shown = True
        else:
            ax.plot(z, x, color=BLOCKED, linewidth=0.7, linestyle=(0, (4, 2)))
            ax.plot(z[-1], x[-1], "x", color=BLOCKED, markersize=4, markeredgewidth=1.1, zorder=4)
    if not shown:
        ax.plot([], [], color=colour, linewidth=0.8, label=f"{rays.label} (dark)")


def element_names(design: Design, instrument_only: bool) -> list[tuple[float, str]]:
    """Where every element stands [mm], and what to call it."""
    names = [(-stop.distance, f"stop {k}" if k else "FAP") for k, stop in enumerate(design.all_stops)]
    names += [(0.0, "main lens"), (design.d_1 + design.d_2, "MLA, sensor")]
    return sorted(names if instrument_only else [*names, (-design.d_f, "object plane")])


def name_rows(names: list[tuple[float, str]], line: float) -> list[int]:
    """Row of each name, from 0, such that no two touch; in the order of `names`, which is sorted."""
    reached: list[float] = []
    rows = []
    for z, text in names:
        width = 0.6 * line * len(text)
        row = next((r for r, end in enumerate(reached) if z - width / 2 > end), len(reached))
        reached[row : row + 1] = [z + width / 2]
        rows.append(row)
    return rows


def _draw_elements(ax: Axes, design: Design, plate: float) -> None:
    for index, stop in enumerate(design.all_stops):
        colour = INK if index == 0 else STOP_COLOURS[(index - 1) % len(STOP_COLOURS)]
        for sign in (-1, 1):
            edge = stop.decentre[0] + sign * stop.diameter / 2
            ax.plot([-stop.distance] * 2, [edge, sign * plate], color=colour, linewidth=2.6, solid_capstyle="butt")
    _draw_lens(ax, design, plate)
    mla, sensor = design.microlens_array, design.sensor
    sizes = (mla.size, design.sensor_size)
    heights = [math.hypot(*size) if is_centred(design) else size[0] for size in sizes]
    for z, middle, height, colour in (
        (design.d_1, mla.decentre[0], heights[0], SKY),
        (design.d_1 + design.d_2, sensor.decentre[0], heights[1], INK),
    ):
        ax.plot([z, z], [middle - height / 2, middle + height / 2], color=colour, linewidth=2.0, solid_capstyle="butt")


def _draw_lens(ax: Axes, design: Design, plate: float) -> None:
    middle, radius = design.main_lens.decentre[0], design.D / 2
    t = np.linspace(-1, 1, 41)
    bulge = 0.09 * radius * (1 - t**2)
    z, x = np.concatenate([-bulge, bulge[::-1]]), middle + radius * np.concatenate([t, t[::-1]])
    ax.fill(z, x, facecolor=LENS_COLOUR, alpha=0.22, edgecolor=LENS_COLOUR, linewidth=0.8)
    for sign in (-1, 1):
        if plate > radius + sign * middle:
            rim = [middle + sign * radius, sign * plate]
            ax.plot([0, 0], rim, color=LENS_COLOUR, linewidth=2.6, solid_capstyle="butt")


def draw_names(ax: Axes, names: list[tuple[float, str]], frame: Frame) -> None:
    """Write names above the drawing, on further lines where they would touch."""
    for (z, text), row in zip(names, name_rows(names, frame.line), strict=True):
        height = frame.half + (0.25 + row) * frame.line
        ax.text(z, height, text, ha="center", va="bottom", fontsize=7.5)
        if row:
            ax.plot([z, z], [frame.half, height], color=GREY, linewidth=0.5)


def draw_distances(ax: Axes, design: Design, frame: Frame, instrument_only: bool) -> None:
    """Dimension the drawing: d_3 and d_1, and d_f below them."""
    rows = [("d_3", -design.d_3, 0.0, 0.9), ("d_1", 0.0, design.d_1, 0.9)]
    if not instrument_only:
        rows.append(("d_f", -design.d_f, 0.0, 2.2))
    for symbol, start, end, row in rows:
        if end == start:
            continue
        level = -frame.half - row * frame.line
        ax.plot([start, end], [level, level], color=GREY, linewidth=0.7)
        ax.plot([start, end], [level, level], linestyle="none", marker="|", markersize=6, color=GREY)
        text = f"{symbol} = {end - start:.4g} mm"
        inside = end - start > 0.62 * frame.line * len(text)
        place = (start + end) / 2 if inside else (start if end <= 0 else end)
        ax.annotate(
            text, (place, level), xytext=(0 if inside else (-4 if end <= 0 else 4), 0), textcoords="offset points",
            ha="center" if inside else ("right" if end <= 0 else "left"), va="center", fontsize=7.5,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0} if inside else None, annotation_clip=False,
        )  # fmt: skip
