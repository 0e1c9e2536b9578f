"""Is what a detector found really the board? Its corners must fit a plane and its cells alternate."""

from __future__ import annotations

import numpy as np

from .board import Board
from .homography import homography, mapped
from .lattice import Array

_STRAY = 0.06
"""Largest RMS distance of corners from a plane in perspective, in cells: distortion stays below, wrong grids above."""


def checked_grid(corners: Array, board: Board, picture: Array) -> Array | None:
    """Corners in the order of `Board.points`, or None where they are not this board's.

    Parameters
    ----------
    corners : ndarray
        Columns and rows, shape (n, 2), as a detector orders them.
    board : Board
    picture : ndarray
        Grey picture, to look at the cells.

    Returns
    -------
    ndarray or None
        Turned from across to down as the board's points are (some detectors mirror boards). Of the two orders half a
        turn apart, the one whose first cell is dark, where the board's colours tell them apart: an odd sum of cells
        across and down.
    """
    across, down = board.inner
    grid = corners.reshape(down, across, 2)
    along, downward = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * downward[1] - along[1] * downward[0] < 0:
        grid = grid[:, ::-1]
    places = np.stack(np.meshgrid(np.arange(across), np.arange(down)), axis=-1).reshape(-1, 2).astype(float)
    flat = grid.reshape(-1, 2)
    matrix = homography(places, flat)
    size = float(np.sqrt(abs(along[0] * downward[1] - along[1] * downward[0]) / ((across - 1) * (down - 1))))
    stray = mapped(matrix, places) - flat
    if not size > 2 or float(np.sqrt(np.square(stray).sum(axis=1).mean())) > _STRAY * size:
        return None
    cells = _cell_levels(matrix, board, picture)
    contrast = _contrast(cells)
    if contrast is None:
        return None
    turned = (board.columns + board.rows) % 2 == 1 and contrast > 0
    return flat[::-1] if turned else flat


def _cell_levels(matrix: Array, board: Board, picture: Array) -> Array:
    """Mean grey level of the inner quarter of each cell, shape (rows, columns); NaN outside the picture."""
    offset = np.array([-0.2, 0.0, 0.2])
    x = np.arange(board.columns)[:, None] - 0.5 + offset
    y = np.arange(board.rows)[:, None] - 0.5 + offset
    grid = np.stack(np.broadcast_arrays(x[None, :, None, :], y[:, None, :, None]), axis=-1).reshape(-1, 2)
    place = np.round(mapped(matrix, grid)).astype(int)
    rows, columns = picture.shape
    inside = (place[:, 0] >= 0) & (place[:, 0] < columns) & (place[:, 1] >= 0) & (place[:, 1] < rows)
    level = np.where(inside, picture[np.clip(place[:, 1], 0, rows - 1), np.clip(place[:, 0], 0, columns - 1)], np.nan)
    result: Array = level.reshape(board.rows, board.columns, 9).mean(axis=2)
    return result


def _contrast(cells: Array) -> float | None:
    """Mean level of cells like the first minus that of the others; None unless each stands out from its neighbours."""
    parity = np.where((np.add.outer(np.arange(cells.shape[0]), np.arange(cells.shape[1])) % 2) == 0, 1.0, -1.0)
    padded = np.pad(cells, 1, constant_values=np.nan)
    around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    known = np.isfinite(around)
    mean = np.where(known, around, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    step = (parity * (cells - mean))[np.isfinite(cells) & known.any(axis=0)]
    if step.size < 0.8 * cells.size:
        return None
    middle = float(np.median(step))
    return middle if (step * np.sign(middle) > 0.25 * abs(middle)).all() and middle != 0 else None
