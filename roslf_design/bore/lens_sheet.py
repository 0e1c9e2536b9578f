"""A bought main lens by its data sheet: cardinal points, pupil, distortion and light over the field.

Lengths along the axis count as lens makers count them, positive towards the sensor: those of the scene's side from the
front vertex, those of the sensor's side from the rear one. The camera's own lengths count from the principal planes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ..lenses.angles import F_TAN, TABLE, TOLD, AngleLaw, AngleMap, Law, ShadedTangent
from ..toml_files import PlainNumber
from ..units import Angle, AnyLength, Length, format_quantity
from .mapping import table_law
from .part import Part

PUPIL_AGREES = 0.02
"""Share of the focal length by which either pupil may miss its place: sheets tell rounded lengths."""
SIZE_AGREES = 0.05
"""Share by which f over the f-number may miss the pupil's diameter: f-numbers are told in steps, as f/1.4 of 1.414."""
KNOTS, BEYOND, FAR = 49, 16, 3.0
"""Counts of heights at which the mapping is told, to the last field and beyond, and where they end, over f."""


class _FieldTable(Part):
    """Percentages over the field, at image heights or at angles of the field."""

    heights: Annotated[tuple[AnyLength, ...], Field(min_length=1, max_length=1000)] | None = None
    """Image heights, rising [mm]; None where angles are given."""
    angles: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=1000)] | None = None
    """Angles to the axis, rising [rad]; None where heights are given."""
    percent: Annotated[tuple[PlainNumber, ...], Field(min_length=1, max_length=1000)]
    """Percentages there [%]."""

    middle: ClassVar[float]
    """Percentage on the axis, by definition."""
    between: ClassVar[tuple[float, float]]
    remedy: ClassVar[str]
    """Least and largest percentages that can be, and words for what to do about others."""

    @model_validator(mode="after")
    def _possible(self) -> _FieldTable:
        if (self.heights is None) == (self.angles is None):
            raise ValueError('needs either heights (["2 mm", ...] on the image) or angles (["5 deg", ...])')
        if len(self.fields) != len(self.percent):
            raise ValueError(f"{len(self.fields)} fields and {len(self.percent)} percentages; give one a field")
        ends = self.fields[0] >= 0 and 0 < self.fields[-1] < (math.inf if self.angles is None else math.pi / 2)
        if not ends or not all(a < b for a, b in pairwise(self.fields)):
            raise ValueError("fields must begin at 0 or above and rise from one to the next, angles to below 90 deg")
        low, high = self.between
        if wrong := [share for share in self.percent if not low <= share <= high]:
            raise ValueError(f"{wrong[0]:g} % is not between {low:g} and {high:g} %; {self.remedy}")
        if self.fields[0] == 0 and self.percent[0] != self.middle:
            raise ValueError(f"{self.percent[0]:g} % on the axis, where it is {self.middle:g} %; give it against that")
        return self

    @property
    def fields(self) -> tuple[float, ...]:
        """Heights or angles."""
        return self.heights or self.angles or ()

    def over(self, focal_length: float, height: Callable[[Law, Law], Any]) -> tuple[Law, Law]:
        """Heights over f and percentages over 100, from the axis on; `height` is that of angles and what is told."""
        at, told = np.array(self.fields), np.array(self.percent) / 100
        if at[0] > 0:
            at, told = np.append(0.0, at), np.append(self.middle / 100, told)
        p = np.asarray(at / focal_length if self.angles is None else height(at, told))
        if not np.all(np.diff(p) > 0):
            raise ValueError("image heights do not rise with the fields of a table; mend what jumps, or end it before")
        return p, told


class _DistortionTable(_FieldTable):
    """Distortion over the field: image height against f tan of the angle, below 0 is barrel-shaped."""

    middle = 0.0
    between = -50.0, 50.0
    remedy = "check unit and sign, or describe a fisheye by the mapping of a lens in [[elements]]"


class _LightTable(_FieldTable):
    """Relative illumination over the field, against the middle: all that the lens loses, cos^4 and barrels included."""

    middle = 100.0
    between = 1.0, 100.0
    remedy = "write percent of the light in the middle, 85 and not 0.85, and end before it is dark"


FARTHEST = 10.0
"""Principal planes from their vertices, over focal length and length together."""


class LensSheet(Part):
    """Numbers of a lens's data sheet."""

    name: str = ""
    """Name of the product."""
    focal_length: Length
    """f [mm]."""
    length: Length
    """From the front vertex to the rear one [mm]."""
    front_principal: AnyLength
    """Front principal plane (H) behind the front vertex [mm]."""
    rear_principal: AnyLength
    """Rear principal plane (H') behind the rear vertex, below 0 inside the lens: back focal length less f [mm]."""
    entrance_pupil: AnyLength | None = None
    """Entrance pupil behind the front vertex [mm]."""
    exit_pupil: AnyLength | None = None
    """Exit pupil behind the rear vertex, below 0 before it [mm]; must agree with the entrance pupil's image."""
    f_number: Annotated[PlainNumber, Field(gt=0, le=1000)] | None = None
    """f over the entrance pupil's diameter, at full aperture."""
    pupil_diameter: Length | None = None
    """Diameter of the entrance pupil [mm]; where f_number is given too, this one counts."""
    distortion: _DistortionTable | None = None
    """Distortion over the field; None where it is not stated."""
    relative_illumination: _LightTable | None = None
    """Light over the field, at full aperture; None is cos^4."""

    @model_validator(mode="after")
    def _of_one_lens(self) -> LensSheet:
        f, s, image = self.focal_length, *self._pupils
        for key in ("front_principal", "rear_principal"):
            if abs(at := getattr(self, key)) > FARTHEST * (f + self.length):
                told = format_quantity(at, "length", 4)
                raise ValueError(f"{key} = {told} is no place for a lens of that size and f; check unit and sign")
        width, number = self.pupil_diameter, self.f_number
        if width is not None and number is not None and abs(f / number / width - 1) > SIZE_AGREES:
            told, own = (format_quantity(float(size), "length", 4) for size in (width, f / number))
            raise ValueError(
                f"pupil_diameter = {told} contradicts f_number = {number:g}, which makes it {own}; mend or drop one"
            )
        # What both miss of 1/s' = 1/s + 1/f, without its quotients; each may err by its share of f.
        if abs(image * (f + s) - f * s) > PUPIL_AGREES * f * (abs(f + s) + abs(image - f)):
            seen = f"{f * s / (f + s) + self.rear_principal:.5g} mm behind the rear vertex" if f + s else "at infinity"
            told, other = (format_quantity(float(x or 0), "length", 5) for x in (self.exit_pupil, self.entrance_pupil))
            raise ValueError(
                f"exit_pupil = {told} contradicts entrance_pupil = {other}, which f images {seen}: mend one of them "
                "(front_principal and rear_principal count, too), or drop the less certain"
            )
        if math.isnan(s) and image == f:
            raise ValueError("exit_pupil stands in the focus, so the scene sees it at infinity; leave it out")
        _ = self.angle_map
        return self

    @property
    def _pupils(self) -> tuple[float, float]:
        """Entrance pupil behind the front principal plane, exit pupil behind the rear one; nan where not told [mm]."""
        front = math.nan if self.entrance_pupil is None else self.entrance_pupil - self.front_principal
        return front, math.nan if self.exit_pupil is None else self.exit_pupil - self.rear_principal

    @property
    def pupil(self) -> dict[str, float]:
        """Keys and numbers of a FAP that stands in its pupil, as far as they are told [mm]."""
        (front, rear), f = self._pupils, self.focal_length
        told = {"distance": f * rear / (rear - f) if math.isnan(front) else -front}
        if self.pupil_diameter is not None or self.f_number is not None:
            told["diameter"] = self.pupil_diameter or f / (self.f_number or math.inf)
        return {key: float(value) for key, value in told.items() if not math.isnan(value)}

    @property
    def gap(self) -> float:
        """Distance HH' between the principal planes, below 0 where they stand crossed [mm]."""
        return self.length - self.front_principal + self.rear_principal

    @property
    def over_field(self) -> dict[str, _FieldTable]:
        """Tables over the field, by their keys."""
        tables = {"distortion": self.distortion, "relative_illumination": self.relative_illumination}
        return {key: table for key, table in tables.items() if table is not None}

    @property
    def reach(self) -> float:
        """Least height over f, to first order, that all of its tables reach; infinite without any."""
        tables = self.over_field.values()
        ends = (table.over(self.focal_length, lambda angles, _: np.tan(angles))[0][-1] for table in tables)
        return float(min(ends, default=math.inf))

    @cached_property
    def angle_map(self) -> AngleMap:
        """How it maps angles, and its light over them; beyond the last fields as there."""
        if not self.over_field:
            return F_TAN
        from scipy.interpolate import CubicSpline, PchipInterpolator

        shape, f = F_TAN, self.focal_length
        if self.distortion is not None:
            told = self.distortion.over(f, lambda angles, bent: np.tan(angles) * (1 + bent))
            last = told[0][-1]
            p = last * np.append(np.sqrt(np.linspace(0, 1, KNOTS)), np.geomspace(1, max(FAR / last, 2.0), BEYOND)[1:])
            angles = np.arctan(p / (1 + CubicSpline(told[0] ** 2, told[1])(np.minimum(p, last) ** 2)))
            if not np.all(np.diff(angles) > 0):
                raise ValueError("distortion changes so fast that angles do not rise with heights; mend the table")
            shape = AngleLaw(table_law(TABLE, (p * p, np.append(1.0, angles[1:] / p[1:])), CubicSpline))
        if self.relative_illumination is None:
            return shape
        p, light = self.relative_illumination.over(f, lambda angles, _: shape.height(angles))
        shade = table_law(TOLD, (p * p, light), PchipInterpolator)  # barrels cut with a kink: no waves about it
        return ShadedTangent(shade) if shape is F_TAN else AngleLaw(shape.kernel, shade)
