"""Rays in the meridional plane y = 0, as 2 x 2 ray matrices: cheap, for diagrams and as a check on the 3D engine.

A ray is (height, slope). Backward, the sensor's gap, the microlens, d_1 and the main lens each multiply it. Fractions
of such rays are shares of a line across the pupil, not of its disc.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .clipping import Bytes, verdict
from .constants import reach
from .frames import Floats, light_order
from .status import Status
from .system import Scalar, Stop, System


class MeridionalRays(NamedTuple):
    """Rays of the meridional plane in object space, and their fate."""

    status: Bytes
    """`Status` codes."""
    height: Floats
    """l, on the main lens [mm], against the axis."""
    slope: Floats
    """o, dx/dz in object space."""

    def at(self, distance: ArrayLike) -> Floats:
        """Heights x at object distances Z [mm] from the lens; for Z = inf, x/Z."""
        share, z = reach(distance)
        return self.height * share - self.slope * z


class Section(NamedTuple):
    """Cut of a microlens image by the meridional plane: what each opening alone would let through."""

    lower: Floats
    """Lower edges on the sensor [mm]; shape (..., K + 1): the stops, then the main lens."""
    upper: Floats
    """Upper edges. An opening that passes the whole line has -inf and inf, one that passes nothing inf and -inf."""

    @property
    def edges(self) -> tuple[Floats, Floats]:
        """Lower and upper edge of the image, all openings together; lower > upper where it is dark."""
        return self.lower.max(axis=-1), self.upper.min(axis=-1)

    @property
    def kept_fraction(self) -> Floats:
        """Share of the line through the flexible angular plane's image that the other openings leave."""
        lower, upper = self.edges
        return np.maximum(upper - lower, 0.0) / (self.upper - self.lower)[..., 0]


def trace_meridional(
    system: System, sensor: ArrayLike, microlens: ArrayLike, offset: ArrayLike = 0.0
) -> MeridionalRays:
    """Trace sensor points back into object space, within the plane y = 0.

    Parameters
    ----------
    system : System
        Without tilt or rotation, nothing but stops decentred in y.
    sensor, microlens, offset : array_like
        p, c and w - c [mm], broadcast.

    Returns
    -------
    MeridionalRays
        Statuses as `backward.trace` gives them for the same points at y = 0.

    Raises
    ------
    ValueError
        A system whose rays leave the plane.
    """
    height, slope = _object_side(system, sensor, microlens, offset)
    lens, v = system.lens, np.asarray(offset, float)
    shape = np.broadcast_shapes(height.shape, v.shape, system.shape)
    marks = [
        (np.abs(v) > np.divide(system.array.pitch, 2), int(Status.MICROLENS)),
        (np.abs(height - lens.decentre[0]) > np.divide(lens.diameter, 2), int(Status.MAIN_LENS)),
    ]
    chords = [_chord(stop) for stop in system.stops]
    for index in light_order(system)[::-1]:
        for k, (stop, half) in enumerate(zip(system.stops, chords, strict=True)):
            with np.errstate(over="ignore", invalid="ignore"):
                passed = np.abs(height - slope * stop.distance - stop.decentre[0]) <= half
            marks.append((~passed & (index == k), int(Status.APERTURE) + k))
    marks.append((~np.isfinite(height + slope), int(Status.UNTRACEABLE)))
    status = verdict(shape, marks)
    lit = status != Status.UNTRACEABLE
    return MeridionalRays(status, np.where(lit, height, 0.0), np.where(lit, slope, 0.0))


def image_section(system: System, microlens: ArrayLike) -> Section:
    """Edges of pinhole microlens images in the meridional plane, found by two rays an opening.

    Parameters
    ----------
    system : System
        As in `trace_meridional`.
    microlens : array_like
        c [mm]; broadcasts with the trials.

    Returns
    -------
    Section
        Aligned, a stop at z reaches from c (1 + d_2/d_1 - h z d_2/d_1^2) by (D_k/2) h d_2/d_1, h = d_f/(d_f - z).
    """
    # Heights are affine in the sensor's coordinate: one ray through each microlens fixes where they start, and one of
    # slope 1 through the axis, free of the field's large numbers, how they grow.
    c, step = np.asarray(microlens, float), np.asarray(system.sensor.distance, float)
    height, slope = _object_side(system, c, c, 0.0)
    d_1 = np.asarray(system.array.distance, float)
    growth = -d_1, 1.0 - d_1 / system.lens.focal_length
    lower, upper = [], []
    for distance, centre, half in _openings(system):
        low, high = _interval(height - slope * distance - centre, growth[0] - growth[1] * distance, half)
        lower.append(c + low * step)
        upper.append(c + high * step)
    return Section(np.stack(np.broadcast_arrays(*lower), -1), np.stack(np.broadcast_arrays(*upper), -1))


def _object_side(system: System, sensor: ArrayLike, microlens: ArrayLike, offset: ArrayLike) -> tuple[Floats, Floats]:
    """Height and slope of backward rays in front of the main lens."""
    parts = (system.lens, system.array, system.sensor)
    if not system.aligned or any(np.any(part.decentre[1]) for part in parts):
        raise ValueError("rays leave the meridional plane: a part is tilted, rotated or decentred in y; trace in 3D")
    lens, array, plane = system.lens, system.array, system.sensor
    c, v = np.asarray(microlens, float), np.asarray(offset, float)
    gap = (np.asarray(sensor, float) - c + np.subtract(plane.decentre[0], array.decentre[0])) - v
    with np.errstate(over="ignore", invalid="ignore"):
        slope = gap / plane.distance + v / array.focal_length
        height = (c + v + array.decentre[0]) - slope * array.distance
        return height, slope + (height - lens.decentre[0]) / lens.focal_length


def _openings(system: System) -> list[tuple[Scalar, Scalar, Floats]]:
    """Distance, centre and half chord of the stops and the main lens."""
    stops = [(stop.distance, stop.decentre[0], _chord(stop)) for stop in system.stops]
    return [*stops, (0.0, system.lens.decentre[0], np.asarray(np.divide(system.lens.diameter, 2)))]


def _chord(stop: Stop) -> Floats:
    """Half of what the plane y = 0 cuts from a stop's disc; negative where it misses it."""
    radius, y = np.divide(stop.diameter, 2), np.abs(stop.decentre[1])
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(y <= radius, np.sqrt(np.maximum((radius - y) * (radius + y), 0.0)), -1.0))


def _interval(start: Floats, rate: Floats, half: Floats) -> tuple[Floats, Floats]:
    """Where a line of heights lies within +-half: all of it or nothing where it does not rise."""
    level, open_ = rate == 0, half >= 0
    safe = np.where(level, 1.0, rate)
    with np.errstate(over="ignore", invalid="ignore"):
        a, b = (-half - start) / safe, (half - start) / safe
    passes = np.where(level, np.abs(start) <= half, False)
    low = np.where(level, np.where(passes, -np.inf, np.inf), np.minimum(a, b))
    high = np.where(level, np.where(passes, np.inf, -np.inf), np.maximum(a, b))
    return np.where(open_, low, np.inf), np.where(open_, high, -np.inf)
