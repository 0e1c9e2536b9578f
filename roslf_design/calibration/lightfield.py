"""The decoded light field L(s, t, u, v) as a value: views, epipolar-plane images, coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .errors import optional_module
from .lattice import Array

if TYPE_CHECKING:
    import xarray

Samples = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class LightField:
    """Radiance by view and microlens.

    s, t count pixels from each microlens image's centre, along the array's rows and square to them, as its shadow lies
    on the sensor (t down the image); u, v count microlens pitches along the same directions. So Eq. 12 holds along
    (s, u) and along (t, v), whatever the array's rotation against the sensor.
    """

    values: Samples
    """Shape (t, s, v, u): the order of storage puts each view's picture last, rows first."""
    weight: Samples
    """Light that the white image has there, 1 at its brightest; 0 where nothing was measured. Shape (t, s, v, u)."""
    s: Array
    """[px]"""
    t: Array
    """[px]"""
    u: Array
    """[microlens pitches]; equal steps, of 1 for square arrays and sqrt(3)/2 for hexagonal ones made square."""
    v: Array
    """[microlens pitches]"""
    pitch: float
    """Microlens-image pitch on the sensor [px]."""
    rotation: float = 0.0
    """Of the array against the sensor, +x towards +y [rad]."""

    def __post_init__(self) -> None:
        shape = (len(self.t), len(self.s), len(self.v), len(self.u))
        if self.values.shape != shape or self.weight.shape != shape:
            raise ValueError(
                f"light field of shape {self.values.shape} and {self.weight.shape}, coordinates of {shape}"
            )

    def __repr__(self) -> str:
        views, size = f"{len(self.s)} x {len(self.t)}", f"{len(self.u)} x {len(self.v)}"
        return f"LightField({views} views of {size} microlenses, pitch {self.pitch:.3f} px)"

    def view(self, s: float = 0.0, t: float = 0.0) -> Samples:
        """The sub-aperture view nearest to (s, t) [px], shape (v, u)."""
        picture: Samples = self.values[_nearest(self.t, t), _nearest(self.s, s)]
        return picture

    def view_weight(self, s: float = 0.0, t: float = 0.0) -> Samples:
        """Weight of `view`, shape (v, u)."""
        picture: Samples = self.weight[_nearest(self.t, t), _nearest(self.s, s)]
        return picture

    def epi(self, v: float, t: float = 0.0) -> Samples:
        """Horizontal epipolar-plane image at row v [pitches] and view row t [px], shape (s, u)."""
        return self.values[_nearest(self.t, t), :, _nearest(self.v, v), :]

    def vertical_epi(self, u: float, s: float = 0.0) -> Samples:
        """Vertical epipolar-plane image at column u [pitches] and view column s [px], shape (t, v)."""
        return self.values[:, _nearest(self.s, s), :, _nearest(self.u, u)]

    def microlens(self, column: int, row: int) -> Samples:
        """What one microlens saw, shape (t, s)."""
        return self.values[:, :, row, column]

    def position(self, column: Any, row: Any) -> tuple[Array, Array]:
        """Microlens coordinates (u, v) [pitches] of fractional columns and rows of a view."""
        du, dv = self.u[1] - self.u[0], self.v[1] - self.v[0]
        return self.u[0] + np.asarray(column, float) * du, self.v[0] + np.asarray(row, float) * dv

    def to_xarray(self) -> xarray.Dataset:
        """The same as an xarray dataset with named coordinates and units.

        Raises
        ------
        MissingExtraError
            Without xarray.
        """
        xr = optional_module("xarray", "a netCDF light field")
        dims = ("t", "s", "v", "u")
        coordinates = {
            "s": ("s", self.s, {"units": "pixel", "long_name": "pixel in the microlens image, along the array's rows"}),
            "t": ("t", self.t, {"units": "pixel", "long_name": "pixel in the microlens image, square to the rows"}),
            "u": ("u", self.u, {"units": "microlens pitch", "long_name": "microlens along the array's rows"}),
            "v": ("v", self.v, {"units": "microlens pitch", "long_name": "microlens square to the rows"}),
        }
        data = {
            "radiance": (dims, self.values, {"long_name": "decoded light field"}),
            "weight": (dims, self.weight, {"long_name": "light in the white image, relative to its brightest"}),
        }
        attributes = {"pitch_px": self.pitch, "rotation_rad": self.rotation}
        dataset: xarray.Dataset = xr.Dataset(data, coords=coordinates, attrs=attributes)
        return dataset


def _nearest(axis: Array, value: float) -> int:
    return int(np.argmin(np.abs(axis - value)))
