"""Whether a design is what its `[required]` asks for: each quantity against its limits."""

from __future__ import annotations

import math
import re
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
from ..design.required import ROUND_ANGLE, ROUND_RADIUS, Required
from ..errors import InputError, Problem
from ..theory import tube
from ..theory.colours import filters
from ..theory.depth_budget import (
    BUILT,
    CALIBRATED,
    COVERAGE,
    FULL,
    MISMATCH,
    NOISE,
    OVERLAP,
    WARMTH,
    DepthBudget,
    depth_budget,
)
from ..theory.depth_error import errors_at_fields, expected_error
from ..theory.disparity_error import MOST_LOST, roomy, share_full
from ..theory.focused import has_views, pupil_remedy
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from ..theory.limits import AT_FIELD, OFF_AXIS, as_design, held_by_builds, limits
from ..theory.photometry import electrons, exposure
from ..theory.quantities import EXPANDED, NO_LENS_MOVES, QUANTITIES, quantity_named
from ..theory.quantity import FEASIBLE, Quantity
from ..traced.fields import images_of
from ..words import clauses, length, number, on_side, percent, the, uncertainty
from .fields import place_off_axis
from .groups import Verdict
from .remedies import MATCH, Holds, is_matched, reaching
from .specification import FieldImages, view_fold

WAYS = "`roslf sweep` shows what moves it, and as a study's [[constraints]] `roslf optimize` holds it"
"""Remedy of a limit that is not held."""
KNOW_BETTER = {
    BUILT: "a calibration tells them (`roslf calibrate --plan` says how well), tighter tolerances hold them",
    CALIBRATED: "`roslf calibrate --plan` names the change of boards or of what is known before that helps most",
}
"""Remedies of a depth that lengths spoil, by the term, as no optimum of nominal lengths mends them."""
MENDED_BY = {
    NOISE: "more light or a longer exposure, a wider FAP, more microlenses matched (depth.window) lessen it",
    MISMATCH: "a wider FAP lessens it, and a measured depth.view_mismatch may be smaller than the one assumed",
    OVERLAP: "images that do not overlap end it (the verdict on the f-number match says how)",
    WARMTH: "a housing that expands less, a narrower environment.range, or calibrated_at where it is used lessen it",
}
"""Remedies of a depth that is missed by the nominal camera, by its largest term."""
AS_BUILT = (
    "lengths as built are not in it: the report (`roslf report`) and the data sheet of a tolerance study (`roslf "
    "datasheet`) tell it with them"
)
"""Remedy of a depth that is held by the lengths as drawn alone."""


OF_DEPTH, LEFT_OUT = ("u_z_mm", "sigma_z_mm"), 0.05
"""Depths that full pixels leave without; share of the field without depth from which one is met in the rest alone, up
to `MOST_LOST`."""
CHARGE = "pixel_electrons"
DETAIL = "detail_lp_per_mm"
SHARPER = "a better corrected lens, a smaller FAP or a smaller sensor lets more of the field hold it"
"""Remedy of detail that the corner of the field does not show."""
DARK = "dark at the edge of what is required"
"""Words on a field that is none."""
LIT = "free the images from what cuts them (the field's verdict says what)"
"""Remedy of a field whose edge gets no light."""
REMEDIES = {"spot_pitches": SHARPER, "relative_illumination": LIT, "kept_fraction": LIT}
"""Remedies of what single microlenses have."""
FLAT = 179.0
"""Full angle of the widest field that a flat sensor sees [degrees]."""
STEPS = ("nm", "um", "mm", "m")
"""Units of length, each a thousand times the one before."""


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

    def holds(self, values: Array | float) -> NDArray[np.bool_]:
        """Where values are within, but for what an optimiser's rounding may leave; nowhere where they are NaN."""
        return quantity_named(self.quantity).within(self.min, self.max, values)

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
    def told(self) -> float | None:
        """Value as the file asks for it: of u, or of U."""
        return None if self.value is None else self.coverage * self.value

    @property
    def value_words(self) -> str:
        """Value in words."""
        return "none" if self.value is None else self._with_unit(self.value)

    def expanded(self, value: float | None) -> str:
        """Expanded uncertainty, which tables show, of a value told as a standard uncertainty; empty of any other."""
        if value is None or math.isinf(value) or self.quantity != "u_z_mm" or self.coverage != 1:
            return ""
        return f"U = {self._with_unit(COVERAGE * value)}"

    def beside(self, once: str, expanded: Array) -> Requirement:
        """Requirement of a depth that is met `once` something is done, and U of lengths as a first look builds them."""
        bare = f"without a calibration, lengths as a first look builds them, U = {uncertainty(float(expanded), 4)}"
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
        return f"met {self.only}".rstrip() if self.met else "not met"

    @property
    def verdict(self) -> Verdict:
        """Whether it is met, and by how much it is missed."""
        where = "" if self.field is None else f"_{self.field.replace(' ', '_')}"
        where += "" if self.at_mm is None else f"_at_{self.at_mm:g}_mm"
        counts = clauses(self.expanded(self.value), self.counts)
        counts = f" ({counts})" if counts else ""
        caution = f", {self.caution.replace('; ', ', and ')}" if self.caution else ""  # no verdict in brief cuts it
        text = f"{self.label} is {self.value_words}{counts}{caution}, required {self.both_limits}"
        if self.met and self.only:
            name = f"required_{self.quantity}{where}"
            return Verdict(name, False, "limit", f"{self.outcome}: {text}", self.remedy)
        if self.met:
            return Verdict.of(f"required_{self.quantity}{where}", f"as required: {text}")
        short = ""
        if self.value is not None and math.isfinite(self.value):
            low, high = -math.inf if self.min is None else self.min, math.inf if self.max is None else self.max
            by = max(low - self.value, self.value - high)
            short = f", missed by {self._with_unit(by)}" if by > 0 else ""
        return Verdict.of(f"required_{self.quantity}{where}", f"not as required: {text}{short}", self.remedy or WAYS)


def _of_corner(shown: FieldImages, quantity: Quantity, at: float | None, low: float | None) -> tuple[str, str, str]:
    """Detail in the field's corner in words, where the middle alone has as much as is required, and the remedy."""
    outer, where = shown.outer_detail(at), shown.in_words("corner")
    beside = f"in the middle; {where} {number(outer, 3)} lp/mm"
    if low is None or quantity.within(low, None, outer):
        return beside, "", ""
    short = where.replace("field's ", "")
    much_less = f", {number(outer, 3)} lp/mm {short}" * (outer < low / 2)
    return beside, f"in the middle alone{much_less}", f'field = "corner" requires it there; {SHARPER}'


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
    lens = shown.design.main_lens.kind
    counted: dict[str, Callable[[float | None], str]] = {
        "u_z_mm": lambda at: budget(at).counted,
        **{name: partial(_width, camera, name) for name in tube.WIDTHS},
    }
    told, others = [], _also_held(shown.design, camera)
    for stated, (asked, quantity, low, high) in zip(shown.design.required, limits(shown.design), strict=True):
        depth = budget(asked.at) if quantity.name == "u_z_mm" else None
        field, coverage = asked.off_axis, COVERAGE if stated.quantity == EXPANDED else 1.0
        value, closed, rays, middle, place, sampled = _valued(shown, camera, asked, quantity, depth)
        undefined = math.isnan(value) or (quantity.of_views and not has_views(camera))
        met = not undefined and bool(quantity.within(low, high, value))
        dark = _darkness(shown, quantity, low, value) if met else None
        met = met and dark != DARK
        label = _label(shown, stated, quantity, asked)
        at, only, remedy, of_detail = asked.at, "", "", quantity.unit == "lp/mm"
        counts = counted[quantity.name](at) if quantity.name in counted and not undefined else ""
        fold = float(quantity_named("fold_lp_per_mm")(camera, at)) if of_detail else math.inf
        # Usable detail of rays ends at their own fold.
        aliases = field is None and not undefined and min(value, closed) > fold
        if aliases:
            counts = f"of contrast; detail above {number(fold, 4)} {quantity.unit} aliases"
        worst, caution = (None, "") if depth is None or undefined else (depth.worst, depth.caution)
        beyond = 0.0 if field is None or depth is None or undefined else value**2 - float(depth.u_z_mm) ** 2
        if field is not None:
            caution = caution and f"in the middle, {caution}"
        if dark is not None:
            counts, only, remedy = clauses(counts, dark * (not met)), dark * met, LIT
        elif met and depth is not None and depth.as_drawn:
            only, remedy = "as drawn", AS_BUILT
        elif depth is not None and not undefined and high is not None and value > high:
            remedy = _of_depth(depth, high) if depth.u_z_mm > high else f"in the middle it is held; {LIT}; {WAYS}"
        elif met and aliases and low is not None and low > fold:
            only, remedy = "by contrast alone", _sampling(fold, at, low)
        elif field is not None and place is None:
            remedy = _unseen(shown, asked)
        elif not met and field is not None and quantity.name in REMEDIES:
            remedy = REMEDIES[quantity.name]
        elif not met and rays is None and not undefined and not quantity.numeric and quantity.name != CHARGE:
            alone = reaching(camera, quantity, at, low, high, others)
            remedy = f"{alone}; {WAYS}" if alone else ""
        elif met and quantity.name == "working_distance_mm" and low is not None and high is not None:
            only, remedy = _of_the_focal_plane(camera, low, high)
        if met and worst is not None and not quantity.within(low, high, math.sqrt((worst[1] / COVERAGE) ** 2 + beyond)):
            only = clauses(only, "over environment.range, not at its worse end", by=", ")
            remedy = clauses(remedy, MENDED_BY[WARMTH])
        so_far = met, counts, only, remedy
        met, counts, only, remedy = _reserved(camera, asked, quantity, value, (low, high), so_far)
        if field is not None and not met and not sampled and low is not None and value < low <= middle:
            remedy = SHARPER
        if quantity.of_views and not has_views(camera):
            remedy = f"pixels are no views, which it is of: {pupil_remedy(camera)}"
        if quantity.name == DETAIL and not undefined and field is None:
            beside, alone, sharper = _of_corner(shown, quantity, at, low if met else None)
            counts, only, remedy = clauses(counts, beside), clauses(only, alone, by=", "), clauses(remedy, sharper)
        if of_detail and not undefined and (of_colours := _of_colours(camera, at, max(value, low or 0.0))):
            counts = clauses(counts, of_colours[0])
            if met and low is not None and low > of_colours[1]:
                remedy = clauses(remedy, "a monochrome sensor lets single views show it, too")
                only = clauses(only, "for refocused images alone", by=", ")
        if not met and not undefined:
            slip = _slip_of_unit(asked, low, high, value, quantity.unit)
            rim = shown.round_end(quantity.name) if low is not None and value < low else ""
            known = _culprit(quantity, camera, fold if of_detail and not sampled else value, low)
            culprit = f"{rim}: {LIT}" if rim else known
            remedy = clauses(slip, culprit, remedy or WAYS * bool(slip or culprit))
        twin = None if value == closed or not lens.mounted or math.isnan(closed) else closed
        if twin is not None:
            counts = clauses(counts, f"of rays; of the thin-lens model {number(twin, 4)} {quantity.unit}")
        elif lens.mounted and met and (field is None or depth is not None) and quantity.name not in NO_LENS_MOVES:
            only = clauses(only, "by the thin-lens model alone", by=", ")
            remedy = clauses(remedy, f"no aberration of {lens.name} is in that: leave it a margin")
        numbers, words = (at, low, high, None if undefined else value), (counts, only, remedy)
        there: tuple[Any, ...] = (twin, field, caution, place, coverage)
        told.append(Requirement(quantity.name, label, *numbers, quantity.unit, met, *words, *there))
    return tuple(_with_conflict(camera, one, told) for one in told)


def _with_conflict(camera: Camera, one: Requirement, others: Sequence[Requirement]) -> Requirement:
    """Requirement of a depth for which pixels are full, its remedy being that no light holds it and the others."""
    if one.met or one.quantity not in OF_DEPTH or FULL not in one.remedy:
        return one
    unfilled = float(camera["sensor.full_well"] / electrons(camera, one.at_mm))  # times the light: there it begins
    for other in others:
        low, value = other.min, other.value
        if other.quantity == CHARGE and low is not None and value is not None and value * unfilled < low:
            words = (
                f"excludes {other.label}, at least {number(low, 4)} {other.unit}: with over "
                f"{number(value * unfilled, 4)} {other.unit} there pixels here are full; require less of one, or a "
                "larger sensor.full_well"
            )
            return replace(one, remedy=words)
    return one


_Valued = tuple[float, float, float | None, float, tuple[float, float] | None, bool]
"""Value; closed forms' and rays' own; the middle's, NaN where it tells nothing; microlens [mm]; limited by sampling."""


def _valued(
    shown: FieldImages, camera: Camera, asked: Required, quantity: Quantity, depth: DepthBudget | None
) -> _Valued:
    """Value of a quantity where it is required."""
    if asked.off_axis is not None:
        value, place, sampled = _off_axis(shown, asked, quantity, depth)
        middle = math.nan
        if quantity.name == DETAIL:
            traced = shown.told(quantity, asked.at)
            middle = float(quantity(camera, asked.at)) if traced is None else traced
        return value, value, value, middle, place, sampled
    closed = float(quantity(camera, asked.at) if depth is None else depth.u_z_mm)
    rays = shown.told(quantity, asked.at)
    value = closed if rays is None else rays
    return value, closed, rays, value, None, False


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


def _unseen(shown: FieldImages, asked: Required) -> str:
    """Remedy of a place that the sensor does not see."""
    far, unit = shown.sees_to(asked), "deg" if asked.object_height is None else "mm"
    sees = f", to {number(far, 4)} {unit}" if math.isfinite(far) else ""
    return f"the sensor does not see so far{sees} in its corner; a larger one or a main lens of shorter f sees more"


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
    return ", ".join(f"{one.label} {one.value_words} ({one.limits})" for one in required if not one.met)


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


def _of_colours(camera: Camera, at: float | None, detail: float) -> tuple[str, float] | None:
    """Words on single views behind colour filters, and the coarsest detail that they fold; None where none of it is."""
    folds = {one.name: view_fold(camera, one, at) for one in filters(camera.colours)}
    views = ", ".join(f"{name} above {number(fold, 4)}" for name, fold in folds.items())
    coarsest = min(folds.values(), default=math.inf)
    return (f"of all pixels refocused; single views alias: {views} lp/mm", coarsest) if detail > coarsest else None


def _darkness(shown: FieldImages, quantity: Quantity, low: float | None, value: float) -> str | None:
    """Words on where a field that is held gets no light: at the ends of what is required, or in the corner alone."""
    if low is None or not ("field_of_view" in quantity.name or quantity.name.startswith(("field_half", ROUND_RADIUS))):
        return None
    if quantity.name in (ROUND_ANGLE, ROUND_RADIUS):
        ends = shown.rim
    else:
        pair = 0 if "width" in quantity.name else 1 if "height" in quantity.name else 2
        ends = low / value * shown.ends.fields[2 * pair : 2 * pair + 2]
    if not np.all(QUANTITIES["relative_illumination"].at_fields(images_of(shown.design, ends)) > 0):
        return DARK
    return None if shown.points[shown.farthest].relative_illumination > 0 else "with a dark corner"


def _slip_of_unit(asked: Required, low: float | None, high: float | None, value: float, unit: str) -> str:
    """Question about a limit's unit, where the next one is about a thousand times nearer to what the design has."""
    text, limit = (asked.max, high) if high is not None and value > high else (asked.min, low)
    typed = next((one for one in STEPS if re.fullmatch(rf"[\d.e+-]+\s*{one}", str(text))), None)
    if typed is None or not limit or not 0 < value / limit < math.inf:
        return ""
    steps = math.log10(value / limit) / 3
    meant = STEPS.index(typed) + round(steps)
    if not 0.75 <= abs(steps) <= 1.25 or not 0 <= meant < len(STEPS):
        return ""
    return f"{text}: did you mean {STEPS[meant]}? the design has {number(value, 3)} {unit}"


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


def _of_depth(budget: DepthBudget, most: float) -> str:
    """Remedy of a depth that is missed, by what adds most to it."""
    largest = budget.largest
    if FULL in largest.remark:
        return f"mostly {largest.name}: {FULL}: expose less; {WAYS}"
    if largest.name in MENDED_BY:
        return f"mostly {largest.name}: {MENDED_BY[largest.name]}; {WAYS}"
    if largest.name not in KNOW_BETTER:
        return WAYS
    others = replace(budget, terms=tuple(term for term in budget.terms if term is not largest))
    rest = float(others.u_z_mm)
    still = f"; without them u is {number(rest, 4)} mm, and misses still: {WAYS}" if rest > most else ""
    way = KNOW_BETTER[largest.name]
    if largest.name == BUILT and CALIBRATED in [term.name for term in others.terms]:
        way = "the calibration does not see them, tighter tolerances hold them"
    return f"mostly {largest.name}, which `roslf optimize` does not count: {way}{still}"


def _left_out(camera: Camera, at: float | None) -> float:
    """Share of the field that has no depth for full pixels; none of an error that the design gives."""
    return 0.0 if "depth.disparity_error" in camera.numbers else share_full(camera, at)[1]


def _reserved(
    camera: Camera, asked: Required, quantity: Quantity, value: float, ends: tuple[float | None, float | None],
    told: tuple[bool, str, str, str],
) -> tuple[bool, str, str, str]:  # fmt: skip
    """Whether a limit is met, its reservation and remedies, once blur of views and, on the axis, full pixels count."""
    (met, counts, only, remedy), at = told, asked.at
    if met and at is not None and quantity.of_views and (blurred := _blurred(camera, at)):
        only, remedy = clauses(only, "where single views blur", by=", "), clauses(remedy, blurred)
    if asked.off_axis is not None:
        return met, counts, only, remedy
    if quantity.name == CHARGE and not math.isnan(value):
        met, counts, remedy = _of_charge(camera, at, value, ends, met)
    elif met and quantity.name in OF_DEPTH and (lost := _left_out(camera, at)) > LEFT_OUT:
        counts = clauses(counts, f"without depth, for full pixels: about {percent(lost)} of the field")
        only = clauses(only, "where pixels are not full", by=", ") * (lost <= MOST_LOST)
        met, remedy = lost <= MOST_LOST, clauses(_with_room(camera, at), remedy)
    return met, counts, only, remedy


def _with_room(camera: Camera, at: float | None) -> str:
    """Exposure, or light, that leaves the texture's bright places room in the full well."""
    return f"{_more_light(camera, roomy(camera) / float(electrons(camera, at)), False)} leaves room"


def _more_light(camera: Camera, factor: float, up: bool) -> str:
    """Exposure that is so many times the design's, or light where the exposure does not follow it, by their keys."""
    way = f'light.exposure = "{on_side(1e3 * factor * float(exposure(camera)), up, 4)} ms"'
    if "light.exposure" in camera.numbers:
        key, unit = ("radiance", "W/m^2/sr") if "light.radiance" in camera.numbers else ("illuminance", "lx")
        way += f' or light.{key} = "{on_side(factor * float(camera[f"light.{key}"]), up, 4)} {unit}"'
    return f"{way} ({number(factor, 3)} times as much)"


def _of_charge(
    camera: Camera, at: float | None, value: float, ends: tuple[float | None, float | None], met: bool
) -> tuple[bool, str, str]:
    """Whether electrons of a pixel are as required and fit into it, the reservation, and the remedy."""
    low, high = ends
    well = float(camera["sensor.full_well"])
    holds = f"the full well holds {number(well, 4)}"
    if low is not None and low >= well:
        return False, holds, f"no light fills a pixel with {number(low, 4)}: require less, or a larger sensor.full_well"
    if value > well:
        needs = ""
        if low is not None and low > roomy(camera):
            needs = f"at least {number(low, 4)} with room for bright places asks for a larger sensor.full_well"
        return False, f"more than fits: {holds}", clauses(_with_room(camera, at), needs)
    if not met and low is not None and 0 < value < low:
        return False, "", f"{_more_light(camera, low / value, True)} reaches it; {holds}"
    if not met and high is not None and value > high:
        return False, "", f"{_more_light(camera, high / value, False)} reaches it"
    return met, "", ""


def _sampling(fold: float, at: float | None, low: float) -> str:
    """Remedy of detail whose contrast is as required, and which is sampled less finely."""
    place = "" if at is None else f'at = "{at:g} mm", '
    return (
        f"believe the sampling: a sample a microlens carries {number(fold, 4)} lp/mm, whatever contrast finer "
        "detail keeps; smaller microlenses or a shorter distance raise it, and detail_lp_per_mm = "
        f"{{{place}min = {low:g}}} requires both"
    )


def _culprit(quantity: Quantity, camera: Camera, have: float, low: float | None) -> str:
    """Remedy of a missed limit by what it hangs on, where that is known; `have` is the value, or the detail sampled."""
    if quantity.name in tube.WIDTHS and (low is None or have >= low):
        parts = [part for part in tube.housed(camera) if quantity.name == tube.WHOLE or part.inside(camera)]
        widest = max(parts, key=lambda part: float(part.across + tube.slack(camera, part.place)))
        return f"the widest is {the(widest.name)}, {widest.sizes(camera)}"
    if low is None or not 0 < have < low:
        return ""
    if quantity.name.startswith(("field_of_view", ROUND_ANGLE)) and low < FLAT:
        wider = math.tan(math.radians(low / 2)) / math.tan(math.radians(have / 2))
        side = "wide on its nearest side" if quantity.name == ROUND_ANGLE else "wide"
        sensor = f"about a sensor {on_side(wider, True, 3)} times as {side} sees that"
        return f"{sensor}{_beyond_tube(quantity, camera, wider)}, or a main lens so many times shorter"
    if quantity.unit == "lp/mm":
        pitch = on_side(1e3 * float(camera.d) * have / low, False, 3)
        return f"microlenses of {pitch} um, not {length(float(camera.d))}, sample {low:g} lp/mm there"
    return ""


def _beyond_tube(quantity: Quantity, camera: Camera, wider: float) -> str:
    """Words on a sensor so many times as wide that does not fit the tube; empty where it does, or stands elsewhere."""
    within = {
        part.name: float(tube.room(camera, part.place))
        for part in tube.housed(camera)
        if part.aside is None and part.inside(camera)
    }
    room = within.get("sensor", math.inf)
    sides = [float(camera.cold.numbers[f"sensor.size.{axis}"]) for axis in (0, 1)]
    least = wider * min(sides)
    if quantity.name == ROUND_ANGLE:
        grown = [max(side, least) for side in sides]
    else:
        one = {"field_of_view_width_deg": 0, "field_of_view_height_deg": 1}.get(quantity.name)
        grown = [side * (wider if one in (None, axis) else 1.0) for axis, side in enumerate(sides)]
    across = math.hypot(*grown)
    if across <= room * (1 + FEASIBLE):
        return ""
    return f" (too wide for [tube]: {number(across, 3)} mm across its corners, of {number(room, 3)} mm that it leaves)"


def _of_the_focal_plane(camera: Camera, low: float, high: float) -> tuple[str, str]:
    """Reservation, and its remedy, where limits of the focal plane's distance are no range that views show sharply."""
    near, far = (float(quantity_named(f"view_depth_of_field_{end}_mm")(camera)) for end in ("near", "far"))
    if not has_views(camera) or (near <= low and high <= far):
        return "", ""
    asked = (
        f'view_depth_of_field_near_mm = {{max = "{low:g} mm"}}, view_depth_of_field_far_mm = {{min = "{high:g} mm"}}'
    )
    sharp = f"single views are sharp from {number(near, 3)} to {number(far, 3)} mm"
    return "by the focal plane alone", f"{sharp}; a range that is to be sharp is required by {asked}"


def _blurred(camera: Camera, at: float) -> str:
    """Remedy of a distance at which single views are not sharp; empty where they are."""
    near, far = (float(quantity_named(f"view_depth_of_field_{end}_mm")(camera)) for end in ("near", "far"))
    if not has_views(camera) or near * (1 - FEASIBLE) <= at <= far * (1 + FEASIBLE):
        return ""
    focus = number(float(quantity_named("working_distance_mm")(camera)), 4)
    sharp = f"single views are sharp from {number(near, 3)} to {number(far, 3)} mm"
    return f"focused at {focus} mm, {sharp}: focus closer to it"


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
