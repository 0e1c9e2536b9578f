"""Transfer function of a microlens's own aperture and defocus, for the pupil's image behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array as Floats
from ..camera import Camera, Number
from ..shapes.discs import gauss_legendre
from .light import microlens_defocus


class Switches(Protocol):
    """A plan of effects."""

    def on(self, name: str) -> bool:
        """Whether an effect is on."""


NODES, PER_CYCLE = 24, 2.5
"""Gauss-Legendre nodes across a circular aperture's overlap, and more for each cycle of a phase across it: to 1e-12."""

CYCLES = (0, 4, 8, 16, 32, 64, 128, 256, 512, 1024)
"""Cycles up to which counts of nodes serve; less than 1e-5 is left beyond."""

MOST_TERMS = 2**18
"""Nodes of overlaps at a time, for memory's sake."""

TABULATE_FROM = 20_000
"""Frequencies from which a circle's transfer is read from a table along the radius, to about 1e-7."""


def pixel_box(frequency: ArrayLike, pixel: Number) -> Floats:
    """The pixel's transfer sinc(k q) at `frequency` k [1/mm] for pixels `pixel` = q wide [mm]; broadcast."""
    return np.asarray(np.sinc(np.multiply(frequency, pixel)))


def disc_spectrum(radius: float, frequency: Floats) -> Floats:
    """Fourier transform of a disc at frequencies [1/mm] from 0 on, R J_1(2 pi R k)/k: its area at 0 [mm^2]."""
    from scipy.special import j1

    safe = np.where(frequency > 0, frequency, 1.0)
    return np.where(frequency > 0, radius * j1(2 * math.pi * radius * safe) / safe, math.pi * radius**2)


def line_transfer(
    width: Number, sensor_distance: Number, defocus: Number, wavelength: Number, frequency: Floats
) -> Floats:
    """Transfer of a square microlens along one of its axes, all broadcast.

    The overlap ``d - a`` of the aperture with itself shifted by ``a = lambda d_2 nu``, and the defocus across it.
    Parameters are those of `MicrolensTransfer`.
    """
    overlap = np.maximum(width - wavelength * sensor_distance * np.abs(frequency), 0.0)
    return np.asarray(overlap / width * np.sinc(defocus * sensor_distance * frequency * overlap))


def circle_overlap(offset: Floats, along: Floats, across: ArrayLike = 0.0) -> Floats:
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
    """`circle_overlap` from so many nodes; shape (N,)."""
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
    """Rotation of the square aperture's sides [rad]."""
    beyond_rays: bool = False
    """Whether this is only what it has beyond diffraction in focus of the rays' own blur."""

    @classmethod
    def of(cls, camera: Camera, plan: Switches, wavelengths: Sequence[float] = ()) -> MicrolensTransfer:
        """As a plan has it; no `wavelengths` [mm] are the camera's own."""
        return cls(
            float(camera.d),
            float(camera.seen.d_2),
            -float(microlens_defocus(camera) / camera.seen.d_2) if plan.on("microlens_defocus") else 0.0,
            (tuple(wavelengths) or (float(camera.wavelength),)) if plan.on("microlens_diffraction") else (),
            camera.lens_shape == "circular",
            float(camera["microlens_array.rotation"]) if plan.on("mla_rotation") else 0.0,
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
        """Transfer at spatial frequencies on the sensor [1/mm], which broadcast; real, as the aperture is symmetric."""
        x, y = (np.asarray(values, float) for values in (frequency_x, frequency_y))
        if self.trivial:
            return np.ones(np.broadcast_shapes(x.shape, y.shape))
        if self.beyond_rays:
            whole = replace(self, beyond_rays=False)
            return np.asarray(whole(x, y) - replace(whole, defocus=0.0)(x, y) * replace(whole, wavelengths=())(x, y))
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
        return line_transfer(self.width, self.sensor_distance, self.defocus, wavelength, frequency)

    def _circle(self, frequency: Floats, wavelength: float) -> Floats:
        cycles = self.defocus * self.sensor_distance * self.width * frequency
        return circle_overlap(wavelength * self.sensor_distance * frequency / self.width, cycles)


def pair_transfer(
    transfer: MicrolensTransfer, frequency: Floats, apart: Floats, vergence: float, detail: ArrayLike = (0.0, 0.0)
) -> Floats:
    """Transfer by interference of a microlens with another, `apart` from it; 1 for one alone at frequency 0.

    Where both light the sensor, from an incoherent pupil, a frequency G comes of pairs of points ``a = lambda d_2 G``
    apart: of the overlap of one aperture with the other, shifted by a. In the overlap, of offset ``a - apart`` and with
    coordinates u about its middle, the two paths differ by ``u . (apart/f_ml - defocus a)``, which for one microlens is
    its defocus. Squares and circles.

    Parameters
    ----------
    transfer : MicrolensTransfer
        With one wavelength or more; not `beyond_rays`.
    frequency : ndarray, shape (M, 2)
        G on the sensor [1/mm].
    apart : ndarray, shape (2,)
        [mm], along the same axes.
    vergence : float
        1/L [1/mm].
    detail : array_like, shape (2,)
        Frequency of a pattern over the array, seen through the overlap, along the same axes [1/mm].

    Returns
    -------
    ndarray, shape (M,)
        Without the sign ``exp(-i pi G . (apart P/d))``, 1 or -1 at frequencies of the lattice.
    """
    c, s, width = math.cos(transfer.rotation), math.sin(transfer.rotation), transfer.width
    turn, detail = np.array([[c, -s], [s, c]]), np.asarray(detail, float)
    frequency, apart, detail = frequency @ turn, apart @ turn, detail @ turn
    total = np.zeros(len(frequency))
    for wavelength in transfer.wavelengths:
        if transfer.circular:
            shift, cycles = _paths(transfer, wavelength, frequency, apart, vergence, detail)
            total += _circles(shift / width, cycles * width)
        else:
            total += pair_line(transfer, wavelength, frequency, apart, vergence, detail).prod(-1)
    return total / len(transfer.wavelengths)


def pair_line(
    transfer: MicrolensTransfer, wavelength: float, frequency: Floats, apart: Floats, vergence: float, detail: ArrayLike
) -> Floats:
    """Transfer by interference of two square microlenses along one of their sides, as `pair_transfer`."""
    shift, cycles = _paths(transfer, wavelength, frequency, apart, vergence, detail)
    overlap = np.maximum(transfer.width - np.abs(shift), 0.0)
    return np.asarray(overlap / transfer.width * np.sinc(cycles * overlap))


def _paths(
    transfer: MicrolensTransfer, wavelength: float, frequency: Floats, apart: Floats, vergence: float, detail: ArrayLike
) -> tuple[Floats, Floats]:
    """How far two microlenses' openings lie apart where they overlap [mm], and how phases turn there [1/mm]."""
    power = 1 / transfer.sensor_distance + vergence + transfer.defocus  # 1/f_ml
    pair = wavelength * transfer.sensor_distance * frequency
    return pair - apart, (apart * power - transfer.defocus * pair) / wavelength - np.asarray(detail)


def _circles(shift: Floats, cycles: Floats) -> Floats:
    """Overlap of two circles 1 wide, `shift` (M, 2) apart: phase turns along and across it."""
    offset, total = np.hypot(*shift.T), np.zeros(len(shift))
    near = offset < 1
    offset, cycles = offset[near], cycles[near]
    unit = np.where(offset > 0, shift[near].T / np.where(offset > 0, offset, 1.0), [[1.0], [0.0]])
    aside = np.stack([-unit[1], unit[0]])
    total[near] = circle_overlap(offset, *((cycles.T * axis).sum(0) for axis in (unit, aside)))
    return total
