"""Mapping of angles to image heights by an objective that is not a collinear f tan: h = f g(theta).

Every wide-angle objective has barrel distortion. Its first order is f all the same, so that the chain of planes
(`.chain`) holds for whatever lies behind it; towards the scene the chain's index times slope, p = h/f, is g(theta) of
an angle theta in air instead of its tangent. Flat windows and liquid before the objective obey Snell's law then, and
every ray crosses the entrance pupil, the image of the FAP in front of all elements, where the chain has it.

What kernels know of it, and what follows from it, is in `..lenses.angles`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from ..lenses.angles import F_TAN, SINE, STEREOGRAPHIC, TABLE, THETA, AngleLaw, AngleMap, Law
from ..toml_files import TAG, nearest
from ..units import Angle, AnyLength, format_quantity
from .part import Part

KINDS: dict[str, tuple[int, float]] = {
    "f theta": (THETA, math.pi / 2),
    "f sin": (SINE, 1.0),
    "2f tan(theta/2)": (STEREOGRAPHIC, 2.0),
}
"""Mappings by their names in a file but "f tan": kind, and p at 90 degrees."""
COLLINEAR: Literal["f tan"] = "f tan"
NAMES = (COLLINEAR, *KINDS)
MISFIT = 0.05
"""Share by which a table's own first order may miss the focal length."""


class MappingTable(Part):
    """A measured mapping: image heights at angles of the field, in air."""

    angles: Annotated[tuple[Angle, ...], Field(min_length=3, max_length=1000)]
    """Angles from 0, rising, to 90 degrees at most [rad]."""
    heights: Annotated[tuple[AnyLength, ...], Field(min_length=3, max_length=1000)]
    """Heights of the image there, from 0, rising [mm]."""

    @model_validator(mode="after")
    def _rises(self) -> MappingTable:
        if len(self.angles) != len(self.heights):
            raise ValueError(f"{len(self.angles)} angles and {len(self.heights)} heights; give one height an angle")
        for name, values in (("angles", self.angles), ("heights", self.heights)):
            if values[0] != 0 or not all(a < b for a, b in pairwise(values)):
                raise ValueError(f"{name} must begin with 0 and rise from one to the next")
        if self.angles[-1] > math.pi / 2 * (1 + 1e-12):
            degrees = math.degrees(self.angles[-1])
            raise ValueError(f"angles reach {degrees:.4g} degrees; end the table at 90 degrees or before")
        return self

    def ratios(self, focal_length: float) -> tuple[Law, Law]:
        """Squares of p = h/f, and theta/p there: at p = 0 it is 1, which f says."""
        p = np.array(self.heights[1:]) / abs(focal_length)
        return np.concatenate([[0.0], p * p]), np.concatenate([[1.0], np.array(self.angles[1:]) / p])


def _named(value: Any) -> Any:
    if isinstance(value, str) and value in NAMES:
        return value
    shown = f'"{value}"' if isinstance(value, str) else f"{value!r}"
    meant = nearest(value, NAMES) if isinstance(value, str) else f"known here: {', '.join(NAMES)}"
    raise ValueError(f"{shown} is no mapping; {meant}; or give {{angles = [...], heights = [...]}}")


AnyMapping = Annotated[
    Annotated[Literal["f tan", "f theta", "f sin", "2f tan(theta/2)"], BeforeValidator(_named), Tag(f"{TAG}name")]
    | Annotated[MappingTable, Tag(f"{TAG}table")],
    Discriminator(lambda value: TAG + ("table" if isinstance(value, (Mapping, MappingTable)) else "name")),
]
"""A mapping by name, or measured."""


def mapping_fault(mapping: MappingTable, focal_length: float) -> str | None:
    """Contradiction between a table and a focal length in words; None where there is none."""
    q, ratios = mapping.ratios(focal_length)
    start = ratios[1] - q[1] * (ratios[2] - ratios[1]) / (q[2] - q[1])
    if not abs(start - 1) <= MISFIT:
        own = format_quantity(float(f"{abs(focal_length) / start:.5g}"), "length") if start > 0 else "none"
        return (
            f"the table begins like a lens of focal length {own}, not {format_quantity(focal_length, 'length')}; "
            "mend one of them"
        )
    law = angle_map(mapping, focal_length)
    if not (np.diff(law.angle(np.linspace(0, law.end, 50 * len(q)))) > 0).all():
        return "between its entries the table's angles do not rise with its heights; mend the entry that jumps"
    return None


@lru_cache(maxsize=64)
def angle_map(mapping: str | MappingTable, focal_length: float) -> AngleMap:
    """Mapping of angles; that of a table depends on the focal length, on which others do not.

    Of a table, theta/p is a cubic spline of p^2 through its entries, which keeps the angle odd in p and its first order
    that of the focal length.
    """
    if mapping == COLLINEAR:
        return F_TAN
    if isinstance(mapping, MappingTable):
        from scipy.interpolate import CubicSpline

        return AngleLaw(table_law(TABLE, mapping.ratios(focal_length), CubicSpline))
    return AngleLaw(np.array([[*KINDS[mapping], 0.0, 0.0, 0.0]], float))


def table_law(kind: int, told: tuple[Law, Law], through: Callable[..., Any]) -> Law:
    """Law of a table: cubics `through` what is told at squares of p."""
    q, values = told
    pieces = np.column_stack([q[:-1], through(q, values).c.T])
    return np.vstack([[kind, math.sqrt(q[-1]), 0.0, 0.0, 0.0], pieces])
