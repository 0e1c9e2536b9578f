"""The same work on several sides: results compared first, then times taken in turns."""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .process import Arrays, Command, SideError, Timing, Worker, store_arrays
from .samples import LEAST, Ratio, Spread, paired_ratio

SIDES = Path(__file__).resolve().parents[1] / "sides"
SHORTEST = 0.02
"""Runs shorter than this [s] are repeated within one measurement."""
MOST = 41
"""Rounds of a comparison, at most."""

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Side:
    """One program, one setting."""

    label: str
    program: str
    """Key of a peer; "here" and "numpy" run in this Python."""
    work: str = ""
    threads: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)
    count: float | None = None
    """Work done by one run, where not the case's."""
    command: tuple[str, ...] = ()
    """A whole process instead of a work; "{python}" stands for the program's Python."""
    file: str = ""
    """Of `SIDES`; empty is <program>_side.py."""
    python_path: Path | None = None
    """Where packages are looked for first: another revision of this project."""


@dataclass(frozen=True)
class Check:
    """One comparison of results."""

    name: str
    difference: float
    allowed: float

    @property
    def ok(self) -> bool:
        """Whether the difference is allowed; a difference that is no number is not."""
        return self.difference <= self.allowed

    @property
    def words(self) -> str:
        """What is wrong."""
        off = f"off by {self.difference:.3g}" if math.isfinite(self.difference) else "no number"
        return f"{self.name} {off}, allowed {self.allowed:.3g}"


@dataclass(frozen=True)
class Goal:
    """What a ratio should come to."""

    against: str
    """Label of the other side."""
    least: float
    """Times as fast, at least."""
    text: str


@dataclass(frozen=True)
class Case:
    """A piece of work and who does it; the first side is the one the others are compared with."""

    name: str
    title: str
    unit: str
    """What is counted: "rays", "trials", "runs"."""
    count: float
    sides: tuple[Side, ...]
    inputs: Callable[[], Mapping[str, Any]] | None = None
    judge: Callable[[Arrays, Arrays], Sequence[Check]] | None = None
    """Compares the first side's result with another's."""
    quality: Callable[[Arrays], Mapping[str, float]] | None = None
    """Numbers that tell how good a result is, smaller is better; for the page."""
    goals: tuple[Goal, ...] = ()
    note: str = ""
    bytes_each: float | None = None
    """Memory that one unit of work reads and writes, at least."""
    fast: bool = True
    """Whether `--quick` and comparisons of revisions run it."""


@dataclass(frozen=True)
class SideResult:
    """What became of a side."""

    label: str
    program: str
    threads: int
    count: float
    state: str
    """"timed", "missing", "failed" or "mismatch"."""
    reason: str = ""
    checks: tuple[Check, ...] = ()
    quality: Mapping[str, float] = field(default_factory=dict)
    first: float | None = None
    """Seconds of the first run, compiling included."""
    prepared: float | None = None
    seconds: tuple[float, ...] = ()
    """Of one run, round by round."""
    cpu: float | None = None
    """Median processor time of one run [s]."""
    peak_mib: float | None = None
    ratio: Ratio | None = None
    """Time of this side over the first side's, for the same work."""

    @property
    def rate(self) -> float | None:
        """Units of work a second, by the median."""
        return self.count / Spread.of(self.seconds).median if self.seconds else None


@dataclass(frozen=True)
class CaseResult:
    """A case, done."""

    case: Case
    sides: tuple[SideResult, ...]

    def side(self, label: str) -> SideResult | None:
        """The side of that label."""
        return next((side for side in self.sides if side.label == label), None)


Runner = Worker | Command


def start(side: Side, pythons: Mapping[str, Path | None]) -> Runner:
    """The side's process.

    Raises
    ------
    SideError
        The program is not installed; the message is empty, the reason is the installer's to tell.
    """
    python = Path(sys.executable) if side.program in ("here", "numpy") else pythons.get(side.program)
    if python is None:
        raise SideError("")
    if side.command:
        words = [word.replace("{python}", str(python)).replace("{sides}", str(SIDES)) for word in side.command]
        return Command(words, side.threads, side.python_path)
    return Worker(python, side.threads, side.python_path)


def compare(
    case: Case,
    pythons: Mapping[str, Path | None],
    reasons: Mapping[str, str],
    budget: float,
    tell: Tell = lambda text: None,
) -> CaseResult:
    """Do a case.

    Parameters
    ----------
    case : Case
    pythons : mapping
        Python of each peer, None where it is not to be had.
    reasons : mapping
        Why a peer is not to be had.
    budget : float
        Time for the rounds [s]; at least `samples.LEAST` rounds are done whatever they take.
    tell : callable
        Told what happens.
    """
    runners: dict[str, Runner] = {}
    results: dict[str, SideResult] = {}
    try:
        with tempfile.TemporaryDirectory(prefix="roslf-bench-") as folder:
            stored = None
            if case.inputs is not None:
                stored = Path(folder) / "inputs.npz"
                store_arrays(stored, case.inputs())
            answers: dict[str, Arrays] = {}
            for side in case.sides:
                tell(f"{case.name}: {side.label}")
                results[side.label] = _first(case, side, stored, pythons, reasons, runners, answers)
            _judge(case, answers, results)
            _rounds(case, runners, results, budget)
    finally:
        for runner in runners.values():
            runner.close()
    return CaseResult(case, _with_ratios([results[side.label] for side in case.sides]))


def _first(
    case: Case,
    side: Side,
    stored: Path | None,
    pythons: Mapping[str, Path | None],
    reasons: Mapping[str, str],
    runners: dict[str, Runner],
    answers: dict[str, Arrays],
) -> SideResult:
    """Start a side, run it once, keep its answer."""
    told = SideResult(side.label, side.program, side.threads, side.count or case.count, "timed")
    try:
        runner = runners[side.label] = start(side, pythons)
        prepared = None
        if isinstance(runner, Worker):
            file = SIDES / (side.file or f"{side.program}_side.py")
            prepared = float(runner.prepare(file, side.work, stored, side.options)["seconds"])
        first = runner.run()
        answers[side.label] = runner.result()
    except SideError as error:
        failed = runners.pop(side.label, None)
        if failed is not None:
            failed.close()
        state, why = ("failed", str(error)) if str(error) else ("missing", reasons.get(side.program, "not installed"))
        return replace(told, state=state, reason=why)
    quality = dict(case.quality(answers[side.label])) if case.quality else {}
    return replace(told, first=first.seconds, prepared=prepared, quality=quality)


def _judge(case: Case, answers: Mapping[str, Arrays], results: dict[str, SideResult]) -> None:
    """Compare answers with the first side's; who differs is told so and not timed."""
    reference = case.sides[0].label
    if case.judge is None or reference not in answers:
        return
    for label, answer in answers.items():
        try:
            checks = tuple(case.judge(answers[reference], answer))
        except (KeyError, ValueError, IndexError) as error:
            results[label] = replace(results[label], state="mismatch", reason=f"results cannot be compared: {error}")
            continue
        wrong = [check for check in checks if not check.ok]
        words = "; ".join(check.words for check in wrong)
        state = "mismatch" if wrong else results[label].state
        results[label] = replace(results[label], state=state, reason=words, checks=checks)


def _rounds(case: Case, runners: Mapping[str, Runner], results: dict[str, SideResult], budget: float) -> None:
    """All sides once a round, in an order that turns, until the budget is spent."""
    labels = [side.label for side in case.sides if results[side.label].state == "timed"]
    times: dict[str, int] = {}
    timings: dict[str, list[Timing]] = {}
    began = time.perf_counter()
    for index in range(MOST):
        if index >= LEAST and time.perf_counter() - began > budget:
            break
        for label in turn(labels, index):
            try:
                times[label] = times.get(label) or _repeats(runners[label])
                timings.setdefault(label, []).append(runners[label].run(times[label]))
            except SideError as error:  # it was alive before: told, and the rest goes on
                results[label] = replace(results[label], state="failed", reason=f"while timed: {error}")
                labels = [other for other in labels if other != label]
                timings.pop(label, None)
    for label, found in timings.items():
        cpu = float(np.median([timing.cpu for timing in found]))
        results[label] = replace(
            results[label],
            seconds=tuple(timing.seconds for timing in found),
            cpu=_finite(cpu),
            peak_mib=_finite(max(timing.peak_mib for timing in found)),
        )


def turn(labels: Sequence[str], index: int) -> list[str]:
    """Order of a round: each side is first, and last, as often as the others; every other round runs backwards."""
    if not labels:
        return []
    first = (index // 2) % len(labels)
    turned = [*labels[first:], *labels[:first]]
    return turned if index % 2 == 0 else turned[::-1]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _repeats(runner: Runner) -> int:
    return 1 if isinstance(runner, Command) else max(1, math.ceil(SHORTEST / max(runner.run().seconds, 1e-9)))


def _with_ratios(sides: Sequence[SideResult]) -> tuple[SideResult, ...]:
    """Ratios to the first side, where both were timed."""
    reference = sides[0]
    if not reference.seconds:
        return tuple(sides)
    ours = [seconds / reference.count for seconds in reference.seconds]
    found = [reference]
    for side in sides[1:]:
        theirs = [seconds / side.count for seconds in side.seconds]
        found.append(replace(side, ratio=paired_ratio(ours, theirs)) if theirs else side)
    return tuple(found)
