"""`roslf calibrate`, and its plan."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .. import calibration
from ..calibration import (
    Board,
    Calibration,
    CalibrationError,
    CameraDraws,
    Decoder,
    LightField,
    MicrolensCentres,
    Outcome,
    SideDatum,
)
from ..calibration.decoding import Samples
from ..calibration.frames import Capture
from ..calibration.model import relative_sigma
from ..calibration.planning import too_large
from ..calibration.posterior import most_steps_for, posterior_accuracy, sample_size_for
from ..calibration.result import LAPLACE_DRAWS
from ..calibration.space import in_medium
from ..design import Design, DesignError, dumps, load
from ..design.files import WRITTEN
from ..errors import InputError, Problem
from ..reporting.calibrate import pages
from ..reporting.calibrate.pictures import what_was_seen
from ..reporting.printers import page_files
from ..toml_files import nearest, read_toml, validated
from .raw_images import UnfinishedError, refused, what_there_was
from .terminal import (
    Flag,
    OptionalOutput,
    Repeated,
    StatusLine,
    bar,
    check_options,
    json_text,
    listed,
    parse_sigmas,
    picture_files,
    print_titled,
    refusal,
    say,
    typed,
    write_files,
)


def calibrate(
    folder: Path | None = None,
    /,
    *,
    design: str | None = None,
    board: str | None = None,
    output: OptionalOutput = None,
    json: Flag = False,
    seed: int = 0,
    f_sigma: str = "1%",
    d_sigma: str = "0.1%",
    cell_sigma: str = "0.1%",
    sigma: Repeated = None,
    white_pitch: str | None = None,
    distances: Path | None = None,
    distortion: Literal[0, 1, 2] | None = None,
    no_posterior: Flag = False,
    accuracy: float | None = None,
    diffraction: Literal["auto", "on", "off"] = "auto",
    use_in: str | None = None,
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
        The checkerboard: cells across, cells down, size of one, as "4x5 6 mm". Of a ChArUco board, which need not be
        seen whole, its markers' size and dictionary too, as "charuco 8x6 6 mm 4.5 mm DICT_4X4_50".
    output
        Folder for calibration.json, calibrated.toml, figures and index.html.
    json
        Print the JSON object instead of tables.
    seed
        Of the posterior, or of a plan's random poses; the same seed gives the same bytes.
    f_sigma
        Standard deviation of the data sheet's focal length, as "1 mm" or "1%".
    d_sigma
        Standard deviation of the microlens pitch, as "0.05 um" or "0.01%".
    cell_sigma
        Standard deviation of the board's cells, all alike, as "10 um" or "0.1%".
    sigma
        Standard deviation of a number of what stands before the lens or about the array, as
        "elements.1.thickness=0.02 mm", "elements.0.index=0.001", "object_space.index=0.1 %" or
        "sensor.cover.thickness=20 um"; may be given several times. Elements count from 0, as in tolerance studies.
    white_pitch
        Use the pitch of the white image's microlens images, known to this share, as "0.01%". Where --d-sigma is as
        small it ties the focal length, better than most data sheets.
    distances
        A TOML file of how far the boards stood: sigma = "0.1 mm", relative = true for readings of a rail instead of
        distances from the main lens, and under [distances] lines such as "board1.tif" = "320 mm".
    distortion
        Radial coefficients to find: 0, 1 or 2. Default: 1 where the design's main lens has a prescription, else none
        unless residuals ask for them.
    no_posterior
        Leave the sampling out; intervals are then those of the Fisher matrix (Laplace's approximation).
    accuracy
        What the posterior's means may be off by, in its own standard deviations, as 0.05 (in 95 % of runs): it is
        sampled for as long as that takes. Default: 0.1.
    diffraction
        Take microlens diffraction off the corners: always, never, or (auto) where the design's is above 0.1 px and the
        white image shows it.
    use_in
        The medium that the camera will look into where that is not the boards', as water, saline or an index: tells
        what depths would be off by, and calibrated.toml is the camera in that medium.
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
    choices = {"boards": boards, "tilt": tilt, "distance": distance, "range": range, "noise": noise}
    planned = {name: value for name, value in choices.items() if value is not None}
    places = {"FOLDER": folder, "--design": design, "--output": output, "--distances": distances}
    places["--use-in"] = use_in
    needed = {"--design": (design, "paper"), "--board": (board, '"4x5 6 mm"'), "--output": (output, "out/calibration")}
    if plan is not None:
        idle = [key for key, value in places.items() if value is not None]
        wrong = dict.fromkeys(idle, "has no place beside --plan; leave it out")
    elif folder is None:
        wrong = {"FOLDER": "name the folder of captured images, or plan them with --plan DESIGN"}
    else:
        wrong = {key: f"is missing; such as {key} {like}" for key, (value, like) in needed.items() if value is None}
        wrong |= {f"--{name}": "goes with --plan only; leave it out" for name in planned}
    if accuracy is not None and (plan is not None or no_posterior):
        beside = "--plan" if plan is not None else "--no-posterior"
        wrong["--accuracy"] = f"is the posterior's, and has no place beside {beside}; drop one"
    check_options(seed, output, *(Problem(key, message) for key, message in wrong.items()))
    if plan is not None:
        asked: dict[str, Any] = {"board": board or "4x5 6 mm", **planned, "f_sigma": f_sigma, "seed": seed}
        asked |= {
            "d_sigma": d_sigma,
            "cell_sigma": cell_sigma,
            "sigma": parse_sigmas(sigma),
            "white_pitch": white_pitch,
        }
        print_plan(plan, asked, distortion, json)
        return
    if accuracy is not None:
        sample_size_for(accuracy)
    assert folder is not None
    assert design is not None
    assert board is not None
    assert output is not None
    began = time.perf_counter()
    try:
        result = calibrated(
            folder, design, board, f_sigma, distortion, seed, no_posterior, diffraction, accuracy,
            d_sigma=d_sigma, cell_sigma=cell_sigma, white_pitch=white_pitch, distances=distances,
            use_in=use_in, sigma=parse_sigmas(sigma),
        )  # fmt: skip
    except CalibrationError as error:
        raise refused(error, folder, output) from None
    command = typed(
        "calibrate", folder, design=design, board=board, output=output, f_sigma=f_sigma, d_sigma=d_sigma,
        cell_sigma=cell_sigma, sigma=sigma, white_pitch=white_pitch, distances=distances, distortion=distortion,
        seed=seed, diffraction=diffraction, no_posterior=no_posterior, accuracy=accuracy, use_in=use_in,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    files = {"calibration.json": f"{json_text(result.to_dict())}\n".encode()}
    try:
        used = result.used_in
        files[pages.CALIBRATED] = dumps(result.calibrated if used is None else used.design, WRITTEN).encode()
    except DesignError as error:
        say(f"roslf: no calibrated.toml, the values make no design: {' '.join(str(error).split())}", error=True)
    pictures = pages.calibration_pictures(result)
    drawings = {name: picture.svg(name=f"calibration-{name}") for name, picture in pictures.items()}
    report = pages.calibration_report(result, drawings, command)
    files |= picture_files(pictures, drawings) | page_files(report)
    write_files(output, files)
    if json:
        print(json_text(result.to_dict() | {"accuracy": result.accuracy.to_dict() | {"seconds": seconds}}))
        return
    print_titled(report.title, [block for section in report.sections[:2] for block in section.blocks])
    say(f"\nWritten to {output}: {', '.join(listed(files))}\n{seconds:.1f} s")


def calibrated(
    folder: Path,
    design: str,
    board: str,
    f_sigma: str,
    distortion: int | None,
    seed: int,
    no_posterior: bool,
    diffraction: Literal["auto", "on", "off"],
    accuracy: float | None = None,
    *,
    d_sigma: str = "0.1%",
    cell_sigma: str = "0.1%",
    white_pitch: str | None = None,
    distances: Path | None = None,
    use_in: str | None = None,
    sigma: Mapping[str, str | float] | None = None,
) -> Outcome:
    """From a folder of images to what they say; options as on the command line.

    Raises
    ------
    InputError, CalibrationError
        What cannot be read, what the images do not determine.
    """
    try:
        checkerboard = Board.parse(board)
    except CalibrationError as error:
        raise refusal("--board", str(error)) from None
    loaded = load(design)
    if use_in is not None:
        try:
            in_medium(loaded, use_in)
        except DesignError as error:
            said = "; ".join(problem.message for problem in error.problems)
            raise refusal("--use-in", f"{use_in}: {said}") from None
    circular = loaded.microlens_array.lens_shape == "circular"
    sigmas = {"f_sigma": f_sigma, "d_sigma": d_sigma, "cell_sigma": cell_sigma, "white_pitch": white_pitch}
    sheet, white = _known(loaded, checkerboard, {**sigmas, "sigma": dict(sigma or {})})
    stood = None
    if distances is not None:
        stood = validated(pages.BoardDistances, read_toml(distances, str(distances)), str(distances))
    with StatusLine("calibrate") as status:
        status.tell("reading the white image")
        capture = calibration.read_capture(folder)
        if loaded.sensor.colours != "mono":
            capture = capture.balanced()
        status.tell("finding microlens centres")
        radius = calibration.undistorted_radius(loaded) or None
        pitch = calibration.image_pitch(loaded)
        try:
            centres = calibration.find_centres(
                capture.white, capture.dark, layout=loaded.microlens_array.layout, pitch=pitch,
                undistorted_radius=radius,
            )  # fmt: skip
        except CalibrationError as error:
            raise UnfinishedError(str(error), what_there_was(capture.white, str(error), pitch)) from None
    views: dict[str, Samples] = {}
    try:
        with bar("boards", len(capture.boards)) as done:
            observations = calibration.observe(_decoded(capture, centres, views, done), checkerboard, circular=circular)
        with StatusLine("calibrate") as status:
            status.tell("fitting")
            guess = calibration.camera_of(loaded).A

            def fit(count: int) -> calibration.Corrected:
                return calibration.calibrate_corrected(
                    observations, checkerboard, sheet, loaded, capture.white, centres.lattice,
                    dark=capture.dark, distortion=count, guess=guess, wish=diffraction,
                )  # fmt: skip

            def plain(corrected: calibration.Corrected) -> Calibration:
                return calibration.calibrate(corrected.calibration.observations, sheet, guess=guess)

            lens = None if loaded.lens is None else loaded.lens.name
            (fitted, waves), bent = calibration.with_distortion(fit, plain, lens, distortion)
            data = []
            if white is not None:
                data.append(calibration.white_pitch(fitted.fit, sheet, centres.lattice.pitch, white))
            if stood is not None:
                data.append(_stood(stood, str(distances), fitted, sheet))
            if no_posterior:
                draws: CameraDraws = calibration.laplace_draws(
                    fitted.fit, sheet, LAPLACE_DRAWS, np.random.default_rng(seed), data
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
                    fitted.fit, sheet, seed=seed, ess=size, most_steps=most, data=data, progress=progress
                )
    except CalibrationError as error:
        if not views:
            raise
        raise UnfinishedError(str(error), what_was_seen(centres, views)) from error
    return calibration.outcome_of(
        loaded, checkerboard, sheet, centres, fitted, draws, posterior_accuracy(draws, accuracy),
        seed=seed, distortion=bent, diffraction=waves, undistorted_radius=radius, data=data,
        medium=use_in,
    )  # fmt: skip


def _part(options: Mapping[str, Any]) -> pages.CalibrationPart:
    """Captures by a command's options, faults reported against the options."""
    try:
        return validated(pages.CalibrationPart, options)
    except InputError as error:
        faults = ((f"--{(fault.key or 'plan').replace('_', '-')}", fault.message) for fault in error.problems)
        raise InputError(tuple(Problem(*fault) for fault in faults)) from None


def _known(design: Design, board: Board, sigmas: Mapping[str, Any]) -> tuple[calibration.DataSheet, float | None]:
    """The data sheet, and how well the white image's pitch is known."""
    asked = _part(sigmas)
    try:
        sheet = pages.data_sheet(design, board, asked)
    except CalibrationError as error:
        raise refusal("--sigma", str(error).removeprefix("sigma of ")) from None
    return sheet, None if asked.white_pitch is None else relative_sigma(asked.white_pitch, 1.0)


def _stood(stood: pages.BoardDistances, file: str, fitted: Calibration, sheet: calibration.DataSheet) -> SideDatum:
    """Distances of the boards that were found; images without one are left out."""
    names, missing = fitted.observations.names, fitted.observations.missing
    wrong = [name for name in stood.distances if name not in (*names, *missing)]
    if wrong:
        said = {name: f"is no image of the board; {nearest(name, names)}" for name in wrong}
        raise InputError(tuple(Problem(f"distances.{name}", message) for name, message in said.items()), file)
    boards = {names.index(name): away for name, away in stood.distances.items() if name in names}
    return calibration.board_distances(fitted.fit, sheet, boards, stood.sigma, relative=stood.relative)


def _decoded(
    capture: Capture, centres: MicrolensCentres, views: dict[str, Samples], done: Callable[[float], None]
) -> Iterator[tuple[str, LightField]]:
    """Light fields one at a time, of which `views` keeps the central ones: a dozen at once would fill the memory."""
    decoder = Decoder.of(centres.lattice, capture.white.shape, white=capture.white, dark=capture.dark)
    for number, path in enumerate(capture.boards):
        done(number)
        try:
            field = decoder(capture.board(path))
        except CalibrationError as error:
            raise CalibrationError(f"{path.name}: {error}") from None
        views[path.name] = field.view().copy()
        yield path.name, field
        del field
    done(len(capture.boards))


def print_plan(design: str, options: Mapping[str, Any], distortion: int | None, json: bool) -> None:
    """Expected errors of a calibration that is planned, on stdout; refused where captures do not determine a camera."""
    loaded = load(design)
    asked = _part(options)
    with StatusLine("calibrate") as status:
        status.tell("planning")
        plan = pages.calibration_plan(loaded, asked, distortion)
    if isinstance(plan, str):
        raise refusal("--plan", plan)
    if json:
        large = too_large(loaded, plan.captures)
        notes = [f"{large}: choose a smaller --board"] if large else []
        print(json_text({**plan.to_dict(loaded.name, asked.seed), "warnings": notes}))
        return
    print_titled(f"Plan of a calibration of {loaded.name}", pages.plan_blocks(loaded, plan, asked))
