"""An evaluation as people read it: a table in the terminal, HTML in a notebook."""

from __future__ import annotations

import io
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

from ..words import number, spaced

if TYPE_CHECKING:
    from rich.console import Console

    from .result import Evaluation, Field, RealLens, RealLensField

MARKS = {"good": "✓", "limit": "~", "fault": "✗"}
"""Sign of each level of verdict."""
Row = tuple[str, str, str]
"""Quantity, value with unit, remark."""


def table_groups(result: Evaluation) -> Iterator[tuple[str, list[Row]]]:
    """The tables of an evaluation: title, then rows of quantity, value and remark."""
    pupil, f, field, image = result.exit_pupil, result.f_number, result.non_distortion, result.microlens_image
    sampling, depth, wave = result.sampling, result.depth, result.diffraction
    yield (
        "Pupils",
        [
            ("aperture constant H", number(result.aperture_constant), "Eq. 3: d_f/(d_f - d_3)"),
            (
                "exit pupil behind the lens",
                f"{number(pupil.distance_from_lens_mm)} mm",
                "image-space telecentric" if pupil.telecentric else f"diameter {number(pupil.diameter_mm)} mm",
            ),
            ("its vergence at the MLA, 1/L", f"{number(pupil.vergence_at_mla_per_mm)} /mm", "0 where telecentric"),
        ],
    )
    yield (
        "f-number",
        [
            ("microlens d_2/d", number(f.microlens), ""),
            ("pupil d_1/(D_F H)", number(f.pupil), "Eq. 8: should equal the microlens's"),
            ("main lens alone d_1/D", number(f.main_lens), "Eq. 9: the traditional match, wrong behind a bore"),
            ("fill factor", number(f.fill_factor, 6), "Eq. 7, exact: image diameter over image pitch"),
            ("mismatch", f"{number(f.mismatch_px)} px", "positive: neighbours overlap"),
        ],
    )
    yield (
        "Field",
        [
            ("undistorted object radius", f"{number(field.x0_max_mm)} mm", "Eq. 6, a half-field"),
            ("the same on the MLA", f"{number(field.x_ml_max_mm)} mm", ""),
            ("sensor sees, half width", f"{number(field.field_half_width_mm)} mm", "on the focal plane"),
            ("sensor sees, half diagonal", f"{number(field.field_half_diagonal_mm)} mm", ""),
            (
                "room at the corner",
                f"{number(field.room_at_corner_mm)} mm",
                f"pencil to the rim of the {field.limited_by}",
            ),
        ],
    )
    yield (
        "Microlens images",
        [
            ("diameter", f"{number(image.diameter_mm * 1e3)} um", f"{number(image.diameter_px)} px"),
            ("pitch", f"{number(image.pitch_mm * 1e3)} um", ""),
            ("centre shift", f"{number(image.centre_shift_px_per_microlens)} px per microlens", "Eq. 4"),
        ],
    )
    yield (
        "Sampling and diffraction",
        [
            ("views across a microlens image", number(sampling.views_geometric, 4), "pixels"),
            ("independent views per axis", number(sampling.views_independent, 3), "4 N_F: what diffraction leaves"),
            ("Fresnel number of a microlens", number(wave.fresnel_number, 3), "d²/(4 λ d_2)"),
            ("Airy radius on the sensor", f"{number(wave.airy_radius_px, 4)} px", ""),
            ("microlenses across the sensor", str(sampling.lateral_samples), ""),
            ("object sample", f"{number(sampling.object_sample_mm)} mm", "one microlens at the focal plane"),
            ("view baseline", f"{number(sampling.view_baseline_mm)} mm", "one pixel, on the FAP"),
        ],
    )
    yield (
        "Depth at the focal plane",
        [
            ("disparity", f"{number(depth.disparity_pitches_per_mm)} pitches/mm", "between the FAP's rims"),
            (
                "depth precision",
                f"{number(depth.sigma_z_mm)} mm",
                f"1 sigma, for {depth.sigma_disparity_pitches:g} pitch of disparity error",
            ),
        ],
    )

    if result.real_lens is not None:
        yield "Real main lens, traced", _lens_rows(result.real_lens)


def _lens_rows(lens: RealLens) -> list[Row]:
    return [
        ("lens", lens.lens, ""),
        ("focal length", f"{number(lens.focal_length_mm)} mm", f"back focal {number(lens.back_focal_length_mm)} mm"),
        ("first vertex to the FAP", f"{number(lens.first_vertex_to_fap_mm)} mm", "for a ruler; d_3 is to H"),
        ("last vertex to the MLA", f"{number(lens.last_vertex_to_mla_mm)} mm", "for a ruler; d_1 is from H'"),
        (
            "undistorted, measured",
            f"{number(lens.x_ml_max_mm)} mm",
            f"on the MLA; thin lens, Eq. 6: {number(lens.thin_x_ml_max_mm)} mm",
        ),
    ]


LENS_HEADINGS = (
    "microlens x, y [mm]",
    "image",
    "kept",
    "shift x, y [px]",
    "wider [%]",
    "focus tan, sag [pitches]",
    "distortion [%]",
    "colour [pitches]",
)


def lens_field_row(field: RealLensField) -> tuple[str, ...]:
    """One field behind the real lens as cells, in the order of `LENS_HEADINGS`."""
    x, y = field.x_ml_mm
    foci = (field.tangential_focus_pitches, field.sagittal_focus_pitches)
    return (
        f"{x:g}, {y:g}",
        field.status if field.chief_ray == "kept" else f"{field.status} ({field.chief_ray})",
        f"{100 * field.kept_fraction:.4g} %",
        "-" if field.shift_px is None else " ".join(_cell(value, "+.2f") for value in field.shift_px),
        _cell(field.widening_percent, ".1f"),
        " ".join(_cell(value, "+.1f") for value in foci),
        _cell(field.distortion_percent, "+.2f"),
        _cell(field.lateral_colour_pitches, ".2f"),
    )


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else f"{float(f'{value:{form}}') + 0.0:{form}}"  # 0.0 rather than -0.0


def field_row(field: Field) -> tuple[str, ...]:
    """One field as cells: place, status, kept, centroid, axis ratio, own cell."""
    x, y = field.x_ml_mm
    dark = field.centroid_mm is None or field.axis_ratio is None
    centroid = "-" if field.centroid_mm is None else " ".join(f"{1e3 * v:+.2f}" for v in field.centroid_mm)
    return (
        f"{x:g}, {y:g}",
        field.status,
        f"{100 * field.kept_fraction:.4g} %",
        centroid,
        "-" if dark else f"{field.axis_ratio:.4f}",
        f"{100 * field.ray_budget.own_cell:.2f} %",
    )


def budget_table(result: Evaluation) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The ray budget: headings, then a row a field; what each element takes of the rays that fill the pupil [%]."""
    if not result.fields:
        return (), []
    names = [name for name, _ in result.fields[0].ray_budget.taken()]
    taking = [name if name in ("own cell", "neighbours") else f"lost at {name}" for name in names if name != "FAP"]
    rows = []
    for field in result.fields:
        x, y = field.x_ml_mm
        shares = [f"{100 * share:.2f} %" for name, share in field.ray_budget.taken() if name != "FAP"]
        rows.append((f"{x:g}, {y:g}", *shares))
    return ("microlens x, y [mm]", *taking), rows


BUDGET_TITLE = "Ray budget: of the rays that fill the pupil, in the order of light"
FIELD_HEADINGS = ("microlens x, y [mm]", "image", "kept", "centroid [um]", "axis ratio", "in own cell")
EFFECT_HEADINGS = ("effect", "estimate", "budget", "", "why")


def absent_effects(result: Evaluation) -> str:
    """One sentence on the effects that this design and scene do not have at all."""
    names = [spaced(effect.name) for effect in result.effects if effect.estimate == 0 and not effect.on]
    return f"Nothing comes from: {', '.join(names)}." if names else ""


def effect_rows(result: Evaluation) -> Iterator[tuple[str, ...]]:
    """The effects plan as cells, without the effects that are zero."""
    for effect in result.effects:
        if effect.estimate == 0 and not effect.on:
            continue
        yield (
            spaced(effect.name),
            f"{number(effect.estimate, 3, zero=1e-12)} {effect.unit}",
            f"{number(effect.budget, 3)} {effect.unit}",
            "on" if effect.on else "off",
            effect.reason,
        )


def print_evaluation(result: Evaluation, console: Console) -> None:
    """Print the verdicts, then the tables."""
    from rich.table import Table

    console.print(f"[bold]{result.design}[/bold]\n")
    for verdict in result.verdicts:
        colour = {"good": "green", "limit": "yellow", "fault": "red"}[verdict.level]
        console.print(f"[{colour}]{MARKS[verdict.level]}[/{colour}] {verdict.text}", highlight=False)
        if verdict.remedy:
            console.print(f"  → {verdict.remedy}", highlight=False)
    for warning in result.warnings:
        console.print(f"[yellow]! {warning}[/yellow]", highlight=False)
    tables = [Table(title=title, show_header=False) for title, _ in table_groups(result)]
    for table, (_, rows) in zip(tables, table_groups(result), strict=True):
        table.add_column(min_width=30)
        table.add_column(min_width=14, justify="right")
        table.add_column(style="dim")
        for row in rows:
            table.add_row(*row)
    fields = Table(*FIELD_HEADINGS, title="Microlens images over the field")
    for field in result.fields:
        fields.add_row(*field_row(field))
    headings, budgets = budget_table(result)
    budget = Table(*headings, title=BUDGET_TITLE)
    for shares in budgets:
        budget.add_row(*shares)
    effects = Table(*EFFECT_HEADINGS, title="Effects: what a simulation of this design has to include")
    for effect in effect_rows(result):
        effects.add_row(*effect, style=None if effect[3] == "on" else "dim")
    traced = [Table(*LENS_HEADINGS, title="Microlens images through the real lens, against its thin twin")]
    for lens_field in result.real_lens.fields if result.real_lens else ():
        traced[0].add_row(*lens_field_row(lens_field))
    for table in (*tables, fields, *([budget] if budgets else []), *(traced if result.real_lens else ()), effects):
        table.box, table.pad_edge, table.title_justify, table.title_style = None, False, "left", "bold"
        console.print()
        console.print(table)
    console.print(f"[dim]{absent_effects(result)}[/dim]", highlight=False)
    console.print(f"\n[dim]{result.method}[/dim]", highlight=False)


def as_text(result: Evaluation) -> str:
    """The printed form without colours."""
    from rich.console import Console

    stream = io.StringIO()
    print_evaluation(result, Console(file=stream, width=118, no_color=True))
    return stream.getvalue()


def as_html(result: Evaluation) -> str:
    """The notebook form: verdicts and tables."""
    parts = [f"<h3>{escape(result.design)}</h3><ul>"]
    parts += [f"<li>{MARKS[v.level]} {escape(v.text)} <em>{escape(v.remedy)}</em></li>" for v in result.verdicts]
    parts += [f"<li>⚠ {escape(warning)}</li>" for warning in result.warnings]
    parts.append("</ul>")
    groups: list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]] = [
        (title, (), [tuple(row) for row in rows]) for title, rows in table_groups(result)
    ]
    groups.append(("Microlens images over the field", FIELD_HEADINGS, [field_row(field) for field in result.fields]))
    headings, budgets = budget_table(result)
    groups.append((BUDGET_TITLE, headings, budgets))
    if result.real_lens is not None:
        lens_rows = [lens_field_row(field) for field in result.real_lens.fields]
        groups.append(("Microlens images through the real lens", LENS_HEADINGS, lens_rows))
    groups.append(("Effects", EFFECT_HEADINGS, list(effect_rows(result))))
    for title, headings, rows in groups:
        head = "".join(f"<th>{escape(text)}</th>" for text in headings)
        body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
        parts.append(f"<h4>{escape(title)}</h4><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
    parts.append(f"<p>{escape(absent_effects(result))}</p><p>{escape(result.method)}</p>")
    return "".join(parts)
