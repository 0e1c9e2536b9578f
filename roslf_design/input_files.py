"""Files that users name: only regular ones of sane size are read; whatever is wrong with one is told in one line."""

from __future__ import annotations

import json
import math
import stat
import struct
import tomllib
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
"""Bound of whole numbers, as TOML has it."""
PACKED = ".mono12p", ".mono12packed"
"""Endings of raw files of 12 bits a pixel, as GenICam's pixel format naming convention packs them."""
SIZES = "raw.toml"
"""File beside them that tells their width and height."""


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
            held = next(iter(sorted(path.glob("*.toml"))), None)
            message = f"is a folder; name the file inside it{f', as {held}' if held else ''}"
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

    Raises
    ------
    InputError
        As for `read_frames`; several pictures.
    """
    frames, note = read_frames(path, origin)
    if len(frames) > 1:
        raise InputError((Problem("", f"holds {len(frames)} pictures; name a file of one"),), origin)
    return frames[0], note


def read_frames(path: Path, origin: str) -> tuple[NDArray[Any], str]:
    """Pictures of one file as they are stored, (frames, rows, columns) or with channels at the end, and a description.

    By its ending: TIFF (pages are frames), numpy's .npy, 12 bits packed as GenICam has Mono12p and Mono12Packed; else
    whatever Pillow reads: its palette as the colours that it stands for, without opacity.

    Raises
    ------
    InputError
        As for `read_bytes`; no picture, damaged, or larger than any sensor; packed pixels without their width and
        height.
    """
    from PIL import Image

    check_file(path, origin)
    suffix = path.suffix.lower()
    reader = {".tif": _tiff, ".tiff": _tiff, ".npy": _array, **dict.fromkeys(PACKED, _packed)}.get(suffix, _picture)
    try:
        frames, note = reader(path)
    except InputError as error:  # of the file beside packed pixels
        message = f"needs {SIZES} beside it with width and height [pixels]: {error.problems[0]}"
        raise InputError((Problem("", message),), origin) from None
    except (*DAMAGED, Image.DecompressionBombError) as error:
        detail = " ".join(str(error).split()) or type(error).__name__
        raise InputError((Problem("", f"cannot be read as an image ({detail}); save it again"),), origin) from None
    return frames, note


def _tiff(path: Path) -> tuple[NDArray[Any], str]:
    import tifffile

    tifffile.logger().disabled = True  # what is damaged is told once, by us
    with tifffile.TiffFile(path) as file:
        series = file.series[0]
        _bearable(series.size)
        note, axes = file.pages[0].tags.get("ImageDescription"), series.axes  # type: ignore[union-attr]
        own = [axes.index(axis) for axis in "YXS" if axis in "YX" or axis in axes]
        pages = [k for k in range(len(axes)) if k not in own]
        pixels = np.asarray(series.asarray()).transpose(pages + own)
        return pixels.reshape(-1, *pixels.shape[len(pages) :]), "" if note is None else str(note.value)


def _array(path: Path) -> tuple[NDArray[Any], str]:
    """Array of numpy: (rows, columns), (frames, rows, columns), or with 3 or 4 channels at the end."""
    stored = np.load(path, mmap_mode="r", allow_pickle=False)
    _bearable(stored.size)
    coloured = stored.ndim > 2 and stored.shape[-1] in (3, 4)
    if stored.ndim - coloured not in (2, 3):
        raise ValueError(f"an array of shape {stored.shape}")
    pixels = np.array(stored).astype(stored.dtype.newbyteorder("="), copy=False)
    return (pixels if stored.ndim - coloured == 3 else pixels[None]), ""


def _packed(path: Path) -> tuple[NDArray[Any], str]:
    """Frames one after another, two pixels in three bytes, the last byte of each frame filled up."""
    text = read_text(path.with_name(SIZES), SIZES, "TOML", "write width = 4096 and height = 3000 into it")
    try:
        told = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError((Problem("", f"is no TOML ({error}); write width = 4096"),), SIZES) from None
    for key in ("width", "height"):
        if type(value := told.get(key)) is not int or not 0 < value <= MOST_SAMPLES:
            raise InputError((Problem(key, f"is {value}; write {key} = 3000"),), SIZES)
    pixels, genicam = told["width"] * told["height"], path.suffix.lower() == PACKED[0]
    _bearable(pixels)
    size = -(-3 * pixels // 2) if genicam else 3 * -(-pixels // 2)
    content = read_bytes(path, str(path))
    if not content or len(content) % size:
        shape = f"{told['width']} x {told['height']} px in {SIZES} make {size}"
        raise ValueError(f"{len(content)} bytes, and {shape}")
    frames = np.frombuffer(content, np.uint8).reshape(-1, size)
    triples = np.pad(frames, ((0, 0), (0, -size % 3))).reshape(len(frames), -1, 3).astype(np.uint16)
    first, middle, last = np.moveaxis(triples, -1, 0)
    if genicam:  # the low bits first
        pair = first | (middle & 15) << 8, middle >> 4 | last << 4
    else:
        pair = first << 4 | middle & 15, last << 4 | middle >> 4
    unpacked = np.stack(pair, -1).reshape(len(frames), -1)[:, :pixels]
    return unpacked.reshape(-1, told["height"], told["width"]), ""


def _picture(path: Path) -> tuple[NDArray[Any], str]:
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        picture = Image.open(path)
    with picture:
        _bearable(math.prod(picture.size) * len(picture.getbands()))
        picture.load()
        plain = {"P": "RGB", "RGBA": "RGB", "LA": "L"}.get(picture.mode, picture.mode)
        kept = picture if plain == picture.mode else picture.convert(plain)
        return np.asarray(kept)[None], str(picture.info.get("Description", ""))


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
