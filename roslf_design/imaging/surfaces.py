"""Surfaces and textures of a scene as rows of numbers, and what a block of rays meets of them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .._jit import kernel
from ..bore.part import Part
from ..camera import Camera
from ..camera.frames import frame
from ..lenses.tracer import BLOCK
from ..scenes import Checkerboard, Noise, PictureTexture, Plane, Scene, Sinusoid, Sphere, Uniform, White
from .camera import Floats, Image

PLANE, SPHERE, TUBE = 0, 1, 2
UNIFORM, CHECKERBOARD, SINUSOID, PICTURE = 0, 1, 2, 3

KIND, ORIGIN, NORMAL, ACROSS, ALONG, EXTENT = 0, 1, 4, 7, 10, 13
"""Places in a surface's row: kind; x, y, Z of its origin; a plane's normal and its u and v axes; two lengths (half
width and height of a plane, radius of a sphere (negative of a hollow one), radius and far end of a tube)."""
LOOK, LEVELS, WIDTH = 15, 16, 20
"""Texture's kind; its numbers; length of a row."""

FAR = 1e300
"""Distance of what is not met."""
BLOCK_ROWS = 14
"""Rows of a block of rays."""
X, Y, SLOPE_X, SLOPE_Y, LENS_AT_X, LENS_AT_Y, LIT, KICK_X, KICK_Y, NEAR, U, V, HIT, LIGHT = range(0, 14 * BLOCK, BLOCK)
"""Where they begin: the pixel's point, then the ray's height; the microlens's point from its axis, then the
ray's slope; that axis; 1 or 0; diffraction's kick; what is met: distance, place on it, number, radiance."""

NOWHERE = np.zeros(2)


class Surfaces(NamedTuple):
    """Surfaces that rays may meet."""

    rows: Floats
    """Rows of numbers, one a surface, shape (S, 20)."""
    pictures: Image
    """Pixels of all pictures, one after the other."""
    beyond: float
    """Radiance where nothing is met."""
    mirrored: Floats
    """Direction across the axis along which the scene is seen reversed, (2,); 0 where it is not."""
    over: float
    """Radiance above which what rays meet is counted."""
    source: float
    """Distance beyond the mouth at which surfaces have their radiance, of a source there [mm]; 0 of even light."""


def encode(
    scene: Scene, focal_plane: float, mirrored: Floats = NOWHERE, over: float = 0.0, source: float = 0.0
) -> Surfaces:
    """Lay a scene out for the kernels; planes that give no distance lie at `focal_plane`, d_f [mm]."""
    rows: list[Floats] = []
    pictures: list[Image] = [np.zeros(1, np.float32)]
    beyond = scene.background
    for thing in scene.surfaces:
        if isinstance(thing, White):
            beyond = thing.level
            continue
        row = np.zeros(WIDTH)
        if isinstance(thing, Plane):
            pose = frame((0.0, 0.0), 0.0, thing.tilt)
            row[KIND] = PLANE
            row[ORIGIN : ORIGIN + 3] = (*thing.centre, focal_plane if thing.distance is None else thing.distance)
            row[ACROSS : ACROSS + 3], row[ALONG : ALONG + 3], row[NORMAL : NORMAL + 3] = pose.x, pose.y, pose.z
            row[EXTENT : EXTENT + 2] = np.inf if thing.size is None else np.divide(thing.size, 2)
        elif isinstance(thing, Sphere):
            row[KIND], row[EXTENT] = SPHERE, thing.radius
            row[ORIGIN : ORIGIN + 3] = (*thing.centre, thing.distance)
        else:
            row[KIND] = TUBE
            row[ORIGIN : ORIGIN + 3] = (*thing.centre, thing.start)
            row[EXTENT : EXTENT + 2] = thing.radius, thing.end
        look, levels = _texture(thing.texture, pictures)
        row[LOOK], row[LEVELS : LEVELS + len(levels)] = look, levels
        rows.append(row)
    return Surfaces(np.array(rows).reshape(-1, WIDTH), np.concatenate(pictures), beyond, mirrored, over, source)


def _texture(texture: Part, pictures: list[Image]) -> tuple[int, tuple[float, ...]]:
    """Kind and numbers of a texture; a picture's pixels go behind those of others."""
    if isinstance(texture, Checkerboard):
        return CHECKERBOARD, (2 / texture.period, texture.high, texture.low)
    if isinstance(texture, Sinusoid):
        return SINUSOID, (*(f(texture.angle) / texture.period for f in (math.cos, math.sin)), texture.contrast)
    if isinstance(texture, PictureTexture | Noise):
        values = texture.load()
        first = sum(map(len, pictures))
        pictures.append(values.ravel())
        return PICTURE, (values.shape[1] / texture.width, first, *values.shape)
    assert isinstance(texture, Uniform)
    return UNIFORM, (texture.level,)


@kernel(inline=True)
def _alternating(
    q: float, a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float
) -> float:
    """Series 1 - q a (1 - q b (1 - q c ...))."""
    end = 1.0 - q * g * (1.0 - q * h * (1.0 - q * i))
    return 1.0 - q * a * (1.0 - q * b * (1.0 - q * c * (1.0 - q * d * (1.0 - q * e * (1.0 - q * f * end)))))


@kernel(inline=True)
def on_circle(share: float) -> Any:
    """Cosine and sine of a share of a turn, from 0 to 1, to 1e-13: series, of which loops are made vectors."""
    z = math.pi * (share - 0.5)
    q = z * z
    sine = z * _alternating(q, 1 / 6, 1 / 20, 1 / 42, 1 / 72, 1 / 110, 1 / 156, 1 / 210, 1 / 272, 0.0)
    cosine = _alternating(q, 1 / 2, 1 / 12, 1 / 30, 1 / 56, 1 / 90, 1 / 132, 1 / 182, 1 / 240, 1 / 306)
    return 2.0 * sine * sine - 1.0, -2.0 * sine * cosine


@kernel(inline=True)
def _checkered(s: Any, u: float, v: float) -> Any:
    """Radiance of a checkerboard."""
    squares = math.floor(u * s[LEVELS]) + math.floor(v * s[LEVELS])
    return s[LEVELS + 1] if squares == 2.0 * math.floor(0.5 * squares) else s[LEVELS + 2]


@kernel(inline=True)
def _waved(s: Any, u: float, v: float) -> Any:
    """Radiance of a sinusoid."""
    phase = u * s[LEVELS] + v * s[LEVELS + 1]
    cosine, _ = on_circle(phase - math.floor(phase))
    return 0.5 * (1.0 + s[LEVELS + 2] * cosine)


@kernel(inline=True)
def _pictured(s: Any, u: float, v: float, pictures: Any) -> Any:
    """Radiance of a picture, which repeats, between its pixels."""
    rows, columns = s[LEVELS + 2], s[LEVELS + 3]
    x, y = u * s[LEVELS] + 0.5 * columns - 0.5, v * s[LEVELS] + 0.5 * rows - 0.5
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j
    i, j = i - columns * math.floor(i / columns), j - rows * math.floor(j / rows)
    i, j = min(max(i, 0.0), columns - 1.0), min(max(j, 0.0), rows - 1.0)  # of what is met nowhere
    below = s[LEVELS + 1] + columns * (j + 1.0 if j + 1.0 < rows else 0.0)
    row, beside = s[LEVELS + 1] + columns * j, i + 1.0 if i + 1.0 < columns else 0.0
    top = pictures[int(row + i)] * (1.0 - fx) + pictures[int(row + beside)] * fx
    low = pictures[int(below + i)] * (1.0 - fx) + pictures[int(below + beside)] * fx
    return top * (1.0 - fy) + low * fy


@kernel(inline=True)
def _on_plane(s: Any, hx: float, hy: float, ox: float, oy: float) -> Any:
    """Distance Z at which a ray meets a plane, FAR where it does not, and (u, v) there."""
    fall = s[NORMAL] * ox + s[NORMAL + 1] * oy + s[NORMAL + 2]
    height = s[NORMAL] * (hx - s[ORIGIN]) + s[NORMAL + 1] * (hy - s[ORIGIN + 1]) + s[NORMAL + 2] * s[ORIGIN + 2]
    z = height / (fall if fall > 0.0 else 1.0)
    dx, dy, dz = hx - ox * z - s[ORIGIN], hy - oy * z - s[ORIGIN + 1], s[ORIGIN + 2] - z
    u = s[ACROSS] * dx + s[ACROSS + 1] * dy + s[ACROSS + 2] * dz
    v = s[ALONG] * dx + s[ALONG + 1] * dy + s[ALONG + 2] * dz
    met = (fall > 0.0) & (abs(u) <= s[EXTENT]) & (abs(v) <= s[EXTENT + 1])
    return z if met else FAR, u, v


@kernel()
def _on_round(s: Any, hx: float, hy: float, ox: float, oy: float) -> Any:
    """As `_on_plane`, of a sphere's near side, a hollow one's far side, or a tube's wall behind its near end."""
    # Counted from the surface's own distance, where the numbers are small.
    rx, ry = hx - ox * s[ORIGIN + 2] - s[ORIGIN], hy - oy * s[ORIGIN + 2] - s[ORIGIN + 1]
    sphere = int(s[KIND]) == SPHERE
    a, b = ox * ox + oy * oy + (1.0 if sphere else 0.0), rx * ox + ry * oy
    c = rx * rx + ry * ry - s[EXTENT] * s[EXTENT]
    under = b * b - a * c
    if under < 0.0 or a == 0.0 or (c > 0.0 and not sphere):
        return FAR, 0.0, 0.0
    near = sphere and s[EXTENT] > 0.0
    z = s[ORIGIN + 2] + (b + (-math.sqrt(under) if near else math.sqrt(under))) / a
    dx, dy, dz = hx - ox * z - s[ORIGIN], hy - oy * z - s[ORIGIN + 1], s[ORIGIN + 2] - z
    if sphere:
        radius = abs(s[EXTENT])
        return z, radius * math.atan2(dx, dz if near else -dz), radius * math.asin(min(1.0, max(-1.0, dy / radius)))
    return z if z <= s[EXTENT + 1] else FAR, s[EXTENT] * math.atan2(dy, dx), z


@kernel(inline=True)
def _numbers(row: Any) -> Any:
    """A surface's numbers, of which the compiler knows that nothing is stored between them."""
    return (
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11], row[12],
        row[13], row[14], row[15], row[16], row[17], row[18], row[19],
    )  # fmt: skip


@kernel()
def look(
    rows: Any, pictures: Any, beyond: float, mirrored: Any, over: float, source: float, mouth: float, rays: Any, m: int
) -> None:  # fmt: skip
    """Radiance over `over` of what a block's rays (hx - ox Z, hy - oy Z) meet first beyond the bore's mouth.

    Distances are FAR, and numbers of surfaces -1, where they meet nothing.
    """
    way_x, way_y = mirrored[0], mirrored[1]
    for i in range(m):  # reversed along a direction of unit length; as they are along none
        along = 2.0 * (way_x * rays[X + i] + way_y * rays[Y + i])
        turned = 2.0 * (way_x * rays[SLOPE_X + i] + way_y * rays[SLOPE_Y + i])
        rays[X + i], rays[Y + i] = rays[X + i] - along * way_x, rays[Y + i] - along * way_y
        rays[SLOPE_X + i], rays[SLOPE_Y + i] = rays[SLOPE_X + i] - turned * way_x, rays[SLOPE_Y + i] - turned * way_y
        rays[NEAR + i], rays[HIT + i], rays[LIGHT + i], rays[U + i], rays[V + i] = FAR, -1.0, beyond - over, 0.0, 0.0
    for n in range(rows.shape[0]):
        s = _numbers(rows[n])
        if int(s[KIND]) == PLANE:
            for i in range(m):
                z, u, v = _on_plane(s, rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i])
                nearer = (z > mouth) & (z < rays[NEAR + i])
                rays[NEAR + i], rays[HIT + i] = z if nearer else rays[NEAR + i], 1.0 * n if nearer else rays[HIT + i]
                rays[U + i], rays[V + i] = u if nearer else rays[U + i], v if nearer else rays[V + i]
            continue
        for i in range(m):
            z, u, v = _on_round(s, rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i])
            if mouth < z < rays[NEAR + i]:
                rays[NEAR + i], rays[HIT + i], rays[U + i], rays[V + i] = z, 1.0 * n, u, v
    for n in range(rows.shape[0]):
        s, texture = _numbers(rows[n]), int(rows[n, LOOK])
        if texture == UNIFORM:
            for i in range(m):
                rays[LIGHT + i] = s[LEVELS] - over if rays[HIT + i] == n else rays[LIGHT + i]
        elif texture == CHECKERBOARD:
            for i in range(m):
                light = _checkered(s, rays[U + i], rays[V + i]) - over
                rays[LIGHT + i] = light if rays[HIT + i] == n else rays[LIGHT + i]
        elif texture == SINUSOID:
            for i in range(m):
                light = _waved(s, rays[U + i], rays[V + i]) - over
                rays[LIGHT + i] = light if rays[HIT + i] == n else rays[LIGHT + i]
        else:
            for i in range(m):
                light = _pictured(s, rays[U + i], rays[V + i], pictures) - over
                rays[LIGHT + i] = light if rays[HIT + i] == n else rays[LIGHT + i]
    if source > 0.0:
        for i in range(m):
            lit = source / (rays[NEAR + i] - mouth) if rays[HIT + i] >= 0.0 else 1.0
            rays[LIGHT + i] = (rays[LIGHT + i] + over) * lit * lit - over


def met(surfaces: Surfaces, mouth: float, rays: Floats) -> tuple[Floats, Floats]:
    """Distances Z of what rays meet first beyond the bore's mouth [mm], inf where they meet nothing; and its radiance.

    Parameters
    ----------
    mouth : float
        Z [mm].
    rays : ndarray, shape (N, 4)
        (h_x, h_y, o_x, o_y) of rays at ``h - o Z``.
    """
    block, answers = np.zeros((BLOCK_ROWS, BLOCK)), []
    for start in range(0, len(rays), BLOCK):
        some = np.asarray(rays[start : start + BLOCK], float)
        block[: some.shape[1], : len(some)] = some.T
        look.compiled(*surfaces, mouth, block.reshape(-1), len(some))
        answers.append(block[[NEAR // BLOCK, LIGHT // BLOCK], : len(some)])
    near, light = np.concatenate(answers, axis=1) if answers else np.empty((2, 0))
    return np.where(near < FAR, near, np.inf), light


def seen_distances(scene: Scene, camera: Camera, rays: Floats) -> Floats:
    """Distances Z at which rays of a camera, as `met` takes them, meet a scene first [mm]."""
    surfaces = encode(scene, float(camera["main_lens.focal_plane"]), camera.chain.mirrored)
    return met(surfaces, float(camera.tip), rays)[0]
