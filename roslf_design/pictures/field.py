"""Maps over the microlens array: how much of each microlens image is kept, and how far it sits off its microlens."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..camera import Camera
from ..evaluation import default_fields
from ..evaluation.fields import axes_in_space, field_discs
from ..shapes.discs import intersect
from ..theory.vignetting import field_limit
from .lettering import short
from .marks import Area, Disc, Dots, Floats, Image, Key, Line, Mark, Point, Text, box_key, line_key, xy
from .panel import Panel, Scale
from .picture import PAGE, Picture, beside, colour_bar, legend_height
from .theme import FIELDS

if TYPE_CHECKING:
    from ..design import Design

POINTS = 120
"""Places along the array's longer side."""
LEFT, TOP, RIGHT, BELOW = 52.0, 26.0, 12.0, 42.0
"""Margins [px]."""


class ArrayMap(NamedTuple):
    """Microlens images on a grid of places over the MLA, rows along y."""

    x: Floats
    """Places on the MLA [mm], shape (N,)."""
    y: Floats
    """Shape (M,)."""
    kept: Floats
    """Kept fraction, shape (M, N)."""
    offset_px: Floats
    """Centroid relative to the microlens's axis [px], shape (M, N, 2); NaN where dark."""

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper end of what the places stand for [mm]."""
        dx, dy = (float(axis[1] - axis[0]) / 2 for axis in (self.x, self.y))
        return float(self.x[0]) - dx, float(self.x[-1]) + dx, float(self.y[0]) - dy, float(self.y[-1]) + dy


def field_map(design: Design, points: int = 160) -> ArrayMap:
    """Shapes of the images of microlenses on a grid, `points` along the MLA's longer side.

    Images change so slowly over the array that the grid need not be that of the microlenses.
    """
    width, height = design.microlens_array.size
    step = max(width, height) / points
    counts = (max(2, round(side / step)) for side in (width, height))
    x, y = (step * (np.arange(count) - (count - 1) / 2) for count in counts)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    images = intersect(*field_discs(design, places))
    shape = len(y), len(x)
    offset = np.where(images.lit[:, None], images.centroid / design.q, np.nan)
    return ArrayMap(
        np.asarray(x, float), np.asarray(y, float), images.kept_fraction.reshape(shape), offset.reshape(*shape, 2)
    )


def mla_map(design: Design, selected: Point | None = None, size: Point = (460, 400)) -> Picture:
    """Draw which microlens images are whole, cut or dark, and which microlens is looked at, `selected` on the MLA [mm].

    A real lens is taken as its thin twin. The picture's mapping takes pixels to places on the MLA [mm].
    """
    thin = design.thin_twin
    fields = field_map(thin, POINTS)
    dots = tuple(
        Dots((float(x),), (0.0,), colour, size=3.6) for x, colour in zip((-7, 0, 7), FIELDS, strict=True)
    )  # fmt: skip
    keys = [
        box_key("whole", "whole", 1.0, "grey"), box_key("cut", "lost", 1.0, "grey"),
        box_key("dark", "dark", 1.0, "grey"), *_frame_keys(thin), Key("centre, edge, corner", dots),
    ]  # fmt: skip
    tall = legend_height(keys, size[0] - 24)
    panel = _panel(thin, (size[0], size[1] - tall), (LEFT, TOP, RIGHT, BELOW))
    marks = [Image(fields.kept, fields.box, "kept"), *_frames(thin)]
    for (x, y), colour in zip(default_fields(thin), FIELDS, strict=True):
        marks.append(Dots([x], [y], colour, size=4.5, edge="ground", width=1.5, clip=True))
    if selected is not None:
        marks += _cross(selected, panel)
    words = shares(thin, fields)
    remark = Text(14, 16, f"on the sensor: {words}", testid="mla-shares")
    title = f"Map of the microlens array of {design.name}: {words} of the images on the sensor"
    panel = panel.with_marks(*marks)
    return Picture("mla-map", title, size, (panel,), tuple(keys), (14.0, size[1] - tall - 2, size[0] - 24), (remark,))


def field_maps(design: Design, fields: ArrayMap | None = None, width: float = PAGE) -> Picture:
    """Draw kept fraction and centroid's offset over the MLA; `fields` where they are known already."""
    fields = field_map(design) if fields is None else fields
    kept, offset = kept_map(design, fields, (width / 2, 300)), offset_map(design, fields, (width / 2, 300))
    lowest = float(fields.kept.min())
    title = f"Kept fraction and offset of the microlens images of {design.name}: {lowest:.3g} kept at the least"
    return beside("maps", title, [kept, offset], _frame_keys(design))


def kept_map(design: Design, fields: ArrayMap, size: Point) -> Picture:
    """The kept fraction over the MLA, with the sensor and the circle of Eq. 6."""
    lowest = float(fields.kept.min())
    title = "kept fraction" + (": 1 everywhere" if lowest == 1.0 else f": down to {lowest:.3g}")
    shades = Image(fields.kept, fields.box, "kept")
    return _map("kept", design, title, [shades], ("kept", 0.0, 1.0, "kept fraction [1]"), size)


def offset_map(design: Design, fields: ArrayMap, size: Point) -> Picture:
    """How far each microlens image's centroid lies off its axis, and which way."""
    length = np.hypot(fields.offset_px[..., 0], fields.offset_px[..., 1])
    top = float(np.nanmax(length)) if np.isfinite(length).any() else 0.0
    marks: list[Mark] = [Image(length, fields.box, "cividis", 0.0, top or 1.0)]
    if top > 0:
        step = max(1, round(len(fields.x) / 9))
        rows, columns = (np.arange(step // 2, len(axis), step) for axis in (fields.y, fields.x))
        reach = 0.9 * step * float(fields.x[1] - fields.x[0]) / top
        for row in rows:
            for column in columns:
                dx, dy = 0.5 * reach * fields.offset_px[row, column]
                x, y = fields.x[column], fields.y[row]
                if math.isfinite(dx):
                    marks.append(Line([x - dx, x + dx], [y - dy, y + dy], "#000000", 2.6, opacity=0.6))
                    marks.append(Line([x - dx, x + dx], [y - dy, y + dy], "#ffffff", 1.3, ends=">"))
    title = f"image centroid: up to {top:.3g} px off axis"
    bar = "cividis", 0.0, top or 1.0, "offset from the microlens axis [px]"
    return _map("offset", design, title, marks, bar, size)


def _map(
    name: str, design: Design, title: str, marks: list[Mark], bar: tuple[str, float, float, str], size: Point
) -> Picture:
    panel = _panel(design, size, (LEFT, 28.0, 74.0, BELOW)).with_marks(*marks, *_frames(design))
    panel = replace(panel, title=title)
    ramp, low, high, label = bar
    return Picture(name, title, size, (panel, colour_bar(panel, low, high, ramp, label)))


def shares(design: Design, fields: ArrayMap) -> str:
    """How many of the microlens images on the sensor are whole, cut and dark, in words."""
    x, y = on_mla(design, design.sensor.decentre)
    half_x, half_y = (0.5 * side for side in design.sensor_size)
    within = (np.abs(fields.y[:, None] - y) <= half_y) & (np.abs(fields.x - x) <= half_x)
    kept = fields.kept[within]
    if not kept.size:
        return "none there"
    parts = {"whole": kept == 1, "cut": (kept > 0) & (kept < 1), "dark": kept == 0}
    return ", ".join(f"{_percent(float(part.mean()))} {name}" for name, part in parts.items() if part.any())


def _percent(share: float) -> str:
    return "all" if share == 1 else f"{min(max(100 * share, 0.1), 99.9):.1f} %"


def circle_of_eq_6(design: Design) -> tuple[Point, float]:
    """Its centre and radius on the MLA [mm]; the radius is 0 or infinite where there is none."""
    return on_mla(design, design.main_lens.decentre), field_limit(Camera.of(design)).radius * design.d_1 / design.d_f


def on_mla(design: Design, point: Point) -> Point:
    """A point against the optical axis in the MLA's own axes [mm]."""
    (home, along, up) = axes_in_space(design, [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    offset = np.subtract(point, home)
    return float(offset @ (along - home)), float(offset @ (up - home))


def _panel(design: Design, size: Point, margins: tuple[float, float, float, float]) -> Panel:
    """The array and, where it is not much larger, the circle of Eq. 6; both axes on one scale."""
    left, top, right, below = margins
    half_x, half_y = (side / 2 for side in design.microlens_array.size)
    (x, y), radius = circle_of_eq_6(design)
    if 0 < radius <= 1.2 * math.hypot(half_x, half_y):
        half_x, half_y = max(half_x, radius + abs(x)), max(half_y, radius + abs(y))
    half_x, half_y = 1.05 * half_x, 1.05 * half_y
    room = max(size[0] - left - right, 60.0), max(size[1] - top - below, 60.0)
    scale = min(room[0] / (2 * half_x), room[1] / (2 * half_y))
    # The rest of the room shows more of the plane rather than nothing.
    half_x, half_y = min(room[0] / scale / 2, 1.6 * half_x), min(room[1] / scale / 2, 1.6 * half_y)
    width, height = 2 * half_x * scale, 2 * half_y * scale
    box = (left + (room[0] - width) / 2, top + (room[1] - height) / 2, width, height)
    return Panel(
        box, Scale(-half_x, half_x), Scale(-half_y, half_y), (), "x on the MLA [mm]", "y on the MLA [mm]", grid="",
        equal=True,
    )  # fmt: skip


def _frames(design: Design) -> list[Mark]:
    width, height = design.microlens_array.size
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    marks: list[Mark] = [Area(*xy(corners * (width, height)), "none", 1.0, "grey", 1.0)]
    turn = design.microlens_array.rotation
    c, s = math.cos(turn), math.sin(turn)
    sensor = corners * design.sensor_size @ np.array([[c, -s], [s, c]]) + on_mla(design, design.sensor.decentre)
    marks.append(Area(*xy(sensor), "none", 1.0, "ground", 4.0))
    marks.append(Area(*xy(sensor), "none", 1.0, "blue", 2.0, testid="mla-sensor"))
    (x, y), radius = circle_of_eq_6(design)
    if 0 < radius < math.inf:
        marks.append(Disc(x, y, radius, edge="ground", width=4.0))
        marks.append(Disc(x, y, radius, edge="vermillion", width=2.0, testid="eq6-circle"))
    return marks


def _cross(selected: Point, panel: Panel) -> list[Mark]:
    """A ring and cross hairs with a hole, haloed."""
    (x, y), (dx, dy) = selected, panel.per_px
    arms = np.array([(-14, 0), (-5, 0), (np.nan, 0), (5, 0), (14, 0), (np.nan, 0), (0, -14), (0, -5), (np.nan, 0),
                     (0, 5), (0, 14)])  # fmt: skip
    marks: list[Mark] = []
    for colour, width, testid in (("ground", 5.0, ""), ("ink", 2.0, "mla-selected")):
        marks.append(Disc(x, y, 6 * dx, edge=colour, width=width))
        marks.append(Line(x + arms[:, 0] * dx, y + arms[:, 1] * dy, colour, width, testid=testid))
    return marks


def _frame_keys(design: Design) -> list[Key]:
    _, radius = circle_of_eq_6(design)
    bound = "at any radius" if math.isinf(radius) else "nowhere" if radius == 0 else f"within {short(radius)} mm"
    return [line_key("sensor", "blue", 2), line_key(f"Eq. 6: undistorted {bound}", "vermillion", 2)]
