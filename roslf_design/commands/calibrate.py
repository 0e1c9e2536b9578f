"""`roslf calibrate`."""

from __future__ import annotations

import json as json_text
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from rich.console import Console

    from ..calibration import Board, DataSheet, LightField, MicrolensCentres, Observations, Session
    from ..calibration.folder import Capture
    from ..calibration.result import Outcome
    from ..design import Design
    from ..report.blocks import Block


def calibrate(
    folder: Path | None = None,
    /,
    *,
    design: str | None = None,
    board: str | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    json: Annotated[bool, Parameter(negative=())] = False,
    seed: int = 0,
    f_sigma: str = "1%",
    distortion: Literal[0, 1, 2] = 0,
    no_posterior: Annotated[bool, Parameter(negative=())] = False,
    plan: str | None = None,
    boards: int | None = None,
    tilt: str | None = None,
    distance: str | None = None,
    range: str | None = None,
    noise: float | None = None,
) -> None:
    """H, d_3 and the rest from images of a checkerboard, and how sure they are; or, with --plan, how sure they will be.

    Example: roslf calibrate captures/monday --design designs/paper.toml --board "4x5 6 mm" -o out/monday

    Example: roslf calibrate --plan paper --boards 12 --tilt "20 deg"

    Parameters
    ----------
    folder
        Raw images: white.tif (or .png), perhaps dark.tif, and images of the board by any other name.
    design
        The design that the camera was built to: a file or a preset. Gives f, pixel and microlens pitch.
    board
        The checkerboard: cells across, cells down, size of one, as "4x5 6 mm".
    output
        Folder for calibration.json, calibrated.toml, figures and index.html.
    json
        Print the JSON object instead of tables.
    seed
        Of the posterior, or of a plan's random poses; the same seed gives the same bytes.
    f_sigma
        Standard deviation of the data sheet's focal length, as "1 mm" or "1%".
    distortion
        Radial coefficients to find: 0, 1 or 2.
    no_posterior
        Leave the sampling out; intervals are then those of the Fisher matrix.
    plan
        Instead of a folder: a design whose calibration is to be planned, before anyone captures an image.
    boards
        With --plan: how many images of the board (12).
    tilt
        With --plan: the largest tilt (20 deg).
    distance
        With --plan: mean distance of the boards from the main lens (the design's focal plane).
    range
        With --plan: farthest minus nearest (a quarter of the way from the FAP to the focal plane).
    noise
        With --plan: standard deviation of a corner's coordinate in one view, in microlens pitches (0.06).
    """
    from ..calibration import CalibrationError, MissingExtraError

    planned = {"--boards": boards, "--tilt": tilt, "--distance": distance, "--range": range, "--noise": noise}
    _check_options(folder, plan, design, board, output, seed, [k for k, v in planned.items() if v is not None])
    try:
        if plan is not None:
            _plan(plan, board, boards, tilt, distance, range, noise, f_sigma, distortion, seed, json)
            return
        assert folder is not None
        assert design is not None
        assert board is not None
        assert output is not None
        result = _calibrated(folder, design, board, f_sigma, distortion, seed, no_posterior)
    except CalibrationError as error:
        raise _refusal("" if plan is None else "--plan", str(error), "" if folder is None else str(folder)) from None
    except MissingExtraError as error:
        raise _refusal("", str(error)) from None
    command = _command(folder, design, board, output, seed, f_sigma, distortion, no_posterior)
    written = _write(result, output, command)
    if json:
        print(json_text.dumps(result.to_dict(), indent=1, allow_nan=False, ensure_ascii=False))
        return
    from rich.console import Console

    print_result(result, written, Console())


def _check_options(
    folder: Path | None,
    plan: str | None,
    design: str | None,
    board: str | None,
    output: Path | None,
    seed: int,
    planned: list[str],
) -> None:
    from ..errors import InputError, Problem

    wrong = []
    if seed < 0:
        wrong.append(Problem("--seed", f"{seed} is negative; give a whole number from 0"))
    if plan is not None:
        given = {"FOLDER": folder, "--design": design, "--output": output}
        wrong += [Problem(k, "has no place beside --plan; leave it out") for k, v in given.items() if v is not None]
    elif folder is None:
        wrong.append(Problem("FOLDER", "name the folder of captured images, or plan them with --plan DESIGN"))
    else:
        needed = {"--design": design, "--board": board, "--output": output}
        examples = {"--design": "paper", "--board": '"4x5 6 mm"', "--output": "out/calibration"}
        wrong += [Problem(k, f"is missing; such as {k} {examples[k]}") for k, v in needed.items() if v is None]
        wrong += [Problem(option, "goes with --plan only; leave it out") for option in planned]
    if output is not None:
        blocked = next((p for p in (output, *output.parents) if p.exists() and not p.is_dir()), None)
        if blocked is not None:
            wrong.append(Problem("-o", f"{blocked} is a file, not a folder; name another place"))
    if wrong:
        raise InputError(tuple(wrong))


def _refusal(key: str, message: str, origin: str = "") -> Exception:
    from ..errors import InputError, Problem

    return InputError((Problem(key, " ".join(message.split())),), origin)


def _calibrated(
    folder: Path, design: str, board: str, f_sigma: str, distortion: int, seed: int, no_posterior: bool
) -> Outcome:
    from ..calibration import calibrate as calibrate_corners
    from ..calibration import camera_of, find_centres, sample_posterior
    from ..calibration.errors import optional_module
    from ..calibration.folder import read_capture
    from ..calibration.result import outcome_of
    from ..design import load

    checkerboard = _board(board)
    loaded = load(design)
    sheet = _sheet(loaded, f_sigma)
    optional_module("cv2", "finding checkerboard corners")
    if not no_posterior:
        optional_module("emcee", "sampling the posterior")
    with _status() as status:
        status.tell("reading the white image")
        capture = read_capture(folder)
        status.tell("finding microlens centres")
        centres = find_centres(capture.white, capture.dark, layout=loaded.microlens_array.layout)
        observations = _observed(capture, centres, checkerboard, status)
        status.tell("fitting")
        found = calibrate_corners(observations, sheet, distortion=distortion, guess=camera_of(loaded).A)
        posterior = None
        if not no_posterior:
            status.tell("sampling the posterior")

            def progress(steps: int, worst: float, least: float) -> None:
                status.tell(
                    f"sampling the posterior: {steps} steps, R-hat {worst:.4f}, effective sample size {least:.0f}"
                )

            posterior = sample_posterior(found.fit, sheet, seed=seed, progress=progress)
    notes = _mismatch(loaded, centres)
    return outcome_of(
        loaded, checkerboard, sheet, centres, found, posterior, seed=seed, distortion=distortion, warnings=notes
    )


def _observed(capture: Capture, centres: MicrolensCentres, board: Board, status: _Status) -> Observations:
    """Corners of every image, decoded one at a time: a dozen light fields at once would fill the memory."""
    import numpy as np

    from ..calibration import CalibrationError, Observations, decode, find_corners, observe

    seen: list[Observations] = []
    missing: list[str] = []
    for number, path in enumerate(capture.boards, 1):
        status.tell(f"finding the board in {path.name} ({number} of {len(capture.boards)})")
        image = capture.board(path)
        try:
            field: LightField = decode(image, centres.lattice, white=capture.white, dark=capture.dark)
        except CalibrationError as error:
            raise CalibrationError(f"{path.name}: {error}") from None
        if find_corners(field.view(), board, field.view_weight()) is None:
            missing.append(path.name)
        else:
            seen.append(observe({path.name: field}, board))
    if not seen:
        raise CalibrationError(
            f"no board of {board.columns} x {board.rows} cells ({board.inner[0]} x {board.inner[1]} inner corners) was"
            f" found in any of the images: {', '.join(missing)}; check --board, light and focus"
        )
    uv = np.concatenate([o.uv for o in seen])
    return Observations(seen[0].points, seen[0].views, uv, tuple(o.names[0] for o in seen), tuple(missing))


def _mismatch(design: Design, centres: MicrolensCentres) -> tuple[str, ...]:
    """A warning where the white image's pitch is not the design's."""
    from ..effects.field import image_pitch

    expected, found = abs(image_pitch(design)) / design.q, centres.lattice.pitch
    if abs(found / expected - 1) < 0.02:
        return ()
    return (
        f"the microlens images are {found:.3f} px apart, and the design says {expected:.3f} px: are --design, its pixel"
        " and its microlens pitch those of this camera?",
    )


def _board(text: str) -> Board:
    from ..calibration import Board, CalibrationError

    try:
        return Board.parse(text)
    except CalibrationError as error:
        raise _refusal("--board", str(error)) from None


def _sheet(design: Design, f_sigma: str) -> DataSheet:
    from ..calibration import sheet_of

    text = f_sigma.strip()
    if text.endswith("%"):
        try:
            relative = float(text[:-1]) / 100
        except ValueError:
            raise _refusal("--f-sigma", f'"{f_sigma}" is not understood; give "1 mm" or "1%"') from None
    else:
        relative = _quantity("--f-sigma", f_sigma, "length") / design.f
    return sheet_of(design, relative)


def _quantity(option: str, text: str, dimension: str) -> float:
    from ..design.units import parse_quantity

    try:
        return parse_quantity(text, dimension)
    except ValueError as error:
        raise _refusal(option, str(error)) from None


def _plan(
    design: str,
    board: str | None,
    boards: int | None,
    tilt: str | None,
    distance: str | None,
    distance_range: str | None,
    noise: float | None,
    f_sigma: str,
    distortion: int,
    seed: int,
    json: bool,
) -> None:
    from ..calibration import CalibrationError, camera_of
    from ..calibration import plan as planned
    from ..calibration.planning import reason
    from ..calibration.section import plan_blocks, plan_to_dict
    from ..design import load

    loaded = load(design)
    captures = captures_for(
        loaded,
        board=_board("4x5 6 mm" if board is None else board),
        boards=12 if boards is None else boards,
        tilt=_quantity("--tilt", tilt or "20 deg", "angle"),
        distance=None if distance is None else _quantity("--distance", distance, "length"),
        distance_range=None if distance_range is None else _quantity("--range", distance_range, "length"),
        noise=0.06 if noise is None else noise,
    )
    with _status() as status:
        status.tell("planning")
        try:
            found = planned(camera_of(loaded), _sheet(loaded, f_sigma), captures, distortion=distortion, seed=seed)
        except CalibrationError as error:
            why = reason(captures)
            if why in str(error) or "into the bore" in str(error):
                raise
            raise CalibrationError(f"{error}: {why}") from None
    notes = too_large(loaded, captures)
    if json:
        data = {**plan_to_dict(found, loaded.name, seed, distortion), "warnings": list(notes)}
        print(json_text.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))
        return
    import math

    from rich.console import Console

    console = Console()
    b = captures.board
    console.print(f"[bold]Plan of a calibration of {loaded.name}[/bold]", highlight=False)
    console.print(
        f"{captures.boards} images of a {b.columns} x {b.rows} board of {b.cell:g} mm cells, tilted by up to"
        f" {math.degrees(captures.tilt):g} degrees, {captures.distance:.4g} +- {captures.distance_range / 2:.3g} mm"
        f" from the lens; corners to {captures.noise:g} pitches in {len(captures.view_grid())} views; f to {f_sigma}.",
        highlight=False,
        soft_wrap=True,
    )
    _print_blocks(plan_blocks(found), console)
    for note in notes:
        console.print(f"Note: {note}.", highlight=False, soft_wrap=True)


def too_large(design: Design, captures: Session) -> tuple[str, ...]:
    """A warning where the sensor cannot see the whole board at its nearest: a plan counts every corner as seen."""
    from ..calibration import camera_of

    board, camera = captures.board, camera_of(design)
    nearest = captures.distance - captures.distance_range / 2 - design.d_3
    field = sorted(size * nearest / camera.A for size in design.sensor_size)
    sides = sorted((board.columns * board.cell, board.rows * board.cell))
    if all(side <= seen for side, seen in zip(sides, field, strict=True)):
        return ()
    return (
        f"the board measures {sides[0]:.4g} x {sides[1]:.4g} mm, but the sensor sees only {field[0]:.3g} x"
        f" {field[1]:.3g} mm at its nearest, and the plan counts every corner as seen: choose a smaller --board",
    )


def captures_for(
    design: Design,
    *,
    board: Board,
    boards: int,
    tilt: float,
    distance: float | None,
    distance_range: float | None,
    noise: float,
) -> Session:
    """What one means to capture with a design; distances not given lie about its focal plane.

    Parameters
    ----------
    design : Design
    board : Board
    boards : int
    tilt : float
        [rad]
    distance, distance_range : float, optional
        [mm]
    noise : float
        [pitches]

    Raises
    ------
    CalibrationError
        A number out of range.
    """
    import math

    from ..calibration import CalibrationError, Session
    from ..theory.aperture import effective_image_distance

    if not 0 <= tilt < math.pi / 2:
        raise CalibrationError(f"boards cannot be tilted by {math.degrees(tilt):g} degrees; stay below 90")
    if distance_range is not None and distance_range < 0:
        raise CalibrationError(f"a range of distances is not negative, got {distance_range:g} mm")
    middle = design.d_f if distance is None else distance
    depth = middle - design.d_3
    image = design.D_F * design.d_2 / abs(float(effective_image_distance(design.f, design.d_1, design.d_3)))
    return Session(
        board=board,
        boards=boards,
        distance=middle,
        distance_range=depth / 4 if distance_range is None else distance_range,
        tilt=tilt,
        offset=0.035 * max(depth, 0.0),
        noise=noise,
        # As far out as corners are followed: views at the pupil's rim are left out.
        reach=0.385 * min(design.d, image) / design.q,
    )


def _write(result: Outcome, folder: Path, command: str) -> list[Path]:
    """Everything into the folder, drawn before the first file is written."""
    from .. import __version__
    from ..calibration.figures import drawn
    from ..calibration.section import calibration_report
    from ..design import DesignError, dumps
    from ..design.write import write_atomically
    from ..report.figures.style import standalone, to_png, to_svg
    from ..report.html import render_html

    text = json_text.dumps(result.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
    files = {"calibration.json": (text + "\n").encode()}
    try:
        files["calibrated.toml"] = dumps(result.calibrated).encode()
    except DesignError as error:
        print(f"roslf: no calibrated.toml, the values make no design: {' '.join(str(error).split())}", file=sys.stderr)
    drawings = {}
    for name, figure in drawn(result).items():
        drawings[name] = to_svg(figure, f"calibration-{name}")
        files[f"{name}.svg"] = standalone(drawings[name])
        files[f"{name}.png"] = to_png(figure)
    files["index.html"] = render_html(calibration_report(result, drawings, command, __version__)).encode()
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_atomically(folder / name, content)
    return [folder / name for name in files]


def _command(
    folder: Path, design: str, board: str, output: Path, seed: int, f_sigma: str, distortion: int, no_posterior: bool
) -> str:
    words = ["roslf", "calibrate", str(folder), "--design", design, "--board", board, "-o", str(output)]
    words += ["--f-sigma", f_sigma, "--distortion", str(distortion), "--seed", str(seed)]
    return shlex.join([*words, "--no-posterior"] if no_posterior else words)


def print_result(result: Outcome, written: list[Path], console: Console) -> None:
    """Sentences and tables for a terminal."""
    from rich.text import Text

    from ..calibration.section import quantities_table, shares_table, statements, ways_table

    marks = {"good": ("✓", "green"), "bad": ("✗", "red"), "caution": ("!", "yellow"), "plain": ("·", "dim")}
    console.print(Text(f"Calibration of {result.design.name}", style="bold"))
    for statement in statements(result):
        mark, colour = marks[statement.tone]
        said = f"{statement.text} {statement.remedy}".strip()
        console.print(Text(f"{mark} ", style=colour) + Text(said), soft_wrap=True)
    _print_blocks((quantities_table(result), ways_table(result), shares_table(result.shares)), console)
    console.print(f"\nWritten to {written[0].parent}: ", end="", highlight=False)
    console.print(", ".join(path.name for path in written), highlight=False, soft_wrap=True)


def _print_blocks(blocks: tuple[Block, ...], console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    from ..report.blocks import Bullets
    from ..report.blocks import Table as Rows

    for block in blocks:
        console.print()
        if isinstance(block, Bullets):
            for item in block.items:
                console.print(item, highlight=False, soft_wrap=True)
        elif isinstance(block, Rows):
            console.print(Text(block.title, style="italic"))
            table = Table(box=None, header_style="bold", pad_edge=False)
            for heading, align in zip(block.headings, block.align, strict=True):
                table.add_column(Text(heading), justify="left" if align == "l" else "right")
            for row in block.rows:
                table.add_row(*(Text(cell) for cell in row))
            console.print(table)


class _Status:
    """One line on stderr that tells what is being done; silent where stderr is not a terminal."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()

    def tell(self, what: str) -> None:
        """Replace the line."""
        if self._shown:
            print(f"\r\x1b[2Kcalibrate: {what} ...", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Leave nothing behind."""
        if self._shown:
            print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


@contextmanager
def _status() -> Iterator[_Status]:
    status = _Status()
    try:
        yield status
    finally:
        status.clear()
