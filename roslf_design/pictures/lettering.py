"""Letters in pictures: how wide a text is, where it breaks, numbers as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..words import SYMBOL

SMALL, PLAIN = 11, 12
"""Sizes of letters [px]; nothing is smaller."""
GLYPH = 0.56
"""Mean width of a letter as a share of its size."""


def text_width(content: str, size: float = PLAIN) -> float:
    """About how wide a text is [px]."""
    # Of d_3 the underscore is not seen, and the index is small.
    return GLYPH * size * (len(content) - 1.2 * len(SYMBOL.findall(content)))


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


def short(value: float, digits: int = 4) -> str:
    """A number for people: `digits` significant digits, a power of ten only where it would be long."""
    if value == 0:
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


def rows_of_names(places: Sequence[float], widths: Sequence[float], gap: float = 0.0) -> list[int]:
    """Row of each name, from 0, such that no two touch; places are their middles, in order, in the widths' unit."""
    reached: list[float] = []
    rows = []
    for place, width in zip(places, widths, strict=True):
        row = next((r for r, end in enumerate(reached) if place - width / 2 > end), len(reached))
        reached[row : row + 1] = [place + width / 2 + gap]
        rows.append(row)
    return rows
