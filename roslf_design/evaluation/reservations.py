"""Reservations about what a design requires: each a rule that looks at one requirement and adds what it has to say."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from ..camera import Camera
from ..design import Design
from ..design.required import ROUND_ANGLE, ROUND_RADIUS, Required
from ..theory import tube
from ..theory.colours import filters
from ..theory.depth_budget import (
    ALIASED,
    BUILT,
    CALIBRATED,
    COVERAGE,
    FULL,
    MISMATCH,
    NOISE,
    OVERLAP,
    WARMTH,
    DepthBudget,
)
from ..theory.disparity_error import MOST_LOST, roomy, share_full
from ..theory.focused import has_views, pupil_remedy
from ..theory.photometry import electrons, exposure
from ..theory.quantities import NO_LENS_MOVES, QUANTITIES, quantity_named
from ..theory.quantity import FEASIBLE, Quantity
from ..theory.vignetting import passed
from ..traced.fields import images_of
from ..words import clauses, length, number, on_side, percent, the, uncertainty
from .field_images import ASTRAY, FieldImages, astray, ends_of
from .remedies import Holds, reaching
from .specification import view_fold

WAYS = "`roslf sweep` shows what moves it, and as a study's [[constraints]] `roslf optimize` holds it"
"""Remedy of a limit that is not held."""
KNOW_BETTER = {
    BUILT: "a calibration tells them (`roslf calibrate --plan` says how well), tighter tolerances hold them",
    CALIBRATED: "`roslf calibrate --plan` names the change of boards or of what is known before that helps most",
}
"""Remedies of a depth that lengths spoil, by the term, as no optimum of nominal lengths mends them."""
MORE_LIGHT = "more light or a longer exposure, "
MENDED_BY = {
    NOISE: f"{MORE_LIGHT}a wider FAP, more microlenses matched (depth.window) lessen it",
    MISMATCH: "a wider FAP lessens it, and a measured depth.view_mismatch may be smaller than the one assumed",
    OVERLAP: "a smaller FAP or a shorter d_2 ends it, as images no longer overlap",
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
OF_LIGHT = "relative_illumination", "kept_fraction"
"""Quantities of single microlenses' light."""
HELD = "in the middle it is held"
"""Words on a depth that only the end of the field misses."""
PAST_BORE = 1.02
"""Times what first order lets through a bore from which on a field is told to be beyond it: glass shifts steep rays."""
SIMULATE = (
    "simulate it: `roslf depth` of the design with a flat --scene there tells spread and bias behind this lens; a "
    "smaller FAP or a better corrected lens lets closed forms tell it"
)
"""Remedy of a depth that aberrations spoil by nobody knows how much."""
ALL_BUT = 0.99
"""Share of the full well up to which depth is looked for in more light."""
FLAT = 179.0
"""Full angle of the widest field that a flat sensor sees [degrees]."""
STEPS = ("nm", "um", "mm", "m")
"""Units of length, each a thousand times the one before."""


class Valued(NamedTuple):
    """Value of a quantity where it is required."""

    value: float
    closed: float
    """Value of closed forms."""
    rays: float | None
    """Value of rays through a real lens; None of none."""
    middle: float
    """Value in the middle; NaN where it tells nothing."""
    place: tuple[float, float] | None
    """Microlens that sees a place off the axis [mm]."""
    sampled: bool
    """Whether sampling limits it."""

    @property
    def differ(self) -> bool:
        """Whether rays tell otherwise than closed forms, that tell anything."""
        return self.value != self.closed and not math.isnan(self.closed)


@dataclass(frozen=True, eq=False)
class Judged:
    """Requirement while it is judged: what is asked, what the design has, and what rules said so far."""

    shown: FieldImages
    camera: Camera
    asked: Required
    quantity: Quantity
    ends: tuple[float | None, float | None]
    """Limits, least and most."""
    depth: DepthBudget | None
    """Budget of a depth; None of other quantities."""
    seen: Valued
    others: Mapping[str, Holds]
    """Limits that a change for this one is not to break."""
    met: bool = False
    untold: bool = False
    """Whether nothing here tells if it is met."""
    counts: str = ""
    only: str = ""
    remedy: str = ""

    @property
    def low(self) -> float | None:
        """Least that is required."""
        return self.ends[0]

    @property
    def high(self) -> float | None:
        """Most that is required."""
        return self.ends[1]

    @property
    def at(self) -> float | None:
        """Distance ahead of the tip [mm]."""
        return self.asked.at

    @property
    def on_axis(self) -> bool:
        """Whether it is of the middle, or of the whole camera."""
        return self.asked.off_axis is None

    @property
    def value(self) -> float:
        """Value of the design."""
        return self.seen.value

    @cached_property
    def blind(self) -> bool:
        """Whether it is of views, and pixels are none."""
        return self.quantity.of_views and not has_views(self.camera)

    @property
    def undefined(self) -> bool:
        """Whether there is no value."""
        return math.isnan(self.value) or self.blind

    @property
    def of_detail(self) -> bool:
        """Whether it is a resolution."""
        return self.quantity.unit == "lp/mm"

    @cached_property
    def fold(self) -> float:
        """Finest detail that is sampled [lp/mm]; infinite of other quantities."""
        return float(quantity_named("fold_lp_per_mm")(self.camera, self.at)) if self.of_detail else math.inf

    @property
    def aliases(self) -> bool:
        """Whether contrast is told beyond what is sampled: usable detail of rays ends at their own fold."""
        return self.on_axis and not self.undefined and min(self.value, self.seen.closed) > self.fold

    @cached_property
    def dark(self) -> bool:
        """Whether a field that is held gets no light where it is required."""
        held = not self.undefined and bool(self.quantity.within(*self.ends, self.value))
        return held and _darkness(self.shown, self.quantity, self.low, self.value)

    @property
    def caution(self) -> str:
        """Reasons to believe it less."""
        told = "" if self.depth is None or self.undefined else self.depth.caution
        return told if self.on_axis or not told else f"in the middle, {told}"

    @property
    def twin(self) -> float | None:
        """Value of the thin-lens model, where the value is of rays."""
        mounted = self.shown.design.main_lens.kind.mounted
        return self.seen.closed if self.seen.differ and mounted else None

    def told(self, counts: str = "", only: str = "", remedy: str = "", *, met: bool | None = None) -> Judged:
        """Requirement with more said of it, behind what was."""
        return replace(
            self,
            met=self.met if met is None else met,
            counts=clauses(self.counts, counts),
            only=clauses(self.only, only, by=", "),
            remedy=clauses(self.remedy, remedy),
        )


Rule = Callable[[Judged], Judged]


def reserved(one: Judged, counted: Mapping[str, Callable[[float | None], str]]) -> Judged:
    """A requirement as all rules have it; `counted` tells what values of some quantities are of."""
    met = not one.undefined and bool(one.quantity.within(*one.ends, one.value)) and not one.dark
    counts = counted[one.quantity.name](one.at) if one.quantity.name in counted and not one.undefined else ""
    if one.aliases:
        counts = f"of contrast; detail above {number(one.fold, 4)} {one.quantity.unit} aliases"
    one = replace(one, met=met, counts=counts)
    one = next((said for rule in FIRST if (said := rule(one)) is not one), one)
    for rule in RULES:
        one = rule(one)
    return one


# --- rules of which the first that has anything to say does -----------------------------------------------------------


def _dark(one: Judged) -> Judged:
    return one.told(DARK, remedy=one.shown.freed) if one.dark else one


def _as_drawn(one: Judged) -> Judged:
    return one.told(only="as drawn", remedy=AS_BUILT) if one.met and one.depth and one.depth.as_drawn else one


def _deep(one: Judged) -> Judged:
    if one.depth is None or one.undefined or one.high is None or one.value <= one.high:
        return one
    beyond = one.depth.u_z_mm > one.high
    return one.told(remedy=_of_depth(one.depth, one.high) if beyond else clauses(HELD, one.shown.freed, WAYS))


def _contrast_alone(one: Judged) -> Judged:
    if not (one.met and one.aliases and one.low is not None and one.low > one.fold):
        return one
    return one.told(only="by contrast alone", remedy=_sampling(one.fold, one.at, one.low))


def _not_seen(one: Judged) -> Judged:
    return one.told(remedy=_unseen(one.shown, one.asked)) if not one.on_axis and one.seen.place is None else one


def _of_single(one: Judged) -> Judged:
    if one.met or one.on_axis or one.quantity.name not in (*OF_LIGHT, "spot_pitches"):
        return one
    return one.told(remedy=one.shown.freed if one.quantity.name in OF_LIGHT else SHARPER)


def _reached(one: Judged) -> Judged:
    known = one.met or one.undefined or one.quantity.numeric or one.quantity.name == CHARGE
    if known or one.seen.rays is not None:
        return one
    alone = reaching(one.camera, one.quantity, one.at, one.low, one.high, one.others)
    return one.told(remedy=f"{alone}; {WAYS}") if alone else one


def _focal_plane(one: Judged) -> Judged:
    if not one.met or one.quantity.name != "working_distance_mm" or one.low is None or one.high is None:
        return one
    return one.told("", *_of_the_focal_plane(one.camera, one.low, one.high))


FIRST: tuple[Rule, ...] = (
    _dark, _as_drawn, _deep, _contrast_alone, _not_seen, _of_single, _reached, _focal_plane,
)  # fmt: skip


# --- rules that all have their say, in this order ---------------------------------------------------------------------


def _worse_end(one: Judged) -> Judged:
    worst = None if one.depth is None or one.undefined else one.depth.worst
    if not one.met or worst is None or one.depth is None:
        return one
    beyond = 0.0 if one.on_axis else one.value**2 - float(one.depth.u_z_mm) ** 2
    if one.quantity.within(*one.ends, math.sqrt((worst[1] / COVERAGE) ** 2 + beyond)):
        return one
    return one.told(only="over environment.range, not at its worse end", remedy=MENDED_BY[WARMTH])


def _where_sharp(one: Judged) -> Judged:
    if not (one.met and one.at is not None and one.quantity.of_views and (blurred := _blurred(one.camera, one.at))):
        return one
    return one.told(only="where single views blur", remedy=blurred)


def _held_by_pixels(one: Judged) -> Judged:
    if not one.on_axis or one.quantity.name != CHARGE or math.isnan(one.value):
        return one
    met, counts, remedy = _of_charge(one.camera, one.at, one.value, one.ends, one.met)
    return replace(one, met=met, counts=counts, remedy=remedy)


def _full_pixels(one: Judged) -> Judged:
    if not (one.on_axis and one.met and one.quantity.name in OF_DEPTH):
        return one
    if (lost := _left_out(one.camera, one.at)) <= LEFT_OUT:
        return one
    told = one.told(
        f"without depth, for full pixels: about {percent(lost)} of the field",
        "where pixels are not full",
        met=lost <= MOST_LOST,
    )
    only = told.only * told.met
    return replace(told, only=only, remedy=clauses(_with_room(one.camera, one.at), one.remedy))


def _no_light(one: Judged) -> Judged:
    if one.met or not one.on_axis or one.quantity.name not in OF_DEPTH or one.high is None or one.undefined:
        return one
    by_noise = one.depth is None or MORE_LIGHT in one.remedy or FULL in one.remedy
    if "depth.disparity_error" in one.camera.numbers or not by_noise:
        return one
    best = least_in_light(one.shown.design, one.quantity, one.at, one.value)
    if not one.high < best < math.inf:
        return one
    ways = one.remedy.replace(MORE_LIGHT, "")
    left = f"{uncertainty(best, 3)} are left{' of u' * (one.depth is not None)}"
    return replace(one, remedy=clauses(f"no light reaches it: with pixels all but full {left}", ways))


def _off_middle(one: Judged) -> Judged:
    short = not one.on_axis and not one.met and not one.seen.sampled and one.low is not None
    return replace(one, remedy=SHARPER) if short and one.value < one.low <= one.seen.middle else one  # type: ignore[operator]


def _no_views(one: Judged) -> Judged:
    if not one.blind:
        return one
    return replace(one, remedy=f"pixels are no views, which it is of: {pupil_remedy(one.camera)}")


def _in_corner(one: Judged) -> Judged:
    if one.quantity.name != DETAIL or one.undefined or not one.on_axis:
        return one
    return one.told(*_of_corner(one.shown, one.quantity, one.at, one.low if one.met else None))


def _colours(one: Judged) -> Judged:
    if not one.of_detail or one.undefined:
        return one
    of_colours = _of_colours(one.camera, one.at, max(one.value, one.low or 0.0))
    if of_colours is None:
        return one
    told = one.told(of_colours[0])
    if not (one.met and one.low is not None and one.low > of_colours[1]):
        return told
    return told.told("", "for refocused images alone", "a monochrome sensor lets single views show it, too")


def _cause(one: Judged) -> Judged:
    if one.met or one.undefined:
        return one
    slip = _slip_of_unit(one.asked, one.low, one.high, one.value, one.quantity.unit)
    short = one.low is not None and one.value < one.low
    rim = clauses(_past_bore(one), one.shown.light_end(one.quantity)) if short else ""
    have = one.fold if one.of_detail and not one.seen.sampled else one.value
    culprit = rim or _culprit(one.quantity, one.camera, have, one.low)
    return replace(one, remedy=clauses(slip, culprit, one.remedy or WAYS * bool(slip or culprit)))


def _real_lens(one: Judged) -> Judged:
    lens = one.shown.design.main_lens.kind
    if one.met and one.depth is not None and lens.mounted and (miss := _astray(one)) > ASTRAY:
        by = f"views miss one slope by {number(miss, 2)} pitches through {lens.name}"
        told = one.told(by, remedy=SIMULATE, met=False)
        return replace(told, only="by formulas, which have none of the lens's aberrations", untold=True)
    if one.twin is not None:
        return one.told(f"of rays; of the thin-lens model {number(one.twin, 4)} {one.quantity.unit}")
    counts = one.on_axis or one.depth is not None
    if not (lens.mounted and one.met and counts and one.quantity.name not in NO_LENS_MOVES):
        return one
    return one.told("", "by the thin-lens model alone", f"no aberration of {lens.name} is in that: leave it a margin")


RULES: tuple[Rule, ...] = (
    _worse_end, _where_sharp, _held_by_pixels, _full_pixels, _no_light, _off_middle, _no_views, _in_corner, _colours,
    _cause, _real_lens,
)  # fmt: skip


# --- words of the rules -----------------------------------------------------------------------------------------------


def _of_corner(shown: FieldImages, quantity: Quantity, at: float | None, low: float | None) -> tuple[str, str, str]:
    """Detail in the field's corner in words, where the middle alone has as much as is required, and the remedy."""
    outer, where = shown.outer_detail(at), shown.in_words("corner")
    beside = f"in the middle; {where} {number(outer, 3)} lp/mm"
    if low is None or quantity.within(low, None, outer):
        return beside, "", ""
    short = where.replace("field's ", "")
    much_less = f", {number(outer, 3)} lp/mm {short}" * (outer < low / 2)
    return beside, f"in the middle alone{much_less}", f'field = "corner" requires it there; {SHARPER}'


def _astray(one: Judged) -> float:
    """Standard deviation of the ways by which a real lens's views miss one slope, where it is asked for [pitches]."""
    place = (one.shown.images, 0) if one.on_axis else one.shown.off_axis(one.asked)
    return 0.0 if place is None else astray(*place, one.at)


def _unseen(shown: FieldImages, asked: Required) -> str:
    """Remedy of a place that the sensor does not see."""
    far, unit = shown.sees_to(asked), "deg" if asked.object_height is None else "mm"
    sees = f", to {number(far, 4)} {unit}" if math.isfinite(far) else ""
    return f"the sensor does not see so far{sees} in its corner; a larger one or a main lens of shorter f sees more"


def _of_colours(camera: Camera, at: float | None, detail: float) -> tuple[str, float] | None:
    """Words on single views behind colour filters, and the coarsest detail that they fold; None where none of it is."""
    folds = {one.name: view_fold(camera, one, at) for one in filters(camera.colours)}
    views = ", ".join(f"{name} above {number(fold, 4)}" for name, fold in folds.items())
    coarsest = min(folds.values(), default=math.inf)
    return (f"of all pixels refocused; single views alias: {views} lp/mm", coarsest) if detail > coarsest else None


def _darkness(shown: FieldImages, quantity: Quantity, low: float | None, value: float) -> bool:
    """Whether a field that is held gets no light at the ends of what is required, by rims that lean as well."""
    if low is None or not quantity.lit:
        return False
    if quantity.name in (ROUND_ANGLE, ROUND_RADIUS):
        ends = shown.rim
    else:
        ends = low / value * shown.ends.fields[ends_of(quantity)]
    return not np.all(QUANTITIES["relative_illumination"].at_fields(images_of(shown.design, ends)) > 0)


def _past_bore(one: Judged) -> str:
    """Words on a field wider than rays through the bore reach, whatever the lens, and the remedy; empty of others."""
    if not one.quantity.name.startswith((ROUND_RADIUS, "field_half")) or one.low is None:
        return ""
    through = min(passed(one.camera, one.at), key=attrgetter("radius"), default=None)
    beyond = through is not None and one.low > PAST_BORE * through.radius
    return f"{through.words}, whatever the lens" if through is not None and beyond else ""


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


def _of_depth(budget: DepthBudget, most: float) -> str:
    """Remedy of a depth that is missed, by what adds most to it."""
    largest = budget.largest
    if FULL in largest.remark:
        return f"mostly {largest.name}: {FULL}: expose less; {WAYS}"
    if ALIASED in largest.remark:
        return f"{largest.remark}; finer microlenses, or a depth.finest as coarse as the object's, end it; {WAYS}"
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
    if quantity.name == ROUND_RADIUS:
        return (
            f"the sensor ends it: about one {on_side(low / have, True, 3)} times as wide on its nearest side sees that"
        )
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


def in_light(design: Design, quantity: Quantity, at: float | None, value: float, times: float) -> float:
    """A depth's uncertainty in so many times the light, from its `value` in the design's own: that less its noise."""
    camera = Camera.of(design)
    lit = Camera.of(design.replace({"light.exposure": times * float(exposure(camera))}))
    now, then = float(quantity(camera, at)), float(quantity(lit, at))
    return then if not math.isfinite(value) or then == math.inf else math.sqrt(max(value**2 - now**2 + then**2, 0.0))


def most_light(design: Design, at: float | None) -> float:
    """Times the design's light in which pixels are full, where the scene is as bright as on average."""
    camera = Camera.of(design)
    return float(camera["sensor.full_well"] / electrons(camera, at))


def least_in_light(design: Design, quantity: Quantity, at: float | None, value: float) -> float:
    """A depth's least uncertainty in any light: with pixels all but full, or as full as leaves room for texture."""
    camera = Camera.of(design)
    full = (ALL_BUT * most_light(design, at), roomy(camera) / float(electrons(camera, at)))
    return min((in_light(design, quantity, at, value, times) for times in full if times > 0), default=math.inf)
