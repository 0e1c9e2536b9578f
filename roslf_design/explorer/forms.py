"""Forms of the views that start runs: what may be chosen, what is chosen by default, and requests read from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, TypeVar

from ..camera import Camera
from ..design import Design
from ..design.required import Required
from ..errors import InputError, Problem
from ..reporting.story import CENTRE, DEPTH, FILL, KEPT
from ..theory.limits import held_by_builds
from ..theory.quantities import in_words, quantity_named
from ..tolerancing.metrics import DISTANT, METRICS
from ..tolerancing.study import MetricGoal
from ..words import listed, to_html
from .main_lens import TRIALS, explored_lens
from .state import BY_SYMBOL, CONJUGATE, State, read, show, shown_in

Options = Mapping[str, Sequence[str]]
"""A form as the browser sends it: every field's name with the values chosen."""

GRADES = ("commercial", "precision", "high")
"""Grades of the shipped table, from loose to tight."""


class WantedQuantity(NamedTuple):
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
    "expected": WantedQuantity("least depth, expected", "u_z_mm", "min"),
    "depth": WantedQuantity("least depth noise", "sigma_z_mm", "min"),
    "field": WantedQuantity("widest field", "field_half_width_mm", "max"),
    "light": WantedQuantity("most light", "light_sr", "max"),
    "views": WantedQuantity("most independent views", "views_independent", "max"),
    "sample": WantedQuantity("finest object sample", "object_sample_mm", "min"),
    "length": WantedQuantity("shortest instrument", "total_length_mm", "min"),
}
"""Goals by their keys, with their directions."""
VARIABLES = ("D", "f", "d_f", "d_1", "D_F", "d_3", "d", "d_2")
"""Variables that may be chosen, but for which of f, d_f and d_1 follows."""
USUAL = ("D_F", "d_3", "d_2")
"""Variables that are chosen by default."""
HELD = {
    "depth": WantedQuantity("depth noise", "sigma_z_mm", "max"),
    "expected": WantedQuantity("depth, expected", "u_z_mm", "max"),
    "field": WantedQuantity("field", "field_half_width_mm", "min"),
    "views": WantedQuantity("independent views", "views_independent", "min"),
    "pixels": WantedQuantity("pixels across an image", "views_geometric", "min"),
    "length": WantedQuantity("total length", "total_length_mm", "max"),
    "light": WantedQuantity("light", "light_sr", "min"),
}
"""Quantities that may be kept from getting worse, with the side of their limit."""
REACH = 2.0
"""Bounds of a variable where nobody says otherwise, as factors of its value."""


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
    """Limits besides the default ones."""
    only_own: bool = False
    """Whether they stand instead of those."""


@dataclass(frozen=True)
class OptimiseRequest:
    """Request for an optimisation run, as the form has it."""

    design: Design
    goal: str = field(default="expected", metadata={KNOWN: GOALS})
    variables: tuple[str, ...] = field(default=USUAL, metadata={KNOWN: VARIABLES})
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Least and greatest value of variables [mm]; `_usual_bounds` of those that are not named."""
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
        return {s: self.bounds.get(s) or _usual_bounds(self.design, s) for s in self.variables}


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
    f"image fill within {100 * FILL:g} % of nominal, depth noise {100 * DEPTH:g} % more at most, no field "
    f"losing more than {100 * KEPT:g} % of its light, image centres found to {CENTRE:g} px"
)
"""Default limits in words."""
LIMITED = [
    {"key": name, "label": metric.label.replace("_Z", "").replace("_", "") + f" [{metric.unit}]" * bool(metric.unit)}
    for name, metric in (METRICS | DISTANT).items()
]
"""Metrics that may be limited; a list has no subscripts."""


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
            {"of": asked.quantity, "at": "", "min": "", "max": ""} | {key: str(v) for key, v in asked.limits().items()}
            for asked in design.required
            if asked.off_axis is None
        ],
        "goals": [{"key": key, "label": goal.label} for key, goal in GOALS.items()],
        "variables": [_offered(s, state) for s in VARIABLES if s not in lens.own],
        "required": to_html("; ".join(map(_asked_words, design.required))),
        "held": [{"key": key, "label": held.label} for key, held in HELD.items()],
        "searches": lens.searches,
        "of": state.reference.name,
    }


def _asked_words(asked: Required) -> str:
    """A limit of the design's `[required]` in a line, as its file has it."""
    limits, unit = asked.limits(), quantity_named(asked.quantity).unit
    told = {end: limit if isinstance(limit, str) else f"{limit:g} {unit}".rstrip() for end, limit in limits.items()}
    ends = [f"{word} {told[end]}" for end, word in (("min", "at least"), ("max", "at most")) if end in limits]
    where = [f"{limits['at']} ahead of the tip"] if asked.at is not None else []
    if asked.off_axis is not None:
        place = f"at the {asked.field}" if isinstance(asked.field, str) else asked.off_axis
        where.append(place if held_by_builds(asked) else f"{place}, not held by a search")
    return ", ".join([f"{in_words(asked.quantity)} {listed(ends)}", *where])


def _offered(symbol: str, state: State) -> dict[str, Any]:
    ends = (show(BY_SYMBOL[symbol], float(f"{end:.4g}")) for end in _usual_bounds(state.drawn, symbol))
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
    ends = list(_usual_bounds(design, symbol))
    for index, side in enumerate(("low", "high")):
        for text in options.get(f"{side}_{symbol}", ()):
            try:
                ends[index] = read(shown_in(BY_SYMBOL[symbol], ends[index]), text)
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
        MetricGoal(quantity=name, **{end: _number_or_text(text) for end, text in ends if text.strip()})
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


def _usual_bounds(design: Design, symbol: str) -> tuple[float, float]:
    """Least and greatest value of a variable, where nobody says otherwise [mm]."""
    value, tip = float(getattr(design, symbol)), float(Camera.of(design).tip)
    low, high = sorted((value / REACH, REACH * value))  # of a FAP behind the lens below 0
    if symbol == "d_3":  # before a tip that is another's, and before the focal plane
        ahead = tip if value < tip else design.d_f - (design.d_f - value) / REACH
        return low, min(max(high, 0.1 * design.f), ahead)
    if symbol == "d_f":
        low = max(low, tip + (value - tip) / REACH)
    return max(low, min(1.05 * design.f, value)) if symbol in ("d_f", "d_1") else low, high
