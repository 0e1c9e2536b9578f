"""What a tolerance run found: yield by grade and by scale, what spoils builds, how limited numbers scatter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .axes import Picture, Plot, Scale, frame
from .svg import PLAIN, SMALL, clipped, document, line, path, path_of, plated, short, tag, text, text_width
from .theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ..runs import LimitSpread, Offender, Share, ToleranceResult

ROW = 24.0
"""Height of a bar's row, its text beside it [px]."""
TALL_ROW = 36.0
"""The same with the text above the bar [px]."""
SIDE = 14.0
"""Margin on either side of bars with their text above [px]."""
RIGHT, BELOW = 16.0, 42.0
"""Margins [px]."""
LARGEST = 3.0
"""Times the way to the limit beyond which bars are cut off."""


def yield_bars(found: ToleranceResult, theme: ThemeName = "light", size: tuple[float, float] = (420, 170)) -> Picture:
    """Draw the yield of every grade with its 95 % interval; that of the run itself stands out.

    Parameters
    ----------
    found : ToleranceResult
    theme : {"light", "dark"}
    size : (width, height)
        [px]; the picture may be higher, so that its rows are legible.
    """
    colours = theme_named(theme)
    rows = [(f"{name} grade", share, name == found.grade) for name, share in found.grades]
    rows = [(name, found.share if own else share, own) for name, share, own in rows]
    left = 14 + 1.1 * max(text_width(name, SMALL) for name, _, _ in rows)
    plot = Plot(left, 12, max(size[0] - left - RIGHT - 60, 80.0), ROW * len(rows), Scale(0, 100), Scale(0, 1))
    parts = [_percent_axis(plot, colours, "builds that hold every limit [%]")]
    for k, (name, share, own) in enumerate(rows):
        y = plot.top + k * ROW
        x, _ = plot.at(100 * share.value, 0)
        hue, testid = colours.blue if own else colours.pale, f"yield-{name.split()[0]}"
        bar = tag("rect", x=left, y=y + 4, width=max(x - left, 0.0), height=ROW - 8, fill=hue, data_testid=testid)
        parts += [bar, _whisker(plot, share, y + ROW / 2, colours)]
        parts.append(text((left - 7, y + ROW / 2 + 4), name, colours.ink, SMALL, "end", bold=own))
        beside = plot.at(100 * share.high, 0)[0] + 8
        parts.append(text((beside, y + ROW / 2 + 4), f"{100 * share.value:.1f} %", colours.ink, SMALL, bold=own))
    title = f"Yield of {100 * found.share.value:.1f} % to the grade {found.grade}, from {found.trials} builds"
    return Picture(document("yield", title, (size[0], max(size[1], plot.bottom + BELOW)), colours, parts))


def yield_curve(found: ToleranceResult, theme: ThemeName = "light", size: tuple[float, float] = (420, 240)) -> Picture:
    """Draw the yield over a common factor on all tolerances; parameters as `yield_bars`."""
    colours = theme_named(theme)
    scales = [scale for scale, _ in found.curve]
    plot = Plot(
        56, 14, max(size[0] - 56 - RIGHT, 80.0), max(size[1] - 14 - BELOW, 60.0),
        Scale(min(scales), max(scales), log=True), Scale(0, 105),
    )  # fmt: skip
    points = [plot.at(scale, 100 * share.value) for scale, share in found.curve]
    band = [plot.at(scale, 100 * share.high) for scale, share in found.curve]
    band += [plot.at(scale, 100 * share.low) for scale, share in reversed(found.curve)]
    one, _ = plot.at(1.0, 0.0)
    inside = path(path_of(band, closed=True), fill=colours.blue, fill_opacity=0.22)
    inside += line((one, plot.top), (one, plot.bottom), colours.grey, 1.2, dash="6 3")
    inside += path(path_of(points), colours.blue, 2.2, data_testid="yield-curve")
    dots = "".join(tag("circle", cx=x, cy=y, r=3.5, fill=colours.blue) for x, y in points)
    body = [
        frame(plot, colours, f"all tolerances of the grade {found.grade}, times", "yield [%]", x_ticks=scales),
        clipped("yield-curve-window", plot.box, inside),
        dots,
    ]
    title = "Yield over a common factor on all tolerances: " + ", ".join(
        f"{100 * share.value:.0f} % at {scale:g}" for scale, share in found.curve
    )
    return Picture(document("yield-curve", title, size, colours, body))


def offender_bars(
    offenders: Sequence[Offender], theme: ThemeName = "light", size: tuple[float, float] = (560, 300), *, most: int = 8
) -> Picture:
    """Draw what each tolerance alone uses of the limits, worst first; parameters as `yield_bars`.

    Parameters
    ----------
    offenders : sequence of Offender
        ``ToleranceResult.offenders``.
    theme, size
        As for `yield_bars`.
    most : int
        How many are shown.
    """
    colours, shown = theme_named(theme), [row for row in offenders if row.used > 1e-3][:most]
    high = min(max([1.0, *(row.used for row in shown)]) * 1.05, LARGEST)
    width = max(size[0] - 2 * SIDE, 100.0)
    plot = Plot(SIDE, 24, width, TALL_ROW * max(len(shown), 1), Scale(0, 100 * high), Scale(0, 1))
    parts = [_percent_axis(plot, colours, "part of the way to a limit that it uses alone [%]")]
    for k, row in enumerate(shown):
        y, hue = plot.top + k * TALL_ROW, colours.vermillion if row.used > 1 else colours.blue
        x, _ = plot.at(100 * min(row.used, high), 0)
        bar = {"fill": hue, "data_testid": f"offender-{k}"}
        parts.append(tag("rect", x=SIDE, y=y + 20, width=x - SIDE, height=10, **bar))
        if row.used > high:  # cut off
            parts.append(path(f"M{x - 11:.1f},{y + 18:.1f}l-6,14h4l6,-14Z", fill=colours.ground))
    limit, _ = plot.at(100.0, 0)
    parts.append(line((limit, plot.top - 4), (limit, plot.bottom), colours.orange, 2))
    parts.append(text((limit, plot.top - 9), "limit", colours.orange, SMALL, "middle", bold=True))
    told = []
    for k, row in enumerate(shown):
        y, name = plot.top + k * TALL_ROW + 14, f"{row.place} ±{row.tolerance}"
        note = next((note for note in _used(row) if text_width(f"{name} {note}", SMALL) + 12 < width), _used(row)[-1])
        parts.append(plated((SIDE, y), name, colours.ink, colours.ground))
        parts.append(plated((plot.right, y), note, colours.ink, colours.ground, anchor="end"))
        told.append(f"{name} uses {_used(row)[0]}")
    if not shown:
        parts.append(text((size[0] / 2, plot.top + 16), "no tolerance matters", colours.ink, PLAIN, "middle"))
    title = f"Worst offenders: {'; '.join(told)}"
    return Picture(document("offenders", title, (size[0], max(size[1], plot.bottom + BELOW)), colours, parts))


def spread_bars(
    spreads: Sequence[LimitSpread], theme: ThemeName = "light", size: tuple[float, float] = (560, 300)
) -> Picture:
    """Draw how limited numbers scatter: 5th to 95th percentile on the way from nominal (0) to the limits (100 %).

    Parameters
    ----------
    spreads : sequence of LimitSpread
        ``ToleranceResult.spreads``.
    theme, size
        As for `yield_bars`.
    """
    colours = theme_named(theme)
    rows = [(row.label, *_ends(row)) for row in spreads]
    left = 14 + max((text_width(name, SMALL) for name, *_ in rows), default=40.0)
    reach = max([1.15, *(abs(end) for _, *ends in rows for end in ends if math.isfinite(end))])
    reach = min(reach * 1.05, LARGEST)
    plot = Plot(
        left,
        24,
        max(size[0] - left - RIGHT, 100.0),
        ROW * max(len(rows), 1),
        Scale(-100 * reach, 100 * reach),
        Scale(0, 1),
    )
    parts = [_percent_axis(plot, colours, "way from nominal to limit: 90 % of builds [%]")]
    parts.append(line(plot.at(0, 0), (plot.at(0, 0)[0], plot.top), colours.grey, 1.2))
    for k, (name, low, high) in enumerate(rows):
        y = plot.top + k * ROW
        a, b = (plot.at(100 * min(max(end, -reach), reach), 0)[0] for end in (low, high))
        worst = max(abs(low), abs(high))
        parts.append(
            tag("rect", x=a, y=y + 6, width=max(b - a, 1.5), height=ROW - 12, rx=2,
                fill=colours.vermillion if worst > 1 else colours.blue, data_testid=f"spread-{k}")
        )  # fmt: skip
        parts.append(text((left - 7, y + ROW / 2 + 4), name, colours.ink, SMALL, "end"))
    ends = [plot.at(100.0 * sign, 0)[0] for sign in (-1, 1)]
    parts += [line((x, plot.top - 4), (x, plot.bottom), colours.orange, 2) for x in ends]
    apart = ends[1] - ends[0] > text_width("lower limit", SMALL) + 16
    marks = [(ends[0], "lower limit"), (ends[1], "upper limit")] if apart else [(sum(ends) / 2, "limits")]
    edge = size[0] - 0.55 * text_width("upper limit", SMALL) - 2
    parts += [text((min(x, edge), plot.top - 9), told, colours.orange, SMALL, "middle", bold=True) for x, told in marks]
    title = f"Scatter of {len(rows)} limited numbers over the builds, as shares of the way from nominal to their limits"
    return Picture(document("spread", title, (size[0], max(size[1], plot.bottom + BELOW)), colours, parts))


def _ends(row: LimitSpread) -> tuple[float, float]:
    """Percentiles as shares of the way to the limit on their side; of the other limit's where there is none."""
    above, below = row.limit_high - row.nominal, row.nominal - row.limit_low

    def share(value: float) -> float:
        way = value - row.nominal
        room = (above if math.isfinite(above) else below) if way > 0 else (below if math.isfinite(below) else above)
        if way == 0 or math.isnan(way):
            return 0.0
        return way / room if room > 0 else math.copysign(math.inf, way)

    return share(row.low), share(row.high)


def _used(row: Offender) -> tuple[str, ...]:
    """What it uses of which limit, from long to short."""
    label = row.limited_by.split(",")[0]
    if math.isinf(row.used):
        return f"{row.limited_by} undefined", f"{label} undefined", "undefined"
    part = f"{short(100 * row.used, 2)} %"
    return f"{part}: {row.limited_by}", f"{part}: {label}", part


def _percent_axis(plot: Plot, theme: Theme, label: str) -> str:
    parts = []
    for value in plot.x.ticks(max(2, int(plot.width / 64))):
        x, _ = plot.at(value, 0)
        parts.append(line((x, plot.top), (x, plot.bottom), theme.grid))
        parts.append(text((x, plot.bottom + 16), short(value), theme.ink, SMALL, "middle"))
    parts.append(line((plot.left, plot.bottom), (plot.right, plot.bottom), theme.grey))
    half = text_width(label, PLAIN) / 2
    # Long labels end where the plot does.
    middle = min(plot.left + plot.width / 2, max(plot.right + RIGHT / 2 - half, half + 4))
    parts.append(text((middle, plot.bottom + 33), label, theme.ink, PLAIN, "middle"))
    return "".join(parts)


def _whisker(plot: Plot, share: Share, y: float, theme: Theme) -> str:
    (a, _), (b, _) = plot.at(100 * share.low, 0), plot.at(100 * share.high, 0)
    ends = "".join(line((x, y - 4), (x, y + 4), theme.ink, 1.4) for x in (a, b))
    return line((a, y), (b, y), theme.ink, 1.4) + ends
