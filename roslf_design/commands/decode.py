"""`roslf decode`."""

from __future__ import annotations

import io
import re
import time
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from ..calibration.raw import NoLatticeError
from ..depth.decoded import DecodeOptions, decoded
from ..depth.view_files import view_files
from ..reporting.decode import pages
from ..reporting.decode.pictures import contrast
from ..reporting.printers import render_html, render_tables
from .refused import refused
from .results import picture_files, print_titled
from .terminal import Flat, Json, OptionalOutput, StatusLine, check_options, json_text, say, typed, write_files

FOCUS = DecodeOptions.model_fields["focus"].description


class _Options(DecodeOptions):
    """Options of which one takes disparities below 0."""

    focus: Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=(), help=FOCUS)] = None


OPTIONS = _Options()


def decode(
    image: Path,
    /,
    *,
    options: Annotated[_Options, Flat] = OPTIONS,
    output: OptionalOutput = None,
    json: Json = False,
) -> None:
    """From a raw light-field image to pictures: views, refocus stack, epipolar-plane image, microlens centres.

    Example: roslf decode raw.tif --white white.tif --design paper -o out/decoded

    Parameters
    ----------
    image
        A raw image (.tif, .png), as of a camera or of roslf render; or decoded views: a folder of pictures named by row
        and column (view_03_04.png) or counted (input_Cam040.png, with the parameters.cfg of the 4D light field
        benchmark), or a .mat file of LFToolbox.
    output
        Folder for pictures, views/, refocus/, decoding.json, tables/ (CSV) and index.html. Default: decoded-IMAGE.
    """
    folder = Path(f"decoded-{re.sub(r'[^A-Za-z0-9._-]+', '-', image.stem) or 'image'}") if output is None else output
    check_options(None, folder, title=f"Light field of {image.name}")
    began = time.perf_counter()
    with StatusLine("decode") as status:
        try:
            result = decoded(image, options, status.tell)
        except NoLatticeError as error:
            raise refused(error, image, folder) from None
        status.tell("drawing")
        command = typed("decode", image, **dict(options), output=folder)
        files = {"decoding.json": f"{json_text(result.to_dict())}\n".encode()}
        pictures = pages.decoding_pictures(result)
        drawings = {name: picture.svg(name=name) for name, picture in pictures.items()}
        report = pages.decoding_report(result, drawings, command)
        files |= picture_files(pictures, drawings) | render_tables(report)
        views = {} if result.kind == "views" else view_files(result.field)
        for name, plane in zip(pages.stack_names(result), result.stack, strict=True):
            files[name] = _grey_png(plane.values, plane.weight)
        files["index.html"] = render_html(report).encode()
        write_files(folder, files)
        if views:
            write_files(folder / "views", views)
    seconds = time.perf_counter() - began
    if json:
        print(json_text({**result.to_dict(), "files": list(files), "views_written": len(views)}))
        return
    print_titled(report.title, report.sections[0].blocks)
    shown = [name for name in files if "/" not in name]
    say(f"\nWritten to {folder}: {', '.join(shown)}, refocus/{', views/' if views else ''}")
    print(f"{seconds:.1f} s")


def _grey_png(values: np.ndarray, weight: np.ndarray) -> bytes:
    """A picture as a PNG of 16 bits, from black to white over what it has."""
    from PIL import Image

    low, high = contrast(values, weight)
    shades = np.clip((values - low) / (high - low), 0, 1) * (weight > 0)
    stream = io.BytesIO()
    Image.fromarray(np.rint(65535 * shades).astype(np.uint16)).save(stream, "PNG")
    return stream.getvalue()
