"""A design's report: verdicts first, then tables and figures, what studies found of it, and what stands behind all."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

from ...accuracy.table import QUANTITIES, choose, shipped_table
from ...bore.elements import AnyElement
from ...camera import Camera
from ...design import Design, MainLens, MicrolensArray, Sensor, dumps
from ...design.files import WRITTEN
from ...design.parts import Opening
from ...evaluation import evaluate
from ...evaluation.evaluate import evaluation_accuracy, held_as_planned, held_to
from ...evaluation.field_images import FieldImages
from ...evaluation.near_cases import near_cases
from ...evaluation.required import required_distances
from ...evaluation.result import (
    Evaluation,
    absent_effects,
    answer_tables,
    budget_table,
    depth_budget_tables,
    effects_table,
    fact_tables,
    field_table,
    lens_table,
    mapping_table,
    seen_table,
    temperature_table,
)
from ...progress import CountedProgress, shares, silent
from ...theory.colours import PIXEL_FILTERS
from ...theory.depth_budget import depth_budget
from ...units import format_quantity
from ...words import TERMS, listed, sentence, spaced
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
from ..lens_words import lens_words
from ..sheet.lines import SpreadSources, basis, datasheet_section, told_as_planned
from . import figures as sheets
from .curves import KnownLengths
from .parts_list import parts_section

TONES: dict[str, Tone] = {"good": "good", "limit": "caution", "fault": "bad"}
"""Tone in which each level of verdict is shown."""
WANTED = 1e-6
"""Accuracy that the table of methods shows them for."""
HARD_CASES = 5
"""Listed, nearest first."""
MODEL = (
    "Microlenses are pinholes at the focal plane's image; their finite aperture, defocus and diffraction are sized "
    "under Effects and not drawn.",
    "Stops are thin circular openings; a tube counts by its rims. Walls neither reflect nor scatter.",
    "Light is of one wavelength, the scene white and at the focal plane unless a figure says otherwise.",
    "Geometry is paraxial in the closed forms; an ideal lens makes it exact at any field, so traced rays agree.",
)
"""True of every report."""


WARMTH = (
    "Lengths between parts grow as the housing, glass as glass, and the indices follow the temperature; the camera has "
    "it all over, and nothing is refocused."
)


STUDIES = ("optimisation", "tolerances", "calibration")
"""Studies that a report may hold findings of, in their order."""


def design_report(
    design: Design,
    *,
    findings: Mapping[str, Finding] | None = None,
    grounds: SpreadSources | None = None,
    opening: tuple[Block, ...] = (),
    command: str = "",
    stamp: tuple[str, ...] = (),
    accuracy: float | None = None,
    progress: CountedProgress = silent,
) -> Report:
    """Everything that closed forms, traced rays and studies say of a design, as sections of text, tables and figures.

    Parameters
    ----------
    design : Design
    findings : mapping, optional
        What studies found of it, by `STUDIES`.
    grounds : SpreadSources, optional
        Of its data sheet and of depth as expected, where a study knows tolerances or a calibration is at hand.
    opening : tuple of Block
        Stands before the verdicts: what was asked.
    command : str
        What reproduces the report; empty leaves it out.
    stamp : tuple of str
        Lines on when and with what it was made; none by default, so that the same design gives the same bytes.
    accuracy : float, optional
        What shares of light may be off by, as for `evaluate`.
    progress : callable
        Told what is being made.

    Raises
    ------
    InputError
        A design that cannot be evaluated.
    """
    progress("evaluating")
    studied = [findings[name] for name in STUDIES if name in findings] if findings else []
    grounds = grounds or basis(design)
    shown = grounds.shown if grounds.design is design else FieldImages.of(design)
    wanted = sorted({*grounds.at, *required_distances(design, math.inf)})
    result = evaluate(
        design, None, accuracy, at=wanted, build=grounds.build, calibration=grounds.calibration, shown=shown
    )
    if findings and "calibration" in findings:
        grounds = grounds._replace(planned=findings["calibration"].lengths)
    looked = grounds.looked
    if looked is not None and grounds.build is None and grounds.calibration is None and result.has_views:
        result = held_as_planned(result, shown, looked, grounds.planned)
        grounds = told_as_planned(grounds, result.required)
    if grounds.required:
        result = held_to(result, grounds.required)
    known = grounds.known
    figures = _design_figures(design, result, known, progress)
    progress("sections")
    said = (*verdicts(result).items, *(one.statement for one in studied if one.statement))
    answers = Statements(tuple(sorted(said, key=lambda one: one.tone != "bad")))
    first: list[Block] = [answers, sheets.glance(design, result.has_views, known)]
    if opening:  # with what was asked, a story's many answers would push the picture off the first page
        first.reverse()
    twin = "" if result.real_lens is None else " of the thin-lens model"
    space = ("plane", "depth") if result.has_views else ("plane",)
    parameters = Table(tuple(parameter_rows(design)), "lldl", ("symbol", "what", "value", ""))
    sections = (
        Section(
            "Summary",
            (*opening, *first, *answer_tables(result, *_with_lengths(grounds))),
        ),
        datasheet_section(grounds, shares(progress, "data sheet")),
        Section("The design", (parameters, figures["dimensions"], *_given(seen_table(result)), *_stops(design))),
        parts_section(design),
        Section(
            "Evaluation",
            (
                *fact_tables(result),
                *_given(mapping_table(result)),
                field_table(result),
                _ray_budget(result),
                *depth_budget_tables(result),
            ),
        ),
        *_temperature(result),
        Section("Rays", (figures["rays"], figures["cells"], figures["view"])),
        Section(f"Microlens images{twin}", (figures["images"], figures["waves"], figures["maps"])),
        *_real_lens(design, result, progress),
        Section(f"Design space{twin}", tuple(figures[name] for name in space if name in figures)),
        Section("Effects", (figures["effects"], *_effects(result))),
        *(one.section for one in studied),
        _accuracy_section(design, result, accuracy),
        Section("Assumptions and what was left out", _assumptions(design, result)),
        Section("Terms", (Table(tuple(TERMS.items()), "ll", ("term", "what it is"), widths=(18, 0), dense=True),)),
        making(command, tuple(one.seed for one in studied if one.seed), stamp, design),
    )
    return Report(design.name, design.source, sections)


def _ray_budget(result: Evaluation) -> Block:
    """Table of the ray budget, or a sentence where nothing takes any light."""
    parts = [part for field in result.fields for part in field.ray_budget.taken() if part[0] != "FAP"]
    if any(abs(share - (name == "own cell")) > 5e-5 for name, share in parts):
        return budget_table(result)
    return Paragraph("Ray budget: all rays that fill the pupil reach their microlens's own pixels.")


def _with_lengths(grounds: SpreadSources) -> tuple[str, str]:
    """U in the focal plane as calibrated by the plan, and uncalibrated, in words; empty where it is not known."""
    camera, build, planned = Camera.of(grounds.design), grounds.before, grounds.planned
    after = None if planned is None else depth_budget(camera, build=build, calibration=planned)
    before = None if build is None else depth_budget(camera, build=build)
    u, bare = ("" if budget is None else budget.expanded_words("± ") for budget in (after, before))
    return u, bare


def _design_figures(
    design: Design, result: Evaluation, known: KnownLengths, progress: CountedProgress
) -> dict[str, Figure]:
    """The figures of every design, by name, but for the plane of pupils where the scene sees none in it."""
    figures = {}
    for number, (name, make) in enumerate(sheets.SHEETS.items()):
        if name == "plane" and (design.aperture.behind or 0.0) >= design.f:
            continue
        progress("figures", number, len(sheets.SHEETS))
        figures[name] = sheets.depth_sheet(design, result, known) if name == "depth" else make(design, result)
    return figures


def verdicts(result: Evaluation, prefix: str = "") -> Statements:
    """The answers and warnings of an evaluation, each with `prefix` before it."""
    items = [Statement(TONES[v.level], prefix + sentence(v.text), sentence(v.remedy)) for v in result.verdicts]
    return Statements((*items, *(Statement("caution", prefix + sentence(text)) for text in result.warnings)))


def _pupil(design: Design) -> str:
    """Remark on the FAP."""
    outline, words = design.aperture.outline, "the aperture stop's image in object space (flexible angular plane, FAP)"
    return f"{words}; extent along x or y of {outline.words}" if outline.straight else words


def parameter_rows(design: Design) -> list[tuple[str, str, str, str]]:
    """Symbol, meaning, value and remark of every length of a design."""
    mla, relay = design.microlens_array, design.sensor.relay_magnification
    width, height = design.pixels
    lens = lens_words(design.main_lens.kind).remark
    seen, made = Camera.of(design).seen, design.with_own_stop
    D_F, d_3, stop = design.D_F, design.d_3, ""
    if d_3 < 0:
        D_F, d_3 = (float(seen.D_F), float(seen.d_3)) if design.aperture.behind else (D_F, d_3)
        stop = "behind the lens, as the scene sees it"
    if made.aperture.behind is not None:
        stop += f": image of a stop of {made.aperture.outline.words}, {_length(made.aperture.behind)} behind the lens"
    types = f"types of {mla.focal_words}" if mla.focal_lengths else ""
    rows = [
        ("D", "main lens clear aperture", design.D, ""),
        ("f", "main lens focal length", design.f, lens),
        ("d_f", "focal plane in front of the lens", design.d_f, ""),
        ("d_1", "main lens to microlens array", design.d_1, ""),
        ("D_F", "FAP diameter", D_F, _pupil(design)),
        ("d_3", "FAP in front of the lens", d_3, stop),
        ("d", "microlens pitch", design.d, f"{mla.layout} array, {mla.lens_shape} lenses"),
        ("f_ml", "microlens focal length", design.f_ml, types),
        ("d_2", "microlens array to sensor", design.d_2, ""),
        ("q", "pixel pitch", design.q, f"{width} x {height} px"),
        ("λ", "wavelength", design.wavelength, ""),
    ]
    notes = [] if relay == 1 else [f"behind a relay of magnification {relay:g}"]
    notes += [own.words] if (own := PIXEL_FILTERS[design.sensor.colours]).kinds else []
    sizes = [
        ("", "microlens array", " x ".join(_length(side) for side in mla.size), ""),
        ("", "sensor", " x ".join(_length(side) for side in design.sensor.size), ", ".join(notes)),
    ]
    return [*((symbol, name, _length(value), remark) for symbol, name, value, remark in rows), *sizes]


def misalignments(design: Design) -> list[tuple[str, str]]:
    """Parts that are decentred, tilted or turned, and by how much."""
    parts: dict[str, MainLens | MicrolensArray | Sensor | Opening | AnyElement] = {
        "main lens": design.main_lens,
        "FAP": design.aperture,
        "microlens array": design.microlens_array,
        "sensor": design.sensor,
        **{at.name: at.part for at in design.in_bore},
    }
    moved = [(name, _pose(part)) for name, part in parts.items() if _pose(part) != "-"]
    if design.microlens_array.rotation:
        moved.append(("microlens array, rotation", format_quantity(design.microlens_array.rotation, "angle")))
    return moved


def _accuracy_section(design: Design, result: Evaluation, asked: float | None = None) -> Section:
    """How far the numbers can be trusted: the method behind each, its expected error, and hard cases near by.

    `result` is of the design at its default fields, evaluated to the accuracy `asked`.
    """
    table = shipped_table()
    rows = []
    for quantity, meaning in QUANTITIES.items():
        if not table.of(quantity) or quantity in lens_words(design.main_lens.kind).unmeasured:
            continue  # not measured yet, or not of this design
        choice = choose(quantity, WANTED, table)
        expected = "rounding, below 1e-12" if choice.expected_error < 1e-12 else f"{choice.expected_error:.1e}"
        rows.append((quantity, choice.method, expected, meaning))
    methods = Table(
        tuple(rows),
        "llll",
        ("quantity", "method", "expected error", "what the error means"),
        "Methods and their errors",
        f"The cheapest method that keeps {WANTED:g} at the sensor's corner, by errors measured against slow, "
        "independent references; an error of rounding means exact within the model. `roslf accuracy` "
        "shows error against time.",
    )
    cases = near_cases(design)
    distances = Table(
        tuple((case.case, f"{case.distance:.2g}", "near" if case.near else "") for case in cases[:HARD_CASES]),
        "ldl",
        ("hard case", "relative distance", ""),
        "Where textbook formulas would lose digits",
        "Near means below 0.01. The forms used here hold up to the singular points: within 4 ulp times (1 + condition "
        "number).",
    )
    own = evaluation_accuracy(design, result, asked)
    closest = f"the closest is {cases[0].case}, at a relative distance of {cases[0].distance:.2g}"
    said = [Statement("caution" if own.kept is False else "plain", sentence(own.sentence()))]
    said += [
        Statement("plain", f"Near a hard case, {case.case} ({_distance(case.distance)}): {case.says}.")
        for case in cases
        if case.near
    ] or [Statement("good", f"The design is near no hard case; {closest}.")]
    return Section("Accuracy", (Paragraph(result.method), Statements(tuple(said)), methods, distances))


def _distance(relative: float) -> str:
    return "to the last digits" if relative < 1e-9 else f"relative distance {relative:.2g}"


def making(command: str, seeds: tuple[str, ...], stamp: tuple[str, ...], design: Design | None = None) -> Section:
    """How a report was made, and how it is made again."""
    blocks: list[Block] = [Bullets((*seeds, *stamp))] if seeds or stamp else []
    if command:
        blocks.append(Code(command, "The command that makes this report again"))
    if design is not None:
        blocks.append(Code(_short_lists(dumps(design, WRITTEN)), "The design, as a file"))
    return Section("How this report was made", tuple(blocks))


def _short_lists(text: str) -> str:
    """TOML with lists of a few values on one line each, as people write them."""

    def joined(match: re.Match[str]) -> str:
        line = f"[{' '.join(match[1].split())}".removesuffix(",") + "]"
        return line if len(line) <= 80 else match[0]

    return re.sub(r"\[\n((?: +[^\s\[\]{}][^\n\[\]{}]*,\n)+) *\]", joined, text)


def _length(value: float) -> str:
    size, unit = format_quantity(value, "length").split()
    if unit == "nm" and float(size) >= 1000:
        size, unit = str(float(size) / 1000), "um"
    return f"{float(size):.7g} {unit}"


def _pose(part: MainLens | MicrolensArray | Sensor | Opening | AnyElement) -> str:
    pairs = [
        ", ".join(format_quantity(value, kind) for value in pair)
        for kind, pair in (("length", part.decentre), ("angle", part.tilt))
        if pair != (0.0, 0.0)
    ]
    return "; ".join(pairs) or "-"


def _given(table: Table | None) -> tuple[Table, ...]:
    return () if table is None else (table,)


def _temperature(result: Evaluation) -> tuple[Section, ...]:
    """The camera at temperatures it meets; nothing of a design that says nothing of them."""
    table = temperature_table(result)
    return () if table is None else (Section("Temperature", (Paragraph(WARMTH), replace(table, title=""))),)


def _stops(design: Design) -> Iterator[Table]:
    """Further stops and misalignments, where there are any."""
    if design.stops:
        rows = tuple(
            (stop.name, stop.part.outline.words, _length(stop.near), _pose(stop.part)) for stop in design.openings[1:]
        )
        headings = ("", "opening", "in front of the lens", "decentre x, y; tilt")
        yield Table(rows, "lddl", headings, "Further stops of the bore")
    moved = misalignments(design)
    if moved:
        yield Table(tuple(moved), "ll", ("part", "decentre x, y; tilt"), "Misalignments")


def _real_lens(design: Design, result: Evaluation, progress: CountedProgress) -> tuple[Section, ...]:
    """Section on the traced lens, its thin-lens model beside it; nothing for an ideal one."""
    if (lens := result.real_lens) is None:
        return ()
    progress("real main lens")
    return (Section("Real main lens", (*sheets.lens_sheets(design, result, lens), lens_table(lens))),)


def _effects(result: Evaluation) -> tuple[Block, ...]:
    absent = absent_effects(result)
    return replace(effects_table(result), title=""), *([Paragraph(absent)] if absent else [])


def _assumptions(design: Design, result: Evaluation) -> tuple[Block, ...]:
    """Assumptions of the report, and the effects that it leaves out."""
    items = [lens_words(design.main_lens.kind).assumed, *MODEL]
    if PIXEL_FILTERS[design.sensor.colours].kinds:
        items.append(
            "Depth noise, depth expected and electrons are those behind the sensor's colour filters, in white light, "
            "a third of its power in each colour; diffraction and resolution are reported for the one wavelength."
        )
    if result.object_space is not None:
        items.append(
            "Liquid, elements before the main lens and glass about the array act by their first order in tables and "
            "drawings: a plate as its thickness over its index."
        )
        if result.object_space.mapping is not None:
            items.append(
                "Before the objective rays go as its mapping says, from where the first order has them in the entrance "
                "pupil, and windows and liquid bend them by Snell's law; behind it all is first order."
            )
    if design.sensor.relay_magnification != 1:
        items.append("The relay to the sensor is ideal: it only scales the pixels.")
    if not design.has_exact_areas:
        items.append(
            "Tilts are traced in the ray diagrams, the 3D view and the table of microlens images over the field; drawn "
            "microlens images and maps are those of FAP, main lens, array and sensor untilted."
        )
    exceeded = [spaced(e.name) for e in result.effects if e.on and abs(e.estimate) > e.budget]
    left = [spaced(e.name) for e in result.effects if not e.on and e.estimate != 0]
    blocks: list[Block] = [Bullets(tuple(items))]
    if exceeded:
        text = f"Above their budgets, so that a simulation of this design must include them: {listed(exceeded)}."
        blocks.append(Paragraph(text))
    if left:
        blocks.append(Paragraph(f"Of some size but below their budgets: {listed(left)}."))
    return (*blocks, Paragraph(result.method))
