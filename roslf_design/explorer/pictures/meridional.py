"""Meridional section: bore, stops, lens, microlens array and sensor, with the rays of three microlenses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...report.figures.ray_diagram import LabelledFan, element_names, frame_of, is_centred, labelled_fans, name_rows
from .axes import Picture, Plot, Scale, legend, moved
from .svg import GLYPH, SMALL, Point, clipped, document, line, path, path_of, plated, short, tag, text, text_width
from .theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ...design import Design

NAME_ROW, DIMENSION_ROW = 16.0, 19.0
"""Heights [px]."""
EXAGGERATIONS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""How much larger than lengths heights may be drawn, times powers of ten."""
SMALLEST_SHARE = 0.25
"""Least share of the picture's length that the instrument has when all is shown without being asked for."""
LOWEST = 90.0
"""Least height of the section itself [px]."""


class Section(NamedTuple):
    """Where things are in the picture."""

    plot: Plot
    half: float
    """Elements and rays reach this high [mm]."""
    exaggeration: float
    """Pixels per millimetre of height over those of length."""
    rows: tuple[int, ...]
    """Of the elements' names."""


def meridional(
    design: Design, theme: ThemeName = "light", size: tuple[float, float] = (900, 340), *, whole: bool | None = None
) -> Picture:
    """Draw the section in which rays run, lengths to scale and heights by a round factor.

    Parameters
    ----------
    design : Design
        A real lens is drawn as its thin twin.
    theme : {"light", "dark"}
    size : (width, height)
        [px].
    whole : bool, optional
        From the object plane on (True; never where that is at infinity), or from a little before the outermost stop
        (False). None shows the way to the object unless the instrument would be small beside it.

    Returns
    -------
    Picture
        Its mapping takes pixels to z and height [mm].
    """
    colours, seen = theme_named(theme), design.thin_twin
    whole = math.isfinite(design.d_f) and (_instrument_is_seen(design) if whole is None else whole)
    drawn = labelled_fans(seen)
    # How many rows the legend takes must be known before the scale is, which it tells.
    entries = _entries(drawn, colours)
    _, foot = legend([*entries, ("", _scale_told(design, 100.0, whole))], colours, size[0] - 28)
    section = _section(seen, drawn, (size[0], size[1] - foot), whole)
    ruler = path("M-11,0h22M-11,-4v8M11,-4v8", colours.grey, 1.2)
    key, _ = legend([*entries, (ruler, _scale_told(design, section.exaggeration, whole))], colours, size[0] - 28)
    plot = section.plot
    rays = "".join(_fan(plot, fan, hue, colours) for fan, hue in zip(drawn, colours.fields, strict=True))
    body = [
        _housing(seen, section, colours),
        clipped("meridional-window", (0.0, plot.top, size[0], plot.height), tag("g", rays, data_testid="rays")),
        _elements(seen, section, colours, whole),
        _names(seen, section, colours, whole),
        _openings(seen, section, colours),
        _lengths(seen, section, colours, whole),
        moved(key, 16, size[1] - foot - 3),
    ]
    blocked = sum(int((~fan.kept).sum()) for fan in drawn)
    title = (
        f"Meridional section of {design.name}: rays of {', '.join(fan.label for fan in drawn)}; "
        f"{blocked} of {sum(fan.kept.size for fan in drawn)} drawn rays are blocked"
    )
    return Picture(document("meridional", title, size, colours, body), plot.mapping)


def _instrument_is_seen(design: Design) -> bool:
    end, front = design.d_1 + design.d_2, max(stop.distance for stop in design.all_stops)
    return end + front > SMALLEST_SHARE * (end + design.d_f)


def _section(design: Design, drawn: list[LabelledFan], size: tuple[float, float], whole: bool) -> Section:
    frame = frame_of(design, not whole, drawn)
    side = 16.0, 18.0 + text_width(f"d_2 = {short(design.d_2)} mm", SMALL)
    length = frame.right - frame.left
    across = max(size[0] - sum(side), 50.0)
    below = DIMENSION_ROW * 2 + 14
    rows, along = [0], across / length
    for _ in range(3):  # fewer pixels per millimetre may want more rows of names, and these leave fewer
        top = 8 + NAME_ROW * (1 + max(rows))
        height = max(size[1] - top - below, LOWEST)
        up = height / (2 * frame.half)
        along = min(across / length, up)
        # A name's width in millimetres, as `name_rows` takes it.
        rows = name_rows(element_names(design, not whole), SMALL * GLYPH * 1.15 / along / 0.6)
    exaggeration = _rounded_down(up / along)
    width = along * length
    tall = 2 * frame.half * along * exaggeration
    plot = Plot(
        side[0] + (across - width) / 2, top + (height - tall) / 2, width, tall,
        Scale(frame.left, frame.right), Scale(-frame.half, frame.half),
    )  # fmt: skip
    return Section(plot, frame.half, exaggeration, tuple(rows))


def _rounded_down(ratio: float) -> float:
    power = 10.0 ** math.floor(math.log10(ratio))
    return max(factor * power for factor in EXAGGERATIONS if factor * power <= ratio * (1 + 1e-9))


def _housing(design: Design, section: Section, theme: Theme) -> str:
    front = max(stop.distance for stop in design.all_stops)
    left, top = section.plot.at(-front, section.half)
    right, bottom = section.plot.at(design.d_1 + design.d_2, -section.half)
    return tag(
        "rect", x=left, y=top, width=right - left, height=bottom - top, fill=theme.pale, fill_opacity=0.28, rx=2
    )  # fmt: skip


def _fan(plot: Plot, fan: LabelledFan, hue: str, theme: Theme) -> str:
    middle, last = len(fan.kept) // 2, int(np.flatnonzero(fan.kept)[-1]) if fan.kept.any() else -1
    first = int(np.flatnonzero(fan.kept)[0]) if fan.kept.any() else -1
    kept, blocked, ends = [], [], []
    for number, (z, x, passed) in enumerate(zip(fan.z, fan.x, fan.kept, strict=True)):
        course = path_of(plot.along(z, x))
        if passed:
            # Chief and marginal rays stand out.
            width = 1.9 if number == middle else 1.4 if number in (first, last) else 0.6
            kept.append(path(course, hue, width))
        else:
            blocked.append(course)
            (end,) = plot.along(z[-1:], x[-1:])
            ends.append(end)
    crosses = "".join(f"M{x - 3.5:.1f},{y - 3.5:.1f}l7,7m0,-7l-7,7" for x, y in ends)
    return tag(
        "g",
        "".join(kept)
        + path("".join(blocked), theme.vermillion, 0.8, dash="4 3", data_testid=f"blocked-{fan.label.split()[0]}")
        + path(crosses, theme.vermillion, 1.5),
    )


def _elements(design: Design, section: Section, theme: Theme, whole: bool) -> str:
    plot, plate = section.plot, section.half
    parts = []
    for index, stop in enumerate(design.all_stops):
        colour = theme.ink if index == 0 else theme.stops[(index - 1) % len(theme.stops)]
        for sign in (-1, 1):
            edge = stop.decentre[0] + sign * stop.diameter / 2
            parts.append(line(plot.at(-stop.distance, edge), plot.at(-stop.distance, sign * plate), colour, 3.2))
    parts.append(_lens(design, section, theme))
    centred, mla = is_centred(design), design.microlens_array
    heights = [math.hypot(*box) if centred else box[0] for box in (mla.size, design.sensor_size)]
    # Each is drawn on the outer side of its plane, so that d_2 between them stays true.
    for z, middle, height, colour, shift in (
        (design.d_1, mla.decentre[0], heights[0], theme.sky, -1.5),
        (design.d_1 + design.d_2, design.sensor.decentre[0], heights[1], theme.ink, 1.5),
    ):
        (x, low), (_, high) = plot.at(z, middle - height / 2), plot.at(z, middle + height / 2)
        parts.append(line((x + shift, low), (x + shift, high), colour, 3))
    if whole:
        parts.append(line(plot.at(-design.d_f, -plate), plot.at(-design.d_f, plate), theme.grey, 1.6, dash="7 3"))
    start, end = plot.at(plot.x.low, 0.0), plot.at(design.d_1 + design.d_2, 0.0)
    return line(start, end, theme.grey, 0.8, dash="10 3 2 3") + "".join(parts)


def _lens(design: Design, section: Section, theme: Theme) -> str:
    plot, middle, radius = section.plot, design.main_lens.decentre[0], design.D / 2
    (x, top), (_, low) = plot.at(0.0, middle + radius), plot.at(0.0, middle - radius)
    bulge = min(max(0.09 * abs(low - top), 4.0), 14.0)
    glass = f"M{x:.1f},{top:.1f}Q{x + bulge:.1f},{(top + low) / 2:.1f} {x:.1f},{low:.1f}Q{x - bulge:.1f},"
    glass += f"{(top + low) / 2:.1f} {x:.1f},{top:.1f}Z"
    mounts = [
        line(plot.at(0.0, middle + sign * radius), plot.at(0.0, sign * section.half), theme.blue, 3.2)
        for sign in (-1, 1)
        if section.half > radius + sign * middle
    ]
    return path(glass, theme.blue, 1.2, theme.blue, fill_opacity=0.22) + "".join(mounts)


def _names(design: Design, section: Section, theme: Theme, whole: bool) -> str:
    plot, parts = section.plot, []
    for (z, name), row in zip(element_names(design, not whole), section.rows, strict=True):
        x, top = plot.at(z, section.half)
        level = top - 5 - NAME_ROW * row
        if row:
            parts.append(line((x, top - 2), (x, level + 3), theme.grid))
        wide = text_width(name, SMALL)
        parts.append(text((min(max(x, wide / 2 + 2), plot.right + 1e9), level), name, theme.ink, SMALL, "middle"))
    return "".join(parts)


def _openings(design: Design, section: Section, theme: Theme) -> str:
    """Diameters of the FAP and the main lens as dimensions across."""
    plot, parts = section.plot, []
    before, lens, behind = (plot.at(z, 0.0)[0] for z in (-design.d_3, 0.0, design.d_1))
    fits = behind - lens > text_width(f"D = {short(design.D)} mm", SMALL) + 34
    lens_side = 1 if fits or behind - lens > lens - before else -1
    marks = (
        ("D_F", -design.d_3, design.aperture.decentre[0], design.D_F, -1),
        ("D", 0.0, design.main_lens.decentre[0], design.D, lens_side),
    )
    for symbol, z, middle, diameter, side in marks:
        (x, top), (_, low) = plot.at(z, middle + diameter / 2), plot.at(z, middle - diameter / 2)
        x += side * 16
        told = f"{symbol} = {short(diameter)} mm"
        parts.append(_arrow((x, top), (x, low), theme))
        # Fields are drawn on the upper side of the lens, so on the lower side of what lies before the FAP.
        beside = low - 0.12 * (low - top) if low - top > 40 else low + 15
        at = (x - 2, top - 6) if symbol == "D_F" else (x + 5 * side, beside)
        parts.append(plated(at, told, theme.ink, theme.ground, anchor="start" if side > 0 else "end"))
    return "".join(parts)


def _lengths(design: Design, section: Section, theme: Theme, whole: bool) -> str:
    """Distances as dimensions along."""
    plot, parts = section.plot, []
    end = design.d_1 + design.d_2
    rows = [("d_3", -design.d_3, 0.0, 0), ("d_1", 0.0, design.d_1, 0)]
    if whole:
        rows.append(("d_f", -design.d_f, 0.0, 1))
    for symbol, start, stop, row in rows:
        (a, bottom), (b, _) = plot.at(start, -section.half), plot.at(stop, -section.half)
        level = bottom + 13 + DIMENSION_ROW * row
        if b - a < 1:
            continue
        told = f"{symbol} = {short(stop - start)} mm"
        parts += [line((x, bottom + 2), (x, level + 4), theme.grid) for x in (a, b)]
        parts.append(_arrow((a, level), (b, level), theme))
        if b - a > text_width(told, SMALL) + 24:
            parts.append(plated(((a + b) / 2, level + 4), told, theme.ink, theme.ground, anchor="middle"))
        elif symbol == "d_1":
            parts.append(text((b + 8, level + 4 + DIMENSION_ROW), told, theme.ink, SMALL))
        else:
            parts.append(text((a - 8, level + 4), told, theme.ink, SMALL, "end"))
    x, bottom = plot.at(end, -section.half)
    parts.append(text((x + 8, bottom + 17), f"d_2 = {short(design.d_2)} mm", theme.ink, SMALL))
    return tag("g", "".join(parts))


def _arrow(start: Point, end: Point, theme: Theme) -> str:
    """A dimension line with a tick at either end."""
    (a, b), (c, d) = start, end
    across = (0.0, 4.0) if abs(c - a) > abs(d - b) else (4.0, 0.0)
    ticks = "".join(
        line((x - across[0], y - across[1]), (x + across[0], y + across[1]), theme.grey, 1.2) for x, y in (start, end)
    )
    return line(start, end, theme.grey, 1.0) + ticks


def _entries(drawn: list[LabelledFan], theme: Theme) -> list[tuple[str, str]]:
    entries = [
        (line((-11, 0), (11, 0), hue, 1.9), fan.label if fan.kept.any() else f"{fan.label} (dark)")
        for fan, hue in zip(drawn, theme.fields, strict=True)
    ]
    if not all(fan.kept.all() for fan in drawn):
        cross = path("M-3.5,-3.5l7,7m0,-7l-7,7", theme.vermillion, 1.5)
        entries.append((line((-11, 0), (11, 0), theme.vermillion, 0.8, dash="4 3") + cross, "blocked, and where"))
    return entries


def _scale_told(design: Design, exaggeration: float, whole: bool) -> str:
    told = "to scale" if exaggeration == 1 else f"lengths to scale, heights ×{short(exaggeration)}"
    return told if whole else f"{told}; object plane {short(design.d_f)} mm before the lens"
