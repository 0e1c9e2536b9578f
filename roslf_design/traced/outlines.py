"""Microlens images of builds behind a real lens, from a few rays each.

Whole images need rays along the FAP's rim alone: closed curves, integrated by their Fourier series, or sides by
Legendre's. Where a rim cuts an image, or part of the FAP is out of sight, its boundary on the sensor is followed along
spokes from its roomiest point, each to where the first rim stops the ray. Between corners, where another rim or side
takes over, the boundary is smooth and Gauss's rule integrates it.
"""

from __future__ import annotations

import math
from functools import cache
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from ..lenses.tracer import BLOCK, COLUMNS, ROWS, pass_surfaces
from ..shapes.pieces import ordered
from .train import LOST, AimedRays, Planes, Train, crossing, kernel_args, side_height

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

RIM = {False: 16, True: 32}
"""Rays along the FAP's rim, without and with straight sides; the outline's area converges exponentially in them."""
HARMONICS = 6
"""Harmonics of a ray's squared height on a surface, along the FAP's rim."""
SCAN = 24
"""Spokes along which the boundary is followed before corners are looked for between them."""
NEARLY = 0.97
"""Squared height of a rim's near miss between two spokes, from which another spoke goes there."""
ON_EDGE, BY_CORNERS, ABOUT = 1e-7, 1e-4, 1e-3
"""How near the boundary a spoke's last ray must come, in its squared height over that of the rim that stops it: for
integrals, for which rim it is beside corners, and for where it is, about."""
FINE = 1e-16
"""How near it must be known where rays are lost at it, of the largest distance: the FAP's points run away there."""
HALVINGS = 9
"""To a corner: its angle is then right to 5e-4, and the area to the square of that."""
STEPS = 120
"""Along a spoke at most."""
PANEL = math.pi / 2
"""Largest angle for one quadrature."""
SMOOTH = 1e-4
"""Largest share of its highest term; what is left out is the square of that, and a panel is halved that has more."""
NODES = 10
"""Nodes of a quadrature."""
DENSE = 33
"""Places along a straight side at which the pencil's heights are looked at."""
LOOKS, PEAK = 12, 2.5e-4
"""Rays along a spoke, and seconds for the peak of a pencil's heights, interpreted: about."""
GRID, ROOMY, FINEST = 7, 0.6, 17
"""Side of the grid on which the roomiest point is looked for, which squared height is low enough, and how many grids
there may be for slivers."""


def circle(count: int, first: float = 0.0) -> Array:
    """Points evenly spaced on the unit circle from the angle `first` on, (count, 2)."""
    turns = first + 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(turns), np.sin(turns)], axis=-1)


def rim_points(count: int, *, straight: bool) -> Array:
    """Points along the FAP's rim, counterclockwise, by their shares of its opening, (count, 2).

    Evenly spaced on a disc's; of straight sides Lobatto's nodes on each in turn, both ends included, a quarter of them.
    """
    if not straight:
        return circle(count)
    along = _lobatto(count // 4)[0]
    one = np.ones_like(along)
    sides = (one, along), (-along, one), (-one, -along), (along, -one)
    return np.concatenate([np.stack(side, axis=-1) for side in sides])


@cache
def _lobatto(count: int) -> tuple[Array, Array, Array, Array]:
    """Lobatto's nodes on [-1, 1], both ends among them, and their weights; then what takes values there elsewhere.

    To derivatives at the nodes, (n, n), and to values at `DENSE` places evenly spaced, (DENSE, n).
    """
    legendre = np.polynomial.legendre.Legendre.basis
    last = legendre(count - 1)
    nodes = np.concatenate([[-1.0], np.sort(last.deriv().roots().real), [1.0]])
    weights = 2 / (count * (count - 1) * last(nodes) ** 2)
    fit = np.linalg.inv(np.polynomial.legendre.legvander(nodes, count - 1))
    slopes = np.stack([legendre(k).deriv()(nodes) for k in range(count)], axis=-1) @ fit
    return nodes, weights, slopes, np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, DENSE), count - 1) @ fit


def _along_sides(values: Array) -> Array:
    """Largest values of functions along four sides (N, R), from those at `rim_points`, (N, 4 n, R)."""
    largest = np.empty((len(values), values.shape[2]))
    _largest.quickest(PEAK * largest.size)(np.ascontiguousarray(values), _lobatto(values.shape[1] // 4)[3], largest)
    return largest


def _moments(curve: Array, straight: bool) -> tuple[Array, Array, Array]:
    """Area, centroid and central second moments (xx, xy, yy) per unit area inside closed curves.

    Parameters
    ----------
    curve : ndarray, (..., K, 2)
        Points [mm], either way round: evenly spaced in some smooth parameter, or of four smooth sides, one after the
        other, as `rim_points` has them.

    Notes
    -----
    Green's theorem with the curve's derivative from its Fourier series, or from Legendre's: the error falls
    exponentially with K.
    """
    start = np.mean(curve, axis=-2, keepdims=True)
    x, y = np.moveaxis(curve - start, -1, 0)
    k = x.shape[-1]
    if straight:
        _, weight, slopes, _ = _lobatto(k // 4)
        sides = (part.reshape(*part.shape[:-1], 4, -1) @ slopes.T for part in (x, y))
        dx, dy = (np.tile(weight, 4) * part.reshape(x.shape) for part in sides)
    else:
        waves = 1j * np.fft.fftfreq(k, 1 / k) * (np.arange(k) * 2 != k)
        dx, dy = (np.fft.ifft(waves * np.fft.fft(part, axis=-1), axis=-1).real * 2 * np.pi / k for part in (x, y))
    area = np.sum(x * dy - y * dx, axis=-1) / 2
    turn = np.where(area < 0, -1.0, 1.0)
    safe = np.where(area == 0, 1.0, area)
    mx, my = np.sum(x * x * dy, axis=-1) / 2 / safe, -np.sum(y * y * dx, axis=-1) / 2 / safe
    xx, yy = np.sum(x**3 * dy, axis=-1) / 3 / safe, -np.sum(y**3 * dx, axis=-1) / 3 / safe
    xy = np.sum(x * x * y * dy, axis=-1) / 2 / safe
    moments = np.stack([xx - mx * mx, xy - mx * my, yy - my * my], axis=-1)
    return np.asarray(area * turn), start[..., 0, :] + np.stack([mx, my], axis=-1), moments


class Outlines(NamedTuple):
    """Microlens images of N build-and-field pairs as if nothing cut them, from rays along the FAP's rim."""

    rim: Array
    """Images of `rim_points`, nan where they are not in sight [mm], (N, P, 2)."""
    width: Array
    """Diameter of the disc as large; of straight sides the wider of the extents along x and y [mm], (N,)."""
    shape: Array
    """Area, centroid, central second moments (xx, xy, yy) [mm], (N, 6)."""
    peaks: Array
    """Largest height of the pencil over that of each rim, as `AimedRays` has them, (N, S + L): above 1 where it is
    cut."""

    @classmethod
    def of(cls, rim: AimedRays, *, straight: bool) -> Outlines:
        """Areas, moments and largest heights from rays to `rim_points`."""
        area, centroid, moments = _moments(rim.landed, straight)
        if straight:
            width = np.sum([_along_sides(sign * rim.landed) for sign in (-1, 1)], axis=0).max(axis=-1)
        else:
            width = 2 * np.sqrt(area / np.pi)
        shape = np.concatenate([area[:, None], centroid, moments], axis=1)
        return cls(rim.landed, width, shape, highest(rim.heights, straight=straight))


def highest(heights: Array, *, straight: bool) -> Array:
    """Largest heights (N, R) along the FAP's rim from those of rays to `rim_points` (N, K, R)."""
    if straight:
        return _along_sides(heights)
    peaks, points = np.empty((len(heights), heights.shape[2])), heights.shape[1]
    waves = np.exp(-2j * np.pi * np.arange(points) / points)
    _highest.quickest(PEAK * peaks.size)(heights, waves, np.empty(HARMONICS + 1, complex), peaks)
    return peaks


def lit_images(
    train: Train,
    planes: Planes,
    base: Array,
    trial: Ints,
    uncut: Outlines,
    elsewhere: tuple[Array, Array],
    *,
    spokes: int = SCAN,
    odd: NDArray[np.bool_] | None = None,
) -> tuple[Array, Array, Ints, Array]:
    """Images of N builds and fields, whole or cut.

    Parameters
    ----------
    uncut : Outlines
        Images as if nothing cut them.
    odd : ndarray of bool, (N,), optional
        Images that are followed in any case.
    train, planes, base, trial, elsewhere, spokes
        As of `_lit_parts`.

    Returns
    -------
    (shape, share, followed, edge)
        As `_lit_parts` has them, but for boundaries, which are known of those M images alone that were `followed`, as
        something cuts them: (M,), (M, spokes, 2) [mm].
    """
    cut = np.any(~(uncut.peaks <= 1), axis=1) | np.isnan(uncut.shape[:, 0])
    some = np.flatnonzero(cut if odd is None else cut | odd)
    shape, share, edge = uncut.shape.copy(), np.ones(len(base)), np.empty((0, spokes, 2))
    if len(some):
        places, wide = (part[some] for part in elsewhere)
        parts = _lit_parts(train, planes, base[some], trial[some], uncut.rim[some], (places, wide), spokes)
        shape[some], share[some], edge = parts
    return shape, share, some, edge


def _lit_parts(
    train: Train,
    planes: Planes,
    base: Array,
    trial: Ints,
    rim: Array,
    elsewhere: tuple[Array, ArrayLike],
    spokes: int = SCAN,
) -> tuple[Array, Array, Array]:
    """Lit parts of images, whatever cuts them: right to some 1e-8 of the whole.

    Parameters
    ----------
    train, planes
        T builds.
    base : ndarray, (N, 2)
        Microlenses, on the array [mm].
    trial : ndarray of int, (N,)
        Their builds.
    rim : ndarray, (N, P, 2)
        Images of the FAP's rim, about which to look; nan where they are not in sight [mm].
    elsewhere : tuple
        Where to look instead, (N, 2), and how far to either side, where none of it is in sight [mm].
    spokes : int
        Of the boundary, at most `BLOCK`.

    Returns
    -------
    (shape, share, edge)
        Area, centroid, central second moments (xx, xy, yy) [mm], (N, 6), zeros where dark; the part of the FAP, by its
        own area, from which light comes, (N,); and the boundary along spokes from its roomiest point, evenly spaced but
        for those beside corners, which go there, (N, spokes, 2) [mm], that point where dark.
    """
    if spokes > BLOCK:
        raise ValueError(f"{spokes} spokes are more than {BLOCK}")
    known = np.isfinite(rim)
    low = np.min(rim, axis=1, where=known, initial=np.inf)
    high = np.max(rim, axis=1, where=known, initial=-np.inf)
    none, (about, wide) = ~np.any(known, axis=(1, 2)), elsewhere
    aside = np.broadcast_to(wide, len(base))[:, None]
    low[none], high[none] = ((about + side * aside)[none] for side in (-1, 1))
    lens, beyond = train
    shape, share, edge = np.zeros((len(base), 6)), np.zeros(len(base)), np.empty((len(base), spokes, 2))
    about, reach = (np.ascontiguousarray(part) for part in ((low + high) / 2, np.max(high - low, axis=1)))
    _follow_images.quickest((lens.seconds + beyond.seconds) * LOOKS * spokes * len(base))(
        trial, *kernel_args(lens), *kernel_args(beyond), planes.array, planes.sensor, planes.rims,
        np.ascontiguousarray(base), about, reach, *_rule(), shape, share, edge,
    )  # fmt: skip
    return shape, share, edge


@cache
def _rule() -> tuple[Array, Array, Array, Array]:
    """Gauss's rule on [-1, 1]: n nodes, weights, and what takes values there to derivatives, (n, n), and to both ends.

    The last is (3, n); its third row is for the highest term.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    terms = np.polynomial.legendre.Legendre.basis
    fit = np.array([(k + 0.5) * weights * terms(k)(nodes) for k in range(NODES)])
    slopes = np.stack([terms(k).deriv()(nodes) for k in range(NODES)], axis=1) @ fit
    ends = np.polynomial.legendre.legvander(np.array([-1.0, 1.0]), NODES - 1) @ fit
    return nodes, weights, slopes, np.concatenate([ends, fit[-1:]])


@kernel()
def _measure_rays(n: int, build: Any, work: Any) -> None:
    """How near n rays from a point of the array, away from points of the sensor, come to the rims.

    Heights are those of `AimedRays`, the FAP's before the other stops'.

    Parameters
    ----------
    build : tuple
        That point (3,); the lens, how many surfaces, their media; the same of what stands before the FAP; rims; sensor.
    work : tuple
        Room for rays; the sensor's points (n,), (n,), in its own coordinates; and what gets the largest squared height
        over that of a rim (n,), `LOST` for rays that do not come through; of which (n,), for those the number of rims;
        all such heights (rims, n), of surfaces, stops, and what stands before the FAP; the FAP's points (n, 2).
    """
    at, lens, count, index, outer, outer_count, outer_index, rims, screen = build
    buffer, radii, u, v, tallest, first, heights, pupil = work
    stops, beyond = rims.shape[0], len(heights) - outer_count
    for i in range(n):
        x = screen[0] + u[i] * screen[3] + v[i] * screen[6] - at[0]
        y = screen[1] + u[i] * screen[4] + v[i] * screen[7] - at[1]
        z = screen[2] + u[i] * screen[5] + v[i] * screen[8] - at[2]
        shrink = 1.0 / sqrt(x * x + y * y + z * z)
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = at[0], at[1], at[2]
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = -x * shrink, -y * shrink
        buffer[5 * BLOCK + i], buffer[6 * BLOCK + i] = -z * shrink, 0.0
    pass_surfaces(buffer, n, lens, index, count, True, False, radii)
    for i in range(n):
        for k in range(count):
            heights[k, i] = radii[k * BLOCK + i] / lens[k * COLUMNS + 5]
        down = buffer[5 * BLOCK + i]
        ox, oy = buffer[3 * BLOCK + i] / down, buffer[4 * BLOCK + i] / down
        side = count
        for k in range(stops):
            rim = rims[k]
            hx, hy = crossing(buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], ox, oy, rim)
            if k == 0:
                pupil[i, 0], pupil[i, 1] = hx / rim[12], hy / rim[13]
            for s in range(int(rim[14])):
                heights[side, i] = side_height(hx, hy, rim, s)
                side += 1
    pass_surfaces(buffer, n if outer_count else 0, outer, outer_index, outer_count, True, False, radii)
    for i in range(n):
        for k in range(outer_count):
            heights[beyond + k, i] = radii[k * BLOCK + i] / outer[k * COLUMNS + 5]
        tallest[i], first[i] = 0.0, 0
        for k in range(len(heights)):
            if heights[k, i] > tallest[i]:
                tallest[i], first[i] = heights[k, i], k
        if buffer[6 * BLOCK + i] != 0.0 or not tallest[i] < LOST:
            tallest[i], first[i] = LOST, len(heights)


@kernel()
def _roomiest(hub: Any, size: float, build: Any, work: Any) -> float:
    """Largest squared height there, after moving a sensor point `hub` to where that is least, from so far away."""
    u, v, tallest = work[2], work[3], work[4]
    best = LOST
    for search in range(FINEST):
        side = GRID if search == 0 else 5
        step = 2.0 * size / (side - 1)
        for i in range(side * side):
            u[i], v[i] = hub[0] - size + step * (i // side), hub[1] - size + step * (i % side)
        _measure_rays(side * side, build, work)
        for i in range(side * side):
            if tallest[i] < best:
                best, hub[0], hub[1] = tallest[i], u[i], v[i]
        size = 2.0 * step if search == 0 else 0.6 * size
        if best < ROOMY or (best < 0.9 and search >= 2):
            break
    return best


@kernel()
def _follow_spokes(
    n: int, hub: Any, most: float, enough: float, angle: Any, far: Any, spokes: Any, build: Any, work: Any
) -> None:
    """How far from a hub the boundary is along n spokes; `far` (n,) holds a first guess, and gets it.

    Every rim's squared height goes on as between the last two rays, the first of them the hub's, to where it would stop
    the ray; the nearest such place is tried next, or the middle of where the boundary may be, up to `most`. Once the
    squared height is within `enough` of the rim's, that place is taken. What the last rays met is left in `work`.
    """
    low, high, last, done, before = spokes
    u, v, tallest, first, heights = work[2], work[3], work[4], work[5], work[6]
    limits = len(heights)
    for i in range(n):
        low[i], high[i], last[i], done[i] = 0.0, most, 0.0, 0.0
        for k in range(limits):
            before[k, i] = hub[2 + k]
    for step in range(STEPS):
        for i in range(n):
            u[i], v[i] = hub[0] + far[i] * math.cos(angle[i]), hub[1] + far[i] * math.sin(angle[i])
        _measure_rays(n, build, work)
        moving = False
        for i in range(n):
            if tallest[i] <= 1.0:
                low[i] = far[i]
            else:
                high[i] = far[i]
            if done[i] != 0.0 or high[i] - low[i] <= FINE * most:
                continue
            half = 0.5 * (low[i] + high[i])
            if tallest[i] == LOST:
                far[i], moving = half, True
                continue
            to, run = high[i], far[i] - last[i]
            for k in range(limits):
                rise = heights[k, i] - before[k, i]
                if heights[k, i] > 0.25 and rise * run > 0.0:
                    to = min(to, far[i] + (1.0 - heights[k, i]) * run / rise)
                before[k, i] = heights[k, i]
            last[i] = far[i]
            if abs(tallest[i] - 1.0) <= enough:
                far[i], done[i] = to, 1.0
            else:
                far[i], moving = to if low[i] < to < high[i] and step % 8 != 7 else half, True
        if not moving:
            break
    lost = False
    for i in range(n):
        last[i] = tallest[i]
        lost = lost or tallest[i] == LOST
    if lost:  # there the boundary is where rays come to nothing, and this just inside
        for i in range(n):
            far[i] = low[i] if last[i] == LOST else far[i]
            u[i], v[i] = hub[0] + far[i] * math.cos(angle[i]), hub[1] + far[i] * math.sin(angle[i])
        _measure_rays(n, build, work)
        for i in range(n):
            first[i] = len(heights) if last[i] == LOST else first[i]


@kernel()
def _along_edge(edges: Any, scan: int, angle: float) -> Any:
    """How far the boundary is at an angle, about: by cubics between `scan` spokes, evenly spaced."""
    at = angle * scan / (2.0 * math.pi)
    k = math.floor(at)
    a, b, c, d = edges[(k - 1) % scan], edges[k % scan], edges[(k + 1) % scan], edges[(k + 2) % scan]
    t = at - k
    return b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))


@kernel()
def _is_smooth(far: Any, pupil: Any, finest: Any) -> bool:
    """Whether the boundary, and the FAP's points at it, hardly need the highest term that the rule's nodes can tell."""
    r, x, y, size = 0.0, 0.0, 0.0, 0.0
    for i in range(len(finest)):
        r, x, y = r + finest[i] * far[i], x + finest[i] * pupil[i, 0], y + finest[i] * pupil[i, 1]
        size = max(size, far[i])
    return abs(r) <= SMOOTH * size and abs(x) <= SMOOTH and abs(y) <= SMOOTH


@kernel()
def _add_panel(begin: float, width: float, far: Any, rule: Any, pupil: Any, sums: Any) -> None:
    """Integrals of a part of the image, about the hub, and of the part of the FAP that shows there, about its middle.

    From how far the boundary is at the rule's nodes, and where it is on the FAP. There parts join by straight lines:
    corners are found to some rounding, which areas then know by its square.
    """
    nodes, weights, slopes, ends = rule
    x0, y0, x1, y1 = 0.0, 0.0, 0.0, 0.0
    for i in range(len(nodes)):
        angle, r = begin + width * (nodes[i] + 1.0) / 2.0, far[i]
        x, y, part = r * math.cos(angle), r * math.sin(angle), weights[i] * width / 2.0 * r * r
        sums[0] += part / 2.0
        sums[1] += part * x / 3.0
        sums[2] += part * y / 3.0
        sums[3] += part * x * x / 4.0
        sums[4] += part * x * y / 4.0
        sums[5] += part * y * y / 4.0
        u, v, du, dv = pupil[i, 0], pupil[i, 1], 0.0, 0.0
        for j in range(len(nodes)):
            du, dv = du + slopes[i, j] * pupil[j, 0], dv + slopes[i, j] * pupil[j, 1]
        sums[6] += weights[i] * (u * dv - v * du) / 2.0
        x0, y0 = x0 + ends[0, i] * u, y0 + ends[0, i] * v
        x1, y1 = x1 + ends[1, i] * u, y1 + ends[1, i] * v
    if sums[7] == 0.0:
        sums[8], sums[9] = x0, y0
    else:
        sums[6] += (sums[10] * y0 - sums[11] * x0) / 2.0
    sums[7], sums[10], sums[11] = 1.0, x1, y1


@kernel()
def _corners(
    scan: int, hub: Any, most: float, edges: Any, marks: Any, trial: Any, spokes: Any, build: Any, work: Any
) -> int:
    """How many corners the boundary has; in `marks` at which angles, in order, and how far; else 0 and the angle 0.

    From `scan` spokes just followed, at distances `edges`; `marks` and `trial` are tuples of room to work in.
    """
    ends, reached, angles, stoppers, order = marks
    angle, far = trial
    first, heights = work[5], work[6]
    limits = len(heights)
    for i in range(scan):
        angles[i], stoppers[i] = angle[i], first[i]
    known, extra = scan, 0
    for k in range(limits):  # a rim that cuts only between two spokes must not be missed
        for i in range(scan):
            before, after = (i - 1) % scan, (i + 1) % scan
            h, hp, hn = heights[k, i], heights[k, before], heights[k, after]
            near = stoppers[i] != k and stoppers[before] != k and stoppers[after] != k and extra < BLOCK
            bend = hp - 2.0 * h + hn
            if near and bend < 0.0 and h > hp and h >= hn and h - (hn - hp) ** 2 / (8.0 * bend) > NEARLY:
                angle[extra] = (angles[i] + math.pi * (hp - hn) / (scan * bend)) % (2.0 * math.pi)
                far[extra] = edges[i]
                extra += 1
    if extra > 0:
        _follow_spokes(extra, hub, most, BY_CORNERS, angle, far, spokes, build, work)
        for i in range(extra):
            angles[known], stoppers[known] = angle[i], first[i]
            known += 1
    ordered(angles, known, order)
    corners = 0
    for i in range(known):
        one, other = order[i], order[(i + 1) % known]
        low, stopper = angles[one], stoppers[one]
        while stopper != stoppers[other] and corners < len(ends):
            high, past = angles[other] + (0.0 if i + 1 < known else 2.0 * math.pi), stoppers[other]
            for _ in range(HALVINGS):
                angle[0] = 0.5 * (low + high)
                far[0] = _along_edge(edges, scan, angle[0])
                _follow_spokes(1, hub, most, BY_CORNERS, angle, far, spokes, build, work)
                if first[0] == stopper:
                    low = angle[0]
                else:
                    high, past = angle[0], first[0]
            ends[corners], reached[corners], low, stopper = high, far[0], high, past
            corners += 1
    ends[0] = ends[0] if corners > 0 else 0.0
    return corners


@kernel()
def _integrate(
    corners: int, scan: int, hub: Any, most: float, edges: Any, ends: Any, rule: Any, trial: Any, spokes: Any,
    build: Any, work: Any, sums: Any,
) -> None:  # fmt: skip
    """Integrals of a lit part between its corners, as `_add_panel` gathers them."""
    nodes, joints = rule[0], rule[3]
    angle, far = trial
    pupil = work[7]
    sums[:] = 0.0
    for corner in range(max(1, corners)):
        begin = ends[corner]
        end = ends[corner + 1] if corner + 1 < corners else ends[0] + 2.0 * math.pi
        whole = (end - begin) / max(1, math.ceil((end - begin) / PANEL - 1e-9))
        width = whole
        while end - begin > 1e-12:
            for i in range(len(nodes)):
                angle[i] = begin + width * (nodes[i] + 1.0) / 2.0
                far[i] = _along_edge(edges, scan, angle[i])
            _follow_spokes(len(nodes), hub, most, ON_EDGE, angle, far, spokes, build, work)
            if width > whole / 100.0 and not _is_smooth(far, pupil, joints[2]):
                width *= 0.5
                continue
            _add_panel(begin, width, far, rule, pupil, sums)
            begin += width
            width = min(whole, 2.0 * width, end - begin)
    sums[6] += (sums[10] * sums[9] - sums[11] * sums[8]) / 2.0


@kernel()
def _follow_images(
    trial: Any, table: Any, count: int, media: Any, outer: Any, outer_count: int, outer_media: Any, array: Any,
    sensor: Any, rims: Any, base: Any, about: Any, reach: Any, nodes: Any, weights: Any, slopes: Any, joints: Any,
    shape: Any, share: Any, edge: Any,
) -> None:  # fmt: skip
    """Lit parts of N images; arguments as of `train.aim` and `_lit_parts`.

    Parameters
    ----------
    about, reach : (N, 2), (N,)
        Sensor points where to begin, and how far across the image is at most [mm].
    nodes, weights, slopes, joints
        As `_rule` has them.
    """
    limits = count + int(np.sum(rims[0, :, 14])) + outer_count
    scan, rule = edge.shape[1], (nodes, weights, slopes, joints)
    whole = math.pi if rims[0, 0, 14] == 1.0 else 4.0
    heights, pupil = np.empty((limits, BLOCK)), np.empty((BLOCK, 2))
    u, v, tallest, first = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK, np.int64)
    work = np.empty(ROWS * BLOCK), np.empty((count + outer_count) * BLOCK), u, v, tallest, first, heights, pupil
    spokes = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty((limits, BLOCK))
    angle, far, edges = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    ends, reached, trial_spokes = np.empty(2 * BLOCK), np.empty(2 * BLOCK), (angle, far)
    marks = ends, reached, np.empty(2 * BLOCK), np.empty(2 * BLOCK, np.int64), np.empty(2 * BLOCK, np.int64)
    at, hub, sums = np.empty(3), np.empty(2 + limits), np.empty(12)
    for job in range(len(trial)):
        t = trial[job]
        for k in range(3):
            at[k] = array[t, k] + base[job, 0] * array[t, 3 + k] + base[job, 1] * array[t, 6 + k]
        build = at, table[t], count, media[t], outer[t], outer_count, outer_media[t], rims[t], sensor[t]
        hub[0], hub[1], most = about[job, 0], about[job, 1], 3.0 * reach[job]
        best = _roomiest(hub, 0.55 * reach[job], build, work)
        for i in range(scan):
            angle[i], far[i] = 2.0 * math.pi * i / scan, 0.5 * reach[job]
            edge[job, i, 0], edge[job, i, 1] = hub[0], hub[1]
        if not best < 1.0:
            continue
        u[0], v[0] = hub[0], hub[1]
        _measure_rays(1, build, work)
        for k in range(limits):
            hub[2 + k] = heights[k, 0]
        _follow_spokes(scan, hub, most, ABOUT, angle, far, spokes, build, work)
        for i in range(scan):
            edge[job, i, 0] += far[i] * math.cos(angle[i])
            edge[job, i, 1] += far[i] * math.sin(angle[i])
            edges[i] = far[i]
        corners = _corners(scan, hub, most, edges, marks, trial_spokes, spokes, build, work)
        for corner in range(corners):  # the spoke beside it goes there instead
            k = round(ends[corner] * scan / (2.0 * math.pi)) % scan
            edge[job, k, 0] = hub[0] + reached[corner] * math.cos(ends[corner])
            edge[job, k, 1] = hub[1] + reached[corner] * math.sin(ends[corner])
        _integrate(corners, scan, hub, most, edges, ends, rule, trial_spokes, spokes, build, work, sums)
        area = sums[0]
        mx, my = sums[1] / area, sums[2] / area
        shape[job, 0], shape[job, 1], shape[job, 2] = area, hub[0] + mx, hub[1] + my
        shape[job, 3], shape[job, 4] = sums[3] / area - mx * mx, sums[4] / area - mx * my
        shape[job, 5] = sums[5] / area - my * my
        share[job] = min(1.0, abs(sums[6]) / whole)


@kernel()
def _peak(g: Any, waves: Any, series: Any) -> float:
    """Largest value of a periodic function from its evenly spaced values.

    `waves` holds the unit circle's points, clockwise; `series` is room for the Fourier coefficients.
    """
    n = len(g)
    best = 0
    for i in range(1, n):
        if g[i] > g[best]:
            best = i
    for h in range(len(series)):
        total = 0j
        for i in range(n):
            total += g[i] * waves[(h * i) % n]
        series[h] = total / n if h == 0 else 2.0 * total / n
    start, limit = 2.0 * math.pi * best / n, math.pi / n
    angle, value = start, g[best]
    for _ in range(6):
        slope, curve, value = 0.0, 0.0, series[0].real
        turn, power = complex(math.cos(angle), math.sin(angle)), 1.0 + 0.0j
        for h in range(1, len(series)):
            power *= turn
            here = series[h] * power
            value += here.real
            slope -= h * here.imag
            curve -= h * h * here.real
        if not curve < 0 or abs(slope) <= 1e-7 * -curve:  # the value is then right to rounding
            break
        angle = min(max(angle - slope / curve, start - limit), start + limit)
    return float(max(value, g[best]))


@kernel()
def _largest(values: Any, dense: Any, largest: Any) -> None:
    """Largest values (N, R) along four sides, from (N, 4 n, R), by parabolas between dense places: exact at corners.

    `dense` takes values at a side's n places to those at dense ones.
    """
    places, nodes = dense.shape
    for i in range(len(values)):
        for k in range(values.shape[2]):
            best = -LOST
            for side in range(4):
                before, here = 0.0, 0.0
                for d in range(places):
                    after = 0.0
                    for j in range(nodes):
                        after += dense[d, j] * values[i, side * nodes + j, k]
                    best = max(best, after)
                    bend = before - 2.0 * here + after
                    if d > 1 and here >= before and here >= after and bend < 0.0:
                        best = max(best, here - (after - before) ** 2 / (8.0 * bend))
                    if math.isnan(after):  # a ray that is lost
                        best = after
                        break
                    before, here = here, after
                if math.isnan(best):
                    break
            largest[i, k] = best


@kernel()
def _highest(heights: Any, waves: Any, series: Any, peaks: Any) -> None:
    """Largest squared heights (N, R) along the FAP's rim, from (N, K, R) of K rays."""
    for n in range(len(heights)):
        for k in range(heights.shape[2]):
            peaks[n, k] = _peak(heights[n, :, k], waves, series)
