"""`roslf export`."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ..bore.export import SequenceRow
from ..camera import Camera
from ..design import Design
from ..design.sequence import D_LINE, lens_rows, optiland, sequence_of, zmx
from ..input_files import MOST_TEXT, read_bytes
from ..lenses.glass import ROOM
from ..lenses.lens_file import load_lens, shipped_names
from ..lenses.prescription import Prescription
from ..theory.limits import as_design
from ..theory.quantities import QUANTITIES
from .terminal import Output, check_target, say, write_file

WRITERS = (".zmx", ".json")


def export(name: str, /, *, output: Output) -> None:
    """A camera, or a lens, as a file of another program: .zmx, or Optiland's .json.

    Parameters
    ----------
    name
        A design file or preset; or a lens: one that ships, a lens file that has [[surfaces]], a .zmx file.
    output
        The file to write; what it ends with, .zmx or .json, says of which program.
    """
    kind = check_target(output, WRITERS)
    subject = _of_lens(load_lens(name)) if _is_lens(name) else _of_camera(as_design(name))
    rows, title, wavelength, warmth, wide, straightened = subject
    text = zmx(rows, title, wavelength, warmth, wide) if kind == ".zmx" else optiland(rows, title, wavelength, wide)
    write_file(output, text.encode())
    say(f"{output}: {len(rows)} surfaces")
    if straightened:
        print("Misalignments are left out.")


class _Subject(NamedTuple):
    """Subject of a file: a lens or a camera."""

    rows: tuple[SequenceRow, ...]
    title: str
    wavelength: float
    """[mm]."""
    warmth: float
    """Temperature [degrees C]."""
    wide: float
    """Half the field's width [mm]."""
    straightened: bool = False
    """Whether misalignments are left out."""


def _of_lens(lens: Prescription) -> _Subject:
    return _Subject(lens_rows(lens), lens.name, lens.wavelength or D_LINE, lens.temperature, 0.0)


def _of_camera(design: Design) -> _Subject:
    camera = Camera.of(design.thin_twin)
    moved = any(
        value for place, value in camera.numbers.items() if not {"decentre", "tilt"}.isdisjoint(place.split("."))
    )
    warmth = ROOM if design.environment is None else float(design.environment.temperature)
    wide = float(QUANTITIES["field_half_width_mm"](camera))
    return _Subject(sequence_of(design), design.name, design.wavelength, warmth, wide, moved)


def _is_lens(name: str) -> bool:
    """Whether it is a lens by that name, or in that file, and no design."""
    path = Path(name)
    if path.suffix.lower() == ".zmx" or (name.lower() in shipped_names() and not path.exists()):
        return True
    return (
        path.suffix.lower() == ".toml" and path.is_file() and b"[[surfaces]]" in read_bytes(path, name, most=MOST_TEXT)
    )
