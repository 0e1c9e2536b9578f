"""One microlens image on its pixels: outline, the rims that cut it, its own cell; by rays or with diffraction."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ...errors import InputError, Problem
from ...evaluation.rims import axes_in_space, rims
from ...microlens.lattice import Lattice, lens_centres, nearest_lens
from ...report.figures.microlens_images import GRID_UP_TO, ImageView, image_view
from ..patch import white_patch
from .axes import Picture, Plot, Scale, frame, legend, moved
from .raster import image, ramp, shaded
from .svg import SMALL, clipped, document, line, path, path_of, short, tag, text
from .theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ...design import Design

UM = 1e3
LEFT, TOP, RIGHT, BELOW = 52.0, 42.0, 12.0, 42.0
"""Margins [px]."""
MOST_PIXELS = 90_000
"""In view; beyond, single ones would not be seen."""
ON_PICTURE = "#f0b429"
"""Outline on a picture that has both black and white."""


def microlens_image(
    design: Design, place: tuple[float, float], theme: ThemeName = "light", size: tuple[float, float] = (320, 380), *,
    diffraction: bool = False, pixels: bool = True, name: str = "microlens", label: str = "", key: bool = True,
) -> Picture:  # fmt: skip
    """Draw the image behind one microlens.

    Parameters
    ----------
    design : Design
        A real lens is taken as its thin twin, and tilts are left out.
    place : (x, y)
        On the MLA [mm]; the nearest microlens is shown.
    theme : {"light", "dark"}
    size : (width, height)
        [px].
    diffraction : bool
        Whether pixels show what they record under uniform light, neighbours' light included; else the share of each
        that this microlens's geometric image covers.
    pixels : bool
        Whether pixels are drawn at all.
    name : str
        Unique on the page, where several microlenses are shown.
    label : str
        What the place is called, such as "edge".
    key : bool
        Whether a legend is drawn.

    Returns
    -------
    Picture
        Its mapping takes pixels to places relative to the microlens's axis [um].
    """
    colours, place = theme_named(theme), nearest_microlens(design, place)
    view = image_view(design.thin_twin, place, MOST_PIXELS)
    names, tall = legend(_entries(design, colours), colours, size[0] - 24) if key else ("", 0.0)
    plot = _plot(view, size, tall)
    drawn, told = _light(design, place, view, plot, colours, diffraction) if pixels else ("", "")
    inside = drawn + _grid(view, plot, colours, pixels) + _lines(design, view, plot, colours, diffraction and pixels)
    body = [
        _beyond(view, plot, colours, name),
        clipped(f"{name}-window", plot.box, inside),
        frame(plot, colours, "x from the axis [µm]", "y from the axis [µm]", grid=False),
        _title(place, view, label, told, plot, colours),
    ]
    body.append(moved(names, 14, plot.bottom + BELOW - 2))
    kept = "no light" if view.kept_fraction == 0 else f"{100 * view.kept_fraction:.4g} % of the pupil's disc kept"
    title = f"Image of the microlens at {place[0]:.4g}, {place[1]:.4g} mm on the MLA: {kept}"
    return Picture(document(name, title, size, colours, body), plot.mapping)


def nearest_microlens(design: Design, place: tuple[float, float], *, inward: bool = False) -> tuple[float, float]:
    """Axis of the microlens nearest to a place or, with `inward`, not farther out; both on the MLA [mm].

    Raises
    ------
    InputError
        The array is smaller than one microlens.
    """
    array = design.microlens_array
    if min(array.size) < array.pitch * (1 - 1e-9):
        raise InputError(
            (Problem("d", f"{array.pitch:g} mm is more than the microlens array is wide; make it smaller"),)
        )
    if inward:
        x, y = (math.copysign(max(abs(side) - 0.499 * array.pitch, 0.0), side) for side in place)
        place = x, y
    lattice = Lattice(array.pitch, array.size, array.layout)
    x, y = lens_centres(lattice, nearest_lens(lattice, place))
    return float(x), float(y)


def _plot(view: ImageView, size: tuple[float, float], foot: float) -> Plot:
    side = max(min(size[0] - LEFT - RIGHT, size[1] - TOP - BELOW - foot), 60.0)
    (x, y), half = UM * view.centres[0], UM * view.half
    left = LEFT + max(0.0, (size[0] - LEFT - RIGHT - side) / 2)
    return Plot(left, TOP, side, side, Scale(x - half, x + half), Scale(y - half, y + half))


def _light(
    design: Design, place: tuple[float, float], view: ImageView, plot: Plot, theme: Theme, diffraction: bool
) -> tuple[str, str]:
    """Pixels as an image, and what to say of them."""
    shape = path_of(plot.along(UM * view.outline[:, 0], UM * view.outline[:, 1]), closed=True)
    plain = path(shape, fill=theme.ink, fill_opacity=0.42)
    if not view.coverage.size:
        return (plain, "pixels too small to draw") if _seen(view) else ("", "")
    (left, low), (right, top) = plot.at(UM * view.x[0], UM * view.y[0]), plot.at(UM * view.x[-1], UM * view.y[-1])
    box = (left, top, right - left, low - top)
    if not diffraction:
        return image(shaded(view.coverage, theme.ink, 0.42), box), ""
    columns, rows = (_whole_pixels(design, place, view, side) for side in (0, 1))
    found = white_patch(design, columns, rows)
    if found is None:
        return plain, "too many images overlap for diffraction"
    peak = float(found.values.max(initial=0.0))
    return image(ramp(found.values / max(peak, 1.0)), box), f"peak {short(peak, 3)}"


def _seen(view: ImageView) -> bool:
    """Whether any of the sensor is in view."""
    return len(view.x) > 1 and len(view.y) > 1


def _whole_pixels(design: Design, place: tuple[float, float], view: ImageView, side: int) -> slice:
    """Which of the sensor's pixels the view holds."""
    edges = (view.x, view.y)[side] + float(axes_in_space(design, [place])[0][side])
    start = design.sensor.decentre[side] - design.pixels[side] * design.q / 2
    first = round((edges[0] - start) / design.q)
    return slice(first, first + len(edges) - 1)


def _grid(view: ImageView, plot: Plot, theme: Theme, pixels: bool) -> str:
    """Lines between pixels, unless they would be all there is to see."""
    if not pixels or not view.coverage.size or view.coverage.shape[1] > GRID_UP_TO:
        return ""
    (left, low), (right, top) = plot.at(UM * view.x[0], UM * view.y[0]), plot.at(UM * view.x[-1], UM * view.y[-1])
    across = (plot.at(UM * x, 0.0)[0] for x in view.x)
    up = (plot.at(0.0, UM * y)[1] for y in view.y)
    data = "".join(f"M{x:.2f},{low:.2f}V{top:.2f}" for x in across) + "".join(
        f"M{left:.2f},{y:.2f}H{right:.2f}" for y in up
    )
    return path(data, theme.grey, 0.5, opacity=0.35)


def _lines(design: Design, view: ImageView, plot: Plot, theme: Theme, on_picture: bool) -> str:
    parts = []
    for rim, hue, (x, y), radius in zip(rims(design), _hues(design, theme), view.centres, view.radii, strict=True):
        cx, cy = plot.at(UM * x, UM * y)
        r = UM * radius / (plot.x.high - plot.x.low) * plot.width
        if r < 1e5:
            colour = ON_PICTURE if on_picture and rim.name == "FAP" else hue
            look = {"fill": "none", "stroke": colour, "stroke_dasharray": "5 3"}
            parts.append(tag("circle", cx=cx, cy=cy, r=r, stroke_width=1.2, **look))
    if len(view.outline):
        data = path_of(plot.along(UM * view.outline[:, 0], UM * view.outline[:, 1]), closed=True)
        if on_picture:
            parts.append(path(data, "#000000", 3.2, opacity=0.5))
        parts.append(path(data, ON_PICTURE if on_picture else theme.ink, 1.8, data_testid="microlens-outline"))
    cell = path_of(plot.along(UM * view.cell[:, 0], UM * view.cell[:, 1]), closed=True)
    parts.append(path(cell, theme.green, 1.8))
    x, y = plot.at(*(UM * view.centres[0]))
    parts.append(path(f"M{x - 6:.1f},{y:.1f}h12M{x:.1f},{y - 6:.1f}v12", theme.vermillion, 2))
    return "".join(parts)


def _hues(design: Design, theme: Theme) -> list[str]:
    further = [theme.stops[k % len(theme.stops)] for k in range(len(design.stops))]
    return [theme.ink, theme.blue, *further]


def _beyond(view: ImageView, plot: Plot, theme: Theme, name: str) -> str:
    """Hatching where the sensor ends, with its pixels' ground on top."""
    hatch = tag(
        "pattern", line((0, 0), (0, 8), theme.grey, 1), id=f"{name}-beyond", width=6, height=6,
        patternUnits="userSpaceOnUse", patternTransform="rotate(45)",
    )  # fmt: skip
    left, top, width, height = plot.box
    parts = [tag("defs", hatch)]
    parts.append(tag("rect", x=left, y=top, width=width, height=height, fill=f"url(#{name}-beyond)", opacity=0.5))
    if _seen(view):
        (a, low), (b, high) = plot.at(UM * view.x[0], UM * view.y[0]), plot.at(UM * view.x[-1], UM * view.y[-1])
        a, b, high, low = max(a, left), min(b, plot.right), max(high, top), min(low, plot.bottom)
        parts.append(tag("rect", x=a, y=high, width=b - a, height=low - high, fill=theme.ground))
    return "".join(parts)


def _title(place: tuple[float, float], view: ImageView, label: str, told: str, plot: Plot, theme: Theme) -> str:
    where = f"{short(place[0])}, {short(place[1])} mm"
    first = text((plot.left, 16), f"{label}: {where}" if label else f"at {where}", theme.ink, bold=True)
    state = "dark" if view.kept_fraction == 0 else f"{100 * view.kept_fraction:.4g} % kept"
    if view.on_sensor <= 0.995 and view.kept_fraction > 0:
        state += f", {100 * view.on_sensor:.3g} % on the sensor"
    colour = theme.ink if view.kept_fraction == 1 else theme.vermillion
    second = text((plot.left, 33), f"{state}{'; ' if told else ''}{told}", colour, SMALL, data_testid="microlens-kept")
    return first + second


def _entries(design: Design, theme: Theme) -> list[tuple[str, str]]:
    entries = [(line((-11, 0), (11, 0), theme.ink, 1.8), "image")]
    for rim, hue in zip(rims(design), _hues(design, theme), strict=True):
        entries.append((line((-11, 0), (11, 0), hue, 1.2, dash="5 3"), f"disc of {rim.name}"))
    entries.append(
        (tag("rect", x=-8, y=-5, width=16, height=10, fill="none", stroke=theme.green, stroke_width=1.8), "own cell")
    )
    entries.append((path("M-6,0h12M0,-6v12", theme.vermillion, 2), "chief ray"))
    return entries
