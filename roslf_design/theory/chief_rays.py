"""Chief rays in front of the bore: from microlenses through the FAP's centre, by Snell's law past all that bends them.

In air the closed forms are exact. Through elements every ray is traced, and where some stand between main lens and FAP
aimed at its centre first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, product, ratio
from ..camera import Camera, Number
from ..lenses.angles import STEEPEST
from .object_space import ObjectSpaceFaces

Place = tuple[Number, Number]
Places = tuple[Array, Array]

STEPS = 30
"""Towards the FAP's centre, by Broyden's method from first order: four to six where plates stand before it."""
SETTLED = 1e-12
"""Part of the FAP's radius by which a ray may miss its centre; `STRAY` where it comes no nearer."""
STRAY = 1e-8
TOGETHER = 4096
"""Builds whose faces are held at once."""


class ChiefRays(NamedTuple):
    """Straight lines in the medium of the scene, against the system's axis."""

    height: Places
    """Points where the rays, prolonged, meet z = 0, x and y [mm]."""
    slope: Places
    """dx/dz and dy/dz; `STEEPEST` at most."""

    def on_plane(self, distance: Number) -> Places:
        """Points where the rays meet a plane, its distance before the main lens [mm]; infinite of rays along it."""
        x, y = (
            np.where(np.abs(slope) < STEEPEST / 2, height - slope * distance, np.copysign(np.inf, -slope))[()]
            for height, slope in zip(self.height, self.slope, strict=True)
        )
        return x, y

    @property
    def directions(self) -> Array:
        """Unit vectors away from the bore, shape (..., 3), the axis last."""
        x, y = self.slope
        along = 1 / np.hypot(1.0, np.hypot(x, y))
        return np.stack(np.broadcast_arrays(-x * along, -y * along, along), axis=-1)


def outer_slopes(c: Camera, place: Place) -> Place:
    """Index times slope, to first order, of a microlens's chief ray in front of the bore, along x and y.

    Parameters
    ----------
    c : Camera
        Its tilts but those of elements are left out.
    place : pair of float or ndarray
        The microlens, from the main lens's axis [mm].
    """
    front = c.front[1]
    x, y = (
        front.d * slope - front.c * height + lean
        for height, slope, lean in zip(*_at_main_lens(c, place), front.axis_slope, strict=True)
    )
    return x, y


def chief_rays(c: Camera, place: Place) -> ChiefRays:
    """Chief rays of microlenses.

    Those that elements lose (by total reflection, or beyond what an objective maps) are what first order says.

    Parameters
    ----------
    c : Camera
        Its tilts but those of elements are left out.
    place : pair of float or ndarray
        The microlenses, from the main lens's axis [mm]; they broadcast with the builds.
    """
    first = _to_first_order(c, place)
    if not c.in_bore:
        return first
    shape = np.broadcast_shapes(*map(np.shape, place), c.shape)
    at = np.stack([np.broadcast_to(part, shape) for part in place])
    if not c.shape:
        key = at.tobytes()
        if key not in c.worked_out:
            c.worked_out[key] = _past_elements(c, at.reshape(2, -1))
        rays = c.worked_out[key]
    else:
        builds = shape[len(shape) - len(c.shape) :]
        at = at.reshape(2, -1, math.prod(builds))
        rays = np.empty((4, *at.shape[1:]))
        for alike in _alike(c, builds):
            for part in np.split(alike, range(TOGETHER, len(alike), TOGETHER)):
                some = c if builds == c.shape == part.shape else c.in_row(builds, part)
                rays[..., part] = _past_elements(some, at[..., part])
    rays = rays.reshape(4, *shape)
    lost, straight = np.isnan(rays).any(0), (*first.height, *first.slope)
    x, y, slope_x, slope_y = (np.where(lost, one, ray)[()] for one, ray in zip(straight, rays, strict=True))
    return ChiefRays((x, y), (slope_x, slope_y))


def _alike(c: Camera, shape: tuple[int, ...]) -> list[NDArray[np.intp]]:
    """Builds in a row, broadcast to a shape, by the order in which stops and elements stand: of one order together.

    A stop comes before an element that begins where it stands, as in `ObjectSpaceFaces.of`.
    """
    starts = [*(rim.ruler_distance for rim in c.stop_openings), *(part.start for part in c.in_bore)]
    orders = np.argsort([np.broadcast_to(start, shape).ravel() for start in starts], axis=0, kind="stable")
    _, which = np.unique(orders, axis=1, return_inverse=True)
    return [np.flatnonzero(which == k) for k in range(which.max(initial=-1) + 1)]


def _at_main_lens(c: Camera, place: Place) -> tuple[Place, Place]:
    """Heights from the main lens's centre and slopes just before it, to first order."""
    slopes = [
        ratio(e + product(at, c.seen.inverse_m), c.seen.gap)
        for at, e in zip(place, c.decentre("aperture"), strict=True)
    ]
    heights = [e + slope * c.seen.d_3 for slope, e in zip(slopes, c.decentre("aperture"), strict=True)]
    return (heights[0], heights[1]), (slopes[0], slopes[1])


def _to_first_order(c: Camera, place: Place) -> ChiefRays:
    """All rays to first order; of an objective with a mapping, as that sends them on from the entrance pupil."""
    (end, front), slopes = c.front, outer_slopes(c, place)
    rays = []
    for height, before, p, aside, centre in zip(
        *_at_main_lens(c, place), slopes, front.axis_offset, c.lens_centre, strict=True
    ):
        slope = p / front.medium
        rays.append((front.a * height - front.b * before + aside + centre + slope * end, slope))
    straight = [tuple(map(np.asarray, ray)) for ray in rays]

    def grown() -> Array:
        steep = np.hypot(*slopes)  # beyond what is imaged the end of that
        return np.minimum(c.sagittal_stretch(steep), STEEPEST) * np.minimum(1.0, ratio(c.mapping.end, steep))

    (x, slope_x), (y, slope_y) = c.mapping.redrawn(straight, grown, lambda: c.entrance_pupil_distance)
    return ChiefRays((x, y), (slope_x, slope_y))


@np.errstate(all="ignore")  # of builds that are no cameras
def _past_elements(c: Camera, at: Array) -> Array:
    """Height and slope of exact rays in front of the bore, (4, n) or (4, n, builds); nan where they are lost.

    `at` are the microlenses, (2, n) or (2, n, builds).
    """
    near, far = ObjectSpaceFaces.unclipped(c).bending
    places = c.lens_centre, _centre(c), _at_main_lens(c, (at[0], at[1]))[0]
    lens, fap, height = (np.stack([np.broadcast_to(part, at.shape[1:]) for part in pair]) for pair in places)

    def passed(faces: ObjectSpaceFaces, height: Array, slope: Array) -> tuple[Array, Array]:
        if not len(faces.names):
            return height, slope
        rays = faces.rays((height[0], height[1]), (slope[0], slope[1]))
        height, slope = (np.where(rays.status, np.nan, part) for part in rays[:2])
        return height, slope

    def to_fap(height: Array) -> tuple[Array, Array, Array]:
        """Rays of the microlens there, and by how much they miss the FAP's centre."""
        met, slope = passed(near, height + lens, ratio(at, c.seen.d_1) + ratio(height, c.seen.d_f))
        return met, slope, met - slope * c["aperture.distance"] - fap

    met, slope, miss = to_fap(height)
    if len(near.names):
        plane, size = c.plane(c["aperture.distance"]), c.fap.radius * c.fap.scale
        # dh/dx of rays through the microlens, x where they meet the FAP: to first order, then by Broyden's method; in
        # numpy, as the aimer of `traced.train` is compiled, whose loading takes longer than all of `evaluate`.
        rate = np.zeros((2, *at.shape)) + ratio(1.0, plane.a - plane.b / c.seen.d_f)
        rate[0, 1], rate[1, 0] = 0.0, 0.0
        for _ in range(STEPS):
            away = np.hypot(*miss) > SETTLED * size
            if not away.any():
                break
            step = np.where(away, -np.sum(rate * miss, axis=1), 0.0)
            height, before = height + step, miss
            met, slope, miss = to_fap(height)
            turned = np.sum(rate * (miss - before), axis=1)
            along, turn = np.sum(rate * step[:, None], axis=0), np.sum(step * turned, axis=0)
            rate = rate + (step - turned)[:, None] * np.where(turn == 0, 0.0, ratio(along, turn))
        met = np.where(np.hypot(*miss) < STRAY * size, met, np.nan)
    return np.concatenate(passed(far, met, slope))


def _centre(c: Camera) -> Place:
    """The FAP's, from the system's axis, with a ruler [mm]."""
    return c["aperture.decentre.0"], c["aperture.decentre.1"]
