"""The hard cases as a page: verdict, table, figure, and what is near the design at hand."""

from __future__ import annotations

import math

from roslf_design.drawing.marks import Dots
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.picture import PAGE, Picture, beside, one_panel
from roslf_design.reporting.blocks import (
    Bullets,
    Code,
    Figure,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
)

from .hard_cases import CaseResult, HardCases, run_trial
from .hard_shapes import ISSUE_RADII, SHAPES, tangent_trial

FLOOR = 1e-17
"""Errors of exactly 0 are drawn here."""
CEILING = 1e4
"""Errors above, and formulas that give no number, are drawn here."""
COLUMNS = 3


def hard_cases_report(cases: HardCases, command: str) -> Report:
    """The whole page."""
    sections = (
        Section("Verdict", (_verdict(cases),)),
        Section("Near this design", (_near(cases),)),
        Section("The cases", (_intro(), reason_table(cases), case_table(cases))),
        Section("Errors on the way to the singular point", (_figure(cases),)),
        Section("Two discs that almost touch", (tangency_table(),)),
        Section("Every function", (function_table(cases), budget_table(cases))),
        Section("At the singular points", (_points(cases),)),
        Section("How this was made", (_method(cases), Code(command))),
    )
    return Report("Hard cases", f"{cases.design.name}: how far its numbers can be trusted", sections)


def _verdict(cases: HardCases) -> Statements:
    broken = [result.case.name for result in cases.results if not result.held]
    trials = sum(len(result.points) for result in cases.results)
    top = max((result.functions[0].share for result in cases.results), default=0.0)
    if broken:
        text = f"{len(broken)} of {len(cases.results)} cases exceed their budget: {', '.join(broken)}"
        return Statements((Statement("bad", text, "the table tells which function and where; do not trust it there"),))
    text = (
        f"All {len(cases.results)} cases keep their budgets over {trials} trials; the worst uses "
        f"{100 * top:.0f} % of it. "
        "No NaN, no infinity that is not documented, no exception."
    )
    return Statements((Statement("good", text),))


def _near(cases: HardCases) -> Statements | Paragraph:
    near = [one for one in cases.near if one.near]
    if not near:
        closest = cases.near[0]
        text = f"The design is near none of them; the closest is {closest.case}, at a relative distance of "
        return Paragraph(text + f"{closest.distance:.2g}.")
    return Statements(tuple(Statement("caution", f"{one.case}, at {one.distance:.2g}: {one.says}") for one in near))


def _intro() -> Paragraph:
    return Paragraph(
        "Each walk goes towards a place where a textbook formula loses its digits, down to neighbouring floating-point "
        "numbers on both sides; all other lengths are moved by a thousandth at every step, so that no round number "
        "helps. An ulp is a unit in the last place of the exact result. The condition number is the sum of "
        "|x df/dx / f| over the arguments: a formula without any fault is off by so many half ulps, since its "
        "arguments are rounded. Ill-conditioned is not unstable; an error is judged next to it."
    )


def reason_table(cases: HardCases) -> Table:
    """What breaks in each case, and the form that holds."""
    rows = tuple((result.case.name, result.case.breaks, result.case.holds) for result in cases.results)
    return Table(rows, "lll", ("case", "what breaks", "form that holds"))


def case_table(cases: HardCases) -> Table:
    """One row a case: its worst function."""
    rows = []
    for result in cases.results:
        worst = result.functions[0]
        ours = max(point.ours.relative for point in result.shown)
        rows.append(
            (
                result.case.name,
                worst.function,
                unbroken(worst.gap),
                minus(f"{worst.judged.ulps:.3g}"),
                conditioned(worst.judged.condition),
                percent(worst.share),
                number(ours),
                number(max((point.naive for point in result.shown), default=math.nan)),
                "yes" if result.held else "NO",
            )
        )
    headings = ("case", "worst function", "at gap", "ulps", "condition", "of budget", "ours", "textbook", "held")
    caption = (
        "Of each case the function that uses most of its budget, 4 ulp (1 + condition) unless the table of other "
        "budgets says so. Ours, textbook: largest relative errors on the walk of the function that the figure shows, "
        "by the form used and by the textbook formula, in the same double precision; where ours is large the quantity "
        "is ill-conditioned, and no formula does better with rounded arguments. No condition is reported where errors "
        "stay below half an ulp or the budget does not ask for it."
    )
    return Table(tuple(rows), "llrrrrrrl", headings, "", caption)


def unbroken(gap: float) -> str:
    """A power of ten with a minus sign, at which no browser ends a line."""
    return minus(f"{gap:.0e}")


def minus(text: str) -> str:
    """With a proper minus sign in the exponent."""
    return text.replace("e-", "e−").replace("e+", "e")


def conditioned(value: float) -> str:
    """A condition number; a dash where it was not asked for."""
    return minus(f"{value:.2g}") if value else "–"


def percent(share: float) -> str:
    """Part of a budget."""
    return f"{100 * share:.0f} %" if share < 10 else "> 1000 %"


def number(value: float) -> str:
    """An error for a table."""
    if math.isnan(value):
        return "-"
    return minus(f"{value:.1e}") if math.isfinite(value) else "none"


def tangency_table() -> Table:
    """The bench's discs at three gaps, computed on the spot."""
    case = next(case for case in SHAPES if case.shown == "overlap")
    r, R = ISSUE_RADII
    rows = []
    for gap in (1e-4, 1e-6, 1e-8):
        trial = tangent_trial(gap)
        point, area = run_trial(trial, case), trial.ours(**trial.given)
        rows.append((unbroken(gap), minus(f"{area:.6g}"), f"{point.ours.ulps:.2g}", number(point.naive)))
    return Table(
        tuple(rows),
        "rrrr",
        ("gap [mm]", "overlap [mm^2]", "ulps", "relative error of the textbook formula"),
        f"Discs of radius {r:g} and {R:g} mm",
        "Budget: 16 ulp for the floating-point radii and distance exactly as given.",
    )


def function_table(cases: HardCases) -> Table:
    """Every function of every case."""
    rows = [
        (
            result.case.name,
            one.function,
            unbroken(one.gap),
            minus(f"{one.judged.ulps:.3g}"),
            conditioned(one.judged.condition),
            percent(one.share),
            number(one.naive),
        )
        for result in cases.results
        for one in result.functions
    ]
    headings = ("case", "function", "at gap", "ulps", "condition", "of budget", "textbook")
    caption = (
        "Of each function the place where it uses most of its budget. Textbook: largest relative error of that "
        "formula; none where it gave no number."
    )
    return Table(tuple(rows), "llrrrrr", headings, "", caption)


def budget_table(cases: HardCases) -> Table:
    """Functions with a budget of their own, and why."""
    rows = dict.fromkeys(
        (one.function, one.budget.text, one.budget.reason)
        for result in cases.results
        for one in result.functions
        if one.budget.reason
    )
    caption = "All other functions have 4 ulp times (1 + condition)."
    return Table(tuple(rows), "lll", ("function", "budget [ulp]", "why"), "Other budgets", caption)


def _points(cases: HardCases) -> Bullets:
    items = []
    for result in cases.results:
        there = result.at_point
        if there is None:
            continue
        text = f"{result.case.name}: {there.finite} functions finite"
        if there.infinite:
            text += f"; infinite or refused as their documentation says: {', '.join(there.infinite)}"
        if there.faults:
            text += f"; FAULTY: {'; '.join(there.faults)}"
        items.append(text + ".")
    return Bullets(tuple(items))


def _method(cases: HardCases) -> Paragraph:
    return Paragraph(
        "References: rays traced at 60 digits, or the textbook's formula where nothing is traced, for the "
        "floating-point arguments exactly as they are; what cancels there leaves 44 digits to spare. Textbook errors: "
        "the printed formula in double precision. "
        f"Seed {cases.seed}."
    )


def _figure(cases: HardCases) -> Figure:
    return Figure(
        "hard-cases",
        "Relative error against the distance from the singular point",
        "Dots: the forms this program uses. Crosses: the textbook formula of the same quantity, in the same double "
        "precision; those on the upper edge gave no number, or one wrong by more than 1e4. Dots on the lower edge are "
        "right to the last bit. Where dots rise with the crosses (images just touch, calibration from near depths) the "
        "quantity is ill-conditioned: no formula can do better with rounded arguments. A pixel's coverage is right to "
        "the last digits of a whole pixel, and not of the little that is covered. Where crosses stay low the textbook "
        "formula fails at the point alone.",
        plot_hard_cases(cases).svg(),
        "Small panels, one a hard case, logarithmic in both directions; dots stay near 1e-16 where crosses rise to 1",
    )


def plot_hard_cases(cases: HardCases) -> Picture:
    """Small panels, one a case, error against gap."""
    shown = [_panel(result) for result in cases.results if result.case.shown]
    rows = [shown[k : k + COLUMNS] for k in range(0, len(shown), COLUMNS)]
    title = "Relative error against the distance from the singular point"
    return beside("hard-cases", title, [beside("", "", row) for row in rows], down=True)


def _panel(result: CaseResult) -> Picture:
    mine = result.shown
    gaps = [max(point.gap, 1e-17) for point in mine]
    naive = [min(max(point.naive, FLOOR), CEILING) for point in mine]
    ours = [min(max(point.ours.relative, FLOOR), CEILING) for point in mine]
    marks = Dots(gaps, naive, "vermillion", "x", 2.6, width=1.2), Dots(gaps, ours, "blue", size=2.2)
    across, up = Scale(min(gaps) / 3, max(gaps) * 3, log=True), Scale(FLOOR, CEILING, log=True)
    ticks = (1e-16, "10⁻¹⁶"), (1e-8, "10⁻⁸"), (1.0, "1")
    words = result.case.gap_means
    words = words if len(words) <= 34 else words.replace("relative distance from the", "distance from")
    title = result.case.name.replace("→", "to")
    panel = Panel((0, 0, 1, 1), across, up, marks, words, "relative error", title, y_ticks=ticks)
    return one_panel("case", title, (1.25 * PAGE / COLUMNS, 190.0), panel, top=26)
