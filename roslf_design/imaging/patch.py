"""A few pixels of the white image around one microlens, with diffraction, quickly enough for a slider."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..effects import plan
from ..shapes.coverage import LARGEST_PART, coverage, coverage_bands
from ..shapes.discs import shapes
from ..theory.exit_pupil import microlens_image_diameter
from .camera import ImageLattice, Region, planned_camera
from .transfer import MicrolensTransfer, fineness
from .white import FRAME, WhiteGeometry

Floats = NDArray[np.float64]

NEIGHBOURS = 1.5
"""Microlens pitches around the patch that lend their light."""
MOST_IMAGES = 400
"""Microlenses that may light one pixel; beyond, their images are one grey."""
MOST = 256
"""Subpixels across the patch and its surroundings."""
KEPT = ("+microlens_diffraction", "+overlap")
"""What is on whatever its size."""


def white_patch(design: Design, columns: slice, rows: slice) -> Floats | None:
    """Pixels of the white image with diffraction at the microlenses.

    Parameters
    ----------
    design : Design
        Tilts and aberrations are left out.
    columns, rows : slice
        Pixels of the sensor, counted from its left and its lower edge.

    Returns
    -------
    ndarray, shape (rows, columns), or None
        Relative intensities, 1 where geometry lights a whole pixel, as `render` with a white scene has them, but for
        light of microlenses more than `NEIGHBOURS` pitches away, for which those on the other side stand in, and for
        what coarser subpixels fold back: within about 1e-2 of full scale or of the brightest pixel. None where more
        than `MOST_IMAGES` images overlap or one is thousands of pixels wide.
    """
    effects = plan(design.thin_twin, overrides=KEPT)
    seen = planned_camera(design, effects)
    transfer = MicrolensTransfer.of(seen, effects)
    wide, high = columns.stop - columns.start, rows.stop - rows.start
    vast = 4 * microlens_image_diameter(seen) > LARGEST_PART * seen.q  # up to four subpixels a pixel
    if vast or (2 * ImageLattice.of(seen).neighbours) ** 2 > MOST_IMAGES:
        return None
    if wide <= 0 or high <= 0:
        return np.zeros((max(high, 0), max(wide, 0)))
    halo = min(FRAME, math.ceil(NEIGHBOURS * float(seen.d / seen.q)))
    fine = max(1, min(fineness(transfer, float(seen.q)), MOST // (max(wide, high) + 2 * halo)))
    region = Region(columns.start - halo, rows.start - halo, wide + 2 * halo, high + 2 * halo)
    light = WhiteGeometry.of(seen, effects).image(region, fine)
    step = float(seen.q) / fine
    frequency_y, frequency_x = np.fft.fftfreq(light.shape[0], step), np.fft.rfftfreq(light.shape[1], step)
    wave = np.fft.irfft2(np.fft.rfft2(light) * transfer(frequency_x, frequency_y[:, None]), s=light.shape)
    pixels = wave.reshape(light.shape[0] // fine, fine, -1, fine).mean((1, 3))
    return np.asarray(np.maximum(pixels[halo:-halo, halo:-halo], 0.0))


def warm_up() -> None:
    """Load the compiled kernels that pictures use (half a second, or several where they were never compiled)."""
    for kernel in (shapes, coverage, coverage_bands):
        _ = kernel.compiled
