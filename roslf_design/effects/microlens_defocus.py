"""Microlens defocus: the sensor is not where the microlenses image the exit pupil."""

from __future__ import annotations

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import exit_pupil_vergence
from .microlens_diffraction import blur_width


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
    """Ray blur b [px]; where diffraction of width w blurs as well, what is left of it, b^2/(b + 10 w).

    W = b/8w waves of defocus take at most 1 - sinc(2 W) = 6.6 W^2 of any frequency that diffraction lets pass, which
    counts for so much of w; beyond a wave or so the rays' blur takes over.
    """
    wavelength = brief.wavelength(design)
    blur, waves = ray_blur(design), defocus_waves(design, wavelength)
    hidden = blur_width(design, wavelength) if brief.diffracts else 0.0
    felt = blur * blur / (blur + 10 * hidden) if blur > 0 else 0.0
    note = f"ray blur {blur / design.q:.3g} px, {waves:.2g} waves at the microlens edge"
    return Estimate(felt / design.q, f"{note}, mostly hidden by diffraction" if 10 * hidden > blur else note)


EFFECT = Effect("microlens_defocus", "Microlens defocus", "px", estimate, cost_per_pixel=5e-9)
