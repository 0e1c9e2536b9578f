"""`roslf report`."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from .progress import StatusLine

if TYPE_CHECKING:
    from ..report.blocks import Report

PAGE, DOCUMENT = "index.html", "report.pdf"


def report(
    design: str,
    /,
    *others: str,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    pdf: Annotated[bool, Parameter(negative=())] = False,
    paper: Literal["a4", "us-letter"] = "a4",
    compare: Annotated[bool, Parameter(negative=())] = False,
    figure: Annotated[list[str] | None, Parameter(negative=())] = None,
    stamp: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """A design report: one self-contained HTML page with verdicts, tables and figures.

    Example: roslf report designs/paper.toml -o reports/paper --pdf
    Example: roslf report --compare paper paper-mismatched

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    others
        With --compare: one or two more designs.
    output
        Folder to write index.html to, made if needed. Default: report-<design>, after the design file's name.
    compare
        Two or three designs side by side, differences marked.
    pdf
        Also write report.pdf, with the same content.
    paper
        Size of the PDF's pages.
    figure
        Also write this figure as a file of its own, e.g. rays.svg; may be given several times. "all" writes every one.
    stamp
        Also print the date and the versions of Python and of the libraries; the page then differs from day to day.
    """
    from ..design import load
    from ..design.write import write_atomically
    from ..report.html import render_html

    check_count(len(others), compare)
    names = (design, *others)
    loaded = [load(name) for name in names]
    folder = Path("report-" + "-".join(map(folder_name, names))) if output is None else output
    check_folder(folder)
    if pdf:
        check_typst()
    options = ["--compare"] * compare + ["-o", str(folder)] + ["--pdf", "--paper", paper] * pdf
    options += [part for name in figure or () for part in ("--figure", name)]
    command = shlex.join(["roslf", "report", *names, *options])
    lines = stamp_lines() if stamp else ()
    with StatusLine("report") as progress:
        if compare:
            from ..report.compare import comparison_report

            content = comparison_report(loaded, command=command, stamp=lines, progress=progress.tell)
        else:
            from ..report.content import design_report

            content = design_report(loaded[0], command=command, stamp=lines, progress=progress.tell)
        files = figure_files(content, figure or ()) | {PAGE: render_html(content).encode()}
        if pdf:
            from ..report.pdf import render_pdf

            progress.tell("PDF")
            files[DOCUMENT] = render_pdf(content, paper)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        write_atomically(folder / name, data)
        print(folder / name)


def check_count(others: int, compare: bool) -> None:
    """Refuse a number of designs that the report is not made for.

    Raises
    ------
    InputError
        Several without --compare; one, or more than three, with it.
    """
    from ..errors import InputError, Problem

    if compare and others not in (1, 2):
        raise InputError((Problem("--compare", f"{others + 1} given; name two or three designs"),))
    if others and not compare:
        raise InputError((Problem("report", "one design at a time; add --compare to set several side by side"),))


def folder_name(design: str) -> str:
    """What a design's folder is called, from the name of its file."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", Path(design).stem).strip("-.") or "design"


def check_folder(folder: Path) -> None:
    """Refuse, before any work, a place that cannot become a folder.

    Raises
    ------
    InputError
        A file is in the way.
    """
    from ..errors import InputError, Problem

    blocked = next((place for place in (folder, *folder.parents) if place.exists() and not place.is_dir()), None)
    if blocked is not None:
        raise InputError((Problem("-o", f"{blocked} is a file, not a folder; name another place"),))
    if (folder / PAGE).is_dir():
        raise InputError((Problem("-o", f"{folder / PAGE} is a folder; name another place"),))


def check_typst() -> None:
    """Tell before any work where a PDF cannot be made.

    Raises
    ------
    InputError
        The typst package is not installed.
    """
    from importlib.util import find_spec

    from ..errors import InputError, Problem

    if find_spec("typst") is None:
        raise InputError((Problem("--pdf", "a PDF needs the typst package; install it: pip install typst"),))


def figure_files(content: Report, wanted: Sequence[str]) -> dict[str, bytes]:
    """Figures as files of their own.

    Raises
    ------
    InputError
        The report has no figure of that name; says which it has.
    """
    from ..errors import InputError, Problem
    from ..report.figures.style import standalone

    known = {figure.name: figure for figure in content.figures}
    unknown = [name for name in wanted if name not in known and name != "all"]
    if unknown:
        raise InputError(
            tuple(Problem("--figure", f"'{name}' is not here; there are all, {', '.join(known)}") for name in unknown)
        )
    chosen = known if "all" in wanted else {name: known[name] for name in wanted}
    return {
        f"{name}.svg" if isinstance(figure.content, str) else f"{name}.png": standalone(figure.content)
        for name, figure in chosen.items()
    }


def stamp_lines() -> tuple[str, ...]:
    """Date, and versions of what the page was made with."""
    import platform
    from datetime import datetime
    from importlib.metadata import version

    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "matplotlib", "pyvista", "vtk"))
    return (
        datetime.now().astimezone().isoformat(sep=" ", timespec="seconds"),
        f"Python {platform.python_version()}",
        libraries,
    )
