"""What is said of a run: lines, README's table, a page."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from roslf_design.drawing.marks import Dots, Key, Line, Mark, dot_key, line_key
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.picture import Picture, legend_height
from roslf_design.drawing.theme import MANY

from . import yardstick
from .scaling import Growth, growth
from .turns import Row, Side, Spread

MARKS = ("<!-- speed: begin -->", "<!-- speed: end -->")
README_ROWS = (
    ("`roslf --help`; `evaluate paper`; `evaluate paper-singlet`", ("help", "evaluate", "evaluate-singlet")),
    (
        "`roslf render`: white, 4600 x 3080 px; checkerboard, 600 x 480 px; rays traced",
        ("render", "render-board", "rays"),
    ),
    ("`roslf depth paper`; the region above", ("depth", "depth-region")),
    (
        "`roslf tolerance`: rigid scope, 20,000 trials; the paper's bench, 200,000; trials alone, a core",
        ("tolerance-scope", "tolerance", "trials"),
    ),
    (
        "`roslf optimize`: rigid scope; `report paper --pdf`; the first five commands above, no kernel compiled",
        ("optimize", "report", "first-five"),
    ),
    ("Rays through a singlet, 1 thread", ("singlet",)),
    ("Monte Carlo of a singlet, every ray of every build traced, 1 thread", ("spots",)),
    (
        "Microlens centres of a white image, 1400 x 1000 px: images 0.7; 0.95 of the pitch",
        ("centres-hexagonal", "centres-square"),
    ),
    ("Disparity of every microlens, 1 thread", ("depth-plain",)),
)
"""README's rows, ten at most: what they say, and which rows of a run they join."""
SECTIONS = {
    "commands": "Commands, from start to exit",
    "rates": "Inside the commands",
    "peers": "Beside other programs",
    "scaling": "How time and memory grow",
}
BARS = "processor seconds of all threads, kernels compiled and bytecode written before"
CLUSTER = {"trials": 1e9, "cores": 100}
"""A study that is only computed."""
STYLE = (
    "body{margin:2rem auto;max-width:62rem;padding:0 1rem;font:1rem/1.5 system-ui,sans-serif;color:#1a1a1a;"
    "overflow-wrap:break-word}table,figure{display:block;overflow-x:auto;margin:0}table{border-collapse:collapse}"
    "th,td{text-align:left;vertical-align:top;min-width:6em;padding:.2rem .8rem .2rem 0;border-bottom:1px solid #ddd}"
    "@media screen and (prefers-color-scheme:dark){:root{color-scheme:dark}body{background:#171b21;color:#e6e9ed}"
    "th,td{border-color:#3d454d}}small{opacity:.8}"
)


def digits(value: float) -> str:
    """Two to three digits that count, thousands apart."""
    if value == 0:
        return "0"
    if abs(value) >= 100:
        size = 10 ** max(0, len(str(int(abs(value)))) - 3)
        return f"{round(value / size) * size:,.0f}"
    return f"{value:.3g}" if abs(value) >= 10 else f"{value:.2g}"


def amount(seconds: float, unit: str = "") -> str:
    """A time, or how many units are done in a second where a unit is given."""
    if unit:
        rate = 1 / seconds
        return f"{digits(rate / 1e6)} million {unit}/s" if rate >= 2e6 else f"{digits(rate)} {unit}/s"
    for name, size in (("min", 60.0), ("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size * (5 if name == "min" else 1):
            return f"{digits(seconds / size)} {name}"
    return f"{digits(seconds / 1e-9)} ns"


def spread(values: Spread, unit: str | None = None) -> str:
    """A median with its range; of ratios where `unit` is None."""
    low, middle, high = (
        digits(value) if unit is None else amount(value, unit) for value in (values.low, values.median, values.high)
    )
    return f"{middle} [{high}, {low}]" if unit else f"{middle} [{low}, {high}]"


def figure(row: Row) -> str:
    """Our median, and the bar that it meets or misses."""
    ours = row.sides[0]
    if not ours.seconds:
        return "failed"
    return " ".join(filter(None, (amount(ours.judged, row.unit), f"({bar(row)})" if row.bar else "")))


def bar(row: Row) -> str:
    """What a row is held to, and whether it meets it."""
    if row.bar is None:
        return ""
    least = f"at least {amount(1 / row.bar, row.unit)}" if row.unit else f"at most {row.bar:g} s"
    return least + {True: ": met", False: ": MISSED", None: ""}[row.met]


def beside(ours: Side, side: Side) -> str:
    """How many times as long another takes, and whether we lose; empty where runs make no pairs."""
    if not ours.seconds or len(ours.seconds) != len(side.seconds):
        return ""
    ratio = ours.ratio(side)
    return spread(ratio) + (", FASTER than here" if ratio.median < 1 else "")


def others(row: Row) -> list[str]:
    """How many times as long everyone else takes, or why that is not known; commands have only themselves."""
    if {side.label for side in row.sides} & {"warm", "cold"}:
        return [f"cold: {amount(side.judged)}" if side.seconds else f"cold: {side.fault}" for side in row.sides[1:]]
    return [
        f"{side.label}: {beside(row.sides[0], side) or side.fault or 'no pairs of runs'}"
        + (f" ({side.note.partition('; ')[2]})" if side.short else "")
        for side in row.sides[1:]
    ]


def line(row: Row) -> str:
    """A row for the terminal."""
    ours = row.sides[0]
    if row.name.startswith("scaling-"):
        return f"{row.title:72s} {grown(growth(row.sides))}"
    text = f"{spread(ours.each, row.unit)} {bar(row)}".rstrip() if ours.seconds else f"failed: {ours.fault}"
    used = [f"processor {amount(ours.judged)}"] if ours.processor and not row.unit else []
    return "; ".join([f"{row.title:72s} {text}", *used, *others(row)])


def comparison_line(row: Row) -> str:
    """Now and then for the terminal."""
    now, then = row.sides
    if not now.seconds or len(now.seconds) != len(then.seconds):
        return f"{row.title:72s} no ratio: " + "; ".join(f"{s.label}: {s.fault}" for s in row.sides if s.fault)
    ratio = then.ratio(now)
    verdict = "as fast, as far as can be seen"
    if ratio.runs >= 3 and not ratio.low <= 1 <= ratio.high:
        verdict = "faster" if ratio.high < 1 else "SLOWER"
    return f"{row.title:72s} {amount(now.each.median):>8s}, now/then {spread(ratio)} of {ratio.runs}  {verdict}"


def heading(machine: Mapping[str, Any]) -> str:
    """Where and when, and how fast that machine then was."""
    return (
        f"{machine['processor']}, {machine['cores']} cores, {machine['date']}, Python {machine['python']}, "
        f"numpy {machine['numpy']}, revision {machine['revision']}.{yardstick.sentence(machine.get('yardstick', {}))}"
    )


def readme_table(rows: Sequence[Row], machine: Mapping[str, Any]) -> str:
    """Markdown: ten rows at most; what was not run is left out."""
    known = {row.name: row for row in rows}
    lines = [
        heading(machine),
        "",
        "| what, processor time of commands | here | cold; others: times as long [range] |",
        "|---|---|---|",
    ]
    for text, names in README_ROWS:
        joined = [known[name] for name in names if name in known]
        if len(joined) == len(names):
            words = "; ".join(other for row in joined for other in others(row))
            lines.append(f"| {text} | {'; '.join(map(figure, joined))} | {words} |")
    return "\n".join(lines) + "\n"


def with_table(readme: str, table: str) -> str:
    """README with the table between its marks.

    Raises
    ------
    ValueError
        The marks are not there, once each and in order.
    """
    begin, end = MARKS
    if not re.fullmatch(rf"(?s)(?!.*{begin}.*{begin}).*{begin}(?!.*{end}.*{end}).*{end}.*", readme):
        raise ValueError(f"README needs {begin} and {end}, once each")
    return f"{readme.split(begin)[0]}{begin}\n{table}{end}{readme.split(end)[1]}"


def page(parts: Mapping[str, Sequence[Row]], machine: Mapping[str, Any]) -> str:
    """Everything, as one HTML file."""
    text = [
        '<!DOCTYPE html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Benchmarks</title><style>{STYLE}</style>",
        f"<h1>Benchmarks</h1><p>{html.escape(heading(machine))} Load {machine['load']} before. Medians, with the range",
        "of all runs. Other programs run in turn with this one, one thread each, in processor time",
        "(beside each its ratio to the wall's: above 1, more threads were at work), once their answers agree, or with",
        "what they fall short in; ratios are of pairs of runs that followed each other. Where another is faster, or a",
        "bar is missed, it says so.</p>",
    ]
    for key, rows in parts.items():
        text.append(f"<h2>{SECTIONS[key]}</h2>")
        if key == "commands":
            text += _commands(rows)
        elif key == "scaling":
            text += _scaling(rows, [row for row in parts.get("rates", ()) if row.name == "trials"])
        else:
            text.append("<table><tr><th>what<th>who<th>median [range]<th>times as long<th>runs")
            text += [_table_row(row, index, side) for row in rows for index, side in enumerate(row.sides)]
            text.append("</table>")
    return "\n".join(text) + "\n"


def _cells(*cells: str) -> str:
    return "<tr><td>" + "<td>".join(html.escape(cell) for cell in cells)


def _commands(rows: Sequence[Row]) -> list[str]:
    text = [
        f"<p>Bars are of {BARS}. Cold: once, in a process that has to compile its kernels anew.</p>",
        "<table><tr><th>what<th>warm: processor<th>bar<th>warm: wall<th>cold: processor (wall)<th>most memory<th>runs",
    ]
    for row in rows:
        late = [side for side in row.sides if side.label == "cold"]
        warm = next((side for side in row.sides if side.label != "cold"), Side("warm"))
        busy = spread(Spread.of(warm.processor), "") if warm.processor else warm.fault
        wall = spread(warm.each, "") if warm.seconds else ""
        first = "; ".join(f"{amount(s.judged)} ({amount(s.seconds[0])})" if s.seconds else s.fault for s in late)
        peak = max((side.peak for side in row.sides if side.peak is not None), default=None)
        memory, what = f"{digits(peak)} MB" if peak else "", f"{row.title}. {row.note}" if row.note else row.title
        text.append(_cells(what, busy, bar(row), wall, first, memory, str(len(row.sides[0].seconds))))
    return [*text, "</table>"]


def grown(found: Growth | None) -> str:
    """How time grows, and whether faster than the size."""
    if found is None:
        return "too few sizes"
    error = f" ± {found.error:.2f}" if math.isfinite(found.error) else ""
    words = f"size^({found.exponent:.2f}{error}), between the two largest {found.at_end:.2f}"
    return words + (": FASTER than the size" if found.faster else "")


def _scaling(rows: Sequence[Row], trials: Sequence[Row]) -> list[str]:
    text = [
        "<p>Processor time of the work alone, all threads, in a process that did a small size before; memory of",
        "the whole process. Exponents of time over size by a line through logarithms, with its standard error, and",
        "between the two largest sizes.</p>",
        f"<figure>{growth_picture(rows).svg()}</figure>"
        if any(side.processor for row in rows for side in row.sides)
        else "",
        "<table><tr><th>what<th>size: processor time<th>grows as<th>most memory, smallest to largest",
    ]
    for row in rows:
        sizes = [f"{side.label}: {amount(side.processor[0]) if side.processor else side.fault}" for side in row.sides]
        peaks = [f"{digits(side.peak)} MB" for side in row.sides if side.peak is not None]
        ends = " to ".join(peaks[:: max(1, len(peaks) - 1)])
        text.append(_cells(f"{row.title} ({row.unit})", "; ".join(sizes), grown(growth(row.sides)), ends))
    text.append("</table>")
    steep = [row.title for row in rows if (found := growth(row.sides)) is not None and found.faster]
    text.append(f"<p>Faster than their size grow: {html.escape('; '.join(steep)) or 'none'}.</p>")
    for row in trials:
        if row.sides[0].seconds:
            rate, cores = 1 / row.sides[0].judged, CLUSTER["cores"]
            text.append(
                f"<p>Computed, not measured: {CLUSTER['trials']:.0e} trials by Dask on {cores:g} cores take "
                f"{amount(CLUSTER['trials'] / rate / cores)}, at the {digits(rate)} trials/s that one core did here "
                f"({html.escape(row.title)}) times {cores:g}; sending and merging chunks is left out.</p>"
            )
    return text


def growth_picture(rows: Sequence[Row]) -> Picture:
    """Processor time over size, both by their logarithms; colours are told apart with any colour vision, signs too."""
    marks: list[Mark] = []
    keys: list[Key] = []
    every = [(side.count, side.processor[0]) for row in rows for side in row.sides if side.processor and side.count > 0]
    (left, right), (low, high) = ((min(values) / 2, max(values) * 2) for values in zip(*every, strict=True))
    guides = (np.array([left, right]) * 10.0**decade for decade in range(-9, 4))
    marks += [Line([left, right], guide, "grey", 0.7, "4 4") for guide in guides]
    keys.append(line_key("as the size", "grey", dash="4 4"))
    for row, colour, shape in zip(rows, (*MANY, *MANY), "osD^v<>*xo+|sD", strict=False):
        points = [(side.count, side.processor[0]) for side in row.sides if side.processor and side.count > 0]
        if points:
            x, y = zip(*points, strict=True)
            marks += [Line(x, y, colour), Dots(x, y, colour, shape)]
            keys.append(dot_key(f"{row.title} [{row.unit}]", colour, shape))
    panel = Panel(
        (64.0, 14.0, 680.0, 420.0), Scale(left, right, True), Scale(low, high, True), tuple(marks),
        "size: trials, pixels, microlenses, boards, elements, factors", "processor time [s]",
    )  # fmt: skip
    height = 490.0 + legend_height(keys, 740.0)
    return Picture("growth", "Processor time over size", (768.0, height), (panel,), tuple(keys), (14.0, 482.0, 740.0))


def _table_row(row: Row, index: int, side: Side) -> str:
    title = f"{html.escape(row.title)}<br><small>{html.escape(row.note)}</small>" if index == 0 else ""
    time = spread(side.each, row.unit) if side.seconds else side.fault
    ours = row.sides[0]
    ratio = beside(ours, side) if index else bar(row)
    note = ". ".join(filter(None, (side.note, side.short and f"Falls short: {side.short}")))
    cells = (html.escape(side.label), html.escape(time) + f"<br><small>{html.escape(note)}</small>", ratio)
    return f"<tr><td>{title}<td>" + "<td>".join(cells) + f"<td>{len(side.seconds)}"
