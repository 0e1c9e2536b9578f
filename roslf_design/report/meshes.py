"""The parts of a 3D scene as triangles and lines: plain geometry, no graphics library, so it needs no OpenGL."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

AROUND = 72
"""Corners of what is round."""
RINGS = 24
"""Parallels of an ellipsoid from pole to pole."""


class Mesh(NamedTuple):
    """Geometry of one part."""

    points: Floats
    """Shape (N, 3) [mm]."""
    faces: Indices
    """Corners of quadrangles, shape (F, 4); empty for lines."""
    lines: tuple[Indices, ...]
    """Corners of each polyline; empty for surfaces."""
    normals: Floats | None
    """Unit normals at the points, where the surface is to look smooth."""


def mesh_of(part: Mapping[str, Any]) -> Mesh:
    """The geometry of a part of `scene3d.Scene`.

    Parameters
    ----------
    part : mapping
        With its ``kind`` and the numbers that `scene3d` gives for it.
    """
    return MAKERS[part["kind"]](part)


def _ring(part: Mapping[str, Any]) -> Mesh:
    u, v = across(part["normal"])
    t = _angles(AROUND)[:, None]
    circle = np.cos(t) * u + np.sin(t) * v
    points = np.concatenate([part["inner"] * circle, part["outer"] * circle]) + np.asarray(part["centre"])
    return Mesh(points, _bands(2, AROUND), (), None)


def _tube(part: Mapping[str, Any]) -> Mesh:
    x, y, _ = part["centre"]
    t = _angles(AROUND)
    circle = np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=1)
    ends = [part["radius"] * circle + [x, y, z] for z in (part["from"], part["to"])]
    return Mesh(np.concatenate(ends), _bands(2, AROUND), (), np.concatenate([circle, circle]))


def _ellipsoid(part: Mapping[str, Any]) -> Mesh:
    t, s = _angles(AROUND), np.linspace(0.0, math.pi, RINGS + 1)[:, None]
    z = np.broadcast_to(np.cos(s), (RINGS + 1, AROUND))
    sphere = np.stack([np.sin(s) * np.cos(t), np.sin(s) * np.sin(t), z], axis=-1).reshape(-1, 3)
    size = np.array([part["radius"], part["radius"], part["thickness"]])
    normals = sphere / size
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(sphere * size + np.asarray(part["centre"]), _bands(RINGS + 1, AROUND), (), normals)


def _plate(part: Mapping[str, Any]) -> Mesh:
    u, v = across(part["normal"])
    width, height = part["size"]
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    points = [np.asarray(part["centre"]) + 0.5 * (i * width * u + j * height * v) for i, j in corners]
    return Mesh(np.array(points), np.array([[0, 1, 2, 3]]), (), None)


def _lines(part: Mapping[str, Any]) -> Mesh:
    lengths = [len(line) for line in part["lines"]]
    starts = np.cumsum([0, *lengths[:-1]])
    lines = tuple(np.arange(start, start + n) for start, n in zip(starts, lengths, strict=True))
    points = np.concatenate([np.asarray(line, float) for line in part["lines"]])
    return Mesh(points, np.empty((0, 4), np.int64), lines, None)


def across(normal: Any) -> tuple[Floats, Floats]:
    """Two unit vectors that span the plane of a normal, the first as near to x as can be."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    u = np.array([1.0, 0.0, 0.0]) - n[0] * n
    if np.linalg.norm(u) < 1e-6:
        u = np.array([0.0, 1.0, 0.0]) - n[1] * n
    u /= np.linalg.norm(u)
    return u, np.cross(n, u)


def _angles(count: int) -> Floats:
    return np.linspace(0.0, 2 * math.pi, count, endpoint=False)


def _bands(rows: int, around: int) -> Indices:
    """Quadrangles between neighbouring rows of points, closed around."""
    row, place = np.meshgrid(np.arange(rows - 1), np.arange(around), indexing="ij")
    here, beside = row * around + place, row * around + (place + 1) % around
    return np.stack([here, beside, beside + around, here + around], axis=-1).reshape(-1, 4)


MAKERS = {"ring": _ring, "tube": _tube, "ellipsoid": _ellipsoid, "plate": _plate, "lines": _lines}
"""How each kind of part is built."""
