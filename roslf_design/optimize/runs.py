"""nlopt's algorithms, each as one run that leaves what it found in a guard and says why it stopped."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .guard import FEASIBLE, Guard

Array = NDArray[np.float64]

Stop = Literal["converged", "evaluations", "time", "round-off", "failed"]

Global = Literal["crs2", "isres"]

XTOL, FTOL = 1e-11, 1e-14
GLOBAL_FTOL = 1e-9
ROW_TOLERANCE = 1e-11
"""Passed to nlopt; the guard's own `FEASIBLE` decides."""


def slsqp(guard: Guard, start: Array, evaluations: int = 300, ftol: float = FTOL) -> Stop:
    """Sequential quadratic programming from a start (clipped to the box)."""
    import nlopt

    problem = guard.problem
    optimiser = nlopt.opt(nlopt.LD_SLSQP, problem.n)
    values, _ = guard.rows(np.clip(np.asarray(start, float), 0.0, 1.0), True)
    inequalities = len(values) - 1 - problem.equalities

    def merit(x: Array, gradient: Array) -> float:
        rows, jacobian = guard.rows(x, gradient.size > 0)
        if gradient.size:
            gradient[:] = jacobian[0]
        return float(rows[0])

    def part(first: int, last: int) -> Any:
        def rows_of(result: Array, x: Array, gradient: Array) -> None:
            rows, jacobian = guard.rows(x, gradient.size > 0)
            result[:] = rows[first:last]
            if gradient.size:
                gradient[:] = jacobian[first:last]

        return rows_of

    optimiser.set_min_objective(merit)
    if inequalities:
        optimiser.add_inequality_mconstraint(part(1, 1 + inequalities), np.full(inequalities, ROW_TOLERANCE))
    if problem.equalities:
        optimiser.add_equality_mconstraint(
            part(1 + inequalities, len(values)), np.full(problem.equalities, ROW_TOLERANCE)
        )
    optimiser.set_ftol_rel(ftol)
    if ftol > FTOL:
        optimiser.set_ftol_abs(ftol)
    return _run(optimiser, guard, start, evaluations)


def globally(
    guard: Guard, algorithm: Global, weight: float, evaluations: int, seed: int, ftol: float = GLOBAL_FTOL
) -> tuple[Stop, Array]:
    """A global search: CRS2_LM on the merit plus `weight` times the violation, or ISRES with the rows themselves.

    Returns
    -------
    (stop, unit)
        Why it stopped; the point of least merit plus penalty, feasible or not.
    """
    import nlopt

    nlopt.srand(seed + 1)  # 0 would mean the clock
    problem = guard.problem
    optimiser = nlopt.opt(nlopt.GN_CRS2_LM if algorithm == "crs2" else nlopt.GN_ISRES, problem.n)
    rows, _ = guard.rows(np.full(problem.n, 0.5), False)
    inequalities = len(rows) - 1 - problem.equalities
    best: list[tuple[float, Array]] = [(np.inf, np.full(problem.n, 0.5))]

    def merit(x: Array, _: Array) -> float:
        found, _ = guard.rows(x, False)
        above = np.maximum(found[1 : 1 + inequalities], 0.0).sum() + np.abs(found[1 + inequalities :]).sum()
        total = float(found[0] + weight * above)
        if total < best[0][0]:
            best[0] = (total, np.array(x))
        return float(found[0]) if algorithm == "isres" else total

    optimiser.set_min_objective(merit)
    if algorithm == "isres":
        for number in range(1, len(rows)):
            add = optimiser.add_inequality_constraint if number <= inequalities else optimiser.add_equality_constraint
            add(lambda x, _, k=number: float(guard.rows(x, False)[0][k]), FEASIBLE)
    optimiser.set_ftol_rel(ftol)
    return _run(optimiser, guard, np.full(problem.n, 0.5), evaluations), best[0][1]


def _run(optimiser: Any, guard: Guard, start: Array, evaluations: int) -> Stop:
    import nlopt

    if guard.seconds_left <= 0:
        return "time"
    optimiser.set_lower_bounds(np.zeros(guard.problem.n))
    optimiser.set_upper_bounds(np.ones(guard.problem.n))
    optimiser.set_xtol_rel(XTOL)
    optimiser.set_xtol_abs(XTOL)
    optimiser.set_maxeval(evaluations)
    if np.isfinite(guard.seconds_left):
        optimiser.set_maxtime(guard.seconds_left)
    try:
        optimiser.optimize(np.clip(np.asarray(start, float), 0.0, 1.0))
    except _named(nlopt, "RoundoffLimited", "roundoff_limited"):
        return "round-off"  # no point comes back; the guard has the best one
    except _named(nlopt, "runtime_error"):
        # How nlopt says that a search broke down: what it found until then is in the guard.
        return "failed"
    reason = optimiser.last_optimize_result()
    if reason == nlopt.MAXEVAL_REACHED:
        return "evaluations"
    return "time" if reason == nlopt.MAXTIME_REACHED else "converged"


def _named(module: Any, *names: str) -> tuple[type[Exception], ...]:
    """Exceptions of nlopt by name: from one version to the next they move out of Python's RuntimeError and back."""
    found = tuple(getattr(module, name) for name in names if hasattr(module, name))
    return (*found, RuntimeError) if "runtime_error" in names else found
