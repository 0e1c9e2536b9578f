"""Curves of a design: depth noise over distance; in the plane of D_F and d_3, where f-numbers match."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._arrays import Array
from ...camera import Camera
from ...design import PATHS
from ...drawing.marks import (
    Area,
    Dots,
    Key,
    Line,
    Mark,
    Point,
    Text,
    box_key,
    dot_key,
    joined,
    line_key,
    where_above,
    xy,
)
from ...drawing.panel import Panel, Scale
from ...drawing.picture import PAGE, Picture, legend_height, one_panel
from ...drawing.theme import SMALL, short, text_width
from ...evaluation import default_fields
from ...theory.depth_error import depth_at, depth_error
from ...theory.f_number import matched, mismatch_px
from ...theory.field_of_view import focus_ahead
from ...theory.light_field import rim_disparity
from ...theory.quantities import QUANTITIES
from ...theory.stop_images import MicrolensImages
from ...theory.vignetting import corner_room

if TYPE_CHECKING:
    from ...design import Design

LOOKS = (("blue", ""), ("orange", "7 4"), ("green", "8 3 2 3"))
"""Colour and line of each design that is compared."""
UNKNOWN = box_key("unknown", "grey", 0.9, hatch=True)
FIELDS = 21
"""Number of points from the centre of the field to its corner."""
POINTS = 121
"""Number of points along each axis of the plane of D_F and d_3."""

LEFT = 1.3
"""How far beyond a FAP behind the lens the plane reaches, over its distance."""


class _DepthCurve(NamedTuple):
    """Depth noise (bound) over distance."""

    distance: Array
    """Distance ahead of the tip [mm], shape (N,)."""
    sigma: Array
    """sigma_Z [mm]."""
    blur: Array
    """Spread of an object point over the MLA [microlens pitches]."""
    focus: float
    """Distance of the focal plane [mm]."""
    in_focus: float
    """sigma_Z there [mm]."""


@lru_cache(maxsize=2)
def _depth_curve(design: Design, points: int = 241) -> _DepthCurve:
    """Depth noise (bound) from 0.4 to 1.8 times the focal plane's distance ahead of the tip."""
    camera = Camera.of(design)
    focus = float(focus_ahead(camera))
    ahead = np.linspace(0.4, 1.8, points) * focus
    blur = np.abs(rim_disparity(camera, depth_at(camera, ahead)))
    return _DepthCurve(
        ahead, np.abs(depth_error(camera, ahead)), blur, focus, float(np.abs(depth_error(camera, focus)))
    )


def depth_precision(design: Design, size: Point = (560, 320)) -> Picture:
    """Draw sigma_Z over the distance ahead of the tip, and the defocus there on a second axis; `size` in px.

    The picture's mapping takes pixels to that distance and sigma_Z [mm].
    """
    distance, sigma, blur, ahead, focus = _depth_curve(design, 121)
    keys = [
        line_key("σ_Z, depth noise (bound)", "blue", 2.2),
        line_key("spread of a point on the MLA (right axis)", "orange", 1.8, "7 4"),
    ]
    known = np.isfinite(sigma)
    across, up = (
        Scale(float(distance[0]), float(distance[-1])),
        Scale(0.0, 1.08 * float(np.max(sigma[known], initial=0))),
    )
    if not known.any():
        up = Scale(0.0, 1.0)
    sharp = f"{short(focus, 3)} mm" if math.isfinite(focus) else "unknown, as no light or texture gives it"
    words = f"in focus at {short(ahead)} mm: {sharp.partition(',')[0]}"
    width = max(size[0] - 114, 80.0)
    # Between the two curves, which both leave the upper middle free; never beyond the panel.
    at, long = float(across.share(ahead)) * width, text_width(words, SMALL)
    start = max(at - 8 - long if at + long + 16 > width else at + 8, min(4.0, width - long))
    dots: list[Mark] = [*_unknown(distance, known, up)]
    if not known.all():
        keys.append(UNKNOWN)
    if math.isfinite(focus):
        dots.append(Dots([ahead], [focus], "vermillion", size=6, edge="ground", width=2))
    marks: tuple[Mark, ...] = (
        Line([ahead] * 2, [0.0, up.high], "grey", 1.2, "6 3"),
        Line(distance[known], sigma[known], "blue", 2.2, testid="sigma-curve"),
        *dots,
        Text(ahead, up.high, words, "ink", SMALL, "start", start - at, 14, halo=True),
    )
    labels = "distance ahead of the tip [mm]", "depth noise (bound) σ_Z [mm]"
    panel = Panel((0, 0, 1, 1), across, up, marks, *labels, y_colour="blue")
    title = f"Depth noise (bound) of {design.name}: {sharp} at the focal plane, {ahead:.4g} mm ahead of the tip"
    picture = one_panel("depth", title, size, panel, keys, right=56)
    other = Scale(0.0, 1.08 * max(float(np.max(blur)), 1e-9))
    spread = Panel(
        picture.panels[0].box, across, other, (Line(distance, blur, "orange", 1.8, "7 4"),),
        y_label="spread [pitches]", x_ticks=(), grid="", right=True, y_colour="lost",
    )  # fmt: skip
    return picture.with_panels(spread)


class _FieldCurve(NamedTuple):
    """Depth noise (bound) over the field."""

    place: Array
    """Place of the microlens, from the centre of what the sensor sees to its corner [mm on the array], shape (N,)."""
    sigma: Array
    """sigma_Z at the focal plane [mm]; inf where it is unknown."""


@lru_cache(maxsize=2)
def field_curve(design: Design) -> _FieldCurve:
    """Depth noise (bound) at the focal plane from the centre of what the sensor sees to its corner."""
    centre, _, corner = np.array(default_fields(design))
    share = np.linspace(0.0, 1.0, FIELDS)
    images = MicrolensImages(Camera.of(design), centre + share[:, None] * (corner - centre))
    sigma = np.asarray(QUANTITIES["sigma_z_at_field_mm"].at_fields(images))
    return _FieldCurve(share * float(np.hypot(*(corner - centre))), np.broadcast_to(sigma, (FIELDS, 1))[:, 0])


def depth_over_field(design: Design, size: Point = (560, 320)) -> Picture:
    """Draw sigma_Z at the focal plane over the field, from its centre to its corner; `size` in px."""
    place, sigma = field_curve(design)
    known = np.isfinite(sigma)
    best = float(np.min(sigma[known], initial=math.inf))
    across = Scale(0.0, float(place[-1]) or design.d / 2)
    # A cut image's error grows without bounds.
    up = Scale(0.0, min(1.15 * float(np.max(sigma[known], initial=0.0)), 20 * best) if known.any() else 1.0)
    shown = np.where(known, np.minimum(sigma, 2 * up.high), np.nan)
    drawn: Mark = Line(place[known], shown[known], "blue", 2.2, testid="field-curve")
    if not place[-1] > 0:  # a single microlens sees all
        drawn = Dots(place[known][:1], shown[known][:1], "blue", size=6, testid="field-curve")
    marks = (*_unknown(place, known, up), drawn)
    labels = "microlens, from the field's centre to its corner [mm]", "depth noise (bound) σ_Z [mm]"
    keys = [line_key("σ_Z in the plane in focus", "blue", 2.2), *([] if known.all() else [UNKNOWN])]
    ends = [f"{short(float(value), 3)} mm" if math.isfinite(value) else "unknown" for value in sigma[[0, -1]]]
    title = f"Depth noise (bound) of {design.name} over the field: {ends[0]} at its centre, {ends[1]} at its corner"
    return one_panel("depth-field", title, size, Panel((0, 0, 1, 1), across, up, marks, *labels), keys)


def _unknown(x: Array, known: NDArray[np.bool_], up: Scale) -> tuple[Mark, ...]:
    """Bands where nothing is known, to half way to the next place that is."""
    middles = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
    steps = np.flatnonzero(np.diff(np.concatenate([[True], known, [True]]).astype(int)))
    return tuple(
        Area([a, b, b, a], [up.low, up.low, up.high, up.high], "grey", 0.9, hatch=True, testid="unknown")
        for a, b in zip(middles[steps[::2]], middles[steps[1::2]], strict=True)
    )


def depth_comparison(designs: Mapping[str, Design]) -> Picture:
    """Draw sigma_Z of up to three named designs over the distance ahead of the tip; both axes are logarithmic."""
    marks: list[Mark] = []
    keys: list[Key] = []
    xs, ys = [], []
    for (name, design), (colour, dash) in zip(designs.items(), LOOKS, strict=False):
        curve = _depth_curve(design)
        known = np.isfinite(curve.sigma)
        xs.append(curve.distance[known])
        ys.append(curve.sigma[known])
        marks.append(Line(xs[-1], ys[-1], colour, 2.0, dash))
        if math.isfinite(curve.in_focus):
            marks.append(Dots([curve.focus], [curve.in_focus], colour, size=5, edge="ground", width=1.5))
        keys.append(line_key(f"{name}: {design.name}", colour, 2.0, dash))
    every = [np.concatenate(values) for values in (xs, ys)]
    across, up = (Scale(np.min(v, initial=1e9) / 1.15, np.max(v, initial=1e-9) * 1.15, log=True) for v in every)
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "distance ahead of the tip [mm]", "σ_Z [mm]")
    title = f"Depth noise (bound) of {', '.join(design.name for design in designs.values())}"
    return one_panel("depth-comparison", title, (PAGE, 320 + legend_height(keys, PAGE - 24)), panel, keys)


class _MatchingPlane(NamedTuple):
    """Curves and a map over d_3 and D_F."""

    d_3: Array
    """Abscissae of the curves [mm], shape (N,)."""
    exact: Array
    """D_F that matches at each (Eq. 7) [mm]; NaN-free: inf where there is none."""
    approximate: Array
    """Diameter of the FAP that matches at each distance approximately, by Eq. 8."""
    band: Array
    """D_F at which images are a pixel smaller and larger than their pitch [mm], shape (2, N)."""
    D_F: Array
    """Ordinates of the map [mm], shape (M,)."""
    margin: Array
    """Smallest non-distortion margin at the sensor's corner (Eqs. 5-6) [mm^2], shape (M, N); full discs where >= 0."""


def _plane_of(design: Design, limits: Point | None = None) -> _MatchingPlane:
    """Curves and map over ranges in which the design and the matched curve are both seen.

    `limits` are other ends of the ranges, of d_3 and D_F [mm]; d_3 stops short of the focal plane.
    """
    camera = Camera.of(design)
    left = min(0.0, LEFT * design.d_3)
    d_3 = np.linspace(left, _right(camera) if limits is None else min(limits[0], design.d_f * (1 - 1e-3)), POINTS)
    exact, approximate = (matched(camera.replace({"d_3": d_3}), "D_F", exact=law).value for law in (True, False))
    here = float(matched(camera, "D_F").value)
    largest = float(np.max(exact, initial=0.0, where=np.isfinite(exact)))
    chosen = 1.35 * max(design.D_F, here if math.isfinite(here) else 0.0, 0.75 * largest)
    D_F = np.linspace(0.0, chosen if limits is None else limits[1], POINTS)
    across, up = np.meshgrid(d_3, D_F)
    # The mismatch is linear in D_F.
    low, high = mismatch_px(camera.replace({"d_3": across[[0, -1]], "D_F": up[[0, -1]]}))
    band = (np.array([[-1.0], [1.0]]) - low) / (high - low) * D_F[-1]
    return _MatchingPlane(d_3, exact, approximate, band, D_F, _margin(camera.replace({"d_3": across, "D_F": up})))


def _margin(camera: Camera) -> Array:
    """Linear in D_F and in d_3, unlike the room itself."""
    before = [place for place in camera.numbers if not place.startswith(("microlens_array.", "sensor."))]
    centred = camera.replace({place: 0.0 for place in before if ".decentre." in place})
    return np.asarray(2 * np.abs(camera.seen.gap) * corner_room(centred).min(axis=0))


def _telecentric(camera: Camera) -> float:
    """Where the FAP is seen at f, with a ruler [mm]; nan where flat glass stands there, or lenses before it."""
    if camera.chain.in_air:
        return float(camera.f)
    return math.nan if camera.chain.bends else float(camera.chain.stands_at(camera.numbers, camera.f))


def _right(camera: Camera) -> float:
    """A d_3 beyond the design, telecentricity, the undistorted region and the match for the design's own D_F."""
    d_f, d_3 = (float(camera[PATHS[symbol]]) for symbol in ("d_f", "d_3"))
    reach = d_f * (1 - 1e-3)
    tried = np.linspace(0.0, reach, 401)
    clear = tried[_margin(camera.replace({"d_3": tried, "D_F": np.zeros_like(tried)})) >= 0]
    match = matched(camera, "d_3")
    telecentric = _telecentric(camera)
    ends = telecentric, float(clear.max(initial=0.0)), float(match.value) if match.exists else 0.0
    shown = [d_3, *(end for end in ends if not math.isnan(end))]
    return min(reach, 1.15 * max(shown))


def matching_plane(design: Design, size: Point = (560, 400), *, limits: Point | None = None) -> Picture:
    """Draw the plane, everything but d_3 and D_F held.

    Parameters
    ----------
    design : Design
        Its decentres are left aside, and a real lens is taken as its thin twin.
    size : (width, height), optional
        [px].
    limits : (d_3, D_F), optional
        Where the axes end [mm], to keep them still while the design is dragged; those of the picture before are
        ``(mapping.x.high, mapping.y.high)``.

    Returns
    -------
    Picture
        Its mapping takes pixels to d_3 and D_F [mm]; the design is the element "design-point".
    """
    from contourpy import contour_generator

    thin = design.thin_twin.with_seen_pupil
    plane = _plane_of(thin, limits)
    across = Scale(float(plane.d_3[0]), float(plane.d_3[-1]) if limits is None else limits[0])
    up = Scale(0.0, float(plane.D_F[-1]))
    per_px = (across.high - across.low) / (size[0] - 72)

    def label(x: float, y: float, words: str, colour: str, away: float, dy: float) -> Text:
        """Words on the right of a place, on its left or, where they fit on neither side, as far right as they do."""
        at, wide, room = (x - across.low) / per_px, text_width(words, SMALL) + 2, size[0] - 72
        start = next((s for s in (at + away, at - away - wide) if 0 <= s <= room - wide), max(room - wide, 0.0))
        return Text(x, y, words, colour, SMALL, dx=start - at, dy=dy, halo=True)

    # No stop stands in glass.
    spans = [(at.near, at.far) for at in thin.in_bore if at.part.length]
    glass = [(near, min(far, across.high)) for near, far in spans if near < across.high]
    marks: list[Mark] = []
    if (plane.margin > 0).any():
        region = where_above(plane.margin, plane.d_3, plane.D_F, 0.0)
        # Where the region goes on beyond the axes there is no edge to draw.
        edges: Any = contour_generator(plane.d_3, plane.D_F, plane.margin).lines(0.0)
        marks += [Area(*xy(region), "green", 0.16, testid="eq6-region"), Line(*xy(joined(edges)), "green", 1.6)]
    marks.append(Area([*plane.d_3, *plane.d_3[::-1]], [*plane.band[0], *plane.band[1, ::-1]], "blue", 0.2))
    for curve, look in ((plane.approximate, ("orange", 1.6, "7 4")), (plane.exact, ("blue", 2.4, ""))):
        real = np.isfinite(curve)
        marks.append(Line(plane.d_3[real], curve[real], *look))
    telecentric = _telecentric(Camera.of(thin))
    marks += [
        Area([near, far, far, near], [0.0, 0.0, up.high, up.high], "grey", 0.9, hatch=True) for near, far in glass
    ]
    if telecentric <= across.high:
        words = "telecentric: d_3 = f" if Camera.of(thin).chain.in_air else "telecentric"
        marks.append(Line([telecentric, telecentric], [0.0, up.high], "grey", 1.2, "8 3 2 3"))
        marks.append(label(telecentric, 0.0, words, "grey", 6.0, -8.0))
    # The design is drawn over the frame, as it may be dragged there.
    x, y = min(thin.d_3, across.high), min(thin.D_F, up.high)
    words = f"d_3 = {short(thin.d_3)} mm, D_F = {short(thin.D_F)} mm"
    marks.append(label(x, y, words, "ink", 14.0, 24.0 if y > 0.9 * up.high else -14.0))
    marks.append(Dots([x], [y], "vermillion", size=8, edge="ground", width=2.5, testid="design-point", cursor="move"))
    nowhere = "" if (plane.margin >= 0).any() else ": nowhere"
    keys = [
        line_key("matched: images just touch, Eq. 7", "blue", 2.4),
        box_key("within ±1 px", "blue", 0.2),
        line_key("approximation, Eq. 8", "orange", 1.6, "7 4"),
        box_key(f"whole sensor undistorted, Eq. 6{nowhere}", "green", 0.16, "green"),
        dot_key("this design", "vermillion", size=5),
        *([box_key("glass stands there", "grey", 0.9, hatch=True)] if glass else []),
    ]
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "FAP distance d_3 [mm]", "FAP diameter D_F [mm]")
    title = (
        f"Plane of FAP diameter and distance for {design.name}, which is at d_3 = {thin.d_3:.4g} mm, "
        f"D_F = {thin.D_F:.4g} mm"
    )
    return one_panel("matching-plane", title, size, panel, keys, left=56, top=12)
