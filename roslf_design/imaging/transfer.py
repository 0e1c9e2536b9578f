"""Convolution of images with the microlens aperture's transfer function, for the incoherent pupil behind it.

A uniform scene fills the FAP with incoherent light (van Cittert-Zernike), and every point of it lights the sensor with
the same pattern |Fresnel transform of the microlens aperture|^2, shifted. So the microlens image is its geometric shape
convolved with that pattern, and in frequencies a product with the aperture's own autocorrelation.

Every microlens spreads its light in the same pattern, so the isolated images with their own kernels, summed over
vignetted, textured and missing neighbours, are one convolution of the whole geometric image, taken tile by tile. For
uniform light this is exact; for a texture it takes the light in a microlens as incoherent; what that misses is
`effects.waves.incoherent_texture_miss`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..shapes.lattice import PACKINGS
from ..theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from ..theory.transfer import MicrolensTransfer
from .camera import Image, Region

PANEL = 16
"""Gauss-Legendre nodes for each oscillation of a product of spectra."""

CORE = 512
"""Pixels of a tile that are kept, about."""

LEAST_HALO, MOST_HALO = 96, 1024
"""Pixels around them that lend their light, at least and at most."""

LEAST_PITCHES = 8.0
"""Microlenses around them that do, at least: waves over the array are then turned by less than 1 mrad, and depth is
that of 14 to .0006 pitches; where tails end at six, waves are turned by 3 mrad, and pixels are 1.5e-3 off."""

LEAST_BLURS = 80.0
"""Widths of diffraction's blur after which a quarter of them does: fewer are left of the tails than after those eight
in the paper's camera, of 3.6 widths a microlens."""

BEYOND = 1e-3
"""Share of a pixel's variance that few rays may bring."""

DEFAULT_FINE = 4
"""Subpixels where no diffraction bounds the frequencies."""

Geometry = Callable[[Region, int], Image]
"""Geometric image of a region (it may reach beyond the sensor), in so many subpixels per pixel and axis."""


class _Encircled(NamedTuple):
    """Fractions of one unclipped microlens image's light, before pixels integrate."""

    disc: float
    """Inside its geometric disc, or whatever shape the FAP has."""
    cell: float
    """Inside its own cell, a square or a hexagon of one image pitch about its centre."""


def encircled(camera: Camera) -> _Encircled:
    """Light that diffraction at a microlens in focus leaves inside its image's disc and inside its cell.

    By Parseval, the light of the image ``P * K`` inside a shape S is the integral of the three spectra's product,
    which ends where the transfer function does: a finite integral of a smooth function.
    """
    lengths = float(camera.d), float(camera.seen.d_2)
    transfer = MicrolensTransfer(*lengths, 0.0, (float(camera.wavelength),), camera.lens_shape)
    image = camera.fap.outline.sized(float(microlens_image_diameter(camera)))
    pitch = abs(float(microlens_image_pitch(camera)))
    panels = math.ceil(2 * transfer.cutoff * max(2 * float(image.reach), pitch)) + 1
    nodes, weights = np.polynomial.legendre.leggauss(PANEL)
    step = transfer.cutoff / panels
    frequency = ((np.arange(panels)[:, None] + (nodes + 1) / 2) * step).ravel()
    weight = np.tile(weights * step / 2, panels)
    cell, area = PACKINGS[camera.layout].cell_spectrum(pitch, frequency), image.area
    passed = transfer(frequency[:, None], frequency) * (4 * weight[:, None] * weight)
    spectra = [image.spectrum(sign * frequency, frequency[:, None]) for sign in (1, -1)]
    own = sum((part * passed * part).sum() for part in spectra)
    within = sum((part * passed * cell).sum() for part in spectra)
    return _Encircled(float(own / 2 / area), float(within / 2 / area))


def fineness(transfer: MicrolensTransfer, pixel: float) -> int:
    """Subpixels per pixel (of width `pixel` [mm]) that keep what a coarser grid would fold back below 1e-3."""
    if not math.isfinite(transfer.cutoff):
        return DEFAULT_FINE
    return min(4, max(2, math.ceil(4 * pixel * transfer.cutoff)))


def halo(transfer: MicrolensTransfer, pixel: float, tolerance: float) -> int:
    """Pixels (of width `pixel` [mm]) around a pixel that lend it light; what comes from farther is `tolerance` of it.

    A square aperture's pattern has 1/(2 pi^2 t) of its light beyond t blur widths on a side. Light from beyond is taken
    to be as bright as the mean of what lies within: half right where an array ends, and elsewhere nearly so.
    """
    blur = max(transfer.wavelengths, default=0.0) * transfer.sensor_distance / transfer.width
    defocused = transfer.width * transfer.sensor_distance * abs(transfer.defocus)
    reach = blur / (4 * math.pi**2 * tolerance) + defocused if tolerance > 0 else math.inf
    lenses = LEAST_PITCHES * transfer.width
    if blur:
        lenses = min(lenses, max(lenses / 4, LEAST_BLURS * blur + defocused))
    return int(min(max(LEAST_HALO, lenses / pixel, reach / pixel), MOST_HALO))


def bands(
    region: Region,
    geometry: Geometry,
    transfer: MicrolensTransfer,
    pixel: float,
    threads: int,
    tolerance: float = 0.01,
) -> Iterator[tuple[int, Image]]:
    """Bands of rows of a region, from the top, with what diffraction makes of them.

    Parameters
    ----------
    geometry : callable
        Gives geometric images.
    transfer : MicrolensTransfer
        A trivial one leaves the geometric image as it is.
    pixel : float
        q [mm].
    threads : int
        For the tiles of a band; the bytes do not depend on it.
    tolerance : float
        Share of a microlens's light that may come from beyond what is looked at, see `halo`.

    Yields
    ------
    row : int
        First row of the band, counted from the region's first.
    image : ndarray of float32, shape (rows, region.columns)
    """
    if transfer.trivial:
        for row in range(0, region.rows, CORE):
            piece = region._replace(row=region.row + row, rows=min(CORE, region.rows - row))
            yield row, geometry(piece, 1)
        return
    fine, edge = fineness(transfer, pixel), halo(transfer, pixel, tolerance)
    wide = Region(region.column - edge, 0, region.columns + 2 * edge, 0)
    kept = np.empty((0, wide.columns * fine), np.float32)
    blur = functools.partial(blurred, transfer=transfer, step=pixel / fine, edge=edge * fine, fine=fine)
    high, across = (_alike(count) for count in (region.rows, region.columns))
    with ThreadPoolExecutor(threads) as pool:
        for row in range(0, region.rows, high):
            rows = min(high, region.rows - row)
            have = kept.shape[0] // fine
            start = region.row - edge + row + have
            band = np.concatenate([kept, geometry(wide._replace(row=start, rows=rows + 2 * edge - have), fine)])
            columns = range(0, region.columns, across)
            ends = [min(column + across, region.columns) + 2 * edge for column in columns]
            tiles = [band[:, column * fine : end * fine] for column, end in zip(columns, ends, strict=True)]
            yield row, np.concatenate(list(pool.map(blur, tiles)), axis=1)
            kept = band[rows * fine :]


def _alike(count: int) -> int:
    """Pixels of each of the tiles that `count` is parted into, all as large where that is possible: `CORE`, about."""
    return math.ceil(count / max(1, round(count / CORE)))


def _quick(count: int) -> int:
    """Least number of samples, not below `count`, whose Fourier transform takes no long factor."""
    while pow(210, count.bit_length(), count):  # a prime factor other than 2, 3, 5 and 7
        count += 1
    return count


@functools.lru_cache(maxsize=4)
def _pattern(transfer: MicrolensTransfer, step: float, edge: int) -> Image:
    """The light pattern within `edge` samples of its centre, shape (2 edge + 1, 2 edge + 1), in samples of `step` [mm].

    What lies beyond is spread over all of it. Always taken from the same frequencies, so that a pixel does not depend
    on the tile that it is in.
    """
    side = _quick(2 * edge + CORE)
    frequency_y, frequency_x = np.fft.fftfreq(side, step), np.fft.rfftfreq(side, step)
    response = transfer(frequency_x, frequency_y[:, None])
    wave = np.fft.irfft2(response, s=(side, side))
    near = np.arange(-edge, edge + 1)
    kernel = wave[np.ix_(near, near)]
    return np.asarray(kernel + (response[0, 0] - kernel.sum()) / kernel.size, np.float32)


def near_reach(transfer: MicrolensTransfer, pixel: float, tolerance: float) -> int:
    """Pixels beyond a straight border that lend a pixel at it all but `BEYOND` of what it scatters, of `halo`."""
    edge = halo(transfer, pixel, tolerance)
    if transfer.trivial:
        return edge
    squares = np.square(_pattern(transfer, pixel, edge), dtype=float)
    outside = np.cumsum(np.maximum(squares.sum(0), squares.sum(1)))[:edge]  # from the farthest row inwards
    return edge - int(np.searchsorted(outside, BEYOND * squares.sum()))


@functools.lru_cache(maxsize=8)
def _response(transfer: MicrolensTransfer, shape: tuple[int, int], step: float, edge: int) -> NDArray[np.complex64]:
    """Spectrum of that pattern about the corner of a tile, times the number of samples.

    Scaled, numpy transforms single precision as that; unscaled in double precision, in more than twice the time.
    """
    tile = np.zeros(shape, np.float32)
    near = np.arange(-edge, edge + 1)
    tile[np.ix_(near, near)] = _pattern(transfer, step, edge)
    return np.asarray(np.fft.rfft2(tile, norm="forward") * np.float32(tile.size) ** 2, np.complex64)


def blurred(tile: Image, transfer: MicrolensTransfer, step: float, edge: int, fine: int) -> Image:
    """Convolve one tile, drop its halo, and gather subpixels into pixels."""
    rows, columns = (count - 2 * edge for count in tile.shape)
    shape = _quick(tile.shape[0]), _quick(tile.shape[1])  # only what is dropped reaches what is added
    spectrum = np.fft.rfft2(tile, shape, norm="forward") * _response(transfer, shape, step, edge)
    core = np.fft.irfft2(spectrum, shape)[edge : edge + rows, edge : edge + columns]
    light = sum(core[i::fine, j::fine] for i in range(fine) for j in range(fine))
    return np.asarray(light / np.float32(fine**2), np.float32)
