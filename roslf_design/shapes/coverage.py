"""Exact pixel coverage: how much of every pixel the microlens images cover.

Green's theorem, pixel by pixel: a piece of boundary that climbs by dy within a pixel adds to it the area between itself
and the pixel's left edge, and dy to every pixel further left in its row. The area under an arc of a circle between two
pixel edges is a difference of values tabulated once per edge, so a disc costs one arc sine per pixel edge it crosses.

Everything is counted in pixels, from the pixel that holds the centre of disc 0: what a microlens adds to a pixel does
not depend on which part of the sensor is asked for.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from .._jit import WHOLE, Band, kernel, prange
from .discs import checked
from .pieces import ARC, DX, DY, EDGE, PIECE, X, Y, bound, lay_edges

Floats = NDArray[np.float64]
Array = Floats
Image = NDArray[np.floating[Any]]

PIXEL = 2e-6
"""Seconds that a pixel in the boxes around all parts takes interpreted: the same but for an ulp of a sine or an arc
tangent, where the libraries' differ."""
PARALLEL_FROM = 40_000
"""Such pixels from which threads pay."""
LARGEST_PART = 20_000
"""Pixels across one part: its own workspace is this many squared."""
LARGEST_SENSOR = 2**40
"""Pixels from the sensor's corner, in x or y, beyond which fractions of a pixel have no digits left."""


def coverage_image(
    axes: ArrayLike,
    centres: ArrayLike,
    radii: ArrayLike,
    *,
    corners: ArrayLike | None = None,
    pixel: float,
    size: tuple[int, int],
    sensor_centre: tuple[float, float] = (0.0, 0.0),
    window: tuple[slice, slice] | None = None,
    out: Image | None = None,
    dtype: DTypeLike = np.float64,
    parallel: bool = False,
) -> Image:
    """Share of each pixel that the common parts of discs and polygons cover, summed over microlenses.

    Parameters
    ----------
    axes : array_like
        Microlens axes on the sensor [mm], shape (..., 2).
    centres, radii : array_like
        Discs relative to their microlens axis [mm], shapes (..., K, 2) and (..., K): those of `images.stop_images`.
    corners : array_like, optional
        Of convex polygons [mm], counterclockwise, shape (..., P, M, 2), counted likewise.
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
    if not (pixel > 0 and math.isfinite(pixel)):
        raise ValueError(f"pixel must be above 0 mm, not {pixel}")
    axis, centre, radius, corner = _flat(axes, centres, radii, corners)
    if image.size == 0 or len(axis) == 0:
        return image
    origin = sensor_centre[0] - 0.5 * columns * pixel, sensor_centre[1] - 0.5 * rows * pixel
    aside = max(np.abs(part).max(initial=0.0) for part in (centre, corner))
    far = (np.abs(axis).max() + aside + max(map(abs, origin))) / pixel
    if not far <= LARGEST_SENSOR:
        raise ValueError(f"a microlens up to {far:g} pixels from the sensor's corner: check axes, centres and pixel")
    widest = np.ptp(corner, axis=-2).max(-1)
    across = np.minimum(2 * radius.min(-1, initial=math.inf), widest.min(-1, initial=math.inf)) / pixel
    if across.max() > LARGEST_PART:
        raise ValueError(f"a part {across.max():.0f} pixels across; at most {LARGEST_PART} are possible: check pixel")
    if radius.max(initial=0.0) / pixel > LARGEST_RADIUS:
        centre, radius = _without_vast_discs(centre, radius, pixel)
    whole = np.ascontiguousarray(image)  # kernels are compiled once more for another layout
    arguments = (axis, centre, radius, corner, *origin, pixel, low_row, low_column, int(across.max()) + 4, whole)
    pixels = int(((across + 2) ** 2).sum())
    if parallel and pixels >= PARALLEL_FROM:
        coverage_bands.compiled(*arguments, min(len(image), BANDS))
    elif coverage.pays(PIXEL * pixels):
        coverage.compiled(*arguments)
    else:
        coverage.interpreted(*arguments)
    if whole is not image:
        image[...] = whole
    return image


def _flat(
    axes: ArrayLike, centres: ArrayLike, radii: ArrayLike, corners: ArrayLike | None
) -> tuple[Array, Array, Array, Array]:
    """Axes (n, 2), centres (n, K, 2) and radii (n, K) of discs, corners (n, P, M, 2) of polygons, contiguous."""
    axis, centre, radius = np.asarray(axes, float), np.asarray(centres, float), np.asarray(radii, float)
    if corners is None or radius.shape[-1:] != (0,):
        centre, radius = checked(centres, radii)
    corner = np.empty((0, 3, 2)) if corners is None else np.asarray(corners, float)
    if axis.ndim < 1 or axis.shape[-1] != 2:
        raise ValueError(f"axes must have shape (..., 2), not {axis.shape}")
    try:
        lead = np.broadcast_shapes(axis.shape[:-1], radius.shape[:-1], corner.shape[:-3])
    except ValueError:
        raise ValueError(f"axes of shape {axis.shape} and radii of shape {radius.shape} do not fit") from None
    k, n = radius.shape[-1], math.prod(lead)
    return (
        np.ascontiguousarray(np.broadcast_to(axis, (*lead, 2))).reshape(n, 2),
        np.ascontiguousarray(np.broadcast_to(centre, (*lead, k, 2))).reshape(n, k, 2),
        np.ascontiguousarray(np.broadcast_to(radius, (*lead, k))).reshape(n, k),
        np.ascontiguousarray(np.broadcast_to(corner, (*lead, *corner.shape[-3:]))).reshape(n, *corner.shape[-3:]),
    )


def _without_vast_discs(centres: Array, radii: Array, pixel: float) -> tuple[Array, Array]:
    """Replace discs too large for the kernel, which clip nothing, by copies of the smallest one."""
    vast = radii > LARGEST_RADIUS * pixel
    smallest = np.argmin(radii, axis=-1)[:, None]
    r = np.take_along_axis(radii, smallest, -1)
    c = np.take_along_axis(centres, smallest[..., None], -2)
    clips = vast & (np.hypot(*np.moveaxis(centres - c, -1, 0)) + r > radii)
    if clips.any():
        raise ValueError(
            f"a disc with a radius of {radii[clips].max() / pixel:g} pixels clips; at most {LARGEST_RADIUS:g} "
            "are possible: check its stop"
        )
    return np.where(vast[..., None], c, centres), np.where(vast, r, radii)


QUARTER = 0.5 * math.pi
ROWS, COLUMNS, REACH = 0, 1, 2
"""Planes of the workspace: for edges of rows and of columns (HALF, AREA); the first and last column that a row has."""
HALF, AREA = 0, 1
BLOCK = 16
"""Edges tabulated at a time: a known count, in plain slices, is what lets the compiler use wide registers."""
FAR = 64.0
"""Radii [px] above which areas are counted from chords within the pixel, not as differences of tabulated ones, whose
last digit is worth the radius squared."""
ROOM = 1e-8
"""Around a part [px]: more than the rounding of a point on a circle of `LARGEST_RADIUS`."""
LARGEST_RADIUS = 1e6
"""Radii [px] up to which a circle's points are where they should be to a small part of a pixel."""
BANDS = 16
"""Bands of rows for the threads to share: several each, as light is not spread evenly."""


@kernel()
def _tabulate(centre: float, r: float, low: int, high: int, tables: Floats, axis: int) -> None:
    """At edges low..high of pixels: half the chord of the circle along the edge, and the area from its diameter to it.

    The area is ``(u w + r^2 asin(u/r))/2``. The arc sine is four times the arc tangent of a quarter of the angle, found
    by halving a tangent twice, and the polynomial is a Chebyshev fit of ``atan(sqrt z)/sqrt z`` for tangents up to
    sqrt(2) - 1 (error 1.3e-18): without branches or calls, the processor does several edges at once.
    """
    rr = 0.5 * r * r
    for block in range(low, high + 1, BLOCK):
        half = tables[axis, HALF, block : block + BLOCK]
        area = tables[axis, AREA, block : block + BLOCK]
        for k in range(BLOCK):
            t = max(-1.0, min(1.0, (block + k - centre) / r))
            w = math.sqrt((1.0 - t) * (1.0 + t))
            x = t / (1.0 + w)
            x /= 1.0 + math.sqrt(1.0 + x * x)
            z = x * x
            p = 0.03796524391097195 - 0.017805382196606493 * z
            p = p * z - 0.05035101930016078
            p = p * z + 0.05846878181892052
            p = p * z - 0.06662951797955637
            p = p * z + 0.07692045329539092
            p = p * z - 0.09090896808988135
            p = p * z + 0.11111110744917034
            p = p * z - 0.14285714279250192
            p = p * z + 0.1999999999994089
            p = p * z - 0.3333333333333312
            p = p * z + 1.0
            half[k] = r * w
            area[k] = rr * (t * w + 4.0 * x * p)


@kernel()
def _bulge(dx: float, dy: float, r: float) -> float:
    """Area between an arc and its chord, far shorter than the radius: a series in ``(chord / 2r)^2``."""
    square = dx * dx + dy * dy
    s = 0.25 * square / (r * r)
    return 0.125 * square * math.sqrt(square) / r * (2.0 / 3.0 + s * (0.2 + s * (3.0 / 28.0 + s * (5.0 / 72.0))))


@kernel()
def _climb(
    acc: Floats,
    tables: Floats,
    cx: float,
    cy: float,
    r: float,
    side: float,
    sign: float,
    x: float,
    y: float,
    area: float,
    x_end: float,
    y_end: float,
    area_end: float,
) -> None:
    """Walk up a piece of circle within one quadrant, from pixel to pixel.

    Parameters
    ----------
    acc
        Sums: pixel i of a row is the sum of ``acc[row, i + 1 :]``.
    tables
        Rows as `coverage` makes them.
    side, sign
        1 or -1: right or left of the centre, above or below it.
    x, y, area
        Where the piece starts, x as a distance, y signed, from the centre; area between the circle and the vertical
        diameter from the horizontal one up to there, signed like y. The same for its end, which is higher.
    """
    last = math.floor(cy + y_end)
    quarter = QUARTER * 0.5 * r * r
    row = math.floor(cy + y)
    at = cx + side * x
    column = math.floor(at)
    far = r > FAR
    while True:
        first = column
        if row < last:
            next_y = (row + 1) - cy
            next_area = tables[ROWS, AREA, row + 1]
            next_at = cx + side * tables[ROWS, HALF, row + 1]
        else:
            next_y = y_end
            next_area = area_end
            next_at = cx + side * x_end
        stop = math.floor(next_at)
        while column != stop:
            edge = column + 1 if stop > column else column
            edge_y = sign * tables[COLUMNS, HALF, edge]
            edge_area = sign * (
                quarter + abs(edge - cx) * tables[COLUMNS, HALF, edge] - abs(tables[COLUMNS, AREA, edge])
            )
            rise = side * (edge_y - y)
            part = edge_area - area + rise * (cx - column)
            if far:
                part = (0.5 * (at + edge) - column) * rise + _bulge(at - edge, edge_y - y, r)
                at = edge
            acc[row, column + 1] += part
            acc[row, column] += rise - part
            y = edge_y
            area = edge_area
            column += 1 if stop > column else -1
        rise = side * (next_y - y)
        part = next_area - area + rise * (cx - column)
        if far:
            part = (0.5 * (at + next_at) - column) * rise + _bulge(at - next_at, next_y - y, r)
            at = next_at
        acc[row, column + 1] += part
        acc[row, column] += rise - part
        if side > 0.0:
            tables[REACH, 1, row] = max(tables[REACH, 1, row], max(first, column))
        else:
            tables[REACH, 0, row] = min(tables[REACH, 0, row], min(first, column))
        if row >= last:
            break
        y = next_y
        area = next_area
        row += 1


@kernel()
def _add_arc_pixels(acc: Floats, tables: Floats, cx: float, cy: float, r: float, start: float, end: float) -> None:
    """Add a counterclockwise arc, quadrant by quadrant; (cx, cy) counted from pixel (0, 0) of `acc`."""
    rr = 0.5 * r * r
    quadrant = math.floor(start / QUARTER)
    x_from = r * math.cos(start)
    y_from = r * math.sin(start)
    x_to = r * math.cos(end)
    y_to = r * math.sin(end)
    x_low = min(x_from, x_to)
    x_high = max(x_from, x_to)
    y_low = min(y_from, y_to)
    y_high = max(y_from, y_to)
    for k in range(quadrant + 1, quadrant + 6):
        if k * QUARTER <= end:
            if k % 4 == 0:
                x_high = r
            elif k % 4 == 1:
                y_high = r
            elif k % 4 == 2:
                x_low = -r
            else:
                y_low = -r
    _tabulate(cy, r, math.floor(cy + y_low), math.floor(cy + y_high) + 1, tables, ROWS)
    _tabulate(cx, r, math.floor(cx + x_low), math.floor(cx + x_high) + 1, tables, COLUMNS)
    angle = start
    while angle < end:
        k = quadrant % 4
        side = 1.0 if k == 0 or k == 3 else -1.0
        sign = 1.0 if k < 2 else -1.0
        # Angle of a point above or below the horizontal diameter; at the poles exact.
        a = angle - quadrant * QUARTER
        x_a = abs(x_from)
        y_a = abs(y_from)
        if angle != start:
            a = 0.0
            x_a = r if k % 2 == 0 else 0.0
            y_a = r - x_a
        angle = (quadrant + 1) * QUARTER
        b = QUARTER
        x_b = 0.0 if k % 2 == 0 else r
        y_b = r - x_b
        if angle >= end:
            b = end - quadrant * QUARTER
            x_b = abs(x_to)
            y_b = abs(y_to)
        if k % 2 == 1:
            a = QUARTER - a
            b = QUARTER - b
        area_a = sign * (rr * a + 0.5 * x_a * y_a)
        area_b = sign * (rr * b + 0.5 * x_b * y_b)
        y_a *= sign
        y_b *= sign
        if side > 0.0:
            _climb(acc, tables, cx, cy, r, side, sign, x_a, y_a, area_a, x_b, y_b, area_b)
        else:
            _climb(acc, tables, cx, cy, r, side, sign, x_b, y_b, area_b, x_a, y_a, area_a)
        quadrant += 1


@kernel()
def _add_edge_pixels(acc: Floats, tables: Floats, x: float, y: float, x_end: float, y_end: float) -> None:
    """Add a straight piece from (x, y) to its end, row by row; counted from pixel (0, 0) of `acc`."""
    low = min(y, y_end)
    high = max(y, y_end)
    row = math.floor(low)
    slope = (x_end - x) / (y_end - y) if y_end != y else 0.0
    sign = 1.0 if y_end > y else -1.0
    while True:
        bottom = max(low, float(row))
        top = min(high, row + 1.0)
        # Where it enters and leaves the row, from left to right; on its ends to the last bit.
        a = (x if sign > 0.0 else x_end) if bottom == low else x + (bottom - y) * slope
        b = (x_end if sign > 0.0 else x) if top == high else x + (top - y) * slope
        left = min(a, b)
        right = max(a, b)
        first = math.floor(left)
        last = math.floor(right)
        rise = sign * (top - bottom)
        for column in range(first, last + 1):
            begin = max(left, float(column))
            end = min(right, column + 1.0)
            share = rise * ((end - begin) / (right - left)) if right > left else rise
            part = share * (0.5 * (begin + end) - column)
            acc[row, column + 1] += part
            acc[row, column] += share - part
        tables[REACH, 0, row] = min(tables[REACH, 0, row], first)
        tables[REACH, 1, row] = max(tables[REACH, 1, row], last)
        row += 1
        if row >= high:
            break


@kernel()
def _add_piece_pixels(
    acc: Floats, tables: Floats, discs: Floats, edges: Floats, piece: Floats, at_x: float, at_y: float,
    middle_x: float, middle_y: float, pixel: float,
) -> None:  # fmt: skip
    """Add a piece of a boundary (`pieces.bound`); (at_x, at_y) is where (middle_x, middle_y) lies, in pixels."""
    k = int(piece[1])
    start = piece[2]
    stop = piece[3]
    if piece[0] == ARC:
        dx = at_x + (discs[k, 0] - middle_x) / pixel
        dy = at_y + (discs[k, 1] - middle_y) / pixel
        _add_arc_pixels(acc, tables, dx, dy, discs[k, 2] / pixel, start, stop)
        return
    dx = at_x + (edges[k, X] - middle_x) / pixel
    dy = at_y + (edges[k, Y] - middle_y) / pixel
    wide = edges[k, DX] / pixel
    high = edges[k, DY] / pixel
    _add_edge_pixels(acc, tables, dx + start * wide, dy + start * high, dx + stop * wide, dy + stop * high)


@kernel()
def _box_of(polygon: Floats) -> tuple[float, float, float, float]:
    """Least and largest x, then y, of a polygon (M, 2)."""
    low_x, high_x, low_y, high_y = math.inf, -math.inf, math.inf, -math.inf
    for m in range(len(polygon)):
        low_x = min(low_x, polygon[m, 0])
        high_x = max(high_x, polygon[m, 0])
        low_y = min(low_y, polygon[m, 1])
        high_y = max(high_y, polygon[m, 1])
    return low_x, high_x, low_y, high_y


@kernel()
def _settle(acc: Floats, tables: Floats, image: Image, row: int, column: int, rows: int, columns: int) -> None:
    """Add a part's sums to the image, where it begins at a row and a column, and clear them."""
    height, width = image.shape
    first = max(0, -column)
    last = min(columns, width - column) - 1
    for j in range(rows):
        total = 0.0
        if 0 <= row + j < height:
            end = int(tables[REACH, 1, j])
            for i in range(end, last, -1):
                total += acc[j, i + 1]
            for i in range(min(end, last), max(int(tables[REACH, 0, j]), first) - 1, -1):
                total += acc[j, i + 1]
                image[row + j, column + i] += min(max(total, 0.0), 1.0)
        for i in range(columns + 1):
            acc[j, i] = 0.0


@kernel()
def coverage(
    axes: Floats,
    centres: Floats,
    radii: Floats,
    corners: Floats,
    origin_x: float,
    origin_y: float,
    pixel: float,
    first_row: int,
    first_column: int,
    side: int,
    image: Image,
) -> None:
    """Add to `image` the share of each pixel that the common parts cover.

    Parameters
    ----------
    axes, centres, radii
        Microlens axes (n, 2) on the sensor, discs relative to them (n, K, 2) and (n, K) [mm].
    corners
        Polygons relative to them (n, P, M, 2) [mm].
    origin_x, origin_y, pixel
        Outer corner of pixel (0, 0) of the sensor, and pixel pitch [mm].
    first_row, first_column
        Which pixel of the sensor ``image[0, 0]`` is.
    side
        Pixels that are enough for any of the parts, four more than its width.
    """
    n, count = radii.shape
    height, width = image.shape
    discs = np.empty((count, 4))
    arcs = np.empty((count * count, 5))
    acc = np.zeros((side, side + 1))
    # Few arrays, as each costs a little at every call of a kernel.
    tables = np.empty((3, 2, side + BLOCK))
    most = corners.shape[1] * corners.shape[2]
    edges = np.empty((most, EDGE))
    work = np.empty((count + 2 * most + 3, 2))
    pieces = np.empty((count * count + (count + 1) * (2 * most + 1), PIECE))
    for s in range(n):
        middle_x = centres[s, 0, 0] if count > 0 else corners[s, 0, 0, 0]
        middle_y = centres[s, 0, 1] if count > 0 else corners[s, 0, 0, 1]
        at_x = (axes[s, 0] - origin_x + middle_x) / pixel
        at_y = (axes[s, 1] - origin_y + middle_y) / pixel
        column = math.floor(at_x)
        row = math.floor(at_y)
        at_x -= column
        at_y -= row
        # Box around the part: common to the boxes around the discs.
        left = -math.inf
        right = math.inf
        bottom = -math.inf
        top = math.inf
        for k in range(count):
            discs[k, 0] = centres[s, k, 0]
            discs[k, 1] = centres[s, k, 1]
            discs[k, 2] = radii[s, k]
            dx = at_x + (centres[s, k, 0] - middle_x) / pixel
            dy = at_y + (centres[s, k, 1] - middle_y) / pixel
            size = radii[s, k] / pixel
            left = max(left, dx - size)
            right = min(right, dx + size)
            bottom = max(bottom, dy - size)
            top = min(top, dy + size)
        sides = 0
        for p in range(corners.shape[1]):
            low_x, high_x, low_y, high_y = _box_of(corners[s, p])
            left = max(left, at_x + (low_x - middle_x) / pixel)
            right = min(right, at_x + (high_x - middle_x) / pixel)
            bottom = max(bottom, at_y + (low_y - middle_y) / pixel)
            top = min(top, at_y + (high_y - middle_y) / pixel)
            sides = lay_edges(corners[s, p], p, edges, sides)
        if not (right > left and top > bottom):
            continue
        left_column = math.floor(left - ROOM)
        low_row = math.floor(bottom - ROOM)
        columns = math.floor(right + ROOM) + 1 - left_column
        rows = math.floor(top + ROOM) + 1 - low_row
        column += left_column - first_column
        row += low_row - first_row
        if column >= width or row >= height or column + columns <= 0 or row + rows <= 0:
            continue
        found = bound(discs, arcs, edges, sides, work, pieces)
        for j in range(rows):
            tables[REACH, 0, j] = columns
            tables[REACH, 1, j] = -1.0
        for p in range(found):
            _add_piece_pixels(
                acc, tables, discs, edges, pieces[p], at_x - left_column, at_y - low_row, middle_x, middle_y, pixel
            )
        _settle(acc, tables, image, row, column, rows, columns)


@kernel(parallel=True)
def coverage_bands(
    axes: Floats,
    centres: Floats,
    radii: Floats,
    corners: Floats,
    origin_x: float,
    origin_y: float,
    pixel: float,
    first_row: int,
    first_column: int,
    side: int,
    image: Image,
    bands: int,
    band: Band = WHOLE,
) -> None:
    """`coverage` by horizontal bands of the image, one thread each: the same image to the last bit."""
    height = image.shape[0]
    for b in prange(bands, band):
        low = height * b // bands
        high = height * (b + 1) // bands
        coverage(
            axes, centres, radii, corners, origin_x, origin_y, pixel, first_row + low, first_column, side,
            image[low:high],
        )  # fmt: skip
