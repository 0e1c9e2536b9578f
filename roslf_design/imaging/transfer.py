"""What a microlens's aperture does to the incoherent image of the pupil behind it, as a transfer function.

A uniform scene fills the FAP with incoherent light (van Cittert-Zernike), and every point of it lights the sensor with
the same pattern |Fresnel transform of the microlens aperture|^2, shifted. So the microlens image is its geometric shape
convolved with that pattern, and in frequencies a product with the aperture's own autocorrelation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Design
from ..effects import Plan
from ..effects.field import defocus

Floats = NDArray[np.float64]

NODES = 64
"""Gauss-Legendre nodes across a circular aperture's overlap, and four more for each cycle of defocus across it."""

TABULATE_FROM = 20_000
"""Frequencies from which a circle's transfer is read from a table along the radius, to about 1e-7."""


@dataclass(frozen=True)
class MicrolensTransfer:
    """Transfer function of a microlens, diffraction and defocus as switched on; 1 at zero frequency."""

    width: float
    """d, the aperture's width [mm]."""
    sensor_distance: float
    """d_2 [mm]."""
    defocus: float
    """1/f_ml - 1/d_2 - 1/L [1/mm]; 0 leaves it out."""
    wavelengths: tuple[float, ...]
    """Equal parts of light at each [mm]; empty leaves diffraction out."""
    circular: bool
    """Shape of the aperture."""
    rotation: float = 0.0
    """Of the square aperture's sides [rad]."""

    @classmethod
    def of(cls, design: Design, plan: Plan, wavelengths: Sequence[float] = ()) -> MicrolensTransfer:
        """As a plan has it.

        Parameters
        ----------
        design : Design
        plan : Plan
        wavelengths : sequence of float
            The scene's [mm]; empty is the design's own.
        """
        array = design.microlens_array
        diffracts = plan.on("microlens_diffraction")
        return cls(
            design.d,
            design.d_2,
            defocus(design) if plan.on("microlens_defocus") else 0.0,
            (tuple(wavelengths) or (design.wavelength,)) if diffracts else (),
            array.lens_shape == "circular",
            array.rotation if plan.on("mla_rotation") else 0.0,
        )

    @property
    def trivial(self) -> bool:
        """True where the microlens image stays as geometry has it."""
        return not self.wavelengths and self.defocus == 0

    @property
    def cutoff(self) -> float:
        """Frequency along x or y beyond which nothing passes, d/(lambda d_2) [1/mm]; inf without diffraction."""
        if not self.wavelengths:
            return math.inf
        reach = self.width / (min(self.wavelengths) * self.sensor_distance)
        turned = abs(math.cos(self.rotation)) + abs(math.sin(self.rotation))
        return reach if self.circular else reach * turned

    def __call__(self, frequency_x: ArrayLike, frequency_y: ArrayLike) -> Floats:
        """Transfer at spatial frequencies on the sensor.

        Parameters
        ----------
        frequency_x, frequency_y : array_like
            [1/mm]; broadcast.

        Returns
        -------
        ndarray
            Real, as the aperture is symmetric.
        """
        x, y = (np.asarray(values, float) for values in (frequency_x, frequency_y))
        if self.trivial:
            return np.ones(np.broadcast_shapes(x.shape, y.shape))
        c, s = math.cos(self.rotation), math.sin(self.rotation)
        if not self.circular and s != 0:
            x, y = c * x + s * y, c * y - s * x
        parts = [self._at(x, y, wavelength) for wavelength in self.wavelengths or (0.0,)]
        return np.asarray(sum(parts) / len(parts))

    def _at(self, x: Floats, y: Floats, wavelength: float) -> Floats:
        if self.circular:
            radius = np.hypot(x, y)
            if radius.size <= TABULATE_FROM:
                return self._circle(radius, wavelength)
            grid = np.linspace(0, float(radius.max()), TABULATE_FROM)
            return np.interp(radius, grid, self._circle(grid, wavelength))
        return self._line(x, wavelength) * self._line(y, wavelength)

    def _line(self, frequency: Floats, wavelength: float) -> Floats:
        """One axis of the square: overlap d - a of the aperture with itself shifted by a = lambda d_2 nu."""
        overlap = np.maximum(self.width - wavelength * self.sensor_distance * np.abs(frequency), 0.0)
        phase = self.defocus * self.sensor_distance * frequency * overlap
        return np.asarray(overlap / self.width * np.sinc(phase))

    def _circle(self, frequency: Floats, wavelength: float) -> Floats:
        """Overlap of two circles, column by column along the shift; x = L sin^2 removes the rim's square root."""
        shift = wavelength * self.sensor_distance * frequency / self.width
        half = np.maximum(1.0 - shift, 0.0)[..., None] / 2
        cycles = abs(self.defocus) * self.sensor_distance * self.width * float(frequency.max(initial=0.0))
        nodes, weights = np.polynomial.legendre.leggauss(NODES + 4 * min(1000, math.ceil(cycles)))
        angle = (nodes + 1) * (math.pi / 4)
        x = half * np.sin(angle) ** 2
        chord = np.sqrt((half - x) * (half + x + shift[..., None]))
        ramp = half * 2 * np.sin(angle) * np.cos(angle) * weights * (math.pi / 4)
        turns = np.cos(2 * math.pi * self.defocus * self.sensor_distance * self.width * frequency[..., None] * x)
        return np.asarray((chord * turns * ramp).sum(-1) * 16 / math.pi)
