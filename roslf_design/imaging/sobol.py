"""Sobol points, as 32-bit integers that an exclusive-or scrambles without losing their evenness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DIMENSIONS = 6
"""Pixel (x, y), microlens aperture (x, y), diffraction at the FAP (radius, angle)."""

BITS = 32

_POLYNOMIALS = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)), (3, 2, (1, 1, 1)), (4, 1, (1, 1, 3, 3)))
"""Degree, inner coefficients and first direction numbers of dimensions 2 to 6 (Joe and Kuo's choice)."""


def sobol_points(count: int) -> NDArray[np.uint32]:
    """First points of the Sobol sequence.

    Parameters
    ----------
    count : int
        How many; every power of two of them fills the unit cube evenly.

    Returns
    -------
    ndarray of uint32, shape (count, 6)
        Coordinates times 2^32.
    """
    directions = np.array([_first(), *(_directions(*row) for row in _POLYNOMIALS)], np.uint32)
    index = np.arange(count, dtype=np.uint32)
    gray = index ^ (index >> np.uint32(1))
    points = np.zeros((count, DIMENSIONS), np.uint32)
    for bit in range(BITS):
        chosen = ((gray >> np.uint32(bit)) & np.uint32(1)).astype(bool)
        points[chosen] ^= directions[:, bit]
    return points


def _first() -> list[int]:
    return [1 << (BITS - 1 - bit) for bit in range(BITS)]


def _directions(degree: int, inner: int, start: tuple[int, ...]) -> list[int]:
    numbers = [m << (BITS - 1 - bit) for bit, m in enumerate(start)]
    for bit in range(degree, BITS):
        value = numbers[bit - degree] ^ (numbers[bit - degree] >> degree)
        for k in range(1, degree):
            if (inner >> (degree - 1 - k)) & 1:
                value ^= numbers[bit - k]
        numbers.append(value)
    return numbers
