"""`roslf presets`."""

from __future__ import annotations

import json as json_text
from typing import Annotated

from cyclopts import Parameter

from ..design import load, preset_names, preset_path


def presets(*, json: Annotated[bool, Parameter(negative=())] = False) -> None:
    """The designs that ship, and where their files are.

    Parameters
    ----------
    json
        Print JSON instead of a table.
    """
    designs = {name: load(preset_path(name)) for name in preset_names()}
    if json:
        rows = [
            {"preset": name, "name": d.name, "source": d.source, "file": str(preset_path(name))}
            for name, d in designs.items()
        ]
        print(json_text.dumps({"schema": "roslf.presets/1", "presets": rows}, indent=1))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("preset", "design", "source", box=None, header_style="bold", pad_edge=False)
    for name, design in designs.items():
        table.add_row(name, design.name, design.source)
    console = Console()
    console.print(table)
    console.print(f"\nFiles: {preset_path('paper').parent}", soft_wrap=True)
    console.print("Use a name wherever a design file is asked for, e.g.: roslf evaluate paper")
