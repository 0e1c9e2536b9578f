"""Evaluation of a design: a frozen value, its JSON, and its tables in the terminal and in a notebook."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

from ..distances import Distance, check_distances
from ..effects.effect import UNIT_WORDS
from ..effects.lens import EFFECTS
from ..effects.plan import PlannedEffect, not_modelled
from ..json_data import plain
from ..tables import Table, plain_text, print_table
from ..theory.depth_budget import COVERAGE, KINDS, BudgetTerm, DepthBudget
from ..theory.focused import FocusedArray
from ..theory.quantities import EXPANDED, PREDICTED_NOISE, QUANTITIES, noise_words, quantity_named
from ..theory.quantity import Quantity
from ..words import fixed, number, place, spaced, uncertainty
from .answer import MEANT, FirstAnswer
from .groups import DepthAssumptions, Field, LookedThrough, Numbers, RealLens, Temperatures, Verdict
from .required import Requirement

if TYPE_CHECKING:
    from rich.console import Console

SCHEMA = "roslf.evaluation/1"
MARKS = {"good": "✓", "limit": "~", "fault": "✗"}
"""Sign of each level of verdict."""
COLOURS = {"good": "green", "limit": "yellow", "fault": "red"}
LENS_EFFECTS = {effect.name for effect in EFFECTS}
WIDTHS = (18, 15, 0)
"""Widths of the columns of the tables of facts, on pages."""
LEAST = (30, 14, 0)
"""Least widths of these columns on a terminal [characters]."""


SYMBOLS = (
    "FAP (flexible angular plane): the aperture stop, of diameter D_F, d_3 before the main lens (D, f); where nothing "
    "bends light before it, it is the entrance pupil itself; the microlens array (MLA, pitch d) stands d_1 behind the "
    "lens, the sensor (pixels q) d_2 behind that, the focal plane d_f before the lens; H = d_f/(d_f - d_3). Other "
    "words: docs/glossary.md."
)
"""Symbols of all tables, explained once."""

AT_DISTANCES: dict[str, tuple[str, float]] = {
    "u_z_mm": ("u_z_mm", 1.0),
    EXPANDED: ("expanded_mm", 1.0),
    "detail_lp_per_mm": ("usable_lp_per_mm", 1.0),
    **{f"field_half_{way}_mm": (f"{way}_mm", 0.5) for way in ("width", "height", "diagonal")},
}
"""Quantities that an evaluation holds at distances: their names there, and what share of these they are."""


@dataclass(frozen=True)
class Evaluation:
    """Everything that `roslf evaluate` says of a design. Lengths in mm, angles in rad."""

    design: str
    """Name of the design."""
    answer: FirstAnswer
    """Answer to what a buyer asks first."""
    aperture_constant: float
    """H, Eq. 3."""
    inverse_aperture_constant: float
    """1/H, which stays finite as d_3 -> d_f."""
    entrance_pupil: Numbers
    """The aperture stop as the scene sees it."""
    exit_pupil: Numbers
    """The image of the FAP by the main lens."""
    f_number: Numbers
    """Whether microlens images fill their cells."""
    non_distortion: Numbers
    """Where microlens images are full discs (Eqs. 5-6); every length is a half-field."""
    microlens_image: Numbers
    """Size and place of undistorted microlens images."""
    fields: tuple[Field, ...]
    sampling: Numbers
    """Sampling of space and angle."""
    depth: Numbers
    """Depth noise (bound), and depth as expected, at the focal plane."""
    depth_budget: DepthBudget
    """Terms of depth as expected at the focal plane."""
    diffraction: Numbers
    """Diffraction at one microlens."""
    effects: tuple[PlannedEffect, ...]
    verdicts: tuple[Verdict, ...]
    warnings: tuple[str, ...]
    method: str
    """How areas were found, and how far they may be off."""
    real_lens: RealLens | None = None
    """The traced main lens; None where it is ideal."""
    object_space: LookedThrough | None = None
    """Media and parts beside the main lens; None where all is air."""
    temperature: Temperatures | None = None
    """Effects of temperature; None of a design without `[environment]`."""
    focused: FocusedArray | None = None
    """Focused microlenses, whose pixels are no views; None of those that image the pupil."""
    required: tuple[Requirement, ...] = ()
    """Quantities that the design file limits, `[required]`."""

    @property
    def matched(self) -> bool:
        """Whether the f-number is."""
        return any(verdict.ok for verdict in self.verdicts if verdict.name == "f_number_matched")

    @property
    def has_views(self) -> bool:
        """Whether pixels are views: neither focused microlenses nor fewer pixels than tell directions apart."""
        return any(verdict.level != "fault" for verdict in self.verdicts if verdict.name == "views_resolved")

    def group(self, name: str) -> Any:
        """Numbers of a group; the evaluation itself where it has no name."""
        return getattr(self, name) if name else self

    def value(self, quantity: Quantity | str, at: Distance | None = None) -> Any:
        """Value of a quantity that is `evaluated`, or of its name; u and U of the focal plane.

        Depth, expected, field and detail also `at` a distance ahead of the tip that was evaluated, and as its tables
        have them: of rays behind a real lens; None where nothing tells it.

        Raises
        ------
        InputError
            A distance that is none.
        ValueError
            A quantity that it does not hold, or holds at no such distance.
        """
        quantity = quantity_named(quantity) if isinstance(quantity, str) else quantity
        if at is not None:
            return self._at_distance(quantity.name, check_distances(at)[0])
        if quantity.name in ("u_z_mm", EXPANDED):
            return float(self.depth_budget.u_z_mm if quantity.name == "u_z_mm" else self.depth_budget.expanded_mm)
        if quantity.evaluated is None:
            name = quantity.name
            raise ValueError(f"holds no {name}; ask roslf.quantity({name!r}) of roslf.Camera.of(design)")
        return getattr(self.group(quantity.evaluated.under), quantity.evaluated.key or quantity.name)

    def _at_distance(self, name: str, at: float) -> Any:
        if name not in AT_DISTANCES:
            known = f"{', '.join(AT_DISTANCES)} are held at distances"
            raise ValueError(f"holds no {name} at {at:g} mm ({known}); ask roslf.quantity({name!r}, at={at:g})")
        for plane in self.answer.at:
            if math.isclose(plane.at_mm, at, rel_tol=1e-9):
                key, share = AT_DISTANCES[name]
                value = getattr(plane, key)
                return value if value is None else share * value
        raise ValueError(f"was not evaluated at {at:g} mm; give it to roslf.evaluate(design, at={at:g})")

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of `roslf evaluate --json`; infinite values are None, what all is air has no object space."""
        data = {"schema": SCHEMA, **plain(self, undefined=False)}
        del data["depth_budget"]  # it is depth.expected
        for required, one in zip(self.required, data["required"], strict=True):
            del one["by_builds"]  # of builds that an evaluation has none of
            k = one.pop("coverage")
            told = {key: one[key] and k * one[key] for key in ("min", "max", "value")}
            one |= {"quantity": required.asked, **told}
        parts = () if self.object_space is None else data["object_space"]["parts"]
        for group in (data["exit_pupil"], data["microlens_image"], *parts):
            if group["sides_mm"] is None:
                del group["sides_mm"]
        if self.temperature is None:
            del data["temperature"]
        if not self.has_views:
            data["depth"] = dict.fromkeys(data["depth"])
            data["fields"] = [field | {"sigma_z_mm": None, "u_z_mm": None} for field in data["fields"]]
        if self.focused is None:
            del data["focused"]
        else:
            data["sampling"] |= dict.fromkeys(key for key in data["sampling"] if QUANTITIES[key].of_views)
        if self.object_space is None:
            del data["object_space"]
        elif self.object_space.mapping is None:
            del data["object_space"]["mapping"]
        return data

    def __str__(self) -> str:
        return self._printed(partial(print_short, more="print(result.everything)"))

    @property
    def everything(self) -> str:
        """All that `roslf evaluate --all` prints."""
        return self._printed(print_evaluation)

    def _printed(self, by: Callable[[Evaluation, Console], None]) -> str:
        from rich.console import Console

        stream = io.StringIO()
        by(self, Console(file=stream, width=118, no_color=True))
        return stream.getvalue()

    def _repr_html_(self) -> str:
        lines = [f"{MARKS[v.level]} {escape(v.text)} <em>{escape(v.remedy)}</em>" for v in self.verdicts]
        lines += [f"⚠ {escape(warning)}" for warning in self.warnings]
        parts = [f"<h3>{escape(self.design)}</h3><ul>{''.join(f'<li>{line}</li>' for line in lines)}</ul>"]
        parts += [table.html() for table in (*answer_tables(self), *_tables(self))]
        parts.append(f"<p>{escape(absent_effects(self))}</p><p>{escape(SYMBOLS)}</p><p>{escape(self.method)}</p>")
        return "".join(parts)


def _facts(result: Evaluation, *groups: str) -> list[tuple[str, str, str]]:
    """Quantities of groups: label, value with unit, remark."""
    rows = []
    for quantity in QUANTITIES.values():
        listed = quantity.evaluated
        if listed is None or listed.under not in groups or listed.label is None:
            continue
        if quantity.of_views and not result.has_views:
            continue
        if (value := result.value(quantity)) is not None:
            remark = listed.remark_on(result.group(listed.under))
            label = noise_words(result.depth.assumes is None) if listed.label == PREDICTED_NOISE else listed.label
            rows.append((label or quantity.label, quantity.text(value), remark))
    return rows


def fact_tables(result: Evaluation) -> list[Table]:
    """Quantity, value with unit and remark, by subject."""
    pupil, field, image = result.exit_pupil, result.non_distortion, result.microlens_image
    across = "image-space telecentric" if pupil.telecentric else _across(pupil)
    tables = {
        "Pupils": [
            *_facts(result, "entrance_pupil", ""),
            ("exit pupil behind the lens", f"{number(pupil.distance_from_lens_mm)} mm", across),
            *_facts(result, "exit_pupil"),
        ],
        "f-number": _facts(result, "f_number"),
        "Field": _facts(result, "non_distortion"),
        "Microlens images": _facts(result, "microlens_image"),
        "Sampling and diffraction": _facts(result, "sampling", "diffraction"),
        "Depth at the focal plane": depth_facts(result),
    }
    tables["Field"].insert(1, ("the same on the MLA", f"{number(field.x_ml_max_mm)} mm", ""))
    if image.sides_mm is not None:
        sides = " x ".join(number(side * 1e3) for side in image.sides_mm)
        tables["Microlens images"].insert(
            0, ("sides; extent along x or y", f"{sides} um", f"{number(image.diameter_px)} px")
        )
    if not result.has_views:
        del tables["Depth at the focal plane"]
    if result.real_lens is not None:
        tables = {title + _whose(result): rows for title, rows in tables.items()}
        tables["Real main lens, traced"] = result.real_lens.facts
    return [Table(tuple(rows), "ldl", title=title, widths=WIDTHS) for title, rows in tables.items()]


def _whose(result: Evaluation) -> str:
    """Whose numbers a table has, in its title, where rays through a real lens have others."""
    return "" if result.real_lens is None else ", of the thin-lens model"


def answer_tables(result: Evaluation, calibrated: str = "", bare: str = "") -> list[Table]:
    """Field of view, distances and light, then field, depth and detail by distance: what a buyer asks.

    U with what lengths add stands below, where it is known, as `FirstAnswer.uncounted`.
    """
    rows, headings = tuple(plane.cells for plane in result.answer.at), result.answer.headings
    lines = (
        result.answer.uncounted("", calibrated, bare),
        f"U is {result.depth_budget.counted}",
        *result.answer.cautions,
    )
    counts = " ".join(f"{line[:1].upper()}{line[1:]}." for line in lines if line)
    if result.real_lens is not None:
        counts += (
            " Field, light and detail are of rays through the real lens, distances and depth of its thin-lens model."
        )
    return [
        Table(result.answer.rows, "ldl", title="What it sees", widths=WIDTHS),
        Table(rows, "l" * len(headings), headings, "At its distances", f"{MEANT} {counts}"),
    ]


def depth_facts(result: Evaluation) -> list[tuple[str, str, str]]:
    """Depth noise and depth expected, and what they are told for: name, value, remark."""
    assumed = result.depth.assumes
    budget = result.depth_budget
    expected = uncertainty(float(budget.u_z_mm))
    told = ("depth, expected", expected, f"1 sigma, of all that is known; most of it {budget.largest.name}")
    return [*_facts(result, "depth"), *(() if assumed is None else assumed.facts), told]


def depth_basis(assumed: DepthAssumptions | None) -> str:
    """Light, texture and matching that depth noise is told for, in words."""
    return "as the design gives it" if assumed is None else str(assumed)


def focused_table(array: FocusedArray) -> Table:
    """Planes of object space as focused microlenses show them."""
    caption = (
        "A focused (plenoptic 2.0) camera, whose pixels are no views. Virtual depth is counted from the array in d_2: "
        "above 0 the main lens's image lies before the array (Keplerian), below 0 behind it (Galilean). Sharp is what "
        f"blurs no more than pixels and diffraction, {number(array.own_blur_px, 3)} px. Seen by: microlenses across "
        "that see a point, 2 at least for depth. Resolution: pixels of the refocused image for one of the sensor's, "
        "along each axis."
    )
    blurs = [f"blur by {name} [px]" for name in array.types]
    headings = ("", "virtual depth", "ahead of the tip [mm]", *blurs, "seen by", "resolution")
    rows = tuple(plane.cells for plane in (*array.in_focus, *array.limits))
    return Table(rows, "l" + "r" * (len(headings) - 1), headings, "Focused microlenses", caption)


def depth_budget_tables(result: Evaluation) -> list[Table]:
    """Terms of depth as expected, precision and trueness told apart; of focused arrays theirs, none without views."""
    if result.focused is not None:
        return [focused_table(result.focused)]
    if not result.has_views:
        return []
    budget = result.depth_budget
    total = float(budget.u_z_mm)

    def cells(name: str, u: Any, *rest: str) -> tuple[str, ...]:
        if u is None:
            return (name, "-", "-", *rest)
        share = f"{100 * float(u / total) ** 2:.0f} %" if 0 < total < math.inf else "-"
        return (name, uncertainty(float(u), 3), share, *rest)

    def line(term: BudgetTerm) -> tuple[str, ...]:
        return cells(term.name, term.u_mm, term.type, term.kind, term.remark)

    rows = [*map(line, budget.terms)]
    words = {"precision": "each microlens its own", "trueness": "all microlenses alike"}
    known = {term.kind for term in budget.terms if term.u_mm is not None}
    rows += [
        cells(f"all {kind}", budget.of_kind(kind) if kind in known else None, "", "", words[kind]) for kind in KINDS
    ]
    rows.append(cells("together, u", total, "", "", f"largest: {budget.largest.name}"))
    rows.append(("expanded, U", budget.expanded_words(), "", "", "", f"k = {COVERAGE}"))
    headings = ("source", "u", "of u²", "type", "", "")
    return [Table(tuple(rows), "ldllll", headings, "Depth, expected, at the focal plane")]


def seen_table(result: Evaluation) -> Table | None:
    """Table of what light meets beside the main lens; None where all is air."""
    if (through := result.object_space) is None:
        return None
    rows = tuple(part.cells for part in through.parts)
    caption = (
        f"{through.around} Distances are mechanical: before the lens, of an element to its sensor side; of the MLA "
        "behind the lens, of the sensor behind the MLA; all are those at 20 °C. In formulas d_f, d_3, D_F, d_1 and "
        "d_2 are as the main lens sees them."
    )
    headings = ("", "what", "distance", "diameter", "as the main lens sees it")
    return Table(rows, "llddl", headings, "Beside the main lens, in the order of light", caption)


def _across(pupil: Numbers) -> str:
    """Diameter, or sides, of a pupil in words."""
    if pupil.sides_mm is not None:
        return f"sides {' x '.join(number(side) for side in pupil.sides_mm)} mm"
    return f"diameter {number(pupil.diameter_mm)} mm"


def temperature_table(result: Evaluation) -> Table | None:
    """The camera at temperatures it meets; nothing of a design that says nothing of them."""
    if (warm := result.temperature) is None:
        return None
    rows = tuple(row.cells(warm.temperature_degc) for row in warm.at)
    here, known = f"{warm.temperature_degc:g} °C", result.depth["expected"]["calibrated_at_degc"]
    other = f" The term temperature of depth, expected, counts from {known:g} °C, where it is calibrated."
    caption = (
        f"The camera as it is focused, in a {warm.held}; disparity between the FAP's rims is that of what is in focus "
        f"at {here}, where it is used.{'' if known in (None, warm.temperature_degc) else other} Parts clear: none "
        "reaches into another; the tube has a verdict of its own."
    )
    headings = ("temperature", "f", "d_1", "d_f", f"disparity from {here} [pitches]", "image fill", "parts clear")
    return Table(rows, "lrrrrrl", headings, "Temperature", caption)


def mapping_table(result: Evaluation) -> Table | None:
    """Table of the effects of the objective's mapping on each field; None where it is f tan."""
    if result.object_space is None or (objective := result.object_space.mapping) is None or not objective.fields:
        return None
    rows = tuple(field.cells for field in objective.fields)
    caption = (
        f"The objective, {objective}. Samples and {noise_words(result.depth.assumes is None)} are those on the focal "
        "plane, along the field's radius and across it; angles are those in the medium of the scene."
    )
    headings = ("microlens x, y [mm]", "angle [deg]", "height against f tan [%]", "object sample [mm]", "σ_Z [mm]")
    return Table(rows, "lrrrr", headings, "The objective's mapping over the field", caption)


def field_table(result: Evaluation) -> Table:
    """The image behind each microlens asked for."""
    rows = tuple(field.cells for field in result.fields)
    headings = ("microlens x, y [mm]", "image", "unvignetted", "centroid [um]", "axis ratio", "in own cell")
    return Table(rows, "llrrrr", headings, f"Microlens images over the field{_whose(result)}")


def budget_table(result: Evaluation) -> Table:
    """Table of the share of the rays filling the pupil that each element takes, a row a field."""
    budgets = [[part for part in field.ray_budget.taken() if part[0] != "FAP"] for field in result.fields]
    rows = (
        (place(field.x_ml_mm), *(f"{fixed(100 * share, 2)} %" for _, share in budget))
        for field, budget in zip(result.fields, budgets, strict=True)
    )
    names = [name for name, _ in budgets[0]] if budgets else []
    beside = ("own cell", "neighbours")
    taking = [name if name in beside else f"lost at {name}" for name in names]
    title = f"Ray budget{_whose(result)}: of the rays that fill the pupil, in the order of light"
    if result.object_space is not None:  # of as many elements as there may be: one row each that takes light
        shares = list(zip(*([share for _, share in budget] for budget in budgets), strict=True))
        lines = [
            (label, own) for label, name, own in zip(taking, names, shares, strict=True) if any(own) or name in beside
        ]
        if idle := len(names) - len(lines):
            lines.insert(-2, (f"lost at all others ({idle})", (0.0,) * len(budgets)))
        cells = tuple((label, *(f"{fixed(100 * share, 2)} %" for share in own)) for label, own in lines)
        headings = ("microlens x, y [mm]", *(place(field.x_ml_mm) for field in result.fields))
        return Table(cells, "l" + "r" * len(budgets), headings, title)
    return Table(tuple(rows), "l" + "r" * len(taking), ("microlens x, y [mm]", *taking), title)


def lens_table(lens: RealLens) -> Table:
    """The image behind each microlens asked for, through the real lens."""
    rows = tuple(field.cells for field in lens.fields)
    title = "Microlens images through the real lens, against its thin-lens model"
    headings = (
        *("microlens x, y [mm]", "image", "unvignetted", "shift x, y [px]", "wider [%]"),
        *("focus tan, sag [pitches]", "distortion [%]", "colour [pitches]"),
    )
    return Table(rows, "llrrrrrr", headings, title)


def effects_table(result: Evaluation) -> Table:
    """The effects plan, without the effects that are zero but those of a real lens; those that are off are faint."""
    rows = tuple(
        (
            spaced(effect.name),
            f"{number(effect.estimate, 3)} {UNIT_WORDS[effect.unit]}",
            f"{number(effect.budget, 3)} {UNIT_WORDS[effect.unit]}",
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
    """Sentences on the effects that a picture of a uniform scene, which the plan is for, does not have at all."""
    names = [spaced(effect.name) for effect in result.effects if effect.modelled and not _told(effect, result)]
    none = f"In a picture of a uniform scene in focus, nothing comes from: {', '.join(names)}." if names else ""
    return " ".join(filter(None, (none, not_modelled(result.effects))))


def _told(effect: PlannedEffect, result: Evaluation) -> bool:
    """Whether an effect has a line: it has a size, or a real lens has it and the scene alone hides it."""
    of_lens = result.real_lens is not None and effect.name in LENS_EFFECTS
    return effect.estimate != 0 or effect.on or of_lens


def _tables(result: Evaluation) -> list[Table]:
    fields = [field_table(result), budget_table(result)] if result.fields else []
    lens = [] if result.real_lens is None else [lens_table(result.real_lens)]
    behind_elements, mapping, warm = seen_table(result), mapping_table(result), temperature_table(result)
    fields = fields if mapping is None else [mapping, *fields]
    first, last = ([] if table is None else [table] for table in (behind_elements, warm))
    return [*first, *fact_tables(result), *depth_budget_tables(result), *last, *fields, *lens, effects_table(result)]


def print_short(
    result: Evaluation,
    console: Console,
    tables: Sequence[Table] = (),
    more: str = "roslf evaluate --all",
    design: str = "DESIGN",
) -> None:
    """Print the first answer and, briefly, the verdicts: faults, limits, what is good; `tables`; what tells `more`.

    `design` is as it was typed.
    """
    by_level = {level: [one for one in result.verdicts if one.level == level] for level in MARKS}
    brief = [replace(one, text=_brief(one.text), remedy=_brief(one.remedy)) for one in by_level["fault"]]
    brief += [replace(one, text=_brief(one.text), remedy="") for one in by_level["limit"]]
    if good := [_brief(one.text).partition(": ")[::2] for one in by_level["good"]]:
        asked = [rest.partition(" is ")[0] for name, rest in good if name == "as required"]
        named = "; ".join(name for name, _ in good if name != "as required")
        brief += [
            Verdict.of("good", line) for line in (f"as required: {'; '.join(asked)}" * bool(asked), named) if line
        ]
    _print_answer(result, brief, console, design)
    for table in tables:
        print_table(table, console)
    console.print(plain_text(f"\nAll of it, remedies and tables: {more}", "dim"))


def _brief(text: str) -> str:
    """A verdict's first statement, without what stands in brackets."""
    while (bare := re.sub(r" \([^()]*\)", "", text)) != text:
        text = bare
    return text.partition("; ")[0]


def _print_answer(result: Evaluation, verdicts: Sequence[Verdict], console: Console, design: str) -> None:
    """Print the first answer and verdicts; that pixels are no views, the first one then, before all."""
    console.print(plain_text(result.design, "bold"))
    leading = 0 if result.has_views or result.focused is not None else 1
    _print_verdicts(verdicts[:leading], console)
    for table in answer_tables(result):
        print_table(table, console, least=() if table.headings else LEAST)
    if line := result.answer.uncounted(design):
        console.print(plain_text(line))
    for line in result.answer.cautions:
        console.print(plain_text(line, "yellow"))
    console.print()
    _print_verdicts(verdicts[leading:], console)
    for warning in result.warnings:
        console.print(plain_text(f"! {warning}", "yellow"))


def print_evaluation(result: Evaluation, console: Console, design: str = "DESIGN") -> None:
    """Print the first answer, the verdicts, then the tables; `design` is as it was typed."""
    _print_answer(result, result.verdicts, console, design)
    for table in _tables(result):
        print_table(table, console, least=() if table.headings else LEAST)
    console.print(plain_text(absent_effects(result), "dim"))
    console.print(plain_text(f"\n{SYMBOLS}\n\n{result.method}", "dim"))


def _print_verdicts(verdicts: Sequence[Verdict], console: Console) -> None:
    for verdict in verdicts:
        mark = plain_text(MARKS[verdict.level], COLOURS[verdict.level])
        console.print(mark, plain_text(verdict.text))
        if verdict.remedy:
            console.print(plain_text(f"  → {verdict.remedy}"))
