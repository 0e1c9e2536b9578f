"""Exact pixel coverage: how much of every pixel the microlens images cover."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from .._jit import THREADS
from . import _pixels
from .discs import checked

Array = NDArray[np.float64]
Image = NDArray[np.floating[Any]]

INTERPRETED_BELOW = 40_000
"""Pixels in the boxes around all parts up to which compiling, or even loading compiled code, takes longer.

Interpreted, a pixel takes 1 to 5 us, and loading numba with the compiled kernel some 0.5 s; once loaded, it is quicker
at any size. Small calls add up: `INTERPRETED_IN_ALL` counts all pixels that the process has interpreted so far. Which
of the two runs makes no difference but an ulp of a sine or an arc tangent, where the libraries' differ.
"""
INTERPRETED_IN_ALL = 200_000
_interpreted = [0]
LARGEST_PART = 20_000
"""Pixels across one part: its own workspace is this many squared."""
LARGEST_SENSOR = 2**40
"""Pixels from the sensor's corner, in x or y, beyond which fractions of a pixel have no digits left."""


class PixelAreas(NamedTuple):
    """One part, pixel by pixel, in the smallest block of pixels that holds it."""

    area: Array
    """Covered area of each pixel [mm^2], shape (rows, columns); row 0 is the lowest in y."""
    first_row: int
    """Row on the sensor of ``area[0]``."""
    first_column: int
    """Column on the sensor of ``area[:, 0]``."""
    x_edges: Array
    """Edges of the columns on the sensor [mm], shape (columns + 1)."""
    y_edges: Array
    """Edges of the rows [mm], shape (rows + 1)."""


def coverage_image(
    axes: ArrayLike,
    centres: ArrayLike,
    radii: ArrayLike,
    *,
    pixel: float,
    size: tuple[int, int],
    sensor_centre: tuple[float, float] = (0.0, 0.0),
    window: tuple[slice, slice] | None = None,
    out: Image | None = None,
    dtype: DTypeLike = np.float64,
    parallel: bool = False,
) -> Image:
    """Share of each pixel that the common parts of discs cover, summed over microlenses.

    Parameters
    ----------
    axes : array_like
        Microlens axes on the sensor [mm], shape (..., 2).
    centres, radii : array_like
        Discs relative to their microlens axis [mm], shapes (..., K, 2) and (..., K): those of `images.stop_images`.
    pixel : float
        q, pixel pitch [mm].
    size : (int, int)
        Pixels of the sensor along x and y. Pixel (row j, column i) covers ``i q`` to ``(i + 1) q`` from the sensor's
        left edge and ``j q`` to ``(j + 1) q`` from its lower one.
    sensor_centre : (float, float)
        Where the sensor's centre is [mm].
    window : (slice, slice), optional
        Rows and columns wanted, without steps: the result is, bit for bit, that part of the whole image.
    out : ndarray, optional
        Image to add to, of the window's shape, float32 or float64, instead of a new one.
    dtype : dtype
        Of a new image.
    parallel : bool
        Use all threads, by bands of rows; the image is the same to the last bit.

    Returns
    -------
    ndarray
        Shape (rows, columns), `out` if that was given. The pixels of a part add up to its area over ``q^2`` to 1e-13
        of it, and each is right to 1e-12, or 1e-15 times the largest clipping disc's radius in pixels; in float32 to
        6e-8.

    Raises
    ------
    ValueError
        As `discs.intersect`; sizes, a window or an `out` that do not fit.
    """
    columns, rows = (int(n) for n in size)
    if columns < 1 or rows < 1:
        raise ValueError(f"size must be at least one pixel by one, not {size}")
    part = (slice(0, rows), slice(0, columns)) if window is None else window
    if any(s.step not in (None, 1) for s in part):
        raise ValueError("a window has no steps: take every n-th pixel afterwards")
    low_row, high_row, _ = part[0].indices(rows)
    low_column, high_column, _ = part[1].indices(columns)
    shape = max(0, high_row - low_row), max(0, high_column - low_column)
    image: Image = np.zeros(shape, dtype) if out is None else out
    if image.shape != shape:
        raise ValueError(f"out has shape {image.shape}, but the window's is {shape}")
    if image.dtype not in (np.float32, np.float64):
        raise ValueError(f"an image of coverage is float32 or float64, not {image.dtype}")
    _check_pixel(pixel)
    origin = sensor_centre[0] - 0.5 * columns * pixel, sensor_centre[1] - 0.5 * rows * pixel
    _add(*_flat(axes, centres, radii), origin, pixel, low_row, low_column, image, parallel)
    return image


def pixel_areas(
    axis: ArrayLike,
    centres: ArrayLike,
    radii: ArrayLike,
    *,
    pixel: float,
    size: tuple[int, int] = (0, 0),
    sensor_centre: tuple[float, float] = (0.0, 0.0),
) -> PixelAreas:
    """Area of one common part in each pixel it touches, also where the sensor's real edge would cut it off.

    Parameters
    ----------
    axis, centres, radii : array_like
        As in `coverage_image`, for one microlens: shapes (2,), (K, 2) and (K,).
    pixel, size, sensor_centre
        As in `coverage_image`: they say how the pixel grid lies.

    Returns
    -------
    PixelAreas
        Where the part is empty, zeros or a block without pixels.
    """
    _check_pixel(pixel)
    at, centre, radius = _flat(axis, centres, radii)
    if len(at) != 1:
        raise ValueError(f"pixel_areas takes one microlens, not {len(at)}: see coverage_image")
    corner = np.array(sensor_centre) - 0.5 * np.array(size) * pixel
    middles, reach = (at - corner + centre[0]) / pixel, radius[0, :, None] / pixel
    box = np.max(middles - reach, axis=0), np.min(middles + reach, axis=0)
    low, high = (np.floor(edge + room).astype(int) for edge, room in zip(box, (-1e-9, 1 + 1e-9), strict=True))
    if (box[0] >= box[1]).any():
        high = low
    image = np.zeros((high[1] - low[1], high[0] - low[0]))
    _add(at, centre, radius, (float(corner[0]), float(corner[1])), pixel, int(low[1]), int(low[0]), image, False)
    x_edges, y_edges = (corner[k] + pixel * np.arange(low[k], high[k] + 1) for k in (0, 1))
    return PixelAreas(image * pixel**2, int(low[1]), int(low[0]), x_edges, y_edges)


def _flat(axes: ArrayLike, centres: ArrayLike, radii: ArrayLike) -> tuple[Array, Array, Array]:
    """Axes (n, 2), centres (n, K, 2) and radii (n, K), contiguous."""
    centre, radius = checked(centres, radii)
    axis = np.asarray(axes, float)
    if axis.ndim < 1 or axis.shape[-1] != 2:
        raise ValueError(f"axes must have shape (..., 2), not {axis.shape}")
    try:
        lead = np.broadcast_shapes(axis.shape[:-1], radius.shape[:-1])
    except ValueError:
        raise ValueError(f"axes of shape {axis.shape} and radii of shape {radius.shape} do not fit") from None
    k, n = radius.shape[-1], math.prod(lead)
    return (
        np.ascontiguousarray(np.broadcast_to(axis, (*lead, 2))).reshape(n, 2),
        np.ascontiguousarray(np.broadcast_to(centre, (*lead, k, 2))).reshape(n, k, 2),
        np.ascontiguousarray(np.broadcast_to(radius, (*lead, k))).reshape(n, k),
    )


def _check_pixel(pixel: float) -> None:
    if not (pixel > 0 and math.isfinite(pixel)):
        raise ValueError(f"pixel must be above 0 mm, not {pixel}")


def _without_vast_discs(centres: Array, radii: Array, pixel: float) -> tuple[Array, Array]:
    """Replace discs too large for the kernel, which clip nothing, by copies of the smallest one."""
    vast = radii > _pixels.LARGEST_RADIUS * pixel
    smallest = np.argmin(radii, axis=-1)[:, None]
    r = np.take_along_axis(radii, smallest, -1)
    c = np.take_along_axis(centres, smallest[..., None], -2)
    clips = vast & (np.hypot(*np.moveaxis(centres - c, -1, 0)) + r > radii)
    if clips.any():
        raise ValueError(
            f"a disc with a radius of {radii[clips].max() / pixel:g} pixels clips; at most {_pixels.LARGEST_RADIUS:g} "
            "are possible: check its stop"
        )
    return np.where(vast[..., None], c, centres), np.where(vast, r, radii)


def _add(
    axes: Array,
    centres: Array,
    radii: Array,
    origin: tuple[float, float],
    pixel: float,
    first_row: int,
    first_column: int,
    image: Image,
    parallel: bool,
) -> None:
    """Run the kernel that the problem's size asks for."""
    if image.size == 0 or len(axes) == 0:
        return
    far = (np.abs(axes).max() + np.abs(centres).max() + max(map(abs, origin))) / pixel
    if not far <= LARGEST_SENSOR:
        raise ValueError(f"a microlens up to {far:g} pixels from the sensor's corner: check axes, centres and pixel")
    across = 2 * radii.min(axis=-1) / pixel
    if across.max() > LARGEST_PART:
        raise ValueError(f"a part {across.max():.0f} pixels across; at most {LARGEST_PART} are possible: check pixel")
    if radii.max() / pixel > _pixels.LARGEST_RADIUS:
        centres, radii = _without_vast_discs(centres, radii, pixel)
    side = int(across.max()) + 4
    arguments = (axes, centres, radii, *origin, pixel, first_row, first_column, side, image)
    pixels = int(((across + 2) ** 2).sum())
    if not _pixels.coverage.ready and pixels < INTERPRETED_BELOW and _interpreted[0] < INTERPRETED_IN_ALL:
        _interpreted[0] += pixels
        _pixels.coverage.interpreted(*arguments)
    elif parallel and pixels >= INTERPRETED_BELOW:
        with THREADS:
            _pixels.coverage_bands.compiled(*arguments, min(len(image), _pixels.BANDS))
    else:
        _pixels.coverage.compiled(*arguments)
