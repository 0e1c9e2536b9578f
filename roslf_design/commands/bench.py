"""`roslf bench`: targets and protocol for a camera that was built, and what its captures are worth."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from ..bench.acceptance import RESULT, accepted, built_lengths
from ..bench.captures import ACCEPTANCE, CALIBRATION, DESIGN, SETUP, read_bench
from ..bench.check import checked
from ..bench.protocol import Protocol
from ..calibration.frames import CalibrationError
from ..calibration.model import relative_sigma
from ..calibration.options import PlanOptions
from ..design import dumps
from ..errors import OTHER_PLACE, refusal
from ..reporting.bench.acceptance import acceptance_report, acceptance_statements, acceptance_tables
from ..reporting.bench.check import check_report, image_line, summary
from ..reporting.bench.protocol import protocol_report
from ..reporting.bench.targets import target_files
from ..reporting.blocks import Statements
from ..reporting.printers import render_html, render_pdf
from ..reporting.sheet.lines import NONE
from ..theory.limits import as_design
from .calibrate import POSES, PlannedPoses, write_calibration
from .refused import refused
from .report import date_of_making
from .results import print_titled
from .terminal import (
    DesignName,
    Json,
    Output,
    StatusLine,
    check_options,
    check_typst,
    json_text,
    listed,
    say,
    status_and_bars,
    typed,
    write_files,
)

bench = App(
    name="bench",
    help="The camera that was built: a bench's protocol and targets to print, and what its captures are worth.",
    help_epilogue="Example: roslf bench paper -o out/bench",
    help_format="plaintext",
)


@bench.default
def write(
    design: DesignName,
    /,
    *,
    output: Output,
    board: str | None = None,
    poses: Annotated[PlannedPoses, Parameter(name="*", show_default=False)] = POSES,
    seed: int = 0,
) -> None:
    """The bench of a camera: a protocol of one page, targets true to scale, and folders for what is captured.

    Example: roslf bench paper -o out/bench

    Parameters
    ----------
    output
        Folder for design.toml, bench.toml, protocol.pdf and .html, targets/, calibration/ and acceptance/.
    board
        The checkerboard, as "4x5 6 mm", or "charuco 8x6 6 mm 4.5 mm DICT_4X4_50". Default: one that suits the field.
    seed
        Seed of poses and texture; the same seed gives the same bytes.
    """
    check_typst("output")
    check_options(seed, output)
    loaded = as_design(design)
    asked = PlanOptions.of(board=board, seed=seed, **dict(poses))
    with StatusLine("bench") as status:
        status.tell("planning")
        protocol = Protocol.of(loaded, asked)
        text = protocol.setup.dumps()
        _refuse_another(output / SETUP, text)
        status.tell("drawing")
        page = protocol_report(protocol)
        files = {
            DESIGN: dumps(loaded).encode(),
            SETUP: text.encode(),
            "protocol.html": render_html(page).encode(),
            "protocol.pdf": render_pdf(page),
        }
        files |= {f"targets/{name}": content for name, content in target_files(protocol.sheets).items()}
    write_files(output, files)
    for name in (CALIBRATION, ACCEPTANCE):
        (output / name).mkdir(exist_ok=True)
    for sheet in protocol.sheets:
        say(f"{sheet.title}: {sheet.remark}")
    say(f"\nWritten to {output}: {', '.join(listed(files))}")


def _refuse_another(path: Path, text: str) -> None:
    """Refuse to write over a bench.toml that says something else: what was measured of the prints stands in it."""
    if path.is_file() and path.read_text(encoding="utf-8", errors="replace") != text:
        raise refusal("output", f"{path} is of another bench, or was changed by hand; {OTHER_PLACE}")


@bench.command(name="check", help_epilogue="")
def check(folder: Path, /, *, json: Json = False) -> None:
    """Worth of the captures so far, and what to take next.

    Example: roslf bench check out/bench

    Parameters
    ----------
    folder
        Folder that roslf bench wrote, with captures in calibration/ and acceptance/.
    """
    read = read_bench(folder)
    with status_and_bars("bench check") as tell:
        result = checked(read, tell)
    write_files(folder, {"check.html": render_html(check_report(read.design.name, result)).encode()})
    if json:
        print(json_text(result.to_dict()))
        return
    for one in result.images:
        say(image_line(one))
    print_titled("\nTogether", [Statements(tuple(one for one in summary(result) if one.tone != "bad"))])
    say(f"\nWritten to {folder}: check.html")


@bench.command(name="report", help_epilogue="")
def report(
    folder: Path,
    /,
    *,
    tolerances: Path | None = None,
    placed: str = "0.2 %",
    revision: str = NONE,
    stamp: bool = True,
    json: Json = False,
) -> None:
    """Acceptance: what was measured beside the data sheet, in tolerance, out, or undecided; one page to sign.

    Example: roslf bench report out/bench --tolerances studies/tolerance-scope/study.toml

    Parameters
    ----------
    folder
        Folder that roslf bench wrote, with captures. Its calibration/result is taken, or made of sound images, without
        sampling the posterior.
    tolerances
        A study of roslf tolerance: lines get two standard deviations of its builds as their limits.
    placed
        Standard uncertainty of the distances that captures have in their names, as a share of each.
    revision
        Revision of the page, as "B".
    stamp
        Date on the page; --no-stamp for none. SOURCE_DATE_EPOCH sets it.
    """
    check_typst("folder")
    read, share = read_bench(folder), _share(placed)
    build = None if tolerances is None else built_lengths(tolerances)
    date = f"{date_of_making():%Y-%m-%d}" if stamp else NONE
    calibration, board = read.calibration / RESULT, read.setup.board.board.text
    command = typed("calibrate", read.calibration, design=folder / DESIGN, board=board, no_posterior=True,
                    output=calibration)  # fmt: skip
    with status_and_bars("bench report") as tell:
        try:
            result = accepted(
                read, calibration, lambda made: write_calibration(made, calibration, command), build, share, tell
            )
        except CalibrationError as error:
            raise refused(error, read.calibration, calibration) from None
    page = acceptance_report(result, read.design, str(calibration), revision, date)
    data = result.to_dict() | {"revision": revision, "date": date}
    write_files(
        folder,
        {
            "acceptance.html": render_html(page).encode(),
            "acceptance.pdf": render_pdf(page),
            "acceptance.json": f"{json_text(data)}\n".encode(),
        },
    )
    if json:
        print(json_text(data))
        return
    print_titled(page.title, [Statements(acceptance_statements(result)), *acceptance_tables(result)])
    say(f"\nWritten to {folder}: acceptance.html, acceptance.pdf, acceptance.json")


def _share(text: str) -> float:
    """A share from its text, as "0.2 %"; refused where it is none."""
    if text.strip().endswith("%"):
        with suppress(ValueError):
            return relative_sigma(text, 1.0)
    raise refusal("placed", f'"{text}" is no share; give "0.2 %"')
