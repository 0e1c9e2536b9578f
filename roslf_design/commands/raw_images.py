"""Raw images of users: read and decoded, or a picture and a line of what was seen before that failed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from .. import calibration
from ..calibration import CalibrationError, LightField
from ..calibration.frames import ColourBalance, Image, grey_frame, read_image_and_notes, same_size
from ..calibration.lattice import amplitude_spectrum, lit_part
from ..camera import Camera
from ..depth.decoded import RawSource
from ..design import Design
from ..drawing.picture import Picture
from ..errors import InputError, Problem
from ..reporting.decode.pictures import no_lattice
from .terminal import picture_files, refusal, write_files

OTHER_CAMERA = 0.02
"""Share by which the pitch of the microlens images may be off the design's: beyond, it is another camera's."""


class RawDecoded(NamedTuple):
    """A raw image as a light field."""

    field: LightField
    source: RawSource
    pixels: Image
    """As they are stored."""
    notes: Mapping[str, Any]
    """Notes that `roslf` left in the file."""
    balance: ColourBalance | None
    """Colour balance of a sensor with colour filters; None without."""


def from_raw(
    image: Path, white: Path | None, dark: Path | None, design: Design | None, progress: Callable[[str], None]
) -> RawDecoded:
    """Read and decode a raw image; without a white image by the design's lattice, wherever that lies in it.

    Raises
    ------
    InputError
        Files that cannot be read or differ in size; neither white image nor design.
    UnfinishedError
        No microlens images are found.
    """
    progress("reading")
    if white is None and design is None:
        raise refusal(
            "--white",
            "is missing: give a white image; or name the camera by --design, and the microlens images are looked for in"
            " the image itself",
        )
    pixels, notes = read_raw(image)
    even, black = (None if path is None else read_raw(path)[0] for path in (white, dark))
    layout = None if design is None else design.microlens_array.layout
    pitch = None if design is None else calibration.image_pitch(design)
    radius = None
    if design is not None and pixels.shape[1::-1] == Camera.of(design).pixels:  # it counts from the sensor's middle
        radius = calibration.undistorted_radius(design) or None
    try:
        for name, path, other in (("white image", white, even), ("dark frame", dark, black)):
            if other is not None:
                same_size(f"raw image {image.name}", pixels.shape, f"{name} {path.name if path else ''}", other.shape)
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
            centres = calibration.find_centres(
                even, black, layout=layout, pitch=pitch, undistorted_radius=radius
            )  # fmt: skip
        else:
            assert layout is not None
            assert pitch is not None
            centres = calibration.find_centres_in_scene(grey, black, layout=layout, pitch=pitch)
        progress("decoding")
        field = calibration.decode(grey, centres.lattice, white=even, dark=black)
    except CalibrationError as error:
        raise UnfinishedError(str(error), what_there_was(searched, str(error), pitch)) from None
    return RawDecoded(field, RawSource(frame, centres, even is not None), pixels, notes, balance)


def _filtered(design: Design | None, notes: Mapping[str, Any]) -> bool:
    """Whether there were colour filters: as the design says, or what `roslf` noted in the file."""
    if design is not None:
        return design.sensor.colours != "mono"
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


class UnfinishedError(CalibrationError):
    """Failure to determine something from images, with a picture of what they show."""

    def __init__(self, message: str, picture: Picture) -> None:
        super().__init__(message)
        self.picture = picture


def refused(error: CalibrationError, origin: Path, folder: Path | None = None) -> InputError:
    """Input error for images that do not determine something, as one line.

    Their picture goes into a folder if given.
    """
    text = " ".join(str(error).split())
    if isinstance(error, UnfinishedError) and folder is not None:
        write_files(folder, picture_files({"failed": error.picture}))
        text += f" (what was seen: {folder / 'failed.png'})"
    return InputError((Problem("", text),), str(origin))


def what_there_was(image: Image, reason: str, pitch: float | None) -> Picture:
    """Draw an image in which no lattice was found; `pitch` is that which was expected [px]."""
    frame = grey_frame(image)
    part, corner = lit_part(frame)
    return no_lattice(frame, amplitude_spectrum(part), corner.tolist(), reason, pitch)
