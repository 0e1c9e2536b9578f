"""Independent references for the calibration: white images by brute force."""

from __future__ import annotations

import math

import numpy as np

SUB = 8


def nodes_over(shape, pitch, rotation, layout, origin=(0.0, 0.0)):
    """Every lattice node whose cell touches the image: rotated rows written out, no library code."""
    rows, columns = shape
    reach = int(math.hypot(rows, columns) / pitch) + 4
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    if layout == "square":
        x, y = i * pitch, j * pitch
    else:
        x, y = (i + 0.5 * (j % 2)) * pitch, j * pitch * math.sqrt(3) / 2
    c, s = math.cos(rotation), math.sin(rotation)
    cx = c * x - s * y + (columns - 1) / 2 + origin[0]
    cy = s * x + c * y + (rows - 1) / 2 + origin[1]
    near = (cx > -pitch) & (cx < columns + pitch) & (cy > -pitch) & (cy < rows + pitch)
    return np.stack([cx[near], cy[near]], axis=-1)


def white_image(shape, centres, radius, cut_radius=None, cut_shift=None, noise=0.0, seed=0, envelope=None):
    """Discs (each cut by a second disc displaced by `cut_shift`), coverage by 8 x 8 sub-samples of edge pixels."""
    rows, columns = shape
    image = np.zeros(rows * columns)
    k = math.ceil(radius) + 2
    offset = (np.arange(SUB) + 0.5) / SUB - 0.5
    shift = np.zeros_like(centres) if cut_shift is None else cut_shift
    cut = math.inf if cut_radius is None else cut_radius
    grid_y, grid_x = (g.ravel() for g in np.mgrid[-k : k + 1, -k : k + 1])
    for start in range(0, len(centres), 4000):
        c, t = centres[start : start + 4000], shift[start : start + 4000]
        px = np.round(c[:, :1]) + grid_x
        py = np.round(c[:, 1:]) + grid_y
        dx, dy = px - c[:, :1], py - c[:, 1:]
        first = np.hypot(dx, dy) - radius
        second = np.hypot(dx - t[:, :1], dy - t[:, 1:]) - cut if cut < math.inf else np.full_like(first, -1e9)
        outermost = np.maximum(first, second)
        value = (outermost < 0).astype(float)
        edge = np.abs(outermost) < 0.75
        ex, ey = dx[edge], dy[edge]
        tx, ty = (np.broadcast_to(t[:, n : n + 1], dx.shape)[edge] for n in (0, 1))
        area = np.zeros(ex.shape)
        for oy in offset:
            for ox in offset:
                inside = (ex + ox) ** 2 + (ey + oy) ** 2 < radius**2
                if cut < math.inf:
                    inside &= (ex + ox - tx) ** 2 + (ey + oy - ty) ** 2 < cut**2
                area += inside
        value[edge] = area / SUB**2
        on = (px >= 0) & (px < columns) & (py >= 0) & (py < rows)
        at = (py[on] * columns + px[on]).astype(np.int64)
        image += np.bincount(at, value[on], rows * columns)
    image = image.reshape(shape)
    if envelope is not None:
        image = image * envelope
    if noise:
        image = image + np.random.default_rng(seed).normal(0, noise, shape)
    return image
