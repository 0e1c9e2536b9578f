"""A scene's surfaces and textures as rows of numbers, and the kernel that finds what a ray of light comes from."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ..camera.frames import frame
from ..design.parts import Part
from ..scenes import Checkerboard, Picture, Plane, Scene, Sinusoid, Sphere, Tube, Uniform, White

PLANE, SPHERE, TUBE = 0, 1, 2
UNIFORM, CHECKERBOARD, SINUSOID, PICTURE = 0, 1, 2, 3

KIND, ORIGIN, NORMAL, ACROSS, ALONG, EXTENT = 0, 1, 4, 7, 10, 13
"""Places in a surface's row: kind; x, y, Z of its origin; a plane's normal and its u and v axes; two lengths (half
width and height of a plane, radius of a sphere, radius and far end of a tube)."""
LOOK, LEVELS, WIDTH = 15, 16, 20
"""Texture's kind; its numbers; length of a row."""

FAR = 1e300
"""Distance of what is not met."""


class Surfaces(NamedTuple):
    """What rays may meet."""

    rows: NDArray[np.float64]
    """One row a surface, shape (S, 20)."""
    pictures: NDArray[np.float32]
    """Pixels of all pictures, one after the other."""
    beyond: float
    """Radiance where nothing is met."""


def encode(scene: Scene, focal_plane: float) -> Surfaces:
    """Lay a scene out for the kernels.

    Parameters
    ----------
    scene : Scene
    focal_plane : float
        d_f [mm], where planes lie that give no distance.
    """
    rows: list[NDArray[np.float64]] = []
    pictures: list[NDArray[np.float32]] = [np.zeros(1, np.float32)]
    beyond = scene.background
    for thing in scene.surfaces:
        if isinstance(thing, White):
            beyond = thing.level
            continue
        row = np.zeros(WIDTH)
        if isinstance(thing, Plane):
            _plane(row, thing, focal_plane)
        elif isinstance(thing, Sphere):
            row[KIND], row[EXTENT] = SPHERE, thing.radius
            row[ORIGIN : ORIGIN + 3] = (*thing.centre, thing.distance)
        else:
            _tube(row, thing)
        _texture(row, thing.texture, pictures)
        rows.append(row)
    return Surfaces(np.array(rows).reshape(-1, WIDTH), np.concatenate(pictures), beyond)


def _plane(row: NDArray[np.float64], plane: Plane, focal_plane: float) -> None:
    pose = frame((0.0, 0.0), 0.0, plane.tilt)
    row[KIND] = PLANE
    row[ORIGIN : ORIGIN + 3] = (*plane.centre, focal_plane if plane.distance is None else plane.distance)
    row[ACROSS : ACROSS + 3], row[ALONG : ALONG + 3], row[NORMAL : NORMAL + 3] = pose.x, pose.y, pose.z
    row[EXTENT : EXTENT + 2] = np.inf if plane.size is None else np.divide(plane.size, 2)


def _tube(row: NDArray[np.float64], tube: Tube) -> None:
    row[KIND] = TUBE
    row[ORIGIN : ORIGIN + 3] = (*tube.centre, tube.start)
    row[EXTENT : EXTENT + 2] = tube.radius, tube.end


def _texture(row: NDArray[np.float64], texture: Part, pictures: list[NDArray[np.float32]]) -> None:
    if isinstance(texture, Uniform):
        row[LOOK], row[LEVELS] = UNIFORM, texture.level
    elif isinstance(texture, Checkerboard):
        row[LOOK] = CHECKERBOARD
        row[LEVELS : LEVELS + 3] = 2 / texture.period, texture.high, texture.low
    elif isinstance(texture, Sinusoid):
        wave = 2 * math.pi / texture.period
        row[LOOK] = SINUSOID
        row[LEVELS : LEVELS + 3] = wave * math.cos(texture.angle), wave * math.sin(texture.angle), texture.contrast
    elif isinstance(texture, Picture):
        values = texture.load()
        row[LOOK] = PICTURE
        row[LEVELS : LEVELS + 4] = values.shape[1] / texture.width, sum(map(len, pictures)), *values.shape
        pictures.append(values.ravel())


@kernel()
def shade(s: Any, u: float, v: float, pictures: Any) -> float:
    """Radiance of a surface at its own (u, v)."""
    look = int(s[LOOK])
    if look == UNIFORM:
        return float(s[LEVELS])
    if look == CHECKERBOARD:
        odd = (math.floor(u * s[LEVELS]) + math.floor(v * s[LEVELS])) & 1
        return float(s[LEVELS + 2] if odd else s[LEVELS + 1])
    if look == SINUSOID:
        return float(0.5 * (1.0 + s[LEVELS + 2] * math.cos(u * s[LEVELS] + v * s[LEVELS + 1])))
    first, rows, columns = int(s[LEVELS + 1]), int(s[LEVELS + 2]), int(s[LEVELS + 3])
    x = u * s[LEVELS] + 0.5 * columns - 0.5
    y = v * s[LEVELS] + 0.5 * rows - 0.5
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j
    i, j = int(i) % columns, int(j) % rows
    i2 = i + 1 if i + 1 < columns else 0
    j2 = j + 1 if j + 1 < rows else 0
    top = pictures[first + j * columns + i] * (1.0 - fx) + pictures[first + j * columns + i2] * fx
    low = pictures[first + j2 * columns + i] * (1.0 - fx) + pictures[first + j2 * columns + i2] * fx
    return float(top * (1.0 - fy) + low * fy)


@kernel()
def meet_sphere(s: Any, hx: float, hy: float, ox: float, oy: float) -> float:
    """Distance Z at which the ray (hx - ox Z, hy - oy Z) first meets a sphere, seen from the lens."""
    # Counted from the sphere's own distance, where the numbers are small.
    rx, ry = hx - ox * s[ORIGIN + 2] - s[ORIGIN], hy - oy * s[ORIGIN + 2] - s[ORIGIN + 1]
    a = 1.0 + ox * ox + oy * oy
    b = rx * ox + ry * oy
    c = rx * rx + ry * ry - s[EXTENT] * s[EXTENT]
    under = b * b - a * c
    if under < 0.0:
        return FAR
    return float(s[ORIGIN + 2] + (b - math.sqrt(under)) / a)


@kernel()
def meet_tube(s: Any, hx: float, hy: float, ox: float, oy: float) -> float:
    """Distance Z at which a ray that enters a tube's near end meets its wall."""
    rx, ry = hx - ox * s[ORIGIN + 2] - s[ORIGIN], hy - oy * s[ORIGIN + 2] - s[ORIGIN + 1]
    a = ox * ox + oy * oy
    c = rx * rx + ry * ry - s[EXTENT] * s[EXTENT]
    if c > 0.0 or a == 0.0:
        return FAR
    b = rx * ox + ry * oy
    z = s[ORIGIN + 2] + (b + math.sqrt(b * b - a * c)) / a
    return float(z if z <= s[EXTENT + 1] else FAR)


@kernel()
def meet_plane(s: Any, hx: float, hy: float, ox: float, oy: float) -> float:
    """Distance Z at which a ray meets a plane."""
    fall = s[NORMAL] * ox + s[NORMAL + 1] * oy + s[NORMAL + 2]
    if fall <= 0.0:
        return FAR
    height = s[NORMAL] * (hx - s[ORIGIN]) + s[NORMAL + 1] * (hy - s[ORIGIN + 1]) + s[NORMAL + 2] * s[ORIGIN + 2]
    return float(height / fall)


@kernel()
def radiance(
    rows: Any, pictures: Any, beyond: float, mouth: float, hx: float, hy: float, ox: float, oy: float
) -> float:
    """Radiance of what the ray (hx - ox Z, hy - oy Z) meets first beyond the bore's mouth."""
    nearest = FAR
    value = beyond
    for n in range(rows.shape[0]):
        s = rows[n]
        kind = int(s[KIND])
        if kind == PLANE:
            z = meet_plane(s, hx, hy, ox, oy)
        elif kind == SPHERE:
            z = meet_sphere(s, hx, hy, ox, oy)
        else:
            z = meet_tube(s, hx, hy, ox, oy)
        if z >= nearest or z <= mouth:
            continue
        dx, dy, dz = hx - ox * z - s[ORIGIN], hy - oy * z - s[ORIGIN + 1], s[ORIGIN + 2] - z
        if kind == PLANE:
            u = s[ACROSS] * dx + s[ACROSS + 1] * dy + s[ACROSS + 2] * dz
            v = s[ALONG] * dx + s[ALONG + 1] * dy + s[ALONG + 2] * dz
            if abs(u) > s[EXTENT] or abs(v) > s[EXTENT + 1]:
                continue
        elif kind == SPHERE:
            u = s[EXTENT] * math.atan2(dx, dz)
            v = s[EXTENT] * math.asin(min(1.0, max(-1.0, dy / s[EXTENT])))
        else:
            u = s[EXTENT] * math.atan2(dy, dx)
            v = z
        nearest = z
        value = shade(s, u, v, pictures)
    return float(value)
