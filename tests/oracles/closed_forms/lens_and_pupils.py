"""Main lens and pupils, read off traced rays."""

from __future__ import annotations

import mpmath as mp

from .camera import Camera, affine_root
from .judging import oracle


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
