"""A first look at tolerances: a few thousand builds to a shipped grade, held to limits relative to the nominal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..evaluation import default_fields
from .studies import run_tolerances, tolerance_plan

if TYPE_CHECKING:
    from ..design import Design
    from ..tolerance.result import StudyResult

TRIALS = 16384
GRADE = "precision"
FILL, KEPT, CENTRE, DEPTH = 0.1, 0.01, 1.0, 0.1
"""Limits: change of the fill factor, light lost, image centres off [px], growth of the depth spread."""

QUESTION = (
    f"A first look, with limits that this report sets itself: {TRIALS} builds to the grade '{GRADE}' (engineering "
    "judgement, as the table of grades says), the decoder calibrated on each. A build is good where its fill factor "
    f"stays within {100 * FILL:g} % of the nominal, its depth spread grows by no more than {100 * DEPTH:g} %, no field "
    f"loses more than {100 * KEPT:g} % of the light that it nominally gets, and the decoder finds image centres to "
    f"{CENTRE:g} px. Tolerances and limits of your own make a study: roslf tolerance."
)


def quick_tolerances(
    design: Design, seed: int = 0, progress: Callable[[int, int], None] | None = None, trials: int = TRIALS
) -> StudyResult:
    """Run it.

    Parameters
    ----------
    design : Design
        Behind a real main lens, builds are what `roslf tolerance` makes of them.
    seed : int
    progress : callable, optional
        Told (trials done, trials in all).
    trials : int

    Raises
    ------
    InputError
        The grade does not suit the design.
    """
    return run_tolerances(quick_study(design, seed) | {"trials": trials}, design, progress=progress)


def quick_study(design: Design, seed: int = 0) -> dict[str, Any]:
    """The study as its file would say it, without the design."""
    places = [[f"{x!r} mm", f"{y!r} mm"] for x, y in default_fields(design)]
    data: dict[str, Any] = {
        "name": f"first look, {GRADE} grade",
        "question": QUESTION,
        "grade": GRADE,
        "seed": seed,
        "fields": places,
        "report": ["fill_factor", "kept_fraction", "sigma_z_mm"],
        "goals": [{"metric": "centre_error_px", "max": CENTRE}],
        "compensators": [{"place": "calibration"}],
        "sobol_samples": 0,
        "keep_worst": 0,
        "keep_trials": 0,
    }
    plan, *_ = tolerance_plan(data, design)
    goals: list[dict[str, Any]] = []
    for column, nominal in zip(plan.columns, plan.nominal.tolist(), strict=True):
        if not math.isfinite(nominal):
            continue  # a field without light
        at = {} if column.field is None else {"fields": [column.field]}
        if column.metric == "centre_error_px":
            goals.append({"metric": "centre_error_px", "max": CENTRE} | at)
        elif column.metric == "fill_factor":
            ends = sorted(((1 - FILL) * nominal, (1 + FILL) * nominal))
            goals.append({"metric": "fill_factor", "min": ends[0], "max": ends[1]} | at)
        elif column.metric == "kept_fraction":
            goals.append({"metric": "kept_fraction", "min": max(0.0, nominal - KEPT)} | at)
        elif column.metric == "sigma_z_mm":
            goals.append({"metric": "sigma_z_mm", "max": (1 + DEPTH) * abs(nominal)})
    return data | {"goals": goals, "report": []}
