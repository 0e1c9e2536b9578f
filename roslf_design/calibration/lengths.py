"""How sure the lengths of a calibrated camera are, and what that leaves uncertain in whatever follows from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..camera import Camera
from ..design import PATHS, Design
from .frames import Array
from .model import DataSheet
from .posterior import CameraDraws

STEP = 0.05
"""Step of a length, for derivatives [standard deviations]."""


class LengthCovariance(NamedTuple):
    """Covariance of lengths of a camera."""

    places: tuple[str, ...]
    """Places of the lengths, such as "aperture.distance"."""
    matrix: Array
    """[mm^2] of lengths, shape (n, n)."""

    @classmethod
    def of(cls, draws: CameraDraws, sheet: DataSheet) -> LengthCovariance:
        """Covariance of a design's calibrated lengths, elements before the lens included, from draws of them."""
        lengths = dict(draws.quantities)
        if (space := sheet.space_at(lengths)) is not None:
            lengths |= space.ruler(lengths)
        own = {PATHS[name]: lengths[name] for name in ("d_3", "d_1", "d_2", "d", "q")} | {PATHS["f"]: draws.draws("f")}
        drawn = own | {known.place: lengths[known.place] for known in sheet.uncertain}
        return cls(tuple(drawn), np.atleast_2d(np.cov(np.stack([*drawn.values()]))))

    def carried(self, design: Design, compute: Callable[[Camera], Array]) -> Array:
        """Standard error of what is computed of a camera, to first order.

        Parameters
        ----------
        design : Design
            As calibrated.
        compute : callable
            Of a camera of builds, shape (b,), an array of shape (b,) or (b, n).

        Returns
        -------
        ndarray
            Shape () or (n,); NaN where there is nothing finite to derive.
        """
        sigma = np.sqrt(np.diag(self.matrix))
        uncertain = np.flatnonzero(sigma)
        best = np.array([float(Camera.of(design)[place]) for place in self.places])
        steps = STEP * np.diag(sigma)[uncertain]
        lengths = best + np.concatenate([steps, -steps])
        with np.errstate(invalid="ignore"):
            values = np.asarray(compute(Camera.of(design, dict(zip(self.places, lengths.T, strict=True)))), float)
            values = np.broadcast_to(values, (len(lengths), *values.shape[1:]))
            rates = (values[: len(steps)] - values[len(steps) :]).T / (2 * STEP * sigma[uncertain])
            own = self.matrix[np.ix_(uncertain, uncertain)]
            variance = np.einsum("...i,ij,...j->...", rates, own, rates)
        return np.sqrt(np.where(variance < 0, 0.0, variance))  # below 0 by rounding alone
