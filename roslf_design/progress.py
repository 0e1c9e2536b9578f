"""Progress of long work, as it is told to whoever waits for it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol


class CountedProgress(Protocol):
    """Receiver of progress: the step under way, and how much of how many things where they are counted."""

    def __call__(self, what: str, done: float = 0.0, total: float = 0.0) -> None:
        """Tell what is done, and how much of `total`; 0 where nothing is counted."""


class EnoughError(Exception):
    """Raised by who is told, for whom what there is so far is enough."""


def silent(what: str, done: float = 0.0, total: float = 0.0) -> None:
    """Progress that nobody looks at."""


Share = Callable[[float], None]
"""Receiver of how much of a step is done, from 0 to 1."""
UNHEARD: Share = partial(silent, "")


def shares(progress: CountedProgress, what: str) -> Share:
    """Beginning of a step: what it calls with the share of it that is done, from 0 to 1, is told as that step's."""
    progress(what)
    return lambda share: progress(what, share, 1.0)


def part_of(progress: Share, begin: float, end: float) -> Share:
    """Progress of a part of something, told as the whole's: from `begin` to `end` of it."""
    return lambda share: progress(begin + share * (end - begin))
