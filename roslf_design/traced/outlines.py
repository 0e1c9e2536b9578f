"""Microlens images of many builds from a few aimed rays each: areas, moments, room and what rims cut off.

An image is the map from the disc of the flexible angular plane (FAP) to the sensor, known at some points of the disc.
Whole images need the points on its rim alone: closed curves, integrated by their Fourier series. Cut ones take the map
and the rims' squared heights as polynomials of the fifth degree over the disc; the lit part is integrated in polar
pieces between its corners.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from .aim import Aimed
from .images import circle, polygon_moments

Array = NDArray[np.float64]

RIM = 16
"""Rays along the FAP's rim, a multiple of four; the outline's area converges exponentially in them."""
HARMONICS = 6
"""Of a ray's squared height on a surface, along the FAP's rim."""
RINGS = ((0.5, 8), (0.8, 8))
"""Radii and rays of the rings inside, where rims cut."""
DEGREE, TERMS = 5, 21
"""Of the polynomials over the FAP's disc: products x^a y^b with a + b <= 5, b running fastest."""
POWERS = np.array([(a, b) for a in range(DEGREE + 1) for b in range(DEGREE + 1 - a)])
SCAN = 32
"""Directions in which the nearest rim is asked for, before corners are looked for between them."""
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
    highest.compiled(rim.heights, np.cos(2 * np.pi * np.arange(RIM) / RIM), HARMONICS, peaks, turns)
    return Outlines(np.concatenate([area[:, None], centroid, moments], axis=1), peaks, turns)


def cut_shapes(rim: Aimed, inner: Aimed, found: Outlines) -> tuple[Array, Array]:
    """Lit shapes (N, 6) and seen parts of the FAP (N,) of images that rims cut, from rays all over the FAP.

    nan where the lens loses some of those rays altogether.
    """
    outer_points, inner_points = pupil_points()
    places = np.concatenate([inner_points, outer_points])
    fit = np.ascontiguousarray(np.linalg.pinv(np.prod(places[:, None, :] ** POWERS, axis=-1)))
    landed = np.concatenate([inner.landed, rim.landed], axis=1)
    heights = np.concatenate([inner.heights, rim.heights], axis=1)
    shape, share = np.full((len(landed), 6), np.nan), np.full(len(landed), np.nan)
    whole = np.flatnonzero(~np.any(np.isnan(landed[:, :, 0]), axis=1))
    size, part = np.empty((len(whole), 6)), np.empty(len(whole))
    cut_images.compiled(
        landed[whole], heights[whole], found.peaks[whole], found.turns[whole], places, fit, _NODES + 0.5, _WEIGHTS,
        size, part,
    )  # fmt: skip
    shape[whole], share[whole] = size, part
    return shape, share


@kernel()
def peak(g: Any, waves: Any, cosines: Any, sines: Any) -> tuple[float, float]:
    """Largest value of a periodic function from its evenly spaced values, and the angle where it is taken.

    `waves` holds a cosine over the places; `cosines` and `sines` are room for the series' coefficients.
    """
    n, harmonics = len(g), len(cosines) - 1
    best = 0
    for i in range(1, n):
        if g[i] > g[best]:
            best = i
    angle = 2.0 * math.pi * best / n
    top = g[best]
    quarter = n // 4
    for h in range(harmonics + 1):
        a, b = 0.0, 0.0
        for i in range(n):
            turn = (h * i) % n
            a += g[i] * waves[turn]
            b += g[i] * waves[turn - quarter if turn >= quarter else turn - quarter + n]
        cosines[h], sines[h] = (a / n if h == 0 else 2.0 * a / n), 2.0 * b / n
    limit = math.pi / n
    start = angle
    value = top
    for _ in range(6):
        slope, curve, value = 0.0, 0.0, cosines[0]
        c1, s1 = math.cos(angle), math.sin(angle)
        c, s = 1.0, 0.0
        for h in range(1, harmonics + 1):
            c, s = c * c1 - s * s1, s * c1 + c * s1
            here = cosines[h] * c + sines[h] * s
            value += here
            slope += h * (sines[h] * c - cosines[h] * s)
            curve -= h * h * here
        if not curve < 0 or abs(slope) <= 1e-7 * -curve:  # the value is then right to rounding
            break
        angle = min(max(angle - slope / curve, start - limit), start + limit)
    return max(value, top), angle


@kernel()
def highest(heights: Any, waves: Any, harmonics: int, peaks: Any, turns: Any) -> None:
    """Largest squared heights (N, R) along the FAP's rim and the angles where they are, from (N, K, R) of K rays."""
    cosines, sines = np.empty(harmonics + 1), np.empty(harmonics + 1)
    for n in range(len(heights)):
        for k in range(heights.shape[2]):
            peaks[n, k], turns[n, k] = peak(heights[n, :, k], waves, cosines, sines)


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
    found = FAP
    for k in range(count):
        at = to_rim(rims[k], hx, hy, cosine, sine, far)
        if at < far:
            far, found = at, k
    return found


@kernel()
def beyond(rims: Any, one: int, other: int, hx: float, hy: float, angle: float) -> float:
    """How far outside rim `other` the boundary of rim `one` runs along a direction."""
    cosine, sine = math.cos(angle), math.sin(angle)
    at = to_circle(hx, hy, cosine, sine)
    if one != FAP:
        at = to_rim(rims[one], hx, hy, cosine, sine, 2.0 * at)
    x, y = hx + at * cosine, hy + at * sine
    if other == FAP:
        return x * x + y * y - 1.0
    f, _, _ = polynomial(rims[other], x, y)
    return f - 1.0


@kernel()
def corner(rims: Any, one: int, other: int, hx: float, hy: float, low: float, high: float) -> float:
    """Angle between two at which the boundary goes over from rim `one` to rim `other`."""
    inside, outside = beyond(rims, one, other, hx, hy, low), beyond(rims, one, other, hx, hy, high)
    stayed = 0
    for _ in range(60):
        if not (inside < 0.0 < outside) or high - low <= 1e-14:
            break
        middle = (low * outside - high * inside) / (outside - inside)
        value = beyond(rims, one, other, hx, hy, middle)
        if value == 0.0:
            return middle
        if value < 0.0:
            outside = outside * 0.5 if stayed < 0 else outside
            low, inside, stayed = middle, value, -1
        else:
            inside = inside * 0.5 if stayed > 0 else inside
            high, outside, stayed = middle, value, 1
    return 0.5 * (low + high)


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
                at = to_rim(rims[active], hx, hy, cosine, sine, 2.0 * at)
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
    landed: Any, heights: Any, peaks: Any, turns: Any, places: Any, fit: Any, nodes: Any, weights: Any, shape: Any,
    share: Any,
) -> None:  # fmt: skip
    """Lit shapes of N images that rims cut.

    Parameters
    ----------
    landed, heights : (N, P, 2), (N, P, R)
        Sensor points and squared heights of rays all over the FAP.
    peaks, turns : (N, R)
        From `highest`.
    places : (P, 2)
        Where the rays meet the unit disc of the FAP.
    fit : (TERMS, P)
        From values at those places to coefficients.
    nodes, weights
        Of a quadrature over [0, 1].
    shape : (N, 6)
        Gets area, centroid and central second moments; zeros where dark.
    share : (N,)
        Gets the part of the FAP that is seen.
    """
    points, rims = heights.shape[1], heights.shape[2]
    image, cuts = np.empty((2, TERMS)), np.empty((rims, TERMS))
    angles, active = np.empty(SCAN + rims), np.empty(SCAN + rims, np.int64)
    ends, along = np.empty(SCAN + rims), np.empty(SCAN + rims, np.int64)
    sums = np.empty(7)
    for n in range(len(landed)):
        count = 0
        marks = SCAN
        for i in range(SCAN):
            angles[i] = 2.0 * math.pi * i / SCAN
        for k in range(rims):
            cutting = peaks[n, k] > 1.0
            for p in range(points):
                cutting = cutting or heights[n, p, k] > 1.0
            if cutting:
                for m in range(TERMS):
                    total = 0.0
                    for p in range(points):
                        total += fit[m, p] * heights[n, p, k]
                    cuts[count, m] = total
                count += 1
        for axis in range(2):
            for m in range(TERMS):
                total = 0.0
                for p in range(points):
                    total += fit[m, p] * (landed[n, p, axis] - landed[n, 0, axis])
                image[axis, m] = total
        hx, hy, best = 0.0, 0.0, -1e300
        for p in range(points):
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
        for m in range(6):
            shape[n, m] = 0.0
        share[n] = 0.0
        if best <= 0.0:
            continue
        for k in range(rims):
            if peaks[n, k] > 1.0:  # a sliver between two directions of the scan must not be missed
                angle = math.atan2(math.sin(turns[n, k]) - hy, math.cos(turns[n, k]) - hx)
                angles[marks] = angle if angle >= 0 else angle + 2.0 * math.pi
                marks += 1
        order = np.argsort(angles[:marks])
        for i in range(marks):
            active[i] = nearest(cuts, count, hx, hy, angles[order[i]])
        for m in range(7):
            sums[m] = 0.0
        corners = 0
        for i in range(marks):
            after = i + 1 if i + 1 < marks else 0
            one, other = active[i], active[after]
            if one != other:
                high = angles[order[after]] + (0.0 if after else 2.0 * math.pi)
                ends[corners] = corner(cuts, one, other, hx, hy, angles[order[i]], high)
                along[corners] = other
                corners += 1
        if corners == 0:
            add_piece(cuts, active[0], image, hx, hy, 0.0, 2.0 * math.pi, nodes, weights, sums)
        for i in range(corners):
            high = ends[i + 1] if i + 1 < corners else ends[0] + 2.0 * math.pi
            add_piece(cuts, along[i], image, hx, hy, ends[i], high, nodes, weights, sums)
        area = sums[0]
        mx, my = sums[1] / area, sums[2] / area
        x0, _, _ = polynomial(image[0], hx, hy)
        y0, _, _ = polynomial(image[1], hx, hy)
        shape[n, 0] = abs(area)
        shape[n, 1], shape[n, 2] = x0 + mx + landed[n, 0, 0], y0 + my + landed[n, 0, 1]
        shape[n, 3], shape[n, 4], shape[n, 5] = (
            sums[3] / area - mx * mx,
            sums[4] / area - mx * my,
            sums[5] / area - my * my,
        )
        share[n] = min(1.0, sums[6] / math.pi)
