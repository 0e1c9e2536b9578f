"""`roslf accuracy`: how far numbers can be trusted, and what accuracy costs in time."""

from __future__ import annotations

import json as json_text
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from .report import PAGE, Progress, check_folder

if TYPE_CHECKING:
    from ..report.blocks import Table

accuracy = App(
    name="accuracy",
    help="How far numbers can be trusted, and what accuracy costs in time.",
    help_epilogue="Example: roslf accuracy hard-cases designs/paper.toml -o reports/hard-cases",
    help_format="plaintext",
)


@accuracy.command(name="hard-cases")
def hard_cases(
    design: str = "paper",
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    json: Annotated[bool, Parameter(negative=())] = False,
    seed: int = 0,
) -> int:
    """Walk from a design to every place where formulas break, and compare each result with 60 digits.

    Example: roslf accuracy hard-cases designs/paper.toml -o reports/hard-cases

    Exit code 1 where a function exceeds its budget.

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    output
        Folder for index.html and hard-cases.json, made if needed. Default: only print.
    json
        Print JSON instead of the table.
    seed
        Of the walks; the same seed gives the same bytes.
    """
    from ..accuracy.hard_cases import run_hard_cases
    from ..design import load
    from ..errors import InputError, Problem

    if seed < 0:
        raise InputError((Problem("--seed", f"{seed} is negative; give a whole number from 0 on"),))
    loaded = load(design)
    if output is not None:
        check_folder(output)
    with Progress() as progress:
        found = run_hard_cases(loaded, seed=seed, progress=progress.tell)
    text = json_text.dumps(found.to_dict(), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    if output is not None:
        from ..accuracy.hard_cases_page import hard_cases_report
        from ..design.write import write_atomically
        from ..report.html import render_html

        command = shlex.join(["roslf", "accuracy", "hard-cases", design, "-o", str(output)])
        output.mkdir(parents=True, exist_ok=True)
        write_atomically(output / "hard-cases.json", text.encode())
        write_atomically(output / PAGE, render_html(hard_cases_report(found, command)).encode())
    if json:
        print(text, end="")
    else:
        from ..accuracy.hard_cases_page import case_table

        print_table(case_table(found))
        for one in found.near:
            if one.near:
                print(f"\nNear {one.case} (at {one.distance:.2g}): {one.says}")
        if output is not None:
            print(f"\n{output / PAGE}")
    return 0 if found.held else 1


def print_table(block: Table) -> None:
    """A table for a terminal."""
    from rich.console import Console
    from rich.table import Table as Printed

    table = Printed(title=block.title, title_justify="left", box=None, header_style="bold", pad_edge=False)
    for heading, align in zip(block.headings, block.align, strict=True):
        table.add_column(heading, justify="left" if align == "l" else "right", overflow="fold")
    for row in block.rows:
        table.add_row(*row)
    Console().print(table)
