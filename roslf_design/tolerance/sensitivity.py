"""One miss at a time: how each perturbation moves each metric, what they add up to, and what each may be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chunk import measure
from .compensate import differences
from .draws import Perturbation
from .dual import exact_derivatives
from .metrics import METRICS, Column
from .plan import Limit, Plan

Array = NDArray[np.float64]

STEP = 1e-4
"""Of a tolerance, for derivatives: the error of a central difference is then far below a percent of anything asked."""
LOOSEST = 1e3
"""Inverse sensitivity stops looking beyond this many times the given tolerance."""
HALVINGS = 40
"""Steps of its bisection, the first ones doublings: six digits and more."""


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives and finite moves of every column. V variants, C columns, P perturbations."""

    derivatives: Array
    """As built, by central differences [column's unit per mm or rad], shape (C, P)."""
    exact: Array
    """The same from closed forms, NaN where there is none, shape (C, P)."""
    plus: Array
    minus: Array
    """Change of the column at the two ends of the tolerance, as built and after adjustment, shape (V, C, P); NaN where
    undefined."""

    @property
    def worst(self) -> Array:
        """Larger of the two moves, shape (V, C, P); infinite where the column becomes undefined."""
        size = np.maximum(np.abs(self.plus), np.abs(self.minus))
        return np.where(np.isnan(size), np.inf, size)


def sensitivity(plan: Plan) -> Sensitivity:
    """How each perturbation alone moves each column."""
    perturbations = plan.draws.perturbations
    nominal, count = plan.nominal, len(perturbations)
    derivatives = differences(plan, [(p.place, STEP * p.tolerance) for p in perturbations])
    exact = np.full(derivatives.shape, np.nan)
    ideal = plan.question.design.lens is None  # closed forms know nothing of a real lens's surfaces
    for row, column in enumerate(plan.columns if ideal else ()):
        known = exact_derivatives(plan.question.design, column.metric)
        if known is not None:
            exact[row] = [known.get(p.place, _elsewhere(p.place, column)) for p in perturbations]
    one = np.eye(count)
    ends = measure(plan, np.concatenate([one, -one], axis=1)).variants - nominal[:, None]
    return Sensitivity(derivatives, exact, ends[..., :count], ends[..., count:])


def _elsewhere(place: str, column: Column) -> float:
    """Derivative by a place that a closed form does not know: a pose changes what is local to a field."""
    pose = any(word in place for word in ("decentre", "tilt", "rotation"))
    return math.nan if pose and METRICS[column.metric].per_field else 0.0


def root_sum_square(plan: Plan, found: Sensitivity) -> Array:
    """Standard deviation of every column if it were linear in the perturbations, shape (C,)."""
    slopes = np.where(np.isfinite(found.exact), found.exact, found.derivatives)
    variance = np.einsum("ci,ij,cj->c", slopes, plan.draws.covariance(), slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


@dataclass(frozen=True)
class Allowed:
    """What one perturbation alone may be, so that it uses no more than its share of any limit."""

    place: str
    tolerance: float
    """Half-width [mm or rad]; infinite where nothing up to `LOOSEST` times the given one uses the share."""
    given: float
    limited_by: str
    """Label of the column whose limit binds; empty where none does."""


def inverse_sensitivity(plan: Plan, share: float) -> tuple[Allowed, ...]:
    """Largest tolerance of each perturbation that keeps every limited column within a share of its limit.

    Parameters
    ----------
    plan : Plan
        Its perturbations and limits.
    share : float
        Part of the way from nominal to a limit that one perturbation may use.

    Raises
    ------
    ValueError
        The nominal design itself does not hold a limit.

    Notes
    -----
    Found on the real response by bisection, not from a derivative: margins and decentres bend. Where something is
    adjusted, what is left after adjustment counts.
    """
    nominal = plan.nominal
    failing = [plan.columns[l.column].label for l in plan.limits if not l.low <= nominal[l.column] <= l.high]
    if failing:
        raise ValueError(f"the nominal design misses its own limits: {', '.join(dict.fromkeys(failing))}")
    perturbations = plan.draws.perturbations
    cases = [(p, limit, sign) for p in perturbations for limit in plan.limits for sign in (1.0, -1.0)]
    inside, outside = np.zeros(len(cases)), np.full(len(cases), np.inf)
    trial = np.ones(len(cases))
    for _ in range(HALVINGS):
        held = _held(plan, nominal, cases, trial, share)
        inside = np.where(held, trial, inside)
        outside = np.where(held, outside, trial)
        trial = np.where(
            np.isinf(outside), np.minimum(2 * inside, LOOSEST), (inside + np.minimum(outside, LOOSEST)) / 2
        )
    free = inside >= LOOSEST * (1 - 1e-9)
    per_limit = len(plan.limits) * 2
    rows = []
    for index, p in enumerate(perturbations):
        part = slice(index * per_limit, (index + 1) * per_limit)
        widths = np.where(free[part], np.inf, inside[part])
        tightest = int(np.argmin(widths))
        label = plan.columns[cases[part][tightest][1].column].label if math.isfinite(widths[tightest]) else ""
        width = math.inf if not label else float(widths[tightest]) * p.tolerance
        rows.append(Allowed(p.place, width, p.tolerance, label))
    return tuple(rows)


def _held(
    plan: Plan, nominal: Array, cases: list[tuple[Perturbation, Limit, float]], widths: Array, share: float
) -> NDArray[np.bool_]:
    index = {p.place: row for row, p in enumerate(plan.draws.perturbations)}
    deviations = np.zeros((len(index), len(cases)))
    for case, (p, _, sign) in enumerate(cases):
        deviations[index[p.place], case] = sign * widths[case]
    found = measure(plan, deviations).variants[-1]
    column = np.array([limit.column for _, limit, _ in cases])
    here, value = nominal[column], found[column, np.arange(len(cases))]
    low = np.array([limit.low for _, limit, _ in cases])
    high = np.array([limit.high for _, limit, _ in cases])
    return np.asarray((value >= here - share * (here - low)) & (value <= here + share * (high - here)))
