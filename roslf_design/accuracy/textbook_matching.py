"""The textbook's closed forms of matched f-numbers, sampling and diffraction."""

from __future__ import annotations

import math
from typing import Any

from .textbook import _d_1, _diameter, _h, _pitch, formula, pupil_angle

# --- matching ---------------------------------------------------------------------------------------------------------


@formula
def microlens_f_number(m: Any, sensor_distance: Any, microlens_pitch: Any) -> Any:
    """d_2/d."""
    return sensor_distance / microlens_pitch


@formula
def microlens_angle(m: Any, sensor_distance: Any, microlens_pitch: Any) -> Any:
    """``d/d_2``."""
    return microlens_pitch / sensor_distance


@formula
def pupil_f_number(
    m: Any, pupil_diameter: Any, focal_length: Any, focal_plane_distance: Any, pupil_distance: Any
) -> Any:
    """d_1/(D_F H)."""
    return _d_1(focal_length, focal_plane_distance) / (pupil_diameter * _h(focal_plane_distance, pupil_distance))


@formula
def main_lens_f_number(m: Any, lens_diameter: Any, mla_distance: Any) -> Any:
    """d_1/D."""
    return mla_distance / lens_diameter


@formula
def fill_factor(
    m: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Image diameter over image pitch (Eq. 7)."""
    optics = focal_length, focal_plane_distance, pupil_distance
    return _diameter(pupil_diameter, sensor_distance, *optics) / _pitch(microlens_pitch, sensor_distance, *optics)


@formula
def approximate_fill_factor(
    m: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Image diameter over d (Eq. 8)."""
    optics = focal_length, focal_plane_distance, pupil_distance
    return _diameter(pupil_diameter, sensor_distance, *optics) / microlens_pitch


@formula
def traditional_fill_factor(
    m: Any, lens_diameter: Any, microlens_pitch: Any, sensor_distance: Any, mla_distance: Any
) -> Any:
    """D d_2/(d_1 d) (Eq. 9)."""
    return lens_diameter * sensor_distance / mla_distance / microlens_pitch


@formula
def matching_mismatch(
    m: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Image diameter less image pitch, in pixels."""
    optics = focal_length, focal_plane_distance, pupil_distance
    diameter = _diameter(pupil_diameter, sensor_distance, *optics)
    return (diameter - _pitch(microlens_pitch, sensor_distance, *optics)) / pixel_pitch


@formula
def matching_residual(
    m: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    sensor_distance: Any,
    mla_distance: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Left less right side of Eq. 7, times d_f - d_3."""
    d, d_1, d_f, d_3 = microlens_pitch, mla_distance, focal_plane_distance, pupil_distance
    left = (d_1 * pupil_diameter + d_3 * d) / ((d_f - d_3) * d * d_1)
    return (left - (d_1 + sensor_distance) / (sensor_distance * d_f)) * (d_f - d_3)


def _found(value: Any) -> tuple[Any, bool]:
    return (value, True) if 0 < value < math.inf else (math.inf, False)


def _vergence(f: Any, d_f: Any, d_3: Any, exact: bool) -> Any:
    return 1 / (_d_1(f, d_f) - f * d_3 / (d_3 - f)) if exact else 0


@formula
def matched_sensor_distance(
    m: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
    exact: bool = True,
) -> Any:
    """d_2 = 1/(D_F H/(d_1 d) - 1/L)."""
    angle = pupil_angle(m, pupil_diameter, focal_length, focal_plane_distance, pupil_distance)
    bend = _vergence(focal_length, focal_plane_distance, pupil_distance, exact)
    rest = angle / microlens_pitch - bend
    return _found(1 / rest if rest else math.inf)


@formula
def matched_pupil_diameter(
    m: Any,
    microlens_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
    exact: bool = True,
) -> Any:
    """D_F = d (1 + d_2/L) d_1/(H d_2)."""
    grow = 1 + sensor_distance * _vergence(focal_length, focal_plane_distance, pupil_distance, exact)
    scale = _h(focal_plane_distance, pupil_distance) * sensor_distance / _d_1(focal_length, focal_plane_distance)
    return _found(microlens_pitch * grow / scale)


@formula
def matched_microlens_pitch(
    m: Any,
    pupil_diameter: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
    exact: bool = True,
) -> Any:
    """``d = D_F H d_2/d_1 over 1 + d_2/L``."""
    optics = focal_length, focal_plane_distance, pupil_distance
    grow = 1 + sensor_distance * _vergence(*optics, exact)
    return _found(_diameter(pupil_diameter, sensor_distance, *optics) / grow if grow else math.inf)


@formula
def matched_pupil_distance(
    m: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    exact: bool = True,
) -> Any:
    """Eq. 7 (or 8) solved for d_3."""
    d, d_2, d_f = microlens_pitch, sensor_distance, focal_plane_distance
    d_1 = _d_1(focal_length, d_f)
    image = pupil_diameter * d_f * d_2 / d_1
    if exact:
        value = (d * (1 + d_2 / d_1) * d_f - image) / (d * (1 + d_2 / d_1) + d * d_2 * d_f / d_1**2)
    else:
        value = d_f - image / d
    # One that rounds to d_f is no design.
    return (value, True) if 0 <= float(value) < float(d_f) else (math.inf, False)


# --- diffraction and sampling -----------------------------------------------------------------------------------------


@formula
def fresnel_number(m: Any, microlens_pitch: Any, sensor_distance: Any, wavelength: Any) -> Any:
    """``d^2/(4 lambda d_2)``."""
    return microlens_pitch**2 / (4 * wavelength * sensor_distance)


@formula
def independent_views(m: Any, microlens_pitch: Any, sensor_distance: Any, wavelength: Any) -> Any:
    """4 N_F."""
    return microlens_pitch**2 / (wavelength * sensor_distance)


@formula
def diffraction_width(m: Any, microlens_pitch: Any, sensor_distance: Any, wavelength: Any) -> Any:
    """``lambda d_2/d``."""
    return wavelength * sensor_distance / microlens_pitch


@formula
def airy_radius(m: Any, microlens_pitch: Any, sensor_distance: Any, wavelength: Any) -> Any:
    """1.22 lambda d_2/d."""
    return 122 * wavelength * sensor_distance / (100 * microlens_pitch)


@formula
def pupil_airy_radius(m: Any, pupil_diameter: Any, effective_image_distance: Any, wavelength: Any) -> Any:
    """1.22 lambda A/D_F."""
    return 122 * wavelength * effective_image_distance / (100 * pupil_diameter)


@formula
def microlens_defocus_waves(
    m: Any,
    microlens_focal_length: Any,
    sensor_distance: Any,
    exit_pupil_vergence: Any,
    microlens_pitch: Any,
    wavelength: Any,
) -> Any:
    """(d^2/8 lambda) |1/f_ml - 1/d_2 - 1/L|."""
    power = abs(1 / microlens_focal_length - 1 / sensor_distance - exit_pupil_vergence)
    return microlens_pitch**2 / (8 * wavelength) * power


@formula
def microlens_defocus_blur(
    m: Any, microlens_focal_length: Any, sensor_distance: Any, exit_pupil_vergence: Any, microlens_pitch: Any
) -> Any:
    """``d d_2 |1/f_ml - 1/d_2 - 1/L|``."""
    power = abs(1 / microlens_focal_length - 1 / sensor_distance - exit_pupil_vergence)
    return microlens_pitch * sensor_distance * power


@formula
def geometric_views(
    m: Any,
    pupil_diameter: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Image diameter over q."""
    optics = focal_length, focal_plane_distance, pupil_distance
    return _diameter(pupil_diameter, sensor_distance, *optics) / pixel_pitch


@formula
def lateral_samples(m: Any, width: Any, microlens_pitch: Any) -> Any:
    """Width over d."""
    return width / microlens_pitch


@formula
def object_sample(m: Any, microlens_pitch: Any, focal_length: Any, focal_plane_distance: Any) -> Any:
    """``d d_f/d_1``."""
    return microlens_pitch * focal_plane_distance / _d_1(focal_length, focal_plane_distance)


@formula
def phase_space_limit(m: Any, pupil_diameter: Any, field_radius: Any, depth: Any, wavelength: Any) -> Any:
    """2 D_F sin(theta)/lambda."""
    atan2 = m.atan2
    return 2 * pupil_diameter * m.sin(atan2(field_radius, depth)) / wavelength
