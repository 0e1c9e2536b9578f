"""A design problem: what may vary, what must hold, what is wanted; as smooth numbers for an optimiser.

Scaling. Variables run from 0 to 1 between their bounds. A limit on what is positive becomes the logarithm of its ratio
to the limit, so that 1e-3 means 0.1 %; on what may be zero or negative, a difference in units of the quantity's own
spread over the box. Goals are merged likewise: the merit is the weighted mean of the logarithms, so a weight says what
one per cent of a goal is worth against one per cent of another.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..camera import TIP, Camera, Number
from ..design import PATHS, Design
from ..design.conjugates import CONJUGATES
from ..theory.f_number import inverse_fill_factor
from ..theory.quantities import Quantity
from ..tolerancing.draws import sobol_points

Array = NDArray[np.float64]

Direction = Literal["min", "max"]
Side = Literal["min", "max", "equal"]
SIGNS: Mapping[Side, str] = {"min": ">=", "max": "<=", "equal": "="}

ROOM = 1e-6
"""Relative distance kept from cameras that are none: d_f = f, the focal plane inside the bore, images of no pitch."""

LOG_ABOVE = 4.0
"""Ratio of bounds from which a variable is scaled by its logarithm."""

DERIVED = {
    "working_distance": "from the bore's tip (the farthest of FAP and stops) to the focal plane; sets d_f",
    "tube_length": "from the FAP, the tube's inner rim, to its outer rim, the design's last stop; moves that stop",
    "tube_diameter": "of the FAP and every further stop together",
}
"""Lengths that set several places."""


@dataclass(frozen=True)
class Variable:
    """A length that may change within bounds [mm]."""

    name: str
    """As written in the study: a symbol of the paper, a dotted place, or one of `DERIVED`."""
    low: float
    high: float
    start: float | None = None
    """Where one search starts; None leaves it to the Sobol points."""

    @property
    def place(self) -> str:
        """Dotted place in the design, or the derived name."""
        return PATHS.get(self.name, self.name)

    @property
    def logarithmic(self) -> bool:
        """Whether it is scaled by its logarithm."""
        return self.low > 0 and self.high / self.low >= LOG_ABOVE

    def value(self, unit: Array) -> Array:
        """[mm] from the scaled value, 0 at the lower and 1 at the upper bound; exact at both."""
        if self.logarithmic:
            inside = self.low * np.exp(unit * math.log(self.high / self.low))
        else:
            inside = self.low + unit * (self.high - self.low)
        return np.where(unit == 1, self.high, inside)

    def unit(self, value: float) -> float:
        """Scaled value, clipped to the bounds."""
        if self.high == self.low:
            return 0.0
        value = min(max(value, self.low), self.high)
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def rate(self, unit: float) -> float:
        """Millimetres per scaled unit, there."""
        if self.logarithmic:
            return float(self.value(np.asarray(unit))) * math.log(self.high / self.low)
        return self.high - self.low


class _Asked:
    """A quantity, at the focal plane or at a distance."""

    quantity: Quantity
    at: float | None

    @property
    def label(self) -> str:
        """E.g. ``sigma_z_mm at 40 mm``."""
        return self.quantity.name if self.at is None else f"{self.quantity.name} at {self.at:g} mm"

    def values(self, camera: Camera) -> Array:
        """The quantity itself, of every build; of several rims that of the worst."""
        return self.quantity(camera, self.at)

    def each(self, camera: Camera) -> Array:
        """The same, or (K, ...) of each of several rims; of the magnitude of something of either sign, that."""
        assert self.quantity.of is not None
        return (self.quantity.signed or self.quantity.of)(camera, self.at)

    def with_unit(self, number: float, digits: int = 6) -> str:
        """A value in words, e.g. ``1.5 mm``."""
        return f"{number:.{digits}g} {self.quantity.unit}".rstrip()


@dataclass(frozen=True)
class Constraint(_Asked):
    """A quantity held between limits; equal where both are the same."""

    quantity: Quantity
    low: float | None = None
    high: float | None = None
    at: float | None = None
    """Ahead of the bore's tip [mm]."""

    @property
    def sides(self) -> tuple[Side, ...]:
        """Which limits there are."""
        if self.low is not None and self.low == self.high:
            return ("equal",)
        given: tuple[tuple[Side, float | None], ...] = (("min", self.low), ("max", self.high))
        return tuple(side for side, limit in given if limit is not None)

    def limit(self, side: Side) -> float:
        """The limit on a side."""
        value = self.high if side == "max" else self.low
        assert value is not None
        return value

    def measured(self, camera: Camera) -> Array:
        """What its rows are made of: the quantity, of each rim where there are several, or a fill factor's inverse."""
        if self.quantity.name == "fill_factor":
            return inverse_fill_factor(camera)
        return self.values(camera) if self.quantity.worst is None else self.each(camera)

    def row(self, side: Side, spread: float) -> tuple[Callable[[Array], Array], float]:
        """From what is measured to a row, and how much the quantity changes where that changes by 1."""
        limit, sign = self.limit(side), -1.0 if side == "min" else 1.0
        if self.quantity.name == "fill_factor":  # linear in the inverse, where the fill factor has poles
            return lambda inverse: sign * (1 - limit * inverse), limit
        if self.quantity.positive and limit > 0:
            return lambda value: sign * np.log(value / limit), limit
        return lambda value: sign * (value - limit) / spread, spread

    def __str__(self) -> str:
        if len(self.sides) == 2:
            return f"{self.low:.6g} <= {self.label} <= {self.with_unit(self.limit('max'))}"
        side = self.sides[0]
        return f"{self.label} {SIGNS[side]} {self.with_unit(self.limit(side))}"


@dataclass(frozen=True)
class Goal(_Asked):
    """A quantity to make small or large."""

    quantity: Quantity
    direction: Direction
    at: float | None = None
    weight: float = 1.0

    @property
    def sign(self) -> float:
        """1 where small is good."""
        return 1.0 if self.direction == "min" else -1.0

    def held(self, value: float) -> Constraint:
        """The limit that nothing worse than a value passes."""
        low, high = (None, value) if self.sign > 0 else (value, None)
        return Constraint(self.quantity, low, high, self.at)


@dataclass(frozen=True)
class LimitRow:
    """One scalar condition: a row, not above 0 or, of an equality, 0."""

    constraint: int
    """Index among the problem's constraints; -1 for what every camera must be."""
    side: Side
    label: str
    """In words."""
    size: float
    """How much the quantity changes where the row changes by 1, at its limit."""
    of: Callable[[Camera, Array], Array]
    """The row, from cameras and what of them is `Constraint.measured`."""


@dataclass(frozen=True)
class DesignProblem:
    """A design problem, ready to be solved."""

    name: str
    design: Design
    variables: tuple[Variable, ...]
    constraints: tuple[Constraint, ...]
    goals: tuple[Goal, ...]
    question: str = ""
    order: Literal["weighted", "lexicographic"] = "weighted"
    slack: float = 0.01
    """Lexicographic: share of an earlier goal that a later one may cost."""
    in_focus: bool = False
    """Whether f_ml follows the focus of the microlenses."""
    tip: float = 0.0
    """Where the bore ends, where it is more than the design shows [mm before the main lens]."""
    scales: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    """What differences of constraints and goals are counted in; None: their spread over the box."""

    @cached_property
    def base(self) -> Camera:
        """The base design, behind its bore."""
        return Camera.of(self.design, {TIP: self.tip} if self.tip else {})

    @property
    def n(self) -> int:
        """How many variables."""
        return len(self.variables)

    def values(self, units: Array) -> dict[str, Array]:
        """Variable name's place to its values [mm], for scaled variables of shape (N, n)."""
        return {variable.place: variable.value(units[:, i]) for i, variable in enumerate(self.variables)}

    def named(self, unit: Array) -> dict[str, float]:
        """Variable name to its value at one point [mm]."""
        return {variable.name: float(variable.value(unit[i])) for i, variable in enumerate(self.variables)}

    def cameras(self, units: Array) -> Camera:
        """The cameras at scaled variables of shape (N, n)."""
        return self.base.replace(spread(self.values(units), self.base), in_focus=self.in_focus)

    def number(self, part: Constraint | Goal, unit: Array) -> float:
        """Value of a constraint's or goal's quantity at one point."""
        return float(np.ravel(part.values(self.cameras(unit[None])))[0])

    def design_at(self, unit: Array, name: str = "") -> Design:
        """The design at one point.

        Raises
        ------
        DesignError
            The point is no design.
        """
        camera = self.cameras(unit[None])
        changed = (*self._set_places, *((PATHS["f_ml"],) if self.in_focus else ()))
        changes = {place: float(np.ravel(camera[place])[0]) for place in changed}
        return self.design.replace({**changes, "name": name or f"{self.name}, optimised"})

    @cached_property
    def rows(self) -> tuple[LimitRow, ...]:
        """Inequalities (rows that must not be above 0), then equalities."""
        every = [*self._always(), *(row for k, c in enumerate(self.constraints) for row in self._rows_of(k, c))]
        return tuple(sorted(every, key=lambda row: row.side == "equal"))

    @property
    def equalities(self) -> int:
        """How many rows must be 0: the last ones."""
        return sum(row.side == "equal" for row in self.rows)

    def _always(self) -> Iterator[LimitRow]:
        """What every camera must be, whatever the limits."""

        def row(label: str, room: Callable[[Camera], Number]) -> LimitRow:
            return LimitRow(-1, "min", label, 1.0, lambda camera, _: np.asarray(ROOM - room(camera)))

        plane, distance = (place in self._set_places for place in CONJUGATES[1:])
        if not (plane and distance):
            yield row("real image: d_f beyond f", lambda c: ((c.d_f if plane else c.d_1) - c.f) / c.f)
        yield row("focal plane in front of the bore", lambda c: 1 - (c.tip if self.tip else c.d_3) / c.d_f)
        for k in range(1, 1 + self.base.stops):
            yield row("focal plane in front of the bore", lambda c, k=k: 1 - c.rims[k].distance / c.d_f)  # type: ignore[misc]
        yield row("microlens images of positive pitch", lambda c: 1 + c.d_2 * c.vergence)

    def _rows_of(self, index: int, constraint: Constraint) -> Iterator[LimitRow]:
        worst = constraint.quantity.worst
        widest = constraint.quantity.name == "largest_diameter_mm"
        rims = [""] * (2 + self.base.stops) if widest else [f" ({rim.name})" for rim in self.base.rims]
        for side in constraint.sides:
            row, size = constraint.row(side, self._spreads[0][index])
            words = f"{SIGNS[side]} {constraint.with_unit(constraint.limit(side))}"
            if worst is not None and side == ("max" if widest else "min"):
                # All of several values must hold: each is a smooth row of its own, where their worst has kinks.
                for k, rim in enumerate(rims):
                    yield LimitRow(index, side, f"{constraint.label}{rim} {words}", size, _after(row, itemgetter(k)))
            else:
                yield LimitRow(index, side, f"{constraint.label} {words}", size, _after(row, worst or np.asarray))

    @cached_property
    def _set_places(self) -> tuple[str, ...]:
        return tuple(spread({variable.place: np.zeros(1) for variable in self.variables}, self.base))

    @cached_property
    def _spreads(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Spread of each constraint's and each goal's quantity over the box, unless given."""
        if self.scales is not None:
            return self.scales
        with np.errstate(all="ignore"):
            cameras = self.cameras(sobol_units(self.n, 64, 0))
            limited = tuple(_spread_of(constraint.values(cameras)) for constraint in self.constraints)
            return limited, tuple(_spread_of(goal.values(cameras)) for goal in self.goals)

    def vector(self, units: Array) -> Array:
        """Merit, inequality and equality rows, shape (1 + rows, N); not finite where there is no such number."""
        with np.errstate(all="ignore"):
            cameras = self.cameras(units)
            result = np.empty((1 + len(self.rows), len(units)))
            result[0] = self.merit(cameras)
            self._fill(result[1:], cameras)
        return result

    def rows_of(self, cameras: Camera) -> Array:
        """Rows of cameras made elsewhere (builds of a design), shape (rows, N); equalities as magnitudes."""
        with np.errstate(all="ignore"):
            result = np.empty((len(self.rows), *cameras.shape))
            self._fill(result, cameras)
        equal = slice(len(result) - self.equalities, None)
        result[equal] = np.abs(result[equal])
        return result

    def _fill(self, result: Array, cameras: Camera) -> None:
        values = [*(constraint.measured(cameras) for constraint in self.constraints), np.empty(0)]
        for number, row in enumerate(self.rows):
            result[number] = row.of(cameras, values[row.constraint])

    def merit(self, cameras: Camera) -> Array:
        """Weighted mean of the goals, small is good; shape (N,)."""
        total: Array = np.zeros(())
        for goal, scale in zip(self.goals, self._spreads[1], strict=True):
            value = goal.values(cameras)
            total = total + goal.weight * goal.sign * (np.log(value) if goal.quantity.positive else value / scale)
        return total / sum(goal.weight for goal in self.goals)

    def with_scales(self) -> DesignProblem:
        """The same problem with its scales written down, so that merits on other parts compare."""
        return replace(self, scales=self._spreads)

    def goal_scale(self, goal: int) -> float:
        """What a goal of either sign is counted in."""
        return self._spreads[1][goal]

    def without(self, keep: frozenset[int]) -> DesignProblem:
        """The same problem with only some of its constraints."""
        return replace(self, constraints=tuple(c for i, c in enumerate(self.constraints) if i in keep))


def _after(row: Callable[[Array], Array], pick: Callable[[Array], Array]) -> Callable[[Camera, Array], Array]:
    return lambda _, measured: row(pick(measured))


def sobol_units(n: int, count: int, seed: int) -> Array:
    """Points of a scrambled Sobol sequence, shape (count, n), each inside (0, 1)."""
    return np.ascontiguousarray(sobol_points(n, 0, count, seed).T)


IDLE = (".tilt.", ".rotation", "microlens_array.decentre", "sensor.decentre")
"""In places that no quantity of a straight camera depends on."""


def check_name(name: str, numbers: Mapping[str, Number]) -> None:
    """Refuse a name that is no variable of a design with these numbers.

    Raises
    ------
    ValueError
        Names the nearest.
    """
    lengths = [
        place for place in numbers if "." in place and not any(word in place for word in (*IDLE, "decentre", "relay"))
    ]
    derived = [each for each in DERIVED if each != "tube_length" or "stops.0.distance" in numbers]
    known = (*PATHS, *(place for place in lengths if place not in PATHS.values()), *derived, *PATHS.values())
    if name in known:
        return
    if name == "tube_length":
        raise ValueError("'tube_length' needs a design with a further stop, the tube's outer rim; add [[stops]] to it")
    lowered = {each.lower(): each for each in known}
    near = difflib.get_close_matches(name.lower(), lowered, 1, 0.4)
    remedy = f"did you mean '{lowered[near[0]]}'?" if near else f"known are {', '.join(known)}"
    raise ValueError(f"'{name}' is nothing that can vary; {remedy}")


def check_together(names: Sequence[str]) -> None:
    """Refuse variables that set the same place twice.

    Raises
    ------
    ValueError
        Says which.
    """
    places = [PATHS.get(name, name) for name in names]
    for place in places:
        if places.count(place) > 1:
            raise ValueError(f"'{place}' varies twice; name it once")
    focal, plane, distance = (place in places for place in CONJUGATES)
    if focal and plane and distance:
        raise ValueError("f, d_f and d_1 cannot all vary: two of them give the third; drop one")
    if "working_distance" in places and plane:
        raise ValueError("'working_distance' sets d_f, which varies too; drop one of them")
    if "working_distance" in places and focal and distance:
        raise ValueError("'working_distance', f and d_1 cannot all vary: two of them give the third; drop one")
    own = any(p == "aperture.diameter" or (p.startswith("stops.") and "diameter" in p) for p in places)
    if "tube_diameter" in places and own:
        raise ValueError("'tube_diameter' sets the FAP's and every stop's diameter, one of which varies too; drop one")


def spread(values: Mapping[str, Array], base: Camera) -> dict[str, Array]:
    """Numbers at places, with derived lengths turned into those that they set."""
    result = {name: value for name, value in values.items() if name not in DERIVED}
    stops = [f"stops.{k}" for k in range(base.stops)]
    if "tube_diameter" in values:
        result |= {f"{part}.diameter": values["tube_diameter"] for part in ("aperture", *stops)}
    d_3 = result.get("aperture.distance", base.d_3)
    if "tube_length" in values:
        result[f"{stops[-1]}.distance"] = d_3 + values["tube_length"]
    if "working_distance" in values:
        tip = np.maximum(d_3, base[TIP])
        for stop in stops:
            tip = np.maximum(tip, result.get(f"{stop}.distance", base[f"{stop}.distance"]))
        result[CONJUGATES[1]] = tip + values["working_distance"]
    return result


def _spread_of(values: Array) -> float:
    finite = np.ravel(values)[np.isfinite(np.ravel(values))]
    if not finite.size:
        return 1.0
    middle = np.median(finite)
    return float(np.median(np.abs(finite - middle))) or float(abs(middle)) or 1.0
