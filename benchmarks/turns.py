"""Things that take time, run in turn; medians with their ranges, ratios pair by pair."""

from __future__ import annotations

import contextlib
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .spent import PATIENCE

Arrays = dict[str, NDArray[Any]]


class Spent(NamedTuple):
    """What one run of a piece of work took."""

    wall: float
    """[s]"""
    processor: float = math.nan
    """Of all threads and processes together [s]; NaN where it is not known."""
    peak: float = math.nan
    """Memory of the largest process at its largest [MB]; NaN where it is not known."""


Run = Callable[[], Spent]
"""Does a piece of work once and says what it took."""

POOLS = ("OMP", "OPENBLAS", "MKL", "NUMBA", "NUMEXPR", "VECLIB")
"""Thread pools; each is given its size by <name>_NUM_THREADS."""


class RunError(Exception):
    """A run that failed; the message is the last line it wrote."""


@dataclass(frozen=True)
class Spread:
    """Several values of one thing."""

    median: float
    low: float
    high: float
    runs: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of one value or more."""
        return cls(statistics.median(values), min(values), max(values), len(values))


@dataclass(frozen=True)
class Side:
    """One program, or one revision, at one piece of work."""

    label: str
    seconds: tuple[float, ...] = ()
    """Of each run; none where it failed or was not to be had."""
    count: float = 1.0
    """Units of work a run."""
    fault: str = ""
    """Why there are no seconds."""
    note: str = ""
    """What else is known of its answer."""
    short: str = ""
    """In what its answer falls short of ours, where its time stands all the same."""
    processor: tuple[float, ...] = ()
    """Processor seconds of each run; none where they are not known."""
    peak: float | None = None
    """Most memory of a process in any run [MB]."""

    @classmethod
    def of(cls, label: str, runs: list[Spent] | str, count: float = 1.0, note: str = "", short: str = "") -> Side:
        """From what `in_turn` gives of it."""
        if isinstance(runs, str):
            return cls(label, count=count, fault=runs, note=note)
        processor = tuple(run.processor for run in runs if math.isfinite(run.processor))
        peak = max((run.peak for run in runs if math.isfinite(run.peak)), default=None)
        return cls(label, tuple(run.wall for run in runs), count, "", note, short, processor, peak)

    @property
    def each(self) -> Spread:
        """Seconds for one unit of work."""
        return Spread.of([seconds / self.count for seconds in self.seconds])

    @property
    def judged(self) -> float:
        """Median that a bar is held against, for one unit of work: processor seconds, where these are known."""
        return statistics.median(self.processor or self.seconds) / self.count

    def ratio(self, other: Side) -> Spread:
        """How many times as long the other took for the same work, pair by pair of runs that followed each other.

        Raises
        ------
        ValueError
            The sides did not run equally often, or not at all.
        """
        if not self.seconds or len(self.seconds) != len(other.seconds):
            raise ValueError(f"{len(self.seconds)} and {len(other.seconds)} runs make no pairs")
        pairs = zip(self.seconds, other.seconds, strict=True)
        return Spread.of([(b / other.count) / (a / self.count) for a, b in pairs])


@dataclass(frozen=True)
class Row:
    """A piece of work and all who did it; the first side is ours."""

    name: str
    title: str
    unit: str = ""
    """What is counted a second ("rays"); empty: the time itself is reported."""
    sides: tuple[Side, ...] = ()
    note: str = ""
    bar: float | None = None
    """What ours is held to: units a second at least, or processor seconds at most."""

    @property
    def met(self) -> bool | None:
        """Whether the first side meets the bar; None where there is none, or nothing was measured."""
        if self.bar is None or not self.sides[0].seconds:
            return None
        judged = self.sides[0].judged
        return 1 / judged >= self.bar if self.unit else judged <= self.bar

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Row:
        """From what `dataclasses.asdict` made."""
        times = ("seconds", "processor")
        sides = tuple(Side(**side | {name: tuple(side[name]) for name in times}) for side in data["sides"])
        return cls(**{**data, "sides": sides})


def in_turn(
    runs: Mapping[str, Run], rounds: int, most_seconds: float = PATIENCE, least: int = 1
) -> dict[str, list[Spent] | str]:
    """Each once a round, every other round backwards, after a round that does not count (caches, compiled kernels).

    Parameters
    ----------
    runs : mapping
        Whom to run, by label.
    rounds : int
        At most.
    most_seconds : float
        No further round begins after this time.
    least : int
        Rounds that are counted whatever they take.

    Returns
    -------
    dict
        What every counted run took; of one that failed, what it said: it was left out from then on.
    """
    results: dict[str, list[Spent] | str] = {label: [] for label in runs}
    start = time.perf_counter()
    for index in range(rounds + 1):
        if index > least and time.perf_counter() - start > most_seconds:
            break
        for label in list(runs)[:: 1 if index % 2 else -1]:
            counted = results[label]
            if isinstance(counted, list):
                try:
                    counted += [runs[label]()][: min(index, 1)]
                except RunError as error:
                    results[label] = str(error)
    return results


AS_USERS_HAVE_IT = ("PYTHONPATH", "PYTHONHOME", "PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX")
"""Left out of what a process runs in: with bytecode not kept, a command reads all sources anew each time."""


def environment(threads: int | None = None, python_path: Path | None = None) -> dict[str, str]:
    """What a process runs in: no packages of the user's, no windows; pools of so many threads (None: as they like)."""
    names = {name: value for name, value in os.environ.items() if name not in AS_USERS_HAVE_IT}
    names |= {"MPLBACKEND": "Agg", "PYTHONNOUSERSITE": "1", "PYTHONWARNINGS": "ignore", "PYTHONHASHSEED": "0"}
    if threads is not None:
        names |= {f"{pool}_NUM_THREADS": str(threads) for pool in POOLS}
    return names | ({"PYTHONPATH": str(python_path)} if python_path else {})


def process(
    words: Sequence[str], python_path: Path | None = None, prints: bool = False, kernels: Path | None = None
) -> Run:
    """A whole process from its start to its exit, in an empty folder.

    Where it `prints` them, its own seconds on its last line (wall, then perhaps processor) stand for those of the
    process. `kernels`: where it keeps compiled kernels, if not where users have them.
    """
    environ = environment(None, python_path) | ({"NUMBA_CACHE_DIR": str(kernels)} if kernels else {})

    def run() -> Spent:
        with tempfile.TemporaryDirectory(prefix="roslf-bench-") as folder, tempfile.NamedTemporaryFile() as out:
            script = (sys.executable, "-I", "-S", str(Path(__file__).with_name("spent.py")), out.name)
            try:
                done = subprocess.run(
                    (*script, *words), capture_output=True, text=True, check=False, env=environ, cwd=folder
                )
            except OSError as error:
                raise RunError(str(error)[:300]) from error
            if done.returncode:
                raise RunError(last_line(done.stderr) or f"exit code {done.returncode}")
            spent = Spent(*json.loads(Path(out.name).read_text()))
        own = list(map(float, last_line(done.stdout).split())) if prints else [spent.wall, spent.processor]
        return Spent(own[0], own[1] if len(own) > 1 else math.nan, spent.peak)

    return run


def last_line(text: str) -> str:
    """The last line of what a program wrote, as far as a table has room for it."""
    return (text.strip().splitlines() or [""])[-1][:300]


class Worker:
    """A process that has made one work of `sides.py` ready and does it whenever it is told to; one thread."""

    def __init__(self, python: Path, work: str, inputs: Path, folder: Path) -> None:
        self._answer, self._log = folder / f"{work}.npz", (folder / f"{work}.log").open("w+")
        self._process = subprocess.Popen(
            [str(python), str(Path(__file__).with_name("sides.py")), work, str(inputs), str(self._answer)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            cwd=folder,
            env=environment(1, Path(__file__).resolve().parents[1] if work.startswith("here_") else None),
        )

    def run(self) -> Spent:
        """Do the work once."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write("go\n")
            self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            self._process.wait()
            self._log.seek(0)
            raise RunError(last_line(self._log.read()) or f"exit code {self._process.returncode}")
        return Spent(*json.loads(line))

    def answer(self) -> Arrays:
        """What its first run found."""
        with np.load(self._answer) as stored:
            return {name: stored[name] for name in stored.files}

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._log):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
