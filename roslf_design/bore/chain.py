"""Light through what stands before the main lens: every plane of object space as two numbers.

A ray that leaves the main lens with height l and slope o (both against its axis) meets the plane at z at
``x = A l - B o + E``, and goes on there with index times slope ``-C l + D o + F``. In air A = 1 and B = z. The plane is
thus seen from the main lens as if it stood in air, B/A before it and 1/A as large: the closed forms, which know air
only, hold for what is seen. Paraxial; a plate is its reduced thickness t/n.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import ratio
from ..lenses.angles import F_TAN, AngleLaw, AngleMap, Law
from .conjugates import CONJUGATES, followed
from .elements import AnyElement, element_name
from .fold import Reflection, fold_of
from .part import Number, PartNumbers

Flags = np.bool_ | NDArray[np.bool_]

FOCAL, PLANE, DISTANCE = CONJUGATES
FARTHEST = 1e-12
"""A plane whose image lies at infinity is taken to lie this inverse magnification away: results are off by as much."""
TELECENTRIC = 1e-6
"""Size of the FAP over that of its image before all elements, below which the image is taken to lie at infinity."""
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
        return np.where(np.abs(self.a) < FARTHEST, np.where(self.a < 0, -FARTHEST, FARTHEST), self.a)[()]

    @property
    def distance(self) -> Number:
        """B/A, of its image before the main lens [mm]."""
        return self.b / self.magnification

    @property
    def depth(self) -> Number:
        """Millimetres that a point moves there over those that its image moves, ``n A^2``."""
        return self.medium * self.magnification**2


class ChainStep(NamedTuple):
    """Light somewhere before the main lens, in air."""

    matrix: tuple[Number, Number, Number, Number]
    """A, B, C and D."""
    shifts: tuple[tuple[Number, Number], tuple[Number, Number]]
    """E and F, along x and along y."""
    place: Number
    """Distance before the main lens [mm]."""

    def propagated(self, gap: Number) -> ChainStep:
        """Straight on by a reduced length; the place stays."""
        (a, b, c, d), ((e_x, f_x), (e_y, f_y)) = self.matrix, self.shifts
        shifts = (e_x - gap * f_x, f_x), (e_y - gap * f_y, f_y)
        return self._replace(matrix=(a + gap * c, b + gap * d, c, d), shifts=shifts)

    def plane(self, medium: Number) -> ImagedPlane:
        """The plane there, with an index on its scene's side."""
        (e_x, f_x), (e_y, f_y) = self.shifts
        return ImagedPlane(*self.matrix, (e_x, e_y), (f_x, f_y), medium)


@dataclass(frozen=True)
class Chain:
    """Elements before the main lens, the medium before them, and the glass about the microlens array."""

    elements: tuple[AnyElement, ...]
    lenslets: str = "scene"
    """Side that the lenslets on a substrate face."""
    housing: float = 0.0
    """Expansion of what spaces the surfaces of an element by prescription [1/K]."""
    plates: tuple[str, ...] = ()
    """Places of the plates about the array: `SUBSTRATE`, `COVER`."""

    @property
    def in_air(self) -> bool:
        """Whether light meets nothing but the main lens, stops and microlenses."""
        return not self.elements and not self.plates

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Elements from the main lens outwards."""
        return tuple(sorted(range(len(self.elements)), key=lambda k: self.elements[k].distance))

    @cached_property
    def folding(self) -> tuple[AnyElement, ...]:
        """Elements that turn the axis or reverse pictures, from the main lens outwards."""
        return tuple(
            element for element in map(self.elements.__getitem__, self.order) if element.turn or element.reverses
        )

    @cached_property
    def reflections(self) -> tuple[Reflection, ...]:
        """Mirrors at which drawings are folded, from the main lens outwards."""
        return tuple(Reflection.of(part) for part in self.folding if part.folds)

    @property
    def leans(self) -> bool:
        """Whether a clear aperture leans by design."""
        return any(part.leans for part in self.folding)

    @cached_property
    def signed(self) -> frozenset[str]:
        """Places of numbers that may have either sign."""
        return frozenset(f"elements.{k}.{key}" for k in self.order for key in self.elements[k].signed)

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
    def mapped(self) -> int | None:
        """Index of the element that is an objective with a mapping; None where light goes on as to first order."""
        return next((k for k, element in enumerate(self.elements) if element.law is not None), None)

    def mapped_from(self, numbers: Mapping[str, Number]) -> Number:
        """Distance of that objective from the main lens [mm], beyond which its mapping holds; else infinite."""
        return math.inf if self.mapped is None else numbers[f"elements.{self.mapped}.distance"]

    @property
    def law(self) -> Law | None:
        """Mapping of angles by the objective; None where it is f tan (`..lenses.angles`)."""
        return None if self.mapped is None else self.elements[self.mapped].law

    @cached_property
    def mapping(self) -> AngleMap:
        """Mapping of angles by the objective, f tan where it has none of its own."""
        return F_TAN if self.law is None else AngleLaw(self.law)

    def at(self, numbers: Mapping[str, Number], k: int) -> PartNumbers:
        """Numbers of an element."""
        return PartNumbers(numbers, f"elements.{k}", self.housing)

    def length(self, numbers: Mapping[str, Number], k: int) -> Number:
        """Length of an element along the axis [mm]."""
        return self.elements[k].span(self.at(numbers, k))

    def prefix_matrices(self, numbers: Mapping[str, Number]) -> tuple[ChainStep, ...]:
        """Light at the main lens, then on the scene's side of each element in turn: what all planes share."""
        steps = [ChainStep((1.0, 0.0, 0.0, 1.0), ((0.0, 0.0), (0.0, 0.0)), 0.0)]
        for k in self.order:
            start, length = numbers[f"elements.{k}.distance"], self.length(numbers, k)
            step = steps[-1].propagated(start - steps[-1].place)
            steps.append(self._through(numbers, k, step, length, np.True_)._replace(place=start + length))
        return tuple(steps)

    def plane(self, numbers: Mapping[str, Number], z: Number, walk: tuple[ChainStep, ...] | None = None) -> ImagedPlane:
        """The plane at z before the main lens [mm]; on a thin lens, the lens not yet passed.

        `prefix_matrices` is that of the numbers, for many planes.
        """
        if not self.elements:
            return ImagedPlane(1.0, z, 0.0, 1.0, (0.0, 0.0), (0.0, 0.0), 1.0)
        steps = self.prefix_matrices(numbers) if walk is None else walk
        behind = 0  # elements that every build's plane has behind it
        while behind < len(self.order):
            start = numbers[f"elements.{self.order[behind]}.distance"]
            if not (_all(z > start) and _all(z >= steps[behind + 1].place)):
                break
            behind += 1
        step = steps[behind]
        index: Number = 1.0
        for k in self.order[behind:]:
            start, length = numbers[f"elements.{k}.distance"], self.length(numbers, k)
            step = step.propagated(np.maximum(np.minimum(start, z) - step.place, 0.0))
            passed = np.greater(z, start)
            if not np.any(passed):
                return step.plane(index)
            inside = np.minimum(np.maximum(z - start, 0.0), length)
            step = self._through(numbers, k, step, inside, passed)._replace(place=start + length)
            glass = numbers.get(f"elements.{k}.index", 1.0)
            index = np.where(passed & np.less(z, step.place), glass, 1.0)[()]
        medium = numbers.get(MEDIUM, 1.0)
        outside = np.greater_equal(z, step.place)
        return step.propagated(np.maximum(z - step.place, 0.0) / medium).plane(np.where(outside, medium, index)[()])

    def _through(
        self, numbers: Mapping[str, Number], k: int, step: ChainStep, inside: Number, passed: Flags
    ) -> ChainStep:
        """Light past as much of an element."""
        element, at = self.elements[k], self.at(numbers, k)
        p, q, r, s = forward = element.forward(at, inside, passed)
        a, b, c, d = step.matrix
        matrix = s * a + q * c, s * b + q * d, r * a + p * c, r * b + p * d
        beyond = numbers.get(MEDIUM, 1.0) if k == self.order[-1] else 1.0
        x, y = (element.shifted(at, axis, forward, inside, step.shifts[axis], beyond) for axis in (0, 1))
        return ChainStep(matrix, (x, y), step.place)

    def mapped_image(self, numbers: Mapping[str, Number], walk: tuple[ChainStep, ...]) -> ImagedPlane:
        """Image plane of what is far, by the objective with a mapping: heights there are focal length times p."""
        assert self.mapped is not None
        part, step = f"elements.{self.mapped}", walk[1 + self.order.index(self.mapped)]
        f, (_, _, c, d) = numbers[f"{part}.focal_length"], step.matrix
        shifts = (-f * lean for _, lean in step.shifts)
        off = (numbers[f"{part}.decentre.{k}"] - numbers[f"main_lens.decentre.{k}"] for k in (0, 1))
        # Its middle is where p = 0, whatever the decentre of the part.
        x, y = (shift + by for shift, by in zip(shifts, off, strict=True))
        return ImagedPlane(f * c, f * d, 0.0, 0.0, (x, y), (0.0, 0.0), 1.0)

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

    def plane_of_vergence(self, numbers: Mapping[str, Number], vergence: Number) -> Number:
        """Distance of the plane before the farthest element that is seen at 1/distance before the main lens [mm]."""
        far, last = self.front(numbers)
        return far + ratio(last.medium * (last.a - last.b * vergence), last.d * vergence - last.c)

    def plane_seen_at(self, numbers: Mapping[str, Number], distance: Number) -> Number:
        """Distance of the plane before the farthest element that is seen at a distance before the main lens [mm]."""
        if not self.elements:
            return distance
        far, last = self.front(numbers)
        return far + ratio(last.medium * (distance * last.a - last.b), last.d - distance * last.c)

    def front(
        self, numbers: Mapping[str, Number], walk: tuple[ChainStep, ...] | None = None
    ) -> tuple[Number, ImagedPlane]:
        """The farthest element's scene side: its distance [mm before the main lens], and the plane, all passed."""
        last = (self.prefix_matrices(numbers) if walk is None else walk)[-1]
        return last.place, last.plane(numbers.get(MEDIUM, 1.0))

    @cached_property
    def foremost_power(self) -> int:
        """How many elements reach up to the farthest that changes what size things are seen in; 0 where none does."""
        return max((n for n, k in enumerate(self.order, 1) if self.elements[k].bends), default=0)

    @property
    def bends(self) -> bool:
        """Whether anything in it changes what size things are seen in."""
        return self.foremost_power > 0

    def past_infinity(self, numbers: Mapping[str, Number], plane: Number) -> Flags:
        """True where light would have to come in converging, to be in focus on the array as a plane is.

        Backwards from the array, such light diverges as it leaves the foremost part with power. A plane in the bore
        that it does come together at lies between that part and the end.
        """
        past = ~np.greater_equal(plane, self.end(numbers))
        if not np.any(past):
            return np.asarray(past)
        steps = self.prefix_matrices(numbers)
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
        for k in self.order:
            start, length = numbers[f"elements.{k}.distance"], self.length(numbers, k)
            before = np.greater_equal(distance, reduced) & np.less_equal(distance, reduced + (start - place))
            stands = np.where(before, place + (distance - reduced), stands)
            reduced = reduced + (start - place) + self.elements[k].forward(self.at(numbers, k), length, np.True_)[1]
            place = start + length
        medium = numbers.get(MEDIUM, 1.0)
        return np.where(np.greater_equal(distance, reduced), place + medium * (distance - reduced), stands)[()]

    def end(self, numbers: Mapping[str, Number]) -> Number:
        """The scene's side of the farthest element [mm before the main lens]; 0 where there is none."""
        if not self.elements:
            return 0.0
        k = self.order[-1]
        return numbers[f"elements.{k}.distance"] + self.length(numbers, k)

    def apart(self, numbers: Mapping[str, Number], stops: Mapping[str, Number]) -> Iterator[tuple[str, Flags]]:
        """Pairs of elements and stops that might stand in each other, in words, and True where they do not."""
        names = [element_name(element, k) for k, element in enumerate(self.elements, 1)]
        for k, (name, stop) in product(self.order, stops.items()):
            start = numbers[f"elements.{k}.distance"]
            clear = np.less_equal(stop, start) | np.greater_equal(stop, start + self.length(numbers, k))
            yield f"{name} and {names[k]} collide", clear
        for k, farther in pairwise(self.order):
            ends = numbers[f"elements.{k}.distance"] + self.length(numbers, k)
            wide, tall = (numbers.get(f"elements.{part}.diameter", math.inf) for part in (k, farther))
            between = self.elements[k].reach(wide, tall / 2) + self.elements[farther].reach(tall, wide / 2)
            clear = np.less_equal(ends + between, numbers[f"elements.{farther}.distance"])
            yield f"{names[k]} and {names[farther]} collide", clear

    def before_array(self, numbers: Mapping[str, Number]) -> Number:
        """Length that glass before the microlenses takes off d_1, ``t (1 - 1/n)`` [mm]."""
        return _shortened(numbers, SUBSTRATE) if self.lenslets == "sensor" else 0.0

    def behind_array(self, numbers: Mapping[str, Number]) -> Number:
        """Length that glass behind the microlenses takes off d_2 [mm]."""
        substrate = _shortened(numbers, SUBSTRATE) if self.lenslets == "scene" else 0.0
        return substrate + _shortened(numbers, COVER)

    def followed(self, numbers: Mapping[str, Number], key: str) -> Number:
        """The value of one of f, d_f and d_1 that the other two in `numbers` give [mm]."""
        array = 0.0 if key == DISTANCE else numbers[DISTANCE] - self.before_array(numbers)
        if key == PLANE and self.elements:  # in vergences: what is in focus may be seen at infinity and beyond
            f = numbers[FOCAL]
            return self.plane_of_vergence(numbers, (array - f) / (array * f))
        apparent = {**numbers, DISTANCE: array}
        if key != PLANE:
            apparent[PLANE] = self.seen_plane(numbers)
        value = followed(apparent, key)
        return value + self.before_array(numbers) if key == DISTANCE else value


def _all(flags: bool | Flags) -> bool:
    return flags if isinstance(flags, bool) else bool(np.all(flags))


def _shortened(numbers: Mapping[str, Number], part: str) -> Number:
    if f"{part}.thickness" not in numbers:
        return 0.0
    index = numbers[f"{part}.index"]
    return numbers[f"{part}.thickness"] * (index - 1) / index
