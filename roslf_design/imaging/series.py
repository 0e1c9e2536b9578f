"""White images where neighbours are alike: an exact, finite Fourier series over the lattice of microlens images.

Unclipped images repeat with the lattice, and diffraction lets no frequency above d/(lambda d_2) pass: a handful of
harmonics (7 x 7 in the paper's camera) is the whole image, overlaps with all neighbours included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..effects.field import image_diameter
from ..effects.waves import pixel_box
from .camera import ImageLattice
from .transfer import MicrolensTransfer

Floats = NDArray[np.float64]

MOST_GROUPS = 400
"""Rows of harmonics beyond which convolution is the cheaper way."""

SMALLEST = 1e-9
"""Harmonics below this part of the mean are left out."""


@dataclass(frozen=True, eq=False)
class HarmonicSeries:
    """A periodic image, ``sum over G of C(G) exp(2 pi i G . p)``; of G and -G only one is kept, doubled."""

    frequencies: Floats
    """G [1/mm], shape (M, 2)."""
    coefficients: NDArray[np.complex128]
    """C(G), shape (M,)."""

    @property
    def groups(self) -> int:
        """How many different y frequencies there are."""
        return int(np.unique(np.round(self.frequencies[:, 1], 9)).size)

    def at(self, x: Floats, y: Floats) -> NDArray[np.float32]:
        """Values on a grid of sensor points.

        Parameters
        ----------
        x, y : ndarray
            Coordinates in the sensor's frame [mm].

        Returns
        -------
        ndarray of float32, shape (y.size, x.size)
        """
        along, across = self._bases(x, y)
        return across @ along

    def _bases(self, x: Floats, y: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Factors whose matrix product is the image; one column (row) pair for each y frequency."""
        heights, group = np.unique(np.round(self.frequencies[:, 1], 9), return_inverse=True)
        widths, place = np.unique(np.round(self.frequencies[:, 0], 9), return_inverse=True)
        waves = np.exp(2j * math.pi * np.outer(widths, x))
        along = np.empty((2 * heights.size, x.size), np.float32)
        across = np.empty((y.size, 2 * heights.size), np.float32)
        for n, height in enumerate(heights):
            mine = group == n
            wave = self.coefficients[mine] @ waves[place[mine]]
            along[2 * n], along[2 * n + 1] = wave.real, wave.imag
            phase = 2 * math.pi * height * y
            across[:, 2 * n], across[:, 2 * n + 1] = np.cos(phase), -np.sin(phase)
        return along, across


def harmonic_series(design: Design, transfer: MicrolensTransfer, pixel: bool = True) -> HarmonicSeries:
    """Series of the white image of a camera whose microlens images are all alike.

    Parameters
    ----------
    design : Design
        As planned: nothing vignettes, nothing is tilted.
    transfer : MicrolensTransfer
        With diffraction, as otherwise the series never ends.
    pixel : bool
        Whether pixels integrate over their squares.

    Returns
    -------
    HarmonicSeries
        Relative intensities: 1 inside a geometric image.
    """
    from scipy.special import j1

    lattice = ImageLattice.of(design)
    reciprocal = np.linalg.inv(lattice.image_axes).T
    limit = transfer.cutoff * (1.0 if transfer.circular else math.sqrt(2))
    most = [math.ceil(limit * np.linalg.norm(axis)) for axis in lattice.image_axes.T]
    m, n = np.meshgrid(np.arange(-most[0], most[0] + 1), np.arange(0, most[1] + 1))
    index = np.stack([m.ravel(), n.ravel()], -1)
    index = index[(index[:, 1] > 0) | (index[:, 0] >= 0)]  # one of each pair G, -G
    frequencies = index @ reciprocal.T
    radius = image_diameter(design) / 2
    height = np.hypot(*frequencies.T)
    safe = np.where(height > 0, height, 1.0)
    spectrum = np.where(height > 0, radius * j1(2 * math.pi * radius * safe) / safe, math.pi * radius**2)
    weight = spectrum / abs(np.linalg.det(lattice.image_axes)) * transfer(frequencies[:, 0], frequencies[:, 1])
    if pixel:
        weight = weight * pixel_box(frequencies[:, 0], design.q) * pixel_box(frequencies[:, 1], design.q)
    weight = weight * np.where(height > 0, 2.0, 1.0)
    kept = np.abs(weight) > SMALLEST * np.abs(weight).max()
    phase = np.exp(-2j * math.pi * frequencies[kept] @ lattice.image_origin)
    return HarmonicSeries(frequencies[kept], weight[kept] * phase)
