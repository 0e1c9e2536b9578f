"""Where on the microlens array the effects are judged, and the few lengths that several of them share."""

from __future__ import annotations

import math

from ..design import Design, Stop
from ..theory import aperture, pupils
from .brief import SceneBrief


def half_sizes(design: Design) -> tuple[float, float]:
    """Half width and half height of the microlens array that the sensor sees [mm]."""
    (width, height), (seen_x, seen_y) = design.microlens_array.size, design.sensor_size
    return min(width, seen_x) / 2, min(height, seen_y) / 2


def field_radius(design: Design, brief: SceneBrief) -> float:
    """X_ml of the farthest microlens that counts [mm]: the brief's own, or the last whose image the corner shows."""
    if brief.field_radius is not None:
        return brief.field_radius
    grow = abs(image_pitch(design)) / design.d
    seen = math.hypot(*design.sensor_size) / 2 + image_diameter(design) / 2
    array = math.hypot(*design.microlens_array.size) / 2
    return min(seen / grow, array) if grow > 0 else array


def field_note(design: Design, brief: SceneBrief) -> str:
    """The same, in words."""
    return f"at X_ml = {field_radius(design, brief):.4g} mm"


def inverse_aperture_constant(design: Design, distance: float | None = None) -> float:
    """1/h = (d_f - z)/d_f of a stop at z (the FAP where none is given); Eq. 3 in the form that never overflows."""
    return float(aperture.inverse_aperture_constant(design.d_f, design.d_3 if distance is None else distance))


def exit_pupil_vergence(design: Design) -> float:
    """1/L [1/mm], the exit pupil's vergence at the microlens array; 0 where the image side is telecentric."""
    return float(pupils.exit_pupil_vergence(design.f, design.d_f, design.d_3))


def image_pitch(design: Design) -> float:
    """Distance between neighbouring microlens images d(1 + d_2/L) [mm]; negative where their order is reversed."""
    return float(pupils.microlens_image_pitch(design.d, design.d_2, design.f, design.d_f, design.d_3))


def stop_scale(design: Design, distance: float) -> float:
    """Scale h d_2/d_1: how much a length on a stop at `distance` is scaled on the sensor."""
    return design.d_2 / (design.d_1 * inverse_aperture_constant(design, distance))


def stop_image(design: Design, stop: Stop, x_ml: float) -> tuple[float, float]:
    """Centre [mm] (along the field, decentre apart) and radius [mm] of a stop's disc on the sensor, seen at `x_ml`."""
    scale = stop_scale(design, stop.distance)
    return x_ml + scale * x_ml * (1 - stop.distance / design.f), stop.diameter / 2 * scale


def image_diameter(design: Design) -> float:
    """Diameter of the full microlens image, D_F H d_2/d_1 [mm]."""
    return float(pupils.microlens_image_diameter(design.D_F, design.d_2, design.f, design.d_f, design.d_3))
