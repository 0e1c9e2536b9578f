"""Bounds of goals and limits over boxes of variables.

The closed forms rise or fall in each single length throughout, whichever way; then their extremes over a box lie at its
corners, and corners are cheap. Quantities for which that does not hold bound nothing, and rule nothing out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..bore.conjugates import CONJUGATES, REFRACTING
from ..camera import TIP, Camera, Number
from ..design import PATHS
from ..errors import InputError, Problem
from ..theory.f_number import inverse_fill_factor
from ..theory.light import CUT_MARGIN, SensorField, sensor_field
from ..theory.tube import LENGTH, WHOLE, WIDTHS, diameters, housed
from ..tolerancing.places import in_lens
from ..words import listed, the
from ..words import number as number_words
from .combinations import Combinations
from .goals import Constraint, Goal
from .problem import ROOM, SIDES, DesignProblem
from .variables import DERIVED, places_of, tied

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

PROVING, MOST_CORNERS = 8, 10_000
"""Rounds of splitting boxes, and corners of them, after which limits that are not ruled out count as open."""
NAMED = 3
"""Parts that are named where a limit refuses many."""


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
    quantity, names = part.quantity, places_of(problem.variables)
    if (
        tied(problem.variables)
        or part.field is not None
        or part.temperature is not None
        or problem.is_by_rays(quantity)
    ):
        return False
    decentred = any(value for place, value in problem.base.numbers.items() if ".decentre." in place)
    if quantity.name in WIDTHS:  # widths of parts, of a cut array the least
        low = part.max is not None and part.min is None if isinstance(part, Constraint) else part.sign > 0
        return low and LENGTH not in problem.base.numbers and not decentred
    monotone = quantity.monotone or quantity.monotone_with in problem.base.numbers
    if not monotone or (problem.in_focus and quantity.name in ("f_ml", "microlens_defocus_px")):
        return False
    chain = problem.base.chain
    if not chain.in_air and (chain.bends or any(name.startswith(REFRACTING) for name in names)):
        return False
    if quantity.traced and problem.base.chain.bends_rays:
        return False
    pupil = [limits.min for name, limits in problem.variables.items() if PATHS.get(name, name) == PATHS["d_3"]]
    if chain.stop_behind or any(low < 0 for low in pupil):
        return False  # through the lens, room is least inside a box
    if quantity.over is not None and decentred:
        return False  # how far off the axis the sensor sees has its least inside a box
    if problem.base.round_fields and quantity.name == "non_distortion_room_mm":
        return False  # its rim is none of the sensor's ends
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


class _Corners(NamedTuple):
    """Cameras at the corners of boxes, shape (2^n, B)."""

    problem: DesignProblem
    cameras: Camera
    housed: Camera
    """With arrays that are cut as small as they can be in a box."""
    image: Flags
    """Whether an image is real."""
    ahead: Flags
    """Whether the focal plane is in front of the bore."""

    @property
    def certain(self) -> Flags:
        """Whether all images in a box are real."""
        return np.asarray(self.image.all(axis=0))

    def extremes(self, part: Constraint | Goal) -> tuple[Array, Array]:
        """Least and greatest value in each box, over its cameras that have their focal plane in front of the bore."""
        if part.quantity.name in WIDTHS:
            return _extremes(part, "smooth", self.housed, self.ahead)
        return _extremes(part, _near_the_bore(part, self.problem.base), self.cameras, self.ahead)

    def cannot_hold(self, constraint: Constraint) -> Flags:
        """Whether no camera in a box holds a constraint; widths of parts are so wherever images lie."""
        wrong = _impossible(constraint, *self.extremes(constraint))
        return wrong if constraint.quantity.name in WIDTHS else wrong & self.certain


class Refused(NamedTuple):
    """A limit that combinations miss wherever variables are."""

    constraint: Constraint
    numbers: NDArray[np.intp]
    """Combinations."""
    parts: dict[str, float]
    """Parts that it never holds with, to the nearest that it comes."""
    widest: str = ""
    """Part of the design that is widest where a width comes nearest, in words; empty where it is one to choose."""

    def words(self, count: int) -> str:
        """Limit and parts, of so many combinations in all."""
        named = [f"{name} {self.constraint.with_unit(value, 4)}" for name, value in self.parts.items()]
        if named and len(self.numbers) == count:  # whichever part
            named = [self.constraint.with_unit(_nearest_to(self.constraint)(self.parts.values()), 4)]
        more = [f"{len(named) - NAMED} more"] if len(named) > NAMED else []
        widest = f"; the widest there is {self.widest}, which is not among the parts to choose" if self.widest else ""
        told = f" (nearest: {listed([*named[:NAMED], *more])}{widest})" if named else ""
        return f"{len(self.numbers)} of {count} cannot hold {self.constraint} whatever varies{told}"

    def to_dict(self) -> dict[str, Any]:
        """As results have it."""
        return {"limit": str(self.constraint), "combinations": len(self.numbers), "nearest": self.parts}


def refused(combinations: Combinations) -> Iterator[Refused]:
    """Limits that parts rule out in all of the box, before any search."""
    problem, count = combinations.problem, len(combinations)
    limits = [limit for limit in problem.constraints if prunable(problem, limit)]
    wrong, nearest = np.zeros((len(limits), count), bool), np.zeros((len(limits), count))
    for start in range(0, count, CHUNK):
        owner = np.arange(start, min(start + CHUNK, count))
        ends = np.zeros((len(owner), problem.n)), np.ones((len(owner), problem.n))
        with np.errstate(all="ignore"):
            corners = _corners(combinations, owner, *ends)
            for k, limit in enumerate(limits):
                least, most = corners.extremes(limit)
                wrong[k, owner] = corners.cannot_hold(limit)
                nearest[k, owner] = most if limit.max is None else least
    for limit, missed, values in zip(limits, wrong, nearest, strict=True):
        if missed.any():
            parts = combinations.deciding(missed, values, _nearest_to(limit))
            all_too_wide = missed.all() and limit.quantity.name in WIDTHS
            whole = limit.quantity.name == WHOLE
            widest = _widest_fixed(combinations, int(values.argmin()), whole) if all_too_wide else ""
            yield Refused(limit, np.flatnonzero(missed), parts, widest)


def extremes(problem: DesignProblem, part: Constraint | Goal) -> tuple[float, float]:
    """Least and greatest value of a part that is `prunable`, within the bounds; infinite where an image may be none."""
    whole, n = Combinations(problem.without_goals(), (), ()), problem.n
    with np.errstate(all="ignore"):
        corners = _corners(whole, np.zeros(1, np.intp), np.zeros((1, n)), np.ones((1, n)))
        least, most = corners.extremes(part) if corners.certain[0] else ([-math.inf], [math.inf])
    return float(least[0]), float(most[0])


def ruled_out(problem: DesignProblem) -> bool:
    """Whether bounds prove that no camera of these variables holds all limits; what has none proves nothing."""
    if not any(prunable(problem, limit) for limit in problem.constraints):
        return False
    whole, n = Combinations(problem.without_goals(), (), ()), problem.n
    boxes = Boxes(whole, np.zeros(1, np.intp), np.zeros((1, n)), np.ones((1, n)))
    for _ in range(PROVING if n else 1):
        boxes = boxes.shaved(np.inf)
        boxes = boxes.where(boxes.bound() < np.inf)
        if not 0 < len(boxes) * 2 ** (n + 1) < MOST_CORNERS:
            break
        boxes = boxes.split() if n else boxes
    return not len(boxes)


def _widest_fixed(combinations: Combinations, number: int, whole: bool) -> str:
    """Widest part where a combination is narrowest, in words; empty where it is one to choose."""
    owner, n = np.array([number]), combinations.problem.n
    with np.errstate(all="ignore"):
        camera = _corners(combinations, owner, np.zeros((1, n)), np.ones((1, n))).housed
        widths, parts = diameters(camera, whole), housed(camera)
    widths = np.nan_to_num(widths.reshape(len(widths), -1), nan=np.inf)
    corner = int(widths.max(axis=0).argmin())
    index = int(widths[:, corner].argmax())
    if index == len(parts):
        return f"the tube as stated, {number_words(widths[index, corner], 4)} mm"
    name, across = parts[index].name, float(np.ravel(np.broadcast_to(parts[index].across, camera.shape))[corner])
    chosen = {place.partition(".")[0] for place in combinations.values(owner)}
    of_element = name not in ("main lens", "microlens array", "sensor")
    if name.replace(" ", "_") in chosen or (of_element and "elements" in chosen):
        return ""
    return f"{the(name)}, {number_words(across, 4)} mm"


def _nearest_to(limit: Constraint) -> Callable[[Iterable[float]], float]:
    """The one of values, all beyond a limit, that comes nearest."""
    if limit.max is None:
        return max
    return min


def refuse_all(combinations: Combinations) -> None:
    """Refuse a choice of parts of which limits rule all out, before any search.

    Raises
    ------
    InputError
        Names the limits, and the nearest that parts come.
    """
    limits, count = list(refused(combinations)), len(combinations)
    if len(set().union(*(limit.numbers.tolist() for limit in limits))) == count:
        told = "; ".join(limit.words(count) for limit in limits)
        words = f"no combination of parts can be a design: {told}; choose among others, or change limits or bounds"
        raise InputError((Problem("catalogue", words),))


def _corners(combinations: Combinations, owner: NDArray[np.intp], low: Array, high: Array) -> _Corners:
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
        housed = cameras
        asked = {part.quantity.name for part in (*problem.constraints, *problem.goals)}
        if not asked.isdisjoint(WIDTHS) and (cut := combinations.cut(owner)).any():
            view = _sensor_fields(cameras, ahead)[0]
            sides = {
                place: np.where(cut, np.fmin(size, 2 * (high + CUT_MARGIN)), size)
                for place, size, high in zip(SIDES, cameras.array_size, view.high, strict=True)
            }
            housed = cameras.replace(sides)
        return _Corners(problem, cameras, housed, image, ahead)


def _bound(combinations: Combinations, owner: NDArray[np.intp], low: Array, high: Array) -> Array:
    with np.errstate(all="ignore"):
        corners = _corners(combinations, owner, low, high)
        problem, image, certain = corners.problem, corners.image, corners.certain
        # d_f > f and d_f > tip hold somewhere in the box only if they do at a corner: both are monotone.
        possible = image.any(axis=0) & (corners.ahead | ~image).any(axis=0)
        for constraint in problem.constraints:
            if prunable(problem, constraint):
                possible &= ~corners.cannot_hold(constraint)
        merit = np.zeros(len(owner))
        weights = sum(goal.weight for goal in problem.goals)
        for index, goal in enumerate(problem.goals):
            if not prunable(problem, goal):
                merit[:] = -np.inf
                break
            least, most = corners.extremes(goal)
            best = least if goal.sign > 0 else most
            size = np.log(np.maximum(best, 0)) if goal.quantity.positive else best / problem.goal_scale(index)
            merit += goal.weight * goal.sign * size / weights
        merit = np.where(certain & ~np.isnan(merit), merit - ROUNDING * (1 + np.abs(merit)), -np.inf)
    return np.where(possible, merit, np.inf)


def _impossible(constraint: Constraint, least: Array, greatest: Array) -> Flags:
    """Whether no camera in a box holds a constraint, by its extremes there."""
    low, high, wrong = constraint.min, constraint.max, np.zeros(len(least), bool)
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
        # A box with images of no pitch in it has no largest image fill.
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
        added = (1,) * (1 + len(shape) - values.ndim)
        every = np.broadcast_to(values.reshape(len(values), *added, *values.shape[1:]), (len(values), *shape))
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
