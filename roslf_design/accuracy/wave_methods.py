"""Methods for microlens images with diffraction, all neighbours alike: series, FFT, and direct Huygens quadrature.

Lengths in pixels: radius r of the pupil's image, pitch P of the images, blur width w = lambda d_2/d. The image repeats
with P and holds no frequency above 1/w, so that its Fourier series ends at the harmonic floor(P/w).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .jobs import Job
from .methods import Method
from .pixels import covered_pixels
from .slices import gauss

Floats = NDArray[np.float64]

MOST_HUYGENS = 8
"""Harmonics up to which direct quadrature is of use: its cost grows with the fourth power."""


def centres(job: Job) -> tuple[Floats, Floats]:
    """Centres of the patch's columns and rows, from the image's centre [px]."""
    corner, width = job.box
    at = np.arange(width) + 0.5
    return at + corner[0] - job.discs[0][0, 0], at + corner[1] - job.discs[0][0, 1]


def transfer(job: Job, frequency: Floats) -> Floats:
    """Of one axis of a square microlens, frequencies per pixel: what its aperture's overlap with itself leaves."""
    width, _, bend = job.blur
    overlap = np.maximum(1 - width * np.abs(frequency), 0.0)
    turns = bend * job.design.d_2 * job.design.d / job.design.q * frequency * overlap
    return np.asarray(overlap * np.sinc(turns))


def _waves(job: Job, order: Floats) -> tuple[Floats, Floats]:
    """Cosines of each harmonic at the patch's columns and rows, those of both signs added."""
    _, pitch, _ = job.blur
    both = np.where(order > 0, 2.0, 1.0)
    x, y = (np.cos(2 * math.pi / pitch * np.outer(at, order)) * both for at in centres(job))
    return x, y


def _series(job: Job, percent: int, seed: int) -> Floats:
    """Harmonics by closed form; 100 % are all there are."""
    from scipy.special import j1

    _, pitch, _ = job.blur
    order = np.arange(math.ceil(job.harmonics * percent / 100) + 1.0)
    height = np.hypot(order, order[:, None]) / pitch
    safe = np.where(height > 0, height, 1.0)
    spectrum = np.where(height > 0, job.radius * j1(2 * math.pi * job.radius * safe) / safe, math.pi * job.radius**2)
    axis = transfer(job, order / pitch) * np.sinc(order / pitch)
    x, y = _waves(job, order)
    return np.asarray((y @ (spectrum * axis * axis[:, None] / pitch**2) @ x.T).ravel())


def _fft(job: Job, count: int, seed: int) -> Floats:
    """Exact coverage of count x count squares of one period, transformed; what lies above their frequencies folds."""
    _, pitch, _ = job.blur
    step = pitch / count
    reach = _reach(job)
    middle = (reach + 0.5) * pitch
    wide = covered_pixels(
        np.array([[middle, middle]]), np.array([job.radius]), (2 * reach + 1) * count, (2 * reach + 1) * count, step
    )
    cell = wide.reshape(2 * reach + 1, count, 2 * reach + 1, count).sum((0, 2))
    order = np.arange(min(job.harmonics, (count - 1) // 2) + 1.0)
    # Samples lie at (k + 1/2) step from the period's corner, the image's centre in its middle; squares blur by a sinc.
    turn = np.exp(1j * math.pi * order * (1 - 1 / count)) / np.sinc(order / count)
    spectrum = np.fft.rfft2(cell)[: order.size, : order.size] / count**2
    spectrum = (spectrum * turn * turn[:, None]).real
    axis = transfer(job, order / pitch) * np.sinc(order / pitch)
    x, y = _waves(job, order)
    return np.asarray((y @ (spectrum * axis * axis[:, None]) @ x.T).ravel())


def pupil_points(radius: float, rings: int) -> tuple[Floats, Floats]:
    """Points of a disc, shape (Q, 2), and their shares of its area: Gauss along the radius, even in angle."""
    nodes, weights = gauss(rings)
    turns = 4 * rings
    angle = 2 * math.pi * (np.arange(turns) + 0.5) / turns
    r = radius * nodes
    points = np.stack([np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()], -1)
    share = np.repeat(2 * nodes * weights / turns, turns)
    return points, share


def profile(job: Job, places: Floats, reach: int) -> Floats:
    """Light of one pupil point along one axis: field over the aperture, squared, over `reach` neighbours each side.

    Neighbours farther out give their mean, w/(2 pi^2 t^2) at a distance t.
    """
    width, pitch, bend = job.blur
    farthest = float(np.max(np.abs(places))) + reach * pitch
    sag = 0.5 * bend * job.design.d**2 / job.design.wavelength
    nodes, weights = gauss(math.ceil(1.7 * (farthest / width + abs(sag))) + 12)
    v = nodes - 0.5
    lens = weights * np.exp(-2j * math.pi * sag * v * v)
    light = np.zeros(places.shape)
    for k in range(-reach, reach + 1):
        field = np.exp((-2j * math.pi / width) * np.multiply.outer(places - k * pitch, v)) @ lens
        light += field.real**2 + field.imag**2
    return light / width + width / (math.pi**2 * (reach + 0.5) * pitch**2)


def _huygens(job: Job, level: int, seed: int) -> Floats:
    """Incoherent sum over pupil points of squared aperture integrals, over each pixel by Gauss's rule."""
    width, _, _ = job.blur
    points, share = pupil_points(job.radius, 3 + 2 * level + math.ceil(2 * job.radius / width))
    nodes, weights = gauss(2 + level + math.ceil(1.5 / width))
    across, along = centres(job)
    found = []
    for axis, at in enumerate((across, along)):
        places = at[:, None] + nodes - 0.5
        light = profile(job, places - points[:, axis, None, None], 2**level)
        found.append(light @ weights)
    area = math.pi * job.radius**2
    return np.asarray(np.einsum("q,qy,qx->yx", share * area, found[1], found[0]).ravel())


def geometric(job: Job) -> Floats:
    """The same image by rays alone, neighbours added: what no number of rays gets past."""
    corner, width = job.box
    _, pitch, _ = job.blur
    at = job.discs[0][:1] - corner
    total = np.zeros((width, width))
    reach = math.ceil(2 * job.radius / pitch) + 1
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            total += covered_pixels(at + pitch * np.array([i, j]), job.discs[1][:1], width, width)
    return total.ravel()


def _geometric(job: Job, level: int, seed: int) -> Floats:
    return geometric(job)


def _series_work(job: Job, percent: int) -> float:
    count = job.harmonics * percent / 100 + 1
    return count * count + 0.02 * count * job.pixels


def _fft_work(job: Job, count: int) -> float:
    return (2 * _reach(job) + 1) ** 2 * count * count + 0.02 * count * job.pixels


def _reach(job: Job) -> int:
    """Neighbours on each side whose light falls into an image's own period."""
    _, pitch, _ = job.blur
    return math.ceil((job.radius - pitch / 2) / pitch - 1e-9)


def _huygens_work(job: Job, level: int) -> float:
    width, pitch, _ = job.blur
    rings = 3 + 2 * level + 2 * job.radius / width
    places = job.box[1] * (2 + level + 1.5 / width)
    reach = 2**level
    nodes = 1.7 * (2 * job.radius + reach * pitch) / width + 12
    return float(4 * rings**2 * places * (2 * reach + 1) * nodes)


def _small(job: Job) -> bool:
    return job.harmonics <= MOST_HUYGENS


QUANTITY = "diffraction image"
WAVES = (
    Method("harmonic series", QUANTITY, "series", (25, 50, 75, 100), _series, _series_work, "n % of the harmonics"),
    Method("FFT", QUANTITY, "fft", (8, 16, 32, 64, 128, 256, 512), _fft, _fft_work, "n x n exact samples a period"),
    Method("direct Huygens", QUANTITY, "huygens", (0, 1, 2), _huygens, _huygens_work, "2^n neighbours a side", _small),
    Method("rays alone", QUANTITY, "first order", (0,), _geometric, lambda job, n: float(job.pixels), "no diffraction"),
)
