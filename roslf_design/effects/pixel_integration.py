"""Pixel box: a pixel records the mean over its own square, sinc(k q) on the image's spectrum. Never left out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import image_pitch
from .microlens_diffraction import blur_width


def transfer(frequency: ArrayLike, pixel: float) -> NDArray[np.float64]:
    """The box's transfer sinc(k q) at `frequency` k [1/mm] for pixels `pixel` = q wide [mm]."""
    return np.sinc(np.multiply(frequency, pixel))


def highest_harmonic(design: Design, wavelength: float) -> int:
    """Highest harmonic of the microlens-image pitch that diffraction lets through: floor(p/w), at least 1."""
    return max(1, math.floor(abs(image_pitch(design)) / blur_width(design, wavelength)))


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Share that a pixel takes of the image's highest harmonic."""
    order = highest_harmonic(design, brief.wavelength(design))
    cycles = order * design.q / abs(image_pitch(design))
    share = 1.0 if cycles >= 1 else float(1 - transfer(cycles, 1.0))
    return Estimate(share, f"takes {share:.2%} of harmonic {order} of the microlens-image pitch")


EFFECT = Effect("pixel_integration", "Pixel box", "intensity", estimate, always=True)
