"""Two or three designs side by side: their verdicts, every number with differences marked, and their drawings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from .. import __version__
from ..evaluation import evaluate
from ..evaluation.show import FIELD_HEADINGS, field_row, table_groups
from . import comparison_sheets as sheets
from .blocks import Block, Bullets, Code, Report, Section, Table
from .content import parameter_rows, verdicts

if TYPE_CHECKING:
    from ..design import Design
    from ..evaluation.result import Evaluation

DIFFERENT, SAME = "≠", ""
MOST = 3
"""Designs that fit beside each other."""
LETTERS = "ABC"


def comparison_report(
    designs: Sequence[Design],
    *,
    command: str = "",
    stamp: tuple[str, ...] = (),
    accuracy: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Compare designs.

    Parameters
    ----------
    designs : sequence of Design
        Two or three, called A, B, C in their order.
    command, stamp, accuracy, progress
        As for `design_report`.

    Raises
    ------
    ValueError
        Fewer than two designs, or more than three.
    """
    if not 2 <= len(designs) <= MOST:
        raise ValueError(f"{len(designs)} designs cannot be compared side by side; give two or three")
    tell = progress or (lambda _: None)
    tell("evaluating")
    results = [evaluate(design, accuracy=accuracy) for design in designs]
    letters = LETTERS[: len(designs)]
    named = list(zip(letters, designs, results, strict=True))
    tell("figures")
    corners = [result.fields[-1].x_ml_mm for result in results]
    sections = (
        Section("Verdicts", tuple(verdicts(result, f"{letter}: ") for letter, _, result in named)),
        Section("What differs", (_parameters(designs), *_numbers(results), *_fields(results))),
        Section("Rays", tuple(sheets.ray_sheet(letter, design) for letter, design, _ in named)),
        Section("Microlens images", (sheets.image_sheet(letters, designs, corners),)),
        Section("Depth", (sheets.depth_sheet(letters, designs),)),
        Section("How this report was made", _making(command, stamp)),
    )
    title = ", ".join(f"{letter}: {design.name}" for letter, design, _ in named)
    return Report(title, "Designs side by side; ≠ marks what differs.", sections, f"roslf_design {__version__}")


def _parameters(designs: Sequence[Design]) -> Table:
    tables = [parameter_rows(design) for design in designs]
    rows = [
        (f"{name}, {symbol}" if symbol else name, *(table[i][2] for table in tables))
        for i, (symbol, name, *_) in enumerate(tables[0])
    ]
    others: list[tuple[str, Callable[[Design], str]]] = [
        ("array", lambda d: f"{d.microlens_array.layout}, {d.microlens_array.lens_shape} lenses"),
        ("pixels", lambda d: "{} x {}".format(*d.pixels)),
        ("further stops", lambda d: str(len(d.stops))),
    ]
    rows += [(name, *(tell(design) for design in designs)) for name, tell in others]
    return _marked("Parameters", rows, len(designs))


def _numbers(results: Sequence[Evaluation]) -> list[Table]:
    groups = [list(table_groups(result)) for result in results]
    tables = []
    for i, (title, rows) in enumerate(groups[0]):
        together = [(row[0], *(group[i][1][j][1] for group in groups)) for j, row in enumerate(rows)]
        tables.append(_marked(title, together, len(results)))
    return tables


def _fields(results: Sequence[Evaluation]) -> list[Table]:
    tables = []
    for i, place in enumerate(("centre", "edge", "corner")):
        cells = [field_row(result.fields[i]) for result in results]
        rows = [(heading, *(cell[j] for cell in cells)) for j, heading in enumerate(FIELD_HEADINGS)]
        tables.append(_marked(f"Microlens image at the {place}", rows, len(results)))
    return tables


def _marked(title: str, rows: Sequence[tuple[str, ...]], count: int) -> Table:
    """A table with a sign before every row whose designs differ; the others step back."""
    same = [len(set(row[1:])) == 1 for row in rows]
    marked = tuple((SAME if equal else DIFFERENT, *row) for equal, row in zip(same, rows, strict=True))
    faint = tuple(index for index, equal in enumerate(same) if equal)
    return Table(
        marked, "ll" + "d" * count, ("", "", *LETTERS[:count]), title, faint=faint, widths=(1.5, 18, *([13] * count))
    )


def _making(command: str, stamp: tuple[str, ...]) -> tuple[Block, ...]:
    blocks: list[Block] = [Bullets((f"roslf_design {__version__}", *stamp))]
    if command:
        blocks.append(Code(command, "The command that makes this report again"))
    return tuple(blocks)
