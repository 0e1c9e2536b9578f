"""Each closed form as a textbook prints it, in double precision: what the forms of the package are held beside.

Written in the paper's symbols (`closed_forms.SYMBOLS`); no reference, but for the overlap of two discs, whose arc
cosines are harmless with 60 digits. Divisions by zero raise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath as mp

from .closed_forms import by_keyword

Form = Callable[..., Any]


def _library(value: Any) -> Any:
    """What has the functions for a number: `math`, or mpmath."""
    return mp if isinstance(value, mp.mpf) else math


def _d_1(f: Any, d_f: Any) -> Any:
    return 1 / (1 / f - 1 / d_f)


def _h(d_f: Any, d_3: Any) -> Any:
    return d_f / (d_f - d_3)


def _z_x(f: Any, d_3: Any) -> Any:
    return f * d_3 / (d_3 - f)


def _per_l(f: Any, d_f: Any, d_3: Any) -> Any:
    return 1 / (_d_1(f, d_f) - _z_x(f, d_3))


def _pitch(d: Any, d_2: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    """By way of the exit pupil's distance."""
    return d * (1 + d_2 / (_d_1(f, d_f) - _z_x(f, d_3)))


def _diameter(D_F: Any, d_2: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    return D_F * _h(d_f, d_3) * d_2 / _d_1(f, d_f)


def _shift(d: Any, q: Any, d_2: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    """Eq. 4 for one microlens."""
    return d * d_2 * d_3 * d_f / (q * _d_1(f, d_f) ** 2 * (d_f - d_3))


def _eq7_residual(D_F: Any, d: Any, d_2: Any, d_1: Any, d_f: Any, d_3: Any) -> Any:
    left = (d_1 * D_F + d_3 * d) / ((d_f - d_3) * d * d_1)
    return (left - (d_1 + d_2) / (d_2 * d_f)) * (d_f - d_3)


def _exists(value: Any) -> tuple[Any, bool]:
    return (value, True) if 0 < value < math.inf else (math.inf, False)


def _matched_sensor_distance(D_F: Any, d: Any, f: Any, d_f: Any, d_3: Any, exact: bool = True) -> Any:
    angle = D_F * _h(d_f, d_3) / _d_1(f, d_f)
    rest = angle / d - (_per_l(f, d_f, d_3) if exact else 0)
    return _exists(1 / rest if rest else math.inf)


def _matched_pupil_diameter(d: Any, d_2: Any, f: Any, d_f: Any, d_3: Any, exact: bool = True) -> Any:
    grow = 1 + d_2 * (_per_l(f, d_f, d_3) if exact else 0)
    return _exists(d * abs(grow) / (_h(d_f, d_3) * d_2 / _d_1(f, d_f)))


def _matched_microlens_pitch(D_F: Any, d_2: Any, f: Any, d_f: Any, d_3: Any, exact: bool = True) -> Any:
    grow = 1 + d_2 * (_per_l(f, d_f, d_3) if exact else 0)
    return _exists(_diameter(D_F, d_2, f, d_f, d_3) / abs(grow) if grow else math.inf)


def _matched_pupil_distance(D_F: Any, d: Any, d_2: Any, f: Any, d_f: Any, exact: bool = True) -> Any:
    """Eq. 7 (or 8) solved for d_3."""
    d_1 = _d_1(f, d_f)
    image = D_F * d_f * d_2 / d_1
    if exact:
        value = (d * (1 + d_2 / d_1) * d_f - image) / (d * (1 + d_2 / d_1) + d * d_2 * d_f / d_1**2)
    else:
        value = d_f - image / d
    return (value, True) if 0 <= float(value) < float(d_f) else (math.inf, False)


def _eq6(D: Any, D_F: Any, d_3: Any, d_f: Any) -> Any:
    return d_f * ((D - D_F) / d_3 - D / d_f) / 2


def _stop_disc(D_k: Any, z_k: Any, c: Any, d_2: Any, f: Any, d_f: Any, e_k: Any) -> Any:
    d_1, h = _d_1(f, d_f), _h(d_f, z_k)
    grow = 1 + d_2 / d_1 - h * z_k * d_2 / d_1**2
    return D_k / 2 * h * d_2 / d_1, tuple(x * grow - e * h * d_2 / d_1 for x, e in zip(c, e_k, strict=True))


def _shear(Z_F: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    return _d_1(f, d_f) / d_f - _d_1(f, d_f) / _h(d_f, d_3) / Z_F


def _epi_slope(Z_F: Any, d: Any, q: Any, d_2: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    """Eq. 12."""
    return q * (_d_1(f, d_f) / _h(d_f, d_3)) / (d * d_2) * _shear(Z_F, f, d_f, d_3)


def _disparity(Z_F: Any, D_F: Any, d: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    return D_F * _d_1(f, d_f) / (d * _h(d_f, d_3)) * (1 / Z_F - 1 / (d_f - d_3))


def _back_substitute(f: Any, A: Any, m: Any) -> Any:
    """Table 2: d_1, d_f, H, d_3 and 1/H, each from those before."""
    d_1 = f * (1 + m)
    d_f = d_1 / m
    h = d_1 / A
    return d_1, d_f, h, d_f - d_f / h, 1 / h


FORMULAS: dict[str, Form] = {
    "mla_distance": _d_1,
    "focal_plane_distance": lambda f, d_1: _d_1(f, d_1),
    "focal_length": lambda d_f, d_1: 1 / (1 / d_f + 1 / d_1),
    "magnification": lambda f, d_f: _d_1(f, d_f) / d_f,
    "inverse_magnification": lambda f, d_f: d_f / _d_1(f, d_f),
    "conjugate_residual": lambda f, d_f, d_1: f / d_f + f / d_1 - 1,
    "gap": lambda d_f, d_3: d_f - d_3,
    "aperture_constant": _h,
    "inverse_aperture_constant": lambda d_f, d_3: 1 - d_3 / d_f,
    "effective_image_distance": lambda f, d_f, d_3: _d_1(f, d_f) / _h(d_f, d_3),
    "pupil_angle": lambda D_F, f, d_f, d_3: D_F * _h(d_f, d_3) / _d_1(f, d_f),
    "exit_pupil_distance": _z_x,
    "exit_pupil_diameter": lambda D_F, f, d_3: D_F * f / abs(d_3 - f),
    "vergence_at_mla_per_mm": _per_l,
    "image_pitch_mm": _pitch,
    "image_diameter_mm": _diameter,
    "centre_shift_px_per_microlens": _shift,
    "f_number_microlens": lambda d_2, d: d_2 / d,
    "f_number_pupil": lambda D_F, f, d_f, d_3: _d_1(f, d_f) / (D_F * _h(d_f, d_3)),
    "f_number_main_lens": lambda D, d_1: d_1 / D,
    "fill_factor": lambda D_F, d, d_2, f, d_f, d_3: abs(_diameter(D_F, d_2, f, d_f, d_3) / _pitch(d, d_2, f, d_f, d_3)),
    "mismatch_px": lambda D_F, d, q, d_2, f, d_f, d_3: (
        (_diameter(D_F, d_2, f, d_f, d_3) - abs(_pitch(d, d_2, f, d_f, d_3))) / q
    ),
    "matched_sensor_distance": _matched_sensor_distance,
    "matched_pupil_diameter": _matched_pupil_diameter,
    "matched_microlens_pitch": _matched_microlens_pitch,
    "matched_pupil_distance": _matched_pupil_distance,
    "non_distortion_room": lambda D, D_F, d_3, f, d_f, X: d_3 / abs(d_f - d_3) * (_eq6(D, D_F, d_3, d_f) - abs(X)),
    "undistorted_field": lambda D, D_F, d_3, f, d_f: max(_eq6(D, D_F, d_3, d_f), 0 * d_f),
    "stop_disc": _stop_disc,
    "view_baseline_mm": lambda q, d_2, f, d_f, d_3: q * _d_1(f, d_f) / (_h(d_f, d_3) * d_2),
    "pupil_shear": _shear,
    "epi_slope": _epi_slope,
    "rim_disparity": _disparity,
    "disparity_rate": lambda Z_F, D_F, d, f, d_f, d_3: D_F * _d_1(f, d_f) / (d * _h(d_f, d_3) * Z_F**2),
    "depth_sigma": lambda sigma, Z_F, D_F, d, f, d_f, d_3: Z_F**2 * d * _h(d_f, d_3) * sigma / (D_F * _d_1(f, d_f)),
    "views_geometric": lambda D_F, q, d_2, f, d_f, d_3: _diameter(D_F, d_2, f, d_f, d_3) / q,
    "object_sample_mm": lambda d, f, d_f: d * d_f / _d_1(f, d_f),
    "fresnel_number": lambda d, d_2, wave: d**2 / (4 * wave * d_2),
    "views_independent": lambda d, d_2, wave: d**2 / (wave * d_2),
    "diffraction_width": lambda d, d_2, wave: wave * d_2 / d,
    "airy_radius_px": lambda d, d_2, q, wave: 122 * wave * d_2 / (100 * d * q),
    "pupil_airy_radius": lambda D_F, wave, f, d_f, d_3: 122 * wave * _d_1(f, d_f) / (100 * D_F * _h(d_f, d_3)),
    "microlens_defocus_waves": lambda f_ml, d_2, d, wave, f, d_f, d_3: (
        d**2 / (8 * wave) * abs(1 / f_ml - 1 / d_2 - _per_l(f, d_f, d_3))
    ),
    "microlens_defocus_blur": lambda f_ml, d_2, d, f, d_f, d_3: d * d_2 * abs(1 / f_ml - 1 / d_2 - _per_l(f, d_f, d_3)),
    "back_substitute": _back_substitute,
}

TEXTBOOK: dict[str, Form] = {name: by_keyword(form) for name, form in FORMULAS.items()}
"""By the name of the closed form in `roslf_design.theory`, with its keywords."""


def overlap(r: Any, R: Any, distance: Any) -> Any:
    """Area common to two discs: two sectors less the kite, which Heron's formula gives."""
    m = _library(distance)
    if distance >= r + R:
        return 0 * distance
    if distance <= abs(R - r):
        return m.pi * min(r, R) ** 2
    first = m.acos((distance**2 + r**2 - R**2) / (2 * distance * r))
    second = m.acos((distance**2 + R**2 - r**2) / (2 * distance * R))
    heron = (r + R - distance) * (distance + r - R) * (distance - r + R) * (distance + r + R)
    return r**2 * first + R**2 * second - m.sqrt(max(heron, 0)) / 2


def lost_share(r: Any, R: Any, distance: Any) -> Any:
    """Share of the disc of radius r outside the other: 1 less the kept share."""
    return 1 - overlap(r, R, distance) / (_library(distance).pi * r**2)


def cos4_loss(slope: Any) -> Any:
    """1 - cos^4 of the angle of that slope."""
    m = _library(slope)
    return 1 - m.cos(m.atan(slope)) ** 4
