"""Rays followed plane by plane at 60 digits, knowing nothing of the engine's formulas.

A camera is a row of planes in space. A ray runs straight to the next plane; an ideal lens sends it through the point of
its focal plane where the parallel ray through the lens's centre meets it; an opening is a disc in its own plane. Light
is followed backward, from the sensor on, and forward, from the object on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mpmath as mp

from roslf_design.design import Design
from roslf_design.fates import FATES, RayFate, state_at
from roslf_design.theory.object_space import FAP, MAIN_LENS

DIGITS = 60
MICROLENS = -1
"""Place of the microlens's own aperture, which no state counts."""
Vector = tuple[Any, Any, Any]


def add(a: Vector, b: Vector, t: Any = 1) -> Vector:
    return tuple(x + t * y for x, y in zip(a, b, strict=True))


def dot(a: Vector, b: Vector) -> Any:
    return mp.fsum(x * y for x, y in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def turned(vector: Vector, axis: Vector, angle: Any) -> Vector:
    """Rodrigues' rotation about a unit axis."""
    along = add((0, 0, 0), axis, dot(axis, vector) * (1 - mp.cos(angle)))
    return add(add(along, vector, mp.cos(angle)), cross(axis, vector), mp.sin(angle))


class Plane(NamedTuple):
    """An element's plane: its vertex and axes in space."""

    vertex: Vector
    x: Vector
    y: Vector
    normal: Vector

    @classmethod
    def of(cls, part: Any, z: Any, roll: float = 0.0) -> Plane:
        tx, ty, tz = (mp.mpf(float(angle)) for angle in (*part.tilt, roll))
        axes = []
        for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
            axis = turned(tuple(map(mp.mpf, axis)), (0, 0, 1), tz)
            axes.append(turned(turned(axis, (1, 0, 0), tx), (0, 1, 0), ty))
        return cls((mp.mpf(float(part.decentre[0])), mp.mpf(float(part.decentre[1])), z), *axes)

    def place(self, x: Any, y: Any) -> Vector:
        return add(add(self.vertex, self.x, mp.mpf(float(x))), self.y, mp.mpf(float(y)))

    def meet(self, point: Vector, direction: Vector) -> Vector:
        ahead = dot(self.normal, add(self.vertex, point, -1)) / dot(self.normal, direction)
        return add(point, direction, ahead)

    def local(self, point: Vector) -> tuple[Any, Any]:
        offset = add(point, self.vertex, -1)
        return dot(offset, self.x), dot(offset, self.y)


def bent(lens: Plane, centre: Vector, focal_length: Any, point: Vector, direction: Vector) -> Vector:
    """Direction behind an ideal lens, for a ray that runs along `direction` and meets the lens at `point`."""
    sign = mp.sign(dot(direction, lens.normal))
    forward = add((0, 0, 0), direction, 1 / (sign * dot(direction, lens.normal)))
    through_centre = add(centre, forward, focal_length)
    onward = add(through_centre, point, -1)
    return onward if focal_length > 0 else add((0, 0, 0), onward, -1)


class Traced(NamedTuple):
    """A ray in object space and how far from each opening's centre it passed."""

    point: Vector
    """On the main lens."""
    direction: Vector
    """Of the light there."""
    misses: dict[int, tuple[Any, Any]]
    """State of a ray that an element takes: (distance from its centre, its radius)."""
    order: list[int]
    """Codes as light meets the elements."""
    crossings: list[tuple[Any, Any]]
    """Where it crossed the stops, in their own frames."""

    def at(self, distance: Any) -> tuple[Any, Any]:
        """x, y on the plane z = -distance; for inf, tangents of the direction under which that object is seen."""
        dx, dy, dz = self.direction
        if mp.isinf(distance):
            return -dx / dz, -dy / dz
        along = (-distance - self.point[2]) / dz
        return self.point[0] + along * dx, self.point[1] + along * dy

    @property
    def status(self) -> int:
        taken = [code for code in self.order if self.misses[code][0] > self.misses[code][1]]
        return taken[0] if taken else RayFate.KEPT

    @property
    def clearance(self) -> Any:
        """Smallest distance from a rim."""
        return min(abs(miss - radius) for miss, radius in self.misses.values())


def planes(design: Design) -> tuple[Plane, Plane, Plane, list[Plane]]:
    """Sensor, array, main lens and stops."""
    array, sensor = design.microlens_array, design.sensor
    d_1, d_2 = mp.mpf(design.d_1), mp.mpf(float(sensor.distance))
    stops = [Plane.of(stop, -mp.mpf(float(stop.distance))) for stop in design.all_stops]
    return (
        Plane.of(sensor, d_1 + d_2),
        Plane.of(array, d_1, float(array.rotation)),
        Plane.of(design.main_lens, mp.mpf(0)),
        stops,
    )


def backward(design: Design, sensor: Any, microlens: Any, offset: Any = (0.0, 0.0)) -> Traced:
    """Follow one ray from the sensor back into object space."""
    with mp.workdps(DIGITS):
        detector, array, lens, stops = planes(design)
        axis = array.place(*microlens)
        start = detector.place(*sensor)
        where = add(add(axis, array.x, mp.mpf(float(offset[0]))), array.y, mp.mpf(float(offset[1])))
        behind = add(where, start, -1)
        between = bent(array, axis, mp.mpf(design.f_ml), where, behind)
        on_lens = lens.meet(where, between)
        back = bent(lens, lens.vertex, mp.mpf(design.f), on_lens, between)
        misses = {}
        crossings = [stop.local(stop.meet(on_lens, back)) for stop in stops]
        for k, crossing in enumerate(crossings):
            misses[state_at(FAP + k)] = (mp.hypot(*crossing), mp.mpf(design.all_stops[k].diameter) / 2)
        order = sorted(misses, key=lambda code: (-design.all_stops[code // FATES - FAP].distance, code))
        misses[state_at(MAIN_LENS)] = (mp.hypot(*lens.local(on_lens)), mp.mpf(design.D) / 2)
        v = [abs(mp.mpf(float(x))) for x in offset]
        reach = mp.hypot(*v) if design.microlens_array.lens_shape == "circular" else max(v)
        misses[MICROLENS] = (reach, mp.mpf(design.d) / 2)
        order += [state_at(MAIN_LENS), MICROLENS]
        return Traced(on_lens, add((0, 0, 0), back, -1), misses, order, crossings)


def forward(
    design: Design, point: Vector, direction: Vector, microlens: Any
) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """Follow one ray from object space on; where it meets the array and the sensor, in their frames."""
    with mp.workdps(DIGITS):
        detector, array, lens, _ = planes(design)
        on_lens = lens.meet(point, direction)
        between = bent(lens, lens.vertex, mp.mpf(design.f), on_lens, direction)
        where = array.meet(on_lens, between)
        axis = array.place(*microlens)
        behind = bent(array, axis, mp.mpf(design.f_ml), where, between)
        return array.local(where), detector.local(detector.meet(where, behind))
