"""Disparity where none was measured, filled in from the known ones nearby, with the error that such a fill has."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP = 0.02
"""Difference over the picture's middle brightness across which neighbours hold together half as well."""
HELD_OUT = 5
"""Known places so near to unknown ones are held out to see how well a fill finds them: edges are as near to them, and
what is known about as far away."""
FEWEST, PARTS = 30, 8
"""Places held out that errors are judged by, at least, and parts of these, by how much known ones differ there."""
WITHIN = 0.68
"""Share of errors within a standard error."""
HARDER = 1.35
"""Errors of a fill over those of places held out whose known ones differ as much: what is unknown is harder than what
is known beside it. By rendered light fields whose disparities are known."""
FARTHEST = 16
"""Distance to the nearest known place beyond which nothing is filled in [places]."""


class DenseMap(NamedTuple):
    """Disparities everywhere, those known as they are."""

    disparity: Array
    """[pitches], shape (v, u); NaN where nothing known is near."""
    sigma: Array
    """Standard error; of those filled in as places held out have it."""
    held_out: float
    """Rms error of the fill at places that were held out; NaN where there are too few."""
    within: float
    """Share of these within the errors reported."""

    @classmethod
    def of(cls, disparity: Array, sigma: Array, known: Flags, picture: Array) -> DenseMap:
        """Fill between known ones: each place the mean of its neighbours, those of like brightness the more.

        The value is the mean of the known ones that a random walk from the place meets first. Its error follows from
        how much these differ by the law (a factor and a power) with which 68 of 100 places held out lie within.

        Parameters
        ----------
        disparity, sigma, picture : ndarray
            Disparities, their standard errors and the all-in-focus picture, shape (v, u).
        known : ndarray of bool
            Where there is a disparity.
        """
        joined = _joined(picture)
        held = known & ndimage.binary_dilation(~known, iterations=HELD_OUT)
        kept, rms, within, factor, power = known & ~held, np.nan, np.nan, 1.0, 1.0
        if min(kept.sum(), held.sum()) >= FEWEST:
            value, spread = _walked(disparity, sigma, kept, joined)
            held &= np.isfinite(value)
            error, apart = np.abs(value - disparity)[held], spread[held]
            factor, power = _law(apart, error)
            rms = float(np.sqrt((error**2).mean()))
            within = float((error < HARDER * factor * apart**power).mean())
        value, spread = _walked(disparity, sigma, known, joined)
        away, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
        value = np.where(away <= FARTHEST, value, np.nan)
        least = sigma[tuple(nearest)]
        widened = np.where(np.isfinite(value), np.maximum(HARDER * factor * spread**power, least), np.inf)
        return cls(np.where(known, disparity, value), np.where(known, sigma, widened), rms, within)


def _law(apart: Array, error: Array) -> tuple[float, float]:
    """Factor and power of how much known ones differ that `WITHIN` of the errors of places held out lie within."""
    parts = np.array_split(np.argsort(apart), min(PARTS, apart.size // FEWEST))
    tiny = np.finfo(float).tiny
    middle = np.log([np.median(apart[part]) + tiny for part in parts])
    typical = np.log([np.quantile(error[part], WITHIN) + tiny for part in parts])
    power = float(np.clip(np.polyfit(middle, typical, 1)[0], 0.0, 1.0)) if np.ptp(middle) > 0 else 1.0
    return float(np.quantile(error / (apart + tiny) ** power, WITHIN)), power


def _joined(picture: Array) -> sparse.csr_matrix:
    """How well neighbours hold together, shape (places, places): 1 of like brightness, less across edges."""
    index = np.arange(picture.size).reshape(picture.shape)
    step = STEP * max(float(np.median(np.abs(picture))), np.finfo(float).tiny)
    first, second, weight = [], [], []
    for a, b in (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]):
        first.append(index[a].ravel())
        second.append(index[b].ravel())
        weight.append((1 / (1 + ((picture[a] - picture[b]) / step) ** 2)).ravel())
    one, other = (np.concatenate(each).astype(np.intp) for each in (first, second))
    weights = np.concatenate(weight)
    half: sparse.csr_matrix = sparse.csr_matrix(
        (np.asarray(weights, np.float64), (one, other)), (picture.size, picture.size)
    )
    both: sparse.csr_matrix = (half + half.T).tocsr()
    return both


def _walked(disparity: Array, sigma: Array, known: Flags, joined: sparse.csr_matrix) -> tuple[Array, Array]:
    """Means of the known ones that walks meet first, and the spread of these with their errors; NaN where none is."""
    unknown, some = np.flatnonzero(~known), np.flatnonzero(known)
    means, spread = np.where(known, disparity, np.nan).ravel(), np.where(known, sigma, np.nan).ravel()
    if unknown.size and some.size:
        rows = joined[unknown]
        middle = float(np.median(disparity[known]))
        value, error = disparity.ravel()[some] - middle, sigma.ravel()[some]
        ends = rows[:, some] @ np.stack([value, value**2 + error**2], 1)
        total = sparse.diags(np.asarray(rows.sum(1)).ravel())
        mean, square = splu((total - rows[:, unknown]).tocsc()).solve(ends).T
        means[unknown], spread[unknown] = mean + middle, np.sqrt(np.maximum(square - mean**2, 0.0))
    return means.reshape(known.shape), spread.reshape(known.shape)
