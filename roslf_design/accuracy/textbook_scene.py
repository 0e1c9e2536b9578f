"""The textbook's closed forms of what lies in front of the camera: field, stops, views, depth, calibration."""

from __future__ import annotations

from typing import Any

from .textbook import _d_1, _h, formula


@formula
def nondistortion_margin(
    m: Any, lens_diameter: Any, pupil_diameter: Any, pupil_distance: Any, distance: Any, radius: Any
) -> Any:
    """Eq. 6's bound less the radius, times 2 d_3."""
    bound = distance * ((lens_diameter - pupil_diameter) / pupil_distance - lens_diameter / distance) / 2
    return 2 * pupil_distance * (bound - abs(radius))


@formula
def nondistortion_bound(
    m: Any,
    lens_diameter: Any,
    pupil_diameter: Any,
    pupil_distance: Any,
    distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
) -> Any:
    """Eq. 6, and where that point's chief ray meets the array."""
    radius = distance * ((lens_diameter - pupil_diameter) / pupil_distance - lens_diameter / distance) / 2
    if radius < 0:
        return radius * 0, radius * 0
    reach = _d_1(focal_length, focal_plane_distance) / _h(focal_plane_distance, pupil_distance)
    return radius, abs(radius * reach / (distance - pupil_distance))


@formula
def stop_margin(
    m: Any,
    stop_diameter: Any,
    stop_distance: Any,
    pupil_diameter: Any,
    pupil_distance: Any,
    distance: Any,
    point: Any,
    stop_decentre: Any,
    pupil_decentre: Any,
) -> Any:
    """Room at the stop, by the ratio of distances from the field point, times Z - d_3."""
    share = (distance - stop_distance) / (distance - pupil_distance)
    off = [
        x * (1 - share) + e_f * share - e_k for x, e_k, e_f in zip(point, stop_decentre, pupil_decentre, strict=True)
    ]
    return (stop_diameter - pupil_diameter * share - 2 * m.hypot(*off)) * (distance - pupil_distance)


@formula
def stop_disc(
    m: Any,
    stop_diameter: Any,
    stop_distance: Any,
    microlens_centre: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    stop_decentre: Any,
) -> Any:
    """Radius (D_k/2) h d_2/d_1; centre c (1 + d_2/d_1 - h z d_2/d_1^2) - e_k h d_2/d_1."""
    d_1, h, d_2 = _d_1(focal_length, focal_plane_distance), _h(focal_plane_distance, stop_distance), sensor_distance
    grow = 1 + d_2 / d_1 - h * stop_distance * d_2 / d_1**2
    centre = tuple(c * grow - e * h * d_2 / d_1 for c, e in zip(microlens_centre, stop_decentre, strict=True))
    return stop_diameter / 2 * h * d_2 / d_1, centre


# --- decoding and epipolar-plane images -------------------------------------------------------------------------------


@formula
def pixel_to_pupil(
    m: Any, pixel: Any, pixel_pitch: Any, sensor_distance: Any, effective_image_distance: Any, centre: Any
) -> Any:
    """Eq. 2."""
    return -(pixel_pitch * effective_image_distance / sensor_distance) * (pixel - centre)


@formula
def pupil_to_pixel(
    m: Any, coordinate: Any, pixel_pitch: Any, sensor_distance: Any, effective_image_distance: Any, centre: Any
) -> Any:
    """Eq. 2, solved for the pixel."""
    return centre - coordinate / (pixel_pitch * effective_image_distance / sensor_distance)


@formula
def pixel_to_lens(m: Any, pixel: Any, pixel_pitch: Any, sensor_distance: Any, mla_distance: Any, centre: Any) -> Any:
    """Eq. 1."""
    return -(pixel_pitch * mla_distance / sensor_distance) * (pixel - centre)


@formula
def view_baseline(m: Any, pixel_pitch: Any, sensor_distance: Any, effective_image_distance: Any) -> Any:
    """Q A/d_2."""
    return pixel_pitch * effective_image_distance / sensor_distance


@formula
def pupil_shear(m: Any, depth: Any, focal_length: Any, focal_plane_distance: Any, pupil_distance: Any) -> Any:
    """``m - A/Z_F``."""
    d_1 = _d_1(focal_length, focal_plane_distance)
    return d_1 / focal_plane_distance - d_1 / _h(focal_plane_distance, pupil_distance) / depth


@formula
def epi_slope(
    m: Any,
    depth: Any,
    microlens_pitch: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Eq. 12."""
    reach = _d_1(focal_length, focal_plane_distance) / _h(focal_plane_distance, pupil_distance)
    shear = pupil_shear(m, depth, focal_length, focal_plane_distance, pupil_distance)
    return pixel_pitch * reach / (microlens_pitch * sensor_distance) * shear


@formula
def epi_inverse_slope(
    m: Any,
    depth: Any,
    microlens_pitch: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Eq. 12, the other way up."""
    lens = focal_length, focal_plane_distance, pupil_distance
    return 1 / epi_slope(m, depth, microlens_pitch, pixel_pitch, sensor_distance, *lens)


@formula
def calibrated_epi_slope(
    m: Any,
    depth: Any,
    effective_image_distance: Any,
    magnification: Any,
    microlens_pitch: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
) -> Any:
    """Eq. 12 in A and m."""
    scale = pixel_pitch * effective_image_distance / (microlens_pitch * sensor_distance)
    return scale * (magnification - effective_image_distance / depth)


@formula
def inverse_depth_from_epi_slope(
    m: Any,
    slope: Any,
    effective_image_distance: Any,
    magnification: Any,
    microlens_pitch: Any,
    pixel_pitch: Any,
    sensor_distance: Any,
) -> Any:
    """Eq. 12, solved for 1/Z_F."""
    scale = microlens_pitch * sensor_distance / (pixel_pitch * effective_image_distance)
    return (magnification - slope * scale) / effective_image_distance


# --- depth ------------------------------------------------------------------------------------------------------------


@formula
def rim_disparity(
    m: Any,
    depth: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """(D_F d_1/(d H)) (1/Z_F - 1/(d_f - d_3))."""
    d_1, h = _d_1(focal_length, focal_plane_distance), _h(focal_plane_distance, pupil_distance)
    return pupil_diameter * d_1 / (microlens_pitch * h) * (1 / depth - 1 / (focal_plane_distance - pupil_distance))


@formula
def defocus_blur(
    m: Any,
    depth: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """The disparity's size."""
    lens = focal_length, focal_plane_distance, pupil_distance
    return abs(rim_disparity(m, depth, pupil_diameter, microlens_pitch, *lens))


@formula
def disparity_rate(
    m: Any,
    depth: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """D_F d_1/(d H Z_F^2)."""
    d_1, h = _d_1(focal_length, focal_plane_distance), _h(focal_plane_distance, pupil_distance)
    return pupil_diameter * d_1 / (microlens_pitch * h * depth**2)


@formula
def depth_sigma(
    m: Any,
    disparity_sigma: Any,
    depth: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """Z_F^2 d H sigma_B/(D_F d_1)."""
    d_1, h = _d_1(focal_length, focal_plane_distance), _h(focal_plane_distance, pupil_distance)
    return depth**2 * microlens_pitch * h * disparity_sigma / (pupil_diameter * d_1)


@formula
def inverse_depth_sigma(
    m: Any,
    disparity_sigma: Any,
    pupil_diameter: Any,
    microlens_pitch: Any,
    focal_length: Any,
    focal_plane_distance: Any,
    pupil_distance: Any,
) -> Any:
    """``d H sigma_B/(D_F d_1)``."""
    d_1, h = _d_1(focal_length, focal_plane_distance), _h(focal_plane_distance, pupil_distance)
    return microlens_pitch * h * disparity_sigma / (pupil_diameter * d_1)


# --- calibration ------------------------------------------------------------------------------------------------------


@formula
def back_substitute(m: Any, focal_length: Any, effective_image_distance: Any, magnification: Any) -> Any:
    """d_1, d_f, H, d_3 and 1/H, each from those before."""
    d_1 = focal_length * (1 + magnification)
    d_f = d_1 / magnification
    h = d_1 / effective_image_distance
    return d_1, d_f, h, d_f - d_f / h, 1 / h


@formula
def back_substitution_jacobian(m: Any, focal_length: Any, effective_image_distance: Any, magnification: Any) -> Any:
    """Derivatives of d_1, d_f, H, d_3 by f, A, m, term by term."""
    f, reach, scale = focal_length, effective_image_distance, magnification
    zero = 0 * f
    return (
        (1 + scale, zero, f),
        (1 + 1 / scale, zero, -f / scale**2),
        ((1 + scale) / reach, -f * (1 + scale) / reach**2, f / reach),
        (1 + 1 / scale, -1 / scale, -f / scale**2 + reach / scale**2),
    )


# --- discs ------------------------------------------------------------------------------------------------------------


def overlap(m: Any, r: Any, R: Any, distance: Any) -> Any:
    """Area common to two discs: two sectors less the kite, which Heron's formula gives."""
    if distance >= r + R:
        return 0 * distance
    if distance <= abs(R - r):
        return m.pi * min(r, R) ** 2
    first = m.acos((distance**2 + r**2 - R**2) / (2 * distance * r))
    second = m.acos((distance**2 + R**2 - r**2) / (2 * distance * R))
    heron = (r + R - distance) * (distance + r - R) * (distance - r + R) * (distance + r + R)
    kite = m.sqrt(max(heron, 0)) / 2
    return r**2 * first + R**2 * second - kite


def lost(m: Any, r: Any, R: Any, distance: Any) -> Any:
    """Share of the disc of radius r outside the other: 1 less the kept share."""
    return 1 - overlap(m, r, R, distance) / (m.pi * r**2)


def cos4_loss(m: Any, slope: Any) -> Any:
    """1 - cos^4 of the angle of that slope."""
    return 1 - m.cos(m.atan(slope)) ** 4
