"""Light, centroid and second moments of each microlens's cell: one pass over the pixels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import THREADS, kernel, prange
from .lattice import Array, CentreLattice


class CellMoments(NamedTuple):
    """Moments of the light inside each lens's Voronoi cell, about the cell's middle."""

    light: Array
    """Sum of the pixel values, shape (n,)."""
    offset: Array
    """Centroid minus the cell's middle [px], shape (n, 2)."""
    spread: Array
    """Central second moments xx, xy, yy [px^2], shape (n, 3)."""
    saturated: NDArray[np.int64]
    """Pixels at or above the saturation level in the cell."""


@kernel(parallel=True)
def _moments(
    image: NDArray[np.float32], x: Array, y: Array, normals: Array, halves: Array, limit: float, out: Array
) -> None:
    rows, columns = image.shape
    sides = halves.shape[0]
    reach = 0.0
    for m in range(sides):
        reach = max(reach, halves[m])
    reach = reach * 1.4143 + 1.0
    for n in prange(x.shape[0]):
        x0, y0 = x[n], y[n]
        light, mx, my, mxx, mxy, myy, hot = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(max(0, math.ceil(y0 - reach)), min(rows, math.floor(y0 + reach) + 1)):
            dy = float(row) - y0
            for column in range(max(0, math.ceil(x0 - reach)), min(columns, math.floor(x0 + reach) + 1)):
                dx = float(column) - x0
                weight, ex, ey = 1.0, dx, dy
                for m in range(sides):
                    along = normals[m, 0] * dx + normals[m, 1] * dy
                    depth = halves[m] - abs(along) + 0.5
                    if depth < 1.0:
                        weight *= max(depth, 0.0)
                        inward = 0.5 * (depth - 1.0) if along > 0.0 else 0.5 * (1.0 - depth)
                        ex += normals[m, 0] * inward
                        ey += normals[m, 1] * inward
                if weight > 0.0:
                    value = float(image[row, column])
                    if value >= limit and weight > 0.5:
                        hot += 1.0
                    value *= weight
                    light += value
                    mx += value * ex
                    my += value * ey
                    mxx += value * ex * ex
                    mxy += value * ex * ey
                    myy += value * ey * ey
        out[n, 0], out[n, 1], out[n, 2] = light, mx, my
        out[n, 3], out[n, 4], out[n, 5], out[n, 6] = mxx, mxy, myy, hot


def cell_moments(
    image: NDArray[np.float32], lattice: CentreLattice, centres: Array, saturation: float = math.inf, scale: float = 1.0
) -> CellMoments:
    """Moments of `image` in the Voronoi cells of `lattice` placed at `centres`.

    Pixels on a cell's side count in proportion to how far they reach inside.

    Parameters
    ----------
    image : ndarray of float32
        Shape (rows, columns).
    lattice : CentreLattice
        Gives the shape of the cells.
    centres : ndarray
        Middles of the cells [px], shape (n, 2).
    saturation : float
        Pixels at or above it are counted.
    scale : float
        Size of the window against the cell.

    Returns
    -------
    CellMoments
        A dark cell has zero offset and spread, never NaN.
    """
    normals, halves = lattice.cell()
    out = np.zeros((len(centres), 7))
    x, y = np.ascontiguousarray(centres[:, 0]), np.ascontiguousarray(centres[:, 1])
    with THREADS:
        _moments.compiled(np.ascontiguousarray(image), x, y, normals, scale * halves, float(saturation), out)
    light = out[:, 0]
    lit = light > 0
    safe = np.where(lit, light, 1.0)
    mean = out[:, 1:6] / safe[:, None] * lit[:, None]
    offset = mean[:, :2]
    squares = np.column_stack([offset[:, 0] ** 2, offset[:, 0] * offset[:, 1], offset[:, 1] ** 2])
    return CellMoments(light, offset, mean[:, 2:] - squares, out[:, 6].astype(np.int64))


def window_pull(image: NDArray[np.float32], lattice: CentreLattice, centres: Array, scale: float = 1.0) -> float:
    """Share of a cell's displacement that its centroid follows: 0 where images stand apart, towards 1 without contrast.

    Light at the sides of a cell drags the centroid along with the cell. For a periodic image the drag is the mean
    light on the sides over the mean light in the cell; here it is measured, by moving the cells to and fro.

    Parameters
    ----------
    image, lattice, centres, scale
        As in `cell_moments`; a few hundred centres are enough.

    Returns
    -------
    float
        So that ``centre = middle + offset / (1 - pull)``.
    """
    step = min(0.3, 0.05 * lattice.pitch)
    pulls = []
    for direction in np.asarray(lattice.first) / lattice.pitches[0], np.asarray(lattice.second) / lattice.pitches[1]:
        ahead = cell_moments(image, lattice, centres + step * direction, scale=scale).offset @ direction
        behind = cell_moments(image, lattice, centres - step * direction, scale=scale).offset @ direction
        pulls.append(1 + float(np.median(ahead - behind)) / (2 * step))
    return float(np.mean(pulls))
