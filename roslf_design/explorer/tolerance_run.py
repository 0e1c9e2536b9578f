"""Tolerance run: builds to a grade, their yield, what spoils them, and how the page shows it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..camera import Camera
from ..evaluation.required import limits_for_study, missed_words, outcome_of, outcomes_words, required_of
from ..reporting.story import quick_study
from ..reporting.tolerance.pages import depth_sentence, impossible_words, loose_words
from ..reporting.tolerance.pictures import LimitSpread, Offender, Yields
from ..theory.depth_budget import depth_budget
from ..theory.quantities import in_words
from ..tolerancing.metrics import Column
from ..tolerancing.places import perturbable, short_name
from ..tolerancing.result import lengths_left_out
from ..tolerancing.run import tally_chunk
from ..tolerancing.sensitivities import sensitivity
from ..tolerancing.study import MetricGoal, TolerancePlan, make_plan, tolerance_plan
from ..tolerancing.summaries import Variant, summarise
from ..tolerancing.tally import merged
from ..tolerancing.trials import lengths_built
from ..tolerancing.yields import Yield, yield_at
from ..units import format_quantity
from ..words import listed, to_html
from .forms import USUAL_LIMITS, ToleranceRequest
from .jobs import Tell
from .state import PLACES

CURVE_TRIALS = 4096
"""Most builds for one point of the yield curve, and for the other grades."""
SCALES = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Factors on all tolerances at once."""


@dataclass(frozen=True)
class ToleranceResult(Yields):
    """Result of a tolerance run."""

    limits: tuple[tuple[str, Yield], ...]
    """Yield of each limit alone."""
    offenders: tuple[Offender, ...]
    """Worst first."""
    spreads: tuple[LimitSpread, ...]
    question: str
    """The limits in words."""
    target: float
    """Target yield, which outcomes go by."""

    def page(self) -> dict[str, Any]:
        """Values for the page."""
        share, (low, high) = self.share, self.share.interval
        return {
            "headline": f"{_percent(share.value)} of the Monte Carlo units (builds) hold every limit "
            f"(95 % interval {_percent(low)} to {_percent(high)}; {share.trials:,} builds): "
            f"{outcome_of(share.value, self.target)}",
            "question": to_html(self.question),
            "rows": [
                {"label": to_html(label), "share": f"{_percent(share.value)}, {outcome_of(share.value, self.target)}"}
                for label, share in sorted(self.limits, key=lambda limit: limit[1].value)
            ],
        }


def run_tolerance(request: ToleranceRequest, tell: Tell = lambda share, text: None) -> ToleranceResult:
    """Builds to a grade: their yield, what spoils them, how they scatter.

    Raises
    ------
    InputError
        The grade is not known, or does not suit the design.
    """
    design, trials = request.design, request.trials
    tell(None, "limits and tolerances")
    data: dict[str, Any] = quick_study(design, request.seed) | {"grade": request.grade, "trials": trials}
    limits = [limit.model_dump(mode="json", exclude_none=True) for limit in request.limits]
    off_axis = [limit for limit in limits_for_study(design) if "field" in limit]
    data["goals"] = (limits if request.only_own else data["goals"] + limits) + off_axis
    if not request.calibrated:
        data["compensators"] = []
    plan, study, grades = tolerance_plan(data, design)
    misses = [_label(label) for label in plan.nominal_misses()]
    nominal = f"As drawn, before any tolerance, it misses {listed(misses)}, which no grade mends." if misses else ""
    few = min(trials, CURVE_TRIALS)
    # In builds: the run itself, the offenders (as long as one run of fewer), one run of fewer for each point.
    total = trials + few * (len(grades.names) + len(SCALES) - 1)
    done = 0
    tallies = []
    for index in range(plan.chunks):
        tell(done / total, f"{done:,} of {trials:,} builds{f'. {nominal}' * bool(nominal)}")
        tallies.append(tally_chunk(plan, index))
        done += plan.chunk_trials(index)
    variant = summarise(plan, merged(tallies))[-1]
    tell(done / total, "one tolerance after the other")
    offenders = sorted(_offenders(plan), key=lambda row: -row.used)

    def few_builds(text: str, asked: TolerancePlan, scale: float) -> Yield:
        nonlocal done
        done += few
        tell(done / total, text)
        return yield_at(asked, scale, few)

    graded = {name: make_plan(study.model_copy(update={"grade": name}), design, grades) for name in grades.names}
    own = variant.result
    by_grade = [
        (name, own if name == request.grade else few_builds(f"grade {name}", other, 1.0))
        for name, other in graded.items()
    ]
    curve = [
        (scale, own if scale == 1.0 else few_builds(f"all tolerances times {scale:g}", plan, scale)) for scale in SCALES
    ]
    decoder = "calibrated on each build" if request.calibrated else "as designed"
    built = lengths_built(plan)
    depth = depth_budget(Camera.of(design), build=built)
    left_out = in_words(lengths_left_out(plan, built))
    missed = missed_words(required_of(design, built))
    missed = in_words(f"As built, uncalibrated, it misses its [required]: {missed}.") if missed else ""
    told = (nominal, missed, depth_sentence(depth, plan), left_out, loose_words(plan), impossible_words(variant))
    held = [USUAL_LIMITS] * (not request.only_own) + [_limit_words(limit) for limit in request.limits]
    held += ["what [required] asks for off the axis"] * bool(off_axis)
    return ToleranceResult(
        grade=request.grade,
        share=own,
        limits=tuple((_label(limit.label), limit.result) for limit in variant.limits),
        offenders=tuple(offenders),
        spreads=tuple(_spreads(variant)),
        grades=tuple(by_grade),
        curve=tuple(curve),
        question=f"{trials:,} Monte Carlo units (builds) to the grade '{study.grade}', the decoder {decoder}. A build "
        "is good with: "
        f"{'; '.join(held)}. "
        f"{' '.join([outcomes_words(study.yield_target), *filter(None, told)])}",
        target=study.yield_target,
    )


def _label(column: str) -> str:
    """A column in words, its field by name: ``fill_factor@2``."""
    name, _, number = column.partition("@")
    if not number:
        return in_words(name)
    beyond = int(number) - len(PLACES)
    place = PLACES[int(number)] if beyond < 0 else f"place {beyond + 1} off the axis of [required]"
    return f"{in_words(name)}, {place}"


def _limit_words(limit: MetricGoal) -> str:
    """A limit in a sentence."""
    ends = {"at least": limit.min, "at most": limit.max}
    column = Column(limit.quantity, None, limit.at)
    told = [f"{word} {end:.4g} {column.quantity.unit}".strip() for word, end in ends.items() if end is not None]
    return f"{_label(column.label)} {listed(told)}"


def _offenders(plan: TolerancePlan) -> Iterator[Offender]:
    """Every tolerance by what it alone uses of the limits that the nominal design holds: there is nothing of others."""
    missed = plan.missed
    moves, kinds = sensitivity(plan), perturbable(plan.question.design)
    ends = np.stack([moves.twin_plus[-1], moves.twin_minus[-1]])
    for index, perturbation in enumerate(plan.draws.perturbations):
        used, worst = 0.0, ""
        for limit in (one for one in plan.limits if one not in missed):
            label = plan.columns[limit.column].label
            here = plan.judged(plan.nominal[[limit.column]], [limit.column])[0]
            for edge, sign in ((limit.high, 1.0), (limit.low, -1.0)):
                way = float(sign * (plan.judged(np.array([edge]), [limit.column])[0] - here))
                if not (math.isfinite(edge) and math.isfinite(way)):
                    continue
                move = float(np.max(sign * ends[:, limit.column, index]))
                part = math.inf if math.isnan(move) else move / way if way > 0 else math.inf if move > 0 else 0.0
                if part > used:
                    used, worst = part, label
        size, kind = f"{perturbation.tolerance:.3g}", kinds[perturbation.place]
        tolerance = format_quantity(float(size), kind) if kind in ("length", "angle") else size
        yield Offender(short_name(perturbation.place, plan.question.design), tolerance, used, _label(worst))


def _spreads(variant: Variant) -> Iterator[LimitSpread]:
    columns = {column.label: column for column in variant.distributions}
    for limit in variant.limits:
        column = columns[limit.label]
        at = dict(zip(column.probabilities, column.quantiles, strict=True))
        label = _label(limit.label)
        yield LimitSpread(label, column.nominal, at[0.05], at[0.95], limit.low, limit.high)


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
