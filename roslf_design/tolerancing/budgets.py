"""Cheapest changes that reach the target yield, and tolerances to relax: single changes, each tried on builds.

A change is one part to a better grade, one more adjustment, one part measured and sorted to what suffices, or, where no
single one does, several grades or all tolerances together. Costs are the grades file's; the same draws serve every
trial, so that changes differ by what they do and not by chance. What they come to is told of draws of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import compress
from typing import Any, Literal, NamedTuple

import numpy as np

from .._arrays import Array
from ..camera import Camera
from ..evaluation.remedies import is_matched
from ..progress import UNHEARD, Share, part_of
from ..theory.focused import has_views
from .draws import Draws, Perturbation
from .metrics import builds_of, focus_shown
from .places import (
    CALIBRATION,
    LEFT,
    Aim,
    GradeLine,
    Grades,
    expand,
    focus_fault,
    nominal_values,
    parse_tolerance,
    perturbable,
)
from .study import VIEWS, Adjuster, Study, TolerancePlan, focused_twice
from .trials import BLOCK, focus_travel, holding, measure_finally
from .yields import (
    DEAR,
    EARLIEST,
    FRESH,
    Yield,
    curve_trials,
    first_draws,
    fresh,
    least_passed,
    promised,
    search_trials,
)

Steps = tuple[tuple[str, str, float], ...]
"""Places, grades (empty where a step is to none of them), and half-widths, or an adjuster's reach [mm or rad]."""
HALF = 0.5
"""Share of a distance that an adjustment moves at most: what stands at both ends of it has seats."""
Kind = Literal["grade", "adjustment", "tightening", "several grades", "all tolerances"]

MOST_TRIALS, STEPS_TRIALS = 4096, 1024
"""Builds that a change is searched by, and those by which the next of several steps is chosen."""
MOST_HELPING, MANY_HELPING = 8, 24
"""Parts among which several steps are looked for where builds are dear, and where they are not: each step asks all."""
HALVINGS = 12
"""Number of halvings in a bisection: it ends at 1/4096 of the tolerance."""
SCREENED = 0.5
"""Share of a search of single changes that is done once it is known of which parts a perfect one suffices, about."""
SINGLE, SEVERAL = 0.5, 0.8
"""Shares of a search that are done after single changes and after several, about."""
FINER = 1.05
"""Share of the largest travel that a focusing thread is told to have, in two digits."""
LOST_ROOM = 1e9
"""Share of its limits' margin that a build counts for which is no camera."""
UNNOTICED = 0.002
"""Share of builds that loosening may cost where the target yield is out of reach anyhow."""


class _CostedPart(NamedTuple):
    """Part with a cost, toleranced by one line: a place with its two axes."""

    place: str
    """Place without the axis."""
    rows: tuple[int, ...]
    """Indices of its perturbations."""
    tolerance: float
    """[mm, rad or none]."""
    kind: str
    """Kind of number that the place is, as `perturbable` has it."""
    line: GradeLine | None
    """Line of the grades that covers it; None where no line does: its cost is not known."""
    widths: tuple[float, ...]
    """Half-widths in every grade, loose to tight."""

    def cost(self, tolerance: float) -> float | None:
        """Cost of one such part, interpolated between grades by the logarithm of its tolerance.

        Beyond the tightest it goes on at the same rate.

        None where it is not known; what is looser than every grade costs as the loosest.
        """
        if self.line is None or min(self.widths) <= 0:
            return None
        if tolerance <= 0:
            return math.inf
        # Finer from grade to grade; a table whose grades repeat a width has the dearer of both.
        points = dict(zip((-math.log(width) for width in self.widths), self.line.costs, strict=True))
        at, costs = np.array(sorted(points)), np.array([points[place] for place in sorted(points)])
        fine = -math.log(tolerance)
        beyond = 0.0
        if fine > at[-1] and len(at) > 1:
            beyond = (fine - at[-1]) * (costs[-1] - costs[-2]) / (at[-1] - at[-2])
        return float(np.interp(fine, at, costs)) + max(beyond, 0.0)

    def extra(self, tolerance: float) -> float | None:
        """Additional cost of another tolerance over the present one."""
        new, now = self.cost(tolerance), self.cost(self.tolerance)
        return None if new is None or now is None else new - now


@dataclass(frozen=True)
class Change:
    """A change of tolerances or adjustments, and what it comes to."""

    kind: Kind
    steps: Steps
    cost: float | None
    """More than now, in the grades file's unit; None where some cost is not known."""
    result: Yield
    """Its yield; of one that reaches the target yield on fresh builds, the interval not below it."""
    aim: Aim | None = None
    """Aim of an adjustment; None of other changes."""

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        steps = [{"place": place, "grade": grade, "to": to} for place, grade, to in self.steps]
        return {"kind": self.kind, "aim": self.aim, "steps": steps, "cost": self.cost, **self.result.to_dict()}


@dataclass(frozen=True)
class _Looser:
    """A part that may be looser."""

    place: str
    grade: str
    given: float
    tolerance: float
    saved: float | None


@dataclass(frozen=True)
class ToleranceBudget:
    """Changes that reach a target yield, and tolerances to relax."""

    target: float
    changes: tuple[Change, ...]
    """Changes that reach the target, cheapest first; empty where the study does already, or nothing known does."""
    looser: tuple[_Looser, ...]
    """Together, after the cheapest change where one is needed."""
    result: Yield
    """Yield with that change and all tolerances relaxed."""
    adjustments: tuple[Change, ...] = ()
    """Further adjustments at assembly, whether or not they reach the target, best first; of the searched builds."""

    @property
    def cost(self) -> float | None:
        """Cost of the cheapest change less what looser parts save; None where some cost is not known."""
        spent = [self.changes[0].cost if self.changes else 0.0]
        saved = [part.saved for part in self.looser]
        if None in spent or None in saved:
            return None
        return sum(filter(None, spent)) - sum(filter(None, saved))

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {
            "target": self.target,
            "changes": [change.to_dict() for change in self.changes],
            "looser": self.looser,
            "adjustments": [change.to_dict() for change in self.adjustments],
            "together": {"cost": self.cost, **self.result.to_dict()},
        }


class _Builds(NamedTuple):
    """A study's builds with some tolerances changed."""

    plan: TolerancePlan
    factors: Array
    """Factors on each perturbation's tolerance, (P,)."""

    def with_part(self, part: _CostedPart, tolerance: float) -> _Builds:
        """Builds with one part at another tolerance."""
        factors = self.factors.copy()
        factors[list(part.rows)] = tolerance / part.tolerance
        return self._replace(factors=factors)

    def deviations(self, trials: int, draws: Draws | None = None) -> Array:
        """Deviations of the first trials [tolerances], (P, trials)."""
        return first_draws(draws or self.plan.draws, trials) * self.factors[:, None]

    def passed(self, trials: int, draws: Draws | None = None) -> int:
        """Number of the trials that hold all limits."""
        return int(holding(self.plan, self.deviations(trials, draws)).sum())

    def judged(self, trials: int) -> Yield:
        """Yield on draws that no search has looked at."""
        return Yield(self.passed(FRESH * trials, fresh(self.plan.draws)), FRESH * trials)

    def used(self, target: float, trials: int, *others: _Builds) -> Array:
        """Shares of the limits' margin that the wanted share of builds uses, here and with others' tolerances."""
        factors = np.stack([builds.factors for builds in (self, *others)], axis=1)
        return _used(self.plan, target, trials, factors.shape[1], factors.tobytes())


@lru_cache(maxsize=256)
def _used(plan: TolerancePlan, target: float, trials: int, count: int, factors: bytes) -> Array:
    """`_Builds.used` of so many changes by their factors: a search that begins anew comes by the same."""
    draws, every = first_draws(plan.draws, trials), np.frombuffer(factors).reshape(-1, count)
    worst, left = np.full((count, trials), LOST_ROOM), np.arange(count)
    for some in filter(len, np.split(np.arange(trials), [trials // EARLIEST])):
        deviations = (every[:, left, None] * draws[:, None, some]).reshape(len(draws), -1)
        room = np.nan_to_num(plan.used_room(measure_finally(plan, deviations)), posinf=LOST_ROOM)
        worst[left[:, None], some] = room.reshape(left.size, -1)
        # Where that many are no cameras already, the rest makes no difference.
        left = left[(worst[left][:, : some[-1] + 1] >= LOST_ROOM).sum(1) <= (1 - target) * trials]
        if not left.size:
            break
    return np.asarray(np.quantile(worst, target, axis=1, method="higher"))


@lru_cache(maxsize=4096)
def _failed(plan: TolerancePlan, trials: int, rest: bool, count: int, factors: bytes) -> Array:
    """Number of builds that miss a limit among the earliest of so many, or among the rest, of each of some changes."""
    draws, start = first_draws(plan.draws, trials), trials // EARLIEST
    some, every = draws[:, start:] if rest else draws[:, :start], np.frombuffer(factors).reshape(count, -1)
    deviations = (every.T[:, :, None] * some[:, None]).reshape(len(some), -1)
    missed = ~holding(plan, deviations) if some.size else np.zeros(0, np.bool_)
    return np.asarray(missed.reshape(count, -1).sum(axis=1))


class _Aim(NamedTuple):
    """Acceptance criterion of a search for changes: so many of so many builds pass."""

    passed: int
    """Builds that must hold all limits."""
    trials: int
    """Number of builds tried."""

    @classmethod
    def at(cls, share: float, trials: int) -> _Aim:
        """A yield whose interval does not begin below a share."""
        return cls(least_passed(share, trials), trials)

    def held_by(self, builds: _Builds) -> bool:
        """Whether builds do."""
        return self.held_by_each([builds])[0]

    def held_by_each(self, changed: Sequence[_Builds], tell: Share = UNHEARD) -> list[bool]:
        """Whether each of several changes of one study holds it: builds of many are measured together."""
        failed, start = np.zeros(len(changed), int), self.trials // EARLIEST
        left = np.arange(len(changed))
        for rest, some in ((False, start), (True, self.trials - start)):  # the first of them tell in most cases
            for at in range(0, len(left), each := max(1, BLOCK // max(some, 1))):
                tell(0.5 * (rest + at / len(left)))
                rows = left[at : at + each]
                factors = np.stack([changed[row].factors for row in rows]).tobytes()
                failed[rows] += _failed(changed[0].plan, self.trials, rest, len(rows), factors)
            left = left[failed[left] <= self.trials - self.passed]
        return [bool(held) for held in failed <= self.trials - self.passed]


def parts_of(plan: TolerancePlan, grades: Grades) -> tuple[_CostedPart, ...]:
    """Parts that a shop makes, from a study's perturbations; a tolerance of zero is none, nor what views show."""
    design = plan.question.design
    kinds, rows = perturbable(design), dict[str, list[int]]()
    for index, p in enumerate(plan.draws.perturbations):
        base, _, axis = p.place.rpartition(".")
        if p.tolerance > 0 and p.source != VIEWS:
            rows.setdefault(base if axis.isdigit() else p.place, []).append(index)
    parts = []
    for place, members in rows.items():
        first = plan.draws.perturbations[members[0]]
        line, widths = grades.line_of(design, first.place) or (None, ())
        parts.append(_CostedPart(place, tuple(members), first.tolerance, kinds[first.place], line, widths))
    return tuple(parts)


def searched_builds(plan: TolerancePlan) -> int:
    """Builds that changes are searched by, where no target yield asks for more."""
    return min(curve_trials(plan), MOST_TRIALS // (DEAR if plan.dear else 1))


def budget(
    plan: TolerancePlan,
    study: Study,
    grades: Grades,
    given: Yield,
    scaled: tuple[float, Yield] | None = None,
    tell: Share = UNHEARD,
) -> ToleranceBudget:
    """Budget of changes that reach a study's target yield, and of tolerances to relax.

    Parameters
    ----------
    plan : TolerancePlan
    study : Study
        Whose `yield_target` is wanted.
    grades : Grades
        What other tolerances there are, and what each costs.
    given : Yield
        As the run has it.
    scaled : (factor, yield), optional
        The common factor on all tolerances that reaches it.
    tell : callable
        Told how much of the search is done.
    """
    target = study.yield_target
    trials = search_trials(searched_builds(plan), target)
    parts, now = parts_of(plan, grades), _Builds(plan.limited, np.ones(len(plan.draws.perturbations)))
    start, changes, adjustments = now, tuple[Change, ...](), tuple[Change, ...]()
    reached = given.value >= target
    if not reached:
        adjusted = list(_adjusted(now, grades, trials, study))
        adjustments = tuple(sorted((change for change, _ in adjusted), key=lambda change: -change.result.value))
        reaching = [
            sure
            for change, builds in adjusted
            for sure in _sure("adjustment", change.steps[0], change.cost, builds, target, change.result, change.aim)
        ]
        reaching += _single(now, parts, grades, target, trials, part_of(tell, 0.0, SINGLE))
        reaching += _several(now, parts, grades, target, trials)
        if scaled is not None:
            extras = [part.extra(scaled[0] * part.tolerance) for part in parts]
            steps = tuple((part.place, "", scaled[0] * part.tolerance) for part in parts)
            cost = None if None in extras else sum(filter(None, extras))
            reaching.append(
                (Change("all tolerances", steps, cost, scaled[1]), now._replace(factors=now.factors * scaled[0]))
            )
        reaching.sort(key=lambda pair: (math.inf if pair[0].cost is None else pair[0].cost, -pair[0].result.value))
        changes = tuple(change for change, _ in reaching)
        if reaching:
            start, reached = reaching[0][1], True
    moved = {place for place, *_ in changes[0].steps} if changes else set()
    left = [part for part in parts if part.place not in moved]
    told = SEVERAL * (not given.value >= target)
    tell(told)

    def loosened(aim: _Aim) -> tuple[tuple[_Looser, ...], _Builds] | None:
        nonlocal told
        begin, told = told, (1 + told) / 2  # nobody knows how often it is searched anew
        looser, builds = _loosened(start, left, grades, aim, part_of(tell, begin, told))
        return (looser, builds) if looser else None

    if reached:  # what loses no build of those that hold now is as good as they are
        most, floor = start.passed(trials), min(target, start.judged(trials).interval[0])
        best = promised(
            lambda share: loosened(_Aim(min(least_passed(share, trials), most), trials)),
            lambda both: both[1].judged(trials),
            floor,
        )
    else:
        both = loosened(_Aim(math.ceil(start.passed(trials) - UNNOTICED * trials), trials))
        best = None if both is None else (both, both[1].judged(trials))
    if best is None:
        return ToleranceBudget(target, changes, (), changes[0].result if changes else given, adjustments)
    (looser, _), result = best
    return ToleranceBudget(target, changes, looser, result, adjustments)


def _single(
    now: _Builds, parts: Sequence[_CostedPart], grades: Grades, target: float, trials: int, tell: Share
) -> Iterator[tuple[Change, _Builds]]:
    """Changes of one thing alone that reach the target."""
    aim = _Aim.at(target, trials)
    helping = aim.held_by_each([now.with_part(part, 0.0) for part in parts], part_of(tell, 0.0, SCREENED))
    perfect = list(compress(parts, helping))  # of the others not even a perfect one suffices
    for index, part in enumerate(perfect):
        tell(SCREENED + (1 - SCREENED) * index / len(perfect))
        for name, width in zip(grades.names, part.widths, strict=True) if part.line else ():
            if width < part.tolerance:
                step, better = (part.place, name, width), now.with_part(part, width)
                first = Yield(better.passed(trials), trials)
                yield from _sure("grade", step, part.extra(width), better, target, first)
        found = promised(
            lambda share, part=part: _tightened(now, part, _Aim.at(share, trials)),  # type: ignore[misc]
            lambda width, part=part: now.with_part(part, width).judged(trials),  # type: ignore[misc]
            target,
        )
        if found is not None:
            width, result = found
            change = Change("tightening", ((part.place, "", width),), part.extra(width), result)
            yield change, now.with_part(part, width)


def _sure(
    kind: Kind,
    step: tuple[str, str, float],
    cost: float | None,
    builds: _Builds,
    target: float,
    first: Yield,
    aim: Aim | None = None,
) -> Iterator[tuple[Change, _Builds]]:
    """A change of one step, where its yield is the target for sure; `first` of the builds that it is searched by."""
    if first.value >= target and (result := builds.judged(first.trials)).interval[0] >= target:
        yield Change(kind, (step,), cost, result, aim), builds


def _tightened(now: _Builds, part: _CostedPart, aim: _Aim) -> float | None:
    """Largest tolerance of a part alone that suffices; None where none does."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        held = aim.held_by(now.with_part(part, middle * part.tolerance))
        low, high = (middle, high) if held else (low, middle)
    return low * part.tolerance if low > 0 else None


def _adjusted(
    now: _Builds, grades: Grades, trials: int, study: Study | None = None
) -> Iterator[tuple[Change, _Builds]]:
    """Changes by one more adjustment, whatever they reach; each leaves what the table tells of a study's grade."""
    plan, missed = now.plan, now.plan.draws.perturbations
    design = plan.question.design
    kinds, nominal = perturbable(design), nominal_values(design)
    own = {adjuster.place for adjuster in plan.adjusters}
    leaves = grades.tolerances(study.grade, design) if study is not None and study.grade else {}

    def left_by(other: TolerancePlan, places: Sequence[str]) -> _Builds:
        """Builds of a plan that adjusts these places, each off by what that leaves."""
        shown = {
            LEFT + one.place: focus_shown(plan.question, one.place)[1] for one in other.adjusters if one.aim == "focus"
        }
        left = {place: (shown | leaves).get(place, math.inf) for place in (LEFT + place for place in places)}
        more = [
            Perturbation(place, 0.0, width, study.distribution, study.truncate)
            for place, width in left.items()
            if study is not None and math.isfinite(width)
        ]
        draws = replace(other.draws, perturbations=(*missed, *more))
        return _Builds(
            replace(other, draws=draws) if more else other, np.pad(now.factors, (0, len(more)), constant_values=1)
        )

    for line in grades.adjustments:
        reach = math.inf
        if line.place == CALIBRATION:
            if plan.calibrated:
                continue
            places, other = [CALIBRATION], replace(plan, calibrated=True)
        else:
            places = [place for place in expand(design, line.place) if place not in own]
            if not places:
                continue
            reach = parse_tolerance(line.range, kinds[places[0]], 1.0) if line.range else math.inf
            lengths = [abs(nominal[place]) for place in places if place.endswith(".distance") and nominal[place]]
            reach = min([reach, *(HALF * length for length in lengths)])
            other = plan.with_adjusters(*(Adjuster(place, reach, line.aim) for place in places))
            if line.aim == "focus":  # no farther than builds want
                if focus_fault(line.aim, places, design) or any(focused_twice(other.adjusters, missed)):
                    continue
                travel = focus_travel(plan, places[0], first_draws(plan.draws, trials))
                reach = min(reach, float(f"{FINER * travel:.1e}"))
                other = plan.with_adjusters(Adjuster(places[0], reach, line.aim))
        builds, few = left_by(other, places), min(trials, curve_trials(other))
        result = Yield(builds.passed(few), few)
        yield Change("adjustment", ((line.place, "", reach),), line.cost, result, line.aim), builds


def _several(
    now: _Builds, parts: Sequence[_CostedPart], grades: Grades, target: float, trials: int
) -> Iterator[tuple[Change, _Builds]]:
    """Parts taken to better grades one after the other, where their yield is the target for sure."""
    found = promised(
        lambda share: _stepped(now, parts, grades, target, _Aim.at(share, trials)),
        lambda both: both[1].judged(trials),
        target,
    )
    if found is not None:
        (steps, builds), result = found
        named = {part.place: part for part in parts}
        cost = sum(named[place].extra(width) or 0.0 for place, _, width in steps)
        yield Change("several grades", steps, cost, result), builds


def _stepped(
    now: _Builds, parts: Sequence[_CostedPart], grades: Grades, target: float, aim: _Aim
) -> tuple[Steps, _Builds] | None:
    """Parts taken to better grades, each time what helps most for its cost, until the aim; None where none is left."""
    few, left = _few(now, aim), {part.place: part for part in parts if part.line}
    tightest = now
    for part in left.values():
        tightest = tightest.with_part(part, min(part.tolerance, *part.widths))
    if not aim.held_by(tightest):
        return None
    builds, (used,) = now, now.used(target, few)
    steps: dict[str, tuple[str, float]] = {}
    while left:
        options: list[tuple[float, _CostedPart, str, float, _Builds]] = []
        for part in left.values():
            at = steps[part.place][1] if part.place in steps else part.tolerance
            spent = part.extra(at) or 0.0
            for name, width in zip(grades.names, part.widths, strict=True):
                cost = part.extra(width)
                if width < at and cost is not None:
                    options.append((max(cost - spent, 1e-9), part, name, width, builds.with_part(part, width)))
        _, *after = builds.used(target, few, *(option[-1] for option in options))
        most = MOST_HELPING if builds.plan.dear else MANY_HELPING
        if len(left) > most and not steps:  # what helps little at first is not asked again
            helps = {option[1].place: used - there for option, there in zip(options, after, strict=True)}
            for place in sorted(left, key=lambda place: -helps.get(place, -math.inf))[most:]:
                del left[place]
        merits = [(used - there) / option[0] for there, option in zip(after, options, strict=True)]
        best = max(range(len(merits)), key=merits.__getitem__, default=None)
        if best is None or merits[best] <= 0:
            return None
        used, (_, part, name, width, builds) = after[best], options[best]
        steps[part.place] = name, width
        if width <= min(part.widths):
            left.pop(part.place, None)
        if used <= 1 and aim.held_by(builds):
            return _pruned(builds, {part.place: part for part in parts}, steps, grades, aim)
    return None


def _few(builds: _Builds, aim: _Aim) -> int:
    """Builds by which the next of several steps is chosen."""
    return min(aim.trials, STEPS_TRIALS // (DEAR if builds.plan.dear else 1))


def _pruned(
    builds: _Builds,
    parts: dict[str, _CostedPart],
    steps: dict[str, tuple[str, float]],
    grades: Grades,
    aim: _Aim,
) -> tuple[Steps, _Builds] | None:
    """Steps that reach the aim without what they can do without; None where a single one is left."""
    for place in sorted(steps, key=lambda place: -(parts[place].extra(steps[place][1]) or 0.0)):
        part, (_, least) = parts[place], steps[place]
        between = [
            (width, name)
            for name, width in zip(grades.names, part.widths, strict=True)
            if least < width < part.tolerance
        ]
        for width, name in [(part.tolerance, ""), *sorted(between, reverse=True)]:
            other = builds.with_part(part, width)
            if aim.held_by(other):
                builds = other
                if name:
                    steps[place] = name, width
                else:
                    del steps[place]
                break
    if len(steps) == 1:
        return None  # a single change, which is there already
    return tuple((place, name, width) for place, (name, width) in steps.items()), builds


def _stays_matched(plan: TolerancePlan, part: _CostedPart, width: float) -> bool:
    """Whether a part alone, so far off either way, leaves the f-number matched where the design has it so."""
    camera, nominal = Camera.of(plan.question.design.thin_twin), nominal_values(plan.question.design)
    if not has_views(camera) or not is_matched(camera):
        return True
    count = 2 * len(part.rows)
    off = {plan.draws.perturbations[row].place: np.zeros(count) for row in part.rows}
    for k, miss in enumerate(off.values()):
        miss[2 * k : 2 * k + 2] = -width, width
    builds, cameras = builds_of(plan.question, {place: nominal[place] + miss for place, miss in off.items()}, count)
    return bool((is_matched(builds.camera) & cameras).all())


def _loosened(
    start: _Builds, parts: Sequence[_CostedPart], grades: Grades, aim: _Aim, tell: Share
) -> tuple[tuple[_Looser, ...], _Builds]:
    """Parts to looser grades, those that matter least first, as long as the aim is held."""
    options, few = [], _few(start, aim)
    share = min(max(aim.passed / aim.trials, 0.01), 1.0)
    for part in (part for part in parts if part.line is not None):
        wider = [
            (width, name)
            for name, width in zip(grades.names, part.widths, strict=True)
            if width > part.tolerance and _stays_matched(start.plan, part, width)
        ]
        if wider:
            wider.sort(reverse=True)
            options.append((start.with_part(part, wider[0][0]), part, wider))
    builds, looser = start, []
    _, *used = start.used(share, few, *(option[0] for option in options))
    for done, at in enumerate(np.argsort(used, kind="stable").tolist(), 1):
        tell(done / (len(options) + 1))
        _, part, wider = options[at]
        for width, name in wider:
            other = builds.with_part(part, width)
            if aim.held_by(other):
                extra = part.extra(width)
                looser.append(_Looser(part.place, name, part.tolerance, width, None if extra is None else -extra))
                builds = other
                break
    return tuple(looser), builds
