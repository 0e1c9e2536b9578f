"""Quantities of several cameras as one table: for a notebook, for pandas, for a spreadsheet."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import by_value
from ..design import PATHS
from ..design.files import write_new
from ..tables import Table, csv_bytes
from ..words import number, sentence

MOST_REASONS = 6
"""Rows of which it is told below a table why they lack values."""
MOST_ROWS = 24
"""Rows that are shown of a table; of a longer one the first and the last half as many."""


@by_value
@dataclass(frozen=True)
class QuantityTable:
    """Quantities of several cameras: a row a camera, a column a place or a quantity."""

    columns: Mapping[str, NDArray[Any]]
    """Name to its values, all of one length; numbers, or texts that name the row."""
    units: Mapping[str, str]
    """Unit of each column of numbers."""
    title: str = ""
    note: str = ""
    """Reservation about columns, in words; stands under the table."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Row to why it has no value of some columns, or an infinite one, in words; of rows that are named."""

    @property
    def headed(self) -> dict[str, NDArray[Any]]:
        """Columns as files have them: with the unit behind a name that does not state it."""
        return {
            f"{name} [{unit}]" if (unit := self.units.get(name)) and (name in PATHS or "." in name) else name: values
            for name, values in self.columns.items()
        }

    def csv(self) -> bytes:
        """Table as a CSV file; an empty cell is what has no value, "inf" what has no end."""
        headed = self.headed
        return csv_bytes([headed, *zip(*(values.tolist() for values in headed.values()), strict=True)])

    def to_csv(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the table as a CSV file; appears whole or not at all.

        Raises
        ------
        FileExistsError
            Where the file exists and `overwrite` is false.
        """
        write_new(Path(path), self.csv(), overwrite)

    def to_pandas(self) -> Any:
        """Table as a `pandas.DataFrame`; its ``attrs`` are units by column, the note, and reasons by row, where any.

        Raises
        ------
        ModuleNotFoundError
            The pandas package is not installed.
        """
        if importlib.util.find_spec("pandas") is None:
            raise ModuleNotFoundError("to_pandas needs the pandas package (pip install pandas); or write to_csv")
        import pandas

        frame = pandas.DataFrame(dict(self.columns))
        frame.attrs |= {"units": dict(self.units)} | ({"note": self.note} if self.note else {})
        frame.attrs |= {"reasons": dict(self.reasons)} if self.reasons else {}
        return frame

    @property
    def table(self) -> Table:
        """Table of text, as pages and terminals set it; the middle of a long one is left out."""
        rows = len(next(iter(self.columns.values()), ()))
        half = MOST_ROWS // 2
        shown = range(rows) if rows <= MOST_ROWS else [*range(half), *range(rows - half, rows)]
        cells = [tuple(_cell(values[row]) for values in self.columns.values()) for row in shown]
        if rows > MOST_ROWS:
            cells.insert(half, ("...",) * len(self.columns))
        align = "".join("d" if values.dtype.kind == "f" else "l" for values in self.columns.values())
        return Table(tuple(cells), align, tuple(self.headed), self.title)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __str__(self) -> str:
        return "\n".join(filter(None, [self.table.text(), *self._below]))

    @property
    def _below(self) -> list[str]:
        """Sentences under the table."""
        told = [f"row {row}: {why}" for row, why in [*self.reasons.items()][:MOST_REASONS]]
        return [sentence(words) for words in (self.note, *told) if words]

    def _repr_html_(self) -> str:
        return self.table.html() + "".join(f"<p>{escape(words)}</p>" for words in self._below)


def _cell(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return "" if np.isnan(value) else number(float(value))
    return str(value)
