"""MTF over detail at some fields; a map of the detail that is resolved, over distance and field."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...camera import Camera
from ...design import Design
from ...drawing.marks import Image, Key, Line, Mark, Text, line_key
from ...drawing.panel import Panel, Scale, colour_bar, round_ticks
from ...drawing.picture import PAGE, Picture, beside, one_panel
from ...drawing.theme import SMALL
from ...evaluation.fields import default_fields
from ...evaluation.stations import BEYOND, planes
from ...progress import UNHEARD, Share
from ...theory.light import on_array, sensor_field
from ...traced.fields import DesignImages, IdealImages, images_of
from ..lens_words import lens_words

COLOURS = ("blue", "orange", "green")
WIDTHS = (4.6, 2.8, 1.2)
"""Widths of the lines: where they lie on each other, each shows beside the next."""
PLACES = ("centre", "edge", "corner")
COLUMNS, ROWS, ALIKE, DEEP = 11, 9, 0.1, 5.0
"""Fields and distances of the map; share of detail below which corner and middle show alike; ratio of its far to its
near end above which distances are drawn logarithmically."""
ON_CURVE = 33
"""Distances of a curve in the map's place."""
NARROW = 95.0
"""Field from which on words centred there would reach beyond the map [%]."""
EMS = np.array([22.0, 9.0])
"""Numbers of lines that find room beside each other across the map, and above each other."""


def mtf_curves(design: Design, images: IdealImages | DesignImages | None = None) -> Picture:
    """MTF at the focal plane of the centre, the edge and the corner: of the refocused image, and of its middle view.

    `images` are the design's there, where they are known.
    """
    images = images_of(design, default_fields(design)) if images is None else images
    transfers = [images.transfer(k, None) for k in range(len(PLACES))]
    fold = min(transfer.fold("tangential") for transfer in transfers)
    detail = np.linspace(0.0, 2.4 * fold, 49)
    pictures = []
    for kind, title in (("refocused", "refocused image"), ("view", "a single view")):
        marks: list[Mark] = [Line([0.0, detail[-1]], [level, level], "grey", 1.0, "2 3") for level in (0.5, 0.1)]
        marks += [
            Line([fold, fold], [0.0, 1.0], "grey", 1.2, "6 3"),
            Text(fold, 0.97, "aliases above", "ink", SMALL, "start", 5, 4, halo=True),
        ]
        for transfer, colour, width in zip(transfers, COLOURS, WIDTHS, strict=True):
            if transfer.middle is None:
                continue
            marks.append(Line(detail, transfer(detail, kind, "tangential"), colour, width))  # type: ignore[arg-type]
            marks.append(Line(detail, transfer(detail, kind, "sagittal"), colour, width, "6 4"))  # type: ignore[arg-type]
        panel = Panel(
            (0, 0, 1, 1), Scale(0.0, float(detail[-1])), Scale(0.0, 1.0), tuple(marks),
            "detail at the focal plane [lp/mm]", "MTF", title=title,
        )  # fmt: skip
        pictures.append(one_panel(f"mtf-{kind}", title, (PAGE / 2, 204), panel, top=26))
    dark = lens_words(design.main_lens.kind).unlit
    keys: list[Key] = [
        line_key(name if transfer.middle is not None else f"{name}: {dark}", colour, width)
        for name, transfer, colour, width in zip(PLACES, transfers, COLOURS, WIDTHS, strict=True)
    ]
    keys += [line_key("tangential", "ink", 2.0), line_key("sagittal", "ink", 1.6, "6 4")]
    return beside("mtf", f"MTF of {design.name} at its focal plane, over detail in lp/mm", pictures, keys)


def resolution_map(design: Design, at: Sequence[float] = (), tell: Share = UNHEARD) -> Picture:
    """Detail at MTF 50 % of the refocused image, over distance ahead of the tip and field towards the corner.

    It reaches distances asked for, `at` [mm], and the outermost field that has light. A curve over distance where that
    shows as much as the middle.
    `tell` hears what share of it is known.
    """
    camera = Camera.of(design)
    low, high = (np.array([float(v) for v in end]) for end in sensor_field(camera))
    share = np.linspace(1e-6, 1.0, COLUMNS)  # the middle, too, has the diagonal for its radius
    middle = (low + high) / 2

    def along(share: np.ndarray) -> IdealImages | DesignImages:
        return images_of(design, on_array(camera, middle + share[:, None] * (high - middle)))

    images = along(share)
    lit = [k for k in range(1, COLUMNS) if images.transfer(k, None).middle is not None]
    whole = COLUMNS - 1 in lit
    if lit and not whole:
        share *= share[lit[-1]]
        images = along(share)
    near, focus, far = (at for _, at in planes(camera))
    reached = (float(near), float(min(far, BEYOND * focus)), *at)  # farther out hardly anything changes
    ends = min(reached), max(reached)
    deep = ends[1] > DEEP * ends[0]
    spaced = np.geomspace if deep else np.linspace
    distances = spaced(*ends, ROWS)
    values = np.full((ROWS, COLUMNS), math.nan)
    title, ahead = f"Detail that {design.name} resolves", Scale(*ends, log=deep)

    def shown(images: IdealImages | DesignImages, column: int, at: np.ndarray) -> np.ndarray:
        each = (images.transfer(column, far).limits_each_way((0.5,), "refocused") for far in at.tolist())
        return np.array([min(limit for (limit,) in each_way) for each_way in each])

    for done, column in enumerate((0, COLUMNS - 1, *range(1, COLUMNS - 1))):
        tell(done / COLUMNS)
        values[:, column] = shown(images, column, distances)
        if column and (np.ptp(values[:, [0, -1]], axis=1) < ALIKE * values[:, 0]).all():
            finer = spaced(*ends, ON_CURVE)
            own = images_of(
                design, on_array(camera, middle)[None]
            )  # its detail lies along pixels' rows, as the table's
            curve = Line(finer, shown(own, 0, finer), "blue", 2.2)
            up = Scale(0.0, 1.08 * float(np.max(curve.y)))
            panel = Panel((0, 0, 1, 1), ahead, up, (curve,), "ahead of the tip [mm]", "MTF 50 % at [lp/mm]")
            every = f"to {100 * ALIKE:g} % as much at every field" + ("" if whole else " that has light")
            return one_panel("resolution-map", f"{title}, {every}", (PAGE, 190), panel, left=64)
    known = values[np.isfinite(values)]
    top = float(known.max(initial=0.0)) or 1.0
    x, y = Scale(0.0, 100 * float(share[-1])), ahead
    half = 0.5 / (ROWS - 1)
    bottom, over = y.low * (y.low / y.high) ** half, y.high * (y.high / y.low) ** half
    if not deep:
        bottom, over = y.low - half * (y.high - y.low), y.high + half * (y.high - y.low)
    half_x = 0.5 * x.high / (COLUMNS - 1)
    shades = Image(np.nan_to_num(values), (-half_x, x.high + half_x, bottom, over), "blue", 0.0, top)
    marks: list[Mark] = [shades]
    if known.size == values.size:
        marks += _lines(x, y, share * 100, distances, values)
    else:
        blank = ~np.isfinite(values)
        darkest = np.flatnonzero(blank.sum(axis=1) == blank.sum(axis=1).max())
        row = int(darkest[len(darkest) // 2])
        at_most = 100 * float(share[blank[row]].mean())
        side, dx = ("end", -6.0) if at_most > NARROW * x.high / 100 else ("middle", 0.0)  # letters stay off the ticks
        dy = -8.0 if row == 0 else 14.0 if row == ROWS - 1 else 4.0
        marks.append(Text(min(at_most, x.high), float(distances[row]), "dark", "ink", SMALL, side, dx, dy, halo=True))
    field = "field, from the middle to the corner [%]" + ("" if whole else "; dark beyond")
    panel = Panel((0, 0, 1, 1), x, y, tuple(marks), field, "ahead of the tip [mm]", grid="")
    picture = one_panel("resolution-map", title, (PAGE, 210), panel, left=64, right=110)
    return picture.with_panels(colour_bar(picture.panels[0], 0.0, top, "blue", "MTF 50 % at [lp/mm]"))


def _lines(across: Scale, up: Scale, x: np.ndarray, y: np.ndarray, values: np.ndarray) -> list[Mark]:
    """Lines of equal resolution, each named nearest its middle where its number is clear of others' and of the rim."""
    from contourpy import contour_generator

    marks: list[Mark] = []
    numbers: list[np.ndarray] = []
    generator = contour_generator(x, y, values)
    for level in round_ticks(float(values.min()), float(values.max()), 5):
        for points in generator.lines(level):
            line = np.asarray(points)
            if len(line) < 2:
                continue
            marks.append(Line(line[:, 0], line[:, 1], "ink", 1.1))
            places = np.column_stack([across.share(line[:, 0]), up.share(line[:, 1])]) * EMS
            rim = np.minimum(places, EMS - places).min(axis=1)
            apart = [np.abs(places - one).max(axis=1) for one in numbers]
            clear = np.flatnonzero(np.min([2 * rim, *apart], axis=0) >= 1)
            if len(clear):
                best = clear[np.argmin(np.abs(clear - len(line) // 2))]
                numbers.append(places[best])
                at = line[best]
                marks.append(Text(float(at[0]), float(at[1]), f"{level:g}", "ink", SMALL, "middle", dy=4, halo=True))
    return marks
