"""Runs in the background (tolerance, optimisation, measuring): what forms ask for, the runs, what they found.

The only place that knows how studies are run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..camera import Camera
from ..depth.measure import Trial, simulate
from ..depth.pictures import PictureOptions, region_about
from ..design import Design
from ..drawing.theme import short
from ..errors import InputError, Problem
from ..optimization.study import Result
from ..reporting.blocks import Statement
from ..reporting.depth.pages import statements as depth_statements
from ..reporting.optimise.pages import statements
from ..reporting.optimise.pictures import SearchEnd, VariableMove, ends_of
from ..reporting.story import CENTRE, DEPTH, FILL, KEPT, quick_study, run_optimisation
from ..reporting.tolerance.pages import depth_sentence, impossible_words, loose_words
from ..reporting.tolerance.pictures import LimitSpread, Offender, Yields
from ..theory.depth_budget import depth_budget
from ..theory.quantities import in_words, quantity_named
from ..tolerancing.metrics import DISTANT, METRICS, Column
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
from ..words import about_time, listed, percent, to_html
from .jobs import Done, Failure, ProcessJob, Progress, Tell
from .main_lens import TRIALS, explored_lens
from .state import BY_SYMBOL, CONJUGATE, PLACES, State, fixed_conjugates, read, show

Options = Mapping[str, Sequence[str]]
"""A form as the browser sends it: every field's name with the values chosen."""

GRADES = ("commercial", "precision", "high")
"""Grades of the shipped table, from loose to tight."""
CURVE_TRIALS = 4096
"""Most builds for one point of the yield curve, and for the other grades."""
SCALES = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Factors on all tolerances at once."""


class _WantedQuantity(NamedTuple):
    """Objective: a quantity wanted of a design, or kept from getting worse."""

    label: str
    quantity: str
    side: str
    """"min" where less is better or the limit a least value, else "max"."""

    @property
    def words(self) -> str:
        """The quantity in words."""
        return in_words(self.quantity)

    @property
    def unit(self) -> str:
        """The quantity's."""
        return quantity_named(self.quantity).unit


GOALS = {
    "depth": _WantedQuantity("least depth noise (bound)", "sigma_z_mm", "min"),
    "expected": _WantedQuantity("least depth, expected", "u_z_mm", "min"),
    "field": _WantedQuantity("widest field", "field_half_width_mm", "max"),
    "light": _WantedQuantity("most light", "light_sr", "max"),
    "views": _WantedQuantity("most independent views", "views_independent", "max"),
    "sample": _WantedQuantity("finest object sample", "object_sample_mm", "min"),
    "length": _WantedQuantity("shortest instrument", "total_length_mm", "min"),
}
"""Goals by their keys, with their directions."""
VARIABLES = ("D", "f", "d_f", "d_1", "D_F", "d_3", "d", "d_2")
"""Variables that may be chosen, but for which of f, d_f and d_1 follows."""
USUAL = ("D_F", "d_3", "d_2")
"""Variables that are chosen by default."""
HELD = {
    "depth": _WantedQuantity("depth noise (bound)", "sigma_z_mm", "max"),
    "expected": _WantedQuantity("depth, expected", "u_z_mm", "max"),
    "field": _WantedQuantity("field", "field_half_width_mm", "min"),
    "views": _WantedQuantity("independent views", "views_independent", "min"),
    "pixels": _WantedQuantity("pixels across an image", "views_geometric", "min"),
    "length": _WantedQuantity("total length", "total_length_mm", "max"),
    "light": _WantedQuantity("light", "light_sr", "min"),
}
"""Quantities that may be kept from getting worse, with the side of their limit."""
GIVE = 1e-3
"""Part of a held value that may be given up, so that the design itself is inside its limits."""
REACH = 2.0
"""Bounds of a variable where nobody says otherwise, as factors of its value."""
FILLED = (0.98, 1.0)
"""Fill factor that counts as matched."""
STARTS = 8
FRONT_POINTS = 9
ACROSS = 15
"""Microlenses along each side of what is measured."""


# What the forms ask for. Each control has its name, what it is before anyone chooses, and what may be chosen.

KNOWN, RANGE = "known", "range"
SEED = {RANGE: (0, 2**32 - 1)}


@dataclass(frozen=True)
class ToleranceRequest:
    """Request for a tolerance run, as the form has it."""

    design: Design
    grade: str = field(default=GRADES[1], metadata={KNOWN: GRADES})
    trials: int = field(default=TRIALS, metadata={RANGE: (64, 1_000_000)})
    seed: int = field(default=0, metadata=SEED)
    calibrated: bool = True
    """Whether the decoder is calibrated on each build."""
    limits: tuple[MetricGoal, ...] = ()
    """Limits besides the first look's."""
    only_own: bool = False
    """Whether they stand instead of those."""


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

    def page(self) -> dict[str, Any]:
        """Values for the page."""
        share, (low, high) = self.share, self.share.interval
        return {
            "headline": f"{_percent(share.value)} of the Monte Carlo units (builds) hold every limit "
            f"(95 % interval {_percent(low)} to {_percent(high)}; {share.trials} builds)",
            "question": to_html(self.question),
            "rows": [
                {"label": to_html(label), "share": _percent(share.value)}
                for label, share in sorted(self.limits, key=lambda limit: limit[1].value)
            ],
        }


@dataclass(frozen=True)
class OptimiseRequest:
    """Request for an optimisation run, as the form has it."""

    design: Design
    goal: str = field(default="depth", metadata={KNOWN: GOALS})
    variables: tuple[str, ...] = field(default=USUAL, metadata={KNOWN: VARIABLES})
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Least and greatest value of variables [mm]; `_bounds_of` those that are not named."""
    follows: str = field(default="d_f", metadata={KNOWN: CONJUGATE})
    """Which of f, d_f and d_1 follows where one of the others varies; the third then stays."""
    in_focus: bool = True
    """Whether f_ml follows the microlenses' focus."""
    matched: bool = True
    """Whether microlens images have to fill their cells without overlap."""
    undistorted: bool = True
    """Whether no microlens image on the sensor may be cut."""
    required: bool = True
    """Whether the limits of the design's `[required]` are held, where it has any."""
    held: tuple[str, ...] = field(default=(), metadata={KNOWN: HELD})
    against: str = field(default="", metadata={KNOWN: ("", *GOALS)})
    """Another goal: what the goal costs of it is found out as well."""
    seed: int = field(default=0, metadata=SEED)

    @property
    def all_bounds(self) -> dict[str, tuple[float, float]]:
        """Least and greatest value of every variable [mm]."""
        return {s: self.bounds.get(s) or _bounds_of(self.design, s) for s in self.variables}


@dataclass(frozen=True)
class OptimiseResult:
    """Result of an optimisation run."""

    goal: _WantedQuantity
    before: float
    after: float
    """The goal's quantity, of the design asked about and of the one found."""
    changes: tuple[VariableMove, ...]
    followers: tuple[tuple[str, float, float], ...]
    """Numbers that moved with the variables: symbol, before and after [mm]."""
    design: Design | None
    """The design found; None where nothing holds all limits."""
    sentences: tuple[Statement, ...]
    ends: tuple[SearchEnd, ...]
    against: _WantedQuantity | None
    """The other goal."""
    front: tuple[tuple[float, float], ...]
    """Goal and what it is against, of designs of which none is better in both."""

    def page(self) -> dict[str, Any]:
        """Values for the page."""
        headline = "Nothing within the bounds holds all that was asked"
        if self.design is not None:
            after = f"{short(self.after, 4)} {self.goal.unit}".strip()
            headline = f"{to_html(self.goal.words)}: {short(self.before, 4)} → {after}"
        return {
            "headline": headline,
            "rows": [
                *({"label": to_html(change.symbol), "share": _moved(change)} for change in self.changes),
                *(
                    {"label": to_html(symbol), "share": f"{_from_to(symbol, before, after)} (follows)"}
                    for symbol, before, after in self.followers
                ),
            ],
            "sentences": [
                {"tone": s.tone, "text": to_html(s.text), "remedy": to_html(s.remedy)} for s in self.sentences
            ],
            "can_apply": self.design is not None,
            "front": bool(self.front),
        }


@dataclass(frozen=True)
class MeasureRequest:
    """Request for a simulated measurement, as the form has it."""

    design: Design
    place: tuple[float, float] = (0.0, 0.0)
    """Place of the microlens that is in the middle, on the array [mm]."""
    exposures: int = field(default=8, metadata={RANGE: (1, 64)})
    seed: int = field(default=0, metadata=SEED)


Request = TypeVar("Request", ToleranceRequest, OptimiseRequest, MeasureRequest)


USUAL_LIMITS = (
    f"fill factor within {100 * FILL:g} % of nominal, depth noise (bound) {100 * DEPTH:g} % more at most, no field "
    f"losing more than {100 * KEPT:g} % of its light, image centres found to {CENTRE:g} px"
)
"""The first look's limits in words."""
LIMITED = [
    {"key": name, "label": f"{metric.label} [{metric.unit}]" if metric.unit else metric.label}
    for name, metric in (METRICS | DISTANT).items()
]
"""Metrics that may be limited."""


def forms(state: State) -> dict[str, Any]:
    """Content of the forms, with what is chosen by default."""
    design = state.design
    lens = explored_lens(design)
    return {
        "grades": [{"key": grade, "chosen": grade == GRADES[1]} for grade in GRADES],
        "trials": lens.trials,
        "usual": USUAL_LIMITS,
        "limited": LIMITED,
        "asked": [
            {
                "of": asked.quantity,
                "at": "" if asked.at is None else format_quantity(asked.at, "length"),
                **{side: "" if end is None else str(end) for side, end in (("min", asked.min), ("max", asked.max))},
            }
            for asked in design.required
        ],
        "goals": [{"key": key, "label": goal.label} for key, goal in GOALS.items()],
        "variables": [_offered(s, state) for s in VARIABLES],
        "required": bool(design.required),
        "held": [{"key": key, "label": held.label} for key, held in HELD.items()],
        "lens": lens.named_apart,
        "of": state.reference.name,
    }


def _offered(symbol: str, state: State) -> dict[str, Any]:
    ends = (show(BY_SYMBOL[symbol], end) for end in _bounds_of(state.design, symbol))
    follows = symbol == state.follows
    return {
        "key": symbol,
        "label": to_html(symbol),
        "chosen": symbol in USUAL,
        "follows": follows,
        **dict(zip(("low", "high"), ends, strict=True)),
    }


def read_form(kind: type[Request], design: Design, options: Options) -> Request:
    """Request from a form's controls.

    A tick is there or not, of several boxes those that are known, one text of what may be.

    Raises
    ------
    InputError
        What is not known, a number out of range, or nothing that may vary.
    """
    values: dict[str, Any] = {}
    for control in fields(kind)[1:]:
        if control.name == "bounds":
            values["bounds"] = {symbol: _bounds(design, symbol, options) for symbol in values["variables"]}
            continue
        if control.name == "limits":
            values["limits"] = _limits(options)
            continue
        if control.name == "place":
            values["place"] = tuple(float(length) for length in options.get("place", (0, 0)))
            continue
        name, chosen = control.name, options.get(control.name, ())
        text = str(chosen[0] if chosen else control.default).strip()
        if isinstance(control.default, bool):
            values[name] = bool(chosen)
        elif isinstance(control.default, tuple):
            values[name] = tuple(key for key in control.metadata[KNOWN] if key in chosen)
        elif isinstance(control.default, int):
            values[name] = _whole(name, text, *control.metadata[RANGE])
        elif text in control.metadata[KNOWN]:
            values[name] = text
        else:
            known = ", ".join(filter(None, control.metadata[KNOWN]))
            raise InputError((Problem(name, f"'{text}' is not known; there are {known}"),))
    if values.get("only_own") and not values["limits"]:
        raise InputError((Problem("limits", "there are none; choose a quantity to limit, or let the usual ones hold"),))
    if values.get("variables") == ():
        raise InputError((Problem("may vary", "nothing is chosen; tick at least one number that may vary"),))
    if "variables" in values and values["follows"] in values["variables"]:
        message = "follows from the other two; let another one follow (at its lock), or do not vary it"
        raise InputError((Problem(values["follows"], message),))
    return kind(design, **values)


def _bounds(design: Design, symbol: str, options: Options) -> tuple[float, float]:
    ends = list(_bounds_of(design, symbol))
    for index, side in enumerate(("low", "high")):
        for text in options.get(f"{side}_{symbol}", ()):
            try:
                ends[index] = read(BY_SYMBOL[symbol], text)
            except ValueError as error:
                raise InputError((Problem(f"{symbol}, bound", str(error)),)) from None
    low, high = ends
    if not (low > 0 or (low == 0 and symbol == "d_3")) or low >= high:
        given = " to ".join(show(BY_SYMBOL[symbol], end) for end in ends)
        least = "not be negative" if symbol == "d_3" else "be above zero"
        raise InputError((Problem(f"{symbol}, bounds", f"{given}; the lower one must {least} and below the other"),))
    return low, high


def _limits(options: Options) -> tuple[MetricGoal, ...]:
    """Limits that were asked for: quantities with the ends, and the distance, beside them."""
    named = options.get("limit_of", ())
    parts = ("min", "max", "at")
    rows = zip(named, *(options.get(f"limit_{part}") or [""] * len(named) for part in parts), strict=False)
    asked = [(name, zip(parts, ends, strict=True)) for name, *ends in rows if name]
    return tuple(
        MetricGoal(metric=name, **{end: _number_or_text(text) for end, text in ends if text.strip()})
        for name, ends in asked
    )


def _number_or_text(text: str) -> float | str:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return text


def _whole(name: str, text: str, low: int, high: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = low - 1
    if not low <= value <= high:
        raise InputError((Problem(name, f"'{text}' is not a whole number from {low} to {high}"),))
    return value


# What the page shows of a run.


def summary(run: Run | None, design: Design, wrong: str = "") -> dict[str, Any]:
    """A run for the page: its state, how far it is, what it found.

    Parameters
    ----------
    run : Run, optional
        None where there was none.
    design : Design
        Shown now; what was found for another is marked so.
    wrong : str
        What is wrong with what the form asked for.
    """
    shown = {"state": "none", "share": -1, "text": "", "message": wrong, "stale": False, "seconds": ""}
    if run is None:
        return shown
    shown["stale"] = run.design != design
    state = run.job.poll()
    if isinstance(state, Progress):
        share = -1 if state.share is None else state.share
        left = "" if state.left is None else f" {percent(share)}, about {about_time(state.left)} left"
        text = f"running{left}: {state.text}"
        return shown | {"state": "running", "share": share, "text": text, "seconds": f"{state.seconds:.0f} s"}
    if isinstance(state, Failure):
        return shown | {"state": "failed", "message": wrong or state.message}
    _, _, show_result = KINDS[run.kind]
    return shown | {"state": "done", "seconds": f"{state.seconds:.1f} s", **show_result(state.result)}


def _moved(change: VariableMove) -> str:
    bound = " (at its bound)" if change.at_bound else ""
    return f"{_from_to(change.symbol, change.before, change.after)}{bound}"


def _from_to(symbol: str, before: float, after: float) -> str:
    number = BY_SYMBOL[symbol]
    return f"{show(number, before)} → {show(number, after)}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


# The tolerance run.


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
    limits = [
        limit.model_dump(exclude_none=True) | ({} if limit.at is None else {"at": f"{limit.at!r} mm"})
        for limit in request.limits
    ]
    data["goals"] = limits if request.only_own else data["goals"] + limits
    if not request.calibrated:
        data["compensators"] = []
    plan, study, grades = tolerance_plan(data, design)
    few = min(trials, CURVE_TRIALS)
    # In builds: the run itself, the offenders (as long as one run of fewer), one run of fewer for each point.
    total = trials + few * (len(grades.names) + len(SCALES) - 1)
    done = 0
    tallies = []
    for index in range(plan.chunks):
        tell(done / total, f"{done} of {trials} builds")
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
    depth = depth_budget(Camera.of(design.thin_twin), build=built)
    left_out = in_words(lengths_left_out(plan, built))
    told = (depth_sentence(depth, design), left_out, loose_words(plan), impossible_words(variant))
    return ToleranceResult(
        grade=request.grade,
        share=own,
        limits=tuple((_label(limit.label), limit.result) for limit in variant.limits),
        offenders=tuple(offenders),
        spreads=tuple(_spreads(variant)),
        grades=tuple(by_grade),
        curve=tuple(curve),
        question=f"{trials} Monte Carlo units (builds) to the grade '{study.grade}', the decoder {decoder}. A build is "
        "good with: "
        f"{'; '.join([USUAL_LIMITS] * (not request.only_own) + [_limit_words(limit) for limit in request.limits])}. "
        f"{' '.join(filter(None, told))}",
    )


def _label(column: str) -> str:
    """A column in words, its field by name: ``fill_factor@2``."""
    name, _, number = column.partition("@")
    return f"{in_words(name)}, {PLACES[int(number)]}" if number else in_words(name)


def _limit_words(limit: MetricGoal) -> str:
    """A limit in a sentence."""
    ends = {"at least": limit.min, "at most": limit.max}
    column = Column(limit.metric, None, limit.at)
    told = [f"{word} {end:.4g} {column.quantity.unit}".strip() for word, end in ends.items() if end is not None]
    return f"{_label(column.label)} {listed(told)}"


def _offenders(plan: TolerancePlan) -> Iterator[Offender]:
    """Every tolerance by what it alone uses of the limits."""
    moves, kinds = sensitivity(plan), perturbable(plan.question.design)
    ends = np.stack([moves.twin_plus[-1], moves.twin_minus[-1]])
    for index, perturbation in enumerate(plan.draws.perturbations):
        used, worst = 0.0, ""
        for limit in plan.limits:
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


# The optimisation run.


def run_optimise(request: OptimiseRequest, tell: Tell = lambda share, text: None) -> OptimiseResult:
    """A better design: a goal, what may vary, what must not get worse.

    Raises
    ------
    InputError
        Nothing may vary, what varies does not go together, or the main lens is a real one.
    """
    design = explored_lens(request.design).searched(request.design)
    tell(None, "first search")
    result = run_optimisation(
        _optimise_study(request), design, origin="optimise", tell=lambda *said: tell(*_part_done(*said))
    )
    answer, wish = result.answer, GOALS[request.goal]
    values = answer.variables()
    best = answer.problem.design_at(answer.unit, f"{design.name}, {wish.label}") if answer.feasible else None
    return OptimiseResult(
        goal=wish,
        before=_number(design, wish.quantity),
        after=answer.number(answer.asked.goals[0]),
        changes=tuple(
            VariableMove(symbol, float(getattr(design, symbol)), values[symbol], *ends)
            for symbol, ends in request.all_bounds.items()
        ),
        followers=tuple(
            (symbol, float(getattr(design, symbol)), after) for symbol, after in answer.followers().items()
        ),
        design=best,
        sentences=tuple(statements(result)),
        ends=ends_of(answer),
        against=GOALS[request.against] if request.against not in ("", request.goal) else None,
        front=_front(result),
    )


def _optimise_study(request: OptimiseRequest) -> dict[str, Any]:
    """The run as a study file would say it, but for the design."""
    label, quantity, direction = GOALS[request.goal]
    goals: list[dict[str, Any]] = [{"quantity": quantity, "direction": direction}]
    bounds = request.all_bounds
    bounds |= {symbol: 2 * (getattr(request.design, symbol),) for symbol in fixed_conjugates(request.follows, bounds)}
    data: dict[str, Any] = {
        "name": f"{request.design.name}: {label}",
        "microlens_in_focus": request.in_focus,
        "seed": request.seed,
        "variables": {s: [format_quantity(value, "length") for value in ends] for s, ends in bounds.items()},
        "solver": {"starts": STARTS},
    }
    limits: list[dict[str, Any]] = []
    if request.matched:
        limits.append({"quantity": "fill_factor", "min": FILLED[0], "max": FILLED[1]})
    if request.undistorted:
        limits.append({"quantity": "non_distortion_room_mm", "min": "0 mm"})
    for asked in request.design.required if request.required else ():
        at = {} if asked.at is None else {"at": format_quantity(asked.at, "length")}
        ends = {side: end for side, end in (("min", asked.min), ("max", asked.max)) if end is not None}
        limits.append({"quantity": asked.quantity, **at, **ends})
    for key in request.held:
        _, name, side = HELD[key]
        value = _number(request.design, name) * (1 + GIVE if side == "max" else 1 - GIVE)
        limits.append(
            {"quantity": name, side: format_quantity(value, "length") if quantity_named(name).length else value}
        )
    if request.against and request.against != request.goal:
        _, other, way = GOALS[request.against]
        # The answer is the goal's own; the other goal is there for the front.
        goals.append({"quantity": other, "direction": way, "weight": 1e-6})
        data["pareto"] = {"goals": [quantity, other], "points": FRONT_POINTS}
    return data | {"goals": goals, "constraints": limits}


def _bounds_of(design: Design, symbol: str) -> tuple[float, float]:
    """Least and greatest value of a variable, where nobody says otherwise [mm]."""
    value = float(getattr(design, symbol))
    low, high = value / REACH, REACH * value
    if symbol == "d_3":
        return low, max(high, 0.1 * design.f)
    return max(low, 1.05 * design.f) if symbol in ("d_f", "d_1") else low, high


def _number(design: Design, quantity: str) -> float:
    return float(quantity_named(quantity)(Camera.of(design.thin_twin)))


def _part_done(text: str, done: float = 0.0, total: float = 0.0) -> tuple[float | None, str]:
    """Share of the searches that are done, and the words for it, from what the solver says."""
    if total:
        return 0.8 * done / total, f"{text}: {done:g} of {total:g}"
    return 0.85 if text.startswith("checking") else None, text


def _front(result: Result) -> tuple[tuple[float, float], ...]:
    points = () if result.front is None else result.front.points
    return tuple((first, second) for first, second, *_ in (point.goals.values() for point in points))


# The simulated measurement.


def run_measure(request: MeasureRequest, tell: Tell = lambda share, text: None) -> Trial:
    """Depth measured in pictures of a slanted wall, as `roslf depth` does, of microlenses about one of them.

    Raises
    ------
    InputError
        What depth is not computed for, or no light there.
    """
    region = region_about(request.design, request.place, ACROSS)
    doing = {
        "white": "rendering a white image", "picture": "tracing rays to the wall",
        "depth": "exposing, decoding and measuring",
    }  # fmt: skip
    options = PictureOptions(region=region, seed=request.seed, exposures=request.exposures)
    return simulate(request.design, options=options, progress=lambda what, share: tell(share, doing[what]))


def _measured(trial: Trial) -> dict[str, Any]:
    result, (rows, columns) = trial.summary(), trial.true.shape
    headline = "No microlens has a depth"
    if result.spread_mm is not None and result.bias_mm is not None:
        predicted = "" if result.predicted_mm is None else f", {short(result.predicted_mm, 2)} mm predicted"
        headline = (
            f"Scatter {short(result.spread_mm, 2)} mm{predicted}; off by {short(result.bias_mm, 2)} mm on average"
        )
    x, y = trial.first.x_ml[rows // 2, columns // 2]
    return {
        "headline": headline,
        "question": f"{columns} x {rows} microlenses about ({short(x, 3)}, {short(y, 3)}) mm on the array, in "
        f"{len(trial.runs)} exposures of a {trial.scene.name}, as roslf depth measures them.",
        "sentences": [
            {
                "tone": s.tone,
                "text": s.text,
                "remedy": "Take more exposures." if "--exposures" in s.remedy else s.remedy,
            }
            for s in depth_statements(trial)
        ],
    }


Work = Callable[[Any, Tell], Any]
KINDS: dict[str, tuple[type[Any], Work, Callable[[Any], dict[str, Any]]]] = {
    "tolerance": (ToleranceRequest, run_tolerance, ToleranceResult.page),
    "optimise": (OptimiseRequest, run_optimise, OptimiseResult.page),
    "measure": (MeasureRequest, run_measure, _measured),
}
"""Kinds of run: the request, the work, and what the page shows of its result."""


@dataclass(frozen=True)
class Run:
    """A run, and the design that it was started for."""

    kind: str
    """Kind of run, one of `KINDS`."""
    design: Design
    job: ProcessJob[Any]

    @classmethod
    def begin(cls, kind: str, design: Design, options: Options) -> Run:
        """Start a run in a process of its own.

        Raises
        ------
        InputError
            Options that cannot be.
        """
        request, work, _ = KINDS[kind]
        return cls(kind, design, ProcessJob(work, read_form(request, design, options)))

    @property
    def result(self) -> Any:
        """Result of the run; None before the end."""
        state = self.job.poll()
        return state.result if isinstance(state, Done) else None
