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
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem
from .glass import AIR, Glass
from .prescription import FirstOrder, LensError, Prescription, grow_cells, lens_growth, rotation, sag, surface_table
from .tracer import COLUMNS, CONIC, FORM, IRREGULAR, MODES, SPHERE, SurfaceStack

Array = NDArray[np.float64]

D_LINE, F_LINE, C_LINE = 587.5618e-6, 486.1327e-6, 656.2725e-6
"""Wavelengths that an Abbe number is told by [mm]."""
HEIGHTS = np.linspace(0.0, 1.0, 9)
"""Parts of the clear aperture at which the glass of a build must not run out."""
SAG_ROOM = 1.25
"""Multiple of the nominal sag within which an asphere's crossing is looked for."""


@lru_cache(maxsize=64)
def lens_places(lens: Prescription) -> Mapping[str, str]:
    """Everything that the making of a lens can miss, with what it measures.

    Returns
    -------
    mapping
        Place to "length", "curvature", "angle", "number" (an index, an Abbe number, a conic constant) or "form" (rms
        sag of a Zernike mode, as `Surface.irregularity` has them). An element's wedge is the tilt of its last surface
        about that surface's vertex; its own tilt is about the middle of its axis.
    """
    places: dict[str, str] = {}

    def pairs(name: str, *misses: str) -> None:
        for miss in misses:
            places.update({f"{name}.{miss}.{axis}": "length" if miss == "decentre" else "angle" for axis in (0, 1)})

    for number, surface in enumerate(lens.surfaces, start=1):
        name = f"surfaces.{number}"
        if surface.curvature:
            places |= {f"{name}.radius": "length", f"{name}.conic": "number"}
        places[f"{name}.curvature"] = "curvature"
        if number < len(lens.surfaces):
            places[f"{name}.thickness"] = "length"
        if surface.glass != AIR:
            places[f"{name}.index"] = "number"
            if abbe_number(surface.glass) is not None:
                places[f"{name}.abbe"] = "number"
        pairs(name, "decentre", "tilt")
        places |= {f"{name}.irregularity.{mode}": "form" for mode in range(MODES)}
    for number, members in enumerate(lens.elements, start=1):
        pairs(f"elements.{number}", "decentre", "tilt", *(("wedge",) if len(members) > 1 else ()))
    return places


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
    numbers = {}
    for place in lens_places(lens):
        part, number, what = place.split(".")[:3]
        surface = lens.surfaces[int(number) - 1]
        if part == "elements" or what in ("decentre", "tilt"):
            numbers[place] = 0.0
        elif what == "irregularity":
            numbers[place] = float(surface.irregularity[int(place[-1])]) if surface.irregularity else 0.0
        elif what == "index":
            numbers[place] = float(surface.glass.index(wavelength))
        else:
            numbers[place] = abbe_number(surface.glass) or 0.0 if what == "abbe" else float(getattr(surface, what))
    return numbers


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
    table, gaps, right = _shaped(lens, made, 1)
    if not right[0]:
        raise LensError((Problem("surfaces", "a radius missed by so much turns its surface inside out"),), lens.name)
    _pose(table, lens, made)
    offsets, changed = _offsets(lens, wavelength, made, 1), []
    for row, old in enumerate(lens.surfaces):
        conic = float(values.get(f"surfaces.{row + 1}.conic", old.conic))
        glass = old.glass.with_offset(float(offsets[row, 0])) if offsets[row, 0] else old.glass
        bend, gap = float(table[0, row, 3]), float(gaps[row, 0])
        form = tuple(float(a) for a in table[0, row, FORM : FORM + MODES])
        changed.append(
            replace(
                old, curvature=bend, conic=conic, thickness=gap, glass=glass, irregularity=form if any(form) else ()
            )
        )
    return _standing(replace(lens, surfaces=tuple(changed)), table)


def turned(lens: Prescription, alpha: float, beta: float, pivot: float) -> Prescription:
    """The whole lens turned by alpha about x, then beta about y [rad], about the axis point at `pivot` along z [mm]."""
    table = surface_table(lens).reshape(1, -1, COLUMNS).copy()
    _turn(table, range(len(lens.surfaces)), np.array([[0.0, 0.0, pivot]]), rotation(alpha, beta)[None])
    return _standing(lens, table)


def _standing(lens: Prescription, table: Array) -> Prescription:
    """A lens whose surfaces stand as in the first build of a table."""
    posed = []
    for surface, vertex, cells in zip(lens.surfaces, lens.vertices, table[0], strict=True):
        x, y, z = (float(value) for value in cells[10:17:3])  # its axis
        tilt = (math.atan2(-y, z), math.atan2(x, math.hypot(y, z))) if cells[7] else surface.tilt
        shift = float(cells[0]), float(cells[1]), float(cells[2]) - vertex
        posed.append(replace(surface, shift=shift, tilt=tilt))
    return replace(lens, surfaces=tuple(posed))


class LensBuilds(NamedTuple):
    """Builds of one lens; T of them, S surfaces."""

    table: Array
    """Rows for the kernels, (T, S * COLUMNS)."""
    media: Array
    """Indices before, between and after the surfaces, (T, S + 1)."""
    sound: NDArray[np.bool_]
    """True where a build is a lens at all, (T,); the others hold the nominal lens."""
    power: Array
    """1/f of the centred lens [1/mm], (T,)."""
    front_principal: Array
    rear_principal: Array
    """Place along z from the nominal first vertex [mm], (T,)."""
    front: Array
    rear: Array
    """Foremost and hindmost point of the lens on the axis or at its rims [mm], (T,)."""

    @property
    def stack(self) -> SurfaceStack:
        """Stack of surfaces that rays are traced through."""
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
    warmth: tuple[Array, float] | None = None,
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
    warmth : pair, optional
        Temperature of each build [degrees C], (T,), and the expansion of what spaces the lens [1/K]; the places'
        numbers are those at the lens's own temperature.
    """
    table, gaps, right = _shaped(lens, values, trials, diameter, warmth)
    sound = right & _sound(lens, table, gaps, values)
    if not sound.all():  # a build that is no lens is traced as the nominal one, and told apart
        drawn = lens_values(lens, wavelength)
        values = {place: np.where(sound, value, drawn[place]) for place, value in values.items()}
        wide = None if diameter is None else np.where(sound, diameter, lens.clear_diameter)
        table, gaps, _ = _shaped(lens, values, trials, wide, warmth)
    media = np.ones((len(lens.surfaces) + 1, trials))
    temperature = None if warmth is None else warmth[0]
    for row, surface in enumerate(lens.surfaces):
        media[row + 1] = surface.glass.index(wavelength if light is None else light, temperature)
    media[1:] += _offsets(lens, wavelength, values, trials)
    bends = [table[:, row, 3] + s.vertex_curvature - s.curvature for row, s in enumerate(lens.surfaces)]
    length = np.sum(gaps[:-1], axis=0)
    order = FirstOrder.of(bends, list(gaps), list(media), length)
    front, rear = order.front_principal, order.rear_principal
    first, last = (_sag(lens, table, row, table[:, row, 5]) for row in (0, len(lens.surfaces) - 1))
    _pose(table, lens, values)
    if np.any(np.asarray(tilt[0])) or np.any(np.asarray(tilt[1])):
        middle = np.zeros((trials, 3))
        middle[:, 2] = (front + rear) / 2
        _turn(table, range(len(lens.surfaces)), middle, rotation(*tilt))
    ends = np.minimum(0.0, first), length + np.maximum(0.0, last)
    return LensBuilds(table.reshape(trials, -1), media.T.copy(), sound, order.power, front, rear, *ends)


def _shaped(
    lens: Prescription,
    values: Mapping[str, Array],
    trials: int,
    diameter: Array | None = None,
    warmth: tuple[Array, float] | None = None,
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Shapes and vertices of builds: kernels' rows (T, S, COLUMNS), gaps (S, T), whose radii keep their signs (T,)."""
    table = np.tile(surface_table(lens), (trials, 1)).reshape(trials, -1, COLUMNS)
    gaps, right = np.empty((len(lens.surfaces), trials)), np.ones(trials, bool)
    if diameter is not None:
        right &= diameter > 0
    vertex = np.zeros(trials)
    growths = None if warmth is None else lens_growth(lens, *warmth)
    for row, surface in enumerate(lens.surfaces):
        name, cells = f"surfaces.{row + 1}", table[:, row]
        if f"{name}.radius" in values:
            radius = values[f"{name}.radius"]
            same = radius * surface.radius > 0
            right &= same
            cells[:, 3] = 1 / np.where(same, radius, surface.radius)
        cells[:, 3] += values.get(f"{name}.curvature", surface.curvature) - surface.curvature
        cells[:, 4] = 1 + values.get(f"{name}.conic", surface.conic)
        if diameter is not None and 2 * surface.semi_diameter <= lens.clear_diameter * (1 + 1e-9):
            cells[:, 5], cells[:, FORM + MODES] = np.square(diameter / 2), 2 / diameter
        if cells[0, 6] in (SPHERE, CONIC):
            cells[:, 6] = np.where((cells[:, 4] == 1) | (cells[:, 3] == 0), SPHERE, CONIC)
        modes = [f"{name}.irregularity.{mode}" for mode in range(MODES)]
        if any(mode in values for mode in modes):
            cells[:, 6] = IRREGULAR
            for mode, place in enumerate(modes):
                cells[:, FORM + mode] = values.get(place, cells[:, FORM + mode])
        cells[:, 25] *= SAG_ROOM
        cells[:, 2] = surface.shift[2] + vertex
        gaps[row] = values.get(f"{name}.thickness", surface.thickness)
        if growths is not None:
            grow_cells(cells, growths[row][0])
            gaps[row] *= growths[row][1]
        vertex = vertex + gaps[row]
    return table, gaps, right


def _sag(lens: Prescription, table: Array, row: int, square: Array) -> Array:
    return sag(square, table[:, row, 3], table[:, row, 4], lens.surfaces[row].asphere)


def _sound(lens: Prescription, table: Array, gaps: Array, values: Mapping[str, Array]) -> NDArray[np.bool_]:
    """No surface wider than itself, no gap used up: what `Prescription` asks of one lens."""
    c, k1, square = np.moveaxis(table[:, :, 3:6], -1, 0)
    good = np.all(np.isfinite(c) & np.isfinite(k1) & (k1 * c * c * square < 1), axis=1) & np.all(gaps >= 0, axis=0)
    if not any(place.rsplit(".", 1)[1] in ("radius", "curvature", "conic", "thickness") for place in values):
        return np.asarray(good)
    for row, (front, rear) in enumerate(pairwise(lens.surfaces)):
        if front.glass == AIR and (front.is_plane or rear.is_plane):
            continue  # a diaphragm
        at = np.square(HEIGHTS)[:, None] * np.minimum(square[:, row], square[:, row + 1])
        good &= np.all(gaps[row] + _sag(lens, table, row + 1, at) - _sag(lens, table, row, at) >= -1e-9, axis=0)
    return np.asarray(good)


def _offsets(lens: Prescription, wavelength: float, values: Mapping[str, Array], trials: int) -> Array:
    """Errors of the indices after the surfaces, as given at the design's wavelength, (S, T)."""
    offsets = np.zeros((len(lens.surfaces), trials))
    for row, surface in enumerate(lens.surfaces):
        name, glass = f"surfaces.{row + 1}", surface.glass
        if f"{name}.abbe" in values:  # n_d kept: n - n_d goes like 1/V
            spread = float(glass.index(wavelength) - glass.index(D_LINE))
            offsets[row] += spread * ((abbe_number(glass) or 0.0) / values[f"{name}.abbe"] - 1)
        if f"{name}.index" in values:
            offsets[row] += values[f"{name}.index"] - float(glass.index(wavelength))
    return offsets


def _pose(table: Array, lens: Prescription, values: Mapping[str, Array]) -> None:
    """Decentre, tilt and wedge the surfaces of builds, then their elements."""
    trials = len(table)
    wedged = {members[-1]: f"elements.{n}.wedge" for n, members in enumerate(lens.elements, 1) if len(members) > 1}

    def step(name: str, members: Iterable[int]) -> None:
        for axis in (0, 1):
            if f"{name}.decentre.{axis}" in values:
                for row in members:
                    table[:, row, axis] += values[f"{name}.decentre.{axis}"]

    for row, surface in enumerate(lens.surfaces):
        name = f"surfaces.{row + 1}"
        places = [(f"{name}.tilt.{k}", f"{wedged.get(row)}.{k}") for k in (0, 1)]
        if any(place in values for pair in places for place in pair):
            alpha, beta = (
                np.broadcast_to(sum((values[place] for place in pair if place in values), drawn), trials)
                for pair, drawn in zip(places, surface.tilt, strict=True)
            )
            table[:, row, 7] = 1.0
            table[:, row, 8:17] = (rotation(alpha, 0.0) @ rotation(0.0, beta)).reshape(-1, 9)
        step(name, (row,))
    for number, members in enumerate(lens.elements, start=1):
        name = f"elements.{number}"
        if f"{name}.tilt.0" in values or f"{name}.tilt.1" in values:
            tilts = [np.broadcast_to(values.get(f"{name}.tilt.{k}", 0.0), trials) for k in (0, 1)]
            _turn(table, members, (table[:, members[0], :3] + table[:, members[-1], :3]) / 2, rotation(*tilts))
        step(name, members)


def _turn(table: Array, members: Iterable[int], pivot: Array, turns: Array) -> None:
    """Turn surfaces as one, about points (T, 3) by matrices (T or 1, 3, 3)."""
    for row in members:
        cells = table[:, row]
        cells[:, :3] = pivot + (turns @ (cells[:, :3] - pivot)[:, :, None])[:, :, 0]
        cells[:, 7] = 1.0
        cells[:, 8:17] = (turns @ cells[:, 8:17].reshape(-1, 3, 3)).reshape(-1, 9)
