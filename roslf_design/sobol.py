"""Direction numbers of the Sobol sequence, for points of trials and of rays."""

from __future__ import annotations

from functools import lru_cache, reduce
from operator import xor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

BITS = 32
"""Bits of a coordinate of the Sobol sequence, which so has 2^32 points."""


@lru_cache(maxsize=4)
def direction_numbers(dimensions: int) -> NDArray[np.int64]:
    """Direction numbers times 2^32, shape (dimensions, BITS).

    From the table of `scipy.stats.qmc.Sobol` (Joe and Kuo 2008): importing all of it takes half a second.
    """
    import scipy

    table = np.load(Path(scipy.__file__).parent / "stats" / "_sobol_direction_numbers.npz")
    polynomials, firsts = (table[name][:dimensions].astype(np.int64) for name in ("poly", "vinit"))
    numbers = np.ones((dimensions, BITS), np.int64)
    for row, polynomial, first in zip(numbers[1:], polynomials[1:].tolist(), firsts[1:], strict=True):
        degree = polynomial.bit_length() - 1
        row[:degree] = first[:degree]
        for k in range(degree, BITS):
            terms = (row[k - back] << back for back in range(1, degree + 1) if polynomial >> (degree - back) & 1)
            row[k] = reduce(xor, terms, row[k - degree])
    numbers <<= np.arange(BITS)[::-1]
    numbers.setflags(write=False)
    return numbers
