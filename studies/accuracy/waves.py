"""Methods with diffraction: pixels behind square microlenses, neighbours alike or one alone behind a cut pupil.

Lengths in pixels: radius r of the pupil's image, pitch P of the images, blur width w = lambda d_2/d. With neighbours
alike the image repeats with P and holds no frequency above 1/w, so that its Fourier series ends at the harmonic
floor(P/w). One microlens alone: the light of one pupil point is a product of two lines, k(x) k(y), over each pixel;
the image is that product integrated over the common part of the rims' discs. A line holds no frequency above 1/w
either: ``k(x) = integral over |nu| < 1/w of T(nu) sinc(nu) cos(2 pi nu x)``.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from roslf_design.shapes.discs import _boundary_arcs, intersect

from .jobs import CUT, Job
from .jobs import WAVES as ALIKE
from .shapes import Kind, Method, breaks, chords, covered_pixels, gauss, inside, panel_rule, pixel_image, random_points

Floats = NDArray[np.float64]

MOST_HUYGENS = 8
"""Harmonics up to which direct quadrature is of use: its cost grows with the fourth power."""
FARTHEST = 4
"""Neighbours on each side whose images reach into one period, up to which an FFT is of use."""
HALO = 24
"""Pixels around the patch at the coarsest level of a cut image's FFT; they double with it."""
BLOCK = 4096
"""Points whose lines are computed at once."""


def transfer(job: Job, frequency: Floats) -> Floats:
    """Of one axis of a square microlens, frequencies per pixel: what its aperture's overlap with itself leaves."""
    width, _, bend = job.blur
    overlap = np.maximum(1 - width * np.abs(frequency), 0.0)
    turns = bend * job.design.d_2 * job.design.d / job.design.q * frequency * overlap
    return np.asarray(overlap * np.sinc(turns))


# --- neighbours alike -------------------------------------------------------------------------------------------------


def alike_centres(job: Job) -> tuple[Floats, Floats]:
    """Centres of the patch's columns and rows, from the image's centre [px]."""
    middle = job.discs[0][0]
    return job.centres[0] - middle[0], job.centres[1] - middle[1]


def _on_patch(job: Job, order: Floats, spectrum: Floats) -> Floats:
    """Pixels from coefficients of the harmonics, those of both signs added."""
    _, pitch, _ = job.blur
    axis = transfer(job, order / pitch) * np.sinc(order / pitch)
    both = np.where(order > 0, 2.0, 1.0)
    x, y = (np.cos(2 * math.pi / pitch * np.outer(at, order)) * both for at in alike_centres(job))
    return np.asarray((y @ (spectrum * axis * axis[:, None]) @ x.T).ravel())


def harmonic_series(job: Job, percent: int = 100, seed: int = 0) -> Floats:
    """Harmonics by closed form; 100 % are all there are."""
    from scipy.special import j1

    _, pitch, _ = job.blur
    order = np.arange(math.ceil(job.harmonics * percent / 100) + 1.0)
    height = np.hypot(order, order[:, None]) / pitch
    safe = np.where(height > 0, height, 1.0)
    spectrum = np.where(height > 0, job.radius * j1(2 * math.pi * job.radius * safe) / safe, math.pi * job.radius**2)
    return _on_patch(job, order, spectrum / pitch**2)


def _alike_fft(job: Job, level: int, seed: int) -> Floats:
    """Exact coverage of the squares of one period, transformed; what lies above their frequencies folds."""
    _, pitch, _ = job.blur
    reach, count = _reach(job), _squares(job, level)
    middle, side = (reach + 0.5) * pitch, (2 * reach + 1) * count
    wide = covered_pixels(np.array([[middle, middle]]), np.array([job.radius]), side, side, pitch / count)
    cell = wide.reshape(2 * reach + 1, count, 2 * reach + 1, count).sum((0, 2))
    order = np.arange(job.harmonics + 1.0)
    # Samples lie at (k + 1/2) step from the period's corner, the image's centre in its middle; squares blur by a sinc.
    turn = np.exp(1j * math.pi * order * (1 - 1 / count)) / np.sinc(order / count)
    spectrum = np.fft.rfft2(cell)[: order.size, : order.size] / count**2
    return _on_patch(job, order, (spectrum * turn * turn[:, None]).real)


def _squares(job: Job, level: int) -> int:
    """Along a period, so that a level's error is the same on every job, about 1/(8 level^2), whatever its waves.

    Of a rim along the squares' side these know the light, not where in them it lies: off by the square of their side
    over 8, it moves a pixel by that times the slope of its blur. That slope is 1/w where pixels are wider than the
    blur, else 1/w^2; every image that overlaps adds its own. All harmonics are had in any case.
    """
    width, pitch, _ = job.blur
    step = math.sqrt(width * max(width, 1.0) / max(1.0, 2 * job.radius / pitch)) / level
    return max(2 * job.harmonics + 1, math.ceil(pitch / step))


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
    # Points of the pupil: Gauss along the radius, even in angle.
    rings = 3 + 2 * level + math.ceil(2 * job.radius / width)
    at, share = gauss(rings)
    angle = 2 * math.pi * (np.arange(4 * rings) + 0.5) / (4 * rings)
    points = job.radius * np.stack([np.outer(at, np.cos(angle)).ravel(), np.outer(at, np.sin(angle)).ravel()])
    shares = np.repeat(2 * at * share / (4 * rings), 4 * rings)
    nodes, weights = gauss(2 + level + math.ceil(1.5 / width))
    along = [
        profile(job, place[:, None] + nodes - 0.5 - point[:, None, None], 2**level) @ weights
        for place, point in zip(alike_centres(job), points, strict=True)
    ]
    return np.asarray(np.einsum("q,qy,qx->yx", shares * math.pi * job.radius**2, along[1], along[0]).ravel())


def rays_alike(job: Job, level: int = 0, seed: int = 0) -> Floats:
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


def _reach(job: Job) -> int:
    """Neighbours on each side whose light falls into an image's own period."""
    _, pitch, _ = job.blur
    return math.ceil((job.radius - pitch / 2) / pitch - 1e-9)


def _series_work(job: Job, percent: int) -> float:
    count = job.harmonics * percent / 100 + 1
    return count * count + 0.02 * count * job.pixels


def _alike_fft_work(job: Job, level: int) -> float:
    count = _squares(job, level)
    return (2 * _reach(job) + 1) ** 2 * count * count + 0.02 * count * job.pixels


def _huygens_work(job: Job, level: int) -> float:
    width, pitch, _ = job.blur
    rings = 3 + 2 * level + 2 * job.radius / width
    places = job.box[1] * (2 + level + 1.5 / width)
    nodes = 1.7 * (2 * job.radius + 2**level * pitch) / width + 12
    return float(4 * rings**2 * places * (2 * 2**level + 1) * nodes)


# --- one microlens behind a cut pupil ---------------------------------------------------------------------------------


def lines(job: Job, at: Floats, places: Floats, integral: bool = False) -> Floats:
    """k(at - places) over pixels at `at`, shape (at, places); its integral over `at` where asked for."""
    farthest = max(abs(float(at.max() - places.min())), abs(float(at.min() - places.max())))
    limit = 1 / job.blur[0]
    bend = abs(job.blur[2]) * job.design.d_2 * job.design.d / job.design.q * limit
    # pi nodes for each cycle of cos, the pixel's sinc and the defocus's; sixteen more for machine precision.
    nodes, share = gauss(math.ceil(math.pi * (farthest * limit + 0.5 * limit + bend)) + 16)
    nu = limit * nodes
    weights = 2 * limit * share * transfer(job, nu) * np.sinc(nu)
    a, b = 2 * math.pi * np.outer(at, nu), 2 * math.pi * np.outer(nu, places)
    if integral:
        # The integral of the cosine, nu never being 0.
        weights = weights / (2 * math.pi * nu)
        return np.asarray((np.sin(a) * weights) @ np.cos(b) - (np.cos(a) * weights) @ np.sin(b))
    return np.asarray((np.cos(a) * weights) @ np.cos(b) + (np.sin(a) * weights) @ np.sin(b))


def pupil_nodes(centres: Floats, radii: Floats, nodes: int) -> tuple[Floats, Floats]:
    """Points of a common part, shape (N, 2), and weights that add up to its area to the last digits.

    Slices between the places where curves change, Gauss's rule along and across. However thin the shape, its area comes
    from the closed form that keeps all digits: what cancels in the slices' lengths is common to their weights.
    """
    edges = breaks(centres, radii, centres[:1] - radii[0], centres[:1] + radii[0])[0]
    wide = edges[1:] > edges[:-1]
    start, half = edges[:-1][wide], 0.5 * np.diff(edges)[wide]
    u, w, ramp, slope = panel_rule(nodes)
    x = (start[:, None] + half[:, None] * ramp).ravel()
    bottom, top = chords(centres, radii, x)
    length = np.maximum(top - bottom, 0.0)
    y = bottom[:, None] + length[:, None] * u
    points = np.stack([np.broadcast_to(x[:, None], y.shape).ravel(), y.ravel()], -1)
    weights = (((half[:, None] * slope).ravel() * length)[:, None] * w).ravel()
    total, shape = float(weights.sum()), intersect(centres, radii)
    if total > 0:
        return points, weights * (float(shape.area) / total)
    # Thinner than the numbers between its ends: a point with all the light.
    return np.asarray(shape.centroid)[None], np.array([float(shape.area)])


def outline_nodes(centres: Floats, radii: Floats, nodes: int) -> tuple[Floats, Floats]:
    """Points along the outline of a common part, shape (N, 2), and weights of dy; quarter turns or less at a time."""
    u, w = gauss(nodes)
    points, steps = [np.empty((0, 2))], [np.empty(0)]
    for arc in _boundary_arcs(centres, radii):
        pieces = math.ceil((arc.end - arc.start) / (0.5 * math.pi))
        turn = (arc.end - arc.start) / pieces
        angle = (arc.start + turn * (np.arange(pieces)[:, None] + u)).ravel()
        r = radii[arc.disc]
        points.append(centres[arc.disc] + r * np.stack([np.cos(angle), np.sin(angle)], -1))
        steps.append(r * np.cos(angle) * turn * np.tile(w, pieces))
    return np.concatenate(points), np.concatenate(steps)


def _enough(job: Job, nodes: int) -> int:
    """Nodes a panel, beyond those that follow k along half the pupil's width."""
    return nodes + math.ceil(3 * job.radius / job.blur[0])


def _spread(job: Job, points: Floats, weights: Floats) -> Floats:
    """Light of pupil points on the patch's pixels, row by row."""
    x, y = job.centres
    image = np.zeros((y.size, x.size))
    for first in range(0, len(points), BLOCK):
        part = slice(first, first + BLOCK)
        image += (lines(job, y, points[part, 1]) * weights[part]) @ lines(job, x, points[part, 0]).T
    return image.ravel()


def _cut_panels(job: Job, nodes: int, seed: int) -> Floats:
    return _spread(job, *pupil_nodes(*job.discs, _enough(job, nodes)))


def _arcs(job: Job, nodes: int, seed: int) -> Floats:
    """Green's theorem along the outline: no slices, no square roots; every arc in pieces of a quarter turn or less."""
    at, dy = outline_nodes(*job.discs, _enough(job, nodes))
    if not len(at):
        return np.zeros(job.pixels)
    x, y = job.centres
    # d/da of the line's integral over at is -k: the sign is that of the outline's turn.
    return np.asarray(((lines(job, y, at[:, 1]) * dy) @ -lines(job, x, at[:, 0], integral=True).T).ravel())


def _cut_points(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """Points in the square around the pupil's image, those past all rims."""
    centres, radii = job.discs
    at = centres[0] + radii[0] * (2 * random_points(kind, count, seed) - 1)
    kept = at[inside(centres, radii, *at.T)]
    return _spread(job, kept, np.full(len(kept), 4 * radii[0] ** 2 / count)) if len(kept) else np.zeros(job.pixels)


def _cut_fft(job: Job, level: int, seed: int) -> Floats:
    """Exact coverage of n x n subpixels, multiplied by the transfer; a wider frame keeps the far side's tails out."""
    centres, radii = job.discs
    corner, width = job.box
    halo = HALO * level
    count = (width + 2 * halo) * level
    cover = covered_pixels(centres - corner + halo, radii, count, count, 1 / level)
    # Subpixels have blurred already, and a pixel is the mean over level of them; its centre lies between two subpixels'
    # where there is an even number of them.
    lag = 0.0 if level % 2 else 1 / level
    factor = [
        transfer(job, np.asarray(v, np.float64))
        * np.where(np.abs(v) > 0, np.sinc(v) / np.sinc(v / level), 1.0)
        * np.exp(-1j * math.pi * v * lag)
        for v in (np.fft.rfftfreq(count, 1 / level), np.fft.fftfreq(count, 1 / level))
    ]
    wave = np.fft.irfft2(np.fft.rfft2(cover) * factor[0] * factor[1][:, None], s=cover.shape)
    first = halo * level + level // 2
    rows = slice(first, first + width * level, level)
    return np.asarray(wave[rows, rows].ravel())


def _nodes(job: Job) -> float:
    """Frequencies times columns and rows: what a point of the pupil costs."""
    return float(2 * job.box[1] * (math.pi * (2 * job.radius + 2) / job.blur[0] + 16))


METHODS = (
    Method(
        "harmonic series", ALIKE, "series", (25, 50, 75, 100), harmonic_series, _series_work, "n % of the harmonics",
    ),
    Method(
        "FFT", ALIKE, "fft", (1, 2, 4, 8, 16, 32), _alike_fft, _alike_fft_work,
        "n exact samples along a blur width, or a pixel where wider", lambda job: _reach(job) <= FARTHEST,
    ),
    Method(
        "direct Huygens", ALIKE, "huygens", (0, 1, 2), _huygens, _huygens_work, "2^n neighbours a side",
        lambda job: job.harmonics <= MOST_HUYGENS,
    ),
    Method("rays alone", ALIKE, "first order", (0,), rays_alike, lambda job, n: float(job.pixels), "no diffraction"),
    Method(
        "arc integrals", CUT, "panels", (1, 2, 3, 4, 6, 8, 12, 16, 24), _arcs,
        lambda job, n: _nodes(job) * _enough(job, n),
        "Green's theorem along the rims, n nodes a quarter turn, and more",
    ),
    Method(
        "Gauss panels", CUT, "panels", (1, 2, 3, 4, 6, 8, 12, 16), _cut_panels,
        lambda job, n: _nodes(job) * _enough(job, n) ** 2,
        "slices of the pupil, n more nodes a panel, along and across",
    ),
    Method(
        "FFT", CUT, "fft", (1, 2, 4, 8), _cut_fft,
        lambda job, n: float(((job.box[1] + 2 * HALO * n) * n) ** 2), "n x n exact subpixels a pixel",
    ),
    Method(
        "Monte Carlo", CUT, "random", tuple(4**k for k in range(2, 9)), partial(_cut_points, "random"),
        lambda job, n: _nodes(job) * n, "n random points of the pupil",
    ),
    Method(
        "scrambled Sobol", CUT, "sobol", tuple(4**k for k in range(2, 9)), partial(_cut_points, "sobol"),
        lambda job, n: _nodes(job) * n, "n evenly spread points of the pupil",
    ),
    Method("rays alone", CUT, "first order", (0,), pixel_image, lambda job, n: float(job.pixels), "no diffraction"),
)  # fmt: skip
"""Methods with diffraction."""
