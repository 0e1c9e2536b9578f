"""The pupil's image behind a microlens: an evenly lit opening, blurred by the microlens's own aperture and focus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from .._arrays import by_value
from ..bore.opening import ClearAperture
from ..camera import Camera
from ..design import Design
from ..shapes.lattice import PACKINGS
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.light import diffraction_width, microlens_defocus, microlens_defocus_blur
from ..theory.transfer import MicrolensTransfer, pixel_box
from .decoding import cubic_taps
from .frames import Array
from .lattice import CentreLattice, Layout

RINGS = 3
"""Neighbours whose light is counted, in pitches: what comes from farther is haze, alike on both sides of an edge."""
_PILED = 16
"""Openings of which a pupil that darkens towards its rim is piled up."""
ROUND = ClearAperture(1.0)
"""Shape of a disc."""


@by_value
@dataclass(frozen=True)
class PupilImage:
    """Image of the evenly lit pupil behind one microlens, blurred by the microlens's own aperture."""

    radius: float
    """Radius of a disc, of another shape the distance of its farthest point from its middle [px]."""
    blur: float
    """lambda d_2/d, first zero of a square microlens's diffraction [px]; 0 leaves diffraction out."""
    pitch: float
    """Pitch of the microlens images [px]."""
    layout: Layout = "square"
    lens_shape: str = "square"
    """Shape of the microlenses."""
    shape: ClearAperture = ROUND
    """Shape of the pupil as the lattice's rows lie, of any size."""
    spread: float = 0.0
    """Ray blur of a microlens that is out of focus on the pupil, signed [px]."""
    dimmer: float = 0.0
    """Share by which the pupil is darker at its rim than in its middle, growing with a `power` of the radius."""
    power: float = 2.0

    @classmethod
    def designed(cls, design: Design, lattice: CentreLattice) -> PupilImage:
        """As a design has it, behind microlenses of a lattice that was found."""
        c = Camera.of(design)
        pupil = c.fap.outline
        radius = float(microlens_image_diameter(c) / (2 * c.q) * (2 * pupil.reach / pupil.width))
        shape = pupil._replace(turn=pupil.turn - lattice.rotation)
        blur, spread = (float(of(c) / c.q) for of in (diffraction_width, microlens_defocus_blur))
        spread = math.copysign(spread, -float(microlens_defocus(c)))
        return cls(radius, blur, lattice.pitch, lattice.layout, c.lens_shape, shape, spread)

    @property
    def opening(self) -> ClearAperture:
        """The pupil's geometric image [px]."""
        return self.shape.scaled(self.radius / self.shape.reach)

    @property
    def axes(self) -> Array:
        """Steps of the lattice as columns [pitches]: u along the rows, v square to them."""
        return PACKINGS[self.layout].steps

    def transfer(self, x: Array, y: Array) -> Array:
        """Transfer function between the pupil's geometric image and a decoded sample, at frequencies [1/px].

        Diffraction, the pixel's square, and the cubic convolution that reads between pixels, averaged over where the
        sample falls between them.
        """
        result: Array = self.lens(x, y) * _reading(x) * _reading(y)
        return result

    @property
    def lens(self) -> MicrolensTransfer:
        """Transfer function of the microlens's diffraction and defocus alone, at frequencies [1/px]."""
        away = (self.blur, self.spread / self.blur) if self.blur > 0 else (1.0, self.spread)
        return MicrolensTransfer(1.0, *away, (1.0,) if self.blur > 0 else (), self.lens_shape)

    def neighbours(self) -> Array:
        """Microlenses around one, itself first [pitches], shape (m, 2)."""
        side = np.arange(-2 * RINGS, 2 * RINGS + 1.0)
        places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2) @ self.axes.T
        distance = np.abs(places).max(axis=1)
        near = distance < RINGS + 0.5
        return np.asarray(places[near][np.argsort(distance[near], kind="stable")])

    def over_cell(self, lattice: CentreLattice, steps: int) -> Array:
        """Light of an evenly lit scene in pixels at ``(i, j)/steps`` of a lattice's cell, shape (steps, steps).

        1 is full light without neighbours. A Fourier series over the lattice, however large and blurred images are.
        """
        return _summed(self._series(lattice, steps), steps)

    def splines_over_cell(self, lattice: CentreLattice, steps: int) -> Array:
        """Coefficients of the cubic spline through `over_cell`, periodic, shape (steps, steps)."""
        shares = [(2 + np.cos(2 * math.pi * f(steps))) / 3 for f in (np.fft.fftfreq, np.fft.rfftfreq)]
        return _summed(self._series(lattice, steps) / np.multiply.outer(*shares), steps)

    def _series(self, lattice: CentreLattice, steps: int) -> Array:
        """Fourier coefficients of `over_cell`, those of the half plane that numpy's `irfft2` takes."""
        x, y, box = _cell_waves(lattice, steps)
        passed = np.maximum(np.abs(x), np.abs(y)) < self.lens.cutoff  # of a blurred image a few in a hundred
        x, y = x[passed], y[passed]
        part = self.opening.spectrum(x, y)
        if self.dimmer:  # a pile of smaller openings
            inner = sum(w * self.opening.scaled(size).spectrum(x, y) for size, w in _pile(self.power))
            part = part + self.dimmer * (inner - part)
        light = np.zeros(passed.shape)
        light[passed] = part * self.lens(x, y) * box[passed]
        return np.asarray(light / abs(np.linalg.det(lattice.basis)))


def _summed(series: Array, steps: int) -> Array:
    """Values of a cell's Fourier series at its steps."""
    return np.asarray(np.fft.irfft2(series, (steps, steps)) * steps**2)


@lru_cache(4)
def _cell_waves(lattice: CentreLattice, steps: int) -> tuple[Array, Array, Array]:
    """Frequencies of a cell's series along the lattice's axes [1/px], and the transfer of a pixel's square there."""
    orders = (f(steps, 1 / steps) for f in (np.fft.fftfreq, np.fft.rfftfreq))
    waves = np.stack(np.meshgrid(*orders, indexing="ij"), -1) @ np.linalg.inv(lattice.basis)
    cos, sin = math.cos(lattice.rotation), math.sin(lattice.rotation)
    return waves @ [cos, sin], waves @ [-sin, cos], pixel_box(waves, 1.0).prod(-1)


@cache
def _pile(power: float) -> tuple[tuple[float, float], ...]:
    """Sizes of openings whose weighted sum falls by a power of the radius, from 1 in the middle to 0 at the rim."""
    nodes, weights = np.polynomial.legendre.leggauss(_PILED)
    sizes = (1 + nodes) / 2
    return tuple(zip(sizes.tolist(), (weights / 2 * power * sizes ** (power - 1)).tolist(), strict=True))


def _reading(frequency: Array) -> Array:
    """Transfer of a pixel's width and of cubic convolution (a = -1/2), along one axis [1/px]."""
    x = (np.arange(2000) + 0.5) / 1000
    further, near, _, _ = cubic_taps(x[:1000])
    axis, back = np.unique(np.abs(frequency), return_inverse=True)
    cubic = 2 * np.cos(2 * math.pi * np.outer(axis, x)) @ np.concatenate([near, further]) / 1000
    return np.asarray((np.sinc(axis) * cubic)[back].reshape(np.shape(frequency)))
