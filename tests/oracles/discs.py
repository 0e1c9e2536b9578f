"""Common parts of discs and polygons by integration over vertical slices in mpmath: no arcs, angles or triangles."""

import itertools

import mpmath as mp


def exact(values):
    """Floats (nested lists or arrays) as the mpmath numbers they exactly are."""
    if hasattr(values, "tolist"):
        values = values.tolist()
    return [exact(v) for v in values] if isinstance(values, list | tuple) else mp.mpf(values)


def slices(centres, radii, polygon=None):
    """Ends of the slices' x-range, the places where another curve takes over, and the y-range as a function of x."""
    discs = list(zip(exact(centres), exact(radii), strict=True))
    edges = []
    breaks = []
    if polygon is not None:
        corners = exact(polygon)
        edges = list(zip(corners, corners[1:] + corners[:1], strict=True))
        breaks += [x for x, _ in corners]
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

    def span(x):
        tops, bottoms = [], []
        for (cx, cy), r in discs:
            half = mp.sqrt(max(r**2 - (x - cx) ** 2, 0))
            tops.append(cy + half)
            bottoms.append(cy - half)
        if edges:
            across = []
            for (ax, ay), (bx, by) in edges:
                if min(ax, bx) <= x <= max(ax, bx) and ax != bx:
                    across.append(ay + (by - ay) * (x - ax) / (bx - ax))
            tops.append(max(across, default=mp.ninf))
            bottoms.append(min(across, default=mp.inf))
        return max(bottoms), min(tops)

    breaks += [c[0] + s * r for c, r in discs for s in (-1, 1)]
    return [low, *sorted({x for x in breaks if low < x < high}), high], span


def moments(centres, radii, polygon=None, *, orders=((0, 0),), digits=60):
    """Integrals of x^a y^b over the common part, one for each (a, b); 0 if it is empty."""
    with mp.workdps(digits):
        points, span = slices(centres, radii, polygon)
        if points[-1] <= points[0]:
            return [mp.mpf(0) for _ in orders]

        def integrand(a, b):
            def slice_integral(x):
                bottom, top = span(x)
                return x**a * (top ** (b + 1) - bottom ** (b + 1)) / (b + 1) if top > bottom else mp.mpf(0)

            return slice_integral

        return [mp.quad(integrand(a, b), points) for a, b in orders]


def area(centres, radii, polygon=None, *, digits=60):
    """Area of the common part."""
    return moments(centres, radii, polygon, digits=digits)[0]


def shape(centres, radii, *, digits=60):
    """Area, centroid and central second moments per unit area (xx, xy, yy)."""
    with mp.workdps(digits):
        orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        a, x, y, xx, xy, yy = moments(centres, radii, orders=orders, digits=digits)
        x, y = x / a, y / a
        return a, (x, y), (xx / a - x * x, xy / a - x * y, yy / a - y * y)


def lens_area(centres, radii, *, digits=60):
    """Area common to two discs by the textbook formula with arc cosines, harmless at this many digits."""
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
