"""Trials: builds drawn, measured as they come, and adjusted. Trial n again, alone."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from .metrics import evaluate_builds
from .places import nominal_values, of_parts, perturbable
from .study import TolerancePlan
from .traced import as_built

Array = NDArray[np.float64]

BLOCK = 4096
"""Trials evaluated at once: their arrays stay in a processor's cache."""
ITERATIONS = 3
"""Gauss-Newton steps, each with a Jacobian of its own trial; the responses are close to linear, so these converge."""
DAMPING = 1e-10
"""Of the largest curvature, against adjusters that do the same."""


class MeasuredTrials(NamedTuple):
    """Consecutive trials, measured."""

    deviations: Array
    """[tolerances], shape (P, trials)."""
    variants: Array
    """Columns as built (then linearly adjusted, then adjusted), shape (V, C, trials)."""
    moved: Array
    """Adjustments [mm, rad], shape (adjusters, trials)."""


def measure(plan: TolerancePlan, deviations: Array) -> MeasuredTrials:
    """Measure trials given by their deviations [tolerances], shape (P, trials)."""
    values, trials = plan.draws.values(deviations), deviations.shape[1]
    variants, moved = [evaluate_builds(plan.question, values, trials)], np.empty((0, trials))
    if plan.adjusters:
        moved, *adjusted = compensator_of(plan).adjusted(values, deviations)
        variants += adjusted
    elif plan.calibrated:
        variants.append(evaluate_builds(plan.question, values, trials, calibrated=True))
    return MeasuredTrials(deviations, np.stack(variants), moved)


def measure_finally(plan: TolerancePlan, deviations: Array, scale: float = 1.0) -> Array:
    """The last of `measure`'s variants alone, what an analysis looks at: shape (C, trials), block by block.

    All tolerances count `scale` times.
    """

    def columns(some: Array) -> Array:
        values = plan.draws.values(some, scale)
        if plan.adjusters:
            return compensator_of(plan).adjusted(values, some * scale)[-1]
        return evaluate_builds(plan.question, values, some.shape[1], calibrated=plan.calibrated)

    starts = range(0, deviations.shape[1], BLOCK)
    return np.concatenate([columns(deviations[:, at : at + BLOCK]) for at in starts], axis=1)


def measure_uniforms(plan: TolerancePlan, uniforms: Array) -> MeasuredTrials:
    """Trials given by their independent uniform numbers, shape (factors, trials), block by block."""
    starts = range(0, uniforms.shape[1], BLOCK)
    drawn = (plan.draws.deviations(np.ascontiguousarray(uniforms[:, at : at + BLOCK])) for at in starts)
    blocks = [measure(plan, deviations) for deviations in drawn]
    return MeasuredTrials(*(np.concatenate(parts, axis=-1) for parts in zip(*blocks, strict=True)))


def one_trial(plan: TolerancePlan, number: int) -> tuple[Design, MeasuredTrials]:
    """Trial `number` again, bit for bit: its design (adjustments included) and what was measured.

    Raises
    ------
    ValueError
        There is no such trial, or its numbers make no design (d_3 >= d_f and the like).
    """
    if not 0 <= number < plan.trials:
        raise ValueError(f"trial {number} does not exist; they run from 0 to {plan.trials - 1}")
    index, within = divmod(number, plan.chunk)
    # Its whole block runs again, so that arrays have the same shapes.
    start, end = within - within % BLOCK, plan.chunk_trials(index)
    block = measure_uniforms(plan, plan.draws.uniforms(index, plan.chunk)[:, start : min(start + BLOCK, end)])
    measured = MeasuredTrials(*(part[..., [within - start]] for part in block))
    values = plan.draws.values(measured.deviations)
    if plan.adjusters:
        values = compensator_of(plan).applied(values, measured.moved)
    design = plan.question.design
    changes = {place: float(value[0]) for place, value in of_parts(design, values).items()}
    return design.replace(changes) if design.lens is None else as_built(design, changes), measured


class Compensator:
    """Adjusts builds of a plan with adjusters: limited columns back to nominal, in units of what their limits allow."""

    def __init__(self, plan: TolerancePlan) -> None:
        self.plan, design = plan, plan.question.design
        self.nominal, kinds = nominal_values(design), perturbable(design)
        aim = evaluate_builds(plan.question, {}, 1, calibrated=plan.calibrated)[:, 0]
        allowed: dict[int, float] = {}
        for limit in plan.limits:
            here = aim[limit.column]
            room = [abs(edge - here) for edge in (limit.low, limit.high) if np.isfinite(edge) and edge != here]
            allowed[limit.column] = min([*room, allowed.get(limit.column, np.inf)])
        self.columns = np.array([column for column in allowed if np.isfinite(aim[column])], dtype=np.intp)
        widths = np.array([allowed[column] for column in self.columns])
        self.aim = aim[self.columns, None]
        self.weights = 1 / np.where(np.isfinite(widths), widths, 1.0)[:, None]
        self.steps = np.array([1e-5 * (design.d_1 if kinds[a.place] == "length" else 1) for a in plan.adjusters])
        self.reach = np.array([adjuster.reach for adjuster in plan.adjusters])[:, None]
        self.gain = self._gain()

    def _gain(self) -> Array:
        """Adjustments that best undo one tolerance of each perturbation, shape (adjusters, perturbations)."""
        plan, perturbations = self.plan, self.plan.draws.perturbations
        steps = [(p.place, 1e-3 * p.tolerance) for p in perturbations]
        steps += [(a.place, float(step)) for a, step in zip(plan.adjusters, self.steps, strict=True)]
        slopes = differences(plan, steps, calibrated=plan.calibrated)[self.columns] * self.weights
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
            result[adjuster.place] = result.get(adjuster.place, self.nominal[adjuster.place]) + row
        return result

    def measured(self, values: Mapping[str, Array], moved: Array) -> Array:
        """All columns of the adjusted builds."""
        plan = self.plan
        return evaluate_builds(plan.question, self.applied(values, moved), moved.shape[1], calibrated=plan.calibrated)

    def adjusted(self, values: Mapping[str, Array], deviations: Array) -> tuple[Array, Array, Array]:
        """Adjustments that bring each trial's targets closest to nominal in the least-squares sense.

        Parameters
        ----------
        values : mapping
            The builds' numbers, unadjusted.
        deviations : ndarray, shape (P, trials)
            The same as deviations [tolerances].

        Returns
        -------
        (adjustments, columns, columns)
            Shapes (adjusters, trials) and (C, trials): the columns of linear adjustment, then the final ones. These
            are never worse: a step that does not lower a trial's residual is halved once, then refused for that trial.
        """
        moved = self.linear(deviations)
        columns = start = self.measured(values, moved)
        residual = self.residual(columns)
        cost = _cost(residual)
        for _ in range(ITERATIONS):
            slopes = []
            for row, step in enumerate(self.steps):
                nudged = moved.copy()
                nudged[row] += step
                slopes.append((self.residual(self.measured(values, nudged)) - residual) / step)
            change = _least_squares(slopes, residual, self.steps)
            for fraction in (1.0, 0.5):
                trial = np.clip(moved + fraction * change, -self.reach, self.reach)
                tried = self.measured(values, trial)
                left = self.residual(tried)
                better = _cost(left) < cost
                moved = np.where(better, trial, moved)
                columns = np.where(better, tried, columns)
                residual = np.where(better, left, residual)
                cost = np.where(better, _cost(left), cost)
                change = np.where(better, 0.0, change)
        return moved, start, columns

    def residual(self, columns: Array) -> Array:
        """How far the limited columns are from nominal, in units of what their limits allow."""
        return (columns[self.columns] - self.aim) * self.weights


@lru_cache(maxsize=4)
def compensator_of(plan: TolerancePlan) -> Compensator:
    """The plan's compensator, made once in a process."""
    return Compensator(plan)


def differences(plan: TolerancePlan, steps: list[tuple[str, float]], *, calibrated: bool = False) -> Array:
    """Central differences of every column at the nominal design.

    Parameters
    ----------
    plan : TolerancePlan
        Whose columns.
    steps : list of (place, step)
        A place may occur more than once. Steps of 0 give 0.

    Returns
    -------
    ndarray, shape (columns, steps)
        Change of the column per unit of the place.
    """
    count, nominal = len(steps), nominal_values(plan.question.design)
    values: dict[str, Array] = {}
    for index, (place, step) in enumerate(steps):
        numbers = values.setdefault(place, np.full(2 * count, nominal[place]))
        numbers[index] += step
        numbers[count + index] -= step
    ends = evaluate_builds(plan.question, values, 2 * count, calibrated=calibrated)
    widths = np.array([step for _, step in steps])
    return (ends[:, :count] - ends[:, count:]) / np.where(widths == 0, 1.0, 2 * widths)


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
    normal = normal + np.where(size > 0, DAMPING * size, 1.0)[:, None, None] * np.eye(len(steps))
    return np.linalg.solve(normal, right[..., None])[..., 0].T * steps[:, None]
