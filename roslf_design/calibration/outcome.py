"""From a folder of captured images to what they say of a camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..design import Design, DesignError
from ..errors import InputError, Problem, refusal
from ..progress import CountedProgress, silent
from ..theory.colours import filters
from ..theory.focused import refuse_focused
from ..toml_files import nearest, read_toml, validated
from .centres import MicrolensCentres, find_centres
from .corner_statistics import StatisticsFit
from .corners import observe
from .decoding import Decoder, LightField, Samples
from .designed import image_pitch, undistorted_radius
from .diffraction import Corners, Corrected, WhiteImage
from .distortion import Distortion, with_distortion
from .fit import Calibration, calibrate
from .frames import CalibrationError, Capture, grey_frame, read_capture
from .model import Board, DataSheet, Observations
from .noise import measured_sensor
from .options import BoardDistances, CalibrateOptions, data_sheet
from .planning import camera_of
from .posterior import CameraDraws, laplace_draws, most_steps_for, sample_posterior, sample_size_for
from .raw import NoLatticeError, full_scale
from .result import LAPLACE_DRAWS, Outcome, outcome_of
from .sidedata import SideDatum, board_distances, white_pitch
from .space import in_medium
from .white_profile import WhiteFrame


class NoCameraError(CalibrationError):
    """Decoded images that do not determine a camera.

    Parameters
    ----------
    message : str
    centres : MicrolensCentres
        As the white image tells them.
    views : mapping
        Central view of each image, by its file's name.
    """

    def __init__(self, message: str, centres: MicrolensCentres, views: Mapping[str, Samples]) -> None:
        super().__init__(message)
        self.centres, self.views = centres, views


def calibrated(folder: Path, design: Design, options: CalibrateOptions, progress: CountedProgress = silent) -> Outcome:
    """Calibration of a camera built to a design, from a folder of captured images.

    Raises
    ------
    InputError
        What cannot be read, or does not go together.
    CalibrationError
        What the images do not determine: `NoLatticeError`, `NoCameraError` with what was seen of them.
    """
    board, size = options.checkerboard, sample_size_for(options.accuracy)
    _check_medium(design, options.use_in)
    refuse_focused(design, "calibration of views")
    sheet = _sheet(design, board, options)
    stood = None
    if options.distances is not None:
        file = str(options.distances)
        stood = validated(BoardDistances, read_toml(options.distances, file), file)
    plain, capture, centres = white_image(folder, design, progress)
    views: dict[str, Samples] = {}
    try:
        fields = _decoded(capture, centres, views, progress)
        observations = observe(fields, board, lens_shape=design.microlens_array.lens_shape)
        progress("fitting")
        white = WhiteImage(capture.white, capture.dark, centres.lattice)
        corrected, bent = _fitted(observations, board, sheet, design, white, options)
        fit, data = corrected.calibration.fit, []
        if options.white_sigma is not None:
            data.append(white_pitch(fit, sheet, centres.lattice.pitch, options.white_sigma))
        if stood is not None:
            data.append(_stood(stood, str(options.distances), corrected.calibration, sheet))
        if options.posterior:
            draws: CameraDraws = _sampled(fit, sheet, data, options.seed, size, progress)
        else:
            draws = laplace_draws(fit, sheet, LAPLACE_DRAWS, np.random.default_rng(options.seed), data)
    except CalibrationError as error:
        if not views:
            raise
        raise NoCameraError(str(error), centres, views) from error
    progress("measuring sensor and pupil")
    even = WhiteFrame(
        grey_frame(plain.white, plain.dark, "white image"),
        full_scale(plain.white, plain.notes, design.sensor.bits, None, plain.dark),
        bool(plain.notes) or plain.dark is not None,
    )
    profile = even.profile(centres, design, capture.balance)
    sensor = measured_sensor(plain.whites, plain.darks, profile, centres, capture.balance is not None)
    result = outcome_of(design, sheet, centres, corrected, bent, draws, options, data)
    return replace(result, sensor=sensor, white=profile)


def _check_medium(design: Design, medium: str | None) -> None:
    if medium is None:
        return
    try:
        in_medium(design, medium)
    except DesignError as error:
        reasons = "; ".join(problem.message for problem in error.problems)
        raise refusal("use_in", f"{medium}: {reasons}") from None


def _sheet(design: Design, board: Board, options: CalibrateOptions) -> DataSheet:
    try:
        return data_sheet(design, board, options)
    except CalibrationError as error:
        raise refusal("sigma", str(error).removeprefix("sigma of ")) from None


def white_image(folder: Path, design: Design, progress: CountedProgress) -> tuple[Capture, Capture, MicrolensCentres]:
    """Captures of a folder as stored and with their colours balanced, and the centres that their white image tells."""
    progress("reading the white image")
    plain = read_capture(folder)
    capture = plain.balanced() if filters(design.sensor.colours) else plain
    progress("finding microlens centres")
    pitch, radius = image_pitch(design), undistorted_radius(design) or None
    layout = design.microlens_array.layout
    try:
        centres = find_centres(capture.white, capture.dark, layout=layout, pitch=pitch, undistorted_radius=radius)
    except CalibrationError as error:
        raise NoLatticeError(str(error), capture.white, pitch) from None
    return plain, capture, centres


def _decoded(
    capture: Capture, centres: MicrolensCentres, views: dict[str, Samples], progress: CountedProgress
) -> Iterator[tuple[str, LightField]]:
    """Light fields one at a time, of which `views` keeps the central ones: a dozen at once would fill the memory."""
    decoder = Decoder.of(centres.lattice, capture.white.shape, white=capture.white, dark=capture.dark)
    count = len(capture.boards)
    for number, path in enumerate(capture.boards):
        progress("boards", number, count)
        try:
            field = decoder(capture.board(path))
        except CalibrationError as error:
            raise CalibrationError(f"{path.name}: {error}") from None
        views[path.name] = field.view().copy()
        yield path.name, field
        del field
    progress("boards", count, count)


def _fitted(
    observations: Observations,
    board: Board,
    sheet: DataSheet,
    design: Design,
    white: WhiteImage,
    options: CalibrateOptions,
) -> tuple[Corrected, Distortion]:
    """Fit with as much distortion as is called for, diffraction taken off where it matters."""
    guess = camera_of(design).A
    corners = Corners.of(observations, board, design, white, options.diffraction)

    def fit(count: int) -> Corrected:
        return corners.calibrated(sheet, count, guess)

    def plain(corrected: Corrected) -> Calibration:
        return calibrate(corrected.calibration.observations, sheet, guess=guess)

    return with_distortion(fit, plain, design.main_lens.kind, options.distortion)


def _stood(stood: BoardDistances, file: str, fitted: Calibration, sheet: DataSheet) -> SideDatum:
    """Distances of the boards that were found; images without one are left out."""
    names, missing = fitted.observations.names, fitted.observations.missing
    wrong = [name for name in stood.distances if name not in (*names, *missing)]
    if wrong:
        faults = {name: f"is no image of the board; {nearest(name, names)}" for name in wrong}
        raise InputError(tuple(Problem(f"distances.{name}", message) for name, message in faults.items()), file)
    boards = {names.index(name): away for name, away in stood.distances.items() if name in names}
    return board_distances(fitted.fit, sheet, boards, stood.sigma, relative=stood.relative)


def _sampled(
    fit: StatisticsFit, sheet: DataSheet, data: Sequence[SideDatum], seed: int, size: float, progress: CountedProgress
) -> CameraDraws:
    """Draws of the posterior, as many as an effective sample size takes."""
    what = "sampling the posterior"
    progress(what)

    def steps_done(steps: int, worst: float, least: float) -> None:
        progress(f"{what}: {steps} steps, R-hat {worst:.4f}, effective sample size {least:.0f}")

    return sample_posterior(
        fit, sheet, seed=seed, ess=size, most_steps=most_steps_for(size), data=data, progress=steps_done
    )
