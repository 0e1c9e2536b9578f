"""Two or three designs side by side: their verdicts, every number with differences marked, and their drawings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ..evaluation import evaluate
from ..evaluation.show import FIELD_HEADINGS, effect_rows, field_row, table_groups
from . import comparison_sheets as sheets
from .blocks import Report, Section, Table
from .content import FOOTER, making, misalignments, parameter_rows, verdicts
from .parts_list import length

if TYPE_CHECKING:
    from ..design import Design
    from ..evaluation.result import Evaluation

DIFFERENT, SAME, ABSENT = "≠", "", "-"
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
        Section("What differs", (_parameters(designs), *_numbers(results), *_fields(results), _effects(results))),
        Section("Rays", tuple(sheets.ray_sheet(letter, design) for letter, design, _ in named)),
        Section("Microlens images", (sheets.image_sheet(letters, designs, corners),)),
        Section("Depth", (sheets.depth_sheet(letters, designs),)),
        making(command, (), stamp),
    )
    title = ", ".join(f"{letter}: {design.name}" for letter, design, _ in named)
    return Report(title, "Designs side by side; ≠ marks what differs.", sections, FOOTER)


def _parameters(designs: Sequence[Design]) -> Table:
    tables = [parameter_rows(design) for design in designs]
    rows = [
        (f"{name}, {symbol}" if symbol else name, *(table[i][2] for table in tables))
        for i, (symbol, name, *_) in enumerate(tables[0])
    ]
    others: list[tuple[str, Callable[[Design], str]]] = [
        ("array", lambda d: f"{d.microlens_array.layout}, {d.microlens_array.lens_shape} lenses"),
        ("pixels", lambda d: "{} x {}".format(*d.pixels)),
        ("main lens", lambda d: "ideal" if d.lens is None else d.lens.name),
        ("further stops", lambda d: str(len(d.stops))),
    ]
    most = max(len(design.stops) for design in designs)
    others += [(f"stop {k + 1}", partial(_stop, number=k)) for k in range(most)]
    others.append(("misalignments", _misaligned))
    rows += [(name, *(tell(design) for design in designs)) for name, tell in others]
    return _marked("Parameters", rows, len(designs))


def _stop(design: Design, number: int) -> str:
    if number >= len(design.stops):
        return ABSENT
    stop = design.stops[number]
    return f"{length(stop.diameter)} at {length(stop.distance)}"


def _misaligned(design: Design) -> str:
    moved = misalignments(design)
    return "; ".join(f"{part} {pose}" for part, pose in moved) if moved else "none"


def _numbers(results: Sequence[Evaluation]) -> list[Table]:
    """The evaluations' tables side by side, by the names of their rows: a real lens has more than an ideal one."""
    groups = [{title: {row[0]: row[1] for row in rows} for title, rows in table_groups(result)} for result in results]
    tables = []
    for title in dict.fromkeys(title for group in groups for title in group):
        names = dict.fromkeys(name for group in groups for name in group.get(title, {}))
        together = [(name, *(group.get(title, {}).get(name, ABSENT) for group in groups)) for name in names]
        tables.append(_marked(title, together, len(results)))
    return tables


def _effects(results: Sequence[Evaluation]) -> Table:
    """Every effect's size, and whether the plan has it on."""
    found = [{effect_row[0]: effect_row for effect_row in effect_rows(result)} for result in results]
    names = dict.fromkeys(name for rows in found for name in rows)
    together = [
        (name, *(f"{rows[name][1]}, {rows[name][3]}" if name in rows else ABSENT for rows in found)) for name in names
    ]
    return _marked("Effects for a white scene, and whether a simulation must have them on", together, len(results))


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
