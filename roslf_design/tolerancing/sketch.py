"""Distributions of any number of trials in bounded memory: counts in bins that are fine where the nominal value is.

Bins hold equal ratios of the deviation from nominal: `SPLIT` bins each time it doubles, both signs, from 2^-50 to 2^30.
A quantile is then right to a `SPLIT`-th of its own deviation from nominal, whatever the scale, without a pilot run; and
counts add up in any order. A value at nominal (an unclipped image keeps exactly 1) has a bin of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

SPLIT_BITS = 7
SPLIT = 2**SPLIT_BITS
SMALLEST, LARGEST = -50, 30
"""Powers of 2 between which deviations are told apart."""
HALF = (LARGEST - SMALLEST) * SPLIT
BINS = 2 * HALF + 1

_SHIFT = 52 - SPLIT_BITS
_FIRST = (1023 + SMALLEST) << SPLIT_BITS


def count(deviations: Array) -> Counts:
    """Bin counts of deviations from nominal; infinite ones go to the outermost bins, NaN must not occur."""
    size = (np.abs(deviations).view(np.int64) >> _SHIFT) - (_FIRST - 1)
    np.clip(size, 0, HALF, out=size)
    return np.bincount(np.where(deviations < 0, HALF - size, HALF + size), minlength=BINS)


def edges() -> Array:
    """Bin edges in deviation from nominal, shape (BINS + 1,); the middle bin is [-2^-50, 2^-50]."""
    bits = (np.arange(HALF + 1, dtype=np.int64) + _FIRST) << _SHIFT
    positive = bits.view(np.float64)
    return np.concatenate([-positive[::-1], positive])


def quantiles(
    counts: Counts, probabilities: Sequence[float], low: float, high: float, below: int = 0, above: int = 0
) -> list[float]:
    """Quantiles of deviations, linear inside a bin.

    Parameters
    ----------
    counts : ndarray, shape (BINS,)
        Of all defined trials.
    probabilities : sequence of float
        In (0, 1).
    low, high : float
        Least and greatest deviation seen; no quantile lies outside.
    below, above : int
        Undefined trials, which count as worse than any: on which side is the caller's knowledge of the goal. Quantiles
        that fall among them are -inf or inf.
    """
    total = int(counts.sum()) + below + above
    heaped = np.concatenate([[0], np.cumsum(counts)]) + below
    bounds = edges()
    found = []
    for p in probabilities:
        rank = p * total
        if rank < below:
            found.append(-np.inf)
        elif rank > total - above or total == 0:
            found.append(np.inf)
        else:
            found.append(float(np.clip(_inverse(heaped, bounds, rank), low, high)))
    return found


def _inverse(heaped: Counts, bounds: Array, rank: float) -> float:
    after = int(np.clip(np.searchsorted(heaped, rank, side="left"), 1, BINS))
    first, last = heaped[after - 1], heaped[after]
    share = (rank - first) / (last - first) if last > first else 0.0
    if after - 1 == HALF:
        return 0.0
    return float(bounds[after - 1] + share * (bounds[after] - bounds[after - 1]))


def share_at_most(counts: Counts, deviations: Array, low: float, high: float) -> Array:
    """Share of defined trials at or below each deviation, linear inside a bin."""
    total = max(int(counts.sum()), 1)
    heaped = np.concatenate([[0], np.cumsum(counts)]) / total
    bounds = edges()
    inside = np.interp(deviations, bounds, heaped)
    # The nominal bin is an atom: all of it lies at or below 0.
    inside = np.where((deviations >= 0) & (deviations <= bounds[HALF + 1]), heaped[HALF + 1], inside)
    return np.where(deviations >= high, 1.0, np.where(deviations < low, 0.0, inside))


def rebin(counts: Counts, cuts: Array) -> Array:
    """Trials between neighbouring cuts (in deviation), fine bins split evenly; shape (cuts - 1,)."""
    heaped = np.concatenate([[0.0], np.cumsum(counts)])
    return np.diff(np.interp(cuts, edges(), heaped))
