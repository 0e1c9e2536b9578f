"""Drawings of an optimisation: what it changed, its search, what it costs and what it holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..._arrays import Array
from ...drawing.marks import Dots, Key, Line, Mark, Point, Text, bars, box_key, dot_key, line_key
from ...drawing.panel import Panel, Scale, colour_bar, names_width, rows_panel
from ...drawing.picture import Picture, as_tall, legend_height, one_panel
from ...drawing.theme import PLAIN, SMALL, THEMES, short, text_width

if TYPE_CHECKING:
    from ...optimization.solve import Answer

WIDE_ROW = 46.0
"""Height of a variable's row [px]."""
FLOOR, SAME = 1e-8, 1e-6
"""Share at which smaller losses are drawn; share up to which a design is the same."""


class SearchEnd(NamedTuple):
    """End of one search."""

    spent: int
    """Evaluations so far, its own included."""
    loss: float
    """How much worse than the answer, as a share of the goal."""
    kind: str
    """"start", "check", or "bad" where a limit fails."""
    solver: str = ""
    """Solver of a check; empty for the main search."""

    @property
    def percent(self) -> float:
        """Loss as it is drawn [%]."""
        return 100 * max(self.loss, FLOOR)


@dataclass(frozen=True)
class VariableMove:
    """One variable, from the design asked about to the one found, between its bounds [mm]."""

    symbol: str
    before: float
    after: float
    low: float
    high: float

    @property
    def at_bound(self) -> bool:
        """Whether it ended at one of its bounds."""
        return min(self.after - self.low, self.high - self.after) <= 1e-6 * max(abs(self.high), 1e-12)


def change_bars(changes: Sequence[VariableMove], size: Point = (560, 200)) -> Picture:
    """Draw every variable between its bounds, where it was and where it is now; `size` [px] is the least."""
    left, foot = 48.0, 26 + WIDE_ROW * len(changes)
    width = max(size[0] - left - 24.0, 100.0)
    marks: list[Mark] = []
    for k, change in enumerate(changes):
        y, scale = 26 + k * WIDE_ROW, Scale(change.low, change.high)
        a, b = (width * min(max(float(scale.share(v)), 0.0), 1.0) for v in (change.before, change.after))
        words = f"{short(change.before)} → {short(change.after)} mm{', at bound' if change.at_bound else ''}"
        half = text_width(words, SMALL) / 2
        marks += [
            Line([0.0, width], [y, y], "pale", 6, clip=False),
            Line([a, b], [y, y], "blue", 3),
            Dots([a], [y], "ground", size=5, edge="grey", width=2),
            Dots([b], [y], "orange" if change.at_bound else "blue", size=6, testid=f"change-{change.symbol}"),
            Text(0.0, y, change.symbol, "ink", PLAIN, "end", dx=-14, dy=4),
            Text(min(max(b, half), width - half), y, words, "ink", SMALL, "middle", dy=-10),
            Text(0.0, y, short(change.low, 3), "grey", SMALL, dy=16),
            Text(width, y, short(change.high, 3), "grey", SMALL, "end", dy=16),
        ]
    keys = [
        dot_key("before", "ground", size=5, edge="grey", width=2),
        *([dot_key("found", "blue", size=6)] if not all(change.at_bound for change in changes) else []),
        *([dot_key("found, at its bound", "orange", size=6)] if any(change.at_bound for change in changes) else []),
    ]
    panel = Panel((left, 0.0, width, foot), Scale(0, width), Scale(foot, 0), tuple(marks), bare=True)
    height = max(size[1], foot + legend_height(keys, size[0] - 24) + 6)
    title = "Variables: " + "; ".join(f"{c.symbol} {c.before:.4g} to {c.after:.4g} mm" for c in changes)
    return Picture("changes", title, (size[0], height), (panel,), tuple(keys), (14.0, foot, size[0] - 24))


def ends_of(answer: Answer) -> tuple[SearchEnd, ...]:
    """Where each start's and each check's search of a study ended."""
    spent, ends = 0, []
    for search in answer.searches:
        spent += search.evaluations
        ends.append(SearchEnd(spent, max(search.merit - answer.merit, 0.0), "start" if search.feasible else "bad"))
    for check in answer.checks:
        spent += check.evaluations + check.polished.evaluations
        kind = "check" if check.polished.feasible else "bad"
        ends.append(SearchEnd(spent, max(check.polished.merit - answer.merit, 0.0), kind, check.solver))
    return tuple(ends)


def ends_differ(ends: Sequence[SearchEnd]) -> bool:
    """Whether searches that hold all limits ended at more than the answer: else all lie on the picture's floor."""
    return any(end.kind != "bad" and end.loss > SAME for end in ends)


SEARCHES = {
    "start": ("a search's end", Dots((), (), "blue", size=4.5, testid="search-ends")),
    "bad": ("a limit fails", Dots((), (), "vermillion", "x", 4, width=2)),
    "check": ("another solver's", Dots((), (), "orange", "D", 5, edge="ground", width=1)),
}
"""Kinds of `SearchEnd`: what they are called, and their signs."""


def search_history(ends: Sequence[SearchEnd], size: Point = (420, 260)) -> Picture:
    """Draw where every search ended, as a loss against the answer, over the evaluations spent so far; `size` in px."""
    top = max([1e-2, *(100 * end.loss for end in ends if end.kind != "bad")])
    marks: list[Mark] = []
    for kind, (_, sign) in SEARCHES.items():
        own = [end for end in ends if end.kind == kind]
        losses = [top if kind == "bad" else end.percent for end in own]
        if own:
            marks.append(replace(sign, x=[end.spent for end in own], y=losses))
        named = [end for end in own if end.solver]
        marks += [Text(end.spent, end.percent, end.solver, "grey", SMALL, "end", dy=-9, halo=True) for end in named]
    signs = [SEARCHES[kind] for kind in ("start", "check", "bad") if any(end.kind == kind for end in ends)]
    keys = [Key(words, (replace(sign, x=(0.0,), y=(0.0,), testid=""),)) for words, sign in signs]
    across = Scale(0.0, 1.05 * max((end.spent for end in ends), default=1))
    up = Scale(100 * FLOOR / 3, 3 * top, log=True)
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "evaluations so far [1]", "worse than the answer by [%]")
    same = sum(end.kind != "bad" and end.loss <= SAME for end in ends)
    title = f"{same} of {len(ends)} searches ended at the answer"
    return one_panel("history", title, size, panel, keys, left=76)


def goal_front(
    points: Array, labels: Sequence[str], *, log: Sequence[bool] = (False, False, False), title: str = "Goals",
    answer: Point | None = None, also: Sequence[float] = (), size: Point = (560, 340),
) -> Picture:  # fmt: skip
    """Draw designs by what they reach of two goals, and of a third by shade.

    Parameters
    ----------
    points : ndarray, shape (N, 2) or (N, 3)
        Abscissa, ordinate and, where there is one, the third goal.
    labels, log : sequence
        Of the goals, and which of them are drawn logarithmically.
    answer : (x, y), optional
        The optimum that was asked for.
    also
        Abscissae that are to be on the axis.
    """
    lone = [answer] if answer is not None else []
    ends = [[*points[:, k], *(point[k] for point in lone), *(also if k == 0 else ())] for k in (0, 1)]
    x, y = (
        Scale(min(v) / 1.08, max(v) * 1.08, log=True) if logarithmic and v else Scale.around(v)
        for v, logarithmic in zip(ends, log, strict=False)
    )
    third = points.shape[1] > 2
    marks: list[Mark] = []
    if third:
        shade = np.log(points[:, 2]) if log[2] else points[:, 2]
        low, high = float(shade.min()), float(shade.max())
        colours = THEMES["light"].shades("cividis", (shade - low) / (high - low or 1.0))[:, :3]
        for (a, b, _), colour in zip(points, colours, strict=True):
            marks.append(Dots([a], [b], f"#{colour.tobytes().hex()}", size=4.5, edge="grey", width=0.6))
    else:
        points = points[np.argsort(points[:, 0], kind="stable")]
        marks.append(Line(points[:, 0], points[:, 1], "blue", 1.8, testid="front-line"))
        marks.append(Dots(points[:, 0], points[:, 1], "blue", size=4.5))
    if answer is not None:
        marks.append(Dots([answer[0]], [answer[1]], "vermillion", "*", 7))
    keys = [dot_key("the optimum", "vermillion", "*", 7)] if answer is not None else []
    panel = Panel((0, 0, 1, 1), x, y, tuple(marks), labels[0], labels[1])
    under = legend_height(keys, size[0] - 28) if keys else 0.0
    tall = max(size[1], text_width(labels[1], PLAIN) + 30, text_width(labels[2], PLAIN) + 30 if third else 0.0)
    picture = one_panel("front", title, (size[0], tall + under), panel, keys, left=64, right=80 if third else 18)
    if not third:
        return picture
    (panel,) = picture.panels
    bar = colour_bar(panel, low, high, "cividis", labels[2])
    if log[2]:
        values = Scale(float(np.exp(low)), float(np.exp(high)), log=True).ticks(4)
        bar = replace(bar, y_ticks=tuple((float(np.log(v)), short(v)) for v in values))
    return picture.with_panels(bar)


def bore_and_stop(field: Array, bore: Array, stop: Array, misplaced: Array) -> Picture:
    """Draw the kept light over the field, through a bore and through the one stop that stands for it.

    `field` is of microlenses from the axis [mm], shape (N,); the others are shares of the stop's light: through all
    rims, through the stop, on the wrong side of its rim.
    """
    marks: list[Mark] = []
    keys: list[Key] = []
    for values, name, colour, dash, sign in (
        (bore, "bore, all rims", "blue", "", "o"),
        (stop, "equivalent stop", "orange", "7 4", "s"),
        (misplaced, "on the wrong side of its rim", "vermillion", "2 3", "^"),
    ):
        marks += [Line(field, values, colour, 1.8, dash), Dots(field, values, colour, sign, 3.5)]
        keys.append(line_key(name, colour, 1.8, dash, Dots((0.0,), (0.0,), colour, sign, 3.5)))
    up = Scale(0.0, 1.06 * max(float(np.max([bore, stop, misplaced])), 1e-9))
    labels = "microlens position from the axis [mm]", "share of the stop's light"
    panel = Panel((0, 0, 1, 1), Scale.around(field, 0.03), up, tuple(marks), *labels)
    return one_panel("bore", "Light through the bore and through its equivalent stop", (576, 310), panel, keys)


def robust_yields(rows: Sequence[tuple[str, float, float]]) -> Picture:
    """Draw the share of builds that hold each constraint: rows of name, share of the nominal, of the robust design.

    Without those that every build holds; the last, of all together, is always there.
    """
    rows = [*(row for row in rows[:-1] if min(row[1:]) < 1), *rows[-1:]]
    width, each, names = 672, 28.0, [name for name, *_ in rows]
    marks: list[Mark] = []
    for k, (_, *shares) in enumerate(rows):
        for share, shift, colour in zip(shares, (-0.2, 0.2), ("grey", "blue"), strict=True):
            at = each * (k + 0.5 + shift)
            marks.append(bars(0.0, 100 * share, at, 0.36 * each, fill=colour))
            marks.append(Text(100 * share, at, f"{100 * share:.1f} %", "ink", SMALL, dx=5, dy=4))
    left = 16 + names_width(names)
    box = (left, 8.0, width - left - 70, each * len(rows))
    panel = rows_panel(box, Scale(0, 100), names, marks, "builds that hold it [%]", each)
    title = "Builds that hold each constraint, of the nominal and of the robust design"
    keys = [box_key("nominal optimum", "grey"), box_key("robust design", "blue")]
    return as_tall("robust", title, panel, keys, size=(width, 0.0))
