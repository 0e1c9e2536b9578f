"""Many builds of one lens at once: the numbers of their surfaces over trials, ready for the kernels.

What `manufacture.as_made` does to one lens, in the same order, on arrays with the builds as leading axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .kernels import COLUMNS, CONIC, SPHERE
from .manufacture import D_LINE, abbe_number, lens_values
from .prescription import Prescription
from .trace import surface_table

Array = NDArray[np.float64]

HEIGHTS = np.linspace(0.0, 1.0, 9)
"""Parts of the clear aperture at which the glass of a build must not run out."""
SAG_ROOM = 1.25
"""How much farther than the nominal sag an asphere's crossing is looked for."""


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
    index = _indices(lens, wavelength, light, values, trials)
    power, front, rear = _first_order(shape, index)
    table = _table(lens, shape, values, tilt, (front + rear) / 2)
    ends = shape.ends()
    return LensBuilds(table, index, sound, power, front, rear, *ends)


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


def _indices(
    lens: Prescription, wavelength: float, light: Array | None, values: Mapping[str, Array], trials: int
) -> Array:
    """Media of the builds; what is missed of a glass is told at the design's wavelength."""
    index = np.ones((trials, len(lens.surfaces) + 1))
    for row, surface in enumerate(lens.surfaces):
        name, glass = f"surfaces.{row + 1}", surface.glass
        index[:, row + 1] = glass.index(wavelength if light is None else light)
        if f"{name}.abbe" in values:
            spread = float(glass.index(wavelength) - glass.index(D_LINE))
            index[:, row + 1] += spread * ((abbe_number(glass) or 0.0) / values[f"{name}.abbe"] - 1)
        if f"{name}.index" in values:
            index[:, row + 1] += values[f"{name}.index"] - float(glass.index(wavelength))
    return index


def _first_order(shape: _Shapes, index: Array) -> tuple[Array, Array, Array]:
    """Power and principal planes of the centred builds, as `first_order` has them."""
    trials = index.shape[0]
    one = np.ones(trials)
    a, b, c, d = one, 0 * one, 0 * one, one
    for row, surface in enumerate(shape.lens.surfaces):
        before, after = index[:, row], index[:, row + 1]
        curvature = shape.c[row] + (2 * surface.asphere[0] if surface.asphere else 0.0)
        bend = -(after - before) / after * curvature
        c, d = bend * a + before / after * c, bend * b + before / after * d
        a, b = a + shape.gap[row] * c, b + shape.gap[row] * d
    with np.errstate(divide="ignore"):
        focal = -1 / c
    return -c, (1 - d) * focal, shape.vertices[-1] + (a - 1) * focal


def _table(
    lens: Prescription,
    shape: _Shapes,
    values: Mapping[str, Array],
    tilt: tuple[Array | float, Array | float],
    pivot: Array,
) -> Array:
    trials, count = shape.c.shape[1], len(lens.surfaces)
    table = np.tile(surface_table(lens), (trials, 1)).reshape(trials, count, COLUMNS)
    vertices = np.zeros((count, trials, 3))
    vertices[:, :, 2] = shape.vertices
    axes: list[Array | None] = [None] * count
    moved = [False] * count
    for row, surface in enumerate(lens.surfaces):
        name = f"surfaces.{row + 1}"
        vertices[row] += surface.shift
        for axis in (0, 1):
            step = values.get(f"{name}.decentre.{axis}")
            if step is not None:
                vertices[row, :, axis] += step
                moved[row] = True
        turns = [_sum(values, (f"{name}.tilt.{axis}", _wedge(lens, row, axis)), surface.tilt[axis]) for axis in (0, 1)]
        if any(isinstance(turn, np.ndarray) for turn in turns) or surface.tilt != (0.0, 0.0):
            axes[row] = _turns(turns[0], 0.0, trials) @ _turns(0.0, turns[1], trials)
    for number, members in enumerate(lens.elements, start=1):
        name = f"elements.{number}"
        turn = [values.get(f"{name}.tilt.{axis}", 0.0) for axis in (0, 1)]
        if any(isinstance(part, np.ndarray) for part in turn):
            middle = (vertices[members[0]] + vertices[members[-1]]) / 2
            _carry(vertices, axes, members, middle, _turns(turn[0], turn[1], trials))
        for axis in (0, 1):
            step = values.get(f"{name}.decentre.{axis}")
            if step is not None:
                for row in members:
                    vertices[row, :, axis] += step
    if np.any(np.asarray(tilt[0])) or np.any(np.asarray(tilt[1])):
        middle = np.zeros((trials, 3))
        middle[:, 2] = pivot
        _carry(vertices, axes, tuple(range(count)), middle, _turns(*tilt, trials))
    for row in range(count):
        cells = table[:, row]
        cells[:, 0:3] = vertices[row]
        cells[:, 3], cells[:, 4], cells[:, 5] = shape.c[row], 1 + shape.k[row], np.square(shape.semi[row])
        kind = cells[0, 6]
        if kind in (SPHERE, CONIC):
            cells[:, 6] = np.where((shape.k[row] == 0) | (shape.c[row] == 0), SPHERE, CONIC)
        cells[:, 25] *= SAG_ROOM
        found = axes[row]
        if found is not None:
            cells[:, 7] = 1.0
            cells[:, 8:17] = found.reshape(trials, 9)
    return table.reshape(trials, count * COLUMNS)


def _wedge(lens: Prescription, row: int, axis: int) -> str:
    """Name of the wedge that turns a surface; empty for one that no element ends with."""
    for number, members in enumerate(lens.elements, start=1):
        if len(members) > 1 and members[-1] == row:
            return f"elements.{number}.wedge.{axis}"
    return ""


def _sum(values: Mapping[str, Array], names: tuple[str, ...], start: float) -> Array | float:
    total: Array | float = start
    for name in names:
        if name in values:
            total = total + values[name]
    return total


def _turns(alpha: Array | float, beta: Array | float, trials: int) -> Array:
    """Matrices that turn by alpha about x, then by beta about y, (T, 3, 3)."""
    (ca, sa), (cb, sb) = ((np.cos(angle), np.sin(angle)) for angle in (alpha, beta))
    turn = np.zeros((trials, 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 0, 2] = cb, sa * sb, ca * sb
    turn[:, 1, 1], turn[:, 1, 2] = ca, -sa
    turn[:, 2, 0], turn[:, 2, 1], turn[:, 2, 2] = -sb, sa * cb, ca * cb
    return turn


def _carry(vertices: Array, axes: list[Array | None], members: tuple[int, ...], pivot: Array, turn: Array) -> None:
    for row in members:
        off = (vertices[row] - pivot)[:, :, None]
        vertices[row] = pivot + (turn @ off)[:, :, 0]
        old = axes[row]
        axes[row] = turn.copy() if old is None else turn @ old
