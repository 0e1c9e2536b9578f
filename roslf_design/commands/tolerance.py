"""`roslf tolerance`."""

from __future__ import annotations

import io
import json as json_module
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..errors import Argument, refusal, with_options
from ..progress import CountedProgress
from ..reporting.blocks import Block, Paragraph, Statements
from ..reporting.printers import page_files
from ..reporting.tolerance.pages import (
    clearance_words,
    cost_words,
    headline,
    looser,
    measured_words,
    share_words,
    statements,
    tables,
    tolerance_pictures,
    tolerance_report,
)
from ..tables import plain_text
from ..tolerancing.result import (
    FIRST,
    as_one,
    builds_of_analyses,
    first_analyses,
    further_analyses,
    precision,
    save_worst,
    trial_arrays,
    trials_for,
)
from ..tolerancing.run import ChunkLostError, WorkerSettings, run_trials
from ..tolerancing.study import RunOptions
from ..tolerancing.tally import npz_bytes
from ..tolerancing.trials import measure_uniforms
from ..tolerancing.yields import MOST_SCALE
from ..words import about_time, sentence
from .results import picture_files, print_blocks
from .terminal import (
    LOGGED,
    Flag,
    Flat,
    Json,
    Output,
    check_options,
    say,
    spelled,
    status_and_bars,
    tell_cost,
    typed,
    write_files,
)

if TYPE_CHECKING:
    from rich.console import Console

    from ..tolerancing.result import StudyResult
    from ..tolerancing.study import TolerancePlan

MOST_WORKERS = 512
PILOT = 64
"""Builds that tell how long one takes."""
STARTED = 10.0
"""Seconds that trials take from which they tell how long analyses will: the first ones compile and load."""
MINUTES = 180.0
"""Seconds from which on it is said what leaves the rest out."""
OPTIONS = RunOptions()


def tolerance(
    study: Path,
    /,
    *,
    output: Output,
    json: Json = False,
    options: Annotated[RunOptions, Flat] = OPTIONS,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: Flag = False,
) -> None:
    """Run a tolerance study: yield, sensitivities, Monte Carlo, inverse tolerances, adjustments.

    Parameters
    ----------
    study
        A study file: a design, its tolerances, the limits that builds are held to.
    output
        Folder for index.html, results.json, summary.txt, trials.npz, figures, the worst trials as design files, and
        the run's chunks.
    workers
        Processes; changes the time, never the results. Default: 1 for small runs, else one a core.
    scheduler
        Address of a Dask scheduler, or "local" for a cluster started here.
    resume
        Go on with a run that was stopped.
    """
    accuracy, faults = options.accuracy, []
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        faults.append(Argument("workers", f"{workers} is out of range; give a whole number from 1 to {MOST_WORKERS}"))
    check_options(options.seed, output, *faults)
    if accuracy is not None and options.trials is not None:
        raise refusal("accuracy", "says how many trials there are, as does --trials; give one of them")
    started = time.perf_counter()
    plan, description, grades = options.plan(study)
    if accuracy is not None:
        count = trials_for(accuracy, plan.draws.sampling)
        plan, description, grades = options.model_copy(update={"trials": count}).plan(study)
    check_options(folder=output, title=f"Tolerances of {plan.question.design.name}")
    if misses := plan.nominal_misses():
        say(f"roslf: the nominal design itself misses {', '.join(misses)}: its builds will, too", error=True)
    if tight := clearance_words(plan):
        say(f"roslf: {tight} {looser(plan)}".rstrip(), error=True)
    if plan.dear:
        builds = plan.trials + sum(builds_of_analyses(plan, description, grades))
        tell_cost(builds * _seconds_a_build(plan), f"{builds:,} builds are traced, their depth errors summed")
    resume = resume or not (output / "results.json").exists()  # one that was killed left chunks alone
    where = WorkerSettings(workers or _workers(plan.chunks), scheduler)
    with status_and_bars("tolerance") as tell:
        try:
            tally = run_trials(plan, output, where, resume=resume, progress=partial(tell, "trials"))
        except ChunkLostError as error:
            say(f"roslf: {with_options(str(error))}", error=True)
            raise SystemExit(1) from None
    took = time.perf_counter() - started
    costs = builds_of_analyses(plan, description, grades)
    waits = took * sum(costs) / plan.trials if took > STARTED else 0.0
    if told := sys.stderr.isatty() or waits > LOGGED:
        say(f"roslf: {measured_words(plan, tally)}", error=True)
    began = time.perf_counter()
    with status_and_bars("tolerance") as tell:
        heard = as_one(tell, "analyses: yield over tolerance", costs[:FIRST])
        result = first_analyses(plan, description, tally, save_worst(plan, tally, output), progress=heard)
    if told and description.only is None:
        write_files(output, {"summary.txt": summary(result).encode()})
        first = sum(costs[:FIRST])
        _say_first(result, output, (time.perf_counter() - began) * (sum(costs) - first) / max(first, 1))
    with status_and_bars("tolerance") as tell:
        result = further_analyses(result, grades, progress=_named(tell))
        seconds = time.perf_counter() - started
        result = replace(result, precision=precision(plan, tally, result.final, accuracy, seconds))
        command = typed("tolerance", study, trials=plan.trials, seed=plan.draws.seed, only=options.only, output=output)
        tell("page and pictures")
        files = {
            "results.json": f"{_lines(result.to_dict())}\n".encode(),
            "summary.txt": summary(result).encode(),
            "trials.npz": npz_bytes(trial_arrays(plan, tally)),
        }
        files |= picture_files(tolerance_pictures(result)) | page_files(tolerance_report(result, command))
    write_files(output, files)
    if json:
        timed = None if result.precision is None else result.precision.to_dict(times=True)
        print(_lines(result.to_dict() | {"accuracy": timed}))
        return
    from rich.console import Console

    _print_result(result, Console(), times=True)


def _named(tell: Callable[..., None]) -> CountedProgress:
    """Progress of analyses, each by its name."""
    return lambda what, done=0.0, total=0.0: tell(f"analyses: {what}", done, total)


def _say_first(result: StudyResult, output: Path, seconds: float) -> None:
    """Yield and table before all that is searched behind them, and how long that takes, about, where it is minutes."""
    from rich.console import Console

    page = Console(stderr=True)
    limits = tables(result, brief=True)[0]
    print_blocks((Paragraph(f"{headline(result)}."), limits), page)
    say(f"roslf: this is in {output / 'summary.txt'}; Sobol indices, single tolerances, changes follow", error=True)
    if seconds > MINUTES:
        remedy = 'only = "yield" in the study, or --only yield, leaves them out; with --resume they follow later'
        say(f"roslf: they take about {about_time(seconds)} or more: {remedy}", error=True)


def _print_result(result: StudyResult, console: Console, times: bool = False) -> None:
    """Answers and tables for a terminal; `times`: with how long it took, which differs from run to run."""
    console.print(plain_text(result.plan.name, "bold") + plain_text(f" ({result.plan.question.design.name})"))
    print_blocks(_blocks(result, times), console)


def _blocks(result: StudyResult, times: bool) -> Iterator[Block]:
    yield Paragraph(f"{headline(result)}.")
    limits, *others = tables(result, brief=True)
    yield limits
    yield Paragraph(f"{limits.caption}\n")
    yield Statements(tuple(statements(result)))
    if result.precision is not None:
        yield Paragraph(sentence(result.precision.accuracy.sentence(times)))
    if result.scale_for_target is not None:
        scale, reached = result.scale_for_target
        all_of_them = "No limit found: even all" if scale >= MOST_SCALE else "All"
        yield Paragraph(
            f"{all_of_them} tolerances times {scale:.3g} give a yield of {share_words(reached)}; the target is "
            f"{100 * result.study.yield_target:.4g} %"
        )
    for grade, at_grade in result.grades:
        yield Paragraph(f"Grade {grade}: yield {share_words(at_grade)}")
    if result.budget is not None and result.budget.looser:
        saved = "" if result.budget.cost is None else f", {cost_words(result.budget.cost)}"
        first = "with the cheapest change and all" if result.budget.changes else "with all"
        yield Paragraph(f"Budget: {first} tolerances to relax, yield {share_words(result.budget.result)}{saved}")
    yield from others
    yield Paragraph("\nOf each metric the weakest field; all fields in results.json.")
    yield from (Paragraph(table.caption) for table in others if table.title == "Tolerances")
    for warning in result.warnings:
        yield Paragraph(f"\nNote: {warning}")


def summary(result: StudyResult) -> str:
    """The terminal's tables as text of a fixed width."""
    from rich.console import Console

    page = io.StringIO()
    _print_result(result, Console(file=page, width=132, color_system=None, force_terminal=False))
    return "".join(f"{line.rstrip()}\n" for line in page.getvalue().splitlines())


def _lines(data: dict[str, object]) -> str:
    """JSON with one line a key: short, and still readable by a difference."""
    rows = (f'"{key}": {json_module.dumps(value, allow_nan=False, ensure_ascii=False)}' for key, value in data.items())
    return spelled("{\n" + ",\n".join(rows) + "\n}")


def _seconds_a_build(plan: TolerancePlan) -> float:
    """Processor time that a build takes, about, once all is compiled [s]."""
    drawn = plan.draws.uniforms(0, plan.chunk, 0, PILOT)
    measure_uniforms(plan, drawn)
    began = time.process_time()
    measure_uniforms(plan, drawn)
    return (time.process_time() - began) / PILOT


def _workers(chunks: int) -> int:
    # A pool costs a second to start: too much below a few chunks.
    mine = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return 1 if chunks < 8 else max(1, min(chunks, mine))
