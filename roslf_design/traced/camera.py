"""A light-field camera as it is traced: where everything stands, and the backward ray from sensor to scene.

Its main lens is real, or ideal with something before it. The lens keeps its frame (first vertex at z = 0); its decentre
is taken up by what is around it. The paper's distances count from the principal planes, where the thin lens splits:
d_f, d_3, further stops and elements from the object-side one, d_1 from the image-side one, so that to first order the
camera is the thin-lens camera of the same numbers.

What stands before the lens (windows, liquids, rods, objectives) is traced face by face, in one train with the lens.
Glass about the array is reduced to air, as in the closed forms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import by_value
from ..bore.opening import ClearAperture
from ..camera import Camera
from ..design import Design
from ..design.assembly import Placed
from ..design.parts import MicrolensArray, Opening, Sensor
from ..errors import Problem
from ..fates import FATES, RayFate, describe, state_at
from ..lenses.manufacture import turned
from ..lenses.prescription import FirstOrder, IdealLens, LensError, Prescription, first_order, rotation
from ..lenses.tracer import BLOCK, COLUMNS, Passed, SurfaceStack
from ..theory.object_space import ObjectSpaceFaces
from .train import FOUND, TOLERANCE, Planes, RayTargets, Train, beyond_fap, fap_of, nearest, rim_row

Array = NDArray[np.float64]

AIR = SurfaceStack(np.empty((1, 0)), np.ones((1, 1)))
"""No surfaces."""


@by_value
@dataclass(frozen=True)
class TracedPlane:
    """A plane of the camera, or a stop on it; its points count as if it stood upright."""

    z: float
    """Place along z of what it is turned about [mm]."""
    x: float = 0.0
    y: float = 0.0
    """Coordinate of the point that the plane is turned about; a stop's decentre [mm]."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """About x, then about y [rad]."""
    diameter: float = math.inf
    """Diameter of a stop [mm]; of a rectangle the wider of its extents along x and y."""
    outline: ClearAperture | None = None
    """A stop's clear opening; None of a disc."""
    name: str = ""
    """A stop's name; by its number where none is given."""

    @property
    def opening(self) -> ClearAperture:
        """Clear opening about the centre."""
        return self.outline or ClearAperture(self.diameter / 2)

    @property
    def straight(self) -> bool:
        """Whether it is a stop with straight sides."""
        return self.opening.straight

    @property
    def rim(self) -> Array:
        """Numbers of a stop, (15,), as `Planes.rims` has them."""
        return rim_row(self.pose, self.opening)

    def points(self, shares: Array) -> Array:
        """Points (..., 2) of a stop's plane by their shares (..., 2) of its opening (`ClearAperture.shares`) [mm]."""
        return np.asarray(self.centre + np.stack(self.opening.at_shares(shares[..., 0], shares[..., 1]), axis=-1))

    def shares(self, points: Array) -> Array:
        """Shares (..., 2) of a stop's opening of points (..., 2) of its plane [mm]."""
        off = points - self.centre
        return np.stack(self.opening.shares(off[..., 0], off[..., 1]), axis=-1)

    def filled(self, disc: Array) -> Array:
        """Points (..., 2) that fill a stop as evenly as some (..., 2) fill the unit disc, rim to rim [mm]."""
        return np.asarray(self.centre + np.stack(self.opening.places(disc[..., 0], disc[..., 1]), axis=-1))

    def height(self, place: Array) -> Array:
        """Squared heights of points (2, ...) over that of a stop's rim."""
        off = place - self.centre.reshape(2, *(1,) * (place.ndim - 1))
        return self.opening.height(off[0], off[1])

    @property
    def centre(self) -> Array:
        """(2,) [mm]."""
        return np.array([self.x, self.y])

    @property
    def axes(self) -> Array:
        """Its own x, y and normal in the lens's frame, one a row, (3, 3)."""
        return rotation(*self.tilt).T

    @property
    def pose(self) -> Array:
        """Pose of the plane: the point that it is turned about and its axes, (12,), as `builds.Planes` has them."""
        return np.concatenate([[self.x, self.y, self.z], self.axes.ravel()])

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


@lru_cache(maxsize=32)
def _faces(ahead: Camera, wavelength: float) -> ObjectSpaceFaces:
    return ObjectSpaceFaces.of(ahead.replace({"wavelength": wavelength}))


@by_value
@dataclass(frozen=True)
class LensCamera:
    """A main lens in air, and the stops, array and sensor before and behind it.

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
        The microlens array and the sensor, glass about them reduced to air.

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
        problems = list[Problem]()
        last = self.lens.surfaces[-1]
        rear = self.lens.length + max(0.0, float(last.sag(last.semi_diameter)))
        if any(self.focal_plane >= rim.z for rim in self.rims):
            problems.append(Problem("focal_plane", "must lie in front of the flexible angular plane and every stop"))
        for rim in self.rims:
            if not rim.diameter > 0:
                problems.append(Problem("aperture.diameter", f"{rim.diameter:g} mm must be greater than zero"))
            behind = rim is self.fap and self.d_3 < 0  # an image, which is nowhere in the way
            if rim.z > self.front and not behind:
                message = f"lies {rim.z - self.front:.4g} mm inside the lens; move it out, or count it from the vertex"
                problems.append(Problem("aperture.distance", message))
        problems += self.collisions()
        if not self.array.z > rear:
            message = f"lies {rear - self.array.z:.4g} mm inside the lens; focus nearer or take a thinner lens"
            problems.append(Problem("microlens_array.distance", message))
        if not self.detector.z > self.array.z:
            problems.append(Problem("sensor.distance", "the sensor must lie behind the microlens array"))
        if problems:
            raise LensError(tuple(problems), self.lens.name)

    def collisions(self) -> Iterator[Problem]:
        """Further parts that stand inside the lens."""
        yield from ()

    @property
    def is_centred(self) -> bool:
        """Whether everything is symmetric about the lens's axis."""
        upright = all(part.tilt == (0.0, 0.0) for part in (*self.rims, self.array, self.detector))
        discs = all((rim.x, rim.y) == (0.0, 0.0) and not rim.straight for rim in self.rims)
        return self.lens.is_centred and upright and discs

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
        return float(self.array.z - self.first_order.rear_principal)

    @property
    def d_2(self) -> float:
        """Microlens array to sensor [mm]."""
        return self.detector.z - self.array.z

    @property
    def d_f(self) -> float:
        """Focal plane to object-side principal plane, as the lens sees it [mm]."""
        return float(self.first_order.front_principal - self.focal_plane)

    @property
    def d_3(self) -> float:
        """FAP to object-side principal plane, as the lens sees it [mm]."""
        return float(self.first_order.front_principal - self.fap.z)

    @property
    def focus(self) -> tuple[float, Array]:
        """B of the focal plane (`ImagedPlane`; d_f in air), and where the lens's axis meets it, (2,) [mm]."""
        return self.d_f, np.zeros(2)

    def straightened(self, point: Array) -> Array:
        """First-order points (..., 2) of the focal plane for those that an objective with a mapping sees there [mm]."""
        return point

    @property
    def apparent_pupil(self) -> tuple[float, float, Array]:
        """The FAP as the lens sees it: place along z [mm], its lengths over those, where the axis meets it, (2,)."""
        return self.fap.z, 1.0, np.zeros(2)

    @cached_property
    def planes(self) -> Planes:
        """Where everything stands around the lens; the camera is one build."""
        rims = np.array([[rim.rim for rim in self.rims]])
        return Planes(self.array.pose[None], self.detector.pose[None], rims)

    def slopes(self, microlens: Array, sensor: Array) -> Array:
        """Slopes of lines from microlenses to points of the sensor, both (..., 2) [mm]."""
        run = self.detector.lifted(sensor) - self.array.lifted(microlens)
        return np.asarray(np.moveaxis(run[:2] / run[2], 0, -1))

    def train(self, wavelength: float) -> Train:
        """Faces that rays of a wavelength [mm] meet."""
        return Train.in_air(self.lens.at(wavelength))

    def beyond(self, rays: Passed, train: Train, *, clip: bool) -> Passed:
        """Rays that cross the upright plane through the FAP's centre, on to the scene, prolonged back to that plane."""
        return rays

    @property
    def rims_at(self) -> int:
        """Place of the FAP in rays' states; further stops come behind it."""
        return len(self.lens.surfaces) + 1

    def place_name(self, place: int) -> str:
        """Name of a place that rays' states count: surfaces of the lens, then what stands before it."""
        stop = place - self.rims_at
        if stop < 0:
            return f"surface {place}"
        return self.rims[stop].name or (f"stop {stop}" if stop else "FAP")

    def describe(self, state: int) -> str:
        """Words for a ray's state."""
        return describe(state, self.place_name)

    def aimed(
        self, pupil: Array, point: Array, wavelength: float, *, clip: bool = False, start: Array | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Slopes at points on the FAP, (3, ...), of the light from points of the scene, (3, ...), and whether it comes.

        Slopes (2, ...) are those of the medium that the FAP stands in, looked for from `start`, near them, on.
        """
        ends = np.moveaxis(np.concatenate([pupil, point]), 0, -1)
        first = 0.0 if start is None else np.moveaxis(start, 0, -1).reshape(1, -1, 2)
        slopes, far, tallest = beyond_fap(self.train(wavelength), ends.reshape(1, -1, 6), first)
        comes = (far <= FOUND) & ((tallest <= 1) if clip else True)
        return np.moveaxis(slopes.reshape(*ends.shape[:-1], 2), -1, 0), comes.reshape(ends.shape[:-1])


@dataclass(frozen=True)
class _BoreCamera(LensCamera):
    """A main lens that looks through elements, whose stops are rows of the train; `rims` is the FAP alone."""

    ahead: Camera
    """Whose elements and stops stand before the lens."""

    def collisions(self) -> Iterator[Problem]:
        """Stops and elements that stand inside the lens."""
        for place, distance in self.ahead.numbers.items():
            part, _, name = place.rpartition(".")
            if name == "distance" and part.startswith(("stops.", "elements.")):
                inside = self.first_order.front_principal - float(distance) - self.front
                if inside > 0:
                    message = f"lies {inside:.4g} mm inside the lens; move it out, or count it from the vertex"
                    yield Problem(place, message)

    @property
    def is_centred(self) -> bool:
        """Whether everything is symmetric about the lens's axis."""
        table = self.faces.table + np.pad(self.origin, (0, COLUMNS - 3))
        return super().is_centred and not (np.any(table[:, :2]) or np.any(table[:, 7]))

    @property
    def d_f(self) -> float:
        """Focal plane to object-side principal plane, as the lens sees it [mm]."""
        return float(self.ahead.seen.d_f)

    @property
    def d_3(self) -> float:
        """FAP to object-side principal plane, as the lens sees it [mm]."""
        return float(self.ahead.seen.d_3)

    @property
    def focus(self) -> tuple[float, Array]:
        """B of the focal plane (`ImagedPlane`), and where the lens's axis meets it, (2,) [mm]."""
        return float(self.ahead.focus.b), np.array(self.ahead.focus.axis_offset, float)

    def straightened(self, point: Array) -> Array:
        """First-order points (..., 2) of the focal plane for those that an objective with a mapping sees there [mm]."""
        if not self.ahead.mapping.bends:
            return point
        x, y = (float(self.ahead[f"main_lens.decentre.{axis}"]) for axis in (0, 1))
        (u, v), _ = self.ahead.straight_ray(point[..., 0] + x, point[..., 1] + y, self.ahead["main_lens.focal_plane"])
        return np.stack([u - x, v - y], axis=-1)

    @property
    def apparent_pupil(self) -> tuple[float, float, Array]:
        """The FAP as the lens sees it: place along z [mm], its lengths over those, where the axis meets it, (2,)."""
        plane = self.ahead.fap.plane
        if plane is None:
            return super().apparent_pupil
        z = self.first_order.front_principal - float(plane.distance)
        return z, float(plane.magnification), np.array(plane.axis_offset, float)

    @property
    def origin(self) -> Array:
        """Point where the system's axis crosses the object-side principal plane, (3,) [mm]."""
        x, y = (-float(self.ahead[f"main_lens.decentre.{axis}"]) for axis in (0, 1))
        return np.array([x, y, self.first_order.front_principal])

    @property
    def faces(self) -> ObjectSpaceFaces:
        """Faces of what stands before the lens, at the camera's own wavelength."""
        return _faces(self.ahead, self.wavelength)

    def train(self, wavelength: float) -> Train:
        """Faces that rays of a wavelength [mm] meet."""
        return Train.of(self.lens.at(wavelength), _faces(self.ahead, wavelength), self.origin)

    def beyond(self, rays: Passed, train: Train, *, clip: bool) -> Passed:
        """Rays that cross the upright plane through the FAP's centre, on to the scene, prolonged back to that plane.

        States count all faces before the lens behind the lens's own, from the lens outwards (`describe`).
        """
        own, faces = len(self.lens.surfaces), len(self.faces.names)
        fap = fap_of(self.faces)
        near, why = np.divmod(rays.state, FATES)
        near = np.where(near > fap, near - fap, np.where(near > 0, own + 1 + fap - near, 0))
        state = np.asarray(FATES * near + why, np.int16)
        if not train.beyond.table.size:
            return rays._replace(state=state)
        out = train.beyond.through(rays.height, rays.slope, start=self.fap.z, end=self.fap.z, clip=clip)
        far, there = np.divmod(out.state, FATES)
        far = np.where(far > 0, own + 1 + faces - far, 0)
        state = np.asarray(np.where(state != RayFate.KEPT, state, FATES * far + there), np.int16)
        return Passed(out.height, out.slope, state, np.minimum(rays.margin, out.margin))

    @property
    def rims_at(self) -> int:
        """Place of the FAP in rays' states, among the faces before the lens."""
        return super().rims_at + fap_of(self.faces)

    def place_name(self, place: int) -> str:
        """Name of a place that rays' states count: surfaces of the lens, then faces from there outwards."""
        face = place - len(self.lens.surfaces) - 1
        return self.faces.names[face] if face >= 0 else f"surface {place}"


@lru_cache(maxsize=64)
def camera_of(design: Design) -> LensCamera:
    """The traced camera of a design; an ideal main lens is traced as one that bends rays in a plane.

    A tilt of the main lens turns it about the middle of its principal planes, one of any other part about its centre.

    Raises
    ------
    LensError
        Parts that collide: a stop or the array inside the lens.
    """
    lens = design.lens or IdealLens.of(design.f, design.D)
    constants = first_order(lens, design.wavelength)
    front, rear = constants.front_principal, constants.rear_principal
    if design.main_lens.tilt != (0.0, 0.0):
        lens = turned(lens, *design.main_lens.tilt, pivot=(front + rear) / 2)

    def stands(part: Opening | MicrolensArray | Sensor, z: float) -> TracedPlane:
        x, y = np.subtract(part.decentre, design.main_lens.decentre)
        return TracedPlane(z, float(x), float(y), part.tilt)

    def opened(at: Placed[Opening]) -> TracedPlane:
        opening = at.part.outline
        plane = stands(at.part, front - at.near)
        return replace(plane, diameter=float(opening.width), outline=opening, name=at.name)

    seen = Camera.of(design)
    mla = rear + float(seen.seen.d_1)
    rims = tuple(map(opened, design.openings))
    array, detector = stands(design.microlens_array, mla), stands(design.sensor, mla + float(seen.seen.d_2))
    focal_plane = front - design.d_f
    if design.elements:
        return _BoreCamera(lens, design.wavelength, rims[:1], focal_plane, array, detector, seen)
    return LensCamera(lens, design.wavelength, rims, focal_plane, array, detector)


def tilted_parts(design: Design) -> tuple[str, ...]:
    """Parts around the main lens that are tilted."""
    tilts = {at.name: at.part.tilt for at in design.openings}
    tilts |= {"microlens array": design.microlens_array.tilt, "sensor": design.sensor.tilt}
    return tuple(name for name, tilt in tilts.items() if tilt != (0.0, 0.0))


def microlenses(design: Design, axes: Sequence[tuple[float, float]] | ArrayLike) -> Array:
    """Microlens axes (..., 2), given in the array's own frame, in the lens's [mm]; as if the array stood upright."""
    cosine, sine = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    there = np.asarray(axes, float) @ np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(there + np.subtract(design.microlens_array.decentre, design.main_lens.decentre))


class RayViews(NamedTuple):
    """Backward rays, told where they cross the plane of the FAP; leading axes of the input."""

    pupil: Array
    """Point on the FAP's own plane, counted as if it stood upright [mm], (..., 2)."""
    place: Array
    """Point where the ray in front of all elements, prolonged, crosses the upright plane through the FAP's centre [mm],
    (..., 2); `pupil` where nothing stands before an upright FAP."""
    slope: Array
    """dx/dz and dy/dz in front of all elements, (..., 2)."""
    state: NDArray[np.int16]
    """State of the ray (`LensCamera.describe`), (...)."""
    fap_margin: Array
    """1 less the squared height over that of the FAP's rim, (...): positive inside."""
    margin: Array
    """Least of the same over the lens's surfaces, the further stops and the elements, (...); -1 or less where one was
    not met."""

    def at(self, distance: ArrayLike) -> Array:
        """Points where the rays cross a plane `distance` in front of the FAP [mm], (..., 2)."""
        return np.asarray(self.place - self.slope * np.asarray(distance, float)[..., None])


def views(
    camera: LensCamera, microlens: ArrayLike, sensor: ArrayLike, wavelength: float | None = None, *, clip: bool = True
) -> RayViews:
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
        Whether clear diameters, the FAP and the stops stop rays; otherwise only `margin` and `fap_margin` tell.
    """
    c, p = np.broadcast_arrays(np.asarray(microlens, float), np.asarray(sensor, float))
    run = (end := camera.array.lifted(c)) - camera.detector.lifted(p)
    train = camera.train(camera.wavelength if wavelength is None else wavelength)
    rays = train.lens.through(end[:2], run[:2] / run[2], start=end[2], end=camera.fap.z, clip=clip)
    ahead = camera.beyond(rays, train, clip=clip)
    place, slope, room, state = ahead.height, ahead.slope, ahead.margin, ahead.state
    lost = state != RayFate.KEPT
    pupil, fap_room = place, room
    for number, rim in sorted(enumerate(camera.rims), key=lambda item: -item[1].z):  # nearest to the lens first
        crossing = rim.crossed(rays.height, rays.slope, camera.fap.z)
        left = np.where(lost, -1.0, 1 - rim.height(crossing))
        if number == 0:
            pupil, fap_room = crossing, left
        else:
            room = np.minimum(room, left)
        if clip:
            state[(state == RayFate.KEPT) & (left < 0)] = state_at(camera.rims_at + number)
    pupil, place, slope = (np.moveaxis(part, 0, -1) for part in (pupil, place, slope))
    return RayViews(pupil, place, slope, state, fap_room, room)


def chief_slope(camera: LensCamera, microlens: ArrayLike, pupil: ArrayLike) -> Array:
    """First-order image-side slope of the ray from a point on the FAP's plane to a microlens, both (..., 2) [mm]."""
    (a, b), (c, d) = camera.first_order.matrix
    z, scale, aside = camera.apparent_pupil
    slope, height = d - c * z, b - a * z
    reach = slope * (camera.array.z - camera.lens.length) + height
    if reach == 0 or not math.isfinite(reach):
        message = "the flexible angular plane is imaged onto the microlens array; move one of them"
        raise LensError((Problem("aperture.distance", message),))
    return np.asarray((slope * np.asarray(microlens, float) - (np.asarray(pupil, float) - aside) / scale) / reach)


@dataclass(frozen=True, eq=False)
class _SensorPoints:
    """Sensor points that see given points of the FAP's plane."""

    camera: LensCamera
    microlens: Array
    sensor: Array
    """[mm], (..., 2)."""
    heights: Array
    """Squared heights of the rays, as `AimedRays` has them, (..., S + R - 1)."""
    ok: NDArray[np.bool_]
    """Whether the point was found, (...); elsewhere the nearest approach."""

    @cached_property
    def views(self) -> RayViews:
        """Views of the backward rays, apertures not counted."""
        return views(self.camera, self.microlens, self.sensor, clip=False)


def sensor_of_pupil(
    camera: LensCamera, microlens: ArrayLike, pupil: ArrayLike, *, start: ArrayLike | None = None
) -> _SensorPoints:
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
        To 1e-11 of the FAP's radius, apertures left aside (`heights` tells of them).
    """
    c, a = np.broadcast_arrays(np.asarray(microlens, float), np.asarray(pupil, float))
    p = c + camera.d_2 * chief_slope(camera, c, a) if start is None else np.broadcast_to(start, c.shape)
    middle = c + camera.d_2 * chief_slope(camera, c, np.zeros(2))
    flat, shape = c.reshape(-1, 2), c.shape[:-1]
    slopes, home = (camera.slopes(c, q).reshape(-1, 2) for q in (p, middle))
    there = camera.fap.shares(a.reshape(-1, 2))
    rays = min(len(flat), BLOCK)
    begin = np.arange(0, len(flat), max(rays, 1)).clip(max=len(flat) - rays)
    wanted = RayTargets(flat - camera.array.centre, np.zeros_like(flat), there, slopes, np.full((len(flat), 4), np.nan))
    train, job = camera.train(camera.wavelength), np.zeros(len(begin), int)
    found = nearest(train, camera.planes, np.zeros(1), wanted, home, job, begin, rays)
    landed, heights, left = (np.empty((len(flat), *part.shape[2:])) for part in found)
    for first, *parts in zip(begin, *found, strict=True):
        for column, part in zip((landed, heights, left), parts, strict=True):
            column[first : first + rays] = part
    sensor = (landed + camera.detector.centre).reshape(c.shape)
    ok = (left <= FOUND * TOLERANCE).reshape(shape)
    return _SensorPoints(camera, c, sensor, heights.reshape(*shape, heights.shape[-1]), ok)


def nominal_targets(design: Design, base: Array, offset: Array, target: Array) -> RayTargets:
    """Targets of rays, found in the nominal camera; base, offset and target (n, 2) as `RayTargets` has them."""
    camera, there = camera_of(design), microlenses(design, base + offset * design.d / 2)
    fap = camera.fap
    nominal = sensor_of_pupil(camera, there, fap.points(target))
    nudge = 1e-3 * float(np.hypot(*np.ptp(nominal.sensor - there, axis=0))) + 1e-6 * camera.d_2
    columns, rates = [], []
    for step in nudge * np.eye(2):
        ends = [nominal.sensor + sign * step for sign in (1, -1)]
        one, other = (fap.shares(views(camera, there, p, clip=False).pupil) for p in ends)
        columns.append(one - other)
        rates.append(camera.slopes(there, ends[0]) - camera.slopes(there, ends[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.stack(rates, axis=-1) @ np.linalg.pinv(np.stack(columns, axis=-1))
    start = np.where(nominal.ok[:, None], camera.slopes(there, nominal.sensor), np.nan)
    return RayTargets(base, offset, target, start, inverse.reshape(-1, 4))
