"""How far the report's numbers can be trusted: the method behind each, its expected error, and hard cases near by."""

from __future__ import annotations

from ..accuracy.table import QUANTITIES, choose, shipped_table
from ..design import Design
from ..evaluation.precision import evaluation_accuracy, near_cases
from ..evaluation.result import Evaluation
from .blocks import Paragraph, Section, Statement, Statements, Table

WANTED = 1e-6
"""Accuracy that the table shows methods for."""
SHOWN = 5
"""Hard cases listed."""


def accuracy_section(design: Design, result: Evaluation, asked: float | None = None) -> Section:
    """The section.

    Parameters
    ----------
    design : Design
    result : Evaluation
        Of the design, at its default fields.
    asked : float, optional
        Accuracy that it was evaluated to.
    """
    table = shipped_table()
    rows = []
    for quantity, meaning in QUANTITIES.items():
        if not table.of(quantity) or (quantity == "real lens" and design.lens is None):
            continue  # not measured yet, or not of this design
        choice = choose(quantity, WANTED, table)
        expected = "rounding, below 1e-12" if choice.expected_error < 1e-12 else f"{choice.expected_error:.1e}"
        rows.append((quantity, choice.method, expected, meaning))
    heads = ("quantity", "method", "expected error", "what the error means")
    caption = (
        f"The cheapest method that keeps {WANTED:g} at the sensor's corner, by errors measured against slow, "
        "independent references; an error of rounding means exact within the model. `roslf accuracy` "
        "shows error against time."
    )
    cases = near_cases(design)
    near = [case for case in cases if case.near]
    said = [
        Statement("caution", f"Near a hard case, {case.case} (relative distance {case.distance:.2g}): {case.says}.")
        for case in near
    ]
    if not near:
        closest = f"the closest is {cases[0].case}, at a relative distance of {cases[0].distance:.2g}"
        text = f"The design is near no hard case; {closest}."
        said.append(Statement("good", text))
    accuracy = evaluation_accuracy(design, result, asked)
    words = accuracy.sentence()
    said.insert(0, Statement("caution" if accuracy.kept is False else "plain", f"{words[0].upper()}{words[1:]}."))
    distances = Table(
        tuple((case.case, f"{case.distance:.2g}", "near" if case.near else "") for case in cases[:SHOWN]),
        "ldl",
        ("hard case", "relative distance", ""),
        "Where textbook formulas would lose digits",
        "Near means below 0.01. The forms used here hold up to the singular points: within 4 ulp times (1 + condition "
        "number).",
    )
    return Section(
        "Accuracy",
        (
            Paragraph(result.method),
            Statements(tuple(said)),
            Table(tuple(rows), "llll", heads, "Methods and their errors", caption),
            distances,
        ),
    )
