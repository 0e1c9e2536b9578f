"""Methods for the spread of measured depths: how a disparity's error becomes a depth's."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from .. import theory
from .jobs import SIGMA_DISPARITY, Job
from .methods import Kind, Method

Floats = NDArray[np.float64]

INSIDE = 0.6826894921370859
"""Share of a normal distribution within one standard deviation."""


def spread(job: Job) -> tuple[float, float]:
    """1/Z_F [1/mm] and its standard deviation."""
    design = job.design
    sigma = theory.inverse_depth_sigma(SIGMA_DISPARITY, design.D_F, design.d, design.f, design.d_f, design.d_3)
    return 1 / job.depth, float(sigma)


def _closed(job: Job, level: int, seed: int) -> Floats:
    """Depth falls with disparity, so that the range's ends are those of the disparity."""
    inverse, sigma = spread(job)
    # (1/(v - s) - 1/(v + s))/2 without the difference.
    return np.array([sigma / ((inverse - sigma) * (inverse + sigma))])


def _first_order(job: Job, level: int, seed: int) -> Floats:
    design = job.design
    lens = design.D_F, design.d, design.f, design.d_f, design.d_3
    return np.array([float(theory.depth_sigma(SIGMA_DISPARITY, job.depth, *lens))])


def _sampled(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """Quantiles of simulated measurements."""
    inverse, sigma = spread(job)
    if kind == "random":
        normal = np.random.default_rng(seed).standard_normal(count)
    else:
        from scipy.special import ndtri
        from scipy.stats.qmc import Sobol

        normal = ndtri(np.clip(Sobol(1, seed=seed).random(count)[:, 0], 2.0**-40, 1 - 2.0**-40))
    ends = np.quantile(inverse + sigma * normal, [0.5 * (1 + INSIDE), 0.5 * (1 - INSIDE)])
    return np.array([0.5 * (1 / ends[1] - 1 / ends[0])])


def _count(job: Job, n: int) -> float:
    return float(n)


DEPTH = (
    Method("closed form", "depth", "exact", (0,), _closed, lambda job, n: 1.0, "ends of the disparity's range"),
    Method("first order", "depth", "first order", (0,), _first_order, lambda job, n: 1.0, "Z_F^2 d H sigma/(D_F d_1)"),
    Method(
        "Monte Carlo",
        "depth",
        "random",
        tuple(4**k for k in range(3, 11)),
        partial(_sampled, "random"),
        _count,
        "n simulated measurements",
    ),
    Method(
        "scrambled Sobol",
        "depth",
        "sobol",
        tuple(4**k for k in range(3, 11)),
        partial(_sampled, "sobol"),
        _count,
        "n evenly spread ones",
    ),
)
