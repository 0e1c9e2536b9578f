"""How sure a run of trials is: standard errors of the yield and of quantiles' ranks, expected and measured.

A yield is a share of builds, and a quantile is the value below which a share of builds lies: both are told to within an
error of that share.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..accuracy.statement import Accuracy, check_accuracy
from . import sketch
from .plan import Plan
from .store import Store
from .summary import Variant
from .tally import Tally
from .yields import CONFIDENCE

Array = NDArray[np.float64]

FINEST = 1e-6
"""A finer yield takes more trials than a study may have."""
SIGMAS = 2.0
"""Of a standard error: what a share is off by in at most 5 % of runs."""
CHUNKS, PARTS = 8, 20
"""Chunks from which their scatter is measured; below, that of so many parts of the trials kept one by one."""


def trials_for(accuracy: float, sampling: str = "random") -> int:
    """Trials after which every share is within `accuracy` in 95 % of runs, whatever the share.

    ``SIGMAS sqrt(p (1 - p)/n)`` is largest at p = 1/2; a little more pays for the binomial interval's own steps. Sobol
    points are counted on for no less, and come in a power of two.

    Raises
    ------
    InputError
        Out of range.
    """
    check_accuracy(accuracy, FINEST, "a finer yield takes more than 1e12 trials")
    count = math.ceil((SIGMAS / 2 / accuracy + 1) ** 2)
    return min(1 << (count - 1).bit_length() if sampling == "sobol" else count, 10**12)


@dataclass(frozen=True)
class Precision:
    """Standard errors of a run, as shares of builds."""

    accuracy: Accuracy
    yield_expected: float
    """From the binomial law."""
    yield_measured: float | None
    """From the scatter of parts of the run; None where there are too few."""
    rank_expected: float
    """Largest over the quantiles asked for."""
    rank_measured: float | None
    """The same, mean square over all columns that are defined."""

    def to_dict(self, times: bool = False) -> dict[str, Any]:
        """JSON-ready."""
        return self.accuracy.to_dict(times) | {
            "standard_errors": {
                "yield": {"expected": self.yield_expected, "measured": self.yield_measured},
                "rank_of_quantiles": {"expected": self.rank_expected, "measured": self.rank_measured},
            }
        }


def precision(
    plan: Plan, tally: Tally, final: Variant, folder: Path, asked: float | None = None, seconds: float | None = None
) -> Precision:
    """What a run's shares are worth.

    Parameters
    ----------
    plan : Plan
    tally : Tally
        All trials.
    final : Variant
        That counts.
    folder : Path
        Where the run's chunks are.
    asked : float, optional
        What yield and ranks may be off by.
    seconds : float, optional
        That the run took.
    """
    low, high = final.result.interval
    from scipy.special import ndtri

    # Half the interval over its number of sigmas: a share of 0 or 1 has an error, too.
    of_yield = 0.5 * (high - low) / float(ndtri(0.5 + CONFIDENCE / 2))
    of_ranks = max(math.sqrt(p * (1 - p) / plan.trials) for p in (*plan.quantiles, 0.0))
    shares = _of_chunks(plan, final, Store(folder, plan, resume=True).tallies()) if plan.chunks >= CHUNKS else None
    by = f"{plan.chunks} chunks of the run"
    share = 1.0
    if shares is None:
        shares, share = _of_kept(plan, tally, final)
        by = f"{PARTS} parts of the first {len(tally.measured)} trials" + (", scaled" if share < 1 else "")
    measured_yield = measured_rank = measured = None
    scatter = 0.0
    if shares is not None:
        errors = shares.std(axis=0, ddof=1) / math.sqrt(len(shares)) * math.sqrt(share)
        measured_yield = float(errors[0, 0])
        known = np.isfinite(errors[1:])
        squares = np.where(known, errors[1:], 0.0) ** 2
        measured_rank = float(np.sqrt(squares.sum(1) / np.maximum(known.sum(1), 1)).max(initial=0.0))
        measured = SIGMAS * max(measured_yield, measured_rank)
        scatter = 1 / math.sqrt(2 * (len(shares) - 1))
    sampled = "Sobol points" if plan.draws.sampling == "sobol" else "random builds"
    accuracy = Accuracy(
        "yield and ranks of quantiles, as shares of builds",
        f"{plan.trials} {sampled}; {shapes_text(plan)}",
        max(SIGMAS * of_ranks, 0.5 * (high - low)),
        measured,
        by if measured is not None else "",
        asked,
        seconds,
        scatter=scatter,
    )
    return Precision(accuracy, of_yield, measured_yield, of_ranks, measured_rank)


def shapes_text(plan: Plan) -> str:
    """How each build is computed: always the exact way, as that is the quicker one, too."""
    if plan.question.design.lens is not None:
        return "each by exact rays through its own lens, shapes by series along the pupil's rim"
    shaped = any(column.metric in ("kept_fraction", "image_area_mm2", "axis_ratio") for column in plan.columns)
    if not shaped:
        return "each by closed forms"
    tilted = not plan.question.design.aligned or any(".tilt." in p.place for p in plan.draws.perturbations)
    rims = "ellipses (to 1e-13)" if tilted else "discs (to 1e-15)"
    return f"each by closed forms, shapes as common parts of {rims}"


def _of_chunks(plan: Plan, final: Variant, tallies: Iterable[Tally]) -> Array:
    """Shares of each whole chunk, (chunks, 1 + quantiles, columns): passed, then at or below each quantile."""
    found = []
    for tally in tallies:
        if tally.trials < plan.chunk:
            continue  # the last may be short: its shares scatter more
        rows = np.full((1 + len(plan.quantiles), len(plan.columns)), tally.passed[-1] / tally.trials)
        for c, column in enumerate(final.distributions):
            shift = 0.0 if math.isnan(column.nominal) else column.nominal
            at = np.array(column.quantiles) - shift
            low, high = float(tally.low[-1, c]), float(tally.high[-1, c])
            rows[1:, c] = math.nan if column.undefined else sketch.share_at_most(tally.counts[-1, c], at, low, high)
        found.append(rows)
    return np.array(found)


def _of_kept(plan: Plan, tally: Tally, final: Variant) -> tuple[Array | None, float]:
    """The same of parts of the trials kept one by one, and which share of the run they are."""
    each = len(tally.measured) // PARTS
    if each < 10:
        return None, 1.0
    values = tally.measured[: each * PARTS, -1].T
    passed = plan.passes(values).all(axis=0).reshape(PARTS, each).mean(1)
    rows = np.empty((PARTS, 1 + len(plan.quantiles), len(plan.columns)))
    rows[:, 0] = passed[:, None]
    for c, column in enumerate(final.distributions):
        below = values[c] <= np.array(column.quantiles)[:, None]
        rows[:, 1:, c] = math.nan if column.undefined else below.reshape(-1, PARTS, each).mean(2).T
    return rows, each * PARTS / plan.trials
