"""A study's result: every analysis of its trials, how sure they are, the JSON object and files made of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, by_value
from ..accuracy.statement import Accuracy, check_accuracy
from ..bore.chain import COLLIDE
from ..bore.part import TEMPERATURE
from ..camera import Camera
from ..design import Design, save
from ..design.files import WRITTEN
from ..errors import InputError
from ..evaluation.required import Requirement, missed_words, required_of
from ..json_data import plain
from ..progress import CountedProgress, shares, silent
from ..tables import BriefValue
from ..theory.depth_budget import DepthBudget, depth_budget
from ..theory.focused import is_focused
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from ..theory.limits import AT_FIELD
from ..theory.quantities import EXPANDED, QUANTITIES, bound_note
from ..theory.tube import WIDTHS, unsaid_bore
from ..units import COLDEST, HOTTEST
from ..words import clauses, listed, number, uncertainty
from .budgets import SEVERAL, ToleranceBudget, budget, searched_builds
from .draws import Perturbation
from .metrics import SHAPES, Column, mount_of, of_cameras
from .places import CALIBRATION, Grades, display, in_lens, of_parts, perturbable
from .sensitivities import (
    LOOSEST,
    TOGETHER,
    Allowed,
    RssRow,
    Sensitivity,
    SobolIndices,
    inverse_sensitivity,
    least_reach,
    put_together,
    rss_rows,
    sensitivity,
    sobol_indices,
)
from .study import MOST_TRIALS, SAME_PLACE, Adjuster, Study, TolerancePlan, make_plan
from .summaries import LimitYield, Variant, correlations, summarise
from .tally import Tally
from .traced import notes
from .trials import (
    design_adjusted,
    final_faults,
    final_values,
    first_builds,
    first_deviations,
    holding,
    lengths_built,
    measure_finally,
)
from .yields import CONFIDENCE, ScaledBuilds, Yield, curve_trials, scale_for_yield, yield_at, yield_curve

SCHEMA = "roslf.tolerance/1"
FINEST = 1e-5
"""A finer yield takes more trials than a study may have."""
MOST_DEAR = 10_000
"""Builds that Sobol indices take where each is traced and its depth errors are summed."""
MANY = 1024
"""Number of builds for quantities that the study does not report: their scatter to some two in a hundred."""
REACH = 0.1
"""Share of a length, or angle [rad], within which inverse sensitivity tells limits."""
AT_REACH = 1e-6
"""Share of it by which a bracket may end short of where limits are looked for."""
SIGMAS = 2.0
"""Width of an error bound in standard errors: a share is off by more in at most 5 % of runs."""
PARTS, LEAST = 20, 10
"""Parts of the kept trials whose scatter is measured, and trials of each at least."""
INVERTED, INVERTED_ADJUSTED = 60, 240
"""Builds that count for one perturbation's inverse sensitivity, by the time it takes."""
SUMMED = 40
"""Builds near nominal, where series tell depth errors and detail, in the time of one far off, by limit on such."""
SAME_WARMTH = 0.05
"""Difference below which two temperatures are one [K]."""
ROUNDING = 1e-12
"""Share of a number that is no move of it."""
KNOWN_LENGTHS = ("u_z_mm", EXPANDED, "u_z_at_field_mm")
"""Metrics that take the lengths of each build as known."""


@dataclass(frozen=True)
class WorstTrial:
    """A trial that exceeds its limits most."""

    number: int
    score: float
    """How far, in units of what the limit allows: 1 is at the limit; infinite where something is undefined."""
    file: str
    """Its design file, of a build that cannot be put together with the numbers that it has; empty where these are a
    real lens's own, and of a build that holds every limit."""
    misses: dict[str, float]
    """Deviations by their places [tolerances]."""
    values: dict[str, float]
    """Columns by their labels, after adjustment; NaN where undefined."""
    faults: tuple[str, ...] = ()
    """Reasons why it cannot be put together, in words."""


@dataclass(frozen=True)
class _StandardError:
    """Standard error of a share of builds."""

    expected: float
    """Error by the binomial law."""
    measured: float | None
    """From the scatter of parts of the run; None where there are too few."""


@dataclass(frozen=True)
class _Precision:
    """How sure a run is, in shares of builds: a quantile is the value below which a share of builds lies."""

    accuracy: Accuracy
    yield_: _StandardError
    ranks: _StandardError
    """Error of quantiles: expected, the largest over those asked for; measured, mean square over all defined columns.
    """

    def to_dict(self, times: bool = False) -> dict[str, Any]:
        """JSON-ready."""
        errors = {"yield": self.yield_, "rank_of_quantiles": self.ranks}
        return self.accuracy.to_dict(times) | {"standard_errors": plain(errors)}


@dataclass(frozen=True)
class AdjusterUse:
    """How far an adjuster moved over all builds."""

    adjuster: Adjuster
    travel: float
    """Largest move either way [mm or rad]."""
    at_end: int
    """Builds in which it rests at the end of its range."""

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        one = self.adjuster
        told = {"place": one.place, "aim": one.aim, "range": one.reach}
        return told | {"travel": self.travel, "trials_at_end": self.at_end}


@by_value
@dataclass(frozen=True)
class StudyResult(BriefValue):
    """Results of a study; printed, its yield alone."""

    plan: TolerancePlan
    study: Study
    variants: tuple[Variant, ...]
    """As built; then, where anything is adjusted, after adjustment (last: what counts)."""
    sensitivity: Sensitivity
    rss: tuple[RssRow, ...]
    sobol: SobolIndices | None
    allowed: tuple[Allowed, ...]
    """Inverse sensitivity; empty where the nominal design misses a limit."""
    yield_curve: tuple[tuple[float, Yield], ...]
    scale_for_target: tuple[float, Yield] | None
    """Common factor on all tolerances that meets the target yield."""
    budget: ToleranceBudget | None
    """Cheapest changes that reach the target yield, and what to relax; None where the nominal design misses a
    limit, or nobody asked."""
    grades: tuple[tuple[str, Yield], ...]
    """The study with each grade."""
    correlations: Array
    """Columns with perturbations, shape (C, P)."""
    put_together: Array
    """Share of the builds that cannot be put together that can once a perturbation alone is none, shape (P,)."""
    focusing: tuple[Adjuster, float] | None
    """Focusing range that would put 99 % of all together, and the share that it would; None where none need be."""
    worst: tuple[WorstTrial, ...]
    warnings: tuple[str, ...]
    built: LengthCovariance
    """Covariance of the builds' lengths, adjusted where anything is."""
    precision: _Precision | None = None
    """Standard errors of the run; None where nobody asked."""
    adjusters: tuple[AdjusterUse, ...] = ()
    """Moves of each adjuster."""
    tracing: tuple[str, ...] = ()
    """How builds behind a real lens were traced; nothing where it is ideal."""
    calibration: CalibratedLengths | None = None
    """Lengths as a calibration that follows will know them; None of builds that nobody calibrates."""

    def __str__(self) -> str:
        low, high = self.final.result.interval
        return (
            f"{self.plan.name}: yield {self.final.result.value:.2%} ({low:.2%} to {high:.2%}, 95 %) of "
            f"{self.plan.trials:,} Monte Carlo units (builds); roslf.report(...) shows all, .to_dict() gives it"
        )

    @property
    def final(self) -> Variant:
        """The variant that counts."""
        return self.variants[-1]

    @property
    def depth(self) -> DepthBudget | None:
        """Depth to be expected of a build that is taken as designed; None of one whose pixels are no views."""
        camera = Camera.of(self.plan.question.design)
        return None if is_focused(camera) else depth_budget(camera, build=self.built)

    @cached_property
    def required(self) -> tuple[Requirement, ...]:
        """Requirements of the design, its lengths as built, and as calibrated where a calibration follows."""
        return required_of(self.plan.question.design, self.built, self.calibration)

    @cached_property
    def uncounted(self) -> tuple[Requirement, ...]:
        """Requirements that builds tell and no limit of the study is as narrow as."""
        return _uncounted(self.plan, self.final, self.required)

    @cached_property
    def together(self) -> Yield:
        """Yield of everything required."""
        return yield_of_all(self.plan, self.final, self.required)

    @cached_property
    def short_of(self) -> tuple[tuple[str, float], ...]:
        """Requirements that the yield does not count and fewer builds meet than its target, with their shares.

        The share is 0 of what the nominal design misses.
        """
        short = list[tuple[str, float]]()
        for one in self.required:
            counted = _is_limited(self.plan, self.final, one) and one.quantity != "u_z_mm"
            alone = one.met and not counted and of_builds(one)
            share = (share_that_meets(self.plan, self.final, one) if alone else None) or Yield(int(one.met), 1)
            if share.value < self.study.yield_target and not counted:
                met = (
                    f"{one.label} {one.limits}, which {100 * share.value:.1f} % of {share.trials:,} builds meet "
                    f"(standard error {100 * share.standard_error:.2g} %)"
                )
                if one.quantity in WIDTHS:
                    met = clauses(met, unsaid_bore(Camera.of(self.plan.question.design)), by=": ")
                short.append((met if one.met else missed_words([one]), share.value))
        return tuple(short)

    @property
    def left_out(self) -> str:
        """Words on what goals of depth leave out, as `lengths_left_out`."""
        return lengths_left_out(self.plan, self.built)

    def to_dict(self) -> dict[str, Any]:
        """The JSON object; what is not finite is None."""
        plan, draws, moves = self.plan, self.plan.draws, self.sensitivity
        columns = [column.label for column in plan.columns]
        places = [p.place for p in draws.perturbations]
        missed = ("place", "nominal", "tolerance", "distribution", "sigma", "group", "opposed", "source")
        by_yield = None
        if self.scale_for_target is not None:
            scale, reached = self.scale_for_target
            tolerances = {p.place: p.tolerance * scale for p in draws.perturbations}
            by_yield = {
                "target": self.study.yield_target,
                "scale": scale,
                **reached.to_dict(),
                "tolerances": tolerances,
            }
        data = {
            "schema": SCHEMA,
            "study": plan.name,
            "design": plan.question.design.name,
            "digest": plan.digest(),
            "seed": draws.seed,
            "sampling": draws.sampling,
            "trials": plan.trials,
            "fields_mm": plan.question.fields,
            "object_distance_mm": plan.question.object_distance,
            "accuracy": None if self.precision is None else self.precision.to_dict(),
            "real_lens": {"method": self.tracing[0]} if self.tracing else None,
            "yield": {
                "value": self.final.result.value,
                "interval_95": self.final.result.interval,
                "trials": self.final.result.trials,
                "of": self.final.name,
                "left_out": self.left_out,
            },
            "yield_required": self.together.to_dict(),
            "perturbations": [{name: getattr(p, name) for name in missed} for p in draws.perturbations],
            "groups": [{"group": name, "correlation": rho} for name, rho in draws.correlations],
            "variants": [variant.to_dict() for variant in self.variants],
            "compensators": [one.to_dict() for one in self.adjusters],
            "depth_expected": None if (depth := self.depth) is None else depth.to_dict(),
            "sensitivity": {
                "columns": columns,
                "places": places,
                "derivative": moves.derivatives,
                "exact": moves.exact,
                "variants": plan.variants,
                "at_plus": moves.plus,
                "at_minus": moves.minus,
                "twins": {
                    columns[row]: {
                        "derivative": moves.twin_derivatives[row],
                        "at_plus": moves.twin_plus[:, row],
                        "at_minus": moves.twin_minus[:, row],
                    }
                    for row in np.flatnonzero(plan.infinite).tolist()
                },
            },
            "rss": self.rss,
            "sobol": None if self.sobol is None else {"columns": columns, **plain(self.sobol)},
            "inverse_sensitivity": self.allowed,
            "yield_curve": [{"scale": scale, **result.to_dict()} for scale, result in self.yield_curve],
            "inverse_by_yield": by_yield,
            "budget": None if self.budget is None else self.budget.to_dict(),
            "grades": [{"grade": grade, **result.to_dict()} for grade, result in self.grades],
            "correlations": {"columns": columns, "places": places, "values": self.correlations},
            "put_together_without": dict(zip(places, self.put_together.tolist(), strict=True)),
            "put_together_by_focusing": None if self.focusing is None else [*self.focusing],
            "worst": [{"trial": w.number, **{k: v for k, v in vars(w).items() if k != "number"}} for w in self.worst],
            "required_short_of": [{"words": words, "share": share} for words, share in self.short_of],
            "warnings": self.warnings,
        }
        finite: dict[str, Any] = plain(data)
        return finite


def share_that_meets(plan: TolerancePlan, final: Variant, one: Requirement) -> Yield | None:
    """Share of the builds that are cameras that meet a requirement: the study's own limit, or the first of them.

    None where neither tells it.
    """
    own = own_limit(plan, final, one)
    return _share_that_meets_all(plan, [one]) if own is None else own.result


def own_limit(plan: TolerancePlan, final: Variant, one: Requirement) -> LimitYield | None:
    """The study's own limit that is just the requirement's; of a depth none, whose lengths it takes as known."""
    alike = ((limit.label, limit.low, limit.high) == _limit_of(plan, one) for limit in final.limits)
    return None if one.quantity == "u_z_mm" else next(compress(final.limits, alike), None)


def _share_that_meets_all(plan: TolerancePlan, required: Sequence[Requirement]) -> Yield | None:
    """Share of a plan's first builds that are cameras that meet all requirements which builds tell; None of none."""
    told = [one for one in required if of_builds(one)]
    if not told:
        return None
    holds, good, _ = _meeting(plan, told)
    return Yield(int(holds.sum()), int(good.sum()))


def _uncounted(plan: TolerancePlan, final: Variant, required: Sequence[Requirement]) -> tuple[Requirement, ...]:
    """Requirements that builds tell and no limit of a study is as narrow as."""
    return tuple(one for one in required if of_builds(one) and not _is_limited(plan, final, one))


def yield_of_all(plan: TolerancePlan, final: Variant, required: Sequence[Requirement]) -> Yield:
    """Yield of everything required: of a study's limits, or of its first builds where what else counts takes some."""
    if not (more := _uncounted(plan, final, required)):
        return final.result
    own = holding(plan, first_deviations(plan, MANY))
    lost = own & ~_meeting(plan, more)[0]
    return Yield(int((own & ~lost).sum()), own.size) if lost.any() else final.result


def _meeting(plan: TolerancePlan, told: Sequence[Requirement]) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array]:
    """Which of a plan's first builds meet all requirements and which are cameras, (T,); their values, (K, T)."""
    builds, good = first_builds(plan, MANY)
    holds, values = good.copy(), []
    with np.errstate(all="ignore"):  # of builds that are no cameras
        for one in told:
            value = of_cameras(plan.question.design, QUANTITIES[one.quantity], builds.camera, one.at_mm)
            values.append(np.broadcast_to(value, good.shape))
            holds &= one.holds(value)
    return holds, good, np.array(values)


def culprit_of(plan: TolerancePlan, one: Requirement) -> tuple[str, float]:
    """Place that most of a requirement's variance over a plan's first builds is of, and its share; empty of none."""
    _, good, (values,) = _meeting(plan, [one])
    if not (np.isfinite(values[good]).all() and np.ptp(values[good]) > 0):
        return "", 0.0
    drawn = first_deviations(plan, MANY)[:, good]
    with np.errstate(all="ignore"):  # of tolerances of 0
        shares = np.nan_to_num([np.corrcoef(own, values[good])[0, 1] ** 2 for own in drawn])
    return plan.draws.perturbations[int(shares.argmax())].place, float(shares.max())


def _is_limited(plan: TolerancePlan, final: Variant, one: Requirement) -> bool:
    """Whether a study's limits are as narrow as a requirement: off the axis at its microlens, else anywhere."""
    label, low, high = _limit_of(plan, one)
    alike = (limit for limit in final.limits if label in (limit.label, limit.label.partition("@")[0]))
    return any(low <= limit.low and limit.high <= high for limit in alike)


def of_builds(one: Requirement) -> bool:
    """Whether any builds, of a real lens thin-lens models, tell how many of them meet a requirement.

    They do not tell how far lengths are off of depth, expected, and nothing off the field's middle, which a study's own
    limits may hold.
    """
    return one.quantity != "u_z_mm" and one.field is None


def asked_ends(one: Requirement) -> tuple[float, float]:
    """Ends that are required."""
    return -math.inf if one.min is None else one.min, math.inf if one.max is None else one.max


def _limit_of(plan: TolerancePlan, one: Requirement) -> tuple[str, float, float]:
    """Label of a study's column of the quantity, empty where it has none, and the ends that are required."""
    low, high = asked_ends(one)
    if one.field is None:
        return Column(one.quantity, None, one.at_mm).label, low, high
    name = {whole: at_field for at_field, whole in AT_FIELD.items()}.get(one.quantity, one.quantity)
    place, fields = one.x_ml_mm, plan.question.fields
    if place is None or (name in AT_FIELD and one.at_mm is not None):
        return "", low, high
    here = (k for k, at in enumerate(fields) if math.dist(at, place) < SAME_PLACE)
    return next((Column(name, k).label for k in here), ""), low, high


def reach_of(p: Perturbation, kind: str) -> float:
    """Half-width beyond which a miss makes another design, is not met or ends closed forms of tilts; else infinite.

    A tolerance that is given is within it, and it is no farther than limits are looked for.
    """
    if kind == "temperature":
        return max(min(p.nominal - COLDEST, HOTTEST - p.nominal), p.tolerance)
    sized = p.nominal and ".decentre." not in p.place
    most = REACH if kind == "angle" else REACH * abs(p.nominal) if sized else math.inf
    return min(max(most, p.tolerance), LOOSEST * p.tolerance) if math.isfinite(most) else most


def _within_reach(allowed: Allowed, p: Perturbation, kind: str) -> Allowed:
    """Inverse sensitivity of a perturbation without limits that lie beyond its `reach_of`."""
    reach = reach_of(p, kind)
    none = f"no limit within ± {display(reach, kind)}"
    if allowed.alone > reach * (1 - AT_REACH):
        allowed = replace(allowed, alone=math.inf, alone_limited_by=none)
    return (
        replace(allowed, tolerance=math.inf, limited_by=none) if allowed.tolerance > reach * (1 - AT_REACH) else allowed
    )


def sobol_samples(plan: TolerancePlan, study: Study) -> int:
    """Base samples of a study's Sobol indices; unless given, no more than `MOST_DEAR` builds where these are dear."""
    if study.only is not None:
        return 0
    if not plan.dear or "sobol_samples" in study.model_fields_set:
        return study.sobol_samples
    return min(study.sobol_samples, 1 << int(math.log2(max(MOST_DEAR / (len(plan.draws.factors) + 2), 1))))


STEPS = (
    "", "scatter of each tolerance", "yield over tolerance", "tolerances for the target", "Sobol indices",
    "each tolerance alone", "changes, tolerances to relax", "other grades",
)  # fmt: skip
"""Names of the steps of `builds_of_analyses`."""
FIRST = 4
"""Number of those that `first_analyses` takes."""


def builds_of_analyses(plan: TolerancePlan, study: Study, grades: Grades, budgets: bool = True) -> tuple[int, ...]:
    """Builds that each step of `analyse` takes, about; one whose depth errors are summed anew counts for many."""
    count, at_once = len(plan.draws.perturbations), curve_trials(plan)
    holds = not plan.nominal_misses() and study.only is None
    graded = (len(grades.names) - 1) * at_once * bool(study.grade and study.only is None)
    asked = [plan.columns[limit.column].quantity for limit in plan.limits]
    summed = 0 if plan.dear else SUMMED * sum(one.numeric and one.of_views for one in asked)
    # Where builds are adjusted few of them take as long as many: of each step the few that its next ones may ask for.
    steps = (INVERTED_ADJUSTED if plan.adjusters else INVERTED) * count
    sobol, inverse = sobol_samples(plan, study) * (count + 2), steps * holds * (1 + summed)
    searched = (40 + count) * searched_builds(plan) * (holds and budgets)
    return 0, 4 * count, 6 * at_once, 8 * at_once, sobol, inverse, searched, graded


def analyse(
    plan: TolerancePlan,
    study: Study,
    grades: Grades,
    tally: Tally,
    worst: tuple[WorstTrial, ...] = (),
    *,
    budgets: bool = True,
    progress: CountedProgress = silent,
) -> StudyResult:
    """Every analysis of a study whose trials have run; `budgets`: what reaches the target yield, too.

    `progress` is told after each how much is done, by the builds that it takes, about; of the budget also within.
    """
    told = as_one(progress, "analyses", builds_of_analyses(plan, study, grades, budgets))
    first = first_analyses(plan, study, tally, worst, progress=told)
    return further_analyses(first, grades, budgets=budgets, progress=told)


def as_one(progress: CountedProgress, whole: str, costs: Sequence[int]) -> CountedProgress:
    """Progress of the first of `STEPS`, told as one thing's by the builds that each takes."""
    ends = (np.cumsum(costs) / sum(costs)).tolist()

    def told(what: str, done: float = 0.0, total: float = 0.0) -> None:
        at = STEPS.index(what)
        progress(whole, ends[at - 1] + done * (ends[at] - ends[at - 1]), 1.0)

    return told


def first_analyses(
    plan: TolerancePlan,
    study: Study,
    tally: Tally,
    worst: tuple[WorstTrial, ...] = (),
    *,
    progress: CountedProgress = silent,
) -> StudyResult:
    """Yield, table and scatter of a study whose trials have run: what `only = "yield"` leaves of `analyse`."""
    count, misses = len(plan.draws.perturbations), plan.nominal_misses()
    progress(STEPS[1], 0.0, 1.0)
    variants, moves = summarise(plan, tally), sensitivity(plan)
    tracing = notes(plan.question.design, plan.question.fields)
    rss = tuple(rss_rows(plan, moves, variants[0]))
    builds = ScaledBuilds(plan, plan.draws, curve_trials(plan))
    progress(STEPS[2], 0.0, 1.0)
    curve = yield_curve(builds, variants[-1].result)
    progress(STEPS[3], 0.0, 1.0)
    scaled = scale_for_yield(plan, study.yield_target, curve, builds)
    progress(STEPS[3], 1.0, 1.0)
    lost, room = variants[-1].impossible, (1 - TOGETHER) * plan.trials
    # What stands in the bore collides wherever the array is.
    collide = max((count for words, count in variants[-1].faults if words.endswith(COLLIDE)), default=0)
    return StudyResult(
        plan=plan,
        study=study,
        variants=variants,
        sensitivity=moves,
        rss=rss,
        sobol=None,
        allowed=(),
        yield_curve=curve,
        scale_for_target=scaled,
        budget=None,
        grades=(),
        correlations=correlations(tally),
        put_together=put_together(plan) if variants[-1].impossible else np.zeros(count),
        focusing=least_reach(plan) if lost > room >= collide else None,
        worst=worst,
        warnings=(*tracing, *_warnings(plan, variants, rss, misses, moves)),
        built=lengths_built(plan),
        adjusters=tuple(map(AdjusterUse, plan.adjusters, tally.travel.tolist(), tally.at_end.tolist())),
        tracing=tracing,
    )


def further_analyses(
    first: StudyResult, grades: Grades, *, budgets: bool = True, progress: CountedProgress = silent
) -> StudyResult:
    """A study's first analyses with those behind its yield, which take most of the time; arguments as of `analyse`."""
    plan, study, given = first.plan, first.study, first.final.result
    count, samples = len(plan.draws.perturbations), sobol_samples(plan, study)
    searched = not plan.nominal_misses() and study.only is None
    sobol_step, alone_step, budget_step, grades_step = STEPS[4:]
    sobol = sobol_indices(plan, samples, shares(progress, sobol_step)) if samples else None
    progress(alone_step)
    kinds, share = perturbable(plan.question.design), 1 / math.sqrt(count) if study.share == "rss" else 1 / count
    alone = zip(inverse_sensitivity(plan, share) if searched else (), plan.draws.perturbations, strict=False)
    allowed = tuple(_within_reach(one, p, kinds[p.place]) for one, p in alone)
    reached = given.value >= study.yield_target

    def tell(share: float) -> None:
        progress(budget_step, share, 0.0 if reached or share >= SEVERAL else 1.0)  # relaxing ends nobody knows when

    tell(0.0)
    saved = budget(plan, study, grades, given, first.scale_for_target, tell) if budgets and searched else None
    progress(grades_step)
    yields = _grades(plan, study, grades, given)
    progress(grades_step, 1.0, 1.0)
    return replace(first, sobol=sobol, allowed=allowed, budget=saved, grades=yields)


def _grades(plan: TolerancePlan, study: Study, grades: Grades, given: Yield) -> tuple[tuple[str, Yield], ...]:
    """The study at each grade; at its own the run has it."""

    def yield_of(name: str) -> Yield:
        if name == study.grade:
            return given
        other = make_plan(study.model_copy(update={"grade": name}), plan.question.design, grades)
        return yield_at(other, 1.0, curve_trials(plan))

    return tuple((name, yield_of(name)) for name in (grades.names if study.grade and study.only is None else ()))


def lengths_left_out(plan: TolerancePlan, built: LengthCovariance) -> str:
    """Words on what limits of expected depth leave out of every build, and the number with it; empty without such.

    Lengths are what the builds differ in, so the metric takes each one's as known. `built` is their covariance.
    """
    columns = [plan.columns[limit.column] for limit in plan.limits]
    goals = [(column.label.partition("@")[0], column.at) for column in columns if column.metric in KNOWN_LENGTHS]
    return depth_left_out(plan.question.design, goals, built)


def depth_left_out(design: Design, goals: Sequence[tuple[str, float | None]], built: LengthCovariance) -> str:
    """Words on what a yield by these goals of expected depth, each with its distance, leaves out; empty of none."""
    if not goals:
        return ""
    camera, whole = Camera.of(design), {}
    for at in dict.fromkeys(at for _, at in goals):
        where = "in the focal plane" if at is None else f"at {number(at, 4)} mm"
        whole[where] = uncertainty(float(depth_budget(camera, at, build=built).u_z_mm), 3)
    told = listed([f"{u} {where}" for where, u in whole.items()])
    limited = listed(list(dict.fromkeys(name for name, _ in goals)))
    return (
        f"Lengths as built are left out of {limited}: each build's own are taken as known. With them, of a camera that "
        f"nobody calibrates, u = {told}, which the data sheet (`roslf datasheet`) gives and holds against what is "
        "required."
    )


def _warnings(
    plan: TolerancePlan,
    variants: tuple[Variant, ...],
    rss: tuple[RssRow, ...],
    misses: tuple[str, ...],
    moves: Sensitivity,
) -> Iterator[str]:
    if misses:
        yield (
            f"the nominal design itself misses {', '.join(misses)}: "
            "no tolerance can mend that, and inverse sensitivity is left out"
        )
    if plan.calibrated and variants[-1].limits == variants[0].limits:
        yield (
            f"{CALIBRATION} moves none of these limits: it teaches the decoder each build and moves no part; without "
            "that compensator the study answers the same, sooner"
        )
    yield from _beside_range(plan)
    for column in variants[-1].distributions:
        if column.undefined:
            yield (
                f"{column.label} is undefined in {column.undefined} of {plan.trials - variants[-1].impossible} builds "
                "that can be put together; they count as failures, and its mean and standard deviation are not stated"
            )
    bent = [row.column for row in rss if not row.linear and math.isfinite(row.monte_carlo)]
    if bent:
        yield f"not linear, so RSS misleads (use Monte Carlo): {', '.join(bent)}"
    if plan.draws.sampling == "sobol" and plan.trials & (plan.trials - 1):
        power = 1 << (plan.trials - 1).bit_length()
        yield f"{plan.trials:,} trials of a Sobol sequence are less even than a power of two, e.g. {power:,}"
    tilts = any(".tilt." in p.place for p in plan.draws.perturbations)
    if tilts and "non_distortion_room_mm" in plan.question.metrics:
        yield "non_distortion_room_mm is right to first order in tilts; kept_fraction is exact in them"
    given = plan.question.design.depth.disparity_error is not None
    if note := bound_note((plan.columns[limit.column].metric for limit in plan.limits), given):
        yield note
    for name, left_out in plan.by_formula.items():
        yield f"{name} is not traced behind the real lens: its formula leaves out {left_out}"
    if twins := plan.of_thin_twins:
        named = ", ".join(twins)
        yield f"of the thin-lens model, nominal and of each build (`roslf evaluate` traces field and detail): {named}"
    if plan.by_rays:
        named = ", ".join(column.label for column in plan.by_rays)
        yield (
            f"of rays through the nominal lens, from where builds change as their thin-lens models do: {named}; what "
            "wedges and decentres of surfaces take of detail and of the undistorted field is not in it"
        )
    moved = np.maximum(np.abs(moves.plus[0]), np.abs(moves.minus[0])) > ROUNDING * np.abs(plan.nominal)[:, None]
    for kind in ("decentre", "tilt"):
        of_kind = [f".{kind}." in p.place for p in plan.draws.perturbations]
        still = zip(plan.columns, moved[:, of_kind].any(axis=1).tolist(), strict=True)
        unmoved = [column.label for column, any_moves in still if column.field is None and not any_moves]
        if any(of_kind) and unmoved:
            yield f"of the whole camera, moved by no {kind} here: {', '.join(unmoved)}"


def _beside_range(plan: TolerancePlan) -> Iterator[str]:
    """Words on builds that are used at other temperatures than the design's range; none where they are not."""
    environment = plan.question.design.environment
    warm = next((p for p in plan.draws.perturbations if p.place == TEMPERATURE), None)
    if environment is None or environment.range is None or warm is None:
        return
    cold, hot = environment.range
    ends = warm.nominal - warm.tolerance, warm.nominal + warm.tolerance
    if not np.allclose(ends, (cold, hot), rtol=0, atol=SAME_WARMTH):
        yield (
            f"builds are used at {ends[0]:g} to {ends[1]:g} degC, ± {warm.tolerance:g} K about the design's own "
            f"temperature, not over its environment.range, {cold:g} to {hot:g} degC; with temperature = "
            f'"{(cold + hot) / 2:g} degC" in [environment] and a tolerance of {(hot - cold) / 2:g} K they would be'
        )


def save_worst(plan: TolerancePlan, tally: Tally, folder: Path) -> tuple[WorstTrial, ...]:
    """Write the worst trials as design files, adjustments included, but those that hold every limit."""
    rows = []
    for trial, score, moved in zip(tally.worst.tolist(), tally.scores.tolist(), tally.worst_moved, strict=True):
        chunk, within = divmod(trial, plan.chunk)
        build = plan.draws.deviations(plan.draws.uniforms(chunk, plan.chunk, within, within + 1)), moved[:, None]
        name, design = f"worst-trial-{trial}.toml", plan.question.design
        measured = measure_finally(plan, build[0])
        name = "" if plan.passes(measured).all() else name
        text = {"name": f"{design.name}, trial {trial} of {plan.name}", "source": f"seed {plan.draws.seed}"}
        faults: tuple[str, ...] = ()
        try:
            design = design_adjusted(plan, *build).replace(text)
        except InputError as error:  # its numbers make no design, which is why it failed
            faults = final_faults(plan, *build)[0] or tuple(problem.message for problem in error.problems)
            numbers = {place: float(value[0]) for place, value in final_values(plan, *build).items()}
            text["source"] += f"; cannot be put together: {'; '.join(faults)}"
            design = design.replace(text).unchecked(of_parts(design, numbers))
            name = "" if any(map(in_lens, numbers)) else name
        if name:
            save(design, folder / name, overwrite=True, digits=WRITTEN)
        misses = {p.place: float(miss) for p, miss in zip(plan.draws.perturbations, build[0][:, 0], strict=True)}
        values = dict(zip((column.label for column in plan.columns), measured[:, 0].tolist(), strict=True))
        rows.append(WorstTrial(trial, score, name, misses, values, faults))
    return tuple(rows)


def trial_arrays(plan: TolerancePlan, tally: Tally) -> dict[str, NDArray[Any]]:
    """The first trials one by one, for a notebook: deviations, metrics and adjustments, with their names."""
    return {
        "places": np.array([p.place for p in plan.draws.perturbations]),
        "tolerances": np.array([p.tolerance for p in plan.draws.perturbations]),
        "columns": np.array([column.label for column in plan.columns]),
        "adjusters": np.array([adjuster.place for adjuster in plan.adjusters], dtype=str),
        "deviations": tally.drawn,
        "metrics": tally.measured,
        "adjustments": tally.moved,
    }


def trials_for(accuracy: float, sampling: str = "random") -> int:
    """Trials after which every share is within `accuracy` in 95 % of runs, whatever the share.

    ``SIGMAS sqrt(p (1 - p)/n)`` is largest at p = 1/2; a little more pays for the binomial interval's own steps. Sobol
    points are counted on for no less, and come in a power of two.

    Raises
    ------
    InputError
        Out of range.
    """
    check_accuracy(accuracy, FINEST, f"a finer yield takes more than {MOST_TRIALS:.0e} trials")
    count = math.ceil((SIGMAS / 2 / accuracy + 1) ** 2)
    return min(1 << (count - 1).bit_length() if sampling == "sobol" else count, MOST_TRIALS)


def precision(
    plan: TolerancePlan, tally: Tally, final: Variant, asked: float | None = None, seconds: float | None = None
) -> _Precision:
    """Precision of a run's shares and quantiles.

    Parameters
    ----------
    plan : TolerancePlan
    tally : Tally
        All trials.
    final : Variant
        That counts.
    asked : float, optional
        What yield and ranks may be off by.
    seconds : float, optional
        That the run took.

    Notes
    -----
    Measured from the scatter of `PARTS` parts of the trials that are kept one by one, scaled to the run; not where
    these are few.
    """
    from scipy.special import ndtri

    low, high = final.result.interval
    # Half the interval over its number of sigmas: a share of 0 or 1 has an error, too.
    yields = _StandardError(0.5 * (high - low) / float(ndtri(0.5 + CONFIDENCE / 2)), None)
    ranks = _StandardError(max(math.sqrt(p * (1 - p) / plan.trials) for p in (*plan.quantiles, 0.0)), None)
    measured, by, each = None, "", len(tally.measured) // PARTS
    if each >= LEAST:
        values = tally.measured[: each * PARTS, -1].T
        share = each * PARTS / plan.trials
        by = f"{PARTS} parts of the first {len(tally.measured):,} trials" + (", scaled" if share < 1 else "")

        def error(good: NDArray[np.bool_], of: NDArray[np.bool_] | np.bool_ = np.True_) -> Array:
            """Standard errors of the share of good builds, shape (..., trials), among those that count."""
            counts = np.broadcast_to(of, good.shape[-1:]).reshape(PARTS, each).sum(axis=-1)
            shares = good.reshape(*good.shape[:-1], PARTS, each).sum(axis=-1) / np.maximum(counts, 1)
            return np.asarray(shares.std(axis=-1, ddof=1) * math.sqrt(share / PARTS))

        yields = replace(yields, measured=float(error(np.asarray(plan.passes(values).all(axis=0)))))
        defined = [c for c, column in enumerate(final.distributions) if not column.undefined]
        below = [values[c] <= np.array(final.distributions[c].quantiles)[:, None] for c in defined]
        cameras = ~np.isnan(values).all(axis=0)
        squares = np.mean(error(np.array(below), cameras) ** 2, axis=0) if below else np.zeros(1)
        ranks = replace(ranks, measured=math.sqrt(squares.max(initial=0.0)))
        measured = SIGMAS * max(yields.measured or 0.0, ranks.measured or 0.0)
    sampled = "Sobol points" if plan.draws.sampling == "sobol" else "random builds"
    accuracy = Accuracy(
        "yield, and the share of builds below each quantile",
        "% of the builds",
        f"{plan.trials:,} {sampled}; {shapes_text(plan)}",
        max(SIGMAS * ranks.expected, 0.5 * (high - low)),
        measured,
        by,
        asked,
        seconds,
        scatter=1 / math.sqrt(2 * (PARTS - 1)),
        known=f"yield known to ±{50 * (high - low):.2g} % of the builds (95 %), the share below each quantile to "
        f"±{100 * SIGMAS * ranks.expected:.2g} %",
    )
    return _Precision(accuracy, yields, ranks)


def shapes_text(plan: TolerancePlan) -> str:
    """How each build is computed: always the exact way, as that is the quicker one, too."""
    design, shapes = plan.question.design, any(name in SHAPES for name in plan.question.metrics)
    discs = design.sees_discs and not any(".tilt." in p.place for p in plan.draws.perturbations)
    return mount_of(design).method(shapes, discs)
