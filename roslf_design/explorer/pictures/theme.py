"""Light and dark colours of the pictures: Okabe and Ito's, shifted where a dark ground asks for it."""

from __future__ import annotations

from typing import Literal, NamedTuple

ThemeName = Literal["light", "dark"]


class Theme(NamedTuple):
    """Colours of one picture; every hue is told apart with any colour vision, and text has a contrast above 4.5."""

    ground: str
    """Behind everything."""
    ink: str
    """Text and outlines."""
    grey: str
    """Secondary text, dimension lines."""
    grid: str
    """Lines behind the data."""
    pale: str
    """Fillings that recede."""
    blue: str
    sky: str
    green: str
    orange: str
    vermillion: str
    purple: str

    @property
    def fields(self) -> tuple[str, str, str]:
        """Centre, edge, corner."""
        return self.blue, self.green, self.purple

    @property
    def stops(self) -> tuple[str, ...]:
        """Further stops of the bore, again from the start where there are more."""
        return self.orange, self.green, self.purple, self.sky

    def level(self, level: str) -> str:
        """Colour of a verdict's level: "good", "limit" or "fault"."""
        return {"good": self.green, "limit": self.orange, "fault": self.vermillion}[level]


THEMES: dict[str, Theme] = {
    "light": Theme(
        ground="#ffffff", ink="#1a1d21", grey="#5f6368", grid="#e3e5e8", pale="#d5d8dc",
        blue="#0072b2", sky="#56b4e9", green="#007d5b", orange="#b87900", vermillion="#c14600", purple="#a8487f",
    ),
    "dark": Theme(
        ground="#171b21", ink="#e6e9ed", grey="#a4abb3", grid="#2c3238", pale="#454c54",
        blue="#4da8ea", sky="#9ad4f5", green="#2fc79a", orange="#f0b429", vermillion="#ff8a4c", purple="#e39ac4",
    ),
}  # fmt: skip


def theme_named(name: str) -> Theme:
    """The theme of that name.

    Raises
    ------
    ValueError
        There is none.
    """
    if name not in THEMES:
        raise ValueError(f"theme {name!r} is not known; use {' or '.join(THEMES)}")
    return THEMES[name]
