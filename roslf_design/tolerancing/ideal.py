"""Builds of a camera behind an ideal lens: images of their stops, and what a decoder makes of them.

The decoder believes in the nominal design, or in what a calibration told it, and looks through a real build. One object
point, two rays through opposite ends of the flexible angular plane (FAP): each lands on some microlens and some pixel.
The decoder turns both into views by the lattice of image centres it believes in, takes the slope between them (Eq. 12)
and turns that into a depth by the design it believes in.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera, Number, Vector
from ..camera.frames import along, dot, minus, plus, times
from ..theory.exit_pupil import microlens_image_pitch
from ..theory.stop_images import MicrolensImages

Array = NDArray[np.float64]

DISC_RULE = ((0.0, 0.0, 0.25), *((np.sqrt(2 / 3), k * np.pi / 3, 0.125) for k in range(6)))
"""Radius, angle and weight of points that average polynomials up to the fifth degree over the unit disc exactly."""
CALIBRATION_DEPTHS = (0.8, 1.0, 1.25)
"""Depths at which a full calibration sees a target, in units of the object's gap to the FAP."""


class BelievedLattice(NamedTuple):
    """Where a decoder believes microlens u has its image centre: ``origin + columns u`` [pixels]."""

    x: Number
    y: Number
    xu: Number
    xv: Number
    yu: Number
    yv: Number

    def centre(self, u: Number, v: Number) -> tuple[Number, Number]:
        """Believed image centre of a microlens [pixels]."""
        x = plus(self.x, plus(times(self.xu, u), times(self.xv, v)))
        return x, plus(self.y, plus(times(self.yu, u), times(self.yv, v)))


class Targets(NamedTuple):
    """Object points whose depth is asked for."""

    x: Array
    y: Array
    """Shape (fields, 1) [mm], in the system's axes."""
    distance: float
    """Z, in front of the main lens [mm]."""
    azimuth: tuple[Array, Array]
    """Unit vector of each field's direction, along which its views are taken; +x on the axis."""


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
    """

    def __init__(
        self,
        camera: Camera,
        nominal: Camera,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
    ) -> None:
        super().__init__(camera, fields)
        self.nominal, self.object_distance, self.calibrated = nominal, object_distance, calibrated
        self.azimuth = azimuths(self.x, self.y)
        self.reach = float(np.max(np.hypot(self.x, self.y))) or float(nominal.array_size[0]) / 2

    @cached_property
    def targets(self) -> Targets:
        """What the decoder looks at."""
        n = self.nominal
        # Chief ray, per unit of c: on the lens at l = H d_3/d_1, slope (c - l)/d_1 behind the lens and l/f more before.
        height = n.d_3 * n.d_f / ((n.d_f - n.d_3) * n.d_1)
        stretch = height - ((1 - height) / n.d_1 + height / n.f) * self.object_distance
        return Targets(self.x * stretch, self.y * stretch, self.object_distance, self.azimuth)

    @cached_property
    def calibration_depths(self) -> tuple[float, ...]:
        """Where a calibration's targets stand, on the axis [mm from the main lens]."""
        d_3 = float(self.nominal.d_3)
        return tuple(d_3 + (self.object_distance - d_3) * factor for factor in CALIBRATION_DEPTHS)

    @cached_property
    def lattice(self) -> BelievedLattice:
        """Image centres that the decoder believes in.

        Calibrated, it is affine: the image centres of microlenses at +-`reach` on both axes of the array, as a white
        image shows them.
        """
        if not self.calibrated:
            pitch = float(microlens_image_pitch(self.nominal) / self.nominal.q)
            return BelievedLattice(0.0, 0.0, pitch, 0.0, 0.0, pitch)
        ends = ((self.reach, 0.0), (-self.reach, 0.0), (0.0, self.reach), (0.0, -self.reach))
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = (self._chief_pixel(x, y) for x, y in ends)
        step = self.camera.d / (2 * self.reach)
        columns = (x0 - x1) * step, (x2 - x3) * step, (y0 - y1) * step, (y2 - y3) * step
        return BelievedLattice((x0 + x1) / 2, (y0 + y1) / 2, *columns)

    def _chief_pixel(self, x: Number, y: Number) -> tuple[Number, Number]:
        u, v = self.camera.chief_point(x, y)
        return u / self.camera.q, v / self.camera.q

    @cached_property
    def centre_error(self) -> tuple[Number, Number]:
        """Image centres less where the decoder believes them [px]."""
        c, (x, y) = self.camera, self.chief
        u, v = self.lattice.centre(self.x / c.d, self.y / c.d)
        return x / c.q - u, y / c.q - v

    @property
    def centre_error_x_px(self) -> Number:
        """Along x."""
        return self.centre_error[0]

    @property
    def centre_error_y_px(self) -> Number:
        """Along y."""
        return self.centre_error[1]

    @property
    def centre_error_px(self) -> Number:
        """The distance."""
        return np.hypot(*self.centre_error)

    @cached_property
    def depth_error_mm(self) -> Number:
        """Decoded depth less true depth of the targets [mm].

        Calibrated, depth follows from targets on the axis at three known distances: 1/depth and slope are related by a
        fractional linear map, which three pairs fix, whatever f, d_1, d_2 and d_3 really are.
        """
        slope, n = self._slope(self.targets), self.nominal
        depth: Number
        if not self.calibrated:  # Eq. 12, solved for the depth
            m, reach = n.d_1 / n.d_f, n.d_1 * (n.d_f - n.d_3) / n.d_f
            depth = 1 / ((m * reach - slope * (n.d * n.d_2 / n.q)) / (reach * reach)) + n.d_3
        else:
            zero, one = np.zeros((1, 1)), np.ones((1, 1))
            known = [self._slope(Targets(zero, zero, z, (one, zero))) for z in self.calibration_depths]
            depth = fractional(slope, known, self.calibration_depths)
        return depth - self.object_distance

    def _slope(self, targets: Targets) -> Number:
        """Slope between the two rays through the FAP's ends, as the decoder computes it [microlenses per pixel]."""
        cos, sin = targets.azimuth
        ends = []
        for sign in (1.0, -1.0):
            x, y, u, v = self._landing(targets, sign * cos, sign * sin)
            s, t = self.lattice.centre(u, v)
            ends.append((minus(x, s), minus(y, t), u, v))
        ds, dt, du, dv = (minus(a, b) for a, b in zip(*ends, strict=True))
        return plus(times(du, cos), times(dv, sin)) / plus(times(ds, cos), times(dt, sin))

    @cached_property
    def blur_pitches(self) -> Number:
        """Root-mean-square radius on the array of the targets' light, of rays that fill the FAP [microlens pitches]."""
        points = [self._landing(self.targets, rho * np.cos(a), rho * np.sin(a)) for rho, a, _ in DISC_RULE]
        weight = np.array([share for *_, share in DISC_RULE])[:, None, None]
        total: Number = 0.0
        for axis in (2, 3):
            at = np.stack(np.broadcast_arrays(*(point[axis] for point in points)))
            total = total + np.sum(weight * (at - np.sum(weight * at, axis=0)) ** 2, axis=0)
        return np.sqrt(total)

    def _landing(self, targets: Targets, a: Array | float, b: Array | float) -> tuple[Number, Number, Number, Number]:
        """Pixel (x, y) [pixels] and microlens (u, v) [indices] that targets reach through a point of the FAP.

        The point is given in units of the FAP's radius, in its own coordinates.
        """
        c, fap, world = self.camera, self.camera.pose("aperture"), self.camera.world
        at = along(world.origin, targets.x, world.x, targets.y, world.y)
        px, py, pz = along(at, -targets.distance, world.z, 0.0, world.z)
        ax, ay, az = along(fap.origin, times(c.fap.radius, a), fap.x, times(c.fap.radius, b), fap.y)
        span = minus(pz, az)
        lx, ly = (times(ax, pz) - times(px, az)) / span, (times(ay, pz) - times(py, az)) / span
        ray: Vector = ((px - lx) / pz - lx / c.f, (py - ly) / pz - ly / c.f, 1.0)
        met: list[Number] = []
        for element in (c.pose("microlens_array"), c.pose("sensor")):
            offset: Vector = (minus(lx, element.origin[0]), minus(ly, element.origin[1]), minus(0.0, element.origin[2]))
            hit = along(offset, -dot(element.z, offset) / dot(element.z, ray), ray, 0.0, ray)
            met += [dot(element.x, hit), dot(element.y, hit)]
        u, v, x, y = met
        return x / c.q, y / c.q, u / c.d, v / c.d


def fractional(x: Number, known: Sequence[Number], images: Sequence[Number]) -> Number:
    """The fractional linear map that takes three known numbers to their images, at `x`."""
    (x0, x1, x2), (y0, y1, y2) = known, images
    # Equal cross-ratios (y - y1)(y0 - y2)/((y - y2)(y0 - y1)) of both: 0 at the middle one, exactly.
    cross = (x - x1) / (x - x2) * ((x0 - x2) / (x0 - x1)) * ((y0 - y1) / (y0 - y2))
    return y1 + cross * (y1 - y2) / (1 - cross)
