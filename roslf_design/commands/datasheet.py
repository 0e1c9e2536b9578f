"""`roslf datasheet`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from ..errors import OTHER_PLACE, refusal
from ..progress import CountedProgress, shares
from ..reporting.printers import Paper, render_html, render_pdf
from ..reporting.sheet.lines import (
    NONE,
    SpreadSources,
    check_revision,
    datasheet_csv,
    datasheet_json,
    datasheet_report,
    sheet_title,
    title_written,
)
from ..reporting.story import calibration_of, datasheet_of, load_story_or_study
from ..theory.limits import as_design
from .report import date_of_making, folder_name
from .terminal import (
    Distances,
    OptionalOutput,
    check_options,
    check_owner,
    check_page,
    check_target,
    check_typst,
    json_text,
    read_distances,
    say,
    status_and_bars,
    write_file,
)

KINDS = (".pdf", ".html", ".json", ".csv")


def datasheet(
    design: str,
    /,
    *,
    output: OptionalOutput = None,
    paper: Literal["a4", "letter"] = "a4",
    calibration: Path | None = None,
    at: Distances = None,
    seed: int | None = None,
    revision: str = NONE,
    stamp: bool | None = None,
) -> None:
    """The page an engineer signs: field of view, distances, resolution, depth of field, in the terms of ISO 8600.

    Example: roslf datasheet studies/tolerance-scope/study.toml -o scope.pdf

    Parameters
    ----------
    design
        A design file, the name of a preset, or a study: of roslf tolerance, whose builds give each line its tolerance
        (2 sigma), of roslf optimize, whose optimum it is, or a story, whose last design it is.
    output
        File to write: .pdf, .html, .json or .csv. Default: datasheet-DESIGN.html.
    paper
        Size of the PDF's pages.
    calibration
        Folder that roslf calibrate wrote: each line gets what it leaves uncertain (2 sigma). Of a single design the
        page is then of the instrument that was calibrated. Or the word planned, which is then no folder's name: what
        roslf calibrate --plan plans of the design.
    at
        Distance ahead of the tip, as "10mm", that gets lines beside the focal plane and the working range's ends; may
        be given several times.
    seed
        Instead of the study's; the same seed gives the same bytes.
    revision
        Revision of the sheet, as "B".
    stamp
        Date on the sheet, of PDF and HTML: with --stamp on both, with --no-stamp on neither. SOURCE_DATE_EPOCH sets it.
        Default: the PDF alone.
    """
    target = Path(f"datasheet-{folder_name(design)}.html") if output is None else output
    kind = check_target(target, KINDS)
    if kind == ".pdf":
        check_typst("output")
    check_options(seed)
    distances = read_distances(at)
    check_revision(revision)
    known = calibration_of(calibration, seed, distances)
    dated = kind == ".pdf" if stamp is None else stamp
    date = f"{date_of_making():%Y-%m-%d}" if dated else NONE
    if calibration is None and load_story_or_study(Path(design))[0] == "design":
        _check_sheet(target, kind, sheet_title(as_design(design).name, revision))
    with status_and_bars("datasheet") as progress:
        grounds = datasheet_of(Path(design), seed, progress, known, distances)
        _check_sheet(target, kind, sheet_title(grounds.design.name, revision))
        content = _written(grounds, kind, paper, revision, date, progress)
    if revision != NONE and target.exists() and target.read_bytes() != content:
        raise refusal("output", f"{target} is there; a sheet with a revision is not written over; {OTHER_PLACE}")
    write_file(target, content)
    say(target)


def _check_sheet(target: Path, kind: str, title: str) -> None:
    """Refuse to write a sheet of a title over one of another design or revision."""
    if kind in (".pdf", ".html"):
        check_page(target, title)
    elif target.is_file():
        check_owner(target, title_written(target.read_bytes()), title)


def _written(
    grounds: SpreadSources, kind: str, paper: Paper, revision: str, date: str, progress: CountedProgress
) -> bytes:
    if kind == ".json":
        return f"{json_text(datasheet_json(grounds, revision))}\n".encode()
    if kind == ".csv":
        return datasheet_csv(grounds, revision)
    page = datasheet_report(grounds, revision, date, shares(progress, "pictures"))
    progress("PDF" if kind == ".pdf" else "page")
    return render_pdf(page, paper) if kind == ".pdf" else render_html(page).encode()
