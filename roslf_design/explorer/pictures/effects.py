"""Every effect's size against its budget."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .axes import Picture, Plot, Scale
from .svg import PLAIN, SMALL, document, line, plated, short, tag, text, text_width, wrapped
from .theme import ThemeName, theme_named

if TYPE_CHECKING:
    from ...evaluation.result import Effect

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


def effects(found: Sequence[Effect], theme: ThemeName = "light", size: tuple[float, float] = (560, 360)) -> Picture:
    """Draw the effects of a plan as bars of estimate over budget, largest first; those of no size are left out.

    Parameters
    ----------
    found : sequence of Effect
        ``evaluate(design).effects``.
    theme : {"light", "dark"}
    size : (width, height)
        [px]; with many effects the picture grows higher than asked for rather than illegible.

    Returns
    -------
    Picture
    """
    colours = theme_named(theme)
    shown = sorted(
        (effect for effect in found if effect.estimate != 0 and effect.budget > 0),
        key=lambda effect: -abs(effect.estimate) / effect.budget,
    )
    shares = [abs(effect.estimate) / effect.budget for effect in shown]
    names = [_named(effect) for effect in shown]
    left = 14 + max((text_width(name, SMALL) for name in names), default=40.0)
    low = max(FLOOR, min(0.03, min(shares, default=1.0) / 3))
    high = max(3.0, max(shares, default=1.0))
    width = max(size[0] - left - RIGHT, 80.0)
    idle = wrapped(_without_size(found), size[0] - 28)
    each = (size[1] - TOP - BELOW - LINE * len(idle)) / max(len(shown), 1)
    why = each >= BAR + REASON
    row = BAR + REASON if why else max(LOWEST, min(BAR, (size[1] - TOP - BELOW) / max(len(shown), 1)))
    bar = BAR if why else row
    notes = [
        f"{short(abs(effect.estimate), 3)} {UNITS.get(effect.unit, effect.unit)}{'' if effect.on else ', left out'}"
        for effect in shown
    ]
    # Room for the notes behind the bars.
    room = max((text_width(note, SMALL) for note in notes), default=0.0) + 16
    reach = (high / low) ** (room / max(width - room, 40.0))
    across = Scale(low, high * reach, log=True)
    plot = Plot(left, TOP, width, row * max(len(shown), 1), across, Scale(0.0, 1.0))
    parts = []
    for value in plot.x.ticks(max(2, int(width / 60))):
        x, _ = plot.at(value, 0)
        parts.append(line((x, plot.top), (x, plot.bottom), colours.grid))
        parts.append(text((x, plot.bottom + 16), short(value, 2), colours.ink, SMALL, "middle"))
    for k, (effect, share) in enumerate(zip(shown, shares, strict=True)):
        x, _ = plot.at(max(share, low), 0)
        # What is always on keeps its colour below the budget: it is not left out.
        parts.append(
            tag("rect", x=left, y=plot.top + k * row + 0.16 * bar, width=max(x - left, 0.0), height=0.68 * bar, rx=1.5,
                fill=colours.blue if effect.on else colours.pale, data_testid=f"effect-{effect.name}")
        )  # fmt: skip
    x, _ = plot.at(1.0, 0)
    parts.append(line((x, plot.top - 4), (x, plot.bottom), colours.orange, 2))
    parts.append(text((x, plot.top - 8), "budget", colours.orange, SMALL, "middle", bold=True))
    for k, (effect, share, name, note) in enumerate(zip(shown, shares, names, notes, strict=True)):
        x, y = plot.at(max(share, low), 0)[0], plot.top + k * row + bar / 2 + 4
        if why:
            # Which side of the budget it is on is seen.
            told = effect.reason.removesuffix("; above the budget").removesuffix("; below the budget")
            (reason,) = wrapped(told, size[0] - 28, SMALL, 1)
            parts.append(plated((14, plot.top + k * row + bar + 9), reason, colours.grey, colours.ground))
        parts.append(text((left - 7, y), name, colours.ink, SMALL, "end"))
        parts.append(plated((x + 8, y), note, colours.ink if effect.on else colours.grey, colours.ground))
    parts.append(line((left, plot.bottom), (plot.right, plot.bottom), colours.grey))
    parts.append(text((left + width / 2, plot.bottom + 33), "estimate over budget", colours.ink, PLAIN, "middle"))
    if not shown:
        parts.append(text((left + width / 2, plot.top + row / 2), "no effect has a size", colours.ink, PLAIN, "middle"))
    foot = plot.bottom + BELOW
    if why and foot + LINE * len(idle) <= size[1]:
        parts += [text((14, foot + LINE * (k + 0.7)), told, colours.grey, SMALL) for k, told in enumerate(idle)]
    over = sum(share > 1 for share in shares)
    title = f"Effects against their budgets: {over} of {len(shown)} above"
    return Picture(document("effects", title, (size[0], max(size[1], plot.bottom + BELOW)), colours, parts))


def _named(effect: Effect) -> str:
    words = {"fap": "FAP", "mla": "MLA", "cos4": "cos⁴"}
    return " ".join(words.get(word, word) for word in effect.name.split("_"))


def _without_size(found: Sequence[Effect]) -> str:
    names = [_named(effect) for effect in found if effect.estimate == 0 or effect.budget <= 0]
    return f"Of no size here: {', '.join(names)}." if names else ""
