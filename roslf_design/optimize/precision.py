"""What an optimum is worth: how far its merit may be off, by the searches' stopping rule and by one more search."""

from __future__ import annotations

from ..accuracy.statement import Accuracy, check_accuracy
from .local import QUICK
from .solve import AGREE, Answer, Settings

FINEST = QUICK
"""Limits are held to 1e-9 of themselves, and a merit is known no better than some of those together."""


def check_optimum_accuracy(accuracy: float) -> float:
    """Refuse what no optimum can be known to.

    Raises
    ------
    InputError
        Not between `FINEST` and 1.
    """
    return check_accuracy(accuracy, FINEST, "limits are held to 1e-9 of themselves")


def optimum_accuracy(answer: Answer, settings: Settings, seconds: float | None = None) -> Accuracy | None:
    """Method, expected and measured error of an answer's merit; None where no design was found."""
    if not answer.feasible:
        return None
    checks = ", ".join(check.solver for check in answer.checks)
    method = f"SLSQP from {len(answer.searches)} starts to {settings.tolerance:g}, the best polished"
    return Accuracy(
        "merit of the optimum (0.01: 1 % of a goal)",
        method + (f"; checked by {checks}" if checks else ""),
        AGREE if settings.accuracy is None else settings.accuracy,
        answer.gained,
        "what one more search gained",
        settings.accuracy,
        seconds,
        model="that no better optimum lies elsewhere is only as sure as the starts and checks agree",
    )
