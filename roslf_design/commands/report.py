"""`roslf report`."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from .model_files import SOLID, design_in_3d, solid_files
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
    from ..design.write import write_atomically
    from ..report.html import render_html

    check_count(len(others), compare)
    names = (design, *others)
    make = maker(names, compare, seed, accuracy, calibration)
    solid = [name for name in figure or () if name in SOLID]
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
        drawn = figure_files(content, [name for name in figure or () if name not in SOLID])
        files = drawn | {PAGE: render_html(content).encode()}
        if subject is not None:
            progress.tell("3D")
            files |= solid_files(subject, solid)
        if pdf:
            from ..report.pdf import render_pdf

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
        A file that is not there, is none of the kinds, or has faults; a seed below 0; an accuracy that is none.
    """
    from ..design import load, preset_names
    from ..design.kinds import CALLED
    from ..errors import InputError, Problem
    from ..evaluation.precision import check_evaluation_accuracy

    if seed is not None and seed < 0:
        raise InputError((Problem("--seed", f"{seed} is negative; give a whole number from 0"),))
    refused = Problem("--calibration", "goes with the report of one design; leave it out, or name it in the story")
    if calibration is not None and compare:
        raise InputError((refused,))
    if compare:
        from ..report.compare import comparison_report

        designs = [load(name) for name in names]
        for each in designs:
            check_evaluation_accuracy(each, accuracy)
        return partial(comparison_report, designs, accuracy=accuracy)
    from ..report.story import full_report, load_story_or_study, story_report, study_report

    (name,) = names
    known = None
    if calibration is not None:
        from ..report.calibrated import read_calibration

        known = read_calibration(calibration)
    if name in preset_names() and not Path(name).exists():
        check_evaluation_accuracy(load(name), accuracy)
        return partial(full_report, load(name), seed=seed or 0, accuracy=accuracy, calibrated=known)
    kind, story = load_story_or_study(Path(name))
    if accuracy is not None and kind != "design":
        remedy = "leave it out" if kind == "story" else f"ask it of roslf {kind}"
        raise InputError((Problem("--accuracy", f"goes with designs, and {name} is {CALLED[kind][0]}; {remedy}"),))
    if known is not None and kind != "design":
        raise InputError((refused,))
    if story is not None:
        return partial(story_report, story, seed=seed)
    if kind == "design":
        check_evaluation_accuracy(load(name), accuracy)
        return partial(full_report, load(name), seed=seed or 0, accuracy=accuracy, calibrated=known)
    return partial(study_report, kind, Path(name), seed=seed)


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
            tuple(
                Problem("--figure", f"'{name}' is not here; there are all, {', '.join((*known, *SOLID))}")
                for name in unknown
            )
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

    libraries = ", ".join(
        f"{name} {version(name)}" for name in ("roslf_design", "numpy", "scipy", "matplotlib", "typst")
    )
    return (
        datetime.now().astimezone().isoformat(sep=" ", timespec="seconds"),
        f"Python {platform.python_version()}",
        libraries,
    )
