"""From a raw image to the light field: sampled at every lattice centre, freed of vignetting, made square."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import THREADS, kernel, prange
from .frames import Frame, grey_frame, refuse_saturated, same_size
from .lattice import Array, CentreLattice
from .lightfield import LightField, Samples

_DARKEST = 0.05
"""Light of the white image, against its brightest, under which a sample says nothing."""


def decode(
    raw: ArrayLike,
    lattice: CentreLattice,
    *,
    white: ArrayLike | None = None,
    dark: ArrayLike | None = None,
    radius: int | None = None,
) -> LightField:
    """Decode a raw image with the lattice of its microlens images.

    Each sample is interpolated (cubic convolution) at a whole number of pixels from a microlens image's fitted centre.
    With a white image, samples are divided by its light and dropped where it has too little. Hexagonal arrays are
    interpolated along their rows to a square grid of sqrt(3)/2 pitches.

    Parameters
    ----------
    raw : array_like
        Raw image, shape (rows, columns), or with channels, which are averaged.
    lattice : CentreLattice
        Of the microlens images, from `find_centres`.
    white, dark : array_like, optional
        White image and frame without light, same size.
    radius : int, optional
        Views run from -radius to +radius pixels; half the pitch, rounded down, where not given.

    Raises
    ------
    CalibrationError
        Images missing, of different sizes, not finite, or a raw image with over 5 % of its pixels saturated.
    """
    frame = grey_frame(raw, dark, "raw image")
    refuse_saturated(raw, "raw image")
    reach = math.floor(lattice.pitch / 2) if radius is None else radius
    if reach < 1:
        raise ValueError(f"radius must be at least 1 px, got {reach}")
    offsets = np.arange(-reach, reach + 1, dtype=np.float64)
    inside = lattice.inside((frame.shape[0], frame.shape[1]))
    if lattice.layout == "square":
        (i0, j0), (i1, j1) = inside.min(axis=0), inside.max(axis=0)
        starts, columns = np.full(j1 - j0 + 1, i0), i1 - i0 + 1
    else:
        # Rows shift by half a pitch each: start them where the row enters the image, a whole number of lenses apart.
        along = inside[:, 0] + 0.5 * inside[:, 1]
        (j0, j1), left = (inside[:, 1].min(), inside[:, 1].max()), math.floor(along.min())
        starts = left - np.floor_divide(np.arange(j0, j1 + 1), 2)
        columns = math.ceil(along.max()) - left + 1
    rows = np.arange(j0, j1 + 1)
    values, seen = _sampled(frame, lattice, offsets, rows, starts, columns)
    weight = seen
    if white is not None:
        bright = grey_frame(white, dark, "white image")
        same_size("raw image", frame.shape, "white image", bright.shape)
        level, lit = _sampled(bright, lattice, offsets, rows, starts, columns)
        level /= max(float(np.quantile(level[lit > 0][::16], 0.99)), 1e-30)
        weight = np.where((level > _DARKEST) & (lit > 0), np.clip(level, 0, 1), 0).astype(np.float32)
        values = np.where(weight > 0, values / np.where(weight > 0, level, 1), 0).astype(np.float32)
    if lattice.layout == "square":
        u, v = np.arange(i0, i1 + 1, dtype=float), rows.astype(float)
    else:
        step = math.sqrt(3) / 2
        u = step * np.arange(math.ceil(along.min() / step), math.floor(along.max() / step) + 1)
        v = step * rows
        values, weight = _squared(values, weight, u, starts + 0.5 * rows)
    return LightField(values, weight, offsets, offsets.copy(), u, v, lattice.pitch, lattice.rotation)


@kernel(parallel=True)
def _gather(
    image: Frame, nodes_x: Array, nodes_y: Array, along: Array, offsets: Array, values: Samples, seen: Samples
) -> None:
    rows, columns = image.shape
    count = offsets.shape[0]
    for k in prange(count * count):
        t, s = k // count, k % count
        dx = offsets[s] * along[0] - offsets[t] * along[1]
        dy = offsets[s] * along[1] + offsets[t] * along[0]
        for v in range(nodes_x.shape[0]):
            for u in range(nodes_x.shape[1]):
                x, y = nodes_x[v, u] + dx, nodes_y[v, u] + dy
                column, row = math.floor(x), math.floor(y)
                if column < 1 or row < 1 or column > columns - 3 or row > rows - 3:
                    continue
                fx, fy = x - column, y - row
                total = 0.0
                for b in range(4):
                    line = 0.0
                    for a in range(4):
                        line += _cubic(a - 1 - fx) * image[row - 1 + b, column - 1 + a]
                    total += _cubic(b - 1 - fy) * line
                values[t, s, v, u] = total
                seen[t, s, v, u] = 1.0


@kernel()
def _cubic(x: float) -> float:
    """Cubic convolution (a = -1/2): exact for quadratics, third order in the pixel."""
    x = abs(x)
    if x < 1.0:
        return (1.5 * x - 2.5) * x * x + 1.0
    if x < 2.0:
        return ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    return 0.0


def _sampled(
    frame: Frame,
    lattice: CentreLattice,
    offsets: Array,
    rows: NDArray[np.int64],
    starts: NDArray[np.int64],
    columns: int,
) -> tuple[Samples, Samples]:
    """Samples and whether they were inside the image, shape (t, s, v, u)."""
    i = starts[:, None] + np.arange(columns)[None, :]
    nodes = lattice.nodes(i, np.broadcast_to(rows[:, None], i.shape))
    along = np.asarray(lattice.first) / lattice.pitches[0]
    shape = (len(offsets), len(offsets), len(rows), columns)
    values, seen = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    x, y = np.ascontiguousarray(nodes[..., 0]), np.ascontiguousarray(nodes[..., 1])
    with THREADS:
        _gather.compiled(frame, x, y, along, offsets, values, seen)
    return values, seen


def _squared(values: Samples, weight: Samples, u: Array, starts: Array) -> tuple[Samples, Samples]:
    """Hexagonal rows interpolated at u (all in pitches); row v's samples stand at ``starts[v] + 0, 1, 2, ...``."""
    columns = values.shape[-1]
    out, held = (np.zeros((*values.shape[:-1], len(u)), np.float32) for _ in range(2))
    for v, start in enumerate(starts):
        base = np.floor(u - start).astype(int)
        part = u - start - base
        taps = np.stack([base - 1, base, base + 1, base + 2])
        usable = (taps >= 0) & (taps < columns)
        taps = np.clip(taps, 0, columns - 1)
        light = weight[..., v, :][..., taps] * usable
        a, b, c, d = np.moveaxis(values[..., v, :][..., taps], -2, 0)
        before, at, after, beyond = np.moveaxis(light > 0, -2, 0)
        # A missing outer tap is put on the parabola through the other three.
        a, d = np.where(before, a, 3 * b - 3 * c + d), np.where(beyond, d, 3 * c - 3 * b + a)
        kernels = [_cubic_array(part + 1), _cubic_array(part), _cubic_array(1 - part), _cubic_array(2 - part)]
        whole = at & after & (before | beyond)
        out[..., v, :] = np.where(whole, kernels[0] * a + kernels[1] * b + kernels[2] * c + kernels[3] * d, 0)
        held[..., v, :] = np.where(whole, np.where(part < 0.5, light[..., 1, :], light[..., 2, :]), 0)
    return out, held


def _cubic_array(x: Array) -> Array:
    return np.where(x < 1, (1.5 * x - 2.5) * x * x + 1, ((-0.5 * x + 2.5) * x - 4) * x + 2)
