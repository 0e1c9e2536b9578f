"""The one kind of table: rows of text, which pages, the PDF and the terminal print each in its own way."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from .errors import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

NUMBER = re.compile(r"([-+−]?\d[\d ]*|[-−]?∞)(.*)", re.DOTALL)
"""What stands before the decimal point, and the rest with its unit."""
LEAST_WORDS = 16
"""Letters that a column of words keeps on a narrow terminal."""


Column = tuple[str, str, Callable[[Any], str]]
"""Heading, letter of `Table.align`, and what it says of a thing."""


class Cell(NamedTuple):
    """One cell, split at the decimal point where its column is aligned on it."""

    align: str
    """l, r or d."""
    text: str
    """All of it."""
    whole: str
    """Of a number aligned on the decimal point: what stands before the point; else empty."""
    rest: str
    """The point and all behind it."""
    room: int
    """Characters that the widest `whole` of the column takes."""


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
    """Of the columns, in heights of a letter (em); 0 takes what its text needs. Aligns tables below each other."""

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

    def cells(self) -> tuple[tuple[Cell, ...], ...]:
        """The body, ready to be set; what is no number in a column of numbers stands left."""
        splits = [
            [NUMBER.fullmatch(text) if kind == "d" else None for kind, text in zip(self.align, row, strict=True)]
            for row in self.rows
        ]
        rooms = [
            max((len(m[1].rstrip()) for row in splits if (m := row[i])), default=0) for i in range(len(self.align))
        ]

        def cell(kind: str, text: str, match: re.Match[str] | None, room: int) -> Cell:
            if match is None:
                return Cell("l" if kind == "d" else kind, text, "", "", room)
            whole = match[1].rstrip()
            return Cell(kind, text, whole, text[len(whole) :], room)

        return tuple(
            tuple(cell(*parts) for parts in zip(self.align, row, split, rooms, strict=True))
            for row, split in zip(self.rows, splits, strict=True)
        )


def plain_text(text: str, style: str = "") -> Text:
    """Text for rich as it stands, whatever a file says: no markup, and nothing that steers the terminal."""
    from rich.text import Text

    return Text(printable(text, kept="\n"), style)


def print_table(block: Table, console: Console, least: tuple[int, ...] = ()) -> None:
    """Print a table, an empty line before it; wider than the terminal rather than with cut numbers.

    Parameters
    ----------
    block : Table
    console : Console
    least : tuple of int
        Characters that columns take at least; aligns tables below each other.
    """
    from rich.table import Table as Grid

    headings = block.headings or ("",) * len(block.align)
    grid = Grid(
        title=plain_text(block.title) if block.title else None,
        title_justify="left",
        box=None,
        header_style="bold",
        pad_edge=False,
        show_header=bool(block.headings),
    )
    needed = 2 * len(headings)
    for index, (heading, align) in enumerate(zip(headings, block.align, strict=True)):
        cells = [row[index] for row in block.rows]
        # Numbers and names stay whole; headings and sentences wrap between their words.
        words = [word for cell in cells for word in (cell.split() if align == "l" else [cell])]
        widest = max(map(len, cells), default=1)
        longest = max(map(len, [*words, *heading.split()]), default=1)
        narrowest = max(longest, min(widest, LEAST_WORDS), *least[index : index + 1])
        side: Literal["left", "right"] = "left" if align == "l" else "right"
        grid.add_column(plain_text(heading), justify=side, min_width=narrowest)
        needed += narrowest
    for number, row in enumerate(block.rows):
        grid.add_row(*map(plain_text, row), style="dim" if number in block.faint else None)
    console.print()
    console.print(grid, width=max(console.width, needed), crop=False)
