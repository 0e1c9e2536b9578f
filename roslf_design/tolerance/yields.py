"""Yield: the share of builds that hold every limit, how sure it is, and what tolerances meet a wanted one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chunk import BLOCK, measure
from .plan import Plan

Array = NDArray[np.float64]

CONFIDENCE = 0.95
SCALES = (0.25, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0, 2.8, 4.0)
"""Of all tolerances at once, for the yield curve."""
TRIALS, TRIALS_ADJUSTED = 16384, 4096
"""Trials for each point of a curve; fewer where each trial is adjusted."""


@dataclass(frozen=True)
class Yield:
    """A measured yield with its interval."""

    passed: int
    trials: int

    @property
    def value(self) -> float:
        """Share that passed."""
        return self.passed / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Exact binomial interval (Clopper-Pearson, 95 %); too wide, never too narrow, for Sobol sampling."""
        return binomial_interval(self.passed, self.trials)


def binomial_interval(passed: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Clopper-Pearson interval of a proportion.

    Parameters
    ----------
    passed, trials : int
        ``0 <= passed <= trials``, ``trials > 0``.
    confidence : float
        At least this much coverage.
    """
    from scipy.special import betaincinv

    tail = (1 - confidence) / 2
    low = float(betaincinv(passed, trials - passed + 1, tail)) if passed else 0.0
    high = float(betaincinv(passed + 1, trials - passed, 1 - tail)) if passed < trials else 1.0
    return low, high


def curve_trials(plan: Plan) -> int:
    """Trials that a point of a curve is worth."""
    return min(TRIALS_ADJUSTED if plan.adjusters else TRIALS, max(plan.trials, 256))


def yield_at(plan: Plan, scale: float, trials: int) -> Yield:
    """Yield with all tolerances times `scale`; the same draws at every scale."""
    deviations = plan.draws.deviations(plan.draws.uniforms(0, trials))
    passed = 0
    for start in range(0, trials, BLOCK):
        seen = measure(plan, deviations[:, start : start + BLOCK], scale)
        passed += int(plan.passes(seen.variants[-1]).all(axis=0).sum())
    return Yield(passed, trials)


def yield_curve(plan: Plan, scales: Sequence[float] = SCALES) -> tuple[tuple[float, Yield], ...]:
    """Yield over a common factor on all tolerances."""
    trials = curve_trials(plan)
    return tuple((scale, yield_at(plan, scale, trials)) for scale in scales)


def scale_for_yield(plan: Plan, target: float) -> tuple[float, Yield] | None:
    """Largest common factor on all tolerances, up to 64, whose yield is still the target.

    Returns
    -------
    (factor, yield) or None
        None where even a thousandth of the tolerances misses the target: the nominal design is at fault. The yield is
        that of `curve_trials` trials with the same draws at every factor, so it falls in steps of one trial.
    """
    trials = curve_trials(plan)
    loose, tight = 64.0, 1e-3
    best = yield_at(plan, tight, trials)
    if best.value < target:
        return None
    whole = yield_at(plan, loose, trials)
    if whole.value >= target:
        return loose, whole
    for _ in range(30):
        middle = float(np.sqrt(loose * tight))
        found = yield_at(plan, middle, trials)
        if found.value >= target:
            tight, best = middle, found
        else:
            loose = middle
        if loose / tight < 1.001:
            break
    return tight, best
