"""`roslf report`."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal

from .._version import __version__
from ..design.files import KINDS
from ..drawing.solid import NoPictureError, picture, vtp_bytes
from ..drawing.svg import file_of
from ..errors import Argument, InputError, Problem, refusal
from ..evaluation.evaluate import check_evaluation_accuracy
from ..options import Options
from ..reporting.blocks import Report
from ..reporting.calibrate.pages import read_calibration
from ..reporting.design.compare import comparison_report, comparison_title
from ..reporting.design.instrument import instrument_scene
from ..reporting.printers import render_html, render_pdf, render_tables
from ..reporting.story import full_report, load_story_or_study, story_report, study_report
from ..theory.limits import as_design
from ..toml_files import read_toml
from .terminal import (
    PAGE,
    Distances,
    Flag,
    Flat,
    OptionalOutput,
    Repeated,
    check_options,
    check_typst,
    listed,
    read_distances,
    say,
    status_and_bars,
    typed,
    write_files,
)

SOLID = {"model": "model.vtp", "3d": "3d.png"}
"""Name of a 3D file to its file name."""
LIBRARIES = ("roslf_design", "numpy", "scipy", "matplotlib", "typst")
"""Whose versions a stamp tells."""


class _Contents(Options):
    """Numbers that a report stands on."""

    calibration: Path | None = None
    """Folder that roslf calibrate wrote: its posterior stands in a design's report instead of a plan, and the data
    sheet is of the instrument that was calibrated, each line with what is left uncertain of it (2 sigma)."""
    seed: int | None = None
    """Seed of all that is drawn at random, instead of the studies' own; the same seed gives the same bytes."""
    accuracy: float | None = None
    """Error that shares of light may have where parts are tilted and rays are counted, as 1e-4: of a design, or of
    designs compared. A study's own accuracy is asked of roslf optimize and roslf tolerance."""
    at: Distances = None
    """Distance ahead of the tip, as "10mm", that it reports beside the focal plane; may be given several times."""

    def maker(self, names: Sequence[str], compare: bool) -> tuple[str, Callable[..., Report]]:
        """Title, and function that makes the report of these inputs, each read and found good."""
        distances = read_distances(self.at)
        if compare and distances:
            raise refusal("at", "goes with one design, study or story; leave it out beside --compare")
        title, make = maker(names, compare, self.seed, self.accuracy, self.calibration)
        return title, partial(make, at=distances) if distances else make


CONTENTS = _Contents()


def report(
    design: str,
    /,
    *others: str,
    output: OptionalOutput = None,
    compare: Flag = False,
    contents: Annotated[_Contents, Flat] = CONTENTS,
    figure: Repeated = None,
    pdf: Flag = False,
    paper: Literal["a4", "letter"] = "a4",
    stamp: bool | None = None,
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
        Folder to write index.html to, and its tables as CSV to tables/; made if needed. Default: report-DESIGN, after
        the design file's name.
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
    stamp
        Date, version and command at the foot of the PDF; with --stamp the page, too, has the date and the versions of
        Python and of the libraries, with --no-stamp nothing does, so that the same design makes the same bytes on any
        day. SOURCE_DATE_EPOCH sets the date. Default: the PDF alone.
    """
    names, wanted = (design, *others), figure or []
    title, make = contents.maker(names, compare)
    solid = [name for name in wanted if name in SOLID]
    if solid and (len(names) > 1 or load_story_or_study(Path(design))[0] != "design"):
        raise refusal("figure", "3d and model are of one design; name its file alone")
    folder = Path("report-" + "-".join(map(folder_name, names))) if output is None else output
    pages = [PAGE, "report.pdf"][: 1 + pdf]
    check_options(contents.seed, folder, title=title, pages=pages)
    if pdf:
        check_typst("pdf")
    command = typed(
        "report", *names, compare=compare, output=folder, pdf=pdf, paper=paper if pdf else None, figure=wanted,
        **dict(contents), stamp=stamp, no_stamp=stamp is False,
    )  # fmt: skip
    made = date_of_making()
    with status_and_bars("report") as progress:
        content = make(command=command, stamp=_stamp_lines(made) if stamp else (), progress=progress)
        files = _figure_files(content, [name for name in wanted if name not in SOLID])
        files[PAGE] = render_html(content).encode()
        files |= render_tables(content)
        if "model" in solid:
            files[SOLID["model"]] = vtp_bytes(instrument_scene(as_design(design)))
        if "3d" in solid:
            progress("3D")
            try:
                files[SOLID["3d"]] = picture(instrument_scene(as_design(design)))
            except NoPictureError as error:
                say(f"roslf: {SOLID['3d']} is left out: {error}", error=True)
        if pdf:
            progress("PDF")
            foot = content.footer if stamp is False else f"roslf_design {__version__} · {made:%Y-%m-%d} · {command}"
            files["report.pdf"] = render_pdf(replace(content, footer=foot), paper)
    write_files(folder, files)
    for name in listed(files):
        say(folder / name)
    if content.answer:
        say(content.answer)


def maker(
    names: Sequence[str],
    compare: bool,
    seed: int | None,
    accuracy: float | None,
    calibration: Path | None = None,
) -> tuple[str, Callable[..., Report]]:
    """Title and maker of the report of these inputs, each read and found good.

    Raises
    ------
    InputError
        Too many or too few of them, a file that is not there, is none of the kinds, or has faults; a seed below 0; an
        accuracy that is none.
    """
    files = [name for name in names[1:] if Path(name).suffix.lower() in (".pdf", ".html", ".svg", ".png")]
    if files:
        what = "--pdf takes no value" if files[0].lower().endswith(".pdf") else "a report is named by its folder"
        where = "the files are written into the folder given with -o (the PDF as report.pdf)"
        raise InputError((Problem("report", f"'{files[0]}' is no design; {what}: {where}"),))
    if compare and len(names) not in (2, 3):
        raise refusal("compare", f"{len(names)} given; name two or three designs")
    if len(names) > 1 and not compare:
        raise InputError((Problem("report", "one design at a time; add --compare to set several side by side"),))
    check_options(seed)
    kind, story = ("design", None) if compare else load_story_or_study(Path(names[0]))
    if calibration is not None and (compare or kind != "design"):
        raise refusal("calibration", "goes with the report of one design; leave it out, or name it in the story")
    if kind == "design":
        designs = [as_design(name) for name in names]
        for each in designs:
            check_evaluation_accuracy(each, accuracy)
        if compare:
            return comparison_title(designs), partial(comparison_report, designs, accuracy=accuracy)
        known = None if calibration is None else read_calibration(calibration)
        make = partial(full_report, designs[0], seed=seed or 0, accuracy=accuracy)
        return designs[0].name, partial(make, calibrated=known, calibration=calibration)
    if accuracy is not None:
        remedy = "leave it out" if kind == "story" else f"ask it of roslf {kind}"
        raise refusal("accuracy", f"goes with designs, and {names[0]} is {KINDS[kind].called}; {remedy}")
    if story is not None:
        return story.table.story.title, partial(story_report, story, seed=seed)
    path = Path(names[0])
    return str(read_toml(path, names[0]).get("name", "")), partial(study_report, kind, path, seed=seed)


def folder_name(design: str) -> str:
    """Folder name of a design, from the name of its file."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", Path(design).stem).strip("-.") or "design"


def _figure_files(content: Report, wanted: Sequence[str]) -> dict[str, bytes]:
    """Figures as files of their own; refused where the report has none of that name, with those that it has."""
    known = {figure.name: figure for figure in content.figures}
    unknown = [name for name in wanted if name not in known and name != "all"]
    if unknown:
        there = f"there are all, {', '.join((*known, *SOLID))}"
        raise InputError(tuple(Argument("figure", f"'{name}' is not here; {there}") for name in unknown))
    return {
        f"{name}.{'svg' if isinstance(figure.content, str) else 'png'}": file_of(figure.content)
        for name, figure in known.items()
        if name in wanted or "all" in wanted
    }


def date_of_making() -> datetime:
    """Now, or what SOURCE_DATE_EPOCH says (reproducible-builds.org): seconds since 1970."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    try:
        return datetime.fromtimestamp(int(epoch), UTC) if epoch else datetime.now().astimezone()
    except (ValueError, OverflowError, OSError):
        message = f'"{epoch}" is no date; give whole seconds since 1970, or unset it'
        raise InputError((Problem("SOURCE_DATE_EPOCH", message),)) from None


def _stamp_lines(made: datetime) -> tuple[str, ...]:
    """Date, and versions of what the page was made with."""
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return made.isoformat(sep=" ", timespec="seconds"), f"Python {platform.python_version()}", libraries
