"""Exact rays through what stands before the main lens: Snell's law at every face, every clear aperture met in order.

Backward, from the main lens to the scene, in the system's axes (main lens at z = 0, +z towards the sensor). Faces are
rows of `lenses.tracer`; ideal lenses bend as they do in the closed forms, rods are integrated by their Taylor series.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from ..camera import Camera, Number
from ..camera.camera import IMAGE
from ..design.elements import Block, FieldLens, Grin, LensGroup
from ..design.mapping import stretch
from ..design.parts import PATHS
from ..lenses.prescription import rotation, surface_table
from ..lenses.tracer import BLOCK, CLIPPED, COLUMNS, MISSED, REFLECTED, ROWS, SPHERE, pass_surfaces, pays, turn
from .backward import law_of
from .pupil import Status

Floats = NDArray[np.float64]

THIN, ROD, MAPPED = 11, 12, 13
"""Kinds of rows beside those of `lenses.tracer`: an ideal lens, 1/f in place of the curvature; a rod, with n_0 and g in
the places of curvature and conic, and its length in that of the first aspheric term; what a mapping makes of a ray that
an ideal lens has just bent, with the way from there to the entrance pupil in the place of the length."""
KIND, LIMIT, TURNED, LENGTH = 6, 5, 7, 17
OPEN = 1e300
"""Square of a semi-diameter that lets everything through."""
TERMS = 16
"""Of a rod's series; with steps of at most `STEP` in its phase what is left out is below 1e-14."""
STEP = 0.25


class Outside(NamedTuple):
    """Rays in the medium of the scene."""

    height: Floats
    """Where they, prolonged, meet z = 0, (2, ...) [mm]; of a lost ray 0, as its slope."""
    slope: Floats
    """dx/dz and dy/dz, (2, ...)."""
    status: NDArray[np.uint8]
    """`Status`: what took a ray first, from the main lens outwards, (...)."""


@dataclass(frozen=True, eq=False)
class FacesAhead:
    """Everything that a ray meets between main lens and scene, as the kernels take it; from the main lens outwards."""

    table: Floats
    """A row a face, stop, ideal lens or rod, (S, 26)."""
    media: Floats
    """Indices on the scene's and on the sensor's side of each, (S, 2)."""
    takers: NDArray[np.uint8]
    """What a ray that each clips is said to be stopped by: `Status`, (S,)."""
    law: Floats
    """Of an objective with a mapping, as in `Layout`."""

    @classmethod
    def of(cls, camera: Camera, *, clip: bool = True) -> FacesAhead:
        """All that stands before the main lens of one camera.

        Parameters
        ----------
        camera : Camera
            One build.
        clip : bool
            Whether clear apertures stop rays.
        """
        rows, media, takers = [], [], []
        for _, faces in sorted(_units(camera), key=lambda unit: unit[0]):
            for row, scene, sensor, taker in faces:
                if not clip:
                    row[LIMIT] = OPEN
                rows.append(row)
                media.append((scene, sensor))
                takers.append(taker)
        return cls(
            np.array(rows).reshape(-1, COLUMNS),
            np.array(media).reshape(-1, 2),
            np.array(takers, np.uint8),
            law_of(camera),
        )

    def rays(self, height: tuple[ArrayLike, ArrayLike], slope: tuple[ArrayLike, ArrayLike]) -> Outside:
        """Carry rays outwards.

        Parameters
        ----------
        height : pair of array_like
            Where they cross the main lens's plane, from the system's axis [mm].
        slope : pair of array_like
            dx/dz and dy/dz just before it.
        """
        lines = np.stack(np.broadcast_arrays(*(np.asarray(part, float) for part in (*height, *slope))))
        shape = lines.shape[1:]
        rays = np.ascontiguousarray(lines.reshape(4, -1))
        out, status = np.zeros_like(rays), np.zeros(rays.shape[1], np.uint8)
        room = np.empty(ROWS * BLOCK), np.empty(BLOCK)
        if pays(carry, rays.shape[1] * len(self.table)):
            carry.compiled(self.table, self.media, self.takers, self.law, *room, rays, out, status)
        else:
            table, media = ([_plain(row) for row in part] for part in (self.table, self.media))
            buffer, work, lines = (_plain(part) for part in (*room, rays))
            carry.interpreted(table, media, self.takers, self.law, buffer, work, lines, out, status)
        found = out.reshape(4, *shape)
        return Outside(found[:2], found[2:], status.reshape(shape))

    def rays_at(
        self, distances: Sequence[float], height: tuple[ArrayLike, ArrayLike], slope: tuple[ArrayLike, ArrayLike]
    ) -> Iterator[Outside]:
        """The same rays past only what stands nearer than each of some growing distances [mm]; then past all.

        They go on straight from there, be it in glass. A ray is lost from where it is lost on.
        """
        lost, first = np.zeros((), np.uint8), 0
        for distance in (*distances, math.inf):
            nearer = -self.table[:, 2] < distance
            end = len(nearer) if nearer.all() else max(first, int(np.argmin(nearer)))
            part = FacesAhead(self.table[first:end], self.media[first:end], self.takers[first:end], self.law)
            (h_x, h_y), (s_x, s_y), status = part.rays(height, slope)
            height, slope, first = (h_x, h_y), (s_x, s_y), end
            lost = np.where(lost, lost, status)
            yield Outside(np.stack(height), np.stack(slope), lost)


def _plain(array: Floats) -> Any:
    """Its numbers come out as Python's own, not as numpy's slow ones."""
    return memoryview(array)  # type: ignore[arg-type]


Face = tuple[Floats, float, float, int]


def _units(camera: Camera) -> Iterator[tuple[tuple[float, int], list[Face]]]:
    """Stops and elements, each with where it begins; a stop on an element's vertex comes before that."""
    n, chain = camera.numbers, camera.chain
    codes = {rim.part: int(Status.APERTURE) + k for k, rim in enumerate((camera.fap, *camera.rims[1:]))}
    medium_from = math.inf if chain is None or not chain.elements else float(chain.end(n))
    medium = float(n.get("object_space.index", 1.0))

    def around(z: float) -> float:
        return medium if z >= medium_from else 1.0

    for part in ("aperture", *(f"stops.{k}" for k in range(camera.stops))):
        z = float(n[f"{part}.distance"])
        row = _row(_centre(n, part, z), rotation(*_pair(n, f"{part}.tilt")), float(n[f"{part}.diameter"]) / 2)
        yield (z, 0), [(row, around(z), around(z), codes[part])]
    if chain is None:
        return
    for k, element in enumerate(chain.elements):
        part = f"elements.{k}"
        z = float(n[f"{part}.distance"])
        radius = float(n[f"{part}.diameter"]) / 2 if f"{part}.diameter" in n else math.inf
        length = float(chain.length(n, k))
        back, front = (codes.get(f"{part}.{side}", codes.get(f"{part}.0", int(Status.ELEMENT))) for side in (0, 1))
        vertex, axes = _centre(n, part, z), rotation(*_pair(n, f"{part}.tilt"))
        beyond = around(z + length)
        if isinstance(element, Block):
            index = float(n[f"{part}.index"])
            near = _row(vertex, axes @ rotation(*_pair(n, f"{part}.wedge")), radius)
            far = _row(vertex - length * axes[:, 2], axes, radius)
            faces: list[Face] = [(near, index, 1.0, back), (far, beyond, index, front)]
        elif isinstance(element, FieldLens):
            row = _row(vertex, axes, radius)
            row[KIND], row[3] = THIN, 1 / float(n[f"{part}.focal_length"])
            faces = [(row, beyond, 1.0, back)]
            if k == chain.mapped:
                bent = row.copy()
                bent[KIND], bent[LENGTH] = MAPPED, float(_pupil_before(camera)) - z
                faces.append((bent, beyond, 1.0, codes[f"{part}{IMAGE}"]))
        elif isinstance(element, Grin):
            row = _row(vertex, axes, radius)
            row[KIND], row[LENGTH] = ROD, length
            row[3:5] = float(n[f"{part}.index"]), float(n[f"{part}.gradient"])
            faces = [(row, beyond, 1.0, back)]
        else:
            assert isinstance(element, LensGroup)
            faces = _group(element, float(n[PATHS["wavelength"]]), vertex, axes, radius, (back, front))
            if beyond != 1:  # as in the closed forms: the liquid ends at a window of no thickness
                faces.append((_row(vertex - length * axes[:, 2], axes, math.inf), beyond, 1.0, front))
        yield (z, 1), faces


def _pupil_before(camera: Camera) -> Number:
    """Where the entrance pupil is seen from just before the objective with a mapping [mm before the main lens]."""
    assert camera.chain is not None
    z = camera[f"elements.{camera.chain.mapped}.distance"]
    return camera.pupil_seen_before(np.nextafter(float(z), np.inf))


def _group(
    element: LensGroup, wavelength: float, vertex: Floats, axes: Floats, radius: float, takers: tuple[int, int]
) -> list[Face]:
    lens = element.lens
    media = [1.0, *(float(surface.glass.index(wavelength)) for surface in lens.surfaces)]
    rows, faces = surface_table(lens).reshape(-1, COLUMNS).copy(), []
    for k in reversed(range(len(rows))):
        row = rows[k]
        row[:3] = vertex + axes @ (row[:3] - [0.0, 0.0, lens.length])
        row[8:17] = (axes @ row[8:17].reshape(3, 3)).reshape(-1)
        row[TURNED] = not np.array_equal(row[8:17].reshape(3, 3), np.eye(3))
        if element.diameter is not None:  # a wider one does not cut; without vignetting nothing does
            row[LIMIT] = OPEN if math.isinf(radius) else min(row[LIMIT], radius * radius)
        faces.append((row, media[k], media[k + 1], takers[k == 0]))
    return faces


def _row(vertex: Floats, axes: Floats, radius: float) -> Floats:
    """A plane face."""
    row = np.zeros(COLUMNS)
    row[:3], row[4], row[LIMIT], row[KIND] = vertex, 1.0, min(radius * radius, OPEN), SPHERE
    row[TURNED], row[8:17] = not np.array_equal(axes, np.eye(3)), axes.reshape(-1)
    return row


def _pair(numbers: Any, place: str) -> tuple[float, float]:
    return float(numbers[f"{place}.0"]), float(numbers[f"{place}.1"])


def _centre(numbers: Any, part: str, z: float) -> Floats:
    return np.array([*_pair(numbers, f"{part}.decentre"), -z])


@kernel()
def cross_flat(
    row: Any, scene: float, sensor: float, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> Any:
    """One ray through a flat face, however it is turned: position, direction, and 0 or why not."""
    nx, ny, nz = row[10], row[13], row[16]
    cosine = dx * nx + dy * ny + dz * nz
    if not cosine < 0.0:
        return x, y, z, dx, dy, dz, MISSED
    px, py, pz = x - row[0], y - row[1], z - row[2]
    t = -(px * nx + py * ny + pz * nz) / cosine
    px, py, pz = px + t * dx, py + t * dy, pz + t * dz
    x, y, z = px + row[0], py + row[1], pz + row[2]
    if px * px + py * py + pz * pz > row[LIMIT]:
        return x, y, z, dx, dy, dz, CLIPPED
    mu = sensor / scene
    square = 1.0 - mu * mu * (1.0 - cosine * cosine)
    if square < 0.0:
        return x, y, z, dx, dy, dz, REFLECTED
    bend = -(sqrt(square) + mu * cosine)
    return x, y, z, mu * dx + bend * nx, mu * dy + bend * ny, mu * dz + bend * nz, 0


@kernel()
def bend_thin(buffer: Any, row: Any, scene: float) -> int:
    """One ray, that in a block's first place, through an ideal lens; 0 or why not."""
    t = (row[2] - buffer[2 * BLOCK]) / buffer[5 * BLOCK]
    x, y = buffer[0] + t * buffer[3 * BLOCK], buffer[BLOCK] + t * buffer[4 * BLOCK]
    buffer[0], buffer[BLOCK], buffer[2 * BLOCK] = x, y, row[2]
    x, y = x - row[0], y - row[1]
    if x * x + y * y > row[LIMIT]:
        return CLIPPED
    # Its tilt matters where liquid begins at it: it leans by the quotients of its axis.
    lean_x, lean_y = row[10] / row[16], row[13] / row[16]
    sx = (buffer[3 * BLOCK] / buffer[5 * BLOCK] + x * row[3] + (scene - 1.0) * lean_x) / scene
    sy = (buffer[4 * BLOCK] / buffer[5 * BLOCK] + y * row[3] + (scene - 1.0) * lean_y) / scene
    shrink = -1.0 / sqrt(1.0 + sx * sx + sy * sy)
    buffer[3 * BLOCK], buffer[4 * BLOCK], buffer[5 * BLOCK] = sx * shrink, sy * shrink, shrink
    return 0


@kernel()
def bend_mapped(buffer: Any, row: Any, law: Any, scene: float) -> int:
    """One ray on an objective's plane, bent by its first order, as its mapping has it; 0 or why not."""
    sx, sy = buffer[3 * BLOCK] / buffer[5 * BLOCK], buffer[4 * BLOCK] / buffer[5 * BLOCK]
    p = scene * sqrt(sx * sx + sy * sy)
    if p > law[0, 1]:
        return CLIPPED
    grown = stretch(law, p, scene)
    buffer[0] += (grown - 1.0) * sx * row[LENGTH]
    buffer[BLOCK] += (grown - 1.0) * sy * row[LENGTH]
    sx, sy = sx * grown, sy * grown
    shrink = -1.0 / sqrt(1.0 + sx * sx + sy * sy)
    buffer[3 * BLOCK], buffer[4 * BLOCK], buffer[5 * BLOCK] = sx * shrink, sy * shrink, shrink
    return 0


@kernel()
def through_rod(buffer: Any, work: Any, row: Any, scene: float) -> int:
    """One ray through a rod of n = n_0 (1 - g^2 r^2/2), in its own axes.

    Along the axis the optical direction p_z stays as it is, and x'' = -(n_0 g/p_z)^2 (1 - g^2 r^2/2) x.
    """
    dx, dy, dz = buffer[3 * BLOCK], buffer[4 * BLOCK], buffer[5 * BLOCK]
    if dz >= 0.0:
        return REFLECTED
    t = (row[2] - buffer[2 * BLOCK]) / dz
    x, y = buffer[0] + t * dx - row[0], buffer[BLOCK] + t * dy - row[1]
    n_0, g2 = row[3], row[4] * row[4]
    r2 = x * x + y * y
    index = n_0 * (1.0 - 0.5 * g2 * r2)
    forward = index * index - dx * dx - dy * dy
    if r2 > row[LIMIT]:
        return CLIPPED
    if index <= 0.0 or forward <= 0.0:
        return REFLECTED
    forward = sqrt(forward)
    phase2 = n_0 * n_0 * g2 / (forward * forward)
    count = max(1, math.ceil(sqrt(phase2) * row[LENGTH] / STEP))
    h = row[LENGTH] / count
    u, v = dx / forward, dy / forward  # per length along the axis, outwards
    for _ in range(count):
        work[0], work[1], work[TERMS], work[TERMS + 1] = x, u * h, y, v * h
        for k in range(TERMS - 2):
            s = 0.0
            for j in range(k + 1):
                s += work[j] * work[k - j] + work[TERMS + j] * work[TERMS + k - j]
            work[2 * TERMS + k] = s
            qx, qy = 0.0, 0.0
            for j in range(k + 1):
                qx += work[2 * TERMS + j] * work[k - j]
                qy += work[2 * TERMS + j] * work[TERMS + k - j]
            scale = -phase2 * h * h / ((k + 1.0) * (k + 2.0))
            work[k + 2] = scale * (work[k] - 0.5 * g2 * qx)
            work[TERMS + k + 2] = scale * (work[TERMS + k] - 0.5 * g2 * qy)
        x, y, u, v = 0.0, 0.0, 0.0, 0.0
        for k in range(TERMS):
            x, y = x + work[k], y + work[TERMS + k]
            u, v = u + k * work[k] / h, v + k * work[TERMS + k] / h
        if x * x + y * y > row[LIMIT]:
            return CLIPPED
    px, py = u * forward / scene, v * forward / scene
    after = 1.0 - px * px - py * py
    if after <= 0.0:
        return REFLECTED
    buffer[0], buffer[BLOCK], buffer[2 * BLOCK] = x + row[0], y + row[1], row[2] - row[LENGTH]
    buffer[3 * BLOCK], buffer[4 * BLOCK], buffer[5 * BLOCK] = px, py, -sqrt(after)
    return 0


@kernel()
def outwards(
    table: Any, media: Any, takers: Any, law: Any, buffer: Any, work: Any,
    hx: float, hy: float, ox: float, oy: float,
) -> Any:  # fmt: skip
    """Height at z = 0 and slope of one ray outside, and its status; `buffer` and `work` are room for a block."""
    shrink = -1.0 / sqrt(1.0 + ox * ox + oy * oy)
    x, y, z, dx, dy, dz = hx, hy, 0.0, ox * shrink, oy * shrink, shrink
    for s in range(len(table)):
        row = table[s]
        kind = int(row[KIND])
        if kind == SPHERE and row[3] == 0.0:
            x, y, z, dx, dy, dz, fate = cross_flat(row, media[s][0], media[s][1], x, y, z, dx, dy, dz)
        else:
            buffer[0], buffer[BLOCK], buffer[2 * BLOCK] = x, y, z
            buffer[3 * BLOCK], buffer[4 * BLOCK], buffer[5 * BLOCK], buffer[6 * BLOCK] = dx, dy, dz, 0.0
            turned = row[TURNED] != 0
            if kind == THIN:
                fate = bend_thin(buffer, row, media[s][0])
            elif kind == MAPPED:
                fate = bend_mapped(buffer, row, law, media[s][0])
            elif kind == ROD:
                if turned:
                    turn(buffer, 1, row, 0, True)
                fate = through_rod(buffer, work, row, media[s][0])
                if turned:
                    turn(buffer, 1, row, 0, False)
            else:
                pass_surfaces(buffer, 1, row, media[s], 1, True, True, work)
                fate = int(buffer[6 * BLOCK]) % 8
            x, y, z = buffer[0], buffer[BLOCK], buffer[2 * BLOCK]
            dx, dy, dz = buffer[3 * BLOCK], buffer[4 * BLOCK], buffer[5 * BLOCK]
        if fate == CLIPPED:
            return 0.0, 0.0, 0.0, 0.0, int(takers[s])
        if fate == REFLECTED:
            return 0.0, 0.0, 0.0, 0.0, TOTALLY_REFLECTED
        if fate != 0 or not dz < 0.0:
            return 0.0, 0.0, 0.0, 0.0, UNTRACEABLE
    sx, sy = dx / dz, dy / dz
    return x - sx * z, y - sy * z, sx, sy, 0


TOTALLY_REFLECTED, UNTRACEABLE = int(Status.REFLECTED), int(Status.UNTRACEABLE)


@kernel()
def carry(
    table: Any, media: Any, takers: Any, law: Any, buffer: Any, work: Any, rays: Any, out: Any, status: Any
) -> None:
    """Rays of x, y, dx/dz, dy/dz at the main lens to the same outside, (4, N); `buffer` and `work` are room."""
    for i in range(rays.shape[1]):
        hx, hy, ox, oy = rays[0, i], rays[1, i], rays[2, i], rays[3, i]
        if not abs(hx) + abs(hy) + abs(ox) + abs(oy) < OPEN:
            status[i] = UNTRACEABLE
            continue
        out[0, i], out[1, i], out[2, i], out[3, i], status[i] = outwards(
            table, media, takers, law, buffer, work, hx, hy, ox, oy
        )
