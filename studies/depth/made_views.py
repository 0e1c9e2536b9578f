"""Light fields rendered for measuring depth estimators: grids of cameras before analytic scenes, exact disparities.

Nothing of the package takes part. Lengths are pixels of the middle view at the plane that does not move; rays go from
each camera through 4 x 4 points of each pixel to parallelograms and ellipsoids; texture is noise in several octaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FAR = 400.0
"""Distance from the cameras to the plane that does not move [px]."""
BASE = 8.0
"""Distance from camera to camera [px]: a point at distance Z moves by BASE (FAR/Z - 1) from view to view."""
SAMPLES = 4
"""Rays along each side of a pixel."""
SUN = np.array([-0.4, -0.5, -0.76])
"""Direction to the light, unit length about."""


class Texture(NamedTuple):
    """Albedo of a surface: a mean, and noise of the same contrast in each octave of its detail."""

    mean: float = 0.5
    contrast: float = 0.12
    """Rms of each octave, against the mean."""
    finest: float = 3.0
    """Period of the finest octave [px]."""
    octaves: int = 4
    patchy: float = 0.0
    """Share of the contrast that comes and goes over the surface."""


class Thing(NamedTuple):
    """A parallelogram c + a p + b q for |a|, |b| <= 1, or an ellipsoid c + a p + b q + e r on the unit sphere."""

    c: Floats
    p: Floats
    q: Floats
    r: Floats | None
    texture: Texture
    seed: int


@dataclass(frozen=True, eq=False)
class MadeViews:
    """A rendered light field."""

    views: NDArray[np.float32]
    """Grey values from 0 to 255, shape (t, s, v, u)."""
    disparity: Floats
    """How far what the middle view sees moves to the left from view to view [px], shape (v, u)."""


def at(x: float, y: float, disparity: float) -> Floats:
    """Place that the middle view sees at (x, y) px from its middle and that moves so far."""
    depth = FAR / (1 + disparity / BASE)
    return np.array([x * depth / FAR, y * depth / FAR, depth])


def wall(disparity: float, texture: Texture, seed: int, lean: tuple[float, float] = (0.0, 0.0)) -> Thing:
    """Plane that fills the picture, with a slope of its disparity across it and down [px over the picture's half]."""
    c = at(0, 0, disparity)
    nearer = [at(128, 0, disparity + lean[0]) - c, at(0, 128, disparity + lean[1]) - c]
    return Thing(c, 4 * nearer[0], 4 * nearer[1], None, texture, seed)


def card(
    x: float, y: float, disparity: float, half: tuple[float, float], texture: Texture, seed: int, turned: float = 0.0,
    lean: tuple[float, float] = (0.0, 0.0),
) -> Thing:  # fmt: skip
    """Parallelogram about (x, y), turned in the picture, with disparities `lean` more at its sides."""
    c, co, si = at(x, y, disparity), math.cos(turned), math.sin(turned)
    p = at(x + half[0] * co, y + half[0] * si, disparity + lean[0]) - c
    q = at(x - half[1] * si, y + half[1] * co, disparity + lean[1]) - c
    return Thing(c, p, q, None, texture, seed)


def ball(x: float, y: float, disparity: float, half: tuple[float, float, float], texture: Texture, seed: int) -> Thing:
    """Ellipsoid about (x, y) with its axes along x, y and z."""
    half_axes = np.diag(half)
    return Thing(at(x, y, disparity), half_axes[0], half_axes[1], half_axes[2], texture, seed)


def box(x: float, y: float, disparity: float, half: float, texture: Texture, seed: int, turned: float) -> list[Thing]:
    """Cube, turned about the vertical and tipped forward."""
    co, si = math.cos(turned), math.sin(turned)
    tip = np.array([[1, 0, 0], [0, 0.9, -0.436], [0, 0.436, 0.9]])
    sides = half * (np.array([[co, 0, si], [0, 1, 0], [-si, 0, co]]) @ tip.T)
    c = at(x, y, disparity)
    return [
        Thing(c + side * sides[k], sides[(k + 1) % 3], sides[(k + 2) % 3], None, texture, seed + 7 * k + (side > 0))
        for k in range(3)
        for side in (-1, 1)
    ]


@njit(inline="always")
def _hash(i: int, j: int, seed: int) -> float:
    n = (i * 374761393 + j * 668265263 + seed * 1274126177) & 0x7FFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0x7FFFFFFF
    n = ((n ^ (n >> 15)) * 2246822519) & 0x7FFFFFFF
    return ((n ^ (n >> 16)) & 0xFFFFF) / 524287.5 - 1.0


@njit(inline="always")
def _noise(a: float, b: float, seed: int) -> float:
    """Noise of unit rms, about, with a period of two lattice steps."""
    i, j = math.floor(a), math.floor(b)
    f, g = a - i, b - j
    f, g = f * f * f * (f * (6 * f - 15) + 10), g * g * g * (g * (6 * g - 15) + 10)
    i, j = int(i), int(j)
    low = (1 - f) * _hash(i, j, seed) + f * _hash(i + 1, j, seed)
    high = (1 - f) * _hash(i, j + 1, seed) + f * _hash(i + 1, j + 1, seed)
    return 2.4 * ((1 - g) * low + g * high)


@njit(inline="always")
def _albedo(a: float, b: float, kind: Floats, seed: int) -> float:
    total, step = 0.0, kind[2] / 2
    for octave in range(int(kind[3])):
        total += _noise(a / step + 17.3 * octave, b / step + 5.7 * octave, seed + 101 * octave)
        step *= 2
    there = 0.5 + 0.5 * math.tanh(3 * _noise(a / 40, b / 40, seed + 999))
    return float(max(kind[0] * (1 + kind[1] * (1 - kind[4] * (1 - there)) * total), 0.02))


@njit(parallel=True)
def _view(s: float, t: float, size: int, shapes: Floats, kinds: Floats, seeds: NDArray[np.int64], aa: int, sun: Floats,
          out: Floats, moves: Floats) -> None:  # fmt: skip
    middle = (size - 1) / 2
    for row in prange(size):
        for column in range(size):
            total = 0.0
            for k in range(aa * aa):
                x = column - middle + ((k % aa) + 0.5) / aa - 0.5 - s * BASE
                y = row - middle + ((k // aa) + 0.5) / aa - 0.5 - t * BASE
                dx, dy = x / FAR, y / FAR
                nearest, what, at_a, at_b, lit = 1e30, -1, 0.0, 0.0, 0.0
                for n in range(shapes.shape[0]):
                    m = shapes[n]  # inverse of (p, q, r): a = m0 (X - c), b = m1, e = m2
                    ox, oy, oz = s * BASE - m[9], t * BASE - m[10], -m[11]
                    oa, ob, oe = (
                        m[0] * ox + m[1] * oy + m[2] * oz,
                        m[3] * ox + m[4] * oy + m[5] * oz,
                        m[6] * ox + m[7] * oy + m[8] * oz,
                    )
                    da, db, de = (
                        m[0] * dx + m[1] * dy + m[2],
                        m[3] * dx + m[4] * dy + m[5],
                        m[6] * dx + m[7] * dy + m[8],
                    )
                    if m[12] > 0:  # ellipsoid
                        aa2, half, rest = (
                            da * da + db * db + de * de,
                            oa * da + ob * db + oe * de,
                            oa * oa + ob * ob + oe * oe - 1,
                        )
                        inside = half * half - aa2 * rest
                        if inside <= 0:
                            continue
                        z = (-half - math.sqrt(inside)) / aa2
                        a, b, e = oa + z * da, ob + z * db, oe + z * de
                    else:
                        if de == 0:
                            continue
                        z = -oe / de
                        a, b, e = oa + z * da, ob + z * db, 1.0
                        if abs(a) > 1 or abs(b) > 1:
                            continue
                    if not 1 < z < nearest:
                        continue
                    nearest, what = z, n
                    if m[12] > 0:
                        nx, ny, nz = (
                            a * m[0] + b * m[3] + e * m[6],
                            a * m[1] + b * m[4] + e * m[7],
                            a * m[2] + b * m[5] + e * m[8],
                        )
                        at_a, at_b = math.atan2(a, -e) * m[13], math.asin(min(max(b, -1.0), 1.0)) * m[14]
                    else:
                        nx, ny, nz = m[6], m[7], m[8]
                        at_a, at_b = a * m[13], b * m[14]
                    shade = (nx * sun[0] + ny * sun[1] + nz * sun[2]) / math.sqrt(nx * nx + ny * ny + nz * nz)
                    lit = 0.45 + 0.55 * (abs(shade) if m[12] == 0 else max(shade, 0.0))
                if what >= 0:
                    total += lit * _albedo(at_a, at_b, kinds[what], seeds[what])
                    if aa == 1:
                        moves[row, column] = BASE * (FAR / nearest - 1)
            out[row, column] = total / (aa * aa)


def rendered(things: list[Thing], size: int = 256, across: int = 9, noise: float = 0.5, seed: int = 0) -> MadeViews:
    """Grid of views of a scene, with noise [grey levels], rounded to 8 bits; disparities at pixels' middles."""
    shapes, kinds = np.zeros((len(things), 15)), np.array([thing.texture for thing in things], float)
    for shape, thing in zip(shapes, things, strict=True):
        third = np.cross(thing.p, thing.q) if thing.r is None else thing.r
        shape[:9] = np.linalg.inv(np.stack([thing.p, thing.q, third], axis=1)).ravel()
        shape[9:12], shape[12] = thing.c, thing.r is not None
        shape[13:] = np.linalg.norm(thing.p), np.linalg.norm(thing.q)
    seeds = np.array([thing.seed for thing in things])
    views, moves = np.zeros((across, across, size, size)), np.zeros((size, size))
    places = np.arange(across) - (across - 1) / 2
    for row, t in enumerate(places):
        for column, s in enumerate(places):
            _view(s, t, size, shapes, kinds, seeds, SAMPLES, SUN, views[row, column], moves)
    unused = np.zeros((size, size))
    _view(0.0, 0.0, size, shapes, kinds, seeds, 1, SUN, unused, moves)
    grey = 255 * views + np.random.default_rng(seed).normal(0, noise, views.shape) if noise else 255 * views
    return MadeViews(np.clip(np.rint(grey), 0, 255).astype(np.float32), moves)


# --- scenes -----------------------------------------------------------------------------------------------------------

Layout = Callable[[np.random.Generator], list[Thing]]
SCENES: dict[str, Layout] = {}


def _scene(function: Layout) -> Layout:
    SCENES[function.__name__] = function
    return function


def _texture(random: np.random.Generator, weak: float = 0.3) -> Texture:
    """Surface as indoor scenes have them: some share of them with little texture."""
    little = random.random() < weak
    contrast = random.uniform(0.02, 0.04) if little else random.uniform(0.05, 0.12)
    return Texture(random.uniform(0.25, 0.75), contrast, random.uniform(2.5, 4.0), 4, random.uniform(0.0, 0.8))


@_scene
def boxes(random: np.random.Generator) -> list[Thing]:
    """Cubes on a floor before a wall."""
    seed = int(random.integers(1 << 20))
    things = [wall(-1.6, _texture(random), seed, (random.uniform(-0.2, 0.2), 0.0))]
    things.append(card(0, 120, 0.2, (400, 80), _texture(random), seed + 1, lean=(0.0, 1.6)))
    for k in range(5):
        x, y = random.uniform(-110, 110), random.uniform(-60, 80)
        things += box(x, y, random.uniform(-0.9, 1.2), random.uniform(18, 34), _texture(random), seed + 50 * k + 9,
                      random.uniform(0, 1.5))  # fmt: skip
    return things


@_scene
def cotton(random: np.random.Generator) -> list[Thing]:
    """Round forms before a wall, smoothly shaded."""
    seed = int(random.integers(1 << 20))
    things = [wall(-1.4, _texture(random), seed)]
    for k, (x, y, d, half) in enumerate(((0, -40, 0.7, (46, 58, 40)), (0, 110, 0.2, (100, 70, 50)),
                                         (-95, 30, -0.6, (30, 70, 30)))):  # fmt: skip
        right, down = x + random.uniform(-12, 12), y + random.uniform(-12, 12)
        things.append(ball(right, down, d, half, _texture(random, 0.5), seed + k + 1))
    return things


@_scene
def poles(random: np.random.Generator) -> list[Thing]:
    """Thin bars before slanted planes."""
    seed = int(random.integers(1 << 20))
    things = [wall(-0.8, _texture(random), seed, (random.uniform(-0.7, 0.7), random.uniform(-0.7, 0.7)))]
    things += [
        card(
            random.uniform(-120, 120),
            random.uniform(-60, 60),
            random.uniform(0.2, 1.6),
            (random.uniform(2.5, 7.0), random.uniform(60, 200)),
            _texture(random),
            seed + k + 1,
            random.uniform(-0.7, 0.7) + (k % 2) * 1.57,
        )
        for k in range(8)
    ]
    return things


@_scene
def pyramids(random: np.random.Generator) -> list[Thing]:
    """Balls and cubes of many sizes, half sunk in a plane."""
    seed = int(random.integers(1 << 20))
    texture = Texture(0.5, 0.09, 3.0, 4, 0.4)
    things = [wall(0.0, texture, seed)]
    for k in range(9):
        x, y = 84 * (k % 3 - 1) + random.uniform(-9, 9), 84 * (k // 3 - 1) + random.uniform(-9, 9)
        half = 12 + 2.5 * k
        if k % 2:
            things.append(ball(x, y, 0.0, (half, half, 1.6 * half), texture, seed + k + 1))
        else:
            things += box(x, y, 0.05, 0.6 * half, texture, seed + 50 * k, random.uniform(0, 1.5))
    return things


# Layouts of those kept back.


@_scene
def backgammon(random: np.random.Generator) -> list[Thing]:
    """Spikes that come nearer, before a plane that goes away: gaps of all widths."""
    seed = int(random.integers(1 << 20))
    texture = Texture(0.5, 0.08, 3.0, 4, 0.5)
    things = [wall(-0.4, texture, seed, (0.0, -1.0))]
    for k in range(7):
        x = 36 * (k - 3) + random.uniform(-3, 3)
        things += [
            card(x + 4 * side, 0, 0.6, (5, 116), texture, seed + 2 * k + side + 2, 0.035 * side, lean=(0.0, 0.8))
            for side in (-1, 1)
        ]
    return things


@_scene
def sideboard(random: np.random.Generator) -> list[Thing]:
    """A shelf: upright boards with things between, pictures on the wall."""
    seed = int(random.integers(1 << 20))
    things = [wall(-1.3, _texture(random), seed, (0.3, 0.0))]
    for k, shelf in enumerate((-30, 50, 118)):
        things.append(card(0, shelf, 0.0, (118, 4), _texture(random), seed + k + 1, random.uniform(-0.03, 0.03)))
        things.append(card(0, shelf - 10, -0.6, (118, 14), _texture(random), seed + k + 11, lean=(0.0, 0.7)))
    for k in range(9):
        half = random.uniform(7, 15), random.uniform(14, 30)
        x, y, d = -104 + 26 * k, (18 if k % 2 else 86) - half[1] + random.uniform(8, 14), random.uniform(-0.7, 0.3)
        if k % 3:
            things.append(card(x, y, d, half, _texture(random), seed + k + 21, random.uniform(-0.2, 0.2),
                               (random.uniform(-0.3, 0.3), 0.0)))  # fmt: skip
        else:
            things.append(ball(x, y, d, (half[0], half[1], half[0]), _texture(random), seed + k + 21))
    things += [
        card(-70 + 70 * k, -88, -1.2, (24, 26), _texture(random), seed + k + 41, random.uniform(-0.1, 0.1))
        for k in range(3)
    ]
    return things


@_scene
def dino(random: np.random.Generator) -> list[Thing]:
    """A body with limbs on a slanted floor, in a corner of two walls."""
    seed = int(random.integers(1 << 20))
    things = [wall(-1.0, _texture(random), seed, (0.9, 0.0)), wall(-1.0, _texture(random), seed + 1, (-1.1, 0.0)),
              card(0, 100, 0.6, (300, 70), _texture(random), seed + 2, lean=(0.0, 1.1))]  # fmt: skip
    for k, (x, y, d, half) in enumerate((
        (-10, 0, 0.5, (60, 34, 34)), (66, -36, 0.7, (24, 20, 20)), (42, -18, 0.6, (34, 11, 11)),
        (-82, 10, 0.4, (44, 8, 8)), (-40, 44, 0.8, (9, 42, 9)), (24, 44, 0.9, (8, 40, 8)), (-18, 40, 0.1, (8, 38, 8)),
    )):  # fmt: skip
        things.append(
            ball(x + random.uniform(-5, 5), y + random.uniform(-5, 5), d, half, _texture(random), seed + 9 + k)
        )
    return things


@_scene
def stripes(random: np.random.Generator) -> list[Thing]:
    """Stripes with more and less contrast, at small steps of disparity."""
    seed = int(random.integers(1 << 20))
    things = [wall(-0.5, Texture(0.45, 0.07, 3.0, 4, 0.3), seed)]
    for k in range(9):
        contrast = (0.02, 0.04, 0.1)[k % 3]
        things.append(card(-112 + 28 * k, random.uniform(-30, 30), 0.1 + 0.1 * (k % 4), (3.0 + 0.8 * k, 90),
                           Texture(random.uniform(0.3, 0.7), contrast, 3.0, 4, 0.3), seed + k + 1,
                           random.uniform(-0.05, 0.05)))  # fmt: skip
    return things


# Layouts kept back since those above were looked at.


@_scene
def leaves(random: np.random.Generator) -> list[Thing]:
    """Flat, leaning leaves at all depths before a far wall."""
    seed = int(random.integers(1 << 20))
    things = [wall(-1.5, _texture(random), seed, (0.0, 0.3))]
    for k in range(22):
        half = random.uniform(10, 26), random.uniform(5, 12)
        lean = random.uniform(-0.3, 0.3), random.uniform(-0.2, 0.2)
        things.append(card(random.uniform(-120, 120), random.uniform(-120, 120), random.uniform(-1.1, 1.3), half,
                           _texture(random), seed + k + 1, random.uniform(0, 3.1), lean))  # fmt: skip
    return things


@_scene
def stairs(random: np.random.Generator) -> list[Thing]:
    """Steps that come nearer downwards, with a rail before them."""
    seed = int(random.integers(1 << 20))
    things = [wall(-1.6, _texture(random), seed)]
    for k in range(7):
        y, d = -96 + 34 * k, -1.2 + 0.35 * k
        things.append(card(0, y, d, (400, 12), _texture(random), seed + 2 * k + 1))
        things.append(card(0, y - 18, d - 0.15, (400, 7), _texture(random), seed + 2 * k + 2, lean=(0.0, 0.15)))
    for k in range(4):
        x = -96 + 64 * k + random.uniform(-8, 8)
        things.append(card(x, 0, 1.5, (4, 150), _texture(random), seed + k + 31, random.uniform(-0.1, 0.1)))
    return things


@_scene
def bottles(random: np.random.Generator) -> list[Thing]:
    """Bodies with necks, in two rows on a table before a wall that goes away."""
    seed = int(random.integers(1 << 20))
    things = [wall(-1.2, _texture(random), seed, (0.5, 0.0)),
              card(0, 96, 0.2, (300, 60), _texture(random), seed + 1, lean=(0.0, 1.2))]  # fmt: skip
    for k in range(7):
        x, front = -96 + 32 * k + random.uniform(-5, 5), k % 2
        y, d, wide = 40 + 30 * front, -0.4 + 0.9 * front + random.uniform(-0.1, 0.1), random.uniform(12, 19)
        things.append(ball(x, y, d, (wide, 38, wide), _texture(random), seed + 3 * k + 5))
        things.append(ball(x, y - 44, d, (0.35 * wide, 26, 0.35 * wide), _texture(random), seed + 3 * k + 6))
    return things


@_scene
def tiles(random: np.random.Generator) -> list[Thing]:
    """A mosaic of tiles that each lean their own way, with gaps to a ground behind."""
    seed = int(random.integers(1 << 20))
    things = [wall(-0.9, _texture(random), seed)]
    for k in range(25):
        x, y = 52 * (k % 5 - 2) + random.uniform(-3, 3), 52 * (k // 5 - 2) + random.uniform(-3, 3)
        lean = random.uniform(-0.4, 0.4), random.uniform(-0.4, 0.4)
        half = random.uniform(17, 23), random.uniform(17, 23)
        things.append(card(x, y, random.uniform(-0.4, 0.8), half, _texture(random), seed + k + 1,
                           random.uniform(-0.3, 0.3), lean))  # fmt: skip
    return things


TRAINING = "boxes", "cotton", "poles", "pyramids"
SEEN = "backgammon", "sideboard", "dino", "stripes"
"""Kept back once, and looked at."""
KEPT_BACK = "leaves", "stairs", "bottles", "tiles"


def made(name: str, seed: int, size: int = 256, across: int = 9) -> MadeViews:
    """A light field by its scene's name."""
    return rendered(SCENES[name](np.random.default_rng(seed)), size, across, seed=seed)
