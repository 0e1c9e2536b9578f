"""Clearances that tolerances use up: which parts meet, or are none any more, within what their numbers may miss."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from .draws import Perturbation
from .metrics import faults_of
from .study import TolerancePlan

Flags = NDArray[np.bool_]
HALF = 0.5
"""Share of a clearance above which a single tolerance is told: two parts that miss by it towards each other meet."""
STEPS = 2.0 ** np.arange(-3, 2)
"""Multiples of a tolerance among which a fault is looked for; beyond the last it takes under half of what is left."""
HALVINGS = 24


class _TightClearance(NamedTuple):
    """A fault that a tolerance alone brings half way or nearer."""

    fault: str
    """Fault of builds, in words: "FAP and prism 1 collide"."""
    reached: tuple[tuple[Perturbation, float], ...]
    """Each such tolerance with how far its number alone may be off before it [mm, rad, or none]."""


def tight_clearances(plan: TolerancePlan) -> tuple[_TightClearance, ...]:
    """Clearances of a study's nominal design that are less than twice a tolerance, in the order of a build's faults."""
    found: dict[str, dict[str, tuple[Perturbation, float]]] = {}
    for one, fault, reach in _first_faults(plan):
        least = found.setdefault(fault, {}).get(one.place)
        if least is None or reach < least[1]:
            found[fault][one.place] = one, reach
    return tuple(_TightClearance(fault, tuple(found[fault].values())) for fault in plan.faults if fault in found)


def _first_faults(plan: TolerancePlan) -> Iterator[tuple[Perturbation, str, float]]:
    """Each number with each fault that it alone reaches within twice its tolerance, either way, and where that is."""
    moved = [one for one in plan.draws.perturbations if one.tolerance > 0]
    ways = list(product(moved, (-1.0, 1.0)))
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
    for (f, _), (one, _), share in zip(wrong, which, high.tolist(), strict=True):
        if share < 1 / HALF:
            yield one, plan.faults[f], share * one.tolerance


def _faults(plan: TolerancePlan, ways: list[tuple[Perturbation, float]], share: Array | float) -> Flags:
    """Faults, shape (faults, ways), of builds that miss a single number each, by a share of its tolerance."""
    shares = np.broadcast_to(share, len(ways))
    values = {
        one.place: np.full(len(ways), one.nominal) for one in dict.fromkeys(perturbation for perturbation, _ in ways)
    }
    for k, ((one, sign), part) in enumerate(zip(ways, shares, strict=True)):
        values[one.place][k] += sign * part * one.tolerance
    return np.array(list(faults_of(plan.question, values, len(ways)).values()))
