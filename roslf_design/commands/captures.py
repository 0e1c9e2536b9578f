"""Depth in captures of users: raw images and files of views, read and measured for `roslf depth`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..calibration.lengths import LengthCovariance
from ..calibration.model import relative_sigma
from ..calibration.result import image_pitch
from ..camera import Camera
from ..depth.captured import (
    MeasuredCapture,
    image_width,
    measured_noise,
    on_array,
    raw_noise,
    scaled,
    searched,
    truth_of,
    with_errors_of,
)  # fmt: skip
from ..depth.geometry import ArrayGeometry, GridGeometry, ViewGeometry
from ..depth.measure import LEAST, measure
from ..depth.unmixing import evened
from ..depth.view_files import MATLAB, read_pfm, read_views
from ..design import Design, load
from ..errors import InputError, Problem
from ..imaging.camera import Region
from ..reporting.calibrate.pages import calibrated_camera
from ..units import read_quantity
from .raw_images import OTHER_CAMERA, RawDecoded, UnfinishedError, from_raw, refused
from .terminal import refusal

VIEWS_WINDOW, WIDEST = 7, 99
"""Pixels of views that are matched together along each side, unless told otherwise, and the most."""
LEAST_KNOWN = 0.2
"""Relative standard error beyond which a length is as good as not known."""
TRUTH = "gt_disp_lowres.pfm"
"""Disparities of the middle view, in a folder of the 4D Light Field Benchmark."""


def captured(
    image: Path,
    design: str | None = None,
    white: Path | None = None,
    dark: Path | None = None,
    calibrated: Path | None = None,
    *,
    region: tuple[int, int, int, int] | None = None,
    between: str | None = None,
    window: int | None = None,
    truth: Path | None = None,
    sigma: Mapping[str, str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> MeasuredCapture:
    """Depth in a raw image, or in decoded views; options as on the command line.

    Raises
    ------
    InputError
        What cannot be read, or does not go together.
    """
    if window is not None and not (3 <= window <= WIDEST and window % 2):
        raise refusal("--window", f"{window} is no window; give an odd number from 3 to {WIDEST}")
    is_views = image.is_dir() or image.suffix.lower() == MATLAB
    camera, covariance = _camera(image, design, calibrated, needed=not is_views)
    known_to = _known_to(camera, covariance, sigma or {})
    read = _views if is_views else _raw
    return read(
        image, camera, covariance, white=white, dark=dark, calibrated=calibrated, region=region, between=between,
        window=window, truth=truth, known_to=known_to, progress=progress,
    )  # fmt: skip


def _known_to(
    design: Design | None, covariance: LengthCovariance | None, sigmas: Mapping[str, str]
) -> dict[str, float]:
    """Standard errors of lengths [mm], as somebody gives them."""
    known: dict[str, float] = {}
    for place, text in sigmas.items():
        if design is None:
            raise refusal("--sigma", "is of a camera's length; name the camera with --design")
        if covariance is not None and place in covariance.places:
            raise refusal("--sigma", f"{place} is in the calibration, with its error; leave it out")
        try:
            value = float(Camera.of(design.thin_twin)[place])
            relative = relative_sigma(text, value)
        except (KeyError, TypeError, AttributeError):
            raise refusal(
                "--sigma", f'{place} is no length of {design.name}; give one as "aperture.diameter"'
            ) from None
        except ValueError as error:
            raise refusal("--sigma", f"{place}: {error}") from None
        if not 0 < relative <= LEAST_KNOWN:
            raise refusal("--sigma", f"{place}={text} is out of range; give more than 0 and {LEAST_KNOWN:.0%} at most")
        known[place] = relative * value
    return known


def _camera(
    image: Path, design: str | None, calibrated: Path | None, *, needed: bool
) -> tuple[Design | None, LengthCovariance | None]:
    """The camera that an image is from, and how sure its lengths are."""
    named = None if design is None else load(design)
    if calibrated is None:
        if named is None and needed:
            message = f"is missing; name the camera that took {image.name}, or its --calibration"
            raise refusal("--design", message)
        return named, None
    return calibrated_camera(calibrated, named)


def _raw(
    image: Path, design: Design | None, covariance: LengthCovariance | None, *, white: Path | None, dark: Path | None,
    calibrated: Path | None, region: tuple[int, int, int, int] | None, between: str | None, window: int | None,
    truth: Path | None, known_to: Mapping[str, float], progress: Callable[[str], None],
) -> MeasuredCapture:  # fmt: skip
    assert design is not None
    if truth is not None:
        raise refusal("--truth", "goes with decoded views; leave it out")
    geometry = ArrayGeometry(design, covariance, window)
    camera = geometry.camera
    search = None if between is None else _between(between, geometry)
    try:
        raw = from_raw(image, white, dark, design, progress)
    except UnfinishedError as error:
        raise refused(error, image) from None
    lattice, pitch = raw.source.centres.lattice, image_pitch(design)
    if abs(lattice.pitch / pitch - 1) > OTHER_CAMERA:
        name = "--design" if calibrated is None else "--calibration"
        message = (
            f"microlens images of {image.name} are {lattice.pitch:.4g} px apart, and {pitch:.4g} px by {design.name}"
        )
        raise refusal(name, f"{message}; name the camera that took it")
    field = on_array(raw.field, lattice, camera, _part(camera, raw, region, image))
    if min(len(field.u), len(field.v)) < LEAST:
        raise InputError((Problem("", f"holds fewer than {LEAST} x {LEAST} microlens images"),), str(image))
    if white is None:
        field = evened(camera, field)
    if not float(field.values.max(initial=0.0)) > 0:
        raise InputError((Problem("", "is black; expose more, or check which file it is"),), str(image))
    noise = raw_noise(camera, raw.pixels, raw.notes, field)
    if raw.balance is not None:
        noise = replace(noise, pixel=noise.pixel.dimmed(raw.balance.evenness))
    progress("measuring depth")
    field = scaled(field, noise.scale)
    if search is None:
        search = searched(field, image_width(camera))
    run = measure(geometry, field, noise.pixel, search=search)
    if known_to:
        run = with_errors_of(run, field, noise.pixel, search, known_to)
    warnings = tuple(raw.source.centres.warnings)
    return MeasuredCapture(
        (run,), np.full(run.depth.shape, np.nan), None, image.name, "raw", design.name,
        "" if calibrated is None else str(calibrated), noise, known_to=known_to, warnings=warnings,
    )  # fmt: skip


def _part(camera: Camera, raw: RawDecoded, region: tuple[int, int, int, int] | None, image: Path) -> Region:
    """Region of the sensor that a raw image shows: as given, as noted in its file, or all."""
    rows, columns = raw.pixels.shape[:2]
    noted = raw.notes.get("region")
    if region is None and isinstance(noted, dict) and all(type(noted.get(key)) is int for key in Region._fields):
        region = Region(**{key: noted[key] for key in Region._fields})
    part = Region.checked(camera, region)
    if (part.columns, part.rows) != (columns, rows):
        shown = "the design's sensor has" if region is None else "--region says"
        message = (
            f"has {columns} x {rows} px, and {shown} {part.columns} x {part.rows}; say which part of the sensor it is"
            f" by --region column,row,{columns},{rows}"
        )
        raise InputError((Problem("", message),), str(image))
    return part


def _views(
    image: Path, design: Design | None, covariance: LengthCovariance | None, *, white: Path | None, dark: Path | None,
    calibrated: Path | None, region: tuple[int, int, int, int] | None, between: str | None, window: int | None,
    truth: Path | None, known_to: Mapping[str, float], progress: Callable[[str], None],
) -> MeasuredCapture:  # fmt: skip
    idle = {"--white": white, "--dark": dark, "--region": region}
    wrong = [Problem(key, "goes with a raw image, and these are views; leave it out")
             for key, value in idle.items() if value is not None]  # fmt: skip
    if wrong:
        raise InputError(tuple(wrong))
    progress("reading views")
    files = read_views(image)
    field, across = files.field, max(len(files.field.s), len(files.field.t))
    lit = int((field.weight > 0).any(axis=(2, 3)).sum())
    if lit < 2:
        raise InputError((Problem("", f"holds {lit or 'no'} view; depth needs two or more"),), str(image))
    if min(len(field.u), len(field.v)) < LEAST:
        raise InputError((Problem("", f"its views have fewer than {LEAST} x {LEAST} pixels"),), str(image))
    geometry: ViewGeometry
    grid = GridGeometry(across, files.grid, window or VIEWS_WINDOW)
    warnings = []
    if files.missing:
        warnings.append(f"{files.missing} of {field.values[:, :, 0, 0].size} views are missing")
    if design is None:
        geometry, camera, wide = grid, "parameters.cfg" if files.grid else "", float(across)
    else:
        if design.microlens_array.layout == "hexagonal":
            message = "has a hexagonal array, and nothing says how its views were made square; give the raw image"
            raise refusal("--design", message)
        geometry, camera, wide = ArrayGeometry(design, covariance, window), design.name, 0.0
        field = replace(field, pitch=image_pitch(design))
        wide = image_width(geometry.camera)
        warnings.append(
            "views are taken as one sensor pixel apart, the middle one on the axis, as roslf decode has them"
        )
    shape = (len(field.v), len(field.u))
    true, of = np.full(shape, np.nan), ""
    beside = image / TRUTH
    file = truth if truth is not None else beside if image.is_dir() and beside.exists() and design is None else None
    if file is not None:
        if design is not None:
            raise refusal("--truth", "goes with views that no --design describes; drop one")
        true, of = _truth(file, grid, shape), file.name
    search = searched(field, wide) if between is None else _between(between, geometry)
    noise = measured_noise(geometry, field, search, progress)
    if not float(field.values.max(initial=0.0)) > 0:
        raise InputError((Problem("", "all views are black; check which files they are"),), str(image))
    progress("measuring depth")
    field = scaled(field, noise.scale)
    run = noise.widened(measure(geometry, field, noise.pixel, search=search))
    if known_to:
        run = with_errors_of(run, field, noise.pixel, search, known_to)
    return MeasuredCapture(
        (run,), true, None, image.name, files.kind, camera, "" if calibrated is None else str(calibrated), noise, of,
        known_to, tuple(warnings),
    )  # fmt: skip


def _truth(file: Path, grid: GridGeometry, shape: tuple[int, ...]) -> NDArray[np.float64]:
    disparity = read_pfm(file)
    if disparity.shape != shape:
        mine, theirs = (f"{size[1]} x {size[0]}" for size in (disparity.shape, shape))
        message = f"has {mine} disparities, and the views {theirs} pixels; name the map of these views"
        raise InputError((Problem("", message),), str(file))
    if not np.isfinite(disparity).any():
        message = "has no disparity that is a finite number; name another with --truth, or take it away"
        raise InputError((Problem("", message),), str(file))
    return truth_of(grid, disparity)


def _between(text: str, geometry: ViewGeometry) -> tuple[float, float]:
    """Disparities of two distances."""
    if geometry.unit != "mm":
        raise refusal("--between", "are distances, which take a camera; name it with --design")
    try:
        ends = np.array([read_quantity(part.strip(), "length") for part in text.split(",")])
    except ValueError as error:
        raise refusal("--between", f'{error}; give two distances, as "300 mm, 400 mm"') from None
    if ends.size != 2 or not 0 < ends.min() < ends.max():
        raise refusal("--between", f'"{text}" is no pair of distances; give two, as "300 mm, 400 mm"')
    with np.errstate(divide="ignore", invalid="ignore"):
        disparities = geometry.disparity(ends)
        in_view = np.isclose(geometry.depth(disparities), ends, rtol=1e-6)
    if not in_view.all():
        raise refusal(
            "--between", f"{ends[~in_view][0]:g} mm lies where the camera sees nothing; give one in front of it"
        )
    return float(disparities.min()), float(disparities.max())
