"""Microlens defocus: the sensor is not where the microlenses image the exit pupil."""

from __future__ import annotations

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import exit_pupil_vergence


def defocus(design: Design) -> float:
    """1/f_ml - 1/d_2 - 1/L [1/mm]; zero where the exit pupil is in focus on the sensor."""
    return 1 / design.f_ml - 1 / design.d_2 - exit_pupil_vergence(design)


def defocus_waves(design: Design, wavelength: float) -> float:
    """Wavefront error at the middle of a square microlens's edge, (d^2/8 lambda) times `defocus`, unsigned [waves]."""
    return design.d**2 / (8 * wavelength) * abs(defocus(design))


def ray_blur(design: Design) -> float:
    """Width of the sensor patch that one point of the exit pupil lights through the whole microlens [mm]."""
    return design.d * design.d_2 * abs(defocus(design))


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Ray blur [px]."""
    blur = ray_blur(design) / design.q
    waves = defocus_waves(design, brief.wavelength(design))
    return Estimate(blur, f"ray blur {blur:.3g} px, {waves:.2g} waves at the microlens edge")


EFFECT = Effect("microlens_defocus", "Microlens defocus", "px", estimate, cost_per_pixel=5e-9)
