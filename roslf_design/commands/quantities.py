"""`roslf quantities`."""

from __future__ import annotations

from ..tables import Table, print_table
from ..theory.quantities import QUANTITIES
from .terminal import Json, json_text

ASKED = {"never": "", "optional": "at, or in focus", "needed": "at"}


def quantities(*, json: Json = False) -> None:
    """Every number of a camera by its name, as `sweep`, studies and `roslf_design.quantity` take it."""
    if json:
        rows = [
            {
                "quantity": one.name, "unit": one.unit, "words": one.words, "equation": one.equation, "at": one.at,
                "camera": one.of is not None, "field": one.local is not None,
            }
            for one in QUANTITIES.values()
        ]  # fmt: skip
        print(json_text({"schema": "roslf.quantities/1", "quantities": rows}))
        return
    from rich.console import Console

    lines = (
        (one.name, one.unit, "camera" if one.of is not None else "field", ASKED[one.at], one.words)
        for one in QUANTITIES.values()
    )
    print_table(Table(tuple(lines), "lllll", ("quantity", "unit", "of a", "distance", "what it is")), Console())
    print(
        "\nThose of a camera are for `roslf sweep --quantity` and optimise studies; docs/reference/quantities.md says"
    )
    print("which are metrics of tolerance studies.")
