"""Blocks of a report on a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..tables import print_table
from .blocks import MARKS, Block, Bullets, Statement, Statements, Table

if TYPE_CHECKING:
    from rich.console import Console

COLOURS = {"good": "green", "bad": "red", "caution": "yellow", "plain": "dim"}


def print_blocks(blocks: Iterable[Block], console: Console) -> None:
    """Statements, tables and bullets."""
    for block in blocks:
        if isinstance(block, Statements):
            print_statements(block.items, console)
        elif isinstance(block, Table):
            print_table(block, console)
        elif isinstance(block, Bullets):
            console.print()
            for item in block.items:
                console.print(item, highlight=False, soft_wrap=True)


def print_statements(items: Iterable[Statement], console: Console) -> None:
    """One a line, its sign in its colour."""
    from rich.text import Text

    for item in items:
        mark = Text(f"{MARKS[item.tone][0]} ", style=COLOURS[item.tone])
        console.print(mark + Text(f"{item.text} {item.remedy}".strip()), soft_wrap=True)
