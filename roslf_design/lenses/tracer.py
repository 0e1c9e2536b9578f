"""Exact rays through stacks of refracting surfaces: builds times rays, either way, each with what became of it.

Rays are worked on in blocks that stay in the nearest cache; each surface is one pass over the block without branches,
so that the compiler can take several rays at once. A stopped ray goes along untouched: its state says where it ended.

A sphere or conic ``c (x^2 + y^2 + (1 + k) z^2) = 2 z`` meets the ray p + t d where ``A t^2 + 2 B t + C = 0``; the
root wanted is the one where the ray crosses towards the side it travels to. Written as C over the sum that does not
cancel, it is exact in the limit of a plane, c -> 0.
"""

from __future__ import annotations

import math
import sys
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel

Array = NDArray[np.float64]
Pair = tuple[ArrayLike, ArrayLike] | Array

BLOCK = 256
"""Rays in a block; seven rows of them are 14 kB."""
ROWS = 7
"""Of a block: position, direction, state."""

KEPT = 0
CLIPPED, MISSED, REFLECTED, NO_PLANE, INVALID, STOPPED = 1, 2, 3, 4, 5, 6
"""What stopped a ray; its state is eight times the number of the surface or stop (from 1; else 0) plus one of these."""
REASONS = {
    CLIPPED: "clipped at surface {}",
    MISSED: "missed surface {}",
    REFLECTED: "total internal reflection at surface {}",
    NO_PLANE: "never reaches the plane",
    STOPPED: "clipped at stop {}",
    INVALID: "not a ray (not finite, or its direction not of unit length)",
}

SPHERE, CONIC, ASPHERE = 1, 2, 3
COLUMNS = 26
"""Of a surface: vertex x y z, c, 1 + k, semi-diameter squared, kind, turned?, rotation (9), asphere (8), sag bound."""
UNIT_ERROR = 1e-9
SAMPLES = 64
OUT_OF_SIGHT = 2.0
"""Squared height told for a surface that a ray does not meet."""

CALL_ABOVE, LOAD_ABOVE, IMPORT_ABOVE = 5, 20_000, 50_000
"""Ray-surface meetings from which the compiled kernel pays: of one call where it is loaded, else of all calls so far,
where numba is imported already and where it is not.

Interpreted, one meeting takes some 7 us, a compiled call some 20 us more than its work; loading the kernel takes 0.1 s,
importing numba 0.4 s. Which of the two runs makes no difference to a single bit.
"""
_spent = [0]


def describe(state: int) -> str:
    """What a ray's state says: "kept", "clipped at surface 3"; surfaces count from 1 at the scene."""
    return "kept" if state == KEPT else REASONS[state % 8].format(state // 8)


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


class Traced(NamedTuple):
    """Where rays ended: on the plane asked for, on the last surface, or where they were stopped."""

    rays: Rays
    """Position and direction at the end, finite for every ray."""
    state: NDArray[np.int16]
    """0 for a ray that was kept, else what `describe` tells, (...)."""
    heights: Array | None
    """Squared heights over those of the clear apertures, (surfaces, ...), where asked for; 2 where not met."""

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Which rays came through, (...)."""
        return np.asarray(self.state == KEPT)

    @property
    def room(self) -> Array:
        """Least of 1 - r^2/semi-diameter^2 over the surfaces, (...); -1 or less where one was not met."""
        assert self.heights is not None
        return np.asarray(1 - np.max(self.heights, axis=0))


class Passed(NamedTuple):
    """Rays on the far side of a lens, told by where they cross a plane."""

    height: Array
    """(2, ...) [mm]; of a lost ray, where it ended."""
    slope: Array
    """dx/dz and dy/dz, (2, ...); 0 for a lost ray."""
    state: NDArray[np.int16]
    """What became of it (`describe`), (...)."""
    heights: Array
    """As `Traced` has them."""

    @property
    def room(self) -> Array:
        """As `Traced` has it."""
        return np.asarray(1 - np.max(self.heights, axis=0))


class SurfaceStack(NamedTuple):
    """T builds of a lens of S surfaces, as the kernels want them."""

    table: Array
    """`COLUMNS` numbers a surface, (T, S * COLUMNS)."""
    media: Array
    """Indices before, between and after the surfaces, (T, S + 1)."""

    def trace(
        self,
        rays: Rays,
        *,
        backward: bool = False,
        plane: ArrayLike | None = None,
        clip: bool = True,
        heights: bool = False,
    ) -> Traced:
        """Trace rays.

        Parameters
        ----------
        rays : Rays
            Anywhere on the side they come from, (3, ...); for more builds than one, (3, T, ...).
        backward : bool
            From the sensor's side to the scene's.
        plane : array_like, optional
            Carry kept rays on to this z [mm], one or (T,); else they end on the last surface.
        clip : bool
            Whether clear diameters stop rays.
        heights : bool
            Whether to give heights on the surfaces.
        """
        start, along = np.broadcast_arrays(np.asarray(rays.position, float), np.asarray(rays.direction, float))
        shape, builds, count = start.shape[1:], len(self.table), int(self.media.shape[1]) - 1
        if builds > 1 and shape[:1] != (builds,):
            raise ValueError(f"rays through {builds} builds need them as their first axis, got {shape}")
        total = math.prod(shape)
        position, direction, state = np.empty(3 * total), np.empty(3 * total), np.empty(total, np.int16)
        squares = np.empty(count * total * heights)
        planes = np.array(np.broadcast_to(math.nan if plane is None else np.asarray(plane, float), (builds,)))
        ins: list[Any] = [np.ascontiguousarray(part).reshape(-1) for part in (start, along, self.table, self.media)]
        arrays: list[Any] = [*ins, planes, np.empty(ROWS * BLOCK), np.empty(count * BLOCK)]
        arrays += [position, direction, state, squares]
        compiled = _pays(total * count)
        if not compiled:
            arrays = [memoryview(array) for array in arrays]  # plain floats out, not numpy's slow and noisy scalars
        run = trace_rays.compiled if compiled else trace_rays.interpreted
        run(total // builds, builds, count, backward, clip, plane is not None, *arrays)
        ended = Rays(position.reshape(3, *shape), direction.reshape(3, *shape))
        return Traced(ended, state.reshape(shape), squares.reshape(count, *shape) if heights else None)

    def through(
        self,
        height: Pair,
        slope: Pair,
        *,
        start: ArrayLike,
        end: ArrayLike,
        backward: bool = True,
        clip: bool = False,
    ) -> Passed:
        """Height and slope in, height and slope out.

        Parameters
        ----------
        height, slope : pairs of array_like, or ndarray (2, ...)
            Where rays cross the plane at `start` [mm], and dx/dz, dy/dz there, all broadcast; for more builds than one,
            (2, T, ...).
        start, end : array_like
            Planes along z, before and after the lens on the light's way [mm]: `start` broadcast against the rays, `end`
            one or (T,).
        backward : bool
            From the sensor's side to the scene's.
        clip : bool
            Whether clear diameters stop rays; otherwise only `Passed.room` tells.
        """
        x, y, z, sx, sy = np.broadcast_arrays(*(np.asarray(part, float) for part in (*height, start, *slope)))
        size = (-1.0 if backward else 1.0) * np.sqrt(1 + sx * sx + sy * sy)
        rays = Rays(np.stack([x, y, z]), np.stack([sx / size, sy / size, 1 / size]))
        found = self.trace(rays, backward=backward, plane=end, clip=clip, heights=True)
        assert found.heights is not None
        kept, way = found.kept, found.rays.direction
        out = np.where(kept, way[:2] / np.where(kept, way[2], 1.0), 0.0)
        return Passed(found.rays.position[:2], out, found.state, found.heights)


def _pays(meetings: int) -> bool:
    if trace_rays.ready:
        return meetings >= CALL_ABOVE
    _spent[0] += meetings
    return _spent[0] >= (LOAD_ABOVE if "numba" in sys.modules else IMPORT_ABOVE)


@kernel()
def copy(source: Any, target: Any, m: int) -> None:
    """Copy `m` numbers; slices as arguments, because only then does the compiler know that no index is negative."""
    for i in range(m):
        target[i] = source[i]


@kernel()
def load(position: Any, direction: Any, buffer: Any, start: int, m: int, n: int) -> None:
    """Copy a block in; what is not a ray (not finite, not of unit length) becomes a still one, marked invalid."""
    for row in range(3):
        begin = row * n + start
        copy(position[begin : begin + m], buffer[row * BLOCK : row * BLOCK + m], m)
        copy(direction[begin : begin + m], buffer[(3 + row) * BLOCK : (3 + row) * BLOCK + m], m)
    for i in range(m):
        x, y, z = buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i]
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        zero = (x - x) + (y - y) + (z - z)  # or nan
        good = zero + abs(dx * dx + dy * dy + dz * dz - 1.0) <= UNIT_ERROR
        buffer[i] = x if good else 0.0
        buffer[BLOCK + i] = y if good else 0.0
        buffer[2 * BLOCK + i] = z if good else 0.0
        buffer[3 * BLOCK + i] = dx if good else 0.0
        buffer[4 * BLOCK + i] = dy if good else 0.0
        buffer[5 * BLOCK + i] = dz if good else 1.0
        buffer[6 * BLOCK + i] = 0.0 if good else 1.0 * INVALID


@kernel()
def nearer_root(a: float, b: float, e: float, s: float) -> tuple[float, float, bool]:
    """Step to where a ray crosses a quadric in its own direction, root of the discriminant, and whether it does."""
    disc = b * b - a * e
    real = disc >= 0
    root = sqrt(disc if real else 0.0)
    same = b * s >= 0
    top = e if same else b - s * root
    bottom = b + s * root if same else a
    some = bottom != 0
    return top / (bottom if some else 1.0), root, real and some


@kernel()
def settle(
    hit: bool, r2: float, limit: float, nx: float, ny: float, nz: float, cosine: float, mu: float, s: float,
    dx: float, dy: float, dz: float, state: float, code: float,
) -> tuple[bool, float, float, float, float]:  # fmt: skip
    """End a visit to a surface of unit normal n: whether the ray moves there, its new direction and its new state."""
    square = 1.0 - mu * mu * (1.0 - cosine * cosine)
    inside, through = r2 <= limit, square >= 0
    moves = hit and state == 0
    goes = moves and inside and through
    bend = s * (sqrt(square if through else 0.0) - mu * cosine)
    fate = code + MISSED if not hit else (code + CLIPPED if not inside else (0.0 if through else code + REFLECTED))
    ex = mu * dx + bend * nx if goes else dx
    ey = mu * dy + bend * ny if goes else dy
    ez = mu * dz + bend * nz if goes else dz
    return moves, ex, ey, ez, fate if state == 0 else state


@kernel()
def meet_sphere(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at a sphere or plane; the cosine of incidence is the root of the discriminant."""
    vx, vy, vz, c = table[first], table[first + 1], table[first + 2], table[first + 3]
    for i in range(m):
        x, y, z = buffer[i] - vx, buffer[BLOCK + i] - vy, buffer[2 * BLOCK + i] - vz
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        near = -(x * dx + y * dy + z * dz)  # from here on, the point nearest the vertex: nothing far away cancels
        px, py, pz = x + near * dx, y + near * dy, z + near * dz
        b = dz - c * (px * dx + py * dy + pz * dz)
        e = c * (px * px + py * py + pz * pz) - 2.0 * pz
        step, root, met = nearer_root(c, b, e, s)
        hx, hy, hz = px + step * dx, py + step * dy, pz + step * dz
        nx, ny, nz = -c * hx, -c * hy, 1.0 - c * hz
        r2 = hx * hx + hy * hy
        hit = met and nz >= 0
        moves, ex, ey, ez, fate = settle(
            hit, r2, limit, nx, ny, nz, root, mu, s, dx, dy, dz, buffer[6 * BLOCK + i], code
        )  # fmt: skip
        buffer[i] = hx + vx if moves else x + vx
        buffer[BLOCK + i] = hy + vy if moves else y + vy
        buffer[2 * BLOCK + i] = hz + vz if moves else z + vz
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = ex, ey, ez
        buffer[6 * BLOCK + i] = fate
        squares[i] = r2 if hit else -1.0


@kernel()
def meet_conic(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at a conic of revolution."""
    vx, vy, vz, c, k1 = table[first], table[first + 1], table[first + 2], table[first + 3], table[first + 4]
    for i in range(m):
        x, y, z = buffer[i] - vx, buffer[BLOCK + i] - vy, buffer[2 * BLOCK + i] - vz
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        near = -(x * dx + y * dy + z * dz)
        px, py, pz = x + near * dx, y + near * dy, z + near * dz
        a = c * (dx * dx + dy * dy + k1 * (dz * dz))
        b = dz - c * (px * dx + py * dy + k1 * (pz * dz))
        e = c * (px * px + py * py + k1 * (pz * pz)) - 2.0 * pz
        step, root, met = nearer_root(a, b, e, s)
        hx, hy, hz = px + step * dx, py + step * dy, pz + step * dz
        nz = 1.0 - k1 * c * hz
        r2 = hx * hx + hy * hy
        size2 = c * c * r2 + nz * nz
        shrink = 1.0 / sqrt(size2 if size2 > 0 else 1.0)
        hit = met and nz >= 0
        moves, ex, ey, ez, fate = settle(
            hit, r2, limit, -c * hx * shrink, -c * hy * shrink, nz * shrink, root * shrink, mu, s,
            dx, dy, dz, buffer[6 * BLOCK + i], code,
        )  # fmt: skip
        buffer[i] = hx + vx if moves else x + vx
        buffer[BLOCK + i] = hy + vy if moves else y + vy
        buffer[2 * BLOCK + i] = hz + vz if moves else z + vz
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = ex, ey, ez
        buffer[6 * BLOCK + i] = fate
        squares[i] = r2 if hit else -1.0


@kernel()
def sag_and_slope(u: float, c: float, k1: float, table: Any, terms: int) -> tuple[float, float, bool]:
    """Sag, its derivative by u = r^2, and whether the surface exists there; `terms` is where a_1 stands in `table`."""
    inner = 1.0 - k1 * c * c * u
    if not inner > 0:
        return 0.0, 0.0, False
    root = sqrt(inner)
    q, dq = 0.0, 0.0
    for j in range(7, -1, -1):
        dq = dq * u + q
        q = q * u + table[terms + j]
    return c * u / (1.0 + root) + u * q, c / (2.0 * root) + q + u * dq, True


@kernel()
def newton_root(
    px: float, py: float, pz: float, dx: float, dy: float, dz: float, s: float, t: float, table: Any, first: int
) -> tuple[float, bool]:
    """Where a ray crosses an asphere in its own direction, from a first guess `t`; gives up rather than wander."""
    c, k1, tolerance = table[first + 3], table[first + 4], 1e-13 * sqrt(table[first + 5])
    for _ in range(30):
        x, y = px + t * dx, py + t * dy
        sag, slope, valid = sag_and_slope(x * x + y * y, c, k1, table, first + 17)
        rate = dz - 2.0 * slope * (x * dx + y * dy)
        if not (valid and rate * s > 0):
            return t, False
        step = (pz + t * dz - sag) / rate
        t -= step
        if abs(step) <= tolerance:
            return t, True
    return t, False


@kernel()
def scanned_root(
    px: float, py: float, pz: float, dx: float, dy: float, dz: float, s: float, table: Any, first: int
) -> tuple[float, bool]:
    """First crossing in the ray's own direction inside the clear aperture, by sampling and bisection; always ends."""
    c, k1, bound = table[first + 3], table[first + 4], table[first + 25]
    low, high = -1e300, 1e300
    across = dx * dx + dy * dy
    reach = table[first + 5] - (px * px + py * py)
    if across > 1e-24:
        along = px * dx + py * dy
        square = along * along + across * reach
        if not square > 0:
            return 0.0, False
        half = sqrt(square)
        low, high = (-along - half) / across, (-along + half) / across
    elif reach < 0:
        return 0.0, False
    if abs(dz) > 1e-12:
        one, other = (-bound - pz) / dz, (bound - pz) / dz
        low, high = max(low, min(one, other)), min(high, max(one, other))
    elif abs(pz) > bound:
        return 0.0, False
    if not low < high:
        return 0.0, False
    before, previous = False, low
    for j in range(SAMPLES + 1):
        t = low + (high - low) * j / SAMPLES
        x, y = px + t * dx, py + t * dy
        sag, _, valid = sag_and_slope(x * x + y * y, c, k1, table, first + 17)
        gap = s * (pz + t * dz - sag)
        if valid and before and gap > 0:
            for _ in range(64):
                middle = 0.5 * (previous + t)
                x, y = px + middle * dx, py + middle * dy
                sag, _, valid = sag_and_slope(x * x + y * y, c, k1, table, first + 17)
                if s * (pz + middle * dz - sag) > 0:
                    t = middle
                else:
                    previous = middle
            return 0.5 * (previous + t), True
        before, previous = valid and gap <= 0, t
    return 0.0, False


@kernel()
def meet_asphere(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at an even asphere."""
    vx, vy, vz, c, k1 = table[first], table[first + 1], table[first + 2], table[first + 3], table[first + 4]
    for i in range(m):
        x, y, z = buffer[i] - vx, buffer[BLOCK + i] - vy, buffer[2 * BLOCK + i] - vz
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        near = -(x * dx + y * dy + z * dz)
        px, py, pz = x + near * dx, y + near * dy, z + near * dz
        a = c * (dx * dx + dy * dy + k1 * (dz * dz))
        b = dz - c * (px * dx + py * dy + k1 * (pz * dz))
        e = c * (px * px + py * py + k1 * (pz * pz)) - 2.0 * pz
        disc = b * b - a * e
        bottom = b + s * sqrt(disc if disc > 0 else 0.0)
        guess = e / bottom if bottom * s > 0 else 0.0  # where the conic under the asphere is met
        t, found = newton_root(px, py, pz, dx, dy, dz, s, guess, table, first)
        if not found:
            t, found = scanned_root(px, py, pz, dx, dy, dz, s, table, first)
        hx, hy, hz = px + t * dx, py + t * dy, pz + t * dz
        r2 = hx * hx + hy * hy
        _, slope, valid = sag_and_slope(r2, c, k1, table, first + 17)
        nx, ny = -2.0 * slope * hx, -2.0 * slope * hy
        shrink = 1.0 / sqrt(nx * nx + ny * ny + 1.0)
        cosine = s * (dx * nx + dy * ny + dz) * shrink
        hit = found and valid and cosine >= 0
        moves, ex, ey, ez, fate = settle(
            hit, r2, limit, nx * shrink, ny * shrink, shrink, cosine, mu, s, dx, dy, dz, buffer[6 * BLOCK + i], code
        )  # fmt: skip
        buffer[i] = hx + vx if moves else x + vx
        buffer[BLOCK + i] = hy + vy if moves else y + vy
        buffer[2 * BLOCK + i] = hz + vz if moves else z + vz
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = ex, ey, ez
        buffer[6 * BLOCK + i] = fate
        squares[i] = r2 if hit else -1.0


@kernel()
def turn(buffer: Any, m: int, table: Any, first: int, into: bool) -> None:
    """Turn a block about a surface's vertex, into the surface's own axes or back."""
    vx, vy, vz = table[first], table[first + 1], table[first + 2]
    xx, xy, xz = table[first + 8], table[first + 9], table[first + 10]
    yx, yy, yz = table[first + 11], table[first + 12], table[first + 13]
    zx, zy, zz = table[first + 14], table[first + 15], table[first + 16]
    if into:
        xy, xz, yx, yz, zx, zy = yx, zx, xy, zy, xz, yz
    for i in range(m):
        x, y, z = buffer[i] - vx, buffer[BLOCK + i] - vy, buffer[2 * BLOCK + i] - vz
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        buffer[i] = xx * x + xy * y + xz * z + vx
        buffer[BLOCK + i] = yx * x + yy * y + yz * z + vy
        buffer[2 * BLOCK + i] = zx * x + zy * y + zz * z + vz
        buffer[3 * BLOCK + i] = xx * dx + xy * dy + xz * dz
        buffer[4 * BLOCK + i] = yx * dx + yy * dy + yz * dz
        buffer[5 * BLOCK + i] = zx * dx + zy * dy + zz * dz


@kernel()
def pass_surfaces(
    buffer: Any, m: int, table: Any, media: Any, count: int, backward: bool, clip: bool, squares: Any
) -> None:
    """Carry a block of rays through one lens; `squares` gets r^2 about each surface's axis, -1 where not met."""
    s = -1.0 if backward else 1.0
    for j in range(count):
        k = count - 1 - j if backward else j
        first = k * COLUMNS
        before, after = (media[k + 1], media[k]) if backward else (media[k], media[k + 1])
        kind, code, mu = int(table[first + 6]), 8.0 * (k + 1), before / after
        limit = table[first + 5] if clip else 1e300
        turned = table[first + 7] != 0
        mine = squares[k * BLOCK : k * BLOCK + m]
        if turned:
            turn(buffer, m, table, first, True)
        if kind == SPHERE:
            meet_sphere(buffer, mine, m, table, first, limit, mu, s, code)
        elif kind == CONIC:
            meet_conic(buffer, mine, m, table, first, limit, mu, s, code)
        else:
            meet_asphere(buffer, mine, m, table, first, limit, mu, s, code)
        if turned:
            turn(buffer, m, table, first, False)


@kernel()
def reach_plane(buffer: Any, m: int, z: float, s: float, code: float) -> None:
    """Carry a block straight on to the plane at `z`."""
    for i in range(m):
        dz = buffer[5 * BLOCK + i]
        alive = buffer[6 * BLOCK + i] == 0
        meets = dz * s > 0
        t = (z - buffer[2 * BLOCK + i]) / (dz if meets else 1.0)
        moves = alive and meets
        buffer[i] = buffer[i] + t * buffer[3 * BLOCK + i] if moves else buffer[i]
        buffer[BLOCK + i] = buffer[BLOCK + i] + t * buffer[4 * BLOCK + i] if moves else buffer[BLOCK + i]
        buffer[2 * BLOCK + i] = z if moves else buffer[2 * BLOCK + i]
        buffer[6 * BLOCK + i] = code + NO_PLANE if alive and not meets else buffer[6 * BLOCK + i]


@kernel()
def trace_rays(
    each: int, builds: int, count: int, backward: bool, clip: bool, to_plane: bool, position: Any, direction: Any,
    table: Any, media: Any, plane: Any, buffer: Any, squares: Any, out_position: Any, out_direction: Any, state: Any,
    heights: Any,
) -> None:  # fmt: skip
    """Trace `each` rays through each build of `count` surfaces; `heights` is filled where it is not empty.

    All arrays are flat, components one after the other; `buffer` and `squares` are room to work.
    """
    n = each * builds
    for build in range(builds):
        lens = table[build * count * COLUMNS : (build + 1) * count * COLUMNS]
        index = media[build * (count + 1) : (build + 1) * (count + 1)]
        for start in range(build * each, (build + 1) * each, BLOCK):
            m = min(BLOCK, (build + 1) * each - start)
            load(position, direction, buffer, start, m, n)
            pass_surfaces(buffer, m, lens, index, count, backward, clip, squares)
            if to_plane:
                reach_plane(buffer, m, plane[build], -1.0 if backward else 1.0, 8.0 * (count + 1))
            if len(heights) > 0:
                for k in range(count):
                    semi2, mine = lens[k * COLUMNS + 5], squares[k * BLOCK : k * BLOCK + m]
                    out = heights[k * n + start : k * n + start + m]
                    for i in range(m):
                        out[i] = mine[i] / semi2 if mine[i] >= 0 else OUT_OF_SIGHT
            for row in range(3):
                begin = row * n + start
                copy(buffer[row * BLOCK : row * BLOCK + m], out_position[begin : begin + m], m)
                copy(buffer[(3 + row) * BLOCK : (3 + row) * BLOCK + m], out_direction[begin : begin + m], m)
            states = state[start : start + m]
            for i in range(m):
                states[i] = int(buffer[6 * BLOCK + i])
