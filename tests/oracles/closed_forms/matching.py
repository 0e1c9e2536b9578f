"""F-number matching: matched lengths found from two tries, everything being affine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath as mp

from .camera import Camera, affine_root
from .judging import oracle


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
