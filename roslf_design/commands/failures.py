"""Pictures of what was seen before a command failed, and the line that names them."""

from __future__ import annotations

from pathlib import Path

from ..calibration import CalibrationError
from ..calibration.frames import Image, grey_frame
from ..calibration.lattice import amplitude_spectrum, lit_part
from ..errors import InputError, Problem
from ..pictures.light_field import no_lattice
from ..pictures.picture import Picture
from .terminal import picture_files, write_files


class UnfinishedError(CalibrationError):
    """What images do not determine, with a picture of what was seen of them."""

    def __init__(self, message: str, picture: Picture) -> None:
        super().__init__(message)
        self.picture = picture


def refused(error: CalibrationError, origin: Path, folder: Path | None = None) -> InputError:
    """What images do not determine as one line; what was seen goes into a folder where one is given."""
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
