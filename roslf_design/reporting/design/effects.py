"""Every effect's size against its budget."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...drawing.marks import Line, Mark, Point, Text, bars
from ...drawing.panel import Panel, Scale, named_ticks, names_width, threshold
from ...drawing.picture import Picture
from ...drawing.theme import PLAIN, SMALL, short, text_width, wrapped
from ...effects.effect import UNIT_WORDS
from ...effects.plan import PlannedEffect, not_modelled
from ...words import spaced

BAR, REASON = 24.0, 15.0
"""Heights of a bar's row, and of the line below it that says why, where there is room [px]."""
LOWEST = 17.0
"""Least height of a row [px]."""
TOP, RIGHT, BELOW = 24.0, 14.0, 42.0
"""Margins [px]."""
FLOOR = 1e-4
"""Shares of the budget below which bars end."""
LINE = 16.0
"""Height of a line of text [px]."""


def effects_budget(effects: Sequence[PlannedEffect], size: Point = (560, 360)) -> Picture:
    """Draw the effects of a plan as bars of estimate over budget, largest first; those of no size are left out.

    `size` [px] is the least: with many effects the picture grows higher rather than illegible; an infinite height takes
    what there is to say.
    """
    sized = {
        effect: abs(effect.estimate) / effect.budget for effect in effects if effect.estimate and effect.budget > 0
    }
    shown = sorted(sized, key=lambda effect: -sized[effect])
    shares = [sized[effect] for effect in shown]
    named = {effect: spaced(effect.name) for effect in effects}
    names = [named[effect] for effect in shown]
    notes = [
        f"{short(abs(effect.estimate), 3)} {UNIT_WORDS[effect.unit]}{'' if effect.on else ', left out'}"
        for effect in shown
    ]
    left = 14 + names_width(names)
    width = max(size[0] - left - RIGHT, 80.0)
    unsized = [named[effect] for effect in effects if effect not in sized and effect.modelled]
    told = [f"Of no size here: {', '.join(unsized)}."] if unsized else []
    idle = [line for text in (*told, not_modelled(effects)) if text for line in wrapped(text, size[0] - 28)]
    # Which side of the budget it is on is seen.
    reasons = [
        wrapped(effect.reason.removesuffix("; above the budget").removesuffix("; below the budget"), size[0] - 28)
        for effect in shown
    ]
    starts = np.cumsum([0.0, *(BAR + REASON * len(lines) for lines in reasons)])
    why = starts[-1] <= size[1] - TOP - BELOW - LINE * len(idle)
    bar = BAR if why else max(LOWEST, min(BAR, (size[1] - TOP - BELOW) / max(len(shown), 1)))
    if not why:
        starts = bar * np.arange(len(shown) + 1)
    low = max(FLOOR, min(0.03, min(shares, default=1.0) / 3))
    high = max(3.0, max(shares, default=1.0))
    # Room for the notes behind the bars.
    space = names_width(notes) + 16 if notes else 16.0
    across = Scale(low, high * (high / low) ** (space / max(width - space, 40.0)), log=True)
    tall = float(starts[-1]) or BAR
    marks: list[Mark] = []
    words: list[Mark] = []
    remarks: list[Mark] = []
    for effect, share, name, note, lines, start in zip(shown, shares, names, notes, reasons, starts[:-1], strict=True):
        at, end = start + bar / 2, max(share, low)
        # What is always on keeps its colour below the budget: it is not left out.
        colour = "blue" if effect.on else "pale"
        marks.append(bars(low, end, at, 0.68 * bar, fill=colour, testid=f"effect-{effect.name}"))
        for k, line in enumerate(lines if why else ()):
            remarks.append(Text(14, TOP + start + bar + 9 + REASON * k, line, "grey", SMALL, plate=True))
        words.append(Text(low, at + 4, name, "ink", SMALL, "end", dx=-7))
        words.append(Text(end, at + 4, note, "ink" if effect.on else "grey", SMALL, dx=8, plate=True))
    if not shown:
        words.append(Text(low, tall / 2, "no effect has a size", "ink", PLAIN, "middle", dx=width / 2))
    ticks = named_ticks(across.ticks(max(2, int(width / 60))))
    ticks = tuple(
        (value, text) for value, text in ticks
        if width * (1 - float(across.share(value))) + RIGHT > text_width(text, SMALL) / 2
    )  # fmt: skip
    # Grid and budget stand beside bars alone: words of reasons are not crossed.
    rows = starts[:-1] if shown else np.zeros(1)
    ends = np.stack([rows, rows + (bar if shown else tall), np.full(rows.shape, np.nan)], axis=-1).ravel()

    def beside_bars(x: float, colour: str, wide: float) -> Line:
        return Line(np.full(ends.shape, x), ends, colour, wide)

    grid = [beside_bars(value, "grid", 1.0) for value, _ in ticks]
    budget = beside_bars(1.0, "orange", 2.0), threshold(1.0, tall, "budget")[1]
    # The ordinate counts pixels downwards.
    panel = Panel(
        (left, TOP, width, tall), across, Scale(tall, 0.0), (*grid, *marks, *budget, *words),
        "estimate over budget [1]", grid="", y_ticks=(), x_ticks=ticks,
    )  # fmt: skip
    foot = TOP + tall + BELOW
    remarks += (Text(14, foot + LINE * (k + 0.7), line, "grey") for k, line in enumerate(idle) if why)
    least = size[1] if math.isfinite(size[1]) else foot + LINE * len(idle) + 6
    title = f"Effects against their budgets: {sum(share > 1 for share in shares)} of {len(shown)} above"
    return Picture("effects", title, (size[0], max(least, foot)), (panel,), remarks=tuple(remarks))
