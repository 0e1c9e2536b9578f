"""Each microlens's own light in its samples, and where on the FAP it comes from.

Diffraction and overlap bring light of neighbouring microlenses into a sample, which look at another place of the scene
from the other side of the FAP: taken for the microlens's own they shear the light field, and depth comes out wrong.
How much of it there is follows from the camera, and what the neighbours see stands in their own samples.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.decoding import LightField, Samples, squared
from ..camera import Camera
from ..theory.disparity_error import ImageParts, image_parts
from ..theory.stop_images import MicrolensImages

NODES = 9
"""Fields along each axis at which cut microlens images are worked out; between them they are interpolated."""
ROUNDS = 6
"""Of taking neighbours' light away: what is left falls to less than a third each time."""
FAINT = 0.0005
"""Share of a neighbour's light in a sample that is let be."""
LEAST = 0.6
"""Own share of a sample's light under which it is dropped: it tells more of its neighbours."""


def places_on_array(camera: Camera, field: LightField) -> NDArray[np.float64]:
    """Places of a light field's microlenses on the array, shape (v, u, 2) [mm]."""
    u, v = np.meshgrid(field.u, field.v)
    return np.stack([u, v], -1) * float(camera.d)


def unmixed(camera: Camera, field: LightField) -> tuple[LightField, NDArray[np.float32]]:
    """A decoded light field with each microlens's own light alone.

    Parameters
    ----------
    camera : Camera
        One build, which took it.
    field : LightField
        Its u and v count microlenses from the array's centre.

    Returns
    -------
    (field, pupil)
        Weights are those of samples with as much noise. Where each sample's light passed the FAP, on average, along u
        and along v [diameters]: shape (2, t, s), or (2, t, s, v, u) where stops cut microlens images.
    """
    places = places_on_array(camera, field)
    height, width = places.shape[:2]
    rows, columns = (np.unique(np.linspace(0, n - 1, min(n, NODES)).round().astype(int)) for n in (height, width))
    images = MicrolensImages(camera, places[np.ix_(rows, columns)].reshape(-1, 2))
    if (images.shapes.kept_fraction >= 1 - 1e-9).all():
        rows, columns = rows[:1], columns[:1]
        images = MicrolensImages(camera, places[:1, :1].reshape(-1, 2))
    parts = image_parts(images, field.s / field.pitch, field.t / field.pitch)
    own = parts.steps.index((0, 0))
    total = parts.light.sum(0)
    shares = np.divide(parts.light, total, out=np.zeros_like(parts.light), where=total > 0)
    grid = (rows.size, columns.size)

    def spread(values: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float32]:
        """From the nodes to all microlenses; shape (..., v, u), or (..., 1, 1) where all are alike."""
        table = values.reshape(*values.shape[:-1], *grid).astype(np.float32)
        if grid == (1, 1):
            return table
        low = _between(table, rows * (size[0] - 1) / max(height - 1, 1), size[0], values.ndim - 1)
        return _between(low, columns * (size[1] - 1) / max(width - 1, 1), size[1], values.ndim)

    hexagonal = field.hexagonal
    lenses = field if hexagonal is None else hexagonal
    values = np.array(lenses.values)
    size = (values.shape[2], values.shape[3])
    start = np.zeros(size[0], int) if hexagonal is None else np.rint(hexagonal.starts - _halves(field)).astype(int)
    nearest = _own_samples(parts, own)
    mine = np.moveaxis(shares[own], 0, -1)
    share = spread(mine, size)
    kept = share > LEAST
    for _ in range(ROUNDS):
        foreign = np.zeros_like(values)
        for step, k in ((step, k) for k, step in enumerate(parts.steps) if k != own):
            theirs = np.moveaxis(shares[k], 0, -1)
            for t, s in zip(*np.nonzero(theirs.max(-1) > FAINT), strict=True):
                there = nearest[k, t, s]
                seen, known = _beside(values[there[0], there[1]], lenses.weight[there[0], there[1]], step, start)
                part = spread(theirs[t, s], size)
                foreign[t, s] += part * np.where(known, seen, values[t, s])
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.where(kept, (lenses.values - foreign) / share, 0.0).astype(np.float32)
    weight = np.asarray(np.where(kept, lenses.weight * share**2, 0.0), np.float32)
    pupil = np.stack([spread(np.moveaxis(axis[own], 0, -1), (height, width)) for axis in (parts.x, parts.y)])
    if grid == (1, 1):
        pupil = pupil[..., 0, 0]
    side = math.copysign(1.0, float(camera.A) * float(camera.D_F))
    pupil *= np.float32(side)
    if hexagonal is None:
        return replace(field, values=values, weight=weight), pupil
    even, light = squared(values, weight, field.u, hexagonal.starts)
    rows_of = hexagonal._replace(values=values, weight=weight)
    return replace(field, values=even, weight=light, hexagonal=rows_of), pupil


def _halves(field: LightField) -> NDArray[np.float64]:
    return field.v / math.sqrt(3)


def _own_samples(parts: ImageParts, own: int) -> NDArray[np.intp]:
    """Which sample (t, s) of a neighbour shows what it sends here: that of the nearest place on the FAP.

    Shape (9, T, S, 2); of the mean over fields.
    """
    light = parts.light.mean(1)
    x, y = ((axis * parts.light).mean(1) / np.maximum(light, 1e-12) for axis in (parts.x, parts.y))
    usable = parts.light[own].mean(0) > LEAST * max(float(parts.light[own].max()), 1e-12)
    t, s = np.nonzero(usable)
    if not t.size:
        t, s = np.nonzero(np.ones_like(usable))
    apart = (x[..., None] - x[own][t, s]) ** 2 + (y[..., None] - y[own][t, s]) ** 2
    best = apart.argmin(-1)
    return np.stack([t[best], s[best]], -1)


def _beside(
    values: Samples, weight: Samples, step: tuple[int, int], start: NDArray[np.intp]
) -> tuple[Samples, NDArray[np.bool_]]:
    """What the microlens some steps of the lattice away has, at each microlens, and whether it is there."""
    rows, columns = values.shape
    row = np.arange(rows) + step[1]
    there = (row >= 0) & (row < rows)
    row = np.clip(row, 0, rows - 1)
    column = np.arange(columns) + (start - start[row] + step[0])[:, None]
    inside = there[:, None] & (column >= 0) & (column < columns)
    column = np.clip(column, 0, columns - 1)
    return values[row[:, None], column], inside & (weight[row[:, None], column] > 0)


def _between(values: NDArray[np.float32], nodes: NDArray[np.float64], size: int, axis: int) -> NDArray[np.float32]:
    """Linearly between nodes along an axis, which then has `size` places."""
    if len(nodes) == 1:
        return np.repeat(values, size, axis)
    at = np.arange(size)
    after = np.clip(np.searchsorted(nodes, at, side="right"), 1, len(nodes) - 1)
    share = ((at - nodes[after - 1]) / (nodes[after] - nodes[after - 1])).astype(np.float32)
    share = share.reshape([-1 if n == axis else 1 for n in range(values.ndim)])
    return np.asarray(np.take(values, after - 1, axis) * (1 - share) + np.take(values, after, axis) * share)
