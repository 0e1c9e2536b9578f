"""`roslf depth`."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..calibration.frames import SUFFIXES
from ..depth.captured import MeasuredCapture
from ..depth.from_files import CaptureOptions, captured
from ..depth.measure import REASONS, Measurement, Trial, simulate
from ..depth.pictures import PictureOptions, Work
from ..depth.view_files import MATLAB
from ..depth.warping import window_sums
from ..design import preset_names
from ..drawing.picture import Picture
from ..errors import Argument
from ..options import Options
from ..reporting.blocks import Block, Report
from ..reporting.depth.captured import capture_answers, capture_basis, capture_report
from ..reporting.depth.pages import answers, basis, depth_report, measurement_pictures
from ..reporting.printers import page_files
from ..scenes import load_scene
from ..theory.limits import as_design
from .render import parse_region
from .results import picture_files, print_titled
from .terminal import (
    Flat,
    Json,
    OptionalOutput,
    Repeated,
    Unread,
    bar,
    check_options,
    json_text,
    listed,
    parse_sigmas,
    say,
    status_and_bars,
    tell_cost,
    typed,
    write_files,
)


class _Options(CaptureOptions):
    """Options but those that the shell has another form for."""

    region: Annotated[tuple[int, int, int, int] | None, Unread] = None
    sigma: Annotated[dict[str, str], Unread] = Field(default_factory=dict)

    def complete(self, region: tuple[int, int, int, int] | None, sigma: dict[str, str]) -> CaptureOptions:
        """Options with what the shell has another form for."""
        return self.model_copy(update={"region": region, "sigma": sigma})


class _Simulation(Options):
    """Pictures that are simulated, of a design."""

    scene: Path | None = None
    """With a design: a scene file. Default: a slanted wall with texture at the focal plane."""
    exposures: int | None = None
    """With a design: pictures that differ by noise alone; with several, scatter is told apart from bias."""
    believed: str | None = None
    """With a design: compute depth as if the camera were this other one, as with a wrong calibration."""
    seed: int | None = None
    """With a design: of noise and sampling; the same seed gives the same bytes."""

    def faults(self, capture: bool) -> list[Argument]:
        """Options that cannot be had: none of them goes with a capture."""
        if capture:
            given = [name for name, value in dict(self).items() if value is not None]
            return [Argument(name, "goes with a design, and this is a capture; leave it out") for name in given]
        none = self.exposures is not None and self.exposures < 1
        return [Argument("exposures", f"{self.exposures} is none; give 1 or more")] if none else []


OPTIONS, SIMULATION = _Options(), _Simulation()


def depth(
    subject: str,
    /,
    *,
    simulation: Annotated[_Simulation, Flat] = SIMULATION,
    output: OptionalOutput = None,
    region: str | None = None,
    options: Annotated[_Options, Flat] = OPTIONS,
    sigma: Repeated = None,
    json: Json = False,
) -> None:
    """Measure depth: in pictures of a scene, taken as a design would, with noise; or in a picture that a camera took.

    Example: roslf depth designs/paper.toml --region 2240,1480,120,120 -o out/depth

    Example: roslf depth raw.tif --white white.tif --design paper --calibration out/monday -o out/depth

    Parameters
    ----------
    subject
        A design file, or the name of a preset (see `roslf presets`): its pictures are simulated. Or a raw image (.tif,
        .png); or decoded views: a folder of pictures named by row and column, or a .mat file of LFToolbox.
    output
        Folder for index.html, depth.json, pictures, tables/ (CSV) and maps, made if needed: depth.tif (Z from the main
        lens in mm as depth_mm of depth.json, not from the tip as pages and words: the file's description says where the
        tip is; 0 where unknown), sigma.tif (its standard error), status.tif (0 where measured, else why not: depth.json
        names the numbers), dense.tif and dense_sigma.tif (the same, filled where unknown, with a larger error).
        Default: only print.
    region
        Only a part of the sensor, as column,row,columns,rows in pixels. Default: a strip across its middle. Of a raw
        image: which part of the sensor it shows, where that is not all.
    sigma
        How surely a length of the camera is known that no calibration states, as aperture.diameter=1% or
        aperture.diameter="20 um"; may be repeated. What that leaves open counts in the errors. Default: as designed.
    """
    of_captures = [*sorted(options.model_fields_set), *(() if sigma is None else ("sigma",))]
    design = _is_design(subject)
    capture = not design and (_is_capture(subject) or bool(of_captures))
    idle = [Argument(name, "goes with a capture, and this is a design; leave it out") for name in of_captures if design]
    check_options(simulation.seed, output, *idle, *simulation.faults(capture))
    piece = None if region is None else parse_region(region)
    chosen = dict(simulation) | options.model_dump(exclude={"region", "sigma"})
    command = typed("depth", subject, region=region, **chosen, sigma=sigma, output=output)
    if capture:
        taken, title = options.complete(piece, parse_sigmas(sigma)), f"Depth in {Path(subject).name}"
        check_options(folder=output, title=title)
        with status_and_bars("depth") as tell_all:
            result = captured(Path(subject), taken, tell_all)
        blocks = (*capture_answers(result), *capture_basis(result))
        _finish(result, title, blocks, partial(capture_report, result), command, output, json)
        return
    camera, look = as_design(subject), None if simulation.scene is None else load_scene(simulation.scene)
    other = None if simulation.believed is None else as_design(simulation.believed)
    pictures = PictureOptions(region=piece, seed=simulation.seed or 0, exposures=simulation.exposures or 1)
    title = f"Depth that {camera.name} measures"
    check_options(folder=output, title=title)
    work = Work.of(camera, pictures, light=None if look is None else look.mean_exposure)
    tell_cost(work.seconds, f"{work}; a smaller --region makes it shorter", window_sums.shelved)
    with bar("depth") as tell:
        trial = simulate(camera, look, pictures, believed=other, progress=lambda what, share: tell(share))
    blocks = (*answers(trial), *basis(trial))
    _finish(trial, title, blocks, partial(depth_report, trial), command, output, json)


def _finish(
    result: Trial | MeasuredCapture,
    title: str,
    blocks: Sequence[Block],
    report: Callable[[Mapping[str, Picture], str], Report],
    command: str,
    output: Path | None,
    json: bool,
) -> None:
    """Write a folder where one is wanted, with the page that `report` makes; then print answers or the JSON object."""
    data, written = result.to_dict(), list[str]()
    if output is not None:
        pictures = measurement_pictures(result)
        unit = result.first.geometry.unit
        data["files"] = {"depth_mm" if unit == "mm" else "disparity_px": "depth.tif"}
        data["files"] |= {f"sigma_{unit}": "sigma.tif", "status": "status.tif"}
        data["files"] |= {"dense": "dense.tif", "dense_sigma": "dense_sigma.tif"}
        data["dense"] = result.first.dense_told()
        data["status"] = {str(code): reason for code, reason in REASONS.items()}
        files = _maps(result) | {"depth.json": f"{json_text(data)}\n".encode()}
        files |= picture_files(pictures) | page_files(report(pictures, command))
        write_files(output, files)
        written = listed(files)
    if json:
        print(json_text(data))
        return
    print_titled(title, blocks)
    if written:
        say(f"\nWritten to {output}: {', '.join(written)}")


def _is_design(subject: str) -> bool:
    return Path(subject).suffix.lower() == ".toml" or subject in preset_names()


def _is_capture(subject: str) -> bool:
    path = Path(subject)
    return path.suffix.lower() in (*SUFFIXES, MATLAB) or (path.is_dir() and subject not in preset_names())


def _maps(trial: Measurement) -> dict[str, bytes]:
    """Maps of the first exposure as TIFF files, rows along y, one pixel a microlens."""
    run = trial.first
    known, unit, tip = run.measured, run.geometry.unit, run.geometry.tip
    what = "Z from the main lens [mm]" if unit == "mm" else f"disparity [{unit}]"
    if tip:
        what += f"; ahead of the tip, as pages count, it is {tip:.6g} mm less"
    what += "; 0 where unknown"
    return {
        "depth.tif": _tiff(np.where(known, run.depth, 0.0).astype(np.float32), what),
        "sigma.tif": _tiff(np.where(known, run.sigma, 0.0).astype(np.float32)),
        "status.tif": _tiff(run.status),
        "dense.tif": _tiff(np.nan_to_num(run.dense, nan=0.0).astype(np.float32), what),
        "dense_sigma.tif": _tiff(np.nan_to_num(run.dense_sigma, posinf=0.0).astype(np.float32)),
    }


def _tiff(values: NDArray[Any], what: str | None = None) -> bytes:
    import tifffile

    stream = io.BytesIO()
    tifffile.imwrite(stream, values, photometric="minisblack", description=what, metadata=None, software="roslf")
    return stream.getvalue()
