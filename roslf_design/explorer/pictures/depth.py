"""Depth precision over the working range."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...report.figures.depth_precision import SIGMA_DISPARITY, focal_plane_sigma
from ...report.figures.depth_precision import depth_precision as curve_of
from .axes import Picture, Plot, Scale, frame, legend, moved
from .svg import PLAIN, SMALL, clipped, document, line, path, path_of, short, tag, text, text_width
from .theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ...design import Design

LEFT, TOP, RIGHT, BELOW = 58.0, 14.0, 56.0, 42.0
"""Margins [px]; the right one holds a second axis."""
POINTS = 121


def depth_precision(design: Design, theme: ThemeName = "light", size: tuple[float, float] = (560, 320)) -> Picture:
    """Draw sigma_Z over the object distance Z, and the defocus there on a second axis.

    Parameters
    ----------
    design : Design
    theme : {"light", "dark"}
    size : (width, height)
        [px].

    Returns
    -------
    Picture
        Its mapping takes pixels to Z and sigma_Z [mm].
    """
    colours = theme_named(theme)
    curve, focus = curve_of(design, POINTS), focal_plane_sigma(design)
    key, tall = legend(_entries(colours), colours, size[0] - 24)
    width, height = max(size[0] - LEFT - RIGHT, 80.0), max(size[1] - TOP - BELOW - tall, 80.0)
    across = Scale(float(curve.distance[0]), float(curve.distance[-1]))
    plot = Plot(LEFT, TOP, width, height, across, Scale(0.0, 1.08 * float(np.max(curve.sigma))))
    other = plot._replace(y=Scale(0.0, 1.08 * max(float(np.max(curve.blur)), 1e-9)))
    x, y = plot.at(design.d_f, focus)
    told = f"at d_f = {short(design.d_f)} mm: {short(focus, 3)} mm"
    leftwards = x + text_width(told, SMALL) + 16 > plot.right
    inside = [
        line((x, plot.top), (x, plot.bottom), colours.grey, 1.2, dash="6 3"),
        path(path_of(plot.along(curve.distance, curve.sigma)), colours.blue, 2.2, data_testid="sigma-curve"),
        path(path_of(other.along(curve.distance, curve.blur)), colours.orange, 1.8, dash="7 4"),
    ]
    # Between the two curves, which both leave the upper middle free.
    at = (x - 8 if leftwards else x + 8, plot.top + 14)
    marks = [
        tag("circle", cx=x, cy=y, r=6, fill=colours.vermillion, stroke=colours.ground, stroke_width=2),
        text(at, told, colours.ink, SMALL, "end" if leftwards else "start", halo=colours.ground),
    ]
    body = [
        frame(
            plot,
            colours,
            "object distance from the main lens Z [mm]",
            "depth precision σ_Z [mm]",
            y_colour=colours.blue,
        ),
        _right_axis(other, colours.orange),
        clipped("depth-window", plot.box, "".join(inside)),
        *marks,
        moved(key, 14, plot.bottom + BELOW - 2),
    ]
    title = f"Depth precision of {design.name}: {focus:.3g} mm at the focal plane, {design.d_f:.4g} mm from the lens"
    return Picture(document("depth", title, size, colours, body), plot.mapping)


def _entries(theme: Theme) -> list[tuple[str, str]]:
    return [
        (line((-11, 0), (11, 0), theme.blue, 2.2), f"σ_Z for {SIGMA_DISPARITY:g} pitch of disparity error"),
        (line((-11, 0), (11, 0), theme.orange, 1.8, dash="7 4"), "spread of a point on the MLA"),
    ]


def _right_axis(plot: Plot, colour: str) -> str:
    parts = [line((plot.right, plot.top), (plot.right, plot.bottom), colour)]
    wide = 0.0
    for value in plot.y.ticks(max(2, int(plot.height / 44))):
        _, py = plot.at(plot.x.low, value)
        parts.append(line((plot.right, py), (plot.right + 4, py), colour))
        parts.append(text((plot.right + 7, py + 4), short(value), colour, SMALL))
        wide = max(wide, text_width(short(value), SMALL))
    at = (plot.right + 22 + wide, plot.top + plot.height / 2)
    return "".join(parts) + text(at, "spread [pitches]", colour, PLAIN, "middle", turned=True)
