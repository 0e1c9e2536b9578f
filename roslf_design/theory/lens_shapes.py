"""Shapes of a microlens's clear aperture, as wide as the pitch: what each of them does to light.

One of a further shape is a class that answers these questions, and its name in `LENS_SHAPES`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array as Floats
from .._arrays import sunflower
from ..camera import Number
from ..shapes.discs import gauss_legendre

NODES, PER_CYCLE = 24, 2.5
"""Gauss-Legendre nodes across a circular aperture's overlap, and more for each cycle of a phase across it: to 1e-12."""

CYCLES = (0, 4, 8, 16, 32, 64, 128, 256, 512, 1024)
"""Cycles up to which counts of nodes serve; less than 1e-5 is left beyond."""

MOST_TERMS = 2**18
"""Nodes of overlaps at a time, for memory's sake."""

LENSES = 8
"""Lenses whose series are summed at a time: what a processor's cache holds."""

SERIES_FROM, TERMS, TERMS_PER_CYCLE = 64, 24, 2.0
"""Frequencies of a lens from which a circle's transfer is a Chebyshev series along the radius, its terms, and more for
each cycle of a phase across the aperture: to 1e-12."""

GAUSS = ((-math.sqrt(0.6) / 2, 5 / 18), (0.0, 8 / 18), (math.sqrt(0.6) / 2, 5 / 18))
"""Gauss's three points across a side, with weights."""


class LensShape:
    """Clear aperture of a microlens."""

    round: ClassVar[bool] = False
    """True where it is alike in all directions, for kernels."""
    area: ClassVar[float]
    """Area over the pitch squared."""
    variance: ClassVar[float]
    """Mean square of places across it along one axis, over the pitch squared."""
    diagonal: ClassVar[float]
    """Its width in the direction in which it is widest, over the pitch."""
    dark: ClassVar[float]
    """First zero of its diffraction along an axis [lambda d_2/d]."""
    neighbours: ClassVar[int]
    """Steps of the lattice between microlenses whose light interferes."""

    def breadth(self, turn: float) -> float:
        """Extent along each axis where it is turned by an angle [rad], over the pitch."""
        raise NotImplementedError

    def own_axes(self, x: Floats, y: Floats, turn: float) -> tuple[Floats, Floats]:
        """Frequencies along its own axes where it is turned by an angle [rad]."""
        raise NotImplementedError

    def blur(self, x: Floats, y: Floats) -> Floats:
        """Share that averaging over the aperture leaves of detail of so many periods per pitch."""
        raise NotImplementedError

    def factors(
        self, width: Number, sensor_distance: Number, defocus: Number, wavelength: Number, x: Floats, y: Floats
    ) -> tuple[Floats, ...]:
        """Factors of its transfer at frequencies on the sensor [1/mm]; lengths as those of `MicrolensTransfer`.

        Lengths are numbers, or arrays over lenses, their first axis, that broadcast with the frequencies.
        """
        raise NotImplementedError

    def overlap(self, width: Number, shift: Floats, detail: Floats, axes: tuple[float, float]) -> Floats:
        """Share of detail [1/mm] along `axes` that passes where the aperture and itself, shifted along them, overlap.

        `width` and `shift` are in mm.
        """
        raise NotImplementedError

    def shared(self, width: float, shift: Floats, cycles: Floats) -> Floats:
        """Share passed where two apertures overlap that lie `shift` apart [mm], phases turning by `cycles` [1/mm].

        Both of shape (M, 2); the result (M,).
        """
        raise NotImplementedError

    def places(self, u: Floats, v: Floats, half: float, turn: float) -> tuple[Floats, Floats]:
        """Places on one turned by an angle [rad], `half` its width, as evenly spread as u and v in the unit square."""
        raise NotImplementedError

    def holds(self, x: Floats, y: Floats, width: float) -> Floats | np.bool_:
        """True where a place of a microlens's cell [mm] lies in its aperture."""
        raise NotImplementedError

    def window(self, nodes: Floats, width: float) -> Floats:
        """Share of the cells about a grid's nodes that lies in the aperture, shape (N, N)."""
        raise NotImplementedError

    def rule(self, width: float) -> Floats:
        """Points and weights that average over it, rows (x, y, weight), shape (n, 3)."""
        raise NotImplementedError

    def sample(self, side: int) -> Floats:
        """Points evenly spread over it [pitches], shape (side squared, 2); `side` is odd."""
        raise NotImplementedError


class _Square(LensShape):
    """A square, whose sides lie along the array's axes."""

    area, variance, diagonal, dark, neighbours = 1.0, 1 / 12, math.sqrt(2), 1.0, 3

    def breadth(self, turn: float) -> float:
        """Extent of a square turned by an angle."""
        return abs(math.cos(turn)) + abs(math.sin(turn))

    def own_axes(self, x: Floats, y: Floats, turn: float) -> tuple[Floats, Floats]:
        """Frequencies along its sides."""
        c, s = math.cos(turn), math.sin(turn)
        return (x, y) if s == 0 else (c * x + s * y, c * y - s * x)

    def blur(self, x: Floats, y: Floats) -> Floats:
        """One sinc along each side."""
        return np.asarray(np.sinc(x) * np.sinc(y))

    def factors(
        self, width: Number, sensor_distance: Number, defocus: Number, wavelength: Number, x: Floats, y: Floats
    ) -> tuple[Floats, ...]:
        """One factor along each side."""
        own = width, sensor_distance, defocus, wavelength
        return _line_transfer(*own, x), _line_transfer(*own, y)

    def overlap(self, width: Number, shift: Floats, detail: Floats, axes: tuple[float, float]) -> Floats:
        """One factor along each side, in which the overlap is a stretch."""
        parts = []
        for share in map(abs, axes):
            left = width - share * shift
            parts.append(left / width * np.sinc(left * share * detail))
        return np.asarray(parts[0] * parts[1])

    def shared(self, width: float, shift: Floats, cycles: Floats) -> Floats:
        """One factor along each side."""
        return np.asarray(shared_line(width, shift, cycles).prod(-1))

    def places(self, u: Floats, v: Floats, half: float, turn: float) -> tuple[Floats, Floats]:
        """Places by stretching the unit square."""
        x, y = (2 * u - 1) * half, (2 * v - 1) * half
        c, s = math.cos(turn), math.sin(turn)
        return c * x - s * y, s * x + c * y

    def holds(self, x: Floats, y: Floats, width: float) -> Floats | np.bool_:
        """True everywhere: it fills its cell."""
        return np.True_

    def window(self, nodes: Floats, width: float) -> Floats:
        """Ones."""
        return np.ones((nodes.size, nodes.size))

    def rule(self, width: float) -> Floats:
        """Gauss's three points a side."""
        return np.array([(width * x, width * y, across * down) for y, down in GAUSS for x, across in GAUSS])

    def sample(self, side: int) -> Floats:
        """Points of a square grid."""
        line = np.arange(-(side // 2), side // 2 + 1.0)
        return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2) / side


class _Round(LensShape):
    """A disc."""

    round = True
    area, variance, diagonal, dark, neighbours = math.pi / 4, 1 / 16, 1.0, 1.22, 2

    def breadth(self, turn: float) -> float:
        """One, however it is turned."""
        return 1.0

    def own_axes(self, x: Floats, y: Floats, turn: float) -> tuple[Floats, Floats]:
        """Frequencies as they are."""
        return x, y

    def blur(self, x: Floats, y: Floats) -> Floats:
        """Transform of a disc."""
        from scipy.special import j1

        k = math.pi * np.hypot(x, y)
        safe = np.where(k > 0, k, 1.0)
        return np.asarray(np.where(k > 0, 2 * j1(safe) / safe, 1.0))

    def factors(
        self, width: Number, sensor_distance: Number, defocus: Number, wavelength: Number, x: Floats, y: Floats
    ) -> tuple[Floats, ...]:
        """One factor, along the radius."""
        return (_circle_transfer(width, sensor_distance, defocus, wavelength, np.hypot(x, y)),)

    def overlap(self, width: Number, shift: Floats, detail: Floats, axes: tuple[float, float]) -> Floats:
        """Integral over the common part of two discs, column by column."""
        nodes, weights = gauss_legendre(24)
        half = (width - shift)[..., None] / 2
        angle = (nodes + 1) * (math.pi / 4)
        x = half * np.sin(angle)
        chord = np.sqrt(np.maximum((half - x) * (half + x + shift[..., None]), 0.0))
        light = chord * half * np.cos(angle) * np.cos(2 * math.pi * detail[..., None] * x)
        return np.asarray((light * weights).sum(-1) * math.pi / (math.pi / 4 * np.square(width)))

    def shared(self, width: float, shift: Floats, cycles: Floats) -> Floats:
        """Integral over the common part of two discs."""
        shift, cycles = shift / width, cycles * width
        offset, total = np.hypot(*shift.T), np.zeros(len(shift))
        near = offset < 1
        offset, cycles = offset[near], cycles[near]
        unit = np.where(offset > 0, shift[near].T / np.where(offset > 0, offset, 1.0), [[1.0], [0.0]])
        aside = np.stack([-unit[1], unit[0]])
        total[near] = _circle_overlap(offset, *((cycles.T * axis).sum(0) for axis in (unit, aside)))
        return total

    def places(self, u: Floats, v: Floats, half: float, turn: float) -> tuple[Floats, Floats]:
        """Places by equal areas along the radius."""
        radius, angle = half * np.sqrt(u), 2 * np.pi * v
        return radius * np.cos(angle), radius * np.sin(angle)

    def holds(self, x: Floats, y: Floats, width: float) -> Floats | np.bool_:
        """True within half a pitch."""
        return np.asarray(np.hypot(x, y) <= width / 2)

    def window(self, nodes: Floats, width: float) -> Floats:
        """Rows of the disc, as fractions."""
        # Columns of the disc, each with its own chord, keep the quadrature smooth: here as fractional rows.
        step = width / nodes.size
        return np.asarray(np.clip((width / 2 - np.hypot(nodes[:, None], nodes)) / step + 0.5, 0, 1))

    def rule(self, width: float) -> Floats:
        """Rule of fifth order: six points about the middle."""
        ring = math.sqrt(2 / 3) * width / 2 * np.exp(1j * np.pi / 3 * np.arange(6))
        return np.vstack([[0.0, 0.0, 0.25], np.column_stack([ring.real, ring.imag, np.full(6, 0.125)])])

    def sample(self, side: int) -> Floats:
        """Points of Vogel's spiral."""
        return np.asarray(0.5 * sunflower(side**2, 0.5).T)


LENS_SHAPES: Mapping[str, LensShape] = MappingProxyType({"square": _Square(), "circular": _Round()})
"""Shapes by their names in a design file."""


def shared_line(width: Number, shift: Floats, cycles: Floats) -> Floats:
    """`LensShape.shared` of squares along one of their sides; all broadcast."""
    overlap = np.maximum(width - np.abs(shift), 0.0)
    return np.asarray(overlap / width * np.sinc(cycles * overlap))


def _circle_transfer(width: Number, distance: Number, defocus: Number, wavelength: Number, frequency: Floats) -> Floats:
    """Transfer of round microlenses, defocused, at frequencies [1/mm]; parameters as of `LensShape.factors`."""
    moved, turned = (
        np.reshape(np.asarray(part, float), (-1, 1))
        for part in (wavelength * distance / width, defocus * distance * width)
    )
    rows = frequency.reshape(len(moved), -1)
    if rows.shape[1] < SERIES_FROM:
        return _circle_overlap(moved * rows, turned * rows).reshape(frequency.shape)
    speed = np.maximum(moved, np.abs(turned) / CYCLES[-1])
    last = np.minimum(rows.max(1, keepdims=True), 1 / np.where(speed > 0, speed, 1e-300))
    last = np.where(last > 0, last, 1.0)
    count = TERMS + math.ceil(TERMS_PER_CYCLE * float((np.abs(turned) * last).max()))
    angle = (np.arange(count) + 0.5) * (math.pi / count)
    nodes = last * np.cos(angle / 2) ** 2
    # Smooth up to where nothing overlaps: the lens that is left there is (1 - offset)^(3/2) wide and high.
    smooth = _circle_overlap(moved * nodes, turned * nodes) / (1 - moved * nodes) ** 1.5
    terms = np.cos(np.arange(count)[:, None] * angle) @ smooth.T * (2 / count)
    terms[0] /= 2
    values, passing = np.zeros(rows.shape), np.flatnonzero((rows <= last).any(0))
    for at in range(0, len(rows), LENSES):
        some = slice(at, at + LENSES)
        near = rows[some, passing]
        place, left = 2 * np.minimum(near / last[some], 1.0) - 1, np.maximum(1 - moved[some] * near, 0.0)
        series = np.polynomial.chebyshev.chebval(place, terms[:, some, None], tensor=False)
        values[some, passing] = np.where(near <= last[some], series * (left * np.sqrt(left)), 0.0)
    return values.reshape(frequency.shape)


def _line_transfer(
    width: Number, sensor_distance: Number, defocus: Number, wavelength: Number, frequency: Floats
) -> Floats:
    """Transfer of a square microlens along one of its axes, all broadcast.

    The overlap ``d - a`` of the aperture with itself shifted by ``a = lambda d_2 nu``, and the defocus across it.
    Parameters are those of `MicrolensTransfer`.
    """
    overlap = np.maximum(width - wavelength * sensor_distance * np.abs(frequency), 0.0)
    return np.asarray(overlap / width * np.sinc(defocus * sensor_distance * frequency * overlap))


def _circle_overlap(offset: Floats, along: Floats, across: ArrayLike = 0.0) -> Floats:
    """Overlap of two circles 1 wide and `offset` apart, a share of one, with phases that turn across it.

    Parameters
    ----------
    offset : ndarray
        From 0; nothing overlaps from 1 on.
    along, across : array_like
        Turns that a phase takes over the unit length, along the offset and across it; of the same shape, or numbers.
    """
    offset, along, across = (np.asarray(part, float) for part in np.broadcast_arrays(offset, along, across))
    turns = np.maximum(np.abs(along), np.abs(across))
    total = np.zeros(offset.shape)
    near = np.flatnonzero((offset < 1.0) & (turns <= CYCLES[-1]))
    # Fast ones apart from slow ones, which need fewer nodes.
    near = near[np.argsort(turns.flat[near], kind="stable")]
    start = 0
    while start < near.size:
        most = next(cycles for cycles in CYCLES if cycles >= turns.flat[near[start]])
        nodes, end = NODES + math.ceil(PER_CYCLE * most), int(np.count_nonzero(turns.flat[near] <= most))
        part = near[start : min(end, start + MOST_TERMS // nodes)]
        total.flat[part] = _overlap(offset.flat[part], along.flat[part], across.flat[part], nodes)
        start += part.size
    return total


def _overlap(offset: Floats, along: Floats, across: Floats, count: int) -> Floats:
    """`_circle_overlap` from so many nodes; shape (N,)."""
    half = (1.0 - offset)[:, None] / 2
    nodes, weights = gauss_legendre(count)
    angle = (nodes + 1) * (math.pi / 4)
    # Column by column along the offset; x = L sin^2 removes the rim's square root.
    x = half * np.sin(angle) ** 2
    chord = np.sqrt((half - x) * (half + x + offset[:, None]))
    ramp = half * 2 * np.sin(angle) * np.cos(angle) * weights * (math.pi / 4)
    turns = np.cos(2 * math.pi * along[:, None] * x)
    if across.any():
        turns *= np.sinc(2 * across[:, None] * chord)
    return np.asarray((chord * turns * ramp).sum(-1) * 16 / math.pi)
