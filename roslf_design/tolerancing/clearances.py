"""Clearances that tolerances use up: which parts meet, or are none any more, within what their numbers may miss."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from .draws import Perturbation
from .metrics import faults_of
from .places import nominal_values
from .study import TolerancePlan
from .trials import ALONG, final_values

HALF = 0.5
"""Share of a clearance above which a tolerance is told: two parts that miss by it towards each other meet."""
STEPS = 2.0 ** np.arange(-3, 2)
"""Multiples of a tolerance among which a fault is looked for; beyond the last it takes under half of what is left."""
HALVINGS = 24
Missed = tuple[tuple[Perturbation, float], ...]
"""A number, or all of a group, with how far each is off [mm, rad, or none]."""


class _TightClearance(NamedTuple):
    """A fault that tolerances bring half way or nearer, each alone or with its group."""

    fault: str
    """Fault of builds, in words: "FAP and prism 1 collide"."""
    reached: tuple[tuple[float, Missed], ...]
    """Share of the farthest that chance goes, 0 where parts touch, with what is off there; nearest first."""


def tight_clearances(plan: TolerancePlan) -> tuple[_TightClearance, ...]:
    """Clearances of a study's nominal design that are less than twice a tolerance, in the order of a build's faults."""
    draws, ends = plan.draws, np.eye(len(plan.draws.factors)) / 2
    one_way = (draws.deviations(0.5 + ends) - draws.deviations(0.5 - ends)) / 2  # (perturbations, factors)
    moves = np.hstack([one_way, -one_way])
    met = np.array([_faults(plan, step * moves) for step in STEPS])  # (steps, faults, ways)
    wrong, way = np.nonzero(met.any(axis=0))
    if not way.size:
        return ()
    first = met[:, wrong, way].argmax(axis=0)
    low, high = np.where(first > 0, STEPS[first - 1], 0.0), STEPS[first]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        hit = _faults(plan, middle * moves[:, way])[wrong, np.arange(len(way))]
        low, high = np.where(hit, low, middle), np.where(hit, middle, high)
    shares = np.where(low > 0, high, 0.0)
    nearest: dict[int, dict[int, tuple[float, Missed]]] = {}
    for k in np.argsort(shares, kind="stable").tolist():
        pairs = zip(draws.perturbations, moves[:, way[k]].tolist(), strict=True)
        missed = tuple((one, shares[k] * abs(move) * one.tolerance) for one, move in pairs if move * one.tolerance)
        if shares[k] < 1 / HALF:
            nearest.setdefault(wrong[k], {}).setdefault(way[k] % len(ends), (float(shares[k]), missed))
    return tuple(_TightClearance(plan.faults[f], tuple(nearest[f].values())) for f in sorted(nearest))


def _faults(plan: TolerancePlan, deviations: Array) -> NDArray[np.bool_]:
    """Faults, shape (faults, builds), of builds at deviations in units of the tolerances.

    None of a build that is a camera where it is focused, or somewhere along the way of a part that is adjusted on each.
    """
    values, searched = plan.draws.values(deviations), plan.adjusters_to_limits
    if searched != plan.adjusters:
        values = final_values(plan, deviations, np.zeros((len(searched), deviations.shape[1])))
    faults = _faults_at(plan, values, deviations.shape[1])
    nominal = nominal_values(plan.question.design)
    for adjuster in searched:
        lost = np.flatnonzero(faults.any(axis=0))
        if not lost.size:
            break
        here = nominal[adjuster.place]
        moved = np.repeat(min(adjuster.reach, HALF * abs(here)) * ALONG, lost.size)
        tried = {place: np.tile(numbers[lost], ALONG.size) for place, numbers in values.items()}
        tried[adjuster.place] = tried.get(adjuster.place, here) + moved
        mended = (~_faults_at(plan, tried, moved.size).any(axis=0)).reshape(ALONG.size, -1).any(axis=0)
        faults[:, lost[mended]] = False
    return faults


def _faults_at(plan: TolerancePlan, values: Mapping[str, Array], builds: int) -> NDArray[np.bool_]:
    """Faults, shape (faults, builds), at numbers of builds."""
    return np.array(list(faults_of(plan.question, values, builds).values()))
