"""Targets as files: SVG and PDF, true to scale."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from ..._arrays import Array
from ...bench.targets import Sheet
from ...drawing.svg import FONT, NAMESPACE, file_of, px, tag
from ..printers import render_drawing

UM = 1e3
"""Units of a drawing in a millimetre: coordinates are micrometres, so that their hundredths are nothing."""


def target_files(sheets: Iterable[Sheet]) -> dict[str, bytes]:
    """Each target as `<kind>.svg` and `<kind>.pdf`."""
    drawings = {sheet.kind: (sheet, file_of(_svg(sheet))) for sheet in sheets}
    files = {f"{kind}.svg": svg for kind, (_, svg) in drawings.items()}
    return files | {f"{kind}.pdf": render_drawing(svg, *sheet.size) for kind, (sheet, svg) in drawings.items()}


def _svg(sheet: Sheet) -> str:
    """A target's drawing, its width and height in millimetres."""
    width, height = sheet.size
    (x, y), (end, _) = sheet.bar_places
    tick = 2.5 if sheet.bar >= 100 else 1.2
    stroke = tick / 10
    bar = tag(
        "path",
        d=f"M{px(UM * x)} {px(UM * y)}H{px(UM * end)}"
        + "".join(f"M{px(UM * at)} {px(UM * (y - tick))}V{px(UM * (y + tick))}" for at in (x, end)),
        fill="none", stroke="black", stroke_width=UM * stroke, data_testid="bar",
    )  # fmt: skip
    letters = 3.4 if sheet.bar >= 100 else 1.6
    stated = f"{sheet.bar:.2f} mm from tick to tick (their middles)"
    texts = [(w.x, w.y, w.text, w.size, w.middle) for w in sheet.words]
    texts.append(((x + end) / 2, y + tick + 1.3 * letters, stated, letters, True))
    body = tag("title", escape(sheet.title, quote=False)) + tag(
        "rect", width=UM * width, height=UM * height, fill="white"
    )
    body += tag("path", d="".join(map(_outline, sheet.dark)), fill="black", data_testid="target")
    body += "".join(
        tag("circle", cx=UM * cx, cy=UM * cy, r=UM * r, fill="none", stroke="black", stroke_width=UM * line)
        for cx, cy, r, line in sheet.rings
    )
    body += bar + "".join(
        tag(
            "text", escape(text, quote=False), x=UM * at, y=UM * down, fill="black", font_size=UM * size,
            text_anchor="middle" if middle else None,
        )
        for at, down, text, size, middle in texts
    )  # fmt: skip
    box = f"0 0 {px(UM * width)} {px(UM * height)}"
    return tag(
        "svg", body, xmlns=NAMESPACE, viewBox=box, width=f"{width:g}mm", height=f"{height:g}mm", font_family=FONT
    )  # fmt: skip


def _outline(polygon: Array) -> str:
    """Path of a polygon; of a rectangle along the axes a short one."""
    places = UM * polygon
    sides = places[1] - places[0], places[2] - places[1]
    start = f"M{px(places[0][0])} {px(places[0][1])}"
    if len(places) == 4 and sides[0][1] == 0 and sides[1][0] == 0:
        return f"{start}H{px(places[1][0])}V{px(places[2][1])}H{px(places[0][0])}z"
    return start + "".join(f"L{px(x)} {px(y)}" for x, y in places[1:]) + "z"
