"""Tables of a report on a terminal: words may wrap, numbers are never cut."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from rich.console import Console

    from ..report.blocks import Table

LEAST_WORDS = 16
"""Letters that a column of words keeps on a narrow terminal."""


def print_table(block: Table, console: Console, leave_out: tuple[str, ...] = ()) -> None:
    """Print a table, an empty line before it; wider than the terminal rather than with cut numbers.

    Parameters
    ----------
    block : Table
    console : Console
    leave_out : tuple of str
        Headings of columns that a terminal has no room for.
    """
    from rich.table import Table as Grid
    from rich.text import Text

    kept = [index for index, heading in enumerate(block.headings) if heading not in leave_out]
    grid = Grid(title=block.title or None, title_justify="left", box=None, header_style="bold", pad_edge=False)
    needed = 2 * len(kept)
    for index in kept:
        cells = [row[index] for row in block.rows]
        widest = max(map(len, cells), default=1)
        # Numbers and names stay whole; headings wrap between their words.
        whole = block.align[index] != "l" or not any(" " in cell for cell in cells)
        least = max(widest if whole else min(widest, LEAST_WORDS), *map(len, block.headings[index].split() or [""]), 0)
        side: Literal["left", "right"] = "left" if block.align[index] == "l" else "right"
        grid.add_column(Text(block.headings[index]), justify=side, min_width=least)
        needed += least
    for row in block.rows:
        grid.add_row(*(Text(row[index]) for index in kept))
    console.print()
    console.print(grid, width=max(console.width, needed), crop=False)
