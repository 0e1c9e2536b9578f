"""Goals and limits of a design problem: quantities, where they are asked for, and smooth rows made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from .._arrays import Array
from ..bore.part import TEMPERATURE
from ..camera import Camera
from ..design.required import ROUND_ANGLE, ROUND_RADIUS
from ..theory.f_number import inverse_fill_factor
from ..theory.light import SensorField, sensor_field
from ..theory.quantities import quantity_named
from ..theory.quantity import Quantity
from ..theory.stop_images import MicrolensImages
from ..theory.vignetting import field_margins
from ..toml_files import Instance, StrictTable
from ..units import AnyLength, Length, Temperature, in_file
from ..words import number as in_digits
from .traces import FieldTraces

Side = Literal["min", "max", "equal"]
SIGNS: Mapping[Side, str] = {"min": ">=", "max": "<=", "equal": "="}


def _named(name: Any) -> Any:
    quantity = quantity_named(name) if isinstance(name, str) else name
    return _smooth(quantity) if isinstance(quantity, Quantity) else quantity


def _smooth(quantity: Quantity) -> Quantity:
    """A quantity that searches can follow: a field over all that the sensor sees, as it bends where light ends it."""
    over = quantity.over
    if not quantity.lit or over is None or quantity.name in (ROUND_ANGLE, ROUND_RADIUS):
        return quantity
    return replace(quantity, of=lambda c, at: over(c, at, sensor_field(c)), lit=False)


def _place(value: Any) -> Any:
    """A place on the array; a single length lies along x."""
    return value if value is None or isinstance(value, (list, tuple)) else (value, 0.0)


class _Asked(StrictTable):
    """A quantity, at the focal plane or ahead of the bore's tip; of single microlenses that of one."""

    quantity: Annotated[Quantity, Instance, BeforeValidator(_named)]
    at: Length | None = None
    """Ahead of the bore's tip [mm]."""
    field: Annotated[tuple[AnyLength, AnyLength] | None, BeforeValidator(_place)] = None
    """Position of the microlens on the array [mm]."""
    temperature: Temperature | None = None
    """Temperature of the camera [degrees C]; the design's where left out."""

    @model_validator(mode="after")
    def _distance(self) -> _Asked:
        name = self.quantity.name
        if fault := self.quantity.fault_of_distance(self.at):
            raise ValueError(fault)
        if self.quantity.of is None and self.field is None:
            raise ValueError(f"'{name}' differs from field to field; say where on the array, e.g. field = \"3 mm\"")
        if self.quantity.local is None and self.field is not None:
            raise ValueError(f"{name} is one number for the whole field; drop field")
        if self.at is not None and self.field is not None:
            raise ValueError(f"{name} at a field is not asked for at a distance; drop at")
        return self

    @property
    def label(self) -> str:
        """E.g. ``sigma_z_mm at 40 mm``."""
        at = None if self.at is None else f"{self.at:g} mm"
        if self.field is not None:
            at = f"({self.field[0]:g}, {self.field[1]:g}) mm"
        name = self.quantity.name if at is None else f"{self.quantity.name} at {at}"
        return name if self.temperature is None else f"{name} at {self.temperature:g} degC"

    @property
    def asked(self) -> tuple[object, ...]:
        """Quantity and place: two of which these are the same have the same values."""
        return self.quantity.name, self.at, self.field, self.temperature

    def warm(self, camera: Camera) -> Camera:
        """The camera at the temperature asked for."""
        return camera if self.temperature is None else camera.replace({TEMPERATURE: self.temperature})

    def values(self, camera: Camera, traces: FieldTraces | None = None) -> Array:
        """The quantity itself, of every build; of several rims that of the worst.

        At a field behind a real lens it is traced: `traces` of the same builds.
        """
        if self.field is not None and traces is not None:
            return traces.at(self.quantity, self.field, self.temperature)
        camera = self.warm(camera)
        if self.field is not None:
            return np.asarray(self.quantity.at_fields(MicrolensImages(camera, [self.field]))[0])  # type: ignore[index]
        return self.quantity(camera, self.at)

    def each(self, camera: Camera, over: SensorField | None = None) -> Array:
        """Values of the quantity, (K, ...) where there are several rims; magnitudes where it has either sign.

        What hangs on how much the sensor sees is taken for the rectangle `over`, where one is given.
        """
        if self.quantity.of is None or self.field is not None:
            return self.values(camera)
        camera = self.warm(camera)
        if over is not None and self.quantity.over is not None:
            return self.quantity.over(camera, self.at, over)
        return (self.quantity.signed or self.quantity.of)(camera, self.at)

    def judged(self, camera: Camera, traces: FieldTraces | None = None) -> Array:
        """Values by which designs are judged: the quantity or, where it may pass infinity, its finite twin."""
        beyond = self.quantity.past_infinity
        return self.values(camera, traces) if beyond is None else beyond(self.warm(camera), self.at)

    def with_unit(self, number: float, digits: int = 6) -> str:
        """A value in words, e.g. ``1.5 mm``."""
        text = f"{number:.{digits}g}" if math.isfinite(number) else in_digits(number)
        return f"{text} {self.quantity.unit}".rstrip()


UNDISTORTED = "undistorted_field_mm"
LEAST_TAKEN = 1e-3
"""Room that a millimetre of field takes at least, by which rows are scaled where it takes less or none."""


class Constraint(_Asked):
    """A quantity held between limits; equal where both are the same."""

    min: Annotated[float, Field(allow_inf_nan=True)] | None = None
    """Text with a unit, or a number in the unit that the quantity's name ends with."""
    max: Annotated[float, Field(allow_inf_nan=True)] | None = None
    """Largest value allowed; None where there is no limit."""

    @field_validator("min", "max", mode="before")
    @classmethod
    def _read(cls, value: Any, info: ValidationInfo) -> float | None:
        quantity = info.data.get("quantity")
        if value is None or quantity is None:
            return None
        if quantity.past_infinity is not None and value == math.inf and not in_file(info):
            return math.inf
        return float(quantity.limit(value, from_file=in_file(info)))

    @model_validator(mode="after")
    def _bounded(self, info: ValidationInfo) -> Constraint:
        name = self.quantity.name
        if self.min is None and self.max is None:
            raise ValueError(f"{name} has no limit; give min, max or both")
        # A search's own limits may lie a hair beyond what can be.
        crossed = self.min is not None and self.max is not None and self.min > self.max
        if (crossed or in_file(info)) and (fault := self.quantity.fault_of_limits(self.min, self.max)):
            raise ValueError(f"{name}: {fault}")
        return self

    @property
    def limits(self) -> dict[Side, float]:
        """Side to the limit there."""
        if self.min is not None and self.min == self.max:
            return {"equal": self.min}
        given: dict[Side, float | None] = {"min": self.min, "max": self.max}
        return {side: limit for side, limit in given.items() if limit is not None}

    @property
    def one_sided(self) -> tuple[Constraint, ...]:
        """Each of its limits alone."""
        if len(self.limits) == 1:
            return (self,)
        return self.model_copy(update={"max": None}), self.model_copy(update={"min": None})

    def limit_words(self, side: Side) -> str:
        """A limit in words, without its number, e.g. ``fill_factor <=``."""
        return f"{self.label} {SIGNS[side]}"

    @property
    def as_judged(self) -> bool:
        """Whether `measured` is `judged`."""
        one = self.quantity.worst is None or self.field is not None
        return one and self.quantity.name not in ("fill_factor", UNDISTORTED)

    def measured(self, camera: Camera, traces: FieldTraces | None = None) -> Array:
        """Values that the rows are made of: the quantity, one for each rim, or a finite stand-in.

        Of an image fill the inverse, of the undistorted field `field_margins`.
        """
        if self.quantity.name == "fill_factor":
            whole = self.field is None
            return np.abs(inverse_fill_factor(self.warm(camera)) if whole else 1 / self.values(camera, traces))
        if self.quantity.name == UNDISTORTED:
            return field_margins(self.warm(camera))
        return self.judged(camera, traces) if self.as_judged else self.each(camera)

    def row(self, limit: float, sign: float, spread: float) -> tuple[Callable[[Array], Array], float]:
        """From what is measured to a row, and how much the quantity changes where that changes by 1."""
        if self.quantity.name == "fill_factor":  # linear in the inverse, where the image fill has poles
            return lambda inverse: sign * (1 - limit * inverse), limit
        if self.quantity.name == UNDISTORTED:  # linear in the room, which is finite also where any field is whole
            if sign > 0:
                return lambda every: (every[:, 0].min(axis=0) - limit) / spread, spread
            return lambda one: (limit * one[2] - one[1]) / (np.maximum(one[2], LEAST_TAKEN) * spread), spread
        if self.quantity.past_infinity is not None:
            # In units of the limit's own twin, unless that is less than the spread: relative, and never too steep.
            edge = -1 / limit if limit > 0 else -math.inf
            unit = max(spread, min(-edge, 1e300))
            return lambda twin: sign * (twin - edge) / unit, unit * limit**2
        if self.quantity.positive and limit > 0:
            return lambda value: sign * np.log(value / limit), limit
        return lambda value: sign * (value - limit) / spread, spread

    def __str__(self) -> str:
        if len(self.limits) == 2:
            return f"{self.min:.6g} <= {self.label} <= {self.with_unit(self.limits['max'])}"
        side, limit = next(iter(self.limits.items()))
        return f"{self.limit_words(side)} {self.with_unit(limit)}"


class Goal(_Asked):
    """A quantity to make small or large."""

    direction: Literal["min", "max"]
    weight: Annotated[float, Field(gt=0)] = 1.0

    @property
    def sign(self) -> float:
        """1 where small is good."""
        return 1.0 if self.direction == "min" else -1.0

    def worse(self, value: float, by: float) -> float:
        """Worse value by so much in the goal's direction; infinity stays."""
        return value if math.isinf(value) else value + self.sign * by

    def as_constraint(self, value: float) -> Constraint:
        """The limit that nothing worse than a value passes."""
        low, high = (None, value) if self.sign > 0 else (value, None)
        return self.limited(low, high)

    def limited(self, low: float | None, high: float | None) -> Constraint:
        """Limits on its quantity; an infinite one is that it is infinite, or not beyond."""
        asked = {"at": self.at, "field": self.field, "temperature": self.temperature}
        return Constraint(quantity=self.quantity, **asked, min=low, max=high)
