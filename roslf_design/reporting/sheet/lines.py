"""The page an engineer signs: a camera in the endoscope standards' terms, each line with its tolerance."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..._arrays import Array
from ...camera import Camera
from ...design import dumps
from ...errors import expect, refusal
from ...evaluation.answer import FirstAnswer
from ...evaluation.doubts import full_well_doubt
from ...evaluation.field_images import RIM, FieldImages, corner
from ...evaluation.required import Requirement, outcome_of, outcomes_words, requirements
from ...evaluation.resolved import LEVELS, WAYS, Place, Resolved
from ...evaluation.result import MARKS, depth_basis, focused_table
from ...evaluation.specification import CRITERION, Colour, Specification, depth_light, specification
from ...evaluation.stations import FOCUS
from ...evaluation.verdicts import as_sharp, lit
from ...evaluation.working_range import WorkingRange
from ...json_data import plain
from ...progress import UNHEARD, Share, part_of
from ...tables import csv_bytes
from ...theory.colours import GREEN
from ...theory.depth_budget import COVERAGE, DepthBudget, depth_budget
from ...theory.disparity_error import full_within
from ...theory.field_of_view import focus_ahead
from ...theory.photometry import through_filter
from ...theory.quantities import QUANTITIES, noise_words
from ...theory.quantity import Listed, Quantity
from ...theory.resolution import FieldTransfer
from ...theory.stop_images import MicrolensImages
from ...theory.tube import WIDTHS, unsaid_bore
from ...tolerancing.metrics import of_cameras
from ...tolerancing.places import short_name
from ...tolerancing.result import MANY, of_builds, share_that_meets, yield_of_all
from ...tolerancing.trials import first_builds, lengths_built
from ...traced.fields import IdealImages
from ...words import ROUNDING, clauses, listed, number
from ..blocks import Block, Figure, Paragraph, Report, Section, Table
from ..design.curves import KnownLengths
from ..design.figures import depth_figure, dimensions_sheet
from ..design.parts_list import named_parts
from ..lens_words import lens_words
from ..tolerance.pages import impossible_words, interval_words, limits_words, set_words
from .resolution import mtf_curves, resolution_map

if TYPE_CHECKING:
    from ...design import Design
    from ...theory.length_covariance import CalibratedLengths, LengthCovariance
    from ...tolerancing.study import TolerancePlan
    from ...tolerancing.summaries import Variant

SCHEMA = "roslf.datasheet/1"
CSV_KEYS = ("subject", "name", "value", "unit", "two_sigma", "calibration_two_sigma", "text", "remark")
"""Columns of a sheet as CSV."""
SIGMAS = 2.0
KINK = 1e-6
"""Part of the builds' spread below which derivatives have missed it."""
FEW = 48
"""Builds that tell the scatter of lines at a distance or a field, to a tenth; a view's MTF takes 10 ms of each."""
USABLE = (
    "Finest detail that shows as what it is: the coarser of what still has half its contrast (MTF 50 %) and of half a "
    "period a microlens, above which detail aliases."
)
DEPTH, EXPECTED = "Depth noise (bound), 1 σ", "Depth, expected"
LEADS = "expanded uncertainty U"
"""Beginning of the name of the line that leads them."""
IN_FOCUS = "in the focal plane"
"""Distance of those that name no other."""
ALIKE = 1e-4
"""Relative difference to which two depths on the sheet, of four digits, are one."""
SHARP = f"Sharp: {CRITERION}."
SMALL = 0.1
"""Length below which micrometres are printed, as `words.length` has them [mm]."""
NO_DISTORTION = 0.01
"""Distortion below which no cause is named [%]."""
BY_DEFINITION = "ideal lens: by definition"
"""Remark on a number that says nothing of the lens that is bought."""
UNLIT = "the corner is {}; this is the farthest field on this sheet that is not"
"""Remark on a number that is not of the corner."""
PARTS, REQUIRED, HEAD = "parts", "Required", "This sheet"
SPECIFIED, RESOLVED = 0.1, 10.0
"""Share of a calibrated sheet's lines that is done once values are known, and what one of resolution takes more than
others, about."""
NONE = "–"
"""Revision or date where none is given."""
NOMINAL = "Nominal values, but where a line says built or calibrated: no tolerance study is at hand."
LOOKED = "Nominal values, but where a line says built or calibrated: to default tolerances, studied below, not yours."
TILTED = "Parts are tilted; the data sheet is of the straight ones, but for what tilted stops cut."


class _SheetLine(NamedTuple):
    """A line of the data sheet."""

    subject: str
    name: str
    value: float | None
    """Value; None: text alone, or nothing that is finite."""
    unit: str
    remark: str = ""
    quantity: str = ""
    """The quantity that a tolerance study tells the scatter of."""
    text: str = ""
    """Instead of a number."""
    of: Callable[[Camera], Array] | None = None
    """Function for the values of builds, where the line is no quantity of a whole camera but at a distance or a
    field."""

    @property
    def of_views(self) -> bool:
        """Whether it takes pixels for views; what is required stays, met or not."""
        if self.subject == REQUIRED:
            return False
        subjects = ("Distances", EXPECTED, DEPTH, "Object field", "Resolution", "Colours")
        if self.subject.startswith(subjects) or self.name == "object samples":
            return True
        return self.quantity != "" and QUANTITIES[self.quantity].of_views

    @property
    def key(self) -> str:
        """Key of the line's scatter."""
        return self.quantity or f"{self.subject}: {self.name}"

    def values(self, builds: Camera) -> Array:
        """Values of builds; NaN where there is none."""
        assert self.of is not None
        return np.broadcast_to(self.of(builds), builds.shape)


class BuildSpread(NamedTuple):
    """Spread of the builds of a tolerance study."""

    plan: TolerancePlan
    final: Variant
    """After adjustment, where anything is adjusted."""
    target: float
    """Yield that the study is to reach."""

    def deviations(self, rows: Iterable[_SheetLine]) -> dict[str, float]:
        """Standard deviations by a line's key: over all builds where the study has it, or over the first of them."""
        deviations = {column.label: column.deviation for column in self.final.distributions}
        (builds, good), (some, _) = (first_builds(self.plan, count) for count in (MANY, FEW))
        images: dict[tuple[Place, Place], MicrolensImages] = {}
        for line in rows:
            if line.key in deviations or not (line.quantity or line.of):
                continue
            with np.errstate(all="ignore"):  # of builds that are no cameras
                if line.quantity:
                    whole = of_cameras(self.plan.question.design, QUANTITIES[line.quantity], builds.camera)
                    values = np.broadcast_to(whole, good.shape)
                elif isinstance(line.of, _Corner):
                    if line.of.ends not in images:
                        images[line.of.ends] = first_builds(self.plan, FEW, line.of.ends)[0]
                    values = line.of.over(images[line.of.ends])
                else:
                    values = line.values(some.camera)
            values = values[good[: values.size]]
            if values.size > 1 and np.isfinite(values).all():  # an end at infinity, or none, has no spread
                deviations[line.key] = float(np.std(values, ddof=1))
        return {key: deviation for key, deviation in deviations.items() if math.isfinite(deviation)}

    def judged(self, one: Requirement) -> Requirement:
        """Requirement with the share of builds that meet it, and its outcome by that."""
        meeting, remedy = share_that_meets(self.plan, self.final, one), one.remedy
        if meeting is None:
            return replace(one, counts=clauses(one.counts, "of the nominal design"))
        words = f"{number(100 * meeting.value, 4)} % of {meeting.trials:,} builds meet it"
        outcome = outcome_of(meeting.value, self.target)
        if one.met and outcome != "met":
            more = f"tighter tolerances or adjustments, for {100 * self.target:.4g} % of builds to meet it"
            bore = unsaid_bore(Camera.of(self.plan.question.design)) if one.quantity in WIDTHS else ""
            remedy = clauses(bore, more, remedy)
        return replace(one, counts=clauses(one.counts, words), by_builds=outcome, remedy=remedy)

    def meeting_all(self, required: Sequence[Requirement]) -> str:
        """Sentence on the builds that meet everything required together; empty where they tell nothing of a design."""
        if not any(map(of_builds, required)):
            return ""
        share = yield_of_all(self.plan, self.final, required)
        lacking = [one.label for one in required if not of_builds(one)]
        without = f" (but {listed(lacking)}, which builds do not tell)" if lacking else ""
        met = number(100 * share.value, 4)
        return f"{met} % of {share.trials:,} builds meet everything required and the study's limits{without}. "


class CalibrationSpread(NamedTuple):
    """Spread that a calibration leaves, or will leave, of one instrument."""

    words: str
    """Description of the calibration, as "as planned"."""
    design: Design
    """Design whose lengths it knows."""
    lengths: CalibratedLengths

    def deviations(
        self, rows: Iterable[_SheetLine], build: LengthCovariance | None, tell: Share = UNHEARD
    ) -> dict[str, float]:
        """Standard deviation that a calibration leaves in the lines, by their keys, to first order.

        Where a build's tolerances are known they are what was known before: none is larger than theirs. `tell` hears
        what share is known.
        """
        design, camera = self.design, Camera.of(self.design)
        known, open_ = self.lengths.after(build)
        covariance = known.plus(open_)
        told = [
            line
            for line in rows
            if line.quantity or not (line.of is None or (design.lens is not None and isinstance(line.of, _Corner)))
        ]
        done = np.cumsum([0.0, *(RESOLVED if isinstance(line.of, _Resolution) else 1.0 for line in told)])
        left = dict[str, float]()
        for line, share in zip(told, (done / done[-1]).tolist(), strict=False):
            tell(share)
            of = partial(of_cameras, design, QUANTITIES[line.quantity]) if line.quantity else line.values
            left[line.key] = float(covariance.carried(camera, of))
        return {name: sigma for name, sigma in left.items() if math.isfinite(sigma)}


class SpreadSources(NamedTuple):
    """Sources of the lines' tolerances: a tolerance study's builds, a calibration."""

    sentences: tuple[str, ...]
    sigma: Mapping[str, float]
    """Standard deviation over builds, by a line's key."""
    calibrated: Mapping[str, float]
    """Standard deviation that a calibration leaves, by a line's key."""
    sheet: Specification
    shown: FieldImages
    rows: tuple[_SheetLine, ...]
    """Every line, in the order of the page."""
    build: LengthCovariance | None = None
    """Covariance of the lengths as built, where a tolerance study gives it."""
    calibration: CalibratedLengths | None = None
    at: tuple[float, ...] = ()
    """Distances ahead of the tip that lines were asked for [mm]."""
    required: tuple[Requirement, ...] = ()
    """Requirements as builds meet them, where a tolerance study gives them."""
    looked: LengthCovariance | None = None
    """Lengths as built to default tolerances, known before a calibration that is planned."""
    planned: CalibratedLengths | None = None
    """Lengths as a calibration that is planned will know them, for required depths and the depths by lengths."""
    target: float | None = None
    """Target yield of the tolerance study, where there is one."""
    set_words: str = ""
    """Words on parts that builds are set by as if perfectly, after a comma."""

    @property
    def design(self) -> Design:
        """The design, that of an instrument where that was calibrated."""
        return self.shown.design

    @property
    def known(self) -> KnownLengths:
        """Knowledge of lengths that depth, expected, is drawn with."""
        return KnownLengths(self.build if self.calibration is None else self.before, self.calibration, self.at)

    @property
    def before(self) -> LengthCovariance | None:
        """Lengths as they are known before a calibration: as built, else to default tolerances."""
        return self.looked if self.build is None else self.build

    @property
    def words(self) -> str:
        """Sentences on the sources, joined."""
        return " ".join(self.sentences)


def _lines(
    shown: FieldImages,
    sheet: Specification,
    budgets: Mapping[float | None, DepthBudget],
    required: Iterable[Requirement],
    traced: bool,
) -> Iterator[_SheetLine]:
    """Lines of the page; budgets of depth are by distance, of the focal plane by None."""
    design = shown.design
    camera = Camera.of(design)
    yield from _required_lines(required)
    pupil, _, tip, *_ = sheet.field_of_view_deg  # of the rays that a real lens lets through
    ways = {"": "diagonal", "width_": "width", "height_": "height"}
    angles = {f"field_of_view_{part}deg": getattr(pupil, way) for part, way in ways.items()}
    angles |= {f"tip_field_of_view_{part}deg": getattr(tip, way) for part, way in ways.items()}
    spans = {}
    if (sensor := shown.dark_beyond) is not None:
        spans = {
            f"field_of_view_{part}deg": f"; the sensor spans {number(getattr(sensor, way), 4)} deg"
            for part, way in ways.items()
            if not math.isclose(getattr(sensor, way), getattr(pupil, way), rel_tol=1e-9)
        }
    for angle in _whole_camera("Field of view", camera, angles):
        ended = angle.quantity.removeprefix("tip_") in spans
        dark = f"lit no farther{spans.get(angle.quantity, '')}" if ended else ""
        yield angle._replace(remark=clauses(dark, angle.remark))
    near, far = sheet.depth_of_field_mm.view
    useful = math.nan if sheet.useful_to_mm is None else sheet.useful_to_mm
    within = WorkingRange(near, far, useful, budgets[None].lengths, full_within(camera))
    yield from _range_lines(within)
    if (assumed := sheet.depth_precision.assumes) is not None:
        told = depth_light(design, camera, within.ends)
        yield _SheetLine("Distances", "light that depth assumes", None, "", told, "", assumed.light)
    yield from _whole_camera("Distances", camera, {})
    yield from _expected_lines(budgets)
    yield from _depth_lines(sheet, traced, shown.outermost == RIM)
    for field in sheet.object_field:
        at = f"at {number(field.at_mm, 4)} mm ({field.plane})"
        focal = field.plane == FOCUS
        plane = None if focal else field.at_mm
        up = f"height {number(field.height_mm, 4)} mm{', lit no farther' if len(spans) > 1 else ''}"
        across = partial(_at_distance, QUANTITIES["field_half_width_mm"], plane, 2.0)
        yield _SheetLine("Object field", f"width {at}", field.width_mm, "mm", up, of=across)
        for quantity, line in _listed("Object field"):
            there = partial(_at_distance, quantity, plane, 1.0)
            name, value = f"{line.label or quantity.label} {at}", float(quantity(camera, field.at_mm))
            own, values = (quantity.name, None) if focal else ("", there)
            yield _SheetLine("Object field", name, value, quantity.unit, line.remark_on(camera), own, of=values)
    for row in sheet.resolution:
        focal = row.plane == FOCUS
        centre = row.x_ml_mm == sheet.field[0].x_ml_mm
        if not (centre or focal):
            continue
        what = "refocused" if row.image == "refocused" else "a view"
        away = _outer(shown.outermost == RIM)[row.x_ml_mm != sheet.field[1].x_ml_mm]
        away += ", outside the lens's field" * (row.x0_mm is None)
        aside = "axis" if centre else away
        at = f"{what}, {number(row.at_mm, 4)} mm ahead ({row.plane}), {aside}"
        dark = "" if row.usable_lp_per_mm is not None else "dark or folded" if traced else "dark"
        axial = focal and centre and row.image == "refocused"
        of = None if axial or dark or traced else _Resolution(row, focal)
        limit = "mtf50_lp_per_mm" if row.limited_by == "contrast" else "fold_lp_per_mm"
        remark, own = "" if dark else row.remark, limit if axial else ""
        yield _SheetLine("Resolution", at, row.usable_lp_per_mm, "lp/mm", remark, own, dark, of)
    yield from _field_lines(shown, sheet, traced)
    answer = lit(FirstAnswer.of(shown, budget=budgets[None]))
    remark = clauses(answer.text, answer.remedy)
    yield _SheetLine("Over the field", "evenly lit", None, "", remark, text="yes" if answer.ok else "no")
    width, height = sheet.pixels
    yield _SheetLine("Sampling", "pixels", None, "", "", text=f"{width} x {height}")
    yield from _whole_camera("Sampling", camera, {})
    samples, lit_of = "{} x {}".format(*sheet.object_samples), ", lit" if spans else ""
    yield _SheetLine("Sampling", "object samples", None, "", f"microlenses that the sensor sees{lit_of}", text=samples)
    if sheet.colours:
        yield from _colour_lines(design, sheet.colours)
    yield from _whole_camera("Body", camera, {})
    yield _SheetLine("Body", PARTS, None, "", _part_words(sheet, camera), text=str(len(sheet.parts)))


def _field_lines(shown: FieldImages, sheet: Specification, traced: bool) -> Iterator[_SheetLine]:
    """Lines on distortion, where the field is lit, and on the light in its corner."""
    camera = Camera.of(shown.design)
    farthest, outermost, middle = corner(sheet.field), shown.shown_last, sheet.field[0]

    def where(angle: float | None) -> str:
        return "in the corner" if angle is None else f"at {number(angle, 4)} deg off axis"

    scale, at = None, where(outermost.angle_deg)
    if outermost.local_magnification is not None and middle.local_magnification is not None:
        scale = outermost.local_magnification / middle.local_magnification if middle.local_magnification else 0.0
    lost = "not seen" if outermost.distortion_percent is None or scale is None else ""
    bent: _Corner | None = _Corner("distortion_percent", (middle.x_ml_mm, outermost.x_ml_mm))
    stretched: _Corner | None = _Corner("local_magnification", (middle.x_ml_mm, outermost.x_ml_mm), against=True)
    shaded = _Corner("relative_illumination", (middle.x_ml_mm, farthest.x_ml_mm), 100.0)
    unlit = "" if outermost == farthest else UNLIT.format("dark or folded" if traced else "dark")
    barrel, bent_by = "below 0 is barrel-shaped", outermost.distortion_percent or 0.0
    against = "against the middle, along the field's radius"
    if not traced and not camera.mapping.bends:
        if camera.chain.bends_rays:
            windows = (
                "of the flat faces of windows (or of their liquid) before the lens: the ideal lens itself has none"
            )
            barrel = clauses(barrel, windows * (abs(bent_by) > NO_DISTORTION))
        else:
            bent = stretched = None
            barrel, against = BY_DEFINITION, f"{against}; {BY_DEFINITION}"
    barrel, against = clauses(barrel, unlit), clauses(against, unlit)
    yield _SheetLine(
        "Over the field", f"distortion {at}", outermost.distortion_percent, "%", barrel, text=lost, of=bent
    )
    yield _SheetLine("Over the field", f"local magnification {at}", scale, "", against, text=lost, of=stretched)
    at, light = where(farthest.angle_deg), 100 * farthest.relative_illumination
    yield _SheetLine("Over the field", f"relative illumination {at}", light, "%", "against the middle", of=shaded)


def _part_words(sheet: Specification, camera: Camera) -> str:
    """Diameters of the parts, of a main lens whose mount is wider its clear one as well."""
    clear = float(camera.cold.D)
    return ", ".join(
        (f"{part.name} of {number(part.diameter_mm, 4)} mm" if part.diameter_mm else f"{part.name}, no diameter stated")
        + f" (D = {number(clear, 4)} mm clear)" * (part.name == "main lens" and clear < 0.999 * part.diameter_mm)
        for part in sheet.parts
    )


def _required_lines(required: Iterable[Requirement]) -> Iterator[_SheetLine]:
    """Lines on what the design file asks for, met or not, with the mark of a warning where met with a reservation."""
    for one in required:
        whole = one.at_mm is None and one.field is None and one.quantity != "u_z_mm"
        of, own = None, one.quantity if whole else ""
        if of_builds(one) and one.at_mm is not None:
            of = partial(_at_distance, QUANTITIES[one.quantity], one.at_mm, 1.0)
        told = [
            f"{MARKS[one.level]} {one.outcome}: {one.both_limits}",
            one.expanded(one.value),
            one.counts,
            one.caution,
        ]
        text = "" if one.value is not None and math.isfinite(one.value) else one.value_words
        yield _SheetLine(REQUIRED, one.label, one.told, one.unit, clauses(*told), own, text, of)


def _outer(rim: bool) -> tuple[str, str]:
    """Places of the field's edge and corner in words; both lie on the rim of a round one, seen otherwise by squares."""
    return (f"{RIM}, along x", f"{RIM}, towards the corner") if rim else ("edge of the field", "corner of the field")


def _range_lines(within: WorkingRange) -> Iterator[_SheetLine]:
    """Lines on both ends of the working range, or that there is none."""
    if within.ends is None:
        yield _SheetLine("Distances", within.label, None, "", within.remark, "", within.value)
        return
    near, far = within.ends
    sharp = "view_depth_of_field_{}_mm"  # whose scatter over builds is an end's where sharpness ends it
    begins, own = within.begins or "where single views are sharp", "" if within.begins else sharp.format("near")
    yield _SheetLine("Distances", f"{within.label}, near", near, "mm", begins, own)
    own = "" if far < within.sharp_to else sharp.format("far")
    yield _SheetLine("Distances", f"{within.label}, far", far, "mm", within.stops, own)


def told_as_planned(grounds: SpreadSources, required: Sequence[Requirement]) -> SpreadSources:
    """Sources with a study of default tolerances behind them, whose lines on required depths are these."""
    told = zip(required, grounds.rows, _required_lines(required), strict=False)
    rows = [new if one.quantity == "u_z_mm" else old for one, old, new in told]
    sentences = tuple(LOOKED if one == NOMINAL else one for one in grounds.sentences)
    return grounds._replace(rows=(*rows, *grounds.rows[len(rows) :]), sentences=sentences)


def _listed(subject: str) -> Iterator[tuple[Quantity, Listed]]:
    for quantity in QUANTITIES.values():
        if quantity.sheet is not None and quantity.sheet.under == subject:
            yield quantity, quantity.sheet


def _whole_camera(subject: str, camera: Camera, known: Mapping[str, float]) -> Iterator[_SheetLine]:
    """Lines of the quantities that are listed under a subject; `known` has values by their names."""
    for quantity, line in _listed(subject):
        value = known[quantity.name] if quantity.name in known else float(quantity(camera))
        missing = math.isnan(value)
        yield _SheetLine(
            subject, line.label or quantity.label, None if missing else value, quantity.unit, line.remark_on(camera),
            quantity.name, "none" if missing else "",
        )  # fmt: skip


def _expected_lines(budgets: Mapping[float | None, DepthBudget]) -> Iterator[_SheetLine]:
    """Lines on what a measured depth is to be believed to, on the axis, in the terms of the GUM."""
    budget = budgets[None]
    u, largest = float(budget.u_z_mm), budget.mostly
    yield _SheetLine(
        EXPECTED,
        f"{LEADS} {IN_FOCUS}, k = {COVERAGE}, {budget.lengths}",
        COVERAGE * u,
        "mm",
        largest,
        "",
        budget.no_depth,
    )
    yield _SheetLine(
        EXPECTED,
        f"standard uncertainty u {IN_FOCUS}, {budget.lengths}",
        u,
        "mm",
        "68 of 100 lie within",
        "",
        budget.no_depth,
    )
    for term in budget.terms:
        if term.u_mm is not None and term.kind == "trueness":
            yield _SheetLine(EXPECTED, f"u {IN_FOCUS} from {term.name}", float(term.u_mm), "mm", term.remark)
    for at, there in budgets.items():
        if at is not None:
            expanded, mostly = float(there.expanded_mm), there.mostly
            yield _SheetLine(EXPECTED, f"U at {number(at, 4)} mm", expanded, "mm", mostly, "", there.no_depth)
    if budget.left_out:
        yield _SheetLine(EXPECTED, "not in it", None, "", budget.left_out, "", "–")


def _depth_lines(sheet: Specification, traced: bool, rim: bool) -> Iterator[_SheetLine]:
    """How well depth is known, at both ends of the working range and over the field in focus.

    Of a round field, whose rim ends it, once where it is alike along x and towards the corner.
    """
    spreads = sheet.depth_precision.spreads
    off: tuple[str, ...] = _outer(rim)
    if rim and math.isclose(spreads[-2].sigma_z_mm, spreads[-1].sigma_z_mm, rel_tol=ALIKE):
        spreads, off = spreads[:-1], (RIM,)
    names = (*("axis" for _ in spreads[len(off) :]), *off)
    kind = FOCUS, "refocused"
    shown = {row.x_ml_mm: row.usable_lp_per_mm for row in sheet.resolution if (row.plane, row.image) == kind}
    middle = shown.get(spreads[0].x_ml_mm)
    for spread, name in zip(spreads, names, strict=True):
        focal, axial = spread.plane == FOCUS, name == "axis"
        of = None
        if not axial:
            of = None if traced else partial(_at_field, QUANTITIES["sigma_z_at_field_mm"], spread.x_ml_mm)
        elif not focal:
            of = partial(_at_distance, QUANTITIES["sigma_z_mm"], spread.at_mm, 1.0)
        there = shown.get(spread.x_ml_mm)
        blurred = traced and not axial and not as_sharp(there, middle)
        told = "" if math.isfinite(spread.sigma_z_mm) and not (blurred and there is None) else "none"
        remark = f"of the thin lens; the real one is not sharp there: {number(there or 0.0, 3)} lp/mm" * blurred
        yield _SheetLine(
            DEPTH, f"at {number(spread.at_mm, 4)} mm ({spread.plane}), {name}", spread.sigma_z_mm, "mm",
            "" if told else remark, "sigma_z_mm" if focal and axial else "", told, of,
        )  # fmt: skip


def _at_field(quantity: Quantity, place: Place, camera: Camera) -> Array:
    (values,) = np.asarray(quantity.at_fields(MicrolensImages(camera, [place])))
    return np.asarray(values)


def _at_distance(quantity: Quantity, at: float | None, factor: float, camera: Camera) -> Array:
    return np.asarray(factor * quantity(camera, at))


@dataclass(frozen=True)
class _Resolution:
    """Resolution at a row's distance, or on each build's own focal plane.

    Where sampling limits the row, a build's contrast is looked at there alone: its whole fall takes ten times as long.
    """

    row: Resolved
    focal: bool

    def _limit(self, transfer: FieldTransfer) -> float:
        fold, half = min(map(transfer.fold, WAYS)), LEVELS[0]
        image = self.row.image
        if self.row.limited_by == "sampling" and all(transfer([fold], image, way)[0] > half for way in WAYS):
            return fold
        ends = [limit for (limit,) in transfer.limits_each_way((half,), image)]
        return math.nan if np.isnan(ends).any() else min(*ends, fold)

    def __call__(self, camera: Camera) -> Array:
        """Values of builds."""
        if Camera.build not in camera.worked_out:  # several rows ask for them
            camera.worked_out[Camera.build] = [camera.build(k) for k in np.ndindex(camera.shape)]
        images = IdealImages(camera, [self.row.x_ml_mm])
        transfers = images.transfers(
            0, focus_ahead(camera) if self.focal else self.row.at_mm, camera.worked_out[Camera.build]
        )
        return np.array(list(map(self._limit, transfers))).reshape(camera.shape)


@dataclass(frozen=True)
class _Corner:
    """A quantity of the field's corner, `against` that of its middle."""

    name: str
    ends: tuple[Place, Place]
    """Middle and corner [mm]."""
    factor: float = 1.0
    against: bool = False

    def over(self, images: MicrolensImages) -> Array:
        """Values of builds at those ends, (T,)."""
        values = np.asarray(QUANTITIES[self.name].at_fields(images), float)
        middle, corner = np.broadcast_to(values, (2, *(images.camera.shape or (1,))))
        return np.asarray(self.factor * corner / (middle if self.against else 1.0))

    def __call__(self, camera: Camera) -> Array:
        """Values of builds behind an ideal lens."""
        return self.over(MicrolensImages(camera, self.ends))


def _colour_lines(design: Design, colours: tuple[Colour, ...]) -> Iterator[_SheetLine]:
    """Lines on a Bayer pattern's effect on pixels, light and depth: of green, the other colours beside."""
    (green,), others = ([one for one in colours if (one.name == "green") is wanted] for wanted in (True, False))
    subject = f"Colours, {design.sensor.colours}"

    def beside(value: Callable[[Colour], float], digits: int = 3) -> str:
        return ", ".join(f"{one.name} {number(value(one), digits)}" for one in others)

    apart = f"{number(green.spacing_px, 3)} px apart; {beside(lambda one: one.views_across)}, 2 px apart"
    across = partial(_in_green, "image_diameter_px", 1 / GREEN.spacing)
    yield _SheetLine(subject, "green pixels across a microlens image", green.views_across, "", apart, of=across)
    folds = partial(_in_green, "fold_lp_per_mm", math.sqrt(GREEN.share))
    detail = f"one pixel of each microlens, half of them green; {beside(lambda one: one.view_fold_lp_per_mm)}"
    yield _SheetLine(subject, "green view aliases above", green.view_fold_lp_per_mm, "lp/mm", detail, of=folds)
    sharp = f"refocused, axis, {number(green.wavelength_nm, 3)} nm; {beside(lambda one: one.mtf50_lp_per_mm)}"
    yield _SheetLine(
        subject,
        "MTF 50 % in green",
        green.mtf50_lp_per_mm,
        "lp/mm",
        sharp,
        of=partial(_in_green, "mtf50_lp_per_mm", 1.0),
    )
    white = f"in white light; {beside(lambda one: one.electrons, 4)}"
    yield _SheetLine(subject, "electrons in a green pixel", green.electrons, "", white, "pixel_electrons")
    every = float(QUANTITIES["sigma_z_mm"](Camera.of(design)))
    noise = noise_words(design.depth.disparity_error is not None)
    alone = f"scene without colours; green alone {number(green.sigma_z_mm, 3)}, {beside(lambda one: one.sigma_z_mm)}"
    yield _SheetLine(subject, f"{noise}, focal plane, all colours", every, "mm", alone, "sigma_z_mm")


def _in_green(name: str, factor: float, camera: Camera) -> Array:
    return np.asarray(factor * QUANTITIES[name](through_filter(camera, GREEN)))


def basis(
    design: Design,
    built: BuildSpread | None = None,
    calibration: CalibrationSpread | None = None,
    at: Sequence[float] = (),
    looked: LengthCovariance | None = None,
    tell: Share = UNHEARD,
) -> SpreadSources:
    """A design's sheet, with what a tolerance study and a calibration know of it, and lines at distances asked for.

    Without a study, a calibration takes the lengths as built to default tolerances, `looked`, as known before.
    `tell` hears what share is known.
    """
    shown = FieldImages.of(design)
    own = None if built is None else lengths_built(built.plan)
    build = looked if own is None else own
    lengths = None if calibration is None else calibration.lengths
    camera = Camera.of(design)
    budget = partial(depth_budget, camera, build=build, calibration=lengths)
    end = 1.0 if calibration is None else SPECIFIED
    sheet, sentences = specification(design, at, shown, budget, part_of(tell, 0.0, end)), []
    budgets = {far: budget(far) for far in (None, *at)}
    required = requirements(shown, camera, budget)
    traced = design.lens is not None  # whose builds are cameras of thin-lens models
    judged = () if built is None else tuple(built.judged(one) for one in required)
    lines = tuple(_lines(shown, sheet, budgets, judged or required, traced))
    rows = tuple(line for line in lines if sheet.has_views or not line.of_views)
    if built is not None:
        share = 100 * built.final.result.value
        sentences.append(
            f"{built.meeting_all(required)}Tolerances are two standard deviations over {built.plan.trials:,} Monte "
            f"Carlo units (builds) of the study {built.plan.name}; yield {share:.2f} % by its own limits (95 % "
            f"interval {interval_words(built.final.result)} %; {limits_words(built.final)}). "
            + (f"{lost} Tolerances are of the others. " if (lost := impossible_words(built.final)) else "")
            + "Lines that the study does not "
            f"report go by the first {MANY} builds, those at a distance or a field by {FEW}."
        )
    if calibration is not None:
        names = ", ".join(short_name(place, design) for place in calibration.lengths.covariance.places)
        others = "" if build is None else ", and over what the tolerances leave open of all others"
        sentences.append(
            f"Uncertainty of one instrument after its calibration, {calibration.words}, is two standard deviations, by "
            f"each line's derivatives over {names}{others}."
        )
        if build is not None and calibration.lengths.planned:
            sentences.append(
                f"{'Default tolerances' if own is None else 'Tolerances'} count as known before it, so that its U is "
                "no larger than by captures alone, which `roslf calibrate --plan` tells beside it."
            )
        if design is calibration.design and not calibration.lengths.planned:
            sentences.append("Values are those of that instrument.")
    first_look = " Lines that say so take lengths as built to default tolerances." if looked is not None else ""
    sentences.append("Lines without one (–) are nominal." if sentences else NOMINAL + first_look)
    sigma = {} if built is None else built.deviations(rows)
    calibrated = {} if calibration is None else calibration.deviations(rows, build, part_of(tell, end, 1.0))
    # Derivatives promise more than builds show where lengths miss by so much that lines bend, and none of a magnitude
    # about 0, as the direction of view.
    for key in calibrated.keys() & sigma.keys():
        calibrated[key] = min(calibrated[key], sigma[key]) if calibrated[key] > KINK * sigma[key] else sigma[key]
        if key in WIDTHS:  # of which no board tells: derivatives halve at what is as wide as the tube leaves
            calibrated[key] = sigma[key]
    told = (sheet, shown, rows, own, lengths, tuple(at), judged, looked)
    target = None if built is None else built.target
    perfect = "" if built is None else set_words(built.plan)
    return SpreadSources(tuple(sentences), sigma, calibrated, *told, target=target, set_words=perfect)


def _value(line: _SheetLine) -> str:
    if line.text:
        return line.text
    assert line.value is not None
    grown, unit = _shown_in(line)
    return f"{_digits(grown * line.value, 4)} {unit}".strip() if math.isfinite(line.value) else number(line.value)


def _shown_in(line: _SheetLine) -> tuple[float, str]:
    """Unit that value and spread of a line are printed in, and how many of it make the line's own.

    That of its limit where one stands beside.
    """
    whole = (REQUIRED, EXPECTED, DEPTH)  # whose limits and tables are in millimetres
    small = line.unit == "mm" and not line.subject.startswith(whole) and 0 < abs(line.value or 0.0) < SMALL
    return (1e3, "um") if small else (1.0, line.unit)


def _spread(line: _SheetLine, sigma: Mapping[str, float]) -> str:
    if line.key not in sigma:
        return "–"
    grown, _ = _shown_in(line)
    # A millionth of the value is what derivatives' steps leave.
    return f"±\N{NO-BREAK SPACE}{_digits(grown * SIGMAS * sigma[line.key], 2, 1e-6 * abs(grown * (line.value or 0.0)))}"


def _digits(value: float, digits: int, zero: float = ROUNDING) -> str:
    """A number as `words.number`, small ones without powers of ten."""
    text = number(value, digits, zero)
    return format(Decimal(text), "f") if "e-" in text else text


def _depths_by_lengths(grounds: SpreadSources) -> Iterator[tuple[str, DepthBudget | None, str]]:
    """Depth, expected, by how lengths are taken: each with when to quote it, or what tells it where it is not known."""
    camera, before = Camera.of(grounds.design), grounds.before
    looked = grounds.build is None and grounds.looked is not None
    calibration = grounds.planned if grounds.calibration is None else grounds.calibration
    as_planned = f", as planned{'; required depths count it' * looked}"
    for lengths, budget, quote, tells in (
        ("as drawn", depth_budget(camera), "compare designs by it; quote it of no camera", ""),
        (
            "as built to default tolerances" if looked else "as built",
            None if before is None else depth_budget(camera, build=before),
            f"quote it of cameras that nobody calibrates{grounds.set_words}"
            + "; by tolerances of a grade, not yours, which a tolerance study's sheet has" * looked,
            "not known here: `roslf datasheet` of a tolerance study has it",
        ),
        (
            "as calibrated",
            None if calibration is None else depth_budget(camera, build=before, calibration=calibration),
            "quote it of a camera after its calibration"
            + (as_planned if grounds.calibration is None else "; the working range and required depths count it"),
            "not known here: `roslf datasheet --calibration` FOLDER (of one made), or planned, tells it",
        ),
    ):
        yield lengths, budget, tells if budget is None else quote


CURVES = 0.55
"""Share of a sheet's pictures that is done when its MTF curves begin."""
CONDITIONS = {"as drawn": "as drawn", "as calibrated": "calibrated"}
"""Depths, expected, by how lengths are taken, in a word; all others are uncalibrated."""


def _answers(grounds: SpreadSources, lead: _SheetLine) -> Iterator[_SheetLine]:
    """Line on depth, expected, that leads, with when to quote it, then those that take lengths otherwise."""
    leads = next(lengths for lengths in ("as drawn", "as built", "as calibrated") if lead.name.endswith(lengths))
    others = []
    for lengths, budget, remark in _depths_by_lengths(grounds):
        if lengths == leads:
            yield lead._replace(remark=f"{lead.remark}; {remark}")
            continue
        value = None if budget is None else float(budget.expanded_mm)
        text = NONE if budget is None else budget.no_depth
        name = f"U {IN_FOCUS}, {CONDITIONS.get(lengths, f'uncalibrated, {lengths}')}"
        others.append(_SheetLine(EXPECTED, name, value, "mm", remark, "", text))
    yield from others


def datasheet_section(grounds: SpreadSources, tell: Share = UNHEARD) -> Section:
    """The page; `tell` hears what share of it is made."""
    columns = (("± 2σ, builds", grounds.sigma), ("± 2σ, calibrated", grounds.calibrated))
    spreads = [column for column in columns if column[1]]
    tables: dict[str, list[tuple[str, ...]]] = {}
    assumed = grounds.sheet.depth_precision.assumes
    noise = f"{noise_words(True).capitalize()}. One standard deviation of one measurement, whatever light and texture."
    if assumed is not None:
        noise = (
            "What photons and read noise alone allow, one standard deviation of one measurement, "
            f"{depth_basis(assumed)}: no instrument reaches it."
        )
        if doubt := full_well_doubt(grounds.design):
            noise += f" Caution: {doubt}."
    where = " ± at the focal plane is wherever a camera has that; elsewhere at the distance itself." if spreads else ""
    captions = {
        REQUIRED: "" if grounds.target is None else outcomes_words(grounds.target),
        "Distances": SHARP,
        EXPECTED: "What a measured depth is to be believed to, on the axis: U, with k = 2, or u, one standard "
        "deviation. The first U leads; those below it take lengths otherwise, and each says when to quote it."
        + (" How far lengths are off is a part of it: it has no ± of its own." if spreads else ""),
        DEPTH: noise,
        "Object field": f"Ends are those of the working range.{where}",
        "Resolution": USABLE + where,
    }
    rows = (_answers(grounds, line) if line.name.startswith(LEADS) else (line,) for line in grounds.rows)
    for line in chain.from_iterable(rows):
        if line.name == PARTS:  # too long for a cell
            captions[line.subject] = f"{line.text} parts: {line.remark}."
            continue
        told = (_spread(line, sigma) for _, sigma in spreads)
        tables.setdefault(line.subject, []).append((line.name, _value(line), *told, line.remark))
    widths, align = (22, 10, *(7 for _ in spreads), 0), f"ld{'l' * len(spreads)}l"
    headings = ("", "value", *(heading for heading, _ in spreads), "")
    blocks: list[Block] = [Paragraph(grounds.words)]
    words = lens_words(grounds.design.main_lens.kind)
    blocks += [Paragraph(text) for text in words.sheet]
    if not grounds.design.aligned:
        blocks.append(Paragraph(TILTED))
    for subject, cells in tables.items():
        first = subject == next(iter(tables))
        title = f"{noise_words(True).capitalize()}, 1 σ" if (subject, assumed) == (DEPTH, None) else subject
        blocks.append(
            Table(
                tuple(cells), align, headings if first else (), title, captions.get(subject, ""),
                widths=widths, dense=True,
            )
        )  # fmt: skip
    if grounds.sheet.focused is not None:
        return Section("Data sheet", (*blocks, focused_table(grounds.sheet.focused)))
    curves = (
        "Contrast of detail at the focal plane, tangential (along the field's radius) and sagittal: diffraction at the "
        "pupil as the stops cut it, at microlenses, their width, the pixel, defocus. Detail beyond the dashed line is "
        "sampled less than twice a period and aliases."
    ) + words.curves
    drawn = resolution_map(grounds.design, grounds.at, part_of(tell, 0.0, CURVES))
    tell(CURVES)
    mapped = (
        "Detail that the image refocused to each distance shows with half its contrast; the lower of tangential and "
        "sagittal. "
    ) + (
        f"Fields lie along a diagonal, detail along and across it, where {grounds.design.microlens_array.lens_shape} "
        "microlenses may pass other detail than along their rows. Lines, where any are drawn, join equal resolution."
        if len(drawn.panels) > 1
        else "To a tenth it is alike at every field that has light."
    )
    blocks += [
        Figure.of("mtf", "MTF", curves, mtf_curves(grounds.design, grounds.shown.images)),
        Figure.of("resolution-map", "Resolution over distance and field", mapped, drawn),
    ]
    return Section("Data sheet", tuple(blocks))


def check_revision(revision: str) -> str:
    """Revision as it is; refused where it is no text on one line."""
    expect(revision, "revision", str, 'the revision as text, as "B"')
    if not (revision.strip() and revision.isprintable()):
        raise refusal("revision", f'{json.dumps(revision)} is no revision; give text on one line, as "B"')
    return revision


def sheet_title(name: str, revision: str) -> str:
    """Title of a sheet: its design's name, and the revision where it has one."""
    return name if revision == NONE else f"{name}, revision {revision}"


def title_written(content: bytes) -> str:
    """Title of a sheet that was written as JSON or CSV; empty of anything else."""
    try:
        if content.startswith(b"{"):
            return sheet_title(*map(json.loads(content).__getitem__, ("design", "revision")))
        rows = csv.reader(io.StringIO(content.decode()))
        head = {row[1]: row[CSV_KEYS.index("text")] for row in rows if row[:1] == [HEAD]}
        return sheet_title(head["design"], head["revision"])
    except (KeyError, IndexError, ValueError, RecursionError, csv.Error):
        return ""


def datasheet_report(grounds: SpreadSources, revision: str = NONE, date: str = NONE, tell: Share = UNHEARD) -> Report:
    """The sheet alone: which design in which revision, on every page, fields to sign, the lines, its drawing.

    Behind it, in an annex, tables and pictures that explain the lines. `tell` hears what share is made.
    """
    design, section = grounds.design, datasheet_section(grounds, tell)
    views, known = grounds.sheet.has_views, grounds.known
    head = sheet_head(design, revision, date)
    behind = [block for block in section.blocks if isinstance(block, Figure) or _explains(block)]
    lines = [block for block in section.blocks if block not in behind]
    if views:
        behind.append(depth_figure(design, known, tall=250.0))
    signed = Section(section.title, (head, signatures(), *lines, dimensions_sheet(design)))
    annex = (Section("Annex", tuple(behind)),) if behind else ()
    which = ", ".join(f"{what} {value.split()[0]}" for what, value in head.rows[1:4] if value != NONE)
    return Report(sheet_title(design.name, revision), design.source, (signed, *annex), f"{design.name}; {which}")


def _explains(block: Block) -> bool:
    """Whether a table of lines explains others, and stands behind those that are signed."""
    return isinstance(block, Table) and block.title.startswith(("Depth noise", "Object field", "Colours"))


def sheet_head(design: Design, revision: str, date: str) -> Table:
    """Which design in which revision a page to sign is of, and of what day."""
    about = f"{_fingerprint(design)} (sha256 of the design as roslf writes it)"
    head = [("design", design.name), ("revision", revision), ("hash of the design", about), ("date", date)]
    if named := named_parts(design):
        head.append(("parts named", "; ".join(f"{words} ({place})" for place, words in named)))
    return Table(tuple(head), "ll", title=HEAD, dense=True, widths=(24, 0))


def signatures() -> Table:
    """Fields to sign."""
    line = 36 * "."
    signed = tuple((role, line, line, line) for role in ("prepared", "checked", "approved"))
    return Table(signed, "llll", ("", "name", "signature", "date"), "Signed")


def _fingerprint(design: Design) -> str:
    """First digits of the hash of a design as its file is written."""
    return hashlib.sha256(dumps(design).encode()).hexdigest()[:12]


def datasheet_json(grounds: SpreadSources, revision: str = NONE) -> dict[str, Any]:
    """The lines with their tolerances, and the specification."""
    rows = [
        {
            "subject": line.subject,
            "name": line.name,
            "value": line.value if line.value is not None and math.isfinite(line.value) else None,
            "text": _value(line),
            "unit": line.unit,
            "two_sigma": None if line.key not in grounds.sigma else SIGMAS * grounds.sigma[line.key],
            "calibration_two_sigma": (
                None if line.key not in grounds.calibrated else SIGMAS * grounds.calibrated[line.key]
            ),
            "quantity": line.quantity or None,
            "remark": line.remark,
        }
        for line in grounds.rows
    ]
    head = {
        "schema": SCHEMA,
        "design": grounds.design.name,
        "design_hash": _fingerprint(grounds.design),
        "revision": revision,
        "basis": grounds.words,
    }
    depths = [
        {
            "lengths": lengths,
            "u_z_mm": None if budget is None else plain(float(budget.u_z_mm)),
            "expanded_mm": None if budget is None else plain(float(budget.expanded_mm)),
            "remark": remark,
        }
        for lengths, budget, remark in (_depths_by_lengths(grounds) if grounds.sheet.has_views else ())
    ]
    return {**head, "lines": rows, "depth_by_lengths": depths, "specification": grounds.sheet.to_dict()}


def datasheet_csv(grounds: SpreadSources, revision: str = NONE) -> bytes:
    """The lines as a table that spreadsheets read, after rows on which sheet it is."""
    data = datasheet_json(grounds, revision)
    head = [{"subject": HEAD, "name": name, "text": data[name]} for name in ("design", "revision")]
    return csv_bytes([CSV_KEYS, *([line.get(key) for key in CSV_KEYS] for line in (*head, *data["lines"]))])
