"""Light path of a design: the elements that light meets, their numbers, and the materials."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING

from ..bore.chain import COVER, SUBSTRATE, Chain
from ..bore.part import TEMPERATURE, WAVELENGTH
from ..lenses.glass import Glass
from .parts import Cover

if TYPE_CHECKING:
    from .design import Design


def chain_of(design: Design) -> Chain:
    """Chain of what light meets before the main lens and about the array."""
    substrate = design.microlens_array.substrate
    housing = 0.0 if design.environment is None else design.environment.expansion
    plates = tuple(place for place, _ in _plates(design))
    return Chain(design.elements, "scene" if substrate is None else substrate.lenslets, housing, plates)


def _plates(design: Design) -> Iterator[tuple[str, Cover]]:
    """Plates about the array, by their places."""
    for place, plate in ((COVER, design.sensor.cover), (SUBSTRATE, design.microlens_array.substrate)):
        if plate is not None:
            yield place, plate


def chain_numbers(design: Design) -> dict[str, float]:
    """Numbers of what light meets, at their places; indices at the design's wavelength."""
    numbers = {WAVELENGTH: design.wavelength}
    numbers |= {f"main_lens.decentre.{axis}": float(design.main_lens.decentre[axis]) for axis in (0, 1)}
    for k, element in enumerate(design.elements):
        numbers |= {f"elements.{k}.{key}": value for key, value in element.numbers()}
    numbers |= {f"{place}.thickness": float(plate.thickness) for place, plate in _plates(design)}
    if design.environment is not None:
        numbers[TEMPERATURE] = float(design.environment.temperature)
    return numbers | {place: _index(glass, design.wavelength) for place, glass in materials_of(design).items()}


@lru_cache(maxsize=256)
def _index(glass: Glass, wavelength: float) -> float:
    return float(glass.index(wavelength))


def materials_of(design: Design) -> dict[str, Glass]:
    """Every material before the main lens and about the array, by the place of its index."""
    materials = {f"elements.{k}": e.glass for k, e in enumerate(design.elements) if e.glass is not None}
    materials |= {"object_space": design.object_space.medium} if design.elements else {}
    materials |= {place: plate.material for place, plate in _plates(design)}
    return {f"{part}.index": glass for part, glass in materials.items()}
