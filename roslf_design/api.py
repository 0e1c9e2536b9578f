"""Functions that `import roslf_design as roslf` offers beside values: much of what the commands do.

Each takes a design, the name of a preset or the path of a file, prints nothing and writes nothing. Those that take long
tell `progress` what is being done, how much of it, and of how much (0 where nothing is counted).
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import NoneType
from typing import Any

from ._arrays import Array
from .bench.acceptance import PLACED, RESULT, Acceptance, accepted, built_lengths
from .bench.captures import read_bench
from .bench.check import BenchCheck, checked
from .calibration.options import CalibrateOptions
from .calibration.outcome import calibrated
from .calibration.result import Outcome
from .calibration.written import FILE, calibration_files
from .camera import Camera
from .depth.captured import MeasuredCapture
from .depth.decoded import Decoded, DecodeOptions, decoded
from .depth.from_files import CaptureOptions, captured
from .depth.measure import Trial, simulate
from .depth.pictures import PictureOptions
from .design import Design
from .distances import Distance, check_distances
from .drawing.picture import Picture
from .errors import expect, path_of
from .imaging.render import RawImage
from .imaging.render import render as render_image
from .optimization.study import Result, load_study
from .optimization.study import run as run_study
from .progress import CountedProgress, shares, silent
from .reporting.blocks import Code, Report
from .reporting.calibrate.pages import calibration_pictures, calibration_report
from .reporting.decode.pages import decoding_pictures, decoding_report
from .reporting.depth.captured import capture_report
from .reporting.depth.pages import depth_report, measurement_pictures
from .reporting.design.pages import design_report
from .reporting.optimise.pages import optimization_report
from .reporting.sheet.lines import NONE, check_revision, datasheet_report
from .reporting.story import calibration_of, datasheet_of, sheet_of
from .reporting.tolerance.pages import tolerance_report
from .scenes import Scene, load_scene
from .seeds import check_seed
from .theory.limits import as_design
from .theory.quantities import quantity_named
from .theory.quantity import Quantity
from .tolerancing.result import StudyResult, analyse
from .tolerancing.run import tally_chunk
from .tolerancing.study import Only, RunOptions
from .tolerancing.tally import merged

STUDY = 'a study file, which names its design: design = "mine.toml"'
PICTURES = "a raw image, or of decoded views"
CAPTURES = "a folder of captures"
BENCH = "a folder that `roslf bench` wrote"


def _scene(scene: Scene | str | Path | None) -> Scene | None:
    if isinstance(scene, (str, os.PathLike)):
        return load_scene(scene)
    expect(scene, "scene", (Scene, NoneType), "a Scene, the path of a scene file, or None")
    return scene


def quantity(name: str, at: Distance | None = None) -> Quantity:
    """A number of a camera by its name, as `roslf evaluate`, tolerance studies and the optimiser know it.

    Parameters
    ----------
    name : str
        E.g. "fill_factor", "sigma_z_mm"; `QUANTITIES` has all.
    at : float or str, optional
        Distance ahead of the bore's tip [mm] that it is asked for at; None is the focal plane.

    Returns
    -------
    Quantity
        Call it with a `Camera`, or with one and a distance: one number a build. Of a camera behind a real lens it is
        that of its thin-lens model, and a `UserWarning` says so of what rays would tell. Its unit, words and equation
        are attributes.

    Raises
    ------
    InputError
        A distance that is none.
    ValueError
        Not known; names the nearest.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> camera = roslf.Camera.of(roslf.load("paper"), {"d_3": [20.0, 120.0]})
    >>> roslf.quantity("fill_factor")(camera).round(3)
    array([0.689, 1.005])
    """
    own = quantity_named(name)
    if own.of is None or (at is None and own.of_rays is None):
        return own
    (there,), of = (None,) if at is None else check_distances(at), own.of

    def told(camera: Camera, asked: float | None) -> Array:
        if own.of_rays is not None and camera.lens.mounted:
            message = f"{name} is of the thin-lens model of {camera.lens.name}; roslf.evaluate traces field and detail"
            warnings.warn(message, stacklevel=3)
        return of(camera, asked if there is None else there)

    return replace(own, of=told)


def render(
    design: Design | str | Path,
    scene: Scene | str | Path | None = None,
    *,
    overrides: Iterable[str] = (),
    progress: CountedProgress = silent,
    **more: Any,
) -> RawImage:
    """The raw light-field image that the sensor would record, with only the physics that it needs.

    Parameters
    ----------
    design : Design, str or Path
    scene : Scene, str or Path, optional
        What is looked at; None is a white field.
    overrides : iterable of str
        Effects by hand: "all", "none", "+name", "-name".
    **more
        As `roslf_design.imaging.render.render` takes them: budget, seed, region, threads, sampling.

    Returns
    -------
    RawImage
        ``pixels`` (rows, columns), 1 where fully lit; with the plan of effects that made it.

    Raises
    ------
    InputError
        A scene that the design cannot see, an effect that is unknown, a region outside the sensor.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> roslf.render("paper", region=(2280, 1520, 40, 30)).pixels.shape
    (30, 40)
    """
    telling = shares(progress, "picture")
    return render_image(as_design(design), _scene(scene), overrides=overrides, progress=telling, **more)


def measure_depth(
    design: Design | str | Path,
    scene: Scene | str | Path | None = None,
    *,
    believed: Design | str | Path | None = None,
    progress: CountedProgress = silent,
    **options: Any,
) -> Trial:
    """Depth that a camera measures of a scene, simulated with noise, beside the truth and the error predicted.

    Parameters
    ----------
    design : Design, str or Path
        The camera, its light and sensor.
    scene : Scene, str or Path, optional
        What is looked at; None is a slanted wall with texture at the focal plane.
    believed : Design, str or Path, optional
        The camera that depth is computed for, where that is another.
    **options
        As `roslf_design.depth.pictures.PictureOptions` has them: region, seed, exposures, rays.

    Returns
    -------
    Trial
        ``summary()`` tells bias and spread; ``first.depth`` and ``first.sigma`` are the maps [mm], shape (v, u).

    Raises
    ------
    InputError
        A scene that the design cannot see; a region with too few microlenses.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> trial = roslf.measure_depth("paper", region=(2240, 1480, 110, 110))  # doctest: +SKIP
    >>> trial.summary().spread_mm  # doctest: +SKIP
    """
    other = None if believed is None else as_design(believed)
    asked = as_design(design), _scene(scene), PictureOptions.of(**options)
    return simulate(*asked, believed=other, progress=lambda what, share: progress(what, share, 1.0))


def capture_depth(image: str | Path, *, progress: CountedProgress = silent, **options: Any) -> MeasuredCapture:
    """Depth in a raw image that a camera took, or in decoded views, with its standard error.

    Parameters
    ----------
    image : str or Path
        A raw image; or decoded views: a folder of pictures, a .mat file of LFToolbox.
    **options
        As `roslf_design.depth.from_files.CaptureOptions` has them: design, white, dark, calibration, truth, region,
        between, window; sigma as ``{"aperture.diameter": "1%"}``.

    Returns
    -------
    MeasuredCapture
        ``first.depth`` and ``first.sigma`` are the maps, of ``first.noise_sigma`` and ``first.calibration_sigma``.

    Raises
    ------
    InputError
        What cannot be read, or does not go together.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> found = roslf.capture_depth("raw.tif", white="white.tif", design="paper")  # doctest: +SKIP
    >>> found.first.depth  # doctest: +SKIP
    """
    return captured(path_of(image, "image", PICTURES), CaptureOptions.of(**options), progress)


def tolerance(
    study: str | Path,
    *,
    trials: int | None = None,
    seed: int | None = None,
    only: Only | None = None,
    progress: CountedProgress = silent,
) -> StudyResult:
    """Run a tolerance study in this process: yield, sensitivities, Monte Carlo, inverse tolerances, adjustments.

    Parameters
    ----------
    study : str or Path
        A study file.
    trials, seed : int, optional
        Instead of the study's; the same seed gives the same numbers.
    only : {"yield"}, optional
        The yield without the searches behind it, which take most of the time.

    Returns
    -------
    StudyResult
        `to_dict` gives the JSON object of `roslf tolerance`; runs too long for one process are that command's.

    Raises
    ------
    InputError
        Every fault of the study file.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> result = roslf.tolerance("studies/tolerance-scope/study.toml", trials=1024)  # doctest: +SKIP
    >>> result.final.result.value  # doctest: +SKIP
    """
    plan, description, grades = RunOptions.of(trials=trials, seed=seed, only=only).plan(path_of(study, "study", STUDY))
    chunks, done = [], 0
    for index in range(plan.chunks):
        progress("trials", done, plan.trials)
        chunks.append(tally_chunk(plan, index))
        done += plan.chunk_trials(index)
    progress("trials", done, plan.trials)
    return analyse(plan, description, grades, merged(chunks), progress=progress)


def optimize(study: str | Path, *, progress: CountedProgress = silent) -> Result:
    """Find the design that a study asks for, or what stands in the way.

    Parameters
    ----------
    study : str or Path
        A study file.

    Returns
    -------
    Result
        ``designs()`` are the best and others by the names of their files; with the limits that hold and what they
        cost, the front where two goals trade.

    Raises
    ------
    InputError
        Every fault of the study file.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> result = roslf.optimize("studies/optimize-rigid-scope/study.toml")  # doctest: +SKIP
    """
    return run_study(load_study(path_of(study, "study", STUDY)), progress)


def calibrate(
    folder: str | Path,
    design: Design | str | Path,
    board: str,
    *,
    progress: CountedProgress = silent,
    **options: Any,
) -> Outcome:
    """H, d_3 and the rest from images of a checkerboard, with how sure they are.

    Parameters
    ----------
    folder : str or Path
        Holds a white image and images of the board, as `roslf calibrate` reads them.
    design : Design, str or Path
        The camera as designed.
    board : str
        Such as "4x5 6 mm" or, partly seen, "charuco 8x6 6 mm 4.5 mm DICT_4X4_50".
    **options
        As `roslf_design.calibration.options.CalibrateOptions` has them: seed, f_sigma, d_sigma, cell_sigma,
        white_pitch, distances, distortion, posterior, accuracy, diffraction, use_in; sigma as
        ``{"elements.1.thickness": "0.02 mm"}``.

    Raises
    ------
    InputError, CalibrationError
        What cannot be read, what the images do not determine.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> outcome = roslf.calibrate("captures", "paper", "4x5 6 mm")  # doctest: +SKIP
    """
    asked = path_of(folder, "folder", CAPTURES), as_design(design), CalibrateOptions.of(board=board, **options)
    return calibrated(*asked, progress)


def bench_check(folder: str | Path, *, progress: CountedProgress = silent) -> BenchCheck:
    """Worth of a bench's captures so far: faults by name, how sure H and d_3 are, and which pose to take next.

    Parameters
    ----------
    folder : str or Path
        Written by `roslf bench`, with captures in it.

    Raises
    ------
    InputError
        What cannot be read; a focused camera, whose views are none.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> roslf.bench_check("out/bench").faults  # doctest: +SKIP
    """
    return checked(read_bench(path_of(folder, "folder", BENCH)), progress)


def bench_report(
    folder: str | Path,
    *,
    tolerances: str | Path | None = None,
    placed: float = PLACED,
    progress: CountedProgress = silent,
) -> Acceptance:
    """Figures of a camera from its bench's captures beside its data sheet: in tolerance, out, or undecided.

    Parameters
    ----------
    folder : str or Path
        As of `bench_check`. Its calibration/result is taken, or one made of sound images, which is not kept.
    tolerances : str or Path, optional
        A study of `tolerance`: lines get two standard deviations of its builds as their limits.
    placed : float
        Standard uncertainty of targets' distances, of themselves.

    Raises
    ------
    InputError, CalibrationError
        What cannot be read, what the images do not determine.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> result = roslf.bench_report("out/bench", placed=0.001)  # doctest: +SKIP
    >>> [(line.name, line.value, line.expanded, line.verdict) for line in result.lines]  # doctest: +SKIP
    """
    bench = read_bench(path_of(folder, "folder", BENCH))
    build = None if tolerances is None else built_lengths(path_of(tolerances, "tolerances", STUDY))
    there = bench.calibration / RESULT
    with TemporaryDirectory() as place:
        made = Path(place)

        def write(outcome: Outcome) -> None:
            for name, content in calibration_files(outcome)[0].items():
                (made / name).write_bytes(content)

        return accepted(bench, there if (there / FILE).is_file() else made, write, build, placed, progress)


def decode(
    image: str | Path, white: str | Path | None = None, *, progress: CountedProgress = silent, **options: Any
) -> Decoded:
    """A light field with its refocus stack, from a raw image or from files of views.

    Parameters
    ----------
    image : str or Path
        A raw image; or decoded views: a folder of pictures, a .mat file of LFToolbox.
    white : str or Path, optional
        White image of the same camera setting.
    **options
        As `roslf_design.depth.decoded.DecodeOptions` has them: dark, design, calibration, focus, row.

    Returns
    -------
    Decoded
        ``field`` is the light field, ``stack`` the refocused pictures.

    Raises
    ------
    InputError, CalibrationError
        What cannot be read; an image without microlenses.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> roslf.decode("raw.tif", "white.tif", design="paper").field  # doctest: +SKIP
    """
    return decoded(path_of(image, "image", PICTURES), DecodeOptions.of(white=white, **options), progress)


def report(
    subject: Design | str | Path | Trial | MeasuredCapture | Decoded | Outcome | Result | StudyResult,
    *,
    progress: CountedProgress = silent,
) -> Report:
    """A report on a design or on a result, as sections of text, tables and figures.

    `render_html` makes it one self-contained page; ``report(...).figure("rays")`` shows one figure in a notebook.

    Parameters
    ----------
    subject : Design, str or Path, or a result
        What `measure_depth`, `capture_depth`, `decode`, `calibrate`, `optimize` and `tolerance` return.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> page = roslf.render_html(roslf.report("paper"))  # doctest: +SKIP
    """
    match subject:
        case StudyResult():
            page = tolerance_report(subject, "")
        case Result():
            page = optimization_report(subject, "")
        case Trial():
            page = depth_report(subject, measurement_pictures(subject), "")
        case MeasuredCapture():
            page = capture_report(subject, measurement_pictures(subject), "")
        case Decoded():
            page = decoding_report(subject, _drawings(decoding_pictures(subject)), "")
        case Outcome():
            page = calibration_report(subject, _drawings(calibration_pictures(subject)), "")
        case _:
            kinds = (Design, str, os.PathLike)
            expect(subject, "subject", kinds, "a design, or what another function of roslf_design returned")
            return design_report(as_design(subject), progress=progress)
    # No command made it.
    parts = (
        replace(part, blocks=tuple(b for b in part.blocks if b != Code("", "Run again"))) for part in page.sections
    )
    return replace(page, sections=tuple(part for part in parts if part.blocks))


def datasheet(
    design: Design | str | Path,
    at: Distance | Sequence[Distance] = (),
    *,
    calibration: str | Path | None = None,
    seed: int | None = None,
    revision: str = "",
    progress: CountedProgress = silent,
) -> Report:
    """The page an engineer signs, as `roslf datasheet` writes it; `render_pdf` and `render_html` print it.

    Parameters
    ----------
    design : Design, str or Path
        The name of a preset or a file as well: of a design, of a study (of `tolerance`, whose builds give each line its
        tolerance, or of `optimize`, whose optimum it is) or of a story.
    at : float or str, or several
        Distances ahead of the bore's tip that get lines of their own [mm].
    calibration : str or Path, optional
        Folder that `roslf calibrate` wrote, or "planned".
    seed : int, optional
        Instead of a study's.
    revision : str
        Of the sheet, as "B".

    Returns
    -------
    Report
        `specification` has the same numbers as values.

    Raises
    ------
    InputError
        What cannot be read; a study that finds no design; a calibration of another design.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> sheet = roslf.datasheet("paper", at="300 mm", revision="B")  # doctest: +SKIP
    >>> _ = open("paper.pdf", "wb").write(roslf.render_pdf(sheet))  # doctest: +SKIP
    """
    distances = check_distances(at)
    check_seed(0 if seed is None else seed)
    head = NONE if revision == "" else check_revision(revision)
    known = calibration_of(calibration, seed, distances)
    if isinstance(design, Design):
        grounds = sheet_of(design, known, distances)
    else:
        expect(design, "design", (str, os.PathLike), "a Design, the name of a preset or the path of a file")
        grounds = datasheet_of(Path(design), seed, progress, known, distances)
    return datasheet_report(grounds, head, tell=shares(progress, "pictures"))


def _drawings(pictures: Mapping[str, Picture]) -> dict[str, str]:
    return {name: picture.svg(name=name) for name, picture in pictures.items()}
