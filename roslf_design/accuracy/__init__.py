"""How far every number can be trusted: what each method costs and errs, the choice among them, and the statement.

What measures the table, walks the hard cases and draws the diagrams is the study `studies/accuracy`.
"""

from __future__ import annotations

from .statement import Accuracy, check_accuracy
from .table import QUANTITIES, AccuracyTable, Choice, choose, current_table, ranked, shipped_table

__all__ = [
    "QUANTITIES",
    "Accuracy",
    "AccuracyTable",
    "Choice",
    "check_accuracy",
    "choose",
    "current_table",
    "ranked",
    "shipped_table",
]
