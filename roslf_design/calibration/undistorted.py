"""How far from the axis a design's microlens images are whole, as the sensor sees it."""

from __future__ import annotations

import math

from ..design import Design
from ..effects.field import image_pitch
from ..evaluation.rims import field_limit


def undistorted_radius(design: Design) -> float:
    """Radius on the sensor inside which no rim cuts into a microlens image [px].

    Inf where none ever does, 0 where some rim cuts even on the axis. Eq. 6 for the main lens and every stop, carried
    from the focal plane to the sensor.
    """
    bound = field_limit(design, 0.0).radius
    if not math.isfinite(bound):
        return math.inf
    return bound * design.d_1 / design.d_f * abs(image_pitch(design)) / design.d / design.q
