"""A design's report: verdicts first, then tables, then figures, then what stands behind them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from ..design import dumps
from ..design.units import format_quantity
from ..evaluation import evaluate
from ..evaluation.show import (
    EFFECT_HEADINGS,
    FIELD_HEADINGS,
    LENS_HEADINGS,
    absent_effects,
    effect_rows,
    field_row,
    lens_field_row,
    number,
    table_groups,
)
from . import sheets
from .accuracy_statement import accuracy_section
from .assumptions import assumptions
from .blocks import Block, Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table, Tone
from .evidence import Evidence
from .parts_list import length, parts_section

if TYPE_CHECKING:
    from ..design import Design, MainLens, MicrolensArray, Sensor, Stop
    from ..evaluation.result import Evaluation

FACTS = (18, 15, 0)
"""Widths of the columns of the evaluation's tables."""
NONE = Evidence()
FOOTER = "roslf_design"
"""No version: the same design gives the same bytes."""


def design_report(
    design: Design,
    *,
    evidence: Evidence = NONE,
    opening: tuple[Block, ...] = (),
    title: str = "",
    command: str = "",
    seeds: tuple[str, ...] = (),
    stamp: tuple[str, ...] = (),
    accuracy: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Everything that closed forms, traced rays and studies say of a design, as sections of text, tables and figures.

    Parameters
    ----------
    design : Design
    evidence : Evidence
        What studies found of it.
    opening : tuple of Block
        Stands before the verdicts: what was asked.
    title : str
        Instead of the design's name.
    command : str
        What reproduces the report; empty leaves it out.
    seeds, stamp : tuple of str
        Lines on chance, and on when and with what it was made; no stamp by default, so that the same design gives the
        same bytes.
    accuracy : float, optional
        What shares of light may be off by, as for `evaluate`.
    progress : callable, optional
        Told what is being made.

    Returns
    -------
    Report

    Raises
    ------
    InputError
        A design that cannot be evaluated.
    """
    tell = progress or (lambda _: None)
    tell("evaluating")
    result = evaluate(design, accuracy=accuracy)
    figures = _figures(design, result, tell)
    answers = Statements((*verdicts(result).items, *evidence.statements()))
    tell("sections")
    sections = (
        Section("Summary", (*opening, answers, key_figures(design, result))),
        Section("The design", (figures["dimensions"], _parameters(design), *_stops(design))),
        parts_section(design),
        Section("Evaluation", _tables(result)),
        Section("Rays", (figures["rays"], figures["cells"], figures["view"])),
        Section(f"Microlens images{_of_twin(result)}", (figures["images"], figures["waves"], figures["maps"])),
        *_real_lens(design, result, tell),
        Section(f"Design space{_of_twin(result)}", (figures["plane"], figures["depth"])),
        Section("Effects", (figures["effects"], *_effects(result))),
        *evidence.sections(design),
        accuracy_section(design, result, accuracy),
        Section("Assumptions and what was left out", assumptions(design, result)),
        making(command, (*seeds, *evidence.seeds), stamp, design),
    )
    return Report(title or design.name, design.source, sections, FOOTER)


TONES: dict[str, Tone] = {"good": "good", "limit": "caution", "fault": "bad"}
"""How each level of verdict is shown."""


def verdicts(result: Evaluation, prefix: str = "") -> Statements:
    """The answers and warnings of an evaluation, each with `prefix` before it."""
    items = [Statement(TONES[v.level], _sentence(v.text), _sentence(v.remedy)) for v in result.verdicts]
    items += [Statement("caution", _sentence(warning)) for warning in result.warnings]
    return Statements(tuple(Statement(item.tone, prefix + item.text, item.remedy) for item in items))


def _sentence(text: str) -> str:
    # "f-number" and symbols such as d_3 keep their small letter.
    capital = text[:1].upper() + text[1:] if text[:2].isalpha() else text
    return f"{capital}." if text and not text.endswith(".") else capital


def _parameters(design: Design) -> Table:
    return Table(tuple(parameter_rows(design)), "lldl", ("symbol", "what", "value", ""))


def parameter_rows(design: Design) -> list[tuple[str, str, str, str]]:
    """Symbol, meaning, value and remark of every length of a design."""
    mla = design.microlens_array
    width, height = design.pixels
    rows = [
        ("D", "main lens clear aperture", design.D, ""),
        ("f", "main lens focal length", design.f, _lens_name(design)),
        ("d_f", "focal plane in front of the lens", design.d_f, ""),
        ("d_1", "main lens to microlens array", design.d_1, ""),
        ("D_F", "FAP diameter", design.D_F, "flexible angular plane: the entrance pupil"),
        ("d_3", "FAP in front of the lens", design.d_3, ""),
        ("d", "microlens pitch", design.d, f"{mla.layout} array, {mla.lens_shape} lenses"),
        ("f_ml", "microlens focal length", design.f_ml, ""),
        ("d_2", "microlens array to sensor", design.d_2, ""),
        ("q", "pixel pitch", design.q, f"{width} x {height} px"),
        ("λ", "wavelength", design.wavelength, ""),
    ]
    sizes = [
        ("", "microlens array", " x ".join(_length(side) for side in mla.size), ""),
        ("", "sensor", " x ".join(_length(side) for side in design.sensor.size), _relay(design)),
    ]
    return [*((symbol, name, _length(value), remark) for symbol, name, value, remark in rows), *sizes]


def _lens_name(design: Design) -> str:
    return "" if design.lens is None else f"{design.lens.name}, at this wavelength"


def _relay(design: Design) -> str:
    magnification = design.sensor.relay_magnification
    return "" if magnification == 1 else f"behind a relay of magnification {magnification:g}"


def _length(value: float) -> str:
    number, unit = format_quantity(value, "length").split()
    return f"{float(number):.7g} {unit}"


def _stops(design: Design) -> tuple[Block, ...]:
    """Further stops and misalignments, where there are any."""
    blocks: list[Block] = []
    if design.stops:
        rows = [
            (f"stop {k}", _length(stop.diameter), _length(stop.distance), _pose(stop))
            for k, stop in enumerate(design.stops, 1)
        ]
        headings = ("", "diameter", "in front of the lens", "decentre x, y; tilt")
        blocks.append(Table(tuple(rows), "lddl", headings, "Further stops of the bore"))
    moved = misalignments(design)
    if moved:
        blocks.append(Table(tuple(moved), "ll", ("part", "decentre x, y; tilt"), "Misalignments"))
    return tuple(blocks)


def misalignments(design: Design) -> list[tuple[str, str]]:
    """Parts that are decentred, tilted or turned, and by how much."""
    parts: dict[str, MainLens | MicrolensArray | Sensor | Stop] = {
        "main lens": design.main_lens,
        "FAP": design.aperture,
        "microlens array": design.microlens_array,
        "sensor": design.sensor,
    }
    moved = [(name, _pose(part)) for name, part in parts.items() if _pose(part) != "-"]
    if design.microlens_array.rotation:
        moved.append(("microlens array, rotation", format_quantity(design.microlens_array.rotation, "angle")))
    return moved


def _pose(part: MainLens | MicrolensArray | Sensor | Stop) -> str:
    told = []
    for kind, pair in (("length", part.decentre), ("angle", part.tilt)):
        if pair != (0.0, 0.0):
            told.append(", ".join(format_quantity(value, kind) for value in pair))
    return "; ".join(told) or "-"


def _tables(result: Evaluation) -> tuple[Block, ...]:
    blocks: list[Block] = [Table(tuple(rows), "ldl", title=title, widths=FACTS) for title, rows in table_groups(result)]
    fields = tuple(field_row(field) for field in result.fields)
    blocks.append(Table(fields, "llrrrr", FIELD_HEADINGS, "Microlens images over the field"))
    return tuple(blocks)


def _figures(design: Design, result: Evaluation, tell: Callable[[str], None]) -> dict[str, Figure]:
    makers: dict[str, tuple[str, Callable[[], Figure]]] = {
        "dimensions": ("drawing", lambda: sheets.dimensions_sheet(design)),
        "rays": ("ray diagram", lambda: sheets.ray_sheet(design, result)),
        "cells": ("zoom on the microlens array", lambda: sheets.cells_sheet(design, result)),
        "view": ("3D view", lambda: sheets.picture_sheet(design)),
        "images": ("microlens images", lambda: sheets.image_sheet(design, result)),
        "waves": ("microlens image by waves", lambda: sheets.wave_sheet(design)),
        "maps": ("maps over the array", lambda: sheets.map_sheet(design, result)),
        "plane": ("design space", lambda: sheets.plane_sheet(design, result)),
        "depth": ("depth precision", lambda: sheets.depth_sheet(design, result)),
        "effects": ("effects", lambda: sheets.effects_sheet(result)),
    }
    found = {}
    for name, (label, make) in makers.items():
        tell(label)
        found[name] = make()
    return found


def _of_twin(result: Evaluation) -> str:
    return "" if result.real_lens is None else " of the thin twin"


def _real_lens(design: Design, result: Evaluation, tell: Callable[[str], None]) -> tuple[Section, ...]:
    """What the traced lens does, its thin twin beside it; nothing for an ideal one."""
    if result.real_lens is None:
        return ()
    tell("real main lens")
    rows = tuple(lens_field_row(field) for field in result.real_lens.fields)
    fields = Table(rows, "llrrrrrr", LENS_HEADINGS, "Microlens images through the real lens, against its thin twin")
    return (Section("Real main lens", (*sheets.lens_sheets(design, result), fields)),)


def _effects(result: Evaluation) -> tuple[Block, ...]:
    rows = tuple(effect_rows(result))
    faint = tuple(index for index, row in enumerate(rows) if row[3] == "off")
    absent = absent_effects(result)
    return Table(rows, "lddll", EFFECT_HEADINGS, faint=faint), *([Paragraph(absent)] if absent else [])


def key_figures(design: Design, result: Evaluation) -> Table:
    """What the camera is and does, in a handful of numbers."""
    field, sampled, depth = result.non_distortion, result.sampling, result.depth
    front = max(0.0, *(stop.distance for stop in design.all_stops))
    widest = max(design.D, *(stop.diameter for stop in design.all_stops), math.hypot(*design.microlens_array.size))
    rows = (
        ("working distance", length(design.d_f - front), "from the foremost part to the focal plane"),
        ("field there, half width", f"{number(field.field_half_width_mm)} mm", "seen by the sensor's half width"),
        ("room at the corner", f"{number(field.room_at_corner_mm)} mm", "0 is where a rim begins to cut (Eq. 6)"),
        ("object sample", f"{number(sampled.object_sample_mm)} mm", f"{sampled.lateral_samples} microlenses across"),
        (
            "depth spread σ_Z",
            f"{number(depth.sigma_z_mm)} mm",
            f"at the focal plane, for {depth.sigma_disparity_pitches:g} pitches of disparity error",
        ),
        (
            "views across",
            number(sampled.views_independent, 3),
            f"independent, of {number(sampled.views_geometric, 3)} pixels",
        ),
        ("length", length(front + design.d_1 + design.d_2), "foremost stop or lens to sensor"),
        ("widest part", length(widest), "lens, stop openings, or diagonal of the microlens array; without walls"),
    )
    return Table(rows, "ldl", title="Key figures", widths=FACTS)


def making(command: str, seeds: tuple[str, ...], stamp: tuple[str, ...], design: Design | None = None) -> Section:
    """How a report was made, and how it is made again."""
    blocks: list[Block] = [Bullets((*seeds, *stamp))] if seeds or stamp else []
    if command:
        blocks.append(Code(command, "The command that makes this report again"))
    if design is not None:
        blocks.append(Code(dumps(design), "The design, as a file"))
    return Section("How this report was made", tuple(blocks))
