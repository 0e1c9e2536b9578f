"""How sure the lengths of a camera are, and what that leaves uncertain in whatever follows from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .._arrays import Array
from ..camera import Camera

STEP = 0.05
"""Step of a length, for derivatives [standard deviations]."""


class LengthCovariance(NamedTuple):
    """Covariance of lengths of a camera."""

    places: tuple[str, ...]
    """Places of the lengths, such as "aperture.distance"."""
    matrix: Array
    """[mm^2] of lengths, shape (n, n)."""

    def of(self, places: tuple[str, ...]) -> LengthCovariance:
        """Covariance of some of the lengths."""
        some = [self.places.index(place) for place in places]
        return LengthCovariance(places, self.matrix[np.ix_(some, some)])

    def informed(self, information: Array) -> LengthCovariance:
        """Covariance with what measurements tell besides, ``(C^-1 + F)^-1``; never larger.

        Parameters
        ----------
        information : ndarray, shape (n, n)
            F of the likelihood alone [1/mm^2]. It may leave lengths open, as C may hold some exactly: neither is
            inverted.
        """
        values, vectors = np.linalg.eigh((information + information.T) / 2)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        moved = self.matrix @ root
        taken = moved @ np.linalg.solve(np.eye(len(values)) + root.T @ moved, moved.T)
        return LengthCovariance(self.places, self.matrix - (taken + taken.T) / 2)

    def carried(self, camera: Camera, compute: Callable[[Camera], Array]) -> Array:
        """Standard error of what is computed of a camera, ``sqrt(J C J^T)``: to first order (GUM 5.2).

        Parameters
        ----------
        camera : Camera
            With the lengths that are best known; its builds may have any shape (...).
        compute : callable
            Of cameras of shape (b, ...), an array of shape (b, ...), or (b, n) of single ones.

        Returns
        -------
        ndarray
            Shape (...) or (n,); NaN where there is nothing finite to derive.
        """
        sigma = np.sqrt(np.diag(self.matrix))
        uncertain = np.flatnonzero(sigma)
        steps = STEP * np.diag(sigma)[:, uncertain]
        offsets = np.concatenate([steps, -steps], axis=1).reshape(len(sigma), -1, *(1,) * len(camera.shape))
        lengths = {place: camera[place] + off for place, off in zip(self.places, offsets, strict=True)}
        with np.errstate(invalid="ignore"):
            values = np.asarray(compute(camera.replace(lengths)), float)
            values = np.broadcast_to(values, (2 * uncertain.size, *values.shape[1:]))
            ahead, behind = values[: uncertain.size], values[uncertain.size :]
            rates = np.moveaxis(ahead - behind, 0, -1) / (2 * STEP * sigma[uncertain])
            own = self.matrix[np.ix_(uncertain, uncertain)]
            variance = np.einsum("...i,ij,...j->...", rates, own, rates)
        return np.sqrt(np.where(variance < 0, 0.0, variance))  # below 0 by rounding alone
