"""Microlens images of many builds behind a real lens, from a few rays each.

An image is the map from the disc of the FAP to the sensor, known at some points of the disc. Whole images need the
points on its rim alone: closed curves, integrated by their Fourier series. Cut ones take the map and the rims' squared
heights as polynomials of the fifth degree over the disc; the lit part is integrated in polar pieces between corners.
"""

from __future__ import annotations

import math
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ..lenses.tracer import BLOCK, COLUMNS, ROWS, pass_surfaces
from .builds import Aimed, Planes, counted, crossing
from .camera import LOST, Train
from .images import circle, polygon_moments

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

RIM = 16
"""Rays along the FAP's rim, a multiple of four; the outline's area converges exponentially in them."""
HARMONICS = 6
"""Harmonics of a ray's squared height on a surface, along the FAP's rim."""
RINGS = ((0.5, 8), (0.8, 8))
"""Radii and rays of the rings inside, where rims cut."""
DEGREE, TERMS = 5, 21
"""Degree of the polynomials over the FAP's disc and number of their terms: products x^a y^b with a + b <= 5, b running
fastest."""
POWERS = np.array([(a, b) for a in range(DEGREE + 1) for b in range(DEGREE + 1 - a)])
MISFIT = 3e-3
"""Misfit of polynomials at the rays that they are laid through, in image widths and squared heights: up to that shares
of the FAP are right to 1e-3, beyond it no polynomials are taken."""
SCAN = 32
"""Directions in which the nearest rim is asked for, before corners are looked for between them."""
HALVINGS = 12
"""To a corner: its angle is then right to 5e-5, and the area to the square of that."""
PANEL = math.pi / 4
"""Largest angle for one quadrature."""
FAP = -1
"""Stands for the FAP's own rim where rims are numbered."""
_NODES, _WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(10))


def pupil_points() -> tuple[Array, Array]:
    """FAP points along its rim, (RIM, 2), and inside it with its middle first, (..., 2), in units of its radius."""
    return circle(RIM), np.concatenate([np.zeros((1, 2)), *(radius * circle(count) for radius, count in RINGS)])


class Outlines(NamedTuple):
    """Microlens images of N build-and-field pairs as if nothing cut them, from `RIM` rays each."""

    shape: Array
    """Area, centroid, central second moments (xx, xy, yy) [mm], (N, 6)."""
    peaks: Array
    """Largest squared height of the pencil over that of each rim, (N, S + R - 1): above 1 where it is cut."""
    turns: Array
    """Where on the FAP's rim [rad], likewise."""


def outlines(rim: Aimed) -> Outlines:
    """Areas, moments and largest heights from rays along the FAP's rim."""
    area, centroid, moments = polygon_moments(rim.landed)
    peaks, turns = np.empty((len(area), rim.heights.shape[2])), np.empty((len(area), rim.heights.shape[2]))
    waves = np.exp(-2j * np.pi * np.arange(RIM) / RIM)
    highest.compiled(rim.heights, waves, np.empty(HARMONICS + 1, complex), peaks, turns)
    return Outlines(np.concatenate([area[:, None], centroid, moments], axis=1), peaks, turns)


def cut_shapes(rim: Aimed, inner: Aimed, uncut: Outlines) -> tuple[Array, Array]:
    """Lit shapes (N, 6) and seen parts of the FAP (N,) of images that rims cut, from rays all over the FAP.

    nan where the lens loses some of those rays altogether, or bends them so much that no polynomials follow.
    """
    outer_points, inner_points = pupil_points()
    places = np.concatenate([inner_points, outer_points])
    powers = np.prod(places[:, None, :] ** POWERS, axis=-1)
    fit = np.linalg.pinv(powers)
    landed = np.concatenate([inner.landed, rim.landed], axis=1)
    heights = np.concatenate([inner.heights, rim.heights], axis=1)
    shape, share = np.full((len(landed), 6), np.nan), np.full(len(landed), np.nan)
    whole = ~np.any(np.isnan(landed[:, :, 0]), axis=1)
    landed, heights, peaks = landed[whole], heights[whole], uncut.peaks[whole]
    cutting = (peaks > 1) | np.any(heights > 1, axis=1)
    landings = landed - landed[:, :1]
    wide = np.ptp(landings, axis=(1, 2))[:, None, None]
    maps, rims = (np.swapaxes(fit @ part, 1, 2).copy() for part in (landings, heights))
    off = [np.abs(powers @ np.swapaxes(c, 1, 2) - part) for c, part in ((maps, landings), (rims, heights))]
    apart = np.maximum((off[0] / wide).max(axis=(1, 2)), (off[1] / np.maximum(heights, 1)).max(axis=(1, 2)))
    size, part = np.empty((len(landed), 6)), np.empty(len(landed))
    corners = np.where(peaks > 1, uncut.turns[whole], np.nan)
    cut_images.compiled(maps, rims, cutting, corners, places, _NODES + 0.5, _WEIGHTS, size, part)
    size[:, 1:3] += np.where(part[:, None] > 0, landed[:, 0], 0.0)
    strayed = apart > MISFIT
    size[strayed], part[strayed] = np.nan, np.nan
    shape[whole], share[whole] = size, part
    return shape, share


def seen_shapes(
    train: Train, planes: Planes, base: Array, trial: Ints, rim: Aimed, inner: Aimed, about: Array, wide: Array
) -> tuple[Array, Array]:
    """Lit shapes (N, 6) and seen parts of the FAP (N,) of images of which part is out of the lens's sight.

    Parameters
    ----------
    train, planes
        T builds.
    base : ndarray, (N, 2)
        Microlenses, on the array [mm].
    trial : ndarray of int, (N,)
        Their builds.
    rim, inner
        Rays of `pupil_points`, nan where there is none: the boundary is looked for about the one with most room.
    about, wide : ndarray, (N, 2) and (N,)
        Where to look, and how far, where the lens shows none of them: sensor points [mm].

    Notes
    -----
    No ray is aimed: `BLOCK` of them leave the microlens, along spokes, to where they are lost or stopped. Corners make
    areas right to 20 over the square of `BLOCK`, in themselves.
    """
    rim_points, inner_points = pupil_points()
    on_fap = np.sum(np.concatenate([inner_points, rim_points]) ** 2, axis=1)
    landed = np.concatenate([inner.landed, rim.landed], axis=1)
    tallest = np.max(np.concatenate([inner.heights, rim.heights], axis=1), axis=2, initial=0.0)
    tallest = np.where(np.isnan(landed[:, :, 0]), np.inf, np.maximum(tallest, on_fap))
    hub = landed[np.arange(len(landed)), np.argmin(tallest, axis=1)]
    known = np.isfinite(landed)
    some = known.any(axis=(1, 2))
    reach = np.max(landed, axis=(1, 2), where=known, initial=-np.inf)
    reach = np.where(some, reach - np.min(landed, axis=(1, 2), where=known, initial=np.inf), wide)
    hub = np.where(some[:, None], hub, about)
    edge, pupil = np.empty((2, len(landed), BLOCK, 2))
    lit = np.zeros(len(landed), np.bool_)
    lens, beyond = train
    follow_spokes.compiled(
        trial, base, *counted(lens), *counted(beyond), planes.array, planes.sensor, planes.rims, hub, reach,
        circle(BLOCK), edge, pupil, lit,
    )  # fmt: skip
    shape, share = np.zeros((len(landed), 6)), np.zeros(len(landed))
    if lit.any():
        area, centroid, moments = polygon_moments(edge[lit])
        shape[lit] = np.concatenate([area[:, None], centroid, moments], axis=1)
        share[lit] = np.minimum(polygon_moments(pupil[lit])[0] / math.pi, 1.0)
    return shape, share


@kernel()
def measure_rays(
    buffer: Any, radii: Any, n: int, at: Any, sx: Any, sy: Any, lens: Any, count: int, index: Any, outer: Any,
    outer_count: int, outer_index: Any, rims: Any, tallest: Any, pupil: Any,
) -> None:  # fmt: skip
    """Largest squared heights (n,) over surfaces, stops and the FAP, and FAP points (n, 2) in its radius.

    Of rays with slopes `sx`, `sy` from a point of the array; `LOST` for those that do not come through.
    """
    for i in range(n):
        shrink = 1.0 / sqrt(1.0 + sx[i] * sx[i] + sy[i] * sy[i])
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = at[0], at[1], at[2]
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = -sx[i] * shrink, -sy[i] * shrink
        buffer[5 * BLOCK + i], buffer[6 * BLOCK + i] = -shrink, 0.0
        tallest[i] = 0.0
    pass_surfaces(buffer, n, lens, index, count, True, False, radii)
    for i in range(n):
        for k in range(count):
            tallest[i] = max(tallest[i], radii[k * BLOCK + i] / lens[k * COLUMNS + 5])
        down = buffer[5 * BLOCK + i]
        ox, oy = buffer[3 * BLOCK + i] / down, buffer[4 * BLOCK + i] / down
        for k in range(rims.shape[0]):
            hx, hy = crossing(buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], ox, oy, rims[k])
            hx, hy = hx / rims[k, 12], hy / rims[k, 12]
            if k == 0:
                pupil[i, 0], pupil[i, 1] = hx, hy
            tallest[i] = max(tallest[i], hx * hx + hy * hy)
    pass_surfaces(buffer, n if outer_count else 0, outer, outer_index, outer_count, True, False, radii)
    for i in range(n):
        for k in range(outer_count):
            tallest[i] = max(tallest[i], radii[k * BLOCK + i] / outer[k * COLUMNS + 5])
        if buffer[6 * BLOCK + i] != 0.0 or not tallest[i] < LOST:
            tallest[i] = LOST


@kernel()
def follow_spokes(
    trial: Any, base: Any, table: Any, count: int, media: Any, outer: Any, outer_count: int, outer_media: Any,
    array: Any, sensor: Any, rims: Any, hub: Any, reach: Any, ways: Any, edge: Any, pupil: Any, lit: Any,
) -> None:  # fmt: skip
    """Boundaries of N lit images along `BLOCK` spokes; arguments as of `aim`.

    Parameters
    ----------
    hub, reach : (N, 2), (N,)
        Sensor points where to begin, and how far from them the image reaches at most [mm].
    ways : (BLOCK, 2)
        Directions.
    edge, pupil : (N, BLOCK, 2)
        Get the boundary on the sensor [mm] and on the FAP, in its radius.
    lit : (N,)
        Gets whether there is any light.
    """
    buffer, radii = np.empty(ROWS * BLOCK), np.empty((count + outer_count) * BLOCK)
    sx, sy, tallest, seen = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty((BLOCK, 2))
    low, high, at = np.empty(BLOCK), np.empty(BLOCK), np.empty(3)
    for job in range(len(trial)):
        t = trial[job]
        x, y = hub[job, 0], hub[job, 1]
        plane, screen = array[t], sensor[t]
        for k in range(3):
            at[k] = plane[k] + base[job, 0] * plane[3 + k] + base[job, 1] * plane[6 + k]
        size, best = reach[job], LOST
        for search in range(18):  # to where there is most room: on a grid of 16 x 16, then on ever finer ones of 5 x 5
            side = 16 if search == 0 else 5
            step = 2.0 * size / (side - 1)
            for i in range(side * side):
                u, v = x - size + step * (i // side), y - size + step * (i % side)
                run = screen[2] + u * screen[5] + v * screen[8] - at[2]
                sx[i] = (screen[0] + u * screen[3] + v * screen[6] - at[0]) / run
                sy[i] = (screen[1] + u * screen[4] + v * screen[7] - at[1]) / run
            measure_rays(
                buffer, radii, side * side, at, sx, sy, table[t], count, media[t], outer[t], outer_count,
                outer_media[t], rims[t], tallest, seen,
            )  # fmt: skip
            u, v = x, y
            for i in range(side * side):
                if tallest[i] < best:
                    best = tallest[i]
                    x, y = u - size + step * (i // side), v - size + step * (i % side)
            size = 2.0 * step if search == 0 else 0.6 * size
        if not best < 1.0:
            continue
        lit[job] = True
        for i in range(BLOCK):
            low[i], high[i] = 0.0, 3.0 * reach[job]
        for _ in range(40):
            for i in range(BLOCK):
                far = 0.5 * (low[i] + high[i])
                u, v = x + far * ways[i, 0], y + far * ways[i, 1]
                run = screen[2] + u * screen[5] + v * screen[8] - at[2]
                sx[i] = (screen[0] + u * screen[3] + v * screen[6] - at[0]) / run
                sy[i] = (screen[1] + u * screen[4] + v * screen[7] - at[1]) / run
            measure_rays(
                buffer, radii, BLOCK, at, sx, sy, table[t], count, media[t], outer[t], outer_count, outer_media[t],
                rims[t], tallest, seen,
            )  # fmt: skip
            for i in range(BLOCK):
                far = 0.5 * (low[i] + high[i])
                if tallest[i] <= 1.0:
                    low[i] = far
                    pupil[job, i, 0], pupil[job, i, 1] = seen[i, 0], seen[i, 1]
                else:
                    high[i] = far
        for i in range(BLOCK):
            edge[job, i, 0], edge[job, i, 1] = x + low[i] * ways[i, 0], y + low[i] * ways[i, 1]


@kernel()
def peak(g: Any, waves: Any, series: Any) -> tuple[float, float]:
    """Largest value of a periodic function from its evenly spaced values, and the angle where it is taken.

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
    return max(value, g[best]), angle


@kernel()
def highest(heights: Any, waves: Any, series: Any, peaks: Any, turns: Any) -> None:
    """Largest squared heights (N, R) along the FAP's rim and the angles where they are, from (N, K, R) of K rays."""
    for n in range(len(heights)):
        for k in range(heights.shape[2]):
            peaks[n, k], turns[n, k] = peak(heights[n, :, k], waves, series)


@kernel()
def polynomial(c: Any, x: float, y: float) -> tuple[float, float, float]:
    """A polynomial of `TERMS` coefficients and its derivatives by x and y."""
    f, fx, fy = 0.0, 0.0, 0.0
    last = TERMS
    for a in range(DEGREE, -1, -1):
        last -= DEGREE + 1 - a
        q, dq = 0.0, 0.0
        for b in range(DEGREE - a, -1, -1):
            dq = dq * y + q
            q = q * y + c[last + b]
        fx = fx * x + f
        f = f * x + q
        fy = fy * x + dq
    return f, fx, fy


@kernel()
def to_circle(hx: float, hy: float, cosine: float, sine: float) -> float:
    """From an inner point along a direction to the unit circle."""
    along = hx * cosine + hy * sine
    return -along + math.sqrt(max(0.0, along * along + 1.0 - hx * hx - hy * hy))


@kernel()
def to_rim(c: Any, hx: float, hy: float, cosine: float, sine: float, far: float) -> float:
    """From an inner point along a direction to where a rim's polynomial is 1; `far` where it is nowhere up to there."""
    f, _, _ = polynomial(c, hx + far * cosine, hy + far * sine)
    if f <= 1.0:
        return far
    low, high, x = 0.0, far, 0.5 * far
    for _ in range(60):
        f, fx, fy = polynomial(c, hx + x * cosine, hy + x * sine)
        if f > 1.0:
            high = x
        else:
            low = x
        slope = fx * cosine + fy * sine
        step = x - (f - 1.0) / slope if slope > 0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - x) <= 1e-15:
            return step
        x = step
    return x


@kernel()
def nearest(rims: Any, count: int, hx: float, hy: float, angle: float) -> int:
    """Which rim is met first along a direction; `FAP` for the FAP's own."""
    cosine, sine = math.cos(angle), math.sin(angle)
    far = to_circle(hx, hy, cosine, sine)
    first = FAP
    for k in range(count):
        at = to_rim(rims[k], hx, hy, cosine, sine, far)
        if at < far:
            far, first = at, k
    return first


@kernel()
def corner(rims: Any, count: int, one: int, hx: float, hy: float, low: float, high: float) -> float:
    """Angle between two at which the boundary leaves rim `one`."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if nearest(rims, count, hx, hy, middle) == one else (low, middle)
    return high


@kernel()
def roominess(rims: Any, count: int, x: float, y: float) -> float:
    """How far inside the FAP and all rims a point lies."""
    least = 1.0 - x * x - y * y
    for k in range(count):
        f, _, _ = polynomial(rims[k], x, y)
        least = min(least, 1.0 - f)
    return least


@kernel()
def add_piece(
    rims: Any, active: int, image: Any, hx: float, hy: float, low: float, high: float, nodes: Any, weights: Any,
    sums: Any,
) -> None:  # fmt: skip
    """Green's integrals along one piece of the boundary, about the image of the hub; then the area on the disc."""
    x0, _, _ = polynomial(image[0], hx, hy)
    y0, _, _ = polynomial(image[1], hx, hy)
    panels = max(1, math.ceil((high - low) / PANEL))
    width = (high - low) / panels
    for panel in range(panels):
        for q in range(len(nodes)):
            angle = low + width * (panel + nodes[q])
            cosine, sine = math.cos(angle), math.sin(angle)
            at = to_circle(hx, hy, cosine, sine)
            if active != FAP:
                at = to_rim(rims[active], hx, hy, cosine, sine, 1.01 * at)
            tx, ty = hx + at * cosine, hy + at * sine
            nx, ny = tx, ty
            if active != FAP:
                _, nx, ny = polynomial(rims[active], tx, ty)
            out, across = nx * cosine + ny * sine, ny * cosine - nx * sine
            grow = -at * across / out  # of the distance, along the boundary
            ux, uy = grow * cosine - at * sine, grow * sine + at * cosine
            x, fx, fy = polynomial(image[0], tx, ty)
            y, gx, gy = polynomial(image[1], tx, ty)
            weight = weights[q] * width
            dx, dy = weight * (fx * ux + fy * uy), weight * (gx * ux + gy * uy)
            x, y = x - x0, y - y0
            sums[0] += 0.5 * (x * dy - y * dx)
            sums[1] += 0.5 * x * x * dy
            sums[2] -= 0.5 * y * y * dx
            sums[3] += x * x * x * dy / 3.0
            sums[4] += 0.5 * x * x * y * dy
            sums[5] -= y * y * y * dx / 3.0
            sums[6] += 0.5 * at * at * weight


@kernel()
def cut_images(
    maps: Any, rims: Any, cutting: Any, turns: Any, places: Any, nodes: Any, weights: Any, shape: Any, share: Any
) -> None:
    """Lit shapes of N images that rims cut.

    Parameters
    ----------
    maps, rims : (N, 2, TERMS), (N, R, TERMS)
        Polynomials over the unit disc of the FAP: sensor points from that of its middle, and squared heights.
    cutting, turns : (N, R)
        Which rims cut, and where on the FAP's rim they cut most; nan where they spare it.
    places : (P, 2)
        Points of the disc, one of which lies near enough to the roomiest.
    nodes, weights
        Of a quadrature over [0, 1].
    shape : (N, 6)
        Gets area, centroid and central second moments; zeros where dark.
    share : (N,)
        Gets the part of the FAP that is seen.
    """
    most = rims.shape[1]
    cuts = np.empty((most, TERMS))
    angles, active = np.empty(SCAN + most), np.empty(SCAN + most, np.int64)
    ends, along = np.empty(SCAN + most), np.empty(SCAN + most, np.int64)
    sums = np.empty(7)
    for n in range(len(maps)):
        image, count, marks = maps[n], 0, SCAN
        for k in range(most):
            if cutting[n, k]:
                cuts[count] = rims[n, k]
                count += 1
        hx, hy, best = 0.0, 0.0, -1e300
        for p in range(len(places)):
            room = roominess(cuts, count, places[p, 0], places[p, 1])
            if room > best:
                hx, hy, best = places[p, 0], places[p, 1], room
        reach = 0.25
        for _ in range(24 if best < 0.2 else 0):
            ux, uy = hx, hy
            for i in range(-2, 3):
                for j in range(-2, 3):
                    x, y = ux + i * reach, uy + j * reach
                    room = roominess(cuts, count, x, y)
                    if room > best:
                        hx, hy, best = x, y, room
            reach *= 0.6
        shape[n], share[n] = 0.0, 0.0
        if best <= 0.0:
            continue
        for i in range(SCAN):
            angles[i] = 2.0 * math.pi * i / SCAN
        for k in range(most):
            if turns[n, k] == turns[n, k]:  # a sliver between two directions of the scan must not be missed
                angle = math.atan2(math.sin(turns[n, k]) - hy, math.cos(turns[n, k]) - hx)
                angles[marks] = angle if angle >= 0 else angle + 2.0 * math.pi
                marks += 1
        order = np.argsort(angles[:marks])
        for i in range(marks):
            active[i] = nearest(cuts, count, hx, hy, angles[order[i]])
        corners = 0
        for i in range(marks):
            after = i + 1 if i + 1 < marks else 0
            one, low = active[i], angles[order[i]]
            high = angles[order[after]] + (0.0 if after else 2.0 * math.pi)
            while one != active[after] and corners < len(ends):
                low = corner(cuts, count, one, hx, hy, low, high)
                one = nearest(cuts, count, hx, hy, low)
                ends[corners], along[corners] = low, one
                corners += 1
        sums[:] = 0.0
        if corners == 0:
            add_piece(cuts, active[0], image, hx, hy, 0.0, 2.0 * math.pi, nodes, weights, sums)
        for i in range(corners):
            high = ends[i + 1] if i + 1 < corners else ends[0] + 2.0 * math.pi
            add_piece(cuts, along[i], image, hx, hy, ends[i], high, nodes, weights, sums)
        area = sums[0]
        mx, my = sums[1] / area, sums[2] / area
        x0, _, _ = polynomial(image[0], hx, hy)
        y0, _, _ = polynomial(image[1], hx, hy)
        shape[n, 0], shape[n, 1], shape[n, 2] = abs(area), x0 + mx, y0 + my
        shape[n, 3], shape[n, 4] = sums[3] / area - mx * mx, sums[4] / area - mx * my
        shape[n, 5] = sums[5] / area - my * my
        share[n] = min(1.0, sums[6] / math.pi)
