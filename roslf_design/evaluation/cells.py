"""Light in a microlens's own cell on the sensor: the lattice's cell at the images' pitch, about the chief ray."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import theory
from ..design import Design
from ..microlens.cells import area_in_polygon
from ..microlens.lattice import cell_polygon

Array = NDArray[np.float64]


def own_cell_area(design: Design, axes: Array, centres: Array, radii: Array) -> Array:
    """Area of each microlens image inside its own cell and on the sensor.

    Parameters
    ----------
    design : Design
    axes : ndarray
        Microlens axes in space [mm], shape (N, 2).
    centres, radii : ndarray
        Discs of the rims relative to those axes, the FAP first [mm], shapes (N, K, 2) and (N, K).

    Returns
    -------
    ndarray
        Shape (N,) [mm^2]; 0 where the images' pitch is 0, and with it the cell.
    """
    array = design.microlens_array
    pitch = abs(float(theory.microlens_image_pitch(design.d, design.d_2, design.f, design.d_f, design.d_3)))
    area = np.zeros(len(radii))
    if pitch == 0:
        return area
    cell = cell_polygon(array.layout, pitch, array.rotation)
    half, middle = np.asarray(design.sensor_size) / 2, np.asarray(design.sensor.decentre)
    for i, axis in enumerate(axes):
        polygon = clipped_to_box(centres[i, 0] + cell, middle - half - axis, middle + half - axis)
        if len(polygon) > 2:
            area[i] = area_in_polygon(centres[i], radii[i], polygon)
    return area


def clipped_to_box(polygon: Array, low: Array, high: Array) -> Array:
    """Part of a convex polygon inside an upright box; corners in order, fewer than three where nothing is left.

    Parameters
    ----------
    polygon : ndarray
        Corners in order, shape (M, 2).
    low, high : ndarray
        Opposite corners of the box, shape (2,).
    """
    for side in (0, 1):
        for sign, limit in ((1.0, high[side]), (-1.0, -low[side])):
            room = limit - sign * polygon[:, side]
            kept: list[Array] = []
            for i in range(len(polygon)):
                j = (i + 1) % len(polygon)
                if room[i] >= 0:
                    kept.append(polygon[i])
                if room[i] * room[j] < 0:
                    kept.append(polygon[i] + (polygon[j] - polygon[i]) * (room[i] / (room[i] - room[j])))
            polygon = np.array(kept).reshape(-1, 2)
    return polygon if _area(polygon) > 0 else np.empty((0, 2))


def _area(polygon: Array) -> float:
    if len(polygon) < 3:
        return 0.0
    x, y = (polygon - polygon[0]).T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))
