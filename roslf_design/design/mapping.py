"""How an objective takes angles to image heights, where it is not a collinear f tan: h = f g(theta).

Every wide-angle objective has barrel distortion. Its first order is f all the same, so that the chain of planes
(`.chain`) holds for whatever lies behind it; towards the scene the chain's index times slope, p = h/f, is g(theta) of
an angle theta in air instead of its tangent. Flat windows and liquid before the objective obey Snell's law then, and
every ray crosses the entrance pupil, the image of the FAP in front of all elements, where the chain has it.

A law is an array, for kernels and numpy alike: a row of kind and largest p; of a table also a row an interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from .._jit import kernel
from ..toml_files import TAG, nearest
from ..units import Angle, AnyLength, format_quantity
from .parts import Part

Law = NDArray[np.float64]

THETA, SINE, STEREOGRAPHIC, TABLE = range(4)
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
NOTHING = 1e-150
"""Added to p where it divides: changes no other number."""


class MappingTable(Part):
    """A measured mapping: image heights at angles of the field, in air."""

    angles: Annotated[tuple[Angle, ...], Field(min_length=3, max_length=1000)]
    """From 0, rising, to 90 degrees at most [rad]."""
    heights: Annotated[tuple[AnyLength, ...], Field(min_length=3, max_length=1000)]
    """Of the image there, from 0, rising [mm]."""

    @model_validator(mode="after")
    def _rises(self) -> MappingTable:
        if len(self.angles) != len(self.heights):
            raise ValueError(f"{len(self.angles)} angles and {len(self.heights)} heights; give one height an angle")
        for name, values in (("angles", self.angles), ("heights", self.heights)):
            if values[0] != 0 or not all(a < b for a, b in pairwise(values)):
                raise ValueError(f"{name} must begin with 0 and rise from one to the next")
        if self.angles[-1] > math.pi / 2 * (1 + 1e-12):
            told = math.degrees(self.angles[-1])
            raise ValueError(f"angles reach {told:.4g} degrees; end the table at 90 degrees or before")
        return self

    def ratios(self, focal_length: float) -> tuple[Law, Law]:
        """Squares of p = h/f, and theta/p there: at p = 0 it is 1, which f says."""
        p = np.array(self.heights[1:]) / abs(focal_length)
        return np.concatenate([[0.0], p * p]), np.concatenate([[1.0], np.array(self.angles[1:]) / p])


def _named(value: Any) -> Any:
    if isinstance(value, str) and value in NAMES:
        return value
    told = f'"{value}"' if isinstance(value, str) else f"{value!r}"
    meant = nearest(value, NAMES) if isinstance(value, str) else f"known here: {', '.join(NAMES)}"
    raise ValueError(f"{told} is no mapping; {meant}; or give {{angles = [...], heights = [...]}}")


AnyMapping = Annotated[
    Annotated[Literal["f tan", "f theta", "f sin", "2f tan(theta/2)"], BeforeValidator(_named), Tag(f"{TAG}name")]
    | Annotated[MappingTable, Tag(f"{TAG}table")],
    Discriminator(lambda value: TAG + ("table" if isinstance(value, (Mapping, MappingTable)) else "name")),
]
"""A mapping by name, or measured."""


def mapping_fault(mapping: MappingTable, focal_length: float) -> str | None:
    """What a table and a focal length contradict in; None where nothing."""
    q, ratios = mapping.ratios(focal_length)
    start = ratios[1] - q[1] * (ratios[2] - ratios[1]) / (q[2] - q[1])
    if not abs(start - 1) <= MISFIT:
        own = format_quantity(float(f"{abs(focal_length) / start:.5g}"), "length") if start > 0 else "none"
        return (
            f"the table begins like a lens of focal length {own}, not {format_quantity(focal_length, 'length')}; "
            "mend one of them"
        )
    law = mapping_law(mapping, focal_length)
    assert law is not None
    p = np.linspace(0, law[0, 1], 50 * len(q))
    if not (np.diff(angle_in_air(law, p)) > 0).all():
        return "between its entries the table's angles do not rise with its heights; mend the entry that jumps"
    return None


@lru_cache(maxsize=64)
def mapping_law(mapping: str | MappingTable, focal_length: float) -> Law | None:
    """What kernels know of a mapping; None of f tan.

    Of a table, theta/p is a cubic spline of p^2 through its entries, which keeps the angle odd in p and its first order
    that of the focal length.
    """
    if isinstance(mapping, MappingTable):
        from scipy.interpolate import CubicSpline

        q, ratios = mapping.ratios(focal_length)
        pieces = np.column_stack([q[:-1], CubicSpline(q, ratios).c.T])
        law = np.vstack([[TABLE, math.sqrt(q[-1]), 0.0, 0.0, 0.0], pieces])
    elif mapping == COLLINEAR:
        return None
    else:
        law = np.array([[*KINDS[mapping], 0.0, 0.0, 0.0]], float)
    law.setflags(write=False)
    return law


@kernel()
def angle_in_air(law: Any, p: Any) -> Any:
    """Angle theta [rad] with g(theta) = p, where p does not exceed the law's largest."""
    kind = law[0, 0]
    if kind == THETA:
        return p * 1.0
    if kind == SINE:
        return np.arcsin(p)
    if kind == STEREOGRAPHIC:
        return 2.0 * np.arctan(p / 2.0)
    q = p * p
    i = 1 + np.maximum(np.searchsorted(law[1:, 0], q.real, "right") - 1, 0)
    t = q - law[:, 0][i]
    return p * (((law[:, 1][i] * t + law[:, 2][i]) * t + law[:, 3][i]) * t + law[:, 4][i])


@kernel()
def stretch(law: Any, p: Any, n: Any) -> Any:
    """Slope in a medium of index n over the first order's, p/n: 1 near the axis, huge at 90 degrees.

    Beyond the law's largest p that of the largest.
    """
    held = np.minimum(p, law[0, 1]) + NOTHING
    angle = angle_in_air(law, held)
    sine, cosine = np.sin(angle), np.cos(angle)
    return sine / np.sqrt((n - 1.0) * (n + 1.0) + cosine * cosine) * (n / held)


@kernel()
def illumination(law: Any, p: Any) -> Any:
    """Irradiance against the axis, through an entrance pupil that is a flat opening of one size: 1 for f sin.

    A part of the image of area dA = f^2 g dg dphi gets its light from the solid angle dOmega = sin(theta) dtheta dphi,
    through an opening that is seen foreshortened, by cos(theta). Its etendue over dA, against that on the axis, is

        cos(theta) sin(theta)/(g g') = sin(theta) cos(theta) theta'(p)/p,

    cos^4 for f tan, sin(theta) cos(theta)/theta for f theta, cos(theta) cos^4(theta/2) for 2f tan(theta/2), 1 for
    f sin. Flat windows and liquid change nothing: n^2 cos(theta) dOmega is the same in each.
    """
    held = np.minimum(p, law[0, 1]) + NOTHING
    angle = angle_in_air(law, held)
    light = np.sin(angle) * np.cos(angle) / held
    kind = law[0, 0]
    if kind == THETA:
        return light
    if kind == SINE:
        return held * 0.0 + 1.0
    if kind == STEREOGRAPHIC:
        return light / (1.0 + held * held / 4.0)
    q = held * held
    i = 1 + np.maximum(np.searchsorted(law[1:, 0], q.real, "right") - 1, 0)
    t = q - law[:, 0][i]
    steepness = (3.0 * law[:, 1][i] * t + 2.0 * law[:, 2][i]) * t + law[:, 3][i]
    return light * (angle / held + 2.0 * q * steepness)


def image_height(law: Law, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """P = g(theta) of angles in air [rad]; beyond what is imaged, the largest."""
    largest = law[0, 1]
    held = np.minimum(angle, angle_in_air(law, largest))
    if law[0, 0] == THETA:
        return np.asarray(held * 1.0)
    if law[0, 0] == SINE:
        return np.asarray(np.sin(held))
    if law[0, 0] == STEREOGRAPHIC:
        return np.asarray(2 * np.tan(held / 2))
    low, high = np.zeros(np.shape(held)), np.full(np.shape(held), largest)
    for _ in range(60):  # the angle rises with p
        middle = (low + high) / 2
        below = angle_in_air(law, middle) < held
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray((low + high) / 2)
