"""`roslf tolerance`."""

from __future__ import annotations

import json as json_text
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..design.files import write_atomically
from ..errors import InputError, Problem
from ..reporting.html import render_html
from ..reporting.study_figures import tolerance_pictures
from ..reporting.tolerance import headline, tables, tolerance_report
from ..tables import print_table
from ..tolerancing.result import analyse, precision, save_worst, trial_arrays, trials_for
from ..tolerancing.run import ChunkLostError, Where, run_trials
from ..tolerancing.study import load_plan
from ..tolerancing.tally import npz_bytes
from ..words import sentence
from .progress import bar

if TYPE_CHECKING:
    from rich.console import Console

    from ..tolerancing.result import StudyResult


def tolerance(
    study: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    json: Annotated[bool, Parameter(negative=())] = False,
    seed: int | None = None,
    workers: int | None = None,
    trials: int | None = None,
    accuracy: float | None = None,
    scheduler: str | None = None,
    resume: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Run a tolerance study: yield, sensitivities, Monte Carlo, inverse tolerances, adjustments.

    Parameters
    ----------
    study
        A study file: a design, what it may miss, the limits it is held to.
    output
        Folder for index.html, results.json, summary.txt, trials.npz, figures, the worst trials as design files, and
        the run's chunks.
    json
        Print the JSON object instead of tables.
    seed
        Instead of the study's; the same seed gives the same bytes.
    workers
        Processes; changes the time, never the results. Default: 1 for small runs, else one a core.
    trials
        Instead of the study's.
    accuracy
        Instead of a number of trials: what the yield and the ranks of quantiles may be off by, as 0.005 (in 95 % of
        runs). 0.001 takes a million trials.
    scheduler
        Address of a Dask scheduler, or "local" for a cluster started here.
    resume
        Go on with a run that was stopped.
    """
    wrong = {"--seed": seed is not None and seed < 0, "--trials": trials is not None and trials < 1}
    wrong["--workers"] = workers is not None and workers < 1
    if any(wrong.values()):
        raise InputError(tuple(Problem(key, "must be a positive whole number") for key, bad in wrong.items() if bad))
    if accuracy is not None and trials is not None:
        raise InputError((Problem("--accuracy", "says how many trials there are, as does --trials; give one of them"),))
    started = time.perf_counter()
    plan, description, grades = load_plan(study, trials=trials, seed=seed)
    if accuracy is not None:
        count = trials_for(accuracy, plan.draws.sampling)
        plan, description, grades = load_plan(study, trials=count, seed=seed)
    where = Where(workers or _workers(plan.chunks), scheduler)
    with bar("trials", plan.trials) as tell:
        try:
            tally = run_trials(plan, output, where, resume=resume, progress=lambda done, _: tell(done))
        except ChunkLostError as error:
            print(f"roslf: {error}", file=sys.stderr)
            raise SystemExit(1) from None
    result = analyse(plan, description, grades, tally, save_worst(plan, tally, output))
    seconds = time.perf_counter() - started
    result = replace(result, precision=precision(plan, tally, result.final, output, accuracy, seconds))
    text = _lines(result.to_dict())
    write_atomically(output / "results.json", (text + "\n").encode())
    write_atomically(output / "summary.txt", summary(result).encode())
    write_atomically(output / "trials.npz", npz_bytes(trial_arrays(plan, tally)))
    for name, picture in tolerance_pictures(result).items():
        write_atomically(output / f"{name}.svg", picture.svg_file())
        write_atomically(output / f"{name}.png", picture.to_png())
    write_atomically(output / "index.html", page(result, str(study)).encode())
    if json:
        timed = None if result.precision is None else result.precision.to_dict(times=True)
        print(_lines(result.to_dict() | {"accuracy": timed}))
        return
    from rich.console import Console

    print_result(result, Console(), times=True)


def page(result: StudyResult, study: str) -> str:
    """The study as a report of its own: one self-contained page."""
    plan = result.plan
    command = f"roslf tolerance {study} --trials {plan.trials} --seed {plan.draws.seed} -o out"
    return render_html(tolerance_report(result, command))


def print_result(result: StudyResult, console: Console, times: bool = False) -> None:
    """Tables for a terminal; `times`: with how long it took, which differs from run to run."""
    console.print(f"[bold]{result.plan.name}[/bold] ({result.plan.question.design.name})", highlight=False)
    console.print(headline(result), highlight=False, soft_wrap=True)
    misses = result.plan.nominal_misses()
    if misses:
        console.print(
            f"The nominal design itself misses {', '.join(misses)}: change the design or the limits.",
            highlight=False,
            soft_wrap=True,
        )
    if result.precision is not None:
        console.print(sentence(result.precision.accuracy.sentence(times)), highlight=False, soft_wrap=True)
    if result.scale_for_target is not None:
        scale, found = result.scale_for_target
        console.print(f"All tolerances times {scale:.3g} give a yield of {100 * found.value:.2f} %", highlight=False)
    for grade in result.grades:
        console.print(f"Grade {grade.grade}: yield {100 * grade.result.value:.2f} %", highlight=False)
    for table in tables(result, brief=True):
        print_table(table, console, leave_out=("source",))  # where each figure comes from is in results.json
    console.print("\nOf each metric the weakest field; all fields in results.json.", highlight=False)
    for warning in result.warnings:
        console.print(f"\nNote: {warning}", highlight=False, soft_wrap=True)
    for trial in result.worst:
        place = trial.file or "no design: some number of it is impossible"
        console.print(f"Worst trial {trial.number}: {place}", highlight=False)


def summary(result: StudyResult) -> str:
    """The terminal's tables as text of a fixed width."""
    import io

    from rich.console import Console

    page = io.StringIO()
    print_result(result, Console(file=page, width=132, color_system=None, force_terminal=False))
    return "".join(f"{line.rstrip()}\n" for line in page.getvalue().splitlines())


def _lines(data: dict[str, object]) -> str:
    """JSON with one line a key: short, and still readable by a difference."""
    rows = (f'"{key}": {json_text.dumps(value, allow_nan=False, ensure_ascii=False)}' for key, value in data.items())
    return "{\n" + ",\n".join(rows) + "\n}"


def _workers(chunks: int) -> int:
    import os

    # A pool costs a second to start: not worth it below a few chunks.
    return 1 if chunks < 8 else max(1, min(chunks, len(os.sched_getaffinity(0))))
