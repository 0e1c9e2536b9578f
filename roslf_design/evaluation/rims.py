"""Every rim of a design in one list, and which of them limits the undistorted field (Eqs. 5-6, any number of rims)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..theory.stops import stop_margin


class Rim(NamedTuple):
    """A circular opening that light must pass."""

    name: str
    """"FAP", "main lens" or "stop 1" and so on, in the order of the design file."""
    diameter: float
    """[mm]."""
    distance: float
    """In front of the main lens [mm]; 0 is the lens."""
    decentre: tuple[float, float]
    """Against the main lens's centre [mm], from which the ideal lens images."""


class FieldLimit(NamedTuple):
    """What ends the undistorted field."""

    radius: float
    """Largest undistorted object radius at d_f, in the worst direction [mm]; inf where no field is too large."""
    rim: str
    """The rim that ends it or, where none does, the one that leaves the least room."""
    room: float
    """Smallest room between a field point's pencil and a rim, on that rim's plane [mm]; negative where it cuts."""


def rims(design: Design) -> tuple[Rim, ...]:
    """FAP first, then the main lens, then the further stops; decentres against the main lens."""
    lens_x, lens_y = design.main_lens.decentre
    names = ("FAP", *(f"stop {index}" for index in range(1, len(design.stops) + 1)))
    stops = [
        Rim(name, stop.diameter, stop.distance, (stop.decentre[0] - lens_x, stop.decentre[1] - lens_y))
        for name, stop in zip(names, design.all_stops, strict=True)
    ]
    return (stops[0], Rim("main lens", design.D, 0.0, (0.0, 0.0)), *stops[1:])


def field_limit(design: Design, object_radius: float) -> FieldLimit:
    """Largest undistorted field, and the room that is left at one.

    Parameters
    ----------
    design : Design
    object_radius : float
        |X_0| at which the room is told [mm], on the focal plane.

    Notes
    -----
    With decentres the worst direction counts: the bound holds all around.
    """
    pupil, *others = rims(design)
    gap = design.d_f - design.d_3

    def room(rim: Rim, radius: float) -> float:
        # Room at the worst azimuth: the field's offset adds to that of the decentres.
        between = pupil.distance - rim.distance
        offset = math.hypot(
            *(
                stop * gap - own * (design.d_f - rim.distance)
                for stop, own in zip(rim.decentre, pupil.decentre, strict=True)
            )
        )
        axial = float(stop_margin(rim.diameter, rim.distance, pupil.diameter, pupil.distance, design.d_f, (0.0, 0.0)))
        return (axial - 2 * offset - 2 * radius * abs(between)) / (2 * gap)

    def bound(rim: Rim) -> float:
        axial, between = room(rim, 0.0), abs(pupil.distance - rim.distance)
        if axial < 0:
            return 0.0
        return axial * gap / between if between else math.inf

    tightest = min(others, key=lambda rim: (bound(rim), room(rim, object_radius)))
    return FieldLimit(bound(tightest), tightest.name, min(room(rim, object_radius) for rim in others))


def axes_in_space(design: Design, axes: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """Microlens axes against the optical axis: the MLA's rotation and decentre applied; shape (N, 2) [mm]."""
    on_array = np.asarray(axes, float).reshape(-1, 2)
    cosine, sine = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    turned = on_array @ np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(turned + np.asarray(design.microlens_array.decentre))
