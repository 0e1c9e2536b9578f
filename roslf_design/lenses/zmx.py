"""Zemax .zmx files: the strict subset that describes a lens of coaxial spheres, conics and even aspheres.

What is not understood is refused with its line, never skipped: a keyword that was skipped could be a tilt, a mirror or
a pickup, and the lens would be wrong without a word. The object and image surfaces, and the distances to them, are
the old camera's and are left out; the design places the lens.
"""

from __future__ import annotations

import codecs
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError, Problem
from .glass import AIR, Glass, find_glass
from .prescription import LensError, Prescription, Surface, faults

# What the old camera looked at and how it was computed, drawn or optimised: nothing of the lens itself.
_HEADER = """
VERS NOTE PFIL LANG ENPD FNUM OBNA FLOA EFFL GFAC GCAT RAIM PUSH SDMA FTYP ROPD PICB XFLN YFLN FWGN VDXN VDYN
VCXN VCYN VANN XFLD YFLD FWGT ZVDX ZVDY ZVCX ZVCY ZVAN WAVL WAVN WWGT WTYP POLS GLRS GSTD NSCD COFN HYPR TOL TOLE MOFF
BLNK OPDF OPTI DMFS FPST SPTS AUTH TITL"""
_DRAWING = "HIDE MIRR SLAB POPS COMM COAT MEMA FIMP VDSZ VPAR SCOL OPAC BLNK"
_HANGING = "PZUP CPUP PPUP GPUP TPUP PICK PKUP SZUP"
HARMLESS, HARMLESS_IN_SURFACE = frozenset(_HEADER.split()), frozenset(_DRAWING.split())
PICKUPS = frozenset(_HANGING.split())
UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}
SUBSET = "STANDARD and EVENASPH surfaces with CURV, CONI, PARM, DISZ, GLAS, DIAM, CLAP, FLAP, STOP"
LISTED = 20


@dataclass
class _Row:
    """A surface while it is being read."""

    line: int
    kind: str = "STANDARD"
    curvature: float | None = None
    conic: float = 0.0
    thickness: float | None = None
    glass: Glass = AIR
    semi_diameter: float = 0.0
    automatic: bool = True
    aperture: float = 0.0
    stop: bool = False
    solved: int = 0
    terms: dict[int, float] = field(default_factory=dict)


class _LineError(Exception):
    """A line that cannot be read."""


def read_zmx(path: str | os.PathLike[str]) -> Prescription:
    """Read the lens in a .zmx file.

    Raises
    ------
    LensError
        Names the file and each line that is not understood.
    """
    origin = os.fspath(path)
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise _failed(origin, "no such file; check the path") from None
    except OSError as error:
        raise _failed(origin, f"cannot be read: {error.strerror}; name a .zmx file and check its permissions") from None
    return parse_zmx(_decode(content, origin), origin)


def _failed(origin: str, message: str) -> LensError:
    return LensError((Problem("", message),), origin)


def _decode(content: bytes, origin: str) -> str:
    if not content.strip(b"\x00 \r\n\t"):
        raise _failed(origin, "is empty; save the lens again")
    marks = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
    guess = next((name for mark, name in marks if content.startswith(mark)), None)
    for name, half in (("utf-16-le", content[1:400:2]), ("utf-16-be", content[0:400:2])):
        if guess is None and 2 * half.count(0) > len(half):  # no mark, but every other byte is zero
            guess = name
    for encoding in (guess,) if guess else ("utf-8", "latin-1"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError as error:
            if guess:
                message = f"is cut off or damaged {encoding} text (byte {error.start}); save the lens again"
                raise _failed(origin, message) from None
        else:
            break
    if any(ord(c) < 32 and c not in "\r\n\t\f" for c in text):
        raise _failed(origin, "is not text; a .zmx file is text (a .zar archive must be unpacked first)")
    return text


def parse_zmx(text: str, origin: str = "") -> Prescription:
    """Read the lens in the text of a .zmx file; `origin` is what errors call it."""
    found: list[Problem] = []
    rows: list[_Row] = []
    head: dict[str, str] = {}
    waves: dict[int, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        try:
            _read_line(words, number, rows, head, waves)
        except _LineError as fault:
            found.append(Problem(f"line {number}", str(fault)))
        except InputError as error:
            found.append(Problem(f"line {number}", error.problems[0].message))
    if "UNIT" not in head and not found:
        found.append(Problem("", "has no UNIT line; is it a whole .zmx file?"))
    if len(found) > LISTED:
        more = f"and {len(found) - LISTED} more lines that are not understood; this reader knows {SUBSET}"
        found = [*found[:LISTED], Problem("", more)]
    surfaces, notes = ((), "") if found else _assemble(rows, float(head["UNIT"]), found)
    if found:
        raise LensError(tuple(found), origin)
    primary = waves.get(int(head.get("PWAV", "0")))
    name = head.get("NAME") or Path(origin).stem
    return Prescription(surfaces, name, f"{Path(origin).name}{notes}", primary)


def _read_line(words: list[str], number: int, rows: list[_Row], head: dict[str, str], waves: dict[int, float]) -> None:
    key, rest = words[0], words[1:]
    if key == "SURF":
        place = _integer(rest, "SURF")
        if place != len(rows):
            raise _LineError(f"SURF {place} where SURF {len(rows)} was due: surfaces are missing or out of order")
        rows.append(_Row(number))
    elif rows and _read_surface(key, rest, rows[-1]):
        return
    elif key == "UNIT":
        unit = rest[0] if rest else ""
        if unit not in UNITS:
            raise _LineError(f"UNIT {unit or '(nothing)'} is not a lens unit; known: {', '.join(UNITS)}")
        head["UNIT"] = repr(UNITS[unit])
    elif key == "MODE":
        if rest[:1] != ["SEQ"]:
            raise _LineError(f"MODE {' '.join(rest)}: only sequential lenses (MODE SEQ) can be read")
    elif key == "NAME":
        head["NAME"] = " ".join(rest)
    elif key == "ENVD":
        if len(rest) > 2 and rest[2] not in ("0", "0.0") and _number(rest, "ENVD") != 20:
            raise _LineError(
                f"ENVD asks for indices at {rest[0]} C; only 20 C is known: set it or turn the adjustment off"
            )
    elif key == "MNUM":
        if rest and _integer(rest, "MNUM") > 1:
            raise _LineError(f"MNUM {rest[0]}: the file holds {rest[0]} configurations; save one of them")
    elif key == "WAVM":
        length = _number(rest[1:], "WAVM")
        if not length > 0:
            raise _LineError(f"WAVM {length:g}: a wavelength must be positive (in um)")
        waves[_integer(rest, "WAVM")] = length * 1e-3
    elif key == "PWAV":
        head["PWAV"] = str(_integer(rest, "PWAV"))
    elif key not in HARMLESS:
        if key in PICKUPS:
            raise _LineError(f"{key} is a pickup: its value hangs on another; fix the value in the file")
        raise _LineError(f"{key} is not understood; this reader knows {SUBSET}")


def _read_surface(key: str, rest: list[str], row: _Row) -> bool:
    """Take a line that belongs to a surface; False where the keyword is none of a surface's."""
    if key == "TYPE":
        row.kind = rest[0] if rest else ""
        if row.kind not in ("STANDARD", "EVENASPH"):
            raise _LineError(f"TYPE {row.kind or '(nothing)'} cannot be read; only STANDARD and EVENASPH can")
    elif key == "CURV":
        row.curvature = _number(rest, "CURV")
        _no_solve(rest[1:2], "CURV")
    elif key == "CONI":
        row.conic = _number(rest, "CONI")
    elif key == "DISZ":
        row.thickness = math.inf if rest[:1] == ["INFINITY"] else _number(rest, "DISZ")
    elif key == "MAZH":
        row.solved = 1
    elif key == "GLAS":
        _read_glass(rest, row)
    elif key == "DIAM":
        row.semi_diameter = _number(rest, "DIAM")
        row.automatic = rest[1:2] in ([], ["0"])
    elif key in ("CLAP", "FLAP"):
        if _number(rest, key) != 0:
            raise _LineError(f"{key} {' '.join(rest)}: a central obstruction cannot be read; only clear discs can")
        radius = _number(rest[1:], key)
        if key == "CLAP" or row.semi_diameter == 0:
            row.aperture = radius
    elif key == "STOP":
        row.stop = True
    elif key == "PARM":
        term, value = _integer(rest, "PARM"), _number(rest[1:], "PARM")
        if value != 0 and not 1 <= term <= 8:
            raise _LineError(f"PARM {term}: an even asphere has terms 1 (r^2) to 8 (r^16)")
        row.terms[term] = value
    else:
        return key in HARMLESS_IN_SURFACE
    return True


def _read_glass(rest: list[str], row: _Row) -> None:
    name = rest[0] if rest else ""
    if name.upper() == "MIRROR":
        raise _LineError("GLAS MIRROR: mirrors cannot be read; this reader knows refracting lenses")
    if name.startswith("___BLANK") or rest[1:2] == ["1"]:
        raise _LineError(f"GLAS {name}: a model glass is a guess at a real one; name the glass itself")
    if rest[1:2] == ["2"]:
        raise _LineError(f"GLAS {name} is a pickup: its value hangs on another surface; fix the value in the file")
    if not name:
        raise _LineError("GLAS names no glass; is the line cut off?")
    row.glass = find_glass(name)


def _no_solve(flag: list[str], key: str) -> None:
    if flag and flag[0] not in ("0", "1"):  # 1: variable in an optimisation, a value all the same
        raise _LineError(f"{key} has a solve or pickup (type {flag[0]}); fix the value in the file")


def _number(words: list[str], key: str) -> float:
    if not words:
        raise _LineError(f"{key} lacks its number; is the line cut off?")
    try:
        value = float(words[0])
    except ValueError:
        raise _LineError(f"{key} {words[0]}: not a number") from None
    if not math.isfinite(value):
        raise _LineError(f"{key} {words[0]}: not a finite number")
    return value


def _integer(words: list[str], key: str) -> int:
    value = _number(words, key)
    if value != int(value):
        raise _LineError(f"{key} {words[0]}: not a whole number")
    return int(value)


def _assemble(rows: list[_Row], scale: float, found: list[Problem]) -> tuple[tuple[Surface, ...], str]:
    if len(rows) < 3:
        message = f"has {len(rows)} surfaces; a lens lies between an object and an image surface: is the file cut off?"
        found.append(Problem("", message))
        return (), ""
    if rows[0].glass != AIR:
        found.append(Problem(f"line {rows[0].line}", f"the object lies in {rows[0].glass.name}; it must lie in air"))
    rows = rows[1:-1]
    kept = list(_without_dummies(rows))
    real = [id(row) for row, _ in kept]
    for row in rows:
        faulty = _row_faults(row, last=row is rows[-1], real=id(row) in real)
        found += [Problem(f"line {row.line}", message) for message in faulty]
    if found:
        return (), ""
    if not kept:
        found.append(Problem("", "holds no refracting surface"))
        return (), ""
    surfaces = tuple(_surface(row, thickness, scale) for row, thickness in kept)
    for problem in faults(surfaces):
        which = int(problem.key.split(".")[1]) - 1
        found.append(Problem(f"line {kept[which][0].line}", problem.message))
    guessed = [str(n) for n, (row, _) in enumerate(kept, start=1) if row.automatic and row.aperture == 0]
    note = f"; clear diameters of surfaces {', '.join(guessed)} are the file's automatic ones" if guessed else ""
    return surfaces, note


def _row_faults(row: _Row, *, last: bool, real: bool) -> Iterator[str]:
    if row.curvature is None or row.thickness is None:
        missing = "CURV" if row.curvature is None else "DISZ"
        yield f"the surface that begins here has no {missing}; is the file cut off?"
    if real and row.semi_diameter <= 0 and row.aperture <= 0:
        yield "the surface that begins here has no clear diameter; give DIAM or CLAP"
    if row.kind == "STANDARD" and any(row.terms.values()):
        yield "the surface that begins here is STANDARD but has PARM values; make it EVENASPH"
    if row.solved and not last:
        yield "the thickness after the surface that begins here is a solve (MAZH); fix the value in the file"
    if row.thickness == math.inf and not last:
        yield "the thickness after the surface that begins here is infinite; only the object's may be"
    if last and row.glass != AIR:
        yield f"the last lens surface ends in {row.glass.name}; is the file cut off?"


def _without_dummies(rows: list[_Row]) -> Iterator[tuple[_Row, float]]:
    """Real surfaces with the distance to the next real one: planes from air to air are only places to measure from."""
    before = AIR
    real = []
    for index, row in enumerate(rows):
        empty = row.glass == before and not row.curvature and not any(row.terms.values())
        if row.stop or not empty:
            real.append(index)
        before = row.glass
    for index, following in zip(real, [*real[1:], None], strict=True):
        gap = math.fsum(row.thickness or 0.0 for row in rows[index:following]) if following is not None else 0.0
        yield rows[index], gap


def _surface(row: _Row, thickness: float, scale: float) -> Surface:
    top = max((term for term, value in row.terms.items() if value), default=0)
    asphere = tuple(row.terms.get(term, 0.0) * scale ** (1 - 2 * term) for term in range(1, top + 1))
    semi = (row.aperture or row.semi_diameter) * scale
    return Surface((row.curvature or 0.0) / scale, semi, thickness * scale, row.glass, row.conic, asphere)
