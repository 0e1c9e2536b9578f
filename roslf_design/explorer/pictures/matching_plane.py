"""The D_F - d_3 plane: where f-numbers match, where the whole sensor is undistorted, and where the design is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...report.figures.matching_plane import MatchingPlane
from ...report.figures.matching_plane import matching_plane as plane_of
from .axes import Picture, Plot, Scale, frame, legend, moved
from .svg import SMALL, clipped, document, line, path, path_of, short, tag, text, text_width
from .theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ...design import Design

Floats = NDArray[np.float64]

LEFT, TOP, RIGHT, BELOW = 56.0, 12.0, 16.0, 42.0
"""Margins [px]."""
POINTS = 121


def matching_plane(
    design: Design, theme: ThemeName = "light", size: tuple[float, float] = (560, 400), *,
    limits: tuple[float, float] | None = None,
) -> Picture:  # fmt: skip
    """Draw the plane, everything but d_3 and D_F held.

    Parameters
    ----------
    design : Design
        Its decentres are left aside, and a real lens is taken as its thin twin.
    theme : {"light", "dark"}
    size : (width, height)
        [px].
    limits : (d_3, D_F), optional
        Where the axes end [mm], to keep them still while the design is dragged; those of the picture before are
        ``(mapping.x1, mapping.y1)``.

    Returns
    -------
    Picture
        Its mapping takes pixels to d_3 and D_F [mm]; the design is the element "design-point".
    """
    colours, seen = theme_named(theme), design.thin_twin
    plane = plane_of(seen, POINTS, limits)
    right = float(plane.d_3[-1]) if limits is None else limits[0]
    key, tall = legend(_entries(bool((plane.margin >= 0).any()), colours), colours, size[0] - 24)
    plot = Plot(
        LEFT, TOP, max(size[0] - LEFT - RIGHT, 80.0), max(size[1] - TOP - BELOW - tall, 80.0),
        Scale(0.0, right), Scale(0.0, float(plane.D_F[-1])),
    )  # fmt: skip
    free = _highest_undistorted(plane)
    body = [
        frame(plot, colours, "FAP distance d_3 [mm]", "FAP diameter D_F [mm]"),
        clipped("matching-plane-window", plot.box, _curves(seen, plane, free, plot, colours)),
        _point(seen, plot, colours),
        moved(key, 14, plot.bottom + BELOW - 2),
    ]
    title = (
        f"Plane of FAP diameter and distance for {design.name}, which is at d_3 = {design.d_3:.4g} mm, "
        f"D_F = {design.D_F:.4g} mm"
    )
    return Picture(document("matching-plane", title, size, colours, body), plot.mapping)


def _highest_undistorted(plane: MatchingPlane) -> Floats:
    """Largest D_F at each d_3 that leaves the whole sensor undistorted [mm]; NaN where none does."""
    free = plane.margin >= 0
    last = np.where(free.any(axis=0), free.shape[0] - 1 - np.argmax(free[::-1], axis=0), 0)
    columns = np.arange(free.shape[1])
    after = np.minimum(last + 1, free.shape[0] - 1)
    inner, outer = plane.margin[last, columns], plane.margin[after, columns]
    # Margins fall linearly with D_F, so the step to the zero is exact but where the limiting rim changes.
    step = np.where(outer < 0, inner / np.where(outer < 0, inner - outer, 1.0), 0.0)
    return np.where(free.any(axis=0), plane.D_F[last] + step * (plane.D_F[after] - plane.D_F[last]), np.nan)


def _at_mismatch(plane: MatchingPlane, wanted: float) -> Floats:
    """D_F at which images overlap by so many pixels [mm]; the mismatch is linear in D_F."""
    low, high = plane.mismatch[0], plane.mismatch[-1]
    return np.asarray((wanted - low) / (high - low) * plane.D_F[-1])


def _curves(design: Design, plane: MatchingPlane, free: Floats, plot: Plot, theme: Theme) -> str:
    parts = []
    known = np.isfinite(free)
    if known.any():
        corners = plot.along(plane.d_3[known], free[known])
        last = int(np.flatnonzero(known)[-1])
        if last + 1 < known.size:  # at D_F = 0, between two columns
            here, beyond = plane.margin[0, last], plane.margin[0, last + 1]
            step = here / (here - beyond)
            corners.append(plot.at(plane.d_3[last] + step * (plane.d_3[last + 1] - plane.d_3[last]), 0.0))
        area = [*corners, (corners[-1][0], plot.bottom), (corners[0][0], plot.bottom)]
        parts.append(path(path_of(area, closed=True), fill=theme.green, fill_opacity=0.16, data_testid="eq6-region"))
        # Where the region goes on beyond the axis there is no edge to draw.
        edge = [
            at
            for k, at in enumerate(corners)
            if at[1] > plot.top + 0.1 or corners[min(k + 1, len(corners) - 1)][1] > plot.top + 0.1
        ]
        parts.append(path(path_of(edge), theme.green, 1.6))
    band = plot.along(plane.d_3, _at_mismatch(plane, -1.0)), plot.along(plane.d_3, _at_mismatch(plane, 1.0))
    parts.append(path(path_of([*band[0], *band[1][::-1]], closed=True), "none", fill=theme.blue, fill_opacity=0.2))
    for curve, hue, width, dash in (
        (plane.approximate, theme.orange, 1.6, "7 4"),
        (plane.exact, theme.blue, 2.4, None),
    ):
        real = np.isfinite(curve)
        parts.append(path(path_of(plot.along(plane.d_3[real], curve[real])), hue, width, dash=dash))
    x, _ = plot.at(design.f, 0.0)
    if x <= plot.right:
        told = "telecentric: d_3 = f"
        parts.append(line((x, plot.top), (x, plot.bottom), theme.grey, 1.2, dash="8 3 2 3"))
        leftwards = x + text_width(told, SMALL) + 10 > plot.right
        at = (x - 6 if leftwards else x + 6, plot.bottom - 8)
        parts.append(text(at, told, theme.grey, SMALL, "end" if leftwards else "start"))
    return "".join(parts)


def _point(design: Design, plot: Plot, theme: Theme) -> str:
    """The design; drawn over the frame, as it may be dragged there."""
    x, y = plot.at(min(design.d_3, plot.x.high), min(design.D_F, plot.y.high))
    told = f"d_3 = {short(design.d_3)}, D_F = {short(design.D_F)} mm"
    leftwards = x + text_width(told, SMALL) + 20 > plot.right
    at = (x - 14 if leftwards else x + 14, y - 10 if y > plot.top + 28 else y + 20)
    dot = tag(
        "circle", cx=x, cy=y, r=8, fill=theme.vermillion, stroke=theme.ground, stroke_width=2.5, cursor="move",
        data_testid="design-point",
    )  # fmt: skip
    return text(at, told, theme.ink, SMALL, "end" if leftwards else "start", halo=theme.ground) + dot


def _entries(somewhere: bool, theme: Theme) -> list[tuple[str, str]]:
    area = tag("rect", x=-10, y=-5, width=20, height=10, fill=theme.green, fill_opacity=0.16, stroke=theme.green)
    band = tag("rect", x=-10, y=-5, width=20, height=10, fill=theme.blue, fill_opacity=0.2)
    return [
        (line((-11, 0), (11, 0), theme.blue, 2.4), "matched, Eq. 7"),
        (band, "within ±1 px"),
        (line((-11, 0), (11, 0), theme.orange, 1.6, dash="7 4"), "nearly, Eq. 8"),
        (area, f"undistorted, Eq. 6{'' if somewhere else ': nowhere'}"),
        (tag("circle", r=5, fill=theme.vermillion), "this design"),
    ]
