"""Exact rays through a prescription, either way, each with what became of it."""

from __future__ import annotations

import math
import sys
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import kernels
from .kernels import ASPHERE, BLOCK, COLUMNS, CONIC, ROWS, SPHERE, trace_rays
from .perturb import axis_of
from .prescription import Prescription, Surface

Array = NDArray[np.float64]

CALL_ABOVE, LOAD_ABOVE, IMPORT_ABOVE = 5, 20_000, 50_000
"""Ray-surface meetings from which the compiled kernel pays: of one call where it is loaded, else of all calls so far,
where numba is imported already and where it is not.

Interpreted, one meeting takes some 7 us, a compiled call some 20 us more than its work; loading the kernel takes 0.1 s,
importing numba 0.4 s. Which of the two runs makes no difference to a single bit.
"""
_spent = [0]

KEPT = 0
REASONS = {
    kernels.CLIPPED: "clipped at surface {}",
    kernels.MISSED: "missed surface {}",
    kernels.REFLECTED: "total internal reflection at surface {}",
    kernels.NO_PLANE: "never reaches the plane",
    kernels.STOPPED: "clipped at stop {}",
    kernels.INVALID: "not a ray (not finite, or its direction not of unit length)",
}


class Rays(NamedTuple):
    """Half-lines in the lens's frame: first vertex at z = 0, +z from scene to sensor."""

    position: Array
    """Points on them, (3, ...) [mm]."""
    direction: Array
    """Unit vectors along the way they travel, (3, ...)."""

    @classmethod
    def between(cls, start: ArrayLike, end: ArrayLike) -> Rays:
        """Rays from points to points, each (3, ...), broadcast [mm]."""
        begin, finish = np.broadcast_arrays(np.asarray(start, float), np.asarray(end, float))
        along = finish - begin
        size = np.sqrt(np.sum(np.square(along), axis=0))
        if not np.all(size > 0):
            raise ValueError("a ray needs two different, finite points")
        return cls(begin.copy(), along / size)

    def at(self, z: ArrayLike) -> Array:
        """Where the lines cross the planes at `z`, (2, ...) [mm]; a line along the plane gives inf or nan."""
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = (np.asarray(z, float) - self.position[2]) / self.direction[2]
            return np.asarray(self.position[:2] + steps * self.direction[:2])


class Traced(NamedTuple):
    """Where rays ended: on the plane asked for, on the last surface, or where they were stopped."""

    rays: Rays
    """Position and direction at the end, finite for every ray."""
    state: NDArray[np.int16]
    """0 for a ray that was kept, else what `describe` tells, (...)."""
    path: Array | None
    """Optical path length from the start [mm], (...), where asked for."""
    room: Array | None
    """Least of 1 - r^2/semi-diameter^2 over the surfaces, (...), where asked for; -1 or less where one was not met."""

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Which rays came through, (...)."""
        return np.asarray(self.state == KEPT)

    def ledger(self) -> dict[str, int]:
        """How many rays were kept, and how many ended in each way; adds up to all of them."""
        codes, counts = np.unique(self.state, return_counts=True)
        return {describe(int(code)): int(count) for code, count in zip(codes, counts, strict=True)}


def describe(state: int) -> str:
    """What a ray's state says: "kept", "clipped at surface 3"; surfaces count from 1 at the scene."""
    return "kept" if state == KEPT else REASONS[state % 8].format(state // 8)


def trace(
    lens: Prescription,
    rays: Rays,
    wavelength: ArrayLike,
    *,
    backward: bool = False,
    plane: float | None = None,
    clip: bool = True,
    path: bool = False,
    room: bool = False,
) -> Traced:
    """Trace rays through a lens.

    Parameters
    ----------
    lens : Prescription
        Its surfaces are met in order, or in reverse order where `backward`.
    rays : Rays
        Anywhere on the side they come from, (3, ...).
    wavelength : array_like
        One [mm], or one for each ray (broadcast).
    backward : bool
        From the sensor's side to the scene's.
    plane : float, optional
        Carry kept rays on to this z [mm]; else they end on the last surface.
    clip : bool
        Whether clear diameters stop rays.
    path, room : bool
        Whether to give optical path lengths, and how far inside the clear apertures each ray stayed.

    Returns
    -------
    Traced
        Every ray, with its state.

    Raises
    ------
    InputError
        A wavelength outside a glass's range.
    """
    shape = np.broadcast_shapes(np.shape(rays.position)[1:], np.shape(rays.direction)[1:], np.shape(wavelength))
    flat = [np.broadcast_to(np.asarray(part, float), (3, *shape)).reshape(3, -1) for part in rays]
    waves = np.broadcast_to(np.asarray(wavelength, float), shape).reshape(-1)
    options = (lens, backward, plane, clip, path, room)
    if np.ndim(wavelength) == 0 or np.all(waves == waves[:1]):
        colour = float(np.asarray(wavelength, float).flat[0]) if np.size(wavelength) else math.nan
        position, direction, state, lengths, rooms = _run(flat, colour, *options)
    else:
        n = waves.size
        position, direction, state = np.empty((3, n)), np.empty((3, n)), np.empty(n, np.int16)
        lengths, rooms = np.empty(n * path), np.empty(n * room)
        for colour in np.unique(waves):
            mine = waves == colour
            part = _run([flat[0][:, mine], flat[1][:, mine]], float(colour), *options)
            position[:, mine], direction[:, mine], state[mine] = part[:3]
            lengths[mine[: lengths.size]], rooms[mine[: rooms.size]] = part[3:]
    return Traced(
        Rays(position.reshape(3, *shape), direction.reshape(3, *shape)),
        state.reshape(shape),
        lengths.reshape(shape) if path else None,
        rooms.reshape(shape) if room else None,
    )


def _run(
    rays: list[Array],
    wavelength: float,
    lens: Prescription,
    backward: bool,
    plane: float | None,
    clip: bool,
    path: bool,
    room: bool,
) -> tuple[Array, Array, NDArray[np.int16], Array, Array]:
    n, count = rays[0].shape[1], len(lens.surfaces)
    index = np.array([1.0, *(float(surface.glass.index(wavelength)) for surface in lens.surfaces)])
    position, direction, state = np.empty(3 * n), np.empty(3 * n), np.empty(n, np.int16)
    lengths, rooms = np.empty(n * path), np.empty(n * room)
    ins: list[Any] = [np.ascontiguousarray(part).reshape(-1) for part in rays]
    arrays: list[Any] = [*ins, surface_table(lens), index, np.empty(ROWS * BLOCK), position, direction, state]
    arrays += [lengths, rooms]
    compiled = _pays(n * count)
    if not compiled:
        arrays = [memoryview(array) for array in arrays]  # plain floats out, not numpy's slow and noisy scalars
    run = trace_rays.compiled if compiled else trace_rays.interpreted
    from_, along, table, media, work, *results = arrays
    target = math.nan if plane is None else float(plane)
    run(from_, along, n, table, count, media, backward, clip, plane is not None, target, work, *results)
    return position.reshape(3, n), direction.reshape(3, n), state, lengths, rooms


def _pays(meetings: int) -> bool:
    if trace_rays.ready:
        return meetings >= CALL_ABOVE
    _spent[0] += meetings
    return _spent[0] >= (LOAD_ABOVE if "numba" in sys.modules else IMPORT_ABOVE)


@lru_cache(maxsize=128)
def surface_table(lens: Prescription) -> Array:
    """A lens's surfaces as the kernels want them: `COLUMNS` numbers each, flat."""
    table = np.zeros((len(lens.surfaces), COLUMNS))
    for row, surface, z in zip(table, lens.surfaces, lens.vertices, strict=True):
        row[0:3] = np.add(surface.shift, (0.0, 0.0, z))
        row[3:6] = surface.curvature, 1 + surface.conic, surface.semi_diameter**2
        row[6] = _kind(surface)
        row[7] = surface.tilt != (0.0, 0.0)
        row[8:17] = _axes(surface).reshape(-1)
        row[17 : 17 + len(surface.asphere)] = surface.asphere
        heights = np.linspace(0, surface.semi_diameter, 257)
        row[25] = 1.1 * np.max(np.abs(surface.sag(heights))) + 1e-6 * surface.semi_diameter
    table.setflags(write=False)
    return table.reshape(-1)


def _kind(surface: Surface) -> int:
    if any(surface.asphere):
        return ASPHERE
    return SPHERE if surface.conic == 0 or surface.curvature == 0 else CONIC


def _axes(surface: Surface) -> Array:
    """Columns: the surface's own axes in the lens's frame, the third along its axis of revolution."""
    alpha, beta = surface.tilt
    ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
    return np.stack([[cb, sa * sb, -ca * sb], [0.0, ca, sa], axis_of(surface)], axis=1)
