"""One camera for everything that computes: a design's numbers, each a float or an array over builds.

Builds are whatever a caller has many of: tolerance trials, sweep points, an optimiser's candidates, walkers. Nothing is
refused here: a camera that cannot be built keeps its numbers, and `Camera.valid` tells which can.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import same
from ..bore.chain import Chain
from ..bore.conjugates import CONJUGATES, follower
from ..bore.main_lens import HIATUS, IdealMainLens, MainLensKind
from ..bore.opening import ClearAperture
from ..bore.part import TEMPERATURE, Colours, Layout, Number
from ..catalogue.entries import stock_of
from ..design import Design, DesignError, Problem
from ..design.growth import Growth
from ..design.parts import BEHIND, PATHS, tube_room
from ..design.required import ROUND_ANGLE, ROUND_RADIUS, Required
from ..errors import expect
from ..lenses.glass import ROOM, Glass
from ..toml_files import nearest
from .numbers import TEMPERATURES, TYPES, numbers_of, possible
from .poses import PosedParts

APPARENT = ("d_f", "d_1", "d_2", "d_3", "D_F", "H", "inverse_H", "A", "m", "inverse_m", "gap", "vergence")
"""Lengths, and what follows from them, that the main lens may see otherwise than a ruler."""


class _Kind(NamedTuple):
    """Properties of a camera beside its numbers."""

    layout: Layout = "square"
    """Layout of the microlens array, as in a design file."""
    lens_shape: str = "square"
    lens: MainLensKind = IdealMainLens()
    chain: Chain = Chain(())
    """Parts that light meets beside the main lens."""
    materials: Mapping[str, Glass] = {}
    """Place of an index to the material it is of, for other wavelengths."""
    growth: Growth | None = None
    """Change of the numbers with temperature; None of a design without `[environment]`."""
    colours: Colours = "mono"
    """Colours of the filters on the sensor's pixels, as in a design file."""
    round_fields: tuple[Required, ...] = ()
    """Round fields that are required: images are to be whole at their rims, not in the sensor's corners."""
    stock: tuple[float, float] | None = None
    """Size [mm] of the stock that the array is cut from, where the design names such a part."""

    @property
    def hashable(self) -> tuple[Any, ...]:
        """Key of the same properties."""
        return tuple(frozenset(part.items()) if isinstance(part, Mapping) else part for part in self)


class Camera(PosedParts):
    """A light-field camera that looks through a restricted object space, as numbers.

    The paper's symbols are attributes, all lengths in mm; every one is a float or an array, and all broadcast together
    to `shape`. ``f``, ``D``, ``d``, ``q`` have one meaning. ``d_f``, ``d_1``, ``d_2``, ``d_3``, ``D_F`` stand under
    `ruler` as a ruler finds them and under `seen` as the main lens sees them, with ``H``, ``m`` and ``A``; on the
    camera itself where both agree, as in air (else `AttributeError` names both).

    Parameters
    ----------
    numbers : mapping
        Dotted place of the design to its number(s); f, d_f and d_1 all there and agreeing.
    kind : optional
        Its properties beside the numbers; an ideal lens in air where not given.

    Examples
    --------
    >>> import numpy as np, roslf_design as roslf
    >>> camera = roslf.Camera.of(roslf.load("paper"), {"d_3": np.linspace(0, 300, 4)})
    >>> camera.H
    array([1.        , 1.4       , 2.33333333, 7.        ])
    """

    def __init__(self, numbers: Mapping[str, Number], kind: _Kind | None = None) -> None:
        self._numbers, self._kind = numbers, kind or _Kind()
        self.layout, self.lens_shape, self.lens, self.chain = self._kind[:4]
        self.materials, self.growth, self.colours, self.round_fields, self.stock = self._kind[4:]

    def _with(self, numbers: Mapping[str, Number]) -> Camera:
        return Camera(numbers, self._kind)

    @classmethod
    def of(cls, design: Design, changes: Mapping[str, ArrayLike] | None = None, /, *, in_focus: bool = False) -> Camera:
        """The camera of a design, with numbers or arrays in place of some of its values.

        Parameters
        ----------
        design : Design
            Gives every number that is not changed.
        changes : mapping, optional
            Dotted place ("aperture.decentre.0") or the paper's symbol ("d_3") to a number or an array over builds.
            Of f, d_f and d_1 the same one follows as in `Design.replace`. Other numbers beside a temperature are those
            at the design's own.
        in_focus : bool
            Whether the microlenses' focal length follows the focus, ``1/f_ml = 1/d_2 + 1/L``.

        Raises
        ------
        DesignError
            A place that the design has not, or that is no number; arrays that do not broadcast; f, d_f and d_1 all
            three.
        """
        expect(design, "design", Design, "a Design, as `roslf_design.load` gives it")
        camera = _nominal(design)
        if not changes and not in_focus:
            return camera
        changes = changes or {}
        if all(key in {PATHS.get(place, place) for place in changes} for key in CONJUGATES):
            raise DesignError((Problem(", ".join(CONJUGATES), "vary two of these; the third follows"),))
        camera = camera.replace(changes, in_focus=in_focus)
        try:
            _ = camera.shape
        except ValueError:
            shapes = ", ".join(f"{place} {np.shape(value)}" for place, value in changes.items())
            raise DesignError((Problem("", f"shapes do not broadcast together: {shapes}"),)) from None
        return camera

    def replace(self, changes: Mapping[str, ArrayLike], *, in_focus: bool = False) -> Camera:
        """Camera with other numbers at some places; parameters and errors as for `of`."""
        given = {self.chain.place_named(PATHS.get(place, place)): value for place, value in changes.items()}
        if "q" in changes:  # a symbol of the paper: the pixel as the microlenses see it, in front of the relay
            relay = given.get("sensor.relay_magnification", self["sensor.relay_magnification"])
            given[PATHS["q"]] = np.multiply(changes["q"], relay)
        numbers = dict(self._numbers)
        if self.chain.stop_behind and BEHIND in given:
            given[PATHS["d_3"]] = np.negative(given.pop(BEHIND))
        given = self._widened(given)
        for place, value in given.items():
            if place not in numbers:
                warm = place == TEMPERATURE  # of a design that says nothing of it
                hint = (
                    "add [environment] with a housing"
                    if warm
                    else nearest(place, [*PATHS, *map(self.chain.called, numbers)])
                )
                raise DesignError((Problem(place, f"is not a number of this design; {hint}"),))
            numbers[place] = _number(value)
        if PATHS["wavelength"] in given:
            if unknown := self.lens.follows - given.keys():
                given |= self.lens.in_light(given[PATHS["wavelength"]])
                numbers |= {place: _number(given[place]) for place in unknown}
            for place in self.materials.keys() - given.keys():
                index = np.vectorize(self.materials[place].index, otypes=[np.float64])
                moved = index(given[PATHS["wavelength"]]) - index(self[PATHS["wavelength"]])
                given[place] = numbers[place] = _number(self[place] + moved)
        if TEMPERATURE in given and self.growth is not None:
            moved = self.growth.moved(numbers, self[TEMPERATURE], numbers[TEMPERATURE])
            numbers |= {place: _number(value) for place, value in moved.items()}
        coldest, warmest, known = TEMPERATURES
        if TEMPERATURE in given and coldest in numbers and not given.keys() & {coldest, warmest}:  # asked at it alone
            numbers.setdefault(known, _number((numbers[coldest] + numbers[warmest]) / 2))
            numbers |= dict.fromkeys((coldest, warmest), numbers[TEMPERATURE])
        numbers |= {place: width for place, width in self._as_tube(numbers).items() if place not in given}
        camera, key = self._with(numbers), follower(given)
        if key is not None:  # no way through the bore hangs on d_f, which is no more than where the camera looks
            numbers[key] = self.chain.followed(numbers, key, camera._walk if key == PATHS["d_f"] else None)
        if in_focus:
            numbers[PATHS["f_ml"]] = camera.seen.d_2 / (1 + camera.seen.d_2 * camera.seen.vergence)
        return camera

    def _as_tube(self, numbers: Mapping[str, Number]) -> dict[str, Number]:
        """Diameters, by place, of the rims that are as wide as a tube leaves them."""
        if not self.chain.fitted:
            return {}
        tip = self._with(numbers).tip  # which asks no rim how wide it is
        return {
            f"{rim}.diameter": _number(tube_room(numbers, tip - numbers[f"{rim}.distance"]))
            for rim in self.chain.fitted
        }

    def _widened(self, given: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
        """Numbers with D_F as the lengths of a FAP that is no disc: all grow alike."""
        if PATHS["D_F"] not in given or PATHS["D_F"] in self._numbers:
            return dict(given)
        rest = {place: value for place, value in given.items() if place != PATHS["D_F"]}
        own = ClearAperture.of({**self._numbers, **{k: _number(v) for k, v in rest.items()}}, "aperture")
        grown = np.divide(given[PATHS["D_F"]], own.width)
        lengths = zip(own.keys, own.lengths, strict=True)
        return rest | {f"aperture.{key}": np.multiply(length, grown) for key, length in lengths}

    @property
    def likeness(self) -> tuple[Any, ...]:
        """Key that cameras share which differ in numbers alone, and can be `joined`."""
        return frozenset(self._numbers), *self._kind.hashable

    @classmethod
    def joined(cls, cameras: Sequence[Camera]) -> Camera:
        """Camera of many builds, the numbers of each those of one of the `cameras`, all of the same `likeness`."""
        first, *rest = cameras
        numbers = {place: [value, *(camera[place] for camera in rest)] for place, value in first.numbers.items()}
        return first._with({p: v[0] if all(one == v[0] for one in v) else np.array(v) for p, v in numbers.items()})

    @property
    def as_measured(self) -> Camera:
        """Camera whose lengths are as measured at whatever temperature: `replace` moves none of them with it."""
        return Camera(self._numbers, self._kind._replace(growth=None))

    @cached_property
    def cold(self) -> Camera:
        """The camera at 20 degrees C, at which sizes of parts are stated (ISO 1); itself where it is not warm."""
        if self.growth is None or np.all(np.equal(self[TEMPERATURE], ROOM)):
            return self
        return self.replace({TEMPERATURE: ROOM})

    def without(self, places: Collection[str]) -> Camera:
        """Camera without numbers that need not be given."""
        return self._with({place: value for place, value in self._numbers.items() if place not in places})

    @property
    def microlens_types(self) -> tuple[Camera, ...]:
        """Cameras with microlenses of each type alone; this one where all are alike."""
        types = [place for place in self._numbers if place.startswith(TYPES)]
        first = self.without(types) if types else self
        return (first, *(first.replace({PATHS["f_ml"]: self[place]}) for place in types))

    def behind_filter(self, numbers: Mapping[str, Number]) -> Camera:
        """Camera as the pixels of one colour see it, all pixels alike: other light, no other glass.

        Parameters
        ----------
        numbers : mapping
            Places of `VIEWING_CONDITIONS` and the wavelength, with what they are there.
        """
        return Camera({**self._numbers, **numbers}, self._kind._replace(colours="mono"))

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name not in APPARENT:
                raise AttributeError(f"'Camera' object has no attribute '{name}'")
            seen = getattr(self.seen, name)
            ruler = getattr(self.ruler, name, None)
            if self.chain.in_air or (ruler is not None and np.array_equal(ruler, seen)):
                return seen
            where = f"{_shown(seen)} as the main lens sees it (camera.seen.{name})"
            if ruler is None:
                raise AttributeError(f"{name} is {where}, which is no mechanical distance: ask camera.seen.{name}")
            mechanical = f"{_shown(ruler)} as a mechanical distance (camera.ruler.{name})"
            raise AttributeError(f"{name} is {mechanical} and {where}: say which")

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Common shape of the builds; () for one camera."""
        return np.broadcast_shapes(*{value.shape for value in self._numbers.values() if isinstance(value, np.ndarray)})

    def build(self, index: int | tuple[int, ...]) -> Camera:
        """Camera of one build out of many."""
        numbers = {p: float(np.broadcast_to(v, self.shape)[index]) for p, v in self._numbers.items()}
        return self._with(numbers)

    def in_row(self, shape: tuple[int, ...], part: slice | NDArray[np.intp]) -> Camera:
        """Some of its builds, broadcast to a shape, one after the other."""
        numbers = {p: np.broadcast_to(v, shape).ravel()[part] if np.ndim(v) else v for p, v in self._numbers.items()}
        return self._with(numbers)

    def with_axes(self, axes: int) -> Camera:
        """Camera of the same builds with `axes` axes of length 1 behind them, for fields, distances or rays."""
        behind = (1,) * axes
        numbers = {
            place: value.reshape(value.shape + behind) if isinstance(value, np.ndarray) and value.ndim else value
            for place, value in self._numbers.items()
        }
        return self._with(numbers)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        return same(self._kind, other._kind) and same(self._numbers, other._numbers)

    def __hash__(self) -> int:
        # Adding 0 makes -0 and 0, which are equal, hash alike; as do a complex number and its real part.
        numbers = frozenset((place, (np.asarray(value).real + 0.0).tobytes()) for place, value in self._numbers.items())
        return hash((numbers, self.likeness))

    def __reduce__(self) -> tuple[Any, ...]:
        return Camera, (dict(self._numbers), self._kind)

    def __repr__(self) -> str:
        shown = ", ".join(
            f"{symbol}={value:.6g}" if np.ndim(value) == 0 else f"{symbol}=array{np.shape(value)}"
            for symbol, place in PATHS.items()
            for value in [self.ruler.D_F if symbol == "D_F" else self.q if symbol == "q" else self[place]]
        )
        return f"Camera({shown})"

    @property
    def array_size(self) -> tuple[Number, Number]:
        """Width and height of the microlens array [mm]."""
        return self._numbers["microlens_array.size.0"], self._numbers["microlens_array.size.1"]

    @property
    def hiatus(self) -> Number:
        """Distance between the main lens's principal planes, which lengths along the outside have besides [mm]."""
        return self._numbers.get(HIATUS, self.lens.gap)

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """True where a build is a camera, shape `shape`.

        Finite numbers, positive sizes, a real image, every stop nearer than the object plane, no part in another, tilts
        below 90 degrees.
        """
        good: NDArray[np.bool_] = np.asarray(True)
        with np.errstate(invalid="ignore"):
            for conditions in self._conditions():
                for _, holds in conditions:
                    good = good & holds
        return np.broadcast_to(good, self.shape)

    def faults(self) -> dict[str, NDArray[np.bool_]]:
        """Reasons why builds are no cameras: each in words, with True where it holds, shape `shape`.

        What follows from a reason is not told: of a build without a real image not where that would lie.
        """
        reasons: dict[str, NDArray[np.bool_]] = {}
        sound = np.ones(self.shape, np.bool_)
        with np.errstate(invalid="ignore"):
            for conditions in self._conditions():
                fresh = {words: sound & ~np.asarray(holds) for words, holds in conditions}
                sound = sound & ~np.any(list(fresh.values()), axis=0)
                reasons |= fresh
        return reasons

    def rooms(self) -> Iterator[tuple[str, Number]]:
        """Pairs of elements and stops, in the words of `faults`, and the room between them [mm]: below 0, none."""
        return self._walk.apart({rim.name: rim.ruler_distance for rim in self.stop_openings})

    def _conditions(self) -> tuple[Iterator[tuple[str, Any]], ...]:
        """Conditions that a camera holds, with the message where it does not.

        No message twice; later ones follow on earlier.
        """
        return self._images_well(), possible(self._numbers, self.chain.signed), self._fits()

    def _images_well(self) -> Iterator[tuple[str, Any]]:
        for known, within in () if self.growth is None else self.growth.known(self[TEMPERATURE]):
            yield f"a temperature outside what is known of {known}", within
        yield "f is not above 0", np.asarray(self.f) > 0
        yield "f_ml is not above 0", np.asarray(self.f_ml) > 0
        yield "no real image", self.chain.forms_image(self.f, self.seen.d_f, self.seen.d_1)
        yield "d_2 is not above 0", np.asarray(self.seen.d_2) > 0

    def _fits(self) -> Iterator[tuple[str, Any]]:
        plane = np.asarray(self._numbers[PATHS["d_f"]])
        past = self.chain.past_infinity(self._numbers, plane, self._walk)
        yield "in focus beyond infinity", ~past
        ahead: Any = plane >= self.chain.end(self._numbers)
        for rim in self.openings_ahead:
            ahead = ahead & (np.asarray(rim.ruler_distance) < plane)
        yield "focal plane in the bore", ahead | past
        yield from ((words, room >= 0) for words, room in self.rooms())


def _shown(value: Number) -> str:
    return f"{value:.6g}" if np.ndim(value) == 0 else f"an array {np.shape(value)}"


def _number(value: ArrayLike) -> Number:
    """A float or an array, of double precision or, for derivatives, complex."""
    if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype in (np.float64, np.complex128)):
        return value
    array = np.asarray(value, np.float64)
    return array if array.ndim else float(array)


@lru_cache(maxsize=64)
def _nominal(design: Design) -> Camera:
    array, lens = design.microlens_array, design.main_lens.kind
    rounds = tuple(one for one in design.required if one.quantity in (ROUND_ANGLE, ROUND_RADIUS))
    stock = None if array.part is None else stock_of(array.part)
    beside = design.chain, design.materials, Growth.of(design), design.sensor.colours, rounds, stock
    return Camera(numbers_of(design), _Kind(array.layout, array.lens_shape, lens, *beside))
