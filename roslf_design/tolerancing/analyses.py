"""Analysis of trials: yields, distributions, sensitivities, Sobol indices, inverse tolerances.

What is undefined is counted beside: it fails every limit and is never averaged away.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import takewhile
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, by_value, ratio
from ..camera import Camera
from ..theory import chief_rays
from ..theory.quantities import QUANTITIES
from ..theory.quantity import finite, from_finite
from .draws import Draws, sobol_points
from .metrics import METRICS, mount_of
from .places import of_parts
from .run import Tally, quantiles, rebin
from .study import TolerancePlan
from .trials import BLOCK, differences, final_faults, measure, measure_finally

CONFIDENCE = 0.95
"""Confidence level of every interval."""
SCALES = (0.25, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0, 2.8, 4.0)
"""Factors on all tolerances at once, for the yield curve."""
CURVE_TRIALS, CURVE_TRIALS_ADJUSTED = 16384, 4096
"""Trials for each point of a curve; fewer where each trial is adjusted."""
HISTOGRAM_BINS = 60
STEP = 1e-4
"""Step of numerical derivatives, in tolerances: small enough that a central difference errs far below a percent."""
IMAGINARY = 1e-40
"""Step for exact derivatives, as a share of the number; its square vanishes against 1."""
LOOSEST = 1e3
"""Inverse sensitivity stops looking beyond this many times the given tolerance."""
HALVINGS = 40
"""Steps of its bisection, the first ones doublings: six digits and more."""
LINEAR = 0.1
"""|RSS / Monte Carlo - 1| above which a response counts as not linear."""
RESAMPLES = 256
"""Bootstrap samples of Sobol indices."""
LOST = 8
"""Builds that a wanted yield loses at least among those that a change is searched by: fewer tell it from no other."""
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
    return min(CURVE_TRIALS_ADJUSTED if plan.adjusters else CURVE_TRIALS, max(plan.trials, 256))


def yield_at(plan: TolerancePlan, scale: float, trials: int) -> Yield:
    """Yield with all tolerances times `scale`; the same draws at every scale."""
    return Yield(sum(_passing(plan, scale, first_draws(plan.draws, trials))), trials)


def _passing(plan: TolerancePlan, scale: float, deviations: Array) -> Iterator[int]:
    """How many builds hold all limits, block by block."""
    for at in range(0, deviations.shape[1], BLOCK):
        block = measure_finally(plan, deviations[:, at : at + BLOCK], scale)
        yield int(plan.passes(block).all(axis=0).sum())


@lru_cache(maxsize=4)
def first_draws(draws: Draws, trials: int) -> Array:
    """Deviations of the first trials, which a curve's every point shares."""
    return draws.deviations(draws.uniforms(0, trials))


def fresh(draws: Draws) -> Draws:
    """Draws with another seed, independent of the run's: they judge what was tuned on the first."""
    seed = np.random.SeedSequence(draws.seed, spawn_key=(2**32 + 1,)).generate_state(1, np.uint64)
    return replace(draws, seed=int(seed[0]))


def search_trials(trials: int, target: float) -> int:
    """Trials that tell a wanted yield from a smaller one: so many, or more where it is near 1."""
    return max(trials, math.ceil(LOST / (1 - target)))


def least_passed(share: float, trials: int) -> int:
    """Fewest trials that must pass for the interval of their yield to begin at a share; one too many where none do."""
    return bisect_left(range(trials + 1), share, key=lambda passed: Yield(passed, trials).interval[0])


def promised(
    search: Callable[[float], T | None], judged: Callable[[T], Yield], target: float
) -> tuple[T, Yield] | None:
    """Best candidate whose yield surely reaches the target, with that yield on fresh draws; None where there is none.

    Whatever was tuned until some builds hold a target holds it better on these than on others. So the search aims at
    the lower end of the yield's interval, other builds judge, and where these fall short it aims higher by as much.

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
    for _ in range(ROUNDS):
        best = search(aim)
        if best is None:
            return None
        result = judged(best)
        if result.interval[0] >= target:
            return best, result
        aim += target - result.interval[0]
    return None


def yield_curve(plan: TolerancePlan, own: Yield | None = None) -> tuple[tuple[float, Yield], ...]:
    """Yield over a common factor on all tolerances; at 1 the run's `own` where there is one."""
    return tuple(
        (scale, own if own is not None and scale == 1.0 else yield_at(plan, scale, curve_trials(plan)))
        for scale in SCALES
    )


def scale_for_yield(
    plan: TolerancePlan, target: float, curve: Sequence[tuple[float, Yield]] = ()
) -> tuple[float, Yield] | None:
    """Largest common factor on all tolerances, up to 64, whose yield is the target for sure.

    Parameters
    ----------
    plan : TolerancePlan
    target : float
    curve : sequence of (factor, yield)
        As `yield_curve` gives it, in rising factors: below its last point on the target, and above its first one under
        it, nothing is measured again.

    Returns
    -------
    (factor, yield) or None
        None where even a thousandth of the tolerances misses the target: the nominal design is at fault. The yield is
        `promised`: that of other draws than the factor was found by, its interval not below the target.
    """
    trials = search_trials(curve_trials(plan), target)

    def largest(aim: float) -> float | None:
        least, loose, tight = least_passed(aim, trials), 64.0, 1e-3
        held = [scale for scale, _ in takewhile(lambda point: point[1].interval[0] >= aim, curve)]
        sure, lost = held[-1] if held else tight, curve[len(held)][0] if len(held) < len(curve) else math.inf

        def reaches(scale: float) -> bool:
            if scale >= lost or tight < scale <= sure:
                return scale < lost
            passed, left = 0, trials
            for count in _passing(plan, scale, first_draws(plan.draws, trials)):  # until it is settled
                passed, left = passed + count, max(left - BLOCK, 0)
                if passed >= least or passed + left < least:
                    break
            return passed >= least

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
        return Yield(sum(_passing(plan, scale, first_draws(fresh(plan.draws), FRESH * trials))), FRESH * trials)

    return promised(largest, judged, target)


@dataclass(frozen=True)
class _ColumnSummary:
    """Summary of one column over the trials of one variant."""

    label: str
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
        if not METRICS[self.label.partition("@")[0]].infinite:
            return data
        nominal, least, greatest = (float(ratio(1.0, value)) for value in (self.nominal, self.low, self.high))
        quantiles, cuts = (ratio(1.0, np.array(values)).tolist() for values in (self.quantiles, self.cuts))
        inverse = {"nominal": nominal, "least": least, "greatest": greatest}
        return data | {"inverse": inverse | {"quantiles": dict(zip(ranks, quantiles, strict=True)), "cuts": cuts}}


@dataclass(frozen=True)
class _LimitYield:
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
    limits: tuple[_LimitYield, ...]
    distributions: tuple[_ColumnSummary, ...]

    @property
    def weakest(self) -> _LimitYield:
        """The limit that fails most often; among those that never fail, the one whose room scatter uses most of."""
        columns = {column.label: column for column in self.distributions}

        def strength(limit: _LimitYield) -> tuple[int, float]:
            column = columns[limit.label]
            told = finite if math.isinf(column.high) or math.isinf(column.nominal) else np.asarray
            here, low, high = (float(told(value)) for value in (column.nominal, column.low, column.high))
            rooms = [abs(float(told(edge)) - here) for edge in (limit.low, limit.high) if np.isfinite(edge)]
            return limit.result.passed, min(rooms) / max(high - low, 1e-300)

        return min(self.limits, key=strength)

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
                _LimitYield(
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


def _summary(plan: TolerancePlan, tally: Tally, v: int, c: int) -> _ColumnSummary:
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
    histogram = rebin(counts, np.array([-np.inf, *places[1:-1], np.inf])) if len(places) else np.empty(0)
    histogram[-1:] += past
    return _ColumnSummary(
        label=plan.columns[c].label,
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


@by_value
@dataclass(frozen=True)
class Sensitivity:
    """Derivatives and finite moves of every column. V variants, C columns, P perturbations."""

    derivatives: Array
    """As built, by central differences [column's unit per mm or rad], shape (C, P)."""
    exact: Array
    """Derivatives from closed forms, NaN where there is none, shape (C, P)."""
    plus: Array
    minus: Array
    """Change of the column at the two ends of the tolerance, as built and after adjustment, shape (V, C, P); NaN where
    undefined, 0 from infinity to infinity."""
    twin_derivatives: Array
    twin_plus: Array
    twin_minus: Array
    """Derivatives of the finite twins of columns that may be infinite, and of all other columns themselves."""

    @property
    def worst(self) -> Array:
        """Larger of the two moves of the twins, shape (V, C, P); infinite where the column becomes undefined."""
        size = np.maximum(np.abs(self.twin_plus), np.abs(self.twin_minus))
        return np.where(np.isnan(size), np.inf, size)


def sensitivity(plan: TolerancePlan) -> Sensitivity:
    """Sensitivity of each column to each perturbation alone."""
    perturbations = plan.draws.perturbations
    steps = [(p.place, STEP * p.tolerance) for p in perturbations]
    derivatives = twins = differences(plan, steps)
    one, here = np.eye(len(perturbations)), plan.nominal[:, None]
    ends = [measure(plan, sign * one, settled=0.0).variants for sign in (1.0, -1.0)]
    with np.errstate(invalid="ignore"):
        plus, minus = moves = [np.where(np.isinf(end) & (end == here), 0.0, end - here) for end in ends]
    if plan.infinite.any():
        twins = differences(plan, steps, judged=True)
        moves = [np.stack([plan.judged(variant) for variant in end]) - plan.judged(here) for end in ends]
    return Sensitivity(derivatives, exact_derivatives(plan), plus, minus, twins, *moves)


def exact_derivatives(plan: TolerancePlan) -> Array:
    """Derivatives of the closed forms by each perturbed place, shape (C, P); NaN where there is none.

    Of an aligned design behind an ideal lens, whose fields all have the same value, by complex steps: no difference, so
    nothing cancels. A pose changes what is local to a field; by those there are none.
    """
    perturbations, design = plan.draws.perturbations, plan.question.design
    exact = np.full((len(plan.columns), len(perturbations)), np.nan)
    if not mount_of(design).in_closed_form(design):
        return exact
    steps = IMAGINARY * np.array([abs(p.nominal) or 1.0 for p in perturbations])
    at = {p.place: p.nominal + 1j * row for p, row in zip(perturbations, np.diag(steps), strict=True)}
    camera = Camera.of(design).replace(of_parts(design, at))
    posed = [any(word in p.place for word in ("decentre", "tilt", "rotation")) for p in perturbations]
    for row, column in enumerate(plan.columns):
        quantity = QUANTITIES.get(column.metric)
        if quantity is not None and quantity.analytic and not (quantity.traced and chief_rays.traced(camera)):
            exact[row] = np.broadcast_to(np.imag(quantity(camera)), steps.shape) / steps
            if column.field is not None:
                exact[row, posed] = np.nan
    return exact


def root_sum_square(plan: TolerancePlan, moves: Sensitivity) -> Array:
    """Standard deviation of every column if it were linear in the perturbations, shape (C,)."""
    slopes = np.where(np.isfinite(moves.exact), moves.exact, moves.derivatives)
    variance = np.einsum("ci,ij,cj->c", slopes, plan.draws.covariance(), slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


@dataclass(frozen=True)
class RssRow:
    """Root sum of squares beside Monte Carlo, as built."""

    column: str
    rss: float
    monte_carlo: float
    """Standard deviation; NaN where trials are undefined."""
    ratio: float
    """Monte Carlo over RSS; infinite where only Monte Carlo scatters."""
    mean_shift: float
    """Mean less nominal: 0 for a linear response."""
    linear: bool
    """Whether the RSS figure may be used."""


def rss_rows(plan: TolerancePlan, moves: Sensitivity, as_built: Variant) -> Iterator[RssRow]:
    """Every column's root sum of squares beside its scatter."""
    for column, rss in zip(as_built.distributions, root_sum_square(plan, moves).tolist(), strict=True):
        spread, shift = column.deviation, column.mean - column.nominal
        ratio = math.nan if math.isnan(rss) else spread / rss if rss > 0 else math.inf if spread > 0 else 1.0
        linear = abs(ratio - 1) <= LINEAR and abs(shift) <= LINEAR * max(rss, 1e-300)
        yield RssRow(column.label, rss, spread, ratio, shift, linear)


@dataclass(frozen=True)
class Allowed:
    """Allowed half-widths of one perturbation: alone until a limit fails, and as its share of the limits' room."""

    place: str
    tolerance: float
    """Half-width that uses no more than the study's share of any limit's room [mm or rad]; infinite where nothing up to
    `LOOSEST` times the given one does."""
    given: float
    limited_by: str
    """Label of the column whose share binds, or why the build is no camera beyond; empty where nothing binds."""
    alone: float
    """Half-width at which, all else nominal, the first limit fails."""
    alone_limited_by: str


def inverse_sensitivity(plan: TolerancePlan, share: float) -> tuple[Allowed, ...]:
    """Largest tolerance of each perturbation alone: until a limit fails, and until it uses a share of a limit's room.

    By bisection on the real response, not from a derivative: margins and decentres bend. Where something is adjusted,
    what is left after adjustment counts.

    Raises
    ------
    ValueError
        The nominal design itself does not hold a limit.
    """
    misses = plan.nominal_misses()
    if misses:
        raise ValueError(f"the nominal design misses its own limits: {', '.join(misses)}")
    perturbations, limits = plan.draws.perturbations, plan.limits
    # One case for each perturbation, end of its tolerance and part of the room: all of it, the share.
    rows, ends, parts = (part.ravel() for part in np.indices((len(perturbations), 2, 2)))
    cases = np.arange(rows.size)
    columns = np.array([limit.column for limit in limits])
    here = plan.judged(plan.nominal[columns, None], columns)
    room = np.where(parts == 0, 1.0, share)
    low, high = (
        np.where(np.isfinite(edge), np.where(parts == 0, twin, here + room * (twin - here)), edge)
        for edge in np.array([(limit.low, limit.high) for limit in limits]).T[..., None]
        for twin in [plan.judged(edge, columns)]
    )
    inside, outside = np.zeros(rows.size), np.full(rows.size, np.inf)
    trial, broken = np.ones(rows.size), np.zeros(rows.size, np.intp)
    for _ in range(HALVINGS):
        deviations = np.zeros((len(perturbations), rows.size))
        deviations[rows, cases] = np.where(ends == 0, trial, -trial)
        value = plan.judged(measure_finally(plan, deviations, settled=0.0)[columns], columns)
        good = (value >= low) & (value <= high)
        held = good.all(axis=0)
        broken = np.where(held, broken, np.argmin(good, axis=0))
        inside, outside = np.where(held, trial, inside), np.where(held, outside, trial)
        trial = np.where(
            np.isinf(outside), np.minimum(2 * inside, LOOSEST), (inside + np.minimum(outside, LOOSEST)) / 2
        )
    deviations = np.zeros((len(perturbations), rows.size))
    deviations[rows, cases] = np.where(ends == 0, 1.0, -1.0) * np.where(np.isfinite(outside), outside, 0.0)
    faults = np.empty(rows.size, dtype=object)
    faults[:] = final_faults(plan, deviations)
    faults = faults.reshape(len(perturbations), 2, 2)
    widths, broken = (part.reshape(len(perturbations), 2, 2) for part in (inside, broken))

    def narrower(index: int, part: int) -> tuple[float, str]:
        end = int(np.argmin(widths[index, :, part]))
        width = float(widths[index, end, part])
        if width >= LOOSEST * (1 - 1e-9):
            return math.inf, ""
        fails = plan.columns[limits[broken[index, end, part]].column].label
        return width * perturbations[index].tolerance, ", ".join(faults[index, end, part]) or fails

    allowed = []
    for index, p in enumerate(perturbations):
        (alone, fails), (tolerance, binds) = narrower(index, 0), narrower(index, 1)
        allowed.append(Allowed(p.place, tolerance, p.tolerance, binds, alone, fails))
    return tuple(allowed)


@by_value
@dataclass(frozen=True)
class SobolIndices:
    """Indices of C columns for F independent factors, with bootstrap intervals. NaN rows where a column has none."""

    factors: tuple[str, ...]
    """A free perturbation, a group that moves together, or a partly tied member's own part."""
    evaluations: int
    first: Array
    """Share of the variance that a factor explains alone, shape (C, F)."""
    first_interval_95: Array
    """Lower and upper end, shape (C, F, 2)."""
    total: Array
    """Share with all its interactions, shape (C, F)."""
    total_interval_95: Array
    undefined_evaluations: NDArray[np.int64]
    """Builds in which a column was undefined, shape (C,); its indices are then NaN rather than of the rest."""


def sobol_indices(plan: TolerancePlan, samples: int) -> SobolIndices:
    """Sobol indices of every column, as finally adjusted: whose scatter its scatter comes from.

    Of what may be infinite those of its finite twin. Of n = `samples` base samples on a scrambled Sobol sequence,
    n (F + 2) builds in all.
    """
    factors = plan.draws.factors
    count = len(factors)
    a, b = np.split(sobol_points(2 * count, 0, samples, plan.draws.seed), 2)
    mixed = (np.where(np.arange(count)[:, None] == index, b, a) for index in range(count))  # one at a time in memory
    samples_of = (plan.draws.deviations(uniforms) for uniforms in itertools.chain((a, b), mixed))
    columns = np.stack([plan.judged(measure_finally(plan, deviations)) for deviations in samples_of])
    undefined = np.isnan(columns).sum(axis=(0, 2))
    indices = saltelli_jansen(columns[0], columns[1], columns[2:], plan.draws.seed)
    for part in indices:
        part[undefined > 0] = np.nan
    return SobolIndices(factors, samples * (count + 2), *indices, undefined)


def saltelli_jansen(f_a: Array, f_b: Array, f_ab: Array, seed: int) -> tuple[Array, Array, Array, Array]:
    """First-order indices (Saltelli 2010) and their intervals, total ones (Jansen 1999) and theirs.

    Parameters
    ----------
    f_a, f_b : ndarray, shape (C, n)
        Responses to the two base samples.
    f_ab : ndarray, shape (F, C, n)
        To the first one with one factor each from the second.
    seed : int
        Of the resampling of base samples.
    """
    columns, n = f_a.shape
    factors = len(f_ab)
    usable = np.asarray(np.isfinite(np.stack([f_a, f_b, *f_ab])).all(axis=(0, 2)))
    middle = np.where(usable, 0.5 * (f_a.mean(axis=1) + f_b.mean(axis=1)), 0.0)
    ya, yb, yab = (np.where(usable[:, None], f, 0.0) - middle[:, None] for f in (f_a, f_b, f_ab))
    # One row a base sample: what is summed for sum y, sum y^2, first and total.
    sums_of = [(ya + yb)[None], (ya * ya + yb * yb)[None], yb * (yab - ya), 0.5 * (ya - yab) ** 2]
    terms = np.concatenate(sums_of).reshape(-1, n)
    stream = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(2**32,))))
    weights = np.concatenate([np.ones((1, n)), stream.multinomial(n, np.full(n, 1 / n), size=RESAMPLES)]) / n
    sums = np.einsum("rn,kn->rk", weights, terms).reshape(len(weights), 2 + 2 * factors, columns)
    variance = 0.5 * sums[:, 1] - (0.5 * sums[:, 0]) ** 2
    still = variance <= 1e-24 * np.maximum(middle**2, 1e-30)
    ratios = np.where(still[:, None], 0.0, sums[:, 2:] / np.where(still, 1.0, variance)[:, None])
    ratios = np.moveaxis(ratios, 2, 1)
    ends = np.quantile(ratios[1:], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    first, total = np.split(ratios[0], 2, axis=1)
    first_ends, total_ends = np.split(np.moveaxis(ends, 0, -1), 2, axis=1)
    return first.copy(), first_ends.copy(), total.copy(), total_ends.copy()
