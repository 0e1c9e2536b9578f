"""How far every number can be trusted, and what accuracy costs in time.

>>> answer = compute(Job("kept fraction", design, (11.15, 0.0)), accuracy=1e-3)
>>> answer.value, answer.choice.method, answer.choice.expected_error, answer.measured_error, answer.seconds

Names below are imported when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .choice import Answer, Choice, choose, compute
    from .hard_cases import HardCases, run_hard_cases
    from .jobs import QUANTITIES, Job
    from .table import calibrate, current_table

_HOMES = {
    "Answer": ".choice",
    "Choice": ".choice",
    "HardCases": ".hard_cases",
    "Job": ".jobs",
    "QUANTITIES": ".jobs",
    "calibrate": ".table",
    "choose": ".choice",
    "compute": ".choice",
    "current_table": ".table",
    "run_hard_cases": ".hard_cases",
}

__all__ = [
    "QUANTITIES",
    "Answer",
    "Choice",
    "HardCases",
    "Job",
    "calibrate",
    "choose",
    "compute",
    "current_table",
    "run_hard_cases",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
