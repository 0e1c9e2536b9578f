"""Bore and scene as the main lens sees them: planes, lengths, openings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from operator import attrgetter
from types import MappingProxyType
from typing import Any

import numpy as np

from .._arrays import Array, magnitude
from ..bore.chain import BoreWalk, Chain, ImagedPlane, StandingElement
from ..bore.lens import IMAGE
from ..bore.opening import ClearAperture
from ..bore.part import Number
from ..design.parts import PATHS, Symbols
from ..lenses.angles import AngleMap
from .lengths import ApparentLengths, RulerLengths
from .numbers import TIP
from .rims import Rim, place_of

IN_FOCUS = 1e-10
"""Share of d_f by which a stop is out of focus at least: it cuts whole microlens images then, or none of one."""


class SeenBore(Symbols[Number]):
    """Bore of a camera, and the scene before it, as its main lens sees them."""

    _numbers: Mapping[str, Number]
    chain: Chain

    def __getitem__(self, place: str) -> Number:
        """The number at a dotted place [mm, rad; the relay's magnification without unit]."""
        return self._numbers[place]

    @property
    def numbers(self) -> Mapping[str, Number]:
        """Every place and its number."""
        return MappingProxyType(self._numbers)

    @cached_property
    def worked_out(self) -> dict[Any, Any]:
        """Cache of results that take long to compute, by what they are; numbers of a camera never change."""
        return {}

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
        names = self.chain.stops
        stops = (self._rim(names[k], f"stops.{k}") for k in range(len(names)))
        return (lens, *stops, *self._mapped_image, *(rim for part in self.in_bore for rim in self._faces(part)))

    @property
    def openings(self) -> tuple[Rim, ...]:
        """Every opening: the FAP, then `rims`."""
        return (self.fap, *self.rims)

    @property
    def has_straight_sides(self) -> bool:
        """Whether straight sides bound any opening."""
        return any(rim.outline.straight for rim in self.openings)

    @property
    def openings_ahead(self) -> tuple[Rim, ...]:
        """Every opening before the main lens, the FAP first."""
        return (self.fap, *self.rims[1:])

    @property
    def stop_openings(self) -> tuple[Rim, ...]:
        """The FAP and the further stops."""
        return (self.fap, *self.rims[1 : 1 + len(self.chain.stops)])

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

    @cached_property
    def _rim_of(self) -> dict[str, Rim]:
        return {rim.part: rim for rim in self.openings}

    @cached_property
    def tip(self) -> Array:
        """Distance of the bore's outer end from the main lens: the farthest of FAP, stops, elements and `TIP` [mm]."""
        farthest = self._numbers[TIP]
        for rim in self.openings_ahead:
            farthest = np.maximum(farthest, rim.ruler_distance)
        return np.asarray(np.maximum(farthest, self.chain.end(self._numbers)))

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
