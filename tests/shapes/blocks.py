"""One common part pixel by pixel, and the paper's stops, for the tests of shapes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.shapes.coverage import coverage_image
from roslf_design.shapes.openings import Openings
from roslf_design.theory.stop_images import stop_discs

PAPER = roslf.load("paper")


class Block(NamedTuple):
    """The smallest block of pixels that holds a part."""

    area: NDArray[np.float64]
    first_row: int
    first_column: int
    x_edges: NDArray[np.float64]
    y_edges: NDArray[np.float64]


def pixel_areas(axis, centres, radii, *, pixel, size=(0, 0), sensor_centre=(0.0, 0.0)):
    """Area of one common part in each pixel it touches, on the grid that a sensor's place gives."""
    centre, radius = np.asarray(centres, float), np.asarray(radii, float)
    corner = np.array(sensor_centre) - 0.5 * np.array(size) * pixel
    middles, reach = (np.asarray(axis) - corner + centre) / pixel, radius[:, None] / pixel
    box = np.max(middles - reach, axis=0), np.min(middles + reach, axis=0)
    low, high = (np.floor(edge + room).astype(int) for edge, room in zip(box, (-1e-9, 1 + 1e-9), strict=True))
    if (box[0] >= box[1]).any():
        high = low + 1
    # The window's grid is the sensor's own: pixels count from its corner, wherever the part lies.
    far = np.maximum(high, 1) + np.maximum(-low, 0)
    shift = np.maximum(-low, 0)
    middle = corner + pixel * (0.5 * far - shift)
    rows, columns = (slice(int(low[k] + shift[k]), int(high[k] + shift[k])) for k in (1, 0))
    image = coverage_image(
        axis, centres, radii, pixel=pixel, size=tuple(far.tolist()), sensor_centre=tuple(middle), window=(rows, columns)
    )
    x_edges, y_edges = (corner[k] + pixel * np.arange(low[k], high[k] + 1) for k in (0, 1))
    return Block(image * pixel**2, int(low[1]), int(low[0]), x_edges, y_edges)


def paper_discs(axes, changes=None):
    """Discs of the FAP and the rims of the paper's bench, changed, behind microlenses at `axes` (..., 2)."""
    axes = np.asarray(axes, float)
    return stop_discs(Camera.of(PAPER.replace(changes or {})), axes[..., 0], axes[..., 1])


def area_in_polygon(centres, radii, polygon):
    """Area of the common part of discs in a convex polygon (..., M, 2), counterclockwise; leading axes broadcast."""
    centres, radii, polygon = (np.asarray(part, float) for part in (centres, radii, polygon))
    lead = np.broadcast_shapes(radii.shape[:-1], polygon.shape[:-2])
    centres, radii, polygon = (
        np.broadcast_to(part, (*lead, *part.shape[part.ndim - own :]))
        for part, own in ((centres, 2), (radii, 1), (polygon, 2))
    )
    areas = [Openings.of_discs(centres[at], radii[at]).area_in(polygon[at]) for at in np.ndindex(lead)]
    return np.array(areas, float).reshape(lead)


def area_in_rectangle(centres, radii, low, high):
    """`area_in_polygon` of an upright rectangle between two corners (..., 2)."""
    a, b = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
    corners = [a, np.stack([b[..., 0], a[..., 1]], -1), b, np.stack([a[..., 0], b[..., 1]], -1)]
    return area_in_polygon(centres, radii, np.stack(corners, -2))
