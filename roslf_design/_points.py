"""Points that fill a disc or a cube evenly, the same every time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
"""Turn between successive points of the sunflower [rad]."""


def sunflower(count: int) -> Floats:
    """Points that fill the unit disc evenly (Vogel's spiral).

    Parameters
    ----------
    count : int
        N.

    Returns
    -------
    ndarray, shape (2, N)
        The k-th at radius sqrt((k + 1/2)/N): equal areas, strictly inside.
    """
    k = np.arange(count)
    radius, angle = np.sqrt((k + 0.5) / count), k * GOLDEN_ANGLE
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


def recurrence(count: int, dimensions: int, shift: Floats | float = 0.5) -> Floats:
    """Points of the additive recurrence whose steps are powers of the generalised golden ratio.

    Parameters
    ----------
    count, dimensions : int
        N and D.
    shift : float or ndarray, shape (D,), optional
        Start of each coordinate; random shifts give independent sets of the same evenness.

    Returns
    -------
    ndarray, shape (D, N)
        In [0, 1).

    Notes
    -----
    The ratio g solves g^(D+1) = g + 1; coordinate i steps by g^-i modulo 1.
    """
    g = 2.0
    for _ in range(64):
        g = (1.0 + g) ** (1.0 / (dimensions + 1))
    steps = g ** -np.arange(1.0, dimensions + 1)
    starts = np.broadcast_to(np.asarray(shift, float), (dimensions,))
    return np.asarray((starts[:, None] + steps[:, None] * np.arange(1, count + 1)) % 1.0)
