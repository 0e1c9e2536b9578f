"""The ray budget: of the light that fills the pupil, as a microlens sees it, who takes what and where it lands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import THREADS
from . import kernels as kn
from .backward import Point
from .constants import constants, rims, rows
from .forward import cells, is_hexagonal, trace_pupil
from .frames import Floats, frames, light_order
from .sampling import pupil_samples
from .status import Status
from .system import Part, System

Counts = NDArray[np.int64]

COMPILE_FROM = 4_000_000
"""Rays from which the compiled count is worth starting numba; below, the same arithmetic runs in numpy."""
CHUNK = 60_000
"""Rays that numpy traces at once, to bound memory."""
PART = 65_536
"""Rays that one task of the compiled count takes at most."""


class Fraction(NamedTuple):
    """A share of the rays."""

    value: Floats
    """Counted rays over all rays."""
    error: Floats
    """Standard error, were the samples random: sqrt((n + 1)(N - n + 1)/(N + 3))/(N + 2), the spread of the share given
    the count. Never 0, for no count proves a share of 0 or 1; even samples do better."""


@dataclass(frozen=True, eq=False)
class RayBudget(Part):
    """Counts of rays, per trial and field; every ray is in exactly one, so they add up to `rays`."""

    rays: int
    """N, rays per field: samples of the flexible angular plane (FAP)."""
    stops: Counts
    """Taken by each stop, the FAP first; shape (..., K). The FAP takes none: it is what the rays fill."""
    main_lens: Counts
    """Taken by the main lens."""
    untraceable: Counts
    """That no light travels, see `Status.UNTRACEABLE`."""
    off_sensor: Counts
    """That passed everything and missed the sensor."""
    neighbours: Counts
    """That reached the sensor in a neighbour's cell."""
    own_cell: Counts
    """That reached the sensor in the microlens's own cell."""
    order: NDArray[np.intp]
    """Stops as light meets them, shape (..., K)."""

    def fraction(self, counts: NDArray[Any]) -> Fraction:
        """Counts as shares of all rays."""
        n, total = np.asarray(counts, float), float(self.rays)
        return Fraction(n / total, np.sqrt((n + 1) * (total - n + 1) / (total + 3)) / (total + 2))

    @property
    def past_stops(self) -> Counts:
        """Rays that are still there behind each stop, in the order of `stops`; shape (..., K)."""
        order = np.broadcast_to(self.order, self.stops.shape)
        taken = np.cumsum(np.take_along_axis(self.stops, order, axis=-1), axis=-1)
        past = np.empty_like(self.stops)
        np.put_along_axis(past, order, self.rays - self.untraceable[..., None] - taken, axis=-1)
        return past

    @property
    def past_main_lens(self) -> Counts:
        """Rays that are still there behind the main lens."""
        return self.on_sensor + self.off_sensor

    @property
    def on_sensor(self) -> Counts:
        """Rays that reach the sensor."""
        return self.own_cell + self.neighbours

    def as_dict(self, index: int | tuple[int, ...] = ()) -> dict[str, Any]:
        """Fractions of one field, as they are published.

        Parameters
        ----------
        index : int or tuple of int
            Of the trial and field.

        Returns
        -------
        dict
            ``fap``, ``stops`` (one entry each, where there are any), ``main_lens``: still there behind it; then
            ``own_cell``; ``rays`` they rest on, and the ``standard_error`` of ``own_cell``.
        """
        past = self.past_stops[index]
        stops = {"stops": [float(n) / self.rays for n in past[1:]]} if len(past) > 1 else {}
        own = self.fraction(self.own_cell[index])
        return {
            "fap": float(past[0]) / self.rays,
            **stops,
            "main_lens": float(self.past_main_lens[index]) / self.rays,
            "own_cell": float(own.value),
            "rays": self.rays,
            "standard_error": float(own.error),
        }


def ray_budget(
    system: System,
    microlens: Point,
    *,
    rays: int = 65_536,
    finite_microlens: bool = False,
    seed: int | None = None,
    compiled: bool | None = None,
) -> RayBudget:
    """Send rays from all over the pupil through microlenses and count their fates.

    Parameters
    ----------
    system : System
        Its trials broadcast with the fields; `System.spread` makes room behind them.
    microlens : pair of array_like
        Fields: the microlenses' axes c, in the MLA's frame [mm].
    rays : int, optional
        N per field, spread evenly over the flexible angular plane (FAP) as a disc in its own frame.
    finite_microlens : bool, optional
        Spread them over the microlens's clear aperture as well; else it is a pinhole.
    seed : int, optional
        Shifts the samples at random, for independent repeats; None takes a fixed set.
    compiled : bool, optional
        Force the compiled or the numpy way; they count alike. None chooses by size.

    Returns
    -------
    RayBudget

    Raises
    ------
    ValueError
        `rays` below 1.
    """
    if rays < 1:
        raise ValueError(f"rays: {rays} given; a budget rests on at least 1")
    x, y = (np.asarray(c, float) for c in microlens)
    shape = np.broadcast_shapes(system.shape, x.shape, y.shape)
    samples = pupil_samples(rays, microlens=system.array.lens_shape if finite_microlens else None, seed=seed)
    if compiled is None:
        compiled = int(np.prod(shape)) * rays >= COMPILE_FROM
    count = _compiled_counts if compiled else _counts
    table = count(system, x, y, shape, samples).reshape(*shape, -1)
    columns = {name: table[..., code] for name, code in _COLUMNS.items()}
    order = np.moveaxis(light_order(system), 0, -1)
    return RayBudget(rays=rays, stops=table[..., kn.COLUMNS :], order=order, **columns)


_COLUMNS = {
    "own_cell": Status.KEPT,
    "main_lens": Status.MAIN_LENS,
    "off_sensor": Status.OFF_SENSOR,
    "neighbours": Status.NEIGHBOUR,
    "untraceable": Status.UNTRACEABLE,
}


def _counts(system: System, x: Floats, y: Floats, shape: tuple[int, ...], samples: Floats) -> Counts:
    """Fates of every field by numpy, a chunk of samples after the other; shape (fields, columns)."""
    fields, width = int(np.prod(shape)), kn.COLUMNS + len(system.stops)
    table = np.zeros((fields, width), np.int64)
    spread, half = system.spread(1), np.asarray(np.divide(system.array.pitch, 2.0))[..., None]
    step = max(1, CHUNK // max(fields, 1))
    for start in range(0, samples.shape[1], step):
        ax, ay, vx, vy = samples[:, start : start + step]
        status = trace_pupil(spread, (ax, ay), (x[..., None], y[..., None]), (vx * half, vy * half)).status
        column = np.broadcast_to(status, (*shape, ax.size)).reshape(fields, -1).astype(np.intp)
        column = np.where(column < Status.APERTURE, column, column - int(Status.APERTURE) + kn.COLUMNS)
        place = column + width * np.arange(fields)[:, None]
        table += np.bincount(place.reshape(-1), minlength=table.size).reshape(table.shape)
    return table


def _compiled_counts(system: System, x: Floats, y: Floats, shape: tuple[int, ...], samples: Floats) -> Counts:
    """Fates of every field by the compiled loop; shape (fields, columns)."""
    fields, width = int(np.prod(shape)), kn.COLUMNS + len(system.stops)
    leading = shape if system.shape else None
    spread = system.spread(1)
    places, codes = rims(spread)
    k, maps = rows(constants(spread), 1, leading), rows(frames(spread), 3, leading)
    place_rows, code_rows = rows(places, 2, leading), rows(codes, 1, leading)
    half = (np.divide(side, 2.0) for side in system.sensor.size)
    cell = np.stack([np.broadcast_to(v, shape) for v in (*cells(system, (x, y)), *half, x, y)]).reshape(10, fields)
    counts = np.zeros((fields, -(-samples.shape[1] // PART), width), np.int64)
    with THREADS:
        kn.pupil_ledger.compiled(
            k,
            maps,
            place_rows,
            code_rows,
            int(leading is not None),
            np.ascontiguousarray(cell.T),
            is_hexagonal(system),
            samples,
            counts,
        )
    total: Counts = counts.sum(axis=1)
    return total
