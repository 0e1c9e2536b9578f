"""Studies run for a report: files as `roslf tolerance` and `roslf optimize` take them, and a first look at tolerances.

The first look takes a few thousand builds to a shipped grade and holds them to limits relative to the nominal.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..evaluation import default_fields
from ..optimization.study import read_study as read_optimisation
from ..optimization.study import run
from ..tolerancing.result import analyse
from ..tolerancing.run import run_trials
from ..tolerancing.study import make_plan, read_study

if TYPE_CHECKING:
    from ..design import Design
    from ..optimization.study import Result
    from ..tolerancing.places import Grades
    from ..tolerancing.result import StudyResult
    from ..tolerancing.study import Study
    from ..tolerancing.study import TolerancePlan as Plan

Tell = Callable[[str], None]
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


def tolerance_plan(
    data: Mapping[str, Any], design: Design | None = None, folder: Path = Path(), origin: str = ""
) -> tuple[Plan, Study, Grades]:
    """A tolerance study ready to run.

    Parameters
    ----------
    data : mapping
        As the study's file says it.
    design : Design, optional
        Takes the place of the file's own.
    folder : Path
        Where files that the study names are looked for.
    origin : str
        What errors are told of.

    Raises
    ------
    InputError
        Every fault of the study.
    """
    study, own, grades = read_study(data, folder, origin, design)
    return make_plan(study, own, grades, origin), study, grades


def run_tolerances(
    data: Mapping[str, Any],
    design: Design | None = None,
    folder: Path = Path(),
    origin: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> StudyResult:
    """Run a tolerance study with all its analyses, in this process; nothing of it stays on the disk.

    As `tolerance_plan`; `progress` is told (trials done, trials in all).
    """
    plan, study, grades = tolerance_plan(data, design, folder, origin)
    with tempfile.TemporaryDirectory() as scratch:
        tally = run_trials(plan, Path(scratch), progress=progress)
    return analyse(plan, study, grades, tally)


def run_optimisation(
    data: Mapping[str, Any],
    design: Design | None = None,
    folder: Path = Path(),
    origin: str = "",
    tell: Tell = lambda _: None,
    seed: int | None = None,
) -> Result:
    """Run an optimisation study.

    As `tolerance_plan`; `tell` is told what is being done, `seed` counts instead of the study's.
    """
    study = read_optimisation(data, folder, origin, seed, design)
    try:
        return run(study, tell)
    except InputError as error:
        raise error if error.origin else InputError(error.problems, origin) from None


def quick_tolerances(
    design: Design, seed: int = 0, progress: Callable[[int, int], None] | None = None, trials: int = TRIALS
) -> StudyResult:
    """The first look; behind a real main lens, builds are what `roslf tolerance` makes of them.

    Raises
    ------
    InputError
        The grade does not suit the design.
    """
    return run_tolerances(quick_study(design, seed) | {"trials": trials}, design, progress=progress)


def quick_study(design: Design, seed: int = 0) -> dict[str, Any]:
    """The first look as its file would say it, without the design."""
    data: dict[str, Any] = {
        "name": f"first look, {GRADE} grade",
        "question": QUESTION,
        "grade": GRADE,
        "seed": seed,
        "fields": [[f"{x!r} mm", f"{y!r} mm"] for x, y in default_fields(design)],
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
            low, high = sorted(((1 - FILL) * nominal, (1 + FILL) * nominal))
            goals.append({"metric": "fill_factor", "min": low, "max": high} | at)
        elif column.metric == "kept_fraction":
            goals.append({"metric": "kept_fraction", "min": max(0.0, nominal - KEPT)} | at)
        elif column.metric == "sigma_z_mm":
            goals.append({"metric": "sigma_z_mm", "max": (1 + DEPTH) * abs(nominal)})
    return data | {"goals": goals, "report": []}
