"""Microlenses by name, and where they stand."""

from __future__ import annotations

from typing import Any, Literal, cast

from ..design import Design
from ..evaluation import default_fields

Place = Literal["centre", "edge", "corner"] | tuple[float, float]
"""A microlens: by name, or where it stands on the MLA [mm]."""

NAMES = ("centre", "edge", "corner")
"""Of what the sensor sees."""


def place_on_mla(design: Design, place: Place) -> tuple[float, float]:
    """Where a microlens stands [mm]."""
    return dict(zip(NAMES, default_fields(design), strict=True))[place] if isinstance(place, str) else place


def read_place(place: Any) -> Place:
    """A microlens by its name or its two coordinates [mm].

    Raises
    ------
    ValueError
        Neither.
    """
    if place in NAMES:
        return cast("Place", place)
    x, y = (float(value) for value in place)
    if not (abs(x) < 1e6 and abs(y) < 1e6):
        raise ValueError("a place on the MLA is two finite numbers")
    return x, y


def on_array(design: Design, x: float, y: float) -> tuple[float, float]:
    """The place on the array nearest to a point [mm]."""
    half_x, half_y = (side / 2 for side in design.microlens_array.size)
    return min(max(x, -half_x), half_x), min(max(y, -half_y), half_y)
