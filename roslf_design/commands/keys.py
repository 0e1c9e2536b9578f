"""`roslf keys`."""

from __future__ import annotations

from ..reporting.keys import FILES, INSTEAD, NEEDED, looked_up, told_of, units_of
from ..tables import Table, print_table
from .terminal import Json, json_text, say


def keys(name: str = "", /, *, json: Json = False) -> None:
    """Every key that a file may hold: what it takes, its default, what it means.

    Example: roslf keys sensor.pixel

    Parameters
    ----------
    name
        A file (design, scene, tolerance, optimize, catalogue, story, bench, distances, lens), a table (main_lens,
        elements.plate, optimize.goals) or a key (sensor.pixel, or pixel). Default: which tables there are.
    """
    shown = looked_up(name) if name else [(table, table.rows()) for tables in FILES.values() for table in tables]
    if json:
        tables = [
            {"table": one.place, "about": one.about, "keys": [key._asdict() for key in rows]} for one, rows in shown
        ]
        print(json_text({"schema": "roslf.keys/1", "tables": tables}))
        return
    from rich.console import Console

    console = Console()
    if not name:
        lines = [(table.place, ", ".join(key.name for key in rows)) for table, rows in shown]
        print_table(Table(tuple(lines), "ll", ("table", "keys")), console)
        say("\nroslf keys TABLE, FILE or KEY says what each takes, its default and what it means.")
        return
    for table, rows in shown:
        title = f"{table.place}: {table.about}"
        print_table(
            Table(tuple(key.words() for key in rows), "llll", ("key", "takes", "default", "meaning"), title), console
        )
    if others := told_of(name, shown):
        say("", f"Also about {name}: {', '.join(f'roslf keys {place}' for place in others)}.")
    units = units_of(key for _, rows in shown for key in rows)
    say("", *(f"Units of {kind}: {known}." for kind, known in units.items()))
    if any(key.default == NEEDED for _, rows in shown for key in rows):
        say(f'"{NEEDED}": a file without it is refused.')
    if any(key.default == INSTEAD for _, rows in shown for key in rows):
        say(f'"{INSTEAD}": needed, unless what the meaning names stands for it.')
