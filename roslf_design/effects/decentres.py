"""Decentres of main lens, stops, microlens array and sensor: microlens images that lie beside their places."""

from __future__ import annotations

import math

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import image_pitch, stop_scale


def shift(design: Design) -> float:
    """How far all decentres, each at its worst, move a microlens image on the sensor [mm]."""
    scale = stop_scale(design, design.d_3)
    moved = math.hypot(*design.main_lens.decentre) * scale * design.d_3 / design.f
    moved += math.hypot(*design.microlens_array.decentre) * abs(image_pitch(design)) / design.d
    moved += math.hypot(*design.sensor.decentre)
    return moved + sum(math.hypot(*stop.decentre) * stop_scale(design, stop.distance) for stop in design.all_stops)


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Shift [px], the same all over the field."""
    moved = shift(design) / design.q
    if moved == 0:
        return Estimate(0.0, "nothing is decentred")
    return Estimate(moved, f"decentres move microlens images by {moved:.3g} px")


EFFECT = Effect("decentres", "Decentres", "px", estimate)
