"""Diffraction at the microlens aperture: the microlens image is its geometric shape seen through a small window."""

from __future__ import annotations

import math

from ..design import Design
from ..theory import diffraction
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import image_pitch


def blur_width(design: Design, wavelength: float) -> float:
    """First zero of a square microlens's diffraction, w = lambda d_2/d [mm]."""
    return float(diffraction.diffraction_width(design.d, design.d_2, wavelength))


def fresnel_number(design: Design, wavelength: float) -> float:
    """N_F = d^2/(4 lambda d_2); 4 N_F views per axis are independent, whatever the pixel count."""
    return float(diffraction.fresnel_number(design.d, design.d_2, wavelength))


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Displacement of an edge [px]: the blur width w, and more where w is a small part of the pitch p.

    The tails of sinc^2 fall off with the square of the distance, so light from a whole pitch around adds up: an edge
    between two images loses (2 w/pi^2) (ln(2 pi p/w) + 0.577) to them, which exceeds w from p/w = 13 on.
    """
    wavelength = brief.wavelength(design)
    width, pitch = blur_width(design, wavelength), abs(image_pitch(design))
    tails = 2 / math.pi**2 * (math.log(2 * math.pi * max(pitch / width, 1.0)) + 0.5772)
    size = width * max(1.0, tails) / design.q
    note = f"blur width lambda d_2/d = {width / design.q:.3g} px, N_F = {fresnel_number(design, wavelength):.3g}"
    return Estimate(size, note)


EFFECT = Effect("microlens_diffraction", "Microlens diffraction", "px", estimate, cost_per_pixel=20e-9)
