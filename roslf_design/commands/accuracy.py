"""`roslf accuracy`: how far numbers can be trusted, and what accuracy costs in time.

The work is the study `studies/accuracy`; in a wheel it lies in the package.
"""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from ..accuracy.statement import check_accuracy
from ..accuracy.table import QUANTITIES, cache_file, check_quantity, current_table
from ..errors import Argument, InputError, Problem
from ..options import Options
from ..reporting.blocks import Report
from ..reporting.lens_words import lens_words
from ..reporting.printers import page_files
from ..scenes import load_scene
from ..tables import Table, print_table
from ..theory.limits import as_design
from .evaluate import parse_field
from .terminal import (
    PAGE,
    DesignName,
    Flat,
    Json,
    OptionalOutput,
    StatusLine,
    check_options,
    check_target,
    say,
    spelled,
    typed,
    write_file,
    write_files,
)

MOST_JOBS = 10_000
_PACKAGE = Path(__file__).resolve().parent.parent

accuracy = App(
    name="accuracy",
    help="How far numbers can be trusted, and what accuracy costs in time.",
    help_epilogue="Example: roslf accuracy hard-cases designs/paper.toml -o reports/hard-cases",
    help_format="plaintext",
)


class _Options(Options):
    """Diagrams that are wanted."""

    scene: str | None = None
    """A scene file: how many rays a pixel of it needs, on a patch about the field."""
    accuracy: float = 1e-3
    """Error that a result may have; each quantity's error is explained on the page."""
    quantity: str | None = None
    """Only this one, as "pixel image". Default: all, or none where a scene is given."""
    field: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Microlens position on the MLA in mm, "11.15" or "x,y", instead of the panels that show every difficulty."""
    jobs: int = 0
    """Also try the choice on so many random jobs, and report how many promises were met."""
    seed: int = 0
    """Seed of random methods and jobs."""

    def check(self, output: Path | None) -> None:
        """Refuse what cannot be had."""
        check_accuracy(self.accuracy)
        of_jobs = f"{self.jobs} is out of range; give a whole number from 0 to {MOST_JOBS}, a second or so each"
        check_options(self.seed, output, *([] if 0 <= self.jobs <= MOST_JOBS else [Argument("jobs", of_jobs)]))
        if self.quantity is not None:
            check_quantity(self.quantity)


OPTIONS = _Options()


@accuracy.default
def diagrams(
    design: DesignName,
    /,
    *,
    options: Annotated[_Options, Flat] = OPTIONS,
    output: OptionalOutput = None,
    json: Json = False,
) -> None:
    """Cost in time of each digit on a design, and the method that is chosen.

    Example: roslf accuracy designs/paper.toml --accuracy 1e-4 -o reports/accuracy

    Parameters
    ----------
    output
        Folder for index.html, accuracy.json and tables/ (CSV), made if needed. Default: only print.
    """
    options.check(output)
    scene, quantity, jobs, seed = options.scene, options.quantity, options.jobs, options.seed
    accuracy, field = options.accuracy, options.field
    loaded = as_design(design)
    axis = None if field is None else parse_field(field, loaded)
    promises, page = study("promises"), study("page")
    wanted = [quantity] if quantity else [] if scene else list(QUANTITIES)
    unfit = {name: why for name in wanted if (why := promises.unfit(loaded, name, axis))}
    if quantity in unfit:
        raise InputError((Argument("quantity", f'"{quantity}" cannot be had: {unfit[quantity]}'),), design)
    if wanted and len(unfit) == len(wanted):
        raise InputError((Problem("", f"nothing can be had of it: {next(iter(unfit.values()))}"),), design)
    left_out = [f"{name[0].upper()}{name[1:]} is left out: {why}." for name, why in unfit.items()]
    if not loaded.aligned:
        left_out.append("Tilts are left out: jobs are of straight cameras.")
    left_out += lens_words(loaded.main_lens.kind).uncounted
    groups, scene_text, table = [], "", current_table()  # one that is damaged is told before anything is measured
    with StatusLine("accuracy") as progress:
        for name in (name for name in wanted if name not in unfit):
            alone = axis and {"this field": promises.Job(name, loaded, axis)}
            each = alone or promises.panel_jobs(loaded, name)
            work = [promises.work_diagram(title, job, seed=seed, progress=progress.tell) for title, job in each.items()]
            groups.append((name, work, [promises.compute(diagram.job, accuracy, seed=seed) for diagram in work]))
        if scene is not None:
            diagram, answer, method = promises.scene_diagram(
                loaded, load_scene(scene), accuracy, seed=seed, axis=axis or (0.0, 0.0), progress=progress.tell
            )
            groups.append(("scene image", [diagram], [answer]))
            scene_text = page.scene_sentence(diagram, answer.choice, method)
        trials = promises.try_choice(loaded, jobs, seed=seed, progress=progress.tell) if jobs else ()
    data = {
        "schema": "roslf.accuracy/1",
        "design": loaded.name,
        "accuracy": accuracy,
        "diagrams": [diagram.to_dict() for _, diagrams, _ in groups for diagram in diagrams],
        "choices": [answer.to_dict() for _, _, answers in groups for answer in answers],
        "left_out": left_out,
        "random_jobs": len(trials),
        "promises_kept": sum(trial.kept for trial in trials),
    }
    command = typed(
        "accuracy", design, accuracy=accuracy, scene=scene, quantity=quantity, field=field, jobs=jobs or None,
        output=output, seed=seed or None,
    )  # fmt: skip
    report = partial(page.accuracy_report, loaded.name, groups, table, trials, command, accuracy, left_out)
    said = [*left_out, scene_text] if scene_text else left_out[:]
    said += [f"{data['promises_kept']} of {len(trials)} random jobs within what was promised"] if trials else []
    _finish(data, "accuracy.json", report, output, json, page.answers_table(groups), said)


@accuracy.command(name="calibrate", help_epilogue="")
def calibrate(
    design: str = "paper",
    /,
    *,
    output: OptionalOutput = None,
    seed: int = 0,
) -> None:
    """Measure on this machine what every method costs and how far off it is; choices then go by that.

    Example: roslf accuracy calibrate

    Parameters
    ----------
    design
        A design file or preset to make the jobs from, the kind of camera you work on.
    output
        Table file. Default: your own, in the cache folder, which all commands use from then on.
    seed
        Of the jobs.
    """
    check_options(seed)
    loaded = as_design(design)
    path = cache_file() if output is None else output
    check_target(path)
    promises = study("promises")
    with StatusLine("accuracy") as progress:
        table = promises.calibrate(loaded, seed=seed, progress=progress.tell)
    content = table.to_json().encode()
    write_files(path.parent, {path.name: content}) if output is None else write_file(path, content)
    say(path)


@accuracy.command(name="hard-cases", help_epilogue="")
def hard_cases(
    design: DesignName = "paper",
    /,
    *,
    output: OptionalOutput = None,
    json: Json = False,
    seed: int = 0,
) -> int:
    """Walk from a design to every place where formulas break, and compare each result with 60 digits.

    Example: roslf accuracy hard-cases designs/paper.toml -o reports/hard-cases

    Exit code 1 where a function exceeds its budget.

    Parameters
    ----------
    output
        Folder for index.html, hard-cases.json and tables/ (CSV), made if needed. Default: only print.
    seed
        Of the walks; the same seed gives the same bytes.
    """
    check_options(seed, output)
    loaded = as_design(design)
    rows, page = study("hard_rows"), study("hard_page")
    with StatusLine("accuracy") as progress:
        cases = study("hard_cases").run_hard_cases(loaded, rows.all_cases(), seed=seed, progress=progress.tell)
    command = typed("accuracy", "hard-cases", design, output=output, seed=seed or None)
    said = [f"Near {one.case} (at {one.distance:.2g}): {one.says}" for one in cases.near if one.near]
    report = partial(page.hard_cases_report, cases, command)
    _finish(cases.to_dict(), "hard-cases.json", report, output, json, page.case_table(cases), said)
    return 0 if cases.held else 1


def study(name: str) -> Any:
    """A module of the study: in the package where it was installed from a wheel, else beside it.

    Raises
    ------
    InputError
        mpmath, which its references need, is not installed.
    """
    installed = (_PACKAGE / "studies" / "accuracy").is_dir()
    if not installed and str(_PACKAGE.parent) not in sys.path:
        sys.path.append(str(_PACKAGE.parent))
    try:
        return import_module(f"{'roslf_design.' if installed else ''}studies.accuracy.{name}")
    except ModuleNotFoundError as error:
        if error.name != "mpmath":
            raise
        message = "references at 60 digits need mpmath; install it with: pip install mpmath"
        raise InputError((Problem("accuracy", message),)) from None


def _finish(
    data: dict[str, Any],
    name: str,
    report: Callable[[], Report],
    output: Path | None,
    json: bool,
    table: Table,
    said: Sequence[str],
) -> None:
    """A folder with the page and the numbers behind it, where one is wanted; then the answer on stdout."""
    text = spelled(json_module.dumps(_short(data), allow_nan=False, ensure_ascii=False))
    if output is not None:
        write_files(output, {name: f"{text}\n".encode(), **page_files(report())})
    if json:
        print(text)
        return
    from rich.console import Console

    print_table(table, Console())
    for line in said if output is None else (*said, output / PAGE):
        say(f"\n{line}")


def _short(value: Any) -> Any:
    """Values with errors and times to four digits: more would be noise."""
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_short(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value
