"""Point sources: coherent light through the bore, the main lens, every microlens that it reaches, and on to the sensor.

Each point's field on the array follows from one diffraction integral over the opening that the rims leave of the FAP
(Collins' form of Fresnel's, with the ray matrix of main lens and air); each microlens cuts out its square or disc,
bends it and lets it spread over d_2; the fields of neighbours add before the sensor takes intensities. Through exact
elements the wave is what their rays make it (`wavefront`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..theory.lens_shapes import LENS_SHAPES
from .camera import Floats, Image, ImageLattice, Region, pixel_centres
from .point_source import PointSource
from .trace import sobol_points
from .wavefront import Wavefront

Field = NDArray[np.complex128]
RoundField = Callable[[Floats, Floats], Field]

FINE = 4
"""Gauss-Legendre nodes per pixel and axis: exact to 1e-4 for the fringes of lenses three pitches apart."""
WIDEST = 64
"""Microlenses (per axis) that one point may light."""
WIDEST_TAIL = 24.0
"""Blur widths beyond a microlens's geometric image at which its light is cut off."""
LEAST_TOLERANCE = 2e-3
"""Smallest share of far tails that is gone after: light beyond falls off only as one over the distance."""
RAYS = 1 << 18
"""Rays for one point without diffraction: landings are counted, to about 1/500 of a pixel's share."""


def point_image(source: PointSource, region: Region, wavelengths: tuple[float, ...], tolerance: float) -> Image:
    """Image of a point source, the FAP's whole light being 1 when summed over all pixels.

    Parameters
    ----------
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
    lattice = ImageLattice.of(source.camera)
    if not wavelengths:
        return _by_rays(source, region, lattice)
    images = [_by_waves(source, region, lattice, wavelength, tolerance) for wavelength in wavelengths]
    return np.asarray(sum(images) / len(images), np.float32)


def _lit_lenses(source: PointSource, lattice: ImageLattice, beyond: float) -> Floats:
    """Indices of the microlenses within the ideal geometric spot and `beyond` around it, shape (N, 2)."""
    d, spread, opening = float(source.camera.d), source.throw * source.defocus, source.opening
    reach = abs(spread) * opening.spans[0] / 2 + beyond + d
    centre = source.spot - spread * opening.centres[0]
    span = min(WIDEST, math.ceil(reach / d * 1.2) + 1)
    steps = np.arange(-span, span + 1)
    nearest = np.round(np.linalg.solve(lattice.turned, centre - lattice.offset))
    index = nearest + np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    near = np.hypot(*(lattice.microlens(index) - centre).T) <= reach
    return np.asarray(index[near & lattice.holds(index)])


def _by_waves(
    source: PointSource, region: Region, lattice: ImageLattice, wavelength: float, tolerance: float
) -> Floats:
    camera = source.camera
    d, d_2, f_ml, D_F = (float(length) for length in (camera.d, camera.seen.d_2, camera.f_ml, camera.seen.D_F))
    image = np.zeros((region.rows, region.columns))
    # The Airy pattern has 2/(pi x) of its light beyond x = pi r D_F/(lambda B), and so has that of a square.
    narrow = abs(D_F) * float(camera.fap.outline.slimness)
    beyond = 2 / (math.pi * max(tolerance, LEAST_TOLERANCE)) * wavelength * source.throw / (math.pi * narrow)
    front = None if source.place is None else Wavefront.of(source, wavelength)
    if front is None and source.place is not None:
        return image
    if front is not None:
        beyond += abs(source.throw) * front.steepest
    index = _lit_lenses(source, lattice, beyond)
    if not len(index):
        return image
    blur = wavelength * d_2 / d
    at, weight = np.polynomial.legendre.leggauss(FINE)
    x, y = ((centres[:, None] + at * float(camera.q) / 2).ravel() for centres in pixel_centres(camera, region))
    shift = camera.decentre("sensor")
    field = np.zeros((y.size, x.size), np.complex128)
    # Cycles of phase across one microlens: towards the farthest sensor point kept, and of the light that comes in.
    cycles = (lattice.reach + WIDEST_TAIL * blur) / blur + d * D_F / (wavelength * source.throw)
    samples = 24 + 2 * math.ceil(cycles)
    nodes, weights = np.polynomial.legendre.leggauss(samples)
    v, dv = nodes * d / 2, weights * d / 2
    window = LENS_SHAPES[camera.lens_shape].window(v, d)
    bend = np.exp(-1j * math.pi / (wavelength * f_ml) * v**2) * dv
    reach = beyond + 3 * d
    arriving = _arriving(source, wavelength, reach) if front is None else _traced_field(front, wavelength, reach)
    full = float(camera.fap.outline.sized(abs(D_F)).area)
    for axis, centre in zip(lattice.microlens(index), lattice.image(index), strict=True):
        lens = _on_array(source, axis, v, wavelength, arriving) * window
        part = float((np.abs(lens) ** 2 * dv[:, None] * dv).sum()) / full
        if part < tolerance**2:
            continue
        # t blur widths out, a lens's field is down to 1/(pi t), and what it adds to the brightest is twice that.
        half = lattice.reach + blur * min(WIDEST_TAIL, 2 + 2 * math.sqrt(part) / (math.pi * tolerance))
        columns = slice(*np.searchsorted(x, (centre[0] - half, centre[0] + half)))
        rows = slice(*np.searchsorted(y, (centre[1] - half, centre[1] + half)))
        if columns.start == columns.stop or rows.start == rows.stop:
            continue
        along, across = (
            np.exp(1j * math.pi / (wavelength * d_2) * (p[:, None] - v) ** 2) * bend
            for p in (y[rows] + (shift[1] - axis[1]), x[columns] + (shift[0] - axis[0]))
        )
        field[rows, columns] += along @ lens @ across.T / (wavelength * d_2)
    power = (np.abs(field) ** 2).reshape(region.rows, FINE, region.columns, FINE)
    return np.asarray(np.einsum("jaib,a,b->ji", power, weight, weight) * float(camera.q**2 / (4 * full)))


def _arriving(source: PointSource, wavelength: float, beyond: float) -> RoundField:
    """The diffraction integral over the opening as a function of places on the array, counted from the spot [mm]."""
    if not source.opening.unclipped or 0 in source.opening.polygons:
        return lambda u_x, u_y: _clipped_field(source, u_x, u_y, wavelength)
    from scipy.special import j0

    # Over a whole disc it depends on the distance from the geometric spot's middle alone, and is tabulated.
    throw, radius, centre = source.throw, source.opening.radii[0], source.opening.centres[0]
    k = math.pi / wavelength
    farthest = abs(throw * source.defocus) * radius + beyond
    step = wavelength * abs(throw) / (2 * radius) / 256
    r = np.arange(0.0, math.sqrt(2) * farthest + 2 * step, step)
    count = 24 + 2 * math.ceil(2 * radius * (r[-1] / abs(throw) + abs(source.defocus) * radius) / wavelength)
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


def _clipped_field(source: PointSource, u_x: Floats, u_y: Floats, wavelength: float) -> Field:
    """Diffraction integral over what the rims leave open, chord by chord."""
    throw, opening = source.throw, source.opening
    widest = float(opening.spans.min()) / 2
    farthest = max(np.abs(u_x).max(), np.abs(u_y).max())
    cycles = 2 * widest * (farthest / abs(throw) + abs(source.defocus) * widest) / wavelength
    count = 24 + 2 * math.ceil(cycles)
    height, weight, left, right = opening.chords(count)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    a = (left + right)[:, None] / 2 + (right - left)[:, None] / 2 * nodes
    k = math.pi / wavelength
    row = np.exp(1j * k * source.defocus * a**2) * (right - left)[:, None] / 2 * weights
    across = np.einsum("ra,rav->rv", row, np.exp(-2j * k / throw * a[:, :, None] * u_x))
    along = np.exp(1j * k * source.defocus * height**2) * weight
    return np.asarray((np.exp(-2j * k / throw * u_y[:, None] * height) * along) @ across)


def _traced_field(front: Wavefront, wavelength: float, beyond: float) -> RoundField:
    """Field on the array of a wave through exact elements, over the opening that they leave, chord by chord."""
    source, k = front.source, math.pi / wavelength
    throw, defocus, radius = source.throw, source.defocus, front.radius
    farthest = abs(throw * defocus) * radius + beyond
    cycles = 2 * radius * (farthest / abs(throw) + abs(defocus) * radius + front.steepest) / wavelength
    count = 24 + 2 * math.ceil(cycles)
    height, weight, left, right = front.chords(count)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    a = (left + right)[:, None] / 2 + (right - left)[:, None] / 2 * nodes
    path = front.path(np.stack(np.broadcast_arrays(a, height[:, None]), axis=-1))
    square = a**2 + height[:, None] ** 2
    row = np.exp(1j * k * (defocus * square + 2 * path)) * (right - left)[:, None] / 2 * weights * weight[:, None]
    summed: dict[bytes, Field] = {}

    def rows(u_x: Floats) -> Field:
        """Sums along the chords: the same for all microlenses of a column."""
        if (key := u_x.tobytes()) not in summed:
            turned = (np.exp(-2j * k / throw * chord[:, None] * u_x) for chord in a)
            summed[key] = np.array([(wave[:, None] * turn).sum(0) for wave, turn in zip(row, turned, strict=True)])
        return summed[key]

    def field(u_x: Floats, u_y: Floats) -> Field:
        return np.asarray(np.exp(-2j * k / throw * u_y[:, None] * height) @ rows(u_x).reshape(len(height), len(u_x)))

    return field


def _on_array(source: PointSource, axis: Floats, v: Floats, wavelength: float, arriving: RoundField) -> Field:
    """Field on one microlens's square, shape (v.size, v.size); its squared size integrates to the light there."""
    field = arriving(*(at + v - spot for at, spot in zip(axis, source.spot, strict=True)))
    vergence = float(source.camera.seen.vergence)
    bent = [np.exp(1j * math.pi / wavelength * vergence * (at + v) ** 2) for at in axis]
    return np.asarray(field * bent[1][:, None] * bent[0] / (wavelength * source.throw))


def _by_rays(source: PointSource, region: Region, lattice: ImageLattice) -> Image:
    camera, opening = source.camera, source.opening
    unit = (sobol_points(RAYS)[:, :2] + 0.5) / 2.0**32
    a = np.stack(camera.fap.outline.polar(np.sqrt(unit[:, 0]), 2 * math.pi * unit[:, 1]), -1) + opening.centres[0]
    # The ray (a, slope (a - X)/R) through d_3 of air, lens, d_1 of air.
    slope = (a - (source.x, source.y)) / source.reach
    if source.place is None:
        kept = opening.contain(a)
    else:
        front = Wavefront.of(source, float(camera["light.wavelength"]))
        if front is None:
            return np.zeros((region.rows, region.columns), np.float32)
        kept, slope = front.lit(a), slope + front.slopes(a)
    height = a + slope * camera.seen.d_3
    after = slope - height / camera.f
    hit = height + after * camera.seen.d_1
    index = lattice.nearest(np.linalg.solve(lattice.turned, (hit - lattice.offset).T).T)
    offset = hit - lattice.microlens(index)
    kept &= lattice.holds(index)
    kept &= np.asarray(LENS_SHAPES[camera.lens_shape].holds(offset[:, 0], offset[:, 1], float(camera.d)), np.bool_)
    land = hit + (after - offset / camera.f_ml) * camera.seen.d_2 - np.array(camera.decentre("sensor"))
    pixel = np.floor(land / camera.q + np.array(camera.pixels) / 2).astype(int) - region[:2]
    kept &= ((pixel >= 0) & (pixel < region[2:])).all(-1)
    image = np.zeros((region.rows, region.columns), np.float32)
    np.add.at(image, tuple(pixel[kept].T[::-1]), np.float32(1 / RAYS))
    return image
