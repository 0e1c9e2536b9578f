"""Which pictures the page has, in which of its views, and how each is made of a state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ..design import Design
from .link import Look
from .pictures.axes import Picture
from .pictures.meridional import meridional
from .pictures.theme import ThemeName
from .state import State

Size = tuple[int, int]


class Drawing(NamedTuple):
    """One picture of the page."""

    tab: str
    """The view that shows it."""
    label: str
    """Its heading."""
    size: Size
    """[px], until the browser tells how much room there is."""
    inputs: Callable[[State, Look], Any]
    """What it is a function of, besides theme and size: equal inputs, equal picture."""
    make: Callable[[Any, ThemeName, Size], Picture]
    """The inputs, theme and size to a picture."""


def _design(state: State, _: Look) -> Design:
    return state.design.thin_twin


DRAWINGS: dict[str, Drawing] = {
    "meridional": Drawing(
        "camera", "Rays in the meridional section", (1040, 280), _design,
        meridional,
    ),
}  # fmt: skip
"""By the name that addresses and the page use."""

LEAST, MOST = 160, 3000
"""Sizes that a picture is made in [px]."""


def fitting(size: Any, fallback: Size) -> Size:
    """A size that the browser tells, kept within reason."""
    try:
        width, height = (round(float(value)) for value in size)
    except (TypeError, ValueError, OverflowError):
        return fallback
    return min(max(width, LEAST), MOST), min(max(height, LEAST), MOST)
