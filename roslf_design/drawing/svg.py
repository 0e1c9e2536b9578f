"""The printer for SVG: plain string work, so that a picture takes milliseconds; the same picture, the same bytes."""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Iterable
from html import escape
from itertools import groupby
from re import Match
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from .._arrays import Array
from ..words import SYMBOL, typographic
from .marks import Area, Disc, Dots, Image, Line, Mark, Point, Text
from .theme import PLAIN, SMALL, Theme, text_width

if TYPE_CHECKING:
    from .panel import Panel

NAMESPACE = "http://www.w3.org/2000/svg"
PIXELATED = "image-rendering:pixelated"
FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', Arial, sans-serif"
"""Fonts that a machine has already."""
SHAPES: dict[str, tuple[Point, ...]] = {
    "s": ((-0.85, -0.85), (0.85, -0.85), (0.85, 0.85), (-0.85, 0.85)),
    "D": ((0, -1.2), (1.2, 0), (0, 1.2), (-1.2, 0)),
    "^": ((0, -1.1), (1, 0.8), (-1, 0.8)),
    "v": ((0, 1.1), (1, -0.8), (-1, -0.8)),
    "<": ((-1.1, 0), (0.8, 1), (0.8, -1)),
    ">": ((1.1, 0), (-0.8, 1), (-0.8, -1)),
    "*": tuple(
        ((1.2, 0.5)[k % 2] * math.sin(k * math.pi / 5), -(1.2, 0.5)[k % 2] * math.cos(k * math.pi / 5))
        for k in range(10)
    ),
}
"""Corners of filled signs for a radius of 1, downwards positive."""
STROKES = {
    "x": (((-1, -1), (1, 1)), ((1, -1), (-1, 1))),
    "+": (((-1, 0), (1, 0)), ((0, -1), (0, 1))),
    "|": (((0, -1), (0, 1)),),
}
"""Lines of the others."""
HEAD = 6.0
"""Length of an arrow's head [px]."""


Look = dict[str, str | float | None]


def px(value: float) -> str:
    """A coordinate, to a hundredth of a pixel."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def tag(name: str, content: str = "", /, **attributes: str | float | None) -> str:
    """One element; underscores in names of attributes stand for hyphens; None and "" leave one out."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{px(value) if isinstance(value, (int, float)) else escape(value)}"'
        for key, value in attributes.items()
        if value is not None and value != ""
    )
    return f"<{name}{given}>{content}</{name}>" if content else f"<{name}{given}/>"


def document(name: str, title: str, size: Point, panels: Iterable[Panel], theme: Theme) -> str:
    """A whole picture of panels, the later on top.

    Its name is unique on the page, gives ``data-testid="picture-NAME"`` and begins all identifiers; its title says what
    is seen, in one sentence, for those who cannot see it.
    """
    width, height = size
    start = _identifier(name)
    body = "".join(_panel(panel, theme, f"{start}-{number}") for number, panel in enumerate(panels))
    return tag(
        "svg",
        tag("title", escape(title, quote=False), id=f"{start}-title")
        + tag("rect", width=width, height=height, fill=theme.ground)
        + body,
        xmlns=NAMESPACE, viewBox=f"0 0 {px(width)} {px(height)}", width=width, height=height,
        role="img", aria_labelledby=f"{start}-title", data_testid=f"picture-{name}", font_family=FONT,
        font_size=PLAIN,
    )  # fmt: skip


def _identifier(name: str) -> str:
    """Identifier made of a name.

    Characters that would end a reference to it, as spaces and brackets, become their codes.
    """
    return re.sub(r"[^\w-]", lambda match: f"_{ord(match[0]):x}_", name)


def file_of(content: str | bytes) -> bytes:
    """A picture's SVG text as a file of its own; the bytes of another picture as they are."""
    if isinstance(content, bytes):
        return content
    return f'<?xml version="1.0" encoding="utf-8"?>\n{content}\n'.encode("utf-8", "backslashreplace")


DRAWN = {
    "svg": "viewBox width height role aria-labelledby data-testid font-family font-size",
    "title": "id",
    "g": "clip-path",
    "defs": "",
    "clipPath": "id",
    "pattern": "id width height patternUnits patternTransform",
    "rect": "x y width height fill fill-opacity",
    "line": "x1 y1 x2 y2 stroke stroke-width",
    "path": "d fill fill-opacity fill-rule stroke stroke-width stroke-dasharray opacity cursor data-testid",
    "circle": "cx cy r fill fill-opacity stroke stroke-width stroke-dasharray opacity cursor data-testid",
    "text": "x y fill font-size font-weight text-anchor transform stroke stroke-width stroke-linejoin paint-order "
    "data-testid",
    "tspan": "dy font-size font-style",
    "image": "x y width height preserveAspectRatio style href data-testid",
}
"""Every element that `document` writes, and its attributes."""
HARMLESS = re.compile(r"(?:url\(#[\w-]++\)|(?:rotate|rgba?)\([\d\s.,%-]*+\)|[\w\s.,:#%'+-])*+")
"""Values of attributes: nothing from elsewhere, nothing that a browser runs."""
PIXELS = re.compile(r"data:image/png;base64,[A-Za-z0-9+/=]*+")
DEEPEST = 16
"""Elements within each other."""


def redrawn(text: str, name: str) -> str:
    """A picture that `document` once wrote, written anew from what it shows: the same text.

    Parameters
    ----------
    text : str
        As it lay in a file, where anybody may have changed it.
    name : str
        The picture's.

    Raises
    ------
    ValueError
        It holds something that `document` never writes, such as a script.
    """
    if "<!" in text:
        raise ValueError("holds a declaration, a comment or raw text")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ValueError(f"is no SVG ({error})") from None
    if root.tag != f"{{{NAMESPACE}}}svg":
        raise ValueError("is no SVG")
    return _again(root, name, DEEPEST)


def _again(element: ElementTree.Element, name: str, depth: int) -> str:
    kind = element.tag.removeprefix(f"{{{NAMESPACE}}}")
    if kind not in DRAWN:
        raise ValueError(f"holds <{kind}>")
    if depth == 0:
        raise ValueError(f"holds elements more than {DEEPEST} deep")
    own = {"href": PIXELS, "style": re.compile(PIXELATED), "id": re.compile(f"{_identifier(name)}[\\w-]*")}
    for key, value in element.attrib.items():
        if key not in DRAWN[kind].split() or not own.get(key, HARMLESS).fullmatch(value):
            raise ValueError(f'holds {key}="{value[:60]}" on <{kind}>')
    inside = escape(element.text or "", quote=False) + "".join(
        _again(part, name, depth - 1) + escape(part.tail or "", quote=False) for part in element
    )
    space = {"xmlns": NAMESPACE} if kind == "svg" else {}
    return tag(kind, inside, **space, **element.attrib)


def _panel(panel: Panel, theme: Theme, name: str) -> str:
    left, top, width, height = panel.box
    behind, around = _axes(panel, theme)
    parts, clipped = [behind], False
    for clip, marks in groupby(enumerate(panel.marks), key=lambda numbered: numbered[1].clip):
        content = "".join(_mark(mark, panel, theme, f"{name}-{k}") for k, mark in marks)
        if clip and content:
            if not clipped:
                window = tag("clipPath", tag("rect", x=left, y=top, width=width, height=height), id=f"{name}-window")
                parts.append(tag("defs", window))
            clipped = True
            content = tag("g", content, clip_path=f"url(#{name}-window)")
        parts.append(content)
    return tag("g", "".join(parts) + around) if "".join(parts) or around else ""


def _axes(panel: Panel, theme: Theme) -> tuple[str, str]:
    """Lines behind the marks, and what stands around them."""
    (left, top, width, _), bottom = panel.box, panel.bottom
    right = left + width
    across, up = panel.ticks() if not panel.bare else (panel.x_ticks or (), panel.y_ticks or ())
    behind, around = [], []
    for value, label in across:
        x, _ = panel.at(value, panel.y.low)
        if "x" in panel.grid:
            behind.append(_line((x, top), (x, bottom), theme.grid))
        around.append(_line((x, bottom), (x, bottom + 4), theme.grey))
        around.append(_text((x, bottom + 16), label, theme.ink, SMALL, "middle"))
    side, sign, colour = (right, 1, theme.colour(panel.y_colour)) if panel.right else (left, -1, None)
    hue = colour or theme.colour(panel.y_colour)
    for value, label in up:
        _, y = panel.at(panel.x.low, value)
        if "y" in panel.grid and not panel.right:
            behind.append(_line((left, y), (right, y), theme.grid))
        if label or not panel.right:
            around.append(_line((side, y), (side + 4 * sign, y), colour or theme.grey))
        around.append(_text((side + 7 * sign, y + 4), label, hue, SMALL, "start" if panel.right else "end"))
    if not panel.bare:
        around += [_line((left, bottom), (right, bottom), theme.grey)] if not panel.right else []
        around.append(_line((side, top), (side, bottom), colour or theme.grey))
    if panel.x_label:
        # Long labels end where the panel does.
        half = text_width(panel.x_label) / 2
        middle = min(left + width / 2, max(right + 8 - half, half + 4))
        around.append(_text((middle, bottom + 33), panel.x_label, theme.ink, PLAIN, "middle"))
    if panel.y_label:
        wide = max((text_width(label, SMALL) for _, label in up), default=0.0)
        x = side + 22 + wide if panel.right else max(13.0, left - 17 - wide)
        around.append(_text((x, (top + bottom) / 2), panel.y_label, hue, PLAIN, "middle", turned=True))
    if panel.title:
        around.append(_text((left, top - 9), panel.title, theme.ink, PLAIN, bold=True))
    return "".join(behind), "".join(around)


def _mark(mark: Mark, panel: Panel, theme: Theme, name: str) -> str:
    more = {"data_testid": mark.testid}
    match mark:
        case Line():
            each = runs(panel.all_at(mark.x, mark.y))
            look: Look = {"stroke": theme.colour(mark.colour), "stroke_width": mark.width, "fill": "none"}
            faint = None if mark.opacity == 1 else mark.opacity
            lines = _path("".join(map(_corners, each)), **look, stroke_dasharray=mark.dash, opacity=faint, **more)
            return lines + "".join(_ends(mark, run, theme) for run in each)
        case Area():
            data = "".join(f"{_corners(run)}Z" for run in runs(panel.all_at(mark.x, mark.y)))
            look = _filled(mark, theme) | {"fill_rule": "evenodd"}
            if not mark.hatch:
                return _path(data, **look, **more)
            pattern = tag(
                "pattern", tag("path", d="M0,0V8", stroke=theme.colour(mark.fill), stroke_width=1), id=f"{name}-hatch",
                width=6, height=6, patternUnits="userSpaceOnUse", patternTransform="rotate(45)",
            )  # fmt: skip
            return tag("defs", pattern) + _path(data, **look | {"fill": f"url(#{name}-hatch)"}, **more)
        case Disc():
            x, y = panel.at(mark.x, mark.y)
            radius = mark.radius / abs(panel.per_px[0])
            if not radius < 1e4 or abs(x) > 2e4 or abs(y) > 2e4:
                return ""
            return tag("circle", cx=x, cy=y, r=radius, **_filled(mark, theme), **more)
        case Dots():
            return _dots(mark, panel, theme)
        case Text():
            x, y = panel.at(mark.x, mark.y)
            at, colour = (x + mark.dx, y + mark.dy), theme.colour(mark.colour)
            halo = theme.ground if mark.halo else ""
            text = _text(at, mark.text, colour, mark.size, mark.anchor, mark.bold, halo=halo, testid=mark.testid)
            if not mark.plate:
                return text
            wide, high = text_width(mark.text, mark.size) + 6, 1.15 * mark.size
            left, top = (
                at[0] - {"start": 3.0, "middle": wide / 2, "end": wide - 3}[mark.anchor],
                at[1] - 0.85 * mark.size,
            )
            return tag("rect", x=left, y=top, width=wide, height=high, fill=theme.ground, fill_opacity=0.85) + text
        case Image():
            return _image(mark, panel, theme)


def _filled(mark: Area | Disc, theme: Theme) -> Look:
    look: Look = {"fill": theme.colour(mark.fill), "fill_opacity": None if mark.opacity == 1 else mark.opacity}
    if mark.edge == "none":
        return look
    return look | {"stroke": theme.colour(mark.edge), "stroke_width": mark.width, "stroke_dasharray": mark.dash}


def runs(corners: Array) -> list[Array]:
    """Stretches between NaN."""
    known = ~np.isnan(corners).any(axis=1)
    if known.all():
        return [corners] if len(corners) else []
    cuts = np.flatnonzero(np.diff(known.astype(np.int8))) + 1
    return [run for run in np.split(corners, cuts) if not np.isnan(run[0]).any()]


def _corners(run: Array) -> str:
    return "M" + " ".join(f"{px(x)},{px(y)}" for x, y in run.tolist())


def _path(data: str, **look: str | float | None) -> str:
    return tag("path", d=data, **look) if data else ""


def _ends(mark: Line, run: Array, theme: Theme) -> str:
    if not mark.ends or len(run) < 2:
        return ""
    colour = theme.colour(mark.colour)
    parts = []
    for tip, before, first in ((run[-1], run[-2], False), (run[0], run[1], True)):
        if first and mark.ends == ">":
            continue
        away = tip - before
        length = float(np.hypot(*away))
        if length == 0:
            continue
        away = away / length
        side = np.array([-away[1], away[0]])
        if mark.ends == "|":
            parts.append(_line(tuple(tip - 4 * side), tuple(tip + 4 * side), colour, max(mark.width, 1.2)))
        else:
            head = min(HEAD, length / 2)
            back = tip - head * away
            corners = np.array([tip, back + 0.42 * head * side, back - 0.42 * head * side])
            parts.append(_path(_corners(corners) + "Z", fill=colour))
    return "".join(parts)


def _dots(mark: Dots, panel: Panel, theme: Theme) -> str:
    places = panel.all_at(mark.x, mark.y)
    places = places[~np.isnan(places).any(axis=1)]
    colour, r = theme.colour(mark.colour), mark.size
    more = {"opacity": None if mark.opacity == 1 else mark.opacity, "data_testid": mark.testid, "cursor": mark.cursor}
    if mark.shape in STROKES:
        data = "".join(
            f"M{px(x + r * a)},{px(y + r * b)}L{px(x + r * c)},{px(y + r * d)}"
            for x, y in places.tolist()
            for (a, b), (c, d) in STROKES[mark.shape]
        )
        return _path(data, stroke=colour, stroke_width=mark.width, fill="none", **more)
    look: Look = {"fill": colour}
    if mark.edge != "none":
        look |= {"stroke": theme.colour(mark.edge), "stroke_width": mark.width}
    if mark.shape == "o":
        if len(places) == 1:
            return tag("circle", cx=places[0, 0], cy=places[0, 1], r=r, **look, **more)
        half = f"a{px(r)},{px(r)} 0 1 0 "
        data = "".join(f"M{px(x - r)},{px(y)}{half}{px(2 * r)},0{half}{px(-2 * r)},0" for x, y in places.tolist())
    else:
        shape = r * np.array(SHAPES[mark.shape])
        data = "".join(_corners(place + shape) + "Z" for place in places)
    return _path(data, **look, **more)


def _line(start: Point, end: Point, colour: str, width: float = 1.0) -> str:
    return tag("line", x1=start[0], y1=start[1], x2=end[0], y2=end[1], stroke=colour, stroke_width=width)


def _text(
    at: Point, content: str, colour: str, size: float = PLAIN, anchor: str = "start", bold: bool = False, *,
    halo: str = "", turned: bool = False, testid: str = "",
) -> str:  # fmt: skip
    if not content:
        return ""
    around: Look = {"stroke": halo, "stroke_width": 3.5, "paint_order": "stroke", "stroke_linejoin": "round"}
    return tag(
        "text", _with_subscripts(content), x=at[0], y=at[1], fill=colour, font_size=size,
        text_anchor="" if anchor == "start" else anchor, font_weight="600" if bold else "",
        transform=f"rotate(-90 {px(at[0])} {px(at[1])})" if turned else "", **(around if halo else {}),
        data_testid=testid,
    )  # fmt: skip


def _with_subscripts(content: str) -> str:
    """Text as SVG: escaped, d_3 with a subscript that every browser knows; selecting it still gives its letters."""

    def lower(match: Match[str]) -> str:
        letter, index, over = match[1], match[2], match[3] or "\u200b"
        return (
            f'<tspan font-style="italic">{letter}</tspan><tspan dy=".28em" font-size="80%">{index}</tspan>'
            f'<tspan dy="-.224em">{over}</tspan>'
        )

    return SYMBOL.sub(lower, escape(typographic(content), quote=False))


def _image(mark: Image, panel: Panel, theme: Theme) -> str:
    if not np.size(mark.values):
        return ""
    from PIL import Image as Pixels

    stream = io.BytesIO()
    colours = theme.shades(mark.ramp, mark.shares)
    (left, first), (right, last) = panel.at(mark.box[0], mark.box[2]), panel.at(mark.box[1], mark.box[3])
    rows = colours if first < last else colours[::-1]
    Pixels.fromarray(np.ascontiguousarray(rows)).save(stream, "PNG", compress_level=6)
    data = base64.b64encode(stream.getvalue()).decode()
    return tag(
        "image", x=left, y=min(first, last), width=right - left, height=abs(last - first), preserveAspectRatio="none",
        style=PIXELATED, href=f"data:image/png;base64,{data}", data_testid=mark.testid,
    )  # fmt: skip
