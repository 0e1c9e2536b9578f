"""SVG text without a plotting library: elements, text with subscripts, short numbers.

A picture is made anew at each move of a slider, so all this is plain string work: one picture takes milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape

from ...words import SYMBOL, typographic
from .theme import Theme

Point = tuple[float, float]

SMALL, PLAIN, LARGE = 11, 12, 13
"""Font sizes [px]; nothing is smaller."""
FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', Arial, sans-serif"
"""Fonts that a machine has already."""
GLYPH = 0.56
"""Mean width of a letter as a share of the font's size."""


def px(value: float) -> str:
    """A coordinate, to a hundredth of a pixel."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def short(value: float, digits: int = 4) -> str:
    """A number for people: `digits` significant digits, a power of ten only where it would be long."""
    if value == 0:
        return "0"
    if not math.isfinite(value):
        return "∞" if value > 0 else "−∞"
    if not 1e-4 <= abs(value) < 1e6:
        mantissa, power = f"{value:.{max(digits - 2, 0)}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        return f"{mantissa}×10{_raised(int(power))}".replace("-", "−")
    text = f"{value:.{digits}g}"
    if "e" in text:
        text = f"{float(text):.0f}"
    return text.replace("-", "−")


def _raised(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def tag(name: str, content: str = "", /, **attributes: str | float | None) -> str:
    """One element; underscores in names of attributes stand for hyphens, and None leaves one out."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{px(value) if isinstance(value, (int, float)) else escape(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return f"<{name}{given}>{content}</{name}>" if content else f"<{name}{given}/>"


def line(start: Point, end: Point, colour: str, width: float = 1.0, dash: str | None = None, **more: str) -> str:
    """A straight line."""
    return tag(
        "line", x1=start[0], y1=start[1], x2=end[0], y2=end[1], stroke=colour, stroke_width=width,
        stroke_dasharray=dash, **more,
    )  # fmt: skip


def path_of(points: Iterable[Point], closed: bool = False) -> str:
    """Corners as the data of a path."""
    corners = " ".join(f"{px(x)},{px(y)}" for x, y in points)
    return f"M{corners}{'Z' if closed else ''}" if corners else ""


def path(
    data: str, stroke: str = "none", width: float = 1.0, fill: str = "none", dash: str | None = None,
    **more: str | float | None,
) -> str:  # fmt: skip
    """A path; "" where it has no corners."""
    if not data:
        return ""
    return tag("path", d=data, fill=fill, stroke=stroke, stroke_width=width, stroke_dasharray=dash, **more)


def text_width(content: str, size: float = PLAIN) -> float:
    """About how wide a text is [px]."""
    # Of d_3 the underscore is not seen, and the index is small.
    return GLYPH * size * (len(content) - 1.2 * len(SYMBOL.findall(content)))


def text(
    at: Point, content: str, colour: str, size: float = PLAIN, anchor: str = "start", *,
    bold: bool = False, halo: str | None = None, turned: bool = False, **more: str,
) -> str:  # fmt: skip
    """A line of text, its baseline at `at`; d_3 gets its subscript.

    Parameters
    ----------
    at : (x, y)
        [px].
    content : str
        As one writes it in plain letters.
    colour : str
    size : float
        [px].
    anchor : {"start", "middle", "end"}
        What of the text is at `at`.
    bold : bool
    halo : str, optional
        Colour of an edge around the letters, for text over lines.
    turned : bool
        Upwards.
    **more
        Further attributes.
    """
    around: dict[str, str | float | None] = (
        {}
        if halo is None
        else {"stroke": halo, "stroke_width": 3.5, "paint_order": "stroke", "stroke_linejoin": "round"}
    )
    return tag(
        "text", _with_subscripts(content), x=at[0], y=at[1], fill=colour, font_size=size,
        text_anchor=None if anchor == "start" else anchor, font_weight="600" if bold else None,
        transform=f"rotate(-90 {px(at[0])} {px(at[1])})" if turned else None, **around, **more,
    )  # fmt: skip


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


def plated(at: Point, content: str, colour: str, ground: str, size: float = SMALL, anchor: str = "start") -> str:
    """A line of text on a plate of the ground's colour, for text on a line."""
    wide = text_width(content, size) + 6
    left = at[0] - {"start": 3.0, "middle": wide / 2, "end": wide - 3}[anchor]
    plate = tag("rect", x=left, y=at[1] - 0.85 * size, width=wide, height=1.15 * size, fill=ground, fill_opacity=0.85)
    return plate + text(at, content, colour, size, anchor)


def _with_subscripts(content: str) -> str:
    def lower(match: object) -> str:
        letter, index, over = match[1], match[2], match[3] or "\u200b"  # type: ignore[index]
        return (
            f'<tspan font-style="italic">{letter}</tspan><tspan dy=".28em" font-size="80%">{index}</tspan>'
            f'<tspan dy="-.224em">{over}</tspan>'
        )

    return SYMBOL.sub(lower, escape(typographic(content), quote=False))


def document(name: str, title: str, size: tuple[float, float], theme: Theme, body: Iterable[str], **more: str) -> str:
    """A whole picture.

    Parameters
    ----------
    name : str
        Unique on the page; gives ``data-testid="picture-NAME"`` and begins all identifiers.
    title : str
        What is seen, in one sentence, for those who cannot see it.
    size : (width, height)
        [px].
    theme : Theme
    body : iterable of str
        Elements.
    **more
        Further attributes.
    """
    width, height = size
    return tag(
        "svg",
        tag("title", escape(title, quote=False), id=f"{name}-title")
        + tag("rect", width=width, height=height, fill=theme.ground)
        + "".join(body),
        xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {px(width)} {px(height)}", width=width, height=height,
        role="img", aria_labelledby=f"{name}-title", data_testid=f"picture-{name}", font_family=FONT,
        font_size=PLAIN, **more,
    )  # fmt: skip


def clipped(name: str, box: tuple[float, float, float, float], content: str) -> str:
    """What of the content lies in a box (left, top, width, height); `name` is unique on the page."""
    left, top, width, height = box
    window = tag("clipPath", tag("rect", x=left, y=top, width=width, height=height), id=name)
    return tag("defs", window) + tag("g", content, clip_path=f"url(#{name})")
