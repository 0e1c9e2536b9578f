"""Diffraction at the microlens aperture: the microlens image is its geometric shape seen through a small window."""

from __future__ import annotations

from ..design import Design
from ..theory import diffraction
from .brief import SceneBrief
from .effect import Effect, Estimate


def blur_width(design: Design, wavelength: float) -> float:
    """First zero of a square microlens's diffraction, w = lambda d_2/d [mm]."""
    return float(diffraction.diffraction_width(design.d, design.d_2, wavelength))


def fresnel_number(design: Design, wavelength: float) -> float:
    """N_F = d^2/(4 lambda d_2); 4 N_F views per axis are independent, whatever the pixel count."""
    return float(diffraction.fresnel_number(design.d, design.d_2, wavelength))


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Blur width w [px]; in mean displacement of an edge the blur stays below w while 4 N_F < 3000."""
    wavelength = brief.wavelength(design)
    width = blur_width(design, wavelength) / design.q
    return Estimate(width, f"blur width lambda d_2/d = {width:.3g} px, N_F = {fresnel_number(design, wavelength):.3g}")


EFFECT = Effect("microlens_diffraction", "Microlens diffraction", "px", estimate, cost_per_pixel=20e-9)
