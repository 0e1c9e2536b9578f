"""Checkerboard corners: OpenCV finds the board in a view, fitted saddles place its corners in all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .board import Board, Observations
from .checkerboard import checked_grid
from .errors import CalibrationError, optional_module
from .lattice import Array
from .lightfield import LightField
from .saddle import Saddles, fit_saddles

_LARGE = 800
"""Views with a short side of fewer pixels are searched doubled as well, where small boards are found better."""
_WORST = 0.35
"""Misfit, against the contrast, above which a corner is not believed."""


class Found(NamedTuple):
    """A board's corners in one picture."""

    corners: Array
    """Columns and rows, shape (n, 2); NaN where a corner could not be placed."""
    contrast: Array
    """Half the step from dark to bright cells there, signed by the corner's colours, shape (n,)."""


def find_corners(picture: ArrayLike, board: Board, weight: ArrayLike | None = None) -> Found | None:
    """Inner corners of a checkerboard to a hundredth of a pixel or two.

    OpenCV's sector-based detector finds the board; what it found is checked against the board's plane and colours;
    each corner is then placed by a fitted saddle (`fit_saddles`).

    Parameters
    ----------
    picture : array_like
        Grey picture, shape (rows, columns).
    board : Board
    weight : array_like, optional
        Pixels of weight 0 say nothing.

    Returns
    -------
    Found or None
        In the order of `Board.points`; up to half a turn where the board's colours do not tell (an even sum of cells
        across and down), or a quarter (as many across as down). None where no board is seen.

    Raises
    ------
    MissingExtraError
        Without OpenCV.
    """
    cv = optional_module("cv2", "finding checkerboard corners")
    pixels, known = _pixels(picture, weight)
    grey = _eight_bit(pixels, known)
    fast, thorough = cv.CALIB_CB_ACCURACY, cv.CALIB_CB_ACCURACY | cv.CALIB_CB_EXHAUSTIVE | cv.CALIB_CB_NORMALIZE_IMAGE
    small = min(grey.shape) < _LARGE
    tries = [(1, fast), (2, fast), (1, thorough), (2, thorough)] if small else [(1, fast), (1, thorough)]
    for scale, flags in tries:
        view = grey if scale == 1 else cv.resize(grey, None, fx=scale, fy=scale, interpolation=cv.INTER_CUBIC)
        seen, corners = cv.findChessboardCornersSB(view, board.inner, flags=flags)
        if not seen:
            continue
        rough = (np.asarray(corners, float).reshape(-1, 2) + 0.5) / scale - 0.5
        checked = checked_grid(rough, board, grey.astype(float))
        if checked is None:
            continue
        saddles = _placed(pixels, known, checked, checked, board)
        typical = float(np.median(np.abs(saddles.contrast)))
        kept = _believed(saddles, checked, board, np.sign(saddles.contrast) * typical)
        return Found(np.where(kept[:, None], saddles.corners, np.nan), saddles.contrast)
    return None


def observe(
    fields: Mapping[str, LightField], board: Board, *, most_views: int = 100, least_weight: float = 0.85
) -> Observations:
    """Corners of one board in the views of several light fields.

    The board is searched in the central view and followed from there from view to view, outwards.

    Parameters
    ----------
    fields : mapping
        Light fields by name, decoded with the same lattice.
    board : Board
    most_views : int
        Views used: the central one and those evenly spread around it.
    least_weight : float
        Views are left out where they, or a view one pixel beside them, have less light than this share of the
        brightest, in the middle of the array: those at the rim of the pupil.

    Returns
    -------
    Observations
        Of the images in which the central view shows the board; the others are named in `missing`.

    Raises
    ------
    CalibrationError
        No image shows the board, or the light fields differ in size.
    """
    if not fields:
        raise CalibrationError("no images of the board were given")
    first = next(iter(fields.values()))
    for name, field in fields.items():
        if field.values.shape != first.values.shape:
            raise CalibrationError(
                f"the light field of {name} differs in size from the others: decode all with one lattice"
            )
    chosen = _chosen_views(first, most_views, least_weight)
    names, missing, uv = [], [], []
    for name, field in fields.items():
        central = find_corners(field.view(), board, field.view_weight())
        if central is None:
            missing.append(name)
            continue
        names.append(name)
        places = _followed(field, board, central, chosen)
        uv.append(np.stack(field.position(places[..., 0], places[..., 1]), axis=-1))
    if not names:
        raise CalibrationError(
            f"no board of {board.columns} x {board.rows} cells ({board.inner[0]} x {board.inner[1]} inner corners) was"
            f" found in any of the images: {', '.join(missing)}"
        )
    views = np.array([(first.s[i], first.t[j]) for i, j in chosen])
    return Observations(board.points, views, np.array(uv), tuple(names), tuple(missing))


def _followed(field: LightField, board: Board, central: Found, chosen: list[tuple[int, int]]) -> Array:
    """Columns and rows of the corners in each chosen view, shape (v, n, 2); NaN where not placed."""
    start = _completed(central.corners, board)
    views = np.array([(field.s[i], field.t[j]) for i, j in chosen])
    places = np.full((len(chosen), len(start), 2), np.nan)
    lever = drift = 0.0
    for k in np.argsort(np.hypot(*views.T), kind="stable"):
        i, j = chosen[k]
        expected = start + (drift / lever if lever > 0 else 0.0) * views[k]
        pixels, known = _pixels(field.values[j, i], field.weight[j, i])
        saddles = _placed(pixels, known, expected, start, board)
        kept = _believed(saddles, expected, board, central.contrast)
        if kept.sum() < 4:
            continue
        places[k] = np.where(kept[:, None], saddles.corners, np.nan)
        moved = (saddles.corners - start)[kept].mean(axis=0)
        lever, drift = lever + float(views[k] @ views[k]), drift + float(views[k] @ moved)
    return places


def _placed(pixels: Array, known: NDArray[np.bool_], start: Array, shape: Array, board: Board) -> Saddles:
    """Saddles from `start`, with edges and window as the grid `shape` has them."""
    across, down = board.inner
    grid = shape.reshape(down, across, 2)
    steps = [np.asarray(np.gradient(grid, axis=k)).reshape(-1, 2) for k in (1, 0)]
    edges = np.column_stack([np.arctan2(step[:, 1], step[:, 0]) for step in steps])
    return fit_saddles(pixels, known, start, edges, _window(shape, board))


def fit_window(corners: Array, board: Board) -> tuple[tuple[float, float], int]:
    """Mean directions [rad] of a board's edges across and down, and how far the windows of its corners reach [px].

    Parameters
    ----------
    corners : ndarray
        Columns and rows, shape (n, 2); NaN where not placed.
    board : Board
    """
    grid = _completed(corners, board).reshape(board.inner[1], board.inner[0], 2)
    steps = [np.diff(grid, axis=k).reshape(-1, 2).mean(axis=0) for k in (1, 0)]
    across, down = (float(np.arctan2(step[1], step[0])) for step in steps)
    return (across, down), _window(grid.reshape(-1, 2), board)


def _window(corners: Array, board: Board) -> int:
    return int(np.clip(round(0.45 * _cell(corners, board)), 3, 8))


def _believed(saddles: Saddles, expected: Array, board: Board, contrast: Array) -> NDArray[np.bool_]:
    """Corners that settled near where they were expected, with the contrast expected, and look like one."""
    near = np.hypot(*(saddles.corners - expected).T) < max(1.0, 0.25 * _cell(expected, board))
    alike = saddles.contrast * np.sign(contrast) > 0.3 * np.abs(contrast)
    kept: NDArray[np.bool_] = saddles.settled & near & alike & (saddles.misfit < _WORST)
    return kept


def _cell(corners: Array, board: Board) -> float:
    """Smaller side of a cell in the picture [px]."""
    grid = corners.reshape(board.inner[1], board.inner[0], 2)
    steps = [np.hypot(*np.moveaxis(np.diff(grid, axis=k), -1, 0)).min() for k in (0, 1)]
    return float(min(steps))


def _completed(corners: Array, board: Board) -> Array:
    """Corners with the missing ones put where the board's plane has them."""
    missing = np.isnan(corners[:, 0])
    if not missing.any():
        return corners
    from .homography import homography, mapped

    plane = board.points[:, :2]
    return np.where(missing[:, None], mapped(homography(plane[~missing], corners[~missing]), plane), corners)


def _chosen_views(field: LightField, most: int, least_weight: float) -> list[tuple[int, int]]:
    """Indices (i of s, j of t) of views inside the pupil's image: an even grid through the central view.

    At the rim a sample mixes lit pixels with dark ones or a neighbour's: it looks from further inside than its (s, t)
    says, by up to half a pixel, and slopes through it are too small by several per cent.
    """
    v, u = len(field.v) // 2, len(field.u) // 2
    reach_v, reach_u = max(1, len(field.v) // 8), max(1, len(field.u) // 8)
    light = np.median(field.weight[:, :, v - reach_v : v + reach_v + 1, u - reach_u : u + reach_u + 1], axis=(2, 3))
    light = light / max(float(light.max()), 1e-30)
    if len(field.s) > 1 and max(np.diff(field.s).max(), np.diff(field.t).max()) < 1.5:
        whole = max(field.s.max(), field.t.max()) < field.pitch / 2 - 1  # all views asked for lie inside
        around = np.pad(light, 1, mode="edge") if whole else np.pad(light, 1)
        light = np.lib.stride_tricks.sliding_window_view(around, (3, 3)).min(axis=(2, 3))
    ci, cj = int(np.argmin(np.abs(field.s))), int(np.argmin(np.abs(field.t)))
    for step in range(1, len(field.s) + 1):
        columns = [i for i in range(len(field.s)) if (i - ci) % step == 0]
        rows = [j for j in range(len(field.t)) if (j - cj) % step == 0]
        chosen = [(i, j) for j in rows for i in columns if light[j, i] >= least_weight or (i, j) == (ci, cj)]
        if len(chosen) <= most:
            break
    return chosen


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


def observe_pictures(pictures: Mapping[str, ArrayLike] | Sequence[ArrayLike], board: Board) -> Observations:
    """Corners of one board in ordinary pictures, or central views decoded elsewhere: one view, (s', t') = (0, 0).

    Parameters
    ----------
    pictures : mapping or sequence
        Grey pictures, by name or numbered; u and v are then columns and rows [px].
    board : Board

    Raises
    ------
    CalibrationError
        No picture shows the board.
    """
    named = pictures if isinstance(pictures, Mapping) else {f"picture {k + 1}": p for k, p in enumerate(pictures)}
    found = {name: find_corners(picture, board) for name, picture in named.items()}
    seen = {name: at.corners for name, at in found.items() if at is not None}
    missing = tuple(name for name in found if name not in seen)
    if not seen:
        raise CalibrationError(f"no board of {board.columns} x {board.rows} cells was found in: {', '.join(missing)}")
    return Observations(board.points, np.zeros((1, 2)), np.stack(list(seen.values()))[:, None], tuple(seen), missing)
