"""What a run of trials says: yields, and the distribution of every metric, with what is undefined counted beside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import sketch
from .chunk import variants_of
from .plan import Limit, Plan
from .tally import Tally
from .yields import Yield

Array = NDArray[np.float64]

HISTOGRAM_BINS = 60


@dataclass(frozen=True)
class Distribution:
    """One column over the trials of one variant."""

    label: str
    nominal: float
    undefined: int
    """Trials in which it has no value; they count as failures of every limit on it."""
    mean: float
    deviation: float
    """Standard deviation. Both NaN where any trial is undefined: an average of the rest would flatter."""
    low: float
    high: float
    """Least and greatest defined value."""
    probabilities: tuple[float, ...]
    quantiles: tuple[float, ...]
    """Undefined trials rank as worst: beyond the limit on that side (infinite there), above all where there is none."""
    cuts: tuple[float, ...]
    histogram: tuple[float, ...]
    """Defined trials between neighbouring cuts."""


@dataclass(frozen=True)
class LimitYield:
    """One limit alone."""

    label: str
    low: float
    high: float
    result: Yield


@dataclass(frozen=True)
class Variant:
    """The builds as they come, or after adjustment."""

    name: str
    result: Yield
    """All limits together."""
    limits: tuple[LimitYield, ...]
    distributions: tuple[Distribution, ...]

    @property
    def weakest(self) -> LimitYield:
        """The limit that fails most often; among those that never fail, the one whose room scatter uses most of."""
        columns = {column.label: column for column in self.distributions}

        def strength(limit: LimitYield) -> tuple[int, float]:
            column = columns[limit.label]
            rooms = [abs(edge - column.nominal) for edge in (limit.low, limit.high) if np.isfinite(edge)]
            return limit.result.passed, min(rooms) / max(column.high - column.low, 1e-300)

        return min(self.limits, key=strength)


def summarise(plan: Plan, tally: Tally) -> tuple[Variant, ...]:
    """Every variant of a run."""
    nominal = plan.nominal
    return tuple(_variant(plan, tally, nominal, v, name) for v, name in enumerate(variants_of(plan)))


def correlations(tally: Tally) -> Array:
    """Correlation of each column (final variant, where defined) with each perturbation, shape (C, P); 0 where still."""
    n = tally.trials - tally.undefined[-1][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_x, mean_y = tally.x / n, tally.total[-1][:, None] / n
        var_x = tally.xx / n - mean_x**2
        var_y = tally.square[-1][:, None] / n - mean_y**2
        found = (tally.xy / n - mean_x * mean_y) / np.sqrt(var_x * var_y)
    return np.where(np.isfinite(found), found, 0.0)


def _variant(plan: Plan, tally: Tally, nominal: Array, v: int, name: str) -> Variant:
    limits = tuple(
        LimitYield(plan.columns[limit.column].label, limit.low, limit.high, Yield(int(held), tally.trials))
        for limit, held in zip(plan.limits, tally.held[v], strict=True)
    )
    columns = tuple(_distribution(plan, tally, nominal, v, c) for c in range(len(plan.columns)))
    return Variant(name, Yield(int(tally.passed[v]), tally.trials), limits, columns)


def _distribution(plan: Plan, tally: Tally, nominal: Array, v: int, c: int) -> Distribution:
    here = float(nominal[c]) if np.isfinite(nominal[c]) else 0.0
    undefined, counts = int(tally.undefined[v, c]), tally.counts[v, c]
    defined = tally.trials - undefined
    low, high = float(tally.low[v, c]), float(tally.high[v, c])
    worst_is_low = _worst_is_low([limit for limit in plan.limits if limit.column == c])
    below, above = (undefined, 0) if worst_is_low else (0, undefined)
    found = sketch.quantiles(counts, plan.quantiles, low, high, below, above)
    mean = deviation = float("nan")
    if not undefined:
        shift = float(tally.total[v, c]) / defined
        mean = here + shift
        deviation = float(np.sqrt(max(float(tally.square[v, c]) / defined - shift**2, 0.0)))
    cuts: tuple[float, ...] = ()
    bars: tuple[float, ...] = ()
    if defined and high > low:
        places = np.linspace(low, high, HISTOGRAM_BINS + 1)
        inner = places.copy()
        inner[0], inner[-1] = -np.inf, np.inf
        bars = tuple(float(bar) for bar in sketch.rebin(counts, inner))
        cuts = tuple(float(here + place) for place in places)
    return Distribution(
        label=plan.columns[c].label,
        nominal=float(nominal[c]),
        undefined=undefined,
        mean=mean,
        deviation=deviation,
        low=here + low if defined else float("nan"),
        high=here + high if defined else float("nan"),
        probabilities=plan.quantiles,
        quantiles=tuple(here + q for q in found),
        cuts=cuts,
        histogram=bars,
    )


def _worst_is_low(limits: list[Limit]) -> bool:
    return any(np.isfinite(limit.low) for limit in limits) and not any(np.isfinite(limit.high) for limit in limits)
