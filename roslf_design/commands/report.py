"""`roslf report`."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ..design import load
from ..design.files import KINDS, write_atomically
from ..errors import InputError, Problem
from ..evaluation.precision import check_evaluation_accuracy
from ..pictures.solid import NoPictureError, picture, vtp_bytes
from ..pictures.svg import file_of
from ..reporting.calibration import read_calibration
from ..reporting.compare import comparison_report
from ..reporting.html import render_html
from ..reporting.pdf import render_pdf
from ..reporting.story import full_report, load_story_or_study, story_report, study_report
from .options import folder_faults, seed_faults
from .progress import StatusLine

if TYPE_CHECKING:
    from ..design import Design
    from ..reporting.blocks import Report

PAGE, DOCUMENT = "index.html", "report.pdf"
SOLID = {"model": "model.vtp", "3d": "3d.png"}
"""Name of a 3D file to its file name."""


def report(
    design: str,
    /,
    *others: str,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    pdf: Annotated[bool, Parameter(negative=())] = False,
    paper: Literal["a4", "letter"] = "a4",
    compare: Annotated[bool, Parameter(negative=())] = False,
    figure: Annotated[list[str] | None, Parameter(negative=())] = None,
    calibration: Path | None = None,
    seed: int | None = None,
    accuracy: float | None = None,
    stamp: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """A report on a design, a study, or a story of several studies: one self-contained HTML page, and a PDF.

    Example: roslf report designs/paper.toml -o reports/paper --pdf

    Example: roslf report studies/story-borescope/story.toml -o reports/story-borescope --pdf

    Example: roslf report --compare paper paper-mismatched

    Parameters
    ----------
    design
        A design file, the name of a preset (see `roslf presets`), a study of roslf optimize or roslf tolerance, or a
        story that runs several studies, each part passing its design on.
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
        Also write this figure as a file of its own, e.g. rays.svg; may be given several times. "all" writes every one
        of the page. Of one design also "model" (model.vtp, its parts in 3D for ParaView and PyVista) and "3d" (3d.png,
        drawn by PyVista; wants OpenGL, and is left out with a note where there is none).
    calibration
        Folder that roslf calibrate wrote: its posterior stands in a design's report instead of a plan.
    seed
        Of everything that chance has a part in, instead of the studies' own; the same seed gives the same bytes.
    accuracy
        Of a design, or of designs compared: what shares of light may be off by where parts are tilted and rays are
        counted, as 1e-4. A study's own accuracy is asked of roslf optimize and roslf tolerance.
    stamp
        Also print the date and the versions of Python and of the libraries; the page then differs from day to day.
    """
    names = (design, *others)
    solid = [name for name in figure or () if name in SOLID]
    make = maker(names, compare, seed, accuracy, calibration)
    subject = design_in_3d(names, compare) if solid else None
    folder = Path("report-" + "-".join(map(folder_name, names))) if output is None else output
    check_folder(folder)
    if pdf:
        check_typst()
    options = ["--compare"] * compare + ["-o", str(folder)] + ["--pdf", "--paper", paper] * pdf
    options += [part for name in figure or () for part in ("--figure", name)]
    options += [] if calibration is None else ["--calibration", str(calibration)]
    options += [] if seed is None else ["--seed", str(seed)]
    options += [] if accuracy is None else ["--accuracy", f"{accuracy:g}"]
    command = shlex.join(["roslf", "report", *names, *options])
    with StatusLine("report") as progress:
        content = make(command=command, stamp=stamp_lines() if stamp else (), progress=progress.tell)
        files = figure_files(content, [name for name in figure or () if name not in SOLID])
        files[PAGE] = render_html(content).encode()
        if subject is not None:
            progress.tell("3D")
            files |= solid_files(subject, solid)
        if pdf:
            progress.tell("PDF")
            files[DOCUMENT] = render_pdf(content, paper)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        write_atomically(folder / name, data)
        print(folder / name)


def maker(
    names: Sequence[str],
    compare: bool,
    seed: int | None,
    accuracy: float | None,
    calibration: Path | None = None,
) -> Callable[..., Report]:
    """What makes the report of these inputs, each read and found good.

    Raises
    ------
    InputError
        Too many or too few of them, a file that is not there, is none of the kinds, or has faults; a seed below 0; an
        accuracy that is none.
    """
    if compare and len(names) not in (2, 3):
        raise refusal("--compare", f"{len(names)} given; name two or three designs")
    if len(names) > 1 and not compare:
        raise refusal("report", "one design at a time; add --compare to set several side by side")
    if seed_faults(seed):
        raise InputError(tuple(seed_faults(seed)))
    misplaced = "goes with the report of one design; leave it out, or name it in the story"
    if compare:
        if calibration is not None:
            raise refusal("--calibration", misplaced)
        designs = [load(name) for name in names]
        for each in designs:
            check_evaluation_accuracy(each, accuracy)
        return partial(comparison_report, designs, accuracy=accuracy)
    (name,) = names
    known = None if calibration is None else read_calibration(calibration)
    kind, story = load_story_or_study(Path(name))
    if kind == "design":
        design = load(name)
        check_evaluation_accuracy(design, accuracy)
        return partial(full_report, design, seed=seed or 0, accuracy=accuracy, calibrated=known)
    if accuracy is not None:
        remedy = "leave it out" if kind == "story" else f"ask it of roslf {kind}"
        raise refusal("--accuracy", f"goes with designs, and {name} is {KINDS[kind].called}; {remedy}")
    if known is not None:
        raise refusal("--calibration", misplaced)
    return (
        partial(study_report, kind, Path(name), seed=seed) if story is None else partial(story_report, story, seed=seed)
    )


def refusal(key: str, message: str) -> InputError:
    """An option that cannot be had."""
    return InputError((Problem(key, message),))


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
    faults = folder_faults(folder)
    if faults:
        raise InputError(tuple(faults))
    if (folder / PAGE).is_dir():
        raise refusal("-o", f"{folder / PAGE} is a folder; name another place")


def check_typst() -> None:
    """Tell before any work where a PDF cannot be made.

    Raises
    ------
    InputError
        The typst package is not installed.
    """
    from importlib.util import find_spec

    if find_spec("typst") is None:
        raise refusal("--pdf", "a PDF needs the typst package; install it: pip install typst")


def figure_files(content: Report, wanted: Sequence[str]) -> dict[str, bytes]:
    """Figures as files of their own.

    Raises
    ------
    InputError
        The report has no figure of that name; says which it has.
    """
    known = {figure.name: figure for figure in content.figures}
    unknown = [name for name in wanted if name not in known and name != "all"]
    if unknown:
        there = f"there are all, {', '.join((*known, *SOLID))}"
        raise InputError(tuple(Problem("--figure", f"'{name}' is not here; {there}") for name in unknown))
    chosen = known if "all" in wanted else {name: known[name] for name in wanted}
    return {
        f"{name}.svg" if isinstance(figure.content, str) else f"{name}.png": file_of(figure.content)
        for name, figure in chosen.items()
    }


def design_in_3d(names: Sequence[str], compare: bool) -> Design:
    """The one design that a 3D model can be made of.

    Raises
    ------
    InputError
        Several designs, or a study.
    """
    (name, *others) = names
    if not others and not compare and load_story_or_study(Path(name))[0] == "design":
        return load(name)
    raise refusal("--figure", "3d and model are of one design; name its file alone")


def solid_files(design: Design, wanted: Sequence[str]) -> dict[str, bytes]:
    """The model and its picture; a picture that cannot be drawn here is told on stderr and left out."""
    files = {}
    if "model" in wanted:
        files[SOLID["model"]] = vtp_bytes(design)
    if "3d" in wanted:
        try:
            files[SOLID["3d"]] = picture(design)
        except NoPictureError as error:
            print(f"roslf: {SOLID['3d']} is left out: {error}", file=sys.stderr)
    return files


def stamp_lines() -> tuple[str, ...]:
    """Date, and versions of what the page was made with."""
    import platform
    from datetime import datetime
    from importlib.metadata import version

    libraries = ", ".join(
        f"{name} {version(name)}" for name in ("roslf_design", "numpy", "scipy", "matplotlib", "typst")
    )
    return (
        datetime.now().astimezone().isoformat(sep=" ", timespec="seconds"),
        f"Python {platform.python_version()}",
        libraries,
    )
