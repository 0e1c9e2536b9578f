"""`roslf accuracy`: how far numbers can be trusted, and what accuracy costs in time."""

from __future__ import annotations

import json as json_text
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from .evaluate import parse_field
from .progress import StatusLine
from .report import PAGE, check_folder
from .tables import print_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..accuracy.choice import Answer
    from ..accuracy.measure import WorkDiagram
    from ..design import Design
    from ..report.blocks import Table

accuracy = App(
    name="accuracy",
    help="How far numbers can be trusted, and what accuracy costs in time.",
    help_epilogue="Example: roslf accuracy hard-cases designs/paper.toml -o reports/hard-cases",
    help_format="plaintext",
)


@accuracy.default
def diagrams(
    design: str,
    /,
    *,
    scene: str | None = None,
    accuracy: float = 1e-3,
    quantity: str | None = None,
    field: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    jobs: int = 0,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    json: Annotated[bool, Parameter(negative=())] = False,
    seed: int = 0,
) -> None:
    """What each digit costs in time on a design, and which method is chosen.

    Example: roslf accuracy designs/paper.toml --accuracy 1e-4 -o reports/accuracy

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    scene
        A scene file: how many rays a pixel of it needs, on a patch about the field.
    accuracy
        What a result may be off by; each quantity's error is explained on the page.
    quantity
        Only this one, as "pixel image". Default: all, or none where a scene is given.
    field
        Microlens position on the MLA in mm, "11.15" or "x,y", instead of the panels that show every difficulty.
    jobs
        Also try the choice on so many random jobs, and tell how many promises were kept.
    output
        Folder for index.html and accuracy.json, made if needed. Default: only print.
    json
        Print JSON instead of tables.
    seed
        Of random methods and jobs.
    """
    from ..accuracy.honesty import try_choice
    from ..accuracy.jobs import QUANTITIES
    from ..accuracy.statement import check_accuracy
    from ..accuracy.table import current_table
    from ..design import load
    from ..errors import InputError, Problem

    check_accuracy(accuracy)
    wrong = {"--seed": seed < 0, "--jobs": jobs < 0}
    if any(wrong.values()):
        raise InputError(tuple(Problem(key, "must not be negative") for key, bad in wrong.items() if bad))
    if quantity is not None and quantity not in QUANTITIES:
        known = ", ".join(QUANTITIES)
        raise InputError((Problem("--quantity", f'no quantity is called "{quantity}"; there are {known}'),))
    loaded = load(design)
    axis = None if field is None else parse_field(field)
    if output is not None:
        check_folder(output)
    wanted = [quantity] if quantity else [] if scene else list(QUANTITIES)
    with StatusLine("accuracy") as progress:
        groups = [measured_group(loaded, name, axis, accuracy, seed, progress.tell) for name in wanted]
        scene_text = ""
        if scene is not None:
            group, scene_text = scene_group(loaded, scene, accuracy, axis, seed, progress.tell)
            groups.append(group)
        trials = try_choice(loaded, jobs, seed=seed, progress=progress.tell) if jobs else ()
    data = {
        "schema": "roslf.accuracy/1",
        "design": loaded.name,
        "accuracy": accuracy,
        "diagrams": [diagram.to_dict() for _, found, _ in groups for diagram in found],
        "choices": [answer.to_dict() for _, _, answers in groups for answer in answers if answer is not None],
        "random_jobs": len(trials),
        "promises_kept": sum(trial.kept for trial in trials),
    }
    text = json_text.dumps(short(data), allow_nan=False, ensure_ascii=False) + "\n"
    if output is not None:
        from ..accuracy.page import accuracy_report
        from ..design.write import write_atomically
        from ..report.html import render_html

        words = ["roslf", "accuracy", design, "--accuracy", f"{accuracy:g}", "-o", str(output)]
        words += ["--scene", scene] if scene else []
        words += ["--jobs", str(jobs)] if jobs else []
        page = accuracy_report(loaded.name, groups, current_table(), trials, shlex.join(words), accuracy)
        output.mkdir(parents=True, exist_ok=True)
        write_atomically(output / "accuracy.json", text.encode())
        write_atomically(output / PAGE, render_html(page).encode())
    if json:
        print(text, end="")
        return
    from rich.console import Console

    print_table(answers_table(groups), Console())
    if scene_text:
        print(scene_text)
    if trials:
        print(f"\n{data['promises_kept']} of {len(trials)} random jobs within what was promised")
    if output is not None:
        print(f"\n{output / PAGE}")


def measured_group(
    design: Design,
    quantity: str,
    axis: tuple[float, float] | None,
    accuracy: float,
    seed: int,
    tell: Callable[[str], None],
) -> tuple[str, list[WorkDiagram], list[Answer | None]]:
    """Diagrams of one quantity, and what is chosen on each."""
    from ..accuracy.choice import compute
    from ..accuracy.jobs import Job, panel_jobs
    from ..accuracy.measure import work_diagram

    jobs = panel_jobs(design, quantity) if axis is None else {"this field": Job(quantity, design, axis)}
    found = [work_diagram(name, job, seed=seed, progress=tell) for name, job in jobs.items()]
    return quantity, found, [compute(diagram.job, accuracy, seed=seed) for diagram in found]


def scene_group(
    design: Design,
    scene: str,
    accuracy: float,
    axis: tuple[float, float] | None,
    seed: int,
    tell: Callable[[str], None],
) -> tuple[tuple[str, list[WorkDiagram], list[Answer | None]], str]:
    """Diagram of a scene's pixels, and the number of rays in words."""
    import numpy as np

    from ..accuracy.choice import Answer, Choice
    from ..accuracy.page import time_text
    from ..accuracy.scene_job import scene_diagram
    from ..scenes import load_scene

    found, choice = scene_diagram(
        design, load_scene(scene), accuracy, seed=seed, axis=axis or (0.0, 0.0), progress=tell
    )
    name = found.points[0].method
    chosen = Choice(
        "scene image", accuracy, name, choice.rays, choice.expected_error, choice.expected_seconds, choice.attainable
    )
    rays = f"{choice.rays} rays a pixel" if choice.rays else f"no rays ({choice.method})"
    enough = "" if choice.attainable else ", which is not enough: no number tried keeps it"
    text = f"\n{found.title}: {rays} for {accuracy:g}{enough}; tracing the whole sensor takes about "
    text += time_text(choice.expected_seconds)
    answer = Answer(np.zeros(0), chosen, choice.expected_error / 2, choice.expected_seconds, 1)
    return ("scene image", [found], [answer]), text


def answers_table(groups: Sequence[tuple[str, list[WorkDiagram], list[Answer | None]]]) -> Table:
    """What was chosen for each job, and what came of it."""
    from ..accuracy.page import time_text
    from ..report.blocks import Table

    rows = []
    for quantity, found, answers in groups:
        for diagram, answer in zip(found, answers, strict=True):
            if answer is None:
                continue
            choice = answer.choice
            actual = [p.error for p in diagram.points if (p.method, p.level) == (choice.method, choice.level)]
            rows.append(
                (
                    quantity,
                    diagram.title,
                    choice.method + (f" {choice.level}" if choice.level else ""),
                    f"{choice.expected_error:.1e}",
                    "-" if answer.measured_error is None else f"{answer.measured_error:.1e}",
                    f"{actual[0]:.1e}" if actual else "-",
                    time_text(answer.seconds),
                    "yes" if choice.attainable else "NO",
                )
            )
    headings = ("quantity", "job", "method", "expected", "measured", "actual", "time", "within")
    return Table(tuple(rows), "lllrrrrl", headings, "Cheapest methods")


@accuracy.command(name="calibrate")
def calibrate(
    design: str = "paper",
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
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
    from ..accuracy import table
    from ..design import load
    from ..design.write import write_atomically

    loaded = load(design)
    path = table.cache_file() if output is None else output
    with StatusLine("accuracy") as progress:
        found = table.calibrate(loaded, seed=max(seed, 0), progress=progress.tell)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, found.to_json().encode())
    print(path)


@accuracy.command(name="hard-cases")
def hard_cases(
    design: str = "paper",
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    json: Annotated[bool, Parameter(negative=())] = False,
    seed: int = 0,
) -> int:
    """Walk from a design to every place where formulas break, and compare each result with 60 digits.

    Example: roslf accuracy hard-cases designs/paper.toml -o reports/hard-cases

    Exit code 1 where a function exceeds its budget.

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    output
        Folder for index.html and hard-cases.json, made if needed. Default: only print.
    json
        Print JSON instead of the table.
    seed
        Of the walks; the same seed gives the same bytes.
    """
    from ..accuracy.hard_cases import run_hard_cases
    from ..design import load
    from ..errors import InputError, Problem

    if seed < 0:
        raise InputError((Problem("--seed", f"{seed} is negative; give a whole number from 0 on"),))
    loaded = load(design)
    if output is not None:
        check_folder(output)
    with StatusLine("accuracy") as progress:
        found = run_hard_cases(loaded, seed=seed, progress=progress.tell)
    text = json_text.dumps(short(found.to_dict()), allow_nan=False, ensure_ascii=False) + "\n"
    if output is not None:
        from ..accuracy.hard_cases_page import hard_cases_report
        from ..design.write import write_atomically
        from ..report.html import render_html

        command = shlex.join(["roslf", "accuracy", "hard-cases", design, "-o", str(output)])
        output.mkdir(parents=True, exist_ok=True)
        write_atomically(output / "hard-cases.json", text.encode())
        write_atomically(output / PAGE, render_html(hard_cases_report(found, command)).encode())
    if json:
        print(text, end="")
    else:
        from rich.console import Console

        from ..accuracy.hard_cases_page import case_table

        print_table(case_table(found), Console())
        for one in found.near:
            if one.near:
                print(f"\nNear {one.case} (at {one.distance:.2g}): {one.says}")
        if output is not None:
            print(f"\n{output / PAGE}")
    return 0 if found.held else 1


def short(value: Any) -> Any:
    """The same with errors and times to four digits: more would be noise."""
    if isinstance(value, dict):
        return {key: short(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [short(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value
