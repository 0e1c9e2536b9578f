"""A lens as its maker prints it: surfaces in order, curvatures, thicknesses, glasses, clear diameters; its first order.

Surfaces run from the scene to the microlens array, the first vertex at z = 0, +z from scene to sensor, air before and
after. A surface holds its curvature rather than its radius, so that a plane is 0 and nothing is infinite.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, Problem
from ..units import FARTHEST, SHORTEST
from .glass import AIR, ROOM, Glass, growth
from .tracer import (
    ASPHERE,
    COLUMNS,
    CONIC,
    FORM,
    IRREGULAR,
    MODES,
    SPHERE,
    THIN,
    Pair,
    Passed,
    SurfaceStack,
)

Array = NDArray[np.float64]

ASPHERE_TERMS = 8
"""Even powers r^2 to r^16, as many as a .zmx even asphere has."""


class LensError(InputError):
    """A lens (or its file) that cannot be used."""


@dataclass(frozen=True)
class Surface:
    """One refracting surface, or a diaphragm where the glass on both sides is the same.

    The sag along the surface's own axis is ``c r^2 / (1 + sqrt(1 - (1 + k) c^2 r^2)) + sum a_i r^(2 i)``.

    Attributes
    ----------
    curvature : float
        c [1/mm], positive when the centre lies on the image side.
    semi_diameter : float
        Clear semi-diameter [mm]: what lies outside is clipped.
    thickness : float
        To the next vertex along the axis [mm]; 0 on the last surface.
    glass : Glass
        After the surface.
    conic : float
        k: 0 sphere, -1 paraboloid.
    asphere : tuple of float
        (a_1, a_2, ...), of r^2, r^4, ... [mm^(1 - 2i)].
    shift : tuple of float
        Displacement of the vertex from its nominal place [mm].
    tilt : tuple of float
        Rotations (alpha, beta) about x and y [rad]; the surface's axis points along
        ``(sin beta, -sin alpha cos beta, cos alpha cos beta)``.
    irregularity : tuple of float
        Rms sags of its Zernike modes 5 to 11 in Noll's order over the clear aperture, added to the sag [mm]:
        astigmatism (at 45 and 0 degrees), coma (y, x), trefoil (y, x), spherical aberration. None has none.
    """

    curvature: float
    semi_diameter: float
    thickness: float = 0.0
    glass: Glass = AIR
    conic: float = 0.0
    asphere: tuple[float, ...] = ()
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    irregularity: tuple[float, ...] = ()

    @property
    def radius(self) -> float:
        """Radius of curvature [mm]; infinite for a plane."""
        return 1 / self.curvature if self.curvature else math.inf

    @property
    def vertex_curvature(self) -> float:
        """Curvature at the vertex, with the r^2 term [1/mm]."""
        return self.curvature + (2 * self.asphere[0] if self.asphere else 0.0)

    @property
    def is_plane(self) -> bool:
        """Flat over its whole aperture."""
        return self.curvature == 0 and not any(self.asphere)

    def sag(self, radius: ArrayLike) -> Array:
        """Height of the surface over its vertex plane at distance `radius` from its axis [mm]; nan beyond its rim."""
        return sag(np.square(np.asarray(radius, float)), self.curvature, 1 + self.conic, self.asphere)

    def reversed(self, glass: Glass, thickness: float) -> Surface:
        """The surface mirrored in z, as light from the other side meets it, before `glass` and `thickness`."""
        (x, y, z), (alpha, beta) = self.shift, self.tilt
        return replace(
            self,
            curvature=0.0 - self.curvature,
            asphere=tuple(0.0 - a for a in self.asphere),
            shift=(x, y, 0.0 - z),
            tilt=(0.0 - alpha, 0.0 - beta),
            irregularity=tuple(0.0 - a for a in self.irregularity),
            glass=glass,
            thickness=thickness,
        )


@dataclass(frozen=True)
class Prescription:
    """A lens: its surfaces from scene to sensor, in air.

    Attributes
    ----------
    surfaces : tuple of Surface
        At least one.
    name, source : str
        What it is called and where the numbers come from.
    wavelength : float or None
        Its design wavelength [mm].
    temperature : float
        At which its lengths hold [degrees C].
    clear_aperture : float or None
        What its maker guarantees to be clear of mechanical diameters [mm]; None: what its surfaces have.

    Raises
    ------
    LensError
        Every fault at once: no glass left at the rim, a surface wider than its own sphere, and the like.
    """

    surfaces: tuple[Surface, ...]
    name: str = ""
    source: str = ""
    wavelength: float | None = None
    temperature: float = ROOM
    clear_aperture: float | None = None

    def __post_init__(self) -> None:
        problems = tuple(faults(self.surfaces))
        if self.wavelength is not None and not 0 < self.wavelength < math.inf:
            problems += (Problem("wavelength", f"{self.wavelength!r} mm must be a positive length"),)
        if problems:
            raise LensError(problems, self.name)

    @property
    def vertices(self) -> tuple[float, ...]:
        """Place of each nominal vertex along z [mm], the first 0."""
        return tuple(accumulate((surface.thickness for surface in self.surfaces[:-1]), initial=0.0))

    @property
    def length(self) -> float:
        """First to last vertex [mm]."""
        return self.vertices[-1]

    @property
    def elements(self) -> tuple[tuple[int, ...], ...]:
        """Pieces that move as one: runs of surfaces joined by glass (a cemented doublet is one piece of three)."""
        ends = [index + 1 for index, surface in enumerate(self.surfaces) if surface.glass == AIR]
        return tuple(tuple(range(start, end)) for start, end in pairwise([0, *ends]))

    @property
    def clear_diameter(self) -> float:
        """Smallest clear diameter of its surfaces [mm]: D of its thin-lens model."""
        return 2 * min(surface.semi_diameter for surface in self.surfaces)

    @property
    def is_centred(self) -> bool:
        """Every surface's axis is the z axis, so that the lens is symmetric about it."""
        return all(
            s.tilt == (0.0, 0.0) and s.shift[:2] == (0.0, 0.0) and not any(s.irregularity) for s in self.surfaces
        )

    def warmed(self, temperature: float, barrel: float = 0.0) -> Prescription:
        """Lens at another temperature [degrees C]; `barrel` is the expansion of what spaces it [1/K]."""
        if temperature == self.temperature and all(s.glass == s.glass.at(temperature) for s in self.surfaces):
            return self
        surfaces = []
        for surface, growths in zip(self.surfaces, lens_growth(self, temperature, barrel), strict=True):
            shape, gap = (float(factor) for factor in growths)
            changed = {
                "curvature": surface.curvature / shape,
                "semi_diameter": surface.semi_diameter * shape,
                "thickness": surface.thickness * gap,
                "glass": surface.glass.at(temperature),
                "asphere": tuple(a * shape ** (1 - 2 * i) for i, a in enumerate(surface.asphere, start=1)),
            }
            surfaces.append(replace(surface, **changed))  # type: ignore[arg-type]
        return replace(self, surfaces=tuple(surfaces), temperature=temperature)

    def at(self, wavelength: ArrayLike) -> SurfaceStack:
        """The lens in numbers at one wavelength, or as one build for each of several (T,) [mm].

        Raises
        ------
        InputError
            A wavelength outside a glass's range.
        """
        waves = np.atleast_1d(np.asarray(wavelength, float))
        media = np.stack([np.ones(len(waves)), *(surface.glass.index(waves) for surface in self.surfaces)], axis=-1)
        return SurfaceStack(np.broadcast_to(surface_table(self), (len(waves), len(self.surfaces) * COLUMNS)), media)

    def through(self, height: Pair, slope: Pair, wavelength: float, **options: Any) -> Passed:
        """Heights and slopes before the lens to those behind it; options as of `SurfaceStack.through`."""
        return self.at(wavelength).through(height, slope, **options)

    def reversed(self) -> Prescription:
        """The lens mounted the other way round; its new first vertex is at z = 0."""
        before = [AIR, *(surface.glass for surface in self.surfaces[:-1])]
        gaps = [0.0, *(surface.thickness for surface in self.surfaces[:-1])]
        turned = tuple(
            surface.reversed(glass, gap) for surface, glass, gap in zip(self.surfaces, before, gaps, strict=True)
        )
        name = self.name.removesuffix(" reversed") if self.name.endswith(" reversed") else f"{self.name} reversed"
        return replace(self, surfaces=turned[::-1], name=name.strip())

    def first_order(self, wavelength: float) -> FirstOrder:
        """Gaussian constants; parameters and errors as of the function of this name."""
        return _constants(self, float(wavelength))


@dataclass(frozen=True)
class IdealLens(Prescription):
    """A lens without thickness that bends rays as first order has it; its one surface is the opening in it.

    Attributes
    ----------
    power : float
        1/f [1/mm].
    """

    power: float = 0.0

    @classmethod
    def of(cls, focal_length: float, diameter: float) -> IdealLens:
        """Ideal lens of a focal length and a clear diameter [mm]."""
        return cls((Surface(0.0, diameter / 2),), "ideal lens", power=1 / focal_length)

    def first_order(self, wavelength: float) -> FirstOrder:
        """Gaussian constants of its power."""
        return FirstOrder(self.power, np.array([[1.0, 0.0], [-self.power, 1.0]]), 0.0)

    def at(self, wavelength: ArrayLike) -> SurfaceStack:
        """The lens in numbers, the same at all wavelengths (T,) [mm]."""
        builds = np.size(wavelength)
        row = np.array(surface_table(self))
        row[3], row[6] = self.power, THIN
        return SurfaceStack(np.broadcast_to(row, (builds, COLUMNS)), np.ones((builds, 2)))


def sag(square: Array, curvature: ArrayLike, k1: ArrayLike, asphere: Sequence[float]) -> Array:
    """Height over its vertex plane of a surface, or of builds of it, at squared distances from its axis; k1 = 1 + k."""
    c, k1 = np.asarray(curvature, float), np.asarray(k1, float)
    with np.errstate(invalid="ignore"):
        total = c * square / (1 + np.sqrt(1 - k1 * c * c * square))
    for power, a in enumerate(asphere, start=1):
        total = total + a * square**power
    return np.asarray(total)


def faults(surfaces: tuple[Surface, ...]) -> list[Problem]:
    """Everything that makes a stack of surfaces impossible as a lens in air, with the place `surfaces.N` (from 1)."""
    if not surfaces:
        return [Problem("surfaces", "a lens needs at least one surface; add [[surfaces]]")]
    problems = [
        Problem(f"surfaces.{number}.{key}", message)
        for number, surface in enumerate(surfaces, start=1)
        for key, message in _surface_faults(surface)
    ]
    if surfaces[-1].glass != AIR:
        message = f"the last surface ends in {surfaces[-1].glass.name}; the lens must end in air: add its rear surface"
        problems.append(Problem(f"surfaces.{len(surfaces)}.glass", message))
    if surfaces[-1].thickness != 0:
        message = "nothing follows the last surface; leave its thickness out (the design places the microlens array)"
        problems.append(Problem(f"surfaces.{len(surfaces)}.thickness", message))
    if not problems:
        for number, (front, rear) in enumerate(pairwise(surfaces), start=1):
            problems += _gap_faults(number, front, rear)
    return problems


def _surface_faults(surface: Surface) -> Iterator[tuple[str, str]]:
    numbers = {
        "radius": (surface.curvature,),
        "conic": (surface.conic,),
        "thickness": (surface.thickness,),
        "asphere": surface.asphere,
        "shift": surface.shift,
        "tilt": surface.tilt,
        "irregularity": surface.irregularity,
    }
    yield from ((key, "is not a finite number") for key, row in numbers.items() if not all(map(math.isfinite, row)))
    semi = surface.semi_diameter
    if not 0 < semi < math.inf:
        yield "diameter", f"{2 * semi:g} mm must be a positive, finite clear diameter"
        return
    if 2 * semi < SHORTEST:
        yield "diameter", f"{2 * semi:g} mm is too small for any lens"
        return
    if surface.thickness < 0:
        yield "thickness", f"{surface.thickness:g} mm must not be negative; order surfaces along the light"
    if len(surface.irregularity) not in (0, MODES):
        yield "irregularity", f"has {len(surface.irregularity)} terms; give the rms sags of all {MODES} modes"
    if len(surface.asphere) > ASPHERE_TERMS:
        yield "asphere", f"has {len(surface.asphere)} terms; at most {ASPHERE_TERMS} (r^2 to r^16)"
    steepness = abs(surface.curvature * semi)
    if (1 + surface.conic) * steepness * steepness >= 1:
        widest = 2 * semi / math.sqrt(1 + surface.conic) / steepness
        yield (
            "diameter",
            f"{2 * semi:g} mm is not less than the {widest:g} mm at which the surface turns back; reduce it",
        )
        return
    with np.errstate(all="ignore"):
        farthest = np.max(np.abs(surface.sag(np.linspace(0, semi, 65))))
    if not farthest <= FARTHEST["length"]:
        yield "diameter", f"{2 * semi:g} mm: the surface has no height at its rim; check radius, conic and asphere"


def _gap_faults(number: int, front: Surface, rear: Surface) -> list[Problem]:
    semi = min(front.semi_diameter, rear.semi_diameter)
    heights = np.linspace(0, semi, 65)
    gap = front.thickness + rear.sag(heights) - front.sag(heights)
    worst = int(np.argmin(gap))
    # A diaphragm drawn inside the sag of its neighbour is only a place to clip; glass and air between lenses are real.
    virtual = front.glass == AIR and (front.is_plane or rear.is_plane)
    if virtual or gap[worst] >= -1e-9:
        return []
    what = front.glass.name if front.glass != AIR else "air gap"
    message = f"the {what} is {gap[worst]:.3g} mm thick at height {heights[worst]:.3g} mm: the surfaces cross"
    return [Problem(f"surfaces.{number}.thickness", f"{message}; increase the thickness or reduce the diameters")]


@lru_cache(maxsize=128)
def surface_table(lens: Prescription) -> Array:
    """A lens's surfaces as the kernels want them: `COLUMNS` numbers each, flat."""
    table = np.zeros((len(lens.surfaces), COLUMNS))
    for row, surface, z in zip(table, lens.surfaces, lens.vertices, strict=True):
        row[0:3] = np.add(surface.shift, (0.0, 0.0, z))
        row[3:6] = surface.curvature, 1 + surface.conic, surface.semi_diameter**2
        row[6] = SPHERE if surface.conic == 0 or surface.curvature == 0 else CONIC
        row[6] = ASPHERE if any(surface.asphere) else row[6]
        row[7] = surface.tilt != (0.0, 0.0)
        row[8:17] = (rotation(surface.tilt[0], 0.0) @ rotation(0.0, surface.tilt[1])).reshape(-1)
        row[17 : 17 + len(surface.asphere)] = surface.asphere
        row[FORM + MODES] = 1 / surface.semi_diameter
        if any(surface.irregularity):
            row[6], row[FORM : FORM + MODES] = IRREGULAR, surface.irregularity
        heights = np.linspace(0, surface.semi_diameter, 257)
        row[25] = 1.1 * np.max(np.abs(surface.sag(heights))) + 1e-6 * surface.semi_diameter
    table.setflags(write=False)
    return table.reshape(-1)


def rotation(alpha: ArrayLike, beta: ArrayLike) -> Array:
    """Matrices that turn by alpha about x, then by beta about y [rad], (..., 3, 3)."""
    if np.ndim(alpha) == np.ndim(beta) == 0 and alpha == beta == 0:
        return np.eye(3)
    a, b = np.broadcast_arrays(np.asarray(alpha, float), np.asarray(beta, float))
    (ca, sa), (cb, sb) = (np.cos(a), np.sin(a)), (np.cos(b), np.sin(b))
    rows = [[cb, sa * sb, ca * sb], [0 * a, ca, -sa], [-sb, sa * cb, ca * cb]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


class FirstOrder(NamedTuple):
    """Gaussian constants in air on both sides, of one lens or of many builds (T,); misaligned ones count as centred.

    Their first-order effect is a shift of the image, not of its focus. Distances along z are in the lens's frame.
    """

    power: Any
    """1/f [1/mm]; 0 for an afocal lens."""
    matrix: Array
    """ABCD from the first vertex plane to the last: (height, slope) after = matrix @ (height, slope) before, (2, 2)
    or (2, 2, T)."""
    length: Any
    """First to last vertex [mm]."""

    @classmethod
    def of(cls, curvatures: Sequence[Any], gaps: Sequence[Any], media: Sequence[Any], length: Any) -> FirstOrder:
        """Constants of surfaces; arguments as of `abcd`."""
        matrix = np.array(np.broadcast_arrays(*abcd(curvatures, gaps, media)))
        return cls(_plain(-matrix[2]), matrix.reshape(2, 2, *matrix.shape[1:]), length)

    @property
    def focal_length(self) -> Any:
        """Effective focal length f [mm], infinite for an afocal lens."""
        with np.errstate(divide="ignore"):
            return _plain(np.divide(1, self.power + 0.0))

    @property
    def back_focal_length(self) -> Any:
        """Last vertex to the image-side focus [mm]."""
        return _plain(self.matrix[0, 0]) * self.focal_length

    @property
    def front_principal(self) -> Any:
        """Place of the object-side principal plane along z [mm]."""
        return (1 - _plain(self.matrix[1, 1])) * self.focal_length

    @property
    def rear_principal(self) -> Any:
        """Place of the image-side principal plane along z [mm]."""
        return self.length + (_plain(self.matrix[0, 0]) - 1) * self.focal_length

    def image_of(self, z: float) -> tuple[float, float]:
        """Place along z of the image of an axial point of the scene's side, and the transverse magnification.

        `z` [mm] may be -inf; for a point at the front focus both are infinite.
        """
        (a, b), (c, d) = self.matrix
        if math.isinf(z):
            return self.length + self.back_focal_length, 0.0
        slope = c * -z + d  # of the ray that leaves the axis at z with unit slope
        if slope == 0:
            return math.inf, math.inf
        return self.length - float((a * -z + b) / slope), float(1 / slope)


@lru_cache(maxsize=128)
def _constants(lens: Prescription, wavelength: float) -> FirstOrder:
    """Gaussian constants, asked for in every camera behind the same lens."""
    media = [1.0, *(float(surface.glass.index(wavelength)) for surface in lens.surfaces)]
    curvatures, gaps = ([getattr(s, name) for s in lens.surfaces] for name in ("vertex_curvature", "thickness"))
    constants = FirstOrder.of(curvatures, gaps, media, lens.length)
    constants.matrix.setflags(write=False)
    return constants


def _plain(value: Any) -> Any:
    """A number of one lens as Python's own."""
    return value if np.ndim(value) or np.iscomplexobj(value) else float(value)


def first_order(lens: Prescription, wavelength: float) -> FirstOrder:
    """Gaussian constants of a lens: its vertex curvatures (with r^2 terms), thicknesses and indices count.

    Raises
    ------
    InputError
        The wavelength [mm, in air] is outside a glass's range.
    """
    return lens.first_order(wavelength)


def lens_growth(lens: Prescription, temperature: Any, barrel: float) -> list[tuple[Array, Array]]:
    """Growth of each surface's shape and of the gap behind it on the way to temperatures [degrees C].

    A cemented surface grows as the mean of its glasses; air, and a diaphragm in it, as what spaces the lens [1/K].
    """
    glasses = [AIR, *(surface.glass for surface in lens.surfaces)]
    held = [barrel if glass == AIR else glass.warming.expansion for glass in glasses]
    grown = []
    for (before, after), rates in zip(pairwise(glasses), pairwise(held), strict=True):
        solid = [rate for glass, rate in zip((before, after), rates, strict=True) if glass != AIR] or [barrel]
        pair = sum(solid) / len(solid), rates[1]
        grown.append((growth(pair[0], lens.temperature, temperature), growth(pair[1], lens.temperature, temperature)))
    return grown


def grow_cells(cells: Array, shape: Any) -> None:
    """Grow the shape of a surface of builds in place: its kernels' rows (..., COLUMNS)."""
    cells[..., 3] /= shape
    cells[..., 5] *= shape * shape
    for term in range(1, ASPHERE_TERMS + 1):
        cells[..., 16 + term] *= shape ** (1.0 - 2 * term)
    cells[..., 25] *= shape
    cells[..., FORM + MODES] /= shape


def warm_constants(lens: Prescription, wavelength: Any, temperature: Any, barrel: float) -> FirstOrder:
    """Gaussian constants of a lens at temperatures [degrees C] that broadcast with wavelengths [mm].

    `barrel` is the expansion of what spaces it [1/K].
    """
    grown = lens_growth(lens, temperature, barrel)
    media = [1.0, *(surface.glass.index(wavelength, temperature) for surface in lens.surfaces)]
    bends = [surface.vertex_curvature / shape for surface, (shape, _) in zip(lens.surfaces, grown, strict=True)]
    gaps = [surface.thickness * gap for surface, (_, gap) in zip(lens.surfaces, grown, strict=True)]
    return FirstOrder.of(bends, gaps, media, sum(gaps[:-1], start=0.0 * gaps[0]))


def abcd(curvatures: Sequence[Any], gaps: Sequence[Any], media: Sequence[Any]) -> tuple[Any, Any, Any, Any]:
    """ABCD of surfaces, each followed by its gap, in media before, between and after them; numbers or arrays (T,)."""
    a, b, c, d = 1.0 + 0 * media[0], 0.0 * media[0], 0.0 * media[0], 1.0 + 0 * media[0]
    for curvature, gap, before, after in zip(curvatures, gaps, media[:-1], media[1:], strict=True):
        bend = -(after - before) / after * curvature
        c, d = bend * a + before / after * c, bend * b + before / after * d
        a, b = a + gap * c, b + gap * d
    return a, b, c, d
