"""`ProgressLine`: what long work tells, as lines on stderr, of a terminal or below a notebook's cell."""

from __future__ import annotations

import math
import sys
import time

from ..errors import printable
from ..words import about_time

OFTEN = 0.5
"""Seconds between two shares of one step that are shown."""


class ProgressLine:
    """Lines of progress for `progress=` of Python's functions: a step each, with its share done and the time so far."""

    def __init__(self) -> None:
        self._what, self._began, self._due, self._open = "", 0.0, 0.0, False

    def __call__(self, what: str, done: float = 0.0, total: float = 0.0) -> None:
        """Show what is being done, and how much of `total`; 0 where nothing is counted."""
        now = time.monotonic()
        if what != self._what:
            if self._open:
                print(file=sys.stderr)
            self._what, self._began, self._due = what, now, now
        elif not total or (done < total and now < self._due) or self._due == math.inf:
            return
        share = f": {done / total:4.0%}, {about_time(now - self._began)}" if total else " ..."
        self._due, self._open = now + OFTEN if not done >= total > 0 else math.inf, 0 <= done < total
        print(f"\r{printable(what)}{share}  ", end="" if self._open else "\n", file=sys.stderr, flush=True)
