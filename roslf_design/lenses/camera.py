"""A light-field camera behind a real lens: where everything stands, and the backward ray from sensor to scene.

The lens keeps its frame (first vertex at z = 0). The paper's distances count from the principal planes, where the thin
lens splits: d_f and d_3 from the object-side one, d_1 from the image-side one, so that to first order the camera is
the thin-lens camera of the same numbers. A ruler cannot reach a principal plane: with ``reference="vertex"`` d_f and
d_3 count from the first vertex and d_1 from the last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Problem
from ..microlens.discs import DiscIntersection
from ..microlens.images import microlens_images
from .first_order import FirstOrder, first_order, focused
from .kernels import STOPPED
from .perturb import rotation
from .prescription import LensError, Prescription
from .trace import KEPT, Rays, trace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rim:
    """A circular stop in object space: the flexible angular plane (FAP) or a further rim of the bore."""

    diameter: float
    """[mm]."""
    z: float
    """Place along z [mm], in front of the lens."""
    x: float = 0.0
    y: float = 0.0
    """Decentre [mm]."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """About x, then about y, about its centre [rad]."""


class Plane(NamedTuple):
    """How a plane of the camera stands: upright where its tilt is zero."""

    x: float = 0.0
    y: float = 0.0
    """What it is turned about [mm]."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """About x, then about y [rad]."""

    @property
    def axes(self) -> Array:
        """Its own x, y and normal in the lens's frame, one a row, (3, 3)."""
        return rotation(*self.tilt).T

    def lifted(self, point: ArrayLike, z: float) -> Array:
        """Points (..., 2) of the plane, counted as if it stood upright, in space, (3, ...) [mm]; `z` is the pivot's."""
        p = np.asarray(point, float)
        if self.tilt == (0.0, 0.0):
            return np.stack([p[..., 0], p[..., 1], np.full(p.shape[:-1], z)])
        across, along, _ = self.axes
        off = p - [self.x, self.y]
        there = np.array([self.x, self.y, z]) + off[..., :1] * across + off[..., 1:] * along
        return np.moveaxis(there, -1, 0)

    def crossed(self, place: Array, slope: Array, ahead: float) -> Array:
        """Where rays cross the plane, (2, ...) [mm], counted as if it stood upright.

        Parameters
        ----------
        place, slope : ndarray, shape (2, ...)
            The rays' heights on some upright plane [mm], and dx/dz, dy/dz.
        ahead : float
            From that plane to the pivot, along z [mm].
        """
        if self.tilt == (0.0, 0.0):
            return place + slope * ahead if ahead else place
        across, along, normal = self.axes
        x, y = place[0] - self.x, place[1] - self.y
        lean = normal[0] * slope[0] + normal[1] * slope[1] + normal[2]
        step = -(normal[0] * x + normal[1] * y - normal[2] * ahead) / lean
        hit = np.stack([x + step * slope[0], y + step * slope[1], step - ahead])
        mine = [np.tensordot(axis, hit, axes=1) for axis in (across, along)]
        return np.stack([mine[0] + self.x, mine[1] + self.y])


UPRIGHT = Plane()


@dataclass(frozen=True)
class LensCamera:
    """A real lens and what stands before and behind it.

    Attributes
    ----------
    lens : Prescription
        The main lens.
    wavelength : float
        Of first-order data and of everything not said otherwise [mm].
    rims : tuple of Rim
        The FAP first, then further stops.
    focal_plane, mla, sensor : float
        Places along z of the plane in focus, the microlens array and the sensor [mm]; where these are tilted, of what
        they turn about.
    array, detector : Plane
        How the microlens array and the sensor stand. Points on them count as if they stood upright.
    """

    lens: Prescription
    wavelength: float
    rims: tuple[Rim, ...]
    focal_plane: float
    mla: float
    sensor: float
    array: Plane = UPRIGHT
    detector: Plane = UPRIGHT

    def __post_init__(self) -> None:
        problems = []
        if not self.rims:
            problems.append(Problem("aperture", "is missing; the first rim is the flexible angular plane"))
        if any(self.focal_plane >= rim.z for rim in self.rims):
            problems.append(Problem("focal_plane", "must lie in front of the flexible angular plane and every stop"))
        for rim in self.rims:
            if not rim.diameter > 0:
                problems.append(Problem("aperture.diameter", f"{rim.diameter:g} mm must be greater than zero"))
            if rim.z > self.front:
                message = f"lies {rim.z - self.front:.4g} mm inside the lens; move it out, or count it from the vertex"
                problems.append(Problem("aperture.distance", message))
        if not self.mla > self.rear:
            message = f"lies {self.rear - self.mla:.4g} mm inside the lens; focus nearer or take a thinner lens"
            problems.append(Problem("microlens_array.distance", message))
        if not self.sensor > self.mla:
            problems.append(Problem("sensor.distance", "the sensor must lie behind the microlens array"))
        if problems:
            raise LensError(tuple(problems), self.lens.name)

    @property
    def front(self) -> float:
        """Foremost point of the lens on the axis or at its front rim [mm]."""
        first = self.lens.surfaces[0]
        return min(0.0, float(first.sag(first.semi_diameter)))

    @property
    def rear(self) -> float:
        """Hindmost point of the lens on the axis or at its rear rim [mm]."""
        last = self.lens.surfaces[-1]
        return self.lens.length + max(0.0, float(last.sag(last.semi_diameter)))

    @property
    def fap(self) -> Rim:
        """The flexible angular plane: the entrance pupil."""
        return self.rims[0]

    @property
    def is_upright(self) -> bool:
        """Whether nothing around the lens is tilted."""
        around = (*(rim.tilt for rim in self.rims), self.array.tilt, self.detector.tilt)
        return all(tilt == (0.0, 0.0) for tilt in around)

    @property
    def first_order(self) -> FirstOrder:
        """Gaussian constants at the camera's wavelength."""
        return first_order(self.lens, self.wavelength)

    @property
    def d_1(self) -> float:
        """Image-side principal plane to microlens array [mm]."""
        return self.mla - self.first_order.rear_principal

    @property
    def d_2(self) -> float:
        """Microlens array to sensor [mm]."""
        return self.sensor - self.mla

    @property
    def d_f(self) -> float:
        """Focal plane to object-side principal plane [mm]."""
        return self.first_order.front_principal - self.focal_plane

    @property
    def d_3(self) -> float:
        """FAP to object-side principal plane [mm]."""
        return self.first_order.front_principal - self.fap.z

    @property
    def lens_diameter(self) -> float:
        """Smallest clear diameter of the lens [mm]: D of its thin twin."""
        return 2 * min(surface.semi_diameter for surface in self.lens.surfaces)

    def with_lens(self, lens: Prescription) -> LensCamera:
        """The same camera with another lens (a perturbed one), nothing refocused."""
        return replace(self, lens=lens)

    def thin_images(self, microlens: ArrayLike) -> DiscIntersection:
        """Microlens images by the thin-lens model of the same first-order numbers, for microlenses (..., 2) [mm]."""
        constants = self.first_order
        return microlens_images(
            microlens,
            [*(rim.diameter for rim in self.rims), self.lens_diameter],
            [*(constants.front_principal - rim.z for rim in self.rims), 0.0],
            [*((rim.x, rim.y) for rim in self.rims), (0.0, 0.0)],
            focal_length=constants.focal_length,
            focal_plane=self.d_f,
            mla_distance=self.d_1,
            sensor_distance=self.d_2,
        )


def mounted(
    lens: Prescription,
    wavelength: float,
    *,
    pupil_diameter: float,
    pupil_distance: float,
    sensor_distance: float,
    focal_plane: float | None = None,
    mla_distance: float | None = None,
    stops: tuple[Rim, ...] = (),
    reference: str = "principal",
) -> LensCamera:
    """Focus a camera with a real lens.

    Parameters
    ----------
    lens, wavelength
        The lens as mounted (`Prescription.reversed` for the other way round), and the wavelength to focus [mm].
    pupil_diameter, pupil_distance : float
        D_F and d_3 of the flexible angular plane [mm].
    sensor_distance : float
        d_2 [mm].
    focal_plane, mla_distance : float
        d_f or d_1 [mm]: one of them; the other follows from the lens.
    stops : tuple of Rim
        Further rims, placed in the lens's frame.
    reference : {"principal", "vertex"}
        What d_f, d_3 and d_1 count from.

    Raises
    ------
    LensError
        Parts that collide, or a focus that does not exist.
    """
    if reference not in ("principal", "vertex"):
        raise LensError((Problem("reference", f"{reference!r} is not known; write 'principal' or 'vertex'"),))
    constants = first_order(lens, wavelength)
    by_vertex = reference == "vertex"
    front = 0.0 if by_vertex else constants.front_principal
    rear = lens.length if by_vertex else constants.rear_principal
    d_f = None if focal_plane is None else focal_plane - front + constants.front_principal
    d_1 = None if mla_distance is None else mla_distance + rear - constants.rear_principal
    d_f, d_1 = focused(lens, wavelength, focal_plane=d_f, mla=d_1)
    mla = constants.rear_principal + d_1
    fap = Rim(pupil_diameter, front - pupil_distance)
    rims = (fap, *stops)
    return LensCamera(lens, wavelength, rims, constants.front_principal - d_f, mla, mla + sensor_distance)


class Views(NamedTuple):
    """Backward rays, told where they cross the plane of the FAP; leading axes of the input."""

    pupil: Array
    """Point on the FAP's own plane, counted as if it stood upright [mm], (..., 2)."""
    place: Array
    """Point on the upright plane through the FAP's centre [mm], (..., 2); `pupil` where the FAP is not tilted."""
    slope: Array
    """dx/dz and dy/dz in object space, (..., 2)."""
    state: NDArray[np.int16]
    """What became of the ray (`trace.describe`), (...)."""
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

    Returns
    -------
    Views
    """
    c, p = np.broadcast_arrays(np.asarray(microlens, float), np.asarray(sensor, float))
    shape = c.shape[:-1]
    start, end = camera.detector.lifted(p, camera.sensor), camera.array.lifted(c, camera.mla)
    colour = camera.wavelength if wavelength is None else wavelength
    rays = Rays(end, Rays.between(start, end).direction)
    traced = trace(camera.lens, rays, colour, backward=True, plane=camera.fap.z, clip=clip, room=True)
    assert traced.room is not None
    lost = traced.state != KEPT
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(lost, 0.0, traced.rays.direction[:2] / traced.rays.direction[2])
    place, room, state = traced.rays.position[:2], traced.room, traced.state.copy()
    pupil, fap_room = place, room
    for number, rim in sorted(enumerate(camera.rims), key=lambda item: -item[1].z):  # nearest to the lens first
        crossing = Plane(rim.x, rim.y, rim.tilt).crossed(place, slope, rim.z - camera.fap.z)
        at = crossing - np.reshape([rim.x, rim.y], (2, *(1,) * len(shape)))
        left = np.where(lost, -1.0, 1 - np.sum(np.square(at), axis=0) / (rim.diameter / 2) ** 2)
        if number == 0:
            pupil, fap_room = crossing, left
        else:
            room = np.minimum(room, left)
        if clip:
            state[(state == KEPT) & (left < 0)] = 8 * (number + 1) + STOPPED
    at_fap, ahead, along = (np.moveaxis(part, 0, -1) for part in (pupil, place, slope))
    return Views(at_fap, ahead, along, state, fap_room, room)


def chief_slope(camera: LensCamera, microlens: ArrayLike, pupil: ArrayLike) -> Array:
    """First-order image-side slope of the ray from a point on the FAP's plane to a microlens, both (..., 2) [mm]."""
    (a, b), (c, d) = camera.first_order.matrix
    slope, height = d - c * camera.fap.z, b - a * camera.fap.z
    reach = slope * (camera.mla - camera.lens.length) + height
    if reach == 0 or not math.isfinite(reach):
        message = "the flexible angular plane is imaged onto the microlens array; move one of them"
        raise LensError((Problem("aperture.distance", message),))
    return np.asarray((slope * np.asarray(microlens, float) - np.asarray(pupil, float)) / reach)
