"""Quantities of a design over one or two of its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array
from ..camera import Camera
from ..design import Design
from .quantities import quantity_named


@dataclass(frozen=True, eq=False)
class Sweep:
    """Values of quantities at points of a line or a grid."""

    places: Mapping[str, Array]
    """Dotted place or symbol to its values; the first is the grid's first axis."""
    values: Mapping[str, Array]
    """Quantity to its values, shape (N,) or (N, M); nan where there is no camera."""
    units: Mapping[str, str]
    """Of each place and quantity."""


def sweep(design: Design, places: Mapping[str, ArrayLike], quantities: Sequence[str], at: float | None = None) -> Sweep:
    """Quantities over one or two numbers of a design, all points at once.

    Parameters
    ----------
    design : Design
        Gives every other number.
    places : mapping
        One or two dotted places ("aperture.distance") or symbols ("d_3") to their values [mm, rad]. Of f, d_f and d_1
        the same one follows as in `Design.replace`.
    quantities : sequence of str
        Names in `QUANTITIES`, of whole cameras.
    at : float, optional
        Distance ahead of the bore's tip for quantities that are asked for at one [mm]; None is the focal plane.

    Raises
    ------
    DesignError
        A place that the design has not.
    ValueError
        None or more than two places; a quantity that is not known, belongs to a field, or needs a distance.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> roslf.sweep(roslf.load("paper"), {"d_3": [20.0, 120.0]}, ["fill_factor"]).values["fill_factor"].round(3)
    array([0.689, 1.005])
    """
    if not 1 <= len(places) <= 2:
        raise ValueError(f"{len(places)} places given; sweep one or two")
    known = [quantity_named(name) for name in quantities]
    for quantity in known:
        if quantity.of is None:
            raise ValueError(f"{quantity.name} belongs to a field, not to a whole camera; take another")
        if quantity.at == "needed" and at is None:
            raise ValueError(f"{quantity.name} is asked for at a distance; give one")
    axes = {place: np.asarray(values, float).ravel() for place, values in places.items()}
    shape = tuple(len(values) for values in axes.values())
    grid = np.meshgrid(*axes.values(), indexing="ij")
    camera = Camera.of(design, {place: values.ravel() for place, values in zip(axes, grid, strict=True)})
    values, valid = {}, camera.valid
    with np.errstate(all="ignore"):  # of points that are no cameras
        for quantity in known:
            each = np.broadcast_to(quantity(camera, at if quantity.at != "never" else None), camera.shape)
            values[quantity.name] = np.where(valid, each, np.nan).reshape(shape)
    units = {quantity.name: quantity.unit for quantity in known}
    return Sweep(axes, values, units | {place: unit_of(place) for place in axes})


UNITS = {
    **dict.fromkeys(("rotation", "acceptance"), "rad"),
    "gradient": "/mm",
    "illuminance": "lx",
    "radiance": "W/m2/sr",
    "exposure": "s",
    **dict.fromkeys(
        ("index", "relay_magnification", "reflectance", "transmission", "quantum_efficiency", "full_well", "read_noise",
         "bits", "contrast", "window", "disparity_error"), "",
    ),
}  # fmt: skip
"""Base unit of places by their last name, where that is no length."""


def unit_of(place: str) -> str:
    """Base unit of a place: "mm" of lengths, "rad" of angles, none of plain numbers."""
    if any(f".{pose}." in place for pose in ("tilt", "wedge")):
        return "rad"
    return UNITS.get(place.rpartition(".")[2], "mm")
