"""`roslf depth`."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..depth.measure import REASONS, Trial, simulate
from ..design import load
from ..errors import Problem
from ..pictures.svg import file_of
from ..reporting.depth import answers, basis, depth_report, trial_pictures
from ..reporting.printers import render_html
from ..scenes import load_scene
from ..tables import plain_text
from .render import parse_region
from .terminal import Flag, OptionalOutput, bar, check_options, json_text, print_blocks, typed, write_files

RENDERING = 0.6
"""Share of the time that goes into the picture, about."""


def depth(
    design: str,
    /,
    *,
    scene: Path | None = None,
    output: OptionalOutput = None,
    region: str | None = None,
    exposures: int = 1,
    believed: str | None = None,
    seed: int = 0,
    json: Flag = False,
) -> None:
    """Take a picture of a scene, with noise, and measure depth in it: how good it is, and how good it should be.

    Example: roslf depth designs/paper.toml --region 2240,1480,120,120 -o out/depth

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    scene
        A scene file. Default: a slanted wall with texture at the focal plane.
    output
        Folder for index.html, depth.json, pictures and maps, made if needed: depth.tif (Z from the main lens in mm, 0
        where unknown), sigma.tif (its standard error), status.tif (0 where measured, else why not: depth.json names
        the numbers). Default: only print.
    region
        Only a part of the sensor, as column,row,columns,rows in pixels. Default: a strip across its middle.
    exposures
        Pictures that differ by noise alone; with several, spread is told apart from what stays.
    believed
        Compute depth for this design instead, as with a wrong calibration.
    seed
        Of noise and sampling: the same seed gives the same bytes.
    json
        Print the JSON object instead of text.
    """
    wrong = [Problem("--exposures", f"{exposures} is none; give 1 or more")] if exposures < 1 else []
    check_options(seed, output, *wrong)
    piece = None if region is None else parse_region(region)
    loaded = load(design)
    other = None if believed is None else load(believed)
    look = None if scene is None else load_scene(scene)
    with _told() as progress:
        trial = simulate(loaded, look, region=piece, seed=seed, exposures=exposures, believed=other, progress=progress)
    data = trial.to_dict()
    command = typed(
        "depth", design, scene=scene, region=region, exposures=exposures if exposures > 1 else None,
        believed=believed, seed=seed or None, output=output,
    )  # fmt: skip
    written: list[Path] = []
    if output is not None:
        pictures = trial_pictures(trial)
        files = maps(trial)
        data["files"] = {"depth_mm": "depth.tif", "sigma_mm": "sigma.tif", "status": "status.tif"}
        data["status"] = {str(code): reason for code, reason in REASONS.items()}
        files["depth.json"] = f"{json_text(data)}\n".encode()
        for name, picture in pictures.items():
            files |= {f"{name}.svg": file_of(picture.svg()), f"{name}.png": picture.to_png()}
        report = depth_report(trial, pictures, command)
        written = write_files(output, files | {"index.html": render_html(report).encode()})
    if json:
        print(json_text(data))
        return
    from rich.console import Console

    console = Console()
    console.print(plain_text(f"Depth that {loaded.name} measures", "bold"))
    print_blocks((*answers(trial), *basis(trial)), console)
    if written:
        print(f"\nWritten to {output}: {', '.join(path.name for path in written)}")


def maps(trial: Trial) -> dict[str, bytes]:
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


@contextmanager
def _told() -> Iterator[Any]:
    """One bar for the picture and the exposures in it."""
    with bar("depth") as tell:

        def progress(what: str, share: float) -> None:
            tell(RENDERING * share if what == "picture" else RENDERING + (1 - RENDERING) * share)

        yield progress
