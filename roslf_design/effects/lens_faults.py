"""Faults of a real main lens: aberrations, distortion, field curvature, colour. An ideal thin lens has none."""

from __future__ import annotations

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Zero: a design's main lens is ideal; real ones come from a traced prescription."""
    return Estimate(0.0, "ideal lens")


EFFECTS = (
    Effect("lens_aberrations", "Main-lens aberrations", "pitch", estimate, available=False),
    Effect("lens_distortion", "Main-lens distortion", "px", estimate, available=False),
    Effect("field_curvature", "Field curvature", "pitch", estimate, available=False),
    Effect("lens_colour", "Main-lens colour", "pitch", estimate, available=False),
)
