"""Depth, sampling and diffraction."""

from __future__ import annotations

import mpmath as mp

from .camera import Camera
from .decoding import move_of_image
from .judging import oracle


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
