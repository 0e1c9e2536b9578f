"""Map of the microlens array: which microlens images are whole, cut or dark, and which microlens is looked at."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...evaluation import default_fields
from ...evaluation.rims import field_limit
from ...report.figures.field_maps import FieldMap, field_map, on_mla
from .axes import Picture, Plot, Scale, frame, legend, moved
from .raster import image
from .svg import SMALL, clipped, document, line, path, short, tag, text
from .theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ...design import Design

POINTS = 120
"""Places along the array's longer side."""
LEFT, TOP, RIGHT, BELOW = 52.0, 26.0, 12.0, 42.0
"""Margins [px]."""


def mla_map(
    design: Design, selected: tuple[float, float] | None = None, theme: ThemeName = "light",
    size: tuple[float, float] = (460, 400),
) -> Picture:  # fmt: skip
    """Draw what becomes of the microlens images over the array.

    Parameters
    ----------
    design : Design
        A real lens is taken as its thin twin.
    selected : (x, y), optional
        A place on the MLA to mark [mm].
    theme : {"light", "dark"}
    size : (width, height)
        [px].

    Returns
    -------
    Picture
        Its mapping takes pixels to places on the MLA [mm].
    """
    colours, seen = theme_named(theme), design.thin_twin
    fields = field_map(seen, POINTS)
    key, tall = legend(_entries(seen, colours), colours, size[0] - 24)
    plot = _plot(seen, (size[0], size[1] - tall))
    inside = _shades(fields, plot, colours) + _frames(seen, plot, colours) + _places(seen, plot, colours)
    if selected is not None:
        inside += _mark(selected, plot, colours)
    told = shares(seen, fields)
    body = [
        text((14, 16), f"on the sensor: {told}", colours.ink, SMALL, data_testid="mla-shares"),
        clipped("mla-map-window", plot.box, inside),
        frame(plot, colours, "x on the MLA [mm]", "y on the MLA [mm]", grid=False),
        moved(key, 14, size[1] - tall - 2),
    ]
    title = f"Map of the microlens array of {design.name}: {told} of the images on the sensor"
    return Picture(document("mla-map", title, size, colours, body), plot.mapping)


def shares(design: Design, fields: FieldMap) -> str:
    """How many of the microlens images on the sensor are whole, cut and dark, in words."""
    x, y = on_mla(design, design.sensor.decentre)
    half_x, half_y = (0.5 * side for side in design.sensor_size)
    within = (np.abs(fields.y[:, None] - y) <= half_y) & (np.abs(fields.x - x) <= half_x)
    kept = fields.kept[within]
    if not kept.size:
        return "none there"
    parts = {"whole": kept == 1, "cut": (kept > 0) & (kept < 1), "dark": kept == 0}
    told = [f"{_percent(float(part.mean()))} {name}" for name, part in parts.items() if part.any()]
    return ", ".join(told)


def _percent(share: float) -> str:
    return "all" if share == 1 else f"{min(max(100 * share, 0.1), 99.9):.1f} %"


def _plot(design: Design, size: tuple[float, float]) -> Plot:
    """The array and, where it is not much larger, the circle of Eq. 6; both axes on one scale."""
    half_x, half_y = (side / 2 for side in design.microlens_array.size)
    radius = field_limit(design, 0.0).radius * design.d_1 / design.d_f
    if 0 < radius <= 1.2 * math.hypot(half_x, half_y):
        x, y = on_mla(design, design.main_lens.decentre)
        half_x, half_y = max(half_x, radius + abs(x)), max(half_y, radius + abs(y))
    half_x, half_y = 1.05 * half_x, 1.05 * half_y
    room = max(size[0] - LEFT - RIGHT, 60.0), max(size[1] - TOP - BELOW, 60.0)
    scale = min(room[0] / (2 * half_x), room[1] / (2 * half_y))
    # The rest of the room shows more of the plane rather than nothing.
    half_x, half_y = min(room[0] / scale / 2, 1.6 * half_x), min(room[1] / scale / 2, 1.6 * half_y)
    width, height = 2 * half_x * scale, 2 * half_y * scale
    left = LEFT + (room[0] - width) / 2
    return Plot(left, TOP + (room[1] - height) / 2, width, height, Scale(-half_x, half_x), Scale(-half_y, half_y))


def _shades(fields: FieldMap, plot: Plot, theme: Theme) -> str:
    dx, dy = (float(axis[1] - axis[0]) / 2 for axis in (fields.x, fields.y))
    left, low = plot.at(fields.x[0] - dx, fields.y[0] - dy)
    right, top = plot.at(fields.x[-1] + dx, fields.y[-1] + dy)
    return image(_colours(fields.kept, theme), (left, top, right - left, low - top))


def _colours(kept: NDArray[np.float64], theme: Theme) -> NDArray[np.uint8]:
    """Whole images pale, cut ones the darker the more is lost, dark ones as black as the theme has it."""
    whole, cut_little, cut_much, dark = (np.array(_rgb(colour), float) for colour in _key(theme))
    share = np.asarray(kept)[..., None]
    mixed = cut_much + (cut_little - cut_much) * share
    colours = np.where(share == 1, whole, np.where(share == 0, dark, mixed))
    opaque = np.full((*np.shape(kept), 1), 255.0)
    return np.concatenate([colours, opaque], -1).round().astype(np.uint8)


def _key(theme: Theme) -> tuple[str, str, str, str]:
    if theme.ground == "#ffffff":
        return "#e4f2ec", "#fbe3b0", "#9a5200", "#15181b"
    return "#1e4a3c", "#8a6a1f", "#ffb74d", "#000000"


def _rgb(colour: str) -> list[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


def _frames(design: Design, plot: Plot, theme: Theme) -> str:
    width, height = design.microlens_array.size
    (left, top), (right, low) = plot.at(-width / 2, height / 2), plot.at(width / 2, -height / 2)
    parts = [tag("rect", x=left, y=top, width=right - left, height=low - top, fill="none", stroke=theme.grey)]
    centre, (width, height) = on_mla(design, design.sensor.decentre), design.sensor_size
    turn = design.microlens_array.rotation
    c, s = math.cos(turn), math.sin(turn)
    corners = [
        plot.at(centre[0] + c * x + s * y, centre[1] - s * x + c * y)
        for x, y in (
            (-width / 2, -height / 2),
            (width / 2, -height / 2),
            (width / 2, height / 2),
            (-width / 2, height / 2),
        )
    ]
    outline = "M" + "L".join(f"{x:.2f},{y:.2f}" for x, y in corners) + "Z"
    parts.append(path(outline, theme.blue, 2, data_testid="mla-sensor"))
    radius = field_limit(design, 0.0).radius * design.d_1 / design.d_f
    if 0 < radius < math.inf:
        x, y = plot.at(*on_mla(design, design.main_lens.decentre))
        r = radius / (plot.x.high - plot.x.low) * plot.width
        if r < 1e4:
            parts.append(
                tag(
                    "circle",
                    cx=x,
                    cy=y,
                    r=r,
                    fill="none",
                    stroke=theme.vermillion,
                    stroke_width=2,
                    data_testid="eq6-circle",
                )
            )
    return "".join(parts)


def _places(design: Design, plot: Plot, theme: Theme) -> str:
    """Centre, edge and corner, where the other pictures look."""
    parts = []
    for place, hue in zip(default_fields(design), theme.fields, strict=True):
        x, y = plot.at(*place)
        parts.append(tag("circle", cx=x, cy=y, r=4.5, fill=hue, stroke=theme.ground, stroke_width=1.5))
    return "".join(parts)


def _mark(selected: tuple[float, float], plot: Plot, theme: Theme) -> str:
    x, y = plot.at(*selected)
    cross = f"M{x - 14:.1f},{y:.1f}h9M{x + 5:.1f},{y:.1f}h9M{x:.1f},{y - 14:.1f}v9M{x:.1f},{y + 5:.1f}v9"
    ring = tag("circle", cx=x, cy=y, r=6, fill="none", stroke=theme.ink, stroke_width=2)
    halo = tag("circle", cx=x, cy=y, r=6, fill="none", stroke=theme.ground, stroke_width=5)
    return tag("g", halo + path(cross, theme.ground, 5) + ring + path(cross, theme.ink, 2), data_testid="mla-selected")


def _entries(design: Design, theme: Theme) -> list[tuple[str, str]]:
    whole, _, much, dark = _key(theme)

    def box(fill: str, stroke: str) -> str:
        return tag("rect", x=-8, y=-5, width=16, height=10, fill=fill, stroke=stroke)

    radius = field_limit(design, 0.0).radius * design.d_1 / design.d_f
    bound = "at any radius" if math.isinf(radius) else "nowhere" if radius == 0 else f"within {short(radius)} mm"
    dots = "".join(tag("circle", cx=x, r=3.6, fill=hue) for x, hue in zip((-7, 0, 7), theme.fields, strict=True))
    return [
        (box(whole, theme.grey), "whole"),
        (box(much, theme.grey), "cut"),
        (box(dark, theme.grey), "dark"),
        (line((-11, 0), (11, 0), theme.blue, 2), "sensor"),
        (line((-11, 0), (11, 0), theme.vermillion, 2), f"Eq. 6: whole {bound}"),
        (dots, "centre, edge, corner"),
    ]
