"""An evaluation as people read it: tables, in the terminal and in a notebook."""

from __future__ import annotations

import io
import math
from html import escape
from typing import TYPE_CHECKING

from ..effects.lens import EFFECTS
from ..tables import Table, plain_text, print_table
from ..words import fixed, length, number, place, spaced

if TYPE_CHECKING:
    from rich.console import Console

    from ..effects.plan import PlannedEffect
    from .result import Depth, DepthAssumptions, Evaluation, RealLens, SeenPart

MARKS = {"good": "✓", "limit": "~", "fault": "✗"}
"""Sign of each level of verdict."""
COLOURS = {"good": "green", "limit": "yellow", "fault": "red"}
LENS_EFFECTS = {effect.name for effect in EFFECTS}
WIDTHS = (18, 15, 0)
"""Widths of the columns of the tables of facts, on pages."""
LEAST = (30, 14, 0)
"""Least widths of these columns on a terminal [characters]."""


def fact_tables(result: Evaluation) -> list[Table]:
    """Quantity, value with unit and remark, by subject."""
    pupil, f, field, image = result.exit_pupil, result.f_number, result.non_distortion, result.microlens_image
    sampling, depth, wave = result.sampling, result.depth, result.diffraction
    exit_pupil = "image-space telecentric" if pupil.telecentric else f"diameter {number(pupil.diameter_mm)} mm"
    rim = f"pencil to the rim of the {field.limited_by}"
    facts = {
        "Pupils": [
            ("aperture constant H", number(result.aperture_constant), "Eq. 3: d_f/(d_f - d_3)"),
            ("exit pupil behind the lens", f"{number(pupil.distance_from_lens_mm)} mm", exit_pupil),
            ("its vergence at the MLA, 1/L", f"{number(pupil.vergence_at_mla_per_mm)} /mm", "0 where telecentric"),
        ],
        "f-number": [
            ("microlens d_2/d", number(f.microlens), ""),
            ("pupil d_1/(D_F H)", number(f.pupil), "Eq. 8: should equal the microlens's"),
            ("main lens alone d_1/D", number(f.main_lens), "Eq. 9: the traditional match, wrong behind a bore"),
            ("fill factor", number(f.fill_factor, 6), "Eq. 7, exact: image diameter over image pitch"),
            ("mismatch", f"{number(f.mismatch_px)} px", "positive: neighbours overlap"),
        ],
        "Field": [
            ("undistorted object radius", f"{number(field.x0_max_mm)} mm", "Eq. 6, a half-field"),
            ("the same on the MLA", f"{number(field.x_ml_max_mm)} mm", ""),
            ("sensor sees, half width", f"{number(field.field_half_width_mm)} mm", "on the focal plane"),
            ("sensor sees, half diagonal", f"{number(field.field_half_diagonal_mm)} mm", ""),
            ("room at the corner", f"{number(field.room_at_corner_mm)} mm", rim),
        ],
        "Microlens images": [
            ("diameter", f"{number(image.diameter_mm * 1e3)} um", f"{number(image.diameter_px)} px"),
            ("pitch", f"{number(image.pitch_mm * 1e3)} um", "images in reversed order" if image.pitch_mm < 0 else ""),
            ("centre shift", f"{number(image.centre_shift_px_per_microlens)} px per microlens", "Eq. 4"),
        ],
        "Sampling and diffraction": [
            ("views across a microlens image", number(sampling.views_geometric, 4), "pixels"),
            ("independent views per axis", number(sampling.views_independent, 3), "4 N_F: what diffraction leaves"),
            ("Fresnel number of a microlens", number(wave.fresnel_number, 3), "d²/(4 λ d_2)"),
            ("Airy radius on the sensor", f"{number(wave.airy_radius_px, 4)} px", ""),
            ("microlenses across the sensor", str(sampling.lateral_samples), ""),
            ("object sample", f"{number(sampling.object_sample_mm)} mm", "one microlens at the focal plane"),
            ("view baseline", f"{number(sampling.view_baseline_mm)} mm", "one pixel, on the FAP"),
        ],
        "Depth at the focal plane": depth_facts(depth),
    }  # fmt: skip
    if result.real_lens is not None:
        facts["Real main lens, traced"] = _lens_facts(result.real_lens)
    return [Table(tuple(rows), "ldl", title=title, widths=WIDTHS) for title, rows in facts.items()]


def depth_facts(depth: Depth) -> list[tuple[str, str, str]]:
    """Depth precision and what it is told for: name, value, remark."""
    return [
        ("disparity", f"{number(depth.disparity_pitches_per_mm)} pitches/mm", "between the FAP's rims"),
        ("depth precision", f"{number(depth.sigma_z_mm)} mm", depth_remark(depth)),
        *(() if depth.assumes is None else _light_facts(depth.assumes)),
    ]


def depth_remark(depth: Depth) -> str:
    """Remark on the disparity error that a depth precision is given for."""
    error = f"1 sigma, for {number(depth.sigma_disparity_pitches, 3)} pitch of disparity error"
    return error + (", as the design gives it" if depth.assumes is None else ", predicted from:")


def depth_basis(assumed: DepthAssumptions | None) -> str:
    """Light, texture and matching that a depth precision is told for, in words."""
    if assumed is None:
        return "as the design gives it"
    texture = f"a texture of {100 * assumed.contrast:.3g} % rms contrast "
    texture += (
        "in each octave of detail" if assumed.period_mm is None else f"with a period of {length(assumed.period_mm)}"
    )
    return (
        f"for {number(assumed.electrons, 4)} electrons a pixel in {number(1e3 * assumed.exposure_s, 3)} ms, {texture}, "
        f"and {assumed.window:g} x {assumed.window:g} microlenses matched"
    )


def _light_facts(assumed: DepthAssumptions) -> list[tuple[str, str, str]]:
    detail = (
        "in each octave of detail" if assumed.period_mm is None else f"with a period of {length(assumed.period_mm)}"
    )
    lenses = f"{assumed.window:g} x {assumed.window:g}"
    return [
        (
            "light",
            f"{number(assumed.electrons, 4)} e-",
            f"a pixel, in {number(1e3 * assumed.exposure_s, 3)} ms",
        ),
        ("texture, rms contrast", f"{assumed.contrast:.3g}", detail),
        ("microlenses matched", lenses, f"of {assumed.views:.0f} independent views"),
    ]


def _lens_facts(lens: RealLens) -> list[tuple[str, str, str]]:
    thin = f"on the MLA; thin lens, Eq. 6: {number(lens.thin_x_ml_max_mm)} mm"
    return [
        ("lens", lens.lens, ""),
        ("focal length", f"{number(lens.focal_length_mm)} mm", f"back focal {number(lens.back_focal_length_mm)} mm"),
        ("first vertex to the FAP", f"{number(lens.first_vertex_to_fap_mm)} mm", "for a ruler; d_3 is to H"),
        ("last vertex to the MLA", f"{number(lens.last_vertex_to_mla_mm)} mm", "for a ruler; d_1 is from H'"),
        ("undistorted, measured", f"{number(lens.x_ml_max_mm)} mm", thin),
    ]


FAR = 1e9
"""Lengths that are told as infinite: of what stands in a focus, rounding leaves some 1e13 [mm]."""


def seen_table(result: Evaluation) -> Table | None:
    """Table of what light meets beside the main lens; None where all is air."""
    if (through := result.object_space) is None:
        return None
    rows = tuple(
        (
            part.name,
            part.what,
            f"{number(part.distance_mm)} mm",
            "" if part.diameter_mm is None else f"{number(part.diameter_mm)} mm",
            _seen(part),
        )
        for part in through.parts
    )
    medium = f"The scene lies in {through.medium}" + ("." if through.index == 1 else f", index {through.index:.5g}.")
    caption = (
        f"{medium} Distances are a ruler's, before the main lens, of an element to its sensor side; of the MLA behind "
        "the lens, of the sensor behind the MLA. In formulas d_f, d_3, D_F, d_1 and d_2 are as the main lens sees them."
    )
    headings = ("", "what", "distance", "diameter", "as the main lens sees it")
    return Table(rows, "llddl", headings, "Beside the main lens, in the order of light", caption)


def _seen(part: SeenPart) -> str:
    """How it is seen, as far as that differs."""
    pairs = (("", part.distance_mm, part.seen_distance_mm), ("diameter ", part.diameter_mm, part.seen_diameter_mm))
    words = [
        f"{name}{number(apparent)} mm" if abs(apparent) < FAR else f"{name}∞"
        for name, own, apparent in pairs
        if own is not None and apparent is not None and not math.isclose(own, apparent, rel_tol=1e-6)
    ]
    return ", ".join(words)


def temperature_table(result: Evaluation) -> Table | None:
    """The camera at temperatures it meets; nothing of a design that says nothing of them."""
    if (warm := result.temperature) is None:
        return None
    rows = tuple(
        (
            f"{row.temperature_degc:g} °C" + (" (here)" if row.temperature_degc == warm.temperature_degc else ""),
            f"{row.focal_length_mm:.7g} mm",
            f"{row.mla_distance_mm:.7g} mm",
            f"{row.focal_plane_mm:.6g} mm",
            "-" if row.focus_shift_pitches is None else _cell(row.focus_shift_pitches, 3, "+"),
            f"{row.fill_factor:.5f}",
            "yes" if row.fits else "no",
        )
        for row in warm.at
    )
    held = f"housing of {warm.housing}, {1e6 * warm.expansion_per_k:.3g}e-6 /K" if warm.housing else "rigid housing"
    caption = (
        f"The camera as it is focused, in a {held}; disparity between the FAP's rims is that of what is in focus at "
        f"{warm.temperature_degc:g} °C."
    )
    headings = ("temperature", "f", "d_1", "d_f", "disparity [pitches]", "fill factor", "parts fit")
    return Table(rows, "lrrrrrl", headings, "Temperature", caption)


def mapping_table(result: Evaluation) -> Table | None:
    """Table of the effects of the objective's mapping on each field; None where it is f tan."""
    if result.object_space is None or (objective := result.object_space.mapping) is None or not objective.fields:
        return None
    rows = tuple(
        (
            place(field.x_ml_mm),
            f"{field.angle_deg:.2f}",
            fixed(field.distortion_percent, 1, "+"),
            " ".join(number(value) for value in field.object_sample_mm),
            " ".join(number(value) for value in field.sigma_z_mm),
        )
        for field in objective.fields
    )
    headings = ("microlens x, y [mm]", "angle [deg]", "height against f tan [%]", "object sample [mm]", "σ_Z [mm]")
    name = "a measured table" if objective.mapping == "table" else objective.mapping
    caption = (
        f"The objective, {objective.element}, images by {name} up to {objective.largest_angle_deg:.4g} degrees in air. "
        "Samples and depth spread are those on the focal plane, along the field's radius and across it; angles are "
        "those in the medium of the scene."
    )
    return Table(rows, "lrrrr", headings, "The objective's mapping over the field", caption)


def field_table(result: Evaluation) -> Table:
    """The image behind each microlens asked for."""
    rows = (
        (
            place(field.x_ml_mm),
            field.status,
            f"{100 * field.kept_fraction:.4g} %",
            "-" if field.centroid_mm is None else " ".join(_cell(1e3 * v, 2, "+") for v in field.centroid_mm),
            "-" if field.axis_ratio is None else f"{field.axis_ratio:.4f}",
            f"{fixed(100 * field.ray_budget.own_cell, 2)} %",
        )
        for field in result.fields
    )
    headings = ("microlens x, y [mm]", "image", "kept", "centroid [um]", "axis ratio", "in own cell")
    return Table(tuple(rows), "llrrrr", headings, "Microlens images over the field")


def budget_table(result: Evaluation) -> Table:
    """Table of the share of the rays filling the pupil that each element takes, a row a field."""
    budgets = [[part for part in field.ray_budget.taken() if part[0] != "FAP"] for field in result.fields]
    rows = (
        (place(field.x_ml_mm), *(f"{fixed(100 * share, 2)} %" for _, share in budget))
        for field, budget in zip(result.fields, budgets, strict=True)
    )
    names = [name for name, _ in budgets[0]] if budgets else []
    taking = [name if name in ("own cell", "neighbours") else f"lost at {name}" for name in names]
    title = "Ray budget: of the rays that fill the pupil, in the order of light"
    if result.object_space is not None:  # of as many elements as there may be, one row each
        headings = ("microlens x, y [mm]", *(place(field.x_ml_mm) for field in result.fields))
        columns = tuple(
            zip(taking, *([f"{fixed(100 * share, 2)} %" for _, share in budget] for budget in budgets), strict=True)
        )
        return Table(columns, "l" + "r" * len(budgets), headings, title)
    return Table(tuple(rows), "l" + "r" * len(taking), ("microlens x, y [mm]", *taking), title)


def lens_table(lens: RealLens) -> Table:
    """The image behind each microlens asked for, through the real lens."""
    rows = (
        (
            place(field.x_ml_mm),
            field.status if field.chief_ray == "kept" else f"{field.status} ({field.chief_ray})",
            f"{100 * field.kept_fraction:.4g} %",
            "-" if field.shift_px is None else " ".join(_cell(value, 2, "+") for value in field.shift_px),
            _cell(field.widening_percent, 1),
            f"{_cell(field.tangential_focus_pitches, 1, '+')} {_cell(field.sagittal_focus_pitches, 1, '+')}",
            _cell(field.distortion_percent, 2, "+"),
            _cell(field.lateral_colour_pitches, 2),
        )
        for field in lens.fields
    )
    headings = (
        *("microlens x, y [mm]", "image", "kept", "shift x, y [px]", "wider [%]"),
        *("focus tan, sag [pitches]", "distortion [%]", "colour [pitches]"),
    )
    title = "Microlens images through the real lens, against its thin twin"
    return Table(tuple(rows), "llrrrrrr", headings, title)


def effects_table(result: Evaluation) -> Table:
    """The effects plan, without the effects that are zero but those of a real lens; those that are off are faint."""
    rows = tuple(
        (
            spaced(effect.name),
            f"{number(effect.estimate, 3)} {effect.unit}",
            f"{number(effect.budget, 3)} {effect.unit}",
            "on" if effect.on else "off",
            effect.reason,
        )
        for effect in result.effects
        if _told(effect, result)
    )
    faint = tuple(index for index, row in enumerate(rows) if row[3] == "off")
    title = "Effects: what a simulation of this design has to include"
    return Table(rows, "lddll", ("effect", "estimate", "budget", "", "why"), title, faint=faint)


def absent_effects(result: Evaluation) -> str:
    """One sentence on the effects that a picture of a uniform scene, which the plan is for, does not have at all."""
    names = [spaced(effect.name) for effect in result.effects if not _told(effect, result)]
    return f"In a picture of a uniform scene in focus, nothing comes from: {', '.join(names)}." if names else ""


def _told(effect: PlannedEffect, result: Evaluation) -> bool:
    """Whether an effect has a line: it has a size, or a real lens has it and the scene alone hides it."""
    of_lens = result.real_lens is not None and effect.name in LENS_EFFECTS
    return effect.estimate != 0 or effect.on or of_lens


def _cell(value: float | None, decimals: int, sign: str = "") -> str:
    return "-" if value is None else fixed(value, decimals, sign)


def _tables(result: Evaluation) -> list[Table]:
    fields = [field_table(result), budget_table(result)] if result.fields else []
    lens = [] if result.real_lens is None else [lens_table(result.real_lens)]
    behind_elements, mapping, warm = seen_table(result), mapping_table(result), temperature_table(result)
    fields = fields if mapping is None else [mapping, *fields]
    first, last = ([] if table is None else [table] for table in (behind_elements, warm))
    return [*first, *fact_tables(result), *last, *fields, *lens, effects_table(result)]


def print_evaluation(result: Evaluation, console: Console) -> None:
    """Print the verdicts, then the tables."""
    console.print(plain_text(f"{result.design}\n", "bold"))
    for verdict in result.verdicts:
        mark = plain_text(MARKS[verdict.level], COLOURS[verdict.level])
        console.print(mark, plain_text(verdict.text))
        if verdict.remedy:
            console.print(plain_text(f"  → {verdict.remedy}"))
    for warning in result.warnings:
        console.print(plain_text(f"! {warning}", "yellow"))
    for table in _tables(result):
        print_table(table, console, least=() if table.headings else LEAST)
    console.print(plain_text(absent_effects(result), "dim"))
    console.print(plain_text(f"\n{result.method}", "dim"))


def as_text(result: Evaluation) -> str:
    """The printed form without colours."""
    from rich.console import Console

    stream = io.StringIO()
    print_evaluation(result, Console(file=stream, width=118, no_color=True))
    return stream.getvalue()


def as_html(result: Evaluation) -> str:
    """The notebook form: verdicts and tables."""
    lines = [f"{MARKS[v.level]} {escape(v.text)} <em>{escape(v.remedy)}</em>" for v in result.verdicts]
    lines += [f"⚠ {escape(warning)}" for warning in result.warnings]
    parts = [f"<h3>{escape(result.design)}</h3><ul>{''.join(f'<li>{line}</li>' for line in lines)}</ul>"]
    for table in _tables(result):
        head = _html_row(table.headings, "th")
        body = "".join(_html_row(row, "td") for row in table.rows)
        parts.append(f"<h4>{escape(table.title)}</h4><table><thead>{head}</thead><tbody>{body}</tbody></table>")
    parts.append(f"<p>{escape(absent_effects(result))}</p><p>{escape(result.method)}</p>")
    return "".join(parts)


def _html_row(cells: tuple[str, ...], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"
