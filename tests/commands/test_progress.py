"""What long work shows: on a terminal only, and nothing of it left behind."""

from __future__ import annotations

import io
import sys

import pytest

from roslf_design.commands import terminal as progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal(monkeypatch):
    """Standard error as a terminal: set inside the test, since pytest puts its own back after each fixture."""
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    return shown


def test_the_status_line_replaces_itself_and_is_gone_afterwards(monkeypatch):
    shown = terminal(monkeypatch)
    with progress.StatusLine("report") as status:
        status.tell("figures")
        status.tell("PDF")
    assert shown.getvalue() == "\r\x1b[2Kreport: figures ...\r\x1b[2Kreport: PDF ...\r\x1b[2K"


def test_a_bar_shows_nothing_of_work_that_is_soon_over(monkeypatch):
    shown = terminal(monkeypatch)
    with progress.bar("trials", 100) as tell:
        tell(100)
    assert shown.getvalue() == ""


@pytest.mark.parametrize(("total", "text"), [(400, "100 of 400"), (1.0, "25%")])
def test_a_bar_counts_things_and_shares(monkeypatch, total, text):
    shown = terminal(monkeypatch)
    monkeypatch.setattr(progress, "PATIENCE", -1.0)
    with progress.bar("trials", total) as tell:
        tell(0.25 * total)
    assert text in shown.getvalue()


def test_silent_where_stderr_is_no_terminal(monkeypatch):
    shown = io.StringIO()
    monkeypatch.setattr(sys, "stderr", shown)
    with progress.StatusLine("report") as status, progress.bar("trials", 10) as tell:
        status.tell("figures")
        tell(5)
    assert shown.getvalue() == ""
