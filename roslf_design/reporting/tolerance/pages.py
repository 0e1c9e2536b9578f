"""A tolerance study as a page and as a section of a design's report; the terminal shares its words and pictures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import words
from ...bore.chain import COLLIDE
from ...camera import Camera
from ...design import Design
from ...drawing.picture import Picture
from ...evaluation.required import OUTCOMES, Requirement, outcome_of, outcomes_words
from ...evaluation.result import MARKS as VERDICT_MARKS
from ...fates import ImageFate
from ...tables import Column
from ...theory.depth_budget import DepthBudget
from ...theory.field_of_view import focus_ahead
from ...theory.quantities import in_words
from ...theory.quantity import finite
from ...theory.tube import WIDTHS, unsaid_bore
from ...tolerancing.budgets import Change, ToleranceBudget
from ...tolerancing.clearances import Missed, tight_clearances
from ...tolerancing.draws import Perturbation
from ...tolerancing.metrics import DISTANT, METRICS, focus_shown, mount_of
from ...tolerancing.places import CALIBRATION, LEFT, display, perturbable, short_name
from ...tolerancing.result import (
    KNOWN_LENGTHS,
    MANY,
    AdjusterUse,
    StudyResult,
    WorstTrial,
    asked_ends,
    culprit_of,
    of_builds,
    own_limit,
    reach_of,
    share_that_meets,
)
from ...tolerancing.study import OWN, VIEWS, TolerancePlan
from ...tolerancing.summaries import ColumnSummary, Variant, correlations, summarise
from ...tolerancing.tally import Tally
from ...tolerancing.traced import fates
from ...tolerancing.yields import Yield
from ..blocks import (
    Block,
    Bullets,
    Code,
    Figure,
    Finding,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
    Tone,
)
from .pictures import Yields, distributions, ranked_correlations, ranked_moves, yield_bars, yield_curve

TOP = 12
"""Rows of a ranking."""
MOST = 14
"""Bars that a ranking shows."""
AT_LIMIT = 0.1
"""Distance from a limit, over the scatter of builds, within which the nominal design lies at it."""
LOOSE = 0.1
"""Share of a length above which its tolerance is told."""
LOOSER = "A grade knows no sizes: give such a length a tolerance of its own in [[perturb]]."
"""Remedy of that, where it is a grade's."""
KNOWN = ", lengths known"
"""Addition to a limit on depth, expected, of builds."""
EXACTLY = (
    "Calibrated: without error. With those of a calibration `roslf datasheet --calibration` of the study tells depth, "
    "by captures alone `roslf calibrate --plan`."
)
"""Words on errors that a study's calibration of each build has not."""
TONES: dict[str, Tone] = {"met": "good", "marginal": "caution", "missed": "bad"}
"""Tone of a yield, by its outcome."""
MOST_FAULTS, MOST_WAYS = 4, 2
"""Reasons why builds cannot be put together that a sentence names."""
AIMS = {"focus": "focus at assembly", "limits": "adjust"}
SETTINGS = {
    ("microlens_array.distance", "focus"): "focus the array at assembly",
    ("microlens_array.distance", "limits"): "set the array where the limits hold best",
    ("sensor.distance", "limits"): "focus the sensor behind the array",
}
"""Adjustments by what a lens maker calls them."""
TOLERANCE_WIDTHS = {
    "parameter": 7.5, "± tolerance": 6, "puts together [%]": 4.5, "r² [%]": 3.5, "alone up to": 7.5,
    "until it fails": 10, "shared budget": 6.5, "for the target yield": 6,
}  # fmt: skip
"""Widths of the columns of tolerances; their sources have the rest."""
MOST_ROWS = 15
"""Tolerances that a table shows."""
MOVES = 0.05
"""Share of a limited number's variance from which on a part is said to move it."""
MOSTLY = 0.5
"""Share from which on it is named before all tolerances together."""
MOST_CHANGES = 8
"""Changes that a table shows."""
QUANTILES = 5
"""Columns of quantiles that fit on a page; the rest is in the results' file."""
MOST_RATIO = 1e3
"""Above it the root sum of squares is noise of rounding."""
FIGURES = {
    "yield": (
        "Yield over tolerance",
        "Share of builds that hold all limits, over a common factor on all tolerances; same draws.",
    ),
    "grades": (
        "What a grade buys",
        "The same study with every graded tolerance at each grade; bars show 95 % intervals.",
    ),
    "spread": (
        "Spread of the weakest metric",
        "The {weakest}: as built, and after adjustment where anything is adjusted. Dashed: nominal.",
    ),
    "sensitivity": (
        "Sensitivity of the weakest metric",
        "One miss at a time: change of {weakest} at both ends of its tolerance{adjusted}.",
    ),
    "correlation": (
        "Correlation with the weakest metric",
        "Over all trials, finally: {weakest}. Grey: what chance alone gives in 95 % of cases.",
    ),
}
"""Title and caption of each picture."""
number = partial(words.number, digits=4, zero=1e-9)


def tolerance_report(result: StudyResult, command: str) -> Report:
    """A study as a page of its own."""
    plan = result.plan
    return Report(f"Tolerances of {plan.question.design.name}", plan.name, (_tolerance_section(result, command),))


def _tolerance_section(result: StudyResult, command: str = "", *, first_look: bool = False) -> Section:
    """A study as a section of a report; the command that reruns it is printed where given."""
    blocks: list[Block] = [Paragraph(result.study.question)] if result.study.question else []
    limits, *others = tables(result)
    answer = replace(_yield_statement(result, first_look=first_look), remedy="")
    head = answer if first_look else replace(answer, text=f"{headline(result)}.")  # the table tells the rest
    blocks += [Statements((head,)), limits, Statements((*statements(result, first_look), *_known_to(result)))]
    weakest, adjusted = in_words(result.final.weakest.label), ", after adjustment" if len(result.variants) > 1 else ""
    for name, picture in tolerance_pictures(result).items():
        title, caption = FIGURES[name]
        if name == "sensitivity" and (lost := _ends_lost(result)):
            caption += f" No bar at an end where the build has no such number: {', '.join(lost)}."
        told = caption.format(weakest=weakest, adjusted=adjusted)
        drawn = Figure.of(f"tolerance-{name}", title, told, picture) if picture.panels else Paragraph(picture.title)
        blocks.append(drawn)
    blocks += [_worded(table) for table in others]
    if result.warnings:
        blocks.append(Bullets(tuple(in_words(warning) for warning in result.warnings)))
    if command:
        blocks.append(Code(command, "Run again"))
    return Section(f"Tolerances: {result.plan.name}", tuple(blocks), f"tolerance-{result.plan.name}".replace(" ", "-"))


def tolerance_finding(result: StudyResult, *, first_look: bool = False) -> Finding:
    """A study in a design's report; of default limits, which nobody asked for, no verdict in the summary."""
    plan = result.plan
    title = "Default tolerances and limits" if first_look else "Tolerances and yield"
    section = Section(title, _tolerance_section(result, first_look=first_look).blocks, "tolerances")
    about = f"{plan.name}; design: {plan.question.design.name}"
    said = None if first_look else replace(_yield_statement(result, about), lead=0)  # among other verdicts
    return Finding(section, said, f"Seed of the {plan.trials:,} builds: {plan.draws.seed}.")


def headline(result: StudyResult, judged: bool = True) -> str:
    """Yield of everything required, with its interval and its builds; `judged`: its outcome and target, too."""
    all_of_it, own = result.together, result.final.result
    plan = result.plan
    adjusted = "" if len(result.variants) == 1 else f" ({100 * result.variants[0].result.value:.2f} % as built"
    limited = any(plan.columns[limit.column].metric == "depth_error_mm" for limit in plan.limits)
    if limited and CALIBRATION in plan.perfect:
        adjusted += "; as if calibration left no error of depth: its `error` states what it leaves"
    adjusted += ")" * bool(adjusted)
    of = f"{all_of_it.trials:,} Monte Carlo units (builds), seed {plan.draws.seed}"
    if all_of_it != own:
        alone = f"{100 * own.value:.2f} %{adjusted} of {own.trials:,}"
        of, adjusted = f"the first {of}, by everything required; by the study's own limits {alone}", ""
    return f"{_yield_words(result, judged)}. 95 % interval {interval_words(all_of_it)} %{adjusted}, of {of}"


def _yield_words(result: StudyResult, judged: bool) -> str:
    share, target = result.together.value, result.study.yield_target
    verdict = f": {outcome_of(share, target)} (target yield {100 * target:.4g} %)" if judged else ""
    missed = [
        f"{one.label} is {'not known' if one.untold else f'missed: {one.value_words} against {one.limits}'}"
        for one in _missed_beside(result)
    ]
    return f"Yield {100 * share:.2f} %{verdict}" + (f", and {words.listed(missed)}" if missed else "")


def _beside(result: StudyResult) -> list[Requirement]:
    """Requirements that are judged over builds as a whole, and that the yield does not count."""
    return [one for one in result.required if not (of_builds(one) or own_limit(result.plan, result.final, one))]


def _missed_beside(result: StudyResult) -> list[Requirement]:
    return [one for one in _beside(result) if not one.met]


def limits_words(variant: Variant) -> str:
    """Limits that a yield is by, in words, once a quantity where its fields have the same."""
    columns = {column.label: column.column for column in variant.distributions}
    edges: dict[tuple[str, str], set[tuple[float, float]]] = {}
    for limit in variant.limits:
        column = columns[limit.label]
        where = "" if column.at is None else f" at {number(column.at)} mm"
        what = in_words(column.quantity.name) + where, column.quantity.unit
        edges.setdefault(what, set()).add((limit.low, limit.high))
    told = []
    for (name, unit), each in edges.items():
        told.append(f"{name} by place" if len(each) > 1 else f"{name} {_ends_words(*each.pop(), unit)}")
    return f"limits: {', '.join(told)}"


def _ends_words(low: float, high: float, unit: str) -> str:
    """Ends of a limit in words."""
    within = f"{number(low)} to {number(high)}"
    if not math.isfinite(low) or not math.isfinite(high):
        within = f"at most {number(high)}" if math.isfinite(high) else f"at least {number(low)}"
    return f"{within} {unit}".rstrip()


def depth_sentence(budget: DepthBudget | None, plan: TolerancePlan) -> str:
    """Sentence on the depth that a build measures if nobody calibrates it, and what adjustments are for."""
    if budget is None:
        return "Microlenses are focused on the scene, not on the pupil: depth from views does not apply."
    design = plan.question.design
    where = f"in the focal plane, {number(_focus(design))} mm ahead"
    text = (
        f"Depth, expected, uncalibrated: {budget.words}, {where}{focus_words(plan)}. Believe it until a camera is "
        "calibrated, then that of its calibration (`roslf calibrate --plan`)."
    )
    if not (searched := plan.adjusters_to_limits):
        return text
    adjusted = words.listed([short_name(adjuster.place, design) for adjuster in searched])
    return f"{text} The study adjusts {adjusted} to its limits{', not to the focus' * (searched == plan.adjusters)}."


def focus_words(plan: TolerancePlan) -> str:
    """Words on whether, and how well, each build is focused, after a comma; empty where its `error` says how well."""
    focused = any(adjuster.aim == "focus" for adjuster in plan.adjusters)
    return set_words(plan) + ", not focused at assembly" * (not focused)


def set_words(plan: TolerancePlan) -> str:
    """Words on parts of which nobody says how well they are set on each build, after a comma; empty where none is."""
    design, told = plan.question.design, list[str]()
    if perfect := [short_name(place, design) for place in plan.perfect if place != CALIBRATION]:
        told = [f", {words.listed(perfect)} set without error (`error` of a compensator states what it leaves)"]
    for p in plan.draws.perturbations:
        if p.source == VIEWS:
            place = p.place.removeprefix(LEFT)
            ahead, _ = focus_shown(plan.question, place)
            told.append(
                f", focused to ± {words.number(ahead, 3)} mm, {VIEWS} ({short_name(place, design)} to "
                f"± {display(p.tolerance, 'length')}; state its `error`)"
            )
    return "".join(told)


def _focused_as(plan: TolerancePlan) -> str:
    """Condition of U where its focus is set as finely as views show it, after a comma; empty where it is not."""
    shown = [p for p in plan.draws.perturbations if p.source == VIEWS]
    return "".join(
        f", if {short_name(p.place, plan.question.design)} within ± {display(p.tolerance, 'length')}" for p in shown
    )


def _travel_words(result: StudyResult, use: AdjusterUse) -> str:
    """Sentence on how far an adjuster moves, and in how many builds it rests at the end of its range."""
    design, one, trials = result.plan.question.design, use.adjuster, result.plan.trials
    aim = "to the focus" if one.aim == "focus" else "to where the limits hold best"
    moves = f"travel up to ± {_width(design, one.place, use.travel)}"
    if use.at_end:
        share = f"{100 * use.at_end / trials:.3g} % of them rest"
        moves = f"{share} at the end of its travel, ± {_width(design, one.place, one.reach)}"
    return words.sentence(f"{short_name(one.place, design)} is set {aim} on each of {trials:,} builds: {moves}")


def _focus(design: Design) -> float:
    """Distance of the focal plane ahead of the tip [mm]."""
    return float(focus_ahead(Camera.of(design.thin_twin)))


def impossible_words(variant: Variant) -> str:
    """How many builds are no cameras, and why; empty where all are."""
    if not variant.impossible:
        return ""

    def percent(count: int) -> str:
        return f"{100 * count / variant.result.trials:.3g} %"

    more = len(variant.faults) - MOST_FAULTS
    reasons = [f"{words} in {percent(count)}" for words, count in variant.faults[:MOST_FAULTS]]
    reasons += [f"{more} more reasons"] if more > 0 else []
    return f"{percent(variant.impossible)} of the builds cannot be put together: {', '.join(reasons)}."


def loose_words(plan: TolerancePlan) -> str:
    """Lengths and clearances of which tolerances take a large part; empty where there are none."""
    design = plan.question.design
    kinds = perturbable(design)
    shares = {
        p: p.tolerance / abs(p.nominal)
        for p in plan.draws.perturbations
        if kinds[p.place] == "length" and ".decentre." not in p.place and p.nominal
    }
    loose = sorted((p for p, share in shares.items() if share > LOOSE), key=lambda p: -shares[p])
    told = [
        f"{short_name(p.place, design)} = {words.length(p.nominal)} ± {display(p.tolerance, 'length')}"
        for p in loose[:MOST_FAULTS]
    ]
    told += [f"{len(loose) - MOST_FAULTS} more"] if len(loose) > MOST_FAULTS else []
    sentences = [f"Tolerances over a tenth of their lengths: {', '.join(told)}."] if told else []
    return " ".join([*sentences, *filter(None, [clearance_words(plan)])])


def clearance_words(plan: TolerancePlan) -> str:
    """Clearances, told by the faults beyond them, of which a tolerance takes over half; empty for none."""
    tight = tight_clearances(plan)
    told = []
    for fault, reached in tight[:MOST_FAULTS]:
        ways = [_off(plan.question.design, *reach) for reach in reached[:MOST_WAYS]]
        more = f", or by {len(reached) - MOST_WAYS} more" if len(reached) > MOST_WAYS else ""
        alone = "" if round(reached[0][0], 2) <= 1 else ", which no tolerance reaches alone"
        told.append(f"{fault} once {' or '.join(ways)}{more}{alone}")
    told += [f"{len(tight) - MOST_FAULTS} more"] if len(tight) > MOST_FAULTS else []
    if not told:
        return ""
    return (
        f"Tolerances over half of what the design leaves: {'; '.join(told)}. Builds that far off could not be put "
        "together and would count as failed: tighten these, or leave more."
    )


def _off(design: Design, share: float, missed: Missed) -> str:
    """Words on how far a number, or a group, is off at a fault, with its tolerance."""
    (one, reach), kind = missed[0], perturbable(design)[missed[0][0].place]
    single, size = len(missed) == 1, f"{display(reach, kind)} (± {display(one.tolerance, kind)})"
    by = f"by {size if single else f'{100 * share:.3g} % of its tolerances'}" if share else "at all, for they touch"
    return f"{short_name(one.place, design) if single else f'group {one.group}'} is off {by}"


def looser(plan: TolerancePlan) -> str:
    """Remedy of tolerances that are too wide for a length, where a grade gives them; empty where none does."""
    return LOOSER if any(one.source not in ("", OWN) for one in plan.draws.perturbations) else ""


def _yield_statement(result: StudyResult, name: str = "", first_look: bool = False) -> Statement:
    """The yield as an answer, with what would mend it; neither good nor bad by default limits."""
    text, lead = headline(result, not first_look), len(_yield_words(result, not first_look))
    if first_look:
        close = " Parts stand closer than default tolerances: have spacers made to the gap (its own [[perturb]])."
        return Statement("plain", f"{text}, by default limits, not yours.{close * _collide(result)}", lead=lead)
    beside, missed = _beside(result), _missed_beside(result)
    text += f" ({name})." if name else "."
    if beside:
        text += f" Not in it, as builds do not tell it: {words.listed([one.label for one in beside])}."
    if result.calibration is None and any(one.quantity == "u_z_mm" and not one.untold for one in missed):
        text += " Missed by a camera that nobody calibrates; of a calibrated one believe its verdict with lengths as"
        text += " calibrated."
    tone = TONES[outcome_of(result.together.value, result.study.yield_target)]
    return Statement("caution" if missed and tone == "good" else tone, text, mends(result), lead)


def mends(result: StudyResult) -> str:
    """Ways to more yield: of the nominal design where it misses limits or lies at them, else of tolerances."""
    target, remedy = result.study.yield_target, ""
    if result.final.result.value < target:
        misses = ", ".join(result.plan.nominal_misses())
        of_nominal = f"The nominal design itself misses its limits ({misses}): change the design or the limits."
        remedy = f"{of_nominal if misses else remedies(result)} {_nominal_at_limits(result)}".rstrip()
    if result.uncounted and result.together.value < min(target, result.final.result.value):
        bore = unsaid_bore(Camera.of(result.plan.question.design))
        wide = any(one.quantity in WIDTHS for one in result.uncounted)
        asked = "`required = true` in the study makes limits of all that is required and finds what holds them."
        remedy = " ".join(filter(None, [remedy, words.sentence(bore * wide), asked]))
    return in_words(remedy)


def _nominal_at_limits(result: StudyResult) -> str:
    """Words on missed limits that the nominal design lies at, with the builds that miss them; empty where none is."""
    columns = {column.label: column for column in result.final.distributions}
    at = {
        limit.label: 1 - limit.result.value
        for limit in result.final.limits
        for edge in (limit.low, limit.high)
        if abs(columns[limit.label].nominal - edge) < AT_LIMIT * columns[limit.label].deviation
        and limit.result.value < result.study.yield_target
    }
    if not at:
        return ""
    missed = words.listed([f"{label} ({100 * share:.2f} % {_of_those(result)}miss it)" for label, share in at.items()])
    tight = "tolerances, however tight, do not bring the target; " * (result.scale_for_target is None)
    return (
        f"The nominal design lies at its limits on {missed}, as an optimum does: {tight}adjust builds at assembly, or "
        "give it margin: narrower limits in `roslf optimize`, or its [robust]."
    )


def remedies(result: StudyResult) -> str:
    """Ways to bring builds to the target yield, and what was tried in vain; of a nominal design within its limits."""

    def told(change: Change) -> str:
        return f"{_change_words(result, change)} ({cost_words(change.cost)}); yield {share_words(change.result)}."

    if result.budget is not None and result.budget.changes:
        best, *others = result.budget.changes
        alone = [change for change in (best, *others) if change.kind in ("grade", "tightening")]
        if not alone:
            return f"Cheapest: {told(best)} No single tolerance reaches it, however tight."
        return f"Cheapest: {told(best)}" + ("" if best == alone[0] else f" Of one tolerance alone: {told(alone[0])}")
    remedy = "All tolerances together, down to a thousandth of what they are, do not reach it"
    if result.scale_for_target is not None:
        remedy = f"Tighten all tolerances to {result.scale_for_target[0]:.3g} of what they are"
        worst = [short_name(place, result.plan.question.design) for place, share in ranking(result)[:3] if share > 0.01]
        remedy += f"; {words.listed(worst)} count most" if worst else ""
    elif result.budget is not None:
        remedy += ", nor does one alone or an adjustment at assembly: change the nominal design or the limits"
    else:
        remedy += "; one alone and adjustments at assembly were not tried: `roslf tolerance` of a study tries them"
    adjusted = _adjustments(result)[:1]
    if adjusted and (result.focusing is None or adjusted[0].steps[0][0] != result.focusing[0].place):
        more = _change_words(result, adjusted[0])
        remedy += f". {more[:1].upper()}{more[1:]} gives {share_words(adjusted[0].result)}"
    return f"{remedy}."


def _mostly(plan: TolerancePlan, final: Variant, related: NDArray[np.float64]) -> tuple[str, float]:
    """Place that most of the weakest metric's variance is of, empty where there is none, and the share."""
    row = [column.label for column in plan.columns].index(final.weakest.label)
    share = float(np.nanmax(related[row] ** 2, initial=0.0))
    if share < MOSTLY:
        return "", share
    return plan.draws.perturbations[int(np.nanargmax(related[row] ** 2))].place, share


def measured_words(plan: TolerancePlan, tally: Tally) -> str:
    """Yield of trials before their analyses, the limit that most builds miss, and what it is mostly of."""
    final = summarise(plan, tally)[-1]
    weakest = final.weakest
    told = f"yield {share_words(final.result)}"
    if weakest.result.passed < weakest.result.trials:
        told += f"; {in_words(weakest.label)} is missed by most, {100 * (1 - weakest.result.value):.4g} %"
        place, share = _mostly(plan, final, correlations(tally))
        if place:
            told += f", mostly by {short_name(place, plan.question.design)} ({100 * share:.3g} % of its variance)"
    return f"{told}; analyses follow"


def statements(result: StudyResult, first_look: bool = False) -> Iterator[Statement]:
    """Remedies of the yield, unless it is by default limits, and what is to be known of it."""
    yield from (Statement("caution", words.sentence(text)) for text in _untraced(result))
    if not first_look and (remedy := mends(result)):
        yield Statement("plain", remedy)
    if lost := impossible_words(result.final):
        remedy = "Change nominal distances or their tolerances so that these parts keep clear."
        place, share = max(zip(_places(result), result.put_together.tolist(), strict=True), key=lambda pair: pair[1])
        if share > 0:
            remedy = (
                f"Hold {short_name(place, result.plan.question.design)} first: at its nominal it alone puts together "
                f"{100 * share:.3g} % of them. {remedy}"
            )
        if result.focusing is not None:
            focus, share = result.focusing
            aim = 'aim = "focus", ' * (focus.aim == "focus")
            remedy = (
                f'Focus each build by [[compensators]]: place = "{focus.place}", {aim}range = "{focus.reach:g} mm", '
                f"with which {100 * share:.3g} % can be put together. {remedy}"
            )
        yield Statement("caution", lost, remedy)
    if loose := loose_words(result.plan):
        yield Statement("caution", loose, looser(result.plan))
    yield Statement("plain", depth_sentence(result.depth, result.plan))
    if result.left_out:
        yield Statement("plain", in_words(result.left_out))
    for use in result.adjusters:
        enough = use.at_end <= (1 - result.study.yield_target) * result.plan.trials
        yield Statement("plain" if enough else "caution", _travel_words(result, use))
    if result.final.weakest.result.value == 1:
        weakest = in_words(result.final.weakest.label)
        whose = " of the study's own" * (result.together.value < 1)
        yield Statement(
            "plain", f"Every build {_of_those(result)}holds every limit{whose}; least margin is left to {weakest}."
        )


def _known_to(result: StudyResult) -> Iterator[Statement]:
    """Statement on how well a study knows its numbers, where it says."""
    if result.precision is not None:
        accuracy = result.precision.accuracy
        yield Statement("caution" if accuracy.kept is False else "plain", words.sentence(accuracy.sentence(False)))


def _untraced(result: StudyResult) -> Iterator[str]:
    """Words on limits that no ray through each build's lens judges, each with what to do about it."""
    plan, columns = result.plan, {column.label: column for column in result.final.distributions}
    thin = {columns[limit.label].column.metric: columns[limit.label] for limit in result.final.limits}
    for name, left_out in plan.by_formula.items():
        if name in thin:
            yield (
                f"{in_words(name)} ({number(thin[name].nominal)} nominal) is judged by the thin-lens model, which "
                f"`roslf evaluate` overrules by rays: it leaves out {left_out}"
            )
    for column in plan.by_rays:
        if column.metric in thin and column.metric in mount_of(plan.question.design).left_out:
            yield (
                f"{in_words(column.metric)} ({number(thin[column.metric].nominal)} nominal) is of rays through the "
                "nominal lens; builds change from there as their thin-lens models do, by .4 to .9 of what rays through "
                "each say behind the paper's singlet: leave it a margin, or hold non_distortion_room_mm at a field, "
                "which is traced"
            )


def _collide(result: StudyResult) -> bool:
    """Whether builds fail as parts collide."""
    return any(fault.endswith(COLLIDE) for fault, _ in result.final.faults)


def _of_those(result: StudyResult) -> str:
    """Which builds limits' yields count, where these are not all."""
    return "of those that can be put together " if any(variant.impossible for variant in result.variants) else ""


def ranking(result: StudyResult) -> list[tuple[str, float]]:
    """Perturbations and the squares of their correlations with the weakest metric, largest first.

    For independent perturbations and a nearly linear response: their shares of its variance, after adjustment.
    """
    parts = result.correlations[_weakest_row(result)] ** 2
    order = np.argsort(-parts, kind="stable")
    return [(result.plan.draws.perturbations[index].place, float(parts[index])) for index in order]


def _places(result: StudyResult) -> list[str]:
    return [p.place for p in result.plan.draws.perturbations]


def blame(result: StudyResult) -> dict[str, float]:
    """Perturbations to their shares of the builds that fail, by how these do, largest first.

    Of those that cannot be put together by what puts them together, of the others by the weakest metric's variance.
    """
    lost, final = result.final.impossible, result.final.result
    missed = max(final.trials - final.passed - lost, 0 if lost else 1)
    parts = (lost * result.put_together + missed * result.correlations[_weakest_row(result)] ** 2) / (lost + missed)
    order = np.argsort(-parts, kind="stable").tolist()
    return {_places(result)[index]: float(parts[index]) for index in order}


def _weakest_row(result: StudyResult) -> int:
    return [column.label for column in result.plan.columns].index(result.final.weakest.label)


# --- tables -----------------------------------------------------------------------------------------------------------


def tables(result: StudyResult, brief: bool = False) -> list[Table]:
    """The tables of a study; `brief`: of each metric the field that fails most often, and no sources."""
    shown = _shown(result, brief)
    made = [_limits(result), _quantiles(result, shown), _tolerances(result, brief)]
    if result.budget is not None:
        made += _budget(result, result.budget)
    made.append(_rss(result, shown))
    made += [_worst(result)] if result.worst else []
    return made if result.sobol is None else [*made, _sobol(result)]


NOBODY = ("", 0.0)
"""Culprit that is none."""


class _LimitRow(NamedTuple):
    """A row of the table of limits."""

    what: str
    asked: str
    shares: tuple[Yield | None, ...]
    """As built and, where anything is adjusted, finally; None where builds do not tell it."""
    outcome: str
    culprit: tuple[str, float] = NOBODY
    """Place, and what part it has in it."""
    without: str = ""
    """Value of the design, where builds do not tell it."""

    @classmethod
    def of(
        cls,
        what: str,
        asked: str,
        shares: Sequence[Yield | None],
        target: float,
        culprit: tuple[str, float] = ("", 0.0),
    ) -> _LimitRow:
        """Row whose last share tells its outcome."""
        share = shares[-1]
        return cls(what, asked, tuple(shares), outcome_of(0.0 if share is None else share.value, target), culprit)

    def cells(self, design: Design) -> tuple[str, ...]:
        """Row of text."""
        place, part = self.culprit
        named = part > MOVES and (self.shares[-1] is None or self.shares[-1].value < 1)
        shares = ("" if share is None else f"{100 * share.value:.2f}" for share in self.shares)
        verdict = words.clauses(f"{VERDICT_MARKS[OUTCOMES[self.outcome]]} {self.outcome}", self.without, by=": ")
        culprit = f"{short_name(place, design)} ({100 * part:.0f}\N{NO-BREAK SPACE}%)" if named else ""
        return self.what, self.asked, *shares, verdict, culprit


def _limits(result: StudyResult) -> Table:
    """All that is required: share of the builds that meets it, alone, verdict and culprit; last, all together."""
    plan, target = result.plan, result.study.yield_target
    variants = result.variants[:1] if len(result.variants) == 1 else (result.variants[0], result.final)
    shown, rows, others = _shown(result, brief=True), [*_required_rows(result, variants)], list[_LimitRow]()
    for label, row in _own_rows(result, variants):
        (rows if label in shown else others).append(row)
    rows.sort(key=lambda one: (*map(one.outcome.__eq__, OUTCOMES), one.shares[-1].value if one.shares[-1] else 0.0))
    possible = [Yield(plan.trials - variant.impossible, plan.trials) for variant in variants]
    if any(one.value < 1 for one in possible):
        most = int(result.put_together.argmax())
        culprit = _places(result)[most], float(result.put_together[most])
        rows.insert(0, _LimitRow.of("can be put together", "", possible, target, culprit))
    together: list[Yield | None] = [variant.result for variant in variants]
    if result.together != result.final.result:
        rows.append(_LimitRow.of("the study's limits together", "", together, target))
        together = [*(None for _ in variants[1:]), result.together]
    every = "everything together, of all builds" if _of_those(result) else "everything together"
    rows.append(_LimitRow.of(every, "", together, target))
    heads = tuple(f"{variant.name} [%]" for variant in variants)
    table = Table(
        tuple(one.cells(plan.question.design) for one in rows), f"ll{'d' * len(heads)}ll",
        ("limit", "required", *heads, "verdict", "culprit"), "Limits", " ".join(_on_limits(result, bool(others))),
    )  # fmt: skip
    return replace(table, left=tuple(one.cells(plan.question.design) for one in others))


def _required_rows(result: StudyResult, variants: Sequence[Variant]) -> Iterator[_LimitRow]:
    """Rows of what the design requires and the study does not limit just so."""
    plan, before = result.plan, [None for _ in variants[1:]]
    for one in result.required:
        if own_limit(plan, result.final, one) is not None:
            continue
        low, high = (one.coverage * end for end in asked_ends(one))
        asked = _ends_words(low, high, one.unit)
        if (share := share_that_meets(plan, result.final, one)) is None:
            known = "uncalibrated" if result.calibration is None else "calibrated"
            bare = f", {known}{_focused_as(plan)}" * (one.quantity == "u_z_mm")
            outcome = "met" if one.met else "not known" if one.untold else "missed"
            yield _LimitRow(one.label, asked, (*before, None), outcome, without=f"{one.value_words}{bare}")
        else:
            target = result.study.yield_target
            yield _LimitRow.of(one.label, asked, (*before, share), target, culprit_of(plan, one))


def _own_rows(result: StudyResult, variants: Sequence[Variant]) -> Iterator[tuple[str, _LimitRow]]:
    """Rows of the study's own limits, each with its column's label."""
    columns = [column.label for column in result.plan.columns]
    for index, limit in enumerate(result.final.limits):
        row = columns.index(limit.label)
        column, parts = result.plan.columns[row], result.correlations[row] ** 2
        what = in_words(limit.label) + KNOWN * (column.metric in KNOWN_LENGTHS)
        asked = _ends_words(limit.low, limit.high, column.quantity.unit)
        culprit = _places(result)[int(parts.argmax())], float(parts.max())
        shares = [variant.limits[index].result for variant in variants]
        yield limit.label, _LimitRow.of(what, asked, shares, result.study.yield_target, culprit)


def _on_limits(result: StudyResult, more: bool) -> Iterator[str]:
    """Sentences below the table of limits, whose file has `more` rows."""
    plan = result.plan
    count = f"Each alone, of {plan.trials:,} builds" + (", of those that can be put together" * bool(_of_those(result)))
    if result.uncounted:
        count += f"; what no limit of the study holds, of the first {min(MANY, plan.trials):,}"
    yield f"{count}. {outcomes_words(result.study.yield_target)}"
    yield "Culprit: the tolerance with the largest part in its variance (r²)."
    if more:
        yield "Of each the weakest field; all are in tables/limits.csv."
    limited = {plan.columns[limit.column].metric for limit in plan.limits}
    if limited & set(KNOWN_LENGTHS):
        yield "Lengths known: each build's own are taken as known, as if calibrated without error."
    if "depth_error_mm" in limited:
        yield "Depth error is of lengths alone: of a measured depth believe depth, expected."
    if plan.calibrated:
        yield EXACTLY
    if places := ", ".join(f"{index} ({words.place(x_ml, 3)})" for index, x_ml in enumerate(plan.question.fields)):
        yield f"Fields, by the position of their microlens [mm]: {places}."


NO_SHAPE: dict[int, str] = {ImageFate.FOLDED: "folded at this field", ImageFate.DARK: "no light at this field"}
"""Words for a number that a microlens image has not."""


def _nominal(result: StudyResult, summary: ColumnSummary) -> str:
    """Nominal value in words; behind a real lens why there is none."""
    question, field = result.plan.question, summary.column.field
    if field is None or not result.tracing or not math.isnan(summary.nominal):
        return number(summary.nominal)
    return NO_SHAPE.get(int(fates(question.design, question.fields[field : field + 1])[0]), number(summary.nominal))


def _quantiles(result: StudyResult, shown: set[str]) -> Table:
    """Nominal value, mean, spread and quantiles of every metric, finally."""
    final = result.final.distributions
    probabilities = final[0].probabilities
    # The outer ones, the middle, and evenly between.
    steps = range(QUANTILES) if len(probabilities) else ()
    places = sorted({round(i * (len(probabilities) - 1) / (QUANTILES - 1)) for i in steps})
    undefined = any(column.undefined for column in final)
    rows = tuple(
        (
            column.label,
            *(_nominal(result, column), _within(column.mean, column.deviation), number(column.deviation)),
            *(_within(column.quantiles[index], column.deviation) for index in places),
            *((str(column.undefined),) if undefined else ()),
        )
        for column in final
        if column.label in shown
    )
    caption = ["Of the builds that can be put together."] if _of_those(result) else []
    if undefined:
        caption += [
            "Undefined trials count as failures; quantiles rank them worst, mean and spread are then not stated."
        ]
    if twins := [label for label in result.plan.of_thin_twins if label in shown]:
        caption += [f"Of the thin-lens model, nominal, too, not of rays: {in_words(', '.join(twins))}."]
    if any(column.infinite for column in final):
        caption += ["What is infinite ranks above all; mean and spread are then not stated."]
    quantiles = (f"{100 * probabilities[index]:.4g} %" for index in places)
    heads = ("metric@field", "nominal", "mean", "std. dev.", *quantiles, *(("undefined",) if undefined else ()))
    title = f"Distributions, {result.final.name}"
    return Table(rows, "l" + "r" * (len(heads) - 1), heads, title, " ".join(caption))


def _tolerances(result: StudyResult, brief: bool) -> Table:
    """Every perturbation: its tolerance, what it may be alone, what the target yield asks, where it comes from."""
    design = result.plan.question.design
    kinds = perturbable(design)
    allowed = {a.place: a for a in result.allowed}
    scale = None if result.scale_for_target is None else result.scale_for_target[0]
    shares, order = dict(ranking(result)), list(blame(result))
    together = dict(zip(_places(result), result.put_together.tolist(), strict=True))

    def own(value: str, p: Perturbation) -> str:
        if p.place not in allowed:
            return ""
        width, reach = getattr(allowed[p.place], value), reach_of(p, kinds[p.place])
        over = math.isinf(width) and math.isfinite(reach)
        return f"over {display(reach, kinds[p.place])}" if over else display(width, kinds[p.place])

    grade = result.study.grade
    source: Column = ("source", "l", lambda p: p.source.split(";")[0].removeprefix(f"{grade}: "))
    columns: tuple[Column, ...] = (
        ("parameter", "l", lambda p: short_name(p.place, design)),
        ("± tolerance", "r", lambda p: display(p.tolerance, kinds[p.place])),
        *((("puts together [%]", "r", lambda p: f"{100 * together[p.place]:.1f}"),) if result.final.impossible else ()),
        ("r² [%]", "d", lambda p: f"{100 * shares.get(p.place, 0.0):.1f}"),
        ("alone up to", "r", lambda p: own("alone", p)),
        ("until it fails", "l", lambda p: allowed[p.place].alone_limited_by if p.place in allowed else ""),
        ("shared budget", "r", lambda p: own("tolerance", p)),
        *((("for the target yield", "r", lambda p: display(p.tolerance * scale, kinds[p.place])),) if scale else ()),
    )
    share = "1/sqrt(n)" if result.study.share == "rss" else "1/n"
    caption = (
        "r²: squared correlation with the weakest metric, 0 of what moves it alike both ways, as a decentre does (its "
        "Sobol indices count that). Alone up to: where, all else nominal, the first goal fails, "
        "or the build cannot be put together; looked for within a tenth of a length, 0.1 rad of an angle, "
        "temperatures that cameras meet, and the tolerance given. "
        f"Shared budget: what uses {share} of each limit's margin, n = {len(shares)} parameters."
        f"{' For the target yield: all tolerances scaled by one factor.' if scale else ''}"
        f"{f' Source: of the grade {grade}, or this study.' if grade and not brief else ''}"
    )
    if result.final.impossible:
        caption = (
            "Puts together: share of the builds that cannot be put together that can once this alone is at its "
            f"nominal; it ranks with r², each for the builds that fail its way. {caption}"
        )
    ranked = sorted(result.plan.draws.perturbations, key=lambda p: order.index(p.place))
    shown = columns if brief else (*columns, source)
    table = Table.of(ranked, shown, "Tolerances", caption)
    if not brief:
        table = replace(table, widths=tuple(TOLERANCE_WIDTHS.get(heading, 0) for heading, *_ in shown), dense=True)
    if len(ranked) > MOST_ROWS:
        caption = f"The {MOST_ROWS} that matter most of {len(ranked)}; all are in tables/tolerances.csv. {caption}"
        return replace(table, rows=table.rows[:MOST_ROWS], left=table.rows[MOST_ROWS:], caption=caption)
    return table


def _budget(result: StudyResult, budget: ToleranceBudget) -> Iterator[Table]:
    """Tables of changes that reach the target yield, cheapest first, and of tolerances to relax."""
    design = result.plan.question.design
    columns: tuple[Column, ...] = (
        ("change", "l", lambda change: _change_words(result, change)),
        ("cost", "d", lambda change: _cost(change.cost)),
        ("yield [%]", "d", lambda change: f"{100 * change.result.value:.2f}"),
        ("95 % interval [%]", "r", lambda change: interval_words(change.result)),
        ("of builds", "r", lambda change: f"{change.result.trials:,}"),
    )
    if budget.changes:
        caption = (
            f"What reaches {100 * budget.target:.4g} % for sure, cheapest first: with all of the yield's interval, on "
            "builds that it was not found by. "
            "Cost: more than now, in the unit of the grades' file (as shipped, 1 is the part in its loosest grade); a "
            "tolerance between two grades by its logarithm."
        )
        yield Table.of(budget.changes[:MOST_CHANGES], columns, "Changes that reach the target yield", caption)
    if adjusted := _adjustments(result):
        caption = (
            "One more adjustment of each build, all tolerances as they are, whether or not it is enough by itself."
        )
        yield Table.of(adjusted, columns, "What an adjustment at assembly would do", caption)
    if budget.looser:
        shown: tuple[Column, ...] = (
            ("parameter", "l", lambda part: short_name(part.place, design)),
            ("± now", "r", lambda part: _width(design, part.place, part.given)),
            ("may be ±", "r", lambda part: _width(design, part.place, part.tolerance)),
            ("grade", "l", lambda part: part.grade),
            ("saves", "d", lambda part: "not known" if part.saved is None else f"{part.saved:.2f}"),
        )
        after = "after the cheapest change, " if budget.changes else ""
        caption = (
            f"All together, {after}a yield of {share_words(budget.result)}"
            + ("" if budget.cost is None else f"; changes and savings together, it {cost_words(budget.cost)}")
            + ". Saves: of the part's cost, in that unit (as shipped, 1 is its loosest grade). None "
            "alone lets the f-number be matched no more (`roslf evaluate`)."
        )
        yield Table.of(budget.looser, shown, "Tolerances to relax", caption)


def _adjustments(result: StudyResult) -> tuple[Change, ...]:
    """Adjustments that the study does not ask for and that save builds, best first."""
    now = result.final.result.interval[1]
    return tuple(c for c in (result.budget.adjustments if result.budget else ()) if c.result.value > now)


def _worst(result: StudyResult) -> Table:
    """The worst trials: their files, what misses most in them, and why they fail; where none does, the nearest."""
    design, limits = result.plan.question.design, result.final.limits
    quantities = {column.label: column.quantity for column in result.plan.columns}

    def collides(place: str, faults: str) -> bool:
        part = "FAP" if place.startswith("aperture.") else short_name(place, design).rpartition(" ")[0]
        return (
            place.endswith((".distance", ".thickness"))
            and part != ""
            and bool(re.search(rf"\b{re.escape(part)}\b", faults))
        )

    def missing(trial: WorstTrial) -> str:
        faults = "; ".join(fault for fault in trial.faults if fault.endswith(COLLIDE))
        parts = [place for place in trial.misses if collides(place, faults)] or trial.misses
        largest = sorted(parts, key=lambda place: -abs(trial.misses[place]))[:MOST_FAULTS]
        return ", ".join(f"{short_name(place, design)} {trial.misses[place]:+.2g}" for place in largest)

    def missed(trial: WorstTrial) -> dict[str, float]:
        values = {limit: trial.values[limit.label] for limit in limits}
        return {l.label: v for l, v in values.items() if not quantities[l.label].within(l.low, l.high, v)}

    def why(trial: WorstTrial) -> str:
        if trial.faults:
            return f"no design: {'; '.join(trial.faults)}"
        return ", ".join(f"{label} {number(value)}" for label, value in [*missed(trial).items()][:MOST_FAULTS])

    trial: Column = ("trial", "r", lambda trial: str(trial.number))
    failed = [trial for trial in result.worst if trial.faults or missed(trial)]
    if not failed:
        columns: tuple[Column, ...] = (trial, ("farthest off [tolerances]", "l", missing))
        caption = "None misses a limit. Every number of each is in results.json."
        return Table.of(result.worst, columns, "Builds nearest to a limit", caption)
    columns = (
        trial,
        ("misses most [tolerances]", "l", missing),
        ("why", "l", why),
        ("file", "l", lambda trial: trial.file or "none"),
    )
    return Table.of(failed, columns, "Worst trials", "Every number of each is in results.json and its file.")


def _change_words(result: StudyResult, change: Change) -> str:
    """A change as one would ask a shop for it."""
    design = result.plan.question.design
    if change.kind == "all tolerances":
        assert result.scale_for_target is not None
        return f"all tolerances times {result.scale_for_target[0]:.3g}"
    said = []
    for place, grade, to in change.steps:
        name = "calibration of each build" if place == CALIBRATION else short_name(place, design)
        if change.kind == "adjustment":
            said.append(
                f"{SETTINGS.get((place, change.aim or ''), AIMS[change.aim or 'limits'])}: {name}"
                + (f", {'travel ' * (change.aim == 'focus')}± {_width(design, place, to)}" if math.isfinite(to) else "")
            )
        else:
            said.append(f"{name} to ± {_width(design, place, to)}" + (f" ({grade})" if grade else ""))
    return "; ".join(said)


def _width(design: Design, place: str, value: float) -> str:
    """A half-width at a place, which may lack its axis."""
    kinds = perturbable(design)
    return display(value, kinds.get(place) or kinds[f"{place}.0"])


def share_words(measured: Yield) -> str:
    """A yield with its interval, and of how many builds."""
    return f"{100 * measured.value:.2f} % ({interval_words(measured)} %) of {measured.trials:,} builds"


def interval_words(measured: Yield) -> str:
    """Interval of a yield [%], with as many decimals as tell its ends apart."""
    low, high = (100 * end for end in measured.interval)
    decimals = next((n for n in (2, 3, 4) if f"{low:.{n}f}" != f"{high:.{n}f}"), 2)
    return f"{low:.{decimals}f} to {high:.{decimals}f}"


def _within(value: float, deviation: float) -> str:
    """A number without the digits that its own spread drowns."""
    if not 0 < deviation < math.inf:
        return number(value)
    text = words.rounded(value, deviation / 10)
    short = number(float(text))
    return text if "e-" in short else short


def cost_words(cost: float | None) -> str:
    """A change of cost in words."""
    if cost is None:
        return "cost not known"
    return f"costs {abs(cost):.2f} {'less' if cost < 0 else 'more'} than now, in the unit of the grades' file"


def _cost(cost: float | None) -> str:
    return "not known" if cost is None else f"{cost:+.2f}"


def _rss(result: StudyResult, shown: set[str]) -> Table:
    """Root sum of squares beside Monte Carlo."""
    columns: tuple[Column, ...] = (
        ("metric@field", "l", lambda row: row.column),
        ("RSS", "d", lambda row: number(row.rss, zero=row.monte_carlo / MOST_RATIO or 1e-9)),
        ("Monte Carlo", "d", lambda row: number(row.monte_carlo)),
        # A spread that is no first-order effect has no ratio worth its digits.
        ("ratio", "d", lambda row: number(row.ratio) if row.ratio <= MOST_RATIO else "none"),
        ("mean shift", "d", lambda row: _within(row.mean_shift, row.monte_carlo)),
        ("linear", "l", lambda row: "yes" if row.linear else "no: use Monte Carlo"),
    )
    title = "Standard deviations as built: RSS beside Monte Carlo"
    return Table.of((row for row in result.rss if row.column in shown), columns, title)


def _sobol(result: StudyResult) -> Table:
    """Sobol indices of the weakest metric, ranked by total index."""
    indices = result.sobol
    assert indices is not None
    row = _weakest_row(result)
    rows: list[tuple[str, ...]] = []
    if indices.undefined_evaluations[row]:
        rows.append(
            (f"undefined in {indices.undefined_evaluations[row]} of {indices.evaluations} builds: no indices", "", "")
        )
    else:
        shares = (indices.first, indices.first_interval_95), (indices.total, indices.total_interval_95)
        for k in np.argsort(-indices.total[row], kind="stable")[:TOP]:
            numbers = [[words.fixed(one, 3) for one in (value[row, k], *ends[row, k])] for value, ends in shares]
            cells = [f"{index} ({low} to {high})" for index, low, high in numbers]
            if not any(float(one) for each in numbers for one in each):
                break  # nor any behind it
            rows.append((_factor(indices.factors[k], result.plan.question.design), *cells))
    heads = ("parameter", "first order (95 %)", "total (95 %)")
    title = f"Sobol indices of {result.final.weakest.label}, {result.final.name}"
    return Table(tuple(rows), "lrr", heads, title)


def _factor(name: str, design: Design) -> str:
    if name.startswith("group "):
        return name
    place = name.removesuffix(" (own part)")
    return short_name(place, design) + ("" if place == name else ", own part")


def _shown(result: StudyResult, brief: bool) -> set[str]:
    """Labels of all columns; `brief`: of each metric the one whose limit is the weakest, else that scatters most."""
    if not brief:
        return {column.label for column in result.plan.columns}
    final = result.final
    spread = {column.label: np.nan_to_num(column.high - column.low) for column in final.distributions}

    def weakness(label: str) -> tuple[float, float]:
        strengths = [final.strength(limit) for limit in final.limits if limit.label == label]
        return min(strengths, default=(math.inf, -spread[label]))

    worst: dict[str, str] = {}
    for column in sorted(result.plan.columns, key=lambda column: weakness(column.label)):
        worst.setdefault(column.metric if column.at is None else column.label, column.label)
    return set(worst.values())


def _worded(table: Table) -> Table:
    """For a page, where there is room: metrics in words, with their units."""
    rows, left = (
        tuple((_label(first), *(in_words(cell) for cell in rest)) for first, *rest in some)
        for some in (table.rows, table.left)
    )
    heads = tuple(heading.replace("metric@field", "metric") for heading in table.headings)
    return replace(table, rows=rows, left=left, headings=heads, title=in_words(table.title))


def _label(cell: str) -> str:
    name = cell.partition(KNOWN)[0].partition("@")[0].partition(" at ")[0]
    metric = METRICS.get(name) or DISTANT.get(name)
    return in_words(cell) + (f" [{metric.unit}]" if metric is not None and metric.unit else "")


# --- pictures ---------------------------------------------------------------------------------------------------------


def tolerance_pictures(result: StudyResult) -> dict[str, Picture]:
    """Every picture that a tolerance study has something for.

    Over the yield, the numbers of one metric: that whose limit is the weakest.
    """
    limit, row = result.final.weakest, _weakest_row(result)
    yields, target = _yields(result), result.study.yield_target
    reached = None if result.scale_for_target is None else result.scale_for_target[0]
    drawn = {"yield": yield_curve(yields, (500, 320), target, reached)}
    if result.grades:
        drawn["grades"] = yield_bars(yields, (500, 0), target)
    # As built and, where anything is adjusted, afterwards.
    variants = result.variants[:1] if len(result.variants) == 1 else (result.variants[0], result.final)
    columns = [variant.distributions[row] for variant in variants]
    # What is infinite somewhere is drawn by its twin.
    twins = any(column.infinite or math.isinf(column.nominal) for column in columns)
    told: Callable[[Any], Any] = finite if twins else np.asarray
    parts = [(v.name, told(np.array(c.cuts)), np.array(c.histogram)) for v, c in zip(variants, columns, strict=True)]
    nominal = float(told(columns[0].nominal)) if math.isfinite(told(columns[0].nominal)) else 0.0
    edges = [float(told(edge)) if math.isfinite(edge) else edge for edge in (limit.low, limit.high)]
    label = _metric(result, row) if not twins else f"-1 over {_metric(result, row, unit=False)} [1/mm]"
    drawn["spread"] = distributions(parts, nominal, [e for e in edges if math.isfinite(e)], label)
    moves = result.sensitivity
    both = (moves.twin_plus, moves.twin_minus) if twins else (moves.plus, moves.minus)
    order = _largest(np.maximum(*(np.abs(np.nan_to_num(ends[-1, row])) for ends in both)))
    plus, minus = (np.nan_to_num(ends[-1, row, order]) for ends in both)
    drawn["sensitivity"] = ranked_moves(_names(result, order), plus, minus, [e - nominal for e in edges], label)
    values, noise = result.correlations[row], 2 / math.sqrt(result.plan.trials)
    order = _largest(np.where(np.abs(values) > noise, np.abs(values), 0.0))
    bare = _metric(result, row, unit=False)
    drawn["correlation"] = ranked_correlations(_names(result, order), values[order], noise, bare)
    return drawn


def _yields(result: StudyResult) -> Yields:
    own = dict(result.grades).get(result.study.grade or "", result.final.result)
    return Yields(result.study.grade or "", own, result.grades, result.yield_curve)


def _names(result: StudyResult, order: NDArray[np.intp]) -> list[str]:
    plan = result.plan
    return [short_name(plan.draws.perturbations[index].place, plan.question.design) for index in order]


def _largest(sizes: NDArray[np.float64]) -> NDArray[np.intp]:
    """Where the largest are, in order; without those too small to be seen."""
    order = np.argsort(-sizes, kind="stable")[:MOST]
    large = order[sizes[order] > 1e-2 * sizes[order[0]]]
    return large if len(large) else order[:1]


def _ends_lost(result: StudyResult) -> list[str]:
    """Tolerances at an end of which, alone, the weakest metric is undefined."""
    lost = np.flatnonzero(np.isinf(result.sensitivity.worst[-1, _weakest_row(result)]))
    return _names(result, lost)


def _metric(result: StudyResult, row: int, unit: bool = True) -> str:
    """A column's metric and field for an axis."""
    column = result.plan.columns[row]
    metric, at = column.quantity, "" if column.at is None else f" at {words.number(column.at, 4)} mm"
    fields = result.plan.question.fields
    place = "" if column.field is None else f" at ({words.place(fields[column.field], 3)}) mm"
    return in_words(metric.name) + at + (f" [{metric.unit}]" if unit and metric.unit else "") + place
