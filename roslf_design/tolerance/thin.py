"""Builds behind an ideal lens: every metric that belongs to a field, over fields and trials, and their decoder.

The decoder believes in the nominal design, or in what a calibration told it, and looks through a real build. One object
point, two rays through opposite ends of the flexible angular plane (FAP): each lands on some microlens and some pixel.
The decoder turns both into views by the lattice of image centres it believes in, takes the slope between them (Eq. 12)
and turns that into a depth by the design it believes in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..microlens.discs import intersect
from ..microlens.ellipses import intersect_ellipses
from ..theory.epi import inverse_depth_from_epi_slope
from ..theory.pupils import microlens_image_pitch
from .algebra import Number, Vector, along, dot, minus, plus, times
from .camera import Camera
from .pencils import Ellipse, chief_point, rim_image, room

Array = NDArray[np.float64]

DISC_RULE = ((0.0, 0.0, 0.25), *((np.sqrt(2 / 3), k * np.pi / 3, 0.125) for k in range(6)))
"""Radius, angle and weight of points that average polynomials up to the fifth degree over the unit disc exactly."""
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


class ThinBuilds:
    """Builds behind an ideal lens; what several metrics share is computed when first asked for.

    Parameters
    ----------
    camera : Camera
        The builds.
    design : Design
        The nominal design.
    fields : sequence of (x, y)
        Microlens positions on the array [mm].
    object_distance : float
        Z of the decoder's target [mm].
    calibrated : bool
        Whether the decoder was calibrated on each build.
    """

    def __init__(
        self,
        camera: Camera,
        design: Design,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
    ) -> None:
        self.camera, self.design, self.calibrated = camera, design, calibrated
        self.fields, self.object_distance = np.array(fields, dtype=np.float64).reshape(-1, 2), object_distance
        self.x, self.y = self.fields[:, :1], self.fields[:, 1:]
        self.microlens = camera.microlens(self.x, self.y)
        self._kept: dict[str, Any] = {}

    def _once(self, key: str, make: Callable[[], Any]) -> Any:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def value(self, name: str) -> Any:
        """A metric, broadcasting to (fields, trials)."""
        return self._once(name, lambda: getattr(self, f"_{name}")())

    @property
    def image(self) -> Ellipse:
        """The FAP's image, as if nothing cut it."""
        rim = self.camera.rims[0]
        return self._once("image", lambda: rim_image(self.camera, rim, self.microlens).ellipse(rim.radius))  # type: ignore[no-any-return]

    @property
    def shapes(self) -> tuple[Array, Array, Array]:
        """Lit area [mm^2], kept fraction and axis ratio."""
        return self._once("shapes", self._shapes)  # type: ignore[no-any-return]

    @property
    def belief(self) -> Belief:
        """What the decoder assumes."""
        return self._once("belief", self._believe)  # type: ignore[no-any-return]

    @property
    def scene(self) -> Scene:
        """What it looks at."""
        return self._once("scene", lambda: scene_for(self.design, self.fields, self.object_distance))  # type: ignore[no-any-return]

    def _believe(self) -> Belief:
        design = self.design
        if not self.calibrated:
            return nominal_belief(design)
        reach = float(np.max(np.hypot(self.x, self.y))) or design.microlens_array.size[0] / 2
        return calibrated_belief(self.camera, design, reach, self.scene)

    def _image_diameter_mm(self) -> Any:
        return 2 * np.sqrt(np.sqrt(self.image.determinant))

    def _image_diameter_px(self) -> Any:
        return self.value("image_diameter_mm") / self.camera.q

    def _image_pitch_mm(self) -> Any:
        # Between the points half a pitch to either side: what mirrored builds share.
        camera, half = self.camera, self.camera.d / 2
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = (
            chief_point(camera, camera.microlens(self.x + a * half, self.y + b * half))
            for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))
        )
        return np.sqrt(np.abs((x1 - x0) * (y3 - y2) - (y1 - y0) * (x3 - x2)))

    def _fill_factor(self) -> Any:
        return self.value("image_diameter_mm") / self.value("image_pitch_mm")

    def _mismatch_px(self) -> Any:
        return (self.value("image_diameter_mm") - self.value("image_pitch_mm")) / self.camera.q

    def _non_distortion_room_mm(self) -> Any:
        return room(self.camera, self.microlens)

    def _centre_shift_px(self) -> Any:
        camera = self.camera
        x0, y0 = chief_point(camera, self.microlens)
        x1, y1 = rim_image(camera, camera.rims[1], self.microlens).centre
        cos, sin = self.scene.azimuth
        return ((x1 - x0) * cos + (y1 - y0) * sin) / camera.q

    def _shapes(self) -> tuple[Array, Array, Array]:
        camera = self.camera
        images = [rim_image(camera, rim, self.microlens).ellipse(rim.radius) for rim in camera.rims]
        shape = (len(self.fields), len(camera.valid))
        centres = np.stack([_spread([image.x, image.y], shape) for image in images], axis=-2)
        centres -= centres[..., :1, :]
        if camera.tilted:
            matrices = np.stack([_spread([image.xx, image.xy, image.yy], shape) for image in images], axis=-2)
            found = intersect_ellipses(centres, matrices)
        else:
            radii = np.stack([np.broadcast_to(np.sqrt(image.xx), shape) for image in images], axis=-1)
            found = intersect(centres, radii)
        return found.area, found.kept_fraction, np.where(found.lit, found.axis_ratio, np.nan)

    def _image_area_mm2(self) -> Any:
        return self.shapes[0]

    def _kept_fraction(self) -> Any:
        return self.shapes[1]

    def _axis_ratio(self) -> Any:
        return self.shapes[2]

    def _centre_error(self) -> tuple[Any, Any]:
        camera = self.camera
        x, y = chief_pixel(camera, self.x, self.y)
        believed = self.belief.lattice.centre(self.x / camera.d, self.y / camera.d)
        return x - believed[0], y - believed[1]

    def _centre_error_x_px(self) -> Any:
        return self._once("centre_error", self._centre_error)[0]

    def _centre_error_y_px(self) -> Any:
        return self._once("centre_error", self._centre_error)[1]

    def _centre_error_px(self) -> Any:
        return np.hypot(*self._once("centre_error", self._centre_error))

    def _blur_pitches(self) -> Any:
        found = [landing(self.camera, self.scene, rho * np.cos(a), rho * np.sin(a)) for rho, a, _ in DISC_RULE]
        u, v = (np.stack([point[axis] + 0 * self.camera.valid for point in found]) for axis in (2, 3))
        weight = np.array([share for *_, share in DISC_RULE])[:, None, None]
        off = [part - np.sum(weight * part, axis=0) for part in (u, v)]
        return np.sqrt(np.sum(weight * (off[0] ** 2 + off[1] ** 2), axis=0))

    def _depth_error_mm(self) -> Any:
        slope = epi_slope_seen(self.camera, self.scene, self.belief.lattice)
        return believed_depth(self.belief, self.design, slope) - self.scene.distance


def _spread(values: Sequence[Any], shape: tuple[int, int]) -> Array:
    return np.stack([np.broadcast_to(value, shape) for value in values], axis=-1)
