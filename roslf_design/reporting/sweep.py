"""Quantities over one number of a design as curves, over two as maps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..drawing.marks import Area, Dots, Image, Key, Line, Mark, Text, box_key, contours, dot_key, line_key, parted
from ..drawing.panel import Panel, Scale, colour_bar, named_ticks
from ..drawing.picture import PAGE, Picture, beside, one_panel
from ..evaluation.sweep import AT, Sweep
from ..theory.limits import Limits
from ..theory.quantities import in_words
from ..words import number

TALL = 230.0
"""Height of each curve's picture [px]."""
SIDES, FOOT = (72.0, 110.0), 42.0
"""Room left and right of a map, and below it [px]."""
MAP = (PAGE - sum(SIDES), 230.0)
"""Width and height of a map [px]."""
DOT = 9.0
"""Room that the dot at the design has at least on each side [px]."""
LEVEL = ("ink", 0.8, "")
"""Look of lines of equal values."""
LINES = 6
"""Lines of equal values on a map, about."""
OWN, REQUIRED = ("vermillion", 1.2, "6 3"), ("orange", 2.0, "9 3")
"""Looks of the lines at the design's own value, and at limits."""
DECADES = 10.0
"""Largest value, over the middle one, from which shades are those of logarithms."""


def sweep_picture(swept: Sweep, design: str, notes: Iterable[str] = (), required: Sequence[Limits] = ()) -> Picture:
    """A panel a quantity, one below the other, as far as there are values; gaps and grey where some are missing.

    Above stands whose they are and where they are asked for, below them one legend and `notes`, as on what is missing.
    Limits that are `required` there are lines with their values.
    """
    shown = _known_part(swept)
    where = "" if swept.at is None else f", {number(swept.at, 4)} mm ahead of the tip"
    pictures, keys = [], {}  # type: list[Picture], dict[str, Key]
    for name in shown.values:
        ends = _ends(swept, name, required)
        picture, own = _panel(shown, name, "" if pictures else f"{design}{where}", ends)
        pictures.append(picture)
        keys |= {key.text: key for key in own}
    title = f"{', '.join(map(in_words, swept.values))} of {design} over {' and '.join(swept.places)}{where}"
    return beside("sweep", title, pictures, [*keys.values(), *(Key(in_words(note), ()) for note in notes)], down=True)


def _ends(swept: Sweep, name: str, required: Sequence[Limits]) -> list[tuple[float, str]]:
    """Limits of a quantity where it is swept, each with its words."""
    return [
        (end, f"{word} {number(end, 4)} {swept.units[name]}".rstrip())
        for asked, quantity, low, high in required
        if quantity.name == name and (quantity.at == "never" or (AT not in swept.places and asked.at == swept.at))
        for word, end in (("at least", low), ("at most", high))
        if end is not None
    ]


def _known_part(swept: Sweep) -> Sweep:
    """Without the margins where nothing has a finite value; all of it where nothing has one."""
    known = np.any([np.isfinite(values) for values in swept.values.values()], axis=0)
    if not known.any():
        return swept
    part = tuple(slice(at.min(), at.max() + 1) for at in np.nonzero(known))
    places = {place: axis[own] for (place, axis), own in zip(swept.places.items(), part, strict=True)}
    values = {name: each[part] for name, each in swept.values.items()}
    return replace(swept, places=places, values=values, valid=swept.valid[part])


def _label(name: str, unit: str) -> str:
    words = "ahead of the tip" if name == AT else in_words(name)
    return f"{words} [{unit}]" if unit else words


def _panel(swept: Sweep, name: str, title: str, ends: list[tuple[float, str]]) -> tuple[Picture, list[Key]]:
    values, unit = swept.values[name], swept.units[name]
    known = values[np.isfinite(values)]
    (place, x), *second = swept.places.items()
    across = Scale(float(x.min()), float(x.max())) if np.ptp(x) > 0 else Scale.around(x)
    label = _label(place, swept.units[place])
    within = all(axis.min() <= at <= axis.max() for axis, at in zip(swept.places.values(), swept.own, strict=True))
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    room = 0.0 if second else max(high - low, abs(high) / 4)  # a limit farther off would leave a curve flat
    near = [(end, words) for end, words in ends if low - room <= end <= high + room]
    keys = [
        Key(f"required: {in_words(name)} {words}, {'above' if end > high else 'below'} all that is shown", ())
        for end, words in ends
        if not low - room <= end <= high + room
    ]
    if not second:
        shown = np.where(np.isfinite(values), values, np.nan)
        there = np.pad(np.isfinite(shown), 1)
        lone = there[1:-1] & ~there[:-2] & ~there[2:]  # no line goes to a neighbour
        up = Scale.around([*known, *(end for end, _ in near)])
        here: list[Mark] = [Line([swept.own[0]] * 2, [up.low, up.high], *OWN, testid="own")] if within else []
        keys += [line_key("the focal plane" if place == AT else "the design", *OWN)] if within else []
        for end, words in near:
            here.append(Line([across.low, across.high], [end, end], *REQUIRED, testid="required"))
            here.append(Text(across.high, end, words, anchor="end", dx=-6.0, dy=-5.0, plate=True))
        keys += [line_key("required", *REQUIRED)] if near else []
        drawn = (*here, Line(x, shown, "blue", 2.0), Dots(x[lone], shown[lone], "blue", size=3.0))
        panel = Panel((0, 0, 1, 1), across, up, drawn, label, _label(name, unit), title)
        return one_panel(f"sweep-{name}", name, (PAGE, TALL), panel, left=72, top=32 if title else 14), keys
    other, y = second[0]
    high = high if high > low else low + 1.0
    up = Scale(float(y.min()), float(y.max())) if np.ptp(y) > 0 else Scale.around(y)
    steps = [(scale.high - scale.low) / max(1, len(v) - 1) / 2 for scale, v in ((across, x), (up, y))]
    box = across.low - steps[0], across.high + steps[0], up.low - steps[1], up.high + steps[1]
    log = low > 0 and high > DECADES * float(np.median(known))
    across_shades = Scale(low, high, log)
    shades = across_shades.share(np.where(np.isfinite(values), values, low)).T
    marks: list[Mark] = [Image(shades, box, "blue", 0.0, 1.0)]
    if min(values.shape) > 1:
        told = named_ticks(across_shades.ticks(LINES))
        levels = [*((*end, REQUIRED) for end in near), *((*tick, LEVEL) for tick in told)]
        inner = MAP[0] * (1 - 1 / len(x)), MAP[1] * (1 - 1 / len(y))  # from the first points to the last
        marks += contours(values.T, x, y, levels, inner, [(swept.own[0], swept.own[1])] * within)
        keys += [line_key("required", *REQUIRED)] * any(getattr(mark, "colour", "") == REQUIRED[0] for mark in marks)
    keys += [box_key("no camera, or no finite value", "grey", 0.9)] if not np.isfinite(values).all() else []
    none = np.argwhere(~np.isfinite(values))
    if none.size:
        middle = np.stack([x[none[:, 0]], y[none[:, 1]]], -1)
        corners = middle[:, None] + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * steps
        marks.append(Area(parted(corners[..., 0]), parted(corners[..., 1]), "grey", 0.9))
    across, up = Scale(*box[:2]), Scale(*box[2:])
    if within:
        per_px = [(scale.high - scale.low) / px for scale, px in zip((across, up), MAP, strict=True)]
        across, up = (
            Scale(min(scale.low, own - DOT * room), max(scale.high, own + DOT * room))
            for scale, own, room in zip((across, up), swept.own, per_px, strict=True)
        )
        marks.append(Dots(swept.own[:1], swept.own[1:], "vermillion", size=6, edge="ground", width=2, testid="own"))
        keys.append(dot_key("the design", "vermillion", size=6))
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), label, _label(other, swept.units[other]), title, grid="")
    top = 32.0 if title else 14.0
    size = PAGE, MAP[1] + top + FOOT
    picture = one_panel(f"sweep-{name}", name, size, panel, left=SIDES[0], right=SIDES[1], top=top, foot=FOOT)
    return picture.with_panels(colour_bar(picture.panels[0], low, high, "blue", _label(name, unit), log)), keys
