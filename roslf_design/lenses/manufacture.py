"""A lens as it was made: radii, thicknesses, indices, decentres, tilts and wedges missed, one build or many at once.

Places are named as on a drawing of the lens as it stands in the camera, from 1 at the scene: ``surfaces.1.radius``,
``surfaces.1.thickness``, ``surfaces.1.index``, ``elements.1.decentre.0`` (along x), ``elements.1.tilt.1`` (about y).
An element is what moves as one piece (`Prescription.elements`), so a cemented doublet tilts as a whole.

Whatever the order given: first shapes, thicknesses and glasses, then surfaces' own decentres, tilts and wedges, then
each element's tilt and decentre.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem
from .glass import AIR, Glass
from .prescription import LensError, Prescription, Surface, abcd, rotation, surface_table
from .tracer import COLUMNS, CONIC, SPHERE, SurfaceStack

Array = NDArray[np.float64]

D_LINE, F_LINE, C_LINE = 587.5618e-6, 486.1327e-6, 656.2725e-6
"""Wavelengths that an Abbe number is told by [mm]."""
HEIGHTS = np.linspace(0.0, 1.0, 9)
"""Parts of the clear aperture at which the glass of a build must not run out."""
SAG_ROOM = 1.25
"""How much farther than the nominal sag an asphere's crossing is looked for."""


@lru_cache(maxsize=64)
def lens_places(lens: Prescription) -> Mapping[str, str]:
    """Everything that the making of a lens can miss, with what it measures.

    Returns
    -------
    mapping
        Place to "length", "curvature", "angle", or "number" (an index, an Abbe number, a conic constant). An element's
        wedge is the tilt of its last surface about that surface's vertex; its own tilt is about the middle of its axis.
    """
    found: dict[str, str] = {}

    def pairs(name: str, misses: tuple[str, ...]) -> None:
        for miss in misses:
            found.update({f"{name}.{miss}.{axis}": "length" if miss == "decentre" else "angle" for axis in (0, 1)})

    last = len(lens.surfaces)
    for number, surface in enumerate(lens.surfaces, start=1):
        if surface.curvature:
            found[f"surfaces.{number}.radius"] = "length"
            found[f"surfaces.{number}.conic"] = "number"
        found[f"surfaces.{number}.curvature"] = "curvature"
        if number < last:
            found[f"surfaces.{number}.thickness"] = "length"
        if surface.glass != AIR:
            found[f"surfaces.{number}.index"] = "number"
            if abbe_number(surface.glass) is not None:
                found[f"surfaces.{number}.abbe"] = "number"
        pairs(f"surfaces.{number}", ("decentre", "tilt"))
    for number, members in enumerate(lens.elements, start=1):
        pairs(f"elements.{number}", ("decentre", "tilt", "wedge") if len(members) > 1 else ("decentre", "tilt"))
    return found


@lru_cache(maxsize=256)
def abbe_number(glass: Glass) -> float | None:
    """V_d = (n_d - 1)/(n_F - n_C); None for a medium without dispersion, or whose formula does not reach the lines."""
    try:
        d, f, c = (float(glass.index(line)) for line in (D_LINE, F_LINE, C_LINE))
    except InputError:
        return None
    return (d - 1) / (f - c) if f > c else None


def lens_values(lens: Prescription, wavelength: float) -> dict[str, float]:
    """The lens's number at every place of `lens_places` [mm, 1/mm, rad or none]; misalignments count from as drawn."""
    found = {}
    for place in lens_places(lens):
        part, number, what = place.split(".")[:3]
        surface = lens.surfaces[int(number) - 1]
        if part == "elements" or what in ("decentre", "tilt"):
            found[place] = 0.0
        elif what == "index":
            found[place] = float(surface.glass.index(wavelength))
        else:
            found[place] = abbe_number(surface.glass) or 0.0 if what == "abbe" else float(getattr(surface, what))
    return found


def as_made(lens: Prescription, values: Mapping[str, float], wavelength: float) -> Prescription:
    """The lens with some places at other values than drawn.

    Parameters
    ----------
    lens : Prescription
        As drawn.
    values : mapping
        Place to value [mm, 1/mm, rad or none].
    wavelength : float
        At which indices are told [mm].

    Raises
    ------
    LensError
        The lens has no such place (those it has are named), or the values make it impossible.
    """
    places = lens_places(lens)
    for place in values:
        if place not in places:
            message = f"is no place of {lens.name} that can be missed; there are {', '.join(places)}"
            raise LensError((Problem(place, message),))
    made = {place: np.array([float(value)]) for place, value in values.items()}
    shape = _Shapes(lens, wavelength, made, 1, None)
    if shape.turned_over[0]:
        raise LensError((Problem("surfaces", "a radius missed by so much turns its surface inside out"),), lens.name)
    offsets, poses = _offsets(lens, wavelength, made, 1), _Poses(lens, shape.vertices, made)
    surfaces = []
    for row, old in enumerate(lens.surfaces):
        curvature, conic, gap, offset = (float(part[row, 0]) for part in (shape.c, shape.k, shape.gap, offsets))
        glass = old.glass.with_offset(offset) if offset else old.glass
        changed = replace(old, curvature=curvature, conic=conic, thickness=gap, glass=glass)
        surfaces.append(poses.posed(changed, row))
    return replace(lens, surfaces=tuple(surfaces))


def turned(lens: Prescription, alpha: float, beta: float, pivot: float) -> Prescription:
    """The whole lens turned by alpha about x, then beta about y [rad], about the axis point at `pivot` along z [mm]."""
    poses = _Poses(lens, np.array(lens.vertices)[:, None], {})
    poses.turn(range(len(lens.surfaces)), np.array([[0.0, 0.0, pivot]]), rotation(alpha, beta)[None])
    return replace(lens, surfaces=tuple(poses.posed(surface, row) for row, surface in enumerate(lens.surfaces)))


class LensBuilds(NamedTuple):
    """Builds of one lens; T of them, S surfaces."""

    table: Array
    """Rows for the kernels, (T, S * COLUMNS)."""
    media: Array
    """Indices before, between and after the surfaces, (T, S + 1)."""
    sound: NDArray[np.bool_]
    """Which builds are lenses at all, (T,); the others hold the nominal lens."""
    power: Array
    """1/f of the centred lens [1/mm], (T,)."""
    front_principal: Array
    rear_principal: Array
    """Along z from the nominal first vertex [mm], (T,)."""
    front: Array
    rear: Array
    """Foremost and hindmost point of the lens on the axis or at its rims [mm], (T,)."""

    @property
    def stack(self) -> SurfaceStack:
        """What rays are traced through."""
        return SurfaceStack(self.table, self.media)


def lens_builds(
    lens: Prescription,
    wavelength: float,
    values: Mapping[str, Array],
    trials: int,
    *,
    light: Array | None = None,
    diameter: Array | None = None,
    tilt: tuple[Array | float, Array | float] = (0.0, 0.0),
) -> LensBuilds:
    """Builds of a lens.

    Parameters
    ----------
    lens : Prescription
        As drawn.
    wavelength : float
        At which indices are told [mm].
    values : mapping
        Places of `manufacture.lens_places` to numbers, (T,).
    trials : int
        T.
    light : ndarray, optional
        Wavelength of each build [mm], (T,); the same by default.
    diameter : ndarray, optional
        D of the builds [mm], (T,): the narrowest surfaces are made as wide.
    tilt : pair
        Of the whole lens about the middle of its principal planes, about x, then about y [rad].
    """
    shape = _Shapes(lens, wavelength, values, trials, diameter)
    sound = shape.sound()
    if not sound.all():  # a build that is no lens is traced as the nominal one, and told apart
        values = {place: np.where(sound, value, shape.drawn[place]) for place, value in values.items()}
        wide = None if diameter is None else np.where(sound, diameter, shape.narrowest)
        shape = _Shapes(lens, wavelength, values, trials, wide)
    media = np.ones((len(lens.surfaces) + 1, trials))
    for row, surface in enumerate(lens.surfaces):
        media[row + 1] = surface.glass.index(wavelength if light is None else light)
    media[1:] += _offsets(lens, wavelength, values, trials)
    bends = [2 * surface.asphere[0] if surface.asphere else 0.0 for surface in lens.surfaces]
    a, _, c, d = abcd([row + bend for row, bend in zip(shape.c, bends, strict=True)], list(shape.gap), list(media))
    with np.errstate(divide="ignore"):
        focal = -1 / c
    front, rear = (1 - d) * focal, shape.vertices[-1] + (a - 1) * focal
    poses = _Poses(lens, shape.vertices, values)
    if np.any(np.asarray(tilt[0])) or np.any(np.asarray(tilt[1])):
        middle = np.zeros((trials, 3))
        middle[:, 2] = (front + rear) / 2
        poses.turn(range(len(lens.surfaces)), middle, rotation(*tilt))
    return LensBuilds(_table(lens, shape, poses), media.T.copy(), sound, -c, front, rear, *shape.ends())


class _Shapes:
    """Curvatures, conics, gaps and sizes of the builds, (S, T) each."""

    def __init__(
        self, lens: Prescription, wavelength: float, values: Mapping[str, Array], trials: int, diameter: Array | None
    ) -> None:
        self.lens, self.drawn = lens, lens_values(lens, wavelength)
        surfaces = lens.surfaces
        self.narrowest = 2 * min(surface.semi_diameter for surface in surfaces)
        c, k, gap, semi = (np.empty((len(surfaces), trials)) for _ in range(4))
        self.turned_over = np.zeros(trials, bool)
        for row, surface in enumerate(surfaces):
            name = f"surfaces.{row + 1}"
            radius = values.get(f"{name}.radius")
            c[row] = surface.curvature
            if radius is not None:
                bad = radius * surface.radius <= 0
                self.turned_over |= bad
                c[row] = 1 / np.where(bad, surface.radius, radius)
            c[row] += values.get(f"{name}.curvature", surface.curvature) - surface.curvature
            k[row] = values.get(f"{name}.conic", surface.conic)
            gap[row] = values.get(f"{name}.thickness", surface.thickness)
            semi[row] = surface.semi_diameter
            if diameter is not None and 2 * surface.semi_diameter <= self.narrowest * (1 + 1e-9):
                semi[row] = diameter / 2
        self.c, self.k, self.gap, self.semi = c, k, gap, semi
        self.bent = any(place.rsplit(".", 1)[1] in ("radius", "curvature", "conic", "thickness") for place in values)

    @property
    def vertices(self) -> Array:
        """Place of each vertex along z [mm], (S, T)."""
        return np.concatenate([np.zeros((1, self.gap.shape[1])), np.cumsum(self.gap[:-1], axis=0)])

    def sag(self, row: int, height: Array) -> Array:
        """Sag of a surface at heights [mm], nan beyond where it turns back."""
        square = height * height
        c, k = self.c[row], self.k[row]
        with np.errstate(invalid="ignore"):
            total = c * square / (1 + np.sqrt(1 - (1 + k) * c * c * square))
        for power, a in enumerate(self.lens.surfaces[row].asphere, start=1):
            total = total + a * square**power
        return np.asarray(total)

    def sound(self) -> NDArray[np.bool_]:
        """No surface inside out or wider than itself, no gap used up: what `Prescription` asks of one lens."""
        good = ~self.turned_over & np.all(np.isfinite(self.c) & np.isfinite(self.k), axis=0)
        good &= np.all((self.gap >= 0) & (self.semi > 0), axis=0)
        good &= np.all((1 + self.k) * np.square(self.c * self.semi) < 1, axis=0)
        if not self.bent:
            return np.asarray(good)
        surfaces = self.lens.surfaces
        for row in range(len(surfaces) - 1):
            air = surfaces[row].glass.name == "air" and (surfaces[row].is_plane or surfaces[row + 1].is_plane)
            if air:
                continue
            height = HEIGHTS[:, None] * np.minimum(self.semi[row], self.semi[row + 1])
            left = self.gap[row] + self.sag(row + 1, height) - self.sag(row, height)
            good &= np.all(left >= -1e-9, axis=0)
        return np.asarray(good)

    def ends(self) -> tuple[Array, Array]:
        """Foremost and hindmost point [mm], (T,)."""
        last = len(self.c) - 1
        front = np.minimum(0.0, self.sag(0, self.semi[0]))
        return front, self.vertices[last] + np.maximum(0.0, self.sag(last, self.semi[last]))


def _offsets(lens: Prescription, wavelength: float, values: Mapping[str, Array], trials: int) -> Array:
    """What is missed of the indices after the surfaces, told at the design's wavelength, (S, T)."""
    found = np.zeros((len(lens.surfaces), trials))
    for row, surface in enumerate(lens.surfaces):
        name, glass = f"surfaces.{row + 1}", surface.glass
        if f"{name}.abbe" in values:  # n_d kept: n - n_d goes like 1/V
            spread = float(glass.index(wavelength) - glass.index(D_LINE))
            found[row] += spread * ((abbe_number(glass) or 0.0) / values[f"{name}.abbe"] - 1)
        if f"{name}.index" in values:
            found[row] += values[f"{name}.index"] - float(glass.index(wavelength))
    return found


class _Poses:
    """Where the surfaces of T builds stand: by how much their vertices are off, (S, T, 3), and their axes."""

    def __init__(self, lens: Prescription, vertices: Array, values: Mapping[str, Array]) -> None:
        self.z, trials = vertices, vertices.shape[1]
        self.shift = np.array([np.broadcast_to(surface.shift, (trials, 3)) for surface in lens.surfaces])
        self.axes: list[Array | None] = [None] * len(lens.surfaces)
        ends = {members[-1]: f"elements.{n}.wedge" for n, members in enumerate(lens.elements, 1) if len(members) > 1}
        for row, surface in enumerate(lens.surfaces):
            name = f"surfaces.{row + 1}"
            tilts = [
                sum((values[place] for place in (f"{name}.tilt.{k}", f"{ends.get(row)}.{k}") if place in values), drawn)
                for k, drawn in enumerate(surface.tilt)
            ]
            if any(isinstance(tilt, np.ndarray) for tilt in tilts) or surface.tilt != (0.0, 0.0):
                alpha, beta = (np.broadcast_to(tilt, trials) for tilt in tilts)
                self.axes[row] = rotation(alpha, 0.0) @ rotation(0.0, beta)
            self._step(values, name, (row,))
        for number, members in enumerate(lens.elements, start=1):
            name = f"elements.{number}"
            if f"{name}.tilt.0" in values or f"{name}.tilt.1" in values:
                first, last = self._places(members[0]), self._places(members[-1])
                tilts = [np.broadcast_to(values.get(f"{name}.tilt.{k}", 0.0), trials) for k in (0, 1)]
                self.turn(members, (first + last) / 2, rotation(*tilts))
            self._step(values, name, members)

    def _places(self, row: int) -> Array:
        at: Array = self.shift[row].copy()
        at[:, 2] += self.z[row]
        return at

    def _step(self, values: Mapping[str, Array], name: str, members: Iterable[int]) -> None:
        for axis in (0, 1):
            if f"{name}.decentre.{axis}" in values:
                for row in members:
                    self.shift[row, :, axis] += values[f"{name}.decentre.{axis}"]

    def turn(self, members: Iterable[int], pivot: Array, turns: Array) -> None:
        """Turn surfaces as one, about points (T, 3) by matrices (T or 1, 3, 3)."""
        for row in members:
            off = self._places(row) - pivot
            self.shift[row] = pivot + (turns @ off[:, :, None])[:, :, 0]
            self.shift[row, :, 2] -= self.z[row]
            old = self.axes[row]
            self.axes[row] = np.broadcast_to(turns, (len(off), 3, 3)) if old is None else turns @ old

    def posed(self, surface: Surface, row: int) -> Surface:
        """A surface as it stands in the first build."""
        dx, dy, dz = (float(value) for value in self.shift[row, 0])
        axes, tilt = self.axes[row], surface.tilt
        if axes is not None:
            x, y, z = axes[0, :, 2]
            tilt = math.atan2(-y, z), math.atan2(x, math.hypot(y, z))
        return replace(surface, shift=(dx, dy, dz), tilt=tilt)


def _table(lens: Prescription, shape: _Shapes, poses: _Poses) -> Array:
    trials, count = shape.c.shape[1], len(lens.surfaces)
    table = np.tile(surface_table(lens), (trials, 1)).reshape(trials, count, COLUMNS)
    for row in range(count):
        cells = table[:, row]
        cells[:, 0:3] = poses.shift[row]
        cells[:, 2] += shape.vertices[row]
        cells[:, 3], cells[:, 4], cells[:, 5] = shape.c[row], 1 + shape.k[row], np.square(shape.semi[row])
        if cells[0, 6] in (SPHERE, CONIC):
            cells[:, 6] = np.where((shape.k[row] == 0) | (shape.c[row] == 0), SPHERE, CONIC)
        cells[:, 25] *= SAG_ROOM
        axes = poses.axes[row]
        if axes is not None:
            cells[:, 7] = 1.0
            cells[:, 8:17] = axes.reshape(-1, 9)
    return table.reshape(trials, count * COLUMNS)
