"""Sensitivities: moves by single tolerances, root sums of squares, inverse tolerances, Sobol indices."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, by_value
from ..camera import Camera
from ..progress import UNHEARD, Share
from ..theory.quantities import QUANTITIES
from .draws import sobol_points
from .metrics import mount_of
from .places import FOCUSING, Aim, of_parts
from .study import Adjuster, TolerancePlan
from .summaries import Variant
from .trials import BLOCK, differences, final_faults, measure, measure_finally
from .yields import CONFIDENCE, failures, first_draws

STEP = 1e-4
"""Step of numerical derivatives, in tolerances: small enough that a central difference errs far below a percent."""
IMAGINARY = 1e-40
"""Step for exact derivatives, as a share of the number; its square vanishes against 1."""
LOOSEST = 1e3
"""Inverse sensitivity stops looking beyond this many times the given tolerance."""
CLOSE = 1e-9
"""Relative width of a bracket at which it stops."""
LEAPT = 1e-7
"""Relative width where nothing is left beyond: no build."""
MOST_STEPS = 64
"""Steps that it takes at most, the first ones doublings; of a limit that is leapt over the rest are halvings."""
DOUBLINGS, LEVELS = 4, 3
"""Steps ahead, among doublings and among halvings, whose builds are measured with those of the step: a call for a few
builds takes as long as one for a hundred."""
LINEAR = 0.1
"""|RSS / Monte Carlo - 1| above which a response counts as not linear."""
AMONG, LOST = 4096, 128
"""Builds among which those that cannot be put together are looked for, and how many of these are tried again."""
TOGETHER, FEW, STEPS = 0.99, 1024, (1, 1.5, 2, 3, 5, 7)
"""Share of the builds that focusing is to put together, of so many at most; ranges that are tried, in a decade."""
RESAMPLES = 256
"""Bootstrap samples of Sobol indices."""


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

    def root_sum_square(self, covariance: Array) -> Array:
        """Standard deviation of every column if it were linear in perturbations of a covariance, shape (C,)."""
        slopes = np.where(np.isfinite(self.exact), self.exact, self.derivatives)
        variance = np.einsum("ci,ij,cj->c", slopes, covariance, slopes)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

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
    return Sensitivity(derivatives, _exact_derivatives(plan), plus, minus, twins, *moves)


def _exact_derivatives(plan: TolerancePlan) -> Array:
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
        if quantity is not None and quantity.analytic and not (quantity.traced and camera.chain.bends_rays):
            exact[row] = np.broadcast_to(np.imag(quantity(camera, column.at)), steps.shape) / steps
            if column.field is not None:
                exact[row, posed] = np.nan
    return exact


def put_together(plan: TolerancePlan) -> Array:
    """Share of the builds that cannot be put together that can once one perturbation alone is none, shape (P,)."""
    count = len(plan.draws.perturbations)
    deviations = first_draws(plan.draws, min(plan.trials, AMONG))
    lost = deviations[:, np.array(list(map(bool, final_faults(plan, deviations))))][:, :LOST]
    if not lost.size:
        return np.zeros(count)
    without = np.repeat(lost[:, None], count, axis=1)
    without[np.arange(count), np.arange(count)] = 0.0
    faults = final_faults(plan, without.reshape(count, -1))
    return np.asarray(np.reshape([not reasons for reasons in faults], (count, -1)).mean(axis=1))


def least_reach(plan: TolerancePlan) -> tuple[Adjuster, float] | None:
    """Smallest focusing range, up to d_1/2, that lets `TOGETHER` of builds be put together, and the share that can."""
    others = tuple(adjuster for adjuster in plan.adjusters if adjuster.place != FOCUSING)
    aim: Aim = next((adjuster.aim for adjuster in plan.adjusters if adjuster.place == FOCUSING), "limits")
    deviations = first_draws(plan.draws, min(plan.trials, FEW))
    for reach in (step * 10.0**decade for decade in range(-2, 3) for step in STEPS):
        if reach > plan.question.design.d_1 / 2:
            break
        focus = Adjuster(FOCUSING, reach, aim)
        adjusted = replace(plan.limited, adjusters=others).with_adjusters(focus)

        def lost(some: Array, plan: TolerancePlan = adjusted) -> NDArray[np.bool_]:
            return np.asarray(np.isnan(measure_finally(plan, some)).all(axis=0))

        failed = failures(lost, deviations, (1 - TOGETHER) * deviations.shape[1])
        if failed is not None:
            return focus, 1 - failed / deviations.shape[1]
    return None


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
    deviations = moves.root_sum_square(plan.draws.covariance()).tolist()
    for column, rss in zip(as_built.distributions, deviations, strict=True):
        spread, shift = column.deviation, column.mean - column.nominal
        ratio = math.nan if math.isnan(rss) else spread / rss if rss > 0 else math.inf if spread > 0 else 1.0
        linear = abs(ratio - 1) <= LINEAR and abs(shift) <= LINEAR * max(rss, 1e-300)
        yield RssRow(column.label, rss, spread, ratio, shift, linear)


@dataclass(frozen=True)
class Allowed:
    """Allowed half-widths of one perturbation: alone until a limit fails, and as its share of the limits' room."""

    place: str
    tolerance: float
    """Half-width that uses no more than the study's share of a limit's margin [mm or rad]; infinite where nothing up to
    `LOOSEST` times the given one does."""
    given: float
    limited_by: str
    """Label of the column whose share binds, or why the build is no camera beyond; empty where nothing binds."""
    alone: float
    """Half-width at which, all else nominal, the first limit fails."""
    alone_limited_by: str


class _Alone:
    """Limited columns of builds with one perturbation alone, each build measured once."""

    def __init__(self, plan: TolerancePlan, columns: NDArray[np.intp]) -> None:
        self.plan, self.columns = plan, columns
        self.known: dict[tuple[int, float], Array] = {}

    def measure(self, keys: Iterable[tuple[int, float]]) -> None:
        """Measure builds that are not known, together."""
        new = [key for key in dict.fromkeys(keys) if key not in self.known]
        builds = np.zeros((len(self.plan.draws.perturbations), len(new)))
        for index, (row, deviation) in enumerate(new):
            builds[row, index] = deviation
        measured = measure_finally(self.plan, builds, settled=0.0)[self.columns]
        self.known |= zip(new, self.plan.judged(measured, self.columns).T, strict=True)

    def of(self, keys: Iterable[tuple[int, float]]) -> Array:
        """Columns of builds that are known, (limits, N)."""
        return np.stack([self.known[key] for key in keys], axis=1)


def _ahead(inside: float, outside: float, over: float) -> Iterator[float]:
    """Deviations that a bracket's next steps may ask for: doublings, or halvings of a bracket with no build beyond."""
    if math.isinf(outside):
        doubled = inside
        for _ in range(DOUBLINGS):
            yield (doubled := min(max(2 * doubled, 1.0), LOOSEST))
    elif math.isinf(over):
        ends = [inside, outside]
        for _ in range(LEVELS):
            middles = [(a + b) / 2 for a, b in itertools.pairwise(ends)]
            yield from middles
            ends = sorted((*ends, *middles))


def inverse_sensitivity(plan: TolerancePlan, share: float) -> tuple[Allowed, ...]:
    """Largest tolerance of each perturbation alone: until a limit fails, and until it uses a share of a limit's room.

    By a bracket on the real response, not from a derivative: margins and decentres bend. Where something is adjusted,
    what is left after adjustment counts.

    Raises
    ------
    ValueError
        The nominal design itself does not hold a limit.
    """
    misses = plan.nominal_misses()
    if misses:
        raise ValueError(f"the nominal design misses its own limits: {', '.join(misses)}")
    plan = plan.limited
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
    margin = np.minimum(here - low, high - here)
    scale = np.where(margin > 0, margin, 1.0)  # at its very limit nothing is counted in shares of no room
    inside, outside = np.zeros(rows.size), np.full(rows.size, np.inf)
    left, over = np.ones(rows.size), np.full(rows.size, -np.inf)  # room at both, of the limit that has least
    broken, last = np.zeros(rows.size, np.intp), np.zeros(rows.size)
    open_, signs, steps, builds = cases, np.where(ends == 0, 1.0, -1.0), np.zeros(rows.size, int), _Alone(plan, columns)
    while open_.size:
        least, most, a, b = (part[open_] for part in (inside, outside, left, over))
        middle = (least + np.minimum(most, LOOSEST)) / 2
        with np.errstate(invalid="ignore"):
            between = (least * b - np.where(np.isinf(most), 0.0, most) * a) / (b - a)
        within = np.isfinite(b) & (between > least) & (between < most)
        doubled = np.minimum(np.maximum(2 * least, 1.0), LOOSEST)
        at = np.where(np.isinf(most), doubled, np.where(within, between, middle))
        keys = list(zip(rows[open_].tolist(), (signs[open_] * at).tolist(), strict=True))
        known = np.array([key in builds.known for key in keys])
        if not known.any():  # each goes as far as it is known before the next are measured
            brackets = zip(rows[open_].tolist(), signs[open_].tolist(), least.tolist(), most.tolist(), b, strict=True)
            ahead = ((row, sign * d) for row, sign, *ends in brackets for d in _ahead(*ends))
            builds.measure([*keys, *ahead])
            known[:] = True
        now, least, most, a, b, at = (part[known] for part in (open_, least, most, a, b, at))
        value = builds.of(itertools.compress(keys, known))
        room_left = np.minimum(value - low[:, now], high[:, now] - value) / scale[:, now]
        room_left = np.where(np.isnan(room_left), -np.inf, room_left)
        tightest = room_left.min(axis=0)
        held = tightest >= 0
        # Illinois: an end that stays twice counts half, so that both close in.
        over[now] = np.where(held, np.where(last[now] > 0, b / 2, b), tightest)
        left[now] = np.where(held, tightest, np.where(last[now] < 0, a / 2, a))
        inside[now], outside[now] = np.where(held, at, least), np.where(held, most, at)
        broken[now] = np.where(held, broken[now], np.argmin(room_left >= 0, axis=0))
        last[now] = np.where(held, 1.0, -1.0)
        near = outside - inside <= np.where(np.isinf(over), LEAPT, CLOSE) * outside
        steps[now] += 1
        done = (inside >= LOOSEST) | (np.isfinite(outside) & near) | (steps >= MOST_STEPS)
        open_ = cases[~done]
    deviations = np.zeros((len(perturbations), rows.size))
    deviations[rows, cases] = signs * np.where(np.isfinite(outside), outside, 0.0)
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


def sobol_indices(plan: TolerancePlan, samples: int, tell: Share = UNHEARD) -> SobolIndices:
    """Sobol indices of every column, as finally adjusted: whose scatter its scatter comes from.

    Of what may be infinite those of its finite twin. Of n = `samples` base samples on a scrambled Sobol sequence,
    n (F + 2) builds in all. `tell` hears what share of them is measured.
    """
    factors = plan.draws.factors
    count = len(factors)
    a, b = np.split(sobol_points(2 * count, 0, samples, plan.draws.seed), 2)
    mixed = (np.where(np.arange(count)[:, None] == index, b, a) for index in range(count))
    every = itertools.chain((a, b), mixed)
    groups = iter(lambda: list(itertools.islice(every, max(1, BLOCK // samples))), [])  # one at a time in memory
    measured = list[Array]()
    for group in groups:
        tell(len(measured) * len(group) / (count + 2))
        measured.append(plan.judged(measure_finally(plan, plan.draws.deviations(np.hstack(group)))))
    columns = np.moveaxis(np.hstack(measured).reshape(len(plan.columns), -1, samples), 1, 0)
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
    sums = (weights @ terms.T).reshape(len(weights), 2 + 2 * factors, columns)
    variance = 0.5 * sums[:, 1] - (0.5 * sums[:, 0]) ** 2
    still = variance <= 1e-24 * np.maximum(middle**2, 1e-30)
    ratios = np.where(still[:, None], 0.0, sums[:, 2:] / np.where(still, 1.0, variance)[:, None])
    ratios = np.moveaxis(ratios, 2, 1)
    ends = np.quantile(ratios[1:], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    first, total = np.split(ratios[0], 2, axis=1)
    first_ends, total_ends = np.split(np.moveaxis(ends, 0, -1), 2, axis=1)
    return first.copy(), first_ends.copy(), total.copy(), total_ends.copy()
