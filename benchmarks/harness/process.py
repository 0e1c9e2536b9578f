"""The parent's end of a side: a worker process, or a whole command run from start to exit."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

WORKER = Path(__file__).with_name("worker.py")
POOLS = ("OMP", "OPENBLAS", "MKL", "NUMBA", "NUMEXPR", "VECLIB")
"""Thread pools; each is told its size by <name>_NUM_THREADS."""
PATIENCE = 900.0
"""Longest wait for one answer [s]."""

Arrays = dict[str, NDArray[Any]]


def store_arrays(file: Path, arrays: Mapping[str, Any]) -> None:
    """Inputs of a work, for all its sides."""
    found: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
    np.savez(file, **found)


class SideError(Exception):
    """A side that could not do its work; the message says why."""


def environment(threads: int, python_path: Path | None = None) -> dict[str, str]:
    """What a side runs in: every pool of threads has `threads`, no window opens, user packages are out."""
    found = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    found |= {f"{pool}_NUM_THREADS": str(threads) for pool in POOLS}
    found |= {"MPLBACKEND": "Agg", "PYTHONNOUSERSITE": "1", "PYTHONWARNINGS": "ignore", "PYTHONHASHSEED": "0"}
    return found | ({"PYTHONPATH": str(python_path)} if python_path else {})


@dataclass(frozen=True)
class Timing:
    """One timed run."""

    seconds: float
    cpu: float
    """Processor time of all its threads [s]; NaN where unknown."""
    peak_mib: float


class Worker:
    """A side's process, ready to run its work."""

    def __init__(self, python: Path, threads: int, python_path: Path | None = None) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix="roslf-bench-")
        self._told = (Path(self._scratch.name) / "stderr").open("w+")
        self._process = subprocess.Popen(
            [str(python), "-c", f"import runpy; runpy.run_path({str(WORKER)!r}, run_name='__main__')"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._told,
            text=True,
            cwd=self._scratch.name,
            env=environment(threads, python_path),
        )

    def prepare(self, side: Path, work: str, inputs: Path | None, options: Mapping[str, Any]) -> dict[str, Any]:
        """Load the side and make its work ready; returns seconds and memory taken."""
        stored = str(inputs) if inputs else None
        return self._ask(do="prepare", side=str(side), work=work, inputs=stored, options=dict(options))

    def run(self, times: int = 1) -> Timing:
        """Do the work `times` times in a row; the mean."""
        return Timing(**self._ask(do="run", times=times))

    def profile(self, most: int = 8) -> dict[str, Any]:
        """Where the time of a run goes."""
        return self._ask(do="profile", most=most)

    def result(self) -> Arrays:
        """What the last run found."""
        to = Path(self._scratch.name) / "result.npz"
        self._ask(do="result", to=str(to))
        with np.load(to) as stored:
            return {name: stored[name] for name in stored.files}

    def close(self) -> None:
        """End the process."""
        if self._process.stdin and not self._process.stdin.closed:
            self._process.stdin.close()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout:
            self._process.stdout.close()
        self._told.close()
        self._scratch.cleanup()

    def _ask(self, **request: Any) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        alarm = threading.Timer(PATIENCE, self._process.kill)
        alarm.start()
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        finally:
            alarm.cancel()
        if not line:
            raise SideError(self._last_words())
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _last_words(self) -> str:
        self._process.wait()
        self._told.seek(0)
        lines = self._told.read().strip().splitlines()
        return lines[-1][:300] if lines else f"the process ended with code {self._process.returncode}"


class Command:
    """A whole process, timed from its start to its exit; the last line it prints may be JSON with its answer."""

    def __init__(self, words: list[str], threads: int, python_path: Path | None = None) -> None:
        self._words, self._environment = words, environment(threads, python_path)
        self._answer: Arrays = {}

    def run(self, times: int = 1) -> Timing:
        """Start it and wait for its end, `times` times; the mean."""
        start = time.perf_counter()
        before = os.times()
        with tempfile.TemporaryDirectory(prefix="roslf-bench-") as folder:
            for _ in range(times):
                self._once(folder)
        after = os.times()
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        return Timing((time.perf_counter() - start) / times, cpu / times, float("nan"))

    def _once(self, folder: str) -> None:
        try:
            done = subprocess.run(
                self._words, capture_output=True, text=True, env=self._environment, cwd=folder, timeout=PATIENCE
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SideError(str(error)[:300]) from error
        if done.returncode:
            told = done.stderr.strip().splitlines()
            raise SideError(told[-1][:300] if told else f"exit code {done.returncode}")
        lines = done.stdout.strip().splitlines()
        if lines and lines[-1].startswith("{"):
            self._answer = {name: np.asarray(value) for name, value in json.loads(lines[-1]).items()}

    def result(self) -> Arrays:
        """The answer printed by the last run."""
        return self._answer

    def close(self) -> None:
        """Nothing is left running."""
