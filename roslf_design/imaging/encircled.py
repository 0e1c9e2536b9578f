"""How much of one microlens's light stays in its geometric image, and in its own cell."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..effects.field import image_diameter, image_pitch
from .transfer import MicrolensTransfer

Floats = NDArray[np.float64]

PANEL = 16
"""Gauss-Legendre nodes for each oscillation of the spectra's product."""


class Encircled(NamedTuple):
    """Fractions of one unclipped microlens image's light, before pixels integrate."""

    disc: float
    """Inside its geometric disc."""
    cell: float
    """Inside a square of one image pitch about its centre."""


def encircled(design: Design, transfer: MicrolensTransfer | None = None) -> Encircled:
    """Energy that diffraction leaves inside, for an unclipped image.

    By Parseval, the light of the image ``P * K`` inside a shape S is the integral of the three spectra's product,
    which ends where the transfer function does: a finite integral of a smooth function.

    Parameters
    ----------
    design : Design
    transfer : MicrolensTransfer, optional
        None is the design's microlens in focus, in the design's wavelength.
    """
    from scipy.special import j1

    array = design.microlens_array
    if transfer is None:
        circular = array.lens_shape == "circular"
        transfer = MicrolensTransfer(design.d, design.d_2, 0.0, (design.wavelength,), circular)
    if not math.isfinite(transfer.cutoff):
        raise ValueError("without diffraction the integral does not end; all light is inside the geometric image")
    radius, pitch = image_diameter(design) / 2, abs(image_pitch(design))
    panels = math.ceil(2 * transfer.cutoff * max(2 * radius, pitch)) + 1
    nodes, weights = np.polynomial.legendre.leggauss(PANEL)
    edges = np.linspace(0, transfer.cutoff, panels + 1)
    step = edges[1] - edges[0]
    frequency = (edges[:-1, None] + step * (nodes + 1) / 2).ravel()
    weight = np.tile(weights * step / 2, panels)
    height = np.hypot(frequency[:, None], frequency)
    spectrum = radius * j1(2 * math.pi * radius * height) / height
    passed = spectrum * transfer(frequency[:, None], frequency) * (4 * weight[:, None] * weight)
    box = pitch * np.sinc(frequency * pitch)
    area = math.pi * radius**2
    return Encircled(float((passed * spectrum).sum() / area), float((passed * box[:, None] * box).sum() / area))
