"""Exact rays through a stack of surfaces: the loops, over flat structure-of-arrays buffers.

Rays are worked on in blocks that stay in the nearest cache; each surface is one pass over the block without branches,
so that the compiler can take several rays at once. A stopped ray goes along untouched: its state says where it ended.

A sphere or conic ``c (x^2 + y^2 + (1 + k) z^2) = 2 z`` meets the ray p + t d where ``A t^2 + 2 B t + C = 0``; the
root wanted is the one where the ray crosses towards the side it travels to. Written as C over the sum that does not
cancel, it is exact in the limit of a plane, c -> 0.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from .._jit import kernel

BLOCK = 256
"""Rays in a block; nine rows of them are 18 kB."""
ROWS = 9

CLIPPED, MISSED, REFLECTED, NO_PLANE, INVALID, STOPPED = 1, 2, 3, 4, 5, 6
"""What stopped a ray; its state is eight times the number of the surface or stop (from 1; else 0) plus one of these."""

SPHERE, CONIC, ASPHERE = 1, 2, 3
COLUMNS = 26
"""Of a surface: vertex x y z, c, 1 + k, semi-diameter squared, kind, turned?, rotation (9), asphere (8), sag bound."""
UNIT_ERROR = 1e-9
SAMPLES = 64


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
def meet_sphere(buffer: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float) -> None:
    """Refract a block at a sphere or plane; the cosine of incidence is the root of the discriminant."""
    vx, vy, vz, c = table[first], table[first + 1], table[first + 2], table[first + 3]
    for i in range(m):
        x, y, z = buffer[i] - vx, buffer[BLOCK + i] - vy, buffer[2 * BLOCK + i] - vz
        dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
        near = -(x * dx + y * dy + z * dz)  # from here on, the point nearest the vertex: nothing far away cancels
        px, py, pz = x + near * dx, y + near * dy, z + near * dz
        b = dz - c * (px * dx + py * dy + pz * dz)
        e = c * (px * px + py * py + pz * pz) - 2.0 * pz
        disc = b * b - c * e
        real = disc >= 0
        root = sqrt(disc if real else 0.0)
        same = b * s >= 0
        top = e if same else b - s * root
        bottom = b + s * root if same else c
        some = bottom != 0
        step = top / (bottom if some else 1.0)
        hx, hy, hz = px + step * dx, py + step * dy, pz + step * dz
        nz = 1.0 - c * hz
        hit = real and some and nz >= 0
        r2 = hx * hx + hy * hy
        moves, ex, ey, ez, fate = settle(
            hit, r2, limit, -c * hx, -c * hy, nz, root, mu, s, dx, dy, dz, buffer[6 * BLOCK + i], code
        )
        buffer[i] = hx + vx if moves else x + vx
        buffer[BLOCK + i] = hy + vy if moves else y + vy
        buffer[2 * BLOCK + i] = hz + vz if moves else z + vz
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = ex, ey, ez
        buffer[6 * BLOCK + i] = fate
        buffer[7 * BLOCK + i] = near + step if moves else 0.0
        buffer[8 * BLOCK + i] = r2 if hit else -1.0


@kernel()
def meet_conic(buffer: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float) -> None:
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
        disc = b * b - a * e
        real = disc >= 0
        root = sqrt(disc if real else 0.0)
        same = b * s >= 0
        top = e if same else b - s * root
        bottom = b + s * root if same else a
        some = bottom != 0
        step = top / (bottom if some else 1.0)
        hx, hy, hz = px + step * dx, py + step * dy, pz + step * dz
        nz = 1.0 - k1 * c * hz
        hit = real and some and nz >= 0
        r2 = hx * hx + hy * hy
        size2 = c * c * r2 + nz * nz
        shrink = 1.0 / sqrt(size2 if size2 > 0 else 1.0)
        nx, ny, nz, cosine = -c * hx * shrink, -c * hy * shrink, nz * shrink, root * shrink
        moves, ex, ey, ez, fate = settle(
            hit, r2, limit, nx, ny, nz, cosine, mu, s, dx, dy, dz, buffer[6 * BLOCK + i], code
        )
        buffer[i] = hx + vx if moves else x + vx
        buffer[BLOCK + i] = hy + vy if moves else y + vy
        buffer[2 * BLOCK + i] = hz + vz if moves else z + vz
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = ex, ey, ez
        buffer[6 * BLOCK + i] = fate
        buffer[7 * BLOCK + i] = near + step if moves else 0.0
        buffer[8 * BLOCK + i] = r2 if hit else -1.0


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
def meet_asphere(buffer: Any, m: int, table: Any, first: int, limit: float, mu: float, s: float, code: float) -> None:
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
        )
        if moves:
            buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = hx + vx, hy + vy, hz + vz
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = ex, ey, ez
        buffer[6 * BLOCK + i] = fate
        buffer[7 * BLOCK + i] = near + t if moves else 0.0
        buffer[8 * BLOCK + i] = r2 if hit else -1.0


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
        buffer[7 * BLOCK + i] = t if moves else 0.0


@kernel()
def trace_rays(
    position: Any,
    direction: Any,
    n: int,
    table: Any,
    count: int,
    index: Any,
    backward: bool,
    clip: bool,
    to_plane: bool,
    plane: float,
    buffer: Any,
    out_position: Any,
    out_direction: Any,
    state: Any,
    path: Any,
    room: Any,
) -> None:
    """Trace `n` rays through `count` surfaces; `path` and `room` are filled where they are not empty.

    All arrays are flat, components one after the other; `index` holds the media before the first surface and after
    each. `room` is the least of ``1 - r^2 / semi-diameter^2`` over the surfaces, -1 or less where one was not met.
    """
    s = -1.0 if backward else 1.0
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        load(position, direction, buffer, start, m, n)
        rooms, paths = room[start : start + m], path[start : start + m]  # empty where they are not wanted
        for i in range(len(rooms)):
            rooms[i] = 1.0
        for i in range(len(paths)):
            paths[i] = 0.0
        for j in range(count):
            k = count - 1 - j if backward else j
            first = k * COLUMNS
            before, after = (index[k + 1], index[k]) if backward else (index[k], index[k + 1])
            semi2, kind, code = table[first + 5], int(table[first + 6]), 8.0 * (k + 1)
            limit = semi2 if clip else 1e300
            mu = before / after
            turned = table[first + 7] != 0
            if turned:
                turn(buffer, m, table, first, True)
            if kind == SPHERE:
                meet_sphere(buffer, m, table, first, limit, mu, s, code)
            elif kind == CONIC:
                meet_conic(buffer, m, table, first, limit, mu, s, code)
            else:
                meet_asphere(buffer, m, table, first, limit, mu, s, code)
            if turned:
                turn(buffer, m, table, first, False)
            for i in range(len(paths)):
                paths[i] += before * buffer[7 * BLOCK + i]
            for i in range(len(rooms)):
                r2 = buffer[8 * BLOCK + i]
                rooms[i] = min(rooms[i], 1.0 - r2 / semi2 if r2 >= 0 else -1.0)
        if to_plane:
            reach_plane(buffer, m, plane, s, 8.0 * (count + 1))
            last = index[0] if backward else index[count]
            for i in range(len(paths)):
                paths[i] += last * buffer[7 * BLOCK + i]
        for row in range(3):
            begin = row * n + start
            copy(buffer[row * BLOCK : row * BLOCK + m], out_position[begin : begin + m], m)
            copy(buffer[(3 + row) * BLOCK : (3 + row) * BLOCK + m], out_direction[begin : begin + m], m)
        states = state[start : start + m]
        for i in range(m):
            states[i] = int(buffer[6 * BLOCK + i])
