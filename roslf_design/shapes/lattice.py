"""Lattices of microlenses: square and hexagonal arrays, their nearest lens and their cells."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bore.part import Layout

Array = NDArray[np.float64]
Floats = NDArray[np.floating]


class _Packing:
    """Layout of microlenses that are one pitch apart along their rows."""

    corners: ClassVar[int]
    """Corners of a cell."""
    slant: ClassVar[float]
    """Shift of every other row [pitches]."""
    rise: ClassVar[float]
    """Distance between rows, and area of a cell [pitches]."""
    fold: ClassVar[float]
    """Frequency beyond which detail folds back, the least over all directions [1/pitch]."""
    orders: ClassVar[float]
    """Orders of the lattice's frequencies along an axis of theirs, over their reach in periods per pitch, at most."""

    @property
    def steps(self) -> Array:
        """Columns: steps of two indices in the array's frame [pitches]; the second leads to the next row."""
        return np.array([[1.0, self.slant], [0.0, self.rise]])

    def wave_up(self, first: Floats, second: Floats) -> Array:
        """Frequency square to the rows of a wave with so many periods along each of the two steps [1/pitch]."""
        raise NotImplementedError

    def in_cell(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """True where a place is nearer to the lens at the origin than to others [pitches]."""
        raise NotImplementedError

    def cell_spectrum(self, pitch: float, frequency: Array) -> Array:
        """Fourier transform of a cell about the origin, at all pairs of frequencies along y and x.

        Parameters
        ----------
        pitch : float
            Of the images [mm]; neighbours lie along x.
        frequency : ndarray, shape (N,)
            Above 0 [1/mm].

        Returns
        -------
        ndarray, shape (N, N)
            [mm^2]; rows are frequencies along y.
        """
        raise NotImplementedError


class _Square(_Packing):
    """Rows one pitch apart, one lens above the other."""

    corners, slant, rise, fold, orders = 4, 0.0, 1.0, 0.5, 1.0

    def wave_up(self, first: Floats, second: Floats) -> Array:
        """Frequency along the second step, which is square to the rows."""
        return second + 0 * first

    def in_cell(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """True within half a pitch along and across."""
        return np.asarray((np.abs(x) <= 0.5) & (np.abs(y) <= 0.5))

    def cell_spectrum(self, pitch: float, frequency: Array) -> Array:
        """One factor along each side."""
        box = pitch * np.sinc(frequency * pitch)
        return np.asarray(box[:, None] * box)


class _Hexagonal(_Packing):
    """Rows along x, each half a pitch further than the last."""

    corners, slant, rise, fold, orders = 6, 0.5, math.sqrt(3) / 2, 1 / math.sqrt(3), 1.4

    def wave_up(self, first: Floats, second: Floats) -> Array:
        """Frequency from both steps, 60 degrees apart."""
        return np.asarray((2 * second - first) / math.sqrt(3))

    def in_cell(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """True within half a pitch along three directions."""
        slant = np.sqrt(0.75) * y
        return np.asarray((np.abs(x / 2 + slant) <= 0.5) & (np.abs(x / 2 - slant) <= 0.5) & (np.abs(x) <= 0.5))

    def cell_spectrum(self, pitch: float, frequency: Array) -> Array:
        """Integral over a hexagon, row by row: as wide as the pitch up to half its height, then narrowing."""
        box = pitch * np.sinc(frequency * pitch)
        half = pitch / (2 * math.sqrt(3))
        across, up = math.pi * pitch * frequency, 2 * math.pi * half * frequency[:, None]
        one = np.sin((across + 3 * up) / 2) * np.sinc((up - across) / (2 * math.pi))
        other = np.sin((across - 3 * up) / 2) * np.sinc((up + across) / (2 * math.pi))
        return np.asarray(
            2 * half * np.sinc(2 * half * frequency)[:, None] * box + half * pitch * (one + other) / across
        )


PACKINGS: Mapping[str, _Packing] = MappingProxyType({"square": _Square(), "hexagonal": _Hexagonal()})
"""Layouts by their names in a design file."""


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
    """Place of its centre [mm]."""

    @property
    def row_spacing(self) -> float:
        """Distance between rows [mm]."""
        return self.pitch * PACKINGS[self.layout].rise


def _lens_indices(lattice: Lattice) -> NDArray[np.int64]:
    """Indices (i, j) of all lenses, shape (N, 2): j counts rows from the centre, i lenses along a row; row by row."""
    _check(lattice)
    rows = np.arange(-_rows(lattice), _rows(lattice) + 1)
    spans = [np.arange(low, high + 1) for low, high in zip(*_span(lattice, rows), strict=True)]
    i = np.concatenate(spans)
    return np.stack([i, np.repeat(rows, [len(s) for s in spans])], -1).astype(np.int64)


def lens_centres(lattice: Lattice, indices: ArrayLike | None = None) -> Array:
    """Centres [mm] of the lenses of these indices (..., 2), or of all as `_lens_indices` lists them; shape (..., 2)."""
    index = _lens_indices(lattice) if indices is None else np.asarray(indices)
    _check(lattice)
    x = lattice.pitch * (index[..., 0] + _offset(lattice, index[..., 1]))
    return _turned(np.stack([x, lattice.row_spacing * index[..., 1]], -1), lattice.rotation) + lattice.decentre


def nearest_lens(lattice: Lattice, points: ArrayLike) -> NDArray[np.int64]:
    """Indices (i, j) of the lens of the array nearest to each point [mm]; shape (..., 2).

    Points outside belong to the nearest lens at the rim. Of equally near lenses, one.
    """
    _check(lattice)
    point = _turned(np.asarray(points, float) - lattice.decentre, -lattice.rotation)
    spacing, last = lattice.row_spacing, _rows(lattice)
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
    if layout not in PACKINGS:
        raise ValueError(f"layout must be one of {', '.join(PACKINGS)}, not {layout!r}")
    corners = PACKINGS[layout].corners
    angle = np.asarray(rotation, float)[..., None] + np.pi * (2 * np.arange(corners) + 1) / corners
    radius = np.asarray(pitch, float)[..., None] / (2 * math.cos(math.pi / corners))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def _check(lattice: Lattice) -> None:
    if lattice.layout not in PACKINGS:
        raise ValueError(f"layout must be one of {', '.join(PACKINGS)}, not {lattice.layout!r}")
    if not (lattice.pitch > 0 and math.isfinite(lattice.pitch)):
        raise ValueError(f"pitch must be above 0 mm, not {lattice.pitch}")
    if not all(side >= lattice.pitch * (1 - 1e-9) and math.isfinite(side) for side in lattice.size):
        raise ValueError(f"size {lattice.size} mm must hold at least one microlens of pitch {lattice.pitch} mm")


def _rows(lattice: Lattice) -> int:
    """Rows on either side of the central one."""
    return _fitting(lattice.size[1] / lattice.row_spacing)


def _fitting(widths: float) -> int:
    """Lenses on either side of a central one in so many widths; 1e-9 for sizes that are multiples but for rounding."""
    return math.floor((widths - 1) / 2 + 1e-9)


def _offset(lattice: Lattice, row: NDArray[np.integer]) -> Array:
    """Shift of a row in pitches."""
    return np.asarray((row % 2) * PACKINGS[lattice.layout].slant)


def _span(lattice: Lattice, row: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last index along each row."""
    side = _fitting(lattice.size[0] / lattice.pitch)
    odd = (row % 2) * PACKINGS[lattice.layout].slant > 0
    # An odd row's lenses sit at i + 1/2: as many to the left (i = -1, ...) as to the right (i = 0, ...).
    half = math.floor(lattice.size[0] / lattice.pitch / 2 + 1e-9)
    low, high = np.where(odd, -half, -side), np.where(odd, half - 1, side)
    return low.astype(np.int64), high.astype(np.int64)


def _turned(points: Array, angle: float) -> Array:
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y = points[..., 0], points[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], -1)
