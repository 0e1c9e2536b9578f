"""A design problem: what may vary, what must hold, what is wanted; as smooth numbers for an optimiser.

Scaling. Variables run from 0 to 1 between their bounds. A limit on what is positive becomes the logarithm of its ratio
to the limit, so that 1e-3 means 0.1 %; on what may be zero or negative, a difference in units of the quantity's own
spread over the box. Goals are merged likewise: the merit is the weighted mean of the logarithms, so a weight says what
one per cent of a goal is worth against one per cent of another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..design.check import CONJUGATES
from .cameras import TIP, Cameras, places_of
from .quantities import Quantity
from .sampling import sobol_units
from .variables import Variable, spread

Array = NDArray[np.float64]

Direction = Literal["min", "max"]
Side = Literal["min", "max", "equal"]

ROOM = 1e-6
"""Relative distance kept from cameras that are none: d_f = f, the focal plane inside the bore, images of no pitch."""


@dataclass(frozen=True)
class Constraint:
    """A quantity held between limits; equal where both are the same."""

    quantity: Quantity
    low: float | None = None
    high: float | None = None
    at: float | None = None
    """Ahead of the bore's tip [mm]."""

    @property
    def label(self) -> str:
        """E.g. ``sigma_z_mm at 40 mm``."""
        return self.quantity.name if self.at is None else f"{self.quantity.name} at {self.at:g} mm"

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

    def values(self, cameras: Cameras) -> Array:
        """The quantity itself, shape (N,)."""
        found = self.quantity.of(cameras, self.at)
        return found if self.quantity.worst is None else self.quantity.worst(found)


@dataclass(frozen=True)
class Goal:
    """A quantity to make small or large."""

    quantity: Quantity
    direction: Direction
    at: float | None = None
    weight: float = 1.0

    @property
    def label(self) -> str:
        """E.g. ``sigma_z_mm at 40 mm``."""
        return self.quantity.name if self.at is None else f"{self.quantity.name} at {self.at:g} mm"

    @property
    def sign(self) -> float:
        """1 where small is good."""
        return 1.0 if self.direction == "min" else -1.0

    def values(self, cameras: Cameras) -> Array:
        """The quantity itself, shape (N,)."""
        found = self.quantity.of(cameras, self.at)
        return found if self.quantity.worst is None else self.quantity.worst(found)


@dataclass(frozen=True)
class Row:
    """One scalar condition that a constraint gives."""

    constraint: int
    """Index among the problem's constraints; -1 for what every camera must be."""
    side: Side
    component: int | None = None
    """Of a quantity with several values (one a rim)."""
    note: str = ""


DOMAIN = ("real image: d_f beyond f", "focal plane in front of the bore", "microlens images of positive pitch")


@dataclass(frozen=True)
class Problem:
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
    def places(self) -> Mapping[str, float]:
        """The base design's numbers."""
        return {**places_of(self.design), TIP: self.tip}

    @property
    def n(self) -> int:
        """How many variables."""
        return len(self.variables)

    def values(self, units: Array) -> dict[str, Array]:
        """Variable name's place to its values [mm], for scaled variables of shape (N, n)."""
        return {variable.place: variable.value(units[:, i]) for i, variable in enumerate(self.variables)}

    def cameras(self, units: Array) -> Cameras:
        """The cameras at scaled variables of shape (N, n)."""
        return Cameras(self.places, spread(self.values(units), self.places), in_focus=self.in_focus)

    def design_at(self, unit: Array, name: str = "") -> Design:
        """The design at one point.

        Raises
        ------
        DesignError
            The point is no design.
        """
        changes = {place: float(value[0]) for place, value in spread(self.values(unit[None]), self.places).items()}
        if self.in_focus:
            changes["microlens_array.focal_length"] = float(np.ravel(self.cameras(unit[None]).f_ml)[0])
        return self.design.replace({**changes, "name": name or f"{self.name}, optimised"})

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """Inequalities (rows that must not be above 0), then equalities."""
        every = tuple(self._rows())
        return (*(row for row in every if row.side != "equal"), *(row for row in every if row.side == "equal"))

    @property
    def equalities(self) -> int:
        """How many rows must be 0: the last ones."""
        return sum(row.side == "equal" for row in self.rows)

    def _rows(self) -> Iterator[Row]:
        stops = 1 + len(self.design.stops)
        if not {CONJUGATES[1], CONJUGATES[2]} <= set(self._set_places):
            yield Row(-1, "min", None, DOMAIN[0])
        yield from (Row(-1, "min", k, DOMAIN[1]) for k in range(stops))
        yield Row(-1, "min", None, DOMAIN[2])
        for index, constraint in enumerate(self.constraints):
            for side in constraint.sides:
                if self._apart(constraint, side):
                    yield from (
                        Row(index, side, k) for k in range(stops + (constraint.quantity.name == "largest_diameter_mm"))
                    )
                else:
                    yield Row(index, side)

    def _apart(self, constraint: Constraint, side: Side) -> bool:
        """Whether each of several values gives a smooth row of its own."""
        kind = "max" if constraint.quantity.name == "largest_diameter_mm" else "min"
        return constraint.quantity.worst is not None and side == kind

    @cached_property
    def _set_places(self) -> tuple[str, ...]:
        zero = {variable.place: np.zeros(1) for variable in self.variables}
        return tuple(spread(zero, self.places))

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
            found = np.empty((1 + len(self.rows), len(units)))
            found[0] = self.merit(cameras)
            self._fill(found[1:], cameras)
        return found

    def rows_of(self, cameras: Cameras) -> Array:
        """Rows of cameras made elsewhere (builds of a design), shape (rows, N); equalities as magnitudes."""
        with np.errstate(all="ignore"):
            length = np.broadcast_shapes(cameras.d_1.shape, cameras.D_F.shape, cameras.d.shape, cameras.d_2.shape, (1,))
            parts = [np.shape(constraint.values(cameras)) for constraint in self.constraints]
            found = np.empty((len(self.rows), *np.broadcast_shapes(length, *parts)))
            self._fill(found, cameras)
        found[len(found) - self.equalities :] = np.abs(found[len(found) - self.equalities :])
        return found

    def _fill(self, found: Array, cameras: Cameras) -> None:
        kept: dict[int, Array] = {}
        for number, row in enumerate(self.rows):
            found[number] = self._domain(row, cameras) if row.constraint < 0 else self._row(row, cameras, kept)

    def merit(self, cameras: Cameras) -> Array:
        """Weighted mean of the goals, small is good; shape (N,)."""
        total: Array = np.zeros(())
        for goal, scale in zip(self.goals, self._spreads[1], strict=True):
            value = goal.values(cameras)
            total = total + goal.weight * goal.sign * (np.log(value) if goal.quantity.positive else value / scale)
        return total / sum(goal.weight for goal in self.goals)

    def _domain(self, row: Row, c: Cameras) -> Array:
        if row.note == DOMAIN[0]:
            by_plane = CONJUGATES[1] in self._set_places
            return ROOM - ((c.d_f - c.f) / c.f if by_plane else (c.d_1 - c.f) / c.f)
        if row.note == DOMAIN[2]:
            return ROOM - (1 + c.d_2 * c.vergence)
        stop = (
            (c.tip if self.tip else c.d_3) if row.component == 0 else c.at(f"stops.{(row.component or 0) - 1}.distance")
        )
        return ROOM - (1 - stop / c.d_f)

    def _row(self, row: Row, c: Cameras, kept: dict[int, Array]) -> Array:
        constraint = self.constraints[row.constraint]
        quantity, limit = constraint.quantity, constraint.limit(row.side)
        sign = -1.0 if row.side == "min" else 1.0
        if row.constraint not in kept:
            kept[row.constraint] = _inverse_fill(c) if quantity.name == "fill_factor" else quantity.of(c, constraint.at)
        value = kept[row.constraint]
        if row.component is not None:
            value = value[row.component]
        elif quantity.worst is not None:
            value = quantity.worst(value)
        if quantity.name == "fill_factor":
            return sign * (1 - limit * value)
        if quantity.positive and limit > 0:
            return sign * np.log(value / limit)
        return sign * (value - limit) / self.scale(row.constraint)

    def with_scales(self) -> Problem:
        """The same problem with its scales written down, so that merits on other parts compare."""
        return replace(self, scales=self._spreads)

    def scale(self, constraint: int) -> float:
        """What a difference from a limit is counted in, where it is not a ratio."""
        return self._spreads[0][constraint]

    def goal_scale(self, goal: int) -> float:
        """What a goal of either sign is counted in."""
        return self._spreads[1][goal]

    def unit_of_row(self, row: Row) -> float:
        """How much the quantity changes where the row changes by 1, at its limit."""
        constraint = self.constraints[row.constraint]
        limit = constraint.limit(row.side)
        ratio = constraint.quantity.positive and limit > 0
        return abs(limit) if ratio else self.scale(row.constraint)

    def label(self, row: Row) -> str:
        """What a row holds, in words."""
        if row.constraint < 0:
            return row.note
        constraint = self.constraints[row.constraint]
        sign = {"min": ">=", "max": "<=", "equal": "="}[row.side]
        limit = f"{constraint.limit(row.side):.6g}"
        unit = f" {constraint.quantity.unit}" if constraint.quantity.unit else ""
        rim = ""
        if row.component is not None and constraint.quantity.name != "largest_diameter_mm":
            rim = f" ({'main lens' if row.component == 0 else f'stop {row.component}'})"
        return f"{constraint.label}{rim} {sign} {limit}{unit}"

    def without(self, keep: frozenset[int]) -> Problem:
        """The same problem with only some of its constraints."""
        return replace(self, constraints=tuple(c for i, c in enumerate(self.constraints) if i in keep))


def _inverse_fill(c: Cameras) -> Array:
    """1/fill factor, which is linear where the fill factor has poles (Eq. 7)."""
    return c.d * (c.reach / c.d_2 + (c.f - c.d_3) / c.f) / c.D_F


def _spread_of(values: Array) -> float:
    finite = np.ravel(values)[np.isfinite(np.ravel(values))]
    if not finite.size:
        return 1.0
    middle = np.median(finite)
    wide = float(np.median(np.abs(finite - middle)))
    return wide or float(abs(middle)) or 1.0
