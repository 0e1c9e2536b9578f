"""Curves of a design: depth, expected, over distance; in the plane of D_F and d_3, where f-numbers match."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._arrays import Array
from ...camera import Camera
from ...design import PATHS, Design
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
from ...evaluation.fields import judged_part
from ...evaluation.required import required_distances
from ...evaluation.working_range import WorkingRange
from ...theory.depth_budget import BUILT, CALIBRATED, COVERAGE, DepthBudget, depth_budget
from ...theory.depth_error import depth_at, errors_at_fields
from ...theory.f_number import matched, mismatch_px
from ...theory.field_of_view import focus_ahead, judged_field
from ...theory.length_covariance import CalibratedLengths, LengthCovariance
from ...theory.light import SensorField
from ...theory.light_field import rim_disparity
from ...theory.limits import limits
from ...theory.quantities import noise_words
from ...theory.stop_images import MicrolensImages
from ...theory.vignetting import corner_room
from ...words import listed

LOOKS = (("blue", ""), ("orange", "7 4"), ("green", "8 3 2 3"))
"""Colour and line of each design that is compared."""
BOUND = "purple", 1.6, "8 3 2 3"
"""Colour, width and line of the bound of depth, beside depth, expected: told apart with any colour vision, and in grey.
"""
UNCERTAINTY = f"depth, U (k = {COVERAGE}) [mm]"
"""Axis of depth, as the pages quote it."""
UNKNOWN = box_key("unknown", "grey", 0.9, hatch=True)
ABOUT = 0.4, 1.8
"""Ends of the distances drawn, in distances of the focal plane, where depth is of use at none or at all."""
NEAREST, ROUND = 0.1, 1.04
"""Nearest end of them, in distances of the focal plane; factor by which they go beyond the focal plane and what is
required."""
DECADES = 6.0
"""Ratio of an axis's ends from which it is logarithmic."""
FIELDS = 21
"""Number of points from the centre of the field to its corner."""
POINTS = 121
"""Number of points along each axis of the plane of D_F and d_3."""

LEFT = 1.3
"""How far beyond a FAP behind the lens the plane reaches, over its distance."""


@dataclass(frozen=True, eq=False)
class KnownLengths:
    """How sure lengths are, for depth as expected; hashed by identity, as covariances are by none."""

    build: LengthCovariance | None = None
    calibration: CalibratedLengths | None = None
    at: tuple[float, ...] = ()
    """Distances ahead of the tip that were asked for [mm], which curves reach."""

    def budget(self, camera: Camera, at: Array | float | None, *, worst: bool = True) -> DepthBudget:
        """Budget of depth at distances ahead of the tip [mm]; None is the focal plane."""
        return depth_budget(camera, at, build=self.build, calibration=self.calibration, worst=worst)


AS_DRAWN = "lengths as drawn"


def counted_lengths(budget: DepthBudget) -> str:
    """Lengths that depth, expected, counts, in words."""
    lengths = [term.name for term in budget.terms if term.name in (BUILT, CALIBRATED) and term.u_mm is not None]
    return f"with {listed(lengths)}" if lengths else AS_DRAWN


DRAWN = KnownLengths()
"""Lengths as drawn: nothing is known of how a workshop makes them."""


class _DepthCurve(NamedTuple):
    """Depth, expected, and its bound over distance."""

    distance: Array
    """Distance ahead of the tip [mm], shape (N,)."""
    expected: Array
    """u_Z [mm]."""
    sigma: Array
    """sigma_Z, that of noise alone [mm]."""
    blur: Array
    """Spread of an object point over the MLA [microlens pitches]."""
    focus: float
    """Distance of the focal plane [mm]."""
    in_focus: float
    """u_Z there [mm]."""
    least: float
    """sigma_Z there [mm]."""
    counts: str
    """Lengths that u_Z counts, in words."""


def _shown_range(design: Design, camera: Camera, known: KnownLengths) -> tuple[float, float, tuple[float, ...]]:
    """Ends of the distances that are drawn, and the focal plane and those that are asked for [mm].

    The working range with the focal plane and what is required or asked for; about the focal plane where there is none.
    """
    focus, required = float(focus_ahead(camera)), (*required_distances(design, math.inf), *known.at)
    if not 0 < focus < math.inf:
        return ABOUT[0] * focus, ABOUT[1] * focus, ()
    near, far = WorkingRange.of(camera, partial(known.budget, camera)).ends or (ABOUT[0] * focus, ABOUT[1] * focus)
    near, far = max(near, NEAREST * focus), far if math.isfinite(far) else ABOUT[1] * focus
    ends = near, far, focus / ROUND, focus * ROUND, *(at / ROUND for at in required), *(at * ROUND for at in required)
    return min(ends), max(ends), (focus, *required)


@lru_cache(maxsize=2)
def _depth_curve(design: Design, points: int = 241, known: KnownLengths = DRAWN) -> _DepthCurve:
    """Depth, expected, over the working range and all distances required or asked for."""
    camera = Camera.of(design)
    low, high, among = _shown_range(design, camera, known)
    focus, spaced = float(focus_ahead(camera)), np.geomspace if high > DECADES * low > 0 else np.linspace
    ahead = np.union1d(spaced(low, high, points), among)
    blur = np.abs(rim_disparity(camera, depth_at(camera, ahead)))
    along, here = known.budget(camera, ahead), known.budget(camera, None)
    u, bound = (np.broadcast_to(np.asarray(u, float), ahead.shape) for u in (along.u_z_mm, along.terms[0].u_mm))
    return _DepthCurve(
        ahead, u, bound, blur, focus, float(here.u_z_mm), float(np.asarray(here.terms[0].u_mm, float)),
        counted_lengths(here),
    )  # fmt: skip


def depth_precision(design: Design, size: Point = (560, 320), known: KnownLengths = DRAWN) -> Picture:
    """Draw U and its bound over the distance ahead of the tip, both k = 2, what is required of them, and the defocus.

    The picture's mapping takes pixels to that distance and depth's uncertainty [mm]; `size` in px, and higher by what
    the keys of what is required take.
    """
    distance, expected, sigma, blur, ahead, focus, _, counts = curve = _depth_curve(design, 121, known)
    expected, sigma, focus = COVERAGE * expected, COVERAGE * sigma, COVERAGE * focus
    finite = np.isfinite(expected)
    drawn = _depth_keys(design, counts) if finite.any() else ()
    keys = [*drawn, line_key("spread of a point on the MLA (right axis)", "orange", 1.8, "7 4")]
    asked, told = _asked_of_depth(design, curve)
    across = Scale(float(distance[0]), float(distance[-1]))
    across = across._replace(log=across.high > DECADES * across.low > 0)
    limited = [float(y) for mark in asked if isinstance(mark, Dots) for y in np.ravel(mark.y)]
    up = _up([*expected[finite], *sigma[finite], *limited])
    sharp = (
        f"± {short(focus, 3)} mm"
        if math.isfinite(focus)
        else "unknown, as light, texture or images that overlap give none"
    )
    width, at_focus = max(size[0] - 114, 80.0), sharp.partition(",")[0]
    # Between the curves, which leave the upper middle free; never beyond the panel.
    at = float(across.share(ahead)) * width
    words = f"in focus at {short(ahead)} mm: {at_focus}"
    if text_width(words, SMALL) + 16 > max(at, width - at):
        words = f"in focus: {at_focus}"
    long = text_width(words, SMALL)
    start = max(at - 8 - long if at + long + 16 > width else at + 8, min(4.0, width - long))
    dots: list[Mark] = [*_unknown(distance, finite, up)]
    if not finite.all():
        keys.append(UNKNOWN)
    if math.isfinite(focus):
        dots.append(Dots([ahead], [focus], "vermillion", size=6, edge="ground", width=2))
    marks: tuple[Mark, ...] = (
        Line([ahead] * 2, [up.low, up.high], "grey", 1.2, "6 3"),
        Line(distance[finite], expected[finite], "blue", 2.2, testid="depth-curve"),
        Line(distance[finite], sigma[finite], *BOUND, testid="sigma-curve"),  # on top, as they may coincide
        *dots,
        *(replace(mark, y=[up.low, up.high]) if isinstance(mark, Line) else mark for mark in asked),
        Text(ahead, up.high, words, "ink", SMALL, "start", start - at, 14, halo=True),
    )
    labels = "distance ahead of the tip [mm]", UNCERTAINTY
    panel = Panel((0, 0, 1, 1), across, up, marks, *labels)
    title = f"Depth, expected, of {design.name}: {sharp} at the focal plane, {ahead:.4g} mm ahead of the tip"
    tall = size[1] + legend_height(told, size[0] - 24)
    picture = one_panel("depth", title, (size[0], tall), panel, [*keys, *told], right=56)
    other = Scale(0.0, 1.08 * max(float(np.max(blur)), 1e-9))
    spread = Panel(
        picture.panels[0].box, across, other, (Line(distance, blur, "orange", 1.8, "7 4"),),
        y_label="spread [pitches]", x_ticks=(), grid="", right=True, y_colour="lost",
    )  # fmt: skip
    return picture.with_panels(spread)


def _depth_keys(design: Design, counts: str) -> tuple[Key, Key]:
    """Keys of depth as expected, of what it counts, and of its bound."""
    given = design.depth.disparity_error is not None
    return (
        line_key(f"U, depth, expected, {counts}", "blue", 2.2),
        line_key(f"2 σ_Z, {noise_words(True) if given else 'its bound by photons and read noise'}", *BOUND),
    )


def _asked_of_depth(design: Design, curve: _DepthCurve) -> tuple[list[Mark], list[Key]]:
    """Signs of what a design requires of depth, at distances that are drawn, lines at others required; their keys."""
    signs: list[Mark] = []
    keys: list[Key] = []
    told = {"u_z_mm": ("U", curve.expected, curve.in_focus), "sigma_z_mm": ("2 σ_Z", curve.sigma, curve.least)}
    others: dict[float, None] = {}
    for asked, quantity, _, most in limits(design):
        at = curve.focus if asked.at is None else asked.at
        if quantity.name not in told or not curve.distance[0] <= at <= curve.distance[-1]:
            continue
        if asked.off_axis is not None or most is None:
            others[at] = None
            continue
        symbol, values, here = told[quantity.name]
        value = here if asked.at is None else float(np.interp(at, curve.distance, values))
        met = bool(quantity.within(None, most, value))
        drawn_alone = met and quantity.name == "u_z_mm" and curve.counts == AS_DRAWN
        look = ("orange" if drawn_alone else "green" if met else "vermillion", "v")  # the colours of verdicts
        signs.append(Dots([at], [COVERAGE * most], *look, size=5, edge="ground", width=1, testid="required"))
        outcome = f"met{' as drawn' * drawn_alone}" if met else "missed"
        words = f"required: {symbol} at most {short(COVERAGE * most)} mm at {short(at)} mm, {outcome}"
        keys.append(dot_key(words, *look))
        others.pop(at, None)
    if others:
        signs += [Line([at, at], [0.0, 0.0], "ink", 1.0, "2 3", testid="required-distance") for at in others]
        keys.append(line_key(f"required at {listed([f'{short(at)} mm' for at in others])}", "ink", 1.0, "2 3"))
    return signs, keys


def _up(values: Sequence[float]) -> Scale:
    """Ordinate for uncertainties, from 0 or, where they differ by much, logarithmic."""
    low, high = min(values, default=0.0), max(values, default=0.0)
    if not high > 0:
        return Scale(0.0, 1.0)
    return Scale(low / 1.3, high * 4.0, log=True) if high > DECADES * low > 0 else Scale(0.0, 1.15 * high)


class _FieldCurve(NamedTuple):
    """Depth, expected, and its bound over the field."""

    place: Array
    """Place of the microlens, from the centre of what the sensor sees to its corner [mm on the array], shape (N,)."""
    sigma: Array
    """sigma_Z at the focal plane [mm]; inf where it is unknown."""
    expected: Array
    """u_Z there, lengths as drawn [mm]."""


@lru_cache(maxsize=2)
def field_curve(design: Design) -> _FieldCurve:
    """Depth at the focal plane from the centre of what the sensor sees to its corner."""
    centre, _, corner = np.array(default_fields(design))
    share = np.linspace(0.0, 1.0, FIELDS)
    images = MicrolensImages(Camera.of(design), centre + share[:, None] * (corner - centre))
    each = (np.broadcast_to(error, (FIELDS, 1))[:, 0] for error in errors_at_fields(images))
    return _FieldCurve(share * float(np.hypot(*(corner - centre))), *each)


def depth_over_field(design: Design, size: Point = (560, 320)) -> Picture:
    """Draw U and its bound, k = 2, at the focal plane over the field, from its centre to its corner; `size` in px."""
    place, sigma, expected = field_curve(design)
    sigma, expected = COVERAGE * sigma, COVERAGE * expected
    known = np.isfinite(expected)
    best = float(np.min(expected[known], initial=math.inf))
    across = Scale(0.0, float(place[-1]) or design.d / 2)
    # A cut image's error grows without bounds.
    up = Scale(0.0, min(1.15 * float(np.max(expected[known], initial=0.0)), 20 * best) if known.any() else 1.0)
    shown, bound = (np.where(known, np.minimum(each, 2 * up.high), np.nan) for each in (expected, sigma))
    drawn: Mark = Line(place[known], shown[known], "blue", 2.2, testid="field-curve")
    if not place[-1] > 0:  # a single microlens sees all
        drawn = Dots(place[known][:1], shown[known][:1], "blue", size=6, testid="field-curve")
    marks = (*_unknown(place, known, up), Line(place[known], bound[known], *BOUND), drawn)
    labels = "microlens, from the field's centre to its corner [mm]", UNCERTAINTY
    curves = _depth_keys(design, "in the plane in focus, lengths as drawn") if known.any() else ()
    keys = [*curves, *([] if known.all() else [UNKNOWN])]
    ends = [f"± {short(float(value), 3)} mm" if math.isfinite(value) else "unknown" for value in expected[[0, -1]]]
    title = f"Depth, expected, of {design.name} over the field: {ends[0]} at its centre, {ends[1]} at its corner"
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
    """Draw U and, thin, its bound, k = 2, of up to three named designs over the distance ahead of the tip; log axes."""
    marks: list[Mark] = []
    keys: list[Key] = []
    xs, ys = [], []
    for (name, design), (colour, dash) in zip(designs.items(), LOOKS, strict=False):
        curve = _depth_curve(design)
        known = np.isfinite(curve.expected)
        expanded, bound = COVERAGE * curve.expected[known], COVERAGE * curve.sigma[known]
        xs.append(curve.distance[known])
        ys.append(np.concatenate([expanded, bound]))
        marks.append(Line(xs[-1], expanded, colour, 2.0, dash))
        marks.append(Line(xs[-1], bound, colour, 0.8, dash))
        if math.isfinite(curve.in_focus):
            marks.append(Dots([curve.focus], [COVERAGE * curve.in_focus], colour, size=5, edge="ground", width=1.5))
        keys.append(line_key(f"{name}: {design.name}", colour, 2.0, dash))
    every = [np.concatenate(values) for values in (xs, ys)]
    across, up = (Scale(np.min(v, initial=1e9) / 1.15, np.max(v, initial=1e-9) * 1.15, log=True) for v in every)
    panel = Panel(
        (0, 0, 1, 1), across, up, tuple(marks), "distance ahead of the tip [mm]", f"{UNCERTAINTY}, thin: 2 σ_Z"
    )
    title = f"Depth, expected, of {', '.join(design.name for design in designs.values())}"
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
    """Smallest non-distortion margin at the sensor's corner, or the rim of a round field that is required (Eqs. 5-6)
    [mm^2], shape (M, N); full discs where >= 0."""


def _plane_of(design: Design, limits: Point | None = None) -> _MatchingPlane:
    """Curves and map over ranges in which the design and the matched curve are both seen.

    `limits` are other ends of the ranges, of d_3 and D_F [mm]; d_3 stops short of the focal plane.
    """
    camera = Camera.of(design)
    left = min(0.0, LEFT * design.d_3)
    d_3 = np.linspace(
        left, _right(design, camera) if limits is None else min(limits[0], design.d_f * (1 - 1e-3)), POINTS
    )
    exact, approximate = (matched(camera.replace({"d_3": d_3}), "D_F", exact=law).value for law in (True, False))
    here = float(matched(camera, "D_F").value)
    largest = float(np.max(exact, initial=0.0, where=np.isfinite(exact)))
    chosen = 1.35 * max(design.D_F, here if math.isfinite(here) else 0.0, 0.75 * largest)
    D_F = np.linspace(0.0, chosen if limits is None else limits[1], POINTS)
    across, up = np.meshgrid(d_3, D_F)
    # The mismatch is linear in D_F.
    low, high = mismatch_px(camera.replace({"d_3": across[[0, -1]], "D_F": up[[0, -1]]}))
    band = (np.array([[-1.0], [1.0]]) - low) / (high - low) * D_F[-1]
    field = judged_field(camera.replace({"d_3": d_3}))
    return _MatchingPlane(
        d_3, exact, approximate, band, D_F, _margin(camera.replace({"d_3": across, "D_F": up}), field)
    )


def _margin(camera: Camera, field: SensorField) -> Array:
    """Linear in D_F and in d_3, unlike the room itself."""
    before = [place for place in camera.numbers if not place.startswith(("microlens_array.", "sensor."))]
    centred = camera.replace({place: 0.0 for place in before if ".decentre." in place})
    return np.asarray(2 * np.abs(camera.seen.gap) * corner_room(centred, field).min(axis=0))


def _telecentric(camera: Camera) -> float:
    """Where the FAP is seen at f, with a ruler [mm]; nan where flat glass stands there, or lenses before it."""
    if camera.chain.in_air:
        return float(camera.f)
    return math.nan if camera.chain.bends else float(camera.chain.stands_at(camera.numbers, camera.f))


def _right(design: Design, camera: Camera) -> float:
    """A d_3 beyond the design, telecentricity, the undistorted region and the match for the design's own D_F."""
    d_f, d_3 = (float(camera[PATHS[symbol]]) for symbol in ("d_f", "d_3"))
    reach = d_f * (1 - 1e-3)
    tried = np.linspace(0.0, reach, 401)
    moved = camera.replace({"d_3": tried, "D_F": np.zeros_like(tried)})
    clear = tried[_margin(moved, judged_field(moved)) >= 0]
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
        Its decentres are left aside, and a real lens is taken as its thin-lens model.
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
    dots = "grey", 1.2, "8 3 2 3"
    if telecentric <= across.high:
        marks.append(Line([telecentric, telecentric], [0.0, up.high], *dots))
    # The design is drawn over the frame, as it may be dragged there.
    x, y = min(thin.d_3, across.high), min(thin.D_F, up.high)
    marks.append(Dots([x], [y], "vermillion", size=8, edge="ground", width=2.5, testid="design-point", cursor="move"))
    telecentric_key = line_key(f"telecentric{': d_3 = f' * Camera.of(thin).chain.in_air}", *dots)
    nowhere = "" if (plane.margin >= 0).any() else ": nowhere"
    keys = [
        line_key("matched: images just touch, Eq. 7", "blue", 2.4),
        box_key("within ±1 px", "blue", 0.2),
        line_key("approximation, Eq. 8", "orange", 1.6, "7 4"),
        box_key(f"{judged_part(design)} undistorted, Eq. 6{nowhere}", "green", 0.16, "green"),
        dot_key(f"this design: d_3 = {short(thin.d_3)} mm, D_F = {short(thin.D_F)} mm", "vermillion", size=5),
        *([telecentric_key] if telecentric <= across.high else []),
        *([box_key("glass stands there", "grey", 0.9, hatch=True)] if glass else []),
    ]
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "FAP distance d_3 [mm]", "FAP diameter D_F [mm]")
    title = (
        f"Plane of FAP diameter and distance for {design.name}, which is at d_3 = {thin.d_3:.4g} mm, "
        f"D_F = {thin.D_F:.4g} mm"
    )
    return one_panel("matching-plane", title, size, panel, keys, left=56, top=12)
