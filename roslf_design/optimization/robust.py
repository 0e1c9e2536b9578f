"""Designs for builds that scatter: yield or a quantile maximised with the same deviations at every design tried.

The same random numbers for every design (common random numbers) make a sample's yield a fixed function of the design,
so that two designs differ by what they are and not by chance. The final figures come from other, fresh numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from .._arrays import Array, by_value
from ..bore.conjugates import CONJUGATES
from ..camera import Camera, Number
from ..design import Design
from ..errors import InputError, Problem
from ..progress import CountedProgress, silent
from ..theory.length_covariance import LengthCovariance
from ..theory.quantity import FEASIBLE
from ..tolerancing.draws import Distribution, Draws, Perturbation
from ..tolerancing.places import expand, nominal_values, tolerance_at
from ..tolerancing.yields import Yield, least_passed
from ..toml_files import StrictTable
from .problem import DesignProblem
from .search import Guard, SearchBudget, derivative_free, followed, slsqp
from .variables import IDLE

SHARP = (0.3, 0.1, 0.03, 0.01)
"""Widths at which the yield's step is softened, one after the other, in units of a scaled row's spread."""
SMOOTH, STEEP = 1e-5, 1e-4
"""Changes of the yield at which a search along its slope ends, and one that gets over the kinks of the worst row."""
AT_ONCE = 20_000
"""Builds that are looked at in one call."""
FRESH = 16
"""Times as many trials for the final figures."""
HARD = 20.0
"""Penalty on a missing share of the yield, or of the goal, against what is maximised."""


class PerturbTable(StrictTable):
    """Perturbation of one or more places in a robust study."""

    place: tuple[str, ...]
    tolerance: str | float
    distribution: Distribution = "normal"
    truncate: Annotated[float, Field(ge=1e-3, le=1e3)] = 2.0

    @field_validator("place", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _readable(self, info: ValidationInfo) -> PerturbTable:
        if design := (info.context or {}).get("design"):
            self.misses(design)
        return self

    def misses(self, design: Design) -> dict[str, tuple[Perturbation, bool]]:
        """Place to its perturbation, and whether that is a share of a length; a ValueError where a design has none."""
        misses, nominal, share = {}, nominal_values(design), str(self.tolerance).strip().endswith("%")
        for name in self.place:
            for place in expand(design, name):
                if place == CONJUGATES[1]:
                    raise ValueError("the focal plane is no part of the hardware; let f or d_1 miss instead")
                if any(word in place for word in IDLE):
                    raise ValueError(f"'{name}' changes nothing that an optimisation looks at; drop it")
                width = tolerance_at(design, place, self.tolerance)
                misses[place] = Perturbation(place, nominal[place], width, self.distribution, self.truncate), share
        return misses


class RobustTable(StrictTable):
    """Settings of a robust optimisation."""

    maximise: Literal["yield", "quantile"] = "yield"
    """"yield": the share of builds that hold every constraint; "quantile": the first goal, as `quantile` of the builds
    reach it, with at least `wanted_yield` for sure: the lower end of the yield's interval reaches it."""
    quantile: Annotated[float, Field(gt=0, lt=1)] = 0.9
    wanted_yield: Annotated[float, Field(gt=0, le=1)] = 0.9
    give_up: Annotated[float, Field(gt=0)] | None = None
    """Share of the first goal that robustness may cost at most; None: any."""
    trials: Annotated[int, Field(ge=16, le=100_000)] = 512
    perturb: Annotated[tuple[PerturbTable, ...], Field(min_length=1)]


@by_value
@dataclass(frozen=True)
class Scatter:
    """Perturbations of builds, and their deviations."""

    perturbations: tuple[Perturbation, ...]
    deviations: Array
    """[tolerances], shape (P, T): common to all designs."""
    fresh: Array
    """Others, for the final figures."""
    relative: tuple[bool, ...]
    """True where a perturbation's tolerance is a share of the nominal value."""

    def tolerances(self, problem: DesignProblem, units: Array) -> dict[str, Number]:
        """Place to its tolerance at designs (..., n) [mm or rad]: shares are of each design's own numbers."""
        nominal = problem.cameras(units)
        return {
            miss.place: miss.tolerance * (np.abs(nominal[miss.place]) / miss.nominal if relative else 1.0)
            for miss, relative in zip(self.perturbations, self.relative, strict=True)
        }

    def covariance(self, problem: DesignProblem, unit: Array) -> LengthCovariance:
        """Covariance of what one design's builds miss."""
        sizes = self.tolerances(problem, unit)
        shares = np.array([p.sigma / p.tolerance if p.tolerance > 0 else 0.0 for p in self.perturbations])
        sigmas = shares * np.array([float(np.ravel(size)[0]) for size in sizes.values()])
        return LengthCovariance(tuple(sizes), np.diag(sigmas**2))

    def builds(self, problem: DesignProblem, units: Array, deviations: Array) -> Camera:
        """Builds of designs (N, n), shape (N T,): hardware with deviations, f and d_1 too; the focal plane follows."""
        units = np.atleast_2d(units)[:, None]
        nominal, applied = problem.cameras(units), self.tolerances(problem, units).items()
        changes = {place: nominal[place] + size * row for (place, size), row in zip(applied, deviations, strict=True)}
        return nominal.replace(changes).in_row((len(units), deviations.shape[1]), slice(None))


@dataclass(frozen=True)
class _BuildStatistics:
    """How one design's builds do, on fresh deviations."""

    yield_: Yield
    goal_nominal: float
    goal_quantile: float
    """Value of the goal that `quantile` of the builds reach; not finite where too many are no cameras."""
    each: tuple[float, ...]
    """Share of builds that hold each constraint."""

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        share = {"yield": self.yield_.value, "interval_95": self.yield_.interval}
        return share | {"goal": self.goal_nominal, "goal_quantile": self.goal_quantile}


@by_value
@dataclass(frozen=True)
class Robust:
    """The robust design beside the nominal one."""

    scatter: Scatter
    unit: Array
    nominal: _BuildStatistics
    robust: _BuildStatistics
    constraint_yields: tuple[tuple[str, float, float], ...]
    """Yields of each constraint: label, share of nominal and of robust builds that hold it."""
    evaluations: int

    @property
    def trials(self) -> int:
        """Number of builds that judge both."""
        return len(self.scatter.fresh[0])


def scatter_of(table: RobustTable, design: Design, seed: int) -> Scatter:
    """Resolve what builds miss.

    Raises
    ------
    InputError
        Unknown places, unreadable tolerances, places that no quantity depends on.
    """
    faults: list[Problem] = []
    misses: dict[str, tuple[Perturbation, bool]] = {}
    for index, line in enumerate(table.perturb):
        try:
            misses |= line.misses(design)
        except ValueError as error:
            faults.append(Problem(f"robust.perturb.{index}", str(error)))
    if faults:
        raise InputError(tuple(faults))
    perturbations = tuple(miss for miss, _ in misses.values())
    relative = tuple(share for _, share in misses.values())
    draws = Draws(perturbations, seed=seed)
    common, fresh = draws.uniforms(0, table.trials), draws.uniforms(1, FRESH * table.trials)
    return Scatter(perturbations, draws.deviations(common), draws.deviations(fresh), relative)


def maximise_robustness(
    problem: DesignProblem,
    table: RobustTable,
    scatter: Scatter,
    nominal: Array,
    budget: SearchBudget,
    tell: CountedProgress = silent,
) -> Robust:
    """Maximise yield, or a quantile of the first goal, as a study's table says, starting from the nominal optimum.

    Builds are held to the problem's constraints. The nominal optimum is scaled; the budget is spent.
    """
    aim = _Aim(replace(problem, goals=problem.goals[:1]), table, scatter, problem.number(problem.goals[0], nominal))
    best, spent, most = nominal, 0, 50 * problem.n * (1 + 2 * problem.n)  # its designs for derivatives, too

    def heard(number: int, tried: float, most: float) -> None:
        tell(f"robust: {table.maximise}", (number + tried / most) / len(SHARP), 1.0)

    for number, width in enumerate(SHARP):
        guard = Guard(followed(partial(aim.vector, width=width), partial(heard, number), most), budget)
        slsqp(guard, best, 50 * problem.n, SMOOTH)
        if width == SHARP[-1]:
            derivative_free(
                "LN_SBPLX",
                partial(_penalised, guard),
                best if guard.unit is None else guard.unit,
                step=0.05,
                ftol=STEEP,
                xtol=1e-5,
                budget=budget.at_most(150 * problem.n),
            )
        best, spent = best if guard.unit is None else guard.unit, spent + guard.evaluations
    before, after = aim.statistics(nominal), aim.statistics(best)
    first, last = before.yield_, after.yield_
    lost = first.interval[0] >= table.wanted_yield > last.interval[0]
    if lost if table.maximise == "quantile" else first.value > last.value:
        best, after = nominal, before  # fresh numbers are the judge
    labels = [constraint.label for constraint in problem.constraints]
    yields = tuple(zip(labels, before.each, after.each, strict=True))
    return Robust(scatter, best, before, after, yields, spent)


@by_value
@dataclass(frozen=True)
class _Aim:
    """Merit of a design over its builds."""

    problem: DesignProblem
    """Problem with the first goal alone."""
    table: RobustTable
    scatter: Scatter
    goal_at_nominal: float

    @cached_property
    def least_yield(self) -> float:
        """Share of the trials that must hold every constraint for the target yield to be sure."""
        return least_passed(self.table.wanted_yield, self.table.trials) / self.table.trials

    def vector(self, units: Array, width: float) -> Array:
        """Merit over builds and, where there is one, the row that must not be above 0; shape (1 or 2, N).

        Of designs (N, n), the yield's steps softened by a width; not finite where a design is no camera.
        """
        most = max(1, AT_ONCE // self.table.trials)
        parts = [self._vector(units[first : first + most], width) for first in range(0, len(units), most)]
        return np.concatenate(parts, axis=1)

    def _vector(self, units: Array, width: float) -> Array:
        problem, table, count = self.problem, self.table, len(units)
        nominal = problem.cameras(units)
        built = self.scatter.builds(problem, units, self.scatter.deviations)
        rows = problem.rows_of(built, count * table.trials).reshape(-1, count, table.trials)
        worst = np.clip(np.where(np.isnan(rows), 1e3, rows).max(axis=0, initial=-1e3), -50.0, 50.0)
        soft = np.mean(1 / (1 + np.exp(np.clip(worst / (0.1 * width), -50, 50))), axis=-1)
        with np.errstate(all="ignore"):
            none = np.where(np.isnan(problem.merit(nominal)), np.nan, 0.0)
            if table.maximise == "quantile":
                return np.stack([self._quantile(built, count)[0] + none, self.least_yield - soft])
            # Far from any yield, the margin itself leads the way.
            total: Array = 1e-3 * np.clip(worst, 0, 5).mean(axis=-1) - soft + none
            if table.give_up is None:
                return total[None]
            goal, before = problem.goals[0], self.goal_at_nominal
            value = goal.values(nominal)
            lost = goal.sign * (value - before) / max(abs(before), 1e-300)
            if math.isinf(before):  # all of it, or nothing
                lost = (value != before).astype(float)
            return np.stack([total, np.broadcast_to(lost, count) - table.give_up])

    def _quantile(self, built: Camera, count: int) -> tuple[Array, Array]:
        """Merit and value of the goal that `quantile` of the builds of each of so many designs reach."""
        with np.errstate(all="ignore"):
            merit = np.broadcast_to(self.problem.merit(built), built.shape).reshape(count, -1)
            values = np.broadcast_to(self.problem.goals[0].values(built), built.shape).reshape(count, -1)
        merit = np.where(np.isnan(merit), np.inf, merit)
        trials = merit.shape[1]
        at = np.argsort(merit)[:, min(trials, math.ceil(self.table.quantile * trials)) - 1, None]
        return np.take_along_axis(merit, at, 1)[:, 0], np.take_along_axis(values, at, 1)[:, 0]

    def statistics(self, unit: Array) -> _BuildStatistics:
        """Statistics on fresh deviations."""
        problem, fresh = self.problem, self.scatter.fresh
        count = fresh.shape[1]
        built = self.scatter.builds(problem, unit, fresh)
        held = np.nan_to_num(problem.rows_of(built, count), nan=np.inf) <= FEASIBLE
        owner = np.array([row.constraint for row in problem.rows])
        each = tuple(float(held[owner == k].all(axis=0).mean()) for k in range(len(problem.constraints)))
        passed, (_, reached) = Yield(int(held.all(axis=0).sum()), count), self._quantile(built, 1)
        return _BuildStatistics(passed, problem.number(problem.goals[0], unit), float(reached[0]), each)


def _penalised(guard: Guard, unit: Array) -> tuple[float]:
    """Merit with a penalty on the row that is to hold."""
    values, _ = guard.rows(unit)
    return (float(values[0] + HARD * np.maximum(values[1:], 0.0).sum()),)
