"""Rays through folded systems in three dimensions, where things really stand; shares no code with the package.

A design's numbers are laid out part by part: behind each mirror as meant, everything is set up mirrored in it. Rays are
then reflected at the mirrors as they are, refracted at faces by Snell's law, bent by ideal lenses and cut by openings.
"""

import math

import numpy as np


def tilted(tilt):
    """Axes turned about x, then y."""
    (cx, sx), (cy, sy) = ((math.cos(t), math.sin(t)) for t in tilt)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return about_y @ about_x


def turned_towards(angle, azimuth):
    """Axes whose z is turned by an angle towards an azimuth."""
    (c, s), (ca, sa) = (math.cos(angle), math.sin(angle)), (math.cos(azimuth), math.sin(azimuth))
    roll = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    return roll @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ roll.T


class Mirroring:
    """A reflection of space in a plane."""

    def __init__(self, point, normal):
        self.linear = np.eye(3) - 2 * np.outer(normal, normal)
        self.offset = 2 * (point @ normal) * normal

    def __call__(self, points):
        return points @ self.linear.T + self.offset

    def ways(self, vectors):
        return vectors @ self.linear.T


class Folded:
    """Parts of a design before its main lens, as they really stand, and rays through them."""

    def __init__(self, design, elements=None):
        self.design, self.mirrorings, self.parts = design, [], []
        elements = list(design.elements if elements is None else elements)
        items = [(e.distance, 1, e) for e in elements]
        items += [(s.distance, 0, s) for s in (design.aperture, *design.stops)]
        last = max(elements, key=lambda e: e.distance, default=None)
        medium = float(design.object_space.medium.index(design.wavelength))
        for distance, is_element, part in sorted(items, key=lambda item: item[:2]):
            vertex, own = np.array([0.0, 0.0, -distance]), tilted(part.tilt)
            centre = vertex + np.array([*part.decentre, 0.0])
            if not is_element:
                self._put("stop", centre, own, part.diameter / 2, part)
            elif part.kind == "mirror":
                axes = turned_towards(math.pi / 2 - part.angle, part.azimuth)
                meant, normal = axes[:, 2], (axes @ own)[:, 2]
                on = vertex + part.piston * meant
                off = np.array(part.decentre)
                down = normal[:2] @ (off + vertex[:2] - on[:2]) / normal[2]  # stays in the surface
                middle = np.array([*off, on[2] - down])
                self._put("mirror", middle, axes @ own, part.diameter / 2, part)
                self.mirrorings.append(Mirroring(vertex, meant))
            elif part.kind == "lens":
                self._put("lens", centre, own, (part.diameter or math.inf) / 2, part, focal=part.focal_length)
            else:
                index = float(part.material.index(design.wavelength))
                radius, beyond = (part.diameter or math.inf) / 2, medium if part is last else 1.0
                self._put("face", centre, own @ tilted(part.wedge), radius, part, ratio=(1.0, index))
                self._put("face", centre - part.thickness * own[:, 2], own, radius, part, ratio=(index, beyond))

    def _put(self, kind, centre, axes, radius, part, **more):
        normal = axes[:, 2]
        for mirroring in reversed(self.mirrorings):
            centre, normal = mirroring(centre), mirroring.ways(normal)
        self.parts.append({"kind": kind, "centre": centre, "normal": normal, "radius": radius, "part": part, **more})

    def name(self, number):
        """Name of the part of that number in messages; "nobody" below 0."""
        part = self.parts[number]["part"]
        if number < 0:
            return "nobody"
        named = {id(self.design.aperture): "FAP"}
        named |= {id(stop): f"stop {k}" for k, stop in enumerate(self.design.stops, 1)}
        named |= {id(element): f"{element.kind} {k}" for k, element in enumerate(self.design.elements, 1)}
        return named[id(part)]

    def outwards(self, points, ways):
        """Rays from the main lens's plane on: points and unit directions at the end, who took each (-1: nobody).

        `behind` tells afterwards which of them came to a mirror's back, where no light travels.
        """
        points, ways = np.array(points, float), np.array(ways, float)
        axis, self.behind = np.array([0.0, 0.0, -1.0]), np.zeros(len(points), bool)
        ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
        took, where = np.full(len(points), -1), []
        for number, part in enumerate(self.parts):
            normal = part["normal"]
            reach = ((part["centre"] - points) @ normal) / (ways @ normal)
            points = points + reach[:, None] * ways
            where.append(points)
            out = np.linalg.norm(points - part["centre"], axis=-1) > part["radius"]
            took = np.where((took < 0) & out, number, took)
            if part["kind"] == "mirror":
                self.behind |= (ways @ normal) * (axis @ normal) <= 0
                axis = axis - 2 * (axis @ normal) * normal
                ways = ways - 2 * (ways @ normal)[:, None] * normal
            elif part["kind"] == "face":
                before, after = part["ratio"]
                facing = normal * np.where(ways @ normal > 0, -1.0, 1.0)[:, None]
                cosine, mu = -(ways * facing).sum(-1), before / after
                ways = mu * ways + (mu * cosine - np.sqrt(1 - mu**2 * (1 - cosine**2)))[:, None] * facing
            elif part["kind"] == "lens":
                along = ways @ normal
                bent = ways / along[:, None] - (points - part["centre"]) / part["focal"] * np.sign(along)[:, None]
                ways = bent * along[:, None] / np.linalg.norm(bent * along[:, None], axis=-1, keepdims=True)
        return points, ways, took, where

    def unfolded(self, points, ways):
        """Points and directions beyond all mirrors, as the unfolded system has them."""
        for mirroring in self.mirrorings:
            points, ways = mirroring(points), mirroring.ways(ways)
        return points, ways


def from_sensor(design, microlens, spots):
    """Rays from spots behind a pinhole microlens at (x, y) to just before the main lens: points there and directions.

    Spots are counted from the microlens's axis [mm], shape (N, 2).
    """
    slope = np.asarray(spots) / design.d_2
    height = np.asarray(microlens) - slope * design.d_1
    slope = slope + height / design.f
    points = np.column_stack([height, np.zeros(len(height))])
    return points, -np.column_stack([slope, np.ones(len(height))])


class SphericalLens:
    """A main lens of spherical and flat surfaces, in its own frame: first vertex at z = 0."""

    def __init__(self, lens, wavelength):
        self.surfaces, z, before, rows = [], 0.0, 1.0, np.eye(2)
        for surface in lens.surfaces:
            index = float(surface.glass.index(wavelength))
            self.surfaces.append((z, surface.curvature, surface.semi_diameter, before, index))
            rows = np.array([[1, 0], [-surface.curvature * (index - before), 1]]) @ rows  # height, index times slope
            rows = np.array([[1, surface.thickness / index], [0, 1]]) @ rows
            z, before = z + surface.thickness, index
        (a, _), (c, d) = rows
        self.front_principal = (1 - d) / -c  # behind the first vertex
        self.rear_principal = z + (1 - a) / c

    def outwards(self, points, ways):
        """Rays from the sensor's side on: points, unit directions, which of them pass all clear apertures."""
        passed = np.ones(len(points), bool)
        ways = ways / np.linalg.norm(ways, axis=-1, keepdims=True)
        for z, curvature, semi, beyond, within in reversed(self.surfaces):
            off = points - [0.0, 0.0, z]
            b = curvature * (off * ways).sum(-1) - ways[:, 2]
            c = curvature * (off * off).sum(-1) - 2 * off[:, 2]
            reach = -c / (b + np.sqrt(b * b - curvature * c))  # to the sheet at the vertex, as ways go to -z
            points = points + reach[:, None] * ways
            normal = np.array([0.0, 0.0, 1.0]) - curvature * (points - [0.0, 0.0, z])
            passed &= np.hypot(*points[:, :2].T) <= semi
            cosine, mu = -(ways * normal).sum(-1), within / beyond
            ways = mu * ways + (mu * cosine - np.sqrt(1 - mu**2 * (1 - cosine**2)))[:, None] * normal
        return points, ways, passed


def outline_by_rays(design, microlens, only_fap=False, count=2000):
    """Rim of what light reaches behind a pinhole microlens, from its axis, by halving; None where it is dark.

    Of what all stops leave, or of the FAP alone.
    """
    real, turn = Folded(design), np.linspace(0, 2 * math.pi, count, endpoint=False)
    fap = next(k for k, part in enumerate(real.parts) if part["part"] is design.aperture)

    def passes(spots):
        points, ways = from_sensor(design, np.broadcast_to(microlens, spots.shape), spots)
        _, _, took, where = real.outwards(points, ways)
        inside = np.linalg.norm(where[fap] - real.parts[fap]["centre"], axis=-1) <= design.D_F / 2
        return inside & (only_fap | (took < 0) & (np.hypot(*points[:, :2].T) <= design.D / 2))

    side = np.linspace(-0.06, 0.06, 121)
    spots = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    lit = passes(spots)
    if not lit.any():
        return None
    middle, ways = spots[lit].mean(0), np.stack([np.cos(turn), np.sin(turn)], -1)
    low, high = np.zeros(count), np.full(count, 0.1)
    for _ in range(40):
        half = (low + high) / 2
        good = passes(middle + half[:, None] * ways)
        low, high = np.where(good, half, low), np.where(good, high, half)
    return middle + low[:, None] * ways


def area(polygon):
    """Area of a polygon, corners counterclockwise."""
    x, y = (polygon - polygon.mean(0)).T
    return (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
