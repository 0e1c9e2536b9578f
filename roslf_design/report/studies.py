"""Studies run for a report: files as `roslf tolerance` and `roslf optimize` take them, on a design handed to them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..design import dumps
from ..errors import InputError

if TYPE_CHECKING:
    from ..design import Design
    from ..optimize.run import Result
    from ..tolerance.places import Grades
    from ..tolerance.result import StudyResult
    from ..tolerance.study import Plan, Study

Tell = Callable[[str], None]


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
    from ..tolerance.study import make_plan, read_study

    with handed_over(data, design) as given:
        study, own, grades = read_study(given, folder, origin)
    return make_plan(study, own, grades, origin), study, grades


def run_tolerances(
    data: Mapping[str, Any],
    design: Design | None = None,
    folder: Path = Path(),
    origin: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> StudyResult:
    """Run a tolerance study with all its analyses, in this process; nothing of it stays on the disk.

    Parameters, errors
        As `tolerance_plan`; `progress` is told (trials done, trials in all).
    """
    from ..tolerance.result import analyse
    from ..tolerance.run import run_trials

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

    Parameters, errors
        As `tolerance_plan`; `tell` is told what is being done, `seed` counts instead of the study's.
    """
    from ..optimize.run import run
    from ..optimize.study import read_study

    with handed_over(data, design) as given:
        study = read_study(given, folder, origin, seed)
    try:
        return run(study, tell)
    except InputError as error:
        raise error if error.origin else InputError(error.problems, origin) from None


@contextmanager
def handed_over(data: Mapping[str, Any], design: Design | None) -> Iterator[Mapping[str, Any]]:
    """The study with another design in place of its own; studies name designs by file, so it lies in one meanwhile."""
    if design is None:
        yield data
        return
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "design.toml"
        file.write_text(dumps(design), encoding="utf-8")
        yield {**data, "design": str(file)}
