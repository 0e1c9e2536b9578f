"""Trials: builds drawn, measured as they come, and adjusted. Trial n again, alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..bore.part import TEMPERATURE
from ..camera import BESIDE, VIEWING_CONDITIONS
from ..design import PATHS, Design
from ..theory.length_covariance import LengthCovariance
from ..theory.quantities import DECODED
from .ideal import IdealBuilds
from .metrics import Question, builds_of, design_built, evaluate_builds, faults_of, focus_moves
from .places import LEFT, nominal_values, of_parts, perturbable
from .study import Adjuster, TolerancePlan

BLOCK = 8192
"""Trials evaluated at once: their arrays stay in a processor's cache."""
STRETCH = 4 * BLOCK
"""Trials adjusted and counted at once: those that need Newton's steps take them together, and histograms are large."""
SETTLED = 0.9
"""Part of the limits' room up to which a build that was adjusted by linear prediction is left alone."""
PILOT, NEAR, SMALL = 64, 1.25, 0.01
"""The first builds, by which prediction is judged: its squares, in limits' rooms, against Newton's; ratio and sum."""
ITERATIONS = 3
"""Gauss-Newton steps, each with a Jacobian of its own trial; the responses are close to linear, so these converge."""
CONVERGED = 2e-3
"""Part of a build's squares: what a step must promise to lower them by, and keep of it for no other to follow."""
ALONG = np.linspace(-1.0, 1.0, 17)
"""Shares of an adjuster's reach at which builds that are no cameras are looked for."""
DAMPING = 1e-10
"""Damping of adjusters that do the same, relative to the largest curvature."""


NUDGE = 1e-3
"""Steps of derivatives [tolerances]."""
DRAWN = 4096
"""Builds that tell what an adjuster leaves whose range ends: a power of two, as evenly drawn points want it."""


class MeasuredTrials(NamedTuple):
    """Consecutive trials, measured."""

    deviations: Array
    """[tolerances], shape (P, trials)."""
    variants: Array
    """Columns as built (then linearly adjusted, then adjusted), shape (V, C, trials)."""
    moved: Array
    """Adjustments [mm, rad], shape (adjusters, trials)."""

    def faults(self, plan: TolerancePlan) -> Iterator[dict[str, NDArray[np.bool_]]]:
        """Variant by variant, why trials are no cameras: reasons to flags over those that have no number at all."""
        for variant, values in enumerate(self.variants):
            lost = np.isnan(values).all(axis=0)
            if not lost.any():
                yield {}
                continue
            deviations = np.ascontiguousarray(self.deviations[:, lost])
            numbers, compensator = plan.draws.values(deviations), _compensator_of(plan) if plan.adjusters else None
            if compensator is not None and variant:
                last = variant == len(self.variants) - 1
                moved = self.moved[:, lost] if last else compensator.linear(deviations)
                numbers = compensator.applied(numbers, moved)
            reasons = faults_of(plan.question, numbers, deviations.shape[1])
            yield {words: flags for words, flags in reasons.items() if flags.any()}


def measure(plan: TolerancePlan, deviations: Array, settled: float = SETTLED) -> MeasuredTrials:
    """Measure trials given by their deviations [tolerances], shape (P, trials); `settled` as in `Compensator`."""
    values, trials = plan.draws.values(deviations), deviations.shape[1]
    variants, moved = [_in_blocks(plan.question, values, trials)], np.empty((0, trials))
    if plan.adjusters:
        moved, *adjusted = _compensator_of(plan).adjusted(values, deviations, settled)
        variants += adjusted[1 - len(plan.variants) :]  # focus is predicted by nothing
    elif plan.calibrated:
        variants.append(_calibrated(plan.question, values, variants[0]))
    return MeasuredTrials(deviations, np.stack(variants), moved)


def measure_finally(plan: TolerancePlan, deviations: Array, scale: float = 1.0, settled: float = SETTLED) -> Array:
    """The last of `measure`'s variants alone, what an analysis looks at: shape (C, trials).

    All tolerances count `scale` times.
    """
    values = plan.draws.values(deviations, scale)
    if plan.adjusters:
        return _compensator_of(plan).adjusted(values, deviations * scale, settled)[-1]
    return _in_blocks(plan.question, values, deviations.shape[1], calibrated=plan.calibrated)


def holding(plan: TolerancePlan, deviations: Array, scale: float = 1.0) -> NDArray[np.bool_]:
    """True where a build holds all limits, (T,): `TolerancePlan.stages` ask those alone that hold what comes before."""
    left = np.arange(deviations.shape[1])
    for stage in plan.stages:
        if left.size:
            left = left[stage.passes(measure_finally(stage, deviations[:, left], scale)).all(axis=0)]
    return np.isin(np.arange(deviations.shape[1]), left)


def _calibrated(question: Question, values: Mapping[str, Array], as_built: Array) -> Array:
    """Columns of builds whose decoder is calibrated on each: those that a decoder has a part in, the rest as built."""
    columns, every = as_built.copy(), question.columns
    asked = question.limited_to(column for column in every if column.metric in DECODED)
    if asked.columns:
        rows = [every.index(column) for column in asked.columns]
        columns[rows] = _in_blocks(asked, values, as_built.shape[1], calibrated=True)
    return columns


def measure_uniforms(plan: TolerancePlan, uniforms: Array) -> MeasuredTrials:
    """Trials given by their independent uniform numbers, shape (factors, trials)."""
    return measure(plan, plan.draws.deviations(uniforms))


def _in_blocks(question: Question, values: Mapping[str, Array], trials: int, *, calibrated: bool = False) -> Array:
    """`evaluate_builds`, block by block."""
    if trials <= BLOCK:
        return evaluate_builds(question, values, trials, calibrated=calibrated)
    columns = np.empty((len(question.columns), trials))
    for start in range(0, trials, BLOCK):
        block = slice(start, min(start + BLOCK, trials))
        some = {place: numbers[block] for place, numbers in values.items()}
        columns[:, block] = evaluate_builds(question, some, block.stop - start, calibrated=calibrated)
    return columns


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
    # All that were measured with it run again, so that arrays have the same shapes.
    start, end = within - within % STRETCH, plan.chunk_trials(index)
    block = measure_uniforms(plan, plan.draws.uniforms(index, plan.chunk, start, min(start + STRETCH, end)))
    measured = MeasuredTrials(*(part[..., [within - start]] for part in block))
    return design_adjusted(plan, measured.deviations, measured.moved), measured


def focus_travel(plan: TolerancePlan, place: str, deviations: Array) -> float:
    """Largest move of a place that focuses builds at these deviations, (P, trials), wherever its travel ends [mm]."""
    moves = focus_moves(plan.question, plan.draws.values(deviations), deviations.shape[1], place)
    return float(np.max(np.abs(moves[np.isfinite(moves)]), initial=0.0))


def design_adjusted(plan: TolerancePlan, deviations: Array, moved: Array) -> Design:
    """Design of one build, shapes (P, 1) and (adjusters, 1); a `ValueError` where its numbers make none."""
    design = plan.question.design
    numbers = of_parts(design, final_values(plan, deviations, moved))
    return design_built(design, {place: float(value[0]) for place, value in numbers.items()})


def final_values(plan: TolerancePlan, deviations: Array, moved: Array | None = None) -> dict[str, Array]:
    """Numbers of builds after adjustment; by how much is worked out where it is not given."""
    values = plan.draws.values(deviations)
    if not plan.adjusters:
        return values
    compensator = _compensator_of(plan.limited)
    return compensator.applied(values, compensator.adjusted(values, deviations)[0] if moved is None else moved)


def final_faults(plan: TolerancePlan, deviations: Array, moved: Array | None = None) -> list[tuple[str, ...]]:
    """Why builds, after adjustment, are no cameras: of each its reasons, none where it is one."""
    values = final_values(plan, deviations, moved)
    reasons = faults_of(plan.question, values, deviations.shape[1])
    return [tuple(words for words, flags in reasons.items() if flags[k]) for k in range(deviations.shape[1])]


def first_builds(
    plan: TolerancePlan, count: int, fields: tuple[tuple[float, float], ...] = ()
) -> tuple[IdealBuilds, NDArray[np.bool_]]:
    """A plan's first builds, adjusted where anything is, at fields or its own, and which are cameras, (builds,).

    Others have nominal numbers. Behind a real main lens their `camera` is of thin-lens models.
    """
    deviations = first_deviations(plan, count)
    values = final_values(plan, deviations)
    question = replace(plan.question, fields=fields) if fields else plan.question
    return builds_of(question, values, deviations.shape[1])


def first_deviations(plan: TolerancePlan, count: int) -> Array:
    """Deviations of a plan's first builds [tolerances], (P, builds)."""
    count = min(count, plan.chunk_trials(0))
    return plan.draws.deviations(np.ascontiguousarray(plan.draws.uniforms(0, plan.chunk, 0, count)))


def lengths_built(plan: TolerancePlan) -> LengthCovariance:
    """Covariance of a camera's lengths over a plan's builds, adjusted where anything is: to first order.

    Where an adjuster's range ends before all builds are adjusted, that of as many builds drawn: no slope tells where
    it stops. f and d_1 stand for d_f, which follows. The temperature is left out where the design gives its range.
    """
    draws = plan.draws
    if plan.adjusters:
        compensator, even = _compensator_of(plan), replace(draws, sampling="sobol")
        deviations = even.deviations(even.uniforms(0, DRAWN))
        moved = compensator.all_moves(draws.values(deviations), compensator.linear(deviations))
        if plan.at_end(moved).any():
            places, numbers = _lengths_of(plan, np.pad(deviations, ((0, 0), (1, 0))))
            off = numbers[:, 1:] - numbers[:, :1]
            return LengthCovariance(places, off @ off.T / DRAWN)
    tolerances = np.array([p.tolerance for p in draws.perturbations])
    steps = NUDGE * np.eye(tolerances.size)
    places, numbers = _lengths_of(plan, np.concatenate([steps, -steps], axis=1))
    ahead, behind = np.split(numbers, 2, axis=1)
    # Of a tolerance of 0 nothing moves.
    rates = (ahead - behind) / (2 * NUDGE * np.where(tolerances > 0, tolerances, 1.0))
    return LengthCovariance(places, rates @ draws.covariance() @ rates.T)


def _lengths_of(plan: TolerancePlan, deviations: Array) -> tuple[tuple[str, ...], Array]:
    """Lengths that differ between builds, adjusted where anything is: their places, and numbers (places, builds)."""
    design, count = plan.question.design, deviations.shape[1]
    left_out = {PATHS["d_f"], *BESIDE, *VIEWING_CONDITIONS}
    if design.environment is not None and design.environment.range is not None:
        left_out.add(TEMPERATURE)
    values = plan.draws.values(deviations)
    if plan.adjusters:
        compensator = _compensator_of(plan)
        values = compensator.applied(values, compensator.linear(deviations))
    builds, _ = builds_of(plan.question, values, count)
    varied = {
        place: np.broadcast_to(number, (count,))
        for place, number in builds.camera.numbers.items()
        if place not in left_out and np.ptp(number) > 0
    }
    return tuple(varied), np.stack([*varied.values()]) if varied else np.zeros((0, count))


class Compensator:
    """Adjusts builds of a plan with adjusters: limited columns back to nominal, in units of what their limits allow.

    What focuses is set by itself, wherever the other adjusters are: these alone are searched for.
    """

    def __init__(self, plan: TolerancePlan) -> None:
        self.plan, design = plan, plan.question.design
        self.nominal, kinds = nominal_values(design), perturbable(design)
        aim = plan.judged(evaluate_builds(plan.question, {}, 1, calibrated=plan.calibrated))[:, 0]
        allowed: dict[int, float] = {}
        for limit in plan.limits:
            here = aim[limit.column]
            ends = plan.judged(
                np.array([[edge for edge in (limit.low, limit.high) if np.isfinite(edge)]]), [limit.column]
            )
            room = [abs(edge - here) for edge in ends[0].tolist() if edge != here]
            allowed[limit.column] = min([*room, allowed.get(limit.column, np.inf)])
        self.columns = np.array([column for column in allowed if np.isfinite(aim[column])], dtype=np.intp)
        widths = np.array([allowed[column] for column in self.columns])
        self.aim = aim[self.columns, None]
        # What is not limited need not be known before the last step.
        self.limited = plan.question.limited_to(plan.columns[column] for column in self.columns)
        rows = {column: row for row, column in enumerate(self.limited.columns)}
        self.rows = np.array([rows[plan.columns[column]] for column in self.columns], dtype=np.intp)
        self.weights = 1 / np.where(np.isfinite(widths), widths, 1.0)[:, None]
        self.searched = plan.adjusters_to_limits
        self.focusing = plan.adjusters[len(self.searched) :]
        self.steps = np.array([1e-5 * (design.d_1 if kinds[a.place] == "length" else 1) for a in self.searched])
        self.reach = np.array([adjuster.reach for adjuster in self.searched])[:, None]
        self.gain = self._gain()

    def _gain(self) -> Array:
        """Adjustments that best undo one tolerance of each perturbation, shape (adjusters, perturbations)."""
        plan, perturbations = self.plan, self.plan.draws.perturbations
        steps = [(p.place, NUDGE * p.tolerance) for p in perturbations]
        steps += [(a.place, float(step)) for a, step in zip(self.searched, self.steps, strict=True)]
        slopes = differences(plan, steps, calibrated=plan.calibrated, judged=True, focused=self.focused)
        slopes = slopes[self.columns] * self.weights
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        count = len(perturbations)
        # What a compensator leaves is undone by none.
        tolerances = np.array([0.0 if p.place.startswith(LEFT) else p.tolerance for p in perturbations])
        undone: Array = -np.linalg.pinv(slopes[:, count:], rcond=1e-8) @ (slopes[:, :count] * tolerances)
        return undone

    def linear(self, deviations: Array) -> Array:
        """Searched adjustments by projection, (adjusters, trials) [mm, rad]; clipped to the adjusters' reach."""
        # Summed one perturbation after the other: the same bits whatever the machine's linear algebra.
        moved = np.zeros((len(self.searched), deviations.shape[1]))
        for column, row in zip(self.gain.T, deviations, strict=True):
            moved += column[:, None] * row
        return np.clip(moved, -self.reach, self.reach)

    def applied(self, values: Mapping[str, Array], moved: Array) -> dict[str, Array]:
        """The builds' numbers with their adjustments on top: of `moved` those that are searched, then the focus."""
        return self.focused(self._moved(values, zip(self.searched, moved, strict=False)), moved.shape[1])

    def focused(self, values: Mapping[str, Array], trials: int) -> dict[str, Array]:
        """The builds' numbers, focused where the plan focuses them."""
        return self._moved(values, zip(self.focusing, self._focus(values, trials), strict=True))

    def all_moves(self, values: Mapping[str, Array], moved: Array) -> Array:
        """All adjustments of builds, shape (adjusters, trials) [mm, rad], from those that are searched."""
        there = self._moved(values, zip(self.searched, moved, strict=True))
        return np.concatenate([moved, self._focus(there, moved.shape[1])])

    def _moved(self, values: Mapping[str, Array], moves: Iterable[tuple[Adjuster, Array]]) -> dict[str, Array]:
        result = dict(values)
        for adjuster, row in moves:
            there = result.get(adjuster.place, self.nominal[adjuster.place]) + row
            result[adjuster.place] = there + values.get(LEFT + adjuster.place, 0.0)
        return result

    def _focus(self, values: Mapping[str, Array], trials: int) -> Array:
        """Moves of what focuses, as far as it reaches; none where nothing would be in focus."""
        if not self.focusing:
            return np.empty((0, trials))
        (one,) = self.focusing
        moves = focus_moves(self.plan.question, values, trials, one.place)
        return np.clip(np.where(np.isfinite(moves), moves, 0.0), -one.reach, one.reach)[None]

    def measured(self, values: Mapping[str, Array], moved: Array) -> Array:
        """All columns of the adjusted builds."""
        plan = self.plan
        return _in_blocks(plan.question, self.applied(values, moved), moved.shape[1], calibrated=plan.calibrated)

    def adjusted(
        self, values: Mapping[str, Array], deviations: Array, settled: float = SETTLED
    ) -> tuple[Array, Array, Array]:
        """Adjustments that bring each trial's targets closest to nominal in the least-squares sense.

        Parameters
        ----------
        values : mapping
            The builds' numbers, unadjusted.
        deviations : ndarray, shape (P, trials)
            The same as deviations [tolerances].
        settled : float
            Part of the limits' room up to which linear prediction is left as it is; 0 where less than all of the room
            is looked at.

        Returns
        -------
        (adjustments, columns, columns)
            Shapes (adjusters, trials) and (C, trials): the columns of linear adjustment, then the final ones.

        Notes
        -----
        The linear prediction is set on every build and measured exactly. A build that then uses no more than `settled`
        of its limits' room is done; each other one goes on by Newton's steps (`refined`). All do where prediction is
        blind, as it is to the length of a vector about zero.
        """
        moved = self.linear(deviations)
        known = {place: numbers for place, numbers in values.items() if not place.startswith(LEFT)}
        if self.searched and len(known) < len(values):  # nobody searches by what is left in the end
            moves, *_ = self.adjusted(known, deviations, settled)
            return moves, self.measured(values, moved), self.measured(values, moves)
        columns = start = self.measured(values, moved)
        if not self.searched:
            return self.all_moves(values, moved), start, columns
        late = np.flatnonzero(self.plan.used_room(start) > (settled if self.predicts else -np.inf))
        if late.size:
            some = {place: numbers[late] for place, numbers in values.items()}
            moved, columns = moved.copy(), start.copy()
            moved[:, late], columns[:, late] = self.refined(
                some, *self._restarted(some, moved[:, late], start[:, late])
            )
        return self.all_moves(values, moved), start, columns

    def _restarted(self, values: Mapping[str, Array], moved: Array, columns: Array) -> tuple[Array, Array]:
        """Adjustments and columns that Newton's steps can start from.

        Builds that prediction leaves no cameras, as out of all focus, start at the best along an adjuster's way.
        """
        lost = np.flatnonzero(np.isnan(columns[self.columns]).all(axis=0))
        if not lost.size:
            return moved, columns
        some = {place: numbers[lost] for place, numbers in values.items()}
        best, cost = moved[:, lost], np.full(lost.size, np.inf)
        predicted = np.abs(moved).max(axis=1)  # one without limits is sought as far as prediction sends any build
        for row, limit in enumerate(self.reach[:, 0]):
            reach = limit if np.isfinite(limit) else predicted[row]
            tried = np.repeat(moved[:, None, lost], ALONG.size, axis=1)
            tried[row] = ALONG[:, None] * reach
            for shifted, here in zip(np.moveaxis(tried, 1, 0), map(_cost, self.left_of_all(some, tried)), strict=True):
                lower = here < cost
                best[:, lower], cost[lower] = shifted[:, lower], here[lower]
        saved = np.isfinite(cost)
        moved, columns = moved.copy(), columns.copy()
        moved[:, lost[saved]] = best[:, saved]
        if saved.any():
            some = {place: numbers[saved] for place, numbers in some.items()}
            columns[:, lost[saved]] = self.measured(some, best[:, saved])
        return moved, columns

    @cached_property
    def predicts(self) -> bool:
        """Whether linear prediction comes near what Newton's steps reach, by the plan's first builds."""
        draws = self.plan.draws
        deviations = draws.deviations(draws.uniforms(0, PILOT))
        values, moved = draws.values(deviations), self.linear(deviations)
        start = self.measured(values, moved)
        by_prediction = _cost(self.residual(start))
        by_newton = _cost(self.residual(self.refined(values, moved, start)[1]))
        return bool(np.median(by_prediction) <= NEAR * np.median(by_newton) + SMALL)

    def refined(self, values: Mapping[str, Array], moved: Array, columns: Array) -> tuple[Array, Array]:
        """Adjustments and columns after Gauss-Newton steps from those given.

        Never worse: a step that does not lower a trial's residual is halved once, then refused for that trial.
        """
        moved, columns = moved.copy(), columns.copy()
        whole = self.limited.columns == self.plan.question.columns  # nothing is left to be measured in the end
        residual = self.residual(columns)
        start = _cost(residual)
        cost = start.copy()
        going = np.arange(moved.shape[1])
        for _ in range(ITERATIONS):
            some = {place: numbers[going] for place, numbers in values.items()}
            here, left = moved[:, going], residual[:, going]
            nudged = here[:, None] + np.diag(self.steps)[..., None]
            ahead = self.left_of_all(some, nudged)
            slopes = [(there - left) / step for there, step in zip(ahead, self.steps, strict=True)]
            end = np.clip(here + _least_squares(slopes, left, self.steps), -self.reach, self.reach)
            before = cost[going]
            promised = _cost(left + np.einsum("act,at->ct", slopes, end - here))
            trying = np.flatnonzero(promised < (1 - CONVERGED) * before)
            if not trying.size:
                break
            going, before, promised = going[trying], before[trying], promised[trying]
            here, end = here[:, trying], end[:, trying]
            some = {place: numbers[trying] for place, numbers in some.items()}
            trying = np.arange(going.size)
            for fraction in (1.0, 0.5):
                tried = (1 - fraction) * here[:, trying] + fraction * end[:, trying]
                reached = self.reached({place: numbers[trying] for place, numbers in some.items()}, tried)
                remaining = self.left_in(reached)
                lower = _cost(remaining)
                better = lower < cost[going[trying]]
                at = going[trying[better]]
                moved[:, at], residual[:, at], cost[at] = tried[:, better], remaining[:, better], lower[better]
                if whole:
                    columns[:, at] = reached[:, better]
                trying = trying[~better]
                if not trying.size:
                    break
            # Done: what did not fall, and what came where a linear response leads.
            fallen, kept = before - cost[going], np.abs(cost[going] - promised) <= CONVERGED * before
            going = going[(fallen > CONVERGED * before) & ~kept]
            if not going.size:
                break
        changed = np.flatnonzero(cost < start)
        if changed.size and not whole:
            some = {place: numbers[changed] for place, numbers in values.items()}
            columns[:, changed] = self.measured(some, moved[:, changed])
        return moved, columns

    def left(self, values: Mapping[str, Array], moved: Array) -> Array:
        """Residual of builds so adjusted."""
        return self.left_in(self.reached(values, moved))

    def reached(self, values: Mapping[str, Array], moved: Array) -> Array:
        """Limited metrics' columns of builds so adjusted."""
        applied = self.applied(values, moved)
        return _in_blocks(self.limited, applied, moved.shape[1], calibrated=self.plan.calibrated)

    def left_in(self, reached: Array) -> Array:
        """Residual of these columns."""
        return (self.plan.judged(reached[self.rows], self.columns) - self.aim) * self.weights

    def left_of_all(self, values: Mapping[str, Array], moved: Array) -> Array:
        """`left` of builds in each of K adjustments at once, (adjusters, K, trials): shape (K, columns, trials)."""
        count, trials = moved.shape[1:]
        every = {place: np.tile(numbers, count) for place, numbers in values.items()}
        left = self.left(every, moved.reshape(len(moved), -1))
        return np.moveaxis(left.reshape(len(left), count, trials), 1, 0)

    def residual(self, columns: Array) -> Array:
        """How far the limited columns are from nominal, in units of what their limits allow."""
        return (self.plan.judged(columns[self.columns], self.columns) - self.aim) * self.weights


@lru_cache(maxsize=4)
def _compensator_of(plan: TolerancePlan) -> Compensator:
    """The plan's compensator, made once in a process."""
    return Compensator(plan)


def differences(
    plan: TolerancePlan,
    steps: list[tuple[str, float]],
    *,
    calibrated: bool = False,
    judged: bool = False,
    focused: Callable[[Mapping[str, Array], int], Mapping[str, Array]] | None = None,
) -> Array:
    """Central differences of every column at the nominal design.

    Parameters
    ----------
    plan : TolerancePlan
        Whose columns.
    steps : list of (place, step)
        A place may occur more than once. Steps of 0 give 0.
    calibrated : bool
        As for `evaluate_builds`.
    judged : bool
        Of what may be infinite the twin's.
    focused : callable, optional
        From numbers of builds, and how many, to these in focus.

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
    numbers_of = values if focused is None else focused(values, 2 * count)
    ends = evaluate_builds(plan.question, numbers_of, 2 * count, calibrated=calibrated)
    ends = plan.judged(ends) if judged else ends
    widths = np.array([step for _, step in steps])
    with np.errstate(invalid="ignore"):
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
