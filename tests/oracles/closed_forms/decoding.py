"""Decoding and epipolar-plane images, by moving a scene point and following its image."""

from __future__ import annotations

from typing import Any

import mpmath as mp

from .camera import Camera, affine_root
from .judging import oracle


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
