"""What a real main lens does over the field, its thin twin beside it: image places and sizes, foci, outlines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..lenses.tracer import KEPT
from ..theory.exit_pupil import pupil_angle
from ..theory.light import half_diagonal
from ..traced.camera import camera_of, microlenses, views
from ..traced.images import measured_bound, real_field
from .marks import Area, Floats, Line, Mark, Point, box_key, line_key, where_above
from .panel import Panel, Scale
from .picture import PAGE, Picture, beside

if TYPE_CHECKING:
    from ..design import Design

KEYS = (line_key("thin twin", "grey", 1.4, "6 4"), line_key("real lens", "blue", 2))
"""What the outlines of a microlens image are."""
FOLDED = 3
"""Status of an image without a single outline."""


class LensCurves(NamedTuple):
    """Along x from the axis to the distance of the sensor's corner; NaN where there is no light to tell it by."""

    x: Floats
    """Microlens [mm], shape (N,)."""
    shift_px: Floats
    """Image centre against the thin twin's, outwards positive."""
    diameter_px: Floats
    """Of the disc with the image's area; NaN where the image is folded."""
    thin_diameter_px: float
    axis_ratio: Floats
    kept: Floats
    """Part of the FAP that is seen."""
    folded: NDArray[np.bool_]
    tangential: Floats
    """Blur on the array from the tangential focus [pitches], signed like the focus."""
    sagittal: Floats
    distortion: Floats
    """[%]."""
    colour: Floats
    """F to C [pitches]."""
    bound: float
    """Measured non-distortion bound on the array [mm]."""


def lens_curves(design: Design, points: int = 46) -> LensCurves:
    """Trace a design's real lens along x."""
    camera = Camera.of(design)
    x = np.linspace(0.0, float(half_diagonal(camera)), points)
    found = real_field(design, np.stack([x, np.zeros(points)], axis=-1))
    cone = float(pupil_angle(camera)) / design.d
    maps, images = found.maps, found.images
    traced, folded = maps.status == KEPT, images.status == FOLDED

    def where(condition: NDArray[np.bool_], values: Floats) -> Floats:
        return np.where(condition, values, np.nan)

    return LensCurves(
        x=x,
        shift_px=found.shift[:, 0] / design.q,
        diameter_px=where(~folded, found.thin_diameter * (1 + found.widening) / design.q),
        thin_diameter_px=found.thin_diameter / design.q,
        axis_ratio=where(images.kept_fraction > 0, images.axis_ratio),
        kept=images.kept_fraction,
        folded=folded,
        tangential=where(traced, maps.tangential_focus * cone),
        sagittal=where(traced, maps.sagittal_focus * cone),
        distortion=where(traced, 100 * maps.distortion),
        colour=found.lateral_colour / design.d,
        bound=measured_bound(design)[1],
    )


def lens_over_field(design: Design, curves: LensCurves | None = None, width: float = PAGE) -> Picture:
    """Draw shift and growth of images against the thin twin's, foci and lateral colour, distortion; `width` in px.

    `curves` are those of `lens_curves` where they are known already.
    """
    c = lens_curves(design) if curves is None else curves
    growth = c.diameter_px - c.thin_diameter_px
    parts = (
        ("microlens images", "real less thin [px]", ((c.shift_px, "blue", ""), (growth, "vermillion", ""))),
        ("foci and colour", "blur on the array [pitches]",
         ((c.tangential, "blue", ""), (c.sagittal, "green", ""), (c.colour, "purple", "2 3"))),
        ("distortion", "image height against first order [%]", ((c.distortion, "orange", ""),)),
    )  # fmt: skip
    each = (width / 3, 290.0)
    pictures = []
    for title, label, lines in parts:
        values = np.concatenate([[0.0], *(line for line, _, _ in lines)])
        up, across = Scale.around(values, 0.06), Scale(0.0, float(c.x[-1]))
        marks: list[Mark] = []
        if title == "microlens images":
            marks += _bounds(c, up)
        marks.append(Line([0.0, across.high], [0.0, 0.0], "grey", 1.2, "6 4"))
        marks += [Line(c.x, line, colour, 1.8, dash) for line, colour, dash in lines]
        box = (64.0, 28.0, each[0] - 64 - 10, each[1] - 28 - 42)
        panel = Panel(box, across, up, tuple(marks), "microlens off axis [mm]", label, title)
        pictures.append(Picture(f"lens-{title.split()[0]}", title, each, (panel,)))
    keys = [
        line_key("thin twin", "grey", 1.2, "6 4"), line_key("image centre, shift", "blue", 1.8),
        line_key("diameter, growth", "vermillion", 1.8), line_key("tangential focus", "blue", 1.8),
        line_key("sagittal focus", "green", 1.8), line_key("lateral colour, F to C", "purple", 1.8, "2 3"),
        line_key("distortion", "orange", 1.8),
    ]  # fmt: skip
    if c.bound < c.x[-1]:
        keys.append(line_key("undistorted within", "ink", 1.2, "1.5 2"))
    if c.folded.any():
        keys.append(box_key("folded or dark", "grey", 0.18))
    return beside("lens-field", f"The real lens of {design.name} over the field", pictures, keys)


def _bounds(c: LensCurves, up: Scale) -> list[Mark]:
    marks: list[Mark] = []
    if c.folded.any():
        first, last = float(c.x[np.argmax(c.folded)]), float(c.x[-1])
        marks.append(Area([first, last, last, first], [up.low, up.low, up.high, up.high], "grey", 0.18))
    if c.bound < c.x[-1]:
        marks.append(Line([c.bound, c.bound], [up.low, up.high], "ink", 1.2, "1.5 2"))
    return marks


def lens_images(design: Design, places: Mapping[str, Point], width: float = PAGE) -> Picture:
    """Draw microlens images as the real lens makes them, and the thin twin's, to one scale; places on the MLA [mm]."""
    drawn = {label: lens_image(design, place) for label, place in places.items()}
    reach = max(float(np.nanmax(np.abs(np.stack([mark.x, mark.y])))) for marks, _ in drawn.values() for mark in marks)
    scale, each = Scale(-1.06 * reach, 1.06 * reach), width / max(len(drawn), 1)
    side = min(each - 68, 240.0)
    pictures = []
    for label, (marks, words) in drawn.items():
        box = (54.0, 28.0, side, side)
        panel = Panel(box, scale, scale, marks, "x [px]", "y [px]", f"{label}: {words}", equal=True)
        pictures.append(Picture(f"lens-{label}", words, (each, side + 28 + 42), (panel,)))
    return beside("lens-images", f"Microlens images behind the real lens of {design.name}", pictures, KEYS)


def lens_image(design: Design, place: Point) -> tuple[tuple[Line | Area, ...], str]:
    """Outlines of a microlens image and its thin twin's [px] from the thin image's centre, and what became of it."""
    found = real_field(design, [place])
    centre, radius = found.thin_centre[0], found.thin_diameter / 2 / design.q
    turn = np.linspace(0, 2 * np.pi, 181)
    marks: list[Line | Area] = [Line(radius * np.cos(turn), radius * np.sin(turn), "grey", 1.4, "6 4")]
    status = int(found.images.status[0])
    if status:
        edge = (found.images.boundary[0] - centre) / design.q if status != FOLDED else _folded(design, place, centre)
        marks.append(Area(edge[:, 0], edge[:, 1], "blue", 0.25, "blue", 2.0))
    kept = 100 * float(found.images.kept_fraction[0])
    return tuple(marks), ("dark", f"cut, {kept:.3g} % kept", "whole", f"folded, {kept:.3g} % kept")[status]


def _folded(design: Design, place: Point, centre: Floats) -> Floats:
    """Outline of what is lit, on a grid: a folded image has no single one."""
    camera = camera_of(design)
    (c,) = microlenses(design, [place])
    side = np.linspace(-1, 1, 161) * 0.7 * camera.lens.clear_diameter * camera.d_2 / camera.d_1
    grid = np.stack(np.meshgrid(side, side), axis=-1) + c * (1 + camera.d_2 / camera.d_1)
    at = views(camera, c, grid, clip=False)
    x, y = (side + c[k] * camera.d_2 / camera.d_1 - centre[k] for k in (0, 1))
    return where_above(np.minimum(at.fap_room, at.room), x / design.q, y / design.q, 0.0)
