"""Colours and letters of all pictures.

Marks name colours by what they are for ("ink", "blue", "grid"); a theme says which that is on its ground. Colours are
Okabe and Ito's, shifted where text or a dark ground asks for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..words import ROUNDING, SYMBOL

ThemeName = Literal["light", "dark"]

FIELDS = ("blue", "green", "purple")
"""Colours of centre, edge and corner."""
STOPS = ("orange", "green", "purple", "sky")
"""Colours of further stops of the bore, again from the start where there are more."""
MANY = ("blue", "orange", "green", "purple", "sky", "vermillion", "grey")
"""Colours of things without one of their own."""


class Theme(NamedTuple):
    """Colours on one ground; every hue is told apart with any colour vision, and text has a contrast above 4.5."""

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
    """Colour of what is blocked, and of the design itself."""
    purple: str
    whole: str
    """On maps: images that are kept whole, those cut a little and cut to nearly nothing, dark ones."""
    cut: str
    lost: str
    dark: str

    def colour(self, name: str) -> str:
        """Colour to write for a name; "none" and colours written as #rrggbb stay."""
        return name if name == "none" or name.startswith("#") else str(getattr(self, name))

    def shades(self, ramp: str, values: Array) -> NDArray[np.uint8]:
        """Colours of values from 0 to 1, shape (..., 4).

        Parameters
        ----------
        ramp : str
            "grey", "blues" or "cividis", even in lightness; "kept" for kept fractions of images; or a colour's name,
            which is the more opaque the larger the value is.
        values : ndarray
            Beyond 0 and 1 they count as those; NaN is transparent.
        """
        empty = np.isnan(values)
        share = np.clip(np.where(empty, 0.0, values), 0.0, 1.0)
        opaque = np.full(share.shape, 255.0)
        if ramp in RAMPS:
            stops, colours = zip(*RAMPS[ramp], strict=True)
            channels = [np.interp(share, stops, [colour[k] for colour in colours]) for k in range(3)]
        elif ramp == "kept":
            whole, cut, lost, dark = (rgb(colour) for colour in (self.whole, self.cut, self.lost, self.dark))
            channels = [
                np.where(share == 1, whole[k], np.where(share == 0, dark[k], lost[k] + (cut[k] - lost[k]) * share))
                for k in range(3)
            ]
        else:
            channels = [np.full(share.shape, float(part)) for part in rgb(self.colour(ramp))]
            opaque = 255 * share
        return np.stack([*channels, np.where(empty, 0.0, opaque)], -1).round().astype(np.uint8)


RAMPS: dict[str, tuple[tuple[float, tuple[int, int, int]], ...]] = {
    "grey": ((0.0, (0, 0, 0)), (1.0, (255, 255, 255))),
    "blues": (
        (0.0, (0, 0, 0)), (0.35, (0, 62, 112)), (0.6, (0, 114, 178)), (0.85, (86, 180, 233)), (1.0, (255, 255, 255)),
    ),
    "cividis": (
        (0.0, (0, 34, 78)), (0.25, (65, 77, 107)), (0.5, (124, 123, 120)), (0.75, (188, 175, 111)),
        (1.0, (254, 232, 56)),
    ),
}  # fmt: skip
"""Places from 0 to 1 and their colours; "cividis" (Nunez et al. 2018) is the same to every colour vision."""

THEMES: dict[str, Theme] = {
    "light": Theme(
        ground="#ffffff", ink="#1a1d21", grey="#5f6368", grid="#e3e5e8", pale="#d5d8dc",
        blue="#0072b2", sky="#56b4e9", green="#007d5b", orange="#b87900", vermillion="#c14600", purple="#a8487f",
        whole="#ccd8e6", cut="#fbe3b0", lost="#9a5200", dark="#15181b",
    ),
    "dark": Theme(
        ground="#171b21", ink="#e6e9ed", grey="#a4abb3", grid="#2c3238", pale="#454c54",
        blue="#4da8ea", sky="#9ad4f5", green="#2fc79a", orange="#f0b429", vermillion="#ff8a4c", purple="#e39ac4",
        whole="#2c3b50", cut="#8a6a1f", lost="#ffb74d", dark="#000000",
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


def stop_colour(number: int) -> str:
    """Colour of a stop: 0 is the FAP, further ones count from 1."""
    return "ink" if number == 0 else STOPS[(number - 1) % len(STOPS)]


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of #rrggbb, 0 to 255."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


SMALL, PLAIN = 11, 12
"""Sizes of letters [px]; nothing is smaller."""
LETTER = 0.63
"""Width of most letters and of digits as a share of their size, in DejaVu Sans, the widest of the fonts named."""
WIDTHS = {
    letter: width
    for width, letters in ((0.3, "ijlIJ'., "), (0.38, '/:;\\|f-t()[]!r"'), (0.54, "*_°sz?c"), (0.7, "VAKΔBRXZCUHNDGOQ"),
                           (0.84, "#+<=>~±×−≥≤→∞wM&"), (0.97, "m%W@"))
    for letter in letters
}  # fmt: skip
"""Width of characters, in font sizes, that differ from the average."""


def text_width(content: str, size: float = PLAIN) -> float:
    """About how wide a text is [px]."""
    # Of d_3 the underscore is not seen, and the index is small.
    lost = (WIDTHS["_"] + 0.2 * LETTER) * len(SYMBOL.findall(content))
    return size * (sum(WIDTHS.get(letter, LETTER) for letter in content) - lost)


def drawn_in(content: str, left: float, width: float, size: float = PLAIN, *, bold: bool = False) -> float:
    """Shift [px] of a text that starts at `left` of a picture, for it to end within its width: to its left edge."""
    over = left + text_width(content, size) * (1.12 if bold else 1.0) - width
    return -min(max(over, 0.0), max(left - 3, 0.0))


def wrapped(content: str, width: float, size: float = SMALL, most: int = 99) -> list[str]:
    """A text in lines no wider than `width` px; where there are more than `most`, the last ends in an ellipsis."""
    lines = [""]
    for word in content.split():
        longer = f"{lines[-1]} {word}".strip()
        if text_width(longer, size) <= width or not lines[-1]:
            lines[-1] = longer
        elif len(lines) < most:
            lines.append(word)
        else:
            lines[-1] = lines[-1].rstrip(" ,;:") + " …"
            break
    return lines


def short(value: float, digits: int = 4, zero: float = ROUNDING) -> str:
    """A number for people: `digits` significant digits, a power of ten only where it would be long; as `number`."""
    if value == 0 or abs(value) < zero:
        return "0"
    if not math.isfinite(value):
        return "∞" if value > 0 else "−∞"
    if not 1e-4 <= abs(value) < 1e6:
        mantissa, power = f"{value:.{max(digits - 2, 0)}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{mantissa}×10{raised}".replace("-", "−")
    text = f"{value:.{digits}g}"
    if "e" in text:
        text = f"{float(text):.0f}"
    return text.replace("-", "−")


def rows_of_names(places: Sequence[float], widths: Sequence[float]) -> list[int]:
    """Row of each name, from 0, such that no two touch; places are their middles, in order, in the widths' unit."""
    reached: list[float] = []
    rows = []
    for place, width in zip(places, widths, strict=True):
        row = next((r for r, end in enumerate(reached) if place - width / 2 > end), len(reached))
        reached[row : row + 1] = [place + width / 2]
        rows.append(row)
    return rows
