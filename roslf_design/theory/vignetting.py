"""Which rims leave the pupil whole, over which field: Eqs. 5-6 for any number of stops, decentred or not.

The pencil of a field point that fills the flexible angular plane (FAP) covers the FAP's shape on every stop's plane;
the microlens image is undistorted ("full", not a cat's eye) while each lies inside its stop. The main lens is a stop
at distance 0, which is Eq. 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from itertools import combinations, permutations
from itertools import product as pairs_of
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, floats, magnitude, product, ratio
from ..camera import Camera, Number, Rim
from ..design.parts import PATHS
from ..words import listed, number, the
from .chief_rays import Place, chief_rays
from .field_of_view import Lit
from .leaning import leaning_radius, leaning_room
from .light import SensorField, sensor_field
from .stop_images import room_in_pupil, settled

ROUNDING = 1e-12
"""Share of the main lens's diameter that rounding leaves of a room which an optimiser holds at 0."""
LIT = 1 / 3
"""Share of a pencil's width on the axis that is left at least where a field counts as lit: .29 of a disc's light."""


def room_at(c: Camera, object_radius: ArrayLike, places: Array | None = None, *, straight_there: bool = True) -> Array:
    """Room between the pencil of the worst field point at a radius and each rim, on that rim's plane [mm].

    Parameters
    ----------
    c : Camera
        Its tilts are left out.
    object_radius : array_like
        |X_0| on the focal plane, as the main lens sees it [mm].
    places : ndarray, shape (..., P, 2), optional
        Places there at which rims that lean by design, and all where sides are straight, are asked, instead of in the
        worst direction [mm].
    straight_there : bool
        Whether straight sides are.

    Returns
    -------
    ndarray, shape (K, ...)
        One row a rim of `Camera.rims`; negative where that rim cuts the pencil, -inf at d_3 = d_f. With decentres the
        worst direction counts: the field's offset adds to that of the decentres.
    """
    d_f, d_3, radius, gap = *floats(c.seen.d_f, c.seen.d_3, object_radius), c.seen.gap
    room = 2 * magnitude(gap)
    pupil = c.decentre("aperture")

    def at_rim(rim: Rim) -> Array:
        u, v = np.zeros(()), np.zeros(())
        placed = rim.leans or (straight_there and (rim.outline.straight or c.fap.outline.straight))
        if placed := placed and places is not None:
            builds = np.broadcast_shapes(places.shape[:-2], c.shape)
            u, v = np.moveaxis(np.broadcast_to(places, (*builds, *places.shape[-2:])), (-1, -2), (0, 1))
        if rim.leans and placed:
            return np.asarray(rim.scale * leaning_room(c, rim, np.hypot(u, v), np.arctan2(v, u)).min(axis=0))
        if rim.leans:
            return rim.scale * leaning_room(c, rim, radius)
        between, way = d_f - rim.distance, rim.distance - d_3
        x, y = (2 * (o * between - e * gap) for e, o in zip(c.decentre(rim.part), pupil, strict=True))
        left = rim.outline.scaled(room).room(
            c.fap.outline.scaled(2 * magnitude(between)), x + 2 * u * way, y + 2 * v * way
        )
        left = np.min(left, axis=0) if placed else left - 2 * radius * np.abs(way)
        here = settled(ratio(left, room), rim.radius)
        anywhere = room_in_pupil(c, rim)
        return rim.scale * np.where(np.isnan(anywhere), here, anywhere)

    return _rows(c, at_rim)


def _rows(c: Camera, of: Callable[..., Array], *known: Array) -> Array:
    """One row a rim of `Camera.rims`, of all builds; `of` takes a rim, and its rows of what is known."""
    return np.stack(np.broadcast_arrays(*map(of, c.rims, *known), np.zeros(c.shape))[:-1])


def corner_room(c: Camera, field: SensorField | None = None) -> Array:
    """`room_at` the corner of what the sensor sees (`field`, its own by default) that is farthest off the axis.

    Of rims that lean by design, and of all with straight sides, at that of the corners which they leave least; of a
    round field that is required, straight sides are asked all round its rim.
    """
    field, scale = field or sensor_field(c), np.asarray(c.seen.inverse_m)
    corners = -field.corners * scale[..., None, None] if c.leaning or c.has_straight_sides else None
    return room_at(c, field.radius * magnitude(scale), corners, straight_there=not _round(c, field))


def _round(c: Camera, field: SensorField) -> bool:
    """Whether a field is the square in a round one that is required."""
    return bool(c.round_fields) and field is not sensor_field(c)


def _straight_bounds(c: Camera, rim: Rim) -> Iterator[tuple[tuple[float, float], float]]:
    """Sides of the part of the focal plane whose pencils a rim with straight sides leaves whole: normals and distances.

    As the main lens sees it, of one build [mm]; none of round rims and of those that lean by design.
    """
    if rim.leans:
        return
    between, way, gap = (float(z) for z in (c.seen.d_f - rim.distance, rim.distance - c.seen.d_3, c.seen.gap))
    pupil, own = c.decentre("aperture"), c.decentre(rim.part)
    x, y = (2 * float(o * between - e * gap) for e, o in zip(own, pupil, strict=True))
    fap = c.fap.outline.scaled(2 * abs(between))
    for (u, v), edge in rim.outline.scaled(2 * abs(gap)).sides:
        left = float(edge - fap.support(u, v) - u * x - v * y)
        turned = math.copysign(1.0, way)
        yield (turned * float(u), turned * float(v)), float(ratio(left, 2 * abs(way)))


def undistorted_towards(c: Camera, ways: Array) -> Array:
    """Radius on the array to which no rim cuts images, in each of some directions; of one build [mm].

    Parameters
    ----------
    ways : ndarray, shape (N, 2)
        Unit vectors from the main lens's axis.
    """
    scale = float(c.seen.inverse_m)
    away = -math.copysign(1.0, scale) * ways

    def at_rim(rim: Rim, radius: Array) -> Array:
        ends = [ratio(max(edge, 0.0), np.maximum(away @ n, 0.0)) for n, edge in _straight_bounds(c, rim)]
        return np.min(ends, axis=0) if ends else np.maximum(radius, 0.0)

    return np.asarray(_rows(c, at_rim, undistorted_radii(c)).min(axis=0) / abs(scale))


def _cut_from(c: Camera, field: SensorField, rim: Rim, bound: float) -> float:
    """Least radius of the places in a field that a rim cuts [mm]: `bound`, or where straight sides begin to in it."""
    ends = np.sort(np.reshape(field, (2, 2)) * -float(c.seen.inverse_m), axis=0).T
    found = list[float]()
    for (u, v), edge in _straight_bounds(c, rim):
        low, high = -math.inf, math.inf  # of the way along that side
        for start, way, (least, most) in ((edge * u, -v, ends[0]), (edge * v, u, ends[1])):
            if way:
                one, other = sorted(((least - start) / way, (most - start) / way))
                low, high = max(low, one), min(high, other)
            elif not least <= start <= most:
                low, high = math.inf, -math.inf
        if low <= high and edge >= 0:
            found.append(math.hypot(edge, min(max(0.0, low), high)))
    return min(found, default=bound)


def undistorted_radii(c: Camera) -> Array:
    """Largest radius on the focal plane whose pencil each rim leaves whole, in the worst direction [mm].

    As the main lens sees it; the object's own is larger by the magnification of `Camera.focus`.

    Parameters
    ----------
    c : Camera
        Its tilts are left out.

    Returns
    -------
    ndarray, shape (K, ...)
        One row a rim of `Camera.rims`; below 0 where even the axis is cut, by as much as it is. A rim in the FAP's own
        plane cuts all fields alike: inf where it leaves room, else its room.
    """
    d_3, gap = *floats(c.seen.d_3), magnitude(c.seen.gap)

    def at_rim(rim: Rim, room: Array) -> Array:
        if rim.leans:
            return np.where(room >= 0, leaning_radius(c, rim), room)
        bound = product(ratio(room / rim.scale, np.abs(d_3 - rim.distance)), gap)
        alike = np.where(room >= 0, np.inf, room)
        return np.where(np.isnan(room_in_pupil(c, rim)), bound, alike)

    return _rows(c, at_rim, room_at(c, 0.0))


def lit_pairs(c: Camera, towards: Place | None = None) -> Iterator[tuple[Rim, Rim, Array]]:
    """Each two openings, FAP and rims, and the radius on the array to which their common part is `LIT` wide [mm].

    In the worst direction, or towards places, where of straight sides that are met at an angle the shares of both
    widths count together; inf of two that never part. Of discs in a row the common part of all is as wide as that of
    the two that have least. Openings that lean by design are left out.
    """
    d_3, gap = floats(c.seen.d_3, c.seen.gap)
    seen = []
    for rim in filter(lambda rim: not rim.leans, c.openings):
        # On the FAP's plane, from the axis' point on the focal plane; and how far that goes per way on the array.
        between = c.seen.d_f - rim.distance
        scale, way = ratio(gap, between), product(ratio(d_3 - rim.distance, between), c.seen.inverse_m)
        seen.append((rim, rim.outline.scaled(magnitude(scale)), [scale * e for e in c.decentre(rim.part)], way))
    least = 2 * np.min(np.broadcast_arrays(*(outline.inradius for _, outline, *_ in seen)), axis=0)
    for (one, first, (x, y), way), (other, second, (u, v), way_2) in combinations(seen, 2):
        sides = [outline.axes for outline in (first, second) if outline.straight]
        normals = [axis for axes in sides for axis in axes] or [(1.0, 0.0)]
        reach = (first.support(*axis) + second.support(*axis) for axis in normals)
        room = np.min(np.broadcast_arrays(*reach), axis=0) - LIT * least
        room = room - np.sqrt((x - u) ** 2 + (y - v) ** 2)  # complex numbers, too: derivatives
        parting = magnitude(way - way_2)
        never = np.real(parting) == 0
        radius = np.where(never, np.inf, room / np.where(never, 1.0, parting))
        radius = np.where(never & (np.real(room) < 0), -np.inf, np.where(np.isnan(radius), np.inf, radius))
        if towards is not None and sides and np.any(parts := np.isfinite(radius)):
            within = []
            for axes in sides:
                each = [
                    first.support(*n) + second.support(*n) - magnitude(n[0] * (x - u) + n[1] * (y - v)) for n in axes
                ]
                lost = [parting / least * _along(n, towards) for n in axes]
                within.append(_lit_between([width / least for width in each], lost))
            radius = np.where(parts, np.maximum(radius, np.min(np.broadcast_arrays(*within), axis=0)), radius)
        yield one, other, radius


def _along(normal: tuple[Number, Number], towards: Place) -> Array:
    """Part of a way towards places that goes along a direction."""
    x, y = towards
    away = np.sqrt(np.asarray(x * x + y * y))
    return magnitude(normal[0] * x + normal[1] * y) / np.where(away == 0, 1.0, away)


def _lit_between(widths: Sequence[Array], lost: Sequence[Array]) -> Array:
    """Way at which what is left of two widths across each other is `LIT`: of either, at most 1, and of both as product.

    Widths are in units of the whole, and so is what each millimetre of way takes.
    """
    (a, b), (p, q) = widths, lost
    each = [ratio(one - LIT, taken) for one, taken in ((a, p), (b, q))]
    # (a - p r)(b - q r) = LIT at its smaller root, in the form that does not cancel.
    half = (a * q + b * p) / 2
    both = ratio(a * b - LIT, half + np.sqrt(np.square(a * q - b * p) / 4 + p * q * LIT))
    return np.asarray(np.min(np.broadcast_arrays(*each, both), axis=0))


def lit_radius(c: Camera, towards: Place | None = None) -> Array:
    """Radius on the array within which a field counts as lit [mm], everywhere or towards places; below 0 of none."""
    if towards is not None and any(rim.outline.straight for rim in c.openings):
        return np.asarray(np.min(np.broadcast_arrays(*(radius for *_, radius in lit_pairs(c, towards))), axis=0))
    if lit_radius not in c.worked_out:  # several quantities of a camera hang on it
        radii = (radius for *_, radius in lit_pairs(c))
        c.worked_out[lit_radius] = np.asarray(np.min(np.broadcast_arrays(*radii), axis=0))
    radius: Array = c.worked_out[lit_radius]
    return radius


def lit_to(c: Camera) -> Lit:
    """Radius on the array to which light reaches towards places, of a dark camera one microlens [mm]."""
    return lambda x, y: np.maximum(lit_radius(c, (x, y)), c.d / 2)


class _TwoRims(NamedTuple):
    """Farthest from the axis that rays through two openings get, whatever the lens does with them."""

    radius: float
    """On a plane [mm]."""
    chief: float
    """There, of the chief ray to the farthest place in focus that they reach [mm]."""
    slope: float
    """Tangent of that chief ray's angle to the axis."""
    pair: tuple[Rim, Rim]

    @property
    def openings(self) -> str:
        """The two in words."""
        return listed([the(name) for name in dict.fromkeys(rim.opening.partition(",")[0] for rim in self.pair)])

    @property
    def words(self) -> str:
        """Words on that."""
        return f"no ray passes {self.openings} beyond {number(self.radius, 4)} mm there"


def passed(c: Camera, at: float | None = None, left_out: Collection[str] = ()) -> Iterator[_TwoRims]:
    """Farthest that rays from a plane get through each two openings: from one rim past the other side of the next.

    To first order. Of several builds, the corners of a box of lengths, by exact rays and for any camera in the box.

    Parameters
    ----------
    c : Camera
        One build or several.
    at : float, optional
        Distance of the plane ahead of the bore's tip [mm]; None is the focal plane.
    left_out : collection of str
        Parts whose openings are not asked.
    """
    plane = c.focus if at is None else c.plane_ahead(at)
    focus = np.asarray(c.seen.d_f)
    away = focus if at is None else np.asarray(plane.distance)
    if c.chain.mapped or not 0 < away.min() <= (far := float(away.max())) < math.inf:
        return
    upright = [rim for rim in c.openings if not (rim.leans or np.any(rim.behind) or np.max(rim.distance) >= far)]
    grown, off = float(np.max(magnitude(plane.magnification))), float(np.max(np.hypot(*c.decentre("aperture"))))
    pupils = float(np.min(c.seen.d_3)), float(np.max(c.seen.d_3))
    for near, outer in permutations((rim for rim in upright if rim.part not in left_out), 2):
        one, other = (rim.radius + np.hypot(*c.decentre(rim.part)) for rim in (near, outer))
        first = float(np.min(outer.distance))
        if first <= np.max(near.distance):
            continue
        # In each length it rises or falls throughout, so that its most is at a corner.
        radius = other + _steepest(c, (one + other) / (outer.distance - near.distance)) * (away - outer.distance)
        other, slope = np.max(other), float(_steepest(c, np.max(one + other) / (first - np.max(near.distance))))
        # A chief ray's slope, and where it meets the plane, rise or fall throughout with the focal plane and the FAP.
        nearest = max(float(np.min(focus, where=focus > 0, initial=math.inf)), first)
        ends = nearest, math.inf if np.any(focus <= 0) else float(focus.max())
        leans = [
            (z, slope if end == math.inf else (off + other + slope * (end - first)) / max(end - z, math.ulp(0.0)))
            for z, end in pairs_of(pupils, ends)
        ]
        chief = off + max(lean * (far - z) for z, lean in leans) * grown
        yield _TwoRims(float(np.max(radius)) * grown, chief, max(lean for _, lean in leans), (near, outer))


def _steepest(c: Camera, slope: Array) -> Array:
    """Slope of the steepest rays between openings, from that to first order: through glass they go steeper."""
    if not (c.shape and c.chain.elements):
        return slope
    return np.asarray(np.where(slope < 1, ratio(slope, np.sqrt(np.maximum(1 - slope**2, 0.0))), np.inf))


def lit_field(c: Camera, field: SensorField) -> SensorField:
    """Part of a part of the array within the circle that light reaches."""
    radius = lit_radius(c)
    (left, below), (right, above) = field
    return SensorField(
        (np.maximum(left, -radius), np.maximum(below, -radius)), (np.minimum(right, radius), np.minimum(above, radius))
    )


def on_focal_plane(c: Camera, radii: Array) -> Array:
    """Radii on the focal plane as the main lens sees them, where they are [mm]: along chief rays, of either sign."""
    straight = radii * magnitude(c.focus.magnification)
    if not c.chain.bends_rays:
        return straight
    places = np.where(np.isfinite(radii), np.abs(radii), 0.0) / magnitude(c.seen.inverse_m)
    rays = chief_rays(c, (np.stack([places, np.zeros_like(places)]), np.zeros(())))
    x, y = rays.on_plane(c[PATHS["d_f"]])
    met = np.copysign(np.hypot(x[0] - x[1], y[0] - y[1]), radii)
    return np.where(np.isfinite(radii), met, straight)


def field_margins(c: Camera) -> Array:
    """Margins by which limits on the undistorted field are judged where no field may be too large.

    Parameters
    ----------
    c : Camera
        Its tilts are left out.

    Returns
    -------
    ndarray, shape (K, 3, ...)
        Of each rim of `Camera.rims` the undistorted radius r where it is [mm], the room on the axis a and what each
        millimetre of radius takes of it b: all finite but r, and ``a - r b`` is 0.
    """
    radii, room = on_focal_plane(c, undistorted_radii(c)), room_at(c, 0.0)
    d_3, gap, grown = *floats(c.seen.d_3), magnitude(c.seen.gap), magnitude(c.focus.magnification)

    def first_order(rim: Rim) -> Array:
        return np.where(np.isnan(room_in_pupil(c, rim)), rim.scale * np.abs(d_3 - rim.distance) / (gap * grown), 0.0)

    taken = _rows(c, first_order)
    if c.chain.bends_rays:  # the radius is that of a traced ray
        taken = np.where(np.isfinite(radii) & (radii != 0), ratio(room, radii), taken)
    return np.stack([radii, *np.broadcast_arrays(room, taken)], axis=1)


class _FieldLimit(NamedTuple):
    """Limit of the undistorted field of one camera."""

    radius: float
    """Largest undistorted object radius at d_f, in the worst direction [mm]; inf where no field is too large."""
    mla_radius: float
    """Radius where its chief ray meets the array [mm]."""
    rim: str
    """The rim that ends it; where what the sensor sees is cut, the one that cuts first in that."""
    clearance: float
    """Least room between a pencil and any rim at the field's farthest corner, on the rim's plane [mm]."""
    nearest: str
    """The rim that leaves that."""
    cuts: list[dict[str, Any]]
    """Rims that cut what the sensor sees, by more than an optimiser's rounding may leave, the first of them first: each
    with the object radius beyond which it does and the room at the farthest corner, below 0 [mm]. The first cuts beyond
    `radius` where a rim that leans or has straight sides ends that in a direction that the sensor does not see."""

    @property
    def numbers(self) -> dict[str, Any]:
        """Numbers by their keys in the JSON of an evaluation."""
        return {
            "x0_max_mm": self.radius,
            "x_ml_max_mm": self.mla_radius,
            "room_at_corner_mm": self.clearance,
            "nearest_rim": self.nearest,
            "limited_by": self.rim,
            "cut_beyond_mm": self.cuts[0]["beyond_mm"] if self.cuts else np.inf,
            "cut_by": self.cuts,
        }


def field_limit(c: Camera, field: SensorField | None = None) -> _FieldLimit:
    """Largest undistorted field of one camera, and the room left at the corner of what the sensor sees.

    Parameters
    ----------
    c : Camera
        One build; its tilts are left out.
    field : SensorField, optional
        The part of it that is judged.
    """
    bounds = np.array([max(float(bound), 0.0) for bound in undistorted_radii(c)])
    rooms = [float(room) for room in corner_room(c, field)]
    nearest, slack = int(np.argmin(rooms)), ROUNDING * float(c.D)
    seen = field or sensor_field(c)
    begin = bounds if _round(c, seen) else np.array([*map(partial(_cut_from, c, seen), c.rims, bounds)])
    first, *others = sorted(range(len(rooms)), key=lambda k: (rooms[k] >= -slack, begin[k], rooms[k]))
    whole, real = on_focal_plane(c, np.stack([bounds, begin], axis=-1)).T.tolist()
    cuts = [
        {"rim": c.rims[k].opening, "beyond_mm": real[k], "clearance_mm": rooms[k]}
        for k in (first, *others)
        if rooms[k] < -slack
    ]
    ends, names = int(np.argmin(bounds)), (c.rims[first].opening, c.rims[nearest].opening)
    on_array = float(bounds[ends]) / abs(float(c.seen.inverse_m))
    return _FieldLimit(whole[ends], on_array, names[0], rooms[nearest], names[1], cuts)
