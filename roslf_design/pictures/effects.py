"""Every effect's size against its budget."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .lettering import PLAIN, SMALL, short, text_width, wrapped
from .marks import Line, Mark, Point, Text, bars
from .panel import Panel, Scale, named_ticks
from .picture import Picture

if TYPE_CHECKING:
    from ..effects.plan import PlannedEffect

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
    shown = sorted(
        (effect for effect in effects if effect.estimate != 0 and effect.budget > 0),
        key=lambda effect: -abs(effect.estimate) / effect.budget,
    )
    shares = [abs(effect.estimate) / effect.budget for effect in shown]
    names = [_named(effect) for effect in shown]
    left = 14 + max((text_width(name, SMALL) for name in names), default=40.0)
    low = max(FLOOR, min(0.03, min(shares, default=1.0) / 3))
    high = max(3.0, max(shares, default=1.0))
    width = max(size[0] - left - RIGHT, 80.0)
    idle = wrapped(_without_size(effects), size[0] - 28)
    each = (size[1] - TOP - BELOW - LINE * len(idle)) / max(len(shown), 1)
    why = each >= BAR + REASON
    row = BAR + REASON if why else max(LOWEST, min(BAR, (size[1] - TOP - BELOW) / max(len(shown), 1)))
    bar = BAR if why else row
    notes = [
        f"{short(abs(effect.estimate), 3)} {UNITS.get(effect.unit, effect.unit)}{'' if effect.on else ', left out'}"
        for effect in shown
    ]
    # Room for the notes behind the bars.
    space = max((text_width(note, SMALL) for note in notes), default=0.0) + 16
    across = Scale(low, high * (high / low) ** (space / max(width - space, 40.0)), log=True)
    tall = row * max(len(shown), 1)
    # The ordinate counts pixels downwards.
    panel = Panel(
        (left, TOP, width, tall), across, Scale(tall, 0.0), (), "estimate over budget [1]", grid="x", y_ticks=(),
        x_ticks=named_ticks(across.ticks(max(2, int(width / 60)))),
    )  # fmt: skip
    marks: list[Mark] = []
    for k, (effect, share) in enumerate(zip(shown, shares, strict=True)):
        # What is always on keeps its colour below the budget: it is not left out.
        colour = "blue" if effect.on else "pale"
        at = k * row + bar / 2
        marks.append(bars(low, max(share, low), at, 0.68 * bar, fill=colour, testid=f"effect-{effect.name}"))
    marks.append(Line([1.0, 1.0], [-4.0, tall], "orange", 2, clip=False))
    marks.append(Text(1.0, 0.0, "budget", "orange", SMALL, "middle", dy=-8, bold=True))
    for k, (effect, share, name, note) in enumerate(zip(shown, shares, names, notes, strict=True)):
        y = k * row + bar / 2 + 4
        if why:
            # Which side of the budget it is on is seen.
            words = effect.reason.removesuffix("; above the budget").removesuffix("; below the budget")
            (reason,) = wrapped(words, size[0] - 28, SMALL, 1)
            marks.append(Text(low, k * row + bar + 9, reason, "grey", SMALL, dx=14 - left, plate=True))
        marks.append(Text(low, y, name, "ink", SMALL, "end", dx=-7))
        marks.append(Text(max(share, low), y, note, "ink" if effect.on else "grey", SMALL, dx=8, plate=True))
    if not shown:
        marks.append(Text(low, row / 2, "no effect has a size", "ink", PLAIN, "middle", dx=width / 2))
    foot = TOP + tall + BELOW
    remarks: tuple[Mark, ...] = ()
    if why and foot + LINE * len(idle) <= size[1]:
        remarks = tuple(Text(14, foot + LINE * (k + 0.7), words, "grey") for k, words in enumerate(idle))
    over = sum(share > 1 for share in shares)
    title = f"Effects against their budgets: {over} of {len(shown)} above"
    return Picture("effects", title, (size[0], max(size[1], foot)), (panel.with_marks(*marks),), remarks=remarks)


def _named(effect: PlannedEffect) -> str:
    words = {"fap": "FAP", "mla": "MLA", "cos4": "cos⁴"}
    return " ".join(words.get(word, word) for word in effect.name.split("_"))


def _without_size(effects: Sequence[PlannedEffect]) -> str:
    names = [_named(effect) for effect in effects if effect.estimate == 0 or effect.budget <= 0]
    return f"Of no size here: {', '.join(names)}." if names else ""
