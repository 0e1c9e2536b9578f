"""Fates of light: what became of a ray and where, and what is left of a microlens image; with words for both."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

FATES = 8
"""Numbers for fates: a ray's state is so many times the number of the place where it ended, plus its fate."""


class RayFate(IntEnum):
    """Fate of one ray: whether it comes through, else what ended it. `state_at` adds where."""

    KEPT = 0
    """Passed everything; where a camera's sensor is traced to, it landed in its own microlens's cell."""
    CLIPPED = 1
    """Outside a clear aperture."""
    MISSED = 2
    """Does not meet a face, or from behind: no light travels there."""
    REFLECTED = 3
    """Totally reflected."""
    NO_PLANE = 4
    """Never reaches the plane that it is traced to."""
    INVALID = 5
    """Not a ray: something in it is not finite."""
    OFF_SENSOR = 6
    """Passed everything and missed the sensor."""
    NEIGHBOUR = 7
    """Passed everything and landed on the sensor, outside its own microlens's cell."""

    @property
    def words(self) -> str:
        """Words for it, with room for the place."""
        return _WORDS[self]


_WORDS = {
    RayFate.KEPT: "kept",
    RayFate.CLIPPED: "clipped at {}",
    RayFate.MISSED: "missed {}",
    RayFate.REFLECTED: "total internal reflection at {}",
    RayFate.NO_PLANE: "never reaches the plane",
    RayFate.INVALID: "not a ray (not finite)",
    RayFate.OFF_SENSOR: "off the sensor",
    RayFate.NEIGHBOUR: "in a neighbour's cell",
}


def state_at(place: int, fate: RayFate = RayFate.CLIPPED) -> int:
    """State of a ray that met its fate at a place, counted from 1; 0 for no place of its own."""
    return FATES * place + fate


def describe(state: int, name: Callable[[int], str] = "surface {}".format) -> str:
    """Words for a ray's state; `name` gives those of a place by its number."""
    place, fate = divmod(state, FATES)
    return RayFate(fate).words.format(name(place))


class ImageFate(IntEnum):
    """Fate of a microlens image, or of any disc that others cut: how much of it is left."""

    DARK = 0
    """Nothing."""
    CLIPPED = 1
    """A part."""
    FULL = 2
    """All of it."""
    FOLDED = 3
    """A caustic of the pupil lies in it: two of its points show the same point of the pupil."""

    @property
    def words(self) -> str:
        """Its word in tables and files."""
        return self.name.lower()
