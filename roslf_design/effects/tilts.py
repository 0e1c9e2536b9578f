"""Tilts of main lens, stops, microlens array and sensor: distances that change across the field."""

from __future__ import annotations

import math

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import exit_pupil_vergence, field_note, field_radius, image_diameter, inverse_aperture_constant, stop_scale


def shift(design: Design, x_ml: float) -> float:
    """How far tilts move or blur a microlens image at radius `x_ml`, first order, all added up [mm].

    An array or sensor tilted by t lies X_ml t out of place there: the chief ray (slope X_ml/L), the image's radius
    (D_F H/2 d_1) and the microlens's own rays (d/2 d_2) each turn that into a shift; in the tilted plane lengths
    shrink by 1 - cos t. A tilted rim reaches D_F t/2 out of its plane, seen under the field angle; a tilted thin
    lens refracts at height l about l t away from z = 0, where it bends by l/f.
    """
    slope = abs(x_ml * exit_pupil_vergence(design))
    cone = (image_diameter(design) + design.d) / (2 * design.d_2)
    array, sensor = math.hypot(*design.microlens_array.tilt), math.hypot(*design.sensor.tilt)
    moved = x_ml * (array + sensor) * (slope + cone)
    moved += x_ml * (2 * math.sin(array / 2) ** 2 + 2 * math.sin(sensor / 2) ** 2)
    angle = x_ml * design.d_f / design.d_1 / (design.d_f - design.d_3)
    for stop in design.all_stops:
        moved += stop.diameter / 2 * math.hypot(*stop.tilt) * angle * stop_scale(design, stop.distance)
    height = x_ml * design.d_3 / (design.d_1 * inverse_aperture_constant(design))
    bend = height**2 / design.f * math.hypot(*design.main_lens.tilt)
    return moved + bend * stop_scale(design, design.d_3)


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Shift [px] at the field's rim."""
    if design.aligned:
        return Estimate(0.0, "nothing is tilted")
    moved = shift(design, field_radius(design, brief)) / design.q
    return Estimate(moved, f"tilts move microlens images by {moved:.3g} px {field_note(design, brief)}")


EFFECT = Effect("tilts", "Tilts", "px", estimate)
