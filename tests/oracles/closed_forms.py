"""Closed forms found again at 60 digits by tracing rays, one oracle of the same name and keywords for each.

Nothing here knows the formulas of `roslf_design.theory`. A camera is four planes, and its only laws are: a ray is
straight; the main lens bends it by its height over f; a pinhole microlens passes the ray through its centre. Quantities
are read off traced rays; unknown rays and matched lengths are found from two tries, everything being affine.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mpmath as mp

DIGITS = 60
ORACLES: dict[str, Callable[..., Any]] = {}


def traced(function: Callable[..., Any]) -> Callable[..., Any]:
    """Run at 60 digits on exact conversions of the floats given."""

    @functools.wraps(function)
    def at_many_digits(**arguments: Any) -> Any:
        with mp.workdps(DIGITS):
            return function(**{name: exactly(value) for name, value in arguments.items()})

    return at_many_digits


def oracle(function: Callable[..., Any]) -> Callable[..., Any]:
    """`traced`, and registered under its own name, which is that of a closed form."""
    ORACLES[function.__name__] = traced(function)
    return ORACLES[function.__name__]


def exactly(value: Any) -> Any:
    if isinstance(value, bool | mp.mpf):
        return value
    if isinstance(value, tuple | list):
        return tuple(exactly(part) for part in value)
    return mp.mpf(float(value))


def keywords(name: str) -> tuple[str, ...]:
    """Arguments of an oracle."""
    return tuple(inspect.signature(ORACLES[name]).parameters)


def flat(value: Any) -> list[mp.mpf]:
    """Numbers of a result, whatever its nesting."""
    return [part for item in value for part in flat(item)] if isinstance(value, tuple | list) else [value]


class Judged(NamedTuple):
    """One number of a result against its oracle."""

    exact: mp.mpf
    ulps: float
    """Error in units of the exact value's last place."""
    condition: float
    """Sum over the arguments of |x df/dx / f|."""


def judge(compute: Callable[..., Any], got: Any, arguments: Mapping[str, Any], enough: float = 0.0) -> list[Judged]:
    """Errors against an oracle, and condition numbers, of every number that a closed form returned.

    Numbers within `enough` ulps are not asked for their condition (it is told as 0), which takes most of the time.
    """
    exact = flat(compute(**arguments))
    with mp.workdps(DIGITS):
        errors = [ulps_off(value, truth) for value, truth in zip(got, exact, strict=True)]
        if max(errors) <= enough:
            return [Judged(truth, error, 0.0) for truth, error in zip(exact, errors, strict=True)]
        moved = movement(compute, arguments, len(exact))
        result = []
        for value, truth, error, move in zip(got, exact, errors, moved, strict=True):
            if truth == 0 and move > 0:  # a difference of equal terms: judged by the terms
                result.append(Judged(truth, float(abs(mp.mpf(float(value))) / last_place(move)), 1.0))
            else:
                result.append(Judged(truth, error, float(move / abs(truth)) if truth != 0 else 0.0))
        return result


def ulps_off(value: Any, truth: Any) -> float:
    if isinstance(truth, bool) or mp.isinf(truth):
        return 0.0 if value == truth else float("inf")
    error = abs(mp.mpf(float(value)) - truth)
    if error == 0:
        return 0.0
    return float(error / last_place(truth)) if truth != 0 else float("inf")


def last_place(value: mp.mpf) -> mp.mpf:
    return mp.ldexp(1, int(mp.floor(mp.log(abs(value), 2))) - 52)


def movement(compute: Callable[..., Any], arguments: Mapping[str, Any], count: int) -> list[mp.mpf]:
    """Sum over the arguments of |x df/dx|, by central differences."""
    step = mp.mpf(10) ** -20
    moved = [mp.mpf(0)] * count
    for nudged in nudges(arguments, step):
        up, down = (flat(compute(**side)) for side in nudged)
        for i, (u, v) in enumerate(zip(up, down, strict=True)):
            if not isinstance(u, bool):
                moved[i] += mp.inf if mp.isinf(u) or mp.isinf(v) else abs(u - v) / (2 * step)
    return moved


def nudges(arguments: Mapping[str, Any], step: mp.mpf) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Pairs of argument sets with one number moved up and down by a relative step."""
    pairs = []
    for name, value in arguments.items():
        if isinstance(value, bool):
            continue
        parts = value if isinstance(value, tuple) else (value,)
        for i, part in enumerate(parts):
            if part == 0:
                continue
            sides = []
            for sign in (1, -1):
                moved: Any = exactly(part) * (1 + sign * step)
                changed = (*exactly(parts[:i]), moved, *exactly(parts[i + 1 :])) if isinstance(value, tuple) else moved
                sides.append({**arguments, name: changed})
            pairs.append((sides[0], sides[1]))
    return pairs


# --- the camera -------------------------------------------------------------------------------------------------------


def affine_root(function: Callable[[mp.mpf], mp.mpf], target: Any = 0, tries: tuple[Any, Any] = (1, 2)) -> mp.mpf:
    """Where an affine function takes a value; inf where it never does."""
    a, b = (mp.mpf(t) for t in tries)
    at_a, at_b = function(a), function(b)
    if at_a == at_b:
        return mp.inf
    return a + (target - at_a) * (b - a) / (at_b - at_a)


class Camera(NamedTuple):
    """Lens at z = 0, array at d_1; tilts and heights paraxial."""

    f: mp.mpf
    d_1: mp.mpf

    @classmethod
    def focused_at(cls, f: mp.mpf, d_f: mp.mpf) -> Camera:
        """Array where a ray from the focal plane's axis point comes back to the axis."""
        height, slope = d_f, 1 - d_f / f
        return cls(f, -height / slope)

    def height(self, sensor: Any, microlens: Any, d_2: Any, z: Any) -> mp.mpf:
        """Height at z before the lens of the ray from a sensor point back through a microlens's centre."""
        slope = (sensor - microlens) / d_2
        lens = microlens - slope * self.d_1
        return lens - (slope + lens / self.f) * z

    def landing(self, microlens: Any, d_2: Any, z: Any, height: Any) -> mp.mpf:
        """Sensor point that sees `height` at z through that microlens."""
        return affine_root(lambda p: self.height(p, microlens, d_2, z), height)

    def pitch(self, d: Any, d_2: Any, d_3: Any) -> mp.mpf:
        return self.landing(d, d_2, d_3, 0) - self.landing(0, d_2, d_3, 0)

    def diameter(self, D_F: Any, d_2: Any, d_3: Any) -> mp.mpf:
        return self.landing(0, d_2, d_3, -D_F / 2) - self.landing(0, d_2, d_3, D_F / 2)

    def reach(self, d_3: Any) -> mp.mpf:
        """A: height on the FAP over the slope with which that ray comes to the array's centre."""
        return self.height(-1, 0, 1, d_3)

    def seen(self, X: Any, Z_F: Any, d_3: Any, pupil: Any) -> tuple[mp.mpf, mp.mpf]:
        """Where on the array, and how steeply, arrives the ray from a scene point through a pupil point."""
        tilt = (pupil - X) / Z_F
        lens = pupil + tilt * d_3
        slope = tilt - lens / self.f
        return lens + slope * self.d_1, slope


# --- main lens --------------------------------------------------------------------------------------------------------


@oracle
def mla_distance(focal_length, focal_plane_distance):
    return Camera.focused_at(focal_length, focal_plane_distance).d_1


@oracle
def focal_plane_distance(focal_length, mla_distance):
    return Camera.focused_at(focal_length, mla_distance).d_1


@oracle
def focal_length(focal_plane_distance, mla_distance):
    power = affine_root(lambda p: focal_plane_distance + (1 - p * focal_plane_distance) * mla_distance)
    return 1 / power


@oracle
def mla_excess(focal_length, focal_plane_distance):
    return Camera.focused_at(focal_length, focal_plane_distance).d_1 - focal_length


@oracle
def magnification(focal_length, focal_plane_distance):
    return Camera.focused_at(focal_length, focal_plane_distance).d_1 / focal_plane_distance


@oracle
def inverse_magnification(focal_length, focal_plane_distance):
    return focal_plane_distance / Camera.focused_at(focal_length, focal_plane_distance).d_1


@oracle
def conjugate_residual(focal_length, focal_plane_distance, mla_distance):
    """How far from the axis the ray from the axial object point meets the array, over what it needs to be."""
    height = focal_plane_distance + (1 - focal_plane_distance / focal_length) * mla_distance
    return height * focal_length / (focal_plane_distance * mla_distance)


@oracle
def gap(focal_plane_distance, pupil_distance):
    return focal_plane_distance - pupil_distance


@oracle
def aperture_constant(focal_plane_distance, pupil_distance):
    """Height on the lens over height on the FAP of a ray from the focal plane's axis point."""
    slope = 1 / (focal_plane_distance - pupil_distance)
    return focal_plane_distance * slope


@oracle
def inverse_aperture_constant(focal_plane_distance, pupil_distance):
    slope = 1 / focal_plane_distance
    return (focal_plane_distance - pupil_distance) * slope


@oracle
def effective_image_distance(focal_length, focal_plane_distance, pupil_distance):
    return Camera.focused_at(focal_length, focal_plane_distance).reach(pupil_distance)


@oracle
def effective_image_distance_from_magnification(focal_length, magnification, pupil_distance):
    return Camera(focal_length, focal_length * (1 + magnification)).reach(pupil_distance)


@oracle
def pupil_angle(pupil_diameter, focal_length, focal_plane_distance, pupil_distance):
    return pupil_diameter / Camera.focused_at(focal_length, focal_plane_distance).reach(pupil_distance)


# --- pupils -----------------------------------------------------------------------------------------------------------


def exit_pupil(f, d_3):
    """Distance behind the lens and height of the image of a FAP point at height 1, where two of its rays meet."""
    heights = 1, 1 + d_3
    slopes = -1, f - (1 + d_3)  # times f, so that parallel rays are exactly parallel
    if slopes[0] == slopes[1]:
        return mp.inf, mp.inf
    where = (heights[1] - heights[0]) / (slopes[0] - slopes[1])
    return where * f, heights[0] + where * slopes[0]


@oracle
def exit_pupil_distance(focal_length, pupil_distance):
    return exit_pupil(focal_length, pupil_distance)[0]


@oracle
def exit_pupil_diameter(pupil_diameter, focal_length, pupil_distance):
    return abs(exit_pupil(focal_length, pupil_distance)[1]) * pupil_diameter


@oracle
def exit_pupil_vergence(focal_length, focal_plane_distance, pupil_distance):
    """Slope of a chief ray on the array over its height there."""
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return camera.landing(1, 1, pupil_distance, 0) - 1


@oracle
def microlens_image_pitch(microlens_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return camera.pitch(microlens_pitch, sensor_distance, pupil_distance)


@oracle
def microlens_image_diameter(pupil_diameter, sensor_distance, focal_length, focal_plane_distance, pupil_distance):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return camera.diameter(pupil_diameter, sensor_distance, pupil_distance)


@oracle
def centre_shift_per_microlens(
    microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    traditional = camera.landing(microlens_pitch, sensor_distance, 0, 0)
    return (traditional - camera.landing(microlens_pitch, sensor_distance, pupil_distance, 0)) / pixel_pitch


@oracle
def centre_deviation(
    index, microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    c = index * microlens_pitch
    traditional = camera.landing(c, sensor_distance, 0, 0)
    return (traditional - camera.landing(c, sensor_distance, pupil_distance, 0)) / pixel_pitch


# --- matching ---------------------------------------------------------------------------------------------------------


@oracle
def microlens_f_number(sensor_distance, microlens_pitch):
    return sensor_distance / microlens_pitch


@oracle
def microlens_angle(sensor_distance, microlens_pitch):
    return microlens_pitch / sensor_distance


@oracle
def pupil_f_number(pupil_diameter, focal_length, focal_plane_distance, pupil_distance):
    return Camera.focused_at(focal_length, focal_plane_distance).reach(pupil_distance) / pupil_diameter


@oracle
def main_lens_f_number(lens_diameter, mla_distance):
    return mla_distance / lens_diameter


@oracle
def fill_factor(pupil_diameter, microlens_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    diameter = camera.diameter(pupil_diameter, sensor_distance, pupil_distance)
    return diameter / camera.pitch(microlens_pitch, sensor_distance, pupil_distance)


@oracle
def approximate_fill_factor(
    pupil_diameter, microlens_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return camera.diameter(pupil_diameter, sensor_distance, pupil_distance) / microlens_pitch


@oracle
def traditional_fill_factor(lens_diameter, microlens_pitch, sensor_distance, mla_distance):
    camera = Camera(mla_distance, mla_distance)  # any focal length: the pupil is at the lens
    return camera.diameter(lens_diameter, sensor_distance, 0) / microlens_pitch


@oracle
def matching_mismatch(
    pupil_diameter, microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    diameter = camera.diameter(pupil_diameter, sensor_distance, pupil_distance)
    return (diameter - camera.pitch(microlens_pitch, sensor_distance, pupil_distance)) / pixel_pitch


@oracle
def matching_residual(
    pupil_diameter, microlens_pitch, sensor_distance, mla_distance, focal_plane_distance, pupil_distance
):
    """Eq. 7 as printed, times d_f - d_3 (the five lengths need no lens between them)."""
    d, d_1, d_f, d_3 = microlens_pitch, mla_distance, focal_plane_distance, pupil_distance
    left = (d_1 * pupil_diameter + d_3 * d) / ((d_f - d_3) * d * d_1)
    right = (d_1 + sensor_distance) / (sensor_distance * d_f)
    return (left - right) * (d_f - d_3)


def matched(unmatched: Callable[[mp.mpf], mp.mpf], tries: tuple[Any, Any] = (1, 2)) -> tuple[mp.mpf, bool]:
    value = affine_root(unmatched, 0, tries)
    exists = bool(0 < value < mp.inf)
    return (value if exists else mp.inf), exists


def excess(camera: Camera, D_F: Any, d: Any, d_2: Any, d_3: Any, exact: bool) -> mp.mpf:
    return camera.diameter(D_F, d_2, d_3) - (camera.pitch(d, d_2, d_3) if exact else d)


@oracle
def matched_sensor_distance(
    pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance, exact=True
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return matched(lambda d_2: excess(camera, pupil_diameter, microlens_pitch, d_2, pupil_distance, exact))


@oracle
def matched_pupil_diameter(
    microlens_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance, exact=True
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return matched(lambda D_F: excess(camera, D_F, microlens_pitch, sensor_distance, pupil_distance, exact))


@oracle
def matched_microlens_pitch(
    pupil_diameter, sensor_distance, focal_length, focal_plane_distance, pupil_distance, exact=True
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return matched(lambda d: excess(camera, pupil_diameter, d, sensor_distance, pupil_distance, exact))


@oracle
def matched_pupil_distance(
    pupil_diameter, microlens_pitch, sensor_distance, focal_length, focal_plane_distance, exact=True
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)

    def cleared(d_3: mp.mpf) -> mp.mpf:
        unmatched = excess(camera, pupil_diameter, microlens_pitch, sensor_distance, d_3, exact)
        return unmatched * (focal_plane_distance - d_3)

    value = affine_root(cleared, 0, (0, focal_plane_distance / 2))
    exists = 0 <= float(value) < float(focal_plane_distance)  # one that rounds to d_f is no design
    return (value if exists else mp.inf), exists


# --- field and stops --------------------------------------------------------------------------------------------------


@oracle
def nondistortion_margin(lens_diameter, pupil_diameter, pupil_distance, distance, radius):
    """Room between the pencil's outermost ray and the lens's rim, in diameter, times Z - d_3."""
    edge = -pupil_diameter / 2  # the far edge of the pupil makes the outer ray of a point at a positive height
    x = abs(radius)
    outermost = abs(x + (edge - x) / (distance - pupil_distance) * distance)
    return (lens_diameter - 2 * outermost) * (distance - pupil_distance)


@oracle
def nondistortion_bound(lens_diameter, pupil_diameter, pupil_distance, distance, focal_length, focal_plane_distance):
    """Field point whose pencil's outermost ray meets the rim, and where its chief ray meets the array."""
    depth = distance - pupil_distance

    def outermost(x: mp.mpf) -> mp.mpf:
        return (pupil_diameter / 2 + x) / depth * distance - x

    if outermost(mp.mpf(0)) > lens_diameter / 2:
        return mp.mpf(0), mp.mpf(0)
    if pupil_distance == 0:  # the pencil covers the same disc whatever the field point
        return mp.inf, mp.inf
    radius = affine_root(outermost, lens_diameter / 2)
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return radius, abs(camera.seen(radius, depth, pupil_distance, 0)[0])


@oracle
def stop_margin(
    stop_diameter, stop_distance, pupil_diameter, pupil_distance, distance, point, stop_decentre, pupil_decentre
):
    """Room of the pencil's ray farthest from the stop's centre, in diameter, times Z - d_3."""

    def on_stop(pupil_point: list[mp.mpf]) -> list[mp.mpf]:
        share = (distance - stop_distance) / (distance - pupil_distance)
        return [x + (a - x) * share for x, a in zip(point, pupil_point, strict=True)]

    centre = [a - e for a, e in zip(on_stop(list(pupil_decentre)), stop_decentre, strict=True)]
    length = mp.hypot(*centre)
    direction = [part / length for part in centre] if length else [mp.mpf(1), mp.mpf(0)]
    rim = [e + pupil_diameter / 2 * n for e, n in zip(pupil_decentre, direction, strict=True)]
    farthest = mp.hypot(*[a - e for a, e in zip(on_stop(rim), stop_decentre, strict=True)])
    return (stop_diameter - 2 * farthest) * (distance - pupil_distance)


@oracle
def stop_disc(
    stop_diameter,
    stop_distance,
    microlens_centre,
    sensor_distance,
    focal_length,
    focal_plane_distance,
    stop_decentre,
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    rim = stop_diameter / 2
    radius = camera.landing(0, sensor_distance, stop_distance, -rim) - camera.landing(
        0, sensor_distance, stop_distance, 0
    )
    centre = tuple(
        camera.landing(c, sensor_distance, stop_distance, e)
        for c, e in zip(microlens_centre, stop_decentre, strict=True)
    )
    return radius, centre


# --- decoding and epipolar-plane images -------------------------------------------------------------------------------


@oracle
def pixel_to_pupil(pixel, pixel_pitch, sensor_distance, effective_image_distance, centre):
    camera = Camera(mp.mpf(100), mp.mpf(140))
    d_3 = affine_root(camera.reach, effective_image_distance)
    return camera.height(pixel_pitch * (pixel - centre), 0, sensor_distance, d_3)


@oracle
def pupil_to_pixel(coordinate, pixel_pitch, sensor_distance, effective_image_distance, centre):
    camera = Camera(mp.mpf(100), mp.mpf(140))
    d_3 = affine_root(camera.reach, effective_image_distance)
    return centre + camera.landing(0, sensor_distance, d_3, coordinate) / pixel_pitch


@oracle
def pixel_to_lens(pixel, pixel_pitch, sensor_distance, mla_distance, centre):
    return Camera(mp.mpf(100), mla_distance).height(pixel_pitch * (pixel - centre), 0, sensor_distance, 0)


@oracle
def view_baseline(pixel_pitch, sensor_distance, effective_image_distance):
    camera = Camera(mp.mpf(100), mp.mpf(140))
    d_3 = affine_root(camera.reach, effective_image_distance)
    return camera.height(0, 0, sensor_distance, d_3) - camera.height(pixel_pitch, 0, sensor_distance, d_3)


def move_of_image(camera: Camera, d_3: Any, Z_F: Any, view: Any) -> mp.mpf:
    """How far on the array the ray of one scene point (on axis) moves from the pupil's centre to a pupil point."""
    return camera.seen(0, Z_F, d_3, view)[0] - camera.seen(0, Z_F, d_3, 0)[0]


@oracle
def pupil_shear(depth, focal_length, focal_plane_distance, pupil_distance):
    return -move_of_image(Camera.focused_at(focal_length, focal_plane_distance), pupil_distance, depth, 1)


@oracle
def epi_slope(depth, microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    view = camera.height(pixel_pitch, 0, sensor_distance, pupil_distance)
    return move_of_image(camera, pupil_distance, depth, view) / microlens_pitch


@oracle
def epi_inverse_slope(
    depth, microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    view = affine_root(lambda S: move_of_image(camera, pupil_distance, depth, S), microlens_pitch)
    return camera.landing(0, sensor_distance, pupil_distance, view) / pixel_pitch


def calibrated(A: mp.mpf, m: mp.mpf) -> tuple[Camera, mp.mpf]:
    """A camera of magnification m and the FAP distance that gives it A; its focal length does not matter."""
    camera = Camera(mp.mpf(100), 100 * (1 + m))
    return camera, affine_root(camera.reach, A, (0, 1))


@oracle
def calibrated_epi_slope(depth, effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance):
    camera, d_3 = calibrated(effective_image_distance, magnification)
    view = camera.height(pixel_pitch, 0, sensor_distance, d_3)
    return move_of_image(camera, d_3, depth, view) / microlens_pitch


@oracle
def inverse_depth_from_epi_slope(
    slope, effective_image_distance, magnification, microlens_pitch, pixel_pitch, sensor_distance
):
    camera, d_3 = calibrated(effective_image_distance, magnification)
    view = camera.height(pixel_pitch, 0, sensor_distance, d_3)
    return affine_root(lambda v: move_of_image(camera, d_3, 1 / v, view) / microlens_pitch, slope)


# --- depth, sampling, diffraction -------------------------------------------------------------------------------------


@oracle
def rim_disparity(depth, pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    rims = [move_of_image(camera, pupil_distance, depth, side * pupil_diameter / 2) for side in (1, -1)]
    return (rims[0] - rims[1]) / microlens_pitch


@oracle
def defocus_blur(depth, pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    rims = [camera.seen(0, depth, pupil_distance, side * pupil_diameter / 2)[0] for side in (1, -1)]
    return abs(rims[0] - rims[1]) / microlens_pitch


def disparity_per_inverse_depth(D_F, d, f, d_f, d_3):
    camera = Camera.focused_at(f, d_f)

    def disparity(inverse: mp.mpf) -> mp.mpf:
        return move_of_image(camera, d_3, 1 / inverse, D_F) / d

    return disparity(mp.mpf(2)) - disparity(mp.mpf(1))


@oracle
def disparity_rate(depth, pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance):
    rate = disparity_per_inverse_depth(
        pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance
    )
    return rate / depth**2


@oracle
def depth_sigma(
    disparity_sigma, depth, pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance
):
    rate = disparity_per_inverse_depth(
        pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance
    )
    return disparity_sigma * depth**2 / rate


@oracle
def inverse_depth_sigma(
    disparity_sigma, pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance
):
    rate = disparity_per_inverse_depth(
        pupil_diameter, microlens_pitch, focal_length, focal_plane_distance, pupil_distance
    )
    return disparity_sigma / rate


@oracle
def geometric_views(pupil_diameter, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return camera.diameter(pupil_diameter, sensor_distance, pupil_distance) / pixel_pitch


@oracle
def lateral_samples(width, microlens_pitch):
    return width / microlens_pitch


@oracle
def object_sample(microlens_pitch, focal_length, focal_plane_distance):
    """Height on the focal plane whose ray through the lens's centre meets the array a pitch off axis."""
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return microlens_pitch * focal_plane_distance / camera.d_1


@oracle
def phase_space_limit(pupil_diameter, field_radius, depth, wavelength):
    return 2 * pupil_diameter * mp.sin(mp.atan2(field_radius, depth)) / wavelength


@oracle
def fresnel_number(microlens_pitch, sensor_distance, wavelength):
    """Half waves of path (paraxial) by which the aperture's edge is farther from the sensor's centre."""
    return 2 * ((microlens_pitch / 2) ** 2 / (2 * sensor_distance)) / wavelength


@oracle
def independent_views(microlens_pitch, sensor_distance, wavelength):
    """Width of a microlens's share of the sensor over its blur."""
    return microlens_pitch / (sensor_distance * (wavelength / microlens_pitch))


@oracle
def diffraction_width(microlens_pitch, sensor_distance, wavelength):
    return sensor_distance * (wavelength / microlens_pitch)


@oracle
def airy_radius(microlens_pitch, sensor_distance, wavelength):
    return mp.mpf(122) / 100 * sensor_distance * (wavelength / microlens_pitch)


@oracle
def pupil_airy_radius(pupil_diameter, effective_image_distance, wavelength):
    return mp.mpf(122) / 100 * effective_image_distance * (wavelength / pupil_diameter)


@oracle
def microlens_defocus_waves(microlens_focal_length, sensor_distance, exit_pupil_vergence, microlens_pitch, wavelength):
    """Sags of the arriving wave, the microlens and the wave that would focus on the sensor, at the edge."""
    square = (microlens_pitch / 2) ** 2 / 2
    return abs(square / microlens_focal_length - square / sensor_distance - square * exit_pupil_vergence) / wavelength


@oracle
def microlens_defocus_blur(microlens_focal_length, sensor_distance, exit_pupil_vergence, microlens_pitch):
    """Where rays from the exit pupil's centre through both edges of the microlens land."""
    edges = []
    for w in (microlens_pitch / 2, -microlens_pitch / 2):
        slope = w * exit_pupil_vergence - w / microlens_focal_length
        edges.append(w + slope * sensor_distance)
    return abs(edges[0] - edges[1])


# --- calibration ------------------------------------------------------------------------------------------------------


@oracle
def back_substitute(focal_length, effective_image_distance, magnification):
    """The camera that shows A and m: d_1 and d_3 from two tries each, d_f and H from rays."""
    d_1 = affine_root(lambda d: d - focal_length, magnification * focal_length)
    d_f = Camera.focused_at(focal_length, d_1).d_1
    d_3 = affine_root(Camera(focal_length, d_1).reach, effective_image_distance, (0, 1))
    return d_1, d_f, d_f / (d_f - d_3), d_3, (d_f - d_3) / d_f


@oracle
def back_substitution_jacobian(focal_length, effective_image_distance, magnification):
    step = mp.mpf(10) ** -25
    base = {
        "focal_length": focal_length,
        "effective_image_distance": effective_image_distance,
        "magnification": magnification,
    }
    columns = []
    for name, value in base.items():
        up, down = (back_substitute(**{**base, name: value * (1 + side * step)})[:4] for side in (1, -1))
        columns.append([(u - v) / (2 * step * value) for u, v in zip(up, down, strict=True)])
    return tuple(tuple(column[row] for column in columns) for row in range(4))


# --- projection -------------------------------------------------------------------------------------------------------


def pupil_point(camera: Camera, d_3: Any, q: Any, d_2: Any, pixel: Any) -> mp.mpf:
    """FAP coordinate that a pixel, counted from its image's centre, sees through a microlens on axis."""
    return camera.height(q * pixel, 0, d_2, d_3)


@traced
def microlens_of(X, Z_F, pixel, centre, A, m, d, q, d_2, u_0):
    """Microlens index u where a scene point is seen in view s'."""
    camera, d_3 = calibrated(A, m)
    arrival, _ = camera.seen(X, Z_F, d_3, pupil_point(camera, d_3, q, d_2, pixel - centre))
    return u_0 + arrival / d


@traced
def pixel_of(X, Z_F, microlens, centre, A, m, d, q, d_2, u_0):
    """Pixel s' of a microlens that sees a scene point."""
    camera, d_3 = calibrated(A, m)
    c = d * (microlens - u_0)
    pupil = affine_root(lambda S: camera.seen(X, Z_F, d_3, S)[0], c)
    return centre + (camera.landing(c, d_2, d_3, pupil) - camera.landing(c, d_2, d_3, 0)) / q


@traced
def ray_of(pixel, microlens, centre, A, m, d, q, d_2, u_0):
    """FAP coordinate and slope by depth of the ray that a pixel of a microlens receives."""
    camera, d_3 = calibrated(A, m)
    c = d * (microlens - u_0)
    sensor = camera.landing(c, d_2, d_3, 0) + q * (pixel - centre)
    at_pupil = camera.height(sensor, c, d_2, d_3)
    return at_pupil, camera.height(sensor, c, d_2, d_3 + 1) - at_pupil
