"""Independent references for lenses: the rays that an independent tracer was given, and vector traces at 60 digits.

Nothing here uses the package. mpmath is imported where it is needed, so that `optiland_rays.py` can use `incoming`
from another Python.
"""

from __future__ import annotations

import itertools

import numpy as np

WAVELENGTH = 550e-6
RAY_COUNT = 10_000


def incoming(radius, count):
    """Rays from planes in front of a lens through its vertex plane, up to 0.92 of its radius and 0.25 in slope."""
    rng = np.random.default_rng(20231)
    r, t = 0.92 * radius * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    slope, way = 0.25 * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    direction = np.stack([slope * np.cos(way), slope * np.sin(way), np.ones(count)]) / np.sqrt(1 + slope**2)
    aim = np.stack([r * np.cos(t), r * np.sin(t), np.zeros(count)])
    return aim - direction * rng.uniform(20, 200, count), direction


def vector_trace(surfaces, position, direction, backward=False):
    """One ray at 60 digits through coaxial surfaces, by bisection of the implicit equation and Snell's law as a system.

    Parameters
    ----------
    surfaces : list of dict
        ``c``, ``k``, ``a`` (r^2, r^4, ... terms), ``z``, ``semi`` and ``n``, the indices before and after.

    Returns
    -------
    (fate, position, direction)
        ``("kept", 0)``, ``("missed", k)``, ``("clipped", k)`` or ``("reflected", k)``, k from 1 in scene order.
    """
    import mpmath as mp

    with mp.workdps(60):
        p, d = [mp.mpf(float(v)) for v in position], [mp.mpf(float(v)) for v in direction]
        size = mp.sqrt(mp.fsum(v * v for v in d))
        d = [v / size for v in d]
        s = -1 if backward else 1
        numbered = list(enumerate(surfaces, start=1))
        for number, surface in reversed(numbered) if backward else numbered:
            hit = _meeting(mp, surface, p, d, s)
            if hit is None:
                return ("missed", number), p, d
            p, normal = hit
            if p[0] ** 2 + p[1] ** 2 > mp.mpf(surface["semi"]) ** 2:
                return ("clipped", number), p, d
            before, after = (mp.mpf(n) for n in (surface["n"][::-1] if backward else surface["n"]))
            # n (d - (d.N) N) is kept: the tangential part of the optical direction; the rest has the sign of travel.
            along = mp.fsum(a * b for a, b in zip(d, normal, strict=True))
            tangent = [before / after * (a - along * b) for a, b in zip(d, normal, strict=True)]
            rest = 1 - mp.fsum(t * t for t in tangent)
            if rest < 0:
                return ("reflected", number), p, d
            d = [t + mp.sign(along) * mp.sqrt(rest) * b for t, b in zip(tangent, normal, strict=True)]
        return ("kept", 0), p, d


def _meeting(mp, surface, p, d, s):
    """First crossing towards the side of travel of the sheet z = sag(r), and the unit normal there."""
    c, k, z0 = mp.mpf(surface["c"]), mp.mpf(surface["k"]), mp.mpf(surface["z"])
    terms = [mp.mpf(a) for a in surface["a"]]

    def sag(u):
        inner = 1 - (1 + k) * c * c * u
        if inner < 0:
            return None
        return c * u / (1 + mp.sqrt(inner)) + mp.fsum(a * u**i for i, a in enumerate(terms, start=1))

    def gap(t):
        x, y, z = (a + t * b for a, b in zip(p, d, strict=True))
        height = sag(x * x + y * y)
        return None if height is None else s * (z - z0 - height)

    nearest = -(p[0] * d[0] + p[1] * d[1] + (p[2] - z0) * d[2])
    reach = 2 * mp.mpf(surface["semi"]) + min(200, 2 * abs(1 / c if c else 0))  # the rest of a flat sphere is far away
    count = 800
    steps = [nearest + reach * (mp.mpf(2 * j) / count - 1) for j in range(count + 1)]
    for (low, at_low), (high, at_high) in itertools.pairwise((t, gap(t)) for t in steps):
        if at_low is None or at_high is None or not (at_low <= 0 < at_high):
            continue
        for _ in range(210):
            middle = (low + high) / 2
            if gap(middle) > 0:
                high = middle
            else:
                low = middle
        point = [a + low * b for a, b in zip(p, d, strict=True)]
        u = point[0] ** 2 + point[1] ** 2
        slope = c / (2 * mp.sqrt(1 - (1 + k) * c * c * u)) + mp.fsum(
            i * a * u ** (i - 1) for i, a in enumerate(terms, start=1)
        )
        normal = [-2 * slope * point[0], -2 * slope * point[1], mp.mpf(1)]
        size = mp.sqrt(mp.fsum(v * v for v in normal))
        return point, [v / size for v in normal]
    return None
