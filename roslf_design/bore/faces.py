"""Faces of what stands before the main lens, as rows of the ray tracer (`..lenses.tracer`), in the system's axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lenses.prescription import rotation
from ..lenses.tracer import COLUMNS, SPHERE
from .opening import ROW, ClearAperture
from .part import Number, PartNumbers

Floats = NDArray[np.float64]

KIND, LIMIT, TURNED = 6, 5, 7
"""Columns of a row: its kind, square of its semi-diameter, whether its axes are turned."""
STOP, HOLE = 15, 17
"""Kind of the row of a stop, which the tracer does not know as it bends nothing, and where the numbers of its opening
stand (`opening.inside`)."""
OPEN = 1e300
"""Square of a semi-diameter that lets everything through."""


class Face(NamedTuple):
    """Face that light meets."""

    row: Floats
    """Numbers of the ray tracer, (..., COLUMNS)."""
    scene: Number
    """Index on its scene's side."""
    sensor: Number
    """Index on its sensor's side."""
    opening: str
    """Place of the opening that stops a ray here: "aperture", "elements.2.0"."""
    name: str
    """Name in messages: "plate 1, back"."""


class Surroundings(NamedTuple):
    """Surroundings of an element, as its faces depend on them."""

    medium: Number
    """Index of what lies on its scene's side."""
    pupil_ahead: Callable[[Number], Number]
    """Distance of the FAP's image for what lies at a distance, in the medium there [both mm before the lens]."""


def vertex_of(at: PartNumbers, z: Number) -> Floats:
    """Vertex of a part that stands z before the main lens [mm], (..., 3)."""
    return np.stack(np.broadcast_arrays(*at.pair("decentre"), np.negative(z)), axis=-1)


def axes_of(at: PartNumbers) -> Floats:
    """Axes of a part, (..., 3, 3)."""
    return rotation(*at.pair("tilt"))


def plane_row(vertex: Floats, axes: Floats, radius: Number, *others: Number) -> Floats:
    """Row of a plane face, with room for the builds of others of its numbers."""
    shape = np.broadcast_shapes(vertex.shape[:-1], axes.shape[:-2], np.shape(radius), *map(np.shape, others))
    row = np.zeros((*shape, COLUMNS))
    row[..., :3], row[..., 4], row[..., LIMIT] = vertex, 1.0, np.minimum(np.square(radius), OPEN)
    row[..., KIND], row[..., TURNED] = SPHERE, is_turned(axes)
    row[..., 8:17] = axes.reshape(*axes.shape[:-2], 9)
    return row


def stop_row(vertex: Floats, axes: Floats, opening: ClearAperture) -> Floats:
    """Row of a stop."""
    hole = opening.row()
    row = plane_row(vertex, axes, opening.reach, hole[..., 0])
    row[..., KIND], row[..., HOLE : HOLE + ROW] = STOP, hole
    return row


def is_turned(axes: Floats) -> NDArray[np.bool_]:
    """True where axes are not the system's own."""
    return np.asarray(np.any(axes != np.eye(3), axis=(-2, -1)))
