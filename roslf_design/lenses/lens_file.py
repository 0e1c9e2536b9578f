"""Lens files: a prescription as TOML with units, in and out, and Zemax .zmx in; every fault told at once.

.. code-block:: toml

    name = "LA1050-A"
    source = "Thorlabs catalogue"
    wavelength = "587.6 nm"       # optional: the maker's design wavelength
    temperature = "20 degC"       # optional: at which its lengths hold

    [[surfaces]]                  # from the scene to the sensor
    radius = "51.5 mm"            # "inf" for a plane; or curvature = "0.0194 mm^-1"
    thickness = "9.69 mm"         # to the next surface
    glass = "N-BK7"               # after this surface, or {index = 1.5168, abbe = 64.2}; left out: air
    diameter = "50.8 mm"          # clear diameter; what lies outside is clipped
    conic = -0.6                  # optional
    asphere = { r4 = "1e-6 mm^-3" }   # optional: r2 to r16

    [[surfaces]]
    radius = "inf"
    diameter = "50.8 mm"

    [glasses]                     # optional: glasses that do not ship
    N-FK58 = { file = "schott.agf" }  # out of a catalogue (.agf), or a page of refractiveindex.info (.yml)
    melt = { index = 1.5171, abbe = 64.0 }  # by its numbers at 587.6 nm
    resin = { formula = "schott", a = [2.2, -0.01, 0.011], range = ["0.4 um", "1 um"] }

Of .zmx files the strict subset is read that describes a lens of coaxial spheres, conics and even aspheres. What is not
understood is refused with its line, never skipped: a keyword that was skipped could be a tilt, a mirror or a pickup,
and the lens would be wrong without a word. The object and image surfaces, and the distances to them, are the old
camera's and are left out; the design places the lens.
"""

from __future__ import annotations

import codecs
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from ..errors import InputError, Problem
from ..input_files import MOST_TEXT, read_bytes
from ..toml_files import PlainNumber, StrictTable, parse_toml, read_toml, validated
from ..units import FARTHEST, Angle, AnyLength, Length, Temperature, format_quantity, read_quantity
from .glass import AIR, ROOM, Glass, find_glass, is_shipped
from .material import Material, glass_table, numbers_of
from .prescription import LensError, Prescription, Surface, faults
from .tracer import MODES

SHIPPED = Path(__file__).with_name("shipped")
"""Folder of the lenses that ship."""
_POWER = re.compile(r"\s*([+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?)\s*mm(?:\^|\*\*)(-?\d+)\s*")


def load_lens(path: str | os.PathLike[str]) -> Prescription:
    """Read a lens from a .toml or .zmx file, or a shipped one by its name such as "LA1050-A".

    Raises
    ------
    LensError
        Names the file and every fault in it.
    """
    place, origin = Path(path), os.fspath(path)
    if origin.lower() in shipped_names() and not place.exists():
        return _loads_lens((SHIPPED / f"{origin.lower()}.toml").read_text("utf-8"), origin)
    if place.suffix.lower() == ".zmx":
        return _read_zmx(place)
    known = ", ".join(name.upper() for name in shipped_names())
    missing = f"check the path, or name a lens that ships: {known}"
    return lens_of(read_toml(place, origin, missing, refusal=LensError), origin, place.parent)


@cache
def shipped_names() -> tuple[str, ...]:
    """Names of the lenses that ship, in lower case."""
    return tuple(sorted(entry.stem for entry in SHIPPED.glob("*.toml")))


def _loads_lens(text: str, origin: str = "") -> Prescription:
    """Read a lens from TOML text; `origin` is what errors call it."""
    return lens_of(parse_toml(text, origin, refusal=LensError), origin)


def lens_of(data: Mapping[str, Any], origin: str = "", folder: Path | None = None) -> Prescription:
    """A lens from the nested values of a lens file.

    `origin` is what errors call it, `folder` where glass files that it names are looked for; None: it may name none.
    """
    read = validated(LensFile, data, origin, refusal=LensError, folder=folder)
    surfaces, warmth = tuple(row.surface for row in read.surfaces.values()), float(read.temperature)
    if warmth != ROOM:
        surfaces = tuple(replace(surface, glass=surface.glass.at(warmth)) for surface in surfaces)
    wavelength = None if read.wavelength is None else float(read.wavelength)
    return Prescription(surfaces, read.name, read.source, wavelength, warmth, read.clear_aperture)


def _inverse_length(power: int) -> BeforeValidator:
    """Validator of a number of mm^power."""
    unit = f"mm^{power}"

    def read(text: object) -> float:
        match = _POWER.fullmatch(text) if isinstance(text, str) else None
        if match is None or int(match[2]) != power:
            raise ValueError(f'expected a number of {unit} such as "1.2e-5 {unit}", got {text!r}')
        return float(match[1])

    return BeforeValidator(read)


def _radius(text: object, info: ValidationInfo) -> float | None:
    if "curvature" not in info.data:  # whose own fault is told
        return None
    curved = info.data["curvature"] is not None
    if text is None and not curved:
        raise ValueError('is missing; add e.g. radius = "51.5 mm", or "inf"')
    if text is None:
        return None
    if curved:
        raise ValueError("radius and curvature: both are given; drop one")
    if isinstance(text, str) and text.strip().lower().removesuffix("mm").strip() in _PLANES:
        return math.inf
    radius = read_quantity(text, "length")
    if radius == 0:
        raise ValueError('"0 mm" is a point; write "inf" for a plane')
    return radius


class Asphere(StrictTable, defer_build=True):
    """Terms of an even asphere."""

    r2: Annotated[float, _inverse_length(-1)] = 0.0
    r4: Annotated[float, _inverse_length(-3)] = 0.0
    r6: Annotated[float, _inverse_length(-5)] = 0.0
    r8: Annotated[float, _inverse_length(-7)] = 0.0
    r10: Annotated[float, _inverse_length(-9)] = 0.0
    r12: Annotated[float, _inverse_length(-11)] = 0.0
    r14: Annotated[float, _inverse_length(-13)] = 0.0
    r16: Annotated[float, _inverse_length(-15)] = 0.0

    @property
    def terms(self) -> tuple[float, ...]:
        """Terms of r^2, r^4 and so on, up to the last that is not 0."""
        terms = list(self.model_dump().values())
        while terms and terms[-1] == 0:
            terms.pop()
        return tuple(terms)


Curvature = Annotated[float, _inverse_length(-1)]
Radius = Annotated[float | None, Field(allow_inf_nan=True, validate_default=True), BeforeValidator(_radius)]
_Form = Annotated[tuple[AnyLength, ...], Field(min_length=MODES, max_length=MODES)]
_PLANES = ("inf", "+inf", "-inf", "infinity")


class SurfaceTable(StrictTable, defer_build=True):
    """One of a lens file's [[surfaces]]."""

    curvature: Curvature | None = None
    """Curvature instead of the radius, as `"0.0194 mm^-1"`."""
    radius: Radius = None
    """Radius, above 0 where the centre lies towards the sensor; `"inf"` for a plane."""
    thickness: AnyLength = 0.0
    glass: Material = AIR
    diameter: Annotated[Length, Field(examples=["50.8 mm"])]
    conic: PlainNumber = 0.0
    asphere: Asphere = Field(default_factory=lambda: Asphere())
    index_offset: Annotated[PlainNumber, Field(gt=-1, lt=1)] = 0.0
    shift: tuple[AnyLength, AnyLength, AnyLength] = (0.0, 0.0, 0.0)
    tilt: tuple[Angle, Angle] = (0.0, 0.0)
    irregularity: _Form = ()

    @field_validator("glass", mode="before")
    @classmethod
    def _by_name(cls, value: object) -> object:
        if isinstance(value, Mapping) and "formula" in value:
            raise ValueError("a glass by its formula stands in [glasses], and its name here")
        return value

    @property
    def surface(self) -> Surface:
        """Surface that it describes."""
        curvature = (self.curvature or 0.0) if self.radius is None else 1 / self.radius
        poses: tuple[Any, ...] = tuple(
            tuple(map(float, values)) for values in (self.shift, self.tilt, self.irregularity)
        )
        glass = self.glass.with_offset(self.index_offset)
        return Surface(
            curvature, self.diameter / 2, float(self.thickness), glass, self.conic, self.asphere.terms, *poses
        )


class LensFile(StrictTable, defer_build=True):
    """A lens file; its glasses come first, for the surfaces name them."""

    name: str = ""
    source: str = ""
    wavelength: Length | None = None
    temperature: Temperature = ROOM
    clear_aperture: Length | None = None
    glasses: dict[str, Material] = Field(default={})
    surfaces: dict[int, SurfaceTable] = Field(default=(), validate_default=True)

    @field_validator("glasses", mode="before")
    @classmethod
    def _named(cls, glasses: object) -> object:
        """Glasses, each with the name before its table unless the table gives another."""
        if not isinstance(glasses, Mapping):
            return glasses
        return {name: {"name": name, **one} if isinstance(one, Mapping) else one for name, one in glasses.items()}

    @field_validator("glasses", mode="after")
    @classmethod
    def _findable(cls, glasses: dict[str, Glass]) -> dict[str, Glass]:
        return {name.upper(): replace(glass, name=name) for name, glass in glasses.items()}

    @field_validator("surfaces", mode="before")
    @classmethod
    def _numbered(cls, rows: object, info: ValidationInfo) -> object:
        """Surfaces by their numbers, from 1 on, with the file's own glasses in place of their names."""
        if not isinstance(rows, (list, tuple)):
            raise ValueError("must be a list of tables; write [[surfaces]] once for each surface")
        return {n: _with_own_glass(row, info.data.get("glasses")) for n, row in enumerate(rows, start=1)}

    @field_validator("surfaces", mode="after")
    @classmethod
    def _fit(cls, rows: dict[int, SurfaceTable], info: ValidationInfo) -> dict[int, SurfaceTable]:
        if "glasses" in info.data and (problems := [*faults(tuple(row.surface for row in rows.values()))]):
            inner = (Problem(p.key.removeprefix("surfaces").lstrip("."), p.message) for p in problems)
            raise InputError(tuple(inner))
        return rows


def _with_own_glass(row: Any, own: Mapping[str, Glass] | None) -> Any:
    """Table of a surface with the file's own glass in place of its name; without, where those have faults."""
    name = row.get("glass") if isinstance(row, Mapping) else None
    if not isinstance(name, str):
        return row
    if own is None:
        return {**row, "glass": AIR}
    return {**row, "glass": own.get(name.upper(), name)}


def table_of(lens: Prescription, digits: int | None = None) -> dict[str, Any]:
    """The nested values of a lens file that `lens_of` turns into an equal lens, or one rounded to `digits`."""
    data: dict[str, Any] = {key: text for key in ("name", "source") if (text := getattr(lens, key))}
    if lens.wavelength is not None:
        data["wavelength"] = format_quantity(lens.wavelength, "length")
    if lens.temperature != ROOM:
        data["temperature"] = format_quantity(lens.temperature, "temperature")
    if lens.clear_aperture is not None:
        data["clear_aperture"] = format_quantity(lens.clear_aperture, "length")
    data["surfaces"] = [_row(surface, digits) for surface in lens.surfaces]
    glasses = (surface.glass for surface in lens.surfaces)
    strange = (glass for glass in glasses if not is_shipped(glass) and not numbers_of(glass))
    own = {glass.name: replace(glass, offset=0.0, temperature=ROOM) for glass in strange}
    if own:
        data["glasses"] = {name: glass_table(glass) for name, glass in own.items()}
    return data


def _row(surface: Surface, digits: int | None) -> dict[str, Any]:
    terms = {
        f"r{2 * i}": f"{float(f'{a:.{digits or 17}g}')!r} mm^{1 - 2 * i}"
        for i, a in enumerate(surface.asphere, start=1)
        if a
    }
    row = {
        "thickness": format_quantity(surface.thickness, "length", digits) if surface.thickness else None,
        "glass": numbers_of(surface.glass) or surface.glass.name if surface.glass != AIR else None,
        "index_offset": surface.glass.offset,
        "diameter": format_quantity(2 * surface.semi_diameter, "length", digits),
        "conic": surface.conic,
        "asphere": terms,
        "shift": [format_quantity(value, "length", digits) for value in surface.shift] if any(surface.shift) else None,
        "tilt": [format_quantity(value, "angle", digits) for value in surface.tilt] if any(surface.tilt) else None,
        "irregularity": [format_quantity(value, "length", digits) for value in surface.irregularity],
    }
    return _radius_text(surface.curvature, digits) | {key: value for key, value in row.items() if value}


def _radius_text(curvature: float, most: int | None) -> dict[str, Any]:
    """The radius in so many digits; or the shortest whose reciprocal is this very curvature, else that itself."""
    if curvature == 0:
        return {"radius": "inf"}
    for digits in range(1, 18) if most is None else (most,):
        radius = float(f"{1 / curvature:.{digits}g}")
        if abs(radius) <= FARTHEST["length"] and (most is not None or 1 / radius == curvature):
            return {"radius": format_quantity(radius, "length")}
    return {"curvature": f"{Decimal(repr(curvature))} mm^-1"}


# What the old camera looked at and how it was computed, drawn or optimised: nothing of the lens itself.
_HEADER = """
VERS NOTE PFIL LANG ENPD FNUM OBNA FLOA EFFL GFAC GCAT RAIM PUSH SDMA FTYP ROPD PICB XFLN YFLN FWGN VDXN VDYN
VCXN VCYN VANN XFLD YFLD FWGT ZVDX ZVDY ZVCX ZVCY ZVAN WAVL WAVN WWGT WTYP POLS GLRS GSTD NSCD COFN HYPR TOL TOLE MOFF
BLNK OPDF OPTI DMFS FPST SPTS AUTH TITL"""
_DRAWING = "HIDE MIRR SLAB POPS COMM COAT MEMA FIMP VDSZ VPAR SCOL OPAC BLNK"
_HANGING = "PZUP CPUP PPUP GPUP TPUP PICK PKUP SZUP"
HARMLESS, HARMLESS_IN_SURFACE, PICKUPS = (frozenset(names.split()) for names in (_HEADER, _DRAWING, _HANGING))
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
    solved: bool = False
    terms: dict[int, float] = field(default_factory=dict)


def _read_zmx(path: str | os.PathLike[str]) -> Prescription:
    """Read the lens in a .zmx file.

    Raises
    ------
    LensError
        Names the file and each line that is not understood.
    """
    origin = os.fspath(path)
    content = read_bytes(Path(path), origin, most=MOST_TEXT, refusal=LensError)
    return _parse_zmx(_decode(content, origin), origin)


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
    for encoding in (guess,) if guess else ("utf-8", "cp1252", "latin-1"):
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


def _parse_zmx(text: str, origin: str = "") -> Prescription:
    """Read the lens in the text of a .zmx file; `origin` is what errors call it."""
    problems: list[Problem] = []
    rows: list[_Row] = []
    head: dict[str, str] = {}
    waves: dict[int, float] = {}
    # Comments of any code page may hold what Python takes for ends of lines.
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        words = line.split()
        if not words:
            continue
        try:
            _read_line(words, number, rows, head, waves)
        except ValueError as error:
            message = error.problems[0].message if isinstance(error, InputError) else str(error)
            problems.append(Problem(f"line {number}", message))
    if "UNIT" not in head and not problems:
        problems.append(Problem("", "has no UNIT line; is it a whole .zmx file?"))
    if len(problems) > LISTED:
        more = f"and {len(problems) - LISTED} more lines that are not understood; this reader knows {SUBSET}"
        problems = [*problems[:LISTED], Problem("", more)]
    surfaces, notes = ((), "") if problems else _assemble(rows, float(head["UNIT"]), problems)
    if problems:
        raise LensError(tuple(problems), origin)
    primary = waves.get(int(head.get("PWAV", "0")))
    name = head.get("NAME") or Path(origin).stem
    return Prescription(surfaces, name, f"{Path(origin).name}{notes}", primary)


def _read_line(words: list[str], number: int, rows: list[_Row], head: dict[str, str], waves: dict[int, float]) -> None:
    key, rest = words[0], words[1:]
    if key == "SURF":
        place = _integer(rest, "SURF")
        if place != len(rows):
            raise ValueError(f"SURF {place} where SURF {len(rows)} was due: surfaces are missing or out of order")
        rows.append(_Row(number))
    elif rows and _read_surface(key, rest, rows[-1]):
        return
    elif key == "UNIT":
        unit = rest[0] if rest else ""
        if unit not in UNITS:
            raise ValueError(f"UNIT {unit or '(nothing)'} is not a lens unit; known: {', '.join(UNITS)}")
        head["UNIT"] = repr(UNITS[unit])
    elif key == "MODE":
        if rest[:1] != ["SEQ"]:
            raise ValueError(f"MODE {' '.join(rest)}: only sequential lenses (MODE SEQ) can be read")
    elif key == "NAME":
        head["NAME"] = " ".join(rest)
    elif key == "ENVD":
        if len(rest) > 2 and rest[2] not in ("0", "0.0") and _number(rest, "ENVD") != 20:
            raise ValueError(
                f"ENVD asks for indices at {rest[0]} C; only 20 C is known: set it or turn the adjustment off"
            )
    elif key == "MNUM":
        if rest and _integer(rest, "MNUM") > 1:
            raise ValueError(f"MNUM {rest[0]}: the file holds {rest[0]} configurations; save one of them")
    elif key == "WAVM":
        length = _number(rest[1:], "WAVM")
        if not length > 0:
            raise ValueError(f"WAVM {length:g}: a wavelength must be positive (in um)")
        waves[_integer(rest, "WAVM")] = length * 1e-3
    elif key == "PWAV":
        head["PWAV"] = str(_integer(rest, "PWAV"))
    elif key not in HARMLESS:
        if key in PICKUPS:
            raise ValueError(f"{key} is a pickup: its value hangs on another; fix the value in the file")
        raise ValueError(f"{key} is not understood; this reader knows {SUBSET}")


def _read_surface(key: str, rest: list[str], row: _Row) -> bool:
    """Take a line that belongs to a surface; False where the keyword is none of a surface's."""
    if key == "TYPE":
        row.kind = rest[0] if rest else ""
        if row.kind not in ("STANDARD", "EVENASPH"):
            raise ValueError(f"TYPE {row.kind or '(nothing)'} cannot be read; only STANDARD and EVENASPH can")
    elif key == "CURV":
        row.curvature = _number(rest, "CURV")
        if rest[1:2] and rest[1] not in ("0", "1"):  # 1: variable in an optimisation, a value all the same
            raise ValueError(f"CURV has a solve or pickup (type {rest[1]}); fix the value in the file")
    elif key == "CONI":
        row.conic = _number(rest, "CONI")
    elif key == "DISZ":
        row.thickness = math.inf if rest[:1] == ["INFINITY"] else _number(rest, "DISZ")
    elif key == "MAZH":
        row.solved = True
    elif key == "GLAS":
        _zmx_glass(rest, row)
    elif key == "DIAM":
        row.semi_diameter = _number(rest, "DIAM")
        row.automatic = rest[1:2] in ([], ["0"])
    elif key in ("CLAP", "FLAP"):
        if _number(rest, key) != 0:
            raise ValueError(f"{key} {' '.join(rest)}: a central obstruction cannot be read; only clear discs can")
        radius = _number(rest[1:], key)
        if key == "CLAP" or row.semi_diameter == 0:
            row.aperture = radius
    elif key == "STOP":
        row.stop = True
    elif key == "PARM":
        term, value = _integer(rest, "PARM"), _number(rest[1:], "PARM")
        if value != 0 and not 1 <= term <= 8:
            raise ValueError(f"PARM {term}: an even asphere has terms 1 (r^2) to 8 (r^16)")
        row.terms[term] = value
    else:
        return key in HARMLESS_IN_SURFACE
    return True


def _zmx_glass(rest: list[str], row: _Row) -> None:
    name = rest[0] if rest else ""
    if name.upper() == "MIRROR":
        raise ValueError("GLAS MIRROR: mirrors cannot be read; this reader knows refracting lenses")
    if name.startswith("___BLANK") or rest[1:2] == ["1"]:
        raise ValueError(f"GLAS {name}: a model glass is a guess at a real one; name the glass itself")
    if rest[1:2] == ["2"]:
        raise ValueError(f"GLAS {name} is a pickup: its value hangs on another surface; fix the value in the file")
    if not name:
        raise ValueError("GLAS names no glass; is the line cut off?")
    row.glass = find_glass(name)


def _number(words: list[str], key: str) -> float:
    if not words:
        raise ValueError(f"{key} lacks its number; is the line cut off?")
    try:
        value = float(words[0])
    except ValueError:
        raise ValueError(f"{key} {words[0]}: not a number") from None
    if not math.isfinite(value):
        raise ValueError(f"{key} {words[0]}: not a finite number")
    return value


def _integer(words: list[str], key: str) -> int:
    value = _number(words, key)
    if value != int(value):
        raise ValueError(f"{key} {words[0]}: not a whole number")
    return int(value)


def _assemble(rows: list[_Row], scale: float, problems: list[Problem]) -> tuple[tuple[Surface, ...], str]:
    if len(rows) < 3:
        message = f"has {len(rows)} surfaces; a lens lies between an object and an image surface: is the file cut off?"
        problems.append(Problem("", message))
        return (), ""
    if rows[0].glass != AIR:
        problems.append(Problem(f"line {rows[0].line}", f"the object lies in {rows[0].glass.name}; it must lie in air"))
    rows = rows[1:-1]
    kept = list(_without_dummies(rows))
    real = [id(row) for row, _ in kept]
    for row in rows:
        faulty = _row_faults(row, last=row is rows[-1], real=id(row) in real)
        problems += [Problem(f"line {row.line}", message) for message in faulty]
    if problems:
        return (), ""
    if not kept:
        problems.append(Problem("", "holds no refracting surface"))
        return (), ""
    surfaces = tuple(_zmx_surface(row, thickness, scale) for row, thickness in kept)
    for problem in faults(surfaces):
        which = int(problem.key.split(".")[1]) - 1
        problems.append(Problem(f"line {kept[which][0].line}", problem.message))
    guessed = [str(n) for n, (row, _) in enumerate(kept, start=1) if row.automatic and row.aperture == 0]
    note = f"; clear diameters of surfaces {', '.join(guessed)} are the file's automatic ones" if guessed else ""
    if len(surfaces) > 2 and not any(surface.curvature or any(surface.asphere) for surface in surfaces[-2:]):
        note += f"; surfaces {len(surfaces) - 1} and {len(surfaces)}, a plane plate, are counted as the lens's own"
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
        yield (
            f"the last lens surface ends in {row.glass.name}; is the file cut off? A cover glass on the image is the "
            "design's, sensor.cover: drop it here"
        )


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


def _zmx_surface(row: _Row, thickness: float, scale: float) -> Surface:
    top = max((term for term, value in row.terms.items() if value), default=0)
    asphere = tuple(row.terms.get(term, 0.0) * scale ** (1 - 2 * term) for term in range(1, top + 1))
    semi = (row.aperture or row.semi_diameter) * scale
    return Surface((row.curvature or 0.0) / scale, semi, thickness * scale, row.glass, row.conic, asphere)
