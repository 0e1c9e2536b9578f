"""`roslf export`."""

from __future__ import annotations

from pathlib import Path

from ..camera import Camera
from ..design import load
from ..design.sequence import D_LINE, lens_rows, optiland, sequence_of, zmx
from ..input_files import MOST_TEXT, read_bytes
from ..lenses.glass import ROOM
from ..lenses.lens_file import load_lens, shipped_names
from ..lenses.prescription import Prescription
from ..theory.quantities import QUANTITIES
from .terminal import Output, check_target, say, write_files

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
    lens = _lens(name)
    if lens is not None:
        rows, title, wide, warmth = lens_rows(lens), lens.name, 0.0, lens.temperature
        wavelength = lens.wavelength or D_LINE
    else:
        design = load(name)
        rows, title, wavelength = sequence_of(design), design.name, design.wavelength
        wide = float(QUANTITIES["field_half_width_mm"](Camera.of(design.thin_twin)))
        warmth = ROOM if design.environment is None else float(design.environment.temperature)
    text = zmx(rows, title, wavelength, warmth, wide) if kind == ".zmx" else optiland(rows, title, wavelength, wide)
    write_files(output.parent, {output.name: text.encode()})
    say(f"{output}: {len(rows)} surfaces")
    if lens is None and not (design.aligned and all(element.decentre == (0.0, 0.0) for element in design.elements)):
        print("Misalignments are left out.")


def _lens(name: str) -> Prescription | None:
    """A lens by that name, or in that file; None where it is a design."""
    path = Path(name)
    if path.suffix.lower() == ".zmx" or (name.lower() in shipped_names() and not path.exists()):
        return load_lens(name)
    if path.suffix.lower() == ".toml" and path.is_file() and b"[[surfaces]]" in read_bytes(path, name, most=MOST_TEXT):
        return load_lens(name)
    return None
