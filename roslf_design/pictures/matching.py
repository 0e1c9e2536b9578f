"""The D_F - d_3 plane: where f-numbers match, where the whole sensor is undistorted, and where the design is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..camera import Camera
from ..theory.f_number import matched, mismatch_px
from ..theory.light import half_diagonal
from ..theory.vignetting import room_at
from .lettering import SMALL, short, text_width
from .marks import Area, Dots, Floats, Line, Mark, Point, Text, box_key, dot_key, line_key
from .panel import Panel, Scale
from .picture import Picture, one_panel

if TYPE_CHECKING:
    from ..design import Design

POINTS = 121


class MatchingPlane(NamedTuple):
    """What the picture shows."""

    d_3: Floats
    """Abscissae of the curves [mm], shape (N,)."""
    exact: Floats
    """D_F that matches at each (Eq. 7) [mm]; NaN-free: inf where there is none."""
    approximate: Floats
    """The same by Eq. 8."""
    D_F: Floats
    """Ordinates of the maps [mm], shape (M,)."""
    margin: Floats
    """Smallest non-distortion margin at the sensor's corner (Eqs. 5-6) [mm^2], shape (M, N); full discs where >= 0."""
    mismatch: Floats
    """Image diameter less pitch [px], shape (M, N)."""


def plane_of(design: Design, points: int = POINTS, limits: Point | None = None) -> MatchingPlane:
    """Curves and maps over ranges in which the design and the matched curve are both seen.

    Parameters
    ----------
    design : Design
    points : int
        Along each axis.
    limits : (d_3, D_F), optional
        Ends of the ranges [mm], instead of those chosen for the design; d_3 stops short of the focal plane.
    """
    camera = Camera.of(design)
    right = _right(camera) if limits is None else min(limits[0], design.d_f * (1 - 1e-3))
    d_3 = np.linspace(0.0, right, points)
    exact, approximate = (matched(camera.replace({"d_3": d_3}), "D_F", exact=law).value for law in (True, False))
    here = float(matched(camera, "D_F").value)
    largest = float(np.max(exact, initial=0.0, where=np.isfinite(exact)))
    chosen = 1.35 * max(design.D_F, here if math.isfinite(here) else 0.0, 0.75 * largest)
    D_F = np.linspace(0.0, chosen if limits is None else limits[1], points)
    across, up = np.meshgrid(d_3, D_F)
    builds = camera.replace({"d_3": across, "D_F": up})
    return MatchingPlane(d_3, exact, approximate, D_F, _margin(builds), np.asarray(mismatch_px(builds)))


def _margin(camera: Camera) -> Floats:
    """Linear in D_F and in d_3, unlike the room itself."""
    parts = [rim.part for rim in (camera.fap, *camera.rims)]
    centred = camera.replace({f"{part}.decentre.{k}": 0.0 for part in parts for k in (0, 1)})
    rooms = room_at(centred, half_diagonal(camera) * camera.inverse_m)
    return np.asarray(2 * camera.gap * rooms.min(axis=0))


def _right(camera: Camera) -> float:
    """A d_3 beyond the design, telecentricity, the undistorted region and the match for the design's own D_F."""
    d_f, d_3 = float(camera.d_f), float(camera.d_3)
    reach = d_f * (1 - 1e-3)
    tried = np.linspace(0.0, reach, 401)
    clear = tried[_margin(camera.replace({"d_3": tried, "D_F": np.zeros_like(tried)})) >= 0]
    match = matched(camera, "d_3")
    shown = [d_3, float(camera.f), float(clear.max(initial=0.0)), float(match.value) if match.exists else 0.0]
    return min(reach, 1.15 * max(shown))


def matching_plane(design: Design, size: Point = (560, 400), *, limits: Point | None = None) -> Picture:
    """Draw the plane, everything but d_3 and D_F held.

    Parameters
    ----------
    design : Design
        Its decentres are left aside, and a real lens is taken as its thin twin.
    size : (width, height)
        [px].
    limits : (d_3, D_F), optional
        Where the axes end [mm], to keep them still while the design is dragged; those of the picture before are
        ``(mapping.x.high, mapping.y.high)``.

    Returns
    -------
    Picture
        Its mapping takes pixels to d_3 and D_F [mm]; the design is the element "design-point".
    """
    thin = design.thin_twin
    plane = plane_of(thin, POINTS, limits)
    right = float(plane.d_3[-1]) if limits is None else limits[0]
    top = float(plane.D_F[-1])
    across, up = Scale(0.0, right), Scale(0.0, top)
    free = bool((plane.margin >= 0).any())
    keys = [
        line_key("matched: images just touch, Eq. 7", "blue", 2.4),
        box_key("within ±1 px", "blue", 0.2),
        line_key("approximation, Eq. 8", "orange", 1.6, "7 4"),
        box_key(f"whole sensor undistorted, Eq. 6{'' if free else ': nowhere'}", "green", 0.16, "green"),
        dot_key("this design", "vermillion", size=5),
    ]
    panel = Panel(
        (0, 0, size[0] - 72, size[1]), across, up, (), "FAP distance d_3 [mm]", "FAP diameter D_F [mm]",
    )  # fmt: skip
    marks = [*_region(plane, top), *_curves(thin, plane, panel), *_point(thin, panel)]
    title = (
        f"Plane of FAP diameter and distance for {design.name}, which is at d_3 = {design.d_3:.4g} mm, "
        f"D_F = {design.D_F:.4g} mm"
    )
    return one_panel("matching-plane", title, size, panel.with_marks(*marks), keys, left=56, top=12)


def highest_undistorted(plane: MatchingPlane) -> Floats:
    """Largest D_F at each d_3 that leaves the whole sensor undistorted [mm]; NaN where none does."""
    free = plane.margin >= 0
    last = np.where(free.any(axis=0), free.shape[0] - 1 - np.argmax(free[::-1], axis=0), 0)
    columns = np.arange(free.shape[1])
    after = np.minimum(last + 1, free.shape[0] - 1)
    inner, outer = plane.margin[last, columns], plane.margin[after, columns]
    # Margins fall linearly with D_F, so the step to the zero is exact but where the limiting rim changes.
    step = np.where(outer < 0, inner / np.where(outer < 0, inner - outer, 1.0), 0.0)
    return np.where(free.any(axis=0), plane.D_F[last] + step * (plane.D_F[after] - plane.D_F[last]), np.nan)


def _region(plane: MatchingPlane, top: float) -> list[Mark]:
    """Where the whole sensor is undistorted, with its edge."""
    bound = highest_undistorted(plane)
    known = np.isfinite(bound)
    if not known.any():
        return []
    x, y = plane.d_3[known], bound[known]
    last = int(np.flatnonzero(known)[-1])
    if last + 1 < known.size:  # at D_F = 0, between two columns
        here, beyond = plane.margin[0, last], plane.margin[0, last + 1]
        x = np.append(x, plane.d_3[last] + here / (here - beyond) * (plane.d_3[last + 1] - plane.d_3[last]))
        y = np.append(y, 0.0)
    # Where the region goes on beyond the axis there is no edge to draw.
    inside = y < top * (1 - 1e-4)
    edge = inside | np.append(inside[1:], inside[-1])
    return [
        Area([*x, x[-1], x[0]], [*y, 0.0, 0.0], "green", 0.16, testid="eq6-region"),
        Line(x[edge], y[edge], "green", 1.6),
    ]


def _curves(design: Design, plane: MatchingPlane, panel: Panel) -> list[Mark]:
    def at_mismatch(wanted: float) -> Floats:
        """D_F at which images overlap by so many pixels [mm]; the mismatch is linear in D_F."""
        low, high = plane.mismatch[0], plane.mismatch[-1]
        return np.asarray((wanted - low) / (high - low) * plane.D_F[-1])

    band = np.concatenate([at_mismatch(-1.0), at_mismatch(1.0)[::-1]])
    marks: list[Mark] = [Area(np.concatenate([plane.d_3, plane.d_3[::-1]]), band, "blue", 0.2)]
    for curve, look in ((plane.approximate, ("orange", 1.6, "7 4")), (plane.exact, ("blue", 2.4, ""))):
        real = np.isfinite(curve)
        marks.append(Line(plane.d_3[real], curve[real], *look))
    if design.f <= panel.x.high:
        words = "telecentric: d_3 = f"
        marks.append(Line([design.f, design.f], [0.0, panel.y.high], "grey", 1.2, "8 3 2 3"))
        leftwards = (panel.x.high - design.f) / panel.per_px[0] < text_width(words, SMALL) + 10
        anchor, dx = ("end", -6.0) if leftwards else ("start", 6.0)
        marks.append(Text(design.f, 0.0, words, "grey", SMALL, anchor, dx, -8))
    return marks


def _point(design: Design, panel: Panel) -> list[Mark]:
    """The design; drawn over the frame, as it may be dragged there."""
    x, y = min(design.d_3, panel.x.high), min(design.D_F, panel.y.high)
    words = f"d_3 = {short(design.d_3)} mm, D_F = {short(design.D_F)} mm"
    leftwards = (panel.x.high - x) / panel.per_px[0] < text_width(words, SMALL) + 20
    anchor, dx = ("end", -14.0) if leftwards else ("start", 14.0)
    dy = 20.0 if y > 0.9 * panel.y.high else -10.0
    dot = Dots([x], [y], "vermillion", size=8, edge="ground", width=2.5, testid="design-point", cursor="move")
    return [Text(x, y, words, "ink", SMALL, anchor, dx, dy, halo=True), dot]
