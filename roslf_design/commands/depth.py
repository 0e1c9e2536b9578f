"""`roslf depth`."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calibration.frames import SUFFIXES
from ..depth.captured import MeasuredCapture
from ..depth.measure import REASONS, Measurement, Trial, share_done, simulate
from ..depth.view_files import MATLAB
from ..design import load, preset_names
from ..errors import Problem
from ..reporting.depth.captured import capture_answers, capture_basis, capture_report
from ..reporting.depth.pages import answers, basis, depth_report, measurement_pictures
from ..reporting.printers import page_files
from ..scenes import load_scene
from .captures import captured
from .render import parse_region
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
    say,
    typed,
    write_files,
)  # fmt: skip


def depth(
    subject: str,
    /,
    *,
    scene: Path | None = None,
    output: OptionalOutput = None,
    region: str | None = None,
    exposures: int | None = None,
    believed: str | None = None,
    seed: int | None = None,
    design: str | None = None,
    white: Path | None = None,
    dark: Path | None = None,
    calibration: Path | None = None,
    between: str | None = None,
    window: int | None = None,
    truth: Path | None = None,
    sigma: Repeated = None,
    json: Flag = False,
) -> None:
    """Measure depth: in pictures of a scene, taken as a design would, with noise; or in a picture that a camera took.

    Example: roslf depth designs/paper.toml --region 2240,1480,120,120 -o out/depth

    Example: roslf depth raw.tif --white white.tif --design paper --calibration out/monday -o out/depth

    Parameters
    ----------
    subject
        A design file, or the name of a preset (see `roslf presets`): its pictures are simulated. Or a raw image (.tif,
        .png); or decoded views: a folder of pictures named by row and column, or a .mat file of LFToolbox.
    scene
        With a design: a scene file. Default: a slanted wall with texture at the focal plane.
    output
        Folder for index.html, depth.json, pictures, tables/ (CSV) and maps, made if needed: depth.tif (Z from the main
        lens in mm, 0 where unknown), sigma.tif (its standard error), status.tif (0 where measured, else why not:
        depth.json names the numbers). Default: only print.
    region
        Only a part of the sensor, as column,row,columns,rows in pixels. Default: a strip across its middle. Of a raw
        image: which part of the sensor it shows, where that is not all.
    exposures
        With a design: pictures that differ by noise alone; with several, spread is told apart from what stays.
    believed
        With a design: compute depth for this one instead, as with a wrong calibration.
    seed
        With a design: of noise and sampling; the same seed gives the same bytes.
    design
        Of the camera that took the image: a file or a preset.
    white
        White image of the same camera setting: tells where the microlens images are, and takes vignetting off. Without
        one both are the design's, which is less sure.
    dark
        Frame without light, taken off both.
    calibration
        Folder that roslf calibrate wrote: depths by the camera as calibrated, with what that leaves open in their
        errors.
    between
        Distances between which to look, as "300 mm, 400 mm". Default: wherever something is sharp.
    window
        Microlenses (pixels of views) that are matched together along each side. Default: the design's; 7 of views.
    truth
        Of decoded views: disparities from view to view as .pfm [px], to compare with. Default: gt_disp_lowres.pfm of
        the folder, where there is one.
    sigma
        How surely a length of the camera is known that no calibration tells, as aperture.diameter=1% or
        aperture.diameter="20 um"; may be repeated. What that leaves open counts in the errors. Default: as designed.
    json
        Print the JSON object instead of text.
    """
    simulated = {"--scene": scene, "--exposures": exposures, "--believed": believed, "--seed": seed}
    taken = {
        "--design": design, "--white": white, "--dark": dark, "--calibration": calibration, "--between": between,
        "--window": window, "--truth": truth, "--sigma": sigma,
    }  # fmt: skip
    capture = _is_capture(subject) or any(value is not None for value in taken.values())
    wrong = [
        Problem(key, "goes with a design, and this is a capture; leave it out")
        for key, value in simulated.items() if capture and value is not None
    ]  # fmt: skip
    if exposures is not None and exposures < 1 and not capture:
        wrong.append(Problem("--exposures", f"{exposures} is none; give 1 or more"))
    check_options(seed, output, *wrong)
    piece = None if region is None else parse_region(region)
    command = typed(
        "depth", subject, scene=scene, region=region, exposures=exposures if exposures != 1 else None,
        believed=believed, seed=seed or None, design=design, white=white, dark=dark, calibration=calibration,
        between=between, window=window, truth=truth, sigma=sigma, output=output,
    )  # fmt: skip
    result: Measurement
    if capture:
        with StatusLine("depth") as status:
            result = captured(
                Path(subject), design, white, dark, calibration, region=piece, between=between, window=window,
                truth=truth, sigma=parse_sigmas(sigma), progress=status.tell,
            )  # fmt: skip
        data, blocks = result.to_dict(), (*capture_answers(result), *capture_basis(result))
        title = f"Depth in {result.source}"
    else:
        loaded = load(subject)
        other = None if believed is None else load(believed)
        look = None if scene is None else load_scene(scene)
        with bar("depth") as tell:
            result = simulate(
                loaded, look, region=piece, seed=seed or 0, exposures=exposures or 1, believed=other,
                progress=lambda what, share: tell(share_done(what, share)),
            )  # fmt: skip
        data, blocks = result.to_dict(), (*answers(result), *basis(result))
        title = f"Depth that {loaded.name} measures"
    written: list[str] = []
    if output is not None:
        pictures = measurement_pictures(result)
        files = maps(result)
        data["files"] = {"depth_mm" if unit_of(result) == "mm" else "disparity_px": "depth.tif"}
        data["files"] |= {f"sigma_{unit_of(result)}": "sigma.tif", "status": "status.tif"}
        data["status"] = {str(code): reason for code, reason in REASONS.items()}
        files["depth.json"] = f"{json_text(data)}\n".encode()
        files |= picture_files(pictures)
        if isinstance(result, Trial):
            report = depth_report(result, pictures, command)
        else:
            assert isinstance(result, MeasuredCapture)
            report = capture_report(result, pictures, command)
        files |= page_files(report)
        write_files(output, files)
        written = listed(files)
    if json:
        print(json_text(data))
        return
    print_titled(title, blocks)
    if written:
        say(f"\nWritten to {output}: {', '.join(written)}")


def _is_capture(subject: str) -> bool:
    path = Path(subject)
    return path.suffix.lower() in (*SUFFIXES, MATLAB) or (path.is_dir() and subject not in preset_names())


def unit_of(measured: Measurement) -> str:
    """Unit of its depths: mm, or px where they are disparities."""
    return measured.first.geometry.unit


def maps(trial: Measurement) -> dict[str, bytes]:
    """Maps of the first exposure as TIFF files, rows along y, one pixel a microlens."""
    run = trial.first
    known = run.measured
    return {
        "depth.tif": _tiff(np.where(known, run.depth, 0.0).astype(np.float32)),
        "sigma.tif": _tiff(np.where(known, run.sigma, 0.0).astype(np.float32)),
        "status.tif": _tiff(run.status),
    }


def _tiff(values: NDArray[Any]) -> bytes:
    import tifffile

    stream = io.BytesIO()
    tifffile.imwrite(stream, values, photometric="minisblack", metadata=None, software="roslf")
    return stream.getvalue()
