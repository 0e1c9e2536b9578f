"""A design problem: what may vary, what must hold, what is wanted; as smooth numbers for an optimiser.

Scaling. Variables run from 0 to 1 between their bounds. A limit on what is positive becomes the logarithm of its ratio
to the limit, so that 1e-3 means 0.1 %; on what may be zero or negative, a difference in units of the quantity's own
spread over the box. Goals are merged likewise: the merit is the weighted mean of the logarithms, so a weight says what
one per cent of a goal is worth against one per cent of another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from operator import itemgetter
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from .._arrays import Array
from ..bore.conjugates import CONJUGATES, follower
from ..camera import BESIDE, TIP, Camera, Number
from ..design import PATHS, Design
from ..evaluation.field_images import FieldImages, rays_tell
from ..lenses.glass import Glass
from ..theory.depth_error import MOST_FILL, fill_left
from ..theory.field_of_view import focus_ahead
from ..theory.focused import LEAST_VIEWS, LIMIT, filtered_views, pupil_blur_ratio
from ..theory.light import cut_sides
from ..theory.quantities import EXPECTED_DEPTHS
from ..theory.quantity import Quantity
from ..theory.tube import OUTER, WIDTHS, housed
from ..tolerancing.draws import sobol_points
from .goals import SIGNS, UNDISTORTED, Constraint, Goal, Side
from .lens_variables import FOCAL, VariedLens
from .main_lens import TRACED_FTOL, IdealLensSearch, lens_search
from .search import BIG
from .traces import Field as ArrayPlace
from .traces import FieldTraces
from .variables import Variable, as_places, places_of

ROOM = 1e-6
"""Relative distance kept from cameras that are none: d_f = f, the focal plane inside the bore, images of no pitch."""

SIDES = "microlens_array.size.0", "microlens_array.size.1"

T = TypeVar("T", Constraint, Goal)

APART = 1e-4
"""Distance in the unit box within which of places where rays told the latest counts alone."""
TRIED = 8
"""Places that are looked at for each start behind a real lens."""


def titled(title: str, kind: str) -> str:
    """A design's name after what was done to it, told once."""
    return title if title.lower().endswith(f", {kind}") else f"{title}, {kind}"


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
    of_views: bool = False
    """Whether what is asked takes pixels for views, so that every camera must have some."""
    given: Mapping[str, Any] = field(default_factory=dict)
    """Values in place of the base design's: a bore (its tip among it), parts of the catalogue."""
    cut: bool = False
    """Whether the array, as large as its stock, is cut to what the sensor sees of it and `CUT_MARGIN` on each side."""
    thin: bool = False
    """Whether closed forms of the thin-lens model stand for rays through a real lens."""
    scales: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    """Units of the differences of constraints and of goals; None: their spread over the box."""
    told_at: tuple[tuple[tuple[float, ...], Mapping[object, float]], ...] = ()
    """Points where rays gave the whole camera's numbers, and logarithms of those over what is posed, where they differ:
    elsewhere they follow the cubic spline through the points."""

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

    def called(self, name: str) -> str:
        """A variable's name, or a place, as a reader knows it: of a part that has a name, with that."""
        return self.design.chain.called(name)

    @property
    def _fields(self) -> tuple[ArrayPlace, ...]:
        """Fields that goals and limits name."""
        asked = (part.field for part in (*self.goals, *self.constraints))
        return tuple(dict.fromkeys(field for field in asked if field is not None))

    @property
    def traced(self) -> bool:
        """Whether a goal or limit is told from rays through a real lens."""
        return not self.thin and bool(self.main_lens.traced(self._fields))

    @property
    def finest(self) -> float:
        """Change of the merit that ends a polished search: rounding, or what Newton's steps leave of traced rays."""
        return TRACED_FTOL if self.by_rays else self.main_lens.finest(self._fields)

    @property
    def summed(self) -> bool:
        """Whether a goal or limit takes milliseconds: depth errors predicted from light and texture, traced rays."""
        return self.traced or any(self._summed(part.quantity) for part in (*self.goals, *self.constraints))

    @property
    def dear(self) -> bool:
        """Whether depth errors of a design take milliseconds whose rays through a real lens are looked at as well."""
        rays = self.by_rays or self.traced
        return rays and any(self._summed(part.quantity) for part in (*self.goals, *self.constraints))

    def _summed(self, quantity: Quantity) -> bool:
        return quantity.numeric and quantity.monotone_with not in self.base.numbers

    def _values(self, units: Array) -> dict[str, Array]:
        """Variables by their places; those that move with others from where the base design has them."""
        values = dict[str, Array]()
        for k, (name, variable) in enumerate(self.variables.items()):
            value = variable.value(units[..., k])
            for place in variable.places(name):
                if not variable.together:
                    values[place] = value
                else:
                    there = values[place] if place in values else self.base.numbers[place]
                    values[place] = np.asarray(there + variable.together[place] * value)
        return values

    def varied_lens(self, units: Array) -> VariedLens | None:
        """The real lens at scaled variables; None behind an ideal one."""
        return self.main_lens.varied(self._values(units))

    def values(self, units: Array) -> dict[str, Array]:
        """Place of a camera to its values [mm]; units as for `cameras`.

        Derived lengths are turned into those that they set, and what varies of a real lens into its focal length. Where
        that varies alone of f, d_f and d_1, the design's focal plane stays if it states one, and d_1 follows.
        """
        places = as_places(self.main_lens.as_lengths(self._values(units)), self.base)
        if FOCAL in places and not places.keys() & CONJUGATES[1:] and self.design.microlens_array.distance is None:
            places[CONJUGATES[1]] = np.full(np.shape(units)[:-1], self.design.d_f)
        return places

    def named(self, unit: Array) -> dict[str, float]:
        """Variable name to its value at one point [mm]."""
        return {name: float(v.value(unit[i])) for i, (name, v) in enumerate(self.variables.items())}

    def before(self, names: Iterable[str]) -> dict[str, float]:
        """Values [mm] that the base design has of these names, where they are its lengths."""
        camera = Camera.of(self.design)
        numbers = {**camera.numbers, "working_distance": float(focus_ahead(camera))}
        ties = {name: variable for name, variable in self.variables.items() if variable.tied}
        places = {name: PATHS.get(name, name) for name in names}
        before = {name: float(numbers[place]) for name, place in places.items() if place in numbers}
        before |= {name: 0.0 for name in names if name in ties and ties[name].together}
        alike = {name: {float(numbers[place]) for place in tie.same} for name, tie in ties.items()}
        return before | {name: alike[name].pop() for name in names if len(alike.get(name, ())) == 1}

    @property
    def drawn(self) -> list[Array]:
        """Scaled variables of the base design; none where it is outside the bounds, or has not all of them."""
        drawn = self.before(self.variables)
        if not all(name in drawn and v.min <= drawn[name] <= v.max for name, v in self.variables.items()):
            return []
        return [np.array([v.unit(drawn[name]) for name, v in self.variables.items()])]

    def cameras(self, units: Array) -> Camera:
        """The cameras at scaled variables of shape (..., n)."""
        cameras = self.base.replace(self.values(units), in_focus=self.in_focus)
        return cameras.replace(self.cut_sides(cameras)) if self.cut else cameras

    def cut_sides(self, stock: Camera) -> dict[str, Array]:
        """Width and height of cut arrays of these stock sizes [mm]; places of fields that are asked for stay on them.

        Nothing but the size of the part changes: what the sensor sees is all there.
        """
        width, height = (max((abs(field[axis]) for field in self._fields), default=0.0) for axis in (0, 1))
        return dict(zip(SIDES, map(np.asarray, cut_sides(stock, (width, height))), strict=True))

    def following(self, unit: Array) -> dict[str, float]:
        """Lengths that follow from the variables, by symbol or place, with their value [mm] at one point.

        Of f, d_f and d_1 the third; f_ml in focus; what a derived length sets.
        """
        own, third = {PATHS.get(name, name) for name in self.variables}, follower(self._set_places)
        moved = [*self._set_places, *([third] if third else []), *([PATHS["f_ml"]] if self.in_focus else [])]
        camera, symbols = self.cameras(unit), {place: symbol for symbol, place in PATHS.items()}
        moved = [place for place in dict.fromkeys(moved) if place not in own and place not in self._held]
        return {symbols.get(place, place): float(camera[place]) for place in moved}

    def held(self, unit: Array) -> dict[str, float]:
        """Length of d_f and d_1 that stays where f varies, by symbol, with its value [mm]."""
        camera = self.cameras(unit)
        return {symbol: float(camera[PATHS[symbol]]) for symbol in ("d_f", "d_1") if PATHS[symbol] in self._held}

    @cached_property
    def _held(self) -> tuple[str, ...]:
        """Places of that."""
        own = places_of(self.variables)
        if FOCAL not in self._set_places or "working_distance" in own:
            return ()
        return tuple(key for key in CONJUGATES[1:] if key not in own and key != follower(self._set_places))

    def traces(self, cameras: Camera, lens: VariedLens | None = None) -> FieldTraces | None:
        """Traces at the fields of cameras behind a real lens; None where no field is asked for."""
        return None if self.thin else self.main_lens.traces(self._fields, cameras, lens)

    def number(self, part: Constraint | Goal, unit: Array) -> float:
        """Value of a constraint's or goal's quantity at one point."""
        cameras, posed_at = self.cameras(unit[None]), self._posed_at(unit[None])
        traces = self.traces(cameras, self.varied_lens(unit[None]))
        return float(np.ravel(posed_at(part).values(cameras, traces))[0])  # type: ignore[type-var]

    def design_at(self, unit: Array, name: str = "") -> Design:
        """The design at one point.

        Raises
        ------
        DesignError
            The point is no design.
        """
        camera = self.cameras(unit[None])
        changed = (*self._set_places, *((PATHS["f_ml"],) if self.in_focus else ()), *(SIDES if self.cut else ()))
        given = {place: value for place, value in self.given.items() if place not in BESIDE}
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
        for symbol, where in (("d_1", "before"), ("d_2", "behind")):
            if plates := [at.place for at in self.design.plates if (at.near >= -self.design.d_1) == (symbol == "d_1")]:
                yield row(
                    f"glass {where} the lenslets fits",
                    lambda c, held=PATHS[symbol], plates=plates: (  # type: ignore[misc]
                        (c[held] - sum(c[f"{place}.thickness"] for place in plates)) / c.f
                    ),
                )
        yield row("microlens images of positive pitch", lambda c: 1 + c.seen.d_2 * c.seen.vergence)
        if self.of_views and not self.in_focus:
            yield row("pixels that are views: microlenses image the pupil", lambda c: 1 - pupil_blur_ratio(c) / LIMIT)
            yield row("pixels enough across a microlens image", lambda c: filtered_views(c) / LEAST_VIEWS - 1)
        expected = any(part.quantity.name in EXPECTED_DEPTHS for part in (*self.constraints, *self.goals))
        if expected and "depth.disparity_error" not in self.base.numbers:
            yield row("views told apart one by one: image fill", lambda c: 1 - fill_left(c) / MOST_FILL[c.layout])
        values = self._values(np.full(self.n, 0.5))
        for label, room in self.main_lens.rooms(values, (*self._set_places, *self.given)):
            yield _own(label, lambda builds, room=room: room(*builds))  # type: ignore[misc]

    def _kept_apart(self) -> Iterator[tuple[End, End, str]]:
        """Pairs of ends that must not overlap: elements, stops and elements, in the order of the base design.

        Those of which one varies, and those that overlap in the base design.
        """
        base, chain = self.base, self.base.chain
        named = [at.name for at in self.design.in_bore]

        def ends(k: int) -> tuple[End, End]:
            start = f"elements.{k}.distance"
            return itemgetter(start), lambda c: c[start] + chain.length(c.numbers, k)

        def rim(k: int, farther: int) -> End:
            near, far = chain.order.index(k), chain.order.index(farther)
            return lambda c: ends(k)[1](c) + (parts := chain.standing(c.numbers))[near].rims_before(parts[far])

        def clear(near: End, far: End) -> bool:
            return bool(far(base) >= near(base))

        moved = {place.rpartition(".")[0] for place in (*self._set_places, *self.given)}
        for k, farther in pairwise(chain.order):
            near, far = rim(k, farther), ends(farther)[0]
            if moved & {f"elements.{k}", f"elements.{farther}"} or not clear(near, far):
                yield near, far, f"{named[k]} clear of {named[farther]}"
        for opening in base.stop_openings:
            stop: End = itemgetter(f"{opening.part}.distance")
            for k in chain.order:
                start, end = ends(k)
                before = opening.ruler_distance <= (start(base) + end(base)) / 2
                near, far = (stop, start) if before else (end, stop)
                if moved & {opening.part, f"elements.{k}"} or not clear(near, far):
                    yield near, far, f"{opening.name} clear of {named[k]}"

    def _rows_of(self, index: int, constraint: Constraint) -> Iterator[_LimitRow]:
        worst = constraint.quantity.worst if constraint.field is None else None
        widest = constraint.quantity.name in ("largest_diameter_mm", *WIDTHS)
        of_what = [f" ({rim.name})" for rim in self.base.rims]
        if widest:
            housing = constraint.quantity.name in WIDTHS
            openings = [rim for rim in self.base.openings if rim.size_places]
            inside = [*(part.name for part in housed(self.base)), *(["tube"] if OUTER in self.base.numbers else [])]
            of_what = [f" ({name})" for name in inside] if housing else [""] * len(openings)
        for side, limit in constraint.limits.items():
            words = f"{SIGNS[side]} {constraint.with_unit(limit)}"
            for end in ("min", "max") if side == "equal" else (side,):
                row, size = constraint.row(limit, 1.0 if end == "max" else -1.0, self._spreads[0][index])
                if worst is None:
                    yield _LimitRow(index, side, f"{constraint.label} {words}", size, row)
                elif end == ("max" if widest else "min"):
                    # All of several values must hold: each is a smooth row of its own, where their worst has kinks.
                    for k, which in enumerate(of_what):
                        label = f"{constraint.label}{which} {words}"
                        yield _LimitRow(index, side, label, size, _after(row, itemgetter(k)))
                else:
                    whole = row if constraint.quantity.name == UNDISTORTED else _after(row, worst)
                    yield _LimitRow(index, side, f"{constraint.label} {words}", size, whole)

    @cached_property
    def _set_places(self) -> tuple[str, ...]:
        return tuple(place for place in self.values(np.zeros(self.n)) if place not in BESIDE)

    @cached_property
    def _spreads(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Spread of each constraint's and each goal's quantity over the box, unless given."""
        if self.scales is not None:
            return self.scales
        with np.errstate(all="ignore"):
            units = sobol_units(self.n, 64, 0)
            cameras = self.cameras(units)
            traces = self.traces(cameras, self.varied_lens(units))

            def spread(part: Goal | Constraint) -> float:
                # Ratios of what takes milliseconds need none.
                apart = part.field is None and part.quantity.positive and self._summed(part.quantity)
                return 1.0 if apart else _spread_of(part.judged(cameras, traces))

            return tuple(map(spread, self.constraints)), tuple(map(spread, self.goals))

    def vector(self, units: Array) -> Array:
        """Merit and rows, shape (1 + rows, N), for units (N, n); not finite where there is no such number."""
        with np.errstate(all="ignore"):
            cameras, lens = self.cameras(units), self.varied_lens(units)
            result = np.empty((1 + len(self.rows), len(units)))
            traces, posed_at = self.traces(cameras, lens), self._posed_at(units)
            measured = [posed_at(limit).measured(cameras, traces) for limit in self.constraints]
            pairs = zip(self.constraints, measured, strict=True)
            known: dict[object, Array] = {limit.asked: values for limit, values in pairs if limit.as_judged}
            result[0] = self.merit(cameras, traces, known, posed_at)
            result[1:] = self.rows_of(cameras, len(units), traces, lens, measured)
        return result

    def limits(self, units: Array) -> Array:
        """Rows of `vector` without the merit, shape (rows, N)."""
        with np.errstate(all="ignore"):
            cameras, lens, posed_at = self.cameras(units), self.varied_lens(units), self._posed_at(units)
            traces = self.traces(cameras, lens)
            measured = [posed_at(limit).measured(cameras, traces) for limit in self.constraints]
            return self.rows_of(cameras, len(units), traces, lens, measured)

    def rows_of(
        self,
        cameras: Camera,
        count: int,
        traces: FieldTraces | None = None,
        lens: VariedLens | None = None,
        measured: Sequence[Array] | None = None,
    ) -> Array:
        """Rows of so many cameras, these or builds of a design behind an ideal lens; shape (rows, N).

        `measured`: what constraints measure, where it is known.
        """
        result = np.empty((len(self.rows), count))
        with np.errstate(all="ignore"):
            values = measured or [constraint.measured(cameras, traces) for constraint in self.constraints]
            every = [*values, _PosedBuilds(cameras, lens)]
            for number, row in enumerate(self.rows):
                result[number] = row.of(every[row.constraint])
        return result

    def merit(
        self,
        cameras: Camera,
        traces: FieldTraces | None = None,
        known: Mapping[object, Array] = MappingProxyType({}),
        posed_at: Callable[[Goal], Goal] = lambda goal: goal,
    ) -> Array:
        """Weighted mean of the goals, small is good, 0 without goals; shape (N,)."""
        total: Array = np.zeros(())
        for goal, scale in zip(self.goals, self._spreads[1], strict=True):
            value = known[goal.asked] if goal.asked in known else posed_at(goal).judged(cameras, traces)
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

    def keeping(self, some: frozenset[int]) -> DesignProblem:
        """Problem with only some of its constraints."""
        return self._limited([(index, one) for index, one in enumerate(self.constraints) if index in some])

    def one_sided(self) -> DesignProblem:
        """Problem with each limit a constraint of its own."""
        return self._limited([(index, side) for index, one in enumerate(self.constraints) for side in one.one_sided])

    def _limited(self, limits: Sequence[tuple[int, Constraint]]) -> DesignProblem:
        """Problem with other constraints, each scaled as the one of that index was."""
        scales = self.scales and (tuple(self.scales[0][index] for index, _ in limits), self.scales[1])
        return replace(self, constraints=tuple(one for _, one in limits), scales=scales)

    @property
    def by_rays(self) -> bool:
        """Whether rays through a real lens tell a number of the whole camera that is asked for."""
        return any(self.is_by_rays(part.quantity) for part in (*self.goals, *self.constraints))

    def is_by_rays(self, quantity: Quantity) -> bool:
        """Whether rays through a real lens tell a quantity of the whole camera."""
        return quantity.of_rays is not None and bool(self.design.main_lens.kind.mounted)

    def told_by_rays(self, unit: Array) -> tuple[DesignProblem, float]:
        """Problem whose numbers of the whole camera are at a point those that rays tell, and how far others they were.

        Elsewhere they are as many times those of the thin-lens model as a spline through points told at before has it.
        """
        if not self.by_rays:
            return self, 0.0
        parts = [part for part in (*self.goals, *self.constraints) if part.temperature is None]
        asked = [(part.quantity, part.at) for part in parts]
        shares, faults = rays_tell(partial(self.design_at, unit), asked, FieldImages.share)
        if faults:
            return self, 0.0
        by = {part.asked: share for part, share in zip(parts, shares, strict=True) if share is not None}
        believed = self._between(unit[None])

        def told(part: T) -> T:
            return (
                part.model_copy(update={"quantity": part.quantity.times(by[part.asked])}) if part.asked in by else part
            )

        logs = {asked: math.log(share) for asked, share in by.items()}
        met = [(at, {**less, **{a: less.get(a, 0.0) - log for a, log in logs.items()}}) for at, less in self.told_at]
        points = (*(one for one in met if np.abs(unit - one[0]).max() > APART), (tuple(unit.tolist()), {}))
        limits, goals = tuple(map(told, self.constraints)), tuple(map(told, self.goals))
        moved = (abs(float(believed[asked][0]) / share - 1) for asked, share in by.items())
        return replace(self, constraints=limits, goals=goals, told_at=points), max(moved, default=0.0)

    def _between(self, units: Array) -> Mapping[object, Array]:
        """How many times what is posed rays tell of each thing asked, about, at points (N, n): a cubic spline of logs.

        Beyond what was told it goes on straight, by no more than that spreads.
        """
        places = np.array([at for at, _ in self.told_at]).reshape(-1, self.n)
        count = len(places)
        asked = [part.asked for part in (*self.goals, *self.constraints)]
        if count < 2:
            return {one: np.ones(len(units)) for one in asked}
        logs = np.array([[less.get(one, 0.0) for one in asked] for _, less in self.told_at])

        def terms(at: Array) -> Array:
            apart = np.linalg.norm(at[:, None] - places, axis=-1)
            return np.concatenate([apart**3, np.ones((len(at), 1)), at], axis=1)

        known = terms(places)
        # The small block: along what no two places differ in, nothing changes.
        system = np.block([[known], [known[:, count:].T, -1e-9 * np.eye(1 + self.n)]])
        weights = np.linalg.solve(system, np.pad(logs, ((0, 1 + self.n), (0, 0))))
        low, high = logs.min(axis=0), logs.max(axis=0)
        found = np.exp(np.clip(terms(units) @ weights, 2 * low - high, 2 * high - low))
        return dict(zip(asked, found.T, strict=True))

    def _posed_at(self, units: Array) -> Callable[[T], T]:
        """Goals and limits as rays tell them at points (N, n)."""
        if len(self.told_at) < 2:
            return lambda part: part
        between = self._between(units)
        return lambda part: part.model_copy(update={"quantity": part.quantity.times(between[part.asked])})

    def untraced(self, *, rays: bool = True, sums: bool = True) -> DesignProblem:
        """Problem with those limits alone that no rays at fields tell; without others, or long sums, where so asked."""

        def taken(limit: Constraint) -> bool:
            told = rays if self.is_by_rays(limit.quantity) else sums or not self._summed(limit.quantity)
            return limit.field is None and told

        some = frozenset(index for index, limit in enumerate(self.constraints) if taken(limit))
        return self.keeping(some).without_goals()

    def without_goals(self) -> DesignProblem:
        """Problem with its limits and no goals."""
        return replace(self, goals=(), scales=self.scales and (self.scales[0], ()))


def _own(label: str, room: Callable[[_PosedBuilds], Number]) -> _LimitRow:
    """Row of a clearance that no camera may have below 0."""
    return _LimitRow(-1, "min", label, 1.0, lambda builds: np.asarray(ROOM - room(builds)))


def _after(row: Callable[[Array], Array], pick: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda measured: row(pick(measured))


FRESH_POINTS = 6
"""Sobol points from which it is asked whether some of the limits can hold, and for the ends of a front."""


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


def _spread_of(values: Array) -> float:
    finite = np.ravel(values)[np.isfinite(np.ravel(values))]
    if not finite.size:
        return 1.0
    middle = np.median(finite)
    return float(np.median(np.abs(finite - middle))) or float(abs(middle)) or 1.0
