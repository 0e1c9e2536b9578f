"""Where searches start: low-discrepancy points in the unit box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def sobol_units(n: int, count: int, seed: int) -> NDArray[np.float64]:
    """Points of a scrambled Sobol sequence, shape (count, n), each inside (0, 1)."""
    from ..tolerance.draws import sobol_points

    return np.ascontiguousarray(sobol_points(n, 0, count, seed).T)
