"""`roslf optimize`."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..accuracy.statement import check_accuracy
from ..design import dumps
from ..design.files import WRITTEN
from ..errors import InputError
from ..optimization.search import QUICK
from ..optimization.study import Result, load_study, run
from ..reporting.optimise.pages import optimisation_pictures, optimization_report
from ..reporting.printers import page_files
from .results import print_titled
from .terminal import (
    Flag,
    Json,
    Output,
    check_options,
    check_study,
    json_text,
    listed,
    say,
    seen_from,
    status_and_bars,
    typed,
    write_files,
)


def optimize(
    study: Path,
    /,
    *,
    output: Output,
    json: Json = False,
    seed: int | None = None,
    accuracy: float | None = None,
    strict: Flag = False,
) -> int:
    """Find the design: from what the bore allows and what must be seen, or say what stands in the way.

    Parameters
    ----------
    study
        A study file: variables, constraints and objectives.
    output
        Folder for results.json, the designs found, figures and a page.
    seed
        Instead of the study's; the same seed gives the same bytes.
    accuracy
        What the merit of the optimum may be off by, as 1e-4 (0.01 is 1 % of a goal): searches stop at a hundredth of
        it. Default: at 1e-8. The best is polished, to 1e-6 or better.
    strict
        End with exit code 1 where no design holds every limit. Default: 0; what stands in the way is an answer, no
        error.
    """
    check_options(seed, output)
    if accuracy is not None:
        check_accuracy(accuracy, QUICK, "limits are held to 1e-9 of themselves")
    posed = load_study(study, seed, accuracy)
    check_options(folder=output, title=posed.table.name)
    check_study(output, posed.table.name, study)
    with status_and_bars("optimize") as tell, _ended_like_ctrl_c():
        try:
            result = run(posed, tell, lambda found: write_files(output, _designs(found)))
        except InputError as error:
            raise error if error.origin else InputError(error.problems, str(study)) from None
    report = optimization_report(result, typed("optimize", study, output=output, seed=seed, accuracy=accuracy))
    files = {
        "results.json": f"{json_text(result.to_dict(timings=False) | {'file': seen_from(output, study)})}\n".encode(),
        **_designs(result),
        **{f"{name}.png": picture.to_png() for name, picture in optimisation_pictures(result).items()},
        **page_files(report),
    }
    write_files(output, files)
    code = 130 if result.stopped else int(strict and not result.answer.feasible)
    if json:
        print(json_text(result.to_dict()))
        return code
    print_titled(report.title, report.sections[0].blocks)
    say(f"\n{result.seconds:.1f} s; written to {output}: {', '.join(listed(files))}")
    return code


@contextmanager
def _ended_like_ctrl_c() -> Iterator[None]:
    """SIGTERM, which ends a job whose time is over, taken for Ctrl-C: the best so far is written."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)


def _designs(result: Result) -> dict[str, bytes]:
    """Design files of what was found."""
    return {name: dumps(design, WRITTEN).encode() for name, design in result.designs()}
