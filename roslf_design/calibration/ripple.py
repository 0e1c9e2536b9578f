"""The pixel grid's beat with the lattice, taken off measured centres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .lattice import Array

_LEAST_SPREAD = 0.3
"""Share of a wave over the pixel that must be independent of the lattice's own three columns."""


def without_ripple(
    nodes: Array, indices: NDArray[np.int64], offset: Array, good: NDArray[np.bool_], clip: float = 6.0
) -> Array:
    """Offsets of lenses from their nodes without the part that depends on where in its pixel a node lies.

    Sharp images on coarse pixels have centroids that are off by a few hundredths of a pixel, periodically in the node's
    place within its pixel, and not at all at the pixel's middle or edge, by symmetry: waves sin(2 pi x), sin(4 pi x).
    Where the lattice beats slowly with the grid (a pitch near a whole number of pixels, no rotation) that does not
    average out. The waves' two amplitudes, the same for x and y, are fitted together with the lattice; where all
    nodes lie alike in their pixels they cannot be told from a common shift, and stay.

    Parameters
    ----------
    nodes : ndarray
        Where the lenses are about [px], shape (n, 2).
    indices : ndarray of int
        Shape (n, 2).
    offset : ndarray
        Measured centre minus node [px], shape (n, 2).
    good : ndarray of bool
        Lenses to fit.
    clip : float
        Offsets farther from the median than this many robust standard deviations are not fitted.
    """
    waves = np.stack([np.sin(2 * np.pi * nodes), np.sin(4 * np.pi * nodes)], axis=-1)  # (n, 2, 2)
    away = np.abs(offset - np.median(offset[good], axis=0))
    used = good & (away <= clip * 1.4826 * np.median(away[good], axis=0) + 1e-9).all(axis=1)
    design = np.column_stack([np.ones(len(indices)), indices - indices[used].mean(axis=0)])[used]
    basis = np.linalg.qr(design)[0]
    seen = waves[used].reshape(len(basis), 4)
    free = (seen - basis @ (basis.T @ seen)).reshape(-1, 2, 2)
    rest = offset[used] - basis @ (basis.T @ offset[used])
    columns, target = free.reshape(-1, 2), rest.ravel()
    spread = np.sqrt(np.square(columns).mean(axis=0) / 0.5)
    kept = spread > _LEAST_SPREAD
    if not kept.any():
        return offset
    amplitude = np.zeros(2)
    amplitude[kept] = np.linalg.lstsq(columns[:, kept], target, rcond=None)[0]
    return offset - waves @ amplitude
