"""Pupil geometry: where the microlens images lie and how large they are (Eqs. 2-4). Exact, and never left out."""

from __future__ import annotations

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import exit_pupil_vergence, field_note, field_radius


def centre_shift(design: Design, x_ml: float) -> float:
    """Distance from a microlens's axis to the centre of its image, X_ml d_2/L [mm], signed; zero where telecentric."""
    return x_ml * design.d_2 * exit_pupil_vergence(design)


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Centre shift at the field's rim [px], signed: negative towards the axis."""
    shift = centre_shift(design, field_radius(design, brief)) / design.q
    return Estimate(shift, f"image centre {shift:.3g} px from the microlens axis {field_note(design, brief)}")


EFFECT = Effect("pupil_geometry", "Pupil geometry", "px", estimate, always=True)
