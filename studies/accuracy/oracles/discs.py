"""Common parts of discs and polygons by integration over vertical slices in mpmath: no arcs, angles or triangles."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import mpmath as mp

Slice = Callable[[Any, Any, Any], Any]
"""Integral along one slice: at x, from bottom to top."""


def exact(values: Any) -> Any:
    """Floats (nested lists or arrays) as the mpmath numbers they exactly are."""
    if hasattr(values, "tolist"):
        values = values.tolist()
    return [exact(v) for v in values] if isinstance(values, list | tuple) else mp.mpf(values)


def slices(centres: Any, radii: Any, polygon: Any = None) -> tuple[list[Any], Callable[[Any], tuple[Any, Any]]]:
    """Ends of the slices' x-range, the places where another curve takes over, and the y-range as a function of x."""
    discs = list(zip(exact(centres), exact(radii), strict=True))
    corners = [] if polygon is None else exact(polygon)
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))
    breaks = [x for x, _ in corners]
    low = max([c[0] - r for c, r in discs] + ([min(breaks)] if edges else []))
    high = min([c[0] + r for c, r in discs] + ([max(breaks)] if edges else []))
    for ((x1, y1), r1), ((x2, y2), r2) in itertools.combinations(discs, 2):
        dd = (x2 - x1) ** 2 + (y2 - y1) ** 2
        if dd == 0:
            continue
        t = (dd + r1**2 - r2**2) / (2 * dd)
        root = r1**2 / dd - t**2
        if root >= 0:
            breaks += [x1 + t * (x2 - x1) + s * mp.sqrt(root) * (y2 - y1) for s in (-1, 1)]
    for (ax, ay), (bx, by) in edges:
        for (cx, cy), r in discs:
            a = (bx - ax) ** 2 + (by - ay) ** 2
            b = (bx - ax) * (ax - cx) + (by - ay) * (ay - cy)
            root = b**2 - a * ((ax - cx) ** 2 + (ay - cy) ** 2 - r**2)
            if root >= 0:
                breaks += [ax + (-b + s * mp.sqrt(root)) / a * (bx - ax) for s in (-1, 1)]

    # Asked some thousand times: what does not depend on x is had beforehand.
    curves = [(cx, cy, r * r) for (cx, cy), r in discs]
    sides = [(min(ax, bx), max(ax, bx), ax, ay, (by - ay) / (bx - ax)) for (ax, ay), (bx, by) in edges if ax != bx]

    def span(x: Any) -> tuple[Any, Any]:
        bottom, top = mp.ninf, mp.inf
        for cx, cy, square in curves:
            off = x - cx
            left = square - off * off
            half = mp.sqrt(left) if left > 0 else mp.mpf(0)
            bottom, top = max(bottom, cy - half), min(top, cy + half)
        if edges:
            across = [ay + rise * (x - ax) for start, end, ax, ay, rise in sides if start <= x <= end]
            bottom, top = max(bottom, min(across, default=mp.inf)), min(top, max(across, default=mp.ninf))
        return bottom, top

    breaks += [c[0] + s * r for c, r in discs for s in (-1, 1)]
    return [low, *sorted({x for x in breaks if low < x < high}), high], span


def integrals(
    centres: Any, radii: Any, along: Sequence[Slice], polygon: Any = None, *, digits: int = 60
) -> list[Any]:  # fmt: skip
    """Integrals over the common part, one for each way to integrate along a slice; 0 if it is empty."""
    with mp.workdps(digits):
        places, span = slices(centres, radii, polygon)
        if places[-1] <= places[0]:
            return [mp.mpf(0) for _ in along]
        if len(along) > 1:  # each asks for the same slices
            span = functools.cache(span)

        def integrand(slice_: Slice) -> Callable[[Any], Any]:
            def at(x: Any) -> Any:
                bottom, top = span(x)
                return slice_(x, bottom, top) if top > bottom else mp.mpf(0)

            return at

        return [mp.quad(integrand(slice_), places) for slice_ in along]


def power(a: int, b: int) -> Slice:
    """Of x^a y^b."""
    return lambda x, bottom, top: x**a * (top ** (b + 1) - bottom ** (b + 1)) / (b + 1)


def area(centres: Any, radii: Any, polygon: Any = None, *, digits: int = 60) -> Any:
    """Area of the common part."""
    return integrals(centres, radii, [power(0, 0)], polygon, digits=digits)[0]


def shape(centres: Any, radii: Any, *, digits: int = 60) -> tuple[Any, Any, Any]:
    """Area, centroid and central second moments per unit area (xx, xy, yy)."""
    with mp.workdps(digits):
        orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        a, x, y, xx, xy, yy = integrals(centres, radii, [power(*order) for order in orders], digits=digits)
        x, y = x / a, y / a
        return a, (x, y), (xx / a - x * x, xy / a - x * y, yy / a - y * y)


def lens_area(centres: Any, radii: Any, *, digits: int = 60) -> Any:
    """Area common to two discs by their segments, with arc cosines that are harmless at this many digits."""
    with mp.workdps(digits):
        (c1, c2), (r1, r2) = exact(centres), exact(radii)
        d = mp.hypot(c2[0] - c1[0], c2[1] - c1[1])
        if d >= r1 + r2:
            return mp.mpf(0)
        if d <= abs(r1 - r2):
            return mp.pi * min(r1, r2) ** 2
        a1 = mp.acos((d**2 + r1**2 - r2**2) / (2 * d * r1))
        a2 = mp.acos((d**2 + r2**2 - r1**2) / (2 * d * r2))
        return r1**2 * (a1 - mp.sin(2 * a1) / 2) + r2**2 * (a2 - mp.sin(2 * a2) / 2)
