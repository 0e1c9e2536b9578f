"""What a study leaves in its folder: results, designs, figures, a page."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from ..design import Design, dumps
from ..design.write import write_atomically
from ..errors import InputError
from .result import to_dict
from .run import Result


def write_result(result: Result, folder: Path, command: str = "") -> list[Path]:
    """Write everything; each file appears whole or not at all.

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
    from .. import __version__
    from ..report.blocks import Report
    from ..report.figures.style import to_png
    from ..report.html import render_html
    from .figures import drawn
    from .section import optimize_section

    folder.mkdir(parents=True, exist_ok=True)
    written = []

    def write(name: str, content: bytes) -> None:
        write_atomically(folder / name, content)
        written.append(folder / name)

    text = json.dumps(to_dict(result, timings=False), indent=1, allow_nan=False, ensure_ascii=False)
    write("results.json", (text + "\n").encode())
    for name, design in designs(result):
        write(name, dumps(design).encode())
    for name, figure in drawn(result).items():
        write(f"{name}.png", to_png(figure))
    answer = result.answer
    section = optimize_section(result, command)
    page = Report(answer.asked.name, f"from {answer.problem.design.name}", (section,), f"roslf_design {__version__}")
    write("index.html", render_html(page).encode())
    return written


def designs(result: Result) -> Iterator[tuple[str, Design]]:
    """File name and design of everything worth keeping; a point that is no design has none."""
    answer = result.answer
    name = "best.toml" if answer.feasible else "least-violating.toml"
    title = f"{answer.asked.name}, {'optimised' if answer.feasible else 'least-violating'}"
    try:
        yield name, answer.problem.design_at(answer.unit, title).replace({"source": _source(result)})
    except InputError:
        if answer.feasible:
            raise
    if result.robust is not None:
        robust = answer.problem.design_at(result.robust.unit, f"{answer.asked.name}, robust")
        yield "robust.toml", robust.replace({"source": _source(result)})
    if result.ranking is not None:
        for place, ranked in enumerate(result.ranking.best, 1):
            parts = result.ranking.combinations.title(ranked.number)
            design = result.ranking.combinations.problem_at(ranked.number).design_at(
                ranked.search.unit, f"{answer.asked.name}, parts {place}"
            )
            yield f"parts-{place:02d}.toml", design.replace({"source": f"catalogue: {parts}"})


def _source(result: Result) -> str:
    return f"roslf optimize, from {result.answer.problem.design.name}"
