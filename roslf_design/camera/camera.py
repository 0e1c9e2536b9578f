"""One camera for everything that computes: a design's numbers, each a float or an array over builds.

Builds are whatever a caller has many of: tolerance trials, sweep points, an optimiser's candidates, walkers. Nothing is
refused here: a camera that cannot be built keeps its numbers, and `Camera.valid` tells which can.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from operator import attrgetter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array, magnitude, same
from ..bore.chain import BoreWalk, Chain, ImagedPlane, StandingElement
from ..bore.conjugates import CONJUGATES, follower
from ..bore.lens import IMAGE
from ..bore.main_lens import HIATUS, IdealMainLens, MainLensKind
from ..bore.opening import ClearAperture
from ..bore.part import TEMPERATURE, Colours, Layout, Number, PartNumbers, minus, plus, times
from ..design import Design, DesignError, Problem
from ..design.growth import Growth
from ..design.parts import BEHIND, PATHS, Symbols
from ..design.required import ROUND_ANGLE, ROUND_RADIUS, Required
from ..errors import expect
from ..lenses.angles import AngleMap
from ..lenses.glass import ROOM
from ..toml_files import nearest
from .frames import Frame, Vector, along, cross, dot, frame, total
from .lengths import ApparentLengths, RulerLengths
from .numbers import TEMPERATURES, TIP, TYPES, numbers_of, possible
from .rims import Rim, place_of

if TYPE_CHECKING:
    from ..lenses.glass import Glass

IN_FOCUS = 1e-10
"""Share of d_f by which a stop is out of focus at least: it cuts whole microlens images then, or none of one."""
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

    @property
    def hashable(self) -> tuple[Any, ...]:
        """Key of the same properties."""
        return tuple(frozenset(part.items()) if isinstance(part, Mapping) else part for part in self)


class Camera(Symbols[Number]):
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
        self.materials, self.growth, self.colours, self.round_fields = self._kind[4:]

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
        given = {PATHS.get(place, place): value for place, value in changes.items()}
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
                hint = "add [environment] with a housing" if warm else nearest(place, [*PATHS, *numbers])
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
        camera, key = self._with(numbers), follower(given)
        if key is not None:  # no way through the bore hangs on d_f, which is no more than where the camera looks
            numbers[key] = self.chain.followed(numbers, key, camera._walk if key == PATHS["d_f"] else None)
        if in_focus:
            numbers[PATHS["f_ml"]] = camera.seen.d_2 / (1 + camera.seen.d_2 * camera.seen.vergence)
        return camera

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

    def __getitem__(self, place: str) -> Number:
        """The number at a dotted place [mm, rad; the relay's magnification without unit]."""
        return self._numbers[place]

    @property
    def numbers(self) -> Mapping[str, Number]:
        """Every place and its number."""
        return MappingProxyType(self._numbers)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Common shape of the builds; () for one camera."""
        return np.broadcast_shapes(*{value.shape for value in self._numbers.values() if isinstance(value, np.ndarray)})

    @cached_property
    def worked_out(self) -> dict[Any, Any]:
        """Cache of results that take long to compute, by what they are; numbers of a camera never change."""
        return {}

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

    def plane(self, z: Number) -> ImagedPlane:
        """The plane at z before the main lens [mm, with a ruler], as the main lens sees it."""
        return self._walk.plane(z)

    def plane_ahead(self, at: Number) -> ImagedPlane:
        """The plane `at` ahead of the bore's tip [mm]; of one distance, for which several quantities ask, kept."""
        if not isinstance(at, float):
            return self.plane(at + self.tip)
        if ("plane", at) not in self.worked_out:
            self.worked_out["plane", at] = self.plane(at + self.tip)
        plane: ImagedPlane = self.worked_out["plane", at]
        return plane

    @cached_property
    def _walk(self) -> BoreWalk:
        return self.chain.walk(self._numbers)

    @cached_property
    def in_bore(self) -> tuple[StandingElement, ...]:
        """Elements before the main lens where they stand, in the order of the design file."""
        return tuple(sorted(self._walk.parts, key=attrgetter("k")))

    def image_of(
        self, x: Number, y: Number, z: Number, pupil: tuple[Number, Number] = (0.0, 0.0)
    ) -> tuple[Number, Number, Number]:
        """Image by what stands before the main lens of a point of object space, against the system's axis [mm].

        Parameters
        ----------
        x, y, z : float or ndarray
            The point; z is its distance before the main lens.
        pupil : pair, optional
            Through which point of the FAP, from its centre and as the main lens sees it [mm]: through an objective with
            a mapping each sees the point elsewhere.
        """
        if self.chain.in_air:
            return x, y, z
        x, y = self.mapping.straight((x, y), lambda: self.straight_ray(x, y, z, pupil)[0])
        return self.first_order_image(x, y, z)

    def first_order_image(self, x: Number, y: Number, z: Number) -> tuple[Number, Number, Number]:
        """Image of a point of the first order's object space; parameters as for `image_of`."""
        plane = self.plane(z)
        x, y = (
            (at - off - aside) / plane.magnification + off
            for at, off, aside in zip((x, y), self.lens_centre, plane.axis_offset, strict=True)
        )
        return x, y, plane.distance

    def plane_seen_at(self, distance: Number) -> Number:
        """Plane in front of the farthest element that the main lens sees at a distance [both mm before it]."""
        return self._walk.plane_seen_at(distance)

    def plane_of_vergence(self, vergence: Number) -> Number:
        """Plane in front of the farthest element that is seen at 1/distance [1/mm]; 0 is infinity [mm]."""
        return self._walk.plane_of_vergence(vergence)

    @cached_property
    def front(self) -> tuple[Number, ImagedPlane]:
        """The farthest element's scene side: its distance before the main lens [mm], and the plane, all passed."""
        return self._walk.front

    @property
    def mapping(self) -> AngleMap:
        """Mapping of angles by what stands before the main lens."""
        return self.chain.mapping

    @cached_property
    def entrance_pupil_distance(self) -> Number:
        """Distance by a ruler of the entrance pupil, the FAP as the scene sees it [mm]."""
        return self.plane_seen_at(self.seen.d_3)

    def pupil_seen_before(self, distance: Number) -> Number:
        """Distance of the FAP's image for what lies at a distance, in the medium there [both mm before the lens]."""
        plane = self.plane(distance)
        return distance + plane.medium * ((self.seen.d_3 * plane.a - plane.b) / (plane.d - self.seen.d_3 * plane.c))

    def sagittal_stretch(self, p: Number) -> Number:
        """Slope of a ray before the farthest element over that of the first order: 1 but behind a mapped objective.

        Parameters
        ----------
        p : float or ndarray
            Index times slope there, to first order; beyond what is imaged, the end of that is taken.
        """
        grown: Number = self.mapping.stretch(p, self.front[1].medium)
        return grown

    def tangential_stretch(self, p: Number) -> Number:
        """Derivative of the slope by that of the first order: for small steps along the field's radius."""
        along: Number = self.mapping.stretch_along(p, self.front[1].medium)
        return along

    def straight_ray(
        self,
        x: Number,
        y: Number,
        z: Number,
        pupil: tuple[Number, Number] = (0.0, 0.0),
        plane: Number | None = None,
    ) -> tuple[tuple[Number, Number], Number]:
        """The ray that reaches a point through a point of the FAP, as the first order has it behind a mapping.

        Parameters
        ----------
        x, y, z, pupil
            As for `image_of`.
        plane : float or ndarray, optional
            Distance at which to tell where it is; that of the point if None [mm].

        Returns
        -------
        pair, float or ndarray
            Where it is there, from the system's axis [mm]; index times its slope, that of the edge where the objective
            does not image the point.
        """
        (end, front), at = self.front, self.entrance_pupil_distance
        apart, wide = at - end, 1 / (front.d - front.c * self.seen.d_3)
        middles = [
            off + wide * (point + aside) + shift - apart / front.medium * lean
            for off, point, aside, shift, lean in zip(
                self.lens_centre, pupil, self.decentre("aperture"), front.axis_offset, front.axis_slope, strict=True
            )
        ]
        slopes = [(middle - place) / (z - at) for middle, place in zip(middles, (x, y), strict=True)]
        steepness = np.hypot(slopes[0], slopes[1])
        p = self.mapping.first_order(steepness, front.medium)
        shrunk = np.where(steepness > 0, p / front.medium / np.where(steepness > 0, steepness, 1.0), 1.0)
        reach = (z if plane is None else plane) - at
        u, v = (middle - shrunk * slope * reach for middle, slope in zip(middles, slopes, strict=True))
        return (u, v), p

    @cached_property
    def focus(self) -> ImagedPlane:
        """The focal plane."""
        return self.plane(self._numbers[PATHS["d_f"]])

    @cached_property
    def apparent(self) -> dict[str, Any]:
        """Apparent lengths as far as they were asked for."""
        return {}

    @property
    def seen(self) -> ApparentLengths:
        """Lengths as the main lens sees them, through what stands before it and about the array; H, m and A."""
        return ApparentLengths(self)

    @property
    def ruler(self) -> RulerLengths:
        """Lengths by a ruler."""
        return RulerLengths(self._numbers)

    @cached_property
    def fap(self) -> Rim:
        """The flexible angular plane, the system's entrance pupil."""
        return self._rim("FAP", "aperture")

    @cached_property
    def rims(self) -> tuple[Rim, ...]:
        """Every opening but the FAP: main lens, further stops and elements, in the order of the design file."""
        lens = Rim("main lens", "main_lens", ClearAperture(self.D / 2), 0.0, 0.0)
        stops = (self._rim(f"stop {k + 1}", f"stops.{k}") for k in range(self.stop_count))
        return (lens, *stops, *self._mapped_image, *(rim for part in self.in_bore for rim in self._faces(part)))

    @property
    def openings(self) -> tuple[Rim, ...]:
        """Every opening: the FAP, then `rims`."""
        return (self.fap, *self.rims)

    @property
    def openings_ahead(self) -> tuple[Rim, ...]:
        """Every opening before the main lens, the FAP first."""
        return (self.fap, *self.rims[1:])

    @property
    def stop_openings(self) -> tuple[Rim, ...]:
        """The FAP and the further stops."""
        return (self.fap, *self.rims[1 : 1 + self.stop_count])

    @cached_property
    def _mapped_image(self) -> tuple[Rim, ...]:
        """Rim of what an objective with a mapping images: a stop in its image of what is far.

        Empty without a mapping.
        """
        return tuple(self._end_of_mapping(part, plane) for part, plane in self._walk.mapped_images())

    def _end_of_mapping(self, part: StandingElement, plane: ImagedPlane) -> Rim:
        scale = magnitude(plane.magnification)
        outline = ClearAperture(magnitude(part.at["focal_length"]) * self.mapping.end / scale)
        name = f"lens {part.k + 1}, mapping"
        return Rim(name, part.at.place + IMAGE, outline, plane.distance, part.start, scale, plane)

    def _faces(self, part: StandingElement) -> Iterator[Rim]:
        """Openings of an element's clear aperture."""
        if f"{part.at.place}.diameter" not in self._numbers:
            return
        for number, (words, z) in enumerate(part.element.openings(part.at)):
            rim = self._rim(f"{part.name}{words}", f"{part.at.place}.{number}", z, ClearAperture(part.diameter / 2))
            yield replace(rim, leans=True) if part.element.leans else rim

    @cached_property
    def in_light_order(self) -> tuple[Rim, ...]:
        """Every opening in the order in which light meets it, that of the first build.

        The farthest first, the FAP before what stands with it, the main lens last.
        """
        # Of two that touch, the back face of the farther element comes before the front face of the nearer.
        return tuple(
            sorted(self.openings, key=lambda rim: (-float(np.ravel(rim.ruler_distance)[0]), rim.part.endswith(".1")))
        )

    @cached_property
    def stop_count(self) -> int:
        """Number of stops beside the FAP and the main lens."""
        number = 0
        while f"stops.{number}.distance" in self._numbers:
            number += 1
        return number

    def _rim(self, name: str, part: str, stands: Number | None = None, outline: ClearAperture | None = None) -> Rim:
        stands = self._numbers[f"{part}.distance"] if stands is None else stands
        outline = ClearAperture.of(self._numbers, part) if outline is None else outline
        if self.chain.in_air:
            return Rim(name, part, outline, stands, stands)
        plane = self.plane(stands)
        scale, distance = magnitude(plane.magnification), plane.distance
        if part != "aperture":  # of a stop in an image of the focal plane no disc is left, but its limit
            near = np.abs(distance - self.seen.d_f) < IN_FOCUS * np.abs(self.seen.d_f)
            distance = np.where(near, self.seen.d_f * (1 - IN_FOCUS), distance)[()] if np.any(near) else distance
        return Rim(name, part, outline.over(scale), distance, stands, scale, plane)

    def towards_scene(self, rim: Rim) -> PartNumbers:
        """Numbers of a stop as rays on the scene's side meet it: those of its image where it stands behind the lens."""
        part, numbers = rim.part, dict(self._numbers)
        if np.any(rim.behind):
            image = {"distance": rim.distance} | dict(zip(rim.outline.keys, rim.outline.lengths, strict=True))
            for axis, (aside, tilt) in enumerate(zip(self.decentre(part), self.tilt(part), strict=True)):
                image |= {f"decentre.{axis}": aside + self.lens_centre[axis], f"tilt.{axis}": tilt}
            for key, value in image.items():
                numbers[f"{part}.{key}"] = np.where(rim.behind, value, numbers[f"{part}.{key}"])[()]
        return PartNumbers(numbers, part)

    @cached_property
    def _rim_of(self) -> dict[str, Rim]:
        return {rim.part: rim for rim in self.openings}

    @property
    def lens_centre(self) -> tuple[Number, Number]:
        """The main lens's centre from the system's axis [mm]."""
        return self._numbers["main_lens.decentre.0"], self._numbers["main_lens.decentre.1"]

    def decentre(self, part: str) -> tuple[Number, Number]:
        """Offset of a part (its place in the design) from the main lens's centre, as that sees it."""
        if ("decentre", part) not in self.worked_out:
            self.worked_out["decentre", part] = self._own_decentre(part)
        x, y = self.worked_out["decentre", part]
        return x, y

    def _own_decentre(self, part: str) -> tuple[Number, Number]:
        place = place_of(part)
        x, y = (self._numbers[f"{place}.decentre.{axis}"] - self.lens_centre[axis] for axis in (0, 1))
        rim = self._rim_of.get(part)
        if rim is None or rim.plane is None:
            return x, y
        plane = rim.plane
        return (x - plane.axis_offset[0]) / plane.magnification, (y - plane.axis_offset[1]) / plane.magnification

    def tilt(self, part: str) -> tuple[Number, Number]:
        """Tilt of a part [rad]; of a stop as the main lens sees it."""
        if part.endswith(IMAGE):
            return 0.0, 0.0
        tilt, rim = self._own_tilt(part), self._rim_of.get(part)
        if rim is None or rim.plane is None or not any(np.any(angle) for angle in tilt):
            return tilt
        bend = rim.plane.medium * rim.plane.magnification
        x, y = (np.arctan(np.tan(angle) / bend) for angle in tilt)
        return x, y

    def _own_tilt(self, part: str) -> tuple[Number, Number]:
        """Tilt of a part with a ruler [rad]; of an element's opening that of the opening."""
        place = place_of(part)
        if place.startswith("elements."):
            standing = self.in_bore[int(place.removeprefix("elements."))]
            return standing.element.lean(standing.at)
        return self._numbers[f"{place}.tilt.0"], self._numbers[f"{place}.tilt.1"]

    @cached_property
    def tilted(self) -> bool:
        """Whether any part is tilted in any build, or leans and may cut: stops' images are then not exactly discs."""
        return self.largest_tilt != 0 or bool(self.leaning)

    @cached_property
    def straight(self) -> bool:
        """True where nothing but further stops is tilted in any build; mirrors may lean."""
        return not any(
            np.any(tilt)
            for place, tilt in self._numbers.items()
            if ".tilt." in place and not place.startswith("stops.")
        )

    @cached_property
    def leaning(self) -> tuple[int, ...]:
        """Which of `rims` lean by design and may cut."""
        if not self.chain.leans:
            return ()
        return tuple(k for k, rim in enumerate(self.rims) if rim.leans and np.any(np.isfinite(rim.radius)))

    @cached_property
    def largest_tilt(self) -> float:
        """Largest tilt of any part in any build [rad]; nan where one is."""
        tilts = [value for place, value in self._numbers.items() if ".tilt." in place]
        return float(np.max([np.max(np.abs(tilt), initial=0.0) for tilt in tilts]))

    def apparent_pose(self, part: str) -> Frame:
        """Vertex and axes of a part of the design, in the main lens's frame (its vertex, its axes)."""
        if ("pose", part) not in self.worked_out:
            self.worked_out["pose", part] = self._own_pose(part)
        pose: Frame = self.worked_out["pose", part]
        return pose

    def ruler_pose(self, part: str) -> Frame:
        """Vertex and axes of a part of the design in the system's axes, as a ruler finds them."""
        place = place_of(part)
        d_1, d_2 = (self._numbers[PATHS[symbol]] for symbol in ("d_1", "d_2"))
        z = {"main_lens": 0.0, "microlens_array": d_1, "sensor": plus(d_1, d_2)}
        decentre, tilt = (
            (self._numbers[f"{place}.decentre.0"], self._numbers[f"{place}.decentre.1"]),
            self._own_tilt(part),
        )
        at = z[part] if part in z else minus(0.0, self._rim_of[part].ruler_distance)
        turn = self._numbers["microlens_array.rotation"] if part == "microlens_array" else 0.0
        return frame(decentre, at, tilt, turn)

    @cached_property
    def world(self) -> Frame:
        """The system's own axes, in which object points are given, in the main lens's frame."""
        return frame((0.0, 0.0), 0.0, (0.0, 0.0)).seen_from(self._lens)

    @cached_property
    def _lens(self) -> Frame:
        return self._placed("main_lens", 0.0)

    def _own_pose(self, part: str) -> Frame:
        if part == "main_lens":
            return frame((0.0, 0.0), 0.0, (0.0, 0.0))
        turn: Number = 0.0
        if part == "microlens_array":
            z, turn = self.seen.d_1, self._numbers["microlens_array.rotation"]
        else:
            z = self.seen.d_1 + self.seen.d_2 if part == "sensor" else -self._rim_of[part].distance  # as seen
        return self._placed(part, z, turn).seen_from(self._lens)

    def _placed(self, part: str, z: Number, roll: Number = 0.0) -> Frame:
        if self.chain.in_air:
            decentre = self._numbers[f"{part}.decentre.0"], self._numbers[f"{part}.decentre.1"]
        else:
            x, y = self.decentre(part)
            decentre = plus(x, self.lens_centre[0]), plus(y, self.lens_centre[1])
        return frame(decentre, z, self.tilt(part), roll)

    def microlens(self, x: Number, y: Number) -> Vector:
        """Point of the array (x, y) [mm, in its own frame] in the main lens's frame."""
        array = self.apparent_pose("microlens_array")
        return along(array.origin, x, array.x, y, array.y)

    @cached_property
    def _chief_rays(self) -> tuple[Vector, Vector, Vector]:
        """Numerators and denominator of `chief_point`, coefficients of 1, x and y: no field in them.

        The lens images the FAP's centre a to ``a/(1 + a_z/f)``; from there through the microlens to the sensor's plane.
        """
        array, sensor, fap = (self.apparent_pose(part) for part in ("microlens_array", "sensor", "aperture"))
        weight = plus(1.0, fap.origin[2] / self.f)

        def against(axis: Vector) -> tuple[Number, Vector]:
            """Coordinate along an axis of the sensor: of the FAP's image, and of the microlens (1, x, y)."""
            offset = dot(axis, sensor.origin)
            image = minus(dot(axis, fap.origin), times(weight, offset))
            return image, (minus(dot(axis, array.origin), offset), dot(axis, array.x), dot(axis, array.y))

        (u, us), (v, vs), (n, ns) = (against(axis) for axis in (sensor.x, sensor.y, sensor.z))
        x, y = (
            tuple(cross(own, image, n, part) for own, part in zip(ns, parts, strict=True))
            for image, parts in ((u, us), (v, vs))
        )
        return x, y, (minus(times(ns[0], weight), n), times(ns[1], weight), times(ns[2], weight))  # type: ignore[return-value]

    def chief_point(self, x: Number, y: Number) -> tuple[Number, Number]:
        """Point of the sensor where the ray through the FAP's centre and the array's (x, y) ends [mm, own frames]."""
        u, v, w = (total(c0, cx, x, cy, y) for c0, cx, cy in self._chief_rays)
        return np.divide(u, w), np.divide(v, w)

    @property
    def array_size(self) -> tuple[Number, Number]:
        """Width and height of the microlens array [mm]."""
        return self._numbers["microlens_array.size.0"], self._numbers["microlens_array.size.1"]

    @property
    def hiatus(self) -> Number:
        """Distance between the main lens's principal planes, which lengths along the outside have besides [mm]."""
        return self._numbers.get(HIATUS, self.lens.gap)

    @cached_property
    def tip(self) -> Array:
        """Distance of the bore's outer end from the main lens: the farthest of FAP, stops, elements and `TIP` [mm]."""
        farthest = self._numbers[TIP]
        for rim in self.openings_ahead:
            farthest = np.maximum(farthest, rim.ruler_distance)
        return np.asarray(np.maximum(farthest, self.chain.end(self._numbers)))

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
        stops = {rim.name: rim.ruler_distance for rim in self.stop_openings}
        yield from self._walk.apart(stops)


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
    beside = design.chain, design.materials, Growth.of(design), design.sensor.colours, rounds
    return Camera(numbers_of(design), _Kind(array.layout, array.lens_shape, lens, *beside))
