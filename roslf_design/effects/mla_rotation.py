"""Rotation of the microlens array against the sensor's rows."""

from __future__ import annotations

import math

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import field_note, field_radius


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Chord 2 X_ml sin(rotation/2) that the outermost microlens moves by [px]."""
    angle = design.microlens_array.rotation
    if angle == 0:
        return Estimate(0.0, "the array is not rotated")
    moved = 2 * field_radius(design, brief) * abs(math.sin(angle / 2)) / design.q
    return Estimate(moved, f"{angle * 1e3:.3g} mrad move microlenses by {moved:.3g} px {field_note(design, brief)}")


EFFECT = Effect("mla_rotation", "MLA rotation", "px", estimate)
