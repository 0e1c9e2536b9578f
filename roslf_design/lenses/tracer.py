"""Exact rays through stacks of refracting surfaces: builds times rays, either way, each with what became of it.

Rays are worked on in blocks that stay in the nearest cache; each surface is one pass over the block without branches,
so that the compiler can take several rays at once. A stopped ray goes along untouched: its state says where it ended.

A sphere or conic ``c (x^2 + y^2 + (1 + k) z^2) = 2 z`` meets the ray p + t d where ``A t^2 + 2 B t + C = 0``; the
root wanted is the one where the ray crosses towards the side it travels to. Written as C over the sum that does not
cancel, it is exact in the limit of a plane, c -> 0.
"""

from __future__ import annotations

import math
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import COMPILED, kernel, soon_written
from ..fates import FATES, RayFate
from .angles import LAW_COLUMNS, first_order, stretch

Array = NDArray[np.float64]
Pair = tuple[ArrayLike, ArrayLike] | Array

BLOCK = 256
"""Most rays in a block; eight rows of them are 16 kB."""
PART, LINE = 64, 8
"""Rays that are traced between two visits to the memory, which works meanwhile, and numbers in a line of the cache."""
ROWS = 8
"""Rows of a block: position, direction, state, and room to work."""

CLIPPED, MISSED, REFLECTED = int(RayFate.CLIPPED), int(RayFate.MISSED), int(RayFate.REFLECTED)
NO_PLANE, INVALID = int(RayFate.NO_PLANE), int(RayFate.INVALID)
"""Fates as kernels take them; states count surfaces from 1 at the scene."""

SPHERE, CONIC, ASPHERE, IRREGULAR = 1, 2, 3, 4
THIN, ROD, MAPPED, MIRROR = 11, 12, 13, 14
"""Rows beside surfaces: an ideal lens, 1/f in place of the curvature; a rod from its sensor's side, with n_0 and g in
the places of curvature and conic, and its length in that of the first aspheric term; what a mapping makes of rays that
an ideal lens beside it has bent, with its focal length in the place of the conic, the way to the entrance pupil in that
of a rod's length, and the largest height that it images, f p, in that of the semi-diameter; a flat mirror in unfolded
space, whose tilt and shift move rays on its scene's side as `MOVED` says."""
COLUMNS = 34
"""Columns of a surface: vertex x y z, c, 1 + k, semi-diameter squared, kind, turned?, rotation (9), asphere (8), sag
bound, irregularity (7), one over its normalising radius."""
MODES, FORM = 7, 26
"""Zernike modes of an irregularity, Noll's 5 to 11, and where their coefficients stand."""
LENGTH, COARSE = 17, 18
"""Columns of a rod's length, and of whether rays through it are only for pixels."""
MOVED = 17
"""Where a mirror's turn about its vertex (9) and then its shift (3) of rays stand, from the sensor's side on."""
TERMS = 16
"""Terms of a rod's series."""
STEP, LONGEST = 0.1, 0.7
"""Steps in a rod's phase: a tenth of how far the series converges, and no longer than that; what is left out is some
1e-14 of a ray's height."""
KICK_ERROR = 1e-7
"""Error of a ray's height and slope for each step through a rod, where rays are for pixels."""
KICK_AT, KICK_APART = 0.5 - sqrt(3.0) / 6, sqrt(3.0) / 3
"""Shares of such a step at which rays are bent by what a rod has beyond a harmonic one: Gauss's two points."""
LANES = 32
"""Rays that go through a rod side by side."""
SAMPLES = 64

MEETING = 8e-6
"""Seconds that one meeting of a ray and a surface takes interpreted, to the same bits as compiled."""
THICK = 100
"""Meetings that take as long as a rod, about."""


def seconds_through(kinds: Array) -> float:
    """Seconds that a ray takes interpreted through surfaces of such kinds."""
    return MEETING * (kinds.size + THICK * int((kinds == ROD).sum()))


class Passed(NamedTuple):
    """Rays on the far side of a lens, told by where they cross a plane."""

    height: Array
    """(2, ...) [mm]; of a lost ray, where it ended."""
    slope: Array
    """dx/dz and dy/dz, (2, ...); 0 for a lost ray."""
    state: NDArray[np.int16]
    """State of the ray (`..fates`), (...)."""
    margin: Array
    """Least of 1 - r^2/semi-diameter^2 over the surfaces, (...); -1 or less for a stopped ray."""


class SurfaceStack(NamedTuple):
    """T builds of a lens of S surfaces, as the kernels want them."""

    table: Array
    """`COLUMNS` numbers a surface, then those of a mapping's law if there is one, (T, S * COLUMNS + L)."""
    media: Array
    """Indices before, between and after the surfaces, (T, S + 1)."""

    @property
    def radii(self) -> Array:
        """Semi-diameters, (T, S) [mm]."""
        count = int(self.media.shape[1]) - 1
        return np.asarray(np.sqrt(self.table[:, : count * COLUMNS].reshape(len(self.table), count, COLUMNS)[:, :, 5]))

    @property
    def seconds(self) -> float:
        """Seconds that a ray takes through it interpreted, about."""
        return seconds_through(self.table[:1, 6 : (self.media.shape[1] - 1) * COLUMNS : COLUMNS])

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
        """Trace rays by height and slope, which the answer gives on the far side.

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
            Whether clear diameters stop rays.
        """
        lines = [np.asarray(part, float) for part in (*height, start, *slope)]
        shape = np.broadcast_shapes(*(part.shape for part in lines))
        builds, count = len(self.table), int(self.media.shape[1]) - 1
        if builds > 1 and shape[:1] != (builds,):
            raise ValueError(f"rays through {builds} builds need them as their first axis, got {shape}")
        total = math.prod(shape)
        out, room, state = _room(4 * total).reshape(4, *shape), _room(total).reshape(shape), np.empty(shape, np.int16)
        planes = np.array(np.broadcast_to(np.asarray(end, float), (builds,)))
        # Writable, as a kernel is compiled once more for arrays that are not.
        spread = (np.broadcast_to(part, shape) if 1 < part.size < total else part for part in lines)
        spread = (np.full(min(PART, total), part.item()) if part.size == 1 < total else part for part in spread)
        given = (np.require(part, requirements=["C", "W"]) for part in (self.table, self.media, *spread))
        work = planes, _room(ROWS * BLOCK), _room(count * BLOCK)
        arrays: list[Any] = [part.reshape(-1) for part in (*given, *work, *out.reshape(4, total), room, state)]
        has_law = self.table.shape[1] > count * COLUMNS  # whose sines numpy and the compiler take a bit apart
        if has_law or _trace_slopes.pays(self.seconds * total):
            _trace_slopes.compiled(total // builds, builds, count, backward, clip, *arrays)
        else:  # plain floats out, not numpy's slow and noisy scalars
            _trace_slopes.interpreted(
                total // builds, builds, count, backward, clip, *[memoryview(array) for array in arrays]
            )
        return Passed(out[:2], out[2:], state, room)


def _room(count: int) -> Array:
    """Room for so many numbers from where a line of the cache begins: a vector of them lies in one."""
    room = np.empty(count + LINE - 1)
    start = -(room.ctypes.data // room.itemsize) % LINE
    return room[start : start + count]


@kernel()
def _near_vertex(buffer: Any, i: int, vx: float, vy: float, vz: float) -> tuple[float, float, float]:
    """Point of a ray nearest a vertex, from there: nothing far away cancels from here on."""
    x, y, z = buffer[i] - vx, buffer[BLOCK + i] - vy, buffer[2 * BLOCK + i] - vz
    dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
    near = -(x * dx + y * dy + z * dz)
    return x + near * dx, y + near * dy, z + near * dz


@kernel()
def _nearer_root(a: float, b: float, e: float, s: float) -> tuple[float, float, bool]:
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
def _refract(
    buffer: Any, squares: Any, i: int, vx: float, vy: float, vz: float, hx: float, hy: float, hz: float,
    nx: float, ny: float, nz: float, cosine: float, hit: bool, limit: float, mu: float, s: float, code: float,
) -> None:  # fmt: skip
    """End a ray's visit to a surface at h from its vertex, of unit normal n: move it there, bend it, or say why not."""
    dx, dy, dz, state = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i], buffer[6 * BLOCK + i]
    r2 = hx * hx + hy * hy
    square = 1.0 - mu * mu * (1.0 - cosine * cosine)
    inside, through = r2 <= limit, square >= 0
    moves = hit and state == 0
    goes = moves and inside and through
    bend = s * (sqrt(square if through else 0.0) - mu * cosine)
    fate = code + MISSED if not hit else (code + CLIPPED if not inside else (0.0 if through else code + REFLECTED))
    buffer[i] = hx + vx if moves else buffer[i]
    buffer[BLOCK + i] = hy + vy if moves else buffer[BLOCK + i]
    buffer[2 * BLOCK + i] = hz + vz if moves else buffer[2 * BLOCK + i]
    buffer[3 * BLOCK + i] = mu * dx + bend * nx if goes else dx
    buffer[4 * BLOCK + i] = mu * dy + bend * ny if goes else dy
    buffer[5 * BLOCK + i] = mu * dz + bend * nz if goes else dz
    buffer[6 * BLOCK + i] = fate if state == 0 else state
    squares[i] = r2 if hit else -1.0


@kernel()
def _meet_sphere(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at a sphere or plane; the cosine of incidence is the root of the discriminant."""
    vx, vy, vz, c = table[first], table[first + 1], table[first + 2], table[first + 3]
    for i in range(m):
        px, py, pz = _near_vertex(buffer, i, vx, vy, vz)
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        b = dz - c * (px * dx + py * dy + pz * dz)
        e = c * (px * px + py * py + pz * pz) - 2.0 * pz
        step, root, met = _nearer_root(c, b, e, s)
        hx, hy, hz = px + step * dx, py + step * dy, pz + step * dz
        nz = 1.0 - c * hz
        hit = met and nz >= 0
        _refract(buffer, squares, i, vx, vy, vz, hx, hy, hz, -c * hx, -c * hy, nz, root, hit, limit, mu, s, code)


@kernel()
def _meet_plane(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at a plane: as a sphere without curvature, with one root less."""
    vx, vy, vz = table[first], table[first + 1], table[first + 2]
    for i in range(m):
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        hit = dz * s > 0
        step = (vz - buffer[2 * BLOCK + i]) / (dz if hit else 1.0)
        hx, hy = buffer[i] - vx + step * dx, buffer[BLOCK + i] - vy + step * dy
        _refract(buffer, squares, i, vx, vy, vz, hx, hy, 0.0, 0.0, 0.0, 1.0, dz * s, hit, limit, mu, s, code)


@kernel()
def _conic_terms(
    px: float, py: float, pz: float, dx: float, dy: float, dz: float, c: float, k1: float
) -> tuple[float, float, float]:
    """A, B and C of where a ray meets a conic of revolution."""
    a = c * (dx * dx + dy * dy + k1 * (dz * dz))
    b = dz - c * (px * dx + py * dy + k1 * (pz * dz))
    return a, b, c * (px * px + py * py + k1 * (pz * pz)) - 2.0 * pz


@kernel()
def _meet_conic(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at a conic of revolution."""
    vx, vy, vz, c, k1 = table[first], table[first + 1], table[first + 2], table[first + 3], table[first + 4]
    for i in range(m):
        px, py, pz = _near_vertex(buffer, i, vx, vy, vz)
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        a, b, e = _conic_terms(px, py, pz, dx, dy, dz, c, k1)
        step, root, met = _nearer_root(a, b, e, s)
        hx, hy, hz = px + step * dx, py + step * dy, pz + step * dz
        nx, ny, nz = -c * hx, -c * hy, 1.0 - k1 * c * hz
        size2 = nx * nx + ny * ny + nz * nz
        shrink = 1.0 / sqrt(size2 if size2 > 0 else 1.0)
        hit = met and nz >= 0
        nx, ny, nz, cosine = nx * shrink, ny * shrink, nz * shrink, root * shrink
        _refract(buffer, squares, i, vx, vy, vz, hx, hy, hz, nx, ny, nz, cosine, hit, limit, mu, s, code)


@kernel()
def _sag_and_slope(u: float, table: Any, first: int) -> tuple[float, float, bool]:
    """Sag of an asphere, its derivative by u = r^2, and whether the surface exists there."""
    c = table[first + 3]
    inner = 1.0 - table[first + 4] * c * c * u
    if not inner > 0:
        return 0.0, 0.0, False
    root = sqrt(inner)
    q, dq = 0.0, 0.0
    for j in range(7, -1, -1):
        dq = dq * u + q
        q = q * u + table[first + 17 + j]
    return c * u / (1.0 + root) + u * q, c / (2.0 * root) + q + u * dq, True


@kernel()
def _gap_behind(
    px: float, py: float, pz: float, dx: float, dy: float, dz: float, t: float, table: Any, first: int
) -> tuple[float, float, bool]:
    """Distance of a ray's point behind an asphere along z, its derivative by t, and whether the surface is there."""
    x, y = px + t * dx, py + t * dy
    sag, slope, valid = _sag_and_slope(x * x + y * y, table, first)
    return pz + t * dz - sag, dz - 2.0 * slope * (x * dx + y * dy), valid


@kernel()
def _newton_root(
    px: float, py: float, pz: float, dx: float, dy: float, dz: float, s: float, t: float, table: Any, first: int
) -> tuple[float, bool]:
    """Parameter at which a ray crosses an asphere in its own direction, from a guess `t`; gives up if it strays."""
    tolerance = 1e-13 * sqrt(table[first + 5])
    for _ in range(30):
        gap, rate, valid = _gap_behind(px, py, pz, dx, dy, dz, t, table, first)
        if not (valid and rate * s > 0):
            return t, False
        step = gap / rate
        t -= step
        if abs(step) <= tolerance:
            return t, True
    return t, False


@kernel()
def _scanned_root(
    px: float, py: float, pz: float, dx: float, dy: float, dz: float, s: float, table: Any, first: int
) -> tuple[float, bool]:
    """First crossing in the ray's own direction inside the clear aperture, by sampling and bisection; always ends."""
    bound, low, high = table[first + 25], -1e300, 1e300
    across, along = dx * dx + dy * dy, px * dx + py * dy
    reach = table[first + 5] - (px * px + py * py)
    square = along * along + across * reach
    if across > 1e-24 and square > 0:
        half = sqrt(square)
        low, high = (-along - half) / across, (-along + half) / across
    elif across > 1e-24 or reach < 0:
        return 0.0, False
    if abs(dz) > 1e-12:
        one, other = (-bound - pz) / dz, (bound - pz) / dz
        low, high = max(low, min(one, other)), min(high, max(one, other))
    if not low < high:
        return 0.0, False
    before, previous = False, low
    for j in range(SAMPLES + 1):
        t = low + (high - low) * j / SAMPLES
        gap, _, valid = _gap_behind(px, py, pz, dx, dy, dz, t, table, first)
        if valid and before and s * gap > 0:
            for _ in range(64):
                middle = 0.5 * (previous + t)
                gap, _, _ = _gap_behind(px, py, pz, dx, dy, dz, middle, table, first)
                t, previous = (middle, previous) if s * gap > 0 else (t, middle)
            return 0.5 * (previous + t), True
        before, previous = valid and s * gap <= 0, t
    return 0.0, False


@kernel()
def _meet_asphere(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at an even asphere."""
    vx, vy, vz, c, k1 = table[first], table[first + 1], table[first + 2], table[first + 3], table[first + 4]
    for i in range(m):
        px, py, pz = _near_vertex(buffer, i, vx, vy, vz)
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        a, b, e = _conic_terms(px, py, pz, dx, dy, dz, c, k1)
        bottom = b + s * sqrt(max(0.0, b * b - a * e))
        guess = e / bottom if bottom * s > 0 else 0.0  # where the conic under the asphere is met
        t, met = _newton_root(px, py, pz, dx, dy, dz, s, guess, table, first)
        if not met:
            t, met = _scanned_root(px, py, pz, dx, dy, dz, s, table, first)
        hx, hy, hz = px + t * dx, py + t * dy, pz + t * dz
        _, slope, valid = _sag_and_slope(hx * hx + hy * hy, table, first)
        nx, ny = -2.0 * slope * hx, -2.0 * slope * hy
        shrink = 1.0 / sqrt(nx * nx + ny * ny + 1.0)
        nx, ny = nx * shrink, ny * shrink
        cosine = s * (dx * nx + dy * ny + dz * shrink)
        hit = met and valid and cosine >= 0
        _refract(buffer, squares, i, vx, vy, vz, hx, hy, hz, nx, ny, shrink, cosine, hit, limit, mu, s, code)


@kernel()
def irregularity(x: float, y: float, table: Any, first: int) -> tuple[float, float, float]:
    """Sag of a surface's irregularity and its derivatives by x and y: seven Zernike modes of unit rms."""
    inverse = table[first + FORM + MODES]
    u, v = x * inverse, y * inverse
    uu, vv, uv = u * u, v * v, u * v
    r2 = uu + vv
    a5, a6 = 2.0 * sqrt(6.0) * table[first + FORM], sqrt(6.0) * table[first + FORM + 1]
    a7, a8 = sqrt(8.0) * table[first + FORM + 2], sqrt(8.0) * table[first + FORM + 3]
    a9, a10 = sqrt(8.0) * table[first + FORM + 4], sqrt(8.0) * table[first + FORM + 5]
    a11 = sqrt(5.0) * table[first + FORM + 6]
    coma, ring = a7 * v + a8 * u, 3.0 * r2 - 2.0
    sag = a5 * uv + a6 * (uu - vv) + ring * coma + a9 * v * (3.0 * uu - vv) + a10 * u * (uu - 3.0 * vv)
    sag += a11 * (6.0 * r2 * r2 - 6.0 * r2 + 1.0)
    bowl = a11 * (24.0 * r2 - 12.0)
    by_u = a5 * v + 2.0 * a6 * u + 6.0 * u * coma + ring * a8 + 6.0 * a9 * uv + 3.0 * a10 * (uu - vv) + bowl * u
    by_v = a5 * u - 2.0 * a6 * v + 6.0 * v * coma + ring * a7 + 3.0 * a9 * (uu - vv) - 6.0 * a10 * uv + bowl * v
    return sag, by_u * inverse, by_v * inverse


@kernel()
def _meet_irregular(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float
) -> None:
    """Refract a block at an even asphere that is not quite what it should be."""
    vx, vy, vz, c, k1 = table[first], table[first + 1], table[first + 2], table[first + 3], table[first + 4]
    tolerance = 1e-13 * sqrt(table[first + 5])
    for i in range(m):
        px, py, pz = _near_vertex(buffer, i, vx, vy, vz)
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        a, b, e = _conic_terms(px, py, pz, dx, dy, dz, c, k1)
        bottom = b + s * sqrt(max(0.0, b * b - a * e))
        t = e / bottom if bottom * s > 0 else 0.0  # where the conic under it all is met
        hx, hy, hz, nx, ny = 0.0, 0.0, 0.0, 0.0, 0.0
        met = False
        for _ in range(30):
            hx, hy, hz = px + t * dx, py + t * dy, pz + t * dz
            sag, slope, valid = _sag_and_slope(hx * hx + hy * hy, table, first)
            more, by_x, by_y = irregularity(hx, hy, table, first)
            nx, ny = -2.0 * slope * hx - by_x, -2.0 * slope * hy - by_y
            rate = dz + nx * dx + ny * dy
            if met or not (valid and rate * s > 0):
                met = met and valid
                break
            step = (hz - sag - more) / rate
            t -= step
            met = abs(step) <= tolerance
        shrink = 1.0 / sqrt(nx * nx + ny * ny + 1.0)
        nx, ny = nx * shrink, ny * shrink
        cosine = s * (dx * nx + dy * ny + dz * shrink)
        hit = met and cosine >= 0
        _refract(buffer, squares, i, vx, vy, vz, hx, hy, hz, nx, ny, shrink, cosine, hit, limit, mu, s, code)


@kernel()
def cross_thin(
    table: Any, first: int, before: float, after: float, s: float, x: float, y: float, z: float, dx: float, dy: float,
    dz: float,
) -> Any:  # fmt: skip
    """Place of a ray on an ideal lens, its direction behind it, and r^2 about its axis.

    The lens's tilt matters where liquid begins at it.
    """
    t = (table[first + 2] - z) / dz
    x, y = x + t * dx, y + t * dy
    off_x, off_y = x - table[first], y - table[first + 1]
    lean_x, lean_y = table[first + 10] / table[first + 16], table[first + 13] / table[first + 16]
    sx, sy = dx / dz, dy / dz
    sx = (before * sx - s * (off_x * table[first + 3]) + (after - before) * lean_x) / after
    sy = (before * sy - s * (off_y * table[first + 3]) + (after - before) * lean_y) / after
    shrink = s / sqrt(1.0 + sx * sx + sy * sy)
    return x, y, sx * shrink, sy * shrink, shrink, off_x * off_x + off_y * off_y


@kernel()
def _meet_thin(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, before: float, after: float, s: float,
    code: float,
) -> None:  # fmt: skip
    """Bend a block at an ideal lens."""
    for i in range(m):
        if buffer[6 * BLOCK + i] != 0.0:
            squares[i] = -1.0
            continue
        x, y, dx, dy, dz, r2 = cross_thin(
            table, first, before, after, s, buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i],
            buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i],
        )  # fmt: skip
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i], squares[i] = x, y, table[first + 2], r2
        if r2 > limit:
            buffer[6 * BLOCK + i] = code + CLIPPED
            continue
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = dx, dy, dz


@kernel()
def bend_mapped(law: Any, reach: float, n: float, inwards: bool, x: float, y: float, sx: float, sy: float) -> Any:
    """Height and slope of a ray, bent by first order, as a mapping has it, or back, and p; its pupil point stays."""
    steepness = sqrt(sx * sx + sy * sy)
    p = first_order(law, steepness, n) if inwards else n * steepness
    grown = stretch(law, p, n)
    if inwards:
        p, grown = n * steepness / grown, 1.0 / grown
    return x + (grown - 1.0) * sx * reach, y + (grown - 1.0) * sy * reach, sx * grown, sy * grown, p


@kernel()
def _meet_mapped(
    buffer: Any, squares: Any, m: int, table: Any, first: int, end: int, limit: float, index: float, s: float,
    code: float,
) -> None:  # fmt: skip
    """Bend a block as a mapping does whose law stands behind the surfaces; `squares` gets (f p)^2."""
    law = table[end:].reshape(-1, LAW_COLUMNS)
    for i in range(m):
        if buffer[6 * BLOCK + i] != 0.0:
            squares[i] = -1.0
            continue
        z, shrink = table[first + 2], 1.0 / buffer[5 * BLOCK + i]
        sx, sy = buffer[3 * BLOCK + i] * shrink, buffer[4 * BLOCK + i] * shrink
        x, y = buffer[i] + (z - buffer[2 * BLOCK + i]) * sx, buffer[BLOCK + i] + (z - buffer[2 * BLOCK + i]) * sy
        x, y, sx, sy, p = bend_mapped(law, table[first + LENGTH], index, s > 0.0, x, y, sx, sy)
        squares[i] = (table[first + 4] * p) ** 2
        if squares[i] > limit:
            buffer[6 * BLOCK + i] = code + CLIPPED
            continue
        shrink = s / sqrt(1.0 + sx * sx + sy * sy)
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = x, y, z
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = sx * shrink, sy * shrink, shrink


@kernel()
def _moved(table: Any, first: int, x: float, y: float, z: float) -> Any:
    """Turn a vector as a mirror turns rays."""
    a, b, c = first + MOVED, first + MOVED + 3, first + MOVED + 6
    return (
        table[a] * x + table[a + 1] * y + table[a + 2] * z,
        table[b] * x + table[b + 1] * y + table[b + 2] * z,
        table[c] * x + table[c + 1] * y + table[c + 2] * z,
    )


@kernel()
def _moved_back(table: Any, first: int, x: float, y: float, z: float) -> Any:
    """Turn a vector back."""
    a, b, c = first + MOVED, first + MOVED + 3, first + MOVED + 6
    return (
        table[a] * x + table[b] * y + table[c] * z,
        table[a + 1] * x + table[b + 1] * y + table[c + 1] * z,
        table[a + 2] * x + table[b + 2] * y + table[c + 2] * z,
    )


@kernel()
def _meet_mirror(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, s: float, code: float
) -> None:
    """Clip a block at a flat mirror, and move it from one side's unfolded space to the other's."""
    vx, vy, vz = table[first], table[first + 1], table[first + 2]
    nx, ny, nz = table[first + 10], table[first + 13], table[first + 16]
    tx, ty, tz = _moved(table, first, vx, vy, vz)
    tx, ty, tz = (
        vx + table[first + MOVED + 9] - tx, vy + table[first + MOVED + 10] - ty, vz + table[first + MOVED + 11] - tz,
    )  # fmt: skip
    for i in range(m):
        squares[i] = -1.0
        if buffer[6 * BLOCK + i] != 0.0:
            continue
        x, y, z = buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i]
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        if s > 0.0:
            x, y, z = _moved_back(table, first, x - tx, y - ty, z - tz)
            dx, dy, dz = _moved_back(table, first, dx, dy, dz)
        cosine = dx * nx + dy * ny + dz * nz
        if not cosine * s > 0.0:
            buffer[6 * BLOCK + i] = code + MISSED
            continue
        t = -((x - vx) * nx + (y - vy) * ny + (z - vz) * nz) / cosine
        x, y, z = x + t * dx, y + t * dy, z + t * dz
        squares[i] = (x - vx) ** 2 + (y - vy) ** 2 + (z - vz) ** 2
        if squares[i] > limit:
            buffer[6 * BLOCK + i] = code + CLIPPED
        elif s < 0.0:
            x, y, z = _moved(table, first, x, y, z)
            x, y, z = x + tx, y + ty, z + tz
            dx, dy, dz = _moved(table, first, dx, dy, dz)
        buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = x, y, z
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = dx, dy, dz


@kernel()
def _rod_step(work: Any, x: float, y: float, u: float, v: float, pull: float, g2: float) -> Any:
    """Solve x'' = -pull (1 - g^2 r^2/2) x, and so for y, over a unit of length, by Taylor series.

    That of s = r^2 has a law of its own, s'' = 2 e - 4 pull s + 3/2 pull g^2 s^2 with e = v^2 + pull s (1 - g^2 s/4),
    which stays. Terms of x, y and once more of s lie backwards, so that a product of series is one of rows.
    """
    last = TERMS - 1
    forth, back = work[:TERMS], work[TERMS : 2 * TERMS]
    xs, ys = work[2 * TERMS : 3 * TERMS], work[3 * TERMS : 4 * TERMS]
    xs[last], xs[last - 1], ys[last], ys[last - 1] = x, u, y, v
    forth[0], forth[1] = x * x + y * y, 2.0 * (x * u + y * v)
    back[last], back[last - 1] = forth[0], forth[1]
    energy = u * u + v * v + pull * forth[0] * (1.0 - 0.25 * g2 * forth[0])
    for k in range(TERMS - 2):
        ss, sx, sy = 0.0, 0.0, 0.0
        old, old_x, old_y = back[last - k :], xs[last - k :], ys[last - k :]
        for j in range(k + 1):
            ss += forth[j] * old[j]
            sx += forth[j] * old_x[j]
            sy += forth[j] * old_y[j]
        part = pull / ((k + 1.0) * (k + 2.0))
        term = part * (1.5 * g2 * ss - 4.0 * forth[k]) + (energy if k == 0 else 0.0)
        forth[k + 2], back[last - 2 - k] = term, term
        xs[last - 2 - k] = part * (0.5 * g2 * sx - old_x[0])
        ys[last - 2 - k] = part * (0.5 * g2 * sy - old_y[0])
    x, y, u, v = 0.0, 0.0, 0.0, 0.0
    for k in range(TERMS):
        power = last - k
        x, y, u, v = x + xs[k], y + ys[k], u + power * xs[k], v + power * ys[k]
    return x, y, u, v


@kernel(apart=True)
def _rod_series(
    lanes: int, g2: float, x: Any, y: Any, u: Any, v: Any, pull: Any, energy: Any, forth: Any, back: Any, xs: Any,
    ys: Any, ss: Any, sx: Any, sy: Any,
) -> None:  # fmt: skip
    """Take as many steps as there are lanes, as `_rod_step`, to the same bits."""
    last = TERMS - 1
    for i in range(lanes):
        xs[last, i], xs[last - 1, i], ys[last, i], ys[last - 1, i] = x[i], u[i], y[i], v[i]
        r2, rate = x[i] * x[i] + y[i] * y[i], 2.0 * (x[i] * u[i] + y[i] * v[i])
        forth[0, i], forth[1, i], back[last, i], back[last - 1, i] = r2, rate, r2, rate
        energy[i] = u[i] * u[i] + v[i] * v[i] + pull[i] * r2 * (1.0 - 0.25 * g2 * r2)
    for k in range(TERMS - 2):
        old, old_x, old_y, odd = back[last - k :], xs[last - k :], ys[last - k :], (k + 1) % 2
        for i in range(lanes):
            single = forth[0, i] if odd else 0.0
            ss[i], sx[i], sy[i] = single * old[0, i], single * old_x[0, i], single * old_y[0, i]
        for j in range(odd, k + 1, 2):  # two at a time: half as many visits to the sums
            for i in range(lanes):
                one, two = forth[j, i], forth[j + 1, i]
                ss[i] = ss[i] + one * old[j, i] + two * old[j + 1, i]
                sx[i] = sx[i] + one * old_x[j, i] + two * old_x[j + 1, i]
                sy[i] = sy[i] + one * old_y[j, i] + two * old_y[j + 1, i]
        for i in range(lanes):
            part = pull[i] / ((k + 1.0) * (k + 2.0))
            term = part * (1.5 * g2 * ss[i] - 4.0 * forth[k, i]) + (energy[i] if k == 0 else 0.0)
            forth[k + 2, i], back[last - 2 - k, i] = term, term
            xs[last - 2 - k, i] = part * (0.5 * g2 * sx[i] - old_x[0, i])
            ys[last - 2 - k, i] = part * (0.5 * g2 * sy[i] - old_y[0, i])
    for i in range(lanes):
        x[i], y[i], u[i], v[i] = 0.0, 0.0, 0.0, 0.0
    for k in range(TERMS):
        power = last - k
        for i in range(lanes):
            x[i], y[i] = x[i] + xs[k, i], y[i] + ys[k, i]
            u[i], v[i] = u[i] + power * xs[k, i], v[i] + power * ys[k, i]


@kernel(apart=True)
def _rod_kicks(
    lanes: int, x: Any, y: Any, u: Any, v: Any, kick: Any, near: Any, near_up: Any, near_down: Any, far: Any,
    far_up: Any, far_down: Any,
) -> None:  # fmt: skip
    """As `_rod_series`, for pixels: harmonic swings, and all else at two points of them.

    The symplectic SABA2 of Laskar and Robutel 2001; a swing is a cosine, and a sine over and times its frequency.
    """
    for i in range(lanes):
        a, b, c, d = x[i], y[i], u[i], v[i]
        a, b, c, d = (
            near[i] * a + near_up[i] * c, near[i] * b + near_up[i] * d,
            near[i] * c - near_down[i] * a, near[i] * d - near_down[i] * b,
        )  # fmt: skip
        bend = kick[i] * (a * a + b * b)
        c, d = c + bend * a, d + bend * b
        a, b, c, d = (
            far[i] * a + far_up[i] * c, far[i] * b + far_up[i] * d,
            far[i] * c - far_down[i] * a, far[i] * d - far_down[i] * b,
        )  # fmt: skip
        bend = kick[i] * (a * a + b * b)
        c, d = c + bend * a, d + bend * b
        x[i], y[i] = near[i] * a + near_up[i] * c, near[i] * b + near_up[i] * d
        u[i], v[i] = near[i] * c - near_down[i] * a, near[i] * d - near_down[i] * b


@kernel(apart=True)
def _rod_crests(
    lanes: int, limit: float, x: Any, y: Any, u: Any, v: Any, pull: Any, out: Any, high: Any, left: Any
) -> bool:
    """Keep rays' largest r^2 in a rod; whether some have no steps left or are clipped."""
    ended = 0
    for i in range(lanes):
        r2 = x[i] * x[i] + y[i] * y[i]
        # A crest between two steps, as of a harmonic swing.
        mean, area = 0.5 * (r2 + (u[i] * u[i] + v[i] * v[i]) / pull[i]), x[i] * v[i] - y[i] * u[i]
        crest = mean + sqrt(max(0.0, mean * mean - area * area / pull[i]))
        outwards = x[i] * u[i] + y[i] * v[i]
        turned, out[i] = out[i] > 0.0 and outwards < 0.0, outwards
        most = max(high[i], r2)
        high[i] = max(most, crest) if turned else most
        left[i] -= 1.0
        ended += 1 if left[i] == 0.0 or high[i] > limit else 0
    return ended > 0


@kernel()
def _into_rod(
    buffer: Any, squares: Any, i: int, table: Any, first: int, limit: float, before: float, s: float, code: float
) -> Any:
    """Height of a ray where a rod begins, optical direction along its axis, and steps through it; 0: it is lost."""
    n_0, g2, length = table[first + 3], table[first + 4] * table[first + 4], table[first + LENGTH]
    start = table[first + 2] - (length if s > 0.0 else 0.0)
    squares[i] = -1.0
    if buffer[6 * BLOCK + i] != 0.0:
        return 0.0, 0.0, 0.0, 0
    dx, dy, dz = before * buffer[3 * BLOCK + i], before * buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
    if not dz * s > 0.0:
        buffer[6 * BLOCK + i] = code + REFLECTED
        return 0.0, 0.0, 0.0, 0
    t = (start - buffer[2 * BLOCK + i]) / dz
    x = buffer[i] + t * buffer[3 * BLOCK + i] - table[first]
    y = buffer[BLOCK + i] + t * buffer[4 * BLOCK + i] - table[first + 1]
    r2 = x * x + y * y
    squares[i] = r2
    index = n_0 * (1.0 - 0.5 * g2 * r2)
    square = index * index - dx * dx - dy * dy
    if r2 > limit or not (index > 0.0 and square > 0.0):
        buffer[6 * BLOCK + i] = code + (CLIPPED if r2 > limit else REFLECTED)
        return 0.0, 0.0, 0.0, 0
    # A ray swings like an elliptic sine of amplitude A, whose poles lie ln(8/(g A)) off the real axis.
    swing = sqrt(g2 * r2 + (dx * dx + dy * dy) / (n_0 * n_0))
    longest = max(STEP, min(LONGEST, STEP * math.log(8.0 / max(swing, 1e-9))))
    if table[first + COARSE] != 0.0:
        beyond = max(0.5 * swing * swing, 1e-9)
        longest = min(LONGEST, (24 * KICK_ERROR / beyond**2) ** (1 / 3), (4320 * KICK_ERROR / beyond) ** 0.2)
    forward = sqrt(square)
    phase2 = n_0 * n_0 * g2 / (forward * forward)
    return x, y, forward, max(1, math.ceil(sqrt(phase2) * length / longest))


@kernel()
def _out_of_rod(
    buffer: Any, i: int, x: float, y: float, px: float, py: float, z: float, clipped: bool, s: float, code: float
) -> None:
    """Give a ray its place and direction behind a rod, or say why it has none."""
    rest = 1.0 - px * px - py * py
    if clipped or not rest > 0.0:
        buffer[6 * BLOCK + i] = code + (CLIPPED if clipped else REFLECTED)
        return
    buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = x, y, z
    buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = px, py, s * sqrt(rest)


@kernel()
def _meet_rod(
    buffer: Any, squares: Any, m: int, table: Any, first: int, limit: float, before: float, after: float, s: float,
    code: float,
) -> None:  # fmt: skip
    """Carry a block through a rod of n = n_0 (1 - g^2 r^2/2), in its own axes.

    Along the axis the optical direction p_z stays as it is, and x'' = -(n_0 g/p_z)^2 (1 - g^2 r^2/2) x. Rays go side by
    side, in lanes; the next one takes the lane of one that has come through.
    """
    n_0, g2, length = table[first + 3], table[first + 4] * table[first + 4], table[first + LENGTH]
    start = table[first + 2] - (length if s > 0.0 else 0.0)
    coarse = table[first + COARSE] != 0.0
    lanes = min(LANES if COMPILED else 1, m)
    owner, room = np.full(lanes, -1), np.zeros((17, lanes))
    x, y, u, v, out, high, left, pull, forward, h = (
        room[0], room[1], room[2], room[3], room[4], room[5], room[6], room[7], room[8], room[9],
    )  # fmt: skip
    a, b, c, d, e, f, g = room[10], room[11], room[12], room[13], room[14], room[15], room[16]
    series = np.empty((4 * TERMS, lanes))
    pull[:] = 1.0
    entered, busy, ended = 0, 0, True
    while True:
        for lane in range(lanes if ended else 0):
            i = owner[lane]
            if i >= 0 and (left[lane] == 0.0 or high[lane] > limit):
                squares[i], owner[lane], busy = high[lane], -1, busy - 1
                px, py = u[lane] / h[lane] * forward[lane] / after, v[lane] / h[lane] * forward[lane] / after
                hx, hy = x[lane] + table[first], y[lane] + table[first + 1]
                _out_of_rod(buffer, i, hx, hy, px, py, start + s * length, high[lane] > limit, s, code)
                room[:7, lane] = 0.0
            while owner[lane] < 0 and entered < m:
                i, entered = entered, entered + 1
                hx, hy, ahead, count = _into_rod(buffer, squares, i, table, first, limit, before, s, code)
                if count == 0:
                    continue
                step = length / count
                owner[lane], busy, left[lane], high[lane] = i, busy + 1, 1.0 * count, squares[i]
                forward[lane], h[lane] = ahead, step
                pull[lane] = n_0 * n_0 * g2 / (ahead * ahead) * step * step
                x[lane], y[lane] = hx, hy  # and how far these go in a step along the axis
                u[lane] = before * buffer[3 * BLOCK + i] / ahead * step
                v[lane] = before * buffer[4 * BLOCK + i] / ahead * step
                out[lane] = hx * u[lane] + hy * v[lane]
                if coarse:
                    omega = sqrt(pull[lane])
                    near, far = math.sin(KICK_AT * omega), math.sin(KICK_APART * omega)
                    a[lane], b[lane], c[lane] = 0.25 * pull[lane] * g2, math.cos(KICK_AT * omega), near / omega
                    d[lane], e[lane] = near * omega, math.cos(KICK_APART * omega)
                    f[lane], g[lane] = far / omega, far * omega
        if busy == 0:
            break
        if coarse:
            _rod_kicks(lanes, x, y, u, v, a, b, c, d, e, f, g)
        elif not COMPILED:
            place, way = (float(x[0]), float(y[0])), (float(u[0]), float(v[0]))
            x[0], y[0], u[0], v[0] = _rod_step(buffer[7 * BLOCK : 8 * BLOCK], *place, *way, float(pull[0]), g2)
        else:
            _rod_series(
                lanes, g2, x, y, u, v, pull, a, series[:TERMS], series[TERMS : 2 * TERMS],
                series[2 * TERMS : 3 * TERMS], series[3 * TERMS :], b, c, d,
            )  # fmt: skip
        ended = _rod_crests(lanes, limit, x, y, u, v, pull, out, high, left)


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
        kind, code, mu = int(table[first + 6]), 1.0 * FATES * (k + 1), before / after
        limit = table[first + 5] if clip else 1e300
        turned = table[first + 7] != 0
        mine = squares[k * BLOCK : k * BLOCK + m]
        if turned:
            turn(buffer, m, table, first, True)
        if kind == SPHERE and table[first + 3] == 0.0:
            _meet_plane(buffer, mine, m, table, first, limit, mu, s, code)
        elif kind == SPHERE:
            _meet_sphere(buffer, mine, m, table, first, limit, mu, s, code)
        elif kind == CONIC:
            _meet_conic(buffer, mine, m, table, first, limit, mu, s, code)
        elif kind == THIN:
            _meet_thin(buffer, mine, m, table, first, limit, before, after, s, code)
        elif kind == ROD:
            _meet_rod(buffer, mine, m, table, first, limit, before, after, s, code)
        elif kind == MAPPED:
            _meet_mapped(buffer, mine, m, table, first, count * COLUMNS, limit, after if backward else before, s, code)
        elif kind == MIRROR:
            _meet_mirror(buffer, mine, m, table, first, limit, s, code)
        elif kind == IRREGULAR:
            _meet_irregular(buffer, mine, m, table, first, limit, mu, s, code)
        else:
            _meet_asphere(buffer, mine, m, table, first, limit, mu, s, code)
        if turned:
            turn(buffer, m, table, first, False)


@kernel(apart=True)
def _enter(x_in: Any, y_in: Any, z_in: Any, slope_x: Any, slope_y: Any, buffer: Any, m: int, s: float) -> None:
    """Take a block of rays in; slices as arguments, as only then the compiler knows that no index is negative."""
    for i in range(m):
        x, y, z, sx, sy = x_in[i], y_in[i], z_in[i], slope_x[i], slope_y[i]
        good = (x - x) + (y - y) + (z - z) + (sx - sx) + (sy - sy) == 0  # else something is not finite
        sx, sy = sx if good else 0.0, sy if good else 0.0
        shrink = s / sqrt(1.0 + sx * sx + sy * sy)
        buffer[i] = x if good else 0.0
        buffer[BLOCK + i] = y if good else 0.0
        buffer[2 * BLOCK + i] = z if good else 0.0
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = sx * shrink, sy * shrink
        buffer[5 * BLOCK + i], buffer[6 * BLOCK + i] = shrink, 0.0 if good else 1.0 * INVALID


@kernel(apart=True)
def _narrow(squares: Any, margin: Any, m: int, limit: float) -> None:
    """Take a surface's margin where it is the least so far."""
    inverse = 1.0 / limit
    for i in range(m):
        margin[i] = min(margin[i], 1.0 - squares[i] * inverse)


@kernel(apart=True)
def _leave(
    buffer: Any, m: int, end: float, s: float, x_out: Any, y_out: Any, slope_x: Any, slope_y: Any, room: Any,
    state: Any,
) -> None:  # fmt: skip
    """Give a block of rays out where they cross a plane."""
    for i in range(m):
        dz, fate = buffer[5 * BLOCK + i], buffer[6 * BLOCK + i]
        alive, meets = fate == 0.0, dz * s > 0
        kept = alive and meets
        shrink = 1.0 / (dz if meets else 1.0)
        sx, sy = buffer[3 * BLOCK + i] * shrink, buffer[4 * BLOCK + i] * shrink
        reach = end - buffer[2 * BLOCK + i] if kept else 0.0
        x_out[i], y_out[i] = buffer[i] + reach * sx, buffer[BLOCK + i] + reach * sy
        slope_x[i], slope_y[i] = sx if kept else 0.0, sy if kept else 0.0
        room[i] = min(buffer[7 * BLOCK + i], 1.0 if kept else -1.0)
        state[i] = int(1.0 * NO_PLANE if alive and not meets else fate)


@kernel()
def _trace_slopes(
    each: int, builds: int, count: int, backward: bool, clip: bool, table: Any, media: Any, x_in: Any, y_in: Any,
    z_in: Any, slope_x: Any, slope_y: Any, plane: Any, buffer: Any, squares: Any, x_out: Any, y_out: Any, sx_out: Any,
    sy_out: Any, room: Any, state: Any,
) -> None:  # fmt: skip
    """Trace `each` rays through each build of `count` surfaces: x, y, z, dx/dz, dy/dz to x, y, dx/dz, dy/dz on a plane.

    All arrays are flat; where `x_in` to `slope_y` are shorter than all rays, one number stands for all. `buffer` and
    `squares` are room to work.
    """
    n, wide, s = each * builds, len(table) // builds, -1.0 if backward else 1.0
    margin = buffer[7 * BLOCK : 8 * BLOCK]
    for build in range(builds):
        lens = table[build * wide : (build + 1) * wide]
        index = media[build * (count + 1) : (build + 1) * (count + 1)]
        for start in range(build * each, (build + 1) * each, PART):
            stop = min(start + PART, (build + 1) * each)
            m = stop - start
            a, b, c = start if len(x_in) == n else 0, start if len(y_in) == n else 0, start if len(z_in) == n else 0
            d, e = start if len(slope_x) == n else 0, start if len(slope_y) == n else 0
            _enter(
                x_in[a : a + m], y_in[b : b + m], z_in[c : c + m], slope_x[d : d + m], slope_y[e : e + m], buffer, m, s
            )  # fmt: skip
            for i in range(start, stop, LINE):
                for line in (x_out, y_out, sx_out, sy_out, room):
                    soon_written(line, i)
            pass_surfaces(buffer, m, lens, index, count, backward, clip, squares)
            for i in range(m):
                margin[i] = 1.0
            for k in range(count):
                _narrow(squares[k * BLOCK : k * BLOCK + m], margin, m, lens[k * COLUMNS + 5])
            _leave(
                buffer, m, plane[build], s, x_out[start:stop], y_out[start:stop], sx_out[start:stop],
                sy_out[start:stop], room[start:stop], state[start:stop],
            )  # fmt: skip
