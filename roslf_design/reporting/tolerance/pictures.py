"""Drawings of a tolerance run: yields, what spoils builds and how numbers scatter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._arrays import Array
from ...drawing.marks import Area, Dots, Key, Line, Mark, Point, Text, bars, box_key, line_key, stairs
from ...drawing.panel import Panel, Scale, named_ticks, names_width, rows_panel, threshold
from ...drawing.picture import Picture, as_tall, notice, one_panel
from ...drawing.theme import PLAIN, SMALL, short, text_width
from ...tolerancing.yields import Yield

ROW = 24.0
"""Height of a bar's row, its text beside it [px]."""
TALL_ROW = 36.0
"""Height of a bar's row, its text above it [px]."""
SIDE = 14.0
"""Margin on either side of bars with their text above [px]."""
RIGHT = 16.0
"""Margin [px]."""
LARGEST = 3.0
"""Times the way to the limit beyond which bars are cut off."""


@dataclass(frozen=True)
class Yields:
    """Yields of a run."""

    grade: str
    share: Yield
    """Yield of the run itself."""
    grades: tuple[tuple[str, Yield], ...]
    curve: tuple[tuple[float, Yield], ...]
    """Yield over a common factor on all tolerances."""


@dataclass(frozen=True)
class Offender:
    """Effect of one tolerance alone, at its end."""

    place: str
    """Place in the design, in words."""
    tolerance: str
    """Half-width with its unit."""
    used: float
    """Largest part of the way from nominal to any limit; above 1 it breaks the limit by itself, inf where the build
    loses a number that is limited."""
    limited_by: str

    @property
    def notes(self) -> tuple[str, ...]:
        """Words for the part of which limit it uses, from long to short."""
        label = self.limited_by.split(",")[0]
        if math.isinf(self.used):
            return f"{self.limited_by} undefined", f"{label} undefined", "undefined"
        part = f"{short(100 * self.used, 2)} %"
        return f"{part}: {self.limited_by}", f"{part}: {label}", part


@dataclass(frozen=True)
class LimitSpread:
    """Scatter of one limited number over the builds."""

    label: str
    nominal: float
    low: float
    high: float
    """5th and 95th percentile."""
    limit_low: float
    limit_high: float

    @property
    def ways(self) -> tuple[float, float]:
        """Percentiles as shares of the way to the limit on their side; of the other limit's where there is none."""
        above, below = self.limit_high - self.nominal, self.nominal - self.limit_low

        def share(value: float) -> float:
            way = value - self.nominal
            room = (above if math.isfinite(above) else below) if way > 0 else (below if math.isfinite(below) else above)
            if way == 0 or math.isnan(way):
                return 0.0
            return way / room if room > 0 else math.copysign(math.inf, way)

        return share(self.low), share(self.high)


def yield_bars(result: Yields, size: Point = (420, 170), target: float | None = None) -> Picture:
    """Draw the yield of every grade with its 95 % interval; that of the run itself stands out.

    `size` [px] is the least: rows stay legible. `target` is the target yield, marked by a line.
    """
    shares = [result.share if name == result.grade else share for name, share in result.grades]
    names = [f"{name} grade" for name, _ in result.grades]
    marks: list[Mark] = []
    for k, ((name, _), share) in enumerate(zip(result.grades, shares, strict=True)):
        at, own = ROW * (k + 0.5), name == result.grade
        marks.append(bars(0.0, 100 * share.value, at, ROW - 8, fill="blue" if own else "pale", testid=f"yield-{name}"))
        marks.append(Line([100 * end for end in share.interval], [at, at], "ink", 1.4, ends="|"))
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


def _builds(shares: Sequence[Yield]) -> str:
    """How many builds lie behind shares, fewest and most."""
    counts = sorted({share.trials for share in shares})
    return " to ".join(f"{count:,}" for count in dict.fromkeys((counts[0], counts[-1])))


def yield_curve(
    result: Yields, size: Point = (420, 240), target: float | None = None, reached: float | None = None
) -> Picture:
    """Draw the yield over a common factor on all tolerances, with its interval, the target and what factor meets it."""
    scales = np.array([scale for scale, _ in result.curve])
    value, low, high = 100 * np.array([(share.value, *share.interval) for _, share in result.curve]).T
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
            at, words = min(max(reached, least), most), f"{100 * target:.3g} % at {reached:.3g} times"
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
        name, notes = f"{row.place} ±{row.tolerance}", row.notes
        note = next((note for note in notes if text_width(f"{name} {note}", SMALL) + 16 < width), notes[-1])
        words.append(Text(0.0, y + 14, name, dx=4, plate=True))
        words.append(Text(100 * high, y + 14, note, anchor="end", plate=True))
        descriptions.append(f"{name} uses {notes[0]}")
    marks += [*threshold(100.0, tall, "limit"), *words]
    if not shown:
        marks.append(Text(50 * high, 16.0, "no tolerance matters", "ink", PLAIN, "middle"))
    label = "part of the way to a limit that it uses alone [%]"
    panel = rows_panel((SIDE, 24, width, tall), Scale(0, 100 * high), (), marks, label)
    return as_tall("offenders", f"Worst offenders: {'; '.join(descriptions)}", panel, size=size)


def spread_bars(spreads: Sequence[LimitSpread], size: Point = (560, 300)) -> Picture:
    """Draw how limited numbers scatter: 5th to 95th percentile on the way from nominal (0) to the limits (100 %).

    `size` [px] is the least: rows stay legible.
    """
    names, ways = [row.label for row in spreads], [row.ways for row in spreads]
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


def ranked_moves(names: Sequence[str], plus: Array, minus: Array, limits: Sequence[float], label: str) -> Picture:
    """Draw how far each perturbation alone moves a number, ranked, at both ends of its tolerance.

    `plus` and `minus` have shape (N,) for N `names`; `limits` are moves that reach a limit, drawn where they are near;
    `label` is the number's, with its unit.
    """
    reach = float(np.abs([plus, minus]).max(initial=0.0))
    if reach == 0:
        return notice("sensitivity", f"No tolerance alone moves {label}.", (540, 60))
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
    if not (np.abs(values) > noise).any():
        words = (
            f"No single tolerance goes with {label} beyond what chance alone gives (within ± {noise:.2g}): "
            "what moves it does so alike both ways, as decentres do, or together with others."
        )
        return notice("correlation", words, (540, 60))
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
    variants: Sequence[tuple[str, Array, Array]], nominal: float, limits: Sequence[float], label: str
) -> Picture:
    """Draw the distribution of a number over the builds, as built and, where anything is adjusted, afterwards.

    Parameters
    ----------
    variants : sequence of (name, cuts, counts)
        Up to two; N + 1 cuts and N counts each. First and last steps much wider than the others hold few builds far
        off: the axis leaves them out, and the legend counts them.
    nominal, limits, label
        Of the number; the label with its unit.
    """
    known = [(*one, filled) for one, filled in zip(variants, (True, False), strict=False) if len(one[1])]
    if not known:
        return notice("spread", f"No build differs from another in {label}.", (500, 60))
    spans = [_middle(cuts) for _, cuts, _, _ in known]
    reach = max([spans[-1][1] - spans[-1][0], *(abs(edge - nominal) for edge in limits)])
    ends = [*limits, *np.ravel(spans)]
    low, high = max(min(ends) - 0.1 * reach, nominal - 1.5 * reach), min(max(ends) + 0.1 * reach, nominal + 1.5 * reach)
    marks: list[Mark] = []
    keys: list[Key] = []
    top = 0.0
    for name, cuts, counts, filled in known:
        density = counts / counts.sum() / np.diff(cuts)
        x, y = stairs(cuts, density)
        marks.append(Area(x, y, "sky", 0.6) if filled else Line(x, y, "blue", 1.8))
        within = np.diff(np.interp([low, high], cuts, np.concatenate([[0.0], np.cumsum(counts)])))[0]
        beyond = round(float(counts.sum() - within))
        legend = f"{name}, {counts.sum():,.0f} builds" + f", {beyond:,} of them beyond the axis" * (beyond > 0)
        keys.append(box_key(legend, "sky", 0.6) if filled else line_key(legend, "blue", 1.8))
        top = max(top, float(density.max()))
    up = 1.08 * top or 1.0
    for edge in limits:
        marks += _limit(edge, 0.0, up, nominal)
    marks.append(Line([nominal, nominal], [0.0, up], "grey", 1.2, "6 3"))
    across = Scale(low, high) if high > low else Scale.around([nominal])
    panel = Panel((0, 0, 1, 1), across, Scale(0.0, up), tuple(marks), label, "share of builds per unit", grid="x")
    return one_panel("spread", f"Distribution of {label} over the builds", (500, 310), panel, keys, left=64, top=20)


def _middle(cuts: Array) -> tuple[float, float]:
    """Ends of a histogram without first and last steps that are much wider than the others."""
    even = np.flatnonzero(np.diff(cuts) <= 1.5 * np.median(np.diff(cuts)))
    return float(cuts[even[0]]), float(cuts[even[-1] + 1])


def _limit(place: float, low: float, high: float, nominal: float) -> list[Mark]:
    """A limit's line, its name above it, on the side where nothing is allowed."""
    anchor, dx = ("start", -3.0) if place >= nominal else ("end", 3.0)
    line = Line([place, place], [low, high], "vermillion", 1.6)
    return [line, Text(place, high, "limit", "vermillion", SMALL, anchor, dx, -4.0)]
