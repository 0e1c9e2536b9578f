"""Common part of K ellipses: the microlens image where something is tilted."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _ellipses
from ._shapes import EMPTY
from .discs import DiscIntersection

Array = NDArray[np.float64]

INTERPRETED_BELOW = 64
"""Ellipses in all up to which compiling, or even loading compiled code, takes longer than it saves."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)


def intersect_ellipses(centres: ArrayLike, matrices: ArrayLike) -> DiscIntersection:
    """Common parts of K ellipses.

    Parameters
    ----------
    centres : array_like, shape (..., K, 2)
        [mm].
    matrices : array_like, shape (..., K, 3)
        (xx, xy, yy) of S in ``(p - centre)^T S^-1 (p - centre) = 1`` [mm^2].

    Returns
    -------
    DiscIntersection
        As `discs.intersect` gives for discs, ellipse 0 in the place of disc 0. Areas, positions and moments are right
        to about 1e-13 of ellipse 0 (its area, semi-axis and semi-axis squared); so is `lost_fraction`, here
        1 - `kept_fraction`.
    """
    c, s = np.asarray(centres, float), np.asarray(matrices, float)
    lead, k = c.shape[:-2], c.shape[-2]
    c, s = np.ascontiguousarray(c.reshape(-1, k, 2)), np.ascontiguousarray(s.reshape(-1, k, 3))
    n = len(c)
    results, status, clipping = np.empty((6, n)), np.empty(n, np.int8), np.empty((n, k), np.bool_)
    run = _ellipses.ellipse_shapes.interpreted if n * k <= INTERPRETED_BELOW else _ellipses.ellipse_shapes.compiled
    run(c, s, results, status, clipping, _NODES, _WEIGHTS)
    share, x, y, *moments = results
    dark = np.equal(status, EMPTY)
    centroid = np.where(dark[:, None], c[:, 0], np.stack([x, y], axis=-1))
    area = math.pi * np.sqrt(s[:, 0, 0] * s[:, 0, 2] - s[:, 0, 1] ** 2) * share
    return DiscIntersection(
        area.reshape(lead),
        centroid.reshape(*lead, 2),
        np.stack(moments, axis=-1).reshape(*lead, 3),
        share.reshape(lead),
        (1 - share).reshape(lead),
        status.reshape(lead),
        clipping.reshape(*lead, k),
    )
