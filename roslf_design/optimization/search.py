"""One search over the unit box, through nlopt: from any start to the best point near it, feasible if there is one.

nlopt passes views of its own memory, stops without a point on round-off, and some of its algorithms die of NaN. Every
evaluation therefore goes through a `Guard`, which copies, maps, counts, and never loses the best point.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from threading import Event
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array, by_value
from ..progress import CountedProgress, EnoughError
from ..theory.quantity import FEASIBLE

Vector = Callable[[Array], Array]
"""Function that is searched: merit and rows that must not be above 0, shape (1 + rows, N), at points (N, n) of the
unit box."""

Global = Literal["crs2", "isres"]
Ended = Literal["", "evaluations", "seconds", "stopped"]
"""Why a search ended before its own end: a budget, or that somebody had enough of it."""

BIG = 1e6
"""Stand-in for infinity: far beyond any merit or row of a camera."""
XTOL, FTOL = 1e-11, 1e-14
QUICK = 1e-8
"""Relative change of the merit at which an unpolished search ends."""
COARSE = 1e-4
"""Change of the violation at which a search for the least ends, where so much more of it is left that none holds."""
FAR = 100.0
"""Violations farther from 0 than so many of those changes are."""
GLOBAL_FTOL = 1e-9
AGREED = 1e-2
"""Spread of the merit over CRS2's population at which it has found its valley: a polish follows it to the bottom."""
TOGETHER = 16
"""Candidates of a global search in one call."""
ROW_TOLERANCE = 1e-11
"""Passed to nlopt; the guard's own `FEASIBLE` decides."""
NEAR = 1e-7
"""Rows this close to their limit are put exactly on it in the end."""
GENTLE = 0.01
"""Cost of a scaled row's violation where it is relaxed: where slacks cost much more, SLSQP breaks down at its start."""
LARGEST_SLACK = 50.0
"""Largest slack of a scaled row that is relaxed; what is worse is cut off there."""

STEP = 5e-4
"""Step of finite differences, in the unit box."""
CENTRAL = (np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12)
FORWARD = (np.array([1.0, 2.0, 3.0, 4.0]), np.array([48.0, -36.0, 16.0, -3.0]) / 12)
ROUGH = (np.array([-1.0, 1.0]), np.array([-0.5, 0.5])), (np.array([1.0, 2.0]), np.array([2.0, -0.5]))
"""Offsets in steps, and weights: about a point, and to one side, which also take minus its sum of weights there; half
as many to about 1e-7, for searches that end at coarser changes."""
FINER = (1.0, 1e-2, 1e-4)
"""Shares of the step that are tried one-sided."""


def value_and_jacobian(
    vector: Vector, unit: Array, step: float = STEP, always: int = 0, *, roughly: bool = False
) -> tuple[Array, Array]:
    """Rows (R,) of a vector function at a point (n,) of the unit box, and their derivatives (R, n); one call for all.

    By five-point differences: the closed forms are right to a few ulp, so that with a step of 1e-3 of the box the
    fourth-order formula is right to about 1e-12, better than the optimiser's own algebra. At a bound the points lie
    inside the box, for beyond d_3 = 0 a design has a kink; and where so many first rows say what `always` holds, inside
    that: differences that reach beyond it tell nothing, and are made one-sided or finer. `roughly`: of two points each.
    """
    n = len(unit)
    central, forward = ROUGH if roughly else (CENTRAL, FORWARD)
    count = len(central[0])
    points = np.repeat(unit[None], 1 + count * n, axis=0)
    weights = np.zeros((n, count))
    for i in range(n):
        inwards = 1.0 if unit[i] < 2 * step else -1.0 if unit[i] > 1 - 2 * step else 0.0
        offsets, weights[i] = (inwards * forward[0], inwards * forward[1]) if inwards else central
        points[1 + count * i : 1 + count * (i + 1), i] += offsets * step
    rows = vector(points)
    values, around, middle = rows[:, 0], rows[:, 1:].reshape(len(rows), n, count), -weights.sum(1)
    held = (values[1 : 1 + always] <= FEASIBLE).all()

    def astray(some: Array) -> NDArray[np.bool_]:
        """Along which variables points are none that tell anything, (n,) or (); `some` (R, ..., 4)."""
        lost = np.isnan(some).any(axis=(0, -1))
        return np.asarray(lost | (held & (some[1 : 1 + always] > FEASIBLE).any(axis=(0, -1))))

    with np.errstate(invalid="ignore"):
        jacobian = (np.einsum("rnk,nk->rn", around, weights) + values[:, None] * middle) / step
        for i in np.flatnonzero(astray(around)).tolist() if always and not np.isnan(values).any() else ():
            for reach in (sign * size * step for size in FINER for sign in (1.0, -1.0)):
                ends = np.repeat(unit[None], 4, axis=0)
                ends[:, i] += reach * FORWARD[0]
                if 0 <= ends[-1, i] <= 1 and not astray(near := vector(ends)):
                    jacobian[:, i] = (near @ FORWARD[1] - 25 / 12 * values) / reach
                    break
    return values, jacobian


def gradient_error(vector: Vector, unit: Array) -> float:
    """Largest difference between derivatives at two step sizes, over the largest derivative of the same row."""
    _, fine = value_and_jacobian(vector, unit)
    _, coarse = value_and_jacobian(vector, unit, 2 * STEP)
    difference = np.abs(fine - coarse).max(axis=1) / np.maximum(np.abs(fine).max(axis=1), 1e-12)
    return float(np.nanmax(difference, initial=0.0))


@dataclass
class SearchBudget:
    """How much more may be tried; by default without end."""

    evaluations: float = math.inf
    """Left of them. Points for derivatives are not counted: where this alone ends a search, it ends on any machine at
    the same point."""
    deadline: float = math.inf
    """On the monotonic clock [s], where somebody asked for one."""
    each: int = 0
    """Evaluations that each design counts for besides, those for derivatives too: 0 where they take no time."""
    halted: Event = field(default_factory=Event)
    """Set where somebody has enough of it; of all parts of a budget one."""

    @classmethod
    def of(cls, evaluations: float, seconds: float | None, each: int = 0) -> SearchBudget:
        """Budget from now on."""
        return cls(evaluations, math.inf if seconds is None else time.monotonic() + seconds, each)

    def counting(self, rows: Vector) -> Vector:
        """Rows whose designs are taken from the budget as they are tried."""

        def counted(units: Array) -> Array:
            self.evaluations -= self.each * len(units)
            return rows(units)

        return counted if self.each else rows

    def heard(self, tell: CountedProgress, what: str, done: float = 0.0, total: float = 0.0) -> None:
        """Tell what is being done; who has enough of it ends the budget."""
        try:
            tell(what, done, total)
        except EnoughError:
            self.halted.set()

    @property
    def ended(self) -> Ended:
        """Budget that ran out first; "" where more may be tried."""
        if self.halted.is_set():
            return "stopped"
        if self.evaluations <= 0:
            return "evaluations"
        return "seconds" if time.monotonic() > self.deadline else ""

    def at_most(self, evaluations: int, designs: int = 1) -> SearchBudget:
        """Budget of a search that tries so many points at most, its start among them, each by so many designs."""
        left = self.evaluations / max(self.each * designs, 1)
        return SearchBudget(min(left, evaluations - 1), self.deadline, halted=self.halted)

    def at_least(self, evaluations: float, seconds: float) -> SearchBudget:
        """Budget with at least so much left, unless somebody has enough of it."""
        deadline = max(self.deadline, time.monotonic() + seconds)
        return replace(self, evaluations=max(self.evaluations, evaluations), deadline=deadline)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Work that Ctrl-C ends, with the best so far: as who has enough of it does. A second one ends all."""
        try:
            yield
        except KeyboardInterrupt:
            if self.halted.is_set():
                raise
            self.halted.set()


def followed(rows: Vector, tell: Callable[[float, float], None], most: int) -> Vector:
    """Rows of a search, whose points are told of as they are tried, by hundredths of the most."""
    tried, told = 0, -1

    def following(units: Array) -> Array:
        nonlocal tried, told
        if (now := min(100 * tried // most, 100)) > told:
            told = now
            tell(min(tried, most), most)
        tried += len(units)
        return rows(units)

    return following


@dataclass
class Guard:
    """Evaluations of what is searched, watched."""

    vector: Vector
    budget: SearchBudget = field(default_factory=SearchBudget)
    always: int = 0
    """How many of the first rows hold always, whatever is searched."""
    limits: Vector | None = None
    """The rows alone, where the merit takes long; None: as `vector` has them."""
    roughly: bool = False
    """Whether derivatives are of two points each."""
    evaluations: int = 0
    """Points asked for by the optimiser; those for derivatives are not counted."""
    mapped: int = 0
    """Evaluations with a value that was undefined."""
    unit: Array | None = None
    """Best point so far: the best feasible or, before there is one, the least violating."""
    merit: float = float("inf")
    violation: float = float("inf")
    _last: tuple[bytes, Array, Array | None] | None = field(default=None, repr=False)

    def rows(self, unit: Array, derivatives: bool = False) -> tuple[Array, Array]:
        """Merit and rows, all finite, and their derivatives (empty where not asked for)."""
        key = unit.tobytes()
        if self._last is None or self._last[0] != key:
            self.evaluations += 1
            self.budget.evaluations -= 1
            self._last = None
        if self._last is None or (derivatives and self._last[2] is None):
            own, jacobian = _inside(unit), None  # a copy: nlopt reuses its memory
            if derivatives:
                values, jacobian = value_and_jacobian(self.vector, own, always=self.always, roughly=self.roughly)
                jacobian = np.where(np.isfinite(jacobian), np.clip(jacobian, -BIG, BIG), 0.0)
            else:
                values = self.vector(own[None])[:, 0]
            # Infinite numbers are numbers: a limit may be held, or a goal missed, by infinity.
            values, undefined = np.clip(values, -BIG, BIG), np.isnan(values)
            if undefined.any():
                self.mapped += 1
                values = np.where(undefined, BIG, values)
            else:
                self._remember(own, values)
            self._last = (key, values, jacobian)
        _, values, jacobian = self._last
        return values, np.empty((0, 0)) if jacobian is None else jacobian

    def together(self, units: Array) -> Array:
        """Merit and rows, all finite, at many points (N, n) in one call, shape (1 + rows, N)."""
        if not len(units):
            return np.empty((1, 0))
        values = np.clip(self.vector(units), -BIG, BIG)
        undefined = np.isnan(values)
        self.evaluations += len(units)
        self.budget.evaluations -= len(units)
        self.mapped += int(undefined.any(axis=0).sum())
        for k in np.flatnonzero(~undefined.any(axis=0)):
            self._remember(units[k].copy(), values[:, k])
        return np.where(undefined, BIG, values)

    def _remember(self, unit: Array, values: Array) -> None:
        violation = violation_of(values[1:])
        better = violation < self.violation
        if violation <= FEASIBLE:
            better = self.violation > FEASIBLE or values[0] < self.merit
        if better:
            self.unit, self.merit, self.violation = unit, float(values[0]), violation

    @property
    def feasible(self) -> bool:
        """Whether the best point holds every row."""
        return self.violation <= FEASIBLE


def violation_of(rows: Array) -> float:
    """Largest violation of the rows (without the merit), 0 where all hold."""
    return float(np.max(rows, initial=0.0))


def slsqp(guard: Guard, start: ArrayLike, evaluations: int = 300, ftol: float = FTOL) -> None:
    """Sequential quadratic programming from a start (clipped to the box)."""
    import nlopt

    begin = _inside(start)
    rows = len(guard.rows(begin, True)[0]) - 1
    optimiser = nlopt.opt(nlopt.LD_SLSQP, len(begin))

    def merit(x: Array, gradient: Array) -> float:
        values, jacobian = guard.rows(x, gradient.size > 0)
        if gradient.size:
            gradient[:] = jacobian[0]
        return float(values[0])

    def limits(result: Array, x: Array, gradient: Array) -> None:
        values, jacobian = guard.rows(x, gradient.size > 0)
        result[:] = values[1:]
        if gradient.size:
            gradient[:] = jacobian[1:]

    optimiser.set_min_objective(merit)
    if rows:
        optimiser.add_inequality_mconstraint(limits, np.full(rows, ROW_TOLERANCE))
    optimiser.set_ftol_rel(ftol)
    if ftol > FTOL:
        optimiser.set_ftol_abs(ftol)
    optimiser.set_xtol_rel(XTOL)
    _run(optimiser, begin, XTOL, guard.budget.at_most(evaluations, 1 + 2 * len(begin)))


def globally(
    guard: Guard, n: int, algorithm: Global, weight: float, evaluations: int, seed: int, agreed: float = AGREED
) -> Array:
    """A global search over n variables: CRS2_LM on the merit plus `weight` times the violation, or ISRES.

    Gives CRS2_LM's point of least merit plus penalty, feasible or not, once those of its population differ by no more
    than `agreed`; ISRES keeps to the rows themselves, and gives its best feasible point if it met one.
    """
    budget = guard.budget.at_most(evaluations)
    if algorithm == "crs2":
        return _controlled_random(guard, n, weight, budget, np.random.default_rng(seed), agreed)
    import nlopt

    nlopt.srand(seed + 1)  # 0 would mean the clock
    middle = np.full(n, 0.5)
    unit, _ = derivative_free(
        "GN_ISRES",
        lambda unit: (float(guard.rows(unit)[0][0]),),
        middle,
        [lambda unit, k=k: float(guard.rows(unit)[0][k]) for k in range(1, len(guard.rows(middle)[0]))],  # type: ignore[misc]
        ftol=GLOBAL_FTOL,
        xtol=XTOL,
        budget=budget,
    )
    return unit if guard.unit is None else guard.unit


def _controlled_random(
    guard: Guard, n: int, weight: float, budget: SearchBudget, random: np.random.Generator, agreed: float
) -> Array:
    """Controlled random search with local mutation (Kaelo and Ali 2006), `TOGETHER` candidates to a call.

    Each is a simplex's farthest corner, turned over through the middle of the others, the best point among them; what
    betters no point of the population is mirrored about the best by random shares. The better replace the worst.
    """

    def costs_of(units: Array) -> Array:
        budget.evaluations -= len(units)
        values = guard.together(units)
        return np.asarray(values[0] + weight * np.maximum(values[1:], 0.0).sum(axis=0))

    units = random.random((10 * (n + 1), n))
    units[0] = 0.5
    costs = costs_of(units)
    while not budget.ended and not (np.ptp(costs) <= agreed and costs.max() < BIG):
        best = units[costs.argmin()]
        order = random.random((TOGETHER, len(units)))
        order[:, costs.argmin()] = 2.0  # no corner but the best one
        corners = units[order.argsort(axis=1)[:, :n]]
        tried = 2 * (best + corners[:, 1:].sum(axis=1)) / n - corners[:, 0]
        tried = tried[((tried >= 0) & (tried <= 1)).all(axis=1)]
        reached = costs_of(tried)
        worse = reached >= costs.max()
        share = random.random((worse.sum(), n))
        mirrored = np.clip(best + share * (best - tried[worse]), 0.0, 1.0)
        reached[worse], tried[worse] = costs_of(mirrored), mirrored
        for cost, unit in zip(reached, tried, strict=True):
            worst = costs.argmax()
            if cost < costs[worst]:
                units[worst], costs[worst] = unit, cost
    return np.asarray(units[costs.argmin()])


def derivative_free(
    algorithm: Literal["LN_NELDERMEAD", "LN_SBPLX", "GN_CRS2_LM", "GN_ISRES"],
    cost: Callable[[Array], tuple[float, ...]],
    start: Array,
    limits: Sequence[Callable[[Array], float]] = (),
    *,
    step: float = 0.1,
    ftol: float = 0.0,
    xtol: float,
    budget: SearchBudget,
) -> tuple[Array, int]:
    """The point of least cost that one of nlopt's algorithms meets from a start, and how many points it tried.

    The cost may have kinks; its first number is made small, further ones decide between equals. Only ISRES holds limits
    (not above 0). The budget is the caller's to spend.
    """
    import nlopt

    best, count = (cost(start), start), 0

    def value(x: Array, _: Array) -> float:
        nonlocal best, count
        count += 1
        unit = np.array(x)
        own = cost(unit)
        if own < best[0]:
            best = (own, unit)
        return own[0]

    optimiser = nlopt.opt(getattr(nlopt, algorithm), len(start))
    optimiser.set_min_objective(value)
    for limit in limits:
        optimiser.add_inequality_constraint(lambda x, _, limit=limit: limit(x), FEASIBLE)
    optimiser.set_initial_step(np.full(len(start), step))
    optimiser.set_ftol_rel(ftol)
    _run(optimiser, start, xtol, budget)
    return best[1], count


def _run(optimiser: Any, start: ArrayLike, xtol: float, budget: SearchBudget) -> None:
    """Run; callers keep the best point, for on round-off and where a search breaks down nlopt gives none back."""
    import nlopt

    if budget.ended:
        return
    n = optimiser.get_dimension()
    optimiser.set_lower_bounds(np.zeros(n))
    optimiser.set_upper_bounds(np.ones(n))
    optimiser.set_xtol_abs(xtol)
    optimiser.set_maxeval(int(1 + budget.evaluations))  # the start is known already
    if math.isfinite(budget.deadline):
        optimiser.set_maxtime(max(budget.deadline - time.monotonic(), 1e-3))  # 0 would be no limit
    # From one version of nlopt to the next its exceptions change their names, and whether they are RuntimeErrors.
    names = ("RoundoffLimited", "roundoff_limited", "runtime_error")
    with suppress(RuntimeError, *(getattr(nlopt, name) for name in names if hasattr(nlopt, name))):
        optimiser.optimize(_inside(start))


def _inside(unit: ArrayLike) -> Array:
    inside: Array = np.clip(np.array(unit, float), 0.0, 1.0)
    return inside


def least_violation(
    guard: Guard, starts: Sequence[Array], weights: Sequence[float] | None = None, evaluations: int = 200
) -> tuple[Array, Array]:
    """The point of least weighted violation, by relaxing each row, and its rows (positive: violated).

    The guard remembers every point tried, so that a feasible one met on the way is kept. A weight says what a scaled
    unit of a row's violation costs; infinite keeps the row hard. Without weights: 1 each.
    """
    n, count = len(starts[0]), len(guard.rows(_inside(starts[0]))[0]) - 1
    costs = np.ones(count) if weights is None else np.asarray(weights, float)
    soft = np.isfinite(costs)

    def relaxed(units: Array) -> Array:
        """Weighted sum of slacks, rows less their slacks."""
        points, which = np.unique(units[:, :n], axis=0, return_inverse=True)  # slacks vary alone at many
        every = guard.vector(points)[1:] if guard.limits is None else guard.limits(points)
        rows = every[:, np.ravel(which)]
        slack = np.zeros_like(rows)
        slack[soft] = LARGEST_SLACK * units[:, n:].T
        return np.concatenate([GENTLE * (costs[soft] @ slack[soft])[None], rows - slack])

    best: tuple[float, float, Array, Array] | None = None
    for start in starts:
        if best is not None and guard.budget.ended:
            break
        inner = Guard(relaxed, guard.budget, roughly=guard.roughly)
        over = np.maximum(guard.rows(_inside(start))[0][1:], 0.0)
        slsqp(inner, np.concatenate([start, over[soft] * 1.01 / LARGEST_SLACK]), evaluations, GENTLE * COARSE)
        if inner.unit is None:
            continue
        if not soft.all() or inner.merit < GENTLE * FAR * COARSE:  # else nothing near it holds
            slsqp(inner, inner.unit, evaluations)
        unit = inner.unit[:n]
        rows = guard.rows(unit)[0][1:]
        over = np.maximum(rows, 0.0)
        cost, hard = float(over[soft] @ costs[soft]), float(over[~soft].max(initial=0.0))
        if best is None or (round(hard, 7), cost) < best[:2]:
            best = (round(hard, 7), cost, unit, rows)
        if hard <= 1e-9 and cost <= 1e-10:
            break
    if best is None:
        unit = _inside(starts[0])
        return unit, guard.rows(unit)[0][1:]
    return best[2], best[3]


@by_value
@dataclass(frozen=True)
class Search:
    """Result of one search."""

    unit: Array
    """Scaled variables."""
    merit: float
    violation: float
    evaluations: int
    mapped: int
    """Evaluations with a value that was undefined."""
    clipped: bool
    """Whether the start lay outside the bounds and was moved onto them."""

    @property
    def feasible(self) -> bool:
        """Whether every row holds."""
        return self.violation <= FEASIBLE


def search(
    vector: Vector,
    start: ArrayLike,
    budget: SearchBudget | None = None,
    evaluations: int = 300,
    tolerance: float = FTOL,
    always: int = 0,
    limits: Vector | None = None,
) -> Search:
    """SLSQP from a start, by way of the least violation where it does not reach a feasible point, then polished.

    Parameters
    ----------
    vector : callable
        Merit and rows over the unit box.
    start : array-like, shape (n,)
        Outside the unit box it is clipped to it.
    budget : SearchBudget, optional
        It is spent.
    evaluations : int
        Of each run, at most.
    tolerance : float
        Change of the merit, absolute and relative, at which a search ends. The finest, `FTOL`, is polished: the run is
        repeated from its own end until nothing is gained.
    always : int
        How many of the first rows hold always: derivatives keep inside.
    limits : callable, optional
        The rows alone, where the merit takes long.
    """
    polish = tolerance <= FTOL
    guard = Guard(vector, budget or SearchBudget(), always, limits, roughly=not polish)
    begin = _inside(np.nan_to_num(np.asarray(start, float), nan=0.5))
    with guard.budget.interruptible():
        slsqp(guard, begin, evaluations, tolerance)
        if not (guard.feasible or guard.budget.ended):
            starts = [begin] if guard.unit is None else [guard.unit, begin][: 2 if polish else 1]
            unit, _ = least_violation(guard, starts, evaluations=evaluations)
            if guard.feasible:
                slsqp(guard, unit, evaluations, tolerance)
        for _ in range(4 if polish else 0):
            before = guard.merit
            if guard.unit is None or not guard.feasible or guard.budget.ended:
                break
            slsqp(guard, guard.unit, evaluations)
            if before - guard.merit <= 1e-12 * max(1.0, abs(before)):
                break
    unit, merit, violation = _on_limits(guard, begin)
    clipped = bool((np.asarray(start) != begin).any())
    return Search(unit, merit, violation, guard.evaluations, guard.mapped, clipped)


def _on_limits(guard: Guard, begin: Array) -> tuple[Array, float, float]:
    """The guard's best point, moved by Newton's method exactly onto the limits that it touches."""
    if guard.unit is None:
        return begin, BIG, BIG
    unit, merit, violation = guard.unit, guard.merit, guard.violation
    if violation > FEASIBLE:
        return unit, merit, violation
    moved = unit
    for _ in range(4):
        values, jacobian = guard.rows(moved, True)
        rows = values[1:]
        touching = rows > -NEAR
        over = violation_of(rows)
        if over <= violation and values[0] <= merit + 1e-6:
            unit, merit, violation = moved, float(values[0]), over
        if not touching.any() or over <= 1e-15:
            break
        free = (moved > 0) & (moved < 1)
        step = np.zeros_like(moved)
        step[free] = -np.linalg.lstsq(jacobian[1:][touching][:, free], rows[touching], rcond=1e-12)[0]
        moved = _inside(moved + step)
    return unit, merit, violation
