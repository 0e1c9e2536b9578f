"""Real objectives and relays by their prescription."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np
from pydantic import StrictBool

from ..lenses.glass import Glass
from ..lenses.prescription import Prescription, first_order, grow_cells, lens_growth, surface_table, warm_constants
from ..lenses.tracer import COLUMNS
from .element import Element, Flags, Matrix, Outline, face
from .export import SequenceRow, lens_surfaces
from .faces import LIMIT, OPEN, TURNED, Face, Surroundings, axes_of, is_turned, plane_row, vertex_of
from .part import Number, PartNumbers
from .real_lens import RealLens, mounted_lens


class LensGroup(Element):
    """A real objective or relay by its prescription; its first order counts."""

    kind: Literal["prescription"]
    prescription: RealLens
    """A lens that ships, a lens file, or the lens as a table."""
    reversed: StrictBool = False
    """Whether it stands the other way round than its prescription says."""

    round_when_seen: ClassVar = False
    trade_name: ClassVar = "lens group"

    @property
    def lens(self) -> Prescription:
        """Lens as it stands in the camera."""
        return mounted_lens(self.prescription, self.reversed, self.diameter)

    @property
    def length(self) -> float:
        """Length from vertex to vertex [mm]."""
        return self.lens.length

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Every material of it; they stand in its prescription."""
        return tuple(("prescription", surface.glass) for surface in self.prescription.surfaces)

    @property
    def prescribed(self) -> tuple[Prescription, ...]:
        """Its own."""
        return (self.prescription,)

    @property
    def half_height(self) -> float:
        """Half of its height [mm]."""
        if self.diameter is None:
            return max(surface.semi_diameter for surface in self.lens.surfaces)
        return self.diameter / 2

    @property
    def bought(self) -> str:
        """Name of the lens."""
        return f"{self.lens.name}, as prescribed"

    def span(self, at: PartNumbers) -> Number:
        """Length along the axis in the camera [mm], at its temperature."""
        if at.temperature is None:
            return self.length
        length: Number = warm_constants(self.lens, at.wavelength, at.temperature, at.housing).length
        return length

    def forward(self, at: PartNumbers, inside: Number, passed: Flags) -> Matrix:
        """Matrix of the whole group."""
        lens, warmth = self.lens, self.lens.temperature if at.temperature is None else at.temperature
        if np.ndim(at.wavelength) or np.ndim(warmth) or warmth != lens.temperature:
            whole = warm_constants(lens, at.wavelength, warmth, at.housing).matrix
            own = tuple(whole.reshape(4, *whole.shape[2:]))
        else:
            own = _matrix(lens, float(at.wavelength))
        matrix = zip(own, (1.0, 0.0, 0.0, 1.0), strict=True)
        return tuple(np.where(passed, x, y)[()] for x, y in matrix)  # type: ignore[return-value]

    def petzval(self, at: PartNumbers) -> Number:
        """Sum over its surfaces as prescribed."""
        media: list[Number] = [1.0, *(surface.glass.index(at.wavelength) for surface in self.lens.surfaces)]
        total: Number = 0.0
        for (before, after), surface in zip(pairwise(media), self.lens.surfaces, strict=True):
            total = total + (1 / before - 1 / after) * surface.vertex_curvature
        return total

    def lengthened(self, at: PartNumbers, before: Number, after: Number) -> tuple[Number, Number]:
        """Length at one temperature [mm], and how many times as long it is at another [degrees C]."""
        cold, warm = (warm_constants(self.lens, at.wavelength, t, at.housing).length for t in (before, after))
        return cold, warm / cold

    def faces(self, at: PartNumbers, name: str, around: Surroundings) -> list[Face]:
        """All surfaces; after them, where a liquid begins, a window of no thickness that ends it."""
        lens, z, warmth = self.lens, at["distance"], at.temperature
        vertex, axes, radius = vertex_of(at, z), axes_of(at), at.get("diameter", math.inf) / 2
        media: list[Number] = [1.0, *(surface.glass.index(at.wavelength, warmth) for surface in lens.surfaces)]
        growths = lens_growth(lens, lens.temperature if warmth is None else warmth, at.housing)
        places, here = [np.zeros(())], np.zeros(())
        for surface, (_, gap) in zip(lens.surfaces, growths, strict=True):
            here = here + surface.thickness * gap
            places.append(here)
        faces: list[Face] = []
        rows = surface_table(lens).reshape(-1, COLUMNS)
        shape = np.broadcast_shapes(vertex.shape[:-1], axes.shape[:-2], np.shape(radius), np.shape(here))
        for k in reversed(range(len(rows))):
            row = np.array(np.broadcast_to(rows[k], (*shape, COLUMNS)))
            grow_cells(row, growths[k][0])
            aside = np.zeros((*np.shape(here), 3)) + rows[k, :3]
            aside[..., 2] += places[k] - lens.vertices[k] - places[-1]
            row[..., :3] = vertex + (axes @ aside if aside.ndim == 1 else (axes @ aside[..., None])[..., 0])
            turn = axes @ rows[k, 8:17].reshape(3, 3)
            row[..., 8:17] = turn.reshape(*turn.shape[:-2], 9)
            row[..., TURNED] = is_turned(turn)
            if self.diameter is not None:  # a wider one does not cut; without vignetting nothing does
                limit = np.minimum(row[..., LIMIT], np.square(radius))
                row[..., LIMIT] = np.where(np.isinf(radius), OPEN, limit)
            faces.append(Face(row, media[k], media[k + 1], f"{at.place}.{int(k == 0)}", name))
        if np.any(np.not_equal(around.medium, 1)):  # as in the closed forms
            length = np.asarray(self.span(at), float)
            end = plane_row(vertex - length[..., None] * axes[..., :, 2], axes, math.inf)
            faces.append(Face(end, around.medium, 1.0, f"{at.place}.1", name))
        return faces

    def profile(self, ends: tuple[float, float], thick: float) -> list[tuple[Outline, Outline]]:
        """Faces of each glass."""
        far, t = -self.distance - self.length, np.linspace(-1, 1, 25)
        faces = [
            face(ends, far + z + surface.sag(surface.semi_diameter * abs(t)), surface.semi_diameter)
            for z, surface in zip(self.lens.vertices, self.lens.surfaces, strict=True)
        ]
        return [(faces[i], faces[j]) for piece in self.lens.elements for i, j in pairwise(piece)]

    def rows(self, name: str, at: float, semi: float) -> list[SequenceRow]:
        """All surfaces."""
        return lens_surfaces(name, self.lens, at - self.lens.length)

    def words(self) -> tuple[str, ...]:
        """Name of the lens."""
        return (self.lens.name or "by its prescription",)


@lru_cache(maxsize=256)
def _matrix(lens: Prescription, wavelength: float) -> tuple[float, float, float, float]:
    p, q, r, s = first_order(lens, wavelength).matrix.ravel().tolist()
    return p, q, r, s
