"""Whether a design is what its `[required]` asks for: each quantity against its limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..camera import Camera
from ..design import Design, preset_names
from ..design.required import Required
from ..errors import InputError, Problem
from ..theory import tube
from ..theory.depth_budget import COVERAGE, DepthBudget, depth_budget
from ..theory.depth_error import errors_at_fields, expected_error
from ..theory.depth_of_field import finest_detail
from ..theory.focused import has_views
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from ..theory.limits import AT_FIELD, OFF_AXIS, as_design, held_by_builds, limits
from ..theory.quantities import EXPANDED, QUANTITIES, quantity_named
from ..theory.quantity import FEASIBLE, Quantity
from ..words import NO_DEPTH, clauses, length, number, on_side, uncertainty
from .field_images import FieldImages
from .fields import place_off_axis
from .groups import Verdict
from .remedies import MATCH, Holds, is_matched
from .reservations import CHARGE, DETAIL, OF_DEPTH, WAYS, Judged, Valued, in_light, least_in_light, most_light, reserved

DETAILS = (DETAIL, "mtf10_lp_per_mm", "mtf50_lp_per_mm")
"""Resolutions, which diffraction ends."""
SHARP = {"view_depth_of_field_": "single views", "depth_of_field_": "a refocused image"}
"""Depths of field, without their end, and what is sharp over them."""
DARKEST, HALVINGS = math.log(1e6), 12
"""Logarithm of the share of a full pixel from which on least light is looked for, and steps of that."""
MARGINAL = 0.5
"""Share of the builds from which what is required is marginal, and no more missed."""
OUTCOMES = {"met": "good", "marginal": "limit", "not known": "limit", "missed": "fault"}
"""Levels of verdict of what is required, by its outcome."""


def outcome_of(share: float, target: float) -> str:
    """Outcome of what is required, by the share of builds that meet it and the target yield."""
    return "met" if share >= target else "marginal" if share >= MARGINAL else "missed"


def outcomes_words(target: float) -> str:
    """Sentence on the shares that `outcome_of` goes by."""
    return (
        f"Met: by {100 * target:.4g} % of the builds at least, the target yield; marginal: by {100 * MARGINAL:g} %; "
        "missed: by fewer."
    )


@dataclass(frozen=True)
class Requirement:
    """A quantity that the design file limits, and whether it is within."""

    quantity: str
    label: str
    """Quantity in words, and where it is asked for."""
    at_mm: float | None
    """Distance ahead of the tip; None is the focal plane, or nowhere in particular."""
    min: float | None
    max: float | None
    value: float | None
    """Value of the design; None where there is none."""
    unit: str
    met: bool
    counts: str = ""
    """Parts that the value counts, and those it is without, in words; empty where the label says all."""
    only: str = ""
    """Reservation about a limit that is met, as "as drawn"; empty where it is met without one."""
    remedy: str = ""
    """Remedy of that, or of a limit that is missed, in a sentence."""
    thin_twin: float | None = None
    """Value of the thin-lens model, where `value` is of rays through a real lens."""
    field: str | None = None
    """Place in the field that it is asked for at, in words; None is the middle, or the whole."""
    caution: str = ""
    """Reasons to believe the value less; empty where none is known."""
    x_ml_mm: tuple[float, float] | None = None
    """Microlens that sees that place; None in the middle, and where the sensor does not see the place."""
    coverage: float = 1.0
    """Factor k of a file that limits U: words tell k times the value and the limits, which are of u."""
    untold: bool = False
    """Whether nothing here tells if it is met: a depth whose views a real lens's aberrations set astray."""
    by_builds: str = ""
    """Outcome by the share of a tolerance study's builds; empty where these do not tell it."""

    def holds(self, values: Array | float) -> NDArray[np.bool_]:
        """Where values are within, but for what an optimiser's rounding may leave; nowhere where they tell nothing."""
        within = quantity_named(self.quantity).within(self.min, self.max, values)
        return np.zeros_like(within) if self.untold else within

    @property
    def limits(self) -> str:
        """Limits in words."""
        ends = {"at least": self.min, "at most": self.max}
        return " and ".join(f"{word} {self._with_unit(end)}" for word, end in ends.items() if end is not None)

    @property
    def both_limits(self) -> str:
        """Limits in words, of a standard uncertainty as the expanded one, too."""
        ends = " and ".join(filter(None, map(self.expanded, (self.min, self.max))))
        return f"{self.limits} ({ends})" if ends else self.limits

    @property
    def asked(self) -> str:
        """Name of the quantity as the file asks for it: that of u, or of U."""
        return self.quantity if self.coverage == 1 else EXPANDED

    @property
    def told(self) -> float | None:
        """Value as the file asks for it: of u, or of U."""
        return None if self.value is None else self.coverage * self.value

    @property
    def value_words(self) -> str:
        """Value in words."""
        if self.quantity == "u_z_mm" and (self.at_mm or math.inf) <= COVERAGE * (self.value or 0.0) < math.inf:
            return NO_DEPTH
        return "none" if self.value is None else self._with_unit(self.value)

    def expanded(self, value: float | None) -> str:
        """Expanded uncertainty, which tables show, of a value told as a standard uncertainty; empty of any other."""
        if value is None or math.isinf(value) or self.quantity != "u_z_mm" or self.coverage != 1:
            return ""
        return f"U = {self._with_unit(COVERAGE * value)}"

    def beside(self, once: str, expanded: Array) -> Requirement:
        """Requirement of a depth that is met `once` something is done, and U uncalibrated."""
        u = uncertainty(float(expanded), 4, ahead=self.at_mm or math.inf)
        bare = f"uncalibrated, by default tolerances, U = {u}"
        told = replace(self, counts=clauses(self.counts, bare))
        if not (self.met and once):
            return told
        remedy = clauses("calibrate every camera, as the plan has it", self.remedy)
        return replace(told, only=clauses(once, self.only, by=", "), remedy=remedy)

    def _with_unit(self, value: float) -> str:
        if self.quantity in ("u_z_mm", "sigma_z_mm"):
            return uncertainty(self.coverage * value, 4)
        if self.quantity in tube.WIDTHS:  # of a tube into which it goes
            return f"{on_side(value, True, 4)} mm"
        if value == math.inf:
            return "infinity"
        return f"{number(value, 4)} {self.unit}".rstrip()

    @property
    def outcome(self) -> str:
        """Whether it is met, in words."""
        if self.untold:
            return f"not known {self.only}"
        if self.met and self.by_builds in ("", "met"):
            return f"met {self.only}".rstrip()
        return self.by_builds if self.met else "missed"

    @property
    def level(self) -> str:
        """Level of its verdict: good, limit or fault."""
        if self.untold:
            return "limit"
        level = OUTCOMES[self.by_builds or "met"] if self.met else "fault"
        return "limit" if level == "good" and self.only else level

    @property
    def verdict(self) -> Verdict:
        """Whether it is met, and by how much it is missed."""
        where = "" if self.field is None else f"_{self.field.replace(' ', '_')}"
        where += "" if self.at_mm is None else f"_at_{self.at_mm:g}_mm"
        counts = clauses(self.expanded(self.value), self.counts)
        counts = f" ({counts})" if counts else ""
        caution = f", {self.caution.replace('; ', ', and ')}" if self.caution else ""  # no verdict in brief cuts it
        text = f"{self.label} is {self.value_words}{counts}{caution}, required {self.both_limits}"
        name, level = f"required_{self.quantity}{where}", self.level
        if self.met:
            how = "as required" if level == "good" else self.outcome
            return Verdict(name, level != "fault", level, f"{how}: {text}", "" if level == "good" else self.remedy)
        if self.untold:
            return Verdict(name, False, level, f"{self.outcome}: {text}", self.remedy)
        short = ""
        if self.value is not None and math.isfinite(self.value):
            low, high = -math.inf if self.min is None else self.min, math.inf if self.max is None else self.max
            by = max(low - self.value, self.value - high)
            short = f", missed by {self._with_unit(by)}" if by > 0 else ""
        return Verdict.of(name, f"not as required: {text}{short}", self.remedy or WAYS)


def _label(shown: FieldImages, stated: Required, quantity: Quantity, asked: Required) -> str:
    """Name of what is required, with the field and the distance that it is required at."""
    label = QUANTITIES[stated.quantity].label or quantity.name
    label += "" if asked.off_axis is None else f" {shown.in_words(asked.off_axis)}"
    return label if asked.at is None else f"{label} at {number(asked.at, 4)} mm"


def requirements(
    shown: FieldImages, camera: Camera, budget: Callable[[float | None], DepthBudget]
) -> tuple[Requirement, ...]:
    """Every requirement of a design, in the order of its file.

    Of a real lens rays tell what they can; what its thin-lens model alone tells is met with that reservation.

    Parameters
    ----------
    shown : FieldImages
        Those of the design.
    camera : Camera
        Its own.
    budget : callable
        Budget of depth at a distance ahead of the tip [mm], None being the focal plane.

    Raises
    ------
    DesignError
        A quantity that is none, or a limit in another unit.
    """
    counted: dict[str, Callable[[float | None], str]] = {
        "u_z_mm": lambda at: budget(at).counted,
        **{name: partial(_width, camera, name) for name in tube.WIDTHS},
    }
    told, others = [], _also_held(shown.design, camera)
    for stated, (asked, quantity, low, high) in zip(shown.design.required, limits(shown.design), strict=True):
        depth = budget(asked.at) if quantity.name == "u_z_mm" else None
        seen = _valued(shown, camera, asked, quantity, depth)
        coverage = COVERAGE if stated.quantity == EXPANDED else 1.0
        judged = reserved(Judged(shown, camera, asked, quantity, (low, high), depth, seen, others), counted)
        label, field = _label(shown, stated, quantity, asked), asked.off_axis
        numbers = (asked.at, low, high, None if judged.undefined else seen.value)
        words = (judged.counts, judged.only, judged.remedy)
        there: tuple[Any, ...] = (judged.twin, field, judged.caution, seen.place, coverage, judged.untold)
        told.append(Requirement(quantity.name, label, *numbers, quantity.unit, judged.met, *words, *there))
    return tuple(_with_conflict(shown.design, one, told) for one in told)


def _with_conflict(design: Design, one: Requirement, others: Sequence[Requirement]) -> Requirement:
    """Requirement that is missed, its remedy being that it and another exclude each other, where they do."""
    if one.met or one.untold:
        return one
    pairs = ((rule, other) for other in others if other is not one for rule in CONFLICTS)
    words = next(filter(None, (rule(design, one, other) for rule, other in pairs)), "")
    return replace(one, remedy=f"excludes {words}") if words else one


def _light_span(design: Design, one: Requirement) -> tuple[float, float]:
    """Least and most light in which electrons or a depth are as required, over the design's.

    0 and infinite where none is, whatever else is required: that is told by itself.
    """
    at, value = one.at_mm, math.inf if one.value is None else one.value
    if one.quantity == CHARGE:
        well = most_light(design, at)
        if not 0 < value < math.inf:
            return 0.0, math.inf
        least, most = (one.min or 0.0) / value, min(well, math.inf if one.max is None else one.max / value)
        return (least, most) if least < most else (0.0, math.inf)
    if design.depth.disparity_error is not None:
        return 0.0, math.inf
    most, quantity, high = most_light(design, at), quantity_named(one.quantity), one.max
    if high is None or one.field is not None or least_in_light(design, quantity, at, value) > high:
        return 0.0, most  # no light alone holds it, which is told
    low, up = math.log(most) - DARKEST, math.log(most)
    for _ in range(HALVINGS):
        middle = (low + up) / 2
        low, up = (low, middle) if in_light(design, quantity, at, value, math.exp(middle)) <= high else (middle, up)
    return math.exp(low), most


def _by_light(design: Design, one: Requirement, other: Requirement) -> str:
    """Words on light that is too much for one and too little for another: of electrons, or depth by noise."""
    if not {one.quantity, other.quantity} <= {CHARGE, *OF_DEPTH}:
        return ""
    own, its = _light_span(design, one), _light_span(design, other)
    there, well = f"{other.label}, {other.limits}", "require less of one, or a larger sensor.full_well"
    if its[0] > own[1] * (1 + FEASIBLE):
        capped = one.max is not None and one.quantity == CHARGE and own[1] < most_light(design, one.at_mm)
        full = "it is above its limit here; require less of one" if capped else f"pixels here are full; {well}"
        if other.quantity != CHARGE or other.value is None:
            return f"{there}: with the light that it takes {full}"
        return f"{there}: with over {number(other.value * own[1], 4)} {other.unit} there {full}"
    if own[0] > its[1] * (1 + FEASIBLE):
        return f"{there}: with the light that this takes it is more than that, or pixels there are full; {well}"
    return ""


def _by_diffraction(design: Design, one: Requirement, other: Requirement) -> str:
    """Words on detail beyond the diffraction of a pupil's f-number, as both are required."""
    fine, slow = (one, other) if one.quantity in DETAILS else (other, one)
    known = fine.quantity in DETAILS and fine.field is None and slow.quantity == "f_number_pupil"
    if not known or fine.min is None or slow.min is None:
        return ""
    camera = Camera.of(design)
    scale = 2 * float(quantity_named("fold_lp_per_mm")(camera, fine.at_mm)) * float(camera.d)  # picture over object
    ends = scale / (float(camera.wavelength) * slow.min)
    if fine.min <= ends:
        return ""
    light = f"light of {length(float(camera.wavelength))} at f/{number(slow.min, 4)} shows no detail above"
    return f"{other.label}, {other.limits}: {light} {number(ends, 4)} lp/mm there; require less of one"


def _by_sharpness(design: Design, one: Requirement, other: Requirement) -> str:
    """Words on detail finer than diffraction leaves a camera that is sharp over as much as is required."""
    fine, end = (one, other) if one.quantity == DETAIL else (other, one)
    kind = end.quantity.removesuffix("near_mm").removesuffix("far_mm")
    if fine.quantity != DETAIL or fine.field is not None or fine.min is None or kind not in SHARP:
        return ""
    ends = {quantity.name: (low, high) for asked, quantity, low, high in limits(design)}
    near, far = ends.get(f"{kind}near_mm", (None, None))[1], ends.get(f"{kind}far_mm", (None, None))[0]
    camera = Camera.of(design)
    at = float(quantity_named("working_distance_mm")(camera)) if fine.at_mm is None else fine.at_mm
    if near is None or far is None or not near < at < far:
        return ""
    most = finest_detail(camera, at, near, far)
    if fine.min <= most:
        return ""
    left = (most / fine.min) ** 2 * (far - at) / (far - near)  # of at - near, what that detail leaves the mean of both
    to = number(at + (at - near) * left / (1 - left), 4)
    sharp = f"with {SHARP[kind]} sharp from {number(near, 4)} to {number(far, 4)} mm"
    return (
        f"{other.label}, {other.limits}: by diffraction of {length(float(camera.wavelength))} light no camera {sharp} "
        f"shows more than {number(most, 4)} lp/mm at {number(at, 4)} mm, and none that shows {number(fine.min, 4)} is "
        f"sharp from {number(near, 4)} to beyond {to} mm; require less of one"
    )


CONFLICTS: tuple[Callable[[Design, Requirement, Requirement], str], ...] = (_by_light, _by_diffraction, _by_sharpness)
"""Reasons for which two requirements exclude each other."""


def _valued(
    shown: FieldImages, camera: Camera, asked: Required, quantity: Quantity, depth: DepthBudget | None
) -> Valued:
    """Value of a quantity where it is required."""
    if asked.off_axis is not None:
        value, place, sampled = _off_axis(shown, asked, quantity, depth)
        middle = math.nan
        if quantity.name == DETAIL:
            traced = shown.told(quantity, asked.at)
            middle = float(quantity(camera, asked.at)) if traced is None else traced
        return Valued(value, value, value, middle, place, sampled)
    closed = float(quantity(camera, asked.at) if depth is None else depth.u_z_mm)
    rays = shown.told(quantity, asked.at)
    value = closed if rays is None else rays
    return Valued(value, closed, rays, value, None, False)


def _width(camera: Camera, name: str, _: float | None) -> str:
    """Parts and walls that a width counts, in words."""
    walls = tube.walls(camera)[1]
    return f"{tube.inserted(camera)}: {walls}" if name == tube.INSERTED else tube.head(camera) or walls


def _off_axis(
    shown: FieldImages, asked: Required, quantity: Quantity, depth: DepthBudget | None
) -> tuple[float, tuple[float, float] | None, bool]:
    """Value off the axis, NaN where nothing sees the place; its microlens [mm] and whether sampling limits it."""
    seen = shown.off_axis(asked)
    if seen is None:
        return math.nan, None, False
    images, field = seen
    x, y = images.fields[field].tolist()
    if quantity.name == DETAIL:
        there = shown.detail_at(seen, asked.at)
        return there.usable_lp_per_mm or 0.0, (x, y), there.limited_by == "sampling"
    if quantity.name in OFF_AXIS:
        noise, expected = (one[field].item() for one in errors_at_fields(images, asked.at))
        return noise if depth is None else depth_off_axis(images.camera, depth, expected, asked.at), (x, y), False
    values = np.broadcast_to(quantity.at_fields(images), (len(images.fields), 1))
    return float(values[field, 0]), (x, y), False


def depth_off_axis(camera: Camera, budget: DepthBudget, expected: float, at: float | None) -> float:
    """Depth, expected, of a microlens off the axis: its image's noise, the lengths of the axis."""
    on_axis, own = float(expected_error(camera, at)), float(budget.u_z_mm)
    return math.inf if math.isinf(expected) or math.isinf(own) else math.sqrt(own**2 - on_axis**2 + expected**2)


def required_of(
    design: Design, build: LengthCovariance | None = None, calibration: CalibratedLengths | None = None
) -> tuple[Requirement, ...]:
    """Requirements of a design as `evaluate` judges them, its lengths as drawn, as built or as calibrated."""
    if not design.required:
        return ()
    camera = Camera.of(design)
    budget = partial(depth_budget, camera, build=build, calibration=calibration)
    return requirements(FieldImages.of(design), camera, budget)


def missed_words(required: Sequence[Requirement]) -> str:
    """Words on what is required and not met, with the limits that it misses; empty where all is met."""
    return ", ".join(
        f"{one.label} {'not known' if one.untold else one.value_words} ({one.limits})"
        for one in required
        if not one.met
    )


def limits_for_study(design: Design) -> tuple[dict[str, Any], ...]:
    """Limits of a design's `[required]` as tables of a study's file, off the axis at the microlens that sees the place.

    Without those off the axis that studies have no number for: detail, and depth at a distance.
    """
    return tuple(filter(None, (_for_study(design, asked) for asked in design.required)))


def _for_study(design: Design, asked: Required) -> dict[str, Any] | None:
    table = {"quantity": asked.quantity, **asked.limits()}
    if asked.off_axis is None:
        return table
    at_field = next((name for name, whole in AT_FIELD.items() if whole == asked.quantity), asked.quantity)
    known, place = QUANTITIES.get(at_field), place_off_axis(design, asked)
    if place is None or known is None or known.local is None or not held_by_builds(asked):
        return None
    ends = {side: limit for side, limit in table.items() if side in ("min", "max")}
    return {"quantity": at_field, "field": [f"{x!r} mm" for x in place], **ends}


def _also_held(design: Design, camera: Camera) -> dict[str, Holds]:
    """Limits that a change for one of them is not to break, by what they are called."""

    def within(quantity: Quantity, at: float | None, low: float | None, high: float | None) -> Holds:
        return lambda changed: np.asarray(quantity.within(low, high, quantity(changed, at)), np.bool_)

    own: dict[str, Holds] = {MATCH: is_matched} if has_views(camera) else {}
    return own | {
        f"{quantity.label or quantity.name} as required": within(quantity, asked.at, low, high)
        for asked, quantity, low, high in limits(design)
        if asked.off_axis is None
    }


def required_distances(design: Design, far: float) -> tuple[float, ...]:
    """Distances ahead of the tip that limits name [mm]: places asked for, and ends to be sharp at, up to `far`."""
    places = []
    for asked, quantity, low, high in limits(design):
        sharp = {"depth_of_field_near_mm": high, "depth_of_field_far_mm": low}.get(quantity.name.removeprefix("view_"))
        if asked.at is not None:
            places.append(float(asked.at))
        elif sharp is not None and 0 < sharp <= far:
            places.append(sharp)
    return tuple(places)


def required_depth(design: Design, ahead: float) -> float | None:
    """U of depth that a design requires at most at a distance ahead of the tip [mm]; None where it requires none."""
    focus = float(quantity_named("working_distance_mm")(Camera.of(design)))
    ends = [
        COVERAGE * high
        for asked, quantity, _, high in limits(design)
        if quantity.name == "u_z_mm" and high is not None and asked.off_axis is None
        if math.isclose(focus if asked.at is None else asked.at, ahead, rel_tol=1e-3)
    ]
    return min(ends, default=None)


def load_beside(name: str, folder: Path) -> Design:
    """The design that a study in a folder names: a file beside it or, where there is none, a preset."""
    return as_design(name if name in preset_names() and not (folder / name).is_file() else folder / name)


def studied(
    data: Mapping[str, Any], folder: Path, design: Design | None, faults: list[Problem]
) -> tuple[Mapping[str, Any], Design | None]:
    """A study's values and its design: the one given takes the place of the file's own; faults are added to."""
    if isinstance(data.get("required"), (Mapping, list)):
        remedy = "write it in the design's file, and `required = true` here for a study that holds it"
        faults.append(Problem("required", f"what a design must reach stands with the design; {remedy}"))
        data = {**data, "required": False}
    if design is not None:
        return {**data, "design": design.name}, design
    name = data.get("design")
    if isinstance(name, str):  # else the study's own check says so
        try:
            return data, load_beside(name, folder)
        except InputError as error:
            faults += [Problem("design", f"{name}: {fault}") for fault in error.problems]
    return data, None
