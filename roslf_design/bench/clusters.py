"""Clusters of samples that err alike: the covariance that they leave of a fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array


def clustered_covariance(inverse: Array, scores: NDArray[Any], parameters: int) -> Array:
    """Covariance of fitted parameters where residuals err alike within a cluster, shape (p, p).

    Parameters
    ----------
    inverse : ndarray, shape (p, p)
        Inverse of the fit's normal matrix.
    scores : ndarray, shape (clusters, p)
        Residuals times columns, summed over each cluster.
    parameters : int
        Number of parameters that the clusters' count is lessened by.
    """
    count = len(scores)
    return np.asarray(inverse @ (scores.T @ scores) @ inverse * count / max(count - parameters, 1))
