"""Choices of a study: parts of the catalogue, and of a real main lens its orientation and its glasses."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from itertools import pairwise, product
from typing import Any, Literal

from ..catalogue.entries import ELEMENT, KINDS, LENS_PRESCRIPTION, MODELS, Kind, Option
from ..lenses.glass import catalogue as glass_catalogue
from ..lenses.glass import find_glass
from ..lenses.prescription import LensError, Prescription
from .lens_variables import with_glasses

Choice = Literal[Kind, "orientations", "glasses"]
"""Kind of choice in a study: parts, and of a real main lens its orientation and its glasses."""

LENS_REVERSED = "main_lens.reversed"


class _OneChange(Option):
    """Option that changes one place of a design."""

    place: str
    value: Any

    @property
    def numbers(self) -> dict[str, Any]:
        """The place to what it has there."""
        return {self.place: self.value}


ORIENTATIONS = tuple(
    _OneChange(part=name, place=LENS_REVERSED, value=turned)
    for name, turned in {"as catalogued": False, "reversed": True}.items()
)


def _optical_solids(wavelength: float) -> tuple[str, ...]:
    """Names of the glasses, crystals and plastics that ship and whose index is known at a wavelength [mm]."""
    every = {glass.name: glass for glass in glass_catalogue().values() if glass.warming.expansion > 0}
    return tuple(name for name, glass in every.items() if glass.shortest <= wavelength <= glass.longest)


def glass_choices(lens: Prescription, names: Iterable[str], wavelength: float) -> tuple[Option, ...]:
    """A lens of every ordered set of glasses, cemented ones different; those that cannot be made are left out.

    Focal length and shape factor are as before.

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
                remade = with_glasses(lens, glasses, wavelength)
                made.append(
                    _OneChange(part=" + ".join(glass.name for glass in glasses), place=LENS_PRESCRIPTION, value=remade)
                )
    return tuple(made)


def given_by(kinds: Iterable[Choice], element: int | None) -> frozenset[str]:
    """Places of a design that parts of some kinds give together, windows to one of its elements."""
    return frozenset(placed(place, element) for kind in kinds if kind in KINDS for place in MODELS[kind].gives)


def placed(place: str, element: int | None) -> str:
    """A place that a part gives, of the element that it is chosen for."""
    return place.replace(ELEMENT, f"elements.{element}.") if place.startswith(ELEMENT) else place
