"""Methods for the diffraction image of one microlens behind a cut pupil, its cat's eye: neighbours are not alike there.

Lengths in pixels, as in `wave_methods`. Of a square microlens the light of one pupil point is a product of two
lines, k(x) k(y), over each pixel; the image is that product integrated over the common part of the rims' discs. A line
holds no frequency above 1/w: ``k(x) = integral over |nu| < 1/w of T(nu) sinc(nu) cos(2 pi nu x)``.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..microlens.discs import boundary_arcs, intersect
from .jobs import CUT, Job
from .methods import Kind, Method, inside, random_points
from .pixels import covered_pixels
from .slices import _mapped, breaks, gauss
from .wave_methods import transfer

Floats = NDArray[np.float64]

HALO = 24
"""Pixels around the patch at the FFT's coarsest level; they double with it."""
SLIVER = 0.02
"""Part of its smallest disc below which a shape is integrated over its inside: along its outline, it would be a
difference of two sides. Wider shapes go along the outline, on which nothing is singular where rims nearly touch."""
BLOCK = 4096
"""Points whose lines are computed at once."""


def frequencies(job: Job, farthest: float) -> tuple[Floats, Floats]:
    """Nodes in (0, 1/w) and weights with the transfer and the pixel in them, for distances up to `farthest` [px]."""
    limit = 1 / job.blur[0]
    bend = abs(job.blur[2]) * job.design.d_2 * job.design.d / job.design.q * limit
    # pi nodes for each cycle of cos, the pixel's sinc and the defocus's; sixteen more for machine precision.
    nodes, weights = gauss(math.ceil(math.pi * (farthest * limit + 0.5 * limit + bend)) + 16)
    nu = limit * nodes
    return nu, 2 * limit * weights * transfer(job, nu) * np.sinc(nu)


def lines(job: Job, at: Floats, places: Floats, integral: bool = False) -> Floats:
    """k(at - places) over pixels at `at`, shape (at, places); its integral over `at` where asked for."""
    far = max(abs(float(at.max() - places.min())), abs(float(at.min() - places.max())))
    nu, weights = frequencies(job, far)
    a, b = 2 * math.pi * np.outer(at, nu), 2 * math.pi * np.outer(nu, places)
    if integral:
        # The integral of the cosine, nu never being 0.
        weights = weights / (2 * math.pi * nu)
        return np.asarray((np.sin(a) * weights) @ np.cos(b) - (np.cos(a) * weights) @ np.sin(b))
    return np.asarray((np.cos(a) * weights) @ np.cos(b) + (np.sin(a) * weights) @ np.sin(b))


def pixel_places(job: Job) -> tuple[Floats, Floats]:
    """Centres of the patch's columns and rows, from the microlens axis [px]."""
    corner, width = job.box
    at = np.arange(width) + 0.5
    return at + corner[0], at + corner[1]


def pupil_nodes(centres: Floats, radii: Floats, nodes: int) -> tuple[Floats, Floats]:
    """Points of a common part, shape (N, 2), and weights that add up to its area to the last digits.

    Slices between the places where curves change, Gauss's rule along and across. However thin the shape, its area comes
    from the closed form that keeps all digits: what cancels in the slices' lengths is common to their weights.
    """
    low, high = centres[:1] - radii[0], centres[:1] + radii[0]
    edges = breaks(centres, radii, low, high)[0]
    wide = edges[1:] > edges[:-1]
    start, half = edges[:-1][wide], 0.5 * np.diff(edges)[wide]
    u, w, ramp, slope = _mapped(nodes)
    x = (start[:, None] + half[:, None] * ramp).ravel()
    weight = (half[:, None] * slope).ravel()
    chord = np.sqrt(np.maximum((radii - (x[:, None] - centres[:, 0])) * (radii + (x[:, None] - centres[:, 0])), 0.0))
    top, bottom = (centres[:, 1] + chord).min(1), (centres[:, 1] - chord).max(1)
    length = np.maximum(top - bottom, 0.0)
    y = bottom[:, None] + length[:, None] * u
    points = np.stack([np.broadcast_to(x[:, None], y.shape).ravel(), y.ravel()], -1)
    weights = ((weight * length)[:, None] * w).ravel()
    total, area = float(weights.sum()), float(intersect(centres, radii).area)
    if total > 0:
        return points, weights * (area / total)
    # Thinner than the numbers between its ends: a point with all the light.
    return np.asarray(intersect(centres, radii).centroid)[None], np.array([area])


def enough(job: Job, nodes: int) -> int:
    """Nodes a panel, beyond those that follow k along half the pupil's width."""
    return nodes + math.ceil(3 * job.radius / job.blur[0])


def spread(job: Job, points: Floats, weights: Floats) -> Floats:
    """Light of pupil points on the patch's pixels, row by row."""
    x, y = pixel_places(job)
    image = np.zeros((y.size, x.size))
    for first in range(0, len(points), BLOCK):
        part = slice(first, first + BLOCK)
        image += (lines(job, y, points[part, 1]) * weights[part]) @ lines(job, x, points[part, 0]).T
    return image.ravel()


def _panels(job: Job, nodes: int, seed: int) -> Floats:
    return spread(job, *pupil_nodes(*job.discs, enough(job, nodes)))


def _arcs(job: Job, nodes: int, seed: int) -> Floats:
    """Green's theorem along the outline: no slices, no square roots; every arc in pieces of a quarter turn or less."""
    at, dy = outline_nodes(*job.discs, enough(job, nodes))
    x, y = pixel_places(job)
    # d/da of the line's integral over at is -k: the sign is that of the outline's turn.
    return np.asarray(((lines(job, y, at[:, 1]) * dy) @ -lines(job, x, at[:, 0], integral=True).T).ravel())


def _sampled(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """Points in the square around the pupil's image, those past all rims."""
    centres, radii = job.discs
    at = centres[0] + radii[0] * (2 * random_points(kind, count, seed) - 1)
    kept = at[inside(centres, radii, *at.T)]
    if not len(kept):
        return np.zeros(job.pixels)
    return spread(job, kept, np.full(len(kept), 4 * radii[0] ** 2 / count))


def _fft(job: Job, level: int, seed: int) -> Floats:
    """Exact coverage of n x n subpixels, multiplied by the transfer; a wider frame keeps the far side's tails out."""
    centres, radii = job.discs
    corner, width = job.box
    halo = HALO * level
    count = (width + 2 * halo) * level
    cover = covered_pixels(centres - corner + halo, radii, count, count, 1 / level)
    nu = np.fft.rfftfreq(count, 1 / level), np.fft.fftfreq(count, 1 / level)
    # Subpixels have blurred already, and a pixel is the mean over level of them.
    line = [
        transfer(job, np.asarray(v, np.float64)) * np.where(np.abs(v) > 0, np.sinc(v) / np.sinc(v / level), 1.0)
        for v in nu
    ]
    wave = np.fft.irfft2(np.fft.rfft2(cover) * line[0] * line[1][:, None], s=cover.shape)
    # A pixel's centre lies between two subpixels' where there is an even number of them.
    if level % 2 == 0:
        turn = [np.exp(-1j * math.pi * v / level) for v in nu]
        spectrum = np.fft.rfft2(wave) * turn[0] * turn[1][:, None]
        wave = np.fft.irfft2(spectrum, s=cover.shape)
    first = halo * level + level // 2
    rows = slice(first, first + width * level, level)
    return np.asarray(wave[rows, rows].ravel())


def _shape(job: Job, level: int, seed: int) -> Floats:
    centres, radii = job.discs
    corner, width = job.box
    return covered_pixels(centres - corner, radii, width, width).ravel()


def _nodes(job: Job) -> float:
    """Frequencies times columns and rows: what a point of the pupil costs."""
    return float(2 * job.box[1] * (math.pi * (2 * job.radius + 2) / job.blur[0] + 16))


CUTS = (
    Method(
        "arc integrals", CUT, "panels", (1, 2, 3, 4, 6, 8, 12, 16, 24), _arcs,
        lambda job, n: _nodes(job) * enough(job, n), "Green's theorem along the rims, n nodes a quarter turn, and more",
    ),
    Method(
        "Gauss panels", CUT, "panels", (1, 2, 3, 4, 6, 8, 12, 16), _panels,
        lambda job, n: _nodes(job) * enough(job, n) ** 2, "slices of the pupil, n more nodes a panel, along and across",
    ),
    Method(
        "FFT", CUT, "fft", (1, 2, 4, 8), _fft,
        lambda job, n: float(((job.box[1] + 2 * HALO * n) * n) ** 2), "n x n exact subpixels a pixel",
    ),
    Method(
        "Monte Carlo", CUT, "random", tuple(4**k for k in range(2, 9)), partial(_sampled, "random"),
        lambda job, n: _nodes(job) * n, "n random points of the pupil",
    ),
    Method(
        "scrambled Sobol", CUT, "sobol", tuple(4**k for k in range(2, 9)), partial(_sampled, "sobol"),
        lambda job, n: _nodes(job) * n, "n evenly spread points of the pupil",
    ),
    Method(
        "rays alone", CUT, "first order", (0,), _shape, lambda job, n: float(job.pixels), "no diffraction",
    ),
)  # fmt: skip
"""Methods for diffraction images of cut pupils."""


def outline_nodes(centres: Floats, radii: Floats, nodes: int) -> tuple[Floats, Floats]:
    """Points along the outline of a common part, shape (N, 2), and weights of dy; quarter turns or less at a time."""
    u, w = gauss(nodes)
    points, steps = [np.empty((0, 2))], [np.empty(0)]
    for arc in boundary_arcs(centres, radii):
        pieces = math.ceil((arc.end - arc.start) / (0.5 * math.pi))
        turn = (arc.end - arc.start) / pieces
        angle = (arc.start + turn * (np.arange(pieces)[:, None] + u)).ravel()
        r = radii[arc.disc]
        points.append(centres[arc.disc] + r * np.stack([np.cos(angle), np.sin(angle)], -1))
        steps.append(r * np.cos(angle) * turn * np.tile(w, pieces))
    return np.concatenate(points), np.concatenate(steps)


def light_at(centres: Floats, radii: Floats, width: float, at: tuple[float, float], nodes: int = 24) -> float:
    """Light that a cut pupil sends to one point of the sensor, through a square microlens in focus.

    Parameters
    ----------
    centres, radii : ndarray
        Rims' discs on the sensor, shapes (K, 2) and (K,).
    width : float
        Blur width w, in the same unit.
    at : (x, y)
        The point.
    nodes : int
        Along each quarter turn or panel, beyond those that follow the waves.

    Returns
    -------
    float
        Integral of ``sinc^2(x/w) sinc^2(y/w)/w^2`` about the point over the common part: 1 would be a wide open pupil.
    """
    r = float(radii.min())
    if intersect(centres, radii).area < SLIVER * math.pi * r * r:
        points, weights = pupil_nodes(centres, radii, nodes + math.ceil(r / width))
        lobes = np.sinc((points - at) / width) ** 2
        return float((weights * lobes[:, 0]) @ lobes[:, 1]) / width**2
    from scipy.special import sici

    points, steps = outline_nodes(centres, radii, nodes + math.ceil(4 * r / width))
    t, u = math.pi * (points[:, 0] - at[0]) / width, (points[:, 1] - at[1]) / width
    # Integral of sinc^2 along x, Si(2 t) - sin^2 t/t over pi.
    along = (sici(2 * t)[0] - np.sin(t) * np.sinc(t / math.pi)) / math.pi
    return float((along * np.sinc(u) ** 2) @ steps) / width
