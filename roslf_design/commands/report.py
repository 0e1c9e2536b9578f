"""`roslf report`."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

PAGE, DOCUMENT = "index.html", "report.pdf"


def report(
    design: str,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    pdf: Annotated[bool, Parameter(negative=())] = False,
    paper: Literal["a4", "us-letter"] = "a4",
    stamp: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """A design report: one self-contained HTML page with verdicts, tables and figures.

    Example: roslf report designs/paper.toml -o reports/paper

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    output
        Folder to write index.html to, made if needed. Default: report-<design>, after the design file's name.
    pdf
        Also write report.pdf, with the same content.
    paper
        Size of the PDF's pages.
    stamp
        Also print the date and the versions of Python and of the libraries; the page then differs from day to day.
    """
    from ..design import load
    from ..design.write import write_atomically
    from ..report.content import design_report
    from ..report.html import render_html

    loaded = load(design)
    folder = Path(f"report-{folder_name(design)}") if output is None else output
    check_folder(folder)
    if pdf:
        check_typst()
    command = shlex.join(["roslf", "report", design, "-o", str(folder), *(["--pdf", "--paper", paper] if pdf else [])])
    with Progress() as progress:
        content = design_report(loaded, command=command, stamp=stamp_lines() if stamp else (), progress=progress.tell)
        files = {PAGE: render_html(content).encode()}
        if pdf:
            from ..report.pdf import render_pdf

            progress.tell("PDF")
            files[DOCUMENT] = render_pdf(content, paper)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        write_atomically(folder / name, data)
        print(folder / name)


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


class Progress:
    """One line on stderr that tells what is being made; silent where stderr is not a terminal."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()

    def __enter__(self) -> Progress:
        return self

    def tell(self, what: str) -> None:
        """Replace the line."""
        if self._shown:
            print(f"\r\x1b[2Kreport: {what} ...", end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print("\r\x1b[2K", end="", file=sys.stderr, flush=True)
