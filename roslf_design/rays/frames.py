"""Where the elements stand: rigid maps between the frames of sensor, microlens array, lens, stops and object space.

A map is a 3 x 4 block ``[R | t]`` (new = R old + t) with the trials behind: shape (3, 4, *trials). The component axes
come first so that one source of arithmetic, indexing ``map[0, 3]``, serves numpy arrays and compiled scalars alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .system import Pair, Scalar, System

Floats = NDArray[np.float64]

SENSOR, ARRAY, LENS, STOPS = 0, 1, 2, 3
"""Places in a stack of frames: sensor to MLA, MLA to lens, lens to object space, then lens to each stop; last
(-1) the flexible angular plane to the lens."""


class Pose(NamedTuple):
    """Axes (columns of R, in the system's axes) and vertex of an element."""

    axes: Floats
    """R, shape (3, 3, *trials)."""
    vertex: tuple[Scalar, Scalar, Scalar]
    """[mm]."""


def rotation(tilt: Pair, roll: Scalar = 0.0) -> Floats:
    """Axes of a tilted element.

    Parameters
    ----------
    tilt : pair
        (t_x, t_y) [rad]: the normal is z turned by t_x about x, then by t_y about the fixed y.
    roll : float or array
        Turn about the element's own normal, before the tilt [rad].

    Returns
    -------
    ndarray, shape (3, 3, *trials)
        ``R_y(t_y) R_x(t_x) R_z(roll)``; the identity, exactly, at zero.
    """
    cx, cy, cz = (np.cos(np.asarray(angle, float)) for angle in (*tilt, roll))
    sx, sy, sz = (np.sin(np.asarray(angle, float)) for angle in (*tilt, roll))
    zero = np.zeros(np.broadcast_shapes(cx.shape, cy.shape, cz.shape))
    about_x = _stack([[1 + zero, zero, zero], [zero, cx, -sx], [zero, sx, cx]])
    about_y = _stack([[cy, zero, sy], [zero, 1 + zero, zero], [-sy, zero, cy]])
    about_z = _stack([[cz, -sz, zero], [sz, cz, zero], [zero, zero, 1 + zero]])
    return _product(about_y, _product(about_x, about_z))


def poses(system: System) -> list[Pose]:
    """Poses of the sensor, the MLA, the lens, and each stop, in the order of a stack of frames."""
    lens, array, sensor = system.lens, system.array, system.sensor
    behind = np.add(array.distance, sensor.distance)
    return [
        Pose(rotation(sensor.tilt), (*sensor.decentre, behind)),
        Pose(rotation(array.tilt, array.rotation), (*array.decentre, array.distance)),
        Pose(rotation(lens.tilt), (*lens.decentre, 0.0)),
        *(Pose(rotation(stop.tilt), (*stop.decentre, np.negative(stop.distance))) for stop in system.stops),
    ]


def between(origin: Pose, target: Pose, dz: Scalar | None = None) -> Floats:
    """Map from one element's frame to another's.

    Parameters
    ----------
    origin, target : Pose
        Elements.
    dz : float or array, optional
        z of the origin's vertex less the target's, where it is known better than by subtraction [mm].

    Returns
    -------
    ndarray, shape (3, 4, *trials)
        ``[R_t^T R_o | R_t^T (v_o - v_t)]``.
    """
    back = np.swapaxes(target.axes, 0, 1)
    steps = [np.subtract(a, b) for a, b in zip(origin.vertex, target.vertex, strict=True)]
    if dz is not None:
        steps[2] = np.asarray(dz, float)
    offset = np.stack(np.broadcast_arrays(*steps))[:, None]
    parts = [_product(back, origin.axes), _product(back, offset)]
    trials = np.broadcast_shapes(*(part.shape[2:] for part in parts))
    return np.concatenate([np.broadcast_to(_padded(p, len(trials)), p.shape[:2] + trials) for p in parts], axis=1)


def frames(system: System) -> Floats:
    """Maps that a ray needs: sensor to MLA, MLA to lens, lens to object space, lens to each stop, the FAP to the lens.

    Returns
    -------
    ndarray, shape (3 + K + 1, 3, 4, *trials)
        Object space has the system's own axes and origin.
    """
    sensor, array, lens, *stops = poses(system)
    world = Pose(rotation((0.0, 0.0)), (0.0, 0.0, 0.0))
    maps = [between(sensor, array, system.sensor.distance), between(array, lens), between(lens, world)]
    maps += [*(between(lens, stop) for stop in stops), between(stops[0], lens)]
    shape = system.shape
    return np.stack([np.broadcast_to(_padded(m, len(shape)), (3, 4, *shape)) for m in maps])


def light_order(system: System) -> NDArray[np.intp]:
    """Stops in the order in which light meets their vertices: the farthest first, the FAP first among equals.

    Returns
    -------
    ndarray, shape (K, *trials)
        Indices into `System.stops`.
    """
    distances = [np.broadcast_to(np.asarray(stop.distance, float), system.shape) for stop in system.stops]
    return np.argsort(-np.stack(distances), axis=0, kind="stable")


def _padded(block: Floats, trial_axes: int) -> Floats:
    """Put missing trial axes where broadcasting wants them: behind the two component axes, in front of the others."""
    missing = trial_axes - (block.ndim - 2)
    return block.reshape(block.shape[:2] + (1,) * missing + block.shape[2:])


def _stack(rows: list[list[Floats]]) -> Floats:
    return np.stack([np.stack(np.broadcast_arrays(*row)) for row in rows])


def _product(a: Floats, b: Floats) -> Floats:
    trials = max(a.ndim, b.ndim) - 2
    product: Floats = np.einsum("ij...,jk...->ik...", _padded(a, trials), _padded(b, trials))
    return product
