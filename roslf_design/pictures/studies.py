"""What studies found: yields, what spoils builds and how numbers scatter; what an optimum changed, costs and holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .._arrays import Array
from .marks import Area, Dots, Key, Line, Mark, Point, Text, bars, box_key, dot_key, line_key, stairs
from .picture import (
    Panel,
    Picture,
    Scale,
    as_tall,
    colour_bar,
    legend_height,
    named_ticks,
    names_width,
    one_panel,
    rows_panel,
    threshold,
)
from .theme import PLAIN, SMALL, THEMES, short, text_width

if TYPE_CHECKING:
    from ..explorer.runs import OptimiseResult
    from ..optimization.solve import Answer

ROW = 24.0
"""Height of a bar's row, its text beside it [px]."""
TALL_ROW = 36.0
"""The same with the text above the bar [px]."""
WIDE_ROW = 46.0
"""Of a variable's row [px]."""
SIDE = 14.0
"""Margin on either side of bars with their text above [px]."""
RIGHT = 16.0
"""Margin [px]."""
LARGEST = 3.0
"""Times the way to the limit beyond which bars are cut off."""
FLOOR = 1e-8
"""Losses below this share are drawn here: the same design."""


class YieldShare(NamedTuple):
    """A measured yield, 0 to 1, with the ends of its 95 % interval, and of how many builds."""

    value: float
    low: float
    high: float
    builds: int


@dataclass(frozen=True)
class Yields:
    """Yields of a run."""

    grade: str
    share: YieldShare
    """Of the run itself."""
    grades: tuple[tuple[str, YieldShare], ...]
    curve: tuple[tuple[float, YieldShare], ...]
    """Over a common factor on all tolerances."""


@dataclass(frozen=True)
class Offender:
    """What one tolerance alone, at its end, does."""

    place: str
    """Where in the design, in words."""
    tolerance: str
    """Half-width with its unit."""
    used: float
    """Largest part of the way from nominal to any limit; above 1 it breaks the limit by itself, inf where the build
    loses a number that is limited."""
    limited_by: str


@dataclass(frozen=True)
class LimitSpread:
    """Scatter of one limited number over the builds."""

    label: str
    nominal: float
    deviation: float
    """Standard deviation; NaN where some builds lack the number."""
    low: float
    high: float
    """5th and 95th percentile."""
    limit_low: float
    limit_high: float


def yield_bars(result: Yields, size: Point = (420, 170), target: float | None = None) -> Picture:
    """Draw the yield of every grade with its 95 % interval; that of the run itself stands out.

    `size` [px] is the least: rows stay legible. `target` is the wanted yield, marked by a line.
    """
    shares = [result.share if name == result.grade else share for name, share in result.grades]
    names = [f"{name} grade" for name, _ in result.grades]
    marks: list[Mark] = []
    for k, ((name, _), share) in enumerate(zip(result.grades, shares, strict=True)):
        at, own = ROW * (k + 0.5), name == result.grade
        marks.append(bars(0.0, 100 * share.value, at, ROW - 8, fill="blue" if own else "pale", testid=f"yield-{name}"))
        marks.append(Line([100 * share.low, 100 * share.high], [at, at], "ink", 1.4, ends="|"))
        percent = f"{100 * share.value:.1f} %"
        # Right of the axis, where no target's line runs.
        marks.append(Text(100.0, at, percent, "ink", SMALL, dx=8, dy=4, bold=own))
    if target is not None:
        marks += threshold(100 * target, ROW * len(names), "target")
    left = 14 + 1.1 * names_width(names)
    box = (left, 12.0 if target is None else 24.0, max(size[0] - left - RIGHT - 60, 80.0), ROW * len(names))
    bold = f"{result.grade} grade"
    label = f"builds that hold every limit [% of {_builds(shares)}]"
    panel = rows_panel(box, Scale(0, 100), names, marks, label, bold=bold)
    words = (f"{100 * share.value:.1f} % {name}" for name, share in zip(names, shares, strict=True))
    return as_tall("yield", f"Yield by grade: {', '.join(words)}", panel, size=size)


def _builds(shares: Sequence[YieldShare]) -> str:
    """How many builds lie behind shares, fewest and most."""
    counts = sorted({share.builds for share in shares})
    return " to ".join(f"{count:,}" for count in dict.fromkeys((counts[0], counts[-1])))


def yield_curve(
    result: Yields, size: Point = (420, 240), target: float | None = None, reached: float | None = None
) -> Picture:
    """Draw the yield over a common factor on all tolerances, with its interval, the target and what factor meets it."""
    scales = np.array([scale for scale, _ in result.curve])
    value, low, high = 100 * np.array([share[:3] for _, share in result.curve]).T
    least, most = float(scales.min()), float(scales.max())
    marks: list[Mark] = [
        Area(np.append(scales, scales[::-1]), np.append(high, low[::-1]), "blue", 0.22),
        Line([1.0, 1.0], [0.0, 105.0], "grey", 1.2, "6 3"),
        Text(1.0, 2.0, "as given", "grey", SMALL, dx=5, dy=-2),
        Line(scales, value, "blue", 2.2, testid="yield-curve"),
        Dots(scales, value, "blue", size=3.5),
    ]
    if target is not None:
        marks.append(Line([least, most], [100 * target] * 2, "orange", 1.6))
        if reached is not None:
            at, words = min(reached, most), f"{100 * target:.3g} % at {reached:.3g} times"
            marks.append(Dots([at], [100 * target], "vermillion", "D", 4.5, edge="ground", width=1.2))
            if at * at < least * most:  # no room on the left
                marks.append(Text(at, 100 * target, words, "ink", SMALL, "start", dx=8, dy=-6, halo=True))
            else:
                marks.append(Text(at, 100 * target, words, "ink", SMALL, "end", dx=-8, dy=16, halo=True))
    ticks = scales if len(scales) < 10 else np.array([0.25, 0.5, 1.0, 2.0, 4.0])
    ticks = ticks[(ticks >= least) & (ticks <= most)]
    grade = f"all tolerances of the grade {result.grade}, times" if result.grade else "all tolerances times"
    panel = Panel(
        (0, 0, 1, 1), Scale(least, most, log=True), Scale(0, 105), tuple(marks), grade,
        f"yield [% of {_builds([share for _, share in result.curve])} builds]",
        x_ticks=named_ticks(ticks.tolist()),
    )  # fmt: skip
    points = (f"{share:.0f} % at {scale:g}" for scale, share in zip(scales.tolist(), value.tolist(), strict=True))
    title = f"Yield over a common factor on all tolerances: {', '.join(points)}"
    dot = Dots((0.0,), (0.0,), "blue", size=3.5)
    keys = [line_key("yield", "blue", 2.2, "", dot), box_key("95 % interval", "blue", 0.22)]
    return one_panel("yield-curve", title, size, panel, keys, left=56)


def offender_bars(offenders: Sequence[Offender], size: Point = (560, 300), *, most: int = 8) -> Picture:
    """Draw what each tolerance alone uses of the limits, worst first, the first `most`; `size` [px] is the least."""
    shown = [row for row in offenders if row.used > 1e-3][:most]
    high = min(max([1.0, *(row.used for row in shown)]) * 1.05, LARGEST)
    width, tall = max(size[0] - 2 * SIDE, 100.0), TALL_ROW * max(len(shown), 1)
    marks: list[Mark] = []
    words: list[Mark] = []
    descriptions = []
    for k, row in enumerate(shown):
        y, end, colour = k * TALL_ROW, 100 * min(row.used, high), "vermillion" if row.used > 1 else "blue"
        marks.append(bars(0.0, end, y + 25, 10, fill=colour, testid=f"offender-{k}"))
        if row.used > high:  # cut off
            slant = end - 100 * high / width * np.array([11.0, 17.0, 13.0, 7.0])
            marks.append(Area(slant, y + np.array([18.0, 32.0, 32.0, 18.0]), "ground"))
        name, notes = f"{row.place} ±{row.tolerance}", _used(row)
        note = next((note for note in notes if text_width(f"{name} {note}", SMALL) + 12 < width), notes[-1])
        words.append(Text(0.0, y + 14, name, plate=True))
        words.append(Text(100 * high, y + 14, note, anchor="end", plate=True))
        descriptions.append(f"{name} uses {notes[0]}")
    marks += [*threshold(100.0, tall, "limit"), *words]
    if not shown:
        marks.append(Text(50 * high, 16.0, "no tolerance matters", "ink", PLAIN, "middle"))
    label = "part of the way to a limit that it uses alone [%]"
    panel = rows_panel((SIDE, 24, width, tall), Scale(0, 100 * high), (), marks, label)
    return as_tall("offenders", f"Worst offenders: {'; '.join(descriptions)}", panel, size=size)


def _used(row: Offender) -> tuple[str, ...]:
    """What it uses of which limit, from long to short."""
    label = row.limited_by.split(",")[0]
    if math.isinf(row.used):
        return f"{row.limited_by} undefined", f"{label} undefined", "undefined"
    part = f"{short(100 * row.used, 2)} %"
    return f"{part}: {row.limited_by}", f"{part}: {label}", part


def spread_bars(spreads: Sequence[LimitSpread], size: Point = (560, 300)) -> Picture:
    """Draw how limited numbers scatter: 5th to 95th percentile on the way from nominal (0) to the limits (100 %).

    `size` [px] is the least: rows stay legible.
    """
    names, ways = [row.label for row in spreads], [_ways(row) for row in spreads]
    reach = max([1.15, *(abs(end) for ends in ways for end in ends if math.isfinite(end))])
    reach = 100 * min(reach * 1.05, LARGEST)
    left = 14 + names_width(names)
    width, tall = max(size[0] - left - RIGHT, 100.0), ROW * max(len(names), 1)
    px = width / (2 * reach)
    marks: list[Mark] = [Line([0.0, 0.0], [0.0, tall], "grey", 1.2)]
    for k, ends in enumerate(ways):
        low, high = (min(max(100 * end, -reach), reach) for end in ends)
        colour = "vermillion" if max(map(abs, ends)) > 1 else "blue"
        bar = bars(low, max(high, low + 1.5 / px), ROW * (k + 0.5), ROW - 12, fill=colour, testid=f"spread-{k}")
        marks.append(bar)
    apart = 200 * px > text_width("lower limit", SMALL) + 16
    sides = (-100.0, "lower limit" if apart else ""), (100.0, "upper limit" if apart else "")
    edge = reach - (0.55 * text_width("upper limit", SMALL) + 2 - RIGHT) / px
    marks += [mark for x, words in sides for mark in threshold(x, tall, words, min(x, edge))]
    if not apart:
        marks.append(threshold(0.0, 0.0, "limits")[1])
    label = "way from nominal to limit: 90 % of builds [%]"
    panel = rows_panel((left, 24.0, width, tall), Scale(-reach, reach), names, marks, label)
    title = (
        f"Scatter of {len(names)} limited numbers over the builds, as shares of the way from nominal to their limits"
    )
    return as_tall("spread", title, panel, size=size)


def _ways(row: LimitSpread) -> tuple[float, float]:
    """Percentiles as shares of the way to the limit on their side; of the other limit's where there is none."""
    above, below = row.limit_high - row.nominal, row.nominal - row.limit_low

    def share(value: float) -> float:
        way = value - row.nominal
        room = (above if math.isfinite(above) else below) if way > 0 else (below if math.isfinite(below) else above)
        if way == 0 or math.isnan(way):
            return 0.0
        return way / room if room > 0 else math.copysign(math.inf, way)

    return share(row.low), share(row.high)


def ranked_moves(names: Sequence[str], plus: Array, minus: Array, limits: Sequence[float], label: str) -> Picture:
    """Draw how far each perturbation alone moves a number, ranked, at both ends of its tolerance.

    `plus` and `minus` have shape (N,) for N `names`; `limits` are moves that reach a limit, drawn where they are near;
    `label` is the number's, with its unit.
    """
    reach = max(float(np.abs([plus, minus]).max(initial=0.0)), 1e-300)
    near = [edge for edge in limits if abs(edge) < 3 * reach]
    scale = Scale.around([*plus, *minus, 0.0, *near], 0.12 if near else 0.05)
    at = ROW * (np.arange(len(names)) + 0.5)
    marks: list[Mark] = [
        bars(0.0, plus, at - ROW / 5, ROW / 2.5, fill="blue"), bars(0.0, minus, at + ROW / 5, ROW / 2.5, fill="orange"),
    ]  # fmt: skip
    for edge in near:
        marks += _limit(edge, ROW * len(names), 0.0, 0.0)
    keys = [box_key("at + tolerance", "blue"), box_key("at − tolerance", "orange")]
    return _ranked("sensitivity", names, scale, marks, f"change of {label}", keys)


def ranked_correlations(names: Sequence[str], values: Array, noise: float, label: str) -> Picture:
    """Draw the correlation of each perturbation with a number over all trials, ranked; `noise` is what chance may give.

    `values` has shape (N,); the others are as for `ranked_moves`.
    """
    at, tall = ROW * (np.arange(len(names)) + 0.5), ROW * len(names)
    marks: list[Mark] = [Area([-noise, noise, noise, -noise], [0.0, 0.0, tall, tall], "pale", 0.8)]
    for up, colour in ((values > 0, "blue"), (values <= 0, "orange")):
        if up.any():
            marks.append(bars(0.0, values[up], at[up], 0.6 * ROW, fill=colour))
    keys = [box_key("rises with it", "blue"), box_key("falls with it", "orange"), box_key("chance", "pale", 0.8)]
    return _ranked("correlation", names, Scale(-1.05, 1.05), marks, f"correlation with {label}", keys)


def _ranked(
    name: str, names: Sequence[str], scale: Scale, marks: Sequence[Mark], label: str, keys: Sequence[Key]
) -> Picture:  # fmt: skip
    width, left, tall = 540, 16 + names_width(names), ROW * len(names)
    zero = Line([0.0, 0.0], [0.0, tall], "ink", 0.9)
    panel = rows_panel((left, 20.0, width - left - RIGHT, tall), scale, names, (*marks, zero), label)
    return as_tall(name, f"Ranked: {label}", panel, keys, size=(width, 0.0))


def distributions(
    variants: Sequence[tuple[str, Array, Array]], nominal: float, limits: Sequence[float], span: Point, label: str
) -> Picture:  # fmt: skip
    """Draw the distribution of a number over the builds, as built and, where anything is adjusted, afterwards.

    Parameters
    ----------
    variants : sequence of (name, cuts, counts)
        Up to two; N + 1 cuts and N counts each.
    nominal, limits, label
        Of the number; the label with its unit.
    span : (low, high)
        Least and greatest value of the last variant.
    """
    marks: list[Mark] = []
    keys: list[Key] = []
    ends, top = [*limits], 0.0
    for (name, cuts, counts), filled in zip(variants, (True, False), strict=False):
        if not len(cuts):
            continue
        density = counts / counts.sum() / np.diff(cuts)
        x, y = stairs(cuts, density)
        marks.append(Area(x, y, "sky", 0.6) if filled else Line(x, y, "blue", 1.8))
        legend = f"{name}, {counts.sum():,.0f} builds"
        keys.append(box_key(legend, "sky", 0.6) if filled else line_key(legend, "blue", 1.8))
        ends += [float(cuts[0]), float(cuts[-1])]
        top = max(top, float(density.max()))
    reach = max([span[1] - span[0], *(abs(edge - nominal) for edge in limits)])
    low, high = min(ends, default=span[0]) - 0.1 * reach, max(ends, default=span[1]) + 0.1 * reach
    low, high = max(low, nominal - 1.5 * reach), min(high, nominal + 1.5 * reach)
    up = 1.08 * top or 1.0
    for edge in limits:
        marks += _limit(edge, 0.0, up, nominal)
    marks.append(Line([nominal, nominal], [0.0, up], "grey", 1.2, "6 3"))
    across = Scale(low, high) if high > low else Scale.around([nominal])
    panel = Panel((0, 0, 1, 1), across, Scale(0.0, up), tuple(marks), label, "share of builds per unit", grid="x")
    return one_panel("spread", f"Distribution of {label} over the builds", (500, 310), panel, keys, left=64, top=20)


def _limit(place: float, low: float, high: float, nominal: float) -> list[Mark]:
    """A limit's line, its name above it, on the side where nothing is allowed."""
    anchor, dx = ("start", -3.0) if place >= nominal else ("end", 3.0)
    line = Line([place, place], [low, high], "vermillion", 1.6)
    return [line, Text(place, high, "limit", "vermillion", SMALL, anchor, dx, -4.0)]


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
        dot_key("before", "ground", size=5, edge="grey", width=2), dot_key("found", "blue", size=6),
        dot_key("found, at its bound", "orange", size=6),
    ]  # fmt: skip
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
        losses = [top if kind == "bad" else 100 * max(end.loss, FLOOR) for end in own]
        if own:
            marks.append(replace(sign, x=[end.spent for end in own], y=losses))
        for end in own:
            if end.solver:
                loss = 100 * max(end.loss, FLOOR)
                marks.append(Text(end.spent, loss, end.solver, "grey", SMALL, "end", dy=-9, halo=True))
    keys = [Key(words, (replace(sign, x=(0.0,), y=(0.0,), testid=""),)) for words, sign in
            (SEARCHES[kind] for kind in ("start", "check", "bad"))]  # fmt: skip
    across = Scale(0.0, 1.05 * max((end.spent for end in ends), default=1))
    up = Scale(100 * FLOOR / 3, 3 * top, log=True)
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "evaluations so far [1]", "worse than the answer by [%]")
    same = sum(end.kind != "bad" and end.loss <= 1e-6 for end in ends)
    title = f"{same} of {len(ends)} searches ended at the answer"
    return one_panel("history", title, size, panel, keys, left=76)


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
    labels = [f"{goal.words} [{goal.unit}]" if goal.unit else goal.words for goal in goals]
    points = np.array(run.front, float).reshape(-1, 2)
    words = "" if len(points) > 1 else "the goals do not compete" if len(points) else "no design holds every limit"
    title = f"What {goals[0].label} costs of {goals[1].label}: {len(points)} designs"
    return goal_front(points, labels, title=title, size=size, words=words, also=(run.after,))


def goal_front(
    points: Array, labels: Sequence[str], *, log: Sequence[bool] = (False, False, False), title: str = "Goals",
    answer: Point | None = None, words: str = "", also: Sequence[float] = (), size: Point = (560, 360),
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
    words, also
        To write into the picture; abscissae that are to be on the axis.
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
        side, dx = ("end", -11.0) if float(x.share(answer[0])) > 0.7 else ("start", 11.0)
        marks.append(Text(*answer, "the optimum", "vermillion", SMALL, side, dx, 5, halo=True))
    panel = Panel((0, 0, 1, 1), x, y, tuple(marks), labels[0], labels[1])
    picture = one_panel("front", title, size, panel, left=64, right=80 if third else 18)
    (panel,) = picture.panels
    if words:
        left, top, width, _ = panel.box
        picture = replace(picture, remarks=(Text(left + width / 2, top + 18, words, "ink", PLAIN, "middle"),))
    if not third:
        return picture
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
    labels = "microlens position from the axis [mm]", "share of the stop's light [1]"
    panel = Panel((0, 0, 1, 1), Scale.around(field, 0.03), up, tuple(marks), *labels)
    return one_panel("bore", "Light through the bore and through its equivalent stop", (576, 310), panel, keys)


def robust_yields(rows: Sequence[tuple[str, float, float]]) -> Picture:
    """Draw the share of builds that hold each constraint: rows of name, share of the nominal, of the robust design."""
    width, each, names = 672, 38.0, [name for name, *_ in rows]
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
