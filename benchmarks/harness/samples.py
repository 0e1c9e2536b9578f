"""Times, their spread, and ratios of times with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

RESAMPLES = 2000
LEVEL = 0.95
"""Of the intervals."""
LEAST = 5
"""Fewer pairs than these give no interval worth the name."""


@dataclass(frozen=True)
class Spread:
    """Median and quartiles of repeated times [s]."""

    median: float
    low: float
    high: float
    best: float
    count: int

    @classmethod
    def of(cls, seconds: Sequence[float]) -> Spread:
        """Summary of at least one time."""
        low, median, high = np.quantile(np.asarray(seconds, np.float64), [0.25, 0.5, 0.75])
        return cls(float(median), float(low), float(high), float(min(seconds)), len(seconds))


@dataclass(frozen=True)
class Ratio:
    """How many times as long the other side took, with its interval."""

    value: float
    low: float
    high: float
    pairs: int


def paired_ratio(ours: Sequence[float], theirs: Sequence[float], seed: int = 0) -> Ratio:
    """Median over pairs of theirs/ours, with a bootstrap interval.

    Parameters
    ----------
    ours, theirs : sequence of float
        Times [s] of runs done next to each other, so that both met the same state of the machine.
    seed : int
        Of the resampling.

    Returns
    -------
    Ratio
        Interval at `LEVEL`: pairs are drawn again with replacement, percentiles of their medians are taken.

    Raises
    ------
    ValueError
        Fewer than `LEAST` pairs, sequences of unequal length, or a time that is not positive.
    """
    a, b = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
    if a.shape != b.shape or a.size < LEAST:
        raise ValueError(f"a ratio takes at least {LEAST} pairs of times; here are {a.size} and {b.size} times")
    if not (np.all(a > 0) and np.all(b > 0)):
        raise ValueError("a ratio takes times above zero")
    logs = np.log(b / a)
    drawn = np.random.default_rng(seed).integers(0, logs.size, (RESAMPLES, logs.size))
    low, high = np.quantile(np.median(logs[drawn], axis=1), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    value, low, high = (float(v) for v in np.exp([np.median(logs), low, high]))
    return Ratio(value, low, high, int(logs.size))


def slope(sizes: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """Exponent p of values ~ sizes^p by least squares on logarithms, and its standard error (0 for two points)."""
    x, y = np.log(np.asarray(sizes, np.float64)), np.log(np.asarray(values, np.float64))
    if x.size < 2 or x.shape != y.shape:
        raise ValueError("a slope takes two points or more")
    x = x - x.mean()
    p = float(x @ y / (x @ x))
    left = y - y.mean() - p * x
    free = x.size - 2
    return p, float(np.sqrt(left @ left / free / (x @ x))) if free else 0.0
