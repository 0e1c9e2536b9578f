"""Checkerboard corners: OpenCV finds the board in a view, fitted saddles place its corners in all of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import kernel
from ..theory.lens_shapes import LENS_SHAPES
from .decoding import LightField
from .frames import Array, CalibrationError
from .model import LEAST_CELLS, MOST_CELLS, Board, Markers, Observations

_LARGE = 800
"""Views with a short side of fewer pixels are searched doubled as well, where small boards are found better."""
_WORST = 0.35
"""Misfit, against the contrast, above which a corner is not believed."""
_UNLIKE = 4.0
"""Ratio of a corner's misfit to the median over its board above which the corner of a board partly seen is not
believed."""
_STRAY = 0.06
"""Largest RMS distance of corners from a plane in perspective, in cells: distortion stays below, wrong grids above."""
LEAST_CELL = 5.0
"""Side of a cell [microlenses] from which on its corners are counted on; all of drawn boards are found down to 4."""
_LEAST = 6
"""Corners of a board with markers that must be seen in the central view."""
_MOST_VIEWS, _LEAST_LIGHT = 100, 0.85
"""Views are left out where they, or a view one pixel beside them, have less light than this share of the pupil's
middle, or that over this share, in the middle of the array: those at the rim of the pupil, where images overlap."""


class _FoundCorners(NamedTuple):
    """A board's corners in one picture."""

    corners: Array
    """Columns and rows, shape (n, 2); NaN where a corner could not be placed."""
    contrast: Array
    """Half the step from dark to bright cells there, signed by the corner's colours, shape (n,)."""


def find_corners(picture: ArrayLike, board: Board, weight: ArrayLike | None = None) -> _FoundCorners | None:
    """Inner corners of a checkerboard to a hundredth of a pixel or two.

    OpenCV's sector-based detector finds the board; what it found is checked against the board's plane and colours;
    each corner is then placed by a fitted saddle (`fit_saddles`). Of a board with markers these tell which corners are
    which, and those in sight are enough.

    `picture` is grey, shape (rows, columns); pixels of `weight` 0 say nothing. Corners come in the order of
    `Board.points`, up to half a turn where the board's colours do not tell (an even sum of cells across and down), or a
    quarter (as many across as down). None where no board is seen.
    """
    import cv2 as cv

    pixels, known = _pixels(picture, weight)
    grey = _eight_bit(pixels, known)
    if board.markers is not None:
        return _find_by_markers(pixels, known, grey, board, board.markers)
    fast, thorough = cv.CALIB_CB_ACCURACY, cv.CALIB_CB_ACCURACY | cv.CALIB_CB_EXHAUSTIVE | cv.CALIB_CB_NORMALIZE_IMAGE
    small = min(grey.shape) < _LARGE
    tries = [(1, fast), (2, fast), (1, thorough), (2, thorough)] if small else [(1, fast), (1, thorough)]
    for scale, flags in tries:
        view = grey if scale == 1 else cv.resize(grey, None, fx=scale, fy=scale, interpolation=cv.INTER_CUBIC)
        detected, corners = cv.findChessboardCornersSB(view, board.inner, flags=flags)
        if not detected:
            continue
        rough = (np.asarray(corners, float).reshape(-1, 2) + 0.5) / scale - 0.5
        checked = _checked_grid(rough, board, grey.astype(float))
        if checked is None:
            continue
        saddles = _placed(pixels, known, checked, checked, board)
        typical = float(np.median(np.abs(saddles.contrast)))
        believed = _believed(saddles, checked, board, np.sign(saddles.contrast) * typical)
        if believed.sum() >= 4:  # what the others' places follow from
            return _FoundCorners(np.where(believed[:, None], saddles.corners, np.nan), saddles.contrast)
    return None


def cells_of(picture: ArrayLike) -> tuple[int, int] | None:
    """Cells across and down of whatever checkerboard a picture shows; None where none is seen."""
    import cv2 as cv

    grey = _eight_bit(*_pixels(picture, None))
    least = (LEAST_CELLS - 1, LEAST_CELLS - 1)
    flags = cv.CALIB_CB_LARGER | cv.CALIB_CB_ACCURACY | cv.CALIB_CB_EXHAUSTIVE | cv.CALIB_CB_NORMALIZE_IMAGE
    for scale in (1, 2) if min(grey.shape) < _LARGE else (1,):
        view = grey if scale == 1 else cv.resize(grey, None, fx=scale, fy=scale, interpolation=cv.INTER_CUBIC)
        detected, _, cells = cv.findChessboardCornersSBWithMeta(view, least, flags)
        if detected:
            down, across = np.shape(cells)[:2]
            if max(across, down) < MOST_CELLS and find_corners(picture, Board(across + 1, down + 1, 1.0)) is not None:
                return across + 1, down + 1
    return None


def _find_by_markers(
    pixels: Array, known: NDArray[np.bool_], grey: NDArray[np.uint8], board: Board, markers: Markers
) -> _FoundCorners | None:
    """Corners of a board of which part is seen; NaN elsewhere."""
    import cv2 as cv

    dictionary = cv.aruco.getPredefinedDictionary(getattr(cv.aruco, markers.dictionary))
    detector = cv.aruco.CharucoDetector(
        cv.aruco.CharucoBoard((board.columns, board.rows), board.cell, markers.width, dictionary)
    )
    rough = np.full((len(board.points), 2), np.nan)
    for scale in (1, 2, 4) if min(grey.shape) < _LARGE else (1, 2):
        view = grey if scale == 1 else cv.resize(grey, None, fx=scale, fy=scale, interpolation=cv.INTER_CUBIC)
        corners, ids = detector.detectBoard(view)[:2]
        if ids is not None and len(ids) > np.isfinite(rough[:, 0]).sum():
            rough[:] = np.nan
            rough[ids.ravel()] = (np.asarray(corners, float).reshape(-1, 2) + 0.5) / scale - 0.5
    named = np.isfinite(rough[:, 0])
    if not _spans_plane(named, board):
        return None
    plane = board.points[:, :2]
    ideal = _mapped(homography(plane[named], rough[named]), plane)
    if float(np.sqrt(np.square(rough - ideal)[named].sum(axis=1).mean())) > _STRAY * _cell(ideal, board):
        return None
    saddles = _placed(pixels, known, ideal, ideal, board)
    colours = 1 - 2 * (np.indices(board.inner[::-1]).sum(axis=0).ravel() % 2)
    contrast = colours * float(np.median((colours * saddles.contrast)[named]))
    believed = _believed(saddles, ideal, board, contrast)
    if not _spans_plane(believed, board):
        return None
    # Corners that come into sight in other views only are measured by the contrast they should have.
    return _FoundCorners(
        np.where(believed[:, None], saddles.corners, np.nan), np.where(believed, saddles.contrast, contrast)
    )


def _spans_plane(visible: NDArray[np.bool_], board: Board) -> bool:
    """Whether corners suffice for a homography: two rows of two or more, and some to check it by."""
    return bool(visible.sum() >= _LEAST and (visible.reshape(board.inner[::-1]).sum(axis=1) >= 2).sum() >= 2)


def observe(
    fields: Mapping[str, LightField] | Iterable[tuple[str, LightField]],
    board: Board,
    most_views: int = _MOST_VIEWS,
    *,
    lens_shape: str = "square",
) -> Observations:
    """Corners of one board in the views of several light fields.

    The board is searched in the central view and followed from there from view to view, outwards.

    Parameters
    ----------
    fields : mapping or iterable of (name, LightField)
        Light fields by name, decoded with the same lattice; an iterable need hold only one at a time.
    most_views : int
        Views used: the central one and those evenly spread around it.
    lens_shape : str
        Whether microlenses are round.

    Returns
    -------
    Observations
        Of the images in which the central view shows the board; the others are named in `missing`.

    Raises
    ------
    CalibrationError
        No image shows the board, or the light fields differ in size.
    """
    chosen: list[tuple[int, int]] = []
    names, missing, uv = [], [], []
    shape, views = None, np.zeros((0, 2))
    for name, field in fields.items() if isinstance(fields, Mapping) else fields:
        if shape is None:
            shape, chosen = field.values.shape, _chosen_views(field, most_views)
            views = np.array([(field.s[i], field.t[j]) for i, j in chosen])
        elif field.values.shape != shape:
            raise CalibrationError(
                f"the light field of {name} differs in size from the others: decode all with one lattice"
            )
        central = find_corners(field.view(), board, field.view_weight())
        if central is None:
            missing.append(name)
        else:
            names.append(name)
            places = _followed(field, board, central, chosen, views, lens_shape)
            uv.append(np.stack(field.position(places[..., 0], places[..., 1]), axis=-1))
        del field  # before the next is decoded
    if shape is None:
        raise CalibrationError("no images of the board were given")
    if not names:
        raise CalibrationError(
            f"no board of {board.columns} x {board.rows} cells ({board.inner[0]} x {board.inner[1]} inner corners) was"
            f" found in any of the images: {', '.join(missing)}; check the board, light and focus"
        )
    return Observations(board.points, views, np.array(uv), tuple(names), tuple(missing))


def observe_pictures(pictures: Mapping[str, ArrayLike] | Sequence[ArrayLike], board: Board) -> Observations:
    """Corners of one board in ordinary pictures, or central views decoded elsewhere: one view, (s', t') = (0, 0).

    Pictures are grey, by name or numbered; u and v are then columns and rows [px].

    Raises
    ------
    CalibrationError
        No picture shows the board.
    """
    named = pictures if isinstance(pictures, Mapping) else {f"picture {k + 1}": p for k, p in enumerate(pictures)}
    looked = {name: find_corners(picture, board) for name, picture in named.items()}
    corners = {name: at.corners for name, at in looked.items() if at is not None}
    missing = tuple(name for name in looked if name not in corners)
    if not corners:
        raise CalibrationError(f"no board of {board.columns} x {board.rows} cells was found in: {', '.join(missing)}")
    return Observations(
        board.points, np.zeros((1, 2)), np.stack(list(corners.values()))[:, None], tuple(corners), missing
    )


def _chosen_views(field: LightField, most: int) -> list[tuple[int, int]]:
    """Indices (i of s, j of t) of views inside the pupil's image: an even grid through the central view.

    At the rim a sample mixes lit pixels with dark ones or a neighbour's: it looks from further inside than its (s, t)
    says, by up to half a pixel, and slopes through it are too small by several per cent.

    Raises
    ------
    CalibrationError
        No view but the central one is left of many.
    """
    v, u = len(field.v) // 2, len(field.u) // 2
    reach_v, reach_u = max(1, len(field.v) // 8), max(1, len(field.u) // 8)
    light = np.median(field.weight[:, :, v - reach_v : v + reach_v + 1, u - reach_u : u + reach_u + 1], axis=(2, 3))
    # Not the brightest: that is where neighbours' images overlap.
    middle = light[np.hypot(*np.meshgrid(field.s, field.t)) <= max(field.pitch / 4, np.abs(field.s).min())]
    light = light / max(float(np.median(middle)), 1e-30)
    light, over = np.minimum(light, 1 / np.maximum(light, 1e-30)), bool((light > 1 / _LEAST_LIGHT).any())
    if len(field.s) > 1 and max(np.diff(field.s).max(), np.diff(field.t).max()) < 1.5:
        whole = max(field.s.max(), field.t.max()) < field.pitch / 2 - 1  # all views asked for lie inside
        around = np.pad(light, 1, mode="edge") if whole else np.pad(light, 1)
        light = np.lib.stride_tricks.sliding_window_view(around, (3, 3)).min(axis=(2, 3))
    ci, cj = int(np.argmin(np.abs(field.s))), int(np.argmin(np.abs(field.t)))
    for step in range(1, len(field.s) + 1):
        columns = [i for i in range(len(field.s)) if (i - ci) % step == 0]
        rows = [j for j in range(len(field.t)) if (j - cj) % step == 0]
        chosen = [(i, j) for j in rows for i in columns if light[j, i] >= _LEAST_LIGHT or (i, j) == (ci, cj)]
        if len(chosen) <= most:
            break
    if len(chosen) == 1 < min(most, len(field.s)):
        cause, remedy = ("overlap", "narrow the aperture") if over else ("are too small", "open the aperture")
        raise CalibrationError(
            f"one view alone is lit evenly, and d_2 and m need several: microlens images, {field.pitch:.1f} px apart,"
            f" {cause}; {remedy}, or take smaller pixels"
        )
    return chosen


def _followed(
    field: LightField,
    board: Board,
    central: _FoundCorners,
    chosen: list[tuple[int, int]],
    views: Array,
    lens_shape: str,
) -> Array:
    """Columns and rows of the corners in each chosen view, shape (v, n, 2); NaN where not placed."""
    start, step, rows = _completed(central.corners, board), field.u[1] - field.u[0], field.hexagonal
    foot = LENS_SHAPES[lens_shape].rule(1 / step)
    grid = None if rows is None else _RowGrid((rows.starts - field.u[0]) / step, 1 / step)
    values, weight = (field.values, field.weight) if rows is None else rows[:2]
    places = np.full((len(chosen), len(start), 2), np.nan)
    lever = drift = 0.0
    for k in np.argsort(np.hypot(*views.T), kind="stable"):
        i, j = chosen[k]
        expected = start + (drift / lever if lever > 0 else 0.0) * views[k]
        saddles = _placed(*_pixels(values[j, i], weight[j, i]), expected, start, board, foot, grid)
        believed = _believed(saddles, expected, board, central.contrast)
        if believed.sum() < 4:
            continue
        places[k] = np.where(believed[:, None], saddles.corners, np.nan)
        moved = (saddles.corners - start)[believed].mean(axis=0)
        lever, drift = lever + float(views[k] @ views[k]), drift + float(views[k] @ moved)
    return places


def _placed(
    pixels: Array,
    known: NDArray[np.bool_],
    start: Array,
    shape: Array,
    board: Board,
    foot: Array | None = None,
    rows: _RowGrid | None = None,
) -> _Saddles:
    """Saddles from `start`, with edges and window as the grid `shape` has them."""
    grid = shape.reshape(*board.inner[::-1], 2)
    steps = [np.asarray(np.gradient(grid, axis=k)).reshape(-1, 2) for k in (1, 0)]
    edges = np.column_stack([np.arctan2(step[:, 1], step[:, 0]) for step in steps])
    if board.markers is not None:
        known = known & ~_on_markers(start, board, board.markers, known.shape, rows)
    return fit_saddles(pixels, known, start, edges, _window(shape, board), foot, rows)


def _on_markers(
    corners: Array, board: Board, markers: Markers, shape: tuple[int, int], rows: _RowGrid | None
) -> NDArray[np.bool_]:
    """Samples on markers or, blurred, beside them: up to a pixel, or half the way to the cell's edge."""
    starts, spacing = (np.zeros(shape[0]), 1.0) if rows is None else rows
    columns = starts[:, None] + spacing * np.arange(shape[1])
    places = np.stack([columns, np.broadcast_to(np.arange(shape[0])[:, None], shape)], axis=-1).reshape(-1, 2)
    cells = _mapped(homography(corners, board.points[:, :2] / board.cell), places)
    cells += np.array([board.columns, board.rows]) / 2  # from the board's outer corner
    whole = np.floor(cells)
    margin = (1 - markers.width / board.cell) / 2
    reach = 0.5 - margin + min(1 / _cell(corners, board), margin / 2)
    inside = (whole >= 0).all(axis=1) & (whole < (board.columns, board.rows)).all(axis=1)
    bright = whole.sum(axis=1) % 2 == 1
    return np.asarray((inside & bright & (np.abs(cells - whole - 0.5) < reach).all(axis=1)).reshape(shape))


def fit_window(corners: Array, board: Board) -> tuple[tuple[float, float], int]:
    """Mean directions [rad] of a board's edges across and down, and how far the windows of its corners reach [px].

    `corners` are columns and rows, shape (n, 2); NaN where not placed.
    """
    grid = _completed(corners, board).reshape(*board.inner[::-1], 2)
    steps = [np.diff(grid, axis=k).reshape(-1, 2).mean(axis=0) for k in (1, 0)]
    across, down = (float(np.arctan2(step[1], step[0])) for step in steps)
    return (across, down), _window(grid.reshape(-1, 2), board)


def _window(corners: Array, board: Board) -> int:
    return int(np.clip(round(0.45 * _cell(corners, board)), 3, 8))


def _cell(corners: Array, board: Board) -> float:
    """Smaller side of a cell in the picture [px]."""
    grid = corners.reshape(*board.inner[::-1], 2)
    return float(min(np.hypot(*np.moveaxis(np.diff(grid, axis=k), -1, 0)).min() for k in (0, 1)))


def _believed(saddles: _Saddles, expected: Array, board: Board, contrast: Array) -> NDArray[np.bool_]:
    """Corners that settled near where they were expected, with the contrast expected, and look like one."""
    near = np.hypot(*(saddles.corners - expected).T) < max(1.0, 0.25 * _cell(expected, board))
    alike = saddles.contrast * np.sign(contrast) > 0.3 * np.abs(contrast)
    believed = saddles.settled & near & alike & (saddles.misfit < _WORST)
    if board.markers is not None and believed.any():  # the edge of what hides the rest may cross a corner's window
        believed &= saddles.misfit < max(0.05, _UNLIKE * float(np.median(saddles.misfit[believed])))
    return np.asarray(believed)


def _completed(corners: Array, board: Board) -> Array:
    """Corners with the missing ones put where the board's plane has them."""
    missing = np.isnan(corners[:, 0])
    if not missing.any():
        return corners
    plane = board.points[:, :2]
    return np.where(missing[:, None], _mapped(homography(plane[~missing], corners[~missing]), plane), corners)


def homography(plane: Array, image: Array) -> Array:
    """Homography (3, 3) from points of a plane to an image, shapes (n, 2), n >= 4; to single precision.

    Raises
    ------
    CalibrationError
        All points in one line.
    """
    import cv2

    matrix = cv2.findHomography(plane, image)[0]
    if matrix is None:
        raise CalibrationError("the corners seen of a board lie in one line: its plane cannot be determined")
    return np.asarray(matrix, float)


def _mapped(matrix: Array, points: Array) -> Array:
    import cv2

    return np.asarray(cv2.perspectiveTransform(np.ascontiguousarray(points[None], float), matrix)[0])


def _pixels(picture: ArrayLike, weight: ArrayLike | None) -> tuple[Array, NDArray[np.bool_]]:
    """Pixels as float64, the unknown ones at the median, and which are known."""
    pixels = np.asarray(picture, float)
    known = np.isfinite(pixels) if weight is None else np.isfinite(pixels) & (np.asarray(weight) > 0)
    middle = float(np.median(pixels[known])) if known.any() else 0.0
    return np.where(known, pixels, middle), known


def _eight_bit(pixels: Array, known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    if not known.any():
        return np.zeros(pixels.shape, np.uint8)
    low, high = np.quantile(pixels[known], (0.005, 0.995))
    grey = (pixels - low) / (high - low if high > low else 1.0)
    return np.asarray(np.clip(np.round(20 + 215 * grey), 0, 255), np.uint8)


# --- is it really the board? ------------------------------------------------------------------------------------------


def _checked_grid(corners: Array, board: Board, picture: Array) -> Array | None:
    """Corners in the order of `Board.points`, or None where they fit no plane or the cells do not alternate.

    `corners` are columns and rows, shape (n, 2), as a detector orders them; the result is turned from across to down as
    the board's points are (some detectors mirror boards). Of the two orders half a turn apart it is the one whose first
    cell is dark, where the board's colours tell them apart: an odd sum of cells across and down.
    """
    across, down = board.inner
    grid = corners.reshape(down, across, 2)
    along, downward = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * downward[1] - along[1] * downward[0] < 0:
        grid = grid[:, ::-1]
    places = np.stack(np.meshgrid(np.arange(across), np.arange(down)), axis=-1).reshape(-1, 2).astype(float)
    flat = np.ascontiguousarray(grid.reshape(-1, 2))
    matrix = homography(places, flat)
    size = float(np.sqrt(abs(along[0] * downward[1] - along[1] * downward[0]) / ((across - 1) * (down - 1))))
    stray = _mapped(matrix, places) - flat
    if not size > 2 or float(np.sqrt(np.square(stray).sum(axis=1).mean())) > _STRAY * size:
        return None
    contrast = _contrast(_cell_levels(matrix, board, picture))
    if contrast is None:
        return None
    turned = (board.columns + board.rows) % 2 == 1 and contrast > 0
    return flat[::-1] if turned else flat


def _cell_levels(matrix: Array, board: Board, picture: Array) -> Array:
    """Mean grey level of the inner quarter of each cell, shape (rows, columns); NaN outside the picture."""
    offset = np.array([-0.2, 0.0, 0.2])
    x = np.arange(board.columns)[:, None] - 0.5 + offset
    y = np.arange(board.rows)[:, None] - 0.5 + offset
    grid = np.stack(np.broadcast_arrays(x[None, :, None, :], y[:, None, :, None]), axis=-1).reshape(-1, 2)
    place = np.round(_mapped(matrix, grid)).astype(int)
    rows, columns = picture.shape
    inside = (place[:, 0] >= 0) & (place[:, 0] < columns) & (place[:, 1] >= 0) & (place[:, 1] < rows)
    level = np.where(inside, picture[np.clip(place[:, 1], 0, rows - 1), np.clip(place[:, 0], 0, columns - 1)], np.nan)
    return np.asarray(level.reshape(board.rows, board.columns, 9).mean(axis=2))


def _contrast(cells: Array) -> float | None:
    """Mean level of cells like the first minus that of the others; None unless each stands out from its neighbours."""
    parity = 1 - 2 * (np.indices(cells.shape).sum(axis=0) % 2)
    padded = np.pad(cells, 1, constant_values=np.nan)
    around = np.ma.masked_invalid([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    step = (parity * (np.ma.masked_invalid(cells) - around.mean(axis=0))).compressed()
    if step.size < 0.8 * cells.size:
        return None
    middle = float(np.median(step))
    return middle if (step * np.sign(middle) > 0.25 * abs(middle)).all() and middle != 0 else None


# --- fitted saddles ---------------------------------------------------------------------------------------------------

_ROUNDS = 30
_BLUR = (0.15, 4.0)
"""Least and most blur (standard deviation) of an edge, besides the sample's own width [px]."""


class _RowGrid(NamedTuple):
    """Where a picture's samples stand, in rows one view pixel apart."""

    starts: Array
    """Column of each row's first sample [view px], shape (rows,)."""
    spacing: float
    """Distance from sample to sample [view px]."""


class _Saddles(NamedTuple):
    """Fitted corners."""

    corners: Array
    """Columns and rows, shape (n, 2)."""
    contrast: Array
    """Half the difference between bright and dark cells, its sign the corner's colours, shape (n,)."""
    misfit: Array
    """RMS difference between picture and model over the window, against the contrast, shape (n,)."""
    settled: NDArray[np.bool_]
    """Corners whose fit came to rest inside its window, with most of the window known."""


def fit_saddles(
    picture: Array,
    known: NDArray[np.bool_],
    corners: Array,
    edges: Array,
    half: int,
    foot: Array | None = None,
    rows: _RowGrid | None = None,
) -> _Saddles:
    """Fit ``level + slopes + contrast erf(a/w) erf(b/w)`` around each corner, a and b distances from two edges.

    Nine parameters by Levenberg-Marquardt. Each sample is the mean of the model over `foot` (by default its square), as
    a microlens averages what its aperture sees; a model taken at the sample's middle is off by up to 0.1 px where edges
    are sharp and run along the rows. On drawn views of a board with 1 % noise this errs by 0.007 px RMS, OpenCV's
    detector by 0.092, its cornerSubPix by 0.045.

    `known` (rows, columns) are the pixels to fit; `corners` (n, 2) columns and rows to start from, within about a
    pixel; `edges` (n, 2) the directions of the two edges [rad]. Windows reach `half` pixels to each side, weighted by a
    Gaussian of 0.6 of that. With `rows` samples stand where those say, as in a hexagonal array: interpolated to a
    square grid first, sharp edges alias, and corners are off by 0.03 pitches.
    """
    out = np.zeros((len(corners), 5))
    picture, corners, edges = (np.ascontiguousarray(part, float) for part in (picture, corners, edges))
    starts, spacing = (np.zeros(len(picture)), 1.0) if rows is None else rows
    foot = LENS_SHAPES["square"].rule(1.0) if foot is None else foot
    _fit.compiled(picture, np.ascontiguousarray(known), starts, spacing, foot, corners, edges, half, out)
    return _Saddles(out[:, :2], out[:, 2], out[:, 3], out[:, 4] > 0)


@kernel()
def _fit(
    picture: Array,
    known: NDArray[np.bool_],
    starts: Array,
    spacing: float,
    foot: Array,
    corners: Array,
    edges: Array,
    half: int,
    out: Array,
) -> None:
    rows, columns = picture.shape
    first, last = starts[0], starts[0]
    for row in range(1, rows):
        first, last = max(first, starts[row]), min(last, starts[row])
    last += (columns - 1) * spacing
    H, new_H, g, new_g, p = np.empty((9, 9)), np.empty((9, 9)), np.empty(9), np.empty(9), np.empty(9)
    # Whole arrays in one expression would be compiled ten times as long.
    normal, root, right, step, trial = np.empty((9, 9)), np.empty((9, 9)), np.empty(9), np.empty(9), np.empty(9)
    for n in range(corners.shape[0]):
        cx, cy = math.floor(corners[n, 0] + 0.5), math.floor(corners[n, 1] + 0.5)
        out[n, 0], out[n, 1], out[n, 2], out[n, 3], out[n, 4] = corners[n, 0], corners[n, 1], 0.0, 1.0, 0.0
        if cx < first + half or cy < half or cx > last - half or cy >= rows - half:
            continue
        p[0], p[1], p[2], p[3], p[4] = corners[n, 0] - cx, corners[n, 1] - cy, edges[n, 0], edges[n, 1], 0.8
        p[6], p[7] = 0.0, 0.0
        low, high, whole, covered = 1e300, -1e300, 0.0, 0.0
        for y in range(-half, half + 1):
            start = starts[cy + y] - cx
            for k in range(math.ceil((-half - start) / spacing), math.floor((half - start) / spacing) + 1):
                x = start + k * spacing
                w = math.exp(-0.5 * (x * x + y * y) / (0.36 * half * half))
                whole += w
                if known[cy + y, k]:
                    covered += w
                    low, high = min(low, picture[cy + y, k]), max(high, picture[cy + y, k])
        if covered < 0.6 * whole or high <= low:
            continue
        p[5] = 0.5 * (low + high)
        # The sign of the contrast: the model against the picture at the start; one misfit tells that of both.
        p[8] = 0.5 * (high - low)
        cost = _misfit(picture, known, starts, spacing, foot, cx, cy, half, p, H, g)
        if 4.0 * p[8] * (g[8] + p[8] * H[8, 8]) <= 0.0:
            p[8] = -p[8]
            cost = _misfit(picture, known, starts, spacing, foot, cx, cy, half, p, H, g)
        damping, moved, rest = 1e-2, 1e300, False
        for _ in range(_ROUNDS):
            largest = H[0, 0]
            for r in range(9):
                largest = max(largest, H[r, r])
            # A floor on the damping keeps the system solvable where a parameter has no effect.
            for r in range(9):
                for c in range(9):
                    normal[r, c] = H[r, c] + H[c, r]
                normal[r, r] += (damping - 1.0) * H[r, r] + 1e-12 * damping * largest
            _solve(normal, g, root, step)
            sharper = min(max(p[4] + step[4], _BLUR[0]), _BLUR[1]) - p[4]
            if sharper != step[4]:
                # The blur goes to its limit, the others where they fit best with it.
                for r in range(9):
                    right[r] = g[r] - normal[r, 4] * sharper
                    normal[r, 4], normal[4, r] = 0.0, 0.0
                normal[4, 4], right[4] = 1.0, sharper
                _solve(normal, right, root, step)
            for k in range(9):
                trial[k] = p[k] + (min(max(step[k], -0.7), 0.7) if k < 5 else step[k])
            trial[4] = min(max(trial[4], _BLUR[0]), _BLUR[1])
            moved = max(abs(step[0]), abs(step[1]))
            cost_now = _misfit(picture, known, starts, spacing, foot, cx, cy, half, trial, new_H, new_g)
            if cost_now < cost:
                rest = moved < 1e-3 and cost - cost_now < 1e-4 * cost_now
                damping, cost = max(damping / 6.0, 1e-9), cost_now
                for r in range(9):
                    p[r], g[r] = trial[r], new_g[r]
                    for c in range(9):
                        H[r, c] = new_H[r, c]
            else:
                rest = moved < 1e-3
                damping *= 8.0
            if rest:
                break
        out[n, 0], out[n, 1], out[n, 2] = cx + p[0], cy + p[1], p[8]
        out[n, 3] = math.sqrt(cost / covered) / max(abs(p[8]), 1e-300)
        if (rest or moved < 0.01) and max(abs(p[0]), abs(p[1])) < 0.6 * half:
            out[n, 4] = 1.0


@kernel()
def _solve(normal: Array, right: Array, root: Array, step: Array) -> None:
    """Solution by Cholesky's root: numpy's would be compiled longer than all else here."""
    for r in range(9):
        step[r] = right[r]
        for c in range(r + 1):
            rest = normal[r, c]
            for k in range(c):
                rest -= root[r, k] * root[c, k]
            # Rounding may leave nothing of a parameter that others stand for.
            root[r, c] = math.sqrt(max(rest, 1e-16 * normal[r, r])) if r == c else rest / root[c, c]
        for c in range(r):
            step[r] -= root[r, c] * step[c]
        step[r] /= root[r, r]
    for r in range(8, -1, -1):
        for k in range(r + 1, 9):
            step[r] -= root[k, r] * step[k]
        step[r] /= root[r, r]


@kernel()
def _misfit(
    picture: Array,
    known: NDArray[np.bool_],
    starts: Array,
    spacing: float,
    foot: Array,
    cx: int,
    cy: int,
    half: int,
    p: Array,
    H: Array,
    g: Array,
) -> float:
    """Weighted square misfit, and into H and g the normal matrix, its lower half, and the right side."""
    sin_a, cos_a, sin_b, cos_b = math.sin(p[2]), math.cos(p[2]), math.sin(p[3]), math.cos(p[3])
    w = p[4]
    scale, norm = 1.0 / (math.sqrt(2.0) * w), math.sqrt(2.0 / math.pi) / w
    for r in range(9):
        g[r] = 0.0
        for c in range(9):
            H[r, c] = 0.0
    far = 0.0
    for n in range(foot.shape[0]):
        far = max(far, foot[n, 0] ** 2 + foot[n, 1] ** 2)
    # The corner of the square lies 1.3 times as far out as Gauss's outermost point.
    reach = 0.005 + math.sqrt(far / 0.6)
    d = np.empty(9)
    total = 0.0
    for y in range(-half, half + 1):
        start = starts[cy + y] - cx
        for n in range(math.ceil((-half - start) / spacing), math.floor((half - start) / spacing) + 1):
            if not known[cy + y, n]:
                continue
            x = start + n * spacing
            weight = math.exp(-0.5 * (x * x + y * y) / (0.36 * half * half))
            for r in range(5):
                d[r] = 0.0
            saddle = 0.0
            a0, b0 = cos_a * (y - p[1]) - sin_a * (x - p[0]), cos_b * (y - p[1]) - sin_b * (x - p[0])
            beyond_a, beyond_b = abs(a0) > 5.0 * w + reach, abs(b0) > 5.0 * w + reach
            sign_a, sign_b = (1.0 if a0 > 0.0 else -1.0), (1.0 if b0 > 0.0 else -1.0)
            if beyond_a and beyond_b:
                saddle = sign_a * sign_b
            for i in range(0 if beyond_a and beyond_b else foot.shape[0]):
                dx, dy, k = x + foot[i, 0] - p[0], y + foot[i, 1] - p[1], foot[i, 2]
                a, b = cos_a * dy - sin_a * dx, cos_b * dy - sin_b * dx
                ea = sign_a if beyond_a else math.erf(a * scale)
                eb = sign_b if beyond_b else math.erf(b * scale)
                saddle += k * ea * eb
                first = 0.0 if beyond_a else k * norm * math.exp(-0.5 * (a / w) ** 2) * eb
                second = 0.0 if beyond_b else k * norm * math.exp(-0.5 * (b / w) ** 2) * ea
                d[0] += first * sin_a + second * sin_b
                d[1] -= first * cos_a + second * cos_b
                d[2] -= first * (cos_a * dx + sin_a * dy)
                d[3] -= second * (cos_b * dx + sin_b * dy)
                d[4] -= (first * a + second * b) / w
            level = p[5] + p[6] * x / half + p[7] * y / half + p[8] * saddle
            rest = picture[cy + y, n] - level
            total += weight * rest * rest
            for r in range(5):
                d[r] *= p[8]
            d[5], d[6], d[7], d[8] = 1.0, x / half, y / half, saddle
            for r in range(9):
                g[r] += weight * d[r] * rest
                for c in range(r + 1):
                    H[r, c] += weight * d[r] * d[c]
    return total
