"""Raw images of users, read and decoded."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..camera import Camera
from ..design import Design
from ..errors import InputError, Problem, refusal
from ..theory.colours import filters
from .centres import MicrolensCentres, find_centres, find_centres_in_scene
from .decoding import LightField, decode
from .designed import image_pitch, undistorted_radius
from .frames import (
    CalibrationError,
    ColourBalance,
    Frame,
    Image,
    grey_frame,
    read_image_and_notes,
    same_size,
    saturation_level,
)
from .white_profile import WhiteFrame

OTHER_CAMERA = 0.02
"""Share by which the pitch of the microlens images may be off the design's: beyond, it is another camera's."""


class NoLatticeError(CalibrationError):
    """An image in which no microlens images are found.

    Parameters
    ----------
    message : str
    image : ndarray
    pitch : float, optional
        That was expected [px].
    """

    def __init__(self, message: str, image: Image, pitch: float | None) -> None:
        super().__init__(message)
        self.image, self.pitch = image, pitch


@dataclass(frozen=True, eq=False)
class RawSource:
    """The raw image that a light field was decoded from, and its lattice."""

    frame: Frame
    """Grey, dark frame off."""
    centres: MicrolensCentres
    white: bool
    """Whether a white image gave the centres; else the scene itself."""

    def to_dict(self) -> dict[str, Any]:
        """Lattice and where it is from, as JSON's types."""
        lattice = self.centres.lattice
        return {
            "from": "white image" if self.white else "raw image",
            "layout": lattice.layout,
            "pitch_px": lattice.pitch,
            "rotation_mrad": 1e3 * lattice.rotation,
            "origin_px": list(lattice.origin),
            "first_px": list(lattice.first),
            "second_px": list(lattice.second),
            "bent": lattice.bend is not None,
            "rms_px": self.centres.rms,
            "microlenses": self.centres.counts(),
        }


class RawDecoded(NamedTuple):
    """A raw image as a light field."""

    field: LightField
    source: RawSource
    pixels: Image
    """Pixels as they are stored."""
    notes: Mapping[str, Any]
    """Notes that `roslf` left in the file."""
    balance: ColourBalance | None
    """Colour balance of a sensor with colour filters; None without."""
    white: WhiteFrame | None
    """White image; None without one."""
    full: float | None
    """Value of a pixel whose well is full; None where nothing states it."""


def from_raw(
    image: Path, white: Path | None, dark: Path | None, design: Design | None, progress: Callable[[str], None]
) -> RawDecoded:
    """Read and decode a raw image; without a white image by the design's lattice, wherever that lies in it.

    A veil that the design has is taken off both.

    Raises
    ------
    InputError
        Files that cannot be read or differ in size; neither white image nor design.
    NoLatticeError
        No microlens images are found.
    """
    progress("reading")
    if white is None and design is None:
        raise refusal(
            "white",
            "is missing: give a white image; or name the camera by `design`, and the microlens images are looked for in"
            " the image itself",
        )
    pixels, notes = read_raw(image)
    (even, white_notes), (black, _) = ((None, {}) if path is None else read_raw(path) for path in (white, dark))
    layout = None if design is None else design.microlens_array.layout
    pitch = None if design is None else image_pitch(design)
    radius = None
    if design is not None and pixels.shape[1::-1] == Camera.of(design).pixels:  # it counts from the sensor's middle
        radius = undistorted_radius(design) or None
    bits = math.inf if design is None else design.sensor.bits
    full = full_scale(pixels, notes, bits, even, black)
    try:
        for name, path, other in (("white image", white, even), ("dark frame", dark, black)):
            if other is not None:
                same_size(f"raw image {image.name}", pixels.shape, f"{name} {path.name if path else ''}", other.shape)
        plain = None
        if even is not None:
            level = full_scale(even, white_notes, bits, pixels, black)
            plain = WhiteFrame(grey_frame(even, black, "white image"), level, bool(white_notes) or black is not None)
        if design is not None and design.light.veil > 0 and full is not None:
            black = np.float32(design.light.veil * full) + (
                np.zeros(pixels.shape[:2], np.float32) if black is None else grey_frame(black, None, "dark frame")
            )
        balance = None
        if _filtered(design, notes):
            balance = ColourBalance.of(pixels if even is None else even, black)
        frame = grey_frame(pixels, black, image.name)
        if balance is not None:
            frame, black = balance(pixels, f"raw image {image.name}"), None
            even = None if even is None else balance(even, "white image")
    except CalibrationError as error:
        raise InputError((Problem("", str(error)),)) from None
    progress("finding microlens centres")
    grey = pixels if balance is None else frame
    searched = grey if even is None else even
    try:
        if even is not None:
            centres = find_centres(
                even, black, layout=layout, pitch=pitch, undistorted_radius=radius
            )  # fmt: skip
        else:
            assert layout is not None
            assert pitch is not None
            centres = find_centres_in_scene(grey, black, layout=layout, pitch=pitch)
        progress("decoding")
        field = decode(grey, centres.lattice, white=even, dark=black)
    except CalibrationError as error:
        raise NoLatticeError(str(error), searched, pitch) from None
    return RawDecoded(field, RawSource(frame, centres, even is not None), pixels, notes, balance, plain, full)


def full_scale(
    pixels: Image, notes: Mapping[str, Any], bits: float, beside: Image | None, dark: Image | None = None
) -> float | None:
    """Value at which a pixel is full, above the level of a dark frame; None where nothing states it.

    Counts are those of a sensor of so many bits; where they, or those of a file beside, are larger, of their type.
    Pictures that `roslf` rendered say it themselves.
    """
    if notes:
        noted = notes.get("full_well")
        return float(noted) if isinstance(noted, (int, float)) and noted > 0 else None
    counts = [image for image in (pixels, beside) if image is not None and image.dtype.kind in "ui"]
    if pixels.dtype.kind not in "ui":
        return None
    most = 2.0**bits - 1
    end = most if max(float(image.max()) for image in counts) <= most < math.inf else saturation_level(pixels)
    return end - (0.0 if dark is None else float(np.median(dark)))


def _filtered(design: Design | None, notes: Mapping[str, Any]) -> bool:
    """Whether there were colour filters: as the design says, or what `roslf` noted in the file."""
    if design is not None:
        return bool(filters(design.sensor.colours))
    noted = notes.get("design")
    sensor = noted.get("sensor") if isinstance(noted, dict) else None
    return isinstance(sensor, dict) and sensor.get("colours", "mono") != "mono"


def read_raw(path: Path) -> tuple[Image, dict[str, Any]]:
    """Pixels of a raw image, and what `roslf` noted in the file; errors as of `from_raw`."""
    try:
        pixels, notes = read_image_and_notes(path)
        grey_frame(pixels, None, "picture")
    except CalibrationError as error:
        said = str(error).removeprefix(f"{path.name} ")
        raise InputError((Problem("", said),), str(path)) from None
    return pixels, notes
