"""Depth from files that users have: raw images and decoded views, read and measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from .._arrays import by_value
from ..calibration.decoding import LightField
from ..calibration.designed import image_pitch
from ..calibration.frames import CalibrationError
from ..calibration.model import relative_sigma
from ..calibration.raw import OTHER_CAMERA, RawDecoded, from_raw
from ..calibration.written import calibrated_camera, calibrated_sensor
from ..camera import Camera
from ..design import Design
from ..errors import Argument, InputError, Problem, refusal
from ..imaging.camera import Region
from ..options import FileName, Options, refuse_idle
from ..progress import CountedProgress, shares, silent
from ..shapes.lattice import PACKINGS
from ..theory.length_covariance import LengthCovariance
from ..theory.limits import as_design
from ..units import read_quantity
from .captured import (
    FEW_VIEWS,
    CaptureNoise,
    MeasuredCapture,
    disagreement,
    image_width,
    measured_noise,
    measured_with_noise,
    on_array,
    raw_noise,
    scaled,
    searched,
    truth_of,
    with_errors_of,
)  # fmt: skip
from .estimate import Start
from .geometry import ArrayGeometry, GridGeometry, ViewGeometry
from .measure import LEAST, Depths, search_about
from .unmixing import ViewLight
from .view_files import is_views, read_pfm, read_views
from .view_order import in_order

VIEWS_WINDOW, WIDEST = 7, 99
"""Pixels of views that are matched together along each side, unless told otherwise, and the most."""
LEAST_KNOWN = 0.2
"""Relative standard error beyond which a length is as good as not known."""
PUPIL = "aperture.diameter", "aperture.sides"
"""Beginnings of places of the FAP's size."""
TRUTH = "gt_disp_lowres.pfm"
"""Disparities of the middle view, in a folder of the 4D Light Field Benchmark."""


class CaptureOptions(Options):
    """Camera that took a picture, and where to look for depth in it."""

    design: FileName | None = None
    """Design of the camera that took the image: a file or a preset."""
    white: Path | None = None
    """White image of the same camera setting: shows where the microlens images are, and takes vignetting off. Without
    one both are the design's, which is less sure."""
    dark: Path | None = None
    """Frame without light, taken off both."""
    calibration: Path | None = None
    """Folder that roslf calibrate wrote: depths by the camera as calibrated, with what that leaves open in their
    errors, and with its sensor's noise where that was measured."""
    region: tuple[int, int, int, int] | None = None
    """Column, row, columns and rows of the sensor that a raw image shows, where that is not all."""
    between: str | None = None
    """Distances between which to look, as "300 mm, 400 mm", or disparities: pixels from view to view of files of views,
    pitches over the pupil of raw images ("-2, 2"; on a command line --between=-2,2). Default: wherever something is
    sharp, or as disp_min and disp_max of parameters.cfg say."""
    window: int | None = None
    """Microlenses (pixels of views) that are matched together along each side. Default: the design's; 7 of views."""
    truth: Path | None = None
    """Disparities of decoded views, from view to view as .pfm [px], to compare with. Default: gt_disp_lowres.pfm of the
    folder, where there is one."""
    sigma: dict[str, str] = Field(default_factory=dict)
    """How surely lengths of the camera are known that no calibration states, by their places, as "1%" or "20 um"."""

    def camera(self) -> tuple[Design | None, LengthCovariance | None]:
        """Camera that an image is from, where one is named, and how sure its lengths are."""
        named = None if self.design is None else as_design(self.design)
        if self.calibration is None:
            return named, None
        design, lengths = calibrated_camera(self.calibration, named)
        return design, lengths.covariance


@by_value
@dataclass(frozen=True)
class _Capture:
    """Picture that somebody took, and the camera it is from."""

    image: Path
    options: CaptureOptions
    design: Design | None
    covariance: LengthCovariance | None
    known_to: Mapping[str, float]

    def measured(
        self, geometry: ViewGeometry, field: LightField, noise: CaptureNoise, search: tuple[float, float],
        progress: CountedProgress, begun: Start | None = None,
    ) -> tuple[Depths, CaptureNoise]:  # fmt: skip
        """Depths of a light field, and its noise as measured; errors of lengths known to some standard error count."""
        run, noise = measured_with_noise(
            geometry, field, noise, search, self.options.between is not None, begun, progress
        )
        if self.known_to:
            run = with_errors_of(run, field, noise.pixel, run.disparities.search, self.known_to)
        return run, noise

    @property
    def calibration(self) -> str:
        """Folder of the calibration; empty where there is none."""
        return "" if self.options.calibration is None else str(self.options.calibration)

    def refused(self, message: str) -> InputError:
        """Image that is not what depth takes."""
        return InputError((Problem("", message),), str(self.image))


def captured(image: Path, options: CaptureOptions, progress: CountedProgress = silent) -> MeasuredCapture:
    """Depth in a raw image, or in decoded views.

    Raises
    ------
    InputError
        What cannot be read, or does not go together; no microlens images in a raw image.
    """
    window, views = options.window, is_views(image)
    if window is not None and not (3 <= window <= WIDEST and window % 2):
        raise refusal("window", f"{window} is no window; give an odd number from 3 to {WIDEST}")
    camera, covariance = options.camera()
    if camera is None and not views:
        raise refusal("design", f"is missing; name the camera that took {image.name}, or its `calibration`")
    known_to = _known_to(camera, covariance, options.sigma)
    return (_views if views else _raw)(_Capture(image, options, camera, covariance, known_to), progress)


def _known_to(
    design: Design | None, covariance: LengthCovariance | None, sigmas: Mapping[str, str]
) -> dict[str, float]:
    """Standard errors of lengths [mm], as somebody gives them."""
    known: dict[str, float] = {}
    if covariance is not None:  # what neighbours shine into an image follows from the pupil, besides depth by lengths
        spread = np.sqrt(np.diag(covariance.matrix))
        known = {at: float(s) for at, s in zip(covariance.places, spread, strict=True) if at.startswith(PUPIL)}
    for place, text in sigmas.items():
        if design is None:
            raise refusal("sigma", "is of a camera's length; name the camera by `design`")
        if covariance is not None and place in covariance.places:
            raise refusal("sigma", f"{place} is in the calibration, with its error; leave it out")
        try:
            value = float(Camera.of(design.thin_twin)[place])
            relative = relative_sigma(text, value)
        except (KeyError, TypeError, AttributeError):
            raise refusal("sigma", f'{place} is no length of {design.name}; give one as "aperture.diameter"') from None
        except ValueError as error:
            raise refusal("sigma", f"{place}: {error}") from None
        if not 0 < relative <= LEAST_KNOWN:
            raise refusal("sigma", f"{place}={text} is out of range; give more than 0 and {LEAST_KNOWN:.0%} at most")
        known[place] = relative * value
    return known


def _raw(capture: _Capture, progress: CountedProgress) -> MeasuredCapture:
    image, design, options = capture.image, capture.design, capture.options
    assert design is not None
    if options.truth is not None:
        raise refusal("truth", "goes with decoded views; leave it out")
    geometry = ArrayGeometry(design, capture.covariance, options.window)
    camera = geometry.camera
    search = None if options.between is None else _between(options.between, geometry)
    try:
        raw = from_raw(image, options.white, options.dark, design, progress)
    except CalibrationError as error:
        raise capture.refused(" ".join(str(error).split())) from None
    lattice, pitch = raw.source.centres.lattice, image_pitch(design)
    if abs(lattice.pitch / pitch - 1) > OTHER_CAMERA:
        name = "design" if options.calibration is None else "calibration"
        message = (
            f"microlens images of {image.name} are {lattice.pitch:.4g} px apart, and {pitch:.4g} px by {design.name}"
        )
        raise refusal(name, f"{message}; name the camera that took it")
    field = on_array(raw.field, lattice, camera, _part(camera, raw, options.region, image))
    if min(len(field.u), len(field.v)) < LEAST:
        raise capture.refused(f"holds fewer than {LEAST} x {LEAST} microlens images")
    if options.white is None:
        field = ViewLight(camera, field).flat_fielded()
    if not float(field.values.max(initial=0.0)) > 0:
        raise capture.refused("is black; expose more, or check which file it is")
    sensor = None if options.calibration is None else calibrated_sensor(options.calibration)
    noise = raw_noise(camera, raw, field, sensor)
    if raw.balance is not None:
        noise = replace(noise, pixel=noise.pixel.dimmed(raw.balance.evenness))
    field = scaled(field, noise.scale)
    if search is None:
        search = searched(field, image_width(camera))
    run, noise = capture.measured(geometry, field, noise, search, progress)
    warnings = tuple(raw.source.centres.warnings)
    return MeasuredCapture(
        (run,), np.full(run.depth.shape, np.nan), None, image.name, "raw", design.name,
        capture.calibration, noise, known_to=capture.known_to, warnings=warnings,
    )  # fmt: skip


def _part(camera: Camera, raw: RawDecoded, region: tuple[int, int, int, int] | None, image: Path) -> Region:
    """Region of the sensor that a raw image shows: as given, as noted in its file, or all."""
    rows, columns = raw.pixels.shape[:2]
    noted = raw.notes.get("region")
    if region is None and isinstance(noted, dict) and all(type(noted.get(key)) is int for key in Region._fields):
        region = Region(**{key: noted[key] for key in Region._fields})
    part = Region.checked(camera, region)
    if (part.columns, part.rows) != (columns, rows):
        shown = "the design's sensor has" if region is None else "`region` says"
        message = (
            f"has {columns} x {rows} px, and {shown} {part.columns} x {part.rows}; say which part of the sensor it is"
            f" by `region` column,row,{columns},{rows}"
        )
        raise InputError((Argument("", message),), str(image))
    return part


def _views(capture: _Capture, progress: CountedProgress) -> MeasuredCapture:
    image, design, options = capture.image, capture.design, capture.options
    refuse_idle(options, ("white", "dark", "region"))
    progress("reading views")
    files = read_views(image)
    field, across = files.field, max(len(files.field.s), len(files.field.t))
    lit = int((field.weight > 0).any(axis=(2, 3)).sum())
    if lit < 2:
        raise capture.refused(f"holds {lit or 'no'} view; depth needs two or more")
    if min(len(field.u), len(field.v)) < LEAST:
        raise capture.refused(f"its views have fewer than {LEAST} x {LEAST} pixels")
    geometry: ViewGeometry
    grid = GridGeometry(across, files.grid, options.window or VIEWS_WINDOW)
    warnings = []
    if files.missing:
        warnings.append(f"{files.missing} of {field.values[:, :, 0, 0].size} views are missing")
    if design is None:
        geometry, camera, wide = grid, "parameters.cfg" if files.grid else "", float(across)
    else:
        if PACKINGS[layout := design.microlens_array.layout].slant:
            message = f"has a {layout} array, and nothing says how its views were made square; give the raw image"
            raise refusal("design", message)
        geometry, camera = ArrayGeometry(design, capture.covariance, options.window), design.name
        field = replace(field, pitch=image_pitch(design))
        wide = image_width(geometry.camera)
        warnings.append(
            "views are taken as one sensor pixel apart, the middle one on the axis, as roslf decode has them"
        )
    true, truth = _truth_of(capture, grid, (len(field.v), len(field.u)))
    ordered = in_order(field, partial(disagreement, across=across), shares(progress, "comparing orders of views"))
    field = ordered.field
    if ordered.warning:
        warnings.append(ordered.warning)
    if options.between is not None:
        search = _between(options.between, geometry)
    elif files.disparities is not None and design is None:
        search = search_about(*sorted(across * end for end in files.disparities))
    else:
        search = searched(field, wide, FEW_VIEWS)
    noise, first, field = measured_noise(geometry, field, search, options.between is not None, progress)
    if not float(field.values.max(initial=0.0)) > 0:
        raise capture.refused("all views are black; check which files they are")
    run, noise = capture.measured(geometry, field, noise, first.search, progress, first.begun)
    return MeasuredCapture(
        (run,), true, None, image.name, files.kind, camera, capture.calibration, noise, truth,
        capture.known_to, tuple(warnings),
    )  # fmt: skip


def _truth_of(capture: _Capture, grid: GridGeometry, shape: tuple[int, int]) -> tuple[NDArray[np.float64], str]:
    """True depths, and the file that they are from; NaN and empty where there is none."""
    image, design, file = capture.image, capture.design, capture.options.truth
    if file is None and design is None and image.is_dir() and (image / TRUTH).exists():
        file = image / TRUTH
    if file is None:
        return np.full(shape, np.nan), ""
    if design is not None:
        raise refusal("truth", "goes with views that no `design` describes; drop one")
    return _truth(file, grid, shape), file.name


def _truth(file: Path, grid: GridGeometry, shape: tuple[int, ...]) -> NDArray[np.float64]:
    disparity = read_pfm(file)
    if disparity.shape != shape:
        mine, theirs = (f"{size[1]} x {size[0]}" for size in (disparity.shape, shape))
        message = f"has {mine} disparities, and the views {theirs} pixels; name the map of these views"
        raise InputError((Problem("", message),), str(file))
    if not np.isfinite(disparity).any():
        message = "has no disparity that is a finite number; name another by `truth`, or take it away"
        raise InputError((Argument("", message),), str(file))
    return truth_of(grid, disparity)


def _between(text: str, geometry: ViewGeometry) -> tuple[float, float]:
    """Disparities searched [pitches] between two distances, or two disparities as results have them."""
    parts, pixels = [part.strip() for part in text.split(",")], geometry.place_unit == "px"
    example = 'give two distances, as "300 mm, 400 mm", or two disparities, as -2,2'
    try:
        disparities = np.array([float(part.removesuffix("px") if pixels else part) for part in parts])
    except ValueError:
        pass
    else:
        scale = geometry.across if isinstance(geometry, GridGeometry) else 1
        if disparities.size != 2 or not np.isfinite(disparities).all() or disparities[0] == disparities[1]:
            raise refusal("between", f'"{text}" is no pair of disparities; {example}')
        return scale * float(disparities.min()), scale * float(disparities.max())
    if geometry.unit != "mm":
        only = "distances take a camera: name it by `design`, or give disparities, as -2,2"
        raise refusal("between", f'"{text}" is no pair of disparities; {only}')
    try:
        ends = np.array([read_quantity(part, "length") for part in parts])
    except ValueError as error:
        raise refusal("between", f"{error}; {example}") from None
    if ends.size != 2 or not 0 < ends.min() < ends.max():
        raise refusal("between", f'"{text}" is no pair of distances; {example}')
    with np.errstate(divide="ignore", invalid="ignore"):
        disparities = geometry.disparity(ends)
        in_view = np.isclose(geometry.depth(disparities), ends, rtol=1e-6)
    if not in_view.all():
        raise refusal(
            "between", f"{ends[~in_view][0]:g} mm lies where the camera sees nothing; give one in front of it"
        )
    return float(disparities.min()), float(disparities.max())
