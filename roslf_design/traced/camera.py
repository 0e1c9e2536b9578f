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
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from ..bore.faces import KIND
from ..camera import Camera
from ..design import Design, Stop
from ..design.parts import MicrolensArray, Sensor
from ..errors import Problem
from ..lenses.manufacture import turned
from ..lenses.prescription import FirstOrder, IdealLens, LensError, Prescription, first_order, rotation
from ..lenses.tracer import (
    BLOCK,
    COLUMNS,
    KEPT,
    MAPPED,
    REASONS,
    ROWS,
    STOPPED,
    Passed,
    SurfaceStack,
    describe,
    pass_surfaces,
)
from ..theory.object_space import FacesAhead, Status

Array = NDArray[np.float64]

NEWTON_STEPS = 25
LOST = 1e300
"""Size of the miss of a ray that did not come through."""
NEAR = 1e-11
"""How near a point of the scene rays must come that are aimed at it from up to 100 mm away [mm]."""
FOUND = 1e3
"""How many times that still counts, where they cannot come nearer."""


@dataclass(frozen=True)
class TracedPlane:
    """A plane of the camera, or a circular stop on it; its points count as if it stood upright."""

    z: float
    """Place along z of what it is turned about [mm]."""
    x: float = 0.0
    y: float = 0.0
    """Coordinate of the point that the plane is turned about; a stop's decentre [mm]."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """About x, then about y [rad]."""
    diameter: float = math.inf
    """Diameter of a stop [mm]."""

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


class Train(NamedTuple):
    """Train of surfaces that rays meet on either side of the FAP, in the lens's frame; builds lead."""

    lens: SurfaceStack
    """The main lens, and before it what stands between it and the FAP."""
    beyond: SurfaceStack
    """Surfaces before the FAP; a stack without surfaces where there are none."""

    @classmethod
    def of(cls, lens: SurfaceStack, ahead: FacesAhead | None = None, origin: ArrayLike = 0.0) -> Train:
        """A lens and what stands before it.

        Parameters
        ----------
        lens : SurfaceStack
            T builds.
        ahead : FacesAhead, optional
            Of the same builds; None is air only.
        origin : array_like
            Where those faces' frame has its origin in the lens's [mm], (3,) or (T, 3).
        """
        builds = len(lens.table)
        if ahead is None:
            return cls(lens, SurfaceStack(np.empty((builds, 0)), np.ones((builds, 1))))
        table = np.array(np.broadcast_to(ahead.table, (builds, *ahead.table.shape[-2:])))
        table[..., :3] += np.broadcast_to(np.asarray(origin, float), (builds, 3))[:, None]
        media = np.broadcast_to(ahead.media, (builds, *ahead.media.shape[-2:]))
        fap = fap_of(ahead)

        def stack(part: slice, medium: Array) -> SurfaceStack:
            """Some of the faces in the order of the light, which comes out of the last into a medium."""
            rows, sides = table[:, part][:, ::-1], media[:, part][:, ::-1]
            return SurfaceStack(rows.reshape(builds, -1), np.concatenate([sides[..., 0], medium], axis=1))

        near, far = stack(slice(fap), media[:, :1, 1]), stack(slice(fap + 1, None), media[:, fap, :1])
        law = np.broadcast_to(ahead.law.ravel(), (builds, ahead.law.size))
        near_law, far_law = (law, law[:, :0]) if MAPPED in ahead.table[..., :fap, KIND] else (law[:, :0], law)
        own = SurfaceStack(
            np.concatenate([near.table, lens.table, near_law], axis=1),
            np.concatenate([near.media[:, :-1], lens.media], axis=1),
        )
        return cls(own, far._replace(table=np.concatenate([far.table, far_law], axis=1)))


def fap_of(ahead: FacesAhead) -> int:
    """How many faces stand between main lens and FAP."""
    return int(np.flatnonzero(ahead.takers == Status.APERTURE)[0])


@lru_cache(maxsize=32)
def _faces(ahead: Camera, wavelength: float) -> FacesAhead:
    return FacesAhead.of(ahead.replace({"wavelength": wavelength}))


@dataclass(frozen=True)
class LensCamera:
    """A main lens and what stands before and behind it.

    Attributes
    ----------
    lens : Prescription
        The main lens.
    wavelength : float
        Of first-order data and of everything not said otherwise [mm].
    rims : tuple of TracedPlane
        The FAP first, then further stops; where elements stand before the lens, these are of the train.
    focal_plane : float
        Place along z of the plane in focus [mm].
    array, detector : TracedPlane
        The microlens array and the sensor, glass about them reduced to air.
    ahead : Camera or None
        Whose elements and stops stand before the lens; None is air only.

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
    ahead: Camera | None = None

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
        numbers = {} if self.ahead is None else self.ahead.numbers
        for place, distance in numbers.items():
            part, _, name = place.rpartition(".")
            if name == "distance" and part.startswith(("stops.", "elements.")):
                inside = self.first_order.front_principal - float(distance) - self.front
                if inside > 0:
                    message = f"lies {inside:.4g} mm inside the lens; move it out, or count it from the vertex"
                    problems.append(Problem(place, message))
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
        """Focal plane to object-side principal plane, as the lens sees it [mm]."""
        return self.first_order.front_principal - self.focal_plane if self.ahead is None else float(self.ahead.seen.d_f)

    @property
    def d_3(self) -> float:
        """FAP to object-side principal plane, as the lens sees it [mm]."""
        return self.first_order.front_principal - self.fap.z if self.ahead is None else float(self.ahead.seen.d_3)

    @property
    def focus(self) -> tuple[float, Array]:
        """B of the focal plane (`ImagedPlane`; d_f in air), and where the lens's axis meets it, (2,) [mm]."""
        if self.ahead is None:
            return self.d_f, np.zeros(2)
        return float(self.ahead.focus.b), np.array(self.ahead.focus.aside, float)

    def straightened(self, point: Array) -> Array:
        """Where first order has points (..., 2) of the focal plane that an objective with a mapping sees there [mm]."""
        if self.ahead is None or self.ahead.law is None:
            return point
        x, y = (float(self.ahead[f"main_lens.decentre.{axis}"]) for axis in (0, 1))
        (u, v), _ = self.ahead.straight_ray(point[..., 0] + x, point[..., 1] + y, self.ahead["main_lens.focal_plane"])
        return np.stack([u - x, v - y], axis=-1)

    @cached_property
    def sight(self) -> tuple[float, float, Array]:
        """The FAP as the lens sees it: place along z [mm], its lengths over those, where the axis meets it, (2,)."""
        plane = None if self.ahead is None else self.ahead.fap.plane
        if plane is None:
            return self.fap.z, 1.0, np.zeros(2)
        z = self.first_order.front_principal - float(plane.distance)
        return z, float(plane.magnification), np.array(plane.aside, float)

    @property
    def origin(self) -> Array:
        """Where the system's axis crosses the object-side principal plane, (3,) [mm]."""
        assert self.ahead is not None
        x, y = (-float(self.ahead[f"main_lens.decentre.{axis}"]) for axis in (0, 1))
        return np.array([x, y, self.first_order.front_principal])

    @property
    def faces(self) -> FacesAhead:
        """Faces of what stands before the lens, at the camera's own wavelength."""
        assert self.ahead is not None
        return _faces(self.ahead, self.wavelength)

    @property
    def faces_centred(self) -> bool:
        """Whether everything before the lens is symmetric about its axis."""
        table = self.faces.table + np.pad(self.origin, (0, COLUMNS - 3))
        return not (np.any(table[:, :2]) or np.any(table[:, 7]))

    def train(self, wavelength: float) -> Train:
        """Train of surfaces that rays of a wavelength [mm] meet."""
        lens = self.lens.at(wavelength)
        if self.ahead is None:
            return Train.of(lens)
        return Train.of(lens, _faces(self.ahead, wavelength), self.origin)

    def beyond(self, rays: Passed, train: Train, *, clip: bool) -> Passed:
        """Rays that cross the upright plane through the FAP's centre, on to the scene, prolonged back to that plane.

        States count all faces before the lens behind the lens's own, from the lens outwards (`describe`).
        """
        if self.ahead is None:
            return rays
        own, faces = len(self.lens.surfaces), len(self.faces.takers)
        fap = fap_of(self.faces)
        near, why = np.divmod(rays.state, 8)
        near = np.where(near > fap, near - fap, np.where(near > 0, own + 1 + fap - near, 0))
        state = np.asarray(8 * near + why, np.int16)
        if not train.beyond.table.size:
            return rays._replace(state=state)
        out = train.beyond.through(rays.height, rays.slope, start=self.fap.z, end=self.fap.z, clip=clip)
        far, there = np.divmod(out.state, 8)
        far = np.where(far > 0, own + 1 + faces - far, 0)
        state = np.asarray(np.where(state != KEPT, state, 8 * far + there), np.int16)
        return Passed(out.height, out.slope, state, np.minimum(rays.room, out.room))

    def describe(self, state: int) -> str:
        """Words for a ray's state; faces before the lens by their names."""
        face = state // 8 - len(self.lens.surfaces) - 1
        if self.ahead is None or face < 0 or state % 8 == STOPPED:
            return describe(state)
        return REASONS[state % 8].replace("surface {}", self.faces.names[face])

    def aimed(
        self, pupil: Array, point: Array, wavelength: float, *, clip: bool = False
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Slopes at points on the FAP, (3, ...), of the light from points of the scene, (3, ...), and whether it comes.

        Slopes (2, ...) are those of the medium that the FAP stands in.
        """
        run = pupil - point
        beyond = self.train(wavelength).beyond
        if not beyond.table.size:
            return run[:2] / run[2], np.ones(run.shape[1:], np.bool_)
        rays = np.ascontiguousarray(np.concatenate([pupil, point]).reshape(6, -1))
        slopes, kept = np.empty((2, rays.shape[1])), np.empty(rays.shape[1], np.bool_)
        room = np.empty(ROWS * BLOCK), np.empty((beyond.media.shape[1] - 1) * BLOCK)
        towards.compiled(beyond.table[0], beyond.media[0], *room, clip, rays, slopes, kept)
        return slopes.reshape(2, *run.shape[1:]), kept.reshape(run.shape[1:])


@kernel()
def aim_beyond(
    table: Any, media: Any, buffer: Any, squares: Any, x: float, y: float, z: float, tx: float, ty: float, tz: float
) -> Any:
    """Slopes at a point of the FAP of the ray that meets a point of the scene, and by how many `NEAR` it misses that.

    By Newton's method from the axis's direction: the map is nearly affine. `buffer` and `squares` are room to work;
    the first of each row of `squares` is then r^2 on each surface.
    """
    count = len(media) - 1
    if count == 0:
        return (x - tx) / (z - tz), (y - ty) / (z - tz), 0.0
    sx, sy, bx, by, best = 0.0, 0.0, 0.0, 0.0, LOST
    miss_x, miss_y = np.empty(3), np.empty(3)
    enough = NEAR * (1.0 + 0.01 * abs(tz - z))
    for step in range(NEWTON_STEPS + 1):
        nudge = 1e-5
        far = LOST
        for probe in range(2, -1, -1):
            ax, ay = sx + (nudge if probe == 1 else 0.0), sy + (nudge if probe == 2 else 0.0)
            shrink = -1.0 / math.sqrt(1.0 + ax * ax + ay * ay)
            buffer[0], buffer[BLOCK], buffer[2 * BLOCK] = x, y, z
            buffer[3 * BLOCK], buffer[4 * BLOCK], buffer[5 * BLOCK] = ax * shrink, ay * shrink, shrink
            buffer[6 * BLOCK] = 0.0
            pass_surfaces(buffer, 1, table, media, count, True, False, squares)
            down = buffer[5 * BLOCK]
            far = LOST
            if buffer[6 * BLOCK] != 0.0 or not down < 0.0:
                break
            t = (tz - buffer[2 * BLOCK]) / down
            miss_x[probe] = buffer[0] + t * buffer[3 * BLOCK] - tx
            miss_y[probe] = buffer[BLOCK] + t * buffer[4 * BLOCK] - ty
            far = max(abs(miss_x[probe]), abs(miss_y[probe]))
        if far < best:
            bx, by, best = sx, sy, far
        if best <= enough or step == NEWTON_STEPS:
            break
        xx, xy = (miss_x[1] - miss_x[0]) / nudge, (miss_x[2] - miss_x[0]) / nudge
        yx, yy = (miss_y[1] - miss_y[0]) / nudge, (miss_y[2] - miss_y[0]) / nudge
        area = xx * yy - xy * yx
        if far == LOST or far > best or area == 0.0:  # half way back to the best so far
            sx, sy = 0.5 * (sx + bx), 0.5 * (sy + by)
        else:
            sx -= (yy * miss_x[0] - xy * miss_y[0]) / area
            sy -= (xx * miss_y[0] - yx * miss_x[0]) / area
    return bx, by, best / enough


@kernel()
def towards(table: Any, media: Any, buffer: Any, squares: Any, clip: bool, rays: Any, slopes: Any, kept: Any) -> None:
    """Aim from points of the FAP at points of the scene, both in `rays` (6, N)."""
    for i in range(rays.shape[1]):
        slopes[0, i], slopes[1, i], far = aim_beyond(
            table, media, buffer, squares, rays[0, i], rays[1, i], rays[2, i], rays[3, i], rays[4, i], rays[5, i]
        )
        kept[i] = far <= FOUND
        if clip:
            for k in range(len(media) - 1):
                kept[i] = kept[i] and squares[k * BLOCK] <= table[k * COLUMNS + 5]


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

    def stands(part: Stop | MicrolensArray | Sensor, z: float, diameter: float = math.inf) -> TracedPlane:
        x, y = np.subtract(part.decentre, design.main_lens.decentre)
        return TracedPlane(z, float(x), float(y), part.tilt, diameter)

    seen = Camera.of(design)
    mla = rear + float(seen.seen.d_1)
    rims = tuple(stands(stop, front - stop.distance, stop.diameter) for stop in design.all_stops)
    array, detector = stands(design.microlens_array, mla), stands(design.sensor, mla + float(seen.seen.d_2))
    parts = lens, design.wavelength, rims[: 1 if design.elements else None], front - design.d_f, array, detector
    return LensCamera(*parts, seen if design.elements else None)


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
    """Point where the ray in front of all elements, prolonged, crosses the upright plane through the FAP's centre [mm],
    (..., 2); `pupil` where nothing stands before an upright FAP."""
    slope: Array
    """dx/dz and dy/dz in front of all elements, (..., 2)."""
    state: NDArray[np.int16]
    """State of the ray (`LensCamera.describe`), (...)."""
    fap_room: Array
    """1 - r^2/(D_F/2)^2 about the FAP's centre, (...): positive inside."""
    room: Array
    """Least of the same over the lens's surfaces, the further stops and the elements, (...); -1 or less where one was
    not met."""

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
    train = camera.train(camera.wavelength if wavelength is None else wavelength)
    rays = train.lens.through(end[:2], run[:2] / run[2], start=end[2], end=camera.fap.z, clip=clip)
    ahead = camera.beyond(rays, train, clip=clip)
    place, slope, room, state = ahead.height, ahead.slope, ahead.room, ahead.state
    lost = state != KEPT
    pupil, fap_room = place, room
    for number, rim in sorted(enumerate(camera.rims), key=lambda item: -item[1].z):  # nearest to the lens first
        crossing = rim.crossed(rays.height, rays.slope, camera.fap.z)
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
    z, scale, aside = camera.sight
    slope, height = d - c * z, b - a * z
    reach = slope * (camera.array.z - camera.lens.length) + height
    if reach == 0 or not math.isfinite(reach):
        message = "the flexible angular plane is imaged onto the microlens array; move one of them"
        raise LensError((Problem("aperture.distance", message),))
    return np.asarray((slope * np.asarray(microlens, float) - (np.asarray(pupil, float) - aside) / scale) / reach)


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
