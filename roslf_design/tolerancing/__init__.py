"""Tolerancing of builds: what may be missed, Monte Carlo, yield, sensitivities, inverse tolerances, adjustments.

`load_plan` reads a study, `run_trials` runs it wherever asked, `analyse` says what it means; `one_trial` gives any
trial again, and `evaluate_builds` is the batched engine under all of them.
"""

from .metrics import METRICS, Question, evaluate_builds
from .result import analyse
from .run import Where, run_trials
from .study import TolerancePlan, load_plan, make_plan, plan_from
from .trials import one_trial

__all__ = [
    "METRICS",
    "Question",
    "TolerancePlan",
    "Where",
    "analyse",
    "evaluate_builds",
    "load_plan",
    "make_plan",
    "one_trial",
    "plan_from",
    "run_trials",
]
