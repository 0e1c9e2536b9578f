"""Projection of scene points, and rays of pixels."""

from __future__ import annotations

from typing import Any

import mpmath as mp

from .camera import Camera, affine_root
from .decoding import calibrated
from .judging import traced


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
