"""Parts of a camera: each a frozen value of a design, and its numbers in a camera, each one or many."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from .._arrays import by_value
from ..lenses.glass import Glass
from ..lenses.prescription import Prescription
from ..toml_files import StrictTable
from ..units import Angle, AnyLength, Length

Number = float | NDArray[np.float64]
"""A float, or an array that broadcasts to whatever builds (and fields) there are."""
Offset = tuple[AnyLength, AnyLength]
Tilt = tuple[Angle, Angle]
Size = tuple[Length, Length]
PartName = Annotated[str, Field(min_length=1)]
"""Name of a part in a catalogue."""
LONGEST_NAME = 24
"""Characters that a name has at most: it stands in columns and in drawings."""
GivenName = Annotated[str, Field(max_length=LONGEST_NAME, pattern=r"^\S(.*\S)?$")]
"""Name that a designer gives a part."""
Layout = Literal["square", "hexagonal"]
"""Packing of microlenses; hexagonal rows run along the array's x axis."""
Colours = Literal["mono", "RGGB", "GRBG", "GBRG", "BGGR"]
"""Filters on a sensor's pixels: none, or a Bayer pattern, the first two pixels of its first two rows."""

WAVELENGTH, TEMPERATURE = "light.wavelength", "environment.temperature"
"""Places of a design that every part may depend on."""


def times(a: Number, b: Number) -> Number:
    """Product; exact zeros and ones cost nothing."""
    if isinstance(a, float):
        if a == 0.0:
            return 0.0
        if a == 1.0:
            return b
    if isinstance(b, float):
        if b == 0.0:
            return 0.0
        if b == 1.0:
            return a
    return a * b


def plus(a: Number, b: Number) -> Number:
    """Sum; exact zeros cost nothing."""
    if isinstance(a, float) and a == 0.0:
        return b
    if isinstance(b, float) and b == 0.0:
        return a
    return a + b


def minus(a: Number, b: Number) -> Number:
    """Difference; exact zeros cost nothing."""
    if isinstance(b, float) and b == 0.0:
        return a
    return a - b


class Part(StrictTable):
    """Base of every part: frozen, comparable, hashable, picklable; unknown keys are errors."""

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """Fields that differ from their defaults."""
        fields = type(self).model_fields
        yield from ((name, value) for name, value in super().__repr_args__() if value != fields[str(name)].default)


class OpticalPart(Part):
    """Part that light meets, and what all of them answer."""

    @property
    def glass(self) -> Glass | None:
        """Material of its index; None of one that has no index, or one that is a number."""
        return None

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Every material of it by its key."""
        return () if self.glass is None else (("material", self.glass),)

    @property
    def prescribed(self) -> tuple[Prescription, ...]:
        """Lens that gives it by surfaces, as in the design file."""
        return ()

    @property
    def grows(self) -> bool:
        """Whether it is known what temperature does to it."""
        return True


@by_value
@dataclass(frozen=True, slots=True)
class PartNumbers:
    """Numbers of one part of a camera by the part's own keys, and what it stands in."""

    numbers: Mapping[str, Number]
    """All numbers of the camera by their places."""
    place: str
    """Place of the part: "elements.2"."""
    housing: float = 0.0
    """Expansion of what holds its pieces apart [1/K]."""

    def __getitem__(self, key: str) -> Number:
        return self.numbers[f"{self.place}.{key}"]

    def get(self, key: str, default: Number) -> Number:
        """Number at a key, `default` where the part has none."""
        return self.numbers.get(f"{self.place}.{key}", default)

    def pair(self, key: str) -> tuple[Number, Number]:
        """Numbers along x and y."""
        return self.numbers[f"{self.place}.{key}.0"], self.numbers[f"{self.place}.{key}.1"]

    @property
    def wavelength(self) -> Number:
        """Wavelength of the light [mm]."""
        return self.numbers[WAVELENGTH]

    @property
    def temperature(self) -> Number | None:
        """Temperature [degrees C]; None of a camera without `[environment]`."""
        return self.numbers.get(TEMPERATURE)
