"""Gradient-index rods."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ..lenses.tracer import LENGTH, ROD
from ..units import Gradient, Length
from ..words import length
from .element import Element, Flags, Matrix
from .export import SequenceRow
from .faces import KIND, Face, Surroundings, axes_of, plane_row, vertex_of
from .part import Number, PartNumbers

SECTION, SECTION_WORD = np.pi / 12, " section "
"""Phase of a rod that one section of its barrel stands for: between two, rays swing farther by less than
1 - cos(pi/24), 0.9 % of their swing. What its name goes on with."""


class Grin(Element):
    """A gradient-index rod with flat faces, ``n(r) = n_0 (1 - g^2 r^2/2)``."""

    kind: Literal["grin"]
    thickness: Length
    """Length of the rod [mm]; a quarter pitch is pi/(2 g)."""
    index: Annotated[float, Field(ge=1, lt=5)]
    """n_0, on its axis."""
    gradient: Gradient
    """g [1/mm]."""

    number_keys: ClassVar = (*Element.number_keys, "thickness", "index", "gradient")
    steps: ClassVar = 24
    cores: ClassVar = (0.35, 0.7)
    trade_name: ClassVar = "gradient-index rod"

    @property
    def round_when_seen(self) -> bool:  # type: ignore[override]
        """Whether its barrel cuts nothing: its sections are seen as many circles."""
        return self.diameter is None

    @property
    def grows(self) -> bool:
        """Whether it is known what temperature does to it: never."""
        return False

    def forward(self, at: PartNumbers, inside: Number, passed: Flags) -> Matrix:
        """Matrix of a part of its swing."""
        n, g = at["index"], at["gradient"]
        cos, sin = np.cos(g * inside), np.sin(g * inside)
        return cos, sin / (n * g), -n * g * sin, cos

    def petzval(self, at: PartNumbers) -> Number:
        """Power of its gradient, were it thin, over the square of its index."""
        return np.square(at["gradient"]) * self.span(at) / at["index"]

    def openings(self, at: PartNumbers) -> Iterator[tuple[str, Number]]:
        """Openings of both faces, and of sections of the barrel."""
        yield from super().openings(at)
        start, thick, swing = at["distance"], self.span(at), at["gradient"]
        whole = np.real(np.asarray(swing * thick)) < np.pi  # half a turn on, the same comes again
        reach = np.where(whole, thick, np.pi / swing)[()]
        sections = max(1, math.ceil(min(float(self.gradient) * float(self.thickness), math.pi) / SECTION))
        for k in range(sections):
            yield f", barrel{SECTION_WORD}{k + 1}", start + reach * ((k + 0.5) / sections)

    def faces(self, at: PartNumbers, name: str, around: Surroundings) -> list[Face]:
        """The rod as a whole: one row."""
        n, g, thick = at["index"], at["gradient"], np.asarray(self.span(at), float)
        radius, vertex = at.get("diameter", math.inf) / 2, vertex_of(at, at["distance"])
        row = plane_row(vertex, axes_of(at), radius, n, g, thick)
        row[..., KIND], row[..., LENGTH] = ROD, thick
        row[..., 3], row[..., 4] = n, g
        return [Face(row, around.medium, 1.0, f"{at.place}.0", name)]

    def rows(self, name: str, at: float, semi: float) -> list[SequenceRow]:
        """No surface stands for it."""
        raise ValueError("a gradient-index rod")

    def words(self) -> tuple[str, ...]:
        """Length, index and gradient."""
        return f"{length(self.thickness)}, n_0 {self.index:g}", f"g = {self.gradient:.5g} /mm"
