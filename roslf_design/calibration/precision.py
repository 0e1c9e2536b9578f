"""What a sampled posterior is worth: how far its means and quantiles may be off for having finitely many draws.

Errors are in standard deviations of the posterior itself: a mean of n independent draws has one of 1/sqrt(n).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..accuracy.statement import Accuracy, check_accuracy

if TYPE_CHECKING:
    from .draws import Draws
    from .posterior import Posterior

SIGMAS = 2.0
"""Of a Monte Carlo standard error: what a mean is off by in at most 5 % of runs."""
FINEST = 0.02
"""A finer posterior takes more than 1e4 independent draws, which is more than chains in memory should hold."""
DEFAULT_ESS, DEFAULT_STEPS, MOST_STEPS = 400.0, 10_000, 60_000
"""Effective sample size and most steps where no accuracy is asked for; most steps ever."""


def sample_size_for(accuracy: float | None) -> float:
    """Effective sample size, bulk and tail, that an accuracy takes.

    Raises
    ------
    InputError
        Out of range.
    """
    if accuracy is None:
        return DEFAULT_ESS
    check_accuracy(accuracy, FINEST, "in standard deviations; a finer posterior takes too many draws")
    return max(50.0, (SIGMAS / accuracy) ** 2)


def most_steps_for(size: float) -> int:
    """Steps after which sampling gives up."""
    return int(min(MOST_STEPS, max(DEFAULT_STEPS, DEFAULT_STEPS * size / DEFAULT_ESS)))


def posterior_accuracy(
    posterior: Posterior | None, draws: Draws, asked: float | None = None, seconds: float | None = None
) -> Accuracy:
    """Method, expected and measured error of the intervals' ends and means.

    Parameters
    ----------
    posterior : Posterior or None
        None where Laplace's approximation stands in.
    draws : Draws
        That quantities are taken from.
    asked : float, optional
        In standard deviations.
    seconds : float, optional
        That everything took.
    """
    of = "means and intervals, in standard deviations of the posterior"
    kept = len(draws.parameters)
    if posterior is None:
        model = "the posterior is taken as normal"
        return Accuracy(of, f"{kept} draws of Laplace's approximation", SIGMAS / math.sqrt(kept), asked=asked,
                        seconds=seconds, model=model)  # fmt: skip
    least = min(min(posterior.bulk_ess.values()), min(posterior.tail_ess.values()))
    method = f"{posterior.walkers} walkers in {posterior.ensembles} ensembles, {posterior.steps} steps"
    return Accuracy(
        of,
        f"{method}: effective sample size {least:.0f}",
        # Kept are only so many of the draws.
        SIGMAS * math.sqrt(1 / least + (0.0 if kept >= posterior.walkers * posterior.steps else 1 / kept)),
        SIGMAS * posterior.between,
        "scatter between ensembles",
        asked,
        seconds,
        scatter=1 / math.sqrt(2 * (posterior.ensembles - 1) * len(posterior.names)),
    )
