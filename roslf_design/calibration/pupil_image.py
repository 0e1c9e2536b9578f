"""The pupil's image behind a microlens, blurred by diffraction: where a decoded sample's light really came from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..imaging.transfer import MicrolensTransfer
from .lattice import Array, Layout

_STEP = 0.25
"""Grid on which the blur is tabulated [px]."""
_RINGS = 3
"""Neighbours whose light is counted, in pitches: what comes from farther is haze, alike on both sides of an edge."""


@dataclass(frozen=True)
class PupilImage:
    """What one microlens makes of the evenly lit pupil: a disc, blurred by the microlens's own aperture."""

    radius: float
    """Of the disc [px]."""
    blur: float
    """lambda d_2/d, first zero of a square microlens's diffraction [px]; 0 leaves diffraction out."""
    pitch: float
    """Of the microlens images [px]."""
    layout: Layout = "square"
    circular: bool = False
    """Shape of the microlenses."""

    @property
    def axes(self) -> Array:
        """Steps of the lattice as columns [pitches]: u along the rows, v square to them."""
        return np.array([[1.0, 0.5], [0.0, math.sqrt(3) / 2]]) if self.layout == "hexagonal" else np.eye(2)

    def transfer(self, x: Array, y: Array) -> Array:
        """Of everything between the pupil's geometric image and a decoded sample, at frequencies [1/px].

        Diffraction, the pixel's square, and the cubic convolution that reads between pixels, averaged over where the
        sample falls between them.
        """
        lens = MicrolensTransfer(1.0, self.blur, 0.0, (1.0,) if self.blur > 0 else (), self.circular)
        result: Array = lens(x, y) * _reading(x) * _reading(y)
        return result

    def neighbours(self) -> Array:
        """Microlenses around one, itself first [pitches], shape (m, 2)."""
        i, j = np.meshgrid(*2 * [np.arange(-2 * _RINGS, 2 * _RINGS + 1)])
        places = np.stack([i.ravel(), j.ravel()], axis=-1) @ self.axes.T
        distance = np.abs(places).max(axis=1)
        near = distance < _RINGS + 0.5
        return np.asarray(places[near][np.argsort(distance[near], kind="stable")])

    def cell(self, places: Array) -> Array:
        """Light of an evenly lit scene at places relative to a microlens image's centre [px], shape (n, 2) -> (n,).

        1 is full light without neighbours. A Fourier series over the lattice, as far as pixels can tell.
        """
        from scipy.special import j1

        reciprocal = np.linalg.inv(self.pitch * self.axes).T
        most = math.ceil(1.5 * self.pitch * 1.2)
        i, j = np.meshgrid(np.arange(-most, most + 1), np.arange(-most, most + 1))
        waves = np.stack([i.ravel(), j.ravel()], axis=-1) @ reciprocal.T
        height = np.hypot(*waves.T)
        waves, height = waves[height < 1.5], height[height < 1.5]
        safe = np.where(height > 0, height, 1.0)
        disc = self.radius * j1(2 * math.pi * self.radius * safe) / safe
        disc = np.where(height > 0, disc, math.pi * self.radius**2) * abs(np.linalg.det(reciprocal))
        strength = disc * self.transfer(waves[:, 0], waves[:, 1])
        return np.asarray(np.cos(2 * math.pi * places @ waves.T) @ strength)


class ViewWeights(NamedTuple):
    """Shares of light in the samples of each view."""

    views: Array
    """(s', t') that the samples are read at [px], shape (v, 2)."""
    shares: Array
    """From each neighbour and place of the pupil, shape (v, m, n); they add up to 1 for each view."""
    neighbours: Array
    """[pitches], shape (m, 2)."""
    places: Array
    """(s', t') on the pupil's geometric image [px], shape (n, 2)."""

    @property
    def baseline(self) -> Array:
        """Mean place on the pupil of the light that each view gets through its own microlens, (v, 2) [px]."""
        own = self.shares[:, 0]
        return np.asarray(own @ self.places / own.sum(axis=1)[:, None])


def view_weights(image: PupilImage, views: Array, points: int = 400) -> ViewWeights:
    """Where the light of each view's samples came from.

    Parameters
    ----------
    image : PupilImage
    views : ndarray
        (s', t') [px], shape (v, 2).
    points : int
        Places on the pupil.
    """
    from scipy.ndimage import map_coordinates

    reach = (_RINGS + 1.5) * image.pitch + image.radius
    step = max(_STEP, image.blur / 12)
    count = 2 ** math.ceil(math.log2(2 * reach / step))
    frequency = np.asarray(np.fft.fftfreq(count, step), np.float64)
    spread = np.fft.fftshift(np.fft.ifft2(image.transfer(frequency[None, :], frequency[:, None])).real)
    turns = np.asarray(np.arange(points) + 0.5, np.float64)
    angle = turns * math.pi * (3 - math.sqrt(5))
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    places: Array = image.radius * np.sqrt(turns / points)[:, None] * along
    around = image.neighbours()
    away = views[:, None, None] - image.pitch * around[None, :, None] - places[None, None]
    shares = map_coordinates(spread, [away[..., 1] / step + count // 2, away[..., 0] / step + count // 2], order=1)
    shares = shares / shares.sum(axis=(1, 2), keepdims=True)
    return ViewWeights(np.asarray(views, float), np.ascontiguousarray(shares), around, places)


def _reading(frequency: Array) -> Array:
    """Transfer of a pixel's width and of cubic convolution (a = -1/2), along one axis [1/px]."""
    x = (np.arange(2000) + 0.5) / 1000
    kernel = np.where(x < 1, (1.5 * x - 2.5) * x * x + 1, ((-0.5 * x + 2.5) * x - 4) * x + 2)
    axis, back = np.unique(np.abs(frequency), return_inverse=True)
    cubic = 2 * np.cos(2 * math.pi * np.outer(axis, x)) @ kernel / 1000
    return np.asarray((np.sinc(axis) * cubic)[back].reshape(np.shape(frequency)))
