"""The best combinations of catalogue parts, the continuous rest optimised for each.

Branch and bound: boxes of variables that cannot hold a feasible camera, or none good enough for the list, are left out
for all combinations at once; what remains is split, and the most promising combinations are optimised as they come up.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, by_value
from ..camera import Camera
from ..errors import InputError
from ..progress import CountedProgress, silent
from ..theory.quantity import FEASIBLE
from .bounds import CORNERS, SLICES, Boxes, Refused, prunable, refused
from .combinations import FULL_WELL, Combinations
from .conflict import Conflict, explain
from .problem import DesignProblem, promising_starts, sobol_units
from .search import BIG, QUICK, Search, SearchBudget, violation_of
from .solve import SETTLED, reached_untraced, searched, settled
from .traces import Retrace
from .variables import lengths_and_numbers

AT_ONCE = 10
"""Combinations optimised between two rounds of splitting."""
MOST_BOXES = 200_000
"""Beyond, splitting stops and the rest is optimised in the order of bounds."""
ROUNDS = 16
TRIED_IN_VAIN = 2
"""Starts of traced searches after which a combination of which none holds the limits is left."""
GLANCES, NEAREST, NEARLY = 64, 8, 0.1
"""Points at which combinations are glanced at that no bounds put in an order, those of them whose goals are looked at,
and what these may miss limits by: others between them miss them by less."""
TIES = 1e-3
"""Merit within which quick searches do not decide: such combinations are searched again, thoroughly, in the end."""


@by_value
@dataclass(frozen=True)
class Ranked:
    """Combination of parts, optimised."""

    number: int
    search: Search
    problem: DesignProblem
    """Problem solved: numbers of the whole camera as rays tell them there."""


@by_value
@dataclass(frozen=True)
class Ranking:
    """The best combinations."""

    combinations: Combinations
    best: tuple[Ranked, ...]
    """Best first, feasible ones only."""
    ruled_out: int
    """Combinations that bounds showed to be infeasible or not good enough."""
    optimised: int
    open: int
    """Combinations neither ruled out nor optimised when the budget was spent; 0: the list is complete."""
    seconds: float
    nearest: int | None = None
    """Where none is feasible, the combination that comes nearest among those that were searched."""
    conflict: Conflict | None = None
    """Conflict that keeps it from being feasible; None where it makes no camera at all."""
    left_out: tuple[tuple[int, str], ...] = ()
    """Combinations that were optimised and are not among the best, each with the reason why."""
    refused: tuple[Refused, ...] = ()
    """Limits that parts rule out before any search, whatever varies; among `ruled_out`."""
    stopped: bool = False
    """Whether somebody stopped the search: the list is the best so far, not polished."""

    def to_dict(self, retraces: tuple[Retrace, ...], timings: bool) -> dict[str, Any]:
        """As results have it; `retraces` of the best behind a real lens."""
        rows = []
        for place, ranked in enumerate(self.best, 1):
            problem, unit = ranked.problem, ranked.search.unit
            rows.append(
                {
                    "rank": place,
                    "parts": self.named(ranked.number),
                    "microlens_array_cut": self.combinations.cut_words(ranked.number, unit) or None,
                    "goals": {goal.label: problem.number(goal, unit) for goal in problem.goals},
                    **lengths_and_numbers(problem.named(unit)),
                    "file": f"parts-{place:02d}.toml",
                    **({"traced": retraces[place - 1].to_dict()} if retraces else {}),
                }
            )
        data = {
            "combinations": len(self.combinations),
            "ruled_out_by_bounds": self.ruled_out,
            "refused": [limit.to_dict() for limit in self.refused],
            "stopped": self.stopped,
            "optimised": self.optimised,
            "open": self.open,
            "best": rows,
            "nearest": None if self.nearest is None else self._nearest(self.nearest),
            "left_out": [{"parts": self.named(number), "why": why} for number, why in self.left_out],
        }
        return data | {"seconds": self.seconds} if timings else data

    def _nearest(self, number: int) -> dict[str, Any]:
        """Where no combination of parts is feasible: which comes nearest, and why it is not."""
        return {"parts": self.named(number), **({} if self.conflict is None else self.conflict.to_dict())}

    def named(self, number: int) -> dict[str, str]:
        """Kind to the name of a combination's part."""
        chosen = self.combinations.chosen(number)
        return {kind: part.part for kind, part in zip(self.combinations.kinds, chosen, strict=True)}

    @property
    def with_assumed_well(self) -> tuple[str, ...]:
        """Sensors of the best combinations that state no full well."""
        listed = (part for ranked in self.best for part in self.combinations.chosen(ranked.number))
        open_ = (part.part for part in listed if FULL_WELL in part.declares and FULL_WELL not in part.declared)
        return tuple(dict.fromkeys(open_))

    def ordered(self, ranked: Ranked) -> dict[str, str]:
        """`named`, an array that is cut with its size."""
        names, cut = self.named(ranked.number), self.combinations.cut_words(ranked.number, ranked.search.unit)
        return names | ({"microlens_arrays": f"{names['microlens_arrays']}, {cut}"} if cut else {})


class _Ranker:
    """Branch and bound over boxes of combinations."""

    def __init__(
        self,
        combinations: Combinations,
        keep: int,
        budget: SearchBudget,
        seed: int,
        starts: int,
        tell: CountedProgress = silent,
    ) -> None:
        n, count = combinations.problem.n, len(combinations)
        self.tell, self.began, self.all = tell, time.monotonic(), budget.evaluations
        self.combinations, self.keep, self.budget, self.seed, self.starts = combinations, keep, budget, seed, starts
        self.middle = sobol_units(n, 1, seed)[0]
        self.best: list[Ranked] = []
        self.nearest: Ranked | None = None
        self.reasons: dict[int, str] = {}
        self.done = np.zeros(count, bool)
        self.refused = tuple(refused(combinations))
        left = np.setdiff1d(np.arange(count), [number for limit in self.refused for number in limit.numbers])
        self.boxes = Boxes(combinations, left.astype(np.intp), np.zeros((len(left), n)), np.ones((len(left), n)))
        self.bound: Array = np.zeros(len(left))
        self.promise = np.zeros(count)
        if not all(prunable(combinations.problem, goal) for goal in combinations.problem.goals):
            self.promise[left] = promise(combinations, left, seed)

    @property
    def threshold(self) -> float:
        """Merit that a combination must beat to enter the list."""
        return self.best[self.keep - 1].search.merit + TIES if len(self.best) >= self.keep else np.inf

    @property
    def left(self) -> int:
        """Number of combinations that boxes are left of."""
        return len(np.unique(self.boxes.owner))

    @property
    def share(self) -> float:
        """Share of the search that is done, if combinations to come cost what those so far did; it never falls.

        Of the combinations that bounds leave or, where that ends first, of the budget; 0 until one is optimised.
        """
        if not self.done.any():
            return 0.0
        optimised, left = int(self.done.sum()), len(np.unique(self.boxes.owner[~self.done[self.boxes.owner]]))
        spent = 1 - self.budget.evaluations / self.all if math.isfinite(self.all) else 0.0
        clock = (time.monotonic() - self.began) / max(self.budget.deadline - self.began, 1e-9)
        return min(max(optimised / (optimised + left), spent, clock), 1.0)

    def heard(self) -> None:
        """Tell how far it is."""
        self.budget.heard(self.tell, "catalogue: combinations", self.share, 1.0)

    def shave(self) -> None:
        """Cut off what bounds rule out."""
        n = self.combinations.problem.n
        self.budget.evaluations -= len(self.boxes) * n * SLICES * 2**n / CORNERS
        self.boxes = self.boxes.shaved(self.threshold)
        self.bound = self.boxes.bound()

    def clear(self) -> None:
        """Drop boxes that cannot hold anything for the list any more."""
        left = (self.bound < self.threshold) & ~self.done[self.boxes.owner]
        self.boxes, self.bound = self.boxes.where(left), self.bound[left]

    def split(self) -> None:
        """Split each box in two, which have its bound."""
        self.boxes, self.bound = self.boxes.split(), np.concatenate([self.bound, self.bound])

    def optimise(self, number: int, low: Array, high: Array) -> None:
        """Optimise a combination from the middle of a box, and from another point of it."""
        try:
            problem = self.combinations.problem_at(number)
        except InputError as error:
            self.done[number] = True
            self.reasons[number] = f"no camera within the bounds: {error.problems[0]}"
            return
        begin = [(low + high) / 2, low + self.middle * (high - low)]
        asked = problem
        if problem.traced or problem.by_rays:
            results, problem, asked = self._traced(problem, begin)
        else:
            results = self._closed(problem, begin)
        designs = [result for result in results if result.feasible]
        if not designs and self.budget.ended == "stopped":  # what a search missed that was cut short is no reason
            return
        self.done[number] = True
        if designs:
            ranked = Ranked(number, min(designs, key=lambda result: result.merit), problem)
            self.best = sorted([*self.best, ranked], key=_order)[: 3 * self.keep]
        least = Ranked(number, min(results, key=lambda result: result.violation), problem)
        self.reasons[number] = "holds every limit, others are better" if designs else _missed(asked, least.search)
        self.nearest = min(self.nearest or least, least, key=lambda one: one.search.violation)

    def _closed(self, problem: DesignProblem, begin: Sequence[Array]) -> list[Search]:
        """Searches from one start after the other, until one ends at a design."""
        results: list[Search] = []
        for start in begin:
            if problem.summed:  # most combinations hold no limits, which takes no goal to tell
                results.append(self._searched(problem.without_goals(), start))
                if not results[-1].feasible:
                    continue
                start = results.pop().unit
            results.append(self._searched(problem, start))
            if results[-1].feasible:
                break
        return results

    def _traced(self, problem: DesignProblem, begin: list[Array]) -> tuple[list[Search], DesignProblem, DesignProblem]:
        """Searches behind a real lens: of what closed forms tell, which take no rays, then of the thin-lens model.

        Rays are traced from its optimum on, and from other starts where that holds the limits. Beside them the problem,
        with what rays tell of the whole camera where they end, and with those limits alone that were looked at.
        """
        problem, part, near = reached_untraced(problem, begin[0], self.seed, self._searched, self.budget)
        if not near.feasible:
            rows = np.nan_to_num(problem.limits(near.unit[None])[:, 0], nan=BIG)
            return [replace(near, violation=violation_of(rows))], problem, part
        thin = self._searched(replace(problem, thin=True), near.unit)
        problem, _ = problem.told_by_rays(thin.unit)
        results: list[Search] = []
        for first in promising_starts(problem, [thin.unit, near.unit, *begin], self.starts, self.seed):
            held = self._searched(problem.without_goals(), first)
            results.append(self._searched(problem, held.unit) if held.feasible else held)
            if len(results) == TRIED_IN_VAIN and not any(result.feasible for result in results):
                break
        best = min(results, key=lambda result: (not result.feasible, result.merit, result.violation))
        problem, moved = problem.told_by_rays(best.unit)
        if moved > SETTLED:
            problem, best, _ = settled(problem, best.unit, SETTLED, self._searched)
            results = [best]
        return results, problem, problem

    def _searched(self, problem: DesignProblem, start: Array, reach: float = 1.0) -> Search:
        end = searched(problem, start, self.budget, 80, max(QUICK, problem.finest), reach)
        self.heard()
        return end

    def optimise_promising(self) -> None:
        """Optimise some combinations, from the middle of their best boxes.

        From the first round on: bounds rule out more, the better what they are held against.
        """
        promising = np.lexsort((self.boxes.owner, self.promise[self.boxes.owner], self.bound))
        _, first = np.unique(self.boxes.owner[promising], return_index=True)
        for index in promising[np.sort(first)][:AT_ONCE]:
            self.heard()
            if self.bound[index] >= self.threshold or self.budget.ended:
                break
            self.optimise(int(self.boxes.owner[index]), self.boxes.low[index], self.boxes.high[index])

    def optimise_some(self) -> None:
        """Optimise some combinations, spread over the list, in all of their box."""
        n, count = self.combinations.problem.n, len(self.combinations)
        for number in np.unique(np.linspace(0, count - 1, AT_ONCE).astype(int)).tolist():
            self.optimise(number, np.zeros(n), np.ones(n))

    def search(self) -> None:
        """Split, rule out and optimise until nothing is left that could enter the list, or the budget is spent."""
        splitting, turn = True, 0
        while not self.budget.ended:
            if splitting:
                self.shave()
            self.clear()
            if not self.left:
                break
            self.optimise_promising()
            self.clear()
            splitting = splitting and turn + 1 < ROUNDS and 2 * len(self.boxes) <= MOST_BOXES
            if splitting and turn % 2:
                self.split()
            turn += 1

    def polish(self) -> None:
        """Search the list's combinations again, thoroughly."""

        def thoroughly(problem: DesignProblem, start: Array, reach: float) -> Search:
            return searched(problem, start, self.budget.at_least(1000, 10.0), tolerance=problem.finest, reach=reach)

        polished = []
        for ranked in [each for each in self.best if each.search.merit < self.threshold]:
            problem, best, _ = settled(ranked.problem, ranked.search.unit, FEASIBLE, thoroughly)
            polished.append(Ranked(ranked.number, best, problem))
            if not best.feasible:
                self.reasons[ranked.number] = _missed(problem, best)
            if self.budget.ended == "stopped":  # meanwhile: all stay as they are
                return
        self.best = sorted((one for one in polished if one.search.feasible), key=_order)[: self.keep]
        if polished and not self.best:
            self.nearest = min(polished, key=lambda one: one.search.violation)


def promise(combinations: Combinations, numbers: NDArray[np.intp], seed: int) -> Array:
    """Order in which combinations are looked at whose goals have no bounds: about their merit, of the thin-lens model.

    Of each its best counts of those points, of some, that lie nearest to the limits which are closed forms; those that
    hold them come first.
    """
    problem = replace(combinations.problem, thin=True)
    closed = frozenset(k for k, limit in enumerate(problem.constraints) if not limit.quantity.numeric)
    limited, units = problem.keeping(closed), sobol_units(problem.n, GLANCES, seed)
    rows = [row for row in limited.rows if row.constraint >= 0]

    def cameras(owner: NDArray[np.intp], at: Array) -> Camera:
        return problem.base.replace({**combinations.values(owner), **problem.values(at)}, in_focus=problem.in_focus)

    with np.errstate(all="ignore"):
        each = cameras(np.repeat(numbers, GLANCES), np.tile(units, (len(numbers), 1)))
        measured = [limit.measured(each) for limit in limited.constraints]
        over = np.full((len(rows) + 1, len(numbers) * GLANCES), -BIG)
        for k, row in enumerate(rows):
            over[k] = row.of(measured[row.constraint])
        over[-1] = np.where(each.valid, -BIG, BIG)
        missed = np.nan_to_num(over, nan=BIG, posinf=BIG).max(axis=0).reshape(len(numbers), GLANCES)
        few = np.abs(missed).argsort(axis=1, kind="stable")[:, :NEAREST]  # optima lie on limits
        merit = problem.merit(cameras(np.repeat(numbers, NEAREST), units[few.ravel()]))
        merit = np.nan_to_num(np.broadcast_to(merit, few.size), nan=BIG, posinf=BIG).reshape(few.shape)
    penalty = BIG * np.maximum(np.take_along_axis(missed, few, axis=1) - NEARLY, 0.0)
    return np.asarray((merit + penalty).min(axis=1))


def rank(
    combinations: Combinations,
    keep: int,
    budget: SearchBudget,
    seed: int = 0,
    tell: CountedProgress = silent,
    starts: int = 2,
) -> Ranking:
    """Find the `keep` best combinations; where the budget is spent those that are best so far.

    Of closed forms the first of two starts that ends at a design counts; behind real lenses, where kinks may stop a
    search, the best of all `starts`.
    """
    began, count = time.monotonic(), len(combinations)
    ranker = _Ranker(combinations, keep, budget, seed, starts, tell)
    possible, stopped = ranker.left > 0, False
    try:
        ranker.search()
        if budget.ended != "stopped":
            ranker.polish()
    except KeyboardInterrupt:
        stopped = True
    stopped = stopped or budget.ended == "stopped"
    ranker.clear()
    optimised, left = int(ranker.done.sum()), ranker.left
    conflict, listed = None, {ranked.number for ranked in ranker.best}
    searched_none = not ranker.best and ranker.nearest is None
    if searched_none and possible and not stopped:  # bounds ruled all out, step by step: some tell why
        ranker.optimise_some()
    nearest = None if ranker.best or stopped else ranker.nearest
    if nearest is not None:
        tell("catalogue: finding what stands in the way")
        conflict = explain(nearest.problem, [nearest.search.unit], budget, seed)
    return Ranking(
        combinations=combinations,
        best=tuple(ranker.best[:keep]),
        ruled_out=count - optimised - left,
        optimised=optimised,
        open=left,
        seconds=time.monotonic() - began,
        nearest=None if nearest is None else nearest.number,
        conflict=conflict,
        left_out=tuple((number, why) for number, why in sorted(ranker.reasons.items()) if number not in listed),
        refused=ranker.refused,
        stopped=stopped or budget.ended == "stopped",
    )


def _missed(problem: DesignProblem, nearest: Search) -> str:
    """The limit that a combination misses by most where it comes nearest to holding all, with its value there."""
    rows = problem.vector(nearest.unit[None])[1:, 0]
    rows = np.where(np.isnan(rows), np.inf, rows)
    row = problem.rows[int(np.argmax(rows))]
    if rows.max() <= FEASIBLE:
        return "holds every limit where a goal is undefined"
    if row.constraint < 0:
        return f"no camera: misses {row.label}"
    constraint = problem.constraints[row.constraint]
    return f"misses {row.label}: nearest found {constraint.with_unit(problem.number(constraint, nearest.unit), 4)}"


def _order(ranked: Ranked) -> tuple[float, int]:
    return ranked.search.merit, ranked.number
