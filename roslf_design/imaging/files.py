"""Raw images as files: TIFF (float or 16 bits) or PNG, with how they were made inside and in a JSON file beside."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..design.files import in_the_way, write_atomically
from ..errors import InputError, Problem, refusal
from .render import RawImage

Depth = Literal["float", "16"]

SUFFIXES = (".tif", ".tiff", ".png")


def check_target(path: Path) -> None:
    """Refuse a place where no image can be written, before any work is done.

    Raises
    ------
    InputError
        Unknown suffix, a folder where a file is wanted, a file where a folder is.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            (Problem("", f'cannot tell an image format from "{path.suffix}"; end in .tif or .png'),), str(path)
        )
    blocked = in_the_way(path) or in_the_way(path.with_suffix(".json"))
    if blocked:
        raise refusal("output", blocked)


def write_image(image: RawImage, path: Path, depth: Depth = "float") -> Path:
    """Write an image and its JSON; each appears whole or not at all.

    Parameters
    ----------
    path : Path
        Ends in .tif, .tiff or .png; PNG is always 16 bits. Its folder is made if needed.
    depth : {"float", "16"}
        32-bit relative intensities, or 16-bit numbers of which 65535 is the ``full_scale`` in the metadata.

    Returns
    -------
    Path
        The JSON file.

    Raises
    ------
    InputError
        As `check_target`.
    OSError
        Disk full, no permission; nothing is left behind.
    """
    check_target(path)
    whole = depth == "16" or path.suffix.lower() == ".png"
    metadata = _portable(image.metadata())
    metadata["rows"] = "row 0 has the lowest y; columns along x"
    metadata["unit"] = "relative intensity, 1 is a fully lit pixel"
    pixels: NDArray[Any] = image.pixels
    if whole:
        metadata["full_scale"] = float(max(1.0, image.pixels.max(initial=0.0)))
        scaled = np.clip(image.pixels, 0, None) * np.float32(65535 / metadata["full_scale"])
        pixels = np.rint(scaled).astype(np.uint16)
    description = json.dumps(metadata, ensure_ascii=True, allow_nan=False)
    content = io.BytesIO()
    if path.suffix.lower() == ".png":
        _png(content, pixels, description)
    else:
        import tifffile

        # The same JSON: of a key spelled "shape" tifffile takes the picture's own shape, and fails where it is none.
        description = description.replace('"shape":', '"sh\\u0061pe":')
        tifffile.imwrite(
            content, pixels, photometric="minisblack", description=description, metadata=None, software="roslf"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, content.getvalue())
    beside = path.with_suffix(".json")
    write_atomically(beside, (json.dumps(metadata, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())
    return beside


def _png(content: io.BytesIO, pixels: NDArray[Any], description: str) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    notes = PngInfo()
    notes.add_text("Description", description, zip=True)
    notes.add_text("Software", "roslf")
    Image.fromarray(pixels).save(content, "PNG", pnginfo=notes)


def _portable(value: Any) -> Any:
    """Notes without folders in file names, which mean nothing elsewhere."""
    if isinstance(value, dict):
        return {key: Path(item).name if key == "file" else _portable(item) for key, item in value.items()}
    return [_portable(item) for item in value] if isinstance(value, (list, tuple)) else value
