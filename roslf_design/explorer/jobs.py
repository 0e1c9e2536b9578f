"""Work that a slider may not wait for: long runs in processes of their own, short ones once a design stands still."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import accumulate
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

from .._arrays import by_value
from ..errors import FAULTS, InputError
from ..processes import end_with_parent
from ..progress import CountedProgress, EnoughError
from ..words import about_time, percent

Result = TypeVar("Result")
Tell = Callable[[float | None, str], None]
"""Told the share that is done (None: unknown) and what is being done."""

GRACE = 2.0
"""Seconds that a cancelled run has to tidy up before it is killed."""

PAUSE = 0.3
"""Seconds that a design must stand still before what takes about as long is done for it."""


@dataclass(frozen=True)
class Progress:
    """A run that goes on."""

    share: float | None
    """Done, 0 to 1; None where nobody knows."""
    text: str
    """Description of the step at work."""
    seconds: float
    told: float = 0.0
    """Time from its start until that share was done [s]."""
    began: float | None = None
    """Time from its start until a first share was known [s]: until then it prepares."""

    @property
    def left(self) -> float | None:
        """Time to its end, if it goes on as it has [s]; None where too little is done to tell."""
        if self.share is None or self.share < 0.02:
            return None
        began = self.began or 0.0
        return max(began + (self.told - began) / self.share - self.seconds, 0.0)

    @property
    def words(self) -> str:
        """How far it is, in words."""
        left = "" if self.left is None else f" {percent(self.share or 0)}, about {about_time(self.left)} left"
        return f"running{left}: {self.text}"


@dataclass(frozen=True)
class Failure:
    """A run that ended without a result."""

    message: str
    """Why: what the input lacks, or that it was cancelled."""


@by_value
@dataclass(frozen=True)
class Done(Generic[Result]):
    """A run that is over."""

    result: Result
    seconds: float


def stages(tell: Tell, parts: Mapping[str, float]) -> CountedProgress:
    """Receiver of progress by steps in their order, told as a share of the whole.

    Parameters
    ----------
    tell : callable
        Told of it.
    parts : mapping
        How the names of steps begin, and about how long each takes, in any unit.
    """
    ends = dict(zip(parts, accumulate(parts.values()), strict=True))
    whole = sum(parts.values())

    def progress(what: str, done: float = 0.0, total: float = 0.0) -> None:
        step = next((step for step in parts if what.startswith(step)), "")
        left = parts.get(step, 0.0) * (1.0 - (done / total if total else 0.0))
        share = (ends[step] - left) / whole if step else None
        tell(share, f"{what}: {done:g} of {total:g}" if total > 1 else what)

    return progress


class ProcessJob(Generic[Result]):
    """A function running in a process of its own, which does not outlive the program.

    Parameters
    ----------
    work : callable
        Called with its request and a `Tell`; both must be importable and picklable, as its result must be.
    request : Any
        What is asked.
    """

    def __init__(self, work: Callable[[Any, Tell], Result], request: Any) -> None:
        # Not fork: the program holds threads (the web server's, kernels') that a forked child would inherit half-alive.
        context = multiprocessing.get_context("spawn")
        self._receiver, sender = context.Pipe()
        self._process = context.Process(target=_run, args=(sender, work, request), daemon=True)
        self._began = time.monotonic()
        self._state: Progress | Done[Result] | Failure = Progress(None, "starting", 0.0)
        self._process.start()
        sender.close()

    def poll(self) -> Progress | Done[Result] | Failure:
        """How far it is, or how it ended; returns at once."""
        if not isinstance(self._state, Progress):
            return self._state
        share, text, told, first = self._state.share, self._state.text, self._state.told, self._state.began
        try:
            while self._receiver.poll():
                kind, content = self._receiver.recv()
                if kind == "progress":
                    share, text, at = content
                    told = at - self._began  # the clock is the machine's, not the process's
                    first = told if first is None and share is not None else first
                    continue
                seconds = time.monotonic() - self._began
                return self._end(Done(content, seconds) if kind == "done" else Failure(content))
        except (EOFError, OSError):
            self._process.join(GRACE)
            code = self._process.exitcode
            return self._end(Failure(f"the run ended without a result (exit code {code}); is memory short?"))
        self._state = Progress(share, text, time.monotonic() - self._began, told, first)
        return self._state

    def stop(self) -> None:
        """Tell the run, once it next says how far it is, that what it has found so far is enough."""
        if isinstance(self._state, Progress):
            with suppress(OSError):
                self._receiver.send("enough")

    def cancel(self) -> None:
        """End the run; may be called at any time, and returns at once."""
        if isinstance(self._state, Progress):
            self._end(Failure("cancelled"))

    def _end(self, state: Done[Result] | Failure) -> Done[Result] | Failure:
        self._state = state
        self._process.terminate()
        threading.Thread(target=_reap, args=(self._process, self._receiver), daemon=True).start()
        return state


def _reap(process: Any, receiver: Connection) -> None:
    """Wait for a process that was told to end, and kill it where it does not."""
    process.join(GRACE)
    if process.is_alive():
        process.kill()
        process.join()
    receiver.close()


def _run(sender: Connection, work: Callable[[Any, Tell], Any], request: Any) -> None:
    # An interrupt at the terminal goes to the whole group, but only the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    end_with_parent()

    enough = False

    def tell(share: float | None, text: str) -> None:
        nonlocal enough
        sender.send(("progress", (share, text, time.monotonic())))
        enough = enough or sender.poll()
        if enough:
            raise EnoughError

    try:
        message = ("done", work(request, tell))
    except EnoughError:
        message = ("failed", "stopped before anything was found")
    except InputError as error:
        message = ("failed", str(error))
    except (*FAULTS, OSError) as error:
        message = ("failed", f"{type(error).__name__}: {error}")
    # Who has the answer ends this process, at once and without a word.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    sender.send(message)
    sender.close()


ASIDE = ThreadPoolExecutor(max_workers=1, thread_name_prefix="aside")
"""Works on one thing after the other while the event loop hears requests."""


class Later:
    """Tasks in the event loop, one for each kind of work.

    Parameters
    ----------
    done : callable
        Called after each piece of work.
    """

    def __init__(self, done: Callable[[], None]) -> None:
        self._done = done
        self._tasks: dict[str, tuple[asyncio.Task[None], object]] = {}

    def do(
        self, name: str, work: Callable[[], object], subject: object, pause: float = PAUSE, *, aside: bool = True
    ) -> None:
        """Do some kind of work in a while [s]; asked again for another subject, the wait begins anew.

        What takes no time need not be done `aside`.
        """

        async def run() -> None:
            await asyncio.sleep(pause)
            try:
                if aside:
                    await asyncio.get_running_loop().run_in_executor(ASIDE, work)
            finally:  # one that is cancelled has been replaced
                if self._tasks.get(name, (None,))[0] is asyncio.current_task():
                    del self._tasks[name]
            if not aside:
                work()
            self._done()

        if name in self._tasks:
            task, before = self._tasks[name]
            if before == subject:
                return
            task.cancel()
        self._tasks[name] = (asyncio.get_running_loop().create_task(run()), subject)

    def cancel(self) -> None:
        """Forget all that waits."""
        for task, _ in self._tasks.values():
            task.cancel()
        self._tasks.clear()
