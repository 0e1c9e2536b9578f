"""`roslf optimize`."""

from __future__ import annotations

import json as json_text
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .. import __version__
from ..accuracy.statement import check_accuracy
from ..design import dumps
from ..design.files import write_atomically
from ..errors import InputError
from ..optimization.run import designs, run, to_dict
from ..optimization.search import QUICK
from ..optimization.study import load_study
from ..reporting.html import render_html
from ..reporting.optimization import optimization_report, statements, tables
from ..reporting.study_figures import optimisation_pictures
from ..reporting.terminal import print_blocks, print_statements
from .options import folder_faults, seed_faults
from .progress import StatusLine

if TYPE_CHECKING:
    from rich.console import Console

    from ..optimization.run import Result


def optimize(
    study: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    json: Annotated[bool, Parameter(negative=())] = False,
    seed: int | None = None,
    accuracy: float | None = None,
) -> None:
    """Find the design: from what the bore allows and what must be seen, or say what stands in the way.

    Example: roslf optimize studies/optimize-rigid-scope/study.toml -o out/rigid-scope

    Parameters
    ----------
    study
        A study file: what may vary, what must hold, what is wanted.
    output
        Folder for results.json, the designs found, figures and a page.
    json
        Print the JSON object instead of tables.
    seed
        Instead of the study's; the same seed gives the same bytes.
    accuracy
        What the merit of the optimum may be off by, as 1e-4 (0.01 is 1 % of a goal): searches stop at a hundredth of
        it, and the best is polished. Default: every search is polished, to 1e-6 or better.
    """
    faults = (*seed_faults(seed), *folder_faults(output))
    if faults:
        raise InputError(faults)
    if accuracy is not None:
        check_accuracy(accuracy, QUICK, "limits are held to 1e-9 of themselves")
    posed = load_study(study, seed, accuracy)
    with StatusLine("optimize") as status:
        try:
            result = run(posed, status.tell)
        except InputError as error:
            raise error if error.origin else InputError(error.problems, str(study)) from None
    words = ["roslf", "optimize", str(study), "-o", str(output)]
    words += [] if seed is None else ["--seed", str(seed)]
    command = shlex.join(words if accuracy is None else [*words, "--accuracy", f"{accuracy:g}"])
    written = write_result(result, output, command)
    if json:
        print(json_text.dumps(to_dict(result), indent=1, allow_nan=False, ensure_ascii=False))
        return
    from rich.console import Console

    print_result(result, written, Console())


def write_result(result: Result, folder: Path, command: str) -> list[Path]:
    """Write results.json, the designs, the figures and a page; each file appears whole or not at all.

    Parameters
    ----------
    result : Result
    folder : Path
        Made if needed.
    command : str
        That reruns the study.

    Returns
    -------
    list of Path
        What was written.
    """
    text = json_text.dumps(to_dict(result, timings=False), indent=1, allow_nan=False, ensure_ascii=False)
    page = optimization_report(result, command, __version__)
    files = {
        "results.json": (text + "\n").encode(),
        **{name: dumps(design).encode() for name, design in designs(result)},
        **{f"{name}.png": figure.to_png() for name, figure in optimisation_pictures(result).items()},
        "index.html": render_html(page).encode(),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_atomically(folder / name, content)
    return [folder / name for name in files]


def print_result(result: Result, written: list[Path], console: Console) -> None:
    """Sentences and tables for a terminal."""
    from rich.text import Text

    console.print(Text(result.answer.asked.name, style="bold"))
    print_statements(statements(result), console)
    print_blocks(tables(result), console)
    console.print()
    for note in result.answer.notes:
        console.print(f"Note: {note}", highlight=False, soft_wrap=True)
    console.print(f"{result.seconds:.1f} s; written to {written[0].parent}: ", end="", highlight=False)
    console.print(", ".join(path.name for path in written), highlight=False, soft_wrap=True)
