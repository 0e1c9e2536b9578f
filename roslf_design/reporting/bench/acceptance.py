"""Acceptance of a camera as a page to sign; the terminal shares its words."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ...bench.acceptance import Acceptance, AcceptanceLine, Verdict
from ...design import Design
from ...words import listed, number
from ..blocks import Block, Bullets, Paragraph, Report, Section, Statement, Statements, Table, Tone
from ..sheet.lines import NONE, sheet_head, signatures

TONES: dict[Verdict, Tone] = {"in tolerance": "good", "out": "bad", "undecided": "caution", "reported": "plain"}
_WORST: tuple[Verdict, ...] = ("out", "undecided", "in tolerance")
RULE = (
    "Measured figures with their expanded uncertainty U (k = 2), beside the data sheet's. In tolerance: all of a figure"
    " ± U lies within the limits; out: all of it lies outside; undecided: neither (ISO 14253-1, JCGM 106). Lines"
    " without limits are reported."
)


def acceptance_report(
    result: Acceptance, design: Design, calibration: str, revision: str = NONE, date: str = NONE
) -> Report:
    """The page: which camera, faults first, the verdicts, each figure, fields to sign."""
    blocks = (
        sheet_head(design, revision, date),
        Statements(acceptance_statements(result)),
        Paragraph(f"{RULE} Calibration: {calibration}."),
        *acceptance_tables(result),
        signatures(),
    )
    return Report(f"Acceptance of {design.name}", design.source, (Section("Acceptance", blocks),))


def acceptance_statements(result: Acceptance) -> tuple[Statement, ...]:
    """Faults of pictures, then what the figures say together."""
    remedy = "Take it again; nothing is judged that depends on it."
    return (*(Statement("bad", fault, remedy) for fault in result.faults), *_verdicts(result))


def _verdicts(result: Acceptance) -> Iterator[Statement]:
    """Counts of the verdicts in one statement, as bad as the worst."""
    counts = [(verdict, result.count(verdict)) for verdict in TONES if result.count(verdict)]
    worst = next((verdict for verdict in _WORST if result.count(verdict)), None)
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts)
    if worst is not None:
        out = [line.name for line in result.lines if line.verdict == "out"]
        which = f"; out: {listed(out)}" if out else ""
        yield Statement(TONES[worst], f"Of {len(result.lines)} figures {said}{which}.")
    if result.lines and not any(line.limits for line in result.lines):
        yield Statement("plain", "No figure has a limit: nothing is judged.", "Name a tolerance study by --tolerances.")


def acceptance_tables(result: Acceptance) -> tuple[Block, ...]:
    """Figures by subject, and what is missing."""
    subjects: dict[str, list[AcceptanceLine]] = {}
    for line in result.lines:
        subjects.setdefault(line.subject, []).append(line)
    headings = ("", "measured", "± U", "data sheet", "limits", "verdict")
    tables: list[Block] = [
        Table(
            tuple(map(_cells, lines)), "ldllll", headings if not k else (), subject,
            "; ".join(dict.fromkeys(line.remark for line in lines if line.remark)),
            widths=(21, 10, 6, 8, 11, 0), dense=True,
        )
        for k, (subject, lines) in enumerate(subjects.items())
    ]  # fmt: skip
    if result.left_out:
        tables += [Paragraph("Not measured:"), Bullets(result.left_out)]
    return tuple(tables)


def _cells(line: AcceptanceLine) -> tuple[str, ...]:
    digits = 4
    if line.expanded > 0 and line.value:  # as far as U knows it
        digits = max(2, 2 + math.floor(math.log10(abs(line.value) / line.expanded) + 1)) if line.value else 2
    measured = f"{number(line.value, min(digits, 6))} {line.unit}".strip()
    expected = NONE if line.expected is None else number(line.expected, 4)
    limits = NONE
    if line.limits is not None:
        low, high = line.limits
        if math.isinf(low):
            limits = f"≤ {number(high, 4)}"
        else:
            limits = f"≥ {number(low, 4)}" if math.isinf(high) else f"{number(low, 4)} to {number(high, 4)}"
    return line.name, measured, f"± {number(line.expanded, 2)}", expected, limits, line.verdict
