"""Yields: shares of builds that hold every limit, with their intervals, over a common factor on all tolerances."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import takewhile
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from .draws import Draws
from .study import TolerancePlan
from .trials import BLOCK, holding

CONFIDENCE = 0.95
"""Confidence level of every interval."""
SCALES = (0.25, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0, 2.8, 4.0)
"""Factors on all tolerances at once, for the yield curve."""
_DEPTH = dict(zip(SCALES, (0, 4, 3, 4, 2, 4, 3, 1, 4, 3, 4, 0), strict=True))
"""Order in which they halve what is between those measured before: both ends first."""
CURVE_TRIALS, CURVE_TRIALS_ADJUSTED = 16384, 4096
"""Trials for each point of a curve; fewer where each trial is adjusted."""
DEAR = 8
"""How many times fewer they are of builds that take a millisecond: the interval says what that leaves unsure."""
MOST_SCALE = 64.0
"""Largest factor on all tolerances that is tried."""
LOST = 8
"""Builds that a target yield loses at least among those that a change is searched by: fewer tell it from no other."""
EARLIEST = 8
"""Share of the builds, one in so many, that is asked alone whether too many fail."""
FRESH, ROUNDS = 4, 6
"""How many times as many builds a change is judged by as it was searched by, and how often it is searched anew."""
T = TypeVar("T")


@dataclass(frozen=True)
class Yield:
    """A measured yield, the share of builds that hold every limit, with its interval."""

    passed: int
    trials: int

    @property
    def value(self) -> float:
        """Share that passed; 0 of none."""
        return self.passed / max(self.trials, 1)

    @property
    def standard_error(self) -> float:
        """Standard error of the share, of builds drawn at random."""
        return math.sqrt(self.value * (1 - self.value) / max(self.trials, 1))

    @property
    def interval(self) -> tuple[float, float]:
        """Exact binomial interval (Clopper-Pearson, 95 %); too wide, never too narrow, for Sobol sampling."""
        from scipy.special import betaincinv

        tail, failed = (1 - CONFIDENCE) / 2, self.trials - self.passed
        low = float(betaincinv(self.passed, failed + 1, tail)) if self.passed else 0.0
        high = float(betaincinv(self.passed + 1, failed, 1 - tail)) if failed else 1.0
        return low, high

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {"yield": self.value, "interval_95": self.interval, "trials": self.trials}


def curve_trials(plan: TolerancePlan) -> int:
    """Trials that a point of a curve is worth."""
    most = CURVE_TRIALS_ADJUSTED if plan.adjusters else CURVE_TRIALS
    return min(most // DEAR if plan.dear else most, max(plan.trials, 256))


def yield_at(plan: TolerancePlan, scale: float, trials: int) -> Yield:
    """Yield with all tolerances times `scale`; the same draws at every scale."""
    return Yield(int(_passing(plan, scale, first_draws(plan.draws, trials)).sum()), trials)


def _passing(plan: TolerancePlan, scale: float, deviations: Array) -> NDArray[np.bool_]:
    """True where a build holds all limits, shape (T,)."""
    blocks = range(0, deviations.shape[1], BLOCK)
    parts = (holding(plan, deviations[:, at : at + BLOCK], scale) for at in blocks)
    return np.concatenate([np.ones(0, np.bool_), *parts])


class ScaledBuilds:
    """The first trials' builds at factors on all tolerances; those measured before bracket the next.

    A build that holds its limits at two factors, or misses them at both, is taken to do so between them: only those
    that change within the bracket are measured. At 0 every build is the nominal design.
    """

    def __init__(self, plan: TolerancePlan, draws: Draws, trials: int) -> None:
        self._plan, self._deviations = plan, first_draws(draws, trials)
        self._holding: dict[float, NDArray[np.bool_]] = {}
        if not plan.nominal_misses():
            self._holding[0.0] = np.ones(trials, np.bool_)

    @property
    def trials(self) -> int:
        """Number of builds."""
        return int(self._deviations.shape[1])

    def passed(self, scale: float, wanted: float = math.inf) -> int:
        """Number of builds that hold all limits at a factor; where so many as wanted seem to, every one is measured."""
        tighter = max((known for known in self._holding if known <= scale), default=None)
        looser = min((known for known in self._holding if known >= scale), default=None)
        if tighter is None or looser is None:
            holds = _passing(self._plan, scale, self._deviations)
        else:
            holds = self._holding[tighter].copy()
            changing = np.flatnonzero(holds != self._holding[looser])
            holds[changing] = _passing(self._plan, scale, self._deviations[:, changing])
            if holds.sum() >= wanted:
                holds = _passing(self._plan, scale, self._deviations)
        self._holding[scale] = holds
        return int(holds.sum())


@lru_cache(maxsize=4)
def first_draws(draws: Draws, trials: int) -> Array:
    """Deviations of the first trials, which a curve's every point shares."""
    return draws.deviations(draws.uniforms(0, trials))


def fresh(draws: Draws) -> Draws:
    """Draws with another seed, independent of the run's: they judge what was tuned on the first."""
    seed = np.random.SeedSequence(draws.seed, spawn_key=(2**32 + 1,)).generate_state(1, np.uint64)
    return replace(draws, seed=int(seed[0]))


def search_trials(trials: int, target: float) -> int:
    """Trials that tell a target yield from a smaller one: so many, or more where it is near 1."""
    return max(trials, math.ceil(LOST / (1 - target)))


def least_passed(share: float, trials: int) -> int:
    """Fewest trials that must pass for the interval of their yield to begin at a share; one too many where none do."""
    return bisect_left(range(trials + 1), share, key=lambda passed: Yield(passed, trials).interval[0])


def failures(fails: Callable[[Array], NDArray[np.bool_]], deviations: Array, most: float) -> int | None:
    """Number of builds, given by their deviations (P, trials), that fail; None where more than `most` do.

    The first of them tell that in most cases.
    """
    failed = 0
    for some in np.split(deviations, [deviations.shape[1] // EARLIEST], axis=1):
        failed += int(fails(some).sum()) if some.size else 0
        if failed > most:
            return None
    return failed


def promised(
    search: Callable[[float], T | None], judged: Callable[[T], Yield], target: float
) -> tuple[T, Yield] | None:
    """Best candidate whose yield surely reaches the target, with that yield on fresh draws; None where there is none.

    Whatever was tuned until some builds hold a target holds it better on these than on others. So the search aims at
    the lower end of the yield's interval, other builds judge, and where these fall short it aims higher by as much, and
    by 1, 2, 4, ... of the builds searched on at least, up to what all of these tell.

    Parameters
    ----------
    search : callable
        From the share that the interval's lower end is to reach, on its own builds, to the best that does; None where
        nothing does.
    judged : callable
        Its yield on `fresh` draws.
    target : float
        Wanted yield.
    """
    aim = target
    for tried in range(ROUNDS):
        best = search(aim)
        if best is None:
            return None
        result = judged(best)
        if result.interval[0] >= target:
            return best, result
        before, searched = aim, result.trials // FRESH
        aim += max(target - result.interval[0], 2**tried / searched)
        aim = min(aim, Yield(searched, searched).interval[0])
        if aim <= before:
            return None
    return None


def yield_curve(builds: ScaledBuilds, own: Yield | None = None) -> tuple[tuple[float, Yield], ...]:
    """Yield over a common factor on all tolerances; at 1 the run's `own` where there is one."""
    yields = {} if own is None else {1.0: own}
    for scale in sorted(SCALES, key=_DEPTH.__getitem__):  # each within a bracket of two before it
        if scale not in yields:
            yields[scale] = Yield(builds.passed(scale), builds.trials)
    return tuple((scale, yields[scale]) for scale in SCALES)


def scale_for_yield(
    plan: TolerancePlan,
    target: float,
    curve: Sequence[tuple[float, Yield]] = (),
    measured: ScaledBuilds | None = None,
) -> tuple[float, Yield] | None:
    """Largest common factor on all tolerances, up to 64, whose yield is the target for sure.

    Parameters
    ----------
    plan : TolerancePlan
    target : float
    curve : sequence of (factor, yield)
        As `yield_curve` gives it, in rising factors: below its last point on the target, and above its first one under
        it, nothing is measured again.
    measured : ScaledBuilds, optional
        Builds that it was measured by: of as many as are searched by here, none is measured twice.

    Returns
    -------
    (factor, yield) or None
        None where even a thousandth of the tolerances misses the target: the nominal design is at fault. The yield is
        `promised`: that of other draws than the factor was found by, its interval not below the target.
    """
    trials = search_trials(curve_trials(plan), target)
    if measured is None or measured.trials != trials:
        measured = ScaledBuilds(plan, plan.draws, trials)
    builds = measured
    others = ScaledBuilds(plan, fresh(plan.draws), FRESH * trials)

    def largest(aim: float) -> float | None:
        least, loose, tight = least_passed(aim, trials), MOST_SCALE, 1e-3
        held = [scale for scale, _ in takewhile(lambda point: point[1].interval[0] >= aim, curve)]
        sure, lost = held[-1] if held else 0.0, curve[len(held)][0] if len(held) < len(curve) else math.inf

        def reaches(scale: float) -> bool:
            if scale >= lost or scale <= sure:
                return scale < lost
            return builds.passed(scale) >= least

        if not reaches(tight):
            return None
        if reaches(loose):
            return loose
        while loose / tight >= 1.001:
            middle = float(np.sqrt(loose * tight))
            if reaches(middle):
                tight = middle
            else:
                loose = middle
        return tight

    def judged(scale: float) -> Yield:
        return Yield(others.passed(scale, least_passed(target, others.trials)), others.trials)

    return promised(largest, judged, target)
