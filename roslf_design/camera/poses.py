"""Poses of a camera's parts, by a ruler and as the main lens sees them."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..bore.lens import IMAGE
from ..bore.part import Number, PartNumbers, minus, plus, times
from ..design.parts import PATHS
from .frames import Frame, Vector, along, cross, dot, frame, total
from .rims import Rim, place_of
from .seen_bore import SeenBore


class PosedParts(SeenBore):
    """Parts of a camera with their poses."""

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
