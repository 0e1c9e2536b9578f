"""The engine's primitive, a backward ray: from a point of the sensor through a point of a microlens to object space.

Backward rays need no aiming. The kernels have no branches, so the same source runs on numpy arrays (interpreted,
broadcasting) and on floats inside compiled loops. What they need of a camera is laid out once: constants by their
places, rigid maps as 3 x 4 blocks ``[R | t]`` (new = R old + t), rims as rows.

The ideal lens is no row of the ray tracer here: a `THIN` row bends the same rays, in thirty times the time (70 ns, not
2.3) and with twice the rounding errors.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ..camera import Camera, Frame
from ..camera.frames import frame
from ..lenses.angles import stretch

Floats = NDArray[np.float64]

D_1, PER_D_2, PER_F_ML, PER_F = 0, 1, 2, 3
"""Places of a camera's constants: d_1, 1/d_2, 1/f_ml, 1/f."""
SENSOR_X, ARRAY_X, LENS_X = 4, 6, 8
"""Decentres of sensor against array, array against lens, lens against the axis; y follows x."""
LENS_RADIUS, HALF = 10, 11
"""Radius of the main lens; half width of a microlens."""
SENSOR, ARRAY, LENS, STOPS = 0, 1, 2, 3
"""Places in a stack of maps: sensor to array, array to lens, lens to object space, then lens to each stop."""


class Layout(NamedTuple):
    """One camera behind an ideal lens, as the kernels take it."""

    constants: Floats
    """[mm] and [1/mm], at the places named above."""
    maps: Floats
    """Shape (3 + K, 3, 4)."""
    rims: Floats
    """The FAP, then the further stops: the lens's decentre less the stop's (x, y), distance, and what `inside` takes
    of its opening; (K, 3 + ROW) [mm]."""
    front: Floats
    """The farthest element's scene side: distance; A, B, C, D, index, E and F (x, y) of its `ImagedPlane`; where the
    scene sees the entrance pupil; (11,)."""
    law: Floats
    """Mapping of an objective (`..lenses.angles`); no rows where there is none."""
    shade: Floats
    """Law of the light over the field; no rows of cos^4."""


def lay_out(camera: Camera) -> Layout:
    """Layout of one camera for the kernels of this module."""
    n = camera.numbers

    def decentre(part: str) -> Floats:
        return np.array([n[f"{part}.decentre.0"], n[f"{part}.decentre.1"]], float)

    sensor, array, lens = (decentre(part) for part in ("sensor", "microlens_array", "main_lens"))
    ones = [
        camera.seen.d_1,
        1 / camera.seen.d_2,
        1 / camera.f_ml,
        1 / camera.f,
        *(sensor - array),
        *(array - lens),
        *lens,
    ]
    openings = camera.openings_ahead
    own = frame((0.0, 0.0), 0.0, (0.0, 0.0))
    to_array = camera.apparent_pose("sensor").seen_from(camera.apparent_pose("microlens_array"))
    maps = [
        _map(to_array),
        _map(camera.apparent_pose("microlens_array")),
        _map(own.seen_from(camera.world)),
        *(_map(own.seen_from(camera.apparent_pose(stop.part))) for stop in openings),
    ]
    if not camera.tilted:
        maps[0][2, 3] = camera.seen.d_2  # better than a difference of (d_1 + d_2) and d_1
    rims = [
        [*(-offset for offset in camera.decentre(stop.part)), stop.distance, *stop.outline.row()] for stop in openings
    ]
    constants = [*ones, camera.D / 2, camera.d / 2]
    numbers, blocks, limits = (np.array(part, float) for part in (constants, maps, rims))
    return Layout(numbers, blocks, limits, scene_side(camera), camera.mapping.kernel, camera.mapping.shade)


def scene_side(camera: Camera) -> Floats:
    """`Layout.front` of one camera."""
    end, plane = camera.front
    front = [
        end,
        plane.a,
        plane.b,
        plane.c,
        plane.d,
        plane.medium,
        *plane.axis_offset,
        *plane.axis_slope,
        camera.entrance_pupil_distance,
    ]
    return np.array(front, float)


def _map(pose: Frame) -> Floats:
    """Block that takes coordinates of a part's own frame to those the pose is given in."""
    return np.array([pose.x, pose.y, pose.z, pose.origin], float).T


@kernel()
def aligned_ray(
    d_1: Any, per_d_2: Any, per_f_ml: Any, per_f: Any, sensor: Any, array: Any, p: Any, c: Any, v: Any
) -> Any:
    """One coordinate of a backward ray where nothing is tilted: height against the lens's centre, object-side slope."""
    s = (((p - c) + sensor) - v) * per_d_2 + v * per_f_ml
    height = ((c + v) + array) - s * d_1
    return height, s + height * per_f


@kernel()
def posed_ray(k: Any, m: Any, px: Any, py: Any, cx: Any, cy: Any, vx: Any, vy: Any) -> Any:
    """Backward ray through tilted elements: height and slope in the lens's frame, and whether light can go that way."""
    dx = (((m[0, 0, 0] * px + m[0, 0, 1] * py) - cx) + m[0, 0, 3]) - vx
    dy = (((m[0, 1, 0] * px + m[0, 1, 1] * py) - cy) + m[0, 1, 3]) - vy
    dz = m[0, 2, 0] * px + m[0, 2, 1] * py + m[0, 2, 3]
    gx = dx + vx * (dz * k[PER_F_ML])
    gy = dy + vy * (dz * k[PER_F_ML])
    tx = m[1, 0, 0] * gx + m[1, 0, 1] * gy + m[1, 0, 2] * dz
    ty = m[1, 1, 0] * gx + m[1, 1, 1] * gy + m[1, 1, 2] * dz
    tz = m[1, 2, 0] * gx + m[1, 2, 1] * gy + m[1, 2, 2] * dz
    wx, wy = cx + vx, cy + vy
    wz = m[1, 2, 0] * wx + m[1, 2, 1] * wy + m[1, 2, 3]
    sx, sy = tx / tz, ty / tz
    lx = (m[1, 0, 0] * wx + m[1, 0, 1] * wy + m[1, 0, 3]) - sx * wz
    ly = (m[1, 1, 0] * wx + m[1, 1, 1] * wy + m[1, 1, 3]) - sy * wz
    face = m[0, 0, 2] * dx + m[0, 1, 2] * dy + m[0, 2, 2] * dz
    return lx, ly, sx + lx * k[PER_F], sy + ly * k[PER_F], (dz > 0.0) & (face > 0.0) & (tz > 0.0) & (wz > 0.0)


@kernel()
def crossing(m: Any, lx: Any, ly: Any, ox: Any, oy: Any) -> Any:
    """Height, slope and forwardness of an object-side ray in another element's frame."""
    tx = m[0, 0] * ox + m[0, 1] * oy + m[0, 2]
    ty = m[1, 0] * ox + m[1, 1] * oy + m[1, 2]
    tz = m[2, 0] * ox + m[2, 1] * oy + m[2, 2]
    sx, sy = tx / tz, ty / tz
    z = m[2, 0] * lx + m[2, 1] * ly + m[2, 3]
    ax = (m[0, 0] * lx + m[0, 1] * ly + m[0, 3]) - sx * z
    ay = (m[1, 0] * lx + m[1, 1] * ly + m[1, 3]) - sy * z
    return ax, ay, sx, sy, tz > 0.0


@kernel()
def behind_elements(front: Any, lens_x: Any, lens_y: Any, hx: Any, hy: Any, ox: Any, oy: Any) -> Any:
    """Height at z = 0 and slope in the medium of the scene, of a ray that leaves the main lens; system's axes."""
    lx, ly = hx - lens_x, hy - lens_y
    sx = ((front[4] * ox - front[3] * lx) + front[8]) / front[5]
    sy = ((front[4] * oy - front[3] * ly) + front[9]) / front[5]
    x = lens_x + ((front[1] * lx - front[2] * ox) + front[6])
    y = lens_y + ((front[1] * ly - front[2] * oy) + front[7])
    return x + sx * front[0], y + sy * front[0], sx, sy


@kernel()
def mapped(law: Any, front: Any, hx: Any, hy: Any, ox: Any, oy: Any) -> Any:
    """A ray behind elements as its objective maps it, and whether that images it; its point on the pupil stays."""
    if law.shape[0] == 0:
        return hx, hy, ox, oy, True
    p = front[5] * np.hypot(ox, oy)
    grown = stretch(law, p, front[5])
    sx, sy = ox * grown, oy * grown
    return hx + (sx - ox) * front[10], hy + (sy - oy) * front[10], sx, sy, p <= law[0, 1]
