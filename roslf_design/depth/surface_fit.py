"""Least-squares fit of a surface to measured points, with the covariance of its parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array


def fitted(
    distance: Callable[[Array], Array], start: Array, sigma: Array, window: float, strays: float = 0.0
) -> tuple[Array, Array, Array]:
    """Parameters of a surface, their covariance, and the points' distances from it.

    Points that scatter more than their errors say, as a texture puts them off, widen the covariance (Birge).

    Parameters
    ----------
    distance : callable
        Distances of the points from the surface with some parameters, shape (n,) [mm].
    start : ndarray
        Parameters to begin with.
    sigma : ndarray, shape (n,)
        Standard errors of the distances, each point's own [mm].
    window : float
        Points that share a measurement, and err alike.
    strays : float
        Share of the points, those farthest off, that do not count.
    """
    from scipy.optimize import least_squares

    used = np.ones(sigma.size, bool)
    rates = np.zeros((0, 0))

    def left(at: Array, some: NDArray[np.bool_]) -> Array:
        return np.asarray(distance(at)[some] / sigma[some])

    for _ in range(3):
        fit = least_squares(left, start, args=(used,), method="lm")
        start, rates = fit.x, np.asarray(fit.jac)
        off = np.abs(distance(start)) / sigma
        before, used = used, off <= np.quantile(off, 1 - strays)
        if (used == before).all():
            break
    wider = max(1.0, float(np.mean(off[used] ** 2)))
    return start, np.asarray(np.linalg.pinv(rates.T @ rates) * window * wider, float), distance(start)
