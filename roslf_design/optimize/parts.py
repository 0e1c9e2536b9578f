"""The catalogue: parts that can be bought, as data files with their provenance, and the reader's confidence in them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from ..design.files import read_toml
from ..design.messages import problems_of
from ..design.units import Length
from ..errors import InputError, Problem

Kind = Literal["lenses", "microlens_arrays", "sensors"]
KINDS: tuple[Kind, ...] = get_args(Kind)

Confidence = Literal["measured", "datasheet", "secondary", "unverified", "typical"]
"""measured: by whom the provenance says; datasheet: read in the maker's own; secondary: read where others quote the
maker; unverified: stated without a source at hand; typical: a size that many makers list, not one part."""
CONFIDENCE: tuple[Confidence, ...] = get_args(Confidence)

SHIPPED = Path(__file__).with_name("catalogue")


class Entry(BaseModel):
    """What every part has."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    part: str
    """Name or number; unique among its kind."""
    maker: str = ""
    provenance: str
    """Where the figures come from."""
    confidence: Confidence
    remark: str = ""


class LensPart(Entry):
    """A main lens."""

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

    @model_validator(mode="after")
    def _inside(self) -> LensPart:
        if self.clear_aperture is not None and self.clear_aperture > self.diameter:
            raise ValueError("clear_aperture is larger than the diameter; swap them")
        return self


class ArrayPart(Entry):
    """A microlens array."""

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


class SensorPart(Entry):
    """An image sensor."""

    pixel: Length
    pixels: tuple[int, int]

    @property
    def size(self) -> tuple[float, float]:
        """Of the pixel field [mm]."""
        return self.pixels[0] * self.pixel, self.pixels[1] * self.pixel

    @model_validator(mode="after")
    def _some(self) -> SensorPart:
        if min(self.pixels) < 1:
            raise ValueError(f"pixels {self.pixels} must be positive")
        return self


GIVEN: Mapping[Kind, tuple[str, ...]] = {
    "lenses": ("main_lens.diameter", "main_lens.focal_length"),
    "microlens_arrays": (
        "microlens_array.pitch",
        "microlens_array.focal_length",
        "microlens_array.size.0",
        "microlens_array.size.1",
    ),
    "sensors": ("sensor.pixel", "sensor.size.0", "sensor.size.1"),
}
"""Places of a design that a part of each kind gives."""


def given_by(kinds: Iterable[Kind]) -> frozenset[str]:
    """Places that parts of some kinds give together."""
    return frozenset(place for kind in kinds for place in GIVEN[kind])


MODELS: Mapping[Kind, type[Entry]] = {"lenses": LensPart, "microlens_arrays": ArrayPart, "sensors": SensorPart}


class Catalogue(BaseModel):
    """Parts by kind."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lenses: tuple[LensPart, ...] = ()
    microlens_arrays: tuple[ArrayPart, ...] = ()
    sensors: tuple[SensorPart, ...] = ()

    def of(self, kind: Kind) -> tuple[Entry, ...]:
        """Parts of one kind."""
        found: tuple[Entry, ...] = getattr(self, kind)
        return found

    def __add__(self, other: Catalogue) -> Catalogue:
        return Catalogue(**{kind: (*self.of(kind), *other.of(kind)) for kind in KINDS})


def shipped_files() -> tuple[Path, ...]:
    """The catalogue's own data files."""
    return tuple(sorted(SHIPPED.glob("*.toml")))


def load_catalogue(paths: Iterable[str | os.PathLike[str]] = (), *, shipped: bool = True) -> Catalogue:
    """Read the shipped catalogue and further files.

    Raises
    ------
    InputError
        Names the file and every fault in it; also where two parts of a kind are called alike.
    """
    faults: list[Problem] = []
    found = Catalogue()
    for path in [*(shipped_files() if shipped else ()), *paths]:
        place = Path(path)
        label = place.name if place in shipped_files() else str(path)
        try:
            found = found + _read(place)
        except InputError as error:
            faults += [Problem("", f"{label}: {fault}") for fault in error.problems]
    for kind in KINDS:
        names = [entry.part for entry in found.of(kind)]
        twice = sorted({name for name in names if names.count(name) > 1})
        faults += [Problem(kind, f"two parts are called '{name}'; rename one") for name in twice]
    if faults:
        raise InputError(tuple(faults))
    return found


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
            own = {key: value for key, value in entry.model_dump().items() if value not in (None, "")}
            yield {"kind": kind, **own, **_followed(entry)}


def _followed(entry: Entry) -> dict[str, Any]:
    if isinstance(entry, LensPart):
        return {"clear_aperture": entry.aperture, "clear_aperture_assumed": entry.clear_aperture is None}
    return {"size": list(entry.size)} if isinstance(entry, SensorPart) else {}
