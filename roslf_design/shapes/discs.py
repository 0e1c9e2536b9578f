"""Common part of K discs: the shape of a microlens image, as its stops cut it out of the pupil's disc.

The common part is convex: a polygon of the crossing points plus one circular cap per arc, all of them positive. Sums of
positives lose nothing, so thin shapes are as good as thick ones. Positions are counted from disc 0.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import Kernel, kernel
from ..fates import ImageFate
from .circles import INSIDE, NODES, WEIGHTS, between, cap, trace

Floats = NDArray[np.float64]
Array = Floats

EMPTY, CLIPPED, FULL = int(ImageFate.DARK), int(ImageFate.CLIPPED), int(ImageFate.FULL)
"""Fates of disc 0 as kernels take them: nothing left, part left, whole."""

DISC = 2e-5
"""Seconds that each disc of a shape takes interpreted."""

LARGEST = 1e70
"""Lengths [mm] beyond which squares of areas overflow."""


class DiscIntersection(NamedTuple):
    """Shapes of the common parts of discs; leading axes are those of the input. Never NaN: see `lit`."""

    area: Array
    """Area [mm^2], shape (...)."""
    centroid: Array
    """Centroid [mm], shape (..., 2), in the coordinates of the centres; of an empty part, the centre of disc 0."""
    second_moments: Array
    """Central second moments per unit area, (xx, xy, yy) [mm^2], shape (..., 3): the covariance of a point drawn evenly
    from the part. 0 for an empty part; r^2/4, 0, r^2/4 for a disc."""
    kept_fraction: Array
    """Area over that of disc 0, shape (...)."""
    lost_fraction: Array
    """1 - kept_fraction, shape (...), right relative to itself: where little is lost, it is what was computed."""
    status: NDArray[np.int8]
    """`ImageFate`, shape (...): is disc 0 whole (FULL), cut (CLIPPED) or gone (DARK)."""
    clipping: NDArray[np.bool_]
    """Shape (..., K): which discs other than 0 cut. Those whose circle bounds the part or, where that is empty, a pair
    without a common point, or all that bound the empty part together."""

    @property
    def lit(self) -> NDArray[np.bool_]:
        """Whether there is any common part at all, shape (...)."""
        return np.asarray(self.status != ImageFate.DARK)

    @property
    def axis_ratio(self) -> Array:
        """Minor over major axis of the ellipse with the same second moments, shape (...): 1 for a disc, 0 if empty."""
        xx, xy, yy = np.ascontiguousarray(np.moveaxis(self.second_moments, -1, 0))
        half = 0.5 * (xx - yy)
        major = 0.5 * (xx + yy) + np.sqrt(half * half + xy * xy)
        # Product of the eigenvalues over the larger one: the smaller one without a difference of eigenvalues.
        minor = np.divide(xx * yy - xy * xy, major, out=np.zeros_like(major), where=major > 0)
        return np.asarray(np.sqrt(np.divide(np.maximum(minor, 0.0), major, out=np.zeros_like(major), where=major > 0)))


class _Arc(NamedTuple):
    """Piece of a circle, counterclockwise."""

    disc: int
    """Index of the disc whose circle it is on."""
    start: float
    """Angle about that disc's centre [rad], in [0, 2 pi)."""
    end: float
    """[rad], above `start` by at most 2 pi."""


def intersect(centres: ArrayLike, radii: ArrayLike) -> DiscIntersection:
    """Area, centroid, moments and losses of the common part of K discs, in batches.

    Parameters
    ----------
    centres : array_like
        Centres [mm], shape (..., K, 2). Disc 0 is the reference: for a microlens image the flexible angular plane
        (FAP), so that `kept_fraction` is 1 when the image is undistorted.
    radii : array_like
        Radii [mm], shape (..., K), broadcast against the centres' leading axes. 0 (or below 1e-70) is empty.

    Returns
    -------
    DiscIntersection

    Raises
    ------
    ValueError
        Shapes that do not fit, a negative radius, a number that is not finite or beyond 1e70.

    Notes
    -----
    For the numbers exactly as given, whatever their distance from tangency or containment: with one or two discs that
    count (those around another do not), areas, lost fractions and moments are right to about 2e-15 of themselves.
    With more, areas to about 1e-15 of the smallest disc's where radii lie within a factor of ten, and lost fractions to
    about 1e-15 divided by the angle [rad] that a notch takes of disc 0's rim: 1e-11 for a loss of 1e-12.
    """
    centre, radius = checked(centres, radii)
    lead, k = radius.shape[:-1], radius.shape[-1]
    compiled = shapes.pays(DISC * radius.size)
    return common(shapes, compiled, lead, k, centre.reshape(-1, k, 2), radius.reshape(-1, k))


def common(kernel: Kernel[..., None], compiled: bool, lead: tuple[int, ...], k: int, *sets: Any) -> DiscIntersection:
    """Run a kernel over n sets of k openings, arrays (n, ...), and lay out the table that it fills.

    The table's columns, shape (n, 8), are area, kept and lost fraction, centroid, moments.
    """
    n = len(sets[0])
    table, status, clipping = np.empty((n, 8)), np.empty(n, np.int8), np.empty((n, k), np.bool_)
    (kernel.compiled if compiled else kernel.interpreted)(*sets, table, status, clipping)
    area, kept, lost = table[:, :3].T.reshape(3, *lead)
    return DiscIntersection(
        area,
        table[:, 3:5].reshape(*lead, 2),
        table[:, 5:].reshape(*lead, 3),
        kept,
        lost,
        status.reshape(lead),
        clipping.reshape(*lead, k),
    )


def _boundary_arcs(centres: ArrayLike, radii: ArrayLike) -> tuple[_Arc, ...]:
    """Boundary of one common part, counterclockwise: one arc of a whole turn for a full disc, () if empty.

    Parameters
    ----------
    centres, radii : array_like
        Shapes (K, 2) and (K,) [mm].
    """
    centre, radius = checked(centres, radii)
    if radius.ndim != 1:
        raise ValueError(f"boundary_arcs takes one shape, radii of shape (K,), not {radius.shape}: call it for each")
    k = len(radius)
    discs, arcs = np.column_stack([centre, radius, np.empty(k)]), np.empty((k * k, 5))
    count, _, _ = trace.interpreted(discs, np.empty((k, 2)), arcs)
    return tuple(_Arc(int(disc), float(start), float(end)) for start, end, disc, _, _ in arcs[:count])


class Chords(NamedTuple):
    """Rows across a common part, whose sums are integrals over it; no rows where it is empty."""

    height: Array
    """Place of each along y [mm], shape (..., N)."""
    weight: Array
    """Weight of each chord in an integral along y [mm]."""
    left: Array
    """Place along x where each begins [mm]."""
    right: Array


def chords(centres: ArrayLike, radii: ArrayLike, rows: int) -> Chords:
    """Gauss-Legendre rows across one common part, in an angle that takes the roots at its ends away.

    Parameters
    ----------
    centres, radii : array_like
        Shapes (K, 2) and (K,) [mm].
    rows : int
        N.
    """
    centre, radius = np.asarray(centres, float), np.asarray(radii, float)
    ends: list[float] = []
    for disc, start, end in _boundary_arcs(centre, radius):
        angles = [start, end, *(top for k in range(-3, 8) if start < (top := math.pi / 2 * (2 * k + 1)) < end)]
        ends += [centre[disc, 1] + radius[disc] * math.sin(angle) for angle in angles]
    low, high = (min(ends), max(ends)) if ends else (0.0, 0.0)
    return rows_between(centre, radius, low, high, rows) if high > low else Chords(*(np.zeros(0) for _ in range(4)))


def rows_between(centres: Array, radii: Array, low: ArrayLike, high: ArrayLike, rows: int) -> Chords:
    """Gauss-Legendre rows between two heights [mm], as `chords`: of width 0 beyond a part, all where none is between.

    Leading axes: centres (..., K, 2), radii (..., K), heights (...), and the chords (..., N).
    """
    y, weight = heights(low, high, rows)
    off = y[..., None, :] - centres[..., 1, None]
    reach = np.sqrt(np.maximum((radii[..., None] - off) * (radii[..., None] + off), 0.0))
    left = (centres[..., :1] - reach).max(-2)
    right = np.maximum((centres[..., :1] + reach).min(-2), left)
    return Chords(y, weight, left, right)


def heights(low: ArrayLike, high: ArrayLike, rows: int) -> tuple[Array, Array]:
    """Gauss-Legendre rows between two heights (...) [mm], and their weights: both (..., N), as of `chords`."""
    nodes, weights = gauss_legendre(rows)
    angle = nodes * (math.pi / 2)
    low, high = (np.asarray(v)[..., None] for v in (low, high))
    half = np.maximum(high - low, 0.0) / 2
    return (low + high) / 2 + half * np.sin(angle), half * np.cos(angle) * weights * (math.pi / 2)


class Outline(NamedTuple):
    """Outline of a closed line through points, from its first edge to its last; straight between points' heights."""

    steps: Array
    """Heights of the points, rising, shape (K,) [mm]."""
    first: Array
    """Ends of the first edges along x, shape (K - 1, 2) [mm]."""
    last: Array

    @classmethod
    def of(cls, points: Array) -> Outline:
        """Outline of points (K, 2) [mm] whose line does not cross itself."""
        steps = np.unique(points[:, 1])
        (x0, y0), (x1, y1) = points.T[..., None, None], np.roll(points, -1, axis=0).T[..., None, None]
        between = np.stack([steps[:-1], steps[1:]], axis=-1)
        middle = between.mean(-1, keepdims=True)
        crossed = (y0 <= middle) != (y1 <= middle)
        share = np.divide(between - y0, y1 - y0, out=np.zeros((len(points), *between.shape)), where=crossed)
        at, centre = x0 + (x1 - x0) * share, (x0 + (x1 - x0) * share.mean(-1, keepdims=True))[..., 0]
        crossed = crossed[..., 0]
        first = np.where(crossed, centre, np.inf).argmin(0)
        last = np.where(crossed, centre, -np.inf).argmax(0)
        row = np.arange(len(between))
        return cls(steps, at[first, row], at[last, row])

    @property
    def between(self) -> tuple[float, float]:
        """Lowest and highest place [mm]."""
        return float(self.steps[0]), float(self.steps[-1])

    def ends(self, y: Array) -> Array:
        """First and last edge along x at heights within, shape (2, N) [mm]."""
        y = np.clip(y, *self.between)
        k = np.clip(np.searchsorted(self.steps, y) - 1, 0, len(self.steps) - 2)
        share = (y - self.steps[k]) / (self.steps[k + 1] - self.steps[k])
        return np.stack([edge[k, 0] + share * (edge[k, 1] - edge[k, 0]) for edge in (self.first, self.last)])


@functools.cache
def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Gauss-Legendre places within -1 and 1, and their weights, both shape (count,)."""
    if count <= 128:
        return np.polynomial.legendre.leggauss(count)
    from scipy.special import roots_legendre  # in count^2 steps, not count^3

    nodes, weights = roots_legendre(count)
    return nodes, weights


def checked(centres: ArrayLike, radii: ArrayLike) -> tuple[Array, Array]:
    """Centres (..., K, 2) and radii (..., K) of the same leading shape, contiguous; errors as `intersect`."""
    centre, radius = np.asarray(centres, float), np.asarray(radii, float)
    if centre.ndim < 2 or centre.shape[-1] != 2:
        raise ValueError(f"centres must have shape (..., K, 2), not {centre.shape}")
    if radius.ndim < 1:
        raise ValueError("radii must have shape (..., K): one for each disc")
    try:
        shape = np.broadcast_shapes(centre.shape[:-1], radius.shape)
    except ValueError:
        raise ValueError(f"centres of shape {centre.shape} and radii of shape {radius.shape} do not fit") from None
    if shape[-1] == 0:
        raise ValueError("there must be at least one disc")
    if not all(v.min(initial=0.0) >= -LARGEST and v.max(initial=0.0) <= LARGEST for v in (centre, radius)):
        raise ValueError(f"centres and radii must be numbers up to {LARGEST:g}: leave out a stop that never clips")
    if radius.min(initial=0.0) < 0:
        raise ValueError(f"radii must not be negative, smallest given: {radius.min()}")
    return (
        np.ascontiguousarray(np.broadcast_to(centre, (*shape, 2))),
        np.ascontiguousarray(np.broadcast_to(radius, shape)),
    )


@kernel()
def _add_piece(total: Floats, area: float, x: float, y: float, xx: float, xy: float, yy: float) -> None:
    """Join a piece to `total` (area, x, y, and central moments xx, xy, yy): sums of squares only, no differences."""
    whole = total[0] + area
    if area <= 0.0 or whole <= 0.0:
        return
    share = area / whole
    dx = x - total[1]
    dy = y - total[2]
    weight = total[0] * share
    total[0] = whole
    total[1] += dx * share
    total[2] += dy * share
    total[3] += xx + weight * dx * dx
    total[4] += xy + weight * dx * dy
    total[5] += yy + weight * dy * dy


@kernel()
def _add_cap(total: Floats, r: float, sine: float, cosine: float, x: float, y: float, ux: float, uy: float) -> None:
    """Join a cap of a disc of radius r; (x, y) is the middle of its chord, (ux, uy) points from there to the rim."""
    area, rise, along, across = cap(sine, cosine)
    rr = r * r
    along *= rr * rr
    across *= rr * rr
    xx = along * ux * ux + across * uy * uy
    yy = along * uy * uy + across * ux * ux
    _add_piece(total, rr * area, x + ux * r * rise, y + uy * r * rise, xx, (along - across) * ux * uy, yy)


@kernel()
def _add_region(total: Floats, discs: Floats, arcs: Floats, count: int) -> None:
    """Join the part bounded by traced arcs: a fan of triangles and a cap on each chord, positions from disc 0."""
    x0 = 0.0
    y0 = 0.0
    for k in range(count):
        i = int(arcs[k, 2])
        cx = discs[i, 0] - discs[0, 0]
        cy = discs[i, 1] - discs[0, 1]
        r = discs[i, 2]
        middle = 0.5 * (arcs[k, 0] + arcs[k, 1])
        sine = arcs[k, 3]
        cosine = arcs[k, 4]
        ux = math.cos(middle)
        uy = math.sin(middle)
        footx = cx + r * cosine * ux
        footy = cy + r * cosine * uy
        sx = footx + r * sine * uy
        sy = footy - r * sine * ux
        ex = footx - r * sine * uy
        ey = footy + r * sine * ux
        if k == 0:
            x0 = sx
            y0 = sy
        elif count > 2:
            px = (x0 + sx + ex) / 3.0
            py = (y0 + sy + ey) / 3.0
            area = 0.5 * ((sx - x0) * (ey - y0) - (sy - y0) * (ex - x0))
            xx = (x0 - px) * (x0 - px) + (sx - px) * (sx - px) + (ex - px) * (ex - px)
            yy = (y0 - py) * (y0 - py) + (sy - py) * (sy - py) + (ey - py) * (ey - py)
            xy = (x0 - px) * (y0 - py) + (sx - px) * (sy - py) + (ex - px) * (ey - py)
            _add_piece(total, area, px, py, xx * area / 12.0, xy * area / 12.0, yy * area / 12.0)
        _add_cap(total, r, sine, cosine, footx, footy, ux, uy)


@kernel()
def _notches(base: int, discs: Floats, arcs: Floats, count: int) -> float:
    """Area of disc `base` outside the part bounded by the traced arcs, for a disc that keeps most of itself.

    In polar coordinates about its centre the loss is the integral of ``(r^2 - rho^2)/2`` over the arcs of other discs;
    ``r - rho`` is a quotient of positive terms, so a loss of any smallness is right relative to itself.
    """
    r0 = discs[base, 2]
    lost = 0.0
    for k in range(count):
        j = int(arcs[k, 2])
        if j == base:
            continue
        _, ux, uy, d, height, foot, _ = between(discs, base, j)
        edge = math.atan2(height, -foot)
        gap = discs[j, 0] - discs[base, 0]
        rise = discs[j, 1] - discs[base, 1]
        r = discs[j, 2]
        sx = gap + r * math.cos(arcs[k, 0])
        sy = rise + r * math.sin(arcs[k, 0])
        ex = gap + r * math.cos(arcs[k, 1])
        ey = rise + r * math.sin(arcs[k, 1])
        # Angles from the direction away from disc j; exact where the arc ends on the circle of `base` itself.
        start = -edge if arcs[(k - 1) % count, 2] == base else math.atan2(uy * sx - ux * sy, -(ux * sx + uy * sy))
        end = edge if arcs[(k + 1) % count, 2] == base else math.atan2(uy * ex - ux * ey, -(ux * ex + uy * ey))
        parts = math.ceil((end - start) / (0.25 * math.pi))
        width = (end - start) / parts
        for part in range(parts):
            for n in range(16):
                angle = start + (part + NODES[n]) * width
                power = 4.0 * r0 * d * math.sin(0.5 * (edge + angle)) * math.sin(0.5 * (edge - angle))
                side = d * math.sin(angle)
                depth = power / (r0 + d * math.cos(angle) + math.sqrt((r - side) * (r + side)))
                lost += WEIGHTS[n] * width * depth * (r0 - 0.5 * depth)
    return lost


@kernel()
def shape(
    discs: Floats, intervals: Floats, arcs: Floats, total: Floats, clips: NDArray[np.bool_]
) -> tuple[int, float, float]:
    """Common part of K discs into `total` (area, centroid from disc 0, central moments) and `clips` (K).

    Returns
    -------
    (status, kept, lost)
        Fractions of disc 0's area.
    """
    total[:] = 0.0
    clips[:] = False
    count, first, second = trace(discs, intervals, arcs)
    _add_region(total, discs, arcs, count)
    if total[0] <= 0.0:
        for k in range(1, len(discs)):
            clips[k] = k in (first, second) if first >= 0 else discs[k, 3] != 0.0
        return EMPTY, 0.0, 1.0
    for k in range(count):
        i = int(arcs[k, 2])
        clips[i] = i > 0
    # The disc that the loss is counted from: disc 0, or one inside it where disc 0 bounds nothing.
    base = 0
    if discs[0, 3] == 0.0:
        for j in range(len(discs)):
            if discs[j, 3] != 0.0 and between(discs, j, 0)[0] == INSIDE:
                base = j
                break
    r = discs[base, 2]
    room = math.pi * r * r
    lost = room - total[0]
    if discs[base, 3] != 0.0 and lost < room / 3.0:
        lost = _notches(base, discs, arcs, count)
    if lost < 0.5 * room:
        total[0] = room - lost
    if count == 1 and base == 0:
        return FULL, 1.0, 0.0
    r0 = discs[0, 2]
    whole = math.pi * r0 * r0
    lost_fraction = lost / whole
    if base != 0:
        lost_fraction += ((r0 - r) / r0) * ((r0 + r) / r0)
    if lost_fraction < 0.5:
        return CLIPPED, 1.0 - lost_fraction, lost_fraction
    kept = min(1.0, total[0] / whole)
    return CLIPPED, kept, 1.0 - kept


@kernel()
def shapes(centres: Floats, radii: Floats, table: Floats, status: NDArray[np.int8], clips: NDArray[np.bool_]) -> None:
    """`shape` of every set of discs, centres (n, K, 2) and radii (n, K), as `common` wants it."""
    n, k = radii.shape
    discs = np.empty((k, 4))
    intervals = np.empty((k, 2))
    arcs = np.empty((k * k, 5))
    total = np.empty(6)
    for i in range(n):
        for j in range(k):
            discs[j, 0] = centres[i, j, 0]
            discs[j, 1] = centres[i, j, 1]
            discs[j, 2] = radii[i, j]
        status[i], table[i, 1], table[i, 2] = shape(discs, intervals, arcs, total, clips[i])
        table[i, 0] = total[0]
        table[i, 3] = discs[0, 0] + total[1]
        table[i, 4] = discs[0, 1] + total[2]
        for j in range(3):
            table[i, 5 + j] = total[3 + j] / total[0] if total[0] > 0.0 else 0.0
