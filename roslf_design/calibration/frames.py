"""Raw frames: a folder of captured images; grey levels as float32, dark frame off, sizes and saturation checked."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..input_files import PACKED, read_frames

Array = NDArray[np.float64]
Frame = NDArray[np.float32]
Image = NDArray[Any]
SUFFIXES = (".tif", ".tiff", ".png", ".npy", *PACKED)
_OURS = ('"full_scale"', '"roslf.render')
"""Marks of an image's notes by which our own renderings are known."""
LARGEST = 1e30
"""Grey level that none reaches; sums of it stay within a float's range."""
MOST_SATURATED = 0.05
"""Share of saturated pixels beyond which a raw image is refused."""
_FULL = tuple(2**bits - 1 for bits in (8, 10, 12, 14))
_STEPS = tuple(2 ** (16 - bits) for bits in (8, 10, 12, 14))
"""Steps between values of so many bits that are a file's highest."""
ALIKE = 0.03
"""Share by which the brightness of white images of one exposure may differ, as lamps do."""


class CalibrationError(ValueError):
    """The images, boards or priors given cannot determine what was asked; the message says why and what to change."""


@dataclass(frozen=True, eq=False)
class Repeated:
    """Frames of one exposure and scene, taken together."""

    levels: tuple[float, ...]
    """Mean of each frame's pixels."""
    mean: Array
    """Mean of each pixel."""
    squares: Array
    """Sum of squares of each pixel's deviations from its mean."""
    full: NDArray[np.bool_]
    """True where a pixel is saturated in some frame."""
    top: float
    """Level at which pixels are saturated; infinite where nothing tells it."""
    kind: np.dtype[Any]
    """Type of the pixels."""

    @classmethod
    def of(cls, frame: Image) -> Repeated:
        """Start with one frame."""
        top = saturation_level(frame)
        mean = np.asarray(frame, float)
        return cls((float(mean.mean()),), mean, np.zeros(mean.shape), frame >= top, top, frame.dtype)

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.levels)

    @property
    def averaged(self) -> Image:
        """Mean frame; of counts rounded to counts, of which saturation is told."""
        if self.kind.kind == "f":
            return self.mean.astype(self.kind)
        return np.where(self.full, self.top, np.rint(self.mean)).astype(self.kind)

    def plus(self, frame: Image) -> Repeated:
        """With one more frame (Welford's update)."""
        other, off = Repeated.of(frame), frame - self.mean
        mean = self.mean + off / (self.count + 1)
        squares = self.squares + off * (frame - mean)
        top = min(self.top, other.top)
        levels = (*self.levels, *other.levels)
        return Repeated(levels, mean, squares, self.full | (frame >= top), top, self.kind)


@dataclass(frozen=True, eq=False)
class Capture:
    """Capture in a folder; the images of the board are read one at a time."""

    white: Image
    """Mean of the brightest white images that are not saturated."""
    dark: Image | None
    boards: tuple[Path, ...]
    """Files of the boards' images, by name."""
    whites: tuple[Repeated, ...] = ()
    """White images of each exposure, the one that `white` is the mean of first."""
    darks: Repeated | None = None
    notes: Mapping[str, Any] = field(default_factory=dict)
    """Notes that `roslf` left in the first white image."""
    balance: ColourBalance | None = None
    """Colour balance that images of the board are yet to get; white image and dark frame have had it."""

    def board(self, path: Path) -> Image:
        """One image of the board; refused where it is of another size than the white image."""
        image = read_image(path)
        same_size(path.name, image.shape, "white image", self.white.shape)
        return image if self.balance is None else self.balance(image, path.name)

    def balanced(self) -> Capture:
        """Capture of a sensor with colour filters, its colours made equal by the white image; errors as `decode`."""
        balance = ColourBalance.of(self.white, self.dark)
        return replace(self, white=balance(self.white, "white image"), dark=None, balance=balance)


def read_capture(folder: Path) -> Capture:
    """Find the images of a folder: ``white.*`` or several ``white_*.*``, dark frames likewise, and boards.

    Boards have any other name. Frames of one exposure are averaged. Previews that `roslf render` writes
    (``*-preview.png``) are left out.

    Raises
    ------
    CalibrationError
        No such folder, no white image, two of one name, no images of the board, files that cannot be read, frames of
        another size.
    """
    if not folder.is_dir():
        raise CalibrationError("is a file; name the folder of images" if folder.exists() else "no such folder")
    images = sorted(
        (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")),
        key=lambda path: [part.zfill(20) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)],
    )
    images = [path for path in images if not path.stem.endswith("-preview")]
    white, dark = _named(images, "white"), _named(images, "dark")
    if not white:
        raise CalibrationError(
            "no white image: capture a bright, even surface with the camera as it is and save it as white.tif, or"
            " several as white_1.tif, white_2.tif"
        )
    boards = tuple(path for path in images if path not in (*white, *dark))
    if not boards:
        raise CalibrationError(f"no images of the board ({', '.join(f'*{end}' for end in SUFFIXES)}) beside white")
    whites, notes = list[Repeated](), dict[str, Any]()
    for frame, noted in _frames(white, "white image"):
        notes = notes or noted
        if whites:
            same_size("white image", frame.shape, "first white image", whites[0].mean.shape)
        level = float(frame.mean(dtype=float))
        like = [k for k, group in enumerate(whites) if abs(level - group.levels[0]) <= ALIKE * abs(group.levels[0])]
        if like:
            whites[like[0]] = whites[like[0]].plus(frame)
        else:
            whites.append(Repeated.of(frame))
    whites.sort(key=lambda group: (group.full.mean() > MOST_SATURATED, -group.levels[0]))
    darks: Repeated | None = None
    for frame, _ in _frames(dark, "dark frame"):
        same_size("white image", whites[0].mean.shape, "dark frame", frame.shape)
        darks = Repeated.of(frame) if darks is None else darks.plus(frame)
    black = None if darks is None else darks.averaged
    return Capture(whites[0].averaged, black, boards, tuple(whites), darks, notes)


def _named(images: list[Path], stem: str) -> list[Path]:
    """Files of white images or dark frames."""
    named = [path for path in images if re.fullmatch(f"{stem}(_.+)?", path.stem.lower())]
    single = [path for path in named if path.stem.lower() == stem]
    if single and len(named) > 1:
        raise CalibrationError(
            f"{' and '.join(p.name for p in named[:2])} are both there; keep one {stem} image, or number all of them:"
            f" {stem}_1, {stem}_2"
        )
    return named


def _frames(paths: list[Path], name: str) -> Iterator[tuple[Image, dict[str, Any]]]:
    """Frames of files, one at a time, each with its file's notes; errors as of `grey_frame`."""
    for path in paths:
        frames, notes = _read_stack(path)
        for frame in frames:
            grey_frame(frame, None, name)
            yield frame, notes


def read_image(path: Path) -> Image:
    """Pixels of an image as they are stored, shape (rows, columns) or (rows, columns, channels).

    Frames of a stack are averaged. Whole numbers that `roslf` wrote come back as the intensities they stand for: its
    full scale is that of the picture, and no sensor's saturation.

    Raises
    ------
    CalibrationError
        Naming the file, where it is no image that can be read.
    """
    return read_image_and_notes(path)[0]


def read_image_and_notes(path: Path) -> tuple[Image, dict[str, Any]]:
    """Pixels as `read_image` has them, and what `roslf` noted in the file; errors as there."""
    frames, notes = _read_stack(path)
    if len(frames) == 1:
        return frames[0], notes
    for frame in frames:
        grey_frame(frame, None, path.name)
    return reduce(Repeated.plus, frames[1:], Repeated.of(frames[0])).averaged, notes


def _read_stack(path: Path) -> tuple[Image, dict[str, Any]]:
    """Frames of a file, shape (frames, rows, columns) or with channels at the end, else as `read_image_and_notes`."""
    try:
        pixels, note = read_frames(path, path.name)
    except InputError as error:
        raise CalibrationError(f"{path.name} {error.problems[0].message}") from None
    if pixels.ndim not in (3, 4) or not len(pixels) or pixels.dtype.kind not in "uif":
        raise CalibrationError(f"{path.name} is no image: its pixels have shape {pixels.shape[1:]}")
    try:
        notes = json.loads(note) if any(key in note for key in _OURS) else {}
    except (ValueError, RecursionError):
        notes = {}
    if not isinstance(notes, dict):
        notes = {}
    scale = notes.get("full_scale")
    if isinstance(scale, (int, float)) and 0 < scale < np.finfo(np.float32).max and pixels.dtype.kind == "u":
        return (pixels * np.float32(scale / 65535)).astype(np.float32), notes
    return pixels, notes


def grey_frame(image: ArrayLike | None, dark: ArrayLike | None = None, name: str = "image") -> Frame:
    """One grey frame from a grey or colour image (channels are averaged), minus its dark frame.

    Raises
    ------
    CalibrationError
        The image, called `name`, is missing, none, not finite, or of another size than its dark frame.
    """
    if image is None:
        raise CalibrationError(f"the {name} is missing: give one frame of the same camera setting")
    pixels = np.asarray(image)
    shape = pixels.shape
    if pixels.ndim not in (2, 3) or min(shape[:2]) < 8 or pixels.size == 0 or pixels.dtype.kind not in "buif":
        raise CalibrationError(f"the {name} is no image: array of shape {shape} and type {pixels.dtype}")
    if not (float(pixels.min()) > -LARGEST and float(pixels.max()) < LARGEST):
        raise CalibrationError(f"the {name} has pixels that are not finite numbers, or larger than any sensor's")
    # Channels one after another: in a quarter of the time.
    grey = pixels.transpose(2, 0, 1).astype(float, order="C").mean(axis=0) if pixels.ndim == 3 else pixels
    frame = np.ascontiguousarray(grey, np.float32)
    if dark is not None:
        same_size(name, frame.shape, "dark frame", np.shape(dark))
        frame = frame - grey_frame(dark, None, "dark frame")
    return frame


@dataclass(frozen=True, eq=False)
class ColourBalance:
    """Makes grey frames of raw images behind a Bayer pattern: pixels of all colours show white alike."""

    gains: Array
    """Gains of the first two pixels of the first two rows, shape (2, 2); the brightest colour has 1."""
    dark: Frame | None = None
    """Frame without light, to be taken off first."""

    @classmethod
    def of(cls, white: ArrayLike, dark: ArrayLike | None = None) -> ColourBalance:
        """By a white image, or by any in which colours are even on average; errors as of `grey_frame`."""
        frame = grey_frame(white, dark, "white image")
        means = np.array([[frame[row::2, column::2].mean(dtype=float) for column in (0, 1)] for row in (0, 1)])
        if not means.min() > 0:
            raise CalibrationError("the white image has pixels of a colour that got no light: expose more")
        return cls(means.max() / means, None if dark is None else grey_frame(dark, None, "dark frame"))

    @property
    def evenness(self) -> float:
        """Electrons of a pixel like the mean of all four in noise, over those of the brightest colour."""
        return 1 / float(self.gains.mean())

    def __call__(self, image: ArrayLike, name: str = "image") -> Frame:
        """A grey frame without its dark frame, refused where much of it is saturated; errors as of `grey_frame`."""
        frame = grey_frame(image, self.dark, name)
        refuse_saturated(image, name, MOST_SATURATED)
        rows, columns = frame.shape
        gains = np.tile(self.gains.astype(np.float32), (rows // 2 + 1, columns // 2 + 1))
        return np.asarray(frame * gains[:rows, :columns])


def same_size(name: str, shape: tuple[int, ...], other: str, other_shape: tuple[int, ...]) -> None:
    """Demand two frames of one size; the error names both and their sizes."""
    if shape[:2] != other_shape[:2]:
        sizes = f"{shape[1]} x {shape[0]} px and {other_shape[1]} x {other_shape[0]} px"
        raise CalibrationError(f"the {name} and the {other} differ in size ({sizes}): use frames of one camera setting")


def saturation_level(image: ArrayLike) -> float:
    """Level at which a pixel of this raw image is saturated: its integer type's largest value, or infinity for floats.

    Sensors with fewer bits than their file saturate lower: where at least 0.1 % of the pixels share the largest value
    found and that is the end of 8, 10, 12 or 14 bits, it is the level. Where their bits are the highest of 16, all
    values are multiples of what one of them counts, and the level is the largest such.
    """
    raw = np.asarray(image)
    if raw.dtype.kind not in "ui":
        return float("inf")
    top = int(raw.max())
    piled = top in _FULL and np.count_nonzero(raw == top) >= max(0.001 * raw.size, 16)
    if piled:
        return float(top)
    used = int(np.bitwise_or.reduce(raw, axis=None)) if raw.dtype == np.uint16 else 1
    step = used & -used  # their lowest bit in use
    return float(np.iinfo(raw.dtype).max - (step - 1 if step in _STEPS else 0))


def refuse_saturated(image: ArrayLike, name: str, most: float) -> float:
    """Level at which an image's pixels are saturated, no more than a share `most` of them; the error names both."""
    top = saturation_level(image)
    share = float(np.mean(np.asarray(image) >= top))
    if share > most:
        raise CalibrationError(
            f"the {name} is saturated: {100 * share:.0f} % of its pixels reach grey level {top:g}; expose less"
        )
    return top
