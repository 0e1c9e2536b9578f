"""A light-field camera behind a real lens: where everything stands, and the backward ray from sensor to scene.

The lens keeps its frame (first vertex at z = 0); its decentre is taken up by what is around it. The paper's distances
count from the principal planes, where the thin lens splits: d_f, d_3 and further stops from the object-side one, d_1
from the image-side one, so that to first order the camera is the thin-lens camera of the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Design, Stop
from ..design.parts import MicrolensArray, Sensor
from ..errors import Problem
from ..lenses.manufacture import turned
from ..lenses.prescription import FirstOrder, LensError, Prescription, first_order, rotation
from ..lenses.tracer import KEPT, STOPPED

Array = NDArray[np.float64]

NEWTON_STEPS = 25


@dataclass(frozen=True)
class TracedPlane:
    """A plane of the camera, or a circular stop on it; its points count as if it stood upright."""

    z: float
    """Place along z of what it is turned about [mm]."""
    x: float = 0.0
    y: float = 0.0
    """What it is turned about; a stop's decentre [mm]."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """About x, then about y [rad]."""
    diameter: float = math.inf
    """Of a stop [mm]."""

    @property
    def centre(self) -> Array:
        """(2,) [mm]."""
        return np.array([self.x, self.y])

    @property
    def axes(self) -> Array:
        """Its own x, y and normal in the lens's frame, one a row, (3, 3)."""
        return rotation(*self.tilt).T

    def lifted(self, point: ArrayLike) -> Array:
        """Points (..., 2) of the plane in space, (3, ...) [mm]."""
        p = np.asarray(point, float)
        if self.tilt == (0.0, 0.0):
            return np.stack([p[..., 0], p[..., 1], np.full(p.shape[:-1], self.z)])
        off, axes = p - self.centre, self.axes
        there = np.array([self.x, self.y, self.z]) + off[..., :1] * axes[0] + off[..., 1:] * axes[1]
        return np.moveaxis(there, -1, 0)

    def crossed(self, place: Array, slope: Array, z: float) -> Array:
        """Points (2, ...) of the plane where rays cross it [mm], from where they cross the upright one at `z`."""
        ahead = self.z - z
        if self.tilt == (0.0, 0.0):
            return place + slope * ahead if ahead else place
        across, along, normal = self.axes
        x, y = place[0] - self.x, place[1] - self.y
        lean = normal[0] * slope[0] + normal[1] * slope[1] + normal[2]
        step = -(normal[0] * x + normal[1] * y - normal[2] * ahead) / lean
        hit = np.stack([x + step * slope[0], y + step * slope[1], step - ahead])
        return np.stack([np.tensordot(across, hit, axes=1) + self.x, np.tensordot(along, hit, axes=1) + self.y])


@dataclass(frozen=True)
class LensCamera:
    """A real lens and what stands before and behind it.

    Attributes
    ----------
    lens : Prescription
        The main lens.
    wavelength : float
        Of first-order data and of everything not said otherwise [mm].
    rims : tuple of TracedPlane
        The FAP first, then further stops.
    focal_plane : float
        Place along z of the plane in focus [mm].
    array, detector : TracedPlane
        The microlens array and the sensor.

    Raises
    ------
    LensError
        Parts that collide: a stop or the array inside the lens.
    """

    lens: Prescription
    wavelength: float
    rims: tuple[TracedPlane, ...]
    focal_plane: float
    array: TracedPlane
    detector: TracedPlane

    def __post_init__(self) -> None:
        problems = []
        last = self.lens.surfaces[-1]
        rear = self.lens.length + max(0.0, float(last.sag(last.semi_diameter)))
        if any(self.focal_plane >= rim.z for rim in self.rims):
            problems.append(Problem("focal_plane", "must lie in front of the flexible angular plane and every stop"))
        for rim in self.rims:
            if not rim.diameter > 0:
                problems.append(Problem("aperture.diameter", f"{rim.diameter:g} mm must be greater than zero"))
            if rim.z > self.front:
                message = f"lies {rim.z - self.front:.4g} mm inside the lens; move it out, or count it from the vertex"
                problems.append(Problem("aperture.distance", message))
        if not self.array.z > rear:
            message = f"lies {rear - self.array.z:.4g} mm inside the lens; focus nearer or take a thinner lens"
            problems.append(Problem("microlens_array.distance", message))
        if not self.detector.z > self.array.z:
            problems.append(Problem("sensor.distance", "the sensor must lie behind the microlens array"))
        if problems:
            raise LensError(tuple(problems), self.lens.name)

    @property
    def front(self) -> float:
        """Foremost point of the lens on the axis or at its front rim [mm]."""
        first = self.lens.surfaces[0]
        return min(0.0, float(first.sag(first.semi_diameter)))

    @property
    def fap(self) -> TracedPlane:
        """The flexible angular plane: the entrance pupil."""
        return self.rims[0]

    @property
    def first_order(self) -> FirstOrder:
        """Gaussian constants at the camera's wavelength."""
        return first_order(self.lens, self.wavelength)

    @property
    def d_1(self) -> float:
        """Image-side principal plane to microlens array [mm]."""
        return self.array.z - self.first_order.rear_principal

    @property
    def d_2(self) -> float:
        """Microlens array to sensor [mm]."""
        return self.detector.z - self.array.z

    @property
    def d_f(self) -> float:
        """Focal plane to object-side principal plane [mm]."""
        return self.first_order.front_principal - self.focal_plane

    @property
    def d_3(self) -> float:
        """FAP to object-side principal plane [mm]."""
        return self.first_order.front_principal - self.fap.z


@lru_cache(maxsize=64)
def camera_of(design: Design) -> LensCamera:
    """The traced camera of a design with a real main lens.

    A tilt of the main lens turns it about the middle of its principal planes, one of any other part about its centre.

    Raises
    ------
    LensError
        Parts that collide: a stop or the array inside the lens.
    ValueError
        The design's main lens is ideal.
    """
    lens = design.lens
    if lens is None:
        raise ValueError(f"{design.name} has an ideal main lens; there is nothing to trace")
    constants = first_order(lens, design.wavelength)
    front, rear = constants.front_principal, constants.rear_principal
    if design.main_lens.tilt != (0.0, 0.0):
        lens = turned(lens, *design.main_lens.tilt, pivot=(front + rear) / 2)

    def stands(part: Stop | MicrolensArray | Sensor, z: float, diameter: float = math.inf) -> TracedPlane:
        x, y = np.subtract(part.decentre, design.main_lens.decentre)
        return TracedPlane(z, float(x), float(y), part.tilt, diameter)

    mla = rear + design.d_1
    rims = tuple(stands(stop, front - stop.distance, stop.diameter) for stop in design.all_stops)
    array, detector = stands(design.microlens_array, mla), stands(design.sensor, mla + design.d_2)
    return LensCamera(lens, design.wavelength, rims, front - design.d_f, array, detector)


def tilted_parts(design: Design) -> tuple[str, ...]:
    """Parts around the main lens that are tilted."""
    tilts = {"FAP": design.aperture.tilt, "microlens array": design.microlens_array.tilt, "sensor": design.sensor.tilt}
    tilts |= {f"stop {number}": stop.tilt for number, stop in enumerate(design.stops, start=1)}
    return tuple(name for name, tilt in tilts.items() if tilt != (0.0, 0.0))


def microlenses(design: Design, axes: Sequence[tuple[float, float]] | ArrayLike) -> Array:
    """Microlens axes (..., 2), given in the array's own frame, in the lens's [mm]; as if the array stood upright."""
    cosine, sine = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    there = np.asarray(axes, float) @ np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(there + np.subtract(design.microlens_array.decentre, design.main_lens.decentre))


class Views(NamedTuple):
    """Backward rays, told where they cross the plane of the FAP; leading axes of the input."""

    pupil: Array
    """Point on the FAP's own plane, counted as if it stood upright [mm], (..., 2)."""
    place: Array
    """Point on the upright plane through the FAP's centre [mm], (..., 2); `pupil` where the FAP is not tilted."""
    slope: Array
    """dx/dz and dy/dz in object space, (..., 2)."""
    state: NDArray[np.int16]
    """What became of the ray (`tracer.describe`), (...)."""
    fap_room: Array
    """1 - r^2/(D_F/2)^2 about the FAP's centre, (...): positive inside."""
    room: Array
    """Least of the same over the lens's surfaces and the further stops, (...); -1 or less where one was not met."""

    def at(self, distance: ArrayLike) -> Array:
        """Where the rays cross a plane `distance` in front of the FAP [mm], (..., 2)."""
        return np.asarray(self.place - self.slope * np.asarray(distance, float)[..., None])


def views(
    camera: LensCamera, microlens: ArrayLike, sensor: ArrayLike, wavelength: float | None = None, *, clip: bool = True
) -> Views:
    """Trace sensor points through pinhole microlenses and the lens to the FAP and beyond.

    Parameters
    ----------
    camera : LensCamera
        The camera.
    microlens : array_like
        Microlens axes c on the array [mm], (..., 2), in the lens's frame; where the array is tilted, as if it stood
        upright.
    sensor : array_like
        Points p on the sensor [mm], (..., 2), broadcast against `microlens`; likewise.
    wavelength : float, optional
        [mm]; the camera's own by default.
    clip : bool
        Whether clear diameters, the FAP and the stops stop rays; otherwise only `room` and `fap_room` tell.
    """
    c, p = np.broadcast_arrays(np.asarray(microlens, float), np.asarray(sensor, float))
    run = (end := camera.array.lifted(c)) - camera.detector.lifted(p)
    colour = camera.wavelength if wavelength is None else wavelength
    rays = camera.lens.through(end[:2], run[:2] / run[2], colour, start=end[2], end=camera.fap.z, clip=clip)
    place, slope, room, state = rays.height, rays.slope, rays.room, rays.state
    lost = state != KEPT
    pupil, fap_room = place, room
    for number, rim in sorted(enumerate(camera.rims), key=lambda item: -item[1].z):  # nearest to the lens first
        crossing = rim.crossed(place, slope, camera.fap.z)
        at = crossing - rim.centre.reshape(2, *(1,) * lost.ndim)
        left = np.where(lost, -1.0, 1 - np.sum(np.square(at), axis=0) / (rim.diameter / 2) ** 2)
        if number == 0:
            pupil, fap_room = crossing, left
        else:
            room = np.minimum(room, left)
        if clip:
            state[(state == KEPT) & (left < 0)] = 8 * (number + 1) + STOPPED
    pupil, place, slope = (np.moveaxis(part, 0, -1) for part in (pupil, place, slope))
    return Views(pupil, place, slope, state, fap_room, room)


def chief_slope(camera: LensCamera, microlens: ArrayLike, pupil: ArrayLike) -> Array:
    """First-order image-side slope of the ray from a point on the FAP's plane to a microlens, both (..., 2) [mm]."""
    (a, b), (c, d) = camera.first_order.matrix
    slope, height = d - c * camera.fap.z, b - a * camera.fap.z
    reach = slope * (camera.array.z - camera.lens.length) + height
    if reach == 0 or not math.isfinite(reach):
        message = "the flexible angular plane is imaged onto the microlens array; move one of them"
        raise LensError((Problem("aperture.distance", message),))
    return np.asarray((slope * np.asarray(microlens, float) - np.asarray(pupil, float)) / reach)


class SensorPoints(NamedTuple):
    """Sensor points that see given points of the FAP's plane."""

    sensor: Array
    """[mm], (..., 2)."""
    views: Views
    """Their backward rays, apertures not counted."""
    ok: NDArray[np.bool_]
    """Whether the point was found, (...); elsewhere the nearest approach."""


def sensor_of_pupil(
    camera: LensCamera, microlens: ArrayLike, pupil: ArrayLike, *, start: ArrayLike | None = None
) -> SensorPoints:
    """Sensor points behind microlenses that see given points of the FAP's plane; inverse of `views`.

    Parameters
    ----------
    camera : LensCamera
        The camera.
    microlens, pupil : array_like
        Microlens axes c and points a on the FAP's plane [mm], (..., 2), broadcast.
    start : array_like, optional
        First guess; first order by default.

    Returns
    -------
    SensorPoints
        To 1e-12 of the FAP's diameter by Newton's method, apertures left aside (`views.room` tells of them).
    """
    c, a = np.broadcast_arrays(np.asarray(microlens, float), np.asarray(pupil, float))
    p = c + camera.d_2 * chief_slope(camera, c, a) if start is None else np.array(np.broadcast_to(start, c.shape))
    origin = c + camera.d_2 * chief_slope(camera, c, np.zeros(2))
    nudge = 1e-3 * camera.d_2 * float(np.abs(chief_slope(camera, np.zeros(2), [camera.fap.diameter / 2, 0.0])[0]))
    tolerance = 1e-12 * camera.fap.diameter
    steps = np.array([[0.0, 0.0], [nudge, 0.0], [0.0, nudge]])
    best, miss = p.copy(), np.full(c.shape[:-1], np.inf)
    for _ in range(NEWTON_STEPS):
        at = views(camera, c[..., None, :], p[..., None, :] + steps, clip=False)
        met = np.all(at.state == KEPT, axis=-1)
        error = at.pupil[..., 0, :] - a
        size = np.where(met, np.hypot(error[..., 0], error[..., 1]), np.inf)
        better = size < miss
        best, miss = np.where(better[..., None], p, best), np.where(better, size, miss)
        if np.all(miss <= tolerance):
            break
        (xx, xy), (yx, yy) = np.moveaxis((at.pupil[..., 1:, :] - at.pupil[..., :1, :]) / nudge, (-1, -2), (0, 1))
        x, y = error[..., 0], error[..., 1]
        stretch = xx * yy - xy * yx
        step = np.stack([yy * x - xy * y, xx * y - yx * x], axis=-1)
        full = step * np.divide(1.0, stretch, where=stretch != 0, out=np.zeros_like(stretch))[..., None]
        # Where a ray misses the lens, or things get worse, come back half way to the best so far, at first to the axis.
        back = np.where(np.isfinite(miss)[..., None], best, origin)
        p = np.where((met & better)[..., None], p - full, (p + back) / 2)
    return SensorPoints(best, views(camera, c, best, clip=False), np.asarray(miss <= 1e3 * tolerance))
