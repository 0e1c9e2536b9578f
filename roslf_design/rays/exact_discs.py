"""Images of stops on the sensor by exact rays through elements: discs still, to within a measured error.

Through a pinhole microlens the image of a stop is a disc to first order. Exact rays move it and make it larger or
smaller, smoothly over the array, and turn it out of round by far less: so the moves are interpolated between
microlenses, and their error is what exact outlines there and between them differ by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera, Rim
from ..polynomials import Polynomials, nodes_between
from ..theory.exit_pupil import stop_angle
from ..theory.object_space import ObjectSpaceFaces
from ..theory.stop_images import stop_discs

Floats = NDArray[np.float64]

NODES = 9
"""Microlenses along each axis of the array at which exact outlines are sought."""
POINTS = 24
"""Points of an outline."""
STEPS = 40
"""Towards it, each of which leaves as much of the miss as exact rays differ from first order."""
SETTLED = 1e-10
"""Part of a stop's radius that rays may miss its edge by."""
NEAR = 0.999
"""Part of a rim's radius within which all light keeps where the rim is left out."""


@dataclass(frozen=True, eq=False)
class ExactDiscs:
    """Images of the FAP and of the rims that cut its light, through any microlens of a part of the array."""

    camera: Camera
    rims: tuple[int, ...]
    """Indices of its stops in `stop_discs`; the FAP is 0."""
    moves: Polynomials
    """Differences of centres (x, y) and radii from first order over that part of the array, from the main lens's
    centre, (K, 3) functions [mm]."""
    error: float
    """Largest distance of exact outlines from these discs [mm, on the sensor]."""

    @classmethod
    def of(cls, camera: Camera, low: Floats, high: Floats, wavelength: float) -> ExactDiscs | None:
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
        ExactDiscs or None
            None where a stop is more than one upright circle (tilts, wedges, real lenses, the barrels of rods), or
            where rays to its edge are lost.
        """
        if camera.chain.in_air or camera.tilted or not _circles(camera):
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
        try:
            at_nodes = [outlines.disc(k, x, y) for k in chosen]
            check = [outlines.points(k, *others) for k in chosen]
        except _LostRayError:
            return None
        centres, radii = stop_discs(camera, x, y)
        moved = [
            (*(middle - centres[:, k].T), radius - radii[:, k])
            for k, (middle, radius, _) in zip(chosen, at_nodes, strict=True)
        ]
        moves = Polynomials.fitted(middle, half, NODES - 1, places, np.array(moved), each=True)
        discs = cls(camera, tuple(chosen), moves, 0.0)
        placed, sizes = discs.at(*others)
        away = [np.hypot(*(p - placed[:, k].T[..., None])) - sizes[:, k, None] for k, p in enumerate(check)]
        error = max(float(np.abs(away).max()), *(float(out.max()) for *_, out in at_nodes))
        return replace(discs, error=error)

    @property
    def farthest(self) -> float:
        """Largest distance that the edge of the FAP's image moves [mm]."""
        across, along, wider = self.moves.bound[0]
        return float(np.hypot(across, along) + wider)

    def at(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Centres relative to microlens axes, (..., K, 2), and radii, (..., K) [mm]; beyond the part as at its edge.

        Parameters
        ----------
        x, y : ndarray, shape (...)
            Axes of microlenses from the main lens's centre [mm].
        """
        centres, radii = stop_discs(self.camera, x, y)
        middle, half = self.moves.middle, self.moves.half
        inside = (np.clip(part, m - h, m + h) for part, m, h in zip((x, y), middle, half, strict=True))
        moved = np.moveaxis(self.moves.at(*inside), (0, 1), (-2, -1))
        rims = list(self.rims)
        return centres[..., rims, :] + moved[..., :2], radii[..., rims] + moved[..., 2]


class _LostRayError(Exception):
    """A ray to the edge of a stop does not get there."""


def _circles(camera: Camera) -> bool:
    """Whether every opening is an upright circle."""
    wedged = any(np.any(value) for place, value in camera.numbers.items() if ".wedge." in place)
    return not wedged and all(element.round_when_seen for element in camera.chain.elements)


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
        chosen, radii = [0], [float(np.max(rim.radius)) for rim in self.stops]
        centres, sizes = stop_discs(self.camera, x, y)
        for k in range(1, len(self.stops)):
            if not np.isfinite(radii[k]):
                continue
            if not self.stops[k].size_places:  # a stop for slopes, which flat faces behind it keep
                away = np.hypot(*(through - centres[:, k].T[..., None])) / sizes[:, k, None]
            else:
                try:
                    away = np.hypot(*self.met(k, x, y, through)) / self.own_radius(k)
                except _LostRayError:
                    return None
            if away.max() > NEAR:
                chosen.append(k)
        return chosen

    def own_radius(self, k: int) -> float:
        """[mm], with a ruler."""
        return float(self.stops[k].radius * self.stops[k].scale)

    def met(self, k: int, x: Floats, y: Floats, points: Floats) -> Floats:
        """Points where rays from the sensor, relative to their microlenses' axes, meet a stop, from its centre."""
        c, z = self.camera, float(self.stops[k].ruler_distance)
        slope = points / float(c.seen.d_2)
        height = np.stack([x, y])[..., None] - slope * float(c.seen.d_1)
        outside = slope + height / float(c.f)
        start = height + np.array(c.lens_centre)[:, None, None]
        there = next(self.space.rays_at([z], (start[0], start[1]), (outside[0], outside[1])))
        if np.any(there.status):
            raise _LostRayError
        centre = np.array(c.ruler_pose(self.stops[k].part).origin[:2], float)
        return np.asarray(there.height - there.slope * z - centre[:, None, None])

    def points(self, k: int, x: Floats, y: Floats) -> Floats:
        """Outline of a stop through microlenses, relative to their axes, (2, ..., POINTS) [mm].

        Rays need not meet one point of the rim but any near it: first order's inverse does that in one to four of them,
        where `traced.train`'s aimer would take three for its derivatives alone.
        """
        rim, c = self.stops[k], self.camera
        (centre, radius), turn = stop_discs(c, x, y), np.linspace(0, 2 * np.pi, POINTS, endpoint=False)
        around = np.stack([np.cos(turn), np.sin(turn)])
        outline = centre[:, k].T[..., None] + radius[:, k, None] * around[:, None]
        if not rim.size_places:
            return np.asarray(outline)
        # To first order, what the stop's own lengths are on the sensor.
        plane = rim.plane or c.plane(rim.ruler_distance)
        scale = -float(c.seen.d_2 * stop_angle(c, rim.distance)) / float(plane.magnification)
        own = self.own_radius(k)
        for _ in range(STEPS):
            place = self.met(k, x, y, outline)
            far = np.hypot(*place)
            if np.abs(far / own - 1).max() < SETTLED:
                return np.asarray(outline)
            outline = outline - scale * place * (1 - own / far)
        raise _LostRayError

    def disc(self, k: int, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """The disc nearest to an outline: its centre (2, ...), radius and how far from it the outline comes [mm]."""
        points = self.points(k, x, y)
        middle = points.mean(-1)
        off = points - middle[..., None]
        # Least squares of |p|^2 = 2 a . p + b.
        rows = np.stack([2 * off[0], 2 * off[1], np.ones_like(off[0])], -1)
        u, v, b = np.squeeze(np.linalg.pinv(rows) @ np.sum(off**2, 0)[..., None], -1).T
        radius = np.sqrt(b + u * u + v * v)
        away = np.hypot(off[0] - u[:, None], off[1] - v[:, None]) - radius[:, None]
        return middle + np.stack([u, v]), radius, np.abs(away).max(-1)
