"""Microlens images as a design has them: their pitch, and how far off axis no rim cuts them."""

from __future__ import annotations

import math

from ..camera import Camera
from ..design import Design
from ..theory.exit_pupil import microlens_image_pitch
from ..theory.vignetting import field_limit


def undistorted_radius(design: Design) -> float:
    """Radius on the sensor inside which no rim cuts into a microlens image [px].

    Inf where none ever does, 0 where some rim cuts even on the axis. Eq. 6 for the main lens and every stop, carried
    from the focal plane to the sensor.
    """
    c = Camera.of(design)
    bound = field_limit(c).mla_radius
    return bound * image_pitch(design) / design.d if math.isfinite(bound) else math.inf


def image_pitch(design: Design) -> float:
    """Pitch of the microlens images by the design [px]."""
    c = Camera.of(design)
    return abs(float(microlens_image_pitch(c) / c.q))
