"""Information on the camera once the boards' poses are eliminated, and what it leaves undetermined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .errors import CalibrationError
from .lattice import Array

_SCALES = {"A": 100.0, "m": 0.4, "inverse_d_2": 0.5, "x_0": 100.0, "y_0": 100.0, "k_1": 10.0, "k_2": 1000.0}
_LOST = 0.3
"""Relative standard deviation of A, m or d_2 above which it counts as not determined."""


class Covariance(NamedTuple):
    """How well a fit knows its shared parameters."""

    names: tuple[str, ...]
    matrix: Array
    """Covariance, shape (p, p)."""
    condition: float
    """Condition number of the normal matrix with its columns scaled to unit length."""

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return {name: float(value) for name, value in zip(self.names, np.sqrt(np.diag(self.matrix)), strict=True)}

    @property
    def correlation(self) -> Array:
        """Correlation matrix, shape (p, p)."""
        sigma = np.sqrt(np.diag(self.matrix))
        result: Array = self.matrix / np.outer(sigma, sigma)
        return result

    def part(self, names: Sequence[str]) -> Array:
        """Covariance of the parameters named, in their order."""
        at = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(at, at)]


def reduced_information(shared: Array, own: Array) -> Array:
    """Fisher information on shared parameters with each board's own eliminated (Schur complement).

    Parameters
    ----------
    shared : ndarray
        Whitened derivatives by the shared parameters, shape (b, r, p): r residuals a board.
    own : ndarray
        Whitened derivatives by the board's own parameters, shape (b, r, k).

    Returns
    -------
    ndarray
        Shape (p, p). Computed from residuals of projections, not from a difference of products.
    """
    basis = np.linalg.qr(_unit_columns(own))[0]
    free = shared - basis @ (np.swapaxes(basis, 1, 2) @ shared)
    result: Array = np.einsum("brp,brq->pq", free, free)
    return result


def covariance_of(information: Array, names: Sequence[str]) -> Covariance:
    """Invert an information matrix after scaling it to unit diagonal.

    Raises
    ------
    CalibrationError
        A parameter has no information at all, or the matrix is singular: names what is lost.
    """
    names = tuple(names)
    diagonal = np.diag(information)
    typical = np.array([_SCALES.get(name, 1.0) for name in names])
    blind = [n for n, d, t in zip(names, diagonal, typical, strict=True) if not d * t * t > 1e-12]
    if blind:
        raise CalibrationError(f"the images do not determine {', '.join(map(readable, blind))}")
    scale = 1 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    condition = float(values[-1] / max(values[0], 1e-300))
    if values[0] < 1e-13 * values[-1]:
        share = np.abs(vectors[:, 0]) * scale / typical
        lost = [n for n, s in zip(names, share, strict=True) if s > 0.1 * share.max()]
        raise CalibrationError(f"the images do not determine {', '.join(map(readable, lost))}: rank loss")
    inverse = (vectors / values) @ vectors.T
    return Covariance(names, inverse * np.outer(scale, scale), condition)


def undetermined(covariance: Covariance, values: dict[str, float]) -> list[str]:
    """Parameters whose standard deviation exceeds 30 % of their value (A, m, d_2 only), in words."""
    sigma = covariance.sigma
    checked = [n for n in ("A", "m", "inverse_d_2") if n in sigma]
    return [readable(name) for name in checked if sigma[name] > _LOST * abs(values[name])]


def readable(name: str) -> str:
    """The paper's symbol for a parameter."""
    return {"inverse_d_2": "d_2"}.get(name, name)


def _unit_columns(matrix: Array) -> Array:
    length = np.sqrt(np.square(matrix).sum(axis=-2, keepdims=True))
    return matrix / np.where(length > 0, length, 1.0)
