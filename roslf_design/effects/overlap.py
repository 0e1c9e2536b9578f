"""Overlap with neighbours: microlens images larger than their pitch (f-number mismatch) lie on top of each other."""

from __future__ import annotations

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import image_diameter, image_pitch


def mismatch(design: Design) -> float:
    """(fill factor - 1) times the image pitch: diameter minus pitch of the microlens images [mm]; Eq. 7's residual."""
    return image_diameter(design) - abs(image_pitch(design))


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Width of the overlap [px]; zero where the images leave gaps."""
    width = mismatch(design) / design.q
    if width <= 0:
        return Estimate(0.0, f"images end {-width:.3g} px short of each other")
    return Estimate(width, f"images overlap by {width:.3g} px")


EFFECT = Effect(
    "overlap",
    "Overlap with neighbours",
    "px",
    estimate,
    cost_per_pixel=5e-9,
    required_by=("microlens_diffraction", "microlens_defocus"),
)
