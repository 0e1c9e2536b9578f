"""How a build's deviations scatter inside their tolerance, by inverse cumulative distribution.

Every distribution is a map from a uniform number in (0, 1) to a deviation in units of the tolerance, symmetric about 0.
Random and low-discrepancy sampling therefore share one path, and members of a group can share their uniform number.
"""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

Distribution = Literal["normal", "uniform", "parabolic", "end-point"]
"""Names of the known distributions."""

DISTRIBUTIONS: tuple[Distribution, ...] = get_args(Distribution)

SMALLEST = 2.0**-53
"""Uniform numbers are kept this far from 0 and 1, so that no deviation is infinite."""


def deviation(distribution: Distribution, uniform: ArrayLike, truncation: float = 2.0) -> Array:
    """Deviations in units of the tolerance.

    Parameters
    ----------
    distribution : str
        "normal": sigma is tolerance / `truncation`, cut off at the tolerance. "uniform". "parabolic": density
        3 x^2 / 2, heaped towards the ends, as general ray tracers use the word. "end-point": either end, evenly.
    uniform : array_like
        In [0, 1].
    truncation : float
        Of "normal": the tolerance in sigmas.

    Returns
    -------
    ndarray
        In [-1, 1], same shape; ``-deviation(u) == deviation(1 - u)`` to rounding.

    Raises
    ------
    ValueError
        Unknown distribution, or a truncation that is not positive.
    """
    u = np.clip(np.asarray(uniform, dtype=np.float64), SMALLEST, 1 - SMALLEST)
    if distribution == "normal":
        return _truncated_normal(u, _positive(truncation))
    if distribution == "uniform":
        return np.asarray(2 * u - 1)
    if distribution == "parabolic":
        return np.cbrt(2 * u - 1)
    if distribution == "end-point":
        return np.where(u < 0.5, -1.0, 1.0)
    raise ValueError(f"distribution: {distribution!r} is not known; use one of {', '.join(DISTRIBUTIONS)}")


def standard_deviation(distribution: Distribution, truncation: float = 2.0) -> float:
    """Standard deviation of `deviation`, in units of the tolerance; parameters as there."""
    if distribution == "normal":
        k = _positive(truncation)
        if k < 0.02:
            # The plain form cancels here; moments of the density's series in k^2 do not.
            return math.sqrt((1 / 3 - k**2 / 10 + k**4 / 56) / (1 - k**2 / 6 + k**4 / 40))
        density = math.exp(-k * k / 2) / math.sqrt(2 * math.pi)
        return math.sqrt(1 - 2 * k * density / math.erf(k / math.sqrt(2))) / k
    return {"uniform": 1 / math.sqrt(3), "parabolic": math.sqrt(0.6), "end-point": 1.0}[distribution]


def _truncated_normal(u: Array, k: float) -> Array:
    from scipy.special import ndtr, ndtri

    tail = float(ndtr(-k))
    # From the nearer tail, where digits are not lost against 1.
    lower = np.minimum(u, 1 - u)
    size = -ndtri(tail + (1 - 2 * tail) * lower) / k
    return np.copysign(np.clip(size, 0.0, 1.0), u - 0.5)


def _positive(truncation: float) -> float:
    if not truncation > 0:
        raise ValueError(f"truncate: {truncation} is not above zero; give the tolerance in sigmas, e.g. 2")
    return truncation
