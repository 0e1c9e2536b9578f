"""Adjustments made on each build: by linear projection, and by Gauss-Newton steps on all trials at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .metrics import evaluate_builds
from .plan import Plan

Array = NDArray[np.float64]

ITERATIONS = 3
"""Gauss-Newton steps, each with a Jacobian of its own trial; the responses are close to linear, so these converge."""
DAMPING = 1e-10
"""Of the largest curvature, against adjusters that do the same."""


@dataclass(frozen=True)
class Targets:
    """What adjusting aims at: the limited columns back at nominal, each in units of what its limit allows."""

    columns: NDArray[np.intp]
    nominal: Array
    weights: Array


def targets(plan: Plan, nominal: Array) -> Targets:
    """Aims of a plan's adjusters, from its limits."""
    allowed: dict[int, float] = {}
    for limit in plan.limits:
        here = nominal[limit.column]
        room = [abs(edge - here) for edge in (limit.low, limit.high) if np.isfinite(edge) and edge != here]
        allowed[limit.column] = min([*room, allowed.get(limit.column, np.inf)])
    columns = np.array([column for column in allowed if np.isfinite(nominal[column])], dtype=np.intp)
    widths = np.array([allowed[column] for column in columns])
    return Targets(columns, nominal[columns], 1 / np.where(np.isfinite(widths), widths, 1.0))


class Compensator:
    """Adjusts builds of one plan.

    Parameters
    ----------
    plan : Plan
        With at least one adjuster.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.aims = targets(plan, evaluate_builds(plan.question, {}, 1, calibrated=plan.calibrated)[:, 0])
        self.steps = np.array([_step(adjuster.place, plan) for adjuster in plan.adjusters])
        self.reach = np.array([adjuster.reach for adjuster in plan.adjusters])[:, None]
        self.gain = self._gain()

    def _gain(self) -> Array:
        """Adjustments that best undo one tolerance of each perturbation, shape (adjusters, perturbations)."""
        plan = self.plan
        perturbations = plan.draws.perturbations
        steps = [(p.place, 1e-3 * p.tolerance) for p in perturbations]
        steps += [(a.place, step) for a, step in zip(plan.adjusters, self.steps, strict=True)]
        slopes = differences(plan, steps, calibrated=plan.calibrated)[self.aims.columns] * self.aims.weights[:, None]
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        count = len(perturbations)
        tolerances = np.array([p.tolerance for p in perturbations])
        undone: Array = -np.linalg.pinv(slopes[:, count:], rcond=1e-8) @ (slopes[:, :count] * tolerances)
        return undone

    def linear(self, deviations: Array) -> Array:
        """Adjustments by projection, shape (adjusters, trials) [mm, rad]; clipped to the adjusters' reach."""
        # Summed one perturbation after the other: the same bits whatever the machine's linear algebra.
        moved = np.zeros((len(self.plan.adjusters), deviations.shape[1]))
        for column, row in zip(self.gain.T, deviations, strict=True):
            moved += column[:, None] * row
        return np.clip(moved, -self.reach, self.reach)

    def applied(self, values: Mapping[str, Array], moved: Array) -> dict[str, Array]:
        """The builds' numbers with their adjustments on top."""
        result = dict(values)
        for adjuster, row in zip(self.plan.adjusters, moved, strict=True):
            here = result.get(adjuster.place)
            result[adjuster.place] = (_nominal(self.plan, adjuster.place) if here is None else here) + row
        return result

    def measured(self, values: Mapping[str, Array], moved: Array) -> Array:
        """All columns of the adjusted builds."""
        plan = self.plan
        return evaluate_builds(plan.question, self.applied(values, moved), moved.shape[1], calibrated=plan.calibrated)

    def newton(self, values: Mapping[str, Array], start: Array) -> tuple[Array, Array]:
        """Adjustments that bring each trial's targets closest to nominal in the least-squares sense.

        Parameters
        ----------
        values : mapping
            The builds' numbers, unadjusted.
        start : ndarray, shape (adjusters, trials)
            First guess, e.g. from `linear`.

        Returns
        -------
        (adjustments, columns)
            Shapes (adjusters, trials) and (columns, trials). Never worse than the start: a step that does not lower a
            trial's residual is halved once, then refused for that trial.
        """
        moved, columns = start, self.measured(values, start)
        residual = self._residual(columns)
        cost = _cost(residual)
        for _ in range(ITERATIONS):
            slopes = []
            for row, step in enumerate(self.steps):
                nudged = moved.copy()
                nudged[row] += step
                slopes.append((self._residual(self.measured(values, nudged)) - residual) / step)
            change = _least_squares(slopes, residual, self.steps)
            for fraction in (1.0, 0.5):
                trial = np.clip(moved + fraction * change, -self.reach, self.reach)
                seen = self.measured(values, trial)
                left = self._residual(seen)
                better = _cost(left) < cost
                moved = np.where(better, trial, moved)
                columns = np.where(better, seen, columns)
                residual = np.where(better, left, residual)
                cost = np.where(better, _cost(left), cost)
                change = np.where(better, 0.0, change)
        return moved, columns

    def _residual(self, columns: Array) -> Array:
        return (columns[self.aims.columns] - self.aims.nominal[:, None]) * self.aims.weights[:, None]


def differences(plan: Plan, steps: list[tuple[str, float]], *, calibrated: bool = False) -> Array:
    """Central differences of every column at the nominal design.

    Parameters
    ----------
    plan : Plan
        Whose columns.
    steps : list of (place, step)
        A place may occur more than once. Steps of 0 give 0.

    Returns
    -------
    ndarray, shape (columns, steps)
        Change of the column per unit of the place.
    """
    count = len(steps)
    values: dict[str, Array] = {}
    for index, (place, step) in enumerate(steps):
        numbers = values.setdefault(place, np.full(2 * count, _nominal(plan, place)))
        numbers[index] += step
        numbers[count + index] -= step
    found = evaluate_builds(plan.question, values, 2 * count, calibrated=calibrated)
    widths = np.array([step for _, step in steps])
    return (found[:, :count] - found[:, count:]) / np.where(widths == 0, 1.0, 2 * widths)


def _cost(residual: Array) -> Array:
    return np.where(np.isfinite(residual).all(axis=0), np.einsum("ct,ct->t", residual, residual), np.inf)


def _least_squares(slopes: list[Array], residual: Array, steps: Array) -> Array:
    """Gauss-Newton steps, shape (adjusters, trials); 0 where a trial's residual is undefined."""
    good = np.isfinite(residual).all(axis=0)
    for slope in slopes:
        good &= np.isfinite(slope).all(axis=0)
    # In units of the difference steps, so that millimetres and radians weigh alike.
    j = np.stack([np.where(good, slope, 0.0) * step for slope, step in zip(slopes, steps, strict=True)])
    normal = np.einsum("act,bct->tab", j, j)
    right = -np.einsum("act,ct->ta", j, np.where(good, residual, 0.0))
    size = np.max(np.einsum("taa->ta", normal), axis=1)
    eye = np.eye(len(steps))
    normal = normal + np.where(size > 0, DAMPING * size, 1.0)[:, None, None] * eye
    return np.linalg.solve(normal, right[..., None])[..., 0].T * steps[:, None]


def _nominal(plan: Plan, place: str) -> float:
    from .places import nominal_values

    return nominal_values(plan.question.design)[place]


def _step(place: str, plan: Plan) -> float:
    angle = ".tilt." in place or place.endswith("rotation")
    return 1e-5 if angle else 1e-5 * plan.question.design.d_1
