"""The catalogue: parts that can be bought, as data files with their provenance, and the reader's confidence in them."""

from __future__ import annotations

import difflib
import operator
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from ..design.files import read_toml
from ..design.messages import problems_of
from ..design.units import Length, parse_quantity
from ..errors import InputError, Problem

Kind = Literal["lenses", "microlens_arrays", "sensors"]
KINDS: tuple[Kind, ...] = get_args(Kind)

Confidence = Literal["measured", "datasheet", "secondary", "unverified", "typical"]
"""measured: by whom the provenance says; datasheet: read in the maker's own; secondary: read where others quote the
maker; unverified: stated without a source at hand; typical: a size that many makers list, not one part."""

SHIPPED = Path(__file__).with_name("catalogue")


class Entry(BaseModel):
    """What every part has."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    places: ClassVar[tuple[str, ...]] = ()
    """Of a design, that such a part gives."""

    part: str
    """Name or number; unique among its kind."""
    maker: str = ""
    provenance: str
    """Where the figures come from."""
    confidence: Confidence
    remark: str = ""

    @property
    def numbers(self) -> dict[str, float]:
        """Place of a design to what this part gives there [mm]."""
        return dict(zip(self.places, self._lengths(), strict=True))

    def _lengths(self) -> tuple[float, ...]:
        return ()


class LensPart(Entry):
    """A main lens."""

    places = ("main_lens.diameter", "main_lens.focal_length")

    type: str = ""
    diameter: Length
    """Outer [mm]."""
    clear_aperture: Length | None = None
    """D [mm]; 90 % of the diameter where not given."""
    focal_length: Length

    @property
    def aperture(self) -> float:
        """D [mm]."""
        return self.clear_aperture if self.clear_aperture is not None else 0.9 * self.diameter

    def _lengths(self) -> tuple[float, ...]:
        return self.aperture, self.focal_length

    @model_validator(mode="after")
    def _inside(self) -> LensPart:
        if self.clear_aperture is not None and self.clear_aperture > self.diameter:
            raise ValueError("clear_aperture is larger than the diameter; swap them")
        return self


class ArrayPart(Entry):
    """A microlens array."""

    places = (
        "microlens_array.pitch",
        "microlens_array.focal_length",
        "microlens_array.size.0",
        "microlens_array.size.1",
    )

    pitch: Length
    focal_length: Length
    """Nominal [mm]."""
    effective_focal_length: Length | None = None
    """As measured in use, where that differs from the nominal one; taken instead of it."""
    size: tuple[Length, Length]
    layout: Literal["square", "hexagonal"] = "square"
    lens_shape: Literal["square", "circular"] = "square"

    @property
    def focal(self) -> float:
        """f_ml [mm]: the effective one where it is known."""
        return self.effective_focal_length if self.effective_focal_length is not None else self.focal_length

    def _lengths(self) -> tuple[float, ...]:
        return self.pitch, self.focal, *self.size


class SensorPart(Entry):
    """An image sensor."""

    places = ("sensor.pixel", "sensor.size.0", "sensor.size.1")

    pixel: Length
    pixels: tuple[int, int]

    @property
    def size(self) -> tuple[float, float]:
        """Of the pixel field [mm]."""
        return self.pixels[0] * self.pixel, self.pixels[1] * self.pixel

    def _lengths(self) -> tuple[float, ...]:
        return self.pixel, *self.size

    @model_validator(mode="after")
    def _some(self) -> SensorPart:
        if min(self.pixels) < 1:
            raise ValueError(f"pixels {self.pixels} must be positive")
        return self


MODELS: Mapping[Kind, type[Entry]] = {"lenses": LensPart, "microlens_arrays": ArrayPart, "sensors": SensorPart}


def given_by(kinds: Iterable[Kind]) -> frozenset[str]:
    """Places of a design that parts of some kinds give together."""
    return frozenset(place for kind in kinds for place in MODELS[kind].places)


class Catalogue(BaseModel):
    """Parts by kind."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lenses: tuple[LensPart, ...] = ()
    microlens_arrays: tuple[ArrayPart, ...] = ()
    sensors: tuple[SensorPart, ...] = ()

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
            catalogue = catalogue + _read(path)
        except InputError as error:
            faults += [Problem("", f"{label}: {fault}") for fault in error.problems]
    for kind in KINDS:
        names = [entry.part for entry in catalogue.of(kind)]
        twice = sorted({name for name in names if names.count(name) > 1})
        faults += [Problem(kind, f"two parts are called '{name}'; rename one") for name in twice]
    if faults:
        raise InputError(tuple(faults))
    return catalogue


def _read(path: Path) -> Catalogue:
    data = read_toml(path, "")
    try:
        return Catalogue.model_validate(data, context={"from_file": True})
    except ValidationError as error:
        raise InputError(problems_of(error, data, Catalogue, from_file=True)) from None


def rows(catalogue: Catalogue, kinds: Iterable[Kind] = KINDS) -> Iterator[dict[str, Any]]:
    """Every part as plain values, lengths in mm."""
    for kind in kinds:
        for entry in catalogue.of(kind):
            row = {"kind": kind} | {key: value for key, value in entry.model_dump().items() if value not in (None, "")}
            if isinstance(entry, LensPart):
                row |= {"clear_aperture": entry.aperture, "clear_aperture_assumed": entry.clear_aperture is None}
            elif isinstance(entry, SensorPart):
                row["size"] = list(entry.size)
            yield row


COMPARE = {"=": operator.eq, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
LENGTHS = ("diameter", "clear_aperture", "focal_length", "effective_focal_length", "pitch", "pixel", "size")
NEAR = 1e-9
"""Relative difference at which lengths count as equal."""


@dataclass(frozen=True)
class PartCondition:
    """A condition on one key of a part, as typed: "focal_length<=100 mm", "maker=Thorlabs"."""

    key: str
    sign: str
    value: float | str

    def holds(self, row: Mapping[str, Any]) -> bool:
        """Whether a part (of `rows`) meets it; of several numbers (a size) all must."""
        own = row.get(self.key)
        if own is None:
            return False
        if isinstance(self.value, str):
            return self.value.lower() in str(own).lower()
        numbers = own if isinstance(own, (list, tuple)) else [own]
        return all(self._compare(float(number), self.value) for number in numbers)

    def _compare(self, number: float, value: float) -> bool:
        if abs(number - value) <= NEAR * abs(value):
            return self.sign in ("=", "<=", ">=")
        return bool(COMPARE[self.sign](number, value))


def read_condition(text: str) -> PartCondition:
    """Read a condition.

    Raises
    ------
    InputError
        Unknown key, no comparison, a length without a unit.
    """
    try:
        return _read_condition(text)
    except ValueError as error:
        raise InputError((Problem("--where", str(error)),)) from None


def _read_condition(text: str) -> PartCondition:
    known = sorted({"kind", *(name for model in MODELS.values() for name in model.model_fields)})
    match = re.fullmatch(r"\s*(\w+)\s*(<=|>=|<|>|=)\s*(.+?)\s*", text)
    if match is None:
        raise ValueError(f'cannot read "{text}"; write e.g. "focal_length<=100 mm" or "maker=Thorlabs"')
    key, sign, value = match.groups()
    if key not in known:
        near = difflib.get_close_matches(key, known, 1, 0.5)
        hint = f"did you mean '{near[0]}'?" if near else ", ".join(known)
        raise ValueError(f"'{key}' is no key of a part; {hint}")
    if key in LENGTHS:
        return PartCondition(key, sign, parse_quantity(value, "length"))
    if key == "pixels":
        try:
            return PartCondition(key, sign, float(value))
        except ValueError:
            raise ValueError(f'"{value}" is no number of pixels; write e.g. "pixels>=400"') from None
    if sign != "=":
        raise ValueError(f"'{key}' holds words, which {sign} does not compare; write {key}={value}")
    return PartCondition(key, sign, value)
