"""What is said of a run: lines, README's table, a page."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from typing import Any

from .turns import Row, Side, Spread

MARKS = ("<!-- speed: begin -->", "<!-- speed: end -->")
README_ROWS = (
    ("`roslf --help`; `evaluate paper`; `evaluate paper-singlet`", ("help", "evaluate", "evaluate-singlet")),
    ("`roslf render paper`, white, 4600 x 3080 px: square; hexagonal array", ("render", "render-hexagonal")),
    ("`roslf render`, checkerboard, 600 x 480 px; rays traced inside", ("render-board", "rays")),
    (
        "`roslf tolerance`, 200,000 trials: as built; focused and calibrated; trials alone, a core's processor time",
        ("tolerance", "tolerance-adjusted", "trials", "trials-adjusted"),
    ),
    (
        "`roslf optimize`: rigid scope; ear speculum with bought parts; bought real lenses, traced",
        ("optimize", "optimize-parts", "optimize-lens"),
    ),
    ("`roslf report paper --pdf`; explorer, slider to new pictures", ("report", "slider")),
    ("Rays through a singlet, 1 thread", ("singlet",)),
    ("Monte Carlo of a singlet, every ray of every build traced, 1 thread", ("spots",)),
    ("Refocus distance, baseline, entrance pupil", ("geometry",)),
    ("Microlens centres of a white image, 1400 x 1000 px", ("centres-hexagonal",)),
)
"""README's rows, ten at most: what they say, and which rows of a run they join."""
SECTIONS = {
    "commands": "Commands, from start to exit",
    "rates": "Inside the commands",
    "bore": "Behind three elements, beside the camera in air that sees the same through the same openings",
    "peers": "Beside other programs",
}
STYLE = (
    "body{margin:2rem auto;max-width:62rem;padding:0 1rem;font:1rem/1.5 system-ui,sans-serif;color:#1a1a1a}"
    "table{border-collapse:collapse;width:100%}th,td{text-align:left;vertical-align:top;padding:.2rem .8rem .2rem 0;"
    "border-bottom:1px solid #ddd}small{color:#555}"
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
    """Our median."""
    ours = row.sides[0]
    return amount(ours.each.median, row.unit) if ours.seconds else "failed"


def others(row: Row) -> list[str]:
    """How many times as long everyone else takes, or why that is not known."""
    ours = row.sides[0]
    return [
        f"{side.label}: {spread(ours.ratio(side))}"
        if ours.seconds and side.seconds and len(ours.seconds) == len(side.seconds)
        else f"{side.label}: {side.fault or 'no pairs of runs'}"
        for side in row.sides[1:]
    ]


def line(row: Row) -> str:
    """A row for the terminal."""
    ours = row.sides[0]
    text = spread(ours.each, row.unit) if ours.seconds else f"failed: {ours.fault}"
    return "; ".join([f"{row.title:72s} {text}", *others(row)])


def comparison_line(row: Row) -> str:
    """Now and then for the terminal."""
    now, then = row.sides
    if not now.seconds or len(now.seconds) != len(then.seconds):
        return f"{row.title:72s} no ratio: " + "; ".join(f"{s.label}: {s.fault}" for s in row.sides if s.fault)
    ratio = then.ratio(now)
    verdict = "as fast, as far as can be told"
    if ratio.runs >= 3 and not ratio.low <= 1 <= ratio.high:
        verdict = "faster" if ratio.high < 1 else "SLOWER"
    return f"{row.title:72s} {figure(row):>8s}, now/then {spread(ratio)} of {ratio.runs}  {verdict}"


def heading(machine: Mapping[str, Any]) -> str:
    """Where and when."""
    return (
        f"{machine['processor']}, {machine['cores']} cores, {machine['date']}, Python {machine['python']}, "
        f"numpy {machine['numpy']}, revision {machine['revision']}."
    )


def readme_table(rows: Sequence[Row], machine: Mapping[str, Any]) -> str:
    """Markdown: ten rows at most; what was not run is left out."""
    known = {row.name: row for row in rows}
    lines = [heading(machine), "", "| what | here | others: times as long [range] |", "|---|---|---|"]
    for text, names in README_ROWS:
        joined = [known[name] for name in names if name in known]
        if len(joined) == len(names):
            beside = "; ".join(other for row in joined for other in others(row))
            lines.append(f"| {text} | {'; '.join(map(figure, joined))} | {beside} |")
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
        f'<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>Benchmarks</title><style>{STYLE}</style>',
        f"<h1>Benchmarks</h1><p>{html.escape(heading(machine))} Load {machine['load']} before. Medians, with the range",
        "of all runs. Other programs run in turn with this one, one thread each, once their answers agree;",
        "ratios are of pairs of runs that followed each other.</p>",
    ]
    for key, rows in parts.items():
        text.append(f"<h2>{SECTIONS[key]}</h2><table><tr><th>what<th>who<th>median [range]<th>times as long<th>runs")
        for row in rows:
            for index, side in enumerate(row.sides):
                text.append(_table_row(row, index, side))
        text.append("</table>")
    return "\n".join(text) + "\n"


def _table_row(row: Row, index: int, side: Side) -> str:
    title = f"{html.escape(row.title)}<br><small>{html.escape(row.note)}</small>" if index == 0 else ""
    time = spread(side.each, row.unit) if side.seconds else side.fault
    ours = row.sides[0]
    ratio = spread(ours.ratio(side)) if index and side.seconds and len(side.seconds) == len(ours.seconds) else ""
    cells = (html.escape(side.label), html.escape(time) + f"<br><small>{html.escape(side.note)}</small>", ratio)
    return f"<tr><td>{title}<td>" + "<td>".join(cells) + f"<td>{len(side.seconds)}"
