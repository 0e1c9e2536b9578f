"""Objects that may stand in object space, and the textures on them.

Positions are (x, y) [mm] off the axis and distances Z from the main lens, or ahead of the bore's tip [mm]. A texture
gives the radiance over a surface's own coordinates (u, v) [mm]; 1 is fully lit white.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from ..bore.part import Offset, Part, Size, Tilt
from ..design.parts import MOST_CONTRAST, OCTAVES
from ..errors import InputError, Problem
from ..input_files import check_file, read_pixels
from ..toml_files import KIND
from ..units import SHORTEST, Angle, AnyLength, Length

MOST_LIGHT = 1e12
"""Radiance that nothing reaches: what is computed of it fits into single precision."""
Level = Annotated[float, Field(ge=0, le=MOST_LIGHT)]


class _Told(Part):
    """Part of a scene that is written with its kind, by default or not."""

    @model_serializer(mode="wrap")
    def _with_kind(self, values: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {KIND: getattr(self, KIND), **values(self)}


class Uniform(_Told):
    """Texture that is uniform."""

    kind: Literal["uniform"] = "uniform"
    level: Level = 1.0
    """Radiance."""


class Checkerboard(_Told):
    """Squares of two levels; a corner lies on the surface's origin."""

    kind: Literal["checkerboard"] = "checkerboard"
    period: Length
    """Two squares [mm]."""
    high: Level = 1.0
    """Radiance of the bright squares."""
    low: Level = 0.0
    """Radiance of the dark squares."""


class Sinusoid(_Told):
    """A grating, 0.5 (1 + contrast cos(2 pi t/period))."""

    kind: Literal["sinusoid"] = "sinusoid"
    period: Length
    """[mm]."""
    angle: Angle = 0.0
    """Direction in which it varies, from the surface's u axis [rad]."""
    contrast: Annotated[float, Field(ge=0, le=1)] = 1.0
    """(max - min)/(max + min)."""


class PictureTexture(_Told):
    """An image file, bilinearly interpolated, repeated beyond its edges; its middle lies on the surface's origin.

    Grey as the mean of its colour channels; the file's full scale is 1. Rows run along v, downwards in the file.
    """

    kind: Literal["image"] = "image"
    file: str
    """PNG, TIFF, JPEG and whatever else Pillow reads; relative to the scene file."""
    width: Length
    """Width of the picture on the surface [mm]; pixels are square."""

    @field_validator("file")
    @classmethod
    def _beside_the_scene(cls, file: str, info: ValidationInfo) -> str:
        folder = (info.context or {}).get("folder")
        return file if folder is None else str(folder / file)

    def load(self) -> NDArray[np.float32]:
        """Radiances, shape (rows, columns).

        Raises
        ------
        InputError
            The file is missing, or no image that can be read.
        """
        check_file(Path(self.file), self.file)
        stat = Path(self.file).stat()
        return _loaded(self.file, stat.st_mtime_ns, stat.st_size)


@functools.lru_cache(maxsize=8)  # reading a picture again for every tile would cost more than the rays
def _loaded(file: str, changed: int, size: int) -> NDArray[np.float32]:
    values, _ = read_pixels(Path(file), file)
    if values.dtype.kind not in "buif":
        raise InputError((Problem("", f"holds no grey levels but {values.dtype} numbers; save it as greys"),), file)
    if values.dtype.kind == "f" and not bool((np.abs(values) <= MOST_LIGHT).all()):
        raise InputError((Problem("", f"holds values that are not finite, or above {MOST_LIGHT:g}; mend it"),), file)
    if values.dtype == np.bool_ or values.dtype.kind not in "uf":
        values = values.astype(np.float32)
        peak = 1.0 if values.max(initial=0) <= 1 else 255.0 if values.max() <= 255 else 65535.0
    else:
        peak = float(np.iinfo(values.dtype).max) if values.dtype.kind == "u" else 1.0
    grey = values[..., :3].mean(-1) if values.ndim == 3 else values
    array = np.ascontiguousarray(grey / peak, np.float32)
    if array.ndim != 2 or array.size == 0:
        raise InputError((Problem("", "holds no two-dimensional image; give a PNG or TIFF file"),), file)
    if not (np.isfinite(array).all() and array.min() >= 0):
        raise InputError((Problem("", "holds values that are negative or not finite; mend the picture"),), file)
    array.setflags(write=False)
    return array


class Noise(_Told):
    """Random texture with the same contrast in each octave of detail, as natural scenes have it; repeats itself.

    Six octaves, from `finest` to 64 times that.
    """

    kind: Literal["noise"] = "noise"
    finest: Annotated[Length, Field(examples=["0.5 mm"])]
    """Period of its finest detail [mm]."""
    contrast: Annotated[float, Field(ge=0, le=MOST_CONTRAST)] = 0.1
    """Rms contrast in each octave; from some 0.2 on parts are black with sharp edges, as no radiance is below zero."""
    mean: Level = 0.5
    """Radiance."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Another seed, another texture."""

    @property
    def width(self) -> float:
        """After which it repeats itself [mm]."""
        return self.finest * _TILE / _PER_PERIOD

    @property
    def black(self) -> float:
        """Share that is black, as no radiance is below zero."""
        return 0.5 * math.erfc(1 / max(self.contrast * math.sqrt(2 * OCTAVES), 1e-9))

    def load(self) -> NDArray[np.float32]:
        """Radiances of one tile, shape (rows, columns)."""
        return _noise(self.contrast, self.mean, self.seed)


_TILE, _PER_PERIOD = 2048, 8
"""Samples across a tile of noise, and across a period of its finest detail: interpolated, that keeps 95 % of it."""


@functools.lru_cache(maxsize=4)
def _noise(contrast: float, mean: float, seed: int) -> NDArray[np.float32]:
    field, deviation = _waves(seed)
    array = field * (mean * contrast * math.sqrt(OCTAVES) / max(deviation, 1e-300))
    array += mean
    radiances = np.maximum(array, 0.0, out=array).astype(np.float32)
    radiances.setflags(write=False)
    return radiances


@functools.lru_cache(maxsize=2)
def _waves(seed: int) -> tuple[NDArray[np.float64], float]:
    """A tile of waves of random phases, and its standard deviation: the same of every contrast and mean."""
    rng, finest = np.random.default_rng(seed), _TILE // _PER_PERIOD
    order = np.hypot(np.fft.fftfreq(_TILE)[:, None], np.fft.rfftfreq(_TILE)[: finest + 1]) * _TILE
    inside = (order >= finest / 2**OCTAVES) & (order <= finest)
    turns = rng.random((_TILE, _TILE // 2 + 1))[:, : finest + 1][inside]
    spectrum = np.zeros(order.shape, complex)
    spectrum[inside] = np.exp(2j * math.pi * turns) / order[inside]
    field = np.fft.irfft(np.fft.ifft(spectrum, axis=0), _TILE)  # waves along x beyond the finest are none
    return field, float(np.sqrt(np.mean(field**2)))


Texture = Annotated[Uniform | Checkerboard | Sinusoid | Noise | PictureTexture, Field(discriminator="kind")]

TEXTURES: dict[str, type[Part]] = {
    "uniform": Uniform,
    "checkerboard": Checkerboard,
    "sinusoid": Sinusoid,
    "noise": Noise,
    "image": PictureTexture,
}
"""Kinds of texture by the name that a file gives them."""


class _Placed(_Told):
    """Object that stands at a distance."""

    measured_from: Literal["main lens", "tip"] = "main lens"
    """Zero of its distances Z: the main lens, or the bore's tip, ahead of which they then count."""

    def seen_from(self, tip: float) -> Self:
        """Object with distances from the main lens, of a bore whose tip is `tip` from that [mm]."""
        if self.measured_from == "main lens":
            return self
        return self.model_copy(update={"measured_from": "main lens", **self._shifted(tip)})

    def _shifted(self, by: float) -> dict[str, Any]:
        """Distances that are `by` longer [mm]."""
        raise NotImplementedError


class White(_Told):
    """A uniform field that fills the view at every distance."""

    kind: Literal["white"] = "white"
    level: Level = 1.0
    """Radiance."""


class Plane(_Placed):
    """A plane at any pose, unbounded or a rectangle; seen from both sides."""

    kind: Literal["plane"] = "plane"
    distance: Length | None = None
    """Z of its origin [mm]; none is the design's focal plane."""
    centre: Offset = (0.0, 0.0)
    """(x, y) of its origin."""
    tilt: Tilt = (0.0, 0.0)
    """Its normal is z turned by t_x about x, then by t_y about y [rad]."""
    size: Size | None = None
    """Width and height [mm]; none is unbounded."""
    texture: Texture = Uniform()
    """Over its own (u, v), u along x and v along y before it is tilted."""

    @model_validator(mode="after")
    def _faces_the_lens(self) -> Plane:
        if math.cos(self.tilt[0]) * math.cos(self.tilt[1]) < 0.01:
            raise ValueError(f"tilt {self.tilt} rad shows the plane's edge to the lens; keep it below 89 degrees")
        if self.distance is None and self.measured_from != "main lens":
            raise ValueError(f'measured_from = "{self.measured_from}" measures no distance; give one, or leave it out')
        return self

    def _shifted(self, by: float) -> dict[str, Any]:
        return {"distance": (self.distance or 0.0) + by}


class Points(_Placed):
    """Point sources."""

    kind: Literal["points"] = "points"
    positions: tuple[tuple[AnyLength, AnyLength, Length], ...] = Field(min_length=1, max_length=1000)
    """(x, y, Z) of each."""
    flux: Annotated[float, Field(gt=0, le=MOST_LIGHT)] = 1.0
    """Light of one that the FAP takes in: the sum over all pixels, where 1 is a fully lit one."""

    def _shifted(self, by: float) -> dict[str, Any]:
        return {"positions": tuple((x, y, z + by) for x, y, z in self.positions)}


class Sphere(_Placed):
    """An opaque sphere seen from outside, or a hollow one whose far side is seen from within.

    Texture over (longitude, latitude) times radius, (0, 0) facing the lens.
    """

    kind: Literal["sphere"] = "sphere"
    distance: AnyLength
    """Z of its centre [mm]; that of a hollow one may lie behind the camera."""
    radius: AnyLength
    """Positive of a ball; negative of a hollow one, as a cup or an eardrum [mm]."""
    centre: Offset = (0.0, 0.0)
    """(x, y) of its centre."""
    texture: Texture = Uniform()
    """Texture over the sphere's surface."""

    @model_validator(mode="after")
    def _can_be_seen(self) -> Sphere:
        if abs(self.radius) < SHORTEST:
            raise ValueError(f"radius {self.radius:g} mm is none; give one, negative where the sphere is hollow")
        if self.distance <= min(self.radius, 0.0):
            ways = (
                "move it farther out" if self.radius < 0 else "move it farther out, or give a hollow one a radius < 0"
            )
            raise ValueError(f"distance {self.distance:g} mm of its centre puts it behind the camera; {ways}")
        return self

    def _shifted(self, by: float) -> dict[str, Any]:
        return {"distance": self.distance + by}


class Tube(_Placed):
    """The inside of a tube along the axis (a lumen); texture over (arc length around, Z)."""

    kind: Literal["tube"] = "tube"
    start: Length
    """Z of its near end [mm]."""
    end: Length
    """Z of its far end [mm]."""
    radius: Length
    """[mm]."""
    centre: Offset = (0.0, 0.0)
    """(x, y) of its axis."""
    texture: Texture = Uniform()
    """Texture over the tube's wall."""

    @model_validator(mode="after")
    def _has_a_length(self) -> Tube:
        if self.end <= self.start:
            raise ValueError(f"end {self.end:g} mm is not beyond start {self.start:g} mm; the far end comes second")
        return self

    def _shifted(self, by: float) -> dict[str, Any]:
        return {"start": self.start + by, "end": self.end + by}


Object = Annotated[White | Plane | Points | Sphere | Tube, Field(discriminator="kind")]

OBJECTS: dict[str, type[Part]] = {"white": White, "plane": Plane, "points": Points, "sphere": Sphere, "tube": Tube}
"""Kinds of object by the name that a file gives them."""


def detail(thing: White | Plane | Points | Sphere | Tube) -> tuple[float, bool]:
    """Period of an object's finest detail [mm], inf where it has none, and whether brightness jumps."""
    if isinstance(thing, White):
        return math.inf, False
    if isinstance(thing, Points):
        return 0.0, True
    texture, period, jumps = thing.texture, math.inf, False
    if isinstance(texture, Checkerboard | Sinusoid):
        period, jumps = texture.period, isinstance(texture, Checkerboard) and texture.high != texture.low
    elif isinstance(texture, Noise):
        period = texture.finest
    elif isinstance(texture, PictureTexture):
        period = 2 * texture.width / texture.load().shape[1]  # two of its pixels
    if isinstance(thing, Plane):
        return (period, jumps) if thing.size is None else (min(period, 2 * min(thing.size)), True)
    return min(period, 4 * abs(thing.radius)), True


def brightness(thing: White | Plane | Sphere | Tube) -> float:
    """Mean radiance of an object, wherever it is."""
    if isinstance(thing, White):
        return thing.level
    texture = thing.texture
    if isinstance(texture, Checkerboard):
        return (texture.high + texture.low) / 2
    if isinstance(texture, PictureTexture):
        return float(texture.load().mean())
    return 0.5 if isinstance(texture, Sinusoid) else texture.mean if isinstance(texture, Noise) else texture.level


def depths(
    thing: White | Plane | Points | Sphere | Tube, focal_plane: float, slopes: float, height: float = 0.0
) -> Iterator[float]:
    """Nearest and farthest Z that an object shows [mm]; nothing for a white field, which looks alike at any.

    Parameters
    ----------
    thing
        The object.
    focal_plane : float
        Z [mm] of planes that give none.
    slopes, height : float
        How far off its axis the camera looks, ``slopes Z + height`` [mm], for planes without bounds and hollow spheres.
    """
    if isinstance(thing, Points):
        yield from (z for _, _, z in thing.positions)
    elif isinstance(thing, Sphere):
        near = thing.distance - thing.radius
        yield from (near, thing.distance if thing.radius > 0 else _nearest_within(thing, slopes, height))
    elif isinstance(thing, Tube):
        yield from (thing.start, thing.end)
    elif isinstance(thing, Plane):
        distance, (tilt_x, tilt_y) = focal_plane if thing.distance is None else thing.distance, thing.tilt
        if thing.size is not None:
            half = abs(math.sin(tilt_y)) * thing.size[0] / 2
            half += abs(math.cos(tilt_y) * math.sin(tilt_x)) * thing.size[1] / 2
            yield from (distance - half, distance + half)
            return
        # Z on the plane grows by (rise_x x + rise_y y): its normal is (sin t_y cos t_x, -sin t_x, cos t_x cos t_y), and
        # distances Z count against the light's z.
        rise_x, rise_y = math.tan(tilt_y), -math.tan(tilt_x) / math.cos(tilt_y)
        at_axis = distance - rise_x * thing.centre[0] - rise_y * thing.centre[1]
        steepest = math.hypot(rise_x, rise_y)
        rise, start = steepest * slopes, steepest * height
        yield from ((at_axis + sign * start) / (1 - sign * rise) if sign * rise < 1 else math.inf for sign in (-1, 1))


def _nearest_within(hollow: Sphere, slopes: float, height: float) -> float:
    """Z at which the rays farthest from a hollow sphere's middle leave it, or at most graze it [mm]."""
    off = math.hypot(*hollow.centre)

    def left(slope: float, start: float) -> float:
        steep = math.hypot(1.0, slope)
        graze = -hollow.radius * steep
        beside = max(-graze, min(graze, slope * hollow.distance + start))
        return hollow.distance + (math.sqrt(graze**2 - beside**2) - slope * beside) / steep**2

    return min(left(side * slopes, side * height - off) for side in (-1, 1))
