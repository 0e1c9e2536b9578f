"""Report of a design, as `roslf report` makes it."""

from __future__ import annotations

import re
from pathlib import Path

from ..design import Design
from ..reporting.printers import render_html
from ..reporting.story import LINES, full_report
from .jobs import Tell, stages

STEPS = {
    "tolerances: builds": 1.0, "tolerances: analyses": 5.0, "calibration plan": 0.8, LINES: 0.2, "evaluating": 0.1,
    "figures": 0.4, "sections": 0.1, "data sheet": 1.5, "real main lens": 0.5,
}  # fmt: skip
"""Steps of making it, and about how long each takes."""


def file_stem(design: Design) -> str:
    """Name of a design's file without its ending."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", Path(design.name).stem).strip("-.") or "design"


def run_report(design: Design, tell: Tell = lambda share, text: None) -> bytes:
    """Page of the report.

    Raises
    ------
    InputError
        A design that cannot be evaluated.
    """
    command = f"roslf report {file_stem(design)}.toml -o report"
    return render_html(full_report(design, command=command, progress=stages(tell, STEPS))).encode()
