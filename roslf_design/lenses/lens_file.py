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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from ..errors import InputError, Problem
from ..input_files import MOST_TEXT, read_bytes
from ..toml_files import nearest, parse_toml, read_toml
from ..units import FARTHEST, format_quantity, read_quantity
from .glass import AIR, COEFFICIENTS, ROOM, Glass, Warming, find_glass, is_shipped, read_glass
from .glass_files import glass_of_table
from .prescription import ASPHERE_TERMS, LensError, Prescription, Surface, faults
from .tracer import MODES

TOP = ("name", "source", "wavelength", "temperature", "surfaces", "glasses")
SURFACE = (
    *("radius", "curvature", "thickness", "glass", "diameter", "conic", "asphere", "index_offset"),
    *("shift", "tilt", "irregularity"),
)
POWERS = tuple(f"r{2 * i}" for i in range(1, ASPHERE_TERMS + 1))
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
        return _loads_lens(files(__package__).joinpath("shipped", f"{origin.lower()}.toml").read_text("utf-8"), origin)
    if place.suffix.lower() == ".zmx":
        return _read_zmx(place)
    known = ", ".join(name.upper() for name in shipped_names())
    missing = f"check the path, or name a lens that ships: {known}"
    return lens_of(read_toml(place, origin, missing, refusal=LensError), origin, place.parent)


@cache
def shipped_names() -> tuple[str, ...]:
    """Names of the lenses that ship, in lower case."""
    folder = files(__package__).joinpath("shipped")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def _loads_lens(text: str, origin: str = "") -> Prescription:
    """Read a lens from TOML text; `origin` is what errors call it."""
    return lens_of(parse_toml(text, origin, refusal=LensError), origin)


def lens_of(data: Mapping[str, Any], origin: str = "", folder: Path | None = None) -> Prescription:
    """A lens from the nested values of a lens file.

    `origin` is what errors call it, `folder` where glass files that it names are looked for; None: it may name none.
    """
    problems: list[Problem] = []
    top = _Table(data, "", TOP, problems)
    own: dict[str, Glass] = {}
    for name, table in _Table(data.get("glasses", {}), "glasses", None, problems).table.items():
        glass, wrong = _own_glass(name, _Table(table, f"glasses.{name}", None, problems).table, folder)
        problems += [Problem(f"glasses.{name}.{problem.key}", problem.message) for problem in wrong]
        if glass is not None:
            own[name.upper()] = glass
    rows = data.get("surfaces", [])
    if not isinstance(rows, list):
        top.fault("surfaces", "must be a list of tables; write [[surfaces]] once for each surface")
        rows = []
    places = [_Table(row, f"surfaces.{n}", SURFACE, problems) for n, row in enumerate(rows, start=1)]
    surfaces = [_surface(place, own, folder) for place in places]
    wavelength = top.length("wavelength") if "wavelength" in data else None
    texts = {key: data.get(key, "") for key in ("name", "source")}
    problems += [Problem(k, f"must be text, got {v!r}") for k, v in texts.items() if not isinstance(v, str)]
    warmth = top.quantity("temperature", data["temperature"], "temperature") if "temperature" in data else ROOM
    whole = tuple(surface for surface in surfaces if surface is not None)
    if warmth != ROOM:
        whole = tuple(replace(surface, glass=surface.glass.at(warmth)) for surface in whole)
    if len(whole) == len(rows):
        problems += faults(whole)
    if not problems:
        try:
            return Prescription(whole, texts["name"], texts["source"], wavelength, warmth)
        except LensError as error:
            problems += error.problems
    raise LensError(tuple(problems), origin)


def _own_glass(name: str, table: Mapping[str, Any], folder: Path | None) -> tuple[Glass | None, tuple[Problem, ...]]:
    """A glass by its numbers, or out of a catalogue's file."""
    if not table.keys() & {"file", "index"}:
        return read_glass(name, table)
    try:
        return glass_of_table(table, folder, name), ()
    except InputError as error:
        return None, _of_file(error, "file")


def _of_file(error: InputError, key: str) -> tuple[Problem, ...]:
    """Faults of a glass, each with the file that it came out of, if any."""
    origin = f"{error.origin}: " if error.origin else ""
    return tuple(Problem(problem.key or key, f"{origin}{problem.message}") for problem in error.problems)


class _Table:
    """A table that is being read: values by key, and what is wrong with them added to the list of all faults."""

    def __init__(self, table: Any, place: str, known: Sequence[str] | None, problems: list[Problem]) -> None:
        self.place, self.problems, self.before = place, problems, len(problems)
        self.table: Mapping[str, Any] = table if isinstance(table, Mapping) else {}
        if self.table is not table:
            problems.append(Problem(place, f"must be a table of keys, got {table!r}"))
        for key in self.table if known is not None else ():
            if key not in (known or ()):
                self.fault(key, f"is not a known key; {nearest(key, known or ())}")

    def fault(self, key: str, message: str) -> float:
        """Tell a fault; nan, as the number that is not to be had."""
        self.problems.append(Problem(f"{self.place}.{key}".strip("."), message))
        return math.nan

    def quantity(self, key: str, value: Any, dimension: str = "length") -> float:
        """A quantity with its unit [mm or rad]."""
        try:
            return read_quantity(value, dimension)
        except ValueError as error:
            return self.fault(key, str(error))

    def length(self, key: str) -> float:
        """A length that must be there [mm]."""
        if key not in self.table:
            return self.fault(key, f'is missing; add it, e.g. {key} = "50.8 mm"')
        return self.quantity(key, self.table[key])

    def number(self, key: str) -> float:
        """A number without a unit, 0 where left out."""
        value = self.table.get(key, 0.0)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            return self.fault(key, f"must be a finite number without a unit, got {value!r}")
        return float(value)

    def inverse_length(self, key: str, power: int) -> float:
        """A number of mm^power, 0 where left out."""
        text, unit = self.table.get(key, f"0 mm^{power}"), f"mm^{power}"
        match = _POWER.fullmatch(text) if isinstance(text, str) else None
        if match is None or int(match[2]) != power:
            return self.fault(key, f'expected a number of {unit} such as "1.2e-5 {unit}", got {text!r}')
        return float(match[1])

    def several(self, key: str, count: int, dimension: str) -> list[float]:
        """So many quantities, zeros where left out."""
        values = self.table.get(key)
        if values is not None and (not isinstance(values, list) or len(values) != count):
            self.fault(key, f"must be a list of {count} {dimension}s, got {values!r}")
            values = None
        return [0.0] * count if values is None else [self.quantity(key, value, dimension) for value in values]


def _surface(row: _Table, own: Mapping[str, Glass], folder: Path | None) -> Surface | None:
    values = row.table
    curvature = _curvature(row)
    thickness = row.length("thickness") if "thickness" in values else 0.0
    diameter = row.length("diameter")
    if diameter <= 0:
        row.fault("diameter", f'"{values["diameter"]}" must be greater than zero')
    conic, offset = row.number("conic"), row.number("index_offset")
    if abs(offset) >= 1:
        row.fault("index_offset", f"{offset:g} is no melt's departure from the catalogue; write one such as 0.0005")
    terms = _Table(values.get("asphere", {}), f"{row.place}.asphere", POWERS, row.problems)
    asphere = [terms.inverse_length(key, 1 - 2 * i) for i, key in enumerate(POWERS, start=1)]
    while asphere and asphere[-1] == 0:
        asphere.pop()
    x, y, z = row.several("shift", 3, "length")
    alpha, beta = row.several("tilt", 2, "angle")
    form = tuple(row.several("irregularity", MODES, "length")) if "irregularity" in values else ()
    given, glass = values.get("glass", "air"), AIR
    if isinstance(given, Mapping) and "formula" in given:
        row.fault("glass", "a glass by its formula stands in [glasses], and its name here")
    elif not isinstance(given, (str, Mapping)):
        row.fault("glass", f"must be a glass's name or a table such as {{index = 1.5, abbe = 60}}, got {given!r}")
    else:
        try:
            glass = find_glass(given, own) if isinstance(given, str) else glass_of_table(given, folder)
            glass = glass.with_offset(offset)
        except InputError as error:
            for problem in _of_file(error, ""):
                row.fault(f"glass.{problem.key}" if problem.key != "glass" else "glass", problem.message)
    if len(row.problems) > row.before:
        return None
    return Surface(curvature, diameter / 2, thickness, glass, conic, tuple(asphere), (x, y, z), (alpha, beta), form)


def _curvature(row: _Table) -> float:
    values = row.table
    if "radius" in values and "curvature" in values:
        return row.fault("radius", "radius and curvature: both are given; drop one")
    if "curvature" in values:
        return row.inverse_length("curvature", -1)
    if "radius" not in values:
        return row.fault("radius", 'is missing; add e.g. radius = "51.5 mm", or "inf"')
    text = values["radius"]
    if isinstance(text, str) and text.strip().lower().removesuffix("mm").strip() in ("inf", "+inf", "-inf", "infinity"):
        return 0.0
    radius = row.length("radius")
    return row.fault("radius", '"0 mm" is a point; write "inf" for a plane') if radius == 0 else 1 / radius


def dumps_lens(lens: Prescription) -> str:
    """Write a lens as TOML text that `_loads_lens` turns into an equal lens."""
    import tomli_w

    return tomli_w.dumps(table_of(lens))


def table_of(lens: Prescription) -> dict[str, Any]:
    """The nested values of a lens file that `lens_of` turns into an equal lens."""
    data: dict[str, Any] = {key: text for key in ("name", "source") if (text := getattr(lens, key))}
    if lens.wavelength is not None:
        data["wavelength"] = format_quantity(lens.wavelength, "length")
    if lens.temperature != ROOM:
        data["temperature"] = format_quantity(lens.temperature, "temperature")
    data["surfaces"] = [_row(surface) for surface in lens.surfaces]
    glasses = (surface.glass for surface in lens.surfaces)
    strange = (glass for glass in glasses if not is_shipped(glass) and not numbers_of(glass))
    own = {glass.name: replace(glass, offset=0.0, temperature=ROOM) for glass in strange}
    if own:
        data["glasses"] = {name: glass_table(glass) for name, glass in own.items()}
    return data


def _row(surface: Surface) -> dict[str, Any]:
    terms = {f"r{2 * i}": f"{a!r} mm^{1 - 2 * i}" for i, a in enumerate(surface.asphere, start=1) if a}
    row = {
        "thickness": format_quantity(surface.thickness, "length") if surface.thickness else None,
        "glass": numbers_of(surface.glass) or surface.glass.name if surface.glass != AIR else None,
        "index_offset": surface.glass.offset,
        "diameter": format_quantity(2 * surface.semi_diameter, "length"),
        "conic": surface.conic,
        "asphere": terms,
        "shift": [format_quantity(value, "length") for value in surface.shift] if any(surface.shift) else None,
        "tilt": [format_quantity(value, "angle") for value in surface.tilt] if any(surface.tilt) else None,
        "irregularity": [format_quantity(value, "length") for value in surface.irregularity],
    }
    return _radius_text(surface.curvature) | {key: value for key, value in row.items() if value}


def _radius_text(curvature: float) -> dict[str, Any]:
    """The shortest radius whose reciprocal is this very curvature, else the curvature itself."""
    if curvature == 0:
        return {"radius": "inf"}
    for digits in range(1, 18):
        radius = float(f"{1 / curvature:.{digits}g}")
        if abs(radius) <= FARTHEST["length"] and 1 / radius == curvature:
            return {"radius": format_quantity(radius, "length")}
    return {"curvature": f"{Decimal(repr(curvature))} mm^-1"}


def numbers_of(glass: Glass) -> dict[str, float]:
    """Index and Abbe number of a glass that was given by them; empty of one with a name of its own."""
    if glass.formula not in ("constant", "abbe") or not glass.name.startswith("n ="):
        return {}
    return dict(zip(COEFFICIENTS[glass.formula], glass.coefficients, strict=True))


def glass_table(glass: Glass) -> dict[str, Any]:
    """The nested values that `read_glass` turns into an equal glass, but for its name and offset."""
    table: dict[str, Any] = {"formula": glass.formula}
    if glass.formula == "sellmeier":
        table |= {"b": list(glass.coefficients[::2]), "c": list(glass.coefficients[1::2])}
    elif glass.formula == "schott":
        table["a"] = list(glass.coefficients)
    else:
        table |= dict(zip(COEFFICIENTS[glass.formula], glass.coefficients, strict=True))
    if glass.against != "air":
        table["against"] = glass.against
    if math.isfinite(glass.longest):
        table["range"] = [format_quantity(glass.shortest, "length"), format_quantity(glass.longest, "length")]
    if glass.source:
        table["source"] = glass.source
    return table | _warming_table(glass.warming)


def _warming_table(warming: Warming) -> dict[str, Any]:
    laws: dict[str, Any] = {"water": "water"}
    if warming.law == "schott":
        *terms, resonance = warming.coefficients
        laws["schott"] = {"d": terms[:3], "e": terms[3:], "lambda_tk": resonance}
    elif warming.law == "rate":
        laws["rate"] = {"rate": warming.coefficients[0], "against": warming.against}
    entries = {"cte": warming.expansion, "dndt": laws.get(warming.law), "warming_source": warming.source}
    return {key: value for key, value in entries.items() if value}


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


def _parse_zmx(text: str, origin: str = "") -> Prescription:
    """Read the lens in the text of a .zmx file; `origin` is what errors call it."""
    problems: list[Problem] = []
    rows: list[_Row] = []
    head: dict[str, str] = {}
    waves: dict[int, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
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


def _zmx_surface(row: _Row, thickness: float, scale: float) -> Surface:
    top = max((term for term, value in row.terms.items() if value), default=0)
    asphere = tuple(row.terms.get(term, 0.0) * scale ** (1 - 2 * term) for term in range(1, top + 1))
    semi = (row.aperture or row.semi_diameter) * scale
    return Surface((row.curvature or 0.0) / scale, semi, thickness * scale, row.glass, row.conic, asphere)
