"""A design's report: verdicts first, then tables, then figures, then what stands behind them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from .. import __version__
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
    table_groups,
)
from . import sheets
from .assumptions import assumptions
from .blocks import Block, Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table, Tone
from .offscreen import NoPictureError, Rendering
from .scene3d import Name, instrument_scene

if TYPE_CHECKING:
    from ..design import Design, MainLens, MicrolensArray, Sensor, Stop
    from ..evaluation.result import Evaluation

FACTS = (18, 15, 0)
"""Widths of the columns of the evaluation's tables."""
NO_PICTURE = "The 3D view is left out: {reason}."


def design_report(
    design: Design, *, command: str = "", stamp: tuple[str, ...] = (), progress: Callable[[str], None] | None = None
) -> Report:
    """Everything that closed forms and traced rays say of a design, as sections of text, tables and figures.

    Parameters
    ----------
    design : Design
    command : str
        What reproduces the report; empty leaves it out.
    stamp : tuple of str
        Lines on when and where it was made; none by default, so that the same design gives the same bytes.
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
    result = evaluate(design)
    scene = instrument_scene(design)
    try:
        rendering: Rendering | NoPictureError = Rendering(scene.data)
    except NoPictureError as reason:
        rendering = reason
    try:
        figures = _figures(design, result, tell)
        tell("3D view")
        picture = _picture(rendering, scene.names)
    except BaseException:
        if isinstance(rendering, Rendering):
            rendering.cancel()
        raise
    sections = (
        Section("Verdicts", (verdicts(result),)),
        Section("The design", (_parameters(design), *_stops(design))),
        Section("Evaluation", _tables(result)),
        Section("Rays", (figures["rays"], figures["cells"], picture)),
        Section(f"Microlens images{_of_twin(result)}", (figures["images"], figures["waves"], figures["maps"])),
        *_real_lens(design, result, tell),
        Section(f"Design space{_of_twin(result)}", (figures["plane"], figures["depth"])),
        Section("Effects", (figures["effects"], *_effects(result))),
        Section("Assumptions and what was left out", assumptions(design, result)),
        _making(design, command, stamp),
    )
    return Report(design.name, design.source, sections, f"roslf_design {__version__}")


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
    parts: dict[str, MainLens | MicrolensArray | Sensor | Stop] = {
        "main lens": design.main_lens,
        "FAP": design.aperture,
        "microlens array": design.microlens_array,
        "sensor": design.sensor,
    }
    moved = [(name, _pose(part)) for name, part in parts.items() if _pose(part) != "-"]
    if design.microlens_array.rotation:
        moved.append(("microlens array, rotation", format_quantity(design.microlens_array.rotation, "angle")))
    if moved:
        blocks.append(Table(tuple(moved), "ll", ("part", "decentre x, y; tilt"), "Misalignments"))
    return tuple(blocks)


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
        "rays": ("ray diagram", lambda: sheets.ray_sheet(design, result)),
        "cells": ("zoom on the microlens array", lambda: sheets.cells_sheet(design, result)),
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


def _picture(rendering: Rendering | NoPictureError, names: tuple[Name, ...]) -> Block:
    if isinstance(rendering, NoPictureError):
        return Statements((Statement("plain", NO_PICTURE.format(reason=rendering)),))
    try:
        return sheets.picture_sheet(rendering.result(), names)
    except NoPictureError as reason:
        return Statements((Statement("plain", NO_PICTURE.format(reason=reason)),))


def _effects(result: Evaluation) -> tuple[Block, ...]:
    rows = tuple(effect_rows(result))
    faint = tuple(index for index, row in enumerate(rows) if row[3] == "off")
    absent = absent_effects(result)
    return Table(rows, "lddll", EFFECT_HEADINGS, faint=faint), *([Paragraph(absent)] if absent else [])


def _making(design: Design, command: str, stamp: tuple[str, ...]) -> Section:
    blocks: list[Block] = [Bullets((f"roslf_design {__version__}", *stamp))]
    if command:
        blocks.append(Code(command, "The command that makes this report again"))
    blocks.append(Code(dumps(design), "The design, as a file"))
    return Section("How this report was made", tuple(blocks))
