"""Forward rays: from a point of the flexible angular plane through one microlens to the sensor, and where they land."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import kernels as kn
from .backward import Point
from .clipping import Bytes, Mark, finite, outside, stop_marks, verdict
from .constants import constants, reach
from .frames import LENS, Floats, frames
from .status import Status
from .system import System


class PupilRays(NamedTuple):
    """Rays through the pupil: their fate, where they land, and their course in object space."""

    status: Bytes
    """`Status` codes."""
    sensor: tuple[Floats, Floats]
    """(x, y) in the sensor's frame [mm]."""
    height: tuple[Floats, Floats]
    """(x, y) where the object-side ray, prolonged, meets the plane z = 0 [mm]."""
    slope: tuple[Floats, Floats]
    """dx/dz and dy/dz in object space."""
    taken: tuple[Mark, ...]
    """What the main lens, then each stop, would take by itself, with the status that tells of it."""

    def at(self, distance: ArrayLike) -> tuple[Floats, Floats]:
        """Points at object distances Z [mm] from the lens; for Z = inf, x/Z and y/Z."""
        share, z = reach(distance)
        return self.height[0] * share - self.slope[0] * z, self.height[1] * share - self.slope[1] * z


def trace_pupil(system: System, pupil: Point, microlens: Point, offset: Point = (0.0, 0.0)) -> PupilRays:
    """Trace points of the pupil through a microlens to the sensor.

    Parameters
    ----------
    system : System
        Its trials broadcast with the points.
    pupil : pair of array_like
        Point of the flexible angular plane (FAP), in its frame and in units of its radius; beyond 1 it is clipped.
    microlens, offset : pair of array_like
        c and w - c, in the MLA's frame [mm].

    Returns
    -------
    PupilRays
        Broadcast shape; untraceable rays hold zeros. A FAP at d_3 = d_f, whose image lies on the MLA, has no such rays.

    Notes
    -----
    A ray that passes everything is kept where it lands in its microlens's own cell, a square of one microlens-image
    pitch about the image's chief ray (hexagonal: the lattice's own cell); else it is off the sensor or a neighbour's.
    """
    points = [np.asarray(c, float) for pair in (pupil, microlens, offset) for c in pair]
    k, maps = constants(system), frames(system)
    shape = np.broadcast_shapes(system.shape, *(c.shape for c in points))
    ax, ay, cx, cy, vx, vy = points
    with np.errstate(all="ignore"):
        radius = k[kn.PUPIL_RADIUS]
        px, py, lx, ly, ox, oy, good = kn.pupil_ray(k, maps, maps[-1], ax * radius, ay * radius, cx, cy, vx, vy)
        hx, hy, sx, sy, front = kn.crossing(maps[LENS], lx, ly, ox, oy)
        half = [np.divide(side, 2.0) for side in system.sensor.size]
        stops, forward = stop_marks(system, maps, (lx, ly, ox, oy), filled=ax * ax + ay * ay <= 1.0)
        good = good & front & forward & finite(lx, ly, px, py)
        own = kn.own_cell(cells(system, microlens), is_hexagonal(system), px, py)
        taken: tuple[Mark, ...] = ((outside(lx, ly, k[kn.LENS_RADIUS]), Status.MAIN_LENS), *stops)
        marks: list[Mark] = [
            (~own, Status.NEIGHBOUR),
            (~((abs(px) <= half[0]) & (abs(py) <= half[1])), Status.OFF_SENSOR),
            (~kn.in_microlens(k, vx, vy), Status.MICROLENS),
            *taken,
            (~good, Status.UNTRACEABLE),
        ]
    status = verdict(shape, marks)
    lit = status != Status.UNTRACEABLE
    sensor, height, slope = ((np.where(lit, x, 0.0), np.where(lit, y, 0.0)) for x, y in ((px, py), (hx, hy), (sx, sy)))
    return PupilRays(status, sensor, height, slope, taken)


def cells(system: System, microlens: Point) -> Floats:
    """Cells of microlens images on the sensor.

    Parameters
    ----------
    system : System
        Its trials broadcast with the microlenses.
    microlens : pair of array_like
        c, in the MLA's frame [mm].

    Returns
    -------
    ndarray, shape (6, *broadcast)
        Chief ray's landing point (x, y) [mm]; then the map from offsets to lattice units, row by row [1/mm]: half the
        steps between the chief rays of the neighbours one pitch to either side along the MLA's x and y, inverted.
        Not finite where the chief rays are not.
    """
    k, maps, d = constants(system), frames(system), np.asarray(system.array.pitch, float)

    def landing(dx: float, dy: float) -> tuple[Floats, Floats]:
        x, y = np.add(microlens[0], dx * d), np.add(microlens[1], dy * d)
        px, py, *_ = kn.pupil_ray(k, maps, maps[-1], 0.0, 0.0, x, y, 0.0, 0.0)
        return px, py

    with np.errstate(all="ignore"):
        (ax, ay), (bx, by) = landing(1, 0), landing(-1, 0)
        (cx, cy), (dx, dy) = landing(0, 1), landing(0, -1)
        xx, yx, xy, yy = (ax - bx) / 2, (ay - by) / 2, (cx - dx) / 2, (cy - dy) / 2
        area = xx * yy - xy * yx
        inverse = (yy / area, -xy / area, -yx / area, xx / area)
        return np.stack(np.broadcast_arrays(*landing(0, 0), *inverse))


def is_hexagonal(system: System) -> float:
    """1 for a hexagonal lattice, 0 for a square one."""
    return float(system.array.layout == "hexagonal")
