"""`roslf presets`."""

from __future__ import annotations

from ..design import load, preset_names, preset_path
from ..tables import Table, print_table
from .terminal import Json, json_text


def presets(*, json: Json = False) -> None:
    """The designs that ship, and where their files are."""
    designs = {name: load(preset_path(name)) for name in preset_names()}
    if json:
        rows = [
            {"preset": name, "name": d.name, "source": d.source, "file": str(preset_path(name))}
            for name, d in designs.items()
        ]
        print(json_text({"schema": "roslf.presets/1", "presets": rows}))
        return
    from rich.console import Console

    table = tuple((name, design.name, design.source) for name, design in designs.items())
    print_table(Table(table, "lll", ("preset", "design", "source")), Console())
    print(f"\nFiles: {preset_path('paper').parent}")
    print("Use a name wherever a design file is asked for, e.g.: roslf evaluate paper")
