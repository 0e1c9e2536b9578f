"""Closed forms found again at 60 digits by tracing rays, one oracle of the same name and keywords for each.

Nothing here knows the formulas of `roslf_design.theory`. A camera is four planes, and its only laws are: a ray is
straight; the main lens bends it by its height over f; a pinhole microlens passes the ray through its centre. Quantities
are read off traced rays; unknown rays and matched lengths are found from two tries, everything being affine.

Oracles are written in the paper's symbols; `SYMBOLS` says which keyword each of them is.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath as mp

from .judging import flat, judge, traced

__all__ = ["ORACLES", "flat", "judge", "keywords", "microlens_of", "pixel_of", "ray_of"]

Form = Callable[..., Any]

SYMBOLS = {
    "f": "focal_length", "d_f": "focal_plane_distance", "d_1": "mla_distance", "d_3": "pupil_distance",
    "D_F": "pupil_diameter", "D": "lens_diameter", "d_2": "sensor_distance", "d": "microlens_pitch",
    "q": "pixel_pitch", "wave": "wavelength", "f_ml": "microlens_focal_length",
    "m": "magnification", "A": "effective_image_distance", "Z_F": "depth", "sigma": "disparity_sigma",
    "X": "radius", "D_k": "stop_diameter", "z_k": "stop_distance", "e_k": "stop_decentre", "c": "microlens_centre",
    "exact": "exact",
}  # fmt: skip
"""Keyword of each symbol."""


def by_keyword(form: Form) -> Form:
    """The same function of keywords instead of symbols."""
    symbol_of = {SYMBOLS[symbol]: symbol for symbol in inspect.signature(form).parameters}
    return lambda **given: form(**{symbol_of[key]: value for key, value in given.items()})


def affine_root(function: Form, target: Any = 0, tries: tuple[Any, Any] = (1, 2)) -> Any:
    """Where an affine function takes a value; inf where it never does."""
    a, b = (mp.mpf(t) for t in tries)
    at_a, at_b = function(a), function(b)
    return mp.inf if at_a == at_b else a + (target - at_a) * (b - a) / (at_b - at_a)


class Planes(NamedTuple):
    """A camera: lens at z = 0, array at d_1; tilts and heights paraxial."""

    f: Any
    d_1: Any

    def height(self, sensor: Any, microlens: Any, d_2: Any, z: Any) -> Any:
        """Height at z before the lens of the ray from a sensor point back through a microlens's centre."""
        slope = (sensor - microlens) / d_2
        lens = microlens - slope * self.d_1
        return lens - (slope + lens / self.f) * z

    def landing(self, microlens: Any, d_2: Any, z: Any, height: Any) -> Any:
        """Sensor point that sees `height` at z through that microlens."""
        return affine_root(lambda p: self.height(p, microlens, d_2, z), height)

    def pitch(self, d: Any, d_2: Any, d_3: Any) -> Any:
        """Of the microlens images."""
        return self.landing(d, d_2, d_3, 0) - self.landing(0, d_2, d_3, 0)

    def diameter(self, D_F: Any, d_2: Any, d_3: Any) -> Any:
        """Of a microlens image."""
        return self.landing(0, d_2, d_3, -D_F / 2) - self.landing(0, d_2, d_3, D_F / 2)

    def reach(self, d_3: Any) -> Any:
        """A: height on the FAP over the slope with which that ray comes to the array's centre."""
        return self.height(-1, 0, 1, d_3)

    def shift(self, c: Any, q: Any, d_2: Any, d_3: Any) -> Any:
        """Of a microlens image against that of a camera whose pupil is the lens, in pixels."""
        return (self.landing(c, d_2, 0, 0) - self.landing(c, d_2, d_3, 0)) / q

    def seen(self, X: Any, Z_F: Any, d_3: Any, pupil: Any) -> Any:
        """Where on the array arrives the ray from a scene point through a pupil point."""
        tilt = (pupil - X) / Z_F
        lens = pupil + tilt * d_3
        return lens + (tilt - lens / self.f) * self.d_1

    def move(self, d_3: Any, Z_F: Any, pupil: Any) -> Any:
        """How far on the array the ray of an axial point moves from the pupil's centre to a pupil point."""
        return self.seen(0, Z_F, d_3, pupil) - self.seen(0, Z_F, d_3, 0)


def _at(f: Any, d_f: Any) -> Planes:
    """Array where a ray from the focal plane's axis point comes back to the axis."""
    return Planes(f, -d_f / (1 - d_f / f))


def _calibrated(A: Any, m: Any) -> tuple[Planes, Any]:
    """A camera of magnification m and the FAP distance that gives it A; its focal length does not matter."""
    camera = Planes(mp.mpf(100), 100 * (1 + m))
    return camera, affine_root(camera.reach, A, (0, 1))


def _exit_pupil(f: Any, d_3: Any) -> tuple[Any, Any]:
    """Distance behind the lens and height of the image of a FAP point at height 1, where two of its rays meet."""
    heights = 1, 1 + d_3
    slopes = -1, f - (1 + d_3)  # times f, so that parallel rays are exactly parallel
    if slopes[0] == slopes[1]:
        return mp.inf, mp.inf
    where = (heights[1] - heights[0]) / (slopes[0] - slopes[1])
    return where * f, heights[0] + where * slopes[0]


def _residual(f: Any, d_f: Any, d_1: Any) -> Any:
    """How far from the axis the ray from the axial object point meets the array, over what it needs to be."""
    return (d_f + (1 - d_f / f) * d_1) * f / (d_f * d_1)


def _excess(camera: Planes, D_F: Any, d: Any, d_2: Any, d_3: Any, exact: bool) -> Any:
    return camera.diameter(D_F, d_2, d_3) - (camera.pitch(d, d_2, d_3) if exact else d)


def _matched(unmatched: Form, either_order: bool = False) -> tuple[Any, bool]:
    value = affine_root(unmatched)
    if either_order:  # a root below 0 is that of images in reversed order
        value = abs(value)
    return (value, True) if 0 < value < mp.inf else (mp.inf, False)


def _matched_pupil_distance(D_F: Any, d: Any, d_2: Any, f: Any, d_f: Any, exact: bool = True) -> Any:
    camera = _at(f, d_f)
    value = affine_root(lambda d_3: _excess(camera, D_F, d, d_2, d_3, exact) * (d_f - d_3), 0, (0, d_f / 2))
    # One that rounds to d_f is no design.
    return (value, True) if 0 <= float(value) < float(d_f) else (mp.inf, False)


def _disparity_per_inverse_depth(D_F: Any, d: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    camera = _at(f, d_f)
    return (camera.move(d_3, 1 / mp.mpf(2), D_F) - camera.move(d_3, mp.mpf(1), D_F)) / d


def _outermost(X: Any, D_F: Any, d_3: Any, d_f: Any) -> Any:
    """Height on the main lens of the outermost ray of a field point's pencil: from the far edge of the pupil."""
    return abs(X + (-D_F / 2 - X) / (d_f - d_3) * d_f)


def _undistorted_field(D: Any, D_F: Any, d_3: Any, f: Any, d_f: Any) -> Any:
    """Field point whose pencil's outermost ray meets the rim."""
    if _outermost(mp.mpf(0), D_F, d_3, d_f) > D / 2:
        return mp.mpf(0)
    return affine_root(lambda X: _outermost(X, D_F, d_3, d_f), D / 2)  # inf: the same disc whatever the field point


def _stop_disc(D_k: Any, z_k: Any, c: Any, d_2: Any, f: Any, d_f: Any, e_k: Any) -> Any:
    camera = _at(f, d_f)
    radius = camera.landing(0, d_2, z_k, -D_k / 2) - camera.landing(0, d_2, z_k, 0)
    return radius, tuple(camera.landing(x, d_2, z_k, e) for x, e in zip(c, e_k, strict=True))


def _defocus_blur(f_ml: Any, d_2: Any, d: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    """Where rays from the exit pupil's centre through both edges of the microlens land."""
    per_L = _at(f, d_f).landing(1, 1, d_3, 0) - 1
    edges = [w + (w * per_L - w / f_ml) * d_2 for w in (d / 2, -d / 2)]
    return abs(edges[0] - edges[1])


def _defocus_waves(f_ml: Any, d_2: Any, d: Any, wave: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    """Sags of the arriving wave, the microlens and the wave that would focus on the sensor, at the edge."""
    per_L = _at(f, d_f).landing(1, 1, d_3, 0) - 1
    square = (d / 2) ** 2 / 2
    return abs(square / f_ml - square / d_2 - square * per_L) / wave


def _back_substitute(f: Any, A: Any, m: Any) -> Any:
    """The camera that shows A and m: d_1 and d_3 from two tries each, d_f from rays, then H and 1/H."""
    d_1 = affine_root(lambda d: d - f, m * f)
    d_f = _at(f, d_1).d_1
    d_3 = affine_root(Planes(f, d_1).reach, A, (0, 1))
    return d_1, d_f, d_f / (d_f - d_3), d_3, (d_f - d_3) / d_f


TRACED: dict[str, Form] = {
    # main lens and pupils
    "mla_distance": lambda f, d_f: _at(f, d_f).d_1,
    "focal_plane_distance": lambda f, d_1: _at(f, d_1).d_1,
    "focal_length": lambda d_f, d_1: 1 / affine_root(lambda power: d_f + (1 - power * d_f) * d_1),
    "magnification": lambda f, d_f: _at(f, d_f).d_1 / d_f,
    "inverse_magnification": lambda f, d_f: d_f / _at(f, d_f).d_1,
    "conjugate_residual": _residual,
    "gap": lambda d_f, d_3: d_f - d_3,
    # Height on the lens over height on the FAP of a ray from the focal plane's axis point, and its inverse.
    "aperture_constant": lambda d_f, d_3: d_f * (1 / (d_f - d_3)),
    "inverse_aperture_constant": lambda d_f, d_3: (d_f - d_3) * (1 / d_f),
    "effective_image_distance": lambda f, d_f, d_3: _at(f, d_f).reach(d_3),
    "pupil_angle": lambda D_F, f, d_f, d_3: D_F / _at(f, d_f).reach(d_3),
    "exit_pupil_distance": lambda f, d_3: _exit_pupil(f, d_3)[0],
    "exit_pupil_diameter": lambda D_F, f, d_3: abs(_exit_pupil(f, d_3)[1]) * D_F,
    # Slope of a chief ray on the array over its height there.
    "vergence_at_mla_per_mm": lambda f, d_f, d_3: _at(f, d_f).landing(1, 1, d_3, 0) - 1,
    "image_pitch_mm": lambda d, d_2, f, d_f, d_3: _at(f, d_f).pitch(d, d_2, d_3),
    "image_diameter_mm": lambda D_F, d_2, f, d_f, d_3: _at(f, d_f).diameter(D_F, d_2, d_3),
    "centre_shift_px_per_microlens": lambda d, q, d_2, f, d_f, d_3: _at(f, d_f).shift(d, q, d_2, d_3),
    # matching
    "f_number_microlens": lambda d_2, d: d_2 / d,
    "f_number_pupil": lambda D_F, f, d_f, d_3: _at(f, d_f).reach(d_3) / D_F,
    "f_number_main_lens": lambda D, d_1: d_1 / D,
    "fill_factor": lambda D_F, d, d_2, f, d_f, d_3: abs(
        _at(f, d_f).diameter(D_F, d_2, d_3) / _at(f, d_f).pitch(d, d_2, d_3)
    ),
    "mismatch_px": lambda D_F, d, q, d_2, f, d_f, d_3: (
        (_at(f, d_f).diameter(D_F, d_2, d_3) - abs(_at(f, d_f).pitch(d, d_2, d_3))) / q
    ),
    "matched_sensor_distance": lambda D_F, d, f, d_f, d_3, exact=True: _matched(
        lambda d_2: _excess(_at(f, d_f), D_F, d, d_2, d_3, exact)
    ),
    "matched_pupil_diameter": lambda d, d_2, f, d_f, d_3, exact=True: _matched(
        lambda D_F: _excess(_at(f, d_f), D_F, d, d_2, d_3, exact), either_order=True
    ),
    "matched_microlens_pitch": lambda D_F, d_2, f, d_f, d_3, exact=True: _matched(
        lambda d: _excess(_at(f, d_f), D_F, d, d_2, d_3, exact), either_order=True
    ),
    "matched_pupil_distance": _matched_pupil_distance,
    # field and stops
    "non_distortion_room": lambda D, D_F, d_3, f, d_f, X: D / 2 - _outermost(abs(X), D_F, d_3, d_f),
    "undistorted_field": _undistorted_field,
    "stop_disc": _stop_disc,
    # epipolar-plane images
    "view_baseline_mm": lambda q, d_2, f, d_f, d_3: -_at(f, d_f).height(q, 0, d_2, d_3),
    "pupil_shear": lambda Z_F, f, d_f, d_3: -_at(f, d_f).move(d_3, Z_F, 1),
    "epi_slope": lambda Z_F, d, q, d_2, f, d_f, d_3: _at(f, d_f).move(d_3, Z_F, _at(f, d_f).height(q, 0, d_2, d_3)) / d,
    # depth: disparity from rim to rim
    "rim_disparity": lambda Z_F, D_F, d, f, d_f, d_3: _at(f, d_f).move(d_3, Z_F, D_F) / d,
    "disparity_rate": lambda Z_F, D_F, d, f, d_f, d_3: _disparity_per_inverse_depth(D_F, d, f, d_f, d_3) / Z_F**2,
    "depth_sigma": lambda sigma, Z_F, D_F, d, f, d_f, d_3: (
        sigma * Z_F**2 / _disparity_per_inverse_depth(D_F, d, f, d_f, d_3)
    ),
    # sampling and diffraction
    "views_geometric": lambda D_F, q, d_2, f, d_f, d_3: _at(f, d_f).diameter(D_F, d_2, d_3) / q,
    "object_sample_mm": lambda d, f, d_f: d * d_f / _at(f, d_f).d_1,
    # Half waves of path (paraxial) by which the aperture's edge is farther from the sensor's centre.
    "fresnel_number": lambda d, d_2, wave: 2 * ((d / 2) ** 2 / (2 * d_2)) / wave,
    "views_independent": lambda d, d_2, wave: d / (d_2 * (wave / d)),
    "diffraction_width": lambda d, d_2, wave: d_2 * (wave / d),
    "airy_radius_px": lambda d, d_2, q, wave: mp.mpf(122) / 100 * d_2 * (wave / d) / q,
    "pupil_airy_radius": lambda D_F, wave, f, d_f, d_3: mp.mpf(122) / 100 * _at(f, d_f).reach(d_3) * (wave / D_F),
    "microlens_defocus_waves": _defocus_waves,
    "microlens_defocus_blur": _defocus_blur,
    # calibration
    "back_substitute": _back_substitute,
}

ORACLES: dict[str, Form] = {name: traced(by_keyword(form)) for name, form in TRACED.items()}
"""By the name of the closed form in `roslf_design.theory`; keywords as there, floats in, mpmath numbers out."""


def keywords(name: str) -> tuple[str, ...]:
    """Arguments of an oracle."""
    return tuple(SYMBOLS[symbol] for symbol in inspect.signature(TRACED[name]).parameters)


# --- projection of scene points, and rays of pixels -------------------------------------------------------------------


@traced
def microlens_of(
    X: Any, Z_F: Any, pixel: Any, centre: Any, A: Any, m: Any, d: Any, q: Any, d_2: Any, u_0: Any
) -> Any:  # fmt: skip
    """Microlens index u where a scene point is seen in view s'."""
    camera, d_3 = _calibrated(A, m)
    return u_0 + camera.seen(X, Z_F, d_3, camera.height(q * (pixel - centre), 0, d_2, d_3)) / d


@traced
def pixel_of(
    X: Any, Z_F: Any, microlens: Any, centre: Any, A: Any, m: Any, d: Any, q: Any, d_2: Any, u_0: Any
) -> Any:  # fmt: skip
    """Pixel s' of a microlens that sees a scene point."""
    camera, d_3 = _calibrated(A, m)
    c = d * (microlens - u_0)
    pupil = affine_root(lambda S: camera.seen(X, Z_F, d_3, S), c)
    return centre + (camera.landing(c, d_2, d_3, pupil) - camera.landing(c, d_2, d_3, 0)) / q


@traced
def ray_of(pixel: Any, microlens: Any, centre: Any, A: Any, m: Any, d: Any, q: Any, d_2: Any, u_0: Any) -> Any:
    """FAP coordinate and slope by depth of the ray that a pixel of a microlens receives."""
    camera, d_3 = _calibrated(A, m)
    c = d * (microlens - u_0)
    sensor = camera.landing(c, d_2, d_3, 0) + q * (pixel - centre)
    at_pupil = camera.height(sensor, c, d_2, d_3)
    return at_pupil, camera.height(sensor, c, d_2, d_3 + 1) - at_pupil
