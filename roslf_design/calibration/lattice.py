"""The lattice of microlens images on the sensor: an origin, two vectors, and the fit that finds them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import CalibrationError

Array = NDArray[np.float64]
Layout = Literal["square", "hexagonal"]


@dataclass(frozen=True)
class CentreLattice:
    """Centres of the microlens images, in pixels; the centre of the sensor's first pixel is (0, 0), x right, y down.

    The node (i, j) is at ``origin + i first + j second``. `second` stands about 90 degrees (square) or 60 degrees
    (hexagonal) from `first`, towards +y. Nothing forces equal lengths or the exact angle: an anamorphic relay or a
    sheared array is a lattice too.
    """

    origin: tuple[float, float]
    first: tuple[float, float]
    second: tuple[float, float]
    layout: Layout

    @property
    def basis(self) -> Array:
        """`first` and `second` as the columns of a 2 x 2 matrix [px]."""
        return np.array([self.first, self.second]).T

    @property
    def pitches(self) -> tuple[float, float]:
        """Lengths of `first` and `second` [px]."""
        return math.hypot(*self.first), math.hypot(*self.second)

    @property
    def pitch(self) -> float:
        """Pitch of the regular lattice with the same cell area [px]."""
        area = abs(float(np.linalg.det(self.basis)))
        return math.sqrt(area if self.layout == "square" else area * 2 / math.sqrt(3))

    @property
    def rotation(self) -> float:
        """Angle from the sensor's +x to `first`, towards +y [rad]."""
        return math.atan2(self.first[1], self.first[0])

    def nodes(self, i: ArrayLike, j: ArrayLike) -> Array:
        """Positions of the nodes (i, j) [px], shape (..., 2); indices may be fractional."""
        i, j = np.broadcast_arrays(np.asarray(i, float), np.asarray(j, float))
        steps = i[..., None] * np.asarray(self.first) + j[..., None] * np.asarray(self.second)
        result: Array = np.asarray(self.origin) + steps
        return result

    def indices(self, xy: ArrayLike) -> Array:
        """Fractional indices (i, j) of positions `xy` [px], shape (..., 2); the inverse of `nodes`."""
        result: Array = (np.asarray(xy, float) - np.asarray(self.origin)) @ np.linalg.inv(self.basis).T
        return result

    def cell(self) -> tuple[Array, Array]:
        """Normals (n, 2) to the sides of a node's Voronoi cell and the half widths (n,) along them [px].

        Opposite sides share a row: two rows for a square cell, three for a hexagonal one.
        """
        a, b = np.asarray(self.first), np.asarray(self.second)
        across = np.array([a, b] if self.layout == "square" else [a, b, b - a])
        length = np.hypot(across[:, 0], across[:, 1])
        return across / length[:, None], length / 2

    def inside(self, shape: tuple[int, int], margin: float = 0.0) -> NDArray[np.int64]:
        """Indices (n, 2) of the nodes at least `margin` pixels inside an image of `shape` (rows, columns)."""
        rows, columns = shape
        corners = self.indices([[0, 0], [columns, 0], [0, rows], [columns, rows]])
        low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
        i, j = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1), indexing="xy")
        xy = self.nodes(i, j)
        kept = (
            (xy[..., 0] >= margin - 0.5)
            & (xy[..., 0] <= columns - 0.5 - margin)
            & (xy[..., 1] >= margin - 0.5)
            & (xy[..., 1] <= rows - 0.5 - margin)
        )
        return np.stack([i[kept], j[kept]], axis=-1).astype(np.int64)

    def recentred(self, i: int, j: int) -> CentreLattice:
        """The same lattice with node (i, j) called (0, 0)."""
        x, y = self.nodes(i, j)
        return CentreLattice((float(x), float(y)), self.first, self.second, self.layout)


class LatticeFit(NamedTuple):
    """A lattice, what it left over, and how well it is known."""

    lattice: CentreLattice
    residuals: Array
    """Measured minus fitted centre of every lens given [px], shape (n, 2)."""
    inliers: NDArray[np.bool_]
    covariance: Array
    """Of (origin, first, second) along one axis [px^2], shape (3, 3); the same for x and y."""

    @property
    def rms(self) -> float:
        """RMS length per axis of the inliers' residuals [px]."""
        return float(np.sqrt(np.mean(self.residuals[self.inliers] ** 2)))


def fit_lattice(
    indices: ArrayLike, centres: ArrayLike, layout: Layout, clip: float = 5.0, rounds: int = 6
) -> LatticeFit:
    """Least-squares lattice through measured centres, with outliers clipped at `clip` robust standard deviations.

    Parameters
    ----------
    indices : array_like
        Lattice indices (i, j), shape (n, 2).
    centres : array_like
        Measured positions [px], shape (n, 2).
    layout : {"square", "hexagonal"}
    clip : float
        Largest residual kept, in robust standard deviations per axis.
    rounds : int
        Most rounds of clipping.

    Raises
    ------
    CalibrationError
        With fewer than four lenses, or lenses in one line only.
    """
    ij, xy = np.asarray(indices, float), np.asarray(centres, float)
    used = np.ones(len(ij), bool)
    middle = ij.mean(axis=0) if len(ij) else np.zeros(2)
    design = np.column_stack([np.ones(len(ij)), ij - middle])
    for _ in range(rounds):
        if used.sum() < 4 or np.linalg.matrix_rank(design[used]) < 3:
            raise CalibrationError(
                f"a lattice needs at least four microlenses, not all in one line; got {int(used.sum())}"
            )
        solution = np.linalg.lstsq(design[used], xy[used], rcond=None)[0]
        residuals = xy - design @ solution
        distance = np.hypot(residuals[:, 0], residuals[:, 1])
        spread = float(np.median(distance[used])) / 1.1774  # the median length of a 2D normal vector is 1.1774 sigma
        kept = distance <= max(clip * spread, 1e-9)
        if np.array_equal(kept, used):
            break
        used = kept
    shift = np.array([[1.0, -middle[0], -middle[1]], [0, 1, 0], [0, 0, 1]])
    origin, first, second = shift @ solution
    freedom = max(2 * int(used.sum()) - 6, 1)
    variance = float(np.sum(residuals[used] ** 2)) / freedom
    covariance = shift @ np.linalg.inv(design[used].T @ design[used]) @ shift.T * variance
    lattice = CentreLattice(_pair(origin), _pair(first), _pair(second), layout)
    return LatticeFit(lattice, residuals, used, covariance)


def _pair(vector: Array) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])
