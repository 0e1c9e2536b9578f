"""Textures: radiance over a surface's own coordinates (u, v) [mm]; 1 is fully lit white."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from ..design.parts import Part
from ..design.units import Angle, Length

Level = Annotated[float, Field(ge=0)]


class Uniform(Part):
    """The same everywhere."""

    kind: Literal["uniform"] = "uniform"
    level: Level = 1.0
    """Radiance."""

    @property
    def smallest_period(self) -> float:
        """Inf: no detail."""
        return math.inf

    @property
    def hard_edges(self) -> bool:
        """Whether brightness jumps."""
        return False

    def at(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Radiance at surface points."""
        return np.full(np.broadcast_shapes(np.shape(u), np.shape(v)), self.level)


class Checkerboard(Part):
    """Squares of two levels; a corner lies on the surface's origin."""

    kind: Literal["checkerboard"] = "checkerboard"
    period: Length
    """Two squares [mm]."""
    high: Level = 1.0
    """Radiance of the bright squares."""
    low: Level = 0.0
    """Radiance of the dark squares."""

    @property
    def smallest_period(self) -> float:
        """Period [mm]."""
        return self.period

    @property
    def hard_edges(self) -> bool:
        """Whether brightness jumps."""
        return self.high != self.low

    def at(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Radiance at surface points."""
        odd = (np.floor(np.multiply(u, 2 / self.period)) + np.floor(np.multiply(v, 2 / self.period))) % 2
        return np.where(odd == 0, self.high, self.low)


class Sinusoid(Part):
    """A grating, 0.5 (1 + contrast cos(2 pi t/period))."""

    kind: Literal["sinusoid"] = "sinusoid"
    period: Length
    """[mm]."""
    angle: Angle = 0.0
    """Direction in which it varies, from the surface's u axis [rad]."""
    contrast: Annotated[float, Field(ge=0, le=1)] = 1.0
    """(max - min)/(max + min)."""

    @property
    def smallest_period(self) -> float:
        """Period [mm]."""
        return self.period

    @property
    def hard_edges(self) -> bool:
        """Whether brightness jumps."""
        return False

    def at(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Radiance at surface points."""
        along = np.multiply(u, math.cos(self.angle)) + np.multiply(v, math.sin(self.angle))
        return np.asarray(0.5 * (1 + self.contrast * np.cos(2 * math.pi / self.period * along)))


class Picture(Part):
    """An image file, bilinearly interpolated, repeated beyond its edges; its middle lies on the surface's origin.

    Grey as the mean of its colour channels; the file's full scale is 1. Rows run along v, downwards in the file.
    """

    kind: Literal["image"] = "image"
    file: str
    """PNG, TIFF, JPEG and whatever else Pillow reads; relative to the scene file."""
    width: Length
    """Width of the picture on the surface [mm]; pixels are square."""

    def load(self) -> NDArray[np.float32]:
        """Radiances, shape (rows, columns).

        Raises
        ------
        OSError, ValueError
            The file is missing, or no image that can be read.
        """
        return load_picture(Path(self.file))

    @property
    def smallest_period(self) -> float:
        """Two of the picture's pixels [mm]."""
        return float(2 * self.width / self.load().shape[1])

    @property
    def hard_edges(self) -> bool:
        """Whether brightness jumps from one of its pixels to the next."""
        return False

    def at(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Radiance at surface points."""
        values = self.load()
        rows, columns = values.shape
        x = np.multiply(u, columns / self.width) + columns / 2 - 0.5
        y = np.multiply(v, columns / self.width) + rows / 2 - 0.5
        x0, y0 = np.floor(x), np.floor(y)
        fx, fy = x - x0, y - y0
        i, j = x0.astype(int) % columns, y0.astype(int) % rows
        i2, j2 = (i + 1) % columns, (j + 1) % rows
        top = values[j, i] * (1 - fx) + values[j, i2] * fx
        return np.asarray(top * (1 - fy) + (values[j2, i] * (1 - fx) + values[j2, i2] * fx) * fy, np.float64)


Texture = Annotated[Uniform | Checkerboard | Sinusoid | Picture, Field(discriminator="kind")]

TEXTURES: dict[str, type[Part]] = {
    "uniform": Uniform,
    "checkerboard": Checkerboard,
    "sinusoid": Sinusoid,
    "image": Picture,
}
"""Kinds of texture by the name that a file gives them."""


def load_picture(path: Path) -> NDArray[np.float32]:
    """Read an image file as radiances, full scale 1, shape (rows, columns).

    Raises
    ------
    OSError, ValueError
        The file is missing, or no image that can be read.
    """
    stat = path.stat()
    return _loaded(str(path), stat.st_mtime_ns, stat.st_size)


_CACHE: dict[tuple[str, int, int], NDArray[np.float32]] = {}
_KEPT = 8


def _loaded(path: str, changed: int, size: int) -> NDArray[np.float32]:
    """Keep the last few pictures: reading them again for every tile would cost more than the rays."""
    key = (path, changed, size)
    if key not in _CACHE:
        from PIL import Image

        with Image.open(path) as image:
            values = np.asarray(image)
        if values.dtype == np.bool_ or values.dtype.kind not in "uf":
            values = values.astype(np.float32)
            peak = 1.0 if values.max(initial=0) <= 1 else 255.0 if values.max() <= 255 else 65535.0
        else:
            peak = float(np.iinfo(values.dtype).max) if values.dtype.kind == "u" else 1.0
        grey = values[..., :3].mean(-1) if values.ndim == 3 else values
        array = np.ascontiguousarray(grey / peak, np.float32)
        if array.ndim != 2 or array.size == 0:
            raise ValueError("holds no two-dimensional image")
        if not (np.isfinite(array).all() and array.min() >= 0):
            raise ValueError("holds values that are negative or not finite")
        array.setflags(write=False)
        while len(_CACHE) >= _KEPT:
            _CACHE.pop(next(iter(_CACHE)))
        _CACHE[key] = array
    return _CACHE[key]
