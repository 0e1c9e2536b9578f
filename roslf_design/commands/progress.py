"""What long work shows on stderr while it runs: nothing where stderr is no terminal, or where it is over at once."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PATIENCE = 2.0
"""Seconds before a bar appears: shorter work needs none."""


class StatusLine:
    """One line that tells what is being done, gone afterwards; silent where stderr is not a terminal.

    Parameters
    ----------
    command
        What the line begins with: the command's name.
    """

    def __init__(self, command: str) -> None:
        self._command = command
        self._shown = sys.stderr.isatty()

    def __enter__(self) -> StatusLine:
        return self

    def tell(self, what: str) -> None:
        """Replace the line."""
        if self._shown:
            print(f"\r\x1b[2K{self._command}: {what} ...", end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


@contextmanager
def bar(name: str, total: float = 1.0) -> Iterator[Callable[[float], None]]:
    """A bar with the time that is left, told how much of `total` is done; counted where `total` is a number of things.

    Yields
    ------
    callable
        Takes how much is done, from 0 to `total`.
    """
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    started = time.monotonic()
    counted = TextColumn("{task.completed:.0f} of {task.total:.0f}") if total > 1 else TaskProgressColumn()
    console = Console(stderr=True)
    shown = Progress(TextColumn(name), BarColumn(), counted, TimeRemainingColumn(), console=console, transient=True)
    task = shown.add_task(name, total=total)

    def tell(done: float) -> None:
        shown.update(task, completed=done)
        if not shown.live.is_started and time.monotonic() - started > PATIENCE:
            shown.start()

    try:
        yield tell
    finally:
        shown.stop()
