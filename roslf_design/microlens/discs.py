"""Common part of K discs: the shape of a microlens image, as its stops cut it out of the pupil's disc."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arcs, _shapes

Array = NDArray[np.float64]

INTERPRETED_BELOW = 4096
"""Shapes (times discs) up to which compiling, or even loading compiled code, takes longer than it saves."""

LARGEST = 1e70
"""Lengths [mm] beyond which squares of areas overflow."""


class ClipStatus(IntEnum):
    """What is left of disc 0."""

    EMPTY = _shapes.EMPTY
    CLIPPED = _shapes.CLIPPED
    FULL = _shapes.FULL


class DiscIntersection(NamedTuple):
    """Shapes of the common parts of discs; leading axes are those of the input. Never NaN: see `lit`."""

    area: Array
    """Area [mm^2], shape (...)."""
    centroid: Array
    """Centroid [mm], shape (..., 2), in the coordinates of the centres; of an empty part, the centre of disc 0."""
    second_moments: Array
    """Central second moments per unit area, (xx, xy, yy) [mm^2], shape (..., 3): the covariance of a point drawn evenly
    from the part. 0 for an empty part; r^2/4, 0, r^2/4 for a disc."""
    kept_fraction: Array
    """Area over that of disc 0, shape (...)."""
    lost_fraction: Array
    """1 - kept_fraction, shape (...), right relative to itself: where little is lost, it is what was computed."""
    status: NDArray[np.int8]
    """`ClipStatus`, shape (...): is disc 0 whole (FULL), cut (CLIPPED) or gone (EMPTY)."""
    clipping: NDArray[np.bool_]
    """Shape (..., K): which discs other than 0 cut. Those whose circle bounds the part or, where that is empty, a pair
    without a common point, or all that bound the empty part together."""

    @property
    def lit(self) -> NDArray[np.bool_]:
        """Whether there is any common part at all, shape (...)."""
        return np.asarray(self.status != ClipStatus.EMPTY)

    @property
    def axis_ratio(self) -> Array:
        """Minor over major axis of the ellipse with the same second moments, shape (...): 1 for a disc, 0 if empty."""
        xx, xy, yy = np.moveaxis(self.second_moments, -1, 0)
        major = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        # Product of the eigenvalues over the larger one: the smaller one without a difference of eigenvalues.
        minor = np.divide(xx * yy - xy * xy, major, out=np.zeros_like(major), where=major > 0)
        return np.asarray(np.sqrt(np.divide(np.maximum(minor, 0.0), major, out=np.zeros_like(major), where=major > 0)))

    @property
    def orientation(self) -> Array:
        """Direction of the major axis from +x [rad], in (-pi/2, pi/2], shape (...); 0 where the axes are equal."""
        xx, xy, yy = np.moveaxis(self.second_moments, -1, 0)
        return np.asarray(0.5 * np.arctan2(2 * xy, xx - yy))


class Arc(NamedTuple):
    """Piece of a circle, counterclockwise."""

    disc: int
    """Index of the disc whose circle it is on."""
    start: float
    """Angle about that disc's centre [rad], in [0, 2 pi)."""
    end: float
    """[rad], above `start` by at most 2 pi."""


def intersect(centres: ArrayLike, radii: ArrayLike) -> DiscIntersection:
    """Area, centroid, moments and losses of the common part of K discs, in batches.

    Parameters
    ----------
    centres : array_like
        Centres [mm], shape (..., K, 2). Disc 0 is the reference: for a microlens image the flexible angular plane
        (FAP), so that `kept_fraction` is 1 when the image is undistorted.
    radii : array_like
        Radii [mm], shape (..., K), broadcast against the centres' leading axes. 0 (or below 1e-70) is empty.

    Returns
    -------
    DiscIntersection

    Raises
    ------
    ValueError
        Shapes that do not fit, a negative radius, a number that is not finite or beyond 1e70.

    Notes
    -----
    For the numbers exactly as given, whatever their distance from tangency or containment: with one or two discs that
    count (those around another do not), areas, lost fractions and moments are right to about 2e-15 of themselves.
    With more, areas to about 1e-15 of the smallest disc's where radii lie within a factor of ten, and lost fractions to
    about 1e-15 divided by the angle [rad] that a notch takes of disc 0's rim: 1e-11 for a loss of 1e-12.
    """
    centre, radius = checked(centres, radii)
    lead, k = radius.shape[:-1], radius.shape[-1]
    n = math.prod(lead)
    area, kept, lost = np.empty(n), np.empty(n), np.empty(n)
    centroid, moments = np.empty((n, 2)), np.empty((n, 3))
    status, clipping = np.empty(n, np.int8), np.empty((n, k), np.bool_)
    run = _shapes.shapes.interpreted if n * k < INTERPRETED_BELOW else _shapes.shapes.compiled
    run(centre.reshape(n, k, 2), radius.reshape(n, k), area, centroid, moments, kept, lost, status, clipping)
    return DiscIntersection(
        area.reshape(lead),
        centroid.reshape(*lead, 2),
        moments.reshape(*lead, 3),
        kept.reshape(lead),
        lost.reshape(lead),
        status.reshape(lead),
        clipping.reshape(*lead, k),
    )


def boundary_arcs(centres: ArrayLike, radii: ArrayLike) -> tuple[Arc, ...]:
    """Boundary of one common part, counterclockwise: one arc of a whole turn for a full disc, () if empty.

    Parameters
    ----------
    centres, radii : array_like
        Shapes (K, 2) and (K,) [mm].
    """
    centre, radius = checked(centres, radii)
    if radius.ndim != 1:
        raise ValueError(f"boundary_arcs takes one shape, radii of shape (K,), not {radius.shape}: call it for each")
    k = len(radius)
    discs, arcs = np.column_stack([centre, radius, np.empty(k)]), np.empty((k * k, 3))
    count = _arcs.trace.interpreted(discs, np.empty((k, 2)), arcs)
    return tuple(Arc(int(disc), float(start), float(end)) for start, end, disc in arcs[:count])


def outline(centres: ArrayLike, radii: ArrayLike, step: float = math.pi / 90) -> Array:
    """Points along the boundary of one common part, for drawing: shape (N, 2) [mm], counterclockwise, not closed.

    Parameters
    ----------
    centres, radii : array_like
        Shapes (K, 2) and (K,) [mm].
    step : float
        Largest angle between neighbouring points of an arc [rad].
    """
    if not step > 0:
        raise ValueError(f"step must be above 0 rad, not {step}")
    centre, radius = np.asarray(centres, float), np.asarray(radii, float)
    points = [np.empty((0, 2))]
    for arc in boundary_arcs(centres, radii):
        angles = np.linspace(arc.start, arc.end, math.ceil((arc.end - arc.start) / step) + 1)[:-1]
        points.append(centre[arc.disc] + radius[arc.disc] * np.stack([np.cos(angles), np.sin(angles)], -1))
    return np.concatenate(points)


def checked(centres: ArrayLike, radii: ArrayLike) -> tuple[Array, Array]:
    """Centres (..., K, 2) and radii (..., K) of the same leading shape, contiguous; errors as `intersect`."""
    centre, radius = np.asarray(centres, float), np.asarray(radii, float)
    if centre.ndim < 2 or centre.shape[-1] != 2:
        raise ValueError(f"centres must have shape (..., K, 2), not {centre.shape}")
    if radius.ndim < 1:
        raise ValueError("radii must have shape (..., K): one for each disc")
    try:
        shape = np.broadcast_shapes(centre.shape[:-1], radius.shape)
    except ValueError:
        raise ValueError(f"centres of shape {centre.shape} and radii of shape {radius.shape} do not fit") from None
    if shape[-1] == 0:
        raise ValueError("there must be at least one disc")
    if not all(v.min(initial=0.0) >= -LARGEST and v.max(initial=0.0) <= LARGEST for v in (centre, radius)):
        raise ValueError(f"centres and radii must be numbers up to {LARGEST:g}: leave out a stop that never clips")
    if radius.min(initial=0.0) < 0:
        raise ValueError(f"radii must not be negative, smallest given: {radius.min()}")
    return (
        np.ascontiguousarray(np.broadcast_to(centre, (*shape, 2))),
        np.ascontiguousarray(np.broadcast_to(radius, shape)),
    )
