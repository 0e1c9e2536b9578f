"""Over the field: maps of the microlens images of the whole array, and what a real main lens does along x."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._arrays import Array
from ...camera import Camera
from ...design import Design
from ...drawing.marks import (
    Area,
    Disc,
    Dots,
    Image,
    Key,
    Line,
    Mark,
    Point,
    Text,
    box_key,
    line_key,
    parted,
    where_above,
    xy,
)
from ...drawing.panel import Panel, Scale, colour_bar
from ...drawing.picture import PAGE, Picture, as_tall, beside, legend_height, one_panel
from ...drawing.theme import FIELDS, PLAIN, SMALL, short, text_width
from ...evaluation import default_fields
from ...evaluation.fields import field_openings
from ...fates import ImageFate, RayFate
from ...theory.exit_pupil import pupil_angle
from ...theory.light import on_array, sensor_field
from ...theory.vignetting import field_limit, undistorted_towards
from ...traced.camera import camera_of, microlenses, views
from ...traced.images import measured_bound, real_field

LEFT, TOP, RIGHT, BELOW = 52.0, 26.0, 12.0, 42.0
"""Margins [px]."""
MOST_SHOWN = 1.68
"""Part of the plane that a map shows at most, in sizes of the array or of the circle of Eq. 6."""
OUTLINE = 720
"""Directions in which the line of Eq. 6 is drawn where openings have straight sides."""
TWINS = (line_key("thin-lens model", "grey", 1.4, "6 4"), line_key("real lens", "blue", 2))
"""Keys of the two outlines of a microlens image behind a real lens."""

_HALF = (-9.0, 0.0, 0.0, -9.0), (0.0, 9.0, 9.0, 0.0)
_TALL = (-5.0, -5.0, 5.0, 5.0)
KEPT_KEYS = (
    box_key("whole", "whole", 1.0, "grey"),
    Key("cut, a little to nearly all", (Area(_HALF[0], _TALL, "cut"), Area(_HALF[1], _TALL, "lost"))),
    box_key("dark", "dark", 1.0, "grey"),
)
"""Shades of a map of kept fractions."""


def _kept_keys(fields: _ArrayMap) -> tuple[Key, ...]:
    """Keys of the shades that a map of kept fractions has."""
    kept = fields.kept
    return tuple(
        key for key, own in zip(KEPT_KEYS, (kept == 1, (kept > 0) & (kept < 1), kept == 0), strict=True) if own.any()
    )


class _ArrayMap(NamedTuple):
    """Microlens images on a grid of places over the MLA, rows along y."""

    x: Array
    """Places on the MLA [mm], shape (N,)."""
    y: Array
    """Shape (M,)."""
    kept: Array
    """Kept fraction, shape (M, N)."""
    offset_px: Array
    """Centroid relative to the microlens's axis [px], shape (M, N, 2); NaN where dark."""

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper end of what the places stand for [mm]."""
        dx, dy = (float(axis[1] - axis[0]) / 2 for axis in (self.x, self.y))
        return float(self.x[0]) - dx, float(self.x[-1]) + dx, float(self.y[0]) - dy, float(self.y[-1]) + dy


def field_map(design: Design, points: int = 160) -> _ArrayMap:
    """Shapes of the images of microlenses on a grid, `points` along the MLA's longer side.

    Images change so slowly over the array that the grid need not be that of the microlenses.
    """
    width, height = design.microlens_array.size
    step = max(width, height) / points
    counts = (max(2, round(side / step)) for side in (width, height))
    x, y = (step * (np.arange(count) - (count - 1) / 2) for count in counts)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    images = field_openings(design, places).common()
    shape = len(y), len(x)
    offset = np.where(images.lit[:, None], images.centroid / design.q, np.nan)
    return _ArrayMap(
        np.asarray(x, float), np.asarray(y, float), images.kept_fraction.reshape(shape), offset.reshape(*shape, 2)
    )


def mla_map(
    design: Design, selected: Point | None = None, size: Point = (460, 400), *, traced_to: float | None = None
) -> Picture:
    """Draw which microlens images are whole, cut or dark, and which microlens is looked at, `selected` on the MLA [mm].

    A real lens is taken as its thin-lens model, and `traced_to` told: how far out images are whole through it [mm]. The
    picture's mapping takes pixels to places on the MLA [mm].
    """
    thin = design.thin_twin
    fields = field_map(thin)
    dots = tuple(Dots((x,), (0.0,), colour, size=3.6) for x, colour in zip((-7.0, 0.0, 7.0), FIELDS, strict=True))
    keys = [*_kept_keys(fields), *_frame_keys(thin), Key("centre, edge, corner", dots)]
    tall = legend_height(keys, size[0] - 24)
    panel = _panel(thin, (size[0], size[1] - tall), (LEFT, TOP, RIGHT, BELOW))
    marks = [Image(fields.kept, fields.box, "kept"), *_frames(thin)]
    for (x, y), colour in zip(default_fields(thin), FIELDS, strict=True):
        marks.append(Dots([x], [y], colour, size=4.5, edge="ground", width=1.5, clip=True))
    if selected is not None:
        marks += _cross(selected, panel)
    words = shares = _shares(thin, fields)
    told = [f"on the sensor: {words}", words]
    if traced_to is not None:
        traced = f"traced: whole to {traced_to:.4g} mm"
        words = f"{shares} by the thin lens, {traced}"
        told = [f"on the sensor: {words}", words, f"{shares}; {traced}", traced]
    shown = next((text for text in told if text_width(text, SMALL) < size[0] - 20), told[-1])
    remark = Text(14, 16, shown, testid="mla-shares")
    title = f"Map of the microlens array of {design.name}: {words} of the images on the sensor"
    panel = panel.with_marks(*marks)
    return Picture("mla-map", title, size, (panel,), tuple(keys), (14.0, size[1] - tall - 2, size[0] - 24), (remark,))


def field_maps(design: Design, fields: _ArrayMap) -> Picture:
    """Draw kept fraction and centroid's offset over the MLA, which `field_map` gives."""
    lowest = float(fields.kept.min())
    length = np.hypot(fields.offset_px[..., 0], fields.offset_px[..., 1])
    top = float(np.nanmax(length)) if np.isfinite(length).any() else 0.0
    arrows: list[Mark] = []
    if top > 0:
        step = max(1, round(len(fields.x) / 9))
        reach = 0.9 * step * float(fields.x[1] - fields.x[0]) / top
        part = np.s_[step // 2 :: step, step // 2 :: step]
        x, y = (axis[part] for axis in np.meshgrid(fields.x, fields.y))
        dx, dy = np.moveaxis(0.5 * reach * fields.offset_px[part], -1, 0)
        for a, b, u, v in np.stack([x, y, dx, dy], -1).reshape(-1, 4):
            if math.isfinite(u):
                arrows.append(Line([a - u, a + u], [b - v, b + v], "#000000", 2.6, opacity=0.6))
                arrows.append(Line([a - u, a + u], [b - v, b + v], "#ffffff", 1.3, ends=">"))
    shown: list[tuple[str, str, Array, float, str, str, list[Mark]]] = [
        ("offset", f"image centroid: up to {top:.3g} px off axis", length, top or 1.0, "cividis",
         "offset from the microlens axis [px]", arrows)
    ]  # fmt: skip
    if lowest < 1:
        words = f"on the sensor: {_shares(design, fields)}"
        shown.insert(0, ("kept", words, fields.kept, 1.0, "kept", "unvignetted fraction [1]", []))
    size, pictures = (PAGE / 2 if lowest < 1 else 0.8 * PAGE, 300.0), []
    for name, title, values, high, ramp, label, marks in shown:
        shades = Image(values, fields.box, ramp, 0.0, high)
        panel = _panel(design, size, (LEFT, 28.0, 74.0, BELOW)).with_marks(shades, *marks, *_frames(design))
        panel = replace(panel, title=title)
        pictures.append(Picture(name, title, size, (panel, colour_bar(panel, 0.0, high, ramp, label))))
    title = f"Unvignetted fraction and offset of the microlens images of {design.name}: {lowest:.3g} at the least"
    return beside("maps", title, pictures, [*(_kept_keys(fields) if lowest < 1 else ()), *_frame_keys(design)])


def _shares(design: Design, fields: _ArrayMap) -> str:
    """How many of the microlens images on the sensor are whole, cut and dark, in words."""
    at = Camera.of(design).chief_point(*np.meshgrid(fields.x, fields.y))
    x, y = (np.abs(place) <= side / 2 for place, side in zip(at, design.sensor_size, strict=True))
    kept = fields.kept[x & y]
    if not kept.size:
        return "none there"
    parts = {"whole": kept == 1, "cut": (kept > 0) & (kept < 1), "dark": kept == 0}
    return ", ".join(f"{_percent(float(part.mean()))} {name}" for name, part in parts.items() if part.any())


def _percent(share: float) -> str:
    return "all" if share == 1 else "under 1 %" if share < 0.01 else f"{min(100 * share, 99):.0f} %"


def _circle_of_eq_6(design: Design) -> tuple[float, float, float]:
    """Its centre and radius on the MLA [mm]; the radius is 0 or infinite where there is none."""
    camera = Camera.of(design)
    x, y = on_array(camera, np.zeros(2)).tolist()
    return x, y, field_limit(camera).mla_radius


def _panel(design: Design, size: Point, margins: tuple[float, float, float, float]) -> Panel:
    """The array and, where it is not much larger, the circle of Eq. 6; both axes on one scale."""
    left, top, right, below = margins
    half = np.array(design.microlens_array.size) / 2
    x, y, radius = _circle_of_eq_6(design)
    if 0 < radius <= 1.2 * np.hypot(*half):
        half = np.maximum(half, radius + np.abs([x, y]))
    room = np.maximum(np.subtract(size, (left + right, top + below)), 60.0)
    scale = float(np.min(room / (2.1 * half)))
    # The rest of the room shows more of the plane rather than nothing.
    half = np.minimum(room / scale / 2, MOST_SHOWN * half)
    width, height = (2 * half * scale).tolist()
    box = (left + float(room[0] - width) / 2, top + float(room[1] - height) / 2, width, height)
    across, up = (Scale(-side, side) for side in half.tolist())
    return Panel(box, across, up, (), "x on the MLA [mm]", "y on the MLA [mm]", grid="", equal=True)


def _frames(design: Design) -> list[Mark]:
    width, height = design.microlens_array.size
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    marks: list[Mark] = [Area(*xy(corners * (width, height)), "none", 1.0, "grey", 1.0)]
    camera = Camera.of(design)
    sensor = on_array(camera, sensor_field(camera).corners[[0, 1, 3, 2]])
    marks.append(Area(*xy(sensor), "none", 1.0, "ground", 4.0))
    marks.append(Area(*xy(sensor), "none", 1.0, "blue", 2.0, testid="mla-sensor"))
    x, y, radius = _circle_of_eq_6(design)
    if 0 < radius < math.inf and camera.has_straight_sides:
        turn = np.linspace(0.0, 2 * np.pi, OUTLINE, endpoint=False)
        ways = np.column_stack([np.cos(turn), np.sin(turn)])
        ends = np.minimum(undistorted_towards(camera, ways), 2 * MOST_SHOWN * math.hypot(width, height))
        edge = xy(on_array(camera, ends[:, np.newaxis] * ways))
        marks.append(Area(*edge, "none", 1.0, "ground", 4.0))
        marks.append(Area(*edge, "none", 1.0, "vermillion", 2.0, testid="eq6-outline"))
    elif 0 < radius < math.inf:
        marks.append(Disc(x, y, radius, edge="ground", width=4.0))
        marks.append(Disc(x, y, radius, edge="vermillion", width=2.0, testid="eq6-circle"))
    return marks


def _cross(selected: Point, panel: Panel) -> list[Mark]:
    """A ring and cross hairs with a hole, haloed."""
    (x, y), (dx, dy) = selected, panel.per_px
    arms = parted([[-14, -5], [5, 14], [0, 0], [0, 0]]), parted([[0, 0], [0, 0], [-14, -5], [5, 14]])
    marks: list[Mark] = []
    for colour, width, testid in (("ground", 5.0, ""), ("ink", 2.0, "mla-selected")):
        marks.append(Disc(x, y, 6 * dx, edge=colour, width=width))
        marks.append(Line(x + arms[0] * dx, y + arms[1] * dy, colour, width, testid=testid))
    return marks


def _frame_keys(design: Design) -> list[Key]:
    _, _, radius = _circle_of_eq_6(design)
    bound = "at any radius" if math.isinf(radius) else "nowhere" if radius == 0 else f"within {short(radius)} mm"
    if 0 < radius < math.inf and (camera := Camera.of(design)).has_straight_sides:
        whole = not field_limit(camera).cuts
        bound = "over all that the sensor sees" if whole else f"{bound} in the worst direction"
    limit = f"Eq. 6: undistorted {bound}"
    beyond = MOST_SHOWN * math.hypot(*design.microlens_array.size) / 2 < radius < math.inf
    circle = Key(f"{limit}, beyond the map" if beyond else limit, ())
    if 0 < radius < math.inf and not beyond:
        circle = line_key(limit, "vermillion", 2)
    return [line_key("what the sensor sees", "blue", 2), circle]


class _LensCurves(NamedTuple):
    """Along x from the axis to the distance of the sensor's corner; NaN where there is no light to tell it by."""

    x: Array
    """Microlens [mm], shape (N,)."""
    shift_px: Array
    """Image centre against the thin-lens model's, outwards positive."""
    diameter_px: Array
    """Diameter of the disc with the image's area; NaN where the image is folded."""
    thin_diameter_px: float
    axis_ratio: Array
    kept: Array
    """Part of the FAP that is seen."""
    folded: NDArray[np.bool_]
    tangential: Array
    """Blur on the array from the tangential focus [pitches], signed like the focus."""
    sagittal: Array
    distortion: Array
    """[%]."""
    colour: Array
    """F to C [pitches]."""
    bound: float
    """Measured non-distortion bound on the array [mm]."""


def _lens_curves(design: Design, points: int = 46) -> _LensCurves:
    """Trace a design's real lens along x."""
    camera = Camera.of(design)
    x = np.linspace(0.0, float(sensor_field(camera).radius), points)
    real = real_field(design, np.stack([x, np.zeros(points)], axis=-1))
    cone = float(pupil_angle(camera)) / design.d
    maps, images = real.maps, real.images
    traced, folded = maps.status == RayFate.KEPT, images.status == ImageFate.FOLDED

    def where(condition: NDArray[np.bool_], values: Array) -> Array:
        return np.where(condition, values, np.nan)

    return _LensCurves(
        x=x,
        shift_px=real.shift[:, 0] / design.q,
        diameter_px=where(~folded, real.thin_diameter * (1 + real.widening) / design.q),
        thin_diameter_px=real.thin_diameter / design.q,
        axis_ratio=where(images.kept_fraction > 0, images.axis_ratio),
        kept=images.kept_fraction,
        folded=folded,
        tangential=where(traced, maps.tangential_focus * cone),
        sagittal=where(traced, maps.sagittal_focus * cone),
        distortion=where(traced, 100 * maps.distortion),
        colour=real.lateral_colour / design.d,
        bound=measured_bound(design)[1],
    )


def lens_over_field(design: Design, curves: _LensCurves | None = None) -> Picture:
    """Draw shift and growth of images against the thin-lens model's, foci and lateral colour, distortion.

    `curves` are those of `_lens_curves` where they are known already.
    """
    c = _lens_curves(design) if curves is None else curves
    parts = {
        ("microlens images", "real less thin [px]"): [
            ("image centre, shift", c.shift_px, "blue", ""),
            ("diameter, growth", c.diameter_px - c.thin_diameter_px, "vermillion", ""),
        ],
        ("foci and colour", "blur on the array [pitches]"): [
            ("tangential focus", c.tangential, "blue", ""), ("sagittal focus", c.sagittal, "green", ""),
            ("lateral colour, F to C", c.colour, "purple", "2 3"),
        ],
        ("distortion", "image height against first order [%]"): [("distortion", c.distortion, "orange", "")],
    }  # fmt: skip
    keys = [line_key("thin-lens model", "grey", 1.2, "6 4")]
    each = (PAGE / 3, 290.0)
    pictures = []
    for (title, label), lines in parts.items():
        values = np.concatenate([[0.0], *(line for _, line, *_ in lines)])
        up, across = Scale.around(values, 0.06), Scale(0.0, float(c.x[-1]))
        marks: list[Mark] = []
        if title == "microlens images" and c.folded.any():
            first = float(c.x[np.argmax(c.folded)])
            marks.append(Area([first, across.high, across.high, first], np.repeat(up[:2], 2), "grey", 0.18))
        if title == "microlens images" and c.bound < across.high:
            marks.append(Line([c.bound, c.bound], up[:2], "ink", 1.2, "1.5 2"))
        marks.append(Line([0.0, across.high], [0.0, 0.0], "grey", 1.2, "6 4"))
        marks += [Line(c.x, line, colour, 1.8, dash) for _, line, colour, dash in lines]
        keys += [line_key(name, colour, 1.8, dash) for name, _, colour, dash in lines]
        panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "microlens off axis [mm]", label, title)
        pictures.append(one_panel(f"lens-{title.split()[0]}", title, each, panel, left=64, top=28, right=10))
    if c.bound < c.x[-1]:
        keys.append(line_key("undistorted within", "ink", 1.2, "1.5 2"))
    if c.folded.any():
        keys.append(box_key("folded or dark", "grey", 0.18))
    return beside("lens-field", f"The real lens of {design.name} over the field", pictures, keys)


def lens_images(design: Design, places: Mapping[str, Point]) -> Picture:
    """Draw microlens images of the real lens and of its thin-lens model to one scale; places on the MLA [mm]."""
    drawn = {label: _lens_image(design, place) for label, place in places.items()}
    reach = max(float(np.nanmax(np.abs(np.stack([mark.x, mark.y])))) for marks, _ in drawn.values() for mark in marks)
    scale, each = Scale(-1.06 * reach, 1.06 * reach), PAGE / max(len(drawn), 1)
    side = min(each - 68, 240.0)
    pictures = []
    for label, (marks, words) in drawn.items():
        said = (
            Text(scale.low, scale.high, label, size=PLAIN, dy=-26, bold=True),
            Text(scale.low, scale.high, words, dy=-9),
        )
        panel = Panel((54.0, 45.0, side, side), scale, scale, (*marks, *said), "x [px]", "y [px]", equal=True)
        pictures.append(as_tall(f"lens-{label}", words, panel, size=(each, 0.0)))
    return beside("lens-images", f"Microlens images behind the real lens of {design.name}", pictures, TWINS)


def _lens_image(design: Design, place: Point) -> tuple[tuple[Line | Area, ...], str]:
    """Outlines of a microlens image and its thin-lens model's [px] from the latter's centre, and its fate."""
    traced = real_field(design, [place])
    centre = traced.thin_centre[0]
    twin = (np.vstack([traced.thin_outline[0], traced.thin_outline[0, :1]]) - centre) / design.q
    marks: list[Line | Area] = [Line(twin[:, 0], twin[:, 1], "grey", 1.4, "6 4")]
    fate = ImageFate(traced.images.status[0])
    if fate != ImageFate.DARK:
        edge = (
            (traced.images.boundary[0] - centre) / design.q
            if fate != ImageFate.FOLDED
            else _folded(design, place, centre)
        )
        marks.append(Area(edge[:, 0], edge[:, 1], "blue", 0.25, "blue", 2.0))
    kept = 100 * float(traced.images.kept_fraction[0])
    words = {ImageFate.DARK: "dark", ImageFate.CLIPPED: f"cut, {kept:.3g} % unvignetted", ImageFate.FULL: "whole"}
    return tuple(marks), words.get(fate, f"folded, {kept:.3g} % unvignetted")


def _folded(design: Design, place: Point, centre: Array) -> Array:
    """Outline of what is lit, on a grid: a folded image has no single one."""
    camera = camera_of(design)
    (c,) = microlenses(design, [place])
    side = np.linspace(-1, 1, 161) * 0.7 * camera.lens.clear_diameter * camera.d_2 / camera.d_1
    grid = np.stack(np.meshgrid(side, side), axis=-1) + c * (1 + camera.d_2 / camera.d_1)
    at = views(camera, c, grid, clip=False)
    x, y = (side + c[k] * camera.d_2 / camera.d_1 - centre[k] for k in (0, 1))
    return where_above(np.minimum(at.fap_margin, at.margin), x / design.q, y / design.q, 0.0)
