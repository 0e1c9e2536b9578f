"""Images of stops on the sensor by exact rays through elements: discs and polygons still, to within a measured error.

Through a pinhole microlens the image of a stop is to first order a disc, or a polygon. Exact rays move it and make it
larger or smaller, smoothly over the array, and turn it out of its shape by far less: so the moves are interpolated
between microlenses, and their error is what exact outlines there and between them differ by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..bore.opening import ClearAperture
from ..camera import Camera, Rim
from ..polynomials import Polynomials, nodes_between
from ..shapes.openings import Openings
from ..theory.exit_pupil import stop_angle
from ..theory.object_space import ObjectSpaceFaces
from ..theory.stop_images import stop_openings

Floats = NDArray[np.float64]

NODES = 9
"""Microlenses along each axis of the array at which exact outlines are sought."""
POINTS = 24
"""Points of an outline."""
STEPS = 40
"""Towards it, each of which leaves as much of the miss as exact rays differ from first order."""
SETTLED = 1e-10
"""Part of a stop's reach that rays may miss its edge by."""
NEAR = 0.999
"""Part of a rim within which all light keeps where the rim is left out."""


@dataclass(frozen=True, eq=False)
class ExactOpenings:
    """Images of the FAP and of the rims that cut its light, through any microlens of a part of the array."""

    camera: Camera
    rims: tuple[int, ...]
    """Indices of its stops in `stop_openings`; the FAP is 0."""
    moves: Polynomials
    """Differences of the openings' numbers (`_numbers`) from first order over that part of the array, from the main
    lens's centre, N functions [mm]."""
    error: float
    """Largest distance of exact outlines from these openings [mm, on the sensor]."""

    @classmethod
    def of(cls, camera: Camera, low: Floats, high: Floats, wavelength: float) -> ExactOpenings | None:
        """Through the microlenses of a rectangle of the array.

        Parameters
        ----------
        camera : Camera
            One; nothing tilted.
        low, high : ndarray, shape (2,)
            Corners, from the main lens's centre [mm].
        wavelength : float
            Of the light in the elements; all else is as at the camera's own [mm].

        Returns
        -------
        ExactOpenings or None
            None where a stop is more than one upright opening (tilts, wedges, real lenses, the barrels of rods), or
            where rays to its edge are lost.
        """
        wedged = any(np.any(value) for place, value in camera.numbers.items() if ".wedge." in place)
        upright = not wedged and all(element.round_when_seen for element in camera.chain.elements)
        if camera.chain.in_air or camera.tilted or not upright:
            return None
        middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
        nodes = nodes_between(-1.0, 1.0, NODES)
        between = (nodes[1:] + nodes[:-1]) / 2
        places, others = (
            middle[:, None] + half[:, None] * np.stack([part.ravel() for part in np.meshgrid(on, on)])
            for on in (nodes, between)
        )
        x, y = places
        outlines = _Outlines.of(camera, wavelength)
        chosen = outlines.cutting(x, y)
        if chosen is None:
            return None
        first = stop_openings(camera, x, y).some(chosen)
        try:
            at_nodes, check = ([outlines.points(k, *some) for k in chosen] for some in ((x, y), others))
        except _LostRayError:
            return None
        fitted = _fitted(first, at_nodes)
        moved = (_numbers(fitted) - _numbers(first)).T
        moves = Polynomials.fitted(middle, half, NODES - 1, places, moved, each=True)
        exact = cls(camera, tuple(chosen), moves, 0.0)
        error = max(
            float(placed.off_rim(k, points).max())
            for placed, outline in ((fitted, at_nodes), (exact.at(*others), check))
            for k, points in enumerate(outline)
        )
        return replace(exact, error=error)

    @property
    def farthest(self) -> float:
        """Largest distance that the edge of the FAP's image moves [mm]."""
        size, total = self.moves.bound, len(self.rims)
        corners = size[3 * total :].reshape(-1, 2) if self.camera.fap.outline.straight else np.zeros((1, 2))
        return float(max(np.hypot(*size[:2]) + size[2 * total], np.hypot(*corners.T).max()))

    def at(self, x: Floats, y: Floats) -> Openings:
        """Openings relative to microlens axes; beyond the part as at its edge.

        Parameters
        ----------
        x, y : ndarray, shape (...)
            Axes of microlenses from the main lens's centre [mm].
        """
        first = stop_openings(self.camera, x, y).some(self.rims)
        middle, half = self.moves.middle, self.moves.half
        within = (np.clip(part, m - h, m + h) for part, m, h in zip((x, y), middle, half, strict=True))
        moved = np.moveaxis(self.moves.at(*within), 0, -1)
        at, total = 2 * first.total, first.total
        return Openings(
            first.centres + moved[..., :at].reshape(first.centres.shape),
            first.radii + moved[..., at : at + total],
            first.corners + moved[..., at + total :].reshape(first.corners.shape),
            first.polygons,
        )


def _numbers(openings: Openings) -> Floats:
    """Centres, radii and corners in a row, (..., 3 K + 8 P) [mm]; for polygons' radii 0."""
    lead = openings.radii.shape[:-1]
    radii = np.where(np.isfinite(openings.radii), openings.radii, 0.0)
    return np.concatenate([openings.centres.reshape(*lead, -1), radii, openings.corners.reshape(*lead, -1)], -1)


def _fitted(first: Openings, outlines: Sequence[Floats]) -> Openings:
    """Openings nearest to outlines (N, POINTS, 2), each of the kind of those of first order."""
    centres, radii, corners = (part.copy() for part in (first.centres, first.radii, first.corners))
    for k in first.discs:
        middle = outlines[k].mean(1)
        off = outlines[k] - middle[:, None]
        # Least squares of |p|^2 = 2 a . p + b.
        rows = np.concatenate([2 * off, np.ones_like(off[..., :1])], -1)
        u, v, b = np.squeeze(np.linalg.pinv(rows) @ np.sum(off**2, -1)[..., None], -1).T
        centres[:, k], radii[:, k] = middle + np.stack([u, v], -1), np.sqrt(b + u * u + v * v)
    for n, k in enumerate(first.polygons):
        corners[:, n] = _straightened(outlines[k].reshape(len(centres), corners.shape[2], -1, 2))
        centres[:, k] = corners[:, n].mean(1)
    return Openings(centres, radii, corners, first.polygons)


def _straightened(sides: Floats) -> Floats:
    """Corners (N, M, 2) where the straight lines nearest to points (N, M, P, 2) along sides meet those before them."""
    middle = sides.mean(2)
    off = sides - middle[:, :, None]
    way = np.linalg.svd(off, full_matrices=False)[2][:, :, 0]
    normal = np.stack([-way[..., 1], way[..., 0]], -1)
    before = np.roll(normal, 1, 1), np.roll(middle, 1, 1)
    lines = np.stack([before[0], normal], -2)
    reach = np.stack([(before[0] * before[1]).sum(-1), (normal * middle).sum(-1)], -1)
    return np.asarray(np.squeeze(np.linalg.solve(lines, reach[..., None]), -1))


class _LostRayError(Exception):
    """A ray to the edge of a stop does not get there."""


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Exact rays to the edges of stops."""

    camera: Camera
    stops: tuple[Rim, ...]
    space: ObjectSpaceFaces

    @classmethod
    def of(cls, camera: Camera, wavelength: float) -> _Outlines:
        coloured = camera if wavelength == camera.wavelength else camera.replace({"wavelength": wavelength})
        return cls(camera, (camera.fap, *camera.rims), ObjectSpaceFaces.of(coloured, clip=False))

    def cutting(self, x: Floats, y: Floats) -> Sequence[int] | None:
        """The FAP, and the stops that some light through it does not clear."""
        try:
            through = self.points(0, x, y)
        except _LostRayError:
            return None
        chosen, first = [0], stop_openings(self.camera, x, y)
        for k in range(1, len(self.stops)):
            if not np.isfinite(np.max(self.stops[k].radius)):
                continue
            if not self.stops[k].size_places:  # a stop for slopes, which flat faces behind it keep
                off = (through - first.centres[:, k, None]) / first.radii[:, k, None, None]
                held = ClearAperture(NEAR).contains(off[..., 0], off[..., 1])
            else:
                try:
                    place = self.met(k, x, y, through)
                except _LostRayError:
                    return None
                held = self.own(k).scaled(NEAR).contains(place[..., 0], place[..., 1])
            if not held.all():
                chosen.append(k)
        return chosen

    def own(self, k: int) -> ClearAperture:
        """The opening of a stop, with a ruler."""
        return self.stops[k].outline.scaled(self.stops[k].scale)

    def met(self, k: int, x: Floats, y: Floats, points: Floats) -> Floats:
        """Points where rays from the sensor, relative to their microlenses' axes, meet a stop, from its centre."""
        c, z = self.camera, float(self.stops[k].ruler_distance)
        slope = np.moveaxis(points, -1, 0) / float(c.seen.d_2)
        height = np.stack([x, y])[..., None] - slope * float(c.seen.d_1)
        outside = slope + height / float(c.f)
        start = height + np.array(c.lens_centre)[:, None, None]
        there = next(self.space.rays_at([z], (start[0], start[1]), (outside[0], outside[1])))
        if np.any(there.status):
            raise _LostRayError
        centre = np.array(c.ruler_pose(self.stops[k].part).origin[:2], float)
        return np.moveaxis(there.height - there.slope * z - centre[:, None, None], 0, -1)

    def points(self, k: int, x: Floats, y: Floats) -> Floats:
        """Outline of a stop through microlenses, relative to their axes, (..., POINTS, 2) [mm]; side by side.

        Rays need not meet one point of the rim but any near it: first order's inverse does that in one to four of them,
        where `traced.train`'s aimer would take three for its derivatives alone.
        """
        rim, c = self.stops[k], self.camera
        centre = stop_openings(c, x, y).centres[:, k, None]
        scale = -float(c.seen.d_2 * stop_angle(c, rim.distance))
        if rim.behind or not rim.size_places:
            return np.asarray(centre + scale * rim.outline.along_rim(POINTS))
        # To first order, what the stop's own lengths are on the sensor.
        scale /= float((rim.plane or c.plane(rim.ruler_distance)).magnification)
        edge, own = self.own(k).along_rim(POINTS), self.own(k).reach
        outline = centre + scale * edge
        for _ in range(STEPS):
            miss = self.met(k, x, y, outline) - edge
            if np.abs(miss).max() < SETTLED * own:
                return np.asarray(outline)
            outline = outline - scale * miss
        raise _LostRayError
