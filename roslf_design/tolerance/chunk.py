"""One chunk of trials: drawn, measured, adjusted, counted. The same bytes wherever it runs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from .compensate import Compensator
from .metrics import evaluate_builds
from .places import nominal_values
from .plan import Plan
from .tally import Tally, count_variant, merged, pack

Array = NDArray[np.float64]

BLOCK = 4096
"""Trials evaluated at once: their arrays stay in a processor's cache."""
STRETCH = 8 * BLOCK
"""Trials counted at once: histograms are large, and adding them up block by block would cost more than the trials."""


@dataclass(frozen=True)
class Measured:
    """Consecutive trials, measured."""

    deviations: Array
    """[tolerances], shape (P, trials)."""
    variants: Array
    """Columns as built (then linearly adjusted, then adjusted), shape (V, C, trials)."""
    moved: Array
    """Adjustments [mm, rad], shape (adjusters, trials)."""


def variants_of(plan: Plan) -> tuple[str, ...]:
    """Names of what is measured of each trial."""
    if plan.adjusters:
        return ("as built", "adjusted, linear", "adjusted")
    return ("as built", "calibrated") if plan.calibrated else ("as built",)


def measure(plan: Plan, deviations: Array, scale: float = 1.0) -> Measured:
    """Measure trials given by their deviations.

    Parameters
    ----------
    plan : Plan
        What is measured.
    deviations : ndarray, shape (P, trials)
        [tolerances].
    scale : float
        All tolerances times this.
    """
    values = plan.draws.values(deviations, scale)
    trials = deviations.shape[1]
    columns = [evaluate_builds(plan.question, values, trials)]
    moved = np.empty((0, trials))
    if plan.adjusters:
        compensator = _compensator(plan)
        start = compensator.linear(deviations * scale)
        columns.append(compensator.measured(values, start))
        moved, after = compensator.newton(values, start)
        columns.append(after)
    elif plan.calibrated:
        columns.append(evaluate_builds(plan.question, values, trials, calibrated=True))
    return Measured(deviations, np.stack(columns), moved)


def run_chunk(plan: Plan, index: int) -> bytes:
    """Run one chunk and pack its results; a function of its arguments alone."""
    return pack(tally_chunk(plan, index), plan.digest())


def tally_chunk(plan: Plan, index: int) -> Tally:
    """Run one chunk of a plan."""
    trials = plan.chunk_trials(index)
    uniforms = plan.draws.uniforms(index, plan.chunk)[:, :trials]
    nominal = _nominal(plan)
    first = index * plan.chunk
    stretches = []
    for begin in range(0, trials, STRETCH):
        blocks = [
            measure(plan, plan.draws.deviations(np.ascontiguousarray(uniforms[:, start : min(start + BLOCK, trials)])))
            for start in range(begin, min(begin + STRETCH, trials), BLOCK)
        ]
        stretches.append(_tally(plan, nominal, _joined(blocks), first + begin))
    return merged(stretches)


def one_trial(plan: Plan, number: int) -> tuple[Design, Measured]:
    """Trial `number` again, bit for bit: its design (adjustments included) and what was measured.

    Raises
    ------
    ValueError
        There is no such trial, or its numbers make no design (d_3 >= d_f and the like).
    """
    measured = trial_measured(plan, number)
    changes = {place: float(value[0]) for place, value in plan.draws.values(measured.deviations).items()}
    start = nominal_values(plan.question.design)
    for adjuster, row in zip(plan.adjusters, measured.moved, strict=True):
        changes[adjuster.place] = changes.get(adjuster.place, start[adjuster.place]) + float(row[0])
    design = plan.question.design
    if design.lens is None:
        return design.replace(changes), measured
    from .mount import as_built

    return as_built(design, changes), measured


def trial_measured(plan: Plan, number: int) -> Measured:
    """What was measured of trial `number`, bit for bit (its whole block runs again, so arrays have the same shapes)."""
    if not 0 <= number < plan.trials:
        raise ValueError(f"trial {number} does not exist; they run from 0 to {plan.trials - 1}")
    index, within = divmod(number, plan.chunk)
    start = within - within % BLOCK
    trials = plan.chunk_trials(index)
    uniforms = plan.draws.uniforms(index, plan.chunk)[:, start : min(start + BLOCK, trials)]
    block = measure(plan, plan.draws.deviations(np.ascontiguousarray(uniforms)))
    pick = slice(within - start, within - start + 1)
    return Measured(block.deviations[:, pick], block.variants[:, :, pick], block.moved[:, pick])


def _joined(blocks: list[Measured]) -> Measured:
    return Measured(
        np.concatenate([block.deviations for block in blocks], axis=1),
        np.concatenate([block.variants for block in blocks], axis=2),
        np.concatenate([block.moved for block in blocks], axis=1),
    )


def _tally(plan: Plan, nominal: Array, seen: Measured, first: int) -> Tally:
    variants, _, trials = seen.variants.shape
    held = np.empty((variants, len(plan.limits)), np.int64)
    passed = np.empty(variants, np.int64)
    stats = []
    for v in range(variants):
        good = plan.passes(seen.variants[v])
        held[v], passed[v] = good.sum(axis=1), good.all(axis=0).sum()
        stats.append(count_variant(seen.variants[v] - nominal[:, None]))
    undefined, counts, total, square, low, high = (np.stack(column) for column in zip(*stats, strict=True))
    final = seen.variants[-1] - nominal[:, None]
    x, xx, xy = _cross(final, seen.deviations)
    scores = _scores(plan, nominal, seen.variants[-1])
    keep = min(plan.keep_worst, trials)
    worst = np.lexsort((np.arange(trials), -scores))[:keep] if keep else np.empty(0, np.intp)
    kept = max(0, min(plan.keep_trials - first, trials))
    return Tally(
        trials=trials,
        passed=passed,
        held=held,
        undefined=undefined,
        counts=counts,
        total=total,
        square=square,
        low=low,
        high=high,
        x=x,
        xx=xx,
        xy=xy,
        worst=(worst + first).astype(np.int64),
        scores=scores[worst],
        drawn=np.ascontiguousarray(seen.deviations[:, :kept].T),
        measured=np.ascontiguousarray(np.moveaxis(seen.variants[:, :, :kept], 2, 0)),
        moved=np.ascontiguousarray(seen.moved[:, :kept].T),
    )


def _cross(y: Array, x: Array) -> tuple[Array, Array, Array]:
    """Sums of x, x^2 and x y over trials where y is defined, shape (C, P) each."""
    shape = (len(y), len(x))
    whole = np.asarray(np.isfinite(y).all(axis=1))
    sx = np.broadcast_to(x.sum(axis=1), shape).copy()
    sxx = np.broadcast_to(np.einsum("pt,pt->p", x, x), shape).copy()
    sxy = np.empty(shape)
    for c, row in enumerate(y):
        if not whole[c]:
            good = np.isfinite(row)
            part = x[:, good]
            sx[c], sxx[c] = part.sum(axis=1), np.einsum("pt,pt->p", part, part)
            sxy[c] = np.einsum("pt,t->p", part, row[good])
        else:
            sxy[c] = np.einsum("pt,t->p", x, row)
    return sx, sxx, sxy


def _scores(plan: Plan, nominal: Array, columns: Array) -> Array:
    """How far each trial exceeds its limits: 0 at nominal, 1 at a limit, in units of what the limit allows."""
    worst = np.full(columns.shape[1], -np.inf)
    for limit in plan.limits:
        value, here = columns[limit.column], nominal[limit.column]
        for edge, over in ((limit.high, value - here), (limit.low, here - value)):
            if np.isfinite(edge):
                allowed = abs(edge - here)
                used = over / allowed if allowed > 0 else np.where(over > 0, 1 + over, over)
                worst = np.maximum(worst, np.where(np.isnan(used), np.inf, used))
    return worst


@lru_cache(maxsize=4)
def _compensator(plan: Plan) -> Compensator:
    return Compensator(plan)


@lru_cache(maxsize=4)
def _nominal(plan: Plan) -> Array:
    return plan.nominal
