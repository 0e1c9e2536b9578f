"""Every effect's size against its budget."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...drawing.marks import Mark, Point, Text, bars
from ...drawing.panel import Panel, Scale, named_ticks, names_width, threshold
from ...drawing.picture import Picture
from ...drawing.theme import PLAIN, SMALL, short, wrapped
from ...words import spaced

if TYPE_CHECKING:
    from ...effects.plan import PlannedEffect

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
UNITS = {"pitch": "pitches", "intensity": "of full scale", "px": "px"}


def effects_budget(effects: Sequence[PlannedEffect], size: Point = (560, 360)) -> Picture:
    """Draw the effects of a plan as bars of estimate over budget, largest first; those of no size are left out.

    `size` [px] is the least: with many effects the picture grows higher rather than illegible.
    """
    sized = {
        effect: abs(effect.estimate) / effect.budget for effect in effects if effect.estimate and effect.budget > 0
    }
    shown = sorted(sized, key=lambda effect: -sized[effect])
    shares = [sized[effect] for effect in shown]
    named = {effect: spaced(effect.name).replace("cos4", "cos⁴") for effect in effects}
    names = [named[effect] for effect in shown]
    notes = [
        f"{short(abs(effect.estimate), 3)} {UNITS.get(effect.unit, effect.unit)}{'' if effect.on else ', left out'}"
        for effect in shown
    ]
    left = 14 + names_width(names)
    width = max(size[0] - left - RIGHT, 80.0)
    unsized = [named[effect] for effect in effects if effect not in sized]
    idle = wrapped(f"Of no size here: {', '.join(unsized)}." if unsized else "", size[0] - 28)
    each = (size[1] - TOP - BELOW - LINE * len(idle)) / max(len(shown), 1)
    why = each >= BAR + REASON
    row = BAR + REASON if why else max(LOWEST, min(BAR, (size[1] - TOP - BELOW) / max(len(shown), 1)))
    bar = BAR if why else row
    low = max(FLOOR, min(0.03, min(shares, default=1.0) / 3))
    high = max(3.0, max(shares, default=1.0))
    # Room for the notes behind the bars.
    space = names_width(notes) + 16 if notes else 16.0
    across = Scale(low, high * (high / low) ** (space / max(width - space, 40.0)), log=True)
    tall = row * max(len(shown), 1)
    marks: list[Mark] = []
    words: list[Mark] = []
    for k, (effect, share, name, note) in enumerate(zip(shown, shares, names, notes, strict=True)):
        at, end = k * row + bar / 2, max(share, low)
        # What is always on keeps its colour below the budget: it is not left out.
        colour = "blue" if effect.on else "pale"
        marks.append(bars(low, end, at, 0.68 * bar, fill=colour, testid=f"effect-{effect.name}"))
        if why:
            # Which side of the budget it is on is seen.
            reason = effect.reason.removesuffix("; above the budget").removesuffix("; below the budget")
            (reason,) = wrapped(reason, size[0] - 28, SMALL, 1)
            words.append(Text(low, k * row + bar + 9, reason, "grey", SMALL, dx=14 - left, plate=True))
        words.append(Text(low, at + 4, name, "ink", SMALL, "end", dx=-7))
        words.append(Text(end, at + 4, note, "ink" if effect.on else "grey", SMALL, dx=8, plate=True))
    if not shown:
        words.append(Text(low, row / 2, "no effect has a size", "ink", PLAIN, "middle", dx=width / 2))
    # The ordinate counts pixels downwards.
    panel = Panel(
        (left, TOP, width, tall), across, Scale(tall, 0.0), (*marks, *threshold(1.0, tall, "budget"), *words),
        "estimate over budget [1]", grid="x", y_ticks=(), x_ticks=named_ticks(across.ticks(max(2, int(width / 60)))),
    )  # fmt: skip
    foot = TOP + tall + BELOW
    remarks: tuple[Mark, ...] = ()
    if why and foot + LINE * len(idle) <= size[1]:
        remarks = tuple(Text(14, foot + LINE * (k + 0.7), line, "grey") for k, line in enumerate(idle))
    title = f"Effects against their budgets: {sum(share > 1 for share in shares)} of {len(shown)} above"
    return Picture("effects", title, (size[0], max(size[1], foot)), (panel,), remarks=remarks)
