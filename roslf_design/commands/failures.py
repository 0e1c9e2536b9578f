"""Pictures of what was seen before a command failed."""

from __future__ import annotations

from ..calibration import CalibrationError
from ..calibration.frames import Image, grey_frame
from ..calibration.lattice import amplitude_spectrum, lit_part
from ..pictures.light_field import no_lattice
from ..pictures.picture import Picture
from ..pictures.svg import file_of


class UnfinishedError(CalibrationError):
    """What images do not determine, with a picture of what was seen of them."""

    def __init__(self, message: str, picture: Picture) -> None:
        super().__init__(message)
        self.picture = picture


def failure_files(picture: Picture) -> dict[str, bytes]:
    """The picture as files."""
    return {"failed.svg": file_of(picture.svg()), "failed.png": picture.to_png()}


def what_there_was(image: Image, reason: str, pitch: float | None) -> Picture:
    """Draw an image in which no lattice was found; `pitch` is that which was expected [px]."""
    frame = grey_frame(image)
    part, corner = lit_part(frame)
    return no_lattice(frame, amplitude_spectrum(part), corner.tolist(), reason, pitch)
