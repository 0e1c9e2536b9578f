"""The page an engineer signs: a camera in the endoscope standards' terms, each line with what it may miss."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ..evaluation.specification import CRITERION, Specification, specification
from ..pictures.resolution import mtf_curves, resolution_map
from ..tables import csv_bytes
from ..theory.quantities import QUANTITIES
from ..words import number
from .blocks import Block, Figure, Paragraph, Report, Section, Table

if TYPE_CHECKING:
    from ..calibration.lengths import LengthCovariance
    from ..design import Design
    from ..tolerancing.analyses import Variant
    from ..tolerancing.study import TolerancePlan

SCHEMA = "roslf.datasheet/1"
SIGMAS = 2.0
REAL = (
    "The main lens is real; the data sheet is of its thin twin: aberrations and the distortion of the lens stand in "
    "the report's section on it, and resolution is without them."
)
SHARP = f"Sharp: {CRITERION}."
PARTS = "parts"
NOMINAL = "Nominal values: no tolerance study is at hand."
TILTED = "Parts are tilted; the data sheet is of the straight ones."


class SheetLine(NamedTuple):
    """A line of the data sheet."""

    subject: str
    name: str
    value: float | None
    """None: text alone, or nothing that is finite."""
    unit: str
    remark: str = ""
    quantity: str = ""
    """The quantity that a tolerance study tells the scatter of."""
    text: str = ""
    """Instead of a number."""


class AsBuilt(NamedTuple):
    """What a tolerance study's builds tell."""

    plan: TolerancePlan
    final: Variant
    """After adjustment, where anything is adjusted."""

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations, by quantity of the whole camera."""
        return {c.label: c.deviation for c in self.final.distributions if math.isfinite(c.deviation)}


class Known(NamedTuple):
    """What a calibration tells of one instrument, or will."""

    words: str
    """What it is, as "as planned"."""
    design: Design
    """That it knows the lengths of."""
    covariance: LengthCovariance


class Basis(NamedTuple):
    """What the lines' tolerances come from."""

    sentences: tuple[str, ...]
    sigma: Mapping[str, float]
    """Standard deviation over builds, by quantity."""
    calibrated: Mapping[str, float]
    """Standard deviation that a calibration leaves, by quantity."""
    sheet: Specification
    design: Design

    @property
    def words(self) -> str:
        """In sentences."""
        return " ".join(self.sentences)


def lines(design: Design, sheet: Specification) -> Iterator[SheetLine]:
    """Every line, in the order of the page."""
    pupil, *tips = sheet.field_of_view_deg
    names = (("full (diagonal)", "diagonal", ""), ("horizontal", "width", "width_"), ("vertical", "height", "height_"))
    for words, key, part in names:
        yield SheetLine(
            "Field of view", f"from the entrance pupil, {words}", getattr(pupil, key), "deg",
            "ISO 8600-3, method B: the FAP, as the scene sees it" if key == "diagonal" else "",
            f"field_of_view_{part}deg",
        )  # fmt: skip
    for words, key, part in names:
        yield SheetLine(
            "Field of view", f"from the distal tip, {words}", getattr(tips[1], key), "deg",
            f"of what is seen {number(tips[1].at_mm or 0.0, 4)} mm ahead of it" if key == "diagonal" else "",
            f"tip_field_of_view_{part}deg",
        )  # fmt: skip
    yield SheetLine(
        "Field of view", "direction of view", sheet.direction_of_view_deg, "deg", "0 is straight ahead",
        "direction_of_view_deg",
    )  # fmt: skip
    near, far = sheet.working_range_mm
    yield SheetLine(
        "Distances", "working distance", sheet.working_distance_mm, "mm", "tip to focal plane", "working_distance_mm"
    )
    for name, ends, prefix, remark in (
        ("working range", (near, far), "view_", "views sharp"),
        ("depth of field, refocused", sheet.depth_of_field_mm.refocused, "", "sharp with the focal plane"),
    ):
        yield SheetLine("Distances", f"{name}, near", ends[0], "mm", remark, f"{prefix}depth_of_field_near_mm")
        yield SheetLine("Distances", f"{name}, far", ends[1], "mm", "", f"{prefix}depth_of_field_far_mm")
    for name, value, quantity in (
        ("hyperfocal distance", sheet.hyperfocal_mm, "hyperfocal_mm"),
        ("hyperfocal distance of a view", sheet.view_hyperfocal_mm, "view_hyperfocal_mm"),
    ):
        text = "none" if value is None else ""
        yield SheetLine("Distances", name, value, "mm", "nearest focus that is sharp to infinity", quantity, text)
    for k, (field, where) in enumerate(zip(sheet.object_field, ("near", "focal plane", "far"), strict=True)):
        at = f"at {number(field.at_mm, 4)} mm ({where})"
        focal = k == 1
        yield SheetLine("Object field", f"width {at}", field.width_mm, "mm", f"height {number(field.height_mm, 4)} mm")
        quantity = "object_magnification" if focal else ""
        yield SheetLine("Object field", f"magnification {at}", field.magnification, "", "array over object", quantity)
        quantity = "object_sample_mm" if focal else ""
        yield SheetLine("Object field", f"object sample {at}", field.object_sample_mm, "mm", "one microlens", quantity)
    for row in sheet.resolution:
        focal = row.at_mm == sheet.working_distance_mm
        centre = row.x_ml_mm == sheet.field[0].x_ml_mm
        if not (centre or focal):
            continue
        what = "refocused" if row.image == "refocused" else "a view"
        aside = "axis" if centre else f"{number(row.x0_mm, 4)} mm off axis"
        at = f"{what}, {number(row.at_mm, 4)} mm ahead, {aside}"
        dark = "" if row.mtf50_lp_per_mm is not None else "dark"
        own = focal and centre and row.image == "refocused"
        folds = f"10 % at {number(row.mtf10_lp_per_mm or 0.0, 4)}, folds at {number(row.fold_lp_per_mm, 4)} lp/mm"
        yield SheetLine(
            "Resolution, MTF 50 %", at, row.mtf50_lp_per_mm, "lp/mm", "" if dark else folds,
            "mtf50_lp_per_mm" if own else "", dark,
        )  # fmt: skip
    corner = max(sheet.field, key=lambda point: point.x0_mm)
    at = f"at {number(corner.angle_deg, 4)} deg off axis"
    yield SheetLine("Over the field", f"distortion {at}", corner.distortion_percent, "%", "below 0 is barrel-shaped")
    share = (
        corner.local_magnification / sheet.field[0].local_magnification if sheet.field[0].local_magnification else 0.0
    )
    yield SheetLine(
        "Over the field", f"local magnification {at}", share, "", "against the middle, along the field's radius"
    )
    yield SheetLine(
        "Over the field", f"relative illumination {at}", 100 * corner.relative_illumination, "%", "against the middle"
    )
    width, height = sheet.pixels
    yield SheetLine("Sampling", "pixels", None, "", "", text=f"{width} x {height}")
    views = f"pixels across a microlens image; {number(sheet.independent_views_across, 3)} of them independent"
    yield SheetLine("Sampling", "views across", sheet.views_across, "", views, "views_geometric")
    across, up = sheet.object_samples
    yield SheetLine("Sampling", "object samples", None, "", "microlenses that the sensor sees", text=f"{across} x {up}")
    yield SheetLine(
        "Body", "outer diameter", sheet.outer_diameter_mm, "mm", "of the narrowest tube", "outer_diameter_mm"
    )
    yield SheetLine("Body", "length", sheet.length_mm, "mm", "tip to sensor", "total_length_mm")
    parts = ", ".join(f"{part.name} {number(part.diameter_mm, 4)} mm" for part in sheet.parts)
    yield SheetLine("Body", PARTS, None, "", parts, text=str(len(sheet.parts)))


def basis(design: Design, built: AsBuilt | None = None, calibration: Known | None = None) -> Basis:
    """A design's sheet, with what a tolerance study and a calibration know of it."""
    sheet, sentences = specification(design), []
    if built is not None:
        share, (low, high) = 100 * built.final.result.value, built.final.result.interval
        sentences.append(
            f"Tolerances are two standard deviations over {built.plan.trials} builds of the study {built.plan.name}; "
            f"yield {share:.2f} % (95 % interval {100 * low:.2f} to {100 * high:.2f} %)."
        )
    if calibration is not None:
        names = ", ".join(calibration.covariance.places)
        sentences.append(
            f"Uncertainty of one instrument after its calibration, {calibration.words}, is two standard deviations, by "
            f"each line's derivatives over {names}."
        )
    sentences.append("Lines without one are nominal." if sentences else NOMINAL)
    return Basis(
        tuple(sentences),
        {} if built is None else built.deviations,
        {} if calibration is None else uncertain(calibration, lines(design, sheet)),
        sheet,
        design,
    )


def uncertain(calibration: Known, rows: Iterable[SheetLine]) -> dict[str, float]:
    """Standard deviation that a calibration leaves in the lines, by quantity, to first order."""
    names = sorted({line.quantity for line in rows if line.quantity})
    design, covariance = calibration.design, calibration.covariance
    told = {name: float(covariance.carried(design, QUANTITIES[name])) for name in names}
    return {name: sigma for name, sigma in told.items() if math.isfinite(sigma)}


def _value(line: SheetLine) -> str:
    if line.text:
        return line.text
    assert line.value is not None
    return f"{number(line.value, 4)} {line.unit}".strip() if math.isfinite(line.value) else number(line.value)


def _spread(line: SheetLine, sigma: Mapping[str, float], missing: str) -> str:
    if line.quantity not in sigma:
        return missing
    # A millionth of the value is what derivatives' steps leave.
    return f"±\N{NO-BREAK SPACE}{number(SIGMAS * sigma[line.quantity], 2, 1e-6 * abs(line.value or 0.0))}"


def datasheet_section(found: Basis) -> Section:
    """The page."""
    columns = (("± 2σ, builds", found.sigma, "nominal"), ("± 2σ, calibrated", found.calibrated, "–"))
    spreads = [column for column in columns if column[1]] or [("tolerance", {}, "nominal")]
    tables: dict[str, list[tuple[str, ...]]] = {}
    captions = {"Distances": SHARP}
    for line in lines(found.design, found.sheet):
        if line.name == PARTS:  # too long for a cell
            captions[line.subject] = f"{line.text} parts: {line.remark}."
            continue
        rows = tables.setdefault(line.subject, [])
        told = (_spread(line, sigma, missing) for _, sigma, missing in spreads)
        rows.append((line.name, _value(line), *told, line.remark))
    widths, align = (24, 10, *(8 for _ in spreads), 0), f"ld{'l' * len(spreads)}l"
    headings = ("", "value", *(heading for heading, *_ in spreads), "")
    blocks: list[Block] = [Paragraph(found.words)]
    if found.design.lens is not None:
        blocks.append(Paragraph(REAL))
    if not found.design.aligned:
        blocks.append(Paragraph(TILTED))
    for title, rows in tables.items():
        first = title == next(iter(tables))
        blocks.append(
            Table(
                tuple(rows), align, headings if first else (), title, captions.get(title, ""),
                widths=widths, dense=True,
            )
        )  # fmt: skip
    curves = (
        "Contrast of detail at the focal plane, tangential (along the field's radius) and sagittal: diffraction at the "
        "pupil as the stops cut it, at microlenses, their width, the pixel, defocus. Detail beyond the dashed line is "
        "sampled less than twice a period and folds back."
    )
    mapped = (
        "Detail that the image refocused to each distance shows with half its contrast; the lower of tangential and "
        "sagittal. Lines join equal resolution."
    )
    blocks += [
        Figure.of("mtf", "MTF", curves, mtf_curves(found.design)),
        Figure.of("resolution-map", "Resolution over distance and field", mapped, resolution_map(found.design)),
    ]
    return Section("Data sheet", tuple(blocks))


def datasheet_report(found: Basis) -> Report:
    """The page alone."""
    return Report(found.design.name, found.design.source, (datasheet_section(found),))


def datasheet_json(found: Basis) -> dict[str, Any]:
    """The lines with their tolerances, and the specification."""
    told = [
        {
            "subject": line.subject,
            "name": line.name,
            "value": line.value if line.value is not None and math.isfinite(line.value) else None,
            "text": _value(line),
            "unit": line.unit,
            "two_sigma": None if line.quantity not in found.sigma else SIGMAS * found.sigma[line.quantity],
            "calibration_two_sigma": (
                None if line.quantity not in found.calibrated else SIGMAS * found.calibrated[line.quantity]
            ),
            "quantity": line.quantity or None,
            "remark": line.remark,
        }
        for line in lines(found.design, found.sheet)
    ]
    head = {"schema": SCHEMA, "design": found.design.name, "basis": found.words}
    return {**head, "lines": told, "specification": found.sheet.to_dict()}


def datasheet_csv(found: Basis) -> bytes:
    """The lines as a table that spreadsheets read."""
    keys = ("subject", "name", "value", "unit", "two_sigma", "calibration_two_sigma", "text", "remark")
    return csv_bytes([keys, *([line[key] for key in keys] for line in datasheet_json(found)["lines"])])
