"""The best combinations of catalogue parts, the continuous rest optimised for each.

Branch and bound: boxes of variables that cannot hold a feasible camera, or none good enough for the list, are left out
for all combinations at once; what remains is split, and the most promising combinations are optimised as they come up.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .bounds import Boxes
from .combinations import Combinations
from .local import Search, search
from .sampling import sobol_units

Array = NDArray[np.float64]

AT_ONCE = 10
"""Combinations optimised between two rounds of splitting."""
BOXES = 200_000
"""Most boxes kept; beyond, splitting stops and the rest is optimised in the order of bounds."""
ROUNDS = 16
TIES = 1e-3
"""Merit within which quick searches do not decide: such combinations are searched again, thoroughly, in the end."""


@dataclass(frozen=True)
class Ranked:
    """One combination, optimised."""

    number: int
    search: Search


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
    """Combinations neither ruled out nor optimised when the time was up; 0: the list is complete."""
    evaluations: int
    seconds: float


def rank(
    combinations: Combinations,
    keep: int,
    seconds: float,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Ranking:
    """Find the best combinations.

    Parameters
    ----------
    combinations : Combinations
    keep : int
        How many.
    seconds : float
        After which the best so far count.
    seed : int
        Of further starts.
    tell : callable
        Told what is being done.
    """
    began = time.monotonic()
    n, count = combinations.problem.n, len(combinations)
    state = _State(combinations, keep, began + seconds, sobol_units(n, 1, seed))
    boxes = Boxes(combinations, np.arange(count), np.zeros((count, n)), np.ones((count, n)))
    for round_ in range(ROUNDS):
        boxes = boxes.shaved(state.threshold)
        bound = boxes.bound()
        alive = (bound < state.threshold) & ~state.done[boxes.owner]
        boxes, bound = boxes.where(alive), bound[alive]
        if not len(boxes) or time.monotonic() > state.deadline:
            break
        left = len(np.unique(boxes.owner))
        tell(f"catalogue: {left} of {count} combinations left, {state.optimised} optimised")
        # From the first round on: bounds rule out more, the better what they are held against.
        state.settle(boxes, bound, AT_ONCE)
        alive = (bound < state.threshold) & ~state.done[boxes.owner]
        boxes = boxes.where(alive)
        if 2 * len(boxes) > BOXES:
            break
        if round_ % 2:
            boxes = boxes.split()
    bound = boxes.bound()
    while len(boxes) and time.monotonic() < state.deadline:
        alive = (bound < state.threshold) & ~state.done[boxes.owner]
        boxes, bound = boxes.where(alive), bound[alive]
        if len(boxes):
            tell(f"catalogue: {len(np.unique(boxes.owner))} combinations left, {state.optimised} optimised")
            state.settle(boxes, bound, AT_ONCE)
    state.polish()
    alive = (bound < state.threshold) & ~state.done[boxes.owner]
    open_ = len(np.unique(boxes.owner[alive]))
    return Ranking(
        combinations,
        tuple(state.best),
        count - state.optimised - open_,
        state.optimised,
        open_,
        state.evaluations,
        time.monotonic() - began,
    )


class _State:
    """The list so far."""

    def __init__(self, combinations: Combinations, keep: int, deadline: float, starts: Array) -> None:
        self.combinations, self.keep, self.deadline, self.starts = combinations, keep, deadline, starts
        self.best: list[Ranked] = []
        self.done = np.zeros(len(combinations), bool)
        self.optimised = self.evaluations = 0

    @property
    def threshold(self) -> float:
        """Merit that a combination must beat to enter the list."""
        return self.best[self.keep - 1].search.merit + TIES if len(self.best) >= self.keep else np.inf

    def settle(self, boxes: Boxes, bound: Array, count: int) -> None:
        """Optimise the most promising combinations, from the middle of their best boxes."""
        order = np.lexsort((boxes.owner, bound))
        tried = 0
        for index in order:
            number = int(boxes.owner[index])
            if self.done[number]:
                continue
            if bound[index] >= self.threshold or tried == count or time.monotonic() > self.deadline:
                return
            tried += 1
            self._optimise(number, boxes.low[index], boxes.high[index])

    def _optimise(self, number: int, low: Array, high: Array) -> None:
        self.done[number] = True
        self.optimised += 1
        try:
            problem = self.combinations.problem_at(number)
        except InputError:
            return  # these parts make no design
        found = None
        for start in ((low + high) / 2, *(low + self.starts * (high - low))):
            result = search(problem, start, self.deadline + 1.0, 80, polish=False)
            self.evaluations += result.evaluations
            if result.feasible:
                found = result
                break
        if found is not None:
            self.best.append(Ranked(number, found))
            self.best.sort(key=lambda ranked: (ranked.search.merit, ranked.number))
            del self.best[3 * self.keep :]

    def polish(self) -> None:
        """Search again, thoroughly, from what the list holds."""
        polished = []
        for ranked in [each for each in self.best if each.search.merit < self.threshold]:
            again = search(self.combinations.problem_at(ranked.number), ranked.search.unit, self.deadline + 10.0)
            self.evaluations += again.evaluations
            better = again.feasible and again.merit < ranked.search.merit
            polished.append(Ranked(ranked.number, again) if better else ranked)
        self.best = sorted(polished, key=lambda ranked: (ranked.search.merit, ranked.number))[: self.keep]
