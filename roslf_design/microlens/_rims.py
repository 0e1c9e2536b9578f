"""Kernels for the common part of ellipses, each the image of the unit circle under a projective map of the plane.

On rim i, parametrised by its angle on the stop itself, the inside of rim j is where a quadratic form of (cos, sin, 1)
is negative: a trigonometric polynomial of degree two. Between its extremes it is monotone, so each of its at most four
zeros has a bracket of its own, and no cut is too short to be seen.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ._arcs import TURN, exclude, leave
from ._circles import NODES, WEIGHTS
from ._shapes import CLIPPED, EMPTY, FULL

Floats = NDArray[np.float64]

SAMPLES = 48
"""Points at which the slope's sign is looked at; two of its zeros closer than that bound a flat stretch, not a cut."""
PANEL = math.pi / 4
"""Largest angle for one 16-point quadrature."""
SAME = 1e-13
"""Quadratic forms below this, for circles of unit size, are one rim and its copy."""


@kernel()
def value(c: Floats, angle: float) -> float:
    """``c0 + c1 cos + c2 sin + c3 cos 2. + c4 sin 2.``."""
    cosine = math.cos(angle)
    sine = math.sin(angle)
    return float(
        c[0] + c[1] * cosine + c[2] * sine + c[3] * (cosine - sine) * (cosine + sine) + c[4] * 2.0 * cosine * sine
    )


@kernel()
def derive(c: Floats, out: Floats) -> None:
    """Coefficients of the derivative."""
    out[0] = 0.0
    out[1] = c[2]
    out[2] = -c[1]
    out[3] = 2.0 * c[4]
    out[4] = -2.0 * c[3]


@kernel()
def zero(c: Floats, slope: Floats, low: float, high: float) -> float:
    """The zero in [low, high], where the signs differ: Newton's step inside the bracket, else its middle."""
    rising = value(c, low) < 0.0
    x = 0.5 * (low + high)
    for _ in range(100):
        f = value(c, x)
        if f == 0.0:
            return x
        if (f < 0.0) == rising:
            low = x
        else:
            high = x
        g = value(slope, x)
        step = x - f / g if g != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - x) <= 2e-16 * abs(x) or not low < step < high:
            return step
        x = step
    return x


@kernel()
def excluded(c: Floats, out: Floats, extremes: Floats, slope: Floats, curve: Floats) -> int:
    """Intervals where the polynomial is positive, into ``out`` (start, length); -1 if everywhere."""
    derive(c, slope)
    derive(slope, curve)
    n = 0
    first = value(slope, 0.0)
    before = first
    for k in range(SAMPLES):
        here = TURN * k / SAMPLES
        there = TURN * (k + 1) / SAMPLES
        after = value(slope, there) if k + 1 < SAMPLES else first  # as periodic in rounding as in truth
        if (before < 0.0) != (after < 0.0):
            extremes[n] = zero(slope, curve, here, there)
            n += 1
        before = after
    if n == 0:
        return -1 if value(c, 0.0) > 0.0 else 0
    start = 0.0
    end = 0.0
    count = 0
    pending = False
    first_end = -1.0
    for k in range(n):
        low = extremes[k]
        high = extremes[k + 1] if k + 1 < n else extremes[0] + TURN
        at_low = value(c, low) > 0.0
        at_high = value(c, high) > 0.0
        if at_high and not at_low:
            start = zero(c, slope, low, high)
            pending = True
        elif at_low and not at_high:
            end = zero(c, slope, low, high)
            if pending:
                out[count, 0] = start
                out[count, 1] = end - start
                count += 1
                pending = False
            else:
                first_end = end
    if pending:
        out[count, 0] = start
        out[count, 1] = first_end + TURN - start
        count += 1
    if count == 0:
        return -1 if value(c, extremes[0]) > 0.0 else 0
    return count


@kernel()
def relate(first: Floats, second_inverse: Floats, c: Floats) -> bool:
    """Polynomial on rim `first` that is negative inside the other; False if they are the same rim."""
    q = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for m in range(3):
                q[a, b] += second_inverse[a, m] * first[m, b]
    # (U, V, W) = q (cos, sin, 1); the form U^2 + V^2 - W^2.
    cc = q[0, 0] * q[0, 0] + q[1, 0] * q[1, 0] - q[2, 0] * q[2, 0]
    ss = q[0, 1] * q[0, 1] + q[1, 1] * q[1, 1] - q[2, 1] * q[2, 1]
    oo = q[0, 2] * q[0, 2] + q[1, 2] * q[1, 2] - q[2, 2] * q[2, 2]
    cs = q[0, 0] * q[0, 1] + q[1, 0] * q[1, 1] - q[2, 0] * q[2, 1]
    co = q[0, 0] * q[0, 2] + q[1, 0] * q[1, 2] - q[2, 0] * q[2, 2]
    so = q[0, 1] * q[0, 2] + q[1, 1] * q[1, 2] - q[2, 1] * q[2, 2]
    c[0] = oo + 0.5 * (cc + ss)
    c[1] = 2.0 * co
    c[2] = 2.0 * so
    c[3] = 0.5 * (cc - ss)
    c[4] = cs
    size = 0.0
    scale = 0.0
    for k in range(5):
        size = max(size, abs(c[k]))
    for a in range(3):
        for b in range(3):
            scale = max(scale, abs(q[a, b]))
    return size > SAME * scale * scale


@kernel()
def add_arc(h: Floats, start: float, end: float, x0: float, y0: float, total: Floats) -> None:
    """Green's integrals along a rim, about (x0, y0): area, x, y, xx, xy, yy."""
    panels = math.ceil((end - start) / PANEL)
    width = (end - start) / panels
    for p in range(panels):
        for n in range(16):
            angle = start + width * (p + NODES[n])
            cosine = math.cos(angle)
            sine = math.sin(angle)
            w = h[2, 0] * cosine + h[2, 1] * sine + h[2, 2]
            x = (h[0, 0] * cosine + h[0, 1] * sine + h[0, 2]) / w
            y = (h[1, 0] * cosine + h[1, 1] * sine + h[1, 2]) / w
            turn = h[2, 1] * cosine - h[2, 0] * sine
            weight = width * WEIGHTS[n]
            dx = weight * (h[0, 1] * cosine - h[0, 0] * sine - x * turn) / w
            dy = weight * (h[1, 1] * cosine - h[1, 0] * sine - y * turn) / w
            x -= x0
            y -= y0
            total[0] += 0.5 * (x * dy - y * dx)
            total[1] += 0.5 * x * x * dy
            total[2] -= 0.5 * y * y * dx
            total[3] += x * x * x * dy / 3.0
            total[4] += 0.5 * x * x * y * dy
            total[5] -= y * y * y * dx / 3.0


@kernel()
def rim_shapes(
    maps: Floats,
    inverses: Floats,
    area: Floats,
    centroid: Floats,
    moments: Floats,
    kept: Floats,
    lost: Floats,
    status: NDArray[np.int8],
    clips: NDArray[np.bool_],
) -> None:
    """Common parts of the images of the unit circle under ``maps`` (n, K, 3, 3); results as `_shapes.shapes`."""
    n, count = maps.shape[:2]
    c = np.empty(5)
    slope = np.empty(5)
    curve = np.empty(5)
    extremes = np.empty(SAMPLES + 1)
    cuts = np.empty((SAMPLES, 2))
    intervals = np.empty((4 * count, 2))
    parts = np.empty((4 * count + 1, 2))
    total = np.empty(6)
    whole = np.empty(6)
    apart = np.empty((count, count), np.bool_)
    for s in range(n):
        total[:] = 0.0
        whole[:] = 0.0
        clips[s] = False
        apart[:] = False
        x0 = maps[s, 0, 0, 2] / maps[s, 0, 2, 2]
        y0 = maps[s, 0, 1, 2] / maps[s, 0, 2, 2]
        add_arc(maps[s, 0], 0.0, TURN, x0, y0, whole)
        state = EMPTY
        for i in range(count):
            m = 0
            origin = 0.0
            out = False
            for j in range(count):
                if j == i:
                    continue
                if not relate(maps[s, i], inverses[s, j], c):
                    out = out or j < i
                    continue
                found = excluded(c, cuts, extremes, slope, curve)
                if found < 0:
                    apart[i, j] = True
                    out = True
                for k in range(found):
                    if m == 0:
                        origin = cuts[k, 0]
                    m = exclude(cuts[k, 0], cuts[k, 1], origin, m, intervals)
            if out:
                continue
            if m == 0:
                add_arc(maps[s, i], 0.0, TURN, x0, y0, total)
                state = FULL if i == 0 else CLIPPED
                clips[s, i] = i > 0
                continue
            for k in range(leave(origin, m, intervals, parts, 0)):
                add_arc(maps[s, i], parts[k, 0], parts[k, 1], x0, y0, total)
                state = CLIPPED
                clips[s, i] = i > 0
        if total[0] <= 0.0:
            state = EMPTY
        status[s] = state
        centroid[s, 0] = x0
        centroid[s, 1] = y0
        area[s] = 0.0
        moments[s] = 0.0
        kept[s] = 0.0
        lost[s] = 1.0
        if state == EMPTY:
            met = True
            for i in range(count):
                for j in range(i):
                    if met and apart[i, j] and apart[j, i]:
                        met = False
                        clips[s, i] = True
                        clips[s, j] = j > 0
            for i in range(1, count):
                clips[s, i] = clips[s, i] or met
            continue
        area[s] = total[0]
        mx = total[1] / total[0]
        my = total[2] / total[0]
        centroid[s, 0] += mx
        centroid[s, 1] += my
        moments[s, 0] = max(0.0, total[3] / total[0] - mx * mx)
        moments[s, 1] = total[4] / total[0] - mx * my
        moments[s, 2] = max(0.0, total[5] / total[0] - my * my)
        kept[s] = 1.0 if state == FULL else min(1.0, total[0] / whole[0])
        lost[s] = 1.0 - kept[s]
