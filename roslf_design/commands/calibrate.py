"""`roslf calibrate`, and its plan."""

from __future__ import annotations

import json as json_text
import math
import shlex
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from cyclopts import Parameter

from .. import __version__, calibration
from ..calibration import (
    Board,
    CalibrationError,
    CameraDraws,
    Captures,
    DataSheet,
    LightField,
    MicrolensCentres,
    Outcome,
)
from ..calibration.datasheet import relative_sigma
from ..calibration.frames import Capture
from ..calibration.planning import reason, too_large
from ..calibration.posterior import most_steps_for, posterior_accuracy, sample_size_for
from ..calibration.result import LAPLACE_DRAWS
from ..design import Design, DesignError, dumps, load
from ..design.files import write_atomically
from ..errors import InputError, Problem
from ..pictures.svg import file_of
from ..reporting import calibration as pages
from ..reporting.html import render_html
from ..reporting.study_figures import calibration_pictures
from ..reporting.terminal import print_blocks, print_statements
from ..units import parse_quantity
from .progress import StatusLine

if TYPE_CHECKING:
    from rich.console import Console


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
    accuracy: float | None = None,
    diffraction: Literal["auto", "on", "off"] = "auto",
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
        Leave the sampling out; intervals are then those of the Fisher matrix (Laplace's approximation).
    accuracy
        What the posterior's means may be off by, in its own standard deviations, as 0.05 (in 95 % of runs): it is
        sampled for as long as that takes. Default: 0.1.
    diffraction
        Take microlens diffraction off the corners: always, never, or (auto) where the design's is above 0.1 px and the
        white image shows it.
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
    planned = {"--boards": boards, "--tilt": tilt, "--distance": distance, "--range": range, "--noise": noise}
    _check_options(folder, plan, design, board, output, seed, [k for k, v in planned.items() if v is not None])
    if accuracy is not None:
        if plan is not None or no_posterior:
            beside = "--plan" if plan is not None else "--no-posterior"
            raise InputError(
                (Problem("--accuracy", f"is the posterior's, and has no place beside {beside}; drop one"),)
            )
        sample_size_for(accuracy)
    began = time.perf_counter()
    try:
        if plan is not None:
            print_plan(plan, board, boards, tilt, distance, range, noise, f_sigma, distortion, seed, json)
            return
        assert folder is not None
        assert design is not None
        assert board is not None
        assert output is not None
        result = calibrated(folder, design, board, f_sigma, distortion, seed, no_posterior, diffraction, accuracy)
    except CalibrationError as error:
        raise _refusal("" if plan is None else "--plan", str(error), "" if folder is None else str(folder)) from None
    words = ["roslf", "calibrate", str(folder), "--design", design, "--board", board, "-o", str(output)]
    words += ["--f-sigma", f_sigma, "--distortion", str(distortion), "--seed", str(seed), "--diffraction", diffraction]
    words += ["--no-posterior"] if no_posterior else []
    words += ["--accuracy", f"{accuracy:g}"] if accuracy is not None else []
    command = shlex.join(words)
    seconds = time.perf_counter() - began
    written = _write(result, output, command)
    if json:
        values = result.to_dict() | {"accuracy": result.accuracy.to_dict() | {"seconds": seconds}}
        print(json_text.dumps(values, indent=1, allow_nan=False, ensure_ascii=False))
        return
    from rich.console import Console

    print_result(result, written, Console())
    print(f"{seconds:.1f} s")


def _check_options(
    folder: Path | None,
    plan: str | None,
    design: str | None,
    board: str | None,
    output: Path | None,
    seed: int,
    planned: list[str],
) -> None:
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


def calibrated(
    folder: Path,
    design: str,
    board: str,
    f_sigma: str,
    distortion: int,
    seed: int,
    no_posterior: bool,
    diffraction: Literal["auto", "on", "off"],
    accuracy: float | None = None,
) -> Outcome:
    """From a folder of images to what they say; options as on the command line.

    Raises
    ------
    InputError, CalibrationError
        What cannot be read, what the images do not determine.
    """
    checkerboard = read_board(board)
    loaded = load(design)
    sheet = read_sheet(loaded, f_sigma)
    with StatusLine("calibrate") as status:
        status.tell("reading the white image")
        capture = calibration.read_capture(folder)
        status.tell("finding microlens centres")
        radius = calibration.undistorted_radius(loaded) or None
        centres = calibration.find_centres(
            capture.white, capture.dark, layout=loaded.microlens_array.layout, undistorted_radius=radius
        )
        observations = calibration.observe(_decoded(capture, centres, status), checkerboard)
        status.tell("fitting")
        fitted, waves = calibration.calibrate_corrected(
            observations, checkerboard, sheet, loaded, capture.white, centres.lattice,
            dark=capture.dark, distortion=distortion, guess=calibration.camera_of(loaded).A, wish=diffraction,
        )  # fmt: skip
        if no_posterior:
            draws: CameraDraws = calibration.laplace_draws(
                fitted.fit, sheet, LAPLACE_DRAWS, np.random.default_rng(seed)
            )
        else:
            status.tell("sampling the posterior")

            def progress(steps: int, worst: float, least: float) -> None:
                status.tell(
                    f"sampling the posterior: {steps} steps, R-hat {worst:.4f}, effective sample size {least:.0f}"
                )

            size = sample_size_for(accuracy)
            most = most_steps_for(size)
            draws = calibration.sample_posterior(
                fitted.fit, sheet, seed=seed, ess=size, most_steps=most, progress=progress
            )
    return calibration.outcome_of(
        loaded, checkerboard, sheet, centres, fitted, draws, posterior_accuracy(draws, accuracy),
        seed=seed, distortion=distortion, diffraction=waves, undistorted_radius=radius,
    )  # fmt: skip


def _decoded(capture: Capture, centres: MicrolensCentres, status: StatusLine) -> Iterator[tuple[str, LightField]]:
    """Light fields one at a time: a dozen at once would fill the memory."""
    for number, path in enumerate(capture.boards, 1):
        status.tell(f"finding the board in {path.name} ({number} of {len(capture.boards)})")
        image = capture.board(path)
        try:
            field = calibration.decode(image, centres.lattice, white=capture.white, dark=capture.dark)
        except CalibrationError as error:
            raise CalibrationError(f"{path.name}: {error}") from None
        yield path.name, field


def _write(result: Outcome, folder: Path, command: str) -> list[Path]:
    """Everything into the folder, drawn before the first file is written."""
    text = json_text.dumps(result.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
    files = {"calibration.json": (text + "\n").encode()}
    try:
        files["calibrated.toml"] = dumps(result.calibrated).encode()
    except DesignError as error:
        print(f"roslf: no calibrated.toml, the values make no design: {' '.join(str(error).split())}", file=sys.stderr)
    drawings = {}
    for name, picture in calibration_pictures(result).items():
        drawings[name] = picture.svg(name=f"calibration-{name}")
        files[f"{name}.svg"] = file_of(drawings[name])
        files[f"{name}.png"] = picture.to_png()
    files["index.html"] = render_html(pages.calibration_report(result, drawings, command, __version__)).encode()
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_atomically(folder / name, content)
    return [folder / name for name in files]


def print_result(result: Outcome, written: list[Path], console: Console) -> None:
    """Sentences and tables for a terminal."""
    from rich.text import Text

    console.print(Text(f"Calibration of {result.design.name}", style="bold"))
    print_statements(pages.statements(result), console)
    print_blocks(
        (pages.quantities_table(result.to_dict()), pages.ways_table(result), pages.shares_table(result.shares)), console
    )
    console.print(f"\nWritten to {written[0].parent}: ", end="", highlight=False)
    console.print(", ".join(path.name for path in written), highlight=False, soft_wrap=True)


# --- the plan ---------------------------------------------------------------------------------------------------------


def print_plan(
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
    """Expected errors of a calibration that is planned, on stdout.

    Raises
    ------
    CalibrationError, InputError
        The captures do not determine the camera, or an option cannot be read.
    """
    loaded = load(design)
    captures = Captures.for_design(
        loaded,
        board=read_board("4x5 6 mm" if board is None else board),
        boards=12 if boards is None else boards,
        tilt=_quantity("--tilt", tilt or "20 deg", "angle"),
        distance=None if distance is None else _quantity("--distance", distance, "length"),
        distance_range=None if distance_range is None else _quantity("--range", distance_range, "length"),
        noise=0.06 if noise is None else noise,
    )
    with StatusLine("calibrate") as status:
        status.tell("planning")
        try:
            plan = calibration.plan(
                calibration.camera_of(loaded), read_sheet(loaded, f_sigma), captures, distortion=distortion, seed=seed
            )
        except CalibrationError as error:
            why = reason(captures)
            if why in str(error) or "into the bore" in str(error):
                raise
            raise CalibrationError(f"{error}: {why}") from None
    large = too_large(loaded, captures)
    notes = [f"{large}: choose a smaller --board"] if large else []
    if json:
        data = {**plan.to_dict(loaded.name, seed, distortion), "warnings": notes}
        print(json_text.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))
        return
    from rich.console import Console

    console = Console()
    b = captures.board
    console.print(f"[bold]Plan of a calibration of {loaded.name}[/bold]", highlight=False)
    console.print(
        f"{captures.boards} images of a {b.columns} x {b.rows} board of {b.cell:g} mm cells, tilted by up to"
        f" {math.degrees(captures.tilt):g} degrees, {captures.distance:.4g} ± {captures.distance_range / 2:.3g} mm"
        f" from the lens; corners to {captures.noise:g} pitches in {len(captures.view_grid())} views; f to {f_sigma}.",
        highlight=False,
        soft_wrap=True,
    )
    print_blocks(pages.plan_blocks(plan), console)
    for note in notes:
        console.print(f"Note: {note}.", highlight=False, soft_wrap=True)


# --- options ----------------------------------------------------------------------------------------------------------


def _refusal(key: str, message: str, origin: str = "") -> InputError:
    return InputError((Problem(key, " ".join(message.split())),), origin)


def read_board(text: str) -> Board:
    """A board from its option."""
    try:
        return Board.parse(text)
    except CalibrationError as error:
        raise _refusal("--board", str(error)) from None


def read_sheet(design: Design, f_sigma: str) -> DataSheet:
    """The data sheet of a design, f as well known as --f-sigma says."""
    try:
        relative = relative_sigma(f_sigma, design.f)
    except ValueError as error:
        raise _refusal("--f-sigma", str(error)) from None
    return calibration.sheet_of(design, relative)


def _quantity(option: str, text: str, dimension: str) -> float:
    """Millimetres or radians of an option with a unit."""
    try:
        return parse_quantity(text, dimension)
    except ValueError as error:
        raise _refusal(option, str(error)) from None
