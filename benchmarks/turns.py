"""Things that take time, run in turn; medians with their ranges, ratios pair by pair."""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
Run = Callable[[], float]
"""Does a piece of work once and says how many seconds it took."""

PATIENCE = 900.0
"""Longest wait for one run [s]."""
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

    @classmethod
    def of(cls, label: str, seconds: list[float] | str, count: float = 1.0, note: str = "") -> Side:
        """From what `in_turn` gives of it."""
        fault = seconds if isinstance(seconds, str) else ""
        return cls(label, () if fault else tuple(map(float, seconds)), count, fault, note)

    @property
    def each(self) -> Spread:
        """Seconds for one unit of work."""
        return Spread.of([seconds / self.count for seconds in self.seconds])

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
    """What is counted a second ("rays"); empty: the time itself is told."""
    sides: tuple[Side, ...] = ()
    note: str = ""

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Row:
        """From what `dataclasses.asdict` made."""
        sides = tuple(Side(**{**side, "seconds": tuple(side["seconds"])}) for side in data["sides"])
        return cls(**{**data, "sides": sides})


def in_turn(
    runs: Mapping[str, Run], rounds: int, most_seconds: float = PATIENCE, least: int = 1
) -> dict[str, list[float] | str]:
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
        Seconds of every counted run; of one that failed, what it said: it was left out from then on.
    """
    results: dict[str, list[float] | str] = {label: [] for label in runs}
    start = time.perf_counter()
    for index in range(rounds + 1):
        if index > least and time.perf_counter() - start > most_seconds:
            break
        for label in list(runs)[:: 1 if index % 2 else -1]:
            seconds = results[label]
            if isinstance(seconds, list):
                try:
                    seconds += [runs[label]()][: min(index, 1)]
                except RunError as error:
                    results[label] = str(error)
    return results


def environment(threads: int | None = None, python_path: Path | None = None) -> dict[str, str]:
    """What a process runs in: no packages of the user's, no windows; pools of so many threads (None: as they like)."""
    names = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    names |= {"MPLBACKEND": "Agg", "PYTHONNOUSERSITE": "1", "PYTHONWARNINGS": "ignore", "PYTHONHASHSEED": "0"}
    if threads is not None:
        names |= {f"{pool}_NUM_THREADS": str(threads) for pool in POOLS}
    return names | ({"PYTHONPATH": str(python_path)} if python_path else {})


def process(words: Sequence[str], python_path: Path | None = None, prints: bool = False) -> Run:
    """A whole process from its start to its exit, in an empty folder; or, where it `prints` them, its own seconds."""

    def run() -> float:
        with tempfile.TemporaryDirectory(prefix="roslf-bench-") as folder:
            start = time.perf_counter()
            try:
                done = subprocess.run(
                    words,
                    capture_output=True,
                    text=True,
                    check=False,
                    env=environment(None, python_path),
                    cwd=folder,
                    timeout=PATIENCE,
                )
            except (OSError, subprocess.TimeoutExpired) as error:
                raise RunError(str(error)[:300]) from error
            seconds = time.perf_counter() - start
        if done.returncode:
            raise RunError(last_line(done.stderr) or f"exit code {done.returncode}")
        return float(last_line(done.stdout)) if prints else seconds

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

    def run(self) -> float:
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
        return float(json.loads(line))

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
