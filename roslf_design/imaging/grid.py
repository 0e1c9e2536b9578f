"""The sensor's pixels: where they are, and pieces of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..errors import InputError, Problem


class Region(NamedTuple):
    """A rectangle of pixels."""

    column: int
    """First column."""
    row: int
    """First row."""
    columns: int
    """How many columns."""
    rows: int
    """How many rows."""

    @classmethod
    def whole(cls, design: Design) -> Region:
        """All of the sensor."""
        return cls(0, 0, *design.pixels)

    @classmethod
    def checked(cls, design: Design, region: tuple[int, int, int, int] | None) -> Region:
        """A region of the sensor; None is all of it.

        Raises
        ------
        InputError
            Outside the sensor, or empty.
        """
        if region is None:
            return cls.whole(design)
        width, height = design.pixels
        piece = cls(*region)
        inside = 0 <= piece.column < piece.column + piece.columns <= width
        if not (inside and 0 <= piece.row < piece.row + piece.rows <= height):
            message = (
                f"{tuple(region)} is no part of the sensor; give column, row, columns, rows within {width} x {height}"
            )
            raise InputError((Problem("region", message),))
        return piece


def pixel_centres(design: Design, region: Region, fine: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates of pixel centres in the sensor's frame [mm].

    Parameters
    ----------
    design : Design
    region : Region
        May reach beyond the sensor.
    fine : int
        Subpixels per pixel and axis.

    Returns
    -------
    x, y : ndarray
        Shapes (columns * fine,) and (rows * fine,); the sensor's centre is 0, rows count along +y.
    """
    width, height = design.pixels
    x = region.column + (np.arange(region.columns * fine) + 0.5) / fine - width / 2
    y = region.row + (np.arange(region.rows * fine) + 0.5) / fine - height / 2
    return x * design.q, y * design.q
