"""Where the microlenses are: square and hexagonal arrays, their nearest lens and their cells."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design.parts import Layout

Array = NDArray[np.float64]

LAYOUTS = ("square", "hexagonal")


class Lattice(NamedTuple):
    """A microlens array (MLA): lenses in rows along its own x axis, one of them at its centre.

    Hexagonal rows lie ``sqrt(3)/2`` of a pitch apart, odd ones half a pitch to the right. A lens belongs to the array
    if its cell's width and height (a pitch, or row spacing) fit into `size`.
    """

    pitch: float
    """d [mm], between the centres of neighbours."""
    size: tuple[float, float]
    """Width and height of the array along its own axes [mm]."""
    layout: Layout = "square"
    rotation: float = 0.0
    """Rotation of the array about its own centre [rad], counterclockwise."""
    decentre: tuple[float, float] = (0.0, 0.0)
    """Where its centre is [mm]."""


def lattice_steps(layout: Layout) -> Array:
    """Columns: steps of two indices in the array's frame [pitches]; the second leads to the next row."""
    return np.array([[1.0, 0.5], [0.0, math.sqrt(3) / 2]]) if layout == "hexagonal" else np.eye(2)


def row_spacing(lattice: Lattice) -> float:
    """Distance between rows [mm]."""
    return lattice.pitch * (math.sqrt(3) / 2 if lattice.layout == "hexagonal" else 1.0)


def lens_indices(lattice: Lattice) -> NDArray[np.int64]:
    """Indices (i, j) of all lenses, shape (N, 2): j counts rows from the centre, i lenses along a row; row by row."""
    _check(lattice)
    rows = np.arange(-_rows(lattice), _rows(lattice) + 1)
    spans = [np.arange(low, high + 1) for low, high in zip(*_span(lattice, rows), strict=True)]
    i = np.concatenate(spans)
    return np.stack([i, np.repeat(rows, [len(s) for s in spans])], -1).astype(np.int64)


def lens_centres(lattice: Lattice, indices: ArrayLike | None = None) -> Array:
    """Centres [mm] of the lenses of these indices (..., 2), or of all as `lens_indices` lists them; shape (..., 2)."""
    index = lens_indices(lattice) if indices is None else np.asarray(indices)
    _check(lattice)
    x = lattice.pitch * (index[..., 0] + _offset(lattice, index[..., 1]))
    return _turned(np.stack([x, row_spacing(lattice) * index[..., 1]], -1), lattice.rotation) + lattice.decentre


def nearest_lens(lattice: Lattice, points: ArrayLike) -> NDArray[np.int64]:
    """Indices (i, j) of the lens of the array nearest to each point [mm]; shape (..., 2).

    Points outside belong to the nearest lens at the rim. Of equally near lenses, one.
    """
    _check(lattice)
    point = _turned(np.asarray(points, float) - lattice.decentre, -lattice.rotation)
    spacing, last = row_spacing(lattice), _rows(lattice)
    middle = np.clip(np.rint(point[..., 1] / spacing), -last, last)
    # In a hexagonal array a neighbouring row may hold the nearest lens; one beyond those never does.
    row = np.clip(np.stack([middle + step for step in (-1, 0, 1)], -1), -last, last).astype(np.int64)
    low, high = _span(lattice, row)
    i = np.clip(np.rint(point[..., :1] / lattice.pitch - _offset(lattice, row)).astype(np.int64), low, high)
    dx = lattice.pitch * (i + _offset(lattice, row)) - point[..., :1]
    distance = np.where(low <= high, np.hypot(dx, spacing * row - point[..., 1:]), np.inf)
    best = np.argmin(distance, -1)[..., None]
    return np.concatenate([np.take_along_axis(i, best, -1), np.take_along_axis(row, best, -1)], -1)


def cell_polygon(layout: Layout, pitch: ArrayLike, rotation: ArrayLike = 0.0) -> Array:
    """Cell of a lattice about the origin: the points nearer to it than to any other lens or image.

    Parameters
    ----------
    layout : {"square", "hexagonal"}
    pitch : array_like
        Of the lenses or of their images [mm], shape (...).
    rotation : array_like
        Of the array [rad], shape (...).

    Returns
    -------
    ndarray
        Corners [mm], counterclockwise, shape (..., 4, 2) or (..., 6, 2).
    """
    if layout not in LAYOUTS:
        raise ValueError(f"layout must be one of {', '.join(LAYOUTS)}, not {layout!r}")
    corners = 4 if layout == "square" else 6
    angle = np.asarray(rotation, float)[..., None] + np.pi * (2 * np.arange(corners) + 1) / corners
    radius = np.asarray(pitch, float)[..., None] / (2 * math.cos(math.pi / corners))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def _check(lattice: Lattice) -> None:
    if lattice.layout not in LAYOUTS:
        raise ValueError(f"layout must be one of {', '.join(LAYOUTS)}, not {lattice.layout!r}")
    if not (lattice.pitch > 0 and math.isfinite(lattice.pitch)):
        raise ValueError(f"pitch must be above 0 mm, not {lattice.pitch}")
    if not all(side >= lattice.pitch * (1 - 1e-9) and math.isfinite(side) for side in lattice.size):
        raise ValueError(f"size {lattice.size} mm must hold at least one microlens of pitch {lattice.pitch} mm")


def _rows(lattice: Lattice) -> int:
    """Rows on either side of the central one."""
    return _fitting(lattice.size[1] / row_spacing(lattice))


def _fitting(widths: float) -> int:
    """Lenses on either side of a central one in so many widths; 1e-9 for sizes that are multiples but for rounding."""
    return math.floor((widths - 1) / 2 + 1e-9)


def _offset(lattice: Lattice, row: NDArray[np.integer]) -> Array:
    """Shift of a row in pitches."""
    return np.asarray((row % 2) * 0.5 if lattice.layout == "hexagonal" else np.zeros(np.shape(row)))


def _span(lattice: Lattice, row: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last index along each row."""
    side = _fitting(lattice.size[0] / lattice.pitch)
    odd = (row % 2 == 1) & (lattice.layout == "hexagonal")
    # An odd row's lenses sit at i + 1/2: as many to the left (i = -1, ...) as to the right (i = 0, ...).
    half = math.floor(lattice.size[0] / lattice.pitch / 2 + 1e-9)
    low, high = np.where(odd, -half, -side), np.where(odd, half - 1, side)
    return low.astype(np.int64), high.astype(np.int64)


def _turned(points: Array, angle: float) -> Array:
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y = points[..., 0], points[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], -1)
