"""The drawing that README opens with: a light-field camera behind a bore, and what its lengths are called.

Run from the project's root: python docs/figures/system.py; it writes docs/figures/system.svg. Proportions are
chosen to be seen (no real camera has them), rays are traced.
"""

from __future__ import annotations

import math
from pathlib import Path

OUT = Path(__file__).with_suffix(".svg")
WIDTH, HEIGHT = 1180, 690
INK, SOFT, GLASS, WALL, BLUE, ORANGE = "#1a1a1a", "#5c5c5c", "#9cc3dd", "#8a8a8a", "#0072B2", "#D55E00"

AXIS = 190
"""Height of the optical axis on the page."""
LENS = 545
"""Where the main lens stands on the page; the lengths below count from it."""
D_F_PLANE, D_3, D_1, D_2 = 470.0, 190.0, 215.0, 34.0
"""d_f, d_3, d_1, d_2 as drawn."""
FAP, RADIUS, ARRAY = 27.0, 112.0, 60.0
"""Half of D_F, of D, of the microlens array."""


def line(x1: float, y1: float, x2: float, y2: float, colour: str = INK, width: float = 1.2, more: str = "") -> str:
    """A straight line."""
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="{width}" {more}/>'


def path(points: list[tuple[float, float]], colour: str, fill: str = "none", opacity: float = 1.0) -> str:
    """A polygon, or a line through points where nothing fills it."""
    d = "M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path d="{d}" stroke="{colour}" fill="{fill}" fill-opacity="{opacity}" stroke-width="1.3"/>'


def text(x: float, y: float, words: str, size: int = 15, anchor: str = "middle", colour: str = INK) -> str:
    """Words; "_" sets the next letter or figure low, "*" around words sets them bold."""
    parts, low, bold = [], False, False
    for letter in words:
        if letter == "_":
            low = True
        elif letter == "*":
            parts.append("</tspan>" if bold else '<tspan font-weight="bold">')
            bold = not bold
        elif low:
            parts.append(f'<tspan dy="4" font-size="{size - 4}">{letter}</tspan><tspan dy="-4">\u200b</tspan>')
            low = False
        else:
            parts.append(letter)
    look = f'font-size="{size}" text-anchor="{anchor}" fill="{colour}"'
    return f'<text x="{x:.1f}" y="{y:.1f}" {look}>{"".join(parts)}</text>'


def span(x1: float, x2: float, y: float, words: str) -> list[str]:
    """A horizontal dimension with its name in a gap of the line."""
    arrows = 'marker-start="url(#tip)" marker-end="url(#tip)"'
    middle = (x1 + x2) / 2
    narrow = x2 - x1 < 60
    shown = line(x1, y, x2, y, SOFT, 1, arrows)
    label = text(x2 + 16, y + 5, words, 17) if narrow else text(middle, y - 6, words, 17)
    return [shown, label]


def height(x: float, half: float, y: float, words: str, side: int) -> list[str]:
    """A vertical dimension about the height y, its name to the left (-1) or to the right (1)."""
    arrows = 'marker-start="url(#tip)" marker-end="url(#tip)"'
    anchor = "end" if side < 0 else "start"
    return [line(x, y - half, x, y + half, SOFT, 1, arrows), text(x + 8 * side, y + 6, words, 17, anchor)]


def pencil(point: float, colour: str) -> list[str]:
    """Light of a point in the focal plane that fills the FAP: through the lens, onto one microlens, to the sensor."""
    image = -point * D_1 / D_F_PLANE
    edges = []
    for rim in (FAP, -FAP):
        at_lens = point + (rim - point) * D_F_PLANE / (D_F_PLANE - D_3)
        behind = image + (image - at_lens) * D_2 / D_1
        heights = point, at_lens, image, behind
        places = LENS - D_F_PLANE, LENS, LENS + D_1, LENS + D_1 + D_2
        edges.append([(x, AXIS - y) for x, y in zip(places, heights, strict=True)])
    there, back = edges
    filled = [path([*there, *reversed(back)], "none", colour, 0.16)]
    return [*filled, *(path(edge, colour) for edge in edges)]


def camera() -> list[str]:
    """Side view, with the lengths below."""
    plane, fap, array = LENS - D_F_PLANE, LENS - D_3, LENS + D_1
    sensor = array + D_2
    wall = RADIUS + 10
    parts = [line(plane - 30, AXIS, sensor + 20, AXIS, SOFT, 0.8, 'stroke-dasharray="12 4 2 4"')]
    for side in (-1, 1):
        parts.append(line(fap, AXIS + side * wall, sensor + 8, AXIS + side * wall, WALL, 7))
        parts.append(line(fap, AXIS + side * FAP, fap, AXIS + side * (wall + 3.5), INK, 6))
    parts += pencil(0.0, BLUE) + pencil(58.0, ORANGE)
    bulge = 26
    top, bottom = AXIS - RADIUS, AXIS + RADIUS
    d = f"M{LENS} {top} Q{LENS + bulge} {AXIS} {LENS} {bottom} Q{LENS - bulge} {AXIS} {LENS} {top}Z"
    parts.append(f'<path d="{d}" fill="{GLASS}" fill-opacity="0.55" stroke="{INK}"/>')
    parts.append(line(plane, AXIS - 100, plane, AXIS + 100, SOFT, 1.5, 'stroke-dasharray="5 4"'))
    pitch = 2 * ARRAY / 8
    for k in range(8):
        y = AXIS - ARRAY + k * pitch
        parts.append(f'<path d="M{array} {y} q7 {pitch / 2} 0 {pitch} Z" fill="{GLASS}" stroke="{INK}"/>')
    parts.append(f'<rect x="{sensor}" y="{AXIS - ARRAY - 6}" width="7" height="{2 * ARRAY + 12}" fill="{INK}"/>')
    parts += [
        text(plane, AXIS - 110, "focal plane: in focus"),
        text(plane + 120, AXIS + 118, "restricted object space", 15, colour=SOFT),
        text(fap - 6, AXIS - wall - 14, "*FAP*, the bore's opening"),
        text(LENS + 18, AXIS - wall - 14, "main lens, f"),
        text(array - 24, AXIS - wall - 14, "microlens array", anchor="middle"),
        text(sensor + 16, AXIS - ARRAY - 16, "sensor", anchor="start"),
        text((fap + LENS) / 2, AXIS + wall - 10, "bore", 14, colour=SOFT),
        *height(fap - 15, FAP, AXIS, "D_F", -1),
        *height(LENS + 34, RADIUS, AXIS, "", 1),
        text(LENS + 42, AXIS + RADIUS - 12, "D", 17, "start"),
    ]
    low = AXIS + wall + 22
    for x in (plane, fap, LENS, array, sensor):
        parts.append(line(x, low - 14, x, low + (62 if x in (plane, LENS) else 22), SOFT, 0.7))
    parts += [
        *span(fap, LENS, low + 16, "d_3"),
        *span(LENS, array, low + 16, "d_1"),
        *span(array, sensor, low + 16, "d_2"),
    ]
    return [*parts, *span(plane, LENS, low + 54, "d_f")]


def behind_one_microlens(x: float, y: float) -> list[str]:
    """Enlarged: three microlenses and the pixels behind them."""
    pitch, reach, pixels = 62.0, 118.0, 5
    parts = [text(x + 60, y - 128, "*enlarged*", 15)]
    for k, colour in ((-1, ORANGE), (0, BLUE), (1, "#009E73")):
        middle = y + k * pitch
        half = pitch / 2
        edges = [(x, middle), (x + reach, middle - half), (x + reach, middle + half)]
        parts.append(path([(x - 46, middle - 12), (x, middle), (x - 46, middle + 12)], colour))
        parts.append(path([*edges, edges[0]], colour, colour, 0.16))
        d = f"M{x} {middle - half} q22 {half} 0 {pitch} q-22 {-half} 0 {-pitch} Z"
        parts.append(f'<path d="{d}" fill="{GLASS}" fill-opacity="0.6" stroke="{INK}"/>')
        for p in range(pixels):
            size = pitch / pixels
            top = middle - half + p * size
            box = f'x="{x + reach}" y="{top:.1f}" width="13" height="{size:.1f}"'
            parts.append(f'<rect {box} fill="white" stroke="{INK}"/>')
    parts += height(x - 62, pitch / 2, y, "d", -1)
    parts += [line(x, y + 100, x, y + 132, SOFT, 0.7), line(x + reach, y + 100, x + reach, y + 132, SOFT, 0.7)]
    parts += span(x, x + reach, y + 124, "d_2")
    parts += [text(x + reach + 20, y + 5, "pixels, q", 15, "start")]
    return [*parts, text(x + 60, y + 152, "one pixel: one direction", 14, colour=SOFT)]


def images(x: float, y: float, words: str, below: str, radius: float, cut: float | None = None) -> list[str]:
    """Nine microlens images on the sensor; a rim's disc that has moved by `cut` leaves of each what lies in both."""
    pitch = 44.0
    parts = []
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            cx, cy = x + i * pitch, y + j * pitch
            lit = f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="{radius}" '
            parts.append(
                f'{lit}fill="{"none" if cut else BLUE}" fill-opacity="0.38" stroke="{BLUE}" stroke-opacity="0.5"/>'
            )
            if cut:
                half = math.sqrt(radius**2 - cut**2 / 4)
                arc = f"A{radius} {radius} 0 0 1 {cx + cut / 2:.1f}"
                d = f"M{cx + cut / 2:.1f} {cy - half:.1f} {arc} {cy + half:.1f} {arc} {cy - half:.1f}Z"
                parts.append(f'<path d="{d}" fill="{BLUE}" fill-opacity="0.38"/>')
    return [*parts, text(x, y + 92, words), text(x, y + 112, below, 14, colour=SOFT)]


def drawing() -> str:
    """The whole SVG."""
    tip = (
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8" '
        f'orient="auto-start-reverse"><path d="M0 1.5 L10 5 L0 8.5 Z" fill="{SOFT}"/></marker></defs>'
    )
    row = 540
    parts = [
        *camera(),
        *behind_one_microlens(960, 190),
        text(40, 440, "*What the sensor sees behind its microlenses*", 16, "start"),
        *images(150, row, "*matched*", "images touch: every pixel counts", 22),
        *images(440, row, "*FAP too wide*", "images overlap: views mix", 27),
        *images(730, row, "*FAP too narrow*", "images leave gaps: pixels wasted", 15),
        *images(1020, row, "*cut by the lens's rim*", "cat's eyes at the field's edge", 22, 20),
    ]
    label = "Side view of a light-field camera behind a bore with its lengths, and microlens images in four cases"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}" '
    head += 'font-family="Helvetica, Arial, sans-serif">'
    return "\n".join([head, tip, f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>', *parts, "</svg>\n"])


if __name__ == "__main__":
    OUT.write_text(drawing(), encoding="utf-8")
