"""Each closed form as a textbook prints it: the reference at 60 digits, and the naive formula at 16.

What cancels or overflows in double precision is harmless with 44 digits to spare, so that one formula serves twice.
The functions take the closed forms' own keywords; `m` is `math` or mpmath.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from functools import partial
from typing import Any

Formula = Callable[..., Any]
FORMULAS: dict[str, Formula] = {}
"""By the name of the closed form in `roslf_design.theory`."""


def formula(function: Formula) -> Formula:
    """Register under the function's own name."""
    FORMULAS[function.__name__] = function
    return function


def formulas() -> dict[str, Formula]:
    """All of them, those in this file's neighbours included."""
    from . import textbook_matching, textbook_scene

    assert textbook_matching is not textbook_scene
    return FORMULAS


def keywords(name: str) -> tuple[str, ...]:
    """Arguments of a closed form."""
    return tuple(inspect.signature(formulas()[name]).parameters)[1:]


def naive(name: str) -> Formula:
    """The formula in double precision; divisions by zero raise."""
    return partial(formulas()[name], math)


def exact(name: str) -> Formula:
    """The formula over mpmath numbers, at the caller's precision."""
    from .digits import many_digits

    return partial(formulas()[name], many_digits())


# --- lengths that follow from others ----------------------------------------------------------------------------------


def _d_1(f: Any, d_f: Any) -> Any:
    return 1 / (1 / f - 1 / d_f)


def _h(d_f: Any, d_3: Any) -> Any:
    return d_f / (d_f - d_3)


def _pitch(d: Any, d_2: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    """By way of the exit pupil's distance."""
    return d * (1 + d_2 / (_d_1(f, d_f) - f * d_3 / (d_3 - f)))


def _diameter(D_F: Any, d_2: Any, f: Any, d_f: Any, d_3: Any) -> Any:
    return D_F * _h(d_f, d_3) * d_2 / _d_1(f, d_f)


# --- main lens --------------------------------------------------------------------------------------------------------


@formula
def mla_distance(m: Any, focal_length: Any, focal_plane_distance: Any) -> Any:
    """1/f = 1/d_f + 1/d_1."""
    return _d_1(focal_length, focal_plane_distance)


@formula
def focal_plane_distance(m: Any, focal_length: Any, mla_distance: Any) -> Any:
    """The same, solved for d_f."""
    return _d_1(focal_length, mla_distance)


@formula
def focal_length(m: Any, focal_plane_distance: Any, mla_distance: Any) -> Any:
    """The same, solved for f."""
    return 1 / (1 / focal_plane_distance + 1 / mla_distance)


@formula
def mla_excess(m: Any, focal_length: Any, focal_plane_distance: Any) -> Any:
    """d_1 - f."""
    return _d_1(focal_length, focal_plane_distance) - focal_length


@formula
def magnification(m: Any, focal_length: Any, focal_plane_distance: Any) -> Any:
    """``m = d_1/d_f``."""
    return _d_1(focal_length, focal_plane_distance) / focal_plane_distance


@formula
def inverse_magnification(m: Any, focal_length: Any, focal_plane_distance: Any) -> Any:
    """1/m."""
    return focal_plane_distance / _d_1(focal_length, focal_plane_distance)


@formula
def conjugate_residual(m: Any, focal_length: Any, focal_plane_distance: Any, mla_distance: Any) -> Any:
    """f/d_f + f/d_1 - 1."""
    return focal_length / focal_plane_distance + focal_length / mla_distance - 1


@formula
def gap(m: Any, focal_plane_distance: Any, pupil_distance: Any) -> Any:
    """``g = d_f - d_3``."""
    return focal_plane_distance - pupil_distance


@formula
def aperture_constant(m: Any, focal_plane_distance: Any, pupil_distance: Any) -> Any:
    """Eq. 3."""
    return _h(focal_plane_distance, pupil_distance)


@formula
def inverse_aperture_constant(m: Any, focal_plane_distance: Any, pupil_distance: Any) -> Any:
    """1/H as 1 - d_3/d_f."""
    return 1 - pupil_distance / focal_plane_distance


@formula
def effective_image_distance(m: Any, focal_length: Any, focal_plane_distance: Any, pupil_distance: Any) -> Any:
    """A = d_1/H."""
    return _d_1(focal_length, focal_plane_distance) / _h(focal_plane_distance, pupil_distance)


@formula
def effective_image_distance_from_magnification(
    m: Any, focal_length: Any, magnification: Any, pupil_distance: Any
) -> Any:
    """A = f + m (f - d_3)."""
    return focal_length + magnification * (focal_length - pupil_distance)


@formula
def pupil_angle(m: Any, pupil_diameter: Any, focal_length: Any, focal_plane_distance: Any, pupil_distance: Any) -> Any:
    """D_F H/d_1."""
    return pupil_diameter * _h(focal_plane_distance, pupil_distance) / _d_1(focal_length, focal_plane_distance)


# --- pupils -----------------------------------------------------------------------------------------------------------


@formula
def exit_pupil_distance(m: Any, focal_length: Any, pupil_distance: Any) -> Any:
    """z_x = f d_3/(d_3 - f)."""
    return focal_length * pupil_distance / (pupil_distance - focal_length)


@formula
def exit_pupil_diameter(m: Any, pupil_diameter: Any, focal_length: Any, pupil_distance: Any) -> Any:
    """D_F f/|d_3 - f|."""
    return pupil_diameter * focal_length / abs(pupil_distance - focal_length)


@formula
def exit_pupil_vergence(m: Any, focal_length: Any, focal_plane_distance: Any, pupil_distance: Any) -> Any:
    """1/(d_1 - z_x)."""
    pupil = focal_length * pupil_distance / (pupil_distance - focal_length)
    return 1 / (_d_1(focal_length, focal_plane_distance) - pupil)


@formula
def microlens_image_pitch(
    m: Any,
    microlens_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """``d (1 + d_2/L)``."""
    return _pitch(microlens_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance)


@formula
def microlens_image_diameter(
    m: Any,
    pupil_diameter: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """D_F H d_2/d_1."""
    return _diameter(pupil_diameter, sensor_distance, focal_length, focal_plane_distance, pupil_distance)


@formula
def centre_shift_per_microlens(
    m: Any,
    microlens_pitch: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Eq. 4 for one microlens."""
    d_f, d_3 = focal_plane_distance, pupil_distance
    d_1 = _d_1(focal_length, d_f)
    return microlens_pitch * sensor_distance * d_3 * d_f / (pixel_pitch * d_1**2 * (d_f - d_3))


@formula
def centre_deviation(
    m: Any,
    index: Any,
    microlens_pitch: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Eq. 4."""
    optics = focal_length, focal_plane_distance, pupil_distance
    return index * centre_shift_per_microlens(m, microlens_pitch, pixel_pitch, sensor_distance, *optics)
