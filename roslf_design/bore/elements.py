"""Kinds of elements that may stand before the main lens, and what lies before them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ..lenses.glass import AIR, Glass
from ..lenses.material import Material
from ..words import length
from .group import LensGroup
from .lens import FieldLens
from .mirror import Mirror
from .part import OpticalPart
from .plate import Plate, Prism
from .rod import Grin

AnyElement = Annotated[Plate | Prism | Mirror | FieldLens | Grin | LensGroup, Field(discriminator="kind")]
"""Element of `[[elements]]`, of any kind."""


class ObjectSpace(OpticalPart):
    """Medium that the scene lies in."""

    medium: Material = AIR
    """Medium in front of the farthest element, which seals it off."""

    @property
    def glass(self) -> Glass:
        """The medium."""
        return self.medium

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """The medium."""
        return (("medium", self.medium),)


def element_name(element: AnyElement, number: int) -> str:
    """Name of an element, as given or "plate 1"; its rims are "plate 1, front" and "plate 1, back"."""
    return element.name or f"{element.kind} {number}"


def made_of(element: AnyElement) -> tuple[str, ...]:
    """Description in a few words each: size and material, focal length, deviation, and the diameter."""
    diameter = () if element.diameter is None else (f"diameter {length(element.diameter)}",)
    return (*element.words(), *diameter)
