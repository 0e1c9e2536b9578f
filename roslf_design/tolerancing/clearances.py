"""Clearances that tolerances use up: which parts meet, or are none any more, within what their numbers may miss."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from .draws import Draws, Perturbation
from .metrics import faults_of
from .study import TolerancePlan

Flags = NDArray[np.bool_]
HALF = 0.5
"""Share of a clearance above which a tolerance is told: two parts that miss by it towards each other meet."""
STEPS = 2.0 ** np.arange(-3, 2)
"""Multiples of a tolerance among which a fault is looked for; beyond the last it takes under half of what is left."""
HALVINGS = 24

_Factor = tuple[Perturbation, ...]
"""Numbers that are off together: one, or all of a group."""


class _TightClearance(NamedTuple):
    """A fault that tolerances bring half way or nearer, each alone or with its group."""

    fault: str
    """Fault of builds, in words: "FAP and prism 1 collide"."""
    reached: tuple[tuple[_Factor, float], ...]
    """Each such number, or group, with how many of its tolerances it is off there; 0 where parts touch."""


def tight_clearances(plan: TolerancePlan) -> tuple[_TightClearance, ...]:
    """Clearances of a study's nominal design that are less than twice a tolerance, in the order of a build's faults."""
    found: dict[str, dict[_Factor, float]] = {}
    for factor, fault, share in _first_faults(plan):
        least = found.setdefault(fault, {})
        least[factor] = min(share, least.get(factor, share))
    return tuple(_TightClearance(fault, tuple(found[fault].items())) for fault in plan.faults if fault in found)


def _factors(draws: Draws) -> Iterator[_Factor]:
    """Numbers as chance moves them, those of `Draws.factors`."""
    moved = [one for one in draws.perturbations if one.tolerance > 0]
    tied = {name for name, rho in draws.correlations if rho == 1}
    yield from ((one,) for one in moved if one.group not in tied)
    groups = (tuple(one for one in moved if one.group == name) for name, _ in draws.correlations)
    yield from (group for group in groups if group)


def _first_faults(plan: TolerancePlan) -> Iterator[tuple[_Factor, str, float]]:
    """Each factor with each fault that it reaches within twice its tolerances, either way, and at how many of them."""
    ways = list(product(_factors(plan.draws), (-1.0, 1.0)))
    if not ways:
        return
    met = np.array([_faults(plan, ways, float(step)) for step in STEPS])  # (steps, faults, ways)
    wrong = [(f, w) for f, w in np.argwhere(met.any(axis=0)).tolist()]
    if not wrong:
        return
    which, own = [ways[w] for _, w in wrong], (np.array([f for f, _ in wrong]), np.arange(len(wrong)))
    first = met[:, [f for f, _ in wrong], [w for _, w in wrong]].argmax(axis=0)
    high = STEPS[first]
    low = np.where(first > 0, STEPS[first - 1], 0.0)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        hit = _faults(plan, which, middle)[own]
        low, high = np.where(hit, low, middle), np.where(hit, middle, high)
    shares = np.where(low > 0, high, 0.0)  # nothing is left where none of them is free
    for (f, _), (factor, _), share in zip(wrong, which, shares.tolist(), strict=True):
        if share < 1 / HALF:
            yield factor, plan.faults[f], share


def _faults(plan: TolerancePlan, ways: list[tuple[_Factor, float]], share: Array | float) -> Flags:
    """Faults, shape (faults, ways), of builds off by a single factor each, by a share of its tolerances."""
    values = {one.place: np.full(len(ways), one.nominal) for factor, _ in ways for one in factor}
    for k, ((factor, sign), part) in enumerate(zip(ways, np.broadcast_to(share, len(ways)), strict=True)):
        for one in factor:
            values[one.place][k] += (-sign if one.opposed else sign) * part * one.tolerance
    return np.array(list(faults_of(plan.question, values, len(ways)).values()))
