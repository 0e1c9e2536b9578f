"""What an optimisation found: variables before and after, where its searches ended, what a goal costs, how robust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .lettering import PLAIN, SMALL, short, text_width
from .marks import Dots, Floats, Key, Line, Mark, Point, Text, bars, box_key, dot_key, line_key
from .panel import Panel, Scale, named_ticks
from .picture import Picture, as_tall, colour_bar, legend_height, one_panel
from .theme import THEMES

if TYPE_CHECKING:
    from ..explorer.runs import OptimiseResult
    from ..optimization.solve import Answer

ROW = 46.0
"""Height of a variable's row [px]."""
FLOOR = 1e-8
"""Losses below this share are drawn here: the same design."""


class SearchEnd(NamedTuple):
    """Where one search ended."""

    spent: int
    """Evaluations so far, its own included."""
    loss: float
    """How much worse than the answer, as a share of the goal."""
    kind: str
    """"start", "check", or "bad" where a limit fails."""
    solver: str = ""
    """Of a check."""


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
    left, right = 48.0, 24.0
    width = max(size[0] - left - right, 100.0)
    tall = ROW * len(changes)
    marks: list[Mark] = []
    for k, change in enumerate(changes):
        y = 26 + k * ROW
        scale = Scale(change.low, change.high)
        a, b = (width * min(max(float(scale.share(v)), 0.0), 1.0) for v in (change.before, change.after))
        marks.append(Line([0.0, width], [y, y], "pale", 6, clip=False))
        marks.append(Line([a, b], [y, y], "blue", 3))
        marks.append(Dots([a], [y], "ground", size=5, edge="grey", width=2))
        colour = "orange" if change.at_bound else "blue"
        marks.append(Dots([b], [y], colour, size=6, testid=f"change-{change.symbol}"))
        marks.append(Text(0.0, y, change.symbol, "ink", PLAIN, "end", dx=-14, dy=4))
        words = f"{short(change.before)} → {short(change.after)} mm{', at bound' if change.at_bound else ''}"
        half = text_width(words, SMALL) / 2
        marks.append(Text(min(max(b, half), width - half), y, words, "ink", SMALL, "middle", dy=-10))
        marks.append(Text(0.0, y, short(change.low, 3), "grey", SMALL, dy=16))
        marks.append(Text(width, y, short(change.high, 3), "grey", SMALL, "end", dy=16))
    keys = [
        dot_key("before", "ground", size=5, edge="grey", width=2), dot_key("found", "blue", size=6),
        dot_key("found, at its bound", "orange", size=6),
    ]  # fmt: skip
    panel = Panel((left, 0.0, width, 26 + tall), Scale(0, width), Scale(26 + tall, 0), tuple(marks), bare=True)
    foot = 26 + tall
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


def search_history(ends: Sequence[SearchEnd], size: Point = (420, 260)) -> Picture:
    """Draw where every search ended, as a loss against the answer, over the evaluations spent so far; `size` in px."""
    keys = [Key(name, (_sign(kind, [0.0], [0.0]),)) for kind, name in
            (("start", "a search's end"), ("check", "another solver's"), ("bad", "a limit fails"))]  # fmt: skip
    spent = max((end.spent for end in ends), default=1)
    top = max([1e-2, *(100 * end.loss for end in ends if end.kind != "bad")])
    marks: list[Mark] = []
    for kind in ("start", "bad", "check"):
        own = [end for end in ends if end.kind == kind]
        if own:
            losses = [top if kind == "bad" else max(100 * end.loss, 100 * FLOOR) for end in own]
            marks.append(_sign(kind, [end.spent for end in own], losses, "search-ends" if kind == "start" else ""))
        for end in own:
            if solver := end.solver:
                loss = max(100 * end.loss, 100 * FLOOR)
                marks.append(Text(end.spent, loss, solver, "grey", SMALL, "end", dy=-9, halo=True))
    across, up = Scale(0.0, 1.05 * spent), Scale(100 * FLOOR / 3, 3 * top, log=True)
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "evaluations so far [1]", "worse than the answer by [%]")
    same = sum(end.kind != "bad" and end.loss <= 1e-6 for end in ends)
    title = f"{same} of {len(ends)} searches ended at the answer"
    return one_panel("history", title, size, panel, keys, left=76)


def _sign(kind: str, x: Sequence[float], y: Sequence[float], testid: str = "") -> Dots:
    if kind == "bad":
        return Dots(x, y, "vermillion", "x", 4, width=2, testid=testid)
    if kind == "check":
        return Dots(x, y, "orange", "D", 5, edge="ground", width=1, testid=testid)
    return Dots(x, y, "blue", size=4.5, testid=testid)


def front(run: OptimiseResult, size: Point = (420, 300)) -> Picture:
    """Draw designs of which none is better in both goals; size as for `search_history`.

    Raises
    ------
    ValueError
        No second goal was asked for.
    """
    if run.against is None:
        raise ValueError("no front: the run was asked for one goal alone")
    goals = run.goal, run.against
    points = np.array(run.front, float).reshape(-1, 2)
    words = "" if len(points) > 1 else "the goals do not compete" if len(points) else "no design holds every limit"
    labels = [f"{goal.words} [{goal.unit}]" if goal.unit else goal.words for goal in goals]
    title = f"What {goals[0].label} costs of {goals[1].label}: {len(points)} designs"
    return goal_front(points, labels, title=title, size=size, words=words, also=(run.after,))


def goal_front(
    points: Floats, labels: Sequence[str], *, log: Sequence[bool] = (False, False, False), title: str = "Goals",
    answer: Point | None = None, words: str = "", also: Sequence[float] = (), size: Point = (560, 360),
) -> Picture:  # fmt: skip
    """Draw designs by what they reach of two goals, and of a third by shade.

    Parameters
    ----------
    points : ndarray, shape (N, 2) or (N, 3)
        Abscissa, ordinate and, where there is one, the third goal.
    labels : sequence of str
        Of the goals.
    log : sequence of bool
        Which of them are drawn logarithmically.
    title : str
    answer : (x, y), optional
        The optimum that was asked for.
    words : str
        To write into the picture.
    also : sequence of float
        Abscissae that are to be on the axis.
    size : (width, height)
        [px].
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
        for (a, b, _), share in zip(points, (shade - low) / (high - low or 1.0), strict=True):
            marks.append(Dots([a], [b], _shade(float(share)), size=4.5, edge="grey", width=0.6))
    else:
        points = points[np.argsort(points[:, 0], kind="stable")]
        marks.append(Line(points[:, 0], points[:, 1], "blue", 1.8, testid="front-line"))
        marks.append(Dots(points[:, 0], points[:, 1], "blue", size=4.5))
    if answer is not None:
        marks.append(Dots([answer[0]], [answer[1]], "vermillion", "*", 7))
        side, dx = ("end", -11.0) if float(x.share(answer[0])) > 0.7 else ("start", 11.0)
        marks.append(Text(*answer, "the optimum", "vermillion", SMALL, side, dx, 5, halo=True))
    panel = Panel((0, 0, 1, 1), x, y, tuple(marks), labels[0], labels[1])
    picture = one_panel("front", title, size, panel, left=64, right=80 if third else 18)
    box = picture.panels[0].box
    remarks = (Text(box[0] + box[2] / 2, box[1] + 18, words, "ink", PLAIN, "middle"),) if words else ()
    panels = picture.panels
    if third:
        bar = colour_bar(panels[0], low, high, "cividis", labels[2])
        if log[2]:
            values = Scale(float(np.exp(low)), float(np.exp(high)), log=True).ticks(4)
            bar = Panel(
                bar.box, bar.x, bar.y, bar.marks, y_label=labels[2], x_ticks=(), grid="", right=True,
                y_ticks=tuple((float(np.log(v)), short(v)) for v in values),
            )  # fmt: skip
        panels = (*panels, bar)
    return Picture("front", title, size, panels, remarks=remarks)


def _shade(share: float) -> str:
    """#rrggbb of a share on the ramp that every colour vision reads alike."""
    red, green, blue, _ = THEMES["light"].shades("cividis", np.array(share)).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"


def bore_and_stop(field: Floats, bore: Floats, stop: Floats, misplaced: Floats, size: Point = (576, 310)) -> Picture:
    """Draw the kept light over the field, through a bore and through the one stop that stands for it.

    Parameters
    ----------
    field : ndarray
        Microlenses from the axis [mm], shape (N,).
    bore, stop, misplaced : ndarray
        Shares of the stop's light: through all rims, through the stop, on the wrong side of its rim.
    size : (width, height)
        [px].
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
    labels = "microlens position from the axis [mm]", "share of the stop's light [1]"
    panel = Panel((0, 0, 1, 1), Scale.around(field, 0.03), up, tuple(marks), *labels)
    return one_panel("bore", "Light through the bore and through its equivalent stop", size, panel, keys)


def robust_yields(rows: Sequence[tuple[str, float, float]], width: float = 672) -> Picture:
    """Draw the share of builds that hold each constraint: rows of name, share of the nominal, of the robust design."""
    each = 38.0
    left = 16 + max(text_width(name, SMALL) for name, *_ in rows)
    tall = each * len(rows)
    marks: list[Mark] = []
    for k, (name, *shares) in enumerate(rows):
        marks.append(Text(0.0, each * (k + 0.5), name, "ink", SMALL, "end", dx=-7, dy=4))
        for share, shift, colour in zip(shares, (-0.2, 0.2), ("grey", "blue"), strict=True):
            at = each * (k + 0.5 + shift)
            marks.append(bars(0.0, 100 * share, at, 0.36 * each, fill=colour))
            marks.append(Text(100 * share, at, f"{100 * share:.1f} %", "ink", SMALL, dx=5, dy=4))
    keys = [box_key("nominal optimum", "grey"), box_key("robust design", "blue")]
    panel = Panel(
        (left, 8.0, width - left - 70, tall), Scale(0, 100), Scale(tall, 0), tuple(marks), "builds that hold it [%]",
        grid="x", x_ticks=named_ticks(range(0, 101, 20)), y_ticks=(),
    )  # fmt: skip
    title = "Builds that hold each constraint, of the nominal and of the robust design"
    return as_tall("robust", title, panel, keys, size=(width, 0.0))
