"""The gallery: instruments that others built, published numbers beside what the program predicts from their designs.

Run from the project's root: python studies/instruments/gallery.py [-o FOLDER] [--only NAME].
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from string import ascii_lowercase

from roslf_design.drawing.marks import Area, Dots, Line, Mark, Text, box_key, dot_key
from roslf_design.drawing.panel import Panel, Scale, named_ticks
from roslf_design.drawing.picture import PAGE, Picture, one_panel
from roslf_design.errors import InputError
from roslf_design.json_data import plain
from roslf_design.reporting.blocks import (
    Block,
    Bullets,
    Code,
    Figure,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
)
from roslf_design.reporting.printers import render_html
from studies.instruments.entries import CLOSE, FAR, HERE, NEAR, SUBJECTS, SUFFIX, Instrument, Pictures, Row, Subject

OUT, NUMBERS = Path("reports/instruments"), "instruments.json"
LOOKS: dict[Subject, tuple[str, str]] = {
    "lengths": ("grey", "s"), "images": ("blue", "o"), "field": ("green", "^"), "refocusing": ("orange", "D"),
    "depth": ("vermillion", "v"),
}  # fmt: skip
"""Colour and shape of each subject's dots."""
ENDS = (0.2, 5.0)
"""Ratios that the picture shows at least."""
LONG_WORD = 18
"""Letters beyond which a word may be broken."""
LINE, STACK, DOT = 34.0, 10.0, 3.6
"""Height of an instrument's line with one layer of dots, of a further layer, and a dot's radius [px]."""


# --- picture ----------------------------------------------------------------------------------------------------------


def layers(places: Sequence[float], apart: float) -> list[int]:
    """Layer of each dot on a line, the lowest in which no other is nearer than `apart`."""
    taken: list[list[float]] = []
    found = []
    for place in places:
        free = (k for k, layer in enumerate(taken) if all(abs(place - other) >= apart for other in layer))
        layer = next(free, len(taken))
        if layer == len(taken):
            taken.append([])
        taken[layer].append(place)
        found.append(layer)
    return found


def missed(rows: Sequence[Row]) -> list[tuple[str, Row]]:
    """Rows beyond a factor of two, each with the letter that the picture names it by."""
    return list(zip(ascii_lowercase, (row for row in rows if row.agrees is False), strict=False))


def ratios(rows: Sequence[Row]) -> Picture:
    """Draw predicted over published, a line for each instrument."""
    known = [row for row in rows if row.ratio is not None]
    letters = {row: letter for letter, row in missed(rows)}
    values = [float(row.ratio or 0) for row in known]
    across = Scale(min(ENDS[0], min(values) / 1.2), max(ENDS[1], max(values) * 1.2), log=True)
    left, right = 16.0, 16.0
    wide = PAGE - left - right
    marks: list[Mark] = []
    up = 0.0
    for instrument, group in reversed([(name, list(own)) for name, own in groupby(known, lambda row: row.instrument)]):
        places = [wide * float(across.share(row.ratio)) for row in group]
        layer = layers(places, 2 * DOT + 1)
        marks.append(Line([across.low, across.high], [up + 4, up + 4], "grid", 1.0))
        for row, level in zip(group, layer, strict=True):
            colour, shape = LOOKS[row.subject]
            y = up + 4 + DOT + STACK * level + 1
            marks.append(Dots([row.ratio], [y], colour, shape, DOT))
            if not row.agrees:
                marks.append(Text(float(row.ratio or 0), y, letters[row], dx=DOT + 4, dy=4, bold=True))
        top = up + LINE + STACK * max(layer)
        marks.append(Text(across.low, top - 12, instrument, dx=4, bold=True, halo=True))
        up = top
    band = Area([NEAR, FAR, FAR, NEAR], [0.0, 0.0, up, up], "sky", 0.25)
    one = Line([1.0, 1.0], [0.0, up], "ink", 1.0)
    ticks = named_ticks([tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10) if across.low <= tick <= across.high])
    panel = Panel(
        (0, 0, 1, 1), across, Scale(0.0, up), (band, one, *marks), "predicted over published", "",
        x_ticks=ticks, y_ticks=(),
    )  # fmt: skip
    seen = [subject for subject in SUBJECTS if any(row.subject == subject for row in known)]
    keys = [dot_key(subject, *LOOKS[subject]) for subject in seen]
    keys.append(box_key("half to twice", "sky", 0.25))
    size = PAGE, up + 90.0
    return one_panel("ratios", "Predicted over published, every number", size, panel, keys, left=left, right=right)


# --- page -------------------------------------------------------------------------------------------------------------


def digits(row: Row) -> int:
    """Digits that tell both numbers of a row apart: those of the published one, four at least and where measured."""
    if row.measured:
        return 4
    return max(4, *(len(f"{abs(value):.10g}".replace(".", "").strip("0")) for value in row.published), 4)


def breakable(text: str) -> str:
    """Text whose long words, names and addresses, may go on in the next line."""
    return " ".join(
        re.sub("([/_(])(?=..)", "\\1\u200b", word) if len(word) > LONG_WORD else word for word in text.split(" ")
    )


def in_full(value: float, many: int) -> str:
    """A number to so many digits, a count of thousands without powers of ten."""
    text = f"{value:.{many}g}"
    return f"{float(text):.0f}" if "e+" in text else text


def cells(row: Row) -> tuple[str, ...]:
    """A row of an instrument's table."""
    many = digits(row)
    published = " to ".join(in_full(value, many) for value in row.published)
    predicted = "-" if row.predicted is None else in_full(row.predicted, many)
    ratio = "-" if row.ratio is None else f"{row.ratio:.4f}" if abs(row.ratio - 1) < 0.1 else f"{row.ratio:.2f}"
    unit = f" [{row.unit}]" if row.unit else ""
    how = f"; predicted: {row.expression}" if row.expression else ""
    return f"{row.figure}{unit}", published or "-", predicted, ratio, row.why, breakable(f"{row.source}{how}")


def table(rows: Sequence[Row]) -> Table:
    """Numbers of one instrument."""
    heads = "number", "published", "predicted", "ratio", "why they differ", "source"
    return Table(tuple(map(cells, rows)), "lrrrll", heads, widths=(12, 6, 6, 4, 14, 18))


def sections(instruments: Sequence[Instrument], rows: Sequence[Row]) -> Iterator[Section]:
    """Each instrument with its lengths' source and its numbers."""
    for one in instruments:
        own = [row for row in rows if row.instrument == one.table.instrument]
        words: list[Block] = []
        if one.design is not None:
            file = f"the preset {one.table.design}" if one.table.design else f"studies/instruments/{one.name}.toml"
            given = "".join(f"; {name} = {value:g}" for name, value in one.table.given.items())
            words.append(Paragraph(f"Design: {file}; lengths: {one.design.source}{given}."))
        yield Section(one.table.instrument, (*words, table(own)), one.name)


def statements(rows: Sequence[Row]) -> Iterator[Statement]:
    """What it comes to."""
    known = [row for row in rows if row.ratio is not None]
    off = [abs(math.log(float(row.ratio or 1))) for row in known]
    within = {share: sum(value <= math.log1p(share) for value in off) for share in (0.01, 0.1, 1.0)}
    told = len({row.instrument for row in rows})
    missed = len(known) - within[1.0]
    yield Statement(
        "good" if not missed else "caution",
        f"Does the program say of instruments that others built what they published? Of {len(rows)} numbers of {told} "
        f"instruments {len(known)} can be predicted: {within[0.01]} to 1 %, {within[0.1]} to 10 %, {within[1.0]} to a "
        f"factor of two. {missed} miss that, and stand below with why.",
    )
    depth = [row for row in known if row.subject == "depth"]
    if depth:
        good = sum(bool(row.agrees) for row in depth)
        more = sum(row.subject == "depth" for row in rows) - len(depth)
        yield Statement(
            "good" if good == len(depth) else "caution",
            f"And of depth? {good} of {len(depth)} figures to a factor of two; {more} more cannot be compared, as the "
            "lengths of their instruments could not be read, or the model does not hold for them.",
        )


def summary(rows: Sequence[Row]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings and lines of a table of the instruments: how many numbers, and how near they are met."""
    lines: list[tuple[str, ...]] = []
    for instrument, own in groupby(rows, lambda row: row.instrument):
        all_own = list(own)
        ratios_of = [row.ratio for row in all_own if row.ratio is not None]
        span = f"{min(ratios_of):.3g} to {max(ratios_of):.3g}" if ratios_of else "-"
        close = str(sum(abs(ratio - 1) <= 0.1 for ratio in ratios_of))
        lines.append((instrument, str(len(all_own)), str(len(ratios_of)), close, span))
    return ("instrument", "numbers", "predicted", "to 10 %", "predicted over published"), lines


def misses(rows: Sequence[Row]) -> Bullets:
    """Rows beyond a factor of two."""
    return Bullets(
        tuple(
            f"({letter}) {row.instrument}, {row.figure}: {row.ratio:.2f} of what is published. {row.why}"
            for letter, row in missed(rows)
        )
    )


def report(instruments: Sequence[Instrument], rows: Sequence[Row]) -> Report:
    """The page."""
    counts = Counter(row.subject for row in rows)
    picture = Figure.of(
        "ratios", "Predicted over published",
        "Each dot is a number; at the line both agree, in the band to a factor of two. Those outside have letters, by "
        "which the list above says why. Nothing was fitted but the view mismatch where a row says so, on another part "
        "of the pictures.",
        ratios(rows),
    )  # fmt: skip
    shares = ", ".join(f"{counts[subject]} of {subject}" for subject in SUBJECTS if counts[subject])
    about = Paragraph(
        f"Numbers: {shares}. Each instrument is a design file of its published lengths, and each prediction an "
        "expression of quantities (roslf quantities lists them) that is computed from it; where a source gives a range "
        f"the ratio is to its geometric middle, signs left out. Rows that are off by more than {CLOSE:.0%} say why."
    )
    how = (
        Paragraph(
            f"A new instrument is NAME.toml, its design, and NAME{SUFFIX}, its numbers with their sources, in "
            "studies/instruments, and nothing else."
        ),
        Code("python studies/depth/published.py\npython studies/instruments/gallery.py", "Run again"),
    )
    parts = (
        Section("Answers", (Statements(tuple(statements(rows))), misses(rows), picture, about), "answers"),
        *sections(instruments, rows),
        Section("How it was done", how, "how"),
    )
    return Report("Instruments that exist", "published numbers beside what is predicted", parts)


def written(path: Path = OUT / NUMBERS) -> list[Row]:
    """Rows as they were written."""
    return [Row.of(data) for data in json.loads(path.read_text())["rows"]]


def write(folder: Path, out: Path, only: Sequence[str] = ()) -> list[Row]:
    """Compare every instrument of a folder, or those named, and write the numbers and the page.

    Raises
    ------
    InputError
        A table of numbers, or a design, that cannot be read.
    """
    instruments = [one for one in Instrument.all(folder) if not only or one.name in only]
    pictures = Pictures.written()
    rows = [row for one in instruments for row in one.rows(pictures)]
    page = render_html(report(instruments, rows))
    out.mkdir(parents=True, exist_ok=True)
    told = plain([row.to_dict() for row in rows])
    (out / NUMBERS).write_text(json.dumps({"rows": told}, allow_nan=False, indent=1) + "\n")
    (out / "index.html").write_text(page)
    return rows


def main() -> None:
    """Write numbers and page; exit code 2 where a file is faulty."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=OUT, help="folder for the results")
    parser.add_argument("--folder", type=Path, default=HERE, help="folder of the instruments")
    parser.add_argument("--only", nargs="*", default=[], help="instruments by the names of their files")
    arguments = parser.parse_args()
    try:
        write(arguments.folder, arguments.output, arguments.only)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
