"""Geometric images made wave images: convolved with the microlenses' diffraction, tile by tile.

Every microlens spreads its light in the same pattern, so the isolated images with their own kernels, summed over
vignetted, textured and missing neighbours, are one convolution of the whole geometric image. For uniform light this
is exact; for a texture it takes the light in a microlens as incoherent, which misses 1 to 2 % rms of full scale in
the paper's camera (full-contrast grating of 3 to 8 microlens pitches, against coherent points added up).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from .grid import Region
from .transfer import MicrolensTransfer

Image = NDArray[np.float32]
Geometry = Callable[[Region, int], Image]
"""Geometric image of a region (it may reach beyond the sensor), in so many subpixels per pixel and axis."""

CORE = 512
"""Pixels of a tile that are kept."""

HALO = 96
"""Pixels around them that lend their light. A square aperture's pattern has 1/(pi^2 t) of its light beyond t blur
widths, and the tile's wrapped far side stands in for what lies farther out: it has about the same mean."""

DEFAULT_FINE = 4
"""Subpixels where no diffraction bounds the frequencies."""


def fineness(transfer: MicrolensTransfer, pixel: float) -> int:
    """Subpixels per pixel that keep what a coarser grid would fold back below 1e-3 of full scale.

    Parameters
    ----------
    transfer : MicrolensTransfer
    pixel : float
        q [mm].
    """
    if not math.isfinite(transfer.cutoff):
        return DEFAULT_FINE
    return min(4, max(2, math.ceil(4 * pixel * transfer.cutoff)))


def bands(
    region: Region, geometry: Geometry, transfer: MicrolensTransfer | None, pixel: float, threads: int
) -> Iterator[tuple[int, Image]]:
    """Bands of rows of a region, from the top, with what diffraction makes of them.

    Parameters
    ----------
    region : Region
    geometry : callable
        Gives geometric images.
    transfer : MicrolensTransfer, optional
        None leaves the geometric image as it is.
    pixel : float
        q [mm].
    threads : int
        For the tiles of a band; the bytes do not depend on it.

    Yields
    ------
    row : int
        First row of the band, counted from the region's first.
    image : ndarray of float32, shape (rows, region.columns)
    """
    if transfer is None:
        for row in range(0, region.rows, CORE):
            rows = min(CORE, region.rows - row)
            yield row, geometry(Region(region.column, region.row + row, region.columns, rows), 1)
        return
    fine = fineness(transfer, pixel)
    wide = Region(region.column - HALO, 0, region.columns + 2 * HALO, 0)
    kept = np.empty((0, wide.columns * fine), np.float32)
    first = region.row - HALO
    with ThreadPoolExecutor(threads) as pool:
        for row in range(0, region.rows, CORE):
            rows = min(CORE, region.rows - row)
            have = kept.shape[0] // fine
            start = first + row + have
            new = geometry(wide._replace(row=start, rows=rows + 2 * HALO - have), fine)
            band = np.concatenate([kept, new])
            image = np.empty((rows, region.columns), np.float32)
            columns = range(0, region.columns, CORE)

            def work(column: int, band: Image = band, image: Image = image) -> None:
                width = min(CORE, image.shape[1] - column)
                tile = band[:, column * fine : (column + width + 2 * HALO) * fine]
                image[:, column : column + width] = _tile(tile, transfer, pixel, fine)

            list(pool.map(work, columns))
            yield row, image
            kept = band[rows * fine :]


@functools.lru_cache(maxsize=8)
def _response(transfer: MicrolensTransfer, rows: int, columns: int, step: float) -> Image:
    frequency_y, frequency_x = np.fft.fftfreq(rows, step), np.fft.rfftfreq(columns, step)
    return transfer(frequency_x, frequency_y[:, None]).astype(np.float32)


def _tile(tile: Image, transfer: MicrolensTransfer, pixel: float, fine: int) -> Image:
    """Convolve one tile, drop its halo, and gather subpixels into pixels."""
    rows, columns = tile.shape
    spectrum = np.fft.rfft2(tile)
    spectrum *= _response(transfer, rows, columns, pixel / fine)
    wave = np.fft.irfft2(spectrum, s=tile.shape)
    edge = HALO * fine
    core = wave[edge : rows - edge, edge : columns - edge]
    return np.asarray(core.reshape(core.shape[0] // fine, fine, core.shape[1] // fine, fine).mean((1, 3)), np.float32)
