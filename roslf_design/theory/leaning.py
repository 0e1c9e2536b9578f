"""Room that stops which lean by design, as fold mirrors do, leave pencils: met ray by ray of the pencil's rim.

A pencil goes from a point of the focal plane through the FAP's rim. Where one of its rays meets the leaning plane is
linear in the point's radius over linear, so that the radius at which it meets the stop's rim solves a quadratic; the
worst of all directions of the point and of all places on the FAP's rim is searched on a grid that closes in on it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._arrays import Array
from ..camera import Camera, Rim
from ..camera.frames import Vector, dot

COARSE, MANY = 48, 16
"""Steps of the first grid around each of both circles, for one camera and for many builds."""
CLOSER, ROUNDS = 0.55, 32
"""Share of a step that each further grid has, and how often: what is left of it counts squared, rounding."""


def leaning_room(c: Camera, rim: Rim, radius: Array, towards: Array | None = None) -> Array:
    """Room that a leaning rim leaves pencils from a radius on the focal plane, on the rim's plane [mm].

    Parameters
    ----------
    radius : ndarray
        As the main lens sees it, of the builds' shape or with further axes before it [mm].
    towards : ndarray, optional
        Directions of those places [rad]; the worst where not given.
    """

    def away(around: Array, way: Array) -> Array:
        (n_0, d_0), (n_1, d_1) = _crossing(c, rim, way, around)
        x, y, z = (a + radius * b for a, b in zip(n_0, n_1, strict=True))
        return np.asarray(-np.sqrt(x * x + y * y + z * z) / np.abs(d_0 + radius * d_1))

    shape = np.broadcast_shapes(np.shape(radius), c.shape)
    least = least_of_angles(away, shape) if towards is None else least_of_angles(lambda u: away(u, towards), shape, 1)
    return np.asarray(rim.radius + least)


def leaning_radius(c: Camera, rim: Rim) -> Array:
    """Largest radius on the focal plane whose pencil a leaning rim leaves whole whatever its direction [mm]."""

    def reach(towards: Array, around: Array) -> Array:
        (n_0, d_0), (n_1, d_1) = _crossing(c, rim, towards, around)
        square = np.square(rim.radius)
        a, b, e = (
            square * one * other - dot(first, second)
            for (first, one), (second, other) in (
                ((n_1, d_1), (n_1, d_1)), ((n_0, d_0), (n_1, d_1)), ((n_0, d_0), (n_0, d_0)),
            )
        )  # fmt: skip
        root = b * b - a * e
        bottom = np.sqrt(np.maximum(root, 0.0)) - b
        meets = (root >= 0) & (bottom > 0)
        return np.where(meets, np.maximum(e, 0.0) / np.where(meets, bottom, 1.0), np.where(e < 0, 0.0, np.inf))

    return least_of_angles(reach, c.shape)


def _crossing(c: Camera, rim: Rim, towards: Array, around: Array) -> tuple[tuple[Vector, Any], tuple[Vector, Any]]:
    """Where rays meet a rim's plane, from its middle: numerator and denominator at radius 0, and both per radius."""
    pose, (e_x, e_y), size = c.apparent_pose(rim.part), c.decentre("aperture"), c.fap.radius
    v, q = pose.origin, (e_x + size * np.cos(around), e_y + size * np.sin(around), -c.seen.d_3)
    p: Vector = np.cos(towards), np.sin(towards), 0.0
    focus: Vector = 0.0, 0.0, -c.seen.d_f
    n_q, n_v, n_p, n_f = (dot(pose.z, point) for point in (q, v, p, focus))
    x, y, z = (n_q * (f - b) + n_f * (b - a) + n_v * (a - f) for a, b, f in zip(q, v, focus, strict=True))
    u, w, h = ((n_q - n_v) * way + n_p * (b - a) for a, b, way in zip(q, v, p, strict=True))
    return ((x, y, z), n_q - n_f), ((u, w, h), -n_p)


def least_of_angles(value: Callable[..., Array], shape: tuple[int, ...], angles: int = 2) -> Array:
    """Least of a smooth function of angles for each of the builds, whose axes follow that of the angles."""
    count = MANY if shape and angles > 1 else COARSE
    step, at = 2 * np.pi / count, [np.zeros(shape)] * angles
    offsets, least = np.arange(count) * step, np.full(shape, np.inf)
    for _ in range(ROUNDS):
        grid = [part.reshape(-1, *(1,) * len(shape)) for part in np.meshgrid(*[offsets] * angles, indexing="ij")]
        values = np.broadcast_to(value(*map(np.add, at, grid)), (grid[0].size, *shape))
        best = np.argmin(np.where(np.isnan(values), np.inf, values), axis=0)
        least = np.take_along_axis(values, best[None], 0)[0]
        at = [one + part.ravel()[best] for one, part in zip(at, grid, strict=True)]
        step *= CLOSER
        offsets = step * np.array([-1.0, 0.0, 1.0])
    return np.asarray(least)
