"""A system's numbers laid out for the arithmetic in `kernels`: constants, stops in order, rows of trials."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .frames import Floats, light_order
from .status import Status
from .system import System

Bytes = NDArray[np.uint8]


def reach(distance: ArrayLike) -> tuple[Floats, Floats]:
    """Weights (a, b) of height l and slope o in the end point ``a l - b o``.

    Parameters
    ----------
    distance : array_like
        Z [mm]. Finite: x = l - Z o. Infinite: x/Z = -o.
    """
    z = np.asarray(distance, float)
    far = np.isinf(z)
    return np.where(far, 0.0, 1.0), np.where(far, 1.0, z)


def constants(system: System, distance: ArrayLike = 0.0) -> Floats:
    """Constants of a system, in the order that `kernels` names.

    Returns
    -------
    ndarray, shape (16, *trials)
        [mm] and [1/mm].
    """
    lens, array, sensor = system.lens, system.array, system.sensor
    share, slope = reach(distance)
    rows = [
        array.distance,
        np.divide(1.0, sensor.distance),
        np.divide(1.0, array.focal_length),
        np.divide(1.0, lens.focal_length),
        *(np.subtract(a, b) for a, b in zip(sensor.decentre, array.decentre, strict=True)),
        *(np.subtract(a, b) for a, b in zip(array.decentre, lens.decentre, strict=True)),
        *lens.decentre,
        share,
        slope,
        np.divide(lens.diameter, 2.0),
        np.divide(array.pitch, 2.0),
        float(array.lens_shape == "circular"),
        np.divide(system.stops[0].diameter, 2.0),
    ]
    shape = np.broadcast_shapes(system.shape, share.shape)
    return np.stack([np.broadcast_to(np.asarray(row, float), shape) for row in rows])


def rims(system: System) -> tuple[Floats, Bytes]:
    """Stops against the lens, the nearest first: what marks a ray last is what light meets first.

    Returns
    -------
    places : ndarray, shape (K, 4, *trials)
        Lens's decentre less the stop's (x, y), distance, radius [mm].
    codes : ndarray of uint8, shape (K, *trials)
        Their status codes.
    """
    ex, ey = system.lens.decentre
    places = [
        [
            np.subtract(ex, stop.decentre[0]),
            np.subtract(ey, stop.decentre[1]),
            stop.distance,
            np.divide(stop.diameter, 2),
        ]
        for stop in system.stops
    ]
    table = np.stack([[np.broadcast_to(np.asarray(x, float), system.shape) for x in place] for place in places])
    order = light_order(system)[::-1]
    return np.take_along_axis(table, order[:, None], axis=0), (order + int(Status.APERTURE)).astype(np.uint8)


def rows(block: NDArray[Any], components: int, leading: tuple[int, ...] | None) -> NDArray[Any]:
    """One contiguous row of constants per row of rays.

    Parameters
    ----------
    block : ndarray, shape (*components, *trials)
        The last trial axis, if there is one, has length 1 (it is the rays').
    components : int
        How many axes are not trials.
    leading : tuple of int or None
        Shape of the rays without their last axis; None where one row serves all.

    Returns
    -------
    ndarray, shape (R, *components)
    """
    if leading is None:
        return np.ascontiguousarray(block[None])
    kept, trials = block.shape[:components], block.shape[components:][:-1]
    padded = block.reshape(kept + (1,) * (len(leading) - len(trials)) + trials)
    spread = np.broadcast_to(padded, kept + leading).reshape(*kept, -1)
    return np.ascontiguousarray(np.moveaxis(spread, -1, 0))


def lines(pair: Iterable[Floats], shape: tuple[int, ...]) -> tuple[list[Floats], tuple[int, int]]:
    """The two coordinates of points as flat arrays, without repeating what one value serves.

    Parameters
    ----------
    pair : two arrays
        Broadcast to `shape`.
    shape : tuple of int
        Of the rays.

    Returns
    -------
    values : list of two ndarray, flat
    steps : (int, int)
        How far to go in them for the next row, and for the next ray of a row.
    """
    pair = [c.reshape((1,) * (len(shape) - c.ndim) + c.shape) for c in pair]
    common = np.broadcast_shapes(*(c.shape for c in pair))
    single_row, single_column = all(n == 1 for n in common[:-1]), common[-1] == 1 and shape[-1] > 1
    wanted = (common[:-1] if single_row else shape[:-1]) + ((1,) if single_column else shape[-1:])
    values = [_own(c, wanted).reshape(-1) for c in pair]
    return values, (0 if single_row else wanted[-1], 0 if single_column else 1)


def _own(values: Floats, shape: tuple[int, ...]) -> Floats:
    """Contiguous and writable, for which alone the loops are compiled; a copy only where it must be."""
    if values.shape == shape and values.flags.c_contiguous and values.flags.writeable:
        return values
    return np.array(np.broadcast_to(values, shape))
