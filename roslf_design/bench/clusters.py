"""Clusters of samples that err alike: the covariance that they leave of a fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array

_LEAST_LEFT = 0.05
"""Share of its variance that a cluster's residuals are taken to keep at least."""


def clustered_covariance(inverse: Array, scores: NDArray[Any], leverage: NDArray[Any]) -> Array:
    """Covariance of fitted parameters where residuals err alike within a cluster, shape (p, p).

    A cluster that draws the fit towards itself leaves less of its errors: its scores count for more by as much (HC2:
    MacKinnon and White, J. Econometrics 29, 305, 1985).

    Parameters
    ----------
    inverse : ndarray, shape (p, p)
        Inverse of the fit's normal matrix.
    scores : ndarray, shape (clusters, p)
        Residuals times columns, summed over each cluster.
    leverage : ndarray, shape (clusters,)
        Rates of a cluster's fitted values with its own, summed over it: 1 where it alone determines a parameter.
    """
    scores = scores / np.sqrt(np.maximum(1 - leverage, _LEAST_LEFT))[:, None]
    return np.asarray(inverse @ (scores.T @ scores) @ inverse)
