"""The lattice of microlens images on the sensor: found in the spectrum of a white image, fitted to measured centres."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .frames import Array, CalibrationError

Layout = Literal["square", "hexagonal"]
_PERIODS = (4.2, 110.0)
"""Shortest and longest lattice period searched [px]; rows of a hexagonal array stand closer than its lenses."""
_NEAR, _BESIDE = (0.8, 1.25), 0.55
"""Frequencies taken for those of an expected pitch, against its own, and the least amplitude of other peaks beside
theirs: what dirt and missing lenses make has less, and a lattice of which only a harmonic was expected has more."""
_ABOUT, _STANDS_OUT = 0.1, 5.0
"""Share of the pitch by which a lattice in a scene, and parts of it, may be off what is expected; and what its
amplitude has to be against those of other frequencies there."""
_CROP = 1024
_BLOCK, _BLOCKS = 16, 7
"""Side of the blocks [px] whose contrast is measured, and how many are averaged along an axis: the longest period."""
_LIT = 0.25
"""Squared contrast of a lit part of the image against the strongest."""
_SIGNIFICANT = 0.1
"""Amplitude of a lattice peak against the strongest: touching images leave 0.77 of a hexagonal array's first order."""
_BINS = 24
_CLIP, _ROUNDS = 5.0, 6
"""Largest residual that a lattice is fitted to, in robust standard deviations per axis; most rounds of clipping."""


@dataclass(frozen=True)
class _LatticeBend:
    """How far nodes lie from a regular lattice: a polynomial of second order and up, 0 with its slopes at `middle`.

    Distortion by a relay or by the main lens's pupil, tilts, and decentres of either are of second and third order.
    """

    middle: tuple[float, float]
    """Indices (i, j) about which it is expanded."""
    reach: tuple[float, float]
    """Indices from there that count as 1, along each."""
    terms: tuple[tuple[float, float], ...]
    """Displacement (x, y) [px] of each column of `bend_columns`, of as many orders as there are."""

    def at(self, indices: Array) -> Array:
        """Displacement [px] of nodes of `indices`, both of shape (..., 2)."""
        order = math.isqrt(8 * len(self.terms) + 25) // 2 - 1
        return np.asarray(bend_columns((indices - self.middle) / self.reach, order) @ np.array(self.terms))


def bend_columns(places: Array, order: int = 3) -> Array:
    """Monomials of places (..., 2) of second order and up to another, shape (..., terms); of third order 7."""
    x, y = np.moveaxis(np.polynomial.polynomial.polyvander(places, order), -2, 0)
    return np.stack([x[..., n - k] * y[..., k] for n in range(2, order + 1) for k in range(n + 1)], axis=-1)


@dataclass(frozen=True)
class CentreLattice:
    """Centres of the microlens images, in pixels; the centre of the sensor's first pixel is (0, 0), x right, y down.

    The node (i, j) is at ``origin + i first + j second``, and as far off as `bend` says. `second` stands about 90
    degrees (square) or 60 degrees (hexagonal) from `first`, towards +y. Nothing forces equal lengths or the exact
    angle: an anamorphic relay or a sheared array is a lattice too.
    """

    origin: tuple[float, float]
    first: tuple[float, float]
    second: tuple[float, float]
    layout: Layout
    bend: _LatticeBend | None = None

    def at(self, origin: Array) -> CentreLattice:
        """Lattice with its node (0, 0) moved to `origin` [px]."""
        return replace(self, origin=(float(origin[0]), float(origin[1])))

    @property
    def basis(self) -> Array:
        """`first` and `second` as the columns of a 2 x 2 matrix [px]."""
        return np.array([self.first, self.second]).T

    @property
    def pitches(self) -> tuple[float, float]:
        """Lengths of `first` and `second` [px]."""
        return math.hypot(*self.first), math.hypot(*self.second)

    @property
    def pitch(self) -> float:
        """Pitch of the regular lattice with the same cell area [px]."""
        area = abs(float(np.linalg.det(self.basis)))
        return math.sqrt(area if self.layout == "square" else area * 2 / math.sqrt(3))

    @property
    def rotation(self) -> float:
        """Angle from the sensor's +x to `first`, towards +y [rad]."""
        return math.atan2(self.first[1], self.first[0])

    def nodes(self, i: ArrayLike, j: ArrayLike) -> Array:
        """Positions of the nodes (i, j) [px], shape (..., 2); indices may be fractional."""
        i, j = np.broadcast_arrays(np.asarray(i, float), np.asarray(j, float))
        steps = i[..., None] * np.asarray(self.first) + j[..., None] * np.asarray(self.second)
        bend = 0.0 if self.bend is None else self.bend.at(np.stack([i, j], axis=-1))
        return np.asarray(np.asarray(self.origin) + steps + bend)

    def indices(self, xy: ArrayLike) -> Array:
        """Fractional indices (i, j) of positions `xy` [px], shape (..., 2); the inverse of `nodes`."""
        away, back = np.asarray(xy, float) - np.asarray(self.origin), np.linalg.inv(self.basis).T
        index = away @ back
        for _ in range(0 if self.bend is None else 8):  # each a few hundred times nearer than the one before
            index = (away - self.bend.at(index)) @ back  # type: ignore[union-attr]
        return np.asarray(index)

    def cell(self) -> tuple[Array, Array]:
        """Normals (n, 2) to the sides of a node's Voronoi cell and the half widths (n,) along them [px].

        Opposite sides share a row: two rows for a square cell, three for a hexagonal one.
        """
        a, b = np.asarray(self.first), np.asarray(self.second)
        across = np.array([a, b] if self.layout == "square" else [a, b, b - a])
        length = np.hypot(across[:, 0], across[:, 1])
        return across / length[:, None], length / 2

    def inside(self, shape: tuple[int, int], margin: float = 0.0) -> NDArray[np.int64]:
        """Indices (n, 2) of the nodes at least `margin` pixels inside an image of `shape` (rows, columns)."""
        size = np.array(shape[::-1])
        corners = self.indices(size * np.array([[0, 0], [1, 0], [0, 1], [1, 1]]))
        low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
        i, j = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1), indexing="xy")
        xy = self.nodes(i, j)
        kept = ((xy >= margin - 0.5) & (xy <= size - 0.5 - margin)).all(axis=-1)
        return np.stack([i[kept], j[kept]], axis=-1).astype(np.int64)


class LatticeFit(NamedTuple):
    """A lattice, what it left over, and how well it is known."""

    lattice: CentreLattice
    residuals: Array
    """Measured minus fitted centre of every lens given [px], shape (n, 2)."""
    inliers: NDArray[np.bool_]
    covariance: Array
    """Covariance of (origin, first, second) along one axis [px^2], shape (3, 3); the same for x and y."""
    bend_error: Array
    """Standard deviation of the lattice's bend at every lens, along one axis [px], shape (n,); 0 without."""

    @property
    def rms(self) -> float:
        """RMS length per axis of the inliers' residuals [px]."""
        return float(np.sqrt(np.mean(self.residuals[self.inliers] ** 2)))


def fit_lattice(
    indices: ArrayLike, centres: ArrayLike, layout: Layout, order: int = 1, *, clipped: bool = True
) -> LatticeFit:
    """Least-squares lattice through centres [px] of the lattice indices (i, j), both of shape (n, 2).

    Outliers are clipped at 5 robust standard deviations an axis, unless centres are exact and none is to be `clipped`.
    Beyond the first `order` the lattice's `bend` is fitted as well.

    Raises
    ------
    CalibrationError
        With fewer than four lenses, or lenses in one line only.
    """
    ij, xy = np.asarray(indices, float), np.asarray(centres, float)
    used = np.ones(len(ij), bool)
    middle = ij.mean(axis=0) if len(ij) else np.zeros(2)
    reach = np.abs(ij - middle).max(axis=0, initial=1.0)
    design = np.column_stack([np.ones(len(ij)), ij - middle])
    if order > 1:
        design = np.column_stack([design, bend_columns((ij - middle) / reach, order)])
    for _ in range(_ROUNDS):
        if used.sum() <= design.shape[1] or np.linalg.matrix_rank(design[used]) < design.shape[1]:
            raise CalibrationError(
                f"a lattice needs at least four microlenses, not all in one line; got {int(used.sum())}"
            )
        solution = np.linalg.lstsq(design[used], xy[used], rcond=None)[0]
        residuals = xy - design @ solution
        distance = np.hypot(residuals[:, 0], residuals[:, 1])
        spread = float(np.median(distance[used])) / 1.1774  # the median length of a 2D normal vector is 1.1774 sigma
        inliers = distance <= max(_CLIP * spread, 1e-9)
        if not clipped or np.array_equal(inliers, used):
            break
        used = inliers
    variance = float(np.sum(residuals[used] ** 2)) / max(2 * (int(used.sum()) - design.shape[1]), 1)
    inverse = np.linalg.inv(design[used].T @ design[used]) * variance
    shift = np.array([[1.0, -middle[0], -middle[1]], [0, 1, 0], [0, 0, 1]])
    origin, first, second = ((float(x), float(y)) for x, y in shift @ solution[:3])
    bend = None
    if order > 1:
        terms = tuple((float(x), float(y)) for x, y in solution[3:])
        bend = _LatticeBend((float(middle[0]), float(middle[1])), (float(reach[0]), float(reach[1])), terms)
    lattice = CentreLattice(origin, first, second, layout, bend)
    error = np.sqrt(np.einsum("nk,kl,nl->n", design[:, 3:], inverse[3:, 3:], design[:, 3:]))
    return LatticeFit(lattice, residuals, used, shift @ inverse[:3, :3] @ shift.T, error)


def estimate_lattice(
    image: NDArray[np.floating], layout: Layout | None = None, pitch: float | None = None
) -> CentreLattice:
    """Find pitch, rotation, layout and phase of the lattice in the lit part of a white image to a fraction of a pixel.

    The shortest significant peaks of the power spectrum span the reciprocal lattice; its inverse, reduced to the
    shortest vectors, is the lattice; folding the image into one cell finds where the bright images sit in it. (0, 0) is
    the node nearest to the light's middle. Where no `layout` is expected, the angle between the two shortest vectors
    decides. Where peaks of an expected `pitch` [px] are seen, weak ones of longer periods are not believed.

    Raises
    ------
    CalibrationError
        If no lattice with a period from 4.2 to 110 px is seen, or not the one expected.
    """
    crop, corner = lit_part(image)
    frequency = None
    if pitch is not None:
        frequency = 1 / pitch if layout == "square" else 2 / math.sqrt(3) / pitch
    basis = _direct_basis(_spectral_peaks(crop, frequency))
    shown = _layout_of(basis)
    if layout is not None and shown != layout:
        raise CalibrationError(f"the white image shows a {shown} lattice, not a {layout} one")
    (a, c), (b, d) = _oriented(basis, shown).tolist()
    lattice = CentreLattice((0.0, 0.0), (a, b), (c, d), shown)
    lattice = lattice.at(lattice.nodes(*_phase(crop, lattice)) + corner)
    middle = lattice.indices(corner + (np.array(crop.shape[::-1]) - 1) / 2)
    return lattice.at(lattice.nodes(*np.round(middle)))


def lattice_of_phases(image: NDArray[np.floating], layout: Layout, pitch: float) -> tuple[CentreLattice, float]:
    """The lattice of an expected layout and pitch [px] on which an image is periodic, and how far parts of it disagree.

    Of all frequencies near the expected ones those are taken in which the whole image has most, and the phases there
    say where the nodes are. Brightness that varies between cells does not move them, as it is in step with nothing.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Of mean 0, slow changes divided off.
    layout, pitch
        As expected; 10 % off at most.

    Returns
    -------
    CentreLattice, float
        (0, 0) is the node nearest to the image's middle; and the distance from their nodes of what sixteen parts of the
        image show by themselves [px rms].

    Raises
    ------
    CalibrationError
        Nothing there stands out.
    """
    rows, columns = image.shape
    window = [np.cos(np.linspace(-math.pi / 2, math.pi / 2, n)).astype(np.float32) ** 2 for n in (rows, columns)]
    shown = np.asarray(image * window[0][:, None] * window[1], np.float32)
    spectrum = np.abs(np.fft.fft2(shown)).astype(np.float32)
    turn = math.pi / 2 if layout == "square" else math.pi / 3
    expected = (1.0 if layout == "square" else 2 / math.sqrt(3)) / pitch
    fx, fy = np.fft.fftfreq(columns)[None, :], np.fft.fftfreq(rows)[:, None]
    row, column = np.nonzero((np.abs(np.hypot(fx, fy) / expected - 1) <= _ABOUT) & (fx > 0))
    if row.size == 0:
        raise CalibrationError(f"the raw image is too small for a lattice of {pitch:.4g} px pitch")
    tried = np.stack([fx[0, column], fy[row, 0]], axis=-1)
    # All first orders of a regular lattice together.
    turns: Array = turn * np.arange(2.0 if layout == "square" else 3.0)
    together = np.ones(len(tried))
    for orders in _turned(tried, turns):
        x, y = np.rint(orders * (columns, rows)).astype(int).T
        together *= spectrum[y % rows, x % columns]
    if not together.max() > _STANDS_OUT ** len(turns) * float(np.median(together)):
        raise CalibrationError(f"the raw image shows no {layout} lattice of about {pitch:.4g} px pitch")
    orders = _turned(_strongest(shown, tried[together.argmax()], turns), turns)
    frequencies = orders[:2]
    middle = (np.array([columns, rows]) - 1) / 2
    phases = np.angle([_amplitude_at(shown, k) for k in frequencies]) / (2 * math.pi)
    (a, c), (b, d) = _oriented(_direct_basis(frequencies), layout).tolist()
    start = np.linalg.solve(frequencies, -phases)
    lattice = CentreLattice((float(start[0]), float(start[1])), (a, b), (c, d), layout)
    off: list[tuple[float, float, float]] = []
    for part, corner in _parts(image):
        wave = np.array([_amplitude_at(part, k) * np.exp(-2j * math.pi * (k @ corner)) for k in frequencies])
        moved = (np.angle(wave) / (2 * math.pi) - phases + 0.5) % 1.0 - 0.5
        x, y = np.linalg.solve(frequencies, -moved).tolist()
        off.append((float(np.abs(wave).min()), x, y))
    strength, *away = np.array(off).T
    apart = math.sqrt(float(np.average(np.square(away).sum(axis=0), weights=strength)))
    if apart > _ABOUT * pitch or abs(lattice.pitch / pitch - 1) > _ABOUT:
        raise CalibrationError(
            f"the raw image shows no {layout} lattice of about {pitch:.4g} px pitch, but parts that are out of step"
        )
    return lattice.at(lattice.nodes(*np.round(lattice.indices(middle)))), apart


def _amplitude_at(image: NDArray[np.floating], frequency: Array) -> complex:
    """Fourier amplitude of an image at one frequency (x, y) [1/px], whole periods counted from its first pixel."""
    rows, columns = image.shape
    across, down = (np.exp(-2j * math.pi * f * np.arange(n)) for f, n in zip(frequency, (columns, rows), strict=True))
    summed = image @ across.real.astype(np.float32) + 1j * (image @ across.imag.astype(np.float32))
    return complex(summed @ down)


def _turned(frequency: Array, angles: Array) -> Array:
    """Frequencies (..., 2) turned by angles (n,) about 0, shape (n, ..., 2)."""
    c, s = np.cos(angles), np.sin(angles)
    return np.asarray(np.einsum("nij,...j->n...i", np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0), frequency))


def _strongest(image: NDArray[np.floating], frequency: Array, turns: Array) -> Array:
    """The frequency near one of the spectrum's which, with those turned from it, an image has most of."""

    def amplitude(k: Array) -> float:
        return sum(abs(_amplitude_at(image, order)) for order in _turned(k, turns))

    step = 0.5 / max(image.shape)
    for _ in range(4):
        for move in step * np.eye(2):
            before, at, after = (amplitude(frequency + n * move) for n in (-1, 0, 1))
            bend = before - 2 * at + after
            shift = 0.5 * (before - after) / bend if bend < 0 else float(np.sign(after - before))
            frequency = frequency + min(max(shift, -2.0), 2.0) * move
        step /= 2
    return frequency


def _parts(image: NDArray[np.floating]) -> Iterator[tuple[NDArray[np.floating], Array]]:
    """Sixteen parts of an image and their first pixels (x, y)."""
    cuts = [[n * k // 4 for k in range(5)] for n in image.shape]
    for top, bottom in pairwise(cuts[0]):
        for left, right in pairwise(cuts[1]):
            yield image[top:bottom, left:right], np.array([left, top], float)


def lit_part(image: NDArray[np.floating]) -> tuple[Array, Array]:
    """The part of an image that holds microlens images, at most 1024 px a side, and where its first pixel is (x, y).

    It is told by contrast, which neither a pedestal nor a glow has, and reaches as far about its mean as a rectangle of
    the same second moments: 0.87 of the radius of a round field.
    """
    from scipy.ndimage import uniform_filter

    held = np.square(np.diff(image[::4], axis=1))
    held = np.minimum(held, np.quantile(held.ravel()[:: 1 + held.size // 500_000], 0.999))  # hot pixels
    for axis, block in enumerate((_BLOCK // 4, _BLOCK)):
        starts = np.arange(0, held.shape[axis], block)
        sizes = np.diff(starts, append=held.shape[axis])
        held = np.add.reduceat(held, starts, axis) / (sizes[:, None] if axis == 0 else sizes)
    held = uniform_filter(held, _BLOCKS, mode="nearest")
    lit = held >= _LIT * held.max()
    ends = []
    for axis, length in enumerate(image.shape):
        edges = np.minimum(_BLOCK * np.arange(lit.shape[axis] + 1), length)
        weight = lit.sum(axis=1 - axis) * np.diff(edges)
        middle = float(np.average((edges[1:] + edges[:-1]) / 2, weights=weight))
        power = ((edges[1:] - middle) ** 3 - (edges[:-1] - middle) ** 3) / 3 / np.diff(edges)
        half = min(math.sqrt(3 * float(np.average(power, weights=weight))), _CROP / 2)
        ends.append((max(0, round(middle - half)), min(length, round(middle + half))))
    (top, bottom), (left, right) = ends
    return np.asarray(image[top:bottom, left:right], float), np.array([left, top], float)


def amplitude_spectrum(crop: Array) -> Array:
    """Amplitude of each frequency of a part of an image, as `np.fft.fft2` orders them; slow changes taken off."""
    rows, columns = crop.shape
    y, x = np.linspace(-1, 1, rows), np.linspace(-1, 1, columns)
    # A quadratic surface off: vignetting would leak into the lowest frequencies.
    along_x, along_y = (np.linalg.qr(np.polynomial.legendre.legvander(axis, 2))[0] for axis in (x, y))
    flat = crop - along_y @ (along_y.T @ crop @ along_x) @ along_x.T
    window = np.cos(x * (math.pi / 2)) ** 2 * np.cos(y * (math.pi / 2))[:, None] ** 2
    return np.asarray(np.abs(np.fft.fft2(flat * window)))


def _spectral_peaks(crop: Array, expected: float | None) -> Array:
    """Frequencies [1/px] of the two shortest significant, independent peaks, shape (2, 2)."""
    amplitude = amplitude_spectrum(crop)
    rows, columns = amplitude.shape
    radius = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(columns)[None, :])
    amplitude = np.where((radius >= 1 / _PERIODS[1]) & (radius <= 1 / _PERIODS[0]), amplitude, 0.0)
    strongest = float(amplitude.max())
    noise = float(np.median(amplitude[amplitude > 0])) if strongest > 0 else 0.0
    if strongest < 8 * noise or np.ptp(crop) <= 1e-6 * np.abs(crop).max():
        raise CalibrationError("the white image shows no periodic lattice of microlenses with a pitch of 5 to 100 px")
    least = np.full(amplitude.shape, max(_SIGNIFICANT * strongest, 4 * noise))
    levels = [least]
    if expected is not None:
        near = (radius >= _NEAR[0] * expected) & (radius <= _NEAR[1] * expected)
        beside = np.maximum(least, _BESIDE * float(amplitude[near].max(initial=0.0)))
        # Images wider one way than the other leave less of the lattice's order that way.
        levels = [beside, np.where(near, least, beside)]
    for level in levels:
        if (found := _independent_peaks(amplitude, amplitude > level, radius)) is not None:
            return found
    raise CalibrationError("the white image is periodic along one direction only: no lattice of microlenses")


def _independent_peaks(amplitude: Array, peak: NDArray[np.bool_], radius: Array) -> Array | None:
    """Frequencies [1/px] of the two shortest independent peaks, shape (2, 2); None where all lie in one direction."""
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        peak = peak & (amplitude >= np.roll(amplitude, step, axis))
    at = np.argwhere(peak)
    at = at[np.argsort(radius[at[:, 0], at[:, 1]], kind="stable")]
    rows, columns = amplitude.shape
    frequencies = np.array([_refined(amplitude, row, column) for row, column in at]) / (columns, rows)
    first = frequencies[0]
    for second in frequencies[1:]:
        cross = abs(first[0] * second[1] - first[1] * second[0])
        if cross > 0.4 * np.hypot(*first) * np.hypot(*second):
            return np.array([first, second])
    return None


def _refined(amplitude: Array, row: int, column: int) -> Array:
    """Signed frequency in bins (x, y) of a peak, by a parabola through the logarithms along each axis."""
    bins = []
    for line, at in ((amplitude[row], column), (amplitude[:, column], row)):
        before, peak, after = np.log(np.maximum(line[[at - 1, at, (at + 1) % len(line)]], 1e-300))
        curvature = before - 2 * peak + after
        vertex = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
        bins.append((at if at <= len(line) // 2 else at - len(line)) + vertex)
    return np.array(bins)


def _direct_basis(frequencies: Array) -> Array:
    """Shortest lattice vectors (columns) dual to two reciprocal vectors (rows): Gauss's reduction."""
    a, b = np.linalg.inv(frequencies).T
    while True:
        if np.hypot(*b) < np.hypot(*a):
            a, b = b, a
        shear = round(float(a @ b) / float(a @ a))
        if shear == 0:
            return np.array([a, b]).T
        b = b - shear * a


def _layout_of(basis: Array) -> Layout:
    a, b = basis.T
    lengths = np.hypot(*a), np.hypot(*b)
    angle = math.degrees(math.acos(abs(float(a @ b)) / float(lengths[0] * lengths[1])))
    if lengths[1] / lengths[0] < 1.2 and angle > 78:
        return "square"
    if lengths[1] / lengths[0] < 1.2 and angle < 72:
        return "hexagonal"
    raise CalibrationError(
        f"the lattice in the white image is neither square nor hexagonal: vectors of {lengths[0]:.2f} and"
        f" {lengths[1]:.2f} px at {angle:.1f} degrees"
    )


def _oriented(basis: Array, layout: Layout) -> Array:
    """Equivalent basis with `first` nearest to +x and `second` 90 or 60 degrees further, towards +y."""
    a, b = basis.T
    star = [a, b] if layout == "square" else [a, b, a - b if a @ b > 0 else a + b]
    star += [-v for v in star]
    first = max(star, key=lambda v: v[0] / np.hypot(*v))
    turn = math.pi / 2 if layout == "square" else math.pi / 3
    ahead = math.atan2(first[1], first[0]) + turn
    second = max(star, key=lambda v: float(v @ (math.cos(ahead), math.sin(ahead))) / float(np.hypot(*v)))
    return np.array([first, second]).T


def _phase(crop: Array, lattice: CentreLattice) -> Array:
    """Indices (fractional) of the bright spot of the cell, from the crop's middle folded into one cell."""
    from scipy.ndimage import gaussian_filter

    rows, columns = crop.shape
    half = int(min(max(12 * lattice.pitch, 48), rows / 2, columns / 2))
    y0, x0 = rows // 2, columns // 2
    y, x = np.mgrid[y0 - half : y0 + half, x0 - half : x0 + half]
    cell = np.floor(lattice.indices(np.stack([x.ravel(), y.ravel()], axis=-1)) % 1.0 * _BINS).astype(int) % _BINS
    flat = cell @ (1, _BINS)
    count = np.bincount(flat, minlength=_BINS**2)
    light = np.bincount(flat, crop[y, x].ravel(), _BINS**2)
    folded = np.where(count > 0, light / np.maximum(count, 1), light.sum() / count.sum()).reshape(_BINS, _BINS)
    smooth = gaussian_filter(folded, 0.2 * _BINS, mode="wrap")
    j, i = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    nearest = np.round(lattice.indices([x0, y0]) - (i / _BINS, j / _BINS))
    return np.asarray(nearest + np.array([(i + 0.5) / _BINS, (j + 0.5) / _BINS]))
