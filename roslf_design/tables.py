"""The one kind of table: rows of text, which pages, the PDF and the terminal print each in its own way."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from .errors import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

NUMBER = re.compile(r"([-+−]?\d[\d ]*|[-−]?∞)(.*)", re.DOTALL)
"""Pattern of a number: the digits before the decimal point, and the rest with its unit."""
LEAST_WORDS = 16
"""Letters that a column of words keeps on a narrow terminal."""
GAP = 2
"""Letters between two columns there."""

Column = tuple[str, str, Callable[[Any], str]]
"""Heading, letter of `Table.align`, and what it says of a thing."""


class _Cell(NamedTuple):
    """One cell, split at the decimal point where its column is aligned on it."""

    align: str
    """l, r or d."""
    text: str
    """All of it."""
    whole: str
    """Digits before the decimal point of a number aligned on it; else empty."""
    rest: str
    """The point and all behind it."""
    room: int
    """Characters that the widest `whole` of the column takes."""


class BriefValue:
    """Value that prints in a few lines, in notebooks too, however long its `repr` is; by default what it holds."""

    def __str__(self) -> str:
        held = ", ".join(name for name in getattr(self, "__dataclass_fields__", ()) if not name.startswith("_"))
        return f"{type(self).__name__} of {held}"

    def _repr_pretty_(self, printer: Any, _: bool) -> None:
        printer.text(str(self))


@dataclass(frozen=True)
class Table:
    """Rows of text.

    Raises
    ------
    ValueError
        A row or `widths` not as long as `align`.
    """

    rows: tuple[tuple[str, ...], ...]
    align: str
    """One letter a column: l left, r right, d on the decimal point."""
    headings: tuple[str, ...] = ()
    title: str = ""
    caption: str = ""
    faint: tuple[int, ...] = ()
    """Rows that matter less."""
    widths: tuple[float, ...] = ()
    """Widths of the columns, in heights of a letter (em); 0 takes what its text needs. Aligns tables below each other.
    """
    left: tuple[tuple[str, ...], ...] = ()
    """Rows that the CSV file has besides."""
    dense: bool = False
    """Small and close on paper: of several that are to fit on one page."""

    def __post_init__(self) -> None:
        wrong = [row for row in (*self.rows, *filter(None, [self.headings])) if len(row) != len(self.align)]
        if wrong:
            raise ValueError(f"table {self.title!r}: {len(self.align)} columns are aligned, but a row has {wrong[0]}")
        if self.widths and len(self.widths) != len(self.align):
            raise ValueError(f"table {self.title!r}: {len(self.align)} columns have {len(self.widths)} widths")

    @classmethod
    def of(cls, things: Iterable[Any], columns: Iterable[Column], title: str = "", caption: str = "") -> Table:
        """A row for each thing, its cells as the columns say them."""
        headings, align, say = zip(*columns, strict=True)
        rows = tuple(tuple(tell(thing) for tell in say) for thing in things)
        return cls(rows, "".join(align), headings if any(headings) else (), title, caption)

    def cells(self) -> tuple[tuple[_Cell, ...], ...]:
        """The body, ready to be set; what is no number in a column of numbers stands left."""
        splits = [
            [NUMBER.fullmatch(text) if kind == "d" else None for kind, text in zip(self.align, row, strict=True)]
            for row in self.rows
        ]
        rooms = [
            max((len(m[1].rstrip()) for row in splits if (m := row[i])), default=0) for i in range(len(self.align))
        ]

        def cell(kind: str, text: str, match: re.Match[str] | None, room: int) -> _Cell:
            if match is None:
                return _Cell("l" if kind == "d" else kind, text, "", "", room)
            whole = match[1].rstrip()
            return _Cell(kind, text, whole, text[len(whole) :], room)

        return tuple(
            tuple(cell(*parts) for parts in zip(self.align, row, split, rooms, strict=True))
            for row, split in zip(self.rows, splits, strict=True)
        )

    def text(self) -> str:
        """Table as lines of text."""
        from rich.console import Console

        stream = io.StringIO()
        print_table(self, Console(file=stream, width=118, no_color=True))
        return stream.getvalue().strip("\n")

    def html(self) -> str:
        """Table as plain HTML, as notebooks show it; rows of words stand left, numbers right."""

        def row(cells: Iterable[str], tag: str) -> str:
            sides = (' style="text-align:left"' if kind == "l" else "" for kind in self.align)
            parts = (f"<{tag}{side}>{escape(cell)}</{tag}>" for side, cell in zip(sides, cells, strict=True))
            return f"<tr>{''.join(parts)}</tr>"

        title = f"<h4>{escape(self.title)}</h4>" if self.title else ""
        head = f"<thead>{row(self.headings, 'th')}</thead>" if self.headings else ""
        return f"{title}<table>{head}<tbody>{''.join(row(cells, 'td') for cells in self.rows)}</tbody></table>"


def csv_bytes(rows: Iterable[Iterable[object]]) -> bytes:
    """Rows as CSV that spreadsheets read; a number that is not known, or None, is an empty cell."""
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerows(["" if cell is None or cell != cell else cell for cell in row] for row in rows)
    return page.getvalue().encode("utf-8", "backslashreplace")  # a file's name may hold what is no letter


def plain_text(text: str, style: str = "") -> Text:
    """Text for rich as it stands, whatever a file says: no markup, and nothing that steers the terminal."""
    from rich.text import Text

    return Text(printable(text, kept="\n"), style)


def print_table(block: Table, console: Console, least: tuple[int, ...] = ()) -> None:
    """Print a table, an empty line before it, no number or name in it cut.

    Where it is wider than the terminal, headings and sentences wrap between their words; where that is not enough,
    further columns follow below, the first repeated before them.

    Parameters
    ----------
    block : Table
    console : Console
    least : tuple of int
        Characters that columns take at least; aligns tables below each other.
    """
    widths = [_widths(block, index, *least[index : index + 1]) for index in range(len(block.align))]
    text = plain_text("")
    for number, columns in enumerate(_strips(widths, console.width)):
        fitted = _fitted([widths[index] for index in columns], console.width)
        text.append("\n")
        if block.title and number == 0:
            across = sum(fitted) + GAP * (len(fitted) - 1)
            text.append("".join(f"{line}\n" for line in _set(block.title, across, "l", console)), "italic")
        styled = [(row, "dim" if place in block.faint else "") for place, row in enumerate(block.rows)]
        for row, style in [(block.headings, "bold"), *styled] if block.headings else styled:
            at = zip(columns, fitted, strict=True)
            cells = [_set(row[index], width, block.align[index], console) for index, width in at]
            for cell, width in zip(cells, fitted, strict=True):
                # Headings stand on their last line, cells hang from their first.
                place = 0 if row is block.headings else len(cell)
                cell[place:place] = [" " * width] * (max(map(len, cells)) - len(cell))
            text.append("".join(f"{(' ' * GAP).join(line)}\n" for line in zip(*cells, strict=True)), style)
    console.print(text, end="", soft_wrap=True)


def _set(cell: str, width: int, align: str, console: Console) -> list[str]:
    """Lines of a cell, each as wide as its column: rich's own tables take ten times as long."""
    from rich.cells import cell_len

    cell = printable(cell, kept="\n")
    spare = width - cell_len(cell)
    if spare < 0 or "\n" in cell:
        lines = plain_text(cell).wrap(console, width, justify="left" if align == "l" else "right")
        return [line.plain for line in lines]
    return [cell + " " * spare if align == "l" else " " * spare + cell]


def _widths(block: Table, index: int, least: int = 1) -> tuple[int, int, int]:
    """Widths of a column: narrowest, with its cells in one line, with its heading so.

    Numbers and names are always whole.
    """
    cells = [row[index] for row in block.rows]
    heading = block.headings[index] if block.headings else ""
    words = [word for cell in cells for word in (cell.split() if block.align[index] == "l" else [cell])]
    widest = max(map(len, cells), default=1)
    longest = max(map(len, [*words, *heading.split()]), default=1)
    narrowest = max(longest, min(widest, LEAST_WORDS), least)
    return narrowest, max(narrowest, widest), max(narrowest, widest, len(heading))


def _strips(widths: list[tuple[int, int, int]], room: int) -> list[list[int]]:
    """Columns that stand beside each other, the first in every strip."""
    strips = [[0]]
    for index in range(1, len(widths)):
        strip = [*strips[-1], index]
        if len(strip) > 2 and sum(widths[k][0] + GAP for k in strip) - GAP > room:
            strip = [0, index]
            strips.append(strip)
        strips[-1] = strip
    return strips


def _fitted(widths: list[tuple[int, int, int]], room: int) -> list[int]:
    """Widths that share what room there is: first cells in one line, then headings."""
    now = [narrow for narrow, _, _ in widths]
    for step in (1, 2):
        missing = [wanted[step] - width for wanted, width in zip(widths, now, strict=True)]
        spare = max(room - sum(now) - GAP * (len(now) - 1), 0)
        share = min(1.0, spare / (sum(missing) or 1))
        now = [width + int(share * more) for width, more in zip(now, missing, strict=True)]
    return now
