"""Designs for builds that scatter: yield or a quantile maximised with the same deviations at every design tried.

The same random numbers for every design (common random numbers) make a sample's yield a fixed function of the design,
so that two designs differ by what they are and not by chance. The final figures come from other, fresh numbers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..design.check import CONJUGATES
from ..errors import InputError
from ..errors import Problem as Fault
from ..tolerance.analyses import Yield
from ..tolerance.draws import Draws, Perturbation
from ..tolerance.places import expand, nominal_values, parse_tolerance, perturbable
from .cameras import FOCAL, PLANE, Cameras
from .problem import Problem
from .tables import RobustTable
from .variables import spread

Array = NDArray[np.float64]

SHARP = (0.3, 0.1, 0.03, 0.01)
"""Widths at which the yield's step is softened, one after the other, in units of a scaled row's spread."""
FRESH = 16
"""Times as many trials for the final figures."""


@dataclass(frozen=True)
class Scatter:
    """What builds miss, and their deviations."""

    perturbations: tuple[Perturbation, ...]
    deviations: Array
    """[tolerances], shape (P, T): common to all designs."""
    fresh: Array
    """Others, for the final figures."""
    relative: tuple[float | None, ...]
    """Of each, the share of the nominal value where the tolerance is one."""


@dataclass(frozen=True)
class Spread:
    """How one design's builds do, on fresh deviations."""

    yield_: Yield
    goal_nominal: float
    goal_quantile: float
    """What `quantile` of the builds reach; infinite (or zero) where too many are no cameras."""


@dataclass(frozen=True)
class Robust:
    """The robust design beside the nominal one."""

    unit: Array
    nominal: Spread
    robust: Spread
    constraint_yields: tuple[tuple[str, float, float], ...]
    """Of each constraint: label, share of nominal and of robust builds that hold it."""
    trials: int
    evaluations: int
    seconds: float


def scatter_of(table: RobustTable, design: Design, problem: Problem, seed: int, origin: str = "") -> Scatter:
    """Resolve what builds miss.

    Raises
    ------
    InputError
        Unknown places, unreadable tolerances, places that no quantity depends on.
    """
    faults: list[Fault] = []
    found: dict[str, tuple[Perturbation, float | None]] = {}
    kinds, nominal = perturbable(design), nominal_values(design)
    for index, line in enumerate(table.perturb):
        for name in line.place:
            try:
                places = expand(design, name)
                for place in places:
                    if place == PLANE:
                        raise ValueError("the focal plane is no part of the hardware; let f or d_1 miss instead")
                    if place not in problem.places:
                        raise ValueError(f"'{name}' changes nothing that an optimisation looks at; drop it")
                    value = parse_tolerance(line.tolerance, kinds[place], nominal[place])
                    text = str(line.tolerance).strip()
                    share = float(text[:-1]) / 100 if text.endswith("%") else None
                    miss = Perturbation(place, nominal[place], value, line.distribution, line.truncate)
                    found[place] = (miss, share)
            except ValueError as error:
                faults.append(Fault(f"robust.perturb.{index}", str(error)))
    if faults:
        raise InputError(tuple(faults), origin)
    perturbations = tuple(miss for miss, _ in found.values())
    draws = Draws(perturbations, seed=seed)
    common, fresh = draws.uniforms(0, table.trials), draws.uniforms(1, FRESH * table.trials)
    shares = tuple(share for _, share in found.values())
    return Scatter(perturbations, draws.deviations(common), draws.deviations(fresh), shares)


def builds(problem: Problem, scatter: Scatter, unit: Array, deviations: Array) -> Cameras:
    """Builds of a design: its hardware with deviations, shape (T,)."""
    nominal = problem.cameras(unit[None])
    values: dict[str, Array] = {}
    for place in spread(problem.values(unit[None]), problem.places):
        if place != PLANE:
            values[place] = nominal.at(place)
    # The hardware is f and d_1; where a build focuses follows from them.
    values |= {FOCAL: nominal.f, CONJUGATES[2]: nominal.d_1}
    if problem.in_focus:
        values["microlens_array.focal_length"] = nominal.f_ml
    for miss, share, row in zip(scatter.perturbations, scatter.relative, deviations, strict=True):
        own = values.get(miss.place, np.asarray(problem.places[miss.place]))
        values[miss.place] = own + (miss.tolerance if share is None else share * np.abs(own)) * row
    return Cameras(problem.places, values)


def maximise_robustness(
    problem: Problem,
    table: RobustTable,
    scatter: Scatter,
    nominal: Array,
    deadline: float,
    tell: Callable[[str], None] = lambda _: None,
) -> Robust:
    """Maximise yield, or a quantile of the first goal, starting from the nominal optimum.

    Parameters
    ----------
    problem : Problem
        Whose constraints builds are held to.
    table : RobustTable
        What is maximised.
    scatter : Scatter
    nominal : ndarray
        The nominal optimum, scaled.
    deadline : float
        On the monotonic clock [s].
    tell : callable
        Told what is being done.
    """
    began = time.monotonic()
    goal_at_nominal = _goal(problem, nominal)
    best, spent = nominal, 0
    for width in SHARP:
        tell(f"robust: {table.maximise}, softened by {width:g}")

        def worth(unit: Array, width: float = width) -> float:
            return _worth(problem, table, scatter, unit, width, goal_at_nominal)

        best, count = _climb(worth, best, deadline)
        spent += count
    spreads = [_spread(problem, table, scatter, unit) for unit in (nominal, best)]
    if _better(table, spreads[0][0], spreads[1][0]):
        best, spreads[1] = nominal, spreads[0]  # fresh numbers are the judge
    labels = [constraint.label for constraint in problem.constraints]
    yields = tuple(zip(labels, spreads[0][1], spreads[1][1], strict=True))
    trials = scatter.fresh.shape[1]
    return Robust(best, spreads[0][0], spreads[1][0], yields, trials, spent, time.monotonic() - began)


def _climb(worth: Callable[[Array], float], start: Array, deadline: float) -> tuple[Array, int]:
    """Subplex from a start; the best point seen."""
    import nlopt

    best: list[tuple[float, Array]] = [(worth(start), start)]
    count = 0

    def value(x: Array, _: Array) -> float:
        nonlocal count
        count += 1
        unit = np.array(x)
        found = worth(unit)
        if found > best[0][0]:
            best[0] = (found, unit)
        return found

    left = deadline - time.monotonic()
    if left <= 0:
        return start, 0
    n = len(start)
    optimiser = nlopt.opt(nlopt.LN_SBPLX, n)
    optimiser.set_lower_bounds(np.zeros(n))
    optimiser.set_upper_bounds(np.ones(n))
    optimiser.set_max_objective(value)
    optimiser.set_initial_step(np.full(n, 0.05))
    optimiser.set_xtol_abs(1e-5)
    optimiser.set_maxeval(150 * n)
    optimiser.set_maxtime(left)
    optimiser.optimize(start)
    return best[0][1], count


def _worth(
    problem: Problem, table: RobustTable, scatter: Scatter, unit: Array, width: float, goal_at_nominal: float
) -> float:
    """What is maximised: finite everywhere."""
    rows = problem.rows_of(builds(problem, scatter, unit, scatter.deviations))
    worst = np.where(np.isfinite(rows), rows, 1e3).max(axis=0, initial=-1e3)
    margin = np.clip(-worst, -50.0, 50.0)
    soft = float(np.mean(1 / (1 + np.exp(np.clip(-margin / (0.1 * width), -50, 50)))))
    merit = float(problem.vector(unit[None])[0, 0])
    if not np.isfinite(merit):
        return -1e6
    # Far from any yield, the margin itself leads the way.
    total = soft + 1e-3 * float(np.clip(margin, -5, 0).mean())
    if table.maximise == "quantile":
        reached = _quantile(problem, table, scatter, unit, scatter.deviations)
        goal = problem.goals[0]
        size = np.log(reached) if goal.quantity.positive and reached > 0 else reached / problem.goal_scale(0)
        missing = max(0.0, table.wanted_yield - soft)
        return -1e6 if not np.isfinite(size) else -goal.sign * float(size) - 20.0 * missing
    if table.give_up is not None:
        lost = problem.goals[0].sign * (_goal(problem, unit) - goal_at_nominal) / max(abs(goal_at_nominal), 1e-300)
        total -= 20.0 * max(0.0, lost - table.give_up)
    return total


def _goal(problem: Problem, unit: Array) -> float:
    return float(np.ravel(problem.goals[0].values(problem.cameras(unit[None])))[0])


def _quantile(problem: Problem, table: RobustTable, scatter: Scatter, unit: Array, deviations: Array) -> float:
    goal = problem.goals[0]
    with np.errstate(all="ignore"):
        values = np.broadcast_to(goal.values(builds(problem, scatter, unit, deviations)), deviations.shape[1:])
    bad = np.inf if goal.sign > 0 else (0.0 if goal.quantity.positive else -np.inf)
    told = np.sort(np.where(np.isfinite(values), values, bad) * goal.sign)
    return goal.sign * float(told[min(len(told) - 1, int(np.ceil(table.quantile * len(told))) - 1)])


def _spread(problem: Problem, table: RobustTable, scatter: Scatter, unit: Array) -> tuple[Spread, list[float]]:
    rows = problem.rows_of(builds(problem, scatter, unit, scatter.fresh))
    held = np.nan_to_num(rows, nan=np.inf) <= 1e-9
    passed = int(held.all(axis=0).sum())
    owner = np.array([row.constraint for row in problem.rows])
    each = [float(held[owner == index].all(axis=0).mean()) for index in range(len(problem.constraints))]
    own = _goal(problem, unit)
    quantile = _quantile(problem, table, scatter, unit, scatter.fresh)
    return Spread(Yield(passed, scatter.fresh.shape[1]), own, quantile), each


def _better(table: RobustTable, left: Spread, right: Spread) -> bool:
    """Whether the left one does better in what is maximised."""
    if table.maximise == "yield":
        return left.yield_.value > right.yield_.value
    return left.yield_.value >= table.wanted_yield > right.yield_.value


def names_of(scatter: Scatter) -> Sequence[Mapping[str, object]]:
    """Perturbations as plain values."""
    return [{"place": p.place, "tolerance": p.tolerance, "distribution": p.distribution} for p in scatter.perturbations]
