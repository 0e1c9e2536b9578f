"""Tables on a terminal: numbers and names whole, whatever the width."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from roslf_design.commands.tables import print_table
from roslf_design.report.blocks import Table

ROWS = (
    ("centre_error_px@2", "-0.00012345", "measured with a gauge that lies about, in words that may wrap", "0"),
    ("fill_factor@0", "1.00506", "by hand", "12"),
)
BLOCK = Table(ROWS, "ldlr", ("metric@field", "std. dev.", "where it comes from", "undefined"), "Limits")


@pytest.mark.parametrize("width", [20, 60, 80, 200])
def test_no_number_and_no_name_is_cut(width):
    shown = io.StringIO()
    print_table(BLOCK, Console(file=shown, width=width))
    text = shown.getvalue()
    assert "…" not in text
    for row in ROWS:
        line = next(line for line in text.splitlines() if row[0] in line)
        assert row[1] in line
        assert row[3] in line.split()
    assert "undefined" in text


def test_columns_left_out():
    shown = io.StringIO()
    print_table(BLOCK, Console(file=shown, width=200), leave_out=("where it comes from",))
    assert "gauge" not in shown.getvalue()
    assert "1.00506" in shown.getvalue()


def test_brackets_are_no_markup():
    shown = io.StringIO()
    print_table(Table((("[red]f[/red]", "1"),), "lr", ("what [mm]", "n")), Console(file=shown, width=80))
    assert "[red]f[/red]" in shown.getvalue()
    assert "[mm]" in shown.getvalue()
