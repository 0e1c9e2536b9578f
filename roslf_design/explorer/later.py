"""Work that takes longer than a slider may wait: done once nothing has changed for a while."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

PAUSE = 0.3
"""How long a design must stand still before what takes about as long is done for it [s]."""


class Later:
    """Timers in the event loop, one for each kind of work; not in threads, which compiled kernels do not stand.

    Parameters
    ----------
    done : callable
        Called after each piece of work.
    """

    def __init__(self, done: Callable[[], None]) -> None:
        self._done = done
        self._timers: dict[str, tuple[asyncio.TimerHandle, object]] = {}

    def do(self, name: str, work: Callable[[], object], subject: object, pause: float = PAUSE) -> None:
        """Work in a while; asked again for another subject, the wait begins anew, for the same one it goes on.

        Parameters
        ----------
        name : str
            Of the kind of work.
        work : callable
        subject : object
            What the work is about.
        pause : float
            [s].
        """

        def run() -> None:
            del self._timers[name]
            work()
            self._done()

        if name in self._timers:
            timer, before = self._timers[name]
            if before == subject:
                return
            timer.cancel()
        self._timers[name] = (asyncio.get_running_loop().call_later(pause, run), subject)

    def cancel(self) -> None:
        """Forget all that waits."""
        for timer, _ in self._timers.values():
            timer.cancel()
        self._timers.clear()
