"""Files that users name: only regular ones of sane size are read; whatever is wrong with one is told in one line."""

from __future__ import annotations

import json
import logging
import math
import stat
import struct
import warnings
import zlib
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError, Problem

MOST_TEXT = 4 << 20
"""Bytes of a file written by hand."""
MOST_BYTES = 1 << 30
"""Bytes of any other file, as of a picture."""
MOST_SAMPLES = 200_000_000
"""Numbers of a picture: pixels times channels."""
DAMAGED = (
    OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, SyntaxError,
    MemoryError, struct.error, zlib.error,
)  # fmt: skip
"""Exceptions of readers of pictures on a damaged one."""
DEEPEST = 32
"""Tables and lists within each other."""
LONGEST = 10_000
"""Entries of one table or list."""
LARGEST = 2**63
"""Below which whole numbers lie, as TOML has it."""


def read_bytes(
    path: Path,
    origin: str,
    missing: str = "check the path",
    *,
    most: int = MOST_BYTES,
    refusal: type[InputError] = InputError,
) -> bytes:
    """The content of a file.

    Parameters
    ----------
    path : Path
        The file.
    origin : str
        What errors call it.
    missing : str
        What to do where there is no such file.
    most : int
        Bytes that such a file has at most.
    refusal : type
        What is raised: the `InputError` of this kind of file.

    Raises
    ------
    InputError
        Missing, a folder, a pipe or a device (which may never end), too large, not readable.
    """
    check_file(path, origin, missing, most=most, refusal=refusal)
    try:
        return path.read_bytes()
    except OSError as error:  # what opens and cannot be read, as /proc/self/mem
        message = f"cannot be read: {error.strerror}; check its name and permissions"
        raise refusal((Problem("", message),), origin) from None


def check_file(
    path: Path,
    origin: str,
    missing: str = "check the path",
    *,
    most: int = MOST_BYTES,
    refusal: type[InputError] = InputError,
) -> None:
    """Refuse a file that `read_bytes` would not read; arguments and errors as there."""
    try:
        kind = path.stat()
        with open(path, "rb") if stat.S_ISREG(kind.st_mode) else nullcontext():
            pass
        if stat.S_ISREG(kind.st_mode) and kind.st_size <= most:
            return
    except (FileNotFoundError, NotADirectoryError):
        message = f"no such file; {missing}"
    except OSError as error:
        message = f"cannot be read: {error.strerror}; check its name and permissions"
    except ValueError as error:  # a name that no file can have
        message = f"cannot be read: {error}; {missing}"
    else:
        if stat.S_ISDIR(kind.st_mode):
            message = "is a folder; name the file inside it"
        elif not stat.S_ISREG(kind.st_mode):
            message = "is a pipe or a device; name a file on disk"
        else:
            message = f"is too large ({kind.st_size / 1e6:.0f} MB; at most {most / 1e6:.0f} MB); is it the right file?"
    raise refusal((Problem("", message),), origin)


def read_text(
    path: Path, origin: str, form: str, missing: str = "check the path", *, refusal: type[InputError] = InputError
) -> str:
    """The text of a file written by hand; `form` is what it is to be ("TOML"), the rest as for `read_bytes`.

    Raises
    ------
    InputError
        As for `read_bytes`; not UTF-8.
    """
    try:
        return read_bytes(path, origin, missing, most=MOST_TEXT, refusal=refusal).decode("utf-8")
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start}); expected a {form} file"
        raise refusal((Problem("", message),), origin) from None


def read_json(path: Path, origin: str, remedy: str) -> Any:
    """The values in a JSON file; `origin` is what errors call it, `remedy` how to get a good one.

    Raises
    ------
    InputError
        As for `read_bytes`; not JSON, or with a number that is not finite.
    """

    def refuse(name: str) -> None:
        raise ValueError(f"{name} is no number of JSON's")

    content = read_bytes(path, origin, remedy)
    try:
        data = json.loads(content, parse_constant=refuse)
        fault = strange(data, longest=None)
    except (ValueError, RecursionError) as error:  # UnicodeDecodeError is a ValueError
        fault = str(error) if isinstance(error, ValueError) else "its lists lie too deep within each other"
    if fault:
        raise InputError((Problem("", f"is damaged, or no JSON ({fault}); {remedy}"),), origin)
    return data


def read_pixels(path: Path, origin: str) -> tuple[NDArray[Any], str]:
    """Pixels of a picture as they are stored, (rows, columns) or (rows, columns, channels), and its description.

    TIFF by its ending, else whatever Pillow reads: its palette as the colours that it stands for, without opacity.

    Raises
    ------
    InputError
        As for `read_bytes`; no picture, damaged, or larger than any sensor.
    """
    from PIL import Image

    check_file(path, origin)
    reader = _tiff if path.suffix.lower() in (".tif", ".tiff") else _picture
    try:
        pixels, note = reader(path)
    except (*DAMAGED, Image.DecompressionBombError) as error:
        detail = " ".join(str(error).split()) or type(error).__name__
        raise InputError((Problem("", f"cannot be read as an image ({detail}); save it again"),), origin) from None
    return pixels, note


def _tiff(path: Path) -> tuple[NDArray[Any], str]:
    import tifffile

    tifffile.logger().setLevel(logging.CRITICAL + 1)  # what is damaged is told once, by us
    with tifffile.TiffFile(path) as file:
        _bearable(file.series[0].size)
        note = file.pages[0].tags.get("ImageDescription")  # type: ignore[union-attr]
        return np.asarray(file.asarray()), "" if note is None else str(note.value)


def _picture(path: Path) -> tuple[NDArray[Any], str]:
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        picture = Image.open(path)
    with picture:
        _bearable(math.prod(picture.size) * len(picture.getbands()))
        picture.load()
        plain = {"P": "RGB", "RGBA": "RGB", "LA": "L"}.get(picture.mode, picture.mode)
        return np.asarray(picture.convert(plain)), str(picture.info.get("Description", ""))


def _bearable(samples: int) -> None:
    if samples > MOST_SAMPLES:
        raise ValueError(f"{samples / 1e6:.0f} million numbers, at most {MOST_SAMPLES / 1e6:.0f}")


def strange(data: Any, longest: int | None = LONGEST) -> str:
    """Fault of nested values that no file of ours can have, with its place and the remedy; "" where all is well.

    Parameters
    ----------
    data : any
        Tables, lists and what they hold.
    longest : int or None
        Entries that one of them has at most.
    """
    left: list[tuple[str, int, Any]] = [("", 0, data)]
    while left:
        place, depth, value = left.pop()
        if isinstance(value, int) and not -LARGEST <= value < LARGEST:
            digits = math.ceil(value.bit_length() * math.log10(2))
            return f"{place}: a whole number of {digits} digits; write a smaller one"
        if not isinstance(value, (Mapping, list)):
            continue
        if depth == DEEPEST:
            return f"{place[:40]}...: more than {DEEPEST} tables or lists within each other; leave the inner ones out"
        if longest is not None and len(value) > longest:
            return f"{place or 'the file'}: has {len(value)} entries, at most {longest} can be used; leave some out"
        items = value.items() if isinstance(value, Mapping) else enumerate(value)
        left += [(f"{place}.{key}".lstrip("."), depth + 1, inner) for key, inner in items]
    return ""
