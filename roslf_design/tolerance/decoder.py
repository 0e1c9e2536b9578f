"""A decoder that believes in the nominal design, or in what a calibration told it, looking through a real build.

One object point, two rays through opposite ends of the flexible angular plane (FAP): each lands on some microlens and
some pixel. The decoder turns both into views by the lattice of image centres it believes in, takes the slope between
them (Eq. 12) and turns that into a depth by the design it believes in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..theory.epi import inverse_depth_from_epi_slope
from ..theory.pupils import microlens_image_pitch
from .algebra import Number, Vector, along, dot, minus, plus, times
from .camera import Camera
from .pencils import chief_point

Array = NDArray[np.float64]

CALIBRATION_DEPTHS = (0.8, 1.0, 1.25)
"""Depths at which a full calibration sees a target, in units of the object's gap to the FAP."""


class Lattice(NamedTuple):
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


class Belief(NamedTuple):
    """All that a decoder assumes."""

    lattice: Lattice
    slopes: tuple[Number, ...]
    """Slopes that the calibration saw at `depths`; empty for the nominal design."""
    depths: tuple[float, ...]
    """[mm from the main lens]."""


class Scene(NamedTuple):
    """Object points whose depth is asked for."""

    x: Array
    y: Array
    """Shape (fields, 1) [mm], in the system's axes."""
    distance: float
    """Z, in front of the main lens [mm]."""
    azimuth: tuple[Array, Array]
    """Unit vector of each field's direction, along which its views are taken; +x on the axis."""


def scene_for(design: Design, fields: Array, distance: float) -> Scene:
    """Object points that the nominal design's chief rays of some microlenses meet.

    Parameters
    ----------
    design : Design
        The nominal design, taken as aligned.
    fields : ndarray, shape (fields, 2)
        Microlens positions [mm].
    distance : float
        Z [mm].
    """
    x, y = fields[:, :1], fields[:, 1:]
    # Chief ray, per unit of c: on the lens at l = H d_3/d_1, slope (c - l)/d_1 behind the lens and l/f more before it.
    height = design.d_3 * design.d_f / ((design.d_f - design.d_3) * design.d_1)
    slope = (1 - height) / design.d_1 + height / design.f
    radius = np.hypot(x, y)
    off = radius > 0
    azimuth = np.where(off, x / np.where(off, radius, 1), 1.0), np.where(off, y / np.where(off, radius, 1), 0.0)
    stretch = height - slope * distance
    return Scene(x * stretch, y * stretch, distance, azimuth)


def nominal_belief(design: Design) -> Belief:
    """What a decoder believes that was given the nominal design."""
    p = design.parameters
    pitch = float(microlens_image_pitch(p.d, p.d_2, p.f, p.d_f, p.d_3)) / design.q
    return Belief(Lattice(0.0, 0.0, pitch, 0.0, 0.0, pitch), (), ())


def calibrated_belief(camera: Camera, design: Design, reach: float, scene: Scene) -> Belief:
    """What a decoder believes after a full calibration of each build.

    The lattice is affine: the image centres of microlenses at +-`reach` on both axes of the array, as a white image
    shows them. Depth follows from targets on the axis at three known distances: 1/(depth) and slope are related by a
    fractional linear map, which three pairs fix, whatever f, d_1, d_2 and d_3 really are.

    Parameters
    ----------
    camera : Camera
        The builds.
    design : Design
        The nominal design, for the targets' distances.
    reach : float
        Largest field radius [mm].
    scene : Scene
        Its distance is the middle target's.
    """
    ends = [chief_pixel(camera, x, y) for x, y in ((reach, 0.0), (-reach, 0.0), (0.0, reach), (0.0, -reach))]
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = ends
    step = camera.d / (2 * reach)
    lattice = Lattice(
        (x0 + x1) / 2, (y0 + y1) / 2, (x0 - x1) * step, (x2 - x3) * step, (y0 - y1) * step, (y2 - y3) * step
    )
    depths = tuple(design.d_3 + (scene.distance - design.d_3) * factor for factor in CALIBRATION_DEPTHS)
    zero, one = np.zeros((1, 1)), np.ones((1, 1))
    targets = [Scene(zero, zero, depth, (one, zero)) for depth in depths]
    return Belief(lattice, tuple(epi_slope_seen(camera, target, lattice) for target in targets), depths)


def chief_pixel(camera: Camera, x: Number, y: Number) -> tuple[Number, Number]:
    """Image centre of the microlens at (x, y) [pixels from the sensor's middle]."""
    u, v = chief_point(camera, camera.microlens(x, y))
    return u / camera.q, v / camera.q


def epi_slope_seen(camera: Camera, scene: Scene, lattice: Lattice) -> Number:
    """Slope between the two rays through the FAP's ends, as the decoder computes it [microlenses per pixel]."""
    cos, sin = scene.azimuth
    ends = []
    for sign in (1.0, -1.0):
        x, y, u, v = landing(camera, scene, sign * cos, sign * sin)
        s, t = lattice.centre(u, v)
        ends.append((minus(x, s), minus(y, t), u, v))
    ds, dt, du, dv = (minus(a, b) for a, b in zip(*ends, strict=True))
    views = plus(times(ds, cos), times(dt, sin))
    return plus(times(du, cos), times(dv, sin)) / views


def landing(camera: Camera, scene: Scene, a: Array | float, b: Array | float) -> tuple[Number, Number, Number, Number]:
    """Pixel (x, y) [pixels] and microlens (u, v) [indices] that a scene's points reach through a point of the FAP.

    The point is given in units of the FAP's radius, in its own coordinates.
    """
    rim = camera.rims[0]
    point = along(camera.world.origin, scene.x, camera.world.x, scene.y, camera.world.y)
    point = along(point, -scene.distance, camera.world.z, 0.0, camera.world.z)
    pupil = along(rim.pose.origin, times(rim.radius, a), rim.pose.x, times(rim.radius, b), rim.pose.y)
    return _land(camera, point, pupil)


def believed_depth(belief: Belief, design: Design, slope: Number) -> Number:
    """Distance Z from the main lens that a decoder reads off a slope [mm]."""
    if not belief.slopes:
        reach = design.d_1 * (design.d_f - design.d_3) / design.d_f
        inverse = inverse_depth_from_epi_slope(slope, reach, design.d_1 / design.d_f, design.d, design.q, design.d_2)
        return 1 / inverse + design.d_3
    return fractional(slope, belief.slopes, belief.depths)


def fractional(x: Number, known: Sequence[Number], images: Sequence[Number]) -> Number:
    """The fractional linear map that takes three known numbers to their images, at `x`."""
    (x0, x1, x2), (y0, y1, y2) = known, images
    # Equal cross-ratios (y - y1)(y0 - y2)/((y - y2)(y0 - y1)) of both: 0 at the middle one, exactly.
    cross = (x - x1) / (x - x2) * ((x0 - x2) / (x0 - x1)) * ((y0 - y1) / (y0 - y2))
    return y1 + cross * (y1 - y2) / (1 - cross)


def _land(camera: Camera, point: Vector, a: Vector) -> tuple[Number, Number, Number, Number]:
    """Pixel (x, y) [pixels] and microlens (u, v) [indices] that a ray through two object-space points lands on."""
    px, py, pz = point
    ax, ay, az = a
    span = minus(pz, az)
    lx, ly = (times(ax, pz) - times(px, az)) / span, (times(ay, pz) - times(py, az)) / span
    ray: Vector = ((px - lx) / pz - lx / camera.f, (py - ly) / pz - ly / camera.f, 1.0)
    found: list[Number] = []
    for element in (camera.array, camera.sensor):
        offset: Vector = (minus(lx, element.origin[0]), minus(ly, element.origin[1]), minus(0.0, element.origin[2]))
        t = -dot(element.z, offset) / dot(element.z, ray)
        hit = along(offset, t, ray, 0.0, ray)
        found += [dot(element.x, hit), dot(element.y, hit)]
    u, v, x, y = found
    return x / camera.q, y / camera.q, u / camera.d, v / camera.d
