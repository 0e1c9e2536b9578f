"""Sobol indices: which perturbation's scatter the scatter of a metric comes from, with all interactions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chunk import BLOCK, measure
from .draws import sobol_points
from .plan import Plan

Array = NDArray[np.float64]

RESAMPLES = 256
CONFIDENCE = 0.95


@dataclass(frozen=True)
class SobolIndices:
    """Indices of C columns for F independent factors, with bootstrap intervals. NaN rows where a column has none."""

    factors: tuple[str, ...]
    """A free perturbation, a group that moves together, or a partly tied member's own part."""
    first: Array
    """Share of the variance that a factor explains alone, shape (C, F)."""
    total: Array
    """Share with all its interactions, shape (C, F)."""
    first_interval: Array
    total_interval: Array
    """Lower and upper end, shape (C, F, 2)."""
    undefined: NDArray[np.int64]
    """Evaluations in which a column was undefined, shape (C,); its indices are then NaN rather than of the rest."""
    evaluations: int


def sobol_indices(plan: Plan, samples: int) -> SobolIndices:
    """Sobol indices of every column, as finally adjusted.

    Parameters
    ----------
    plan : Plan
        What is perturbed and measured.
    samples : int
        Base samples n; n (F + 2) builds are evaluated.

    Notes
    -----
    Estimators of Saltelli (first order, 2010) and Jansen (total, 1999) on a scrambled Sobol sequence; intervals by
    resampling the base samples.
    """
    factors = plan.draws.factors
    both = sobol_points(2 * len(factors), 0, samples, plan.draws.seed)
    a, b = both[: len(factors)], both[len(factors) :]
    f_a, f_b = _columns(plan, a), _columns(plan, b)
    f_ab = np.empty((len(factors), *f_a.shape))
    for index in range(len(factors)):
        mixed = a.copy()
        mixed[index] = b[index]
        f_ab[index] = _columns(plan, mixed)
    undefined = (
        (~np.isfinite(f_a)).sum(axis=1) + (~np.isfinite(f_b)).sum(axis=1) + (~np.isfinite(f_ab)).sum(axis=(0, 2))
    )
    first, total, first_interval, total_interval = _estimate(f_a, f_b, f_ab, plan.draws.seed)
    first[undefined > 0] = total[undefined > 0] = np.nan
    first_interval[undefined > 0] = total_interval[undefined > 0] = np.nan
    return SobolIndices(factors, first, total, first_interval, total_interval, undefined, samples * (len(factors) + 2))


def _columns(plan: Plan, uniforms: Array) -> Array:
    parts = [
        measure(plan, plan.draws.deviations(uniforms[:, start : start + BLOCK])).variants[-1]
        for start in range(0, uniforms.shape[1], BLOCK)
    ]
    return np.concatenate(parts, axis=1)


def _estimate(f_a: Array, f_b: Array, f_ab: Array, seed: int) -> tuple[Array, Array, Array, Array]:
    """Indices and intervals; f_a, f_b of shape (C, n), f_ab (F, C, n)."""
    columns, n = f_a.shape
    factors = len(f_ab)
    defined = [np.isfinite(f_a).all(axis=1), np.isfinite(f_b).all(axis=1), np.isfinite(f_ab).all(axis=(0, 2))]
    usable = np.logical_and.reduce(defined)
    middle = np.where(usable, 0.5 * (f_a.mean(axis=1) + f_b.mean(axis=1)), 0.0)
    ya = np.where(usable[:, None], f_a, 0.0) - middle[:, None]
    yb = np.where(usable[:, None], f_b, 0.0) - middle[:, None]
    yab = np.where(usable[:, None], f_ab, 0.0) - middle[:, None]
    # One row a base sample: what is summed for sum y, sum y^2, first and total.
    terms = np.concatenate(
        [
            (ya + yb)[None],
            (ya * ya + yb * yb)[None],
            yb * (yab - ya),
            0.5 * (ya - yab) ** 2,
        ]
    ).reshape(-1, n)
    stream = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(2**32,))))
    weights = np.concatenate([np.ones((1, n)), stream.multinomial(n, np.full(n, 1 / n), size=RESAMPLES)]) / n
    sums = np.einsum("rn,kn->rk", weights, terms).reshape(len(weights), 2 + 2 * factors, columns)
    variance = 0.5 * sums[:, 1] - (0.5 * sums[:, 0]) ** 2
    still = variance <= 1e-24 * np.maximum(middle**2, 1e-30)
    ratios = np.where(still[:, None], 0.0, sums[:, 2:] / np.where(still, 1.0, variance)[:, None])
    ratios = np.moveaxis(ratios, 2, 1)
    ends = np.quantile(ratios[1:], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    first, total = ratios[0, :, :factors].copy(), ratios[0, :, factors:].copy()
    intervals = np.moveaxis(ends, 0, -1)
    return first, total, intervals[:, :factors].copy(), intervals[:, factors:].copy()
