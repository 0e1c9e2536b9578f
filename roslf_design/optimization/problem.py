"""A design problem: what may vary, what must hold, what is wanted; as smooth numbers for an optimiser.

Scaling. Variables run from 0 to 1 between their bounds. A limit on what is positive becomes the logarithm of its ratio
to the limit, so that 1e-3 means 0.1 %; on what may be zero or negative, a difference in units of the quantity's own
spread over the box. Goals are merged likewise: the merit is the weighted mean of the logarithms, so a weight says what
one per cent of a goal is worth against one per cent of another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from operator import itemgetter
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, InstanceOf, ValidationInfo, field_validator, model_validator

from .._arrays import Array
from ..bore.conjugates import CONJUGATES, follower
from ..bore.part import TEMPERATURE
from ..camera import TIP, VIEWING_CONDITIONS, Camera, Number
from ..design import PATHS, Design
from ..lenses.glass import Glass
from ..theory.f_number import inverse_fill_factor
from ..theory.light import SensorField
from ..theory.quantities import quantity_named
from ..theory.quantity import Quantity
from ..theory.stop_images import MicrolensImages
from ..theory.tube import housed
from ..theory.vignetting import field_margins
from ..tolerancing.draws import sobol_points
from ..toml_files import StrictTable, nearest
from ..units import AnyLength, Length, Temperature, format_quantity, in_file
from ..words import number as in_digits
from .lens_variables import BENDING, FOCAL, VariedLens
from .main_lens import IdealLensSearch, lens_search
from .search import BIG
from .traces import Field as ArrayPlace
from .traces import FieldTraces

Side = Literal["min", "max", "equal"]
SIGNS: Mapping[Side, str] = {"min": ">=", "max": "<=", "equal": "="}

ROOM = 1e-6
"""Relative distance kept from cameras that are none: d_f = f, the focal plane inside the bore, images of no pitch."""

TRIED = 8
"""Places that are looked at for each start behind a real lens."""

LOG_ABOVE = 4.0
"""Ratio of bounds from which a variable is scaled by its logarithm."""

DERIVED = {
    "working_distance": "from the bore's tip (the farthest of FAP, stops and elements) to the focal plane; sets d_f",
    "tube_length": "from the FAP, the tube's inner rim, to its outer rim, the design's last stop; moves that stop",
    "tube_diameter": "of the FAP and every further stop together",
}
"""Lengths that set several places."""


class Variable(StrictTable):
    """Bounds [mm] of a length that may change: ``["0.5 mm", "8 mm"]`` for short.

    Below 0 are those of the focal length of an element that diverges.
    """

    min: AnyLength
    max: AnyLength
    start: AnyLength | None = None
    """Start of one of the searches."""

    measured_in: ClassVar[str] = "mm"

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        if isinstance(value, (list, tuple)) and len(value) == 2:
            return {"min": value[0], "max": value[1]}
        if not isinstance(value, Mapping):
            example = '["0.5 mm", "8 mm"]' if cls.measured_in else "[-2, 2]"
            raise ValueError(f"{value!r} is no pair of bounds; write e.g. {example}")
        return value

    @model_validator(mode="after")
    def _ordered(self) -> Variable:
        if self.measured_in == "":
            shown = f"{self.min:g}", f"{self.max:g}"
        else:
            shown = format_quantity(self.min, "length"), format_quantity(self.max, "length")
        if self.min > self.max:
            raise ValueError(f"contradictory bounds: min {shown[0]} is above max {shown[1]}; swap them")
        if self.measured_in == "":
            return self
        if self.min < 0 <= self.max:
            raise ValueError(f"bounds {self.min:g} and {self.max:g} mm hold 0 between them; keep to one sign")
        if self.max == 0:
            raise ValueError("max must be greater than zero")
        return self

    @property
    def logarithmic(self) -> bool:
        """Whether it is scaled by its logarithm."""
        return self.min > 0 and self.max / self.min >= LOG_ABOVE

    def value(self, unit: Array) -> Array:
        """[mm] from the scaled value, 0 at the lower and 1 at the upper bound; exact at both."""
        if self.logarithmic:
            inside = self.min * np.exp(unit * math.log(self.max / self.min))
        else:
            inside = self.min + unit * (self.max - self.min)
        return np.where(unit == 1, self.max, inside)

    def unit(self, value: float) -> float:
        """Scaled value, clipped to the bounds."""
        value = min(max(value, self.min), self.max)
        if self.logarithmic:
            return math.log(value / self.min) / math.log(self.max / self.min)
        return (value - self.min) / ((self.max - self.min) or 1.0)

    def end(self, upper: bool) -> str:
        """A bound in words, e.g. ``<= 8 mm``."""
        side, limit = ("<=", self.max) if upper else (">=", self.min)
        return f"{side} {limit:.6g} {self.measured_in}".rstrip()

    def rate(self, unit: float) -> float:
        """Millimetres (or what it is counted in) per scaled unit, there."""
        if self.logarithmic:
            return float(self.value(np.asarray(unit))) * math.log(self.max / self.min)
        return self.max - self.min


class NumberVariable(Variable):
    """Bounds of a number without a unit that may change: ``[-2, 2]`` for short."""

    min: float
    max: float
    start: float | None = None

    measured_in: ClassVar[str] = ""

    @property
    def logarithmic(self) -> bool:
        """A number without a unit is never scaled by its logarithm."""
        return False


NUMBERS = (BENDING,)
"""Variables without a unit."""


def lengths_and_numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Lengths, and beside them a lens's shape factor where it varies."""
    lengths = {name: value for name, value in values.items() if name not in NUMBERS}
    return {"variables_mm": lengths} | ({"shape_factor": values[BENDING]} if BENDING in values else {})


def titled(title: str, kind: str) -> str:
    """A design's name after what was done to it, told once."""
    return title if title.lower().endswith(f", {kind}") else f"{title}, {kind}"


def _named(name: Any) -> Any:
    return quantity_named(name) if isinstance(name, str) else name


def _place(value: Any) -> Any:
    """A place on the array; a single length lies along x."""
    return value if value is None or isinstance(value, (list, tuple)) else (value, 0.0)


class _Asked(StrictTable):
    """A quantity, at the focal plane or ahead of the bore's tip; of single microlenses that of one."""

    quantity: Annotated[InstanceOf[Quantity], BeforeValidator(_named)]
    at: Length | None = None
    """Ahead of the bore's tip [mm]."""
    field: Annotated[tuple[AnyLength, AnyLength] | None, BeforeValidator(_place)] = None
    """Position of the microlens on the array [mm]."""
    temperature: Temperature | None = None
    """Temperature of the camera [degrees C]; the design's where left out."""

    @model_validator(mode="after")
    def _distance(self) -> _Asked:
        name = self.quantity.name
        if self.quantity.at == "needed" and self.at is None:
            raise ValueError(f'{name} needs a distance ahead of the tip; write e.g. at = "40 mm"')
        if self.quantity.at == "never" and self.at is not None:
            raise ValueError(f"{name} is not asked for at a distance; drop at")
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
    """Text with a unit for lengths, or a number in the unit that the quantity's name ends with."""
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
    def _bounded(self) -> Constraint:
        name, length = self.quantity.name, self.quantity.length
        if self.min is None and self.max is None:
            raise ValueError(f"{name} has no limit; give min, max or both")
        if self.min is not None and self.max is not None and self.min > self.max:
            low, high = (format_quantity(end, "length") if length else f"{end:g}" for end in (self.min, self.max))
            raise ValueError(f"{name}: min {low} is above max {high}; swap them")
        return self

    @property
    def limits(self) -> dict[Side, float]:
        """Side to the limit there."""
        if self.min is not None and self.min == self.max:
            return {"equal": self.min}
        given: dict[Side, float | None] = {"min": self.min, "max": self.max}
        return {side: limit for side, limit in given.items() if limit is not None}

    def limit_words(self, side: Side) -> str:
        """A limit in words, without its number, e.g. ``fill_factor <=``."""
        return f"{self.label} {SIGNS[side]}"

    def measured(self, camera: Camera, traces: FieldTraces | None = None) -> Array:
        """Values that the rows are made of: the quantity, one for each rim, or a finite stand-in.

        Of a fill factor the inverse, of the undistorted field `field_margins`.
        """
        if self.quantity.name == "fill_factor":
            whole = self.field is None
            return np.abs(inverse_fill_factor(self.warm(camera)) if whole else 1 / self.values(camera, traces))
        if self.quantity.name == UNDISTORTED:
            return field_margins(self.warm(camera))
        alone = self.quantity.worst is None or self.field is not None
        return self.judged(camera, traces) if alone else self.each(camera)

    def row(self, limit: float, sign: float, spread: float) -> tuple[Callable[[Array], Array], float]:
        """From what is measured to a row, and how much the quantity changes where that changes by 1."""
        if self.quantity.name == "fill_factor":  # linear in the inverse, where the fill factor has poles
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


End = Callable[[Camera], Number]
"""Where something ends, of every build [mm before the main lens]."""


@dataclass(frozen=True)
class _LimitRow:
    """One scalar condition: a row that must not be above 0. An equality is two of them."""

    constraint: int
    """Index among the problem's constraints; -1 for what every camera must be."""
    side: Side
    label: str
    """Label in words."""
    size: float
    """How much the quantity changes where the row changes by 1, at its limit."""
    of: Callable[[Any], Array]
    """The row, from what is `Constraint.measured`; of what every camera must be, from `_PosedBuilds`."""


class _PosedBuilds(NamedTuple):
    """Cameras, and the real lenses that they stand behind."""

    camera: Camera
    lens: VariedLens | None
    """Lenses of the builds; None: ideal ones."""


@dataclass(frozen=True)
class DesignProblem:
    """A design problem, ready to be solved."""

    name: str
    design: Design
    variables: Mapping[str, Variable]
    """By their names: a symbol of the paper, a dotted place, or one of `DERIVED`."""
    constraints: tuple[Constraint, ...]
    goals: tuple[Goal, ...]
    question: str = ""
    order: Literal["weighted", "lexicographic"] = "weighted"
    slack: float = 0.01
    """Lexicographic: share of an earlier goal that a later one may cost."""
    in_focus: bool = False
    """Whether f_ml follows the focus of the microlenses."""
    given: Mapping[str, Any] = field(default_factory=dict)
    """Values in place of the base design's: a bore (its tip among it), parts of the catalogue."""
    scales: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    """Units of the differences of constraints and of goals; None: their spread over the box."""

    @cached_property
    def base(self) -> Camera:
        """The base design, behind its bore and with its parts."""
        return Camera.of(self.design).replace({p: v for p, v in self.given.items() if not isinstance(v, (str, Glass))})

    @property
    def n(self) -> int:
        """Number of variables."""
        return len(self.variables)

    @cached_property
    def main_lens(self) -> IdealLensSearch:
        """The main lens, as searches have it."""
        return lens_search(self.design)

    @property
    def _fields(self) -> tuple[ArrayPlace, ...]:
        """Fields that goals and limits name."""
        asked = (part.field for part in (*self.goals, *self.constraints))
        return tuple(dict.fromkeys(field for field in asked if field is not None))

    @property
    def traced(self) -> bool:
        """Whether a goal or limit is told from rays through a real lens."""
        return bool(self.main_lens.traced(self._fields))

    @property
    def finest(self) -> float:
        """Change of the merit that ends a polished search: rounding, or what Newton's steps leave of traced rays."""
        return self.main_lens.finest(self._fields)

    @property
    def summed(self) -> bool:
        """Whether a goal or limit takes milliseconds: depth errors predicted from light and texture, traced rays."""
        numeric = [part.quantity for part in (*self.goals, *self.constraints) if part.quantity.numeric]
        return self.traced or any(quantity.monotone_with not in self.base.numbers for quantity in numeric)

    def _values(self, units: Array) -> dict[str, Array]:
        """Variables by their places."""
        return {PATHS.get(s, s): v.value(units[..., i]) for i, (s, v) in enumerate(self.variables.items())}

    def varied_lens(self, units: Array) -> VariedLens | None:
        """The real lens at scaled variables; None behind an ideal one."""
        return self.main_lens.varied(self._values(units))

    def values(self, units: Array) -> dict[str, Array]:
        """Place of a camera to its values [mm]; units as for `cameras`.

        Derived lengths are turned into those that they set, and what varies of a real lens into its focal length.
        """
        return _spread(self.main_lens.as_lengths(self._values(units)), self.base)

    def named(self, unit: Array) -> dict[str, float]:
        """Variable name to its value at one point [mm]."""
        return {name: float(v.value(unit[i])) for i, (name, v) in enumerate(self.variables.items())}

    def cameras(self, units: Array) -> Camera:
        """The cameras at scaled variables of shape (..., n)."""
        return self.base.replace(self.values(units), in_focus=self.in_focus)

    def following(self, unit: Array) -> dict[str, float]:
        """Lengths that follow from the variables, by symbol or place, with their value [mm] at one point.

        Of f, d_f and d_1 the third; f_ml in focus; what a derived length sets.
        """
        own, third = {PATHS.get(name, name) for name in self.variables}, follower(self._set_places)
        moved = [*self._set_places, *([third] if third else []), *([PATHS["f_ml"]] if self.in_focus else [])]
        camera, symbols = self.cameras(unit), {place: symbol for symbol, place in PATHS.items()}
        return {symbols.get(place, place): float(camera[place]) for place in dict.fromkeys(moved) if place not in own}

    def traces(self, cameras: Camera, lens: VariedLens | None = None) -> FieldTraces | None:
        """Traces at the fields of cameras behind a real lens; None where no field is asked for."""
        return self.main_lens.traces(self._fields, cameras, lens)

    def number(self, part: Constraint | Goal, unit: Array) -> float:
        """Value of a constraint's or goal's quantity at one point."""
        cameras = self.cameras(unit[None])
        return float(np.ravel(part.values(cameras, self.traces(cameras, self.varied_lens(unit[None]))))[0])

    def design_at(self, unit: Array, name: str = "") -> Design:
        """The design at one point.

        Raises
        ------
        DesignError
            The point is no design.
        """
        camera = self.cameras(unit[None])
        changed = (*self._set_places, *((PATHS["f_ml"],) if self.in_focus else ()))
        given = {place: value for place, value in self.given.items() if place != TIP}
        changes = {place: float(np.ravel(camera[place])[0]) for place in changed}
        if lens := self.main_lens.redrawn(self._values(unit)):
            changes |= lens
            changes.pop(FOCAL, None)
            if not changes.keys() & CONJUGATES[1:]:
                changes[CONJUGATES[2]] = float(np.ravel(camera.seen.d_1)[0])
        return self.design.replace({**given, **changes, "name": name or titled(self.name, "optimised")})

    @cached_property
    def rows(self) -> tuple[_LimitRow, ...]:
        """Everything that must hold: no row above 0."""
        return (*self._always(), *(row for k, c in enumerate(self.constraints) for row in self._rows_of(k, c)))

    @property
    def always(self) -> int:
        """How many of the first rows say what every camera must be."""
        return sum(row.constraint < 0 for row in self.rows)

    def _always(self) -> Iterator[_LimitRow]:
        """Rows that hold for every camera, whatever the limits."""

        def row(label: str, room: Callable[[Camera], Number]) -> _LimitRow:
            return _own(label, lambda builds: room(builds.camera))

        plane, distance = (place in self._set_places for place in CONJUGATES[1:])
        if self.base.chain.bends:
            yield row("real image: d_1 above 0", lambda c: c.seen.d_1 / c.f)
            yield row("focal plane nearer than infinity", lambda c: c.tip / c[PATHS["d_f"]])
        elif not (plane and distance):
            yield row("real image: d_f beyond f", lambda c: ((c.seen.d_f if plane else c.seen.d_1) - c.f) / c.f)
        openings = self.base.stop_openings
        for place in (
            *(f"{opening.part}.distance" for opening in openings),
            *(place for place in self.given if place == TIP),
        ):
            yield row("focal plane in front of the bore", lambda c, place=place: 1 - c[place] / c[PATHS["d_f"]])  # type: ignore[misc]
        if self.base.chain.elements:
            yield row("focal plane in front of the bore", lambda c: 1 - c.chain.end(c.numbers) / c[PATHS["d_f"]])
            for near, far, label in self._kept_apart():
                yield row(label, lambda c, near=near, far=far: (far(c) - near(c)) / c.tip)  # type: ignore[misc]
        yield row("microlens images of positive pitch", lambda c: 1 + c.seen.d_2 * c.seen.vergence)
        values = self._values(np.full(self.n, 0.5))
        for label, room in self.main_lens.rooms(values, (*self._set_places, *self.given)):
            yield _own(label, lambda builds, room=room: room(*builds))  # type: ignore[misc]

    def _kept_apart(self) -> Iterator[tuple[End, End, str]]:
        """Pairs of ends that must not overlap: elements, stops and elements, in the order of the base design."""
        base, chain = self.base, self.base.chain
        named = [at.name for at in self.design.in_bore]

        def ends(k: int) -> tuple[End, End]:
            start = f"elements.{k}.distance"
            return itemgetter(start), lambda c: c[start] + chain.length(c.numbers, k)

        moved = {place.rpartition(".")[0] for place in (*self._set_places, *self.given)}
        for k, farther in pairwise(chain.order):
            if moved & {f"elements.{k}", f"elements.{farther}"}:
                yield ends(k)[1], ends(farther)[0], f"{named[k]} clear of {named[farther]}"
        for rim in base.stop_openings:
            stop: End = itemgetter(f"{rim.part}.distance")
            for k in chain.order:
                if moved & {rim.part, f"elements.{k}"}:
                    start, end = ends(k)
                    before = rim.ruler_distance <= (start(base) + end(base)) / 2
                    yield *((stop, start) if before else (end, stop)), f"{rim.name} clear of {named[k]}"

    def _rows_of(self, index: int, constraint: Constraint) -> Iterator[_LimitRow]:
        worst = constraint.quantity.worst if constraint.field is None else None
        widest = constraint.quantity.name in ("largest_diameter_mm", "outer_diameter_mm")
        rims = [f" ({rim.name})" for rim in self.base.rims]
        if widest:
            housing = constraint.quantity.name == "outer_diameter_mm"
            openings = [rim for rim in self.base.openings if rim.size_places]
            rims = [f" ({part.name})" for part in housed(self.base)] if housing else [""] * len(openings)
        for side, limit in constraint.limits.items():
            words = f"{SIGNS[side]} {constraint.with_unit(limit)}"
            for end in ("min", "max") if side == "equal" else (side,):
                row, size = constraint.row(limit, 1.0 if end == "max" else -1.0, self._spreads[0][index])
                if worst is None:
                    yield _LimitRow(index, side, f"{constraint.label} {words}", size, row)
                elif end == ("max" if widest else "min"):
                    # All of several values must hold: each is a smooth row of its own, where their worst has kinks.
                    for k, rim in enumerate(rims):
                        label = f"{constraint.label}{rim} {words}"
                        yield _LimitRow(index, side, label, size, _after(row, itemgetter(k)))
                else:
                    whole = row if constraint.quantity.name == UNDISTORTED else _after(row, worst)
                    yield _LimitRow(index, side, f"{constraint.label} {words}", size, whole)

    @cached_property
    def _set_places(self) -> tuple[str, ...]:
        return tuple(self.values(np.zeros(self.n)))

    @cached_property
    def _spreads(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Spread of each constraint's and each goal's quantity over the box, unless given."""
        if self.scales is not None:
            return self.scales
        with np.errstate(all="ignore"):
            units = sobol_units(self.n, 64, 0)
            cameras = self.cameras(units)
            traces = self.traces(cameras, self.varied_lens(units))
            limited = tuple(_spread_of(constraint.judged(cameras, traces)) for constraint in self.constraints)
            return limited, tuple(_spread_of(goal.judged(cameras, traces)) for goal in self.goals)

    def vector(self, units: Array) -> Array:
        """Merit and rows, shape (1 + rows, N), for units (N, n); not finite where there is no such number."""
        with np.errstate(all="ignore"):
            cameras, lens = self.cameras(units), self.varied_lens(units)
            result = np.empty((1 + len(self.rows), len(units)))
            traces = self.traces(cameras, lens)
            result[0] = self.merit(cameras, traces)
            result[1:] = self.rows_of(cameras, len(units), traces, lens)
        return result

    def rows_of(
        self, cameras: Camera, count: int, traces: FieldTraces | None = None, lens: VariedLens | None = None
    ) -> Array:
        """Rows of so many cameras, these or builds of a design behind an ideal lens; shape (rows, N)."""
        result = np.empty((len(self.rows), count))
        with np.errstate(all="ignore"):
            values = [constraint.measured(cameras, traces) for constraint in self.constraints]
            measured = [*values, _PosedBuilds(cameras, lens)]
            for number, row in enumerate(self.rows):
                result[number] = row.of(measured[row.constraint])
        return result

    def merit(self, cameras: Camera, traces: FieldTraces | None = None) -> Array:
        """Weighted mean of the goals, small is good, 0 without goals; shape (N,)."""
        total: Array = np.zeros(())
        for goal, scale in zip(self.goals, self._spreads[1], strict=True):
            value = goal.judged(cameras, traces)
            if goal in self._bent:
                value = np.minimum(value, 0.0)  # infinite is infinite, however far beyond
            counted = goal.sign * (np.log(value) if goal.quantity.positive else value / scale)
            total = total + goal.weight * np.maximum(counted, -BIG)  # a field without end is the best, and a number
        return total / (sum(goal.weight for goal in self.goals) or 1.0)

    @cached_property
    def _bent(self) -> tuple[Goal, ...]:
        """Goals that have a kink where they become infinite: no limit keeps them finite.

        To a single goal that is to be small what lies beyond shows the way back.
        """
        finite = {constraint.label for constraint in self.constraints if constraint.max is not None}
        alone = len(self.goals) == 1
        return tuple(
            goal
            for goal in self.goals
            if goal.quantity.past_infinity is not None and goal.label not in finite and not (alone and goal.sign > 0)
        )

    def sides(self) -> Iterator[DesignProblem]:
        """Smooth problems on both sides of each kink of the merit.

        A goal kept finite, and infinite, where it is none.
        """
        limited, wanted = self._spreads
        for goal in self._bent if len(self.goals) > 1 else ():
            k = self.goals.index(goal)
            near, beyond = ((*self.constraints, goal.limited(*ends)) for ends in ((None, math.inf), (math.inf, None)))
            scales, rest = (*limited, wanted[k]), (*wanted[:k], *wanted[k + 1 :])
            yield replace(self, constraints=near, scales=(scales, wanted))
            yield replace(
                self, constraints=beyond, goals=(*self.goals[:k], *self.goals[k + 1 :]), scales=(scales, rest)
            )

    def with_scales(self) -> DesignProblem:
        """Problem with its present scales written down, so that merits on other parts compare."""
        return replace(self, scales=self._spreads)

    def goal_scale(self, goal: int) -> float:
        """Unit in which a goal of either sign is counted."""
        return self._spreads[1][goal]

    def without(self, keep: frozenset[int]) -> DesignProblem:
        """Problem with only some of its constraints."""
        scales = self.scales and (tuple(s for i, s in enumerate(self.scales[0]) if i in keep), self.scales[1])
        return replace(self, constraints=tuple(c for i, c in enumerate(self.constraints) if i in keep), scales=scales)

    def without_goals(self) -> DesignProblem:
        """Problem with its limits and no goals."""
        return replace(self, goals=(), scales=self.scales and (self.scales[0], ()))


def _own(label: str, room: Callable[[_PosedBuilds], Number]) -> _LimitRow:
    """Row of a clearance that no camera may have below 0."""
    return _LimitRow(-1, "min", label, 1.0, lambda builds: np.asarray(ROOM - room(builds)))


def _after(row: Callable[[Array], Array], pick: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda measured: row(pick(measured))


def sobol_units(n: int, count: int, seed: int) -> Array:
    """Points of a scrambled Sobol sequence, shape (count, n), each inside (0, 1)."""
    return np.ascontiguousarray(sobol_points(n, 0, count, seed).T)


def promising_starts(problem: DesignProblem, starts: Sequence[Array], count: int, seed: int) -> list[Array]:
    """So many of some starts: behind a real lens those first where its rays come through, others in place of the rest.

    Where an image is folded or dark there is no number to go by, and a search that begins there ends there.
    """
    if not problem.traced or not problem.n:
        return list(starts)[:count]
    every = [*starts, *sobol_units(problem.n, TRIED * count, seed + 1)]
    values = problem.vector(np.clip(np.stack(every), 0.0, 1.0))
    order = np.argsort(~np.isfinite(values).all(axis=0), kind="stable")
    return [every[k] for k in order[:count]]


IDLE = (".tilt.", ".wedge.", ".rotation", "microlens_array.decentre", "sensor.decentre")
"""In places that no quantity of a straight camera depends on."""


def name_faults(names: Sequence[str], numbers: Mapping[str, Number], own: Sequence[str] = ()) -> Iterator[str]:
    """Faults of variables' names: unknown, or setting a place twice.

    In a design with these numbers, and a real lens with places of its `own`.
    """
    idle = (*IDLE, ".turn", "decentre", "relay", ".index", ".gradient", "tube.", "environment.")
    built = [place for place in numbers if "." in place and place not in VIEWING_CONDITIONS]
    lengths = [place for place in built if not any(word in place for word in idle)]
    known = dict.fromkeys([*PATHS, *lengths, *DERIVED, *own])
    for name in names:
        if name not in known:
            yield f"'{name}' is nothing that can vary; {nearest(name, known)}"
        elif name == "tube_length" and "stops.0.distance" not in numbers:
            yield "'tube_length' needs a design with a further stop, the tube's outer rim; add [[stops]] to it"
    places = [PATHS.get(name, name) for name in names]
    yield from (f"'{place}' varies twice; name it once" for place in dict.fromkeys(places) if places.count(place) > 1)
    focal, plane, distance = (place in places for place in CONJUGATES)
    ahead, tube = "working_distance" in places, "tube_diameter" in places
    rim = any(p == "aperture.diameter" or (p.startswith("stops.") and "diameter" in p) for p in places)
    clashes = {
        "f, d_f and d_1 cannot all vary: two of them give the third; drop one": focal and plane and distance,
        "'working_distance' sets d_f, which varies too; drop one of them": ahead and plane,
        "'working_distance', f and d_1 cannot all vary: two of them give the third; drop one": (
            ahead and focal and distance
        ),
        "'tube_diameter' sets the FAP's and every stop's diameter, one of which varies too; drop one": tube and rim,
    }
    yield from (words for words, clash in clashes.items() if clash)


def _spread(values: Mapping[str, Array], base: Camera) -> dict[str, Array]:
    """Numbers at places, with derived lengths turned into those that they set."""
    result = {name: value for name, value in values.items() if name not in DERIVED}
    stops = [opening.part for opening in base.stop_openings]
    if "tube_diameter" in values:
        result |= {f"{part}.diameter": values["tube_diameter"] for part in stops}
    d_3 = result.get("aperture.distance", base["aperture.distance"])
    if "tube_length" in values:
        result[f"{stops[-1]}.distance"] = d_3 + values["tube_length"]
    if "working_distance" in values:
        tip = base[TIP]
        for stop in stops:
            tip = np.maximum(tip, result.get(f"{stop}.distance", base[f"{stop}.distance"]))
        tip = np.maximum(tip, base.chain.end({**base.numbers, **result}))
        result[CONJUGATES[1]] = tip + values["working_distance"]
    return result


def _spread_of(values: Array) -> float:
    finite = np.ravel(values)[np.isfinite(np.ravel(values))]
    if not finite.size:
        return 1.0
    middle = np.median(finite)
    return float(np.median(np.abs(finite - middle))) or float(abs(middle)) or 1.0
