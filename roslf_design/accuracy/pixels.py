"""Exact coverage of pixels by one microlens image, counted from a corner."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..microlens.coverage import coverage_image

Floats = NDArray[np.float64]


def covered_pixels(centres: Floats, radii: Floats, columns: int, rows: int, pixel: float = 1.0) -> Floats:
    """Share of each pixel that the common part of K discs covers.

    Parameters
    ----------
    centres, radii : ndarray
        Shapes (K, 2) and (K,), from the outer corner of pixel (0, 0).
    columns, rows : int
    pixel : float
        Pixel pitch.

    Returns
    -------
    ndarray, shape (rows, columns)
    """
    middle = (columns * pixel / 2, rows * pixel / 2)
    image = coverage_image(
        np.zeros(2), centres, radii, pixel=pixel, size=(columns, rows), sensor_centre=middle, dtype=np.float64
    )
    return np.asarray(image)
