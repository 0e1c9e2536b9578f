"""The catalogue: parts that can be bought, as data files with their provenance, and the reader's confidence in them."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import pairwise, product
from operator import attrgetter, eq, ge, gt, le, lt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np
from pydantic import Field, StrictBool, ValidationError, model_validator

from ..bore.main_lens import MainLensKind, main_lens_kind
from ..bore.real_lens import Lens, focal_length_at
from ..design.environment import Environment
from ..design.parts import Colours
from ..errors import InputError, Problem, refusal
from ..lenses.glass import catalogue as glass_catalogue
from ..lenses.glass import find_glass
from ..lenses.manufacture import D_LINE
from ..lenses.material import Material
from ..lenses.prescription import LensError, Prescription
from ..theory.colours import PIXEL_FILTERS
from ..toml_files import Instance, StrictTable, nearest, problems_of, read_toml
from ..units import Angle, Length, read_quantity
from ..words import length
from .lens_variables import with_glasses

if TYPE_CHECKING:
    from ..bore.elements import AnyElement
    from ..design import Design

Kind = Literal["lenses", "microlens_arrays", "sensors", "windows"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Choice = Literal[Kind, "orientations", "glasses"]
"""Kind of choice in a study: parts, and of a real main lens its orientation and its glasses."""

Confidence = Literal["measured", "datasheet", "secondary", "unverified", "typical"]
"""measured: by whom the provenance says; datasheet: read in the maker's own; secondary: read where others quote the
maker; unverified: stated without a source at hand; typical: a size that many makers list, not one part."""

Gives = Mapping[str, Callable[[Any], Any]]
"""Place of a design to what a part has there."""

LENS_PRESCRIPTION, LENS_REVERSED = "main_lens.prescription", "main_lens.reversed"
ALIKE = 0.05
"""Relative difference up to which a prescription's focal length is that of its catalogue line."""

SAME = 0.01
"""Relative difference up to which a length of a part counts as the design's."""
WIDER = 2.0
"""Clear aperture, over the design's, up to which a window still stands for one that is narrower."""
ANOTHER = math.log(1.2)
"""Penalty for another material, as logarithm of a ratio."""

ELEMENT = "element."
"""Prefix of places in the element that a part is chosen for."""

SHIPPED = Path(__file__).with_name("catalogue")


class Option(StrictTable):
    """Option of several to choose from."""

    gives: ClassVar[Gives] = {}
    part: Annotated[str, Field(min_length=1)]
    """Name or number; unique among its kind."""

    @property
    def numbers(self) -> dict[str, Any]:
        """Place of a design to what this gives there [mm]; words for a layout and a shape."""
        return {place: read(self) for place, read in self.gives.items()}

    @property
    def declared(self) -> dict[str, Any]:
        """Place of a design to what is known of this one, beside numbers that all of its kind have."""
        return {}

    @property
    def is_cut(self) -> bool:
        """Whether it may be cut to the size that a sensor needs."""
        return False

    def fits(self, lens: MainLensKind) -> bool:
        """Whether it can be chosen for a camera with such a main lens."""
        return True

    def behind(self, lens: MainLensKind, wavelength: float, environment: Environment | None) -> dict[str, Any]:
        """Numbers that this gives a camera with such a main lens."""
        return self.numbers


class _Unlike(NamedTuple):
    """Differences of a part from what a design asks for."""

    lengths: tuple[tuple[str, float, float], ...]
    """Name, the part's, the design's [mm]."""
    lacks: tuple[str, ...] = ()
    short: float = 0.0
    """Size of what it lacks, as logarithm of a ratio."""
    beyond: str = ""
    """Words on what it has beyond what is asked for, which does not count."""

    @property
    def words(self) -> list[str]:
        """Words on what is not the same; empty of a part that serves as it is."""
        apart = [f"{name} {length(have)}" for name, have, wanted in self.lengths if abs(have / wanted - 1) > SAME]
        return [*apart, *self.lacks]

    @property
    def size(self) -> float:
        """Sum of logarithms of ratios."""
        return self.short + sum(abs(math.log(have / wanted)) for _, have, wanted in self.lengths)


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

    def unlike(self, design: Design, element: AnyElement | None = None) -> _Unlike:
        """Differences from the part that a design has; of a window, from the element that it stands for."""
        raise NotImplementedError

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
            raise ValueError("clear_aperture is larger than the diameter; swap them")
        return self


class _LensPart(_Round):
    """A main lens."""

    gives: ClassVar[Gives] = {
        "main_lens.diameter": attrgetter("aperture"),
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

    def behind(self, lens: MainLensKind, wavelength: float, environment: Environment | None) -> dict[str, Any]:
        """Numbers and, where the camera's main lens has them, surfaces and their own focal length."""
        warmth = () if environment is None else (environment.temperature, environment.expansion)
        return self.numbers | lens.replacement(self.kind, wavelength, *warmth)

    def unlike(self, design: Design, element: AnyElement | None = None) -> _Unlike:
        """Differences in focal length and clear aperture."""
        aperture = "clear aperture", self.aperture, design.D
        return _Unlike((("focal length", self.focal_length, design.f), aperture))

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

    pitch: Length
    focal_length: Length
    """Nominal [mm]."""
    effective_focal_length: Length | None = None
    """As measured in use, where that differs from the nominal one; taken instead of it."""
    size: tuple[Length, Length]
    layout: Literal["square", "hexagonal"] = "square"
    lens_shape: Literal["square", "circular"] = "square"
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

    def unlike(self, design: Design, element: AnyElement | None = None) -> _Unlike:
        """Differences in pitch, focal length and shape, and whether it is too small for array or sensor."""
        mla, lacks = design.microlens_array, []
        if (self.layout, self.lens_shape) != (mla.layout, mla.lens_shape):
            lacks.append(f"{self.layout}, {self.lens_shape} lenses")
        needed = [min(pair) for pair in zip(mla.size, design.sensor_size, strict=True)]
        if any(have < need * (1 - SAME) for have, need in zip(self.size, needed, strict=True)):
            lacks.append(f"only {' x '.join(map(length, self.size))}")
        lengths = ("pitch", self.pitch, mla.pitch), ("focal length", self.focal, design.f_ml)
        larger = any(have > side * (1 + SAME) for have, side in zip(self.size, mla.size, strict=True))
        return _Unlike(lengths, tuple(lacks), beyond="cut to size" if larger and self.cut else "")


class _SensorPart(Entry):
    """An image sensor."""

    gives: ClassVar[Gives] = {
        "sensor.pixel": attrgetter("pixel"),
        "sensor.size.0": lambda sensor: sensor.size[0],
        "sensor.size.1": lambda sensor: sensor.size[1],
    }

    pixel: Length
    pixels: tuple[int, int]
    acceptance: Angle | None = None
    """Angle at which a pixel takes half of the light [rad]; None where nothing is known."""
    colours: Colours | None = None
    """Filters on its pixels; None where it is sold with and without."""

    @property
    def declared(self) -> dict[str, Any]:
        """Acceptance and colours."""
        keys = {"sensor.acceptance": self.acceptance, "sensor.colours": self.colours}
        return {place: value for place, value in keys.items() if value is not None}

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the pixel field [mm]."""
        return self.pixels[0] * self.pixel, self.pixels[1] * self.pixel

    @property
    def area(self) -> float:
        """Area [mm^2]."""
        return math.prod(self.size)

    def unlike(self, design: Design, element: AnyElement | None = None) -> _Unlike:
        """Differences in pixel and filters, and pixels that it lacks: a larger one, read out in part, is the same."""
        lacks = []
        short = sum(max(0.0, math.log(need / have)) for have, need in zip(self.pixels, design.pixels, strict=True))
        if short:
            lacks.append(f"only {self.pixels[0]} x {self.pixels[1]} px")
        if self.colours is not None and self.colours != design.sensor.colours:
            lacks.append(PIXEL_FILTERS[self.colours].words)
        (across, up), (wide, high) = design.pixels, self.pixels
        read = f"{across} x {up} of its {wide} x {high} px read" if (wide, high) != (across, up) else ""
        return _Unlike((("pixel", self.pixel, design.sensor.pixel),), tuple(lacks), short, read)

    @property
    def row(self) -> dict[str, Any]:
        """Plain values, its size among them."""
        return super().row | {"size": list(self.size)}

    @model_validator(mode="after")
    def _some(self) -> _SensorPart:
        if min(self.pixels) < 1:
            raise ValueError(f"pixels {self.pixels} must be positive")
        return self


class _WindowPart(_Round):
    """A plane-parallel window."""

    gives: ClassVar[Gives] = {
        f"{ELEMENT}diameter": attrgetter("aperture"),
        f"{ELEMENT}thickness": attrgetter("thickness"),
        f"{ELEMENT}material": attrgetter("material"),
    }

    thickness: Length
    material: Material

    def unlike(self, design: Design, element: AnyElement | None = None) -> _Unlike:
        """Differences in thickness, clear aperture and material; one that is somewhat wider is the same."""
        assert element is not None
        lacks, wider = [], 1.0 if element.diameter is None else self.aperture / element.diameter
        apart = abs(math.log(wider)) * (1 if wider > 1 else 2)  # which cuts light
        if not 1 - SAME <= wider <= WIDER:
            lacks.append(f"clear aperture {length(self.aperture)}")
        if element.glass is None or self.material.name != element.glass.name:
            lacks.append(f"of {self.material.name}")
            apart += ANOTHER
        beyond = f"{length(self.diameter)} wide" if wider > 1 + SAME else ""
        if design.tube is not None and self.diameter > (room := design.tube.room) * (1 + SAME):
            lacks.append(f"{length(self.diameter)} wide in a tube of {length(room)} inside")
            apart += 2 * math.log(self.diameter / room)
        return _Unlike((("thickness", self.thickness, element.length),), tuple(lacks), apart, beyond)


class _Orientation(Option):
    """_Orientation of a real main lens."""

    gives: ClassVar[Gives] = {LENS_REVERSED: attrgetter("turned")}
    turned: bool


ORIENTATIONS = _Orientation(part="as catalogued", turned=False), _Orientation(part="reversed", turned=True)


class _GlassChoice(Option):
    """A custom singlet or cemented doublet of other glasses; its focal length and shape factor are as before."""

    gives: ClassVar[Gives] = {LENS_PRESCRIPTION: attrgetter("lens")}
    lens: Annotated[Prescription, Instance]


def _optical_solids(wavelength: float) -> tuple[str, ...]:
    """Names of the glasses, crystals and plastics that ship and whose index is known at a wavelength [mm]."""
    every = {glass.name: glass for glass in glass_catalogue().values() if glass.warming.expansion > 0}
    return tuple(name for name, glass in every.items() if glass.shortest <= wavelength <= glass.longest)


def glass_choices(lens: Prescription, names: Iterable[str], wavelength: float) -> tuple[_GlassChoice, ...]:
    """A lens of every ordered set of glasses, cemented ones different; those that cannot be made are left out.

    Raises
    ------
    InputError
        A glass that is not known.
    """
    chosen = [find_glass(name) for name in names or _optical_solids(wavelength)]
    made = []
    for glasses in product(chosen, repeat=len(lens.surfaces) - 1):
        if all(one != other for one, other in pairwise(glasses)):
            with suppress(LensError):
                lens_of_them = with_glasses(lens, glasses, wavelength)
                made.append(_GlassChoice(part=" + ".join(glass.name for glass in glasses), lens=lens_of_them))
    return tuple(made)


MODELS: Mapping[Kind, type[Entry]] = {
    "lenses": _LensPart,
    "microlens_arrays": _ArrayPart,
    "sensors": _SensorPart,
    "windows": _WindowPart,
}


def given_by(kinds: Iterable[Choice], element: int | None) -> frozenset[str]:
    """Places of a design that parts of some kinds give together, windows to one of its elements."""
    return frozenset(placed(place, element) for kind in kinds if kind in KINDS for place in MODELS[kind].gives)


def placed(place: str, element: int | None) -> str:
    """A place that a part gives, of the element that it is chosen for."""
    return place.replace(ELEMENT, f"elements.{element}.") if place.startswith(ELEMENT) else place


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


COMPARE: Mapping[str, Callable[[Any, Any], Any]] = {"=": eq, "<": lt, "<=": le, ">": gt, ">=": ge}
LENGTHS = frozenset(
    ("diameter", "clear_aperture", "thickness", "focal_length", "effective_focal_length", "pitch", "pixel", "size")
)
MEANT = {
    **dict.fromkeys(("width", "height", "side", "format"), "size"),
    **dict.fromkeys(("name", "model", "number"), "part"),
    **dict.fromkeys(("vendor", "manufacturer", "brand"), "maker"),
    **dict.fromkeys(("pixel_size", "pixel_pitch"), "pixel"),
    **dict.fromkeys(("resolution", "megapixels"), "pixels"),
    **dict.fromkeys(("f", "efl"), "focal_length"),
    **dict.fromkeys(("glass", "substance"), "material"),
    "d": "diameter",
    "aperture": "clear_aperture",
}
"""Names that people give to keys, and the keys."""
CLOSE = 0.7
"""Likeness from which on a key is taken for one misspelt."""
NEAR = 1e-9
"""Relative difference at which lengths count as equal."""


def read_condition(text: str) -> Callable[[Mapping[str, Any]], bool]:
    """Whether a part (of `rows`) meets a condition as typed: "focal_length<=100 mm", "maker=Thorlabs".

    A part without the key does not; of several numbers (a size) all must. Lengths that differ by rounding are equal.

    Raises
    ------
    InputError
        Unknown key, no comparison, a length without a unit.
    """
    try:
        key, sign, value = parse_condition(text)
    except ValueError as error:
        raise refusal("where", str(error)) from None

    def holds(row: Mapping[str, Any]) -> bool:
        own = row.get(key)
        if own is None:
            return False
        if isinstance(value, str):
            return value.lower() in str(own).lower()
        over = np.ravel(own) - value
        return bool(COMPARE[sign](np.where(np.abs(over) <= NEAR * abs(value), 0, over), 0).all())

    return holds


def _instead(key: str, known: Collection[str]) -> str:
    """Remedy for a key that is none: the one that means the same, one spelt much alike, or the keys of each kind."""
    if (meant := MEANT.get(key.lower())) is not None:
        return f"write {meant}"
    own = ({"kind": None} | Entry.model_fields).keys()
    each = {"all parts": own} | {k: [n for n in m.model_fields if n not in own] for k, m in MODELS.items()}
    listed = "; ".join(f"{kind.replace('_', ' ')} have {', '.join(names)}" for kind, names in each.items())
    return nearest(key, known, listed, least=CLOSE)


def parse_condition(text: str) -> tuple[str, str, float | str]:
    """Key, comparison and value of a condition as typed.

    Raises
    ------
    ValueError
        As `read_condition` tells it.
    """
    known = sorted({"kind", *(name for model in MODELS.values() for name in model.model_fields)})
    match = re.fullmatch(r"\s*(\w+)\s*(<=|>=|<|>|=)\s*(.+?)\s*", text)
    if match is None:
        raise ValueError(f'cannot read "{text}"; write e.g. "focal_length<=100 mm" or "maker=Thorlabs"')
    key, sign, value = match.groups()
    if key not in known:
        raise ValueError(f"'{key}' is no key of a part; {_instead(key, known)}")
    if key in LENGTHS or key == "acceptance":
        return key, sign, read_quantity(value, "length" if key in LENGTHS else "angle")
    if key == "pixels":
        try:
            return key, sign, float(value)
        except ValueError:
            raise ValueError(f'"{value}" is no number of pixels; write e.g. "pixels>=400"') from None
    if sign != "=":
        raise ValueError(f"'{key}' holds words, which {sign} does not compare; write {key}={value}")
    return key, sign, value
