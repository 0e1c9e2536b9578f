"""`roslf calibrate`."""

from __future__ import annotations

import json as json_text
import shlex
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from .calibrate_shared import print_blocks, read_board, read_sheet, refusal
from .progress import StatusLine

if TYPE_CHECKING:
    from rich.console import Console

    from ..calibration import Board, LightField, MicrolensCentres, Observations
    from ..calibration.folder import Capture
    from ..calibration.result import Outcome
    from ..design import Design


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
    from ..calibration import CalibrationError, MissingExtraError

    planned = {"--boards": boards, "--tilt": tilt, "--distance": distance, "--range": range, "--noise": noise}
    _check_options(folder, plan, design, board, output, seed, [k for k, v in planned.items() if v is not None])
    if accuracy is not None:
        _check_accuracy(accuracy, plan, no_posterior)
    began = time.perf_counter()
    try:
        if plan is not None:
            from .calibrate_plan import print_plan

            print_plan(plan, board, boards, tilt, distance, range, noise, f_sigma, distortion, seed, json)
            return
        assert folder is not None
        assert design is not None
        assert board is not None
        assert output is not None
        result = calibrated(folder, design, board, f_sigma, distortion, seed, no_posterior, diffraction, accuracy)
    except CalibrationError as error:
        raise refusal("" if plan is None else "--plan", str(error), "" if folder is None else str(folder)) from None
    except MissingExtraError as error:
        raise refusal("", str(error)) from None
    command = _command(folder, design, board, output, seed, f_sigma, distortion, no_posterior, diffraction)
    if accuracy is not None:
        command += f" --accuracy {accuracy:g}"
    worth = replace(result.accuracy, seconds=time.perf_counter() - began)
    written = _write(result, output, command)
    if json:
        values = result.to_dict() | {"accuracy": worth.to_dict(times=True)}
        print(json_text.dumps(values, indent=1, allow_nan=False, ensure_ascii=False))
        return
    from rich.console import Console

    print_result(result, written, Console())
    print(f"{worth.seconds:.1f} s")


def _check_accuracy(accuracy: float, plan: str | None, no_posterior: bool) -> None:
    from ..calibration.precision import sample_size_for
    from ..errors import InputError, Problem

    if plan is not None or no_posterior:
        beside = "--plan" if plan is not None else "--no-posterior"
        raise InputError((Problem("--accuracy", f"is the posterior's, and has no place beside {beside}; drop one"),))
    sample_size_for(accuracy)


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
    InputError, CalibrationError, MissingExtraError
        What cannot be read, what the images do not determine, what is not installed.
    """
    from ..calibration import calibrate_corrected, camera_of, find_centres, sample_posterior, undistorted_radius
    from ..calibration.errors import optional_module
    from ..calibration.folder import read_capture
    from ..calibration.precision import most_steps_for, sample_size_for
    from ..calibration.result import outcome_of
    from ..design import load

    checkerboard = read_board(board)
    loaded = load(design)
    sheet = read_sheet(loaded, f_sigma)
    optional_module("cv2", "finding checkerboard corners")
    if not no_posterior:
        optional_module("emcee", "sampling the posterior")
    with StatusLine("calibrate") as status:
        status.tell("reading the white image")
        capture = read_capture(folder)
        status.tell("finding microlens centres")
        radius = undistorted_radius(loaded) or None
        centres = find_centres(
            capture.white, capture.dark, layout=loaded.microlens_array.layout, undistorted_radius=radius
        )
        observations = _observed(capture, centres, checkerboard, status)
        status.tell("fitting")
        found, waves = calibrate_corrected(
            observations, checkerboard, sheet, loaded, capture.white, centres.lattice,
            dark=capture.dark, distortion=distortion, guess=camera_of(loaded).A, wish=diffraction,
        )  # fmt: skip
        posterior = None
        if not no_posterior:
            status.tell("sampling the posterior")

            def progress(steps: int, worst: float, least: float) -> None:
                status.tell(
                    f"sampling the posterior: {steps} steps, R-hat {worst:.4f}, effective sample size {least:.0f}"
                )

            size = sample_size_for(accuracy)
            posterior = sample_posterior(
                found.fit, sheet, seed=seed, ess=size, most_steps=most_steps_for(size), progress=progress
            )
    notes = _mismatch(loaded, centres)
    return outcome_of(
        loaded, checkerboard, sheet, centres, found, posterior, seed=seed, distortion=distortion, warnings=notes,
        diffraction=waves, undistorted_radius=radius, accuracy=accuracy,
    )  # fmt: skip


def _observed(capture: Capture, centres: MicrolensCentres, board: Board, status: StatusLine) -> Observations:
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
    folder: Path,
    design: str,
    board: str,
    output: Path,
    seed: int,
    f_sigma: str,
    distortion: int,
    no_posterior: bool,
    diffraction: str,
) -> str:
    words = ["roslf", "calibrate", str(folder), "--design", design, "--board", board, "-o", str(output)]
    words += ["--f-sigma", f_sigma, "--distortion", str(distortion), "--seed", str(seed), "--diffraction", diffraction]
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
    print_blocks((quantities_table(result), ways_table(result), shares_table(result.shares)), console)
    console.print(f"\nWritten to {written[0].parent}: ", end="", highlight=False)
    console.print(", ".join(path.name for path in written), highlight=False, soft_wrap=True)
