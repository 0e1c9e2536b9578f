"""Point sources: coherent light through the bore, the main lens, every microlens that it reaches, and on to the sensor.

Each point's field on the array follows from one diffraction integral over the opening that the rims leave of the FAP
(Collins' form of Fresnel's, with the ray matrix of main lens and air); each microlens cuts out its square or disc,
bends it and lets it spread over d_2; the fields of neighbours add before the sensor takes intensities.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design, Stop
from .camera import ImageLattice
from .grid import Region, pixel_centres
from .sobol import sobol_points

Floats = NDArray[np.float64]
Field = NDArray[np.complex128]

FINE = 4
"""Gauss-Legendre nodes per pixel and axis: exact to 1e-4 for the fringes of lenses three pitches apart."""

WIDEST = 64
"""Microlenses (per axis) that one point may light."""


WIDEST_TAIL = 24.0
"""Blur widths beyond a microlens's geometric image at which its light is cut off."""


LEAST_TOLERANCE = 2e-3
"""Smallest share of far tails that is gone after: light beyond falls off only as one over the distance."""


class Opening(NamedTuple):
    """What rims leave of the FAP for one point: the common part of discs on the FAP's plane."""

    centres: Floats
    """(K, 2), against the main lens's axis [mm]."""
    radii: Floats
    """(K,)."""

    @property
    def unclipped(self) -> bool:
        """Whether the FAP's disc, the first, lies inside all others."""
        apart = np.hypot(*(self.centres - self.centres[0]).T)
        return bool((apart + self.radii[0] <= self.radii).all())

    def chords(self, rows: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Rows across the opening: heights, their weights, and each chord's ends [mm]."""
        low = float((self.centres[:, 1] - self.radii).max())
        high = float((self.centres[:, 1] + self.radii).min())
        nodes, weights = np.polynomial.legendre.leggauss(rows)
        angle, half = nodes * (math.pi / 2), max(high - low, 0.0) / 2
        y = (high + low) / 2 + half * np.sin(angle)
        reach = np.sqrt(np.maximum(self.radii[:, None] ** 2 - (y - self.centres[:, 1:]) ** 2, 0.0))
        left = (self.centres[:, :1] - reach).max(0)
        right = np.maximum((self.centres[:, :1] + reach).min(0), left)
        return y, weights * (math.pi / 2) * half * np.cos(angle), left, right


@dataclass(frozen=True)
class PointSource:
    """One point as a camera sees it; positions against the main lens's axis."""

    design: Design
    """As planned, not tilted."""
    x: float
    y: float
    distance: float
    """Z [mm]."""

    @property
    def reach(self) -> float:
        """Distance from the FAP, R = Z - d_3 [mm]."""
        return self.distance - self.design.d_3

    @property
    def throw(self) -> float:
        """B of the ray matrix from the FAP to the array, d_1/H [mm]."""
        design = self.design
        return design.d_1 * (design.d_f - design.d_3) / design.d_f

    @property
    def defocus(self) -> float:
        """Curvature of the wave on the FAP that the main lens does not undo, 1/R - 1/(d_f - d_3) [1/mm]."""
        design = self.design
        return (design.d_f - self.distance) / (self.reach * (design.d_f - design.d_3))

    @property
    def spot(self) -> tuple[float, float]:
        """Where the ray through the FAP plane's axis point meets the array [mm]."""
        return -self.x * self.throw / self.reach, -self.y * self.throw / self.reach

    def opening(self) -> Opening:
        """What the FAP, the lens and further rims leave open for this point."""
        design = self.design
        lens = Stop(diameter=design.D, distance=0.0)
        centres, radii = [], []
        for stop in (*design.all_stops, lens):
            grow = self.reach / (self.distance - stop.distance)
            at = np.subtract(stop.decentre, design.main_lens.decentre if stop is not lens else (0.0, 0.0))
            centres.append([self.x + (at[0] - self.x) * grow, self.y + (at[1] - self.y) * grow])
            radii.append(stop.diameter / 2 * grow)
        return Opening(np.array(centres), np.array(radii))


def point_image(
    source: PointSource, region: Region, wavelengths: tuple[float, ...], tolerance: float
) -> NDArray[np.float32]:
    """Image of a point source, the FAP's whole light being 1 when summed over all pixels.

    Parameters
    ----------
    source : PointSource
    region : Region
        Pixels wanted.
    wavelengths : tuple of float
        Equal parts of light [mm]; empty: rays instead of waves.
    tolerance : float
        Share of the light in far diffraction tails that may be left out.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
    """
    lattice = ImageLattice.of(source.design)
    image = np.zeros((region.rows, region.columns), np.float32)
    if not wavelengths:
        _add_rays(image, source, region)
        return image
    for wavelength in wavelengths:
        _add_wave(image, source, region, lattice, wavelength, tolerance, 1 / len(wavelengths))
    return image


def _array_offset(design: Design) -> Floats:
    return np.subtract(design.microlens_array.decentre, design.main_lens.decentre)


def _turn(design: Design) -> Floats:
    c, s = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    return np.array([[c, -s], [s, c]])


def _lit_lenses(source: PointSource, lattice: ImageLattice, beyond: float) -> Floats:
    """Microlens axes (against the main lens's) within the geometric spot and `beyond` around it, shape (N, 2)."""
    design = source.design
    opening = source.opening()
    blur = source.throw * abs(source.defocus)
    reach = blur * opening.radii[0] + beyond + design.d
    centre = np.array(source.spot) + source.throw * source.defocus * opening.centres[0] * -1.0
    turned = _turn(design) @ lattice.axes
    guess = np.linalg.solve(turned, centre - _array_offset(design))
    span = min(WIDEST, math.ceil(reach / design.d * 1.2) + 1)
    steps = np.arange(-span, span + 1)
    i, j = np.meshgrid(np.round(guess[0]) + steps, np.round(guess[1]) + steps)
    index = np.stack([i.ravel(), j.ravel()], -1)
    place = index @ lattice.axes.T
    there = (np.abs(place) <= np.array(lattice.half_size) + 1e-9).all(1)
    axis = index @ turned.T + _array_offset(design)
    return np.asarray(axis[there & (np.hypot(*(axis - centre).T) <= reach)])


def _add_wave(
    image: NDArray[np.float32], source: PointSource, region: Region, lattice: ImageLattice, wavelength: float,
    tolerance: float, share: float,
) -> None:  # fmt: skip
    design = source.design
    # The Airy pattern has 2/(pi x) of its light beyond x = pi r D_F/(lambda B).
    beyond = 2 / (math.pi * max(tolerance, LEAST_TOLERANCE)) * wavelength * source.throw / (math.pi * design.D_F)
    axes = _lit_lenses(source, lattice, beyond)
    if not len(axes):
        return
    blur = wavelength * design.d_2 / design.d
    shift = np.subtract(design.sensor.decentre, design.main_lens.decentre)
    at, weight = np.polynomial.legendre.leggauss(FINE)
    x, y = ((centres[:, None] + at * design.q / 2).ravel() for centres in pixel_centres(design, region))
    x, y = x + shift[0], y + shift[1]
    field = np.zeros((y.size, x.size), np.complex128)
    # Cycles of phase across one microlens: towards the farthest sensor point kept, and of the light that comes in.
    cycles = (lattice.reach + WIDEST_TAIL * blur) / blur + design.d * design.D_F / (wavelength * source.throw)
    samples = 24 + 2 * math.ceil(cycles)
    nodes, weights = np.polynomial.legendre.leggauss(samples)
    v, dv = nodes * design.d / 2, weights * design.d / 2
    window = np.ones((samples, samples))
    if design.microlens_array.lens_shape == "circular":
        # Columns of the disc, each with its own chord, keep the quadrature smooth: here as fractional rows.
        window = np.clip((design.d / 2 - np.hypot(v[:, None], v)) / (design.d / samples) + 0.5, 0, 1)
    opening = source.opening()
    arriving = _round_field(source, opening, wavelength, beyond + 3 * design.d) if opening.unclipped else None
    full = math.pi * design.D_F**2 / 4
    grow = float((lattice.image_axes @ np.linalg.inv(_turn(design) @ lattice.axes))[0, 0])
    for axis in axes:
        lens = _on_array(source, opening, axis, v, wavelength, arriving) * window
        part = float((np.abs(lens) ** 2 * dv[:, None] * dv).sum()) / full
        if part < tolerance**2:
            continue
        # t blur widths out, a lens's field is down to 1/(pi t), and what it adds to the brightest is twice that.
        tail = blur * min(WIDEST_TAIL, 2 + 2 * math.sqrt(part) / (math.pi * tolerance))
        centre = grow * axis
        half = lattice.reach + tail
        columns = slice(*np.searchsorted(x, (centre[0] - half, centre[0] + half)))
        rows = slice(*np.searchsorted(y, (centre[1] - half, centre[1] + half)))
        if columns.start == columns.stop or rows.start == rows.stop:
            continue
        bend = np.exp(-1j * math.pi / (wavelength * design.f_ml) * v**2) * dv
        over = [
            np.exp(1j * math.pi / (wavelength * design.d_2) * (p[:, None] - v) ** 2) * bend
            for p in (y[rows] - axis[1], x[columns] - axis[0])
        ]
        field[rows, columns] += over[0] @ lens @ over[1].T / (wavelength * design.d_2)
    power = np.abs(field) ** 2
    power = power.reshape(region.rows, FINE, region.columns, FINE)
    pixels = np.einsum("jaib,a,b->ji", power, weight, weight) * (design.q**2 / (4 * full))
    image += (share * pixels).astype(np.float32)


RoundField = Callable[[Floats, Floats], Field]


def _round_field(source: PointSource, opening: Opening, wavelength: float, beyond: float) -> RoundField:
    """Diffraction integral over a whole disc against the distance from the geometric spot's middle, tabulated."""
    from scipy.special import j0

    throw, radius, centre = source.throw, opening.radii[0], opening.centres[0]
    k = math.pi / wavelength
    farthest = throw * abs(source.defocus) * radius + beyond
    step = wavelength * throw / (2 * radius) / 256
    r = np.arange(0.0, math.sqrt(2) * farthest + 2 * step, step)
    count = 24 + 2 * math.ceil(2 * radius * (r[-1] / throw + abs(source.defocus) * radius) / wavelength)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    rho, ring = (nodes + 1) * radius / 2, math.pi * radius * weights
    table = j0(2 * k / throw * r[:, None] * rho) @ (rho * ring * np.exp(1j * k * source.defocus * rho**2))

    def field(u_x: Floats, u_y: Floats) -> Field:
        shifted = [u - source.defocus * throw * e for u, e in zip((u_x, u_y), centre, strict=True)]
        r_at = np.hypot(shifted[0], shifted[1][:, None])
        value = np.interp(r_at, r, table.real) + 1j * np.interp(r_at, r, table.imag)
        turn = [np.exp(-2j * k / throw * e * u) for u, e in zip((u_x, u_y), centre, strict=True)]
        return np.asarray(value * turn[0] * turn[1][:, None] * np.exp(1j * k * source.defocus * (centre @ centre)))

    return field


def _on_array(
    source: PointSource, opening: Opening, axis: Floats, v: Floats, wavelength: float, arriving: RoundField | None
) -> Field:
    """Field on one microlens's square, shape (v.size, v.size); its squared size integrates to the light there."""
    design, throw = source.design, source.throw
    u_x, u_y = axis[0] + v - source.spot[0], axis[1] + v - source.spot[1]
    field = _clipped_field(source, opening, u_x, u_y, wavelength) if arriving is None else arriving(u_x, u_y)
    vergence = (design.f - design.d_3) / (design.f * throw)
    bent = [np.exp(1j * math.pi / wavelength * vergence * (axis[n] + v) ** 2) for n in (0, 1)]
    return np.asarray(field * bent[1][:, None] * bent[0] / (wavelength * throw))


def _clipped_field(source: PointSource, opening: Opening, u_x: Floats, u_y: Floats, wavelength: float) -> Field:
    """Diffraction integral over what the rims leave open, chord by chord."""
    throw = source.throw
    widest = float(opening.radii.min())
    cycles = (
        2 * widest * (max(np.abs(u_x).max(), np.abs(u_y).max()) / throw + abs(source.defocus) * widest) / wavelength
    )
    count = 24 + 2 * math.ceil(cycles)
    height, weight, left, right = opening.chords(count)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    a = (left + right)[:, None] / 2 + (right - left)[:, None] / 2 * nodes
    k = math.pi / wavelength
    row = np.exp(1j * k * source.defocus * a**2) * (right - left)[:, None] / 2 * weights
    across = np.einsum("ra,rav->rv", row, np.exp(-2j * k / throw * a[:, :, None] * u_x))
    along = np.exp(1j * k * source.defocus * height**2) * weight
    return np.asarray((np.exp(-2j * k / throw * u_y[:, None] * height) * along) @ across)


RAYS = 1 << 18
"""Rays for one point without diffraction: landings are counted, to about 1/500 of a pixel's share."""


def _add_rays(image: NDArray[np.float32], source: PointSource, region: Region) -> None:
    design = source.design
    lattice = ImageLattice.of(design)
    opening = source.opening()
    unit = (sobol_points(RAYS)[:, :2] + 0.5) / 2.0**32
    rho, phi = opening.radii[0] * np.sqrt(unit[:, 0]), 2 * math.pi * unit[:, 1]
    a = np.stack([rho * np.cos(phi), rho * np.sin(phi)], -1) + opening.centres[0]
    kept = (np.hypot(*(a[:, None] - opening.centres).transpose(2, 0, 1)) <= opening.radii * (1 + 1e-12)).all(1)
    # The ray (a, slope (a - X)/R) through d_3 of air, lens, d_1 of air.
    slope = (a - (source.x, source.y)) / source.reach
    height = a + slope * design.d_3
    after = slope - height / design.f
    hit = height + after * design.d_1
    turned = _turn(design) @ lattice.axes
    local = np.linalg.solve(turned, (hit - _array_offset(design)).T).T
    index = _nearest(local, lattice)
    axis = index @ turned.T + _array_offset(design)
    offset = hit - axis
    kept &= (np.abs(index @ lattice.axes.T) <= np.array(lattice.half_size) + 1e-9).all(1)
    if design.microlens_array.lens_shape == "circular":
        kept &= np.hypot(*offset.T) <= design.d / 2
    land = hit + (after - offset / design.f_ml) * design.d_2
    land = land - np.subtract(design.sensor.decentre, design.main_lens.decentre)
    width, rows = design.pixels
    column = np.floor(land[:, 0] / design.q + width / 2).astype(int) - region.column
    row = np.floor(land[:, 1] / design.q + rows / 2).astype(int) - region.row
    kept &= (column >= 0) & (column < region.columns) & (row >= 0) & (row < region.rows)
    np.add.at(image, (row[kept], column[kept]), np.float32(1 / RAYS))


def _nearest(local: Floats, lattice: ImageLattice) -> Floats:
    """Index of the nearest lattice point, for square and hexagonal packing."""
    base = np.floor(local)
    corners = [base + np.array([i, j]) for i in (0, 1) for j in (0, 1)]
    far = [np.hypot(*((local - corner) @ lattice.axes.T).T) for corner in corners]
    choice = np.argmin(far, axis=0)
    return np.asarray(np.choose(choice[:, None], corners))
