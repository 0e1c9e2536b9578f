"""Which limits an optimum rests on, and what relaxing each would buy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .gradients import value_and_jacobian
from .problem import Problem

Array = NDArray[np.float64]

TOUCHING = 1e-6
"""Scaled rows and variables this close to their limit count as on it."""


@dataclass(frozen=True)
class Active:
    """A limit that the optimum touches."""

    label: str
    """E.g. ``fill_factor <= 1`` or ``d_3 <= 8 mm``."""
    unit: str
    """Of the limit."""
    multiplier: float
    """Change of the scaled merit per unit of the scaled row; 0 where the limit only happens to be touched."""
    merit_per_unit: float
    """By how much the merit falls (0.01: the goals get 1 % better) where the limit is relaxed by one unit."""
    goal_per_unit: float | None
    """The same for a single goal, in the goal's unit: how much better it gets."""


@dataclass(frozen=True)
class Conditions:
    """First-order conditions at a point."""

    active: tuple[Active, ...]
    residual: float
    """Length of what no multiplier explains, over the length of the merit's gradient: 0 at an optimum."""


def conditions(problem: Problem, unit: Array) -> Conditions:
    """Active limits and their multipliers, by non-negative least squares on the gradients."""
    from scipy.optimize import nnls

    values, jacobian = value_and_jacobian(problem.vector, unit)
    slope, rows = jacobian[0], values[1:]
    columns: list[Array] = []
    told: list[tuple[str, str, float]] = []
    for number, row in enumerate(problem.rows):
        equal = row.side == "equal"
        if row.constraint < 0 or (rows[number] < -TOUCHING and not equal):
            continue
        size = problem.unit_of_row(row)
        kind = problem.constraints[row.constraint].quantity.unit
        for sign in (1.0, -1.0) if equal else (1.0,):
            columns.append(sign * jacobian[1 + number])
            told.append((problem.label(row), kind, size))
    for i, variable in enumerate(problem.variables):
        if variable.high == variable.low:
            continue
        for side, touches, sign in (("<=", unit[i] > 1 - TOUCHING, 1.0), (">=", unit[i] < TOUCHING, -1.0)):
            if touches:
                columns.append(sign * np.eye(problem.n)[i])
                bound = variable.high if sign > 0 else variable.low
                told.append((f"{variable.name} {side} {bound:.6g} mm", "mm", variable.rate(float(unit[i]))))
    length = float(np.linalg.norm(slope))
    if not columns:
        return Conditions((), 1.0 if length > 1e-6 else 0.0)
    found, residual = nnls(np.stack(columns, axis=1), -slope)
    merged: dict[str, Active] = {}
    for (label, kind, size), multiplier in zip(told, found, strict=True):
        gain = float(multiplier) / size
        before = merged.get(label)
        if before is None or multiplier > before.multiplier:
            merged[label] = Active(label, kind, float(multiplier), gain, _in_goal(problem, unit, gain))
    order = sorted(merged.values(), key=lambda a: -a.multiplier)
    return Conditions(tuple(order), float(residual) / max(length, 1e-12))


def _in_goal(problem: Problem, unit: Array, gain: float) -> float | None:
    if len(problem.goals) != 1:
        return None
    goal = problem.goals[0]
    if not goal.quantity.positive:
        return gain * problem.goal_scale(0)
    return gain * float(np.ravel(goal.values(problem.cameras(unit[None])))[0])
