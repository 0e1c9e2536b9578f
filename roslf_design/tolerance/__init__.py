"""What a real build will do: what may be missed, Monte Carlo, yield, sensitivities, inverse tolerances, adjustments.

`load_plan` reads a study, `run_trials` runs it wherever asked, `analyse` says what it means; `one_trial` gives any
trial again, and `evaluate_builds` is the batched engine under all of them.
"""

from .chunk import one_trial
from .metrics import METRICS, Question, evaluate_builds
from .plan import Plan, load_plan, make_plan, plan_from
from .run import Where, analyse, run_trials

__all__ = [
    "METRICS",
    "Plan",
    "Question",
    "Where",
    "analyse",
    "evaluate_builds",
    "load_plan",
    "make_plan",
    "one_trial",
    "plan_from",
    "run_trials",
]
