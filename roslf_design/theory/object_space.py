"""Exact rays through what stands before the main lens: Snell's law at every face, every clear aperture met in order.

Backward, from the main lens to the scene, in the system's axes (main lens at z = 0, +z towards the sensor). Faces are
rows of `lenses.tracer`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from ..bore.chain import MEDIUM
from ..bore.faces import HOLE, KIND, LIMIT, OPEN, STOP, TURNED, Face, Surroundings, axes_of, stop_row, vertex_of
from ..bore.opening import UNBOUNDED, ClearAperture, inside
from ..camera import Camera, Number
from ..fates import FATES
from ..lenses.tracer import (
    BLOCK,
    CLIPPED,
    COARSE,
    COLUMNS,
    INVALID,
    LENGTH,
    MAPPED,
    MISSED,
    REFLECTED,
    ROD,
    ROWS,
    SPHERE,
    THIN,
    bend_mapped,
    cross_thin,
    pass_surfaces,
    seconds_through,
)

Floats = NDArray[np.float64]

MAIN_LENS, FAP = 1, 2
"""Numbers of openings in rays' states: the main lens, the flexible angular plane (FAP), then the others of
`Camera.openings_ahead`; 0 for an element's face that no opening of the design stands for."""


class SceneRays(NamedTuple):
    """Rays in the medium of the scene."""

    height: Floats
    """Points where the rays, prolonged, meet z = 0, (2, ...) [mm]; of a lost ray 0, as its slope."""
    slope: Floats
    """dx/dz and dy/dz, (2, ...)."""
    status: NDArray[np.int16]
    """State of the ray (`..fates`): what took it first, from the main lens outwards, and at which opening, (...)."""


@dataclass(frozen=True, eq=False)
class ObjectSpaceFaces:
    """Everything that a ray meets between main lens and scene, as the kernels take it; from the main lens outwards.

    Leading axes are those of the builds, where there are many.
    """

    table: Floats
    """A row a face, stop, ideal lens or rod, (..., S, 26)."""
    media: Floats
    """Indices on the scene's and on the sensor's side of each, (..., S, 2)."""
    openings: NDArray[np.int16]
    """Number of the opening that each face belongs to, as in rays' states, (S,); where builds differ (..., S)."""
    law: Floats
    """Law of an objective with a mapping (`..lenses.angles`); no rows where there is none."""
    names: tuple[str, ...] = ()
    """Names of the faces and openings: "plate 1, back", "stop 2"; in the first build."""

    @classmethod
    def of(cls, camera: Camera, *, clip: bool = True) -> ObjectSpaceFaces:
        """All that stands before the main lens of a camera, in the order in which it stands in each build.

        Parameters
        ----------
        clip : bool
            Whether clear apertures stop rays.
        """
        units = ((start, rank, face) for start, rank, unit in _units(camera, clip) for face in unit)
        starts, ranks, faces = zip(*units, strict=True)
        table = np.empty((*camera.shape, len(faces), COLUMNS))
        media = np.empty((*camera.shape, len(faces), 2))
        for k, face in enumerate(faces):
            table[..., k, :], media[..., k, 0], media[..., k, 1] = face.row, face.scene, face.sensor
        *_, parts, names = zip(*faces, strict=True)
        if not clip:
            table[..., LIMIT] = OPEN
        numbers = {rim.part: FAP + k for k, rim in enumerate(camera.openings_ahead)}
        # Of a thin element both faces are one opening; one that no aperture takes rays at is lost in the element.
        openings = [numbers.get(part, numbers.get(f"{part.rpartition('.')[0]}.0", 0)) for part in parts]
        begin = np.stack([np.broadcast_to(start, camera.shape) for start in starts], axis=-1)
        order = np.lexsort((np.broadcast_to(ranks, begin.shape), begin))
        first = order.reshape(-1, len(faces))[0] if order.size else np.arange(len(faces))
        if alike := bool((order == first).all()):
            table, media = (np.take(part, first, axis=-2) for part in (table, media))
        else:
            table, media = (np.take_along_axis(part, order[..., None], axis=-2) for part in (table, media))
        belongs = np.array(openings, np.int16)[first if alike else order]
        names = tuple(names[k] for k in first)
        return cls(table, media, belongs, camera.mapping.kernel, names)

    @classmethod
    def unclipped(cls, camera: Camera) -> ObjectSpaceFaces:
        """`of` a camera, past which clear apertures let every ray; told once of each."""
        if cls not in camera.worked_out:
            camera.worked_out[cls] = cls.of(camera, clip=False)
        faces: ObjectSpaceFaces = camera.worked_out[cls]
        return faces

    @property
    def for_pixels(self) -> ObjectSpaceFaces:
        """Faces for pixels: rays run through rods to some millionths of their heights and slopes, ten times as fast."""
        table = self.table.copy()
        table[table[..., KIND] == ROD, COARSE] = 1.0
        return replace(self, table=table)

    def rays(self, height: tuple[ArrayLike, ArrayLike], slope: tuple[ArrayLike, ArrayLike]) -> SceneRays:
        """Carry rays outwards, through one build or each build's own: builds are the rays' last axes then.

        Parameters
        ----------
        height : pair of array_like
            Where they cross the main lens's plane, from the system's axis [mm].
        slope : pair of array_like
            dx/dz and dy/dz just before it.
        """
        lines = np.stack(np.broadcast_arrays(*(np.asarray(part, float) for part in (*height, *slope))))
        shape, count = lines.shape[1:], math.prod(self.table.shape[:-2])
        table, media = (
            np.ascontiguousarray(part.reshape(count, *part.shape[-2:])) for part in (self.table, self.media)
        )
        rays = np.ascontiguousarray(lines.reshape(4, -1, count).transpose(2, 0, 1))
        out, status = np.zeros_like(rays), np.zeros((count, rays.shape[2]), np.int16)
        room = np.empty(ROWS * BLOCK), np.empty(BLOCK)
        openings = np.ascontiguousarray(np.broadcast_to(self.openings, (count, table.shape[1])))
        # Angles from sines come out of numpy and of the compiler a bit apart.
        if len(self.law) or _carry_builds.pays(seconds_through(table[0, :, KIND]) * status.size):
            _carry_builds.compiled(table, media, openings, self.law, *room, rays, out, status)
        else:
            buffer, work = (_plain(part) for part in room)
            for k in range(count):
                faces, indices = ([_plain(row) for row in part[k]] for part in (table, media))
                carry.interpreted(
                    faces, indices, openings[k], self.law, buffer, work, _plain(rays[k]), out[k], status[k]
                )
        outside = out.transpose(1, 2, 0).reshape(4, *shape)
        return SceneRays(outside[:2], outside[2:], status.T.reshape(shape))

    @property
    def bending(self) -> tuple[ObjectSpaceFaces, ObjectSpaceFaces]:
        """Only what bends rays: what stands between main lens and FAP, and what stands before the FAP."""
        table, index = self.table, self.media
        flat = np.isin(table[..., KIND], (SPHERE, STOP)) & (table[..., 3] == 0)
        bends = ~flat | (index[..., 0] != index[..., 1])
        rows = np.flatnonzero(bends.reshape(-1, bends.shape[-1]).any(0))
        fap = self.names.index("FAP")
        return self._only(rows[rows < fap]), self._only(rows[rows > fap])

    def _only(self, rows: NDArray[np.intp]) -> ObjectSpaceFaces:
        return replace(
            self, table=self.table[..., rows, :], media=self.media[..., rows, :], openings=self.openings[..., rows],
            names=tuple(self.names[row] for row in rows),
        )  # fmt: skip

    def rays_at(
        self, distances: Sequence[float], height: tuple[ArrayLike, ArrayLike], slope: tuple[ArrayLike, ArrayLike]
    ) -> Iterator[SceneRays]:
        """Rays past only what stands nearer than each of some growing distances [mm]; then past all.

        They go on straight from there, be it in glass; in a gradient-index rod they are where they are inside. A ray is
        lost from where it is lost on.
        """
        lost, first, rest = np.zeros((), np.int16), 0, self._some(0, len(self.table))
        for distance in (*distances, math.inf):
            nearer = -rest.table[:, 2] < distance
            end = len(nearer) if nearer.all() else max(first, int(np.argmin(nearer)))
            stage, rod = rest._some(first, end), rest.table[end - 1] if end > first else rest.table[0]
            left = rod[LENGTH] - rod[2] - distance if rod[KIND] == ROD else 0.0
            within = end > first and left > 0
            if within:  # cut in two, with its axial index between: slope times index goes on as it is
                depth = rod[LENGTH] - left
                stage.table[-1, LENGTH], stage.media[-1, 0] = depth, rod[3]
                rod[:3] -= depth * rod[[10, 13, 16]]
                rod[LENGTH], rest.media[end - 1, 1] = left, rod[3]
            (h_x, h_y), (s_x, s_y), status = stage.rays(height, slope)
            height, slope, first = (h_x, h_y), (s_x, s_y), end - within
            lost = np.where(lost, lost, status)
            yield SceneRays(np.stack(height), np.stack(slope), lost)

    def _some(self, first: int, end: int) -> ObjectSpaceFaces:
        """Copies of the faces from one to another."""
        some = slice(first, end)
        return ObjectSpaceFaces(
            self.table[some].copy(), self.media[some].copy(), self.openings[some], self.law, self.names[some]
        )


def _plain(array: Floats) -> Any:
    """Its numbers come out as Python's own, not as numpy's slow ones."""
    return memoryview(array)  # type: ignore[arg-type]


def _units(camera: Camera, clip: bool) -> Iterator[tuple[Number, int, list[Face]]]:
    """Stops and elements, each with where it begins; a stop, 0, on an element's vertex comes before that, 1.

    Stops that do not clip let everything through.
    """
    n = camera.numbers
    medium_from = camera.chain.end(n)
    medium = n.get(MEDIUM, 1.0)

    def around(z: Number) -> Number:
        return np.where(np.greater_equal(z, medium_from), medium, 1.0)

    for rim in camera.stop_openings:
        at, z = camera.towards_scene(rim), rim.ruler_distance
        opening = ClearAperture.of(at.numbers, rim.part) if clip else UNBOUNDED
        row = stop_row(vertex_of(at, at["distance"]), axes_of(at), opening)
        yield z, 0, [Face(row, around(z), around(z), rim.part, rim.name)]
    for part in camera.in_bore:
        surroundings = Surroundings(around(part.end), camera.pupil_seen_before)
        yield part.start, 1, part.element.faces(part.at, part.name, surroundings)


@kernel()
def _cross_flat(
    row: Any, scene: float, sensor: float, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> Any:
    """One ray through a flat face, however it is turned: position, direction, and 0 or why not."""
    if row[TURNED] == 0.0:
        if not dz < 0.0:
            return x, y, z, dx, dy, dz, MISSED
        t = (row[2] - z) / dz
        x, y = x + t * dx, y + t * dy
        px, py = x - row[0], y - row[1]
        if px * px + py * py > row[LIMIT]:
            return x, y, row[2], dx, dy, dz, CLIPPED
        if scene != sensor:
            mu = sensor / scene
            dx, dy = mu * dx, mu * dy
            square = 1.0 - dx * dx - dy * dy
            if square < 0.0:
                return x, y, row[2], dx, dy, dz, REFLECTED
            dz = -sqrt(square)
        return x, y, row[2], dx, dy, dz, 0
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
def _cross_stop(row: Any, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> Any:
    """One ray through a stop, however it is turned: position, and 0 or why not."""
    nx, ny, nz = row[10], row[13], row[16]
    cosine = dx * nx + dy * ny + dz * nz
    if not cosine < 0.0:
        return x, y, z, MISSED
    t = -((x - row[0]) * nx + (y - row[1]) * ny + (z - row[2]) * nz) / cosine
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    px, py, pz = x - row[0], y - row[1], z - row[2]
    across = row[8] * px + row[11] * py + row[14] * pz
    along = row[9] * px + row[12] * py + row[15] * pz
    return x, y, z, 0 if inside(row, HOLE, across, along) else CLIPPED


@kernel()
def outwards(table: Any, media: Any, openings: Any, law: Any, buffer: Any, work: Any, m: int) -> None:
    """Carry a block from z = 0 outwards: x, y, -, dx/dz, dy/dz there to the same outside, prolonged, and states.

    `work` is room for a block.
    """
    for i in range(m):
        ox, oy = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i]
        shrink = -1.0 / sqrt(1.0 + ox * ox + oy * oy)
        buffer[2 * BLOCK + i], buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = 0.0, ox * shrink, oy * shrink
        buffer[5 * BLOCK + i], buffer[6 * BLOCK + i] = shrink, 0.0
    for s in range(len(table)):
        row = table[s]
        kind = int(row[KIND])
        flat, thin = kind == SPHERE and row[3] == 0.0, kind == THIN and row[TURNED] == 0.0
        single = flat or thin or kind in (STOP, MAPPED)
        if not single:
            pass_surfaces(buffer, m, row, media[s], 1, True, True, work)
        for i in range(m):
            fate = int(buffer[6 * BLOCK + i])
            if fate < 0:  # lost before: states that are told already are below 0
                continue
            x, y, z = buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i]
            dx, dy, dz = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i]
            if flat:
                x, y, z, dx, dy, dz, fate = _cross_flat(row, media[s][0], media[s][1], x, y, z, dx, dy, dz)
            elif kind == STOP:
                x, y, z, fate = _cross_stop(row, x, y, z, dx, dy, dz)
            elif thin:
                x, y, dx, dy, dz, r2 = cross_thin(row, 0, media[s][1], media[s][0], -1.0, x, y, z, dx, dy, dz)
                z, fate = row[2], CLIPPED if r2 > row[LIMIT] else 0
            elif kind == MAPPED:
                x, y, sx, sy, p = bend_mapped(law, row[LENGTH], media[s][0], False, x, y, dx / dz, dy / dz)
                shrink = -1.0 / sqrt(1.0 + sx * sx + sy * sy)
                dx, dy, dz, fate = sx * shrink, sy * shrink, shrink, CLIPPED if p > law[0, 1] else 0
            fate %= FATES
            if fate != 0 or not dz < 0.0:
                buffer[6 * BLOCK + i] = -1.0 * (FATES * int(openings[s]) + (fate if fate != 0 else MISSED))
            elif single:
                buffer[i], buffer[BLOCK + i], buffer[2 * BLOCK + i] = x, y, z
                buffer[3 * BLOCK + i], buffer[4 * BLOCK + i], buffer[5 * BLOCK + i] = dx, dy, dz
    for i in range(m):
        lost = buffer[6 * BLOCK + i] != 0.0
        shrink = 1.0 if lost else buffer[5 * BLOCK + i]
        sx, sy, z = buffer[3 * BLOCK + i] / shrink, buffer[4 * BLOCK + i] / shrink, buffer[2 * BLOCK + i]
        x, y = buffer[i] - sx * z, buffer[BLOCK + i] - sy * z
        buffer[i], buffer[BLOCK + i], buffer[6 * BLOCK + i] = (
            0.0 if lost else x, 0.0 if lost else y, -buffer[6 * BLOCK + i],
        )  # fmt: skip
        buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = 0.0 if lost else sx, 0.0 if lost else sy


@kernel()
def carry(
    table: Any, media: Any, openings: Any, law: Any, buffer: Any, work: Any, rays: Any, out: Any, status: Any
) -> None:
    """Rays of x, y, dx/dz, dy/dz at the main lens to the same outside, (4, N); `buffer` and `work` are room."""
    for first in range(0, rays.shape[1], BLOCK):
        m = min(BLOCK, rays.shape[1] - first)
        for i in range(m):
            hx, hy, ox, oy = rays[0, first + i], rays[1, first + i], rays[2, first + i], rays[3, first + i]
            good = abs(hx) + abs(hy) + abs(ox) + abs(oy) < OPEN
            buffer[i], buffer[BLOCK + i] = hx if good else 0.0, hy if good else 0.0
            buffer[3 * BLOCK + i], buffer[4 * BLOCK + i] = ox if good else 0.0, oy if good else 0.0
        outwards(table, media, openings, law, buffer, work, m)
        for i in range(m):
            hx, hy, ox, oy = rays[0, first + i], rays[1, first + i], rays[2, first + i], rays[3, first + i]
            if not abs(hx) + abs(hy) + abs(ox) + abs(oy) < OPEN:
                status[first + i] = INVALID
                continue
            out[0, first + i], out[1, first + i] = buffer[i], buffer[BLOCK + i]
            out[2, first + i], out[3, first + i] = buffer[3 * BLOCK + i], buffer[4 * BLOCK + i]
            status[first + i] = int(buffer[6 * BLOCK + i])


@kernel()
def _carry_builds(
    table: Any, media: Any, openings: Any, law: Any, buffer: Any, work: Any, rays: Any, out: Any, status: Any
) -> None:
    """`carry` through builds, the first axis of all but `law`."""
    for build in range(len(table)):
        carry(table[build], media[build], openings[build], law, buffer, work, rays[build], out[build], status[build])
