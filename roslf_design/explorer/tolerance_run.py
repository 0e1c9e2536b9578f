"""A tolerance run for the explorer: builds to a grade, their yield, what spoils them, how they scatter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .jobs import Job, Tell

if TYPE_CHECKING:
    from ..design import Design
    from ..tolerance.study import Plan, Study

FIELDS = ("centre", "edge", "corner")
AXES = {"0": "x", "1": "y"}
GRADES = ("commercial", "precision", "high")
"""Of the shipped table, from loose to tight."""
TRIALS = 16384
"""Builds where nobody says otherwise."""
TRIALS_TRACED = 1024
"""The same behind a real lens, whose every build is traced."""
CURVE_TRIALS = 4096
"""Most builds for one point of the yield curve, and for the other grades."""
SCALES = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Of all tolerances at once."""


@dataclass(frozen=True)
class ToleranceRequest:
    """What is asked."""

    design: Design
    grade: str = "precision"
    trials: int | None = None
    """None: `TRIALS`, or `TRIALS_TRACED` behind a real lens."""
    seed: int = 0
    calibrated: bool = True
    """Whether the decoder is calibrated on each build."""


@dataclass(frozen=True)
class Share:
    """A measured yield."""

    value: float
    low: float
    high: float
    """Its 95 % interval."""


@dataclass(frozen=True)
class LimitShare:
    """One limit alone."""

    label: str
    low: float
    high: float
    """Infinite where there is none."""
    share: Share


@dataclass(frozen=True)
class Offender:
    """What one tolerance alone, at its end, does."""

    place: str
    """Where in the design, in words."""
    tolerance: str
    """Half-width with its unit."""
    used: float
    """Largest part of the way from nominal to any limit; above 1 it breaks the limit by itself, inf where the build
    loses a number that is limited."""
    limited_by: str


@dataclass(frozen=True)
class Spread:
    """Scatter of one limited number over the builds."""

    label: str
    nominal: float
    deviation: float
    """Standard deviation; NaN where some builds lack the number."""
    low: float
    high: float
    """5th and 95th percentile."""
    limit_low: float
    limit_high: float


@dataclass(frozen=True)
class ToleranceResult:
    """What was found."""

    grade: str
    trials: int
    share: Share
    limits: tuple[LimitShare, ...]
    offenders: tuple[Offender, ...]
    """Worst first."""
    spreads: tuple[Spread, ...]
    grades: tuple[tuple[str, Share], ...]
    curve: tuple[tuple[float, Share], ...]
    """Yield over a common factor on all tolerances."""
    question: str
    """The limits in words."""


def start(request: ToleranceRequest) -> Job[ToleranceResult]:
    """Run it in a process of its own."""
    return Job(run, request)


def run(request: ToleranceRequest, tell: Tell = lambda share, text: None) -> ToleranceResult:
    """Run it here.

    Raises
    ------
    InputError
        The grade is not known, or does not suit the design.
    """
    from ..report.quick_tolerances import quick_study
    from ..report.studies import tolerance_plan
    from ..tolerance.analyses import summarise, yield_at
    from ..tolerance.run import tally_chunk
    from ..tolerance.study import make_plan
    from ..tolerance.tally import merged

    design = request.design
    trials = request.trials or (TRIALS if design.lens is None else TRIALS_TRACED)
    tell(None, "limits and tolerances")
    data: dict[str, Any] = quick_study(design, request.seed) | {"grade": request.grade, "trials": trials}
    if not request.calibrated:
        data["compensators"] = []
    plan, study, grades = tolerance_plan(data, design)
    few = min(trials, CURVE_TRIALS)
    # In builds: the run itself, then one run of fewer for each point.
    total, done = trials + few * (len(SCALES) + len(grades.names) + 1), 0
    tallies = []
    for index in range(plan.chunks):
        tell(done / total, f"{done} of {trials} builds")
        tallies.append(tally_chunk(plan, index))
        done += plan.chunk_trials(index)
    variant = summarise(plan, merged(tallies))[-1]
    tell(done / total, "one tolerance after the other")
    offenders = tuple(_offenders(plan))
    done += few
    by_grade = []
    for name in grades.names:
        tell(done / total, f"grade {name}")
        other = make_plan(study.model_copy(update={"grade": name}), plan.question.design, grades)
        by_grade.append((name, _share(yield_at(other, 1.0, few))))
        done += few
    curve = []
    for scale in SCALES:
        tell(done / total, f"all tolerances times {scale:g}")
        curve.append((scale, _share(yield_at(plan, scale, few))))
        done += few
    return ToleranceResult(
        grade=request.grade,
        trials=trials,
        share=_share(variant.result),
        limits=tuple(LimitShare(_label(l.label), l.low, l.high, _share(l.result)) for l in variant.limits),
        offenders=offenders,
        spreads=tuple(_spreads(plan, variant)),
        grades=tuple(by_grade),
        curve=tuple(curve),
        question=_question(request, study, trials),
    )


def _label(column: str) -> str:
    """A column in words, its field by name: ``fill_factor@2``."""
    from ..report.words import in_words

    name, _, number = column.partition("@")
    return f"{in_words(name)}, {FIELDS[int(number)]}" if number else in_words(name)


def _place(dotted: str) -> str:
    """A place of the design in words: ``main_lens.tilt.1``."""
    words = dotted.replace("_", " ").split(".")
    if words[-1] in AXES and len(words) > 1 and words[-2] in ("decentre", "tilt"):
        words[-1] = AXES[words[-1]]
    return " ".join(words)


def _share(found: Any) -> Share:
    return Share(found.value, *found.interval)


def _question(request: ToleranceRequest, study: Study, trials: int) -> str:
    from ..report.quick_tolerances import CENTRE, DEPTH, FILL, KEPT

    decoder = "calibrated on each build" if request.calibrated else "as designed"
    return (
        f"{trials} builds to the grade '{study.grade}', the decoder {decoder}. A build is good where its fill factor "
        f"stays within {100 * FILL:g} % of nominal, its depth spread grows by {100 * DEPTH:g} % at most, no field "
        f"loses more than {100 * KEPT:g} % of its light, and image centres are found to {CENTRE:g} px."
    )


def _offenders(plan: Plan) -> Iterator[Offender]:
    """Every tolerance by what it alone uses of the limits, worst first."""
    import numpy as np

    from ..design.units import format_quantity
    from ..tolerance.analyses import sensitivity
    from ..tolerance.places import perturbable

    found, nominal = sensitivity(plan), plan.nominal
    kinds = perturbable(plan.question.design)
    ends = np.stack([found.plus[-1], found.minus[-1]])
    rows = []
    for index, p in enumerate(plan.draws.perturbations):
        used, worst = 0.0, ""
        for limit in plan.limits:
            here, label = float(nominal[limit.column]), plan.columns[limit.column].label
            for edge, sign in ((limit.high, 1.0), (limit.low, -1.0)):
                way = sign * (edge - here)
                if not math.isfinite(way):
                    continue
                move = float(np.max(sign * ends[:, limit.column, index]))
                part = math.inf if math.isnan(move) else move / way if way > 0 else math.inf if move > 0 else 0.0
                if part > used:
                    used, worst = part, label
        kind = kinds[p.place]
        told = (
            format_quantity(float(f"{p.tolerance:.3g}"), kind) if kind in ("length", "angle") else f"{p.tolerance:.3g}"
        )
        rows.append(Offender(_place(p.place), told, used, _label(worst)))
    yield from sorted(rows, key=lambda row: -row.used)


def _spreads(plan: Plan, variant: Any) -> Iterator[Spread]:

    columns = {column.label: column for column in variant.distributions}
    for limit in variant.limits:
        column = columns[limit.label]
        at = dict(zip(column.probabilities, column.quantiles, strict=True))
        yield Spread(_label(limit.label), column.nominal, column.deviation, at[0.05], at[0.95], limit.low, limit.high)
