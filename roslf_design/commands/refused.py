"""Captured images that give no result: one line of why, and a picture of what was seen of them."""

from __future__ import annotations

from pathlib import Path

from ..calibration.frames import CalibrationError, grey_frame
from ..calibration.lattice import amplitude_spectrum, lit_part
from ..calibration.outcome import NoCameraError
from ..calibration.raw import NoLatticeError
from ..drawing.picture import Picture
from ..errors import InputError, Problem
from ..reporting.calibrate.pictures import what_was_seen
from ..reporting.decode.pictures import no_lattice
from .results import picture_files
from .terminal import write_files


def refused(error: CalibrationError, origin: Path, folder: Path | None = None) -> InputError:
    """Refusal, in one line, of images that do not determine a camera; a picture of what was seen goes into a folder."""
    text, picture = " ".join(str(error).split()), _picture(error)
    if picture is not None and folder is not None:
        write_files(folder, picture_files({"failed": picture}))
        text += f" (what was seen: {folder / 'failed.png'})"
    return InputError((Problem("", text),), str(origin))


def _picture(error: CalibrationError) -> Picture | None:
    match error:
        case NoLatticeError():
            frame = grey_frame(error.image)
            part, corner = lit_part(frame)
            return no_lattice(frame, amplitude_spectrum(part), corner.tolist(), str(error), error.pitch)
        case NoCameraError():
            return what_was_seen(error.centres, error.views)
    return None
