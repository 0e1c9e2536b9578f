"""Summaries of trials: distributions, limits' yields, correlations.

What is undefined is counted beside: it fails every limit and is never averaged away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._arrays import Array, ratio
from ..theory.quantity import finite, from_finite
from .metrics import Column
from .study import TolerancePlan
from .tally import Tally, quantiles, rebin
from .yields import Yield

HISTOGRAM_BINS = 60
MIDDLE, FAR = (0.01, 0.99), 5.0
"""Ends of the 98 % of builds that a histogram's steps are for where all builds reach `FAR` times as far."""


@dataclass(frozen=True)
class ColumnSummary:
    """Summary of one column over the trials of one variant."""

    column: Column
    nominal: float
    undefined: int
    """Trials that are cameras in which it has no value; they count as failures of every limit on it."""
    mean: float
    deviation: float
    """Standard deviation. Both over what are cameras; NaN where any of these is undefined: an average of the rest would
    flatter."""
    low: float
    high: float
    """Least and greatest defined value."""
    infinite: int
    """Trials in which it is infinite; quantiles may be, mean and standard deviation are not stated."""
    probabilities: tuple[float, ...]
    quantiles: tuple[float, ...]
    """Undefined trials rank as worst: beyond the limit on that side (infinite there), above all where there is none."""
    cuts: tuple[float, ...]
    histogram: tuple[float, ...]
    """Defined trials between neighbouring cuts, infinite ones below the last."""

    @property
    def label(self) -> str:
        """As results name the column."""
        return self.column.label

    def to_dict(self) -> dict[str, Any]:
        """As results have it, 1 over it beside what may be infinite."""
        ranks = [f"{p:g}" for p in self.probabilities]
        data = {
            "column": self.label,
            "nominal": self.nominal,
            "undefined_trials": self.undefined,
            "infinite_trials": self.infinite,
            "mean": self.mean,
            "standard_deviation": self.deviation,
            "least": self.low,
            "greatest": self.high,
            "quantiles": dict(zip(ranks, self.quantiles, strict=True)),
            "histogram": {"cuts": self.cuts, "trials": self.histogram},
        }
        if not self.column.quantity.infinite:
            return data
        nominal, least, greatest = (float(ratio(1.0, value)) for value in (self.nominal, self.low, self.high))
        quantiles, cuts = (ratio(1.0, np.array(values)).tolist() for values in (self.quantiles, self.cuts))
        inverse = {"nominal": nominal, "least": least, "greatest": greatest}
        return data | {"inverse": inverse | {"quantiles": dict(zip(ranks, quantiles, strict=True)), "cuts": cuts}}


@dataclass(frozen=True)
class LimitYield:
    """One limit alone, over the builds that are cameras."""

    label: str
    low: float
    high: float
    result: Yield

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {"column": self.label, "min": self.low, "max": self.high, **self.result.to_dict()}


@dataclass(frozen=True)
class Variant:
    """The builds as they come, or after adjustment."""

    name: str
    result: Yield
    """All limits together, over all builds."""
    impossible: int
    """Builds that are no cameras: parts collide, a number is beyond what it can be."""
    faults: tuple[tuple[str, int], ...]
    """Why, in words, and in how many, most first; a build may have several reasons."""
    limits: tuple[LimitYield, ...]
    distributions: tuple[ColumnSummary, ...]

    @property
    def weakest(self) -> LimitYield:
        """The limit that fails most often; among those that never fail, the one whose room scatter uses most of."""
        return min(self.limits, key=self.strength)

    def strength(self, limit: LimitYield) -> tuple[int, float]:
        """Builds that hold a limit, and its room over the scatter of what it limits: the weaker the less."""
        column = next(column for column in self.distributions if column.label == limit.label)
        told = finite if math.isinf(column.high) or math.isinf(column.nominal) else np.asarray
        here, low, high = (float(told(value)) for value in (column.nominal, column.low, column.high))
        rooms = [abs(float(told(edge)) - here) for edge in (limit.low, limit.high) if np.isfinite(edge)]
        return limit.result.passed, min(rooms) / max(high - low, 1e-300)

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {
            "name": self.name,
            **self.result.to_dict(),
            "impossible": {"trials": self.impossible, "reasons": dict(self.faults)},
            "limits": [limit.to_dict() for limit in self.limits],
            "distributions": [column.to_dict() for column in self.distributions],
        }


def summarise(plan: TolerancePlan, tally: Tally) -> tuple[Variant, ...]:
    """Every variant of a run."""
    return tuple(
        Variant(
            name,
            Yield(int(tally.passed[v]), tally.trials),
            int(tally.impossible[v]),
            tuple(
                (plan.faults[reason], int(tally.faults[v, reason]))
                for reason in np.argsort(-tally.faults[v], kind="stable")
                if tally.faults[v, reason]
            ),
            tuple(
                LimitYield(
                    plan.columns[limit.column].label,
                    limit.low,
                    limit.high,
                    Yield(int(held), tally.trials - int(tally.impossible[v])),
                )
                for limit, held in zip(plan.limits, tally.held[v], strict=True)
            ),
            tuple(_summary(plan, tally, v, c) for c in range(len(plan.columns))),
        )
        for v, name in enumerate(plan.variants)
    )


def _summary(plan: TolerancePlan, tally: Tally, v: int, c: int) -> ColumnSummary:
    nominal = float(plan.nominal[c])
    here = nominal if math.isfinite(nominal) else 0.0
    undefined, counts = int(tally.undefined[v, c] - tally.impossible[v]), tally.counts[v, c]
    infinite = int(tally.infinite[v, c])
    defined = tally.trials - int(tally.undefined[v, c]) - infinite
    low, high = float(tally.low[v, c]), float(tally.high[v, c])
    limits = [limit for limit in plan.limits if limit.column == c]
    worst_is_low = any(np.isfinite(l.low) for l in limits) and not any(np.isfinite(l.high) for l in limits)
    # Infinite ones are above all finite ones.
    beside = {"below": undefined, "above": infinite} if worst_is_low else {"above": undefined + infinite}
    mean = deviation = math.nan
    if defined and not undefined and not infinite:
        total, square = tally.moments[v, c].tolist()
        shift = total / defined
        mean = here + shift
        deviation = math.sqrt(max(square / defined - shift**2, 0.0))
    places, past = np.linspace(low, high, HISTOGRAM_BINS + 1) if defined and high > low else np.empty(0), 0
    if infinite and defined:  # up to infinity in equal steps of the twin
        places, past = from_finite(np.linspace(float(finite(here + low)), 0.0, HISTOGRAM_BINS + 1)) - here, infinite
    first, last = quantiles(counts, MIDDLE, low, high).tolist()
    if not infinite and len(places) and 0 < last - first < (high - low) / FAR:
        places = np.unique([low, *np.linspace(first, last, HISTOGRAM_BINS - 1), high])
    histogram = rebin(counts, np.array([-np.inf, *places[1:-1], np.inf])) if len(places) else np.empty(0)
    histogram[-1:] += past
    return ColumnSummary(
        column=plan.columns[c],
        nominal=nominal,
        undefined=undefined,
        mean=mean,
        deviation=deviation,
        low=here + low if defined else math.inf if infinite else math.nan,
        high=math.inf if infinite else here + high if defined else math.nan,
        infinite=infinite,
        probabilities=plan.quantiles,
        quantiles=tuple((here + quantiles(counts, plan.quantiles, low, high, **beside)).tolist()),
        cuts=tuple((here + places).tolist()),
        histogram=tuple(histogram.tolist()),
    )


def correlations(tally: Tally) -> Array:
    """Correlation of each column (final variant, where defined) with each perturbation, shape (C, P); 0 where still."""
    n = tally.trials - tally.undefined[-1][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_x, mean_y = tally.x / n, tally.total[-1][:, None] / n
        var_x = tally.xx / n - mean_x**2
        var_y = tally.square[-1][:, None] / n - mean_y**2
        r = (tally.xy / n - mean_x * mean_y) / np.sqrt(var_x * var_y)
    return np.where(np.isfinite(r), r, 0.0)
