"""Cells of tables as every format needs them: split at the decimal point where a column is aligned on it."""

from __future__ import annotations

import re
from typing import NamedTuple

from .blocks import Table

NUMBER = re.compile(r"([-+−]?\d[\d ]*|[-−]?∞)(.*)", re.DOTALL)
"""What stands before the decimal point, and the rest with its unit."""


class Cell(NamedTuple):
    """One cell."""

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


def column_cells(table: Table) -> tuple[tuple[Cell, ...], ...]:
    """The body of a table, ready to be set."""
    parts = [
        [_split(text) if kind == "d" else None for kind, text in zip(table.align, row, strict=True)]
        for row in table.rows
    ]
    rooms = [max((len(row[i][0]) for row in parts if row[i]), default=0) for i in range(len(table.align))]  # type: ignore[index]
    return tuple(
        tuple(
            Cell(kind if split else ("l" if kind == "d" else kind), text, *(split or ("", "")), room)
            for kind, text, split, room in zip(table.align, row, splits, rooms, strict=True)
        )
        for row, splits in zip(table.rows, parts, strict=True)
    )


def _split(text: str) -> tuple[str, str] | None:
    match = NUMBER.fullmatch(text)
    return (match[1].rstrip(), text[len(match[1].rstrip()) :]) if match else None
