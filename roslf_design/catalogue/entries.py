"""Parts that can be bought, as data files with their provenance, and the reader's confidence in them.

A part says which keys of a design it gives, so that a design may name it: `part = "IMX250"`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import Field, StrictBool, ValidationError, model_validator

from ..bore.main_lens import MainLensKind, main_lens_kind
from ..bore.part import Colours, Layout
from ..bore.real_lens import Lens, focal_length_at
from ..errors import InputError, Problem
from ..lenses.manufacture import D_LINE
from ..lenses.material import Material
from ..toml_files import StrictTable, nearest, problems_of, read_toml, validated
from ..units import Angle, Length, format_quantity, parse_quantity
from ..words import length

Kind = Literal["lenses", "microlens_arrays", "sensors", "windows"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Confidence = Literal["measured", "datasheet", "secondary", "unverified", "typical"]
"""measured: by whom the provenance says; datasheet: read in the maker's own, of a sensor also in that of a camera with
it; secondary: read where others quote the maker, or in part; unverified: stated without a source at hand; typical: a
size that many makers list, not one part."""
ELECTRONS = ("full_well", "read_noise")
"""Keys of a sensor's numbers of electrons."""

Gives = Mapping[str, Callable[[Any], Any]]
"""Place of a design to what a part has there."""

LENS_PRESCRIPTION = "main_lens.prescription"
ALIKE = 0.05
"""Relative difference up to which a prescription's focal length is that of its catalogue line."""

EDGE = "outer_diameter"
"""Key of the diameter of a whole part, which a tube must hold."""
ELEMENT = "element."
"""Prefix of places in the element that a part is chosen for."""

SHIPPED = Path(__file__).parent


class Option(StrictTable):
    """Option of several to choose from."""

    gives: ClassVar[Gives] = {}
    declares: ClassVar[Gives] = {}
    """Place of a design to what some of its kind have there."""
    part: Annotated[str, Field(min_length=1)]
    """Name or number; unique among its kind."""

    @property
    def numbers(self) -> dict[str, Any]:
        """Place of a design to what this gives there [mm]; words for a layout and a shape."""
        return {place: read(self) for place, read in self.gives.items()}

    @property
    def declared(self) -> dict[str, Any]:
        """Place of a design to what is known of this one, beside numbers that all of its kind have."""
        return {place: value for place, read in self.declares.items() if (value := read(self)) is not None}

    @property
    def is_cut(self) -> bool:
        """Whether it may be cut to the size that a sensor needs."""
        return False

    def fits(self, lens: MainLensKind) -> bool:
        """Whether it can be chosen for a camera with such a main lens."""
        return True

    def behind(self, lens: MainLensKind, wavelength: float, *warmth: float) -> dict[str, Any]:
        """Numbers that this gives a camera with such a main lens; `warmth` as `MainLensKind.replacement` takes it."""
        return self.numbers


class Entry(Option):
    """Fields common to all parts of the catalogue."""

    maker: str = ""
    provenance: str
    """Source of the figures."""
    page: str = ""
    """Address of the page or data sheet that they were read on."""
    read: Annotated[str, Field(pattern=r"^(\d{4}-\d\d-\d\d)?$")] = ""
    """Day on which they were read, as "2026-11-28"."""
    confidence: Confidence
    remark: str = ""

    @property
    def area(self) -> float:
        """Area of a sensor or an array [mm^2]; 0 of other parts."""
        return 0.0

    @property
    def unstated(self) -> tuple[str, ...]:
        """Things that a design may say of such a part, and nobody says of this one."""
        return ()

    @property
    def name(self) -> str:
        """Maker and part."""
        return f"{self.maker} {self.part}".strip()

    @property
    def table(self) -> dict[str, Any]:
        """Keys that it gives its table of a design file, with their units."""
        table: dict[str, Any] = {}
        for place, value in (self.numbers | self.declared).items():
            key, _, axis = place.partition(".")[2].partition(".")
            dimension = "angle" if key == "acceptance" else "length"
            is_plain = key in ELECTRONS or not isinstance(value, float)
            text = value if is_plain else format_quantity(value, dimension)
            table[key] = [*table.get(key, ()), text] if axis else text
        return table

    @property
    def source(self) -> str:
        """Source of the figures, where and when they were read."""
        read = " ".join(filter(None, (self.page, self.read and f"read {self.read}")))
        return f"{self.provenance}; {read}" if read else self.provenance

    @property
    def row(self) -> dict[str, Any]:
        """Plain values, lengths in mm."""
        return {key: value for key, value in self.model_dump().items() if value not in (None, "")}


class _Round(Entry):
    """A round part, held at its edge."""

    diameter: Length
    """Outer [mm]."""
    clear_aperture: Length | None = None
    """[mm]; 90 % of the diameter where not given."""

    @property
    def aperture(self) -> float:
        """Clear aperture [mm]."""
        return self.clear_aperture if self.clear_aperture is not None else 0.9 * self.diameter

    @property
    def row(self) -> dict[str, Any]:
        """Plain values; whether the clear aperture is assumed."""
        return super().row | {
            "clear_aperture": self.aperture,
            "clear_aperture_assumed": self.clear_aperture is None,
        }

    @model_validator(mode="after")
    def _inside(self) -> Self:
        if self.clear_aperture is not None and self.clear_aperture > self.diameter:
            clear, outer = length(self.clear_aperture), length(self.diameter)
            raise ValueError(f"clear_aperture {clear} is larger than the diameter {outer}; mend one of them")
        return self


class _LensPart(_Round):
    """A main lens."""

    gives: ClassVar[Gives] = {
        "main_lens.diameter": attrgetter("aperture"),
        f"main_lens.{EDGE}": attrgetter("diameter"),
        "main_lens.focal_length": attrgetter("focal_length"),
    }

    type: str = ""
    focal_length: Length
    prescription: Lens = None
    """Its surfaces: the name of a lens that ships, a lens file beside the catalogue's, or a table. Behind a real main
    lens only parts that have them are chosen."""

    @property
    def kind(self) -> MainLensKind:
        """Main lens that it makes."""
        return main_lens_kind(self.prescription, turned=False)

    @property
    def row(self) -> dict[str, Any]:
        """Plain values; the name of its prescription."""
        row = super().row
        for lens in self.kind.prescribed:
            row["prescription"] = lens.name
        return row

    def fits(self, lens: MainLensKind) -> bool:
        """Whether its surfaces are known, where the camera's are."""
        return lens.replaced_by(self.kind)

    def behind(self, lens: MainLensKind, wavelength: float, *warmth: float) -> dict[str, Any]:
        """Numbers and, where the camera's main lens has them, surfaces and their own focal length."""
        return self.numbers | lens.replacement(self.kind, wavelength, *warmth)

    @property
    def table(self) -> dict[str, Any]:
        """Its surfaces, where they are known, in place of the focal length that they have."""
        table = super().table
        for lens in self.kind.prescribed:
            table = {"prescription": lens, "diameter": table["diameter"]}
        return table

    @model_validator(mode="after")
    def _same(self) -> Self:
        if self.prescription is not None:
            focal = focal_length_at(self.prescription, self.prescription.wavelength or D_LINE)
            if not abs(focal / self.focal_length - 1) <= ALIKE:
                raise ValueError(
                    f"focal_length is {self.focal_length:g} mm, and its prescription's {focal:.5g} mm; mend one of them"
                )
        return self


class _ArrayPart(Entry):
    """A microlens array."""

    gives: ClassVar[Gives] = {
        "microlens_array.pitch": attrgetter("pitch"),
        "microlens_array.focal_length": attrgetter("focal"),
        "microlens_array.size.0": lambda array: array.size[0],
        "microlens_array.size.1": lambda array: array.size[1],
        "microlens_array.layout": attrgetter("layout"),
        "microlens_array.lens_shape": attrgetter("lens_shape"),
    }
    declares: ClassVar[Gives] = {"microlens_array.material": attrgetter("material")}

    pitch: Length
    focal_length: Length
    """Nominal [mm]."""
    effective_focal_length: Length | None = None
    """As measured in use, where that differs from the nominal one; taken instead of it."""
    size: tuple[Length, Length]
    layout: Layout = "square"
    lens_shape: Literal["square", "circular"] = "square"
    material: Material | None = None
    """Material of the microlenses, by which focal length and pitch go with temperature."""
    cut: StrictBool = True
    """Whether it may be cut to the size that a sensor needs."""

    @property
    def focal(self) -> float:
        """f_ml [mm]: the effective one where it is known."""
        return self.effective_focal_length if self.effective_focal_length is not None else self.focal_length

    @property
    def is_cut(self) -> bool:
        """Whether it may be cut."""
        return self.cut

    @property
    def area(self) -> float:
        """Area [mm^2]."""
        return math.prod(self.size)


class _SensorPart(Entry):
    """An image sensor."""

    gives: ClassVar[Gives] = {
        "sensor.pixel": attrgetter("pixel"),
        "sensor.size.0": lambda sensor: sensor.size[0],
        "sensor.size.1": lambda sensor: sensor.size[1],
    }
    declares: ClassVar[Gives] = {
        "sensor.acceptance": attrgetter("acceptance"),
        "sensor.colours": attrgetter("colours"),
        **{f"sensor.{key}": attrgetter(key) for key in ELECTRONS},
    }

    pixel: Length
    pixels: tuple[int, int]
    acceptance: Angle | None = None
    """Angle at which a pixel takes half of the light [rad]; None where nothing is known."""
    full_well: Annotated[float, Field(gt=0)] | None = None
    """Electrons that a pixel holds; None where nothing is known."""
    read_noise: Annotated[float, Field(ge=0)] | None = None
    """Rms [electrons]; None where nothing is known."""
    colours: Colours | None = None
    """Filters on its pixels; None where it is sold with and without, or nothing is known."""
    mono_too: StrictBool = False
    """Whether it is sold with filters and without."""
    package: tuple[Length, Length] | None = None
    """Width and height of its package [mm]; None where nothing is known."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the pixel field [mm]."""
        return self.pixels[0] * self.pixel, self.pixels[1] * self.pixel

    @property
    def area(self) -> float:
        """Area [mm^2]."""
        return math.prod(self.size)

    @property
    def unstated(self) -> tuple[str, ...]:
        """Its filters, full well or package; of none the glass that covers it."""
        known = {"colour filters": self.colours or self.mono_too, "full well": self.full_well, "package": self.package}
        return (*(name for name, said in known.items() if not said), "cover glass")

    @property
    def filters(self) -> str:
        """Filters on its pixels, in words."""
        return self.colours or ("with and without" if self.mono_too else "not stated")

    @property
    def table(self) -> dict[str, Any]:
        """Keys that it gives its table, with those of its package where that is known."""
        sides = [format_quantity(side, "length") for side in self.package or ()]
        return super().table | ({"package": sides} if sides else {})

    @property
    def row(self) -> dict[str, Any]:
        """Plain values, its size among them."""
        return super().row | {"size": list(self.size), "filters": self.filters}

    @model_validator(mode="after")
    def _some(self) -> _SensorPart:
        if min(self.pixels) < 1:
            raise ValueError(f"pixels {self.pixels} must be positive")
        return self


class _WindowPart(_Round):
    """A plane-parallel window."""

    gives: ClassVar[Gives] = {
        f"{ELEMENT}diameter": attrgetter("aperture"),
        f"{ELEMENT}{EDGE}": attrgetter("diameter"),
        f"{ELEMENT}thickness": attrgetter("thickness"),
        f"{ELEMENT}material": attrgetter("material"),
    }

    thickness: Length
    material: Material


MODELS: Mapping[Kind, type[Entry]] = {
    "lenses": _LensPart,
    "microlens_arrays": _ArrayPart,
    "sensors": _SensorPart,
    "windows": _WindowPart,
}


class Catalogue(StrictTable):
    """Parts by kind."""

    lenses: tuple[_LensPart, ...] = ()
    microlens_arrays: tuple[_ArrayPart, ...] = ()
    sensors: tuple[_SensorPart, ...] = ()
    windows: tuple[_WindowPart, ...] = ()

    def of(self, kind: Kind) -> tuple[Entry, ...]:
        """Parts of one kind."""
        parts: tuple[Entry, ...] = getattr(self, kind)
        return parts

    def __add__(self, other: Catalogue) -> Catalogue:
        return Catalogue(**{kind: (*self.of(kind), *other.of(kind)) for kind in KINDS})


def load_catalogue(paths: Iterable[str | os.PathLike[str]] = (), *, shipped: bool = True) -> Catalogue:
    """Read the shipped catalogue and further files.

    Raises
    ------
    InputError
        Names the file and every fault in it; also where two parts of a kind are called alike.
    """
    faults: list[Problem] = []
    catalogue = Catalogue()
    own = {path: path.name for path in sorted(SHIPPED.glob("*.toml"))} if shipped else {}
    for path, label in [*own.items(), *((Path(path), str(path)) for path in paths)]:
        try:
            context = {"from_file": True, "folder": path.parent}
            catalogue += Catalogue.model_validate(read_toml(path, ""), context=context)
        except (InputError, ValidationError) as error:
            problems = error.problems if isinstance(error, InputError) else problems_of(error, Catalogue)
            faults += [Problem("", f"{label}: {fault}") for fault in problems]
    for kind in KINDS:
        names = [entry.part for entry in catalogue.of(kind)]
        twice = sorted({name for name in names if names.count(name) > 1})
        faults += [Problem(kind, f"two parts are called '{name}'; rename one") for name in twice]
    if faults:
        raise InputError(tuple(faults))
    return catalogue


def rows(catalogue: Catalogue, kinds: Iterable[Kind] = KINDS) -> Iterator[dict[str, Any]]:
    """Every part as plain values, lengths in mm."""
    for kind in kinds:
        for entry in catalogue.of(kind):
            yield {"kind": kind} | entry.row


NAMED: Mapping[str, Kind] = {
    "main_lens": "lenses",
    "microlens_array": "microlens_arrays",
    "sensor": "sensors",
    "elements": "windows",
}
"""Table of a design to the kind of part that it may name."""
WITHOUT: Mapping[Kind, Collection[str]] = {
    "lenses": (EDGE,),
    "microlens_arrays": ("layout", "lens_shape"),
    "windows": ("diameter", EDGE),
}
"""Keys that a part gives its table, and that is whole without."""
CLOSE = 0.7
"""Likeness from which on a name is taken for one misspelt."""
INSTEAD = {
    **dict.fromkeys(("prescription", "sheet", "focal_lengths"), "focal_length"),
    "pixels": "size",
}
"""Keys of a design that stand for another."""


def with_named_parts(place: str, value: Any, folder: str | Path | None) -> Any:
    """A table of a design, or its elements, with what the parts give that they name; else as it is.

    Raises
    ------
    InputError
        Every part that is not known, at its place in the table.
    """
    several, faults = place == "elements", list[Problem]()
    if several and not isinstance(value, (list, tuple)):
        return value
    filled = list[Any]()
    for k, table in enumerate(value if several else [value]):
        named = isinstance(table, Mapping) and table.get("part") is not None and table.get("kind", "plate") == "plate"
        try:
            filled.append(_filled(NAMED[place], table, None if folder is None else Path(folder)) if named else table)
        except InputError as error:
            words = "; ".join(str(error).splitlines()) if error.origin else error.problems[0].message
            faults.append(Problem(f"{k}.part" if several else "part", words))
    if faults:
        raise InputError(tuple(faults))
    return filled if several else filled[0]


def _filled(kind: Kind, table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
    """A table with what the part that it names gives; its own values win; to a whole one it gives its edge alone.

    Parameters
    ----------
    kind : str
        Kind of the part.
    table : mapping
        With `part`: a name, or the `file` of a catalogue and the `name` in it.
    folder : path-like
        What the path of that file counts from; None where none may be opened.

    Raises
    ------
    InputError
        No such part, at `part`, and too few values of its own.
    """
    asked, own, whole = table["part"], {INSTEAD.get(key, key) for key in table}, _needed(kind)
    settled = isinstance(asked, str) and own >= whole
    if settled and (EDGE in own or EDGE not in WITHOUT.get(kind, ())):
        return table
    try:
        entry = _named_part(kind, asked, folder)
    except InputError:
        if isinstance(asked, str) and own >= whole - {"diameter"}:
            return table
        raise
    left = {EDGE} if settled else {*entry.table}
    given = {key: value for key, value in entry.table.items() if key in left and INSTEAD.get(key, key) not in own}
    return {**given, **table, "part": entry.part}


def left_to(kind: Kind, table: Mapping[str, Any], asked: Any) -> dict[str, Any]:
    """Values that a table keeps where another part is asked for: not what that gives, nor what the one before declares.

    Where none is called so, and the values of its own do not make the table whole, its reader tells it.
    """
    try:
        given = {INSTEAD.get(key, key) for key in _named_part(kind, asked, Path()).table}
    except InputError:
        given = _needed(kind)
    own = {key: value for key, value in table.items() if INSTEAD.get(key, key) not in given}
    for place, value in declared_by(kind, table["part"]).items():
        if own.get(_key(place)) == value:
            del own[_key(place)]
    return own


def declared_by(kind: Kind, asked: Any) -> dict[str, Any]:
    """Place of a design to what a shipped part that is called so declares; empty where none is."""
    with suppress(InputError):
        return _named_part(kind, asked, None).declared
    return {}


def stock_of(asked: Any) -> tuple[float, float] | None:
    """Size [mm] of the stock that a shipped array is cut from; None of no such, and of one that stays whole."""
    with suppress(InputError):
        array = _named_part("microlens_arrays", asked, None)
        width, height = (array.numbers[f"microlens_array.size.{axis}"] for axis in (0, 1))
        return (width, height) if array.is_cut else None
    return None


def _needed(kind: Kind) -> set[str]:
    """Keys that make a table whole, whatever part of a kind it names."""
    return {_key(place) for place in MODELS[kind].gives}.difference(WITHOUT.get(kind, ()))


def _named_part(kind: Kind, asked: Any, folder: Path | None) -> Entry:
    """The part that is called so; `asked` and `folder` as `_filled` has them.

    Raises
    ------
    InputError
        None is, or several are, at `part`; or faults of the file.
    """
    path = SHIPPED / f"{kind}.toml"
    if isinstance(asked, Mapping) and {*asked} == {"file", "name"} and all(isinstance(v, str) for v in asked.values()):
        if folder is None:
            raise _no_part("this text may open no file; write the part's values instead")
        asked, path = asked["name"], folder / asked["file"]
    elif not isinstance(asked, str):
        raise _no_part(f'must be text, or {{file = "mine.toml", name = "its part"}}, got {asked!r}')
    listed = read_toml(path, path.name).get(kind)
    tables = [one for one in listed if isinstance(one, Mapping)] if isinstance(listed, list) else []
    names = [(part := str(one.get("part")), f"{one.get('maker', '')} {part}".strip()) for one in tables]
    called, words = meant(asked, names), kind.replace("_", " ")
    if not called:
        command = f"`roslf catalogue --kind {kind}` lists them"
        where = f'one of your own is part = {{file = "mine.toml", name = "{asked}"}}'
        near = nearest(asked, [*chain(*zip(*names, strict=True))], f"{command}, and {where}", least=CLOSE)
        raise _no_part(f"'{asked}' is none of the {words} in {path.name}; {near}")
    if len(called) > 1:
        several = " and ".join(f"'{names[k][0]}'" for k in called)
        raise _no_part(f"'{asked}' names {len(called)} {words} in {path.name}: {several}; write one so, or rename one")
    return validated(MODELS[kind], tables[called[0]], path.name, folder=path.parent)


def meant(asked: str, names: Sequence[tuple[str, str]]) -> list[int]:
    """Indices of parts, each by its name and by that with its maker, called so: to the letter, else in other case.

    Else with other spaces.
    """
    for alike in (str, str.lower, lambda name: "".join(name.lower().split())):
        if called := [k for k, own in enumerate(names) if alike(asked) in map(alike, own)]:
            return called
    return []


def _key(place: str) -> str:
    """Key of a table that a place of a design is at, or in."""
    return place.split(".")[1]


def other_focal_length(part: str, f: float) -> float | None:
    """Focal length of a shipped lens [mm], where it is not about `f`; None where it is, or none is so called."""
    path = SHIPPED / "lenses.toml"
    named = next((one for one in read_toml(path, path.name)["lenses"] if one["part"] == part), None)
    own = f if named is None else parse_quantity(named["focal_length"], "length")
    return own if abs(own / f - 1) > ALIKE else None


@cache
def named_window(part: str | None) -> _WindowPart | None:
    """A shipped window; None where none is so called."""
    return next((one for one in load_catalogue().windows if one.part == part), None) if part else None


def _no_part(message: str) -> InputError:
    return InputError((Problem("part", message),))
