"""Shot and read noise of the sensor."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Rms noise sqrt(N + r^2)/N of a fully lit pixel [fraction of full scale]; zero where no exposure is given."""
    if brief.exposure is None:
        return Estimate(0.0, "the scene gives no exposure, so no noise is asked for")
    rms = math.sqrt(brief.exposure + brief.read_noise**2) / brief.exposure
    return Estimate(rms, f"{rms:.2%} rms at {brief.exposure:.4g} electrons and {brief.read_noise:.3g} read noise")


def add_noise(
    image: NDArray[np.float32], exposure: float, read_noise: float, generator: np.random.Generator
) -> NDArray[np.float32]:
    """An image as one exposure would record it.

    Parameters
    ----------
    image : ndarray
        Relative intensities; 1 is a fully lit pixel.
    exposure : float
        Electrons N at intensity 1.
    read_noise : float
        Rms r [electrons].
    generator : numpy.random.Generator
        Same state, same bytes.

    Returns
    -------
    ndarray
        Relative intensities again, which read noise may take below zero.
    """
    electrons = generator.poisson(np.maximum(image, 0).astype(np.float64) * exposure).astype(np.float32)
    if read_noise > 0:
        electrons += np.float32(read_noise) * generator.standard_normal(image.shape, np.float32)
    return electrons / np.float32(exposure)


EFFECT = Effect("noise", "Shot and read noise", "intensity", estimate, cost_per_pixel=50e-9)
