"""`roslf decode`."""

from __future__ import annotations

import io
import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from .. import calibration
from ..calibration import LightField
from ..calibration.refocusing import CameraDistances, Distances, focus_stack
from ..camera import Camera
from ..depth.decoded import Decoded, RawSource, textured_row
from ..depth.view_files import MATLAB, read_views, view_files
from ..design import Design, load
from ..errors import InputError, Problem, refusal
from ..reporting.calibrate.pages import CALIBRATED, read_calibration
from ..reporting.decode import pages
from ..reporting.decode.pictures import contrast
from ..reporting.printers import render_html, render_tables
from ..units import read_quantity
from .raw_images import OTHER_CAMERA, UnfinishedError, from_raw, refused
from .terminal import (
    Flag,
    OptionalOutput,
    StatusLine,
    check_options,
    json_text,
    picture_files,
    print_titled,
    say,
    typed,
    write_files,
)

MOST_PLANES = 100
"""Planes of one refocus stack."""


def decode(
    image: Path,
    /,
    *,
    white: Path | None = None,
    dark: Path | None = None,
    design: str | None = None,
    calibration: Path | None = None,
    focus: Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=())] = None,
    row: int | None = None,
    output: OptionalOutput = None,
    json: Flag = False,
) -> None:
    """From a raw light-field image to pictures: views, refocus stack, epipolar-plane image, microlens centres.

    Example: roslf decode raw.tif --white white.tif --design paper -o out/decoded

    Parameters
    ----------
    image
        A raw image (.tif, .png), as of a camera or of roslf render; or decoded views: a folder of pictures named by row
        and column (view_03_04.png) or counted (input_Cam040.png, with the parameters.cfg of the 4D light field
        benchmark), or a .mat file of LFToolbox.
    white
        White image of the same camera setting: tells where the microlens images are, and takes vignetting off. Without
        one, a design says what to look for in the image itself; views are then less sure, and vignetted.
    dark
        Frame without light, taken off both.
    design
        Of the camera: a file or a preset. Names refocused planes in mm, and helps to find the microlens images.
    calibration
        Folder that roslf calibrate wrote: the same by the camera as calibrated.
    focus
        What to refocus to, several times or with commas: distances from the main lens ("320 mm"), or disparities
        between opposite edges of the views, in pitches (1.5; of files of views in pixels), above 0 for near points.
        Default: seven planes over all that is sharp.
    row
        Row of the views that the epipolar-plane image is of, from 0. Default: the one with most texture.
    output
        Folder for pictures, views/, refocus/, decoding.json, tables/ (CSV) and index.html. Default: decoded-<image>.
    json
        Print the JSON object instead of tables.
    """
    folder = Path(f"decoded-{re.sub(r'[^A-Za-z0-9._-]+', '-', image.stem) or 'image'}") if output is None else output
    check_options(None, folder)
    began = time.perf_counter()
    with StatusLine("decode") as status:
        try:
            result = decoded(
                image, white, dark, design, calibration, focus=focus, row=row, progress=status.tell
            )  # fmt: skip
        except UnfinishedError as error:
            raise refused(error, image, folder) from None
        status.tell("drawing")
        command = typed(
            "decode", image, white=white, dark=dark, design=design, calibration=calibration, focus=focus, row=row,
            output=folder,
        )  # fmt: skip
        files = {"decoding.json": f"{json_text(result.to_dict())}\n".encode()}
        pictures = pages.decoding_pictures(result)
        drawings = {name: picture.svg(name=name) for name, picture in pictures.items()}
        report = pages.decoding_report(result, drawings, command)
        files |= picture_files(pictures, drawings) | render_tables(report)
        views = {} if result.kind == "views" else view_files(result.field)
        if views:
            write_files(folder / "views", views)
        for name, plane in zip(pages.stack_names(result), result.stack, strict=True):
            files[name] = _grey_png(plane.values, plane.weight)
        (folder / "refocus").mkdir(parents=True, exist_ok=True)
        files["index.html"] = render_html(report).encode()
        write_files(folder, files)
    seconds = time.perf_counter() - began
    if json:
        print(json_text({**result.to_dict(), "files": list(files), "views_written": len(views)}))
        return
    print_titled(report.title, report.sections[0].blocks)
    shown = [name for name in files if "/" not in name]
    say(f"\nWritten to {folder}: {', '.join(shown)}, refocus/{', views/' if views else ''}")
    print(f"{seconds:.1f} s")


def decoded(
    image: Path,
    white: Path | None = None,
    dark: Path | None = None,
    design: str | None = None,
    calibrated: Path | None = None,
    *,
    focus: list[str] | None = None,
    row: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Decoded:
    """Read and decode an image, or read views; options as on the command line.

    Raises
    ------
    InputError
        What cannot be read or does not go together.
    UnfinishedError
        No microlens images are found.
    """
    is_views = image.is_dir() or image.suffix.lower() == MATLAB
    if is_views:
        options = {"--white": white, "--dark": dark, "--design": design, "--calibration": calibrated}
        idle = [Problem(key, "goes with a raw image, and these are views; leave it out") for key, value in
                options.items() if value is not None]  # fmt: skip
        if idle:
            raise InputError(tuple(idle))
    camera, source = _camera(design, calibrated)
    warnings: list[str] = []
    raw: RawSource | None = None
    distances: Distances | None = None
    if is_views:
        progress("reading views")
        files = read_views(image)
        field, kind, distances = files.field, files.kind, files.grid
        source = "parameters.cfg" if files.grid is not None else ""
        if files.missing:
            warnings.append(f"{files.missing} of {field.values[:, :, 0, 0].size} views are missing")
    else:
        kind = "raw"
        if camera is not None:
            distances = CameraDistances(Camera.of(camera))
        field, raw = from_raw(image, white, dark, camera, progress)[:2]
        warnings += raw.centres.warnings
        designed = None if camera is None else calibration.image_pitch(camera)
        if designed is not None and abs(field.pitch / designed - 1) > OTHER_CAMERA:
            warnings.append(
                f"microlens images are {field.pitch:.4g} px apart, and {designed:.4g} px by {source}: distances are"
                " right only if it describes this camera"
            )
    chosen = None if focus is None else _disparities(focus, field, distances)
    if row is not None and not 0 <= row < len(field.v):
        raise refusal("row", f"{row} is none of the views' rows; give 0 to {len(field.v) - 1}")
    progress("refocusing")
    stack = focus_stack(field, chosen, distances)
    at = textured_row(field) if row is None else row
    return Decoded(image.name, kind, field, stack, at, raw, source if distances is not None else "", tuple(warnings))


def _camera(design: str | None, calibrated: Path | None) -> tuple[Design | None, str]:
    """The camera that was named, and what to call it."""
    if design is not None and calibrated is not None:
        raise refusal("calibration", "is a camera as well as --design; drop one")
    if calibrated is not None:
        read_calibration(calibrated)
        folder = calibrated if calibrated.is_dir() else calibrated.parent
        return load(folder / CALIBRATED), "the calibration"
    return (None, "") if design is None else (load(design), "the design")


def _disparities(focus: list[str], field: LightField, distances: Distances | None) -> np.ndarray:
    """Disparities across the views [pitches] that --focus asks for; far ones first."""
    disparities = []
    texts = [part.strip() for each in focus for part in each.split(",")]
    if len(texts) > MOST_PLANES:
        raise refusal("focus", f"asks for {len(texts)} planes; give {MOST_PLANES} at most, the others in another run")
    for text in texts:
        try:
            value = float(text)
        except ValueError:
            if distances is None:
                message = f'"{text}" is a distance, which takes --design or --calibration; or give a disparity, as 1.5'
                raise refusal("focus", message) from None
            try:
                away = read_quantity(text, "length")
            except ValueError as error:
                raise refusal("focus", f'{error}; give "320 mm", or a disparity, as 1.5') from None
            slope = distances.slope(away) if away > 0 else math.nan
            if not math.isclose(distances.distance(slope), away, rel_tol=1e-6):
                raise refusal(
                    "focus", f'"{text}" lies where the camera sees nothing; give one in front of it'
                ) from None
            value = -slope * field.pitch
        reach = max(len(field.u), len(field.v))
        if not abs(value) <= reach:
            raise refusal("focus", f'"{text}" is a disparity of more than the whole picture, {reach}')
        disparities.append(value)
    return np.array(sorted(disparities))


def _grey_png(values: np.ndarray, weight: np.ndarray) -> bytes:
    """A picture as a PNG of 16 bits, from black to white over what it has."""
    from PIL import Image

    low, high = contrast(values, weight)
    shades = np.clip((values - low) / (high - low), 0, 1) * (weight > 0)
    stream = io.BytesIO()
    Image.fromarray(np.rint(65535 * shades).astype(np.uint16)).save(stream, "PNG")
    return stream.getvalue()
