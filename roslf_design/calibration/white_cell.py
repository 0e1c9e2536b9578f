"""What the white image says of one microlens image: how large the pupil's disc is in it, and how blurred."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .decode import decode
from .errors import CalibrationError
from .frames import grey_frame
from .lattice import Array, CentreLattice
from .pupil_image import PupilImage

_HALF = 24
"""Microlenses to each side of the middle that are averaged."""


class WhiteCell(NamedTuple):
    """Mean light over a microlens's cell."""

    places: Array
    """Relative to the microlens image's centre [px], shape (n, 2)."""
    light: Array
    """Relative to its mean, shape (n,)."""


class CellFit(NamedTuple):
    """A pupil image fitted to a cell."""

    image: PupilImage
    misfit: float
    """RMS difference, relative to the mean."""
    sigma: tuple[float, float]
    """Standard deviations of radius and blur [px], judged by the misfit; blur's is 0 where it was held."""


def white_cell(white: ArrayLike, lattice: CentreLattice, dark: ArrayLike | None = None) -> WhiteCell:
    """Average the microlens images in the middle of the white image.

    Raises
    ------
    CalibrationError
        Less than three microlenses in the middle.
    """
    frame = grey_frame(white, dark, "white image")
    rows, columns = frame.shape
    reach = int(np.ceil((_HALF + 2) * lattice.pitch))
    top, left = max(0, rows // 2 - reach), max(0, columns // 2 - reach)
    piece = frame[top : rows // 2 + reach, left : columns // 2 + reach]
    i, j = np.round(lattice.indices([left + piece.shape[1] / 2, top + piece.shape[0] / 2])).astype(int)
    x, y = lattice.nodes(i, j)
    moved = CentreLattice((float(x) - left, float(y) - top), lattice.first, lattice.second, lattice.layout)
    # Without squaring: each microlens where it stands.
    square = CentreLattice(moved.origin, moved.first, moved.second, "square") if lattice.layout == "square" else moved
    field = decode(piece, square)
    whole = (field.weight > 0).all(axis=(0, 1))
    if whole.sum() < 3:
        raise CalibrationError("the middle of the white image holds too few whole microlens images")
    cell = field.values[:, :, whole].mean(axis=-1, dtype=float)
    s, t = np.meshgrid(field.s, field.t)
    return WhiteCell(np.stack([s.ravel(), t.ravel()], axis=-1), cell.ravel() / cell.mean())


def fit_cell(cell: WhiteCell, start: PupilImage, *, blurred: bool) -> CellFit:
    """Fit the disc's radius, and with `blurred` the blur, to a cell.

    Parameters
    ----------
    cell : WhiteCell
    start : PupilImage
        Expected; pitch, layout and the microlenses' shape are taken from it.
    blurred : bool
        Fit the blur as well; else there is none.
    """
    from dataclasses import replace

    from scipy.optimize import least_squares

    def image(x: Array) -> PupilImage:
        return replace(start, radius=float(x[0]), blur=float(x[1]) if blurred else 0.0)

    def off(x: Array) -> Array:
        light = image(x).cell(cell.places)
        return np.asarray(light / light.mean() - cell.light)

    size = 2 if blurred else 1
    low = np.array([0.1 * start.pitch, 0.01 * start.blur])[:size]
    high = np.array([start.pitch, 0.7 * start.pitch])[:size]
    tries = []
    for radius in (start.radius, 0.45 * start.pitch):  # a design of another camera starts far off
        first = np.clip(np.array([radius, start.blur])[:size], 1.01 * low, 0.99 * high)
        tries.append(least_squares(off, first, bounds=(low, high), x_scale=first))
    found = min(tries, key=lambda one: float(one.cost))
    freedom = len(cell.light) - len(found.x)
    slopes = np.asarray(found.jac, float)
    covariance = np.linalg.pinv(slopes.T @ slopes) * 2 * found.cost / freedom
    sigma = np.sqrt(np.diag(covariance))
    misfit = float(np.sqrt(2 * found.cost / freedom))
    return CellFit(image(found.x), misfit, (float(sigma[0]), float(sigma[1]) if blurred else 0.0))
