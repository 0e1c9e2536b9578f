"""Light through what stands before the main lens: every plane of object space as two numbers.

A ray that leaves the main lens with height l and slope o (both against its axis) meets the plane at z at
``x = A l - B o + E``, and goes on there with index times slope ``-C l + D o + F``. In air A = 1 and B = z. The plane is
thus seen from the main lens as if it stood in air, B/A before it and 1/A as large: the closed forms, which know air
only, hold for what is seen. Paraxial; a plate is its reduced thickness t/n.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import accumulate, pairwise, product
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import ratio
from ..lenses.angles import F_TAN, AngleMap
from .conjugates import CONJUGATES, followed
from .elements import AnyElement, element_name
from .fold import Fold, fold_of
from .lens_sheet import LensSheet
from .part import Number, PartNumbers, minus, plus, times

Flags = np.bool_ | NDArray[np.bool_]

FOCAL, PLANE, DISTANCE = CONJUGATES
FARTHEST = 1e-12
"""A plane whose image lies at infinity is taken to lie this inverse magnification away: results are off by as much."""
TELECENTRIC = 1e-6
"""Size of the FAP over that of its image before all elements, below which the image is taken to lie at infinity."""
COLLIDE = "collide"
"""Last word on two parts of the bore that stand in each other."""
MEDIUM = "object_space.index"
COVER, SUBSTRATE = "sensor.cover", "microlens_array.substrate"


class ImagedPlane(NamedTuple):
    """A plane of object space as the main lens sees it."""

    a: Number
    b: Number
    c: Number
    d: Number
    axis_offset: tuple[Number, Number]
    """E: where the main lens's axis meets it [mm]."""
    axis_slope: tuple[Number, Number]
    """F: index times slope of the main lens's axis there."""
    medium: Number
    """Index of what lies on its scene's side."""

    @property
    def magnification(self) -> Number:
        """A, its lengths over those of its image."""
        if isinstance(self.a, float):
            return self.a if abs(self.a) >= FARTHEST else math.copysign(FARTHEST, self.a)
        far = np.abs(self.a) < FARTHEST
        return np.where(far, np.where(self.a < 0, -FARTHEST, FARTHEST), self.a)[()] if far.any() else self.a

    @property
    def distance(self) -> Number:
        """B/A, of its image before the main lens [mm]."""
        return self.b / self.magnification

    @property
    def depth(self) -> Number:
        """Millimetres that a point moves there over those that its image moves, ``n A^2``."""
        return self.medium * self.magnification**2


class _ChainStep(NamedTuple):
    """Light somewhere before the main lens, in air."""

    matrix: tuple[Number, Number, Number, Number]
    """A, B, C and D."""
    shifts: tuple[tuple[Number, Number], tuple[Number, Number]]
    """E and F, along x and along y."""
    place: Number
    """Distance before the main lens [mm]."""

    def propagated(self, gap: Number) -> _ChainStep:
        """Straight on by a reduced length; the place stays."""
        (a, b, c, d), ((e_x, f_x), (e_y, f_y)) = self.matrix, self.shifts
        shifts = (minus(e_x, times(gap, f_x)), f_x), (minus(e_y, times(gap, f_y)), f_y)
        return self._replace(matrix=(plus(a, times(gap, c)), plus(b, times(gap, d)), c, d), shifts=shifts)

    def plane(self, medium: Number) -> ImagedPlane:
        """The plane there, with an index on its scene's side."""
        (e_x, f_x), (e_y, f_y) = self.shifts
        return ImagedPlane(*self.matrix, (e_x, e_y), (f_x, f_y), medium)


class StandingElement(NamedTuple):
    """An element where it stands in a camera."""

    k: int
    """Which of the design's elements it is, from 0."""
    element: AnyElement
    at: PartNumbers
    start: Number
    """Distance of its sensor-side vertex before the main lens [mm]."""
    length: Number
    """Length along the axis [mm]."""
    beyond: Number
    """Index of what lies on its scene's side."""

    @property
    def end(self) -> Number:
        """Distance of its scene's side before the main lens [mm]."""
        return self.start + self.length

    @property
    def name(self) -> str:
        """Name, "plate 1"."""
        return element_name(self.element, self.k + 1)

    @property
    def diameter(self) -> Number:
        """Clear aperture [mm]; infinite where it lets everything through."""
        return self.at.get("diameter", math.inf)

    def rims_before(self, farther: StandingElement) -> Number:
        """How far rims of it and of the next element stand towards each other, as a mirror's that leans [mm]."""
        wide, tall = self.diameter, farther.diameter
        return self.element.reach(wide, tall / 2) + farther.element.reach(tall, wide / 2)

    def through(self, step: _ChainStep, inside: Number, passed: Flags) -> _ChainStep:
        """Light past as much of it as lies `inside` [mm], of a thin one where it is `passed`."""
        p, q, r, s = forward = self.element.forward(self.at, inside, passed)
        a, b, c, d = step.matrix
        matrix = s * a + q * c, s * b + q * d, r * a + p * c, r * b + p * d
        x, y = (self.element.shifted(self.at, k, forward, inside, step.shifts[k], self.beyond) for k in (0, 1))
        return _ChainStep(matrix, (x, y), self.end)


class BoreWalk(NamedTuple):
    """The bore of a camera as light goes through it, from the main lens outwards: what all planes share."""

    parts: tuple[StandingElement, ...]
    steps: tuple[_ChainStep, ...]
    """Light at the main lens, then on the scene's side of each element in turn."""
    medium: Number
    """Index of what lies beyond all elements."""
    power: Number = 0.0
    """Power of the main lens, through which planes behind it are seen [1/mm]; 0 where those before it go on there."""
    farthest: tuple[float, ...] = ()
    """Farthest that each element, with all behind it, reaches in any build [mm before the main lens]."""

    @property
    def front(self) -> tuple[Number, ImagedPlane]:
        """The farthest element's scene side: its distance [mm before the main lens], and the plane, all passed."""
        return self.steps[-1].place, self.steps[-1].plane(self.medium)

    def plane(self, z: Number) -> ImagedPlane:
        """The plane at z before the main lens, below 0 behind it [mm]; on a thin lens, the lens not yet passed."""
        parts, steps, medium, power, farthest = self
        if (power if isinstance(power, float) else np.any(power)) and np.any(np.less(z, 0)):
            return self._behind(z)
        # Elements that every build's plane has behind it; most are told by a number.
        behind = bisect_left(farthest, np.min(np.asarray(z).real) if np.size(z) else -math.inf)
        while behind < len(parts) and _all(z > parts[behind].start) and _all(z >= steps[behind + 1].place):
            behind += 1
        step = steps[behind]
        index: Number = 1.0
        back = _smaller(z, 0.0)  # once, before the first part
        for part in parts[behind:]:
            step, back = step.propagated(_larger(_smaller(part.start, z) - step.place, back)), 0.0
            passed = np.greater(z, part.start)
            if not np.any(passed):
                return step.plane(index)
            inside = np.minimum(np.maximum(z - part.start, 0.0), part.length)
            step = part.through(step, inside, passed)
            index = _either(passed & np.less(z, step.place), part.at.get("index", 1.0), index)
        beyond = _larger(z - step.place, back) / medium
        return step.propagated(beyond).plane(_either(z >= step.place, medium, index))

    def _behind(self, z: Number) -> ImagedPlane:
        """Planes of which some stand behind the main lens, which bends ``o`` to ``o - l/f`` on the way there."""
        through = ImagedPlane(1 + z * self.power, z, self.power, 1.0, (0.0, 0.0), (0.0, 0.0), 1.0)
        behind = np.less(z, 0)
        if np.all(behind):
            return through
        ahead = self._replace(power=0.0).plane(np.where(behind, 0.0, z))

        def chosen(a: Number, b: Number) -> Number:
            return np.where(behind, a, b)[()]

        offset, slope = ((chosen(0.0, x), chosen(0.0, y)) for x, y in (ahead.axis_offset, ahead.axis_slope))
        a, b, c, d = (chosen(*both) for both in zip(through[:4], ahead[:4], strict=True))
        return ImagedPlane(a, b, c, d, offset, slope, chosen(1.0, ahead.medium))

    def plane_of_vergence(self, vergence: Number) -> Number:
        """Distance of the plane before the farthest element that is seen at 1/distance before the main lens [mm]."""
        far, last = self.front
        return far + ratio(last.medium * (last.a - last.b * vergence), last.d * vergence - last.c)

    def plane_seen_at(self, distance: Number) -> Number:
        """Distance of the plane before the farthest element that is seen at a distance before the main lens [mm]."""
        far, last = self.front
        here = times(last.medium, minus(times(distance, last.a), last.b))
        return plus(far, _over(here, minus(last.d, times(distance, last.c))))

    def mapped_images(self) -> Iterator[tuple[StandingElement, ImagedPlane]]:
        """Each objective with a mapping, and its image plane of what is far: heights there are focal length times p."""
        for part, step in zip(self.parts, self.steps[1:], strict=True):
            if not part.element.mapping_name:
                continue
            f, (_, _, c, d) = part.at["focal_length"], step.matrix
            shifts = (-f * lean for _, lean in step.shifts)
            centre = (part.at.numbers[f"main_lens.decentre.{axis}"] for axis in (0, 1))
            # Its middle is where p = 0, whatever the decentre of the part.
            x, y = (s + (own - at) for s, own, at in zip(shifts, part.at.pair("decentre"), centre, strict=True))
            yield part, ImagedPlane(f * c, f * d, 0.0, 0.0, (x, y), (0.0, 0.0), 1.0)

    def apart(self, stops: Mapping[str, Number]) -> Iterator[tuple[str, Number]]:
        """Pairs of elements and stops that might stand in each other, in words, and the room between [mm]."""
        for part, (name, stop) in product(self.parts, stops.items()):
            yield f"{name} and {part.name} {COLLIDE}", np.maximum(part.start - stop, stop - part.end)
        for part, farther in pairwise(self.parts):
            yield f"{part.name} and {farther.name} {COLLIDE}", farther.start - (part.end + part.rims_before(farther))


@dataclass(frozen=True)
class Chain:
    """Elements before the main lens, the medium before them, and the glass about the microlens array."""

    elements: tuple[AnyElement, ...]
    housing: float = 0.0
    """Expansion of what spaces the surfaces of an element by prescription [1/K]."""
    plates_before: tuple[str, ...] = ()
    """Places of the glass before the microlenses: `SUBSTRATE` where they face the sensor."""
    plates_behind: tuple[str, ...] = ()
    """Places of the glass behind them: `SUBSTRATE`, `COVER`."""
    stop_behind: bool = False
    """Whether a stop stands behind the main lens: planes below 0 are then seen through it."""
    main_lens: LensSheet | None = None
    """Data sheet of the main lens, which may map angles and tell light over the field."""
    bores: tuple[str, ...] = ()
    """Places of the openings that are the tube's own bore."""
    stops: tuple[str, ...] = ()
    """Names of the further stops."""
    fitted: tuple[str, ...] = ()
    """Places of the stops that are as wide as the tube leaves them."""

    @property
    def _names(self) -> dict[str, tuple[str, ...]]:
        """Names of elements and stops, by the heads of their places."""
        names = (element_name(part, k + 1) for k, part in sorted(self._outwards, key=itemgetter(0)))
        return {"elements": tuple(names), "stops": self.stops}

    def place_named(self, place: str) -> str:
        """Place with a part's number for its name: "elements.objective.distance" is "elements.9.distance"."""
        head, _, rest = place.partition(".")
        if head not in ("elements", "stops") or rest[:1] == "*" or rest.partition(".")[0].isdigit():
            return place
        meant = [(name, k) for k, name in enumerate(self._names[head]) if f"{rest}.".startswith(f"{name}.")]
        name, k = max(meant, key=lambda one: len(one[0]), default=("", 0))
        return f"{head}.{k}{rest.removeprefix(name)}" if meant else place

    def called(self, place: str) -> str:
        """Place as a reader knows it, with a part's given name for its number."""
        head, _, rest = place.partition(".")
        number, dot, key = rest.partition(".")
        known = self._names.get(head, ()) if number.isdigit() else ()
        if not known or int(number) >= len(known):  # of a bore that stands in a study's file, say
            return place
        name = known[int(number)]
        own = self.elements[int(number)].name if head == "elements" else name != f"stop {int(number) + 1}"
        return f"{head}.{name}{dot}{key}" if own else place

    @property
    def in_air(self) -> bool:
        """Whether light meets nothing but the main lens, f tan at that, stops before it and microlenses."""
        return not (self.plates_before or self.plates_behind or self.stop_behind or self.bends_rays)

    @property
    def bends_rays(self) -> bool:
        """Whether light goes otherwise before the main lens than straight on: elements, or its own mapping."""
        return bool(self.elements) or self.mapping.bends

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Elements from the main lens outwards."""
        return tuple(sorted(range(len(self.elements)), key=lambda k: self.elements[k].distance))

    @cached_property
    def _outwards(self) -> tuple[tuple[int, AnyElement], ...]:
        """Elements from the main lens outwards, with which of the design's each is."""
        return tuple((k, self.elements[k]) for k in self.order)

    @cached_property
    def folding(self) -> tuple[AnyElement, ...]:
        """Elements that turn the axis or reverse pictures, from the main lens outwards."""
        return tuple(part for _, part in self._outwards if part.turn or part.reverses)

    @cached_property
    def folds(self) -> tuple[Fold, ...]:
        """Mirrors and prisms at which drawings are folded, from the main lens outwards."""
        return tuple(Fold.of(part) for part in self.folding if part.turn)

    @property
    def leans(self) -> bool:
        """Whether a clear aperture leans by design."""
        return any(part.leans for part in self.folding)

    @cached_property
    def signed(self) -> frozenset[str]:
        """Places of numbers that may have either sign."""
        return frozenset(f"elements.{k}.{key}" for k, part in self._outwards for key in part.signed)

    @cached_property
    def fold(self) -> NDArray[np.float64]:
        """True directions in front of all elements by those of the unfolded axis, (3, 3)."""
        return reduce(np.matmul, [fold_of(part.turn, part.towards, part.reverses) for part in self.folding], np.eye(3))

    @cached_property
    def mirrored(self) -> NDArray[np.float64]:
        """Direction across the axis along which the scene is seen reversed, of unit length; 0 where it is not.

        An odd number of reflections does that: along the direction into which the last of them turns the view.
        """
        odd = [part.towards for part in self.folding if part.reverses]
        return np.array([math.cos(odd[-1]), math.sin(odd[-1])]) if len(odd) % 2 else np.zeros(2)

    def unfolded(self, points: Sequence[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
        """Points of the scene, x, y and distance, where the unfolded system has them."""
        away = self.mirrored
        return [
            (x - 2 * (along := away[0] * x + away[1] * y) * away[0], y - 2 * along * away[1], z) for x, y, z in points
        ]

    @cached_property
    def mapped(self) -> str:
        """Place of the mapping of angles in a design; empty where light goes on as to first order."""
        own = "main_lens.sheet.distortion" if self.mapping.bends else ""
        return next((f"elements.{k}.mapping" for k, part in self._outwards if part.mapping_name), own)

    def mapped_from(self, numbers: Mapping[str, Number]) -> Number:
        """Distance of what maps angles from the main lens [mm], beyond which its mapping holds; else infinite."""
        return numbers.get(f"{self.mapped.removesuffix('.mapping')}.distance", 0.0) if self.mapped else math.inf

    @cached_property
    def mapping(self) -> AngleMap:
        """Mapping of angles by the objective, else by the main lens; f tan where neither has one."""
        own = F_TAN if self.main_lens is None else self.main_lens.angle_map
        return next((part.angle_map for _, part in self._outwards if part.mapping_name), own)

    def at(self, numbers: Mapping[str, Number], k: int) -> PartNumbers:
        """Numbers of an element."""
        return PartNumbers(numbers, f"elements.{k}", self.housing)

    def length(self, numbers: Mapping[str, Number], k: int) -> Number:
        """Length of an element along the axis [mm]."""
        return self.elements[k].span(self.at(numbers, k))

    def standing(self, numbers: Mapping[str, Number]) -> tuple[StandingElement, ...]:
        """Elements where they stand, from the main lens outwards."""
        last, medium = self.order[-1:], numbers.get(MEDIUM, 1.0)
        numbered = ((k, part, self.at(numbers, k), medium if k in last else 1.0) for k, part in self._outwards)
        return tuple(StandingElement(k, part, at, at["distance"], part.span(at), n) for k, part, at, n in numbered)

    def walk(self, numbers: Mapping[str, Number]) -> BoreWalk:
        """Light through all elements, from the main lens outwards."""
        parts = self.standing(numbers)
        steps = [_ChainStep((1.0, 0.0, 0.0, 1.0), ((0.0, 0.0), (0.0, 0.0)), 0.0)]
        for part in parts:
            step = steps[-1].propagated(part.start - steps[-1].place)
            steps.append(part.through(step, part.length, np.True_))
        focal_length = numbers.get(FOCAL) if self.stop_behind else None  # not known yet of a lens by prescription
        power = 0.0 if focal_length is None else 1 / focal_length
        ends = [max(_most(part.start), _most(step.place)) for part, step in zip(parts, steps[1:], strict=True)]
        return BoreWalk(parts, tuple(steps), numbers.get(MEDIUM, 1.0), power, tuple(accumulate(ends, max)))

    def plane(self, numbers: Mapping[str, Number], z: Number) -> ImagedPlane:
        """The plane at z before the main lens [mm]; on a thin lens, the lens not yet passed."""
        return self.walk(numbers).plane(z)

    def telecentric(self, numbers: Mapping[str, Number], fap: Number) -> Flags:
        """Whether the scene sees what stands at `fap` [mm before the main lens] at infinity, or all but."""
        (_, last), plane = self.front(numbers), self.plane(numbers, fap)
        return np.abs(last.d * plane.a - last.c * plane.b) < TELECENTRIC

    def seen_plane(self, numbers: Mapping[str, Number]) -> Number:
        """d_f of the focal plane's image in the air before the main lens [mm]."""
        return self.plane(numbers, numbers[PLANE]).distance

    def apparent_values(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Conjugates as they are seen in air, with what of them is given; other places as they are.

        Where stops stand is left out: the air before the main lens is no place to compare them in.
        """
        if self.in_air:
            return dict(values)
        apparent = {place: value for place, value in values.items() if not place.startswith(("aperture.", "stops."))}
        if values.get(PLANE) is not None:
            apparent[PLANE] = self.seen_plane(values)
        if (distance := values.get(DISTANCE)) is not None:
            apparent[DISTANCE] = distance - self.before_array(values)
        return apparent

    def forms_image(self, focal_length: Number, plane: Number, array: Number) -> Flags:
        """True where an image of the focal plane forms on the array; all lengths as the main lens sees them [mm].

        Behind what bends light in the bore, the main lens may as well see that plane at infinity or beyond.
        """
        if self.bends:
            return np.greater(array, 0)
        return np.greater(plane, focal_length) & np.greater(array, focal_length)

    def front(self, numbers: Mapping[str, Number]) -> tuple[Number, ImagedPlane]:
        """The farthest element's scene side: its distance [mm before the main lens], and the plane, all passed."""
        return self.walk(numbers).front

    @cached_property
    def foremost_power(self) -> int:
        """How many elements reach up to the farthest that changes what size things are seen in; 0 where none does."""
        return max((n for n, (_, part) in enumerate(self._outwards, 1) if part.bends), default=0)

    @property
    def bends(self) -> bool:
        """Whether anything in it changes what size things are seen in."""
        return self.foremost_power > 0

    def past_infinity(self, numbers: Mapping[str, Number], plane: Number, walk: BoreWalk | None = None) -> Flags:
        """True where light would have to come in converging, to be in focus on the array as a plane is.

        Backwards from the array, such light diverges as it leaves the foremost part with power. A plane in the bore
        that it does come together at lies between that part and the end.
        """
        past = ~np.greater_equal(plane, self.end(numbers))
        if not np.any(past):
            return np.asarray(past)
        steps = (walk or self.walk(numbers)).steps
        (a, b, c, d), last = steps[self.foremost_power].matrix, steps[-1].matrix
        # Flat glass and air behind it: A and B grow by their reduced length, times C and D.
        room = ((last[0] - a) * c + (last[1] - b) * d) / (c * c + d * d)
        ahead = (plane - steps[-1].place) / numbers.get(MEDIUM, 1.0) + room
        return np.asarray(past & ~np.greater(ahead, 0))

    def stands_at(self, numbers: Mapping[str, Number], distance: Number) -> Number:
        """Distance by a ruler of a plane that is seen at a distance through flat glass [mm]; nan inside glass."""
        place: Number = 0.0
        reduced: Number = 0.0
        stands: Number = np.full(np.shape(distance), np.nan)
        for part in self.standing(numbers):
            before = np.greater_equal(distance, reduced) & np.less_equal(distance, reduced + (part.start - place))
            stands = np.where(before, place + (distance - reduced), stands)
            through = part.element.forward(part.at, part.length, np.True_)[1]
            reduced = reduced + (part.start - place) + through
            place = part.end
        medium = numbers.get(MEDIUM, 1.0)
        return np.where(np.greater_equal(distance, reduced), place + medium * (distance - reduced), stands)[()]

    def end(self, numbers: Mapping[str, Number]) -> Number:
        """The scene's side of the farthest element [mm before the main lens]; 0 where there is none."""
        return sum((numbers[f"elements.{k}.distance"] + self.length(numbers, k) for k in self.order[-1:]), 0.0)

    def before_array(self, numbers: Mapping[str, Number]) -> Number:
        """Length that glass before the microlenses takes off d_1, ``t (1 - 1/n)`` [mm]."""
        return sum((_shortened(numbers, place) for place in self.plates_before), 0.0)

    def behind_array(self, numbers: Mapping[str, Number]) -> Number:
        """Length that glass behind the microlenses takes off d_2 [mm]."""
        return sum((_shortened(numbers, place) for place in self.plates_behind), 0.0)

    def followed(self, numbers: Mapping[str, Number], key: str, walk: BoreWalk | None = None) -> Number:
        """The value of one of f, d_f and d_1 that the other two in `numbers` give [mm]; `walk` where it is known."""
        array = 0.0 if key == DISTANCE else numbers[DISTANCE] - self.before_array(numbers)
        if key == PLANE and self.order:  # in vergences: what is in focus may be seen at infinity and beyond
            f = numbers[FOCAL]
            return (walk or self.walk(numbers)).plane_of_vergence((array - f) / (array * f))
        apparent = {**numbers, DISTANCE: array}
        if key != PLANE:
            apparent[PLANE] = self.seen_plane(numbers)
        value = followed(apparent, key)
        return value + self.before_array(numbers) if key == DISTANCE else value


def _all(flags: bool | Flags) -> bool:
    return flags if isinstance(flags, bool) else bool(np.all(flags))


def _most(a: Number) -> float:
    """The largest; infinite where one is undefined."""
    most = a if isinstance(a, float) else float(np.max(np.real(a), initial=-math.inf))
    return math.inf if math.isnan(most) else most


def _smaller(a: Number, b: Number) -> Number:
    """The smaller, of plain numbers without numpy's cost."""
    return min(a, b) if isinstance(a, float) and isinstance(b, float) else np.minimum(a, b)


def _larger(a: Number, b: Number) -> Number:
    """The larger, of plain numbers without numpy's cost."""
    return max(a, b) if isinstance(a, float) and isinstance(b, float) else np.maximum(a, b)


def _either(flags: bool | Flags, a: Number, b: Number) -> Number:
    """A where flags hold, else b."""
    if isinstance(a, float) and isinstance(b, float) and a == b:
        return a
    return np.where(flags, a, b)[()]


def _over(a: Number, b: Number) -> Number:
    """Quotient with its limits; exact ones cost nothing."""
    return a if isinstance(b, float) and b == 1.0 else ratio(a, b)


def _shortened(numbers: Mapping[str, Number], part: str) -> Number:
    index = numbers[f"{part}.index"]
    return numbers[f"{part}.thickness"] * (index - 1) / index
