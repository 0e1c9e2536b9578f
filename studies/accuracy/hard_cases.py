"""The hard cases: walks from a design to places where formulas break, each result judged beside its condition number.

A row tells what breaks, which form holds, and how to walk there (`hard_rows` has them all); running it gives the worst
place of every function, against 60 digits and beside the textbook formula in the same double precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import mpmath as mp
import numpy as np

from roslf_design.design import Design
from roslf_design.evaluation.near_cases import Near, near_cases

from .forms import CLOSED
from .oracles.judging import DIGITS, Judged, exactly, flat, judge, last_place

STEPS = 40
"""Steps of a walk."""


@dataclass(frozen=True)
class Budget:
    """How far a function may be off."""

    ulps: float = 4.0
    reason: str = ""
    """Why it is not 4 ulp times (1 + condition)."""
    conditioned: bool = True
    """Whether the number is per (1 + condition)."""

    @property
    def text(self) -> str:
        """For tables."""
        return f"{self.ulps:g} (1 + condition)" if self.conditioned else f"{self.ulps:g}"

    def share(self, judged: Judged) -> float:
        """Error as a part of this budget: above 1 it is broken."""
        return judged.ulps / (self.ulps * (1 + judged.condition if self.conditioned else 1.0))


@dataclass(frozen=True)
class Trial:
    """One function at one place of a walk."""

    function: str
    gap: float
    given: dict[str, Any] = field(repr=False)
    ours: Callable[..., Any] = field(repr=False)
    exact: Callable[..., Any] = field(repr=False)
    """Reference at 60 digits, by the same keywords."""
    naive: Callable[..., Any] | None = field(default=None, repr=False)
    """Textbook formula in double precision."""
    scale: Callable[..., float] | None = field(default=None, repr=False)
    """What errors are measured against; None is the result itself."""


Trials = Callable[[Design, np.random.Generator, int], Iterator[Trial]]


@dataclass(frozen=True)
class HardCase:
    """One row of the table."""

    name: str
    breaks: str
    holds: str
    trials: Trials = field(repr=False)
    shown: str = ""
    """Function whose errors the figure shows."""
    budgets: dict[str, Budget] = field(default_factory=dict, repr=False)
    """By function; without an entry, `Budget()`."""
    gap_means: str = "relative distance from the singular point"
    point: Callable[[Design], Iterator[tuple[str, dict[str, Any]]]] | None = field(default=None, repr=False)
    """Functions and arguments at the singular point itself."""

    def budget(self, function: str) -> Budget:
        """Of one function."""
        return self.budgets.get(function, Budget())


@dataclass(frozen=True)
class Point:
    """One function at one place."""

    function: str
    gap: float
    ours: Judged
    naive: float
    """Relative error of the textbook formula in double precision; inf where it gives no number."""
    fault: str
    """What our function did that it must not: an exception, NaN, inf. Empty where all is well."""


@dataclass(frozen=True)
class Worst:
    """Worst place of one function on one walk."""

    function: str
    budget: Budget
    gap: float
    judged: Judged
    naive: float
    """Largest relative error of the naive formula on the whole walk."""

    @property
    def share(self) -> float:
        """Of the budget."""
        return self.budget.share(self.judged)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready; what JSON has no number for is null."""
        numbers = {
            "ulps": self.judged.ulps,
            "relative_error": self.judged.relative,
            "condition": self.judged.condition,
            "share_of_budget": self.share,
            "naive_relative_error": self.naive,
        }
        return {
            "function": self.function,
            "budget_ulp": self.budget.ulps,
            "budget_times_condition": self.budget.conditioned,
            "reason": self.budget.reason,
            "gap": self.gap,
        } | {key: value if math.isfinite(value) else None for key, value in numbers.items()}


@dataclass(frozen=True)
class AtPoint:
    """What happens at the singular point itself."""

    finite: int
    """Functions that give finite numbers there."""
    infinite: tuple[str, ...]
    """Functions that give inf, which their documentation tells."""
    faults: tuple[str, ...]
    """Functions that give NaN, an inf that is not documented, or an exception."""


@dataclass(frozen=True)
class CaseResult:
    """One row, run."""

    case: HardCase
    points: tuple[Point, ...]
    at_point: AtPoint | None

    @property
    def faults(self) -> tuple[Point, ...]:
        """Places where a function gave NaN, an undocumented inf or an exception."""
        return tuple(point for point in self.points if point.fault)

    @property
    def shown(self) -> tuple[Point, ...]:
        """Of the function that the figure shows."""
        return tuple(point for point in self.points if point.function == self.case.shown)

    @property
    def functions(self) -> tuple[Worst, ...]:
        """Worst place of each function, worst function first."""
        worst = []
        for name in dict.fromkeys(point.function for point in self.points):
            budget = self.case.budget(name)
            mine = [point for point in self.points if point.function == name]
            top = max(mine, key=lambda point: budget.share(point.ours))
            worst.append(Worst(name, budget, top.gap, top.ours, max(point.naive for point in mine)))
        return tuple(sorted(worst, key=lambda one: -one.share))

    @property
    def held(self) -> bool:
        """Whether every function kept its budget, without a fault."""
        clean = self.at_point is None or not self.at_point.faults
        return clean and not self.faults and self.functions[0].share <= 1

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "name": self.case.name,
            "breaks": self.case.breaks,
            "holds": self.case.holds,
            "held": self.held,
            "trials": len(self.points),
            "faults": [f"{point.function}: {point.fault}" for point in self.faults],
            "at_the_point": None if self.at_point is None else asdict(self.at_point),
            "functions": [one.to_dict() for one in self.functions],
        }


@dataclass(frozen=True)
class HardCases:
    """The whole table."""

    design: Design
    seed: int
    results: tuple[CaseResult, ...]
    near: tuple[Near, ...]
    """How close the design itself is to each case."""

    @property
    def held(self) -> bool:
        """Whether every row holds."""
        return all(result.held for result in self.results)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "schema": "roslf.hard-cases/1",
            "design": self.design.name,
            "seed": self.seed,
            "held": self.held,
            "cases": [result.to_dict() for result in self.results],
            "near": [one._asdict() for one in self.near],
        }


def run_hard_cases(
    design: Design, cases: Iterable[HardCase], *, steps: int = STEPS, seed: int = 0,
    progress: Callable[[str], None] = lambda name: None,
) -> HardCases:  # fmt: skip
    """Walk from a design to every singular point and judge each function on the way.

    Parameters
    ----------
    design : Design
    cases : iterable of HardCase
        As `hard_rows.all_cases()`.
    steps : int
        Of each walk.
    seed : int
        Of the gaps and of what else is moved on the way.
    progress : callable
        Told each row's name.
    """
    results = []
    for number, case in enumerate(cases):
        progress(case.name)
        rng = np.random.default_rng([seed, number])
        points = tuple(run_trial(trial, case) for trial in case.trials(design, rng, steps))
        results.append(CaseResult(case, points, _at_point(case, design)))
    return HardCases(design, seed, tuple(results), near_cases(design))


def _at_point(case: HardCase, design: Design) -> AtPoint | None:
    if case.point is None:
        return None
    finite, infinite, faults = 0, [], []
    for name, given in case.point(design):
        function = CLOSED[name]
        try:
            values = np.array(flat(function(**given)), dtype=float)
        except (ArithmeticError, ValueError) as error:
            if "Raises" in str(function.__doc__):
                infinite.append(name)
            else:
                faults.append(f"{name} raised {error}")
            continue
        if np.isfinite(values).all():
            finite += 1
        elif np.isnan(values).any() or "inf" not in str(function.__doc__):
            faults.append(f"{name} gave {values}")
        else:
            infinite.append(name)
    return AtPoint(finite, tuple(infinite), tuple(faults))


def run_trial(trial: Trial, case: HardCase) -> Point:
    """Judge one function at one place; an exception is told as a fault, whatever it was."""
    with mp.workdps(DIGITS):
        truths = flat(trial.exact(**trial.given))
    naive = _naive_error(trial, truths)
    try:
        got = flat(trial.ours(**trial.given))
    except (ArithmeticError, ValueError) as error:
        nothing = Judged(None, 0.0, 0.0, 0.0)
        return Point(trial.function, trial.gap, nothing, naive, f"raised {error}")
    judged = _judge(trial, got, truths, case.budget(trial.function).conditioned)
    unreal = not math.isfinite(judged.ulps)
    fault = "not a number, or infinite where the exact value is not" if unreal else ""
    return Point(trial.function, trial.gap, judged, naive, fault)


def _judge(trial: Trial, got: list[Any], truths: list[Any], conditioned: bool) -> Judged:
    """The worst of a result's numbers next to its condition."""
    if trial.scale is None:
        judged = judge(trial.exact, got, trial.given, 0.5 if conditioned else math.inf, truths)
        return max(judged, key=Budget().share)
    with mp.workdps(DIGITS):
        unit = last_place(mp.mpf(trial.scale(**trial.given)))
        error = max(abs(exactly(value) - truth) for value, truth in zip(got, truths, strict=True))
        top = max(abs(truth) for truth in truths)
        return Judged(top, float(error / unit), float(error / top) if top else float(error / unit / 2**52), 0.0)


def _naive_error(trial: Trial, truths: list[Any]) -> float:
    """Largest relative error of the textbook formula in double precision; inf where it gives no number."""
    if trial.naive is None:
        return math.nan
    try:
        with np.errstate(all="ignore"):
            values = flat(trial.naive(**trial.given))
    except (ArithmeticError, ValueError):
        return math.inf
    worst = 0.0
    for value, truth in zip(values, truths, strict=True):
        if isinstance(truth, bool) or mp.isinf(truth):
            worst = worst if value == truth else math.inf
        elif isinstance(value, complex) or not math.isfinite(value) or (truth == 0 and value != 0):
            return math.inf
        elif truth != 0:
            with mp.workdps(DIGITS):
                worst = max(worst, float(abs((mp.mpf(float(value)) - truth) / truth)))
    return worst
