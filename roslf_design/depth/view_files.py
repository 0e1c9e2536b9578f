"""Files of decoded views: folders of pictures, Matlab's light fields, disparity maps; to and from `LightField`."""

from __future__ import annotations

import configparser
import io
import json
import math
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import ratio
from ..calibration.decoding import LightField, Samples
from ..calibration.frames import LARGEST, CalibrationError, grey_frame, read_image_and_notes
from ..errors import InputError, Problem
from ..input_files import DAMAGED, MOST_SAMPLES, check_file, read_bytes, read_text

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg")
PARAMETERS = "parameters.cfg"
MATLAB = ".mat"
_CHANNELS = 8
"""Most channels of a sample."""
_MOST = 512 << 20
"""Bytes that a light field may take, unpacked, and again as samples with weights."""
_SIZES = {"single": 4, "double": 8} | {f"{sign}int{bits}": bits // 8 for sign in ("", "u") for bits in (8, 16, 32, 64)}
_PAIR = re.compile(r"(?:^|[^0-9])(\d{1,4})[_,x-](\d{1,4})$")
_SINGLE = re.compile(r"(?:^|[_-])cam(\d{1,6})$", re.IGNORECASE)
_PFM = re.compile(rb"(P[fF])\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,40})[ \t\r]*\n")
NAMES = "views are named by row and column, as view_03_04.png, or counted by rows, as input_Cam040.png"


@dataclass(frozen=True)
class CameraGrid:
    """Cameras side by side that look the same way, their pictures shifted so that one plane does not move.

    As the 4D Light Field Benchmark (Honauer et al. 2016) describes its scenes in `parameters.cfg`.
    """

    baseline: float
    """Distance from camera to camera [mm]."""
    focal_length: float
    """[px]"""
    focus: float
    """Distance of the plane that does not move [mm]."""

    def distance(self, slope: Any) -> Any:
        """Distance of what moves by `slope` [px a view; below 0 for near points]; below 0 where nothing is [mm].

        Of a number or an array.
        """
        return ratio(1.0, 1 / self.focus - slope / (self.baseline * self.focal_length))

    def slope(self, distance: Any) -> Any:
        """Pixels that a point at a distance [mm] moves by from view to view; of a number or an array."""
        return self.baseline * self.focal_length * (1 / self.focus - 1 / distance)


@dataclass(frozen=True, eq=False)
class ViewFiles:
    """Content of files of decoded views."""

    field: LightField
    """s, t count views from the middle one, u, v pixels; its pitch is the number of views across."""
    kind: str
    """"views" of a folder, or "matlab"."""
    grid: CameraGrid | None = None
    """Grid of the cameras, where the folder says how they stood."""
    missing: int = 0
    """Views of the grid that are not there; their weight is 0."""
    disparities: tuple[float, float] | None = None
    """Least and largest disparity from view to view [px], where the folder states them."""


def is_views(image: Path) -> bool:
    """True where a path holds decoded views rather than a raw image."""
    return image.is_dir() or image.suffix.lower() == MATLAB


def read_views(path: Path) -> ViewFiles:
    """Read decoded views: a folder of pictures, or a .mat file of LFToolbox.

    Colours are averaged; values stay as they are stored.

    Raises
    ------
    InputError
        No views there, named otherwise, twice, of different sizes, too many; damaged files; no light field.
    """
    return _matlab(path) if path.suffix.lower() == MATLAB and not path.is_dir() else _folder(path)


# --- folders ----------------------------------------------------------------------------------------------------------


def _folder(folder: Path) -> ViewFiles:
    if not folder.is_dir():
        raise _refused(folder, "is no folder of views" if folder.exists() else "no such folder; check the path")
    grid, across, disparities = None, None, None
    if (folder / PARAMETERS).exists():
        grid, across, disparities = _parameters(folder / PARAMETERS)
    places = _places(folder, across)
    cells = np.array(list(places))
    low, size = cells.min(axis=0), np.ptp(cells, axis=0) + 1
    values, holes = None, {}
    for (row, column), path in places.items():
        view, held = _view(path)
        if values is None:
            samples = int(math.prod(size.tolist())) * view.size
            if samples > MOST_SAMPLES:
                said = f"{size[1]} x {size[0]} views of {view.shape[1]} x {view.shape[0]} px are too many"
                raise _refused(folder, f"{said} (at most {MOST_SAMPLES / 1e6:.0f} million numbers); leave some out")
            values = np.zeros((*size, *view.shape), np.float32)
        if view.shape != values.shape[2:]:
            mine, theirs = (f"{shape[1]} x {shape[0]} px" for shape in (view.shape, values.shape[2:]))
            first = next(iter(places.values())).name
            raise _refused(folder, f"{path.name} has {mine} and {first} {theirs}; views of one light field are alike")
        at = row - low[0], column - low[1]
        values[at] = view
        if held is not None:
            holes[at] = held
    assert values is not None
    missing = int(math.prod(size.tolist())) - len(places)
    # What is the same all over takes no room.
    weight: Samples = np.broadcast_to(np.float32(1), values.shape)
    if missing or holes:
        weight = np.zeros(values.shape, np.float32)
        for row, column in places:
            at = row - low[0], column - low[1]
            weight[at] = holes.get(at, 1.0)
    return ViewFiles(_field(values, weight), "views", grid, missing, disparities)


def _places(folder: Path, across: int | None) -> dict[tuple[int, int], Path]:
    """Files by row and column; of two kinds of names the one that more files have."""
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith("."))
    pairs = [(match, path) for path in files if (match := _PAIR.search(path.stem))]
    singles = [(match, path) for path in files if (match := _SINGLE.search(path.stem))]
    if not pairs and not singles:
        raise _refused(folder, f"holds no views among its {len(files)} pictures; {NAMES}" if files else
                       f"holds no pictures; {NAMES}")  # fmt: skip
    places: dict[tuple[int, int], Path] = {}
    if len(singles) > len(pairs):
        numbers = [int(match[1]) for match, _ in singles]
        wide = across or math.isqrt(max(numbers) + 1)
        if across is None and wide * wide != max(numbers) + 1:
            said = f"{max(numbers) + 1} views are no square grid, and no {PARAMETERS} says num_cams_x"
            raise _refused(folder, f"{said}; name them by row and column, as view_03_04.png")
        named: Iterator[tuple[tuple[int, int], Path]] = (
            (divmod(number, wide), path) for number, (_, path) in zip(numbers, singles, strict=True)
        )
    else:
        named = (((int(match[1]), int(match[2])), path) for match, path in pairs)
    for place, path in named:
        if place in places:
            raise _refused(folder, f"{places[place].name} and {path.name} are the same view; keep one")
        places[place] = path
    return places


def _view(path: Path) -> tuple[Samples, Any]:
    """Picture of a view, and where something was measured, if not everywhere."""
    try:
        pixels, notes = read_image_and_notes(path)
        view = grey_frame(pixels, None, "view")
    except CalibrationError as error:
        said = str(error).removeprefix(f"{path.name} ")
        raise _refused(path, said) from None
    return view, view != 0 if notes.get("unmeasured") == 0 else None


def _parameters(path: Path) -> tuple[CameraGrid | None, int, tuple[float, float] | None]:
    """Cameras as `parameters.cfg` of the 4D Light Field Benchmark describes them, how many a row has, disparities."""
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_text(path, str(path), "configuration"))
    except configparser.Error as error:
        raise _refused(path, f"cannot be read ({' '.join(str(error).split())}); delete it, or mend it") from None

    def number(section: str, key: str) -> float:
        text = parser.get(section, key, fallback=None)
        try:
            value = math.nan if text is None else float(text)
        except ValueError:
            value = math.nan
        if not 0 < value < 1e9:
            said = "is missing" if text is None else f"is no positive number: {text!r}"
            raise InputError((Problem(f"{section}.{key}", f"{said}; write it, or delete the file"),), str(path))
        return value

    across = int(number("extrinsics", "num_cams_x"))
    width = max(number("intrinsics", f"image_resolution_{axis}_px") for axis in "xy")
    focal = number("intrinsics", "focal_length_mm") / number("intrinsics", "sensor_size_mm") * width
    focus = 1e3 * number("extrinsics", "focus_distance_m")
    ends = [parser.get("meta", key, fallback=None) for key in ("disp_min", "disp_max")]
    return CameraGrid(number("extrinsics", "baseline_mm"), focal, focus), max(across, 1), _disparities(ends, path)


def _disparities(ends: list[str | None], path: Path) -> tuple[float, float] | None:
    """Least and largest disparity that a configuration tells [px from view to view]; None where it tells none."""
    if None in ends:
        return None
    try:
        low, high = (float(end or "") for end in ends)
    except ValueError:
        low, high = math.nan, math.nan
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        message = f"with disp_max is no range of disparities: {ends[0]!r} to {ends[1]!r}; mend both, or delete them"
        raise InputError((Problem("meta.disp_min", message),), str(path))
    return low, high


def view_files(field: LightField) -> dict[str, bytes]:
    """Views as 16-bit PNG files by name, one scale for all, 0 where nothing was measured; `read_views` reads them back.

    Views without any light are left out. What interpolation at sharp edges leaves below 0 becomes nearly 0.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    top = float(field.values.max(initial=0.0)) or 1.0
    notes = PngInfo()
    notes.add_text("Description", json.dumps({"full_scale": top, "unmeasured": 0}))
    files = {}
    for row, column in np.argwhere((field.weight > 0).any(axis=(2, 3))):
        shades = np.clip(np.rint(field.values[row, column] * np.float32(65535 / top)), 1, 65535)
        shades *= field.weight[row, column] > 0
        stream = io.BytesIO()
        Image.fromarray(shades.astype(np.uint16)).save(stream, "PNG", pnginfo=notes, compress_level=1)
        files[f"view_{row:02d}_{column:02d}.png"] = stream.getvalue()
    return files


# --- Matlab -----------------------------------------------------------------------------------------------------------


def _matlab(path: Path) -> ViewFiles:
    from scipy.io import loadmat, matlab, whosmat

    check_file(path, str(path))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            known = {name: (shape, kind) for name, shape, kind in whosmat(path)}
            shape, kind = known.get("LF", ((), ""))
            if not (kind in _SIZES and len(shape) in (4, 5) and min(shape) > 0):
                there = ", ".join(sorted(known)[:8]) or "nothing"
                raise _refused(path, f"holds no light field LF of shape (t, s, v, u, channels), but {there}")
            size = math.prod(shape) * _SIZES[kind]
            if max(size, 8 * math.prod(shape[:4])) > _MOST or math.prod(shape[4:]) > _CHANNELS:
                said = f"its LF of {' x '.join(map(str, shape))} {kind} numbers is too large"
                most = f"{_MOST >> 20} MB in memory, and {_CHANNELS} channels"
                raise _refused(
                    path, f"{said} ({size / 2**20:.0f} MB; at most {most}); cut it in Matlab, or save it as uint8"
                )
            stored: NDArray[Any] = loadmat(path, variable_names=["LF"])["LF"]
    except NotImplementedError:
        raise _refused(path, "is a file of Matlab 7.3 (HDF5); save it again in Matlab by save(..., '-v7')") from None
    except InputError:
        raise
    except (*DAMAGED, matlab.MatReadError) as error:
        detail = " ".join(str(error).split())[:120] or type(error).__name__
        raise _refused(path, f"cannot be read as a file of Matlab ({detail}); save it again") from None
    if stored.dtype.kind == "c":
        raise _refused(path, "its LF has complex numbers; save their real parts or absolute values")
    if not float(np.abs(stored).max(initial=0)) < LARGEST:
        raise _refused(path, "its LF has values that are not finite, or larger than any sensor's; mend them")
    channels = stored.reshape(*stored.shape[:4], -1)
    values, weight = (np.zeros(channels.shape[:4], np.float32) for _ in range(2))
    weight += np.float32(1)
    colours = channels.shape[4]
    if colours in (2, 4):  # the last channel of LFToolbox is each sample's weight
        colours -= 1
        weight = np.asarray(channels[..., -1], np.float32)
        weight /= max(float(weight.max()), 1e-30)
    for channel in range(colours):
        values += np.asarray(channels[..., channel], np.float32)
    values /= np.float32(colours)
    return ViewFiles(_field(values, np.clip(weight, 0, 1, out=weight)), "matlab")


def _field(values: Samples, weight: Samples) -> LightField:
    t, s, v, u = (np.arange(length) - (length - 1) / 2 for length in values.shape)
    if any(weight.strides) and not weight.all():
        values *= weight > 0
    return LightField(values, weight, s, t, u, v, float(max(values.shape[:2])))


# --- disparity maps ---------------------------------------------------------------------------------------------------


def read_pfm(path: Path) -> Samples:
    """Values of a portable float map, shape (rows, columns), first row on top; not finite where it has none.

    Raises
    ------
    InputError
        No such file, none of that kind, in colours, cut short.
    """
    content = read_bytes(path, str(path))
    head = _PFM.match(content)
    try:
        scale = math.nan if head is None else float(head[4])
    except ValueError:
        scale = math.nan
    if head is None or not (scale < 0 or scale > 0):
        raise _refused(path, "is no portable float map (Pf, width, height, scale, then numbers); save it again")
    if head[1] == b"PF":
        raise _refused(path, "is a map in colours (PF); a map of disparities has one value a pixel (Pf)")
    columns, rows = int(head[2]), int(head[3])
    there, wanted = len(content) - head.end(), 4 * rows * columns
    if there != wanted or wanted == 0:
        said = f"says {columns} x {rows} numbers, {wanted} bytes, and holds {there}"
        raise _refused(path, f"{said}; it is damaged, copy or save it again")
    numbers = np.frombuffer(content, "<f4" if scale < 0 else ">f4", rows * columns, head.end())
    if (np.abs(numbers[np.isfinite(numbers)]) > LARGEST).any():
        raise _refused(path, f"has disparities beyond {LARGEST:g} px; write infinity where nothing is known")
    return np.ascontiguousarray(numbers.reshape(rows, columns)[::-1], np.float32)


def pfm_bytes(values: NDArray[np.floating]) -> bytes:
    """Values of shape (rows, columns), first row on top, as a portable float map; NaN stays where nothing is known."""
    rows, columns = values.shape
    return f"Pf\n{columns} {rows}\n-1.0\n".encode() + np.ascontiguousarray(values[::-1], "<f4").tobytes()


def _refused(path: Path, message: str) -> InputError:
    return InputError((Problem("", message),), str(path))
