"""The best combinations of catalogue parts, the continuous rest optimised for each.

Branch and bound: boxes of variables that cannot hold a feasible camera, or none good enough for the list, are left out
for all combinations at once; what remains is split, and the most promising combinations are optimised as they come up.

The closed forms rise or fall in each single length throughout, whichever way; then their extremes over a box lie at its
corners, and corners are cheap. Quantities for which that does not hold bound nothing, and rule nothing out.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from .._arrays import Array, by_value
from ..bore.conjugates import CONJUGATES, REFRACTING
from ..bore.main_lens import MainLensKind
from ..camera import TIP, Camera, Number
from ..design import PATHS, Design
from ..errors import InputError, Problem
from ..lenses.glass import Glass
from ..lenses.prescription import Prescription
from ..theory import chief_rays
from ..theory.f_number import inverse_fill_factor
from ..theory.light import SensorField, sensor_field
from ..tolerancing.places import in_lens
from ..toml_files import StrictTable, nearest
from ..traced.camera import camera_of
from .lens_variables import why_not_bent
from .parts import (
    KINDS,
    LENS_PRESCRIPTION,
    LENS_REVERSED,
    ORIENTATIONS,
    Catalogue,
    Choice,
    Entry,
    Kind,
    Option,
    given_by,
    glass_choices,
    parse_condition,
    placed,
    read_condition,
    rows,
)
from .problem import (
    DERIVED,
    ROOM,
    Constraint,
    DesignProblem,
    Goal,
    lengths_and_numbers,
    promising_starts,
    sobol_units,
)
from .search import QUICK, Search, SearchBudget
from .solve import Conflict, explain, searched
from .traces import Retrace

FOCAL, _, DISTANCE = CONJUGATES

Flags = NDArray[np.bool_]

Nearby = Literal["smooth", "zero", "pole", "jump"]
"""Behaviour of a quantity where the focal plane comes to the bore: it stays, goes to zero, or to infinity, from
above or with either sign."""

ROUNDING = 1e-9
"""Allowance of bounds for rounding, relative."""
CHUNK = 8_000
"""Boxes evaluated at once: their corners stay in a processor's cache."""
CORNERS = 500
"""Corners of boxes that count as one evaluation, for they take as long."""
SLICES = 5
"""Parts of a side that are tried when shaving."""
AT_ONCE = 10
"""Combinations optimised between two rounds of splitting."""
MOST_BOXES = 200_000
"""Beyond, splitting stops and the rest is optimised in the order of bounds."""
ROUNDS = 16
TRIED = 64
"""Places from which a first camera behind another lens is looked for."""
TIES = 1e-3
"""Merit within which quick searches do not decide: such combinations are searched again, thoroughly, in the end."""


def _condition(text: str) -> str:
    parse_condition(text)
    return text


Conditions = tuple[Annotated[str, AfterValidator(_condition)], ...]


class CatalogueTable(StrictTable):
    """Parts to choose among."""

    kinds: Annotated[tuple[Choice, ...], Field(min_length=1)] = ("lenses", "microlens_arrays", "sensors")
    """Kinds of parts to choose; of a real main lens also its orientation, and the glasses of a custom one."""
    where: dict[Kind, Conditions] = Field(default_factory=dict)
    """Kind to conditions for its parts, as `roslf catalogue --where` takes them: lenses = ["focal_length<=20 mm"]."""
    only: dict[Choice, tuple[str, ...]] = Field(default_factory=dict)
    """Kind to names of those parts, or glasses, alone: lenses = ["AC050-008-A", "AC080-016-A"]."""
    files: tuple[str, ...] = ()
    """Further catalogue files, beside the study."""
    shipped: bool = True
    """Whether the shipped catalogue takes part."""
    element: Annotated[int, Field(ge=0)] | None = None
    """For which of [[elements]], from 0, a window is chosen; may be left out where there is one plate."""
    keep: Annotated[int, Field(ge=1, le=100)] = 10

    def faults_behind(self, lens: Prescription, shaped: Sequence[str]) -> Iterator[Problem]:
        """Faults of a choice that does not go together with a real main lens, given its variables."""
        if "windows" in self.kinds:
            words = f"with a real main lens ({lens.name}) windows are not chosen; leave the kind out"
            yield Problem("catalogue.kinds", words)
        if "lenses" in self.kinds and "glasses" in self.kinds:
            yield Problem("catalogue.kinds", "a bought lens has its glasses; leave lenses or glasses out")
        if "lenses" in self.kinds and shaped:
            words = f"a bought lens stays as it is, and '{shaped[0]}' varies; drop it, or leave the kind lenses out"
            yield Problem("catalogue.kinds", words)
        wrong = why_not_bent(lens) if "glasses" in self.kinds else None
        if wrong is not None:
            words = f"glasses are chosen for spherical singlets and cemented doublets ({lens.name}: {wrong})"
            yield Problem("catalogue.kinds", f"{words}; leave the kind out")

    def chosen(self, catalogue: Catalogue, lens: MainLensKind) -> Catalogue:
        """The parts of a catalogue that a study asks for, and that fit a main lens.

        Raises
        ------
        InputError
            A name that no part has, conditions that none meets, no lens to trace.
        """
        left: dict[str, tuple[Entry, ...]] = {}
        faults: list[Problem] = []
        for kind in (kind for kind in KINDS if kind in self.kinds):
            parts, names = catalogue.of(kind), self.only.get(kind)
            tell = f"holds no {kind}; add some, or leave the kind out"
            known = [part.part for part in parts]
            for name in names or ():
                if name not in known:
                    words = f"'{name}' is no part of the catalogue; {nearest(name, known, 'see `roslf catalogue`')}"
                    faults.append(Problem(f"catalogue.only.{kind}", words))
            conditions = [read_condition(text) for text in self.where.get(kind, ())]
            rows_of_kind = zip(parts, rows(catalogue, [kind]), strict=True)
            parts = tuple(part for part, row in rows_of_kind if all(holds(row) for holds in conditions))
            if known and not parts:
                asked = " and ".join(self.where[kind])
                tell = (
                    f"none of {len(known)} {kind.replace('_', ' ')} meets {asked}; see `roslf catalogue --kind {kind}`"
                )
            if names is not None:
                parts = tuple(part for part in parts if part.part in names)
            if parts and not any(part.fits(lens) for part in parts):
                tell = f"of the {kind} asked for none has a prescription that could be traced; see `roslf catalogue`"
            parts = tuple(part for part in parts if part.fits(lens))
            if not parts and not faults:
                faults.append(Problem("catalogue", tell))
            left[kind] = parts
        if faults:
            raise InputError(tuple(faults))
        return catalogue.model_copy(update=left)

    def plate(self, design: Design) -> int | None:
        """The element that windows are chosen for; None where none are.

        Raises
        ------
        ValueError
            The design has no such plate, or several and the study does not say which.
        """
        if "windows" not in self.kinds:
            return None
        plates = [k for k, at in enumerate(design.in_bore) if "windows" in at.part.catalogue]
        if self.element is None and len(plates) == 1:
            return plates[0]
        if self.element in plates:
            return self.element
        if not plates:
            raise ValueError("windows are for plates, and the design has none; add one to its [[elements]]")
        raise ValueError(f"say for which plate a window is wanted: element = {' or '.join(map(str, plates))}")


@dataclass(frozen=True)
class Combinations:
    """Every combination of some kinds of parts, numbered with the last kind running fastest."""

    problem: DesignProblem
    kinds: tuple[Choice, ...]
    parts: tuple[tuple[Option, ...], ...]
    """Parts of each kind."""
    element: int | None = None
    """Index of the design's element that a window is for."""

    @classmethod
    def of(
        cls,
        problem: DesignProblem,
        catalogue: Catalogue,
        kinds: Sequence[Choice],
        element: int | None = None,
        glasses: Sequence[str] = (),
    ) -> Combinations:
        """Combinations of a catalogue; kinds left out keep the base design's part.

        What the parts give does not vary any more; an array's microlenses have the focal length that they have.

        Raises
        ------
        InputError
            A glass that is not known; none that the lens can be made of.
        """
        if element is not None and problem.design.elements[element].diameter is None:  # any, for parts to replace
            problem = replace(problem, design=problem.design.replace({f"elements.{element}.diameter": 1.0}))
        given = given_by(kinds, element)
        left = {name: v for name, v in problem.variables.items() if PATHS.get(name, name) not in given}
        in_focus = problem.in_focus and "microlens_arrays" not in kinds
        posed = replace(problem, variables=left, in_focus=in_focus, order="weighted")
        parts: list[tuple[Option, ...]] = []
        for kind in kinds:
            if kind == "orientations":
                parts.append(ORIENTATIONS)
            elif kind == "glasses":
                (lens,) = problem.design.main_lens.kind.prescribed
                parts.append(glass_choices(lens, glasses, problem.design.wavelength))
                if not parts[-1]:
                    words = f"{lens.name} cannot be made of these glasses in its focal length; name others"
                    raise InputError((Problem("catalogue.only.glasses", words),))
            else:
                parts.append(catalogue.of(kind))
        return cls(posed.with_scales(), tuple(kinds), tuple(parts), element)

    @property
    def _shape(self) -> tuple[int, ...]:
        return tuple(len(parts) for parts in self.parts)

    def __len__(self) -> int:
        return int(np.prod(self._shape))

    def chosen(self, number: int) -> tuple[Option, ...]:
        """The parts of a combination."""
        return tuple(parts[i] for parts, i in zip(self.parts, np.unravel_index(number, self._shape), strict=True))

    @cached_property
    def _columns(self) -> list[dict[str, Array]]:
        return [
            {place: np.array([self._numbers(part)[place] for part in parts]) for place in self._numbers(parts[0])}
            for parts in self.parts
        ]

    def _numbers(self, part: Option) -> dict[str, Any]:
        """Numbers that a part sets, by place; of a material also the index that the problem's light has in it."""
        wavelength, environment = float(self.problem.base.wavelength), self.problem.design.environment
        own = part.behind(self.problem.design.main_lens.kind, wavelength, environment)
        numbers = {placed(place, self.element): value for place, value in own.items()}
        warm = None if environment is None else environment.temperature
        glasses = {place: value for place, value in numbers.items() if isinstance(value, Glass)}
        return numbers | {
            f"{place.rpartition('.')[0]}.index": float(glass.index(wavelength, warm))
            for place, glass in glasses.items()
        }

    def values(self, numbers: NDArray[np.intp]) -> dict[str, Array]:
        """Place to the parts' numbers, for many combinations at once."""
        which = np.unravel_index(numbers, self._shape) if self.parts else ()
        return {
            place: column[index]
            for index, columns in zip(which, self._columns, strict=True)
            for place, column in columns.items()
            if column.dtype == np.float64
        }

    def problem_at(self, number: int) -> DesignProblem:
        """The problem with a combination's parts; of the base design d_1 stays, and d_f follows a new lens.

        Here alone it counts what only some sensors' entries say (colour filters, acceptance).

        Raises
        ------
        InputError
            Behind a real lens: within the variables' bounds there is no camera.
        """
        parts = self.chosen(number)
        numbers = {place: value for part in parts for place, value in self._numbers(part).items()}
        design, given = self.problem.design, {**self.problem.given, **numbers}
        if declared := {place: value for part in parts for place, value in part.declared.items()}:
            design = design.replace(declared)
        own = {place: given.pop(place) for place in (LENS_PRESCRIPTION, LENS_REVERSED) if place in given}
        if own:
            own |= {place: given.pop(place) for place in (PATHS["D"],) if place in numbers}
            given.pop(FOCAL, None)
            design = self._behind(own, design)
        return replace(self.problem, design=design, given=given)

    def _behind(self, own: Mapping[str, Any], base: Design) -> Design:
        """Some camera that can be built behind another real lens, by what it is made of; the search moves the rest."""
        problem = self.problem
        units = sobol_units(problem.n, TRIED, 0)
        numbers = problem.values(units) if problem.n else {}
        numbers = {place: value for place, value in numbers.items() if place != FOCAL}
        fault = InputError((Problem("catalogue", "no camera"),))
        for k in range(-1, len(units)):
            moved = {place: float(value[k]) for place, value in numbers.items()} if k >= 0 else {}
            if not moved.keys() & CONJUGATES[1:]:
                moved[DISTANCE] = float(base.d_1)
            try:
                design = base.replace({**own, **moved})
                camera_of(design)
            except InputError as error:
                fault = error
            else:
                return design
        raise fault


class Boxes:
    """Boxes of scaled variables, each belonging to a combination."""

    def __init__(self, combinations: Combinations, owner: NDArray[np.intp], low: Array, high: Array) -> None:
        self.combinations, self.owner, self.low, self.high = combinations, owner, low, high

    def __len__(self) -> int:
        return len(self.owner)

    def where(self, keep: Flags) -> Boxes:
        """Some of them."""
        return Boxes(self.combinations, self.owner[keep], self.low[keep], self.high[keep])

    def split(self) -> Boxes:
        """Boxes each split in two, across the widest side."""
        axis = np.argmax(self.high - self.low, axis=1)
        row = np.arange(len(self))
        left, right = self.high.copy(), self.low.copy()
        left[row, axis] = right[row, axis] = (self.low[row, axis] + self.high[row, axis]) / 2
        owner = np.concatenate([self.owner, self.owner])
        return Boxes(self.combinations, owner, np.concatenate([self.low, right]), np.concatenate([left, self.high]))

    def shaved(self, threshold: float) -> Boxes:
        """Each with the ends of its sides cut off where nothing feasible, or nothing below a merit, can lie."""
        low, high = self.low.copy(), self.high.copy()
        alive = np.ones(len(self), bool)
        for axis in range(low.shape[1]):
            start, side = low[:, axis].copy(), high[:, axis] - low[:, axis]
            possible = np.empty((SLICES, len(self)), bool)
            for index in range(SLICES):
                left, right = low.copy(), high.copy()
                left[:, axis] = start + side * (index / SLICES)
                right[:, axis] = start + side * ((index + 1) / SLICES)
                possible[index] = Boxes(self.combinations, self.owner, left, right).bound() < threshold
            first = np.argmax(possible, axis=0)
            last = SLICES - np.argmax(possible[::-1], axis=0)
            alive &= possible.any(axis=0)
            low[:, axis] = np.where(first > 0, start + side * (first / SLICES), start)
            high[:, axis] = np.where(last < SLICES, start + side * (last / SLICES), high[:, axis])
        return Boxes(self.combinations, self.owner, low, high).where(alive)

    def bound(self) -> Array:
        """Least merit that a box can hold, shape (B,); infinite where nothing in it is feasible."""
        bounds = np.empty(len(self))
        for start in range(0, len(self), CHUNK):
            piece = slice(start, start + CHUNK)
            bounds[piece] = _bound(self.combinations, self.owner[piece], self.low[piece], self.high[piece])
        return bounds


def prunable(problem: DesignProblem, part: Constraint | Goal) -> bool:
    """Whether a quantity's extremes over boxes of these variables lie at corners."""
    quantity, names = part.quantity, {PATHS.get(name, name) for name in problem.variables}
    if part.field is not None or part.temperature is not None:
        return False
    monotone = quantity.monotone or quantity.monotone_with in problem.base.numbers
    if not monotone or (problem.in_focus and quantity.name in ("f_ml", "microlens_defocus_px")):
        return False
    chain = problem.base.chain
    if not chain.in_air and (chain.bends or any(name.startswith(REFRACTING) for name in names)):
        return False
    if quantity.traced and chief_rays.traced(problem.base):
        return False
    decentred = any(value for place, value in problem.base.numbers.items() if ".decentre." in place)
    if quantity.over is not None and decentred:
        return False  # how far off the axis the sensor sees has its least inside a box
    if quantity.bent_in_f and CONJUGATES[0] in names:
        return False
    if any(in_lens(name) for name in names):
        return False
    if names & (DERIVED.keys() - {"working_distance"}):
        return False
    with_plane = ("total_length_mm", "vergence_at_mla_per_mm", "microlens_defocus_px")
    if "working_distance" in names and quantity.name in with_plane:
        return False
    if TIP in problem.given and "aperture.distance" in names:
        return False
    stops_matter = part.at is not None or quantity.name in ("non_distortion_room_mm", "total_length_mm")
    moves = any(name == "aperture.distance" or name.startswith("stops.") for name in names)
    return not (problem.design.stops and moves and stops_matter)


def _bound(combinations: Combinations, owner: NDArray[np.intp], low: Array, high: Array) -> Array:
    problem = combinations.problem
    corners = np.array(list(product((0.0, 1.0), repeat=problem.n)))
    units = low + corners[:, None, :] * (high - low)
    numbers = {**combinations.values(owner), **problem.values(units)}
    focal, chain = numbers.get(CONJUGATES[0], problem.base.f), problem.base.chain
    least = focal * (1 + 2 * ROOM)
    if not chain.in_air:
        glass = problem.base.replace({place: number for place, number in numbers.items() if place not in CONJUGATES})
        leasts = glass.plane_seen_at(least), least + chain.before_array(glass.numbers)
    else:
        leasts = least, least
    for place, lowest in zip(CONJUGATES[1:], leasts, strict=True):
        if place in numbers and not (CONJUGATES[1] in numbers and CONJUGATES[2] in numbers):
            # What lies beyond holds no camera; the corner moves to where cameras begin.
            numbers[place] = np.maximum(numbers[place], lowest)
    with np.errstate(all="ignore"):
        cameras = problem.base.replace(numbers, in_focus=problem.in_focus)
        shape = units.shape[:2]
        image = np.broadcast_to(cameras.seen.d_f > cameras.f * (1 + ROOM), shape)
        ahead = np.broadcast_to(cameras[CONJUGATES[1]] * (1 - ROOM) > cameras.tip, shape)
        certain = image.all(axis=0)
        # d_f > f and d_f > tip hold somewhere in the box only if they do at a corner: both are monotone.
        possible = image.any(axis=0) & (ahead | ~image).any(axis=0)
        for constraint in problem.constraints:
            if prunable(problem, constraint):
                nearby = _near_the_bore(constraint, problem.base)
                possible &= ~(certain & _impossible(constraint, nearby, cameras, ahead))
        merit = np.zeros(shape[1])
        weights = sum(goal.weight for goal in problem.goals)
        for index, goal in enumerate(problem.goals):
            if not prunable(problem, goal):
                merit[:] = -np.inf
                break
            least, most = _extremes(goal, _near_the_bore(goal, problem.base), cameras, ahead)
            best = least if goal.sign > 0 else most
            size = np.log(np.maximum(best, 0)) if goal.quantity.positive else best / problem.goal_scale(index)
            merit += goal.weight * goal.sign * size / weights
        merit = np.where(certain & ~np.isnan(merit), merit - ROUNDING * (1 + np.abs(merit)), -np.inf)
    return np.where(possible, merit, np.inf)


def _impossible(constraint: Constraint, nearby: Nearby, cameras: Camera, ahead: Flags) -> Flags:
    """Whether no camera in a box, that has its focal plane in front of the bore, holds a constraint."""
    low, high, wrong = constraint.min, constraint.max, np.zeros(ahead.shape[1], bool)
    least, greatest = _extremes(constraint, nearby, cameras, ahead)
    finite = np.where(np.isfinite(least), np.abs(least), 0) + np.where(np.isfinite(greatest), np.abs(greatest), 0)
    room = ROUNDING * (finite + abs(low or 0.0) + abs(high or 0.0))
    if low is not None:
        wrong |= greatest + room < low
    if high is not None:
        wrong |= least - room > high
    return wrong


def _extremes(part: Constraint | Goal, nearby: Nearby, cameras: Camera, ahead: Flags) -> tuple[Array, Array]:
    """Least and greatest value in a box, over its cameras that have their focal plane in front of the bore."""
    quantity, shape = part.quantity, ahead.shape
    if quantity.name == "fill_factor":
        inverse = np.broadcast_to(inverse_fill_factor(cameras), shape)
        least, most = inverse.min(axis=0), inverse.max(axis=0)
        # A box with images of no pitch in it has no largest fill factor.
        nearest = np.maximum(np.maximum(least, -most), 0.0)
        with np.errstate(divide="ignore"):
            return 1 / np.maximum(most, -least), 1 / nearest
    values: Array
    if quantity.over is None:
        values = part.each(cameras)
    else:  # what the sensor sees counts as one more length, with corners of its own
        extremes = [part.each(cameras, over) for over in _sensor_fields(cameras, ahead)]
        rims = () if quantity.worst is None else (len(extremes[0]),)
        values = np.concatenate([np.broadcast_to(v, (*rims, *shape)) for v in extremes], axis=-2)
        ahead = np.concatenate([ahead, ahead])
        shape = ahead.shape
    if quantity.worst is not None:
        every = np.broadcast_to(values, (len(values), *shape))
        least, most = quantity.worst(every.min(axis=1)), quantity.worst(every.max(axis=1))
    else:
        values = np.broadcast_to(values, shape)
        least = (np.where(ahead, values, np.inf) if nearby == "pole" else values).min(axis=0)
        most = values.max(axis=0)
    every_ahead = ahead.all(axis=0)
    if nearby in ("pole", "jump"):
        most = np.where(every_ahead, most, np.inf)
    if nearby in ("zero", "jump"):
        least = np.where(every_ahead, least, 0.0 if nearby == "zero" else -np.inf)
    if quantity.signed is None:
        return least, most
    crosses = (least <= 0) & (most >= 0)
    sizes = np.abs(least), np.abs(most)
    return np.where(crosses, 0.0, np.minimum(*sizes)), np.maximum(*sizes)


def _sensor_fields(cameras: Camera, ahead: Flags) -> tuple[SensorField, SensorField]:
    """Least and most of the array that the sensor sees, over boxes of centred cameras.

    Interval arithmetic: 1/L bends in f, its factors ``(f - d_3)/f`` and ``d_f/(d_1 (d_f - d_3))`` do not.
    """

    def ends(values: Number) -> tuple[Array, Array]:
        every = np.broadcast_to(values, ahead.shape)
        return every.min(axis=0), every.max(axis=0)

    bend, angle = (
        ends(1 - cameras.seen.d_3 / cameras.f),
        ends(cameras.seen.d_2 * cameras.seen.inverse_m / cameras.seen.gap),
    )
    grows = [1 + a * b for a in bend for b in angle]
    least, most = np.minimum.reduce(grows), np.maximum.reduce(grows)
    known = ahead.all(axis=0) & (angle[0] > 0) & (least * most > 0)
    least, most = np.sort(np.abs([least, most]), axis=0)
    narrow, wide = [], []
    for array, sensor in zip(cameras.array_size, cameras.sensor_size, strict=True):
        (array_low, array_high), (sensor_low, sensor_high) = ends(array), ends(sensor)
        narrow.append(np.where(known, np.minimum(array_low, sensor_low / most), 0.0) / 2)
        wide.append(np.where(known, np.minimum(array_high, sensor_high / least), array_high) / 2)
    (a, b), (c, d) = narrow, wide
    return SensorField((-a, -b), (a, b)), SensorField((-c, -d), (c, d))


@lru_cache(maxsize=256)
def _near_the_bore(part: Constraint | Goal, base: Camera) -> Nearby:
    """Behaviour of a quantity as the focal plane comes to the bore, from two cameras where it nearly does."""
    gaps = np.array([1e-6, 1e-9])
    values = part.each(base.replace({"aperture.distance": base[CONJUGATES[1]] * (1 - gaps)}), sensor_field(base))
    near, nearer = np.broadcast_arrays(np.abs(values), gaps)[0].reshape(-1, 2)[0]
    if nearer > 30 * near:
        return "pole" if part.quantity.positive else "jump"
    return "zero" if part.quantity.positive and nearer < near / 30 else "smooth"


@by_value
@dataclass(frozen=True)
class Ranked:
    """Combination of parts, optimised."""

    number: int
    search: Search


@by_value
@dataclass(frozen=True)
class Ranking:
    """The best combinations."""

    combinations: Combinations
    best: tuple[Ranked, ...]
    """Best first, feasible ones only."""
    ruled_out: int
    """Combinations that bounds showed to be infeasible or not good enough."""
    optimised: int
    open: int
    """Combinations neither ruled out nor optimised when the budget was spent; 0: the list is complete."""
    seconds: float
    nearest: int | None = None
    """Where none is feasible, the combination that comes nearest among those that were searched."""
    conflict: Conflict | None = None
    """Conflict that keeps it from being feasible; None where it makes no camera at all."""

    def to_dict(self, retraces: tuple[Retrace, ...], timings: bool) -> dict[str, Any]:
        """As results have it; `retraces` of the best behind a real lens."""
        rows = []
        for place, ranked in enumerate(self.best, 1):
            problem, unit = self.combinations.problem_at(ranked.number), ranked.search.unit
            parts = [part.part for part in self.combinations.chosen(ranked.number)]
            rows.append(
                {
                    "rank": place,
                    "parts": dict(zip(self.combinations.kinds, parts, strict=True)),
                    "goals": {goal.label: problem.number(goal, unit) for goal in problem.goals},
                    **lengths_and_numbers(problem.named(unit)),
                    "file": f"parts-{place:02d}.toml",
                    **({"traced": retraces[place - 1].to_dict()} if retraces else {}),
                }
            )
        data = {
            "combinations": len(self.combinations),
            "ruled_out_by_bounds": self.ruled_out,
            "optimised": self.optimised,
            "open": self.open,
            "best": rows,
            "nearest": None if self.nearest is None else self._nearest(self.nearest),
        }
        return data | {"seconds": self.seconds} if timings else data

    def _nearest(self, number: int) -> dict[str, Any]:
        """Where no combination of parts is feasible: which comes nearest, and why it is not."""
        parts = [part.part for part in self.combinations.chosen(number)]
        named = dict(zip(self.combinations.kinds, parts, strict=True))
        return {"parts": named, **({} if self.conflict is None else self.conflict.to_dict())}


def rank(
    combinations: Combinations,
    keep: int,
    budget: SearchBudget,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
    starts: int = 2,
) -> Ranking:
    """Find the `keep` best combinations; where the budget is spent those that are best so far.

    Of closed forms the first of two starts that ends at a design counts; behind real lenses, where kinks may stop a
    search, the best of all `starts`.
    """
    began = time.monotonic()
    n, count = combinations.problem.n, len(combinations)
    middle = sobol_units(n, 1, seed)[0]
    best: list[Ranked] = []
    nearest: Ranked | None = None
    done = np.zeros(count, bool)
    boxes = Boxes(combinations, np.arange(count), np.zeros((count, n)), np.ones((count, n)))
    bound = np.zeros(count)

    def threshold() -> float:
        """Merit that a combination must beat to enter the list."""
        return best[keep - 1].search.merit + TIES if len(best) >= keep else np.inf

    def alive() -> tuple[Boxes, Array]:
        """Boxes, and their bounds, that may still hold something for the list."""
        left = (bound < threshold()) & ~done[boxes.owner]
        return boxes.where(left), bound[left]

    def optimise(number: int, low: Array, high: Array) -> None:
        nonlocal nearest
        done[number] = True
        try:
            problem = combinations.problem_at(number)
        except InputError:
            return  # no camera
        begin = [(low + high) / 2, low + middle * (high - low)]
        results: list[Search] = []
        for start in promising_starts(problem, begin, starts if problem.traced else 2, seed):
            results.append(searched(problem, start, budget, 80, max(QUICK, problem.finest)))
            if results[-1].feasible and not problem.traced:
                break
        designs = [result for result in results if result.feasible]
        if designs:
            ranked = Ranked(number, min(designs, key=lambda result: result.merit))
            best[:] = sorted([*best, ranked], key=_order)[: 3 * keep]
        least = Ranked(number, min(results, key=lambda result: result.violation))
        nearest = min(nearest or least, least, key=lambda one: one.search.violation)

    splitting, turn = True, 0
    while not budget.ended:
        if splitting:
            budget.evaluations -= len(boxes) * n * SLICES * 2**n / CORNERS
            boxes = boxes.shaved(threshold())
            bound = boxes.bound()
        boxes, bound = alive()
        if not len(boxes):
            break
        tell(f"catalogue: {len(np.unique(boxes.owner))} of {count} combinations left, {done.sum()} optimised")
        # From the first round on the most promising are optimised, from the middle of their best boxes: bounds rule
        # out more, the better what they are held against.
        promising = np.lexsort((boxes.owner, bound))
        _, first = np.unique(boxes.owner[promising], return_index=True)
        for index in promising[np.sort(first)][:AT_ONCE]:
            if bound[index] >= threshold() or budget.ended:
                break
            optimise(int(boxes.owner[index]), boxes.low[index], boxes.high[index])
        boxes, bound = alive()
        splitting = splitting and turn + 1 < ROUNDS and 2 * len(boxes) <= MOST_BOXES
        if splitting and turn % 2:
            boxes, bound = boxes.split(), np.concatenate([bound, bound])
        turn += 1
    polished = []
    for ranked in [each for each in best if each.search.merit < threshold()]:
        problem = combinations.problem_at(ranked.number)
        again = searched(problem, ranked.search.unit, budget.at_least(1000, 10.0), tolerance=problem.finest)
        better = again.feasible and again.merit < ranked.search.merit
        polished.append(Ranked(ranked.number, again) if better else ranked)
    best = sorted(polished, key=_order)[:keep]
    optimised, left = int(done.sum()), len(np.unique(alive()[0].owner))
    conflict = None
    if not best:
        # Where bounds ruled all out, nothing was searched: some, spread over the list, tell why.
        for number in () if nearest else np.unique(np.linspace(0, count - 1, AT_ONCE).astype(int)).tolist():
            optimise(number, np.zeros(n), np.ones(n))
    if not best and nearest is not None:
        tell("catalogue: finding what stands in the way")
        conflict = explain(combinations.problem_at(nearest.number), [nearest.search.unit], budget, seed)
    return Ranking(
        combinations=combinations,
        best=tuple(best),
        ruled_out=count - optimised - left,
        optimised=optimised,
        open=left,
        seconds=time.monotonic() - began,
        nearest=None if nearest is None or best else nearest.number,
        conflict=conflict,
    )


def _order(ranked: Ranked) -> tuple[float, int]:
    return ranked.search.merit, ranked.number
