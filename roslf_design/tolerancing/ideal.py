"""Builds of a camera behind an ideal lens: images of their stops, and what a decoder makes of them.

The decoder believes in the nominal design, or in what a calibration told it, and looks through a real build. One object
point, two rays through opposite ends of the flexible angular plane (FAP): each lands on some microlens and some pixel.
The decoder turns both into views by the lattice of image centres it believes in, takes the slope between them (Eq. 12)
and turns that into a depth by the design it believes in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np

from .._arrays import Array
from ..bore.part import minus
from ..camera import Camera, Number, Vector
from ..camera.frames import along, cross, dot, total
from ..theory.exit_pupil import microlens_image_pitch
from ..theory.light import field_stretch
from ..theory.stop_images import MicrolensImages

Place = tuple[Number, Number]

CALIBRATION_DEPTHS = (0.8, 1.0, 1.25)
"""Depths at which a full calibration sees a target, in units of the object's gap to the end of the bore."""


def bore_end(camera: Camera) -> float:
    """The FAP or the farthest element, whichever is farther out [mm from the main lens]; of one camera."""
    end = camera.chain.end(camera.numbers)
    return max(float(camera["aperture.distance"]), float(end))


def azimuths(x: Array, y: Array) -> tuple[Array, Array]:
    """Unit vector from the axis towards each field; +x on the axis."""
    radius = np.hypot(x, y)
    off = radius > 0
    return np.where(off, x / np.where(off, radius, 1.0), 1.0), np.where(off, y / np.where(off, radius, 1.0), 0.0)


class IdealBuilds(MicrolensImages):
    """Builds behind an ideal lens at some fields; numbers broadcast to (fields, trials).

    Parameters
    ----------
    camera : Camera
        The builds.
    nominal : Camera
        As designed: what an uncalibrated decoder believes in, taken as aligned.
    fields : sequence of (x, y)
        Microlens positions on the array [mm].
    object_distance : float
        Z of the decoder's targets, which the nominal chief rays of the fields meet [mm].
    calibrated : bool
        Whether the decoder was calibrated on each build.
    strays : pair, optional
        How far each field's microlens is from where the pitch has it [mm]; a calibration does not learn it.
    """

    def __init__(
        self,
        camera: Camera,
        nominal: Camera,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
        strays: tuple[Number, Number] | None = None,
    ) -> None:
        super().__init__(camera, fields)
        self.lenslet_offsets = strays
        self.nominal, self.object_distance, self.calibrated = nominal, object_distance, calibrated
        self.azimuth = azimuths(self.x, self.y)
        self.reach = float(np.max(np.hypot(self.x, self.y))) or float(nominal.array_size[0]) / 2

    @cached_property
    def targets(self) -> tuple[Array, Array]:
        """Where the object points that the decoder looks at stand beside the axis [mm], (fields, 1)."""
        n, plane = self.nominal, self.nominal.plane(self.object_distance)
        # Chief ray, per unit of c: on the lens at l = H d_3/d_1, slope (c - l)/d_1 behind the lens and l/f more before.
        height = n.seen.d_3 * n.seen.d_f / ((n.seen.d_f - n.seen.d_3) * n.seen.d_1)
        slope = (1 - height) / n.seen.d_1 + height / n.f
        _, across = field_stretch(n, np.hypot(self.x, self.y))
        stretch = (plane.a * height - plane.b * slope) * across
        return self.x * stretch, self.y * stretch

    @cached_property
    def calibration_depths(self) -> tuple[float, ...]:
        """Where a calibration's targets stand, on the axis [mm from the main lens]."""
        bore = bore_end(self.nominal)
        return tuple(bore + (self.object_distance - bore) * factor for factor in CALIBRATION_DEPTHS)

    @cached_property
    def lattice(self) -> tuple[Place, Place, Place]:
        """Image centre of microlens (0, 0) that the decoder believes in, and the steps to the next along u and v [px].

        Calibrated, from the image centres of microlenses at +-`reach` on both axes of the array, as a white image
        shows them.
        """
        c = self.camera
        if not self.calibrated:
            pitch = float(microlens_image_pitch(self.nominal) / self.nominal.q)
            return (0.0, 0.0), (pitch, 0.0), (0.0, pitch)
        along = self.reach * np.array([[1.0], [-1.0], [0.0], [0.0]])
        u, v = (np.asarray(at / c.q) for at in c.chief_point(along, along[[2, 3, 0, 1]]))
        step = c.d / (2 * self.reach)
        middle = (u[0] + u[1]) / 2, (v[0] + v[1]) / 2
        return middle, ((u[0] - u[1]) * step, (v[0] - v[1]) * step), ((u[2] - u[3]) * step, (v[2] - v[3]) * step)

    def believed_centre(self, u: Number, v: Number) -> Place:
        """Image centre of a microlens that the decoder believes in [px]."""
        x, y = (total(o, a, u, b, v) for o, a, b in zip(*self.lattice, strict=True))
        return x, y

    @cached_property
    def centre_error(self) -> Place:
        """Image centres less where the decoder believes them [px]."""
        c, (x, y) = self.camera, self.chief
        u, v = self.believed_centre(self.x / c.d, self.y / c.d)
        return self._strayed(x / c.q - u, y / c.q - v)

    def _strayed(self, x: Number, y: Number) -> Place:
        """Errors of image centres [px], with those of the microlenses' own places: an image goes along."""
        if self.lenslet_offsets is None:
            return x, y
        aside = self.pitch / self.camera.d / self.camera.q
        return x + self.lenslet_offsets[0] * aside, y + self.lenslet_offsets[1] * aside

    @cached_property
    def depth_error_mm(self) -> Number:
        """Decoded depth less true depth of the targets [mm].

        Calibrated, depth follows from targets on the axis at three known distances: 1/depth and slope are related by a
        fractional linear map, which three pairs fix, whatever f, d_1, d_2 and d_3 really are.
        """
        rows: tuple[Array, ...] = (*self.targets, *self.azimuth)
        n = self.nominal
        depth: Number
        if not self.calibrated:  # Eq. 12, solved for the depth
            slope = self._slope(rows, self.object_distance)
            m, reach = n.seen.d_1 / n.seen.d_f, n.seen.d_1 * (n.seen.d_f - n.seen.d_3) / n.seen.d_f
            depth = n.plane_seen_at(1 / ((m * reach - slope * (n.d * n.seen.d_2 / n.q)) / (reach * reach)) + n.seen.d_3)
        else:  # all at once, the calibration's behind the fields' own
            depths, count = self.calibration_depths, len(self.fields)
            along_x = (np.full((len(depths), 1), value) for value in (0.0, 0.0, 1.0, 0.0))
            rows = tuple(map(np.concatenate, zip(rows, along_x, strict=True)))
            slopes = self._slope(rows, np.array([*[self.object_distance] * count, *depths])[:, None])
            depth = fractional(slopes[:count], [slopes[[k]] for k in range(count, len(slopes))], depths)
        depth = n.mapping.undrawn(
            depth, lambda: field_stretch(n, np.hypot(self.x, self.y))[0], lambda: n.entrance_pupil_distance
        )
        return depth - self.object_distance

    def _slope(self, rows: tuple[Array, ...], z: Number) -> Array:
        """Slope between two rays of an object point through the FAP's ends, as decoded [microlenses per pixel].

        Rows are the point's x and y [mm], and cosine and sine of where the ends lie.
        """
        x, y, cos, sin = rows
        ends = []
        rim = self.camera.fap.outline.rim
        for (px, py), (u, v) in self._landings(x, y, z, (rim(cos, sin), rim(-cos, -sin))):
            s, t = self.believed_centre(u, v)
            ends.append((minus(px, s), minus(py, t), u, v))
        ds, dt, du, dv = (minus(a, b) for a, b in zip(*ends, strict=True))
        return np.asarray(total(0.0, du, cos, dv, sin) / total(0.0, ds, cos, dt, sin))

    @cached_property
    def blur_pitches(self) -> Number:
        """Root-mean-square radius on the array of the targets' light, of rays that fill the FAP [microlens pitches]."""
        x, y = self.targets
        rule = self.camera.fap.outline.rule
        points = [microlens for _, microlens in self._landings(x, y, self.object_distance, [way[:2] for way in rule])]
        weight = np.array([share for *_, share in rule])[:, None, None]
        total: Number = 0.0
        for axis in (0, 1):
            at = np.stack(np.broadcast_arrays(*(point[axis] for point in points)))
            total = total + np.sum(weight * (at - np.sum(weight * at, axis=0)) ** 2, axis=0)
        return np.sqrt(total)

    def _landings(
        self, x: Array, y: Array, z: Number, ways: Sequence[tuple[Array | float, Array | float]]
    ) -> Iterator[tuple[Place, Place]]:
        """Pixel [pixels] and microlens [indices] that object points reach through points of the FAP.

        Those are given in its own coordinates [mm].
        """
        c, fap = self.camera, self.camera.apparent_pose("aperture")
        points = c.mapping.images(lambda way: self._before_lens(c.image_of(x, y, z, way)), ways)
        for (a, b), point in zip(ways, points, strict=True):
            yield self._landing(point, along(fap.origin, a, fap.x, b, fap.y))

    def _before_lens(self, apparent: Vector) -> Vector:
        """An object point, as the main lens sees it (x, y, distance before it), in the main lens's frame."""
        world, (x, y, z) = self.camera.world, apparent
        at = along(world.origin, x, world.x, y, world.y)
        return along(at, -1.0 * z, world.z, 0.0, world.z)

    def _landing(self, point: Vector, through: Vector) -> tuple[Place, Place]:
        """Where the ray of one point through another, both in the main lens's frame, meets sensor and array."""
        c, (px, py, pz), (ax, ay, az) = self.camera, point, through
        span, bend = minus(pz, az), -(1 / pz + 1 / c.f)
        lx, ly = cross(ax, pz, px, az) / span, cross(ay, pz, py, az) / span
        rx, ry = total(px / pz, bend, lx), total(py / pz, bend, ly)
        met: list[Place] = []
        for unit, axes in self._planes:
            (x, vx), (y, vy), (z, vz) = [
                (total(offset, u, lx, v, ly), total(w, u, rx, v, ry)) for (u, v, w), offset in axes
            ]
            reach = -z / vz
            met.append((total(x, reach, vx) / unit, total(y, reach, vy) / unit))
        return met[0], met[1]

    @cached_property
    def _planes(self) -> list[tuple[Number, list[tuple[Vector, Number]]]]:
        """Sensor and array: what places on them are counted in, their axes, and where the lens lies along those."""
        c = self.camera
        poses = (c.q, c.apparent_pose("sensor")), (c.d, c.apparent_pose("microlens_array"))
        return [(unit, [(axis, -dot(axis, pose.origin)) for axis in pose[1:]]) for unit, pose in poses]


def fractional(x: Number, known: Sequence[Number], images: Sequence[Number]) -> Number:
    """The fractional linear map that takes three known numbers to their images, at `x`."""
    (x0, x1, x2), (y0, y1, y2) = known, images
    # Equal cross-ratios (y - y1)(y0 - y2)/((y - y2)(y0 - y1)) of both: 0 at the middle one, exactly.
    cross = (x - x1) / (x - x2) * ((x0 - x2) / (x0 - x1)) * ((y0 - y1) / (y0 - y2))
    return y1 + cross * (y1 - y2) / (1 - cross)
