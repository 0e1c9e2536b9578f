"""Which microlenses may speak for the lattice: the whole, lit, unsaturated ones whose image no stop has cut."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .lattice import Array

_HALF = 3
"""Shapes are averaged over 7 x 7 lenses before they are judged."""
_CUT = 0.003
"""Least ellipticity called a cut, where there are clear cuts. A disc of radius r that is cut to an ellipticity e has
its centroid moved by about r e/4 or a little more."""
_CLEAR = 0.015
"""A cut is clear above this; a field without one is taken whole, since slow changes of shape are then aberrations."""


class Reason(IntEnum):
    """Why a lens was left out of the lattice fit."""

    USED = 0
    BORDER = 1
    DARK = 2
    SATURATED = 3
    CUT = 4
    OUTLIER = 5
    BEYOND = 6

    @property
    def text(self) -> str:
        """One phrase for reports."""
        return {
            Reason.USED: "used",
            Reason.BORDER: "cell reaches over the image's edge",
            Reason.DARK: "too dark",
            Reason.SATURATED: "saturated pixels",
            Reason.CUT: "image cut by a stop (cat's eye)",
            Reason.OUTLIER: "off the lattice by over 5 sigma",
            Reason.BEYOND: "beyond the undistorted field",
        }[self]


class Shapes(NamedTuple):
    """How far each lens's neighbourhood departs in shape from the undistorted middle."""

    ellipticity: Array
    """Length of (xx - yy, 2 xy)/(xx + yy) minus its value in the middle, averaged over 7 x 7 lenses, shape (n,)."""
    threshold: float
    """Above it a lens counts as cut; infinite in a field without a clear cut."""

    @property
    def cut(self) -> NDArray[np.bool_]:
        """Lenses whose neighbourhood is cut."""
        return self.ellipticity > self.threshold


def judge_shapes(indices: NDArray[np.int64], spread: Array, good: NDArray[np.bool_], radius: Array) -> Shapes:
    """Compare the shape of the microlens images with that in the middle of the field.

    A stop that cuts a disc makes it narrower along the field's radius: its second moments become elliptical before its
    centroid moves by much. A shape common to all lenses (square lenses, astigmatism) is taken off first.

    Parameters
    ----------
    indices : ndarray of int
        Lattice indices, shape (n, 2).
    spread : ndarray
        Central second moments xx, xy, yy, shape (n, 3).
    good : ndarray of bool
        Lenses with a usable image.
    radius : ndarray
        Distance of each lens from the field's middle, any unit, shape (n,).
    """
    xx, xy, yy = spread.T
    total = np.where(xx + yy > 0, xx + yy, 1.0)
    shape = np.column_stack([(xx - yy) / total, 2 * xy / total])
    smooth = _neighbourhood_mean(indices, shape, good)
    noise = _noise(indices, shape, good) / (2 * _HALF + 1)
    threshold = _CUT + 4 * noise
    trusted = good & (radius <= max(float(np.quantile(radius[good], 0.15)), float(np.sort(radius[good])[:9][-1])))
    ellipticity = np.zeros(len(shape))
    for _ in range(8):
        departure = smooth - np.median(smooth[trusted], axis=0)
        ellipticity = np.hypot(departure[:, 0], departure[:, 1])
        grown = good & (ellipticity <= threshold)
        if np.array_equal(grown, trusted) or grown.sum() < 9:
            break
        trusted = grown
    clear = np.count_nonzero(ellipticity[good] > max(_CLEAR, threshold)) >= max(0.002 * good.sum(), 4)
    return Shapes(ellipticity, threshold if clear else float("inf"))


def _neighbourhood_mean(indices: NDArray[np.int64], values: Array, good: NDArray[np.bool_]) -> Array:
    """Mean of `values` over the good lenses within 3 indices of each lens; 0 where there are none."""
    low = indices.min(axis=0) - _HALF
    size = indices.max(axis=0) - low + _HALF + 1
    at = tuple((indices - low).T)
    count = np.zeros(size)
    count[at] = good
    out = np.empty_like(values)
    held = _box(count)[at]
    for k in range(values.shape[1]):
        grid = np.zeros(size)
        grid[at] = np.where(good, values[:, k], 0.0)
        out[:, k] = _box(grid)[at] / np.maximum(held, 1)
    return out


def _box(grid: Array) -> Array:
    """Sums over (2 _HALF + 1)^2 windows."""
    for axis in (0, 1):
        padded = np.insert(np.cumsum(grid, axis=axis), 0, 0.0, axis=axis)
        n = grid.shape[axis]
        top, bottom = np.minimum(np.arange(n) + _HALF + 1, n), np.maximum(np.arange(n) - _HALF, 0)
        grid = np.take(padded, top, axis=axis) - np.take(padded, bottom, axis=axis)
    return grid


def _noise(indices: NDArray[np.int64], values: Array, good: NDArray[np.bool_]) -> float:
    """Robust standard deviation of one lens's shape, from differences between neighbours along an index row."""
    order = np.lexsort((indices[:, 0], indices[:, 1]))
    ordered, usable = indices[order], good[order]
    pair = (np.diff(ordered[:, 0]) == 1) & (np.diff(ordered[:, 1]) == 0) & usable[1:] & usable[:-1]
    steps = np.diff(values[order], axis=0)[pair]
    return float(np.median(np.abs(steps))) * 1.4826 / np.sqrt(2) if len(steps) else 0.0
