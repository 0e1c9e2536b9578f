"""Runs the hard cases on a design: worst errors beside condition numbers, and the naive formula beside ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .. import theory
from ..design import Design
from .cases import FORMS, STEPS, Budget, HardCase, Trial
from .digits import DIGITS, Judged, exactly, flat, judge, last_place, many_digits
from .nearby import Near, near_cases

FAILED = math.inf
"""Error told of a naive formula that gives no number."""


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
        """Of the budget: above 1 it is broken."""
        return share(self.judged, self.budget)


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
    def functions(self) -> tuple[Worst, ...]:
        """Worst place of each function, worst function first."""
        found = []
        for name in dict.fromkeys(point.function for point in self.points):
            budget = self.case.budget(name)
            mine = [point for point in self.points if point.function == name]
            top = max(mine, key=lambda point: share(point.ours, budget))
            found.append(Worst(name, budget, top.gap, top.ours, max(point.naive for point in mine)))
        return tuple(sorted(found, key=lambda one: -one.share))

    @property
    def worst(self) -> Worst:
        """Of all functions."""
        return self.functions[0]

    @property
    def held(self) -> bool:
        """Whether every function kept its budget, without a fault."""
        clean = self.at_point is None or not self.at_point.faults
        return clean and not self.faults and self.worst.share <= 1


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
        """JSON-ready; infinite errors of naive formulas are null."""
        return {
            "schema": "roslf.hard-cases/1",
            "design": self.design.name,
            "seed": self.seed,
            "held": self.held,
            "cases": [
                {
                    "name": result.case.name,
                    "breaks": result.case.breaks,
                    "holds": result.case.holds,
                    "held": result.held,
                    "trials": len(result.points),
                    "faults": [f"{point.function}: {point.fault}" for point in result.faults],
                    "at_the_point": None if result.at_point is None else asdict(result.at_point),
                    "functions": [
                        {
                            "function": one.function,
                            "budget_ulp": one.budget.ulps,
                            "budget_times_condition": one.budget.conditioned,
                            "reason": one.budget.reason,
                            "gap": one.gap,
                            "ulps": finite(one.judged.ulps),
                            "relative_error": finite(one.judged.relative),
                            "condition": finite(one.judged.condition),
                            "share_of_budget": finite(one.share),
                            "naive_relative_error": finite(one.naive),
                        }
                        for one in result.functions
                    ],
                }
                for result in self.results
            ],
            "near": [one._asdict() for one in self.near],
        }


def finite(value: float) -> float | None:
    """None for what JSON has no number for."""
    return value if math.isfinite(value) else None


def share(judged: Judged, budget: Budget) -> float:
    """Error as a part of its budget."""
    return judged.ulps / (budget.ulps * (1 + judged.condition if budget.conditioned else 1.0))


def all_cases() -> tuple[HardCase, ...]:
    """Every row: closed forms, shapes, waves, fits."""
    from .fit_cases import FITS
    from .shape_cases import SHAPES
    from .wave_cases import WAVES

    return (*FORMS, *SHAPES, *WAVES, *FITS)


def run_hard_cases(
    design: Design,
    *,
    cases: Iterable[HardCase] | None = None,
    steps: int = STEPS,
    seed: int = 0,
    progress: Callable[[str], None] = lambda name: None,
) -> HardCases:
    """Walk from a design to every singular point and judge each function on the way.

    Parameters
    ----------
    design : Design
    cases : iterable of HardCase, optional
        None is all.
    steps : int
        Of each walk.
    seed : int
        Of the gaps and of what else is moved on the way.
    progress : callable
        Told each row's name.

    Raises
    ------
    InputError
        mpmath is not installed.
    """
    many_digits()
    found = []
    for number, case in enumerate(all_cases() if cases is None else cases):
        progress(case.name)
        rng = np.random.default_rng([seed, number])
        points = tuple(_run(trial, case) for trial in case.trials(design, rng, steps))
        found.append(CaseResult(case, points, _at_point(case, design)))
    return HardCases(design, seed, tuple(found), near_cases(design))


def _at_point(case: HardCase, design: Design) -> AtPoint | None:
    if case.point is None:
        return None
    finite, infinite, faults = 0, [], []
    for name, given in case.point(design):
        function = getattr(theory, name)
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


def _run(trial: Trial, case: HardCase) -> Point:
    try:
        got = flat(trial.ours(**trial.given))
    except (ArithmeticError, ValueError) as error:
        # A walk must not end in an exception: it is told as a fault, whatever it was.
        return Point(trial.function, trial.gap, Judged(0.0, 0.0, 0.0), _naive(trial), f"raised {error}")
    conditioned = case.budget(trial.function).conditioned
    judged = _judge(trial, got, conditioned)
    unreal = not math.isfinite(judged.ulps)
    fault = "not a number, or infinite where the exact value is not" if unreal else ""
    return Point(trial.function, trial.gap, judged, _naive(trial), fault)


def _judge(trial: Trial, got: list[Any], conditioned: bool) -> Judged:
    if trial.scale is None:
        return judge(trial.exact, got, trial.given, enough=0.5 if conditioned else math.inf)
    mp = many_digits()
    with mp.workdps(DIGITS):
        truths = flat(trial.exact(**{name: exactly(value) for name, value in trial.given.items()}))
        unit = last_place(mp.mpf(trial.scale(**trial.given)))
        off = [abs(exactly(value) - truth) for value, truth in zip(got, truths, strict=True)]
        error = max(off)
        top = max(abs(truth) for truth in truths)
        return Judged(float(error / unit), float(error / top) if top else float(error / unit / 2**52), 0.0)


def _naive(trial: Trial) -> float:
    """Largest relative error of the textbook formula in double precision."""
    if trial.naive is None:
        return math.nan
    mp = many_digits()
    with mp.workdps(DIGITS):
        truths = flat(trial.exact(**{name: exactly(value) for name, value in trial.given.items()}))
    try:
        with np.errstate(all="ignore"):
            values = flat(trial.naive(**trial.given))
    except (ArithmeticError, ValueError):
        return FAILED
    worst = 0.0
    for value, truth in zip(values, truths, strict=True):
        if isinstance(truth, bool) or mp.isinf(truth):
            worst = worst if value == truth else FAILED
        elif isinstance(value, complex) or not math.isfinite(value):
            return FAILED
        elif truth != 0:
            worst = max(worst, float(abs((mp.mpf(float(value)) - truth) / truth)))
        elif value != 0:
            return FAILED
    return worst
